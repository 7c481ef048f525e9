// The terms of (2a) in the compliant motion, terms=true: closed forms of the planar arm, and their sum with friction.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "components/unit/unit_table.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"

namespace cotwin::terms_test {
namespace {

constexpr Duration kTick{1'000'000};

class Controller {
 public:
  explicit Controller(const std::string& query)
      : instance_(
            make_unit("unit:compliance?" + query, {}, {std::filesystem::path(places::source()) / "models"}, unit_types())) {}
  std::span<double> operator[](const std::string& name) { return instance_.variables.at(name).reals(); }
  std::string warning() { return instance_.variables.at("warning").strings()[0]; }
  bool has(const std::string& name) const { return instance_.variables.find(name) != nullptr; }
  void start() { instance_.unit->initialise({}); }
  void step() { ASSERT_EQ(instance_.unit->step({}, kTick), StepResult::kDone); }

 private:
  Instance instance_;
};

TEST(ComplianceTerms, AreTheClosedFormsOfThePlanarArm) {
  Controller c("robot=planar2&terms=true");
  const double q1 = 0.4, q2 = 0.9, w1 = 0.8, w2 = -1.3, a1 = 2, a2 = -3;
  for (const auto& [name, first, second] :
       {std::tuple{"q_d", q1, q2}, std::tuple{"dq_d", w1, w2}, std::tuple{"ddq_d", a1, a2}}) {
    c[name][0] = first;
    c[name][1] = second;
  }
  c.start();  // q_c = q_d
  constexpr double g = 9.81, l1 = 0.4, c1 = 0.2, c2 = 0.175, m1 = 6, m2 = 4, I1 = 0.08375, I2 = 0.0424333333;
  const double h = m2 * l1 * c2 * std::sin(q2), coupling = m2 * l1 * c2 * std::cos(q2), M22 = I2 + m2 * c2 * c2;
  EXPECT_NEAR(c["tau_coriolis"][0], -h * (2 * w1 * w2 + w2 * w2), 1e-12);
  EXPECT_NEAR(c["tau_coriolis"][1], h * w1 * w1, 1e-12);
  EXPECT_NEAR(c["tau_gravity"][0], g * ((m1 * c1 + m2 * l1) * std::cos(q1) + m2 * c2 * std::cos(q1 + q2)), 1e-12);
  EXPECT_NEAR(c["tau_gravity"][1], g * m2 * c2 * std::cos(q1 + q2), 1e-12);
  EXPECT_NEAR(c["tau_inertia"][0], (I1 + m1 * c1 * c1 + m2 * l1 * l1 + M22 + 2 * coupling) * a1 + (M22 + coupling) * a2, 1e-7);
  EXPECT_NEAR(c["tau_inertia"][1], (M22 + coupling) * a1 + M22 * a2, 1e-7);
}

TEST(ComplianceTerms, AddUpToInverseDynamicsWithFriction) {
  for (const char* query :
       {"robot=lwr4", "robot=lwr4&base=floating", "robot=lwr4&space=cartesian", "robot=../tests/components/data/finger.urdf"}) {
    SCOPED_TRACE(query);
    Controller c(std::string(query) + "&terms=true"), plain(query);
    for (Controller* one : {&c, &plain}) {
      for (double& friction : (*one)["link_tau_C"]) friction = 2;
      for (double& friction : (*one)["tau_C"]) friction = 1;
      one->start();
    }
    const std::size_t n = c["q"].size();
    for (int i = 0; i < 400; ++i) {
      for (Controller* one : {&c, &plain}) {
        for (std::size_t j = 0; j < n; ++j) {
          const double w = 1 + 0.3 * static_cast<double>(j), t = 1e-3 * i;
          if (one->has("q_d")) {
            (*one)["q_d"][j] = 0.5 * (1 - std::cos(w * t));
            (*one)["dq_d"][j] = 0.5 * w * std::sin(w * t);
            (*one)["ddq_d"][j] = 0.5 * w * w * std::cos(w * t);
          }
          if (one->has("tau_e")) (*one)["tau_e"][j] = 3 * std::sin(5 * t + w);
        }
        if (one->has("f_e")) (*one)["f_e"][0] = 10 * std::sin(0.01 * i);
      }
      const std::uint64_t before = testing::allocations();
      c.step();
      EXPECT_TRUE(i < 10 || testing::allocations() == before);
      plain.step();
      for (std::size_t j = 0; j < n; ++j) {
        const double tau_e = c[c.has("tau_e") ? "tau_e" : "tau_wrench"][j];
        const double parts[] = {c["tau_inertia"][j], c["tau_coriolis"][j], c["tau_gravity"][j], c["tau_f"][j], -tau_e};
        double sum = 0, size = 1;
        for (const double part : parts) {
          sum += part;
          size += std::abs(part);
        }
        ASSERT_NEAR(sum, c["tau_id"][j], 1e-12 * size) << "joint " << j << ", step " << i;
        ASSERT_EQ(c["tau_m"][j], plain["tau_m"][j]);  // the terms change nothing
      }
    }
    EXPECT_FALSE(plain.has("tau_gravity"));
  }
}

// The first cut torque, limit and change that had to wait write the warning.
TEST(ComplianceTerms, AllocateNothingWhenTorquesAreCutAndLimitsActForTheFirstTime) {
  for (const char* query :
       {"robot=planar2", "robot=lwr4", "robot=lwr4&space=cartesian", "robot=lwr4&space=cartesian&render=impedance"}) {
    Controller c(std::string(query) + "&terms=true");
    const auto set = [&](const char* name, double value) {
      if (c.has(name)) std::ranges::fill(c[name], value);
    };
    set("tau_max", 500);
    c.start();
    c.step();
    const std::uint64_t before = testing::allocations();
    for (int i = 0; i < 600; ++i) {
      if (i == 20) c["q"][0] = 0.3;
      if (i == 40) set("tau_max", 1);
      if (i == 100) set(c.has("p_d") ? "p_d" : "q_d", 3);
      if (i == 200) set("dq_max", 0.1);
      if (i == 300) {
        set("q_min", -0.1);
        set("q_max", 0.1);
      }
      if (i == 400) {
        for (const char* name : {"S_a", "S_T", "M_T", "omega"}) set(name, 3000);
      }
      c.step();
    }
    EXPECT_EQ(testing::allocations(), before) << query;
    EXPECT_NE(c.warning().find("reached tau_max"), std::string::npos) << query;
  }
}

}  // namespace
}  // namespace cotwin::terms_test
