#include "components/io/links/rtde_line.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "components/io/link/datagram_queue.h"

#ifndef _WIN32
#include <poll.h>
#endif

namespace cotwin::io {

namespace {

constexpr int kPieces = 64;  // of the stream at once, so that a robot that sends without end does not hold the scenario up
constexpr std::int64_t kRetry = 500'000'000, kPatience = 2'000'000'000;  // ns

bool sleep(int descriptor, bool connecting, std::int64_t until) {
#ifdef _WIN32
  return descriptor < 0 && !connecting && until < 0;  // only exported units run on Windows, which have no clock that waits
#else
  const std::int64_t left = std::max<std::int64_t>(until - monotonic_now(), 0);
  const timespec timeout{static_cast<time_t>(left / 1'000'000'000), static_cast<long>(left % 1'000'000'000)};
  pollfd file{descriptor, static_cast<short>(connecting ? POLLOUT : POLLIN), 0};
  return ppoll(&file, descriptor >= 0 ? 1 : 0, &timeout, nullptr) >= 0;  // false: a signal
#endif
}

}  // namespace

void RtdeLine::open(const net::Endpoint& controller, const rtde::ClientSettings& settings, std::int64_t silence,
                    const std::string& place) {
  stream_.close();
  controller_ = controller;
  client_.emplace(settings, place);
  period_ = std::llround(1e9 / settings.frequency);
  retry_ = 0;
  set_ups_ = 0;
  silence_ = silence;
  was_running_ = connecting_ = stamped_ = false;
  number_ = -1;
  reason_ = "not connected yet";
  culprit_ = {};
  serve();
}

void RtdeLine::end(const char* reason, std::string_view culprit) {
  reason_ = reason;
  culprit_ = culprit;
  stream_.close();
  client_->close();
  was_running_ = connecting_ = false;
  retry_ = monotonic_now() + kRetry;
}

bool RtdeLine::serve() {
  using State = net::TcpStream::State;
  rtde::Client& c = *client_;
  const std::int64_t now = monotonic_now();
  State state = stream_.state();
  if (state == State::kClosed) {
    if (connecting_) end("nobody answers");
    if (c.state() != rtde::Client::State::kIdle) end("the controller has ended the connection");
    if (now < retry_) return false;
    stream_ = net::TcpStream::connect(controller_);
    patience_ = now + kPatience;
    connecting_ = true;
    state = stream_.state();
  }
  if (state == State::kClosed || (state == State::kConnecting && now > patience_)) end("nobody answers");
  if (state != State::kOpen) return false;
  connecting_ = false;
  if (c.state() == rtde::Client::State::kIdle) c.open(now);
  const std::span<std::uint8_t> space = c.space();
  const std::size_t size = stream_.receive(space);
  c.received(size);
  c.set_up(now);
  if (size > 0 || space.empty() || !c.running()) heard_ = now;
  if (c.running() && !was_running_) ++set_ups_;
  was_running_ = c.running();
  c.sent(stream_.send(c.waiting()));
  if (c.state() == rtde::Client::State::kFailed) end(c.reason(), c.culprit());
  if (c.running() && now - heard_ > silence_) end("the controller is silent");
  return size > 0;
}

std::int64_t RtdeLine::source_time(double timestamp) {
  const double frequency = 1e9 / static_cast<double>(period_);
  if (!stamped_ || timestamp < last_stamp_ || timestamp - last_stamp_ > rtde::kLongestPause) {
    first_stamp_ = timestamp;
    first_number_ = number_ + 1;
    stamped_ = true;
  }
  last_stamp_ = timestamp;
  const std::int64_t most = std::numeric_limits<std::int64_t>::max() / period_ - 2;
  const std::int64_t cycles = std::llround((timestamp - first_stamp_) * frequency);
  number_ = std::min(std::max(number_, first_number_ + cycles), most);
  return (number_ + 1) * period_;
}

std::optional<Arrival> RtdeLine::wait(std::int64_t deadline) {
  for (;;) {
    std::optional<double> stamp;
    int pieces = 0;
    do {
      if (const std::optional<double> newer = client_->look_ahead()) stamp = newer;
      client_->make_room(monotonic_now());
    } while (++pieces < kPieces && serve() && client_->running());
    const std::int64_t now = monotonic_now();
    if (stamp) return Arrival{now, source_time(*stamp)};
    if (client_->running() && client_->senseless()) end("the stream of the controller cannot be read");
    if (now >= deadline) return std::nullopt;
    const bool connecting = stream_.state() == net::TcpStream::State::kConnecting;
    const bool closed = stream_.state() == net::TcpStream::State::kClosed;
    if (!sleep(stream_.descriptor(), connecting, std::min(deadline, closed ? std::max(retry_, now) : now + kRetry)))
      return std::nullopt;
  }
}

}  // namespace cotwin::io
