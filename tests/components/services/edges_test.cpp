// Services at the edges: files beside the URDF that do not fit, odd robots and moves, members without effect, free end postures.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "components/services/json/json.h"
#include "models/robot/frame_kinematics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/chain_urdf.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::services::edges_test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::Not;

std::string robots_folder() { return places::source() + "/models/robots"; }

json ask(Robots& robots, const json& request, const Context& context = {}) {
  return json::parse(answer(robots, request.dump(), context));
}

std::string refusal(Robots& robots, const json& request) {
  try {
    answer(robots, request.dump());
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

json lwr_move(const std::string& service) {
  json r{{"service", service},
         {"robot", "lwr4"},
         {"from_q_rad", {0, 0.5, 0, -1, 0, 0.6, 0}},
         {"to_q_rad", {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}}};
  if (service == "optimise") r.update({{"T_min_s", 2}, {"degree", 6}, {"particles", 16}, {"rounds", 8}});
  return r;
}

/// A disc that turns, or a fork that is lifted: "revolute" or "prismatic", with the axis z. `limit`: attributes of <limit>.
void write_robot(const std::filesystem::path& file, const std::string& type, const std::string& limit,
                 const std::string& axis = "0 0 1") {
  std::ofstream(file) << R"(<robot name="one"><link name="base"><inertial><mass value="3"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="part"><inertial><mass value="2"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.8" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="axis" type=")"
                      << type << R"("><parent link="base"/><child link="part"/><axis xyz=")" << axis << R"("/><limit )" << limit
                      << "/></joint></robot>";
}

std::string parameters(const std::string& rows, const std::string& units = "") {
  return R"(<ssv:ParameterSet version="1.0" name="x" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"><ssv:Parameters>
)" + rows +
         "</ssv:Parameters>" + units + "</ssv:ParameterSet>";
}

std::string real(const std::string& name, const std::string& value, const std::string& unit) {
  return "<ssv:Parameter name=\"" + name + "\"><ssv:Real value=\"" + value + "\" unit=\"" + unit + "\"/></ssv:Parameter>\n";
}

TEST(FilesBesideTheRobot, AreRefusedWithAForeignMeasureOrAnUnknownName) {
  const testing::TemporaryFolder folder("beside");
  write_robot(folder.path() / "wheel.urdf", "revolute", R"(lower="-3" upper="3" velocity="10" effort="5")");
  const json request{{"service", "jerk"}, {"robot", "wheel"}, {"from_q_rad", {0}}, {"to_q_rad", {1}}, {"T_s", 2}};
  const auto expect = [&](const char* file, const std::string& content, const std::string& part) {
    std::ofstream(folder.path() / file) << content;
    Robots robots({folder.path()});
    const std::string message = refusal(robots, request);
    if (part.empty()) {
      EXPECT_EQ(message, "");
    } else {
      EXPECT_THAT(message, HasSubstr(part));
    }
    std::filesystem::remove(folder.path() / file);
  };
  expect("drive_train.ssv", parameters(real("K", "1000", "N.m/rad")), "");
  expect("drive_train.ssv", parameters(real("K", "1000", "furlong")), "drive_train.ssv:3: K: is in furlong, expected N.m/rad");
  expect("drive_train.ssv", parameters(real("B[1]", "1", "N.m/rad")), "B[1]: is in N.m/rad, expected kg.m2");
  expect("drive_train.ssv", parameters(real("K", "1", "kN.m/rad")), "K: is in kN.m/rad, expected N.m/rad");
  expect("drive_train.ssv", parameters(real("tau_c", "1", "N.m")), "tau_c: is no parameter of unit:drive_train, expected one");
  const std::string thousand =
      R"(<ssv:Units><ssc:Unit name="N.m/rad"><ssc:BaseUnit kg="1" m="2" s="-2" rad="-1" factor="1000"/></ssc:Unit></ssv:Units>)";
  expect("drive_train.ssv", parameters(real("K", "1", "N.m/rad"), thousand), "defines with the factor 1000");
  expect("energy.ssv", parameters(real("P_0", "10", "V")), "P_0: is in V, expected W");
  expect("energy.ssv", parameters(real("P_idle", "10", "W")), "is no parameter of unit:energy");
  // A prismatic joint has both measures: that of the unit's variable is the revolute one beside revolute joints.
  write_robot(folder.path() / "wheel.urdf", "prismatic", R"(lower="0" upper="3" velocity="10" effort="500")");
  json lift = request;
  lift["from_q"] = lift["from_q_rad"];
  lift["to_q"] = lift["to_q_rad"];
  lift.erase("from_q_rad");
  lift.erase("to_q_rad");
  std::ofstream(folder.path() / "drive_train.ssv") << parameters(real("K", "1000", "N/m") + real("B", "1", "kg"));
  Robots robots({folder.path()});
  EXPECT_EQ(refusal(robots, lift), "");
}

