#include "master/workflows/clear_of.h"

#include <algorithm>
#include <cmath>

#include "master/scenario/folders.h"
#include "master/workflows/waypoints.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/trajectory/waypoints.h"

namespace cotwin::master {

namespace fs = std::filesystem;

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

/// Whether a robot may be the twin of another one, which it does not meet: both have the same motion, or stand at the same place, in different
/// components.
bool are_twins(const ScenarioCell& all, std::size_t one, std::size_t other) {
  const ScenarioCell::Robot &a = all.robots[one], &b = all.robots[other];
  const collision::PlacedCell::Robot &there = all.cell.robots[one], &here = all.cell.robots[other];
  const bool same_place = there.X_WB == here.X_WB && !there.by.empty() && !here.by.empty();
  return !share_component(a, b) && (same_place || (!a.motion.empty() && a.motion == b.motion));
}

/// The cell of one robot, which comes first, with others that it may meet, whose numbers are `kept`.
struct Around {
  collision::PlacedCell cell;
  std::vector<std::size_t> kept;
  std::vector<std::string> unknown, bare;  // robots that were left out
};

Around around(const ScenarioCell& all, std::size_t own) {
  Around found{all.cell, {own}, {}, {}};
  const std::vector<collision::PlacedCell::Robot>& robots = all.cell.robots;
  for (std::size_t i = 0; i < robots.size(); ++i) {
    if (i == own || are_twins(all, own, i)) continue;
    const std::string& name = robots[i].robot.name;
    if (robots[i].robot.shapes.empty()) continue;
    if (robots[own].by.empty() || robots[i].by.empty()) {
      found.unknown.push_back(name);
    } else if (std::ranges::all_of(robots[i].robot.shapes, &std::vector<scene::Shape>::empty)) {
      found.bare.push_back(name);
    } else {
      found.kept.push_back(i);
    }
  }
  found.cell.robots.clear();
  for (const std::size_t i : found.kept) found.cell.robots.push_back(robots[i]);
  return found;
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

/// What one motion of a robot comes near to, and what that rests on. The robots' motions go on until `until`.
std::vector<fmu::Finding> judge(const Mover& mover, std::size_t own, const ScenarioCell& all, std::span<const Mover> movers,
                                double until) {
  std::vector<fmu::Finding> findings;
  const std::string& name = all.cell.robots[own].robot.name;
  const auto note = [&](const std::string& what) { findings.push_back({Level::kNote, name + ": " + what}); };
  Around around = master::around(all, own);
  std::vector<collision::Motion> motions;
  std::string resting;
  bool slows = false;
  for (const std::size_t i : around.kept) {
    const auto moves = all.robots[i].changed ? movers.end() : std::ranges::find(movers, all.robots[i].motion, &Mover::name);
    motions.push_back(moves != movers.end() ? moves->motion : collision::Motion{{}, all.cell.robots[i].q0});
    if (moves == movers.end()) text::append(resting, all.cell.robots[i].robot.name);
    slows = slows || (moves != movers.end() && moves->slows);
  }
  collision::Checker checker(std::move(around.cell), {0, true});
  const collision::Verdict verdict = checker.check(motions, until);
  const collision::Nearest& at = verdict.nearest;
  if (!verdict.clear)
    findings.push_back({Level::kError, name + ": " + at.link + " meets " + at.other + time_of(at.t, mover) +
                                           (at.d < -1e-6 ? ", overlapping by " + text::to_text(-at.d, 3) + " m" : "")});
  else if (std::isfinite(at.d))
    note("clear; nearest: " + at.link + ", " + text::to_text(at.d, 3) + " m from " + at.other + time_of(at.t, mover));
  else
    note("clear; there is nothing to meet");
  for (const std::string& what : checker.notes()) note(what);
  if (!resting.empty())
    note("no motion of joints is known of " + resting + ", taken to rest at the start and not checked itself");
  if (!around.unknown.empty())
    note("not checked against " + text::joined(around.unknown) + ", because no places are given (--base 'NAME: x y z')");
  if (!around.bare.empty()) note("not checked against " + text::joined(around.bare) + ", because there are no shapes");
  if (motions.size() > 1 && slows) note("checked at the planned times; where a motion is slowed, robots meet elsewhere");
  return findings;
}

}  // namespace

LegCheck::LegCheck(const Scenario& scenario, const std::string& motion, const CellRequest& request,
                   std::span<const UnitType> types) {
  const ScenarioCell all = cell_of(scenario, request, types);
  const auto own = std::ranges::find(all.cell.robots, motion, [](const auto& one) { return one.robot.name; });
  if (own == all.cell.robots.end()) throw Error(motion, "moves no robot that is known");
  Around around = master::around(all, static_cast<std::size_t>(own - all.cell.robots.begin()));
  places_ = collision::places(around.cell);
  notes_ = all.notes;
  notes_.insert(notes_.end(), all.differing.begin(), all.differing.end());
  for (collision::PlacedCell::Robot& robot : around.cell.robots) {
    motions_.push_back({{}, robot.q0});
    if (motions_.size() > 1) notes_.push_back(robot.robot.name + " is taken to rest where it starts");
    for (collision::Tool& tool : robot.tools) tool.from = -scene::kInfinity, tool.until = scene::kInfinity;
  }
  checker_.emplace(std::move(around.cell), collision::Options{0, true});
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
  const std::vector<fs::path> folders = model_folders(scenario.folder);
  std::vector<fmu::Finding> findings;
  const auto note = [&](const std::string& what) { findings.push_back({Level::kNote, what}); };
  std::vector<Mover> movers;
  CellRequest request{.names = names, .bases = bases};
  bool poses = false;
  for (const ComponentSpec& spec : scenario.components) {
    if (!is_unit_of(spec, "motion")) continue;
    Member member = member_of(scenario, spec.name, types, folders);
    if (member.variables().find("q_d") == nullptr) {
      poses = true;
      note(spec.name + ": not checked for collisions, because its motion is one of poses");
      continue;
    }
    movers.push_back(mover_of(member, scenario.start));
    request.motions.emplace_back(spec.name, member.variables().at("q_d").size());
  }
  const ScenarioCell all = cell_of(scenario, request, types);
  for (const std::string& what : all.notes) note(what);
  for (const std::string& what : all.differing) findings.push_back({Level::kWarning, what});
  constexpr std::size_t kMost = 30;
  const std::vector<collision::Place> all_places = collision::places(all.cell);
  std::string places;
  for (std::size_t k = 0; k < std::min(kMost, all_places.size()); ++k)
    text::append(places, collision::text_of(all_places[k]), "; ");
  if (all_places.size() > kMost) places += "; and " + std::to_string(all_places.size() - kMost) + " more";
  if (!places.empty()) note("places: " + places);
  const double until = std::min(scenario.stop.seconds(), scenario.start.seconds() + kLongest);
  if (until < scenario.stop.seconds()) note("motions that loop are checked for an hour");
  if (movers.empty() && !poses)
    findings.push_back({Level::kWarning, "no unit:motion of joints, so nothing was checked for collisions"});
  for (const Mover& mover : movers) {
    std::vector<std::size_t> moved, judged;  // the one with its name first
    for (std::size_t i = 0; i < all.robots.size(); ++i)
      if (all.robots[i].motion == mover.name && !all.robots[i].changed && !all.cell.robots[i].robot.shapes.empty())
        moved.push_back(i);
    std::ranges::stable_sort(moved, {}, [&](std::size_t i) { return all.cell.robots[i].robot.name != mover.name; });
    for (const std::size_t i : moved) {
      if (std::ranges::any_of(judged, [&](std::size_t other) { return are_twins(all, i, other); })) continue;
      judged.push_back(i);
      std::ranges::move(judge(mover, i, all, movers, until), std::back_inserter(findings));
    }
    if (judged.empty()) note(mover.name + ": not checked for collisions, because its robot is not known");
  }
  return findings;
}

}  // namespace cotwin::master
