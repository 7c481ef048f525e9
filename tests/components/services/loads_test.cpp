// Payloads, wrenches, ends in motion, waypoints and logs in requests: against robots with the tool in their URDF, closed forms of a planar arm,
// and the moves that the logs have sampled.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "components/services/json/json.h"
#include "components/services/services.h"
#include "models/energetics/motion_energy.h"
#include "models/robot/indices.h"
#include "models/robot/urdf/urdf.h"
#include "models/trajectory/series/series.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::services::loads_test {
namespace {

using cotwin::testing::error_of;
using nlohmann::json;
using ::testing::HasSubstr;

std::string robots_folder() { return places::source() + "/models/robots"; }
json ask(Robots& robots, const json& request) { return json::parse(answer(robots, request.dump())); }

json lwr(const std::string& service, const json& more = json::object()) {
  json r{{"service", service},
         {"robot", "lwr4"},
         {"from_q_rad", {0, 0.5, 0, -1, 0, 0.6, 0}},
         {"to_q_rad", {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}},
         {"T_s", 2}};
  r.update(more);
  return r;
}

/// The first place at which two replies differ by more than `tolerance`, relative to numbers above 1. Times of extremes are left out: extremes are
/// flat, and some are there twice.
std::string difference(const json& a, const json& b, double tolerance, const std::string& at = "") {
  if (a.is_number() && b.is_number()) {
    const bool of_peak = at.ends_with("/value") || at.ends_with("/limit");  // of either sign, where both are there
    const double x = of_peak ? std::abs(a.get<double>()) : a.get<double>(),
                 y = of_peak ? std::abs(b.get<double>()) : b.get<double>();
    return std::abs(x - y) <= tolerance * std::max(1.0, std::abs(x)) ? "" : at + ": " + a.dump() + ", " + b.dump();
  }
  if (a.type() != b.type() || (a.is_structured() && a.size() != b.size())) return at + ": " + a.dump() + ", " + b.dump();
  if (!a.is_structured()) return a == b ? "" : at + ": " + a.dump() + ", " + b.dump();
  for (const auto& [key, value] : a.items()) {
    if (a.is_object() && !b.contains(key)) return at + "/" + key;
    if (key.ends_with("t_s") && value.is_number()) continue;
    const json& other = a.is_object() ? b[key] : b[std::stoul(key)];
    if (const std::string d = difference(value, other, tolerance, at + "/" + key); !d.empty()) return d;
  }
  return "";
}

Move random_move(const robot::RobotModel& robot, std::mt19937& random, double T) {
  std::uniform_real_distribution<double> share(0.2, 0.8), small(-0.3, 0.3);
  Move m;
  for (const robot::Joint& joint : robot.joints) {
    const double low = std::max(joint.q_min, -2.0), high = std::min(joint.q_max, 2.0);
    for (auto* q : {&m.from_q, &m.to_q}) q->push_back(low + share(random) * (high - low));
    for (auto* x : {&m.dq_from, &m.dq_to, &m.ddq_from, &m.ddq_to}) x->push_back(small(random));
    for (int k = 0; k < 2; ++k) m.c.push_back(0.2 * small(random));
  }
  m.degree = 7;
  m.T = T;
  return m;
}

robot::Payload random_payload(const robot::RobotModel& robot, std::mt19937& random, robot::Interval when) {
  std::uniform_real_distribution<double> share(0.1, 1);
  robot::Payload p{{"part", robot.end_effector().name, {}, {}, {}}, when};
  p.part.X_PA = {rotation_from_rpy(share(random), share(random), share(random)), {share(random), -0.2, 0.1 * share(random)}};
  p.part.inertia.mass = 3 * share(random);
  p.part.inertia.p_LC = {0.1 * share(random), 0.05, -0.1 * share(random)};
  p.part.inertia.I_CC = Eigen::Vector3d(0.02, 0.03, 0.025).asDiagonal();
  return p;
}

const char* const kRobots[] = {"lwr4", "ur5e", "kr300_r2500", "planar2", "iiwa14"};

// A link that a fixed joint adds to the file is another way through the reader of URDFs.
TEST(Payload, IsAToolInTheUrdf) {
  const testing::TemporaryFolder folder("payload");
  for (const char* name : kRobots) {
    std::string urdf = testing::content(robots_folder() + "/" + name + "/robot.urdf");
    const robot::RobotModel plain = robot::load_urdf(robots_folder() + "/" + name + "/robot.urdf");
    const std::string tool =
        "<link name=\"part\"><inertial><origin xyz=\"0.02 -0.01 0.15\" rpy=\"0 0 0\"/><mass value=\"2.5\"/>"
        "<inertia ixx=\"0.02\" ixy=\"0.001\" ixz=\"0\" iyy=\"0.03\" iyz=\"-0.002\" izz=\"0.025\"/></inertial></link>"
        "<joint name=\"part_joint\" type=\"fixed\"><parent link=\"" +
        plain.end_effector().name + "\"/><child link=\"part\"/><origin xyz=\"0.1 0 0.05\" rpy=\"0 0 0\"/></joint>";
    urdf.insert(urdf.rfind("</robot>"), tool);
    for (const char* file : {"drive_train.ssv", "energy.ssv"})
      if (const std::string text = testing::content(robots_folder() + "/" + name + "/" + file); !text.empty())
        folder.write(std::string(name) + "/" + file, text);
    folder.write(std::string(name) + "/robot.urdf", urdf);
    Robots with({folder.path()}, "", false, places::source() + "/models/people/iso_ts_15066.csv"), without({robots_folder()});
    std::mt19937 random(7);
    Move m = random_move(plain, random, 1.7);
    for (const std::string service : {"torques", "energy", "feasibility", "peak_power", "safety", "reaction"}) {
      json request{{"service", service}, {"robot", name}, {"from_q_rad", m.from_q},
                   {"to_q_rad", m.to_q}, {"T_s", 1.7},    {"detail", "all"}};
      if (service == "reaction") request["base"] = {{"mass_kg", 100}, {"inertia_kg_m2", {9, 0, 0, 9, 0, 9}}};
      if (service == "safety") request["frame"] = plain.end_effector().name;
      const json expected = ask(with, request);
      request["payload"] = {{"frame", plain.end_effector().name},
                            {"p_m", {0.1, 0, 0.05}},
                            {"mass_kg", 2.5},
                            {"com_m", {0.02, -0.01, 0.15}},
                            {"inertia_kg_m2", {0.02, 0.001, 0, 0.03, -0.002, 0.025}}};
      json found = ask(without, request);
      if (service == "safety") {  // there the part is of the robot: M/2, here of the load: m_L
        EXPECT_NEAR(found["iso_ts_15066"]["mass_kg"].get<double>(), expected["iso_ts_15066"]["mass_kg"].get<double>() + 1.25,
                    1e-12);
        EXPECT_EQ(difference(found["effective"], expected["effective"], 1e-9), "") << name;
        continue;
      }
      EXPECT_EQ(difference(found, expected, service == "reaction" ? 1e-9 : 1e-12), "") << name << " " << service;
    }
  }
}

TEST(Payload, MayBeAToolByNameAndCarryAnotherOne) {
  const testing::TemporaryFolder folder("tools");
  folder.write(
      "tools/gripper.urdf",
      "<robot name=\"gripper\"><link name=\"hand\"><inertial><origin xyz=\"0 0 0.05\"/><mass value=\"0.8\"/><inertia "
      "ixx=\"1e-3\" "
      "ixy=\"0\" ixz=\"0\" iyy=\"1e-3\" iyz=\"0\" izz=\"6e-4\"/></inertial></link><link name=\"tcp\"/><joint name=\"j\" "
      "type=\"fixed\"><parent link=\"hand\"/><child link=\"tcp\"/><origin xyz=\"0 0 0.12\"/></joint></robot>");
  std::filesystem::create_directories(folder / "robots");
  Robots robots({robots_folder(), folder / "robots"});
  const json part{{"mass_kg", 2}, {"from_share", 0.3}, {"to_share", 0.8}};
  json on_tcp = part, at_place = part;
  on_tcp["frame"] = "tcp";
  at_place["p_m"] = {0, 0, 0.12};
  const json hand{{"mass_kg", 0.8}, {"com_m", {0, 0, 0.05}}, {"inertia_kg_m2", {1e-3, 0, 0, 1e-3, 0, 6e-4}}};
  const json by_name = ask(robots, lwr("torques", {{"payload", {"gripper", on_tcp}}, {"detail", "all"}}));
  EXPECT_EQ(ask(robots, lwr("torques", {{"payload", "gripper"}})),
            ask(robots, lwr("torques", {{"payload", {{"tool", "gripper"}}}})));
  const json by_numbers = ask(robots, lwr("torques", {{"payload", {hand, at_place}}, {"detail", "all"}}));
  EXPECT_EQ(difference(by_name, by_numbers, 1e-12), "");
  EXPECT_NE(difference(by_name, ask(robots, lwr("torques", {{"payload", hand}, {"detail", "all"}})), 1e-3), "");
  const auto refusal = [&](const json& payload) {
    return error_of([&] { ask(robots, lwr("torques", {{"payload", payload}})); });
  };
  EXPECT_THAT(refusal({{"tool", "hammer"}}), HasSubstr("/payload/tool: tool: 'hammer' is unknown, expected tools/hammer.urdf"));
  EXPECT_THAT(refusal({{"tool", "../gripper"}}), HasSubstr("/payload/tool: tool: is not a name"));
  EXPECT_THAT(refusal({{"tool", "gripper"}, {"mass_kg", 1}}), HasSubstr("/payload/mass_kg: is given beside a tool"));
  EXPECT_THAT(refusal({{{"tool", "gripper"}, {"to_share", 0.7}}, on_tcp}),
              HasSubstr("/payload/1/frame: is on the payload payload_1, which is not carried all that time"));
}

// Of the arm of two joints that turn about −y: x = l1 c1 + l2 c12, z = l1 s1 + l2 s12.
TEST(Wrench, IsTheTransposedJacobianTimesItInClosedForm) {
  Robots robots({robots_folder()});
  constexpr double l1 = 0.4, l2 = 0.35, fx = 13, fz = -27, my = 4;
  json request{{"service", "torques"},    {"robot", "planar2"}, {"from_q_rad", {0.3, 0.4}},
               {"to_q_rad", {1.1, -0.9}}, {"T_s", 1},           {"detail", "all"}};
  for (const char* axes : {"base", "frame"}) {
    request["wrench"] = {
        {"frame", "tip"}, {"force_N", {fx, 5, fz}}, {"moment_Nm", {1, my, 2}}, {"axes", axes}, {"from_share", 0.25}};
    const json series = ask(robots, request)["series"];
    for (std::size_t i = 0; i < series["t_s"].size(); ++i) {
      const auto value = [&](std::size_t j, const char* name) { return series["joints"][j][name][i].get<double>(); };
      const double q1 = value(0, "q_rad"), q12 = q1 + value(1, "q_rad");
      const bool turned = std::string(axes) == "frame";
      const double X = turned ? std::cos(q12) * fx - std::sin(q12) * fz : fx,
                   Z = turned ? std::sin(q12) * fx + std::cos(q12) * fz : fz;
      const bool acts = series["t_s"][i].get<double>() >= 0.25;
      const double tau_2 = -l2 * std::sin(q12) * X + l2 * std::cos(q12) * Z - my;
      const double tau_1 = -l1 * std::sin(q1) * X + l1 * std::cos(q1) * Z + tau_2;
      EXPECT_NEAR(value(0, "external_Nm"), acts ? -tau_1 : 0, 1e-12) << axes << i;
      EXPECT_NEAR(value(1, "external_Nm"), acts ? -tau_2 : 0, 1e-12) << axes << i;
      EXPECT_NEAR(value(1, "tau_Nm"),
                  value(1, "inertial_Nm") + value(1, "coriolis_Nm") + value(1, "gravity_Nm") + value(1, "drive_Nm") +
                      value(1, "external_Nm"),
                  1e-12);
    }
  }
}

// What the motors and the wrench do is in the energies and in friction, for loads that come and go at any time.
TEST(Loads, BalanceTheBooksOfEnergy) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> share(0, 1), force(-40, 40);
  for (const char* name : kRobots)
    for (int trial = 0; trial < 4; ++trial) {
      const robot::RobotModel robot = robot::load_urdf(robots_folder() + "/" + name + "/robot.urdf");
      Move m = random_move(robot, random, 1.5);
      double a = share(random), b = share(random), c = share(random), d = share(random);
      m.loads.payloads.push_back(random_payload(robot, random, {std::min(a, b), std::max(a, b)}));
      m.loads.wrench = robot::ExternalWrench{robot.end_effector(), {}, trial % 2 == 0, {std::min(c, d), std::max(c, d)}};
      for (double& f : m.loads.wrench->f) f = force(random);
      const Plan p = plan(robot, m);
      energetics::RigidRobot body(robot, m.loads);
      energetics::Accountant accountant(robot.joints.size(), energetics::Bus::kShared);
      std::ranges::fill(accountant.losses.k_t, 1.0);
      const auto energy = energetics::energy_of_motion(body, p.solution.path, accountant, {});
      EXPECT_LT(std::abs(energy.residual()), 1e-7 * (1 + std::abs(energy.books.mechanical()))) << name << trial;
      EXPECT_GT(std::abs(energy.external), 1e-3);
      // Cost and peaks by samples that know nothing of the intervals but which load acts.
      constexpr std::size_t kSamples = 40001;
      const Torques t = torques(robot, m, kSamples);
      const std::size_t n = robot.joints.size();
      double squares = 0;
      std::vector<double> most(n);
      for (std::size_t k = 0; k < t.q.size(); ++k) {
        const double weight = k < n || k >= t.q.size() - n ? 0.5 : 1;
        squares += weight * t.torque(k) * t.torque(k) * m.T / (kSamples - 1);
        most[k % n] = std::max(most[k % n], std::abs(t.torque(k)));
      }
      EXPECT_NEAR(p.torque() / squares, 1, 1e-3) << name << trial;
      for (std::size_t j = 0; j < n; ++j)
        EXPECT_NEAR(std::abs(p.solution.peaks[5 * j + 4].value), most[j], 0.01 * most[j] + 1e-9) << name << trial;
      // The same motion as a path.
      Move as_path = m;
      as_path.path = p.solution.path;
      const Plan other = plan(robot, as_path);
      for (std::size_t k = 0; k < p.solution.costs.size(); ++k)
        EXPECT_NEAR(other.solution.costs[k], p.solution.costs[k], 1e-9 * (1 + p.solution.costs[k])) << name << k;
      for (std::size_t k = 0; k < p.solution.peaks.size(); ++k)
        EXPECT_NEAR(other.solution.peaks[k].value, p.solution.peaks[k].value, 1e-9 * (1 + std::abs(p.solution.peaks[k].value)));
    }
}

