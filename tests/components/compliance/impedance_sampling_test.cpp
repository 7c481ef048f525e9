// render=impedance at the rate of the steps: whether the robot vibrates with held torques and old measurements, and what the unit says.
#include "components/compliance/cartesian/sampled_loop.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <random>
#include <string>

#include "models/numerics/dense.h"
#include "tests/components/compliance/cartesian_harness.h"
#include "tests/support/allocations.h"

namespace cotwin::testing::impedance_sampling_test {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr const char* kMeasured[] = {"q", "dq", "theta", "dtheta"};
constexpr int kParts = 2;  // of a step

/// A random robot, posture, stiffness and drive train, with measurements that are `late` parts of a step old.
class Design {
 public:
  Design(unsigned seed, double fastest_shaping, int latest)
      : random_(seed),
        robot_(std::array{"lwr4", "ur5e", "ur10e"}[seed % 3]),
        kinematics_(robot_),
        unit("unit:compliance?space=cartesian&render=impedance", robot_),
        drive("unit:drive_train", robot_),
        late(std::uniform_int_distribution<int>(latest > 0 ? kParts : 0, latest)(random_)) {
    for (const char* off : {"tau_max", "q_min", "q_max", "dq_max", "tau_C", "tau_S", "sigma0", "sigma1", "sigma2"})
      unit[off].setZero();
    for (const char* friction : {"tau_C", "tau_S", "sigma0", "sigma1", "sigma2"}) drive[friction].setZero();
    q_ = unit["q"].size() == 7 ? lwr4_posture() : (VectorXd(6) << 0.2, -1.2, 1.5, 0.3, 0.7, 0.1).finished();
    for (double& angle : q_) angle += draw(-0.5, 0.5);
    unit["S_T"] = three_decades(2, 3.7);
    unit["K_o"] = three_decades(1, 2.5);
    unit["shaping"].setConstant(draw(1, fastest_shaping));
    const double K = decades(3.7, 4.7), B = decades(-0.7, 0.3), D = draw(0, 1) < 0.3 ? 0.0 : decades(0, 1.7);
    for (Subject* part : {&unit, &drive}) {
      (*part)["K"].setConstant(K);
      (*part)["B"].setConstant(B);
      (*part)["D"].setConstant(D);
    }
    unit["delay"][0] = 1e-3 * late / kParts;
  }

  /// The amplitude of the motion after a push, in the last quarter of 2 s over that in the second; 1e9 where it grows without a bound.
  double growth() {
    desire(unit, kinematics_.at(q_));
    drive["q0"] = q_;
    drive.initialise();
    std::deque<std::array<VectorXd, 4>> past;
    const auto measure = [&] {
      past.push_back({drive["q"], drive["dq"], drive["theta"], drive["dtheta"]});
      if (static_cast<int>(past.size()) > late + 1) past.pop_front();
    };
    const auto pass = [&] {
      for (int k = 0; k < 4; ++k) unit[kMeasured[k]] = past.front()[static_cast<std::size_t>(k)];
    };
    measure();
    pass();
    unit.initialise();
    constexpr int kSteps = 2000;
    double early = 0, last = 0;
    for (int n = 0; n < kSteps; ++n) {
      pass();
      unit.step();
      drive["tau_m"] = unit["tau_m"];
      for (int k = 0; k < kParts; ++k) {
        drive["tau_e"] = (n < 5 ? 1e-2 : 0.0) * VectorXd::Ones(q_.size());
        drive.step(Duration{kMillisecond.ns / kParts});
        measure();
      }
      const double speed = drive["dq"].norm();
      if (!(speed < 5)) return 1e9;
      if (n > kSteps / 4 && n < kSteps / 2) early = std::max(early, speed);
      if (n > 3 * kSteps / 4) last = std::max(last, speed);
    }
    return last < 1e-9 ? 0 : last / early;
  }
  bool told() const { return unit.warning().find("make the robot vibrate") != std::string::npos; }

 private:
  double draw(double least, double most) { return std::uniform_real_distribution<double>(least, most)(random_); }
  double decades(double least, double most) { return std::pow(10, draw(least, most)); }
  Vector3d three_decades(double least, double most) {  // in the same order with every compiler
    const double z = decades(least, most), y = decades(least, most), x = decades(least, most);
    return {x, y, z};
  }

  std::mt19937_64 random_;
  std::string robot_;
  Kinematics kinematics_;
  VectorXd q_;

