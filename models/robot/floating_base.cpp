#include "models/robot/floating_base.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cassert>

#include "models/foundation/support/error.h"

namespace cotwin::robot {
namespace {

constexpr int kBaseJoints = 6;

/// The robot with joints that move its base. The base's link and the massless links between them are bodies 0 to 5.
RobotModel with_base_joints(const RobotModel& robot) {
  const std::string why = robot.base.inertia.unphysical();
  if (!why.empty()) throw Error("robot " + robot.name, "base '" + robot.base.name + "' cannot float: " + why);
  RobotModel moved;
  moved.name = robot.name;
  moved.gravity.setZero();
  for (int i = 0; i < kBaseJoints; ++i) {
    Joint joint;
    joint.name = robot.base.name;
    joint.parent = i - 1;
    joint.type = i < 3 ? JointType::kPrismatic : JointType::kRevolute;
    joint.axis = Eigen::Vector3d::Unit(i % 3);
    moved.joints.push_back(joint);
    moved.bodies.emplace_back();
  }
  moved.bodies.back() = robot.base;
  for (Joint joint : robot.joints) {
    joint.parent += kBaseJoints;
    moved.joints.push_back(joint);
  }
  for (Mimic mimic : robot.mimics) {
    mimic.joint.parent += kBaseJoints;
    mimic.leader += kBaseJoints;
    mimic.place += kBaseJoints;
    moved.mimics.push_back(mimic);
  }
  moved.bodies.insert(moved.bodies.end(), robot.bodies.begin(), robot.bodies.end());
  return moved;
}

/// dω/dt minus the accelerations of the base's revolute joints, whose axes move with the joints before them.
Eigen::Vector3d turning_axes(const Eigen::Vector3d& w) { return {w.y() * w.z(), -w.x() * w.z(), w.x() * w.y()}; }

Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d S;
  S << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return S;
}

}  // namespace

FloatingMechanism::FloatingMechanism(const RobotModel& robot, const char* isa)
    : robot_(with_base_joints(robot)), mechanism_(robot_, isa) {}

void FloatingMechanism::update(const RobotModel& robot) {
  assert(robot.n() == n());
  robot_.bodies[kBaseJoints - 1].inertia = robot.base.inertia;
  for (std::size_t i = 0; i < robot.bodies.size(); ++i) robot_.bodies[kBaseJoints + i].inertia = robot.bodies[i].inertia;
  mechanism_.update(robot_);
}

FloatingData::FloatingData(const FloatingMechanism& mechanism)
    : data(mechanism.with_base()),
      q(Eigen::VectorXd::Zero(mechanism.with_base().n())),
      dq(q),
      ddq(q),
      tau(q),
      M(q.size(), q.size()),
      J(6, q.size()) {}

FloatingInertia::FloatingInertia(int n) : F(6, n), A(6, n), M(n, n), M_star(n, n) {}

Wrench FloatingInertia::momentum(const Twist& V_B, const VectorIn& dq) const {
  Wrench h = I_c * V_B;
  h.noalias() += F * dq;
  return h;
}

Twist FloatingInertia::locked_twist(const Wrench& h) const {
  const Eigen::Vector3d w = I_C_inverse * (h.tail<3>() - p_C.cross(h.head<3>()));
  Twist V;
  V << h.head<3>() / mass - w.cross(p_C), w;
  return V;
}

Twist FloatingInertia::base_twist(const Wrench& h, const VectorIn& dq) const {
  Twist V = locked_twist(h);
  V.noalias() += A * dq;
  return V;
}

Eigen::Vector3d FloatingInertia::base_spin(const Eigen::Vector3d& spin, const VectorIn& dq) const {
  Eigen::Vector3d w = I_C_inverse * spin;
  w.noalias() += Z() * dq;
  return w;
}

// About the centre of mass, linear and angular momentum decouple: l = m (v + ω × p_C) + F_l q̇, and the angular momentum is
// I_C ω + (F_a − p_C × F_l) q̇.
void floating_inertia(const FloatingMechanism& mechanism, FloatingData& d, const VectorIn& q, FloatingInertia& out) {
  const Eigen::Index n = mechanism.n();
  assert(q.size() == n && out.F.cols() == n);
  d.q.tail(n) = q;
  mass_matrix(mechanism.with_base(), d.data, d.q, d.M);
  out.I_c = d.M.topLeftCorner<6, 6>();
  out.F = d.M.topRightCorner(6, n);
  out.M = d.M.bottomRightCorner(n, n);
  out.mass = d.M(0, 0);
  out.p_C = Eigen::Vector3d(d.M(5, 1), d.M(3, 2), d.M(4, 0)) / out.mass;  // of m S(p_C)
  const Eigen::Matrix3d S = cross_matrix(out.p_C);
  out.I_C = out.I_c.bottomRightCorner<3, 3>() + out.mass * S * S;
  out.I_C_inverse = out.I_C.inverse();
  for (Eigen::Index j = 0; j < n; ++j) out.A.col(j) = -out.locked_twist(out.F.col(j));
  for (Eigen::Index j = 0; j < n; ++j) {
    const Twist a = out.A.col(j);
    for (Eigen::Index i = j; i < n; ++i) out.M_star(i, j) = out.M(i, j) + out.F.col(i).dot(a);
  }
  for (Eigen::Index j = 1; j < n; ++j)
    for (Eigen::Index i = 0; i < j; ++i) out.M_star(i, j) = out.M_star(j, i);
}

