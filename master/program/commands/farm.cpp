// cotwin farm: the runs of a study on all cores or on Slurm; resume, cancel, status, export, repeat.
#include <unistd.h>

#include <atomic>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "components/services/json/json.h"
#include "components/services/json/request.h"
#include "master/farm/farm.h"
#include "master/farm/slurm.h"
#include "master/program/commands/commands.h"
#include "master/program/interrupt.h"
#include "master/program/progress_line.h"
#include "master/results/summary.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::size_t kMostMessages = 10;
constexpr const char* kCancelFile = "cancel";  // in the folder of a study: the farm ends

struct FarmArguments {
  fs::path file, out, csv;  // file: a study or a scenario, or the folder of a study
  std::vector<std::string> vary, set, keep, success;
  std::string design, table, view, json;
  std::optional<std::int64_t> runs, seed;
  std::optional<double> stop, limit;
  std::string on, partition;  // on: "slurm"; empty: this machine
  std::optional<int> threads;
  bool dry_run = false, quiet = false;
  std::int64_t run = 0;  // of repeat; the chunk of a batch

  /// Of this machine all, of a chunk one.
  int threads_or_default() const {
    return threads.value_or(on.empty() ? static_cast<int>(std::max(1u, std::thread::hardware_concurrency())) : 1);
  }
};

/// The study of a file, or nothing but the scenario of one.
Json read_file(const fs::path& file) {
  if (file.extension() != ".json") return Json{{"scenario", fs::absolute(file).string()}};
  try {
    return services::parse_object(text::read_file(file, "a study (.json)"));
  } catch (const services::RequestError& error) {
    throw Error(file.string(), error.pointer().empty() ? error.detail() : error.what());
  }
}

/// Options replace members of the file; assignments are added to its own.
Json with_options(Json study, const FarmArguments& a) {
  for (const std::string& given : a.vary) {
    const std::size_t equals = given.find('=');
    if (equals == std::string::npos || equals == 0)
      throw Error("--vary " + given, "expected NAME=LOW:HIGH, NAME=normal:MEAN:DEVIATION or NAME=VALUE,VALUE");
    study["vary"][given.substr(0, equals)] = distribution_of(std::string_view(given).substr(equals + 1));
  }
  for (const std::string& assignment : a.set) {
    if (study.contains("set") && study["set"].is_string()) study["set"] = Json::array({study["set"]});
    study["set"].push_back(assignment);
  }
  if (!a.keep.empty()) study["keep"] = a.keep;
  if (!a.success.empty()) study["success"] = a.success;
  if (!a.design.empty()) study["design"] = a.design;
  if (!a.table.empty()) study["table"] = fs::absolute(a.table).string();
  if (a.runs) study["runs"] = *a.runs;
  if (a.seed) study["seed"] = *a.seed;
  if (a.stop) study["stop_s"] = *a.stop;
  if (a.limit) study["limit_s"] = *a.limit;
  return study;
}

std::string bytes(double n) { return n < 2e6 ? text::to_text(n / 1e3, 3) + " kB" : text::to_text(n / 1e6, 3) + " MB"; }

void print(std::ostream& out, const std::string& name, std::int64_t runs, Registry& registry) {
  const Registry::Totals t = registry.totals();
  out << name << ": " << t.done + t.failed << " of " << text::counted(runs, "run") << ", " << t.failed << " failed";
  if (t.judged > 0)
    out << "; success in " << t.successes << " of " << t.judged << " ("
        << text::to_text(100 * static_cast<double>(t.successes) / static_cast<double>(t.judged), 3) << " %)";
  out << '\n';
  const std::vector<Registry::Message> messages = registry.messages();
  for (const Registry::Message& message : std::span(messages).first(std::min(messages.size(), kMostMessages))) {
    out << (message.failure ? "  failed: " : "  warning: ") << text::counted(message.runs, "run") << ", first " << message.run
        << ": " << message.text << '\n';
  }
  if (messages.size() > kMostMessages)
    out << "  and " << text::counted(static_cast<std::int64_t>(messages.size() - kMostMessages), "other message")
        << " (table messages)\n";
  for (const Registry::Spread& s : registry.spreads()) {
    out << "  " << s.name << ": ";
    if (s.count == 0) {
      out << "in no run\n";
    } else {
      out << text::to_text(s.min, 6) << " to " << text::to_text(s.max, 6) << ", mean " << text::to_text(s.mean, 6) << '\n';
    }
  }
}

