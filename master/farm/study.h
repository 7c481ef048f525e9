#pragma once
#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "master/farm/design.h"

namespace cotwin::master {

/// A study: a scenario, what varies in its runs, and what is kept of each. As JSON, with only "scenario" and "vary" or "table" required:
///   "name"      of the study; default: that of its file
///   "scenario"  system structure (.ssd) or package (.ssp), relative to the study
///   "vary"      {factor: {"uniform": [low, high]}, …}: distributions with the names of kDistributionWords, perhaps truncated by "min"
///               and "max"; {"values": [1, 2]} or {"from": 0, "to": 1, "points": 5}
///   "table"     in place of "vary" a CSV file with a column per factor and a row per run
///   "design"    how the runs fill the space, of kDesignWords; default: latin_hypercube
///   "runs"      their number; a grid and a table have their own
///   "seed"      of latin_hypercube and random; default: 1
///   "set"       assignments for all runs, as for `cotwin run --set`; {factor} in them is its value
///   "keep"      of each run: "end NAME", "min NAME", "max NAME" or "peak NAME" (largest magnitude) of each element of a variable, and
///               "figures", all of the summary; default: "figures"
///   "success"   conditions on what is kept or on a variable at the end, "peak world.force<30", that all must hold
///   "stop_s"    stop time; default: the scenario's
///   "limit_s"   wall time of a run, s, at which it ends as failed; default: 600
/// A factor is what --set can name: a variable, one of its elements, a setting, or a name that stands in braces in "set".
struct Study {
  std::string name;
  std::filesystem::path scenario;  // absolute
  Design design;
  std::filesystem::path table;  // absolute; empty: none
  std::vector<std::string> set, keep, success;
  std::optional<double> stop;  // s
  double limit = 600;          // s
  std::string text;            // the study as JSON with absolute paths, on one line

  /// What `cotwin run --set` gets for these values of the factors, in this order.
  std::vector<std::string> assignments(const std::vector<std::string>& point) const;
};

/// Reads a study. `place`: for messages; `folder`: of relative paths. Throws Error.
Study read_study(const nlohmann::ordered_json& study, const std::string& place, const std::filesystem::path& folder);

/// The member of "vary" that an option names: LOW:HIGH, DISTRIBUTION:NUMBER:NUMBER, or VALUE,VALUE,….
nlohmann::ordered_json distribution_of(std::string_view text);

}  // namespace cotwin::master
