#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/scenario/scenario.h"
#include "master/scenery/recorded.h"
#include "models/trajectory/columns.h"

/// `cotwin view`: results as one HTML page that needs nothing else: robots, scene and contacts in 3D over time, with plots beside.
namespace cotwin::master {

struct ViewOptions {
  std::filesystem::path results;     // folder of a run, or a recording (CSV)
  std::filesystem::path scenario;    // empty: that of the run
  std::string robot;                 // name or URDF, in place of the scenario's robots; empty: those
  std::filesystem::path out;         // empty: view.html in the folder of the recording
  std::vector<std::string> plots;    // signals to plot at the beginning, also as patterns; empty: chosen
  trajectory::TimeColumn time = {};  // of a recording that is no folder
  /// The folders with robots and scenes for a scenario in this folder, which may be empty.
  std::function<std::vector<std::filesystem::path>(const std::filesystem::path&)> model_folders;
  /// Gets what is done at present, and the share of it that is done.
  std::function<void(const std::string& what, double share)> progress;
};

struct ViewSummary {
  std::filesystem::path page;
  std::size_t rows = 0, columns = 0, robots = 0, bodies = 0, bytes = 0;
  std::vector<std::string> remarks;  // what is not shown, and why; also on the page
};

/// The page without a recording, as the build made it from master/view/page. Throws Error if this build has none.
std::filesystem::path empty_page();

/// The signals to plot at the beginning: those that the scenario compares or reports, then vectors of the recording, then others. Some may not
/// be recorded. `scenario`: nullptr: none.
std::vector<std::string> first_plots(const Scenario* scenario, const Recorded& recorded);

/// Writes the page. Throws Error for results that cannot be read or a page that cannot be written.
ViewSummary write_view(const ViewOptions& options, std::span<const UnitType> types);

}  // namespace cotwin::master
