// cotwin excite: designs a motion that excites a robot's dynamics parameters, for measurements.
#include <algorithm>
#include <cmath>
#include <functional>
#include <iostream>
#include <memory>
#include <numbers>
#include <optional>
#include <thread>

#include "master/engine/tools.h"
#include "master/program/commands/commands.h"
#include "master/program/interrupt.h"
#include "master/program/progress_line.h"
#include "master/workflows/clear_of.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/foundation/support/threads.h"
#include "models/identification/excitation/design.h"
#include "models/identification/excitation/samples.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/urdf/urdf_shapes.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct ExciteArguments {
  std::string robot, criterion = "condition";
  fs::path out;
  excitation::DesignOptions design;
  double rate = 250;  // Hz
  int periods = 1, threads = 1;
  bool quiet = false;
  std::vector<std::string> clear_of;  // scene and cloud
  std::string base;                   // as for read_base(); "": at the scene's origin
  std::vector<std::string> attach;
  std::optional<double> floor;  // m
  bool checked() const { return floor || !clear_of.empty(); }
};

std::vector<std::string> column_names(std::size_t n) {
  std::vector<std::string> names = {"t"};
  for (const char* what : {"q", "dq", "ddq"}) {
    for (std::size_t j = 0; j < n; ++j) names.push_back(what + std::to_string(j + 1));
  }
  return names;
}

void write_motion(const fs::path& place, const excitation::FourierSeries& series, double rate, int periods) {
  AtomicFile file(place);
  csv::Writer writer(file.stream(), column_names(series.joints));
  std::vector<double> row(1 + 3 * series.joints);
  excitation::for_each_sample(series, rate, periods, [&](double t, std::span<const excitation::FourierSeries::State> states) {
    row[0] = t;
    for (std::size_t j = 0; j < series.joints; ++j) {
      row[1 + j] = states[j].q;
      row[1 + series.joints + j] = states[j].dq;
      row[1 + 2 * series.joints + j] = states[j].ddq;
    }
    writer.row(row);
  });
  file.commit();
}

void write_design(std::ostream& out, const robot::RobotModel& robot, const excitation::Design& design) {
  out << robot.name << ": " << design.rank << " of " << design.base << " base parameters excited, condition number "
      << text::to_text(design.condition, 4)
      << " (columns of unit length; `cotwin tune` tells that of all unknowns, with friction and motors)\n\n";
  const auto percent = [](double share) { return share > 0 ? text::to_text(100 * share, 3) + " %" : std::string("0 %"); };
  out << "of the limits of        position  speed  acceleration  torque\n";
  for (std::size_t j = 0; j < robot.joints.size(); ++j) {
    const excitation::Margins& m = design.margins[j];
    std::string line = robot.joints[j].name;
    const auto column = [&](const std::string& cell, std::size_t end) {
      line += std::string(line.size() + cell.size() < end ? end - line.size() - cell.size() : 2, ' ') + cell;
    };
    column(percent(m.q), 32);
    column(percent(m.dq), 39);
    column(percent(m.ddq), 53);
    column(percent(m.tau), 61);
    out << line << '\n';
  }
}

/// The period of a motion; `rows` gets its samples.
trajectory::Path path_of(const excitation::FourierSeries& series, std::vector<double>& rows) {
  constexpr std::size_t kPerHarmonic = 40;
  const std::size_t count = kPerHarmonic * series.harmonics;
  std::vector<double> t;
  for (std::size_t k = 0; k <= count; ++k) {
    t.push_back(series.period * static_cast<double>(k) / static_cast<double>(count));
    const std::size_t at = rows.size();
    rows.resize(at + 3 * series.joints);
    for (std::size_t j = 0; j < series.joints; ++j) {
      const excitation::FourierSeries::State s = series.at(j, t.back());
      rows[at + j] = s.q;
      rows[at + series.joints + j] = s.dq;
      rows[at + 2 * series.joints + j] = s.ddq;
    }
  }
  return master::path_of(series.joints, t, rows);
}

/// Cuts the ranges of the joints that move a link or tool relative to what it met, on the side on which they are then, by a third of what the motion
/// uses from its middle.
void cut_ranges(const robot::RobotModel& robot, const std::vector<collision::Tool>& tools, const std::vector<double>& rows,
                const trajectory::Path& path, const collision::Nearest& met, excitation::DesignOptions& design) {
  const std::size_t n = robot.joints.size();
  std::vector<double> q(n), dq(n), ddq(n);
  path.at(met.t, q, dq, ddq);
  const auto moves = [&](std::size_t joint, const std::string& name) {
    const auto tool = std::ranges::find(tools, name, &collision::Tool::name);
    const auto body = std::ranges::find(robot.bodies, name, &robot::Body::name);
    const int link = tool != tools.end()          ? tool->link
                     : body != robot.bodies.end() ? static_cast<int>(body - robot.bodies.begin())
                                                  : -1;
    return link >= 0 && robot.moves(static_cast<int>(joint), link);
  };
  for (std::size_t j = 0; j < n; ++j) {
    if (moves(j, met.link) == moves(j, met.other)) continue;
    double low = q[j], high = q[j];
    for (std::size_t k = j; k < rows.size(); k += 3 * n) low = std::min(low, rows[k]), high = std::max(high, rows[k]);
    constexpr double kKept = 2.0 / 3;
    const double middle = (low + high) / 2;
    if (q[j] >= middle)
      design.q_max[j] = std::min(design.q_max[j], middle + kKept * (high - middle));
    else
      design.q_min[j] = std::max(design.q_min[j], middle - kKept * (middle - low));
  }
}

