// Distances of robots that move, in closed form, against forward kinematics with all pairs of shapes, and against finely divided motions.
#include "components/monitor/monitor.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "models/robot/frame_kinematics.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/components/monitor/slides.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/unit_subject.h"

namespace cotwin::monitor::monitor_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::error_of;
using cotwin::testing::TemporaryFolder;
using cotwin::testing::UnitSubject;
using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST_F(Slides, HaveTheDistanceOfTheBallFromThePlate) {
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@plate.sdf&ignore=hand:plate");
  unit.set("q", std::vector<double>{1, 0, 0}).set("dq", std::vector<double>{0.5, 9, 0});
  unit.initialise();
  EXPECT_NEAR(unit.real("distance"), 3 - 0.0005 - 1 - 0.1, 1e-12);
  EXPECT_NEAR(unit.real("least_distance"), unit.real("distance"), 0);
  EXPECT_NEAR(unit.real("distance_rate"), -0.5, 1e-12);
  EXPECT_NEAR(unit.real("time_to_contact"), 1.8995 / 0.5, 1e-12);
  EXPECT_LT((unit.vector("p_a") - Vector3d(1.1, 0, 0)).norm(), 1e-12);
  EXPECT_LT((unit.vector("p_b") - Vector3d(2.9995, 0, 0)).norm(), 1e-12);
  EXPECT_LT((unit.vector("normal") - Vector3d::UnitX()).norm(), 1e-12);
  EXPECT_EQ(unit.integer("points_known"), 1);
  EXPECT_EQ(unit.integer("pair", 0), 3);  // plate, rail, ball
  EXPECT_EQ(unit.integer("pair", 1), 1);
  EXPECT_NEAR(unit.real("self_distance"), 0.4 - 0.15, 1e-12);  // ball and hand are no neighbours
  unit.set("r", std::vector{0.25}).set("dq", std::vector<double>{-0.5, 0, 0});
  unit.step(1e-3);
  EXPECT_NEAR(unit.real("distance"), 1.6495, 1e-12);
  EXPECT_LT((unit.vector("p_a") - Vector3d(1.35, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(unit.real("time_to_contact"), 1e12);
  EXPECT_NEAR(unit.real("self_distance"), 0.25, 1e-12);
  unit.set("r", std::vector{0.0}).set("q", std::vector<double>{2.95, 0, 0});
  unit.step(1e-3);
  EXPECT_NEAR(unit.real("distance"), -0.0505, 1e-12);
  EXPECT_EQ(unit.real("time_to_contact"), 0);
}

TEST_F(Slides, PassNoThinPlateBetweenTwoInstants) {
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@plate.sdf&ignore=hand:plate");
  for (const double way : {4.0, 1.0, 0.3, 0.21}) {
    unit.set("q", std::vector<double>{3 - way / 2, 0, 0});
    unit.initialise();
    unit.set("q", std::vector<double>{3 + way / 2, 0, 0});
    unit.step(1e-3);
    EXPECT_GT(unit.real("distance"), 0);
    EXPECT_LT(unit.real("least_distance"), 0) << way;
    EXPECT_NEAR(unit.real("least_distance"), -0.1005, 0.05 * way + 1e-6) << way;
  }
  // Nearly touching, and turning away before.
  unit.set("q", std::vector<double>{0, 0, 0});
  unit.initialise();
  unit.set("q", std::vector<double>{3 - 0.0005 - 0.1 - 1e-9, 0, 0});
  unit.step(1e-3);
  EXPECT_GT(unit.real("least_distance"), 0);
}

// An L of triangles, whose lower bar is 4 m along x and 1 m along y.
TEST_F(Slides, KnowNoPointsWithinAClosedMesh) {
  std::string obj;
  for (const char* z : {"-1", "1"}) {
    for (const char* xy : {"0 0", "4 0", "4 1", "1 1", "1 4", "0 4"}) obj += std::string("v ") + xy + " " + z + "\n";
  }
  obj += "f 4 2 1\nf 4 3 2\nf 4 1 6\nf 5 4 6\nf 7 8 10\nf 8 9 10\nf 12 7 10\nf 12 10 11\n";
  for (int k = 1; k <= 6; ++k) {
    const std::string from = std::to_string(k), to = std::to_string(k % 6 + 1);
    const std::string above = std::to_string(k + 6), above_to = std::to_string(k % 6 + 7);
    obj += "f " + from + " " + to + " " + above_to + "\nf " + from + " " + above_to + " " + above + "\n";
  }
  folder_.write("bar.obj", obj);
  folder_.write("bar.sdf",
                "<sdf version=\"1.11\"><world name=\"w\"><model name=\"bar\"><static>true</static><pose>-1 -0.5 0 0 0 0</pose>"
                "<link name=\"l\"><collision name=\"c\"><geometry><mesh><uri>bar.obj</uri></mesh></geometry></collision></link>"
                "</model></world></sdf>");
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@bar.sdf&ignore=hand:bar");
  unit.set("q", std::vector<double>{3.4, 0, 0});
  unit.initialise();
  EXPECT_NEAR(unit.real("distance"), 0.3, 1e-12);
  EXPECT_EQ(unit.integer("points_known"), 1);
  for (const double q : {2.95, 1.0}) {
    unit.set("q", std::vector<double>{q, 0, 0});
    unit.step(1e-3);
    EXPECT_LT(unit.real("distance"), 0) << q;
    EXPECT_EQ(unit.integer("points_known"), 0) << q;
  }
  EXPECT_NEAR(unit.real("distance"), -0.6, 1e-12);
}

// The ball passes an obstacle beside its way, which moves itself.
TEST_F(Slides, HaveTheLeastDistanceOnTheirWay) {
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@ball.sdf&ignore=hand:obstacle");
  unit.set("q", std::vector<double>{0, 0, 0}).set("obstacle.p", std::vector<double>{2, 0.5, 0});
  unit.initialise();
  EXPECT_NEAR(unit.real("distance"), std::hypot(2, 0.5) - 0.3, 1e-12);
  unit.set("q", std::vector<double>{3, 0, 0})
      .set("obstacle.p", std::vector<double>{1, 0.5, 0.3})
      .set("dq", std::vector<double>{2, 0, 0})
      .set("obstacle.v", std::vector<double>{-1, 0, 0});
  unit.step(1e-3);
  const double least = std::hypot(0.5, 0.15) - 0.3;  // half way, at x = 1.5 both
  EXPECT_LE(unit.real("least_distance"), least + 0.05 * (3 + std::hypot(1, 0.3)));
  EXPECT_GE(unit.real("least_distance"), least - 1e-3);
  const double d = Vector3d(2, 0.5, 0.3).norm();
  EXPECT_NEAR(unit.real("distance_rate"), 2 / d * 3, 1e-12);  // moving apart along x at 3 m/s
  EXPECT_NEAR(unit.real("distance"), d - 0.3, 1e-12);
}

TEST_F(Slides, OfTwoRobotsHaveTheSameDistanceSeenFromBothSides) {
  UnitSubject unit = monitor("robots=a:@slide.urdf,b:@slide.urdf&ignore=a/hand:b/hand,a/hand:b/ball,a/ball:b/hand");
  unit.set("b.base_p0", std::vector<double>{0, 1, 0})
      .set("a.q", std::vector<double>{0, 0, 0})
      .set("b.q", std::vector<double>{1, 0, 0})
      .set("b.dq", std::vector<double>{1, 0, 0})
      .set("r", std::vector{0.01});
  unit.initialise();
  const double d = std::sqrt(2) - 0.2 - 0.02;
  for (const char* prefix : {"", "a.", "b."}) {
    const std::string x = prefix;
    EXPECT_NEAR(unit.real(x + "distance"), d, 1e-12);
    EXPECT_NEAR(unit.real(x + "distance_rate"), std::sqrt(0.5), 1e-12);
    EXPECT_LT((unit.vector(x + "p_a") + d * unit.vector(x + "normal") - unit.vector(x + "p_b")).norm(), 1e-12);
  }
  EXPECT_LT((unit.vector("a.normal") + unit.vector("b.normal")).norm(), 1e-12);
  EXPECT_LT((unit.vector("a.p_a") - Vector3d(0.11 * std::sqrt(0.5), 0.11 * std::sqrt(0.5), 0)).norm(), 1e-12);
  EXPECT_EQ(unit.integer("a.pair", 0), unit.integer("b.pair", 1));
}

TEST_F(Slides, WithoutAnybodyAroundHaveNoDistance) {
  UnitSubject unit = monitor("robot=@slide.urdf");
  unit.initialise();
  unit.step(1e-3);
  for (const char* name : {"distance", "least_distance", "time_to_contact"}) EXPECT_EQ(unit.real(name), 1e12);
  EXPECT_THAT(unit.vector("p_b"), Vector3d::Zero());
  EXPECT_EQ(unit.integer("pair"), 0);
  EXPECT_NEAR(unit.real("self_distance"), 0.25, 1e-12);
}

std::vector<std::string> notes_of(UnitSubject& unit) {
  std::vector<std::string> notes;
  unit.unit().append_notes(notes);
  return notes;
}

/// Points of the plane x = 3, of 0.05 m spacing.
std::string wall() {
  std::string points = "x,y,z\n";
  for (int i = -20; i <= 20; ++i)
    for (int k = -20; k <= 20; ++k) points += "3," + std::to_string(0.05 * i) + "," + std::to_string(0.05 * k) + "\n";
  return points;
}

TEST_F(Slides, HaveTheDistanceOfAPointCloud) {
  folder_.write("my wall, left.csv", wall());
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@ball.sdf&ignore=hand:cloud,hand:obstacle&cloud=@my wall, left.csv");
  unit.set("q", std::vector<double>{1, 0, 0})
      .set("dq", std::vector<double>{0.5, 0, 0})
      .set("obstacle.p", std::vector<double>{0, 9, 0});
  unit.initialise();
  EXPECT_NEAR(unit.real("cloud.r"), 0.025, 1e-4);  // half of the spacing
  EXPECT_NEAR(unit.real("distance"), 2 - 0.1 - unit.real("cloud.r"), 1e-6);
  EXPECT_NEAR(unit.real("time_to_contact"), unit.real("distance") / 0.5, 1e-6);
  EXPECT_LT((unit.vector("normal") - Vector3d::UnitX()).norm(), 1e-6);
  EXPECT_EQ(unit.integer("pair", 0), 4);  // obstacle, cloud, rail, ball
  EXPECT_EQ(unit.integer("pair", 1), 2);
  EXPECT_TRUE(notes_of(unit).empty());
  unit.set("cloud.r", std::vector{0.005}).set("r", std::vector{0.25});
  unit.step(1e-3);
  EXPECT_NEAR(unit.real("distance"), 2 - 0.1 - 0.255, 1e-6);
  EXPECT_THAT(
      notes_of(unit),
      ElementsAre(HasSubstr("cloud.r is 0.005 m, but 95 % of the points are up to 0.05 m from the next one: links may pass")));
  // It stands where its parameters say, between points.
  unit.set("cloud.p0", std::vector<double>{0, 0.025, 0.025})
      .set("cloud.quat0", std::vector<double>{0, 0, 0, 1})
      .set("r", std::vector{0.0});
  unit.set("q", std::vector<double>{-2, 0, 0});
  unit.initialise();
  EXPECT_NEAR(unit.real("distance"), std::hypot(1, 0.025 * std::sqrt(2)) - 0.105, 1e-6);
}

TEST_F(Slides, PassNoPointCloudBetweenTwoInstants) {
  folder_.write("wall.csv", wall());
  UnitSubject unit = monitor("robot=@slide.urdf&ignore=hand:cloud&cloud=@wall.csv");
  for (const double way : {4.0, 1.0, 0.3}) {
    unit.set("q", std::vector<double>{3 - way / 2, 0, 0});
    unit.initialise();
    unit.set("q", std::vector<double>{3 + way / 2, 0, 0});
    const std::uint64_t before = cotwin::testing::allocations();
    unit.step(1e-3);
    EXPECT_EQ(cotwin::testing::allocations(), before);
    EXPECT_GT(unit.real("distance"), 0);
    EXPECT_NEAR(unit.real("least_distance"), -0.1 - unit.real("cloud.r"), 0.05 * way + 1e-6) << way;
  }
}

TEST_F(Slides, TellOfCloudsThatAreNotInMetres) {
  folder_.write("far.xyz", "0 0 0\n25 0 0\n50 0 0\n");
  EXPECT_THAT(monitor("robot=@slide.urdf&cloud=@far.xyz").instance().warnings,
              ::testing::Contains(HasSubstr("25 m (95 %) from the next one: are they in m?")));
}

TEST_F(Slides, RefuseCloudsThatTheyCannotWatch) {
  folder_.write("wall.csv", wall());
  folder_.write("bad.pcd", "VERSION 0.7\nFIELDS x y z\nDATA binar\n");
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&cloud=@missing.pcd"); }), HasSubstr("missing.pcd"));
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&cloud=@slide.urdf"); }), HasSubstr("unknown format of a point cloud"));
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&cloud=@bad.pcd"); }),
              HasSubstr("bad.pcd:3: 'DATA binar', expected DATA ascii"));
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&cloud=@wall.csv&separation=cloud"); }),
              HasSubstr("'cloud' stands, expected"));
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&cloud=@wall.csv&obstacles=cloud"); }),
              HasSubstr("'cloud' is no body of scene"));
  std::string named = cotwin::testing::content(folder_.path() / "plate.sdf");
  for (std::size_t at; (at = named.find("plate")) != std::string::npos;) named.replace(at, 5, "cloud");
  folder_.write("named.sdf", named);
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&cloud=@wall.csv&scene=@named.sdf"); }),
              HasSubstr("scene: has a body 'cloud', expected another name"));
}

