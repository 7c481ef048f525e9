// cotwin pack: writes units as FMUs, scenarios as packages (SSP) or as one FMU.
#include <fstream>
#include <iostream>
#include <memory>

#include "fmu/archive/file_kind.h"
#include "fmu/export/pack.h"
#include "master/program/commands/commands.h"
#include "master/twin/pack_twin.h"
#include "master/twin/package.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct PackArguments {
  std::string source;
  fs::path out;
  int fmi = 2;
  bool as_fmu = false;
  std::vector<std::string> set, platforms;
  fs::path libraries;

  fmu::Version version() const { return fmi == 2 ? fmu::Version::k2 : fmu::Version::k3; }
};

/// Adds `--set NAME=VALUE` of a unit to the request: settings, and start values of variables.
void add_values(const PackArguments& arguments, fmu::PackRequest& request) {
  ParameterSet values{"--set", {}, {}};
  for (const std::string& assignment : arguments.set) {
    const std::size_t equals = assignment.find('=');
    if (equals == std::string::npos || equals == 0)
      throw Error("--set " + assignment, "expected variable=value or setting=value");
    const std::string name = assignment.substr(0, equals);
    if (has_setting(request.source, name, request.types)) {
      request.source = with_setting(request.source, name, assignment.substr(equals + 1));
      continue;
    }
    values.values.push_back({name, assignment.substr(equals + 1), "", "--set " + assignment, true});
  }
  request.values.push_back(std::move(values));
}

std::vector<std::string> pack_unit(const PackArguments& arguments) {
  fmu::PackRequest request;
  request.source = arguments.source;
  request.folders = model_folders({});
  request.types = units();
  request.version = arguments.version();
  request.platforms = arguments.platforms;
  request.libraries = arguments.libraries;
  request.libraries_of_modules = libraries_of_modules();
  add_values(arguments, request);
  return fmu::pack_unit(request, arguments.out);
}

std::vector<std::string> pack_scenario(const PackArguments& arguments) {
  Scenario scenario = load_scenario(arguments.source);
  for (const std::string& assignment : arguments.set) assign(scenario, assignment, units());
  PackageOptions options;
  options.types = units();
  options.folders = model_folders(scenario.folder);
  options.version = arguments.version();
  options.platforms = arguments.platforms;
  options.libraries = arguments.libraries;
  options.libraries_of_modules = libraries_of_modules();
  return arguments.as_fmu ? pack_twin(scenario, options, arguments.out) : pack_scenario(scenario, options, arguments.out);
}

int pack(const PackArguments& arguments) {
  const bool unit = arguments.source.rfind("unit:", 0) == 0;
  const std::string ending = unit || arguments.as_fmu ? ".fmu" : ".ssp";
  if (!fmu::has_ending(arguments.out, ending))
    throw Error("--out " + arguments.out.string(), "expected a name that ends in " + ending);
  for (const std::string& warning : unit ? pack_unit(arguments) : pack_scenario(arguments)) {
    std::cerr << "cotwin: warning: " << warning << '\n';
  }
  return kExitDone;
}

}  // namespace

void add_pack(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<PackArguments>();
  CLI::App* command = app.add_subcommand("pack", "Write a unit as an FMU, or a scenario as an SSP of FMUs or as one FMU");
  command->add_option("SOURCE", all->source, "A unit, e.g. 'unit:drive_train?robot=lwr4', or a scenario (.ssd, .ssp)")
      ->type_name("SOURCE")
      ->required();
  command->add_option("-o,--out", all->out, "X.fmu for a unit, X.ssp for a scenario (X.fmu with --as-fmu)")
      ->type_name("FILE")
      ->required();
  command->add_option("--fmi", all->fmi, "Version of FMI")
      ->check(CLI::IsMember({2, 3}))
      ->type_name("2|3")
      ->capture_default_str();
  command->add_flag("--as-fmu", all->as_fmu, "Write a scenario as one FMU that contains the master and all units");
  command->add_option("--set", all->set, "variable=value or setting=value of a unit; for a scenario as in run; may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  command
      ->add_option(
          "--platforms", all->platforms,
          "Platforms whose libraries are packed: linux64, win64, aarch64-linux, built by scripts/cross.sh; default: this one")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("NAMES");
  command
      ->add_option("--platform-dir", all->libraries,
                   "Folder with the libraries of platforms, PLATFORM/UNIT.dll or .so; default: build/cross/fmu")
      ->check(CLI::ExistingDirectory)
      ->type_name("DIR");
  command->callback([all, &chosen] { chosen = [all] { return pack(*all); }; });
}

}  // namespace cotwin::master
