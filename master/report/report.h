#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/trajectory/columns.h"

/// The report of one or several runs or tunings as one HTML page (docs/report.md).
namespace cotwin::report {

struct PageOptions {
  std::vector<std::filesystem::path> results;  // folders, or recordings (CSV); the first one is the reference of comparisons
  std::filesystem::path out;                   // empty: default_page()
  std::vector<std::string> signals;            // patterns of the columns to plot; empty: all
  std::string version;                         // of the program, for the last line
  trajectory::TimeColumn time = {};            // of recordings that are no folders
};

struct WrittenPage {
  std::filesystem::path file;
  std::string lacking;             // what the page lacks and why: one sentence; empty if nothing
  std::vector<std::string> notes;  // what is missing, damaged or does not fit; also on the page
};

/// Where a page is written by default: report.html in the folder of a result, comparison.html in the first one of several; beside a
/// recording: <name>.report.html.
std::filesystem::path default_page(const std::vector<std::filesystem::path>& results);

/// Reads the results and writes the page. Throws Error for results that do not exist or have nothing that can be read, and if the
/// page cannot be written.
WrittenPage write_page(const PageOptions& options);

}  // namespace cotwin::report
