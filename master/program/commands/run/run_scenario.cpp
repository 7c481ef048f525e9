// A run of the program: a scenario or package with its results folder, checkpoints and page, or one FMU.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include "master/engine/wiring/members.h"
#include "master/program/browser.h"
#include "master/program/commands/run/run_arguments.h"
#include "master/program/interrupt.h"
#include "master/program/progress_line.h"
#include "master/program/view_server.h"
#include "master/program/watch.h"
#include "master/results/abandoned.h"
#include "master/results/results_folder.h"
#include "master/results/run_record.h"
#include "master/results/summary.h"
#include "master/run/checkpoint.h"
#include "master/run/identity.h"
#include "master/run/master.h"
#include "master/scenario/event_text.h"
#include "master/view/live_page.h"
#include "master/workflows/fmu_run.h"
#include "master/workflows/waypoints.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/changes/history.h"
#include "models/robot/kernels/kernels.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

/// How far the run is.
class Progress {
 public:
  Progress(const Master& master, bool wanted) : master_(master), line_(wanted) {}
  void update() {
    if (!line_.is_due()) return;
    const auto wall = Clock::now() - begin_;
    if (wall < std::chrono::milliseconds(100)) return;  // short runs have no line
    const double speed = (master_.now() - begin_time_).seconds() / std::chrono::duration<double>(wall).count();
    line_.update(text::to_text((master_.now() - master_.scenario().start).seconds(), 4) + " s, " + text::to_text(speed, 3) +
                     " times real time",
                 static_cast<double>(master_.tick()) / static_cast<double>(master_.ticks()));
  }

 private:
  using Clock = std::chrono::steady_clock;

  const Master& master_;
  ProgressLine line_;
  Clock::time_point begin_ = Clock::now();
  Time begin_time_ = master_.now();  // not the start if the run is resumed
};

void save_json(const fs::path& file, const Summary& summary, const Outcome& outcome) {
  std::ostringstream out;
  write_json(out, summary, outcome);
  write_file(file, out.str());
}

void read_clock(const RunArguments& arguments, ClockSpec& clock) {
  if (arguments.real_time && !arguments.clock.empty())
    throw Error("--real-time", "given with --clock " + arguments.clock + ", expected one of the two");
  if (arguments.real_time) choose_clock(clock, "wall");
  if (!arguments.clock.empty()) choose_clock(clock, arguments.clock);
  // A free-running clock would end most scenarios before a browser is open.
  const bool shown = !arguments.view.empty() && arguments.clock.empty();
  if (shown && clock.kind == ClockKind::kFree) choose_clock(clock, "wall");
  const auto needs_deadlines = [&](const char* option, bool given) {
    if (given && clock.kind == ClockKind::kFree)
      throw Error(option, "does not apply to a free-running clock, expected also --clock wall, arrivals or locked");
  };
  needs_deadlines("--overrun", arguments.overrun.has_value());
  needs_deadlines("--priority", arguments.priority.has_value());
  needs_deadlines("--cpu", !arguments.cpus.empty());
  if (arguments.overrun) clock.overrun = *arguments.overrun;
  if (arguments.priority) clock.priority = *arguments.priority;
  if (!arguments.cpus.empty()) {
    try {
      clock.cpus = parse_cpus(arguments.cpus);
    } catch (const Error& error) {
      throw Error("--cpu", error.what());
    }
  }
}

Scenario read_scenario(const RunArguments& arguments) {
  Scenario scenario = load_scenario(arguments.file);
  for (const std::string& assignment : arguments.set) assign(scenario, assignment, units());
  for (const std::string& event : arguments.events) add_event(scenario, event);
  for (const std::string& points : arguments.waypoints) set_waypoints(scenario, points, !arguments.stop, units());
  for (const std::string& tool : arguments.detach) add_tool_event(scenario, false, tool);
  for (const std::string& tool : arguments.attach) add_tool_event(scenario, true, tool);
  if (arguments.stop) {
    constexpr double kMaxSeconds = 9e9;  // 2^63 ns is 9.22e9 s
    if (!(std::abs(*arguments.stop) <= kMaxSeconds))
      throw Error("--stop " + text::to_text(*arguments.stop),
                  "expected a time in seconds, " + text::to_text(kMaxSeconds) + " at most");
    scenario.stop = Time::from_seconds(*arguments.stop);
  }
  read_clock(arguments, scenario.clock);
  if (arguments.coupling) scenario.coupling = *arguments.coupling;
  if (!arguments.record.empty()) {
    scenario.recording.clear();
    scenario.all_outputs = false;
    for (const std::string& pattern : arguments.record) scenario.recording.push_back({pattern, "--record"});
  }
  return scenario;
}

