// One step of Cartesian compliance with self-motion and tracking of a flexible arm with 7 joints, in processor time of the thread,
// beside the same law on the functions of Orocos KDL. Pinocchio is not in Debian 12.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <string>

#include "components/unit/unit_table.h"
#include "models/foundation/support/error.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/benchmarks/compliance_peer.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using Eigen::VectorXd;

constexpr int kStates = 64;  // wrenches in turn

class Subject {
 public:
  explicit Subject(const std::string& query)
      : instance_(make_unit("unit:compliance?" + query, {{"robot", "lwr4"}},
                            {std::filesystem::path(places::source()) / "models"}, unit_types())) {}
  Eigen::Map<VectorXd> operator[](const char* name) {
    const std::span<double> reals = instance_.variables.at(name).reals();
    return {reals.data(), static_cast<Eigen::Index>(reals.size())};
  }
  Unit& unit() { return *instance_.unit; }

 private:
  Instance instance_;
};

void design(Subject& subject, const benchmark::ComplianceDesign& d, const VectorXd& q, const Pose& X) {
  const auto set = [&](const char* name, double value) { subject[name].setConstant(value); };
  for (const char* friction : {"tau_C", "tau_S", "sigma0", "sigma1", "sigma2", "tau_max", "tau_wind_up"}) set(friction, 0);
  set("M_T", d.M_T);
  set("S_T", d.S_T);
  set("M_R", d.M_R);
  set("K_o", d.K_o);
  set("omega", d.omega);
  set("zeta", d.zeta);
  set("shaping", d.shaping);
  set("elastic_bandwidth", d.bandwidth);
  set("K", d.K);
  set("B", d.B);
  set("omega_k", d.omega_k);
  set("k_nu", d.k_nu);
  const Eigen::Quaterniond Q(X.R);
  subject["p_d"] = X.p;
  subject["quat_d"] = Eigen::Vector4d(Q.w(), Q.x(), Q.y(), Q.z());
  subject["q"] = subject["theta"] = q;
  subject.unit().initialise({});
}

}  // namespace

int main() try {
  const std::string file = places::source() + "/models/robots/lwr4/robot.urdf";
  const robot::RobotModel model = robot::load_urdf(file);
  const VectorXd q = (VectorXd(7) << 0.2, 0.6, -0.3, -1.2, 0.4, 0.9, 0.1).finished();
  const robot::Mechanism mechanism(model);
  robot::Data data(mechanism);
  const Pose X = robot::forward_kinematics(mechanism, data, q, robot::on_body(model.end_effector()));
  const benchmark::ComplianceDesign d;
  const auto peer = benchmark::make_kdl_compliance(model, d);
  Subject ours("space=cartesian");
  design(ours, d, q, X);
  peer->start(q);
  const auto wrench = [](std::size_t k) {
    const double t = static_cast<double>(k) / kStates * 2 * std::acos(-1.0);
    Eigen::Matrix<double, 6, 1> F;
    F << 20 * std::sin(t), 10 * std::cos(t), 15, 2 * std::cos(t), 2, 3 * std::sin(t);
    return F;
  };
  std::size_t k = 0, k_peer = 0;
  const auto step = [&](Subject& subject) {
    const auto F = wrench(k++);
    subject["f_e"] = F.head<3>();
    subject["m_e"] = F.tail<3>();
    if (subject.unit().step({}, Duration{1'000'000}) != StepResult::kDone) throw Error("compliance", "the step was not done");
  };
  const auto step_peer = [&] {
    peer->step(wrench(k_peer++), q, q);
    benchmark::keep(*peer);
  };
  // The same law, except for the integrator of rotation and the terms with the rates of M and N in the self-motion, which KDL has
  // no function for.
  for (int i = 0; i < 100; ++i) {
    step(ours);
    step_peer();
    const double motion = (ours["q_c"] - peer->q_c).norm(), torque = (ours["tau_m"] - peer->tau_m).norm();
    if (motion < 1e-4 && torque < 1e-2 * peer->tau_m.norm()) continue;
    throw Error(file, "after " + std::to_string(i + 1) + " steps KDL's motion differs from ours by " + std::to_string(motion) +
                          " rad, its torque by " + std::to_string(torque) + " N.m");
  }
  const auto row = [&](const char* name, Subject& subject, double ratio, double most) {
    const auto figures = benchmark::measure([&] { step(subject); }, step_peer, 31, 2e-3, benchmark::thread_seconds);
    benchmark::print({name, "us", 1e6 * figures.ours, "the same law on KDL", 1e6 * figures.peer, ratio, true});
    if (most > 0)
      benchmark::print({std::string(name) + ", absolute", "us", 1e6 * figures.ours, "KDL", 1e6 * figures.peer, most, false});
  };
  row("Cartesian compliance with self-motion, 7 elastic joints, one step", ours, 0.5, 4);
  Subject impedance("space=cartesian&render=impedance");
  design(impedance, d, q, X);
  row("the same with render=impedance", impedance, 0, 0);

  // The unit as example 02 has it, with its friction and elastic joints, that follows a swinging desired motion under external torques.
  Subject joints("space=joints");
  joints["q"] = joints["theta"] = joints["q_d"] = q;
  joints.unit().initialise({});
  std::size_t k_joints = 0;
  const auto step_joints = [&] {
    const double t = 1e-3 * static_cast<double>(k_joints++ % 10'000);
    joints["q_d"] = q + VectorXd::Constant(7, 0.1 * std::sin(t));
    joints["dq_d"].setConstant(0.1 * std::cos(t));
    joints["ddq_d"].setConstant(-0.1 * std::sin(t));
    joints["tau_e"].setConstant(2 * std::sin(7 * t));
    joints["q"] = joints["theta"] = joints["q_c"];
    joints["dq"] = joints["dtheta"] = joints["dq_c"];
    if (joints.unit().step({}, Duration{1'000'000}) != StepResult::kDone) throw Error("compliance", "the step was not done");
  };
  // Without a peer: KDL has no joint compliance, and the law on its functions above is another one.
  const auto figures = benchmark::measure(
      step_joints, [] {}, 31, 2e-3, benchmark::thread_seconds);
  benchmark::print({"compliance of 7 elastic joints with friction, one step", "us", 1e6 * figures.ours, "", 0, 1.2, false});
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "compliance: %s\n", error.what());
  return 1;
}
