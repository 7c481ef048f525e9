// What answers rest on: data that a robot does not have, or that its files call assumed; safety by ISO/TS 15066 beside the effective mass.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "components/services/json/json.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::services::assumptions_test {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

json ask(Robots& robots, const json& request) { return json::parse(answer(robots, request.dump())); }

std::string refusal(Robots& robots, const json& request) {
  try {
    answer(robots, request.dump());
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

/// "what" of the assumptions of a reply.
std::vector<std::string> listed(const json& reply) {
  std::vector<std::string> all;
  for (const json& one : reply.value("assumptions", json::array())) all.push_back(one["what"]);
  return all;
}

json assumption(const json& reply, const std::string& what) {
  for (const json& one : reply.value("assumptions", json::array()))
    if (one["what"] == what) return one;
  return nullptr;
}

Robots shipped() { return Robots({places::source() + "/models/robots"}); }

/// A robot of two links whose files are written in the test.
struct Bench {
  Bench() { urdf(R"(lower="-3" upper="3" velocity="2" effort="200")", 4); }
  void urdf(const std::string& limit, double mass) const {
    std::ofstream out(folder.path() / "arm.urdf");
    out << R"(<robot name="arm"><link name="base"/>)";
    for (const int i : {1, 2}) {
      out << "<link name=\"l" << i << "\"><inertial><origin xyz=\"0.3 0 0\"/><mass value=\"" << mass << "\"/><inertia ixx=\""
          << mass / 100 << "\" iyy=\"" << mass / 50 << "\" izz=\"" << mass / 50
          << R"(" ixy="0" ixz="0" iyz="0"/></inertial></link>)";
      out << "<joint name=\"j" << i << R"(" type="revolute"><origin xyz=")" << (i == 1 ? 0 : 0.5) << R"( 0 0"/><parent link=")"
          << (i == 1 ? "base" : "l1") << "\"/><child link=\"l" << i << R"("/><axis xyz="0 0 1"/><limit )" << limit
          << "/></joint>";
    }
    out << R"(<link name="tip"/><joint name="fixed" type="fixed"><origin xyz="0.5 0 0"/><parent link="l2"/><child link="tip"/></joint></robot>)";
  }
  void drives(const std::string& rows, const char* file = "drive_train.ssv") const {
    std::string all;
    std::istringstream in(rows);
    for (std::string row; std::getline(in, row, ';');)
      all += "<ssv:Parameter name=\"" + row.substr(0, row.find('=')) + "\"><ssv:String value=\"" +
             row.substr(row.find('=') + 1) + "\"/></ssv:Parameter>";
    std::ofstream(folder.path() / file)
        << R"(<ssv:ParameterSet version="1.0" name="x" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"><ssv:Parameters>)"
        << all << "</ssv:Parameters></ssv:ParameterSet>";
  }
  Robots robots() const { return Robots({folder.path()}, "arm", false, places::source() + "/models/people/iso_ts_15066.csv"); }
  static json move(const std::string& service, const json& more = json::object()) {
    json request{{"service", service}, {"robot", "arm"}, {"from_q_rad", {0, 1}}, {"to_q_rad", {1, 0.5}}};
    request.update(more);
    return request;
  }
  testing::TemporaryFolder folder{"assumptions"};
};

/// A request of each service with what it needs.
json request_of(const std::string& service, json move) {
  move["service"] = service;
  if (service == "throughput") move.update({{"M_kg", 1}, {"S_N_per_m", 500}, {"zeta", 1}});
  if (service == "optimise") move.update({{"T_max_s", 4}, {"particles", 8}, {"rounds", 2}, {"degree", 6}, {"refine", false}});
  if (service == "grow") move.update({{"T_min_s", 2}, {"T_max_s", 8}, {"motions", 50}});
  if (service == "reactionless") move.update({{"particles", 8}, {"rounds", 1}});
  if (service == "payload") move["T_s"] = 3;
  if (service == "reach") {
    move.erase("to_q_rad");
    move.update({{"directions", {"x"}}, {"poses", {{{"p_m", {0.5, 0, 0}}, {"quaternion_wxyz", {1, 0, 0, 0}}}}}});
  }
  return move;
}

