#pragma once
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "components/unit/unit.h"
#include "master/engine/engine.h"
#include "master/engine/step_control.h"
#include "master/scenario/scenario.h"

namespace cotwin::master {

/// A whole scenario as one unit. Its variables are those of all components, "drive.tau_J", with "_" for characters that the
/// name of a variable may not contain (and a further "_" if two names become equal):
///   input      an input with an element that no connection feeds; held over a step
///   output     the variables in `outputs`
///   parameter, tunable   as in the components, unless a connection sets them
///   state      all others: other outputs, fed inputs, states
/// The scenario's events happen at their times. A step of a whole number of ticks gives the same bits as a run of the scenario;
/// any other step is cut into the smallest number of ticks that are not longer than the scenario's and differ by at most 1 ns. Time may start
/// anywhere and has no end. A tick that a component discards is repeated in 2 … 1024 parts, as in a run; if a component cannot
/// be restored or discards the smallest parts, the step is discarded. If a component asks for the end of the run, its tick is
/// the last.
class Twin final : public Unit {
 public:
  /// `members`: the scenario's components with their start values. `outputs`: names as in the recording. `states_leave`: no
  /// component has states that only its own instance can restore. Throws Error as the wiring does.
  Twin(Scenario scenario, std::vector<Member> members, const std::set<std::string>& outputs, bool states_leave = true);

  void declare(Variables& variables) override;
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  void restored() override;
  void save_memory(std::string& bytes) override;
  void restore_memory(const std::string& bytes) override;
  /// Whether a host may save states and restore them anywhere.
  bool restorable() const override { return control_->not_restorable() == nullptr && states_leave_; }
  void append_notes(std::vector<std::string>& notes) const override;
  void end() noexcept override;

 private:
  /// A tick since the last checkpoint, with what the host had written before it.
  struct Past {
    Snapshot outside;
    Time begin, end;
  };
  void build_engine();
  Role role_of(const std::string& name, const Variable& variable) const;
  bool step_tick(Time begin, Time end);
  Past& past(std::int64_t tick) { return past_[static_cast<std::size_t>(tick) % past_.size()]; }

  Scenario scenario_;
  std::vector<Member> members_;
  std::set<std::string> outputs_;
  bool states_leave_;
  std::optional<Engine> engine_;
  std::optional<StepControl> control_;
  std::int64_t tick_ = 0;
  Variables outside_;       // that a host may write while stepping
  std::vector<Past> past_;  // by tick, modulo its size
};

}  // namespace cotwin::master