// A payload that is carried to the end is held while the robot waits; a wrench ends with the motion.
TEST(Loads, CountInTheWaitOnlyIfTheyAreStillCarried) {
  Robots robots({robots_folder()});
  const auto waiting = [&](json more) {
    more["cycle_s"] = 4;
    return ask(robots, lwr("energy", more))["waiting"]["energy_J"].get<double>();
  };
  const double empty = waiting(json::object());
  EXPECT_GT(waiting({{"payload", {{"mass_kg", 5}}}}), empty + 0.1);
  EXPECT_EQ(waiting({{"payload", {{"mass_kg", 5}, {"to_share", 0.9}}}}), empty);
  EXPECT_EQ(waiting({{"wrench", {{"force_N", {0, 0, -50}}}}}), empty);
}

// The shortest duration is that at whose torques a bound is met, also where the load makes it.
TEST(Loads, LengthenTheShortestDuration) {
  Robots robots({robots_folder()});
  json request = lwr("cycle_time");
  request.erase("T_s");
  const double free = ask(robots, request)["T_s"];
  request["payload"] = {{"mass_kg", 14}, {"com_m", {0, 0, 0.1}}, {"from_share", 0.5}};
  request["wrench"] = {{"force_N", {0, 0, -40}}};
  const json loaded = ask(robots, request);
  ASSERT_GT(loaded["T_s"].get<double>(), free * 1.02);
  json timed = request;
  timed["service"] = "feasibility";
  timed["T_s"] = loaded["T_s"].get<double>() * (1 + 1e-6);
  EXPECT_EQ(ask(robots, timed)["feasible"], true);
  timed["T_s"] = loaded["T_s"].get<double>() * (1 - 1e-5);
  EXPECT_EQ(ask(robots, timed)["feasible"], false);
  EXPECT_EQ(loaded["limiting"]["bound"], "tau");
  request["payload"]["mass_kg"] = 60;
  request["payload"]["from_share"] = 0;
  const json never = ask(robots, request);
  EXPECT_EQ(never["feasible"], false);
  EXPECT_TRUE(never["T_s"].is_null());
}

