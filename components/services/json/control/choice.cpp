#include <algorithm>
#include <map>
#include <mutex>

#include "components/services/json/control/control.h"
#include "components/services/json/request.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

const std::vector<std::string> kGoals = {"possible", "fastest", "cheapest", "gentle", "safe"};
const std::vector<std::string> kPersons = {"unknown", "near", "away"};
/// Members that say what the request is about and no service takes, and those that a service without use for them leaves out.
constexpr const char *kContext[] = {"goal", "person_m", "deadline_s"}, *kTariff[] = {"price_per_kWh", "co2_kg_per_kWh"};

#define COTWIN_END "to_q_rad|to_q_deg|to_q"
#define COTWIN_PATH "series|waypoints"

bool gives_one_of(const Json& request, std::string_view names) {
  return std::ranges::any_of(text::split(names, '|'), [&](const auto& name) { return request.contains(std::string(name)); });
}

bool is_tariff(const std::string& name) { return std::ranges::find(kTariff, name) != std::end(kTariff); }

/// Why the row does not fit the request; "": it does.
std::string obstacle(const Choice& row, const Json& request, const std::string& persons) {
  for (const std::string_view names : text::split(row.given, ' '))
    if (!names.empty() && !gives_one_of(request, names)) return std::string(names.substr(0, names.find('|'))) + " is missing";
  for (const std::string_view name : text::split(row.missing, ' '))
    if (!name.empty() && request.contains(std::string(name))) return std::string(name) + " is given";
  if (row.near > 0 && persons != "near") return "no person is known to be near";
  if (row.near < 0 && persons == "near") return "a person is near";
  const Json sets = Json::parse(row.sets), &takes = schemas_of(row.service)["request"]["properties"];
  for (const auto& [name, value] : request.items()) {
    if (sets.contains(name) ? sets[name] != value : name == row.becomes) return name + " is given, which the goal decides";
    if (std::ranges::find(kContext, name) == std::end(kContext) && name != row.time && !is_tariff(name) &&
        !takes.contains(name))
      return std::string(row.service) + " takes no " + name;
  }
  return "";
}

}  // namespace

const std::vector<Choice>& choices() {
  // row, goal, service, given, missing, near, sets, time and what it becomes, why
  static const std::vector<Choice> kAll = {
      {"reach", "possible", "reach", "poses", "", 0, "{}", "", "", "poses are given: whether the frame gets there"},
      {"move", "possible", "feasibility", COTWIN_END "|" COTWIN_PATH, "power_max_W", 0, "{}", "", "",
       "a motion is given: whether it keeps its bounds"},
      {"power", "possible", "peak_power", COTWIN_END "|" COTWIN_PATH " power_max_W", "", 0, "{}", "", "",
       "a motion and a bound of power are given: whether it keeps that, too"},
      {"duration", "fastest", "cycle_time", COTWIN_END, "T_s M_kg", -1, "{}", "", "",
       "the duration is missing, and no person is known to be near: the shortest one within the bounds"},
      {"beside_persons", "fastest", "safety", COTWIN_END, "T_s M_kg", 1, R"({"pace": "safe"})", "", "",
       "the duration is missing, and a person is near: the one from which on contact stays within the limits of body parts"},
      {"compliant", "fastest", "throughput", COTWIN_END " M_kg S_N_per_m", "T_s", 0, "{}", "", "",
       "a compliance is given: the shortest move, and the time until it has settled"},
      {"cost", "cheapest", "energy", "T_s|" COTWIN_PATH, "", 0, "{}", "", "", "the duration is given: what the motion costs"},
      {"best_duration", "cheapest", "energy", COTWIN_END, "T_s deadline_s", 0, R"({"best": true})", "", "",
       "the duration is missing, and nothing is due: the one of least energy"},
      {"cheapest_in_time", "cheapest", "optimise", COTWIN_END " deadline_s", "T_s", 0, R"({"cost": "energy"})", "deadline_s",
       "T_max_s", "the duration is missing before a deadline: the motion of least energy until then"},
      {"jerk", "gentle", "jerk", COTWIN_PATH, "", 0, "{}", "", "", "a path is given: how gentle it is"},
      {"least_jerk", "gentle", "optimise", COTWIN_END " T_s", "", 0, R"({"cost": "jerk"})", "T_s", "T_min_s",
       "the duration is given: the motion of least jerk in it"},
      {"gentlest_in_time", "gentle", "optimise", COTWIN_END " deadline_s", "T_s", 0, R"({"cost": "jerk"})", "deadline_s",
       "T_max_s", "the duration is missing before a deadline: the motion of least jerk until then"},
      {"safe_motion", "safe", "safety", "T_s|" COTWIN_PATH, "", 0, "{}", "", "",
       "the duration is given: whether contact stays within the limits of body parts"},
      {"safe_duration", "safe", "safety", COTWIN_END, "T_s deadline_s", 0, R"({"pace": "safe"})", "", "",
       "the duration is missing, and nothing is due: the one from which on contact stays within the limits of body parts"},
      {"safest_in_time", "safe", "optimise", COTWIN_END " deadline_s", "T_s", 0, R"({"cost": "safety"})", "deadline_s",
       "T_max_s",
       "the duration is missing before a deadline: the motion with the least share of the limits of body parts until then"}};
  return kAll;
}

