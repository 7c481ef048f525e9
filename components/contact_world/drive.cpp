// Where drive trains have moved the links of the robots, and the torques that drive them within a step.
#include <algorithm>

#include "components/contact_world/parts.h"
#include "models/scene/robot_links.h"

namespace cotwin::contact_world {
namespace {

/// (h ω)² of a gear and its link above which a step does not resolve their oscillation.
constexpr double kLargestResolved = 0.3;

}  // namespace

/// Sets the links to the drive train's q, q̇ at the start of the step. The world then predicts their motion by (1) under τ_J and
/// the contacts, and the mean contact torque is the τ_e of the same step of the drive train. The prediction makes stiff
/// contacts stable. The next step starts from the drive train's result, not from the prediction.
void ContactWorld::set_links(Robot& r, double h) {
  if (floating_) r.X_WB = pose_of_input(place_, r.prefix, "base_quat", r.base_p, r.base_quat);
  scene::place_links(r.placed->model, r.X_WB, r.q, r.dq, r.X_WL, r.V_WL);
  if (floating_) {
    const Eigen::Vector3d v = vector3(r.base_v), w = vector3(r.base_w);
    Twist V_WB;
    V_WB << v, w;
    world_->set_pose(r.parts.base, r.X_WB);
    world_->set_twist(r.parts.base, V_WB);
    for (std::size_t i = 0; i < r.X_WL.size(); ++i) {
      r.V_WL[i].head<3>() += v + w.cross(r.X_WL[i].p - r.X_WB.p);
      r.V_WL[i].tail<3>() += w;
    }
  }
  if (actuation_ == Actuation::kTorque && h_before_ > 0) add_correction(r);
  for (std::size_t i = 0; i < r.X_WL.size(); ++i) {
    world_->set_pose(r.parts.bodies[i], r.X_WL[i]);
    world_->set_twist(r.parts.bodies[i], r.V_WL[i]);
  }
  for (std::size_t i = 0; i < r.n; ++i) r.acceleration[i] = h_before_ > 0 ? (r.dq[i] - r.dq_before[i]) / h_before_ : 0;
  if (actuation_ == Actuation::kPrescribed) {
    apply_last_torque(r);
  } else {
    drive(r, h);
  }
  r.dq_before = r.dq;
  r.q_before = r.q;
}

/// actuation=prescribed: applies the torque that explains the last step by (2a), without the contacts.
void ContactWorld::apply_last_torque(Robot& r) {
  robot::inverse_dynamics(*r.mechanism, *r.data, r.vector(r.q), r.vector(r.dq), r.vector(r.acceleration),
                          Eigen::Map<Eigen::VectorXd>(r.tau.data(), static_cast<Eigen::Index>(r.n)));
  for (std::size_t i = 0; i < r.n; ++i) {
    world_->set_inertia(r.parts.joints[i], 0);
    world_->set_tau(r.parts.joints[i], r.tau[i] - r.tau_e[i]);
  }
}

/// τ_J at the start of the step contains K (θ − q) + D (θ̇ − q̇); its change within the step follows the motion of the link.
/// Where the step does not resolve the oscillation of link and gear, numerical damping like that of backward differences is
/// added: the two units see different phases of the oscillation and would otherwise excite each other. The damping bounds free
/// oscillations; in contact, a stiff undamped gear still makes the force alternate from step to step.
void ContactWorld::drive(Robot& r, double h) {
  if (std::any_of(r.K.begin(), r.K.end(), [](double K) { return K > 0; })) compute_mobility(r, r.q);
  for (std::size_t i = 0; i < r.n; ++i) {
    const double other = r.mean_other(i, h);
    if (r.placed->model.joints[i].passive) {
      world_->set_tau(r.parts.joints[i], other);
      continue;
    }
    const double damper = r.D[i] * (r.dtheta[i] - r.dq[i]);
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
