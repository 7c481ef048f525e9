// cotwin new: writes a first scenario for a robot of which only the URDF is known.
#include <algorithm>
#include <cctype>
#include <iostream>
#include <memory>
#include <string>
#include <string_view>

#include "components/unit/settings.h"
#include "master/program/commands/commands.h"
#include "master/workflows/starter/files.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/robot/robot_model.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

/// As a word that a shell takes as it is.
std::string for_a_shell(const fs::path& path) {
  const std::string text = path.string();
  const bool is_plain = std::ranges::all_of(text, [](unsigned char c) {
    return std::isalnum(c) != 0 || c > 127 || std::string_view("/._-+").find(static_cast<char>(c)) != std::string_view::npos;
  });
  if (is_plain) return text;
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

struct NewArguments {
  std::string robot, lock;
  starter::Kind kind = starter::Kind::kMotion;
  std::string unphysical = "error";
  fs::path out;
  bool overwrite = false;
};

Settings robot_settings(const NewArguments& a, const std::string& unphysical) {
  Settings settings("drive_train", "", {{"robot", a.robot}, {"lock", a.lock}, {"unphysical", unphysical}}, model_folders({}));
  settings.declare(settings_of(find_type("drive_train", units())));
  return settings;
}

/// The robot, and warnings of the reader as notes.
robot::RobotModel read_robot(const NewArguments& a, std::vector<std::string>& notes) {
  Settings settings = robot_settings(a, a.unphysical);
  try {
    robot::RobotModel robot = settings.robot();
    notes = settings.warnings();
    return robot;
  } catch (const Error& error) {
    if (a.unphysical == "warn") throw;
    try {
      robot_settings(a, "warn").robot();
    } catch (const Error&) {
      throw error;
    }
    throw Error(std::string(error.what()) + "\nGive the link the inertia of a body, or take it as it is by --unphysical warn");
  }
}

/// Drive data from files beside the robot's URDF; nothing if there are none.
std::optional<starter::Drives> known_drives(const NewArguments& a) {
  Settings settings = robot_settings(a, a.unphysical);
  const Instance drive = make_unit(settings, units());
  if (drive.given.empty()) return std::nullopt;
  const auto values = [&](const char* name) {
    const std::span<double> reals = drive.variables.at(name).reals();
    return std::vector<double>(reals.begin(), reals.end());
  };
  return starter::Drives{values("K"), values("D"), values("B"), values("sigma2"), values("tau_C")};
}

/// The robot as the scenario in `folder` names it: a name as it is; a file by the path from the folder if both are below the
/// working directory, so that they can be moved together, otherwise by its absolute path.
std::string robot_in_scenario(const std::string& robot, const fs::path& folder) {
  std::error_code none;
  if (!fs::is_regular_file(robot, none)) return robot;
  const fs::path here = fs::current_path(), file = fs::absolute(robot).lexically_normal();
  const auto below = [&](const fs::path& path) { return *path.lexically_relative(here).begin() != ".."; };
  const fs::path target = fs::absolute(folder).lexically_normal();
  if (!below(file) || !below(target)) return file.string();
  const std::string relative = file.lexically_relative(target).string();
  return relative.find('/') == std::string::npos ? "./" + relative : relative;
}

int new_scenario(NewArguments a) {
  const fs::path file = urdf_of(a.robot);
  const bool is_file = file == fs::path(a.robot);
  if (is_file) a.robot = fs::absolute(file).string();
  std::vector<std::string> notes;
  const robot::RobotModel robot = read_robot(a, notes);
  const std::optional<starter::Drives> drives = robot.n() > 0 ? known_drives(a) : std::nullopt;
  starter::Sketch sketch = starter::make_sketch(robot, a.kind, drives);
  sketch.notes.insert(sketch.notes.begin(), notes.begin(), notes.end());
  const std::string kind = text::word_of(a.kind, starter::kKindWords);
  starter::Naming naming{file_name_of(robot.name) + "_" + kind, a.robot, a.lock, a.unphysical == "warn"};
  if (a.out.empty()) a.out = naming.scenario;
  naming.robot = robot_in_scenario(a.robot, a.out);
  const std::vector<starter::File> files = starter::files_of(sketch, robot, naming);
  for (const starter::File& written : files) {
    const fs::path place = a.out / written.name;
    if (!a.overwrite && fs::exists(place))
      throw Error(place.string(), "exists, expected another folder after --out, or --overwrite");
  }
  make_folder(a.out);
  for (const starter::File& written : files) {
    const fs::path place = a.out / written.name;
    write_file(place, written.text);
    std::cout << place.string() << '\n';
  }
  for (const std::string& note : sketch.notes) std::cout << "note: " << note << '\n';
  std::cout << "run it with: cotwin run " << for_a_shell(a.out / "twin.ssd") << '\n';
  return kExitDone;
}

}  // namespace

void add_new(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<NewArguments>();
  CLI::App* command = app.add_subcommand("new", "Write a first scenario for a robot, with comments, that runs as it is");
  command->add_option("--robot", all->robot, "URDF, or the name of a robot")->type_name("ROBOT")->required();
  command
      ->add_option_function<std::string>(
          "--kind", [all](const std::string& word) { all->kind = text::choose("--kind", word, starter::kKindWords); },
          "motion: moves through waypoints; compliance: is pushed and gives way; contact: presses against a plate (default: "
          "motion)")
      ->check(CLI::IsMember({"motion", "compliance", "contact"}))
      ->type_name("WORD");
  command->add_option("-o,--out", all->out, "Folder for the files (default: <robot>_<kind>)")->type_name("FOLDER");
  command->add_option("--lock", all->lock, "Joints that stand still, e.g. finger_1:0.02,finger_2:0.02; rad or m")
      ->type_name("JOINT:POSITION,…");
  command
      ->add_option("--unphysical", all->unphysical,
                   "Links with an inertia that no body can have, or none: an error, or a warning (warn)")
      ->check(CLI::IsMember({"error", "warn"}))
      ->type_name("WORD")
      ->capture_default_str();
  command->add_flag("--overwrite", all->overwrite, "Overwrite files of these names");
  command->callback([all, &chosen] { chosen = [all] { return new_scenario(*all); }; });
}

}  // namespace cotwin::master
