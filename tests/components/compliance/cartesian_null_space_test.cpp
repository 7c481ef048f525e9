// Lower tasks, goals and compliance of the self-motion below Cartesian compliance, in the whole unit.
#include <Eigen/LU>
#include <tuple>

#include "models/foundation/support/error.h"
#include "models/robot/indices.h"
#include "tests/components/compliance/cartesian_harness.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::testing::cartesian_null_space_test {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// (0, 30, 0, −60, 0, 60, 0)°.
VectorXd reference_pose() { return (VectorXd(7) << 0, 30, 0, -60, 0, 60, 0).finished() * std::acos(-1.0) / 180; }

Subject unit_at(const std::string& query, const std::string& robot, const VectorXd& q, const std::string& frame = "") {
  Subject unit("unit:compliance?space=cartesian" + (frame.empty() ? "" : "&frame=" + frame) + query, robot);
  desire(unit, Kinematics(robot, frame).at(q));
  unit["q"] = q;
  unit["theta"] = q;
  return unit;
}

TEST(CartesianNullSpace, SelfMotionAfterAPushGoesOnWithoutDampingAndStopsWithIt) {
  for (const double k_nu : {0.0, 4.0}) {
    const VectorXd q = lwr4_posture();
    Subject unit = unit_at("&wrench=joints", "lwr4", q);
    unit["k_nu"].setConstant(k_nu);
    unit["S_T"].setConstant(1e5);
    unit["K_o"].setConstant(1e4);
    unit.initialise();
    unit["tau_e"] = 0.3 * VectorXd::Unit(7, 2);
    for (int i = 0; i < 300; ++i) unit.step();
    unit["tau_e"].setZero();
    for (int i = 0; i < 300; ++i) unit.step();
    const double energy = unit.value("null_energy");
    EXPECT_EQ(unit.value("null_potential"), 0);
    for (int i = 0; i < 1500; ++i) unit.step();
    EXPECT_LT((Vector3d(unit["p_c"]) - Vector3d(unit["p_d"])).norm(), 1e-6);
    EXPECT_LT(unit.value("task_error"), 1e-5);
    if (k_nu == 0) {
      EXPECT_GT(energy, 0.01);
      EXPECT_NEAR(unit.value("null_energy"), energy, 0.01 * energy);
    } else {
      EXPECT_LT(unit.value("null_energy"), 1e-5 * energy);  // e^(−2 k_ν t) at 1.5 s
    }
  }
}

TEST(CartesianNullSpace, ThePostureIsReachedAsFarAsThePoseAllows) {
  const VectorXd q = lwr4_posture();
  Subject unit = unit_at("&null_space=posture", "lwr4", q);
  unit["q_0"] = reference_pose();
  unit.initialise();
  for (int i = 0; i < 6000; ++i) unit.step();
  EXPECT_LT(unit.value("task_error"), 1e-9);
  EXPECT_LT(unit.value("null_energy"), 1e-8);
  // Nᵀ K (q − q_0) = 0: the force of the posture has no part along the one direction of the null space.
  const MatrixXd J = Kinematics("lwr4").jacobian(unit["q_c"]);
  const VectorXd z = Eigen::FullPivLU<MatrixXd>(J).kernel().col(0).normalized();
  EXPECT_NEAR(z.dot(10 * (VectorXd(unit["q_c"]) - reference_pose())), 0, 1e-4);
  EXPECT_GT((VectorXd(unit["q_c"]) - q).norm(), 0.05);
}

