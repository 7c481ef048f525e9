// Bodies that latches connect with links that a drive train moves, or that such links grip (docs/decisions.md).
//
// Within a step the rest of the world answers the links of a robot like an inertia: the impulses of latches and grips change by −L Δq̇ if
// the links end the step at q̇ + Δq̇, with
//   L = Jᵀ (W + S)⁻¹ J
// J: of the rows of Loads; W: mobility of all else that they connect, other robots with their gears included; S: softness. The drive
// train integrates (M + L) q̈ = … + τ_e + L q̈', q̈' the acceleration that this unit expects, and its Δq̇ and Δq move the bodies along.
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "components/contact_world/engine/body/body.h"
#include "components/contact_world/parts.h"
#include "models/scene/robot_links.h"

namespace cotwin::contact_world {
namespace {

/// Softness of rigid rows relative to their mobility, for those that others repeat or that hold to the ground.
constexpr double kRegular = 1e-9;

/// (h ω)² of gear and link up to which a step needs no damping, with a soft latch and with rigid ones only.
constexpr double kResolvedWithSoft = 0.03, kResolvedWithRigid = 0.3;

/// Friction above this share of its bound may be at it.
constexpr double kSticks = 0.99;

/// Rounding of a pivot that is 0, relative to its diagonal.
constexpr double kZero = 1e-14;

using Factor = Eigen::Ref<Eigen::MatrixXd>;

/// L of C + kRegular diag(C) = L Lᵀ in the lower triangle of C.
void factorise(Factor C) {
  for (Eigen::Index i = 0; i < C.rows(); ++i) C(i, i) = C(i, i) > 0 ? C(i, i) * (1 + kRegular) : 1;
  Eigen::LLT<Factor> in_place(C);
}

/// Replaces a positive semidefinite matrix by its Cholesky factor, with columns of zeros for directions in which it is 0.
void semidefinite_root(Eigen::MatrixXd& A) {
  for (Eigen::Index j = 0; j < A.cols(); ++j) {
    const double all = A(j, j), left = all - A.row(j).head(j).squaredNorm();
    const double root = left > kZero * all ? std::sqrt(left) : 0;
    for (Eigen::Index i = j; i < A.rows(); ++i)
      A(i, j) = root > 0 ? (A(i, j) - A.row(i).head(j).dot(A.row(j).head(j))) / root : 0;
    A.col(j).head(j).setZero();
  }
}

/// The body of a number in the state, counted from 1; −1 for what is none.
int body_of(double number) { return number >= 1 && number < 1e9 ? static_cast<int>(number) - 1 : -1; }

}  // namespace

/// Whether the robot may hold something that its drive train should know.
bool ContactWorld::may_hold(const Robot& r) const {
  return loads_->free.rows() > 0 && actuation_ == Actuation::kTorque && r.link == LinkSide::kInside;
}

/// Whether the drive train takes it.
bool ContactWorld::gives_loads(const Robot& r) const { return may_hold(r) && r.takes_loads != 0; }

/// Whether a force is one between a link that a drive train moves and a body that can move.
bool ContactWorld::grips(const ContactPoint& point, const Vector3d& f_W) const {
  if (loads_->gripping == loads_->grips || !(f_W.dot(point.n_W) > 0)) return false;
  const auto is_part = [&](int body) {
    const auto index = static_cast<std::size_t>(body);
    return index < bodies_.size() && bodies_[index]->motion == scene::Motion::kDynamic;
  };
  const int link = is_part(point.body_a) ? point.body_b : point.body_a;
  return is_part(point.body_a) != is_part(point.body_b) && std::ranges::any_of(robots_, [&](const auto& r) {
           return gives_loads(*r) &&
                  std::ranges::find(r->parts.bodies, static_cast<std::size_t>(link)) != r->parts.bodies.end();
         });
}

/// Keeps what find_loads() needs of a contact after a step h.
void ContactWorld::add_grip(std::size_t index, double h) {
  const ContactPoint& point = world_->contacts()[index];
  const World::ContactLaw law = world_->contact_law(index);
  const Vector3d f = world_->forces()[index];
  const double normal = f.dot(point.n_W);
  const bool sticks = (f - normal * point.n_W).norm() < kSticks * law.mu * normal;
  double* to = grips_.data() + Loads::kNumbers * loads_->gripping++;
  Eigen::Map<Eigen::Matrix<double, Loads::kNumbers, 1>>(to) << point.body_a + 1, point.body_b + 1, point.p_W, point.n_W,
      law.stiffness < scene::kInfinity ? 1 / (h / 2 * (law.damping + h / 2 * law.stiffness)) : 0, sticks;
}

/// Finds the rows of latches and grips and what they connect, where a step h has led.
void ContactWorld::find_loads(double h) {
  Loads& all = *loads_;
  all.rows.clear();
  if (actuation_ == Actuation::kPrescribed || h == 0) return;
  for (std::size_t l = 0; l < latches_.size(); ++l) {
    const Latch& latch = world_->latches()[l];
    for (int k = 0; k < 6 && latch.closed && !latch.overloaded; ++k) {
      all.rows.push_back({.latch = static_cast<int>(l), .axis = k % 3, .turns = k > 2});
      all.rows.back().read(latch, h);
    }
  }
  for (auto grip = grips_.begin(); grip != grips_.end() && *grip > 0; grip += Loads::kNumbers) {
    const Vector3d p(&grip[2]), n(&grip[5]), t = n.unitOrthogonal();
    Loads::Row row{.parent = body_of(grip[0]), .child = body_of(grip[1]), .d = n, .p = p, .softness = std::max(grip[8], 0.0)};
    all.rows.push_back(row);
    row.softness = 0;
    for (const Vector3d& along : {t, Vector3d(n.cross(t))}) {
      row.d = along;
      if (grip[9] != 0) all.rows.push_back(row);
    }
  }
  const Eigen::Index rows = std::ssize(all.rows);
  auto free = all.free.topLeftCorner(rows, rows);
  free.setZero();
  for (Eigen::Index i = 0; i < rows; ++i) free(i, i) = all.rows[static_cast<std::size_t>(i)].softness;
  for (const auto& body : bodies_) {
    body->held = find_body(body->index);
    body->latched = !floating_ && body->held && !body->jointed && std::ranges::any_of(all.rows, [&](const Loads::Row& row) {
      return row.latch >= 0 && row.sign(body->index) != 0;
    });
    if (body->held) free.noalias() += all.body.topRows(rows) * all.body.topRows(rows).transpose();
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
  const bool soft = std::ranges::any_of(loads_->rows, [](const Loads::Row& row) { return row.softness > 0; });
  compute_mobility(r, r.q_link);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (r.placed->model.joints[k].passive) continue;
    r.damping[k] = step_damping(r, k, h, soft ? kResolvedWithSoft : kResolvedWithRigid);
    r.M(i, i) += r.B[k] + h / 2 * r.damping[k] + h * h / 4 * r.K[k];
  }
  r.root.compute(r.M);
  r.response.leftCols(rows) = r.J.topRows(rows).transpose();
  r.root.matrixL().solveInPlace(r.response.leftCols(rows));
}

/// Whether all that is held are links on fixed bases of drive trains that take their loads, bodies without joints and the ground, by rigid contacts or by latches
/// that bear: their energy comes by nothing else than these, other contacts and inputs.
bool ContactWorld::free_loads() const {
  const auto is_free = [&](int end) {
    if (end < 0) return true;
    const auto index = static_cast<std::size_t>(end);
    if (index < bodies_.size()) return bodies_[index]->motion != scene::Motion::kDriven && !bodies_[index]->jointed;
    return std::ranges::none_of(robots_, [&](const auto& r) {
      return !gives_loads(*r) && std::ranges::find(r->parts.bodies, index) != r->parts.bodies.end();
    });
  };
  return !floating_ && !loads_->rows.empty() && std::ranges::all_of(loads_->rows, [&](const Loads::Row& row) {
    return is_free(row.parent) && is_free(row.child) && (row.latch >= 0 || row.softness == 0);
  }) && std::ranges::none_of(world_->latches(), [](const Latch& latch) { return latch.overloaded; });
}

/// Kinetic and potential energy of the bodies that are held, and of the latches' springs, J.
double ContactWorld::energy_of_loads() {
  double energy = 0, squared = 0;
  for (const Loads::Row& row : loads_->rows) {
    if (row.latch < 0 || !world_->latches()[static_cast<std::size_t>(row.latch)].closed) continue;
    squared = row.axis == 0 ? row.error * row.error : squared + row.error * row.error;
    if (row.axis < 2) continue;
    // The moment of a turned latch is k sin φ, its energy k (1 − cos φ).
    const double cosine = std::copysign(std::sqrt(std::max(0.0, 1 - squared)), row.cosine);
    energy += row.stiffness * (!row.turns ? squared / 2 : cosine > 0 ? squared / (1 + cosine) : 1 - cosine);
  }
  for (const auto& one : bodies_) {
    const RigidBody& body = world_->body(one->index);
    if (one->held) energy += body.kinetic_energy() - body.mass * vector3(gravity_).dot(body.p);
  }
  return energy;
}

/// At the end of a step: what the drive trains have to know of what their links carry, and the energy that it got.
void ContactWorld::write_loads(double h) {
  const bool was_known = free_loads();
  for (Loads::Row& row : loads_->rows) {
    if (row.latch >= 0) row.read(world_->latches()[static_cast<std::size_t>(row.latch)], h);
  }
  load_gain_[1] = energy_of_loads() - loads_->energy;
  for (const auto& one : bodies_) {
    one->was_held = one->held;
    if (!one->held) continue;
    const Pose& X_WB = world_->poses()[one->index];
    const Eigen::AngleAxisd turn(X_WB.R * one->X_start.R.transpose());
    load_gain_[1] -= (vector3(one->f) + one->outer.head<3>()).dot(X_WB.p - one->X_start.p) +
                     turn.angle() * turn.axis().dot(vector3(one->m) + one->outer.tail<3>());
  }
  find_loads(h);
  load_gain_[0] =
      was_known && free_loads() && std::ranges::all_of(bodies_, [](const auto& b) { return b->was_held || !b->held; });
  const Eigen::Index rows = std::ssize(loads_->rows);
  auto factor = loads_->factor.topLeftCorner(rows, rows);
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    if (!may_hold(r)) continue;
    for (std::vector<double>* v : {&r.load_factor, &r.load_torque, &r.load_damping}) std::ranges::fill(*v, 0.0);
    if (!r.held || !gives_loads(r)) continue;
    factor = loads_->free.topLeftCorner(rows, rows);
    for (const auto& other : robots_) {
      if (other == robot || !other->held) continue;
      factor.noalias() += other->response.leftCols(rows).transpose() * other->response.leftCols(rows);
    }
    factorise(factor);
    auto J = r.J.topRows(rows);
    factor.triangularView<Eigen::Lower>().solveInPlace(J);
    const auto n = static_cast<Eigen::Index>(r.n);
    r.M.noalias() = J.transpose() * J;
    Eigen::Map<Eigen::VectorXd>(r.load_torque.data(), n).noalias() = r.M * r.vector(r.ddq);
    semidefinite_root(r.M);
    Eigen::Map<Eigen::MatrixXd>(r.load_factor.data(), n, n) = r.M;  // its columns are the rows of F
    r.load_damping = r.damping;
  }
}

