// Costs of a frame: effective mass, safety of persons, and cycles of a compliant frame whose parameters are variables beside the motion.
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>
#include <random>

#include "components/services/contact_service.h"
#include "components/services/services.h"
#include "models/foundation/support/error.h"
#include "models/optimisation/evaluation/quadrature.h"
#include "models/optimisation/search.h"
#include "models/robot/urdf/urdf.h"
#include "models/trajectory/bernstein.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::optimisation::frame_test {
namespace {

using numerics::Deviation;
using numerics::SecondOrder;

/// A carriage of 10 kg on a horizontal rail along x.
robot::RobotModel carriage() {
  return robot::parse_urdf(R"(<robot name="carriage"><link name="base"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="plate"/><axis xyz="1 0 0"/>
<limit lower="-5" upper="5" velocity="100" effort="150"/></joint>
<link name="plate"><inertial><mass value="10"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
</robot>)",
                           "carriage.urdf");
}

Problem problem_of(const robot::RobotModel& robot, std::vector<double> from, std::vector<double> to, double T, int degree) {
  Problem p;
  p.robot = robot;
  const std::vector<double> zero(from.size(), 0.0);
  p.ends = {from, zero, zero, to, zero, zero};
  p.T_min = p.T_max = T;
  p.degree = degree;
  p.bounds = bounds_of(robot);
  return p;
}

SearchOptions few(int rounds = 80) {
  SearchOptions options;
  options.particles = 64;
  options.rounds = rounds;
  return options;
}

CompliantFrame compliant(const robot::RobotModel& robot, ComplianceValues least, ComplianceValues most) {
  CompliantFrame frame;
  frame.frame = robot.end_effector();
  frame.axes = {{Eigen::Vector3d::UnitX(), least, most}};
  frame.load = 2;
  frame.settled = 1e-4;
  return frame;
}

TEST(SettledAfter, IsTheLastTimeOutsideOfTheBand) {
  std::mt19937 random(1);
  const auto between = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random()) / static_cast<double>(random.max());
  };
  int inside = 0, over = 0;
  for (int trial = 0; trial < 400; ++trial) {
    SecondOrder system;
    system.M = std::exp(between(-2, 2));
    system.S = std::exp(between(2, 9));
    const double zeta = trial % 10 == 0 ? 1 : std::exp(between(-3, 1.6)), omega = std::sqrt(system.S / system.M);
    system.D = 2 * zeta * std::sqrt(system.M * system.S);
    const Deviation start{between(-1, 1), between(-3, 3) * omega};
    const double band = std::exp(between(-5, 0.5));
    const double settled = settled_after(system, start, band);
    // Scan far beyond the slowest pole.
    const double slow = zeta > 1 ? omega / (2 * zeta) : omega * zeta, end = 12 / slow, step = std::min(end, 12 / omega) / 4000;
    double last = 0;
    bool any = false;
    Deviation at = start;
    for (double t = 0; t < end; t += step) {
      if (std::abs(at.x) > band) last = t, any = true;
      at = numerics::advance(system, at, 0, 0, step);
    }
    EXPECT_GE(settled, last - 1e-9 * end) << trial;
    EXPECT_LE(settled, any ? last + 1.001 * step : step) << trial;
    inside += !any;
    over += zeta > 1;
  }
  EXPECT_GT(inside, 10);
  EXPECT_GT(over, 50);
  // The step response of the service.
  for (const double D : {20.0, 60.0, 77.46, 200.0})
    EXPECT_NEAR(settled_after({1, D, 1500}, {1, 0}, 0.02), services::settling_time(1, D, 1500, 0.02), 1e-9);
}

