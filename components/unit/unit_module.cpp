#include "components/unit/unit_module.h"

#include <dlfcn.h>

#include <algorithm>
#include <string>

#include "models/foundation/support/error.h"

namespace cotwin {

namespace {

namespace fs = std::filesystem;

/// Throws Error for a module whose objects this program would misread.
void check_layout(const UnitModule& module, const std::string& place) {
  const std::string hint = "; rebuild it with find_package(cotwin) of this version";
  if (module.format != kModuleFormat || std::string(module.version) != COTWIN_UNIT_INTERFACE) {
    throw Error(place, std::string("is a module for cotwin ") + module.version + ", expected " + COTWIN_UNIT_INTERFACE + hint);
  }
  static constexpr const char* kNames[] = {"the C++ ABI version", "_GLIBCXX_USE_CXX11_ABI", "EIGEN_MAX_ALIGN_BYTES",
                                           "sizeof(Variable)",    "sizeof(Variables)",      "sizeof(Settings)",
                                           "sizeof(UnitType)"};
  static_assert(std::size(kNames) == kUnitLayout.size());
  for (std::size_t i = 0; i < kUnitLayout.size(); ++i) {
    if (module.layout[i] == kUnitLayout[i]) continue;
    throw Error(place, "was compiled with " + std::to_string(module.layout[i]) + " for " + kNames[i] + ", expected " +
                           std::to_string(kUnitLayout[i]) + ": use the compiler and the options of cotwin (no -march)");
  }
}

const UnitModule& open_module(const fs::path& file) {
  const std::string place = file.string();
  if (!fs::is_regular_file(file)) throw Error(place, "no such file, expected a module of units (.so) or a folder of them");
  void* library = dlopen(fs::absolute(file).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) throw Error(place, std::string("cannot be loaded: ") + dlerror());
  using Entry = const UnitModule* (*)();
  const auto entry = reinterpret_cast<Entry>(dlsym(library, "cotwin_unit_module"));
  if (entry == nullptr)
    throw Error(place, "has no function cotwin_unit_module, expected a module that cotwin_unit() in CMake made");
  const UnitModule& module = *entry();
  check_layout(module, place);
  return module;
}

/// The files that a path means: itself, or the modules of a folder in alphabetical order.
std::vector<fs::path> files_of(const fs::path& path) {
  if (!fs::is_directory(path)) return {path};
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(path)) {
    if (entry.path().extension() == ".so") files.push_back(entry.path());
  }
  if (files.empty()) throw Error(path.string(), "has no module of units (*.so)");
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

UnitCatalogue load_units(std::span<const UnitType> own, std::span<const fs::path> paths) {
  UnitCatalogue all{{own.begin(), own.end()}, {}};
  for (const fs::path& path : paths) {
    for (const fs::path& listed : files_of(path)) {
      const fs::path file = fs::weakly_canonical(listed);
      if (std::find(all.modules.begin(), all.modules.end(), file) != all.modules.end()) continue;
      const UnitModule& module = open_module(file);
      for (const UnitType& type : std::span(module.types, module.count)) {
        const auto same = [&](const UnitType& t) { return std::string_view(t.name) == type.name; };
        if (std::any_of(all.types.begin(), all.types.end(), same))
          throw Error(file.string(), std::string("there is another unit '") + type.name + "', expected a name of its own");
        all.types.push_back(type);
      }
      all.modules.push_back(file);
    }
  }
  return all;
}

}  // namespace cotwin
