// cotwin new: writes a first scenario for a robot of which only the URDF is known.
#include <algorithm>
#include <cctype>
#include <iostream>
#include <memory>
#include <string>
#include <string_view>

#include "master/program/commands/commands.h"
#include "master/workflows/starter/make.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct NewArguments {
  starter::Request request;
  fs::path out;
  bool overwrite = false;
};

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
  const fs::path file = urdf_of(a.request.robot);
  const bool is_file = file == fs::path(a.request.robot);
  if (is_file) a.request.robot = fs::absolute(file).string();
  const starter::Starter made = starter::make_starter(a.request, units());
  const std::string name = is_file && file.stem() != "robot" ? file.stem().string() : made.robot;
  const std::string scenario = file_name_of(name) + "_" + text::word_of(a.request.kind, starter::kKindWords);
  if (a.out.empty()) a.out = scenario;
  const std::string robot = made.converted.empty() ? robot_in_scenario(a.request.robot, a.out) : "./robot.urdf";
  const std::vector<starter::File> files = made.files(scenario, robot);
  for (const starter::File& written : files) {
    const fs::path place = a.out / written.name;
    std::error_code none;
    if (fs::equivalent(place, file, none))
      throw Error(place.string(), "is the robot that is read, expected another folder after --out");
    if (!a.overwrite && fs::exists(place))
      throw Error(place.string(), "exists, expected another folder after --out, or --overwrite");
  }
  make_folder(a.out);
  for (const starter::File& written : files) {
    const fs::path place = a.out / written.name;
    write_file(place, written.text);
    std::cout << place.string() << '\n';
  }
  for (const std::string& note : made.sketch.notes) std::cout << "note: " << note << '\n';
  std::cout << "run it with: cotwin run " << text::for_a_shell((a.out / "twin.ssd").string()) << '\n';
  return kExitDone;
}

}  // namespace

void add_new(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<NewArguments>();
  CLI::App* command =
      app.add_subcommand("new", "Write a first scenario for a robot, with comments, and try that it runs as it is");
  command->add_option("--robot", all->request.robot, "URDF, or the name of a robot")->type_name("ROBOT")->required();
  command
      ->add_option_function<std::string>(
          "--kind", [all](const std::string& word) { all->request.kind = text::choose("--kind", word, starter::kKindWords); },
          "motion: moves through waypoints; compliance: is pushed and gives way; contact: presses against a plate (default: "
          "motion)")
      ->check(CLI::IsMember({"motion", "compliance", "contact"}))
      ->type_name("WORD");
  command->add_option("-o,--out", all->out, "Folder for the files (default: <file>_<kind>, or <robot>_<kind> for robot.urdf)")
      ->type_name("FOLDER");
  command->add_option("--lock", all->request.lock, "Joints that stand still, e.g. finger_1:0.02,finger_2:0.02; rad or m")
      ->type_name("JOINT:POSITION,…");
  command
      ->add_option("--end-effector", all->request.end_effector,
                   "Link at which the probe of --kind contact is mounted (default: the flange or palm of the longest chain)")
      ->type_name("LINK");
  add_unphysical(*command, all->request.unphysical);
  command
      ->add_option("--urdf-units", all->request.units,
                   "Units of a URDF that is not in SI, e.g. length=mm,mass=g,limit=deg,speed=deg/s,rpy=deg,inertia=g.mm2; it "
                   "is written in SI "
                   "beside the scenario, as robot.urdf. si: take unusual numbers as they are")
      ->type_name("QUANTITY=UNIT,…");
  command->add_flag("--overwrite", all->overwrite, "Overwrite files of these names");
  command->callback([all, &chosen] { chosen = [all] { return new_scenario(*all); }; });
}

}  // namespace cotwin::master
