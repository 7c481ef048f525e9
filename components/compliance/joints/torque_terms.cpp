#include "components/compliance/joints/torque_terms.h"

namespace cotwin::compliance {

TorqueTerms::TorqueTerms(std::size_t joints)
    : inertia_(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(joints))),
      coriolis_(inertia_),
      gravity_(inertia_),
      rest_(inertia_) {}

void TorqueTerms::declare(JointVariables& joints) {
  const auto reals = [](Eigen::VectorXd& v) { return std::span(v.data(), static_cast<std::size_t>(v.size())); };
  joints.output("tau_inertia", reals(inertia_), "N.m", "M ddq_c of (2a)");
  joints.output("tau_coriolis", reals(coriolis_), "N.m", "C dq_c of (2a): Coriolis and centrifugal torques");
  joints.output("tau_gravity", reals(gravity_), "N.m",
                "g of (2a); these three, tau_f and -tau_e, where it acts on the robot, together are tau_id");
}

void TorqueTerms::compute(LinkDynamics& links, const std::vector<double>& q_c, const std::vector<double>& dq_c,
                          const std::vector<double>& ddq_c) {
  using Vector = Eigen::Map<const Eigen::VectorXd>;
  const Vector q(q_c.data(), rest_.size()), dq(dq_c.data(), rest_.size()), ddq(ddq_c.data(), rest_.size());
  links.inverse_dynamics(q, dq, ddq, inertia_);
  links.inverse_dynamics(q, dq, rest_, coriolis_);
  links.gravity(q, gravity_);
  inertia_ -= coriolis_;
  coriolis_ -= gravity_;
}

}  // namespace cotwin::compliance
