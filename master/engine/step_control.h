#pragma once
#include <functional>
#include <optional>
#include <vector>

#include "components/unit/snapshot.h"
#include "master/engine/engine.h"
#include "master/engine/input_error.h"
#include "models/foundation/support/bytes.h"

/// Repeats ticks that a unit discards or that miss a tolerance: checkpoints, replay, ticks cut into parts.
namespace cotwin::master {

inline constexpr int kMostParts = 1024;  // into which a tick is cut; fewer where a part would be shorter than 1 ns
/// Ticks between two checkpoints. A Model Exchange solver restarts where it is saved: a run and the same scenario as one FMU
/// have the same bits only if both save at the same ticks.
inline constexpr std::int64_t kCheckpointEvery = 256;
inline constexpr std::int64_t kMostWaiting = 64;  // ticks that a checkpoint may come later

/// The state of a whole system at the beginning of a tick.
class Checkpoint {
 public:
  /// Leaves out units that cannot be restored. Allocates only the first time.
  void take(std::int64_t tick, std::span<const Member> members, const Engine& engine);
  void restore(std::span<const Member> members, Engine& engine) const;
  /// The tick that was about to begin; −1 before the first take().
  std::int64_t tick() const { return tick_; }

  /// What another process can read. It lacks a state that a foreign FMU can only keep in itself.
  static auto fields(auto& c, auto each) { return each(c.tick_, c.snapshots_, c.progress_, c.events_, c.coupling_); }
  /// Throws Error for bytes that are cut short, damaged, or of another scenario.
  void read(ByteReader& in, std::span<const Member> members, const Engine& engine);

 private:
  struct Progress {
    Time time;
    Duration last_step;

    static auto fields(auto& p, auto each) { return each(p.time, p.last_step); }
  };
  std::int64_t tick_ = -1;
  std::vector<Snapshot> snapshots_;
  std::vector<Progress> progress_;  // per member
  Events::State events_;
  std::vector<double> coupling_;
};

/// Steps an engine tick by tick, for a run and for a scenario that is one unit (Twin).
class StepControl {
 public:
  /// Returns the times of a past tick, and sets the inputs that were written from outside before it.
  using Recall = std::function<Tick(std::int64_t)>;

  /// `tolerance`: 0 for none. `repeats`: see step().
  StepControl(Engine& engine, std::span<const Member> members, double tolerance, Recall recall, bool repeats);

  /// After the engine's initialise. Takes a first checkpoint, if all units can be restored, so that later ones allocate nothing.
  void initialise();

  /// The tick from which on save_checkpoint() is due; never if a unit cannot be restored.
  std::int64_t next_checkpoint() const { return next_checkpoint_; }
  /// Returns false if it waits, for at most kMostWaiting ticks, because values of a loop begin to grow.
  bool save_checkpoint(std::int64_t tick);
  /// Values were changed or restored from outside: earlier ticks cannot be replayed. The next tick begins with a checkpoint.
  void forget() {
    if (not_restorable_ == nullptr) next_checkpoint_ = careful_until_ = 0;
    last_rewound_ = -1;
  }
  /// Values jump at the beginning of the next tick, as by an event: with a tolerance its first step is short.
  void jump() { jump_ = true; }
  /// The first member that cannot be restored; nullptr if all can.
  const Member* not_restorable() const { return not_restorable_; }

  /// Steps the tick, where a unit discards it in 2, 4 … kMostParts parts; with a tolerance in steps of free length that end at
  /// events and at the end of the tick. Returns Engine::kNoSlot, or the slot that discarded the smallest parts (the first try
  /// where a unit cannot be restored). `timed`: see Engine::step. Throws Error where a tick cannot be replayed.
  ///
  /// Where values of a loop grow and a change is found (Engine::find_coupling_change), the state of the last checkpoint is restored, with the
  /// change: rewound() has its tick, which is the next one to be stepped. With `repeats`, the ticks since then are repeated here instead.
  std::size_t step(const Tick& tick, bool timed = false) {
    rewound_.reset();
    std::size_t discarded_by = input_error_ ? step_to_tolerance(tick, timed) : engine_.step(tick, 1, timed);
    if (discarded_by != Engine::kNoSlot && !input_error_) discarded_by = step_in_parts(tick, discarded_by);
    const bool goes_on = discarded_by == Engine::kNoSlot && engine_.finished_by() == Engine::kNoSlot;
    if (goes_on && engine_.watch_growth()) [[unlikely]]
      return end_growth(tick);
    return discarded_by;
  }
  /// The tick to which the last step() has gone back.
  std::optional<std::int64_t> rewound() const { return rewound_; }
  /// The tick of the last checkpoint.
  std::int64_t checkpoint() const { return checkpoint_.tick(); }

  std::int64_t discarded() const;
  /// Per member.
  const std::vector<std::int64_t>& discarded_by() const { return discarded_by_; }
  int most_parts() const { return most_parts_; }
  /// Mean number of steps of `ticks` ticks stepped to a tolerance; 1 without one.
  double mean_parts(std::int64_t ticks) const;
  /// The same with the steps that were taken back.
  double mean_tries(std::int64_t ticks) const;
  /// Outputs that jump in every step, so that they are not controlled any more.
  std::vector<std::string> noisy() const { return input_error_ ? input_error_->noisy() : std::vector<std::string>(); }
  /// Steps that missed the tolerance and were repeated; steps of the smallest length that were kept nevertheless.
  std::int64_t rejected() const { return rejected_; }
  std::int64_t tolerance_missed() const { return tolerance_missed_; }

  /// Writes the last checkpoint and all counts.
  void write(ByteWriter& out) const;
  /// Restores the state that write() wrote, and returns its tick. Throws Error as Checkpoint::read.
  std::int64_t restore(ByteReader& in);
  /// What is kept besides the last checkpoint.
  static auto fields(auto& c, auto each) {
    return each(c.careful_until_, c.discarded_by_, c.most_parts_, c.next_, c.parts_sum_, c.rejected_, c.tolerance_missed_);
  }

 private:
  std::size_t step_in_parts(const Tick& tick, std::size_t discarded_by);
  std::size_t end_growth(const Tick& tick);
  std::size_t step_to_tolerance(const Tick& tick, bool timed);
  Duration length(Duration left) const;
  void choose_next(Duration made, double error, Duration shortest, Duration longest);
  void restore_checkpoint() { checkpoint_.restore(members_, engine_); }
  void replay_until(std::int64_t tick);
  void count_discard(std::size_t slot) { ++discarded_by_[engine_.schedule.slots[slot].member]; }
  void find_next_checkpoint(std::int64_t tick);

  Engine& engine_;
  std::span<const Member> members_;
  Recall recall_;
  const Member* not_restorable_ = nullptr;
  Checkpoint checkpoint_;
  std::int64_t next_checkpoint_ = 0;
  std::int64_t careful_until_ = 0;  // every tick before this one begins with a checkpoint
  std::vector<std::int64_t> discarded_by_;
  int most_parts_ = 1;
  bool repeats_;
  std::optional<std::int64_t> rewound_;
  std::int64_t last_rewound_ = -1;
  int times_rewound_ = 0;  // to this tick

  // With a tolerance.
  double tolerance_;
  std::optional<InputError> input_error_;
  Checkpoint step_begin_;
  std::vector<double> energies_;  // of the bonds at the beginning of the step
  Duration next_{};               // length of the next step; 0: that of a first one
  bool jump_ = false;
  std::int64_t parts_sum_ = 0, rejected_ = 0, tolerance_missed_ = 0;
};

}  // namespace cotwin::master
