#include "master/tuning/files.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <system_error>

#include "models/identification/motor_inertia.h"
#include "models/robot/urdf_update.h"
#include "models/text/error.h"

namespace cotwin::master::tuning {

namespace fs = std::filesystem;

AtomicFile::AtomicFile(fs::path place) : place_(std::move(place)) {
  beside_ = place_;
  beside_ += ".part" + std::to_string(::getpid());
  out_.open(beside_, std::ios::binary | std::ios::trunc);
  if (!out_) throw Error(place_.string(), "cannot be written");
}

AtomicFile::~AtomicFile() {
  if (done_) return;
  out_.close();
  std::error_code ignored;
  fs::remove(beside_, ignored);
}

void AtomicFile::commit() {
  out_.close();
  if (!out_) throw Error(place_.string(), "cannot be written");
  std::error_code error;
  fs::rename(beside_, place_, error);
  if (error) throw Error(place_.string(), "cannot be written: " + error.message());
  done_ = true;
}

void write_file(const fs::path& place, const std::string& content) {
  AtomicFile file(place);
  file.stream() << content;
  file.commit();
}

namespace {

using identification::FrictionLaw;

class Parameters {
 public:
  explicit Parameters(ParameterSet& set) : set_(set) {}
  void add(const char* name, std::size_t joint, double value, const char* unit) {
    set_.values.push_back({std::string(name) + "[" + std::to_string(joint + 1) + "]", value, unit, ""});
  }

 private:
  ParameterSet& set_;
};

/// Friction behind the gear: the smooth laws of the link.
void add_link(Parameters& set, std::size_t j, const identification::JointDrive& drive, FrictionLaw law) {
  if (law == FrictionLaw::kSigmoid) {
    set.add("link_A", j, 2 * drive.tau_C, "N.m");
    set.add("link_alpha", j, 2 / drive.v_R, "s/rad");
    set.add("link_s", j, drive.s, "rad/s");
    set.add("link_k", j, drive.tau_0 - drive.tau_C, "N.m");
  } else {
    set.add("link_tau_C", j, drive.tau_C, "N.m");
    set.add("link_v_R", j, drive.v_R, "rad/s");
    set.add("link_tau_0", j, drive.tau_0, "N.m");
  }
}

/// Behind the gear there is no Stribeck effect: the Coulomb and viscous friction that come nearest to the curve, up to the
/// joint's greatest speed and beyond where it changes its sign.
identification::JointDrive without_stribeck(identification::JointDrive drive, double speed) {
  constexpr int kPoints = 200;
  const double first = std::min(3 * drive.v_R, speed);  // tanh 3 = 0.995
  double cc = 0, cv = 0, vv = 0, ch = 0, vh = 0;
  for (int i = 0; i < kPoints; ++i) {
    const double v = first + (speed - first) * i / (kPoints - 1);
    const double c = std::tanh(v / drive.v_R), h = drive.friction(v) - drive.tau_0;
    cc += c * c;
    cv += c * v;
    vv += v * v;
    ch += c * h;
    vh += v * h;
  }
  const double determinant = cc * vv - cv * cv;
  drive.tau_C = determinant > 0 ? std::max(0.0, (vv * ch - cv * vh) / determinant) : drive.tau_C;
  drive.sigma2 = vv > 0 ? std::max(0.0, (vh - cv * drive.tau_C) / vv) : drive.sigma2;
  drive.tau_S = drive.tau_C;
  return drive;
}

/// Friction of the motor: Coulomb or Stribeck with a bristle.
void add_motor(Parameters& set, std::size_t j, const identification::JointDrive& drive) {
  constexpr double kDeflection = 1e-3;  // rad, of the sliding bristle
  const double breakaway = std::max(drive.tau_S, drive.tau_C);
  const double sigma0 = (drive.tau_C > 0 ? drive.tau_C : breakaway) / kDeflection;
  // Barabanov and Ortega: passive for σ1 ≤ σ2 τ_C / (τ_S − τ_C); and no more than critical for 1 kg·m².
  const double passive =
      breakaway > drive.tau_C ? drive.sigma2 * drive.tau_C / (breakaway - drive.tau_C) : 2 * std::sqrt(sigma0);
  set.add("tau_C", j, drive.tau_C, "N.m");
  set.add("tau_S", j, breakaway, "N.m");
  set.add("v_S", j, drive.v_S, "rad/s");
  set.add("delta", j, drive.delta, "1");
  set.add("tau_0", j, drive.tau_0, "N.m");
  set.add("sigma0", j, sigma0, "N.m/rad");
  set.add("sigma1", j, std::min(passive, 2 * std::sqrt(sigma0)), "N.m.s/rad");
}

}  // namespace

ParameterSet drive_parameters(const std::string& name, const robot::RobotModel& robot, const identification::Estimate& estimate,
                              const Settings& settings, const measurement::Survey& survey,
                              const std::vector<identification::Torsion>& torsion) {
  ParameterSet set;
  set.name = name;
  Parameters parameters(set);
  const FrictionLaw law = settings.model.friction;
  const bool motor = settings.model.motor_inertia;
  const std::vector<double> least = identification::least_motor_inertia(robot);
  for (std::size_t j = 0; j < estimate.drive.size(); ++j) {
    const bool flat = !motor && law == FrictionLaw::kStribeck;
    const identification::JointDrive drive =
        flat ? without_stribeck(estimate.drive[j], survey.joints[j].speed_max) : estimate.drive[j];
    if (j < torsion.size() && torsion[j].K > 0) parameters.add("K", j, torsion[j].K, "N.m/rad");
    if (motor) parameters.add("B", j, std::max(drive.B, least[j]), "kg.m2");
    parameters.add(motor ? "sigma2" : "link_sigma2", j, drive.sigma2, "N.m.s/rad");
    if (motor && law != FrictionLaw::kSigmoid) {
      add_motor(parameters, j, drive);
    } else {
      add_link(parameters, j, drive, law);
    }
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
  std::ifstream in(file, std::ios::binary);
  std::ostringstream xml;
  xml << in.rdbuf();
  if (!in) throw Error(file.string(), "cannot be read");
  std::string urdf = robot::updated_urdf(xml.str(), file.string(), robot);
  const std::size_t head = urdf.starts_with("<?xml") ? urdf.find('\n') + 1 : 0;
  return urdf.insert(head, "<!-- " + text + " -->\n");
}

}  // namespace cotwin::master::tuning
