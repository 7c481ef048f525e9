// The terms of (2a) as outputs, terms=true: against closed forms of the planar arm and the balance with the joint torque.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/components/drive_train/harness.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::terms_test {
namespace {

using testing::Drive;
using testing::excitation;

// Data of models/robots/planar2; its axes are along −y, so that the links rise with q.
TEST(DriveTrainTerms, AreTheClosedFormsOfThePlanarArm) {
  Drive drive("robot=planar2&terms=true&friction=smooth");
  drive["q0"][0] = 0.4;
  drive["q0"][1] = 0.9;
  drive["dq0"][0] = 0.8;
  drive["dq0"][1] = -1.3;
  drive["link_sigma2"][1] = 2;
  drive.initialise();
  for (int i = 0; i < 200; ++i) {
    drive["tau_m"][0] = 40 * std::sin(0.03 * i) + 60;
    drive["tau_m"][1] = 15;
    drive.step(1e-3);
    const double q1 = drive["q"][0], q2 = drive["q"][1], w1 = drive["dq"][0], w2 = drive["dq"][1];
    constexpr double g = 9.81, l1 = 0.4, c1 = 0.2, c2 = 0.175, m1 = 6, m2 = 4, I1 = 0.08375, I2 = 0.0424333333;
    const double h = m2 * l1 * c2 * std::sin(q2);
    EXPECT_NEAR(drive["tau_coriolis"][0], -h * (2 * w1 * w2 + w2 * w2), 1e-12);
    EXPECT_NEAR(drive["tau_coriolis"][1], h * w1 * w1, 1e-12);
    EXPECT_NEAR(drive["tau_gravity"][0], g * ((m1 * c1 + m2 * l1) * std::cos(q1) + m2 * c2 * std::cos(q1 + q2)), 1e-12);
    EXPECT_NEAR(drive["tau_gravity"][1], g * m2 * c2 * std::cos(q1 + q2), 1e-12);
    const double coupling = m2 * l1 * c2 * std::cos(q2), M22 = I2 + m2 * c2 * c2;
    const double M11 = I1 + m1 * c1 * c1 + m2 * l1 * l1 + M22 + 2 * coupling;
    const double a1 = drive["ddq"][0], a2 = drive["ddq"][1];
    EXPECT_NEAR(drive["tau_inertia"][0], M11 * a1 + (M22 + coupling) * a2, 1e-7);  // I2 has 9 digits
    EXPECT_NEAR(drive["tau_inertia"][1], (M22 + coupling) * a1 + M22 * a2, 1e-7);
    EXPECT_NEAR(drive["tau_link"][0], 0, 1e-12);
    EXPECT_NEAR(drive["tau_link"][1], 2 * w2, 1e-12);
  }
}

TEST(DriveTrainTerms, AddUpToTheTorqueOnTheLinksInEveryVariant) {
  for (const char* query :
       {"robot=lwr4", "robot=lwr4&transmission=rigid", "robot=lwr4&friction=coulomb", "robot=lwr4&method=cvode",
        "robot=lwr4&method=rosenbrock&friction=elasto_plastic", "robot=lwr4&base=floating",
        "robot=../tests/components/data/finger.urdf", "robot=../tests/components/data/finger.urdf&passive=knuckle"}) {
    SCOPED_TRACE(query);
    Drive drive(std::string(query) + "&terms=true"), plain(query);
    for (Drive* d : {&drive, &plain}) {
      d->set("dq0", 0.3).set("link_sigma2", 3).set("link_tau_C", 0.5).set("link_load", 0.02).set("stop_stiffness", 1e4);
      d->initialise();
    }
    EXPECT_TRUE(drive.instance().unit->partials().empty());
    for (int i = 0; i < 300; ++i) {
      for (Drive* d : {&drive, &plain}) {
        for (std::size_t j = 0; j < (*d)["tau_m"].size(); ++j) {
          (*d)["tau_m"][j] = excitation(i, j);
          (*d)["tau_e"][j] = 0.1 * excitation(i + 50, j);
        }
      }
      const std::uint64_t before = testing::allocations();
      drive.step(1e-3);
      EXPECT_TRUE(i <= 10 || testing::allocations() == before);
      plain.step(1e-3);
      for (std::size_t j = 0; j < drive["q"].size(); ++j) {
        const double whole = drive["tau_J"][j] + drive["tau_e"][j];
        const double parts[] = {drive["tau_inertia"][j], drive["tau_coriolis"][j], drive["tau_gravity"][j],
                                drive["tau_link"][j]};
        double sum = 0, size = 1;
        for (const double part : parts) {
          sum += part;
          size += std::abs(part);
        }
        EXPECT_NEAR(sum, whole, 1e-12 * size) << "joint " << j << ", step " << i;
        EXPECT_EQ(drive["q"][j], plain["q"][j]);  // the terms change nothing
        EXPECT_EQ(drive["tau_J"][j], plain["tau_J"][j]);
      }
      if (HasFailure()) return;
    }
    EXPECT_EQ(plain.variables().find("tau_gravity"), nullptr);
  }
}

TEST(DriveTrainTerms, NeedTheLinksInside) {
  EXPECT_THAT(testing::error_of([] { Drive("robot=lwr4&link_side=outside&terms=true"); }),
              ::testing::HasSubstr("terms=true with link_side=outside"));
}

}  // namespace
}  // namespace cotwin::terms_test