Json json_of(const std::string& name, const fs::path& folder, std::int64_t runs, Registry& registry) {
  const Registry::Totals t = registry.totals();
  Json j{{"study", name},      {"folder", folder.string()}, {"runs", runs},
         {"done", t.done},     {"failed", t.failed},        {"success", t.judged > 0 ? Json(t.successes) : Json()},
         {"judged", t.judged}, {"seconds", t.seconds}};
  j["figures"] = Json::object();
  for (const Registry::Spread& s : registry.spreads())
    j["figures"][s.name] = {{"runs", s.count}, {"min", s.min}, {"mean", s.mean}, {"max", s.max}};
  j["messages"] = Json::array();
  for (const Registry::Message& m : registry.messages())
    j["messages"].push_back({{"failure", m.failure}, {"text", m.text}, {"run", m.run}, {"runs", m.runs}});
  return j;
}

void report(const FarmArguments& a, const std::string& name, const fs::path& folder, std::int64_t runs, Registry& registry) {
  if (!a.json.empty()) {
    const std::string text = json_of(name, folder, runs, registry).dump(2) + "\n";
    if (a.json == "-") {
      std::cout << text;
    } else {
      write_file(a.json, text);
    }
  }
  if (!a.quiet && a.json != "-") print(std::cout, name, runs, registry);
}

/// The program and its environment, as a node needs them.
SlurmOptions slurm_options(const FarmArguments& a) {
  SlurmOptions options;
  options.partition = a.partition;
  options.program = fs::read_symlink("/proc/self/exe").string();
  options.threads = a.threads_or_default();
  for (char** entry = environ; *entry != nullptr; ++entry) {
    const std::string text = *entry;
    const std::size_t equals = text.find('=');
    if (text.starts_with("COTWIN_") && equals != std::string::npos)
      options.environment.emplace_back(text.substr(0, equals), text.substr(equals + 1));
  }
  return options;
}

/// Makes what the registry lacks. Returns the exit code.
int fill(const FarmArguments& a, const Farm& farm, const Facts& facts, const fs::path& folder, Registry& registry) {
  note_signals();
  const std::int64_t runs = farm.study().design.runs;
  const fs::path chunks = folder / kChunksFolder, cancel_file = folder / kCancelFile;
  std::error_code none;
  std::atomic<bool> is_cancelled = false;
  bool is_over = false;
  {
    ProgressLine line(!a.quiet);
    const auto tell = [&line](const std::string& what) {
      line.clear();
      std::cerr << "cotwin: " << what << '\n';
    };
    const FarmHooks hooks{[&] { return stop_signal() != 0 || is_cancelled; },
                          [&](std::int64_t over, std::int64_t failed, const std::string& where) {
                            if (fs::exists(cancel_file, none)) is_cancelled = true;
                            if (!line.is_due()) return;
                            line.update("run " + std::to_string(over) + " of " + std::to_string(runs) +
                                            (failed > 0 ? ", " + std::to_string(failed) + " failed" : "") +
                                            (where.empty() ? "" : "; chunks: " + where),
                                        static_cast<double>(over) / static_cast<double>(runs));
                          }};
    if (a.on.empty()) {
      if (!files_of_batches(chunks).empty())
        throw Error(folder.string(),
                    "has chunks in Slurm, expected --on slurm, or first: cotwin farm cancel " + folder.string());
      if (fs::exists(chunks)) Merger(farm, facts, registry, chunks, tell).merge();
      is_over = farm.fill(registry, a.threads_or_default(), hooks);
    } else {
      if (const Registry::Totals t = registry.totals(); t.done + t.failed == 0)
        registry.add(farm.sample(hooks.stops), registry.begin_session(this_process(1)));
      is_over = fill_on_slurm(farm, facts, registry, folder, slurm_options(a), hooks, tell);
    }
  }
  if (is_cancelled) fs::remove(cancel_file, none);
  report(a, farm.study().name, folder, runs, registry);
  if (is_over) return registry.totals().done > 0 ? kExitDone : kExitRunFailed;
  const bool is_stopped = stop_signal() != 0 || is_cancelled;
  std::cerr << "cotwin: "
            << (is_cancelled ? "stopped by cotwin farm cancel; "
                : is_stopped ? std::string("stopped by ") + name_of_signal(stop_signal()) + "; "
                             : "")
            << "continue with: cotwin farm resume " << folder.string() << (a.on.empty() ? "" : " --on slurm") << '\n';
  return !is_stopped ? kExitRunFailed : kExitSignalled + (is_cancelled ? SIGTERM : stop_signal());
}

