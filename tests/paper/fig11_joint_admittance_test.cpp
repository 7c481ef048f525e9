// VI-B, Fig. 11: joints of a two-DoF arm under admittance, with abruptly changing external torques and changing targeted
// stiffness and damping. "The transient phase (time ≈ 2.5 s) was overshoot-free and the desired stiffness values were
// accurately rendered for both joints at the steady state." The numbers of the figure are not in the text; those of
// examples/01_joint_admittance are our choice.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "tests/support/places.h"

namespace cotwin::master::fig11_joint_admittance_test {
namespace {

const std::filesystem::path kExample = std::filesystem::path(places::source()) / "examples/01_joint_admittance";

/// The constant values between two switchings, as in the example's events.
struct Phase {
  double from, to;                    // s
  std::array<double, 2> tau_e, M, S;  // of both joints; D = 2 √(S M)
};
constexpr std::array<double, 2> kM = {6.25, 2.25};
const std::vector<Phase> kPhases = {{0, 1, {0, 0}, kM, {100, 36}},
                                    {1, 6, {20, 9}, kM, {100, 36}},
                                    {6, 11, {20, 9}, kM, {225, 81}},
                                    {11, 16, {-18, -8.1}, kM, {225, 81}},
                                    {16, 21, {-18, -8.1}, kM, {56.25, 20.25}},
                                    {21, 28, {0, 0}, kM, {56.25, 20.25}}};

/// Critical damping from Δ(0) = x, Δ̇(0) = v: Δ = f + (x − f + (v + w (x − f)) t) e^(−wt), f = τ_e/S, w = √(S/M).
struct Closed {
  double x, v;
};
Closed aperiodic(double x, double v, double tau_e, double M, double S, double t) {
  const double f = tau_e / S, w = std::sqrt(S / M), a = x - f, b = v + w * a, decay = std::exp(-w * t);
  return {f + (a + b * t) * decay, (b - w * (a + b * t)) * decay};
}

struct Deviations {
  std::vector<double> t;
  std::array<std::vector<double>, 2> compliant, link;  // q_c − q_d, q − q_d
};

Deviations run(const std::vector<std::string>& assignments) {
  Scenario scenario = load_scenario(kExample / "arm.ssd");
  for (const std::string& assignment : assignments) assign(scenario, assignment);
  MasterOptions options;
  options.types = unit_types();
  options.folders = {kExample, std::filesystem::path(places::source()) / "models"};
  Master master(std::move(scenario), std::move(options));
  master.initialise();
  const auto signal = [&](const char* name) { return find_real_signal(master.members(), name, "test").reals(); };
  const std::span<double> q_d = signal("motion.q_d"), q_c = signal("compliance.q_c"), q = signal("drive.q");
  Deviations d;
  do {
    d.t.push_back(master.now().seconds());
    for (std::size_t i = 0; i < 2; ++i) {
      d.compliant[i].push_back(q_c[i] - q_d[i]);
      d.link[i].push_back(q[i] - q_d[i]);
    }
  } while (master.step_tick());
  master.finish();
  return d;
}

/// Both ways of tracking the compliant motion (IV-A3).
class Fig11 : public testing::TestWithParam<const char*> {
 protected:
  std::string tracking() const { return std::string("compliance.passivity=") + GetParam(); }
};

TEST_P(Fig11, CompliantMotionIsTheClosedFormBetweenAbruptSwitchings) {
  const Deviations d = run({tracking(), "compliance.transition=0"});
  for (std::size_t i = 0; i < 2; ++i) {
    Closed start{0, 0};
    std::size_t k = 0;
    for (const Phase& phase : kPhases) {
      for (; k < d.t.size() && d.t[k] <= phase.to; ++k) {
        const Closed expected = aperiodic(start.x, start.v, phase.tau_e[i], phase.M[i], phase.S[i], d.t[k] - phase.from);
        ASSERT_NEAR(d.compliant[i][k], expected.x, 1e-12) << "joint " << i + 1 << " at " << d.t[k];  // rounding of 28 000 steps
      }
      start = aperiodic(start.x, start.v, phase.tau_e[i], phase.M[i], phase.S[i], phase.to - phase.from);
    }
    EXPECT_EQ(k, d.t.size());
  }
}

TEST_P(Fig11, TransientIsFreeOfOvershootAndOverAfterTwoAndAHalfSeconds) {
  const Deviations d = run({tracking()});
  for (std::size_t i = 0; i < 2; ++i) {
    double before = 0;
    for (const Phase& phase : kPhases) {
      const double rest = phase.tau_e[i] / phase.S[i], way = std::abs(rest - before), direction = rest > before ? 1 : -1;
      for (std::size_t k = 0; k < d.t.size(); ++k) {
        if (d.t[k] <= phase.from || d.t[k] > phase.to) continue;
        ASSERT_LT(direction * (d.compliant[i][k] - rest), 1e-9) << d.t[k];
        ASSERT_LT(direction * (d.link[i][k] - rest), 1e-3 * way + 1e-6) << d.t[k];
        if (d.t[k] > phase.from + 2.5) {
          ASSERT_NEAR(d.link[i][k], rest, 0.01 * way + 1e-6) << d.t[k];
        }
      }
      before = rest;
    }
  }
}

TEST_P(Fig11, StiffnessIsRenderedByTheLinksAtTheSteadyStateToAThousandth) {
  const Deviations d = run({tracking()});
  for (const Phase& phase : kPhases) {
    const auto k = static_cast<std::size_t>(std::lround(phase.to * 1000)) - 1;  // just before the next switching
    for (std::size_t i = 0; i < 2; ++i) {
      const double rest = phase.tau_e[i] / phase.S[i];
      EXPECT_NEAR(d.link[i][k], rest, 1e-3 * std::abs(rest) + 1e-5) << "joint " << i + 1 << " at " << d.t[k];
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Tracking, Fig11, testing::Values("0", "1"), [](const auto& tracking) {
  return std::string(tracking.param) == "0" ? "ComputedTorque" : "PassivityBased";
});

}  // namespace
}  // namespace cotwin::master::fig11_joint_admittance_test
