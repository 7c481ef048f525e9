// The torques that drive the links of the robots within a step.
#include <algorithm>

#include "components/contact_world/parts.h"

namespace cotwin::contact_world {
namespace {

/// (h ω)² of a gear and its link above which a step does not resolve their oscillation.
constexpr double kLargestResolved = 0.3;

}  // namespace

/// τ_J at the start of the step contains K (θ − q) + D (θ̇ − q̇); its change within the step follows the motion of the link.
/// Where the step does not resolve the oscillation of link and gear, numerical damping like that of backward differences is
/// added: the two units see different phases of the oscillation and would otherwise excite each other. The damping bounds free
/// oscillations; in contact, a stiff undamped gear still makes the force alternate from step to step.
void ContactWorld::drive(Robot& r, double h) {
  if (std::any_of(r.K.begin(), r.K.end(), [](double K) { return K > 0; })) compute_mobility(r, r.q);
  const bool loaded = gives_loads(r);
  for (std::size_t i = 0; i < r.n; ++i) {
    const double other = r.mean_other(i, h);
    if (r.placed->model.joints[i].passive) {
      world_->set_tau(r.parts.joints[i], other);
      continue;
    }
    const double damper = (loaded ? std::max(r.D[i], r.load_damping[i]) : r.D[i]) * (r.dtheta[i] - r.dq[i]);
    world_->set_inertia(r.parts.joints[i], r.B[i]);
    const double tau = r.tau_J[i] + r.B[i] * r.acceleration[i];  // (2b): motor and friction torque of the last step
    world_->set_tau(r.parts.joints[i], tau + other - damper, r.K[i], step_damping(r, i, h, kLargestResolved), r.dtheta[i]);
  }
}

/// Damping of the gear in a step h, N.m.s/rad, with the mobility of the links. `resolved`: (h ω)² up to which it is D.
double ContactWorld::step_damping(const Robot& r, std::size_t i, double h, double resolved) {
  const double swing = h * h * r.K[i] * r.mobility[i];  // (h ω)²
  const double numerical = swing > resolved ? h / 2 * r.K[i] * (1 - resolved / swing) : 0;
  return std::max(r.D[i], numerical);
}

void ContactWorld::compute_mobility(Robot& r, const std::vector<double>& q) {
  robot::mass_matrix(*r.mechanism, *r.data, r.vector(q), r.M);
  r.root.compute(r.M);
  r.inverse_root.setIdentity();
  r.root.matrixL().solveInPlace(r.inverse_root);
  for (std::size_t i = 0; i < r.n; ++i) r.mobility[i] = r.inverse_root.col(static_cast<Eigen::Index>(i)).squaredNorm();
}

}  // namespace cotwin::contact_world
