#include "fmu/import/fmu_store.h"

#include "fmu/archive/archive.h"
#include "models/foundation/support/error.h"

namespace cotwin::fmu {

namespace fs = std::filesystem;

namespace {

/// Copies an unpacked FMU into a new temporary folder.
std::shared_ptr<const ForeignFmu> copy_of(const ForeignFmu& fmu) {
  const auto folder = std::make_shared<const TemporaryFolder>();
  fs::copy(fmu.folder, folder->path(), fs::copy_options::recursive);
  auto copy = std::make_shared<ForeignFmu>(fmu);
  copy->folder = folder->path();
  copy->unpacked = folder;
  return copy;
}

}  // namespace

std::shared_ptr<const ForeignFmu> FmuStore::open(const fs::path& path, const LoadOptions& options) {
  std::error_code none;
  fs::path key = fs::weakly_canonical(path, none);
  if (none) key = path;
  std::shared_ptr<const ForeignFmu>& first = opened_[key];
  if (first == nullptr) return first = open_fmu(path);
  const ModelDescription& d = first->description;
  const bool once = (d.co_simulation && d.co_simulation->only_once_per_process) ||
                    (d.model_exchange && d.model_exchange->only_once_per_process);
  if (!once || options.process == ProcessChoice::kOwn) return first;
  try {
    return copy_of(*first);
  } catch (const fs::filesystem_error& error) {
    throw Error(first->name, error.what());
  }
}

}  // namespace cotwin::fmu