TEST(Assumptions, NameTheUnknownMotorsInEveryService) {
  Robots robots = shipped();
  for (const std::string& name : robots.names())
    for (const std::string& service : service_names()) {
      // A verification needs a co-simulation (ask_test); searches take long.
      if (service == "verify" || (service == "optimise" && name != "ur10e" && name != "iiwa14")) continue;
      if (service.starts_with("reaction") && !(robots.find(name)->base.mass > 0)) continue;
      if (service == "reactionless" || service == "reach") continue;  // below, of a small robot; of the shape alone
      const std::size_t n = robots.find(name)->model.joints.size();
      json move{{"robot", name}, {"from_q_rad", std::vector<double>(n, 0.2)}, {"to_q_rad", std::vector<double>(n, 0.3)}};
      if (name == "kr300_r2500")
        for (const char* q : {"from_q_rad", "to_q_rad"}) move[q][1] = move[q][1].get<double>() - 1;  // its range
      const json reply = ask(robots, request_of(service, move)), motors = assumption(reply, "inertia of motors");
      ASSERT_TRUE(motors.is_object()) << name << " " << service << reply;
      EXPECT_EQ(motors["file"], "drive_train.ssv");
      EXPECT_THAT(reply["notes"].dump(), HasSubstr("inertia of motors")) << name << service;
      if (robots.find(name)->drives) {
        EXPECT_EQ(motors["value"], json(robots.find(name)->drives->B));
        EXPECT_THAT(motors["effect"].get<std::string>(), HasSubstr("as uncertain"));
        // What iiwa14 has of Stürz et al. is no assumption.
        EXPECT_EQ(assumption(reply, "Coulomb friction").is_null(), name == "iiwa14") << name << service;
      } else {
        EXPECT_EQ(motors["value"], 0);
        EXPECT_THAT(motors["effect"].get<std::string>(), HasSubstr("torques and power are")) << name << service;
        EXPECT_EQ(assumption(reply, "friction")["value"], 0) << name << service;
      }
      // Energy data count only where energy is told: lwr4, iiwa14 and kr300 have some, all assumed.
      const bool unknown = !assumption(reply, "losses of motors and supply").is_null();
      EXPECT_EQ(unknown, service == "energy" && !robots.find(name)->energy) << name << service;
    }
}

TEST(Assumptions, NameTheUnknownMotorsInAMotionThatDoesNotTurnTheBase) {
  const Bench bench;
  Robots robots = bench.robots();
  const json base{{"mass_kg", 30}, {"com_m", {0, 0, 0}}, {"inertia_kg_m2", {1, 0, 0, 1, 0, 1}}};
  const json move = Bench::move("reactionless", {{"to_q_rad", {0.1, 0.9}}, {"particles", 8}, {"rounds", 1}, {"base", base}});
  EXPECT_THAT(listed(ask(robots, move)), ElementsAre("inertia of motors", "friction"));
  bench.drives("B=1;tau_C=1;assumed=B");
  Robots known = bench.robots();
  EXPECT_THAT(listed(ask(known, move)), ElementsAre("inertia of motors"));
}

TEST(Assumptions, AreNoneWhereAllIsKnown) {
  const Bench bench;
  bench.drives("K=1000;B=2 1;tau_C=1;sigma2=0.5;sources=data sheet;assumed=none");
  bench.drives("R=1;k_t=5;P_0=20;controller=30;efficiency=0.9;V_min=48;V_max=56;C=0.005;assumed=none", "energy.ssv");
  Robots robots = bench.robots();
  for (const std::string& service : service_names())
    if (service != "verify" && service != "reactionless" && service != "reaction") {  // this base has no inertia
      const json reply = ask(robots, request_of(service, Bench::move(service)));
      EXPECT_THAT(listed(reply), ElementsAre()) << service << reply;
      EXPECT_FALSE(reply.contains("notes")) << service << reply;
    }
  // By what the request takes away.
  EXPECT_THAT(listed(ask(robots, Bench::move("torques", {{"drives", "none"}}))), ElementsAre("inertia of motors", "friction"));
  EXPECT_EQ(ask(robots, Bench::move("torques", {{"drives", "none"}}))["assumptions"][0]["file"], "request: drives = none");
}

