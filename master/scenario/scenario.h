#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "components/unit/si.h"
#include "components/unit/time.h"
#include "components/unit/unit_table.h"
#include "fmu/import/choices.h"
#include "models/foundation/formats/parameter_set.h"

/// A scenario: the description of a run. Read from an SSP 1.0 system structure (.ssd) and our annotation in it. A plain value:
/// nested systems are flattened, parameter bindings are in order of priority, and each item has its place in the file for
/// messages. The lists of members (models/foundation/support/fields.h) have what decides the results of a run: hash_of(Scenario).
namespace cotwin::master {

/// The kinds of connectors of SSP.
enum class ConnectorKind : std::uint8_t { kInput, kOutput, kParameter, kCalculatedParameter, kInout };
inline constexpr std::pair<const char*, ConnectorKind> kConnectorWords[] = {
    {"input", ConnectorKind::kInput},
    {"output", ConnectorKind::kOutput},
    {"parameter", ConnectorKind::kParameter},
    {"calculatedParameter", ConnectorKind::kCalculatedParameter},
    {"inout", ConnectorKind::kInout}};

/// The words of SSP for the interface of an FMU.
inline constexpr std::pair<const char*, fmu::InterfaceChoice> kImplementationWords[] = {
    {"any", fmu::InterfaceChoice::kAny},
    {"CoSimulation", fmu::InterfaceChoice::kCoSimulation},
    {"ModelExchange", fmu::InterfaceChoice::kModelExchange}};

/// A connector of a component as listed in the SSD (optional for unit: sources).
struct ConnectorSpec {
  std::string name;  // variable, or one element "q[3]"
  ConnectorKind kind = ConnectorKind::kInout;
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
  std::vector<ParameterValue> start_values;  // in order of application: later ones replace earlier ones
  int stage = 0;                             // stages run one after another within a tick; within a stage: Jacobi
  int period = 1;                            // in ticks
  bool threads = true;                       // false: never on a worker thread
  bool beside = false;                       // steps beside the loop, on a thread of its own (master/engine/beside.h)
  fmu::InterfaceChoice implementation = fmu::InterfaceChoice::kAny;  // of an FMU that has several
  fmu::ProcessChoice process = fmu::ProcessChoice::kAuto;            // of an FMU

  static auto fields(auto& c, auto each) {
    return each(c.name, c.source, c.start_values, c.stage, c.period, c.beside, c.implementation);
  }
  static auto left_out(auto& c, auto each) { return each(c.type, c.place, c.connectors, c.threads, c.process); }
};

/// One end of a connection: a component's variable or one element of it.
struct Port {
  std::string component;
  std::string variable;  // or one element: "q[3]"
  std::string unit;      // of the connector, "" if not given

  static auto fields(auto& p, auto each) { return each(p.component, p.variable, p.unit); }
};

struct ConnectionSpec {
  Port from, to;
  double factor = 1, offset = 0;  // of ssc:LinearTransformation, applied after conversion of units of measure
  bool suppress_unit_conversion = false;
  std::string place;

  static auto fields(auto& c, auto each) { return each(c.from, c.to, c.factor, c.offset, c.suppress_unit_conversion); }
  static auto left_out(auto& c, auto each) { return each(c.place); }
};

/// At `time`, the variable changes to `value`, at once or linearly over `ramp`.
struct EventSpec {
  Time time;
  std::string variable;  // "drive.tau_e", "drive.tau_e[2]": an unconnected input or a tunable
  std::string value;
  Duration ramp;  // 0: a jump
  std::string place;

  static auto fields(auto& e, auto each) { return each(e.time, e.variable, e.value, e.ramp); }
  static auto left_out(auto& e, auto each) { return each(e.place); }
};

/// At `time`, a tool is mounted on a robot or removed from it (master/engine/tools.h). Lengths in m, angles in rad.
struct ToolSpec {
  /// A further frame on the tool, in the tool's frame.
  struct Frame {
    std::string name;
    std::array<double, 3> xyz{}, rpy{};

    static auto fields(auto& f, auto each) { return each(f.name, f.xyz, f.rpy); }
  };

