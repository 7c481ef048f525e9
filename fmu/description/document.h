#pragma once
#include <string>

#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// documentation/index.html: what the FMU is, from which settings it was made, and a table of its variables.
std::string document(const ModelDescription& description, const std::string& settings);

}  // namespace cotwin::fmu
