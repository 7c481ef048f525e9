// Parameter bindings of SSP 1.0 (clause "ParameterBindings"): sets inline or in .ssv files, a prefix, mappings inline or in
// .ssm files.
#include <algorithm>
#include <iterator>
#include <map>
#include <set>

#include "master/scenario/system.h"
#include "models/foundation/formats/parameter_set_xml.h"
#include "models/foundation/support/error.h"

namespace cotwin::master::ssp {

namespace {

constexpr std::size_t kMaxAssignments = 1'000'000;  // needed because a set can be bound many times

void check_type(const xml::Element& element, const char* expected) {
  const std::string type = xml::text(element, "type", expected);
  if (type != expected) throw Error(element.place, "type '" + type + "' is not supported, expected '" + expected + "'");
}

using Value = decltype(ParameterValue::value);

/// Reads the transformation of discrete values of a mapping entry: source value → target value. Empty if there is none.
std::map<Value, Value> value_table(const xml::Element& entry, const xml::Complaint& complain) {
  std::map<Value, Value> table;
  for (const xml::Element& c : entry.children) {
    const bool boolean = c.name == "BooleanMappingTransformation", integer = c.name == "IntegerMappingTransformation";
    if (c.space != kSsc || (!boolean && !integer && c.name != "EnumerationMappingTransformation")) continue;
    xml::check_children(c, kSsc, {"MapEntry"}, complain);
    for (const xml::Element& m : c.children) {
      if (m.space != kSsc || m.name != "MapEntry") continue;
      const auto read = [&](const char* name) -> Value {
        if (boolean) return xml::boolean(m, name);
        if (integer) return std::int64_t{xml::integer(m, name)};
        return xml::text(m, name);
      };
      if (!table.emplace(read("source"), read("target")).second) {
        throw Error(m.place, "a second entry for '" + xml::text(m, "source") + "'");
      }
    }
    if (table.empty()) throw Error(c.place, "'" + c.name + "' without 'MapEntry'");
  }
  return table;
}

}  // namespace

void Reader::bindings(Element& element, const xml::Element& list, const Document& document) {
  xml::check_children(list, kSsd, {"ParameterBinding"}, complain_);
  for (const xml::Element& binding : list.children) {
    if (binding.space != kSsd || binding.name != "ParameterBinding") continue;
    xml::check_attributes(binding, {"id", "description", "type", "source", "sourceBase", "prefix"}, complain_);
    xml::check_children(binding, kSsd, {"ParameterValues", "ParameterMapping", "Annotations"}, complain_);
    check_type(binding, "application/x-ssp-parameter-set");

    const std::string source = xml::text(binding, "source", "");
    const xml::Element* inlined = xml::child(binding, kSsd, "ParameterValues");
    if (source.empty() && inlined == nullptr) {
      complain_(binding.place, "a binding without values, expected 'source' or 'ParameterValues'");
      continue;
    }
    if (!source.empty() && inlined != nullptr) {
      throw Error(binding.place, "a binding with both 'source' and 'ParameterValues', expected one of them");
    }
    ParameterSet set;
    if (inlined != nullptr) {
      const xml::Element* root = xml::child(*inlined, kSsv, "ParameterSet");
      if (root == nullptr)
        throw Error(inlined->place, "'ParameterValues' without 'ParameterSet' of '" + std::string(kSsv) + "'");
      set = read_parameter_set(*root, complain_);
      // Inline sets can also use the unit definitions of the system structure.
      const std::vector<UnitDefinition>& outer = document.units.list();
      set.units.insert(set.units.end(), outer.begin(), outer.end());
    } else {
      const std::filesystem::path file = resolve(binding, source, document);
      set = read_parameter_set(xml::parse(read_text_file(file, "a parameter set (.ssv)"), file.string()), complain_);
    }
    std::vector<Assignment> values =
        mapped(set, xml::text(binding, "prefix", ""), xml::child(binding, kSsd, "ParameterMapping"), document);
    if (assignments_ += values.size(); assignments_ > kMaxAssignments) {
      throw Error(binding.place, "more than " + std::to_string(kMaxAssignments) + " parameter values");
    }
    std::move(values.begin(), values.end(), std::back_inserter(element.assignments));
  }
}

std::vector<Assignment> Reader::mapped(const ParameterSet& set, const std::string& prefix, const xml::Element* mapping,
                                       const Document& document) {
  std::vector<Assignment> values;
  std::map<std::string, std::size_t> by_name;
  const UnitDefinitions units(set.units);
  for (const ParameterValue& v : set.values) {
    by_name.emplace(prefix + v.name, values.size());
    values.push_back({v, {}});
    values.back().value.name = prefix + v.name;
    std::string& unit = values.back().value.unit;
    if ((unit == "None" || unit == "none") && units.find(unit) == nullptr) {  // as some tools write
      complain_(v.place, "unit of measure '" + unit + "' of '" + v.name + "' is none: its number is taken as it is");
      unit.clear();
    }
    if (!unit.empty()) unit = units_.intern(units, unit, v.place);
  }
  if (mapping == nullptr) return values;

  xml::check_attributes(*mapping, {"id", "description", "type", "source", "sourceBase"}, complain_);
  check_type(*mapping, "application/x-ssp-parameter-mapping");
  const std::string source = xml::text(*mapping, "source", "");
  xml::Element loaded;
  const xml::Element* root = xml::child(*mapping, kSsm, "ParameterMapping");
  if (!source.empty()) {
    if (root != nullptr) throw Error(mapping->place, "a mapping with both 'source' and content, expected one of them");
    const std::filesystem::path file = resolve(*mapping, source, document);
    loaded = xml::parse(read_text_file(file, "a parameter mapping (.ssm)"), file.string());
    root = &loaded;
  }
  if (root == nullptr || root->space != kSsm || root->name != "ParameterMapping") {
    throw Error(root == nullptr ? mapping->place : root->place, "expected 'ParameterMapping' of '" + std::string(kSsm) + "'");
  }
  check_version(*root, "SSM", complain_);
  xml::check_children(*root, kSsm, {"MappingEntry", "Annotations"}, complain_);

  // With a mapping, only the parameters that it lists are applied, under their mapped names (clause "ParameterMapping").
  std::vector<Assignment> result;
  std::set<std::string> targets;
  for (const xml::Element& entry : root->children) {
    if (entry.space != kSsm || entry.name != "MappingEntry") continue;
    xml::check_attributes(entry, {"id", "description", "source", "target", "suppressUnitConversion"}, complain_);
    const std::string& from = xml::text(entry, "source");
    const std::string& to = xml::text(entry, "target");
    if (!targets.insert(to).second) throw Error(entry.place, "a second entry maps to '" + to + "'");
    const auto found = by_name.find(from);
    if (found == by_name.end()) {
      std::vector<std::string> names;
      for (const auto& [name, index] : by_name) names.push_back(name);
      complain_(entry.place, xml::unknown("a parameter of set '" + set.name + "'", from, names));
      continue;
    }
    Assignment a = values[found->second];
    const std::map<Value, Value> table = value_table(entry, complain_);
    if (table.empty()) {
      a.transformation = read_transformation(entry, complain_);
      const bool number = std::holds_alternative<double>(a.value.value) || std::holds_alternative<std::int64_t>(a.value.value);
      if ((a.transformation.factor != 1 || a.transformation.offset != 0) && !number) {
        throw Error(entry.place, "parameter '" + from + "' is not a number, expected one for a linear transformation");
      }
    } else {
      const auto row = table.find(a.value.value);
      if (row == table.end())
        throw Error(entry.place, "parameter '" + from + "': the transformation has no entry for its value");
      a.value.value = row->second;
    }
    a.value.name = to;
    result.push_back(std::move(a));
  }
  return result;
}

}  // namespace cotwin::master::ssp