// What swings after the motion without damping is the Fourier integral of the acceleration.
TEST(CompliantFrame, SwingsByTheFourierIntegralOfTheAcceleration) {
  const robot::RobotModel robot = carriage();
  const double T = 0.4, distance = 0.5, M = 3, S = 2000;
  const ComplianceValues values{M, 1e-9, S};
  Problem p = problem_of(robot, {0}, {distance}, T, 5);
  p.bounds.tau = {1e6};
  p.compliant = compliant(robot, values, values);
  p.costs = {{Quantity::kTime, 1, {}}};
  const Solution s = assess(p, {}, p.ends.q_to, T);
  ASSERT_EQ(s.status, Status::kFeasible) << s.reason;
  const double m = p.compliant->load, omega = std::sqrt(S / (M + m));
  std::complex<double> integral = 0;
  const Quadrature rule = gauss_legendre(60);
  for (std::size_t i = 0; i < rule.s.size(); ++i) {
    const double x = rule.s[i], t = T * x;
    const double a = distance / (T * T) * (60 * x - 180 * x * x + 120 * x * x * x);
    integral += rule.w[i] * T * a * std::polar(1.0, -omega * t);
  }
  const double amplitude = m / ((M + m) * omega) * std::abs(integral);
  // Deflections during the motion are larger here; the damping of the settling follows from the amplitude.
  EXPECT_GT(s.responses[0].deflection, amplitude);
  const double decay = values.D / (2 * (M + m));  // 1/s
  EXPECT_NEAR(s.responses[0].settle * decay, std::log(amplitude / p.compliant->settled), 1e-4);
}

// Brute force over shape, duration and damping, with Runge's method for the deflection, which is linear in c.
TEST(CompliantFrame, HasTheShortestCycleOfAGrid) {
  const robot::RobotModel robot = carriage();
  Problem p = problem_of(robot, {0}, {0.5}, 1, 7);
  p.T_min = 0.3;
  p.T_max = 1.2;
  p.samples = 80;
  p.compliant = compliant(robot, {3, 10, 2000}, {3, 400, 2000});
  p.compliant->T_process = 0.2;
  p.costs = {{Quantity::kCycle, 1, {}}};
  const Solution s = minimise(p, few(160));
  ASSERT_EQ(s.status, Status::kFeasible) << s.reason;
  EXPECT_NEAR(s.cost, s.T + s.responses[0].settle + 0.2, 1e-12);

  const double m = 2, distance = 0.5, effort = 150, mass = 10;
  const MotionBasis basis(7, true);
  constexpr int kSteps = 100;
  std::vector<std::array<double, 3>> shapes;  // q″ at half steps: of the quintic and of the two coefficients
  for (int i = 0; i <= 2 * kSteps; ++i) {
    const double x = 0.5 * i / kSteps;
    shapes.push_back({distance * trajectory::bernstein::evaluate(basis.points(1), x)[2],
                      trajectory::bernstein::evaluate(basis.points(2), x)[2],
                      trajectory::bernstein::evaluate(basis.points(3), x)[2]});
  }
  double best = 1e9, best_damping = 0;
  for (int i = 0; i <= 40; ++i) {
    const double T = 0.3 * std::pow(4, i / 40.0), h = T / kSteps;
    for (int k = 0; k <= 40; ++k) {
      const SecondOrder system{3 + m, 10 * std::pow(40, k / 40.0), 2000};
      std::array<Deviation, 3> at{};
      for (int step = 0; step < kSteps; ++step)
        for (std::size_t c = 0; c < 3; ++c) {
          const auto rate = [&](const Deviation& d, int half) {
            const double force = -m * shapes[static_cast<std::size_t>(2 * step + half)][c] / (T * T);
            return Deviation{d.dx, numerics::acceleration(system, d, force)};
          };
          const auto moved = [&](const Deviation& r, double by) { return Deviation{at[c].x + by * r.x, at[c].dx + by * r.dx}; };
          const Deviation a = rate(at[c], 0), b = rate(moved(a, h / 2), 1), e = rate(moved(b, h / 2), 1),
                          f = rate(moved(e, h), 2);
          at[c].x += h / 6 * (a.x + 2 * b.x + 2 * e.x + f.x);
          at[c].dx += h / 6 * (a.dx + 2 * b.dx + 2 * e.dx + f.dx);
        }
      for (int u = 0; u <= 60; ++u)
        for (int v = 0; v <= 60; ++v) {
          const double c_1 = distance * (0.4 * u - 12), c_2 = distance * (0.4 * v - 12);
          const Deviation end{at[0].x + c_1 * at[1].x + c_2 * at[2].x, at[0].dx + c_1 * at[1].dx + c_2 * at[2].dx};
          if (T + 0.2 >= best) continue;
          bool possible = true;
          for (std::size_t j = 0; j < shapes.size() && possible; j += 2)
            possible = mass * std::abs(shapes[j][0] + c_1 * shapes[j][1] + c_2 * shapes[j][2]) <= effort * T * T;
          if (!possible) continue;
          const double cycle = T + 0.2 + settled_after(system, end, 1e-4);
          if (cycle < best) best = cycle, best_damping = system.D;
        }
    }
  }
  EXPECT_LE(s.cost, 1.002 * best);
  EXPECT_GE(s.cost, 0.93 * best);  // the grid is coarse
  // The shortest motion alone, with the damping that is best after a step, has a longer cycle.
  p.costs = {{Quantity::kTime, 1, {}}};
  const Solution fastest = minimise(p, few(160));
  p.costs = {{Quantity::kCycle, 1, {}}};
  const double by_step = 2 * 0.78 * std::sqrt(5 * 2000);
  EXPECT_GT(assess(p, fastest.c, fastest.q_to, fastest.T, std::vector<ComplianceValues>{{3, by_step, 2000}}).cost,
            1.02 * s.cost)
      << best_damping;
}

