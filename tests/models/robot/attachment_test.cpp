#include "models/robot/changes/attachment.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <random>

#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::robot::attachment_test {
namespace {

using cotwin::testing::error_of;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using ::testing::HasSubstr;

RobotModel lwr4() { return load_urdf(places::source() + "/models/robots/lwr4/robot.urdf"); }

Inertia box(double mass, double a, double b, double c) {
  Inertia body{mass, Vector3d::Zero(), Matrix3d::Zero()};
  body.I_CC.diagonal() << mass / 12 * (b * b + c * c), mass / 12 * (a * a + c * c), mass / 12 * (a * a + b * b);
  return body;
}

const Pose kOnTop = {rotation_from_rpy(0.1, -0.2, 0.3), {0, 0.01, 0.078}};
Attachment sensor() { return {"ft_sensor", "link_7", kOnTop, box(0.25, 0.06, 0.06, 0.03)}; }
Attachment gripper() { return {"gripper", "ft_sensor", {Matrix3d::Identity(), {0, 0, 0.05}}, box(0.8, 0.1, 0.05, 0.1)}; }

TEST(Attachment, MakesTheCarryingBodyTheCompositeBody) {
  RobotModel robot = lwr4();
  const Inertia before = robot.bodies[6].inertia;
  attach(robot, sensor());
  // The zeroth, first and second moments about the body's origin add up, whatever the frames.
  const auto sum = (before.parameters() + sensor().inertia.seen_from(kOnTop).parameters()).eval();
  EXPECT_TRUE(robot.bodies[6].inertia.parameters().isApprox(sum, 1e-14));
  EXPECT_EQ(robot.end_effector().name, "ft_sensor");
  EXPECT_EQ(robot.frame("ft_sensor").X_BF, kOnTop);  // link_7's frame is that of body 6
}

TEST(Attachment, OnAnAttachmentIsAtTheEndOfTheChainOfPoses) {
  RobotModel robot = lwr4();
  attach(robot, sensor());
  attach(robot, gripper());
  EXPECT_EQ(robot.frame("gripper").body, 6);
  EXPECT_TRUE(robot.frame("gripper").X_BF.p.isApprox(kOnTop * gripper().X_PA.p));
}

TEST(Attachment, TakenOffFromTheTopRestoresTheBodyToTheLastBit) {
  const RobotModel bare = lwr4();
  RobotModel robot = bare;
  attach(robot, sensor());
  attach(robot, gripper());
  detach(robot, "gripper");
  detach(robot, "ft_sensor");
  EXPECT_EQ(robot.bodies, bare.bodies);
  EXPECT_EQ(robot.frames, bare.frames);
  EXPECT_EQ(robot.history.size(), 4u);
}

TEST(Attachment, TakenOffFromBelowLeavesTheBodyAsIfItHadNeverBeenThere) {
  Attachment camera = gripper();
  camera.name = "camera";
  camera.parent = "link_7";
  RobotModel robot = lwr4(), other = lwr4();
  attach(robot, sensor());
  attach(robot, camera);
  detach(robot, "ft_sensor");
  attach(other, camera);
  EXPECT_EQ(robot.bodies, other.bodies);
  EXPECT_EQ(robot.frames, other.frames);
}

TEST(Attachment, TakenOffATunedBodyIsSubtractedFromIt) {
  RobotModel robot = lwr4();
  attach(robot, sensor());
  const Inertia tuned = robot.bodies[6].inertia + box(0.1, 0.1, 0.1, 0.1);
  set_inertia(robot, 6, tuned, "tuning of Tuesday");
  detach(robot, "ft_sensor");
  const auto left = robot.bodies[6].inertia.parameters();
  const auto expected = (tuned.parameters() - sensor().inertia.seen_from(kOnTop).parameters()).eval();
  EXPECT_TRUE(left.isApprox(expected, 1e-13));
}

TEST(Attachment, TakenOffABodySetByHandIsSubtractedFromIt) {
  RobotModel robot = lwr4();
  attach(robot, sensor());
  Attachment camera = gripper();
  camera.parent = "link_7";
  attach(robot, camera);
  const Inertia by_hand = robot.bodies[6].inertia + box(0.1, 0.1, 0.1, 0.1);
  robot.bodies[6].inertia = by_hand;  // a plain value: not logged
  detach(robot, "ft_sensor");
  const auto without_sensor = (by_hand.parameters() - sensor().inertia.seen_from(kOnTop).parameters()).eval();
  EXPECT_TRUE(robot.bodies[6].inertia.parameters().isApprox(without_sensor, 1e-13));
  detach(robot, "gripper");
  const auto without_both = (without_sensor - camera.inertia.seen_from(camera.X_PA).parameters()).eval();
  EXPECT_TRUE(robot.bodies[6].inertia.parameters().isApprox(without_both, 1e-12));
}

TEST(Attachment, CannotBeTakenOffABodyThatIsLighterThanIt) {
  RobotModel robot = lwr4();
  attach(robot, sensor());
  set_inertia(robot, 6, box(0.2, 0.1, 0.1, 0.1), "a wrong tuning");
  const RobotModel untouched = robot;
  EXPECT_THAT(error_of([&] { detach(robot, "ft_sensor"); }), HasSubstr("without 'ft_sensor' its body would have mass -0.0"));
  EXPECT_EQ(robot, untouched);
}

TEST(Attachment, MayBeAPointMassOrAMereFrame) {
  RobotModel robot = lwr4();
  const double mass = robot.bodies[6].inertia.mass;
  attach(robot, {"payload", "link_7", {Matrix3d::Identity(), {0, 0, 0.2}}, {2, Vector3d::Zero(), Matrix3d::Zero()}});
  EXPECT_DOUBLE_EQ(robot.bodies[6].inertia.mass, mass + 2);
  EXPECT_EQ(robot.bodies[6].inertia.unphysical(), "");
  const Inertia loaded = robot.bodies[6].inertia;
  attach(robot, {"tcp", "payload", {Matrix3d::Identity(), {0, 0, 0.1}}, {}});
  EXPECT_EQ(robot.bodies[6].inertia, loaded);
  EXPECT_NEAR(robot.end_effector().X_BF.p.z(), 0.3, 1e-15);
}

TEST(Attachment, OnTheBaseMovesNothing) {
  RobotModel robot = lwr4();
  robot.base.inertia = {};
  const std::vector<Body> bodies = robot.bodies;
  attach(robot, {"pedestal", "base", {}, box(50, 1, 1, 1)});
  EXPECT_EQ(robot.bodies, bodies);
  EXPECT_EQ(robot.base.inertia.mass, 50);
  attach(robot, {"cabinet", "base", {Matrix3d::Identity(), {1, 0, 0}}, box(20, 0.5, 0.5, 1)});
  detach(robot, "pedestal");
  detach(robot, "cabinet");
  EXPECT_EQ(robot.base.inertia, Inertia{});
}

TEST(Attachment, ThatIsInvalidIsRefusedAndChangesNothing) {
  RobotModel robot = lwr4();
  robot.base.inertia = {};
  attach(robot, sensor());
  attach(robot, gripper());
  const RobotModel untouched = robot;
  Attachment what = gripper();
  what.name = "tool";
  what.parent = "ft_senor";
  EXPECT_THAT(error_of([&] { attach(robot, what); }), HasSubstr("no frame 'ft_senor', did you mean 'ft_sensor'?"));
  EXPECT_THAT(error_of([&] { attach(robot, gripper()); }), HasSubstr("already has a frame with this name"));
  what = gripper();
  what.name = "tool";
  what.inertia.I_CC(2, 2) *= 10;
  EXPECT_THAT(error_of([&] { attach(robot, what); }), HasSubstr("attachment 'tool': principal moments"));
  what.inertia = {-1, Vector3d::Zero(), Matrix3d::Zero()};
  EXPECT_THAT(error_of([&] { attach(robot, what); }), HasSubstr("mass -1 kg, expected > 0"));
  what.name = "two\nlines";
  EXPECT_THAT(error_of([&] { attach(robot, what); }), HasSubstr("not a valid name in a URDF"));
  what.name = "tool";
  EXPECT_THAT(error_of([&] { attach(robot, what, "", NAN); }), HasSubstr("nan s, expected a finite time"));
  what.inertia = {1, Vector3d::Zero(), Matrix3d::Zero()};
  what.parent = "base";  // which has no mass
  EXPECT_THAT(error_of([&] { attach(robot, what); }), HasSubstr("with this point mass its body has no moments of inertia"));
  what.X_PA.R *= 2;
  EXPECT_THAT(error_of([&] { attach(robot, what); }), HasSubstr("X_PA is not a pose"));
  EXPECT_THAT(error_of([&] { detach(robot, "tool"); }), HasSubstr("no attachment is named 'tool'"));
  EXPECT_THAT(error_of([&] { detach(robot, "link_7"); }), HasSubstr("'link_7' is a link of the robot"));
  EXPECT_THAT(error_of([&] { detach(robot, "ft_sensor"); }), HasSubstr("'gripper' is mounted on 'ft_sensor'"));
  EXPECT_THAT(error_of([&] { set_inertia(robot, 7, box(1, 1, 1, 1), ""); }),
              HasSubstr("no body 7, expected -1 (the base) to 6"));
  EXPECT_THAT(error_of([&] { set_inertia(robot, 0, {}, ""); }), HasSubstr("body 'link_1': mass 0 kg"));
  EXPECT_EQ(robot, untouched);
}

TEST(Attachment, HistorySaysWhatAndWhy) {
  RobotModel robot = lwr4();
  Attachment sensor{"ft_sensor", "link_7", {}, {0.25, {0, 0, 0.03}, Matrix3d::Identity() * 1e-4}};
  sensor.X_PA.p = {0, 0, 0.01};
  attach(robot, sensor, "IV-A2");
  set_inertia(robot, 6, box(1, 0.1, 0.1, 0.1), "tuned");
  detach(robot, "ft_sensor", "broken");
  ASSERT_EQ(robot.history.size(), 3u);
  EXPECT_EQ(robot.history[0].what, "attach ft_sensor to link_7: 0.25 kg at (0, 0, 0.03) m in ft_sensor");
  EXPECT_EQ(robot.history[0].reason, "IV-A2");
  EXPECT_EQ(robot.history[1].what, "set inertia of link_7: 1 kg at (0, 0, 0) m in link_7");
  EXPECT_EQ(robot.history[2].what, "detach ft_sensor from link_7: 0.25 kg at (0, 0, 0.03) m in ft_sensor");
  EXPECT_EQ(robot.history[2].reason, "broken");
}

TEST(Attachment, HistoryRebuildsEveryEarlierRobotToTheLastBit) {
  std::mt19937 choices(4);
  const auto choose = [&](int count) { return static_cast<int>(choices() % static_cast<unsigned>(count)); };
  for (int round = 0; round < 200; ++round) {
    RobotModel robot = lwr4();
    std::vector<RobotModel> earlier;

    for (int i = 0; i < 12; ++i) {
      const RobotModel untouched = robot;
      try {
        switch (choose(3)) {
          case 0: {
            const auto frame = static_cast<std::size_t>(choose(static_cast<int>(robot.frames.size())));
            const std::string name = "part_" + std::to_string(choose(6));
            attach(robot, {name, robot.frames[frame].name, kOnTop, box(1 + choose(3), 0.1, 0.2, 0.3)});
            break;
          }
          case 1:
            detach(robot, "part_" + std::to_string(choose(6)));
            break;
          default:
            set_inertia(robot, choose(8) - 1, box(20 + choose(9), 0.5, 0.6, 0.7), "tuned");
        }
      } catch (const Error&) {
        EXPECT_EQ(robot, untouched);  // nothing of that name, or something mounted on it
        continue;
      }
      earlier.push_back(untouched);
    }
    ASSERT_EQ(earlier.size(), robot.history.size());
    for (std::size_t change = 0; change < earlier.size(); ++change) EXPECT_EQ(before(robot, change), earlier[change]);
    EXPECT_EQ(before(robot, robot.history.size()), robot);
    EXPECT_THROW(before(robot, robot.history.size() + 1), Error);
  }
}

}  // namespace
}  // namespace cotwin::robot::attachment_test
