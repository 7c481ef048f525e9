#include "master/workflows/fmu_run.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_map>

#include "fmu/description/rate.h"
#include "fmu/process/process.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

constexpr const char* kName = "fmu";       // of the only component
constexpr double kMaxSeconds = 9e9;        // 2^63 ns is 9.22e9 s
constexpr double kDefaultIntervals = 500;  // number of steps if the FMU proposes no step size
constexpr double kLeastInterval = 1e-9;    // s

double checked(double seconds, const std::string& what) {
  if (!(std::abs(seconds) <= kMaxSeconds))
    throw Error(what + " " + text::to_text(seconds), "expected seconds, " + text::to_text(kMaxSeconds) + " at most");
  return seconds;
}

Scenario scenario_of(const FmuRunOptions& options, const fmu::ModelDescription& description) {
  const fmu::DefaultExperiment experiment = description.default_experiment.value_or(fmu::DefaultExperiment{});
  const double start = checked(options.start ? *options.start : experiment.start.value_or(0), "--start-time");
  const double stop =
      checked(options.stop ? *options.stop : std::max(experiment.stop.value_or(start + 1), start), "--stop-time");
  const bool proposed = experiment.step && *experiment.step >= kLeastInterval;
  const double usual = proposed ? *experiment.step : (stop - start) / kDefaultIntervals;
  const double interval = checked(options.interval.value_or(usual), "--output-interval");
  Scenario scenario;
  scenario.name = description.model_name;
  scenario.file = options.file;
  scenario.start = Time::from_seconds(start);
  scenario.stop = Time::from_seconds(stop);
  scenario.tick = Duration::from_seconds(interval);
  if (scenario.stop <= scenario.start && !options.stop)
    throw Error(options.file.string(), "its DefaultExperiment ends at " + text::to_text(experiment.stop.value_or(stop)) +
                                           " s, before the start at " + text::to_text(start) + " s; expected --stop-time");
  if (scenario.stop <= scenario.start)
    throw Error("--stop-time " + text::to_text(stop), "expected a time after the start at " + text::to_text(start) + " s");
  if (scenario.tick.ns <= 0) throw Error("--output-interval " + text::to_text(interval), "expected 1e-09 s or more");
  ComponentSpec component;
  component.name = kName;
  component.source = options.file.string() + "?si=false";
  component.process = options.process;
  if (options.process == fmu::ProcessChoice::kAuto && description.generation_tool != fmu::kGenerationTool) {
    if (!fmu::host_program().empty()) {
      component.process = fmu::ProcessChoice::kOwn;
    } else {
      scenario.warnings.push_back(std::string(fmu::kHostProgram) +
                                  " is missing in the folder of this program: the FMU runs in this process");
    }
  }
  if (options.set_stop_time) component.source += "&stop=" + text::to_text(stop);
  if (options.tolerance) component.source += "&tolerance=" + text::to_text(*options.tolerance);
  if (options.timeout) component.source += "&timeout=" + text::to_text(*options.timeout);
  if (options.memory) component.source += "&memory=" + text::to_text(*options.memory);
  component.implementation = options.interface_type;
  for (const auto& [name, value] : options.start_values) {
    component.start_values.push_back({name, value, "", "--start-value " + name + " " + value});
  }
  scenario.components.push_back(std::move(component));
  return scenario;
}

/// Finds a variable of the FMU by name. FMI 2 names each element of an array, FMI 3 the whole array; both names are found.
class VariableFinder {
 public:
  explicit VariableFinder(const fmu::ModelDescription& description) : index_(description) {
    for (const fmu::ModelVariable& v : description.variables) {
      if (const std::size_t bracket = v.name.find('['); bracket != std::string::npos)
        first_element_.emplace(std::string_view(v.name).substr(0, bracket), &v);
    }
  }

  const fmu::ModelVariable* find(const std::string& name) const {
    if (const fmu::ModelVariable* same = index_.variable(name)) return same;
    for (std::size_t bracket = name.rfind('['); bracket != std::string::npos && bracket > 0;
         bracket = name.rfind('[', bracket - 1)) {
      if (const fmu::ModelVariable* whole = index_.variable(std::string_view(name).substr(0, bracket))) return whole;
    }
    const auto found = first_element_.find(name);
    return found == first_element_.end() ? nullptr : found->second;
  }

 private:
  fmu::DescriptionIndex index_;
  std::unordered_map<std::string_view, const fmu::ModelVariable*> first_element_;  // by the name up to the first bracket
};