// A disc of 0.8 kg m² on a vertical axis with the friction of its URDF; quintic of 1.5 rad in 2 s: ∫ q̇² dt = (10/7) 1.5²/2.
TEST(FrictionOfTheUrdf, CountsWithoutDriveTrainSsv) {
  const testing::TemporaryFolder folder("friction");
  const auto disc = [&](const std::string& name, const std::string& dynamics) {
    std::filesystem::create_directory(folder.path() / name);
    write_robot(folder.path() / name / "robot.urdf", "revolute", R"(lower="-3" upper="3" velocity="2" effort="7")" + dynamics);
  };
  const std::string dynamics = R"(/><dynamics damping="3" friction="1")";
  disc("plain", "");
  disc("rubs", dynamics);
  disc("known", dynamics);
  std::ofstream(folder.path() / "known/drive_train.ssv") << parameters(real("B", "0.1", "kg.m2"));
  Robots robots({folder.path()});
  const auto asked = [&](const std::string& robot, const std::string& service, double T) {
    return json{{"service", service}, {"robot", robot}, {"from_q_rad", {0}}, {"to_q_rad", {1.5}}, {"T_s", T}};
  };
  const double friction = 10.0 / 7 * 3 * 1.5 * 1.5 / 2 + 1.5;
  const json rubs = ask(robots, asked("rubs", "energy", 2)), plain = ask(robots, asked("plain", "energy", 2));
  EXPECT_NEAR(rubs["friction_J"].get<double>(), friction, 1e-9);
  EXPECT_NEAR(rubs["work_positive_J"].get<double>() + rubs["work_negative_J"].get<double>(), friction, 1e-9);
  EXPECT_EQ(plain["friction_J"], 0);
  // At the highest speed of 1.875 · 1.5 / 1.6 rad/s damping and friction take 6.27 N m, with the disc's inertia more than 7 N m before it.
  EXPECT_EQ(ask(robots, asked("plain", "feasibility", 1.6))["feasible"], true);
  const json verdict = ask(robots, asked("rubs", "feasibility", 1.6));
  EXPECT_EQ(verdict["feasible"], false);
  EXPECT_THAT(verdict["reason"].get<std::string>(), HasSubstr("joint axis: tau"));
  // Without the drives, and where drive_train.ssv rules, there is none.
  json without = asked("rubs", "energy", 2);
  without["drives"] = "none";
  EXPECT_EQ(ask(robots, without)["friction_J"], 0);
  EXPECT_EQ(ask(robots, asked("known", "energy", 2))["friction_J"], 0);
}

TEST(Notes, HaveWhatTheReaderOfTheUrdfWarnedOf) {
  const testing::TemporaryFolder folder("warned");
  write_robot(folder.path() / "wheel.urdf", "revolute", R"(lower="-3" upper="3" velocity="10" effort="5")", "0 0 2");
  Robots robots({folder.path()});
  const json request{{"service", "jerk"}, {"robot", "wheel"}, {"from_q_rad", {0}}, {"to_q_rad", {1}}, {"T_s", 2}};
  const json reply = ask(robots, request);
  ASSERT_EQ(reply["notes"].size(), 2U);  // the other one is of the drives
  EXPECT_THAT(reply["notes"][0].get<std::string>(), HasSubstr("axis of length 2 is normalised"));
  write_robot(folder.path() / "wheel.urdf", "revolute", R"(lower="-3" upper="3" velocity="10" effort="5")");
  Robots clean({folder.path()});
  EXPECT_EQ(ask(clean, request)["notes"].size(), 1U);
}

