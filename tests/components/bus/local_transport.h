#pragma once
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <utility>

#include "components/bus/transport.h"
#include "components/bus/wake.h"

namespace cotwin::bus {

/// Messages of different lengths from one thread to one other. Wait-free.
class ByteQueue {
 public:
  /// `capacity`: bytes, rounded up to a power of two, of which each message takes its length, rounded up to 8, and 8 more. An
  /// empty queue takes every message of up to half of them.
  explicit ByteQueue(std::size_t capacity)
      : mask_(std::bit_ceil(capacity < 64 ? std::size_t{64} : capacity) - 1),
        bytes_(std::make_unique<std::byte[]>(mask_ + 1)) {}

  /// False: there is no room, and the message is not taken.
  bool push(std::span<const std::byte> message) {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    const std::size_t to_end = mask_ + 1 - (tail & mask_);
    const std::size_t size = record(message.size());
    const std::size_t skipped = size > to_end ? to_end : 0;  // a message is in one piece
    if (size > mask_ + 1 || tail + skipped + size - head_.load(std::memory_order_acquire) > mask_ + 1) return false;
    if (skipped > 0) put(tail, kSkip);
    put(tail + skipped, message.size());
    if (!message.empty()) std::memcpy(&bytes_[((tail + skipped) & mask_) + kHeader], message.data(), message.size());
    tail_.store(tail + skipped + size, std::memory_order_release);
    return true;
  }
  /// The oldest message, until drop() is called; without data if there is none.
  std::span<const std::byte> front() {
    std::size_t head = head_.load(std::memory_order_relaxed);
    if (empty()) return {};
    if (get(head) == kSkip) {
      head += mask_ + 1 - (head & mask_);
      head_.store(head, std::memory_order_release);
    }
    return {&bytes_[(head & mask_) + kHeader], get(head)};
  }
  /// Removes the message of the last front().
  void drop() {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    head_.store(head + record(get(head)), std::memory_order_release);
  }
  /// By the reader.
  bool empty() const { return head_.load(std::memory_order_relaxed) == tail_.load(std::memory_order_acquire); }

 private:
  static constexpr std::size_t kHeader = sizeof(std::uint64_t);
  static constexpr std::uint64_t kSkip = ~std::uint64_t{0};
  static std::size_t record(std::size_t size) { return kHeader + (size + 7) / 8 * 8; }
  void put(std::size_t at, std::uint64_t value) { std::memcpy(&bytes_[at & mask_], &value, sizeof value); }
  std::uint64_t get(std::size_t at) const {
    std::uint64_t value;
    std::memcpy(&value, &bytes_[at & mask_], sizeof value);
    return value;
  }

  const std::size_t mask_;
  const std::unique_ptr<std::byte[]> bytes_;
  alignas(64) std::atomic<std::size_t> tail_ = 0;
  alignas(64) std::atomic<std::size_t> head_ = 0;
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

inline std::pair<std::unique_ptr<LocalTransport>, std::unique_ptr<LocalTransport>> LocalTransport::make_pair(
    std::size_t capacity) {
  const auto there = std::make_shared<Direction>(capacity), back = std::make_shared<Direction>(capacity);
  return {std::unique_ptr<LocalTransport>(new LocalTransport(there, back)),
          std::unique_ptr<LocalTransport>(new LocalTransport(back, there))};
}

inline bool LocalTransport::send(std::span<const std::byte> message) {
  const bool taken = out_->queue.push(message);
  if (!taken) ++dropped_;
  out_->wake.notify();
  return taken;
}

inline std::span<const std::byte> LocalTransport::receive() {
  if (held_) in_->queue.drop();
  const std::span<const std::byte> message = in_->queue.front();
  held_ = !message.empty();
  return message;
}

inline bool LocalTransport::wait(std::int64_t deadline) {
  if (held_) in_->queue.drop();
  held_ = false;
  return in_->wake.wait([this] { return !in_->queue.empty(); }, deadline);
}

}  // namespace cotwin::bus
