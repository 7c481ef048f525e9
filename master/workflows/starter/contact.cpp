#include "master/workflows/starter/contact.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose.h"
#include "models/numerics/dense.h"
#include "models/numerics/random.h"
#include "models/robot/urdf/urdf_document.h"

namespace cotwin::master::starter {

namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using robot::Joint;
using robot::RobotModel;

std::size_t at(Eigen::Index i) { return static_cast<std::size_t>(i); }
bool turns(const Joint& joint) { return joint.type == robot::JointType::kRevolute; }
double to_grain(double x, double grain) { return std::round(x / grain) * grain; }

}  // namespace

const robot::Frame& flange(const RobotModel& robot) {
  constexpr int kFinger = 5, kArm = 3;  // joints
  const robot::Frame& end = robot.end_effector();
  const auto joints_to = [&](int body) {
    int count = 0;
    for (; body >= 0; body = robot.joint_of(body).parent) ++count;
    return count;
  };
  const auto children = [&](int body) {
    int count = 0;
    for (int other = 0; other < robot.body_count(); ++other) count += robot.joint_of(other).parent == body ? 1 : 0;
    return count;
  };
  int palm = end.body, passed = 0;
  for (int body = end.body; body >= 0; body = robot.joint_of(body).parent, ++passed) {
    if (passed > 0 && passed <= kFinger && children(body) > 1 && joints_to(body) >= kArm) palm = body;
  }
  if (palm == end.body) return end;
  const auto last =
      std::find_if(robot.frames.rbegin(), robot.frames.rend(), [&](const robot::Frame& f) { return f.body == palm; });
  return last == robot.frames.rend() ? end : *last;
}

double within(const Joint& joint, double q, double margin) {
  const bool low = std::isfinite(joint.q_min), high = std::isfinite(joint.q_max);
  if (low && high) {
    if (!(joint.q_max > joint.q_min)) return joint.q_min;
    const double distance = margin * (joint.q_max - joint.q_min);
    return std::clamp(q, joint.q_min + distance, joint.q_max - distance);
  }
  const double distance = turns(joint) ? 0.3 : 0.05;  // rad, m
  if (low) return std::max(q, joint.q_min + distance);
  return high ? std::min(q, joint.q_max - distance) : q;
}

VectorXd rest_posture(const RobotModel& robot) {
  VectorXd q(robot.n());
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const Joint& joint = robot.joints[at(i)];
    q[i] = within(joint, to_grain(within(joint, 0, 0.15), 0.01), 0);
  }
  return q;
}

ContactPlanner::ContactPlanner(const RobotModel& robot, const robot::Frame& frame)
    : robot_(robot), frame_(frame), mechanism_(robot), data_(mechanism_), probe_(robot::on_body(frame)) {
  if (frame.body < 0) fail("it is fixed to the base");
  size_ = reach();
  Pose X_BP;
  if (const MatrixXd J = translation(rest_posture(robot), X_BP); !(numerics::singular_values(J)[0] > 1e-6)) {
    // On the axis of the joints that move it, as the hub of a wheel: the probe is mounted beside the axis.
    const robot::Body& body = robot.bodies[at(frame.body)];
    const double gyration = body.inertia.mass > 0 ? std::sqrt(body.inertia.I_CC.trace() / 2 / body.inertia.mass) : 0;
    size_ = std::clamp(gyration, 0.02, 0.5);
    const Vector3d axis = robot.joint_of(frame.body).axis;
    p_FA_ = frame.X_BF.R.transpose() * (size_ * axis.unitOrthogonal());
    probe_.X_BF.p += probe_.X_BF.R * p_FA_;
    if (!(numerics::singular_values(translation(rest_posture(robot), X_BP))[0] > 1e-6)) fail("it does not move in a line");
  }
  order_postures();
}

MatrixXd ContactPlanner::translation(const VectorXd& q, Pose& X_BP) {
  MatrixXd J(6, robot_.n());
  X_BP = robot::jacobian(mechanism_, data_, q, probe_, J);
  return J.topRows(3);
}