// A goal from outside, xi = −M⁻¹ K (q_c − q_0) of the step's beginning, is the built-in posture but for its age: half the step, half the
// difference. The frame stays.
TEST(CartesianNullSpace, AGoalFromOutsideActsAsTheSameGoalInside) {
  const VectorXd q = lwr4_posture();
  const robot::RobotModel model = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  const robot::Mechanism mechanism(model);
  robot::Data data(mechanism);
  MatrixXd M(7, 7);
  std::vector<double> furthest;
  for (const int parts : {1, 2}) {
    Subject inside = unit_at("&null_space=posture", "lwr4", q), outside = unit_at("", "lwr4", q);
    inside["q_0"] = reference_pose();
    inside.initialise();
    outside.initialise();
    furthest.push_back(0);
    for (int i = 0; i < 2000 * parts; ++i) {
      const VectorXd at = outside["q_c"];
      robot::mass_matrix(mechanism, data, at, M);
      outside["xi"] = -M.ldlt().solve(VectorXd(10 * (at - reference_pose())));
      inside.step(1e-3 / parts);
      outside.step(1e-3 / parts);
      furthest.back() = std::max(furthest.back(), (VectorXd(inside["q_c"]) - VectorXd(outside["q_c"])).norm());
    }
    EXPECT_GT((VectorXd(outside["q_c"]) - q).norm(), 0.4);
    EXPECT_LT(outside.value("task_error"), 1e-9);
    EXPECT_LT((Vector3d(outside["p_c"]) - Vector3d(outside["p_d"])).norm(), 1e-12);
    outside["xi"][3] = std::nan("");
    EXPECT_NE(error_of([&] { outside.step(); }).find(".xi: is not finite, expected finite values"), std::string::npos);
  }
  EXPECT_LT(furthest[0], 5e-3);
  EXPECT_NEAR(furthest[0] / furthest[1], 2, 0.2);
}

TEST(CartesianNullSpace, TheEffectiveMassEndsAtItsLeastValueOnTheSelfMotion) {
  // Of the specification: along the self-motion of this pose 2.62214 to 3.31740 kg, the least value at q_3 = 105.4°. The masses
  // of the arm are not symmetric: on the other side the least value is 2.62254, at −106.2°.
  for (const double start : {-0.3, -0.6, 0.3, 0.6}) {
    Subject unit = unit_at("&wrench=joints&null_space=effective_mass", "lwr4", reference_pose(), "link_7");
    unit["w_mass"].setZero();
    unit["k_nu"].setConstant(4);
    unit["S_T"].setConstant(1e5);
    unit["K_o"].setConstant(1e4);
    unit.initialise();
    unit["tau_e"] = start * VectorXd::Unit(7, 2);
    for (int i = 0; i < 500; ++i) unit.step();
    unit["tau_e"].setZero();
    unit["w_mass"].setConstant(60);
    for (int i = 0; i < 12000; ++i) unit.step();
    EXPECT_NEAR(unit.value("effective_mass"), unit["q_c"][2] > 0 ? 2.62214 : 2.62254, 1e-5);
    EXPECT_NEAR(unit["q_c"][2] * 180 / std::acos(-1.0), unit["q_c"][2] > 0 ? 105.4 : -106.2, 0.1);
    EXPECT_LT(unit.value("null_energy"), 1e-6);
    EXPECT_LT(unit.value("task_error"), 1e-6);
  }
}

TEST(CartesianNullSpace, JointsStayAwayFromTheirLimitsWhereAskedTo) {
  VectorXd q = lwr4_posture();
  const auto run = [&](const std::string& query) {
    Subject unit = unit_at("&wrench=joints" + query, "lwr4", q);
    unit["k_nu"].setConstant(1);
    unit.initialise();
    double least = 10;
    for (int i = 0; i < 4000; ++i) {
      unit["tau_e"] = (i < 1500 ? 6 : 0) * VectorXd::Unit(7, 2);
      unit.step();
      for (int j = 0; j < 7; ++j)
        least = std::min({least, unit["q_max"][j] - unit["q_c"][j], unit["q_c"][j] - unit["q_min"][j]});
    }
    return least;
  };
  const double without = run(""), with = run("&null_space=limits");
  EXPECT_LT(without, 0.1);
  EXPECT_GT(with, without + 0.05);
}