  Time time;
  bool attach = true;                  // false: remove it; then only `name`, `reason`, `robot` and `components` matter
  bool known = true;                   // to the controllers; false: only the simulated robot changes
  std::string name;                    // of the tool and its frame
  std::string parent;                  // frame of the robot, or of another tool on it
  std::array<double, 3> xyz{}, rpy{};  // the tool's frame in its parent's
  double mass = 0;                     // kg
  std::array<double, 3> com{};         // in the tool's frame
  std::array<double, 6> inertia{};     // xx, xy, xz, yy, yz, zz about the centre of mass, in the tool's axes, kg.m2
  std::vector<Frame> frames{};
  std::string reason{};                   // for the history
  std::string robot{};                    // name of the robot's model, or its name in a contact world; "": the only one
  std::vector<std::string> components{};  // "drive", "world.left"; empty: all that have the robot
  std::string scope{};                    // the nested scenario that has the event: only its components
  std::filesystem::path shapes{};         // its URDF, if that has collision shapes
  std::string place{};

  static auto fields(auto& t, auto each) {
    return each(t.time, t.attach, t.known, t.name, t.parent, t.xyz, t.rpy, t.mass, t.com, t.inertia, t.frames, t.robot,
                t.components, t.scope);
  }
  /// The file of the shapes counts with its content.
  static auto left_out(auto& t, auto each) { return each(t.reason, t.shapes, t.place); }
};

struct RecordSpec {
  std::string variables;  // "drive.q", "drive.*", "*.tau_J"; glob over component.variable
  std::string place;

  static auto fields(auto& r, auto each) { return each(r.variables); }
  static auto left_out(auto& r, auto each) { return each(r.place); }
};

/// A setting of a nested scenario: a default for the units inside the component `scope`.
struct NestedSetting {
  std::string scope, name, value;
  std::string place;

  static auto fields(auto& s, auto each) { return each(s.scope, s.name, s.value); }
  static auto left_out(auto& s, auto each) { return each(s.place); }
};

/// A comparison of two signals of a run, as in Table I and Fig. 10 of the paper.
struct ComparisonSpec {
  std::string name;  // "joint torque"
  std::string a, b;  // "drive.tau_J", "recording.tau"
  int segments = 8;
  std::optional<Time> from, to;
  std::string place;

  static auto fields(auto& c, auto each) { return each(c.name, c.a, c.b, c.segments, c.from, c.to); }
  static auto left_out(auto& c, auto each) { return each(c.place); }
};

/// A power bond between two units: the power effort · flow that leaves side a should enter side b.
struct BondSpec {
  std::string name;
  std::string effort_a, flow_a;  // "drive.tau_J", "drive.dq"
  std::string effort_b, flow_b;  // the other unit's variables
  double tolerance = 0;          // J; a larger energy error is reported at the end of the run; 0: only recorded
  std::string place;
  double reference = 1;  // J; energy below which the scenario's tolerance is not relative to the bond's energy

  static auto fields(auto& b, auto each) {
    return each(b.name, b.effort_a, b.flow_a, b.effort_b, b.flow_b, b.tolerance, b.reference);
  }
  static auto left_out(auto& b, auto each) { return each(b.place); }
};

enum class ReportKind : std::uint8_t { kSignal, kDifference, kAttitude, kEnergy };
inline constexpr std::pair<const char*, ReportKind> kReportWords[] = {{"signal", ReportKind::kSignal},
                                                                      {"difference", ReportKind::kDifference},
                                                                      {"attitude", ReportKind::kAttitude},
                                                                      {"energy", ReportKind::kEnergy}};

/// An entry of the summary at the end of a run, per element and for all elements together.
///   signal      RMS and largest magnitude of `a`
///   difference  the same of a − b, e.g. a tracking error
///   attitude    the same of the rotation vector (rad) that turns the axes of quaternion b into those of a, in the axes of b
///   energy      the integral of Σ a·b over time, `a` an effort and `b` a flow
struct ReportSpec {
  std::string name;  // "joint torque"; "": composed of kind and signals
  ReportKind kind = ReportKind::kSignal;
  std::string a, b;  // "drive.tau_J"; b is empty for a signal
  std::string place;

