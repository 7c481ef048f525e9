// Preparation of samples, and data of real robots.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <complex>
#include <filesystem>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/identification/identification.h"
#include "models/robot/urdf/urdf.h"
#include "models/trajectory/series/recording.h"
#include "models/trajectory/spline.h"
#include "tests/models/identification/samples.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"

namespace cotwin::identification::data_test {
namespace {

using namespace testing;
using Eigen::Index;
using Eigen::VectorXd;
using std::numbers::pi;

// ω²/(iν + ω)² for a sine of circular frequency ν, in gain and phase, on irregular steps; the acceleration is the derivative of
// the filtered speed, so its gain is the filter's times ν.
TEST(CausalFilter, HasTheResponseOfItsTransferFunction) {
  const double cutoff = 5, nu = 2 * pi * 3, omega = 2 * pi * cutoff;
  CausalFilter filter(1, cutoff);
  const std::complex<double> G = std::pow(omega / (std::complex<double>(omega, nu)), 2);
  const auto signal = [&](double t) { return std::sin(nu * t); };
  const auto response = [&](double t) { return (G * std::exp(std::complex<double>(0, nu * t))).imag(); };
  const auto slope = [&](double t) { return nu * (G * std::exp(std::complex<double>(0, nu * t))).real(); };
  const double zero = 0;
  filter.reset({&zero, 1}, {&zero, 1}, {&zero, 1});
  double t = 0;
  for (int k = 0; t < 4; ++k) {
    const double h = k % 3 == 0 ? 0.5e-3 : 1e-3;
    t += h;
    const double u = signal(t), tau = 7 * u;
    filter.step(h, {&u, 1}, {&u, 1}, {&tau, 1});
    if (t < 2) continue;  // the transient, e^(−ω t)
    // inputs are linear between samples: (ν h)²/8 of their size
    ASSERT_NEAR(filter.q()[0], response(t), 1e-4);
    ASSERT_NEAR(filter.dq()[0], response(t), 1e-4);
    ASSERT_NEAR(filter.ddq()[0], slope(t), 2e-3);
    ASSERT_NEAR(filter.tau()[0], 7 * response(t), 7e-4);
  }
}

TEST(CausalFilter, FollowsARampExactlyWithItsDelayWhateverTheStep) {
  for (const double h : {1e-4, 1e-2, 1.0}) {
    CausalFilter filter(1, 2);
    double q = 1, dq = 0, tau = 0;
    filter.reset({&q, 1}, {&dq, 1}, {&tau, 1});
    double t = 0;
    while (t < 6) {
      t += h;
      q = 1 + 3 * t;
      dq = 2 * t;
      filter.step(h, {&q, 1}, {&dq, 1}, {&tau, 1});
    }
    EXPECT_NEAR(filter.q()[0], 1 + 3 * (t - filter.delay()), 1e-9);
    EXPECT_NEAR(filter.ddq()[0], 2, 1e-9);
    EXPECT_EQ(filter.tau()[0], 0);
  }
}

TEST(CausalFilter, GoesOnFromItsStateAndAllocatesNothing) {
  CausalFilter a(2, 10), b(2, 10);
  const std::vector<double> q{0.1, 0.2}, dq{1, -1}, tau{3, 4};
  a.reset(q, dq, tau);
  const auto before = cotwin::testing::allocations();
  a.step(1e-3, dq, tau, q);
  EXPECT_EQ(cotwin::testing::allocations(), before);
  std::copy(a.state().begin(), a.state().end(), b.state().begin());
  b.restored();
  EXPECT_TRUE(std::ranges::equal(a.ddq(), b.ddq()));
  a.step(1e-3, q, dq, tau);
  b.step(1e-3, q, dq, tau);
  EXPECT_TRUE(std::ranges::equal(a.ddq(), b.ddq()));
  EXPECT_TRUE(std::ranges::equal(a.tau(), b.tau()));
  EXPECT_THROW(CausalFilter(2, 0), Error);
}

/// Data of a real robot: trained on the first 70 %, tested on the rest.
/// Positions, speeds and torques behind the same zero-phase low-pass (Hz); q̈ by the spline through the speeds; 2 % cut off at each
/// end, where derivatives are one-sided.
Samples prepare(const trajectory::Recording& recording, double cutoff) {
  const auto filtered = [&](const trajectory::Series& s) { return trajectory::smooth(s, cutoff, 4); };
  const trajectory::Series q = filtered(recording.q), tau = filtered(recording.tau);
  const auto derivative = [&](const std::vector<double>& x) {
    return trajectory::solve_spline(q.t, q.width, x, trajectory::SplineEnds::kFree).dq;
  };
  Samples all;
  all.joints = q.width;
  all.t = q.t;
  all.q = q.x;
  all.tau = tau.x;
  all.dq = recording.dq.size() != 0 ? filtered(recording.dq).x : derivative(q.x);
  all.ddq = derivative(all.dq);
  const auto cut = static_cast<std::size_t>(0.02 * static_cast<double>(all.t.size()));
  return part(all, cut, all.t.size() - cut);
}

struct RealRobot {
  robot::RobotModel robot;
  Samples train, test;
};

RealRobot load(const std::string& urdf, const std::string& csv, double cutoff) {
  RealRobot real;
  real.robot = robot::load_urdf(urdf);
  const trajectory::Recording recording =
      trajectory::load_recording(places::public_data("measurements/" + csv), trajectory::axes_of(real.robot));
  const Samples all = prepare(recording, cutoff);
  const std::size_t split = 7 * all.count() / 10;
  real.train = part(all, 0, split);
  real.test = part(all, split, all.count());
  return real;
}

bool absent(const std::string& csv) { return !std::filesystem::exists(places::public_data("measurements/" + csv)); }
constexpr const char* kNeeds = "needs public measurements (scripts/fetch_logs.py)";

struct Figures {
  VectorXd floor, feasible_train, swarm_train, feasible_test, swarm_test;
  double swarm_over_feasible = 0, swarm_over_floor = 0;
};

Figures identify(const RealRobot& real, const ModelOptions& options) {
  TorqueData train(real.robot, options), test(real.robot, options);
  add(train, real.train);
  add(test, real.test);
  test.flush();
  const Problem problem(train, real.robot);
  const FeasibleResult feasible = solve_feasible(problem);
  SwarmSearch search(problem);
  const SwarmSearchProgress progress = search.run();
  Figures f;
  f.floor = problem.floor().rms;
  f.feasible_train = problem.data().rms(feasible.estimate);
  f.swarm_train = problem.data().rms(search.estimate());
  f.feasible_test = test.rms(feasible.estimate);
  f.swarm_test = test.rms(search.estimate());
  f.swarm_over_feasible = progress.weighted_rms / feasible.weighted_rms;
  f.swarm_over_floor = progress.weighted_rms / std::sqrt(problem.floor().cost);
  return f;
}

VectorXd list(std::initializer_list<double> values) {
  return Eigen::Map<const VectorXd>(std::data(values), static_cast<Index>(values.size()));
}

// Reference values: least squares with friction terms by independent code with its own filter, to
// two digits.
TEST(RealRobots, PandaErrorIsAtMostThatOfIndependentLeastSquares) {
  if (absent("panda_unisa.csv")) GTEST_SKIP() << kNeeds;
  ModelOptions options;
  options.motor_inertia = false;  // torque sensors behind the gears
  const Figures f = identify(load(places::public_data("models/panda_franka_ros.urdf"), "panda_unisa.csv", 5), options);
  const VectorXd train = list({.27, .17, .24, .22, .07, .06, .05}), test = list({.34, .26, .28, .20, .11, .07, .05});
  EXPECT_LT((f.floor - train).cwiseAbs().maxCoeff(), 0.02);
  EXPECT_LT(f.swarm_over_feasible, 1.02);
  EXPECT_GE(f.swarm_over_floor, 1);
  EXPECT_LE(f.feasible_test.norm(), test.norm());
  EXPECT_LE(f.swarm_test.norm(), test.norm());
}

TEST(RealRobots, Ur10ErrorIsBelowThatOfIndependentLeastSquares) {
  if (absent("ur10_unisa.csv")) GTEST_SKIP() << kNeeds;
  const RealRobot real = load(places::source() + "/models/robots/ur10/robot.urdf", "ur10_unisa.csv", 10);
  const VectorXd train = list({2.8, 1.8, 1.7, .40, .38, 1.9}), test = list({3.1, 3.3, 2.1, .76, .31, 1.1});
  const Figures f = identify(real, {});
  EXPECT_LT((f.floor - train).cwiseQuotient(train).cwiseAbs().maxCoeff(), 0.03);
  EXPECT_LT(f.swarm_over_feasible, 1.02);
  EXPECT_GE(f.swarm_over_floor, 1);
  EXPECT_LE(f.feasible_test.norm(), 1.01 * test.norm());

  // Its friction rises over a speed of about 0.1 rad/s: with the slope in the search the error is a third smaller.
  ModelOptions sigmoid;
  sigmoid.friction = FrictionLaw::kSigmoid;
  const Figures s = identify(real, sigmoid);
  EXPECT_LT(s.swarm_over_feasible, 1.02);
  EXPECT_GE(s.swarm_over_floor, 1);
  EXPECT_LT(s.swarm_train.norm(), 0.75 * f.swarm_train.norm());
  EXPECT_LT(s.swarm_test.norm(), 0.85 * test.norm());
}

}  // namespace
}  // namespace cotwin::identification::data_test
