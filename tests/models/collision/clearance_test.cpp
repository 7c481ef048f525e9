// Motions past obstacles: first contacts in closed form, and against finely sampled motions.
#include "models/collision/meeting/meeting.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "models/cloud/sample.h"
#include "models/collision/body.h"
#include "models/collision/contact/detector.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/robot_links.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::collision::clearance_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::error_of;
using Eigen::Vector3d;
using scene::Shape;
using scene::ShapeType;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

using Values = std::vector<double>;

Shape shape(ShapeType type, const Vector3d& size, const Vector3d& p = Vector3d::Zero()) {
  Shape s;
  s.type = type;
  s.size = size;
  s.X_BS.p = p;
  return s;
}

scene::Body body(const std::string& name, const Shape& shape, const Vector3d& p) {
  scene::Body b;
  b.name = name;
  b.motion = scene::Motion::kStatic;
  b.X_WB.p = p;
  b.shapes = {shape};
  return b;
}

/// A ball of 0.1 m at the end of an arm of 1 m that turns about z, and slides along it by the second joint.
PlacedCell::Robot arm(const std::string& name, const Vector3d& p = Vector3d::Zero()) {
  robot::RobotModel model;
  model.name = "arm";
  model.base.name = "base";
  robot::Joint turn, slide;
  turn.name = "turn";
  slide.name = "slide";
  slide.type = robot::JointType::kPrismatic;
  slide.parent = 0;
  slide.axis = Vector3d::UnitX();
  model.joints = {turn, slide};
  model.bodies.resize(2);
  model.bodies[0].name = "shaft";
  model.bodies[1].name = "hand";
  return {{name, model, {{}, {}, {shape(ShapeType::kSphere, {0.1, 0, 0}, {1, 0, 0})}}}, {Eigen::Matrix3d::Identity(), p}};
}

PlacedCell placed(const scene::Scene& scene, std::vector<PlacedCell::Robot> robots, std::vector<std::string> ignore = {},
                  std::vector<PlacedCell::Cloud> clouds = {}) {
  PlacedCell cell;
  cell.add(scene);
  cell.robots = std::move(robots);
  cell.ignore = std::move(ignore);
  cell.clouds = std::move(clouds);
  return cell;
}

/// From rest to rest by a quintic.
Motion go(const Values& from, const Values& to, double T) {
  Values q = from;
  q.insert(q.end(), to.begin(), to.end());
  const Values zeros(q.size());
  return {trajectory::Path(from.size(), {0, T}, q, zeros, zeros), {}};
}

Values at(const Motion& motion, double t) {
  Values q(motion.path.joints()), dq = q, ddq = q;
  motion.path.at(t, q, dq, ddq);
  return q;
}

// The ball at angle φ is 2 sin(|φ - ψ| / 2) from a ball at angle ψ on its circle.
TEST(Clearance, OfATurningBallIsKnownInClosedForm) {
  scene::Scene scene;
  const double psi = 1.3;
  scene.bodies = {body("ball", shape(ShapeType::kSphere, {0.2, 0, 0}), {std::cos(psi), std::sin(psi), 0})};
  for (const double clearance : {0.0, 0.05, 0.3}) {
    for (const double T : {1e-3, 1.0, 1e3}) {
      Checker checker(placed(scene, {arm("")}), {clearance});
      const Motion motion = go({0, 0}, {2, 0}, T);
      const Verdict verdict = checker.check({&motion, 1});
      ASSERT_FALSE(verdict.clear);
      const double contact = psi - 2 * std::asin((0.3 + clearance) / 2);
      EXPECT_NEAR(at(motion, verdict.nearest.t)[0], contact, 2e-6);
      EXPECT_LE(at(motion, verdict.nearest.t)[0], contact + 1e-12) << "not later";
      EXPECT_NEAR(verdict.nearest.d, clearance, 2e-6);
      EXPECT_EQ(verdict.nearest.link, "hand");
      EXPECT_EQ(verdict.nearest.other, "ball");
      EXPECT_NEAR((verdict.nearest.p_link - verdict.nearest.p_other).norm(), clearance, 2e-6);
      // It ends before.
      const Motion shorter = go({0, 0}, {contact - 0.01, 0}, T);
      const Verdict clear = checker.check({&shorter, 1});
      EXPECT_TRUE(clear.clear);
      const double least = 2 * std::sin((psi - contact + 0.01) / 2) - 0.3;
      EXPECT_NEAR(clear.nearest.d, least, std::max(1e-4, 1e-3 * least));
      EXPECT_NEAR(clear.nearest.t, T, 0.2 * T);
    }
  }
}

