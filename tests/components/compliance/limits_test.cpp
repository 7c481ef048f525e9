// The joint admittance at its limits, during manual guidance, and while its stiffness and inertia change: motion and energy.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "components/compliance/joints/admittance.h"

namespace cotwin::compliance::limits_test {
namespace {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double number(double low, double high) { return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53; }
  double decades(double low, double high) { return std::pow(10.0, number(low, high)); }
  bool chance(double p) { return number(0, 1) < p; }

 private:
  std::mt19937_64 engine_;
};

double stored(const Admittance& a, const Deviation& at) { return 0.5 * a.M_a * at.dx * at.dx + 0.5 * a.S_a * at.x * at.x; }

TEST(Limits, StopTheCompliantMotionWithTheBrakingDecelerationAndDoNotThrowItBack) {
  const Admittance a{.M_a = 2, .D_a = 1};
  const Limits limits{-1, 1, 0, 8};
  Deviation at;
  Tank tank;
  bool reached = false;
  for (int n = 0; n < 3000; ++n) {
    const Compliant c = advance(a, at, 30, 0, limits, {}, 1e-3, tank);
    ASSERT_LE(c.Delta.x, 1);
    ASSERT_GE(c.Delta.dx, 0);
    // The step that ends at the wall brakes a little harder than the others, so that it is not passed.
    ASSERT_GT(c.ddDelta, -8 * (1 - c.Delta.x < 1e-5 ? 1.2 : 1 + 1e-3)) << n;
    reached = reached || c.limit == Limit::kPosition;
    at = c.Delta;
  }
  EXPECT_TRUE(reached);
  EXPECT_NEAR(at.x, 1, 1e-6);
  EXPECT_NEAR(at.dx, 0, 1e-9);
  // No windup: a torque in the other direction moves it at once.
  const Compliant back = advance(a, at, -30, 0, limits, {}, 1e-3, tank);
  EXPECT_EQ(back.limit, Limit::kNone);
  EXPECT_NEAR(back.Delta.dx, -15e-3, 1e-4);
}

TEST(Limits, HoldForAnyAdmittanceTorqueMotionAndStep) {
  Random draw(3);
  for (int round = 0; round < 2000; ++round) {
    const Admittance a{draw.decades(-1, 1.5), draw.chance(0.5) ? 0 : draw.decades(-2, 2), draw.chance(0.5) ? 0.0 : 1.0,
                       draw.chance(0.3) ? 0 : draw.decades(0, 4), 0};
    const Limits limits{-draw.number(0.3, 2), draw.number(0.3, 2), draw.number(0.5, 3), draw.decades(0, 2)};
    const double h = draw.decades(-4, -1.5), amplitude = 0.9 * std::min(-limits.q_min, limits.q_max);
    const double omega = draw.number(0, 0.9) * limits.dq_max / amplitude;
    Deviation at;
    Tank tank;
    double tau = 0;
    for (int n = 1; n <= 600; ++n) {
      if (draw.chance(0.02)) tau = draw.number(-200, 200);
      const Desired desired{amplitude * std::sin(omega * n * h), amplitude * omega * std::cos(omega * n * h)};
      at = advance(a, at, tau, 0, limits, desired, h, tank).Delta;
      const double q = desired.q + at.x, dq = desired.dq + at.dx;
      ASSERT_LE(q, limits.q_max + 1e-12) << round << " " << n;
      ASSERT_GE(q, limits.q_min - 1e-12) << round << " " << n;
      ASSERT_LE(std::abs(dq), limits.dq_max * (1 + 1e-8) + std::abs(at.x) / h * 1e-9) << round << " " << n;
    }
  }
}

TEST(Limits, DoNotHinderADesiredMotionThatIsOutsideThem) {
  const Admittance a{.S_a = 100};
  const Limits limits{-1, 1, 2, 10};
  Tank tank;
  Deviation at;
  for (int n = 1; n <= 2000; ++n) {
    const double t = n * 1e-3;
    const Desired desired{1.5 * std::sin(3 * t), 4.5 * std::cos(3 * t)};
    const Compliant c = advance(a, at, 0, 0, limits, desired, 1e-3, tank);
    at = c.Delta;
    ASSERT_EQ(at.x, 0);
    ASSERT_EQ(c.limit, Limit::kNone);
  }
  EXPECT_TRUE(outside(limits, {1.5, 0}));
  EXPECT_TRUE(outside(limits, {0, 4.5}));
  EXPECT_FALSE(outside(limits, {1, -2}));
  EXPECT_FALSE(outside({}, {100, 100}));
}

TEST(Admittance, IsDampedWhenGuidedFreely) {
  const Admittance a{.M_a = 3, .zeta_a = 1, .S_a = 0, .omega_free = 2};
  Deviation at{0, 1};
  Tank tank;
  for (int n = 0; n < 1000; ++n) at = advance(a, at, 0, 0, {}, {}, 1e-3, tank).Delta;
  EXPECT_NEAR(at.dx, std::exp(-2 * 2 * 1.0), 1e-9);  // M v̇ = −2 M omega_free v
  // With a stiffness above M omega_free², the damping ratio is zeta_a.
  EXPECT_EQ(relation({.M_a = 3, .zeta_a = 1, .S_a = 27, .omega_free = 2}).D, 2 * std::sqrt(81.0));
}

TEST(Admittance, IsPassiveForAnyStiffnessInertiaTorqueAndLimits) {
  // E + T ≤ E(0) + T(0) + ∫ τ_e Δ̇ dt in every step.
  Random draw(17);
  for (int round = 0; round < 3000; ++round) {
    Admittance now{draw.decades(-1, 1), draw.chance(0.3) ? 0 : draw.decades(-2, 1), draw.number(0, 1.5), draw.decades(0, 3), 1};
    const bool limited = draw.chance(0.5);
    const Limits limits{limited ? -draw.number(0.1, 1) : 0, limited ? draw.number(0.1, 1) : 0,
                        limited ? draw.number(0.3, 3) : 0, 10};
    Tank tank{draw.chance(0.5) ? 0 : draw.number(0, 2), draw.number(0, 10)};
    const double h = draw.decades(-4, -1);
    Deviation at;
    double tau = 0, budget = std::min(tank.energy, tank.capacity), largest = 1;
    tank.energy = budget;
    Admittance target = now;
    for (int n = 0; n < 400; ++n) {
      if (draw.chance(0.05)) tau = draw.number(-30, 30);
      if (draw.chance(0.1)) target.S_a = draw.chance(0.2) ? 0 : draw.decades(0, 4);
      if (draw.chance(0.1)) target.M_a = draw.decades(-1, 1);
      change(now, target, at, tank);
      const Compliant c = advance(now, at, tau, 0, limits, {}, h, tank);
      budget += tau * (c.Delta.x - at.x);
      at = c.Delta;
      largest = std::max({largest, stored(now, at), std::abs(budget)});
      ASSERT_GE(tank.energy, 0);
      ASSERT_LE(tank.energy, tank.capacity);
      ASSERT_LE(stored(now, at) + tank.energy, budget + 1e-11 * largest) << round << " " << n;  // rounding of 400 steps
    }
  }
}

TEST(Admittance, DoesNotGainEnergyFromPeriodicChangesOfStiffness) {
  // The classical pump: stiff on the way in, soft on the way out. Undamped, it would gain a factor of 4 in each half swing.
  Admittance now{.M_a = 1, .zeta_a = 0, .S_a = 100};
  Deviation at{0.1, 0};
  Tank tank{0.2, 10};
  const double start = stored(now, at) + tank.energy;
  for (int n = 0; n < 20'000; ++n) {
    Admittance target = now;
    target.S_a = at.x * at.dx < 0 ? 400 : 100;
    change(now, target, at, tank);
    at = advance(now, at, 0, 0, {}, {}, 1e-3, tank).Delta;
    ASSERT_LE(stored(now, at) + tank.energy, start * (1 + 1e-9)) << n;
  }
}

TEST(Admittance, RaisesItsStiffnessWithTheEnergyOfItsDamping) {
  // A step of 20 N.m at S = 100 N.m/rad stores 2 J and loses 2 J to damping; a rise to 225 needs 2.5 J at once. With an empty
  // tank the stiffness rises with the energy that damping provides, and the rest on the way back; the final deviation is τ_e/S.
  Admittance now{.M_a = 6.25, .zeta_a = 1, .S_a = 100};
  Deviation at;
  Tank tank{0, 10};
  for (int n = 0; n < 5000; ++n) at = advance(now, at, 20, 0, {}, {}, 1e-3, tank).Delta;
  EXPECT_NEAR(tank.energy, 2, 1e-3);
  Admittance target = now;
  target.S_a = 225;
  EXPECT_FALSE(change(now, target, at, tank));
  EXPECT_NEAR(now.S_a, 100 + tank.energy + 2 / (0.5 * 0.04), 0.1);
  for (int n = 0; n < 5000; ++n) {
    change(now, target, at, tank);
    at = advance(now, at, 20, 0, {}, {}, 1e-3, tank).Delta;
  }
  EXPECT_EQ(now.S_a, 225);
  EXPECT_NEAR(at.x, 20.0 / 225, 1e-6);
}

}  // namespace
}  // namespace cotwin::compliance::limits_test
