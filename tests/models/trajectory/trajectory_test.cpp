// Motions made of polynomials: waypoints, time scaling, joint limits.
#include "models/trajectory/trajectory.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/trajectory/axes.h"
#include "models/trajectory/time_scaling.h"
#include "models/trajectory/waypoints.h"

namespace cotwin::trajectory::trajectory_test {
namespace {

using State = std::array<double, 4>;  // q, q̇, q̈, jerk

State at(const Path& path, double t, std::size_t joint = 0) {
  std::vector<double> q(path.joints()), dq(q), ddq(q), dddq(q);
  path.at(t, q, dq, ddq, dddq);
  return {q[joint], dq[joint], ddq[joint], dddq[joint]};
}

Waypoints three_points() {
  Waypoints points;
  points.joints = 2;
  points.t = {1, 2, 4};
  points.q = {0, 1, 1, -1, 0.5, 2};
  return points;
}

TEST(Waypoints, RestToRestReachesEveryPointInTimeAndStops) {
  Waypoints points = three_points();
  points.dwell = {0, 0.5, 0.25};
  const Path path = make_path(points, Passing::kRest);
  EXPECT_EQ(path.begin(), 1);
  EXPECT_EQ(path.end(), 4.25);
  for (std::size_t j = 0; j < 2; ++j) {
    for (const double t : {1.0, 2.0, 2.3, 2.5, 4.0, 4.1, 0.0, 9.0}) {
      const State s = at(path, t, j);
      EXPECT_EQ(s[0], points.q[(t < 2 ? 0 : t < 4 ? 1 : 2) * 2 + j]);
      EXPECT_NEAR(s[1], 0, 1e-14);
      EXPECT_NEAR(s[2], 0, 1e-14);
    }
  }
}

TEST(Waypoints, ThroughThePointsMeansContinuousUpToSnap) {
  Waypoints points = three_points();
  points.t.insert(points.t.end(), {4.5, 7});
  points.q.insert(points.q.end(), {1, 1, -1, 0});
  const Path path = make_path(points, Passing::kThrough);
  const double h = 1e-5;
  for (std::size_t j = 0; j < 2; ++j) {
    for (std::size_t k = 0; k < points.t.size(); ++k) EXPECT_NEAR(at(path, points.t[k], j)[0], points.q[2 * k + j], 1e-15);
    for (std::size_t k = 1; k + 1 < points.t.size(); ++k) {
      const double t = points.t[k];
      const State before = at(path, t - h, j), here = at(path, t, j), after = at(path, t + h, j);
      EXPECT_GT(std::abs(here[1]), 1e-3);  // it does not stop
      const double snap_before = (here[3] - before[3]) / h, snap_after = (after[3] - here[3]) / h;
      const double scale = 1 + std::abs(here[3]) + std::abs(snap_after);
      EXPECT_NEAR(before[3], after[3], 3 * h * scale);
      EXPECT_NEAR(snap_before, snap_after, 0.02 * scale);  // the fifth derivative jumps: h times the jump remains
    }
    for (const double t : {points.t.front(), points.t.back()}) {
      EXPECT_NEAR(at(path, t, j)[1], 0, 1e-14);
      EXPECT_NEAR(at(path, t, j)[2], 0, 1e-13);
    }
  }
}

TEST(Waypoints, NoOtherVelocitiesAndAccelerationsAtThePointsHaveLessJerk) {
  const Waypoints points = three_points();
  const Path best = make_path(points, Passing::kThrough);
  const auto jerk = [](const Path& path) {
    double sum = 0;  // midpoints, fine enough to distinguish the optimum from its neighbours
    constexpr int N = 3000;
    for (int i = 0; i < N; ++i) {
      const double t = path.begin() + (path.end() - path.begin()) * (i + 0.5) / N;
      const double x = at(path, t)[3];
      sum += x * x;
    }
    return sum;
  };
  const State middle = at(best, 2);
  for (const auto& [dv, da] : {std::pair{0.05, 0.0}, {-0.05, 0.0}, {0.0, 0.2}, {0.0, -0.2}, {0.05, 0.2}, {-0.05, 0.2}}) {
    const Path other(1, {1, 2, 4}, {0, 1, 0.5}, {0, middle[1] + dv, 0}, {0, middle[2] + da, 0});
    EXPECT_GT(jerk(other), jerk(best)) << dv << ", " << da;
  }
}

TEST(Waypoints, RedundantCoefficientsChangeTheLegsAndKeepThePoints) {
  Waypoints points = three_points();
  points.dwell = {0, 0.5, 0};
  for (const Passing passing : {Passing::kRest, Passing::kThrough}) {
    const std::vector<double> c_r = {0.3, -0.1, 0, 0, 0, 0, 0.2, 0.4};  // 2 legs × 2 joints × 2
    const Path plain = make_path(points, passing), bent = make_path(points, passing, 7, c_r);
    for (const double t : points.t) {
      for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(at(bent, t)[k], at(plain, t)[k], 1e-12);
    }
    EXPECT_NEAR(at(bent, 2.25)[0], 1, 1e-15);                             // dwells
    EXPECT_NEAR(at(bent, 1.5, 0)[0] - at(plain, 1.5, 0)[0], 0.3, 1e-12);  // φ₀ peaks at the middle, where φ₁ is zero
    EXPECT_EQ(at(bent, 1.5, 1)[0], at(plain, 1.5, 1)[0]);
  }
  EXPECT_THROW(make_path(points, Passing::kRest, 7, std::vector<double>(3)), Error);
}

TEST(Waypoints, PointsOutOfOrderAreErrorsThatNameThem) {
  Waypoints points = three_points();
  points.dwell = {0, 2, 0};
  try {
    make_path(points, Passing::kRest);
    FAIL();
  } catch (const Error& e) {
    EXPECT_STREQ(e.what(), "waypoint 3: reached at 4 s, expected after the departure from the previous point at 4 s");
  }
  points.t = {1};
  points.q = {0, 1};
  points.dwell = {};
  EXPECT_THROW(make_path(points, Passing::kRest), Error);
}

TEST(TimeScaling, ThePhasesDerivativesAreThoseOfItsValue) {
  const Phase phase(2, 1.5, 0.4, 0.8);
  EXPECT_NEAR(phase.duration(), 1.5 * (2 + 0.6), 1e-15);
  const double h = 1e-5;
  double last = -1;
  for (double t = 0.01; t < phase.duration(); t += 0.0123) {
    const auto s = phase.at(t), before = phase.at(t - h), after = phase.at(t + h);
    EXPECT_NEAR((after.s - before.s) / (2 * h), s.ds, 1e-8);
    EXPECT_NEAR((after.ds - before.ds) / (2 * h), s.dds, 1e-7);
    EXPECT_NEAR((after.dds - before.dds) / (2 * h), s.ddds,
                1e-3);  // the jerk of the phase has a kink where the ramps meet the cruise
    EXPECT_GT(s.s, last);
    last = s.s;
    const auto most = phase.largest();
    EXPECT_LE(s.ds, most.ds);
    EXPECT_LE(std::abs(s.dds), most.dds);
    EXPECT_LE(std::abs(s.ddds), most.ddds * (1 + 1e-12));
    EXPECT_NEAR(phase.at(phase.time_of(s.s)).s, s.s, 1e-12);
  }
  EXPECT_EQ(phase.at(phase.duration()).s, 2);
  EXPECT_EQ(phase.at(0).ds, 0);
  EXPECT_NEAR(phase.at(phase.duration()).ds, 0, 1e-12);
  EXPECT_THROW(Phase(1, 0), Error);
  EXPECT_THROW(Phase(1, 1, 1.5, 0.6), Error);
}

TEST(TimeScaling, StretchingMeetsTheTightestLimitExactly) {
  Waypoints points = three_points();
  const Path path = make_path(points, Passing::kThrough);
  const Phase natural(path.end() - path.begin());
  for (int derivative = 1; derivative <= 3; ++derivative) {
    std::vector<Limits> limits(2);
    double Limits::*const which = derivative == 1 ? &Limits::dq : derivative == 2 ? &Limits::ddq : &Limits::dddq;
    limits[0].*which = 0.7;
    limits[1].*which = 0.4;
    const double factor = stretch_to(path, natural, limits);
    const Phase stretched(natural.length(), factor);
    double tightest = 0;
    for (std::size_t j = 0; j < 2; ++j) {
      double most = 0;  // of the motion itself, sampled
      std::vector<double> q(2), dq(2), ddq(2), dddq(2);
      for (int i = 0; i <= 20000; ++i) {
        const auto s = stretched.at(stretched.duration() * i / 20000);
        path.at(path.begin() + s.s, q, dq, ddq, dddq);
        apply_chain_rule(s, dq, ddq, dddq);
        most = std::max(most, std::abs(derivative == 1 ? dq[j] : derivative == 2 ? ddq[j] : dddq[j]));
      }
      EXPECT_LE(most, limits[j].*which * (1 + 1e-9));
      tightest = std::max(tightest, most / (limits[j].*which));
    }
    EXPECT_NEAR(tightest, 1, 1e-6);
  }
  EXPECT_THROW(stretch_to(path, natural, std::vector<Limits>{{0, 1, 1}, {1, 1, 1}}), Error);
}

TEST(TimeScaling, SoftEndsKeepTheirBoundsAndEnterFromRest) {
  // A motion that starts and ends with velocity: q = (s, −2s) at constant rate.
  const Path path(2, {0, 2}, {0, 0, 2, -4}, {1, -2, 1, -2}, {0, 0, 0, 0});
  const Phase phase(2, 1, 0.5, 0.5);
  std::vector<double> q(2), dq(2), ddq(2), dddq(2), before(2);
  for (int i = 0; i <= 5000; ++i) {
    const auto s = phase.at(phase.duration() * i / 5000);
    path.at(s.s, q, dq, ddq, dddq);
    apply_chain_rule(s, dq, ddq, dddq);
    for (std::size_t j = 0; j < 2; ++j) {
      EXPECT_LE(std::abs(dq[j]), bound(path, phase, j, 1) * (1 + 1e-12));
      EXPECT_LE(std::abs(ddq[j]), bound(path, phase, j, 2) * (1 + 1e-12));
      EXPECT_LE(std::abs(dddq[j]), bound(path, phase, j, 3) * (1 + 1e-12));
    }
    if (i == 0 || i == 5000) {
      EXPECT_NEAR(dq[1], 0, 1e-12);
    }
  }
  EXPECT_NEAR(bound(path, phase, 1, 2), 2 * 1.875 / 0.5, 1e-9);  // |q′| max s̈, which is attained here
}

TEST(Limits, AViolationNamesJointTimeValueAndLimit) {
  std::vector<Axis> axes = free_axes(2);
  axes[1].name = "elbow";
  const Path path = make_path(three_points(), Passing::kRest);
  const Phase phase(3);
  EXPECT_EQ(limit_violation(path, phase, axes), "");
  axes[1].q_min = -0.9;
  axes[1].q_max = 3;
  EXPECT_EQ(limit_violation(path, phase, axes), "elbow is at -1 rad at 1 s, expected -0.9 to 3 rad");
  axes[1].q_min = -1;
  axes[1].dq_max = 2.5;  // joint 2 moves by 2 rad in 1 s with 15/8 of the mean velocity, and by 3 rad in 2 s
  EXPECT_EQ(limit_violation(path, phase, axes), "elbow moves with 3.75 rad/s at 0.5 s, expected at most 2.5 rad/s");
  EXPECT_EQ(limit_violation(path, Phase(3, 2), axes), "");
  axes[1].ddq_max = 1;
  EXPECT_EQ(limit_violation(path, Phase(3, 2), axes).substr(0, 22), "elbow accelerates with");
}

}  // namespace
}  // namespace cotwin::trajectory::trajectory_test
