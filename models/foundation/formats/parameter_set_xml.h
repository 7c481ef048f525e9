#pragma once
#include <vector>

#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/formats/xml.h"

/// Parameter sets inside other XML files: SSP allows an ssv:ParameterSet within a system structure.
namespace cotwin {

/// Reads a parameter set from its element. `complain` is called for elements and attributes unknown to SSP.
ParameterSet read_parameter_set(const xml::Element& root, const xml::Complaint& complain = xml::refuse);

/// The units of measure defined in a file: the ssc:Unit elements in the Units child of its root. Throws Error for duplicate
/// names and for factors that are 0 or not finite.
std::vector<UnitDefinition> read_unit_definitions(const xml::Element& root, const xml::Complaint& complain = xml::refuse);

/// Reads a whole text file. Throws Error `file: cannot be read, expected …`.
std::string read_text_file(const std::filesystem::path& file, const std::string& expected);

}  // namespace cotwin
