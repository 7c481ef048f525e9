// Damaged, contradicting, unequal, huge, tiny and fast scenes.

#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/collision/collision.h"
#include "tests/benchmarks/contact/cases.h"
#include "tests/benchmarks/contact/run.h"
#include "tests/support/contact_scenes.h"
#include "tests/support/foreign_scenes.h"

namespace cotwin::benchmark {
namespace {

constexpr double kStep = 1e-3;  // s

double energy(const Run& run) { return testing::energy(run.scene(), run.X_WB, run.V_WB); }

// Without impacts and friction the energy is constant.
std::vector<Figure> joints(const EngineKind& kind, const scene::Scene& scene, double duration) {
  Run run(kind, scene, kStep);
  const double before = energy(run);
  double gap = 0, error = 0;
  for (int k = 0; k < std::lround(duration / kStep); ++k) {
    run.step();
    gap = worst(gap, testing::joint_gap(run.scene(), run.X_WB));
    error = worst(error, std::abs(energy(run) - before));
  }
  return {{"step", "us", run.mean_microseconds(), 0}, {"joint gap", "mm", 1e3 * gap, 0}, {"energy error", "J", error, 0}};
}

// The gap closes by itself or remains; energy does not grow.
std::vector<Figure> open_triangle(const EngineKind& kind, double gap) {
  Run run(kind, testing::open_triangle(gap), kStep);
  const double before = energy(run);
  double gained = 0;
  for (int k = 0; k < 3000; ++k) {
    run.step();
    gained = worst(gained, energy(run) - before);
  }
  return {{"step", "us", run.mean_microseconds(), 0},
          {"energy gained", "J", gained, 0},
          {"joint gap at the end", "mm", 1e3 * testing::joint_gap(run.scene(), run.X_WB), 0}};
}

// Largest motion of any body, penetration in Cotwin's collision detection, and gain of energy.
std::vector<Figure> at_rest(const EngineKind& kind, const scene::Scene& scene, double duration) {
  Run run(kind, scene, kStep);
  contact_world::Collision collision(run.scene());
  const double before = energy(run);
  double moved = 0, depth = 0, gained = 0;
  for (int k = 0; k < std::lround(duration / kStep); ++k) {
    run.step();
    gained = worst(gained, energy(run) - before);
    for (std::size_t b = 0; b < scene.bodies.size(); ++b) moved = worst(moved, (run.X_WB[b].p - scene.bodies[b].X_WB.p).norm());
    if (k % 50 != 0) continue;
    collision.detect(run.X_WB, 0);
    for (const contact_world::ContactPoint& point : collision.points()) depth = worst(depth, -point.gap);
  }
  return {{"step", "us", run.mean_microseconds(), 0},
          {"motion", "mm", 1e3 * moved, 0},
          {"penetration", "mm", 1e3 * depth, 0},
          {"energy gained", "J", gained, 0}};
}

// What settles somewhere: gain of energy, and depth in the second half.
std::vector<Figure> settles(const EngineKind& kind, const scene::Scene& scene, double duration) {
  Run run(kind, scene, kStep);
  contact_world::Collision collision(run.scene());
  const double before = energy(run);
  double depth = 0, gained = 0;
  const auto steps = std::lround(duration / kStep);
  for (int k = 0; k < steps; ++k) {
    run.step();
    gained = worst(gained, energy(run) - before);
    if (k < steps / 2 || k % 5 != 0) continue;
    collision.detect(run.X_WB, 0);
    for (const contact_world::ContactPoint& point : collision.points()) depth = worst(depth, -point.gap);
  }
  return {{"step", "us", run.mean_microseconds(), 0},
          {"penetration in the second half", "mm", 1e3 * depth, 0},
          {"energy gained", "J", gained, 0}};
}

// Contact springs without damping go on oscillating, so their depth is no error.
std::vector<Figure> soft_stack(const EngineKind& kind, double stiffness) {
  std::vector<Figure> figures = settles(kind, testing::soft_stack(stiffness), 2);
  figures.erase(figures.begin() + 1);
  return figures;
}

// Heights after one fall: the small ball's speed is (3 M − m) / (M + m) v for impacts one after the other.
std::vector<Figure> ball_on_ball(const EngineKind& kind, double ratio) {
  Run run(kind, testing::ball_on_ball(ratio), kStep);
  const double before = energy(run), v = std::sqrt(2 * 9.81);
  double fastest = 0, error = 0;
  for (int k = 0; k < 550; ++k) {
    run.step();
    fastest = worst(fastest, run.V_WB[2].z());
    error = worst(error, std::abs(energy(run) - before));
  }
  return {{"step", "us", run.median_microseconds(), 0},
          {"error of the small ball's speed", "1", std::abs(fastest / ((3 - ratio) / (1 + ratio) * v) - 1), 0},
          {"energy error", "1", error / before, 0}};
}

// Whether they have exchanged their speeds (e = 1).
std::vector<Figure> two_bullets(const EngineKind& kind) {
  Run run(kind, testing::two_bullets(300), kStep);
  for (int k = 0; k < 10; ++k) run.step();
  return {{"step", "us", run.median_microseconds(), 0},
          {"error of the speed after the impact", "1", std::abs(run.V_WB[1].x() / 300 - 1), 0}};
}

// The tip must not be below the plate's front face after it has reached it at 3 ms.
std::vector<Figure> fast_rod(const EngineKind& kind) {
  Run run(kind, testing::fast_rod(), kStep);
  double angle = 0, last = 0;
  for (int k = 0; k < 40; ++k) {
    run.step();
    const double now = std::atan2(-run.X_WB[0].R(2, 0), run.X_WB[0].R(0, 0));
    angle = worst(angle, std::abs(std::remainder(now, 2 * M_PI)));
    last = testing::joint_gap(run.scene(), run.X_WB);
  }
  return {{"step", "us", run.median_microseconds(), 0},
          {"angle beyond the plate", "rad", std::max(0.0, angle - 1.1), 0},
          {"joint gap", "mm", 1e3 * last, 0}};
}

}  // namespace

std::vector<Case> foreign_cases() {
  const auto joined = [](const char* name, scene::Scene scene, double duration) {
    return Case{name, [scene, duration](const EngineKind& kind) { return joints(kind, scene, duration); }};
  };
  const auto rests = [](const char* name, scene::Scene scene, double duration) {
    return Case{name, [scene, duration](const EngineKind& kind) { return at_rest(kind, scene, duration); }};
  };
  const auto falls = [](const char* name, scene::Scene scene, double duration) {
    return Case{name, [scene, duration](const EngineKind& kind) { return settles(kind, scene, duration); }};
  };
  return {joined("slider-crank from the dead centre", testing::slider_crank(10), 3),
          joined("necklace of 20 spherical joints", testing::necklace(20), 2),
          joined("rope of 20 (0.2 kg) with 1 kg", testing::loaded_rope(20, 1), 2),
          joined("rope of 20 (0.2 kg) with 100 kg", testing::loaded_rope(20, 100), 2),
          {"triangle that does not close by 1 mm", [](const EngineKind& kind) { return open_triangle(kind, 1e-3); }},
          {"triangle that does not close by 50 mm", [](const EngineKind& kind) { return open_triangle(kind, 0.05); }},
          rests("stack of 5 cubes of 1 mm", testing::stack_of_edge(5, 1e-3), 1),
          rests("stack of 5 cubes of 50 m", testing::stack_of_edge(5, 50), 2),
          rests("stack of 40 cubes", testing::stack_of_edge(40, 0.1), 2),
          rests("brick wall of 10 rows", testing::brick_wall(10), 1),
          {"soft stack, 1e5 N/m below 10 boxes", [](const EngineKind& kind) { return soft_stack(kind, 1e5); }},
          {"soft stack, 1e8 N/m below 10 boxes", [](const EngineKind& kind) { return soft_stack(kind, 1e8); }},
          rests("ball spins in a groove of ±10 degrees", testing::wedged_ball(0.1745, 0.5), 2),
          {"ball of 10 g on 1 kg, e = 1", [](const EngineKind& kind) { return ball_on_ball(kind, 0.01); }},
          {"ball of 1 kg on 1 kg, e = 1", [](const EngineKind& kind) { return ball_on_ball(kind, 1); }},
          falls("Painleve's rod, friction 2", testing::painleve_rod(2), 1.5),
          falls("boxes at one place and in the ground", testing::coincident_boxes(), 2),
          falls("box at 100 m/s", testing::fast_box(100), 3),
          falls("pyramid on its tip", testing::pyramid_on_tip(), 3),
          falls("10 plates of 0.1 mm", testing::thin_plates(10), 2),
          falls("disc at 200 rad/s", testing::spinning_disc(200), 2),
          {"two bullets of 300 m/s", two_bullets},
          {"rod at 300 rad/s against a plate", fast_rod}};
}

}  // namespace cotwin::benchmark
