#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "models/collision/contact/detector.h"
#include "tests/benchmarks/contact/cases.h"
#include "tests/benchmarks/contact/run.h"
#include "tests/support/contact_scenes.h"

namespace cotwin::benchmark {
namespace {

constexpr double kStep = 1e-3;                 // s
const double kFrictionAngle = std::atan(0.5);  // rad, of box_on_slope()
constexpr double kGravity = 9.81;              // m/s²
constexpr double kHalfDegree = 0.5 * 3.14159265358979323846 / 180;

std::vector<Figure> pushed_ball(const EngineKind& kind) {
  Run run(kind, testing::pushed_ball(), kStep);
  double velocity = 0;
  for (int k = 1; k <= 2000; ++k) {
    run.step();
    Eigen::Vector3d p_WB;
    const Twist V_WB = testing::pushed_ball_at(k * kStep, p_WB);
    velocity = (run.V_WB[1].head<3>() - V_WB.head<3>()).norm();
  }
  return {{"step", "us", run.median_microseconds(), 0}, {"velocity error when it rolls", "m/s", velocity, 4e-7}};
}

std::vector<Figure> balls(const EngineKind& kind) {
  Run run(kind, testing::balls(666, 2), 2e-3);
  collision::Detector detector(run.scene());
  double deepest = 0;
  for (int k = 0; k < 500; ++k) {
    run.step();
    if (k % 10 != 0) continue;
    detector.detect(run.X_WB, 0);
    for (const contact_world::ContactPoint& point : detector.points()) deepest = std::max(deepest, -point.gap);
  }
  return {{"step", "us", run.mean_microseconds(), 0}, {"deepest penetration", "m", deepest, 1.5e-4}};
}

std::vector<Figure> on_slope(const EngineKind& kind) {
  Run sticks(kind, testing::box_on_slope(kFrictionAngle - kHalfDegree), kStep);
  for (int k = 0; k < 1000; ++k) sticks.step();
  const Eigen::Vector3d there = sticks.X_WB[1].p;
  for (int k = 0; k < 2000; ++k) sticks.step();
  const double creep = (sticks.X_WB[1].p - there).norm() / 2;

  const double angle = kFrictionAngle + kHalfDegree;
  Run slips(kind, testing::box_on_slope(angle), kStep);
  const Eigen::Vector3d start = slips.X_WB[1].p;
  for (int k = 0; k < 2000; ++k) slips.step();
  const double expected = 0.5 * kGravity * (std::sin(angle) - 0.5 * std::cos(angle)) * 4;
  const double error = std::abs((slips.X_WB[1].p - start).norm() / expected - 1);
  return {{"step", "us", sticks.median_microseconds(), 0},
          {"creep half a degree below the friction angle", "um/s", 1e6 * creep, 1},
          {"error of the way half a degree above", "1", error, 0}};
}

std::vector<Figure> held_box(const EngineKind& kind) {
  Run run(kind, testing::held_box(), kStep);
  Eigen::Vector3d there = Eigen::Vector3d::Zero();
  for (int k = 0; k < 5000; ++k) {
    run.engine().apply(2, (Wrench() << -50, 0, 0, 0, 0, 0).finished());
    run.step();
    if (k == 999) there = run.X_WB[1].p;
  }
  return {{"step", "us", run.median_microseconds(), 0}, {"creep", "um/s", 1e6 * (run.X_WB[1].p - there).norm() / 4, 1}};
}

std::vector<Figure> floating_arm(const EngineKind& kind) {
  const std::array<double, 7> q{0.3, -0.9, 0.4, 1.2, -0.5, 0.8, 0.2}, dq{0.5, -0.4, 0.6, 0.5, -0.7, 0.4, 0.6};
  Run run(kind, testing::floating_arm(q, dq), kStep);
  const double energy = testing::energy(run.scene(), run.X_WB, run.V_WB);
  const Wrench momentum = testing::momentum(run.scene(), run.X_WB, run.V_WB);
  for (int k = 0; k < 10000; ++k) run.step();
  const double lost = std::abs(testing::energy(run.scene(), run.X_WB, run.V_WB) / energy - 1);
  const Wrench gained = testing::momentum(run.scene(), run.X_WB, run.V_WB) - momentum;
  return {{"step", "us", run.median_microseconds(), 0},
          {"momentum error in 10 s", "1", gained.norm() / momentum.norm(), 1e-12},
          {"energy error in 10 s", "1", lost, 0}};
}

}  // namespace

std::vector<Case> public_cases() {
  return {{"ball pushed obliquely", pushed_ball, 3},
          {"666 balls dropped", balls, 1, true},
          {"box on a slope", on_slope, 1},
          {"box held by friction", held_box, 1},
          {"floating arm", floating_arm, 1}};
}

}  // namespace cotwin::benchmark
