#pragma once
#include <span>
#include <vector>

#include "master/engine/coupling/step_growth.h"
#include "master/engine/wiring/wiring.h"

namespace cotwin::master {

/// Steps the units of a loop as with coupling=explicit: by their stages, with inputs held or continued as the master does it (class Wiring).
class ExplicitSteps final : public CoupledSteps {
 public:
  /// `group`: the members of the loop. `links`: all of the scenario; those from outside the loop are left out, their inputs keep their values.
  ExplicitSteps(const Scenario& scenario, std::span<const Member> members, const std::vector<ResolvedConnection>& links,
                std::span<const std::size_t> group);

  bool step(Time begin, Duration h) override;
  void deviate() override;
  std::span<double* const> values() const override { return values_; }
  double magnitude(std::size_t value) const override { return magnitudes_[value]; }
  std::span<ScheduledUnit* const> slots() const override { return slots_; }
  std::span<const Member> members() const override { return members_; }

 private:
  std::span<const Member> members_;
  Schedule schedule_;
  Wiring wiring_;
  std::vector<ScheduledUnit*> slots_;  // of the group, in the order of stepping
  std::vector<double*> values_;
  std::vector<double> magnitudes_;
};

}  // namespace cotwin::master
