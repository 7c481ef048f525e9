// The linear unit COTWIN_LINEAR_UNIT (linear_units.h) as an exported unit.
#include "fmu/export/export.h"
#include "tests/support/linear_units.h"

namespace cotwin::fmu {

const UnitType& exported_unit() { return find_type(COTWIN_LINEAR_UNIT, testing::linear_types()); }

}  // namespace cotwin::fmu
