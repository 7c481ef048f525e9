// The largest stiffness of an environment that the admittance tolerates: by eigenvalues, and as motion of unit and drive train.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <complex>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "components/compliance/cartesian/frame/contact_stiffness.h"
#include "components/unit/unit_table.h"
#include "tests/support/places.h"

namespace cotwin::contact_test {
namespace {

using compliance::ContactSweep;
using compliance::FollowingRobot;
using compliance::largest_contact_stiffness;
using compliance::SecondOrder;

/// The largest real part of the roots of Σ c_k sᵏ, relative to the largest root.
double growth(const std::vector<double>& c) {
  const auto n = static_cast<Eigen::Index>(c.size()) - 1;
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n, n);
  A.diagonal(1).setOnes();
  for (Eigen::Index k = 0; k < n; ++k) A(n - 1, k) = -c[static_cast<std::size_t>(k)] / c.back();
  const Eigen::VectorXcd roots = Eigen::EigenSolver<Eigen::MatrixXd>(A, false).eigenvalues();
  return roots.real().maxCoeff() / roots.cwiseAbs().maxCoeff();
}

std::vector<double> product(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> c(a.size() + b.size() - 1);
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < b.size(); ++k) c[i + k] += a[i] * b[k];
  }
  return c;
}

SecondOrder critically_damped(double M, double S) { return {M, 2 * std::sqrt(S * M), S}; }

TEST(ContactStiffness, OfAPositionControlledRobotIsThePublishedExample) {
  // Table II of the paper in X, Y, Z; figures of an independent computation, three digits.
  const double S[] = {1500, 1000, 500}, slow[] = {6000, 4060, 2170}, fast[] = {14'800, 11'600, 7750},
               heavy[] = {39'800, 32'000, 22'200};
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(largest_contact_stiffness(critically_damped(1, S[i]), 40, 1), slow[i], 0.005 * slow[i]);
    EXPECT_NEAR(largest_contact_stiffness(critically_damped(1, S[i]), 300, 1), fast[i], 0.005 * fast[i]);
    EXPECT_NEAR(largest_contact_stiffness(critically_damped(10, S[i]), 300, 1), heavy[i], 0.005 * heavy[i]);
  }
}

TEST(ContactStiffness, SeparatesGrowingFromDecayingEigenvalues) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> decade(-1.5, 1.5);
  const auto draw = [&](double scale) { return scale * std::pow(10, decade(random)); };
  int bounded = 0;
  for (int round = 0; round < 5000; ++round) {
    const double omega = draw(1), zeta = draw(1);  // in units of the admittance's frequency
    const SecondOrder a{1, draw(1), round % 5 == 0 ? 0.0 : 1.0};
    const double K = largest_contact_stiffness(a, omega, zeta);
    const auto at = [&](double K_e) {
      std::vector<double> c = product({a.S, a.D, a.M}, {omega * omega, 2 * zeta * omega, 1});
      c[0] += K_e * omega * omega;
      return growth(c);
    };
    if (K < 0.01) continue;
    ++bounded;
    ASSERT_LT(at(0.99 * K), 0) << round;
    ASSERT_GT(at(1.01 * K), 0) << round;
  }
  EXPECT_GT(bounded, 3000);
}

// e^(−d s) by Padé's approximant of order 2, whose phase is exact to 5e-4 for Ωd < 0.8.
TEST(ContactStiffness, OfAPositionControlledRobotBehindADelaySeparatesGrowingFromDecayingEigenvalues) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> decade(-1, 1);
  const auto draw = [&](double scale) { return scale * std::pow(10, decade(random)); };
  int bounded = 0;
  for (int round = 0; round < 5000; ++round) {
    const double omega = draw(3), zeta = draw(1), d = draw(0.1);  // in units of the admittance's frequency
    const SecondOrder a{1, draw(2), round % 5 == 0 ? 0.0 : 1.0};
    const double K = largest_contact_stiffness(a, omega, zeta, d), without = largest_contact_stiffness(a, omega, zeta);
    ASSERT_LE(K, without) << round;
    const std::vector<double> late = {1, -d / 2, d * d / 12};
    const auto at = [&](double K_e) {
      std::vector<double> early = late;
      for (double& c : early) c = std::abs(c);
      std::vector<double> c = product(product({a.S, a.D, a.M}, {omega * omega, 2 * zeta * omega, 1}), early);
      for (std::size_t k = 0; k < late.size(); ++k) c[k] += K_e * omega * omega * late[k];
      return growth(c);
    };
    const double highest = 2 * std::max({1.0, omega, std::sqrt(K)});  // of the frequencies that decide
    if (K < 0.01 || K > 0.99 * without || highest * d > 0.8) continue;
    ++bounded;
    ASSERT_LT(at(0.99 * K), 0) << round;
    ASSERT_GT(at(1.01 * K), 0) << round;
  }
  EXPECT_GT(bounded, 1500);
}