/// Returns the double nearest to the time in seconds; n · 1e-9 would have a rounding error.
double exact_seconds(Time time) { return static_cast<double>(time.ns) / 1e9; }

void append_quoted(std::string& line, const std::string& text) {
  line += '"';
  for (const char c : text) {
    if (c == '"') line += c;
    line += c;
  }
  line += '"';
}

}  // namespace

InputTable::InputTable(const fs::path& file, std::span<const Member> members, const fmu::ModelDescription& description) {
  csv::Reader reader(file);
  const std::vector<std::string>& names = reader.names();
  const SignalIndex signals(members);
  const VariableFinder variables(description);
  columns_.reserve(names.size());
  for (std::size_t c = 1; c < names.size(); ++c) {
    const std::string place = file.string() + ": column '" + names[c] + "'";
    Column column{signals.find(std::string(kName) + "." + names[c], place), false, {}, {}};
    const Role role = column.signal.variable->role;
    if (role != Role::kInput && role != Role::kTunable) fail(place, "is " + with_article(role) + ", expected an input");
    const fmu::ModelVariable* variable = variables.find(names[c]);
    column.continuous = column.signal.variable->kind() == Kind::kReal && variable != nullptr &&
                        variable->variability == fmu::Variability::kContinuous;
    columns_.push_back(std::move(column));
  }
  while (reader.next()) {
    const double seconds = reader.real(0);
    if (!(std::abs(seconds) <= kMaxSeconds))
      throw Error(reader.place(0), "'" + std::string(reader.text(0)) + "', expected seconds");
    const Time time = Time::from_seconds(seconds);
    if (!times_.empty() && time < times_.back())
      throw Error(reader.place(0), "time decreases, expected rows in the order of time");
    times_.push_back(time);
    for (std::size_t c = 1; c < names.size(); ++c) read_cell(columns_[c - 1], reader, c);
  }
  if (times_.empty()) throw Error(file.string(), "has no rows, expected values over time");
}

void InputTable::read_cell(Column& column, const csv::Reader& reader, std::size_t c) const {
  const std::string_view cell = reader.text(c);
  const Kind kind = column.signal.variable->kind();
  if (kind == Kind::kString) {
    column.texts.emplace_back(cell);
    return;
  }
  std::size_t count = 0;
  for (const std::string_view part : text::split(cell, ' ')) {
    if (part.empty()) continue;
    std::optional<double> number = text::parse_real(part);
    if (!number && kind == Kind::kBoolean && text::parse_boolean(part)) number = *text::parse_boolean(part) ? 1 : 0;
    const bool fits = number && (kind == Kind::kReal || (kind == Kind::kBoolean && (*number == 0 || *number == 1)) ||
                                 (kind == Kind::kInteger && text::parse_integer(part) &&
                                  *number >= std::numeric_limits<std::int32_t>::min() &&
                                  *number <= std::numeric_limits<std::int32_t>::max()));
    if (!fits) throw Error(reader.place(c), "'" + std::string(part) + "', expected " + std::string(name_of(kind)));
    column.numbers.push_back(*number);
    ++count;
  }
  if (count != column.signal.count) {
    throw Error(reader.place(c), std::to_string(count) + " values, expected " + std::to_string(column.signal.count));
  }
}

double InputTable::at(const Column& column, std::size_t element, Time time, bool before) const {
  const std::size_t n = column.signal.count;
  const auto value = [&](std::size_t row) { return column.numbers[row * n + element]; };
  // The first row after `time`; if `before`, the first row at or after it.
  const auto next =
      before ? std::lower_bound(times_.begin(), times_.end(), time) : std::upper_bound(times_.begin(), times_.end(), time);
  const auto b = static_cast<std::size_t>(next - times_.begin());
  if (b == 0) return value(0);
  if (b == times_.size() || !column.continuous) return value(b - 1);
  const double span = static_cast<double>((times_[b] - times_[b - 1]).ns);
  const double share = static_cast<double>((time - times_[b - 1]).ns) / span;
  return value(b - 1) + (value(b) - value(b - 1)) * share;
}

