#pragma once
#include <filesystem>
#include <string>
#include <string_view>

#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// Reads modelDescription.xml of FMI 2.0 and 3.0: Co-Simulation, Model Exchange and (to say that it is there) Scheduled
/// Execution. What the rest of this folder relies on holds afterwards: names are unique, references and indices lead to
/// variables, numbers have the type of their variable, every extent of an array can be computed (extents()) and start values
/// fit it. Defaults of the standard are filled in for causality, variability and initial. Attributes that the standard does not
/// know are let be. Throws Error `place:line: …` for anything else, and for FMI 1.0 and versions yet to come.
ModelDescription parse_model_description(std::string_view xml, const std::string& place);

/// The same from a file of at most 256 MiB.
ModelDescription load_model_description(const std::filesystem::path& file);

}  // namespace cotwin::fmu