// An arm that rests, or moves one link only, is as near as it is, however a clearance rounds.
TEST(Clearance, OfLinksThatRestIsExact) {
  std::mt19937 random(5);
  const auto real = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  for (int k = 0; k < 300; ++k) {
    scene::Scene scene;
    double least = scene::kInfinity;
    for (int i = 0; i < 5; ++i) {
      const Vector3d p(real(-2, 2), real(-2, 2), real(-2, 2));
      scene.bodies.push_back(body("ball" + std::to_string(i), shape(ShapeType::kSphere, {0.1, 0, 0}), p));
      least = std::min(least, (p - Vector3d::UnitX()).norm() - 0.2);
    }
    const double clearance = real(0, 0.5);
    PlacedCell cell = placed(scene, {arm("")});
    cell.r = k % 2 == 0 ? real(0, 0.3) : 0;
    const double inflation = cell.r;
    const Motion rests{{}, {0, 0}}, slow = go({0, 0}, {0, 1e-9}, 1);
    Checker checker(std::move(cell), {clearance});
    for (const Motion& motion : {rests, slow}) EXPECT_EQ(checker.check({&motion, 1}).clear, least - inflation > clearance) << k;
  }
}

TEST(Clearance, PassesNoThinPlateAtAnySpeed) {
  scene::Scene scene;
  scene.bodies = {body("plate", shape(ShapeType::kBox, {1e-4, 0.05, 0.05}), {0, 1, 0.12})};
  Checker checker(placed(scene, {arm("")}));
  for (const double turns : {1.0, 7.3, 40.0}) {
    const Motion motion = go({-0.3, 0}, {-0.3 + turns * 2 * std::numbers::pi, 0}, 0.01);
    const Verdict verdict = checker.check({&motion, 1});
    ASSERT_FALSE(verdict.clear) << turns;
    EXPECT_NEAR(std::remainder(at(motion, verdict.nearest.t)[0] - std::numbers::pi / 2, 2 * std::numbers::pi), 0, 0.1);
    EXPECT_LT(at(motion, verdict.nearest.t)[0], 2) << "the first time";
  }
  const Motion beside = go({-0.3, -0.2}, {40, -0.2}, 0.01);  // 0.8 m from the axis
  EXPECT_TRUE(checker.check({&beside, 1}).clear);
}

TEST(Clearance, KnowsWhereTheOtherRobotIsAtThatTime) {
  // Both slide towards x = 0 along the same line; the second one is late.
  const auto from_both_sides = [](double wait) {
    Checker checker(placed({}, {arm("a", {-3, 0, 0}), arm("b", {3, 0, 0})}));
    Motion a = go({0, 0}, {0, 3.2}, 1);
    Motion b = go({std::numbers::pi, 0}, {std::numbers::pi, 1}, 1);
    b.path = trajectory::Path(2, {wait, wait + 1}, {std::numbers::pi, 0, std::numbers::pi, 1}, Values(4), Values(4));
    // a goes on to y = 0 again and returns.
    a.path = trajectory::Path(2, {0, 1, 2}, {0, 0, 0, 3.2, 0, 0}, Values(6), Values(6));
    const Motion motions[] = {a, b};
    return checker.check(motions);
  };
  const Verdict meets = from_both_sides(0), waits = from_both_sides(1.5);
  ASSERT_FALSE(meets.clear);  // a at -2 + x_a, b at 2 - x_b
  EXPECT_EQ(meets.nearest.link, "hand");
  EXPECT_EQ(meets.nearest.other, "b/hand");
  EXPECT_LT(meets.nearest.t, 1);
  EXPECT_TRUE(waits.clear) << waits.nearest.t;
}

