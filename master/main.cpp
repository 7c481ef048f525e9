// The program `cotwin`: what the library in this folder does, from the command line.
#include <signal.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <iostream>

#include "master/master.h"
#include "master/reference.h"
#include "master/report.h"
#include "models/text/error.h"
#include "models/text/text.h"

namespace {

namespace fs = std::filesystem;
using namespace cotwin;
using namespace cotwin::master;

enum ExitCode { kExitDone = 0, kExitRunFailed = 1, kExitBadInput = 2, kExitSignalled = 128 };  // 128 + the signal's number

std::atomic<int> stop_signal{0};

void ask_to_stop(int signal) { stop_signal = signal; }

/// The first Ctrl-C ends the run cleanly, a second one at once.
void catch_signals() {
  struct sigaction action = {};
  action.sa_handler = ask_to_stop;
  action.sa_flags = SA_RESETHAND;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

/// Where units look up named data, in this order.
std::vector<fs::path> model_folders(const fs::path& scenario) {
  std::vector<fs::path> folders;
  if (!scenario.empty()) folders.push_back(fs::absolute(scenario).parent_path());
  folders.push_back(fs::current_path());
  if (const char* listed = std::getenv("COTWIN_MODELS")) {
    for (const std::string_view folder : text::split(listed, ':')) {
      if (!folder.empty()) folders.emplace_back(folder);
    }
  }
  std::error_code none;
  const fs::path program = fs::read_symlink("/proc/self/exe", none);
  if (!none) folders.push_back((program.parent_path() / ".." / "share" / "cotwin" / "models").lexically_normal());
  folders.emplace_back(COTWIN_SOURCE_MODELS);
  return folders;
}

std::string file_name_of(const std::string& scenario) {
  std::string name = scenario.empty() ? "run" : scenario;
  for (char& c : name) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' || c == '.' || (c & 0x80);
    if (!plain) c = '_';
  }
  return name == "." || name == ".." ? "run" : name;
}

/// A line on the terminal that overwrites itself; nothing where stderr is a file.
class Progress {
 public:
  Progress(const Master& master, bool wanted) : master_(master), shown_(wanted && isatty(STDERR_FILENO)) {}
  ~Progress() {
    if (drawn_) std::cerr << "\r\x1b[K" << std::flush;
  }
  void update() {
    if (!shown_) return;
    const auto now = Clock::now();
    if (now - last_ < std::chrono::milliseconds(100)) return;
    last_ = now;
    drawn_ = true;
    constexpr int kWidth = 40;
    const double share = static_cast<double>(master_.tick()) / static_cast<double>(master_.ticks());
    const int full = static_cast<int>(share * kWidth);
    const double wall = std::chrono::duration<double>(now - begin_).count();
    const double simulated = (master_.now() - master_.scenario().start).seconds();
    std::cerr << "\r\x1b[K[" << std::string(static_cast<std::size_t>(full), '#')
              << std::string(static_cast<std::size_t>(kWidth - full), '.') << "] " << text::to_text(simulated, 4) << " s, "
              << text::to_text(wall > 0 ? simulated / wall : 0, 3) << " times real time" << std::flush;
  }

