// The compliance unit in closed loop with the drive train: elastic joints with LuGre friction, torques constant for a
// millisecond.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <string>
#include <tuple>

#include "components/unit/joint_variables.h"
#include "components/unit/unit_table.h"
#include "models/robot/drives/drive_parameters.h"
#include "models/robot/robot_model.h"
#include "tests/support/places.h"

namespace cotwin::drive_train_test {
namespace {

using Eigen::VectorXd;
constexpr Duration kMillisecond{1'000'000};

/// A controller and the robot that it moves.
class Loop {
 public:
  explicit Loop(const std::string& robot) : controller_(make("compliance", robot)), drive_(make("drive_train", robot)) {}

  Eigen::Map<VectorXd> controller(const char* name) { return values(controller_, name); }
  Eigen::Map<VectorXd> drive(const char* name) { return values(drive_, name); }

  /// Both at rest at `q`.
  void start(const VectorXd& q) {
    drive("q0") = q;
    controller("q_d") = q;
    drive_.unit->initialise({});
    exchange();
    controller_.unit->initialise({});
  }
  void step() {
    exchange();
    ASSERT_EQ(controller_.unit->step({}, kMillisecond), StepResult::kDone);
    drive("tau_m") = controller("tau_m").array() + push_;
    drive("tau_e") = controller("tau_e");
    if (pushed_.size() > 0) drive("tau_e") += pushed_;
    ASSERT_EQ(drive_.unit->step({}, kMillisecond), StepResult::kDone);
  }
  /// A torque on every motor in addition to the controller's.
  void push_motor(double tau) { push_ = tau; }
  /// A torque on the links that the controller does not measure.
  void push_links(const VectorXd& tau) { pushed_ = tau; }
  std::string warning() { return controller_.variables.at("warning").strings()[0]; }
  std::int32_t limit(std::size_t i) { return controller_.variables.at("limit").integers()[i]; }
  VectorXd error() { return controller("q_c") - drive("q"); }

 private:
  static Instance make(const std::string& unit, const std::string& robot) {
    return make_unit("unit:" + unit, {{"robot", robot}}, {std::filesystem::path(places::source()) / "models"}, unit_types());
  }
  static Eigen::Map<VectorXd> values(Instance& instance, const char* name) {
    const std::span<double> reals = instance.variables.at(name).reals();
    return {reals.data(), static_cast<Eigen::Index>(reals.size())};
  }
  void exchange() {
    for (const char* name : {"q", "dq", "theta", "dtheta"}) controller(name) = drive(name);
  }