TEST(EndsInMotion, AreThoseOfThePolynomialOfUnitMotion) {
  Robots robots({robots_folder()});
  std::mt19937 random(5);
  const auto robot = robots.find("lwr4");
  const Move m = random_move(robot->model, random, 1.4);
  json request = lwr("feasibility", {{"from_q_rad", m.from_q},
                                     {"to_q_rad", m.to_q},
                                     {"T_s", m.T},
                                     {"degree", 7},
                                     {"c_r_rad", m.c},
                                     {"detail", "all"},
                                     {"samples", 201},
                                     {"dq_from_rad_per_s", m.dq_from},
                                     {"dq_to_rad_per_s", m.dq_to},
                                     {"ddq_from_rad_per_s2", m.ddq_from},
                                     {"ddq_to_rad_per_s2", m.ddq_to}});
  const json reply = ask(robots, request), motion = reply["motion"];
  EXPECT_EQ(motion["dq_start_rad_per_s"], json(m.dq_from));
  EXPECT_EQ(motion["ddq_end_rad_per_s2"], json(m.ddq_to));
  const trajectory::RedundantTerms terms(7);
  for (std::size_t j = 0; j < 7; ++j) {
    const trajectory::Path own(
        1, {0, m.T}, 7,
        trajectory::make_polynomial({m.from_q[j], m.dq_from[j], m.ddq_from[j], {}}, {m.to_q[j], m.dq_to[j], m.ddq_to[j], {}},
                                    m.T, terms, std::span(m.c).subspan(2 * j, 2)));
    for (std::size_t i = 0; i < 201; ++i) {
      double q, dq, ddq;
      own.at(reply["series"]["t_s"][i], {&q, 1}, {&dq, 1}, {&ddq, 1});
      EXPECT_NEAR(reply["series"]["joints"][j]["q_rad"][i].get<double>(), q, 1e-12);
      EXPECT_NEAR(reply["series"]["joints"][j]["ddq_rad_per_s2"][i].get<double>(), ddq, 1e-10);
    }
  }
  request.erase("T_s");
  EXPECT_THAT(error_of([&] { ask(robots, request); }), HasSubstr("/T_s: is missing, and the move begins or ends in motion"));
  request["T_s"] = 1.4;
  request["service"] = "cycle_time";
  EXPECT_THAT(error_of([&] { ask(robots, request); }), HasSubstr("is an unknown member"));
  // A search keeps them, and no duration is safe that changes them.
  json search = lwr("optimise", {{"T_min_s", 2}, {"particles", 8}, {"rounds", 4}, {"dq_from_rad_per_s", m.dq_from}});
  search.erase("T_s");
  EXPECT_EQ(ask(robots, search)["motion"]["dq_start_rad_per_s"], json(m.dq_from));
  EXPECT_TRUE(ask(robots, lwr("safety", {{"dq_from_rad_per_s", m.dq_from}}))["T_safe_s"].is_null());
  EXPECT_THAT(error_of([&] {
                ask(robots, lwr("energy", {{"dq_from_rad_per_s", m.dq_from}, {"best", true}}));
              }),
              HasSubstr("/best: is true"));
}

