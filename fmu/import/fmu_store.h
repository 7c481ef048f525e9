#pragma once
#include <filesystem>
#include <map>
#include <memory>

#include "fmu/import/load.h"

namespace cotwin::fmu {

/// The FMUs of one scenario. An FMU of which a process may hold several instances is unpacked and loaded once, however many
/// components use it: a copy of its library per instance would cost memory and, at a hundred of them, most of the processor's
/// caches. One that may be instantiated once per process only gets files of its own, and so a library of its own, per instance.
class FmuStore {
 public:
  /// As open_fmu().
  std::shared_ptr<const ForeignFmu> open(const std::filesystem::path& path, const LoadOptions& options);

 private:
  std::map<std::filesystem::path, std::shared_ptr<const ForeignFmu>> opened_;  // by canonical path
};

}  // namespace cotwin::fmu