// Gravity needs nearly all of the torque, so that the friction of 8 N m is only met where it counts in part.
TEST(Notes, ExplainADurationThatIsFarLongerThanTheBoundsOfSpeedNeed) {
  Robots robots({robots_folder()});
  json request = lwr_move("cycle_time");
  request["tau_max_Nm"] = json(7, 36);
  const json slow = ask(robots, request);
  ASSERT_TRUE(slow["feasible"].get<bool>()) << slow;
  EXPECT_GT(slow["T_s"].get<double>(), 100);
  ASSERT_EQ(slow["notes"].size(), 2U);  // the second one tells of assumptions
  const std::string note = slow["notes"][0];
  EXPECT_THAT(note, HasSubstr("the motion creeps"));
  EXPECT_THAT(note, HasSubstr("joint_2"));
  EXPECT_THAT(note, HasSubstr("of 36 N m"));
  EXPECT_THAT(note, HasSubstr("a real robot would stand still"));
  request.erase("tau_max_Nm");
  EXPECT_THAT(ask(robots, request)["notes"].dump(), Not(HasSubstr("creeps")));
  // A duration that the request gives is not questioned.
  json timed = lwr_move("feasibility");
  timed["T_s"] = 500;
  EXPECT_THAT(ask(robots, timed)["notes"].dump(), Not(HasSubstr("creeps")));
  // A light, weak wheel is slow because of its inertia.
  const testing::TemporaryFolder folder("weak");
  write_robot(folder.path() / "wheel.urdf", "revolute", R"(lower="-3" upper="3" velocity="1000" effort="0.1")");
  Robots weak({folder.path()});
  const json heavy = ask(weak, {{"service", "cycle_time"}, {"robot", "wheel"}, {"from_q_rad", {-1}}, {"to_q_rad", {1}}});
  EXPECT_TRUE(heavy["feasible"].get<bool>());
  EXPECT_THAT(heavy["notes"].dump(), Not(HasSubstr("creeps")));
}

TEST(ServiceRequests, RefuseMembersWithoutEffect) {
  Robots robots({robots_folder()});
  const auto expect = [&](const std::string& service, const json& change, const std::string& part) {
    json request = lwr_move(service);
    request.update(change);
    EXPECT_THAT(refusal(robots, request), HasSubstr(part)) << request;
  };
  expect("optimise", {{"tolerance", 0.1}}, "/tolerance: is given, but has no effect without the rule lexicographic");
  expect("optimise", {{"directions", 5}}, "/directions: is given, but has no effect without the rule pareto");
  expect("optimise", {{"settle_s", 1}}, "/settle_s: is given, but has no effect without verify");
  expect("optimise", {{"bus", "grid"}}, "/bus: is given, but has no effect without the cost energy");
  expect("optimise", {{"rule", "lexicographic"}, {"cost", {{{"name", "torque"}, {"weight", 2}}}}},
         "/cost/0/weight: is given, but has no effect without the rule weighted");
  expect("energy", {{"T_s", 2}, {"T_max_s", 5}}, "/T_max_s: is given, but has no effect without best");
  expect("energy", {{"robot", "planar2"}, {"from_q_rad", {0, 0}}, {"to_q_rad", {1, 1}}, {"T_s", 2}, {"price_per_kWh", 1}},
         "/price_per_kWh: is given, but has no effect without an energy.ssv");
}

TEST(ServiceRequests, BoundTheDuration) {
  Robots robots({robots_folder()});
  const auto expect = [&](const std::string& service, const json& change, const std::string& part) {
    json request = lwr_move(service);
    request.update(change);
    EXPECT_THAT(refusal(robots, request), HasSubstr(part)) << request;
  };
  for (const double T : {1e-5, 9.9e-5, 1.0001e4, 1e300}) {
    expect("feasibility", {{"T_s", T}}, "/T_s: is ");
    expect("optimise", {{"T_min_s", T}}, "expected 0.0001 to 10000 s");
    expect("optimise", {{"T_min_s", 1e-4}, {"T_max_s", T < 1 ? 1e5 : T}}, "/T_max_s: is ");
    expect("energy", {{"best", true}, {"T_max_s", T}}, "expected 0.0001 to 10000 s");
  }
  for (const double T : {1e-4, 1e4}) {
    json request = lwr_move("feasibility");
    request["T_s"] = T;
    EXPECT_EQ(ask(robots, request)["feasible"], T > 1);
  }
}

