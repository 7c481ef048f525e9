#include "components/operator_hand/operator_hand.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <complex>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "components/unit/snapshot.h"
#include "components/unit/unit_table.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"
#include "tests/support/unit_subject.h"

namespace cotwin::operator_hand_test {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;
using Values = std::vector<std::pair<std::string, std::string>>;

constexpr Duration kTick{1'000'000};

/// A hand of the unit.
class Subject : public testing::UnitSubject {
 public:
  explicit Subject(const std::string& query, const Values& values = {}) : UnitSubject("unit:operator_hand?" + query, values) {}
  std::span<double> rate(const std::string& name) const { return variables().at(name).rate; }
  void put(const std::string& name, const Vector3d& value) { Vector3d::Map((*this)[name].data()) = value; }
  void to(double t, Duration h = kTick) {
    while (now_ < Time::from_seconds(t)) step(h);
  }
  std::string error() {
    try {
      initialise();
      to(2.5);
    } catch (const Error& e) {
      return e.what();
    }
    return "no error";
  }
};

const Values kHeld = {{"grip_t", "-1"}, {"grip_duration", "0"}};  // closed from the start
std::vector<std::pair<std::string, std::string>> operator+(Values a, const Values& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

double minimum_jerk(double s) { return s <= 0 ? 0 : s >= 1 ? 1 : s * s * s * (10 - 15 * s + 6 * s * s); }

TEST(OperatorHand, IntendsMinimumJerkMovesFromRestToRest) {
  Subject s("points=3",
            {{"waypoint_t", "0.5 1.5 3"}, {"waypoint_p", "1 1 1  1.3 0.8 1.1  1 1 2"}, {"waypoint_dwell", "0 0.5 0"}});
  s.set("p", "5 6 7");  // the waypoints are displacements
  s.initialise();
  const Vector3d A(0.3, -0.2, 0.1), B(-0.3, 0.2, 0.9), origin(5, 6, 7);
  for (int i = 0; i < 3500; ++i) {
    s.step();
    const Vector3d expected = origin + A * minimum_jerk((s.now() - 0.5) / 1) + B * minimum_jerk((s.now() - 2) / 1);
    ASSERT_LT((s.vector("p_i") - expected).norm(), 1e-14) << s.now();
  }
  Subject absolute("", {{"waypoint_p", "1 2 3  1 2 3"}, {"relative", "false"}});
  absolute.initialise();
  EXPECT_EQ(absolute.vector("p_i"), Vector3d(1, 2, 3));
}

// At p = 0 and with x_i = X: m ẍ + (D + D_g) ẋ + (K + K_g) x = K X from x = X, the sum of two exponentials.
TEST(OperatorHand, AnswersAStepWithTheClosedFormForAnyStiffnessAndStep) {
  struct Case {
    double m, D, K, D_g, K_g;
  };
  for (const Case& c :
       {Case{0.8, 25, 300, 50, 5000}, {0.5, 0, 500, 0, 2000}, {1, 1e5, 1e7, 0, 1e3}, {1e-3, 10, 300, 50, 1e6}}) {
    for (const Duration h : {kTick, Duration{20'000'000}}) {
      const auto three = [](double x) { return text::to_text(x); };
      Subject s("", kHeld + Values{{"m_h", three(c.m)},
                                   {"D_h", three(c.D)},
                                   {"K_h", three(c.K)},
                                   {"D_g", three(c.D_g)},
                                   {"K_g", three(c.K_g)},
                                   {"waypoint_p", "0.1 -0.2 0.3 0.1 -0.2 0.3"},
                                   {"relative", "false"}});
      s.initialise();
      const std::complex<double> root =
          std::sqrt(std::complex<double>((c.D + c.D_g) * (c.D + c.D_g) - 4 * c.m * (c.K + c.K_g)));
      const auto r1 = (-(c.D + c.D_g) + root) / (2 * c.m), r2 = (c.K + c.K_g) / c.m / r1;
      const double end = c.K / (c.K + c.K_g);
      for (int i = 0; i < 50; ++i) {
        s.step(h);
        const auto e1 = std::exp(r1 * s.now()), e2 = std::exp(r2 * s.now());
        const double x = end + (1 - end) * ((r1 * e2 - r2 * e1) / (r1 - r2)).real();
        const double dx = (1 - end) * (r1 * r2 * (e2 - e1) / (r1 - r2)).real();
        const Vector3d X(0.1, -0.2, 0.3);
        ASSERT_LT((s.vector("p_h") - x * X).norm(), 1e-9) << c.K << " N/m after " << s.now();
        ASSERT_LT((s.vector("f") - (c.K_g * x + c.D_g * dx) * X).norm(), 1e-7 * (c.K_g + c.D_g * std::abs(r1))) << s.now();
      }
    }
  }
}

TEST(OperatorHand, PullsAtAHeldPointWithBothSpringsInSeries) {
  Subject s("", kHeld + Values{{"waypoint_p", "0.05 0 -0.02 0.05 0 -0.02"}, {"relative", "false"}, {"K_h", "100 300 500"}});
  s.initialise();
  s.to(3);
  EXPECT_NEAR(s.vector("f").x(), 0.05 / (1 / 100. + 1 / 5000.), 1e-12);
  EXPECT_NEAR(s.vector("f").y(), 0, 1e-12);
  EXPECT_NEAR(s.vector("f").z(), -0.02 / (1 / 500. + 1 / 5000.), 1e-12);
}

TEST(OperatorHand, GripsAndReleasesSmoothly) {
  Subject s("", {{"waypoint_p", "0.05 0 0 0.05 0 0"}, {"relative", "false"}, {"grip_t", "0.5"}, {"release_t", "1.5"}});
  s.initialise();
  double before = 0, largest = 0;
  for (int i = 0; i < 2000; ++i) {
    s.step();
    if (s.now() <= 0.5 || s.now() > 1.7) {
      ASSERT_EQ(s.vector("f"), Vector3d::Zero()) << s.now();
    }
    ASSERT_NEAR(s.real("grip"), minimum_jerk((s.now() - 0.5) / 0.2) * (1 - minimum_jerk((s.now() - 1.5) / 0.2)), 1e-13);
    largest = std::max(largest, std::abs(s.vector("f").x() - before));
    before = s.vector("f").x();
    if (i == 1400) {
      EXPECT_NEAR(s.vector("f").x(), 0.05 / (1 / 300. + 1 / 5000.), 1e-6);
    }
  }
  EXPECT_LT(largest, 2);  // N per millisecond; at once it would be 250 N
}

// Without a grip the hand has no effect, so that the point may be anywhere when it is taken.
TEST(OperatorHand, TakesThePointWhereItIsAndGoesOnFromThere) {
  Subject s("grips=2&points=4", {{"waypoint_t", "1 2 3 4"},
                                 {"waypoint_p", "0 0 0  0.1 0 0  0.1 0 0.2  0 0 0"},
                                 {"grip_t", "0.5 3.2005"},
                                 {"release_t", "2.5 9"},
                                 {"axes", "0.8 0.2 -0.4 0.4"}});
  s.initialise();
  const Vector3d first(0.3, -0.2, 0.5), second(-0.4, 0.1, 0.9), v(0.05, 0, -0.1);
  s.put("p", first);
  s.to(0.9);
  EXPECT_LT(s.vector("f").norm(), 1e-9) << "closed on a point at rest, and not yet on the way";
  EXPECT_LT((s.vector("p_i") - first).norm(), 1e-14);
  s.to(2.3);
  const Vector3d displaced = Vector3d(0.1, 0, 0.2 * minimum_jerk(0.3));
  EXPECT_LT((s.vector("p_i") - first - displaced).norm(), 1e-14);
  EXPECT_GT(s.vector("f").x(), 20) << "the held point is pulled";
  s.to(2.8);
  EXPECT_EQ(s.vector("f"), Vector3d::Zero());
  s.put("v", v);
  for (int i = 0; i < 500; ++i) {  // the point moves at constant speed, also while it is taken
    s.put("p", second + (s.now() - 3.2005) * v);
    Vector3d::Map(s.rate("p").data()) = v;
    s.step();
  }
  const Vector3d path(0.1, 0, 0.2), at_3_3 = path - path * minimum_jerk(0.3), at_grip = path - path * minimum_jerk(0.2005);
  EXPECT_LT((s.vector("p_i") - second - (at_3_3 - at_grip)).norm(), 1e-12);
}

TEST(OperatorHand, TakesABodyInItsOrientation) {
  Subject s("moment=true&grips=2",
            {{"waypoint_t", "1 5"}, {"waypoint_turn", "0.2 0 0  0 0 1.2"}, {"grip_t", "0 3"}, {"release_t", "2 9"}});
  s.put("w", Vector3d::Zero());
  s.initialise();
  s.to(2.5);
  EXPECT_EQ(s.vector("m"), Vector3d::Zero());
  const Eigen::Quaterniond Q(Eigen::AngleAxisd(2.1, Vector3d(1, -2, 3).normalized()));
  const double values[] = {Q.w(), Q.x(), Q.y(), Q.z()};
  std::copy(values, values + 4, s["quat"].begin());
  s.to(3);
  s.step();
  EXPECT_LT(s.vector("m").norm(), 1e-3) << "the turn of 120 degrees before the grip is not turned back";
  const std::span<const double> Q_i = s["quat_i"];
  EXPECT_NEAR(std::abs(Q.dot(Eigen::Quaterniond(Q_i[0], Q_i[1], Q_i[2], Q_i[3]))), 1, 1e-6);
}

TEST(OperatorHand, CorrectsOnlyTheLagThatItSawSinceItTookThePoint) {
  Subject s("", {{"grip_t", "1"}, {"correction", "2"}, {"reaction_delay", "0.2"}});
  s.initialise();
  s.to(0.9);
  s.put("p", Vector3d(0.5, 0, 0));
  s.to(1.5);
  EXPECT_LT((s.vector("p_i") - Vector3d(0.5, 0, 0)).norm(), 1e-14) << "the point was elsewhere before";
}

/// The point moves, with exact slopes; stiffness and grip change. Returns the error of the balance over the energy turned over.
double leak(int parts) {
  Subject s("points=3", {{"waypoint_p", "0 0 0 0.3 0.1 0 0 0 0.2"},
                         {"D_h", "25 10 40"},
                         {"K_h", "300 200 500"},
                         {"grip_t", "0.1"},
                         {"axes", "0.8 0.2 -0.4 0.4"},
                         {"correction", "1"}});
  const auto p = [](double t) { return Vector3d(0.02 * std::sin(9 * t), 0.05 * std::sin(3 * t), 0.03 * std::sin(20 * t)); };
  const auto v = [](double t) { return Vector3d(0.18 * std::cos(9 * t), 0.15 * std::cos(3 * t), 0.6 * std::cos(20 * t)); };
  s.put("p", p(0));
  s.put("v", v(0));
  s.initialise();
  const double E0 = s.real("energy"), h = 1e-3 / parts;
  for (int i = 0; i < 2500 * parts; ++i) {
    if (i == 1000 * parts) s.set("K_h", "600 200 100");
    const double t = s.now();
    s.put("p", p(t));
    s.put("v", v(t));
    Vector3d::Map(s.rate("p").data()) = (p(t + h) - p(t)) / h;
    Vector3d::Map(s.rate("v").data()) = (v(t + h) - v(t)) / h;
    s.step(Duration{kTick.ns / parts});
  }
  const double balance = s.real("work_muscles") - s.real("work_robot") - s.real("work_dissipated") - (s.real("energy") - E0);
  EXPECT_GT(s.real("work_dissipated"), 0.5);
  return std::abs(balance) / s.real("work_dissipated");
}

TEST(OperatorHand, BalancesWorkEnergyAndDissipation) {
  const double once = leak(1), fine = leak(4);
  EXPECT_LT(once, 1e-4);
  EXPECT_LT(fine, once / 12);  // p and v are linear in a step: order two
}

TEST(OperatorHand, SeesThePointAsItWasExactlyTheReactionDelayAgo) {
  Subject s("history=60", {{"reaction_delay", "0.05"}});
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(-1, 1);
  std::vector<Vector3d> sent;
  for (int i = 0; i <= 300; ++i) {
    sent.emplace_back(any(random), any(random), any(random));
    s.put("p", sent.back());
    if (i == 0) s.initialise();
    s.step();
    ASSERT_EQ(s.vector("p_seen"), sent[static_cast<std::size_t>(std::max(i + 1 - 50, 0))]) << i;
  }
}

// With p = p_i the correction obeys ė = −ω_c e(t − T), which is stable for ω_c T < π/2.
TEST(OperatorHand, CorrectsWhatIsSeenAndIsStableUpToTheCrossoverLimit) {
  for (const double share : {0.3, 0.96, 1.04}) {
    const double T = 0.2, rate = share * std::numbers::pi / 2 / T;
    Subject s("", {{"reaction_delay", "0.2"}, {"correction", text::to_text(rate)}, {"correction_max", "1000"}});
    s.initialise();
    s.set("e", "0.01 0 0");
    double early = 0, late = 0;
    for (int i = 0; i < 20'000; ++i) {
      s.put("p", s.vector("p_i"));
      s.step();
      (i < 10'000 ? early : late) = std::max(i < 10'000 ? (i > 5'000 ? early : 0) : late, s.vector("e").norm());
    }
    EXPECT_EQ(late < early, share < 1) << share;
  }
  Subject held("", kHeld + Values{{"waypoint_p", "0 0 0 0.3 0 0"}, {"correction", "2"}, {"correction_max", "0.04"}});
  held.initialise();
  held.to(5);
  EXPECT_NEAR(held.vector("p_i").x(), 0.34, 1e-12) << "a held point does not wind the correction up";
}

// Virtual work: τ_eᵀ q̇ = fᵀ v for any posture and speed, and v is the rate of p.
TEST(OperatorHand, PushesTheJointsByTheTransposedJacobian) {
  for (const char* robot :
       {"lwr4", "planar2", "kr300_r2500", "tests/components/data/finger.urdf", "tests/components/data/gantry.urdf"}) {
    Subject s(std::string("robot=") + robot, kHeld + Values{{"offset", "0.1 -0.05 0.2"}, {"waypoint_p", "0 0 0 0.1 0.2 0.3"}});
    std::mt19937 random(7);
    std::uniform_real_distribution<double> any(-1, 1);
    const auto q = s["q"], dq = s["dq"];
    for (double& x : q) x = 0.3 * any(random);
    s.initialise();
    for (int i = 0; i < 200; ++i) {
      for (double& x : q) x += 0.01 * any(random);
      for (double& x : dq) x = any(random);
      s.step();
      double power = 0;
      for (std::size_t j = 0; j < q.size(); ++j) power += s["tau_e"][j] * dq[j];
      const double expected = s.vector("f").dot(s.vector("v"));
      ASSERT_NEAR(power, expected, 1e-9 * (1 + std::abs(expected))) << robot;
      const Vector3d p = s.vector("p"), v = s.vector("v");
      const std::vector<double> here(q.begin(), q.end());
      for (std::size_t j = 0; j < q.size(); ++j) q[j] += 1e-7 * dq[j];
      s.step();
      ASSERT_LT((s.vector("p") - p - 1e-7 * v).norm(), 1e-11) << robot;
      std::copy(here.begin(), here.end(), q.begin());
    }
  }
}

TEST(OperatorHand, TurnsItsStiffnessEllipsoidWithItsAxes) {
  const Eigen::Quaterniond Q(0.5, -0.1, 0.7, 0.3);
  const Eigen::Matrix3d R = Q.normalized().toRotationMatrix();
  Subject s("", kHeld + Values{{"axes", "0.5 -0.1 0.7 0.3"},
                               {"K_h", "100 300 500"},
                               {"relative", "false"},
                               {"waypoint_p", "0.1 0.02 -0.03 0.1 0.02 -0.03"},
                               {"D_h", "60"}});
  s.initialise();
  s.to(3);
  const Vector3d k(1 / (1 / 100. + 1 / 5000.), 1 / (1 / 300. + 1 / 5000.), 1 / (1 / 500. + 1 / 5000.));
  EXPECT_LT((s.vector("f") - R * k.asDiagonal() * R.transpose() * Vector3d(0.1, 0.02, -0.03)).norm(), 1e-9);
}

TEST(OperatorHand, MeasuresForceLagAndSmoothnessOfTheMotion) {
  const double A = 0.3, T = 1.5;
  const Values move = kHeld + Values{{"waypoint_t", "0.5 2"}, {"waypoint_p", "0 0 0 0 0.18 -0.24"}};
  Subject perfect("", move);  // the point follows the plan
  perfect.initialise();
  while (perfect.now() < 3) {
    const double s = std::clamp((perfect.now() + 1e-3 - 0.5) / T, 0.0, 1.0), ds = 30 * s * s * (1 - s) * (1 - s) / T;
    perfect.put("p", Vector3d(0, 0.6, -0.8) * A * minimum_jerk(s));
    perfect.put("v", Vector3d(0, 0.6, -0.8) * A * ds);
    perfect.step();
  }
  EXPECT_NEAR(perfect.real("jerk"), 720, 0.01 * 720);
  EXPECT_LT(perfect.real("lag_rms"), 1e-9);
  Subject held("", move + Values{{"m_h", "1e-6"}, {"D_h", "0"}, {"K_g", "1e9"}, {"D_g", "10"}});  // the point does not move
  held.initialise();
  held.to(3);
  const double rms = A * std::sqrt(181. / 462);  // ∫ (10 s³ − 15 s⁴ + 6 s⁵)² ds
  EXPECT_NEAR(held.real("lag_rms"), rms, 1e-5 * rms);
  EXPECT_NEAR(held.real("f_rms"), 300 * rms, 1e-4 * 300 * rms);
  EXPECT_EQ(held.real("jerk"), 0);
}

TEST(OperatorHand, RefusesWhatItCannotDo) {
  EXPECT_THAT(Subject("", {{"waypoint_t", "1 0.5"}}).error(), HasSubstr("waypoint 2: reached at 0.5 s"));
  EXPECT_THAT(Subject("", {{"m_h", "0.5 0 0.5"}}).error(), HasSubstr("m_h[2] = 0 kg"));
  EXPECT_THAT(Subject("", {{"K_h", "-1"}}).error(), HasSubstr("K_h[1] = -1 N/m"));
  EXPECT_THAT(Subject("", {{"axes", "0 0 0 0"}}).error(), HasSubstr("axes: the quaternion (w, x, y, z) has length 0"));
  EXPECT_THAT(Subject("", {{"grip_t", "1"}, {"release_t", "0.5"}}).error(),
              HasSubstr("release_t: is 0.5 s, expected at least 1 s"));
  EXPECT_THAT(Subject("grips=2", {{"grip_t", "1 3"}, {"release_t", "2 2.5"}}).error(),
              HasSubstr("release_t[2]: is 2.5 s, expected at least 3 s"));
  EXPECT_THAT(Subject("grips=2", {{"grip_t", "1 2.1"}, {"release_t", "2 3"}}).error(),
              HasSubstr("grip_t[2]: is 2.1 s, expected at least 2.2 s, when the grip before it is open"));
  EXPECT_THAT(Subject("", {{"passing", "over"}}).error(), HasSubstr("expected one of rest, through"));
  EXPECT_THAT(Subject("history=100", {{"reaction_delay", "0.2"}}).error(), HasSubstr("expected a larger setting history"));
  EXPECT_THROW(Subject("robot=lwr4&frame=tol"), Error);
  EXPECT_THROW(Subject("frame=tool"), Error) << "a frame without a robot has no effect";
  EXPECT_THROW(Subject("points=1"), Error);
  Subject s("");
  s.initialise();
  s.set("K_h", "-5");
  EXPECT_THROW(s.step(), Error) << "tunables are checked in each step";
}

TEST(OperatorHand, TurnsABodyAsItIntendsAndDoesTheWorkThatTheBodyReceives) {
  // A free body of inertia I: I ω̇ = m, integrated beside the unit with its quaternion.
  const Vector3d turn(0.3, -0.8, 2.5);
  Subject s("moment=true", kHeld + Values{{"waypoint_turn", "0 0 0 0.3 -0.8 2.5"},
                                          {"waypoint_p", "0 0 0 0 0 0"},
                                          {"K_r", "20 10 15"},
                                          {"D_r", "3 2 2"},
                                          {"axes", "0.9 0.1 -0.3 0.2"}});
  const double inertia = 0.2;
  Eigen::Quaterniond Q(Eigen::AngleAxisd(1.1, Vector3d(1, 2, 3).normalized()));
  const Eigen::Quaterniond start = Q;
  Vector3d w = Vector3d::Zero();
  const auto show = [&] {
    const double values[] = {Q.w(), Q.x(), Q.y(), Q.z()};
    std::copy(values, values + 4, s["quat"].begin());
    s.put("w", w);
  };
  show();
  s.initialise();
  EXPECT_EQ(s.vector("m"), Vector3d(0, 0, 0));
  double worst = 0;
  for (int n = 0; n < 6000; ++n) {
    show();
    s.step();
    const Vector3d before = w;
    w += 1e-3 / inertia * s.vector("m");
    const Vector3d way = 5e-4 * (before + w);
    Q = (Eigen::Quaterniond(Eigen::AngleAxisd(way.norm(), way.norm() > 0 ? Vector3d(way.normalized()) : Vector3d::UnitX())) *
         Q);
    Q.normalize();
    worst = std::max(worst, std::abs(s.real("work_turn") - inertia * w.squaredNorm() / 2));
  }
  const Eigen::Quaterniond intended = Eigen::Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.normalized())) * start;
  EXPECT_LT(Q.angularDistance(intended), 1e-3);
  EXPECT_LT(worst, 0.02);  // J, of 0.9 J at most: explicit steps of the body
  EXPECT_LT(s.vector("m").norm(), 0.05);
}

TEST(OperatorHand, ItsMomentIsPartOfTheJointTorquesOfAGuidedRobot) {
  Subject s("robot=lwr4&moment=true",
            kHeld + Values{{"waypoint_turn", "0 0 0 0.5 0.2 -0.1"}, {"waypoint_p", "0 0 0 0.1 0.2 0.3"}});
  const auto q = s["q"];
  for (std::size_t j = 0; j < q.size(); ++j) q[j] = 0.3 + 0.1 * static_cast<double>(j);
  s.initialise();
  s.to(0.8);
  EXPECT_GT(s.vector("m").norm(), 0.5);
  // The power of tau_e is that of force and moment: by the motion of the frame for each joint alone, by differences.
  const Vector3d f = s.vector("f"), m = s.vector("m");
  const std::vector<double> tau(s["tau_e"].begin(), s["tau_e"].end());
  Subject frame("robot=lwr4&moment=true", kHeld + Values{{"waypoint_p", "0 0 0 0 0 0"}, {"D_r", "1 1 1"}, {"K_r", "0 0 0"}});
  for (std::size_t j = 0; j < q.size(); ++j) {
    std::copy(q.begin(), q.end(), frame["q"].begin());
    std::fill(frame["dq"].begin(), frame["dq"].end(), 0.0);
    frame["dq"][j] = 1;
    frame.initialise();
    const Vector3d v = frame.vector("v"), w = -frame.vector("m");  // m = D_r (0 − ω)
    EXPECT_NEAR(tau[j], f.dot(v) + m.dot(w), 1e-9) << j;
  }
}

TEST(OperatorHand, GoesBackToAnEarlierStateAndAllocatesNothing) {
  Subject s("robot=lwr4&moment=true&grips=2", {{"waypoint_p", "0 0 0 0.1 0.2 0.3"},
                                               {"waypoint_turn", "0 0 0 0.1 0.2 0.3"},
                                               {"correction", "2"},
                                               {"grip_t", "0 1"},
                                               {"release_t", "0.6 9"}});
  const auto q = s["q"];
  s.initialise();
  const auto run = [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      for (std::size_t j = 0; j < q.size(); ++j) q[j] = 0.1 * std::sin(0.01 * i + static_cast<double>(j));
      ASSERT_EQ(s.unit().step(Time{i * kTick.ns}, kTick), StepResult::kDone);
    }
  };
  run(0, 400);
  Snapshot before, first, second;
  before.take(s.variables());
  const auto allocations = testing::allocations();
  run(400, 1600);  // the ring of 1000 samples is full
  EXPECT_EQ(testing::allocations(), allocations);
  first.take(s.variables());
  before.restore(s.variables(), s.unit());
  run(400, 1600);
  second.take(s.variables());
  EXPECT_EQ(first, second);
}

}  // namespace
}  // namespace cotwin::operator_hand_test
