#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "components/services/json/contact_json.h"
#include "components/services/json/control/control.h"
#include "components/services/json/move_json.h"
#include "components/services/json/request.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

/// What is said of a reply. {name} is a figure or word by its place in the reply, with the unit of its name; what is in brackets is left
/// out where a figure in it does not exist, or all of them have been said before. The first pattern of the service counts that fits.
struct Pattern {
  const char *service, *when;  // of this reply: a figure that exists, "member=word", or "": any other one
  const char *yes, *no;        // no: the motion is not possible
  const char* due;             // the duration that has to be in time, the first one that exists
  const char* figures;         // of the planner, the first five that exist: label=place
  // Of answers about persons, before the reason: one is not safe, or nobody can say.
  const char *unsafe = nullptr, *unknown = nullptr;
};
const Pattern kPatterns[] = {
    {"feasibility", "", "The robot can make the move in {T_s}", "The robot cannot make the move[ in {T_s}]: {reason}", "T_s",
     "duration=T_s|share of the closest bound=limiting/share|time of the closest bound=limiting/t_s|"
     "least distance=clear_of/nearest/distance_m|time of the least distance=clear_of/nearest/t_s"},
    {"cycle_time", "moves_per_hour", "The move takes {T_s} at least, which makes {moves_per_hour} moves per hour", "",
     "T_cycle_s",
     "shortest duration=T_s|cycle=T_cycle_s|moves per hour=moves_per_hour|share of the closest bound=limiting/share|"
     "least distance=clear_of/nearest/distance_m|time of the closest bound=limiting/t_s"},
    {"cycle_time", "", "The robot does not move", "No duration of the move is possible: {reason}", "T_cycle_s",
     "share of the closest bound=limiting/share|least distance=clear_of/nearest/distance_m"},
    {"energy", "boundary=joints", "The move takes {T_s} and needs {energy_J} for the work of the joints; losses are unknown",
     "The move is not possible in {T_s}: {reason}", "T_s", "duration=T_s|work of the joints=energy_J"},
    {"energy", "cycle_s",
     "The cycle of {cycle_s} needs {energy_J}, the move of {T_s} {move_J}[; the cycle costs {price}][; with a duration of the "
     "move "
     "of {best/T_s} it would need {best/energy_J}]",
     "The move is not possible in {T_s}: {reason}", "T_s",
     "duration=T_s|cycle=cycle_s|energy of the cycle=energy_J|energy of the move=move_J|price of the cycle=price|CO2=co2_kg|"
     "largest power=peak_power_W"},
    {"energy", "",
     "The move takes {T_s} and needs {energy_J}[, which costs {price}][; with a duration of {best/T_s} it would need "
     "{best/energy_J}]",
     "The move is not possible in {T_s}: {reason}", "T_s",
     "duration=T_s|energy=energy_J|price=price|duration of least energy=best/T_s|energy saved by it=best/saved_J|"
     "CO2=co2_kg|largest power=peak_power_W|energy returned=returned_J"},
    {"torques", "", "The motors can make the move in {T_s}", "The move is not possible in {T_s}: {reason}", "T_s",
     "duration=T_s"},
    {"peak_power", "", "The move takes {T_s}, and the motors draw {drawn/power_W} at most",
     "The move is not possible in {T_s}: {reason}", "T_s",
     "duration=T_s|largest power=drawn/power_W|its time=drawn/t_s|largest power returned=returned/power_W|its time "
     "there=returned/t_s"},
    {"jerk", "", "The move takes {T_s}[ and has {share_of_quintic} of the jerk of the standard motion]",
     "The move is not possible in {T_s}: {reason}", "T_s", "duration=T_s|jerk of the standard motion=share_of_quintic"},
    {"effective_mass", "", "The robot feels like {lightest/mass_kg} to {heaviest/mass_kg} along the move, which takes {T_s}",
     "The move is not possible in {T_s}: {reason}", "T_s",
     "duration=T_s|least mass=lightest/mass_kg|its time=lightest/t_s|largest mass=heaviest/mass_kg|its time "
     "there=heaviest/t_s"},
    {"safety", "pace=safe", "The move takes {T_s} at least beside a person", "The move is not possible in {T_s}: {reason}",
     "T_s",
     "shortest duration beside a person=T_s|share of the limit=iso_ts_15066/share|largest "
     "speed=iso_ts_15066/speed_m_per_s|its limit=iso_ts_15066/limit_m_per_s",
     nullptr, "The move takes {T_s} at least beside a person, "},
    {"safety", "", "In {T_s} the move is slow enough for contact with a person[ at the {worst_part}]",
     "The move is not possible in {T_s}: {reason}", "T_s",
     "duration=T_s|duration from which on it is safe=T_safe_s|share of the limit=iso_ts_15066/share|largest "
     "speed=iso_ts_15066/speed_m_per_s|its limit=iso_ts_15066/limit_m_per_s",
     "In {T_s} the move is ", "In {T_s} the move is "},
    {"manipulability", "", "The move takes {T_s} and is least agile at {kinematic/least/t_s}",
     "The move is not possible in {T_s}: {reason}", "T_s",
     "duration=T_s|time of least velocity=kinematic/least/t_s|time of greatest velocity=kinematic/greatest/t_s|"
     "time of least acceleration=dynamic/least/t_s|time of greatest acceleration=dynamic/greatest/t_s"},
    {"payload", "", "The robot can make the move of {T_s}[ with up to {mass_kg}]",
     "The move is not possible in {T_s}, even without a load: {reason}", "T_s",
     "duration=T_s|largest load=mass_kg|share of the closest bound=limiting/share|time of the closest bound=limiting/t_s"},
    {"reach", "", "The robot reaches all poses", "The robot does not reach all poses: {reason}", "",
     "distance left=poses/0/distance_m|angle left=poses/0/angle_rad"},
    {"reaction", "", "The move takes {T_s} and turns the base by {worst/turn/turn_rad} at most, {end/turn_rad} at its end",
     "The move is not possible in {T_s}: {reason}", "T_s",
     "duration=T_s|turn at the end=end/turn_rad|largest turn=worst/turn/turn_rad|its time=worst/turn/t_s|mass=mass_kg"},
    {"reactionless", "",
     "The robot gets there in {T_s} and turns its base by {worst/turn/turn_rad} at most, the standard motion by "
     "{standard/worst_turn_rad}",
     "There is no such motion: {reason}", "T_s",
     "duration=T_s|largest turn=worst/turn/turn_rad|turn at the end=end/turn_rad|turn of the standard "
     "motion=standard/worst_turn_rad|distance left=to_go/distance_m"},
    {"throughput", "moves_per_hour",
     "A cycle takes {T_cycle_s}, of which {T_settle_s} to settle, and {moves_per_hour} fit in an hour", "", "T_cycle_s",
     "cycle=T_cycle_s|move=T_move_s|settling=T_settle_s|moves per hour=moves_per_hour|share lost to compliance=lost_share"},
    {"throughput", "", "The robot does not move; it settles in {T_settle_s}",
     "The move is not possible in {T_move_s}: {reason}", "T_cycle_s", "settling=T_settle_s|move=T_move_s"},
    {"optimise", "front", "{front} motions were found, of which none is better than another in all costs",
     "No possible motion was found: {reason}", "", ""},
    {"optimise", "", "A motion was found that takes {T_s}[ and saves {saved_share} against the standard one]",
     "No possible motion was found: {reason}", "compliance/T_cycle_s|T_s",
     "duration=T_s|share saved=saved_share|energy=costs/energy_J|work=costs/work_J|"
     "share of the limits for persons=costs/safety_share|effective mass=costs/effective_mass_kg|"
     "share of the closest bound=limiting/share|least distance=clear_of/nearest/distance_m|duration of the standard "
     "motion=quintic/T_s"},
    {"grow", "", "{feasible_motions} of {motions} motions are possible[, the fastest in {costs/time_s/least}]",
     "None of {motions} motions is possible: {reason}", "",
     "motions=motions|possible motions=feasible_motions|shortest duration=costs/time_s/least|least "
     "work=costs/work_J/least|least energy=costs/energy_J/least"},
    {"verify", "", "In the twin the robot makes the move in {T_s}[ and draws {drawn_J}]",
     "In the twin the robot does not make the move in {T_s}: {reason}", "T_s",
     "duration=T_s|work=work_J|work predicted=rigid_work_J|friction=friction_J|energy drawn=drawn_J"}};

