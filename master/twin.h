#pragma once
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "components/unit/unit.h"
#include "master/engine.h"
#include "master/scenario.h"

namespace cotwin::master {

/// A whole scenario as one unit: the robot, not its parts. Its variables are those of all components, "drive.tau_J":
///   input      an input with an element that no connection feeds; held over a step
///   output     what stands in `outputs`
///   parameter, tunable   as the components have them, but for those that a connection gives their value
///   state      everything else: other outputs, inputs that are fed, states
/// The scenario's events happen at their times. A step is made in ticks of the scenario: a whole number of them is stepped as a
/// run of the scenario steps it, bit for bit; any other length is cut into the fewest equal ticks that are not longer. Time may
/// start anywhere and has no end. A step that a component discards is discarded. When a component asks for the end of the run,
/// the tick in which it does is the last.
class Twin final : public Unit {
 public:
  /// `members`: the scenario's components with their start values; `outputs`: names as the recording has them. Throws Error for
  /// what the wiring refuses.
  Twin(Scenario scenario, std::vector<Member> members, const std::set<std::string>& outputs);

  void declare(Variables& variables) override;
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  void restored() override;
  void save_memory(std::string& bytes) override;
  void restore_memory(const std::string& bytes) override;
  bool restorable() const override;

 private:
  Role role_of(const std::string& name, const Variable& variable) const;

  Scenario scenario_;
  std::vector<Member> members_;
  std::set<std::string> outputs_;
  std::optional<Engine> engine_;
  std::int64_t tick_ = 0;
};

}  // namespace cotwin::master
