#include "master/twin/twin_package.h"

#include <algorithm>
#include <optional>

#include "fmu/export/package.h"
#include "fmu/import/package.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/fields.h"

namespace cotwin::master {

namespace {

constexpr std::uint64_t kMagic = 0x364e495754544f43u;  // the bytes "COTTWIN6": the format and its version

/// What a twin needs of a scenario: its units, files and start values are in their packages.
struct TwinLists {
  static auto fields(Is<Scenario> auto& s, auto each) {
    return each(s.name, s.start, s.stop, s.tick, s.coupling, s.components, s.connections, s.events, s.tools, s.units);
  }
  static auto left_out(Is<Scenario> auto& s, auto each) {
    return each(s.file, s.folder, s.clock, s.threads, s.tolerance, s.settings, s.nested_settings, s.recording, s.all_outputs,
                s.decimation, s.comparisons, s.bonds, s.reports, s.ignore_unknown_parameters, s.warnings, s.unpacked);
  }
  static auto fields(Is<ComponentSpec> auto& c, auto each) { return each(c.name, c.stage, c.period, c.beside); }
  static auto left_out(Is<ComponentSpec> auto& c, auto each) {
    return each(c.source, c.type, c.place, c.connectors, c.start_values, c.threads, c.implementation, c.process);
  }
  static auto fields(Is<ToolSpec> auto& t, auto each) {
    return each(t.time, t.attach, t.known, t.name, t.parent, t.xyz, t.rpy, t.mass, t.com, t.inertia, t.frames, t.reason,
                t.robot, t.components, t.scope);
  }
  static auto left_out(Is<ToolSpec> auto& t, auto each) { return each(t.shapes, t.place); }
};

/// Throws Error for a scenario that the twin cannot step.
void check(const ByteReader& in, const TwinPackage& package) {
  const Scenario& s = package.scenario;
  if (package.packages.size() != s.components.size()) in.fail("has different numbers of units and components");
  if (package.given.size() > s.components.size()) in.fail("has start values of more units than components");
  if (s.tick.ns < 1 || s.stop < s.start) in.fail("has a tick < 1 ns or a stop time before the start time");
  for (const ComponentSpec& c : s.components) {
    if (c.period < 1) in.fail("has a component with a period < 1");
  }
}

Instance build_unit(const fmu::Package& unit, const std::filesystem::path& resources, std::span<const UnitType> types) {
  const auto type = std::find_if(types.begin(), types.end(), [&](const UnitType& t) { return t.name == unit.unit; });
  if (type == types.end()) throw Error("there is no unit " + unit.unit + " in this library");
  Settings settings(unit.unit, unit.query, {}, {resources});
  settings.set_robot(unit.robot);
  settings.set_cell(unit.cell);
  Instance instance;
  instance.unit = construct(*type, settings);
  instance.unit->declare(instance.variables);
  unit.start.write(instance.variables);
  instance.warnings = settings.warnings();
  instance.robots = settings.robots_used();
  return instance;
}

Instance build_fmu(fmu::ForeignPackage package, const std::filesystem::path& resources) {
  const std::string name = package.name, folder = package.folder;
  try {
    if (!std::filesystem::is_directory(resources / folder))
      throw Error("there is no folder resources/" + folder + ", which holds it unpacked");
    Instance instance = fmu::make_instance(std::move(package), resources);
    instance.robots = robots_of_fmu(resources / folder);
    return instance;
  } catch (const Error& error) {
    const std::string what = error.what();
    if (what.rfind(name + ": ", 0) == 0) throw;
    throw Error(name, what);
  }
}

}  // namespace

std::string serialise(const TwinPackage& package) {
  ByteWriter out;
  Putter<TwinLists>(out).put(package);
  return sealed(kMagic, out.take());
}

TwinPackage deserialise_twin(std::string_view bytes, const std::string& place) {
  ByteReader in = opened(kMagic, bytes, place, "is not an exported scenario of this version");
  TwinPackage package;
  Getter<TwinLists>(in).get(package);
  in.expect_end();
  check(in, package);
  return package;
}

std::unique_ptr<Twin> build_twin(const TwinPackage& package, const std::filesystem::path& resources,
                                 std::span<const UnitType> types, std::vector<std::string>* warnings) {
  std::vector<Member> members;
  bool states_leave = true;
  for (std::size_t i = 0; i < package.packages.size(); ++i) {
    const ComponentSpec& spec = package.scenario.components[i];
    const std::string &bytes = package.packages[i], place = "component '" + spec.name + "'";
    Member member{spec, {}};
    if (i < package.given.size()) member.given = package.given[i];
    std::optional<fmu::ForeignPackage> held;
    std::optional<fmu::Package> unit;
    if (fmu::is_foreign_package(bytes)) {
      held = fmu::deserialise_foreign(bytes, place);
    } else {
      unit = fmu::deserialise_package(bytes, place);
    }
    try {
      states_leave = states_leave && (!held || held->interface().can_serialise_state);
      member.instance = held ? build_fmu(std::move(*held), resources) : build_unit(*unit, resources, types);
    } catch (const Error& error) {
      throw Error(place, error.what());
    }
    if (warnings != nullptr) {
      for (const std::string& warning : member.instance.warnings) warnings->push_back(spec.name + ": " + warning);
    }
    members.push_back(std::move(member));
  }
  return std::make_unique<Twin>(package.scenario, std::move(members), package.outputs, states_leave);
}

}  // namespace cotwin::master
