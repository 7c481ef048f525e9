#pragma once
#include <filesystem>
#include <map>
#include <memory>

#include "fmu/import/load.h"

namespace cotwin::fmu {

/// The FMUs of one scenario. An FMU is unpacked and loaded once, even if many components use it: copies of its library would
/// cost memory and, at a hundred instances, most of the processor's caches. Only an FMU that allows one instance per process is
/// copied for each further instance, so that each has its own library.
class FmuStore {
 public:
  /// Like open_fmu().
  std::shared_ptr<const ForeignFmu> open(const std::filesystem::path& path, const LoadOptions& options);

 private:
  std::map<std::filesystem::path, std::shared_ptr<const ForeignFmu>> opened_;  // by canonical path
};

}  // namespace cotwin::fmu
