#include "components/compliance/cartesian/joint_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "components/compliance/cartesian/frame/rotation.h"
#include "models/foundation/support/error.h"
#include "models/robot/robot_model.h"

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kLeastDamping = 1e-3;  // of lambda_0: a lost direction always has some

MovingPose moved(const MovingPose& from, const Twist& by) {
  return {from.p + by.head<3>(), quaternion_of(by.tail<3>()) * from.Q, from.V};
}

Twist between(const MovingPose& a, const MovingPose& b) {
  Twist d;
  d << b.p - a.p, axis_angle(b.Q * a.Q.conjugate());
  return d;
}

}  // namespace

JointMotion::JointMotion(const robot::RobotModel& robot, SelfMotion& self_motion)
    : self_motion_(self_motion),
      tasks_(self_motion.tasks()),
      cascade_(robot.n(), row_counts(tasks_)),
      null_space_(cascade_),
      p_(tasks_.size(), Vector3d::Zero()) {
  const Index n = robot.n();
  for (VectorXd* v : {&q, &dq, &ddq, &q_mid_, &dq_mid_, &gradient_, &tau_, &then_, &own_, &push_}) v->setZero(n);
  allowed_.resize(static_cast<std::size_t>(n));
  met.resize(static_cast<std::size_t>(n));
  for (Eigen::MatrixXd* A : {&J6_, &dJ6_, &held_J6_, &held_dJ6_}) A->setZero(6, n);
  for (Eigen::MatrixXd* A : {&M_, &dM_, &C_, &mobility_}) A->setZero(n, n);
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    control::Task& task = cascade_.tasks[k];
    forces_.emplace_back(task.a);
    for (std::size_t i = 0; i < tasks_[k].directions.size(); ++i)
      task.scale[static_cast<Index>(i)] = tasks_[k].directions[i] < 3 ? 1 : kLength;
  }
}

void JointMotion::select_rows(const TaskEntry& task, const Eigen::MatrixXd& from, Eigen::MatrixXd& J) const {
  const std::size_t m = task.directions.size();
  const double* column = from.data();
  double* to = J.data();
  for (Index i = 0; i < from.cols(); ++i, column += 6, to += m) {
    for (std::size_t r = 0; r < m; ++r) to[r] = column[task.directions[r]];
  }
}

void JointMotion::evaluate(LinkDynamics& links, const VectorXd& at, const VectorXd* velocity, const JointMotionGains& gains) {
  const auto jacobian = [&](const robot::FrameOnBody& frame, Eigen::MatrixXd& J, Eigen::MatrixXd& dJ) {
    return velocity ? links.jacobian(at, *velocity, frame, J, dJ) : links.jacobian(at, frame, J);
  };
  X_ = jacobian(E_, J6_, dJ6_);
  links.mass_matrix(at, M_);
  std::size_t held = 0;
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    const TaskEntry& entry = tasks_[k];
    control::Task& task = cascade_.tasks[k];
    if (entry.held) {
      p_[k] = jacobian(entry.frame, held_J6_, held_dJ6_).p;
      task.activation = self_motion_.held(held++).activation;
    }
    select_rows(entry, entry.held ? held_J6_ : J6_, task.J);
    if (velocity) select_rows(entry, entry.held ? held_dJ6_ : dJ6_, task.dJ);
  }
  cascade_.sigma_0 = gains.sigma_0;
  cascade_.lambda_0 = std::max(gains.lambda_0, kLeastDamping);
  if (!cascade_.decompose(M_))
    throw Error("space=cartesian", "the mass matrix of the robot is not positive definite, expected mass on every joint");
  sigma_min = std::numeric_limits<double>::infinity();
  lambda = 0;
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    if (tasks_[k].held) continue;
    sigma_min = std::min(sigma_min, cascade_.tasks[k].sigma_min);
    lambda = std::max(lambda, cascade_.tasks[k].lambda / gains.sigma_0);
  }
}

void JointMotion::want(const Twist& acceleration) {
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    VectorXd& a = cascade_.tasks[k].a;
    a.setZero();
    for (std::size_t i = 0; i < tasks_[k].directions.size() && !tasks_[k].held; ++i)
      a[static_cast<Index>(i)] = acceleration[tasks_[k].directions[i]];
  }
}

void JointMotion::start(LinkDynamics& links, const VectorXd& at, const Twist& V, const JointMotionGains& gains) {
  q = at;
  evaluate(links, q, nullptr, gains);
  want(V);
  cascade_.solve(dq);
  ddq.setZero();
  std::ranges::fill(met, 0);
}