/// The server of --view; nothing without the option. Throws Error also if this build has no page.
std::optional<ViewServer> view_server(const RunArguments& arguments, const std::vector<fs::path>& folders) {
  if (arguments.view.empty()) return std::nullopt;
  if (arguments.view == kAnyPort)
    return std::optional<ViewServer>(std::in_place, std::nullopt, arguments.local_writes, units(), folders);
  const std::optional<long long> port = text::parse_integer(arguments.view);
  if (!port || *port < 0 || *port > 65535)
    throw Error("--view", "'" + arguments.view + "' is no port, expected 0 (a free one) to 65535: --view=8081");
  return std::optional<ViewServer>(std::in_place, static_cast<std::uint16_t>(*port), arguments.local_writes, units(), folders);
}

/// How a browser shows the run; nullptr: this build has no page.
std::shared_ptr<bus::RunPage> page_of(const Scenario& scenario, const RunArguments& arguments,
                                      const std::vector<fs::path>& folders) {
  try {
    return arguments.plain ? gateway_page() : live_page(scenario, units(), folders);
  } catch (const Error&) {
    if (!arguments.view.empty()) throw;
    return nullptr;
  }
}

/// Writes the checkpoints of a run whose state can be saved.
class Checkpoints {
 public:
  Checkpoints(Master& master, CheckpointWriter::Options options)
      : master_(master), file_(options.file), writer_(std::move(options)) {}

  void take(bool last = false) {
    master_.save([this](RunState state) { writer_.write(std::move(state)); }, last);
  }
  /// Ends the writing. If `take_last`, a last checkpoint is written of the point where the run was stopped.
  void end(bool take_last) {
    writer_.wait_until_idle();
    if (take_last) take(true);
    writer_.end();
  }
  /// Returns whether there is a checkpoint from which the run can be resumed.
  bool any() const {
    std::error_code none;
    return fs::exists(file_, none);
  }
  std::string failure() const { return writer_.failure(); }

 private:
  Master& master_;
  fs::path file_;
  CheckpointWriter writer_;
};

/// Runs the loop of a Master or an FmuRun. Errors become the outcome. `checkpoints` may be nullptr.
template <class Run>
Outcome run_to_the_end(Run& run, const Master& master, bool progress_wanted, Checkpoints* checkpoints) {
  Outcome outcome;
  try {
    std::optional<Progress> progress(std::in_place, master, progress_wanted);
    for (;;) {
      if (attention.load(std::memory_order_relaxed) != 0) [[unlikely]] {
        if (stop_signal() != 0) break;
        attention &= ~kCheckpointDue;
        if (checkpoints != nullptr) checkpoints->take();
      }
      if (!run.step_tick()) break;
      if (master.tick() % 64 == 0) progress->update();
    }
    progress.reset();
    if (stop_signal() != 0 && master.tick() < master.ticks())
      outcome = {Outcome::State::kInterrupted, std::string("stopped by ") + name_of_signal(stop_signal())};
    if (checkpoints != nullptr) checkpoints->end(outcome.state == Outcome::State::kInterrupted);
    run.finish();
  } catch (const std::exception& error) {
    outcome = {Outcome::State::kFailed, error.what()};
    if (checkpoints != nullptr) checkpoints->end(false);
    try {
      run.finish();
    } catch (const Error& closing) {
      if (outcome.message != closing.what()) outcome.message += std::string("; ") + closing.what();
    }
  }
  return outcome;
}

