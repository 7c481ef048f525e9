#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "components/unit/unit_table.h"
#include "fmu/import/foreign.h"

/// FMUs of others as units: what a scenario's source="x.fmu" becomes.
namespace cotwin::fmu {

/// What a scenario may say of a foreign FMU; the words are those of our annotation.
struct LoadOptions {
  std::string instance_name = "fmu";                // the component's name
  std::string kind = "any";                         // "cs", "me"; "any": Co-Simulation where the FMU offers it
  std::string process = "auto";                     // "shared", "own": see load()
  double timeout = 60;                              // s, of a call in a process of its own; ten times that to initialise
  double memory = 4e9;                              // bytes, of a process of its own
  bool locals = true;                               // also the FMU's local variables
  std::map<std::string, std::uint64_t> structural;  // of type UInt64, which give the sizes of arrays
  std::optional<double> stop, tolerance;            // s; relative
  bool si = true;                                   // values in SI; false: as the FMU has them, without a measure
  bool slopes = false;                              // also the time derivatives of outputs that the FMU can tell, "der(y)"
  bool rollback = false;                            // the FMU is told that the run may go back (ForeignUnit)
};

/// The unit of an archive (.fmu) or of an unpacked folder with modelDescription.xml, with its variables and their start values.
/// What was unpacked is removed when the unit goes, after errors too; what a killed program left behind is removed by the next
/// one. Throws Error `x.fmu: …`.
Instance load(const std::filesystem::path& path, const LoadOptions& options = {});

/// The archive unpacked, or the folder, and its description read. Throws Error as load().
std::shared_ptr<const ForeignFmu> open_fmu(const std::filesystem::path& path);

/// As load(), of an FMU that has been opened. process "own": in a process of its own (process.h), where a crash, a hang, an
/// exit() and what exceeds a limit of time or memory is an Error; "shared": in this one; "auto": shared.
Instance load(std::shared_ptr<const ForeignFmu> fmu, const LoadOptions& options);

/// As load(), of an FMU that has been unpacked and read, without XML and archives, and always in this process.
Instance make_instance(std::shared_ptr<const ForeignFmu> fmu, const LoadOptions& options);

/// The interface that `kind` ("any", "cs", "me") means. Throws Error if the FMU does not offer it.
InterfaceKind chosen_kind(const ModelDescription& description, const std::string& kind);

/// The settings of a source's query, "x.fmu?kind=me&process=own", on top of `options`. Throws Error for a key or value that is
/// none.
LoadOptions read_query(std::string_view query, LoadOptions options);

}  // namespace cotwin::fmu
