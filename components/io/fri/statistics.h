#pragma once
#include <array>
#include <cstddef>
#include <cstdint>

#include "components/io/fri/fri.h"

namespace cotwin::fri {

/// Number, mean, standard deviation and range of a quantity.
class Moments {
 public:
  void add(double x);
  std::uint64_t count() const { return count_; }
  double mean() const { return mean_; }
  double deviation() const;  // 0 for fewer than two values
  double minimum() const { return minimum_; }
  double maximum() const { return maximum_; }

 private:
  std::uint64_t count_ = 0;
  double mean_ = 0, squares_ = 0, minimum_ = 0, maximum_ = 0;
};

/// How often times occurred. Bins grow by a factor 2^(1/8), from 1 µs to 1000 s, so that quantiles are exact to 9 %.
class TimeHistogram {
 public:
  void add(std::int64_t ns);
  std::uint64_t count() const { return count_; }
  /// s below which a share of the times lie, at the upper end of the bin; 0 if there is none.
  double quantile(double share) const;

 private:
  static constexpr std::size_t kPerOctave = 8, kOctaves = 30;
  std::array<std::uint64_t, kPerOctave * kOctaves> bins_{};
  std::uint64_t count_ = 0;
};

/// Finds loss, reordering and duplicates in a stream of packets with consecutive numbers.
class SequenceTracker {
 public:
  enum class Arrival : std::uint8_t {
    kNew,        // newer than all before, perhaps after a gap
    kReordered,  // a missing one of the last kWindow, after newer ones
    kDuplicate,  // one of the last kWindow, again
    kStale       // far from the others: ignored, unless another one follows, which is kNew: the sender has begun anew
  };
  static constexpr std::int64_t kWindow = 256;  // packets
  static constexpr std::int64_t kLargestGap = 32'000;
  static constexpr std::uint32_t kRepeats = 8;  // consecutive duplicates that show that the sender has begun anew

  /// `bits` of the numbers: 16 or 32.
  explicit SequenceTracker(unsigned bits) : bits_(bits) {}

  /// `silent`: nothing newer came for so long that stragglers have come, too. Then an old one that comes twice is that of a sender
  /// that has begun anew and repeats its first packet.
  Arrival add(std::uint32_t number, bool silent = false);
  /// How far a number is after the newest one; negative: before.
  std::int64_t ahead(std::uint32_t number) const {
    const unsigned shift = 32 - bits_;  // the difference as a signed number of `bits_` bits
    return static_cast<std::int32_t>((number - number_) << shift) >> shift;
  }
  /// The packet that was added last, newer than all before, is the first of a sender that has begun anew: the gap before it is
  /// no loss.
  void begin_at_newest();
  /// The next packet is of another sender.
  void forget() { started_ = false; }
  /// Position in the stream of the packet that was added last, without the wrap of its number.
  std::int64_t position() const { return position_; }
  /// The newest position.
  std::int64_t newest() const { return newest_; }

  std::uint64_t received() const { return received_; }  // kNew and kReordered
  std::uint64_t lost() const { return lost_; }          // missing up to now between the first and the newest
  std::uint64_t reordered() const { return reordered_; }
  std::uint64_t duplicates() const { return duplicates_; }
  std::uint64_t stale() const { return stale_; }
  std::uint64_t restarts() const { return restarts_; }  // of the sender

 private:
  void begin(std::uint32_t number);
  bool seen(std::int64_t position) const;
  void mark(std::int64_t position, bool seen);

  unsigned bits_;
  bool started_ = false;
  std::uint32_t number_ = 0;  // of the newest
  std::int64_t newest_ = 0, position_ = 0, first_ = 0;
  std::array<std::uint64_t, kWindow / 64> seen_{};  // bit: position modulo kWindow
  std::uint32_t after_ = 0, run_ = 0;  // packets in a row that are not newer, and the number that would continue them
  std::uint64_t received_ = 0, lost_ = 0, reordered_ = 0, duplicates_ = 0, stale_ = 0, restarts_ = 0;
  std::uint64_t gap_ = 0;  // before the newest packet
};

/// Datagrams that were not accepted, by the reason.
class FaultCounts {
 public:
  Fault add(Fault fault) {
    counts_[static_cast<std::size_t>(fault)] += fault == Fault::kNone ? 0 : 1;
    return fault;
  }
  std::uint64_t of(Fault fault) const { return counts_[static_cast<std::size_t>(fault)]; }
  std::uint64_t total() const {
    std::uint64_t sum = 0;
    for (const std::uint64_t count : counts_) sum += count;
    return sum;
  }

 private:
  std::array<std::uint64_t, kFaults> counts_{};
};

}  // namespace cotwin::fri