/// Prints each warning once to stderr.
class Warnings {
 public:
  void print(const std::vector<std::string>& warnings) {
    for (const std::string& warning : warnings) {
      if (printed_.insert(warning).second) std::cerr << "cotwin: warning: " << warning << '\n';
    }
  }
  /// Returns the warnings that were not printed yet.
  std::vector<std::string> rest(std::vector<std::string> warnings) const {
    std::erase_if(warnings, [&](const std::string& warning) { return printed_.contains(warning); });
    return warnings;
  }

 private:
  std::set<std::string> printed_;
};

/// Prints the outcome and the summary. Returns the exit code.
int report(const RunArguments& arguments, const Summary& summary, const Outcome& outcome, Warnings& warnings) {
  if (outcome.state == Outcome::State::kFailed) std::cerr << "cotwin: " << outcome.message << '\n';
  if (outcome.state == Outcome::State::kInterrupted)
    std::cerr << "cotwin: " << outcome.message << " at t = " << text::to_text(summary.reached) << " s\n";
  const bool json_to_stdout = arguments.json == "-";
  // Writes the file first, because stdout may be closed early (| head).
  if (!arguments.json.empty() && !json_to_stdout) save_json(arguments.json, summary, outcome);
  if (json_to_stdout) {
    write_json(std::cout, summary, outcome);
    warnings.print(summary.warnings);
  } else if (!arguments.quiet) {
    Summary shown = summary;
    shown.warnings = warnings.rest(summary.warnings);
    write_report(std::cout, shown, outcome);
  } else {
    warnings.print(summary.warnings);
  }
  if (outcome.state == Outcome::State::kFailed) return kExitRunFailed;
  return outcome.state == Outcome::State::kInterrupted ? kExitSignalled + stop_signal() : kExitDone;
}

/// Loads the checkpoint named on the command line, replaces the options by those of its run and changes to the working
/// directory of that run.
RunCheckpoint resume(RunArguments& arguments, const Build& build) {
  const fs::path folder = fs::absolute(arguments.resume);
  const std::string place = (arguments.resume / ResultsFolder::kCheckpoint).string();
  RunCheckpoint checkpoint = load_checkpoint(arguments.resume / ResultsFolder::kCheckpoint);
  if (checkpoint.build.version != build.version || checkpoint.build.file != build.file)
    throw Error(place, "was written by cotwin " + checkpoint.build.version + " (build " + hexadecimal(checkpoint.build.file) +
                           "), expected the same program with the same --units, which is cotwin " + build.version + " (build " +
                           hexadecimal(build.file) + ") here");
  if (checkpoint.build.cpu != build.cpu)
    throw Error(place, "was written with the instruction set " + checkpoint.build.cpu + ", here it is " + build.cpu +
                           "; results would differ (COTWIN_CPU selects another one)");
  read_options(checkpoint.command, place, arguments);
  std::error_code error;
  fs::current_path(checkpoint.folder, error);
  if (error) throw Error(place, "began in " + checkpoint.folder + ", which cannot be entered: " + error.message());
  arguments.out = folder.lexically_proximate(checkpoint.folder);
  return checkpoint;
}

/// Continues in a process that is watched if the scenario has FMUs. Returns the exit code in the watching process.
std::optional<int> watch(const Scenario& scenario, const RunArguments& arguments, const fs::path& out, const fs::path& shown) {
  if (std::ranges::all_of(scenario.components, is_unit)) return std::nullopt;
  WatchOptions options;
  options.quiet = arguments.quiet;
  options.ends_children = arguments.view.empty();  // the browser stays
  options.ended = [&](pid_t process, const std::string& reason) {
    const std::string why = reason.empty() ? "the files of the run could not be completed" : reason;
    const std::string kept = close_abandoned_run(out, shown, process, why);
    const bool resumable = !kept.empty() && fs::exists(out / ResultsFolder::kCheckpoint);
    return kept + (resumable ? "; continue with: cotwin run --resume " + shown.string() : "");
  };
  return watch_run(options);
}

}  // namespace

