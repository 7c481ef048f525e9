// One verdict per reply: findings, light, sentence and what is required of them.
#include "components/services/json/verdict.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <random>
#include <set>

#include "components/services/json/control/control.h"
#include "components/services/json/control/tasks.h"
#include "components/services/json/json.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::services::verdict_test {
namespace {

using cotwin::testing::content;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// "measured": lwr4 as if its drives were measured, "slide": a prismatic joint below a revolute one, and the shipped robots.
class Bench {
 public:
  Bench() : folder_("verdicts"), robots_(robots()) {
    context_.verify = [](const Robot& robot, const Move& move, double T, const VerificationOptions& options) {
      Move timed = move;
      timed.T = T;
      Verification v;
      v.reason = plan(robot.model, timed).solution.reason;
      if (v.reason.empty() && options.tracking_max < 1e-3) v.reason = "tracking error 0.001 in the twin";
      v.feasible = v.reason.empty();
      v.T = T;
      for (auto* x : {&v.tracking, &v.end_error, &v.tau, &v.tau_rigid, &v.dq, &v.tau_limit})
        x->assign(robot.model.joints.size(), 1);
      return v;
    };
  }
  Json ask(const Json& request) { return Json::parse(answer_object(robots_, request, context_)); }
  Json ask(const char* request) { return ask(Json::parse(request)); }
  Robots& library() { return robots_; }

 private:
  Robots robots() {
    const std::string shipped = places::source() + "/models/robots";
    for (const char* file : {"measured/drive_train.ssv", "measured/energy.ssv"}) {
      std::string text = content(shipped + "/lwr4" + std::string(file).substr(8)), kept;
      for (std::size_t at = 0, end = 0; at < text.size(); at = end + 1) {
        end = std::min(text.find('\n', at), text.size());
        if (const std::string line = text.substr(at, end - at); line.find(R"(name="assumed")") == std::string::npos)
          kept += line + "\n";
      }
      folder_.write(file, kept);
    }
    folder_.write("measured/robot.urdf", content(shipped + "/lwr4/robot.urdf"));
    folder_.write("measured/hulls.urdf", content(shipped + "/lwr4/hulls.urdf"));
    const std::string inertial = R"(<inertial><mass value="4"/><origin xyz="0.2 0 0"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>)";
    folder_.write("slide/robot.urdf", R"(<robot name="slide"><link name="base"/><link name="car">)" + inertial +
                                          R"(</link><link name="arm">)" + inertial + R"(</link>
      <joint name="rail" type="prismatic"><parent link="base"/><child link="car"/><axis xyz="1 0 0"/>
        <limit lower="-2" upper="2" velocity="1.5" effort="300"/></joint>
      <joint name="turn" type="revolute"><parent link="car"/><child link="arm"/><axis xyz="0 1 0"/>
        <limit lower="-2" upper="2" velocity="3" effort="60"/></joint></robot>)");
    return Robots({folder_.path(), shipped}, "measured", false, places::source() + "/models/people/iso_ts_15066.csv");
  }

  cotwin::testing::TemporaryFolder folder_;
  Robots robots_;
  Context context_;
};

constexpr const char* kFar = R"("from_q_rad": [0, -0.9, 0, 1.2, 0, 0.6, 0], "to_q_rad": [1.2, 0.9, 0, -1.2, 0, -0.6, 0])";

Json far(const std::string& members) { return Json::parse("{" + std::string(kFar) + ", " + members + "}"); }

std::string says(const Json& reply, const std::string& of) {
  for (const Json& finding : reply["verdict"]["findings"])
    if (finding["of"] == of) return finding["says"];
  return "";
}

/// Random requests, seeded: every goal, and every service but reactionless, which searches long.
class Requests {
 public:
  explicit Requests(std::uint32_t seed) : random_(seed) {}
  Json next() {
    const std::string robot = one_of({"measured", "measured", "ur10e", "planar2", "slide"});
    static const std::map<std::string, std::vector<double>> kReach = {{"measured", {2.9, 2, 2.9, 2, 2.9, 2, 2.9}},
                                                                      {"ur10e", {3, 3, 2.8, 3, 3, 3}},
                                                                      {"planar2", {2, 2}},
                                                                      {"slide", {2.1, 2.1}}};
    q_ = robot == "slide" ? "q" : "q_rad";
    std::vector<double> from, to;
    for (const double most : kReach.at(robot)) {
      from.push_back(between(-most, most));
      to.push_back(from.back() + between(-1, 1) * between(0, most));
    }
    Json m{{"robot", robot}};
    m["from_" + q_] = from;
    m["to_" + q_] = to;
    const double T = std::vector<double>{0.3, 1, 2, 4, 10, 30}[below(6)];
    std::string service;
    do service = one_of(service_names());
    while (service == "reactionless");
    below(3) == 0 ? goal(m, T, from, to) : ask(m, service, T);
    if (below(4) > 0) m["audience"] = one_of(kAudiences);
    if (below(2) > 0) m["require"] = one_of(kRequired);
    m["detail"] = "all";
    return m;
  }

