// Motions that do not turn a free base, against goals that a second formulation reaches, and what the motion that is found does to the base.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <nlohmann/json.hpp>

#include "components/services/json/json.h"
#include "models/foundation/support/error.h"
#include "models/numerics/random.h"
#include "models/robot/floating_base.h"
#include "models/robot/frame_kinematics.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::services::reactionless_test {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using nlohmann::json;
using ::testing::HasSubstr;

const json kBase{{"mass_kg", 30}, {"com_m", {0.05, -0.03, -0.2}}, {"inertia_kg_m2", {1.5, 0.1, 0.05, 1.2, -0.04, 0.9}}};

json ask(Robots& robots, const json& request) { return json::parse(answer(robots, request.dump())); }
std::string robots_folder() { return places::source() + "/models/robots"; }

/// The LWR 4+ on kBase.
robot::RobotModel satellite(Robots& robots) {
  robot::RobotModel robot = robots.find("lwr4")->model;
  robot.base.inertia.mass = 30;
  robot.base.inertia.p_LC << 0.05, -0.03, -0.2;
  robot.base.inertia.I_CC << 1.5, 0.1, 0.05, 0.1, 1.2, -0.04, 0.05, -0.04, 0.9;
  return robot;
}

/// A posture and the pose of the end effector, the base's first frame being at rest.
struct Reach {
  explicit Reach(const robot::RobotModel& model)
      : mechanism(model), data(mechanism), inertia(model.n()), kinematics(model, model.end_effector()), J(6, model.n()) {}
  /// From q with joint speeds in null(Z) by the pseudoinverse, over a way of this length; returns the end posture.
  VectorXd integrate(VectorXd q, const VectorXd& u, const VectorXd& v, double length) {
    constexpr int kSteps = 100;
    const auto rate = [&](const VectorXd& at, double s) {
      robot::floating_inertia(mechanism, data, at, inertia);
      const MatrixXd Z = inertia.Z();
      const VectorXd wanted = std::cos(3 * s) * u + std::sin(3 * s) * v;
      return VectorXd(length * (wanted - Z.transpose() * (Z * Z.transpose()).inverse() * (Z * wanted)));
    };
    for (int k = 0; k < kSteps; ++k) {
      const double h = 1.0 / kSteps, s = k * h;
      const VectorXd a = rate(q, s), b = rate(q + 0.5 * h * a, s + 0.5 * h), c = rate(q + 0.5 * h * b, s + 0.5 * h),
                     d = rate(q + h * c, s + h);
      q += h / 6 * (a + 2 * b + 2 * c + d);
    }
    return q;
  }
  Vector3d centre(const VectorXd& q) {
    robot::floating_inertia(mechanism, data, q, inertia);
    return inertia.p_C;
  }
  robot::FloatingMechanism mechanism;
  robot::FloatingData data;
  robot::FloatingInertia inertia;
  robot::FrameKinematics kinematics;
  MatrixXd J;
};

TEST(Reactionless, ReachesPosesThatRandomMotionsInTheNullSpaceReach) {
  Robots robots({robots_folder()});
  const robot::RobotModel model = satellite(robots);
  Reach reach(model);
  std::uint32_t draw = 0;
  const auto uniform = [&] { return 2 * numerics::uniform({.seed = 3, .draw = draw++}) - 1; };
  for (bool reached = false; !reached;) {
    VectorXd from(7), u(7), v(7);
    from << 0, 0.5, 0, -1, 0, 0.9, 0;
    for (Eigen::Index j = 0; j < 7; ++j) {
      from[j] += 0.5 * uniform();
      u[j] = uniform();
      v[j] = uniform();
    }
    const VectorXd to = reach.integrate(from, u.normalized(), v.normalized(), 2.5 + 1.5 * uniform());
    const Vector3d start = reach.kinematics.jacobian(from, reach.J).p;
    const robot::FrameMotion end = reach.kinematics.jacobian(to, reach.J);
    const Vector3d p = end.p + reach.centre(from) - reach.centre(to);
    bool within = true;
    for (std::size_t j = 0; j < 7; ++j) within = within && std::abs(to[static_cast<Eigen::Index>(j)]) < model.joints[j].q_max;
    if (!within || (p - start).norm() < 0.3) continue;
    reached = true;
    const json reply =
        ask(robots,
            {{"service", "reactionless"},
             {"robot", "lwr4"},
             {"base", kBase},
             {"from_q_rad", std::vector<double>(from.begin(), from.end())},
             {"T_s", 12},
             {"particles", 24},
             {"rounds", 15},
             {"drives", "none"},
             {"detail", "all"},
             {"to_pose", {{"p_m", {p.x(), p.y(), p.z()}}, {"quaternion_wxyz", {end.Q.w(), end.Q.x(), end.Q.y(), end.Q.z()}}}}});
    ASSERT_TRUE(reply["reactionless"].get<bool>()) << reply["notes"];
    EXPECT_LT(reply["to_go"]["distance_m"].get<double>(), 1e-6);
    EXPECT_LT(reply["to_go"]["angle_rad"].get<double>(), 1e-6);
    // What the service `reaction` finds for the written table: no turn, and a displacement that brings the end effector to the goal.
    json table{{"service", "reaction"}, {"robot", "lwr4"}, {"base", kBase}, {"drives", "none"}};
    table["series"] = {{"t_s", reply["motion"]["t_s"]}, {"q_rad", reply["motion"]["q_rad"]}};
    const json found = ask(robots, table);
    for (const json& rate : found["worst"]["rate"]["rate_rad_per_s"]) EXPECT_LT(std::abs(rate.get<double>()), 1e-9);
    EXPECT_LT(found["worst"]["turn"]["turn_rad"].get<double>(), 1e-9);
    const std::vector<double> last = reply["motion"]["q_rad"].back();
    const robot::FrameMotion tip = reach.kinematics.jacobian(Eigen::Map<const VectorXd>(last.data(), 7), reach.J);
    const json& d = found["end"]["displacement_m"];
    EXPECT_LT((tip.p + Vector3d(d[0], d[1], d[2]) - p).norm(), 1e-6);
    EXPECT_LT(tip.Q.angularDistance(end.Q), 1e-6);
    EXPECT_GT(reply["standard"]["turn_rad"].get<double>(), 1e-3);
    for (const char* cost : {"torque_squared_integral", "work_J", "jerk_squared_integral"})
      EXPECT_NEAR(found["costs"][cost].get<double>() / reply["costs"][cost].get<double>(), 1, 1e-6) << cost;
  }
}

