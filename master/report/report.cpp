#include "master/report/report.h"

#include <algorithm>

#include "master/report/sections.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"

namespace cotwin::report {

namespace fs = std::filesystem;

namespace {

std::string title_of(const std::vector<Results>& all) {
  if (all.size() > 1) return "Comparison of " + std::to_string(all.size()) + " results";
  const Results& results = all.front();
  if (results.is_tuning()) {
    const std::string robot = text_of(member(results.figures, "robot"));
    return "Tuning of " + (robot.empty() ? results.name : robot);
  }
  const std::string scenario = text_of(member(member(results.record, "scenario"), "name"));
  return "Run of " + (scenario.empty() ? results.name : scenario);
}

/// Throws Error for a pattern that selects no column of any recording.
void check_signals(const std::vector<std::string>& patterns, const std::vector<Results>& all) {
  std::vector<std::string> columns, joints;
  for (const Results& results : all) {
    if (!results.recording) continue;
    for (const RecordedColumn& column : results.recording->columns) {
      columns.push_back(column.name);
      joints.push_back(column.joint);
    }
  }
  for (const std::string& pattern : patterns) {
    bool any = false;
    for (std::size_t i = 0; i < columns.size() && !any; ++i) any = selects(pattern, columns[i], joints[i]);
    if (!any) throw no_signal("--signals", pattern, columns);
  }
}

}  // namespace

fs::path default_page(const std::vector<fs::path>& results) {
  std::error_code none;
  const fs::path& first = results.front();
  const char* name = results.size() > 1 ? "comparison.html" : "report.html";
  if (fs::is_directory(first, none)) return first / name;
  return results.size() > 1 ? first.parent_path() / name : first.parent_path() / (first.stem().string() + ".report.html");
}

WrittenPage write_page(const PageOptions& options) {
  if (options.results.empty()) throw Error("RESULTS", "are missing, expected folders with results, or recordings (CSV)");
  std::vector<Results> all;
  for (const fs::path& place : options.results) all.push_back(load_results(place, options.signals, options.time));
  check_signals(options.signals, all);
  WrittenPage written;
  for (const Results& results : all) {
    const std::string place = all.size() > 1 ? results.name + ": " : "";
    for (const std::string& note : results.notes) written.notes.push_back(place + note);
    if (!results.recording) continue;
    for (const std::string& note : results.recording->notes) written.notes.push_back(place + note);
  }
  written.file = options.out.empty() ? default_page(options.results) : options.out;
  for (const fs::path& place : options.results) {
    std::error_code none;
    if (fs::equivalent(place, written.file, none))
      throw Error(written.file.string(), "is one of the results, expected another file");
  }
  const Gnuplot gnuplot;
  Page page(title_of(all));
  if (!gnuplot.available()) {
    written.lacking = "the page has tables and no plots: " + gnuplot.lacking();
    page.note("Plots are missing: " + gnuplot.lacking() + ".");
  }
  if (all.size() > 1) write_comparison(page, all, gnuplot);
  for (const Results& results : all) {
    if (results.is_tuning()) write_tuning(page, results, gnuplot);
    if (results.is_run()) write_run(page, results, gnuplot);
  }
  write_file(written.file, page.html(escaped("Written by cotwin report " + options.version +
                                             (gnuplot.available() ? ", plots by " + gnuplot.version() : std::string()) + ".")));
  return written;
}

}  // namespace cotwin::report
