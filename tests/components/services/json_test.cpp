// Requests and replies of services as JSON: schemas against actual replies, closed forms, robots of other kinds, damaged requests.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>
#include <regex>

#include "components/services/contact_service.h"
#include "components/services/energy_service.h"
#include "components/services/json/json.h"
#include "models/robot/indices.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::services::json_test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

std::string robots_folder() { return places::source() + "/models/robots"; }

/// The first place at which `value` does not fit a schema of the keywords that schemas.cpp uses; "" if it fits.
std::string misfit(const json& schema, const json& value, const std::string& at = "") {
  const auto is = [&](const std::string& type) {
    return type == "number"    ? value.is_number()
           : type == "integer" ? value.is_number_integer()
           : type == "string"  ? value.is_string()
           : type == "boolean" ? value.is_boolean()
           : type == "null"    ? value.is_null()
           : type == "array"   ? value.is_array()
                               : type == "object" && value.is_object();
  };
  if (schema.contains("type")) {
    const json& types = schema["type"];
    const bool fits = types.is_string() ? is(types) : std::ranges::any_of(types, [&](const json& t) { return is(t); });
    if (!fits) return at + " is " + value.type_name() + ", expected " + types.dump();
  }
  if (schema.contains("const") && value != schema["const"]) return at + " const";
  if (schema.contains("enum") && std::ranges::find(schema["enum"], value) == schema["enum"].end()) return at + " enum";
  if (value.is_number()) {
    if (schema.contains("minimum") && value < schema["minimum"]) return at + " minimum";
    if (schema.contains("exclusiveMinimum") && value <= schema["exclusiveMinimum"]) return at + " exclusiveMinimum";
    if (schema.contains("maximum") && value > schema["maximum"]) return at + " maximum";
  }
  if (value.is_array() && schema.contains("items"))
    for (std::size_t i = 0; i < value.size(); ++i)
      if (const std::string m = misfit(schema["items"], value[i], at + "/" + std::to_string(i)); !m.empty()) return m;
  if (value.is_array() && value.size() < schema.value("minItems", 0U)) return at + " minItems";
  for (const json& own : schema.value("allOf", json::array()))
    if (const std::string m = misfit(own, value, at); !m.empty()) return m;
  if (schema.contains("anyOf") &&
      std::ranges::none_of(schema["anyOf"], [&](const json& own) { return misfit(own, value, at).empty(); }))
    return at + " fits none of " + schema["anyOf"].dump();
  if (!value.is_object()) return "";
  for (const json& name : schema.value("required", json::array()))
    if (!value.contains(name)) return at + " lacks " + name.dump();
  for (const auto& [name, member] : value.items()) {
    const json* own = nullptr;
    if (schema.contains("properties") && schema["properties"].contains(name)) own = &schema["properties"][name];
    if (!own && schema.contains("patternProperties"))
      for (const auto& [pattern, type] : schema["patternProperties"].items())
        if (std::regex_search(name, std::regex(pattern))) own = &type;
    if (!own && schema.contains("additionalProperties")) {
      if (schema["additionalProperties"] == false) return at + " has the unknown member " + name;
      own = &schema["additionalProperties"];
    }
    if (!own) continue;
    if (const std::string m = misfit(*own, member, at + "/" + name); !m.empty()) return m;
  }
  return "";
}

json ask(Robots& robots, const json& request) { return json::parse(answer(robots, request.dump())); }

std::string refusal(Robots& robots, const std::string& request) {
  try {
    answer(robots, request);
  } catch (const std::exception& e) {
    return e.what();
  }
  return "";
}

json lwr_move(const std::string& service) {
  json r{{"service", service},
         {"robot", "lwr4"},
         {"from_q_rad", {0, 0.5, 0, -1, 0, 0.6, 0}},
         {"to_q_rad", {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}}};
  if (service == "reactionless")
    r.update({{"to_q_rad", {0.05, 0.55, 0, -1.05, 0, 0.6, 0}},
              {"to_pose", {{"directions", {"z"}}}},
              {"base", {{"mass_kg", 100}, {"inertia_kg_m2", {9, 0, 0, 9, 0, 9}}}},
              {"particles", 8},
              {"rounds", 4}});
  if (service == "reaction" || service == "reactionless") r["momentum"] = {{"angular_Nms", {0, 0, 0.1}}};
  if (service == "throughput") r.update({{"M_kg", 1}, {"S_N_per_m", {500, 1500}}, {"zeta", 1}});
  if (service == "optimise") r.update({{"T_min_s", 2}, {"degree", 7}, {"particles", 8}, {"rounds", 4}});
  if (service == "grow") r.update({{"T_min_s", 1}, {"T_max_s", 3}, {"motions", 100}});
  if (service == "payload") r["T_s"] = 2;
  if (service == "reach") {
    r.erase("to_q_rad");
    r["poses"] = {{{"p_m", {0.4, 0.2, 0.6}}, {"quaternion_wxyz", {1, 0, 0, 0}}},
                  {{"p_m", {2, 0, 0}}, {"quaternion_wxyz", {1, 0, 0, 0}}}};
  }
  return r;
}

/// A twin that gives back what it was asked for.
Verification echo(const Robot& robot, const Move&, double T, const VerificationOptions& options) {
  Verification v;
  v.T = T;
  v.settle = options.settle;
  const std::size_t n = robot.model.joints.size();
  for (auto* x : {&v.tracking, &v.end_error, &v.tau, &v.tau_rigid, &v.dq, &v.tau_limit}) x->assign(n, 1);
  return v;
}

TEST(ServiceSchemas, FitEveryReplyAtEveryLevelOfDetailAndEveryRequest) {
  Robots robots({robots_folder()});
  Context context;
  context.verify = echo;
  for (const std::string& service : service_names()) {
    const json both = json::parse(schema(service));
    for (const char* detail : {"verdict", "margins", "series", "all"}) {
      json request = lwr_move(service);
      request["detail"] = detail;
      if (service == "feasibility" || service == "cycle_time" || service == "verify" || service == "optimise")
        request["clear_of"] = {
            {"scene", "table"},
            {"clearance_m", 0.01},
            {"self", true},
            {"ignore", {"link_1:table"}},
            {"base", {{"p_m", {0, 0, 0.4}}}},
            {"robots",
             {{{"robot", "planar2"}, {"name", "post"}, {"base", {{"p_m", {2, 0, 0}}}}, {"q_rad", {0, 0}}},
              {{"robot", "planar2"}, {"series", {{"t_s", {0, 1, 2}}, {"q_rad", {{0, 0}, {0.1, 0}, {0, 0}}}}}}}}};
      if (service == "energy") request.update({{"best", true}, {"cycle_s", 6}, {"price_per_kWh", 0.3}});
      EXPECT_EQ(misfit(both["request"], request), "") << request;
      const std::string reply_text = answer(robots, request.dump(), context);
      const json reply = json::parse(reply_text);
      EXPECT_EQ(misfit(both["reply"], reply), "") << service << " " << detail;
      EXPECT_EQ(answer(robots, request.dump(), context), reply_text);
      request["surprise"] = 1;
      EXPECT_NE(misfit(both["request"], request), "");
    }
  }
  EXPECT_THROW(schema("dance"), Error);
}

