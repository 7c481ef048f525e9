// Run lengths of the CUSUM against an integral equation, a published table and runs; whitening; effects of causes against finite differences.
#include "models/anomaly/cusum.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "models/anomaly/attribution.h"
#include "models/anomaly/whitening.h"
#include "models/numerics/random.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"

namespace cotwin::anomaly_cusum_test {
namespace {

using namespace anomaly;

double normal(std::uint32_t run, std::uint32_t k) { return numerics::normal({.seed = 87, .stream = run, .round = k}); }

/// The run length from 0 by the Markov chain of Brook and Evans (Biometrika 59, 1972) with `m` states.
double run_length_of_chain(double k, double h, int m) {
  const double width = 2 * h / (2 * m - 1);
  const auto below = [](double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); };
  Eigen::MatrixXd A = Eigen::MatrixXd::Identity(m, m);
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j < m; ++j) {
      const double from = i * width, high = below(j * width + 0.5 * width - from + k);
      A(i, j) -= j == 0 ? high : high - below(j * width - 0.5 * width - from + k);
    }
  }
  return A.partialPivLu().solve(Eigen::VectorXd::Ones(m))[0];
}

TEST(CusumOfAnomalies, HasTheRunLengthOfTheory) {
  EXPECT_NEAR(run_length_of_chain(0.5, 4, 200), 336, 1);  // the published ones of one side, k = 0.5
  EXPECT_NEAR(run_length_of_chain(0.5, 5, 200), 930, 4);
  for (const double k : {0.25, 0.5, 1.0}) {
    for (const double h : {3.0, 5.0, 7.0}) {
      EXPECT_NEAR(run_length(k, h) / run_length_of_chain(k, h, 200), 1, k < 1 ? 0.03 : 0.06) << k << ' ' << h;
      EXPECT_NEAR(threshold(k, run_length(k, h)), h, 1e-9);
    }
  }
  EXPECT_LT(threshold(50, 1e9), 1) << "huge reference values have small thresholds, not infinite ones";
}

TEST(CusumOfAnomalies, HasTheRunLengthOfTheoryOverFourThousandRunsOfWhiteNoise) {
  constexpr double kReference = 0.5, kLength = 100;
  const double h = threshold(kReference, kLength);
  double up = 0, down = 0;
  constexpr std::uint32_t kRuns = 4000;
  for (std::uint32_t run = 0; run < kRuns; ++run) {
    Cusum sum;
    std::uint32_t first_up = 0, first_down = 0;
    for (std::uint32_t k = 0; first_up == 0 || first_down == 0; ++k) {
      sum.add(normal(run, k), kReference);
      if (first_up == 0 && sum.up > h) first_up = k + 1;
      if (first_down == 0 && sum.down > h) first_down = k + 1;
    }
    up += first_up;
    down += first_down;
  }
  EXPECT_NEAR(up / kRuns, kLength, 0.05 * kLength);
  EXPECT_NEAR(down / kRuns, kLength, 0.05 * kLength);
}

TEST(CusumOfAnomalies, CountsSinceWhenItsSumIsNotZero) {
  Cusum sum;
  for (const double z : {0.1, -0.2, 0.3}) sum.add(z, 0.5);
  EXPECT_EQ(sum.largest(), 0);
  for (int k = 0; k < 5; ++k) sum.add(2, 0.5);
  EXPECT_EQ(sum.age(), 5);
  EXPECT_NEAR(sum.up, 7.5, 1e-12);
}

TEST(WhiteningOfAnomalies, TakesTheCorrelationOutAndKeepsItsShareOfAShift) {
  constexpr double kRho = 0.7, kShift = 0.8;
  constexpr std::uint32_t kCount = 40000;
  std::vector<double> x(kCount), w(kCount), shifted(kCount);
  double before = 0;
  for (std::uint32_t k = 0; k < kCount; ++k) x[k] = before = kRho * before + std::sqrt(1 - kRho * kRho) * normal(1, k);
  EXPECT_NEAR(correlation(x), kRho, 0.02);
  const Whitening white = whitening(correlation(x), correlation(x), kCount);
  double mean = 0;
  for (std::uint32_t k = 1; k < kCount; ++k) {
    w[k] = white(x[k], x[k - 1]);
    mean += white(x[k] + kShift, x[k - 1] + kShift) / kCount;
  }
  EXPECT_NEAR(correlation(w), 0, 0.02);
  EXPECT_NEAR(mean, kShift * white.gain(), 0.03);
}

