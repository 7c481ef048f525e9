// The section of a run.
#include <algorithm>
#include <cmath>

#include "master/report/energy_flow.h"
#include "master/report/sections.h"
#include "models/foundation/support/text.h"

namespace cotwin::report {

namespace {

constexpr std::size_t kMostGroups = 60, kMostElements = 8, kMostRowsOfRun = 400, kMostSpansShown = 100;

/// "3.2 ms" in the unit that a reader expects.
std::string duration(double seconds) {
  if (!std::isfinite(seconds)) return "–";
  const double size = std::abs(seconds);
  if (size != 0 && size < 1e-6) return number(seconds * 1e9, 3) + " ns";
  if (size != 0 && size < 1e-3) return number(seconds * 1e6, 3) + " µs";
  if (size != 0 && size < 1) return number(seconds * 1e3, 3) + " ms";
  return number(seconds, 4) + " s";
}

/// A two-column table that leaves out what is not known.
class Facts {
 public:
  void add(const char* what, const std::string& text) {
    if (!text.empty()) table_.row({what, text});
  }
  void add_code(const char* what, const std::string& text) {
    if (!text.empty()) table_.row({what, Cell::of_html(code(text))});
  }
  void add_seconds(const char* what, const json& value) {
    if (value.is_number()) table_.row({what, duration(number_of(value))});
  }
  void write(Page& page) const {
    if (!table_.empty()) page.table(table_);
  }

