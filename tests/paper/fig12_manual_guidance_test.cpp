// VI-C, Fig. 12: a stiff robot is guided by hand through its twin. Without a suitable damping or inertia the loop of hand, sensor,
// twin, line and position control vibrates. The border of vibration in the simulation is compared with the prediction of
// models/control. The paper gives no numbers; those of examples/09_manual_guidance are our choice.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "models/control/guidance.h"
#include "models/foundation/support/text.h"
#include "tests/support/places.h"

namespace cotwin::master::fig12_manual_guidance_test {
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

// ----- chart.svg of the example: lines are predicted, circles measured.

constexpr double kInertias[] = {0.25, 0.28, 0.32, 0.36, 0.4, 0.44, 0.48, 0.52, 0.55, 0.58, 0.6, 0.62, 0.65, 0.68,
                                0.7,  0.75, 0.8,  0.9,  1,   1.3,  1.6,  2,    3,    5,    7,   10,   14,   20};
struct Line {
  double d;  // s
  const char* colour;
};
constexpr Line kLines[] = {{0.005, "#1b7837"}, {0.01, "#2166ac"}, {0.02, "#b35806"}, {0.04, "#b2182b"}};

int right(double M) { return static_cast<int>(std::lround(60 + 480 * std::log(M / 0.25) / std::log(80))); }
int up(double D) { return static_cast<int>(std::lround(310 - 290. / 45 * D)); }

std::string line_of(const Line& line) {
  std::string path = "<path d=\"";
  for (const double M : kInertias) {
    path += (M == kInertias[0] ? "M" : "L") + std::to_string(right(M)) + " " +
            std::to_string(up(guidance::damping_border(loop_of_axis(line.d), M).D));
  }
  return path + "\" fill=\"none\" stroke=\"" + line.colour + "\" stroke-width=\"2\"/>\n";
}

/// Bisection with the simulation, to 0.6 %.
double measured_border(double M, double d) {
  const guidance::Loop loop = loop_of_axis(d);
  const guidance::Border predicted = guidance::damping_border(loop, M);
  if (predicted.D == 0) return 0;
  const double duration = std::clamp(25 * 2 * std::numbers::pi / predicted.omega, 2.0, 19.0);
  double low = 0.9 * predicted.D, high = 1.1 * predicted.D;
  for (int k = 0; k < 5; ++k) (vibrates(kAxis, loop, M, (low + high) / 2, duration) ? low : high) = (low + high) / 2;
  return (low + high) / 2;
}

std::string chart() {
  std::string svg =
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"360\" font-family=\"sans-serif\" font-size=\"12\">\n"
      "<rect width=\"560\" height=\"360\" fill=\"white\"/>\n"
      "<path d=\"M60 20V310H540\" fill=\"none\" stroke=\"black\"/>\n";
  for (const double M : {0.25, 0.5, 1., 2., 5., 10., 20.}) {
    const std::string x = std::to_string(right(M));
    svg += "<text x=\"" + x + "\" y=\"326\" text-anchor=\"middle\">" + text::to_text(M) + "</text><path d=\"M" + x +
           " 310v4\" stroke=\"black\"/>\n";
  }
  for (const int D : {0, 10, 20, 30, 40}) {
    svg += "<text x=\"52\" y=\"" + std::to_string(up(D) + 4) + "\" text-anchor=\"end\">" + std::to_string(D) +
           "</text><path d=\"M60 " + std::to_string(up(D)) + "h-4\" stroke=\"black\"/>\n";
  }
  svg +=
      "<text x=\"300\" y=\"346\" text-anchor=\"middle\">inertia M of the twin [kg]</text><text transform=\"translate(18 165) "
      "rotate(-90)\" text-anchor=\"middle\">damping D [N·s/m]</text>\n"
      "<text x=\"300\" y=\"36\">above a line: stable; below: vibrates</text><text x=\"300\" y=\"52\">lines predicted, "
      "circles measured</text>\n";
  int row = 72;
  for (const Line& line : kLines) {
    svg += line_of(line) + "<text x=\"300\" y=\"" + std::to_string(row) + "\" fill=\"" + line.colour + "\">delay 2 × " +
           text::to_text(1e3 * line.d) + " ms</text>\n";
    row += 16;
    for (const double M : {0.25, 0.35, 0.5, 0.7, 1., 2., 5., 10., 20.}) {
      const double D = measured_border(M, line.d);
      if (D == 0) continue;
      svg += "<circle cx=\"" + std::to_string(right(M)) + "\" cy=\"" + std::to_string(up(D)) +
             "\" r=\"4\" fill=\"none\" stroke=\"" + line.colour + "\" stroke-width=\"1.5\"/>\n";
    }
  }
  return svg + "</svg>\n";
}

// COTWIN_DRAW_CHART=FILE draws the chart, which takes minutes.
TEST(Fig12, ChartOfTheExampleShowsThePredictedBorders) {
  if (const char* file = std::getenv("COTWIN_DRAW_CHART")) std::ofstream(file) << chart();
  std::stringstream drawn;
  drawn << std::ifstream(kExample / "chart.svg").rdbuf();
  for (const Line& line : kLines) EXPECT_NE(drawn.str().find(line_of(line)), std::string::npos) << line_of(line);
}

INSTANTIATE_TEST_SUITE_P(Loop, Fig12Chart,
                         testing::Values(Case{0.25, 0.005}, Case{0.5, 0.005}, Case{0.25, 0.01}, Case{0.5, 0.01},
                                         Case{0.25, 0.02}, Case{0.5, 0.02}, Case{1, 0.04}, Case{5, 0.04}, Case{20, 0.04}),
                         [](const auto& chart) {
                           return "M" + std::to_string(std::lround(1000 * chart.param.M)) + "gD" +
                                  std::to_string(std::lround(1000 * chart.param.d)) + "ms";
                         });

}  // namespace
}  // namespace cotwin::master::fig12_manual_guidance_test
