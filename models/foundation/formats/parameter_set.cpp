#include "models/foundation/formats/parameter_set.h"

#include <cmath>
#include <limits>
#include <ostream>
#include <set>
#include <unordered_map>

#include "models/foundation/formats/parameter_set_xml.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin {

namespace {

// SSP 1.0, SystemStructureParameterValues.xsd and SystemStructureCommon.xsd.
constexpr const char* kSsv = "http://ssp-standard.org/SSP1/SystemStructureParameterValues";
constexpr const char* kSsc = "http://ssp-standard.org/SSP1/SystemStructureCommon";

const std::vector<std::string> kMetadata = {"id",        "description", "author",         "fileversion",
                                            "copyright", "license",     "generationTool", "generationDateAndTime"};

ParameterValue read_value(const xml::Element& parameter, const xml::Complaint& complain) {
  ParameterValue result{xml::text(parameter, "name"), 0.0, "", parameter.place};
  if (result.name.empty()) throw Error(parameter.place, "a parameter without a name");
  xml::check_attributes(parameter, {"name", "id", "description"}, complain);

  const xml::Element* type = nullptr;
  for (const xml::Element& c : parameter.children) {
    if (c.space != kSsv || c.name == "Annotations") continue;
    if (type != nullptr) throw Error(c.place, "parameter '" + result.name + "' has a second value '" + c.name + "'");
    type = &c;
  }
  if (type == nullptr)
    throw Error(parameter.place, "parameter '" + result.name +
                                     "' without a value, expected 'Real', 'Integer', 'Boolean', 'String' or 'Enumeration'");

  if (type->name == "Real") {
    result.value = xml::real(*type, "value");
    result.unit = xml::text(*type, "unit", "");
    xml::check_attributes(*type, {"value", "unit"}, complain);
  } else if (type->name == "Integer") {
    result.value = std::int64_t{xml::integer(*type, "value")};
    xml::check_attributes(*type, {"value"}, complain);
  } else if (type->name == "Boolean") {
    result.value = xml::boolean(*type, "value");
    xml::check_attributes(*type, {"value"}, complain);
  } else if (type->name == "String") {
    result.value = xml::text(*type, "value");
    xml::check_attributes(*type, {"value"}, complain);
  } else if (type->name == "Enumeration") {
    result.value = xml::text(*type, "value");  // the item's name; the variable's type defines its number
    xml::check_attributes(*type, {"value", "name"}, complain);
  } else if (type->name == "Binary") {
    throw Error(type->place,
                "parameter '" + result.name + "' is binary, expected 'Real', 'Integer', 'Boolean', 'String' or 'Enumeration'");
  } else {
    throw Error(type->place, "parameter '" + result.name + "': " +
                                 xml::unknown("a type", type->name, {"Real", "Integer", "Boolean", "String", "Enumeration"}));
  }
  return result;
}

/// Text of a double in XML Schema.
std::string schema_text(double value) {
  if (std::isnan(value)) return "NaN";
  if (std::isinf(value)) return value > 0 ? "INF" : "-INF";
  return text::to_text(value);
}

void write_definition(std::ostream& out, const UnitDefinition& d) {
  out << "    <ssc:Unit name=\"" << xml::escaped(d.name) << "\">\n      <ssc:BaseUnit";
  const std::pair<const char*, int> exponents[] = {{"kg", d.kg}, {"m", d.m},     {"s", d.s},   {"A", d.A},
                                                   {"K", d.K},   {"mol", d.mol}, {"cd", d.cd}, {"rad", d.rad}};
  for (const auto& [name, exponent] : exponents) {
    if (exponent != 0) out << ' ' << name << "=\"" << exponent << '"';
  }
  if (d.factor != 1) out << " factor=\"" << schema_text(d.factor) << '"';
  if (d.offset != 0) out << " offset=\"" << schema_text(d.offset) << '"';
  out << "/>\n    </ssc:Unit>\n";
}

void write_value(std::ostream& out, const ParameterValue& p) {
  out << "    <ssv:Parameter name=\"" << xml::escaped(p.name) << "\">";
  if (const double* real = std::get_if<double>(&p.value)) {
    out << "<ssv:Real value=\"" << schema_text(*real) << '"';
    if (!p.unit.empty()) out << " unit=\"" << xml::escaped(p.unit) << '"';
  } else if (const std::int64_t* integer = std::get_if<std::int64_t>(&p.value)) {
    if (*integer < std::numeric_limits<std::int32_t>::min() || *integer > std::numeric_limits<std::int32_t>::max()) {
      throw Error("parameter '" + p.name + "': " + std::to_string(*integer) + ", expected a 32-bit integer as in SSV");
    }
    out << "<ssv:Integer value=\"" << *integer << '"';
  } else if (const bool* truth = std::get_if<bool>(&p.value)) {
    out << "<ssv:Boolean value=\"" << (*truth ? "true" : "false") << '"';
  } else {
    out << "<ssv:String value=\"" << xml::escaped(std::get<std::string>(p.value)) << '"';
  }
  out << "/></ssv:Parameter>\n";
}

}  // namespace

