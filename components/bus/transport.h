#pragma once
#include <cstddef>
#include <cstdint>
#include <span>

namespace cotwin::bus {

/// Carries messages between two programs or threads, each of which has an end. Messages may be lost, doubled and reordered, but a
/// message that arrives is whole. An end is for one thread. Nothing blocks or allocates except wait().
class Transport {
 public:
  virtual ~Transport() = default;
  /// False: not sent.
  virtual bool send(std::span<const std::byte> message) = 0;
  /// The next message, valid until the next call; empty if there is none.
  virtual std::span<const std::byte> receive() = 0;
  /// Waits until something may have arrived, or CLOCK_MONOTONIC reaches `deadline`, ns. False: the deadline came first.
  virtual bool wait(std::int64_t deadline) = 0;
  /// The largest message.
  virtual std::size_t max_bytes() const = 0;
};

}  // namespace cotwin::bus