// Two hands come towards each other on a line and go back, one in cycles of 1 s, the other in longer ones: first they pass each other by.
TEST(Clearance, KnowsLoopsThatGetOutOfStep) {
  using Loop = Motion::Loop;
  const auto position = [](const Motion& motion, double t) {
    const double T = motion.period, u = std::max(t - (motion.path.end() - T), 0.0), cycle = std::floor(u / T);
    if (motion.loop == Loop::kNo || t <= motion.path.end()) return at(motion, t)[1];
    const bool back = motion.loop == Loop::kThereAndBack && std::fmod(cycle, 2) == 1;
    return at(motion, motion.path.end() - T + (back ? T - (u - cycle * T) : u - cycle * T))[1];
  };
  int later = 0;
  for (const Loop loop : {Loop::kNo, Loop::kThereAndBack, Loop::kRepeat}) {
    for (const double period : {1.0, 1.1, 1.37}) {
      for (const double wait : {0.0, 0.4}) {
        const auto swing = [&](double far, double begin, double T, double phi) {
          const Values q = loop == Loop::kRepeat ? Values{phi, 0, phi, far, phi, 0} : Values{phi, 0, phi, far};
          Values t{begin, begin + T};
          if (loop == Loop::kRepeat) t = {begin, begin + T / 2, begin + T};
          return Motion{trajectory::Path(2, t, q, Values(q.size()), Values(q.size())), {}, loop, T};
        };
        // a comes out to x = -0.07 and b to 0.07, of hands at -2 and 2: they meet only if they are in step.
        const Motion motions[] = {swing(1.93, 0, 1, 0),
                                  swing(1.93, loop == Loop::kNo ? wait : 1 + wait, period, std::numbers::pi)};
        Checker checker(placed({}, {arm("a", {-3, 0, 0}), arm("b", {3, 0, 0})}));
        constexpr double kUntil = 9, kStep = 1e-3;
        double first = scene::kInfinity;
        const double end = loop == Loop::kNo ? 1 : kUntil;
        for (int k = 0; k * kStep <= end && first == scene::kInfinity; ++k) {
          const double t = k * kStep, gap = (2 - position(motions[1], t)) - (-2 + position(motions[0], t)) - 0.2;
          if (gap < 0) first = t;
        }
        const Verdict verdict = checker.check(motions, kUntil);
        EXPECT_EQ(verdict.clear, first == scene::kInfinity) << period << " s, after " << wait << " s";
        if (verdict.clear || first == scene::kInfinity) continue;
        EXPECT_NEAR(verdict.nearest.t, first, 1.1 * kStep);
        later += first > 1 ? 1 : 0;
      }
    }
  }
  EXPECT_GT(later, 4) << "only in a later cycle";
}

/// Robots of models/robots with their hulls.
PlacedCell::Robot shipped(const std::string& name, const Vector3d& p) {
  const fs::path urdf = fs::path(cotwin::places::source()) / "models/robots" / name / "robot.urdf";
  PlacedCell::Robot stand{{name, robot::load_urdf(urdf), {}}, {Eigen::Matrix3d::Identity(), p}};
  stand.robot.shapes = scene::hulls_of_urdf(urdf, stand.robot.model);
  return stand;
}

