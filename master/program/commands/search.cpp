// cotwin search: finds the value of a parameter at which a condition begins or ceases to hold, by bisection over runs.
#include <algorithm>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "master/engine/wiring/members.h"
#include "master/program/commands/commands.h"
#include "master/program/interrupt.h"
#include "master/program/watch.h"
#include "master/scenario/scenario.h"
#include "master/workflows/parameter_search.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

struct SearchArguments : SearchSettings {
  std::string json;
  bool quiet = false;

  bool shows() const { return !quiet && json != "-"; }
};

void print_head(const SearchArguments& arguments) {
  std::cout << arguments.vary.substr(0, arguments.vary.find('=')) << ": " << arguments.until;
  for (const std::string& name : arguments.peaks) std::cout << ", largest " << name;
  std::cout << '\n';
}

void print(const SearchRun& run) {
  std::cout << text::to_text(run.value, 10) << ": "
            << (run.holds ? "holds at " + text::to_text(run.time, 6) + " s" : "does not hold");
  for (const double peak : run.peaks) std::cout << ", " << text::to_text(peak, 8);
  std::cout << std::endl;
}

SearchHooks hooks_of(const SearchArguments& arguments) {
  return {[] { return stop_signal() != 0; },
          [](const std::string& warning) { std::cerr << "cotwin: warning: " << warning << '\n'; },
          [&arguments](const SearchRun& run) {
            if (arguments.shows()) print(run);
          }};
}

void report(const SearchArguments& arguments, const ParameterSearch& search) {
  const double critical = search.critical();
  if (arguments.shows()) {
    std::cout << search.variable() << " = " << text::to_text(critical, 8) << " (" << text::to_text(search.low(), 10) << " to "
              << text::to_text(search.high(), 10) << "): " << arguments.until << " holds "
              << (search.holds_above() ? "above" : "below") << '\n';
  }
  if (arguments.json.empty()) return;
  nlohmann::ordered_json j;
  j["scenario"] = search.scenario();
  j["variable"] = search.variable();
  j["condition"] = arguments.until;
  j["critical"] = critical;
  j["low"] = search.low();
  j["high"] = search.high();
  j["holds"] = search.holds_above() ? "above" : "below";
  j["runs"] = nlohmann::ordered_json::array();
  for (const SearchRun& run : search.made()) {
    nlohmann::ordered_json one{{"value", run.value}, {"holds", run.holds}, {"time", run.time}};
    for (std::size_t k = 0; k < arguments.peaks.size(); ++k) one["peaks"][arguments.peaks[k]] = run.peaks[k];
    j["runs"].push_back(one);
  }
  if (arguments.json == "-") {
    std::cout << j.dump(2) << '\n';
  } else {
    write_file(arguments.json, j.dump(2) + "\n");
  }
}

}  // namespace

void add_search(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<SearchArguments>();
  CLI::App* command = app.add_subcommand(
      "search", "Find the value of a parameter at which a condition begins or ceases to hold, by bisection over runs");
  command->add_option("FILE", all->file, "System structure (.ssd) or package (.ssp)")->type_name("FILE")->required();
  command->add_option("--vary", all->vary, "Parameter and the interval that is searched, e.g. compliance.S_T=100:10000")
      ->type_name("NAME=LOW:HIGH")
      ->required();
  command
      ->add_option(
          "--until", all->until,
          "Condition that must hold at one end of the interval only, at any time of a run: a variable that is true or not\n"
          "0, or a comparison, e.g. 'world.pad.dent>0'. It ends the run")
      ->type_name("CONDITION")
      ->required();
  command
      ->add_option(
          "--tolerance", all->tolerance,
          "Width of the interval at which the search ends, relative to its larger end, or to the whole interval while\n"
          "it includes 0")
      ->type_name("SHARE")
      ->capture_default_str();
  command->add_option("--peak", all->peaks, "Variable whose largest magnitude in each run is told; may be repeated")
      ->type_name("NAME")
      ->allow_extra_args(false);
  command->add_option("--set", all->set, "As for cotwin run; may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  command->add_option("--stop,--stop-time", all->stop, "Stop time in seconds; replaces that of the file")->type_name("SECONDS");
  command->add_option("--threads", all->threads, "Largest number of threads (default: chosen automatically)")
      ->check(CLI::Range(1, 255))
      ->type_name("N");
  command->add_option("--json", all->json, "Write the result as JSON, to stdout with -")->type_name("FILE|-");
  command->add_flag("--quiet", all->quiet, "No table");
  command->footer(
      "Each run begins anew with the scenario's start values; nothing is recorded. Where the interval does not include 0, its\n"
      "geometric middle is tried. A run that fails ends the search with its error.");
  command->callback([all, &chosen] {
    chosen = [all] {
      if (!std::ranges::all_of(load_scenario(all->file).components, is_unit)) {
        const WatchOptions watch{.ended = [](pid_t, const std::string&) { return std::string(); }, .quiet = true};
        if (const std::optional<int> code = watch_run(watch)) return *code;
      }
      note_signals();
      ParameterSearch search(*all, units(), hooks_of(*all));
      try {
        if (all->shows()) print_head(*all);
        if (!search.search()) return kExitSignalled + stop_signal();
        report(*all, search);
        return static_cast<int>(kExitDone);
      } catch (const Error& error) {
        if (!search.runs()) throw;
        std::cerr << "cotwin: " << error.what() << '\n';
        return static_cast<int>(kExitRunFailed);
      }
    };
  });
}

}  // namespace cotwin::master
