#pragma once
#include <cstdint>
#include <map>
#include <set>
#include <span>
#include <utility>
#include <vector>

namespace cotwin::testing {

/// What a line does to datagrams. Probabilities per datagram; times in ns.
struct Disturbance {
  double loss = 0;          // share that begins a burst of losses
  int burst = 1;            // datagrams lost in a row
  double duplicate = 0;     // share that comes twice
  double reorder = 0;       // share that is held back by `hold`, so that later ones overtake it
  std::int64_t delay = 0;   // of every datagram
  std::int64_t jitter = 0;  // added to the delay, uniform from 0; does not change the order
  std::int64_t hold = 0;    // of reordered ones
  std::uint64_t seed = 1;
};

/// A line for datagrams in one direction that loses, delays, doubles and reorders them: a function of seed and number of the
/// datagram, the same at any speed. Counts what leaves it, in the order in which it leaves.
class LossyLine {
 public:
  struct Counts {
    std::int64_t sent = 0, delivered = 0, lost = 0;
    std::int64_t duplicates = 0;  // delivered once more
    std::int64_t overtaken = 0;   // delivered for the first time after one that was sent later
    friend bool operator==(const Counts&, const Counts&) = default;
  };

  explicit LossyLine(const Disturbance& disturbance) : disturbance_(disturbance) {}
  void set(const Disturbance& disturbance) { disturbance_ = disturbance; }

  void push(std::int64_t now, std::span<const std::uint8_t> bytes);
  /// The next datagram that is due at `now`; empty if there is none.
  std::vector<std::uint8_t> pop(std::int64_t now);
  /// When the next datagram is due; the largest time if there is none.
  std::int64_t due() const;
  bool empty() const { return waiting_.empty(); }

  const Counts& counts() const { return counts_; }

 private:
  struct Datagram {
    std::int64_t number;
    std::vector<std::uint8_t> bytes;
  };
  void schedule(std::int64_t at, std::int64_t number, std::span<const std::uint8_t> bytes);

  Disturbance disturbance_;
  Counts counts_;
  std::map<std::pair<std::int64_t, std::int64_t>, Datagram> waiting_;  // by time, then in order of scheduling
  std::int64_t scheduled_ = 0, last_due_ = 0, newest_ = -1;
  int burst_left_ = 0;
  std::set<std::int64_t> delivered_;
};

}  // namespace cotwin::testing
