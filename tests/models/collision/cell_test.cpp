// Which body carries both parts of a pair of a robot with branches: motions are bounded relative to it.
#include "models/collision/cell/cell.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "tests/models/collision/random_shapes.h"

namespace cotwin::collision::cell_test {
namespace {

using Eigen::Vector3d;

/// A torso on the base with two arms of two links, and beside it a mast of two links on the base. Each link has a ball at 0.3 m.
scene::PlacedRobot branched() {
  scene::PlacedRobot robot;
  robot.model.name = "branched";
  robot.model.base.name = "base";
  struct Link {
    const char* name;
    int parent;
    Vector3d p;
  };
  const std::vector<Link> links{{"torso", -1, {0, 0, 0}},   {"left", 0, {0, 0.5, 1}},       {"left_hand", 1, {0.5, 0, 0}},
                                {"right", 0, {0, -0.5, 1}}, {"right_hand", 3, {0.5, 0, 0}}, {"mast", -1, {-1, 0, 0}},
                                {"mast_top", 5, {0, 0, 1}}};
  scene::Shape ball = shape(scene::ShapeType::kSphere, {0.05, 0, 0});
  ball.X_BS.p = {0.3, 0, 0};
  robot.shapes.push_back({ball});
  for (const Link& link : links) {
    robot::Joint joint;
    joint.name = std::string("to_") + link.name;
    joint.parent = link.parent;
    joint.X_PJ.p = link.p;
    joint.axis = Vector3d::UnitZ();
    robot.model.joints.push_back(joint);
    robot.model.bodies.emplace_back().name = link.name;
    robot.shapes.push_back({ball});
  }
  return robot;
}

TEST(Branches, HaveTheBodyThatCarriesBoth) {
  const scene::PlacedRobot robot = branched();
  Cell cell;
  cell.add(robot, false);
  cell.find_pairs({});
  std::map<std::set<std::string>, std::string> carriers;
  for (const Pair& pair : cell.pairs) {
    ASSERT_TRUE(pair.self);
    const std::string carrier = pair.common < 0 ? "base" : robot.model.bodies[static_cast<std::size_t>(pair.common)].name;
    carriers[{cell.parts[pair.a].name, cell.parts[pair.b].name}] = carrier;
  }
  EXPECT_EQ(carriers.size(), 8U * 7 / 2 - 7);  // neighbours are no pairs
  for (const char* left : {"left", "left_hand"}) {
    for (const char* right : {"right", "right_hand"}) EXPECT_EQ((carriers[{left, right}]), "torso") << left << " " << right;
  }
  for (const char* hand : {"left_hand", "right_hand"}) {
    EXPECT_EQ((carriers[{"torso", hand}]), "torso");
    for (const char* other : {"base", "mast", "mast_top"}) EXPECT_EQ((carriers[{hand, other}]), "base") << hand << " " << other;
  }
  EXPECT_EQ((carriers[{"base", "mast_top"}]), "base");
}

TEST(Branches, MoveByNoMoreThanTheirTravels) {
  const scene::PlacedRobot robot = branched();
  Cell cell;
  cell.add(robot, false);
  cell.find_pairs({});
  const std::size_t n = robot.model.joints.size();
  Random random(1);
  const auto link_poses = [&](const std::vector<double>& q) {
    std::vector<Pose> X;
    for (std::size_t i = 0; i < n; ++i) {
      const robot::Joint& joint = robot.model.joints[i];
      const Pose parent = joint.parent < 0 ? Pose{} : X[static_cast<std::size_t>(joint.parent)];
      X.push_back(parent * joint.X_PJ * Pose{Eigen::AngleAxisd(q[i], joint.axis).toRotationMatrix(), Vector3d::Zero()});
    }
    return X;
  };
  double most = 0;
  for (int k = 0; k < 200; ++k) {
    std::vector<double> q(n), after(n), moved(n);
    for (std::size_t i = 0; i < n; ++i) {
      q[i] = random.real(-3, 3);
      moved[i] = random.real(0, 0.5);
      after[i] = q[i] + (random.real(0, 1) < 0.5 ? -1 : 1) * moved[i];
    }
    const auto place_all = [&](const std::vector<double>& at) {
      const std::vector<Pose> X = link_poses(at);
      cell.place(0, {}, X);
      std::vector<double> distances;
      for (const Pair& pair : cell.pairs)
        distances.push_back(cell.distance(pair, cell.parts[pair.a].X_W, cell.parts[pair.b].X_W).d);
      return distances;
    };
    const std::vector<double> before = place_all(q), now = place_all(after);
    for (std::size_t p = 0; p < cell.pairs.size(); ++p) {
      const Pair& pair = cell.pairs[p];
      double reach = 0;
      const double bound = cell.travel(cell.parts[pair.a], pair.common, q, moved, reach) +
                           cell.travel(cell.parts[pair.b], pair.common, q, moved, reach);
      const double change = std::abs(now[p] - before[p]);
      ASSERT_LE(change, bound + 1e-12) << cell.parts[pair.a].name << " and " << cell.parts[pair.b].name;
      if (bound > 0) most = std::max(most, change / bound);
    }
  }
  EXPECT_GT(most, 0.3);
}

}  // namespace
}  // namespace cotwin::collision::cell_test
