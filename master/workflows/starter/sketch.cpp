#include "master/workflows/starter/sketch.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose.h"
#include "models/numerics/dense.h"
#include "models/numerics/random.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf_document.h"
#include "models/trajectory/waypoints.h"

namespace cotwin::master::starter {

namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using robot::Joint;
using robot::JointType;
using robot::RobotModel;

bool is_revolute(const Joint& joint) { return joint.type == JointType::kRevolute; }
double rounded(double x, double grain) { return std::round(x / grain) * grain; }
std::size_t index(Eigen::Index i) { return static_cast<std::size_t>(i); }

/// `q` at least the share `margin` of the range away from both limits.
double within(const Joint& joint, double q, double margin) {
  const bool low = std::isfinite(joint.q_min), high = std::isfinite(joint.q_max);
  if (low && high) {
    if (!(joint.q_max > joint.q_min)) return joint.q_min;
    const double distance = margin * (joint.q_max - joint.q_min);
    return std::clamp(q, joint.q_min + distance, joint.q_max - distance);
  }
  const double distance = is_revolute(joint) ? 0.3 : 0.05;  // rad, m
  if (low) return std::max(q, joint.q_min + distance);
  return high ? std::min(q, joint.q_max - distance) : q;
}

/// Near zero and away from the limits.
VectorXd rest_posture(const RobotModel& robot) {
  VectorXd q(robot.n());
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const Joint& joint = robot.joints[index(i)];
    q[i] = within(joint, rounded(within(joint, 0, 0.15), 0.01), 0);
  }
  return q;
}

class Maker {
 public:
  Maker(const RobotModel& robot, Kind kind)
      : robot_(robot), mechanism_(robot), data_(mechanism_), axes_(trajectory::axes_of(robot)), n_(robot.n()) {
    sketch_.kind = kind;
  }

  Sketch make(const std::optional<Drives>& known) {
    VectorXd q = rest_posture(robot_);
    if (sketch_.kind == Kind::kContact) {
      probe_ = robot::on_body(robot_.end_effector());
      size_ = reach();
      q = bent_posture();
    }
    choose_drives(q, known);
    choose_compliance(q);
    if (sketch_.kind == Kind::kMotion) add_motion(q);
    if (sketch_.kind == Kind::kCompliance) add_push(q);
    if (sketch_.kind == Kind::kContact) add_contact(q);
    keep_to_efforts();
    const Waypoint& last = sketch_.waypoints.back();
    sketch_.stop = std::ceil(last.t + last.dwell + 0.5);
    return std::move(sketch_);
  }

 private:
  const Joint& joint(Eigen::Index i) const { return robot_.joints[index(i)]; }
  VectorXd gravity(const VectorXd& q) {
    VectorXd g(n_);
    robot::gravity(mechanism_, data_, q, g);
    return g;
  }
  MatrixXd inertia(const VectorXd& q) {
    MatrixXd M(n_, n_);
    robot::mass_matrix(mechanism_, data_, q, M);
    for (Eigen::Index i = 0; i < n_; ++i) M(i, i) += sketch_.drives.B.empty() ? 0 : sketch_.drives.B[index(i)];
    return M;
  }
  /// Of the probe's centre, 3 x n, in the base frame.
  MatrixXd translation(const VectorXd& q, Pose& X_BP) {
    MatrixXd J(6, n_);
    X_BP = robot::jacobian(mechanism_, data_, q, probe_, J);
    return J.topRows(3);
  }

  /// Length of the chain from the first joint to the end-effector, m.
  double reach() const {
    double length = 0;
    const robot::Frame& end = robot_.end_effector();
    if (end.body < 0) return 0;
    length += end.X_BF.p.norm();
    for (int body = end.body; body >= 0; body = robot_.joint_of(body).parent) {
      const Joint& moved = robot_.joint_of(body);
      if (moved.parent >= 0) length += moved.X_PJ.p.norm();
      if (!is_revolute(moved) && std::isfinite(moved.q_max - moved.q_min)) length += moved.q_max - moved.q_min;
    }
    return length;
  }

