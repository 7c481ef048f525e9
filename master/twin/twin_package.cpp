#include "master/twin/twin_package.h"

#include <algorithm>
#include <array>
#include <optional>

#include "fmu/export/package.h"
#include "fmu/import/package.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

constexpr std::uint64_t kMagic = 0x354e495754544f43u;  // the bytes "COTTWIN5": the format and its version

// put() and get() of a type handle the same fields in the same order.
void put(ByteWriter& out, const Port& port) {
  for (const std::string* text : {&port.component, &port.variable, &port.unit}) out.text(*text);
}
void get(ByteReader& in, Port& port) {
  for (std::string* text : {&port.component, &port.variable, &port.unit}) *text = in.text();
}

void put(ByteWriter& out, const ComponentSpec& component) {
  out.text(component.name);
  out.value(static_cast<std::int32_t>(component.stage));
  out.value(static_cast<std::int32_t>(component.period));
  out.value(static_cast<std::uint8_t>(component.beside));
}
void get(ByteReader& in, ComponentSpec& component) {
  component.name = in.text();
  component.stage = in.value<std::int32_t>();
  component.period = in.value<std::int32_t>();
  component.beside = in.value<std::uint8_t>() != 0;
}

void put(ByteWriter& out, const ConnectionSpec& connection) {
  put(out, connection.from);
  put(out, connection.to);
  out.value(connection.factor);
  out.value(connection.offset);
  out.value(static_cast<std::uint8_t>(connection.suppress_unit_conversion));
}
void get(ByteReader& in, ConnectionSpec& connection) {
  get(in, connection.from);
  get(in, connection.to);
  connection.factor = in.value<double>();
  connection.offset = in.value<double>();
  connection.suppress_unit_conversion = in.value<std::uint8_t>() != 0;
}

void put(ByteWriter& out, const EventSpec& event) {
  out.value(event.time.ns);
  out.text(event.variable);
  out.text(event.value);
  out.value(event.ramp.ns);
}
void get(ByteReader& in, EventSpec& event) {
  event.time.ns = in.value<std::int64_t>();
  event.variable = in.text();
  event.value = in.text();
  event.ramp.ns = in.value<std::int64_t>();
}

void put(ByteWriter& out, const std::array<double, 3>& numbers) {
  for (const double number : numbers) out.value(number);
}
void get(ByteReader& in, std::array<double, 3>& numbers) {
  for (double& number : numbers) number = in.value<double>();
}

void put(ByteWriter& out, const ToolSpec::Frame& frame) {
  out.text(frame.name);
  put(out, frame.xyz);
  put(out, frame.rpy);
}
void get(ByteReader& in, ToolSpec::Frame& frame) {
  frame.name = in.text();
  get(in, frame.xyz);
  get(in, frame.rpy);
}

template <class Unit>
auto exponents(Unit& unit) {
  return std::array{&unit.kg, &unit.m, &unit.s, &unit.A, &unit.K, &unit.mol, &unit.cd, &unit.rad};
}
void put(ByteWriter& out, const UnitDefinition& unit) {
  out.text(unit.name);
  for (const int* exponent : exponents(unit)) out.value(static_cast<std::int32_t>(*exponent));
  out.value(unit.factor);
  out.value(unit.offset);
}
void get(ByteReader& in, UnitDefinition& unit) {
  unit.name = in.text();
  for (int* exponent : exponents(unit)) *exponent = in.value<std::int32_t>();
  unit.factor = in.value<double>();
  unit.offset = in.value<double>();
}

void put(ByteWriter& out, const GivenStart& start) {
  out.text(start.variable);
  out.value(static_cast<std::uint64_t>(start.element));
  out.value(start.value);
}
void get(ByteReader& in, GivenStart& start) {
  start.variable = in.text();
  start.element = in.value<std::uint64_t>();
  start.value = in.value<double>();
}

void put(ByteWriter& out, const std::string& text) { out.text(text); }
void get(ByteReader& in, std::string& text) { text = in.text(); }

template <class T>
void put(ByteWriter& out, const std::vector<T>& list);
template <class T>
void get(ByteReader& in, std::vector<T>& list);