TEST(ServiceSchemas, FitMovesThatAreNotPossibleAndEveryRule) {
  Robots robots({robots_folder()});
  const auto fits = [&](const std::string& service, const json& change) {
    json request = lwr_move(service);
    request.update(change);
    const json both = json::parse(schema(service));
    EXPECT_EQ(misfit(both["request"], request), "") << request;
    EXPECT_EQ(misfit(both["reply"], ask(robots, request)), "") << request;
  };
  const json beyond{{"to_q_rad", {1.2, -0.2, 0.4, 3, -0.5, -0.3, 0.8}}};
  for (const char* service : {"feasibility", "cycle_time"}) fits(service, beyond);
  json timed = beyond;
  timed["T_s"] = 0.1;
  for (const std::string& service : service_names())
    if (service != "cycle_time" && service != "optimise" && service != "grow" && service != "verify" && service != "reach")
      fits(service, service == "reactionless" ? json{{"T_s", 0.1}} : timed);
  fits("optimise", {{"T_min_s", 0.1}, {"detail", "all"}});
  fits("grow", {{"T_min_s", 0.1}, {"T_max_s", 0.1}, {"detail", "all"}});
  const json two{{{"name", "torque"}}, {{"name", "jerk"}}};
  for (const char* rule : {"weighted", "lexicographic", "pareto"}) fits("optimise", {{"cost", two}, {"rule", rule}});
  fits("optimise", {{"cost", two}, {"rule", "pareto"}, {"T_min_s", 0.1}});
  fits("optimise", {{"degree", 31}, {"refine", false}});
}

// In all services that take them.
TEST(ServiceSchemas, FitLoadsPathsAndEndsInMotion) {
  Robots robots({robots_folder()});
  Context context;
  context.verify = echo;
  const json payload{{"mass_kg", 1}, {"com_m", {0, 0, 0.1}}, {"inertia_kg_m2", {0.01, 0, 0, 0.01, 0, 0.01}}},
      postures{{"t_s", {0, 2}}, {"q_rad", {lwr_move("jerk")["from_q_rad"], lwr_move("jerk")["to_q_rad"]}}};
  const std::map<std::string, json> members{
      {"payload", json::array({payload, {{"name", "part"}, {"frame", "link_5"}, {"mass_kg", 2}}})},
      {"wrench", {{"force_N", {1, 2, 3}}, {"moment_Nm", {1, 2, 3}}, {"axes", "frame"}, {"from_share", 0.1}, {"to_share", 0.2}}},
      {"dq_to_rad_per_s", {0.1, 0, 0, 0, 0, 0, 0}},
      {"waypoints", postures},
      {"series", postures}};
  std::map<std::string, std::size_t> taken;
  for (const std::string& service : service_names())
    for (const auto& [name, value] : members) {
      const json both = json::parse(schema(service));
      if (!both["request"]["properties"].contains(name)) continue;
      ++taken[name];
      json request = lwr_move(service);
      if (name == "waypoints" || name == "series")
        for (const char* other : {"from_q_rad", "to_q_rad", "T_s"}) request.erase(other);
      if (name == "dq_to_rad_per_s" && service != "optimise") request["T_s"] = 2;
      request["detail"] = "all";
      request[name] = value;
      EXPECT_EQ(misfit(both["request"], request), "") << service << name;
      const json reply = json::parse(answer(robots, request.dump(), context));
      EXPECT_EQ(misfit(both["reply"], reply), "") << service << name;
    }
  EXPECT_EQ(taken["payload"], service_names().size() - 1);  // all but reach
  EXPECT_EQ(taken["series"], 10U);
}

TEST(ServiceSchemas, RequireWhatTheServicesRequire) {
  const auto refuses = [&](const std::string& service, const char* without, const json& change = json::object()) {
    json request = lwr_move(service);
    request.erase(without);
    request.update(change);
    EXPECT_NE(misfit(json::parse(schema(service))["request"], request), "") << request;
  };
  refuses("feasibility", "from_q_rad");
  refuses("energy", "to_q_rad");
  refuses("throughput", "zeta");
  refuses("optimise", "cost", {{"cost", json::array()}});
}

// The reader and the schema must have the same members: an unknown one lists those that were read.
TEST(ServiceSchemas, HaveTheMembersThatTheServicesRead) {
  Robots robots({robots_folder()});
  for (const std::string& service : service_names()) {
    json request = lwr_move(service);
    request["surprise"] = 1;
    const std::string message = refusal(robots, request.dump());
    const std::size_t list = message.find("expected one of ");
    ASSERT_NE(list, std::string::npos) << service << message;
    const json properties = json::parse(schema(service))["request"]["properties"];
    std::string known = message.substr(list + 16) + ", ";
    std::size_t count = 0;
    while (!known.empty()) {
      const std::string name = known.substr(0, known.find(", "));
      known.erase(0, name.size() + 2);
      EXPECT_TRUE(properties.contains(name)) << service << " reads " << name;
      ++count;
    }
    for (const auto& property : properties.items()) {
      const std::string& name = property.key();
      // Read for robots with prismatic joints, or only if another member is not given.
      const bool alternative = !name.ends_with("_rad") && properties.contains(name + "_rad");
      const bool other_units = std::ranges::any_of(
          properties.items(), [&](const auto& p) { return p.key().size() > name.size() && p.key().starts_with(name + "_"); });
      if (alternative || other_units || name == "D_Ns_per_m") continue;
      EXPECT_THAT(message, HasSubstr(name)) << service;
    }
    EXPECT_GT(count, service == "reach" ? 5U : 10U);
  }
}

