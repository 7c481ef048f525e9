// cotwin units, describe, reference: information about the units.
#include <iostream>
#include <memory>
#include <sstream>

#include "master/program/commands/commands.h"
#include "master/program/reference.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

Described describe_unit(const std::string& source, const std::map<std::string, std::string>& defaults) {
  const UnitSource parts = parse_unit_source(source);
  Described unit{source, Settings(parts.unit, parts.query, defaults, model_folders({})), {}, ""};
  try {
    unit.instance = make_unit(unit.settings, units());
  } catch (const MissingSetting& error) {
    unit.missing = error.what();
  }
  return unit;
}

int describe_source(std::string source, bool json) {
  if (source.rfind("unit:", 0) != 0) source = "unit:" + source;
  const Described unit = describe_unit(source, {});
  if (json) {
    describe_json(std::cout, unit);
  } else {
    describe(std::cout, unit);
  }
  return kExitDone;
}

int write_reference(const fs::path& folder, const std::string& robot) {
  fs::create_directories(folder);
  std::string index = "# Units\n\nWritten by `cotwin reference` from the units' declarations.\n\n";
  for (const UnitType& type : units()) {
    const Described unit = describe_unit(std::string("unit:") + type.name, {{"robot", robot}});
    std::ostringstream page;
    describe_markdown(page, type, unit, "`robot=" + robot + "`");
    const std::string name = std::string(type.name) + ".md";
    write_file(folder / name, page.str());
    index += "- [`" + std::string(type.name) + "`](" + name + "): " + type.summary + '\n';
  }
  write_file(folder / "README.md", index);
  return kExitDone;
}

int list_units() {
  for (const UnitType& type : units()) {
    std::string name = type.name;
    name.resize(std::max<std::size_t>(name.size(), 14), ' ');
    std::cout << name << "  " << type.summary << '\n';
  }
  return kExitDone;
}

}  // namespace

void add_catalogue(CLI::App& app, Chosen& chosen) {
  struct Arguments {
    std::string source, robot = "lwr4";
    fs::path folder;
    bool json = false;
  };
  const auto all = std::make_shared<Arguments>();
  CLI::App* units_command = app.add_subcommand("units", "List the units");

  CLI::App* describe_command = app.add_subcommand("describe", "Show the settings and variables of a unit");
  describe_command->add_option("UNIT", all->source, "A scenario's source, e.g. 'unit:drive_train?robot=lwr4'")
      ->type_name("SOURCE")
      ->required();
  describe_command->add_flag("--json", all->json, "As JSON");

  CLI::App* reference_command = app.add_subcommand("reference", "Write one Markdown page per unit");
  reference_command->add_option("DIR", all->folder, "Folder for the pages")->type_name("FOLDER")->required();
  reference_command->add_option("--robot", all->robot, "Robot whose sizes and start values are shown")
      ->type_name("NAME")
      ->capture_default_str();

  units_command->callback([&chosen] { chosen = list_units; });
  describe_command->callback([all, &chosen] { chosen = [all] { return describe_source(all->source, all->json); }; });
  reference_command->callback([all, &chosen] { chosen = [all] { return write_reference(all->folder, all->robot); }; });
}

}  // namespace cotwin::master