TEST(WhiteningOfAnomalies, OfFewValuesIsThatOfAll) {
  EXPECT_NEAR(whitening(0.1, 0.6, 1e-9).rho, 0.9, 1e-9) << "bounded, where the bias would be anything";
  EXPECT_NEAR(whitening(0.1, 0.6, 1e9).rho, 0.1, 1e-6);
  EXPECT_GT(whitening(0.1, 0.6, 20).rho, 0.3);
  EXPECT_EQ(whitening(-0.5, -0.5, 1e9).rho, 0) << "negative correlation is not used";
  EXPECT_EQ(correlation(std::vector<double>{}), 0);
  EXPECT_EQ(correlation(std::vector<double>{0, 0, 0}), 0);
}

TEST(TorqueModelOfAnomalies, HasTheEffectsOfFiniteChanges) {
  for (const char* name : {"ur10e", "lwr4", "planar2"}) {
    const robot::RobotModel robot = robot::load_urdf(places::source() + "/models/robots/" + name + "/robot.urdf");
    const std::size_t n = robot.joints.size();
    const auto with_friction = [&](TorqueModel& model, double factor) {
      for (std::size_t j = 0; j < n; ++j) {
        model.drives.tau_C[j] = factor * 3;
        model.drives.sigma2[j] = factor * 2;
        model.drives.link_A[j] = factor * 1.5;
        model.drives.link_k[j] = -factor * 0.75 + 0.1;
        model.drives.link_alpha[j] = 40;
        model.drives.tau_0[j] = 0.3;
        model.drives.B[j] = 0.2;
      }
      model.update();
    };
    TorqueModel model(robot, true), worn(robot, true);
    with_friction(model, 1);
    with_friction(worn, 1.2);
    robot::RobotModel loaded = robot;
    robot::Attachment load;
    load.name = "load";
    load.parent = robot.end_effector().name;
    load.inertia.mass = 1;
    robot::attach(loaded, load);
    TorqueModel heavier(loaded, true);
    with_friction(heavier, 1);

    std::vector<double> q(n), dq(n), ddq(n);
    for (std::size_t j = 0; j < n; ++j) {
      const double x = static_cast<double>(j);
      q[j] = std::sin(3 * x + 1), dq[j] = std::cos(5 * x), ddq[j] = 2 * std::sin(7 * x);
    }
    for (TorqueModel* m : {&model, &worn, &heavier}) m->evaluate(q.data(), dq.data(), ddq.data());
    const auto size = static_cast<Eigen::Index>(n);
    EXPECT_LT((heavier.tau() - model.tau() - model.effects().col(0)).norm(), 1e-9 * model.tau().norm()) << name;
    const Eigen::VectorXd share = 0.2 * model.effects().middleCols(1, size).diagonal();
    EXPECT_LT((worn.tau() - model.tau() - share).norm(), 1e-9 * model.tau().norm()) << name;
    EXPECT_TRUE(model.effects().middleCols(1 + size, size).isIdentity(0));
    const Eigen::MatrixXd encoder = model.effects().rightCols(size);
    const Eigen::VectorXd tau = model.tau();
    for (std::size_t j = 0; j < n; ++j) {
      constexpr double kStep = 1e-6;
      q[j] += kStep;
      model.evaluate(q.data(), dq.data(), ddq.data());
      q[j] -= kStep;
      EXPECT_LT(((model.tau() - tau) / kStep - encoder.col(static_cast<Eigen::Index>(j))).norm(), 1e-3 * (1 + tau.norm()))
          << name << ' ' << j;
    }
    EXPECT_EQ(model.cause(0), Cause::kLoad);
    EXPECT_EQ(model.cause(static_cast<int>(3 * n)), Cause::kEncoder);
    EXPECT_EQ(model.joint(static_cast<int>(2 * n)), static_cast<int>(n) - 1);
  }
}

}  // namespace
}  // namespace cotwin::anomaly_cusum_test