TEST(ServiceReplies, NameTheJointTheTimeAndTheBound) {
  Robots robots({robots_folder()});
  json request = lwr_move("feasibility");
  request["T_s"] = 0.5;
  const json reply = ask(robots, request);
  EXPECT_FALSE(reply["feasible"]);
  EXPECT_EQ(reply["limiting"]["bound"], "dq");
  EXPECT_NEAR(reply["limiting"]["t_s"].get<double>(), 0.25, 1e-9);  // a quintic is fastest in its middle
  request["dq_max_rad_per_s"] = {nullptr, nullptr, nullptr, nullptr, nullptr, nullptr, nullptr};
  request["tau_max_Nm"] = request["dq_max_rad_per_s"];
  EXPECT_TRUE(ask(robots, request)["feasible"]);
  request["q_max_rad"] = {1.0, 3, 3, 3, 3, 3, 3};
  const json bounded = ask(robots, request);
  EXPECT_FALSE(bounded["feasible"]);
  EXPECT_EQ(bounded["limiting"]["joint"], "joint_1");
  EXPECT_EQ(bounded["limiting"]["bound"], "q");
}

// Torque and speed of a single joint without gravity: T from 1.875 Δ/T ≤ v and (10/√3) Δ/T² ≤ τ/I.
TEST(ServiceReplies, FindTheShortestCycleOfASingleJointInClosedForm) {
  const testing::TemporaryFolder folder("wheel");
  std::ofstream(folder.path() / "wheel.urdf")
      << R"(<robot name="wheel"><link name="base"/><link name="disc"><inertial><mass value="1"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.8" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="axis" type="revolute">
    <parent link="base"/><child link="disc"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="100" effort="5"/></joint></robot>)";
  Robots robots({folder.path()});
  const json reply = ask(robots, {{"service", "cycle_time"}, {"robot", "wheel"}, {"from_q_rad", {-1}}, {"to_q_rad", {1}}});
  EXPECT_NEAR(reply["T_s"].get<double>(), std::sqrt(10 / std::sqrt(3.0) * 2 * 0.8 / 5), 1e-6);
  EXPECT_EQ(reply["limiting"]["bound"], "tau");
  const json degrees = ask(robots, {{"service", "cycle_time"},
                                    {"robot", "wheel"},
                                    {"from_q_deg", {-180 / M_PI}},
                                    {"to_q_deg", {180 / M_PI}},
                                    {"dq_max_rad_per_s", {0.5}}});
  EXPECT_NEAR(degrees["T_s"].get<double>(), 1.875 * 2 / 0.5, 1e-6);
  // The same wheel with <limit acceleration>: a bound of its own, which null lifts.
  std::string slow = testing::content(folder.path() / "wheel.urdf");
  slow.replace(slow.find("effort"), 0, "acceleration=\"0.5\" ");
  folder.write("slow.urdf", slow);
  const json braked{{"service", "cycle_time"}, {"robot", "slow"}, {"from_q_rad", {-1}}, {"to_q_rad", {1}}};
  const json at_acceleration = ask(robots, braked);
  EXPECT_NEAR(at_acceleration["T_s"].get<double>(), std::sqrt(10 / std::sqrt(3.0) * 2 / 0.5), 1e-6);
  EXPECT_EQ(at_acceleration["limiting"]["bound"], "ddq");
  json free = braked;
  free["ddq_max_rad_per_s2"] = {nullptr};
  EXPECT_EQ(ask(robots, free)["limiting"]["bound"], "tau");
  // No duration meets a bound of position.
  const json none = ask(robots, {{"service", "cycle_time"}, {"robot", "wheel"}, {"from_q_rad", {0}}, {"to_q_rad", {3.5}}});
  EXPECT_FALSE(none["feasible"]);
  EXPECT_TRUE(none["T_s"].is_null());
  EXPECT_THAT(none["reason"].get<std::string>(), HasSubstr("joint axis: q"));
  // A start or end at its bound of position does not decide on the duration, a motion beyond the bound does.
  for (const auto& [from, to] : {std::pair{-3.0, -1.0}, {1.0, 3.0}}) {
    json ends{{"service", "cycle_time"}, {"robot", "wheel"}, {"from_q_rad", {from}}, {"to_q_rad", {to}}};
    const json at_bound = ask(robots, ends);
    EXPECT_NEAR(at_bound["T_s"].get<double>(), std::sqrt(10 / std::sqrt(3.0) * 2 * 0.8 / 5), 1e-6);
    EXPECT_EQ(at_bound["limiting"]["bound"], "tau");
    ends["dq_max_rad_per_s"] = {0.5};
    EXPECT_EQ(ask(robots, ends)["limiting"]["bound"], "dq");
  }
  const json beyond =
      ask(robots, {{"service", "feasibility"}, {"robot", "wheel"}, {"from_q_rad", {0}}, {"to_q_rad", {3.5}}, {"T_s", 10}});
  EXPECT_EQ(beyond["limiting"]["bound"], "q");
  // Without motor data work is all there is: I ω²/2 at ω = 1.875·2/T.
  const json energy =
      ask(robots, {{"service", "energy"}, {"robot", "wheel"}, {"from_q_rad", {-1}}, {"to_q_rad", {1}}, {"T_s", 2}});
  EXPECT_EQ(energy["boundary"], "joints");
  EXPECT_NEAR(energy["energy_J"].get<double>(), 0.5 * 0.8 * 1.875 * 1.875, 1e-9);
  EXPECT_NEAR(energy["work_negative_J"].get<double>(), -0.5 * 0.8 * 1.875 * 1.875, 1e-9);
  const json power =
      ask(robots, {{"service", "peak_power"}, {"robot", "wheel"}, {"from_q_rad", {-1}}, {"to_q_rad", {1}}, {"T_s", 2}});
  // I q̈ q̇ with q′ = 30 s²(1−s)², q″ = 60 s(1−s)(1−2s): largest where its derivative vanishes, by a fine search here.
  double most = 0;
  for (int i = 0; i <= 1000000; ++i) {
    const double s = i * 1e-6, rest = 1 - s;
    most = std::max(most, 1800 * s * s * s * rest * rest * rest * (1 - 2 * s));
  }
  EXPECT_NEAR(power["drawn"]["power_W"].get<double>(), 0.8 * 4 * most / 8, 1e-7);
  EXPECT_NEAR(power["returned"]["power_W"].get<double>(), -0.8 * 4 * most / 8, 1e-7);
}

