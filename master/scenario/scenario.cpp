#include "master/scenario/scenario.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "components/unit/settings.h"
#include "components/unit/unit_table.h"
#include "fmu/archive/archive.h"
#include "fmu/archive/file_kind.h"
#include "master/scenario/annotation.h"
#include "master/scenario/flatten.h"
#include "master/scenario/system.h"
#include "master/scenario/uri.h"
#include "models/foundation/formats/parameter_set_xml.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

constexpr double kMaxSeconds = 9e9;  // 2^63 ns is 9.22e9 s
constexpr std::size_t kMaxWarnings = 100;

/// Reads ssd:DefaultExperiment. Without a stop time the run lasts one second.
void read_experiment(const xml::Element& document, const xml::Complaint& complain, Scenario& scenario) {
  const xml::Element* experiment = xml::child(document, ssp::kSsd, "DefaultExperiment");
  double start = 0, stop = 1;
  if (experiment != nullptr) {
    xml::check_attributes(*experiment, {"startTime", "stopTime"}, complain);
    start = xml::real(*experiment, "startTime", 0.0);
    stop = xml::real(*experiment, "stopTime", start + 1);
    if (!(std::abs(start) <= kMaxSeconds && std::abs(stop) <= kMaxSeconds && start <= stop)) {
      throw Error(experiment->place, "start time " + text::to_text(start) + " s, stop time " + text::to_text(stop) +
                                         " s, expected a stop time not before the start time, both within ±" +
                                         text::to_text(kMaxSeconds) + " s");
    }
  }
  scenario.start = Time::from_seconds(start);
  scenario.stop = Time::from_seconds(stop);
}

/// Reads the step of the fixed-step master in the annotations of the Open Simulation Platform, which has changed their names over time.
void read_osp_step(const xml::Element& document, Scenario& scenario) {
  for (const xml::Element* holder :
       {&document, xml::child(document, ssp::kSsd, "System"), xml::child(document, ssp::kSsd, "DefaultExperiment")}) {
    const xml::Element* list = holder != nullptr ? xml::child(*holder, ssp::kSsd, "Annotations") : nullptr;
    if (list == nullptr) continue;
    for (const xml::Element& annotation : list->children) {
      const std::string type = xml::text(annotation, "type", "");
      if (type != "com.opensimulationplatform" && type != "org.open-simulation-platform") continue;
      for (const xml::Element& outer : annotation.children) {
        for (const xml::Element& algorithm : outer.children) {
          if (algorithm.name != "FixedStepAlgorithm" && algorithm.name != "FixedStepMaster") continue;
          const char* const name = xml::find(algorithm, "baseStepSize") != nullptr ? "baseStepSize" : "stepSize";
          scenario.tick = read_duration(algorithm, name, 1e-9);
        }
      }
    }
  }
}

/// Collects the elements with annotations of nested documents, outer ones first.
void collect_nested(const ssp::Element& element, std::vector<const ssp::Element*>& found) {
  if (element.annotation) found.push_back(&element);
  for (const ssp::Element& e : element.elements) collect_nested(e, found);
}

/// Returns the parts of a setting or parameter that can be file names: each item of a list `left:lwr4,right:panda.urdf`.
std::vector<std::string_view> possible_files(std::string_view text) {
  std::vector<std::string_view> parts{text};
  for (const std::string_view item : text::split(text, ',')) {
    parts.push_back(text::trim(item));
    if (const std::size_t colon = item.find(':'); colon != std::string_view::npos)
      parts.push_back(text::trim(item.substr(colon + 1)));
  }
  return parts;
}

/// Throws Error if a setting or parameter in a package names a file outside the package.
void check_inside(std::string_view text, const std::string& what, const std::string& place) {
  for (const std::string_view part : possible_files(text)) {
    const std::filesystem::path path = std::filesystem::path(part).lexically_normal();
    if (path.is_absolute() || (!path.empty() && *path.begin() == ".."))
      throw Error(place, what + ": '" + std::string(part) + "' is outside the package, expected a file in it");
  }
}

