// Bodies that latches connect with links that a drive train moves (docs/decisions.md).
//
// Within a step the rest of the world answers the links of a robot like an inertia: the impulses of the latches change by
// −L Δq̇ if the links end the step at q̇ + Δq̇, with
//   L = Jᵀ (W + S)⁻¹ J
// J: of the latches' rows; W: mobility of all else that they connect, other robots with their gears included; S: the softness 4/(k h²)
// of the implicit midpoint rule, 0 of rigid latches. The drive train integrates (M + L) q̈ = … + τ_e + L q̈', q̈' the acceleration that
// this unit expects, and its Δq̇ and Δq move the bodies along.
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>

#include "components/contact_world/engine/body/body.h"
#include "components/contact_world/parts.h"
#include "models/scene/robot_links.h"

namespace cotwin::contact_world {
namespace {

/// Softness of rigid rows relative to their mobility, for those that others repeat or that hold to the ground.
constexpr double kRegular = 1e-9;

using Factor = Eigen::Ref<Eigen::MatrixXd>;

/// L of C + kRegular diag(C) = L Lᵀ in the lower triangle of C.
void factorise(Factor C) {
  for (Eigen::Index i = 0; i < C.rows(); ++i) C(i, i) = C(i, i) > 0 ? C(i, i) * (1 + kRegular) : 1;
  Eigen::LLT<Factor> in_place(C);
}

}  // namespace

/// Whether a drive train may have to know what latches hold on the robot.
bool ContactWorld::gives_loads(const Robot& r) const {
  return !latches_.empty() && actuation_ == Actuation::kTorque && r.link == LinkSide::kInside;
}

/// Finds the rows of the closed latches and what they connect, where a step h has led.
void ContactWorld::find_loads(double h) {
  Loads& all = *loads_;
  all.rows.clear();
  if (actuation_ == Actuation::kPrescribed || h == 0) return;
  for (const Latch& latch : world_->latches()) {
    if (!latch.closed) continue;
    const Motion6 error = latch.aim(Stage::kPosition, h).error;
    for (int k = 0; k < 3; ++k) {
      const Vector3d axis = latch.joint.R_parent.col(k), zero = Vector3d::Zero(), &p = latch.joint.p_child;
      all.rows.push_back({latch.joint.parent, latch.joint.child, axis, zero, p, latch.law.stiffness, axis.dot(error.linear)});
      all.rows.push_back(
          {latch.joint.parent, latch.joint.child, zero, axis, p, latch.law.turn_stiffness, axis.dot(error.angular)});
    }
  }
  const Eigen::Index rows = std::ssize(all.rows);
  auto free = all.free.topLeftCorner(rows, rows);
  free.setZero();
  for (Eigen::Index i = 0; i < rows; ++i) {
    const double k = all.rows[static_cast<std::size_t>(i)].stiffness;
    if (k > 0) free(i, i) = 4 / (k * h * h);
  }
  for (const auto& body : bodies_) {
    if (find_body(body->index)) free.noalias() += all.body.topRows(rows) * all.body.topRows(rows).transpose();
  }
  for (const auto& robot : robots_) find_robot(*robot, h);
}

/// The part of a free body: its mobility is U Uᵀ with rows of impulses' responses, in axes in which its inertia is the unit matrix. Returns
/// whether latches hold it.
bool ContactWorld::find_body(std::size_t index) {
  const RigidBody& body = world_->body(index);
  bool held = false;
  for (std::size_t i = 0; i < loads_->rows.size() && body.dynamic(); ++i) {
    const Loads::Row& row = loads_->rows[i];
    const double sign = row.sign(index);
    held = held || sign != 0;
    const Vector3d moment = row.m + (row.p - body.p).cross(row.d);
    loads_->body.row(static_cast<Eigen::Index>(i)) << sign * body.inverse_root_mass * row.d.transpose(),
        sign * body.inverse_root_moments.cwiseProduct(body.R.transpose() * moment).transpose();
  }
  return held;
}

/// The part of a robot, whose gears are springs and dampers by the implicit midpoint rule.
void ContactWorld::find_robot(Robot& r, double h) {
  const Eigen::Index rows = std::ssize(loads_->rows), n = static_cast<Eigen::Index>(r.n);
  r.held = false;
  for (std::size_t l = 0; l < r.X_WL.size(); ++l) r.X_WL[l] = world_->poses()[r.parts.bodies[l]];
  for (Eigen::Index i = 0; i < rows; ++i) {
    const Loads::Row& row = loads_->rows[static_cast<std::size_t>(i)];
    std::fill(r.tau.begin(), r.tau.end(), 0.0);
    for (std::size_t l = 0; l < r.parts.bodies.size(); ++l) {
      const double sign = row.sign(r.parts.bodies[l]);
      if (sign == 0) continue;
      Wrench F;
      F << sign * row.d, sign * row.m;
      scene::add_joint_torques(r.placed->model, r.X_WL, static_cast<int>(l), row.p, F, r.tau);
      r.held = true;
    }
    r.J.row(i) = r.vector(r.tau);
  }
  if (!r.held) return;
  compute_mobility(r, r.q_link);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (r.placed->model.joints[k].passive) continue;
    r.damping[k] = step_damping(r, k, h);
    r.M(i, i) += r.B[k] + h / 2 * r.damping[k] + h * h / 4 * r.K[k];
  }
  r.root.compute(r.M);
  r.response.leftCols(rows) = r.J.topRows(rows).transpose();
  r.root.matrixL().solveInPlace(r.response.leftCols(rows));
}