 private:
  double between(double least, double most) { return std::uniform_real_distribution(least, most)(random_); }
  std::size_t below(std::size_t n) { return std::uniform_int_distribution<std::size_t>(0, n - 1)(random_); }
  std::string one_of(const std::vector<std::string>& words) { return words[below(words.size())]; }

  void search(Json& m) {
    m.update({{"particles", 8}, {"rounds", 4}, {"refine", false}, {"degree", below(2) ? 7 : 5}});
    if (below(6) == 0) m["evaluations_max"] = 20;
  }
  void path(Json& m, double T, const std::vector<double>& from, const std::vector<double>& to) {
    for (const char* end : {"from_", "to_"}) m.erase(end + q_);
    m["waypoints"] = {{"t_s", {0, T}}, {q_, {from, to}}};
  }
  void goal(Json& m, double T, const std::vector<double>& from, const std::vector<double>& to) {
    m["goal"] = one_of({"possible", "fastest", "cheapest", "gentle", "safe"});
    if (below(3) > 0) m["person_m"] = below(2) ? 0.3 : 3;
    const std::size_t form = below(4);
    if (form % 2 == 0) m["T_s"] = T;
    if (form > 0) m["deadline_s"] = T * between(0.5, 2);
    if (form == 3 && below(2)) return path(m, T, from, to);
    if (form > 0 && form != 2 && m["goal"] != "possible" && m["goal"] != "fastest") search(m);
    if (m["goal"] == "gentle" && form % 2 == 0) search(m);
  }
  void ask(Json& m, const std::string& service, double T) {
    m["service"] = service;
    if (service == "reach") {
      m.erase("to_" + q_);
      m["poses"] =
          Json::array({{{"p_m", {between(-1, 1), between(-1, 1), between(-0.2, 1)}}, {"quaternion_wxyz", {0, 1, 0, 0}}}});
      return;
    }
    if (service == "optimise") {
      search(m);
      m.update({{"T_min_s", T}, {"T_max_s", 1.5 * T}, {"cost", one_of({"time", "energy", "safety", "jerk"})}});
      if (below(3) == 0) {
        m["cost"] = {{{"name", "time"}}, {{"name", one_of({"safety", "torque"})}}};
        m.update({{"rule", "pareto"}, {"directions", 2}});
      } else {
        if (below(3) == 0)
          m.update({{"verify", true}, {q_ == "q" ? "tracking_max" : "tracking_max_rad", below(2) ? 1e-6 : 0.01}});
        if (below(3) == 0)
          m["compliance"] = {{"M_kg", 2}, {"D_Ns_per_m", {1, below(2) ? 2 : 200}}, {"S_N_per_m", 800}, {"zeta_min", 0.5}};
      }
    } else if (service == "grow") {
      m.update({{"T_min_s", T}, {"T_max_s", 2 * T}, {"motions", 64}});
    } else if (service == "reaction") {
      m["base"] = Json::parse(R"({"mass_kg": 100, "inertia_kg_m2": [9, 0, 0, 9, 0, 9]})");
      m["T_s"] = T;
    } else if (service != "cycle_time" && below(4) > 0) {
      m["T_s"] = T;
    }
    if (service == "peak_power" && below(3) > 0) m["power_max_W"] = std::vector<double>{10, 100, 1000}[below(3)];
    if (service == "throughput") m.update({{"M_kg", 5}, {"S_N_per_m", 500}, {"D_Ns_per_m", below(2) ? 5 : 100}});
    if (service == "safety" || (service == "optimise" && m["cost"] == "safety")) {
      m["parts"] = Json::array({one_of({"chest", "hands_and_fingers", "skull_and_forehead"})});
      m["contact"] = one_of({"transient", "quasi_static"});
    }
    if (service == "safety" && !m.contains("T_s")) m["pace"] = one_of({"bounds", "safe"});
    if (service == "verify") m[q_ == "q" ? "tracking_max" : "tracking_max_rad"] = below(2) ? 1e-6 : 0.01;
    if ((service == "feasibility" || service == "cycle_time" || service == "verify" || service == "optimise") && below(3) == 0)
      m["clear_of"] = {{"self", true}};
  }

