#include "master/workflows/waypoints.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "master/engine/wiring/members.h"
#include "master/scenario/folders.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"
#include "models/trajectory/waypoints.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

ComponentSpec& motion_of(Scenario& scenario, std::string& points, const std::string& place) {
  const std::size_t equals = points.find('=');
  if (equals != std::string::npos) {
    const std::string name(text::trim(points.substr(0, equals)));
    for (ComponentSpec& spec : scenario.components) {
      if (spec.name != name) continue;
      if (!is_unit_of(spec, "motion")) throw Error(place, "'" + name + "' is " + spec.source + ", expected a unit:motion");
      points.erase(0, equals + 1);
      return spec;
    }
  }
  ComponentSpec* only = nullptr;
  std::string names;
  for (ComponentSpec& spec : scenario.components) {
    if (!is_unit_of(spec, "motion")) continue;
    names += (only == nullptr ? "" : ", ") + spec.name;
    only = &spec;
  }
  if (only == nullptr) throw Error(place, "the scenario has no unit:motion");
  if (names != only->name)
    throw Error(place, "the scenario has the motions " + names + ", expected the name of one before '='");
  return *only;
}

/// The axes of a motion of joints through waypoints.
std::vector<trajectory::Axis> axes_of(const ComponentSpec& motion, const Scenario& scenario, std::span<const UnitType> types,
                                      const std::string& place) {
  const UnitSource source = parse_unit_source(motion.source);
  Settings settings(source.unit, source.query, settings_for(scenario, motion.name), model_folders(scenario.folder));
  settings.declare(settings_of(find_type(source.unit, types)));
  for (const auto& [setting, wanted] : {std::pair("kind", "waypoints"), std::pair("space", "joint")}) {
    if (const std::string has = settings.choice(setting); has != wanted)
      throw Error(place, "component '" + motion.name + "' has " + setting + "=" + has + ", expected " + setting + "=" + wanted);
  }
  if (settings.text("robot").empty()) return trajectory::free_axes(static_cast<std::size_t>(settings.integer("joints", 1)));
  return trajectory::axes_of(settings.robot(Settings::Masses::kUnused));
}

trajectory::Waypoints parse_points(std::string_view given, std::span<const trajectory::Axis> axes, const std::string& place) {
  trajectory::Waypoints all;
  all.joints = axes.size();
  std::size_t timed = 0, number = 0;
  const auto real = [&](std::string_view word) {
    const std::optional<double> value = text::parse_real(word);
    if (!value || !std::isfinite(*value))
      throw Error(place, "point " + std::to_string(number) + ": '" + std::string(text::trim(word)) + "', expected a number");
    return *value;
  };
  for (std::string_view point : text::split(given, ';')) {
    if (text::trim(point).empty()) continue;
    ++number;
    if (const std::size_t colon = point.find(':'); colon != std::string_view::npos) {
      all.t.push_back(real(point.substr(0, colon)));
      point.remove_prefix(colon + 1);
      ++timed;
    }
    std::string words(point);
    std::replace(words.begin(), words.end(), ',', ' ');
    std::size_t count = 0;
    for (const std::string_view word : text::split(words, ' ')) {
      if (word.empty()) continue;
      all.q.push_back(real(word));
      ++count;
    }
    if (count != axes.size())
      throw Error(place, "point " + std::to_string(number) + " has " + std::to_string(count) + " numbers, expected " +
                             std::to_string(axes.size()) + ", one per joint");
  }
  if (number < 2) throw Error(place, "expected an existing file, or two points or more with ';' between them");
  if (timed != 0 && timed != number)
    throw Error(place, "some points have a time, expected all or none, as in '0: 0 0; 2: 1 0.5'");
  if (timed == number) return all;
  all.t = {0};
  for (std::size_t k = 1; k < number; ++k) {
    const std::span<const double> q(all.q);
    all.t.push_back(all.t.back() + trajectory::calm_duration(axes, q.subspan((k - 1) * all.joints, all.joints),
                                                             q.subspan(k * all.joints, all.joints)));
  }
  return all;
}

