#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/archive/archive.h"
#include "fmu/description/model_description.h"
#include "models/foundation/formats/parameter_set.h"

/// Writes units as self-contained FMUs.
namespace cotwin::fmu {

/// The contents of an FMU to write. The first four members are the arguments of make_unit().
struct PackRequest {
  std::string source;  // "unit:drive_train?robot=lwr4"
  std::map<std::string, std::string> defaults;
  std::vector<std::filesystem::path> folders;
  std::span<const UnitType> types;
  std::vector<ParameterSet> values;  // applied in order to the unit's start values
  Version version = Version::k3;
  std::string name;                             // modelName; "": the unit's name
  std::optional<DefaultExperiment> experiment;  // no value: 0 to 1 s in steps of 1 ms
  /// Platforms, as named in FMI 3 ("x86_64-linux") or FMI 2 ("linux64"). Their libraries must have been built. Empty: this
  /// platform.
  std::vector<std::string> platforms;
  std::filesystem::path libraries;  // a folder to search before library_folder() and cross_folder()
  std::vector<std::filesystem::path> libraries_of_modules = {};  // folders for units from outside (unit_module.h)
  bool alone = true;  // the FMU must initialise with its own start values; false: other FMUs may set values first
};

/// Writes the FMU: model description; the library of each platform; in resources/ the package that the unit is built from
/// (package.h) and every file that a parameter names; documentation. The token is a hash of everything that the host or the
/// unit reads and of the libraries, so equal requests give equal FMUs. The archives are byte-identical except for
/// generationDateAndTime, which the environment variable SOURCE_DATE_EPOCH fixes. Returns the unit's warnings. Throws Error if make_unit() or the unit does
/// (also its initialisation, if `alone`), and if a library was not built.
std::vector<std::string> pack_unit(const PackRequest& request, const std::filesystem::path& out);

/// A unit that is already built, with the start values in its variables.
struct PackContent {
  const UnitType& type;  // its name is that of the library that the build made
  const Unit& unit;
  const Variables& variables;
  std::string query;                               // its settings, from packed_query()
  std::shared_ptr<const robot::RobotModel> robot;  // nullptr if it has none
  std::shared_ptr<const scene::Cell> cell;         // nullptr if it has none
  std::vector<ArchiveFile> resources;              // other files that the unit reads, with their bytes
  std::vector<std::string> parts = {};             // units that the library must contain
  bool only_once = false;                          // one instance per process, because an FMU inside requires it
  bool needs_tool = false;                         // needs an execution tool, likewise
  std::string identifier = {};                     // modelIdentifier, the library's name in the FMU; empty: the unit's name
};

/// Writes the FMU of a built unit. Uses only the members of the request after `values`.
void pack(const PackContent& content, const PackRequest& request, const std::filesystem::path& out);

/// Returns the files that parameters and settings name, as resources/<name>, and changes both to the new names. `names`: names in
/// use, extended by the new ones.
std::vector<ArchiveFile> collect_files(Settings& settings, const Variables& variables, std::set<std::string>& names);

/// Returns the unit's settings without paths of this machine: robots and scenes are packed, so names replace their files.
std::string packed_query(const Settings& settings);

/// Returns the folder of the libraries, <folder>/<platform>/<unit>.so: ../lib/cotwin/fmu relative to the folder of the running
/// program, both in the build tree and installed.
std::filesystem::path library_folder();

/// Returns the folder of the libraries for other platforms, from scripts/cross.sh: build/cross/fmu.
std::filesystem::path cross_folder();

/// Returns the platform of this program as named in FMI 3: "x86_64-linux".
std::string own_platform();

/// Returns the requested platforms as named in FMI 3, each once; this program's if none is requested.
std::vector<std::string> platforms_of(const std::vector<std::string>& wanted);
/// Returns the path of a platform's library in an FMU: "binaries/linux64/x.so".
std::string library_name(const std::string& platform, Version version, const std::string& identifier);

}  // namespace cotwin::fmu