/// What the runs will need, from a few of them.
int dry_run(const Farm& farm, const FarmArguments& a) {
  note_signals();
  const std::int64_t runs = farm.study().design.runs;
  double seconds = 0;
  const std::vector<RunRow> rows = farm.sample([] { return stop_signal() != 0; });
  if (stop_signal() != 0) return kExitSignalled + stop_signal();
  for (const RunRow& row : rows) {
    seconds += row.seconds;
    if (!row.failure.empty()) std::cout << "run " << row.run << " fails: " << row.failure << '\n';
  }
  const auto made = static_cast<double>(rows.size());
  const double all = static_cast<double>(runs) * seconds / made;
  const auto columns = static_cast<double>(farm.study().design.factors.size() + farm.figures().size());
  std::cout << farm.study().name << ": " << text::counted(runs, "run") << " of " << duration(seconds / made) << ", "
            << duration_text(all / a.threads_or_default()) << " on " << text::counted(a.threads_or_default(), "thread")
            << "; disk " << bytes(static_cast<double>(runs) * (9 * columns + 40)) << "; memory "
            << bytes(static_cast<double>(farm.bytes_of_twin())) << " a twin\n"
            << "  kept: " << text::joined(farm.figures()) << '\n';
  return kExitDone;
}

/// "runs is 50, was 40": members of the study's file that have changed.
std::string changes(const Json& now, const Json& was) {
  std::string all;
  Json both = was;
  both.update(now);
  for (const auto& [name, unused] : both.items()) {
    const auto value = [&name = name](const Json& j) { return j.contains(name) ? j[name].dump() : std::string("missing"); };
    if (value(now) != value(was)) text::append(all, name + " is " + value(now) + ", was " + value(was), "; ");
  }
  return all;
}

/// The study of a folder.
Study stored_study(Registry& registry, const fs::path& folder) {
  return read_study(Json::parse(registry.fact("study")), folder.string(), "/");
}

/// Enters the working directory in which a study began, to which its assignments may be relative.
void enter_origin(const fs::path& origin, const fs::path& folder) {
  std::error_code error;
  fs::current_path(origin, error);
  if (error) throw Error(folder.string(), "began in " + origin.string() + ", which cannot be entered: " + error.message());
}

int begin(const FarmArguments& a) {
  end_on_signals(" while the study is prepared; nothing was written\n");
  const Json file = read_file(a.file);
  const bool is_study = a.file.extension() == ".json";
  Study study =
      read_study(with_options(file, a), a.file.string(), is_study ? fs::absolute(a.file).parent_path() : fs::current_path());
  const Farm farm = [&] {
    try {
      return Farm(std::move(study), units());
    } catch (const Error& error) {
      throw Error(a.file.string(), error.what());
    }
  }();
  if (a.dry_run) return dry_run(farm, a);
  if (!a.on.empty()) check_slurm(a.partition);  // before there is a folder
  const fs::path folder = a.out.empty() ? fs::path("results") / (file_name_of(farm.study().name) + ".farm") : a.out;
  Facts facts = farm.facts(this_build());
  facts.emplace_back("folder", fs::current_path().string());
  const Facts of_runs = facts;
  facts.emplace_back("file", is_study ? fs::absolute(a.file).string() : "");
  facts.emplace_back("content", file.dump());
  std::vector<std::string> factors;
  for (const Factor& factor : farm.study().design.factors) factors.push_back(factor.name);
  Registry registry(folder, facts, factors, farm.figures());
  return fill(a, farm, of_runs, folder, registry);
}

int resume(const FarmArguments& given) {
  FarmArguments a = given;
  end_on_signals(" while the study is prepared\n");
  const fs::path shown = a.file, folder = fs::absolute(a.file);
  if (!a.json.empty() && a.json != "-") a.json = fs::absolute(a.json).string();
  Registry registry(folder, false);
  enter_origin(registry.fact("folder"), shown);
  const Farm farm(stored_study(registry, shown), units());
  Facts facts = farm.facts(this_build());
  std::string differs = difference(registry.facts(), facts);
  if (const fs::path file = registry.fact("file"); !file.empty() && fs::exists(file)) {
    const std::string changed = changes(read_file(file), Json::parse(registry.fact("content")));
    if (!changed.empty()) text::append(differs, changed, "; ");
  }
  if (!differs.empty())
    throw Error(shown.string(), "cannot be resumed, its runs would not belong together: " + differs + "; expected no change");
  facts.emplace_back("folder", registry.fact("folder"));
  return fill(a, farm, facts, folder, registry);
}

