#include "models/energetics/drives.h"

#include "models/foundation/support/choice.h"

namespace cotwin::energetics {

double copper_factor(Current current) { return current == Current::kDc ? 1 : current == Current::kPeak ? 1.5 : 3; }

Current parse_current(const std::string& place, const std::string& name) {
  return text::choose<Current>(place, name, {{"dc", Current::kDc}, {"peak", Current::kPeak}, {"rms", Current::kRms}});
}

DriveLosses::DriveLosses(std::size_t joints) { write_start_values(*this, kDriveLosses, joints); }

}  // namespace cotwin::energetics
