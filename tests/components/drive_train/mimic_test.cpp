// The drive train of robots with mimic, locked and passive joints.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/components/drive_train/harness.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::mimic_test {
namespace {

using testing::Drive;
using ::testing::HasSubstr;

const std::string kFinger = places::source() + "/tests/components/data/finger.urdf";

std::vector<std::string> methods() { return {"rosenbrock", "cvode"}; }

void without_friction(Drive& drive) {
  for (const char* name : {"D", "sigma0", "sigma1", "sigma2", "tau_C", "tau_S"}) drive.set(name, 0);
}

TEST(DriveTrainMimic, HasTheIndependentJointsAsPortsAndKeepsItsEnergy) {
  for (const std::string& method : methods()) {
    Drive drive("robot=" + kFinger + "&method=" + method);
    without_friction(drive);
    ASSERT_EQ(drive["q"].size(), 2u);
    EXPECT_EQ(drive["mass"].size(), 4u);
    drive.set("K", 2000).set("B", 0.01).tolerances(1e-10, 1e-11, 1e-9).set("max_substeps", 100000);
    drive["q0"][1] = 0.3;
    drive.initialise();
    const double start = drive.energy();
    double most = 0;
    for (int n = 0; n < 300; ++n) {
      drive.step(1e-3);
      most = std::max(most, drive["energy_kinetic"][0]);
      ASSERT_NEAR(drive.energy(), start, 2e-6) << method << ", step " << n;
    }
    EXPECT_GT(most, 1) << method;
  }
}

TEST(DriveTrainMimic, TheMotorOfTheLeaderMovesTheGroupAndItsOwnInertia) {
  // From rest with a rigid transmission: (Gᵀ M G + B) q̈ = τ_m − Gᵀ g, M and g of the robot with four free joints.
  robot::RobotModel all = robot::load_urdf(kFinger);
  robot::RobotModel free = all;  // in the order of the tree: shoulder, knuckle, bend, tip
  for (const robot::Mimic& mimic : all.mimics) free.joints.push_back(mimic.joint);
  free.mimics.clear();
  Eigen::MatrixXd G(4, 2), M(4, 4);
  G << 1, 0, 0, 1, 0, 0.8, 0, 0.4;
  const Eigen::Vector2d q(0.2, 0.5), tau(7, 0.4), B(0.3, 0.05);
  const Eigen::VectorXd at = G * q + Eigen::Vector4d(0, 0, 0.1, 0.05);
  Eigen::VectorXd g(4);
  const robot::Mechanism mechanism(free);
  robot::Data data(mechanism);
  robot::mass_matrix(mechanism, data, at, M);
  robot::gravity(mechanism, data, at, g);
  const Eigen::Vector2d expected =
      (G.transpose() * M * G + Eigen::MatrixXd(B.asDiagonal())).ldlt().solve(tau - G.transpose() * g);

  Drive drive("robot=" + kFinger + "&transmission=rigid");
  without_friction(drive);
  for (std::size_t i = 0; i < 2; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    drive["q0"][i] = q[k];
    drive["B"][i] = B[k];
    drive["tau_m"][i] = tau[k];
  }
  drive.initialise();
  EXPECT_NEAR(drive["ddq"][0], expected[0], 1e-11);
  EXPECT_NEAR(drive["ddq"][1], expected[1], 1e-11);
}

TEST(DriveTrainPassive, MovesUnderGravityAndTheFrictionOfItsLinkAlone) {
  // A pendulum m, I, l on a passive joint against Runge-Kutta of (I + m l²) q̈ = m g l cos q − d q̇
  for (const std::string& method : methods()) {
    for (const char* transmission : {"flexible", "rigid"}) {
      for (const char* friction : {"lugre", "coulomb", "smooth"}) {
        if (std::string(transmission) == "rigid" && std::string(friction) == "coulomb") continue;
        const std::string query = "robot=" + kFinger + "&passive=shoulder&lock=knuckle:0.2&method=" + method +
                                  "&transmission=" + transmission + "&friction=" + friction;
        Drive drive(query);
        ASSERT_EQ(drive["q"].size(), 1u);
        // The parameters of a motor and its torque have no effect.
        drive.set("K", 500).set("B", 3).set("D", 1).set("sigma0", 100).set("sigma2", 2).set("tau_C", 5).set("tau_S", 6);
        drive.set("tau_m", 40).set("link_sigma2", 0.05);
        drive.tolerances(1e-10, 1e-11, 1e-9).set("max_substeps", 100000);
        drive["q0"][0] = 0.4;
        drive.initialise();

        robot::UrdfOptions options;
        options.locked["knuckle"] = 0.2;
        const robot::RobotModel pendulum = robot::load_urdf(kFinger, options);
        ASSERT_EQ(pendulum.n(), 1);
        const Inertia& body = pendulum.bodies[0].inertia;
        const double I = body.I_CC(1, 1) + body.mass * (body.p_LC.x() * body.p_LC.x() + body.p_LC.z() * body.p_LC.z());
        const auto f = [&](double q, double dq) {
          const double torque = body.mass * 9.81 * (std::cos(q) * body.p_LC.x() + std::sin(q) * body.p_LC.z());
          return (torque - 0.05 * dq) / I;
        };
        double q = 0.4, dq = 0;
        const double start = drive.energy();
        for (int n = 0; n < 400; ++n) {
          drive.step(1e-3);
          constexpr double h = 5e-4;
          for (int s = 0; s < 2; ++s) {
            const double k1 = f(q, dq), k2 = f(q + h / 2 * dq, dq + h / 2 * k1),
                         k3 = f(q + h / 2 * dq + h * h / 4 * k1, dq + h / 2 * k2),
                         k4 = f(q + h * dq + h * h / 2 * k2, dq + h * k3);
            q += h * dq + h * h / 6 * (k1 + k2 + k3);
            dq += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
          }
          ASSERT_NEAR(drive["q"][0], q, 1e-7) << query << ", step " << n;
          ASSERT_EQ(drive["theta"][0], drive["q"][0]);
          ASSERT_EQ(drive["tau_J"][0], 0);
          ASSERT_EQ(drive["tau_f"][0], 0);
        }
        EXPECT_GT(q, 1);
        EXPECT_EQ(drive["work_m"][0], 0) << query;
        EXPECT_NEAR(drive.unbalanced(start), 0, 1e-6) << query;
      }
    }
  }
}

TEST(DriveTrainPassive, StepAllocatesNothingAndIsRepeatable) {
  const std::string query = "robot=" + kFinger + "&passive=knuckle";
  Drive one(query), other(query);
  for (Drive* drive : {&one, &other}) {
    drive->set("link_tau_C", 0.02).set("link_v_R", 0.05);
    drive->initialise();
    drive->set("tau_m", 3);
    drive->step(1e-3);
  }
  const std::uint64_t before = testing::allocations();
  for (int n = 0; n < 100; ++n) one.step(1e-3);
  EXPECT_EQ(testing::allocations(), before);
  // The other is saved and restored half way.
  for (int n = 0; n < 50; ++n) other.step(1e-3);
  Snapshot snapshot;
  snapshot.take(other.instance().variables, *other.instance().unit);
  for (int n = 0; n < 20; ++n) other.step(1e-3);
  snapshot.restore(other.instance().variables, *other.instance().unit);
  for (int n = 0; n < 50; ++n) other.step(1e-3);
  for (const char* name : {"q", "dq", "theta", "dtheta", "tau_J"}) {
    for (std::size_t i = 0; i < 2; ++i) EXPECT_EQ(one[name][i], other[name][i]) << name;
  }
}

TEST(DriveTrainPassive, OutsideTheLinkGivesNoTorque) {
  Drive drive("link_side=outside&robot=" + kFinger + "&passive=knuckle");
  drive.set("K", 1000).set("tau_m", 2);
  drive.initialise();
  drive["q"][0] = drive["q"][1] = 0.01;
  drive["dq"][0] = drive["dq"][1] = 0.5;
  drive.step(1e-3);
  EXPECT_NE(drive["tau_J"][0], 0);
  EXPECT_EQ(drive["tau_J"][1], 0);
  EXPECT_NEAR(drive["theta"][1], 0.01 + 0.5e-3, 1e-15);  // the link's position at the end of the step: q moves on with dq
}

TEST(DriveTrainPassive, WrongSettingsAreErrors) {
  const auto error = [](const std::string& more) { return testing::error_of([&] { Drive drive("robot=" + kFinger + more); }); };
  EXPECT_THAT(error("&lock=knuckle"), HasSubstr("lock=knuckle, expected joint:position,joint:position in rad or m"));
  EXPECT_THAT(error("&lock=knuckle:0.1,knuckle:0.2"), HasSubstr("joint 'knuckle' stands there twice"));
  EXPECT_THAT(error("&lock=knukle:0.1"), HasSubstr("no joint 'knukle' to lock"));
  EXPECT_THAT(error("&lock=bend:0.1"), HasSubstr("joint 'bend': mimics 'knuckle', expected that joint to be locked"));
  EXPECT_THAT(error("&lock=knuckle:0,shoulder:1"), HasSubstr("has no movable joint"));
  EXPECT_THAT(error("&passive=tip"), HasSubstr("joint 'tip': mimics 'knuckle', expected that joint to be passive"));
  EXPECT_THAT(error("&passive=,"), HasSubstr("expected joint,joint"));
}

}  // namespace
}  // namespace cotwin::mimic_test