json near_question() {
  return {{"service", "reactionless"},
          {"robot", "lwr4"},
          {"base", kBase},
          {"from_q_rad", {0, 0.5, 0, -1, 0, 0.6, 0}},
          {"to_q_rad", {0.05, 0.55, 0, -1.05, 0, 0.6, 0}},
          {"to_pose", {{"directions", {"z"}}}},
          {"particles", 8},
          {"rounds", 4}};
}

TEST(Reactionless, TakesTheShortestDurationWithinTheBoundsUnlessItIsGiven) {
  Robots robots({robots_folder()});
  json question = near_question();
  const json shortest = ask(robots, question);
  ASSERT_TRUE(shortest["feasible"].get<bool>()) << shortest["reason"];
  EXPECT_NEAR(shortest["limiting"]["share"].get<double>(), 1, 1e-3);
  question["T_s"] = 0.3 * shortest["T_s"].get<double>();
  const json shorter = ask(robots, question);
  EXPECT_FALSE(shorter["feasible"].get<bool>());
  EXPECT_THAT(shorter["reason"].get<std::string>(), HasSubstr("bound"));
  EXPECT_TRUE(shorter["reactionless"].get<bool>());
}

// In four fifths of the time that the way of least speeds needs, it exceeds the bound of jerk by 1/0.8³: twice.
TEST(Reactionless, HeedsBoundsOfAccelerationAndJerkInAGivenTime) {
  Robots robots({robots_folder()});
  json question = near_question();
  question.update({{"ddq_max_rad_per_s2", std::vector<double>(7, 2)}, {"dddq_max_rad_per_s3", std::vector<double>(7, 20)}});
  const json shortest = ask(robots, question);
  EXPECT_EQ(shortest["limiting"]["bound"], "dddq");
  question["T_s"] = 0.8 * shortest["T_s"].get<double>();
  const json reply = ask(robots, question);
  EXPECT_TRUE(reply["reactionless"].get<bool>());
  EXPECT_LT(reply["limiting"]["share"].get<double>(), 1.2) << "of 54 such questions 49 find a way within the bounds";
  EXPECT_LT(reply["to_go"]["distance_m"].get<double>(), 1e-9);
  EXPECT_LT(reply["worst"]["turn"]["turn_rad"].get<double>(), 1e-12);
}

TEST(Reactionless, KeepsTheAttitudeOfVeryLightAndVeryHeavyBases) {
  Robots robots({robots_folder()});
  for (const double mass : {1.0, 1e5}) {
    json question = near_question();
    question.update(
        {{"T_s", 8}, {"base", {{"mass_kg", mass}, {"inertia_kg_m2", {mass / 100, 0, 0, mass / 100, 0, mass / 100}}}}});
    const json reply = ask(robots, question);
    EXPECT_TRUE(reply["reactionless"].get<bool>()) << reply["notes"];
    EXPECT_LT(reply["to_go"]["distance_m"].get<double>(), 1e-9);
    EXPECT_LT(reply["worst"]["turn"]["turn_rad"].get<double>(), 1e-12);
    EXPECT_GT(reply["standard"]["turn_rad"].get<double>(), 1e-4);
  }
}

