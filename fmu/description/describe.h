#pragma once
#include "components/unit/unit_table.h"
#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// Returns the model description of an exported unit, without token and date. Start values are the current values of the
/// variables. Value references: 0 is time; then, in the order of declaration, every element of every variable (FMI 2, "q[1]")
/// or every variable as an array (FMI 3), but elements that differ in their units of measure, which are scalars there, too; in
/// FMI 3 the slopes of inputs (rate.h) are last.
/// Causality and variability follow from the role:
///   input → input, output → output, parameter → fixed, tunable → tunable parameter, state → local with an approximate start
///   value
/// Reals are continuous unless they are declared discrete.
ModelDescription describe(const UnitType& type, const Unit& unit, const Variables& variables, Version version);

}  // namespace cotwin::fmu