std::vector<UnitDefinition> read_unit_definitions(const xml::Element& root, const xml::Complaint& complain) {
  std::vector<UnitDefinition> units;
  // The list is in the file's own namespace, its elements are in the common one.
  const xml::Element* list = xml::child(root, root.space.text(), "Units");
  if (list == nullptr) return units;
  xml::check_children(*list, kSsc, {"Unit"}, complain);
  std::set<std::string> names;
  for (const xml::Element& unit : list->children) {
    if (unit.space != kSsc || unit.name != "Unit") continue;
    xml::check_attributes(unit, {"name", "id", "description"}, complain);
    xml::check_children(unit, kSsc, {"BaseUnit", "Annotations"}, complain);
    const xml::Element* base = xml::child(unit, kSsc, "BaseUnit");
    UnitDefinition d;
    d.name = xml::text(unit, "name");
    if (base == nullptr) throw Error(unit.place, "unit of measure '" + d.name + "' without 'BaseUnit'");
    xml::check_attributes(*base, {"kg", "m", "s", "A", "K", "mol", "cd", "rad", "factor", "offset"}, complain);
    const std::pair<const char*, int*> exponents[] = {{"kg", &d.kg}, {"m", &d.m},     {"s", &d.s},   {"A", &d.A},
                                                      {"K", &d.K},   {"mol", &d.mol}, {"cd", &d.cd}, {"rad", &d.rad}};
    for (const auto& [name, exponent] : exponents) *exponent = xml::integer(*base, name, 0);
    d.factor = xml::real(*base, "factor", 1.0);
    d.offset = xml::real(*base, "offset", 0.0);
    if (!std::isnormal(d.factor) || !std::isfinite(d.offset)) {
      throw Error(base->place, "unit of measure '" + d.name + "': factor " + text::to_text(d.factor) + ", offset " +
                                   text::to_text(d.offset) + ", expected finite numbers, the factor not 0");
    }
    if (!names.insert(d.name).second) throw Error(unit.place, "unit of measure '" + d.name + "' is defined twice");
    units.push_back(std::move(d));
  }
  return units;
}

ParameterSet read_parameter_set(const xml::Element& root, const xml::Complaint& complain) {
  if (root.space != kSsv || root.name != "ParameterSet") {
    throw Error(root.place, "'" + root.name + "' of namespace '" + root.space + "', expected 'ParameterSet' of '" + kSsv + "'");
  }
  const std::string& version = xml::text(root, "version");
  if (version.rfind("1.", 0) != 0) throw Error(root.place, "version '" + version + "' of SSV, expected 1.0");
  std::vector<std::string> attributes = kMetadata;
  attributes.insert(attributes.end(), {"version", "name"});
  xml::check_attributes(root, attributes, complain);
  xml::check_children(root, kSsv, {"Parameters", "Enumerations", "Units", "Annotations"}, complain);

  ParameterSet set;
  set.name = xml::text(root, "name");
  set.units = read_unit_definitions(root, complain);
  const xml::Element* parameters = xml::child(root, kSsv, "Parameters");
  if (parameters == nullptr) throw Error(root.place, "parameter set '" + set.name + "' without 'Parameters'");
  xml::check_children(*parameters, kSsv, {"Parameter"}, complain);
  std::unordered_map<std::string, std::string> places;
  for (const xml::Element& parameter : parameters->children) {
    if (parameter.space != kSsv || parameter.name != "Parameter") continue;
    ParameterValue value = read_value(parameter, complain);
    const auto [first, inserted] = places.emplace(value.name, value.place);
    if (!inserted) throw Error(value.place, "parameter '" + value.name + "' is given twice, first at " + first->second);
    set.values.push_back(std::move(value));
  }
  return set;
}

std::string read_text_file(const std::filesystem::path& file, const std::string& expected) {
  return text::read_file(file, expected);
}

ParameterSet load_parameter_set(const std::filesystem::path& file) {
  return parse_parameter_set(read_text_file(file, "a parameter set (.ssv)"), file.string());
}

ParameterSet parse_parameter_set(std::string_view text, const std::string& place) {
  return read_parameter_set(xml::parse(text, place));
}

void write_parameter_set(std::ostream& out, const ParameterSet& set) {
  out << "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      << "<ssv:ParameterSet xmlns:ssv=\"" << kSsv << "\" xmlns:ssc=\"" << kSsc << "\" version=\"1.0\" name=\""
      << xml::escaped(set.name) << "\" generationTool=\"cotwin\">\n  <ssv:Parameters>\n";
  for (const ParameterValue& p : set.values) write_value(out, p);
  out << "  </ssv:Parameters>\n";
  if (!set.units.empty()) {
    out << "  <ssv:Units>\n";
    for (const UnitDefinition& d : set.units) write_definition(out, d);
    out << "  </ssv:Units>\n";
  }
  out << "</ssv:ParameterSet>\n";
}

}  // namespace cotwin
