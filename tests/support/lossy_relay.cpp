#include "tests/support/lossy_relay.h"

#include <poll.h>

#include <algorithm>
#include <chrono>
#include <vector>

namespace cotwin::testing {

LossyRelay::LossyRelay() : robot_side_({0x7f000001, 0}, "relay"), twin_side_({0x7f000001, 0}, "relay") {}

void LossyRelay::set(const Disturbance& disturbance) {
  const std::lock_guard lock(mutex_);
  wanted_ = disturbance;
  new_ = true;
}

void LossyRelay::apply() {
  if (!new_.exchange(false)) return;
  const std::lock_guard lock(mutex_);
  down_.set(wanted_);
  Disturbance other = wanted_;
  ++other.seed;
  up_.set(other);
}

void LossyRelay::run(const net::Endpoint& twin, const std::atomic<bool>& end) {
  using Clock = std::chrono::steady_clock;
  constexpr std::int64_t kLongestWait = 10'000'000;  // ns
  std::vector<std::uint8_t> buffer(2048);
  net::Endpoint robot;
  while (!end) {
    apply();
    while (const auto datagram = robot_side_.receive(buffer)) {
      robot = datagram->from;
      down_.push(datagram->arrival, std::span(buffer).first(datagram->size));
    }
    while (const auto datagram = twin_side_.receive(buffer))
      up_.push(datagram->arrival, std::span(buffer).first(datagram->size));
    const std::int64_t now = std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
    while (down_.due() <= now) twin_side_.send(down_.pop(now), twin);
    while (up_.due() <= now) {
      robot_side_.send(up_.pop(now), robot);
      last_up_ = now;
    }
    const std::int64_t wait = std::clamp<std::int64_t>(std::min(down_.due(), up_.due()) - now, 0, kLongestWait);
    const timespec timeout{0, static_cast<long>(wait)};
    pollfd files[] = {{robot_side_.descriptor(), POLLIN, 0}, {twin_side_.descriptor(), POLLIN, 0}};
    ppoll(files, 2, &timeout, nullptr);
  }
}

}  // namespace cotwin::testing
