#include "models/trajectory/pose_path.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/trajectory/waypoints.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"

namespace cotwin::trajectory::pose_path_test {
namespace {

using cotwin::testing::TemporaryFile;
using Eigen::Quaterniond, Eigen::Vector3d, Eigen::Vector4d;
using robot::testing::Draw;
using testing::error_of;
using ::testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

Vector4d quaternion(const Eigen::AngleAxisd& rotation) {
  const Quaterniond Q(rotation);
  return {Q.w(), Q.x(), Q.y(), Q.z()};
}
Quaterniond eigen(const Vector4d& Q) { return {Q[0], Q[1], Q[2], Q[3]}; }

/// Waypoints along lines, one per second, without rotation.
PoseWaypoints through(std::vector<Vector3d> p) {
  PoseWaypoints points;
  const std::size_t N = p.size();
  points.p = std::move(p);
  for (std::size_t k = 0; k < N; ++k) points.t.push_back(static_cast<double>(k));
  points.Q.assign(N, Vector4d(1, 0, 0, 0));
  points.dwell.assign(N, 0);
  points.legs.resize(N - 1);
  points.speed.assign(N - 1, 0);
  points.turn_speed.assign(N - 1, 0);
  return points;
}

/// Any waypoints: lines, arcs, circles (without kThrough), half turns, equal points, dwells.
PoseWaypoints random_points(Draw& draw, PosePassing passing) {
  const int N = draw.integer(2, 7);
  std::vector<Vector3d> p;
  for (int k = 0; k < N; ++k) p.push_back(draw.numbers(3, -1, 1));
  PoseWaypoints points = through(p);
  double t = draw.number(-2, 2);
  for (std::size_t k = 0; k < p.size(); ++k) {
    points.t[k] = t;
    points.dwell[k] = draw.integer(0, 3) == 0 ? draw.number(0.1, 1) : 0;
    t += points.dwell[k] + draw.number(0.5, 2);
    const Vector4d before = k == 0 ? Vector4d(1, 0, 0, 0) : points.Q[k - 1];
    const double angles[] = {0, 1e-9, 0.3, 2, kPi - 1e-7, kPi, 3.0};
    const Vector4d turned = multiply(before, quaternion({angles[draw.integer(0, 6)], draw.direction()}));
    points.Q[k] = draw.integer(0, 1) == 0 ? turned : Vector4d(-turned);
    if (k == 0) continue;
    LegShape& leg = points.legs[k - 1];
    const int kind = passing == PosePassing::kThrough ? 0 : draw.integer(0, 3);
    if (kind == 1) {
      leg.kind = LegShape::Kind::kArc;
      leg.point = draw.numbers(3, -1, 1);
    } else if (kind == 2) {  // the end is moved to where the circle leads
      leg = {LegShape::Kind::kCircle, draw.numbers(3, -1, 1), draw.direction(), draw.number(-7, 7)};
      const Eigen::AngleAxisd turn(leg.angle, leg.axis);
      points.p[k] = leg.point + turn * (points.p[k - 1] - leg.point) + draw.number(-1, 1) * leg.axis;
    } else if (kind == 3) {
      points.p[k] = points.p[k - 1];
    }
  }
  return points;
}

/// First derivative by central differences of sixth order.
template <class Function>
auto difference(const Function& f, double t, double h) {
  return ((45 * (f(t + h) - f(t - h)) - 9 * (f(t + 2 * h) - f(t - 2 * h)) + (f(t + 3 * h) - f(t - 3 * h))) / (60 * h)).eval();
}

constexpr PosePassing kAll[] = {PosePassing::kRest, PosePassing::kBlend, PosePassing::kThrough};

TEST(PosePath, DerivativesAreThoseOfPositionAndOrientation) {
  Draw draw(1);
  for (int i = 0; i < 200; ++i) {
    const PosePassing passing = kAll[i % 3];
    const PosePath path = make_pose_path(random_points(draw, passing), passing, 0.25);
    for (std::size_t k = 0; k + 1 < path.knots().size(); ++k) {
      const double a = path.knots()[k], b = path.knots()[k + 1], h = (b - a) / 400;
      for (const double x : {0.02, 0.37, 0.5, 0.81, 0.98}) {
        const double t = a + x * (b - a);
        const PoseMotion m = path.at(t);
        const double scale = std::max({1.0, m.v.norm(), m.dv.norm(), m.ddv.norm(), m.w.norm(), m.dw.norm(), m.ddw.norm()}) *
                             std::max(1.0, std::pow(b - a, -3));
        EXPECT_LT((difference([&](double u) { return path.at(u).p; }, t, h) - m.v).norm(), 1e-9 * scale);
        EXPECT_LT((difference([&](double u) { return path.at(u).v; }, t, h) - m.dv).norm(), 1e-9 * scale);
        EXPECT_LT((difference([&](double u) { return path.at(u).dv; }, t, h) - m.ddv).norm(), 1e-9 * scale);
        // Q̇ = ½ (0, ω) Q with ω in the reference frame
        const Vector4d dQ = difference([&](double u) { return path.at(u).Q; }, t, h);
        EXPECT_LT((2 * multiply(dQ, conjugate(m.Q)) - Vector4d(0, m.w[0], m.w[1], m.w[2])).norm(), 1e-9 * scale);
        EXPECT_LT((difference([&](double u) { return path.at(u).w; }, t, h) - m.dw).norm(), 1e-9 * scale);
        EXPECT_LT((difference([&](double u) { return path.at(u).dw; }, t, h) - m.ddw).norm(), 1e-9 * scale);
        EXPECT_NEAR(m.Q.norm(), 1, 1e-15);
      }
    }
  }
}

TEST(PosePath, IsContinuousToTheSecondDerivativeAndPassesItsWaypoints) {
  Draw draw(2);
  for (int i = 0; i < 300; ++i) {
    const PosePassing passing = kAll[i % 3];
    const PoseWaypoints points = random_points(draw, passing);
    const PosePath path = make_pose_path(points, passing, 0.25);
    for (const double knot : path.knots()) {
      const double e = 1e-9;
      const PoseMotion a = path.at(knot - e), b = path.at(knot + e);
      const double scale =
          1 + a.v.norm() + a.dv.norm() + a.ddv.norm() + b.ddv.norm() + a.w.norm() + a.dw.norm() + a.ddw.norm() + b.ddw.norm();
      EXPECT_LT((a.p - b.p).norm(), 4 * e * scale);
      EXPECT_LT((a.v - b.v).norm(), 4 * e * scale);
      EXPECT_LT((a.dv - b.dv).norm(), 4 * e * scale);
      EXPECT_LT((a.Q - b.Q).norm(), 4 * e * scale) << "also the sign is continuous";
      EXPECT_LT((a.w - b.w).norm(), 4 * e * scale);
      EXPECT_LT((a.dw - b.dw).norm(), 4 * e * scale);
    }
    for (std::size_t k = 0; k < points.t.size(); ++k) {
      const bool rests = k == 0 || k + 1 == points.t.size() || points.dwell[k] > 0 || passing == PosePassing::kRest;
      if (!rests && passing == PosePassing::kBlend) continue;
      const PoseMotion m = path.at(points.t[k]);
      EXPECT_LT((m.p - points.p[k]).norm(), 1e-14);
      EXPECT_LT(shortest_rotation(m.Q, points.Q[k].normalized()).norm(), 1e-14);
      EXPECT_TRUE(!rests || m.v.norm() + m.w.norm() < 1e-11);
    }
  }
}

TEST(PosePath, LinesAreStraightAndRotationsAreGeodesics) {
  PoseWaypoints points = through({{0, 0, 0}, {1, 2, -0.5}});
  points.Q[1] = quaternion({2.5, Vector3d(1, -2, 0.5).normalized()});
  const PosePath path = make_pose_path(points, PosePassing::kRest);
  const Vector3d axis = Vector3d(1, -2, 0.5).normalized();
  for (double t = 0; t <= 1; t += 0.01) {
    const double s = t * t * t * (10 + t * (6 * t - 15)), ds = 30 * t * t * (1 - t) * (1 - t);
    const PoseMotion m = path.at(t);
    EXPECT_LT((m.p - s * points.p[1]).norm(), 5e-15);
    EXPECT_LT((m.Q - quaternion({2.5 * s, axis})).norm(), 1e-14);
    EXPECT_LT((m.w - 2.5 * ds * axis).norm(), 1e-13);
  }
}

TEST(PosePath, BlendsRoundCornersAndKeepTheRestStraightAndUniform) {
  PoseWaypoints points = through({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {1, 2, 0}});
  points.Q[1] = quaternion({1.0, Vector3d::UnitX()});
  points.Q[2] = multiply(points.Q[1], quaternion({0.8, Vector3d::UnitY()}));
  points.Q[3] = points.Q[2];
  const double B = 0.3;
  const PosePath path = make_pose_path(points, PosePassing::kBlend, B);
  // The first leg starts at rest and reaches its speed after B; in the corner it slows down while the second one starts.
  const double v = 1 / (1 - B / 2);
  for (double t = B; t < 1 - B / 2; t += 0.01) {
    const PoseMotion m = path.at(t);
    EXPECT_NEAR(m.v[0], v, 1e-13);
    EXPECT_NEAR(m.p[0], 1 + v * (t - 1), 1e-13);
    EXPECT_EQ(m.p[1], 0);
    EXPECT_LT((m.w - v * Vector3d::UnitX()).norm(), 1e-13);
    EXPECT_LT(m.dv.norm() + m.dw.norm(), 1e-11);
  }
  // In the middle of the corner both legs have their mean speed. The distance to the waypoint is 5/64 B |v_2 − v_1|.
  const PoseMotion corner = path.at(1);
  EXPECT_LT((corner.v - Vector3d(v / 2, 0.5, 0)).norm(), 1e-12);
  EXPECT_NEAR((corner.p - points.p[1]).norm(), 5.0 / 64 * B * std::hypot(v, 1), 1e-14);
  // Two legs in one direction at one speed: nothing is to be seen of the waypoint.
  const PoseWaypoints line = through({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}});
  const PosePath straight = make_pose_path(line, PosePassing::kBlend, B);
  for (double t = 1.2; t < 1.8; t += 0.01) EXPECT_NEAR(straight.at(t).v[0], 1, 1e-13);
}

TEST(PosePath, ArcsPassTheirPointAlsoBeyondHalfACircle) {
  PoseWaypoints points = through({{1, 0, 0.5}, {0, -1, 0.5}});
  points.legs[0] = {LegShape::Kind::kArc, {-std::sqrt(0.5), std::sqrt(0.5), 0.5}, Vector3d::UnitZ(), 0};
  const PosePath path = make_pose_path(points, PosePassing::kRest);
  const double middle = path.at(0.5).p[1];
  EXPECT_NEAR(middle, std::sqrt(0.5), 1e-14) << "three quarters of a circle through the second quadrant: the middle is 135 deg";
  for (double t = 0; t <= 1; t += 0.01) {
    const PoseMotion m = path.at(t);
    EXPECT_NEAR((m.p - Vector3d(0, 0, 0.5)).norm(), 1, 1e-14);
    const double ds = 30 * t * t * (1 - t) * (1 - t);
    EXPECT_NEAR(m.v.norm(), 1.5 * kPi * ds, 1e-12);
  }
  points = through({{1, 0, 0}, {1, 0, 0.3}});
  points.legs[0] = {LegShape::Kind::kCircle, {0, 0, 7}, {0, 0, 2}, 4 * kPi};
  const PosePath helix = make_pose_path(points, PosePassing::kRest);
  EXPECT_LT((helix.at(0.5).p - Vector3d(1, 0, 0.15)).norm(), 1e-14) << "after one of two turns";
  EXPECT_NEAR(helix.at(0.3).p.head<2>().norm(), 1, 1e-14);
}

TEST(PosePath, ThroughWaypointsAboutOneAxisIsTheSplineOfTheAngle) {
  // The angle is a joint: the spline of minimum jerk through the same values.
  const std::vector<double> angles{0, 1, 0.2, 2.5, 5.0};
  PoseWaypoints points = through(std::vector<Vector3d>(5, Vector3d::Zero()));
  const Vector3d axis = Vector3d(2, -1, 0.4).normalized();
  for (std::size_t k = 0; k < 5; ++k) points.Q[k] = quaternion({angles[k], axis});
  const Path joint = make_path({1, points.t, angles, {}, {}}, Passing::kThrough);
  const PosePath path = make_pose_path(points, PosePassing::kThrough);
  for (double t = 0.01; t < 4; t += 0.05) {
    double q, dq, ddq;
    joint.at(t, {&q, 1}, {&dq, 1}, {&ddq, 1});
    const PoseMotion m = path.at(t);
    EXPECT_LT((m.Q - quaternion({q, axis})).norm(), 1e-13);
    EXPECT_LT((m.w - dq * axis).norm(), 1e-12);
    EXPECT_LT((m.dw - ddq * axis).norm(), 1e-11);
  }
}

TEST(PosePath, DoesNotDependOnTheFramesInWhichItIsGiven) {
  Draw draw(5);
  for (int i = 0; i < 60; ++i) {
    const PosePassing passing = kAll[i % 3];
    PoseWaypoints points = random_points(draw, passing);
    for (std::size_t k = 1; k < points.Q.size(); ++k) {  // the axis of half turns depends on the frame
      points.Q[k] = multiply(points.Q[k - 1], quaternion({2.0, draw.direction()}));
    }
    const Quaterniond world(Eigen::AngleAxisd(draw.number(0, 3), draw.direction()));
    const Vector4d left(world.w(), world.x(), world.y(), world.z()), right = quaternion({1.1, draw.direction()});
    PoseWaypoints turned = points;
    for (std::size_t k = 0; k < points.p.size(); ++k) {
      turned.p[k] = world * points.p[k];
      turned.Q[k] = multiply(multiply(left, points.Q[k]), right);
      if (k == 0) continue;
      turned.legs[k - 1].point = world * points.legs[k - 1].point;
      turned.legs[k - 1].axis = world * points.legs[k - 1].axis;
    }
    const PosePath a = make_pose_path(points, passing, 0.25), b = make_pose_path(turned, passing, 0.25);
    for (double x = 0; x < 1; x += 0.1) {
      const PoseMotion m = a.at(a.begin() + x * (a.end() - a.begin())), n = b.at(a.begin() + x * (a.end() - a.begin()));
      const double scale = 1 + m.dv.norm() + m.dw.norm();
      EXPECT_LT((world * m.p - n.p).norm(), 1e-11);
      EXPECT_LT(shortest_rotation(multiply(multiply(left, m.Q), right), n.Q).norm(), 1e-11 * scale);
      EXPECT_LT((world * m.w - n.w).norm(), 1e-10 * scale);
      EXPECT_LT((world * m.dw - n.dw).norm(), 1e-9 * scale);
    }
  }
}

TEST(PosePath, TheSignOfTheGivenQuaternionsChangesNoBit) {
  Draw draw(3);
  for (int i = 0; i < 60; ++i) {
    const PosePassing passing = kAll[i % 3];
    const PoseWaypoints points = random_points(draw, passing);
    PoseWaypoints negative = points;
    for (Vector4d& Q : negative.Q) {
      if (draw.integer(0, 1) == 1) Q = -Q;
    }
    const PosePath a = make_pose_path(points, passing, 0.25), b = make_pose_path(negative, passing, 0.25);
    for (double x = 0; x < 1; x += 0.07) {
      const double t = a.begin() + x * (a.end() - a.begin());
      EXPECT_EQ(a.at(t).Q, b.at(t).Q);
      EXPECT_EQ(a.at(t).w, b.at(t).w);
      EXPECT_EQ(a.at(t).dw, b.at(t).dw);
    }
    EXPECT_GE(a.at(a.begin()).Q[0], 0);
  }
}

TEST(PosePath, AHalfTurnIsAboutTheAxisWhoseLargestComponentIsPositive) {
  const Vector4d a(1, 0, 0, 0), b(0, 0.6, -0.8, 0);
  EXPECT_LT((shortest_rotation(a, b) - kPi * Vector3d(-0.6, 0.8, 0)).norm(), 1e-15);
  EXPECT_EQ(shortest_rotation(a, -b), shortest_rotation(a, b));
  // Rounding does not choose the axis, also not among components of the same magnitude.
  const double c = 1 / std::sqrt(3.0);
  for (const double e : {-1e-15, 0.0, 1e-15}) {
    const Vector3d psi = shortest_rotation(a, Vector4d(e, -c, c + e, -c));
    EXPECT_GT(psi[0], 0);
    EXPECT_NEAR(psi.norm(), kPi, 1e-14);
  }
  EXPECT_EQ(shortest_rotation(a, a), Vector3d::Zero());
  EXPECT_NEAR(shortest_rotation(a, Vector4d(1, 1e-12, 0, 0))[0], 2e-12, 1e-26);
}

TEST(PosePath, SpeedsDetermineDurations) {
  PoseWaypoints points = through({{0, 0, 0}, {0.5, 0, 0}, {0.5, 0, 0}});
  points.Q[2] = quaternion({1.2, Vector3d::UnitZ()});
  points.speed = {0.25, 0};
  points.turn_speed = {0, 0.8};
  for (const PosePassing passing : kAll) {
    const PosePath path = make_pose_path(points, passing, 0.4);
    if (passing != PosePassing::kThrough) {
      const PosePeaks peaks = find_peaks(path);
      EXPECT_NEAR(peaks.linear[0].value, 0.25, 1e-9);
      EXPECT_NEAR(peaks.angular[0].value, 0.8, 1e-9);
    } else {
      EXPECT_NEAR(path.end(), 0.5 / 0.25 + 1.2 / 0.8, 1e-14) << "mean speeds of a spline";
    }
  }
}

TEST(PosePath, PeaksAreThoseOfTheClosedForm) {
  PoseWaypoints points = through({{0, 0, 0}, {0, 3, 4}});
  points.t[1] = 2;
  points.Q[1] = quaternion({0.6, Vector3d::UnitX()});
  const PosePeaks line = find_peaks(make_pose_path(points, PosePassing::kRest));
  const double unit[] = {1.875, 10 / std::sqrt(3.0), 60};  // of the quintic: speed, acceleration, jerk
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(line.linear[i].value, unit[i] * 5 / std::pow(2, i + 1), 1e-6);
    EXPECT_NEAR(line.angular[i].value, unit[i] * 0.6 / std::pow(2, i + 1), 1e-6);
  }
  // With a limit on the speed alone the stretched motion reaches it.
  PoseLimits limits;
  limits.linear[0] = 1;
  EXPECT_NEAR(stretch_to(line, Phase(2), limits), 1.875 * 5 / 2, 1e-9);
  EXPECT_THAT(limit_violation(line, make_pose_path(points, PosePassing::kRest), Phase(2), limits),
              HasSubstr("the frame moves with 4.6875 m/s at 1 s, expected at most 1 m/s"));
}

