// cotwin tune: identifies a physically consistent model of a robot and its drives from measured logs.

#include <algorithm>
#include <array>
#include <iostream>
#include <memory>
#include <optional>
#include <thread>

#include "master/program/commands/commands.h"
#include "master/program/interrupt.h"
#include "master/program/log_options.h"
#include "master/program/progress_line.h"
#include "master/results/results_folder.h"
#include "master/run/identity.h"
#include "master/workflows/tuning/cross_validation.h"
#include "master/workflows/tuning/report.h"
#include "master/workflows/tuning/tuning.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct TuneArguments {
  tuning::Settings settings;
  std::string robot;
  fs::path out, resume;
  std::string method = "swarm", friction = "sigmoid", torques = "motor";
  LogOptions log;
  std::optional<int> rounds, threads;
  bool accept_result = false, no_offset = false, no_viscous = false, quiet = false, cross_validate = false, overwrite = false;
  double checkpoint = 10;  // s
  bool check = false;
  std::string json;
};

/// The result files of a tuning.
const std::array<std::string, 8> kResults = {"robot.urdf",   "drive_train.ssv", "twin.ssd",    "torques.csv",
                                             "figures.json", "report.md",       "report.html", "resume.json"};

tuning::Settings settings_of(const TuneArguments& a) {
  tuning::Settings s = a.settings;
  s.robot = urdf_of(a.robot);
  s.method = tuning::method_of(a.method);
  s.model.friction = identification::friction_law(a.friction);
  s.model.motor_inertia = text::choose<bool>("--torques", a.torques, {{"motor", true}, {"joint", false}});
  s.model.offset = !a.no_offset;
  s.model.viscous = !a.no_viscous;
  a.log.apply(s);
  if (a.rounds) s.rounds = *a.rounds;
  tuning::check(s);
  return s;
}

/// Tells what the log tells before a solution.
int check_command(const TuneArguments& arguments, const tuning::Settings& settings, const tuning::Data& data) {
  const tuning::LogCheck check = tuning::check_log(settings, data);
  const bool prints = arguments.json == "-";
  if (prints) std::cout << tuning::check_json(data, check);
  if (!arguments.json.empty() && !prints) write_file(arguments.json, tuning::check_json(data, check));
  if (!prints && !arguments.quiet) tuning::write_check(std::cout, data, check);
  for (const std::string& warning : check.warnings) std::cerr << "cotwin: warning: " << warning << '\n';
  for (const std::string& sentence : check.evidence) std::cerr << "cotwin: " << sentence << '\n';
  if (!prints && check.evidence.empty()) std::cout << "nothing against this log\n";
  return check.evidence.empty() || arguments.accept_result ? kExitDone : kExitRunFailed;
}

