#pragma once
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/identity.h"
#include "master/scenario/folders.h"

/// The subcommands of the program `cotwin`, one file each.
namespace cotwin::master {

enum ExitCode { kExitDone = 0, kExitRunFailed = 1, kExitBadInput = 2, kExitSignalled = 128 };  // 128 + the signal's number

/// The chosen command. Returns the exit code. Throws Error for bad input.
using Chosen = std::function<int()>;

/// Add subcommands to the program. The one that is named on the command line sets `chosen`.
void add_run(CLI::App& app, Chosen& chosen);
void add_anomaly(CLI::App& app, Chosen& chosen);
void add_pack(CLI::App& app, Chosen& chosen);
void add_inspection(CLI::App& app, Chosen& chosen);  // info, check
void add_catalogue(CLI::App& app, Chosen& chosen);   // units, describe, reference
void add_tune(CLI::App& app, Chosen& chosen);
void add_excite(CLI::App& app, Chosen& chosen);
void add_perturb(CLI::App& app, Chosen& chosen);
void add_report(CLI::App& app, Chosen& chosen);
void add_cloud(CLI::App& app, Chosen& chosen);
void add_scan(CLI::App& app, Chosen& chosen);
void add_tool(CLI::App& app, Chosen& chosen);
void add_search(CLI::App& app, Chosen& chosen);
void add_farm(CLI::App& app, Chosen& chosen);
void add_fit_energy(CLI::App& app, Chosen& chosen);
void add_robot(CLI::App& app, Chosen& chosen);
void add_ask(CLI::App& app, Chosen& chosen);
void add_serve(CLI::App& app, Chosen& chosen);
void add_view(CLI::App& app, Chosen& chosen);
void add_new(CLI::App& app, Chosen& chosen);
void add_plot(CLI::App& app, Chosen& chosen);
void add_manual(CLI::App& app, Chosen& chosen);
void add_completion(CLI::App& app, Chosen& chosen);

/// Adds --unphysical: the word of robot::take_unphysical().
inline void add_unphysical(CLI::App& command, std::string& word) {
  command
      .add_option("--unphysical", word,
                  "Links with an inertia that no body can have, or none: an error, a warning (warn), or estimated (estimate)")
      ->check(CLI::IsMember({"error", "warn", "estimate"}))
      ->type_name("WORD")
      ->capture_default_str();
}

/// Refuses nan, which the ranges of CLI11 let pass because comparisons with it are false.
inline const CLI::Validator kNumber(
    [](std::string& text) {
      char* end = nullptr;
      return std::isnan(std::strtod(text.c_str(), &end)) ? "is " + text + ", expected a number" : std::string();
    },
    "");

/// What of `cotwin run` another command can choose.
struct ScenarioRun {
  std::filesystem::path file, out;
  std::vector<std::string> set, record;
  std::optional<double> stop{};  // s
  std::string view{};            // --view: a port, or "true" for any; empty: not given
  bool quiet = false, overwrite = false;
  bool resumable = true;               // checkpoints are written
  bool plain = false;                  // gateways of the scenario show no page of the run
  std::function<void()> started = {};  // called when the first tick is about to begin
};
/// Runs a scenario as `cotwin run` does. Returns the exit code. Throws Error.
int run_scenario(const ScenarioRun& run);

/// Writes the page of the results in a folder beside them (`cotwin report`) and, unless `quiet`, prints its name and what it lacks.
/// Errors go to stderr: results without a page are results.
void write_report_page(const std::filesystem::path& folder, bool quiet = false);

/// Returns the units of this program, of the modules in COTWIN_UNITS (separated by ':') and of those given by --units. Loads the
/// modules at the first call. Throws Error.
std::span<const UnitType> units();
/// Returns the folders with the FMU libraries of the modules' units.
std::vector<std::filesystem::path> libraries_of_modules();
/// Adds the option --units to a command.
void add_units_option(CLI::App& command);

/// Returns version and hash of this program with its modules, and the instruction set in use.
Build this_build();
/// Returns `name` with other characters than letters, digits, '-', '_' and '.' replaced, for a file or folder.
std::string file_name_of(const std::string& name);
/// Returns whether the path is an FMU: an archive (.fmu) or a folder with a modelDescription.xml.
bool is_fmu(const std::filesystem::path& path);

}  // namespace cotwin::master
