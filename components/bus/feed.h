#pragma once
#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <thread>
#include <utility>

#include "components/bus/wake.h"
#include "models/foundation/support/error.h"

namespace cotwin::bus {

/// Records of equal length, known at run time, from one thread to several readers that come and go: the signals of a running twin.
/// publish() costs the same whatever the readers do, and never blocks or allocates. A reader that is slower than the records come
/// loses the oldest ones and is told how many.
class Feed {
 public:
  static constexpr std::size_t kMaxReaders = 64;

  /// `bytes`: of a record; `capacity` >= 2 records, rounded up to a power of two, that a reader may be behind.
  Feed(std::size_t bytes, std::size_t capacity)
      : bytes_(bytes),
        words_((bytes + 7) / 8),
        mask_(std::bit_ceil(capacity < 2 ? std::size_t{2} : capacity) - 1),
        cells_(std::make_unique<Word[]>((mask_ + 1) * (words_ + 1))) {}
  Feed(const Feed&) = delete;
  Feed& operator=(const Feed&) = delete;

  std::size_t bytes() const { return bytes_; }
  std::size_t capacity() const { return mask_ + 1; }
  /// Number of the last record, from 1; 0: none yet. From any thread.
  std::uint64_t published() const { return newest_.load(); }

  /// By the one publishing thread. `record` has bytes(), or fewer: what readers get behind its end is unspecified.
  void publish(std::span<const std::byte> record) {
    const std::uint64_t number = newest_.load(std::memory_order_relaxed) + 1;
    Word* const cell = cell_of(number);
    // A reader that sees one of the words that follow sees the odd mark, too, after it: each word is released and acquired.
    cell[0].store(2 * number - 1, std::memory_order_relaxed);
    for (std::size_t i = 0; 8 * i < record.size(); ++i) {
      std::uint64_t word = 0;
      std::memcpy(&word, record.data() + 8 * i, std::min<std::size_t>(8, record.size() - 8 * i));
      cell[1 + i].store(word, std::memory_order_release);
    }
    cell[0].store(2 * number, std::memory_order_release);
    // Sequentially consistent, as slots_ and the wakes: either a reader that enters now sees the record, or it is notified.
    newest_.store(number);
    const std::size_t slots = slots_.load();
    for (std::size_t i = 0; i < slots; ++i) notify(readers_[i]);
  }

  /// For one thread. Ends before its feed.
  class Reader {
   public:
    /// Begins with the last record, if there is one. `wake`: shared by all that a thread waits for. Throws Error if there are
    /// kMaxReaders. Also while records are published.
    explicit Reader(Feed& feed, std::shared_ptr<Wake> wake = nullptr)
        : feed_(feed), wake_(wake ? std::move(wake) : std::make_shared<Wake>()), slot_(feed.enter(wake_.get())) {
      next_ = std::max<std::uint64_t>(feed.published(), 1);
    }
    /// May wait until the publisher has left notify().
    ~Reader() { feed_.leave(slot_, wake_.get()); }
    Reader(const Reader&) = delete;
    Reader& operator=(const Reader&) = delete;

    /// Copies the oldest record that is still there and was not taken. False: there is none.
    bool take(std::span<std::byte> record) {
      for (;;) {
        const std::uint64_t newest = feed_.published();
        if (next_ > newest) return false;
        if (newest - next_ >= feed_.capacity()) skip_to(newest - feed_.mask_);
        if (feed_.copy(next_, record)) {
          ++next_;
          return true;
        }
        skip_to(next_ + 1);  // it was overwritten meanwhile
      }
    }
    /// The same for the newest record; those before it count as lost.
    bool pop_newest(std::span<std::byte> record) {
      if (!empty()) skip_to(feed_.published());
      return take(record);
    }
    bool empty() const { return next_ > feed_.published(); }
    /// Waits for a record until CLOCK_MONOTONIC reaches `deadline`, ns. False: there is none.
    bool wait(std::int64_t deadline = kNever) {
      return wake_->wait([this] { return !empty(); }, deadline);
    }
    Wake& wake() { return *wake_; }
    /// Number of the record that was taken last.
    std::uint64_t number() const { return next_ - 1; }
    std::uint64_t lost() const { return lost_; }

   private:
    void skip_to(std::uint64_t next) {
      lost_ += next - next_;
      next_ = next;
    }

    Feed& feed_;
    std::shared_ptr<Wake> wake_;
    std::size_t slot_;
    std::uint64_t next_ = 1, lost_ = 0;
  };

 private:
  using Word = std::atomic<std::uint64_t>;
  /// The wake of a reader: nullptr while the publisher notifies it, and if there is none.
  struct Slot {
    std::atomic<Wake*> wake = nullptr;
    std::atomic<bool> taken = false;
  };

  Word* cell_of(std::uint64_t number) const { return &cells_[(number & mask_) * (words_ + 1)]; }

  /// False: the record is not there any more.
  bool copy(std::uint64_t number, std::span<std::byte> record) const {
    const Word* const cell = cell_of(number);
    if (cell[0].load(std::memory_order_acquire) != 2 * number) return false;
    for (std::size_t i = 0; i < words_; ++i) {
      const std::uint64_t word = cell[1 + i].load(std::memory_order_acquire);
      std::memcpy(record.data() + 8 * i, &word, std::min<std::size_t>(8, bytes_ - 8 * i));
    }
    return cell[0].load(std::memory_order_relaxed) == 2 * number;
  }

  static void notify(Slot& slot) {
    Wake* const wake = slot.wake.exchange(nullptr);
    if (wake == nullptr) return;
    wake->notify();
    slot.wake.store(wake, std::memory_order_release);
  }
  std::size_t enter(Wake* wake) {
    for (std::size_t i = 0; i < kMaxReaders; ++i) {
      if (readers_[i].taken.exchange(true, std::memory_order_acq_rel)) continue;
      readers_[i].wake.store(wake);
      for (std::size_t n = slots_.load(); n <= i && !slots_.compare_exchange_weak(n, i + 1);) {
      }
      return i;
    }
    throw Error("bus", "a feed has " + std::to_string(kMaxReaders) + " readers, expected no more");
  }
  void leave(std::size_t i, Wake* wake) {
    for (Wake* expected = wake; !readers_[i].wake.compare_exchange_weak(expected, nullptr); expected = wake)
      std::this_thread::yield();
    readers_[i].taken.store(false, std::memory_order_release);
  }

  const std::size_t bytes_, words_, mask_;
  const std::unique_ptr<Word[]> cells_;  // per record its mark (2 · number; odd while it is written) and its words
  alignas(64) std::atomic<std::uint64_t> newest_ = 0;
  alignas(64) std::array<Slot, kMaxReaders> readers_;
  std::atomic<std::size_t> slots_ = 0;  // so many may be taken
};

}  // namespace cotwin::bus