/// All services on one robot, which have to answer with finite numbers or null, or to refuse.
void answers_everything(Robots& robots, const json& move, const std::string& except = "") {
  Context context;
  for (const std::string& service : service_names()) {
    if (service == "verify" || service == except) continue;
    json request = move;
    request["service"] = service;
    if (service == "throughput") request.update({{"M_kg", 1}, {"S_N_per_m", 500}, {"zeta", 1}});
    if (service == "cycle_time" || service == "optimise") request.erase("T_s");
    if (service == "optimise")
      request.update({{"T_min_s", move.value("T_s", 1.0)}, {"particles", 8}, {"rounds", 4}, {"degree", 6}});
    if (service == "grow") {
      request.erase("T_s");
      request.update({{"T_min_s", move.value("T_s", 1.0)}, {"motions", 20}});
    }
    if (service == "reactionless") request.update({{"particles", 8}, {"rounds", 1}});
    if (service == "reactionless" && request.value("to_q_rad", json::array()).size() > 1) {
      for (std::size_t j = 0; j < request["to_q_rad"].size(); ++j)
        request["to_q_rad"][j] = 0.9 * request["from_q_rad"][j].get<double>() + 0.1 * request["to_q_rad"][j].get<double>();
      request["to_pose"]["directions"] = {"z"};
    }
    if (service == "reach") {
      for (const char* other : {"to_q_rad", "to_q", "T_s"}) request.erase(other);
      request.update({{"directions", {"x", "z"}}, {"poses", {{{"p_m", {0.5, 0, 0.5}}, {"quaternion_wxyz", {1, 0, 0, 0}}}}}});
    }
    request["detail"] = "all";
    const std::string text = answer(robots, request.dump(), context);
    EXPECT_THAT(text, Not(HasSubstr("nan"))) << request;
    EXPECT_FALSE(json::parse(text).empty());
  }
}

TEST(ServiceRequests, AnswerMovesOfOneJointAndMovesThatStandStill) {
  const testing::TemporaryFolder folder("single");
  write_robot(folder.path() / "wheel.urdf", "revolute", R"(lower="-3" upper="3" velocity="10" effort="50")");
  write_robot(folder.path() / "lift.urdf", "prismatic", R"(lower="0" upper="2" velocity="1" effort="100")");
  Robots robots({folder.path(), robots_folder()});
  for (const double to : {1.0, 0.0}) {
    answers_everything(robots, {{"robot", "wheel"}, {"from_q_rad", {0}}, {"to_q_rad", {to}}, {"T_s", 2}}, "safety");
    answers_everything(robots, {{"robot", "lift"}, {"from_q", {0}}, {"to_q", {to}}, {"T_s", 2}}, "safety");
  }
  json still = lwr_move("feasibility");
  still["to_q_rad"] = still["from_q_rad"];
  still["T_s"] = 1;
  answers_everything(robots, still);
  still.erase("T_s");
  still["service"] = "cycle_time";
  const json reply = ask(robots, still);
  EXPECT_TRUE(reply["feasible"].get<bool>());
  EXPECT_EQ(reply["T_s"], 1e-3);
  // Locked joints.
  answers_everything(robots, {{"robot", "lwr4"},
                              {"locked_q", {{"joint_1", 0}, {"joint_3", 0}, {"joint_5", 0}, {"joint_7", 0}}},
                              {"from_q_rad", {0.5, -1, 0.6}},
                              {"to_q_rad", {0.2, -0.5, 0.2}},
                              {"T_s", 2}});
}

TEST(ServiceRequests, AnswerTheShortestAndTheLongestDuration) {
  Robots robots({robots_folder()});
  for (const double T : {1e-4, 1e4}) {
    json move = lwr_move("feasibility");
    move["T_s"] = T;
    answers_everything(robots, move);
  }
}

TEST(OrderOfCosts, KeepsEachCostWithinTheToleranceOfItsOptimum) {
  Robots robots({robots_folder()});
  for (const double tolerance : {0.0, 1e-6, 0.01, 0.2}) {
    json request = lwr_move("optimise");
    request.update({{"rounds", 20},
                    {"cost", {{{"name", "torque"}}, {{"name", "jerk"}}}},
                    {"rule", "lexicographic"},
                    {"tolerance", tolerance}});
    const json both = ask(robots, request);
    ASSERT_EQ(both["status"], "feasible") << both["reason"];
    json first = request;
    first.update({{"cost", {{{"name", "torque"}}}}});
    const double optimum = ask(robots, first)["costs"]["torque_squared_integral"];
    EXPECT_LE(both["costs"]["torque_squared_integral"].get<double>(), optimum * (1 + tolerance) * (1 + 1e-9)) << tolerance;
    if (tolerance == 0.2) {
      first.update({{"detail", "all"}});
      const json alone = ask(robots, first);
      json jerk = lwr_move("jerk");
      jerk.update({{"T_s", alone["T_s"]}, {"degree", 6}, {"c_r_rad", alone["motion"]["c_r_rad"]}});
      EXPECT_LT(both["costs"]["jerk_squared_integral"].get<double>(),
                ask(robots, jerk)["jerk_squared_integral_rad2_per_s5"].get<double>());
    }
  }
}

