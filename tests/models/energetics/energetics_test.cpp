// Energy of drives, DC links and motions against closed forms, a second formulation and conservation of energy.
#include "models/energetics/motion_energy.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include "models/energetics/waiting.h"
#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "models/trajectory/bernstein.h"
#include "models/trajectory/waypoints.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::energetics::energetics_test {
namespace {

using cotwin::testing::error_of;
using trajectory::Path;

constexpr double kNever = std::numeric_limits<double>::infinity();

double sum(const std::vector<double>& x) { return std::accumulate(x.begin(), x.end(), 0.0); }

robot::RobotModel shipped(const std::string& name) {
  return robot::load_urdf(places::source() + "/models/robots/" + name + "/robot.urdf");
}

/// One joint about a vertical axis with the moment of inertia M.
robot::RobotModel turntable(double M) {
  const std::string m = std::to_string(M);
  return robot::parse_urdf(R"(<robot name="turntable"><link name="base"/>
    <joint name="j" type="revolute"><parent link="base"/><child link="plate"/><axis xyz="0 0 1"/>
      <limit lower="-9" upper="9" velocity="9" effort="99"/></joint>
    <link name="plate"><inertial><mass value="10"/><inertia ixx=")" +
                               m + R"(" ixy="0" ixz="0" iyy=")" + m + R"(" iyz="0" izz=")" + m +
                               R"("/></inertial></link></robot>)",
                           "turntable");
}

/// Copper losses of k τ², no other.
Accountant copper_only(std::size_t joints, Bus bus, double k) {
  Accountant accountant(joints, bus);
  accountant.losses.R.assign(joints, k);
  accountant.losses.k_t.assign(joints, 1);
  return accountant;
}

Path quintic(double distance, double T) {
  return trajectory::make_path({1, {0, T}, {0, distance}, {}, {}}, trajectory::Passing::kRest);
}

/// A path of one joint, of quadratics: durations and accelerations of its parts.
Path parabolas(const std::vector<std::pair<double, double>>& parts) {
  std::vector<double> t{0}, control;
  double q = 0, dq = 0;
  for (const auto& [h, ddq] : parts) {
    const double end = q + h * dq + 0.5 * h * h * ddq;
    const std::vector<double> quadratic = {q, q + 0.5 * h * dq, end};
    const std::vector<double> five = trajectory::bernstein::elevate(quadratic, 5);
    control.insert(control.end(), five.begin(), five.end());
    q = end;
    dq += h * ddq;
    t.push_back(t.back() + h);
  }
  return Path(1, t, 5, control);
}

TEST(Cubic, ThroughTheNodesIsThePolynomialAndItsPartsAreItsAreas) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 2000; ++trial) {
    const Cubic p = {normal(random), normal(random) * 3, normal(random) * 5, trial % 5 == 0 ? 0.0 : normal(random) * 5};
    std::array<double, kNodes> at{};
    double gauss = 0;
    for (std::size_t k = 0; k < kNodes; ++k) {
      at[k] = value(p, kNode[k]);
      gauss += kWeight[k] * at[k];
    }
    const Cubic same = through(at);
    for (std::size_t k = 0; k < 4; ++k) ASSERT_NEAR(same[k], p[k], 1e-12) << trial;
    EXPECT_NEAR(gauss, integral(p, 1), 1e-13);
    Parts brute;
    constexpr int kParts = 4000;
    for (int k = 0; k < kParts; ++k) {
      const double area = integral(p, (k + 1.0) / kParts) - integral(p, k / double(kParts));
      (area > 0 ? brute.positive : brute.negative) += area;
    }
    const Parts exact = parts(p);
    EXPECT_NEAR(exact.positive, brute.positive, 1e-5) << trial;
    EXPECT_NEAR(exact.positive + exact.negative, integral(p, 1), 1e-13) << trial;
    const Crossings zeros = crossings(p);
    for (std::size_t k = 0; k < zeros.count; ++k) EXPECT_NEAR(value(p, zeros.s[k]), 0, 1e-11) << trial;
  }
}