TEST(PosePath, RefusesWaypointsThatDetermineNoMotion) {
  PoseWaypoints points = through({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}});
  const auto error = [&](PosePassing passing = PosePassing::kRest, double blend = 0.1) {
    return error_of([&] { make_pose_path(points, passing, blend); });
  };
  const PoseWaypoints good = points;
  points.t[2] = 1;
  EXPECT_THAT(error(), HasSubstr("waypoint 3: reached at 1 s, expected after"));
  points.t[2] = std::numeric_limits<double>::infinity();
  EXPECT_THAT(error(), HasSubstr("waypoint 3: reached at inf s, expected a time"));
  points = good;
  points.Q[1] = Vector4d::Zero();
  EXPECT_THAT(error(), HasSubstr("waypoint 2: the quaternion (w, x, y, z) has length 0, expected 1"));
  points = good;
  points.p[1][0] = std::nan("");
  EXPECT_THAT(error(), HasSubstr("waypoint 2: position"));
  points = good;
  points.legs[1] = {LegShape::Kind::kArc, {1.5, 0, 0}, Vector3d::UnitZ(), 0};
  EXPECT_THAT(error(), HasSubstr("leg 2: the arc from (1, 0, 0) m through (1.5, 0, 0) m to (2, 0, 0) m"));
  for (const Vector3d& same : {points.p[1], points.p[2]}) {
    points.legs[1].point = same;
    EXPECT_THAT(error(), HasSubstr("expected three points that are not on one line"));
  }
  points.p[2] = points.p[1];
  points.legs[1].point = {0, 5, 0};
  EXPECT_THAT(error(), HasSubstr("expected three points that are not on one line"));
  points = good;
  points.speed[1] = 1e-300;
  EXPECT_THAT(error(), HasSubstr("leg 2: lasts 1.875e+300 s"));
  points = good;
  points.legs[1] = {LegShape::Kind::kCircle, {1, 1, 0}, {0, 0, 1}, kPi / 2};
  EXPECT_THAT(error(), HasSubstr("leg 2: the circle leads to (2, 1, 0) m, expected the waypoint at (2, 0, 0) m"));
  points.legs[1].axis = Vector3d::Zero();
  EXPECT_THAT(error(), HasSubstr("leg 2: the circle's axis is (0, 0, 0)"));
  EXPECT_THAT(error(PosePassing::kThrough), HasSubstr("leg 2: is an arc, expected a line"));
  points = good;
  EXPECT_THAT(error(PosePassing::kBlend, 0.8), HasSubstr("leg 1: lasts 1 s, too short for blend = 0.8 s"));
  EXPECT_EQ(error(PosePassing::kBlend, 0.66), "");
  points.p[2] = points.p[1];
  points.speed[1] = 1;
  EXPECT_THAT(error(), HasSubstr("leg 2: has no length for its speed, expected a duration"));
}

