// Application control (V-A): the table that chooses services, answers for whoever asks, and chains.
#include "components/services/json/control/control.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>
#include <set>

#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::services::control_test {
namespace {

using cotwin::testing::content;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

const std::string kRobots = places::source() + "/models/robots";
const Json kMove = Json::parse(R"({"robot": "lwr4", "from_q_rad": [0, 0.5, 0, -1, 0, 0.6, 0],
                                   "to_q_rad": [1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8]})");
const Json kSearch = Json::parse(R"({"degree": 6, "particles": 8, "rounds": 4, "refine": false})");

Json with(Json request, const std::string& more) {
  request.update(Json::parse(more));
  return request;
}

std::string refusal(Robots& robots, const Json& request) {
  try {
    answer_object(robots, request);
  } catch (const RequestError& e) {
    return e.pointer() + ": " + e.detail();
  }
  return "";
}

Json ask(Robots& robots, const Json& request) { return Json::parse(answer_object(robots, request)); }

struct Order {
  const char *members, *row;
};
const Json kSeries = Json::parse(R"({"robot": "lwr4", "series": {"t_s": [0, 1, 2, 3], "q_rad": [[0, 0.5, 0, -1, 0, 0.6, 0],
    [0.1, 0.5, 0, -1, 0, 0.6, 0], [0.2, 0.5, 0, -1, 0, 0.6, 0], [0.3, 0.5, 0, -1, 0, 0.6, 0]]}})");
const Json kPoses = Json::parse(R"({"robot": "lwr4", "poses": [{"p_m": [0.4, 0.2, 0.6], "quaternion_wxyz": [1, 0, 0, 0]}]})");
const Order kMoves[] = {
    {R"({"goal": "possible"})", "move"},
    {R"({"goal": "possible", "T_s": 2, "person_m": 0.2})", "move"},
    {R"({"goal": "possible", "power_max_W": 300})", "power"},
    {R"({"power_max_W": 300})", "power"},  // which one row alone takes
    {R"({"goal": "fastest"})", "duration"},
    {R"({"goal": "fastest", "person_m": 1.6})", "duration"},
    {R"({"goal": "fastest", "person_m": 1.59})", "beside_persons"},
    {R"({"goal": "fastest", "M_kg": 2, "S_N_per_m": 500, "zeta": 1})", "compliant"},
    {R"({"M_kg": 2, "S_N_per_m": 500, "zeta": 1, "person_m": 0})", "compliant"},
    {R"({"goal": "cheapest", "T_s": 2})", "cost"},
    {R"({"goal": "cheapest", "T_s": 2, "deadline_s": 3, "price_per_kWh": 0.3})", "cost"},
    {R"({"goal": "cheapest"})", "best_duration"},
    {R"({"goal": "cheapest", "deadline_s": 3, "price_per_kWh": 0.3})", "cheapest_in_time"},
    {R"({"goal": "gentle", "T_s": 2})", "least_jerk"},
    {R"({"goal": "gentle", "deadline_s": 3})", "gentlest_in_time"},
    {R"({"goal": "safe", "T_s": 4})", "safe_motion"},
    {R"({"goal": "safe", "T_s": 4, "deadline_s": 5})", "safe_motion"},
    {R"({"goal": "safe"})", "safe_duration"},
    {R"({"goal": "safe", "deadline_s": 5})", "safest_in_time"},
};
const Order kPaths[] = {{R"({"goal": "possible"})", "move"},
                        {R"({"goal": "cheapest"})", "cost"},
                        {R"({"goal": "gentle"})", "jerk"},
                        {R"({"goal": "safe"})", "safe_motion"}};