int tune_command(const TuneArguments& arguments, const std::vector<std::string>& given) {
  tuning::Run run;
  const Build build = this_build();
  run.program = build.version + " (build " + hexadecimal(build.file) + ", " + build.cpu + ")";
  run.checkpoint = arguments.checkpoint;
  tuning::Settings settings;
  if (!arguments.resume.empty()) {
    for (const std::string& option : given) {
      if (option != "--resume" && option != "--rounds" && option != "--threads" && option != "--out" && option != "--quiet" &&
          option != "--checkpoint" && option != "--overwrite" && option != "--accept-result")
        throw Error(option,
                    "is fixed with --resume, expected only --rounds, --threads, --out, --checkpoint, --overwrite, "
                    "--accept-result or --quiet");
    }
    run.resume = tuning::load_resume(arguments.resume / "resume.json");
    if (run.resume->program != run.program)
      throw Error((arguments.resume / "resume.json").string(),
                  "was written by cotwin " + run.resume->program + ", expected the same program, which is " + run.program);
    settings = run.resume->settings;
    if (arguments.rounds) settings.rounds = *arguments.rounds;
    tuning::check(settings);
  } else {
    if (arguments.robot.empty()) throw Error("--robot", "is missing, expected a robot's name or URDF");
    settings = settings_of(arguments);
  }
  run.out =
      !arguments.out.empty() ? arguments.out
      : !arguments.resume.empty()
          ? arguments.resume
          : fs::path("results") / file_name_of("tune_" + fs::path(settings.data.front() / "").parent_path().stem().string());
  const int cores = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  if (!arguments.json.empty() && !arguments.check) throw Error("--json", "is for --check, expected both");
  for (const auto* logs : {&settings.data, &settings.held_out})
    for (const fs::path& log : *logs)
      if (std::error_code none; fs::equivalent(log, arguments.json, none))
        throw Error("--json " + arguments.json, "is a log, expected another file");
  ResultsFolder results(run.out);
  run.threads = arguments.threads.value_or(std::min(cores, 8));

  note_signals();
  ProgressLine line(!arguments.quiet && arguments.json != "-");
  const tuning::Hooks hooks{[&](const std::string& what, double share) { line.update(what, share); },
                            [] { return stop_signal() != 0; }};
  try {
    if (arguments.cross_validate) {
      const auto is_given = [&](const char* option) { return std::find(given.begin(), given.end(), option) != given.end(); };
      settings = tuning::cross_validate(
          settings, {!is_given("--cutoff"), !is_given("--load-friction"), !is_given("--prior-weight")}, run.threads, hooks);
    }
    const tuning::Data data = tuning::load_data(settings, hooks);
    if (arguments.check) {
      line.clear();
      return check_command(arguments, settings, data);
    }
    results.open();
    if (run.out != arguments.resume && !arguments.overwrite) {
      std::vector<fs::path> inputs = {settings.robot};
      inputs.insert(inputs.end(), settings.data.begin(), settings.data.end());
      inputs.insert(inputs.end(), settings.held_out.begin(), settings.held_out.end());
      const fs::path kept = results.keep_earlier(kResults, inputs);
      line.clear();
      if (!kept.empty() && !arguments.quiet) std::cout << "earlier results: moved to " << kept.string() << '\n';
    }
    const tuning::Result result = tuning::tune(settings, run, hooks, data);
    line.clear();
    for (const std::string& warning : result.warnings) std::cerr << "cotwin: warning: " << warning << '\n';
    if (!arguments.quiet) {
      tuning::write_table(std::cout, data, result);
      std::cout << "\nresults: " << run.out.string()
                << " (report.md, robot.urdf, drive_train.ssv, torques.csv, figures.json)\n";
      if (result.evaluation.replay) std::cout << "the tuned twin: cotwin run " << (run.out / "twin.ssd").string() << '\n';
    }
    write_report_page(run.out, arguments.quiet);
    for (const std::string& sentence : result.evidence) std::cerr << "cotwin: " << sentence << '\n';
    if (!result.interrupted) {
      for (const std::string& sentence : result.verdicts) std::cerr << "cotwin: " << sentence << '\n';
      if (result.alarms.empty() || arguments.accept_result) return kExitDone;
      std::cerr << "cotwin: the log or the result is not to be trusted (--accept-result accepts it)\n";
      return kExitRunFailed;
    }
    std::cerr << "cotwin: stopped by " << name_of_signal(stop_signal());
    if (result.swarm) std::cerr << " after round " << result.swarm->progress.round;
    if (settings.method != tuning::Method::kLeastSquares)
      std::cerr << "; continue with: cotwin tune --resume " << run.out.string();
    std::cerr << '\n';
  } catch (const tuning::Stopped&) {
    line.clear();
    std::cerr << "cotwin: stopped by " << name_of_signal(stop_signal()) << " before the search; nothing was written\n";
  }
  return kExitSignalled + stop_signal();
}

}  // namespace

