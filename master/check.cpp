#include "master/check.h"

#include <algorithm>
#include <ostream>

#include "fmu/process.h"
#include "master/events.h"
#include "master/omissions.h"
#include "master/recorder.h"
#include "master/schedule.h"
#include "master/statistics.h"
#include "master/wiring.h"
#include "models/text/error.h"
#include "models/text/text.h"

namespace cotwin::master {

namespace {

using fmu::Finding;

class Checker {
 public:
  Checker(std::span<const UnitType> types, const std::vector<std::filesystem::path>& folders)
      : types_(types), folders_(folders) {}

  std::vector<Finding> check(const std::filesystem::path& file) {
    Scenario scenario;
    if (attempt([&] { scenario = load_scenario(file); })) check(scenario);
    std::stable_sort(findings_.begin(), findings_.end(), [](const Finding& a, const Finding& b) { return a.level < b.level; });
    return std::move(findings_);
  }

 private:
  void check(const Scenario& scenario) {
    for (const std::string& warning : scenario.warnings) warn(warning);
    for (const ComponentSpec& spec : scenario.components) check_component(spec, scenario);
    if (members_.size() < scenario.components.size()) return;  // what names those that are missing cannot be judged
    attempt([&] { check_settings(scenario, members_, settings_used_); });
    for (const Member& member : members_) {
      for (const std::string& warning : member.instance.warnings) warn(member.name() + ": " + warning);
    }
    attempt([&] { (void)Schedule(scenario, members_); });
    check_connections(scenario);
    each(scenario, &Scenario::events, [&](const Scenario& one) { Events(one, members_, fed_); });
    each(scenario, &Scenario::recording, [&](const Scenario& one) { (void)choose_columns(one, members_); });
    const auto statistics = [&](const Scenario& one) { Statistics(one, members_, {}); };
    each(scenario, &Scenario::reports, statistics);
    each(scenario, &Scenario::comparisons, statistics);
    each(scenario, &Scenario::bonds, statistics);
  }

  void check_component(const ComponentSpec& spec, const Scenario& scenario) {
    std::optional<Member> loaded;
    std::vector<std::string> used;
    ComponentSpec checked = spec;
    if (!is_unit(spec) && spec.process == "auto" && !fmu::host_program().empty()) checked.process = "own";
    if (!attempt([&] { loaded = load_member(checked, scenario, types_, folders_, fmus_, &used); })) return;
    if (!is_unit(spec)) check_description(spec, scenario);
    Member& member = *loaded;
    settings_used_.insert(settings_used_.end(), used.begin(), used.end());
    for (const ConnectorSpec& connector : spec.connectors) attempt([&] { check_connector(connector, member, scenario); });
    const ParameterSet values = start_values(scenario, member, &member.instance.warnings);
    for (const ParameterValue& value : values.values) {
      attempt([&] {
        check_name(value, member);
        apply(ParameterSet{values.name, {value}, values.units}, member.variables());
      });
    }
    attempt([&] { member.variables().check_ranges(); }, spec.place + ": component '" + spec.name + "': ");
    members_.push_back(std::move(member));
  }

  /// What is wrong with an FMU that can be loaded.
  void check_description(const ComponentSpec& spec, const Scenario& scenario) {
    const std::filesystem::path file = scenario.folder / spec.source.substr(0, spec.source.rfind('?'));
    for (const Finding& finding : fmu::check_fmu(file, false)) {
      if (finding.level != Finding::Level::kNote) findings_.push_back({finding.level, spec.name + ": " + finding.text});
    }
  }

  /// Each connection by itself; if all are right, that no input is fed twice.
  void check_connections(const Scenario& scenario) {
    bool right = true;
    for (const ConnectionSpec& connection : scenario.connections) {
      Scenario one = only(scenario);
      one.connections = {connection};
      right = attempt([&] { fed_.push_back(resolve_links(one, members_).front().to); }) && right;
    }
    if (!right) return;
    attempt([&] {
      for (const std::string& omission : find_omissions(scenario, members_, resolve_links(scenario, members_))) warn(omission);
    });
  }

  /// `look` at scenarios that have but one item of a list.
  template <class List, class Look>
  void each(const Scenario& scenario, List Scenario::*list, Look look) {
    for (const auto& item : scenario.*list) {
      Scenario one = only(scenario);
      (one.*list) = {item};
      attempt([&] { look(one); });
    }
  }

  /// The scenario without its lists.
  static Scenario only(const Scenario& scenario) {
    Scenario one;
    one.start = scenario.start;
    one.stop = scenario.stop;
    one.tick = scenario.tick;
    one.units = scenario.units;
    return one;
  }

  template <class Call>
  bool attempt(Call call, const std::string& place = "") {
    try {
      call();
      return true;
    } catch (const Error& error) {
      findings_.push_back({Finding::Level::kError, place + error.what()});
      return false;
    }
  }
  void warn(const std::string& what) { findings_.push_back({Finding::Level::kWarning, what}); }

  std::span<const UnitType> types_;
  const std::vector<std::filesystem::path>& folders_;
  fmu::FmuStore fmus_;
  std::vector<Member> members_;
  std::vector<std::string> settings_used_;
  std::vector<Signal> fed_;
  std::vector<Finding> findings_;
};

}  // namespace

std::vector<Finding> check_scenario(const std::filesystem::path& file, std::span<const UnitType> types,
                                    const std::vector<std::filesystem::path>& folders) {
  return Checker(types, folders).check(file);
}

void write_info(std::ostream& out, const Scenario& scenario) {
  const auto seconds = [](std::int64_t ns) { return text::to_text(static_cast<double>(ns) / 1e9); };
  out << scenario.name << ": system structure (SSP 1.0), " << seconds(scenario.start.ns) << " s to "
      << seconds(scenario.stop.ns) << " s in ticks of " << seconds(scenario.tick.ns) << " s\n";
  for (const auto& [name, value] : scenario.settings) out << "  setting     " << name << " = " << value << '\n';
  for (const NestedSetting& s : scenario.nested_settings)
    out << "  setting     " << s.name << " = " << s.value << " in " << s.scope << '\n';
  for (const ComponentSpec& c : scenario.components) {
    out << "  component   " << c.name << "  " << c.source;
    if (c.stage != 0) out << ", stage " << c.stage;
    if (c.period != 1) out << ", every " << c.period << " ticks";
    if (c.process != "auto") out << ", process " << c.process;
    out << '\n';
  }
  for (const ConnectionSpec& c : scenario.connections) {
    out << "  connection  " << c.from.component << '.' << c.from.variable << " -> " << c.to.component << '.' << c.to.variable;
    if (c.factor != 1) out << " times " << text::to_text(c.factor);
    if (c.offset != 0) out << " plus " << text::to_text(c.offset);
    out << '\n';
  }
  for (const EventSpec& e : scenario.events) {
    out << "  event       " << seconds(e.time.ns) << " s  " << e.variable << " = " << e.value << '\n';
  }
}

}  // namespace cotwin::master