TEST(PosePath, WaypointsComeFromAFile) {
  const TemporaryFile file(
      "t,x,y,z,qw,qx,qy,qz,dwell,via_x,via_y,via_z\n0,1,0,0,1,0,0,0,0,,,\n2,-1,0,0,0,0,0,1,0.5,0,1,0\n4,-1,0,3,1,0,0,0,0,,,\n");
  const PoseWaypoints points = load_pose_waypoints(file.path());
  const PosePath path = make_pose_path(points, PosePassing::kRest);
  EXPECT_LT((path.at(1).p - Vector3d(0, 1, 0)).norm(), 1e-15);
  EXPECT_EQ(path.at(2.3).p, Vector3d(-1, 0, 0));
  EXPECT_LT((eigen(path.at(1).Q) * Vector3d::UnitX() - Vector3d::UnitY()).norm(), 1e-15);
  EXPECT_EQ(path.end(), 4);
  const TemporaryFile fast("x,y,z,speed\n0,0,0,0\n1,0,0,0.5\n");
  EXPECT_NEAR(make_pose_path(load_pose_waypoints(fast.path()), PosePassing::kRest).end(), 1.875 * 2, 1e-14);
  const TemporaryFile bad("t,x,y\n0,0,0\n");
  EXPECT_THAT(error_of([&] { load_pose_waypoints(bad.path()); }), HasSubstr("'z'"));
  const TemporaryFile wrong("t,x,y,z\n0,0,0,0\n1,0,0,nan\n");
  EXPECT_THAT(error_of([&] { load_pose_waypoints(wrong.path()); }), HasSubstr(":3"));
}

}  // namespace
}  // namespace cotwin::trajectory::pose_path_test
