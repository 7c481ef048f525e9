// unit:indices against the functions of models/robot/indices.h, symmetries, closed forms and the figures of the reference pose.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <fstream>

#include "components/indices/indices.h"
#include "components/unit/unit_table.h"
#include "models/foundation/support/error.h"
#include "models/numerics/dense.h"
#include "models/robot/body_parts.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/indices.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/robot/floating_dynamics.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/unit_subject.h"

namespace cotwin::indices::indices_unit_test {
namespace {

using cotwin::testing::error_of;
using cotwin::testing::TemporaryFolder;
using robot::BodyPart;
using robot::find_body_part;
using robot::load_body_parts;
using ::testing::HasSubstr;

constexpr double kDegree = 3.14159265358979323846 / 180;

std::string models() { return places::source() + "/models"; }
std::vector<double> reference_pose() { return {0, 30 * kDegree, 0, -60 * kDegree, 0, 60 * kDegree, 0}; }

class Subject : public testing::UnitSubject {
 public:
  explicit Subject(const std::string& query) : UnitSubject("unit:indices?" + query) {}
  void initialise() { start(); }
};

TEST(IndicesUnit, HasTheFiguresOfTheReferencePose) {
  Subject blow("robot=lwr4&frame=link_7");
  blow.set("q", reference_pose());
  blow.initialise();
  EXPECT_NEAR(blow.real("effective_mass"), 3.28702, 5e-6);
  EXPECT_NEAR(blow.real("effective_inertia"), 4.4007e-4, 5e-9);
  // Hand: 0.6 kg, 75 N/mm, 280 N; chest: 40 kg, 25 N/mm, 280 N. The links have 16.37074 kg, of which half is the larger mass.
  EXPECT_NEAR(blow.real("simple_mass"), 8.18537, 5e-6);
  EXPECT_NEAR(blow["v_max"][0], 1.3675, 5e-4);
  EXPECT_NEAR(blow["v_max"][1], 0.6793, 5e-4);
  EXPECT_NEAR(blow["reduced_mass"][0], 0.55902, 5e-5);
  EXPECT_NEAR(blow["reduced_mass"][1], 6.7949, 5e-4);
  blow.set("load", {5});
  blow.step();
  EXPECT_NEAR(blow.real("simple_mass"), 13.18537, 5e-6);
  EXPECT_NEAR(blow["reduced_mass"][1], 1 / (1 / 13.18537 + 1.0 / 40), 5e-6);
  EXPECT_NEAR(blow.real("effective_mass"), 3.28702, 5e-6);  // of the robot without it
  blow.set("load", {0});

  Subject effective("robot=lwr4&frame=link_7&robot_mass=effective");
  effective.set("q", reference_pose());
  effective.set("B", {3, 3, 2, 2, 1, 0.6, 0.5});
  effective.initialise();
  EXPECT_NEAR(effective["v_max"][0], 1.435, 5e-4);
  EXPECT_NEAR(effective["v_max"][1], 1.016, 5e-4);
  EXPECT_NEAR(effective["reduced_mass"][0], 0.5074, 5e-5);
  EXPECT_NEAR(effective["reduced_mass"][1], 3.037, 5e-4);
  effective["B"][4] = 0;  // no motor has none: it is unknown
  EXPECT_THAT(error_of([&] { effective.initialise(); }),
              HasSubstr("B[5]: is 0, expected a finite value > 0 with robot_mass=effective"));
  blow.set("u", {7, 0, 0});  // the length has no meaning
  blow.step();
  EXPECT_NEAR(blow.real("effective_mass"), 4.90484, 5e-6);

  Subject slow("robot=lwr4&frame=link_7&motors=held&parts=");
  slow.set("q", reference_pose());
  slow.set("B", {3, 3, 2, 2, 1, 0.6, 0.5});  // drive_train.ssv
  slow.initialise();
  EXPECT_NEAR(slow.real("effective_mass"), 8.57909, 5e-6);
  EXPECT_NEAR(slow.real("effective_inertia"), 0.401920, 5e-7);
  EXPECT_EQ(slow.variables().find("v_max"), nullptr);
}

TEST(IndicesUnit, TurnsWithTheBase) {
  const Eigen::Quaterniond turn = Eigen::Quaterniond(0.3, -0.5, 0.7, 0.2).normalized();
  Subject still("robot=lwr4&direction=world"), turned("robot=lwr4&direction=world");
  const Eigen::Vector3d u(0.2, -0.4, 0.7), u_turned = turn * u;
  for (Subject* s : {&still, &turned}) {
    s->set("q", {0.2, 0.7, -0.4, -1.1, 0.3, 0.9, 0.1});
    s->set("dq", {0.4, -0.2, 0.3, 0.6, -0.1, 0.2, 0.5});
  }
  still.set("u", {u[0], u[1], u[2]});
  turned.set("u", {u_turned[0], u_turned[1], u_turned[2]});
  turned.set("base_quat", {2 * turn.w(), 2 * turn.x(), 2 * turn.y(), 2 * turn.z()});
  still.initialise();
  turned.initialise();
  for (const char* name : {"effective_mass", "effective_inertia", "speed", "energy", "kin_v", "dyn_w"})
    EXPECT_NEAR(turned.real(name), still.real(name), 1e-12 * std::abs(still.real(name))) << name;
  const auto centre = [](Subject& s) { return Eigen::Vector3d(s["dyn_v_centre"].data()); };
  EXPECT_LT((centre(turned) - turn * centre(still)).norm(), 1e-12 * centre(still).norm());
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d a(still["kin_v_axes"].data() + 3 * axis), b(turned["kin_v_axes"].data() + 3 * axis);
    EXPECT_LT((b - turn * a).norm(), 1e-12);
  }
}

TEST(IndicesUnit, AlongTheMotionTheSpeedIsThatOfTheFrame) {
  Subject s("robot=planar2&direction=motion&frame=tip&parts=");
  s.set("q", {0.3, 0.8});
  s.set("u", {1, 0, 1});
  s.initialise();
  const double at_rest = s.real("effective_mass");
  EXPECT_EQ(s.real("speed"), 0);
  s.set("dq", {0.5, -0.2});
  s.step();
  // Joint speeds 0.5 and −0.2 about one axis: v² = (l₁ w₁)² + (l₂ w₁₂)² + 2 l₁ l₂ w₁ w₁₂ cos q₂ with w₁₂ = 0.3.
  const double v = std::sqrt(0.04 + 0.105 * 0.105 + 2 * 0.2 * 0.105 * std::cos(0.8));
  EXPECT_NEAR(s.real("speed"), v, 1e-12);
  EXPECT_NEAR(s.real("energy"), 0.5 * s.real("effective_mass") * v * v, 1e-12);
  EXPECT_NE(s.real("effective_mass"), at_rest);
}

TEST(IndicesUnit, TellsWhichLimitsWereExceeded) {
  Subject s("robot=lwr4&frame=link_7&parts=palm,sternum,forehead");
  s.set("q", reference_pose());
  s.initialise();
  EXPECT_EQ(s.text("warning"), "");
  s.set("dq", {0, 0.6, 0, -0.4, 0, 0, 0});
  s.step();
  const double speed = std::abs(s.real("speed"));
  ASSERT_GT(speed, 0.1);
  ASSERT_LT(speed, s["v_max"][1]);
  EXPECT_EQ(s["v_max"][2], 0);  // transient contact with the skull is not permitted
  EXPECT_EQ(s.text("warning"), "E moved faster than the speed limit v_max of forehead");
  for (double& rate : s["dq"]) rate *= 0.99 * s["v_max"][1] / speed;
  s.step();
  EXPECT_THAT(s.text("warning"), Not(HasSubstr("sternum")));
  s.set("margin", {0.02});
  s.step();
  EXPECT_EQ(s.text("warning"), "E moved faster than the speed limit v_max of sternum, forehead");
  EXPECT_NEAR(s["collision_energy"][1], 0.5 * s["reduced_mass"][1] * s.real("speed") * s.real("speed"), 1e-12);
}

TEST(IndicesUnit, CountsThePermissiblePressureOnASmallArea) {
  Subject s("robot=lwr4&frame=link_7&parts=chest,pelvis&contact=quasi_static");
  s.set("q", reference_pose());
  s.initialise();
  const double chest = s["v_max"][0], pelvis = s["v_max"][1];
  s.set("contact_area", {0.5e-4});
  s.step();
  EXPECT_NEAR(s["v_max"][0] / chest, 1.2e6 * 0.5e-4 / 140, 1e-12);  // the sternum: 120 N/cm² on half a cm² instead of 140 N
  EXPECT_NEAR(s["v_max"][1] / pelvis, 2.1e6 * 0.5e-4 / 180, 1e-12);
}

// As the drive train and the contact world: bodies in force follow the tunables.
TEST(IndicesUnit, FollowsAToolThatIsMounted) {
  robot::RobotModel robot = robot::load_urdf(models() + "/robots/lwr4/robot.urdf");
  Inertia tool;
  tool.mass = 1.5;
  tool.p_LC = {0.02, 0, 0.1};
  tool.I_CC = Eigen::Vector3d(0.004, 0.005, 0.003).asDiagonal();
  attach(robot, {"tool", "link_7", {}, tool});
  Subject s("robot=lwr4&frame=link_7");
  s.set("q", reference_pose());
  s.set("transition", {0.02});
  s.initialise();
  const double before = s.real("effective_mass");
  const auto pi = robot.bodies[6].inertia.parameters();
  s["mass"][6] = pi[0];
  for (std::size_t i = 0; i < 3; ++i) s["first_moment"][18 + i] = pi[static_cast<Eigen::Index>(1 + i)];
  for (std::size_t i = 0; i < 6; ++i) s["inertia"][36 + i] = pi[static_cast<Eigen::Index>(4 + i)];
  s.step();
  const double after_a_tick = s.real("effective_mass");
  for (int i = 0; i < 1000; ++i) s.step();
  const robot::Mechanism mechanism(robot);
  robot::Data data(mechanism);
  robot::FrameInertia f(7);
  const std::vector<double> q = reference_pose();
  frame_inertia(mechanism, data, Eigen::Map<const Eigen::VectorXd>(q.data(), 7), Eigen::VectorXd(),
                robot::on_body(robot.frame("link_7")), f);
  const double expected = effective_mass(f, f.X_BF.R.col(2));
  EXPECT_NEAR(s.real("effective_mass"), expected, 1e-8 * expected);
  EXPECT_GT(expected, before + 1);
  EXPECT_LT(after_a_tick, before + 0.2 * (expected - before));  // without a jump
}

// One to three joints: fewer singular values than rows. A slide and mimic joints turn the base, too.
TEST(IndicesUnit, KnowsTheReactionOfFewJoints) {
  Subject satellite("parts=&base=floating&robot=" + places::source() + "/tests/components/data/satellite.urdf");
  satellite.set("q", {0.4, 0});
  satellite.initialise();
  EXPECT_EQ(satellite["Z"].size(), 6U);
  EXPECT_GT(satellite["sigma_Z"][1], 0.05);
  EXPECT_EQ(satellite["sigma_Z"][2], 0);
  EXPECT_GT(satellite.real("sigma_min"), 0.05);
  // Locked in the shoulder, the elbow's axis is all that is left; its speed moves the tip.
  Subject elbow("parts=&base=floating&lock=shoulder:0.4&robot=" + places::source() + "/tests/components/data/satellite.urdf");
  elbow.set("q", {0});
  elbow.initialise();
  for (std::size_t row = 0; row < 3; ++row) EXPECT_NEAR(elbow["Z"][row], satellite["Z"][2 * row + 1], 1e-14);
  EXPECT_NEAR(elbow["sigma_Z"][0], std::hypot(elbow["Z"][0], elbow["Z"][1], elbow["Z"][2]), 1e-14);
  EXPECT_GT(elbow.real("sigma_min"), 0.1);
  const TemporaryFolder folder("reaction");
  folder.write("gripper.urdf", R"(<robot name="gripper"><link name="palm"><inertial><mass value="2"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <link name="left"><inertial><mass value="0.3"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <link name="right"><inertial><mass value="0.3"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="slide" type="prismatic"><parent link="palm"/><child link="left"/><origin xyz="0 0.1 0.2"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.1" velocity="1" effort="10"/></joint>
    <joint name="other" type="prismatic"><parent link="palm"/><child link="right"/><origin xyz="0 -0.1 0.2"/><axis xyz="1 0 0"/>
    <limit lower="-0.1" upper="0.1" velocity="1" effort="10"/><mimic joint="slide" multiplier="-1"/></joint></robot>)");
  Subject gripper("parts=&base=floating&robot=" + (folder.path() / "gripper.urdf").string());
  gripper.set("q", {0});
  gripper.initialise();
  // Opposite slides at y = ±0.1 m have no momentum and turn the palm about z: −2 · 0.3 · 0.1 per m/s over I_zz of the whole.
  const double I = 0.02 + 2 * 1e-3 + 2 * 0.3 * 0.01;
  EXPECT_NEAR(gripper["Z"][0], 0, 1e-15);
  EXPECT_NEAR(gripper["Z"][2], 2 * 0.3 * 0.1 / I, 1e-13);
}

// Against forward dynamics of the floating robot: the force acts on the joints by Jᵀ and on the base as a wrench.
TEST(IndicesUnit, OfAFloatingRobotRecoilsAndMovesWithItsBase) {
  const robot::RobotModel robot = robot::load_urdf(models() + "/robots/lwr4/robot.urdf");
  const std::vector<double> q = {0.2, 0.7, -0.4, -1.1, 0.3, 0.9, 0.1}, dq = {0.4, -0.2, 0.3, 0.6, -0.1, 0.2, 0.5};
  const Eigen::Quaterniond Q = Eigen::Quaterniond(0.3, -0.5, 0.7, 0.2).normalized();
  const Eigen::Vector3d v(0.3, -0.2, 0.1), w(0.5, 0.4, -0.7), u(0.6, 0, 0.8);  // in W
  Subject s("robot=lwr4&base=floating&direction=world&frame=link_7");
  s.set("q", q);
  s.set("dq", dq);
  s.set("base_quat", {Q.w(), Q.x(), Q.y(), Q.z()});
  s.set("base_v", {v[0], v[1], v[2]});
  s.set("base_w", {w[0], w[1], w[2]});
  s.set("u", {u[0], u[1], u[2]});
  s.initialise();

  using Vector = Eigen::Map<const Eigen::VectorXd>;
  const Vector at(q.data(), 7), rate(dq.data(), 7);
  const robot::FrameOnBody E = robot::on_body(robot.frame("link_7"));
  const robot::FloatingMechanism floating(robot);
  robot::FloatingData data(floating);
  const robot::Mechanism fixed(robot);
  robot::Data fixed_data(fixed);
  Eigen::MatrixXd J(6, 7);
  const Eigen::Vector3d p = jacobian(fixed, fixed_data, at, E, J).p, u_B = Q.conjugate() * u;
  const Eigen::Vector3d v_B = Q.conjugate() * v, w_B = Q.conjugate() * w;
  EXPECT_NEAR(s.real("speed"), u_B.dot(v_B + w_B.cross(p) + J.topRows(3) * rate), 1e-12);

  Eigen::VectorXd ddq(7);
  Twist A, V, coriolis;
  V << v_B, w_B;
  const auto accelerate = [&](const Eigen::VectorXd& speed, const Twist& base, const Eigen::Vector3d& force) {
    Wrench F;
    F << force, p.cross(force);
    floating_forward_dynamics(floating, data, at, speed, J.topRows(3).transpose() * force, base, F, Eigen::Vector3d::Zero(),
                              ddq, A);
    jacobian_dot_times_dq(fixed, fixed_data, at, speed, E, coriolis);
    const Eigen::Vector3d omega = base.tail<3>();
    return Eigen::Vector3d(A.head<3>() + A.tail<3>().cross(p) + omega.cross(omega.cross(p)) +
                           2 * omega.cross(Eigen::Vector3d(J.topRows(3) * speed)) + J.topRows(3) * ddq + coriolis.head<3>());
  };
  const double a = u_B.dot(accelerate(Eigen::VectorXd::Zero(7), Twist::Zero(), u_B));
  EXPECT_NEAR(s.real("effective_mass") * a, 1, 1e-10);
  const Eigen::Vector3d drift = Q * accelerate(rate, V, Eigen::Vector3d::Zero());
  EXPECT_LT((Eigen::Vector3d(s["dyn_v_centre"].data()) - drift).norm(), 1e-10 * (1 + drift.norm()));

  // Kinematic ellipsoid: the generalised Jacobian.
  robot::FloatingInertia inertia(7);
  floating_inertia(floating, data, at, inertia);
  generalised_jacobian(floating, data, inertia, at, E, J);
  EXPECT_NEAR(s.real("kin_v"), std::sqrt((J.topRows(3) * J.topRows(3).transpose()).determinant()), 1e-10);

  const auto Z = Eigen::Map<const Eigen::Matrix<double, 3, 7, Eigen::RowMajor>>(s["Z"].data());
  EXPECT_EQ(Z, inertia.Z());
  const Eigen::VectorXd sigma_Z = numerics::singular_values(Eigen::MatrixXd(Z));
  J.bottomRows(3) *= 0.3;
  const Eigen::VectorXd sigma = numerics::singular_values(J);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(s["sigma_Z"][static_cast<std::size_t>(i)], sigma_Z[i], 1e-13);
  EXPECT_NEAR(s.real("sigma_min"), sigma[5], 1e-13);

  // Heavier tool: bodies follow here, too.
  const double before = s.real("effective_mass");
  s["mass"][6] += 5;
  for (int i = 0; i < 1000; ++i) s.step();
  EXPECT_GT(s.real("effective_mass"), before + 0.1);
}

TEST(IndicesUnit, LeavesOutTheMotorsOfPassiveJoints) {
  Subject with("robot=lwr4&motors=held&frame=link_7"), without("robot=lwr4&motors=held&frame=link_7&passive=joint_4");
  for (Subject* s : {&with, &without}) {
    s->set("q", reference_pose());
    s->set("B", {3, 3, 2, 2, 1, 0.6, 0.5});
    s->initialise();
    s->step();
  }
  with.set("B", {3, 3, 2, 0, 1, 0.6, 0.5});
  with.set("transition", {0});
  with.step();
  EXPECT_DOUBLE_EQ(without.real("effective_mass"), with.real("effective_mass"));
  EXPECT_EQ(without["tau_max"][3], 0);
}

TEST(IndicesUnit, NamesJointsWithoutATorqueLimit) {
  const TemporaryFolder folder("no_effort");
  std::string urdf = cotwin::testing::content(models() + "/robots/planar2/robot.urdf");
  const std::string limit = "<limit lower=\"-2.8\" upper=\"2.8\" velocity=\"3\" effort=\"75\"/>",
                    elbow = "elbow\" type=\"revolute";
  urdf.replace(urdf.find(limit), limit.size(), "");
  urdf.replace(urdf.find(elbow), elbow.size(), "elbow\" type=\"continuous");
  std::ofstream(folder.path() / "arm.urdf") << urdf;
  Subject s("robot=" + (folder.path() / "arm.urdf").string());
  s.set("q", {0.3, 0.8});
  s.initialise();
  EXPECT_EQ(s.text("warning"), "tau_max is not given for joints that then add nothing to the dynamic ellipsoids: 2");
  EXPECT_EQ(s["dyn_v_lengths"][1], 0);
  s.set("tau_max", {150, 75});
  s.initialise();
  EXPECT_EQ(s.text("warning"), "");
  EXPECT_GT(s["dyn_v_lengths"][1], 0);
}

TEST(IndicesUnit, IsFiniteAtASingularPose) {
  Subject s("robot=lwr4&frame=link_7&direction=world");
  s.initialise();  // stretched upwards
  EXPECT_EQ(s.real("effective_mass"), 1e12);
  EXPECT_EQ(s.variables().first_not_finite(), "");
  EXPECT_NEAR(s["v_max"][0], 280 / std::sqrt(0.6 * 75e3), 1e-9);  // as against a wall
  EXPECT_EQ(s.real("kin_v"), s["kin_v_lengths"][0] * s["kin_v_lengths"][1] * s["kin_v_lengths"][2]);
}

TEST(IndicesUnit, SaysWhatIsWrong) {
  const auto error = [](const std::string& query, const std::string& name, const std::vector<double>& values) {
    Subject s("robot=lwr4" + query);
    if (!name.empty()) s.set(name, values);
    return error_of([&] { s.initialise(); });
  };
  EXPECT_THAT(error("&parts=palm,chets", "", {}), HasSubstr("no body part or region 'chets'; did you mean 'chest'?"));
  EXPECT_THAT(error("&parts=palm,", "", {}), HasSubstr("no body part or region ''"));
  EXPECT_THAT(error("", "u", {0, 0, 0}), HasSubstr("indices.u: has the length 0, expected a finite length > 0"));
  EXPECT_THAT(error("", "base_quat", {0, 0, 0, 0}), HasSubstr("base_quat"));
  EXPECT_THAT(error("", "q", {0, 0, NAN, 0, 0, 0, 0}), HasSubstr("q[3]: is nan, expected a finite value"));
  EXPECT_THAT(error("&motors=held", "B", {1, -1, 1, 1, 1, 1, 1}), HasSubstr("B[2]"));
  EXPECT_THAT(error_of([] { Subject("robot=lwr4&frame=link_9"); }), HasSubstr("no frame 'link_9'"));
}

TEST(BodyParts, HaveTheFiguresOfTheTechnicalSpecification) {
  const std::vector<BodyPart> parts = load_body_parts(models() + "/people/iso_ts_15066.csv");
  EXPECT_EQ(parts.size(), 29u);  // all areas of table A.2
  for (const BodyPart& part : parts) {
    const bool head = part.region == "skull_and_forehead" || part.region == "face";
    EXPECT_EQ(part.transient.force, head ? 0 : 2 * part.quasi_static.force) << part.name;
    EXPECT_TRUE(head || part.transient.pressure == 2 * part.quasi_static.pressure) << part.name;
    for (const BodyPart& other : parts) {
      if (other.region != part.region) continue;
      EXPECT_EQ(other.mass, part.mass);
      EXPECT_EQ(other.stiffness, part.stiffness);
      EXPECT_EQ(other.quasi_static.force, part.quasi_static.force);
    }
  }
  const BodyPart& hand = find_body_part(parts, "hands_and_fingers", "");
  EXPECT_EQ(hand.name, "back_of_the_hand_nd");  // the most sensitive to pressure
  EXPECT_EQ(hand.mass, 0.6);
  EXPECT_EQ(hand.stiffness, 75e3);
  EXPECT_EQ(hand.transient.force, 280);
  EXPECT_EQ(find_body_part(parts, "palm", "").quasi_static.pressure, 260e4);
}

TEST(BodyParts, NameTheLineOfABadValue) {
  const TemporaryFolder folder("body_parts");
  const std::string header = "part,region,mass,stiffness,force,transient_force,pressure,transient_pressure\n";
  const auto error = [&](const std::string& text) {
    std::ofstream(folder.path() / "parts.csv") << text;
    return error_of([&] { load_body_parts(folder.path() / "parts.csv"); });
  };
  EXPECT_EQ(error(header + "a,b,1,2,3,,,\n"), "");
  EXPECT_THAT(error(header + "a,b,1,2,3,,,\nc,b,-1,2,3,,,\n"),
              HasSubstr("parts.csv:3: column 'mass': is -1, expected a finite value > 0"));
  EXPECT_THAT(error(header + "a,b,1,x,3,,,\n"), HasSubstr("parts.csv:2: column 'stiffness': 'x', expected a number"));
  EXPECT_THAT(error(header + "a,b,1,inf,3,,,\n"), HasSubstr("stiffness"));
  EXPECT_THAT(error(header + "a,b,1,2,,,,\n"), HasSubstr("force"));
  EXPECT_THAT(error(header + "a,b,1,2,3,,,\na,b,1,2,3,,,\n"), HasSubstr("parts.csv:3: column 'part': 'a' stands there twice"));
  EXPECT_THAT(error(header + "a,b,1,2\n"), HasSubstr("parts.csv:2"));
  EXPECT_THAT(error(header), HasSubstr("has no rows"));
  EXPECT_THAT(error("part,region,mass\n"), HasSubstr("stiffness"));
  EXPECT_THAT(error(header + "\"a b\",b,1,2,3,,,\n"), HasSubstr("expected a name without blanks"));
  EXPECT_THAT(error_of([&] { load_body_parts(folder.path() / "none.csv"); }), HasSubstr("none.csv"));
}

}  // namespace
}  // namespace cotwin::indices::indices_unit_test
