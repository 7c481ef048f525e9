#include "components/io/link/datagram_queue.h"

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

DatagramQueue::DatagramQueue() : slots_(kSlots + 1) {}

void DatagramQueue::open(const net::Endpoint& local, const std::string& place) {
  if (!socket_ || wanted_ != local) {
    socket_.reset();
    socket_.emplace(local, place);
    wanted_ = local;
  }
  sender_ = {};
  take();
  first_ = count_ = 0;
  strangers_ = displaced_ = 0;
  stamped_ = skips_ = false;
  newest_.reset();
  last_old_.reset();
  newest_at_ = heard_ = 0;
  silence_ = std::numeric_limits<std::int64_t>::max();
}

void DatagramQueue::set_source(const net::Endpoint& from, unsigned bits,
                               std::function<std::optional<Stamp>(std::span<const std::uint8_t>)> stamp) {
  source_ = from;
  bits_ = bits;
  stamp_ = std::move(stamp);
}

bool DatagramQueue::is_newer(std::uint32_t number, const net::Endpoint& from, std::int64_t arrival) {
  heard_ = std::max(heard_, arrival);
  const std::int64_t range = std::int64_t{1} << bits_;
  const std::int64_t ahead = (static_cast<std::int64_t>(number) - number_) & (range - 1);
  constexpr std::int64_t kOld = 256;       // datagrams; a number further back is that of a sender that has begun anew
  constexpr std::int64_t kAnew = 1 << 20;  // further than any loss
  if (!stamped_) {
    position_ = number;
  } else if (from != from_) {
    position_ += kAnew;
  } else if (ahead != 0 && ahead < range - kOld) {
    position_ += skips_ ? 1 : ahead;
  } else {
    if (ahead == 0 || arrival - newest_at_ <= silence_ || !begins_anew(number)) return false;
    position_ += kAnew;
  }
  number_ = number;
  from_ = from;
  newest_at_ = arrival;
  last_old_.reset();
  stamped_ = true;
  skips_ = false;
  return true;
}

/// Whether a number that is not newer is the second one of a sender that repeats its first datagram, or goes on after it.
bool DatagramQueue::begins_anew(std::uint32_t number) {
  const bool second = last_old_ && (number == *last_old_ || number == *last_old_ + 1);
  last_old_ = number;
  return second;
}

void DatagramQueue::take() {
  for (int taken = 0; socket_ && taken < kMostTaken; ++taken) {
    // The slot after the newest datagram; if all are taken, the spare one.
    Slot& slot = slots_[(first_ + count_) % slots_.size()];
    const std::optional<net::UdpSocket::Received> received = socket_->receive(slot.bytes);
    if (!received) break;
    if (!sender_.covers(received->from) && received->arrival - heard_ <= silence_) {
      ++strangers_;
      continue;
    }
    slot.size = std::min(received->size, slot.bytes.size());
    slot.from = received->from;
    slot.arrival = received->arrival;
    if (count_ < kSlots) {
      ++count_;
    } else {  // the newest ones matter
      first_ = (first_ + 1) % slots_.size();
      ++displaced_;
    }
    if (!stamp_ || !source_.covers(slot.from)) continue;
    const std::optional<Stamp> stamp = stamp_({slot.bytes.data(), slot.size});
    if (stamp && is_newer(stamp->number, slot.from, slot.arrival)) {
      newest_ = Arrival{slot.arrival, (position_ + 1) * stamp->period};
    }
  }
}

std::optional<DatagramQueue::Datagram> DatagramQueue::receive() {
  if (count_ == 0) return std::nullopt;
  const Slot& slot = slots_[first_];
  first_ = (first_ + 1) % slots_.size();
  --count_;
  return Datagram{{slot.bytes.data(), slot.size}, slot.from, slot.arrival};
}

std::optional<Arrival> DatagramQueue::wait(std::int64_t deadline) {
  for (;;) {
    take();
    if (newest_) return std::exchange(newest_, std::nullopt);
    if (!socket_ || monotonic_now() >= deadline || !sleep(deadline)) return std::nullopt;
  }
}

Arrival DatagramQueue::next_period(std::int64_t numbers) {
  position_ += numbers;
  return {monotonic_now(), (position_ + 1) * (period_ / numbers)};
}

bool DatagramQueue::wait_for_any(std::int64_t deadline) {
  take();
  while (count_ == 0 && socket_ && monotonic_now() < deadline && sleep(deadline)) take();
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
