#include "fmu/check/libraries.h"

#include <algorithm>
#include <map>
#include <set>
#include <string>

#include "fmu/check/elf.h"
#include "fmu/check/pe.h"
#include "fmu/import/library.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

namespace fs = std::filesystem;
using Level = Finding::Level;

std::vector<std::string> identifiers(const ModelDescription& d) {
  std::vector<std::string> found;
  for (const auto* interface : {&d.co_simulation, &d.model_exchange, &d.scheduled_execution}) {
    if (*interface && std::find(found.begin(), found.end(), (*interface)->model_identifier) == found.end()) {
      found.push_back((*interface)->model_identifier);
    }
  }
  return found;
}

/// Returns the machine for which the libraries of a folder in binaries/ are built, by the folder's name.
std::string machine_of(const std::string& folder) {
  static const std::map<std::string, std::string> kFmi2 = {{"linux64", "x86_64"}, {"linux32", "x86"},     {"win64", "x86_64"},
                                                           {"win32", "x86"},      {"darwin64", "x86_64"}, {"darwin32", "x86"}};
  const auto found = kFmi2.find(folder);
  return found != kFmi2.end() ? found->second : folder.substr(0, std::min(folder.find('-'), folder.size()));
}

/// The functions of FMI 2.0.4 for Co-Simulation, all of which must be present (2.1, 4.2).
constexpr const char* kCoSimulation2 =
    "fmi2CancelStep fmi2DeSerializeFMUstate fmi2DoStep fmi2EnterInitializationMode fmi2ExitInitializationMode "
    "fmi2FreeFMUstate fmi2FreeInstance fmi2GetBoolean fmi2GetBooleanStatus fmi2GetDirectionalDerivative "
    "fmi2GetFMUstate fmi2GetInteger fmi2GetIntegerStatus fmi2GetReal fmi2GetRealOutputDerivatives "
    "fmi2GetRealStatus fmi2GetStatus fmi2GetString fmi2GetStringStatus fmi2GetTypesPlatform fmi2GetVersion "
    "fmi2Instantiate fmi2Reset fmi2SerializeFMUstate fmi2SerializedFMUstateSize fmi2SetBoolean "
    "fmi2SetDebugLogging fmi2SetFMUstate fmi2SetInteger fmi2SetReal fmi2SetRealInputDerivatives fmi2SetString "
    "fmi2SetupExperiment fmi2Terminate";

/// Collects the findings of one library.
class Report {
 public:
  Report(const fs::path& file, std::string name, const std::string& prefix, std::vector<Finding>& out)
      : file_(file), name_(std::move(name)), prefix_(prefix), out_(out) {}

  void elf() {
    const ElfLibrary elf = read_elf(file_);
    common(elf.machine, elf.exported);
    std::vector<std::string> all = elf.needed;
    for (std::string& library : all) {
      const auto versions = elf.other_versions.find(library);
      if (versions != elf.other_versions.end()) library += " (" + text::joined(versions->second) + ")";
    }
    needs((elf.oldest_glibc.empty() ? "" : "glibc " + elf.oldest_glibc + " or newer"), all);
    if (elf.unique_symbols) add(Level::kWarning, "has unique symbols (STB_GNU_UNIQUE): it stays in memory after unloading");
    for (const std::string& needed : elf.needed) {
      static const std::set<std::string> kSystem = {"libc.so.6",
                                                    "libm.so.6",
                                                    "libdl.so.2",
                                                    "libpthread.so.0",
                                                    "librt.so.1",
                                                    "ld-linux-x86-64.so.2",
                                                    "ld-linux-aarch64.so.1",
                                                    "linux-vdso.so.1"};
      if (kSystem.count(needed) != 0) continue;
      if (!fs::exists(file_.parent_path() / needed)) {
        add(Level::kWarning, "needs " + needed + ", which is not in the archive");
      } else if (std::none_of(elf.run_path.begin(), elf.run_path.end(),
                              [](const std::string& p) { return p.find("$ORIGIN") != std::string::npos; })) {
        add(Level::kWarning, "needs " + needed + " from its own folder, but has no $ORIGIN in its run path");
      }
    }
  }