const Json* at(const Json& reply, const std::string& place) {
  const nlohmann::json_pointer<std::string> pointer("/" + place);
  return reply.contains(pointer) && !reply[pointer].is_null() ? &reply[pointer] : nullptr;
}

struct Figure {
  double value;
  const char* unit;
};
/// In the unit in which people read it: by the end of its name, or of one that it is a part of.
Figure read_by_people(const std::string& name, double x) {
  const double size = std::abs(x);
  if (name.ends_with("_m_per_s")) return {x, "m/s"};
  if (name.ends_with("_s")) return size >= 7200 ? Figure{x / 3600, "h"} : size >= 120 ? Figure{x / 60, "min"} : Figure{x, "s"};
  if (name.ends_with("_J")) return size >= 1e6 ? Figure{x / 1e6, "MJ"} : size >= 1e3 ? Figure{x / 1e3, "kJ"} : Figure{x, "J"};
  if (name.ends_with("_W")) return size >= 1e3 ? Figure{x / 1e3, "kW"} : Figure{x, "W"};
  if (name.ends_with("_kg")) return size > 0 && size < 1 ? Figure{1e3 * x, "g"} : Figure{x, "kg"};
  if (name.ends_with("_m")) return size < 1 ? Figure{1e3 * x, "mm"} : Figure{x, "m"};
  if (name.ends_with("_rad")) return {x * 180 / std::numbers::pi, "°"};
  if (name.ends_with("share") || name.ends_with("share_of_quintic")) return {100 * x, "%"};
  if (name == "price" && size > 0 && size < 0.01) return {1e3 * x, "per 1000 moves"};
  const std::size_t parent = name.rfind('/');
  return parent == std::string::npos ? Figure{x, ""} : read_by_people(name.substr(0, parent), x);
}