TEST_F(Slides, RefuseWhatTheyCannotWatch) {
  EXPECT_THAT(error_of([&] { monitor("robot=@bare.urdf&scene=@plate.sdf"); }),
              HasSubstr("robot 'slide': has no shapes, so nothing can be said of collisions: scripts/capsules.py"));
  EXPECT_THAT(error_of([&] { monitor("scene=@plate.sdf"); }), HasSubstr("has no robot to watch"));
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&ignore=hand"); }),
              HasSubstr("ignore: 'hand', expected two names as in link_5:table"));
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&ignore=hand:bal"); }),
              HasSubstr("ignore: 'bal' is no link and no body, did you mean 'ball'?"));
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@ball.sdf&base=floating");
  unit.initialise();
  unit.set("q", std::vector<double>{0, std::nan(""), 0});
  EXPECT_THAT(error_of([&] { unit.step(1e-3); }), HasSubstr("monitor.q[2]: is nan at 0.001 s, expected a finite value"));
  unit.set("q", std::vector<double>{0, 0, 0}).set("obstacle.quat", std::vector<double>{0, 0, 0, 0});
  EXPECT_THAT(error_of([&] { unit.step(1e-3); }), HasSubstr("monitor.obstacle.quat: the quaternion (w, x, y, z) is 0"));
  unit.set("obstacle.quat", std::vector<double>{1, 0, 0, 0}).set("base_w", std::vector<double>{0, 0, HUGE_VAL});
  EXPECT_THAT(error_of([&] { unit.step(1e-3); }), HasSubstr("monitor.base_w[3]: is inf"));
}