TEST(Progress, RisesAndEndsAtOneAlsoForSearchesThatEndEarly) {
  Robots robots({robots_folder()});
  for (const json& change :
       {json{{"rounds", 20}}, json{{"rounds", 1000}, {"evaluations_max", 200}}, json{{"to_pose", json::object()}},
        json{{"rule", "lexicographic"}, {"cost", {{{"name", "torque"}}, {{"name", "jerk"}}}}},
        json{{"rule", "pareto"}, {"directions", 2}, {"cost", {{{"name", "torque"}}, {{"name", "jerk"}}}}}}) {
    std::vector<double> told;
    Context context;
    context.progress = [&](double share, const std::string&) { told.push_back(share); };
    json request = lwr_move("optimise");
    request.update(change);
    answer(robots, request.dump(), context);
    ASSERT_FALSE(told.empty());
    for (std::size_t i = 1; i < told.size(); ++i) EXPECT_GT(told[i], told[i - 1]);
    EXPECT_EQ(told.back(), 1) << change;
  }
}

robot::FrameMotion pose_of(const robot::RobotModel& robot, const std::vector<double>& q) {
  robot::FrameKinematics kinematics(robot, robot.end_effector());
  Eigen::MatrixXd J(6, robot.n());
  return kinematics.jacobian(Eigen::Map<const Eigen::VectorXd>(q.data(), robot.n()), J);
}

TEST(ToPose, FindsACheaperEndOfTheSamePose) {
  Robots robots({robots_folder()});
  json request = lwr_move("optimise");
  request.update({{"to_q_rad", {0.6, 0.7, 0.3, -1.2, 0.4, 0.8, 0.2}},
                  {"T_min_s", 1.5},
                  {"particles", 32},
                  {"rounds", 40},
                  {"drives", "none"}});
  const double fixed = ask(robots, request)["cost"];
  const robot::RobotModel& robot = robots.find("lwr4")->model;
  const robot::FrameMotion goal = pose_of(robot, request["to_q_rad"].get<std::vector<double>>());
  const auto expect_goal = [&](const json& reply) {
    ASSERT_EQ(reply["status"], "feasible") << reply["reason"];
    EXPECT_LT(reply["cost"].get<double>(), 0.995 * fixed);
    const robot::FrameMotion end = pose_of(robot, reply["motion"]["q_end_rad"].get<std::vector<double>>());
    EXPECT_LT((end.p - goal.p).norm(), 1e-9);
    EXPECT_LT(1 - std::abs(end.Q.dot(goal.Q)), 1e-12);
  };
  request["to_pose"] = json::object();
  expect_goal(ask(robots, request));
  // The same pose by its numbers, from another posture near it.
  request["to_q_rad"] = {0.5, 0.8, 0.2, -1.1, 0.5, 0.7, 0.3};
  request["to_pose"] = {{"p_m", {goal.p.x(), goal.p.y(), goal.p.z()}},
                        {"quaternion_wxyz", {goal.Q.w(), goal.Q.x(), goal.Q.y(), goal.Q.z()}}};
  expect_goal(ask(robots, request));
}

TEST(ToPose, IsSearchedWithEachRule) {
  Robots robots({robots_folder()});
  json request = lwr_move("optimise");
  request.update({{"to_q_rad", {0.6, 0.7, 0.3, -1.2, 0.4, 0.8, 0.2}},
                  {"degree", 6},
                  {"T_min_s", 1.5},
                  {"particles", 16},
                  {"rounds", 16},
                  {"drives", "none"},
                  {"to_pose", json::object()},
                  {"rule", "lexicographic"},
                  {"tolerance", 0.1},
                  {"cost", {{{"name", "torque"}}, {{"name", "acceleration"}}}}});
  const robot::RobotModel& robot = robots.find("lwr4")->model;
  const robot::FrameMotion goal = pose_of(robot, request["to_q_rad"].get<std::vector<double>>());
  const auto expect_goal = [&](const json& motion) {
    const robot::FrameMotion end = pose_of(robot, motion["q_end_rad"].get<std::vector<double>>());
    EXPECT_LT((end.p - goal.p).norm(), 1e-9);
  };
  const json ordered = ask(robots, request);
  ASSERT_EQ(ordered["status"], "feasible") << ordered;
  expect_goal(ordered["motion"]);
  request.erase("tolerance");
  request.update({{"rule", "pareto"}, {"directions", 3}, {"refine", false}});
  const json front = ask(robots, request)["front"];
  ASSERT_GT(front.size(), 1u);
  json ends = json::array();
  for (const json& member : front) {
    expect_goal(member["motion"]);
    ends.push_back(member["motion"]["q_end_rad"]);
  }
  EXPECT_NE(ends, json::array({ends[0]}));
}

