#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>
#include <optional>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/trajectory/bernstein.h"
#include "models/trajectory/columns.h"
#include "models/trajectory/pose_path.h"
#include "models/trajectory/waypoints.h"

namespace cotwin::trajectory {

namespace {

using Eigen::Matrix3d, Eigen::Vector3d, Eigen::Vector4d;

constexpr double kQuinticPeak = 1.875;  // peak speed of the quintic from rest to rest, relative to the mean

std::string number(double x) { return text::to_text(x, 6); }
std::string number(const Vector3d& p) { return "(" + number(p[0]) + ", " + number(p[1]) + ", " + number(p[2]) + ")"; }

class Builder {
 public:
  Builder(const PoseWaypoints& points, PosePassing passing, double blend)
      : points_(points), passing_(passing), blend_(blend), N_(points.t.size()) {}

  std::string place(std::size_t k) const {
    return points_.places.empty() ? "waypoint " + std::to_string(k + 1) : points_.places[k];
  }
  std::string leg_name(std::size_t k) const {
    return points_.places.empty() ? "leg " + std::to_string(k + 1) : points_.places[k + 1];
  }
  bool passed(std::size_t k) const { return passing_ != PosePassing::kRest && k > 0 && k + 1 < N_ && points_.dwell[k] == 0; }

  void check() const {
    if (N_ < 2) throw Error("waypoints", std::to_string(N_) + " given, expected at least 2");
    assert(points_.p.size() == N_ && points_.Q.size() == N_ && points_.dwell.size() == N_ && points_.legs.size() == N_ - 1);
    assert(points_.speed.size() == N_ - 1 && points_.turn_speed.size() == N_ - 1);
    for (std::size_t k = 0; k < N_; ++k) {
      if (!(std::abs(points_.t[k]) < 1e12)) throw Error(place(k), "reached at " + number(points_.t[k]) + " s, expected a time");
      if (!points_.p[k].allFinite() || !(points_.p[k].norm() < 1e9)) {
        throw Error(place(k), "position " + number(points_.p[k]) + " m, expected below 1e9 m");
      }
      const double length = points_.Q[k].norm();
      if (!(std::abs(length - 1) <= 1e-3)) {
        throw Error(place(k), "the quaternion (w, x, y, z) has length " + number(length) + ", expected 1");
      }
      if (!(points_.dwell[k] >= 0)) throw Error(place(k), "dwell " + number(points_.dwell[k]) + " s, expected >= 0");
    }
    if (passing_ == PosePassing::kBlend && !(blend_ > 0)) {
      throw Error("waypoints", "blend " + number(blend_) + " s, expected > 0");
    }
  }

  /// Waypoints as unit quaternions of continuous sign: w > 0 at the first, or else its first component that is not zero.
  std::vector<Vector4d> orientations() const {
    std::vector<Vector4d> Q;
    for (const Vector4d& given : points_.Q) {
      const Vector4d unit = given.normalized();
      if (Q.empty()) {
        Eigen::Index first = 0;
        while (first < 3 && unit[first] == 0) ++first;
        Q.push_back(unit[first] < 0 ? Vector4d(-unit) : unit);
        continue;
      }
      // The sign to which the shortest rotation leads; it is not that of the scalar product for a rotation by 180°.
      const Vector4d led = turned(Q.back(), shortest_rotation(Q.back(), unit));
      Q.push_back(led.dot(unit) < 0 ? Vector4d(-unit) : unit);
    }
    return Q;
  }

  static Vector4d turned(const Vector4d& Q, const Vector3d& psi) {
    const Vector3d zero = Vector3d::Zero();
    return multiply(Q, exponential({{psi, zero, zero, zero}}).c[0]);
  }

