// Bodies of the robot that change during a run, and those of others that its links carry.
#include <algorithm>
#include <utility>

#include "components/drive_train/drive_train.h"
#include "components/drive_train/floating_links.h"

namespace cotwin::drive_train {

double DriveTrain::energy_of_links() {
  equations_.evaluate(x_.data(), at_start_);
  const Energies e = equations_.energies(x_.data(), at_start_);
  return e.kinetic + e.potential;
}

/// As follow_drives() for the bodies, which take a changed tool at once: a tool moves with its link when it is mounted and when it is
/// removed, so speeds stay and its energy and momentum come or go with it.
bool DriveTrain::follow_bodies(double remaining) {
  const bool at_once = tool_changes_ != tool_changes_seen_;
  tool_changes_seen_ = tool_changes_;
  if (!equations_.bodies().pending()) return false;
  const double before = energy_of_links();
  equations_.follow_bodies(place_, at_once ? 0 : remaining);
  if (equations_.floating()) equations_.floating()->set_velocity(x_.data(), x_.data() + n_);
  energy_bodies_ += energy_of_links() - before;
  return true;
}

/// Takes the load of this step. Returns whether it or the one before changes the equations.
bool DriveTrain::follow_load() {
  bool damped = false;
  for (std::size_t i = 0; i < load_damping_.size(); ++i) {
    double& D = equations_.parameters().D[i];
    const double before = std::exchange(D, std::max(wanted_.D[i], equations_.passive(i) ? 0 : load_damping_[i]));
    damped = damped || D != before;
  }
  const bool was_loaded = equations_.loaded();
  equations_.set_load(load_factor_);
  return damped || was_loaded || equations_.loaded();
}

}  // namespace cotwin::drive_train
