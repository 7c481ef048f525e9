// cotwin tool: mounts tools on a robot outside of a run, and reads the history files of runs.
#include <algorithm>
#include <iostream>
#include <memory>

#include "components/unit/settings.h"
#include "master/engine/tools.h"
#include "master/program/commands/commands.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/changes/history.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;
using robot::RobotHistory;

struct ToolArguments {
  fs::path history, out;
  std::string robot, tool, of, reason;
  std::vector<double> q;
  std::optional<std::size_t> change;
  std::optional<double> time;
};

std::vector<RobotHistory> load(const fs::path& file) {
  return robot::parse_history(text::read_file(file, "a history of tools (.json)"), file.string());
}

/// The robot of the file that --of names, by itself or one of its components.
RobotHistory& choose(std::vector<RobotHistory>& histories, const ToolArguments& a) {
  RobotHistory* found = nullptr;
  std::string names;
  for (RobotHistory& history : histories) {
    const std::string components = text::joined(history.components);
    names += (names.empty() ? "'" : ", '") + history.name + "'" + (components.empty() ? "" : " (" + components + ")");
    const bool named = history.name == a.of || std::count(history.components.begin(), history.components.end(), a.of) > 0;
    if (!a.of.empty() && !named) continue;
    if (found != nullptr) throw Error(a.history.string(), "has several robots, expected --of with one component of " + names);
    found = &history;
  }
  if (found == nullptr) throw Error("--of " + a.of, a.history.string() + " has only " + (names.empty() ? "no robot" : names));
  return *found;
}

RobotHistory begin(const std::string& name) {
  Settings settings("tool", "", {}, model_folders({}));
  const fs::path file = settings.robot_file(name, " (another robot: --robot PATH.urdf)");
  std::vector<std::string> warnings;
  RobotHistory history{"", name, {}, robot::load_urdf(file, {}, &warnings)};
  history.name = history.robot.name;
  for (const std::string& warning : warnings) std::cerr << "cotwin: warning: " << warning << '\n';
  return history;
}

/// Prints the last change and the joints that cannot hold the robot at q.
void tell(const robot::RobotModel& robot, std::vector<double> q) {
  std::cout << robot.history.back().what << '\n';
  if (q.empty()) q.assign(static_cast<std::size_t>(robot.n()), 0.0);
  if (std::ssize(q) != robot.n())
    throw Error("--q", std::to_string(q.size()) + " positions, expected " + std::to_string(robot.n()));
  const robot::Mechanism mechanism(robot);
  robot::Data data(mechanism);
  Eigen::VectorXd g(robot.n());
  robot::gravity(mechanism, data, Eigen::Map<const Eigen::VectorXd>(q.data(), std::ssize(q)), g);
  if (const std::string load = describe_overload(robot, g); !load.empty())
    std::cerr << "cotwin: warning: at this pose " << load << '\n';
}

int change(const ToolArguments& a, bool attach) {
  const bool exists = fs::exists(a.history);
  if (exists && !a.robot.empty())
    throw Error(a.history.string(), "exists already and has its robot, expected no --robot or another file");
  if (!exists && a.robot.empty()) throw Error(a.history.string(), "does not exist, expected --robot for a new history");
  std::vector<RobotHistory> histories;
  if (exists) {
    histories = load(a.history);
  } else {
    histories.push_back(begin(a.robot));
  }
  RobotHistory& history = choose(histories, a);
  std::optional<double> time = a.time;
  if (!time && !history.robot.history.empty()) time = history.robot.history.back().time;
  if (attach) {
    const ToolSpec tool = parse_tool(a.tool);
    robot::attach(history.robot, attachment(tool), tool.reason.empty() ? a.reason : tool.reason, time);
  } else {
    robot::detach(history.robot, a.tool, a.reason, time);
  }
  tell(history.robot, a.q);
  write_file(a.history, robot::to_json(histories));
  return kExitDone;
}