class Cells : public ::testing::Test {
 protected:
  double real(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  scene::Scene scene(int bodies) {
    scene::Scene s;
    for (int k = 0; k < bodies; ++k) {
      const double angle = real(-3, 3), far = real(0.35, 1.2);
      const Vector3d size(real(0.05, 0.2), real(0.05, 0.2), real(0.05, 0.3));
      s.bodies.push_back(body("box" + std::to_string(k), shape(ShapeType::kBox, size),
                              {far * std::cos(angle), far * std::sin(angle), real(0, 1.2)}));
    }
    return s;
  }
  Values posture(const robot::RobotModel& model) {
    Values q;
    for (const robot::Joint& joint : model.joints) q.push_back(real(std::max(joint.q_min, -2.0), std::min(joint.q_max, 2.0)));
    return q;
  }
  std::mt19937 random_{3};
};

/// The surfaces of a scene as points.
PlacedCell::Cloud cloud_of(const scene::Scene& s, double spacing, double radius) {
  std::vector<std::string> none;
  return {"cloud", std::make_shared<cloud::Tree>(cloud::sample(s, {.spacing = spacing}, none)), radius, {}};
}

// The same by many samples. Every fifth scene is a cloud.
TEST_F(Cells, AnswerAsFinelySampledMotionsDo) {
  constexpr int kSamples = 1000;
  int clear = 0, touching = 0;
  for (int k = 0; k < 60; ++k) {
    scene::Scene s = scene(4);
    std::vector<PlacedCell::Cloud> clouds;
    if (k % 5 == 4) {
      clouds.push_back(cloud_of(s, 0.02, 0.01));
      s.bodies.clear();
    }
    const std::vector<PlacedCell::Robot> robots{shipped("lwr4", {0, 0, 0}), shipped("ur5e", {1, 0, 0})};
    const Options options{k % 3 == 0 ? 0.03 : 0, k % 2 == 0};
    Checker checker(placed(s, robots, {}, clouds), options);
    std::vector<Motion> motions;
    for (const PlacedCell::Robot& stand : robots)
      motions.push_back(k % 4 == 0 && !motions.empty() ? Motion{{}, posture(stand.robot.model)}
                                                       : go(posture(stand.robot.model), posture(stand.robot.model), 2));
    const Verdict verdict = checker.check(motions);
    std::vector<collision::Body> own, others;
    for (const auto& shapes : robots[0].robot.shapes) own.emplace_back(shapes);
    for (const auto& shapes : robots[1].robot.shapes) others.emplace_back(shapes);
    for (const scene::Body& b : s.bodies) others.emplace_back(b.shapes);
    for (const PlacedCell::Cloud& cloud : clouds) others.emplace_back(cloud.points, cloud.radius);
    collision::Finder finder;
    for (const collision::Body& solid : own) finder.reserve(solid);
    for (const collision::Body& solid : others) finder.reserve(solid);
    double least = scene::kInfinity, first = scene::kInfinity;
    for (int i = 0; i <= kSamples && first == scene::kInfinity; ++i) {
      const double t = 2.0 * i / kSamples;
      std::vector<std::vector<Pose>> X;
      for (std::size_t r = 0; r < 2; ++r) {
        const robot::RobotModel& model = robots[r].robot.model;
        const Values q = motions[r].path.joints() > 0 ? at(motions[r], t) : motions[r].q, zeros(q.size());
        X.emplace_back(model.bodies.size());
        std::vector<Twist> V(model.bodies.size());
        scene::place_links(model, robots[r].X_WB, q, zeros, X.back(), V);
        X.back().insert(X.back().begin(), robots[r].X_WB);
      }
      std::vector<Pose> X_others = X[1];
      for (const scene::Body& b : s.bodies) X_others.push_back(b.X_WB);
      for (const PlacedCell::Cloud& cloud : clouds) X_others.push_back(cloud.X_WC);
      for (std::size_t a = 0; a < own.size(); ++a) {
        for (std::size_t b = 0; b < others.size(); ++b) {
          if (a == 0 && (b == 0 || b >= X[1].size())) continue;
          const double balls = (X[0][a] * own[a].middle() - X_others[b] * others[b].middle()).norm() - own[a].radius();
          if (balls - others[b].radius() > std::max(least, options.clearance)) continue;
          const double d = finder.find(own[a], X[0][a], others[b], X_others[b]).d;
          least = std::min(least, d);
          if (d < options.clearance) first = std::min(first, t);
        }
        for (std::size_t b = a + 2; b < own.size() && options.self; ++b) {
          const double balls = (X[0][a] * own[a].middle() - X[0][b] * own[b].middle()).norm() - own[a].radius();
          if (balls < own[b].radius() && finder.find(own[a], X[0][a], own[b], X[0][b]).d < 0) first = std::min(first, t);
        }
      }
    }
    if (verdict.clear) {
      ++clear;
      EXPECT_EQ(first, scene::kInfinity) << k;
      if (!options.self) {
        EXPECT_LE(verdict.nearest.d, least + std::max(1e-4, 1e-3 * least)) << k;
      }
      if (!options.self) {
        EXPECT_GE(verdict.nearest.d, least - 0.02) << k << ": between two samples";
      }
    } else {
      ++touching;
      EXPECT_LE(verdict.nearest.t, first) << k;
      if (first < scene::kInfinity) {
        EXPECT_GT(verdict.nearest.t, first - 2.1 * 2 / kSamples) << k;
      }
    }
  }
  EXPECT_GT(clear, 8);
  EXPECT_GT(touching, 20);
}

// The balls reach beyond the surfaces by their radius, and the points are at most so far apart.
TEST_F(Cells, OfCloudsAreLikeTheirScenes) {
  constexpr double kSpacing = 0.01, kRadius = 0.006, kGap = 0.02;
  int clear = 0, touching = 0;
  for (int k = 0; k < 60; ++k) {
    const scene::Scene s = scene(4);
    PlacedCell::Cloud cloud = cloud_of(s, kSpacing, kRadius);
    PlacedCell::Robot robot = shipped(k % 2 == 0 ? "lwr4" : "ur5e", {0, 0, 0});
    Checker of_scene(placed(s, {robot}));
    const Motion motion = go(posture(robot.robot.model), posture(robot.robot.model), 2);
    // Somewhere else in W, all the same.
    const Pose X{rotation_from_rpy(0.3, -0.2, 1), {5, -3, 2}};
    robot.X_WB = cloud.X_WC = X;
    Checker of_cloud(placed({}, {robot}, {}, {cloud}));
    const Verdict expected = of_scene.check({&motion, 1}), found = of_cloud.check({&motion, 1});
    if (expected.clear) {
      ++clear;
      EXPECT_LE(found.nearest.d, expected.nearest.d - kRadius + kGap);
      if (found.clear) {
        EXPECT_GE(found.nearest.d, expected.nearest.d - kRadius - 1e-3 * (1 + expected.nearest.d));
      }
      if (!found.clear) {
        EXPECT_LT(expected.nearest.d, kRadius + 1e-4);
      }
    } else {
      ++touching;
      if (!found.clear) {
        EXPECT_EQ(found.nearest.other, "cloud");
      }
      EXPECT_TRUE(!found.clear || found.nearest.d < kGap - kRadius) << "a link that hardly touches may be between points";
    }
  }
  EXPECT_GT(clear, 5);
  EXPECT_GT(touching, 5);
}

// The contact world finds its points by other paths: normals of faces and edges first, and features.
TEST_F(Cells, AgreeWithThePointsOfTheContactWorld) {
  constexpr double kMargin = 0.2;  // m
  int apart = 0, meeting = 0;
  for (int k = 0; k < 400; ++k) {
    const scene::Scene boxes = scene(k % 2 == 0 ? 3 : 15);
    const PlacedCell::Robot stand = shipped("lwr4", Vector3d::Zero());
    const robot::RobotModel& model = stand.robot.model;
    const Motion rest{{}, posture(model)};
    const Verdict verdict = Checker(placed(boxes, {stand})).check({&rest, 1});
    std::vector<Pose> X_W(1, stand.X_WB);
    X_W.resize(model.bodies.size() + 1);
    std::vector<Twist> V(model.bodies.size());
    const Values zeros(rest.q.size());
    scene::place_links(model, stand.X_WB, rest.q, zeros, std::span(X_W).subspan(1), V);
    scene::Scene all;
    for (std::size_t i = 0; i < X_W.size(); ++i) {
      all.bodies.push_back({});
      all.bodies.back().motion = i == 0 ? scene::Motion::kStatic : scene::Motion::kDriven;
      all.bodies.back().shapes = stand.robot.shapes[i];
      for (std::size_t j = 0; j < i; ++j) all.no_contact.emplace_back(static_cast<int>(j), static_cast<int>(i));
    }
    for (const scene::Body& box : boxes.bodies) {
      all.bodies.push_back(box);
      X_W.push_back(box.X_WB);
    }
    Detector detector(all);
    detector.detect(X_W, kMargin);
    double gap = kMargin;
    for (const ContactPoint& point : detector.points()) gap = std::min(gap, point.gap);
    EXPECT_EQ(verdict.clear, gap > 0) << k;
    if (verdict.clear) {
      EXPECT_NEAR(std::min(verdict.nearest.d, kMargin), gap, 1e-9) << k;
    }
    (verdict.clear ? apart : meeting) += gap < kMargin ? 1 : 0;
  }
  EXPECT_GT(apart, 50);
  EXPECT_GT(meeting, 20);
}

TEST(Clearance, TellsWhatItCannotAnswerAndWhatItLeavesOut) {
  scene::Scene scene;
  scene.bodies = {body("ball", shape(ShapeType::kSphere, {0.2, 0, 0}), {0.5, 0, 0})};
  PlacedCell::Robot bare = arm("bare");
  bare.robot.shapes = {{}, {}, {}};
  EXPECT_THAT(error_of([&] { Checker(placed(scene, {bare})); }), HasSubstr("robot 'arm': has no shapes"));
  EXPECT_THAT(error_of([&] { Checker(placed(scene, {arm("")}, {"hand:bal"})); }),
              HasSubstr("'bal' is no link and no body, did you mean 'ball'?"));
  EXPECT_THAT(error_of([&] { Checker(placed(scene, {arm("")}, {"hand"})); }), HasSubstr("expected two names"));
  // The ball is around the hand from the beginning, or does not count.
  const Motion stands{{}, {0, -0.5}};
  const Verdict inside = Checker(placed(scene, {arm("")})).check({&stands, 1});
  EXPECT_FALSE(inside.clear);
  EXPECT_EQ(inside.nearest.t, 0);
  EXPECT_NEAR(inside.nearest.d, -0.3, 1e-12);
  EXPECT_TRUE(Checker(placed(scene, {arm("")}, {"ball:hand"})).check({&stands, 1}).clear);
  scene.bodies[0].motion = scene::Motion::kDriven;
  EXPECT_THAT(
      Checker(placed(scene, {arm("")})).notes(),
      ElementsAre("no shapes of base, shaft, which meet nothing", "may move in the run, and are taken where they start: ball"));
  const Motion away = go({0, 0.5}, {1, 0.6}, 1);
  const Verdict alone = Checker(placed({}, {arm("")})).check({&away, 1});
  EXPECT_TRUE(alone.clear);
  EXPECT_EQ(alone.nearest.d, scene::kInfinity);
}

// A ball of 0.1 m, 0.5 m beyond the hand, which passes a post at 90 degrees on the way from 0 to 2 rad.
TEST(Tools, CountWhileTheyAreThere) {
  scene::Scene scene;
  scene.bodies = {body("post", shape(ShapeType::kSphere, {0.1, 0, 0}), {0, 1.5, 0})};
  const Motion motion = go({0, 0}, {2, 0}, 1);
  const auto with = [&](double from, double until) {
    PlacedCell::Robot stand = arm("");
    stand.tools = {{"rod", 1, {shape(ShapeType::kSphere, {0.1, 0, 0}, {1.5, 0, 0})}, from, until}};
    return Checker(placed(scene, {stand})).check({&motion, 1});
  };
  const double contact = std::numbers::pi / 2 - 2 * std::asin(0.2 / 3), leaves = std::numbers::pi - contact;
  const auto time_of = [&](double angle) {
    double low = 0, high = 1;
    while (high - low > 1e-12) (at(motion, (low + high) / 2)[0] < angle ? low : high) = (low + high) / 2;
    return low;
  };
  const Verdict always = with(-scene::kInfinity, scene::kInfinity);
  ASSERT_FALSE(always.clear);
  EXPECT_EQ(always.nearest.link, "rod");
  EXPECT_EQ(always.nearest.other, "post");
  EXPECT_NEAR(always.nearest.t, time_of(contact), 1e-5);
  EXPECT_EQ(with(-1, 0.9).nearest.link, "rod");
  // Gone before, come after, or never there.
  for (const auto& [from, until] :
       {std::pair{0.0, time_of(contact) - 1e-3}, {time_of(leaves) + 1e-3, 2.0}, {-2.0, -1.0}, {3.0, 2.0}}) {
    const Verdict clear = with(from, until);
    EXPECT_TRUE(clear.clear) << from << " to " << until << ": " << clear.nearest.t;
    EXPECT_LE(clear.nearest.d, 0.3 + 1e-3) << "the hand is 0.5 m from the post, less the radii";
  }
  // It comes or goes while it overlaps, or comes after the motion's end.
  const double middle = time_of(std::numbers::pi / 2);
  EXPECT_NEAR(with(middle, 2).nearest.t, middle, 1e-9);
  EXPECT_NEAR(with(middle, 2).nearest.d, -0.2, 1e-9);
  EXPECT_NEAR(with(0, middle).nearest.t, time_of(contact), 1e-5);
  const Motion stays{{}, {std::numbers::pi / 2, 0}};
  PlacedCell::Robot late = arm("");
  late.tools = {{"rod", 1, {shape(ShapeType::kSphere, {0.1, 0, 0}, {1.5, 0, 0})}, 7, 9}};
  const Verdict met = Checker(placed(scene, {late})).check({&stays, 1});
  EXPECT_FALSE(met.clear);
  EXPECT_EQ(met.nearest.t, 7);
}

TEST(Tools, OfARobotMeetItsOtherLinksAndThoseOfOthers) {
  // The shaft has a ball at x = 0.3; a tool of the hand reaches back to it, or one of the shaft to the hand.
  PlacedCell::Robot stand = arm("");
  stand.robot.shapes[1] = {shape(ShapeType::kSphere, {0.05, 0, 0}, {0.3, 0, 0})};
  const Motion rests{{}, {0, 0}};
  const auto meets = [&](const Tool& tool, std::vector<std::string> ignore = {}, bool self = true) {
    stand.tools = {tool};
    const Verdict verdict = Checker(placed({}, {stand}, ignore), {0, self}).check({&rests, 1});
    return verdict.clear ? "" : verdict.nearest.link + " " + verdict.nearest.other;
  };
  const Tool back{"a::b c", 1, {shape(ShapeType::kBox, {0.8, 0.02, 0.02}, {0.6, 0, 0})}};
  EXPECT_EQ(meets(back), "shaft a::b c") << "a neighbour of the link that carries it counts, the link itself does not";
  EXPECT_EQ(meets(back, {}, false), "");
  EXPECT_EQ(meets(back, {"shaft:a::b c"}), "");
  EXPECT_EQ(meets(back, {" a::b c : shaft "}), "");
  EXPECT_EQ(meets({"rod", 0, {shape(ShapeType::kBox, {1, 0.02, 0.02}, {0.5, 0, 0})}}), "hand rod");
  EXPECT_EQ(meets({"lamp", -1, {shape(ShapeType::kBox, {0.1, 0.1, 2}, {1, 0, 0})}}), "hand lamp");
  EXPECT_THAT(error_of([&] { meets(back, {"shaft:a:b c"}); }), HasSubstr("'a:b c' is no link and no body"));
  // Of another robot, also while this one rests.
  PlacedCell::Robot other = arm("right", {3, 0, 0});
  other.tools = {{"rod", 1, {shape(ShapeType::kBox, {2, 0.1, 0.1}, {1, 0, 0})}}};
  stand.tools.clear();
  const Motion motions[] = {go({0, 0}, {0.1, 0}, 1), go({1, 0}, {std::numbers::pi, 0}, 1)};
  const Verdict verdict = Checker(placed({}, {stand, other})).check(motions);
  EXPECT_FALSE(verdict.clear);
  EXPECT_EQ(verdict.nearest.other, "right/rod");
  // The other one rests, and gets its tool at the end of the motion, or later; gone again before, it does not count.
  other.X_WB.p.x() = 3.02;
  for (const double from : {0.5, 1.0, 4.0, 1e3}) {
    other.tools = {{"rod", 1, {shape(ShapeType::kBox, {2, 0.1, 0.1}, {1, 0, 0})}, from}};
    const Motion both[] = {go({0, 0}, {0.1, 0}, 1), {{}, {std::numbers::pi, 0}}};
    const Verdict late = Checker(placed({}, {stand, other})).check(both);
    EXPECT_FALSE(late.clear) << from;
    EXPECT_EQ(late.nearest.t, from);
    other.tools.front().from = -2;
    other.tools.front().until = -1;
    EXPECT_TRUE(Checker(placed({}, {stand, other})).check(both).clear);
  }
  Checker bare(placed({}, {stand, arm("x", {9, 0, 0})}));
  EXPECT_TRUE(bare.check(motions).clear);
}

// Ends of a motion count: it starts or ends in the obstacle.
TEST(Clearance, CountsBothEnds) {
  scene::Scene scene;
  scene.bodies = {body("ball", shape(ShapeType::kSphere, {0.2, 0, 0}), {1, 0, 0})};
  Checker checker(placed(scene, {arm("")}));
  const Motion starts = go({0.29, 0}, {2, 0}, 1), ends = go({2, 0}, {0.29, 0}, 1);
  EXPECT_EQ(checker.check({&starts, 1}).nearest.t, 0);
  EXPECT_FALSE(checker.check({&starts, 1}).clear);
  const Verdict late = checker.check({&ends, 1});
  EXPECT_FALSE(late.clear);
  EXPECT_NEAR(at(ends, late.nearest.t)[0], 2 * std::asin(0.15), 1e-5);
}

}  // namespace
}  // namespace cotwin::collision::clearance_test
