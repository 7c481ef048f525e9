// Friction-critical statics.

#include <algorithm>
#include <array>
#include <cmath>

#include "tests/benchmarks/contact/cases.h"
#include "tests/benchmarks/contact/run.h"
#include "tests/support/contact_scenes.h"
#include "tests/support/hard_scenes.h"

namespace cotwin::benchmark {
namespace {

constexpr double kStep = 1e-3;                               // s
constexpr double kLean = 15 * 3.14159265358979323846 / 180;  // tan = 0.268

// The farthest that any body moves in `duration`.
std::vector<Figure> stands(const EngineKind& kind, const scene::Scene& scene, double duration) {
  Run run(kind, scene, kStep);
  double moved = 0;
  for (int k = 0; k < std::lround(duration / kStep); ++k) {
    run.step();
    for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
      moved = worst(moved, (run.X_WB[b].p - scene.bodies[b].X_WB.p).norm());
    }
  }
  return {{"step", "us", run.mean_microseconds(), 0}, {"motion", "mm", 1e3 * moved, 0}};
}

std::vector<Figure> ladder(const EngineKind& kind) {
  constexpr double kDuration = 0.6;
  std::vector<Figure> figures = stands(kind, testing::ladder(1.02 * testing::critical_ladder_mu()), 2);
  figures[1].name = "motion at 1.02 of the critical friction";
  const double mu = 0.9 * testing::critical_ladder_mu();
  Run slides(kind, testing::ladder(mu), kStep);
  const Eigen::Vector3d start = slides.X_WB[2].p;
  for (int k = 0; k < std::lround(kDuration / kStep); ++k) slides.step();
  const double expected = testing::ladder_path(mu, kDuration);
  figures.push_back({"error of the way at 0.9 of it", "1", std::abs((slides.X_WB[2].p - start).norm() / expected - 1), 0});
  return figures;
}

std::vector<Figure> masses(const EngineKind& kind, std::span<const double> masses) {
  Run run(kind, testing::stack_of_masses(masses), kStep);
  const Eigen::Vector3d edges = Eigen::Vector3d::Constant(testing::kStackEdge);
  Pose top_of_ground;
  top_of_ground.p.z() = -0.5 * testing::kStackEdge;
  double depth = 0, drift = 0;
  for (int k = 0; k < 3000; ++k) {
    run.step();
    for (std::size_t i = 1; i <= masses.size(); ++i) {
      depth = worst(depth, testing::depth_on_top(run.X_WB[i], i == 1 ? top_of_ground : run.X_WB[i - 1], edges));
      drift = worst(drift, run.X_WB[i].p.head<2>().norm());
    }
  }
  return {{"step", "us", run.mean_microseconds(), 0},
          {"penetration", "mm", 1e3 * depth, 0},
          {"drift in 3 s", "mm", 1e3 * drift, 0}};
}

std::vector<Figure> light_below(const EngineKind& kind) { return masses(kind, std::array{1.0, 1000.0}); }
std::vector<Figure> alternating(const EngineKind& kind) { return masses(kind, std::array{0.1, 100.0, 0.1, 100.0, 0.1}); }

double fallen(const Run& run) {  // bodies of the scene that have turned by more than 45 degrees
  double count = 0;
  for (std::size_t b = 1; b < run.X_WB.size(); ++b) count += run.X_WB[b].R(2, 2) < 0.7 ? 1 : 0;
  return count;
}

// The goal of exact pivoting is three times the time of the default method; it stands in both rows, as pivoting may not end.
std::vector<Figure> dominoes(const EngineKind& kind) {
  constexpr int kCount = 30, kSteps = 2500;
  Run run(kind, testing::dominoes(kCount), kStep);
  double depth = 0;
  for (int k = 0; k < kSteps; ++k) {
    run.step();
    for (std::size_t b = 1; b <= kCount; ++b) {  // of the corners below the ground
      const Eigen::Matrix3d& R = run.X_WB[b].R;
      const double low = run.X_WB[b].p.z() - 0.005 * std::abs(R(2, 0)) - 0.025 * std::abs(R(2, 1)) - 0.05 * std::abs(R(2, 2));
      depth = worst(depth, -low);
    }
  }
  double goal = kind.ours && !kind.exact ? 3 * run.mean_microseconds() : 0;
  if (kind.ours && kind.exact) {
    Run sweeps({"sweeps", make_default, true, false}, testing::dominoes(kCount), kStep);
    for (int k = 0; k < kSteps; ++k) sweeps.step();
    goal = 3 * sweeps.mean_microseconds();
  }
  return {{"step", "us", run.mean_microseconds(), goal},
          {"penetration of the ground", "mm", 1e3 * depth, 0},
          {"still standing after 2.5 s", "1", kCount - fallen(run), 0}};
}

}  // namespace

std::vector<Case> static_cases() {
  return {{"card house, 2 levels", [](const EngineKind& kind) { return stands(kind, testing::card_house(2, kLean, 0.35), 2); }},
          {"card house, 3 levels", [](const EngineKind& kind) { return stands(kind, testing::card_house(3, kLean, 0.35), 2); }},
          {"arch of 9", [](const EngineKind& kind) { return stands(kind, testing::arch(9, 0.5), 3); }},
          {"ladder", ladder},
          {"1 kg below 1000 kg", light_below},
          {"masses 0.1 and 100 kg in turn", alternating},
          {"30 dominoes", dominoes}};
}

}  // namespace cotwin::benchmark