// A position control that resonates in the delay: the border is the least |A/T| of all frequencies where A/T e^(jΩd) < 0.
TEST(ContactStiffness, OfAResonatingPositionControlBehindADelayIsTheLeastOfAllCrossings) {
  for (const double zeta : {0.01, 0.1, 0.5, 1.0}) {
    for (const double d : {0.05, 0.4, 0.9, 2.0}) {
      const SecondOrder a{1, 3, 1};
      const double omega = 10;
      double least = largest_contact_stiffness(a, omega, zeta), before = 0;  // it may be less late, too
      for (double Omega = 1e-3; Omega < 3 * omega; Omega += 1e-4) {
        const std::complex<double> s(0, Omega);
        const std::complex<double> P =
            (a.M * s * s + a.D * s + a.S) * (s * s / (omega * omega) + 2 * zeta / omega * s + 1.0) * std::exp(s * d);
        if (P.imag() * before < 0 && P.real() < 0) least = std::min(least, std::abs(P));
        before = P.imag();
      }
      EXPECT_NEAR(largest_contact_stiffness(a, omega, zeta, d), least, 2e-3 * least) << zeta << " " << d;
    }
  }
}

/// Of a robot of one joint with the admittance `a` in rotation about z, one whole search.
double of_one_joint(const SecondOrder& a, FollowingRobot robot) {
  robot.J(5, 0) = robot.J_bar(0, 5) = 1;
  robot.rotation.M(2, 2) = a.M;
  robot.rotation.D(2, 2) = a.D;
  robot.rotation.S(2, 2) = a.S;
  ContactSweep sweep(1);
  for (int n = 0; n < 2000; ++n) {
    if (sweep.advance(robot)) return sweep.K_e_max[5];
  }
  ADD_FAILURE() << "no end";
  return 0;
}

TEST(ContactStiffness, OfARigidRobotIsBelowThatOfTheDelayOfHalfAStepAndOfItsMeasurements) {
  // The contact moves the mass m itself during the delay T: (M s² + D s + S) + K_e e^(−T s) = 0 for m → ∞ and weak gains, at s =
  // jΩ: tan(TΩ) = DΩ/(MΩ² − S), K_e = DΩ/sin(TΩ).
  for (const double h : {2e-4, 2e-3, 1e-2}) {
    for (const auto& [S, old] : {std::pair{0.0, 0.0}, {100.0, 0.0}, {2000.0, 0.0}, {100.0, 2.0}}) {
      const SecondOrder a{1, 40, S};
      const double delay = old * h, T = delay + (0.5 + ContactSweep::kDelay) * h;
      double low = std::sqrt(S), high = 1.57 / T;
      for (int k = 0; k < 100; ++k) {
        const double Omega = (low + high) / 2;
        (std::tan(T * Omega) * (Omega * Omega - S) < a.D * Omega ? low : high) = Omega;
      }
      const double exact = ContactSweep::kShare * a.D * low / std::sin(T * low);
      FollowingRobot heavy(1);
      heavy.M(0, 0) = 1e6;
      heavy.step = h;
      heavy.delay = delay;
      EXPECT_NEAR(of_one_joint(a, heavy), exact, 0.08 * exact) << h << " " << S << " " << delay;
    }
  }
}

TEST(ContactStiffness, OfAnUndampedAdmittanceIsZeroAndNeverNegative) {
  EXPECT_EQ(largest_contact_stiffness({1, 0, 100}, 40, 1, 1e-3), 0);
  EXPECT_GT(largest_contact_stiffness({1, 3, 1}, 1e6, 1e-3, 1), 0) << "10^5 crossings: a bound of them";
  EXPECT_EQ(largest_contact_stiffness({1, 0, 100}, 40, 1), 0);
  EXPECT_EQ(largest_contact_stiffness({1, 0, 0}, 40, 1), 0);
  EXPECT_EQ(largest_contact_stiffness({1, 0, 0}, 40, 0), 0);
}

// ----- One link on an elastic or rigid joint pushes a spring.

struct Design {
  double K = 1e4;  // N.m/rad; 0: rigid
  double M_a = 0.05, S_a = 300;
  double bandwidth = 500;
  double h = 1e-3;
  double shaping = 4, omega = 30, B = 1;
};
constexpr double kInertia = 0.2, kDamping = 5;  // of rotor.urdf; of the gear

double predicted(const Design& d) {
  FollowingRobot robot(1);
  const double total = kInertia + d.B;
  robot.M(0, 0) = d.K > 0 ? kInertia : total;
  robot.B[0] = d.B;
  robot.K[0] = d.K;
  robot.D[0] = kDamping;
  robot.K_P(0, 0) = d.omega * d.omega * total;
  robot.K_D(0, 0) = 2 * d.omega * total;
  robot.shaping[0] = d.shaping;
  robot.bandwidth = d.bandwidth;
  robot.step = d.h;
  return of_one_joint(critically_damped(d.M_a, d.S_a), robot);
}

