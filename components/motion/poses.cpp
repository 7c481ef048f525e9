#include "components/motion/poses.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"

namespace cotwin::motion {

using Eigen::Quaterniond, Eigen::Vector3d, Eigen::Vector4d;

namespace {

Vector3d vector(const std::vector<double>& x, std::size_t k) { return {x[3 * k], x[3 * k + 1], x[3 * k + 2]}; }

void put(std::array<double, 3>& to, const Vector3d& from) { std::copy(from.begin(), from.end(), to.begin()); }

}  // namespace

PoseSource::PoseSource(Settings& settings) : settings_(settings) {
  const std::size_t N = static_cast<std::size_t>(settings.integer("points")), legs = N - 1;
  for (std::size_t k = 0; k < N; ++k) {
    t_.push_back(static_cast<double>(k));
    quat_.insert(quat_.end(), {1, 0, 0, 0});
  }
  for (std::size_t k = 0; k < legs; ++k) axis_.insert(axis_.end(), {0, 0, 1});
  p_.resize(3 * N);
  dwell_.resize(N);
  shape_.resize(legs, "line");
  point_.resize(3 * legs);
  for (std::vector<double>* x : {&angle_, &speed_, &turn_speed_}) x->resize(legs);
}

void PoseSource::declare(Variables& v) {
  v.parameter("file", file_,
              "CSV with waypoints: columns t, x, y, z, optionally qw, qx, qy, qz, dwell, and of the leg to the waypoint speed, "
              "turn_speed, via_x, via_y, via_z; empty: waypoints from the parameters");
  v.parameter(
      "passing", passing_,
      "rest: stops at every waypoint; blend: rounds corners between straight legs; through: a spline through waypoints");
  v.parameter("blend", blend_, "s", "passing=blend: duration of each change of speed, half before and half after the waypoint")
      .range(1e-6, 1e9);
  v.parameter("waypoint_t", t_, "s", "arrival times at the waypoints");
  auto p = v.parameter("waypoint_p", p_, "m", "positions in W: x, y, z of the first waypoint, then of the next");
  if (file_.empty()) p.essential();
  v.parameter("waypoint_quat", quat_, "1",
              "orientations in W, unit quaternions (w, x, y, z) of any sign, waypoint by waypoint");
  v.parameter("waypoint_dwell", dwell_, "s", "duration of the rest at each waypoint").range(0, 1e9);
  v.parameter(
      "leg_shape", shape_,
      "way to the next waypoint: line; arc (through leg_point); circle (about the axis through leg_point along leg_axis "
      "by leg_angle, also a helix)");
  v.parameter("leg_point", point_, "m", "arc: a point on it; circle: a point on its axis; in W, leg by leg");
  v.parameter("leg_axis", axis_, "1", "circle: direction of its axis in W, leg by leg");
  v.parameter("leg_angle", angle_, "rad", "circle: angle, positive by the right-hand rule, also above 2 pi").range(-1e6, 1e6);
  v.parameter("leg_speed", speed_, "m/s", "greatest speed of each leg instead of its times; 0: by waypoint_t").range(0, 1e9);
  v.parameter("leg_turn_speed", turn_speed_, "rad/s",
              "greatest angular velocity of each leg; with both speeds, the slower one counts; 0: none")
      .range(0, 1e9);
  v.parameter("v_max", limits_[0], "m/s", "limit of the speed; 0: none").range(0, 1e9);
  v.parameter("dv_max", limits_[1], "m/s2", "limit of the acceleration; 0: none").range(0, 1e12);
  v.parameter("ddv_max", limits_[2], "m/s3", "limit of the jerk; 0: none").range(0, 1e15);
  v.parameter("w_max", limits_[3], "rad/s", "limit of the angular velocity; 0: none").range(0, 1e9);
  v.parameter("dw_max", limits_[4], "rad/s2", "limit of the angular acceleration; 0: none").range(0, 1e12);
  v.parameter("ddw_max", limits_[5], "rad/s3", "limit of the angular jerk; 0: none").range(0, 1e15);
}

trajectory::PoseWaypoints PoseSource::points() const {
  if (!file_.empty()) return trajectory::load_pose_waypoints(settings_.file(file_));
  using Kind = trajectory::LegShape::Kind;
  trajectory::PoseWaypoints points;
  points.t = t_;
  points.dwell = dwell_;
  points.speed = speed_;
  points.turn_speed = turn_speed_;
  for (std::size_t k = 0; k < t_.size(); ++k) {
    points.p.push_back(vector(p_, k));
    points.Q.emplace_back(quat_[4 * k], quat_[4 * k + 1], quat_[4 * k + 2], quat_[4 * k + 3]);
  }
  for (std::size_t k = 0; k + 1 < t_.size(); ++k) {
    const Kind kind = text::choose<Kind>("motion: leg_shape[" + std::to_string(k + 1) + "]", shape_[k],
                                         {{"line", Kind::kLine}, {"arc", Kind::kArc}, {"circle", Kind::kCircle}});
    points.legs.push_back({kind, vector(point_, k), vector(axis_, k), angle_[k]});
  }
  return points;
}

trajectory::PosePath PoseSource::path(const trajectory::PoseMotion* start, bool relative) const {
  using trajectory::PosePassing;
  const PosePassing passing = text::choose<PosePassing>(
      "motion: passing", passing_,
      {{"rest", PosePassing::kRest}, {"blend", PosePassing::kBlend}, {"through", PosePassing::kThrough}});
  trajectory::PoseWaypoints waypoints = points();
  if (start != nullptr && relative) {
    const Quaterniond turn(start->Q[0], start->Q[1], start->Q[2], start->Q[3]);
    for (Vector3d& p : waypoints.p) p = start->p + turn * p;
    for (Vector4d& Q : waypoints.Q) Q = trajectory::multiply(start->Q, Q);
    for (trajectory::LegShape& leg : waypoints.legs) {
      leg.point = start->p + turn * leg.point;
      leg.axis = turn * leg.axis;
    }
  }
  if (start != nullptr && !waypoints.p.empty()) {
    waypoints.p[0] = start->p;
    waypoints.Q[0] = start->Q;
  }
  return trajectory::make_pose_path(waypoints, passing, blend_);
}

trajectory::PoseLimits PoseSource::limits() const {
  trajectory::PoseLimits limits;
  for (std::size_t i = 0; i < 3; ++i) {
    if (limits_[i] > 0) limits.linear[i] = limits_[i];
    if (limits_[i + 3] > 0) limits.angular[i] = limits_[i + 3];
  }
  return limits;
}

void PoseOutputs::declare(Variables& v, const std::string& frame) {
  v.output("p_d", p_, "m", "desired position of " + frame + " in W");
  v.output("quat_d", quat_, "1",
           "its desired orientation in W, unit quaternion (w, x, y, z) of continuous sign, w >= 0 at the start");
  v.output("v_d", v_, "m/s", "its desired velocity in W, the derivative of p_d").derivative_of("p_d");
  v.output("w_d", w_, "rad/s", "its desired angular velocity in W");
  v.output("dv_d", dv_, "m/s2", "its desired acceleration in W, the derivative of v_d").derivative_of("v_d");
  v.output("dw_d", dw_, "rad/s2", "its desired angular acceleration in W, the derivative of w_d").derivative_of("w_d");
}

void PoseOutputs::set(const trajectory::PoseMotion& m, const trajectory::Phase::Value& s, double sign) {
  put(p_, m.p);
  for (std::size_t i = 0; i < 4; ++i) quat_[i] = sign * m.Q[static_cast<Eigen::Index>(i)];
  put(v_, m.v * s.ds);
  put(w_, m.w * s.ds);
  put(dv_, m.dv * (s.ds * s.ds) + m.v * s.dds);
  put(dw_, m.dw * (s.ds * s.ds) + m.w * s.dds);
}

void PoseOutputs::set(const robot::FrameMotion& m, const Vector3d& p_WB, const Quaterniond& Q_WB, double sign) {
  put(p_, p_WB + Q_WB * m.p);
  const Quaterniond Q = Q_WB * m.Q;
  quat_ = {sign * Q.w(), sign * Q.x(), sign * Q.y(), sign * Q.z()};
  put(v_, Q_WB * m.V.head<3>());
  put(w_, Q_WB * m.V.tail<3>());
  put(dv_, Q_WB * m.dV.head<3>());
  put(dw_, Q_WB * m.dV.tail<3>());
}

const robot::Frame& frame_of(Settings& settings, const robot::RobotModel& robot) {
  const std::string name = settings.text("frame");
  return name.empty() ? robot.end_effector() : robot.frame(name);
}

RobotInWorld::RobotInWorld(Settings& settings, const robot::RobotModel& robot)
    : frame_(frame_of(settings, robot).name), kinematics_(robot, frame_of(settings, robot)) {}

void RobotInWorld::declare(Variables& v) {
  v.parameter("base_p0", base_p0_, "m", "position of the robot's base in W");
  v.parameter("base_quat0", base_quat0_, "1", "its orientation in W, unit quaternion (w, x, y, z)");
}

void RobotInWorld::initialise() {
  p_WB_ = Vector3d(base_p0_.data());
  const Quaterniond Q(base_quat0_[0], base_quat0_[1], base_quat0_[2], base_quat0_[3]);
  if (!p_WB_.allFinite()) throw Error("motion.base_p0", "is not finite, expected a position");
  if (!(std::abs(Q.norm() - 1) < 1e-6)) {
    throw Error("motion.base_quat0", "the quaternion (w, x, y, z) has length " + text::to_text(Q.norm()) + ", expected 1");
  }
  Q_WB_ = Q.normalized();
}

}  // namespace cotwin::motion