// Every order of the lists is answered by its row, by the service of that row with the members that the row adds; the lists have every row, as
// does the document.
TEST(Control, ChoosesTheRowOfTheTable) {
  Robots robots({kRobots}, "lwr4", false, places::source() + "/models/people/iso_ts_15066.csv");
  std::set<std::string> seen;
  const auto expect = [&](const Json& request, const std::string& row) {
    Json chosen = request;
    choose(chosen);
    const auto at = std::ranges::find(choices(), row, [](const Choice& c) { return std::string(c.name); });
    ASSERT_NE(at, choices().end()) << row;
    EXPECT_EQ(chosen["choice"]["row"], row) << request;
    EXPECT_EQ(chosen["service"], at->service) << request;
    EXPECT_FALSE(chosen.contains("goal") || chosen.contains("person_m") || chosen.contains("deadline_s")) << chosen;
    const Json sets = Json::parse(at->sets);
    for (const auto& [name, value] : sets.items()) EXPECT_EQ(chosen[name], value);
    if (*at->time != '\0') {
      EXPECT_EQ(chosen[at->becomes], request[at->time]);
    }
    Json quick = request;
    if (chosen["service"] == "optimise") quick.update(kSearch);
    const Json reply = ask(robots, quick);
    EXPECT_EQ(reply["choice"]["row"], row);
    EXPECT_EQ(reply["choice"]["service"], at->service);
    EXPECT_EQ(reply["choice"]["why"], at->why);
    // The same as the service by its name, and again the same bytes once it is settled.
    Json named = quick;
    choose(named);
    const std::string settled = answer_object(robots, named);
    EXPECT_EQ(settled, answer_object(robots, quick));
    named.erase("choice");
    Json without = reply;
    Json same = ask(robots, named);
    for (Json* one : {&without, &same})
      for (const char* own : {"choice", "verdict"}) one->erase(own);  // which has the deadline
    EXPECT_EQ(without, same);
    seen.insert(row);
  };
  for (const auto& [members, row] : kMoves) expect(with(kMove, members), row);
  for (const auto& [members, row] : kPaths) expect(with(kSeries, members), row);
  expect(kPoses, "reach");
  const std::string document = content(places::source() + "/docs/services.md");
  for (const Choice& row : choices()) {
    EXPECT_TRUE(seen.contains(row.name)) << row.name;
    EXPECT_THAT(document, HasSubstr(std::string("| `") + row.name + "` | " + row.goal + " | "));
  }
}

TEST(Control, RefusesWhatHasSeveralReadingsOrNone) {
  Robots robots({kRobots}, "lwr4");
  const auto why = [&](const std::string& members) { return refusal(robots, with(kMove, members)); };
  EXPECT_THAT(why("{}"), AllOf(HasSubstr("several readings"), HasSubstr("duration (fastest, cycle_time): "),
                               HasSubstr("move (possible, feasibility): "), HasSubstr("expected goal or service")));
  EXPECT_THAT(why(R"({"person_m": 0.5})"),
              AllOf(HasSubstr("beside_persons (fastest, safety)"), Not(HasSubstr("duration (fastest"))));
  // Contradictions: the fastest in a given time, the gentlest in any, a deadline that has passed or is too early, two goals.
  EXPECT_THAT(why(R"({"goal": "fastest", "T_s": 2})"), HasSubstr("duration: T_s is given"));
  EXPECT_THAT(why(R"({"goal": "gentle"})"), AllOf(HasSubstr("least_jerk: T_s is missing"), HasSubstr("deadline_s is missing")));
  EXPECT_THAT(why(R"({"goal": "cheapest", "deadline_s": 3, "cost": "jerk"})"),
              HasSubstr("cost is given, which the goal decides"));
  EXPECT_THAT(why(R"({"goal": "cheapest", "deadline_s": 3, "T_max_s": 9})"),
              HasSubstr("T_max_s is given, which the goal decides"));
  EXPECT_EQ(why(R"({"goal": "cheapest", "deadline_s": -3})"), "/deadline_s: is -3 s, in the past, expected more than 0");
  EXPECT_EQ(why(R"({"goal": "safe", "T_s": 4, "deadline_s": 3})"),
            "/T_s: is 4 s, longer than the 3 s to the deadline, expected at most these");
  EXPECT_THAT(why(R"({"goal": ["fastest", "cheapest"]})"), HasSubstr("/goal: "));
  EXPECT_THAT(why(R"({"goal": "best"})"), HasSubstr("expected one of possible, fastest, cheapest, gentle, safe"));
  EXPECT_THAT(why(R"({"goal": "cheapest", "deadline": "2099-01-01T00:00:00Z"})"), HasSubstr("/deadline: is a time"));
  EXPECT_THAT(why(R"({"goal": "fastest", "person_m": -1})"), HasSubstr("/person_m: "));
  EXPECT_THAT(why(R"({"goal": "fastest", "colour": "red"})"), HasSubstr("cycle_time takes no colour"));
  EXPECT_THAT(why(R"({"goal": "fastest", "service": "energy"})"), HasSubstr("/goal: is an unknown member"));
  EXPECT_THAT(why(R"({"goal": "gentle", "T_s": 1e300})"), HasSubstr("/T_min_s: "));
  EXPECT_THAT(why(R"({"goal": "cheapest", "deadline_s": 1e-6})"),
              AllOf(HasSubstr("/T_max_s: "), HasSubstr("the goal cheapest has set it, by the row cheapest_in_time")));
  EXPECT_THAT(why(R"({"goal": "cheapest", "robot": "ur10", "from_q_rad": [0,0,0,0,0,0], "to_q_rad": [1,0,0,0,0,0]})"),
              AllOf(HasSubstr("/best: "), HasSubstr("no energy.ssv"), HasSubstr("by the row best_duration")));
  EXPECT_THAT(refusal(robots, Json::object()), HasSubstr("has neither service nor goal"));
  EXPECT_THAT(refusal(robots, Json::array()), HasSubstr("array"));
  // A choice that is none.
  for (const char* choice :
       {R"({"row": "cost", "persons": "near"})", R"({"row": "nothing", "persons": "near"})", R"({"row": 1})",
        R"({"row": "duration", "persons": "here"})", R"([])", R"({"row": "duration", "deadline_s": 0})",
        R"({"row": "duration", "more": 1})", "null", R"("duration")"})
    EXPECT_THAT(why(R"({"service": "cycle_time", "choice": )" + std::string(choice) + "}"), HasSubstr("/choice")) << choice;
  EXPECT_THAT(why(R"({"goal": "fastest", "choice": {"row": "duration"}})"), HasSubstr("/choice: is given without service"));
}

