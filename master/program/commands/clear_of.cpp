#include "master/program/commands/clear_of.h"

#include <algorithm>
#include <cmath>

#include "master/engine/wiring/members.h"
#include "master/program/commands/commands.h"
#include "master/view/stage.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/scene/sdf/sdf.h"
#include "models/scene/urdf/urdf_shapes.h"

namespace cotwin::master {

namespace fs = std::filesystem;

scene::Scene scene_with(const std::string& name, std::optional<double> floor) {
  scene::Scene scene;
  std::error_code none;
  if (!name.empty()) {
    fs::path file = name;
    for (const fs::path& folder : model_folders({}))
      if (!fs::is_regular_file(file, none)) file = folder / "scenes" / name / "scene.sdf";
    if (!fs::is_regular_file(file, none))
      throw Error("scene '" + name + "'", "is neither a file nor the name of a scene, expected an SDF file");
    scene = scene::load(file);
  }
  if (floor) {
    scene::Body plane;
    plane.name = "floor";
    plane.motion = scene::Motion::kStatic;
    plane.X_WB.p.z() = *floor;
    plane.shapes.resize(1);
    plane.shapes.front().type = scene::ShapeType::kPlane;
    scene.bodies.push_back(std::move(plane));
  }
  return scene;
}

trajectory::Path path_of(std::size_t joints, const std::vector<double>& t, const std::vector<double>& rows) {
  std::vector<double> q, dq, ddq;
  for (std::size_t i = 0; i < t.size(); ++i) {
    const double* row = &rows[3 * joints * i];
    q.insert(q.end(), row, row + joints);
    dq.insert(dq.end(), row + joints, row + 2 * joints);
    ddq.insert(ddq.end(), row + 2 * joints, row + 3 * joints);
  }
  return {joints, t, q, dq, ddq};
}

namespace {

/// The desired motion of a unit:motion, from the start to its end.
trajectory::Path motion_of(Member& member, std::vector<double>& waypoints) {
  const Variables& v = member.variables();
  Unit& unit = *member.instance.unit;
  unit.initialise(Time{});
  if (const Variable* times = v.find("waypoint_t")) waypoints.assign(times->reals().begin(), times->reals().end());
  const double duration = v.at("duration").reals()[0];
  const double end = v.at("t_start").reals()[0] + duration;
  if (!(duration > 0 && end <= 3600))
    throw Error(member.name(), "lasts " + text::to_text(end) + " s, expected at most an hour");
  const auto steps = static_cast<std::int64_t>(std::clamp(std::ceil(end / 0.002), 100.0, 1e6));
  const Duration h = Duration::from_seconds(end / static_cast<double>(steps));
  std::vector<double> t, rows;
  Time now{};
  for (std::int64_t k = 0; k <= steps; ++k) {
    t.push_back(now.seconds());
    for (const char* name : {"q_d", "dq_d", "ddq_d"}) {
      const auto values = v.at(name).reals();
      rows.insert(rows.end(), values.begin(), values.end());
    }
    (void)unit.step(now, h);
    now = now + h;
  }
  return path_of(v.at("q_d").size(), t, rows);
}

}  // namespace

std::vector<fmu::Finding> check_clear(const fs::path& file, const std::string& name) {
  using Level = fmu::Finding::Level;
  const Scenario scenario = load_scenario(file);
  const std::vector<fs::path> folders = model_folders(file.parent_path());
  const scene::Scene scene = scene_with(name, {});
  std::vector<fmu::Finding> findings;
  fmu::FmuStore fmus;
  for (const ComponentSpec& spec : scenario.components) {
    if (!is_unit(spec) || parse_unit_source(spec.source).unit != "motion") continue;
    Member member = load_member(spec, scenario, units(), folders, fmus);
    apply(start_values(scenario, member), member.variables());
    if (member.variables().find("q_d") == nullptr) {
      findings.push_back({Level::kNote, spec.name + ": not checked for collisions, because its motion is one of poses"});
      continue;
    }
    // The places of robots are those that the page has.
    Recorded signals;
    const std::size_t n = member.variables().at("q_d").size();
    signals.signals.push_back({spec.name + ".q_d", "", 0, n});
    signals.columns.resize(n);
    const Stage stage = stage_of(scenario, signals, units(), folders);
    const auto robot = std::ranges::find_if(stage.robots, [&](const StagedRobot& one) {
      return std::ranges::any_of(one.tracks, [&](const StagedTrack& track) { return track.signal == spec.name + ".q_d"; });
    });
    if (robot == stage.robots.end() || stage.models[robot->model].urdf.empty()) {
      findings.push_back({Level::kNote, spec.name + ": not checked for collisions, because its robot is not known"});
      continue;
    }
    const StagedModel& model = stage.models[robot->model];
    std::vector<double> waypoints;
    const clearance::Motion motion{motion_of(member, waypoints), {}};
    clearance::Stand stand{{"", *model.model, scene::hulls_of_urdf(model.urdf, *model.model)},
                           robot->in_world ? robot->base.X_WB : Pose{}};
    clearance::Checker checker(scene, {std::move(stand)}, {0, true, {}});
    const clearance::Verdict verdict = checker.check({&motion, 1});
    const clearance::Nearest& at = verdict.nearest;
    const double start = member.variables().at("t_start").reals()[0];
    const auto leg = std::ranges::upper_bound(waypoints, at.t - start);
    std::string where = " at " + text::to_text(at.t, 4) + " s";
    if (waypoints.size() > 1 && leg != waypoints.begin() && leg != waypoints.end())
      where += ", between waypoints " + std::to_string(leg - waypoints.begin()) + " and " +
               std::to_string(leg - waypoints.begin() + 1);
    if (!verdict.clear)
      findings.push_back({Level::kError, spec.name + ": " + at.link + " meets " + at.other + where});
    else if (std::isfinite(at.d))
      findings.push_back({Level::kNote, spec.name + ": clear; nearest: " + at.link + ", " + text::to_text(at.d, 3) +
                                            " m from " + at.other + where});
    else
      findings.push_back({Level::kNote, spec.name + ": clear; there is nothing to meet"});
    for (const std::string& note : checker.notes()) findings.push_back({Level::kNote, spec.name + ": " + note});
  }
  if (findings.empty())
    findings.push_back({Level::kWarning, "no unit:motion of joints, so nothing was checked for collisions"});
  return findings;
}

}  // namespace cotwin::master