TEST(ToPose, IsRefusedWhereItCannotBeSearched) {
  Robots robots({robots_folder()});
  const auto expect = [&](const json& pose, const std::string& part, const json& change = json::object()) {
    json request = lwr_move("optimise");
    request["to_pose"] = pose;
    request.update(change);
    EXPECT_THAT(refusal(robots, request), HasSubstr(part)) << pose;
  };
  expect({{"p_m", {9, 0, 0}}, {"quaternion_wxyz", {1, 0, 0, 0}}}, "/to_pose: is not reached");
  expect({{"p_m", {0.3, 0, 0.5}}}, "/to_pose/quaternion_wxyz: is missing");
  expect({{"p_m", {0.3, 0}}, {"quaternion_wxyz", {1, 0, 0, 0}}}, "/to_pose/p_m: has 2 values, expected 3");
  expect({{"p_m", {0.3, 0, 0.5}}, {"quaternion_wxyz", {1, 1, 0, 0}}}, "/to_pose/quaternion_wxyz: has the norm");
  expect({{"frame", "hand"}}, "/to_pose/frame");
  expect({{"directions", {"up"}}}, "/to_pose/directions");
  expect({{"directions", {"x", "y", "z"}}}, "/to_pose/directions: leaves 4 directions");
  expect({{"q", 1}}, "/to_pose/q");
  expect(3, "/to_pose");
}

TEST(ToPose, SaysThatARobotWithoutRedundancyHasNoChoice) {
  Robots robots({robots_folder()});
  json request{{"service", "optimise"}, {"robot", "ur5e"}, {"T_min_s", 3}, {"degree", 6}, {"particles", 8}, {"rounds", 4}};
  request["from_q_rad"] = {0, -1, 1, -1, -1, 0};
  request["to_q_rad"] = {0.3, -1.2, 1.4, -0.9, -1.3, 0.5};
  request["to_pose"] = json::object();
  const json reply = ask(robots, request);
  EXPECT_THAT(reply["notes"].dump(), HasSubstr("no freedom"));
  for (std::size_t j = 0; j < 6; ++j)
    EXPECT_NEAR(reply["motion"]["q_end_rad"][j].get<double>(), request["to_q_rad"][j].get<double>(), 1e-9);
  request["to_pose"] = {{"directions", {"x", "y", "z", "rx", "ry"}}, {"axes", "tool"}};
  EXPECT_THAT(ask(robots, request)["notes"].dump(), Not(HasSubstr("freedom")));
}

// e^(−x) (1 + x) = 0.02 at x = 5.834 for ζ = 1: with ω ≤ 20 rad/s the time is 5.834/20 s. Less damping settles sooner.
TEST(Compliance, IsSearchedWithTheMotion) {
  Robots robots({robots_folder()});
  json request = lwr_move("optimise");
  json wanted{{"M_kg", {1, 4}}, {"D_Ns_per_m", {1, 1000}},   {"S_N_per_m", {100, 5000}},
              {"zeta_min", 1},  {"omega_max_rad_per_s", 20}, {"T_process_s", 0.5}};
  request["compliance"] = wanted;
  const json reply = ask(robots, request);
  const json& found = reply["compliance"];
  ASSERT_TRUE(found["feasible"].get<bool>()) << reply;
  EXPECT_NEAR(found["T_settle_s"].get<double>(), 5.834 / 20, 1e-3);
  EXPECT_NEAR(found["zeta"].get<double>(), 1, 1e-3);
  EXPECT_LE(found["omega_rad_per_s"].get<double>(), 20 * (1 + 1e-8));
  EXPECT_NEAR(found["T_cycle_s"].get<double>(), 2 + 0.5 + found["T_settle_s"].get<double>(), 1e-9);
  EXPECT_NEAR(found["moves_per_hour"].get<double>(), 3600 / found["T_cycle_s"].get<double>(), 1e-9);
  EXPECT_EQ(ask(robots, request), reply);  // the same bits
  request["compliance"].erase("zeta_min");
  EXPECT_LT(ask(robots, request)["compliance"]["T_settle_s"].get<double>(), 0.7 * 5.834 / 20);
  // No parameters within the ranges are damped enough.
  request["compliance"]["D_Ns_per_m"] = 1;
  request["compliance"]["zeta_min"] = 1;
  const json none = ask(robots, request);
  EXPECT_EQ(none["status"], "feasible");
  EXPECT_FALSE(none["feasible"].get<bool>());
  EXPECT_THAT(none["reason"].get<std::string>(), HasSubstr("compliance: no parameters within the ranges"));
  for (const char* name : {"M_kg", "D_Ns_per_m", "S_N_per_m", "zeta", "T_settle_s", "T_cycle_s", "moves_per_hour"})
    EXPECT_TRUE(none["compliance"][name].is_null()) << name;
  const auto expect = [&](const json& change, const std::string& part) {
    json bad = request;
    bad["compliance"] = wanted;
    bad["compliance"].update(change);
    EXPECT_THAT(refusal(robots, bad), HasSubstr(part));
  };
  expect({{"M_kg", {4, 1}}}, "/compliance/M_kg: is [4,1], expected 0 < least <= most");
  expect({{"M_kg", {1, 2, 3}}}, "/compliance/M_kg: has 3 values");
  expect({{"S_N_per_m", nullptr}}, "/compliance/S_N_per_m");
  expect({{"settled_share", 2}}, "/compliance/settled_share");
  expect({{"K", 2}}, "/compliance/K");
}