/// Length of the chain from the first joint to the frame, m.
double ContactPlanner::reach() const {
  constexpr double kLongestSlide = 2;  // m; longer ranges are those of rails, or mean no limit
  double length = frame_.X_BF.p.norm();
  for (int body = frame_.body; body >= 0; body = robot_.joint_of(body).parent) {
    const Joint& moved = robot_.joint_of(body);
    if (moved.parent >= 0) length += moved.X_PJ.p.norm();
    if (!turns(moved) && std::isfinite(moved.q_max - moved.q_min)) length += std::min(moved.q_max - moved.q_min, kLongestSlide);
  }
  return length;
}

/// Of 500 postures those in which the end-effector moves best in all directions in which it can move.
void ContactPlanner::order_postures() {
  constexpr std::uint32_t kTried = 500;
  const VectorXd rest = rest_posture(robot_);
  std::vector<std::pair<double, VectorXd>> scored;
  for (std::uint32_t k = 0; k < kTried; ++k) {
    VectorXd q = rest;
    for (Eigen::Index i = 0; k > 0 && i < q.size(); ++i) {
      const Joint& joint = robot_.joints[at(i)];
      const double u = 2 * numerics::uniform({1, 0x57a7, 0, k, static_cast<std::uint32_t>(i)}) - 1;
      q[i] = to_grain(within(joint, rest[i] + u * (turns(joint) ? 1.6 : 0.5 * size_), 0.2), 0.01);
    }
    Pose X_BP;
    const VectorXd sigma = numerics::singular_values(translation(q, X_BP));
    double score = 1;
    for (Eigen::Index i = 0; i < sigma.size(); ++i) score *= sigma[i] + 0.02 * size_;
    scored.emplace_back(score, std::move(q));
  }
  std::ranges::stable_sort(scored, [](const auto& a, const auto& b) { return a.first > b.first; });
  for (const std::size_t k : {std::size_t{0}, std::size_t{7}, std::size_t{40}}) postures_.push_back(scored[k].second);
}

const VectorXd& ContactPlanner::posture(const Press& press) const { return postures_[at(press.posture)]; }

/// Downwards where the robot can; otherwise the directions in which it moves best, away from its base first.
std::optional<Vector3d> ContactPlanner::direction(const Press& press, const MatrixXd& J, const Vector3d& p) const {
  const numerics::Svd svd = numerics::svd(J);
  if (press.direction == 0) {
    if (J.row(2).norm() < 0.3 * svd.values[0]) return std::nullopt;
    return Vector3d(-Vector3d::UnitZ());
  }
  const Eigen::Index column = (press.direction - 1) / 2;
  if (column >= svd.values.size() || svd.values[column] < 0.1 * svd.values[0]) return std::nullopt;
  Vector3d u = svd.U.col(column);
  if (u.dot(p) < 0) u = -u;
  return press.direction % 2 == 1 ? u : Vector3d(-u);
}

/// The posture after the way along u.
VectorXd ContactPlanner::follow(const VectorXd& start, const Vector3d& u, double way) {
  constexpr int kSteps = 200;
  VectorXd q = start;
  Pose X_BP;
  const MatrixXd J = translation(q, X_BP);
  const Vector3d begin = X_BP.p;
  const double sigma = numerics::singular_values(J)[0];
  for (int k = 1; k <= kSteps; ++k) {
    const MatrixXd Jq = translation(q, X_BP);
    const Vector3d missing = begin + u * (way * k / kSteps) - X_BP.p;
    const Eigen::Matrix3d A = Jq * Jq.transpose() + 1e-3 * sigma * sigma * Eigen::Matrix3d::Identity();
    q += Jq.transpose() * numerics::solve_ldlt(MatrixXd(A), missing);
    for (Eigen::Index i = 0; i < q.size(); ++i) q[i] = within(robot_.joints[at(i)], q[i], 0.01);
  }
  return q;
}

/// The force f at which the plate's spring, f = k_p · depth, and the joint admittance, S_a (q − q_d) = Jᵀ(q) (−u f), are at rest together.
/// `start`: u · p of the probe's centre when it touches.
double ContactPlanner::force_at_rest(const VectorXd& end, const Contact& contact, const std::vector<double>& S_a,
                                     double start) {
  const auto depth_under = [&](double force) {
    VectorXd q = end;
    Pose X_BP;
    for (int k = 0; k < 30; ++k) {
      const MatrixXd J = translation(q, X_BP);
      for (Eigen::Index i = 0; i < q.size(); ++i) q[i] = end[i] - force * J.col(i).dot(contact.direction) / S_a[at(i)];
    }
    translation(q, X_BP);
    return contact.direction.dot(X_BP.p) - start;
  };
  double low = 0, high = contact.kp * contact.depth;
  for (int k = 0; k < 50; ++k) {
    const double force = (low + high) / 2;
    (contact.kp * depth_under(force) > force ? low : high) = force;
  }
  return low;
}

