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

constexpr double kStep = 1e-3, kStepOfPiles = 2e-3;  // s
constexpr double kDegrees = 180 / 3.14159265358979323846;
constexpr std::array<double, 7> kStart{0.3, -0.9, 0.4, 1.2, -0.5, 0.8, 0.2};  // rad

double turned(const Run& run) {  // degrees
  double most = 0;
  for (std::size_t i = 0; i < kStart.size(); ++i) {
    most = std::max(most, std::abs(std::remainder(testing::joint_angle(run.scene(), i, run.X_WB) - kStart[i], 2 * M_PI)));
  }
  return most * kDegrees;
}

void hold_by_motors(Run& run) {
  for (std::size_t i = 0; i < kStart.size(); ++i) run.engine().set_motor(i, 0, 1000);
}

std::vector<Figure> held_by_motors(const EngineKind& kind) {
  Run run(kind, testing::arm(kStart), kStep);
  hold_by_motors(run);
  for (int k = 0; k < 5000; ++k) run.step();
  return {{"step", "us", run.median_microseconds(), 8}, {"creep in 5 s", "deg", turned(run), 1e-3}};
}

// (2a) at rest: the holding torques are known exactly, so all motion is an error of the engine. The pose is an unstable
// equilibrium.
std::vector<Figure> held_by_torques(const EngineKind& kind) {
  std::array<double, 7> tau{};
  testing::gravity_torques(kStart, tau);
  Run run(kind, testing::arm(kStart), kStep);
  double creep = 0;
  for (int k = 0; k < 5000; ++k) {
    for (std::size_t i = 0; i < tau.size(); ++i) run.engine().set_tau(i, tau[i]);
    run.step();
    if (k == 999) creep = turned(run);
  }
  return {{"step", "us", run.median_microseconds(), 8}, {"creep in 1 s", "deg", creep, 1e-3}};
}

std::vector<Figure> swinging(const EngineKind& kind) {
  Run run(kind, testing::arm(kStart), kStep);
  const double before = testing::energy(run.scene(), run.X_WB, run.V_WB);
  double gap = 0, error = 0;
  for (int k = 0; k < 5000; ++k) {
    run.step();
    gap = std::max(gap, testing::joint_gap(run.scene(), run.X_WB));
    error = std::max(error, std::abs(testing::energy(run.scene(), run.X_WB, run.V_WB) - before));
  }
  return {
      {"step", "us", run.median_microseconds(), 9}, {"joint gap", "mm", 1e3 * gap, 0.01}, {"energy error", "J", error, 0.1}};
}

std::vector<Figure> stack(const EngineKind& kind) {
  constexpr int kBoxes = 10;
  Run run(kind, testing::stack(kBoxes), kStep);
  const Eigen::Vector3d edges = Eigen::Vector3d::Constant(testing::kStackEdge);
  Pose top_of_ground;  // as a box whose top face is the ground
  top_of_ground.p.z() = -0.5 * testing::kStackEdge;
  double depth = 0, drift = 0;
  for (int k = 0; k < 5000; ++k) {
    run.step();
    for (std::size_t i = 1; i <= kBoxes; ++i) {
      depth = std::max(depth, testing::depth_on_top(run.X_WB[i], i == 1 ? top_of_ground : run.X_WB[i - 1], edges));
      drift = std::max(drift, run.X_WB[i].p.head<2>().norm());
    }
  }
  return {{"step", "us", run.median_microseconds(), 30},
          {"penetration", "mm", 1e3 * depth, 0.02},
          {"drift in 5 s", "mm", 1e3 * drift, 0.1}};
}

