#include "models/identification/stiffness.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/identification/problem.h"
#include "models/trajectory/series/series.h"

namespace cotwin::identification {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

/// τ_J and its first two derivatives at the samples, from the bodies of a model.
struct JointTorques {
  std::vector<double> tau, dtau, ddtau;
};

JointTorques joint_torques(const robot::RobotModel& robot, Estimate estimate, const Samples& samples) {
  for (JointDrive& drive : estimate.drive) {
    const std::vector<double> harmonics = drive.harmonics;
    drive = {};
    drive.harmonics = harmonics;  // springs stand beside the links, not before the gears
  }
  trajectory::Series series;
  series.t = samples.t;
  series.width = samples.joints;
  series.x = torques(robot, estimate, samples);
  const trajectory::Series first = trajectory::differentiate(series);
  return {series.x, first.x, trajectory::differentiate(first).x};
}

Samples bent(const Samples& motors, const JointTorques& torque, const VectorXd& compliance) {
  Samples links = motors;
  links.dtheta = motors.dq;
  links.ddtheta = motors.ddq;
  for (std::size_t i = 0; i < links.q.size(); ++i) {
    const double c = compliance[static_cast<Index>(i % motors.joints)];
    links.q[i] -= c * torque.tau[i];
    links.dq[i] -= c * torque.dtau[i];
    links.ddq[i] -= c * torque.ddtau[i];
  }
  return links;
}

}  // namespace

StiffnessResult search_stiffness(const robot::RobotModel& robot, const Samples& motors, const ModelOptions& model,
                                 const StiffnessOptions& options, numerics::Threads* threads) {
  const auto n = static_cast<std::size_t>(robot.n());
  if (motors.t.size() != motors.count() || motors.joints != n)
    throw Error("samples", "of " + std::to_string(motors.joints) + " joints with " + std::to_string(motors.t.size()) +
                               " instants, expected " + std::to_string(n) + " and one per sample");
  if (!(0 < options.K_min && options.K_min < options.K_max))
    throw Error("stiffness", "between " + text::to_text(options.K_min) + " and " + text::to_text(options.K_max) +
                                 " N.m/rad, expected above 0 and ascending");
  const TorqueData empty(robot, model);
  const auto problem_of = [&](const Samples& samples, const VectorXd& sigma) {
    TorqueData data = empty;
    data.add(samples);
    ProblemOptions weights;
    weights.sigma = sigma;
    return Problem(data, robot, weights);
  };
  const Problem rigid = problem_of(motors, {});
  StiffnessResult result;
  result.rigid_rms = rigid.floor().rms;
  result.rigid_cost = rigid.floor().cost;
  result.samples = motors;
  Estimate bodies = rigid.floor_estimate();
  const double low = std::log(options.K_min), high = std::log(options.K_max);
  std::vector<double> centre(n, 0.5 * (low + high));  // ln K
  const auto compliance_of = [](const double* x, std::size_t stride, std::size_t count) {
    VectorXd c(static_cast<Index>(count));
    for (std::size_t j = 0; j < count; ++j) c[static_cast<Index>(j)] = std::exp(-x[j * stride]);
    return c;
  };
  for (int pass = 0; pass <= options.refinements; ++pass) {
    const JointTorques torque = joint_torques(robot, bodies, result.samples);
    const auto cost = [&](std::size_t, std::size_t count, const double* x, std::size_t stride, double* costs) {
      for (std::size_t k = 0; k < count; ++k)
        costs[k] = problem_of(bent(motors, torque, compliance_of(x + k, stride, n)), rigid.sigma()).floor().cost;
    };
    numerics::Swarm swarm(std::vector<double>(n, low), std::vector<double>(n, high), centre,
                          std::vector<double>(n, pass == 0 ? 0.3 * (high - low) : 0.2), cost, options.swarm);
    swarm.run(threads);
    swarm.best(centre);
    const VectorXd compliance = compliance_of(centre.data(), 1, n);
    result.K = compliance.cwiseInverse();
    result.samples = bent(motors, torque, compliance);
    const Problem found = problem_of(result.samples, rigid.sigma());
    result.cost = found.floor().cost;
    result.rms = found.floor().rms;
    bodies = found.floor_estimate();
  }
  return result;
}

void TorsionFit::add(double tau_J, double dq, double torsion) {
  Eigen::Vector3d z(tau_J, dq, torsion);
  if (count_ == 0) origin_ = z;
  z -= origin_;
  count_ += 1;
  sum_ += z;
  products_ += z * z.transpose();
}

Torsion TorsionFit::solve(double independent) const {
  Torsion result;
  if (count_ < 4) return result;
  const Eigen::Vector3d mean = sum_ / count_;
  const Eigen::Matrix3d S = products_ / count_ - mean * mean.transpose();  // covariances of τ_J, q̇ and θ − q
  // What the speed explains is taken out of torque and torsion first (Frisch, Waugh 1933).
  const bool moves = S(1, 1) > 0;
  const double torque_by_speed = moves ? S(0, 1) / S(1, 1) : 0, torsion_by_speed = moves ? S(2, 1) / S(1, 1) : 0;
  const double torque = S(0, 0) - torque_by_speed * S(0, 1), torsion = S(2, 2) - torsion_by_speed * S(2, 1),
               both = S(0, 2) - torque_by_speed * S(1, 2);
  constexpr double kRounding = 1e-12;  // of the variances, that is left of what the speed explains wholly
  if (!(torque > kRounding * S(0, 0) && torsion > kRounding * S(2, 2))) return result;
  const double compliance = both / torque;
  result.correlation = both / std::sqrt(torque * torsion);
  result.lag = torsion_by_speed - compliance * torque_by_speed;
  const Eigen::Vector3d centre = mean + origin_;
  result.offset = centre[2] - compliance * centre[0] - result.lag * centre[1];
  const double rest = std::max(0.0, torsion - compliance * both);
  const double deviation = std::sqrt(rest / torque / std::max(1.0, independent - 3));
  constexpr double kKnown = 0.3, kExplained = 0.5;
  if (!(compliance > 0) || deviation > kKnown * compliance || result.correlation * result.correlation < kExplained)
    return result;
  result.K = 1 / compliance;
  result.deviation = deviation / (compliance * compliance);
  return result;
}

}  // namespace cotwin::identification