std::optional<ContactPlanner::Plan> ContactPlanner::plan(const Press& press, const MatrixXd& M, std::vector<double> S_a) {
  const VectorXd& start = posture(press);
  probe_ = robot::on_body(frame_);
  probe_.X_BF.p += probe_.X_BF.R * p_FA_;
  Pose X_BP;
  const MatrixXd J = translation(start, X_BP);
  const std::optional<Vector3d> wanted = direction(press, J, X_BP.p);
  if (!wanted) return std::nullopt;
  const Vector3d u = *wanted;
  Contact contact;
  contact.frame = frame_.name;
  contact.tool = "probe";
  while (std::ranges::any_of(robot_.frames, [&](const robot::Frame& f) { return f.name == contact.tool; })) contact.tool += "_";
  contact.direction = u;
  contact.radius = to_grain(std::clamp(0.02 * size_, 0.002, 0.02), 0.001);
  // In front of the frame; beside it, a probe that can move only one way would move another way.
  const VectorXd sigma = numerics::singular_values(J);
  const bool one_way = sigma.size() < 2 || sigma[1] < 0.1 * sigma[0];
  contact.p_FP = p_FA_;
  if (!one_way) contact.p_FP += X_BP.R.transpose() * u * std::clamp(0.12 * size_, 0.01, 0.15);
  probe_.X_BF = robot::on_body(frame_).X_BF;
  probe_.X_BF.p += probe_.X_BF.R * contact.p_FP;
  constexpr double kGrain = 1e-4;  // m
  contact.gap = std::max(to_grain(0.04 * size_ * press.scale, kGrain), kGrain);
  contact.depth = std::max(to_grain(0.03 * size_ * press.scale, kGrain), kGrain);
  contact.width = 0.2 * size_;
  contact.height = 0.05 * size_;

  translation(start, X_BP);
  const Vector3d begin = X_BP.p;
  const double way = contact.gap + contact.depth;
  VectorXd q = follow(start, u, way);
  const MatrixXd J_end = translation(q, X_BP);
  if (!((X_BP.p - begin - u * way).norm() < 0.1 * contact.depth)) fail("it cannot go on by " + text::to_text(way, 3) + " m");
  for (double& x : q) x = to_grain(x, 1e-6);

  contact.p_WO = begin + u * (contact.radius + contact.gap + contact.height / 2);
  contact.rpy = robot::rpy_of(Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), -u).toRotationMatrix());
  // Stiffness of the joint admittance at the probe along u; the force is to be a tenth of the weight of the moving bodies.
  const VectorXd a = J_end.transpose() * u;
  const auto stiffness = [&] {
    double yielding = 0;
    for (Eigen::Index i = 0; i < a.size(); ++i) yielding += a[i] * a[i] / S_a[at(i)];
    return 1 / yielding;
  };
  constexpr double kHarder = 10;  // than the robot is the plate
  double mass = 0;
  for (const robot::Body& body : robot_.bodies) mass += body.inertia.mass;
  if (mass > 0) {
    const double now = contact.depth * stiffness() * kHarder / (1 + kHarder);
    const double factor = std::clamp(0.1 * mass * 9.81 / now, 1.0 / 16, 2.25);
    for (double& S : S_a) S = text::parse_real(text::to_text(factor * S, 3)).value();
  }
  const double effective_mass = 1 / a.dot(numerics::solve_ldlt(M, a));
  contact.kp = text::parse_real(text::to_text(kHarder * stiffness(), 2)).value();
  contact.kd = text::parse_real(text::to_text(std::sqrt(contact.kp * effective_mass), 2)).value();
  contact.force = force_at_rest(q, contact, S_a, u.dot(begin) + contact.gap);
  return Plan{contact, q, std::move(S_a)};
}

void ContactPlanner::fail(const std::string& why) const {
  throw Error("robot '" + robot_.name + "', frame '" + frame_.name + "'", why);
}

}  // namespace cotwin::master::starter
