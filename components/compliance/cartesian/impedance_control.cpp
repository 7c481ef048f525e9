#include "components/compliance/cartesian/impedance_control.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "components/compliance/joints/views.h"
#include "models/numerics/modes.h"
#include "models/robot/robot_model.h"

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

Matrix3d turned(const Matrix3d& A, const Matrix3d& R) { return R * A * R.transpose(); }

/// The rotation of E relative to the desired frame, η ≥ 0, in the axes of the latter.
Quaterniond rotation(const ElasticFrame& frame, const Pose& X) {
  Quaterniond Q = frame.desired.Q.conjugate() * Quaterniond(X.R);
  if (Q.w() < 0) Q.coeffs() *= -1;
  return Q;
}

/// ∂(elastic moment)/∂φ for small turns φ, the symmetric part, in the axes of the desired frame.
Matrix3d tangent(const ElasticFrame& frame, const Quaterniond& Q) {
  constexpr double kTurn = 1e-5;  // rad
  const Vector3d m = elastic_moment(frame.potential, frame.K_o, Q);
  Matrix3d T;
  for (int k = 0; k < 3; ++k) {
    const Quaterniond further = quaternion_of(kTurn * Vector3d::Unit(k)) * Q;
    T.col(k) = (elastic_moment(frame.potential, frame.K_o, further) - m) / kTurn;
  }
  return (T + T.transpose()) / 2;
}

/// The damping, relative to that of a rigid drive, with which a mode behind gears is at the aperiodic limit: with the mass 1, of which
/// `links` is that of the links, the stiffness 1 and a deflection of the gears of `twist` under it. By (2a), (2b), (2c) and q̄,
///   1 + (1 − twist)(1 + links twist s²)(δ s + (1 − links) s²) + links s² = 0,
/// which has δ = 2 and s = −1 twice for twist = 0; here δ with the root s = −1.
double damping_behind_gears(double twist, double links) {
  const double bounded = std::min(twist, ImpedanceControl::kSoftest);
  return ((1 + links) / ((1 - bounded) * (1 + links * bounded)) + 1 - links) / 2;
}

}  // namespace

ImpedanceControl::ImpedanceControl(const robot::RobotModel& robot, std::vector<int> directions)
    : directions_(std::move(directions)) {
  const Index n = robot.n(), m = static_cast<Index>(directions_.size());
  for (VectorXd* v : {&twist, &q_bar, &dq_r, &ddq_r, &l_, &r_, &x_, &dtheta_, &u_}) v->setZero(n);
  task_.setZero(m);
  J6_.setZero(6, n);
  SJ_.setZero(6, n);
  J_.setZero(m, n);
  Y_.setZero(n, m);
  modes_x_.setZero(n, 6);
  A_.setZero(m, m);
  for (MatrixXd* matrix : {&M_, &S_q_, &square_, &fourth_}) matrix->setZero(n, n);
  M_llt_.compute(MatrixXd::Identity(n, n));
  A_llt_.compute(MatrixXd::Identity(m, m));
  statics_.compute(MatrixXd::Identity(n, n));
}

void ImpedanceControl::start(const Joints& q, const Joints& theta) { twist = map(theta) - map(q); }

