// cotwin robot: an emulated robot with its controller, for clients of the robot's interface.
#include <fstream>
#include <iostream>
#include <memory>

#include "master/program/commands/commands.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct RobotArguments {
  std::string fri, robot, address, client, q0, mode = "position";
  std::optional<int> port;
  double period = 5;       // ms
  double frequency = 500;  // Hz
  std::optional<double> seconds;
  fs::path out = "results/robot";
  std::vector<std::string> set, record;
  bool once = false, quiet = false, rtde = false, script = false;
};

constexpr double kSpacing = 0.25e-3;  // s per ms of the period, between messages of a run that is late

/// lwr, sunrise (1.15), sunrise-1.11 …: the setting of unit:io, which checks it.
std::string protocol_of(const std::string& fri) { return fri == "sunrise" ? "sunrise-1.15" : fri; }

/// models/scenarios/<name>
fs::path scenario_file(const std::string& name) {
  for (const fs::path& folder : model_folders({})) {
    const fs::path file = folder / "scenarios" / name;
    std::error_code none;
    if (fs::is_regular_file(file, none)) return file;
  }
  throw Error("scenarios/" + name, "is not in the model folders, expected it in those of Cotwin (COTWIN_MODELS adds others)");
}

/// The program for a Universal Robots controller, to the standard output.
int print_script() {
  std::ifstream file(scenario_file("rtde_follow.script"));
  std::cout << file.rdbuf() << std::flush;
  return file && std::cout ? 0 : 1;
}

ScenarioRun run_of(const RobotArguments& a, const char* scenario) {
  ScenarioRun run;
  run.file = scenario_file(scenario);
  run.out = a.out;
  run.record = a.record;
  run.stop = a.seconds;
  run.quiet = a.quiet;
  return run;
}

std::string duration_of(const RobotArguments& a) {
  return a.seconds ? "for " + text::to_text(*a.seconds) + " s" : "until Ctrl-C";
}

int emulate_rtde(const RobotArguments& a) {
  ScenarioRun run = run_of(a, "rtde_robot.ssd");
  const auto set = [&](const std::string& name, const std::string& value) { run.set.push_back(name + "=" + value); };
  const std::string robot = a.robot.empty() ? "ur5e" : a.robot, address = a.address.empty() ? "127.0.0.1" : a.address;
  set("robot", urdf_of(robot).string());
  set("controller.address", address);
  set("controller.frequency", text::to_text(a.frequency));
  if (a.port) set("controller.port", std::to_string(*a.port));
  set("drive.q0", a.q0.empty() ? "0 -1.57 1.57 -1.57 -1.57 0" : a.q0);
  run.set.insert(run.set.end(), a.set.begin(), a.set.end());
  if (!a.quiet) {
    std::cout << "robot " << robot << " with RTDE at " << address << ":" << a.port.value_or(30004) << ", "
              << text::to_text(a.frequency) << " Hz; " << duration_of(a) << std::endl;
  }
  return run_scenario(run);
}

int emulate(const RobotArguments& a) {
  if (a.script) return print_script();
  if (a.rtde == !a.fri.empty()) throw Error("cotwin robot", "expected either --fri or --rtde");
  if (a.rtde) return emulate_rtde(a);
  const std::string protocol = protocol_of(a.fri), robot = a.robot.empty() ? "lwr4" : a.robot;
  const bool lwr = protocol == "lwr";
  if (lwr && a.mode != "position") {
    throw Error("cotwin robot --mode", "'" + a.mode +
                                           "' with --fri lwr, expected it only with sunrise: the flags of an LWR client's "
                                           "commands say what it commands");
  }
  ScenarioRun run = run_of(a, "fri_robot.ssd");
  const auto set = [&](const std::string& name, const std::string& value) { run.set.push_back(name + "=" + value); };
  set("controller.protocol", protocol);
  set("robot", urdf_of(robot).string());
  set("controller.period", text::to_text(a.period * 1e-3));
  set("controller.spacing", text::to_text(a.period * kSpacing));
  set("controller.client_mode", a.mode);
  set("controller.restart", a.once ? "0" : "1");
  set("controller.start_time", "-1");
  const std::string address = a.address.empty() ? "127.0.0.1" : a.address;
  const std::string client = a.client.empty() ? "127.0.0.1" : a.client;
  set("controller.address", address);
  const std::string default_port = lwr ? "49938" : "30200";
  set("controller.client", client.find(':') == std::string::npos ? client + ":" + default_port : client);
  if (a.port) set("controller.port", std::to_string(*a.port));
  if (!a.q0.empty()) set("drive.q0", a.q0);
  run.set.insert(run.set.end(), a.set.begin(), a.set.end());
  if (!a.quiet) {
    std::cout << "robot " << robot << " with FRI " << protocol << " at " << address
              << (a.port ? ":" + std::to_string(*a.port) : "") << ", client expected at "
              << (client.find(':') == std::string::npos ? client + ":" + default_port : client) << ", a message every "
              << text::to_text(a.period) << " ms; " << duration_of(a) << std::endl;
  }
  return run_scenario(run);
}

}  // namespace

