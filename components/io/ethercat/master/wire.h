#pragma once
#include <cstddef>
#include <cstdint>
#include <span>

namespace cotwin::ethercat {

/// The cable between a master and its first slave: a network interface, or an emulated bus. Times are ns of one clock that never
/// goes back (CLOCK_MONOTONIC, or simulated time). Implementations allocate nothing after construction.
class Wire {
 public:
  virtual ~Wire() = default;
  /// Sends a frame. Returns false if it cannot be sent (cable unplugged, queue full).
  virtual bool send(std::span<const std::uint8_t> frame) = 0;
  /// Receives the next frame into `buffer` and returns its length in bytes; 0 if none came until `deadline` or a signal ended
  /// the wait. A deadline in the past asks for what has come. A frame longer than `buffer` is dropped.
  virtual std::size_t receive(std::span<std::uint8_t> buffer, std::int64_t deadline) = 0;
  virtual std::int64_t now() const = 0;
  /// When the frame that receive() returned last had arrived.
  virtual std::int64_t received_at() const = 0;
};

}  // namespace cotwin::ethercat