/// The robots left and right on a table, with everything that a second formulation needs.
class Cell : public ::testing::Test {
 protected:
  struct Placed {
    robot::RobotModel model;
    std::vector<std::vector<scene::Shape>> shapes;
    Pose X_WB;
  };
  Cell() {
    for (const char* name : {"lwr4", "ur5e"}) {
      const fs::path urdf = fs::path(places::source()) / "models/robots" / name / "robot.urdf";
      robots_.push_back({robot::load_urdf(urdf), {}, {}});
      robots_.back().shapes = scene::hulls_of_urdf(urdf, robots_.back().model);
    }
    robots_[0].X_WB.p = {0, 0, 0.33};
    robots_[1].X_WB = {Eigen::AngleAxisd(1, Vector3d::UnitZ()).toRotationMatrix(), {0.9, 0.2, 0}};
    const Eigen::Quaterniond turned(robots_[1].X_WB.R);
    unit_.set("left.base_p0", std::vector<double>{0, 0, 0.33}).set("right.base_p0", std::vector<double>{0.9, 0.2, 0});
    unit_.set("right.base_quat0", std::vector<double>{turned.w(), turned.x(), turned.y(), turned.z()});
  }
  double real(double low, double high) { return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53; }
  std::vector<double> random(std::size_t n, double most) {
    std::vector<double> values(n);
    for (double& x : values) x = real(-most, most);
    return values;
  }
  void set(const std::vector<double>& q_left, const std::vector<double>& q_right) {
    unit_.set("left.q", q_left).set("right.q", q_right);
  }