/// Removes the start values of a variable or its elements.
void forget(ComponentSpec& spec, std::string_view name) {
  std::erase_if(spec.start_values, [&](const ParameterValue& v) { return v.name.substr(0, v.name.find('[')) == name; });
}

/// The components that values of `first` reach.
std::set<std::string> reached_from(const std::string& first, const Scenario& scenario) {
  std::set<std::string> reached{first};
  for (bool grown = true; grown;) {
    grown = false;
    for (const ConnectionSpec& c : scenario.connections) {
      if (reached.contains(c.from.component)) grown = reached.insert(c.to.component).second || grown;
    }
  }
  return reached;
}

/// Lets drive trains begin at q.
void start_drives(Scenario& scenario, const std::string& motion, std::span<const double> q, std::span<const UnitType> types,
                  const std::string& place) {
  const std::set<std::string> reached = reached_from(motion, scenario);
  for (ComponentSpec& spec : scenario.components) {
    if (!reached.contains(spec.name) || !(is_unit_of(spec, "drive_train") || is_unit_of(spec, "contact_world"))) continue;
    const bool connected = std::any_of(scenario.connections.begin(), scenario.connections.end(), [&](const ConnectionSpec& c) {
      return c.to.component == spec.name && c.to.variable.substr(0, c.to.variable.find('[')) == "q0";
    });
    const bool chosen = std::any_of(spec.start_values.begin(), spec.start_values.end(), [](const ParameterValue& v) {
      return v.name.substr(0, v.name.find('[')) == "q0" && v.by_user;
    });
    if (connected || chosen) continue;
    fmu::FmuStore fmus;
    const Member member = load_member(spec, scenario, types, model_folders(scenario.folder), fmus);
    const Variable* const q0 = member.variables().find("q0");
    if (q0 == nullptr || q0->size() != q.size()) continue;
    forget(spec, "q0");
    spec.start_values.push_back({"q0", text::joined(q), "", place});
  }
}

}  // namespace

void set_waypoints(Scenario& scenario, const std::string& given, bool extend, std::span<const UnitType> types) {
  const std::string place = "--waypoints " + given;
  std::string points = given;
  ComponentSpec& motion = motion_of(scenario, points, place);
  const std::vector<trajectory::Axis> axes = axes_of(motion, scenario, types, place);
  std::error_code none;
  const fs::path file(text::trim(points));
  const bool is_file = fs::is_regular_file(file, none);
  if (!is_file && file.extension() == ".csv") throw Error(place, "no file " + file.string());
  std::optional<trajectory::Waypoints> parsed;
  if (!is_file) parsed = parse_points(points, axes, place);
  for (const char* name : {"file", "waypoint_t", "waypoint_q", "waypoint_dwell", "c_r"}) forget(motion, name);
  const auto set = [&](const char* name, std::string value) {
    motion.start_values.push_back({name, std::move(value), "", place});
  };
  if (is_file) {
    set("file", fs::absolute(file).lexically_normal().string());
  } else {
    motion.source = with_setting(motion.source, "points", std::to_string(parsed->t.size()));
    set("waypoint_t", text::joined(parsed->t));
    set("waypoint_q", text::joined(parsed->q));
  }
  // Prepares the motion once, which checks it against the limits and gives its first point and its duration.
  fmu::FmuStore fmus;
  const Member member = load_member(motion, scenario, types, model_folders(scenario.folder), fmus);
  apply(start_values(scenario, member), member.variables());
  member.instance.unit->initialise(scenario.start);
  const Variables& v = member.variables();
  start_drives(scenario, motion.name, v.at("q_d").reals(), types, place);
  const double end = v.at("t_start").reals()[0] + v.at("duration").reals()[0];
  if (extend && scenario.stop.seconds() < end) scenario.stop = Time::from_seconds(std::ceil(10 * end) / 10);
}

}  // namespace cotwin::master
