#include "models/robot/drives/friction.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

namespace cotwin::robot::friction_test {
namespace {

// A strain-wave joint of the 10 N.m class: sliding deflection about 1 mrad.
Bristle joint() {
  return {.sigma0 = 5000, .sigma1 = 20, .sigma2 = 3, .tau_C = 5, .tau_S = 7, .v_S = 0.1, .delta = 2, .breakaway = 0.7};
}

double difference(const std::function<double(double)>& f, double x, double h) {
  return (8 * (f(x + h) - f(x - h)) - (f(x + 2 * h) - f(x - 2 * h))) / (12 * h);
}

using Law = BristleRates (*)(const Bristle&, double, double);

// ż = law(v(t), z) by classical Runge–Kutta in steps of h.
double integrate(Law law, const Bristle& p, const std::function<double(double)>& v, double z, double T, double h) {
  const auto steps = static_cast<long>(std::lround(T / h));
  for (long n = 0; n < steps; ++n) {
    const double t = static_cast<double>(n) * h;
    const double a = law(p, v(t), z).dz, b = law(p, v(t + h / 2), z + h / 2 * a).dz, c = law(p, v(t + h / 2), z + h / 2 * b).dz,
                 d = law(p, v(t + h), z + h * c).dz;
    z += h / 6 * (a + 2 * b + 2 * c + d);
  }
  return z;
}

TEST(CoulombViscous, IsCoulombAndViscousFrictionAwayFromRest) {
  const CoulombViscous f{.tau_C = 4, .sigma2 = 2, .tau_0 = 0.5, .v_R = 1e-3};
  EXPECT_DOUBLE_EQ(f.at(0.3).torque, 4 + 0.6 + 0.5);
  EXPECT_DOUBLE_EQ(f.at(-0.3).torque, -4 - 0.6 + 0.5);
  EXPECT_DOUBLE_EQ(f.at(0).torque, 0.5);
}

TEST(CoulombViscous, CreepsUnderALoadBelowCoulombFrictionAsFastAsDocumented) {
  const CoulombViscous f{.tau_C = 4, .sigma2 = 0, .tau_0 = 0, .v_R = 1e-2};
  EXPECT_NEAR(f.at(1e-2 * std::atanh(3.0 / 4)).torque, 3, 1e-14);
}

TEST(CoulombViscous, SlopeIsTheDerivative) {
  const CoulombViscous f{.tau_C = 4, .sigma2 = 2, .tau_0 = 0.5, .v_R = 0.05};
  for (const double v : {-0.2, -0.03, 0.0, 0.01, 0.1}) {
    EXPECT_NEAR(f.at(v).slope, difference([&](double x) { return f.at(x).torque; }, v, 1e-4), 1e-6) << v;
  }
}

TEST(Sigmoid, OfThePandaHasTheTwoPublishedFormsOfOneCurve) {
  // Joint 4 of Gaz et al. 2019, supplementary: φ1 = 1.2794, φ2 = 5.5903, φ3 = 0.036194.
  const Sigmoid f{.A = 1.2794, .alpha = 5.5903, .s = 0.036194, .k = -1.2794 * (1 / (1 + std::exp(-(5.5903 * 0.036194))))};
  for (const double v : {-2.0, -0.1, 0.0, 0.05, 1.0}) {
    const double printed = 1.2794 / (1 + std::exp(-5.5903 * (v + 0.036194))) - 1.2794 / (1 + std::exp(-5.5903 * 0.036194));
    EXPECT_NEAR(f.at(v).torque, printed, 1e-15) << v;
  }
  EXPECT_NEAR(f.at(0).torque, 0, 1e-15);
}

TEST(Sigmoid, OfTheLwrTendsToItsLimitsWithoutOverflow) {
  // Joint 1 of the LWR 4+ (A, α, s, k): k for −∞, k + A for +∞, also where e^{−α (v + s)} overflows.
  const Sigmoid f{.A = 1.367, .alpha = 195.8, .s = -0.0157, .k = -0.456};
  EXPECT_DOUBLE_EQ(f.at(-100).torque, -0.456);
  EXPECT_DOUBLE_EQ(f.at(100).torque, -0.456 + 1.367);
  EXPECT_EQ(f.at(-100).slope, 0);
  EXPECT_NEAR(f.at(0.02).slope, difference([&](double x) { return f.at(x).torque; }, 0.02, 1e-5), 1e-5);
}

TEST(Stribeck, GoesFromBreakawayToCoulombWithTheGivenExponent) {
  for (const double delta : {0.5, 1.0, 1.7, 2.0}) {
    Bristle p = joint();
    p.delta = delta;
    EXPECT_DOUBLE_EQ(p.stribeck(0).torque, 7);
    EXPECT_NEAR(p.stribeck(-0.1).torque, 5 + 2 / std::numbers::e, 1e-14);
    EXPECT_NEAR(p.stribeck(100).torque, 5, 1e-6);
    for (const double v : {-0.3, -0.02, 0.05, 0.2}) {
      EXPECT_NEAR(p.stribeck(v).slope, difference([&](double x) { return p.stribeck(x).torque; }, v, 1e-5), 1e-7)
          << delta << " " << v;
    }
  }
}

TEST(Lugre, SteadySlidingIsTheStribeckCurve) {
  const Bristle p = joint();
  for (const double v : {-1.0, -0.05, 0.01, 0.1, 2.0}) {
    const double z = integrate(
        lugre, p, [v](double) { return v; }, 0, 60 * p.stribeck(v).torque / (p.sigma0 * std::abs(v)),
        0.05 * p.stribeck(v).torque / (p.sigma0 * std::abs(v)));
    const double g = 5 + 2 * std::exp(-v * v / 0.01);
    EXPECT_NEAR(lugre(p, v, z).torque, std::copysign(g, v) + 3 * v, 1e-9) << v;
    EXPECT_NEAR(lugre(p, v, p.steady_deflection(v)).dz, 0, 1e-15) << v;
  }
}

TEST(Bristles, PartialDerivativesAreThoseOfTheRates) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> v_of(-0.5, 0.5), z_of(-1.3e-3, 1.3e-3);
  for (const Law law : {lugre, elasto_plastic}) {
    for (int i = 0; i < 2000; ++i) {
      const Bristle p = joint();
      const double v = v_of(random), z = z_of(random);
      const double share = p.sigma0 * std::abs(z) / p.stribeck(v).torque;
      // differences are meaningless across the kinks at v = 0 and at both ends of the plastic part
      if (std::abs(v) < 1e-4 || std::abs(share - p.breakaway) < 0.02 || std::abs(share - 1) < 0.02) continue;
      const BristleRates r = law(p, v, z);
      const double hv = 1e-6, hz = 1e-7;
      EXPECT_NEAR(r.dz_by_v, difference([&](double x) { return law(p, x, z).dz; }, v, hv), 1e-7 * (1 + std::abs(r.dz_by_v)))
          << v << " " << z;
      EXPECT_NEAR(r.dz_by_z, difference([&](double x) { return law(p, v, x).dz; }, z, hz), 1e-6 * (1 + std::abs(r.dz_by_z)))
          << v << " " << z;
      EXPECT_NEAR(r.torque_by_v, difference([&](double x) { return law(p, x, z).torque; }, v, hv),
                  1e-6 * (1 + std::abs(r.torque_by_v)));
      EXPECT_NEAR(r.torque_by_z, difference([&](double x) { return law(p, v, x).torque; }, z, hz),
                  1e-6 * (1 + std::abs(r.torque_by_z)));
    }
  }
}

TEST(LugreUpdate, IsTheExactSolutionForConstantSpeed) {
  const Bristle p = joint();
  for (const double v : {-0.7, -1e-3, 1e-9, 0.02, 1.5}) {
    for (const double z : {-1e-3, 0.0, 4e-4}) {
      const double h = 1e-3;
      const double expected = integrate(
          lugre, p, [v](double) { return v; }, z, h, h / 20000);
      EXPECT_NEAR(lugre_after(p, v, z, h), expected, 1e-14) << v << " " << z;
      // two half steps equal a whole step
      EXPECT_NEAR(lugre_after(p, v, lugre_after(p, v, z, h / 2), h / 2), lugre_after(p, v, z, h), 1e-18);
    }
  }
}

TEST(LugreUpdate, IsStableForAnyStiffnessSpeedAndStep) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> exponent(-3, 12), unit(-1, 1);
  for (int i = 0; i < 100000; ++i) {
    Bristle p = joint();
    p.sigma0 = std::pow(10.0, exponent(random));
    const double v = unit(random) * std::pow(10.0, exponent(random) - 6), h = std::pow(10.0, exponent(random) - 6);
    const double bound = p.stribeck(v).torque / p.sigma0;
    const double z = 3 * unit(random) * bound;
    const double after = lugre_after(p, v, z, h);
    ASSERT_LE(std::abs(after), std::max(std::abs(z), bound) * (1 + 1e-15)) << p.sigma0 << " " << v << " " << h << " " << z;
    // it approaches the steady deflection and never passes it
    const double goal = p.steady_deflection(v);
    ASSERT_GE((after - goal) * (z - goal), -1e-15 * std::abs(goal) * std::abs(z - goal))
        << p.sigma0 << " " << v << " " << h << " " << z;
  }
}