Pose generalised_jacobian(const FloatingMechanism& mechanism, FloatingData& d, const FloatingInertia& inertia,
                          const VectorIn& q, const FrameOnBody& frame, MatrixOut J) {
  const Eigen::Index n = mechanism.n();
  assert(q.size() == n && J.rows() == 6 && J.cols() == n);
  d.q.tail(n) = q;
  const Pose X_BF = jacobian(mechanism.with_base(), d.data, d.q, {frame.body + kBaseJoints, frame.X_BF}, d.J);
  J = d.J.rightCols(n);
  J.noalias() += d.J.leftCols<6>().lazyProduct(inertia.A);
  return X_BF;
}

void floating_inverse_dynamics(const FloatingMechanism& mechanism, FloatingData& d, const VectorIn& q, const VectorIn& dq,
                               const VectorIn& ddq, const Twist& V_B, const Twist& A_B, const Eigen::Vector3d& gravity,
                               VectorOut tau, Wrench& W) {
  const Eigen::Index n = mechanism.n();
  assert(q.size() == n && dq.size() == n && ddq.size() == n && tau.size() == n);
  d.q.tail(n) = q;
  d.dq << V_B, dq;
  d.ddq << A_B.head<3>() - gravity, A_B.tail<3>() - turning_axes(V_B.tail<3>()), ddq;
  inverse_dynamics(mechanism.with_base(), d.data, d.q, d.dq, d.ddq, d.tau);
  W = d.tau.head<6>();
  tau = d.tau.tail(n);
}

// The accelerations of the base's joints are zero here instead of A_B: any choice of A_B cancels, because b* is orthogonal to
// the base's motion.
void reduced_inverse_dynamics(const FloatingMechanism& mechanism, FloatingData& d, const FloatingInertia& inertia,
                              const VectorIn& q, const VectorIn& dq, const VectorIn& ddq, const Eigen::Vector3d& spin,
                              const Wrench& W, VectorOut tau) {
  const Eigen::Index n = mechanism.n();
  assert(q.size() == n && dq.size() == n && ddq.size() == n && tau.size() == n);
  d.q.tail(n) = q;
  d.dq << Eigen::Vector3d::Zero(), inertia.base_spin(spin, dq), dq;
  d.ddq << Twist::Zero(), ddq;
  inverse_dynamics(mechanism.with_base(), d.data, d.q, d.dq, d.ddq, d.tau);
  tau = d.tau.tail(n);
  tau.noalias() += inertia.A.transpose() * (d.tau.head<6>() - W);
}

// Ṫ of T = (A; 1) adds Tᵀ M Ṫ to C*, which is zero: Tᵀ M is zero in the columns of the base.
void reduced_coriolis_matrix(const FloatingMechanism& mechanism, FloatingData& d, const FloatingInertia& inertia,
                             const VectorIn& q, const VectorIn& dq, const Eigen::Vector3d& spin, MatrixOut C) {
  const Eigen::Index n = mechanism.n();
  assert(q.size() == n && dq.size() == n && C.rows() == n && C.cols() == n);
  d.q.tail(n) = q;
  d.dq << Eigen::Vector3d::Zero(), inertia.base_spin(spin, dq), dq;
  coriolis_matrix(mechanism.with_base(), d.data, d.q, d.dq, d.M);
  C = d.M.bottomRightCorner(n, n);
  d.J.rightCols(n) = d.M.topRightCorner(6, n);
  d.J.rightCols(n).noalias() += d.M.topLeftCorner<6, 6>().lazyProduct(inertia.A);
  C.noalias() += inertia.A.transpose().lazyProduct(d.J.rightCols(n));
  C.noalias() += d.M.bottomLeftCorner(n, 6).lazyProduct(inertia.A);
}

Twist base_acceleration(const FloatingMechanism& mechanism, FloatingData& d, const FloatingInertia& inertia, const VectorIn& q,
                        const VectorIn& dq, const VectorIn& ddq, const Eigen::Vector3d& spin, const Wrench& W) {
  const Eigen::Index n = mechanism.n();
  assert(q.size() == n && dq.size() == n && ddq.size() == n);
  const Eigen::Vector3d w = inertia.base_spin(spin, dq);
  d.q.tail(n) = q;
  d.dq << Eigen::Vector3d::Zero(), w, dq;
  d.ddq << Twist::Zero(), ddq;
  inverse_dynamics(mechanism.with_base(), d.data, d.q, d.dq, d.ddq, d.tau);
  Twist A = inertia.locked_twist(W - d.tau.head<6>());
  A.tail<3>() += turning_axes(w);
  return A;
}

}  // namespace cotwin::robot