int run_scenario(RunArguments arguments) {
  end_on_signals(" while loading and initialising; no results were written\n");
  const Build build = this_build();
  locate(arguments.json);
  std::optional<RunCheckpoint> earlier;
  if (!arguments.resume.empty()) earlier = resume(arguments, build);
  Scenario scenario = read_scenario(arguments);
  const std::uint64_t hash = hash_of(scenario), files = hash_of(load_scenario(arguments.file));
  const auto expect_same = [&](bool same) {
    if (!same)
      throw Error((arguments.out / ResultsFolder::kCheckpoint).string(),
                  "belongs to another scenario: " + arguments.file.string() +
                      " or a file that it names has changed, expected the same");
  };
  expect_same(!earlier || earlier->scenario == hash);
  const fs::path shown = arguments.out.empty() ? fs::path("results") / file_name_of(scenario.name) : arguments.out;
  const fs::path here = fs::current_path(), out = here / shown;  // an FMU may call chdir()
  if (const std::optional<int> code = watch(scenario, arguments, out, shown)) return *code;
  MasterOptions options;
  options.types = units();
  options.folders = model_folders(scenario.folder);
  const auto store = options.models = std::make_shared<FileStore>();
  options.results = out;
  options.view_data = !arguments.no_view_data && !arguments.plain;
  options.joint_names = arguments.joint_names;
  options.threads = arguments.threads;
  options.page = page_of(scenario, arguments, options.folders);
  std::optional<ViewServer> server = view_server(arguments, options.folders);
  if (server) options.observer = &*server;
  ResultsFolder results(out, shown);
  fs::path kept;
  std::optional<RunRecord> record;
  std::optional<Master> master;
  options.before_results = [&] {
    note_signals();
    results.open();
    if (!earlier && !arguments.overwrite) kept = results.keep_earlier_run();
    if (!earlier && arguments.overwrite) {
      for (const char* name : {ResultsFolder::kView, ResultsFolder::kSummary, ResultsFolder::kCheckpoint,
                               ResultsFolder::kHistory, ResultsFolder::kPage})
        fs::remove(out / name);
    }
    RunRecord::Given given{.file = out / ResultsFolder::kRecord,
                           .build = build,
                           .scenario = hash,
                           .files = files,
                           .set = arguments.set,
                           .events = arguments.events,
                           .waypoints = arguments.waypoints,
                           .attach = arguments.attach,
                           .detach = arguments.detach,
                           .results = {},
                           .joint_names = arguments.joint_names,
                           .resumed_at = {}};
    if (!master->columns().empty()) given.results = out / ResultsFolder::kSignals;
    if (earlier) given.resumed_at = master->now().seconds();
    record.emplace(std::move(given), *master);
  };
  if (earlier) options.resume = earlier->state;
  options.waiting = [](const std::vector<std::string>& names) {
    end_at_once_on_signals();
    std::string all;
    for (const std::string& name : names) all += (all.empty() ? "'" : ", '") + name + "'";
    std::cerr << "cotwin: waiting for the last step beside the loop of " << all
              << "; the recording is closed, Ctrl-C ends now\n";
  };
  master.emplace(std::move(scenario), std::move(options));
  const std::uint64_t models = hash_of(*store);
  expect_same(!earlier || earlier->models == models);
  Warnings warnings;
  warnings.print(master->warnings());
  master->initialise();
  warnings.print(master->warnings());
  if (arguments.started) arguments.started();
  if (server) {
    std::cerr << "cotwin: live at " << server->url() << std::endl;
    open_in_browser(server->url());
  }
  if (!kept.empty() && !arguments.quiet)
    std::cout << "earlier results: moved to " << (shown / kept.filename()).string() << '\n';
  std::optional<Checkpoints> checkpoints;
  if (arguments.checkpoint > 0 && master->unsavable().empty()) {
    CheckpointWriter::Options writing;
    writing.file = out / ResultsFolder::kCheckpoint;
    writing.every = std::chrono::duration<double>(arguments.checkpoint);
    writing.head = {build, hash, options_of(arguments), here.string(), {}, models};
    writing.sync_recording = [&](RunState& state) { return master->sync_recording(state); };
    writing.due = [] { attention |= kCheckpointDue; };
    checkpoints.emplace(*master, std::move(writing));
  }
  const bool own_thread = master->scenario().clock.real_time_thread();
  Outcome outcome;
  const auto loop = [&] {
    master->prepare_threads();
    warnings.print(master->warnings());
    outcome = run_to_the_end(*master, *master, !arguments.quiet && !own_thread, checkpoints ? &*checkpoints : nullptr);
  };
  if (own_thread) {
    std::thread(loop).join();
  } else {
    loop();
  }
  if (server) server->end();
  Summary summary = master->summary();
  if (!summary.recording.empty()) summary.recording = shown / ResultsFolder::kSignals;
  if (checkpoints && !checkpoints->failure().empty()) summary.warnings.push_back("no checkpoint: " + checkpoints->failure());
  if (arguments.checkpoint > 0 && summary.wall_seconds > arguments.checkpoint && !master->unsavable().empty())
    summary.warnings.push_back("no checkpoint: " + master->unsavable());
  if (outcome.state == Outcome::State::kDone) {
    std::error_code none;
    fs::remove(out / ResultsFolder::kCheckpoint, none);
  }
  if (const std::vector<robot::RobotHistory> histories = master->histories(); !histories.empty()) {
    try {
      write_file(out / ResultsFolder::kHistory, robot::to_json(histories));
    } catch (const Error& error) {
      summary.warnings.push_back(std::string("no history of the tools: ") + error.what());
    }
  }
  try {
    record->close(summary, outcome);
  } catch (const Error& error) {
    if (outcome.state == Outcome::State::kDone) throw;
    summary.warnings.push_back(error.what());
  }
  try {
    save_json(out / ResultsFolder::kSummary, summary, outcome);
  } catch (const Error& error) {
    summary.warnings.push_back(std::string("no summary of the run in a file: ") + error.what());
  }
  const int code = report(arguments, summary, outcome, warnings);
  std::error_code moved;
  fs::current_path(here, moved);  // no FMU runs any more
  if (arguments.report) write_report_page(moved ? out : shown, arguments.quiet);
  if (outcome.state != Outcome::State::kDone && checkpoints && checkpoints->any())
    std::cerr << "cotwin: continue with: cotwin run --resume " << shown.string() << '\n';
  return code;
}

