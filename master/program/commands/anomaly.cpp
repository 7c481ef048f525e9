// cotwin anomaly: whether a robot changed within a log, and whether it is the one that was tuned.
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "master/program/commands/commands.h"
#include "master/program/interrupt.h"
#include "master/program/log_options.h"
#include "master/program/progress_line.h"
#include "master/workflows/anomaly/anomaly.h"
#include "master/workflows/tuning/data.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

struct AnomalyArguments {
  AnomalySettings settings;
  LogOptions log;
  std::string robot, torques = "motor", json;
  bool quiet = false;
};

int anomaly_command(const AnomalyArguments& arguments) {
  AnomalySettings settings = arguments.settings;
  settings.log.robot = urdf_of(arguments.robot);
  settings.motor = text::choose<bool>("--torques", arguments.torques, {{"motor", true}, {"joint", false}});
  arguments.log.apply(settings.log);
  tuning::check(settings.log);
  note_signals();
  ProgressLine line(!arguments.quiet && arguments.json != "-");
  try {
    const AnomalyReport report = find_anomalies(
        settings,
        {[&](const std::string& what, double share) { line.update(what, share); }, [] { return stop_signal() != 0; }});
    line.clear();
    if (arguments.json != "-" && !arguments.quiet) write_text(std::cout, report);
    if (arguments.json == "-") std::cout << to_json(report).dump(2) << '\n';
    if (!arguments.json.empty() && arguments.json != "-") write_file(arguments.json, to_json(report).dump(2) + "\n");
    return report.something() ? kExitRunFailed : kExitDone;
  } catch (const tuning::Stopped&) {
    line.clear();
    std::cerr << "cotwin: stopped by " << name_of_signal(stop_signal()) << "; nothing was written\n";
  }
  return kExitSignalled + stop_signal();
}

}  // namespace

void add_anomaly(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<AnomalyArguments>();
  AnomalySettings& s = all->settings;
  CLI::App* command =
      app.add_subcommand("anomaly", "Find out from measured torques whether a robot has changed. Exit code 1: it has");
  command->add_option("log", s.log.data, "Log (CSV): columns t, q1 …, tau1 … in SI, behind the gears")
      ->required()
      ->type_name("LOG")
      ->expected(1);
  command
      ->add_option("--robot", all->robot,
                   "URDF of the tuned robot, beside its drive_train.ssv, or name of a robot in models/robots")
      ->required()
      ->type_name("URDF");
  command
      ->add_option("--healthy", s.healthy,
                   "At least three logs of the robot as it should be, of several days: is it another one now?")
      ->type_name("CSV");
  command->add_option("--reference", s.reference, "Log with which to compare, in place of the beginning of LOG")
      ->type_name("CSV")
      ->expected(1);
  command
      ->add_option("--baseline", s.watch.baseline,
                   "Seconds of motion at the beginning with which the rest is compared, at most 45 % of all")
      ->check(CLI::Range(5.0, 1e5))
      ->check(kNumber)
      ->capture_default_str()
      ->type_name("SECONDS");
  command
      ->add_option("--torques", all->torques,
                   "motor: measured at the motors, times the gear ratio; joint: measured behind the gears")
      ->capture_default_str();
  command->add_option("--lock", s.log.lock, "Joints that stand still: joint:position,joint:position in rad or m")
      ->type_name("JOINTS");
  command->add_option("--passive", s.log.passive, "Joints without a motor, whose torque is 0: joint,joint")
      ->type_name("JOINTS");
  command->add_option("--json", all->json, "Write the result as JSON, to stdout with -")->type_name("FILE|-");
  command->add_flag("--quiet", all->quiet, "Only the exit code, and errors");
  add_log_options(*command, all->log, s.log);
  command->get_option("--cutoff")
      ->description("Zero-phase low-pass filter in Hz (default: 10, or a fifth of the sampling rate)");
  command->callback([all, &chosen] { chosen = [all] { return anomaly_command(*all); }; });
}

}  // namespace cotwin::master
