// cotwin plot: a chart of recorded signals.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "master/engine/wiring/members.h"
#include "master/program/commands/commands.h"
#include "master/program/time_options.h"
#include "master/report/chart.h"
#include "master/results/results.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct PlotArguments {
  fs::path results, out;
  std::vector<std::string> patterns;
  std::optional<double> from, to;
  TimeOptions time;
  std::string title;
  int width = 1000, height = 0;
};

/// The recording of a folder of results, also of a run that goes on or was killed.
fs::path recording_of(const fs::path& results) {
  if (!fs::is_directory(results) || csv::is_bag(results)) return results;
  for (const char* name : {"signals.csv", "signals.csv.part"}) {
    if (fs::exists(results / name)) return results / name;
  }
  throw Error(results.string(), "has no signals.csv, expected the folder of a run's results, or a CSV file");
}

/// What the run.json beside the recording tells of its columns; nothing if there is no such file.
report::ColumnFacts facts_of(const fs::path& recording) {
  const fs::path file = recording.parent_path() / "run.json";
  std::ifstream in(file);
  if (!in) return {};
  try {
    return report::column_facts(nlohmann::json::parse(in));
  } catch (const nlohmann::json::exception&) {
    std::cerr << "cotwin: warning: " << file.string() << ": cannot be read; the chart has no units of measure\n";
    return {};
  }
}

/// The rows of the chosen signals from `from` to `to`.
struct Table {
  std::vector<std::string> names;
  std::vector<double> t;                     // s
  std::vector<std::vector<double>> columns;  // NaN: gaps
};

/// Reads only the columns of the patterns. What is left out goes to stderr. `in_file`, `facts`: of the columns by their names in the file, and by
/// their own.
Table read(const PlotArguments& a, const fs::path& recording, const trajectory::TimeColumn& time,
           const report::ColumnFacts& in_file, const report::ColumnFacts& facts) {
  report::RowReader rows(recording, time, {}, in_file);
  std::vector<std::size_t> chosen;
  Table table;
  for (const std::string& pattern : a.patterns) {
    bool any = false;
    for (std::size_t i = 0; i < rows.names().size(); ++i) {
      const auto fact = facts.find(rows.names()[i]);
      if (!report::selects(pattern, rows.names()[i], fact != facts.end() ? fact->second.joint : "")) continue;
      any = true;
      if (std::ranges::find(chosen, i) != chosen.end()) continue;
      chosen.push_back(i);
      table.names.push_back(rows.names()[i]);
    }
    if (!any) throw report::no_signal(recording.string(), pattern, rows.names());
  }
  constexpr std::size_t kMostCurves = 100;
  if (chosen.size() > kMostCurves)
    throw Error(recording.string(),
                std::to_string(chosen.size()) + " signals, expected " + std::to_string(kMostCurves) + " at most in one chart");
  rows.only(chosen);
  table.columns.resize(chosen.size());
  bool any = false;
  while (rows.next()) {
    any = true;
    if (rows.t() < a.from.value_or(rows.t()) || rows.t() > a.to.value_or(rows.t())) continue;
    table.t.push_back(rows.t());
    for (std::size_t c = 0; c < chosen.size(); ++c) table.columns[c].push_back(rows.value(chosen[c]));
  }
  if (!any) rows.check_that_rows_were_read();
  for (const std::string& note : rows.notes()) std::cerr << "cotwin: note: " << note << '\n';
  if (table.t.empty()) throw Error(recording.string(), "has no rows in this time, expected one or more");
  return table;
}

/// The panels of a pattern: one per unit of measure.
std::vector<plot::Panel> panels_of(const std::string& pattern, const Table& table, const report::ColumnFacts& facts) {
  std::vector<plot::Panel> panels;
  for (std::size_t c = 0; c < table.names.size(); ++c) {
    const std::string& column = table.names[c];
    const auto found = facts.find(column);
    if (!report::selects(pattern, column, found != facts.end() ? found->second.joint : "")) continue;
    const std::string unit = found == facts.end() ? "" : found->second.unit;
    auto panel = std::find_if(panels.begin(), panels.end(), [&](const plot::Panel& p) { return p.unit == unit; });
    if (panel == panels.end()) panel = panels.insert(panels.end(), plot::Panel{unit, {}});
    panel->curves.push_back({report::shown_name(facts, column), table.t, table.columns[c]});
  }
  return panels;
}