int run_fmu(RunArguments arguments) {
  end_on_signals(" while loading; no results were written\n");
  if (arguments.fmu.process != fmu::ProcessChoice::kOwn) {
    const fs::path rows = output_file_of(arguments.fmu);
    WatchOptions watch;
    watch.quiet = arguments.quiet;
    watch.ended = [&rows](pid_t, const std::string& reason) { return reason.empty() ? "" : keep_rows(rows, rows); };
    if (const std::optional<int> code = watch_run(watch)) return *code;
  }
  locate(arguments.json);
  if (!arguments.fmu.input_file.empty()) arguments.fmu.input_file = fs::absolute(arguments.fmu.input_file);
  const fs::path shown = output_file_of(arguments.fmu), out = arguments.fmu.output_file = fs::current_path() / shown;
  FmuRun run(arguments.fmu);
  FileLock lock;
  if (!fs::exists(out) || fs::is_regular_file(out)) lock = FileLock(out.string() + ".lock", out.string());
  run.initialise();
  note_signals();
  Warnings warnings;
  warnings.print(run.master().warnings());
  const Outcome outcome = run_to_the_end(run, run.master(), !arguments.quiet, nullptr);
  Summary summary = run.summary();
  summary.recording = shown;
  return report(arguments, summary, outcome, warnings);
}

int run_scenario(const ScenarioRun& run) {
  RunArguments arguments;
  arguments.file = run.file;
  arguments.out = run.out;
  arguments.set = run.set;
  arguments.record = run.record;
  arguments.stop = run.stop;
  arguments.view = run.view;
  arguments.quiet = run.quiet;
  arguments.overwrite = run.overwrite;
  if (!run.resumable) arguments.checkpoint = 0;
  arguments.started = run.started;
  arguments.plain = run.plain;
  return run_scenario(std::move(arguments));
}

}  // namespace cotwin::master