  /// The least distance of links of both robots at the inputs of the unit, by forward kinematics and all pairs of shapes.
  double between_robots() {
    std::vector<std::pair<collision::Convex, Pose>> pieces[2];
    for (std::size_t r = 0; r < 2; ++r) {
      const Placed& placed = robots_[r];
      const Eigen::VectorXd q = unit_.joints(r == 0 ? "left.q" : "right.q"), rest = Eigen::VectorXd::Zero(q.size());
      for (std::size_t b = 0; b < placed.shapes.size(); ++b) {
        Pose X = placed.X_WB;
        if (b > 0) {
          const robot::FrameMotion motion =
              robot::FrameKinematics(placed.model, {"", static_cast<int>(b) - 1, {}}).at(q, rest, rest);
          X = X * Pose{motion.Q.toRotationMatrix(), motion.p};
        }
        for (const scene::Shape& shape : placed.shapes[b]) {
          collision::Convex convex = collision::make_convex(shape);
          const Pose X_WC = X * convex.X_BC;
          pieces[r].emplace_back(std::move(convex), X_WC);
        }
      }
    }
    double least = HUGE_VAL;
    collision::Feature scratch;
    for (std::size_t i = 0; i < pieces[0].size(); ++i) {
      for (std::size_t k = 0; k < pieces[1].size(); ++k) {
        const auto& [a, X_a] = pieces[0][i];
        const auto& [b, X_b] = pieces[1][k];
        const bool bases = i < robots_[0].shapes[0].size() && k < robots_[1].shapes[0].size();
        if (!bases) least = std::min(least, collision::distance({&a, X_a.R, X_a.p}, {&b, X_b.R, X_b.p}, scratch).d);
      }
    }
    return least;
  }