 private:
  using Clock = std::chrono::steady_clock;
  const Master& master_;
  bool shown_, drawn_ = false;
  Clock::time_point begin_ = Clock::now(), last_ = begin_;
};

struct RunArguments {
  fs::path scenario, out;
  std::vector<std::string> set, record;
  std::string json;
  double stop = 0;
  bool has_stop = false, real_time = false, quiet = false;
  std::optional<int> threads;
};

void save_json(const fs::path& file, const Summary& summary, const Outcome& outcome) {
  std::ofstream out(file);
  write_json(out, summary, outcome);
  if (!out.flush()) throw Error(file.string(), "cannot be written");
}

Scenario read_scenario(const RunArguments& arguments) {
  Scenario scenario = load_scenario(arguments.scenario);
  for (const std::string& assignment : arguments.set) assign(scenario, assignment);
  if (arguments.has_stop) scenario.stop = Time::from_seconds(arguments.stop);
  if (arguments.real_time) scenario.clock = "real-time";
  if (!arguments.record.empty()) {
    scenario.recording.clear();
    for (const std::string& pattern : arguments.record) scenario.recording.push_back({pattern, "--record"});
  }
  return scenario;
}

/// The loop; what goes wrong in it is the outcome.
Outcome run_to_the_end(Master& master, bool progress_wanted) {
  Outcome outcome;
  try {
    Progress progress(master, progress_wanted);
    while (stop_signal == 0 && master.step_tick()) {
      if (master.tick() % 64 == 0) progress.update();
    }
    if (stop_signal != 0 && master.tick() < master.ticks()) outcome.state = "interrupted";
    master.finish();
  } catch (const Error& error) {
    outcome = {"failed", error.what()};
    try {
      master.finish();
    } catch (const Error& closing) {
      if (outcome.message != closing.what()) outcome.message += std::string("; ") + closing.what();
    }
  }
  return outcome;
}

int run(const RunArguments& arguments) {
  Scenario scenario = read_scenario(arguments);
  const fs::path out = arguments.out.empty() ? fs::path("results") / file_name_of(scenario.name) : arguments.out;
  MasterOptions options;
  options.types = unit_types();
  options.folders = model_folders(arguments.scenario);
  options.results = out;
  options.threads = arguments.threads;
  Master master(std::move(scenario), std::move(options));
  catch_signals();
  master.initialise();

  const Outcome outcome = run_to_the_end(master, !arguments.quiet);
  const Summary summary = master.summary();
  const bool json_to_stdout = arguments.json == "-";
  if (json_to_stdout) {
    write_json(std::cout, summary, outcome);
  } else if (!arguments.quiet) {
    write_report(std::cout, summary, outcome);
  }
  std::cout.flush();
  if (outcome.state == "failed") std::cerr << "cotwin: " << outcome.message << '\n';
  if (!arguments.json.empty() && !json_to_stdout) save_json(arguments.json, summary, outcome);
  if (outcome.state == "failed") return kExitRunFailed;
  return outcome.state == "interrupted" ? kExitSignalled + stop_signal : kExitDone;
}

Instance make(const std::string& source, const std::map<std::string, std::string>& defaults) {
  return make_unit(source, defaults, model_folders({}), unit_types());
}

int describe_source(std::string source, bool json) {
  if (source.rfind("unit:", 0) != 0) source = "unit:" + source;
  const Instance instance = make(source, {});
  if (json) {
    describe_json(std::cout, source, instance);
  } else {
    describe(std::cout, source, instance);
  }
  return kExitDone;
}

int write_reference(const fs::path& folder, const std::string& robot) {
  fs::create_directories(folder);
  std::ofstream index(folder / "README.md");
  index << "# Units\n\nWritten by `cotwin reference` from the units' declarations.\n\n";
  for (const UnitType& type : unit_types()) {
    const Instance instance = make(std::string("unit:") + type.name, {{"robot", robot}});
    const fs::path file = folder / (std::string(type.name) + ".md");
    std::ofstream page(file);
    describe_markdown(page, type, instance, "`robot=" + robot + "`");
    index << "- [`" << type.name << "`](" << type.name << ".md): " << type.summary << '\n';
    if (!page.flush()) throw Error(file.string(), "cannot be written");
  }
  if (!index.flush()) throw Error((folder / "README.md").string(), "cannot be written");
  return kExitDone;
}

int list_units() {
  for (const UnitType& type : unit_types()) {
    std::string name = type.name;
    name.resize(std::max<std::size_t>(name.size(), 14), ' ');
    std::cout << name << "  " << type.summary << '\n';
  }
  return kExitDone;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Cotwin: a value-driven digital twin of robot manipulators, as co-simulation units and a small master."};
  app.set_version_flag("--version", std::string("cotwin ") + COTWIN_VERSION);
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 done; 1 the run failed (a NaN, a step that nobody could make, a full disk); 2 bad input (command line, "
      "scenario,\n"
      "parameters, files); 130 or 143 ended by Ctrl-C or SIGTERM, with everything up to then in the files.");

  RunArguments arguments;
  CLI::App* run_command = app.add_subcommand("run", "Run a scenario");
  run_command->add_option("SCENARIO", arguments.scenario, "System structure (.ssd)")->required();
  CLI::Option* stop = run_command->add_option("--stop", arguments.stop, "Stop time in seconds, instead of the scenario's");
  run_command
      ->add_option("--set", arguments.set, "unit.variable=value, unit.variable[i]=value or setting=value; may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  run_command->add_option("--out", arguments.out,
                          "Folder for the results (default: results/<scenario> in the working directory)");
  run_command
      ->add_option("--record", arguments.record,
                   "Variables to record instead of the scenario's choice, e.g. 'drive.*'; may be repeated")
      ->type_name("GLOB")
      ->allow_extra_args(false);
  run_command->add_option("--threads", arguments.threads, "At most so many threads (default: as many as pay)")
      ->check(CLI::Range(1, 255));
  run_command->add_option("--json", arguments.json, "Write the summary as JSON, to stdout with -")->type_name("FILE|-");
  run_command->add_flag("--real-time", arguments.real_time, "A second of the scenario takes a second");
  run_command->add_flag("--quiet", arguments.quiet, "No progress bar and no table");

  CLI::App* units_command = app.add_subcommand("units", "List the units that a scenario may use");

  std::string source;
  bool json = false;
  CLI::App* describe_command = app.add_subcommand("describe", "Show the variables of a unit");
  describe_command->add_option("UNIT", source, "A scenario's source, e.g. 'unit:drive_train?robot=lwr4'")->required();
  describe_command->add_flag("--json", json, "As JSON");

  fs::path folder;
  std::string robot = "lwr4";
  CLI::App* reference_command = app.add_subcommand("reference", "Write one page of Markdown per unit");
  reference_command->add_option("DIR", folder, "Folder for the pages")->required();
  reference_command->add_option("--robot", robot, "Robot whose sizes and start values are shown")->capture_default_str();

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitDone : kExitBadInput;
  }
  arguments.has_stop = stop->count() > 0;
  try {
    if (*run_command) return run(arguments);
    if (*units_command) return list_units();
    if (*describe_command) return describe_source(source, json);
    if (*reference_command) return write_reference(folder, robot);
  } catch (const std::exception& error) {
    std::cerr << "cotwin: " << error.what() << '\n';
    return kExitBadInput;
  }
  return kExitBadInput;
}
