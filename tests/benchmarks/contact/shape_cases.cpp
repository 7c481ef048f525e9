// Round shapes, fast bodies, overlap and soft contacts.

#include <algorithm>
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

double deepest(contact_world::Collision& collision, const Run& run) {
  double depth = 0;
  collision.detect(run.X_WB, 0);
  for (const contact_world::ContactPoint& point : collision.points()) depth = worst(depth, -point.gap);
  return depth;
}

// Measured with Cotwin's collision detection for every engine.
std::vector<Figure> mixed_pile(const EngineKind& kind) {
  constexpr int kBodies = 96, kSteps = 1500;
  Run run(kind, testing::mixed_pile(kBodies, 3), 2e-3);
  contact_world::Collision collision(run.scene());
  double falling = 0, resting = 0;
  for (int k = 0; k < kSteps; ++k) {
    run.step();
    if (k % 5 == 0 || k + 1 == kSteps) falling = worst(falling, deepest(collision, run));
    if (k >= kSteps - 250 && k % 5 == 0) resting = worst(resting, deepest(collision, run));
  }
  double outside = 0;
  for (std::size_t b = 5; b < run.X_WB.size(); ++b) {
    const Eigen::Vector3d& p = run.X_WB[b].p;
    outside += std::isfinite(p.sum()) && std::abs(p.x()) < 0.35 && std::abs(p.y()) < 0.35 && p.z() > -0.01 ? 0 : 1;
  }
  return {{"step", "us", run.mean_microseconds(), 0},
          {"penetration while falling", "mm", 1e3 * falling, 1},
          {"penetration at rest", "mm", 1e3 * resting, 1},
          {"bodies that left the bin", "1", outside, 0}};
}

// The distance that the bullet is behind the wall's front face at the end.
std::vector<Figure> bullet(const EngineKind& kind) {
  Run run(kind, testing::bullet(300, 0.005), kStep);
  for (int k = 0; k < 20; ++k) run.step();
  return {{"step", "us", run.median_microseconds(), 0}, {"behind the wall", "m", std::max(0.0, run.X_WB[1].p.x()), 0}};
}

std::vector<Figure> overlap(const EngineKind& kind) {
  Run run(kind, testing::overlapping_boxes(0.01), kStep);
  double gained = 0;
  for (int k = 0; k < 1000; ++k) {
    run.step();
    gained = worst(gained, energy(run));
  }
  const double left = 0.1 - std::abs(run.X_WB[1].p.x() - run.X_WB[0].p.x());
  return {{"step", "us", run.median_microseconds(), 0},
          {"energy gained", "mJ", 1e3 * gained, 0},
          {"energy at the end", "mJ", 1e3 * energy(run), 0},
          {"overlap after 1 s", "mm", 1e3 * std::max(0.0, left), 0}};
}

// The first bounce: speed after it, and the largest force as a mean over a step, from the change of speed. The mean over 1 ms of
// the exact solution reaches 0.996, 0.96 and 0.63 of the peak for 1e4, 1e6 and 1e7 N/m.
std::vector<Figure> soft_ball(const EngineKind& kind, double stiffness) {
  Run run(kind, testing::soft_ball(stiffness), kStep);
  double force = 0, v = 0, rebound = 0, depth = 0;
  for (int k = 0; k < 200; ++k) {  // the ball returns to its height after 0.2 s and the contact's duration
    run.step();
    force = worst(force, (run.V_WB[1].z() - v) / kStep + 9.81);
    v = run.V_WB[1].z();
    rebound = worst(rebound, v);
    depth = worst(depth, testing::kSoftBallRadius - run.X_WB[1].p.z());
  }
  const double peak = testing::soft_ball_peak(stiffness);
  return {{"step", "us", run.median_microseconds(), 0},
          {"error of the restitution 1", "1", std::abs(1 - rebound / testing::kSoftBallSpeed), 0},
          {"error of the peak force", "1", std::abs(force / peak - 1), 0},
          {"error of the depth", "1", std::abs(depth / (peak / stiffness) - 1), 0}};
}

}  // namespace

std::vector<Case> shape_cases() {
  return {{"mixed pile of 96", mixed_pile, 1, true},
          {"bullet of 300 m/s", bullet},
          {"boxes that overlap by 10 mm", overlap},
          {"soft ball, 1e4 N/m", [](const EngineKind& kind) { return soft_ball(kind, 1e4); }},
          {"soft ball, 1e6 N/m", [](const EngineKind& kind) { return soft_ball(kind, 1e6); }},
          {"soft ball, 1e7 N/m", [](const EngineKind& kind) { return soft_ball(kind, 1e7); }}};
}

}  // namespace cotwin::benchmark