void add_robot(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<RobotArguments>();
  RobotArguments& a = *all;
  CLI::App* command = app.add_subcommand(
      "robot", "Emulate a robot with its controller, for clients of its interface (docs/fri.md, docs/rtde.md)");
  command
      ->add_option("--fri", a.fri,
                   "KUKA's FRI: lwr (LWR 4+, FRI 1.0), sunrise (1.15), or sunrise-1.11, -1.14, -1.16, -2.5, -2.7")
      ->type_name("PROTOCOL");
  command->add_flag("--rtde", a.rtde,
                    "Universal Robots' RTDE instead of FRI, for robots with 6 joints (ur3e, ur5e, ur10, ur10e, ur16e, ur20)");
  command->add_flag("--rtde-script", a.script,
                    "Print the program for a real Universal Robots controller that follows commands over RTDE, and exit");
  command->add_option("--robot", a.robot, "URDF, or name of a robot in models/robots (default: lwr4, with --rtde ur5e)")
      ->type_name("URDF");
  command->add_option("--frequency", a.frequency, "RTDE: control cycles in Hz: 500 (e-Series) or 125 (CB3)")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000))
      ->type_name("HZ");
  command->add_option("--period", a.period, "FRI: send period in milliseconds, 1 to 100")
      ->capture_default_str()
      ->type_name("MS");
  command
      ->add_option("--client", a.client,
                   "IPv4 address of the client, perhaps with :port (default: 127.0.0.1, port 49938 or 30200)")
      ->type_name("ADDRESS");
  command
      ->add_option(
          "--address", a.address,
          "IPv4 address that the controller sends from, or listens at (default: 127.0.0.1, reached from this machine only)")
      ->type_name("ADDRESS");
  command
      ->add_option(
          "--port", a.port,
          "UDP port that the controller sends from (default: any for lwr and at 127.x.x.x, else 30200), or TCP port that "
          "it listens at (30004)")
      ->check(CLI::Range(0, 65535))
      ->type_name("PORT");
  command
      ->add_option("--mode", a.mode, "Sunrise: what the client has to command: position, torque, wrench, or (2.5 and 2.7) pose")
      ->capture_default_str()
      ->type_name("MODE");
  command
      ->add_option(
          "--q0", a.q0,
          "Joint positions at the start in rad, e.g. '0 0.3 0 -1.2 0 0.9 0' (default: 0, RTDE: 0 -1.57 1.57 -1.57 -1.57 0)")
      ->type_name("LIST");
  command->add_flag("--once", a.once,
                    "After an end of commanding for a reason (lost commands, limits …), do not begin it again");
  command->add_option("--seconds", a.seconds, "Duration (default: until Ctrl-C)")
      ->check(CLI::PositiveNumber)
      ->check(kNumber)
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
  for (const char* of_fri : {"--client", "--mode", "--period", "--once"}) command->get_option(of_fri)->excludes("--rtde");
  command->get_option("--frequency")->excludes("--fri");
  command->callback([all, &chosen] { chosen = [all] { return emulate(*all); }; });
}

}  // namespace cotwin::master