/// At the end of a step: what the drive trains have to know of what their links carry.
void ContactWorld::write_loads(double h) {
  find_loads(h);
  const Eigen::Index rows = std::ssize(loads_->rows);
  auto factor = loads_->factor.topLeftCorner(rows, rows);
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    if (!gives_loads(r)) continue;
    for (std::vector<double>* v : {&r.load_inertia, &r.load_torque, &r.load_damping}) std::ranges::fill(*v, 0.0);
    if (rows == 0 || !r.held) continue;
    factor = loads_->free.topLeftCorner(rows, rows);
    for (const auto& other : robots_) {
      if (other == robot || !other->held) continue;
      factor.noalias() += other->response.leftCols(rows).transpose() * other->response.leftCols(rows);
    }
    factorise(factor);
    auto J = r.J.topRows(rows);
    factor.triangularView<Eigen::Lower>().solveInPlace(J);
    const auto n = static_cast<Eigen::Index>(r.n);
    Eigen::Map<Eigen::MatrixXd> L(r.load_inertia.data(), n, n);
    L.noalias() = J.transpose() * J;
    Eigen::Map<Eigen::VectorXd>(r.load_torque.data(), n).noalias() = L * r.vector(r.ddq);
    r.load_damping = r.damping;
  }
}

/// The same of one link.
void ContactWorld::add_correction(std::size_t body, const Pose& X_WL, const Twist& V_WL) {
  const Pose& expected = world_->poses()[body];
  const Twist& V = world_->twists()[body];
  const Eigen::AngleAxisd turn(X_WL.R * expected.R.transpose());
  for (std::size_t i = 0; i < loads_->rows.size(); ++i) {
    const Loads::Row& row = loads_->rows[i];
    const double sign = row.sign(body);
    if (sign == 0) continue;
    const Vector3d w = V.tail<3>(), w_now = V_WL.tail<3>(), arm = row.p - expected.p, arm_now = turn * arm;
    const Vector3d speed = V_WL.head<3>() + w_now.cross(arm_now) - V.head<3>() - w.cross(arm);
    auto motion = loads_->motion.row(static_cast<Eigen::Index>(i));
    motion[0] += sign * row.along(speed, w_now - w);
    motion[1] += sign * row.along(X_WL.p + arm_now - row.p, turn.angle() * turn.axis());
  }
}

/// Compares where the drive train has moved the links in the last step with where this unit expected them, before it takes them there.
void ContactWorld::add_correction(Robot& r) {
  Loads& all = *loads_;
  double gain = 0;
  for (std::size_t i = 0; i < r.n; ++i) {
    const double moved = r.q[i] - r.q_before[i];
    gain += r.tau_c[i] * (r.q[i] - r.q_link[i]) + r.load_torque[i] * moved;
    for (std::size_t j = 0; j < r.n; ++j)
      gain -= (r.dq[i] * r.dq[j] - r.dq_before[i] * r.dq_before[j]) * r.load_inertia[i * r.n + j] / 2;
  }
  for (std::size_t l = 0; l < r.X_WL.size(); ++l) add_correction(r.parts.bodies[l], r.X_WL[l], r.V_WL[l]);
  if (r.held) {
    all.gain += gain;
    all.link = r.parts.bodies.back();
  } else {
    world_->add_gain(r.parts.bodies.back(), gain);
  }
}

/// Moves the bodies that latches hold along with links that the drive trains have moved otherwise than expected.
void ContactWorld::carry_loads() {
  Loads& all = *loads_;
  const Eigen::Index rows = std::ssize(all.rows);
  if (rows == 0) return;
  auto factor = all.factor.topLeftCorner(rows, rows);
  auto motion = all.motion.topRows(rows);
  factor = all.free.topLeftCorner(rows, rows);
  factorise(factor);
  const auto L = factor.triangularView<Eigen::Lower>();
  L.solveInPlace(motion);
  L.transpose().solveInPlace(motion);  // now the impulses and their times, on the first bodies
  for (std::size_t i = 0; i < all.rows.size(); ++i) {
    const Loads::Row& row = all.rows[i];
    if (row.stiffness == 0) continue;
    const double stretch = 4 / (row.stiffness * h_before_ * h_before_) * motion(static_cast<Eigen::Index>(i), 1);
    all.gain += row.stiffness * stretch * (row.error + stretch / 2);
  }
  for (const auto& one : bodies_) {
    if (one->jointed || !find_body(one->index)) continue;
    const RigidBody& body = world_->body(one->index);
    const Eigen::Matrix<double, 6, 2> change = -all.body.topRows(rows).transpose() * motion;
    const auto turned = [&](int k) -> Vector3d {
      return body.R * body.inverse_root_moments.cwiseProduct(change.col(k).tail<3>());
    };
    const Vector3d turn = turned(1), shift = body.inverse_root_mass * change.col(1).head<3>();
    const Vector3d v = body.v + body.inverse_root_mass * change.col(0).head<3>(), w = body.w + turned(0), centre = body.p;
    const double angle = turn.norm(), kinetic = body.kinetic_energy();
    const Matrix3d R = angle > 0 ? Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix() : Matrix3d(Matrix3d::Identity());
    const Pose X_WB = world_->poses()[one->index];
    const Vector3d arm = R * (X_WB.p - centre);
    Twist V_WB;
    V_WB << v + w.cross(arm), w;
    world_->set_pose(one->index, {R * X_WB.R, centre + shift + arm});
    world_->set_twist(one->index, V_WB);
    all.gain += body.kinetic_energy() - kinetic - body.mass * Eigen::Map<const Vector3d>(gravity_.data()).dot(shift);
  }
  motion.setZero();
  if (all.gain != 0) world_->add_gain(all.link, all.gain);
  all.gain = 0;
}

}  // namespace cotwin::contact_world