void check_inside(const Scenario& scenario) {
  for (const auto& [key, value] : scenario.settings) check_inside(value, "setting '" + key + "'", scenario.file.string());
  for (const NestedSetting& nested : scenario.nested_settings) {
    // Files in the folder of a nested document were already replaced by their absolute paths.
    const std::filesystem::path path = std::filesystem::path(nested.value).lexically_relative(scenario.folder);
    if (path.empty() || *path.begin() == "..") check_inside(nested.value, "setting '" + nested.name + "'", nested.place);
  }
  for (const ComponentSpec& component : scenario.components) {
    if (ssp::scheme_of(component.source) != "unit") continue;
    const std::string what = "component '" + component.name + "'";
    const std::string query = parse_unit_source(component.source).query;
    for (const std::string_view setting : text::split(query, '&')) {
      const std::size_t value = std::min(setting.find('='), setting.size() - 1) + 1;
      check_inside(ssp::percent_decoded(std::string(setting.substr(value)), component.place), what, component.place);
    }
    for (const ParameterValue& value : component.start_values) {
      if (const auto* text = std::get_if<std::string>(&value.value))
        check_inside(*text, what + ", parameter '" + value.name + "'", value.place);
    }
  }
}

/// `confined`: the document is in a package with the root `folder`.
Scenario read(std::string_view text, const std::string& place, const std::filesystem::path& folder,
              const std::filesystem::path& file, bool confined = false) {
  const xml::Element document = xml::parse(text, place);
  Scenario scenario;
  scenario.file = file;
  scenario.folder = folder;
  scenario.name = xml::text(document, "name", "");

  // A file with our annotation was written for this master: unknown items are then errors, not foreign extensions.
  const xml::Element* annotation = find_annotation(document);
  xml::Complaint complain = xml::refuse;
  if (annotation == nullptr) {
    scenario.ignore_unknown_parameters = true;
  } else {
    scenario.ignore_unknown_parameters = xml::text(*annotation, "unknownParameters", "error") == "ignore";
  }
  const auto note = [&scenario](const std::string& where, const std::string& what) {
    if (scenario.warnings.size() < kMaxWarnings) scenario.warnings.push_back(where.empty() ? what : where + ": " + what);
    if (scenario.warnings.size() == kMaxWarnings) scenario.warnings.push_back("further warnings are not shown");
  };
  if (annotation == nullptr) complain = note;

  ssp::UnitTable units;
  for (const UnitDefinition& d : read_unit_definitions(document, complain)) units.add(d);
  const ssp::Element root = ssp::Reader(units, complain).read(document, folder, file, confined);
  ssp::flatten(root, units, scenario.ignore_unknown_parameters ? xml::Complaint(note) : complain, scenario);
  scenario.units = units.definitions();
  read_experiment(document, complain, scenario);
  read_osp_step(document, scenario);

  std::vector<const ssp::Element*> nested;
  collect_nested(root, nested);
  std::vector<Scenario> alone;
  for (const ssp::Element* e : nested) alone.push_back(read_nested_annotation(*e->annotation, e->path, e->folder, scenario));
  const std::vector<RecordSpec> recorded = std::exchange(scenario.recording, {});
  if (annotation != nullptr) read_annotation(*annotation, scenario);
  if (scenario.recording.empty() && !recorded.empty()) scenario.all_outputs = true;
  scenario.recording.insert(scenario.recording.end(), recorded.begin(), recorded.end());
  std::stable_sort(scenario.events.begin(), scenario.events.end(),
                   [](const EventSpec& a, const EventSpec& b) { return a.time < b.time; });
  std::stable_sort(scenario.tools.begin(), scenario.tools.end(),
                   [](const ToolSpec& a, const ToolSpec& b) { return a.time < b.time; });
  for (std::size_t i = 0; i < nested.size(); ++i) {
    const std::string unused = unused_of_nested(*nested[i]->annotation, alone[i], scenario);
    if (unused.empty()) continue;
    note(nested[i]->annotation->place, unused + " of the nested scenario '" + nested[i]->path +
                                           "' has no effect: the outer scenario's value applies to the whole run");
  }
  if (confined) check_inside(scenario);
  return scenario;
}

