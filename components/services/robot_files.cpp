#include "components/services/robot_files.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/support/assumed.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace fs = std::filesystem;

namespace {

constexpr double kLargest = 1e12;

[[noreturn]] void fail(const ParameterValue& v, const std::string& what) { throw Error(v.place + ": " + v.name, what); }

std::vector<double> numbers_of(const ParameterValue& v) {
  if (const double* x = std::get_if<double>(&v.value)) return {*x};
  if (const std::int64_t* x = std::get_if<std::int64_t>(&v.value)) return {static_cast<double>(*x)};
  const std::string* list = std::get_if<std::string>(&v.value);
  if (!list) fail(v, "is a boolean, expected numbers");
  std::string blanks = *list;
  std::ranges::replace_if(
      blanks, [](char c) { return c == '\n' || c == '\t' || c == '\r'; }, ' ');
  std::vector<double> all;
  for (const std::string_view part : text::split(blanks, ' ')) {
    if (text::trim(part).empty()) continue;
    const auto x = text::parse_real(text::trim(part));
    if (!x) fail(v, "has '" + std::string(part) + "', expected numbers separated by blanks");
    all.push_back(*x);
  }
  return all;
}

/// Sets the vector, all values or the element "name[k]". A single number holds for all.
void take(const ParameterValue& v, std::vector<double>& values, double min, double max) {
  const std::vector<double> given = numbers_of(v);
  for (const double x : given)
    if (!(x >= min && x <= max && std::isfinite(x)))
      fail(v, "is " + text::to_text(x) + ", expected " + text::to_text(min) + " to " + text::to_text(max));
  if (const std::size_t bracket = v.name.find('['); bracket != std::string::npos) {
    const auto k = text::parse_integer(std::string_view(v.name).substr(bracket + 1, v.name.size() - bracket - 2));
    if (!k || *k < 1 || static_cast<std::size_t>(*k) > values.size() || given.size() != 1)
      fail(v, "expected one number for an element from 1 to " + std::to_string(values.size()));
    values[static_cast<std::size_t>(*k - 1)] = given[0];
    return;
  }
  if (given.size() == 1) {
    std::ranges::fill(values, given[0]);
  } else if (given.size() == values.size()) {
    values = given;
  } else {
    fail(v, "has " + std::to_string(given.size()) + " values, expected one or " + std::to_string(values.size()));
  }
}

std::string vector_name(const ParameterValue& v) { return v.name.substr(0, v.name.find('[')); }

/// Refuses a value whose unit of measure is not one of `measures`, or that defines such a name as something else.
void check_measure(const ParameterValue& v, const ParameterSet& set, const std::vector<std::string>& measures) {
  if (v.unit.empty()) return;
  std::string expected;
  for (const std::string& measure : measures) expected += (expected.empty() ? "" : " or ") + measure;
  if (std::ranges::find(measures, v.unit) == measures.end())
    fail(v, "is in " + v.unit + ", expected " + (expected.empty() ? "no unit of measure" : expected));
  for (const UnitDefinition& d : set.units)
    if (d.name == v.unit && (d.factor != 1 || d.offset != 0))
      fail(v, "is in " + v.unit + ", which the file defines with the factor " + text::to_text(d.factor) + " and the offset " +
                  text::to_text(d.offset) + ", expected SI: 1 and 0");
}

/// The measure of prismatic joints, from that of revolute ones: "N.m.s/rad" becomes "N.s/m".
std::string prismatic(std::string si) {
  for (const auto& [of_revolute, of_prismatic] : {std::pair{"N.m", "N"}, {"kg.m2", "kg"}, {"rad", "m"}})
    if (const std::size_t at = si.find(of_revolute); at != std::string::npos)
      si.replace(at, std::string_view(of_revolute).size(), of_prismatic);
  return si;
}

template <class Struct, class Table>
bool read_row(const ParameterValue& v, const ParameterSet& set, const Table& table, bool prismatic_too, Struct& values) {
  const std::string name = vector_name(v);
  for (const auto& row : table) {
    if (name != row.name) continue;
    std::vector<std::string> measures{row.si};
    if (prismatic_too && row.prismatic_differs && prismatic(row.si) != row.si) measures.push_back(prismatic(row.si));
    check_measure(v, set, measures);
    take(v, values.*row.values, row.min, row.max);
    return true;
  }
  return false;
}

/// Refuses a name that the unit does not have.
template <std::size_t N>
void check_other(const ParameterValue& v, const char* unit, std::vector<std::string> names, const char* const (&others)[N]) {
  const std::string name = vector_name(v);
  names.insert(names.end(), std::begin(others), std::end(others));
  if (std::ranges::find(names, name) != names.end()) return;
  const std::string closest = text::closest(name, names);
  fail(v,
       std::string("is no parameter of ") + unit + ", expected one" + (closest.empty() ? "" : ", perhaps '" + closest + "'"));
}

template <class Table>
std::vector<std::string> names_of(const Table& table) {
  std::vector<std::string> names;
  for (const auto& row : table) names.emplace_back(row.name);
  return names;
}

bool has_prismatic(const robot::RobotModel& robot) {
  return std::ranges::any_of(robot.joints, [](const robot::Joint& j) { return j.type == robot::JointType::kPrismatic; });
}

std::string text_of(const ParameterValue& v) {
  const std::string* text = std::get_if<std::string>(&v.value);
  if (!text) fail(v, "expected a text");
  return *text;
}

/// Reads the texts `sources` and `assumed`; notes the name of what is neither.
bool read_text(const ParameterValue& v, std::span<const char* const> names, Provenance& p) {
  if (v.name == "sources") p.sources = text_of(v);
  if (v.name == "assumed") check_assumed(v.place + ": assumed", p.assumed = text_of(v), names);
  if (v.name == "sources" || v.name == "assumed") return true;
  if (!p.has(vector_name(v))) p.given.push_back(vector_name(v));
  return false;
}

/// Further variables of unit:drive_train that a file may set. The services do not use them.
constexpr const char* kOtherOfDrives[] = {"q0",           "dq0",         "q_min",       "q_max",      "rtol",
                                          "atol",         "atol_speed",  "transition",  "link_order", "stop_stiffness",
                                          "max_substeps", "mass",        "input_order", "inertia",    "stop_restitution",
                                          "first_moment", "tool_changes"};
/// Likewise of unit:energy.
constexpr const char* kOtherOfEnergy[] = {"servo_off_after", "rest_speed", "V_start", "input_order"};

}  // namespace