  /// Of 500 postures the one in which the end-effector moves best in all directions in which it can move.
  VectorXd bent_posture() {
    const VectorXd rest = rest_posture(robot_);
    VectorXd best = rest;
    double highest = -1;
    for (std::uint32_t k = 0; k < 500; ++k) {
      VectorXd q = rest;
      for (Eigen::Index i = 0; k > 0 && i < n_; ++i) {
        const double u = 2 * numerics::uniform({1, 0x57a7, 0, k, static_cast<std::uint32_t>(i)}) - 1;
        q[i] = rounded(within(joint(i), rest[i] + u * (is_revolute(joint(i)) ? 1.6 : 0.5 * size_), 0.2), 0.01);
      }
      Pose X_BP;
      const VectorXd sigma = numerics::singular_values(translation(q, X_BP));
      double score = 1;
      for (Eigen::Index i = 0; i < sigma.size(); ++i) score *= sigma[i] + 0.02 * size_;
      if (score > highest) {
        highest = score;
        best = q;
      }
    }
    return best;
  }

  void choose_drives(const VectorXd& q, const std::optional<Drives>& known) {
    sketch_.assumed = !known.has_value();
    if (known) {
      sketch_.drives = *known;
      return;
    }
    // Motors behind gears are about as heavy as the links: half of them, at least 5 % of the heaviest joint of the kind.
    const VectorXd M = inertia(q).diagonal();
    Drives& d = sketch_.drives;
    for (Eigen::Index i = 0; i < n_; ++i) {
      double heaviest = 0;
      for (Eigen::Index j = 0; j < n_; ++j) {
        if (joint(j).type == joint(i).type) heaviest = std::max(heaviest, M[j]);
      }
      const double B = std::max({0.5 * M[i], 0.05 * heaviest, is_revolute(joint(i)) ? 1e-3 : 1e-2});
      d.B.push_back(text::parse_real(text::to_text(B, 2)).value());
      d.K.push_back(0);
      d.D.push_back(0);
      d.sigma2.push_back(joint(i).damping);
      d.tau_C.push_back(joint(i).friction);
    }
    sketch_.notes.emplace_back(
        "nothing is known of the drives: joints are rigid, and the inertia of the motors is assumed as half of that of the "
        "links "
        "(drive_train.ssv)");
    if (std::any_of(robot_.joints.begin(), robot_.joints.end(), [](const Joint& j) { return j.damping > 0 || j.friction > 0; }))
      sketch_.notes.emplace_back("friction of the motors: <dynamics> of the URDF");
  }

  void choose_compliance(const VectorXd& q) {
    const VectorXd M = inertia(q).diagonal();
    const bool contact = sketch_.kind == Kind::kContact;
    const double omega = contact ? 8 : 4;  // rad/s
    sketch_.zeta_a = contact ? 2 : 1;
    for (Eigen::Index i = 0; i < n_; ++i) {
      const double m = text::parse_real(text::to_text(contact ? 2 * M[i] : M[i], 2)).value();
      sketch_.M_a.push_back(m);
      sketch_.S_a.push_back(text::parse_real(text::to_text(m * omega * omega, 3)).value());
    }
  }

  /// To one side, to the other and back, neighbouring joints in opposite directions.
  void add_motion(const VectorXd& rest) {
    VectorXd one = rest, other = rest;
    for (Eigen::Index i = 0; i < n_; ++i) {
      const double range = joint(i).q_max - joint(i).q_min;
      double way = is_revolute(joint(i)) ? 0.4 : 0.1;  // rad, m
      if (std::isfinite(range)) way = std::min(way, 0.25 * range);
      if (i % 2 == 1) way = -way;
      one[i] = within(joint(i), rounded(rest[i] + way, 0.001), 0.02);
      other[i] = within(joint(i), rounded(rest[i] - way, 0.001), 0.02);
    }
    add(rest, 0, 0.5);
    add(one, 0, 0.5);
    add(other, 0, 0.5);
    add(rest, 0, 0);
  }

  /// Stands while it is pushed from 1 to 4 s, and from 7 to 10 s with twice the stiffness.
  void add_push(const VectorXd& rest) {
    const VectorXd g = gravity(rest);
    for (Eigen::Index i = 0; i < n_; ++i) {
      double push = sketch_.S_a[index(i)] * (is_revolute(joint(i)) ? 0.1 : 0.02);  // deviation in rad, m
      const double free = joint(i).tau_max - std::abs(g[i]);
      if (free > 0) push = std::min(push, 0.3 * free);
      sketch_.push.push_back(text::parse_real(text::to_text(push, 2)).value());
    }
    add(rest, 0, 0);
    add(rest, 13, 0);
  }