/// Returns a value of the command line. The name of a file in the working directory becomes an absolute path, because units
/// look up relative paths in the scenario's folder first.
std::string from_working_directory(const std::string& value) {
  const bool may_be_path = value.find_first_of("/.") != std::string::npos && !text::parse_real(value);
  std::error_code error;
  if (!may_be_path || !std::filesystem::is_regular_file(value, error)) return value;
  const std::filesystem::path absolute = std::filesystem::absolute(value, error);
  return error ? value : absolute.lexically_normal().string();
}

void assign_setting(Scenario& scenario, const std::string& component, const std::string& key, const std::string& value,
                    const std::string& place) {
  std::vector<std::string> names;
  for (ComponentSpec& c : scenario.components) {
    names.push_back(c.name);
    if (c.name != component) continue;
    c.source = with_setting(c.source, key, value);
    return;
  }
  throw Error(place, xml::unknown("a component", component, names));
}

/// Replaces the folder to which a package was unpacked by the package's name.
std::string renamed(std::string text, const std::string& folder, const std::string& package) {
  for (std::size_t at = 0; (at = text.find(folder, at)) != std::string::npos; at += package.size()) {
    text.replace(at, folder.size(), package);
  }
  return text;
}

/// Calls `change` for every place and warning of a scenario.
template <class Change>
void for_each_text(Scenario& scenario, Change change) {
  for (ComponentSpec& component : scenario.components) {
    change(component.place);
    for (ConnectorSpec& connector : component.connectors) change(connector.place);
    for (ParameterValue& value : component.start_values) change(value.place);
  }
  const auto change_all = [&](auto& list) {
    for (auto& item : list) change(item.place);
  };
  change_all(scenario.connections);
  change_all(scenario.events);
  change_all(scenario.tools);
  change_all(scenario.recording);
  change_all(scenario.comparisons);
  change_all(scenario.bonds);
  change_all(scenario.reports);
  change_all(scenario.nested_settings);
  for (std::string& warning : scenario.warnings) change(warning);
}

Scenario load_package(const std::filesystem::path& package) {
  fmu::sweep_temporary_folders();
  const auto unpacked = std::make_shared<const fmu::TemporaryFolder>(fmu::unpack_archive(package));
  const auto name = [&](std::string& text) { text = renamed(std::move(text), unpacked->path().string(), package.string()); };
  try {
    const std::filesystem::path file = unpacked->path() / "SystemStructure.ssd";
    if (!std::filesystem::is_regular_file(file))
      throw Error(package.string(), "contains no SystemStructure.ssd, expected an SSP");
    Scenario scenario = read(read_text_file(file, "a system structure (.ssd)"), file.string(), unpacked->path(), file, true);
    for_each_text(scenario, name);
    scenario.file = package;
    scenario.unpacked = unpacked;
    return scenario;
  } catch (const Error& error) {
    throw Error(renamed(error.what(), unpacked->path().string(), package.string()));
  }
}

}  // namespace

Scenario load_scenario(const std::filesystem::path& file) {
  if (fmu::has_ending(file, ".ssp") || fmu::is_archive(file)) return load_package(file);
  return read(read_text_file(file, "a system structure (.ssd)"), file.string(), file.parent_path(), file);
}

Scenario parse_scenario(std::string_view xml, const std::string& place, const std::filesystem::path& folder) {
  return read(xml, place, folder, {});
}

std::string with_setting(const std::string& source, const std::string& key, const std::string& value) {
  const bool of_unit = source.rfind("unit:", 0) == 0;
  const std::size_t question = of_unit ? source.find('?') : source.rfind('?');
  std::string query;
  if (question != std::string::npos && question + 1 < source.size()) {
    for (const std::string_view pair : text::split(std::string_view(source).substr(question + 1), '&')) {
      if (pair.substr(0, pair.find('=')) == key) continue;
      query += (query.empty() ? "" : "&") + std::string(pair);
    }
  }
  return source.substr(0, question) + "?" + query + (query.empty() ? "" : "&") + key + "=" +
         (of_unit ? escape_setting(value) : value);
}

