#pragma once
#include <vector>

#include "components/unit/snapshot.h"
#include "master/run/events.h"
#include "master/run/schedule.h"
#include "models/support/bytes.h"

/// Going back: what must be kept of a whole system to be at an earlier instant again.
namespace cotwin::master {

inline constexpr int kMostParts = 1024;  // into which a tick is cut
/// Ticks between two checkpoints. A solver of Model Exchange begins afresh where it is saved: a run and the same scenario as
/// one FMU have the same bits only if both save at the same ticks.
inline constexpr std::int64_t kCheckpointEvery = 256;

class Checkpoint {
 public:
  /// Allocates only the first time.
  void take(std::int64_t tick, std::span<const Member> members, const Schedule& schedule, const Events& events);
  void restore(std::span<const Member> members, Schedule& schedule, Events& events) const;
  /// The tick that was about to begin; −1: nothing taken yet.
  std::int64_t tick() const { return tick_; }

  /// As bytes that another process can read, without a state that a foreign FMU only keeps itself.
  void write(ByteWriter& out) const;
  /// Throws Error for bytes that are cut short or damaged, or of another scenario.
  void read(ByteReader& in, std::span<const Member> members, const Schedule& schedule, const Events& events);

 private:
  struct Progress {
    Time time;
    Duration last_step;
  };
  std::int64_t tick_ = -1;
  std::vector<Snapshot> snapshots_;
  std::vector<Progress> progress_;
  Events::Bookmark events_;
};

/// All real outputs of a system in one row, to hold two ways of stepping against each other.
class OutputError {
 public:
  /// `tolerance`: relative to the largest magnitude that an output has had so far, or to kFloor where that is smaller.
  OutputError(std::span<const Member> members, double tolerance);

  void remember();
  /// The largest difference between what was remembered and what is now, 1 being just within tolerance.
  double against_remembered();

  void write(ByteWriter& out) const;
  void read(ByteReader& in);

  static constexpr double kFloor = 1e-3;  // in the output's own SI measure

 private:
  struct Output {
    std::span<const double> values;
    std::size_t at;
    double scale;
  };
  std::vector<Output> outputs_;
  std::vector<double> remembered_;
  double tolerance_;
};

}  // namespace cotwin::master
