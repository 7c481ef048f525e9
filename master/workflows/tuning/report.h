#pragma once
#include <iosfwd>
#include <string>

#include "master/workflows/tuning/tuning.h"

namespace cotwin::master::tuning {

/// The tables per joint, for a terminal.
void write_table(std::ostream& out, const Data& data, const Result& result);
/// The result of --check, for a terminal and for programs.
void write_check(std::ostream& out, const Data& data, const LogCheck& check);
std::string check_json(const Data& data, const LogCheck& check);
/// report.md: data, settings, errors, parameters with standard deviations, what the data do not determine.
std::string report_markdown(const Settings& settings, const Data& data, const Result& result);
/// figures.json: the same numbers for programs.
std::string figures_json(const Settings& settings, const Data& data, const Result& result);

}  // namespace cotwin::master::tuning
