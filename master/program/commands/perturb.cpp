// cotwin perturb: writes a robot with randomly changed parameters, in place of a real one.
#include <fstream>
#include <iostream>
#include <memory>
#include <set>
#include <sstream>

#include "components/unit/settings.h"
#include "components/unit/variables.h"
#include "master/program/commands/commands.h"
#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"
#include "models/numerics/random.h"
#include "models/robot/changes/perturbed.h"
#include "models/robot/urdf/urdf.h"
#include "models/robot/urdf/urdf_update.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct PerturbArguments {
  std::string robot;
  double inertia = 0.05, values = 0.1;
  std::uint64_t seed = 1;
  std::vector<fs::path> sets;
  fs::path out;
};

void write(const fs::path& file, const std::string& text) {
  write_file(file, text);
  std::cout << file.string() << '\n';
}

/// Multiplies every number of the set by 1 + bound · u, u uniform in [−1, 1], also numbers of a list in a String. Parameters
/// with the same name up to the first '_' (tau_C, tau_S) have the same u in the same element, so that their order is preserved.
ParameterSet perturbed(ParameterSet set, double bound, std::uint64_t seed) {
  constexpr std::uint32_t kStream = 0x55f;
  const auto scaled = [&](double value, const std::string& name, std::size_t element) {
    std::uint32_t family = 2166136261u;  // FNV-1a
    for (const char c : name.substr(0, name.find_first_of("_["))) family = (family ^ static_cast<unsigned char>(c)) * 16777619u;
    const numerics::Key key{seed, kStream, 0, family, static_cast<std::uint32_t>(element)};
    return value * (1 + bound * (2 * numerics::uniform(key) - 1));
  };
  for (ParameterValue& parameter : set.values) {
    const ElementName name = parse_element_name(parameter.name);
    const std::size_t element = name.element < 0 ? 0 : static_cast<std::size_t>(name.element);
    if (double* real = std::get_if<double>(&parameter.value)) *real = scaled(*real, name.name, element);
    std::string* list = std::get_if<std::string>(&parameter.value);
    if (list == nullptr) continue;
    std::string changed;
    bool all = true;
    std::istringstream words(*list);
    std::size_t k = 0;
    for (std::string word; words >> word; ++k) {
      const auto number = text::parse_real(word);
      all = all && number.has_value();
      if (number) text::append(changed, text::to_text(scaled(*number, name.name, k)), " ");
    }
    if (all && !changed.empty()) *list = changed;
  }
  return set;
}

int perturb(const PerturbArguments& a) {
  if (!(a.values >= 0 && a.values < 1)) throw Error("--values", text::to_text(a.values) + ", expected a share from 0 to 1");
  Settings settings("perturb", "", {}, model_folders({}));
  const fs::path file = settings.robot_file(a.robot, " (another robot: --robot PATH.urdf)");
  std::vector<std::string> warnings;
  const robot::RobotModel robot = robot::load_urdf(file, {}, &warnings);
  const robot::RobotModel other = robot::perturbed(robot, a.inertia, a.seed);
  for (const std::string& warning : warnings) std::cerr << "warning: " << warning << '\n';
  make_folder(a.out);
  std::vector<fs::path> sources = a.sets;
  sources.push_back(file);
  std::set<fs::path> names;
  for (const fs::path& source : sources) {
    const fs::path target = a.out / (source == file ? "robot.urdf" : source.filename());
    if (fs::exists(target) && fs::equivalent(target, source)) {
      throw Error(target.string(), "would be overwritten, expected another folder after --out");
    }
    if (!names.insert(target).second)
      throw Error(target.string(), "would be written twice, expected parameter sets with different names");
  }
  write(a.out / "robot.urdf", robot::updated_urdf(text::read_file(file, "a URDF"), file.string(), other));
  for (const fs::path& set : a.sets) {
    std::ostringstream xml;
    const ParameterSet values = load_parameter_set(set);
    try {
      write_parameter_set(xml, perturbed(values, a.values, a.seed));
    } catch (const Error& error) {
      throw Error(set.string(), error.what());
    }
    write(a.out / set.filename(), xml.str());
  }
  return kExitDone;
}

}  // namespace

void add_perturb(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<PerturbArguments>();
  CLI::App* command = app.add_subcommand(
      "perturb", "Write a robot with randomly changed parameters, within bounds: to test tuning or the effect of errors");
  command->add_option("--robot", all->robot, "URDF, or the name of a robot")->type_name("ROBOT")->required();
  command->add_option("--inertia", all->inertia, "Largest relative change of masses and moments of inertia")
      ->type_name("SHARE")
      ->capture_default_str();
  command->add_option("--parameters", all->sets, "Parameter sets of the robot (SSV), e.g. its drive_train.ssv")
      ->type_name("FILE");
  command->add_option("--values", all->values, "Largest relative change of their numbers")
      ->type_name("SHARE")
      ->capture_default_str();
  command->add_option("--seed", all->seed, "Seed of the random changes")->type_name("NUMBER")->capture_default_str();
  command->add_option("-o,--out", all->out, "Folder for robot.urdf and the parameter sets")->type_name("FOLDER")->required();
  command->callback([all, &chosen] { chosen = [all] { return perturb(*all); }; });
}

}  // namespace cotwin::master
