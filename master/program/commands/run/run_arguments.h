#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "master/program/commands/commands.h"
#include "master/workflows/fmu_run.h"

namespace cotwin::master {

inline constexpr const char* kAnyPort = "true";  // what a flag without a value gives

/// The options of `cotwin run`.
struct RunArguments {
  std::filesystem::path file, out, resume;
  std::vector<std::string> set, record, attach, detach, events, waypoints;
  std::string json;
  std::optional<double> stop;
  bool real_time = false, quiet = false, overwrite = false, report = false;
  bool joint_names = false, no_view_data = false;
  std::string clock, cpus;  // empty: the scenario's
  std::optional<OverrunPolicy> overrun;
  std::optional<int> priority;
  std::string view;                    // --view: a port, or kAnyPort; empty: not given
  std::string local_writes = "owner";  // of the server of --view
  double checkpoint = 10;              // s of wall time; 0: none
  std::optional<int> threads;
  std::optional<CouplingChoice> coupling;
  FmuRunOptions fmu;              // for a single FMU
  bool plain = false;             // gateways of the scenario show no page of the run
  std::function<void()> started;  // empty: nothing
};

/// The options that determine a run, as JSON for its checkpoints.
std::string options_of(const RunArguments& arguments);
/// Reads the text of options_of(). Throws Error at `place` for other text.
void read_options(const std::string& text, const std::string& place, RunArguments& arguments);

/// Return the exit code. Throw Error for bad input.
int run_scenario(RunArguments arguments);
int run_fmu(RunArguments arguments);

/// Makes the path of a file absolute, which an FMU that calls chdir() does not move; "-" is stdout.
void locate(std::string& file);

}  // namespace cotwin::master
