// cotwin scan: a scenario with a scanner on a robot → a cloud of its cell, and what was not seen.
#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>

#include "components/services/json/clear_json.h"
#include "master/engine/wiring/members.h"
#include "master/program/commands/commands.h"
#include "master/program/interrupt.h"
#include "master/program/progress_line.h"
#include "master/workflows/clear_of.h"
#include "master/workflows/scan.h"
#include "models/cloud/cloud_file.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct ScanArguments {
  fs::path file, out;
  std::vector<std::string> set;
  std::string scanner, posture, mounting;
  ScanRequest request;
  bool quiet = false;
};

std::string millimetres(double x) { return text::to_text(1000 * x, 3) + " mm"; }

nlohmann::ordered_json json_of(const ScanPlan& plan, const ProfileTaker& taker, std::size_t points,
                               const ScanFigures& figures) {
  nlohmann::ordered_json bodies = nlohmann::ordered_json::array(), unseen = bodies;
  for (const ScanFigures::OfBody& body : figures.bodies) {
    bodies.push_back(
        {{"name", body.name}, {"seen", body.seen ? nlohmann::ordered_json(*body.seen) : nlohmann::ordered_json()}});
    if (body.seen == 0.0) unseen.push_back(body.name);
  }
  return {
      {"scenario", plan.scenario.name},
      {"postures", plan.postures.size()},
      {"left_out", plan.skipped},
      {"profiles", taker.profiles()},
      {"profiles_without_points", taker.empty_profiles()},
      {"points", points},
      {"points_of_robots", taker.own_points()},
      {"spacing_m", {{"median", figures.spacing.median}, {"most", figures.spacing.most}, {"largest", figures.spacing.largest}}},
      {"distance_from_scene_m", {{"rms", figures.rms}, {"largest", figures.largest}}},
      {"places", services::places_json(plan.places)},
      {"bodies", bodies},
      {"never_seen", unseen}};
}

void tell(const ScanPlan& plan, const ProfileTaker& taker, std::size_t points, const ScanFigures& figures) {
  std::cout << "profiles   " << taker.profiles() << " of " << plan.postures.size() << " postures";
  if (taker.empty_profiles() > 0) std::cout << ", " << taker.empty_profiles() << " of them without a point";
  std::cout << "\npoints     " << points << ", and " << taker.own_points() << " on the robot, which were left out";
  if (points > 1)
    std::cout << "; spacing: median " << millimetres(figures.spacing.median) << ", 95 % up to "
              << millimetres(figures.spacing.most);
  std::cout << '\n';
  if (!figures.bodies.empty())
    std::cout << "from scene " << millimetres(figures.rms) << " RMS, " << millimetres(figures.largest) << " at most\n";
  std::string unseen;
  for (const ScanFigures::OfBody& body : figures.bodies) {
    std::cout << "seen       " << (body.seen ? text::to_text(100 * *body.seen, 3) + " % of " : "a body without end, ")
              << body.name << '\n';
    if (body.seen == 0.0) text::append(unseen, body.name);
  }
  if (!unseen.empty()) std::cout << "never seen " << unseen << '\n';
}

