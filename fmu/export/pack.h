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
#include "models/support/parameter_set.h"

/// Units as FMUs: archives that stand alone.
namespace cotwin::fmu {

/// What becomes an FMU. The first four are those of make_unit().
struct PackRequest {
  std::string source;  // "unit:drive_train?robot=lwr4"
  std::map<std::string, std::string> defaults;
  std::vector<std::filesystem::path> folders;
  std::span<const UnitType> types;
  std::vector<ParameterSet> values;  // applied one after the other to the unit's own start values
  Version version = Version::k3;
  std::string name;                             // what the host shows as the model's name; "" for the unit's
  std::optional<DefaultExperiment> experiment;  // instead of 0 to 1 s in steps of 1 ms
  /// Platforms as FMI 3 ("x86_64-linux") or FMI 2 ("linux64") names them, whose libraries must have been built; empty: this
  /// one.
  std::vector<std::string> platforms;
  std::filesystem::path libraries;  // a folder that is looked into before library_folder() and cross_folder()
  std::vector<std::filesystem::path> libraries_of_modules = {};  // folders for units from outside (unit_module.h)
  bool alone = true;  // a host must be able to initialise the FMU as it is; false: other FMUs may give it values
};

/// Writes the FMU: model description, the library of each platform, in resources/ the package that the unit is built from
/// (package.h) and every file that a parameter names, and documentation. The token is a hash of all that the host or the unit
/// reads, so equal requests give equal FMUs; so are the archives, byte by byte, but for generationDateAndTime, which is the
/// environment's SOURCE_DATE_EPOCH where there is one. Returns the warnings of the unit. Throws Error for what make_unit() and
/// the unit refuse (its initialisation, too, of one that is `alone`), and for a library that was not built.
std::vector<std::string> pack_unit(const PackRequest& request, const std::filesystem::path& out);

/// A unit that somebody has built, with the start values in its variables.
struct PackContent {
  const UnitType& type;  // by whose name the library is called
  const Unit& unit;
  const Variables& variables;
  std::string query;                               // its settings, as packed_query()
  std::shared_ptr<const robot::RobotModel> robot;  // nullptr if it has none
  std::shared_ptr<const scene::Cell> cell;         // nullptr if it has none
  std::vector<ArchiveFile> resources;              // what else the unit reads, each with its bytes
  std::vector<std::string> parts = {};             // units that the library must have inside
  bool only_once = false;                          // per process; what an FMU inside asks for, so does this one
  bool needs_tool = false;                         // likewise
};

/// The second half of pack_unit(): of the request only what comes after `values` matters.
void pack(const PackContent& content, const PackRequest& request, const std::filesystem::path& out);

/// The files that parameters name, as resources/<name>; the parameters then name the copies. `names` are those taken already.
std::vector<ArchiveFile> take_files(const Settings& settings, const Variables& variables, std::set<std::string>& names);

/// The unit's settings without paths of this machine: robot and scene are packed, so their names
/// stand for their files.
std::string packed_query(const Settings& settings);

/// Where the libraries lie, <folder>/<platform>/<unit>.so: ../lib/cotwin/fmu beside the running program's folder, in the build
/// tree and installed alike.
std::filesystem::path library_folder();

/// Where scripts/cross.sh puts the libraries for other platforms: build/cross/fmu, beside the folder of this build.
std::filesystem::path cross_folder();

/// "x86_64-linux": the platform that this program was built for.
std::string own_platform();

/// The platforms of the request in the words of FMI 3, each once; this program's where it names none.
std::vector<std::string> platforms_of(const std::vector<std::string>& wanted);
/// Where an FMU of that version has its library for a platform, "binaries/linux64/x.so".
std::string library_name(const std::string& platform, Version version, const std::string& identifier);

}  // namespace cotwin::fmu