/// A motion that keeps clear, if one is found; tells what each search met.
std::optional<excitation::Design> design_clear(const robot::RobotModel& robot, const fs::path& urdf,
                                               const std::vector<collision::Tool>& tools, ExciteArguments& a,
                                               const std::function<excitation::Design()>& search) {
  constexpr int kMostSearches = 20;
  std::vector<std::string> notes;
  collision::PlacedCell cell = cell_of(a.clear_of, notes);
  cell.robots.push_back({{"", robot, scene::hulls_of_urdf(urdf, robot)}, {}, tools});
  if (!a.base.empty()) {
    const auto [name, X_WB] = read_base(a.base);
    if (!name.empty() && name != robot.name) throw Error("--base", "'" + a.base + "' is for another robot than " + robot.name);
    cell.robots.back().X_WB = X_WB;
  } else if (!a.clear_of.empty()) {
    notes.push_back("the robot's base is taken to be at the scene's origin; --base says otherwise");
  }
  if (a.floor) {
    scene::Body plane;
    plane.name = "floor";
    plane.motion = scene::Motion::kStatic;
    plane.X_WB.p.z() = *a.floor;
    plane.shapes.resize(1);
    plane.shapes.front().type = scene::ShapeType::kPlane;
    cell.bodies.push_back({std::move(plane)});
  }
  collision::Checker checker(std::move(cell), {0, true});
  notes.insert(notes.end(), checker.notes().begin(), checker.notes().end());
  for (const std::string& note : notes) std::cerr << "warning: " << note << '\n';
  a.design.q_min.resize(robot.joints.size(), -scene::kInfinity);
  a.design.q_max.resize(robot.joints.size(), scene::kInfinity);
  for (std::size_t j = 0; j < robot.joints.size(); ++j) {
    a.design.q_min[j] = std::max(a.design.q_min[j], robot.joints[j].q_min);
    a.design.q_max[j] = std::min(a.design.q_max[j], robot.joints[j].q_max);
  }
  collision::Nearest last;
  for (int k = 1; k <= kMostSearches; ++k) {
    excitation::Design design = search();
    if (stop_signal() != 0) return design;
    std::vector<double> rows;
    const collision::Motion motion{path_of(design.series, rows), {}};
    const collision::Verdict verdict = checker.check({&motion, 1});
    if (verdict.clear) {
      if (!a.quiet && std::isfinite(verdict.nearest.d))
        std::cout << "clear: " << verdict.nearest.link << " comes nearest, " << text::to_text(verdict.nearest.d, 3)
                  << " m from " << verdict.nearest.other << " at " << text::to_text(verdict.nearest.t, 4) << " s\n\n";
      return design;
    }
    std::cerr << "search " << k << ": " << verdict.nearest.link << " meets " << verdict.nearest.other << " at "
              << text::to_text(verdict.nearest.t, 4) << " s" << (k < kMostSearches ? "; again with smaller ranges" : "")
              << '\n';
    const collision::Nearest& met = verdict.nearest;
    constexpr double kSame = 1e-6;  // m
    if (met.t == 0 && last.t == 0 && met.link == last.link && met.other == last.other && std::abs(met.d - last.d) < kSame)
      throw Error("--clear-of", met.link + " meets " + met.other + " in every posture, expected another place of it");
    last = met;
    cut_ranges(robot, tools, rows, motion.path, met, a.design);
  }
  return {};
}

