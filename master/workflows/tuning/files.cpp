#include "master/workflows/tuning/files.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <system_error>

#include "components/unit/joint_variables.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/identification/torque_data/motor_inertia.h"
#include "models/robot/drives/drive_parameters.h"
#include "models/robot/drives/friction.h"
#include "models/robot/urdf/urdf_update.h"

namespace cotwin::master::tuning {

namespace fs = std::filesystem;

namespace {

using identification::FrictionLaw;

class Parameters {
 public:
  Parameters(ParameterSet& set, const robot::RobotModel& robot) : set_(set), measures_(&robot) {}
  void add(const char* name, std::size_t joint, double value) {
    const std::string si = measures_.si(robot::drive_parameter(name).si, joint);
    set_.values.push_back({std::string(name) + "[" + std::to_string(joint + 1) + "]", value, si, ""});
  }

 private:
  ParameterSet& set_;
  JointMeasures measures_;
};

/// Friction behind the gear: the smooth laws of the link.
void add_link(Parameters& set, std::size_t j, const identification::JointDrive& drive, FrictionLaw law) {
  if (law == FrictionLaw::kSigmoid) {
    set.add("link_A", j, 2 * drive.tau_C);
    set.add("link_alpha", j, 2 / drive.v_R);
    set.add("link_s", j, drive.s);
    set.add("link_k", j, drive.tau_0 - drive.tau_C);
    return;
  }
  set.add("link_tau_C", j, drive.tau_C);
  set.add("link_v_R", j, drive.v_R);
  set.add("link_tau_0", j, drive.tau_0);
  if (law != FrictionLaw::kStribeck) return;
  set.add("link_tau_S", j, drive.tau_S);
  set.add("link_v_S", j, drive.v_S);
  set.add("link_delta", j, drive.delta);
}

/// Torques beside friction over the speed: friction that grows with the load, springs.
void add_rest(Parameters& set, std::size_t j, const identification::JointDrive& drive,
              const identification::ModelOptions& model) {
  if (model.load) {
    set.add("link_load", j, drive.load);
    set.add("link_v_load", j, drive.v_load);
  }
  for (std::size_t k = 0; 2 * k + 1 < drive.harmonics.size(); ++k) {
    set.add("spring_sin", robot::Harmonics::kMost * j + k, drive.harmonics[2 * k]);
    set.add("spring_cos", robot::Harmonics::kMost * j + k, drive.harmonics[2 * k + 1]);
  }
}

/// Friction of the motor: Coulomb or Stribeck, by its static curve (friction=smooth) and with a bristle (the others).
void add_motor(Parameters& set, std::size_t j, const identification::JointDrive& drive) {
  constexpr double kDeflection = 1e-3;  // rad, of the sliding bristle
  const double breakaway = std::max(drive.tau_S, drive.tau_C);
  const double sigma0 = (drive.tau_C > 0 ? drive.tau_C : breakaway) / kDeflection;
  // Barabanov and Ortega: passive for σ1 ≤ σ2 τ_C / (τ_S − τ_C); and no more than critical for 1 kg·m².
  const double passive =
      breakaway > drive.tau_C ? drive.sigma2 * drive.tau_C / (breakaway - drive.tau_C) : 2 * std::sqrt(sigma0);
  set.add("tau_C", j, drive.tau_C);
  set.add("tau_S", j, breakaway);
  set.add("v_S", j, drive.v_S);
  set.add("delta", j, drive.delta);
  set.add("tau_0", j, drive.tau_0);
  set.add("v_R", j, drive.v_R);
  set.add("sigma0", j, sigma0);
  set.add("sigma1", j, std::min(passive, 2 * std::sqrt(sigma0)));
}

}  // namespace

ParameterSet drive_parameters(const std::string& name, const robot::RobotModel& robot, const identification::Estimate& estimate,
                              const Settings& settings, const std::vector<identification::Torsion>& torsion) {
  ParameterSet set;
  set.name = name;
  Parameters parameters(set, robot);
  const FrictionLaw law = settings.model.friction;
  const std::vector<double> least = identification::least_motor_inertia(robot);
  for (std::size_t j = 0; j < estimate.drive.size(); ++j) {
    const identification::JointDrive& drive = estimate.drive[j];
    const bool passive = robot.joints[j].passive, motor = settings.model.motor_inertia && !passive;
    if (!passive && j < torsion.size() && torsion[j].K > 0) parameters.add("K", j, torsion[j].K);
    if (motor) parameters.add("B", j, std::max(drive.B, least[j]));
    parameters.add(motor ? "sigma2" : "link_sigma2", j, drive.sigma2);
    if (motor && law != FrictionLaw::kSigmoid) {
      add_motor(parameters, j, drive);
    } else {
      add_link(parameters, j, drive, law);
    }
    add_rest(parameters, j, drive, settings.model);
  }
  return set;
}

robot::RobotModel tuned_robot(const robot::RobotModel& robot, const identification::Estimate& estimate,
                              const std::string& reason) {
  robot::RobotModel tuned = identification::with_bodies(robot, estimate, reason);
  for (std::size_t j = 0; j < tuned.joints.size(); ++j) {
    tuned.joints[j].damping = estimate.drive[j].sigma2;
    tuned.joints[j].friction = estimate.drive[j].tau_C;
  }
  return tuned;
}

std::string tuned_urdf(const std::filesystem::path& file, const robot::RobotModel& robot, const std::string& comment) {
  std::string text;
  for (const char c : comment) {  // no "--" within a comment, no '-' at its end
    if (c == '-' && !text.empty() && text.back() == '-') text += ' ';
    text += c;
  }
  std::string urdf = robot::updated_urdf(text::read_file(file, "a URDF"), file.string(), robot);
  const std::size_t head = urdf.starts_with("<?xml") ? urdf.find('\n') + 1 : 0;
  return urdf.insert(head, "<!-- " + text + " -->\n");
}

}  // namespace cotwin::master::tuning