void JointMotion::advance(LinkDynamics& links, const MovingPose& before, const MovingPose& after, const Twist& end_acceleration,
                          const VectorXd& tau_e, const Posture* posture, std::span<const Limits> limits,
                          const JointMotionGains& gains, double h) {
  posture_ = posture;
  constexpr double kShort = 0.2, kMostParts = 100;
  const int count = static_cast<int>(std::clamp(std::ceil(h * gains.omega_k / kShort), 1.0, kMostParts));
  const double length = h / count;
  const Twist mean = (after.V - before.V) / h;
  const Twist way = count > 1 ? between(before, after) : Twist(Twist::Zero());
  std::ranges::fill(met, 0);
  for (int k = 0; k < count; ++k) {
    const double s = static_cast<double>(k) / count;
    MovingPose from = k == 0 ? before : moved(before, s * way + s * (1 - s) / 2 * h * (before.V - after.V));
    from.V = before.V + s * (after.V - before.V);
    part(links, from, mean, tau_e, limits, gains, length);
  }
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    const control::Task& task = cascade_.tasks[k];
    self_motion_.task_sigma[k] = task.sigma_min;
    self_motion_.task_residual[k] = std::sqrt((task.residual.array() * task.scale.array()).square().sum());
  }
  // The acceleration at the end, which differs from the mean by that of the task.
  want(end_acceleration - mean);
  cascade_.solve(tau_);
  ddq += tau_;
}

// With J in the middle of the part, where q̇_c is still to come: ẋ_c − J (q̇_c + h/2 q̈_c) on both sides of the equation. Terms of
// second order in q̇_c take it from the last acceleration.
void JointMotion::part(LinkDynamics& links, const MovingPose& before, const Twist& acceleration, const VectorXd& tau_e,
                       std::span<const Limits> limits, const JointMotionGains& gains, double h) {
  q_mid_ = q + h / 2 * dq;
  dq_mid_ = dq + h / 2 * ddq;
  evaluate(links, q_mid_, &dq_mid_, gains);
  links.coriolis_matrix(q_mid_, dq_mid_, C_);
  for (Index j = 0; j < C_.cols(); ++j) {  // Ṁ = C + Cᵀ
    for (Index i = 0; i <= j; ++i) dM_(i, j) = dM_(j, i) = C_(i, j) + C_(j, i);
  }
  const MovingPose target = moved(before, h / 2 * before.V);
  const Quaterniond E = target.Q * Quaterniond(X_.R).conjugate();
  Twist error, V;
  V.noalias() = J6_.lazyProduct(dq);
  error << target.p - X_.p, 2 * E.w() * E.vec();
  const double K_v = 2 * gains.omega_k, K_p = gains.omega_k * gains.omega_k;
  const Twist feedback = K_v * (before.V - V) + K_p * error;
  want(acceleration + feedback / (1 + K_v * h / 2));
  std::size_t held = 0;
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    if (!tasks_[k].held) continue;
    control::Task& task = cascade_.tasks[k];
    const SelfMotion::Held to = self_motion_.held(held++);
    const Vector3d e = to.target - p_[k];
    task.a.noalias() = task.J.lazyProduct(dq);
    for (std::size_t i = 0; i < tasks_[k].directions.size(); ++i) {
      double& a = task.a[static_cast<Index>(i)];
      a = to.omega * (to.omega * e[tasks_[k].directions[i]] - 2 * a) / (1 + to.omega * h);
    }
  }
  held = 0;
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    control::Task& task = cascade_.tasks[k];
    const double omega = tasks_[k].held ? self_motion_.held(held++).omega : gains.omega_k;
    const double part = 1 / (1 + omega * h);  // the rest is in J q̇ of the middle
    task.a.noalias() -= part * task.dJ.lazyProduct(dq_mid_);
  }
  cascade_.solve(ddq);

  gradient_.setZero();
  const double potential = self_motion_.add_goals(links, q_mid_, E_, gradient_);
  // Damping of ν in the middle of the part, (ν + h/2 (a − k_ν ν_mid)) = ν_mid, for any k_ν.
  tau_ = map(self_motion_.xi) - gains.k_nu * dq;
  if (posture_ != nullptr)
    tau_ += posture_->ddq + gains.k_nu * posture_->dq + gains.k_nu * gains.k_nu / 4 * (posture_->q - q_mid_);
  null_space_.evaluate(cascade_, {dq_mid_, M_, dM_, gradient_, tau_e, self_motion_.yield(), 0, &tau_});
  ddq += null_space_.ddq / (1 + gains.k_nu * h / 2);
  self_motion_.write_outputs(
      {null_space_.nu, null_space_.energy, potential, null_space_.external_work - 2 * gains.k_nu * null_space_.energy});
  bound(limits, h);
  q += h * dq + h * h / 2 * ddq;
  dq += h * ddq;
}

