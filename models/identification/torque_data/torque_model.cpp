#include "models/identification/torque_data/torque_model.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/robot/changes/attachment.h"

namespace cotwin::identification {

using Eigen::VectorXd;

const char* to_text(FrictionLaw law) {
  switch (law) {
    case FrictionLaw::kNone:
      return "none";
    case FrictionLaw::kCoulomb:
      return "coulomb";
    case FrictionLaw::kSigmoid:
      return "sigmoid";
    case FrictionLaw::kStribeck:
      return "stribeck";
  }
  return "";
}

FrictionLaw friction_law(const std::string& text) {
  for (const FrictionLaw law : {FrictionLaw::kNone, FrictionLaw::kCoulomb, FrictionLaw::kSigmoid, FrictionLaw::kStribeck})
    if (text == to_text(law)) return law;
  throw Error("friction", "'" + text + "', expected none, coulomb, sigmoid or stribeck");
}

double JointDrive::friction(double v) const {
  const double height = tau_C + (tau_S - tau_C) * std::exp(-std::pow(std::abs(v / v_S), delta));
  return height * std::tanh((v + s) / v_R) + sigma2 * v + tau_0;
}

double JointDrive::torque(double q, double dtheta, double ddtheta, double gravity) const {
  double tau = B * ddtheta + friction(dtheta) + load * std::abs(gravity) * std::tanh(dtheta / v_load);
  for (std::size_t k = 0; 2 * k + 1 < harmonics.size(); ++k) {
    const double angle = static_cast<double>(k + 1) * q;
    tau += harmonics[2 * k] * std::sin(angle) + harmonics[2 * k + 1] * std::cos(angle);
  }
  return tau;
}

Estimate estimate_of(const robot::RobotModel& robot, bool urdf_friction) {
  Estimate estimate;
  estimate.pi.resize(10 * robot.body_count());
  estimate.drive.resize(static_cast<std::size_t>(robot.n()));
  for (int i = 0; i < robot.body_count(); ++i)
    estimate.pi.segment<10>(10 * i) = robot.bodies[static_cast<std::size_t>(i)].inertia.parameters();
  for (std::size_t k = 0; k < robot.joints.size() && urdf_friction; ++k) {
    estimate.drive[k].sigma2 = robot.joints[k].damping;
    estimate.drive[k].tau_C = estimate.drive[k].tau_S = robot.joints[k].friction;
  }
  return estimate;
}

robot::RobotModel with_bodies(const robot::RobotModel& robot, const Estimate& estimate, const std::string& reason) {
  if (estimate.pi.size() != 10 * robot.body_count())
    throw Error("estimate", "has " + std::to_string(estimate.pi.size()) + " inertial parameters, expected " +
                                std::to_string(10 * robot.body_count()));
  robot::RobotModel result = robot;
  for (int i = 0; i < robot.body_count(); ++i)
    robot::set_inertia(result, i, Inertia::from_parameters(estimate.pi.segment<10>(10 * i)), reason);
  return result;
}

std::vector<double> torques(const robot::RobotModel& robot, const Estimate& estimate, const Samples& samples) {
  const std::size_t n = samples.joints, count = samples.count();
  robot::RobotModel model = robot;
  for (int i = 0; i < robot.body_count(); ++i)
    model.bodies[static_cast<std::size_t>(i)].inertia = Inertia::from_parameters(estimate.pi.segment<10>(10 * i));
  const robot::Mechanism mechanism(model);
  robot::Data scratch(mechanism);
  // by joint, the layout of the batch kernel
  std::vector<double> by_joint[3], result(n * count), tau(n * count);
  const std::vector<double>* const from[3] = {&samples.q, &samples.dq, &samples.ddq};
  for (int k = 0; k < 3; ++k) {
    by_joint[k].resize(n * count);
    for (std::size_t s = 0; s < count; ++s)
      for (std::size_t j = 0; j < n; ++j) by_joint[k][j * count + s] = (*from[k])[s * n + j];
  }
  robot::inverse_dynamics_batch(mechanism, scratch, count, by_joint[0].data(), by_joint[1].data(), by_joint[2].data(),
                                tau.data());
  std::vector<double> gravity(n * count);
  if (std::any_of(estimate.drive.begin(), estimate.drive.end(), [](const JointDrive& drive) { return drive.load != 0; })) {
    const robot::Mechanism prior(robot);
    robot::Data prior_scratch(prior);
    const std::vector<double> rest(n * count);
    robot::inverse_dynamics_batch(prior, prior_scratch, count, by_joint[0].data(), rest.data(), rest.data(), gravity.data());
  }
  const std::vector<double>& dtheta = samples.dtheta.empty() ? samples.dq : samples.dtheta;
  const std::vector<double>& ddtheta = samples.ddtheta.empty() ? samples.ddq : samples.ddtheta;
  for (std::size_t s = 0; s < count; ++s)
    for (std::size_t j = 0; j < n; ++j) {
      const std::size_t at = s * n + j;
      result[at] =
          tau[j * count + s] + estimate.drive[j].torque(samples.q[at], dtheta[at], ddtheta[at], gravity[j * count + s]);
    }
  return result;
}

}  // namespace cotwin::identification
