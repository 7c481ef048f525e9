#include "master/workflows/tuning/settings.h"

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "components/robot_files/joint_settings.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin::master::tuning {

namespace {

using nlohmann::json;
namespace fs = std::filesystem;

/// Visits every setting once: the one list that writing and reading share.
template <class Visit>
void for_each(Settings& s, Visit&& visit) {
  trajectory::RecordingFormat& f = s.format;
  visit("topic", f.topic);
  visit("t_column", f.t_column);
  visit("t_unit", f.t_unit);
  visit("rate", f.rate);
  visit("q_columns", f.q_columns);
  visit("dq_columns", f.dq_columns);
  visit("tau_columns", f.tau_columns);
  visit("theta_columns", f.theta_columns);
  visit("angle_unit", f.angle_unit);
  visit("q_scale", f.q_scale);
  visit("q_offset", f.q_offset);
  visit("tau_scale", f.tau_scale);
  visit("max_gap", f.max_gap);
  visit("max_speed", f.max_speed);
  visit("split", s.split);
  visit("cutoff", s.cutoff);
  visit("order", s.order);
  visit("margin", s.margin);
  visit("lock", s.lock);
  visit("passive", s.passive);
  visit("accept_data", s.accept_data);
  visit("viscous", s.model.viscous);
  visit("offset", s.model.offset);
  visit("motor_inertia", s.model.motor_inertia);
  visit("load", s.model.load);
  visit("v_R", s.model.v_R);
  visit("delta", s.model.delta);
  visit("harmonics", s.model.harmonics);
  visit("speed_nodes", s.model.speed_nodes);
  visit("prior_weight", s.prior_weight);
  visit("mass_factor", s.bounds.mass_factor);
  visit("stretch_factor", s.bounds.stretch_factor);
  visit("shear", s.bounds.shear);
  visit("shift", s.bounds.shift);
  visit("skip_rows", s.skip_rows);
  visit("seed", s.seed);
  visit("rounds", s.rounds);
  visit("particles", s.particles);
  visit("threshold", s.threshold);
  visit("chosen", s.chosen);
}

std::vector<std::string> to_strings(const std::vector<fs::path>& files) {
  std::vector<std::string> names;
  for (const fs::path& file : files) names.push_back(file.string());
  return names;
}

std::vector<fs::path> to_paths(const std::vector<std::string>& names) { return {names.begin(), names.end()}; }

/// The value of `from` where it has the type of `to` and fits it.
bool take(const json& from, bool& to) {
  if (from.is_boolean()) to = from.get<bool>();
  return from.is_boolean();
}
bool take(const json& from, double& to) {
  if (from.is_number()) to = from.get<double>();
  return from.is_number();
}
bool take(const json& from, std::uint64_t& to) {
  if (from.is_number_unsigned()) to = from.get<std::uint64_t>();
  return from.is_number_unsigned();
}
bool take(const json& from, int& to) {
  if (!from.is_number_integer()) return false;
  const bool fits = from.is_number_unsigned() ? from.get<std::uint64_t>() <= std::numeric_limits<int>::max()
                                              : from.get<std::int64_t>() >= std::numeric_limits<int>::min();
  if (fits) to = from.get<int>();
  return fits;
}
bool take(const json& from, std::string& to) {
  if (from.is_string()) to = from.get<std::string>();
  return from.is_string();
}
template <class T>
bool take(const json& from, std::vector<T>& to) {
  if (!from.is_array()) return false;
  to.resize(from.size());
  for (std::size_t i = 0; i < to.size(); ++i) {
    if (!take(from[i], to[i])) return false;
  }
  return true;
}

template <class T>
T member(const json& object, const char* name, const std::string& place) {
  const auto found = object.find(name);
  if (found == object.end()) throw Error(place, std::string("has no '") + name + "', expected the settings of a tuning");
  T value{};
  if (!take(*found, value))
    throw Error(place, std::string("'") + name + "' is " + found->type_name() + ", expected another type of value");
  return value;
}

}  // namespace

const char* to_text(Method method) {
  return method == Method::kSwarm ? "swarm" : method == Method::kFeasible ? "feasible" : "least-squares";
}

