// cotwin plot: a chart of recorded signals.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "master/engine/members.h"
#include "master/program/commands/commands.h"
#include "master/program/plot/chart.h"
#include "models/support/atomic_file.h"
#include "models/support/csv.h"
#include "models/support/error.h"
#include "models/support/text.h"
#include "models/trajectory/columns.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct Arguments {
  fs::path results, out;
  std::vector<std::string> patterns;
  std::optional<double> from, to;
  std::string title;
  int width = 1000, height = 0;
};

/// The recording of a folder of results, also of a run that goes on or was killed.
fs::path recording_of(const fs::path& results) {
  if (!fs::is_directory(results)) return results;
  for (const char* name : {"signals.csv", "signals.csv.part"}) {
    if (fs::exists(results / name)) return results / name;
  }
  throw Error(results.string(), "has no signals.csv, expected the folder of a run's results, or a CSV file");
}

/// Units of measure by variable, from the run.json beside the recording; none if there is no such file.
std::map<std::string, std::string> units_of(const fs::path& recording) {
  std::map<std::string, std::string> units;
  const fs::path file = recording.parent_path() / "run.json";
  std::ifstream in(file);
  if (!in) return units;
  try {
    const nlohmann::json columns = nlohmann::json::parse(in).at("recording").at("columns");
    for (const nlohmann::json& column : columns)
      units[column.at("name").get<std::string>()] = column.at("unit").get<std::string>();
  } catch (const nlohmann::json::exception&) {
    std::cerr << "cotwin: warning: " << file.string() << ": cannot be read; the chart has no units of measure\n";
  }
  return units;
}

std::string without_element(const std::string& column) {
  return column.empty() || column.back() != ']' ? column : column.substr(0, column.rfind('['));
}

/// Whether the pattern selects the column, by its own name or by that of its vector.
bool is_of(const std::string& pattern, const std::string& column) {
  return glob(pattern, column) || glob(pattern, without_element(column));
}

/// The panels of a pattern: one per unit of measure.
std::vector<plot::Panel> panels_of(const std::string& pattern, const csv::Table& table, std::size_t time,
                                   const std::map<std::string, std::string>& units) {
  std::vector<plot::Panel> panels;
  for (const std::string& column : table.names) {
    const std::string variable = without_element(column);
    if (column == table.names[time] || !is_of(pattern, column)) continue;
    std::string unit;
    if (const auto found = units.find(column); found != units.end())
      unit = found->second;
    else if (const auto whole = units.find(variable); whole != units.end())
      unit = whole->second;
    auto panel = std::find_if(panels.begin(), panels.end(), [&](const plot::Panel& p) { return p.unit == unit; });
    if (panel == panels.end()) panel = panels.insert(panels.end(), plot::Panel{unit, {}});
    panel->curves.push_back({column, table.columns[time], table.column(column)});
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

int plot_command(const Arguments& a) {
  if (a.from && a.to && !(*a.from < *a.to))
    throw Error("--from, --to",
                text::to_text(*a.from) + " s to " + text::to_text(*a.to) + " s, expected a time and a later one");
  const fs::path recording = recording_of(a.results);
  const fs::path out = a.out.empty() ? recording.parent_path() / "plot.svg" : a.out;
  const plot::Format format = format_of(out);
  // Reads only the columns of the patterns.
  std::vector<std::string> columns, all;
  {
    const csv::Reader header(recording);
    const std::size_t time = trajectory::find_time_column(header, recording.string(), "");
    all = header.names();
    columns.push_back(all[time]);
    all.erase(all.begin() + static_cast<std::ptrdiff_t>(time));
  }
  for (const std::string& pattern : a.patterns) {
    bool any = false;
    for (const std::string& column : all) {
      if (!is_of(pattern, column)) continue;
      any = true;
      if (std::find(columns.begin(), columns.end(), column) == columns.end()) columns.push_back(column);
    }
    if (!any)
      throw Error(recording.string(), "no signal " + in_quotes(pattern) + suggestion(pattern, all) + "; there are " +
                                          std::to_string(all.size()) +
                                          (all.empty() ? "" : ", the first is " + in_quotes(all.front())));
  }
  constexpr std::size_t kMostCurves = 100, kMostPanels = 20;
  if (columns.size() > kMostCurves + 1)
    throw Error(recording.string(), std::to_string(columns.size() - 1) + " signals, expected " + std::to_string(kMostCurves) +
                                        " at most in one chart");
  csv::Table table = csv::load(recording, columns);
  if (a.from || a.to) {
    const std::vector<double>& t = table.columns[0];
    const auto begin = a.from ? std::lower_bound(t.begin(), t.end(), *a.from) - t.begin() : 0;
    const auto end = a.to ? std::upper_bound(t.begin(), t.end(), *a.to) - t.begin() : static_cast<std::ptrdiff_t>(t.size());
    for (std::vector<double>& column : table.columns)
      column = std::vector<double>(column.begin() + begin, column.begin() + std::max(begin, end));
  }
  if (table.columns[0].empty()) throw Error(recording.string(), "has no rows in this time, expected one or more");
  plot::Chart chart;
  chart.title = a.title.empty() ? a.results.string() : a.title;
  chart.width = a.width;
  chart.height = a.height;
  const std::map<std::string, std::string> units = units_of(recording);
  for (const std::string& pattern : a.patterns) {
    for (plot::Panel& panel : panels_of(pattern, table, 0, units)) {
      const auto is_finite = [](double y) { return std::isfinite(y); };
      if (std::ranges::none_of(panel.curves, [&](const plot::Curve& c) { return std::ranges::any_of(c.y, is_finite); }))
        throw Error(recording.string(), in_quotes(pattern) + " has no finite value in this time, expected one or more");
      for (plot::Curve& curve : panel.curves) curve = plot::thinned(std::move(curve), static_cast<std::size_t>(a.width));
      chart.panels.push_back(std::move(panel));
    }
  }
  if (chart.panels.size() > kMostPanels)
    throw Error(recording.string(), std::to_string(chart.panels.size()) + " charts one below the other, expected " +
                                        std::to_string(kMostPanels) + " at most");
  write_file(out, plot::draw(chart, format));
  std::cout << out.string() << '\n';
  return kExitDone;
}

}  // namespace

void add_plot(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("plot", "Draw recorded signals as SVG, PNG or PDF, with gnuplot");
  command->add_option("RESULTS", all->results, "Folder with the results of a run, or a CSV file")
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
  command->add_option("--from", all->from, "First time in seconds")->type_name("SECONDS");
  command->add_option("--to", all->to, "Last time in seconds")->type_name("SECONDS");
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