// 1. q̄ of the last step's twist, and there the inertia, J̄ and the stiffness in the joints
// 2. the desired motion in the joints
// 3. q̄ and the static torque l(q̄)
// 4. damping and the null space
// 5. limits
// 6. torque feedback
void ImpedanceControl::torque(LinkDynamics& links, const robot::FrameOnBody& E, const ElasticFrame& frame,
                              const ElasticPosture& posture, const robot::DriveParameters& drives, const Measured& measured,
                              const Joints& shaping, const ElasticLimits* limits, Joints& tau_m) {
  const Index n = q_bar.size();
  elastic_ = false;
  for (Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const bool soft = drives.K[k] > 0;
    elastic_ = elastic_ || soft;
    q_bar[i] = soft ? measured.theta[k] - twist[i] : measured.q[k];
    dtheta_[i] = soft ? measured.dtheta[k] : measured.dq[k];
  }
  X = links.jacobian(q_bar, E, J6_);
  update_inertia(links, drives, shaping);
  update_reference(links, E, frame);
  update_stiffness(frame, drives);
  solve_statics(links, E, frame, drives, measured.theta);

  V.noalias() = J6_ * dtheta_;
  const Twist error = V - frame.desired.V;
  const Wrench damped = damping(frame, drives, shaping) * error;
  dissipated = damped.dot(error);
  u_ = l_;
  u_.noalias() -= J6_.transpose() * damped;
  // The null space: x − J̄ J x, times M + B/r.
  if (posture.self_motion != nullptr) {
    posture.self_motion->evaluate(links, q_bar, dtheta_, E, J6_, M_, posture.gains, posture.desired, x_);
    x_ = -x_;
  } else {
    x_ = posture.D * (dtheta_ - dq_r);
    if (posture.K > 0) x_ += posture.K * (q_bar - map(posture.q_0));
  }
  task_.noalias() = J_ * x_;
  A_llt_.solveInPlace(task_);
  r_.noalias() = M_.lazyProduct(x_);
  u_ -= r_;
  u_.noalias() += J_.transpose() * task_;

  for (Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    u_[i] += drives.B[k] / (drives.K[k] > 0 ? shaping[k] : 1.0) * ddq_r[i];
  }
  if (limits != nullptr) {
    limits->limits.confine(links, {q_bar, dtheta_, measured.q, M_, M_llt_, drives, shaping, limits->tau_e, limits->h},
                           limits->joints, u_);
  }
  for (Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const double tau_J = robot::Torsion{.K = drives.K[k]}.at(measured.theta[k] - measured.q[k]).torque;  // (2c)
    tau_m[k] = drives.K[k] > 0 ? shaping[k] * u_[i] - (shaping[k] - 1) * tau_J : u_[i];
  }
}