 private:
  Table table_{{"", ""}, 2};
};

/// The first of two values that is there: files of a run repeat one another.
const json& either(const json& a, const json& b) { return a.is_null() ? b : a; }

std::string joined(const json& list, const char* between) {
  std::string all;
  for (const json& element : list_of(list)) all += (all.empty() ? "" : between) + text_of(element);
  return all;
}

void write_run_facts(Page& page, const Results& results) {
  const json &record = results.record, &summary = results.summary;
  page.heading(3, "Origin and machine");
  Facts facts;
  const json& scenario = member(record, "scenario");
  facts.add("scenario", scenario.is_object() ? text_of(member(scenario, "name")) : text_of(member(summary, "scenario")));
  facts.add_code("file", text_of(member(scenario, "file")));
  facts.add_code("hash of the scenario", text_of(member(scenario, "hash")));
  if (record.is_object() || summary.is_object()) facts.add("state", state_of(results).words);
  facts.add("begun", text_of(member(record, "begun")));
  facts.add("ended", text_of(member(record, "ended")));
  if (member(record, "resumed_at").is_number()) facts.add_seconds("resumed at", member(record, "resumed_at"));
  const double start = number_of(either(member(record, "start"), member(summary, "start")));
  const double reached = number_of(either(member(record, "reached"), member(summary, "reached")));
  if (std::isfinite(start) && std::isfinite(reached)) {
    facts.add("simulated", number(start, 9) + " s to " + number(reached, 9) + " s in " +
                               text_of(either(member(record, "ticks"), member(summary, "ticks"))) + " ticks of " +
                               duration(number_of(either(member(record, "tick"), member(summary, "tick")))));
  }
  const std::string threads = text_of(either(member(record, "threads"), member(summary, "threads")));
  if (const double wall = number_of(either(member(record, "wall_seconds"), member(summary, "wall_seconds"))); wall > 0) {
    facts.add("run in", duration(wall) + " on " + threads + (threads == "1" ? " thread, " : " threads, ") +
                            number((reached - start) / wall, 3) + " times real time");
  }
  facts.add("clock", text_of(either(member(record, "clock"), member(member(summary, "clock"), "kind"))));
  const json& program = member(record, "program");
  if (program.is_object())
    facts.add("program", "cotwin " + text_of(member(program, "version")) + ", build " + text_of(member(program, "build")));
  const json& machine = member(record, "machine");
  if (machine.is_object()) {
    facts.add("machine", text_of(member(machine, "host")) + ", " + text_of(member(machine, "system")) + ", " +
                             text_of(member(machine, "processors")) + " × " + text_of(member(machine, "processor")) + ", " +
                             text_of(member(machine, "instruction_set")));
  }
  facts.add_code("given with --set", joined(member(record, "set"), "  "));
  std::string settings;
  if (const json& all = member(record, "settings"); all.is_object()) {
    for (const auto& [name, value] : all.items()) text::append(settings, name + "=" + text_of(value));
  }
  facts.add_code("common settings", settings);
  if (results.recording) {
    const LoadedRecording& recording = *results.recording;
    facts.add("recording",
              recording.file.filename().string() + ": " + std::to_string(recording.rows) + " rows of " +
                  std::to_string(recording.columns.size()) + " columns" +
                  (recording.rows > 0 ? ", t = " + number(recording.begin, 9) + " to " + number(recording.end, 9) + " s"
                                      : std::string()));
  }
  facts.write(page);
  Table components({"component", "source", "stage", "period in ticks"}, 2);
  for (const json& component : list_of(member(record, "components"))) {
    components.row({text_of(member(component, "name")), Cell::of_html(code(text_of(member(component, "source")))),
                    text_of(member(component, "stage")), text_of(member(component, "period"))});
  }
  if (!components.empty()) page.table(components, "Components");
}

/// Figures by element of one kind: one row a figure, or one row an element if the vector is long. `names`: of the elements.
void write_elements(Page& page, const std::string& caption,
                    const std::vector<std::pair<std::string, std::vector<double>>>& rows, const std::vector<double>& all,
                    const std::vector<std::string>& names) {
  const std::size_t elements = names.size();
  std::vector<std::string> heads = {""};
  if (elements <= kMostElements) {
    for (const std::string& name : names) heads.push_back(elements == 1 && name.starts_with('[') ? "value" : name);
    if (elements > 1 && !all.empty()) heads.push_back("all");
    Table table(heads);
    for (std::size_t r = 0; r < rows.size(); ++r) {
      std::vector<Cell> cells = {rows[r].first};
      for (std::size_t i = 0; i < elements; ++i)
        cells.push_back(i < rows[r].second.size() ? Cell(rows[r].second[i]) : Cell(""));
      if (elements > 1 && r < all.size()) cells.push_back(std::isnan(all[r]) ? Cell("") : Cell(all[r]));
      table.row(std::move(cells));
    }
    page.table(table, caption);
    return;
  }
  for (const auto& [name, values] : rows) heads.push_back(name);
  Table table(heads);
  for (std::size_t i = 0; i < std::min(elements, kMostRowsOfRun); ++i) {
    std::vector<Cell> cells = {names[i]};
    for (const auto& [name, values] : rows) cells.push_back(i < values.size() ? Cell(values[i]) : Cell(""));
    table.row(std::move(cells));
  }
  page.table(table, caption + (elements > kMostRowsOfRun ? " (the first " + std::to_string(kMostRowsOfRun) + " elements)"
                                                         : std::string()));
}

/// The figures of an entry of the summary, a table for each unit of measure. `totals`: as many rows have one, of all elements of a table.
void write_entry(Page& page, const json& entry, const std::vector<std::pair<std::string, std::vector<double>>>& rows,
                 const std::string& time, bool totals) {
  std::size_t size = 0;
  for (const auto& [name, values] : rows) size = std::max(size, values.size());
  const std::vector<std::string> joints = texts_of(member(entry, "joints"));
  const std::string name = text_of(member(entry, "name")), what = text_of(member(entry, "what"));
  for (const master::ElementKind& kind : kinds_of(entry, size)) {
    std::vector<std::pair<std::string, std::vector<double>>> chosen;
    for (const auto& [figure, values] : rows) chosen.emplace_back(figure, kind.of(values));
    std::vector<double> all;
    if (totals)
      all = {master::joined_rms(chosen[0].second), master::largest_of(chosen[1].second),
             std::numeric_limits<double>::quiet_NaN()};
    std::vector<std::string> names;
    for (const std::size_t i : kind.elements)
      names.push_back(i < joints.size() ? joints[i] : "[" + std::to_string(i + 1) + "]");
    write_elements(page, with_unit(name, kind.si) + (name == what || what.empty() ? "" : ": " + what) + time, chosen, all,
                   names);
  }
}

void write_figures(Page& page, const json& summary) {
  const json::array_t &tallies = list_of(member(summary, "signals")), &comparisons = list_of(member(summary, "comparisons"));
  if (tallies.empty() && comparisons.empty()) return;
  page.heading(3, "Figures of the run");
  for (const json& tally : tallies) {
    write_entry(page, tally,
                {{"RMS", numbers_of(member(tally, "rms"))},
                 {"largest magnitude", numbers_of(member(tally, "max"))},
                 {"at t [s]", numbers_of(member(tally, "time_of_max"))}},
                "", true);
  }
  for (const json& compared : comparisons) {
    std::vector<std::pair<std::string, std::vector<double>>> rows = {{"largest |a − b|", numbers_of(member(compared, "max"))},
                                                                     {"at t [s]", numbers_of(member(compared, "time_of_max"))}};
    std::size_t part = 0;
    for (const json& segment : list_of(member(compared, "segment_rms"))) {
      if (part < 16) rows.emplace_back("RMS, part " + std::to_string(++part), numbers_of(segment));
    }
    rows.emplace_back("RMS", numbers_of(member(compared, "rms")));
    write_entry(page, compared, rows,
                ", t = " + number(number_of(member(compared, "from")), 6) + " to " +
                    number(number_of(member(compared, "to")), 6) + " s",
                false);
  }
}

void write_energy(Page& page, const Results& results) {
  const json::array_t &works = list_of(member(results.summary, "energy")), &bonds = list_of(member(results.summary, "bonds"));
  const std::vector<EnergyFlow> flows = energy_flows(results);
  if (works.empty() && bonds.empty() && flows.empty()) return;
  page.heading(3, "Energy");
  for (const EnergyFlow& flow : flows) {
    const std::string svg = flow_svg(flow);
    std::string below =
        "drawn from the mains: " + number(flow.drawn) + " J; net work of the motors: " + number(flow.motor_work) + " J";
    if (flow.friction) below += ", of which friction: " + number(*flow.friction) + " J";
    if (flow.residual) below += "; residual of the books: " + number(*flow.residual) + " J";
    if (flow.cost && *flow.cost != 0) below += "; cost: " + number(*flow.cost);
    if (flow.co2 && *flow.co2 != 0) below += "; CO₂: " + number(*flow.co2) + " kg";
    if (!svg.empty()) {
      page.figure(svg,
                  "Energy of " + code(flow.component) + ": sources on the left, the DC link in the middle, sinks on the right",
                  "<p>" + escaped(below) + "</p>");
    } else {
      page.paragraph(code(flow.component) + ": " + escaped(below));
    }
    Table table({"from or to", "in [J]", "out [J]"});
    for (const FlowEntry& entry : flow.sources) table.row({entry.name, entry.joules, ""});
    for (const FlowEntry& entry : flow.sinks) table.row({entry.name, "", entry.joules});
    page.table(table, "The books of " + flow.component);
  }
  Table table({"energy", "what", "net [J]", "positive [J]", "negative [J]"}, 2);
  for (const json& work : works)
    table.row({text_of(member(work, "name")), Cell::of_html(code(text_of(member(work, "what")))),
               number_of(member(work, "value")), number_of(member(work, "positive")), number_of(member(work, "negative"))});
  if (!table.empty()) page.table(table, "Work");
  Table leaks({"power bond", "out [J]", "in [J]", "leak [J]", "of what was exchanged [%]"});
  for (const json& bond : bonds)
    leaks.row({text_of(member(bond, "name")), number_of(member(bond, "energy_a")), number_of(member(bond, "energy_b")),
               number_of(member(bond, "leak")), 100 * number_of(member(bond, "share"))});
  if (!leaks.empty()) page.table(leaks, "Power bonds");
}

void write_clock(Page& page, const json& clock) {
  Table table({"", "median", "99 % within", "99.99 % within", "at most"});
  for (const auto& [key, name] :
       {std::pair{"start_delay", "delay of the start of ticks"}, std::pair{"run_time", "run time of ticks"}}) {
    const json& h = member(clock, key);
    if (!(number_of(member(h, "count")) > 0)) continue;
    table.row({name, duration(number_of(member(h, "median"))), duration(number_of(member(h, "p99"))),
               duration(number_of(member(h, "p99_99"))), duration(number_of(member(h, "max")))});
  }
  if (!table.empty()) page.table(table, "Clock: " + text_of(member(clock, "kind")));
}

void write_time(Page& page, const json& summary) {
  const json::array_t& units = list_of(member(summary, "units"));
  if (units.empty()) return;
  page.heading(3, "Time of the run");
  Table table({"", "per step", "share [%]"});
  for (const json& unit : units)
    table.row({text_of(member(unit, "name")), duration(number_of(member(unit, "seconds_per_step"))),
               Cell(number(100 * number_of(member(unit, "share")), 3))});
  const json& master = member(summary, "master");
  for (const auto& [key, name] : {std::pair{"exchange", "master: exchange"}, std::pair{"checks", "master: checks"},
                                  std::pair{"recording", "master: recording"}})
    table.row({name, "", Cell(number(100 * number_of(member(master, key)), 3))});
  page.table(table);
  write_clock(page, member(summary, "clock"));
  Table loops({"loop", "coupling", "gain in a tick", "iterations per step", "unit steps per step", "divided"}, 2);
  for (const json& loop : list_of(member(summary, "loops"))) {
    const double steps = number_of(member(loop, "steps"));
    loops.row({text_of(member(loop, "members")), text_of(member(loop, "coupling")), number_of(member(loop, "gain")),
               number_of(member(loop, "iterations")) / steps, number_of(member(loop, "unit_steps")) / steps,
               text_of(member(loop, "divided"))});
  }
  if (!loops.empty()) page.table(loops, "Loops of units");
}

void write_contacts(Page& page, const LoadedRecording& recording, const Gnuplot& gnuplot) {
  if (recording.contact_units.empty()) return;
  page.heading(3, "Contacts");
  if (recording.contacts.empty()) {
    page.paragraph("The recorded rows show no contact.");
    return;
  }
  page.paragraph("As far as the recorded rows show them: shorter contacts between two rows are not seen.");
  Table table({"component", "begin [s]", "end [s]", "duration [s]", "largest force [N]", "deepest [m]"});
  for (std::size_t i = 0; i < std::min(recording.contacts.size(), kMostSpansShown); ++i) {
    const ContactSpan& span = recording.contacts[i];
    table.row({span.component, Cell(number(span.begin, 7)), span.open ? Cell("until the end") : Cell(number(span.end, 7)),
               Cell(number(span.end - span.begin, 5)), span.force, span.penetration});
  }
  page.table(table, std::to_string(recording.contacts.size()) + (recording.contacts.size() == 1 ? " contact" : " contacts") +
                        (recording.contacts.size() > kMostSpansShown ? ", the first " + std::to_string(kMostSpansShown) : ""));
  for (const std::string& component : recording.contact_units) {
    Plot plot;
    plot.y_label = "N";
    plot.description = "Contact force of " + component + " over time; times in contact are shaded";
    for (const char* name : {".force", ".f_c[1]", ".f_c[2]", ".f_c[3]"}) {
      const RecordedColumn* column = recording.find(component + name);
      if (column != nullptr && column->plotted)
        plot.lines.push_back({element_of(*column), column->curve.points(), plot.lines.size()});
    }
    for (const ContactSpan& span : recording.contacts) {
      if (span.component == component) plot.shaded.emplace_back(span.begin, span.end);
    }
    Artist(page, gnuplot).plot(std::move(plot), "Forces of " + code(component) + "; times in contact are shaded");
  }
}

void write_residuals(Page& page, const LoadedRecording& recording, const Gnuplot& gnuplot) {
  if (recording.residuals.empty()) return;
  page.heading(3, "Residuals");
  for (const Residual& residual : recording.residuals) {
    const std::string caption =
        escaped(residual.name) + ": " + code(residual.a + (residual.attitude ? " against " : " − ") + residual.b);
    if (residual.curves.empty()) {
      page.paragraph(caption + " was not recorded: record both signals to see it over time.");
      continue;
    }
    for (const master::ElementKind& kind : master::kinds_of(residual.unit, {{}, residual.units}, residual.curves.size())) {
      for (std::size_t first = 0; first < kind.elements.size(); first += kStyles) {
        Plot plot;
        plot.y_label = kind.si;
        plot.description = residual.name + " over time";
        for (std::size_t k = first; k < std::min(first + kStyles, kind.elements.size()); ++k) {
          const std::size_t i = kind.elements[k];
          plot.lines.push_back({element_of(recording, residual.elements[i]), residual.curves[i].points(), k - first});
        }
        Artist(page, gnuplot).plot(std::move(plot), caption);
      }
    }
  }
}

void write_signals(Page& page, const LoadedRecording& recording, const Gnuplot& gnuplot) {
  page.heading(3, "Signals");
  std::size_t shown = 0, left = 0;
  std::string names;
  for (const ColumnGroup& group : recording.groups) {
    const bool wanted = std::ranges::any_of(group.columns, [&](std::size_t c) { return recording.columns[c].plotted; });
    if (!wanted) continue;
    if (shown++ < kMostGroups) {
      write_group(page, recording, group, gnuplot);
    } else if (++left <= 40) {
      text::append(names, group.name);
    }
  }
  if (left > 0)
    page.note("Not shown, because a page has at most " + std::to_string(kMostGroups) + " groups of signals: " + names +
              (left > 40 ? " and others" : "") + ". --signals chooses them.");
  if (shown == 0) page.paragraph("No column was chosen.");
}

/// The scheduled events, and what observers of the run changed.
void write_events(Page& page, const json& record) {
  Table table({"at t [s]", "event", "value", "ramp [s]", "by"}, 0, true);
  std::size_t rows = 0;
  for (const json& event : list_of(member(record, "events"))) {
    if (rows++ == kMostRowsOfRun) break;
    const std::string attached = text_of(member(event, "attach")), detached = text_of(member(event, "detach"));
    const std::string what = !attached.empty()   ? "attach " + attached
                             : !detached.empty() ? "detach " + detached
                                                 : text_of(member(event, "name"));
    table.row({Cell(number(number_of(member(event, "time")), 7)), what, text_of(member(event, "value")),
               text_of(member(event, "ramp")), "scenario"});
  }
  const json& outside = member(record, "from_outside");
  const auto by = [](const json& entry) {
    const std::string name = text_of(member(entry, "by"));
    return name.empty() ? std::string("observer") : name;
  };
  rows = 0;
  for (const json& change : list_of(member(outside, "changes"))) {
    if (rows++ == kMostRowsOfRun) break;
    table.row({Cell(number(number_of(member(change, "time")), 7)), text_of(member(change, "name")),
               text_of(member(change, "value")), "", by(change)});
  }
  rows = 0;
  for (const json& command : list_of(member(outside, "commands"))) {
    if (rows++ == kMostRowsOfRun) break;
    table.row({Cell(number(number_of(member(command, "time")), 7)), text_of(member(command, "command")), "", "", by(command)});
  }
  if (table.empty()) return;
  page.heading(3, "Events");
  page.table(table);
}

/// A value of a parameter: long vectors are shortened.
std::string value_of(const json& value) {
  if (value.is_array()) return joined(value, " ");
  const std::string text = text_of(value);
  return text.size() <= 200 ? text : text.substr(0, 200) + "…";
}

void write_run_parameters(Page& page, const json& record) {
  const json& parameters = member(record, "parameters");
  if (!parameters.is_object() || parameters.empty()) return;
  page.heading(3, "Parameters");
  Table table({"parameter", "value", "unit"}, 3);
  std::size_t rows = 0;
  for (const auto& [name, entry] : parameters.items()) {
    if (rows++ == kMostRowsOfRun) break;
    table.row({Cell::of_html(code(name)), value_of(member(entry, "value")), text_of(member(entry, "unit"))});
  }
  page.table(table,
             "Values that scenario, parameter files and command line gave; all others have their defaults" +
                 std::string(parameters.size() > kMostRowsOfRun ? " (the first " + std::to_string(kMostRowsOfRun) + ")" : ""));
}

void write_messages(Page& page, const Results& results) {
  const RunState state = state_of(results);
  if (!state.good) page.alarm("The run: " + state.words);
  for (const std::string& note : results.notes) page.note(note);
  if (results.recording) {
    for (const std::string& note : results.recording->notes) page.note(note);
  }
  const json& warnings = either(member(results.summary, "warnings"), member(results.record, "warnings"));
  std::size_t shown = 0;
  for (const json& warning : list_of(warnings)) {
    if (shown++ < 50) page.note("Warning: " + text_of(warning));
  }
  if (shown > 50) page.note(std::to_string(shown - 50) + " more warnings are in run.json.");
}

/// What the run was, in a line.
void write_outcome(Page& page, const Results& results) {
  const json &record = results.record, &summary = results.summary;
  std::string line;
  if (record.is_object() || summary.is_object()) line = state_of(results).words;
  const double start = number_of(either(member(record, "start"), member(summary, "start")));
  const double reached = number_of(either(member(record, "reached"), member(summary, "reached")));
  if (std::isfinite(start) && std::isfinite(reached))
    text::append(line, number(start, 9) + " s to " + number(reached, 9) + " s simulated");
  text::append(line, text_of(member(record, "begun")));
  if (!line.empty()) page.paragraph(escaped(line) + ".");
}

}  // namespace

void Artist::plot(Plot plot, const std::string& caption_html) {
  if (!gnuplot_.available()) return;
  if (!has_points(plot)) {
    page_.paragraph(caption_html + ": nothing to draw, because no value is finite.");
    return;
  }
  const std::string below = plot.lines.size() > 1 ? keys(plot.lines) : "";
  try {
    page_.figure(draw(gnuplot_, std::move(plot)), caption_html, below);
  } catch (const std::exception& error) {
    page_.paragraph(caption_html);
    page_.note(std::string("The plot could not be drawn: ") + error.what());
  }
}

RunState state_of(const Results& results) {
  std::string state = text_of(member(results.record, "state"));
  if (state.empty()) state = text_of(member(results.summary, "state"));
  std::string reason = text_of(member(results.record, "reason"));
  if (reason.empty()) reason = text_of(member(results.summary, "message"));
  if (state.empty()) return {"unknown", true};
  const bool good = state == "complete" || state == "done";
  if (state == "running") return {"running when this page was written, or its program was killed", false};
  return {state + (reason.empty() ? "" : ": " + reason), good};
}

void write_group(Page& page, const LoadedRecording& recording, const ColumnGroup& group, const Gnuplot& gnuplot) {
  page.heading(4, with_unit(group.name, group.unit));
  for (std::size_t first = 0; first < group.columns.size(); first += kStyles) {
    Plot plot;
    plot.y_label = group.unit == "1" ? "" : group.unit;
    plot.description = group.name + " over time";
    for (std::size_t i = first; i < std::min(first + kStyles, group.columns.size()); ++i) {
      const RecordedColumn& column = recording.columns[group.columns[i]];
      if (column.plotted) plot.lines.push_back({element_of(column), column.curve.points(), i - first});
    }
    if (!plot.lines.empty() && recording.rows > 0) Artist(page, gnuplot).plot(std::move(plot), "");
  }
  Table table({"", "smallest", "at t [s]", "largest", "at t [s]", "mean", "RMS", "at the end"});
  std::size_t rows = 0;
  for (const std::size_t c : group.columns) {
    const Figures& f = recording.columns[c].curve.figures();
    if (f.count == 0 || rows++ >= kMostRowsOfRun) continue;
    table.row({element_of(recording.columns[c]), f.min, f.t_of_min, f.max, f.t_of_max, f.mean(), f.rms(), f.last});
  }
  if (!table.empty()) page.table(table);
}

void write_run(Page& page, const Results& results, const Gnuplot& gnuplot) {
  page.heading(2, results.name, true);
  write_outcome(page, results);
  write_messages(page, results);
  write_figures(page, results.summary);
  if (results.recording) {
    write_contacts(page, *results.recording, gnuplot);
    write_residuals(page, *results.recording, gnuplot);
    write_signals(page, *results.recording, gnuplot);
  } else {
    page.paragraph("The run has no recording, so there are no plots.");
  }
  write_energy(page, results);
  write_events(page, results.record);
  if (const json& notes = member(results.summary, "notes"); !list_of(notes).empty()) {
    page.heading(3, "Notes of the units");
    for (const json& note : list_of(notes)) page.paragraph(escaped(text_of(note)));
  }
  write_run_parameters(page, results.record);
  write_time(page, results.summary);
  write_run_facts(page, results);
}

}  // namespace cotwin::report
