#include "tests/support/linear_units.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::testing::linear_units_test {
namespace {

constexpr Time kStart{0};

struct Made : Instance {
  explicit Made(const std::string& source) : Instance(make_unit("unit:" + source, {}, {}, linear_types())) {}
  double& operator[](const std::string& name) { return variables.at(name).reals()[0]; }
  double& rate(const std::string& name) { return variables.at(name).rate[0]; }
  void step(double now, double h) {
    ASSERT_EQ(unit->step(Time::from_seconds(now), Duration::from_seconds(h)), StepResult::kDone);
  }
};

TEST(LinearUnit, FollowsARampLikeTheClosedFormOfALag) {
  Made lag("lag?T=0.5");
  lag["x0"] = 3;
  lag.unit->initialise(kStart);
  EXPECT_EQ(lag["y"], 3);
  lag["u"] = 2;
  lag.rate("u") = -4;
  lag.step(0, 0.7);
  // u = a + b t: y = a + b (t − T) + (y0 − a + b T) exp(−t/T)
  const double T = 0.5, a = 2, b = -4, t = 0.7;
  EXPECT_NEAR(lag["y"], a + b * (t - T) + (3 - a + b * T) * std::exp(-t / T), 1e-14);
}

TEST(LinearUnit, HoldsItsInputsIfThatIsChosen) {
  Made lag("lag?held=true");
  EXPECT_TRUE(lag.variables.at("u").rate.empty());
  lag.unit->initialise(kStart);
  lag["u"] = 2;
  lag.step(0, 0.25);
  EXPECT_NEAR(lag["y"], 2 * (1 - std::exp(-0.25)), 1e-15);
}

TEST(LinearUnit, OscillatesLikeADampedBodyUnderAConstantForce) {
  Made side("two_mass_1");
  side.unit->initialise(kStart);
  side["F"] = 5;
  double now = 0;
  for (const double h : {0.1, 0.3, 0.1, 0.5}) {
    side.step(now, h);
    now += h;
  }
  // ẍ + 2δ ẋ + ω0² x = F, x(0) = 1, ẋ(0) = 0
  const double delta = 0.05, omega = std::sqrt(10 - delta * delta), e = 1 - 5.0 / 10, decay = std::exp(-delta * now);
  const double cosine = std::cos(omega * now), sine = std::sin(omega * now);
  EXPECT_NEAR(side["x1"], 0.5 + decay * e * (cosine + delta / omega * sine), 1e-14);
  EXPECT_NEAR(side["v1"], -decay * e * (omega + delta * delta / omega) * sine, 1e-14);
}

TEST(LinearUnit, OutputsHoldWithTheInputsAtTheEndOfTheStep) {
  for (const bool held : {false, true}) {
    Made side(held ? "two_mass_2?held=true" : "two_mass_2");
    side["x1"] = 0.5;
    side.unit->initialise(kStart);
    EXPECT_EQ(side["F"], -100 * 0.5);
    if (!held) side.rate("x1") = 3;
    side.step(0, 0.01);
    const double x1 = held ? 0.5 : 0.53;
    EXPECT_NEAR(side["F"], 100 * (side["x2"] - x1) + (side["v2"] - side["v1"]), 1e-13);
  }
}

TEST(LinearUnit, DoesNotAllocateInAStepOfAKnownLength) {
  Made side("two_mass_2");
  side.unit->initialise(kStart);
  for (int i = 1; i <= 8; ++i) side.step(0, 1e-3 * i);
  const auto before = allocations();
  for (int round = 0; round < 3; ++round) {
    for (int i = 1; i <= 8; ++i) side.step(0, 1e-3 * i);
  }
  EXPECT_EQ(allocations(), before);
  EXPECT_EQ(dynamic_cast<LinearUnit&>(*side.unit).steps(), 32);
}

TEST(LinearUnit, ForgetsLengthsWithoutMixingThemUp) {
  Made many("lc_mass");
  many.unit->initialise(kStart);
  many["F"] = -2;
  double v = 1;
  for (int i = 0; i < 60; ++i) {
    const double h = 1e-3 * (1 + i * 7 % 20);
    many.step(0, h);
    v += 2 * h;  // m v̇ = −F, m = 1
  }
  EXPECT_NEAR(many["v"], v, 1e-13);
}

TEST(LinearUnit, ItsJacobianIsThatOfDifferences) {
  Made side("two_mass_2?partials=true");
  side.unit->initialise(kStart);
  const auto partials = side.unit->partials();
  ASSERT_EQ(partials.size(), 5u);  // F by x1, v1 and x; x2 and v2 by x
  std::vector<double> values(2 + 3 * 2);
  side.unit->evaluate_partials(values);
  std::size_t next = 0;
  for (const Partial& partial : partials) {
    const Variable& unknown = side.variables.at(partial.unknown);
    const bool by_state = std::string(partial.known) == "x";
    const Variable& known = side.variables.at(by_state ? "x0" : partial.known);
    for (double& element : known.reals()) {
      const double y = unknown.reals()[0];
      element += 1;
      side.unit->initialise(kStart);
      EXPECT_NEAR(values[next++], unknown.reals()[0] - y, 1e-12) << partial.unknown << " by " << partial.known;
      element -= 1;
      side.unit->initialise(kStart);
    }
  }
  EXPECT_EQ(next, values.size());
  EXPECT_TRUE(Made("two_mass_2").unit->partials().empty());
}

TEST(LinearUnit, RejectsMatricesThatDoNotFit) {
  LinearSystem system{Eigen::MatrixXd::Zero(1, 1), Eigen::MatrixXd::Zero(1, 2), Eigen::MatrixXd::Zero(1, 1),
                      Eigen::MatrixXd::Zero(1, 1), Eigen::VectorXd::Zero(1),    {{"u", "1", "in", ""}},
                      {{"y", "1", "out", ""}}};
  EXPECT_EQ(error_of([&] { LinearUnit(system, {}); }), "B: is 1 x 2, expected 1 x 1");
}

TEST(LinearUnits, DeclareDerivativesOnlyIfThatIsChosen) {
  EXPECT_EQ(Made("two_mass_1").variables.at("v1").derivative_of, "");
  EXPECT_EQ(Made("two_mass_1?derivatives=true").variables.at("v1").derivative_of, "x1");
  EXPECT_EQ(Made("contact_2?derivatives=true").variables.at("v2").derivative_of, "x2");
  EXPECT_EQ(Made("clock").variables.find("dy"), nullptr);
  EXPECT_EQ(Made("clock?derivatives=true").variables.at("dy").derivative_of, "y");
}

TEST(LinearUnits, SourcesAreFunctionsOfTheTimeAtTheEndOfAStep) {
  Made clock("clock?derivatives=true"), cosine("cosine?derivatives=true"), jump("jump");
  cosine["T"] = 3;
  jump["t0"] = 0.3;
  for (Made* unit : {&clock, &cosine, &jump}) {
    unit->unit->initialise(Time::from_seconds(0.1));
    EXPECT_EQ((*unit)["y"], unit == &clock ? 0.1 : unit == &jump ? 0 : std::cos(2 * std::numbers::pi / 3 * 0.1));
    unit->step(0.1, 0.2);
  }
  EXPECT_EQ(clock["y"], 0.3);
  EXPECT_EQ(clock["dy"], 1);
  EXPECT_EQ(jump["y"], 1);
  const double phase = 2 * std::numbers::pi * 0.1;  // of 0.3 s at a period of 3 s
  EXPECT_NEAR(cosine["y"], std::cos(phase), 1e-15);
  EXPECT_NEAR(cosine["dy"], -2 * std::numbers::pi / 3 * std::sin(phase), 1e-15);
}

TEST(LinearUnits, SettingsMustBeNumbers) {
  EXPECT_EQ(error_of([] { Made("contact_2?kc=stiff"); }), "kc: 'stiff', expected a number");
}

TEST(CoupledReference, GivesThePublishedPositionsOfTheContact) {
  // The published figures have an error of their own: the exponential series with scaling and squaring in decimal arithmetic of
  // 60 digits gives the others.
  const double at_1e6 = coupled_reference(contact(1e6), 0.1)[0], at_1e7 = coupled_reference(contact(1e7), 0.1)[0];
  EXPECT_NEAR(at_1e6 / 2.0584355208e-4, 1, 1e-8);
  EXPECT_NEAR(at_1e7 / 3.9157547708e-4, 1, 1e-7);
  EXPECT_NEAR(at_1e6 / 2.0584355182427e-4, 1, 2e-9);
  EXPECT_NEAR(at_1e7 / 3.9157546687930e-4, 1, 2e-9);
}

TEST(CoupledReference, SatisfiesTheEquationsOfMotion) {
  // m1 ẍ1 = −c1 x1 − d1 ẋ1 + F, m2 ẍ2 = −c2 x2 − d2 ẋ2 − F with the numbers of the two-mass oscillator
  for (const double t : {0.0, 0.3, 1.7, 5.0}) {
    const Eigen::Vector4d z = coupled_reference(two_masses(), t);
    const double dt = 1e-4;
    const Eigen::Vector4d slope =
        (coupled_reference(two_masses(), t + dt) - coupled_reference(two_masses(), t - dt)) / (2 * dt);
    const double F = 100 * (z[2] - z[0]) + (z[3] - z[1]);
    EXPECT_NEAR(slope[0], z[1], 1e-5);
    EXPECT_NEAR(slope[1], -10 * z[0] - 0.1 * z[1] + F, 1e-4);
    EXPECT_NEAR(slope[2], z[3], 1e-5);
    EXPECT_NEAR(2 * slope[3], -20 * z[2] - 0.1 * z[3] - F, 1e-4);
  }
  EXPECT_EQ(coupled_reference(two_masses(), 0), Eigen::Vector4d(1, 0, 0, 0));
}

/// The largest error of x1 over `seconds`: sides that exchange their outputs after every step of h.
double error_of_exchange(Made& one, Made& two, const TwoBodies& bodies, double seconds, double h) {
  one.unit->initialise(kStart);
  const auto to_two = [&] {
    two["x1"] = one["x1"];
    two["v1"] = one["v1"];
  };
  to_two();
  two.unit->initialise(kStart);
  double largest = 0;
  for (int n = 0; n * h < seconds; ++n) {
    one["F"] = two["F"];
    one.step(n * h, h);
    to_two();
    two.step(n * h, h);
    largest = std::max(largest, std::abs(one["x1"] - coupled_reference(bodies, (n + 1) * h)[0]));
  }
  return largest;
}

TEST(LinearUnits, SidesThatExchangeFinelyMoveLikeTheWholeSystem) {
  Made one("two_mass_1"), two("two_mass_2");
  const double coarse = error_of_exchange(one, two, two_masses(), 2, 2e-4),
               fine = error_of_exchange(one, two, two_masses(), 2, 1e-4);
  EXPECT_LT(fine, 2e-3);
  EXPECT_NEAR(coarse / fine, 2, 0.1);  // held values: first order
  Made hit("contact_1"), base("contact_2?kc=1e7");
  EXPECT_LT(error_of_exchange(hit, base, contact(1e7), 0.01, 1e-6), 0.02 * 4e-4);
}

TEST(LinearUnits, MassAndSpringThatExchangeFinelyOscillate) {
  Made mass("lc_mass"), spring("lc_spring");
  mass.unit->initialise(kStart);
  spring.unit->initialise(kStart);
  const double h = 1e-4;
  for (int n = 0; n < 10'000; ++n) {
    mass["F"] = spring["F"];
    mass.step(n * h, h);
    spring["v"] = mass["v"];
    spring.step(n * h, h);
  }
  EXPECT_NEAR(mass["v"], std::cos(10), 2e-3);
  EXPECT_NEAR(spring["F"], 10 * std::sin(10), 2e-2);
}

}  // namespace
}  // namespace cotwin::testing::linear_units_test
