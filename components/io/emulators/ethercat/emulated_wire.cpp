#include "components/io/emulators/ethercat/emulated_wire.h"

#include <algorithm>

namespace cotwin::ethercat {

bool EmulatedWire::send(std::span<const std::uint8_t> frame) {
  now_ += turnaround_;
  if (frame.size() > kLongestFrame) return false;
  if (unplugged_) return true;
  Pending copy;
  std::copy(frame.begin(), frame.end(), copy.bytes.begin());
  copy.size = frame.size();
  const std::optional<std::int64_t> back = bus_.transmit(std::span(copy.bytes).first(copy.size), now_);
  if (!back) return true;
  if (count_ == pending_.size()) {  // as a full receive queue: the oldest frame is dropped
    first_ = (first_ + 1) % pending_.size();
    --count_;
  }
  copy.at = *back + turnaround_;
  pending_[(first_ + count_) % pending_.size()] = copy;
  ++count_;
  return true;
}

std::size_t EmulatedWire::receive(std::span<std::uint8_t> buffer, std::int64_t deadline) {
  while (count_ > 0) {
    const Pending& p = pending_[first_];
    if (p.at > std::max(deadline, now_)) break;
    now_ = std::max(now_, p.at);
    received_at_ = p.at;
    const std::size_t size = p.size;
    if (size <= buffer.size()) std::copy_n(p.bytes.begin(), size, buffer.begin());
    first_ = (first_ + 1) % pending_.size();
    --count_;
    if (size <= buffer.size()) return size;
  }
  if (deadline > now_) advance_to(deadline);
  return 0;
}

void EmulatedWire::advance_to(std::int64_t now) {
  if (now <= now_) return;
  now_ = now;
  bus_.advance(now_);
}

}  // namespace cotwin::ethercat