TEST(Assumptions, NameWhatFilesLeaveOutAndCallAssumed) {
  const Bench bench;
  const auto of = [&](const std::string& rows, const json& request) {
    bench.drives(rows);
    Robots robots = bench.robots();
    return ask(robots, request);
  };
  const json move = Bench::move("cycle_time");
  // A motor without inertia, or of 0; the number that counts is told.
  json reply = of("K=1000;B[1]=2;tau_C=1", move);
  EXPECT_THAT(listed(reply), ElementsAre("inertia of motors of j2"));
  EXPECT_EQ(reply["assumptions"][0]["value"], json({2, 1}));
  EXPECT_THAT(listed(of("B=2 0;tau_C=1", move)), ElementsAre("inertia of motors of j2"));
  EXPECT_THAT(listed(of("B=0;tau_C=1", move)), ElementsAre("inertia of motors of j1, j2"));
  json held = move;
  held.update({{"from_q_rad", {0}}, {"to_q_rad", {1}}, {"locked_q", {{"j1", 0}}}});
  EXPECT_THAT(listed(of("B[1]=2;tau_C=1", held)), ElementsAre("inertia of motors of j2"));
  EXPECT_THAT(listed(of("B[2]=2;tau_C=1", held)), ElementsAre());
  // Friction counts as told where the motor or the link has any.
  EXPECT_THAT(listed(of("B=2", move)), ElementsAre("friction"));
  EXPECT_THAT(listed(of("B=2;link_tau_C=0", move)), ElementsAre());
  reply = of("B=2;sigma2=1;tau_C=0.5;D=3;assumed=B  tau_C D", move);
  EXPECT_THAT(listed(reply), ElementsAre("inertia of motors", "Coulomb friction"));
  EXPECT_EQ(reply["assumptions"][0]["value"], 2);
  EXPECT_EQ(reply["notes"], json({"assumed, not measured: inertia of motors, Coulomb friction; the answer is as uncertain"}));
  bench.drives("B=2;assumed=B k");
  Robots wrong = bench.robots();
  EXPECT_THAT(refusal(wrong, move), HasSubstr("assumed: 'k', expected names of parameters as K B D"));
  // Limits, unless the request has them; a given duration is no search.
  bench.urdf(R"(lower="-3" upper="3" velocity="0" effort="200")", 4);
  reply = of("B=2;tau_C=1", Bench::move("feasibility", {{"T_s", 1}}));
  EXPECT_THAT(listed(reply), ElementsAre("limit of speed of j1, j2"));
  EXPECT_TRUE(reply["assumptions"][0]["value"].is_null());
  EXPECT_EQ(reply["assumptions"][0]["file"], "arm.urdf");
  EXPECT_THAT(listed(of("B=2;tau_C=1", Bench::move("feasibility", {{"dq_max_rad_per_s", {nullptr, 1}}}))), ElementsAre());
  EXPECT_THAT(listed(of("sigma0=1", Bench::move("jerk", {{"T_s", 1}}))),  // which judges the bounds, too
              ElementsAre("inertia of motors of j1, j2", "friction", "limit of speed of j1, j2"));
}