int excite(ExciteArguments& a) {
  std::vector<std::string> warnings;
  const fs::path urdf = urdf_of(a.robot);
  robot::RobotModel robot = robot::load_urdf(urdf, {robot::Unphysical::kWarn, ""}, &warnings);
  std::vector<collision::Tool> tools;
  for (const std::string& text : a.attach) {
    const ToolSpec tool = parse_tool(text);
    robot::attach(robot, attachment(tool));
    const robot::Frame& frame = robot.frame(tool.name);
    tools.push_back({tool.name, frame.body, {}});
    if (!tool.shapes.empty()) tools.back().shapes = scene::shapes_of_tool(tool.shapes, frame.X_BF, &warnings);
  }
  a.design.criterion = text::choose<excitation::Criterion>(
      "--criterion", a.criterion,
      {{"condition", excitation::Criterion::kCondition}, {"determinant", excitation::Criterion::kDeterminant}});
  excitation::check_samples("--rate", a.design.period, a.rate);
  const fs::path out = a.out.empty() ? fs::path(file_name_of("excitation_" + robot.name) + ".csv") : a.out;
  for (const std::string& warning : warnings) std::cerr << "warning: " << warning << '\n';

  note_signals();
  numerics::Threads threads(a.threads);
  ProgressLine line(!a.quiet);
  const auto search = [&] {
    excitation::Design found = excitation::design_excitation(robot, a.design, &threads, [&](int round) {
      line.update("round " + std::to_string(round), static_cast<double>(round) / a.design.rounds);
      return stop_signal() == 0;
    });
    line.clear();
    return found;
  };
  const std::optional<excitation::Design> found = a.checked() ? design_clear(robot, urdf, tools, a, search) : search();
  if (!found)
    throw Error("--clear-of",
                "no motion was found that keeps clear, expected other limits (--q-min, --q-max) or another place");
  const excitation::Design& design = *found;
  if (stop_signal() != 0) {
    std::cerr << "cotwin: stopped by " << name_of_signal(stop_signal()) << "; nothing was written\n";
    return kExitSignalled + stop_signal();
  }
  make_folder(out.parent_path());
  write_motion(out, design.series, a.rate, a.periods);
  if (!a.quiet) {
    write_design(std::cout, robot, design);
    std::cout << "\nmotion: " << out.string() << ", " << a.periods << " x " << text::to_text(a.design.period) << " s at "
              << text::to_text(a.rate) << " Hz" << (a.checked() ? "" : "; not checked for collisions") << '\n';
  }
  return kExitDone;
}

}  // namespace

void add_excite(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<ExciteArguments>();
  ExciteArguments& a = *all;
  a.threads = static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1u, 8u));
  CLI::App* command = app.add_subcommand("excite", "Design a motion that excites a robot's dynamics (Fourier series)");
  command->add_option("--robot", a.robot, "URDF, or name of a robot in models/robots")->required()->type_name("URDF");
  command->add_option("--out", a.out, "Motion (CSV): t, q1 …, dq1 …, ddq1 … (default: excitation_<robot>.csv)")
      ->type_name("CSV");
  command->add_option("--period", a.design.period, "Period in seconds")->capture_default_str()->type_name("SECONDS");
  command->add_option("--periods", a.periods, "Periods")->capture_default_str()->check(CLI::Range(1, 10000))->type_name("N");
  command->add_option("--harmonics", a.design.harmonics, "Number of harmonics of the base frequency 1/period")
      ->capture_default_str()
      ->type_name("N");
  command->add_option("--rate", a.rate, "Samples per second")->capture_default_str()->type_name("HZ");
  command->add_option("--share", a.design.share, "Share of every limit that the motion may use")
      ->capture_default_str()
      ->type_name("SHARE");
  command->add_option("--max-acceleration", a.design.ddq_max, "Acceleration limit of every joint in rad/s2")
      ->capture_default_str()
      ->type_name("RAD/S2");
  command->add_option("--max-speed", a.design.dq_max, "Further speed limit of every joint in rad/s")->type_name("RAD/S");
  command->add_option("--q-min", a.design.q_min, "Per joint: lower position limit within the URDF's limits, rad")
      ->delimiter(',')
      ->type_name("X,…");
  command->add_option("--q-max", a.design.q_max, "Per joint: upper position limit within the URDF's limits, rad")
      ->delimiter(',')
      ->type_name("X,…");
  command
      ->add_option(
          "--clear-of", a.clear_of,
          "Scene (SDF file, or name of a scene) or point cloud (.pcd, .ply, .xyz, .csv) that the motion keeps clear of, and of "
          "the robot itself: the search is repeated with smaller ranges of the joints; twice for both")
      ->allow_extra_args(false)
      ->type_name("SCENE");
  command
      ->add_option("--floor", a.floor,
                   "Height of a floor in the scene, below the robot's base, that the motion keeps clear of, m")
      ->check(kNumber)
      ->type_name("Z");
  command->add_option("--base", a.base, "Where the robot's base is in the scene, m and rad (default: at its origin)")
      ->type_name("'X Y Z [ROLL PITCH YAW]'");
  command->add_option("--attach", a.attach, "A tool that the robot carries, as in `cotwin tool attach`; may be repeated")
      ->type_name("NAME,ITEM=VALUE");
  command->add_option("--criterion", a.criterion, "condition (minimise) or determinant (maximise)")->capture_default_str();
  command->add_option("--seed", a.design.seed, "Seed; equal seeds give equal bits")->capture_default_str()->type_name("N");
  command->add_option("--rounds", a.design.rounds, "Rounds of the particle swarm")->capture_default_str()->type_name("N");
  command->add_option("--particles", a.design.particles, "Particles of the swarm")->capture_default_str()->type_name("N");
  command->add_option("--threads", a.threads, "The result is independent of it")->check(CLI::Range(1, 255))->type_name("N");
  command->add_flag("--quiet", a.quiet, "No progress bar and no table");
  command->callback([all, &chosen] { chosen = [all] { return excite(*all); }; });
}

}  // namespace cotwin::master
