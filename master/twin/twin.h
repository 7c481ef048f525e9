#pragma once
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "components/unit/unit.h"
#include "master/run/engine.h"
#include "master/run/step_control.h"
#include "master/ssp/scenario.h"

namespace cotwin::master {

/// A whole scenario as one unit: the robot, not its parts. Its variables are those of all components, "drive.tau_J", "_" for
/// what the name of a variable may not have (and one more behind where that makes two alike):
///   input      an input with an element that no connection feeds; held over a step
///   output     what stands in `outputs`
///   parameter, tunable   as the components have them, but for those that a connection gives their value
///   state      everything else: other outputs, inputs that are fed, states
/// The scenario's events happen at their times. A step is made in ticks of the scenario: a whole number of them is stepped as a
/// run of the scenario steps it, bit for bit; any other length is cut into the fewest equal ticks that are not longer. Time may
/// start anywhere and has no end. A tick that a component discards is made in 2 … 1024 parts, as the master makes it; where a
/// component cannot be taken back, or the parts do not help, the step is discarded. When a component asks for the end of the
/// run, the tick in which it does is the last.
class Twin final : public Unit {
 public:
  /// `members`: the scenario's components with their start values; `outputs`: names as the recording has them;
  /// `states_leave`: no component has states that only this instance could take back. Throws Error for what the wiring refuses.
  Twin(Scenario scenario, std::vector<Member> members, const std::set<std::string>& outputs, bool states_leave = true);

  void declare(Variables& variables) override;
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  void restored() override;
  void save_memory(std::string& bytes) override;
  void restore_memory(const std::string& bytes) override;
  /// Whether a host may save states and restore them anywhere.
  bool restorable() const override { return can_go_back_ && states_leave_; }
  void tell(std::vector<std::string>& notes) const override;

 private:
  /// A tick since the checkpoint, and what the host had written before it.
  struct Past {
    Snapshot outside;
    Time begin, end;
  };
  Role role_of(const std::string& name, const Variable& variable) const;
  bool tick(Time begin, Time end);
  bool tick_in_parts(Time begin, Time end);
  void forget_the_past();

  Scenario scenario_;
  std::vector<Member> members_;
  std::set<std::string> outputs_;
  bool can_go_back_, states_leave_;
  std::optional<Engine> engine_;
  std::int64_t tick_ = 0;
  Variables outside_;  // what a host may write while stepping
  Checkpoint checkpoint_;
  std::vector<Past> past_;
  std::size_t past_ticks_ = 0;  // of them
  bool checkpointed_ = false;
  std::vector<std::int64_t> discarded_by_;  // per component
  int most_parts_ = 1;
};

}  // namespace cotwin::master
