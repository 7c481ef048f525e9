// The unit's poses: a Cartesian motion, and forward kinematics of a joint motion.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "components/motion/motion.h"
#include "components/unit/unit_table.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/components/motion/subject.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::poses_test {
namespace {

using cotwin::testing::TemporaryFile;
using Eigen::Quaterniond, Eigen::Vector3d, Eigen::VectorXd;
using testing::error_of;
using ::testing::HasSubstr;

using testing::kTick;
using testing::Values;
using Subject = testing::MotionSubject;

robot::RobotModel lwr4() { return robot::load_urdf(std::filesystem::path(places::source()) / "models/robots/lwr4/robot.urdf"); }

TEST(MotionPoses, FollowALineAndAGeodesicAtThePhasesRates) {
  Subject s("space=cartesian", {{"waypoint_p", "0.4,0,0.5, 0.4,0.3,0.5"},
                                {"waypoint_quat", "1,0,0,0, 0,1,0,0"},  // half a turn about x
                                {"waypoint_t", "0,2"},
                                {"time_scale", "2"},
                                {"t_start", "1"}});
  s.initialise();
  EXPECT_FALSE(s.has("q_d"));
  EXPECT_EQ(s.vector("p_d"), Vector3d(0.4, 0, 0.5));
  EXPECT_EQ(s.real("duration"), 4);
  for (double t = 0.1; t < 4; t += 0.1) {
    s.at(1 + t);
    const double x = t / 4, f = x * x * x * (10 + x * (6 * x - 15));
    const double df = 30 * x * x * (1 - x) * (1 - x) / 4, ddf = 60 * x * (1 - x) * (1 - 2 * x) / 16;
    EXPECT_LT((s.vector("p_d") - Vector3d(0.4, 0.3 * f, 0.5)).norm(), 1e-15);
    EXPECT_LT((s.vector("v_d") - Vector3d(0, 0.3 * df, 0)).norm(), 1e-14);
    EXPECT_LT((s.vector("dv_d") - Vector3d(0, 0.3 * ddf, 0)).norm(), 1e-14);
    EXPECT_LT((s.vector("w_d") - Vector3d(std::numbers::pi * df, 0, 0)).norm(), 1e-14);
    EXPECT_LT((s.vector("dw_d") - Vector3d(std::numbers::pi * ddf, 0, 0)).norm(), 1e-13);
    EXPECT_NEAR(s.real("quat_d", 0), std::cos(std::numbers::pi / 2 * f), 5e-15);
  }
}

TEST(MotionPoses, TurnOnWithoutAJumpOfTheQuaternionWhenAMotionRepeats) {
  // Three thirds of a turn: the orientation is the same again, the quaternion the negative one.
  Subject s("space=cartesian&points=4", {{"waypoint_quat",
                                          "1,0,0,0, 0.5,0,0,0.86602540378443865, -0.5,0,0,0.86602540378443865, "
                                          "1,0,0,0"},
                                         {"passing", "through"},
                                         {"loop", "repeat"}});
  s.initialise();
  Quaterniond before = s.orientation();
  for (int k = 1; k < 900; ++k) {
    s.at(k * 0.01);
    const Quaterniond Q = s.orientation();
    EXPECT_GT(Q.dot(before), 0.99) << "at " << k * 0.01 << " s";
    before = Q;
  }
  s.at(3);
  EXPECT_NEAR(s.real("quat_d", 0), -1, 1e-14);
  s.at(6);
  EXPECT_NEAR(s.real("quat_d", 0), 1, 1e-14);
}

TEST(MotionPoses, MeetLimitsOfTheFrameByStretching) {
  Values values{{"waypoint_p", "0,0,0, 1,0,0"}, {"v_max", "0.25"}, {"dw_max", "1"}};
  Subject s("space=cartesian", values);
  EXPECT_THAT(s.error_of_initialise(), HasSubstr("motion: the frame moves with 1.875 m/s at 0.5 s, expected at most 0.25 m/s"));
  s.set("limits", "warn");
  s.initialise();
  EXPECT_THAT(s.text("warning"), HasSubstr("the frame moves with 1.875 m/s"));
  s.set("limits", "stretch");
  s.initialise();
  EXPECT_NEAR(s.real("stretch"), 7.5, 1e-9);
  s.at(3.75);
  EXPECT_NEAR(s.real("v_d"), 0.25, 1e-10);
}

TEST(MotionPoses, BeginAtThePoseOfTheRobot) {
  Subject s("space=cartesian&from=start&robot=lwr4&frame=link_6",
            {{"q_start", "0.1,0.5,-0.2,1,0.3,-0.7,0.4"}, {"waypoint_p", "0,0,0, 0.3,0.1,0.6"}, {"base_p0", "1,2,3"}});
  s.initialise();
  const robot::RobotModel model = lwr4();
  const robot::Mechanism mechanism(model);
  robot::Data data(mechanism);
  const VectorXd q{{0.1, 0.5, -0.2, 1, 0.3, -0.7, 0.4}};
  const Pose X = robot::forward_kinematics(mechanism, data, q, robot::on_body(model.frame("link_6")));
  EXPECT_LT((s.vector("p_d") - Vector3d(1, 2, 3) - X.p).norm(), 1e-14);
  EXPECT_LT((s.orientation().toRotationMatrix() - X.R).norm(), 1e-14);
  s.at(1);
  EXPECT_EQ(s.vector("p_d"), Vector3d(0.3, 0.1, 0.6));
}

TEST(MotionPoses, OfAJointMotionAreThoseOfForwardKinematics) {
  const Values values{{"waypoint_q", "0,0.3,0,1,0,0.5,0, 2,1,-1,-1,1.5,-1,2.5, -2,0.3,2.5,1,-2,0.5,-2.5"},
                      {"waypoint_t", "0,1,2"},
                      {"passing", "through"},
                      {"limits", "ignore"},
                      {"base_p0", "0.3,-0.2,1"},
                      {"base_quat0", "0.5,-0.5,0.5,0.5"}};
  Subject s("robot=lwr4&points=3&pose=true", values);
  s.initialise();
  EXPECT_GE(s.real("quat_d"), 0);
  const robot::RobotModel model = lwr4();
  const robot::Mechanism mechanism(model);
  robot::Data data(mechanism);
  const Quaterniond Q_WB(0.5, -0.5, 0.5, 0.5);
  Quaterniond before = s.orientation();
  const double e = 1e-5;
  for (double t = 0.01; t < 2; t += 0.01) {
    s.at(t);
    const Pose X = robot::forward_kinematics(mechanism, data, s.joints("q_d"), robot::on_body(model.end_effector()));
    EXPECT_LT((s.vector("p_d") - Vector3d(0.3, -0.2, 1) - Q_WB * X.p).norm(), 1e-14);
    EXPECT_LT((s.orientation().toRotationMatrix() - Q_WB * X.R).norm(), 1e-14);
    EXPECT_GT(s.orientation().dot(before), 0.9) << "the sign is continuous";
    before = s.orientation();
    const Vector3d v = s.vector("v_d"), w = s.vector("w_d"), dv = s.vector("dv_d"), dw = s.vector("dw_d");
    s.at(t + e);
    const Vector3d p1 = s.vector("p_d"), v1 = s.vector("v_d"), w1 = s.vector("w_d");
    const Quaterniond Q1 = s.orientation();
    s.at(t - e);
    EXPECT_LT(((p1 - s.vector("p_d")) / (2 * e) - v).norm(), 1e-6);
    EXPECT_LT(((v1 - s.vector("v_d")) / (2 * e) - dv).norm(), 2e-5);
    EXPECT_LT(((w1 - s.vector("w_d")) / (2 * e) - dw).norm(), 2e-5);
    const Quaterniond dQ = Q1 * s.orientation().conjugate();
    EXPECT_LT((dQ.vec() / e - w).norm(), 1e-5);
  }
}

TEST(MotionPoses, OfAPointingHandFollowAFile) {
  const TemporaryFile file("t,x,y,z,via_x,via_y,via_z\n0,1,0,0,,,\n1,-1,0,0,0,1,0\n");
  Subject s("space=cartesian", {{"file", file.path()}});
  s.initialise();
  s.at(0.5);
  EXPECT_LT((s.vector("p_d") - Vector3d(0, 1, 0)).norm(), 1e-15);
}

const Values kReach{{"q_start", "0.2,0.6,-0.3,1.2,0.4,-0.8,0.5"},
                    {"waypoint_p", "0,0,0, 0.1,-0.05,0.08"},
                    {"waypoint_quat", "1,0,0,0, 0.96,0.28,0,0"},
                    {"waypoint_t", "0,2"}};

TEST(MotionPoses, DriveTheJointsByInverseKinematics) {
  Values values = kReach;
  values.insert(values.end(),
                {{"base_p0", "1,0,0.5"}, {"base_quat0", "0.6,0,0.8,0"}, {"soft_start", "0.2"}, {"t_start", "0.1"}});
  Subject s("space=cartesian&from=relative&inverse=true&robot=lwr4", values);
  s.initialise();
  EXPECT_EQ(s.text("warning"), "");
  EXPECT_LT(s.real("inverse_error"), 1e-9);
  EXPECT_LT((s.joints("q_d") - VectorXd{{0.2, 0.6, -0.3, 1.2, 0.4, -0.8, 0.5}}).norm(), 1e-12);
  const robot::RobotModel model = lwr4();
  const robot::Mechanism mechanism(model);
  robot::Data data(mechanism);
  const robot::FrameOnBody frame = robot::on_body(model.end_effector());
  const Quaterniond Q_WB(0.6, 0, 0.8, 0);
  const Vector3d first = s.vector("p_d");
  const Quaterniond Q_first = s.orientation();
  for (double t = 0.05; t < 2.3; t += 0.05) {
    s.at(t);
    const VectorXd q = s.joints("q_d"), dq = s.joints("dq_d"), ddq = s.joints("ddq_d");
    Eigen::MatrixXd J(6, 7);
    Twist bias;
    const Pose X = robot::jacobian(mechanism, data, q, frame, J);
    robot::jacobian_dot_times_dq(mechanism, data, q, dq, frame, bias);
    EXPECT_LT((Vector3d(1, 0, 0.5) + Q_WB * X.p - s.vector("p_d")).norm(), 1e-12);
    EXPECT_LT((Q_WB * X.R - s.orientation().toRotationMatrix()).norm(), 1e-12);
    EXPECT_LT((Q_WB * (J * dq).head<3>() - s.vector("v_d")).norm(), 1e-12);
    EXPECT_LT((Q_WB * (J * ddq + bias).tail<3>() - s.vector("dw_d")).norm(), 1e-11);
    EXPECT_GT(s.real("sigma_min"), 0.02);
  }
  EXPECT_LT((s.vector("p_d") - first - Q_first * Vector3d(0.1, -0.05, 0.08)).norm(), 1e-14);
  EXPECT_LT((s.orientation().coeffs() - (Q_first * Quaterniond(0.96, 0.28, 0, 0)).coeffs()).norm(), 1e-14);
}

TEST(MotionPoses, ReachTheirPosturesAtAnyTimeInAnyOrder) {
  Subject forwards("space=cartesian&from=relative&inverse=true&robot=lwr4", kReach);
  Subject random("space=cartesian&from=relative&inverse=true&robot=lwr4", kReach);
  forwards.initialise();
  random.initialise();
  random.at(1.9);
  for (const double t : {0.3, 0.9, 1.4}) {
    forwards.at(t);
    random.at(t);
    EXPECT_EQ(forwards.joints("q_d"), random.joints("q_d"));
    EXPECT_EQ(forwards.joints("ddq_d"), random.joints("ddq_d"));
    const std::uint64_t before = testing::allocations();
    random.at(2 - t);
    EXPECT_EQ(testing::allocations(), before);
  }
}

TEST(MotionPoses, StretchUntilTheJointsMeetTheirLimits) {
  Values values = kReach;
  values.insert(values.end(), {{"limits", "stretch"}, {"dq_limit", "0.1"}});
  Subject s("space=cartesian&from=relative&inverse=true&robot=lwr4", values);
  s.initialise();
  EXPECT_GT(s.real("stretch"), 1.5);
  double fastest = 0;
  for (double t = 0; t < s.real("duration"); t += 0.01) {
    s.at(t + 0.01);
    fastest = std::max(fastest, s.joints("dq_d").cwiseAbs().maxCoeff());
  }
  EXPECT_NEAR(fastest, 0.1, 1e-4);
}

TEST(MotionPoses, SearchTheFirstPostureClosestToTheGivenOne) {
  // The pose of one posture, searched from another: within the limits, and no further from it than the posture of the pose.
  const VectorXd of_pose{{0.2, 0.6, -0.3, 1.2, 0.4, -0.8, 0.5}}, given{{0, 0.5, 0, 1, 0, -1, 0}};
  Subject start("space=cartesian&from=start&robot=lwr4", {{"q_start", "0.2,0.6,-0.3,1.2,0.4,-0.8,0.5"}});
  start.initialise();
  const Vector3d p = start.vector("p_d");
  const Quaterniond Q = start.orientation();
  const auto text = [](auto... x) {
    std::string list;
    ((list += text::to_text(x) + ","), ...);
    list.pop_back();
    return list;
  };
  const std::string place = text(p[0], p[1], p[2]), turn = text(Q.w(), Q.x(), Q.y(), Q.z());
  for (const std::string null_space : {"reference", "centre", "joint&null_joint=3", "arm"}) {
    Subject s("space=cartesian&inverse=true&robot=lwr4&null_space=" + null_space,
              {{"q_start", "0,0.5,0,1,0,-1,0"}, {"waypoint_p", place + "," + place}, {"waypoint_quat", turn + "," + turn}});
    if (s.has("null_value")) s.set("null_value", "-0.2");
    s.initialise();
    const VectorXd q = s.joints("q_d");
    EXPECT_TRUE(null_space != "reference" || (q - given).norm() <= (of_pose - given).norm());
    EXPECT_TRUE(null_space != "centre" || q.norm() < of_pose.norm());
    EXPECT_TRUE(null_space != "joint&null_joint=3" || std::abs(q[2] + 0.2) < 1e-10);
    s.at(0.5);
    EXPECT_LT((s.joints("q_d") - q).norm(), 1e-12) << "a pose at rest is a posture at rest";
    EXPECT_LT(s.joints("dq_d").norm(), 1e-15);
  }
}

TEST(MotionPoses, RefuseWhatTheyCannotRender) {
  EXPECT_THAT(error_of([] { Subject("space=cartesian&kind=polynomial"); }),
              HasSubstr("unit:motion: kind=polynomial with space=cartesian, expected kind=waypoints"));
  EXPECT_THAT(error_of([] { Subject("pose=true"); }), HasSubstr("pose=true needs a robot"));
  EXPECT_THAT(error_of([] { Subject("space=cartesian&from=start"); }), HasSubstr("from=start needs a robot"));
  EXPECT_THAT(error_of([] { Subject("pose=true&robot=lwr4&frame=link_9"); }), HasSubstr("link_9"));
  Subject shape("space=cartesian", {{"leg_shape", "spiral"}});
  EXPECT_THAT(shape.error_of_initialise(), HasSubstr("motion: leg_shape[1]: 'spiral', expected one of line, arc, circle"));
  Subject loop("space=cartesian", {{"waypoint_p", "0,0,0,1,0,0"}, {"loop", "repeat"}});
  EXPECT_THAT(loop.error_of_initialise(), HasSubstr("the pose at the end is 1 m and 0 rad from that at the start"));
  Subject far("space=cartesian&inverse=true&robot=lwr4", {{"waypoint_p", "2,0,0, 2,0,0"}});
  EXPECT_THAT(far.error_of_initialise(),
              ::testing::AllOf(HasSubstr("motion: inverse kinematics at the first waypoint: "), HasSubstr("are left for")));
  Values values = kReach;
  values[1].second = "0,0,0, 0,0,5";
  Subject leaves("space=cartesian&from=relative&inverse=true&robot=lwr4", values);
  EXPECT_THAT(leaves.error_of_initialise(), HasSubstr("inverse kinematics at "));
  Subject few("space=cartesian&inverse=true&robot=planar2", {{"waypoint_p", "0.5,0.1,0.5, 0.5,0.1,0.5"}});
  EXPECT_THAT(few.error_of_initialise(), HasSubstr("2 joints cannot follow 6 directions everywhere, name those that count"));
  Subject singular("space=cartesian&inverse=true&robot=lwr4&from=relative", {{"waypoint_p", "0,0,0, 0,0,0"}});
  singular.initialise();
  EXPECT_THAT(singular.text("warning"), HasSubstr("motion: the posture is nearly singular at 0 s: smallest singular value "));
  EXPECT_THAT(error_of([] { Subject("space=cartesian&inverse=true"); }), HasSubstr("inverse=true needs a robot"));
  EXPECT_THAT(error_of([] { Subject("space=cartesian&inverse=true&robot=planar2&null_space=arm"); }),
              HasSubstr("is not a chain of seven revolute joints"));
  EXPECT_THAT(error_of([] { Subject("space=cartesian&inverse=true&robot=planar2&null_space=joint&null_joint=3"); }),
              HasSubstr("joint 3, expected 1 to 2"));
  EXPECT_THAT(error_of([] { Subject("space=cartesian&inverse=true&robot=planar2&directions=x,y,w"); }),
              HasSubstr("task directions: 'w', expected all, or some of x, y, z, rx, ry, rz"));
  Subject zero("space=cartesian", {{"waypoint_quat", "0,0,0,0,1,0,0,0"}});
  EXPECT_THAT(zero.error_of_initialise(), HasSubstr("waypoint 1: the quaternion (w, x, y, z) has length 0, expected 1"));
}

}  // namespace
}  // namespace cotwin::poses_test