// The rack lifts 2 kg: 2·9.81 N, in N and m.
TEST(ServiceReplies, GiveAPrismaticJointItsOwnUnits) {
  const testing::TemporaryFolder folder("lift");
  std::ofstream(folder.path() / "lift.urdf")
      << R"(<robot name="lift"><link name="base"/><link name="fork"><inertial><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="rack" type="prismatic">
    <parent link="base"/><child link="fork"/><axis xyz="0 0 1"/><limit lower="0" upper="2" velocity="1" effort="100"/></joint></robot>)";
  Robots robots({folder.path()});
  const json request{{"service", "torques"}, {"robot", "lift"}, {"from_q", {0}},
                     {"to_q", {1}},          {"T_s", 4},        {"detail", "series"}};
  const json reply = ask(robots, request);
  EXPECT_NEAR(reply["joints"][0]["gravity_N"].get<double>(), 2 * 9.81, 1e-9);
  EXPECT_NEAR(reply["series"]["joints"][0]["q_m"].back().get<double>(), 1, 1e-12);
  EXPECT_EQ(misfit(json::parse(schema("torques"))["reply"], reply), "");
  json fast = request;
  fast["T_s"] = 1;  // 1.875 m/s
  EXPECT_THAT(ask(robots, fast)["reason"].get<std::string>(), HasSubstr(" m/s at 0.5 s, bound 1 m/s"));
  EXPECT_THAT(refusal(robots, R"({"service":"torques","robot":"lift","from_q_rad":[0],"to_q_rad":[1]})"),
              HasSubstr("/from_q_rad: is given, but the robot has prismatic joints, expected from_q with values in rad for"));
  EXPECT_THAT(refusal(robots, R"({"service":"torques","robot":"lift","from_q_deg":[0],"to_q_deg":[1]})"),
              HasSubstr("/from_q_deg: is given, but the robot has prismatic joints, expected from_q with values in rad for"));
}

TEST(ServiceReplies, HoldLockedJointsAndLeaveOutTheirDrives) {
  Robots robots({robots_folder()});
  const json reply = ask(robots, {{"service", "energy"},
                                  {"robot", "lwr4"},
                                  {"locked_q", {{"joint_3", 0.2}, {"joint_5", 0}}},
                                  {"from_q_rad", {0, 0.5, -1, 0.6, 0}},
                                  {"to_q_rad", {0.5, 0.2, -0.6, 0.2, 0.3}},
                                  {"T_s", 2}});
  EXPECT_EQ(reply["boundary"], "mains");
  EXPECT_EQ(reply["joints"].size(), 5U);
  const auto robot = robots.find("lwr4", {{"joint_3", 0.2}, {"joint_5", 0}});
  EXPECT_EQ(robot->drives->K, (std::vector<double>{12000, 12000, 10000, 6000, 6000}));
  EXPECT_EQ(robot->energy->losses.R, (std::vector<double>{0.6, 0.6, 1, 1.4, 1.4}));
  EXPECT_THAT(refusal(robots, R"({"service":"jerk","robot":"lwr4","locked_q":{"joint_9":0},"from_q_rad":[0],"to_q_rad":[0]})"),
              HasSubstr("joint_9"));
  EXPECT_THAT(
      refusal(robots, R"({"service":"jerk","robot":"lwr4","locked_q":{"joint_3":100},"from_q_rad":[0],"to_q_rad":[0]})"),
      HasSubstr("is locked at 100, expected -2.9"));
}

TEST(ServiceReplies, BalanceTheBooksOfEnergy) {
  Robots robots({robots_folder()});
  for (const char* bus : {"shared", "none", "grid"}) {
    json request = lwr_move("energy");
    request.update({{"T_s", 1.5}, {"bus", bus}, {"detail", "all"}});
    const json e = ask(robots, request);
    const auto J = [&](const char* name) { return e[std::string(name) + "_J"].get<double>(); };
    EXPECT_NEAR(J("drawn"),
                J("work_positive") + J("work_negative") + J("copper") + J("converter") + J("iron") + J("idle") + J("stored") +
                    J("chopped") + J("supply_losses") + J("controller"),
                1e-9 * J("drawn"));
    EXPECT_NEAR(J("work_positive") + J("work_negative"), J("kinetic") + J("potential") + J("friction"), 1e-6);
    EXPECT_NEAR(J("residual"), 0, 1e-6);
  }
}

// Joints 1 and 3 have the same shape, which overshoots and comes back: they reverse at the same instant.
TEST(ServiceReplies, CountJointsThatReverseTogether) {
  Robots robots({robots_folder()});
  json request = lwr_move("energy");
  request.update({{"T_s", 2},
                  {"degree", 6},
                  {"from_q_rad", {0, 0, 0, 0, 0, 0, 0}},
                  {"to_q_rad", {0.2, 0, 0.2, 0, 0, 0, 0}},
                  {"c_r_rad", {0.8, 0, 0.8, 0, 0, 0, 0}}});
  const json e = ask(robots, request);
  EXPECT_NEAR(e["work_positive_J"].get<double>() + e["work_negative_J"].get<double>(),
              e["potential_J"].get<double>() + e["friction_J"].get<double>(), 1e-6);
}

// The best duration is a minimum: no duration of a fine scan costs less.
TEST(ServiceReplies, FindTheDurationOfLeastEnergy) {
  Robots robots({robots_folder()});
  const auto robot = robots.find("lwr4");
  Move m;
  m.from_q = {0, 0.5, 0, -1, 0, 0.6, 0};
  m.to_q = {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8};
  m.drives = drive_terms(*robot);
  for (const double cycle : {0.0, 8.0}) {
    EnergyOptions options;
    options.cycle = cycle;
    options.best = true;
    m.T = 3;
    const MotionCost c = energy_of(*robot, m, options);
    ASSERT_TRUE(c.best);
    options.best = false;
    const double shortest = shortest_duration(robot->model, m);
    double least = 1e99;
    for (int i = 0; i <= 60; ++i) {
      m.T = shortest * (1 + 1e-9) + 0.1 * i;
      if (cycle > 0 && m.T > cycle) break;
      least = std::min(least, energy_of(*robot, m, options).total());
    }
    EXPECT_LE(c.best->energy, least * (1 + 1e-5)) << cycle;
    EXPECT_GT(c.best->energy, 0.99 * least);
  }
}

