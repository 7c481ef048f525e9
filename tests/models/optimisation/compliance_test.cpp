// Parameters of compliance for the least settling time: the closed form of the second-order step response.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "components/services/services.h"
#include "models/foundation/support/error.h"
#include "models/optimisation/evaluation/compliance.h"

namespace cotwin::optimisation::compliance_test {
namespace {

ComplianceProblem table_2() {
  ComplianceProblem p;
  p.least = {1, 1, 500};
  p.most = {10, 1000, 1500};
  p.cost = [](const ComplianceValues& v) { return services::settling_time(v.M, v.D, v.S, 0.02); };
  return p;
}

// The overshoot e^(−ζπ/√(1 − ζ²)) of the best damping equals the band: ζ² = L²/(π² + L²) with L = −ln 0.02.
TEST(Compliance, SettlesFastestWithTheOvershootOfTheBand) {
  const ComplianceSolution s = minimise_compliance(table_2());
  const double L = -std::log(0.02), zeta = L / std::hypot(std::numbers::pi, L);
  EXPECT_TRUE(s.feasible);
  EXPECT_NEAR(s.values.M, 1, 1e-6);
  EXPECT_NEAR(s.values.S, 1500, 1e-3);
  EXPECT_NEAR(s.values.D, 2 * zeta * std::sqrt(1500), 1e-3 * s.values.D);
  EXPECT_LT(s.cost, 0.7 * services::settling_time(1, 2 * std::sqrt(1500), 1500, 0.02));  // the aperiodic limit of Table II
}

// Stable at K_e with a tracking loop of ω and ζ = 1 (Routh, specification section 1): light masses are excluded.
TEST(Compliance, KeepsAFurtherCondition) {
  const auto stiffest = [](const ComplianceValues& v) {
    const double w = 40, a_3 = v.D + 2 * w * v.M, a_2 = v.S + 2 * w * v.D + w * w * v.M, a_1 = 2 * w * v.S + w * w * v.D;
    return a_1 * (a_3 * a_2 - v.M * a_1) / (a_3 * a_3 * w * w) - v.S;
  };
  ComplianceProblem p = table_2();
  const ComplianceSolution free = minimise_compliance(p);
  ASSERT_LT(stiffest(free.values), 8000);
  p.violation = [&](const ComplianceValues& v) { return 8000 - stiffest(v); };
  const ComplianceSolution s = minimise_compliance(p);
  ASSERT_TRUE(s.feasible);
  EXPECT_GE(stiffest(s.values), 8000);
  EXPECT_GT(s.cost, free.cost);
  // No point of a grid is better.
  for (int i = 0; i <= 30; ++i)
    for (int j = 0; j <= 60; ++j)
      for (int k = 0; k <= 5; ++k) {
        const ComplianceValues v{std::pow(10, i / 30.0), std::pow(10, 3 * j / 60.0), 500 + 200.0 * k};
        if (stiffest(v) < 8000) continue;
        EXPECT_GE(p.cost(v), s.cost * (1 - 1e-3));
      }
  p.violation = [](const ComplianceValues&) { return 1.0; };
  EXPECT_FALSE(minimise_compliance(p).feasible);
}

TEST(Compliance, RefusesBoundsOutOfRange) {
  ComplianceProblem p = table_2();
  p.least.D = 0;
  EXPECT_THROW(minimise_compliance(p), Error);
  p = table_2();
  p.most.S = 100;
  EXPECT_THROW(minimise_compliance(p), Error);
  p = table_2();
  p.cost = {};
  EXPECT_THROW(minimise_compliance(p), Error);
}

}  // namespace
}  // namespace cotwin::optimisation::compliance_test