void InputTable::apply(Time now, Duration h) const {
  for (const Column& column : columns_) {
    const Variable& variable = *column.signal.variable;
    const std::size_t first = column.signal.first;
    if (variable.kind() == Kind::kString) {
      const auto row = std::upper_bound(times_.begin(), times_.end(), now) - times_.begin();
      variable.strings()[first] = column.texts[static_cast<std::size_t>(std::max<std::ptrdiff_t>(row - 1, 0))];
      continue;
    }
    for (std::size_t i = 0; i < column.signal.count; ++i) {
      const double value = at(column, i, now, false);
      if (variable.kind() == Kind::kInteger) variable.integers()[first + i] = static_cast<std::int32_t>(value);
      if (variable.kind() == Kind::kBoolean) variable.booleans()[first + i] = value != 0;
      if (variable.kind() != Kind::kReal) continue;
      variable.reals()[first + i] = value;
      if (variable.rate.empty()) continue;
      variable.rate[first + i] = column.continuous && h.ns > 0 ? (at(column, i, now + h, true) - value) / h.seconds() : 0;
    }
  }
}

fs::path output_file_of(const FmuRunOptions& options) {
  if (!options.output_file.empty()) return options.output_file;
  const fs::path file = options.file.filename().empty() ? options.file.parent_path() : options.file;
  return file.stem().string() + "_out.csv";
}

FmuRun::FmuRun(const FmuRunOptions& options)
    : options_(options),
      description_(fmu::read_fmu_description(options.file)),
      master_(scenario_of(options, description_), {}) {
  options_.output_file = output_file_of(options_);
  std::vector<std::pair<std::string, const fmu::ModelVariable*>> chosen;
  if (options_.output_variables.empty()) {
    for (const fmu::ModelVariable& v : description_.variables) {
      if (v.causality == fmu::Causality::kOutput && v.type != fmu::Type::kClock) chosen.emplace_back(v.name, &v);
    }
  }
  const VariableFinder variables(description_);
  for (const std::string& name : options_.output_variables) {
    const fmu::ModelVariable* variable = variables.find(name);
    if (variable == nullptr) (void)find(name, "--output-variable");  // throws Error with similar names
    if (variable != nullptr) chosen.emplace_back(name, variable);
  }
  // fmusim groups enumerations with the integer type that represents them.
  const fmu::Type carrier = description_.version == fmu::Version::k2 ? fmu::Type::kInt32 : fmu::Type::kInt64;
  const auto group = [&](const fmu::ModelVariable* v) { return v->type == fmu::Type::kEnumeration ? carrier : v->type; };
  std::stable_sort(chosen.begin(), chosen.end(),
                   [&](const auto& a, const auto& b) { return group(a.second) < group(b.second); });
  for (const auto& [name, variable] : chosen)
    outputs_.push_back({name, find(name, "--output-variable"), variable->type != fmu::Type::kBinary});
  if (!options_.input_file.empty()) inputs_.emplace(options_.input_file, master_.members(), description_);
}

Signal FmuRun::find(const std::string& name, const std::string& place) {
  return find_signal(master_.members(), std::string(kName) + "." + name, place);
}

void FmuRun::initialise() {
  if (inputs_) inputs_->apply(master_.now(), {});
  master_.initialise();
  out_.emplace(options_.output_file);
  line_ = "\"time\"";
  for (const Output& output : outputs_) {
    line_ += ',';
    append_quoted(line_, output.name);
  }
  out_->write(line_ += '\n');
  write_row();
}

bool FmuRun::step_tick() {
  if (inputs_) inputs_->apply(master_.now(), std::min(master_.scenario().tick, master_.scenario().stop - master_.now()));
  if (!master_.step_tick()) return false;
  write_row();
  return true;
}

void FmuRun::write_row() {
  line_.clear();
  csv::append(line_, exact_seconds(master_.now()));
  for (const Output& output : outputs_) {
    line_ += ',';
    const Variable& variable = *output.signal.variable;
    for (std::size_t i = output.signal.first; i < output.signal.first + output.signal.count; ++i) {
      if (i > output.signal.first) line_ += ' ';
      if (variable.kind() == Kind::kReal) csv::append(line_, variable.reals()[i]);
      if (variable.kind() == Kind::kInteger) line_ += std::to_string(variable.integers()[i]);
      if (variable.kind() == Kind::kBoolean) line_ += variable.booleans()[i] ? '1' : '0';
      if (variable.kind() == Kind::kString) {
        if (output.quoted) {
          append_quoted(line_, variable.strings()[i]);
        } else {
          line_ += variable.strings()[i];
        }
      }
    }
  }
  line_ += '\n';
  out_->write(line_);
  ++rows_;
}

void FmuRun::finish() {
  master_.finish();
  if (out_) out_->close();
}

Summary FmuRun::summary() const {
  Summary summary = master_.summary();
  summary.recording = options_.output_file;
  summary.rows = rows_;
  return summary;
}

}  // namespace cotwin::master