  static auto fields(auto& r, auto each) { return each(r.name, r.kind, r.a, r.b); }
  static auto left_out(auto& r, auto each) { return each(r.place); }
};

/// When ticks begin.
///   free      as fast as possible
///   wall      on the wall clock
///   arrivals  when packets of a robot or bus come
///   locked    on the wall clock, kept in phase with the clock of a robot or bus by a phase-locked loop
enum class ClockKind : std::uint8_t { kFree, kWall, kArrivals, kLocked };
inline constexpr std::pair<const char*, ClockKind> kClockWords[] = {{"free", ClockKind::kFree},
                                                                    {"wall", ClockKind::kWall},
                                                                    {"arrivals", ClockKind::kArrivals},
                                                                    {"locked", ClockKind::kLocked},
                                                                    {"real-time", ClockKind::kWall}};

/// What follows a tick that begins too late.
///   catch_up  the late ticks run at once, one after the other
///   skip      whole ticks are left out: the late one is a longer step, so that scenario time stays with the clock
///   stop      the run ends with an error
enum class OverrunPolicy : std::uint8_t { kCatchUp, kSkip, kStop };
inline constexpr std::pair<const char*, OverrunPolicy> kOverrunWords[] = {
    {"catch_up", OverrunPolicy::kCatchUp}, {"skip", OverrunPolicy::kSkip}, {"stop", OverrunPolicy::kStop}};

/// What follows when the robot or bus is silent: the run goes on on the wall clock, ends with an error, or pauses.
enum class SilencePolicy : std::uint8_t { kWall, kStop, kWait };
inline constexpr std::pair<const char*, SilencePolicy> kSilenceWords[] = {
    {"wall", SilencePolicy::kWall}, {"stop", SilencePolicy::kStop}, {"wait", SilencePolicy::kWait}};

struct ClockSpec {
  ClockKind kind = ClockKind::kFree;
  std::string component{};  // whose robot or bus is followed; "": the only one that has such a clock
  OverrunPolicy overrun = OverrunPolicy::kCatchUp;
  Duration late{200'000};  // a tick that begins later is an overrun
  SilencePolicy silence = SilencePolicy::kWall;
  Duration timeout{100'000'000};  // without a packet the source is silent
  Duration cycle{};               // of the source; 0: its own, or a tick
  Duration shift{};               // locked: of the ticks after the beginnings of the source's cycles
  double bandwidth = 1;           // locked: of the loop, Hz
  Duration within{};              // locked: largest mean offset; 0: cycle/20
  int priority = 0;               // of SCHED_FIFO; 0: ordinary scheduling and no locked memory
  std::vector<int> cpus{};        // of the loop's thread, then of the workers; empty: any
  std::string place{};

  bool follows() const { return kind == ClockKind::kArrivals || kind == ClockKind::kLocked; }
  bool real_time_thread() const { return priority > 0 || !cpus.empty(); }
};

/// The CPUs of a list such as "2", "2 3" or "2,3". Throws Error for other text.
std::vector<int> parse_cpus(const std::string& list);
/// Replaces kind and component of the clock by those of a text such as "wall" or "arrivals:io". Settings that the new kind does not
/// have get their defaults. Throws Error for other text.
void choose_clock(ClockSpec& clock, const std::string& text);

/// How units of a loop of connections are stepped together.
///   explicit  each with the values that the others have sent it before
///   implicit  with the values at the end of the step, which are solved for
///   auto      implicit for the loops that need it in ticks of this length, otherwise explicit
enum class CouplingChoice : std::uint8_t { kAuto, kExplicit, kImplicit };
constexpr CouplingChoice last(CouplingChoice) { return CouplingChoice::kImplicit; }
inline constexpr std::pair<const char*, CouplingChoice> kCouplingWords[] = {
    {"auto", CouplingChoice::kAuto}, {"explicit", CouplingChoice::kExplicit}, {"implicit", CouplingChoice::kImplicit}};

struct Scenario {
  std::string name;
  std::filesystem::path file;    // from which it was read
  std::filesystem::path folder;  // base of relative references
  Time start, stop;              // ssd:DefaultExperiment
  Duration tick{1'000'000};
  ClockSpec clock;
  int threads = 0;       // 0: chosen automatically
  double tolerance = 0;  // > 0: adaptive communication step (relative)
  CouplingChoice coupling = CouplingChoice::kAuto;
  std::map<std::string, std::string> settings;  // defaults for all units: robot=lwr4
  std::vector<NestedSetting> nested_settings;   // outer ones first; inner ones take precedence
  std::vector<ComponentSpec> components;        // in the order of the file
  std::vector<ConnectionSpec> connections;
  std::vector<EventSpec> events;      // by time
  std::vector<ToolSpec> tools;        // by time
  std::vector<RecordSpec> recording;  // empty: every output
  bool all_outputs = false;           // record every output in addition
  int decimation = 1;                 // record every n-th tick
  std::vector<ComparisonSpec> comparisons;
  std::vector<BondSpec> bonds;
  std::vector<ReportSpec> reports;         // empty: RMS and largest magnitude of every recorded vector of reals
  std::vector<UnitDefinition> units;       // units of measure defined in the SSD and the files that it refers to
  bool ignore_unknown_parameters = false;  // true is the rule of SSP; our annotation makes them errors
  std::vector<std::string> warnings;       // "place: …": items that were ignored or deviate from the standard
  std::shared_ptr<const void> unpacked;    // owns `folder` if a package (.ssp) was unpacked to it

