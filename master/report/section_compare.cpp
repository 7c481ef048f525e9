// Several runs or tunings beside each other.
#include <algorithm>
#include <cmath>
#include <map>

#include "master/report/compare.h"
#include "master/report/energy_flow.h"
#include "master/report/sections.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::report {

namespace {

constexpr std::size_t kMostPlots = 24, kMostRows = 400;
constexpr std::size_t kMostBytes = 150;  // of a value

/// A table with a column per result; rows appear in the order in which they are first met.
class ComparisonTable {
 public:
  ComparisonTable(std::string what, std::span<const Results> all) : what_(std::move(what)), all_(all) {}
  void add(const std::string& row, std::size_t result, std::string text, bool is_number) {
    const auto [found, is_new] = index_.emplace(row, rows_.size());
    if (is_new) rows_.push_back({row, std::vector<std::string>(all_.size()), is_number});
    rows_[found->second].cells[result] = std::move(text);
  }
  void add(const std::string& row, std::size_t result, double value) {
    if (!std::isnan(value)) add(row, result, number(value), true);
  }
  void write(Page& page, const std::string& caption, bool only_different = false) const {
    std::vector<std::string> heads = {what_};
    for (const Results& results : all_) heads.push_back(results.name);
    Table table(heads);
    std::size_t shown = 0, more = 0;
    for (const Row& row : rows_) {
      const bool same = std::ranges::all_of(row.cells, [&](const std::string& cell) { return cell == row.cells.front(); });
      if (only_different && same) continue;
      if (shown++ >= kMostRows) {
        ++more;
        continue;
      }
      std::vector<Cell> cells = {Cell(row.name)};
      for (const std::string& text : row.cells) {
        cells.push_back(text.empty() ? Cell("–") : Cell::of_html(escaped(text, kMostBytes)));
        cells.back().is_number = row.is_number;
      }
      table.row(std::move(cells));
    }
    if (!table.empty())
      page.table(table, caption + (more > 0 ? " (" + std::to_string(more) + " more are left out)" : std::string()));
  }

 private:
  struct Row {
    std::string name;
    std::vector<std::string> cells;
    bool is_number;
  };
  std::string what_;
  std::span<const Results> all_;
  std::vector<Row> rows_;
  std::map<std::string, std::size_t> index_;
};

std::string value_text(const json& value) {
  std::string text = text_of(value);
  for (const json& element : list_of(value)) text::append(text, text_of(element), " ");
  return text;
}

void compare_parameters(Page& page, std::span<const Results> all) {
  ComparisonTable parameters("parameter", all);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (const json& given = member(all[i].record, "parameters"); all[i].is_run() && given.is_object()) {
      for (const auto& [name, entry] : given.items()) parameters.add(name, i, value_text(member(entry, "value")), false);
    }
  }
  parameters.write(page, "Parameters that differ", true);
}

void compare_origins(Page& page, std::span<const Results> all) {
  ComparisonTable facts("", all);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const json &record = all[i].record, &summary = all[i].summary;
    if (!all[i].is_run()) continue;
    facts.add("state", i, state_of(all[i]).words, false);
    facts.add("scenario", i, text_of(member(member(record, "scenario"), "name")), false);
    facts.add("hash of the scenario", i, text_of(member(member(record, "scenario"), "hash")), false);
    facts.add("version", i, text_of(member(member(record, "program"), "version")), false);
    facts.add("build", i, text_of(member(member(record, "program"), "build")), false);
    facts.add("given with --set", i, value_text(member(record, "set")), false);
    facts.add("reached [s]", i, number_of(member(record, "reached")));
    facts.add("tick [s]", i, number_of(member(record, "tick")));
    facts.add("times real time", i, number_of(member(summary, "real_time_factor")));
    facts.add("recorded rows", i, all[i].recording ? static_cast<double>(all[i].recording->rows) : std::nan(""));
  }
  facts.write(page, "");
}