  Instance controller_, drive_;
  double push_ = 0;
  VectorXd pushed_;
};

/// A desired motion that starts at rest: amplitudes a (1 − cos w t) about q0.
void desire(Loop& loop, const VectorXd& q0, double t) {
  for (Eigen::Index i = 0; i < q0.size(); ++i) {
    const double a = 0.4, w = 1.1 + 0.3 * static_cast<double>(i), s = 1 - std::cos(w * t), c = std::cos(w * t);
    loop.controller("q_d")[i] = q0[i] + a * s * s;  // rests with q̇ = q̈ = 0 at t = 0
    loop.controller("dq_d")[i] = 2 * a * w * s * std::sin(w * t);
    loop.controller("ddq_d")[i] = 2 * a * w * w * (std::sin(w * t) * std::sin(w * t) + s * c);
  }
}

double worst_error(Loop& loop, const VectorXd& q0, double seconds) {
  double worst = 0;
  loop.start(q0);
  for (int n = 1; n <= std::lround(seconds * 1000); ++n) {
    desire(loop, q0, n * 1e-3);
    loop.step();
    worst = std::max(worst, loop.error().lpNorm<Eigen::Infinity>());
  }
  return worst;
}

TEST(ComplianceWithDriveTrain, TracksWithinATenthOfAMilliradianInBothModesWhenItKnowsTheDrive) {
  const VectorXd q0 = (VectorXd(7) << 0, 0.3, 0, -1.2, 0, 0.9, 0).finished();
  for (const double passivity : {0.0, 1.0}) {
    Loop loop("lwr4");
    loop.drive("stop_stiffness").setZero();  // the motion goes beyond the limits
    loop.controller("passivity").setConstant(passivity);
    EXPECT_LT(worst_error(loop, q0, 6), 1e-4) << "passivity " << passivity;
  }
}

TEST(ComplianceWithDriveTrain, TracksARobotWithDefaultDriveDataBecauseBothUnitsHaveTheSameDefaults) {
  Loop loop(places::source() + "/tests/components/data/rotor.urdf");  // so that no drive data are beside it
  for (const char* name : {"K", "B"}) EXPECT_EQ(VectorXd(loop.controller(name)), VectorXd(loop.drive(name))) << name;
  EXPECT_LT(worst_error(loop, VectorXd::Zero(1), 6), 1e-4);
}

TEST(ComplianceWithDriveTrain, UnmodelledFrictionCausesAnErrorBoundedByTheGains) {
  const VectorXd q0 = (VectorXd(7) << 0, 0.3, 0, -1.2, 0, 0.9, 0).finished();
  Loop loop("lwr4");
  loop.drive("stop_stiffness").setZero();  // the motion goes beyond the limits
  for (const char* name : {"sigma0", "sigma1", "sigma2", "tau_C", "tau_S"}) loop.controller(name).setZero();
  // At most (tau_S + sigma2 |q̇|) / ((M + B) ω²), and the same once more while the sign changes.
  double bound = 0;
  for (Eigen::Index i = 0; i < 7; ++i) {
    const double omega = loop.controller("omega")[i];
    const double friction = loop.drive("tau_S")[i] + 3 * loop.drive("sigma2")[i];
    bound = std::max(bound, friction / (loop.controller("B")[i] * omega * omega));
  }
  const double worst = worst_error(loop, q0, 6);
  EXPECT_LT(worst, 2 * bound);
  EXPECT_GT(worst, 1e-3);  // and the friction has an effect
}

TEST(ComplianceWithDriveTrain, ErrorsAfterAJumpOfTheExternalTorqueDieOutInBothModes) {
  for (const double passivity : {0.0, 1.0}) {
    Loop loop("planar2");
    loop.controller("passivity").setConstant(passivity);
    loop.start(Eigen::Vector2d(0.4, -0.6));
    loop.controller("tau_e") << 20, -12;
    double worst = 0;
    for (int n = 0; n < 4000; ++n) {
      loop.step();
      worst = std::max(worst, loop.error().lpNorm<Eigen::Infinity>());
    }
    EXPECT_LT(worst, 3e-3) << passivity;  // deflection of the springs: 20 N.m over 10 000 N.m/rad
    EXPECT_LT(loop.error().lpNorm<Eigen::Infinity>(), 1e-5) << passivity;
  }
}

TEST(ComplianceWithDriveTrain, StabilisesAnElasticJointUpToTheLimitOfSampling) {
  // On a soft spring, a constant torque moves the motor alone: θ̇ ← θ̇ − h 2ζω (M + B)/B θ̇, which diverges beyond ζ ω h (M +
  // B)/B = 1.
  const double M = 0.2, zeta = 1, omega = 30, h = 1e-3;
  for (const double share : {0.8, 0.95, 1.05, 1.25}) {
    Loop loop(places::source() + "/tests/components/data/rotor.urdf");
    const double B = M / (share / (zeta * omega * h) - 1);
    for (const auto& [name, value] : {std::pair{"K", 50.0}, {"B", B}}) {
      loop.controller(name).setConstant(value);
      loop.drive(name).setConstant(value);
    }
    loop.controller("omega").setConstant(omega);
    loop.controller("zeta").setConstant(zeta);
    loop.controller("tau_max").setZero();
    loop.start(VectorXd::Zero(1));
    double first = 0, last = 0;
    for (int n = 0; n < 600; ++n) {
      loop.push_motor(n == 0 ? 5 : 0);  // for one step: this disturbs the motor, not the link
      loop.step();
      double& most = n < 300 ? first : last;
      most = std::max(most, std::abs(loop.drive("dtheta")[0] - loop.controller("dtheta_c")[0]));
    }
    if (share < 1) {
      EXPECT_LT(last, 0.1 * first) << share;
    } else {
      EXPECT_GT(last, 10 * first) << share;
    }
  }
}

TEST(ComplianceWithDriveTrain, TorqueFeedbackDampsLinksThatVibrateOnTheirSprings) {
  // Error 0.2 to 0.4 s after a jump: with shaping the links are at rest by then.
  const auto ringing = [](double shaping) {
    Loop loop("planar2");
    loop.controller("shaping").setConstant(shaping);
    for (const char* name : {"sigma0", "sigma1", "tau_C", "tau_S"}) {  // friction also damps
      loop.controller(name).setZero();
      loop.drive(name).setZero();
    }
    loop.start(Eigen::Vector2d(0.4, -0.6));
    loop.controller("tau_e") << 20, -12;
    double sum = 0;
    VectorXd before = loop.error();
    for (int n = 0; n < 400; ++n) {
      loop.step();
      if (n >= 200) sum += (loop.error() - before).squaredNorm();  // velocity: slow creep has little effect
      before = loop.error();
    }
    return std::sqrt(sum);
  };
  EXPECT_LT(ringing(4), 0.3 * ringing(1));
}

TEST(ComplianceWithDriveTrain, IsGuidedFreelyByAnExternalTorqueAndStaysWhereItIsLeft) {
  Loop loop("planar2");
  loop.controller("S_a").setZero();
  loop.controller("D_a").setConstant(20);
  const Eigen::Vector2d q0(0.4, -0.6);
  loop.start(q0);
  loop.controller("tau_e") << 6, 3;
  for (int n = 0; n < 2000; ++n) loop.step();
  loop.controller("tau_e").setZero();
  for (int n = 0; n < 3000; ++n) loop.step();
  const VectorXd left = loop.drive("q");
  EXPECT_NEAR(left[0] - q0[0], 6.0 / 20 * 2, 1e-3);  // τ_e/D for 2 s; the way lost at the start is made up when stopping
  EXPECT_NEAR(left[1] - q0[1], 3.0 / 20 * 2, 1e-3);
  for (int n = 0; n < 1000; ++n) loop.step();
  EXPECT_LT((loop.drive("q") - left).norm(), 1e-5);
}

TEST(ComplianceWithDriveTrain, UnequalGainsReduceAnErrorOfAMilliradianInBothModes) {
  // Gains that differ by a factor of 40 between the joints of one arm: with K_P = (M + B) Ω² an error of 1 mrad grew to 29 rad.
  for (const double passivity : {0.0, 1.0}) {
    Loop loop("planar2");
    for (const char* name : {"sigma0", "sigma1", "sigma2", "tau_C", "tau_S"}) {
      loop.controller(name).setZero();
      loop.drive(name).setZero();
    }
    for (const auto& [name, first, second] : {std::tuple{"K", 5328.0, 2897.0}, {"B", 0.0861, 0.1373}}) {
      loop.controller(name) << first, second;
      loop.drive(name) << first, second;
    }
    for (const auto& [name, first, second] : {std::tuple{"omega", 1.055, 44.04},
                                              {"zeta", 1.0, 1.0},
                                              {"shaping", 1.0, 1.0},
                                              {"Lambda", 1.055, 44.04},
                                              {"K_s", 3.0, 3.0}}) {
      loop.controller(name) << first, second;
    }
    loop.controller("passivity").setConstant(passivity);
    const Eigen::Vector2d q0(0.5, -0.8);
    loop.start(q0);
    loop.controller("q_d") = q0 + Eigen::Vector2d(1e-3, 1e-3);
    double worst = 0;
    for (int n = 0; n < 20'000; ++n) {
      loop.step();
      worst = std::max(worst, loop.error().lpNorm<Eigen::Infinity>());
    }
    EXPECT_LT(worst, 2e-3) << passivity;
    EXPECT_LT(loop.error().lpNorm<Eigen::Infinity>(), 1e-5) << passivity;
  }
}

TEST(ComplianceWithDriveTrain, AJumpOfTheExternalTorqueAsksTheMotorsForAtMostTauWindUp) {
  // The springs carry 20 N.m more after the jump. Earlier versions asked the motors for 400 N.m for some milliseconds, of which
  // 150 were given.
  for (const double passivity : {0.0, 1.0}) {
    Loop loop("planar2");
    loop.controller("passivity").setConstant(passivity);
    for (const char* name : {"M_a", "S_a"}) loop.controller(name).setConstant(name[0] == 'M' ? 6.25 : 100);
    loop.start(Eigen::Vector2d(0.5, -0.8));
    for (int n = 0; n < 100; ++n) loop.step();
    const VectorXd tau_m = loop.controller("tau_m"), tau_id = loop.controller("tau_id");
    loop.controller("tau_e") << 20, 9;
    loop.step();
    const VectorXd requested = loop.controller("tau_id") - tau_id;
    VectorXd most = (loop.controller("tau_m") - tau_m).cwiseAbs();
    for (int n = 0; n < 2000; ++n) {
      loop.step();
      most = most.cwiseMax((loop.controller("tau_m") - tau_m).cwiseAbs());
    }
    for (int i = 0; i < 2; ++i) {
      EXPECT_LT(most[i], loop.controller("tau_wind_up")[i] + 0.1 * std::abs(requested[i])) << passivity << " joint " << i + 1;
      EXPECT_LT(most[i], 5 * std::abs(requested[i])) << passivity << " joint " << i + 1;
    }
    EXPECT_EQ(loop.warning(), "");
  }
}

TEST(ComplianceWithDriveTrain, StopsAtAJointLimitWhenPushedAndTheRunReportsIt) {
  Loop loop("planar2");
  loop.controller("S_a").setZero();
  loop.start(Eigen::Vector2d(2.0, 0));
  EXPECT_EQ(loop.warning(), "");
  loop.controller("tau_e") << 8, 0;
  double farthest = 0, fastest = 0;
  for (int n = 0; n < 4000; ++n) {
    loop.step();
    farthest = std::max(farthest, loop.controller("q_c")[0]);
    fastest = std::max(fastest, loop.controller("dq_c")[0]);
  }
  EXPECT_LE(farthest, 2.8 + 1e-12);  // of the URDF
  EXPECT_GT(farthest, 2.8 - 1e-6);
  EXPECT_LE(fastest, 3);
  EXPECT_NEAR(loop.drive("q")[0], 2.8, 1e-4);
  EXPECT_EQ(loop.limit(0), 1);
  EXPECT_EQ(loop.limit(1), 0);
  EXPECT_NE(loop.warning().find("compliant motion of joints 1 was stopped at a limit of position"), std::string::npos)
      << loop.warning();
  // Pulled back, it leaves the limit at once.
  loop.controller("tau_e") << -8, 0;
  loop.step();
  EXPECT_LT(loop.controller("dq_c")[0], 0);
  EXPECT_EQ(loop.limit(0), 0);
}

TEST(ComplianceWithDriveTrain, SaturatedMotorsDoNotWindUpAndReturnWithoutOvershoot) {
  // The links are pushed with more than the motors can give, which the controller does not measure; then they are released.
  Loop loop("planar2");
  const Eigen::Vector2d q0(0.5, -0.8);
  loop.controller("tau_max") << 60, 30;
  loop.start(q0);
  for (int n = 0; n < 100; ++n) loop.step();
  loop.push_links(Eigen::Vector2d(80, 0));
  double away = 0;
  for (int n = 0; n < 300; ++n) {
    loop.step();
    away = std::max(away, std::abs(loop.error()[0]));
  }
  EXPECT_GT(away, 0.02);
  EXPECT_NE(loop.warning().find("motor torques of joints 1"), std::string::npos) << loop.warning();
  loop.push_links(Eigen::Vector2d(0, 0));
  double beyond = 0;
  for (int n = 0; n < 3000; ++n) {
    loop.step();
    if (n > 300) beyond = std::max(beyond, std::abs(loop.error()[0]));
  }
  EXPECT_LT(beyond, 0.5 * away);
  EXPECT_LT(loop.error().lpNorm<Eigen::Infinity>(), 2e-4);
}

Instance make(const std::string& unit, const std::string& robot) {
  return make_unit("unit:" + unit + "?robot=" + robot, {}, {std::filesystem::path(places::source()) / "models"}, unit_types());
}

// Both units declare the parameters of the drive from one table.
TEST(ComplianceWithDriveTrain, DeclaresTheParametersOfTheDriveAlike) {
  const Instance drive = make("drive_train", "planar2"), controller = make("compliance", "planar2");
  int shared = 0;
  for (const auto& row : robot::kDriveParameters) {
    const Variable& a = drive.variables.at(row.name);
    EXPECT_EQ(a.role == Role::kTunable, row.mutability != Mutability::kFixed) << row.name;
    EXPECT_EQ(a.size(), row.size(2)) << row.name;
    const Variable* b = controller.variables.find(row.name);
    if (b == nullptr) continue;
    ++shared;
    EXPECT_EQ(a.role, b->role) << row.name;
    EXPECT_EQ(a.si, b->si) << row.name;
    EXPECT_EQ(a.min, b->min) << row.name;
    EXPECT_EQ(a.max, b->max) << row.name;
    EXPECT_TRUE(b->description.starts_with(a.description)) << row.name;
    const bool followed = controller.variables.find(std::string(row.name) + "_in_force") != nullptr;
    EXPECT_EQ(followed, row.mutability != Mutability::kFixed) << row.name;
  }
  EXPECT_EQ(shared, 27);
}

TEST(JointMeasures, OfPrismaticJointsAreInMetresAndNewtons) {
  const std::string gantry = places::source() + "/tests/components/data/gantry.urdf";
  for (const char* unit : {"drive_train", "compliance"}) {
    const Instance instance = make(unit, gantry);
    const auto si = [&](const char* name) { return instance.variables.at(name).si; };
    EXPECT_EQ(si("q"), "m") << unit;
    EXPECT_EQ(si("dq"), "m/s") << unit;
    EXPECT_EQ(si("tau_m"), "N") << unit;
    EXPECT_EQ(si("K"), "N/m") << unit;
    EXPECT_EQ(si("B"), "kg") << unit;
    EXPECT_EQ(si("sigma2"), "N.s/m") << unit;
    EXPECT_EQ(si("link_alpha"), "s/m") << unit;
    EXPECT_EQ(si("inertia"), "kg.m2") << unit;  // of bodies, not of joints
  }
  EXPECT_EQ(make("compliance", gantry).variables.at("omega").si, "rad/s");  // a frequency
  EXPECT_EQ(make("motion", gantry).variables.at("q_d").si, "m");
  EXPECT_EQ(make("io", gantry).variables.at("tau_e").si, "N");
  EXPECT_EQ(make("contact_world", gantry).variables.at("tau_e").si, "N");
  EXPECT_EQ(make("tuner", gantry).variables.at("sigma2").si, "N.s/m");
}

TEST(JointMeasures, AreThoseOfEachJointWithItsName) {
  robot::RobotModel robot;
  robot.joints.resize(4);
  robot.joints[2].type = robot::JointType::kPrismatic;
  robot.joints[2].name = "my slide";
  const JointMeasures measures(&robot);
  EXPECT_EQ(measures.si("N.m/rad", 1), "N.m/rad");
  EXPECT_EQ(measures.si("N.m/rad", 2), "N/m");
  std::vector<double> q(4), rows(8), three(3);
  Variables v;
  JointVariables joints(v, measures);
  joints.input("q", q, "rad", "position");
  joints.output("dq", q, "rad/s", "speed").derivative_of("q");
  joints.parameter("damping", q, "1", "damping ratio");
  joints.parameter("table", rows, "rad", "row after row");
  joints.parameter("other", three, "rad", "not of the joints");
  EXPECT_EQ(v.at("q").si, "");
  EXPECT_EQ(v.at("q").si_of(0), "rad");
  EXPECT_EQ(v.at("q").si_of(2), "m");
  EXPECT_EQ(v.at("q").elements->names[2], "my slide");
  EXPECT_EQ(v.at("dq").si_of(2), "m/s");
  EXPECT_FALSE(v.at("damping").mixed());
  EXPECT_EQ(v.at("table").si_of(6), "m");
  EXPECT_TRUE(v.at("table").elements->names.empty());
  EXPECT_EQ(v.at("other").si, "rad");
  Variables one_kind;
  for (robot::Joint& joint : robot.joints) joint.type = robot::JointType::kPrismatic;
  JointVariables(one_kind, JointMeasures(&robot)).input("q", q, "rad", "position");
  EXPECT_EQ(one_kind.at("q").si, "m");
}

}  // namespace
}  // namespace cotwin::drive_train_test