/// Three digits, without an exponent.
std::string digits_of(double x) {
  if (x == 0) return "0";
  const int decimals = std::clamp(2 - static_cast<int>(std::floor(std::log10(std::abs(x)))), 0, 9);
  std::array<char, 400> buffer{};
  std::snprintf(buffer.data(), buffer.size(), "%.*f", decimals, x);
  std::string digits = buffer.data();
  if (decimals > 0) digits.erase(digits.find_last_not_of('0') + 1);
  if (digits.ends_with('.')) digits.pop_back();
  return digits == "-0" ? "0" : digits;
}

std::string words_of(const std::string& place, const Json& value) {
  if (value.is_array()) return std::to_string(value.size());
  if (value.is_string()) {
    const std::string words = value.get<std::string>();
    return place.ends_with("_part") ? words_of_part(words) : words;
  }
  if (!value.is_number()) return value.dump();
  const Figure figure = read_by_people(place, value.get<double>());
  const std::string unit = figure.unit;
  return digits_of(figure.value) + (unit.empty() || unit == "°" ? "" : " ") + unit;
}

std::string filled(std::string_view pattern, const Json& reply) {
  std::string all, group;
  bool in_group = false, whole = true, news = false;
  for (std::size_t i = 0; i < pattern.size(); ++i) {
    std::string& out = in_group ? group : all;
    const char c = pattern[i];
    if (c == '[') {
      in_group = whole = true, news = false;
    } else if (c == ']') {
      if (whole && news) all += group;
      group.clear();
      in_group = false;
    } else if (c == '{') {
      const std::size_t end = pattern.find('}', i);
      const std::string place(pattern.substr(i + 1, end - i - 1));
      const Json* value = at(reply, place);
      const std::string words = value ? words_of(place, *value) : "an unknown figure";
      whole = whole && value;
      news = news || all.find(words) == std::string::npos;
      out += words;
      i = end;
    } else {
      out += c;
    }
  }
  return all;
}