Method method_of(const std::string& text) {
  return text::choose<Method>(
      "method", text, {{"swarm", Method::kSwarm}, {"feasible", Method::kFeasible}, {"least-squares", Method::kLeastSquares}});
}

robot::RobotModel load_robot(const Settings& settings, std::vector<std::string>* warnings) {
  robot::UrdfOptions options;
  options.unphysical = robot::Unphysical::kWarn;
  read_joint_settings(settings.robot.string(), "", settings.lock, settings.passive, options);
  return robot::load_urdf(settings.robot, options, warnings);
}

identification::ProblemOptions problem_options(const Settings& settings) {
  identification::ProblemOptions options;
  options.prior_weight = settings.prior_weight;
  options.bounds = settings.bounds;
  return options;
}

json to_json(const Settings& settings) {
  Settings copy = settings;
  json object;
  object["robot"] = settings.robot.string();
  object["data"] = to_strings(settings.data);
  object["held_out"] = to_strings(settings.held_out);
  object["method"] = to_text(settings.method);
  object["friction"] = identification::to_text(settings.model.friction);
  for_each(copy, [&](const char* name, auto& value) { object[name] = value; });
  return object;
}

Settings settings_from_json(const json& object, const std::string& place) {
  if (!object.is_object()) throw Error(place, "is no object, expected the settings of a tuning");
  Settings settings;
  settings.robot = member<std::string>(object, "robot", place);
  settings.data = to_paths(member<std::vector<std::string>>(object, "data", place));
  settings.held_out = to_paths(member<std::vector<std::string>>(object, "held_out", place));
  settings.method = method_of(member<std::string>(object, "method", place));
  settings.model.friction = identification::friction_law(member<std::string>(object, "friction", place));
  for_each(settings, [&](const char* name, auto& value) {
    if (name == std::string_view("topic") && !object.contains(name)) return;  // older than it
    value = member<std::remove_reference_t<decltype(value)>>(object, name, place);
  });
  check(settings);
  return settings;
}

double most_of_bound(identification::ActiveBound::Kind kind) {
  using enum identification::ActiveBound::Kind;
  return kind == kMass || kind == kStretch ? 1e4 : 1e3;
}

void check(const Settings& s) {
  using enum identification::ActiveBound::Kind;
  const auto within = [](const char* name, double value, double least, double most) {
    if (!(value >= least && value <= most)) {
      throw Error(name, text::to_text(value) + ", expected " + text::to_text(least) + " to " + text::to_text(most));
    }
  };
  if (s.data.empty()) throw Error("--data", "no file, expected at least one");
  within("--split", s.split, 0.05, 1);
  within("--cutoff", s.cutoff, 0, 1e6);
  within("--order", s.order, 1, 8);
  within("--margin", s.margin, -1, 1e6);
  within("--prior-weight", s.prior_weight, 0, 1e6);
  within("--mass-factor", s.bounds.mass_factor, 1.01, most_of_bound(kMass));
  within("--stretch-factor", s.bounds.stretch_factor, 1.01, most_of_bound(kStretch));
  within("--shear", s.bounds.shear, 0.01, most_of_bound(kShear));
  within("--shift", s.bounds.shift, 0.01, most_of_bound(kShift));
  within("--skip-rows", s.skip_rows, 0, 0.5);
  within("--rounds", s.rounds, 1, 1e9);
  within("--particles", s.particles, 4, 1e6);
  within("--threshold", s.threshold, 0, 1e300);
  within("--v-r", s.model.v_R, 1e-6, 1e3);
  within("--max-gap", s.format.max_gap, 1.5, 1e9);
  within("time unit", s.format.t_unit, 1e-12, 1e6);
  within("angle unit", s.format.angle_unit, 1e-6, 1e3);
  within("--rate", s.format.rate, 0, 1e7);
  within("speed nodes", s.model.speed_nodes, 8, 1000);
  within("Stribeck exponent", s.model.delta, 0.1, 10);
  for (const int count : s.model.harmonics) within("--harmonics", count, 0, 4);
}

}  // namespace cotwin::master::tuning
