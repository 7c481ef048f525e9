// cotwin run: runs a scenario, a package, or one FMU with the option names of fmusim (Reference FMUs).
#include <memory>

#include "master/program/commands/run/run_arguments.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

/// Throws Error if one of the options was given: they apply only to scenarios, or only to FMUs.
void reject(const std::vector<CLI::Option*>& options, const std::string& what) {
  for (const CLI::Option* option : options) {
    if (option->count() > 0) throw Error(option->get_name(), "does not apply to " + what);
  }
}

}  // namespace

void locate(std::string& file) {
  if (!file.empty() && file != "-") file = std::filesystem::absolute(file).string();
}

void add_run(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<RunArguments>();
  RunArguments& arguments = *all;
  CLI::App* run_command = app.add_subcommand("run", "Run a scenario or an FMU");
  run_command->add_option("FILE", arguments.file, "System structure (.ssd), package (.ssp) or FMU (.fmu)")->type_name("FILE");
  run_command->add_option("--stop,--stop-time", arguments.stop, "Stop time in seconds; replaces that of the file")
      ->type_name("SECONDS");
  run_command
      ->add_option(
          "--set", arguments.set,
          "unit.variable=value, unit.variable[i]=value, unit.setting=value, or setting=value for all units; may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  run_command
      ->add_option("--out", arguments.out, "Folder for the results (default: results/<scenario> in the working directory)")
      ->type_name("FOLDER");
  run_command
      ->add_option("--record", arguments.record,
                   "Variables to record in place of the scenario's, e.g. 'drive.*'; may be repeated")
      ->type_name("GLOB")
      ->allow_extra_args(false);
  run_command->add_flag("--joint-names", arguments.joint_names,
                        "Columns of signals.csv have the names of joints in place of their numbers: drive.q[elbow]");
  run_command->add_flag("--no-view-data", arguments.no_view_data,
                        "No view.bin: pages show only what is recorded by choice (default: what they need, 60 times a second)");
  run_command
      ->add_option(
          "--waypoints", arguments.waypoints,
          "Waypoints of the desired joint motion in place of the scenario's: a CSV file (t, q1 …, dwell), or points such as "
          "'0 0.3 0; 0.5 1 0' in rad and m, with times '0: 0 0.3 0; 2: 0.5 1 0'. The drives begin at the first one. With "
          "several motions MOTION=FILE; may be repeated")
      ->type_name("FILE|POINTS")
      ->allow_extra_args(false);
  run_command
      ->add_option("--event", arguments.events,
                   "Change of a tunable or of an input without a connection, e.g. 't=2 compliance.S_a[1]=500 ramp=10 ms'; in "
                   "addition to the scenario's events; may be repeated")
      ->type_name("'t=TIME NAME=VALUE'")
      ->allow_extra_args(false);
  run_command
      ->add_option(
          "--attach", arguments.attach,
          "Mount a tool, e.g. 'gripper,parent=link_7,mass=0.8,com=0 0 0.05,inertia=1e-3 0 0 1e-3 0 1e-3@3'; the items are "
          "those of an attach event (docs/scenario.md); may be repeated")
      ->type_name("NAME,ITEM=VALUE@TIME")
      ->allow_extra_args(false);
  run_command->add_option("--detach", arguments.detach, "Remove a tool, e.g. 'gripper@5'; may be repeated")
      ->type_name("NAME@TIME")
      ->allow_extra_args(false);
  run_command
      ->add_option("--checkpoint", arguments.checkpoint,
                   "Seconds of wall time between two checkpoints, from which an interrupted run can be resumed; 0: none")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber)
      ->check(kNumber)
      ->type_name("SECONDS");
  run_command
      ->add_option("--resume", arguments.resume,
                   "Resume the interrupted run with results in FOLDER from its last checkpoint (without FILE)")
      ->type_name("FOLDER");
  run_command->add_flag("--overwrite", arguments.overwrite,
                        "Overwrite earlier results (default: they are moved to earlier-1, earlier-2 … in the folder)");
  run_command->add_option("--threads", arguments.threads, "Largest number of threads (default: chosen automatically)")
      ->check(CLI::Range(1, 255))
      ->type_name("N");
  run_command
      ->add_option_function<std::string>(
          "--coupling", [all](const std::string& word) { all->coupling = text::choose("--coupling", word, kCouplingWords); },
          "How units that depend on one another step: implicit, explicit, or auto; replaces that of the scenario")
      ->check(CLI::IsMember({"auto", "explicit", "implicit"}))
      ->type_name("WORD");
  run_command->add_option("--json", arguments.json, "Write the summary as JSON, to stdout with -")->type_name("FILE|-");
  run_command->add_flag("--real-time", arguments.real_time, "Synchronise simulated time with wall time (--clock wall)");
  run_command
      ->add_option("--clock", arguments.clock,
                   "When ticks begin: free, wall, arrivals (of a robot's or bus's packets) or locked (to its clock), with the "
                   "component after a colon if there are several; replaces that of the scenario")
      ->type_name("WORD[:UNIT]");
  run_command
      ->add_option_function<std::string>(
          "--overrun", [all](const std::string& word) { all->overrun = text::choose("--overrun", word, kOverrunWords); },
          "Late ticks: catch_up, skip or stop; replaces that of the scenario")
      ->check(CLI::IsMember({"catch_up", "skip", "stop"}))
      ->type_name("WORD");
  run_command->add_option("--priority", arguments.priority, "SCHED_FIFO priority of the loop, with locked memory; 0: none")
      ->check(CLI::Range(0, 99))
      ->type_name("N");
  run_command->add_option("--cpu", arguments.cpus, "CPUs of the loop and of its further threads, e.g. 2,3")->type_name("LIST");
  run_command
      ->add_flag(
          "--view", arguments.view,
          "Show the run in a browser while it goes on, at http://localhost:8081/ or, as --view=PORT, at another port (0: a "
          "free one); by the wall clock unless another one is chosen; the page can pause the run and set values")
      ->option_text("[=PORT]");
  run_command
      ->add_option("--local-writes", arguments.local_writes,
                   "Who on this machine may change the run by --view; owner: who runs it, and root; all: all users (default: "
                   "owner; the others may watch)")
      ->check(CLI::IsMember({"owner", "all"}))
      ->needs("--view")
      ->type_name("WHO");
  run_command->add_flag("--quiet", arguments.quiet, "No progress bar and no table");
  run_command->add_flag("--report", arguments.report, "Write report.html beside the results, as cotwin report does");

  FmuRunOptions& fmu = arguments.fmu;
  const std::string group = "For an FMU (as in fmusim)";
  std::vector<CLI::Option*> of_fmu;
  const auto add = [&](CLI::Option* option, const char* type) {
    of_fmu.push_back(option->group(group)->type_name(type));
    return option;
  };
  add(run_command->add_option("--start-time", fmu.start, "Start time in seconds"), "SECONDS");
  add(run_command->add_option("--output-interval", fmu.interval, "Communication step and interval of the output"), "SECONDS");
  add(run_command->add_option("--start-value", fmu.start_values, "Start value, in the FMU's own unit of measure; repeatable"),
      "NAME VALUE");
  add(run_command->add_option("--input-file", fmu.input_file,
                              "CSV, time first: continuous reals are interpolated linearly, others held from row to row"),
      "FILE");
  add(run_command->add_option("--output-file", fmu.output_file, "CSV for the results (default: <FMU>_out.csv)"), "FILE");
  add(run_command->add_option("--output-variable", fmu.output_variables, "Record only this variable; repeatable"), "NAME")
      ->allow_extra_args(false);
  add(run_command->add_option("--tolerance", fmu.tolerance, "Relative tolerance passed to the FMU"), "NUMBER");
  add(run_command
          ->add_option_function<std::string>(
              "--interface-type",
              [&fmu](const std::string& word) {
                fmu.interface_type = text::choose("--interface-type", word, fmu::kInterfaceWords);
              },
              "cs or me; default: cs if the FMU has it")
          ->check(CLI::IsMember({"cs", "me"})),
      "TYPE");
  add(run_command
          ->add_option_function<std::string>(
              "--process",
              [&fmu](const std::string& word) { fmu.process = text::choose("--process", word, fmu::kProcessWords); },
              "own: a crash, hang or exit becomes an error (docs/scenario.md); shared: with cotwin; default: auto")
          ->check(CLI::IsMember({"auto", "own", "shared"})),
      "WHERE");
  add(run_command->add_option("--timeout", fmu.timeout,
                              "Time limit of one call in its own process; ten times that for initialisation (default: 60)"),
      "SECONDS");
  add(run_command->add_option("--memory", fmu.memory, "Memory limit of its own process (default: 4e9)"), "BYTES");
  of_fmu.push_back(run_command->add_flag("--set-stop-time", fmu.set_stop_time, "Pass the stop time to the FMU")->group(group));

  std::vector<CLI::Option*> of_scenario;
  for (const char* name :
       {"--set",    "--out",      "--record",     "--joint-names", "--no-view-data", "--waypoints", "--event",
        "--attach", "--detach",   "--threads",    "--real-time",   "--clock",        "--overrun",   "--priority",
        "--cpu",    "--coupling", "--checkpoint", "--overwrite",   "--report",       "--view",      "--local-writes"}) {
    of_scenario.push_back(run_command->get_option(name));
  }
  std::vector<CLI::Option*> decided = of_fmu;
  for (const char* name :
       {"FILE",        "--stop",  "--set",      "--out",       "--record",    "--joint-names", "--no-view-data",
        "--waypoints", "--event", "--attach",   "--detach",    "--real-time", "--clock",       "--overrun",
        "--priority",  "--cpu",   "--coupling", "--overwrite", "--view",      "--local-writes"})
    decided.push_back(run_command->get_option(name));
  run_command->callback([all, of_fmu, of_scenario, decided, &chosen] {
    chosen = [all, of_fmu, of_scenario, decided] {
      if (!all->resume.empty()) {
        for (const CLI::Option* option : decided) {
          if (option->count() > 0)
            throw Error(
                option->get_name(),
                "cannot be changed when a run is resumed, expected only --threads, --json, --checkpoint, --report or --quiet");
        }
        return run_scenario(*all);
      }
      if (all->file.empty()) throw Error("FILE", "is missing, expected a scenario, a package or an FMU");
      if (!is_fmu(all->file)) {
        reject(of_fmu, "a scenario, expected an FMU (.fmu)");
        return run_scenario(*all);
      }
      reject(of_scenario, "an FMU, expected a scenario (.ssd, .ssp)");
      all->fmu.file = all->file;
      all->fmu.stop = all->stop;
      return run_fmu(*all);
    };
  });
}

}  // namespace cotwin::master