// The peg is pushed down and sideways and tilted until it touches both walls. It slides to the floor and comes to rest.
std::vector<Figure> slot(const EngineKind& kind) {
  constexpr double kClearance = 0.5e-3;
  Run run(kind, testing::slot(kClearance), kStep);
  const Wrench push = (Wrench() << 3, 0, -4, 0, 0.05, 0).finished();
  const double half_gap = 0.5 * (testing::kPegWidth + kClearance);
  double depth = 0, jitter = 0;
  for (int k = 0; k < 3000; ++k) {
    run.engine().apply(3, push);
    run.step();
    const Pose& X_WB = run.X_WB[3];
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector3d edges(testing::kPegWidth, testing::kPegWidth, testing::kPegLength);
      const Eigen::Vector3d signs(corner & 1 ? 0.5 : -0.5, corner & 2 ? 0.5 : -0.5, corner & 4 ? 0.5 : -0.5);
      const Eigen::Vector3d p = X_WB * Eigen::Vector3d(signs.cwiseProduct(edges));
      if (p.z() < testing::kPegLength) depth = std::max(depth, std::abs(p.x()) - half_gap);
      if (k < 2000) continue;
      jitter = std::max(jitter, (run.V_WB[3].head<3>() + run.V_WB[3].tail<3>().cross(p - X_WB.p)).norm());
    }
  }
  return {{"step", "us", run.median_microseconds(), 7},
          {"wall penetration", "mm", 1e3 * depth, 0.02},
          {"jitter at rest", "mm/s", 1e3 * jitter, 0.01}};
}

// The depths at the end, measured with Cotwin's collision detection for every engine.
std::vector<Figure> pile_of_1000(const EngineKind& kind) {
  Run run(kind, testing::pile(1000, 1), kStepOfPiles);
  for (int k = 0; k < 600; ++k) run.step();
  collision::Detector detector(run.scene());
  detector.detect(run.X_WB, 0);
  double deepest = 0;
  for (const contact_world::ContactPoint& point : detector.points()) deepest = std::max(deepest, -point.gap);
  return {{"step", "us", run.mean_microseconds(), 5000}, {"penetration at the end", "mm", 1e3 * deepest, 0}};
}

// Cubes are dropped in four layers into a square pen whose width grows with their number, so that the pile is similar for any
// number.
scene::Scene pen(int across) {
  constexpr int kLayers = 4;
  constexpr double kPitch = 0.19, kWall = 0.1, kHeight = 1;
  scene::Scene scene = testing::pile(kLayers * across * across, 1);
  for (int k = 0; k < kLayers * across * across; ++k) {
    const int layer = k / (across * across), row = k / across % across, column = k % across;
    scene.bodies[static_cast<std::size_t>(k) + 1].X_WB.p << kPitch * column, kPitch * row, kPitch * (layer + 0.6);
  }
  const double width = kPitch * across, middle = 0.5 * (width - kPitch), offset = 0.5 * (width + kWall);
  const auto first = static_cast<int>(scene.bodies.size());
  for (const int axis : {0, 1}) {
    for (const int side : {-1, 1}) {
      Eigen::Vector3d edges(width + 2 * kWall, width + 2 * kWall, kHeight), p_WB(middle, middle, 0.5 * kHeight);
      edges[axis] = kWall;
      p_WB[axis] += side * offset;
      scene.bodies.push_back(testing::box("wall", edges, 1, p_WB, 0.5));
      scene.bodies.back().motion = scene::Motion::kStatic;
    }
  }
  for (int a = first; a < first + 4; ++a) {
    scene.no_contact.emplace_back(0, a);
    for (int b = a + 1; b < first + 4; ++b) scene.no_contact.emplace_back(a, b);
  }
  return scene;
}

// The time per box and step after all boxes have come to rest.
std::vector<Figure> growing_pens(const EngineKind& kind) {
  constexpr int kSettled = 400, kMeasured = 200;
  double per_box[2] = {0, 0}, step = 0;  // us
  for (const int i : {0, 1}) {
    const int across = i == 0 ? 5 : 16, boxes = 4 * across * across;
    Run run(kind, pen(across), kStepOfPiles);
    for (int k = 0; k < kSettled + kMeasured; ++k) run.step();
    step = run.mean_microseconds(kSettled);
    per_box[i] = step / boxes;
  }
  return {{"step of 1024", "us", step, 0}, {"step per box of 1024, against that of 100", "1", per_box[1] / per_box[0], 0}};
}

}  // namespace

std::vector<Case> scene_cases() {
  return {{"arm held by motors", held_by_motors, 5},
          {"arm held by gravity torques", held_by_torques, 5},
          {"arm swings", swinging, 5},
          {"stack of 10", stack, 3},
          {"peg in a slot", slot, 5},
          {"1000 boxes dropped", pile_of_1000, 1, true},
          {"boxes at rest in growing pens", growing_pens, 1, true}};
}

}  // namespace cotwin::benchmark