TEST(Lugre, WithoutCoulombFrictionIsViscousAlone) {
  for (const Law law : {lugre, elasto_plastic}) {
    const BristleRates r = law({.sigma0 = 1e4, .sigma1 = 10, .sigma2 = 3}, 0.5, 1e-3);
    EXPECT_EQ(r.torque, 1.5);
    EXPECT_EQ(r.dz, 0);
    EXPECT_EQ(r.torque_by_v, 3);
  }
}

TEST(Bristles, WithOnlyABreakawayTorqueStickAndThenSlideAgainstASmallTorque) {
  const Bristle p{.sigma0 = 5000, .sigma1 = 0, .sigma2 = 3, .tau_C = 0, .tau_S = 7, .v_S = 0.1};
  EXPECT_TRUE(p.present());
  for (const Law law : {lugre, elasto_plastic}) {
    EXPECT_EQ(law(p, 0, 1e-3).torque, 5000 * 1e-3) << "a spring at rest";
    // At 20 v_S the only remaining part of τ_S is the share that keeps ż finite.
    const double z = integrate(
        law, p, [](double) { return 2.0; }, 1e-3, 2e-5, 1e-9);
    EXPECT_NEAR(law(p, 2, z).torque, 3 * 2 + Bristle::kLeastSliding * 7, 1e-6);
  }
}