void compare_summaries(Page& page, std::span<const Results> all) {
  ComparisonTable figures("figure", all), energy("energy [J]", all);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const json& summary = all[i].summary;
    for (const json& tally : list_of(member(summary, "signals"))) {
      const std::vector<double> rms = numbers_of(member(tally, "rms")), most = numbers_of(member(tally, "max"));
      for (const master::ElementKind& kind : kinds_of(tally, rms.size())) {
        const std::string name = with_unit(text_of(member(tally, "name")), kind.si);
        figures.add(name + ", RMS", i, master::joined_rms(kind.of(rms)));
        figures.add(name + ", largest", i, master::largest_of(kind.of(most)));
      }
    }
    for (const json& compared : list_of(member(summary, "comparisons"))) {
      const std::vector<double> most = numbers_of(member(compared, "max"));
      for (const master::ElementKind& kind : kinds_of(compared, most.size()))
        figures.add(with_unit(text_of(member(compared, "name")), kind.si) + ", largest |a − b|", i,
                    master::largest_of(kind.of(most)));
    }
    for (const json& work : list_of(member(summary, "energy")))
      energy.add(text_of(member(work, "name")), i, number_of(member(work, "value")));
    for (const json& bond : list_of(member(summary, "bonds")))
      energy.add("leak of " + text_of(member(bond, "name")), i, number_of(member(bond, "leak")));
    for (const EnergyFlow& flow : energy_flows(all[i])) {
      energy.add(flow.component + ": drawn from the mains", i, flow.drawn);
      for (const FlowEntry& entry : flow.sinks) energy.add(flow.component + ": to " + entry.name, i, entry.joules);
    }
  }
  figures.write(page, "Figures of the runs");
  energy.write(page, "Energy");
}

void compare_tunings(Page& page, std::span<const Results> all) {
  ComparisonTable table("torque error, RMS", all);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const json& f = all[i].figures;
    const std::string tuned = text_of(member(f, "tuned"));
    table.add("method", i, text_of(member(member(f, "settings"), "method")), false);
    table.add("weighted, training", i, number_of(member(member(f, "weighted_rms"), tuned.c_str())));
    const json::array_t& joints = list_of(member(f, "joints"));
    for (const char* part : {"training", "held_out"}) {
      const std::vector<double> rms = numbers_of(member(member(member(f, part), "rms"), tuned.c_str()));
      for (std::size_t j = 0; j < std::min(joints.size(), rms.size()); ++j)
        table.add(text_of(joints[j]) + (std::string(part) == "training" ? ", training" : ", held out"), i, rms[j]);
    }
  }
  table.write(page, "Tunings: errors of the robots that were written");
}

/// The curve of a column, or nullptr.
const RecordedColumn* plotted(const Results& results, const std::string& name) {
  const RecordedColumn* column = results.recording ? results.recording->find(name) : nullptr;
  return column != nullptr && column->plotted ? column : nullptr;
}

/// The element with the largest difference, of all runs on one plot.
void write_overlay(Page& page, std::span<const Results> all, const SignalDifference& difference, const Gnuplot& gnuplot) {
  std::size_t worst = 0;
  for (std::size_t i = 0; i < difference.curves.size(); ++i) {
    if (difference.curves[i].figures().largest() > difference.curves[worst].figures().largest()) worst = i;
  }
  const std::string& name = difference.elements[worst];
  Plot plot;
  plot.y_label = difference.unit == "1" ? "" : difference.unit;
  plot.description = name + " of all runs over time";
  for (std::size_t i = 0; i < all.size() && plot.lines.size() < kStyles; ++i) {
    if (const RecordedColumn* column = plotted(all[i], name))
      plot.lines.push_back({all[i].name, column->curve.points(), plot.lines.size()});
  }
  Artist(page, gnuplot).plot(std::move(plot), code(name) + " of all runs");
}

