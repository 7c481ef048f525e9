#pragma once
#include <filesystem>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "master/twin/twin.h"

/// The file from which an exported scenario is built, beside the package of the FMU (fmu/export/package.h). It needs no XML.
namespace cotwin::master {

inline constexpr const char* kTwinName = "twin";
inline constexpr const char* kTwinSummary = "A whole scenario as one unit, with the master inside.";
inline constexpr const char* kTwinFile = "scenario.bin";

/// The data of a Twin. `packages[i]`: the unit of scenario.components[i] as fmu::serialise(Package), or the FMU as
/// fmu::serialise(ForeignPackage). `given[i]`: its start values of inputs and outputs, which choose the solutions of algebraic
/// loops; may be shorter than the list of components.
struct TwinPackage {
  Scenario scenario;
  std::vector<std::string> packages;
  std::vector<std::vector<GivenStart>> given;
  std::set<std::string> outputs;

  static auto fields(auto& p, auto each) { return each(p.scenario, p.packages, p.given, p.outputs); }
};

/// The bytes include a version and a hash.
std::string serialise(const TwinPackage& package);
/// Throws Error `place: …` for bytes that are not such a package of this version, or are damaged.
TwinPackage deserialise_twin(std::string_view bytes, const std::string& place);

/// Builds all units. `resources`: folder of the FMUs and of the files that parameters name. `warnings`, if given, receives the
/// warnings from building the units. Throws Error naming the component that cannot be built, or as the wiring does.
std::unique_ptr<Twin> build_twin(const TwinPackage& package, const std::filesystem::path& resources,
                                 std::span<const UnitType> types, std::vector<std::string>* warnings = nullptr);

}  // namespace cotwin::master