// What nobody said of persons is told; a person whom the answer does not regard, and a deadline that is missed, are seen in the light.
TEST(Control, TellsTheContextInTheLight) {
  Robots robots({kRobots}, "lwr4", false, places::source() + "/models/people/iso_ts_15066.csv");
  const auto told = [&](const std::string& members) { return ask(robots, with(kMove, members)); };
  EXPECT_EQ(told(R"({"goal": "fastest"})")["choice"]["persons"], "unknown");
  EXPECT_EQ(told(R"({"goal": "fastest", "person_m": 9})")["choice"]["persons"], "away");
  const Json near = told(R"({"goal": "cheapest", "T_s": 3, "person_m": 1, "audience": "operator"})");
  EXPECT_THAT(near["sentence"].get<std::string>(), HasSubstr("a person is near, which this does not regard"));
  EXPECT_EQ(near["light"], "amber");
  const Json safe = told(R"({"goal": "safe", "T_s": 4, "person_m": 1, "audience": "operator"})");
  EXPECT_THAT(safe["sentence"].get<std::string>(), Not(HasSubstr("does not regard")));
  const Json late = told(R"({"goal": "fastest", "deadline_s": 1, "audience": "operator"})");
  EXPECT_EQ(late["choice"]["in_time"], false);
  EXPECT_EQ(late["light"], "red");
  EXPECT_THAT(late["sentence"].get<std::string>(), HasSubstr("later than the deadline in 1 s"));
  EXPECT_EQ(told(R"({"goal": "fastest", "deadline_s": 2, "person_m": 1})")["choice"]["in_time"], false);  // 3.4 s are safe
  EXPECT_EQ(told(R"({"goal": "fastest", "deadline_s": 4, "person_m": 1})")["choice"]["in_time"], true);
  const Json in_time = told(R"({"goal": "fastest", "deadline_s": 2, "audience": "operator"})");
  EXPECT_EQ(in_time["choice"]["in_time"], true);
  EXPECT_EQ(in_time["light"], "amber");  // the data of the drives are assumed
  EXPECT_THAT(in_time["sentence"].get<std::string>(), HasSubstr("not measured: inertia of motors and 2 more"));
}