// Dissipated power: τ_f v less what the bristle stores, σ0 z ż.
double dissipated(Law law, const Bristle& p, double v, double z) {
  const BristleRates r = law(p, v, z);
  return r.torque * v - p.sigma0 * z * r.dz;
}

TEST(Lugre, DissipatesWhereverThePassivityConditionHoldsAndNotBeyondIt) {
  // Reachable deflections are |z| ≤ τ_S / σ0. The condition σ2 ≥ σ1 (τ_S − τ_C)/τ_C is necessary and sufficient (Barabanov and Ortega 2000).
  Bristle p = joint();
  p.sigma2 = p.sigma1 * (p.tau_S - p.tau_C) / p.tau_C;
  double least = 0;
  for (double v = -50; v <= 50; v += 0.01) {
    for (double share = -1; share <= 1; share += 0.02)
      least = std::min(least, dissipated(lugre, p, v, share * p.tau_S / p.sigma0));
  }
  EXPECT_GE(least, -1e-9);
  p.sigma2 *= 0.9;
  EXPECT_LT(dissipated(lugre, p, 50, p.tau_S / p.sigma0), 0);
}

/// Torque of steady sliding, g(v) sign(v) + σ2 v.
double steady_torque(const Bristle& p, double v) { return std::copysign(p.stribeck(v).torque, v) + p.sigma2 * v; }