TEST(Compliance, OfAxesIsSearchedTogetherWithTheMotion) {
  Robots robots({robots_folder()});
  json request = lwr_move("optimise");
  request.update({{"T_min_s", 1},
                  {"T_max_s", 3},
                  {"degree", 7},
                  {"particles", 32},
                  {"rounds", 24},
                  {"refine", false},
                  {"cost", "cycle_time"}});
  const json axis{{"direction", {1, 0, 0}}, {"M_kg", 2}, {"D_Ns_per_m", {10, 400}}, {"S_N_per_m", {500, 3000}}};
  const json wanted{{"axes", {axis, {{"direction", {0, 0, 2}}, {"M_kg", 3}, {"D_Ns_per_m", {10, 400}}, {"S_N_per_m", 1000}}}},
                    {"load_kg", 2},
                    {"settled_m", 2e-4},
                    {"zeta_min", 0.4},
                    {"T_process_s", 0.5}};
  request["compliance"] = wanted;
  const json reply = ask(robots, request);
  ASSERT_EQ(reply["status"], "feasible") << reply;
  const json& found = reply["compliance"];
  ASSERT_EQ(found["axes"].size(), 2u);
  EXPECT_EQ(found["axes"][1]["direction"], json({0.0, 0.0, 1.0}));
  double settle = 0;
  for (const json& one : found["axes"]) {
    settle = std::max(settle, one["T_settle_s"].get<double>());
    EXPECT_GE(one["zeta"].get<double>(), 0.4 * (1 - 1e-6));
    EXPECT_GT(one["deflection_m"].get<double>(), 2e-4);
  }
  EXPECT_EQ(found["T_settle_s"].get<double>(), settle);
  EXPECT_NEAR(reply["costs"]["cycle_time_s"].get<double>(), reply["T_s"].get<double>() + settle + 0.5, 1e-12);
  EXPECT_NEAR(found["T_cycle_s"].get<double>(), reply["cost"].get<double>(), 1e-12);
  // The quintic of the same duration with the same compliance swings longer.
  EXPECT_GT(reply["quintic"]["costs"]["cycle_time_s"].get<double>(), reply["cost"].get<double>());
  EXPECT_EQ(ask(robots, request), reply);  // the same bits

  request["compliance"]["deflection_max_m"] = 1e-6;
  request["rounds"] = 2;
  const json none = ask(robots, request);
  EXPECT_FALSE(none["feasible"].get<bool>());
  EXPECT_THAT(none["reason"].get<std::string>(), HasSubstr("compliance: axis 1: deflection"));
  EXPECT_FALSE(none["compliance"]["feasible"].get<bool>());
  EXPECT_TRUE(none["compliance"]["T_cycle_s"].is_null());
  const auto expect = [&](const json& change, const std::string& part) {
    json bad = request;
    bad["compliance"] = wanted;
    bad["compliance"].update(change);
    EXPECT_THAT(refusal(robots, bad), HasSubstr(part));
  };
  expect({{"axes", json::array()}}, "/compliance/axes: expected an array of one to three axes");
  expect({{"axes", {{{"direction", {0, 0, 0}}}}}}, "/compliance/axes/0/direction: expected three numbers");
  expect({{"axes", {{{"direction", {1, 0, 0}}}}}}, "/compliance/axes/0/M_kg: is missing");
  expect({{"load_kg", 0}}, "/compliance/load_kg");
  expect({{"settled_share", 0.1}}, "/compliance/settled_share");
  expect({{"frame", "hand"}}, "/compliance/frame");
  request.erase("compliance");
  EXPECT_THAT(refusal(robots, request), HasSubstr("/cost: is cycle_time or stiffness, but no compliance is searched"));
}

