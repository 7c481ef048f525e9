#pragma once
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "master/workflows/tuning/settings.h"

namespace cotwin::master {

/// How the columns of a log are named and scaled, as options of a command.
struct LogOptions {
  std::string time_unit = "s", angle_unit = "rad";
  std::vector<double> q_offset_in_angle_unit;
  /// Writes them into settings whose other options are known. Throws Error.
  void apply(tuning::Settings& settings) const;
};

/// Adds the options; those that need no conversion write into `settings` directly. Both must outlive the command.
void add_log_options(CLI::App& command, LogOptions& options, tuning::Settings& settings);

}  // namespace cotwin::master
