#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "components/unit/si.h"
#include "components/unit/unit_table.h"
#include "fmu/import/fmu_store.h"
#include "fmu/import/load.h"
#include "master/ssp/scenario.h"

/// The components of a scenario with the units that stand behind them, and how a name finds a variable.
namespace cotwin::master {

struct Member {
  ComponentSpec spec;
  Instance instance;
  SettingList settings{};  // that a unit has; of an FMU none

  const std::string& name() const { return spec.name; }
  const Variables& variables() const { return instance.variables; }
};

/// A variable of a member: the whole, or one element of it.
struct Signal {
  std::size_t member = 0;
  const Variable* variable = nullptr;
  std::size_t first = 0, count = 0;  // elements
  std::string name;                  // "drive.tau_J", "drive.tau_J[3]"

  std::span<double> reals() const { return variable->reals().subspan(first, count); }
};

/// Builds every component's unit or loads its FMU, checks the connectors that the SSD lists against its variables and applies
/// the start values. Throws Error at the component's place for a unit, setting, connector or value that does not fit, and for a
/// shared setting that no unit asks for. `folders`: where units look up named data.
std::vector<Member> load_members(const Scenario& scenario, std::span<const UnitType> types,
                                 const std::vector<std::filesystem::path>& folders);

/// The parts of load_members: a component's unit or FMU, without its start values; a connector held against the variable that
/// it means; settings held against those that units asked for. `fmus`: of all components of the scenario.
Member load_member(const ComponentSpec& spec, const Scenario& scenario, std::span<const UnitType> types,
                   const std::vector<std::filesystem::path>& folders, fmu::FmuStore& fmus,
                   std::vector<std::string>* settings_used = nullptr);
void check_connector(const ConnectorSpec& connector, const Member& member, const Scenario& scenario);
void check_settings(const Scenario& scenario, std::span<Member> members, const std::vector<std::string>& used);

/// Finds signals by name, many of them; the members must not change meanwhile.
class SignalIndex {
 public:
  explicit SignalIndex(std::span<const Member> members);
  /// As find_signal below.
  Signal find(std::string_view name, const std::string& place) const;

 private:
  std::span<const Member> members_;
  std::unordered_map<std::string_view, std::size_t> by_name_;
};

/// The signal "component.variable" or "component.variable[element]". Throws Error at `place` if there is none, naming the
/// closest.
Signal find_signal(std::span<const Member> members, std::string_view name, const std::string& place);
/// The same, where only reals make sense.
Signal find_real_signal(std::span<const Member> members, std::string_view name, const std::string& place);

/// Name of one element for people and columns: "drive.q" of a scalar, "drive.q[2]" of a vector, `element` counted from 0.
std::string element_name(const std::string& member, const Variable& variable, std::size_t element);

/// The start values that the scenario gives a component. What its unit does not have is left out where the scenario allows
/// that, and told in `unknown`.
ParameterSet start_values(const Scenario& scenario, const Member& member, std::vector<std::string>* unknown = nullptr);

/// Throws Error for a start value whose name is no variable of the member; it may be the name of a setting.
void check_name(const ParameterValue& value, const Member& member);

/// What the scenario says of a component that is an FMU: its file or folder, and how it is loaded. Throws Error for a query
/// that is none.
struct FmuSource {
  std::filesystem::path path;
  fmu::LoadOptions options;
};
FmuSource fmu_source(const ComponentSpec& spec, const Scenario& scenario);

/// Whether the component is a unit of this program; else it is an FMU.
bool is_unit(const ComponentSpec& spec);

/// "an input", "a tunable": for messages.
std::string with_article(Role role);

/// The measure called `name`: one that the scenario defines, else as si::parse reads it.
si::Measure measure(const Scenario& scenario, const std::string& name);

/// `name` matches `pattern`, in which * stands for any text and ? for any character.
bool glob(std::string_view pattern, std::string_view name);

/// For messages: 'name', and "; did you mean 'the closest'?" if there is one.
std::string in_quotes(std::string_view s);
std::string suggestion(std::string_view wanted, const std::vector<std::string>& candidates);

/// `place: what`, or just `what` where there is no place.
[[noreturn]] void fail(const std::string& place, const std::string& what);

}  // namespace cotwin::master
