#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "components/unit/si.h"
#include "components/unit/time.h"
#include "components/unit/unit_table.h"
#include "models/support/parameter_set.h"

/// A scenario: what differs between two runs. Read from an SSP 1.0 system structure (.ssd) and our annotation in it; a plain
/// value with nested systems already flattened, parameter bindings applied in order of priority, and every place remembered for
/// messages.
namespace cotwin::master {

/// A connector of a component as the SSD lists it (optional for unit: sources).
struct ConnectorSpec {
  std::string name;  // variable, or one element "q[3]"
  std::string kind;  // "input", "output", "inout", "parameter", "calculatedParameter"
  std::string type;  // "Real", "Integer", "Boolean", "String", "Enumeration", "Binary"; "" if not given
  std::string unit;  // "" if not given
  std::string place;
};

struct ComponentSpec {
  std::string name;    // flattened: "cell.robot.drive"
  std::string source;  // "unit:drive_train?robot=lwr4", "plant.fmu"
  std::string type;    // the SSD's type attribute
  std::string place;   // "twin.ssd:17"
  std::vector<ConnectorSpec> connectors;
  std::vector<ParameterValue> start_values;  // in order of application: later ones win
  int stage = 0;                             // stages run one after the other within a tick; same stage: Jacobi
  int period = 1;                            // in ticks
  bool threads = true;                       // false: never on a worker thread
  std::string implementation = "any";        // of an FMU that has several: "any", "CoSimulation", "ModelExchange"
  std::string process = "auto";              // of an FMU: "shared" with the master, its "own", or "auto" (fmu/import/load.h)
};

/// One end of a connection: a component's variable, whole or one element.
struct Port {
  std::string component;
  std::string variable;  // may carry an element: "q[3]"
  std::string unit;      // of the connector, "" if not given
};

struct ConnectionSpec {
  Port from, to;
  double factor = 1, offset = 0;  // of ssc:LinearTransformation, applied after conversion of units of measure
  bool suppress_unit_conversion = false;
  std::string place;
};

/// "at time, component.variable becomes value", at once or along a line of the given duration.
struct EventSpec {
  Time time;
  std::string variable;  // "drive.tau_e", "drive.tau_e[2]": an input that nothing is connected to, or a tunable
  std::string value;
  Duration ramp;  // 0: a jump
  std::string place;
};

struct RecordSpec {
  std::string variables;  // "drive.q", "drive.*", "*.tau_J"; glob over component.variable
  std::string place;
};

/// A setting of a nested scenario: a default for the units below the component `scope`.
struct NestedSetting {
  std::string scope, name, value;
  std::string place;
};

/// Two signals of a run held against each other: Table I and Fig. 10.
struct ComparisonSpec {
  std::string name;  // "joint torque"
  std::string a, b;  // "drive.tau_J", "recording.tau"
  int segments = 8;
  std::optional<Time> from, to;
  std::string place;
};

/// A power bond between two units: effort · flow on side a should leave what effort · flow on side b takes up.
struct BondSpec {
  std::string name;
  std::string effort_a, flow_a;  // "drive.tau_J", "drive.dq"
  std::string effort_b, flow_b;  // the other unit's variables
  double tolerance = 0;          // J; a larger leak is told at the end of the run; 0: only recorded
  std::string place;
};

/// What the summary at the end of a run tells of its signals, per element and in one line for all.
///   signal      RMS and largest magnitude of `a`
///   difference  the same of a − b, e.g. a tracking error
///   energy      the integral of Σ a·b over time, `a` an effort and `b` a flow
struct ReportSpec {
  std::string name;             // "joint torque"; "": made from kind and signals
  std::string kind = "signal";  // "signal", "difference", "energy"
  std::string a, b;             // "drive.tau_J"; b is empty for a signal
  std::string place;
};

struct Scenario {
  std::string name;
  std::filesystem::path file;    // where it was read from
  std::filesystem::path folder;  // where relative references start
  Time start, stop;              // ssd:DefaultExperiment
  Duration tick{1'000'000};
  std::string clock = "free";                   // "free", "real-time"
  int threads = 0;                              // 0: as many as pay
  double tolerance = 0;                         // > 0: adaptive communication step (relative)
  std::map<std::string, std::string> settings;  // defaults that units share: robot=lwr4
  std::vector<NestedSetting> nested_settings;   // outer before inner ones, which win
  std::vector<ComponentSpec> components;        // in the order of the file
  std::vector<ConnectionSpec> connections;
  std::vector<EventSpec> events;      // by time
  std::vector<RecordSpec> recording;  // empty: every output
  bool all_outputs = false;           // every output is recorded beside them
  int decimation = 1;                 // every so many ticks
  std::vector<ComparisonSpec> comparisons;
  std::vector<BondSpec> bonds;
  std::vector<ReportSpec> reports;         // empty: RMS and largest magnitude of every recorded vector of reals
  std::vector<UnitDefinition> units;       // units of measure that the SSD and the files it refers to define
  bool ignore_unknown_parameters = false;  // what SSP says of parameters that nobody has; our annotation asks for errors
  std::vector<std::string> warnings;       // "place: …", what was left out or read leniently
  std::shared_ptr<const void> unpacked;    // keeps what a package (.ssp) was unpacked to, which is `folder` then
};

/// Reads an .ssd, or the one in a package (.ssp). Throws Error `file:line: …` for malformed XML, what SSP 1.0 forbids, unknown
/// names, what we cannot run; then nothing is left on the disk.
Scenario load_scenario(const std::filesystem::path& file);
/// The same from text in memory; relative references are looked up in `folder`.
Scenario parse_scenario(std::string_view xml, const std::string& place, const std::filesystem::path& folder);

/// "cell.robot.drive.K[2]" as component and variable: of all components that the name starts with, the one with the longest
/// name. The variable itself is not looked up. Nothing if there is no such component.
std::optional<Port> split_name(const Scenario& scenario, std::string_view name);

/// Finds components by name, many of them; their names must not change meanwhile.
class ComponentIndex {
 public:
  explicit ComponentIndex(const Scenario& scenario);
  std::optional<std::size_t> find(std::string_view name) const;
  /// Whether split_name() of this name gives anything.
  bool has_owner(std::string_view name) const;

 private:
  std::unordered_map<std::string_view, std::size_t> by_name_;
};

/// The source of a component, "unit:drive_train?robot=lwr4" or "plant.fmu?timeout=5", with the setting `key` at `value`.
std::string with_setting(const std::string& source, const std::string& key, const std::string& value);
/// Whether the source names a unit of `types` that has the setting.
bool has_setting(const std::string& source, const std::string& key, std::span<const UnitType> types);

/// The defaults of settings for the component of this name: the scenario's, and those of the nested scenarios that it is in.
std::map<std::string, std::string> settings_for(const Scenario& scenario, std::string_view component);

/// Applies `--set NAME=VALUE`. A relative path given this way is relative to the working directory.
///   setting=value               a default for all units that have the setting, those of nested scenarios, too
///   component.setting=value     a setting of one unit, where its type in `types` has a setting of this name
///   component.variable=value    else: the last start value of a variable
///   component?setting=value     a setting in any case, also of an FMU (fmu::LoadOptions)
/// Throws Error for a malformed assignment or an unknown component.
void assign(Scenario& scenario, std::string_view assignment, std::span<const UnitType> types = {});

}  // namespace cotwin::master
