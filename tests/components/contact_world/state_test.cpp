// Saved states of a world: those that an earlier program wrote are read, and damaged ones are refused and change nothing.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <sstream>

#include "components/contact_world/engine/world.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "tests/support/places.h"
#include "tests/support/random_scene.h"

namespace cotwin::contact_world::state_test {
namespace {

constexpr double kStep = 1e-3;
constexpr std::array kSeeds = {1, 2, 3, 5, 7, 16, 18, 21, 24, 25, 38, 58};

/// Bodies, joints, loops, limits and motors by chance; in every second world surfaces that yield, in every third a latch.
World world(int seed) {
  constexpr Method kMethods[] = {Method::kTree, Method::kDantzig, Method::kPgs};
  Options options;
  options.method = kMethods[seed % 3];
  options.contacts = 4;
  options.dents = 2;
  scene::Scene scene = testing::RandomScene(static_cast<std::uint64_t>(seed)).scene();
  for (scene::Body& body : scene.bodies) {
    for (scene::Shape& shape : body.shapes) {
      if (seed % 2 != 0) continue;
      shape.material.stiffness = scene::kInfinity;
      shape.material.damping = 0;
      shape.material.foundation = 1e7;
      shape.material.yield = 1e5;
    }
  }
  if (seed % 3 == 0 && scene.bodies.size() >= 2) {
    scene::Joint& latch = scene.latches.emplace_back();
    latch.name = "latch";
    latch.type = scene::JointType::kFixed;
    latch.parent = 0;
    latch.child = 1;
  }
  World world(std::move(scene), options);
  if (seed % 3 == 0) {
    LatchLaw law;
    law.reach = 100;
    law.tilt = 4;
    law.time = 0.1;
    world.set_latch(0, law);
  }
  return world;
}

std::string refusal(World& world, const std::vector<double>& state) {
  try {
    world.restore(state);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

/// What is told of the state with each of its numbers replaced by others.
std::string all_refusals(World& world, const std::vector<double>& state) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  std::string all;
  for (std::size_t i = 0; i < state.size(); ++i) {
    for (const double wrong : {std::nan(""), kInfinity, -kInfinity, 1e300, -1.0, 0.5}) {
      std::vector<double> damaged = state;
      damaged[i] = wrong;
      all += refusal(world, damaged) + "\n";
    }
  }
  return all;
}

std::vector<double> poses_and_twists(const World& world) {
  std::vector<double> numbers;
  for (std::size_t b = 0; b < world.poses().size(); ++b) {
    for (const double x : world.poses()[b].p) numbers.push_back(x);
    for (const double x : world.twists()[b]) numbers.push_back(x);
  }
  return numbers;
}

struct Saved {
  std::vector<double> state, later;  // later: poses and twists after another step
  std::uint64_t refusals = 0;        // hash of all_refusals()
};

/// Of each world after 20 steps with disturbances, by the program before states were one list.
std::vector<Saved> saved() {
  std::ifstream file(places::source() + "/tests/components/contact_world/states.txt");
  std::vector<Saved> all;
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    Saved& one = all.emplace_back();
    std::string word;
    for (std::vector<double>* list : {&one.state, &one.later}) {
      std::size_t count = 0;
      words >> count;
      while (count-- > 0 && words >> word) list->push_back(std::strtod(word.c_str(), nullptr));
    }
    words >> one.refusals;
  }
  return all;
}

TEST(WorldState, OfAnEarlierProgramIsRead) {
  const std::vector<Saved> all = saved();
  ASSERT_EQ(all.size(), kSeeds.size());
  for (std::size_t k = 0; k < kSeeds.size(); ++k) {
    const Saved& one = all[k];
    World w = world(kSeeds[k]);
    ASSERT_EQ(w.state_size(), one.state.size()) << kSeeds[k];
    w.step(kStep);
    w.restore(one.state);
    std::vector<double> again;
    w.save(again);
    EXPECT_EQ(again, one.state) << kSeeds[k];
    w.step(kStep);
    const std::vector<double> later = poses_and_twists(w);
    ASSERT_EQ(later.size(), one.later.size());
    for (std::size_t i = 0; i < later.size(); ++i)
      EXPECT_NEAR(later[i], one.later[i], 1e-7 * (1 + std::abs(one.later[i]))) << kSeeds[k] << ", " << i;
  }
}

TEST(WorldState, IsRefusedInTheSameWordsWhereANumberIsDamaged) {
  const std::vector<Saved> all = saved();
  for (std::size_t k = 0; k < kSeeds.size(); ++k) {
    World w = world(kSeeds[k]);
    EXPECT_EQ(hash_of(all_refusals(w, all[k].state)), all[k].refusals) << kSeeds[k];
  }
}

TEST(WorldState, ThatIsRefusedChangesNothing) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (const int seed : kSeeds) {
    World w = world(seed), same = world(seed);
    std::vector<double> early, state, of_same;
    w.save(early);
    for (int k = 0; k < 20; ++k) {
      w.step(kStep);
      same.step(kStep);
    }
    for (std::size_t i = 0; i < early.size(); ++i) {
      std::vector<double> damaged = early;
      damaged[i] = kNan;
      ASSERT_NE(refusal(w, damaged), "");
    }
    w.step(kStep);
    same.step(kStep);
    w.save(state);
    same.save(of_same);
    EXPECT_EQ(state, of_same) << seed;
  }
}

}  // namespace
}  // namespace cotwin::contact_world::state_test
