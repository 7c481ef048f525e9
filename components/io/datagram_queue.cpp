#include "components/io/datagram_queue.h"

#include <algorithm>
#include <chrono>
#include <utility>

#ifndef _WIN32
#include <poll.h>
#endif

namespace cotwin::io {

std::int64_t monotonic_now() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

DatagramQueue::DatagramQueue() : slots_(kSlots) {}

void DatagramQueue::open(const net::Endpoint& local, const std::string& place) {
  if (!socket_ || wanted_ != local) {
    socket_.reset();
    socket_.emplace(local, place);
    wanted_ = local;
  }
  take();
  first_ = count_ = 0;
  stamped_ = false;
  newest_.reset();
}

void DatagramQueue::set_source(const net::Endpoint& from, unsigned bits,
                               std::function<std::optional<Stamp>(std::span<const std::uint8_t>)> stamp) {
  source_ = from;
  bits_ = bits;
  stamp_ = std::move(stamp);
}

bool DatagramQueue::is_newer(std::uint32_t number) {
  const std::int64_t range = std::int64_t{1} << bits_;
  std::int64_t ahead = (static_cast<std::int64_t>(number) - number_) & (range - 1);
  constexpr std::int64_t kOld = 256;  // datagrams; a number further back is that of a sender that has begun anew
  if (stamped_ && (ahead == 0 || ahead >= range - kOld)) return false;
  if (!stamped_) ahead = static_cast<std::int64_t>(number) - number_;
  number_ += ahead;
  stamped_ = true;
  return true;
}

void DatagramQueue::take() {
  while (socket_) {
    // The oldest datagrams are dropped: the newest ones matter.
    if (count_ == kSlots) {
      first_ = (first_ + 1) % kSlots;
      --count_;
    }
    Slot& slot = slots_[(first_ + count_) % kSlots];
    const std::optional<net::UdpSocket::Received> received = socket_->receive(slot.bytes);
    if (!received) break;
    slot.size = std::min(received->size, slot.bytes.size());
    slot.from = received->from;
    slot.arrival = received->arrival;
    ++count_;
    if (!stamp_ || !source_.covers(slot.from)) continue;
    const std::optional<Stamp> stamp = stamp_({slot.bytes.data(), slot.size});
    if (stamp && is_newer(stamp->number)) newest_ = Arrival{slot.arrival, (number_ + 1) * stamp->period};
  }
}

std::optional<DatagramQueue::Datagram> DatagramQueue::receive() {
  if (count_ == 0) return std::nullopt;
  const Slot& slot = slots_[first_];
  first_ = (first_ + 1) % kSlots;
  --count_;
  return Datagram{{slot.bytes.data(), slot.size}, slot.from, slot.arrival};
}

std::optional<Arrival> DatagramQueue::wait(std::int64_t deadline) {
  for (;;) {
    take();
    if (newest_) return std::exchange(newest_, std::nullopt);
    if (!socket_ || !sleep(deadline)) return std::nullopt;
  }
}

Arrival DatagramQueue::next_period() {
  ++number_;
  return {monotonic_now(), (number_ + 1) * period_};
}

bool DatagramQueue::wait_for_any(std::int64_t deadline) {
  take();
  while (count_ == 0 && socket_ && sleep(deadline)) take();
  return count_ > 0;
}

bool DatagramQueue::sleep(std::int64_t deadline) const {
#ifdef _WIN32
  return deadline < 0;  // only exported units run on Windows, which have no clock that waits
#else
  const std::int64_t left = std::max<std::int64_t>(deadline - monotonic_now(), 0);
  const timespec timeout{static_cast<time_t>(left / 1'000'000'000), static_cast<long>(left % 1'000'000'000)};
  pollfd file{socket_->descriptor(), POLLIN, 0};
  return ppoll(&file, 1, &timeout, nullptr) > 0;
#endif
}

}  // namespace cotwin::io