TEST(CompliantFrame, IsAsSoftAsTheCycleAllows) {
  const robot::RobotModel robot = carriage();
  Problem p = problem_of(robot, {0}, {0.5}, 1, 6);
  p.T_min = 0.3;
  p.T_max = 1.2;
  p.samples = 80;
  p.compliant = compliant(robot, {3, 10, 500}, {3, 400, 4000});
  p.compliant->zeta_min = 0.5;
  p.costs = {{Quantity::kCycle, 1, {}}, {Quantity::kStiffness, 1, {}}};
  const Solution s = minimise_in_order(p, 0.05, few(40));
  ASSERT_EQ(s.status, Status::kFeasible) << s.reason;
  ASSERT_EQ(s.optima.size(), 2u);
  EXPECT_LE(s.costs[0], 1.05 * s.optima[0] * (1 + 1e-9));
  EXPECT_GE(damping_ratio(s.compliance[0], 2), 0.5 * (1 - 1e-6));
  EXPECT_NEAR(s.costs[1], s.compliance[0].S, 1e-9);
  p.costs.pop_back();
  const Solution alone = minimise(p, few(40));
  EXPECT_LE(alone.cost, 1.02 * s.optima[0]);
  EXPECT_LT(s.costs[1], 0.9 * 4000);
  // Impossible conditions are named.
  p.compliant->deflection_max = 1e-7;
  const Solution none = minimise(p, few(8));
  EXPECT_NE(none.status, Status::kFeasible);
  EXPECT_NE(none.reason.find("compliance: axis 1: deflection"), std::string::npos) << none.reason;
}

TEST(CompliantFrame, HasTheSameBitsOnAnyNumberOfThreads) {
  const robot::RobotModel robot = carriage();
  Problem p = problem_of(robot, {0}, {0.5}, 0.8, 6);
  p.samples = 80;
  p.compliant = compliant(robot, {1, 10, 500}, {3, 400, 4000});
  p.costs = {{Quantity::kCycle, 1, {}}};
  numerics::Threads threads(3);
  const Solution a = minimise(p, few(30)), b = minimise(p, few(30), &threads);
  EXPECT_EQ(a.c, b.c);
  EXPECT_EQ(a.compliance[0].D, b.compliance[0].D);
  EXPECT_EQ(a.cost, b.cost);
}

ContactFrame contact_of(const robot::RobotModel& robot) {
  ContactFrame contact;
  contact.frame = robot::on_body(robot.end_effector());
  robot::BodyPart chest;
  chest.name = "chest";
  chest.mass = 40;
  chest.stiffness = 25000;
  chest.transient.force = 280;
  contact.parts = {chest};
  return contact;
}

TEST(ContactFrame, HasTheLeastMassOfAGrid) {
  const robot::RobotModel robot = robot::load_urdf(places::source() + "/models/robots/planar2/robot.urdf");
  Problem p = problem_of(robot, {-0.4, 2.2}, {1.2, -1.0}, 4, 6);
  p.contact = contact_of(robot);
  p.contact->u = Eigen::Vector3d::UnitX();
  p.costs = {{Quantity::kMass, 1, {}}};
  const Solution s = minimise(p, few());
  ASSERT_EQ(s.status, Status::kFeasible) << s.reason;

  const Evaluator evaluator(p);
  const auto scratch = evaluator.scratch();
  Motions motions = evaluator.motions();
  Values values = evaluator.values();
  double best = 1e9, quintic = 0;
  for (int i = -40; i <= 40; ++i)
    for (int k = -40; k <= 40; k += 8) {
      for (int lane = 0; lane < 8; ++lane) {
        motions.c[static_cast<std::size_t>(lane)] = 0.8 * i;
        motions.c[kLanes + static_cast<std::size_t>(lane)] = 0.8 * (k + lane);
      }
      evaluator.evaluate(motions, *scratch, values);
      for (std::size_t lane = 0; lane < 8; ++lane) {
        if (values.kinematic[lane] > 0 || values.torque[lane] > 0) continue;
        best = std::min(best, values.costs[lane]);
        if (i == 0 && k + static_cast<int>(lane) == 0) quintic = values.costs[lane];
      }
    }
  ASSERT_LT(best, 1e9);
  EXPECT_LE(s.cost, 1.005 * best);
  EXPECT_LT(s.cost, 0.97 * quintic);

  services::Move move;
  move.from_q = p.ends.q_from;
  move.to_q = p.ends.q_to;
  move.T = s.T;
  move.degree = s.degree;
  move.c = s.c;
  services::ContactOptions options;
  options.u = p.contact->u;
  EXPECT_NEAR(s.cost, services::masses_along(robot, move, options).heaviest.mass, 2e-3 * s.cost);
}

