#pragma once
#include <filesystem>
#include <string>
#include <string_view>

#include "components/unit/snapshot.h"
#include "fmu/import/load.h"

/// The data of an FMU inside an exported scenario, apart from the FMU's own files. No XML is read there.
namespace cotwin::fmu {

struct ForeignPackage {
  std::string name;    // of the archive, for messages
  std::string folder;  // of the unpacked FMU, in resources/
  LoadOptions options;
  ModelDescription description;
  Snapshot start;  // the start values of all variables

  static auto fields(auto& p, auto each) { return each(p.name, p.folder, p.options, p.description, p.start); }
  const Interface& interface() const { return interface_of(description, chosen_kind(description, options.kind)); }
};

/// Writes a package with a version and a hash. Throws Error `name: …` for a package that deserialise_foreign() would reject.
std::string serialise(const ForeignPackage& package);
/// The same for the parts of a package whose description has passed the checks, as one that was read from XML has.
std::string serialise_checked(const std::string& name, const std::string& folder, const LoadOptions& options,
                              const ModelDescription& description, const Snapshot& start);
bool is_foreign_package(std::string_view bytes);
/// Reads a package. Its description passes the same checks as one from XML (fmu/description/consistency.h); folder and model
/// identifiers are names that stay in resources/. Throws Error `place: …` otherwise, and for bytes that are damaged or not a
/// package of this version.
ForeignPackage deserialise_foreign(std::string_view bytes, const std::string& place);

/// Returns whether exported scenarios for this platform can contain FMUs; those for Windows cannot.
bool holds_fmus(const std::string& platform);

/// Makes the FMU's unit with its start values; `resources` contains the package's folder. Throws Error like load(), and on a
/// platform without support for FMUs in exported scenarios.
Instance make_instance(ForeignPackage package, const std::filesystem::path& resources);

}  // namespace cotwin::fmu