/// Takes the speeds that the joints may have after h seconds, and those that they would have. False if none exceeds its limits.
bool JointMotion::update_bounds(std::span<const Limits> limits, double h) {
  then_ = dq + h * ddq;
  bool clear = true;
  const auto at_rest = [&](std::size_t i) {
    return Desired{limits[i].bound_position() ? (limits[i].q_min + limits[i].q_max) / 2 : 0, 0};
  };
  for (std::size_t i = 0; i < met.size() && clear; ++i) {
    const auto k = static_cast<Index>(i);
    const Desired rest = at_rest(i);
    clear = clear_of(limits[i], rest, {q[k] - rest.q + h * (dq[k] + then_[k]) / 2, then_[k]}, h);
  }
  if (clear) return false;
  bool within = true;
  for (std::size_t i = 0; i < met.size(); ++i) {
    const auto k = static_cast<Index>(i);
    const Desired rest = at_rest(i);
    allowed_[i] = allowed(limits[i], rest, {q[k] - rest.q, dq[k]}, h);
    within = within && beyond(k) == 0;
  }
  return !within;
}

/// What the speed of joint i lacks to be allowed.
double JointMotion::beyond(Index i) const {
  const Allowed& may = allowed_[static_cast<std::size_t>(i)];
  return std::max(std::min(then_[i], may.dx_high), may.dx_low) - then_[i];
}

/// Changes the speeds by the least kinetic energy so that they are allowed, without a change of the first `kept` tasks: impulses on the
/// joints that hold them at their limits, N M⁻¹ push, by projected Gauss-Seidel. Returns whether they are.
bool JointMotion::make_room(std::size_t kept) {
  constexpr int kMost = 100;
  constexpr double kLeast = 1e-7;   // of its mobility, below which a joint cannot move in the null space
  constexpr double kEnough = 1e-9;  // rad/s
  const Index n = then_.size();
  cascade_.mobility(kept, mobility_);
  push_.setZero();
  double most = 1;
  for (int sweep = 0; sweep < kMost && most > kEnough; ++sweep) {
    most = 0;
    for (Index i = 0; i < n; ++i) {
      const double own = mobility_(i, i);
      if (!(own > kLeast * own_[i])) continue;
      const Allowed& may = allowed_[static_cast<std::size_t>(i)];
      const double free = then_[i] - own * push_[i];
      const double push = (std::max(std::min(free, may.dx_high), may.dx_low) - free) / own, change = push - push_[i];
      if (change == 0) continue;
      push_[i] = push;
      then_ += change * mobility_.col(i);
      most = std::max(most, std::abs(change * own));
    }
  }
  double left = 0;
  for (Index i = 0; i < n; ++i) {
    left = std::max(left, std::abs(beyond(i)));
    if (push_[i] != 0) note(i, push_[i] < 0);
  }
  return left <= kEnough;
}

// Where a joint would pass a limit, self-motion makes room for it, so that the tasks go on; where that is not enough, the motion of the
// last task, then that of the one before it, and so on: the first task is kept as long as any motion of the joints within their limits
// keeps it (saturation in the null space, Flacco, De Luca and Khatib, IEEE T-RO 31(3), 2015, solved for all joints at once). What
// remains is cut joint by joint.
void JointMotion::bound(std::span<const Limits> limits, double h) {
  if (!update_bounds(limits, h)) return;
  cascade_.mobility(0, mobility_);
  own_ = mobility_.diagonal();
  bool within = false;
  for (std::size_t kept = tasks_.size(); kept > 0 && !within; --kept) within = make_room(kept);
  for (Index i = 0; i < then_.size(); ++i) {
    const double d = beyond(i);
    if (d == 0) continue;
    note(i, d < 0);
    then_[i] += d;
  }
  ddq = (then_ - dq) / h;
}

void JointMotion::note(Index i, bool high) {
  const auto k = static_cast<std::size_t>(i);
  met[k] = static_cast<std::int32_t>(high ? allowed_[k].high : allowed_[k].low);
}

void JointMotion::accelerations_of(const Twist& acceleration, Eigen::Ref<VectorXd> ddq_of) {
  want(acceleration);
  cascade_.solve(ddq_of);
}

Wrench JointMotion::wrench_of(LinkDynamics& links, const robot::VectorIn& tau, const JointMotionGains& gains) {
  evaluate(links, q, nullptr, gains);
  tau_ = tau;
  cascade_.solve_mass(tau_);
  cascade_.split(tau_, forces_);
  Wrench w = Wrench::Zero();
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    for (std::size_t i = 0; i < tasks_[k].directions.size() && !tasks_[k].held; ++i)
      w[tasks_[k].directions[i]] = forces_[k][static_cast<Index>(i)];
  }
  return w;
}

}  // namespace cotwin::compliance