// 29.104 kg of the URDF's links without the base: 14.552 kg, with the sternum's 40 kg and 25 N/mm: 0.5425 m/s at 280 N.
TEST(Safety, HasTheMassOfTheStandardBesideTheEffectiveOne) {
  Robots robots = shipped();
  json request{{"service", "safety"},
               {"robot", "ur10e"},
               {"from_q_rad", {0, -1.57, 1.57, -1.57, -1.57, 0}},
               {"to_q_rad", {1.57, -1.05, 1.57, -2.1, -1.57, 0.78}},
               {"T_s", 1.5}};
  request["parts"] = {"sternum"};
  const json reply = ask(robots, request);
  const double M = 7.369 + 13.051 + 3.989 + 2.1 + 1.98 + 0.615, mu = 1 / (1 / (M / 2) + 1.0 / 40),
               limit = 280 / std::sqrt(mu * 25e3);
  EXPECT_NEAR(limit, 0.54, 5e-3);
  const json& simple = reply["iso_ts_15066"];
  EXPECT_NEAR(simple["mass_kg"].get<double>(), M / 2, 1e-9);
  EXPECT_NEAR(simple["limit_m_per_s"].get<double>(), limit, 1e-9);
  const double speed = std::abs(reply["fastest"]["speed_m_per_s"].get<double>());
  EXPECT_NEAR(simple["share"].get<double>(), speed / limit, 1e-9);
  EXPECT_NEAR(simple["T_safe_s"].get<double>(), 1.5 * speed / limit, 1e-9);
  EXPECT_NEAR(simple["energy_J"].get<double>(), mu * speed * speed / 2, 1e-9);
  EXPECT_NEAR(reply["effective"]["limit_m_per_s"].get<double>(), 2.22, 0.01);
  EXPECT_EQ(reply["T_safe_s"], simple["T_safe_s"]);
  EXPECT_TRUE(reply["safe"].is_null());
  EXPECT_THAT(reply["safe_reason"].get<std::string>(),
              HasSubstr("1.71 m/s at sternum, limit 2.22 m/s by the effective mass of 0.644 kg, 0.542"));
  EXPECT_THAT(reply["safe_reason"].get<std::string>(), HasSubstr("there is no drive_train.ssv beside the URDF"));
  // However slow: nobody knows.
  json slow = request;
  slow["T_s"] = 100;
  EXPECT_TRUE(ask(robots, slow)["safe"].is_null());
  json only = request;
  only["mass"] = "effective";
  EXPECT_THAT(refusal(robots, only), HasSubstr("/mass: is effective, but there is no drive_train.ssv"));
  request["load_kg"] = 10;
  EXPECT_NEAR(ask(robots, request)["iso_ts_15066"]["mass_kg"].get<double>(), M / 2 + 10, 1e-9);
  EXPECT_EQ(ask(robots, request)["load_kg"], 10);
  for (const json& load : {json(-1), json("10")}) {
    request["load_kg"] = load;
    EXPECT_THAT(refusal(robots, request), HasSubstr("/load_kg"));
  }
}

TEST(Safety, DecidesByTheLargerMassUnlessTheOtherIsAskedFor) {
  const Bench bench;
  bench.drives("B=2 1;tau_C=1");
  Robots robots = bench.robots();
  json request = Bench::move("safety", {{"parts", {"chest", "hands_and_fingers"}}, {"frame", "tip"}, {"T_s", 2}});
  const auto share = [&](const json& reply, const char* mass) { return reply[mass]["share"].get<double>(); };
  const json larger = ask(robots, request);
  EXPECT_EQ(larger["iso_ts_15066"]["mass_kg"], 4);
  ASSERT_GT(std::abs(share(larger, "effective") - share(larger, "iso_ts_15066")), 0.01);
  for (const json& part : larger["parts"]) {
    EXPECT_EQ(part["share"], std::max(part["effective"]["share"], part["iso_ts_15066"]["share"]));
    EXPECT_EQ(part["energy_J"], std::max(part["effective"]["energy_J"], part["iso_ts_15066"]["energy_J"]));
    EXPECT_EQ(part["T_safe_s"], std::max(part["effective"]["T_safe_s"], part["iso_ts_15066"]["T_safe_s"]));
  }
  request["mass"] = "effective";
  const json effective = ask(robots, request);
  EXPECT_EQ(effective["T_safe_s"], effective["effective"]["T_safe_s"]);
  EXPECT_EQ(effective["effective"], larger["effective"]);
  // At T_safe the verdict changes, by either mass.
  for (const char* mass : {"larger", "effective"}) {
    request["mass"] = mass;
    request["T_s"] = (mass == std::string("larger") ? larger : effective)["T_safe_s"].get<double>() * 1.0001;
    const json at = ask(robots, request);
    EXPECT_EQ(at["safe"], true);
    EXPECT_EQ(at["safe_reason"], "");
    request["T_s"] = at["T_s"].get<double>() * 0.9998;
    const json beyond = ask(robots, request);
    EXPECT_EQ(beyond["safe"], false);
    EXPECT_THAT(beyond["safe_reason"].get<std::string>(), HasSubstr("m/s at sternum, limit")) << beyond;
  }
  // The cost of an optimisation is the share of the service.
  json best = request;
  best.update({{"service", "optimise"},
               {"cost", "safety"},
               {"T_min_s", 2},
               {"particles", 8},
               {"rounds", 4},
               {"degree", 6},
               {"refine", false}});
  for (const char* member : {"T_s"}) best.erase(member);
  for (const char* mass : {"larger", "effective"})
    for (const double load : {0.0, 7.0}) {
      best.update({{"mass", mass}, {"load_kg", load}});
      const json found = ask(robots, best);
      json along = request;
      along.update({{"mass", mass}, {"load_kg", load}, {"T_s", 2}, {"degree", 6}, {"c_r_rad", found["motion"]["c_r_rad"]}});
      const double wanted = std::max(ask(robots, along)["parts"][0]["share"].get<double>(),
                                     ask(robots, along)["parts"][1]["share"].get<double>());
      EXPECT_NEAR(found["costs"]["safety_share"].get<double>(), wanted, 2e-3 * wanted) << mass << load;
    }
  best["cost"] = "torque";
  EXPECT_THAT(refusal(robots, best), HasSubstr("has no effect without the cost"));
}