// A robot whose drives were measured has a green light where the move is possible and a red one where it is not; one whose motors are unknown
// has none of both beside a person.
TEST(Control, ShowsALightThatFollowsTheVerdict) {
  const cotwin::testing::TemporaryFolder folder("light");
  const fs::path measured = folder.path() / "measured", unknown = folder.path() / "unknown";
  for (const fs::path& robot : {measured, unknown}) fs::create_directories(robot);
  for (const fs::path& robot : {measured, unknown}) fs::copy_file(kRobots + "/lwr4/robot.urdf", robot / "robot.urdf");
  std::string drives = content(kRobots + "/lwr4/drive_train.ssv");
  const std::string key = R"(name="assumed")";
  const std::size_t at = drives.find(key);
  ASSERT_NE(at, std::string::npos);
  const std::size_t value = drives.find("value=\"", at) + 7;
  drives.replace(value, drives.find('"', value) - value, "none");
  std::ofstream(measured / "drive_train.ssv") << drives;
  Robots robots({folder.path()}, "measured", false, places::source() + "/models/people/iso_ts_15066.csv");
  const auto light = [&](const std::string& robot, const std::string& members) {
    const Json reply = ask(robots, with(with(kMove, members), R"({"audience": "operator", "robot": ")" + robot + "\"}"));
    return reply["light"].get<std::string>();
  };
  EXPECT_EQ(light("measured", R"({"service": "feasibility", "T_s": 2})"), "green");
  EXPECT_EQ(light("measured", R"({"service": "feasibility", "T_s": 0.5})"), "red");
  EXPECT_EQ(light("unknown", R"({"service": "feasibility", "T_s": 2})"), "amber");
  EXPECT_EQ(light("unknown", R"({"service": "feasibility", "T_s": 0.5})"), "red");
  EXPECT_EQ(light("measured", R"({"service": "safety", "T_s": 9})"), "green");
  EXPECT_EQ(light("measured", R"({"service": "safety", "T_s": 2})"), "red");
  EXPECT_EQ(light("unknown", R"({"service": "safety", "T_s": 9})"), "amber");  // safe is null, the limits are kept
  EXPECT_EQ(light("unknown", R"({"service": "safety", "T_s": 2})"), "red");    // they are not
  EXPECT_EQ(light("measured", R"({"service": "safety", "T_s": 0.5})"), "red");
}

/// The request of each service.
Json request_of(const std::string& service) {
  if (service == "reach") return with(kPoses, R"({"service": "reach"})");
  Json request = with(kMove, R"({"service": ")" + service + "\"}");
  if (service == "throughput") return with(request, R"({"M_kg": 1, "S_N_per_m": 500, "zeta": 1})");
  if (service == "grow") return with(request, R"({"T_min_s": 1, "T_max_s": 3, "motions": 100})");
  if (service == "optimise") return with(with(request, kSearch.dump()), R"({"T_min_s": 2})");
  if (service == "reactionless")
    return with(request, R"({"to_q_rad": [0.05, 0.55, 0, -1.05, 0, 0.6, 0], "to_pose": {"directions": ["z"]},
                            "base": {"mass_kg": 100, "inertia_kg_m2": [9, 0, 0, 9, 0, 9]}, "particles": 8, "rounds": 1})");
  if (service != "cycle_time") request["T_s"] = 2;
  return request;
}

/// A twin that finds what the plan says.
Verification echo(const Robot& robot, const Move&, double T, const VerificationOptions& options) {
  Verification v;
  v.T = T;
  v.settle = options.settle;
  for (auto* x : {&v.tracking, &v.end_error, &v.tau, &v.tau_rigid, &v.dq, &v.tau_limit})
    x->assign(robot.model.joints.size(), 1);
  return v;
}