/// The same of one body of the robot.
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
  if (!r.held || !gives_loads(r)) return;
  double given = 0;
  for (std::size_t i = 0; i < r.n; ++i) {
    given += (r.tau_l[i] + r.load_torque[i]) * (r.q[i] - r.q_before[i]);
    double now = 0, before = 0;
    for (std::size_t j = 0; j < r.n; ++j) {
      now += r.load_factor[i * r.n + j] * r.dq[j];
      before += r.load_factor[i * r.n + j] * r.dq_before[j];
    }
    given -= (now * now - before * before) / 2;
    const double twist = r.dtheta[i] - r.dq[i];  // what the damping takes for the step's sake is no loss of the robot
    if (r.load_damping[i] > r.D[i]) given -= h_before_ * (r.load_damping[i] - r.D[i]) * twist * twist;
  }
  for (std::size_t l = 0; l < r.X_WL.size(); ++l) add_correction(r.parts.bodies[l], r.X_WL[l], r.V_WL[l]);
  loads_->given += given;
}

/// At the start of a step: moves the bodies that latches hold along with links that the drive trains have moved otherwise than expected. Bodies in
/// grips move by the forces of their contacts alone.
void ContactWorld::carry_loads() {
  Loads& all = *loads_;
  const Eigen::Index rows = std::ssize(all.rows);
  if (rows == 0) return;
  const double energy = energy_of_loads();
  auto factor = all.factor.topLeftCorner(rows, rows);
  auto motion = all.motion.topRows(rows);
  factor = all.free.topLeftCorner(rows, rows);
  factorise(factor);
  const auto L = factor.triangularView<Eigen::Lower>();
  L.solveInPlace(motion);
  L.transpose().solveInPlace(motion);  // now the impulses and their times, on the first bodies
  for (std::size_t i = 0; i < all.rows.size(); ++i)
    all.rows[i].error += all.rows[i].softness * motion(static_cast<Eigen::Index>(i), 1);
  for (const auto& one : bodies_) {
    if (!one->latched) continue;
    find_body(one->index);
    const RigidBody& body = world_->body(one->index);
    const Eigen::Matrix<double, 6, 2> change = -all.body.topRows(rows).transpose() * motion;
    const auto turned = [&](int k) -> Vector3d {
      return body.R * body.inverse_root_moments.cwiseProduct(change.col(k).tail<3>());
    };
    const Vector3d dv = body.inverse_root_mass * change.col(0).head<3>(), w = body.w + turned(0), turn = turned(1);
    const Vector3d impulse = body.mass * dv, spin = body.R * body.root_moments.cwiseProduct(change.col(0).tail<3>());
    share_among_latches(one->index, impulse, spin);
    const Vector3d centre = body.p + body.inverse_root_mass * change.col(1).head<3>();
    const double angle = turn.norm();
    const Matrix3d R = angle > 0 ? Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix() : Matrix3d(Matrix3d::Identity());
    const Pose X_WB = world_->poses()[one->index];
    const Vector3d arm = R * (X_WB.p - body.p);
    Twist V_WB;
    V_WB << body.v + dv + w.cross(arm), w;
    world_->set_pose(one->index, {R * X_WB.R, centre + arm});
    world_->set_twist(one->index, V_WB);
  }
  motion.setZero();
  all.energy = energy_of_loads();
  for (const auto& one : bodies_) one->X_start = world_->poses()[one->index];
  const double given = std::exchange(all.given, 0);
  if (!free_loads()) return;
  for (const auto& one : bodies_) {
    if (one->held) world_->leave_out(one->index);
  }
  for (const auto& r : robots_) {
    if (!r->held) continue;
    world_->leave_out(r->parts.bodies.back());
    if (std::exchange(load_gain_[0], 0) != 0)
      world_->add_gain(r->parts.bodies.back(), given + load_gain_[1] + all.energy - energy);
  }
}

/// Shows the impulse and spin that a body has got in the last step besides the latches' in their forces. Several ones share it, since rigid ones
/// together are not determined.
void ContactWorld::share_among_latches(std::size_t index, const Vector3d& impulse, const Vector3d& spin) {
  const auto holds = [&](const Loads::Row& row) {
    return row.latch >= 0 && row.axis == 0 && !row.turns && row.sign(index) != 0;
  };
  const auto number = static_cast<double>(std::ranges::count_if(loads_->rows, holds));
  for (const Loads::Row& row : loads_->rows) {
    if (!holds(row)) continue;
    const double share = row.sign(index) / number;
    latches_[static_cast<std::size_t>(row.latch)].carry(share * impulse,
                                                        share * (spin + (world_->body(index).p - row.p).cross(impulse)));
  }
}

}  // namespace cotwin::contact_world