TEST(ContactFrame, HasTheLeastPeakSpeedOfADegree) {
  const robot::RobotModel robot = carriage();
  Problem p = problem_of(robot, {0}, {0.5}, 2, 7);
  p.contact = contact_of(robot);
  p.costs = {{Quantity::kSafety, 1, {}}};
  const Solution s = minimise(p, few());
  ASSERT_EQ(s.status, Status::kFeasible) << s.reason;
  const double limit = robot::speed_limit_of_force(280, 25000, robot::reduced_mass(10, 40));
  EXPECT_NEAR(s.cost, 1.3776 * 0.5 / 2 / limit, 2e-3 * s.cost);  // docs/equations.md: least T q̇_max/Δ of degree 7
  services::Move move;
  move.from_q = p.ends.q_from;
  move.to_q = p.ends.q_to;
  move.T = s.T;
  move.degree = s.degree;
  move.c = s.c;
  services::ContactOptions options;
  options.parts = p.contact->parts;
  EXPECT_NEAR(s.cost, services::safety_along(robot, move, options).parts[0].effective.share, 1e-4 * s.cost);
}

TEST(ContactFrame, RefusesWhatIsIncomplete) {
  const robot::RobotModel robot = carriage();
  Problem p = problem_of(robot, {0}, {0.5}, 2, 7);
  const auto refusal = [&](Quantity quantity, const auto& change) {
    Problem own = p;
    own.costs = {{quantity, 1, {}}};
    change(own);
    return cotwin::testing::error_of([&] { check(own); });
  };
  const auto nothing = [](Problem&) {};
  EXPECT_EQ(refusal(Quantity::kMass, nothing),
            "optimisation: the cost 'effective_mass' has no frame, expected Problem::contact");
  EXPECT_EQ(refusal(Quantity::kCycle, nothing),
            "optimisation: the cost 'cycle_time' has no compliant frame, expected Problem::compliant");
  p.contact = contact_of(robot);
  p.compliant = compliant(robot, {1, 1, 1}, {2, 2, 2});
  EXPECT_EQ(refusal(Quantity::kSafety, nothing), "");
  EXPECT_EQ(refusal(Quantity::kSafety, [](Problem& own) { own.contact->parts.clear(); }),
            "optimisation: the cost 'safety' has no body part, expected at least one");
  EXPECT_EQ(refusal(Quantity::kSafety, [](Problem& own) { own.contact->transient = false; }),
            "optimisation: this contact with the body part chest is not permitted, expected another one for the cost 'safety'");
  EXPECT_EQ(refusal(Quantity::kMass, [](Problem& own) { own.contact->u = Eigen::Vector3d(0, 0, 2); }),
            "optimisation: the direction of the contact has the length 2, expected 1");
  EXPECT_EQ(refusal(Quantity::kCycle, [](Problem& own) { own.compliant->axes[0].most.D = 0.5; }),
            "compliance: D from 1 to 0.5, expected 0 < least <= most");
  EXPECT_EQ(refusal(Quantity::kCycle, [](Problem& own) { own.compliant->load = 0; }),
            "optimisation: the load of the compliant frame is 0, expected more than 0");
  EXPECT_EQ(refusal(Quantity::kCycle, [](Problem& own) { own.compliant->axes.clear(); }),
            "optimisation: the compliant frame has no axis, expected at least one");
}

}  // namespace
}  // namespace cotwin::optimisation::frame_test
