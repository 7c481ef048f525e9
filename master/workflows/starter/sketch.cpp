#include "master/workflows/starter/sketch.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "master/workflows/starter/contact.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/dynamics.h"
#include "models/trajectory/waypoints.h"

namespace cotwin::master::starter {

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using robot::Joint;
using robot::JointType;
using robot::RobotModel;

bool is_revolute(const Joint& joint) { return joint.type == JointType::kRevolute; }
double rounded(double x, double grain) { return std::round(x / grain) * grain; }
std::size_t index(Eigen::Index i) { return static_cast<std::size_t>(i); }

class Maker {
 public:
  Maker(const RobotModel& robot, Kind kind)
      : robot_(robot), mechanism_(robot), data_(mechanism_), axes_(trajectory::axes_of(robot)), n_(robot.n()) {
    sketch_.kind = kind;
  }

  std::optional<Sketch> make(const std::optional<Drives>& known, ContactPlanner* planner, const Press& press) {
    const VectorXd q = planner == nullptr ? rest_posture(robot_) : planner->posture(press);
    choose_drives(q, known);
    choose_compliance(q);
    if (sketch_.kind == Kind::kMotion) add_motion(q);
    if (sketch_.kind == Kind::kCompliance) add_push(q);
    if (planner != nullptr) {
      const std::optional<ContactPlanner::Plan> plan = planner->plan(press, inertia(q), sketch_.S_a);
      if (!plan) return std::nullopt;
      add_contact(q, *plan);
    }
    keep_to_efforts();
    const Waypoint& last = sketch_.waypoints.back();
    sketch_.stop = std::ceil(last.t + last.dwell + 0.5);
    constexpr double kLongest = 1000;  // s
    if (!(sketch_.stop <= kLongest)) {
      const auto slowest = std::ranges::min_element(robot_.joints, {}, &Joint::dq_max);
      throw Error("robot '" + robot_.name + "'",
                  "the motion takes " + text::to_text(sketch_.stop, 3) + " s, expected at most " + text::to_text(kLongest) +
                      " s; joint '" + slowest->name + "' has a speed limit of " + text::to_text(slowest->dq_max, 3));
    }
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
  void choose_drives(const VectorXd& q, const std::optional<Drives>& known) {
    sketch_.assumed = !known.has_value();
    if (known) {
      sketch_.drives = *known;
      return;
    }
    // Motors behind gears are about as heavy as the links: half of them, at least 5 % of the heaviest joint of the kind.
    const VectorXd M = inertia(q).diagonal();
    Drives& d = sketch_.drives;
    const VectorXd g = gravity(q);
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
      // At its limits of torque and speed a motor loses about a third of its power; unknown limits from weight and a calm motion.
      const double unit = is_revolute(joint(i)) ? 1 : 0.25, slow = unit, fast = 5 * unit;  // rad/s, rad/s2; m/s, m/s2
      const double tau =
          std::isfinite(joint(i).tau_max) && joint(i).tau_max > 0 ? joint(i).tau_max : 2 * std::abs(g[i]) + fast * (M[i] + B);
      const double power = tau * (std::isfinite(joint(i).dq_max) && joint(i).dq_max > 0 ? joint(i).dq_max : slow);
      d.k_t.push_back(text::parse_real(text::to_text(tau / std::sqrt(power / 3), 3)).value());
      d.power += power;
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
      constexpr double kShare = 0.3, kLongest = 10;  // of the speed limit, s
      if (joint(i).dq_max * kShare * kLongest < way) {
        way = joint(i).dq_max * kShare * kLongest;
        sketch_.notes.push_back("joint '" + joint(i).name + "' moves by " + text::to_text(way, 2) +
                                " only, because its speed limit is " + text::to_text(joint(i).dq_max, 3));
      }
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
      if (const double way = joint(i).q_max - rest[i]; way > 0) push = std::min(push, 0.5 * way * sketch_.S_a[index(i)]);
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

  void add_contact(const VectorXd& start, const ContactPlanner::Plan& plan) {
    sketch_.contact = plan.contact;
    sketch_.S_a = plan.S_a;
    add(start, 0, 0.5);
    add(plan.end, 0, 2);
    add(start, 0, 0);
    // The motion into the plate is slow.
    for (std::size_t i = 1; i < 3; ++i) {
      const double late =
          std::max(0.0, 3 - (sketch_.waypoints[i].t - sketch_.waypoints[i - 1].t - sketch_.waypoints[i - 1].dwell));
      for (std::size_t k = i; k < 3; ++k) sketch_.waypoints[k].t += late;
    }
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
};

}  // namespace

void check_robot(const RobotModel& robot) {
  const std::string place = "robot '" + robot.name + "'";
  if (robot.n() == 0) throw Error(place, "has no joint that moves, expected revolute, continuous or prismatic joints");
  for (const Joint& joint : robot.joints) {
    if (joint.passive) throw Error(place, "joint '" + joint.name + "' is passive, expected motors at all joints, or --lock");
  }
}

Sketch make_sketch(const RobotModel& robot, Kind kind, const std::optional<Drives>& known) {
  check_robot(robot);
  return Maker(robot, kind).make(known, nullptr, {}).value();
}

std::optional<Sketch> make_contact(const RobotModel& robot, ContactPlanner& planner, const Press& press,
                                   const std::optional<Drives>& known) {
  check_robot(robot);
  return Maker(robot, Kind::kContact).make(known, &planner, press);
}

}  // namespace cotwin::master::starter
