#pragma once
#include <cstdint>
#include <filesystem>
#include <iosfwd>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace cotwin {

/// One value of a parameter set as in SSV (SSP 1.0, clause 6.3 "ssv:Parameter").
struct ParameterValue {
  std::string name;  // "K", or one element of a vector counted from 1: "K[3]"
  std::variant<double, std::int64_t, bool, std::string> value;
  std::string unit;      // as written in the file, "" if there is none
  std::string place;     // "drive.ssv:12", for messages
  bool by_user = false;  // given for this run, by --set, and not by a file

  static auto fields(auto& p, auto each) { return each(p.name, p.value, p.unit); }
  static auto left_out(auto& p, auto each) { return each(p.place, p.by_user); }
};

/// A unit of measure defined in a file (ssc:Unit/ssc:BaseUnit): value in SI = factor · value + offset, exponents of the SI base
/// units.
struct UnitDefinition {
  std::string name;
  int kg = 0, m = 0, s = 0, A = 0, K = 0, mol = 0, cd = 0, rad = 0;
  double factor = 1, offset = 0;

  static auto fields(auto& u, auto each) {
    return each(u.name, u.kg, u.m, u.s, u.A, u.K, u.mol, u.cd, u.rad, u.factor, u.offset);
  }
  friend bool operator==(const UnitDefinition&, const UnitDefinition&) = default;
};

/// A named list of values: drive data of a robot, a tuning result, a variant. The file format is SSV (SSP 1.0).
struct ParameterSet {
  std::string name;
  std::vector<ParameterValue> values;
  std::vector<UnitDefinition> units;

  static auto fields(auto& s, auto each) { return each(s.values, s.units); }
  static auto left_out(auto& s, auto each) { return each(s.name); }
};

/// Reads an .ssv file. Throws Error `file:line: …` for malformed XML, unknown types, invalid values and duplicate names.
ParameterSet load_parameter_set(const std::filesystem::path& file);

/// Reads text in memory; `place` is its name in messages.
ParameterSet parse_parameter_set(std::string_view xml, const std::string& place);

/// Writes a parameter set as SSV 1.0 that validates against SystemStructureParameterValues.xsd.
void write_parameter_set(std::ostream& out, const ParameterSet& set);

}  // namespace cotwin
