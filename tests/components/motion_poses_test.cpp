// The unit's poses: a Cartesian motion, and forward kinematics of a joint motion.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "components/motion/motion.h"
#include "components/unit/unit_table.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf.h"
#include "models/support/error.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin {
namespace {

using cotwin::testing::TemporaryFile;
using Eigen::Quaterniond, Eigen::Vector3d, Eigen::VectorXd;
using testing::error_of;
using ::testing::HasSubstr;

constexpr Duration kTick{1'000'000};
using Values = std::vector<std::pair<std::string, std::string>>;

/// A motion unit with its variables by name.
class Subject {
 public:
  explicit Subject(const std::string& query, const Values& values = {}) {
    const UnitType type{"motion", "", [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<motion::Motion>(s); },
                        &motion::Motion::declare_settings};
    instance_ = make_unit("unit:motion?" + query, {}, {std::filesystem::path(places::source()) / "models"}, {&type, 1});
    for (const auto& [name, value] : values) set(name, value);
  }
  void set(const std::string& name, const std::string& value) { assign_text(instance_.variables.at(name), value); }
  void initialise() {
    instance_.variables.check_ranges();
    instance_.unit->initialise(Time{0});
  }
  void to(double t) { ASSERT_EQ(instance_.unit->step(Time::from_seconds(t) + Duration{-kTick.ns}, kTick), StepResult::kDone); }
  double real(const std::string& name, std::size_t element = 0) const { return instance_.variables.at(name).reals()[element]; }
  Vector3d vector(const std::string& name) const { return Vector3d(instance_.variables.at(name).reals().data()); }
  VectorXd joints(const std::string& name) const {
    const auto x = instance_.variables.at(name).reals();
    return Eigen::Map<const VectorXd>(x.data(), static_cast<Eigen::Index>(x.size()));
  }
  Quaterniond orientation() const {
    const auto Q = instance_.variables.at("quat_d").reals();
    return {Q[0], Q[1], Q[2], Q[3]};
  }
  std::string text(const std::string& name) const { return instance_.variables.at(name).strings()[0]; }
  bool has(const std::string& name) const { return instance_.variables.find(name) != nullptr; }
  std::string error_of_initialise() {
    return error_of([&] { initialise(); });
  }

 private:
  Instance instance_;
};

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
    s.to(1 + t);
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
    s.to(k * 0.01);
    const Quaterniond Q = s.orientation();
    EXPECT_GT(Q.dot(before), 0.99) << "at " << k * 0.01 << " s";
    before = Q;
  }
  s.to(3);
  EXPECT_NEAR(s.real("quat_d", 0), -1, 1e-14);
  s.to(6);
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
  s.to(3.75);
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
  s.to(1);
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
    s.to(t);
    const Pose X = robot::forward_kinematics(mechanism, data, s.joints("q_d"), robot::on_body(model.end_effector()));
    EXPECT_LT((s.vector("p_d") - Vector3d(0.3, -0.2, 1) - Q_WB * X.p).norm(), 1e-14);
    EXPECT_LT((s.orientation().toRotationMatrix() - Q_WB * X.R).norm(), 1e-14);
    EXPECT_GT(s.orientation().dot(before), 0.9) << "the sign is continuous";
    before = s.orientation();
    const Vector3d v = s.vector("v_d"), w = s.vector("w_d"), dv = s.vector("dv_d"), dw = s.vector("dw_d");
    s.to(t + e);
    const Vector3d p1 = s.vector("p_d"), v1 = s.vector("v_d"), w1 = s.vector("w_d");
    const Quaterniond Q1 = s.orientation();
    s.to(t - e);
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
  s.to(0.5);
  EXPECT_LT((s.vector("p_d") - Vector3d(0, 1, 0)).norm(), 1e-15);
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
  Subject zero("space=cartesian", {{"waypoint_quat", "0,0,0,0,1,0,0,0"}});
  EXPECT_THAT(zero.error_of_initialise(), HasSubstr("waypoint 1: the quaternion (w, x, y, z) has length 0, expected 1"));
}

}  // namespace
}  // namespace cotwin