  static auto fields(auto& s, auto each) {
    return each(s.name, s.start, s.stop, s.tick, s.tolerance, s.coupling, s.settings, s.nested_settings, s.components,
                s.connections, s.events, s.tools, s.recording, s.all_outputs, s.decimation, s.comparisons, s.bonds, s.reports,
                s.units, s.ignore_unknown_parameters);
  }
  /// A run may go on in another folder, by another clock and with other threads.
  static auto left_out(auto& s, auto each) { return each(s.file, s.folder, s.clock, s.threads, s.warnings, s.unpacked); }
};

/// Reads an .ssd, or the one in a package (.ssp). Throws Error `file:line: …` for malformed XML, violations of SSP 1.0, unknown
/// names and unsupported features; unpacked files are then removed.
Scenario load_scenario(const std::filesystem::path& file);
/// Reads the same from a string; relative references are looked up in `folder`.
Scenario parse_scenario(std::string_view xml, const std::string& place, const std::filesystem::path& folder);

/// Splits "cell.robot.drive.K[2]" into component and variable. If the name begins with several components, the one with the
/// longest name is used. The variable is not looked up. Returns nothing if no component matches.
std::optional<Port> split_name(const Scenario& scenario, std::string_view name);

/// Fast look-up of components by name. The names must not change meanwhile.
class ComponentIndex {
 public:
  explicit ComponentIndex(const Scenario& scenario);
  std::optional<std::size_t> find(std::string_view name) const;
  /// Returns whether split_name() of this name has a result.
  bool has_owner(std::string_view name) const;

 private:
  std::unordered_map<std::string_view, std::size_t> by_name_;
};

/// Returns a component's source ("unit:drive_train?robot=lwr4", "plant.fmu?timeout=5") with the setting `key` set to `value`.
std::string with_setting(const std::string& source, const std::string& key, const std::string& value);
/// Returns whether the source is a unit in `types` with this setting.
bool has_setting(const std::string& source, const std::string& key, std::span<const UnitType> types);

/// Returns the defaults of settings for a component: those of the scenario, and of the nested scenarios around the component.
std::map<std::string, std::string> settings_for(const Scenario& scenario, std::string_view component);

/// Applies `--set NAME=VALUE`. Relative paths are relative to the working directory.
///   setting=value               a default for all units with this setting, also in nested scenarios
///   component.setting=value     a setting of one unit, if its type in `types` has a setting of this name
///   component.variable=value    otherwise the start value of a variable, which replaces all others
///   component?setting=value     always a setting, also of an FMU (fmu::LoadOptions)
/// Throws Error for a malformed assignment or an unknown component.
void assign(Scenario& scenario, std::string_view assignment, std::span<const UnitType> types = {});

/// Adds the event of `--attach NAME,parent=FRAME,mass=…,…@TIME` or `--detach NAME,…@TIME`, whose items are the attributes of an
/// Event. A relative `file` is relative to the working directory. Throws Error for a malformed text.
void add_tool_event(Scenario& scenario, bool attach, std::string_view text);

/// A tool that is mounted outside of a run: NAME,parent=FRAME,mass=…,… as for --attach, without a time. Throws Error for a malformed
/// text.
ToolSpec parse_tool(std::string_view text);

}  // namespace cotwin::master
