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
#include "models/bag/bag.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

/// The topics of a ROS bag, or the messages of one as a table.
void info_of_bag(const fs::path& bag, const fs::path& csv, const std::string& topic) {
  if (csv.empty()) {
    std::cout << bag.string() << ": ROS 2 bag\n";
    for (const bag::TopicInfo& one : bag::topics_of(bag)) {
      std::cout << "  topic  " << one.name << "  " << one.type << ", " << text::counted(one.messages, "message");
      if (one.duration > 0)
        std::cout << " in " << text::to_text(one.duration, 4) << " s, "
                  << text::to_text(static_cast<double>(one.messages - 1) / one.duration, 4) << " Hz";
      if (!one.joints.empty()) std::cout << "; joints " << text::joined(one.joints);
      std::cout << (one.trouble.empty() ? "" : "; not read: " + one.trouble) << '\n';
    }
    return;
  }
  std::error_code none;
  if (fs::equivalent(bag, csv, none)) throw Error("--csv " + csv.string(), "is the bag itself, expected another file");
  const std::unique_ptr<csv::Source> table = csv::open(bag, {.topic = topic});
  AtomicFile out(csv);
  csv::Writer writer(out.stream(), table->names());
  while (table->next()) {
    for (std::size_t c = 0; c < table->names().size(); ++c) writer.cell(table->real(c));
    writer.end_row();
  }
  out.commit();
  for (const std::string& note : table->notes()) std::cout << "note: " << note << '\n';
}

int info(const fs::path& file, const fs::path& csv, const std::string& topic) {
  if (csv::is_bag(file)) {
    info_of_bag(file, csv, topic);
  } else if (!csv.empty()) {
    throw Error(file.string(), "is no ROS bag, expected one with --csv");
  } else if (is_fmu(file)) {
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
    command
        ->add_option("FILE", *file,
                     "FMU (.fmu, or unpacked), system structure (.ssd), package (.ssp); info: ROS bag (.mcap, .db3, folder)")
        ->type_name("FILE")
        ->required();
    command->callback([action, &chosen] { chosen = action; });
    return command;
  };
  const auto csv = std::make_shared<fs::path>();
  const auto topic = std::make_shared<std::string>();
  CLI::App* shown = add("info", "Show a summary of an FMU, a scenario or a ROS bag",
                        [file, csv, topic] { return info(*file, *csv, *topic); });
  CLI::Option* const written =
      shown->add_option("--csv", *csv, "Write the messages of a ROS bag as a table")->type_name("FILE");
  shown->add_option("--topic", *topic, "With --csv: their topic (default: the only one with joints)")
      ->type_name("NAME")
      ->needs(written);
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
