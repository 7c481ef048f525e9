#include "fmu/export/export.h"
#include "tests/fmu/probe.h"

namespace cotwin::fmu {

const UnitType& exported_unit() {
  static constexpr UnitType kType{"probe", "shows what is done with a unit",
                                  [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<probe::Probe>(s); },
                                  &probe::Probe::declare_settings};
  return kType;
}

}  // namespace cotwin::fmu
