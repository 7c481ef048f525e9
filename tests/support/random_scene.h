#pragma once
#include <cstddef>
#include <cstdint>
#include <random>
#include <span>

#include "components/contact_world/engine/world.h"
#include "models/scene/scene.h"
#include "tests/support/contact_scenes.h"

namespace cotwin::testing {

/// An unusual but valid scene: bodies inside each other, in exact stacks, very thin, with mass ratios up to 1e8, fast, soft or
/// bouncing, joined in chains and loops, some with joints that are pulled apart. Drawn from a seed, or from the bytes of a
/// fuzzer.
class RandomScene {
 public:
  explicit RandomScene(std::uint64_t seed);
  explicit RandomScene(std::span<const std::uint8_t> bytes);

  const scene::Scene& scene() const { return scene_; }
  /// Pushes bodies, drives joints, moves driven bodies; now and then.
  void disturb(contact_world::World& world);

 private:
  void build();
  void add_ground();
  void add_body();
  void add_joint(int parent, int child);
  Pose place();
  scene::Shape shape();
  scene::Material material();

  std::uint64_t next();
  double number(double low, double high);
  double scale(double low, double high);  // logarithmic
  bool one_in(int count) { return next() % static_cast<std::uint64_t>(count) == 0; }
  int index(std::size_t count) { return static_cast<int>(next() % count); }
  Eigen::Vector3d vector(double limit);
  Eigen::Matrix3d rotation();

  std::mt19937_64 engine_;
  std::span<const std::uint8_t> bytes_;
  bool from_bytes_ = false;
  scene::Scene scene_;
};

}  // namespace cotwin::testing
