#pragma once
#include <CLI/CLI.hpp>
#include <filesystem>
#include <span>
#include <string>

#include "models/trajectory/columns.h"

/// Options of commands that read recordings: which column is the time, and its unit.
namespace cotwin::master {

struct TimeOptions {
  std::string column, unit = "s", topic;  // of --t-column, --time-unit and --topic

  /// Adds --t-column and --time-unit, which set this object, or --topic.
  void add_to(CLI::App& command);
  void add_topic_to(CLI::App& command);
  /// What was given, for these places. Throws Error for a unit that is none, for a scenario in place of its results, and if something was given and all places are folders.
  trajectory::TimeColumn chosen(std::span<const std::filesystem::path> places) const;
};

}  // namespace cotwin::master