void put(ByteWriter& out, const ToolSpec& tool) {
  out.value(tool.time.ns);
  out.value(static_cast<std::uint8_t>(tool.attach));
  out.value(static_cast<std::uint8_t>(tool.known));
  for (const std::string* text : {&tool.name, &tool.parent, &tool.reason, &tool.robot, &tool.scope}) out.text(*text);
  for (const auto* numbers : {&tool.xyz, &tool.rpy, &tool.com}) put(out, *numbers);
  out.value(tool.mass);
  for (const double moment : tool.inertia) out.value(moment);
  put(out, tool.frames);
  put(out, tool.components);
}
void get(ByteReader& in, ToolSpec& tool) {
  tool.time.ns = in.value<std::int64_t>();
  tool.attach = in.value<std::uint8_t>() != 0;
  tool.known = in.value<std::uint8_t>() != 0;
  for (std::string* text : {&tool.name, &tool.parent, &tool.reason, &tool.robot, &tool.scope}) *text = in.text();
  for (auto* numbers : {&tool.xyz, &tool.rpy, &tool.com}) get(in, *numbers);
  tool.mass = in.value<double>();
  for (double& moment : tool.inertia) moment = in.value<double>();
  get(in, tool.frames);
  get(in, tool.components);
}

template <class T>
void put(ByteWriter& out, const std::vector<T>& list) {
  out.value(static_cast<std::uint64_t>(list.size()));
  for (const T& item : list) put(out, item);
}
template <class T>
void get(ByteReader& in, std::vector<T>& list) {
  list.resize(in.count(sizeof(std::uint64_t)));
  for (T& item : list) get(in, item);
}

}  // namespace

std::string serialise(const TwinPackage& package) {
  const Scenario& s = package.scenario;
  ByteWriter out;
  out.text(s.name);
  out.value(s.start.ns);
  out.value(s.stop.ns);
  out.value(s.tick.ns);
  out.value(static_cast<std::uint8_t>(s.coupling));
  put(out, s.components);
  put(out, s.connections);
  put(out, s.events);
  put(out, s.tools);
  put(out, s.units);
  put(out, package.packages);
  for (std::size_t i = 0; i < s.components.size(); ++i)
    put(out, i < package.given.size() ? package.given[i] : std::vector<GivenStart>());
  put(out, std::vector<std::string>(package.outputs.begin(), package.outputs.end()));
  ByteWriter head;
  head.value(kMagic);
  head.value(hash_of(out.bytes()));
  return head.bytes() + out.bytes();
}

TwinPackage deserialise_twin(std::string_view bytes, const std::string& place) {
  ByteReader in(as_bytes(bytes), place);
  if (bytes.size() < sizeof kMagic || in.value<std::uint64_t>() != kMagic)
    in.fail("is not an exported scenario of this version");
  if (in.value<std::uint64_t>() != hash_of(bytes.substr(2 * sizeof(std::uint64_t)))) in.fail("is damaged");
  TwinPackage package;
  Scenario& s = package.scenario;
  s.name = in.text();
  s.start.ns = in.value<std::int64_t>();
  s.stop.ns = in.value<std::int64_t>();
  s.tick.ns = in.value<std::int64_t>();
  const auto coupling = in.value<std::uint8_t>();
  if (coupling >= std::size(kCouplingWords)) in.fail("has an unknown choice of coupling");
  s.coupling = static_cast<CouplingChoice>(coupling);
  get(in, s.components);
  get(in, s.connections);
  get(in, s.events);
  get(in, s.tools);
  get(in, s.units);
  get(in, package.packages);
  if (package.packages.size() != s.components.size()) in.fail("has different numbers of units and components");
  package.given.resize(s.components.size());
  for (std::vector<GivenStart>& given : package.given) get(in, given);
  if (s.tick.ns < 1 || s.stop < s.start) in.fail("has a tick < 1 ns or a stop time before the start time");
  for (const ComponentSpec& c : s.components) {
    if (c.period < 1) in.fail("has a component with a period < 1");
  }
  std::vector<std::string> outputs;
  get(in, outputs);
  package.outputs.insert(outputs.begin(), outputs.end());
  in.expect_end();
  return package;
}

namespace {

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