// All services that take a log answer it as the move that it has sampled.
TEST(Series, HasTheAnswersOfTheMoveThatItSamples) {
  Robots robots({robots_folder()});
  const json load{
      {"payload", {{"mass_kg", 3}, {"com_m", {0, 0.02, 0.1}}}}, {"wrench", {{"force_N", {5, -10, 20}}}}, {"detail", "all"}};
  const json whole = ask(robots, lwr("feasibility", {{"samples", 401}, {"detail", "all"}}))["series"];
  json series{{"t_s", whole["t_s"]}};
  for (std::size_t i = 0; i < 401; ++i) {
    json row = json::array();
    for (std::size_t j = 0; j < 7; ++j) row.push_back(whole["joints"][j]["q_rad"][i]);
    series["q_rad"].push_back(row);
  }
  std::size_t services = 0;
  for (const std::string& service : service_names()) {
    const json properties = json::parse(schema(service))["request"]["properties"];
    if (!properties.contains("series") || service == "reaction") continue;
    ++services;
    json of_move = load;
    if (service == "effective_mass" || service == "safety") of_move["samples"] = 51;
    json of_log = of_move;
    of_log.update({{"service", service}, {"robot", "lwr4"}, {"series", series}});
    json expected = ask(robots, lwr(service, of_move)), found = ask(robots, of_log);
    expected.erase("motion");
    if (service == "energy")  // the largest one of an interval's mean values
      expected["peak_power_W"] = found["peak_power_W"] =
          std::abs(expected["peak_power_W"].get<double>() / found["peak_power_W"].get<double>() - 1) < 1e-3;
    for (std::size_t j = 0; service == "torques" && j < 7; ++j)
      for (const char* term : {"inertial_Nm", "coriolis_Nm", "gravity_Nm", "drive_Nm", "external_Nm"}) {
        json &own = found["joints"][j][term], &other = expected["joints"][j][term];
        EXPECT_NEAR(std::abs(own.get<double>()), std::abs(other.get<double>()), 5e-3)
            << j << term;  // the largest one at samples
        own = other;
      }
    // The heaviest direction is that of a velocity of 1e-9 m/s, at the end.
    EXPECT_EQ(difference(found, expected, service == "effective_mass" || service == "safety" ? 1e-4 : 2e-6), "") << service;
  }
  EXPECT_EQ(services, 9U);
}