// Operators read a sentence and a light, planners also figures, which are those of the engineer's reply in other units; a detail beside the
// audience brings its reply. Possible and impossible moves of every service.
TEST(Control, AnswersEachAudienceWithTheSameFigures) {
  Robots robots({kRobots}, "lwr4", false, places::source() + "/models/people/iso_ts_15066.csv");
  Context context;
  context.verify = echo;
  for (const std::string& service : service_names()) {
    const auto told = [&](Json request, const std::string& audience, const char* detail = nullptr) {
      request["audience"] = audience;
      if (detail) request["detail"] = detail;
      return Json::parse(answer_object(robots, request, context));
    };
    for (const bool possible : {true, false}) {
      Json request = request_of(service);
      if (!possible && service == "reach") request["poses"][0]["p_m"] = {3, 0, 0};
      if (!possible && service == "reactionless") {  // which would search long
        Verdict verdict;
        verdict.add(Of::kPoses, false, "no motion");
        Json none{{"T_s", 2}};
        verdict.tell(none);
        EXPECT_EQ(presented(service, {"operator", false}, Json(), none)["sentence"], "There is no such motion: no motion.");
        continue;
      }
      // Beyond the limit of joint 1, which no duration mends.
      if (!possible && service != "reach") request["to_q_rad"][0] = 4;
      if (!possible && (service == "payload" || service == "throughput")) request["T_s"] = 2;
      const Json brief = told(request, "operator"), plan = told(request, "planner"), all = told(request, "engineer");
      const std::string sentence = brief["sentence"], light = brief["light"];
      EXPECT_EQ(brief.size(), 3u) << brief;
      EXPECT_EQ(brief["verdict"]["light"], light);
      EXPECT_THAT(sentence,
                  AllOf(Not(HasSubstr("unknown figure")), Not(HasSubstr("{")), Not(HasSubstr("[")), Not(HasSubstr("nan"))))
          << service;
      EXPECT_TRUE(sentence.ends_with(".") && !std::islower(static_cast<unsigned char>(sentence[0])))
          << service << ": " << sentence;
      EXPECT_EQ(plan["sentence"], sentence);
      EXPECT_EQ(all["sentence"], sentence);
      EXPECT_EQ(light == "red",
                (all.contains("feasible") && all["feasible"] == false) || all.value("safe", Json(true)) == false)
          << service << sentence;
      EXPECT_LE(plan["figures"].size(), 5u);
      if (possible) {
        EXPECT_GE(plan["figures"].size(), 1u) << service;
      }
      // Each figure is one of the engineer's, and its text is its value to three digits.
      for (const Json& figure : plan["figures"]) {
        const double value = figure["value"];
        const std::string text = figure["text"], unit = figure["unit"];
        EXPECT_TRUE(text.ends_with(unit)) << text;
        EXPECT_NEAR(std::stod(text), value, 0.005 * std::abs(value) + 1e-9) << figure;
      }
      Json plain = request;
      plain["detail"] = "all";
      const Json engineer = Json::parse(answer_object(robots, plain, context));
      for (const auto& [name, value] : engineer.items()) EXPECT_EQ(all[name], value) << service << " " << name;
      const Json verdict = told(request, "operator", "verdict");
      EXPECT_EQ(verdict["sentence"], sentence);
      EXPECT_GT(verdict.size(), 3u);
      EXPECT_FALSE(verdict.contains("figures"));
    }
  }
}

// Units by the place of a figure, at their borders.
TEST(Control, WritesFiguresAsPeopleReadThem) {
  const auto figure = [](const char* place, double x) {
    Json reply{{"T_s", 1.0}, {"energy_J", 1.0}};
    Verdict().tell(reply);
    if (std::string(place) == "best") {
      reply["best"] = {{"T_s", x}, {"energy_J", 1}, {"saved_J", 1}};
    } else {
      reply[place] = x;
    }
    const Json figures = presented("energy", {"planner", false}, Json(), reply)["figures"];
    for (const Json& one : figures)
      if (one["value"] != 1.0) return one["text"].get<std::string>();
    return std::string("none");
  };
  EXPECT_EQ(figure("T_s", 0.0123456), "0.0123 s");
  EXPECT_EQ(figure("T_s", 119.94), "120 s");
  EXPECT_EQ(figure("T_s", 120), "2 min");
  EXPECT_EQ(figure("T_s", 9000), "2.5 h");
  EXPECT_EQ(figure("energy_J", 999), "999 J");
  EXPECT_EQ(figure("energy_J", 123456), "123 kJ");
  EXPECT_EQ(figure("energy_J", 5e6), "5 MJ");
  EXPECT_EQ(figure("energy_J", 1e-12), "0 J");
  EXPECT_EQ(figure("energy_J", -1e-12), "0 J");
  EXPECT_EQ(figure("energy_J", 1e300).size(), 295 + std::string(" MJ").size());  // no exponent, whatever the figure
  EXPECT_EQ(figure("price", 0.0000194), "0.0194 per 1000 moves");
  EXPECT_EQ(figure("price", 0.01), "0.01");
  EXPECT_EQ(figure("price", 0), "0");
  EXPECT_EQ(figure("price", 1234.56), "1235");
  EXPECT_EQ(figure("peak_power_W", 1500), "1.5 kW");
  EXPECT_EQ(figure("co2_kg", 0.0042), "4.2 g");
  EXPECT_EQ(figure("co2_kg", 4.2), "4.2 kg");
  EXPECT_EQ(figure("best", 2.5), "2.5 s");
  Json turned{
      {"T_s", 2}, {"end", {{"turn_rad", -std::numbers::pi / 2}}}, {"worst", {{"turn", {{"turn_rad", std::numbers::pi}}}}}};
  Verdict().tell(turned);
  turned = presented("reaction", {"operator", false}, Json(), turned);
  EXPECT_THAT(turned["sentence"].get<std::string>(), AllOf(HasSubstr("by 180° at most"), HasSubstr("-90° at its end")));
}