bool has_setting(const std::string& source, const std::string& key, std::span<const UnitType> types) {
  if (source.rfind("unit:", 0) != 0) return false;
  const std::string unit = parse_unit_source(source).unit;
  const auto type = std::find_if(types.begin(), types.end(), [&](const UnitType& t) { return t.name == unit; });
  return type != types.end() && settings_of(*type).find(key) != nullptr;
}

std::map<std::string, std::string> settings_for(const Scenario& scenario, std::string_view component) {
  std::map<std::string, std::string> settings = scenario.settings;
  for (const NestedSetting& nested : scenario.nested_settings) {
    if (component.size() > nested.scope.size() && component.substr(0, nested.scope.size()) == nested.scope &&
        component[nested.scope.size()] == '.')
      settings[nested.name] = nested.value;
  }
  return settings;
}

ComponentIndex::ComponentIndex(const Scenario& scenario) {
  for (std::size_t i = 0; i < scenario.components.size(); ++i) by_name_.emplace(scenario.components[i].name, i);
}

std::optional<std::size_t> ComponentIndex::find(std::string_view name) const {
  const auto found = by_name_.find(name);
  return found == by_name_.end() ? std::nullopt : std::optional(found->second);
}

bool ComponentIndex::has_owner(std::string_view name) const {
  for (std::size_t dot = name.find('.'); dot != std::string_view::npos; dot = name.find('.', dot + 1)) {
    if (dot + 1 < name.size() && by_name_.contains(name.substr(0, dot))) return true;
  }
  return false;
}

std::optional<Port> split_name(const Scenario& scenario, std::string_view name) {
  const ComponentSpec* best = nullptr;
  for (const ComponentSpec& c : scenario.components) {
    const bool starts =
        name.size() > c.name.size() + 1 && name.substr(0, c.name.size()) == c.name && name[c.name.size()] == '.';
    if (starts && (best == nullptr || c.name.size() > best->name.size())) best = &c;
  }
  if (best == nullptr) return std::nullopt;
  return Port{best->name, std::string(name.substr(best->name.size() + 1)), ""};
}

void assign(Scenario& scenario, std::string_view assignment, std::span<const UnitType> types) {
  const std::string place = "--set " + std::string(assignment);
  const std::size_t equals = assignment.find('=');
  const std::string name(text::trim(assignment.substr(0, equals)));
  if (equals == std::string_view::npos || name.empty()) {
    throw Error(place,
                "expected component.variable=value, component.variable[2]=value, component.setting=value or setting=value");
  }
  const std::string value = from_working_directory(std::string(assignment.substr(equals + 1)));
  if (const std::size_t question = name.find('?'); question != std::string::npos) {
    const std::string key = name.substr(question + 1);
    if (key.empty()) throw Error(place, "expected component?setting=value");
    return assign_setting(scenario, name.substr(0, question), key, value, place);
  }
  if (name.find('.') == std::string::npos) {
    scenario.settings[name] = value;
    std::erase_if(scenario.nested_settings, [&](const NestedSetting& s) { return s.name == name; });
    return;
  }
  const std::optional<Port> port = split_name(scenario, name);
  if (!port) {
    std::vector<std::string> candidates;
    const std::string tail = name.substr(name.rfind('.') + 1);
    for (const ComponentSpec& c : scenario.components) candidates.push_back(c.name + "." + tail);
    throw Error(place, xml::unknown("a variable of a component", name, candidates));
  }
  for (ComponentSpec& c : scenario.components) {
    if (c.name != port->component) continue;
    if (has_setting(c.source, port->variable, types)) {
      c.source = with_setting(c.source, port->variable, value);
      continue;
    }
    // As a string: the unit converts it to the variable's kind, one value for all elements or one for each.
    c.start_values.push_back({port->variable, value, "", place, true});
  }
}