DriveData load_drives(const fs::path& file, const robot::RobotModel& robot) {
  DriveData drives(robot.joints.size());
  const std::vector<double> starts = drives.B;
  std::ranges::fill(drives.B, std::numeric_limits<double>::quiet_NaN());
  const ParameterSet set = load_parameter_set(file);
  for (const ParameterValue& v : set.values)
    if (!read_text(v, robot::kDriveParameterNames, drives) &&
        !read_row(v, set, robot::kDriveParameters, has_prismatic(robot), drives))
      check_other(v, "unit:drive_train", names_of(robot::kDriveParameters), kOtherOfDrives);
  for (std::size_t j = 0; j < starts.size(); ++j) {
    if (!std::isnan(drives.B[j])) continue;
    drives.B[j] = starts[j];
    drives.without_B.push_back(j);
  }
  return drives;
}

EnergyData load_energy(const fs::path& file, const robot::RobotModel& robot) {
  const std::size_t joints = robot.joints.size();
  EnergyData e;
  e.losses = energetics::DriveLosses(joints);
  struct Scalar {
    const char *name, *si;
    double* value;
  };
  const Scalar scalars[] = {{"P_0", "W", &e.standby.P_0},
                            {"P_off", "W", &e.standby.P_off},
                            {"P_brake", "W", &e.standby.P_brake},
                            {"E_release", "J", &e.standby.E_release},
                            {"t_close", "s", &e.standby.t_close},
                            {"t_release", "s", &e.standby.t_release},
                            {"controller", "W", &e.standby.controller},
                            {"C", "F", &e.link.C},
                            {"V_min", "V", &e.link.V_min},
                            {"V_max", "V", &e.link.V_max},
                            {"efficiency", "1", &e.supply.efficiency},
                            {"eta_r", "1", &e.supply.eta_r},
                            {"price_per_kWh", "1", &e.supply.price_per_kWh},
                            {"co2_per_kWh", "kg", &e.supply.co2_per_kWh}};
  std::vector<std::string> names = names_of(energetics::kDriveLosses);
  names.insert(names.end(), {"current", "sources", "assumed"});
  for (const Scalar& scalar : scalars) names.emplace_back(scalar.name);
  const ParameterSet set = load_parameter_set(file);
  for (const ParameterValue& v : set.values) {
    if (v.name == "current") e.current = energetics::parse_current(v.place + ": current", text_of(v));
    if (read_text(v, energetics::kMayBeAssumed, e)) continue;
    for (const Scalar& scalar : scalars) {
      if (v.name != scalar.name) continue;
      check_measure(v, set, {scalar.si});
      std::vector<double> one{0};
      take(v, one, 0, kLargest);
      *scalar.value = one[0];
    }
    if (!read_row(v, set, energetics::kDriveLosses, has_prismatic(robot), e.losses))
      check_other(v, "unit:energy", names, kOtherOfEnergy);
  }
  energetics::Accountant accountant(joints, energetics::Bus::kShared);
  accountant.losses = e.losses;
  accountant.current = e.current;
  accountant.link = e.link;
  accountant.supply = e.supply;
  accountant.check(file.string());
  return e;
}

}  // namespace cotwin::services
