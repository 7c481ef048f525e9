#pragma once
#include <array>
#include <cstdint>

#include "components/io/emulators/ethercat/bus.h"
#include "components/io/ethercat/master/wire.h"

namespace cotwin::ethercat {

/// The cable to an emulated bus in the same program. Time is simulated: waiting moves it forward.
class EmulatedWire final : public Wire {
 public:
  /// `bus` must outlive the wire. `start`: ns. `turnaround`: ns that the master's host needs for sending or receiving a frame.
  explicit EmulatedWire(Bus& bus, std::int64_t start = 0, std::int64_t turnaround = 5'000)
      : bus_(bus), now_(start), turnaround_(turnaround) {}

  bool send(std::span<const std::uint8_t> frame) override;
  std::size_t receive(std::span<std::uint8_t> buffer, std::int64_t deadline) override;
  std::int64_t now() const override { return now_; }
  std::int64_t received_at() const override { return received_at_; }

  /// Moves the time forward, with the slaves.
  void advance_to(std::int64_t now);
  /// Frames are lost from now on, as with an unplugged cable, or not any more.
  void unplug(bool unplugged) { unplugged_ = unplugged; }

 private:
  struct Pending {
    std::array<std::uint8_t, kLongestFrame> bytes;
    std::size_t size = 0;
    std::int64_t at = 0;  // ns, when it is back
  };

  Bus& bus_;
  std::int64_t now_, turnaround_, received_at_ = 0;
  std::array<Pending, 16> pending_{};  // a ring
  std::size_t first_ = 0, count_ = 0;
  bool unplugged_ = false;
};

}  // namespace cotwin::ethercat