// m_u and v_max of unit:indices at the reference pose: the functions are the same, the path passes through the pose.
TEST(ServiceReplies, TellMassesAndSpeedsOfPersonsAlongThePath) {
  Robots robots({robots_folder()});
  json request = lwr_move("safety");
  request.update({{"T_s", 4}, {"parts", {"chest", "hands_and_fingers", "face"}}, {"detail", "series"}});
  const json slow = ask(robots, request);
  const double T_safe = slow["parts"][0]["T_safe_s"];
  request["parts"] = {"chest"};
  request["T_s"] = T_safe * 1.0001;
  EXPECT_TRUE(ask(robots, request)["safe"].get<bool>());
  request["T_s"] = T_safe * 0.9999;
  EXPECT_FALSE(ask(robots, request)["safe"].get<bool>());
  EXPECT_TRUE(slow["T_safe_s"].is_null());  // contact with the face is not permitted
  EXPECT_FALSE(slow["safe"].get<bool>());
  // Kinetic energy along u is at most that of the whole robot.
  const auto robot = robots.find("lwr4");
  const robot::Mechanism mechanism(robot->model);
  robot::Data data(mechanism);
  Move m;
  m.from_q = request["from_q_rad"].get<std::vector<double>>();
  m.to_q = request["to_q_rad"].get<std::vector<double>>();
  m.T = 4;
  const Torques t = torques(robot->model, m, 401);
  for (std::size_t i = 0; i < 401; ++i) {
    const double speed = slow["series"]["speed_m_per_s"][i];
    const Eigen::Map<const Eigen::VectorXd> q(&t.q[i * 7], 7), dq(&t.dq[i * 7], 7);
    EXPECT_LE(0.5 * slow["series"]["mass_kg"][i].get<double>() * speed * speed,
              robot::kinetic_energy(mechanism, data, q, dq) * (1 + 1e-9) + 1e-12);
  }
}

TEST(ServiceReplies, DoNotLetTheSamplesOfTheSeriesDecideOnSafety) {
  Robots robots({robots_folder()});
  json request = lwr_move("safety");
  request.update({{"T_s", 1}, {"parts", {"chest"}}, {"samples", 2}});
  const json coarse = ask(robots, request);
  EXPECT_FALSE(coarse["safe"]);
  request["samples"] = 401;
  EXPECT_EQ(ask(robots, request), coarse);
  // The largest share of a dense series is at most that of the reply.
  request.update({{"samples", 20001}, {"detail", "series"}});
  const json fine = ask(robots, request);
  double fastest = 0;
  for (const json& speed : fine["series"]["speed_m_per_s"]) fastest = std::max(fastest, std::abs(speed.get<double>()));
  EXPECT_NEAR(std::abs(coarse["fastest"]["speed_m_per_s"].get<double>()), fastest, 1e-6 * fastest);
  EXPECT_GE(std::abs(coarse["fastest"]["speed_m_per_s"].get<double>()), fastest * (1 - 1e-12));
}

// The terms are the largest of the motion, whatever the samples of the series: their sum is not below the peak.
TEST(ServiceReplies, DoNotLetTheSamplesOfTheSeriesDecideOnTheTermsOfTorques) {
  Robots robots({robots_folder()});
  json request = lwr_move("torques");
  request["T_s"] = 2;
  const json many = ask(robots, request);
  request["samples"] = 2;
  EXPECT_EQ(ask(robots, request), many);
  double least = 0, most = 0;
  for (const json& joint : many["joints"]) {
    const double tau = joint["tau_Nm"].get<double>();
    double sum = 0;
    for (const char* term : {"inertial_Nm", "coriolis_Nm", "gravity_Nm", "drive_Nm"})
      sum += std::abs(joint[term].get<double>());
    EXPECT_GE(sum, std::abs(tau) * (1 - 1e-12)) << joint["joint"];
    least = std::min(least, joint["inertial_Nm"].get<double>());
    most = std::max(most, joint["inertial_Nm"].get<double>());
  }
  EXPECT_LT(least, 0);
  EXPECT_GT(most, 0);
}

TEST(ServiceReplies, InventNoDurationWhereNoneIsPossible) {
  Robots robots({robots_folder()});
  const json small(7, 0.1);
  for (const char* service : {"safety", "effective_mass"}) {
    json request = lwr_move(service);
    request["q_max_rad"] = small;
    EXPECT_THAT(refusal(robots, request.dump()), HasSubstr("no duration"));
    request["T_s"] = 2;
    const json reply = ask(robots, request);
    EXPECT_FALSE(reply["feasible"]);
    EXPECT_THAT(reply["reason"].get<std::string>(), HasSubstr(": q = "));
  }
  json request = lwr_move("cycle_time");
  request.update({{"tau_max_Nm", json(7, 20)}, {"detail", "all"}});
  const json weak = ask(robots, request);
  EXPECT_FALSE(weak["feasible"]);
  EXPECT_TRUE(weak["T_s"].is_null());
  EXPECT_EQ(weak["limiting"]["joint"], "joint_2");
  EXPECT_FALSE(weak.contains("motion"));
}

TEST(ServiceReplies, NeedABoundForAShortestDuration) {
  const testing::TemporaryFolder folder("free");
  std::ofstream(folder.path() / "free.urdf")
      << R"(<robot name="free"><link name="base"/><link name="disc"><inertial><mass value="1"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.8" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="axis" type="continuous">
    <parent link="base"/><child link="disc"/><axis xyz="0 0 1"/></joint></robot>)";
  Robots robots({folder.path()});
  json request{{"service", "cycle_time"}, {"robot", "free"}, {"from_q_rad", {0}}, {"to_q_rad", {1}}};
  const json none = ask(robots, request);
  EXPECT_FALSE(none["feasible"]);
  EXPECT_TRUE(none["T_s"].is_null());
  EXPECT_THAT(none["reason"].get<std::string>(), HasSubstr("no bound limits the duration"));
  request["dq_max_rad_per_s"] = {2};
  EXPECT_NEAR(ask(robots, request)["T_s"].get<double>(), 1.875 / 2, 1e-9);
}

TEST(ServiceReplies, JoinTheBoundOfPowerWithTheOthers) {
  Robots robots({robots_folder()});
  json request = lwr_move("peak_power");
  request.update({{"T_s", 0.1}, {"power_max_W", 1e9}});
  EXPECT_FALSE(ask(robots, request)["feasible"]);
  request.update({{"T_s", 4}, {"power_max_W", 1e-3}});
  const json weak = ask(robots, request);
  EXPECT_FALSE(weak["feasible"]);
  EXPECT_THAT(weak["reason"].get<std::string>(), HasSubstr("bound 0.001 W"));
  request["power_max_W"] = 1e9;
  EXPECT_TRUE(ask(robots, request)["feasible"]);
}