  /// Displacement of leg k: line, radius, normal × radius and angle.
  struct Shape {
    Vector3d line, radius = Vector3d::Zero(), normal_times_radius = Vector3d::Zero();
    double angle = 0, length = 0;
  };
  Shape shape(std::size_t k) const {
    const LegShape& leg = points_.legs[k];
    const Vector3d a = points_.p[k], b = points_.p[k + 1];
    Shape s;
    s.line = b - a;
    s.length = s.line.norm();
    if (leg.kind == LegShape::Kind::kLine) return s;
    if (passing_ == PosePassing::kThrough) {
      throw Error(leg_name(k), "is an arc, expected a line: with passing = through all legs are parts of one spline");
    }
    Vector3d centre, normal;
    if (leg.kind == LegShape::Kind::kArc) {
      const Vector3d u = leg.point - a, v = b - a, n = u.cross(v);
      if (!(n.norm() > 1e-6 * u.norm() * v.norm()) || !((b - leg.point).norm() > 1e-6 * v.norm())) {
        throw Error(leg_name(k), "the arc from " + number(a) + " m through " + number(leg.point) + " m to " + number(b) +
                                     " m is not determined, expected three points that are not on one line");
      }
      centre = a + (u.squaredNorm() * v.cross(n) - v.squaredNorm() * u.cross(n)) / (2 * n.squaredNorm());
      normal = n.normalized();
    } else {
      if (!(leg.axis.norm() > 0) || !leg.axis.allFinite() || !leg.point.allFinite()) {
        throw Error(leg_name(k), "the circle's axis is " + number(leg.axis) + ", expected a vector other than zero");
      }
      normal = leg.axis.normalized();
      centre = leg.point + normal * normal.dot(a - leg.point);
    }
    s.radius = a - centre;
    s.normal_times_radius = normal.cross(s.radius);
    const Vector3d along = normal * normal.dot(b - a);
    if (leg.kind == LegShape::Kind::kArc) {
      s.angle = std::atan2(normal.dot(s.radius.cross(b - centre)), s.radius.dot(b - centre));
      if (s.angle <= 0) s.angle += 2 * std::numbers::pi;
      s.line = Vector3d::Zero();
    } else {
      s.angle = leg.angle;
      s.line = along;
      const Vector3d end = a + along + (std::cos(s.angle) - 1) * s.radius + std::sin(s.angle) * s.normal_times_radius;
      if (!((end - b).norm() <= 1e-6 * (1 + s.radius.norm()))) {
        throw Error(leg_name(k), "the circle leads to " + number(end) + " m, expected the waypoint at " + number(b) + " m");
      }
      // The end to the last digit: the rest of at most a micrometre is distributed along the leg.
      s.line += b - end;
    }
    s.length = std::hypot(s.angle * s.radius.norm(), s.line.norm());
    return s;
  }

  /// Duration of leg k.
  double duration(std::size_t k, double length, double angle) const {
    const double v = points_.speed[k], w = points_.turn_speed[k];
    if (!(v >= 0) || !(w >= 0)) {
      throw Error(leg_name(k), "speeds of " + number(v) + " m/s and " + number(w) + " rad/s, expected >= 0");
    }
    if (v == 0 && w == 0) {
      const double departure = points_.t[k] + points_.dwell[k];
      if (points_.t[k + 1] > departure) return points_.t[k + 1] - departure;
      throw Error(place(k + 1), "reached at " + number(points_.t[k + 1]) +
                                    " s, expected after the departure from the previous point at " + number(departure) + " s");
    }
    double T = std::max(v > 0 ? length / v : 0, w > 0 ? angle / w : 0);
    if (!(T > 0)) throw Error(leg_name(k), "has no length for its speed, expected a duration");
    if (passing_ == PosePassing::kRest) T *= kQuinticPeak;
    // A ramp from or to rest covers half of its duration at full speed.
    if (passing_ == PosePassing::kBlend) T += 0.5 * blend_ * ((passed(k) ? 0 : 1) + (passed(k + 1) ? 0 : 1));
    return T;
  }

