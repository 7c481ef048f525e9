#pragma once
#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// One result of the checks of an FMU. Lists of findings are sorted by level.
struct Finding {
  enum class Level { kError, kWarning, kNote };
  Level level;
  std::string text;
  friend bool operator==(const Finding&, const Finding&) = default;
};

/// Checks the archive or folder, its modelDescription.xml and its libraries. If `load` is set, also creates and initialises an
/// instance, which runs the FMU's code. An FMU that cannot be read gives a finding of level kError, not an exception.
std::vector<Finding> check_fmu(const std::filesystem::path& path, bool load);

/// Writes a readable summary of an FMU: version, interfaces, platforms, variables. Throws Error if it cannot be read.
void write_info(std::ostream& out, const std::filesystem::path& path);

/// Writes one finding per line, then the number of errors and warnings. Returns true if there is no error.
bool write_findings(std::ostream& out, const std::vector<Finding>& findings);

/// Checks the rules of the FMI standard that the reader of the model description does not check.
std::vector<Finding> check_description(const ModelDescription& description);

}  // namespace cotwin::fmu
