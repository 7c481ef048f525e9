#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "components/unit/unit_table.h"
#include "fmu/import/choices.h"
#include "fmu/import/foreign.h"

/// Loads foreign FMUs as units, as for source="x.fmu" in a scenario.
namespace cotwin::fmu {

/// Settings of a foreign FMU in a scenario, named as in our annotation.
struct LoadOptions {
  std::string instance_name = "fmu";  // the component's name
  InterfaceChoice kind = InterfaceChoice::kAny;
  ProcessChoice process = ProcessChoice::kAuto;
  double timeout = 60;                              // s, of a call in the FMU's own process; ten times that to initialise
  double memory = 4e9;                              // bytes, limit of the FMU's own process
  bool locals = true;                               // also the FMU's local variables
  std::map<std::string, std::uint64_t> structural;  // UInt64 structural parameters (sizes of arrays), by name
  std::optional<double> stop, tolerance;            // s; relative
  bool si = true;                                   // convert values to SI; false: keep the FMU's values, without a unit
  bool slopes = false;                              // also the time derivatives "der(y)" of outputs that the FMU gives
  std::optional<bool> rollback;  // earlier states may be restored (ForeignUnit); no value: if the FMU is ours

  static auto fields(auto& o, auto each) {
    return each(o.instance_name, o.kind, o.locals, o.structural, o.stop, o.tolerance, o.si, o.slopes, o.rollback);
  }
  /// Of this program's process, not of the FMU in a package.
  static auto left_out(auto& o, auto each) { return each(o.process, o.timeout, o.memory); }
};

/// Loads an archive (.fmu) or an unpacked folder with modelDescription.xml as a unit, with its variables and their start
/// values. The unpacked files are removed with the unit and after errors. Files that a killed program left behind are removed
/// at the next load. Throws Error `x.fmu: …`.
Instance load(const std::filesystem::path& path, const LoadOptions& options = {});

/// Unpacks the archive, or uses the folder, and reads its description. Throws Error like load().
std::shared_ptr<const ForeignFmu> open_fmu(const std::filesystem::path& path);

/// Reads the description of an archive, without unpacking it, or of an unpacked folder. Throws Error.
ModelDescription read_fmu_description(const std::filesystem::path& path);

/// Loads an opened FMU. process kOwn: in its own process (process.h), where a crash, a hang, an exit() and an exceeded limit
/// of time or memory become an Error; kShared and kAuto: in this process.
Instance load(std::shared_ptr<const ForeignFmu> fmu, const LoadOptions& options);

/// Loads an opened FMU in this process. Needs neither the XML reader nor archives.
Instance make_instance(std::shared_ptr<const ForeignFmu> fmu, const LoadOptions& options);

/// Returns the interface for `kind`. The FMU need not have it.
InterfaceKind chosen_kind(const ModelDescription& description, InterfaceChoice kind);

/// Returns `options` changed by the query of a source, "x.fmu?kind=me&process=own". Throws Error for an invalid key or value.
LoadOptions read_query(std::string_view query, LoadOptions options);

}  // namespace cotwin::fmu