  std::mt19937_64 engine_{1};
  std::vector<Placed> robots_;
  UnitSubject unit_{"unit:monitor?robots=left:lwr4,right:ur5e"};
};

TEST_F(Cell, HasTheLeastDistanceOfAllPairsOfShapes) {
  unit_.initialise();
  for (int k = 0; k < 300; ++k) {
    set(random(7, 2), random(6, 2));
    unit_.step(1e-3);
    EXPECT_NEAR(unit_.real("distance"), between_robots(), 1e-9) << k;
    EXPECT_LE(unit_.real("least_distance"), unit_.real("distance"));
  }
}

TEST_F(Cell, HasTheLeastDistanceOfAFinelyDividedMotion) {
  for (int k = 0; k < 60; ++k) {
    const double way = k % 3 == 0 ? 1 : k % 3 == 1 ? 0.1 : 1e-3;
    const std::vector<double> from[2] = {random(7, 2), random(6, 2)}, by[2] = {random(7, way), random(6, way)};
    const auto move = [&](double share) {
      std::vector<double> q[2] = {from[0], from[1]};
      for (std::size_t r = 0; r < 2; ++r) {
        for (std::size_t i = 0; i < q[r].size(); ++i) q[r][i] += share * by[r][i];
      }
      set(q[0], q[1]);
    };
    move(0);
    unit_.initialise();
    move(1);
    unit_.step(1e-3);
    const double found = unit_.real("least_distance");
    double sampled = HUGE_VAL;
    constexpr int kParts = 100;
    for (int s = 0; s <= kParts; ++s) {
      move(static_cast<double>(s) / kParts);
      unit_.initialise();
      sampled = std::min(sampled, unit_.real("distance"));
    }
    const double longest = 2 * way * 13;  // no point moves farther
    EXPECT_LE(found, sampled + 0.05 * longest) << k;
    EXPECT_GE(found, sampled - longest / kParts) << k;
    EXPECT_EQ(found > 0, sampled > 0) << k;
  }
}

TEST_F(Cell, HasTheRateOfTheDistance) {
  int compared = 0;
  for (int k = 0; k < 100; ++k) {
    const std::vector<double> q_left = random(7, 2), q_right = random(6, 2), dq_left = random(7, 1), dq_right = random(6, 1);
    const auto at = [&](double t) {
      std::vector<double> left = q_left, right = q_right;
      for (std::size_t i = 0; i < 7; ++i) left[i] += t * dq_left[i];
      for (std::size_t i = 0; i < 6; ++i) right[i] += t * dq_right[i];
      set(left, right);
      unit_.set("left.dq", dq_left).set("right.dq", dq_right);
      unit_.initialise();
      return std::pair{unit_.real("distance"), unit_.integer("pair", 0) * 100 + unit_.integer("pair", 1)};
    };
    const auto [before, pair_before] = at(-1e-6);
    const auto [after, pair_after] = at(1e-6);
    const auto [d, pair] = at(0);
    if (pair_before != pair || pair_after != pair || d < 0.01) continue;
    ++compared;
    EXPECT_NEAR(unit_.real("distance_rate"), (after - before) / 2e-6, 1e-4) << k;
  }
  EXPECT_GT(compared, 60);
}