TEST(DcLink, ChargesAsTheSquareRootOfTheEnergyAndChopsTheRest) {
  const DcLink link{.C = 0.01, .V_min = 48, .V_max = 60};
  LinkFlows flows;
  // C U U̇ = −P: U² = U₀² + 2 E/C; 6.48 J fill the capacitor.
  EXPECT_NEAR(draw(link, 48, {-5, 0, 0, 0}, 1, flows), std::sqrt(48 * 48 + 2 * 5 / 0.01), 1e-12);
  EXPECT_EQ(flows.chopped, 0);
  EXPECT_NEAR(draw(link, 48, {-10, 0, 0, 0}, 1, flows), 60, 1e-12);
  EXPECT_NEAR(flows.chopped, 10 - 0.5 * 0.01 * (60 * 60 - 48 * 48), 1e-12);
  EXPECT_EQ(flows.supplied, 0);
  // Returned and taken again within one interval: +10 − 20 s crosses zero at half; 2.5 J go in and out.
  flows = {};
  EXPECT_NEAR(draw(link, 48, {-10, 20, 0, 0}, 1, flows), 48, 1e-12);
  EXPECT_NEAR(flows.supplied, 0, 1e-12);
  // The other way round the rectifier has to feed first, and the link keeps what comes back.
  flows = {};
  EXPECT_NEAR(draw(link, 48, {10, -20, 0, 0}, 1, flows), std::sqrt(48 * 48 + 2 * 2.5 / 0.01), 1e-12);
  EXPECT_NEAR(flows.supplied, 2.5, 1e-12);
}

TEST(DcLink, AgreesWithSmallStepsOfTheDifferentialEquation) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int trial = 0; trial < 40; ++trial) {
    const DcLink link{.C = 0.004 + 0.003 * uniform(random), .V_min = 48, .V_max = 55 + 5 * uniform(random)};
    const Cubic p = {40 * uniform(random), 100 * uniform(random), 200 * uniform(random), 200 * uniform(random)};
    const double h = 0.3, start = 48 + (link.V_max - 48) * (0.5 + 0.5 * uniform(random));
    LinkFlows exact, small;
    const double V = draw(link, start, p, h, exact);
    double U = start;
    constexpr int kSteps = 100000;
    for (int k = 0; k < kSteps; ++k) {
      const double power = value(p, (k + 0.5) / kSteps);
      U -= power / (link.C * U) * h / kSteps;
      if (U < link.V_min) small.supplied += link.stored(link.V_min) - link.stored(U);
      if (U > link.V_max) small.chopped += link.stored(U) - link.stored(link.V_max);
      U = std::clamp(U, link.V_min, link.V_max);
    }
    EXPECT_NEAR(V, U, 2e-3) << trial;
    EXPECT_NEAR(exact.supplied, small.supplied, 3e-3) << trial;
    EXPECT_NEAR(exact.chopped, small.chopped, 3e-3) << trial;
  }
}

TEST(Drives, OfAPermanentMagnetMotorLoseTheSameInEveryConvention) {
  // Amplitude-invariant dq: P = 1.5 R i_q² = 3 R i_rms², k_t per rms ampere is √2 larger; τ = 1.5 p ψ i_q.
  constexpr double R = 0.7, pairs = 5, flux = 0.02, gear = 101, tau = 80;
  const double k_peak = 1.5 * pairs * flux * gear, k_e = pairs * flux * gear;
  EXPECT_NEAR(k_peak / k_e, 1.5, 1e-15);
  const double expected = 1.5 * R * std::pow(tau / k_peak, 2);
  for (const auto& [current, k_t, resistance] :
       {std::tuple{Current::kPeak, k_peak, R}, std::tuple{Current::kRms, k_peak * std::sqrt(2.0), R},
        std::tuple{Current::kDc, k_peak, 1.5 * R}}) {
    Accountant drive(1, Bus::kShared);
    drive.losses.R = {resistance};
    drive.losses.k_t = {k_t};
    drive.current = current;
    drive.adopt();
    const double torque[] = {tau};
    EXPECT_NEAR(drive.holding_power(torque), expected, 1e-12 * expected);
  }
  EXPECT_EQ(parse_current("x", "rms"), Current::kRms);
  EXPECT_NE(error_of([] { parse_current("drives.current", "RMS"); }).find("dc, peak, rms"), std::string::npos);
}

