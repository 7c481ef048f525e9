#pragma once
#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// What is wrong with an FMU, or might be; the worst first.
struct Finding {
  enum class Level { kError, kWarning, kNote };
  Level level;
  std::string text;
  friend bool operator==(const Finding&, const Finding&) = default;
};

/// Looks at the archive or folder, its modelDescription.xml and its libraries, and makes an instance if `load` is set: then the
/// FMU's code runs. An FMU that cannot be read at all is an error among the findings; nothing is thrown for it.
std::vector<Finding> check_fmu(const std::filesystem::path& path, bool load);

/// What an FMU is: for people. Throws Error for one that cannot be read.
void write_info(std::ostream& out, const std::filesystem::path& path);

/// The findings, one a line, and a verdict. Returns whether there is no error.
bool write_findings(std::ostream& out, const std::vector<Finding>& findings);

/// What the standards ask of a model description beyond what reading it needs.
std::vector<Finding> check_description(const ModelDescription& description);

}  // namespace cotwin::fmu
