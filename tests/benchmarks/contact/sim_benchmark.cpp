// The scenes of SimBenchmark, with its measures of error.

#include <algorithm>
#include <array>
#include <cmath>

#include "components/contact_world/engine/collision/collision.h"
#include "tests/benchmarks/contact/cases.h"
#include "tests/benchmarks/contact/run.h"
#include "tests/support/contact_scenes.h"
#include "tests/support/hard_scenes.h"

namespace cotwin::benchmark {
namespace {

constexpr double kStep = 1e-3;  // s

double energy(const Run& run) { return testing::energy(run.scene(), run.X_WB, run.V_WB); }

// The mean squared error of the velocities of board and first ball over 4 s.
std::vector<Figure> rolling(const EngineKind& kind, const Eigen::Vector3d& direction) {
  constexpr int kSteps = 4000;
  Run run(kind, testing::rolling(), kStep);
  double sum = 0;
  for (int k = 1; k <= kSteps; ++k) {
    Wrench force = Wrench::Zero();
    force.head<3>() = testing::kRollingForce * direction;
    run.engine().apply(1, force);
    run.step();
    const Eigen::Vector3d board = testing::rolling_board_acceleration() * k * kStep * direction;
    const Eigen::Vector3d ball = testing::rolling_ball_acceleration() * k * kStep * direction;
    sum += (run.V_WB[1].head<3>() - board).squaredNorm() + (run.V_WB[2].head<3>() - ball).squaredNorm();
  }
  return {{"step", "us", run.mean_microseconds(), 0}, {"mean squared velocity error", "m2/s2", sum / kSteps, 0}};
}

std::vector<Figure> rolling_along(const EngineKind& kind) { return rolling(kind, Eigen::Vector3d::UnitY()); }
std::vector<Figure> rolling_across(const EngineKind& kind) { return rolling(kind, Eigen::Vector3d(1, 1, 0).normalized()); }

// The height of the first bounces: after n bounces e^(2n) of the fall is left. e = 1: the mean squared energy error over 10 s.
std::vector<Figure> bouncing(const EngineKind& kind) {
  constexpr int kSteps = 10000;
  Run run(kind, testing::falling_ball(1), kStep);
  const double before = energy(run);
  double sum = 0;
  for (int k = 0; k < kSteps; ++k) {
    run.step();
    sum += std::pow(energy(run) - before, 2);
  }
  return {{"step", "us", run.median_microseconds(), 0}, {"mean squared energy error", "J2", sum / kSteps, 0}};
}

std::vector<Figure> bouncing_half(const EngineKind& kind) {
  constexpr double e = 0.8, g = 9.8, kFall = 9.5;
  Run run(kind, testing::falling_ball(e), kStep);
  const double lands = std::sqrt(2 * kFall / g), again = 2 * e * lands;  // s, of the first impact and until the second
  double top = 0;
  for (int k = 0; k < std::lround((lands + again) / kStep) - 20; ++k) {
    run.step();
    if (k * kStep > lands + 0.1) top = std::max(top, run.X_WB[1].p.z() - 0.5);
  }
  return {{"step", "us", run.median_microseconds(), 0},
          {"error of the second height", "1", std::abs(top / (e * e * kFall) - 1), 0}};
}

std::vector<Figure> elastic_balls(const EngineKind& kind) {
  constexpr int kSteps = 4000;
  Run run(kind, testing::cube_of_balls(1, 0), kStep);
  const double before = energy(run);
  double error = 0;
  for (int k = 0; k < kSteps; ++k) {
    run.step();
    error = worst(error, std::abs(energy(run) - before));
  }
  return {{"step", "us", run.mean_microseconds(), 0}, {"energy error", "1", error / before, 0}};
}

std::vector<Figure> inelastic_balls(const EngineKind& kind) {
  constexpr int kSteps = 3000;
  Run run(kind, testing::cube_of_balls(0, 0.5), kStep);
  contact_world::Collision collision(run.scene());
  double depth = 0;
  for (int k = 0; k < kSteps; ++k) {
    run.step();
    if (k % 10 != 0) continue;
    collision.detect(run.X_WB, 0);
    for (const contact_world::ContactPoint& point : collision.points()) depth = worst(depth, -point.gap);
  }
  return {{"step", "us", run.mean_microseconds(), 0}, {"penetration", "mm", 1e3 * depth, 0}};
}

// A quadruped that holds its posture by PD control, as ANYmal does there, with the torques held over a step.
std::vector<Figure> quadruped(const EngineKind& kind) {
  constexpr int kSteps = 3000, kJoints = 12;
  const scene::Scene scene = testing::quadruped();
  Run run(kind, scene, kStep);
  std::array<double, kJoints> q{};
  double gap = 0, sway = 0, depth = 0;
  for (int k = 0; k < kSteps; ++k) {
    for (std::size_t j = 0; j < kJoints; ++j) {
      const double now = testing::joint_angle(scene, j, run.X_WB);
      const double dq = k > 0 ? std::remainder(now - q[j], 2 * M_PI) / kStep : 0;
      q[j] = now;
      run.engine().set_tau(j, -testing::kQuadrupedKp * now - testing::kQuadrupedKd * dq);
    }
    run.step();
    gap = worst(gap, testing::joint_gap(scene, run.X_WB));
    for (std::size_t b = 4; b < scene.bodies.size(); b += 3) {
      const scene::Shape& foot = scene.bodies[b].shapes[0];
      depth = worst(depth, foot.size.x() - (run.X_WB[b] * foot.X_BS.p).z());
    }
    if (k >= kSteps - 500) sway = worst(sway, run.V_WB[1].norm());
  }
  return {{"step", "us", run.median_microseconds(), 0},
          {"joint gap", "mm", 1e3 * gap, 0},
          {"penetration of the feet", "mm", 1e3 * depth, 0},
          {"motion at rest", "mm/s, mrad/s", 1e3 * sway, 0}};
}

}  // namespace

std::vector<Case> sim_benchmark() {
  return {{"SimBenchmark rolling, along y", rolling_along},
          {"SimBenchmark rolling, diagonal", rolling_across},
          {"SimBenchmark bouncing, e = 1", bouncing},
          {"SimBenchmark bouncing, e = 0.8", bouncing_half},
          {"SimBenchmark 666 (6 x 6 x 6) balls, elastic", elastic_balls, 1, true},
          {"SimBenchmark 666 (6 x 6 x 6) balls, inelastic", inelastic_balls, 1, true},
          {"SimBenchmark quadruped, 12 joints", quadruped}};
}

}  // namespace cotwin::benchmark
