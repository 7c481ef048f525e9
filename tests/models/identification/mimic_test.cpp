// Identification of robots with mimic and passive joints.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "models/foundation/support/error.h"
#include "models/identification/identification.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/identification/samples.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::identification::mimic_test {
namespace {

using namespace testing;
using cotwin::testing::error_of;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::HasSubstr;

robot::RobotModel finger(const robot::UrdfOptions& options = {}) {
  return robot::load_urdf(places::source() + "/tests/components/data/finger.urdf", options);
}

ModelOptions options_with(bool motor_inertia) {
  ModelOptions options;
  options.friction = FrictionLaw::kCoulomb;
  options.motor_inertia = motor_inertia;
  return options;
}

ProblemOptions little_prior() {
  ProblemOptions options;
  options.prior_weight = 1e-6;
  return options;
}

TEST(IdentificationMimic, BaseParametersReproduceTheTorquesOfTheIndependentJoints) {
  const robot::RobotModel robot = finger();
  const BaseParameters base = base_parameters(robot);
  EXPECT_EQ(base.G.cols(), 40);
  const robot::Mechanism mechanism(robot);
  robot::Data scratch(mechanism);
  VectorXd pi(40), tau(2);
  for (int b = 0; b < 4; ++b) pi.segment<10>(10 * b) = robot.bodies[static_cast<std::size_t>(b)].inertia.parameters();
  const VectorXd beta = base.G * pi, q = Eigen::Vector2d(0.7, -0.4), dq = Eigen::Vector2d(1, -2), ddq = Eigen::Vector2d(-3, 5);
  MatrixXd Y(2, 40);
  robot::regressor(mechanism, scratch, q, dq, ddq, Y);
  robot::inverse_dynamics(mechanism, scratch, q, dq, ddq, tau);
  VectorXd found = VectorXd::Zero(2);
  for (std::size_t i = 0; i < base.columns.size(); ++i) found += Y.col(base.columns[i]) * beta[static_cast<Index>(i)];
  EXPECT_LT((found - tau).norm(), 1e-10);
}

TEST(IdentificationMimic, FindsThePhysicalRobotBehindTheTorques) {
  const robot::RobotModel robot = finger();
  const Estimate truth = truth_of(robot);
  const Samples samples = simulate(robot, truth, 2000, 1e-3);
  TorqueData data(perturbed(robot, 0.2), options_with(true));
  add(data, samples);
  const Problem problem(data, perturbed(robot, 0.2), little_prior());
  const FeasibleResult found = solve_feasible(problem);
  for (std::size_t b = 0; b < 4; ++b) EXPECT_EQ(with_bodies(robot, found.estimate, "").bodies[b].inertia.unphysical(), "");
  const Samples other = simulate(robot, truth, 500, 0, 3);
  const Discrepancy error = discrepancy(other, torques(robot, found.estimate, other));
  EXPECT_LT(error.rms.maxCoeff(), 1e-3);  // the noise of one sample
  EXPECT_NEAR(found.estimate.drive[1].B, truth.drive[1].B, 0.02 * truth.drive[1].B);
}

/// Samples in which the passive joint accelerates as gravity, the other joints and its friction make it.
Samples passive_samples(const robot::RobotModel& robot, const Estimate& truth, int passive, double noise) {
  Samples samples = simulate(robot, truth, 2000, 0);
  const robot::Mechanism mechanism(robot);
  robot::Data scratch(mechanism);
  const Index n = robot.n();
  MatrixXd M(n, n);
  for (std::size_t s = 0; s < samples.count(); ++s) {
    const std::size_t row = s * static_cast<std::size_t>(n);
    robot::mass_matrix(mechanism, scratch, Eigen::Map<const VectorXd>(&samples.q[row], n), M);
    const std::size_t at = row + static_cast<std::size_t>(passive);
    samples.ddq[at] -= samples.tau[at] / (M(passive, passive) + truth.drive[static_cast<std::size_t>(passive)].B);
  }
  samples.tau = torques(robot, truth, samples);
  for (std::size_t i = 0; i < samples.tau.size(); ++i) {
    const bool free = static_cast<int>(i % static_cast<std::size_t>(n)) == passive;
    EXPECT_NEAR(free ? samples.tau[i] : 0, 0, 1e-9);
    // What a sensor there would show has no effect.
    samples.tau[i] = free ? 3.0 : samples.tau[i] + noise * numerics::normal({12, 0, 0, 0, static_cast<std::uint32_t>(i)});
  }
  return samples;
}

TEST(IdentificationPassive, UsesThatNoTorqueActsThere) {
  robot::UrdfOptions options;
  options.passive = {"knuckle"};
  const robot::RobotModel robot = finger(options);
  Estimate truth = truth_of(robot, false);
  truth.drive[1] = {};
  truth.drive[1].tau_C = truth.drive[1].tau_S = 0.02;
  truth.drive[1].sigma2 = 0.01;
  const Samples samples = passive_samples(robot, truth, 1, 1e-3);
  TorqueData data(perturbed(robot, 0.2), options_with(true));
  add(data, samples);
  EXPECT_EQ(data.columns(1).motor_inertia, -1);
  const Problem problem(data, perturbed(robot, 0.2), little_prior());
  const Estimate found = solve_feasible(problem).estimate;
  EXPECT_EQ(found.drive[1].B, 0);
  EXPECT_NEAR(found.drive[1].tau_C, 0.02, 0.002);
  EXPECT_NEAR(found.drive[1].sigma2, 0.01, 0.001);
  // The torques of the same bodies with a motor at the passive joint, on another motion.
  truth.drive[0] = {};
  truth.drive[1] = {};
  Estimate bodies = found;
  for (JointDrive& drive : bodies.drive) drive = {};
  const Samples other = simulate(robot, truth, 500, 0, 3);
  const Discrepancy error = discrepancy(other, torques(robot, bodies, other));
  double largest = 0;
  for (std::size_t i = 1; i < other.tau.size(); i += 2) largest = std::max(largest, std::abs(other.tau[i]));
  EXPECT_LT(error.rms[1], 0.01 * largest);
}

// Without friction zero solves its equation to rounding: a weight from that would let bodies vanish.
TEST(IdentificationPassive, HasTheRelativeErrorOfTheOthersAtLeast) {
  robot::UrdfOptions options;
  options.passive = {"knuckle"};
  const robot::RobotModel robot = finger(options);
  Estimate truth = truth_of(robot, false);
  truth.drive[1] = {};
  for (const double noise : {1e-3, 1e-2}) {
    TorqueData data(robot, options_with(true));
    add(data, passive_samples(robot, truth, 1, noise));
    const Problem problem(data, robot, {});
    const auto found = solve_feasible(problem);
    EXPECT_GT(problem.sigma()[1], 0.01 * noise) << noise;
    EXPECT_LT(found.weighted_rms, 1.1) << noise;
    EXPECT_TRUE(problem.active_bounds(found.xi).empty()) << noise;
  }
}

TEST(IdentificationPassive, NeedsAMeasuredTorqueSomewhere) {
  robot::UrdfOptions options;
  options.passive = {"knuckle", "shoulder"};
  const robot::RobotModel robot = finger(options);
  TorqueData data(robot, options_with(false));
  add(data, simulate(robot, truth_of(robot), 500, 0));
  EXPECT_THAT(error_of([&] { Problem(data, robot); }), HasSubstr("all joints that moved are passive"));
}

}  // namespace
}  // namespace cotwin::identification::mimic_test
