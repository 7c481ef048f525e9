#pragma once
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "components/unit/si.h"
#include "components/unit/unit_table.h"
#include "fmu/import/fmu_store.h"
#include "fmu/import/load.h"
#include "master/scenario/scenario.h"

/// The components of a scenario with their units, and the look-up of variables by name.
namespace cotwin::master {

/// A start value of one real element that the scenario gives, in the variable's own unit of measure.
struct GivenStart {
  std::string variable;
  std::size_t element = 0;
  double value = 0;

  static auto fields(auto& g, auto each) { return each(g.variable, g.element, g.value); }
};

struct Member {
  ComponentSpec spec;
  Instance instance;
  SettingList settings{};           // of a unit; empty for an FMU
  std::vector<GivenStart> given{};  // of inputs and outputs

  /// The start value that the scenario gives to the element.
  std::optional<double> start_of(const Variable& variable, std::size_t element) const;
  const std::string& name() const { return spec.name; }
  const Variables& variables() const { return instance.variables; }
};

/// A variable of a member, or one of its elements.
struct Signal {
  std::size_t member = 0;
  const Variable* variable = nullptr;
  std::size_t first = 0, count = 0;  // elements
  std::string name;                  // "drive.tau_J", "drive.tau_J[3]"

  std::span<double> reals() const { return variable->reals().subspan(first, count); }
  /// The unit of measure of its elements; "" where they differ.
  std::string si() const { return of_elements().si.empty() ? variable->si_of(first) : ""; }
  /// Names and units of measure of its elements.
  Elements of_elements() const;
};

/// Builds each component's unit or loads its FMU, compares the connectors of the SSD with its variables and applies the start
/// values. Throws Error at the component's place for an invalid unit, setting, connector or value, and for a shared setting
/// that no unit reads. `folders`: where units search for named data; `models`: as for Settings.
std::vector<Member> load_members(const Scenario& scenario, std::span<const UnitType> types,
                                 const std::vector<std::filesystem::path>& folders,
                                 const std::shared_ptr<FileStore>& models = nullptr);

/// The steps of load_members: builds a component's unit or FMU without its start values; compares a connector with its
/// variable; compares the settings with those that units have read. `fmus`: shared by all components of the scenario.
Member load_member(const ComponentSpec& spec, const Scenario& scenario, std::span<const UnitType> types,
                   const std::vector<std::filesystem::path>& folders, fmu::FmuStore& fmus,
                   std::vector<std::string>* settings_used = nullptr, const std::shared_ptr<FileStore>& models = nullptr);
void check_connector(const ConnectorSpec& connector, const Member& member, const Scenario& scenario);
void check_settings(const Scenario& scenario, std::span<Member> members, const std::vector<std::string>& used);

/// An index to find many signals by name. The members must not change during its lifetime.
class SignalIndex {
 public:
  explicit SignalIndex(std::span<const Member> members);
  /// As find_signal below.
  Signal find(std::string_view name, const std::string& place) const;

 private:
  std::span<const Member> members_;
  std::unordered_map<std::string_view, std::size_t> by_name_;
};

/// The signal "component.variable" or "component.variable[element]". If there is none, throws Error at `place` with the closest
/// name.
Signal find_signal(std::span<const Member> members, std::string_view name, const std::string& place);
/// The same; throws Error also if the variable is not real.
Signal find_real_signal(std::span<const Member> members, std::string_view name, const std::string& place);

/// Name of one element in columns and messages: "drive.q" of a scalar, "drive.q[2]" of a vector. `element` counts from 0.
std::string element_name(const std::string& member, const Variable& variable, std::size_t element);

/// "u.tau[2] is nan at t = 0.3 s, expected a finite output"
std::string not_finite(const Member& member, const Variable& variable, std::size_t element, double value, double seconds);
/// Whether all real inputs are finite and below 1e12 in SI. Values of loops that diverge are larger before they are not finite.
bool has_moderate_inputs(const Member& member);
/// For a value that is not finite of a unit with such inputs in a loop.
inline constexpr const char* kOwnFault = ", its inputs were finite: the fault is in this unit, not in the loop that it is in";

/// The start values of a component. Where the scenario permits unknown parameters, names that the unit does not have are left
/// out and listed in `unknown`.
ParameterSet start_values(const Scenario& scenario, const Member& member, std::vector<std::string>* unknown = nullptr);

/// The values of `set` that were applied to real inputs and outputs of the member (Member::given).
std::vector<GivenStart> given_starts(const ParameterSet& set, const Member& member);

/// Throws Error for a start value whose name is not a variable of the member; the message says if it is a setting.
void check_name(const ParameterValue& value, const Member& member, std::span<const Member> all = {});

/// File or folder of a component that is an FMU, and its options for loading. Throws Error for an invalid query.
struct FmuSource {
  std::filesystem::path path;
  fmu::LoadOptions options;
};
FmuSource fmu_source(const ComponentSpec& spec, const Scenario& scenario);

/// The robots of an unpacked FMU that was made from a unit of this program; none for other FMUs.
std::vector<std::shared_ptr<const robot::RobotModel>> robots_of_fmu(const std::filesystem::path& folder);

/// Whether the component is a unit of this program; otherwise it is an FMU.
bool is_unit(const ComponentSpec& spec);
/// Whether it is this one, "motion".
bool is_unit_of(const ComponentSpec& spec, const char* type);

/// Whether the component is a unit that would reach a robot, a bus or a network when it is initialised.
bool reaches_outside(const Member& member);

/// The process in which an FMU of the component is tried: its own, unless the scenario chooses.
fmu::ProcessChoice trial_process(const ComponentSpec& spec);

/// "an input", "a tunable": for messages.
std::string with_article(Role role);

/// The unit of measure `name`: as the scenario defines it, otherwise from si::parse.
si::Measure measure(const Scenario& scenario, const std::string& name);

/// Whether `name` matches `pattern`, where * matches any text and ? any character.
bool glob(std::string_view pattern, std::string_view name);

/// For messages: 'name', and "; did you mean 'closest'?" if a candidate is similar.
std::string in_quotes(std::string_view s);
std::string suggestion(std::string_view wanted, const std::vector<std::string>& candidates);

/// `what` without the name of the component where it begins with that: "drive.K: …" and "drive: …" of component drive.
std::string without_component(const std::string& component, const std::string& what);

/// Throws Error `place: what`, or `what` if the place is empty.
[[noreturn]] void fail(const std::string& place, const std::string& what);

}  // namespace cotwin::master