Json figures_of(const Pattern& pattern, const Json& reply) {
  Json figures = Json::array();
  for (const std::string_view entry : text::split(pattern.figures, '|')) {
    const std::size_t cut = entry.find('=');
    const std::string place(entry.substr(cut + 1));
    const Json* value = at(reply, place);
    if (!value || !value->is_number() || figures.size() == 5) continue;
    const Figure figure = read_by_people(place, value->get<double>());
    figures.push_back(
        {{"name", entry.substr(0, cut)}, {"value", figure.value}, {"unit", figure.unit}, {"text", words_of(place, *value)}});
  }
  return figures;
}

const Pattern& pattern_of(const std::string& service, const Json& reply) {
  const auto fits = [&](const Pattern& p) {
    const std::string_view when = p.when;
    const std::size_t cut = when.find('=');
    const Json* const value = when.empty() ? nullptr : at(reply, std::string(when.substr(0, cut)));
    return service == p.service && (when.empty() || (value && (cut == when.npos || *value == when.substr(cut + 1))));
  };
  return *std::ranges::find_if(kPatterns, fits);
}

/// Adds the findings on the persons and the deadline of a choice, and tells the choice.
void add_choice(const std::string& service, const Json& choice, Json& reply) {
  Verdict verdict(reply);
  Json& told = reply["choice"];
  told = {{"row", choice["row"]}, {"persons", choice["persons"]}, {"service", service}, {"why", row_of(choice).why}};
  if (choice["persons"] == "near" && !verdict.find(Of::kPersons))
    verdict.add(Of::kPersons, Says::kUnknown, "a person is near, which this does not regard");
  if (choice.contains("deadline_s")) {
    told["deadline_s"] = choice["deadline_s"];
    told["in_time"] = nullptr;
    const Json* T = nullptr;
    std::string cycle;
    for (const std::string_view place : text::split(pattern_of(service, reply).due, '|'))
      if (!T && !place.empty()) {
        T = at(reply, std::string(place));
        if (T && place.ends_with("T_cycle_s")) cycle = "the cycle of " + words_of("_s", *T) + " is ";
      }
    if (T) {
      const bool in_time = T->get<double>() <= choice["deadline_s"].get<double>();
      told["in_time"] = in_time;
      verdict.add(Of::kDeadline, in_time, cycle + "later than the deadline in " + words_of("_s", choice["deadline_s"]));
    } else {
      verdict.add(Of::kDeadline, Says::kUnknown, "the deadline is not regarded, the answer has no duration");
    }
  }
  verdict.tell_findings(reply);
}

/// The verdict in a sentence, without the full stop.
std::string sentence_of(const std::string& service, const Json& reply) {
  const Verdict verdict(reply);
  const Pattern& pattern = pattern_of(service, reply);
  const Finding* const persons = verdict.find(Of::kPersons);
  const char* const before = !persons || persons->says == Says::kYes ? nullptr
                             : persons->says == Says::kNo            ? pattern.unsafe
                                                                     : pattern.unknown;
  std::string sentence = !verdict.feasible() ? filled(pattern.no, reply)
                         : before            ? filled(before, reply) + persons->why
                                             : filled(pattern.yes, reply);
  const auto add = [&](const std::string& words) {
    if (sentence.find(words) == std::string::npos) sentence += "; " + words;
  };
  for (const Finding& f : verdict.findings()) add(f.why);
  if (const Json assumed = reply.value("assumptions", Json::array()); !assumed.empty() && light_of(reply) < 2)
    add("not measured: " + assumed[0]["what"].get<std::string>() +
        (assumed.size() > 1 ? " and " + std::to_string(assumed.size() - 1) + " more" : ""));
  return sentence;
}

}  // namespace