 private:
  const PoseWaypoints& points_;
  PosePassing passing_;
  double blend_;
  std::size_t N_;
};

/// Angular velocity and acceleration in the body for a rotation vector and its first two derivatives.
std::array<Vector3d, 2> rates_in_body(const Vector3d& psi, const Vector3d& dpsi, const Vector3d& ddpsi) {
  const Taylor3 w = angular_velocity_in_body(exponential({{psi, dpsi, ddpsi / 2, Vector3d::Zero()}}));
  return {w.c[0], w.c[1]};
}

/// The derivatives of the rotation vector ψ with which the body has angular velocity w and acceleration dw. |ψ| <= π.
std::array<Vector3d, 2> derivatives_of(const Vector3d& psi, const Vector3d& w, const Vector3d& dw) {
  const Vector3d zero = Vector3d::Zero();
  Matrix3d E;  // w = E ψ̇, w˙ = E ψ̈ + Ė ψ̇
  for (Eigen::Index i = 0; i < 3; ++i) E.col(i) = rates_in_body(psi, Vector3d::Unit(i), zero)[0];
  const Matrix3d inverse = E.inverse();
  const Vector3d dpsi = inverse * w;
  return {dpsi, Vector3d(inverse * (dw - rates_in_body(psi, dpsi, zero)[1]))};
}

}  // namespace

PosePath make_pose_path(const PoseWaypoints& points, PosePassing passing, double blend) {
  const Builder builder(points, passing, blend);
  builder.check();
  const std::size_t N = points.t.size();
  PosePath path;
  path.passing_ = passing;
  path.p_ = points.p;
  path.Q_ = builder.orientations();
  Waypoints spline{6, {points.t[0]}, {}, points.dwell, {}};  // positions and, added up, rotation vectors in the body
  Vector3d turned = Vector3d::Zero();
  double t = points.t[0];
  const auto append = [&](std::size_t k) {
    spline.q.insert(spline.q.end(), points.p[k].begin(), points.p[k].end());
    spline.q.insert(spline.q.end(), turned.begin(), turned.end());
  };
  append(0);
  path.knots_ = {t};
  for (std::size_t k = 0; k + 1 < N; ++k) {
    const Builder::Shape shape = builder.shape(k);
    PosePath::Leg leg;
    leg.line = shape.line;
    leg.radius = shape.radius;
    leg.normal_times_radius = shape.normal_times_radius;
    leg.angle = shape.angle;
    leg.psi = shortest_rotation(path.Q_[k], path.Q_[k + 1]);
    leg.blend = passing == PosePassing::kBlend ? blend : 0;
    const double T = builder.duration(k, shape.length, leg.psi.norm());
    const double start = t + points.dwell[k];
    t = start + T;
    if (!(t > start && t < 1e12)) {
      throw Error(builder.leg_name(k),
                  "lasts " + number(T) + " s after " + number(start) + " s, expected a time that adds to it");
    }
    const double before = builder.passed(k) ? 0.5 * leg.blend : 0, after = builder.passed(k + 1) ? 0.5 * leg.blend : 0;
    leg.begin = start - before;
    leg.end = t + after;
    const double most = T * leg.blend / std::max(2 * leg.blend - before - after, 1e-300);
    if (leg.blend > most * (1 + 1e-12)) {
      throw Error(builder.leg_name(k), "lasts " + number(T) + " s, too short for blend = " + number(blend) +
                                           " s, expected at most " + number(most) + " s");
    }
    for (const double knot : {leg.begin, leg.begin + leg.blend, leg.end - leg.blend, leg.end}) path.knots_.push_back(knot);
    path.legs_.push_back(leg);
    turned += leg.psi;
    spline.t.push_back(t);
    append(k + 1);
  }
  if (points.dwell.back() > 0) path.knots_.push_back(t + points.dwell.back());
  std::sort(path.knots_.begin(), path.knots_.end());
  const double close = 1e-12 * std::max(std::abs(path.knots_.front()), std::abs(path.knots_.back()));
  const auto same = [close](double a, double b) { return b - a <= close; };
  path.knots_.erase(std::unique(path.knots_.begin(), path.knots_.end(), same), path.knots_.end());
  if (passing != PosePassing::kThrough) return path;

  path.positions_ = make_path(spline, Passing::kThrough);
  path.knots_.assign(path.positions_.times().begin(), path.positions_.times().end());
  std::array<double, 6> q, dq, ddq;
  std::vector<std::array<Vector3d, 2>> rates;  // angular velocity and acceleration in the body at the knots
  for (const double knot : path.knots_) {
    path.positions_.at(knot, q, dq, ddq);
    rates.push_back({Vector3d(dq[3], dq[4], dq[5]), Vector3d(ddq[3], ddq[4], ddq[5])});
  }
  for (std::size_t k = 0, waypoint = 0; k + 1 < path.knots_.size(); ++k) {
    const double T = path.knots_[k + 1] - path.knots_[k];
    const bool rests = path.knots_[k] == spline.t[waypoint] && points.dwell[waypoint] > 0;
    const Vector3d psi = rests ? Vector3d::Zero() : path.legs_[waypoint].psi;
    path.Q_at_knot_.push_back(path.Q_[waypoint]);
    const auto d = derivatives_of(psi, rates[k + 1][0], rates[k + 1][1]);
    auto& control = path.rotation_.emplace_back();
    for (Eigen::Index i = 0; i < 3; ++i) {
      control[static_cast<std::size_t>(i)] =
          bernstein::quintic({0, rates[k][0][i] * T, rates[k][1][i] * T * T}, {psi[i], d[0][i] * T, d[1][i] * T * T});
    }
    if (!rests) ++waypoint;
  }
  return path;
}

PoseWaypoints load_pose_waypoints(const std::filesystem::path& file) {
  csv::Reader reader(file);
  const auto find = [&](const char* name) -> std::optional<std::size_t> {
    const auto at = std::find(reader.names().begin(), reader.names().end(), name);
    if (at == reader.names().end()) return std::nullopt;
    return static_cast<std::size_t>(at - reader.names().begin());
  };
  const auto finite = [&](std::size_t column) {
    const double value = reader.real(column);
    if (!std::isfinite(value)) throw Error(reader.place(column), text::to_text(value) + ", expected a finite number");
    return value;
  };
  const auto optional = [&](std::optional<std::size_t> column) { return column ? finite(*column) : 0.0; };
  const std::array<std::size_t, 3> xyz{reader.column("x"), reader.column("y"), reader.column("z")};
  std::optional<std::array<std::size_t, 4>> quaternion;
  if (find("qw") || find("qx") || find("qy") || find("qz")) {
    quaternion = {reader.column("qw"), reader.column("qx"), reader.column("qy"), reader.column("qz")};
  }
  std::optional<std::array<std::size_t, 3>> via;
  if (find("via_x") || find("via_y") || find("via_z")) {
    via = {reader.column("via_x"), reader.column("via_y"), reader.column("via_z")};
  }
  const auto speed = find("speed"), turn_speed = find("turn_speed"), dwell = find("dwell");
  std::optional<std::size_t> time = find("t");
  if (!time && !speed && !turn_speed) time = find_time_column(reader, file.string(), "");
  PoseWaypoints points;
  while (reader.next()) {
    const bool first = points.t.empty();
    points.places.push_back(reader.place());
    points.t.push_back(optional(time));
    points.p.emplace_back(finite(xyz[0]), finite(xyz[1]), finite(xyz[2]));
    Vector4d Q(1, 0, 0, 0);
    for (std::size_t i = 0; quaternion && i < 4; ++i) Q[static_cast<Eigen::Index>(i)] = finite((*quaternion)[i]);
    points.Q.push_back(Q);
    points.dwell.push_back(optional(dwell));
    LegShape leg;
    if (via && !reader.text((*via)[0]).empty()) {
      if (first) throw Error(reader.place((*via)[0]), "a point of an arc at the first waypoint, expected an empty cell");
      leg.kind = LegShape::Kind::kArc;
      leg.point = {finite((*via)[0]), finite((*via)[1]), finite((*via)[2])};
    }
    if (first) continue;
    points.legs.push_back(leg);
    points.speed.push_back(optional(speed));
    points.turn_speed.push_back(optional(turn_speed));
  }
  return points;
}

}  // namespace cotwin::trajectory