int list(const ToolArguments& a) {
  for (const RobotHistory& history : load(a.history)) {
    std::cout << "robot " << history.name;
    for (std::size_t i = 0; i < history.components.size(); ++i) std::cout << (i == 0 ? " in " : ", ") << history.components[i];
    std::cout << '\n';
    std::size_t k = 0;
    for (const robot::Change& change : history.robot.history) {
      std::cout << "  " << ++k << "  " << (change.time ? text::to_text(*change.time) + " s  " : "") << change.what
                << (change.reason.empty() ? "" : " (" + change.reason + ")") << '\n';
    }
  }
  return kExitDone;
}

int write_urdf(const ToolArguments& a) {
  std::vector<RobotHistory> histories = load(a.history);
  const RobotHistory& history = choose(histories, a);
  std::size_t k = history.robot.history.size();
  if (a.change && a.time) throw Error("--change", "and --time, expected one of the two");
  if (a.change) k = *a.change;
  if (a.time) k = robot::changes_until(history.robot, *a.time);
  const std::string urdf = robot::to_urdf(robot::before(history.robot, k));
  if (a.out.empty()) {
    std::cout << urdf << std::flush;
  } else {
    write_file(a.out, urdf);
  }
  return kExitDone;
}

}  // namespace

void add_tool(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<ToolArguments>();
  CLI::App* tool = app.add_subcommand("tool", "Mount tools on a robot, and read the history of a run's tools");
  tool->require_subcommand(1);
  const auto add = [&](const char* name, const char* what) {
    CLI::App* command = tool->add_subcommand(name, what);
    command->add_option("HISTORY", all->history, "History file, e.g. results/<scenario>/history.json")
        ->type_name("FILE")
        ->required();
    return command;
  };
  const auto add_of = [&](CLI::App* command) {
    command->add_option("--of", all->of, "Which robot of the file: its name, or a component of the run")->type_name("NAME");
  };
  const auto add_change = [&](CLI::App* command) {
    add_of(command);
    command->add_option("--reason", all->reason, "Noted in the history")->type_name("TEXT");
    command->add_option("--time", all->time, "Time of the change, s (default: that of the last change)")->type_name("SECONDS");
    command->add_option("--q", all->q, "Pose in which the joints' torque limits are checked, rad or m (default: 0)")
        ->delimiter(',')
        ->type_name("Q1,Q2,…");
  };

  CLI::App* attach = add("attach", "Mount a tool; begins the history if the file does not exist");
  attach
      ->add_option("TOOL", all->tool, "As in `cotwin run --attach`, without a time: 'gripper,parent=link_7,file=gripper.urdf'")
      ->type_name("NAME,ITEM=VALUE")
      ->required();
  attach->add_option("--robot", all->robot, "For a new history: URDF, or the name of a robot")->type_name("ROBOT");
  add_change(attach);

  CLI::App* detach = add("detach", "Remove a tool");
  detach->add_option("TOOL", all->tool, "Its name")->type_name("NAME")->required();
  add_change(detach);

  CLI::App* history = add("history", "List the changes");

  CLI::App* exported = add("export", "Write the robot, or an earlier configuration of it, as URDF");
  add_of(exported);
  exported->add_option("--change", all->change, "After this number of changes; 0: the robot at the start")->type_name("K");
  exported->add_option("--time", all->time, "At this time of the run")->type_name("SECONDS");
  exported->add_option("-o,--out", all->out, "File (default: standard output)")->type_name("FILE");

  attach->callback([all, &chosen] { chosen = [all] { return change(*all, true); }; });
  detach->callback([all, &chosen] { chosen = [all] { return change(*all, false); }; });
  history->callback([all, &chosen] { chosen = [all] { return list(*all); }; });
  exported->callback([all, &chosen] { chosen = [all] { return write_urdf(*all); }; });
}

}  // namespace cotwin::master
