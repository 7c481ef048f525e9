// Closed loops, long chains, and several impacts at once.

#include <algorithm>
#include <cmath>
#include <string>

#include "tests/benchmarks/contact/cases.h"
#include "tests/benchmarks/contact/run.h"
#include "tests/support/contact_scenes.h"
#include "tests/support/hard_scenes.h"

namespace cotwin::benchmark {
namespace {

constexpr double kStep = 1e-3;             // s
constexpr double kAngle = 0.5;             // rad above the collinear pose
constexpr double kBase = 1, kCrank = 0.5;  // m

double energy(const Run& run) { return testing::energy(run.scene(), run.X_WB, run.V_WB); }

std::vector<Figure> joints(const EngineKind& kind, const scene::Scene& scene, double h, double duration, int sweeps = 0) {
  Run run(kind, scene, h, sweeps);
  const double before = energy(run);
  double gap = 0, error = 0;
  for (int k = 0; k < std::lround(duration / h); ++k) {
    run.step();
    gap = worst(gap, testing::joint_gap(run.scene(), run.X_WB));
    error = worst(error, std::abs(energy(run) - before));
  }
  return {{"step", "us", run.median_microseconds(), 0}, {"joint gap", "mm", 1e3 * gap, 0}, {"energy error", "J", error, 0}};
}

// The cranks of a parallelogram against the pendulum of the same energy. Beyond the first pass of the collinear pose both the
// parallelogram and its crossed form are solutions; engines that keep the parallelogram are compared.
std::vector<Figure> parallelogram(const EngineKind& kind, double h) {
  std::vector<Figure> figures = joints(kind, testing::parallelogram(kBase, kCrank, kAngle), h, 5);
  Run run(kind, testing::parallelogram(kBase, kCrank, kAngle), h);
  const double duration = 0.3;  // passes the pose once
  for (int k = 0; k < std::lround(duration / h); ++k) run.step();
  const Eigen::Vector3d p = run.X_WB[0].p;
  const double theta = testing::parallelogram_angle(kBase, kCrank, 2, kAngle, duration);
  figures.push_back(
      {"error of the crank's angle at 0.3 s", "rad", std::abs(std::remainder(std::atan2(p.z(), p.x()) - theta, 2 * M_PI)), 0});
  return figures;
}

constexpr double kCradleGap = 0.5e-3;

// The fastest that the last ball becomes after the first impact, relative to the first ball's speed.
std::vector<Figure> cradle(const EngineKind& kind, double gap) {
  constexpr int kBalls = 5;
  Run run(kind, testing::cradle(kBalls, gap), kStep);
  const double before = energy(run);
  double last = 0, others = 0, opening = 0;
  double gained = 0;
  for (int k = 0; k < 500; ++k) {  // the first ball arrives after 0.28 s, the last returns after 0.84 s
    run.step();
    if (run.V_WB[kBalls - 1].head<3>().norm() > last) {
      last = run.V_WB[kBalls - 1].head<3>().norm();
      others = 0;
      for (std::size_t b = 0; b + 1 < kBalls; ++b) others = std::max(others, run.V_WB[b].head<3>().norm());
    }
    opening = worst(opening, testing::joint_gap(run.scene(), run.X_WB));
    gained = worst(gained, std::abs(energy(run) - before));
  }
  const double v = testing::cradle_speed();
  return {{"step", "us", run.median_microseconds(), 0},
          {"missing speed of the last ball", "1", std::abs(1 - last / v), gap > 0 ? 0.05 : 0},
          {"speed left in the others", "1", others / v, 0},
          {"energy error", "mJ", 1e3 * gained, 0},
          {"joint gap", "mm", 1e3 * opening, 0}};
}

std::vector<Figure> row_of_balls(const EngineKind& kind, double gap) {
  constexpr int kBalls = 5;
  Run run(kind, testing::row_of_balls(kBalls, gap), kStep);
  const double before = energy(run);
  for (int k = 0; k < 300; ++k) run.step();
  return {{"step", "us", run.median_microseconds(), 0},
          {"missing speed of the last ball", "1", std::abs(1 - run.V_WB[kBalls + 1].x()), 0},
          {"energy error", "1", std::abs(energy(run) - before) / 0.25, 0}};  // ½ m v²
}

std::vector<Figure> square_break(const EngineKind& kind) {
  Run run(kind, testing::square_break(4), kStep);
  const double before = energy(run);
  const Wrench momentum = testing::momentum(run.scene(), run.X_WB, run.V_WB);
  for (int k = 0; k < 500; ++k) run.step();
  const Wrench gained = testing::momentum(run.scene(), run.X_WB, run.V_WB) - momentum;
  return {{"step", "us", run.mean_microseconds(), 0},
          {"energy error", "1", std::abs(energy(run) - before) / (0.5 * 0.17 * 9), 0},
          {"momentum error", "1", gained.head<2>().norm() / momentum.head<2>().norm(), 0}};
}

}  // namespace

std::vector<Case> loop_cases() {
  std::vector<Case> cases{
      {"parallelogram, 1 ms", [](const EngineKind& kind) { return parallelogram(kind, 1e-3); }},
      {"parallelogram, 0.1 ms", [](const EngineKind& kind) { return parallelogram(kind, 1e-4); }},
      {"double parallelogram",
       [](const EngineKind& kind) { return joints(kind, testing::double_parallelogram(kBase, kCrank, kAngle), kStep, 5); }},
      {"four-bar of equal lengths",
       [](const EngineKind& kind) { return joints(kind, testing::parallelogram(kCrank, kCrank, kAngle), kStep, 5); }},
      {"Bricard", [](const EngineKind& kind) { return joints(kind, testing::bricard(), kStep, 5); }}};
  for (const int sweeps : {20, 50, 200}) {
    cases.push_back({"chain of 20, " + std::to_string(sweeps) + " sweeps",
                     [sweeps](const EngineKind& kind) { return joints(kind, testing::chain(20), kStep, 2, sweeps); }});
  }
  cases.push_back({"cradle in contact", [](const EngineKind& kind) { return cradle(kind, 0); }});
  cases.push_back({"cradle with gaps", [](const EngineKind& kind) { return cradle(kind, kCradleGap); }});
  cases.push_back({"row of balls in contact", [](const EngineKind& kind) { return row_of_balls(kind, 0); }});
  cases.push_back({"row of balls with gaps", [](const EngineKind& kind) { return row_of_balls(kind, kCradleGap); }});
  cases.push_back({"square break of 16", square_break});
  return cases;
}

}  // namespace cotwin::benchmark
