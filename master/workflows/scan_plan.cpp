// From a scenario with a scanner to one that scans.
#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>

#include "components/unit/settings.h"
#include "master/engine/wiring/members.h"
#include "master/engine/wiring/wiring.h"
#include "master/scenario/folders.h"
#include "master/twin/ssd_write.h"
#include "master/workflows/clear_of.h"
#include "master/workflows/scan.h"
#include "master/workflows/waypoints.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose_values.h"
#include "models/trajectory/waypoints.h"

namespace cotwin::master {
namespace {

namespace fs = std::filesystem;

const ComponentSpec& component_of(const Scenario& scenario, const std::string& name) {
  return *std::ranges::find(scenario.components, name, &ComponentSpec::name);
}

/// The motion of joints that is the nearest source of the positions of the robot at the scanner.
std::string motion_of(const Scenario& scenario, const ScannerSite& site) {
  std::set<std::string> sources;
  for (const ConnectionSpec& c : scenario.connections) {
    if (c.to.component == site.name && c.to.variable.substr(0, c.to.variable.find('[')) == site.prefix + "q")
      sources.insert(c.from.component);
  }
  std::string motions;
  for (std::size_t before = 0; motions.empty() && sources.size() > before;) {
    before = sources.size();
    for (const ComponentSpec& spec : scenario.components)
      if (sources.contains(spec.name) && is_unit_of(spec, "motion")) text::append(motions, spec.name);
    const std::set<std::string> reached = sources;
    for (const ConnectionSpec& c : scenario.connections)
      if (reached.contains(c.to.component)) sources.insert(c.from.component);
  }
  if (motions.empty() || motions.find(',') != std::string::npos)
    throw Error(scenario.file.string(), (motions.empty() ? "no unit:motion reaches " : "the motions " + motions + " reach ") +
                                            site.name + "." + site.prefix +
                                            "q by connections, expected one, to go through postures");
  return motions;
}

/// "wrist_3_joint is at 10.6, beyond its limits -6.28 to 6.28"; "" within all of them.
std::string beyond_limits(const robot::RobotModel& robot, const std::vector<double>& q) {
  for (std::size_t j = 0; j < q.size(); ++j) {
    const robot::Joint& joint = robot.joints[j];
    if (!(q[j] >= joint.q_min && q[j] <= joint.q_max))
      return joint.name + " is at " + text::to_text(q[j], 4) + ", beyond its limits " + text::to_text(joint.q_min, 4) + " to " +
             text::to_text(joint.q_max, 4);
  }
  return "";
}

std::vector<std::vector<double>> wanted_postures(const ScanRequest& r, const Variables& motion,
                                                 const robot::RobotModel& robot) {
  const auto n = static_cast<std::size_t>(robot.n());
  std::vector<std::vector<double>> postures;
  if (!r.postures.empty()) {
    const trajectory::Waypoints read = trajectory::load_waypoints(r.postures, trajectory::axes_of(robot));
    for (std::size_t k = 0; k < read.t.size(); ++k)
      postures.emplace_back(read.q.begin() + static_cast<std::ptrdiff_t>(k * n),
                            read.q.begin() + static_cast<std::ptrdiff_t>((k + 1) * n));
    return postures;
  }
  const auto first = motion.at("q_d").reals();
  const std::vector<double> q_0 = r.at.empty() ? std::vector<double>(first.begin(), first.end()) : r.at;
  if (q_0.size() != n)
    throw Error("--at",
                std::to_string(q_0.size()) + " positions, expected " + std::to_string(n) + ", of the joints of " + robot.name);
  for (const double q : q_0)
    if (!std::isfinite(q)) throw Error("--at", text::to_text(q) + ", expected finite positions");
  for (int k = 0; k < r.count; ++k) {
    postures.push_back(q_0);
    postures.back().back() += k * r.step;
  }
  return postures;
}

}  // namespace

ScannerSite site_of(const Scenario& scenario, const std::string& name, std::span<const UnitType> types) {
  std::string names;
  ScannerSite site;
  for (const ComponentSpec& spec : scenario.components) {
    if (!is_unit_of(spec, "scanner")) continue;
    text::append(names, spec.name);
    if (name.empty() || spec.name == name) site.name = spec.name;
  }
  if (names.empty()) throw Error(scenario.file.string(), "has no unit:scanner, expected one");
  if (site.name.empty() || (name.empty() && site.name != names))
    throw Error("--scanner", (name.empty() ? "is not given" : "'" + name + "' is none") + ", expected one of " + names);
  const UnitSource source = parse_unit_source(component_of(scenario, site.name).source);
  Settings settings(source.unit, source.query, settings_for(scenario, site.name), model_folders(scenario.folder));
  settings.declare(settings_of(find_type(source.unit, types)));
  site.cell = settings.cell();
  const Member member = member_of(scenario, site.name, types, model_folders(scenario.folder));
  const Variables& v = member.variables();
  const std::string frame = settings.text("frame");
  site.frame =
      scene::find_frame(site.cell, frame.empty() ? site.cell.robots.front().model.end_effector().name : frame, site.name);
  if (site.frame.robot < 0)
    throw Error(site.name, "is fixed to the scene, frame=" + frame + ", expected a frame of a robot, which moves it");
  const std::string& robot = site.cell.robots[static_cast<std::size_t>(site.frame.robot)].name;
  site.prefix = robot.empty() ? "" : text::identifier(robot) + ".";
  site.floating = settings.choice("base") == "floating";
  site.X_FS = pose_of(site.name + ".mount_quat", {v.at("mount_p").reals().begin(), v.at("mount_p").reals().end()},
                      {v.at("mount_quat").reals().begin(), v.at("mount_quat").reals().end()});
  site.cell.scene.bodies.clear();
  for (collision::PlacedCell::Body& one : cell_of(scenario, {.names = {site.name}}, types).cell.bodies)
    site.cell.scene.bodies.push_back(std::move(one.body));
  return site;
}

ScanPlan plan_scan(const Scenario& scenario, const ScannerSite& site, const ScanRequest& r, std::span<const UnitType> types) {
  const std::string trigger = site.name + ".trigger";
  if (std::ranges::any_of(scenario.connections,
                          [&](const ConnectionSpec& c) { return c.to.component + "." + c.to.variable == trigger; }))
    throw Error(trigger, "is connected, expected none: the scan triggers its profiles itself");
  const std::string motion = motion_of(scenario, site);
  ScanPlan plan{scenario, motion, {}, {}, {}, {}};
  const robot::RobotModel& robot = site.cell.robots[static_cast<std::size_t>(site.frame.robot)].model;
  Member mover = member_of(scenario, motion, types, model_folders(scenario.folder));
  mover.instance.unit->initialise(scenario.start);
  CellRequest request{.names = r.clear_of, .watching = {site.name}, .motions = {{motion, static_cast<std::size_t>(robot.n())}}};
  for (const ComponentSpec& spec : scenario.components)
    if (is_unit_of(spec, "monitor")) request.watching.push_back(spec.name);
  LegCheck legs(scenario, motion, request, types);
  plan.notes = legs.notes();
  plan.places = legs.places();
  std::size_t number = 0;
  for (const std::vector<double>& q : wanted_postures(r, mover.variables(), robot)) {
    std::string why = beyond_limits(robot, q);
    if (why.empty()) why = legs.meets(plan.postures.empty() ? q : plan.postures.back(), q);
    if (const std::string which = "posture " + std::to_string(++number); !why.empty())
      plan.skipped.push_back(which + " is left out: on the way there " + why);
    else
      plan.postures.push_back(q);
  }
  if (plan.postures.empty()) throw Error("no posture is clear", plan.skipped.empty() ? "there are none" : plan.skipped.front());

  const std::vector<trajectory::Axis> axes = trajectory::axes_of(robot);
  const double tick = scenario.tick.seconds();
  const auto on_tick = [tick](double t) { return std::ceil(t / tick - 1e-9) * tick; };
  const double settle = on_tick(r.settle), rest = settle + std::max(5 * tick, on_tick(0.01));
  std::erase_if(plan.scenario.events, [&](const EventSpec& event) { return event.variable == trigger; });
  std::string points, dwell;
  double t = 0;
  const std::size_t last = std::max<std::size_t>(plan.postures.size(), 2);  // a motion has two waypoints
  for (std::size_t k = 0; k < last; ++k) {
    const std::vector<double>& q = plan.postures[std::min(k, plan.postures.size() - 1)];
    if (k > 0) t = on_tick(t + rest + trajectory::calm_duration(axes, plan.postures[k - 1], q));
    text::append(points, text::to_text(t) + ": " + text::joined(q), "; ");
    text::append(dwell, text::to_text(rest), " ");
    if (k == plan.postures.size()) break;
    const auto set = [&](double at, const char* value) {
      plan.scenario.events.push_back({scenario.start + Duration::from_seconds(at), trigger, value, {}, "scan"});
    };
    if (k > 0) set(t, "false");
    set(t + settle, "true");
  }
  std::ranges::stable_sort(plan.scenario.events, {}, [](const EventSpec& event) { return event.time.ns; });
  std::vector<ParameterValue>& values = std::ranges::find(plan.scenario.components, motion, &ComponentSpec::name)->start_values;
  const std::string start = text::to_text(scenario.start.seconds());
  for (const auto& [name, value] : std::initializer_list<std::pair<const char*, std::string>>{{"passing", "rest"},
                                                                                              {"loop", "no"},
                                                                                              {"t_start", start},
                                                                                              {"time_scale", "1"},
                                                                                              {"soft_start", "0"},
                                                                                              {"soft_stop", "0"}})
    values.push_back({name, value, "", "scan"});
  set_waypoints(plan.scenario, motion + "=" + points, false, types);
  values.push_back({"waypoint_dwell", dwell, "", "scan"});
  plan.scenario.stop = scenario.start + Duration::from_seconds(t + rest);
  Member through = member_of(plan.scenario, motion, types, model_folders(scenario.folder));
  through.instance.unit->initialise(scenario.start);
  if (std::abs(through.variables().at("duration").reals()[0] - (t + rest)) > tick)
    throw Error(motion, "stretches the motion through the postures, expected limits that it keeps, or limits=warn");
  return plan;
}

namespace {

/// A text in which names of files relative to one folder are relative to another one.
std::string relocated(const std::string& given, const fs::path& from, const fs::path& to) {
  std::string all;
  for (std::size_t begin = 0; begin <= given.size();) {
    const std::size_t end = std::min(given.find_first_of(",;:|=&?", begin), given.size());
    const std::string word = given.substr(begin, end - begin);
    std::error_code none;
    const bool file = !word.empty() && fs::path(word).is_relative() && fs::is_regular_file(from / word, none);
    all += file ? fs::absolute(from / word).lexically_proximate(fs::absolute(to)).generic_string() : word;
    if (end < given.size()) all += given[end];
    begin = end + 1;
  }
  return all;
}

}  // namespace

std::string scenario_text(const Scenario& given, std::span<const UnitType> types, const fs::path& folder) {
  Scenario scenario = given;
  std::vector<Member> members = load_members(scenario, types, model_folders(scenario.folder));
  const std::vector<ResolvedConnection> links = resolve_connections(scenario, members);
  std::vector<PackedComponent> components;
  for (Member& member : members) {
    ParameterSet set{member.name(), {}, scenario.units};
    for (ParameterValue& value : member.spec.start_values) {
      if (auto* words = std::get_if<std::string>(&value.value)) *words = relocated(*words, scenario.folder, folder);
      std::erase_if(set.values, [&](const ParameterValue& earlier) { return earlier.name == value.name; });
      set.values.push_back(value);
    }
    si::define_units(set);
    std::ostringstream text;
    write_parameter_set(text, set);
    std::string source = member.spec.source;
    for (const auto& [key, value] : settings_for(scenario, member.name())) {  // a file has no defaults for all units
      const bool set_here =
          is_unit(member.spec) && ("&" + parse_unit_source(source).query).find("&" + key + "=") != std::string::npos;
      if (!set_here && has_setting(source, key, types)) source = with_setting(source, key, value);
    }
    PackedComponent one{relocated(source, scenario.folder, folder), "", !is_unit(member.spec)};
    if (!set.values.empty()) one.values = text.str().substr(text.str().find('\n') + 1);  // without the XML declaration
    for (const ParameterValue& value : set.values) one.valued.insert(value.name);
    components.push_back(std::move(one));
  }
  return to_ssd(scenario, members, links, components, false);
}

}  // namespace cotwin::master
