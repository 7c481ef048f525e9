// The scenario as an exported unit: what CMake writes for each unit (fmu/export/exported_unit.cpp.in), for the twin.
#include <fstream>
#include <sstream>

#include "fmu/export/export.h"
#include "master/twin/twin_package.h"
#include "models/support/error.h"

namespace cotwin::fmu {

namespace {

std::unique_ptr<Unit> make_twin(Settings& settings) {
  const std::filesystem::path file = settings.file(master::kTwinFile);
  std::ifstream in(file, std::ios::binary);
  std::ostringstream content;
  content << in.rdbuf();
  if (!in) throw Error(file.string(), "cannot be read");
  std::vector<std::string> warnings;
  auto twin =
      master::build_twin(master::deserialise_twin(content.str(), file.string()), file.parent_path(), unit_types(), &warnings);
  for (std::string& warning : warnings) settings.warn(std::move(warning));
  return twin;
}

}  // namespace

const UnitType& exported_unit() {
  static constexpr UnitType kType{master::kTwinName, master::kTwinSummary, make_twin};
  return kType;
}

}  // namespace cotwin::fmu
