#pragma once
#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <type_traits>

/// Bounded queues between threads. None of the functions blocks or allocates after the constructor.
namespace cotwin::bus {

/// A queue from one thread to one other. Wait-free.
template <class T>
class SpscQueue {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  /// `capacity` ≥ 1 is rounded up to a power of two.
  explicit SpscQueue(std::size_t capacity)
      : mask_(std::bit_ceil(capacity < 1 ? 1 : capacity) - 1), cells_(std::make_unique<T[]>(mask_ + 1)) {}

  std::size_t capacity() const { return mask_ + 1; }
  /// False: the queue is full, and the value is not taken.
  bool push(const T& value) {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - known_head_ > mask_) {
      known_head_ = head_.load(std::memory_order_acquire);
      if (tail - known_head_ > mask_) return false;
    }
    cells_[tail & mask_] = value;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }
  /// False: the queue is empty.
  bool pop(T& value) {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (empty()) return false;
    value = cells_[head & mask_];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }
  /// By the reader.
  bool empty() const { return head_.load(std::memory_order_relaxed) == tail_.load(std::memory_order_acquire); }

 private:
  const std::size_t mask_;
  const std::unique_ptr<T[]> cells_;
  alignas(64) std::atomic<std::size_t> tail_ = 0;  // values pushed
  std::size_t known_head_ = 0;                     // the writer's copy of head_, perhaps too small
  alignas(64) std::atomic<std::size_t> head_ = 0;  // values popped
};

/// A queue from several threads to one. A writer that is interrupted within push() delays the values behind its own until it goes
/// on; it delays no other writer.
template <class T>
class MpscQueue {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  /// `capacity` ≥ 1 is rounded up to a power of two, at least 2.
  explicit MpscQueue(std::size_t capacity)
      : mask_(std::bit_ceil(capacity < 2 ? 2 : capacity) - 1), cells_(std::make_unique<Cell[]>(mask_ + 1)) {
    for (std::size_t i = 0; i <= mask_; ++i) cells_[i].turn.store(i, std::memory_order_relaxed);
  }

  std::size_t capacity() const { return mask_ + 1; }
  /// False: the queue is full, and the value is not taken.
  bool push(const T& value) {
    std::size_t tail = tail_.load(std::memory_order_relaxed);
    for (;;) {
      Cell& cell = cells_[tail & mask_];
      const std::size_t turn = cell.turn.load(std::memory_order_acquire);
      if (turn == tail) {
        if (!tail_.compare_exchange_weak(tail, tail + 1, std::memory_order_relaxed)) continue;
        cell.value = value;
        cell.turn.store(tail + 1, std::memory_order_release);
        return true;
      }
      if (static_cast<std::ptrdiff_t>(turn - tail) < 0) return false;
      tail = tail_.load(std::memory_order_relaxed);
    }
  }
  /// False: the queue is empty.
  bool pop(T& value) {
    if (empty()) return false;
    Cell& cell = cells_[head_ & mask_];
    value = cell.value;
    cell.turn.store(head_ + mask_ + 1, std::memory_order_release);
    ++head_;
    return true;
  }
  /// By the reader.
  bool empty() const { return cells_[head_ & mask_].turn.load(std::memory_order_acquire) != head_ + 1; }

 private:
  struct Cell {
    std::atomic<std::size_t> turn;  // number of the push that may write it; that + 1: it can be read
    T value;
  };
  const std::size_t mask_;
  const std::unique_ptr<Cell[]> cells_;
  alignas(64) std::atomic<std::size_t> tail_ = 0;
  alignas(64) std::size_t head_ = 0;
};

/// The latest value of up to 62 threads, for one reader. Lock-free: a free slot is written and then exchanged with the latest one.
template <class T>
class LatestValue {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  static constexpr std::size_t kMaxWriters = 62;
  /// `writers`: threads that may be within set() at once, at most kMaxWriters.
  explicit LatestValue(std::size_t writers)
      : cells_(std::make_unique<T[]>(writers + 2)), free_(~std::uint64_t{0} >> (62 - writers)) {}

  /// Returns true if a value that was not taken has been replaced.
  bool set(const T& value) {
    std::uint64_t free = free_.load(std::memory_order_acquire);
    while (!free_.compare_exchange_weak(free, free & (free - 1), std::memory_order_acquire)) {
    }
    const int slot = std::countr_zero(free);
    cells_[static_cast<std::size_t>(slot)] = value;
    const int replaced = latest_.exchange(slot, std::memory_order_acq_rel);
    if (replaced < 0) return false;
    release(replaced);
    return true;
  }
  /// False: no value since the last call.
  bool take(T& value) {
    const int slot = latest_.exchange(-1, std::memory_order_acq_rel);
    if (slot < 0) return false;
    value = cells_[static_cast<std::size_t>(slot)];
    release(slot);
    return true;
  }
  bool empty() const { return latest_.load(std::memory_order_acquire) < 0; }

 private:
  void release(int slot) { free_.fetch_or(std::uint64_t{1} << slot, std::memory_order_release); }

  const std::unique_ptr<T[]> cells_;
  alignas(64) std::atomic<std::uint64_t> free_;  // a bit per slot; each writer and the reader hold at most one, latest_ one
  alignas(64) std::atomic<int> latest_ = -1;
};

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

/// Bytes of a fixed number from one thread to one other, which always sees a whole publication: the writer fills one of three
/// buffers while the reader has another. Wait-free.
class TripleBuffer {
 public:
  explicit TripleBuffer(std::size_t size)
      : size_(size), bytes_(std::make_unique<std::byte[]>(3 * size)), back_(0), front_(2), middle_(1) {}

  /// By the writer: the buffer to be filled. Its content is that of some earlier publication.
  std::span<std::byte> back() { return {&bytes_[back_ * size_], size_}; }
  void publish() { back_ = middle_.exchange(back_ | kNew, std::memory_order_acq_rel) & ~kNew; }
  /// By the reader: takes the last publication; false: there is none since the last call.
  bool take() {
    if (empty()) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & ~kNew;
    return true;
  }
  bool empty() const { return (middle_.load(std::memory_order_acquire) & kNew) == 0; }
  std::span<const std::byte> front() const { return {&bytes_[front_ * size_], size_}; }

 private:
  static constexpr std::size_t kNew = 4;
  const std::size_t size_;
  const std::unique_ptr<std::byte[]> bytes_;
  alignas(64) std::size_t back_;
  alignas(64) std::size_t front_;
  alignas(64) std::atomic<std::size_t> middle_;
};

}  // namespace cotwin::bus
