// cotwin info, check: information about a file, and its errors.
#include <algorithm>
#include <functional>
#include <iostream>
#include <iterator>
#include <memory>
#include <string>

#include "fmu/check/check.h"
#include "master/program/commands/commands.h"
#include "master/workflows/check.h"
#include "master/workflows/clear_of.h"
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

int check(const fs::path& file, const std::vector<std::string>& scene, const std::vector<std::string>& bases) {
  auto findings = is_fmu(file) ? fmu::check_fmu(file, true) : check_scenario(file, units(), model_folders(file.parent_path()));
  if (!scene.empty()) {
    if (is_fmu(file)) throw Error("--clear-of", "is given with an FMU, expected a scenario");
    const bool wrong = std::ranges::any_of(findings, [](const auto& one) { return one.level == fmu::Finding::Level::kError; });
    if (!wrong) std::ranges::move(check_clear(file, units(), scene, bases), std::back_inserter(findings));
    std::ranges::stable_sort(findings, {}, &fmu::Finding::level);
  }
  return fmu::write_findings(std::cout, findings) ? kExitDone : kExitBadInput;
}

}  // namespace

void add_inspection(CLI::App& app, Chosen& chosen) {
  const auto file = std::make_shared<fs::path>();
  const auto scene = std::make_shared<std::vector<std::string>>();
  const auto bases = std::make_shared<std::vector<std::string>>();
  const auto add = [&](const char* name, const char* description, const std::function<int()>& action) {
    CLI::App* command = app.add_subcommand(name, description);
    command->add_option("FILE", *file, "FMU (.fmu, or unpacked), system structure (.ssd) or package (.ssp)")
        ->type_name("FILE")
        ->required();
    command->callback([action, &chosen] { chosen = action; });
    return command;
  };
  add("info", "Show a summary of an FMU or a scenario", [file] { return info(*file); });
  CLI::App* checked = add("check", "List all errors and warnings of an FMU or a scenario; exit code 2 if there is an error",
                          [file, scene, bases] { return check(*file, *scene, *bases); });
  CLI::Option* clear_of =
      checked
          ->add_option(
              "--clear-of", *scene,
              "Also whether the desired motions of joints keep clear of this scene (SDF file, or name of a scene), point cloud "
              "(.pcd, .ply, .xyz, .csv) or all that this component watches, of the other robots and of the robot itself, with "
              "the tools that it carries then; may be repeated")
          ->allow_extra_args(false)
          ->type_name("NAME");
  checked
      ->add_option("--base", *bases,
                   "Where a robot stands, m and rad; without it where contact worlds, monitors and scanners of the scenario "
                   "have it; may "
                   "be repeated")
      ->needs(clear_of)
      ->type_name("'NAME: X Y Z [ROLL PITCH YAW]'");
}

}  // namespace cotwin::master