  void pe() {
    const PeLibrary pe = read_pe(file_);
    common(pe.machine, pe.exported);
    needs("", pe.needed);
    for (const std::string& needed : pe.needed) {
      if (is_part_of_windows(needed)) continue;
      if (!fs::exists(file_.parent_path() / needed)) {
        add(Level::kWarning, "needs " + needed + ", which is neither part of Windows nor in the archive");
      } else {
        add(Level::kNote, "needs " + needed + " from its own folder; Windows searches there only if the host requests it");
      }
    }
  }

  void add(Level level, const std::string& text) { out_.push_back({level, name_ + " " + text}); }

 private:
  void common(const std::string& machine, const std::vector<std::string>& exported) {
    const std::string expected = machine_of(file_.parent_path().filename().string());
    if (machine != expected) add(Level::kError, "is for " + machine + ", expected " + expected);
    std::vector<std::string> others;
    bool interface = false;
    for (const std::string& symbol : exported) {
      interface = interface || symbol.starts_with(prefix_);
      if (!symbol.starts_with("fmi2") && !symbol.starts_with("fmi3")) others.push_back(symbol);
    }
    if (!interface) add(Level::kError, "exports no function " + prefix_ + "…");
    if (std::ranges::binary_search(exported, "fmi2DoStep")) all_functions(exported);
    if (others.empty()) return;
    const std::size_t n = others.size();
    others.resize(std::min<std::size_t>(n, 3));
    add(Level::kWarning, "exports " + std::to_string(n) +
                             " symbols other than fmi2* and fmi3*, which can collide with those of other libraries: " +
                             text::joined(others) + (n > 3 ? ", …" : ""));
  }
  /// FMPy, OMSimulator and libcosim refuse a library without one of them; our importer does not.
  void all_functions(const std::vector<std::string>& exported) {
    std::vector<std::string> missing;
    for (const std::string_view name : text::split(kCoSimulation2, ' ')) {
      if (!std::ranges::binary_search(exported, name)) missing.emplace_back(name);
    }
    if (!missing.empty())
      add(Level::kWarning,
          "lacks functions that FMI 2 requires, without which other tools refuse it: " + text::joined(missing));
  }
  void needs(const std::string& first, std::vector<std::string> libraries) {
    if (!first.empty()) libraries.insert(libraries.begin(), first);
    add(Level::kNote, "needs " + (libraries.empty() ? "nothing" : text::joined(libraries)));
  }

  const fs::path& file_;
  std::string name_;
  const std::string& prefix_;
  std::vector<Finding>& out_;
};

}  // namespace

std::vector<fs::path> libraries(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code none;
  for (const auto& entry : fs::recursive_directory_iterator(folder / "binaries", none)) {
    const std::string ending = entry.path().extension().string();
    if (entry.is_regular_file() && (ending == ".so" || ending == ".dll" || ending == ".dylib")) found.push_back(entry.path());
  }
  std::sort(found.begin(), found.end());
  return found;
}

void check_libraries(const fs::path& folder, const ModelDescription& d, std::vector<Finding>& out) {
  const std::vector<std::string> own = identifiers(d);
  for (const std::string& identifier : own) {
    try {
      library_file(folder, d.version, identifier);
    } catch (const Error& error) {
      out.push_back({Level::kWarning, error.what()});
    }
  }
  const std::string prefix = d.version == Version::k2 ? "fmi2" : "fmi3";
  for (const fs::path& file : libraries(folder)) {
    if (std::find(own.begin(), own.end(), file.stem().string()) == own.end()) continue;  // a dependency of the FMU's library
    Report report(file, fs::relative(file, folder).generic_string(), prefix, out);
    try {
      if (file.extension() == ".so") report.elf();
      if (file.extension() == ".dll") report.pe();
      if (file.extension() == ".dylib") report.add(Level::kNote, "is not checked: libraries for macOS cannot be read");
    } catch (const Error& error) {
      report.add(Level::kError, std::string("cannot be used: ") + error.what());
    }
  }
}

}  // namespace cotwin::fmu
