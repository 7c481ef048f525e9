#include "master/scenario/annotation.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "master/scenario/system.h"
#include "models/foundation/formats/parameter_set_xml.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/changes/tool.h"
#include "models/robot/urdf/urdf_document.h"

namespace cotwin::master {

namespace {

constexpr double kMaxSecondsOfAnnotation = 9e9;  // 2^63 ns is 9.22e9 s
const char* const kSpanExpected = "a time such as '0.001', '1 ms' or '2 s'";

/// Returns seconds from a number with or without a unit of time.
double seconds(const std::string& value, const std::string& place, const std::string& what) {
  const std::string_view trimmed = text::trim(value);
  const std::size_t blank = trimmed.find(' ');
  const std::optional<double> number = text::parse_real(trimmed.substr(0, blank));
  const auto fail = [&]() -> double { throw Error(place, what + ": '" + value + "', expected " + kSpanExpected); };
  if (!number || !std::isfinite(*number)) return fail();
  if (blank == std::string_view::npos) return *number;
  si::Measure measure;
  try {
    measure = si::parse(trimmed.substr(blank));
  } catch (const Error&) {
    return fail();
  }
  if (!si::convertible(measure, si::parse("s"))) return fail();
  return *number * measure.factor;
}

/// Reads a duration in whole nanoseconds.
std::int64_t nanoseconds(const xml::Element& e, const char* name, double min) {
  const std::string& value = xml::text(e, name);
  const std::string what = "attribute '" + std::string(name) + "' of '" + e.name + "'";
  const double s = seconds(value, e.place, what);
  if (!(s >= min && s <= kMaxSecondsOfAnnotation)) {
    throw Error(e.place, what + ": '" + value + "', expected " + text::to_text(min, 6) + " s to " +
                             text::to_text(kMaxSecondsOfAnnotation, 6) + " s");
  }
  const Duration d = Duration::from_seconds(s);
  // Tolerance: 1e-3 ns, or the resolution of a double of this size.
  if (std::abs(s * 1e9 - static_cast<double>(d.ns)) > std::max(1e-3, 4e-16 * std::abs(s * 1e9))) {
    throw Error(e.place, what + ": '" + value + "', expected a whole number of nanoseconds");
  }
  return d.ns;
}

int bounded(const xml::Element& e, const char* name, int fallback, int min, int max) {
  const int value = xml::integer(e, name, fallback);
  if (value < min || value > max) {
    throw Error(e.place, "attribute '" + std::string(name) + "' of '" + e.name + "': " + std::to_string(value) + ", expected " +
                             std::to_string(min) + " to " + std::to_string(max));
  }
  return value;
}

double not_negative(const xml::Element& e, const char* name, double fallback) {
  const double value = xml::real(e, name, fallback);
  if (!(value >= 0) || !std::isfinite(value)) {
    throw Error(e.place, "attribute '" + std::string(name) + "' of '" + e.name + "': " + xml::text(e, name) +
                             ", expected a finite number, 0 or more");
  }
  return value;
}

/// Reads the name of a variable of a component. Only the component is looked up.
std::string variable(const xml::Element& e, const char* name, const Scenario& scenario, const ComponentIndex& index) {
  const std::string& value = xml::text(e, name);
  if (!index.has_owner(value)) {
    std::vector<std::string> candidates;
    const std::string tail = value.substr(value.rfind('.') + 1);
    for (const ComponentSpec& c : scenario.components) candidates.push_back(c.name + "." + tail);
    throw Error(e.place, xml::unknown("a variable of a component", value, candidates));
  }
  return value;
}

void read_component(const xml::Element& e, Scenario& scenario, const ComponentIndex& index, std::set<std::string>& seen) {
  xml::check_attributes(e, {"name", "stage", "period", "threads", "process", "beside"});
  const std::string& name = xml::text(e, "name");
  const std::optional<std::size_t> at = index.find(name);
  if (!at) {
    std::vector<std::string> names;
    for (const ComponentSpec& c : scenario.components) names.push_back(c.name);
    throw Error(e.place, xml::unknown("a component", name, names));
  }
  if (!seen.insert(name).second) throw Error(e.place, "a second 'Component' with the name '" + name + "'");
  ComponentSpec* const found = &scenario.components[*at];
  found->stage = bounded(e, "stage", found->stage, 0, 1'000'000);
  found->period = bounded(e, "period", found->period, 1, 1'000'000'000);
  found->threads = xml::boolean(e, "threads", found->threads);
  found->beside = xml::boolean(e, "beside", found->beside);
  found->process = xml::choice(e, "process", fmu::kProcessWords, found->process);
  if (found->process == fmu::ProcessChoice::kOwn && found->source.rfind("unit:", 0) == 0) {
    throw Error(e.place, "component '" + name + "' with process=\"own\" is a built-in unit, expected an FMU");
  }
}

/// The CPUs of a list "2, 3".
std::vector<int> read_cpus(const xml::Element& e) {
  try {
    return parse_cpus(xml::text(e, "cpu"));
  } catch (const Error& error) {
    throw Error(e.place, "attribute 'cpu' of 'Clock': " + std::string(error.what()));
  }
}

void read_clock(const xml::Element& e, Scenario& scenario, const ComponentIndex& index) {
  xml::check_attributes(e, {"kind", "component", "overrun", "late", "silence", "timeout", "cycle", "shift", "bandwidth",
                            "within", "priority", "cpu"});
  ClockSpec clock;
  clock.place = e.place;
  clock.kind = xml::choice<ClockKind>(e, "kind", kClockWords);
  const auto given = [&](const char* name) { return xml::find(e, name) != nullptr; };
  const auto only_of = [&](std::initializer_list<const char*> names, bool applies, const char* kinds) {
    for (const char* name : names) {
      if (given(name) && !applies)
        throw Error(e.place, "attribute '" + std::string(name) + "' of 'Clock' of kind '" +
                                 text::word_of(clock.kind, kClockWords) + "', expected it only with " + kinds);
    }
  };
  only_of({"overrun", "late", "priority", "cpu"}, clock.kind != ClockKind::kFree, "'wall', 'arrivals' or 'locked'");
  only_of({"component", "silence", "timeout", "cycle"}, clock.follows(), "'arrivals' or 'locked'");
  only_of({"shift", "bandwidth", "within"}, clock.kind == ClockKind::kLocked, "'locked'");
  if (given("component")) {
    clock.component = xml::text(e, "component");
    if (!index.find(clock.component)) {
      std::vector<std::string> names;
      for (const ComponentSpec& c : scenario.components) names.push_back(c.name);
      throw Error(e.place, xml::unknown("a component", clock.component, names));
    }
  }
  clock.overrun = xml::choice(e, "overrun", kOverrunWords, clock.overrun);
  clock.silence = xml::choice(e, "silence", kSilenceWords, clock.silence);
  if (given("late")) clock.late = Duration{nanoseconds(e, "late", 0)};
  if (given("timeout")) clock.timeout = Duration{nanoseconds(e, "timeout", 1e-9)};
  if (given("cycle")) clock.cycle = Duration{nanoseconds(e, "cycle", 1e-9)};
  if (given("shift")) clock.shift = Duration{nanoseconds(e, "shift", -kMaxSecondsOfAnnotation)};
  if (given("within")) clock.within = Duration{nanoseconds(e, "within", 1e-9)};
  clock.bandwidth = xml::real(e, "bandwidth", clock.bandwidth);
  if (!(clock.bandwidth >= 1e-3 && clock.bandwidth <= 1e3))
    throw Error(e.place, "attribute 'bandwidth' of 'Clock': " + xml::text(e, "bandwidth") + ", expected 0.001 to 1000 Hz");
  clock.priority = bounded(e, "priority", 0, 0, 99);
  if (given("cpu")) clock.cpus = read_cpus(e);
  scenario.clock = std::move(clock);
}

void read_setting(const xml::Element& e, Scenario& scenario) {
  xml::check_attributes(e, {"name", "value"});
  const std::string& name = xml::text(e, "name");
  if (name.empty()) throw Error(e.place, "a setting without a name");
  if (!scenario.settings.emplace(name, xml::text(e, "value")).second) throw Error(e.place, "a second setting '" + name + "'");
}

template <std::size_t N>
std::array<double, N> numbers(const xml::Element& e, const char* name) {
  std::array<double, N> values{};
  if (xml::find(e, name) == nullptr) return values;
  std::string list = xml::text(e, name);
  std::replace_if(
      list.begin(), list.end(), [](char c) { return c == ',' || c == '\t' || c == '\n' || c == '\r'; }, ' ');
  std::size_t count = 0;
  for (const std::string_view item : text::split(list, ' ')) {
    if (item.empty()) continue;
    const std::optional<double> value = text::parse_real(item);
    if (!value || !std::isfinite(*value) || count == N) count = N + 1;
    if (count < N) values[count++] = *value;
  }
  if (count != N)
    throw Error(e.place, "attribute '" + std::string(name) + "' of '" + e.name + "': '" + xml::text(e, name) + "', expected " +
                             std::to_string(N) + " finite numbers");
  return values;
}

std::array<double, 3> values_of(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

/// Reads a tool from its URDF into the numbers of the event.
void read_tool_file(const std::filesystem::path& file, ToolSpec& tool) {
  const std::string xml = read_text_file(file, "a URDF");
  const robot::Attachment part = robot::parse_tool(xml, file.string(), tool.name);
  if (xml.find("<collision") != std::string::npos) tool.shapes = std::filesystem::absolute(file).lexically_normal();
  tool.mass = part.inertia.mass;
  tool.com = values_of(part.inertia.p_LC);
  const Eigen::Matrix3d& I = part.inertia.I_CC;
  tool.inertia = {I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2)};
  for (const robot::PartFrame& frame : part.further)
    tool.frames.push_back({frame.name, values_of(frame.X_AF.p), values_of(robot::rpy_of(frame.X_AF.R))});
}

void read_event(const xml::Element& e, const std::filesystem::path& folder, Scenario& scenario, const ComponentIndex& index) {
  if (xml::find(e, "attach") != nullptr || xml::find(e, "detach") != nullptr) {
    scenario.tools.push_back(read_tool(e, folder));
    return;
  }
  scenario.events.push_back(read_change(e, scenario, index));
}

void read_recording(const xml::Element& e, Scenario& scenario) {
  xml::check_attributes(e, {"decimation", "outputs"});
  xml::check_children(e, kAnnotationSpace, {"Record"});
  scenario.decimation = bounded(e, "decimation", 1, 1, 1'000'000'000);
  for (const xml::Element& record : e.children) {
    if (record.space != kAnnotationSpace) continue;
    xml::check_attributes(record, {"variables"});
    std::string list = xml::text(record, "variables");
    std::replace_if(
        list.begin(), list.end(), [](char c) { return c == ',' || c == '\t' || c == '\n' || c == '\r'; }, ' ');
    std::size_t count = 0;
    for (const std::string_view pattern : text::split(list, ' ')) {
      if (pattern.empty()) continue;
      scenario.recording.push_back({std::string(pattern), record.place});
      ++count;
    }
    if (count == 0) throw Error(record.place, "'Record' without variables, expected e.g. 'drive.q drive.tau_J' or 'drive.*'");
  }
  scenario.all_outputs = xml::boolean(e, "outputs", false);
}

void read_comparison(const xml::Element& e, Scenario& scenario, const ComponentIndex& index) {
  xml::check_attributes(e, {"name", "a", "b", "segments", "from", "to"});
  ComparisonSpec c{xml::text(e, "name"),
                   variable(e, "a", scenario, index),
                   variable(e, "b", scenario, index),
                   bounded(e, "segments", 8, 1, 1'000),
                   std::nullopt,
                   std::nullopt,
                   e.place};
  if (xml::find(e, "from") != nullptr) c.from = Time{nanoseconds(e, "from", -kMaxSecondsOfAnnotation)};
  if (xml::find(e, "to") != nullptr) c.to = Time{nanoseconds(e, "to", -kMaxSecondsOfAnnotation)};
  if (c.from && c.to && *c.from >= *c.to) throw Error(e.place, "comparison '" + c.name + "': from is not before to");
  scenario.comparisons.push_back(std::move(c));
}

void read_bond(const xml::Element& e, Scenario& scenario, const ComponentIndex& index) {
  xml::check_attributes(e, {"name", "effortA", "flowA", "effortB", "flowB", "tolerance", "reference"});
  scenario.bonds.push_back({xml::text(e, "name"), variable(e, "effortA", scenario, index),
                            variable(e, "flowA", scenario, index), variable(e, "effortB", scenario, index),
                            variable(e, "flowB", scenario, index), not_negative(e, "tolerance", 0), e.place,
                            not_negative(e, "reference", 1)});
}

void read_report(const xml::Element& e, Scenario& scenario, const ComponentIndex& index) {
  xml::check_attributes(e, {"name", "kind", "a", "b"});
  ReportSpec r{xml::text(e, "name", ""), xml::choice(e, "kind", kReportWords, ReportKind::kSignal),
               variable(e, "a", scenario, index), "", e.place};
  if (r.kind != ReportKind::kSignal) {
    r.b = variable(e, "b", scenario, index);
  } else if (xml::find(e, "b") != nullptr) {
    throw Error(e.place, "a report of kind 'signal' has no 'b'");
  }
  scenario.reports.push_back(std::move(r));
}

/// Throws Error if an element below `element` that is not in `allowed` is our annotation.
void reject_elsewhere(const xml::Element& element, const std::vector<const xml::Element*>& allowed) {
  for (const xml::Element& c : element.children) {
    if (c.space == ssp::kSsc && c.name == "Annotation" && xml::text(c, "type", "") == kAnnotationType &&
        std::find(allowed.begin(), allowed.end(), &c) == allowed.end()) {
      throw Error(c.place, std::string("an annotation '") + kAnnotationType +
                               "', expected it once, at the root of the document or at its root system");
    }
    reject_elsewhere(c, allowed);
  }
}

}  // namespace

Duration read_duration(const xml::Element& e, const char* name, double min) { return Duration{nanoseconds(e, name, min)}; }

EventSpec read_change(const xml::Element& e, const Scenario& scenario, const ComponentIndex& index) {
  xml::check_attributes(e, {"time", "variable", "value", "ramp"});
  const Duration ramp{xml::find(e, "ramp") != nullptr ? nanoseconds(e, "ramp", 0) : 0};
  return {Time{nanoseconds(e, "time", -kMaxSecondsOfAnnotation)}, variable(e, "variable", scenario, index),
          xml::text(e, "value"), ramp, e.place};
}

ToolSpec read_tool(const xml::Element& e, const std::filesystem::path& folder) {
  ToolSpec tool;
  tool.attach = xml::find(e, "attach") != nullptr;
  if (tool.attach && xml::find(e, "detach") != nullptr)
    throw Error(e.place, "attributes 'attach' and 'detach' of 'Event', expected one of the two");
  const char* const kind = tool.attach ? "attach" : "detach";
  if (tool.attach) {
    xml::check_attributes(e, {"time", "attach", "parent", "xyz", "rpy", "file", "mass", "com", "inertia", "known", "robot",
                              "components", "scope", "reason"});
    xml::check_children(e, kAnnotationSpace, {"Frame"});
  } else {
    xml::check_attributes(e, {"time", "detach", "robot", "components", "scope", "reason"});
    xml::check_children(e, kAnnotationSpace, {});
  }
  tool.place = e.place;
  tool.time = Time{nanoseconds(e, "time", -kMaxSecondsOfAnnotation)};
  tool.name = xml::text(e, kind);
  if (tool.name.empty()) throw Error(e.place, std::string(kind) + " without the name of a tool");
  tool.robot = xml::text(e, "robot", "");
  tool.scope = xml::text(e, "scope", "");
  tool.reason = xml::text(e, "reason", "");
  const std::string components = xml::text(e, "components", "");
  for (const std::string_view name : text::split(components, ' ')) {
    if (!name.empty()) tool.components.emplace_back(name);
  }
  if (tool.attach) {
    tool.parent = xml::text(e, "parent");
    tool.known = xml::boolean(e, "known", true);
    tool.xyz = numbers<3>(e, "xyz");
    tool.rpy = numbers<3>(e, "rpy");
    const bool from_file = xml::find(e, "file") != nullptr;
    for (const char* name : {"mass", "com", "inertia"}) {
      if (from_file && xml::find(e, name) != nullptr)
        throw Error(e.place, std::string("attributes 'file' and '") + name + "' of '" + e.name + "', expected one of the two");
    }
    if (from_file) {
      try {
        read_tool_file(folder / xml::text(e, "file"), tool);
      } catch (const Error& error) {
        throw Error(e.place, "tool '" + tool.name + "': " + error.what());
      }
    }
    if (!from_file) {
      tool.mass = not_negative(e, "mass", 0);
      tool.com = numbers<3>(e, "com");
      tool.inertia = numbers<6>(e, "inertia");
    }
    for (const xml::Element& frame : e.children) {
      xml::check_attributes(frame, {"name", "xyz", "rpy"});
      tool.frames.push_back({xml::text(frame, "name"), numbers<3>(frame, "xyz"), numbers<3>(frame, "rpy")});
    }
  }
  return tool;
}

const xml::Element* find_annotation(const xml::Element& document) {
  const xml::Element* ours = nullptr;
  for (const xml::Element* holder :
       {&document, xml::child(document, ssp::kSsd, "System"), xml::child(document, ssp::kSsd, "DefaultExperiment")}) {
    const xml::Element* list = holder != nullptr ? xml::child(*holder, ssp::kSsd, "Annotations") : nullptr;
    if (list == nullptr) continue;
    for (const xml::Element& a : list->children) {
      if (ours == nullptr && a.space == ssp::kSsc && a.name == "Annotation" && xml::text(a, "type", "") == kAnnotationType)
        ours = &a;
    }
  }
  reject_elsewhere(document, {ours});
  if (ours == nullptr) return nullptr;
  if (ours->children.size() != 1 || ours->children[0].name != "Master" || ours->children[0].space != kAnnotationSpace) {
    throw Error(ours->place, std::string("annotation '") + kAnnotationType + "', expected one element 'Master' of namespace '" +
                                 kAnnotationSpace + "' in it");
  }
  return &ours->children[0];
}

void read_annotation(const xml::Element& master, Scenario& scenario) {
  xml::check_attributes(master, {"tick", "stop", "clock", "threads", "tolerance", "coupling", "unknownParameters"});
  for (const xml::Element& c : master.children) {
    if (c.space != kAnnotationSpace) throw Error(c.place, "'" + c.name + "' of namespace '" + c.space + "' in our annotation");
  }
  xml::check_children(master, kAnnotationSpace,
                      {"Clock", "Setting", "Component", "Event", "Recording", "Comparison", "Report", "Bond"});

  if (xml::find(master, "tick") != nullptr) scenario.tick = Duration{nanoseconds(master, "tick", 1e-9)};
  if (xml::find(master, "stop") != nullptr) scenario.stop = Time{nanoseconds(master, "stop", scenario.start.seconds())};
  scenario.clock.kind = xml::choice(master, "clock", kClockWords, ClockKind::kFree);
  scenario.clock.place = master.place;
  scenario.threads = bounded(master, "threads", 0, 0, 1024);
  scenario.tolerance = not_negative(master, "tolerance", 0);
  scenario.coupling = xml::choice(master, "coupling", kCouplingWords, CouplingChoice::kAuto);
  scenario.ignore_unknown_parameters =
      xml::choice<bool>(master, "unknownParameters", {{"error", false}, {"ignore", true}}, false);

  const ComponentIndex index(scenario);
  std::set<std::string> components;
  bool recording = false, clock = xml::find(master, "clock") != nullptr;
  for (const xml::Element& c : master.children) {
    if (c.name == "Clock") {
      if (std::exchange(clock, true)) throw Error(c.place, "a second clock");
      read_clock(c, scenario, index);
    }
    if (c.name == "Setting") read_setting(c, scenario);
    if (c.name == "Component") read_component(c, scenario, index, components);
    if (c.name == "Event") read_event(c, scenario.folder, scenario, index);
    if (c.name == "Comparison") read_comparison(c, scenario, index);
    if (c.name == "Report") read_report(c, scenario, index);
    if (c.name == "Bond") read_bond(c, scenario, index);
    if (c.name == "Recording") {
      if (std::exchange(recording, true)) throw Error(c.place, "a second 'Recording'");
      read_recording(c, scenario);
    }
  }
  std::stable_sort(scenario.events.begin(), scenario.events.end(),
                   [](const EventSpec& a, const EventSpec& b) { return a.time < b.time; });
  std::stable_sort(scenario.tools.begin(), scenario.tools.end(),
                   [](const ToolSpec& a, const ToolSpec& b) { return a.time < b.time; });
}

Scenario read_nested_annotation(const xml::Element& annotation, const std::string& scope, const std::filesystem::path& folder,
                                Scenario& scenario) {
  const std::string prefix = scope + ".";
  Scenario nested;
  nested.start = scenario.start;
  nested.stop = scenario.stop;
  nested.folder = folder;
  std::vector<std::size_t> original;  // of nested.components
  for (std::size_t i = 0; i < scenario.components.size(); ++i) {
    if (scenario.components[i].name.rfind(prefix, 0) != 0) continue;
    original.push_back(i);
    nested.components.push_back(scenario.components[i]);
    nested.components.back().name.erase(0, prefix.size());
  }
  read_annotation(annotation, nested);

  for (std::size_t i = 0; i < original.size(); ++i) {
    const ComponentSpec& from = nested.components[i];
    ComponentSpec& to = scenario.components[original[i]];
    to.stage = from.stage;
    to.period = from.period;
    to.threads = from.threads;
    to.beside = from.beside;
    to.process = from.process;
  }
  for (const auto& [name, value] : nested.settings) {
    std::error_code none;
    const bool is_file = !value.empty() && std::filesystem::is_regular_file(folder / value, none);
    const std::string found = is_file ? std::filesystem::absolute(folder / value).lexically_normal().string() : value;
    scenario.nested_settings.push_back({scope, name, found, annotation.place});
  }
  for (EventSpec e : nested.events) {
    e.variable = prefix + e.variable;
    scenario.events.push_back(std::move(e));
  }
  for (ToolSpec tool : nested.tools) {
    tool.scope = tool.scope.empty() ? scope : prefix + tool.scope;
    for (std::string& component : tool.components) component = prefix + component;
    scenario.tools.push_back(std::move(tool));
  }
  for (RecordSpec r : nested.recording) {
    r.variables = prefix + r.variables;
    scenario.recording.push_back(std::move(r));
  }
  const auto name_of = [&](const std::string& name) { return name.empty() ? name : scope + ": " + name; };
  for (ComparisonSpec c : nested.comparisons) {
    c.name = name_of(c.name);
    for (std::string* signal : {&c.a, &c.b}) *signal = prefix + *signal;
    scenario.comparisons.push_back(std::move(c));
  }
  for (BondSpec b : nested.bonds) {
    b.name = name_of(b.name);
    for (std::string* signal : {&b.effort_a, &b.flow_a, &b.effort_b, &b.flow_b}) *signal = prefix + *signal;
    scenario.bonds.push_back(std::move(b));
  }
  for (ReportSpec r : nested.reports) {
    r.name = name_of(r.name);
    r.a = prefix + r.a;
    if (!r.b.empty()) r.b = prefix + r.b;
    scenario.reports.push_back(std::move(r));
  }
  return nested;
}

std::string unused_of_nested(const xml::Element& annotation, const Scenario& nested, const Scenario& scenario) {
  std::string unused;
  const auto compare = [&](const char* name, bool given, bool same) {
    if (given && !same) text::append(unused, name);
  };
  const auto given = [&](const char* name) { return xml::find(annotation, name) != nullptr; };
  compare("tick", given("tick"), nested.tick == scenario.tick);
  compare("stop", given("stop"), nested.stop == scenario.stop);
  compare("clock", nested.clock.kind != ClockKind::kFree || given("clock"), nested.clock.kind == scenario.clock.kind);
  compare("threads", given("threads"), nested.threads == scenario.threads);
  compare("tolerance", given("tolerance"), nested.tolerance == scenario.tolerance);
  compare("coupling", given("coupling"), nested.coupling == scenario.coupling);
  compare("unknownParameters", given("unknownParameters"),
          nested.ignore_unknown_parameters == scenario.ignore_unknown_parameters);
  compare("decimation", nested.decimation != 1, nested.decimation == scenario.decimation);
  return unused;
}

}  // namespace cotwin::master
