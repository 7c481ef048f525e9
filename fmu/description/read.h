#pragma once
#include <filesystem>
#include <string>
#include <string_view>

#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// Reads modelDescription.xml of FMI 2.0 and 3.0: Co-Simulation, Model Exchange and the attributes of Scheduled Execution.
/// Guarantees: names are unique, references and indices refer to variables, numbers have the type of their variable, the
/// dimensions of every array can be computed and its start values fit them. The standard's defaults are filled in for
/// causality, variability and initial. Unknown attributes are ignored. Throws Error `place:line: …` for everything else, for
/// FMI 1.0 and for later versions.
ModelDescription parse_model_description(std::string_view xml, const std::string& place);

/// Reads the same from a file of at most 256 MiB.
ModelDescription load_model_description(const std::filesystem::path& file);

}  // namespace cotwin::fmu
