#pragma once
#include "components/unit/unit_table.h"
#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// The model description of a unit as exported by this folder, without token and date. Start values are those that the
/// variables have now. Value references are as export.h says: time has 0; then come, in the order of declaration, every element
/// of every variable (FMI 2, "q[1]") or every variable (FMI 3, an array, and at the end the slopes of inputs, rate.h).
/// Causality and variability follow from the role:
///   input → input, output → output, parameter → fixed, tunable → tunable parameter, state → local with an approximate start
///   value
/// Reals are continuous but for outputs that say they are discrete.
ModelDescription describe(const UnitType& type, const Unit& unit, const Variables& variables, Version version);

}  // namespace cotwin::fmu
