#include "master/workflows/clear_of.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "master/engine/wiring/members.h"
#include "master/scenario/folders.h"
#include "master/scenery/scenery.h"
#include "models/cloud/cloud_file.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/scene/sdf/sdf.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "models/trajectory/waypoints.h"

namespace cotwin::master {

namespace fs = std::filesystem;

Surroundings surroundings(const std::vector<std::string>& names, std::optional<double> floor, std::vector<std::string>& notes) {
  Surroundings all;
  bool has_scene = false;
  for (const std::string& name : names) {
    std::error_code none;
    fs::path file = name;
    for (const char* ending : {"scene.sdf", "scene.pcd"})
      for (const fs::path& folder : model_folders({}))
        if (!fs::is_regular_file(file, none)) file = folder / "scenes" / name / ending;
    if (!fs::is_regular_file(file, none))
      throw Error("scene '" + name + "'",
                  "is neither a file nor the name of a scene, expected an SDF file or a point cloud (.pcd, .ply, .xyz, .csv)");
    const bool cloud = cloud::is_cloud(file);
    if (cloud ? !all.clouds.empty() : has_scene)
      throw Error("scene '" + name + "'", std::string("is the second ") + (cloud ? "cloud" : "scene") + ", expected one");
    if (!cloud) {
      all.scene = scene::load(file, &notes);
      has_scene = true;
      continue;
    }
    const cloud::Obstacle read = cloud::load_obstacle(file);
    for (const std::string& remark : read.remarks) notes.push_back(file.string() + ": " + remark);
    notes.push_back("the " + text::counted(std::ssize(read.points->cloud().points), "point") + " of " +
                    file.filename().string() + " have balls of " + text::to_text(read.touching(), 3) + " m");
    all.clouds.push_back({.points = read.points, .radius = read.touching(), .X_WC = {}});
  }
  if (floor) {
    scene::Body plane;
    plane.name = "floor";
    plane.motion = scene::Motion::kStatic;
    plane.X_WB.p.z() = *floor;
    plane.shapes.resize(1);
    plane.shapes.front().type = scene::ShapeType::kPlane;
    all.scene.bodies.push_back(std::move(plane));
  }
  return all;
}

std::pair<std::string, Pose> read_base(const std::string& text, const std::string& option) {
  const std::size_t colon = text.rfind(':');
  const bool named = colon != std::string::npos;
  std::vector<double> numbers;
  for (const std::string_view word : text::split(std::string_view(text).substr(named ? colon + 1 : 0), ' '))
    if (!word.empty()) numbers.push_back(text::parse_real(word).value_or(std::numeric_limits<double>::quiet_NaN()));
  const bool finite = std::ranges::all_of(numbers, [](double x) { return std::isfinite(x); });
  if (!finite || (numbers.size() != 3 && numbers.size() != 6))
    throw Error(
        option,
        "'" + text + "', expected x y z or x y z roll pitch yaw in m and rad, after NAME: where there are several robots");
  numbers.resize(6);
  return {named ? std::string(text::trim(std::string_view(text).substr(0, colon))) : "",
          {rotation_from_rpy(numbers[3], numbers[4], numbers[5]), {numbers[0], numbers[1], numbers[2]}}};
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

using Level = fmu::Finding::Level;

/// A unit:motion of joints.
struct Mover {
  std::string name;
  double start = 0;  // s
  bool slows = false;
  std::vector<double> waypoints;  // s, from the start
  collision::Motion motion;
};

Mover mover_of(Member& member, Time begin) {
  constexpr double kLongest = 3600, kStep = 0.002;  // s
  using Loop = collision::Motion::Loop;
  const Variables& v = member.variables();
  Unit& unit = *member.instance.unit;
  Mover mover;
  mover.name = member.name();
  mover.start = v.at("t_start").reals()[0];
  mover.slows = v.find("speed") != nullptr;
  if (const Variable* times = v.find("waypoint_t")) mover.waypoints.assign(times->reals().begin(), times->reals().end());
  mover.motion.loop =
      text::choose<Loop>(mover.name + ".loop", v.at("loop").strings()[0],
                         {{"no", Loop::kNo}, {"repeat", Loop::kRepeat}, {"there_and_back", Loop::kThereAndBack}});
  if (mover.motion.loop != Loop::kNo) begin = std::min(begin, Time{} + Duration::from_seconds(mover.start));
  unit.initialise(begin);
  mover.motion.period = v.at("duration").reals()[0];
  const double end = mover.start + mover.motion.period, length = std::max(end - begin.seconds(), kStep);
  if (!(mover.motion.period > 0 && end <= kLongest))
    throw Error(mover.name, "lasts " + text::to_text(end) + " s, expected at most an hour");
  const auto steps = static_cast<std::int64_t>(std::clamp(std::ceil(length / kStep), 100.0, 1e6));
  const Duration h = Duration::from_seconds(length / static_cast<double>(steps));
  std::vector<double> t, rows;
  Time now = begin;
  for (std::int64_t k = 0; k <= steps; ++k) {
    t.push_back(now.seconds());
    for (const char* name : {"q_d", "dq_d", "ddq_d"}) {
      const auto values = v.at(name).reals();
      rows.insert(rows.end(), values.begin(), values.end());
    }
    (void)unit.step(now, h);
    now = now + h;
  }
  mover.motion.path = path_of(v.at("q_d").size(), t, rows);
  return mover;
}

/// A robot of the scenario.
struct Standing {
  const StagedRobot* robot;
  const Mover* mover = nullptr;  // one of its motions
  std::string name;
  std::string placed_by;  // "": its place is not known
  Pose X_WB;
};

bool follows(const Standing& one, const Mover& mover) {
  const std::vector<StagedTrack>& tracks = one.robot->tracks;
  return std::ranges::find(tracks, mover.name + ".q_d", &StagedTrack::signal) != tracks.end();
}

/// The robot that a motion moves, one with a place if there are several: its twins do the same. The end: none is known.
auto moved_by(const Mover& mover, std::vector<Standing>& robots) {
  const auto placed =
      std::ranges::find_if(robots, [&](const Standing& one) { return follows(one, mover) && !one.placed_by.empty(); });
  return placed != robots.end() ? placed
                                : std::ranges::find_if(robots, [&](const Standing& one) { return follows(one, mover); });
}

/// The robots of a stage, at the places of contact worlds and monitors, or those given. Those that a motion moves have its name.
std::vector<Standing> stand(const Scenery& stage, const std::vector<Mover>& movers, const std::vector<std::string>& bases) {
  std::vector<Standing> robots;
  for (const StagedRobot& robot : stage.robots) {
    Standing one{&robot, nullptr, robot.prefixes.front().substr(0, robot.prefixes.front().rfind('.')), "", {}};
    if (robot.in_world) {
      one.X_WB = robot.base.X_WB;
      one.name = one.placed_by = robot.base.p.substr(0, robot.base.p.rfind('.'));
    }
    const auto mover = std::ranges::find_if(movers, [&](const Mover& candidate) { return follows(one, candidate); });
    if (mover != movers.end()) one.mover = &*mover;
    robots.push_back(std::move(one));
  }
  for (const Mover& mover : movers)
    if (const auto own = moved_by(mover, robots); own != robots.end() && own->mover == &mover) own->name = mover.name;
  std::vector<std::string> names;
  for (const Standing& one : robots) names.push_back(one.name);
  for (const std::string& text : bases) {
    const auto [name, X_WB] = read_base(text);
    const auto found = name.empty() && robots.size() == 1 ? robots.begin() : std::ranges::find(robots, name, &Standing::name);
    if (found == robots.end())
      throw Error("--base", "'" + text + "' names no robot, expected NAME: of " + text::joined(names) + " before the numbers");
    found->X_WB = X_WB;
    found->placed_by = "--base";
  }
  return robots;
}

/// Whether a robot may be the twin of another one, which it does not meet: both have the same motion, or stand at the same place in different
/// components.
bool is_twin(const Standing& one, const Standing& other) {
  const std::vector<std::string>&components = one.robot->components, &others = other.robot->components;
  const bool together = std::ranges::find_first_of(components, others) != components.end();
  const bool same_place = one.X_WB == other.X_WB && !one.placed_by.empty() && !other.placed_by.empty();
  return (one.mover != nullptr && one.mover == other.mover) || (same_place && !together);
}

collision::Stand stand_of(const Standing& one, const Scenery& stage, const std::string& name, std::vector<std::string>& notes) {
  const StagedModel& model = stage.models[one.robot->model];
  collision::Stand stand{{name, *model.model, scene::hulls_of_urdf(model.urdf, *model.model)}, one.X_WB};
  for (const StagedTool& tool : one.robot->tools) {
    stand.tools.push_back({tool.name, tool.body, {}, tool.from, tool.until.value_or(scene::kInfinity)});
    if (!tool.urdf.empty()) stand.tools.back().shapes = scene::shapes_of_tool(tool.urdf, tool.X_BA, &notes);
  }
  return stand;
}

/// " at 1.2 s, between waypoints 1 and 2"
std::string time_of(double t, const Mover& mover) {
  const auto leg = std::ranges::upper_bound(mover.waypoints, t - mover.start);
  std::string when = " at " + text::to_text(t, 4) + " s";
  if (mover.waypoints.size() > 1 && leg != mover.waypoints.begin() && leg != mover.waypoints.end())
    when += ", between waypoints " + std::to_string(leg - mover.waypoints.begin()) + " and " +
            std::to_string(leg - mover.waypoints.begin() + 1);
  return when;
}

/// What one motion comes near to, and what that rests on. The robots' motions go on until `until`.
std::vector<fmu::Finding> judge(const Mover& mover, std::vector<Standing>& robots, const Scenery& stage,
                                const Surroundings& around, double until) {
  std::vector<fmu::Finding> findings;
  const auto note = [&](const std::string& what) { findings.push_back({Level::kNote, mover.name + ": " + what}); };
  const auto own = moved_by(mover, robots);
  if (own == robots.end() || stage.models[own->robot->model].urdf.empty()) {
    note("not checked for collisions, because its robot is not known");
    return findings;
  }
  std::vector<std::string> notes;
  std::vector<collision::Stand> stands{stand_of(*own, stage, "", notes)};
  std::vector<collision::Motion> motions{mover.motion};
  std::string resting, unknown, bare;
  bool slows = mover.slows;
  for (const Standing& other : robots) {
    if (&other == &*own || is_twin(*own, other) || stage.models[other.robot->model].urdf.empty()) continue;
    collision::Stand there = stand_of(other, stage, other.name, notes);
    if (own->placed_by.empty() || other.placed_by.empty()) {
      text::append(unknown, other.name);
    } else if (std::ranges::all_of(there.robot.shapes, &std::vector<scene::Shape>::empty)) {
      text::append(bare, other.name);
    } else {
      stands.push_back(std::move(there));
      motions.push_back(other.mover != nullptr ? other.mover->motion : collision::Motion{{}, other.robot->q0});
      if (other.mover == nullptr) text::append(resting, other.name);
      slows = slows || (other.mover != nullptr && other.mover->slows);
    }
  }
  collision::Checker checker(around.scene, std::move(stands), {0, true, {}}, around.clouds);
  const collision::Verdict verdict = checker.check(motions, until);
  const collision::Nearest& at = verdict.nearest;
  if (!verdict.clear)
    findings.push_back({Level::kError, mover.name + ": " + at.link + " meets " + at.other + time_of(at.t, mover)});
  else if (std::isfinite(at.d))
    note("clear; nearest: " + at.link + ", " + text::to_text(at.d, 3) + " m from " + at.other + time_of(at.t, mover));
  else
    note("clear; there is nothing to meet");
  notes.insert(notes.end(), checker.notes().begin(), checker.notes().end());
  for (const std::string& what : notes) note(what);
  if (!resting.empty()) note("no motion of joints is known of " + resting + ", taken to rest at the start");
  if (!unknown.empty()) note("not checked against " + unknown + ", because no places are given (--base 'NAME: x y z')");
  if (!bare.empty()) note("not checked against " + bare + ", because there are no shapes");
  if (motions.size() > 1 && slows) note("checked at the planned times; where a motion is slowed, robots meet elsewhere");
  return findings;
}

}  // namespace

LegCheck::LegCheck(const Scenario& scenario, const std::string& motion, const Surroundings& around,
                   std::span<const UnitType> types) {
  const std::vector<fs::path> folders = model_folders(scenario.folder);
  Recorded signals;
  fmu::FmuStore fmus;
  const auto spec = std::ranges::find(scenario.components, motion, &ComponentSpec::name);
  const std::size_t n = load_member(*spec, scenario, types, folders, fmus).variables().at("q_d").size();
  signals.signals.push_back({motion + ".q_d", "", 0, n});
  signals.columns.resize(n);
  const Scenery stage = scenery_of(scenario, signals, types, folders);
  const std::vector<Mover> movers{{motion, 0, false, {}, {}}};
  std::vector<Standing> robots = stand(stage, movers, {});
  const auto own = moved_by(movers.front(), robots);
  if (own == robots.end()) throw Error(motion, "moves no robot that is known");
  std::vector<collision::Stand> stands{stand_of(*own, stage, "", notes_)};
  motions_.emplace_back();
  for (const Standing& other : robots) {
    if (&other == &*own || is_twin(*own, other) || other.placed_by.empty()) continue;
    stands.push_back(stand_of(other, stage, other.name, notes_));
    motions_.push_back({{}, other.robot->q0});
    notes_.push_back(other.name + " is taken to rest where it starts");
  }
  for (collision::Stand& stand : stands)
    for (collision::Tool& tool : stand.tools) tool.from = -scene::kInfinity, tool.until = scene::kInfinity;
  checker_.emplace(around.scene, std::move(stands), collision::Options{0, true, {}}, around.clouds);
  notes_.insert(notes_.end(), checker_->notes().begin(), checker_->notes().end());
}

std::string LegCheck::meets(std::span<const double> from, std::span<const double> to) {
  trajectory::Waypoints leg{from.size(), {0, 1}, {from.begin(), from.end()}, {}, {}};
  leg.q.insert(leg.q.end(), to.begin(), to.end());
  motions_.front().path = trajectory::make_path(leg, trajectory::Passing::kRest);
  const collision::Verdict verdict = checker_->check(motions_, 1);
  return verdict.clear ? "" : verdict.nearest.link + " meets " + verdict.nearest.other;
}

std::vector<fmu::Finding> check_clear(const fs::path& file, std::span<const UnitType> types,
                                      const std::vector<std::string>& names, const std::vector<std::string>& bases) {
  constexpr double kLongest = 3600;  // s
  const Scenario scenario = load_scenario(file);
  const std::vector<fs::path> folders = model_folders(file.parent_path());
  std::vector<std::string> notes;
  const Surroundings around = surroundings(names, {}, notes);
  fmu::FmuStore fmus;
  std::vector<Mover> movers;
  Recorded signals;  // the places of robots are those that the page has
  std::string floating;
  bool poses = false;
  for (const ComponentSpec& spec : scenario.components) {
    if (!is_unit(spec)) continue;
    if (spec.source.find("base=floating") != std::string::npos) text::append(floating, spec.name);
    if (parse_unit_source(spec.source).unit != "motion") continue;
    Member member = load_member(spec, scenario, types, folders, fmus);
    apply(start_values(scenario, member), member.variables());
    if (member.variables().find("q_d") == nullptr) {
      poses = true;
      notes.push_back(spec.name + ": not checked for collisions, because its motion is one of poses");
      continue;
    }
    movers.push_back(mover_of(member, scenario.start));
    const std::size_t n = member.variables().at("q_d").size();
    signals.signals.push_back({spec.name + ".q_d", "", signals.columns.size(), n});
    signals.columns.resize(signals.columns.size() + n);
  }
  const Scenery stage = scenery_of(scenario, signals, types, folders);
  std::vector<Standing> robots = stand(stage, movers, bases);
  std::string places;
  for (const Standing& one : robots) {
    const Eigen::Vector3d& p = one.X_WB.p;
    const std::string at = text::to_text(p.x(), 4) + " " + text::to_text(p.y(), 4) + " " + text::to_text(p.z(), 4);
    if (!one.placed_by.empty() || one.mover != nullptr)
      text::append(places,
                   one.name + " at (" + at + ") m" + (one.placed_by.empty() ? ", no place is given" : " by " + one.placed_by),
                   "; ");
  }
  if (!places.empty()) notes.push_back("bases: " + places);
  if (!floating.empty()) notes.push_back("bases that move are taken to stay where they start: " + floating);
  const double until = std::min(scenario.stop.seconds(), scenario.start.seconds() + kLongest);
  if (until < scenario.stop.seconds()) notes.push_back("motions that loop are checked for an hour");
  std::vector<fmu::Finding> findings;
  for (const std::string& what : notes) findings.push_back({Level::kNote, what});
  if (movers.empty() && !poses)
    findings.push_back({Level::kWarning, "no unit:motion of joints, so nothing was checked for collisions"});
  for (const Mover& mover : movers) std::ranges::move(judge(mover, robots, stage, around, until), std::back_inserter(findings));
  return findings;
}

}  // namespace cotwin::master
