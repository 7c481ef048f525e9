#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"

/// Finds the value of a parameter at which a condition begins or ceases to hold, by bisection over runs.
namespace cotwin::master {

struct SearchSettings {
  std::filesystem::path file;  // the scenario
  std::string vary, until;     // "component.variable=LOW:HIGH"; "component.variable>0.1"
  std::vector<std::string> set, peaks;
  double tolerance = 1e-3;
  std::optional<double> stop;  // s
  std::optional<int> threads;
};

struct SearchRun {
  double value = 0;
  bool holds = false;
  double time = 0;            // s: when the condition held first, otherwise the end of the run
  std::vector<double> peaks;  // largest magnitudes up to then
};

/// All must be given.
struct SearchHooks {
  std::function<bool()> stops;                   // asked before each tick: whether the search ends here
  std::function<void(const std::string&)> warn;  // of a run; not again where only numbers differ
  std::function<void(const SearchRun&)> ended;   // after each run
};

class ParameterSearch {
 public:
  /// Throws Error for a scenario, variable or interval that cannot be searched.
  ParameterSearch(const SearchSettings& settings, std::span<const UnitType> types, SearchHooks hooks);
  ~ParameterSearch();

  /// Returns false if it was stopped. Throws Error if the condition holds at both ends or at neither, and for a run that fails.
  bool search();
  /// Whether a run has begun and not ended.
  bool runs() const;

  const std::string& scenario() const;
  const std::string& variable() const;
  /// The interval in which the condition changes, its middle, and whether the condition holds above it.
  double low() const;
  double high() const;
  double critical() const;
  bool holds_above() const;
  const std::vector<SearchRun>& made() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::master
