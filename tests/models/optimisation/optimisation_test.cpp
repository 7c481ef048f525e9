// Polynomials with redundant coefficients against exact optima of ∫ q̈² (rational arithmetic, specification section 4).
#include "models/optimisation/search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "models/trajectory/bernstein.h"
#include "tests/models/optimisation/time_optimal_path.h"
#include "tests/support/places.h"

namespace cotwin::optimisation::optimisation_test {
namespace {

robot::RobotModel robot_named(const std::string& name) {
  return robot::load_urdf(places::source() + "/models/robots/" + name + "/robot.urdf");
}

/// One revolute joint about the vertical with inertia M, without gravity's effect.
robot::RobotModel flywheel(double M) {
  robot::RobotModel robot = robot_named("planar2");
  robot.joints.resize(1);
  robot.bodies.resize(1);
  robot.frames.erase(std::remove_if(robot.frames.begin(), robot.frames.end(), [](const robot::Frame& f) { return f.body > 0; }),
                     robot.frames.end());
  robot.gravity.setZero();
  Inertia inertia;
  inertia.mass = 1;

  inertia.I_CC = M * Eigen::Matrix3d::Identity();
  robot.bodies[0].inertia = inertia;
  robot.joints[0].dq_max = std::numeric_limits<double>::infinity();
  robot.joints[0].q_min = -std::numeric_limits<double>::infinity();
  robot.joints[0].q_max = robot.joints[0].tau_max = std::numeric_limits<double>::infinity();
  return robot;
}

Problem unit_move(const robot::RobotModel& robot, int degree, Quantity quantity) {
  Problem p;
  p.robot = robot;
  const std::size_t n = robot.joints.size();
  p.ends = {std::vector<double>(n, 0.0), std::vector<double>(n, 0.0), std::vector<double>(n, 0.0),
            std::vector<double>(n, 1.0), std::vector<double>(n, 0.0), std::vector<double>(n, 0.0)};
  p.degree = degree;
  p.bounds = bounds_of(robot);
  p.costs = {{quantity, 1, {}}};
  return p;
}

TEST(Optimisation, ReachesTheExactOptimaOfSquaredAcceleration) {
  const robot::RobotModel robot = flywheel(1);
  const std::pair<int, double> exact[] = {{5, 120.0 / 7},  {6, 120.0 / 7},   {7, 14.0},        {8, 14.0},
                                          {9, 144.0 / 11}, {11, 165.0 / 13}, {13, 312.0 / 25}, {15, 210.0 / 17}};
  SearchOptions options;
  options.particles = 40;
  options.rounds = 100;
  for (const auto& [degree, optimum] : exact) {
    const Solution solution = minimise(unit_move(robot, degree, Quantity::kAcceleration), options);
    EXPECT_EQ(solution.status, Status::kFeasible) << solution.reason;
    EXPECT_NEAR(solution.cost, optimum, 1e-6) << "degree " << degree;
    EXPECT_GE(solution.cost, optimum - 1e-10) << "degree " << degree;
  }
}

TEST(Optimisation, FindsTheSameOptimaWithoutNewtonsMethod) {
  SearchOptions options;
  options.refine = false;
  for (const auto& [degree, optimum] : {std::pair{7, 14.0}, std::pair{15, 210.0 / 17}})
    EXPECT_NEAR(minimise(unit_move(flywheel(1), degree, Quantity::kAcceleration), options).cost, optimum, 1e-6);
}

// Specification section 3: M = 2 kg m², constant load 5 N m, 1.5 rad: dE/dT = 0 at T⁴ = 3 (120/7) M² Δ²/g².
TEST(Optimisation, FindsTheDurationOfLeastSquaredTorqueUnderAConstantLoad) {
  Problem p = unit_move(flywheel(2), 5, Quantity::kTorque);
  p.ends.q_to = {1.5};
  p.drives.tau_0 = {5};
  p.T_min = 0.5;
  p.T_max = 10;
  SearchOptions options;
  options.particles = 40;
  options.rounds = 100;
  const Solution solution = minimise(p, options);
  EXPECT_NEAR(solution.T, std::pow(3 * (120.0 / 7) * 4 * 2.25 / 25, 0.25), 1e-4);
  EXPECT_NEAR(solution.cost, 69.1442, 1e-4);
}

TEST(Optimisation, IntegratesWorkAndJerkOfTheQuintic) {
  Problem p = unit_move(flywheel(3), 5, Quantity::kWork);
  p.ends.q_to = {1.2};
  p.T_min = p.T_max = 0.8;
  p.costs.push_back({Quantity::kSharedWork, 1, {}});
  p.costs.push_back({Quantity::kJerk, 1, {}});
  p.costs.push_back({Quantity::kPower, 1, [](std::size_t states, const double* tau, const double* dq, double* power) {
                       for (std::size_t i = 0; i < states; ++i) power[i] = std::max(tau[i] * dq[i], 0.0);
                     }});
  const Solution s = assess(p, {}, p.ends.q_to, p.T_min);
  const double work = 0.5 * 3 * std::pow(1.875 * 1.2 / 0.8, 2);  // the kinetic energy at the peak of the speed
  EXPECT_NEAR(s.costs[0], work, 1e-6 * work);                    // the quadrature crosses one kink
  EXPECT_NEAR(s.costs[1], work, 1e-6 * work);
  EXPECT_NEAR(s.costs[2], 720 * 1.2 * 1.2 / std::pow(0.8, 5), 1e-9 * s.costs[2]);
  EXPECT_EQ(s.costs[3], s.costs[0]);
}

Problem lwr_move(int degree, Quantity quantity) {
  Problem p;
  p.robot = robot_named("lwr4");
  const std::vector<double> zero(7, 0.0);
  p.ends = {{0, 0.5, 0, -1, 0, 0.6, 0}, zero, zero, {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}, zero, zero};
  p.T_min = p.T_max = 1.5;
  p.degree = degree;
  p.bounds = bounds_of(p.robot);
  p.costs = {{quantity, 1, {}}};
  return p;
}

SearchOptions few(int rounds = 100) {
  SearchOptions options;
  options.particles = 48;
  options.rounds = rounds;
  return options;
}

TEST(Optimisation, KeepsAllBoundsBetweenTheSamples) {
  for (const double jerk : {400.0, std::numeric_limits<double>::infinity()}) {
    Problem p = lwr_move(7, Quantity::kTorque);
    p.samples = 96;
    p.bounds.dddq.assign(7, jerk);
    const Solution s = minimise(p, few());
    ASSERT_EQ(s.status, Status::kFeasible) << s.reason;
    const robot::Mechanism mechanism(p.robot);
    robot::Data data(mechanism);
    std::vector<double> q(7), dq(7), ddq(7), dddq(7);
    Eigen::VectorXd tau(7);
    double integral = 0;
    constexpr int kSteps = 20000;
    for (int i = 0; i <= kSteps; ++i) {
      s.path.at(s.T * i / kSteps, q, dq, ddq, dddq);
      const Eigen::Map<const Eigen::VectorXd> Q(q.data(), 7), V(dq.data(), 7), A(ddq.data(), 7);
      robot::inverse_dynamics(mechanism, data, Q, V, A, tau);
      integral += (i == 0 || i == kSteps ? 0.5 : 1.0) * tau.squaredNorm() * s.T / kSteps;
      for (std::size_t j = 0; j < 7; ++j) {
        ASSERT_LE(std::abs(dq[j]), p.bounds.dq[j] * (1 + 1e-8));
        ASSERT_LE(std::abs(dddq[j]), jerk * (1 + 1e-8));
        ASSERT_LE(std::abs(tau[static_cast<Eigen::Index>(j)]), p.bounds.tau[j] * (1 + 1e-8));
        ASSERT_LE(q[j], p.bounds.q_max[j] + 1e-8);
        ASSERT_GE(q[j], p.bounds.q_min[j] - 1e-8);
      }
    }
    EXPECT_NEAR(s.cost, integral, 1e-6 * integral);  // trapezoidal rule of 20 000 steps
    EXPECT_NEAR(q[3], p.ends.q_to[3], 1e-12);
    Problem quintic = p;
    quintic.degree = 5;
    EXPECT_LT(s.cost, 0.85 * assess(quintic, {}, p.ends.q_to, p.T_min).cost);
  }
}

TEST(Optimisation, IsNeverFasterThanTheTimeOptimalMotionOnItsPath) {
  Problem p = lwr_move(9, Quantity::kTime);
  p.ends.q_to = {-1, 0.9, 0.2, -0.3, 0.4, -0.5, 1};
  p.T_min = 0.05;
  p.T_max = 5;
  const Solution s = minimise(p, few());
  ASSERT_EQ(s.status, Status::kFeasible) << s.reason;
  const double bound = testing::time_optimal(p.robot, s.path, p.bounds.dq, p.bounds.tau, 1000);
  EXPECT_GT(s.T, bound * (1 - 2e-3));  // the recursion's steps
  EXPECT_LT(s.T, bound * 1.2);
}

// An end at a limit of a joint takes no longer than one a little inside, whatever T_max, and a higher degree no longer than a lower
// one. Where a few particles find no motion that is fast enough, Newton's method does.
TEST(Optimisation, FindsTheFastestMotionToALimitOfAJointWhateverTheLongestDuration) {
  double slower = std::numeric_limits<double>::infinity();
  for (const int degree : {9, 11}) {
    Problem p = lwr_move(degree, Quantity::kTime);
    p.ends.q_to[3] = p.bounds.q_max[3] - 1e-6;
    p.T_min = 0.05;
    p.T_max = 6;
    const Solution inside = minimise(p, few());
    ASSERT_EQ(inside.status, Status::kFeasible) << inside.reason;
    EXPECT_LT(inside.T, slower);
    slower = inside.T;
    p.ends.q_to[3] = p.bounds.q_max[3];
    for (const double T_max : {1.005 * inside.T, 20.0}) {
      p.T_max = T_max;
      const Solution s = minimise(p, few());
      ASSERT_EQ(s.status, Status::kFeasible) << "degree " << degree << ", T_max " << T_max << ": " << s.reason;
      EXPECT_NEAR(s.T, inside.T, 1e-3 * inside.T) << "degree " << degree << ", T_max " << T_max;
    }
    p.costs = {{Quantity::kTorque, 1, {}}};
    p.T_min = p.T_max = 1.01 * inside.T;
    const Solution fixed = minimise(p, few());
    EXPECT_EQ(fixed.status, Status::kFeasible) << "degree " << degree << ": " << fixed.reason;
  }
}

// Gauss–Jacobi quadrature with the weight s² (1 − s)² and m nodes is exact for q̇ of degree d = 2 m + 3: Δ = ∫ q̇ dt ≤ T q̇_max Σ W_i,
// so that T q̇_max/Δ ≥ 1/Σ W_i, which is attained: 1.875, 1.377551, 1.220930, 1.147541, 1.106341, 1.080617, …, 1.042274 (degree 21).
TEST(Optimisation, ReachesTheShortestTimeThatASpeedBoundAllowsForEachDegree) {
  const std::pair<int, double> exact[] = {{5, 1.875},         {7, 1.3775510204},  {9, 1.2209302326},
                                          {11, 1.1475409836}, {15, 1.0806174957}, {21, 1.0422740525}};
  for (const auto& [degree, least] : exact) {
    Problem p = unit_move(flywheel(1), degree, Quantity::kTime);
    p.bounds.dq = {1};
    p.T_min = 0.5;
    p.T_max = 4;
    SearchOptions options;
    options.particles = 40;
    options.rounds = 100;
    const Solution s = minimise(p, options);
    ASSERT_EQ(s.status, Status::kFeasible) << s.reason;
    EXPECT_GE(s.T, least * (1 - 1e-9)) << "degree " << degree;
    EXPECT_LE(s.T, least * (1 + 2e-3)) << "degree " << degree;
  }
}

TEST(Optimisation, GivesTheSameBitsOnAnyNumberOfThreads) {
  Problem p = lwr_move(6, Quantity::kTorque);
  p.samples = 64;
  numerics::Threads threads(3);
  const Solution one = minimise(p, few(20)), many = minimise(p, few(20), &threads);
  EXPECT_EQ(one.c, many.c);
  EXPECT_EQ(one.history, many.history);
  EXPECT_EQ(one.pruned, many.pruned);
}

TEST(Optimisation, NamesTheJointTheTimeAndTheBoundOfAnInfeasibleMove) {
  Problem p = lwr_move(7, Quantity::kTorque);
  p.T_min = p.T_max = 0.1;
  const Solution s = minimise(p, few(10));
  EXPECT_EQ(s.status, Status::kInfeasible);
  EXPECT_NE(s.reason.find("bound"), std::string::npos) << s.reason;
  EXPECT_NE(s.reason.find("joint"), std::string::npos) << s.reason;
}

TEST(Optimisation, OrdersCostsOneAfterAnother) {
  Problem p = unit_move(flywheel(1), 9, Quantity::kAcceleration);
  p.costs.push_back({Quantity::kJerk, 1, {}});
  const Solution best = minimise(unit_move(flywheel(1), 9, Quantity::kAcceleration), few());
  const Solution s = minimise_in_order(p, 0.05, few());
  EXPECT_LE(s.costs[0], 1.05 * best.cost * (1 + 1e-6));
  EXPECT_LT(s.costs[1], 0.8 * assess(p, best.c, best.q_to, best.T).costs[1]);
}

TEST(Optimisation, KeepsParticlesOfAParetoFrontNoneOfWhichCoversAnother) {
  Problem p = unit_move(flywheel(1), 7, Quantity::kAcceleration);
  p.costs.push_back({Quantity::kTime, 1, {}});
  p.T_min = 0.5;
  p.T_max = 2;
  const auto front = pareto_front(p, 6, few(30));
  ASSERT_GT(front.size(), 20u);
  for (std::size_t i = 1; i < front.size(); ++i) {
    EXPECT_GT(front[i].costs[0], front[i - 1].costs[0]);
    EXPECT_LT(front[i].costs[1], front[i - 1].costs[1]);
  }
  for (const auto& m : front)  // ∫ q̈² ≥ 14 / T³ at degree 7
    EXPECT_GE(m.costs[0], 14 / std::pow(m.costs[1], 3) * (1 - 1e-9));
}

// Newton's method after the swarm finds more than a few rounds of few particles: the ends of the front are its results.
TEST(Optimisation, EndsAParetoFrontWithTheRefinedOptimumOfEachCost) {
  Problem p = lwr_move(9, Quantity::kTorque);
  p.costs.push_back({Quantity::kJerk, 1, {}});
  SearchOptions options = few(4);
  options.particles = 8;
  const auto front = pareto_front(p, 2, options);
  ASSERT_GE(front.size(), 2U);
  const std::vector<double> zero(p.robot.joints.size() * 4, 0.0);
  EXPECT_LE(front.back().costs[1], assess(p, zero, p.ends.q_to, p.T_max).costs[1]);
  p.costs[1].weight = 0;
  EXPECT_LE(front.front().costs[0], minimise(p, options).costs[0]);
  for (const auto& member : front) {
    const Solution s = assess(p, member.c, member.q_to, member.T);
    EXPECT_EQ(s.status, Status::kFeasible) << s.reason;
    EXPECT_EQ(s.costs, member.costs);
  }
}

TEST(Optimisation, EndsTheRefinementWhenItIsTold) {
  Problem p = lwr_move(9, Quantity::kTorque);
  SearchOptions options = few(4);
  const Solution whole = minimise(p, options);
  EXPECT_TRUE(whole.complete);
  options.refine = false;
  const Solution swarm = minimise(p, options);
  EXPECT_TRUE(swarm.complete);
  options.refine = true;
  int steps = 0;
  options.on_step = [&] { return ++steps < 3; };
  const Solution told = minimise(p, options);
  EXPECT_FALSE(told.complete);
  EXPECT_EQ(steps, 3);
  EXPECT_LE(told.cost, swarm.cost);
  EXPECT_LT(told.evaluations, whole.evaluations);
}

TEST(Optimisation, RefusesWhatIsNoProblem) {
  const Problem good = lwr_move(7, Quantity::kTorque);
  const auto refuses = [&](const std::function<void(Problem&)>& change) {
    Problem p = good;
    change(p);
    EXPECT_THROW(check(p), Error);
  };
  refuses([](Problem& p) { p.degree = 32; });
  refuses([](Problem& p) { p.T_min = 2; });
  refuses([](Problem& p) { p.ends.q_to.pop_back(); });
  refuses([](Problem& p) { p.ends.q_to[2] = std::nan(""); });
  refuses([](Problem& p) { p.bounds.tau[1] = 0; });
  refuses([](Problem& p) { p.costs.clear(); });
  refuses([](Problem& p) { p.costs[0].weight = -1; });
  refuses([](Problem& p) { p.costs = {{Quantity::kPower, 1, {}}}; });
}

// The control points on parts of [0, 1] bound the extremes, and the kinematic verdict is that of the exact extremes.
TEST(Optimisation, DecidesKinematicBoundsExactly) {
  Problem p = unit_move(flywheel(1), 11, Quantity::kAcceleration);
  const Evaluator free(p);
  Motions motions = free.motions();
  for (int trial = 0; trial < 200; ++trial) {
    for (std::size_t i = 0; i < motions.c.size(); ++i)
      motions.c[i] = 0.2 * std::sin(1.7 * static_cast<double>(trial) + 3.1 * static_cast<double>(i * i));
    const auto points = free.control_points(motions, 0, 0);
    const auto range = trajectory::bernstein::extremes(points, 1);
    const double peak = std::max(range.max.value, -range.min.value);
    for (const double share : {1 + 1e-7, 1 - 1e-7}) {
      Problem bounded = p;
      bounded.bounds.dq = {peak * share};
      const Evaluator evaluator(bounded);
      const auto scratch = evaluator.scratch();
      Values values = evaluator.values();
      evaluator.evaluate(motions, *scratch, values);
      EXPECT_EQ(values.kinematic[0] == 0, share > 1) << "trial " << trial;
    }
  }
}

}  // namespace
}  // namespace cotwin::optimisation::optimisation_test