void compare_two(Page& page, std::span<const Results> all, std::size_t other, const Gnuplot& gnuplot, std::size_t& plots) {
  const Results &reference = all.front(), &b = all[other];
  page.heading(3, b.name + " against " + reference.name);
  if (!reference.recording || !b.recording) {
    page.note("One of them has no recording, so their signals cannot be compared.");
    return;
  }
  RecordingComparison comparison;
  try {
    comparison = compare_recordings(*reference.recording, *b.recording);
  } catch (const Error& error) {
    page.note(std::string("The recordings cannot be compared: ") + error.what());
    return;
  }
  const auto list_names = [&](const std::vector<std::string>& names, const std::string& place) {
    if (names.empty()) return;
    std::string text;
    for (std::size_t i = 0; i < std::min<std::size_t>(names.size(), 12); ++i) text += (i > 0 ? ", " : "") + names[i];
    page.note("Only in " + place + ": " + text +
              (names.size() > 12 ? " and " + std::to_string(names.size() - 12) + " more" : "") + ".");
  };
  list_names(comparison.only_in_reference, reference.name);
  list_names(comparison.only_in_other, b.name);
  if (comparison.rows == 0 || comparison.signals.empty()) {
    page.note(comparison.signals.empty() ? "They have no signal in common." : "They have no time in common.");
    return;
  }
  page.paragraph("Differences " + code(b.name + " − " + reference.name) + " at " + std::to_string(comparison.rows) +
                 " rows of the reference, t = " + escaped(number(comparison.begin, 7)) + " to " +
                 escaped(number(comparison.end, 7)) + " s; between rows linear.");
  Table table({"signal", "largest |difference|", "at t [s]", "of element", "RMS"});
  std::vector<const SignalDifference*> different;
  std::size_t equal = 0;
  for (const SignalDifference& signal : comparison.signals) {
    const double largest = signal.largest();
    if (largest == 0) {
      ++equal;
      continue;
    }
    double squares = 0, count = 0;
    std::size_t worst = 0;
    for (std::size_t i = 0; i < signal.curves.size(); ++i) {
      const Figures& f = signal.curves[i].figures();
      squares += f.squares;
      count += static_cast<double>(f.count);
      if (f.largest() > signal.curves[worst].figures().largest()) worst = i;
    }
    if (count == 0) {
      table.row({with_unit(signal.name, signal.unit), "no common values", "", "", ""});
      continue;
    }
    table.row({with_unit(signal.name, signal.unit), largest, signal.curves[worst].figures().t_of_largest(),
               element_of(*reference.recording, signal.elements[worst]), std::sqrt(squares / count)});
    different.push_back(&signal);
  }
  if (equal > 0)
    page.paragraph(std::to_string(equal) + " of " + std::to_string(comparison.signals.size()) + " signals are equal.");
  if (!table.empty()) page.table(table, "Signals that differ");
  for (const SignalDifference* signal : different) {
    if (++plots > kMostPlots) break;
    page.heading(4, with_unit(signal->name, signal->unit));
    Plot plot;
    plot.y_label = signal->unit == "1" ? "difference" : "difference " + signal->unit;
    plot.description = "Difference of " + signal->name + " between " + b.name + " and " + reference.name;
    for (std::size_t i = 0; i < std::min(signal->curves.size(), kStyles); ++i)
      plot.lines.push_back({element_of(*reference.recording, signal->elements[i]), signal->curves[i].points(), i});
    Artist(page, gnuplot).plot(std::move(plot), "Difference");
    write_overlay(page, all, *signal, gnuplot);
  }
}

}  // namespace

std::vector<master::ElementKind> kinds_of(const json& entry, std::size_t size) {
  return master::kinds_of(text_of(member(entry, "unit")), {{}, texts_of(member(entry, "units"))}, size);
}

std::string element_of(const LoadedRecording& recording, const std::string& name) {
  const RecordedColumn* column = recording.find(name);
  return element_of(column != nullptr ? *column : RecordedColumn{name, "", Curve(false), false, ""});
}

std::string element_of(const RecordedColumn& column) {
  if (!column.joint.empty()) return column.joint;
  const std::string &name = column.name, vector = vector_of(name);
  if (vector != name) return name.substr(vector.size());
  const std::size_t dot = name.rfind('.');
  return dot == std::string::npos || dot + 1 == name.size() ? name : name.substr(dot + 1);
}

void write_comparison(Page& page, std::span<const Results> all, const Gnuplot& gnuplot) {
  page.heading(2, "Comparison");
  if (std::ranges::any_of(all, &Results::is_tuning)) compare_tunings(page, all);
  if (std::ranges::none_of(all, &Results::is_run)) return;
  compare_summaries(page, all);
  compare_parameters(page, all);
  std::size_t plots = 0;
  for (std::size_t i = 1; i < all.size(); ++i) compare_two(page, all, i, gnuplot, plots);
  if (plots > kMostPlots) page.note("More signals differ than are plotted; --signals chooses them.");
  page.heading(3, "Origin of the runs");
  compare_origins(page, all);
}

}  // namespace cotwin::report