std::string detail_for(const std::string& audience) {
  return audience == "operator" ? "verdict" : audience == "planner" ? "margins" : audience == "engineer" ? "all" : "";
}

Audience audience_of(const Json& request, bool detail) {
  Audience audience;
  if (!request.is_object()) return audience;
  Reader r(request);
  if (request.contains("audience")) audience.name = r.word("audience", kAudiences);
  if (request.contains("require")) audience.least = r.word("require", kRequired);
  audience.whole = audience.name.empty() || audience.name == "engineer" || detail;
  return audience;
}

Json presented(const std::string& service, const Audience& audience, const Json& choice, Json reply) {
  if (!choice.is_null()) add_choice(service, choice, reply);
  light_all(reply);
  const std::size_t light = light_of(reply);
  const auto least = std::ranges::find(kLights, audience.least) - kLights.begin();
  const bool unmet = !audience.least.empty() && light > static_cast<std::size_t>(least);
  if (audience.name.empty() && !unmet) return reply;
  const std::string sentence = sentence_of(service, reply) + ".";
  if (unmet) reply["verdict"]["unmet"] = sentence;
  if (audience.name.empty()) return reply;
  Json own = Json::object();
  if (audience.whole) {
    own = std::move(reply);
  } else {
    own["verdict"] = reply["verdict"];
    if (audience.name == "planner") own["figures"] = figures_of(pattern_of(service, reply), reply);
    if (!choice.is_null()) own["choice"] = reply["choice"];
  }
  own["sentence"] = sentence;
  own["light"] = kLights[light];
  return own;
}

Json schemas::light_required() {
  return described({{"enum", kRequired}},
                   "the worst light that will do: with a worse one the exit code is 1, and a job is Aborted");
}

void add_control_schemas(const std::string& service, Json& request, Json& reply) {
  using namespace schemas;
  Json rows = Json::array();
  for (const Choice& row : choices())
    if (service == row.service) rows.push_back(row.name);
  const Json persons{{"enum", {"near", "away", "unknown"}}};
  request["properties"]["audience"] =
      described({{"enum", kAudiences}},
                "operator: a sentence and a light; planner: also five figures; engineer: beside everything; the first two with "
                "detail beside the reply of that detail");
  if (!rows.empty())
    request["properties"]["choice"] =
        described(Object().must("row", {{"enum", rows}}).must("persons", persons).may("deadline_s", positive()),
                  "why the control has chosen this service");
  request["properties"]["require"] = light_required();
  reply["properties"]["choice"] =
      Object()
          .must("row", kText)
          .must("persons", persons)
          .may("deadline_s", kNumber)
          .must("service", kText)
          .must("why", kText)
          .may("in_time", described({{"type", {"boolean", "null"}}}, "null: the answer has no duration"));
  reply["properties"]["sentence"] = described(kText, "with an audience");
  reply["properties"]["light"] = described({{"enum", kLights}}, "with an audience: that of the verdict");
  reply["properties"]["figures"] = array_of(Object()
                                                .must("name", kText)
                                                .must("value", kNumber)
                                                .must("unit", kText)
                                                .must("text", described(kText, "as people read it")));
  // Of operators and planners the reply has no other members.
  reply["anyOf"] = Json::array({Json{{"required", reply["required"]}}, Json{{"required", {"verdict", "sentence", "light"}}}});
  reply.erase("required");
}

}  // namespace cotwin::services
