#pragma once
#include <vector>

#include "models/support/parameter_set.h"
#include "models/support/xml.h"

/// Parameter sets inside other XML files: SSP allows an ssv:ParameterSet within a system structure.
namespace cotwin {

/// What parse_parameter_set() reads, from its element. `complain` hears of elements and attributes that SSP does not know.
ParameterSet read_parameter_set(const xml::Element& root, const xml::Complaint& complain = xml::refuse);

/// The units of measure that a file defines: the ssc:Unit elements in the Units child of its root. Throws Error for doubled
/// names, factors that are 0, not finite or not a number.
std::vector<UnitDefinition> read_unit_definitions(const xml::Element& root, const xml::Complaint& complain = xml::refuse);

/// The whole of a text file. Throws Error `file: cannot be read, expected …`.
std::string read_text_file(const std::filesystem::path& file, const std::string& expected);

}  // namespace cotwin