const Json kChain = Json::parse(R"({"steps": [
    {"name": "shortest", "goal": "fastest"},
    {"name": "cost", "goal": "cheapest", "T_s": "$shortest/T_s"},
    {"name": "part", "service": "payload", "T_s": "$cost/T_s", "com_m": [0, "$shortest/T_s", 0]},
    {"service": "feasibility", "payload": {"mass_kg": "$part/mass_kg", "com_m": [0, "$shortest/T_s", 0]}, "T_s": "$shortest/T_s"}]})");

Json chain_of(const Json& steps, const std::string& more = "{}") {
  return with(Json{{"defaults", kMove}, {"steps", steps}}, more);
}

// The same as asking one after the other and copying values by hand; any number of times.
TEST(Chains, GiveWhatTheServicesGiveOneAfterTheOther) {
  Robots robots({kRobots}, "lwr4");
  const Json chain = chain_of(kChain["steps"]);
  const Json reply = ask(robots, chain);
  ASSERT_EQ(reply["steps"].size(), 4u);
  Json shortest = ask(robots, with(kMove, R"({"service": "cycle_time"})"));
  const double T = shortest["T_s"];
  const Json part = ask(robots, with(kMove, Json{{"service", "payload"}, {"T_s", T}, {"com_m", {0, T, 0}}}.dump()));
  const Json last =
      ask(robots,
          with(kMove,
               Json{{"service", "feasibility"}, {"T_s", T}, {"payload", {{"mass_kg", part["mass_kg"]}, {"com_m", {0, T, 0}}}}}
                   .dump()));
  EXPECT_EQ(reply["steps"][0]["reply"]["T_s"], T);
  EXPECT_EQ(reply["steps"][0]["reply"]["choice"]["row"], "duration");
  EXPECT_EQ(reply["steps"][1]["reply"]["T_s"], T);
  EXPECT_EQ(reply["steps"][2]["reply"], part);
  EXPECT_EQ(reply["steps"][3]["reply"], last);
  EXPECT_EQ(reply["steps"][3]["name"], "4");
  EXPECT_EQ(reply["steps"][3]["service"], "feasibility");
  EXPECT_EQ(answer_object(robots, chain), reply.dump());
  Json settled = chain;
  settle(settled);
  EXPECT_EQ(answer_object(robots, settled), reply.dump());
  EXPECT_NO_THROW(check_object(robots, chain));
  std::vector<double> shares;
  Context context;
  context.progress = [&](double share, const std::string&) { shares.push_back(share); };
  Json search = chain;
  search["steps"].push_back(with(kSearch, R"({"service": "optimise", "T_min_s": "$shortest/T_s"})"));
  (void)answer_object(robots, search, context);
  ASSERT_FALSE(shares.empty());
  EXPECT_TRUE(std::ranges::is_sorted(shares) && shares.front() >= 0.8 && shares.back() <= 1);
}

TEST(Chains, AreToldToTheirAudience) {
  Robots robots({kRobots}, "lwr4");
  const auto told = [&](const std::string& audience) {
    return ask(robots, chain_of(kChain["steps"], R"({"audience": ")" + audience + "\"}"));
  };
  const Json brief = told("operator"), plan = told("planner"), all = told("engineer");
  EXPECT_EQ(brief["light"], "amber");
  EXPECT_EQ(brief["sentence"], brief["steps"][0]["reply"]["sentence"]);  // the first of those with the worst light
  EXPECT_FALSE(brief["steps"][0]["reply"].contains("T_s"));
  EXPECT_TRUE(plan["steps"][0]["reply"].contains("figures"));
  EXPECT_TRUE(all["steps"][0]["reply"].contains("motion"));
  // A step that is not possible decides.
  Json steps = kChain["steps"];
  steps.push_back({{"service", "feasibility"}, {"T_s", 0.2}});
  steps.push_back({{"service", "feasibility"}, {"T_s", 2}});
  const Json red = ask(robots, chain_of(steps, R"({"audience": "operator"})"));
  EXPECT_EQ(red["light"], "red");
  EXPECT_EQ(red["sentence"], red["steps"][4]["reply"]["sentence"]);
}