TEST(CartesianNullSpace, AHeldElbowStaysUnderAPushAndALowerTaskDisturbsNoHigherOne) {
  const VectorXd q = lwr4_posture();
  Kinematics elbow("lwr4", "link_4");
  const Vector3d p = elbow.at(q).p;
  Subject held = unit_at("&wrench=joints&tasks=pose,link_4:z", "lwr4", q);
  Subject free = unit_at("&wrench=joints", "lwr4", q);
  for (Subject* unit : {&held, &free}) {
    unit->initialise();
    (*unit)["tau_e"] = 3 * VectorXd::Unit(7, 2);
    for (int i = 0; i < 800; ++i) unit->step();
  }
  EXPECT_LT(std::abs(elbow.at(held["q_c"]).p.z() - p.z()), 2e-3);
  EXPECT_GT((elbow.at(free["q_c"]).p - p).norm(), 0.02);
  EXPECT_LT(held.value("task_error"), 1e-5);
}

TEST(CartesianNullSpace, TasksThatContradictAreToldAndTheHigherOneIsDone) {
  const VectorXd q = lwr4_posture();
  Subject unit = unit_at("&tasks=pose,link_4", "lwr4", q);  // the elbow has one direction left, not three
  unit.initialise();
  EXPECT_EQ(unit.warning(), "");
  unit["shift_held"] = Vector3d(0.1, 0.1, 0.1);
  for (int i = 0; i < 3000; ++i) unit.step();
  EXPECT_LT(unit.value("task_error"), 1e-6);
  EXPECT_GT(unit["task_residual"][1], 0.1);
  EXPECT_LT(unit["task_sigma"][1], 1e-6);
  EXPECT_NE(unit.warning().find("a lower task could not be done"), std::string::npos) << unit.warning();
}

TEST(CartesianNullSpace, WhereBothCanBeDonePositionBeforeOrientationIsThePose) {
  const VectorXd q = (VectorXd(6) << 0.3, -1.2, 1.4, 0.2, 0.5, 0).finished();
  VectorXd pose;
  for (const std::string tasks : {"pose", "position,orientation", "orientation,z,x,y"}) {
    Subject unit = unit_at("&tasks=" + tasks, "kr300_r2500", q);
    unit.initialise();
    unit["f_e"] = Vector3d(50, -80, 60);
    unit["m_e"] = Vector3d(5, 9, -7);
    for (int i = 0; i < 500; ++i) unit.step();
    EXPECT_LT(unit.value("task_error"), 1e-6) << tasks;
    if (pose.size() == 0) pose = unit["q_c"];
    EXPECT_LT((VectorXd(unit["q_c"]) - pose).norm(), 1e-8) << tasks;
  }
}

TEST(CartesianNullSpace, ActivationOfAHeldFrameSwitchesWithoutAJump) {
  Subject unit = unit_at("&tasks=pose,link_4:z&wrench=joints", "lwr4", lwr4_posture());
  unit["activation"].setZero();
  unit.initialise();
  unit["tau_e"] = 2 * VectorXd::Unit(7, 2);
  for (int i = 0; i < 400; ++i) unit.step();
  unit["activation"].setOnes();
  VectorXd before = unit["dq_c"];
  double jump = 0;
  for (int i = 0; i < 800; ++i) {
    unit.step();
    jump = std::max(jump, (VectorXd(unit["dq_c"]) - before).norm());
    before = unit["dq_c"];
  }
  EXPECT_LT(jump, 0.05);
  EXPECT_TRUE(before.allFinite());
}