namespace {

/// The event of `--attach` or `--detach` without its time.
xml::Element tool_event(const std::string& kind, std::string_view items, const std::string& place, const std::string& form) {
  xml::Element event;
  event.name = kind;
  event.place = xml::Place(xml::Shared(place), 0);
  std::string name = kind;  // of the attribute that the first item gives
  for (const std::string_view item : text::split(items, ',')) {
    const std::size_t equals = name == kind ? std::string_view::npos : item.find('=');
    if (name.empty() && equals == std::string_view::npos) throw Error(place, "'" + std::string(item) + "', " + form);
    if (equals != std::string_view::npos) name = text::trim(item.substr(0, equals));
    if (xml::find(event, name) != nullptr) throw Error(place, "'" + name + "' stands there twice");
    event.attributes.push_back(
        {{}, name, std::string(text::trim(equals == std::string_view::npos ? item : item.substr(equals + 1)))});
    name.clear();
  }
  return event;
}

}  // namespace

void add_tool_event(Scenario& scenario, bool attach, std::string_view text) {
  const std::string kind = attach ? "attach" : "detach", place = "--" + kind + " " + std::string(text);
  const std::string form = attach ? "expected NAME,parent=FRAME,mass=KG,com=X Y Z,…@TIME" : "expected NAME@TIME";
  const std::size_t at = text.rfind('@');
  if (at == std::string_view::npos) throw Error(place, "has no time, " + form);
  xml::Element event = tool_event(kind, text.substr(0, at), place, form);
  if (xml::find(event, "time") != nullptr) throw Error(place, "'time' stands there twice");
  event.attributes.push_back({{}, "time", std::string(text::trim(text.substr(at + 1)))});
  scenario.tools.push_back(read_tool(event, ""));
  std::stable_sort(scenario.tools.begin(), scenario.tools.end(),
                   [](const ToolSpec& a, const ToolSpec& b) { return a.time < b.time; });
}

ToolSpec parse_tool(std::string_view text) {
  const std::string place = "tool " + std::string(text);
  xml::Element event = tool_event("attach", text, place, "expected NAME,parent=FRAME,mass=KG,com=X Y Z,…");
  for (const char* name : {"time", "known", "robot", "components"}) {
    if (xml::find(event, name) != nullptr) throw Error(place, "'" + std::string(name) + "' is only for tools of a run");
  }
  event.attributes.push_back({{}, "time", "0"});
  return read_tool(event, "");
}

std::vector<int> parse_cpus(const std::string& list) {
  std::vector<int> cpus;
  std::string blanks = list;
  std::replace(blanks.begin(), blanks.end(), ',', ' ');
  for (const std::string_view item : text::split(blanks, ' ')) {
    if (item.empty()) continue;
    const std::optional<double> number = text::parse_real(item);
    if (!number || !(*number >= 0 && *number < 1e6) || *number != std::floor(*number))
      throw Error("'" + list + "', expected numbers of CPUs such as '2' or '2 3'");
    cpus.push_back(static_cast<int>(*number));
  }
  if (cpus.empty()) throw Error("'" + list + "', expected numbers of CPUs such as '2' or '2 3'");
  return cpus;
}

void choose_clock(ClockSpec& clock, const std::string& text) {
  const std::string place = "--clock " + text;
  const std::size_t colon = text.find(':');
  ClockSpec chosen;
  chosen.kind = text::choose(place, text.substr(0, colon), kClockWords);
  chosen.place = place;
  if (colon != std::string::npos) {
    if (!chosen.follows()) throw Error(place, "a component, expected one only with 'arrivals' or 'locked'");
    chosen.component = text.substr(colon + 1);
  }
  if (chosen.kind != ClockKind::kFree) {
    chosen.overrun = clock.overrun;
    chosen.late = clock.late;
    chosen.priority = clock.priority;
    chosen.cpus = clock.cpus;
  }
  if (chosen.follows()) {
    if (colon == std::string::npos) chosen.component = clock.component;
    chosen.silence = clock.silence;
    chosen.timeout = clock.timeout;
    chosen.cycle = clock.cycle;
  }
  if (chosen.kind == ClockKind::kLocked) {
    chosen.shift = clock.shift;
    chosen.bandwidth = clock.bandwidth;
    chosen.within = clock.within;
  }
  clock = std::move(chosen);
}

}  // namespace cotwin::master