  std::mt19937 random_;
  std::string q_;
};

// Members that are truth values, by the schemas: a new one has to be put into a list.
const std::set<std::string> kVerdicts = {"feasible", "safe", "reached", "clear", "in_time", "reactionless"},
                            kOthers = {"complete", "at_shortest", "at_longest", "brakes_close"},
                            kOfOtherMotions = {"quintic", "standard", "best", "stiff", "history", "front", "goals"};

void each_truth_value(const Json& schema, std::set<std::string>& names) {
  if (schema.is_array())
    for (const Json& one : schema) each_truth_value(one, names);
  if (!schema.is_object()) return;
  if (schema.contains("properties"))
    for (const auto& [name, own] : schema["properties"].items())
      if (own.is_object() && own.contains("type") && own["type"].dump().find("boolean") != std::string::npos)
        names.insert(name);
  for (const auto& [name, own] : schema.items()) each_truth_value(own, names);
}

/// The first member of the reply that says no.
std::string no_in(const Json& value, const std::string& place = "") {
  std::string found;
  if (value.is_object()) {
    for (const auto& [name, own] : value.items()) {
      if (!found.empty() || kOfOtherMotions.contains(name)) continue;
      const std::string at = place + "/" + name;
      if ((kVerdicts.contains(name) && own == false) || (name == "says" && own == "no")) return at;
      if (name == "safety_share" && own.is_number() && own > 1 + 1e-9) return at;
      found = no_in(own, at);
    }
  } else if (value.is_array() && !value.empty() && value.front().is_object()) {
    for (std::size_t i = 0; found.empty() && i < value.size(); ++i) found = no_in(value[i], place + "/" + std::to_string(i));
  }
  return found;
}

/// The motion of a reply as the request of another service; null: it has none, or several.
Json motion_in(const Json& request, const Json& reply) {
  Json own{{"robot", request["robot"]}};
  if (request.contains("waypoints")) {
    own["waypoints"] = request["waypoints"];
    return own;
  }
  const std::string q = request.contains("from_q") ? "q" : "q_rad";
  if (!request.contains("to_" + q) || reply.contains("to_" + q) || !reply.contains("T_s") || !reply["T_s"].is_number())
    return {};
  own["from_" + q] = request["from_" + q];
  own["to_" + q] = request["to_" + q];
  own["T_s"] = reply["T_s"];
  const std::string c = q == "q" ? "c_r" : "c_r_rad";
  if (reply.contains("motion") && reply["motion"].contains(c)) {
    own["degree"] = 5 + reply["motion"][c].size() / request["from_" + q].size();
    own[c] = reply["motion"][c];
  }
  return own;
}

// No green and no amber where any member says no, no red where none does; each finding is what its service says when it is asked alone.
TEST(Verdicts, AgreeWithEachMemberAndEachService) {
  std::set<std::string> names;
  for (const std::string& service : service_names()) each_truth_value(Json::parse(schema(service))["reply"], names);
  for (const std::string& name : names) EXPECT_TRUE(kVerdicts.contains(name) != kOthers.contains(name)) << name;
  Bench bench;
  Requests requests(1);
  std::map<std::string, int> seen;
  constexpr int kRequests = 800;
  for (int k = 0; k < kRequests; ++k) {
    const Json request = requests.next();
    Json reply;
    try {
      reply = bench.ask(request);
    } catch (const Error&) {
      ++seen["refused"];
      continue;
    }
    const std::string light = reply["verdict"]["light"], no = no_in(reply),
                      where = request.dump() + "\n" + reply["verdict"].dump();
    ++seen[light];
    EXPECT_EQ(light == "red", !no.empty()) << no << where;
    bool unknown = reply.contains("assumptions");
    for (const Json& finding : reply["verdict"]["findings"]) {
      const std::string of = finding["of"], word = finding["says"];
      ++seen[of + " " + word];
      unknown = unknown || word == "unknown";
      EXPECT_TRUE(word != "no" || finding["why"] != "") << where;
    }
    EXPECT_EQ(light == "green", no.empty() && !unknown) << where;
    EXPECT_EQ(reply["verdict"].contains("unmet"),
              request.contains("require") && (light == "red" || (light == "amber" && request["require"] == "green")))
        << where;
    if (request.contains("audience")) {
      EXPECT_EQ(reply["light"], light);
      const std::string sentence = reply["sentence"];
      EXPECT_THAT(sentence,
                  AllOf(Not(HasSubstr("unknown figure")), Not(HasSubstr("  ")), Not(HasSubstr("; ;")), Not(HasSubstr(": ."))))
          << where;
      // Whoever reads the sentence alone knows each no.
      for (const Json& finding : reply["verdict"]["findings"])
        EXPECT_TRUE(finding["says"] == "yes" || sentence.find(finding["why"].get<std::string>()) != std::string::npos)
            << sentence << where;
    }
    const std::string service = request.contains("service") ? request["service"] : reply["choice"]["service"];
    if (service == "optimise" && reply.contains("front")) {
      for (const Json& one : reply["front"]) {
        Json own = motion_in(request, one);
        own["service"] = "feasibility";
        EXPECT_EQ(says(one, "bounds"), says(bench.ask(own), "bounds")) << where;
      }
      if (!reply["front"].empty()) ++seen["front"];
    }
    Json motion = motion_in(request, reply);
    if (motion.is_null() || service == "reaction") continue;  // whose torques are those on a free base
    motion["service"] = "feasibility";
    EXPECT_EQ(says(reply, "bounds"), says(bench.ask(motion), "bounds")) << where;
    if (const std::string persons = says(reply, "persons"); !persons.empty() && reply.contains("safe")) {
      motion["service"] = "safety";
      for (const char* own : {"parts", "contact"})
        if (request.contains(own)) motion[own] = request[own];
      EXPECT_EQ(says(bench.ask(motion), "persons"), persons) << where;
    }
    if (const std::string twin = says(reply, "twin"); !twin.empty()) {
      for (const char* own : {"parts", "contact"}) motion.erase(own);
      motion["service"] = "verify";
      for (const char* own : {"tracking_max", "tracking_max_rad"})
        if (request.contains(own)) motion[own] = request[own];
      EXPECT_EQ(says(bench.ask(motion), "twin"), twin) << where;
    }
  }
  // The sweep has seen each finding in each of its ways.
  for (const char* each : {"front",           "green",
                           "amber",           "red",
                           "bounds yes",      "bounds no",
                           "poses yes",       "poses no",
                           "power yes",       "power no",
                           "clear_of yes",    "clear_of no",
                           "twin yes",        "twin no",
                           "compliance yes",  "compliance no",
                           "persons yes",     "persons no",
                           "persons unknown", "deadline yes",
                           "deadline no",     "deadline unknown",
                           "search yes",      "search unknown"})
    EXPECT_GE(seen[each], 1) << each;
  EXPECT_LT(seen["refused"], kRequests / 3);
}

std::string sentence(const Json& reply) { return reply["sentence"]; }

TEST(Verdicts, SeeWhatAReplyHasBesideItsOwnFeasibility) {
  Bench bench;
  const Json search{{"particles", 16}, {"rounds", 10}, {"refine", false}, {"audience", "operator"}, {"detail", "verdict"}};
  const auto with = [&](const char* members) {
    Json request = far(members);
    request.update(search);
    return bench.ask(request);
  };
  // Persons: 1.9 times what contact allows; figures as of the service safety.
  const Json green = with(R"("goal": "safe", "deadline_s": 2, "person_m": 0.3)");
  EXPECT_EQ(green["light"], "red");
  EXPECT_EQ(green["safe"], false);
  EXPECT_EQ(green["feasible"], true);
  EXPECT_EQ(green["choice"]["in_time"], true);
  EXPECT_THAT(sentence(green), AllOf(HasSubstr("not slow enough beside a person, the limits ask for "),
                                     HasSubstr("m/s at the sternum, 0.679 allowed"), Not(HasSubstr("ISO"))));
  Json alone = far(R"("service": "safety")");
  const Json motion = green["motion"];
  alone.update({{"T_s", motion["T_s"]}, {"degree", 5 + motion["c_r_rad"].size() / 7}, {"c_r_rad", motion["c_r_rad"]}});
  const Json safety = bench.ask(alone);
  for (const char* name : {"safe", "safe_reason", "T_safe_s", "worst_part", "mass", "load_kg", "effective", "iso_ts_15066"})
    EXPECT_EQ(green[name], safety[name]) << name;
  EXPECT_NEAR(green["costs"]["safety_share"].get<double>(), green["iso_ts_15066"]["share"].get<double>(), 1e-3);
  // A front.
  const Json front =
      with(R"("service": "optimise", "T_min_s": 1.9, "T_max_s": 2, "cost": [{"name": "safety"}, {"name": "energy"}],
                             "rule": "pareto", "directions": 2, "degree": 6)");
  EXPECT_EQ(front["light"], "red");
  EXPECT_THAT(sentence(front),
              HasSubstr("; none of " + std::to_string(front["front"].size()) + " motions is slow enough beside a person"));
  for (const Json& one : front["front"]) EXPECT_EQ(one["verdict"]["light"], "red");
  const Json slow = with(R"("service": "optimise", "T_min_s": 3, "T_max_s": 9, "cost": [{"name": "safety"}, {"name": "energy"}],
                            "rule": "pareto", "directions": 2, "degree": 6)");
  EXPECT_EQ(slow["light"], "green");  // that of the best one
  EXPECT_TRUE(std::ranges::any_of(slow["front"], [](const Json& one) { return one["verdict"]["light"] == "green"; }));
  // The twin.
  const Json twin = with(R"("service": "optimise", "T_min_s": 2, "T_max_s": 2, "verify": true, "tracking_max_rad": 1e-6)");
  EXPECT_EQ(twin["light"], "red");
  EXPECT_EQ(twin["feasible"], false);
  EXPECT_EQ(twin["reason"], "tracking error 0.001 in the twin");
  // A path that breaks its bounds, asked how gentle it is.
  const Json fast = bench.ask(R"({"goal": "gentle", "waypoints": {"t_s": [0, 0.5], "q_rad": [[0, -0.9, 0, 1.2, 0, 0.6, 0],
                                  [1.2, 0.9, 0, -1.2, 0, -0.6, 0]]}, "audience": "operator"})");
  EXPECT_EQ(fast["light"], "red");
  EXPECT_THAT(sentence(fast), HasSubstr("The move is not possible in 0.5 s: joint joint_4: dq"));
  // A search that has ended early.
  const Json early = with(R"("service": "optimise", "T_min_s": 2, "evaluations_max": 10)");
  EXPECT_EQ(early["light"], "green");
  EXPECT_THAT(sentence(early), HasSubstr("the search has ended early, a better motion may exist"));
  const Json none = with(R"("service": "optimise", "T_min_s": 0.3, "T_max_s": 0.4, "evaluations_max": 10)");
  EXPECT_EQ(none["light"], "red");
  EXPECT_EQ(says(none, "search"), "unknown");
}

