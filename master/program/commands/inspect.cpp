// cotwin info, check: information about a file, and its errors.
#include <fstream>
#include <iostream>
#include <memory>

#include "fmu/check/check.h"
#include "master/program/commands/commands.h"
#include "master/workflows/check.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

int info(const fs::path& file) {
  if (is_fmu(file)) {
    fmu::write_info(std::cout, file);
  } else {
    write_info(std::cout, load_scenario(file));
  }
  return kExitDone;
}

int check(const fs::path& file) {
  const auto findings =
      is_fmu(file) ? fmu::check_fmu(file, true) : check_scenario(file, units(), model_folders(file.parent_path()));
  return fmu::write_findings(std::cout, findings) ? kExitDone : kExitBadInput;
}

}  // namespace

void add_inspection(CLI::App& app, Chosen& chosen) {
  const auto file = std::make_shared<fs::path>();
  const auto add = [&](const char* name, const char* description, int (*action)(const fs::path&)) {
    CLI::App* command = app.add_subcommand(name, description);
    command->add_option("FILE", *file, "FMU (.fmu, or unpacked), system structure (.ssd) or package (.ssp)")
        ->type_name("FILE")
        ->required();
    command->callback([file, action, &chosen] { chosen = [file, action] { return action(*file); }; });
  };
  add("info", "Show a summary of an FMU or a scenario", info);
  add("check", "List all errors and warnings of an FMU or a scenario; exit code 2 if there is an error", check);
}

}  // namespace cotwin::master