TEST(ElastoPlastic, SlidesLikeLugreAndIsASpringBelowBreakaway) {
  const Bristle p = joint();
  for (const double v : {-1.0, 0.02, 0.5}) {
    EXPECT_NEAR(elasto_plastic(p, v, p.steady_deflection(v)).torque, steady_torque(p, v), 1e-12);
    EXPECT_NEAR(elasto_plastic(p, v, p.steady_deflection(v)).dz, 0, 1e-15);
    EXPECT_EQ(elasto_plastic(p, v, 0.69 * p.steady_deflection(v)).dz, v);
    EXPECT_EQ(elasto_plastic(p, v, -0.9 * p.steady_deflection(v)).dz, v);
  }
}

// A mass of 1 kg.m² under a constant load and a small oscillating one, together below breakaway: its position after T, by
// symplectic Euler in steps that resolve the bristle.
double drift(Law law, double T) {
  Bristle p = joint();
  p.sigma1 = 140;  // critically damped against σ0
  double x = 0, v = 0, z = 0, settled = 0;
  const double h = 2e-5;
  const auto steps = static_cast<long>(T / h);
  for (long n = 0; n < steps; ++n) {
    const double t = static_cast<double>(n) * h;
    const double load = 2.0 + 1.0 * std::sin(2 * std::numbers::pi * 10 * t);
    v += h * (load - law(p, v, z).torque);
    x += h * v;
    z += h * law(p, v, z).dz;
    if (n + 1 == steps / 5) settled = x;
  }
  return x - settled;
}

TEST(ElastoPlastic, DoesNotDriftUnderASmallOscillatingLoadWhereLugreDoes) {
  // Between whole periods of the load; 3 N.m at most against a breakaway torque of 7 N.m.
  const double lugre_drift = drift(lugre, 5), elasto_plastic_drift = drift(elasto_plastic, 5);
  EXPECT_GT(lugre_drift, 1e-4);
  EXPECT_LT(std::abs(elasto_plastic_drift), 1e-9);
}

TEST(ElastoPlastic, ReturnsFromAPreslidingCycleToWhereItWas) {
  const Bristle p{.sigma0 = 5000, .tau_C = 5, .tau_S = 7};
  const auto v = [](double t) {
    return 4e-4 * 2 * std::numbers::pi * std::cos(2 * std::numbers::pi * t);
  };  // ±0.4 mrad of 1 mrad
  EXPECT_NEAR(integrate(elasto_plastic, p, v, 0, 1, 1e-4), 0, 1e-15);
  EXPECT_GT(std::abs(integrate(lugre, p, v, 0, 1, 1e-4)), 1e-5);  // plain LuGre creeps
}

TEST(StickSlip, HoldsUpToTheBreakawayTorqueAndThenYieldsToTheLoad) {
  const Bristle p = joint();
  EXPECT_EQ(StickSlip::mode_at_rest(p, 7), 0);
  EXPECT_EQ(StickSlip::mode_at_rest(p, -7), 0);
  EXPECT_EQ(StickSlip::mode_at_rest(p, 7.001), 1);
  EXPECT_EQ(StickSlip::mode_at_rest(p, -7.001), -1);
  EXPECT_DOUBLE_EQ(StickSlip::slipping(p, 0, 1).torque, 7);
  EXPECT_DOUBLE_EQ(StickSlip::slipping(p, -0.2, -1).torque, steady_torque(p, -0.2));
  EXPECT_NEAR(StickSlip::slipping(p, -0.2, -1).slope, difference([&](double v) { return steady_torque(p, v); }, -0.2, 1e-5),
              1e-7);
}