const Json& schemas_of(const std::string& service) {
  static std::mutex mutex;
  static std::map<std::string, Json> all;
  const std::lock_guard lock(mutex);
  const auto at = all.find(service);
  return at != all.end() ? at->second : all.emplace(service, Json::parse(schema(service))).first->second;
}

const Choice& row_of(const Json& choice) {
  return *std::ranges::find(choices(), choice["row"].get<std::string>(), [](const Choice& c) { return std::string(c.name); });
}

namespace {

void check_choice(const Json& request) {
  if (!request.contains("choice")) return;
  Reader r(request["choice"], "/choice");
  const std::string row = r.text("row");
  if (std::ranges::none_of(choices(), [&](const Choice& c) { return row == c.name && request["service"] == c.service; }))
    throw RequestError("/choice/row", "'" + row.substr(0, 40) + "' is no row of the table that chooses this service");
  (void)r.word("persons", kPersons);
  if (r.has("deadline_s")) (void)r.positive("deadline_s");
  r.finish();
}

}  // namespace

#undef COTWIN_END
#undef COTWIN_PATH

void choose(Json& request) {
  if (request.contains("service")) return check_choice(request);
  Reader r(request);
  if (r.has("choice")) throw RequestError("/choice", "is given without service, expected it only beside one");
  if (r.has("deadline")) throw RequestError("/deadline", "is a time, which only a gateway knows, expected deadline_s");
  const std::string goal = r.has("goal") ? r.word("goal", kGoals) : "";
  std::string persons = "unknown";
  if (r.has("person_m")) persons = r.not_negative("person_m", 0) < kNear_m ? "near" : "away";
  if (r.has("deadline_s")) {
    const double left = r.number("deadline_s");
    if (!(left > 0)) throw RequestError("/deadline_s", "is " + text::to_text(left) + " s, in the past, expected more than 0");
    if (const Json* T = r.any("T_s"); T && T->is_number() && T->get<double>() > left)
      throw RequestError("/T_s", "is " + text::to_text(T->get<double>()) + " s, longer than the " + text::to_text(left) +
                                     " s to the deadline, expected at most these");
  }
  std::vector<const Choice*> fits;
  std::string obstacles, readings;
  for (const Choice& row : choices()) {
    if (!goal.empty() && goal != row.goal) continue;
    if (const std::string why = obstacle(row, request, persons); !why.empty()) {
      text::append(obstacles, std::string(row.name) + ": " + why, "; ");
      continue;
    }
    fits.push_back(&row);
    text::append(readings, std::string(row.name) + " (" + row.goal + ", " + row.service + "): " + row.why, "; ");
  }
  if (fits.empty())
    throw RequestError("", goal.empty() ? "has neither service nor goal, expected one of them"
                                        : "fits no row of the goal " + goal + " (" + obstacles + "), expected one that does");
  if (fits.size() > 1)
    throw RequestError("",
                       "has several readings, " + readings + "; expected " + (goal.empty() ? "goal or service" : "service"));
  const Choice& row = *fits.front();
  Json choice{{"row", row.name}, {"persons", persons}};
  if (request.contains("deadline_s")) choice["deadline_s"] = request["deadline_s"];
  Json chosen{{"service", row.service}};
  const Json& takes = schemas_of(row.service)["request"]["properties"];
  for (const auto& [name, value] : request.items())
    if (takes.contains(name)) chosen[name] = value;
  const Json sets = Json::parse(row.sets);
  for (const auto& [name, value] : sets.items()) chosen[name] = value;
  if (*row.time != '\0') chosen[row.becomes] = request[row.time];
  if (std::string_view(row.time) == "deadline_s") chosen[row.becomes] = std::min(request[row.time].get<double>(), kLongest);
  chosen["choice"] = choice;
  request = std::move(chosen);
}

Json control_schemas() {
  using namespace schemas;
  const Json audience{{"enum", kAudiences}};
  Json chosen{{"type", "object"},
              {"description", "A request without a service: the control chooses it (docs/services.md)"},
              {"properties",
               {{"goal", {{"enum", kGoals}}},
                {"person_m", described(at_least_zero(), "distance of the nearest person; without it unknown")},
                {"deadline_s", described(positive(), "seconds until the motion must have ended")},
                {"audience", audience},
                {"require", light_required()}}},
              {"anyOf", Json::array()},
              {"not", {{"anyOf", {{{"required", {"service"}}}, {{"required", {"steps"}}}}}}}};
  for (const char* name : {"goal", "poses", "power_max_W", "M_kg"})  // of which each tells a row, or some
    chosen["anyOf"].push_back({{"required", {name}}});
  const Json object{{"type", "object"}};
  Json steps = array_of(object);
  steps.update({{"minItems", 1}, {"maxItems", kMostSteps}});
  const Json chain = Object()
                         .must("steps", described(steps,
                                                  "requests with names; \"$NAME/POINTER\" is a value of the answer to an "
                                                  "earlier one"))
                         .may("defaults", described(object, "members of all steps"))
                         .may("audience", audience)
                         .may("require", light_required());
  const Json reply = Object()
                         .must("verdict", described(verdict(), "of the first step with the worst light"))
                         .must("steps", array_of(Object().must("name", kText).must("service", kText).must("reply", object)))
                         .may("sentence", kText)
                         .may("light", {{"enum", kLights}});
  return {{"chosen", chosen}, {"chain", chain}, {"chain_reply", reply}};
}

}  // namespace cotwin::services