/// The URDF of a robot with the arm of `satellite` twice, with "left_" and "right_" before the names of joints and links.
std::string with_two_arms(const std::string& satellite) {
  const std::size_t first = satellite.find("<joint"), end = satellite.rfind("</robot>");
  std::string two = satellite.substr(0, first);
  for (const auto& [side, place] : {std::pair{"left", "0 0.4 0"}, {"right", "0 -0.4 0"}}) {
    std::string arm = satellite.substr(first, end - first);
    for (const std::string word : {"\"joint_", "\"link_"})
      for (std::size_t at = 0; (at = arm.find(word, at)) != std::string::npos; at += word.size())
        arm.insert(at + 1, std::string(side) + "_");
    const std::string origin = "xyz=\"0 0 0\"";
    two += arm.replace(arm.find(origin), origin.size(), std::string("xyz=\"") + place + "\"");
  }
  return two + "</robot>\n";
}

TEST(Reactionless, LetsOneArmWorkWhileTheOtherBalances) {
  const testing::TemporaryFolder folder("two_arms");
  folder.write("two.urdf", with_two_arms(testing::content(places::source() + "/examples/21_reaction/satellite.urdf")));
  Robots robots({folder.path()});
  json locked;
  for (const char* joint : {"left_joint_3", "left_joint_5", "left_joint_7", "right_joint_3", "right_joint_5", "right_joint_7"})
    locked[joint] = 0;
  const json reply = ask(robots, {{"service", "reactionless"},
                                  {"robot", "two"},
                                  {"locked_q", locked},
                                  {"from_q_rad", {0, 0.3, -1.2, 0.9, 0, 0.3, -1.2, 0.9}},
                                  {"to_q_rad", {0.6, 0.6, -0.8, 0.2, 0, 0.3, -1.2, 0.9}},
                                  {"to_pose", {{"frame", "left_link_7"}, {"directions", {"x", "y", "z"}}}},
                                  {"T_s", 8},
                                  {"particles", 16},
                                  {"rounds", 10}});
  ASSERT_TRUE(reply["reactionless"].get<bool>()) << reply["notes"];
  EXPECT_TRUE(reply["feasible"].get<bool>()) << reply["reason"];
  EXPECT_LT(reply["to_go"]["distance_m"].get<double>(), 1e-9);
  EXPECT_LT(reply["worst"]["turn"]["turn_rad"].get<double>(), 1e-12);
  EXPECT_GT(reply["standard"]["turn_rad"].get<double>(), 0.09);
}

TEST(Reactionless, SaysWhyThereIsNoneAndTurnsTheBaseLittleAtTheEnd) {
  Robots robots({robots_folder()});
  json question = near_question();
  question["from_q_rad"] = {0, 0, 0, 0, 0, 0, 0};  // stretched: no joint turns the base about x
  question["T_s"] = 4;
  const json singular = ask(robots, question);
  EXPECT_FALSE(singular["reactionless"].get<bool>());
  EXPECT_THAT(singular["notes"].dump(), HasSubstr("the first posture is singular"));
  question = near_question();
  question.erase("to_pose");
  question.update({{"locked_q", {{"joint_1", 0}, {"joint_3", 0}, {"joint_5", 0}, {"joint_7", 0}}},
                   {"from_q_rad", {0.5, -1, 0.6}},
                   {"to_q_rad", {0.9, -0.4, 0.2}},
                   {"T_s", 6}});
  const json three = ask(robots, question);
  EXPECT_FALSE(three["reactionless"].get<bool>());
  EXPECT_THAT(three["notes"].dump(), HasSubstr("3 joints turns the base"));
  EXPECT_LT(three["to_go"]["angle_rad"].get<double>(), 1e-6);
  EXPECT_LT(three["end"]["turn_rad"].get<double>(), three["standard"]["turn_rad"].get<double>());
}

TEST(Reactionless, TellsTheDriftOfARobotWithMomentum) {
  Robots robots({robots_folder()});
  json question = near_question();
  question.update({{"T_s", 5}, {"momentum", {{"linear_Ns", {0, 4.5, 0}}}}});
  const json reply = ask(robots, question);
  EXPECT_TRUE(reply["reactionless"].get<bool>());
  EXPECT_NEAR(reply["drift"]["displacement_m"][1].get<double>(), 5 * 4.5 / reply["mass_kg"].get<double>(), 1e-9);
  EXPECT_THAT(reply["notes"].dump(), HasSubstr("has momentum"));
}

TEST(Reactionless, RefusesWhatItCannotAnswer) {
  Robots robots({robots_folder()});
  const auto refusal = [&](const json& change) {
    json question = near_question();
    question.merge_patch(change);
    return testing::error_of([&] { ask(robots, question); });
  };
  EXPECT_THAT(refusal({{"to_q_rad", nullptr}}), HasSubstr("/to_q_rad: is missing, expected a posture, or p_m"));
  EXPECT_THAT(refusal({{"from_q_rad", {0, 2.5, 0, 0, 0, 0, 0}}}), HasSubstr("/from_q_rad/1: is 2.5, expected -2.09"));
  EXPECT_THAT(refusal({{"degree", 9}}), HasSubstr("/degree"));
  EXPECT_THAT(refusal({{"base", {{"mass_kg", -1}}}}), HasSubstr("/base/mass_kg"));
}

}  // namespace
}  // namespace cotwin::services::reactionless_test
