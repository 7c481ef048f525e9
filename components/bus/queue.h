#pragma once
#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
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