  void add(const VectorXd& q, double t, double dwell) {
    if (!sketch_.waypoints.empty() && t == 0) {
      const Waypoint& last = sketch_.waypoints.back();
      const auto n = static_cast<std::size_t>(n_);
      t = last.t + last.dwell + trajectory::calm_duration(axes_, {last.q.data(), n}, {q.data(), n});
    }
    sketch_.waypoints.push_back({t, q, dwell});
  }

  void add_contact(const VectorXd& start) {
    const robot::Frame& end = robot_.end_effector();
    if (!(size_ > 1e-3)) fail_contact("its end-effector '" + end.name + "' does not move");
    Pose X_BP;
    const MatrixXd J = translation(start, X_BP);
    const numerics::Svd svd = numerics::svd(J);
    const double sigma = svd.values[0];
    if (!(sigma > 1e-6)) fail_contact("its end-effector '" + end.name + "' does not move in a line");
    // Downwards where the robot can; otherwise in the direction in which it moves best, away from its base.
    Vector3d u = -Vector3d::UnitZ();
    if (J.row(2).norm() < 0.3 * sigma) {
      u = svd.U.col(0);
      if (u.dot(X_BP.p) < 0) u = -u;
    }
    Contact contact;
    contact.frame = end.name;
    contact.tool = "probe";
    while (
        std::any_of(robot_.frames.begin(), robot_.frames.end(), [&](const robot::Frame& f) { return f.name == contact.tool; }))
      contact.tool += "_";
    contact.direction = u;
    contact.radius = rounded(std::clamp(0.02 * size_, 0.002, 0.02), 0.001);
    contact.p_FP = X_BP.R.transpose() * u * std::clamp(0.12 * size_, 0.01, 0.15);
    probe_.X_BF.p += probe_.X_BF.R * contact.p_FP;
    contact.gap = std::max(rounded(0.04 * size_, 0.001), 0.001);
    contact.depth = std::max(rounded(0.03 * size_, 0.001), 0.001);
    contact.width = 0.4 * size_;
    contact.height = 0.05 * size_;

    VectorXd q = start;
    translation(q, X_BP);
    const Vector3d begin = X_BP.p;
    const double way = contact.gap + contact.depth;
    constexpr int kSteps = 200;
    for (int k = 1; k <= kSteps; ++k) {
      const MatrixXd Jq = translation(q, X_BP);
      const Vector3d missing = begin + u * (way * k / kSteps) - X_BP.p;
      const double damping = 1e-3 * sigma * sigma;
      const Eigen::Matrix3d A = Jq * Jq.transpose() + damping * Eigen::Matrix3d::Identity();
      q += Jq.transpose() * numerics::solve_ldlt(MatrixXd(A), missing);
      for (Eigen::Index i = 0; i < n_; ++i) q[i] = within(joint(i), q[i], 0.01);
    }
    const MatrixXd J_end = translation(q, X_BP);
    if (!(std::abs(u.dot(X_BP.p - begin) - way) < 0.1 * contact.depth))
      fail_contact("its end-effector '" + end.name + "' cannot go on by " + text::to_text(way, 3) + " m");

    contact.p_WO = begin + u * (contact.radius + contact.gap + contact.height / 2);
    contact.rpy = robot::rpy_of(Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), -u).toRotationMatrix());
    // Stiffness of the joint admittance at the probe along u; the force is to be a tenth of the weight of the moving bodies.
    const VectorXd a = J_end.transpose() * u;
    const auto stiffness = [&] {
      double yielding = 0;
      for (Eigen::Index i = 0; i < n_; ++i) yielding += a[i] * a[i] / sketch_.S_a[index(i)];
      return 1 / yielding;
    };
    constexpr double kHarder = 10;  // than the robot is the plate
    double mass = 0;
    for (const robot::Body& body : robot_.bodies) mass += body.inertia.mass;
    if (mass > 0) {
      const double now = contact.depth * stiffness() * kHarder / (1 + kHarder);
      const double factor = std::clamp(0.1 * mass * 9.81 / now, 1.0 / 16, 2.25);
      for (double& S : sketch_.S_a) S = text::parse_real(text::to_text(factor * S, 3)).value();
    }
    const double softer = stiffness();
    const double effective_mass = 1 / a.dot(numerics::solve_ldlt(inertia(q), a));
    contact.kp = text::parse_real(text::to_text(kHarder * softer, 2)).value();
    contact.kd = text::parse_real(text::to_text(std::sqrt(contact.kp * effective_mass), 2)).value();
    contact.force = contact.depth * softer * contact.kp / (softer + contact.kp);

    for (double& x : q) x = rounded(x, 1e-6);
    add(start, 0, 0.5);
    add(q, 0, 2);
    add(start, 0, 0);
    // The motion into the plate is slow.
    for (std::size_t i = 1; i < 3; ++i) {
      const double late =
          std::max(0.0, 3 - (sketch_.waypoints[i].t - sketch_.waypoints[i - 1].t - sketch_.waypoints[i - 1].dwell));
      for (std::size_t k = i; k < 3; ++k) sketch_.waypoints[k].t += late;
    }
    sketch_.contact = contact;
  }

  [[noreturn]] void fail_contact(const std::string& why) const {
    throw Error("robot '" + robot_.name + "'", why + ", expected --kind motion or compliance");
  }

  /// Slows the motion down until the motors have the torque; sets limits aside that do not carry the robot's weight.
  void keep_to_efforts() {
    const auto joints = static_cast<std::size_t>(n_);
    for (int attempt = 0;; ++attempt) {
      trajectory::Waypoints points;
      points.joints = joints;
      for (const Waypoint& w : sketch_.waypoints) {
        points.t.push_back(w.t);
        points.q.insert(points.q.end(), w.q.begin(), w.q.end());
        points.dwell.push_back(w.dwell);
      }
      const trajectory::Path path = trajectory::make_path(points, trajectory::Passing::kRest);
      VectorXd q(n_), dq(n_), ddq(n_), tau(n_), most = VectorXd::Zero(n_), weight = VectorXd::Zero(n_);
      constexpr int kSamples = 400;
      for (int k = 0; k <= kSamples; ++k) {
        const double t = path.begin() + (path.end() - path.begin()) * k / kSamples;
        path.at(t, {q.data(), joints}, {dq.data(), joints}, {ddq.data(), joints});
        robot::inverse_dynamics(mechanism_, data_, q, dq, ddq, tau);
        weight = weight.cwiseMax(gravity(q).cwiseAbs());
        for (Eigen::Index i = 0; i < n_; ++i) {
          const Drives& d = sketch_.drives;
          const std::size_t j = index(i);
          double other = d.B[j] * std::abs(ddq[i]) + d.sigma2[j] * std::abs(dq[i]) + d.tau_C[j];
          if (!sketch_.push.empty()) other += sketch_.push[j];
          most[i] = std::max(most[i], std::abs(tau[i]) + other);
        }
      }
      bool slower = false;
      for (Eigen::Index i = 0; i < n_; ++i) {
        const Joint& j = joint(i);
        if (most[i] <= 0.9 * j.tau_max || set_aside(j.name)) continue;
        if (attempt < 6 && sketch_.kind != Kind::kCompliance && weight[i] <= 0.8 * j.tau_max) {
          slower = true;
          continue;
        }
        sketch_.without_limit.push_back(j.name);
        sketch_.notes.push_back("joint '" + j.name + "': the URDF's effort limit of " + text::to_text(j.tau_max) +
                                " does not carry the motion, which takes up to " + text::to_text(most[i], 3) +
                                "; it is set aside (tau_max in compliance.ssv)");
      }
      if (!slower) return;
      for (Waypoint& w : sketch_.waypoints) w.t = rounded(1.4 * w.t, 0.1);
    }
  }
  bool set_aside(const std::string& name) const {
    return std::find(sketch_.without_limit.begin(), sketch_.without_limit.end(), name) != sketch_.without_limit.end();
  }

  const RobotModel& robot_;
  robot::Mechanism mechanism_;
  robot::Data data_;
  std::vector<trajectory::Axis> axes_;
  Eigen::Index n_;
  Sketch sketch_;
  robot::FrameOnBody probe_;
  double size_ = 0;  // of the robot, m
};

}  // namespace

Sketch make_sketch(const RobotModel& robot, Kind kind, const std::optional<Drives>& known) {
  const std::string place = "robot '" + robot.name + "'";
  if (robot.n() == 0) throw Error(place, "has no joint that moves, expected revolute, continuous or prismatic joints");
  for (const Joint& joint : robot.joints) {
    if (joint.passive) throw Error(place, "joint '" + joint.name + "' is passive, expected motors at all joints, or --lock");
  }
  return Maker(robot, kind).make(known);
}

}  // namespace cotwin::master::starter