int status(const FarmArguments& a) {
  Registry registry(a.file, true);
  const Study study = stored_study(registry, a.file);
  report(a, study.name, a.file, study.design.runs, registry);
  if (a.json != "-" && !files_of_batches(a.file / kChunksFolder).empty()) {
    try {
      const std::string queued = chunks_in_slurm(a.file);
      std::cout << "  chunks in Slurm: " << (queued.empty() ? "none" : queued) << '\n';
    } catch (const Error& error) {
      std::cout << "  chunks in Slurm: unknown, " << error.what() << '\n';
    }
  }
  return kExitDone;
}

/// Ends the farm of a folder, wherever it runs, and its chunks in the queue.
int cancel(const FarmArguments& a) {
  Registry(a.file, true);
  write_file(a.file / kCancelFile, "");
  constexpr int kTries = 900;  // chunks in the queue get some time to end
  for (int tries = 1;; ++tries) {
    try {
      const database::OwnerLock owner(a.file / Registry::kFile);
      fs::remove(a.file / kCancelFile);
      if (!files_of_batches(a.file / kChunksFolder).empty()) cancel_in_slurm(a.file);
      break;
    } catch (const database::InUse&) {
      if (tries == kTries) throw;
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
  }
  if (!a.quiet) std::cout << "cancelled; continue with: cotwin farm resume " << a.file.string() << '\n';
  return kExitDone;
}

/// On a node: makes a chunk of the batch in a file.
int chunk(const FarmArguments& a) {
  end_on_signals(" while a chunk is prepared\n");
  const fs::path file = fs::absolute(a.file), folder = file.parent_path();
  const Batch batch = read_batch(file);
  const auto index = static_cast<std::size_t>(a.run);
  if (index >= batch.chunks.size())
    throw Error("CHUNK", std::to_string(a.run) + ", expected one of " +
                             text::counted(static_cast<std::int64_t>(batch.chunks.size()), "chunk") + ", from 0");
  std::optional<Farm> farm;
  try {
    enter_origin(fact_of(batch.facts, "folder", file.string()), file);
    farm.emplace(read_study(Json::parse(fact_of(batch.facts, "study", file.string())), file.string(), "/"), units());
    if (const std::string differs = difference(batch.facts, farm->facts(this_build())); !differs.empty())
      throw Error("its runs would not belong to the others", differs);
  } catch (const std::exception& error) {
    refuse_chunk(batch, index, folder, error.what());
    throw;
  }
  note_signals();
  make_chunk(*farm, batch, index, folder, [] { return stop_signal() != 0; });
  return stop_signal() == 0 ? kExitDone : kExitSignalled + stop_signal();
}

int export_runs(const FarmArguments& a) {
  Registry registry(a.file, true);
  if (a.csv.empty() || a.csv == "-") {
    registry.write(std::cout);
  } else {
    AtomicFile file(a.csv);
    registry.write(file.stream());
    file.commit();
  }
  return kExitDone;
}

int repeat(const FarmArguments& a) {
  const fs::path folder = fs::absolute(a.file), here = fs::current_path();
  ScenarioRun run;
  {
    Registry registry(folder, true);
    enter_origin(registry.fact("folder"), a.file);
    const Study study = stored_study(registry, a.file);
    if (a.run < 1 || a.run > study.design.runs)
      throw Error("RUN", std::to_string(a.run) + ", expected 1 to " + std::to_string(study.design.runs));
    run.file = study.scenario;
    run.stop = study.stop;
    run.set = study.assignments(study.design.point(a.run));
  }
  run.out = a.out.empty() ? folder / ("run_" + std::to_string(a.run)) : here / a.out;
  run.view = a.view;
  run.quiet = a.quiet;
  if (!a.quiet) {
    std::cout << "cotwin run " << run.file.string() << (run.stop ? " --stop " + text::to_text(*run.stop) : "");
    for (const std::string& assignment : run.set) std::cout << " --set '" << assignment << "'";
    std::cout << std::endl;
  }
  return run_scenario(run);
}

}  // namespace