TEST(Series, IsSmoothedOnRequestAndTellsNoise) {
  Robots robots({robots_folder()});
  std::mt19937 random(9);
  std::normal_distribution<double> noise(0, 1e-4);
  const json whole = ask(robots, lwr("feasibility", {{"samples", 2001}, {"detail", "all"}}));
  json series{{"t_s", whole["series"]["t_s"]}};
  for (std::size_t i = 0; i < 2001; ++i) {
    json row = json::array();
    for (std::size_t j = 0; j < 7; ++j) row.push_back(whole["series"]["joints"][j]["q_rad"][i].get<double>() + noise(random));
    series["q_rad"].push_back(row);
  }
  json request{{"service", "energy"}, {"robot", "lwr4"}, {"series", series}};
  const json move = ask(robots, lwr("energy"));
  const json noisy = ask(robots, request);
  EXPECT_THAT(noisy["notes"].dump(), HasSubstr("accelerations of the series rest on its noise: joint "));
  EXPECT_GT(noisy["energy_J"].get<double>(), 2 * move["energy_J"].get<double>());
  request["series"]["cutoff_Hz"] = 8;
  const json smooth = ask(robots, request);
  EXPECT_NEAR(smooth["energy_J"].get<double>() / move["energy_J"].get<double>(), 1, 0.02);
  EXPECT_THAT(ask(robots, {{"service", "energy"},
                           {"robot", "lwr4"},
                           {"waypoints", {{"t_s", {0, 2}}, {"q_rad", {series["q_rad"][0], series["q_rad"][2000]}}}}})
                  .value("notes", json::array())
                  .dump(),
              ::testing::Not(HasSubstr("noise")));
}

