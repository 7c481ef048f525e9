#pragma once
#include <filesystem>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "master/twin/twin.h"

/// What an exported scenario is built from: a file beside the package of the FMU (fmu/export/package.h), without XML.
namespace cotwin::master {

inline constexpr const char* kTwinName = "twin";
inline constexpr const char* kTwinSummary = "A whole scenario as one unit, with the master inside.";
inline constexpr const char* kTwinFile = "scenario.bin";

/// What a Twin needs of a scenario. `packages[i]`: the unit of scenario.components[i], as fmu::serialise(Package) or, of a
/// component that is an FMU, fmu::serialise(ForeignPackage) gives it.
struct TwinPackage {
  Scenario scenario;
  std::vector<std::string> packages;
  std::set<std::string> outputs;
};

/// Versioned, with a hash over all bytes.
std::string serialise(const TwinPackage& package);
/// Throws Error `place: …` for bytes that are not such a package of this version, or are damaged.
TwinPackage deserialise_twin(std::string_view bytes, const std::string& place);

/// Builds all units; `resources`: where the files lie that their parameters name, and the FMUs; `warnings`, if given, receives
/// what the units say when they are built. Throws Error, which names the component, for what cannot be built, and for what does
/// not fit together.
std::unique_ptr<Twin> build_twin(const TwinPackage& package, const std::filesystem::path& resources,
                                 std::span<const UnitType> types, std::vector<std::string>* warnings = nullptr);

}  // namespace cotwin::master