TEST(ARobotOf30Joints, IsAnsweredLikeOthers) {
  const testing::TemporaryFolder folder("chain");
  std::ofstream(folder.path() / "chain.urdf") << testing::chain_urdf(30);
  Robots robots({folder.path()});
  std::vector<double> from(30), to(30);
  for (std::size_t j = 0; j < 30; ++j) {
    from[j] = 0.1 * std::sin(static_cast<double>(j));
    to[j] = 0.15 * std::cos(1.3 * static_cast<double>(j));
  }
  json request{{"robot", "chain"}, {"from_q_rad", from}, {"to_q_rad", to}};
  const auto of = [&](const std::string& service, const json& more) {
    json own = request;
    own["service"] = service;
    own.update(more);
    return ask(robots, own);
  };
  const json shortest = of("feasibility", json::object());
  ASSERT_TRUE(shortest["feasible"].get<bool>()) << shortest;
  const double T = shortest["T_s"];
  EXPECT_FALSE(of("feasibility", {{"T_s", 0.99 * T}})["feasible"].get<bool>());
  EXPECT_TRUE(of("feasibility", {{"T_s", 1.01 * T}})["feasible"].get<bool>());
  // Without friction the joints' work is what the links were lifted by: their centres at both ends, by forward kinematics.
  const robot::RobotModel robot = robot::load_urdf(folder.path() / "chain.urdf");
  const auto potential = [&](const std::vector<double>& q) {
    const robot::Mechanism mechanism(robot);
    robot::Data data(mechanism);
    double sum = 0;
    for (int body = 0; body < 30; ++body)
      sum += 0.5 * 9.81 *
             robot::forward_kinematics(mechanism, data, Eigen::Map<const Eigen::VectorXd>(q.data(), 30),
                                       {body, {Eigen::Matrix3d::Identity(), Eigen::Vector3d(0, 0, 0.05)}})
                 .p.z();
    return sum;
  };
  const json energy = of("energy", {{"T_s", 1.5 * T}});
  const double lifted = potential(to) - potential(from);
  ASSERT_GT(std::abs(lifted), 0.1);
  EXPECT_NEAR(energy["work_positive_J"].get<double>() + energy["work_negative_J"].get<double>(), lifted,
              1e-3 * std::abs(lifted));
  const json better =
      of("optimise", {{"T_min_s", 1.5 * T}, {"degree", 6}, {"particles", 32}, {"rounds", 60}, {"refine", false}});
  ASSERT_EQ(better["status"], "feasible") << better["reason"];
  EXPECT_LT(better["cost"].get<double>(), 0.995 * better["quintic"]["cost"].get<double>());
}

TEST(Optimise, HasTheMassAndTheSafetyOfTheirServices) {
  Robots robots({robots_folder()});
  json request = lwr_move("optimise");
  request.update({{"T_min_s", 2}, {"degree", 6}, {"particles", 32}, {"rounds", 12}, {"refine", false}});
  request["cost"] = {{{"name", "effective_mass"}}, {{"name", "safety"}, {"weight", 10}}};
  request.update({{"direction", {0, 0, 3}}, {"motors", "held"}, {"parts", {"chest"}}});
  const json reply = ask(robots, request);
  ASSERT_EQ(reply["status"], "feasible") << reply;
  EXPECT_LE(reply["cost"].get<double>(), reply["quintic"]["cost"].get<double>());
  json along = lwr_move("safety");
  along.update({{"T_s", 2}, {"degree", 6}, {"direction", {0, 0, 1}}, {"motors", "held"}, {"parts", {"chest"}}});
  along["c_r_rad"] = reply["motion"]["c_r_rad"];
  const json safety = ask(robots, along);
  EXPECT_NEAR(reply["costs"]["effective_mass_kg"].get<double>(), safety["heaviest"]["mass_kg"].get<double>(),
              1e-2 * safety["heaviest"]["mass_kg"].get<double>());
  EXPECT_NEAR(reply["costs"]["safety_share"].get<double>(), safety["parts"][0]["share"].get<double>(),
              1e-3 * safety["parts"][0]["share"].get<double>());
  const auto expect = [&](const json& change, const std::string& part) {
    json bad = request;
    bad.update(change);
    EXPECT_THAT(refusal(robots, bad), HasSubstr(part));
  };
  expect({{"cost", "torque"}}, "/direction: is given, but has no effect without the cost effective_mass or safety");
  expect({{"cost", "effective_mass"}}, "/parts: is given, but has no effect without the cost safety");
  expect({{"frame", "hand"}}, "/frame");
  expect({{"parts", {"skull_and_forehead"}}}, "/parts");
}

}  // namespace
}  // namespace cotwin::services::edges_test