TEST(Waypoints, AreTheMovesBetweenThem) {
  Robots robots({robots_folder()});
  const json a = lwr("energy")["from_q_rad"], b = lwr("energy")["to_q_rad"];
  json there_and_back{{"robot", "lwr4"}, {"waypoints", {{"t_s", {0, 2, 4.5}}, {"q_rad", {a, b, a}}, {"dwell_s", {0, 0.5, 0}}}}};
  there_and_back["service"] = "feasibility";
  there_and_back["detail"] = "all";
  const json there = ask(robots, lwr("feasibility", {{"detail", "all"}})),
             back = ask(robots, lwr("feasibility", {{"detail", "all"}, {"from_q_rad", b}, {"to_q_rad", a}}));
  const json both = ask(robots, there_and_back);
  EXPECT_EQ(both["T_s"], 4.5);
  EXPECT_FALSE(both.contains("motion"));
  EXPECT_NEAR(both["work_J"].get<double>(), there["work_J"].get<double>() + back["work_J"].get<double>(), 1e-3);
  for (std::size_t j = 0; j < 7; ++j)
    EXPECT_NEAR(std::abs(both["joints"][j]["dq_rad_per_s"]["value"].get<double>()),
                std::abs(there["joints"][j]["dq_rad_per_s"]["value"].get<double>()), 1e-9);
  there_and_back["waypoints"] = {{"t_s", {0, 2}}, {"q_rad", {a, b}}};
  json one = ask(robots, there_and_back), plain = there;
  plain.erase("motion");
  EXPECT_EQ(difference(one, plain, 1e-9), "");
  // They pass a point on the way without rest, and a point may be there twice.
  const json middle{0.5, 0.2, 0.1, -0.3, -0.2, 0.2, 0.3};
  there_and_back["waypoints"] = {{"t_s", {0, 1, 2, 3}}, {"q_rad", {a, middle, b, b}}, {"passing", "through"}};
  EXPECT_GT(std::abs(ask(robots, there_and_back)["series"]["joints"][0]["dq_rad_per_s"][33].get<double>()), 0.3);
  there_and_back["waypoints"] = {{"t_s", {0, 1, 2}},
                                 {"q_deg", {{0, 10, 0, 0, 0, 0, 0}, {0, 10, 0, 0, 0, 0, 0}, {10, 20, 0, 0, 0, 0, 0}}}};
  EXPECT_NEAR(ask(robots, there_and_back)["series"]["joints"][1]["q_rad"][100].get<double>(), 20 * M_PI / 180, 1e-12);
}

// At rest a joint holds the moment of the arm and of the mass: m = min (bound − |g_j|)/(g · lever).
TEST(LargestPayload, OfAPlanarArmAtRestIsTheClosedForm) {
  Robots robots({robots_folder()});
  constexpr double g = 9.81, l1 = 0.4, l2 = 0.35;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> angle(-1.2, 1.2);
  for (int trial = 0; trial < 20; ++trial) {
    const double q1 = angle(random), q2 = angle(random), q12 = q1 + q2;
    const double g2 = 4 * g * 0.175 * std::cos(q12), g1 = g * (6 * 0.2 + 4 * l1) * std::cos(q1) + g2;
    const double lever_2 = l2 * std::cos(q12), lever_1 = l1 * std::cos(q1) + lever_2;
    const auto limit = [](double bound, double torque, double per_kg) {
      return (std::copysign(bound, per_kg) - torque) / per_kg;
    };
    const double expected = std::min(limit(150, g1, g * lever_1), limit(75, g2, g * lever_2));
    const json reply = ask(robots, {{"service", "payload"},
                                    {"robot", "planar2"},
                                    {"from_q_rad", {q1, q2}},
                                    {"to_q_rad", {q1, q2}},
                                    {"T_s", 1},
                                    {"drives", "none"}});
    EXPECT_NEAR(reply["mass_kg"].get<double>() / expected, 1, 1e-9) << q1 << " " << q2;
    EXPECT_EQ(reply["limiting"]["bound"], "tau");
  }
  // With it the motion is just feasible, also in motion, for a part of it and beside another payload.
  json request = lwr("payload", {{"com_m", {0.05, 0, 0.1}},
                                 {"from_share", 0.3},
                                 {"payload", {{"mass_kg", 1.5}}},
                                 {"wrench", {{"force_N", {0, 0, -20}}}}});
  const double most = ask(robots, request)["mass_kg"];
  for (const auto& [factor, feasible] : {std::pair{1 - 1e-6, true}, {1 + 1e-6, false}}) {
    json with = request;
    with.erase("com_m");
    with.erase("from_share");
    with["service"] = "feasibility";
    with["payload"] = {{{"mass_kg", 1.5}}, {{"mass_kg", factor * most}, {"com_m", {0.05, 0, 0.1}}, {"from_share", 0.3}}};
    EXPECT_EQ(ask(robots, with)["feasible"], feasible);
  }
  request["tau_max_Nm"] = json::array({nullptr, nullptr, nullptr, nullptr, nullptr, nullptr, nullptr});
  EXPECT_TRUE(ask(robots, request)["mass_kg"].is_null());
  EXPECT_THAT(ask(robots, request)["notes"].dump(), HasSubstr("no bound of torque limits the payload"));
  request = lwr("payload", {{"T_s", 0.2}});
  EXPECT_EQ(ask(robots, request)["feasible"], false);
  EXPECT_TRUE(ask(robots, request)["mass_kg"].is_null());
  request.erase("T_s");
  EXPECT_THAT(error_of([&] { ask(robots, request); }), HasSubstr("/T_s: is missing, expected it"));
}

