// The cost "energy" against the books of models/energetics, which integrate the same motion on another grid.
#include <gtest/gtest.h>

#include <cmath>

#include "models/energetics/motion_energy.h"
#include "models/foundation/support/error.h"
#include "models/optimisation/search.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/energetics/electrical_data.h"
#include "tests/support/places.h"

namespace cotwin::optimisation::energy_test {
namespace {

struct Case {
  const char* robot;
  std::vector<double> from, to;
  double T;
};

const Case kCases[] = {
    {"lwr4", {0, 0.5, 0, -1, 0, 0.6, 0}, {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}, 1.5},
    {"kr300_r2500", {0, -1.2, 1.2, 0, 0.4, 0}, {1.2, -1.9, 1.8, 0.5, -0.8, 1}, 1.6},
};

Problem problem_of(const Case& c, energetics::Bus bus, int degree) {
  const std::string folder = places::source() + "/models/robots/" + c.robot;
  Problem p;
  p.robot = robot::load_urdf(folder + "/robot.urdf");
  const std::vector<double> zero(c.from.size(), 0.0);
  p.ends = {c.from, zero, zero, c.to, zero, zero};
  p.T_min = p.T_max = c.T;
  p.degree = degree;
  p.bounds = bounds_of(p.robot);
  p.drives.B.assign(c.from.size(), 0.3);
  p.drives.sigma2.assign(c.from.size(), 2);
  p.electrical = testing::load_electrical(folder + "/energy.ssv", c.from.size());
  p.electrical->bus = bus;
  p.electrical->supply.eta_r = 0.7;
  p.costs = {{Quantity::kEnergy, 1, {}}};
  return p;
}

/// Energy drawn for the motion of the solution by the books, J.
double booked(const Problem& p, const Solution& s) {
  energetics::RigidRobot robot(p.robot);
  robot.B = p.drives.B;
  robot.sigma = p.drives.sigma2;
  energetics::Accountant accountant(p.robot.joints.size(), p.electrical->bus);
  accountant.losses = p.electrical->losses;
  accountant.current = p.electrical->current;
  accountant.link = p.electrical->link;
  accountant.supply = p.electrical->supply;
  return energetics::energy_of_motion(robot, s.path, accountant, p.electrical->standby).books.drawn;
}

TEST(EnergyCost, AgreesWithTheBooksOfTheMotionForEveryBus) {
  for (const Case& c : kCases)
    for (const auto bus : {energetics::Bus::kSeparate, energetics::Bus::kShared, energetics::Bus::kGrid}) {
      const Problem p = problem_of(c, bus, 7);
      std::vector<double> shape(2 * c.from.size());
      for (std::size_t i = 0; i < shape.size(); ++i) shape[i] = 0.1 * std::sin(static_cast<double>(i * i));
      const Solution s = assess(p, shape, p.ends.q_to, p.T_min);
      const double expected = booked(p, s);
      EXPECT_NEAR(s.cost, expected, 2e-4 * expected) << c.robot << ", bus " << static_cast<int>(bus);
    }
}

TEST(EnergyCost, FindsACheaperMotionThatTheBooksConfirm) {
  for (const Case& c : kCases) {
    Problem p = problem_of(c, energetics::Bus::kShared, 8);
    p.samples = 96;
    SearchOptions options;
    options.particles = 48;
    options.rounds = 60;
    const Solution best = minimise(p, options);
    ASSERT_EQ(best.status, Status::kFeasible) << best.reason;
    EXPECT_NEAR(best.cost, booked(p, best), 1e-3 * best.cost);
    Problem quintic = p;
    quintic.degree = 5;
    const Solution plain = assess(quintic, {}, p.ends.q_to, p.T_min);
    EXPECT_LT(best.cost, 0.99 * booked(quintic, plain)) << c.robot;
  }
}

// Without a load, E = P T / η + copper of ∫ τ² dt / η with ∫ τ² dt = (120/7) M² Δ² / T³: dE/dT = 0 at T⁴ = 3 r (120/7) M² Δ² / P.
TEST(EnergyCost, ChoosesTheDurationAtWhichStandbyAndCopperBalance) {
  Problem p;
  p.robot = robot::load_urdf(places::source() + "/models/robots/planar2/robot.urdf");
  p.robot.joints.resize(1);
  p.robot.bodies.resize(1);
  std::erase_if(p.robot.frames, [](const robot::Frame& f) { return f.body > 0; });
  p.robot.gravity.setZero();
  Inertia inertia;
  inertia.mass = 1;
  inertia.I_CC = 2 * Eigen::Matrix3d::Identity();
  p.robot.bodies[0].inertia = inertia;
  p.ends = {{0}, {0}, {0}, {1.5}, {0}, {0}};
  p.T_min = 0.2;
  p.T_max = 20;
  p.degree = 5;
  p.bounds = bounds_of(p.robot);
  p.bounds.dq = p.bounds.tau = {1e9};
  Electrical e;
  e.losses = energetics::DriveLosses(1);
  e.losses.R = {0.5};
  e.losses.k_t = {5};
  e.bus = energetics::Bus::kGrid;  // what comes back is fed back without loss
  e.standby.P_0 = 40;
  e.supply.efficiency = 1;
  p.electrical = e;
  p.costs = {{Quantity::kEnergy, 1, {}}};
  SearchOptions options;
  options.particles = 40;
  options.rounds = 100;
  const Solution s = minimise(p, options);
  const double r = 0.5 / 25, T = std::pow(3 * r * (120.0 / 7) * 4 * 2.25 / 40, 0.25);
  EXPECT_NEAR(s.T, T, 1e-3 * T);
  EXPECT_NEAR(s.cost, 40 * T + r * (120.0 / 7) * 4 * 2.25 / (T * T * T), 1e-4 * s.cost);
}

TEST(EnergyCost, IsRefusedWithoutElectricalData) {
  Problem p = problem_of(kCases[0], energetics::Bus::kShared, 7);
  p.electrical->losses.k_t[2] = 0;
  EXPECT_THROW(check(p), Error);
  p.electrical->losses.k_t.pop_back();
  EXPECT_THROW(check(p), Error);
  p.electrical.reset();
  EXPECT_THROW(check(p), Error);
}

}  // namespace
}  // namespace cotwin::optimisation::energy_test