TEST_F(Cell, AllocatesNothingInAStepAndGivesTheSameBitsWhateverWasNearestBefore) {
  unit_.initialise();
  const std::vector<double> q_left = random(7, 2), q_right = random(6, 2);
  std::vector<double> found;
  for (int k = 0; k < 20; ++k) {
    set(random(7, 2), random(6, 2));
    const std::uint64_t before = cotwin::testing::allocations();
    unit_.step(Duration{1'000'000});
    EXPECT_EQ(cotwin::testing::allocations(), before);
    set(q_left, q_right);
    unit_.step(Duration{1'000'000});
    std::vector<double> now = unit_.values("p_a");
    now.push_back(unit_.real("distance"));
    now.push_back(unit_.real("right.self_distance"));
    if (k > 0) EXPECT_EQ(now, found);
    found = now;
  }
}

// A long arm turns by half a turn, and its end passes through a thin post that is far from it at both instants.
TEST(Levers, AreThoseOfTheWholeArm) {
  const TemporaryFolder folder("monitor");
  const std::string inertial =
      "<inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial>";
  folder.write("arm.urdf",
               "<robot name=\"arm\"><link name=\"base\"/><link name=\"bar\">" + inertial +
                   "<collision><origin xyz=\"1 0 0\"/><geometry><box size=\"2 0.02 0.02\"/></geometry></collision></link>"
                   "<joint name=\"q\" type=\"continuous\"><parent link=\"base\"/><child link=\"bar\"/><axis xyz=\"0 0 "
                   "1\"/></joint></robot>");
  folder.write("post.sdf",
               "<sdf version=\"1.11\"><world name=\"w\"><model name=\"post\"><static>true</static><pose>0 1.95 0 0 0 "
               "0</pose><link name=\"post\"><collision "
               "name=\"c\"><geometry><cylinder><radius>0.01</radius><length>1</length></cylinder></geometry></collision></"
               "link></model></world></sdf>");
  UnitSubject unit("unit:monitor?robot=" + (folder / "arm.urdf").string() + "&scene=" + (folder / "post.sdf").string());
  for (const double half : {0.03, 0.3, 1.5}) {
    unit.set("q", std::vector<double>{M_PI / 2 - half});
    unit.initialise();
    unit.set("q", std::vector<double>{M_PI / 2 + half});
    unit.step(1e-3);
    EXPECT_NEAR(unit.real("distance"), 1.95 * std::sin(half) - 0.02, half < 1 ? 2e-3 * half + 1e-9 : 10);
    EXPECT_LT(unit.real("least_distance"), 0) << half;
  }
}

// A base that moves: the distance from a plane that stands still, and its rate.
TEST(FloatingBase, MovesTheRobot) {
  UnitSubject unit("unit:monitor?robot=ur5e&scene=table&base=floating&ignore=base:table");
  unit.set("q", std::vector<double>{0.1, -1.2, 1, 0.3, 0.5, 0});
  const auto at = [&](double t) {
    const Eigen::Quaterniond quat(Eigen::AngleAxisd(0.3 + 0.2 * t, Vector3d::UnitX()));
    unit.set("base_p", std::vector<double>{0, 0, 1 + 0.5 * t})
        .set("base_quat", std::vector<double>{quat.w(), quat.x(), quat.y(), quat.z()});
    unit.set("base_v", std::vector<double>{0, 0, 0.5}).set("base_w", std::vector<double>{0.2, 0, 0});
    return unit.real("distance");
  };
  at(0);
  unit.initialise();
  const double d = unit.real("distance"), rate = unit.real("distance_rate");
  at(1e-6);
  unit.step(1e-6);
  EXPECT_NEAR((unit.real("distance") - d) / 1e-6, rate, 1e-4);
  // Half a turn and back would leave the distance at both ends, but not in between.
  unit.set("base_p", std::vector<double>{0, 0, 3}).set("base_quat", std::vector<double>{1, 0, 0, 0});
  unit.initialise();
  const double up = unit.real("distance");
  unit.set("base_quat", std::vector<double>{std::cos(1.2), std::sin(1.2), 0, 0});
  unit.step(1e-3);
  EXPECT_LT(unit.real("least_distance"), std::min(up, unit.real("distance")) + 1e-6);
}

TEST(ShippedRobots, TouchThemselvesNotAtHome) {
  for (const char* name : {"lwr4", "iiwa14", "kr300_r2500", "ur5e", "ur10", "ur20"}) {
    UnitSubject unit(std::string("unit:monitor?robot=") + name);
    unit.initialise();
    EXPECT_GT(unit.real("self_distance"), 0) << name;
    EXPECT_LT(unit.real("self_distance"), 1) << name;
  }
}

}  // namespace
}  // namespace cotwin::monitor::monitor_test