TEST(Chains, TellWhichStepFailedAndRunNoneAfterIt) {
  Robots robots({kRobots}, "lwr4");
  const Json weak = Json::parse(R"([{"name": "shortest", "goal": "fastest", "tau_max_Nm": [1, 1, 1, 1, 1, 1, 1]},
      {"name": "cost", "goal": "cheapest", "T_s": "$shortest/T_s"}, {"goal": "possible"}])");
  EXPECT_THAT(refusal(robots, chain_of(weak)),
              AllOf(HasSubstr("/steps/1/T_s: step 'cost': takes '/T_s' of the step 'shortest', which did not answer that"),
                    HasSubstr("joint_2"), HasSubstr("not asked after it: '3'")));
  const Json slow = Json::parse(R"([{"goal": "fastest"}, {"service": "energy", "tau_max_Nm": [1, 1, 1, 1, 1, 1, 1]}])");
  EXPECT_THAT(refusal(robots, chain_of(slow)),
              HasSubstr("/steps/1: step '2': energy: no duration of the move meets the bounds"));
}

TEST(Chains, RefuseWhatCannotBeAnswered) {
  Robots robots({kRobots}, "lwr4");
  const auto why = [&](const std::string& steps, const std::string& more = "{}") {
    const Json chain = chain_of(Json::parse(steps), more);
    const std::string told = refusal(robots, chain);
    std::string checked;
    try {
      check_object(robots, chain);
    } catch (const RequestError& e) {
      checked = e.pointer();
    }
    EXPECT_EQ(checked, told.substr(0, checked.size())) << "is only refused when it is asked: " << told;
    return told;
  };
  EXPECT_THAT(
      why(R"([{"name": "a", "service": "energy", "T_s": "$b/T_s"}, {"name": "b", "service": "energy", "T_s": "$a/T_s"}])"),
      HasSubstr("/steps/0/T_s: refers to the step 'b', which is no earlier one"));
  EXPECT_THAT(why(R"([{"name": "a", "service": "energy", "T_s": "$a/T_s"}])"), HasSubstr("never in a circle"));
  EXPECT_THAT(why(R"([{"goal": "fastest"}, {"service": "energy", "T_s": "$1/T_ss"}])"),
              HasSubstr("/steps/1/T_s: refers to '/T_ss', which cycle_time never answers"));
  EXPECT_THAT(why(R"([{"goal": "fastest"}, {"service": "energy", "T_s": "$1"}])"), HasSubstr("never answers"));
  EXPECT_THAT(why(R"([{"goal": "fastest"}, {"service": "energy", "T_s": "$1/limiting/joint/T_s"}])"),
              HasSubstr("never answers"));
  EXPECT_THAT(why(R"([{"goal": "fastest"}, {"service": "energy", "T_s": "$1/a~b"}])"), HasSubstr("is no JSON pointer"));
  EXPECT_THAT(why(R"([{"goal": "fastest"}, {"service": "energy", "T_s": "$"}])"), HasSubstr("refers to the step ''"));
  EXPECT_THAT(why(R"([{"goal": "fastest"}, {"service": "energy", "colour": "$1/T_s"}])"), HasSubstr("/steps/1/colour: "));
  EXPECT_THAT(why(R"([{"goal": "fastest"}, {"service": "energy", "T_s": -1}])"), HasSubstr("/steps/1/T_s: "));
  EXPECT_THAT(why(R"([{"name": "a", "goal": "fastest"}, {"name": "a", "goal": "cheapest"}])"), HasSubstr("/steps/1/name: "));
  EXPECT_THAT(why(R"([{"name": "a/b", "goal": "fastest"}])"), HasSubstr("/steps/0/name: "));
  EXPECT_THAT(why(R"([{"steps": [{"goal": "fastest"}]}])"), HasSubstr("/steps/0/steps: "));
  EXPECT_THAT(why(R"([{"goal": "fastest", "audience": "planner"}])"), HasSubstr("/steps/0/audience: "));
  EXPECT_THAT(why(R"([{"service": "nobody"}])"), HasSubstr("/steps/0/service: "));
  EXPECT_THAT(why(R"([{"service": 1}])"), HasSubstr("/steps/0/service: "));
  EXPECT_THAT(why(R"([{}])"), HasSubstr("/steps/0: has several readings"));
  EXPECT_THAT(why(R"([7])"), HasSubstr("/steps/0: is no object"));
  EXPECT_THAT(why("[]"), HasSubstr("/steps: "));
  EXPECT_THAT(why(R"({"goal": "fastest"})"), HasSubstr("/steps: "));
  EXPECT_THAT(why(R"([{"goal": "fastest"}])", R"({"robot": "lwr4"})"), HasSubstr("/robot: is no member of a chain"));
  EXPECT_THAT(why(R"([{"goal": "fastest"}])", R"({"audience": "child"})"), HasSubstr("/audience: "));
  EXPECT_THAT(why(R"([{"goal": "fastest"}])", R"({"audience": 3})"), HasSubstr("/audience: "));
  EXPECT_THAT(why(R"([{"goal": "fastest"}])", R"({"defaults": 3})"), HasSubstr("/defaults: "));
  EXPECT_THAT(why(R"([{"goal": "fastest", "detail": "all"},
                   {"service": "energy", "T_s": "$1/series/joints/0/q_rad/99999999999999999999999"}])"),
              HasSubstr("which did not answer that"));
  EXPECT_THAT(
      why(R"([{"goal": "fastest"}, {"goal": "fastest"}])", R"({"defaults": {"x": ")" + std::string(3 << 20, 'x') + "\"}}"),
      HasSubstr("/defaults: are too large to be members of 2 steps"));
  std::string many = "[";
  for (int i = 0; i < 101; ++i) many += std::string(i ? "," : "") + R"({"goal": "fastest"})";
  EXPECT_THAT(why(many + "]"), HasSubstr("/steps: is no array of 1 to 100"));
  std::string wide = R"([{"goal": "fastest"}, {"goal": "cheapest")";
  for (int i = 0; i < 256; ++i) wide += ",\"" + std::to_string(i) + "\":0";
  EXPECT_THAT(why(wide + "}]"), HasSubstr("/steps/1: has 260 members with the defaults, expected at most 256"));
}

