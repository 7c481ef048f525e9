#include "components/compliance/joints/link_dynamics.h"

namespace cotwin::compliance {

LinkDynamics::LinkDynamics(const robot::RobotModel& robot, bool floating)
    : mechanism_(robot), data_(mechanism_), bodies_(robot) {
  if (floating) floating_ = std::make_unique<Floating>(robot);
}

void LinkDynamics::inverse_dynamics(const robot::VectorIn& q, const robot::VectorIn& dq, const robot::VectorIn& a,
                                    robot::VectorOut tau) {
  if (!floating_) return robot::inverse_dynamics(mechanism_, data_, q, dq, a, tau);
  Floating& f = *floating_;
  floating_inertia(f.mechanism, f.data, q, f.inertia);
  reduced_inverse_dynamics(f.mechanism, f.data, f.inertia, q, dq, a, spin_, Wrench::Zero(), tau);
}

void LinkDynamics::inverse_dynamics(const States& q, const States& dq, const States& a, States& tau) {
  robot::inverse_dynamics_batch(mechanism_, data_, static_cast<std::size_t>(q.rows()), q.data(), dq.data(), a.data(),
                                tau.data());
}

void LinkDynamics::mass_matrix(const robot::VectorIn& q, robot::MatrixOut M) {
  if (!floating_) return robot::mass_matrix(mechanism_, data_, q, M);
  floating_inertia(floating_->mechanism, floating_->data, q, floating_->inertia);
  M = floating_->inertia.M_star;
}

void LinkDynamics::coriolis_matrix(const robot::VectorIn& q, const robot::VectorIn& dq, robot::MatrixOut C) {
  if (!floating_) return robot::coriolis_matrix(mechanism_, data_, q, dq, C);
  Floating& f = *floating_;
  floating_inertia(f.mechanism, f.data, q, f.inertia);
  reduced_coriolis_matrix(f.mechanism, f.data, f.inertia, q, dq, spin_, C);
}

void LinkDynamics::gravity(const robot::VectorIn& q, robot::VectorOut g) {
  if (!floating_) return robot::gravity(mechanism_, data_, q, g);
  g.setZero();
}

Pose LinkDynamics::forward_kinematics(const robot::VectorIn& q, const robot::FrameOnBody& frame) {
  return robot::forward_kinematics(mechanism_, data_, q, frame);
}

Pose LinkDynamics::jacobian(const robot::VectorIn& q, const robot::FrameOnBody& frame, robot::MatrixOut J) {
  return robot::jacobian(mechanism_, data_, q, frame, J);
}

Pose LinkDynamics::jacobian(const robot::VectorIn& q, const robot::VectorIn& dq, const robot::FrameOnBody& frame,
                            robot::MatrixOut J, robot::MatrixOut dJ) {
  return robot::jacobian(mechanism_, data_, q, dq, frame, J, dJ);
}

void LinkDynamics::jacobian_dot_times_dq(const robot::VectorIn& q, const robot::VectorIn& dq, const robot::FrameOnBody& frame,
                                         Eigen::Ref<Twist> a) {
  robot::jacobian_dot_times_dq(mechanism_, data_, q, dq, frame, a);
}

void LinkDynamics::update_bodies(const std::string& place) {
  bodies_.take(place, mechanism_);
  adopt_bodies();
}

void LinkDynamics::follow_bodies(const std::string& place, double remaining) {
  if (bodies_.follow(place, remaining, mechanism_)) adopt_bodies();
}

void LinkDynamics::restored_bodies() {
  bodies_.restored(mechanism_);
  adopt_bodies();
}

void LinkDynamics::adopt_bodies() {
  if (floating_) floating_->mechanism.update(bodies_.robot());
}

}  // namespace cotwin::compliance