TEST(Safety, IsUnknownWithoutAMotor) {
  const Bench bench;
  const json request = Bench::move("safety", {{"parts", {"chest"}}, {"T_s", 100}});
  const auto verdict = [&](const std::string& rows) {
    bench.drives(rows);
    Robots robots = bench.robots();
    return ask(robots, request);
  };
  EXPECT_EQ(verdict("B=1")["safe"], true);
  for (const char* rows : {"B=1 0", "B[1]=1", "K=1"}) {
    const json reply = verdict(rows);
    EXPECT_TRUE(reply["safe"].is_null()) << rows;
    EXPECT_THAT(reply["safe_reason"].get<std::string>(), HasSubstr("drive_train.ssv has no inertia of the motors of j"));
  }
  // With the head no contact is permitted at any speed.
  json head = request;
  head["parts"] = {"face"};
  Robots robots = bench.robots();
  EXPECT_TRUE(ask(robots, head)["T_safe_s"].is_null());
  bench.urdf(R"(lower="-3" upper="3" velocity="2" effort="200")", 0);
  Robots light = bench.robots();
  EXPECT_THAT(refusal(light, request), HasSubstr("joint 'j1' moves no mass"));
}

TEST(Throughput, HasNoMovesPerHourOfAMoveThatCannotBe) {
  Robots robots = shipped();
  json request{{"service", "throughput"},
               {"robot", "lwr4"},
               {"from_q_rad", {0, 0.5, 0, -1, 0, 0.6, 0}},
               {"to_q_rad", {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}},
               {"M_kg", 1},
               {"S_N_per_m", 500},
               {"zeta", 1}};
  for (const double T : {0.1, 4.0}) {
    request["T_s"] = T;
    const json reply = ask(robots, request);
    EXPECT_EQ(reply["feasible"], T == 4);
    for (const char* figure : {"T_cycle_s", "moves_per_hour", "stiff_moves_per_hour", "lost_share"})
      EXPECT_EQ(reply[figure].is_null(), T != 4) << figure;
  }
}

TEST(RobotData, IsListedByFile) {
  Robots robots = shipped();
  const json all = data_of_all(robots);
  EXPECT_EQ(
      all["iiwa14"],
      json({{"joints", 7}, {"drive_train.ssv", "partly assumed"}, {"compliance.ssv", "given"}, {"energy.ssv", "assumed"}}));
  EXPECT_EQ(all["ur10e"],
            json({{"joints", 6}, {"drive_train.ssv", "missing"}, {"compliance.ssv", "missing"}, {"energy.ssv", "missing"}}));
  EXPECT_EQ(all["lwr4"]["drive_train.ssv"], "assumed");
  EXPECT_EQ(all["kr300_r2500"]["energy.ssv"], "assumed");
  const Bench bench;
  bench.drives("B=1");
  Robots own = bench.robots();
  EXPECT_EQ(json(data_of_all(own))["arm"]["drive_train.ssv"], "given");
  bench.drives("B=many");
  Robots broken = bench.robots();
  EXPECT_THAT(json(data_of_all(broken))["arm"]["problem"].get<std::string>(), HasSubstr("B: has 'many'"));
}

}  // namespace
}  // namespace cotwin::services::assumptions_test
