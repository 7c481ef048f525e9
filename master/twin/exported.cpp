// The scenario as an exported unit: the counterpart of fmu/export/exported_unit.cpp.in, which CMake fills in for each unit.
#include "fmu/export/export.h"
#include "master/twin/twin_package.h"
#include "models/foundation/support/file.h"

namespace cotwin::fmu {

namespace {

std::unique_ptr<Unit> make_twin(Settings& settings) {
  const std::filesystem::path file = settings.file(master::kTwinFile);
  const std::string bytes = text::read_file(file, "an exported scenario", ~std::uint64_t{0});
  std::vector<std::string> warnings;
  auto twin = master::build_twin(master::deserialise_twin(bytes, file.string()), file.parent_path(), unit_types(), &warnings);
  for (std::string& warning : warnings) settings.warn(std::move(warning));
  return twin;
}

}  // namespace

const UnitType& exported_unit() {
  static constexpr UnitType kType{master::kTwinName, master::kTwinSummary, make_twin};
  return kType;
}

}  // namespace cotwin::fmu