TEST(MotionEnergy, OfTheQuinticIsTheClosedForm) {
  constexpr double M = 2.3, D = 1.7, T = 0.9;
  const RigidRobot robot(turntable(M));
  const double W = 0.5 * M * std::pow(1.875 * D / T, 2);
  EXPECT_NEAR(W, 1.7578125 * M * D * D / (T * T), 1e-12);
  for (const Bus bus : {Bus::kSeparate, Bus::kShared, Bus::kGrid}) {
    Accountant accountant = copper_only(1, bus, 0);
    const MotionEnergy e = energy_of_motion(robot, quintic(D, T), accountant, {});
    EXPECT_NEAR(e.books.mechanical_positive[0], W, 1e-9 * W);
    EXPECT_NEAR(e.books.mechanical_negative[0], -W, 1e-9 * W);
    EXPECT_NEAR(e.books.drawn, bus == Bus::kGrid ? 0 : W, 1e-9 * W);  // without a capacitor what comes back is chopped
    EXPECT_NEAR(e.books.link.chopped, bus == Bus::kGrid ? 0 : W, 1e-9 * W);
    EXPECT_NEAR(e.books.link.returned, bus == Bus::kGrid ? W : 0, 1e-9 * W);
  }
  Accountant large = copper_only(1, Bus::kShared, 0);
  large.link = {.C = 1, .V_min = 48, .V_max = 60};
  const MotionEnergy e = energy_of_motion(robot, quintic(D, T), large, {});
  EXPECT_NEAR(e.books.stored, W, 1e-9 * W);
  EXPECT_EQ(e.books.link.chopped, 0);
  EXPECT_NEAR(e.V, std::sqrt(48 * 48 + 2 * W), 1e-9);
  // Next time the same motion costs nothing: the ideal shared link.
  EXPECT_NEAR(energy_of_motion(robot, quintic(D, T), large, {}, 1, e.V).books.drawn, 0, 1e-9 * W);
}

TEST(MotionEnergy, CopperAndViscousLossesAreThoseOfTheProfileOfSpeed) {
  constexpr double M = 1.4, D = 0.8, T = 1.3, k = 0.05, sigma = 3;
  RigidRobot robot(turntable(M));
  robot.sigma = {sigma};
  const auto copper = [&](const Path& path) {
    Accountant accountant = copper_only(1, Bus::kGrid, k);
    RigidRobot frictionless(turntable(M));
    return sum(energy_of_motion(frictionless, path, accountant, {}).books.copper) / (k * M * M * D * D / (T * T * T));
  };
  EXPECT_NEAR(copper(quintic(D, T)), 120.0 / 7, 1e-9);
  const double a3 = 4.5 * D / (T * T);  // equal thirds: top speed 1.5 D/T after T/3
  EXPECT_NEAR(copper(parabolas({{T / 3, a3}, {T / 3, 0}, {T / 3, -a3}})), 13.5, 1e-9);
  EXPECT_NEAR(copper(parabolas({{T / 2, 4 * D / (T * T)}, {T / 2, -4 * D / (T * T)}})), 16, 1e-9);
  const std::vector<double> cubic = {0, 0, D, D};  // q̇ parabolic: the least
  EXPECT_NEAR(copper(Path(1, {0, T}, 5, trajectory::bernstein::elevate(cubic, 5))), 12, 1e-9);
  Accountant accountant = copper_only(1, Bus::kGrid, 0);
  EXPECT_NEAR(energy_of_motion(robot, quintic(D, T), accountant, {}).friction, 10.0 / 7 * sigma * D * D / T, 1e-9);
  // Coulomb friction takes τ_C Δ at every speed.
  robot.sigma = {0};
  robot.tau_C = {4};
  for (const double stretch : {0.3, 1.0, 7.0})
    EXPECT_NEAR(energy_of_motion(robot, quintic(D, T), accountant, {}, stretch).friction, 4 * D, 1e-9);
}

Path random_motion(std::size_t n, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<double> q(4 * n);
  for (double& x : q) x = uniform(random);
  return trajectory::make_path({n, {0, 0.7, 1.1, 2}, q, {}, {}}, trajectory::Passing::kThrough);
}

TEST(EnergyBooks, CloseForEveryRobotMotionAndSupply) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (const std::string name : {"lwr4", "kr300_r2500", "planar2"}) {
    const robot::RobotModel model = shipped(name);
    RigidRobot robot(model);
    for (int trial = 0; trial < 12; ++trial) {
      const auto bus = static_cast<Bus>(trial % 3);
      Accountant accountant(robot.n(), bus);
      for (std::size_t j = 0; j < robot.n(); ++j) {
        robot.B[j] = uniform(random);
        robot.tau_C[j] = 5 * uniform(random);
        robot.sigma[j] = 5 * uniform(random);
        robot.tau_0[j] = uniform(random);
        accountant.losses.R[j] = uniform(random);
        accountant.losses.k_t[j] = 1 + 10 * uniform(random);
        accountant.losses.V_0[j] = uniform(random);
        accountant.losses.k_h[j] = uniform(random);
        accountant.losses.k_e[j] = uniform(random);
      }
      accountant.current = static_cast<Current>(trial % 3);
      accountant.link = {.C = trial % 2 ? 0.02 : 0, .V_min = 48, .V_max = 58};
      accountant.supply = {.efficiency = 0.85, .eta_r = 0.7};
      const MotionEnergy e = energy_of_motion(robot, random_motion(robot.n(), random), accountant,
                                              {.P_0 = 20, .P_brake = 3, .controller = 50}, 0.5 + uniform(random));
      EXPECT_GT(e.books.drawn, 100);
      EXPECT_NEAR(e.books.residual(), 0, 1e-12 * e.books.drawn) << name << trial;
      // Work is the rise of energy and friction: an independent quadrature of the dynamics.
      EXPECT_NEAR(e.residual(), 0, 1e-9 * e.books.drawn) << name << trial;
      EXPECT_GE(e.books.link.chopped, 0);
      EXPECT_GE(e.books.regenerable, 0);
      if (bus != Bus::kGrid) {
        EXPECT_EQ(e.books.link.returned, 0);
      }
    }
  }
}

