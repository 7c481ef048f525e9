#pragma once
#include <cstddef>

#include "components/unit/variables.h"
#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// Whether element `row` of an output is declared to depend on element `column` of an input without delay (ModelStructure, attribute dependencies).
/// False where the FMU declares no dependencies. The variables are those of the imported unit, in which scalars q[1] … of FMI 2 may be one vector.
bool declares_dependency(const ModelDescription& description, const Variable& output, std::size_t row, const Variable& input,
                         std::size_t column);

}  // namespace cotwin::fmu