TEST(Verdicts, GoAtAPaceThatIsSafe) {
  Bench bench;
  const Json fastest =
      bench.ask(far(R"("goal": "fastest", "person_m": 0.3, "deadline_s": 20, "audience": "operator", "detail": "margins")"));
  EXPECT_EQ(sentence(fastest), "The move takes 6.51 s at least beside a person.");
  EXPECT_EQ(fastest["light"], "green");
  EXPECT_EQ(fastest["choice"]["in_time"], true);
  EXPECT_EQ(fastest["safe"], true);
  EXPECT_NEAR(fastest["iso_ts_15066"]["share"].get<double>(), 1, 1e-9);
  EXPECT_NEAR(fastest["T_s"].get<double>(), fastest["T_safe_s"].get<double>(), 1e-9);
  const Json shortest = bench.ask(far(R"("service": "safety")"));
  EXPECT_EQ(shortest["safe"], false);
  EXPECT_NEAR(shortest["T_safe_s"].get<double>(), fastest["T_s"].get<double>(), 1e-9);
  const Json late = bench.ask(far(R"("goal": "fastest", "person_m": 0.3, "deadline_s": 5, "audience": "operator")"));
  EXPECT_EQ(late["light"], "red");
  EXPECT_THAT(sentence(late), HasSubstr("at least beside a person; later than the deadline in 5 s"));
  // Where the bounds ask for more than persons do.
  const Json small = bench.ask(
      R"({"goal": "safe", "from_q_rad": [0, 0, 0, 0, 0, 0, 0], "to_q_rad": [0, 0, 0, 0, 0, 0, 1], "audience": "engineer"})");
  EXPECT_GT(small["T_s"].get<double>(), small["T_safe_s"].get<double>());
  EXPECT_EQ(small["light"], "green");
  // No duration is safe.
  const Json skull = bench.ask(far(R"("goal": "safe", "parts": "skull_and_forehead", "audience": "operator")"));
  EXPECT_EQ(skull["light"], "red");
  EXPECT_FALSE(skull.contains("pace"));
  EXPECT_THAT(sentence(skull), AllOf(HasSubstr("s the move is not slow enough beside a person at any speed: contact with the "),
                                     HasSubstr("is not permitted")));
  const Json unknown =
      bench.ask(R"({"goal": "safe", "robot": "ur10e", "from_q_rad": [0, -1, 1, 0, 0, 0], "to_q_rad": [1, -1.5, 0.5, 0.3, 0, 0],
                                     "audience": "operator"})");
  EXPECT_EQ(unknown["light"], "amber");
  EXPECT_THAT(sentence(unknown), AllOf(HasSubstr("at least beside a person, slow enough beside a person as far as is known"),
                                       HasSubstr("the inertia of the motors is unknown")));
  for (const char* beside : {R"("T_s": 3)", R"("T_s": 3, "audience": "operator")"})
    EXPECT_THROW((void)bench.ask(far(R"("service": "safety", "pace": "safe", )" + std::string(beside))), RequestError);
  try {
    (void)bench.ask(far(R"("service": "safety", "pace": "slow")"));
    FAIL();
  } catch (const RequestError& e) {
    EXPECT_EQ(std::string(e.what()), "/pace: is 'slow', expected one of bounds, safe");
  }
}

