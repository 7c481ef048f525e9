#pragma once
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "components/bus/queue.h"

namespace cotwin::bus {

/// Consistent cuts over several state databases: one thread adds their images as they arrive, another one takes the newest instant
/// at which all of them are known. It sees the states of one epoch and of one life of their owner, never a mixture, and never waits.
class StateCut {
 public:
  struct Database {
    std::size_t bytes = 0;
    std::int64_t period = 1;  // a publication holds for the epochs e … e + period − 1: 1 if there is one in each epoch
    std::size_t owner = 0;    // databases with the same number are of one program and have the same session
  };
  static constexpr std::int64_t kNone = std::numeric_limits<std::int64_t>::min();

  /// `depth`: publications that are kept of each database, for those that arrive later than others.
  explicit StateCut(std::vector<Database> databases, std::size_t depth = 8);

  /// By the writing thread: the image of a database at `epoch`, not before the last one of the same session. Another session is a new
  /// life of the owner: what is known of the earlier one is forgotten, and epochs may begin anew. No cut has two sessions of one
  /// owner. Owners whose epochs are to be compared need a common time. Sessions must not return: StateReplica follows none that has
  /// ended.
  void add(std::size_t database, std::uint64_t session, std::int64_t epoch, std::span<const std::byte> image);

  /// By the reading thread: takes the newest cut; false: there is none since the last call.
  bool take();
  /// The epoch of the cut that was taken; kNone before the first one.
  std::int64_t epoch() const;
  /// Image of a database in the cut, session and epoch of its publication.
  std::span<const std::byte> image(std::size_t database) const;
  std::uint64_t session(std::size_t database) const;
  std::int64_t published(std::size_t database) const;

 private:
  struct History {
    Database database;
    std::size_t place = 0;             // in a cut: epoch and session of the publication, and the image behind them
    std::vector<std::int64_t> epochs;  // a ring; kNone: empty
    std::vector<std::byte> images;
    std::size_t newest = 0;
    std::uint64_t session = 0;
  };
  /// The slot of the newest publication at or before `epoch`; the depth if there is none.
  std::size_t find(const History& history, std::int64_t epoch) const;
  std::int64_t newest_cut() const;
  bool one_life() const;

  std::size_t depth_;
  std::vector<History> histories_;
  std::int64_t last_ = kNone;  // epoch of the last cut
  TripleBuffer cuts_;
};

}  // namespace cotwin::bus
