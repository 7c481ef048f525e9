#include "master/workflows/check.h"

#include <algorithm>
#include <ostream>
#include <set>

#include "master/clock/clock.h"
#include "master/engine/coupling/bonds.h"
#include "master/engine/events.h"
#include "master/engine/threaded_unit.h"
#include "master/engine/tools.h"
#include "master/engine/wiring/arrangement.h"
#include "master/engine/wiring/schedule.h"
#include "master/engine/wiring/wiring.h"
#include "master/run/master.h"
#include "master/run/omissions.h"
#include "master/run/recorder.h"
#include "master/run/separation_loop.h"
#include "master/run/statistics.h"
#include "master/workflows/coupling_check.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

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
    if (members_.size() < scenario.components.size()) return;  // references to components that failed to load cannot be checked
    attempt([&] { check_settings(scenario, members_, settings_used_); });
    for (const Member& member : members_) {
      for (const std::string& warning : member.instance.warnings) warn(member.name() + ": " + warning);
    }
    attempt([&] { (void)Schedule(scenario, members_, arrange_as_given(members_)); });
    check_connections(scenario);
    Events(scenario, members_, fed_, [&](const Error& error) { add(error.what()); });
    Tools(scenario, members_, fed_, [&](const Error& error) { add(error.what()); });
    each(scenario, &Scenario::recording, [&](const Scenario& one) { (void)choose_columns(one, members_); });
    const auto statistics = [&](const Scenario& one) { Statistics(one, members_, {}); };
    each(scenario, &Scenario::reports, statistics);
    each(scenario, &Scenario::comparisons, statistics);
    each(scenario, &Scenario::bonds, [&](const Scenario& one) { Bonds(one, members_); });
    attempt([&] { (void)make_clock(scenario.clock, scenario.tick, members_); });
    if (errors_ > 0) return;
    attempt([&] {
      for (Finding& finding : check_coupling(scenario, members_)) findings_.push_back(std::move(finding));
    });
    if (errors_ == 0) try_to_begin(scenario);
  }

  /// Does what a run does before its first tick, without results, and without a clock that waits. Not with units that would then reach
  /// outside.
  void try_to_begin(const Scenario& scenario) {
    if (const auto outside = std::ranges::find_if(members_, reaches_outside); outside != members_.end()) {
      findings_.push_back({Finding::Level::kNote, "the initialisation is not tried, because '" + outside->name() +
                                                      "' would reach outside this program"});
      return;
    }
    Scenario trial = scenario;
    trial.clock = {};
    for (ComponentSpec& spec : trial.components) spec.process = trial_process(spec);
    members_.clear();  // some FMUs allow one instance
    attempt([&] {
      MasterOptions options;
      options.types = types_;
      options.folders = folders_;
      options.threads = 1;
      Master master(std::move(trial), std::move(options));
      master.initialise();
    });
  }

  void check_component(const ComponentSpec& spec, const Scenario& scenario) {
    std::optional<Member> loaded;
    std::vector<std::string> used;
    ComponentSpec checked = spec;
    checked.process = trial_process(spec);
    if (!attempt([&] { loaded = load_member(checked, scenario, types_, folders_, fmus_, &used); })) return;
    if (!is_unit(spec)) check_description(spec, scenario);
    Member& member = *loaded;
    settings_used_.insert(settings_used_.end(), used.begin(), used.end());
    for (const ConnectorSpec& connector : spec.connectors) attempt([&] { check_connector(connector, member, scenario); });
    ParameterSet values = start_values(scenario, member, &member.instance.warnings);
    const auto apply_all = [&] {
      for (const ParameterValue& value : values.values) check_name(value, member);
      apply(values, member.variables());
    };
    if (succeeds(apply_all)) {
      member.given = given_starts(values, member);
    } else {
      ParameterSet one{values.name, {{}}, values.units};
      for (ParameterValue& value : values.values) {
        one.values.front() = std::move(value);
        attempt([&] {
          check_name(one.values.front(), member);
          apply(one, member.variables());
        });
        if (errors_ > kMostErrors) break;
      }
    }
    attempt([&] { member.variables().check_ranges(); }, spec.place + ": component '" + spec.name + "': ");
    members_.push_back(std::move(member));
  }

  /// Adds the findings about an FMU that can be loaded.
  void check_description(const ComponentSpec& spec, const Scenario& scenario) {
    const std::filesystem::path file = scenario.folder / spec.source.substr(0, spec.source.rfind('?'));
    for (const Finding& finding : fmu::check_fmu(file, false)) {
      if (finding.level != Finding::Level::kNote) findings_.push_back({finding.level, spec.name + ": " + finding.text});
    }
  }

  void check_connections(const Scenario& scenario) {
    const std::size_t errors_before = errors_;
    attempt([&] { put_on_threads(scenario, members_, ThreadMode::kInStep); });
    const std::vector<ResolvedConnection> links =
        resolve_connections(scenario, members_, [&](const Error& error) { add(error.what()); });
    for (const ResolvedConnection& link : links) fed_.push_back(link.to);
    if (errors_ > errors_before) return;
    attempt([&] {
      for (const std::string& omission : find_omissions(scenario, members_, links)) warn(omission);
    });
    const SeparationLoop separation = trace_separation(scenario, members_, links);
    for (const std::string& warning : separation.warnings) warn(warning);
    for (const std::string& note : separation.notes) findings_.push_back({Finding::Level::kNote, note});
    if (scenario.coupling != CouplingChoice::kImplicit) check_torques(links);
  }

  /// The stiffness that a controller tells as safe, K_e_max, is that of torques that act in the tick in which they are computed.
  void check_torques(const std::vector<ResolvedConnection>& links) {
    std::set<std::pair<std::size_t, std::size_t>> told;
    for (const ResolvedConnection& link : links) {
      const Member &from = members_[link.from.member], &to = members_[link.to.member];
      const auto tells = [](const Variable& v) { return v.name.ends_with("K_e_max"); };
      if (!link.from.variable->name.ends_with("tau_m") || !link.to.variable->essential) continue;  // a meter may read it late
      if (std::ranges::none_of(from.variables(), tells)) continue;
      if (to.spec.stage > from.spec.stage || !told.emplace(link.from.member, link.to.member).second) continue;
      warn("'" + to.name() + "' is in stage " + std::to_string(to.spec.stage) + " and '" + from.name() + "' in stage " +
           std::to_string(from.spec.stage) + ": the torque " + link.from.name +
           " arrives a tick late, so that the robot may vibrate at walls softer than K_e_max; expected a later stage of '" +
           to.name() + "'");
    }
  }

  /// Runs `examine` on a scenario that has only this list. If that throws, runs it on scenarios with one item of the list each,
  /// so that every faulty item is reported.
  template <class List, class Examine>
  void each(const Scenario& scenario, List Scenario::*list, Examine examine) {
    Scenario all = only(scenario);
    all.*list = scenario.*list;
    if (succeeds([&] { examine(all); })) return;
    for (const auto& item : scenario.*list) {
      if (errors_ > kMostErrors) return;
      Scenario one = only(scenario);
      (one.*list) = {item};
      attempt([&] { examine(one); });
    }
  }

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
      add(place + error.what());
      return false;
    }
  }
  template <class Call>
  static bool succeeds(Call call) {
    try {
      call();
      return true;
    } catch (const Error&) {
      return false;
    }
  }
  void add(const std::string& error) {
    if (++errors_ < kMostErrors) findings_.push_back({Finding::Level::kError, error});
    if (errors_ == kMostErrors) findings_.push_back({Finding::Level::kError, "further errors are not shown"});
  }
  void warn(const std::string& what) { findings_.push_back({Finding::Level::kWarning, what}); }

  std::span<const UnitType> types_;
  const std::vector<std::filesystem::path>& folders_;
  fmu::FmuStore fmus_;
  std::vector<Member> members_;
  std::vector<std::string> settings_used_;
  std::vector<Signal> fed_;
  std::vector<Finding> findings_;
  static constexpr std::size_t kMostErrors = 1000;
  std::size_t errors_ = 0;
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
    if (c.process != fmu::ProcessChoice::kAuto) out << ", process " << text::word_of(c.process, fmu::kProcessWords);
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
  for (const ToolSpec& tool : scenario.tools) {
    out << "  event       " << seconds(tool.time.ns) << " s  " << (tool.attach ? "attach " : "detach ") << tool.name;
    if (tool.attach)
      out << " to " << tool.parent << ", " << text::to_text(tool.mass) << " kg" << (tool.known ? "" : ", not known");
    out << '\n';
  }
}

}  // namespace cotwin::master