TEST(ServiceReplies, ComparesJerkWithTheQuintic) {
  Robots robots({robots_folder()});
  json request = lwr_move("jerk");
  request["T_s"] = 2;
  const json reply = ask(robots, request);
  // ∫ q‴² dt = 720 Δ²/T⁵ of the quintic.
  double sum = 0;
  for (std::size_t j = 0; j < 7; ++j)
    sum += std::pow(request["to_q_rad"][j].get<double>() - request["from_q_rad"][j].get<double>(), 2);
  EXPECT_NEAR(reply["jerk_squared_integral_rad2_per_s5"].get<double>(), 720 * sum / 32, 1e-6);
  EXPECT_NEAR(reply["share_of_quintic"].get<double>(), 1, 1e-12);
  EXPECT_NEAR(std::abs(reply["joints"][0]["dddq_rad_per_s3"].get<double>()), 60 * 1.2 / 8, 1e-6);
  // A robot that stands still.
  json still = lwr_move("jerk");
  still["T_s"] = 2;
  still["from_q_rad"] = still["to_q_rad"];
  const json none = ask(robots, still);
  EXPECT_EQ(none["jerk_squared_integral_rad2_per_s5"], 0);
  EXPECT_EQ(none["acceleration_squared_integral_rad2_per_s3"], 0);
  EXPECT_TRUE(none["share_of_quintic"].is_null());
}

TEST(ServiceReplies, OptimiseBeatsTheQuinticAndGivesItsMotion) {
  Robots robots({robots_folder()});
  json request = lwr_move("optimise");
  request.update({{"particles", 32}, {"rounds", 40}, {"cost", {{{"name", "torque"}}, {{"name", "jerk"}, {"weight", 1e-6}}}}});
  const json reply = ask(robots, request);
  ASSERT_EQ(reply["status"], "feasible") << reply["reason"];
  EXPECT_GT(reply["saved_share"].get<double>(), 0);
  EXPECT_EQ(reply["motion"]["unit"], "unit:motion?kind=polynomial&degree=7");
  // The costs are those of the motion that is returned.
  json again = lwr_move("feasibility");
  again.update({{"T_s", reply["motion"]["T_s"]}, {"degree", 7}, {"c_r_rad", reply["motion"]["c_r_rad"]}, {"detail", "all"}});
  EXPECT_NEAR(ask(robots, again)["torque_squared_integral"].get<double>(),
              reply["costs"]["torque_squared_integral"].get<double>(),
              1e-9 * reply["costs"]["torque_squared_integral"].get<double>());
  request["rule"] = "pareto";
  request["directions"] = 3;
  request["cost"] = {{{"name", "torque"}}, {{"name", "jerk"}}};
  EXPECT_GE(ask(robots, request)["front"].size(), 2U);
}

// T_min = max(1.875 Δ/q̇_max, …) of the quintic, which saves time against itself only if it is compared at its own duration.
TEST(ServiceReplies, OptimiseComparesASearchedDurationWithTheFastestQuintic) {
  Robots robots({robots_folder()});
  json request = lwr_move("optimise");
  request.erase("T_min_s");
  request.update({{"cost", "time"}, {"drives", "none"}, {"particles", 32}, {"rounds", 40}});
  EXPECT_THAT(refusal(robots, request.dump()), HasSubstr("gives no duration, expected T_min_s, or T_max_s"));
  request["T_max_s"] = 10;
  const json reply = ask(robots, request);
  ASSERT_EQ(reply["status"], "feasible") << reply["reason"];
  json quintic = lwr_move("cycle_time");
  quintic.erase("T_s");
  quintic.erase("degree");
  quintic["drives"] = "none";
  const double T = ask(robots, quintic)["T_s"].get<double>();
  EXPECT_NEAR(reply["quintic"]["T_s"].get<double>(), T, 2e-3 * T);
  EXPECT_NEAR(reply["saved_share"].get<double>(), 1 - reply["T_s"].get<double>() / reply["quintic"]["T_s"].get<double>(),
              1e-12);
  EXPECT_GT(reply["saved_share"].get<double>(), 0.1);
  // However long the motion may be at most.
  request["T_max_s"] = 10000;
  EXPECT_NEAR(ask(robots, request)["T_s"].get<double>(), reply["T_s"].get<double>(), 0.02 * T);
  // The quintic of an order of costs keeps the order.
  request.update({{"T_max_s", 10}, {"cost", {{{"name", "time"}}, {{"name", "torque"}}}}, {"rule", "lexicographic"}});
  const json ordered = ask(robots, request);
  EXPECT_NEAR(ordered["quintic"]["T_s"].get<double>(), T, 0.015 * T) << "0.01 is the tolerance";
  request.erase("rule");
  request["cost"] = "time";
  // A search that may try little is no worse than the quintic beside it.
  request["evaluations_max"] = 100;
  const json short_of = ask(robots, request);
  EXPECT_LE(short_of["T_s"].get<double>(), short_of["quintic"]["T_s"].get<double>());
  request.erase("evaluations_max");
  // At the fixed duration of the faster motion the quintic keeps no bounds: there is nothing to compare with.
  request["T_min_s"] = request["T_max_s"] = 1.01 * reply["T_s"].get<double>();
  request["cost"] = "torque";
  const json fixed = ask(robots, request);
  EXPECT_EQ(fixed["status"], "feasible") << fixed["reason"];
  EXPECT_EQ(fixed["quintic"]["feasible"], false);
  EXPECT_TRUE(fixed["saved_share"].is_null());
}

TEST(ServiceReplies, OptimiseTakesWorkForEnergyWhereTheLossesAreUnknown) {
  Robots robots({robots_folder()});
  json request = lwr_move("optimise");
  request.update({{"robot", "ur5e"}, {"particles", 16}, {"rounds", 10}, {"cost", "energy"}});
  for (const char* end : {"from_q_rad", "to_q_rad"}) request[end].erase(6);
  const json reply = ask(robots, request);
  EXPECT_TRUE(reply["costs"].contains("work_J")) << reply;
  EXPECT_THAT(reply["notes"].dump(), HasSubstr("no energy.ssv"));
  request["cost"] = {{{"name", "torque"}}, {{"name", "work"}}, {{"name", "energy"}}};
  EXPECT_THAT(refusal(robots, request.dump()), HasSubstr("both are the same"));
}