// Stretched arms, poses out of reach, contradicting tasks, huge weights and torques: everything stays finite and within the
// limits of the joints.
TEST(CartesianNullSpace, StaysFiniteAndWithinTheLimitsOfTheJointsWhateverIsAsked) {
  constexpr double kSlack = 1e-8, kWay = 1e-5;  // of limits.cpp; rad, where braking ends within a step
  const std::string goals = "&null_space=posture,limits,manipulability,effective_mass";
  for (const auto& [robot, query, joints] : {std::tuple{"lwr4", "&tasks=position,link_4,orientation,link_4:z", 7},
                                             {"lwr4", "&tasks=link_4:z,pose", 7},
                                             {"kr300_r2500", "&tasks=orientation,position", 6},
                                             {"planar2", "&task=x,z&tasks=z,x", 2},
                                             {"planar2", "&task=x", 2}}) {
    for (const double reach : {0.0, 10.0}) {
      for (const double weight : {1.0, 1e7}) {
        SCOPED_TRACE(std::string(robot) + query + ", " + std::to_string(reach) + " m, " + std::to_string(weight));
        VectorXd start = VectorXd::Zero(joints);          // stretched
        if (joints == 6) start << 0, -1.2, 1.4, 0, 0, 0;  // 0 is outside the limits; the wrist is singular
        Subject unit = unit_at(query + ("&wrench=joints" + goals), robot, start);
        unit["p_d"] += Vector3d(reach, -reach, reach);
        unit["K_0"].setConstant(weight);
        unit["w_mass"].setConstant(weight);
        unit["k_nu"].setConstant(weight / 100);
        unit["q_0"].setConstant(0.5);
        unit.initialise();
        for (int i = 0; i < 1000; ++i) {
          unit["tau_e"].setConstant(i % 200 < 100 ? 30 : -20);
          unit.step();
          const VectorXd q = unit["q_c"], dq = unit["dq_c"];
          ASSERT_TRUE(q.allFinite() && dq.allFinite() && VectorXd(unit["tau_m"]).allFinite()) << i;
          for (int j = 0; j < joints; ++j) {
            ASSERT_LE(std::abs(dq[j]), unit["dq_max"][j] * (1 + kSlack)) << i << ", joint " << j;
            if (unit["q_min"][j] >= unit["q_max"][j]) continue;
            ASSERT_GE(q[j], unit["q_min"][j] - kWay) << i << ", joint " << j;
            ASSERT_LE(q[j], unit["q_max"][j] + kWay) << i << ", joint " << j;
          }
        }
        for (const char* output :
             {"null_energy", "null_potential", "manipulability", "effective_mass", "task_sigma", "task_residual"})
          EXPECT_TRUE(VectorXd(unit[output]).allFinite()) << output;
      }
    }
  }
}

TEST(CartesianNullSpace, AllocatesNothing) {
  for (const std::string query : {"", "&tasks=position,orientation,link_4:z", "&wrench=joints&null_space=posture,limits",
                                  "&null_space=manipulability", "&tasks=pose,link_4&null_space=effective_mass"}) {
    Subject unit = unit_at(query, "lwr4", lwr4_posture());
    unit.initialise();
    unit.step();
    const auto before = allocations();
    for (int i = 0; i < 5; ++i) unit.step();
    EXPECT_EQ(allocations() - before, 0U) << query;
  }
}

TEST(CartesianNullSpace, RefusesTasksThatItCannotRead) {
  const auto error = [](const std::string& query) {
    return error_of([&] { Subject("unit:compliance?space=cartesian" + query, "lwr4"); });
  };
  EXPECT_NE(error("&tasks=pose,elbow").find("'elbow' is no frame of robot"), std::string::npos) << error("&tasks=pose,elbow");
  EXPECT_NE(error("&tasks=position").find("no task has direction rx"), std::string::npos);
  EXPECT_NE(error("&tasks=pose,x").find("direction x is in two tasks"), std::string::npos);
  EXPECT_NE(error("&tasks=pose,link_4:rx").find("expected x, y or z after the colon"), std::string::npos);
  EXPECT_NE(error("&tasks=pose,orientation&task=x").find("has no direction"), std::string::npos);
  EXPECT_NE(error("&null_space=damping").find("expected some of posture"), std::string::npos);
  const std::string fixed = Kinematics("lwr4").at(lwr4_posture()).p.norm() > 0 ? error("&tasks=pose,base") : "";
  EXPECT_FALSE(fixed.empty());
  EXPECT_NE(error_of([&] {
              Subject unit = unit_at("&null_space=effective_mass", "lwr4", lwr4_posture());
              unit["mass_axis"].setZero();
              unit.initialise();
            }).find("mass_axis"),
            std::string::npos);
}

}  // namespace
}  // namespace cotwin::testing::cartesian_null_space_test