TEST(Verdicts, KnowWhichDurationADeadlineIsFor) {
  Bench bench;
  const Json reach = bench.ask(R"({"goal": "possible", "poses": [{"p_m": [0.5, 0, 0.5], "quaternion_wxyz": [0, 1, 0, 0]}],
                                   "deadline_s": 0.001, "audience": "operator"})");
  EXPECT_TRUE(reach["choice"]["in_time"].is_null());
  EXPECT_EQ(reach["light"], "amber");
  EXPECT_THAT(sentence(reach), HasSubstr("the deadline is not regarded, the answer has no duration"));
  // The cycle of a compliance, which is longer than the move.
  const char* const kCompliance =
      R"("goal": "gentle", "particles": 8, "rounds": 4, "compliance": {"M_kg": 2, "D_Ns_per_m": 20, "S_N_per_m": 800}, "audience": "engineer")";
  const Json late = bench.ask(far(kCompliance + std::string(R"(, "deadline_s": 2.2)")));
  EXPECT_LT(late["T_s"].get<double>(), 2.2 + 1e-9);
  EXPECT_GT(late["compliance"]["T_cycle_s"].get<double>(), 2.2);
  EXPECT_EQ(late["choice"]["in_time"], false);
  EXPECT_EQ(late["light"], "red");
  EXPECT_THAT(sentence(late), HasSubstr(" s is later than the deadline in 2.2 s"));
  const Json process = bench.ask(far(R"("goal": "fastest", "T_process_s": 3, "deadline_s": 2.5, "audience": "operator")"));
  EXPECT_THAT(sentence(process), HasSubstr("; the cycle of 4.98 s is later than the deadline in 2.5 s"));
  // Later steps of a chain see what the chain tells.
  Json chain = Json::parse(R"({"steps": [{"name": "a", "goal": "fastest", "deadline_s": 0.5},
      {"service": "feasibility", "T_s": 2, "detail": "$a/verdict/light"}]})");
  chain["defaults"] = far(R"("robot": "measured")");
  try {
    (void)bench.ask(chain);
    FAIL();
  } catch (const RequestError& e) {
    EXPECT_THAT(std::string(e.what()), HasSubstr("is 'red', expected one of margins"));
  }
}