plot::Format format_of(const fs::path& file) {
  const std::string ending = file.extension().string();
  if (ending == ".svg") return plot::Format::kSvg;
  if (ending == ".png") return plot::Format::kPng;
  if (ending == ".pdf") return plot::Format::kPdf;
  throw Error(file.string(), "expected a name that ends in .svg, .png or .pdf");
}

int plot_command(const PlotArguments& a) {
  if (a.from && a.to && !(*a.from < *a.to))
    throw Error("--from, --to",
                text::to_text(*a.from) + " s to " + text::to_text(*a.to) + " s, expected a time and a later one");
  const fs::path recording = recording_of(a.results);
  const fs::path out = a.out.empty() ? (recording / "").parent_path().parent_path() / "plot.svg" : a.out;
  const plot::Format format = format_of(out);
  report::ColumnFacts facts;
  const report::ColumnFacts in_file = facts_of(recording);
  for (const auto& [name, fact] : in_file) facts.emplace(fact.name, fact);
  const Table table = read(a, recording, a.time.chosen({&a.results, 1}), in_file, facts);
  plot::Chart chart;
  chart.title = a.title.empty() ? a.results.string() : a.title;
  chart.width = a.width;
  chart.height = a.height;
  for (const std::string& pattern : a.patterns) {
    for (plot::Panel& panel : panels_of(pattern, table, facts)) {
      const auto is_finite = [](double y) { return std::isfinite(y); };
      if (std::ranges::none_of(panel.curves, [&](const plot::Curve& c) { return std::ranges::any_of(c.y, is_finite); }))
        throw Error(recording.string(), in_quotes(pattern) + " has no finite value in this time, expected one or more");
      for (plot::Curve& curve : panel.curves) curve = plot::thinned(std::move(curve), static_cast<std::size_t>(a.width));
      chart.panels.push_back(std::move(panel));
    }
  }
  constexpr std::size_t kMostPanels = 20;
  if (chart.panels.size() > kMostPanels)
    throw Error(recording.string(), std::to_string(chart.panels.size()) + " charts one below the other, expected " +
                                        std::to_string(kMostPanels) + " at most");
  write_file(out, plot::draw(chart, format));
  std::cout << out.string() << '\n';
  return kExitDone;
}

}  // namespace

void add_plot(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<PlotArguments>();
  CLI::App* command = app.add_subcommand("plot", "Draw recorded signals as SVG, PNG or PDF, with gnuplot");
  command->add_option("RESULTS", all->results, "Folder with the results of a run, a CSV file or a ROS bag")
      ->type_name("FOLDER|FILE")
      ->required();
  command
      ->add_option(
          "SIGNALS", all->patterns,
          "Signals, e.g. 'drive.tau_J' (all elements) or 'drive.*'; each pattern gets a chart, several if its signals have "
          "several units of measure")
      ->type_name("GLOB")
      ->required();
  command->add_option("-o,--out", all->out, "Picture, .svg, .png or .pdf (default: plot.svg beside the recording)")
      ->type_name("FILE");
  command->add_option("--from", all->from, "First time in seconds")->check(kNumber)->type_name("SECONDS");
  command->add_option("--to", all->to, "Last time in seconds")->check(kNumber)->type_name("SECONDS");
  all->time.add_to(*command);
  all->time.add_topic_to(*command);
  command->add_option("--title", all->title, "Title (default: RESULTS)")->type_name("TEXT");
  command->add_option("--width", all->width, "Width in pixels")
      ->check(CLI::Range(200, 10000))
      ->type_name("N")
      ->capture_default_str();
  command->add_option("--height", all->height, "Height in pixels (default: by the number of charts)")
      ->check(CLI::Range(100, 20000))
      ->type_name("N");
  command->callback([all, &chosen] { chosen = [all] { return plot_command(*all); }; });
}

}  // namespace cotwin::master