void add_tune(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<TuneArguments>();
  TuneArguments& a = *all;
  tuning::Settings& s = a.settings;
  CLI::App* command = app.add_subcommand("tune", "Identify a robot's dynamics, friction and motors from measured torques");
  command->add_option("--robot", a.robot, "URDF, or name of a robot in models/robots")->type_name("URDF");
  command->add_option("--lock", s.lock, "Joints that stand still: joint:position,joint:position in rad or m")
      ->type_name("JOINTS");
  command->add_option("--passive", s.passive, "Joints without a motor, whose torque is 0: joint,joint")->type_name("JOINTS");
  command
      ->add_option("--data", s.data,
                   "Log (CSV): columns t, q1 …, tau1 … in SI, behind the gears; more files are more logs of the same robot")
      ->type_name("CSV");
  command->add_option("--out", a.out, "Folder for the results (default: results/tune_<data>)")->type_name("FOLDER");
  command->add_option("--split", s.split, "First share of the data, for training; the rest is held out")
      ->capture_default_str()
      ->type_name("SHARE");
  command->add_option("--held-out", s.held_out, "Logs used only for prediction, in place of --split")->type_name("CSV");

  const std::string search = "Search";
  const auto in = [](const std::string& group, CLI::Option* option, const char* type) {
    option->group(group);
    if (*type != '\0') option->type_name(type);
    return option;
  };
  in(search, command->add_option("--method", a.method, "swarm, feasible (least squares) or least-squares (not physical)"), "")
      ->capture_default_str();
  in(search, command->add_option("--friction", a.friction, "none, coulomb, sigmoid or stribeck"), "")->capture_default_str();
  in(search,
     command->add_option("--torques", a.torques,
                         "motor: measured at the motors, times the gear ratio; joint: measured behind the gears"),
     "")
      ->capture_default_str();
  in(search,
     command->add_option("--v-r", s.model.v_R, "Speed over which Coulomb friction changes sign; of slides a tenth, in m/s"),
     "RAD/S")
      ->capture_default_str();
  in(search,
     command
         ->add_option("--harmonics", s.model.harmonics,
                      "Per joint: number of harmonics of its position, for springs and counterbalances")
         ->delimiter(','),
     "N,…");
  in(search, command->add_flag("--no-offset", a.no_offset, "No constant friction torque"), "");
  in(search, command->add_flag("--load-friction", s.model.load, "Friction also depends on the gravity torque"), "");
  in(search, command->add_flag("--no-viscous", a.no_viscous, "No viscous friction"), "");
  in(search, command->add_option("--prior-weight", s.prior_weight, "Weight of the deviation from the URDF"), "W")
      ->capture_default_str();
  in(search, command->add_option("--mass-factor", s.bounds.mass_factor, "Masses within 1/X and X times the URDF's"), "X")
      ->capture_default_str();
  in(search,
     command->add_option("--stretch-factor", s.bounds.stretch_factor, "Standard deviations of the mass distribution likewise"),
     "X")
      ->capture_default_str();
  in(search, command->add_option("--shear", s.bounds.shear, "Largest shear of the mass distribution"), "X")
      ->capture_default_str();
  in(search,
     command->add_option("--shift", s.bounds.shift,
                         "Largest shift of centres of mass, in standard deviations of the URDF's body"),
     "X")
      ->capture_default_str();
  in(search,
     command->add_flag("--cross-validate", a.cross_validate,
                       "Choose --cutoff, --load-friction and --prior-weight, if not given, on the training data"),
     "");
  in(search, command->add_option("--seed", s.seed, "Seed; equal seeds give equal bits"), "N")->capture_default_str();
  in(search, command->add_option("--rounds", a.rounds, "Largest number of rounds of the swarm (default: 500)"), "N");
  in(search, command->add_option("--particles", s.particles, "Particles of the swarm"), "N")->capture_default_str();
  in(search, command->add_option("--threshold", s.threshold, "Cost at which the swarm stops"), "COST")->capture_default_str();
  in(search,
     command->add_option("--threads", a.threads, "Threads; the result does not depend on them")->check(CLI::Range(1, 255)),
     "N");
  in(search,
     command
         ->add_option(
             "--checkpoint", a.checkpoint,
             "Seconds between two writes of resume.json, from which a killed tuning can be resumed; 0: none during the search")
         ->check(CLI::NonNegativeNumber)
         ->check(kNumber),
     "SECONDS")
      ->capture_default_str();
  in(search, command->add_option("--resume", a.resume, "Resume the stopped tuning in FOLDER"), "FOLDER");

  add_log_options(*command, a.log, s);
  command->add_flag("--check", a.check, "Only look at the log: joints, what is wrong with it, what the motion determines");
  command->add_option("--json", a.json, "Write the result of --check as JSON, to stdout with -")->type_name("FILE|-");
  command->add_flag("--accept-result", a.accept_result,
                    "Exit code 0 even if the log is found to be wrong, or torques are predicted badly");
  command->add_flag("--quiet", a.quiet, "No progress bar and no table; warnings and verdicts all the same");
  command->add_flag("--overwrite", a.overwrite,
                    "Overwrite earlier results (default: they are moved to earlier-1, earlier-2 … in the folder)");

  command->callback([all, command, &chosen] {
    chosen = [all, command] {
      std::vector<std::string> given;
      for (const CLI::Option* option : command->get_options()) {
        if (option->count() > 0) given.push_back(option->get_name());
      }
      return tune_command(*all, given);
    };
  });
}

}  // namespace cotwin::master