TEST(Verdicts, TellWhatOperatorsMayTakeLiterally) {
  Bench bench;
  const auto told = [&](const std::string& members) {
    return sentence(bench.ask(far(members + R"(, "audience": "operator")")));
  };
  const Json cycle = bench.ask(far(R"("service": "energy", "T_s": 2, "cycle_s": 10, "audience": "engineer")"));
  EXPECT_EQ(cycle["move_J"], bench.ask(far(R"("service": "energy", "T_s": 2)"))["energy_J"]);
  EXPECT_NEAR(cycle["energy_J"].get<double>(), cycle["move_J"].get<double>() + cycle["waiting"]["energy_J"].get<double>(),
              1e-9);
  EXPECT_THAT(sentence(cycle), HasSubstr("The cycle of 10 s needs "));
  EXPECT_THAT(told(R"("service": "energy", "T_s": 2, "price_per_kWh": 0.3)"), HasSubstr(" per 1000 moves"));
  EXPECT_THAT(
      sentence(bench.ask(
          R"({"service": "energy", "robot": "planar2", "from_q_rad": [0, 0], "to_q_rad": [1, 0], "T_s": 2, "audience": "operator"})")),
      HasSubstr("for the work of the joints; losses are unknown"));
  for (const char* service : {"cycle_time", "throughput"}) {
    Json standing = Json::parse(
        R"({"from_q_rad": [0, 0.5, 0, -1, 0, 0.6, 0], "to_q_rad": [0, 0.5, 0, -1, 0, 0.6, 0], "audience": "engineer"})");
    standing["service"] = service;
    if (service == std::string("throughput")) standing.update({{"M_kg", 1}, {"S_N_per_m", 500}, {"zeta", 1}});
    const Json reply = bench.ask(standing);
    EXPECT_TRUE(reply["moves_per_hour"].is_null()) << reply;
    EXPECT_THAT(sentence(reply), HasSubstr("The robot does not move"));
    EXPECT_EQ(reply["light"], "green");
  }
}