void ImpedanceControl::update_inertia(LinkDynamics& links, const robot::DriveParameters& drives, const Joints& shaping) {
  links.mass_matrix(q_bar, M_);
  for (Index i = 0; i < M_.rows(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    M_(i, i) += drives.B[k] / (drives.K[k] > 0 ? shaping[k] : 1.0);
  }
  for (std::size_t k = 0; k < directions_.size(); ++k) {
    const int i = directions_[k];
    J_.row(static_cast<Index>(k)) = (i < 3 ? 1 : JointMotion::kLength) * J6_.row(i);
  }
  M_llt_.compute(M_);
  Y_ = J_.transpose();
  M_llt_.matrixL().solveInPlace(Y_);
  A_.noalias() = Y_.transpose().lazyProduct(Y_);
  A_llt_.compute(A_);
  // Near singular poses J̄ is damped. The smallest pivot is an upper bound of the smallest eigenvalue.
  constexpr double kNear = 1e-3, kDamping = 1e-3, kNone = 1e-12;  // kNone, 1/kg: where no joint moves E at all
  const double trace = A_.trace();
  const double least = A_llt_.info() == Eigen::Success ? A_llt_.matrixLLT().diagonal().cwiseAbs2().minCoeff() : 0.0;
  sigma_min = std::sqrt(least);
  if (!(least >= kNear * trace && least > kNone)) {
    const double depth = 1 - least / std::max(kNear * trace, kNone);
    A_.diagonal().array() += kDamping * depth * depth * trace + kNone;
    A_llt_.compute(A_);
  }
}

void ImpedanceControl::update_reference(LinkDynamics& links, const robot::FrameOnBody& E, const ElasticFrame& frame) {
  moving_ = !frame.desired.V.isZero(0) || !frame.acceleration.isZero(0);
  dq_r.setZero();
  ddq_r.setZero();
  if (!moving_) return;
  const auto to_joints = [&](const Twist& twist_of_E, VectorXd& joints) {
    for (std::size_t k = 0; k < directions_.size(); ++k) {
      const int i = directions_[k];
      task_[static_cast<Index>(k)] = (i < 3 ? 1 : JointMotion::kLength) * twist_of_E[i];
    }
    A_llt_.solveInPlace(task_);
    joints.noalias() = Y_ * task_;
    M_llt_.matrixU().solveInPlace(joints);
  };
  to_joints(frame.desired.V, dq_r);
  Twist drift;
  links.jacobian_dot_times_dq(q_bar, dq_r, E, drift);
  to_joints(frame.acceleration - drift, ddq_r);
}

void ImpedanceControl::update_stiffness(const ElasticFrame& frame, const robot::DriveParameters& drives) {
  stiffness_ratio = 0;
  relief_ = 1;
  if (!elastic_) return;
  const Index n = q_bar.size();
  update_joint_stiffness(frame);
  for (Index i = 0; i < n; ++i) {
    const double K = drives.K[static_cast<std::size_t>(i)], scale = K > 0 ? 1 / std::sqrt(K) : 0.0;
    S_q_.row(i) *= scale;
    S_q_.col(i) *= scale;
  }
  // ‖A⁴‖ in the Frobenius norm is (Σ λ⁸)^½ ≥ ρ⁴, for six eigenvalues at most √6 ρ⁴.
  square_.noalias() = S_q_.lazyProduct(S_q_);
  fourth_.noalias() = square_.lazyProduct(square_);
  stiffness_ratio = std::pow(fourth_.squaredNorm(), 0.125);
  if (stiffness_ratio > kSoftest) relief_ = kSoftest / stiffness_ratio;
  // In units of K^(1/2): I − relief S_q.
  square_ = -relief_ * S_q_;
  square_.diagonal().array() += 1;
  statics_.compute(square_);
}

/// S_q = Jᵀ S J
void ImpedanceControl::update_joint_stiffness(const ElasticFrame& frame) {
  Square S = Square::Zero();
  S.topLeftCorner<3, 3>() = turned(frame.S_T, axes_of(frame));
  S.bottomRightCorner<3, 3>() = turned(tangent(frame, rotation(frame, X)), frame.desired.Q.toRotationMatrix());
  SJ_.noalias() = S.lazyProduct(J6_);
  S_q_.noalias() = J6_.transpose().lazyProduct(SJ_);
}

void ImpedanceControl::linearise(LinkDynamics& links, const ElasticFrame& frame, const ElasticPosture& posture,
                                 const robot::DriveParameters& drives, const Joints& shaping, SampledRobot& robot) {
  update_inertia(links, drives, shaping);
  update_stiffness(frame, drives);
  update_joint_stiffness(frame);
  robot.H = S_q_;
  SJ_.noalias() = damping(frame, drives, shaping).lazyProduct(J6_);
  robot.R.noalias() = J6_.transpose().lazyProduct(SJ_);
  const bool goals = posture.self_motion != nullptr;
  const double D = goals ? posture.gains.k_nu : posture.D;
  const double K = !goals ? posture.K : posture.desired != nullptr ? D * D / 4 : 0.0;
  robot.M = M_;
  for (Index i = 0; i < q_bar.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const bool soft = drives.K[k] > 0;
    // The null space: M + B/r less its part in the directions of E.
    task_ = J_.col(i);
    A_llt_.solveInPlace(task_);
    x_ = M_.col(i);
    x_.noalias() -= J_.transpose() * task_;
    robot.R.col(i) += D * x_;
    robot.H.col(i) += K * x_;
    robot.M(i, i) -= drives.B[k] / (soft ? shaping[k] : 1.0);
    robot.B[i] = drives.B[k];
    robot.K[i] = drives.K[k];
    robot.D[i] = drives.D[k];
    robot.shaping[i] = soft ? shaping[k] : 1.0;
  }
  robot.relief = relief_;
}

Wrench ImpedanceControl::spring(const ElasticFrame& frame) const {
  const Matrix3d R_d = frame.desired.Q.toRotationMatrix(), R_BA = axes_of(frame);
  const Vector3d x = X.p - frame.desired.p, f = R_BA * (frame.S_T * (R_BA.transpose() * x));
  Wrench w;
  w << f, R_d * elastic_moment(frame.potential, frame.K_o, rotation(frame, X));
  if (frame.turns_with_tool) w.tail<3>() -= R_d * (frame.P_R * (R_d.transpose() * x.cross(f)));
  return w;
}

void ImpedanceControl::solve_statics(LinkDynamics& links, const robot::FrameOnBody& E, const ElasticFrame& frame,
                                     const robot::DriveParameters& drives, const Joints& theta) {
  constexpr int kMost = 20, kFixedTangent = 3;
  constexpr double kExact = 1e-12, kLongest = 0.1;  // rad (m)
  const Index n = q_bar.size();
  const auto statics = [&] {
    links.inverse_dynamics(q_bar, dq_r, ddq_r, l_);
    for (Index i = 0; i < n; ++i) l_[i] += robot::spring(drives, static_cast<std::size_t>(i)).at(q_bar[i]).torque;
    x_.noalias() = J6_.transpose().lazyProduct(spring(frame));
    l_ -= x_;
  };
  statics();
  static_error = 0;
  for (int iteration = 0; elastic_; ++iteration) {
    for (Index i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const double K = drives.K[k];
      r_[i] = K > 0 ? theta[k] - q_bar[i] - (l_[i] + (1 - relief_) * x_[i]) / K : 0.0;
    }
    static_error = r_.lpNorm<Eigen::Infinity>();
    if (static_error < kExact || iteration == kMost) break;
    // The tangent of the start is good enough unless the robot jumped.
    if (iteration >= kFixedTangent) update_stiffness(frame, drives);
    for (Index i = 0; i < n; ++i) r_[i] *= std::sqrt(drives.K[static_cast<std::size_t>(i)]);
    statics_.solveInPlace(r_);
    for (Index i = 0; i < n; ++i) {
      const double K = drives.K[static_cast<std::size_t>(i)];
      r_[i] = K > 0 ? r_[i] / std::sqrt(K) : 0.0;
    }
    const double length = r_.lpNorm<Eigen::Infinity>();
    q_bar += std::min(1.0, kLongest / length) * r_;
    X = links.jacobian(q_bar, E, J6_);
    statics();
  }
  constexpr double kLost = 1e-3;  // rad
  for (Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    twist[i] = drives.K[k] > 0 && static_error < kLost ? theta[k] - q_bar[i] : 0.0;
  }
}

/// damping_behind_gears() of each mode: `V` has the directions of the modes in columns, `values` their stiffness.
ImpedanceControl::Six ImpedanceControl::factors_behind_gears(const Eigen::Ref<const ModeColumns>& V, const Six& values,
                                                             const robot::DriveParameters& drives, const Joints& shaping) {
  const Index n = M_.rows();
  const MatrixXd& L = M_llt_.matrixLLT();
  Six motors = Six::Zero(), twist = Six::Zero();
  // L_Mᵀ times the motion of the joints in each mode, and their torques for an acceleration of 1.
  for (Index i = 0; i < n; ++i) {
    modes_x_.row(i).setZero();
    for (Index j = 0; j < V.rows(); ++j) modes_x_.row(i) += Y_(i, j) * V.row(j);
  }
  for (Index i = 0; i < n; ++i) {
    const double K = drives.K[static_cast<std::size_t>(i)];
    if (!(K > 0)) continue;
    Eigen::Matrix<double, 1, 6> torque = L(i, 0) * modes_x_.row(0);
    for (Index j = 1; j <= i; ++j) torque += L(i, j) * modes_x_.row(j);
    twist += torque.cwiseAbs2().transpose() / K;
  }
  for (Index i = n - 1; i >= 0; --i) {
    for (Index j = i + 1; j < n; ++j) modes_x_.row(i) -= L(j, i) * modes_x_.row(j);
    modes_x_.row(i) /= L(i, i);
    const auto joint = static_cast<std::size_t>(i);
    if (drives.K[joint] > 0) motors += drives.B[joint] / shaping[joint] * modes_x_.row(i).cwiseAbs2().transpose();
  }
  Six factors;
  for (Index k = 0; k < 6; ++k) factors[k] = values[k] > 0 ? damping_behind_gears(values[k] * twist[k], 1 - motors[k]) : 1.0;
  return factors;
}

/// With the inertia A⁻¹ of the rendered directions, A = L Lᵀ, and Lᵀ S L = U Ω² Uᵀ: D_T, D_R and √ζ L⁻ᵀ U diag(2 Ω γ) Uᵀ L⁻¹ √ζ. The modes
/// L u damp out without coupling if the ratios of translation and rotation are equal.
ImpedanceControl::Square ImpedanceControl::damping(const ElasticFrame& frame, const robot::DriveParameters& drives,
                                                   const Joints& shaping) {
  const Matrix3d& R_BA = axes_of(frame);
  const Matrix3d R_d = frame.desired.Q.toRotationMatrix();
  Square D = Square::Zero();
  D.topLeftCorner<3, 3>() = turned(frame.D_T, R_BA);
  D.bottomRightCorner<3, 3>() = turned(frame.D_R, R_d);
  if (!(frame.zeta_T > 0 || frame.zeta_R > 0)) return D;
  Square S = Square::Zero();
  S.topLeftCorner<3, 3>() = turned(frame.S_T, R_BA);
  S.bottomRightCorner<3, 3>() = turned(frame.K_o, R_d);

  const auto m = static_cast<Index>(directions_.size());
  const auto unit = [&](Index k) { return directions_[static_cast<std::size_t>(k)] < 3 ? 1 : JointMotion::kLength; };
  const auto at = [&](Index k) { return directions_[static_cast<std::size_t>(k)]; };
  Square L = Square::Identity(), W = Square::Zero();
  for (Index i = 0; i < m; ++i) {
    for (Index j = 0; j < m; ++j) {
      if (j <= i) L(i, j) = A_llt_.matrixLLT()(i, j);
      W(i, j) = S(at(i), at(j)) / (unit(i) * unit(j));
    }
  }
  const Square WL = W.lazyProduct(L);
  W = L.transpose().lazyProduct(WL);
  const numerics::Modes6 modes = numerics::modes6((W + W.transpose()) / 2);
  ModeColumns V = modes.vectors.transpose();  // U, then L⁻ᵀ U
  for (Index i = 5; i >= 0; --i) {
    for (Index j = i + 1; j < 6; ++j) V.row(i) -= L(j, i) * V.row(j);
    V.row(i) /= L(i, i);
  }
  Six factors = Six::Ones();
  if (elastic_) factors = factors_behind_gears(V.topRows(m), modes.values, drives, shaping);
  for (Index k = 0; k < 6; ++k) factors[k] *= 2 * std::max(std::sqrt(std::max(modes.values[k], 0.0)), frame.omega_free);
  const ModeColumns scaled = V * factors.asDiagonal();
  const Square of_modes = scaled.lazyProduct(V.transpose());
  const auto ratio = [&](Index k) { return std::sqrt(at(k) < 3 ? frame.zeta_T : frame.zeta_R); };
  for (Index i = 0; i < m; ++i) {
    for (Index j = 0; j < m; ++j) D(at(i), at(j)) += unit(i) * unit(j) * ratio(i) * ratio(j) * of_modes(i, j);
  }
  return D;
}

}  // namespace cotwin::compliance
