#include "models/identification/identification.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <functional>
#include <set>

#include "models/foundation/support/error.h"
#include "models/identification/torque_data/drive_terms.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/identification/samples.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"

namespace cotwin::identification::identification_test {
namespace {

using namespace testing;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::HasSubstr;

const robot::RobotModel& lwr() {
  static const robot::RobotModel robot = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  return robot;
}
const robot::RobotModel& planar() {
  static const robot::RobotModel robot = robot::load_urdf(places::source() + "/models/robots/planar2/robot.urdf");
  return robot;
}

TorqueData compressed(const robot::RobotModel& robot, const Samples& samples, const ModelOptions& options = {}) {
  TorqueData data(robot, options);
  add(data, samples);
  data.flush();
  return data;
}

VectorXd random_xi(const Problem& problem, double reach, std::uint32_t stream) {
  VectorXd xi(problem.dimensions());
  for (Index i = 0; i < xi.size(); ++i) xi[i] = reach * numerics::normal({14, stream, 0, 0, static_cast<std::uint32_t>(i)});
  return xi.cwiseMax(problem.lower()).cwiseMin(problem.upper());
}

/// All rows [F C | Y_b | τ] / σ of the samples without compression: the second formulation.
MatrixXd all_rows(const TorqueData& data, const Samples& s, const VectorXd& sigma) {
  const robot::RobotModel& robot = data.robot();
  const robot::Mechanism mechanism(robot);
  robot::Data scratch(mechanism);
  const Index n = robot.n(), b = static_cast<Index>(data.base().columns.size());
  const auto count = static_cast<Index>(s.count());
  std::vector<DriveTerms> terms;
  Index drives = 0;
  std::vector<Index> first;
  for (int j = 0; j < n; ++j) {
    terms.emplace_back(data, j);
    first.push_back(drives);
    drives += terms.back().size();
  }
  MatrixXd A = MatrixXd::Zero(n * count, drives + b + 1), Y(n, 10 * n);
  for (Index k = 0; k < count; ++k) {
    const Eigen::Map<const VectorXd> q(&s.q[static_cast<std::size_t>(k * n)], n), dq(&s.dq[static_cast<std::size_t>(k * n)], n),
        ddq(&s.ddq[static_cast<std::size_t>(k * n)], n);
    robot::regressor(mechanism, scratch, q, dq, ddq, Y);
    for (Index j = 0; j < n; ++j) {
      auto row = A.row(k * n + j);
      const double unknowns[4] = {std::tanh(dq[j] / data.options().v_R), dq[j], 1, ddq[j]};
      for (Index i = 0; i < terms[static_cast<std::size_t>(j)].size(); ++i)
        row[first[static_cast<std::size_t>(j)] + i] = unknowns[i];
      for (Index i = 0; i < b; ++i) row[drives + i] = Y(j, data.base().columns[static_cast<std::size_t>(i)]);
      row[drives + b] = s.tau[static_cast<std::size_t>(k * n + j)];
      row /= sigma[j];
    }
  }
  return A;
}

TEST(BaseParameters, ReproduceTheTorquesOfAnyRobotAndAreIndependent) {
  robot::testing::Draw draw(21);
  for (int trial = 0; trial < 30; ++trial) {
    using robot::testing::Kind;
    const Kind kind = trial % 3 == 0 ? Kind::kChain : trial % 3 == 1 ? Kind::kMixedChain : Kind::kTree;
    const robot::RobotModel robot = draw.robot(kind, draw.integer(1, 7));
    const Index n = robot.n();
    const BaseParameters base = base_parameters(robot);
    const auto b = static_cast<Index>(base.columns.size());
    const robot::Mechanism mechanism(robot);
    robot::Data scratch(mechanism);
    MatrixXd all(50 * n, 10 * n), Y(n, 10 * n);
    for (Index s = 0; s < 50; ++s) {
      robot::regressor(mechanism, scratch, draw.numbers(robot.n(), -3, 3), draw.numbers(robot.n(), -3, 3),
                       draw.numbers(robot.n(), -9, 9), Y);
      all.middleRows(n * s, n) = Y;
    }
    MatrixXd kept(all.rows(), b);
    for (Index i = 0; i < b; ++i) kept.col(i) = all.col(base.columns[static_cast<std::size_t>(i)]);
    EXPECT_LT((kept * base.G - all).norm(), 1e-10 * all.norm()) << "trial " << trial;
    const VectorXd singular = all.jacobiSvd().singularValues();
    const auto rank = (singular.array() > 1e-9 * singular[0]).count();
    EXPECT_EQ(b, rank) << "trial " << trial;
  }
}

// Gautier and Khalil's number for arms of seven revolute joints with perpendicular neighbours: 43 with gravity.
TEST(BaseParameters, AreFortyThreeForTheLwr) { EXPECT_EQ(base_parameters(lwr()).columns.size(), 43u); }

// Two parallel joints under gravity in the plane (closed form): with p = m_2 and the first link's length l,
//   Izz_1 + l² m_2,   mc_1 (two components, one with + l m_2),   Izz_2,   mc_2 (two components).
TEST(BaseParameters, OfThePlanarArmAreTheTextbooksSix) {
  const BaseParameters base = base_parameters(planar());
  ASSERT_EQ(base.columns.size(), 6u);
  const double l = planar().joints[1].X_PJ.p.norm();
  const Eigen::RowVectorXd mass_2 = base.G.col(10).transpose();
  EXPECT_NEAR(mass_2.cwiseAbs().maxCoeff(), std::max(l, l * l), 1e-9);
  EXPECT_NEAR(mass_2.norm(), std::hypot(l, l * l), 1e-9);
  const std::string names = base.name(0) + ", " + base.name(1) + ", " + base.name(2);
  EXPECT_THAT(names, HasSubstr("m_2"));
}

TEST(TorqueData, GivesTheErrorsOfAnyEstimateWithoutTheSamples) {
  const Estimate truth = truth_of(lwr());
  const Samples samples = simulate(lwr(), truth, 3000, 0.05);
  const TorqueData data = compressed(lwr(), samples);
  EXPECT_EQ(data.count(), 3000u);
  Estimate other = truth_of(perturbed(lwr(), 0.3));
  for (const Estimate& estimate : {truth, other, estimate_of(lwr())}) {
    const VectorXd direct = discrepancy(samples, torques(lwr(), estimate, samples)).rms;
    EXPECT_LT((data.rms(estimate) - direct).cwiseQuotient(direct).cwiseAbs().maxCoeff(), 1e-9);
  }
  EXPECT_NEAR(data.rms(truth).mean(), 0.05, 0.002);  // the noise that was added
}

TEST(TorqueData, KeepsTheCurveOfFrictionWhateverSpeedTheUrdfAllows) {
  for (const double limit : {0.02, 3.0, 1e3, 1e9}) {
    robot::RobotModel robot = planar();
    for (robot::Joint& joint : robot.joints) joint.dq_max = limit;
    Estimate truth = truth_of(robot);
    for (JointDrive& drive : truth.drive) drive.v_R = 0.1;
    const Samples samples = simulate(robot, truth, 1500, 0.05);
    ModelOptions options;
    options.friction = FrictionLaw::kSigmoid;
    Estimate none = truth;
    for (JointDrive& drive : none.drive) drive.tau_C = drive.tau_S = 0;
    const TorqueData data = compressed(robot, samples, options);
    EXPECT_NEAR(data.rms(truth).mean(), 0.05, 0.005) << limit;
    EXPECT_NEAR(data.rms(none)[0], discrepancy(samples, torques(robot, none, samples)).rms[0], 1e-9) << limit;
  }
}

TEST(TorqueData, MergedFromPartsIsTheWhole) {
  const Estimate truth = truth_of(lwr());
  const Samples samples = simulate(lwr(), truth, 1000, 0.05);
  TorqueData parts = compressed(lwr(), part(samples, 600, 1000));
  parts.merge(compressed(lwr(), part(samples, 0, 600)));
  const TorqueData whole = compressed(lwr(), samples);
  EXPECT_EQ(parts.count(), 1000u);
  EXPECT_LT((parts.rms(truth) - whole.rms(truth)).norm(), 1e-12);
  ModelOptions other;
  other.viscous = false;
  EXPECT_THROW(parts.merge(TorqueData(lwr(), other)), Error);
}

TEST(TorqueData, TakesSamplesWithoutAllocating) {
  for (const FrictionLaw law : {FrictionLaw::kCoulomb, FrictionLaw::kSigmoid}) {
    ModelOptions options;
    options.friction = law;
    options.harmonics.assign(7, 1);
    TorqueData data(lwr(), options, 0.999);
    const Samples s = simulate(lwr(), truth_of(lwr()), 200, 0);
    const auto before = cotwin::testing::allocations();
    for (std::size_t k = 0; k < s.count(); ++k) data.add(&s.q[7 * k], &s.dq[7 * k], &s.ddq[7 * k], &s.tau[7 * k]);
    EXPECT_EQ(cotwin::testing::allocations(), before);
  }
}

// Without noise, unconstrained least squares must find the robot itself: its base parameters and its friction.
TEST(Floor, RecoversAKnownRobotExactly) {
  ModelOptions options;
  options.motor_inertia = false;  // B_1 and Izz_1 are one parameter
  const Estimate truth = truth_of(lwr(), false);
  const Samples samples = simulate(lwr(), truth, 2000, 0);
  const Problem problem(compressed(lwr(), samples, options), perturbed(lwr(), 0.3));
  const VectorXd beta = base_parameters(lwr()).G * truth.pi;
  EXPECT_EQ(problem.floor().rank, problem.floor().unknowns);
  EXPECT_LT((problem.floor().beta - beta).norm(), 1e-8 * beta.norm());
  for (std::size_t j = 0; j < 7; ++j) {
    EXPECT_NEAR(problem.floor().drive[j].tau_C, truth.drive[j].tau_C, 1e-8);
    EXPECT_NEAR(problem.floor().drive[j].sigma2, truth.drive[j].sigma2, 1e-8);
    EXPECT_NEAR(problem.floor().drive[j].tau_0, truth.drive[j].tau_0, 1e-8);
  }
  const VectorXd direct = discrepancy(samples, torques(lwr(), problem.floor_estimate(), samples)).rms;
  EXPECT_LT(direct.maxCoeff(), 1e-8);
}

TEST(Floor, IsTheLeastSquaresSolutionOfAllSamples) {
  const Samples samples = simulate(lwr(), truth_of(lwr(), false), 1500, 0.1);
  ModelOptions options;
  options.motor_inertia = false;
  ProblemOptions weights;
  weights.sigma = VectorXd::LinSpaced(7, 0.5, 2);
  const TorqueData data = compressed(lwr(), samples, options);
  const Problem problem(data, lwr(), weights);
  const MatrixXd A = all_rows(data, samples, weights.sigma);
  const Index p = A.cols() - 1;
  const VectorXd x = A.leftCols(p).colPivHouseholderQr().solve(A.col(p));
  EXPECT_LT((problem.floor().beta - x.tail(43)).norm(), 1e-9 * x.norm());
  const double least = (A.leftCols(p) * x - A.col(p)).squaredNorm() / (7.0 * 1500);
  EXPECT_NEAR(problem.floor().cost, least, 1e-12 * least);
  // standard deviations: σ² (AᵀA)⁻¹ with the given weights
  const VectorXd deviation = (A.leftCols(p).transpose() * A.leftCols(p)).inverse().diagonal().cwiseSqrt();
  for (Index i = 0; i < p; ++i)
    EXPECT_NEAR(problem.excitation().unknown[static_cast<std::size_t>(i)].deviation, deviation[i], 1e-6 * deviation[i]) << i;
}

// Also if the shape of friction is sought: the floor is the best for all joints together, not for one after the other.
TEST(Floor, IsNotAboveFeasibleLeastSquaresWithNonlinearFriction) {
  for (const FrictionLaw law : {FrictionLaw::kSigmoid, FrictionLaw::kStribeck}) {
    for (const auto* robot : {&planar(), &lwr()}) {
      Estimate truth = truth_of(*robot);
      for (JointDrive& drive : truth.drive) {
        if (law == FrictionLaw::kSigmoid) {
          drive.v_R = 0.15;
          drive.s = 0.03;
        } else {
          drive.tau_S = 1.5 * drive.tau_C;
          drive.v_S = 0.3;
        }
      }
      ModelOptions options;
      options.friction = law;
      ProblemOptions free;
      free.prior_weight = 1e-6;
      const Problem problem(compressed(*robot, simulate(*robot, truth, 2000, 0.05), options), *robot, free);
      const double floor = problem.weighted_rms(problem.floor_estimate());
      const double feasible = solve_feasible(problem).weighted_rms;
      EXPECT_LE(floor, feasible * (1 + 1e-9)) << to_text(law) << ", " << robot->name;
      EXPECT_LT(feasible, 1.01 * floor) << to_text(law) << ", " << robot->name;
    }
  }
}

TEST(Floor, WeightsJointsByTheirResiduals) {
  Samples samples = simulate(lwr(), truth_of(lwr()), 4000, 0);
  const VectorXd noise = VectorXd::LinSpaced(7, 0.7, 0.1);
  for (std::size_t i = 0; i < samples.tau.size(); ++i)
    samples.tau[i] += noise[static_cast<Index>(i % 7)] * numerics::normal({15, 0, 0, 0, static_cast<std::uint32_t>(i)});
  const Problem problem(compressed(lwr(), samples), lwr());
  for (Index j = 0; j < 7; ++j) EXPECT_NEAR(problem.sigma()[j], noise[j], 5 * noise[j] / std::sqrt(2 * 4000.0));
  EXPECT_NEAR(problem.floor().cost, 1, 0.02);
}

TEST(Problem, RefusesWhatCannotBeIdentified) {
  const Samples samples = simulate(lwr(), truth_of(lwr()), 300, 0.1);
  const auto message = [](const std::function<void()>& f) -> std::string {
    try {
      f();
    } catch (const Error& e) {
      return e.what();
    }
    return "no error";
  };
  EXPECT_EQ(message([&] { Problem(compressed(lwr(), part(samples, 0, 20)), lwr()); }),
            "torque data: 20 samples, expected at least as many as unknowns, 71");
  EXPECT_THAT(message([&] { Problem(compressed(lwr(), samples), planar()); }), HasSubstr("2 joints, expected 7"));
  Samples dead = samples;
  for (std::size_t k = 0; k < dead.count(); ++k) dead.tau[7 * k + 3] = 0;
  EXPECT_THAT(message([&] { Problem(compressed(lwr(), dead), lwr()); }), HasSubstr("torque of joint 4"));
  EXPECT_THROW(friction_law("coulombic"), Error);
}

TEST(Problem, CostInLanesIsTheSumOfSquaredResiduals) {
  for (const FrictionLaw law : {FrictionLaw::kNone, FrictionLaw::kCoulomb, FrictionLaw::kSigmoid, FrictionLaw::kStribeck}) {
    ModelOptions options;
    options.friction = law;
    const Problem problem(compressed(lwr(), simulate(lwr(), truth_of(lwr()), 800, 0.1), options), perturbed(lwr(), 0.3));
    const auto d = static_cast<std::size_t>(problem.dimensions());
    for (std::uint32_t trial = 0; trial < 10; ++trial) {
      std::vector<double> lanes(8 * d), scratch(problem.scratch_doubles());
      double costs[8];
      std::vector<VectorXd> points;
      for (std::uint32_t k = 0; k < 8; ++k) {
        points.push_back(random_xi(problem, 0.5, 8 * trial + k));
        for (std::size_t i = 0; i < d; ++i) lanes[8 * i + k] = points.back()[static_cast<Index>(i)];
      }
      problem.cost(lanes.data(), 8, scratch.data(), costs);
      for (std::size_t k = 0; k < 8; ++k) {
        VectorXd r;
        problem.residuals(points[k], r);
        ASSERT_NEAR(costs[k], r.squaredNorm(), 1e-10 * costs[k]) << to_text(law);  // two implementations
        // independently: the errors of the estimate, and the pull to the prior
        const double w = problem.weighted_rms(problem.estimate(points[k]));
        // nonlinear friction: by its basis of few directions, exact to 1e-7 of its torque
        ASSERT_NEAR(costs[k], w * w + problem.prior_cost(points[k]), 1e-6 * costs[k]) << to_text(law);
      }
    }
  }
}

TEST(Problem, DerivativesOfTheResidualsAreTheirSlopes) {
  for (const FrictionLaw law : {FrictionLaw::kCoulomb, FrictionLaw::kSigmoid, FrictionLaw::kStribeck}) {
    ModelOptions options;
    options.friction = law;
    const Problem problem(compressed(lwr(), simulate(lwr(), truth_of(lwr()), 800, 0.1), options), perturbed(lwr(), 0.1));
    const VectorXd xi = random_xi(problem, 0.1, 77);
    VectorXd r, up, down;
    MatrixXd J;
    problem.residuals(xi, r, &J);
    constexpr double kStep = 1e-5;
    for (Index i = 0; i < xi.size(); ++i) {
      const VectorXd step = kStep * VectorXd::Unit(xi.size(), i);
      problem.residuals(xi + step, up);
      problem.residuals(xi - step, down);
      ASSERT_LT(((up - down) / (2 * kStep) - J.col(i)).norm(), 1e-5 * (1e-3 + J.col(i).norm())) << to_text(law) << " " << i;
    }
  }
}

TEST(Problem, NoPhysicalRobotIsBelowTheFloor) {
  const Problem problem(compressed(lwr(), simulate(lwr(), truth_of(lwr()), 1500, 0.2)), perturbed(lwr(), 0.3));
  for (std::uint32_t k = 0; k < 300; ++k)
    ASSERT_GE(problem.cost(random_xi(problem, 0.02 * k, k)), problem.floor().cost * (1 - 1e-12));
}

TEST(Excitation, NamesTheParametersThatAFixedJointDoesNotExcite) {
  Samples samples = simulate(lwr(), truth_of(lwr()), 1500, 0);
  for (std::size_t k = 0; k < samples.count(); ++k) samples.dq[7 * k + 6] = samples.ddq[7 * k + 6] = samples.q[7 * k + 6] = 0;
  samples.tau = torques(lwr(), truth_of(lwr()), samples);
  for (std::size_t i = 0; i < samples.tau.size(); ++i)
    samples.tau[i] += 0.05 * numerics::normal({16, 0, 0, 0, static_cast<std::uint32_t>(i)});
  const Problem all(compressed(lwr(), simulate(lwr(), truth_of(lwr()), 1500, 0.05)), lwr());
  const Problem problem(compressed(lwr(), samples), lwr());
  EXPECT_EQ(problem.excitation().structural, 43);
  EXPECT_LT(problem.excitation().rank, all.excitation().rank);
  bool named = false;
  for (const Determination& u : problem.excitation().unknown) named = named || (!u.determined && u.name == "sigma2_7");
  EXPECT_TRUE(named);
  ASSERT_FALSE(problem.excitation().warnings.empty());
  EXPECT_THAT(problem.excitation().warnings.front(), HasSubstr("the others are left to the prior"));
}

// All 2^k choices of coefficients that are fixed at zero: the best one that is not negative.
TEST(NonnegativeLeastSquares, FindsTheSolutionOfAnExhaustiveSearch) {
  robot::testing::Draw draw(9);
  int held = 0;
  for (int trial = 0; trial < 4000; ++trial) {
    const int rows = draw.integer(5, 12), m = draw.integer(1, 5);
    MatrixXd T(rows, m);
    for (double& x : T.reshaped()) x = draw.number(-1, 1);
    if (m > 2 && trial % 5 == 0) T.col(2) = T.col(0) - T.col(1);  // dependent
    const VectorXd b = draw.numbers(rows, -1, 1);
    bool nonnegative[kMostTerms];
    for (int k = 0; k < m; ++k) nonnegative[k] = draw.integer(0, 2) > 0;
    double least = b.squaredNorm();
    for (unsigned set = 0; set < (1u << m); ++set) {
      MatrixXd free(rows, m);
      std::vector<int> which;
      for (int k = 0; k < m; ++k)
        if (set >> k & 1) {
          free.col(static_cast<Index>(which.size())) = T.col(k);
          which.push_back(k);
        }
      if (which.empty()) continue;
      const auto count = static_cast<Index>(which.size());
      const VectorXd x = free.leftCols(count).completeOrthogonalDecomposition().solve(b);
      bool good = true;
      for (Index i = 0; i < count; ++i) good = good && !(nonnegative[which[static_cast<std::size_t>(i)]] && x[i] < -1e-12);
      if (good) least = std::min(least, (free.leftCols(count) * x - b).squaredNorm());
    }
    MatrixXd T_work = T;
    VectorXd b_work = b, phi(kMostTerms);
    unsigned active = 0;
    const double found = solve_nonnegative(rows, m, T_work.data(), rows, b_work.data(), nonnegative, phi.data(), &active);
    ASSERT_NEAR(found, least, 1e-10) << "trial " << trial;
    ASSERT_NEAR((T * phi.head(m) - b).squaredNorm(), least, 1e-10) << "trial " << trial;
    for (int k = 0; k < m; ++k) ASSERT_TRUE(!nonnegative[k] || phi[k] >= 0) << "trial " << trial;
    held += active != 0;
  }
  EXPECT_GT(held, 1000);
}

void expect_physical(const robot::RobotModel& robot, const Estimate& estimate) {
  for (int i = 0; i < robot.n(); ++i)
    EXPECT_EQ(Inertia::from_parameters(estimate.pi.segment<10>(10 * i)).unphysical(), "") << "body " << i + 1;
  for (const JointDrive& d : estimate.drive) {
    EXPECT_GE(d.tau_C, 0);
    EXPECT_GE(d.tau_S, d.tau_C);
    EXPECT_GE(d.sigma2, 0);
    EXPECT_GE(d.B, 0);
  }
}

TEST(Feasible, FindsTheTorquesOfAKnownRobotFromAPriorThatIsThirtyPercentOff) {
  const Samples samples = simulate(lwr(), truth_of(lwr()), 2000, 0.05);
  const Problem problem(compressed(lwr(), samples), perturbed(lwr(), 0.3));
  const FeasibleResult result = solve_feasible(problem);
  expect_physical(lwr(), result.estimate);
  // The truth is a physical robot whose error is the noise: the best robot is at most that far from the floor.
  EXPECT_LT(result.weighted_rms, 1.01);
  EXPECT_GE(result.weighted_rms, std::sqrt(problem.floor().cost) * (1 - 1e-12));
}

// A convex problem has one minimum: from any start, Levenberg–Marquardt ends at the minimum that the barrier method found, and
// no step from there decreases the cost.
TEST(Feasible, ConvexOptimumIsWhereEveryDescentEnds) {
  // noise so strong that the unconstrained robot is far from physical
  const Samples samples = simulate(lwr(), truth_of(lwr()), 600, 3);
  ProblemOptions options;
  options.prior_weight = 1;
  const Problem problem(compressed(lwr(), samples), perturbed(lwr(), 0.3), options);
  const FeasibleResult convex = solve_feasible(problem, {.convex = true, .starts = 0});
  EXPECT_EQ(convex.start, -1);
  const FeasibleResult descent =
      solve_feasible(problem, {.convex = false, .starts = 3, .iterations = 3000, .tolerance = 1e-13});
  EXPECT_NEAR(descent.cost, convex.cost, 1e-5 * convex.cost);
  EXPECT_GE(descent.cost, convex.cost * (1 - 1e-7));
  EXPECT_GT(convex.cost, 1.001 * problem.floor().cost);
  for (std::uint32_t k = 0; k < 200; ++k) {
    const VectorXd step = random_xi(problem, 1, 500 + k);
    for (const double length : {1e-1, 1e-2, 1e-3}) ASSERT_GE(problem.cost(convex.xi + length * step), convex.cost * (1 - 1e-9));
  }
  expect_physical(lwr(), convex.estimate);
}

// The data do not determine B_1 and B_2, and others hardly: the pull to the prior determines them, not rounding.
TEST(Feasible, FindsTheSameRobotFromTorquesThatDifferByRounding) {
  for (const FrictionLaw law : {FrictionLaw::kCoulomb, FrictionLaw::kSigmoid, FrictionLaw::kStribeck}) {
    Samples samples = simulate(lwr(), truth_of(lwr()), 1500, 0.1);
    ModelOptions model;
    model.friction = law;
    ProblemOptions options;
    options.prior_weight = 1e-3;
    const FeasibleResult one = solve_feasible(Problem(compressed(lwr(), samples, model), perturbed(lwr(), 0.3), options));
    for (std::size_t i = 0; i < samples.tau.size(); ++i)
      samples.tau[i] *= 1 + 1e-13 * numerics::normal({19, 0, 0, 0, static_cast<std::uint32_t>(i)});
    const FeasibleResult other = solve_feasible(Problem(compressed(lwr(), samples, model), perturbed(lwr(), 0.3), options));
    EXPECT_NEAR(one.cost, other.cost, 1e-8 * one.cost) << to_text(law);
    EXPECT_LT((one.estimate.pi - other.estimate.pi).cwiseAbs().maxCoeff(), 1e-5) << to_text(law);
    for (std::size_t j = 0; j < 7; ++j) EXPECT_NEAR(one.estimate.drive[j].B, other.estimate.drive[j].B, 1e-5) << to_text(law);
  }
}

// The optimum without the box has bodies far outside of it: the optimum within is on the faces, and descents find no lower one.
TEST(Feasible, StaysWithinANarrowBox) {
  const Samples samples = simulate(lwr(), truth_of(lwr()), 1500, 0.1);
  ProblemOptions narrow;
  narrow.bounds.mass_factor = 1.2;
  narrow.bounds.stretch_factor = 1.2;
  narrow.bounds.shear = narrow.bounds.shift = 0.2;
  const Problem problem(compressed(lwr(), samples), perturbed(lwr(), 0.3), narrow);
  const FeasibleResult result = solve_feasible(problem);
  EXPECT_EQ(result.start, -1);
  EXPECT_TRUE((result.xi.array() >= problem.lower().array()).all() && (result.xi.array() <= problem.upper().array()).all());
  const VectorXd width = problem.upper() - problem.lower();
  EXPECT_GT(((result.xi - problem.lower()).cwiseMin(problem.upper() - result.xi).array() < 1e-4 * width.array()).count(), 5);
  std::set<ActiveBound::Kind> kinds;
  for (const ActiveBound& bound : problem.active_bounds(result.xi)) kinds.insert(bound.kind);
  EXPECT_THAT(kinds, ::testing::IsSupersetOf({ActiveBound::Kind::kMass, ActiveBound::Kind::kShift}));
  EXPECT_TRUE(problem.active_bounds(VectorXd::Zero(problem.dimensions())).empty());
  const FeasibleResult descents = solve_feasible(problem, {.convex = false, .starts = 2, .iterations = 2000});
  EXPECT_GE(descents.cost, result.cost * (1 - 1e-6));
}

// A slide of a tenth of a metre a second at most, whose friction changes sign within 2 mm/s.
TEST(Friction, OfASlideChangesItsSignWithinATenthOfTheSpeedOfARevoluteJoint) {
  const robot::RobotModel gantry = robot::load_urdf(places::source() + "/tests/components/data/gantry.urdf");
  Estimate truth = truth_of(gantry);
  int slides = 0;
  for (std::size_t j = 0; j < truth.drive.size(); ++j)
    if (gantry.joints[j].type == robot::JointType::kPrismatic) {
      truth.drive[j].v_R = 2e-3;
      ++slides;
    }
  ASSERT_GT(slides, 0);
  Samples samples = simulate(gantry, truth, 2000, 0);
  for (std::vector<double>* values : {&samples.q, &samples.dq, &samples.ddq})
    for (double& x : *values) x *= 0.05;
  samples.tau = torques(gantry, truth, samples);
  const FeasibleResult result = solve_feasible(Problem(compressed(gantry, samples), gantry));
  for (std::size_t j = 0; j < truth.drive.size(); ++j) {
    EXPECT_NEAR(result.estimate.drive[j].tau_C, truth.drive[j].tau_C, 0.02 * truth.drive[j].tau_C) << j;
    EXPECT_EQ(result.estimate.drive[j].v_R, truth.drive[j].v_R) << j;
  }
}

TEST(Feasible, StopsOnRequestAndIsNeverWorseThanThePrior) {
  ModelOptions model;
  model.friction = FrictionLaw::kSigmoid;
  const Problem problem(compressed(lwr(), simulate(lwr(), truth_of(lwr()), 800, 0.1), model), perturbed(lwr(), 0.3));
  const double prior = problem.cost(VectorXd::Zero(problem.dimensions()));
  for (const bool convex : {true, false}) {
    for (const int most : {0, 1, 7, 30}) {
      int asked = 0;
      FeasibleOptions options;
      options.convex = convex;
      options.starts = convex ? 0 : 2;
      options.stop = [&] { return ++asked > most; };
      const FeasibleResult result = solve_feasible(problem, options);
      EXPECT_TRUE(result.interrupted) << most;
      EXPECT_LE(asked, most + 2) << "continued after the request to stop";
      EXPECT_LE(result.cost, prior);
      expect_physical(lwr(), result.estimate);
    }
  }
}

TEST(SwarmSearch, ComesWithinTwoPercentOfFeasibleLeastSquaresAndFiveFromADistantPrior) {
  const Samples samples = simulate(lwr(), truth_of(lwr()), 2000, 0.1);
  for (const double share : {0.0, 0.3}) {
    const Problem problem(compressed(lwr(), samples), perturbed(lwr(), share));
    const FeasibleResult feasible = solve_feasible(problem);
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      SwarmSearchOptions options;
      options.swarm.seed = seed;
      SwarmSearch search(problem, options);
      const SwarmSearchProgress progress = search.run();
      EXPECT_EQ(progress.round, 500u);
      EXPECT_LT(progress.weighted_rms, (share == 0 ? 1.02 : 1.05) * feasible.weighted_rms) << "seed " << seed;
      EXPECT_GE(progress.weighted_rms, std::sqrt(problem.floor().cost) * (1 - 1e-12));
      EXPECT_NEAR(progress.weighted_rms, problem.weighted_rms(search.estimate()), 1e-9);
      expect_physical(lwr(), search.estimate());
    }
  }
}

// 3 kN.m at the base and a noise of half a per cent at the hand: a few of the axes attract the swarm at first, and it must not
// drift along the others.
TEST(SwarmSearch, ConvergesFromADistantPriorOfAHeavyRobot) {
  const robot::RobotModel heavy = robot::load_urdf(places::source() + "/models/robots/kr300_r2500/robot.urdf");
  Samples samples = simulate(heavy, truth_of(heavy), 2000, 0);
  VectorXd rms = VectorXd::Zero(6);
  for (std::size_t i = 0; i < samples.tau.size(); ++i) rms[static_cast<Index>(i % 6)] += samples.tau[i] * samples.tau[i] / 2000;
  for (std::size_t i = 0; i < samples.tau.size(); ++i)
    samples.tau[i] +=
        0.005 * std::sqrt(rms[static_cast<Index>(i % 6)]) * numerics::normal({19, 0, 0, 0, static_cast<std::uint32_t>(i)});
  const TorqueData data = compressed(heavy, samples);
  for (const std::uint32_t specimen : {1u, 2u, 3u}) {
    const Problem problem(data, perturbed(heavy, 0.3, specimen));
    SwarmSearch search(problem);
    search.run();
    EXPECT_LT(problem.weighted_rms(search.estimate()), 1.001 * problem.weighted_rms(problem.floor_estimate())) << specimen;
  }
}

TEST(SwarmSearch, GivesTheSameBitsOnAnyNumberOfThreads) {
  const Problem problem(compressed(lwr(), simulate(lwr(), truth_of(lwr()), 800, 0.1)), perturbed(lwr(), 0.3));
  SwarmSearchOptions options;
  options.swarm.rounds = 120;
  const auto result = [&](int count) {
    numerics::Threads threads(count);
    SwarmSearch search(problem, options);
    search.run(&threads);
    return search.save();
  };
  const std::string one = result(1);
  EXPECT_EQ(result(2), one);
  EXPECT_EQ(result(8), one);
}

TEST(SwarmSearch, GoesOnFromAFileToTheSameBitsAndRefusesForeignOnes) {
  const TorqueData data = compressed(lwr(), simulate(lwr(), truth_of(lwr()), 800, 0.1));
  const Problem problem(data, perturbed(lwr(), 0.3));
  SwarmSearchOptions options;
  options.swarm.rounds = 150;
  SwarmSearch whole(problem, options);
  whole.run();
  EXPECT_GT(whole.progress().reconfigurations, 0u);
  for (const std::uint32_t stop : {1u, 40u, 99u}) {
    SwarmSearch first(problem, options);
    while (first.progress().round < stop) first.round();
    const Problem again(data, perturbed(lwr(), 0.3));
    SwarmSearch second(again, options, first.save());
    EXPECT_EQ(second.best(), first.best());
    second.run();
    EXPECT_EQ(second.save(), whole.save()) << "stopped after " << stop;
  }
  const Problem other(data, lwr());
  EXPECT_THROW(SwarmSearch(other, options, whole.save()), Error);
  options.swarm.seed = 2;
  EXPECT_THROW(SwarmSearch(problem, options, whole.save()), Error);
  EXPECT_THROW(SwarmSearch(problem, options, std::string(20, '\0')), Error);
}

TEST(SwarmSearch, MoreRoundsMayBeAskedForWhenItIsResumed) {
  const Problem problem(compressed(planar(), simulate(planar(), truth_of(planar()), 500, 0.1)), planar());
  SwarmSearchOptions options;
  options.swarm.rounds = 30;
  SwarmSearch brief(problem, options);
  brief.run();
  options.swarm.rounds = 60;
  SwarmSearch longer(problem, options, brief.save());
  EXPECT_EQ(longer.run().round, 60u);
  EXPECT_LE(longer.progress().cost, brief.progress().cost);
}

/// A robot with known nonlinear friction, tuned from a wrong shape.
struct Shaped {
  Samples samples;
  Estimate found;
  double excess = 0;  // of the weighted RMS over the noise
};
Shaped tune_shaped(FrictionLaw law, const JointDrive& drive) {
  Estimate truth = truth_of(planar());
  for (JointDrive& d : truth.drive) d = drive;
  Shaped result;
  result.samples = simulate(planar(), truth, 6000, 0.01);
  ModelOptions options;
  options.friction = law;
  options.v_R = law == FrictionLaw::kStribeck ? drive.v_R : 0.02;
  const Problem problem(compressed(planar(), result.samples, options), planar());
  SwarmSearch search(problem);
  search.run();
  result.found = search.estimate();
  result.excess = discrepancy(result.samples, torques(planar(), result.found, result.samples)).rms.maxCoeff() / 0.01;
  return result;
}

TEST(SwarmSearch, FindsTheSlopeAndShiftOfSigmoidFriction) {
  JointDrive drive;
  drive.tau_C = drive.tau_S = 2;
  drive.sigma2 = 1;
  drive.tau_0 = 0.3;
  drive.B = 0.2;
  drive.v_R = 0.08;
  drive.s = 0.02;
  const Shaped result = tune_shaped(FrictionLaw::kSigmoid, drive);
  for (const JointDrive& d : result.found.drive) {
    EXPECT_NEAR(d.v_R, 0.08, 0.002);
    EXPECT_NEAR(d.s, 0.02, 0.001);
    EXPECT_NEAR(d.tau_C, 2, 0.02);
    EXPECT_NEAR(d.sigma2, 1, 0.02);
  }
  EXPECT_LT(result.excess, 1.05);  // including the interpolation of the curve between nodes
}

TEST(SwarmSearch, FindsTheStribeckSpeed) {
  JointDrive drive;
  drive.tau_C = 2;
  drive.tau_S = 3;
  drive.v_S = 0.25;
  drive.sigma2 = 1;
  drive.B = 0.2;
  drive.v_R = 0.02;
  const Shaped result = tune_shaped(FrictionLaw::kStribeck, drive);
  for (const JointDrive& d : result.found.drive) {
    EXPECT_NEAR(d.v_S, 0.25, 0.01);
    EXPECT_NEAR(d.tau_C, 2, 0.03);
    EXPECT_NEAR(d.tau_S, 3, 0.03);
  }
  EXPECT_LT(result.excess, 1.05);
}

// A spring over joint 2, such as a counterbalance, is not a rigid body: harmonics represent it.
TEST(Harmonics, RepresentASpring) {
  Estimate truth = truth_of(lwr());
  truth.drive[1].harmonics = {3, -1, 0.5, 2};
  const Samples samples = simulate(lwr(), truth, 2000, 0.02);
  ModelOptions options;
  options.harmonics = {0, 2, 0, 0, 0, 0, 0};
  const Problem with(compressed(lwr(), samples, options), lwr()), without(compressed(lwr(), samples), lwr());
  EXPECT_NEAR(with.sigma()[1], 0.02, 0.002);
  EXPECT_GT(without.sigma()[1], 0.1);
  const Estimate found = solve_feasible(with).estimate;
  ASSERT_EQ(found.drive[1].harmonics.size(), 4u);
  EXPECT_NEAR(found.drive[1].harmonics[2], 0.5, 0.05);  // the first ones are shared with gravity
  EXPECT_NEAR(found.drive[1].harmonics[3], 2, 0.05);
  EXPECT_LT(discrepancy(samples, torques(lwr(), found, samples)).rms[1], 0.021);
}

// If both sides are measured, a linear fit finds it, also if the link's encoder is delayed by 3 ms and has an offset.
TEST(Torsion, GivesTheStiffnessBesideTheLagOfTheRecord) {
  constexpr double K = 5e6, lag = 3e-3, offset = 1e-3;
  TorsionFit fit, noisy, unrelated;
  double xx = 0, xy = 0;  // of a linear fit of torsion over torque alone
  for (std::uint32_t k = 0; k < 2500; ++k) {
    const double t = 0.004 * k;
    const double q = std::sin(1.3 * t) + 0.3 * std::sin(3.1 * t), dq = 1.3 * std::cos(1.3 * t) + 0.93 * std::cos(3.1 * t);
    const double tau = 2000 * std::cos(q) + 300 * std::sin(7 * t);
    const double torsion = tau / K + lag * dq + offset, noise = 3e-5 * numerics::normal({18, 0, 0, 0, k});
    fit.add(tau, dq, torsion);
    noisy.add(tau, dq, torsion + noise);
    unrelated.add(2000 * numerics::normal({18, 1, 0, 0, k}), dq, torsion + noise);
    xx += (tau - 1600) * (tau - 1600);
    xy += (tau - 1600) * (torsion - offset);
  }
  const Torsion exact = fit.solve(2500);
  EXPECT_NEAR(exact.K, K, 1e-6 * K);
  EXPECT_NEAR(exact.lag, lag, 1e-9);
  EXPECT_NEAR(exact.offset, offset, 1e-9);
  EXPECT_NEAR(exact.correlation, 1, 1e-6);
  const Torsion found = noisy.solve(2500);
  EXPECT_NEAR(found.K, K, 3 * found.deviation);
  EXPECT_LT(found.deviation, 0.02 * K);
  EXPECT_GT(noisy.solve(100).deviation, 4 * found.deviation);  // fewer independent samples
  EXPECT_EQ(unrelated.solve(2500).K, 0);
  EXPECT_EQ(TorsionFit().solve(10).K, 0);
  EXPECT_GT(std::abs(xy / xx - 1 / K), 0.5 / K);  // and without the lag it would be wrong by half
}

// A tool of 2 kg is mounted half-way: with forgetting, the result is the robot with the tool.
TEST(TorqueData, ForgettingFollowsARobotThatChanges) {
  robot::RobotModel loaded = lwr();
  loaded.bodies[6].inertia.mass += 2;
  const Samples before = simulate(lwr(), truth_of(lwr()), 4000, 0.02, 1);
  const Samples after = simulate(loaded, truth_of(loaded), 4000, 0.02, 2);
  TorqueData forgets(lwr(), {}, 0.995), keeps(lwr());
  for (TorqueData* data : {&forgets, &keeps}) {
    add(*data, before);
    add(*data, after);
    data->flush();
  }
  EXPECT_NEAR(forgets.weight(), 200, 0.1);
  EXPECT_LT(forgets.rms(truth_of(loaded)).maxCoeff(), 0.025);
  EXPECT_GT(keeps.rms(truth_of(loaded)).maxCoeff(), 0.5);
  EXPECT_LT(Problem(forgets, lwr()).sigma().maxCoeff(), 0.04);
}

TEST(Estimate, BecomesARobotWithItsHistory) {
  const Problem problem(compressed(lwr(), simulate(lwr(), truth_of(lwr()), 800, 0.1)), perturbed(lwr(), 0.3));
  const Estimate found = solve_feasible(problem).estimate;
  const robot::RobotModel tuned = with_bodies(lwr(), found, "tuned on a test");
  EXPECT_EQ(tuned.history.size(), lwr().history.size() + 7);
  EXPECT_EQ(tuned.history.back().reason, "tuned on a test");
  EXPECT_LT((estimate_of(tuned).pi - found.pi).norm(), 1e-12 * found.pi.norm());
}

}  // namespace
}  // namespace cotwin::identification::identification_test