int run_scan(const ScanArguments& a) {
  end_on_signals("; nothing was written\n");
  constexpr double kLongest = 3600;  // s
  if (!(a.request.settle >= 0 && a.request.settle <= kLongest))
    throw Error("--settle", text::to_text(a.request.settle) + ", expected 0 to 3600 s");
  if (!std::isfinite(a.request.step)) throw Error("--step", "expected an angle in rad, or a way in m");
  const std::optional<Pose> mounting =
      a.mounting.empty() ? std::nullopt : std::optional(read_base(a.mounting, "--mounting").second);
  Scenario scenario = load_scenario(a.file);
  for (const std::string& assignment : a.set) assign(scenario, assignment, units());
  const ScannerSite site = site_of(scenario, a.scanner, units());
  const ScanPlan plan = plan_scan(scenario, site, a.request, units());
  for (const std::string& note : plan.notes) std::cerr << "cotwin: warning: " << note << '\n';
  for (const std::string& skipped : plan.skipped) std::cerr << "cotwin: warning: " << skipped << '\n';

  const fs::path out = a.out.empty() ? fs::path("results") / file_name_of(scenario.name + "_scan") : a.out;
  MasterOptions options;
  options.types = units();
  options.folders = model_folders(scenario.folder);
  Master master(plan.scenario, std::move(options));
  for (const std::string& warning : master.warnings()) std::cerr << "cotwin: warning: " << warning << '\n';
  master.initialise();
  ProfileTaker taker(master, site, a.posture, mounting);
  note_signals();
  make_folder(out);
  write_file(out / "scan.ssd", scenario_text(plan.scenario, units(), out));
  ProgressLine line(!a.quiet);
  const std::span<double> desired = find_real_signal(master.members(), plan.motion + ".q_d", plan.motion).reals();
  std::size_t on_the_way = 0;  // profiles
  taker.take();
  for (bool on = true; on && stop_signal() == 0;) {
    const std::size_t profiles = taker.profiles();
    on = master.step_tick();
    taker.take();
    const auto rests = [](double q, double planned) { return std::abs(q - planned) < 1e-6; };
    if (taker.profiles() > profiles && !std::ranges::equal(desired, plan.postures.at(profiles), rests)) ++on_the_way;
    if (line.is_due()) line.update("scan", static_cast<double>(master.tick()) / static_cast<double>(master.ticks()));
  }
  line.clear();
  master.finish();
  for (const std::string& note : master.summary().notes)
    if (note.starts_with(site.name + ":")) std::cerr << note << '\n';
  if (on_the_way > 0)
    std::cerr << "cotwin: warning: " << text::counted(static_cast<std::int64_t>(on_the_way), "profile")
              << " on the way to a posture, because " << plan.motion << " was slowed\n";
  const int stopped = stop_signal();
  if (stopped != 0)
    std::cerr << "cotwin: stopped by " << name_of_signal(stopped) << " at " << text::to_text(master.now().seconds(), 4)
              << " s, after " << taker.profiles() << " of " << plan.postures.size() << " profiles\n";
  if (stopped != 0 && taker.points().empty()) return kExitSignalled + stopped;
  if (taker.points().empty())
    throw Error(site.name, taker.own_points() > 0 ? "met only the robot itself, so there is no cloud"
                                                  : "met nothing, so there is no cloud");
  cloud::Cloud cloud = cloud::make_cloud(taker.points());
  const std::size_t points = cloud.points.size();
  {
    AtomicFile file(out / "cloud.pcd");
    cloud::write_cloud(file.stream(), cloud, cloud::Format::kPcd);
    file.commit();
  }
  const ScanFigures figures = judge_scan(std::make_shared<const cloud::Tree>(std::move(cloud)), site.cell.scene);
  write_file(out / "summary.json", json_of(plan, taker, points, figures).dump(2) + "\n");
  if (!a.quiet) {
    tell(plan, taker, points, figures);
    std::cout << "written    " << (out / "cloud.pcd").string() << ", summary.json and scan.ssd beside it\n";
  }
  return stopped != 0 ? kExitSignalled + stopped : kExitDone;
}

}  // namespace

void add_scan(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<ScanArguments>();
  ScanRequest& request = all->request;
  CLI::App* command = app.add_subcommand(
      "scan", "Scan the cell of a scenario with a unit:scanner on a robot: a point cloud, and what was not seen");
  command->add_option("SCENARIO", all->file, "Scenario (.ssd) whose unit:motion moves the robot with the scanner")
      ->required()
      ->type_name("FILE");
  command->add_option("--scanner", all->scanner, "Component with the scanner, where there are several")->type_name("NAME");
  command->add_option("--at", request.at, "First posture, rad or m; without it where the motion begins")
      ->delimiter(',')
      ->type_name("Q1,Q2,…");
  command->add_option("--step", request.step, "From one posture to the next, of the last joint, rad or m")
      ->type_name("RAD")
      ->capture_default_str();
  command->add_option("--count", request.count, "Number of postures")
      ->type_name("N")
      ->check(CLI::Range(1, 100'000))
      ->capture_default_str();
  command
      ->add_option("--postures", request.postures,
                   "In place of these: waypoints (CSV, as for a motion), whose times do not count")
      ->type_name("FILE")
      ->excludes("--at")
      ->check(CLI::ExistingFile);
  command->add_option("--settle", request.settle, "Rest in a posture before its profile, s")
      ->type_name("S")
      ->capture_default_str();
  command
      ->add_option("--posture", all->posture,
                   "Signal by which points are placed, as a controller knows the joints: drive.theta_over_gear; without it "
                   "where the links are")
      ->type_name("SIGNAL");
  command
      ->add_option("--mounting", all->mounting,
                   "The scanner in its frame by which points are placed, m and rad; without it where it is")
      ->type_name("'X Y Z [ROLL PITCH YAW]'");
  command
      ->add_option(
          "--clear-of", request.clear_of,
          "A scene, point cloud or component of whose things the robot keeps clear, beside what scanner and monitors watch")
      ->type_name("NAME")
      ->allow_extra_args(false);
  command->add_option("--set", all->set, "As for cotwin run")->type_name("NAME=VALUE")->allow_extra_args(false);
  command->add_option("--out", all->out, "Folder for cloud.pcd, summary.json and scan.ssd, the scenario that scans")
      ->type_name("FOLDER");
  command->add_flag("--quiet", all->quiet, "Print errors and warnings only");
  add_units_option(*command);
  command->callback([all, &chosen] { chosen = [all] { return run_scan(*all); }; });
}

}  // namespace cotwin::master