// At a fixed duration nothing has less jerk than the quintic, ∫ q‴² dt = 720 Δ²/T⁵: the last cost cannot save.
TEST(ServiceReplies, CompareTheLastCostOfALexicographicOrderWithThatOfTheQuintic) {
  Robots robots({robots_folder()});
  json request = lwr_move("optimise");
  request.update({{"cost", {{{"name", "torque"}}, {{"name", "jerk"}}}}, {"rule", "lexicographic"}, {"tolerance", 10}});
  const json reply = ask(robots, request);
  ASSERT_EQ(reply["status"], "feasible") << reply["reason"];
  EXPECT_LE(reply["saved_share"].get<double>(), 1e-9);
  EXPECT_EQ(reply["saved_shares"]["jerk_squared_integral"], reply["saved_share"]);
  double sum = 0;
  for (std::size_t j = 0; j < 7; ++j)
    sum += std::pow(request["to_q_rad"][j].get<double>() - request["from_q_rad"][j].get<double>(), 2);
  EXPECT_NEAR(reply["quintic"]["cost"].get<double>(), 720 * sum / 32, 1e-6 * 720 * sum / 32);
}

TEST(ServiceReplies, SearchTheDurationOfLeastEnergyWithinTheGivenLimits) {
  Robots robots({robots_folder()});
  json request = lwr_move("cycle_time");
  const double shortest = ask(robots, request)["T_s"];
  const auto best = [&](json change) {
    json energy = lwr_move("energy");
    energy.update({{"best", true}, {"T_s", 0.2}});
    energy.update(change);
    return energy;
  };
  EXPECT_THAT(refusal(robots, best({{"T_max_s", 0.5 * shortest}}).dump()), HasSubstr("expected at least that for T_max"));
  EXPECT_THAT(refusal(robots, best({{"cycle_s", 0.9 * shortest}}).dump()), HasSubstr("expected at least that for the cycle"));
  // A longer T_max does not reach beyond the cycle.
  for (const json& change :
       {json{{"T_max_s", 1.1 * shortest}, {"cycle_s", 20}}, json{{"T_max_s", 20}, {"cycle_s", 1.1 * shortest}}})
    EXPECT_LE(ask(robots, best(change))["best"]["T_s"].get<double>(), 1.1 * shortest * (1 + 1e-12)) << change;
}

TEST(ServiceReplies, TellTheProgressOfAllSearchesInAscendingOrder) {
  Robots robots({robots_folder()});
  for (const std::string rule : {"weighted", "lexicographic", "pareto"}) {
    std::vector<double> told;
    Context context;
    context.progress = [&](double share, const std::string&) { told.push_back(share); };
    json request = lwr_move("optimise");
    request.update({{"cost", {{{"name", "torque"}}, {{"name", "jerk"}}}}, {"rule", rule}, {"rounds", 10}, {"refine", false}});
    if (rule == "pareto") request["directions"] = 3;
    answer(robots, request.dump(), context);
    const std::size_t searches = rule == "weighted" ? 1 : rule == "lexicographic" ? 2 : 3;
    ASSERT_EQ(told.size(), 10 * searches) << rule;
    EXPECT_EQ(told.back(), 1) << rule;
    for (std::size_t i = 1; i < told.size(); ++i) EXPECT_GT(told[i], told[i - 1]) << rule;
  }
}

TEST(ServiceReplies, EndASearchAtItsLimits) {
  Robots robots({robots_folder()});
  json request = lwr_move("optimise");
  request["detail"] = "margins";
  EXPECT_TRUE(ask(robots, request)["complete"].get<bool>());
  request.update({{"particles", 64}, {"rounds", 100000}, {"evaluations_max", 1000}});
  for (const std::string rule : {"weighted", "lexicographic", "pareto"}) {
    request.update({{"rule", rule}, {"cost", {{{"name", "torque"}}, {{"name", "jerk"}}}}});
    const json reply = ask(robots, request);
    EXPECT_FALSE(reply["complete"].get<bool>()) << rule;
    const int rounds = rule == "weighted" ? 1 : 2;
    if (rule != "pareto") {
      EXPECT_LE(reply["evaluations"].get<int>(), 1000 + rounds * 64) << rule;
    }
  }
  request.update({{"rule", "weighted"}, {"evaluations_max", 1000000000}, {"limit_s", 1e-6}});
  EXPECT_FALSE(ask(robots, request)["complete"].get<bool>());
}

