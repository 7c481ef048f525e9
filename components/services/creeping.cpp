#include <algorithm>
#include <cmath>

#include "components/services/services.h"
#include "models/foundation/support/text.h"
#include "models/robot/drives/rigid_friction.h"

namespace cotwin::services {

std::string creeping(const optimisation::Problem& p, const optimisation::Solution& motion) {
  constexpr double kFar = 10, kNearly = 0.9;
  double needed = 0;  // s
  for (const optimisation::Peak& peak : motion.peaks) {
    if (peak.bound == "dq") needed = std::max(needed, motion.T * peak.share);
    if (peak.bound == "ddq") needed = std::max(needed, motion.T * std::sqrt(peak.share));
    if (peak.bound == "dddq") needed = std::max(needed, motion.T * std::cbrt(peak.share));
  }
  if (!(needed > 0) || motion.T <= kFar * needed) return "";
  const std::size_t n = p.robot.joints.size();
  const robot::LoadedDynamics dynamics(p.robot, p.loads);
  robot::LoadedDynamics::Scratch scratch(dynamics);
  std::vector<double> q(n), dq(n), ddq(n);
  Eigen::VectorXd gravity(p.robot.n());
  double most = 0, torque = 0, t = 0;
  std::size_t joint = 0;
  constexpr int kPlaces = 400;
  for (int i = 0; i <= kPlaces; ++i) {
    const double along = static_cast<double>(i) / kPlaces, at = motion.T * along;
    motion.path.at(at, q, dq, ddq);
    const Eigen::Map<const Eigen::VectorXd> posture(q.data(), p.robot.n());
    robot::gravity(dynamics.mechanism(along), scratch.data, posture, gravity);
    gravity -= dynamics.wrench_torque(scratch, along, posture);
    for (std::size_t j = 0; j < n; ++j) {
      const auto term = [j](const std::vector<double>& values) { return values.empty() ? 0.0 : values[j]; };
      const double own =
          gravity[static_cast<Eigen::Index>(j)] +
          robot::rigid_friction(term(p.drives.tau_C), 0, term(p.drives.tau_0), robot::coulomb_sign(dq[j]), dq[j]);
      if (const double share = std::abs(own) / p.bounds.tau[j]; share > most) {
        most = share;
        torque = std::abs(own);
        t = at;
        joint = j;
      }
    }
  }
  if (most < kNearly) return "";
  const robot::Joint& own = p.robot.joints[joint];
  const bool revolute = own.type == robot::JointType::kRevolute;
  const std::string unit = revolute ? " N m" : " N";
  std::string note = "the motion creeps: " + text::to_text(motion.T, 4) + " s are " + text::to_text(motion.T / needed, 3) +
                     " times the " + text::to_text(needed, 4) +
                     " s that speed, acceleration and jerk need, because gravity and " + "Coulomb friction of joint " +
                     own.name + " take " + text::to_text(torque, 5) + unit + " of " + text::to_text(p.bounds.tau[joint], 5) +
                     unit + " at " + text::to_text(t, 4) + " s";
  if (most > 1)
    note += std::string("; it is feasible only because friction counts in part below 0.001 ") + (revolute ? "rad/s" : "m/s") +
            ", a real robot would stand still";
  return note;
}

}  // namespace cotwin::services
