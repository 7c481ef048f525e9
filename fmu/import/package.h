#pragma once
#include <filesystem>
#include <string>
#include <string_view>

#include "components/unit/snapshot.h"
#include "fmu/import/load.h"

/// What an exported scenario needs of an FMU that it holds, beside the FMU's own files: no XML is read there.
namespace cotwin::fmu {

struct ForeignPackage {
  std::string name;    // of the archive, for messages
  std::string folder;  // below resources/: the unpacked FMU
  LoadOptions options;
  ModelDescription description;
  Snapshot start;  // the start values of all variables

  const Interface& interface() const { return interface_of(description, chosen_kind(description, options.kind)); }
};

/// Versioned, with a hash over all bytes. Throws Error `name: …` for a package that deserialise_foreign() would refuse.
std::string serialise(const ForeignPackage& package);
bool is_foreign_package(std::string_view bytes);
/// What holds of a description that was read from XML holds of the one that comes back (fmu/description/consistency.h), and
/// folder and model identifiers are names that stay below resources/. Throws Error `place: …` for anything else, and for bytes
/// that are not such a package of this version, or are damaged.
ForeignPackage deserialise_foreign(std::string_view bytes, const std::string& place);

/// Whether a library of this platform can hold FMUs: Windows' cannot.
bool holds_fmus(const std::string& platform);

/// The FMU's unit, with its start values; `resources`: where the package's folder lies. Throws Error as load() does, and in a
/// library that cannot hold FMUs.
Instance make_instance(ForeignPackage package, const std::filesystem::path& resources);

}  // namespace cotwin::fmu