/// A value of JSON that has been damaged at random: members renamed, dropped, exchanged, replaced.
void damage(Json& value, std::mt19937& random) {
  static const Json kOther = Json::parse(
      R"([null, true, -1, 1e300, "", "$", "$shortest/T_s", "$shortest", "$cost/~", [], {}, [1, "$1/T_s"], {"row": "cost"}, "fastest", "lwr4"])");
  if (value.is_structured() && !value.empty() && random() % 4 != 0) {
    auto at = value.begin();
    std::advance(at, random() % value.size());
    return damage(*at, random);
  }
  if (value.is_object() && random() % 2 == 0) {
    static const char* const kNames[] = {"goal", "service",    "steps",    "audience", "choice",
                                         "name", "deadline_s", "person_m", "T_s",      "detail"};
    value[kNames[random() % std::size(kNames)]] = kOther[random() % kOther.size()];
    return;
  }
  value = kOther[random() % kOther.size()];
}

// Whatever a client sends is answered or refused with a pointer; what the check lets pass is not refused for its form later.
TEST(Chains, AnswerOrRefuseDamagedRequests) {
  Robots robots({kRobots}, "lwr4");
  std::mt19937 random(86);
  int answered = 0;
  for (int k = 0; k < 200; ++k) {
    Json request =
        k % 2 ? chain_of(kChain["steps"], R"({"audience": "planner"})") : with(kMove, R"({"goal": "fastest", "person_m": 3})");
    for (std::size_t n = random() % 3; n-- > 0;) damage(request, random);
    try {
      check_object(robots, request);
      (void)answer_object(robots, request);
      ++answered;
    } catch (const Error&) {
    }
  }
  EXPECT_GT(answered, 50);
}

}  // namespace
}  // namespace cotwin::services::control_test
