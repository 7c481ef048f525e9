#pragma once
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>

#include "components/bus/queue.h"
#include "components/bus/wake.h"

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

/// Two ends in one process, for two threads.
class LocalTransport final : public Transport {
 public:
  /// `capacity`: bytes that wait in each direction; a message that finds no room is dropped.
  static std::pair<std::unique_ptr<LocalTransport>, std::unique_ptr<LocalTransport>> make_pair(std::size_t capacity);

  bool send(std::span<const std::byte> message) override;
  std::span<const std::byte> receive() override;
  bool wait(std::int64_t deadline) override;
  std::size_t max_bytes() const override { return out_->max_bytes; }
  std::uint64_t dropped() const { return dropped_; }

 private:
  struct Direction {
    explicit Direction(std::size_t capacity) : queue(capacity), max_bytes(capacity / 2 - sizeof(std::uint64_t)) {}
    ByteQueue queue;
    Wake wake;
    std::size_t max_bytes;
  };
  LocalTransport(std::shared_ptr<Direction> out, std::shared_ptr<Direction> in) : out_(std::move(out)), in_(std::move(in)) {}

  std::shared_ptr<Direction> out_, in_;
  bool held_ = false;  // whether the queue's front is the last message that was returned
  std::uint64_t dropped_ = 0;
};

}  // namespace cotwin::bus