class Wall {
 public:
  explicit Wall(const Design& d)
      : controller_(make("compliance")),
        drive_(make(d.K > 0 ? "drive_train" : "drive_train?transmission=rigid")),
        elastic_(d.K > 0),
        step_{std::lround(1e9 * d.h)} {
    for (Instance* unit : {&controller_, &drive_}) {
      for (const char* name : {"sigma0", "sigma1", "sigma2", "tau_C", "tau_S"}) set(*unit, name, 0);
      set(*unit, "B", d.B);
      if (elastic_ || unit == &controller_) set(*unit, "K", d.K);
    }
    if (elastic_) set(drive_, "D", kDamping);
    set(controller_, "M_a", d.M_a);
    set(controller_, "S_a", d.S_a);
    set(controller_, "shaping", d.shaping);
    set(controller_, "omega", d.omega);
    set(controller_, "elastic_bandwidth", d.bandwidth);
    drive_.unit->initialise({});
    controller_.unit->initialise({});
  }

  /// The amplitude at the end over that after the first touch, in 3 s.
  double growth(double K_e) {
    constexpr int kParts = 20;  // the wall's force is continuous for the link
    const int steps = static_cast<int>(3e9 / static_cast<double>(step_.ns));
    double early = 0, late = 0;
    for (int n = 0; n < steps; ++n) {
      for (const char* name : {"q", "dq"}) set(controller_, name, get(drive_, name));
      for (const char* name : {"theta", "dtheta"}) set(controller_, name, elastic_ ? get(drive_, name) : 0.0);
      const double push = n < 10 ? 0.1 : 0.0;
      set(controller_, "tau_e", push - K_e * get(drive_, "q"));
      EXPECT_EQ(controller_.unit->step({}, step_), StepResult::kDone);
      set(drive_, "tau_m", get(controller_, "tau_m"));
      for (int k = 0; k < kParts; ++k) {
        set(drive_, "tau_e", push - K_e * get(drive_, "q"));
        EXPECT_EQ(drive_.unit->step({}, Duration{step_.ns / kParts}), StepResult::kDone);
      }
      const double x = std::abs(get(drive_, "q"));
      if (!(x < 1)) return 1e9;
      if (n > steps / 6 && n < steps / 3) early = std::max(early, x);
      if (n > 5 * steps / 6) late = std::max(late, x);
    }
    return late < 1e-12 ? 0 : late / early;
  }

 private:
  static Instance make(const std::string& unit) {
    return make_unit("unit:" + unit, {{"robot", places::source() + "/tests/components/data/rotor.urdf"}}, {}, unit_types());
  }
  static void set(Instance& unit, const char* name, double value) { unit.variables.at(name).reals()[0] = value; }
  static double get(Instance& unit, const char* name) { return unit.variables.at(name).reals()[0]; }

  Instance controller_, drive_;
  bool elastic_;
  Duration step_;
};

TEST(ContactStiffness, IsBelowWhereUnitAndDriveTrainBeginToVibrateAgainstASpring) {
  const Design designs[] = {{},
                            {.M_a = 0.02, .S_a = 100},
                            {.bandwidth = 200},
                            {.h = 2.5e-4},
                            {.h = 2e-3},
                            {.K = 3e4},
                            {.K = 3e3},
                            {.shaping = 1},  // the same motors, less light
                            {.omega = 100},  // stiff gains hold the motors, so that the links vibrate on the gears
                            {.shaping = 8, .omega = 10},
                            {.B = 0.1},
                            {.B = 3},
                            {.K = 0, .M_a = 0.1},
                            {.K = 0, .M_a = 0.4, .h = 2e-3},
                            {.K = 0, .M_a = 0.1, .omega = 150}};
  for (const Design& d : designs) {
    const double K_e = predicted(d);
    const auto which = &d - designs;
    EXPECT_LT(Wall(d).growth(K_e), 1) << which << ": " << K_e;
    EXPECT_GT(Wall(d).growth(4.8 * K_e), 1) << which << ": " << K_e;
  }
}

TEST(ContactStiffness, OfAnAdmittanceHeavierThanTheRobotIsBoundedBySamplingAlone) {
  for (const Design& d : {Design{.M_a = 0.3}, Design{.M_a = 2}, Design{.K = 0, .M_a = 3}}) {
    const double mass = d.K > 0 ? kInertia : kInertia + d.B, K_e = predicted(d);
    const double most = std::min(mass, d.M_a) / (d.h * d.h);
    EXPECT_LE(K_e, most) << d.K << " " << d.M_a;
    EXPECT_GT(K_e, 0.1 * most) << d.K << " " << d.M_a;
    EXPECT_LT(Wall(d).growth(K_e), 1) << d.K << " " << d.M_a;
  }
}

}  // namespace
}  // namespace cotwin::contact_test
