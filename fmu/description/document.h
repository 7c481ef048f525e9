#pragma once
#include <string>

#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// Returns documentation/index.html: description of the FMU, its settings, and a table of its variables.
std::string document(const ModelDescription& description, const std::string& settings);

}  // namespace cotwin::fmu