void add_farm(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<FarmArguments>();
  CLI::App* farm =
      app.add_subcommand("farm", "Run a study: many runs of a scenario with different values, on all cores or on Slurm");
  const auto texts = [&](const char* name, std::vector<std::string>& to, const char* what, const char* type) {
    farm->add_option(name, to, what)->type_name(type)->allow_extra_args(false);
  };
  const auto add_common = [&](CLI::App* command) {
    command
        ->add_option("--threads", all->threads,
                     "Number of threads (default: all of this machine), with --on slurm of each chunk (1)")
        ->check(CLI::Range(1, 1024))
        ->type_name("N");
    command->add_option("--on", all->on, "Where the runs are made: slurm, as job arrays (default: this machine)")
        ->check(CLI::IsMember({"slurm"}))
        ->type_name("slurm");
    command->add_option("--partition", all->partition, "Of Slurm")->needs("--on")->type_name("NAME");
    command->add_option("--json", all->json, "Write the figures as JSON, to stdout with -")->type_name("FILE|-");
    command->add_flag("--quiet", all->quiet, "No progress and no table");
  };
  farm->add_option("FILE", all->file, "Study (.json, docs/farm.md), or a scenario (.ssd, .ssp) with the options of a study")
      ->type_name("FILE");
  texts("--vary", all->vary,
        "What varies: NAME=LOW:HIGH (uniform), NAME=normal:MEAN:DEVIATION or another distribution, NAME=VALUE,VALUE; may be "
        "repeated",
        "NAME=DISTRIBUTION");
  farm->add_option("--table", all->table, "CSV file with a column for each name and a row for each run, in place of --vary")
      ->type_name("FILE");
  farm->add_option("--design", all->design, "How the runs fill the space (default: latin_hypercube)")
      ->check(CLI::IsMember({"latin_hypercube", "sobol", "random", "grid"}))
      ->type_name("WORD");
  farm->add_option("--runs", all->runs, "Number of runs")->type_name("N");
  farm->add_option("--seed", all->seed, "Of the designs latin_hypercube and random (default: 1)")->type_name("N");
  texts("--set", all->set, "As for cotwin run, in all runs; {NAME} is the value of what varies; may be repeated", "NAME=VALUE");
  texts("--keep", all->keep,
        "What is kept of a run: 'end NAME', 'min NAME', 'max NAME', 'peak NAME' (largest magnitude), or figures, all of the\n"
        "summary (default); may be repeated",
        "WHAT");
  texts("--success", all->success,
        "Condition of success, e.g. 'peak world.force<30', or of a variable at the end; may be repeated", "CONDITION");
  farm->add_option("--stop,--stop-time", all->stop, "Stop time in seconds; replaces that of the file")
      ->check(kNumber)
      ->type_name("SECONDS");
  farm->add_option("--limit", all->limit, "Wall time at which a run ends as failed (default: 600)")
      ->check(kNumber)
      ->type_name("SECONDS");
  farm->add_option("--out", all->out, "Folder of the study (default: results/<study>.farm)")->type_name("FOLDER");
  farm->add_flag("--dry-run", all->dry_run, "Tell runs, time, disk and memory, from at most three runs");
  add_common(farm);
  farm->footer(
      "Each run is a fresh one, numbered from 1; its figures are those of cotwin run with the same values. The folder has an\n"
      "SQLite database farm.db with the table `runs`, also while the study goes on. Options replace members of the study's "
      "file.");
  const auto add = [&](const char* name, const char* what, int (*action)(const FarmArguments&)) {
    CLI::App* command = farm->add_subcommand(name, what);
    command->add_option("FOLDER", all->file, "Folder of the study")->type_name("FOLDER")->required();
    command->callback([all, action, &chosen] { chosen = [all, action] { return action(*all); }; });
    return command;
  };
  add_common(add("resume", "Make the runs that are missing", resume));
  CLI::App* told = add("status", "Tell how far a study is, and its figures so far", status);
  told->add_option("--json", all->json, "Write the figures as JSON, to stdout with -")->type_name("FILE|-");
  add("cancel", "End the farm of a study, and its chunks in Slurm", cancel);
  CLI::App* part = add("chunk", "On a node of a cluster: make a chunk of a study", chunk);
  part->add_option("CHUNK", all->run, "Number of the chunk, from 0")->required();
  part->group("");  // not for users
  add("export", "Write all runs as CSV", export_runs)
      ->add_option("--csv", all->csv, "File (default: stdout)")
      ->type_name("FILE|-");
  CLI::App* again = add("repeat", "Repeat one run with all of its results, as cotwin run does", repeat);
  again->add_option("RUN", all->run, "Number of the run")->type_name("N")->required();
  again->add_option("--out", all->out, "Folder for the results (default: run_<N> in the folder of the study)")
      ->type_name("FOLDER");
  again->add_flag("--view", all->view, "Show the run in a browser while it goes on, as cotwin run does")
      ->option_text("[=PORT]");
  again->add_flag("--quiet", all->quiet, "No progress and no table");
  farm->callback([all, farm, &chosen] {
    if (!farm->get_subcommands().empty()) return;
    if (all->file.empty()) throw CLI::RequiredError("FILE");
    chosen = [all] { return begin(*all); };
  });
}

}  // namespace cotwin::master