// w = l1 l2 |sin q2|, and accelerations J M⁻¹ τ_max from the matrices.
TEST(Manipulability, OfAPlanarArmIsTheClosedForm) {
  Robots robots({robots_folder()});
  json request{
      {"service", "manipulability"}, {"robot", "planar2"}, {"from_q_rad", {0.3, 0.2}}, {"to_q_rad", {0.8, 2.4}}, {"T_s", 1}};
  json reply = ask(robots, request);
  EXPECT_EQ(reply["kinematic"]["dimensions"], 2);
  EXPECT_NEAR(reply["kinematic"]["least"]["measure"].get<double>(), 0.4 * 0.35 * std::sin(0.2), 1e-12);
  EXPECT_EQ(reply["kinematic"]["least"]["t_s"], 0);
  EXPECT_NEAR(reply["kinematic"]["greatest"]["measure"].get<double>(), 0.4 * 0.35, 1e-9);
  const double dynamic = reply["dynamic"]["least"]["measure"];
  request["payload"] = {{"mass_kg", 5}};
  EXPECT_LT(ask(robots, request)["dynamic"]["least"]["measure"].get<double>(), 0.9 * dynamic);
  EXPECT_EQ(ask(robots, request)["kinematic"], reply["kinematic"]);
  request["tau_max_Nm"] = {10, nullptr};
  EXPECT_TRUE(ask(robots, request)["dynamic"].is_null());
}

TEST(Reach, FindsPosesOfRandomPosturesAndNamesTheBound) {
  Robots robots({robots_folder()});
  std::mt19937 random(2);
  for (const char* name : {"lwr4", "ur5e", "kr300_r2500"}) {
    const auto robot = robots.find(name);
    const robot::Mechanism mechanism(robot->model);
    robot::Data data(mechanism);
    json request{{"service", "reach"}, {"robot", name}};
    std::vector<Pose> poses;
    for (int k = 0; k < 8; ++k) {
      const Move m = random_move(robot->model, random, 1);
      const Pose X = forward_kinematics(mechanism, data, Eigen::Map<const Eigen::VectorXd>(m.from_q.data(), robot->model.n()),
                                        robot::on_body(robot->model.end_effector()));
      const Eigen::Quaterniond Q(X.R);
      poses.push_back(X);
      request["poses"].push_back({{"p_m", {X.p.x(), X.p.y(), X.p.z()}}, {"quaternion_wxyz", {Q.w(), Q.x(), Q.y(), Q.z()}}});
    }
    const json reply = ask(robots, request);
    EXPECT_EQ(reply["feasible"], true) << reply["reason"];
    for (std::size_t k = 0; k < poses.size(); ++k) {
      const std::vector<double> q = reply["poses"][k]["q_rad"];
      const Pose X = forward_kinematics(mechanism, data, Eigen::Map<const Eigen::VectorXd>(q.data(), robot->model.n()),
                                        robot::on_body(robot->model.end_effector()));
      EXPECT_LT((X.p - poses[k].p).norm() + (X.R - poses[k].R).norm(), 1e-8) << name;
      for (std::size_t j = 0; j < q.size(); ++j)
        EXPECT_TRUE(q[j] >= robot->model.joints[j].q_min && q[j] <= robot->model.joints[j].q_max);
    }
    EXPECT_FALSE(reply.contains("assumptions"));
  }
  json request{{"service", "reach"}, {"robot", "planar2"}, {"directions", {"x", "z"}}, {"frame", "tip"}};
  request["poses"] = {{{"p_m", {0.3, 0, 0.7}}, {"quaternion_wxyz", {1, 0, 0, 0}}},
                      {{"p_m", {0, 0, 2}}, {"quaternion_wxyz", {1, 0, 0, 0}}}};
  json reply = ask(robots, request);
  EXPECT_EQ(reply["poses"][0]["reached"], true);
  EXPECT_NEAR(reply["poses"][1]["distance_m"].get<double>(), 0.75, 1e-6);
  EXPECT_THAT(reply["reason"].get<std::string>(), ::testing::StartsWith("pose 2: "));
  EXPECT_THAT(reply["reason"].get<std::string>(), HasSubstr("out of reach without bounds of positions, too"));
  request["q_max_rad"] = {nullptr, 1};
  request["q_min_rad"] = {nullptr, -1};
  reply = ask(robots, request);
  EXPECT_EQ(reply["poses"][0]["reached"], false);
  EXPECT_THAT(reply["poses"][0]["reason"].get<std::string>(), HasSubstr("reached beyond bounds with elbow at "));
}