TEST(EnergyBooks, JointsOnOneLinkNeverCostMoreThanOnSeparateRectifiers) {
  std::mt19937 random(5);
  const RigidRobot robot(shipped("lwr4"));
  for (int trial = 0; trial < 5; ++trial) {
    const Path path = random_motion(robot.n(), random);
    double before = kNever;
    for (const Bus bus : {Bus::kSeparate, Bus::kShared, Bus::kGrid}) {
      Accountant accountant = copper_only(robot.n(), bus, 0.002);
      const double drawn = energy_of_motion(robot, path, accountant, {}).books.drawn;
      EXPECT_LT(drawn, before);
      before = drawn;
    }
  }
}

TEST(EnergyOfMotion, IsLeastAtTheReferenceDuration) {
  // specifications.md section 3: M = 2, load 5 N·m, Δ = 1.5 rad: T* = 2.07432 s, ∫τ² = 69.1442; the load takes 5 · 1.5 J.
  RigidRobot robot(turntable(2));
  robot.tau_0 = {5};
  Accountant accountant = copper_only(1, Bus::kGrid, 1);
  const auto drawn = [&](double T) { return energy_of_motion(robot, quintic(1.5, 1), accountant, {}, T).books.drawn; };
  double low = 0.5, high = 10;
  while (high - low > 1e-6) {
    const double a = low + (high - low) / 3, b = high - (high - low) / 3;
    (drawn(a) < drawn(b) ? high : low) = drawn(a) < drawn(b) ? b : a;
  }
  EXPECT_NEAR(low, 2.07432, 5e-6);
  EXPECT_NEAR(drawn(low) - 7.5, 69.1442, 5e-5);
}

TEST(Waiting, ClosesTheBrakesWhenItPays) {
  const Standby s{.P_0 = 37, .P_off = 12, .P_brake = 5, .E_release = 30, .t_close = 0.2, .t_release = 0.3};
  const double P_hold = 2;
  const Waiting w = wait(s, P_hold, 0);
  EXPECT_NEAR(w.break_even, 0.5 + 30.0 / 32, 1e-12);
  EXPECT_FALSE(wait(s, P_hold, w.break_even - 1e-6).closes);
  EXPECT_TRUE(wait(s, P_hold, w.break_even + 1e-6).closes);
  EXPECT_NEAR(wait(s, P_hold, 10).energy, 44 * 0.5 + 12 * 9.5 + 30, 1e-12);
  EXPECT_EQ(wait(s, P_hold, 0.4).closed, kNever);
  // Where servo off saves nothing, brakes stay open.
  EXPECT_EQ(wait({.P_0 = 37, .P_off = 40}, 0, 100).break_even, kNever);
}

TEST(MotionEnergy, RefusesWhatItCannotCompute) {
  const RigidRobot robot(turntable(1));
  Accountant accountant(1, Bus::kShared);
  EXPECT_NE(error_of([&] { energy_of_motion(robot, quintic(1, 1), accountant, {}, 0); }), "");
  EXPECT_NE(error_of([&] { energy_of_motion(robot, quintic(1, 1), accountant, {}, std::nan("")); }), "");
  accountant.losses.k_t = {0};
  EXPECT_NE(error_of([&] { energy_of_motion(robot, quintic(1, 1), accountant, {}); }).find("k_t[1]"), std::string::npos);
  accountant.losses.k_t = {1};
  accountant.link.V_max = 40;
  EXPECT_NE(error_of([&] { energy_of_motion(robot, quintic(1, 1), accountant, {}); }).find("V_max"), std::string::npos);
  accountant.link.V_max = 60;
  accountant.supply.efficiency = 0;
  EXPECT_NE(error_of([&] { energy_of_motion(robot, quintic(1, 1), accountant, {}); }).find("efficiency"), std::string::npos);
  accountant.supply.efficiency = 1;
  const RigidRobot two(shipped("planar2"));
  EXPECT_NE(error_of([&] { energy_of_motion(two, quintic(1, 1), accountant, {}); }), "");
}

}  // namespace
}  // namespace cotwin::energetics::energetics_test
