// cotwin fit-energy: logs with the power of an arm -> parameters of unit:energy, and how well they predict motions they have not seen.
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "components/unit/si.h"
#include "master/program/commands/commands.h"
#include "models/energetics/fitted_parameters.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin::master {
namespace {

namespace fs = std::filesystem;
using namespace energetics;

struct FitEnergyArguments {
  std::vector<fs::path> logs;
  fs::path out;
  std::string model = "motion", robot, json;
  std::vector<std::string> columns;
  std::optional<double> train_before;  // s
};

/// "dq=qd_actual_" …
PowerColumns columns_of(const std::vector<std::string>& given) {
  PowerColumns columns;
  const std::pair<const char*, std::string*> known[] = {{"t", &columns.t},
                                                        {"power", &columns.power},
                                                        {"voltage", &columns.voltage},
                                                        {"current", &columns.current},
                                                        {"q", &columns.q},
                                                        {"dq", &columns.dq},
                                                        {"ddq", &columns.ddq},
                                                        {"tau", &columns.tau},
                                                        {"i", &columns.i},
                                                        {"reference", &columns.reference}};
  for (const std::string& one : given) {
    const std::size_t equals = one.find('=');
    bool found = false;
    for (const auto& [name, column] : known) {
      if (equals == std::string::npos || one.substr(0, equals) != name) continue;
      *column = one.substr(equals + 1);
      found = true;
    }
    if (!found)
      throw Error("--column", "'" + one + "', expected t, power, voltage, current, q, dq, ddq, tau, i or reference and =NAME");
  }
  return columns;
}

const char* verdict_of(const PowerParameter& p) {
  switch (p.told) {
    case Told::kValue:
      return "";
    case Told::kAtZero:
      return "at its bound 0";
    case Told::kUnexcited:
      return "not told: the joint did not move";
    case Told::kDependent:
      break;
  }
  return "not told: its column depends on others";
}

std::string percent(double share) { return text::to_text(100 * share, 3) + " %"; }

std::string sentence_of(const std::string& what, const HeldOut& h) {
  return what + ": " + std::to_string(h.motions) + " motions, power RMSE " + text::to_text(h.rmse, 3) +
         " W, energy of a motion wrong by " + percent(h.median) + " (median), at most " + percent(h.largest) +
         "; all errors together " + percent(h.motion_part) + " of the energy above that at rest";
}

nlohmann::ordered_json json_of(const HeldOut& h) {
  return {
      {"motions", h.motions}, {"rmse_W", h.rmse}, {"median", h.median}, {"largest", h.largest}, {"motion_part", h.motion_part}};
}

int fit(const FitEnergyArguments& a) {
  const PowerModel model = parse_power_model("--model", a.model);
  std::optional<robot::RobotModel> robot;
  if (!a.robot.empty()) robot = robot::load_urdf(urdf_of(a.robot));
  const PowerLog log = read_power_logs(a.logs, columns_of(a.columns), robot ? &*robot : nullptr);
  for (const std::string& warning : log.warnings) std::cerr << "cotwin: warning: " << warning << '\n';
  const PowerFit fitted = fit_power(log, model);
  const HeldOut each = leave_one_out(log, model);
  std::optional<HeldOut> later;
  if (a.train_before) later = train_before(log, model, *a.train_before);

  if (a.json != "-") {
    std::cout << log.place() << ": ";
    if (log.recordings > 1) std::cout << log.recordings << " recordings, ";
    std::cout << log.t.size() << " samples, " << log.joints() << " joints, " << motions_of(log).size() << " motions, at rest "
              << text::to_text(log.power_at_rest(), 4) << " W\nmodel " << name_of(model) << ", RMSE "
              << text::to_text(fitted.rmse, 3) << " W\n";
    for (const PowerParameter& p : fitted.parameters) {
      const std::string verdict = verdict_of(p);
      std::cout << "  " << p.name << " = " << text::to_text(p.value, 5) << (p.si == "1" ? "" : ' ' + p.si);
      std::cout << (verdict.empty() ? " +- " + text::to_text(p.error, 2) : ", " + verdict) << '\n';
    }
    std::cout << sentence_of("each motion left out once", each) << '\n';
    if (later) std::cout << sentence_of("trained before " + text::to_text(*a.train_before) + " s", *later) << '\n';
  }
  if (!a.json.empty()) {
    nlohmann::ordered_json j{{"log", log.place()},
                             {"recordings", log.recordings},
                             {"model", name_of(model)},
                             {"samples", fitted.samples},
                             {"rmse_W", fitted.rmse}};
    for (const PowerParameter& p : fitted.parameters) {
      const bool told = p.told == Told::kValue || p.told == Told::kAtZero;
      j["parameters"][p.name] = {{"value", p.value}, {"error", p.error}, {"unit", p.si}, {"told", told}};
    }
    j["leave_one_out"] = json_of(each);
    if (later) j["train_before"] = json_of(*later);
    if (a.json == "-") {
      std::cout << j.dump(2) << '\n';
    } else {
      write_file(a.json, j.dump(2) + "\n");
    }
  }
  if (a.out.empty()) return kExitDone;
  const bool with_gain = model != PowerModel::kConstant && model != PowerModel::kCurrent;
  ParameterSet set = fitted_parameters(with_gain ? fit_power(log, model, {}, {.gain_is_one = true}) : fitted, log);
  si::define_units(set);
  std::ostringstream xml;
  write_parameter_set(xml, set);
  write_file(a.out, xml.str());
  if (a.json != "-") std::cout << a.out.string() << '\n';
  return kExitDone;
}

}  // namespace

void add_fit_energy(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<FitEnergyArguments>();
  CLI::App* command = app.add_subcommand(
      "fit-energy", "Fit the losses of a robot's drives to a log with its power, and test them on motions that are left out");
  command
      ->add_option("LOG", all->logs,
                   "Logs (CSV): time, power or voltage and current, speeds, torques or currents of the joints; several are\n"
                   "recordings of the same robot, as are parts of one file in which the time begins anew")
      ->type_name("FILE")
      ->required();
  command
      ->add_option("--model", all->model,
                   "constant, work, speed, motion (friction of each joint), heat (the same with copper losses by torques),\n"
                   "current (measured motor currents)")
      ->type_name("MODEL")
      ->capture_default_str();
  command->add_option("--robot", all->robot, "URDF, or the name of a robot: its inverse dynamics, where the log has no torques")
      ->type_name("ROBOT");
  command
      ->add_option("--column", all->columns,
                   "Name of a column, of joints without the number, e.g. dq=actual_qd_; t, power, voltage, current, q, dq,\n"
                   "ddq, tau, i, reference (speeds that tell when the robot moves); may be repeated")
      ->type_name("KEY=NAME")
      ->allow_extra_args(false);
  command
      ->add_option("--train-before", all->train_before,
                   "Also fit to samples before this time (of each recording) and test on later motions")
      ->check(kNumber)
      ->type_name("SECONDS");
  command
      ->add_option("-o,--out", all->out, "Write the parameters of unit:energy (SSV), e.g. energy.ssv beside the robot's URDF")
      ->type_name("FILE");
  command->add_option("--json", all->json, "Write the result as JSON, to stdout with -")->type_name("FILE|-");
  command->footer("Values: s, W or V and A, rad, rad/s, N.m, A. Powers at rest should be part of the log.");
  command->callback([all, &chosen] { chosen = [all] { return fit(*all); }; });
}

}  // namespace cotwin::master