// A robot whose motion turns its base has none that does not.
TEST(Verdicts, SayThatTheBaseTurns) {
  Bench bench;
  const Json reply =
      bench.ask(R"({"service": "reactionless", "locked_q": {"joint_1": 0, "joint_3": 0, "joint_5": 0, "joint_7": 0},
      "from_q_rad": [0.5, -1, 0.6], "to_q_rad": [0.9, -0.4, 0.2], "T_s": 6, "particles": 8, "rounds": 4, "audience": "engineer",
      "base": {"mass_kg": 100, "inertia_kg_m2": [9, 0, 0, 9, 0, 9]}})");
  EXPECT_EQ(reply["reactionless"], false);
  EXPECT_EQ(says(reply, "base"), "no");
  EXPECT_EQ(reply["light"], "red");
  EXPECT_THAT(sentence(reply), HasSubstr("There is no such motion: "));
}

TEST(Verdicts, MayBeRequired) {
  Bench bench;
  const auto unmet = [&](const std::string& members) { return bench.ask(far(members))["verdict"].value("unmet", ""); };
  EXPECT_EQ(unmet(R"("service": "feasibility", "T_s": 2, "require": "green")"), "");
  EXPECT_EQ(unmet(R"("service": "feasibility", "T_s": 0.5)"), "");
  EXPECT_THAT(unmet(R"("service": "feasibility", "T_s": 0.5, "require": "amber")"),
              HasSubstr("The robot cannot make the move in 0.5 s: "));
  EXPECT_EQ(unmet(R"("service": "cycle_time", "robot": "lwr4", "require": "amber")"), "");
  EXPECT_THAT(unmet(R"("service": "cycle_time", "robot": "lwr4", "require": "green")"), HasSubstr("not measured: "));
  for (const char* audience : {"operator", "planner", "engineer"}) {
    const Json reply =
        bench.ask(far(R"("goal": "possible", "T_s": 0.5, "require": "green", "audience": ")" + std::string(audience) + "\""));
    EXPECT_EQ(reply["verdict"]["unmet"], reply["sentence"]);
  }
  const auto refusal = [&](const Json& request) {
    for (const bool check : {false, true}) try {
        check ? check_object(bench.library(), request) : (void)bench.ask(request);
        ADD_FAILURE() << request;
      } catch (const RequestError& e) {
        if (check) return std::string(e.what());
      }
    return std::string();
  };
  EXPECT_EQ(refusal(far(R"("service": "feasibility", "require": "red")")), "/require: is 'red', expected one of green, amber");
  EXPECT_THAT(refusal(far(R"("service": "feasibility", "require": 1)")), HasSubstr("/require: "));
  // Of a chain: its worst step decides, and it stands beside the steps only.
  const auto chain = [&](const std::string& steps, const std::string& more) {
    return Json::parse(R"({"defaults": {)" + std::string(kFar) + R"(}, "steps": [)" + steps + "]" + more + "}");
  };
  const std::string steps =
      R"({"service": "feasibility", "T_s": 2}, {"service": "jerk", "T_s": 0.5}, {"service": "torques", "T_s": 0.4}, {"goal": "fastest"})";
  for (const char* audience : {"", R"(, "audience": "operator")"}) {
    const Json reply = bench.ask(chain(steps, R"(, "require": "green")" + std::string(audience)));
    EXPECT_EQ(reply["steps"].size(), 4u);
    EXPECT_EQ(reply["verdict"]["light"], "red");
    EXPECT_THAT(reply["verdict"]["unmet"].get<std::string>(), HasSubstr("The move is not possible in 0.5 s"));
    for (const Json& step : reply["steps"]) EXPECT_FALSE(step["reply"]["verdict"].contains("unmet"));
  }
  EXPECT_FALSE(bench.ask(chain(R"({"goal": "fastest"})", R"(, "require": "green")"))["verdict"].contains("unmet"));
  EXPECT_THAT(refusal(chain(R"({"goal": "fastest", "require": "green"})", "")),
              HasSubstr("/steps/0/require: is given in a step"));
  EXPECT_THAT(refusal(chain(steps, R"(, "require": "blue")")), HasSubstr("/require: is 'blue'"));
  Json inside = chain(steps, "");
  inside["defaults"]["require"] = "green";
  EXPECT_THAT(refusal(inside), HasSubstr("/defaults/require: is given for each step"));
  // Tasks: a library's is each task's, a chain's own stays beside its steps.
  EXPECT_EQ(
      read_tasks(R"([{"service": "jerk", "require": "amber"}])", "tasks.json", {"measured", "", {}, false, "green"})[0].request,
      R"({"service":"jerk","require":"green","robot":"measured"})");  // the stricter one
  const std::vector<Task> tasks = read_tasks(R"({"defaults": {"require": "amber", )" + std::string(kFar) + R"(}, "tasks": [
      {"service": "feasibility", "T_s": 0.5}, {"service": "feasibility", "T_s": 2}, {"steps": [{"service": "jerk", "T_s": 0.5}]}]})",
                                             "tasks.json", {"measured", "", {}});
  const std::vector<Row> rows = ask_all(bench.library(), tasks);
  EXPECT_NE(services::unmet(rows[0]), "");
  EXPECT_EQ(services::unmet(rows[1]), "");
  EXPECT_NE(services::unmet(rows[2]), "") << rows[2].reply << rows[2].problem;
}

}  // namespace
}  // namespace cotwin::services::verdict_test
