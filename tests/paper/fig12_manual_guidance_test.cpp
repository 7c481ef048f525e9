// VI-C, Fig. 12: a stiff robot is guided by hand through its twin. Without a suitable damping or inertia the loop of hand, sensor,
// twin, line and position control vibrates. The border of vibration in the simulation is compared with the prediction of
// models/guidance. The paper gives no numbers; those of examples/09_manual_guidance are our choice.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "models/guidance/border.h"
#include "models/support/text.h"
#include "tests/support/places.h"

namespace cotwin::master {
namespace {

const std::filesystem::path kExample = std::filesystem::path(places::source()) / "examples/09_manual_guidance";

/// The loop of axis.ssd.
guidance::Loop loop_of_axis(double d) {
  return {.m_h = 0.7,
          .D_h = 20,
          .K_h = 400,
          .D_g = 50,
          .K_g = 5000,
          .cutoff = 40,
          .delay = 2 * d,
          .omega = 150,
          .mass = 21,
          .h = 1e-3};
}

/// A scenario of the example, with the names of the twin's inertia and damping and the axis along which it is pushed.
struct Guided {
  const char* file;
  const char* inertia;
  const char* damping;
  std::size_t axis;
};
constexpr Guided kAxis{"axis.ssd", "twin.M_a", "twin.D_a", 0}, kTool{"twin.ssd", "twin.M_T", "twin.D_T", 1};

/// Whether the vibration after a small move grows: the force in the last quarter of `duration` against that in the quarter before.
bool vibrates(const Guided& guided, const guidance::Loop& loop, double M, double D, double duration) {
  Scenario scenario = load_scenario(kExample / guided.file);
  const auto set = [&](const std::string& name, double value) { assign(scenario, name + "=" + text::to_text(value)); };
  set("operator.m_h", loop.m_h);
  set("operator.D_h", loop.D_h);
  set("operator.K_h", loop.K_h);
  set(guided.inertia, M);
  set(guided.damping, D);
  set("sensor.delay", loop.delay / 2);
  set("line.delay", loop.delay / 2);
  set("controller.omega", loop.omega);
  set("sensor.tau_e_cutoff", loop.cutoff);
  if (loop.K_J > 0) {
    assign(scenario, "robot.transmission=flexible", unit_types());
    for (const std::string unit : {"robot", "controller"}) {
      set(unit + ".K", loop.K_J);
      set(unit + ".B", loop.B);
    }
  }
  if (guided.axis == 1) {
    assign(scenario, "operator.waypoint_t=0 0.2 0.4");
    assign(scenario, "operator.waypoint_dwell=0");
    assign(scenario, "operator.waypoint_p=0 0 0 0 0.003 0 0 0.003 0");
  }
  MasterOptions options;
  options.types = unit_types();
  options.folders = {kExample, std::filesystem::path(places::source()) / "models"};
  Master master(std::move(scenario), std::move(options));
  master.initialise();
  const double& f = find_real_signal(master.members(), "operator.f", "test").reals()[guided.axis];
  double before = 0, last = 0;
  constexpr double kForce = 200;  // N: far above that of the move, 4 N
  while (master.now().seconds() < duration && std::abs(f) < kForce) {
    if (!master.step_tick()) break;
    const double t = master.now().seconds();
    if (t > 0.5 * duration) (t > 0.75 * duration ? last : before) += f * f;
  }
  return std::abs(f) >= kForce || last > before;
}

struct Case {
  double M, d;  // kg, s
};

class Fig12Chart : public testing::TestWithParam<Case> {};

TEST_P(Fig12Chart, BorderOfVibrationIsThePredictedOneToFivePercent) {
  const auto [M, d] = GetParam();
  const guidance::Loop loop = loop_of_axis(d);
  const guidance::Border predicted = guidance::damping_border(loop, M);
  const double duration = std::clamp(25 * 2 * std::numbers::pi / predicted.omega, 2.0, 19.0);
  EXPECT_TRUE(vibrates(kAxis, loop, M, 0.95 * predicted.D, duration)) << predicted.D << " N.s/m";
  EXPECT_FALSE(vibrates(kAxis, loop, M, 1.05 * predicted.D, duration)) << predicted.D << " N.s/m";
}

TEST(Fig12, EitherDampingOrInertiaCancelsTheVibration) {
  const guidance::Loop loop = loop_of_axis(0.01);
  EXPECT_TRUE(vibrates(kAxis, loop, 0.25, 10, 4));
  EXPECT_FALSE(vibrates(kAxis, loop, 0.25, 50, 4)) << "more damping";
  EXPECT_FALSE(vibrates(kAxis, loop, 2, 10, 4)) << "more inertia";
}

// A gear between motor and carriage lets the carriage swing. The loop excites it, and needs much more damping.
TEST(Fig12, BorderOfAnElasticAxisIsThePredictedOneToFivePercent) {
  for (const auto& [M, d] : {Case{10, 0.005}, Case{1, 0.01}, Case{0.5, 0.04}}) {
    guidance::Loop loop = loop_of_axis(d);
    loop.K_J = 40'000;
    loop.B = 8;
    loop.mass = 28;
    const double D = guidance::damping_border(loop, M).D;
    EXPECT_GT(D, 1.5 * guidance::damping_border(loop_of_axis(d), M).D);
    EXPECT_TRUE(vibrates(kAxis, loop, M, 0.95 * D, 18)) << M << " kg, " << D << " N.s/m";
    EXPECT_FALSE(vibrates(kAxis, loop, M, 1.05 * D, 18)) << M << " kg, " << D << " N.s/m";
  }
}

// The tool of the LWR 4+ with its elastic joints and their friction: where the vibration is slow against the position control and
// the joints, the loop is that of the axis, with an effective mass of the tool of 3.5 kg.
TEST(Fig12, BorderOfTheElasticArmIsThatOfTheAxisForSlowVibrations) {
  guidance::Loop loop = loop_of_axis(0.04);
  loop.mass = 3.5;
  for (const double M : {2.0, 10.0}) {
    const double D = guidance::damping_border(loop, M).D;
    EXPECT_TRUE(vibrates(kTool, loop, M, 0.95 * D, 7.9)) << M << " kg, " << D << " N.s/m";
    EXPECT_FALSE(vibrates(kTool, loop, M, 1.05 * D, 7.9)) << M << " kg, " << D << " N.s/m";
  }
}

INSTANTIATE_TEST_SUITE_P(Loop, Fig12Chart,
                         testing::Values(Case{0.25, 0.005}, Case{0.5, 0.005}, Case{0.25, 0.01}, Case{0.5, 0.01},
                                         Case{0.25, 0.02}, Case{0.5, 0.02}, Case{1, 0.04}, Case{5, 0.04}, Case{20, 0.04}),
                         [](const auto& chart) {
                           return "M" + std::to_string(std::lround(1000 * chart.param.M)) + "gD" +
                                  std::to_string(std::lround(1000 * chart.param.d)) + "ms";
                         });

}  // namespace
}  // namespace cotwin::master