TEST(Loads, AreRefusedWhereTheyCannotBe) {
  Robots robots({robots_folder()});
  const auto refusal = [&](const char* name, const json& value, const char* service = "torques") {
    return error_of([&] { ask(robots, lwr(service, {{name, value}})); });
  };
  EXPECT_THAT(refusal("payload", {{"mass_kg", 0}}), HasSubstr("/payload/mass_kg: is 0"));
  EXPECT_THAT(refusal("payload", json::object()), HasSubstr("/payload/mass_kg: is missing"));
  EXPECT_THAT(refusal("payload", {{"mass_kg", 1}, {"inertia_kg_m2", {1, 0, 0, 1, 0, 3}}}),
              HasSubstr("/payload: robot 'lwr4_published_fit', attachment 'payload_1': principal moments"));
  EXPECT_THAT(refusal("payload", {{"mass_kg", 1}, {"frame", "link_77"}}), HasSubstr("no frame 'link_77'"));
  EXPECT_THAT(refusal("payload", {{"mass_kg", 1}, {"name", "link_3"}}), HasSubstr("already has a frame with this name"));
  EXPECT_THAT(refusal("payload", {{"mass_kg", 1}, {"from_share", 0.5}, {"to_share", 0.5}}),
              HasSubstr("/payload/to_share: is 0.5, expected more than from_share"));
  EXPECT_THAT(refusal("payload", {{"mass_kg", 1}, {"to_share", 1.5}}), HasSubstr("/payload/to_share: is 1.5, expected 0 to 1"));
  EXPECT_THAT(refusal("payload", {{"mass_kg", 1}, {"from_share", -0.1}}),
              HasSubstr("/payload/from_share: is -0.1, expected 0 to 1"));
  EXPECT_THAT(refusal("payload", json::array()), HasSubstr("/payload: has 0 payloads, expected 1 to 8"));
  EXPECT_THAT(refusal("payload", {{"mass_kg", 1}, {"box_m", {1, 0, 1}}}),
              HasSubstr("/payload/box_m: has an edge of 0 or less"));
  EXPECT_THAT(refusal("payload", {{"mass_kg", 1}, {"weight", 1}}), HasSubstr("/payload/weight: is an unknown member"));
  EXPECT_THAT(refusal("wrench", json::object()), HasSubstr("/wrench/force_N: and moment_Nm are missing"));
  EXPECT_THAT(refusal("wrench", {{"force_N", {1, 2}}}), HasSubstr("/wrench/force_N: has 2 values, expected 3"));
  EXPECT_THAT(refusal("wrench", {{"force_N", {1, 2, 1e300}}}), HasSubstr("/wrench/force_N: has numbers of 1e15 and more"));
  EXPECT_THAT(refusal("wrench", {{"force_N", {1, 2, 3}}, {"frame", "hand"}}), HasSubstr("/wrench/frame: "));
  EXPECT_THAT(refusal("wrench", {{"force_N", {1, 2, 3}}, {"axes", "world"}}), HasSubstr("/wrench/axes: is 'world'"));
  EXPECT_THAT(refusal("payload", {{"mass_kg", 1}, {"from_share", 0.5}}, "reaction"),
              HasSubstr("/payload/from_share: is an unknown member"));
  EXPECT_THAT(refusal("wrench", {{"force_N", {1, 2, 3}}}, "reaction"), HasSubstr("/wrench: is an unknown member"));
  json search =
      lwr("optimise", {{"T_min_s", 2}, {"cost", "effective_mass"}, {"payload", {{"mass_kg", 1}, {"from_share", 0.5}}}});
  search.erase("T_s");
  EXPECT_THAT(error_of([&] { ask(robots, search); }), HasSubstr("comes or goes on the way"));
  // A start that needs more torque than there is is an answer.
  const json heavy = ask(robots, lwr("feasibility", {{"payload", {{"mass_kg", 80}, {"to_share", 0.1}}}}));
  EXPECT_EQ(heavy["feasible"], false);
  EXPECT_THAT(heavy["reason"].get<std::string>(), HasSubstr("tau = "));

  const json row = lwr("torques")["from_q_rad"];
  const auto path = [&](const char* kind, const json& value) {
    return error_of([&] { ask(robots, {{"service", "torques"}, {"robot", "lwr4"}, {kind, value}}); });
  };
  EXPECT_THAT(path("waypoints", {{"t_s", {0, 1, 1}}, {"q_rad", {row, row, row}}}), HasSubstr("/waypoints/t_s/2: is 1 after 1"));
  EXPECT_THAT(path("waypoints", {{"t_s", {0, 1}}, {"q_rad", {row, row}}, {"dwell_s", {2, 0}}}),
              HasSubstr("/waypoints/t_s: waypoint 2: reached at 1 s"));
  EXPECT_THAT(path("waypoints", {{"t_s", {0}}, {"q_rad", json::array({row})}}),
              HasSubstr("is no array of 1 postures, one per time (2 to 100000)"));
  EXPECT_THAT(path("waypoints", {{"t_s", {0, 1}}, {"q_rad", {row, {1, 2}}}}),
              HasSubstr("/waypoints/q_rad/1: has 2 values, expected 7"));
  EXPECT_THAT(path("series", {{"t_s", {0, 0.1, 0.2, 0.3, 1.2}}, {"q_rad", {row, row, row, row, row}}}),
              HasSubstr("/series/t_s/4: is 0.9 s after the one before, a gap"));
  EXPECT_THAT(path("series", {{"t_s", {0, 0.1, 0.2}}, {"q_rad", {row, row, row}}, {"cutoff_Hz", 50}}),
              HasSubstr("/series/cutoff_Hz: "));
  EXPECT_THAT(error_of([&] {
                ask(robots, lwr("torques", {{"waypoints", {{"t_s", {0, 1}}, {"q_rad", {row, row}}}}}));
              }),
              HasSubstr("/from_q_rad: is given beside waypoints"));
}

}  // namespace
}  // namespace cotwin::services::loads_test