TEST(ServiceRequests, AreRefusedWithAPointerAndNeverCrash) {
  Robots robots({robots_folder()});
  const auto expect = [&](json change, const char* part, const std::string& service = "feasibility") {
    json request = lwr_move(service);
    request.update(change);
    EXPECT_THAT(refusal(robots, request.dump()), HasSubstr(part)) << request;
  };
  expect({{"from_q_rad", {0, 1}}}, "/from_q_rad: has 2 values, expected 7");
  expect({{"from_q_rad", {0, 0, 1e300, 0, 0, 0, 0}}}, "/from_q_rad/2: is 1e+300 rad, expected -1000000 to 1000000");
  expect({{"from", "walk"}}, "/from: is given, expected from_q_rad with a posture, or \"run\"");
  expect({{"T_s", 2}}, "/T_s: is no member of optimise, expected T_min_s", "optimise");
  expect({{"T_min", 2}}, "/T_min: is no member of optimise, expected T_min_s", "optimise");
  expect({{"cost", "frog"}}, "/cost: is 'frog', expected one of time, torque, work, shared_work, acceleration, jerk, energy",
         "optimise");
  expect({{"cost", "power"}}, "/cost: is 'power', expected one of", "optimise");
  expect({{"cost", {{{"name", "jerk"}}, {{"name", "time"}}, {{"name", "jerk"}}}}}, "/cost/2/name: is 'jerk' again", "optimise");
  expect({{"from_q_deg", {0, 0, 0, 0, 0, 0, 0}}}, "expected one of them");
  for (const char* member : {"price_per_kWh", "co2_kg_per_kWh"})
    expect({{member, 1e308}}, "is 1e+308, expected a magnitude of at most 1e+15", "energy");
  expect({{"cycle_s", 1e308}}, "/cycle_s: is 1e+308, expected", "energy");
  expect({{"T_process_s", -1e16}}, "/T_process_s: is -1e+16, expected a magnitude of at most 1e+15", "cycle_time");
  expect({{"T_s", 0}}, "/T_s");
  expect({{"T_s", -1}}, "/T_s");
  expect({{"T_s", 1e300}}, "/T_s");
  expect({{"T_s", "1"}}, "/T_s");
  expect({{"degree", 32}}, "/degree");
  expect({{"degree", 7}, {"c_r_rad", {1}}}, "expected 14");
  expect({{"dq_max_rad_per_s", {1, 1, 1, 1, 1, 1, 0}}}, "/dq_max_rad_per_s/6");
  expect({{"detail", "more"}}, "/detail");
  expect({{"samples", 1}}, "/samples");
  expect({{"samples", 1000000}}, "/samples");
  expect({{"robot", nullptr}}, "/robot");
  expect({{"robot", "a/b"}}, "/robot");
  expect({{"frame", "hand"}}, "/frame", "effective_mass");
  expect({{"direction", {0, 0, 0}}}, "/direction", "effective_mass");
  expect({{"parts", {"tail"}}}, "/parts", "safety");
  expect({{"bus", "tram"}}, "/bus", "energy");
  expect({{"cycle_s", 0.1}}, "cycle", "energy");
  expect({{"cost", "power"}}, "/cost", "optimise");
  expect({{"cost", {{{"name", "torque"}, {"weight", -1}}}}}, "/cost/0/weight", "optimise");
  expect({{"T_max_s", 1}}, "/T_max_s", "optimise");
  expect({{"verify", true}, {"rule", "pareto"}, {"cost", {{{"name", "torque"}}, {{"name", "time"}}}}},
         "/verify: is true with the rule pareto", "optimise");
  expect({{"evaluations_max", 0}}, "/evaluations_max", "optimise");
  expect({{"limit_s", 0}}, "/limit_s", "optimise");
  expect({{"verify", true}}, "co-simulation", "optimise");
  expect({{"M_kg", -1}}, "expected", "throughput");
  expect({{"M_kg", {1, 1, 1}}}, "expected one or 3", "throughput");
  for (const char* name : {"M_kg", "S_N_per_m", "zeta"})
    expect({{name, json::array()}}, (std::string("/") + name + ": is empty").c_str(), "throughput");
  const std::string good = lwr_move("feasibility").dump();
  EXPECT_THAT(refusal(robots, good.substr(0, good.size() - 1) + ",\"robot\":\"lwr4\"}"), HasSubstr("twice"));
  json loads = lwr_move("torques");
  loads.update({{"payload", {{{"mass_kg", 1}, {"com_m", {0, 0, 0.1}}, {"to_share", 0.5}}, {{"tool", "gripper"}}}},
                {"wrench", {{"force_N", {1, 2, 3}}, {"axes", "frame"}}}});
  json path{{"service", "energy"},
            {"robot", "planar2"},
            {"series", {{"t_s", {0, 0.1, 0.2}}, {"q_rad", {{0, 0}, {0.1, 0}, {0.1, 0.1}}}}}};
  std::mt19937 random(7);
  for (const std::string& whole : {good, loads.dump(), path.dump()})
    for (int i = 0; i < 700; ++i) {
      std::string damaged = whole;
      for (int k = 0; k < 3; ++k) damaged[random() % damaged.size()] = static_cast<char>(random());
      refusal(robots, damaged);
    }
}

TEST(ServiceRequests, AreCheckedWithoutAnAnswer) {
  Robots robots({robots_folder()});
  for (const std::string& service : service_names()) {
    const auto pointer = [&](const char* removed, const json& change) -> std::string {
      json request = lwr_move(service);
      if (removed) request.erase(removed);
      request.update(change);
      try {
        check_object(robots, nlohmann::ordered_json(request));
      } catch (const RequestError& e) {
        return e.pointer();
      }
      return "none";
    };
    EXPECT_EQ(pointer(nullptr, json::object()), "none") << service << ": also verify, although there is no twin here";
    const char* const needed = service == "reach" ? "poses" : "to_q_rad";
    EXPECT_EQ(pointer(needed, json::object()), std::string("/") + needed) << service;
    EXPECT_EQ(pointer(nullptr, {{"dq_mx_rad_per_s", {1}}}), "/dq_mx_rad_per_s") << service;
    EXPECT_EQ(pointer(nullptr, {{"from_q_rad", {0, 1}}}), "/from_q_rad") << service;
    EXPECT_EQ(pointer(nullptr, {{"robot", "nobody"}}), "/robot") << service;
  }
  // Searches of ages, and a move whose duration cannot be found.
  json request = lwr_move("optimise");
  request.update({{"particles", 100000}, {"rounds", 100000}, {"refine", true}});
  EXPECT_NO_THROW(check_object(robots, nlohmann::ordered_json(request)));
  request = lwr_move("feasibility");
  request.update({{"tau_max_Nm", {1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6}}});
  EXPECT_NO_THROW(check_object(robots, nlohmann::ordered_json(request)));
}

TEST(ServiceRequests, TakeRobotsOfManyJoints) {
  const testing::TemporaryFolder folder("snake");
  std::ofstream urdf(folder.path() / "snake.urdf");
  urdf << "<robot name=\"snake\"><link name=\"l0\"/>";
  for (int i = 1; i <= 30; ++i)
    urdf << "<link name=\"l" << i
         << "\"><inertial><origin xyz=\"0.05 0 0\"/><mass value=\"0.5\"/><inertia ixx=\"1e-3\" iyy=\"1e-3\" "
         << "izz=\"1e-3\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link><joint name=\"j" << i
         << "\" type=\"continuous\"><parent link=\"l" << i - 1 << "\"/><child link=\"l" << i
         << "\"/><origin xyz=\"0.1 0 0\"/><axis xyz=\"0 " << i % 2 << " " << 1 - i % 2 << "\"/></joint>";
  urdf << "</robot>";
  urdf.close();
  Robots robots({folder.path()});
  const std::vector<double> from(30, 0.0), to(30, 0.1);
  for (const char* service : {"feasibility", "energy", "torques", "peak_power", "jerk", "effective_mass"}) {
    const json request{{"service", service}, {"robot", "snake"}, {"from_q_rad", from},
                       {"to_q_rad", to},     {"T_s", 1},         {"detail", "all"}};
    EXPECT_EQ(misfit(json::parse(schema(service))["reply"], ask(robots, request)), "") << service;
  }
}

}  // namespace
}  // namespace cotwin::services::json_test