 public:
  Subject unit, drive;
  int late;
};

TEST(ImpedanceSampling, TellsExactlyTheDesignsWhoseMotionGrows) {
  int grow = 0, grow_without_delay = 0;
  for (unsigned seed = 0; seed < 100; ++seed) {
    Design design(seed, 5, seed % 2 == 0 ? 0 : 10);
    const bool grows = design.growth() > 1;
    grow += grows;
    grow_without_delay += grows && design.late == 0;
    EXPECT_EQ(design.told(), grows) << seed << ": " << design.late << " " << design.unit.warning();
  }
  EXPECT_GT(grow, 30);
  EXPECT_LT(grow, 80);
  EXPECT_GT(grow_without_delay, 10);
}

TEST(ImpedanceSampling, IsStableBelowTheBordersThatAreTold) {
  int delays = 0, shapings = 0, stiffnesses = 0;
  for (unsigned seed = 0; seed < 30; ++seed) {
    Design told(seed, 5, 10);
    told.growth();
    const auto grows = [&](double shaping, double stiffness) {
      Design design(seed, 5, 10);
      design.unit["shaping"].setConstant(shaping);
      for (const char* name : {"S_T", "K_o"}) design.unit[name] *= stiffness;
      return design.growth() > 1;
    };
    const double shaping = told.unit.value("shaping"), most = told.unit.value("shaping_border");
    if (most > 0) {
      ++shapings;
      EXPECT_FALSE(grows(1 + 0.97 * (most - 1), 1)) << seed;
      EXPECT_TRUE(grows(std::min(shaping, 1 + 1.5 * (most - 1)), 1)) << seed;
    }
    const double stiffness = told.unit.value("stiffness_border");
    if (stiffness > 0) {
      ++stiffnesses;
      EXPECT_FALSE(grows(shaping, 0.97 * stiffness)) << seed;
      EXPECT_TRUE(grows(shaping, std::min(1.0, 1.5 * stiffness))) << seed;
    }
    delays += told.unit.value("delay_border") > 0;
    EXPECT_LT(told.unit.value("delay_border"), 1e-3 * told.late / kParts) << seed;
  }
  EXPECT_GT(delays, 5);
  EXPECT_GT(shapings, 5);
  EXPECT_GT(stiffnesses, 0);
}

/// A design that vibrates with 4 ms, but not with 0.6 ms, in its first step.
Design at_rest() {
  Design design(2, 5, 10);
  const VectorXd q = VectorXd::Constant(6, 0.7);
  desire(design.unit, Kinematics("ur10e").at(q));
  design.unit["q"] = design.unit["theta"] = q;
  design.unit["delay"][0] = 0;
  design.unit["shaping"].setOnes();
  design.unit.initialise();
  return design;
}

TEST(ImpedanceSampling, IsCheckedInTheFirstStepAndOncePerDoublingOfTheStepWithoutAllocation) {
  Design design = at_rest();
  EXPECT_EQ(design.unit.value("checked_step"), 0);
  const double steps[] = {1e-4, 5e-5, 1.9e-4, 3e-4, 5.9e-4, 4e-3, 3e-2},
               checked[] = {1e-4, 1e-4, 1e-4, 3e-4, 3e-4, 4e-3, 4e-3};  // more than the step that vibrates is not looked for
  for (std::size_t k = 0; k < std::size(steps); ++k) {
    const auto before = allocations();
    design.unit.step(Duration{std::lround(1e9 * steps[k])});
    EXPECT_EQ(allocations() - before, 0u) << steps[k];
    EXPECT_EQ(design.unit.value("checked_step"), checked[k]) << steps[k];
    EXPECT_EQ(design.told(), steps[k] >= 4e-3) << steps[k];
  }
}

// The search takes tens of milliseconds: a controller that runs must not make it.
TEST(ImpedanceSampling, BordersAreSoughtOnlyInTheFirstStep) {
  for (const double first : {1e-4, 4e-3}) {
    Design design = at_rest();
    for (const double h : {first, 4e-3, 8e-3}) design.unit.step(Duration{std::lround(1e9 * h)});
    EXPECT_TRUE(design.told());
    EXPECT_EQ(design.unit.value("checked_step"), 4e-3);
    EXPECT_EQ(design.unit.value("stiffness_border") > 0, first == 4e-3) << design.unit.warning();
  }
}

// ----- The loop alone.

using compliance::SampledLoop;
using compliance::SampledRobot;

/// ln of the largest eigenvalue of a step, whose columns are motions integrated by the classical Runge–Kutta method: of links and motors
/// and of the torques that measurements of earlier steps still have to give.
double growth_by_integration(const SampledRobot& r) {
  const auto n = r.M.rows();
  const int old = static_cast<int>(std::ceil(r.delay / r.step - 1e-9));
  const Eigen::MatrixXd A = Eigen::MatrixXd::Identity(n, n) - r.relief * r.K.cwiseInverse().asDiagonal() * r.H;
  const Eigen::MatrixXd stiffness = r.H * A.inverse(), M_inverse = r.M.inverse();
  const auto torque = [&](const VectorXd& x) -> VectorXd {
    const VectorXd q = x.head(n), theta = x.segment(n, n), dtheta = x.tail(n);
    const VectorXd u = -stiffness * theta - r.R * dtheta;
    return r.shaping.cwiseProduct(u) - (r.shaping.array() - 1).matrix().cwiseProduct(r.K.cwiseProduct(theta - q));
  };
  const auto rate = [&](const VectorXd& x, const VectorXd& tau) {
    VectorXd d(4 * n);
    const VectorXd gear = r.K.cwiseProduct(x.segment(n, n) - x.head(n)) + r.D.cwiseProduct(x.tail(n) - x.segment(2 * n, n));
    d << x.segment(2 * n, n), x.tail(n), M_inverse * gear, (tau - gear).cwiseQuotient(r.B);
    return d;
  };
  const auto size = (4 + old) * n;
  Eigen::MatrixXd map(size, size);
  for (Eigen::Index column = 0; column < size; ++column) {
    const VectorXd start = VectorXd::Unit(size, column);
    VectorXd x = start.head(4 * n);
    VectorXd queue(n * (old + 1));  // measured now, a step ago, …
    queue << torque(x), start.tail(n * old);
    constexpr int kFine = 400;
    for (int k = 0; k < kFine; ++k) {
      const double t = (k + 0.5) * r.step / kFine, h = r.step / kFine;
      const auto age = static_cast<Eigen::Index>(std::ceil((r.delay - t) / r.step));
      const VectorXd tau = queue.segment(n * std::max<Eigen::Index>(age, 0), n);
      const VectorXd k1 = rate(x, tau), k2 = rate(x + h / 2 * k1, tau), k3 = rate(x + h / 2 * k2, tau),
                     k4 = rate(x + h * k3, tau);
      x += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    }
    map.col(column) << x, queue.head(n * old);
  }
  return std::log(map.eigenvalues().cwiseAbs().maxCoeff());
}

SampledRobot random_loop(std::mt19937_64& random, int n) {
  const auto draw = [&](double least, double most) { return std::uniform_real_distribution<double>(least, most)(random); };
  const auto definite = [&](double low, double high) -> Eigen::MatrixXd {
    Eigen::MatrixXd V(n, n);
    for (double& value : V.reshaped()) value = draw(-1, 1);
    VectorXd d(n);
    for (double& value : d) value = std::pow(10, draw(low, high));
    return V * d.asDiagonal() * V.transpose() + std::pow(10, low) * Eigen::MatrixXd::Identity(n, n);
  };
  SampledRobot r(n);
  r.M = definite(-1, 1);
  for (double& K : r.K) K = std::pow(10, draw(3.5, 4.5));
  for (double& B : r.B) B = std::pow(10, draw(-0.5, 0.5));
  for (double& D : r.D) D = std::pow(10, draw(0, 1.5));
  for (double& s : r.shaping) s = draw(1, 4);
  r.H = definite(1, 2.5);
  r.R = definite(0, 1.5);
  r.step = 1e-3;
  r.delay = 1e-3 * 0.25 * std::uniform_int_distribution<int>(0, 12)(random);
  return r;
}

TEST(SampledLoop, GrowsAsTheEigenvaluesOfIntegratedMotions) {
  std::mt19937_64 random(1);
  int grow = 0;
  for (int round = 0; round < 60; ++round) {
    const int n = 1 + round % 3;
    const SampledRobot r = random_loop(random, n);
    const double exact = growth_by_integration(r), told = SampledLoop(n).growth(r);
    if (exact > 2e-6) {
      ++grow;
      EXPECT_NEAR(told, exact, 1e-2 * exact + 1e-6) << round;
    } else {
      EXPECT_LT(told, SampledLoop::kNone) << round << " " << exact;
    }
  }
  EXPECT_GT(grow, 15);
  EXPECT_LT(grow, 50);
}

TEST(SampledLoop, OfARigidJointGrowsFromTheKnownBordersOn) {
  // A mass m with a held damper R: v⁺ = (1 − R h/m) v, stable up to R h/m = 2. With a delay of one step λ² − λ + R h/m = 0: up to 1.
  SampledRobot r(1);
  r.M(0, 0) = 0.3;
  r.B[0] = 0.2;
  for (const double delay : {0.0, 1e-3}) {
    r.delay = delay;
    const double most = (delay > 0 ? 1.0 : 2.0) * 0.5 / r.step;
    r.R(0, 0) = 0.999 * most;
    EXPECT_LT(SampledLoop(1).growth(r), SampledLoop::kNone);
    r.R(0, 0) = 1.001 * most;
    EXPECT_GT(SampledLoop(1).growth(r), SampledLoop::kNone);
  }
}

TEST(SampledLoop, ExaminesDelaysOfManyStepsWithLongerOnes) {
  // A delayed damper, ẍ = −R/m ẋ(t − T), is stable up to R T/m = π/2.
  SampledRobot r(1);
  r.M(0, 0) = 0.3;
  r.B[0] = 0.2;
  r.step = 1e-4;
  r.delay = 20e-3;
  const double most = 3.14159265 / 2 * 0.5 / (r.delay + r.step / 2);
  r.R(0, 0) = 0.99 * most;
  EXPECT_LT(SampledLoop(1).growth(r), SampledLoop::kNone);
  r.R(0, 0) = 1.01 * most;
  EXPECT_GT(SampledLoop(1).growth(r), SampledLoop::kNone);
}

}  // namespace
}  // namespace cotwin::testing::impedance_sampling_test
