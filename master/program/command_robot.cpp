// cotwin robot: an emulated robot with its controller, for clients of the robot's interface.
#include <iostream>
#include <memory>

#include "master/program/commands.h"
#include "models/robot/urdf/urdf.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct RobotArguments {
  std::string fri, robot = "lwr4", address, client, q0, mode = "position";
  std::optional<int> port;
  double period = 5;  // ms
  std::optional<double> seconds;
  fs::path out = "results/robot";
  std::vector<std::string> set, record;
  bool once = false, quiet = false;
};

/// lwr, sunrise (1.15), sunrise-1.11 …: the setting of unit:io, which checks it.
std::string protocol_of(const std::string& fri) { return fri == "sunrise" ? "sunrise-1.15" : fri; }

fs::path scenario_file() {
  for (const fs::path& folder : model_folders({})) {
    const fs::path file = folder / "scenarios/fri_robot.ssd";
    std::error_code none;
    if (fs::is_regular_file(file, none)) return file;
  }
  throw Error("scenarios/fri_robot.ssd",
              "is not in the model folders, expected it in those of Cotwin (COTWIN_MODELS adds others)");
}

int emulate(const RobotArguments& a) {
  const std::string protocol = protocol_of(a.fri);
  const bool lwr = protocol == "lwr";
  ScenarioRun run;
  run.file = scenario_file();
  run.out = a.out;
  run.record = a.record;
  run.stop = a.seconds;
  run.quiet = a.quiet;
  const auto set = [&](const std::string& name, const std::string& value) { run.set.push_back(name + "=" + value); };
  set("controller.protocol", protocol);
  set("robot", urdf_of(a.robot).string());
  set("controller.period", text::to_text(a.period * 1e-3));
  set("controller.client_mode", a.mode);
  set("controller.restart", a.once ? "0" : "1");
  const std::string address = a.address.empty() ? (lwr ? "127.0.0.1" : "127.0.0.2") : a.address;
  const std::string client = a.client.empty() ? "127.0.0.1" : a.client;
  set("controller.address", address);
  const std::string default_port = lwr ? "49938" : "30200";
  set("controller.client", client.find(':') == std::string::npos ? client + ":" + default_port : client);
  if (a.port) set("controller.port", std::to_string(*a.port));
  if (!a.q0.empty()) set("drive.q0", a.q0);
  run.set.insert(run.set.end(), a.set.begin(), a.set.end());
  if (!a.quiet) {
    std::cout << "robot " << a.robot << " with FRI " << protocol << " at " << address
              << (a.port ? ":" + std::to_string(*a.port)
                  : lwr  ? ""
                         : ":30200")
              << ", client expected at " << (client.find(':') == std::string::npos ? client + ":" + default_port : client)
              << ", a message every " << text::to_text(a.period) << " ms; "
              << (a.seconds ? "for " + text::to_text(*a.seconds) + " s" : "until Ctrl-C") << std::endl;
  }
  return run_scenario(run);
}

}  // namespace

void add_robot(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<RobotArguments>();
  RobotArguments& a = *all;
  CLI::App* command =
      app.add_subcommand("robot", "Emulate a robot with its controller, for clients of its interface (docs/fri.md)");
  command
      ->add_option("--fri", a.fri,
                   "KUKA's FRI: lwr (LWR 4+, FRI 1.0), sunrise (1.15), or sunrise-1.11, -1.14, -1.16, -2.5, -2.7")
      ->required()
      ->type_name("PROTOCOL");
  command->add_option("--robot", a.robot, "URDF, or name of a robot in models/robots")
      ->capture_default_str()
      ->type_name("URDF");
  command->add_option("--period", a.period, "Send period in milliseconds, 1 to 100")->capture_default_str()->type_name("MS");
  command
      ->add_option("--client", a.client,
                   "IPv4 address of the client, perhaps with :port (default: 127.0.0.1, port 49938 or 30200)")
      ->type_name("ADDRESS");
  command
      ->add_option(
          "--address", a.address,
          "IPv4 address that the controller sends from (default: 127.0.0.1 for lwr, 127.0.0.2 for sunrise, reached from "
          "this machine only)")
      ->type_name("ADDRESS");
  command->add_option("--port", a.port, "UDP port that the controller sends from (default: any for lwr, 30200 for sunrise)")
      ->check(CLI::Range(0, 65535))
      ->type_name("PORT");
  command->add_option("--mode", a.mode, "Sunrise: what the client has to command: position, torque, wrench or pose")
      ->capture_default_str()
      ->type_name("MODE");
  command->add_option("--q0", a.q0, "Joint positions at the start in rad, e.g. '0 0.3 0 -1.2 0 0.9 0' (default: 0)")
      ->type_name("LIST");
  command->add_flag("--once", a.once,
                    "After an end of commanding for a reason (lost commands, limits …), do not begin it again");
  command->add_option("--seconds", a.seconds, "Duration (default: until Ctrl-C)")
      ->check(CLI::PositiveNumber)
      ->type_name("SECONDS");
  command
      ->add_option("--set", a.set,
                   "As in cotwin run, for the components controller, position_control and drive; may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  command->add_option("--record", a.record, "Variables to record, e.g. 'drive.q'; may be repeated (default: state and quality)")
      ->type_name("GLOB")
      ->allow_extra_args(false);
  command->add_option("--out", a.out, "Folder for the results")->capture_default_str()->type_name("FOLDER");
  command->add_flag("--quiet", a.quiet, "No progress bar and no table");
  command->callback([all, &chosen] { chosen = [all] { return emulate(*all); }; });
}

}  // namespace cotwin::master