TEST(Torsion, IsLinearWithoutBacklash) {
  const Torsion k{.K = 1e4};
  EXPECT_EQ(k.at(2e-3).torque, 20);
  EXPECT_EQ(k.at(2e-3).slope, 1e4);
  EXPECT_EQ(k.energy(2e-3), 0.02);
  EXPECT_EQ(k.under(20), 2e-3);
}

TEST(Torsion, WithBacklashIsADeadZoneAndLinearBeyond) {
  const Torsion k{.K = 1e4, .backlash = 1e-3};
  const double e = 1e-4;
  for (const double phi : {2e-3, 5e-3, -3e-3}) {
    const double beyond = std::abs(phi) - 1e-3;
    EXPECT_NEAR(k.at(phi).torque, std::copysign(1e4 * beyond, phi), 1e4 * e * e / (2 * beyond)) << phi;
  }
  EXPECT_NEAR(k.at(0).slope / 1e4, 0.005, 1e-4);
  EXPECT_EQ(k.at(0).torque, 0);
}

TEST(Torsion, SlopeIsTheDerivativeOfTheTorqueAndTorqueThatOfTheEnergy) {
  const Torsion k{.K = 1e4, .backlash = 1e-3};
  for (const double phi : {-4e-3, -1e-3, -2e-4, 1e-5, 9e-4, 1.1e-3, 3e-3}) {
    EXPECT_NEAR(k.at(phi).slope, difference([&](double x) { return k.at(x).torque; }, phi, 1e-6), 1e-4) << phi;
    EXPECT_NEAR(k.at(phi).torque, difference([&](double x) { return k.energy(x); }, phi, 1e-6), 1e-8) << phi;
  }
  EXPECT_EQ(k.energy(0), 0);
}

TEST(Torsion, UnderATorqueIsTheInverse) {
  for (const double b : {0.0, 1e-5, 1e-3, 0.1}) {
    const Torsion k{.K = 7e3, .backlash = b};
    for (const double torque : {-100.0, -1e-3, 0.0, 1e-9, 0.5, 30.0}) {
      EXPECT_NEAR(k.at(k.under(torque)).torque, torque, 1e-12 * (1 + std::abs(torque))) << b << " " << torque;
    }
  }
}

// Speed after an impact of mass m with v0 on a stop of stiffness k, by Runge–Kutta in (depth, speed).
double rebound(double m, double k, double x, double v0) {
  double depth = 0, speed = v0;
  const double h = 1e-5 * std::sqrt(m / k) * std::numbers::pi;
  const auto a = [&](double d, double s) { return -stop_torque(k, x, v0, d, s).torque / m; };
  do {
    const double d1 = speed, s1 = a(depth, speed);
    const double d2 = speed + h / 2 * s1, s2 = a(depth + h / 2 * d1, d2);
    depth += h * d2;
    speed += h * s2;
  } while (depth > 0);
  return -speed;
}

TEST(Stop, ReturnsAFreeMassWithTheRestitutionWhateverMassStiffnessAndSpeed) {
  for (const double e : {0.1, 0.5, 0.9, 1.0}) {
    const double x = stop_damping(e);
    EXPECT_NEAR(rebound(2, 1e5, x, 0.5) / 0.5, e, 1e-3) << e;
    EXPECT_NEAR(rebound(0.01, 1e3, x, 3) / 3, e, 1e-3) << e;
  }
}

TEST(Stop, PushesOnly) {
  EXPECT_EQ(stop_torque(1e5, 1, 1, -1e-3, 0.1).torque, 0);
  EXPECT_EQ(stop_torque(1e5, 2, 1, 1e-3, -0.9).torque, 0);
  const StopTorque s = stop_torque(1e5, 0.7, 0.4, 1e-3, 0.2);
  EXPECT_NEAR(s.torque, 100 * (1 + 0.7 * 0.2 / 0.4), 1e-12);
  EXPECT_NEAR(s.by_depth, s.torque / 1e-3, 1e-9);
  EXPECT_NEAR(s.by_speed, 100 * 0.7 / 0.4, 1e-12);
}

}  // namespace
}  // namespace cotwin::robot::friction_test
