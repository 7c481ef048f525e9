#include "models/robot/urdf/urdf.h"

#include <console_bridge/console.h>
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <fstream>
#include <limits>
#include <locale>
#include <map>
#include <random>
#include <thread>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/urdf/units.h"
#include "tests/support/places.h"

namespace cotwin::robot::urdf_test {
namespace {

namespace fs = std::filesystem;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
using Parameters = Eigen::Matrix<double, 10, 1>;
const char* const kHead = "<robot name=\"r\">\n";
const char* const kBase = "<link name=\"base\"/>\n";
const char* const kArm =
    "<link name=\"arm\"><inertial><mass value=\"2\"/><inertia ixx=\"0.1\" ixy=\"0\" ixz=\"0\" iyy=\"0.1\" iyz=\"0\" "
    "izz=\"0.1\"/>"
    "</inertial></link>\n";
const char* const kTurn =
    "<joint name=\"turn\" type=\"revolute\"><parent link=\"base\"/><child link=\"arm\"/><axis xyz=\"0 0 1\"/>"
    "<limit lower=\"-1\" upper=\"2\" velocity=\"3\" effort=\"4\"/></joint>\n";

std::string arm_with(const std::string& more) { return std::string(kHead) + kBase + kArm + kTurn + more + "</robot>"; }
/// A link named `name` of 1 kg on a fixed joint.
std::string rigid_on(const std::string& parent, const std::string& name, const std::string& origin) {
  return "<link name=\"" + name +
         "\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/>" +
         "</inertial></link><joint name=\"to_" + name + "\" type=\"fixed\"><parent link=\"" + parent + "\"/><child link=\"" +
         name + "\"/>" + origin + "</joint>";
}
/// The arm with `from` replaced in its text.
std::string arm_but(const std::string& from, const std::string& to) {
  std::string xml = arm_with("");
  const std::size_t at = xml.find(from);
  if (at == std::string::npos) throw Error("test", "no '" + from + "' in the arm");
  return xml.replace(at, from.size(), to);
}

RobotModel parsed(const std::string& xml, const UrdfOptions& options = {}, std::vector<std::string>* warnings = nullptr) {
  return parse_urdf(xml, "arm.urdf", options, warnings);
}
std::string refusal_of(const std::string& xml, const UrdfOptions& options = {}) {
  try {
    parsed(xml, options);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}
std::vector<std::string> warnings_of(const std::string& xml, const UrdfOptions& options = {Unphysical::kWarn, ""}) {
  std::vector<std::string> warnings;
  parsed(xml, options, &warnings);
  return warnings;
}

double moving_mass(const RobotModel& robot) {
  double mass = 0;
  for (const Body& body : robot.bodies) mass += body.inertia.mass;
  return mass;
}
std::vector<std::string> joint_names(const RobotModel& robot) {
  std::vector<std::string> names;
  for (const Joint& joint : robot.joints) names.push_back(joint.name);
  return names;
}

TEST(Urdf, OfTheLwr4IsAChainOfSevenJoints) {
  const RobotModel robot = load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  EXPECT_EQ(robot.name, "lwr4_published_fit");
  ASSERT_EQ(robot.n(), 7);
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(robot.joints[static_cast<std::size_t>(i)].parent, i - 1);
    EXPECT_EQ(robot.joints[static_cast<std::size_t>(i)].name, "joint_" + std::to_string(i + 1));
    EXPECT_EQ(robot.bodies[static_cast<std::size_t>(i)].name, "link_" + std::to_string(i + 1));
  }
  EXPECT_NEAR(moving_mass(robot), 16.37, 0.005);  // 16.4 kg: sum of the published masses
  EXPECT_EQ(robot.joints[3].X_PJ.p, Vector3d(0, 0, 0.4));
  EXPECT_EQ(robot.joints[1].q_max, 2.094);
  EXPECT_EQ(robot.joints[6].tau_max, 38);
  EXPECT_EQ(robot.end_effector().name, "link_7");
}

TEST(Urdf, GivesTypesLimitsAndFriction) {
  const RobotModel arm = parsed(arm_with(""));
  EXPECT_EQ(arm.joints[0].type, JointType::kRevolute);
  EXPECT_EQ(arm.joints[0].q_min, -1);
  EXPECT_EQ(arm.joints[0].q_max, 2);
  EXPECT_EQ(arm.joints[0].dq_max, 3);
  EXPECT_EQ(arm.joints[0].tau_max, 4);
  const RobotModel wheel = parsed(arm_but("revolute", "continuous"));
  EXPECT_EQ(wheel.joints[0].q_min, -kInfinity);
  EXPECT_EQ(wheel.joints[0].q_max, kInfinity);
  EXPECT_EQ(wheel.joints[0].tau_max, 4);
  const RobotModel rail = parsed(arm_but("<axis xyz=\"0 0 1\"/>", "<dynamics damping=\"0.5\" friction=\"0.25\" K=\"7000\"/>"));
  EXPECT_EQ(rail.joints[0].axis, Vector3d::UnitX());  // URDF's default
  EXPECT_EQ(rail.joints[0].damping, 0.5);
  EXPECT_EQ(rail.joints[0].friction, 0.25);
  EXPECT_EQ(parsed(arm_but("revolute", "prismatic")).joints[0].type, JointType::kPrismatic);
  EXPECT_EQ(parsed(arm_but("upper=\"2\"", "upper=\"inf\"")).joints[0].q_max, kInfinity);
  for (const char* none : {"1e15", "1e16", "3.4e38", "1e308"})
    EXPECT_EQ(parsed(arm_but("upper=\"2\"", "upper=\"" + std::string(none) + "\"")).joints[0].q_max, kInfinity) << none;
}

TEST(Urdf, AxesAreUnitVectors) {
  EXPECT_EQ(parsed(arm_but("0 0 1", "0 0 -1")).joints[0].axis, Vector3d(0, 0, -1));
  EXPECT_TRUE(parsed(arm_but("0 0 1", "3 0 -4")).joints[0].axis.isApprox(Vector3d(0.6, 0, -0.8), 1e-15));
  EXPECT_THAT(refusal_of(arm_but("0 0 1", "0 0 0")),
              HasSubstr("arm.urdf:4: joint 'turn': axis of length 0, expected a unit vector"));
}

TEST(Urdf, LinksOnFixedJointsBecomeOneBodyWithTheirParent) {
  // Two cubes of 0.2 m, 3 kg each, side by side along the arm's x, the second rotated by a quarter turn on its joint and given
  // in a frame of its own; together a box of 0.4 x 0.2 x 0.2 m with its centre 0.1 m out: m/12 (b² + c²) and so on.
  const auto cube = [](const std::string& name, const std::string& origin) {
    return "<link name=\"" + name + "\"><inertial>" + origin +
           "<mass value=\"3\"/><inertia ixx=\"0.02\" ixy=\"0\" ixz=\"0\" iyy=\"0.02\" " +
           "iyz=\"0\" izz=\"0.02\"/></inertial></link>";
  };
  const RobotModel robot = parsed(kHead + std::string(kBase) + cube("arm", "") + kTurn +
                                  cube("hand", "<origin xyz=\"0 -0.1 0\" rpy=\"0.1 0.2 0.3\"/>") +
                                  "<joint name=\"grip\" type=\"fixed\"><parent link=\"arm\"/><child link=\"hand\"/>"
                                  "<origin xyz=\"0.1 0 0\" rpy=\"0 0 1.5707963267948966\"/></joint></robot>");
  ASSERT_EQ(robot.n(), 1);
  const Inertia& body = robot.bodies[0].inertia;
  EXPECT_DOUBLE_EQ(body.mass, 6);
  EXPECT_TRUE(body.p_LC.isApprox(Vector3d(0.1, 0, 0), 1e-15)) << body.p_LC.transpose();
  const Matrix3d box = Vector3d(6.0 / 12 * 0.08, 6.0 / 12 * 0.2, 6.0 / 12 * 0.2).asDiagonal();
  EXPECT_TRUE(body.I_CC.isApprox(box, 1e-14)) << body.I_CC;
  EXPECT_EQ(robot.frame("hand").body, 0);
  EXPECT_EQ(robot.frame("hand").X_BF.p, Vector3d(0.1, 0, 0));
  EXPECT_EQ(robot.frames.back().name, "hand");
}

TEST(Urdf, LinksOnTheBaseAreTheBase) {
  const RobotModel robot =
      parsed(arm_with(rigid_on("base", "pedestal", "<origin xyz=\"0 0 -1\"/>") + rigid_on("pedestal", "foot", "")));
  EXPECT_EQ(robot.n(), 1);
  EXPECT_EQ(robot.base.name, "base");
  EXPECT_EQ(robot.base.inertia.mass, 2);
  EXPECT_EQ(robot.base.inertia.p_LC, Vector3d(0, 0, -1));
  EXPECT_EQ(robot.frame("foot").body, -1);
}

TEST(Urdf, JointsComeDepthFirstInTheOrderOfTheFile) {
  const auto joint = [](const std::string& name, const std::string& parent) {
    return rigid_on(parent, name, "").replace(rigid_on(parent, name, "").find("fixed"), 5, "continuous");
  };
  // The file names 'right' first, but its branch last; the alphabetical order is different.
  const RobotModel robot = parsed(kHead + std::string(kBase) + joint("right", "base") + joint("left", "base") +
                                  joint("b", "left") + joint("a", "left") + joint("z", "right") + "</robot>");
  EXPECT_THAT(joint_names(robot), ElementsAre("to_right", "to_z", "to_left", "to_b", "to_a"));
  EXPECT_EQ(robot.joints[4].parent, 2);
}

TEST(Urdf, TipSelectsTheChainToItAndReportsOmittedLinks) {
  const std::string xml =
      arm_with(rigid_on("arm", "flange", "") + rigid_on("flange", "hand", "") + rigid_on("arm", "tool0", ""));
  std::vector<std::string> warnings;
  const RobotModel robot = parsed(xml, {Unphysical::kError, "flange"}, &warnings);
  EXPECT_EQ(robot.bodies[0].inertia.mass, 3);
  EXPECT_EQ(robot.frames.size(), 3u);
  EXPECT_EQ(robot.end_effector().name, "flange");
  EXPECT_THAT(warnings, ElementsAre("arm.urdf: the chain to 'flange' omits 2 kg: 'hand', 'tool0'"));
  EXPECT_EQ(refusal_of(xml, {Unphysical::kError, "flang"}), "arm.urdf: no link 'flang' for the tip, did you mean 'flange'?");
}

TEST(Urdf, MassesAreConservedByMerging) {
  // Sums of the <mass> elements; whether the root's side is fixed follows from the robot.
  for (const auto& folder : fs::directory_iterator(fs::path(places::source()) / "models/robots")) {
    const std::string name = folder.path().filename().string();
    SCOPED_TRACE(name);
    const fs::path file = folder.path() / "robot.urdf";
    std::vector<std::string> warnings;
    const RobotModel robot = load_urdf(file, {}, &warnings);
    EXPECT_THAT(warnings, IsEmpty());
    EXPECT_EQ(robot.n(), name == "lwr4" || name == "iiwa14" ? 7 : name == "planar2" ? 2 : 6);
    std::ifstream in(file);
    double total = 0;
    const std::string key = "<mass value=\"";
    for (std::string line; std::getline(in, line);) {
      const std::size_t at = line.find(key);
      if (at != std::string::npos)
        total += *text::parse_real(line.substr(at + key.size(), line.find('"', at + key.size()) - at - key.size()));
    }
    EXPECT_NEAR(moving_mass(robot) + robot.base.inertia.mass, total, 1e-12 * total);
    for (const Body& body : robot.bodies) EXPECT_EQ(body.inertia.unphysical(), "");
    EXPECT_EQ(parse_urdf(to_urdf(robot), "again"), robot);
  }
}

TEST(Urdf, BodiesOfARandomTreeAreTheSumsOfTheirLinks) {
  std::mt19937_64 generator(2);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(generator); };
  const auto three = [&](double size) { return Vector3d(uniform(-size, size), uniform(-size, size), uniform(-size, size)); };
  const auto written = [](const Vector3d& v) {
    return text::to_text(v[0]) + " " + text::to_text(v[1]) + " " + text::to_text(v[2]);
  };
  for (int round = 0; round < 300; ++round) {
    SCOPED_TRACE(round);
    const int links = 2 + round % 20;
    std::string xml = "<robot name=\"tree\">";
    std::vector<Pose> X_WL(1);       // in the root link's frame, all joints at 0
    std::vector<int> carrier = {0};  // the link to which this body belongs
    std::map<int, Parameters> sums;  // by carrying body, about the root link's origin
    for (int i = 0; i < links; ++i) {
      const Vector3d p = three(1), rpy = three(3), half = three(0.5).cwiseAbs() + Vector3d::Constant(0.1);
      const double mass = uniform(0.1, 5);
      const Vector3d square = half.cwiseProduct(half) * mass / 3;  // a box with these half edges
      const Vector3d moments(square[1] + square[2], square[0] + square[2], square[0] + square[1]);
      xml += "<link name=\"" + std::to_string(i) + "\"><inertial><origin xyz=\"" + written(p) + "\" rpy=\"" + written(rpy) +
             "\"/>";
      xml += "<mass value=\"" + text::to_text(mass) + "\"/><inertia ixx=\"" + text::to_text(moments[0]) +
             "\" ixy=\"0\" ixz=\"0\" iyy=\"";
      xml += text::to_text(moments[1]) + "\" iyz=\"0\" izz=\"" + text::to_text(moments[2]) + "\"/></inertial></link>\n";
      if (i > 0) {
        const int parent = static_cast<int>(generator() % static_cast<unsigned>(i));
        const bool is_fixed = generator() % 2 == 0;
        const Vector3d p_joint = three(1), rpy_joint = three(3);
        xml +=
            "<joint name=\"to_" + std::to_string(i) + "\" type=\"" + (is_fixed ? "fixed" : "continuous") + "\"><parent link=\"";
        xml += std::to_string(parent) + "\"/><child link=\"" + std::to_string(i) + "\"/><origin xyz=\"" + written(p_joint) +
               "\" rpy=\"";
        xml += written(rpy_joint) + "\"/></joint>\n";
        const Pose X_PL = {rotation_from_rpy(rpy_joint[0], rpy_joint[1], rpy_joint[2]), p_joint};
        X_WL.push_back(X_WL[static_cast<std::size_t>(parent)] * X_PL);
        carrier.push_back(is_fixed ? carrier[static_cast<std::size_t>(parent)] : i);
      }
      const Pose X_WI = X_WL.back() * Pose{rotation_from_rpy(rpy[0], rpy[1], rpy[2]), p};
      const Inertia box = {mass, Vector3d::Zero(), moments.asDiagonal()};
      const auto [sum, is_new] = sums.emplace(carrier.back(), Parameters::Zero());
      sum->second += box.seen_from(X_WI).parameters();
    }
    const RobotModel robot = parsed(xml + "</robot>");
    ASSERT_EQ(robot.frames.size(), static_cast<std::size_t>(links));
    ASSERT_EQ(static_cast<std::size_t>(robot.n()) + 1, sums.size());
    std::vector<Pose> X_WB;
    for (const Joint& joint : robot.joints) {
      X_WB.push_back(joint.parent < 0 ? joint.X_PJ : X_WB[static_cast<std::size_t>(joint.parent)] * joint.X_PJ);
    }
    for (int body = -1; body < robot.n(); ++body) {
      const Body& found = body < 0 ? robot.base : robot.bodies[static_cast<std::size_t>(body)];
      const Pose X = body < 0 ? Pose{} : X_WB[static_cast<std::size_t>(body)];
      const Parameters sum = sums.at(std::stoi(found.name));
      EXPECT_LE((found.inertia.seen_from(X).parameters() - sum).norm(), 1e-12 * sum.norm());  // chains of up to 20 poses
    }
    for (const Frame& frame : robot.frames) {
      const Pose X = (frame.body < 0 ? Pose{} : X_WB[static_cast<std::size_t>(frame.body)]) * frame.X_BF;
      const Pose& expected = X_WL[static_cast<std::size_t>(std::stoi(frame.name))];
      EXPECT_TRUE(X.R.isApprox(expected.R, 1e-13) && (X.p - expected.p).norm() < 1e-12) << frame.name;
    }
    EXPECT_EQ(parsed(to_urdf(robot)), robot);
  }
}

TEST(Urdf, OfTwoArmsContainsBothAndTheTipSelectsOne) {
  // Two arms of two joints on one stand.
  const auto arm = [](const std::string& side, const std::string& y) {
    std::string xml, parent = "stand";
    for (const char* const name : {"upper", "lower", "hand"}) {
      const std::string link = side + "_" + name, type = name == std::string("hand") ? "fixed" : "continuous";
      xml += "<link name='" + link + "'><inertial><origin xyz='0 0 0.1'/><mass value='2'/>" +
             "<inertia ixx='0.02' iyy='0.02' izz='0.01' ixy='0' ixz='0' iyz='0'/></inertial></link><joint name='to_" + link +
             "' type='" + type + "'><parent link='" + parent + "'/><child link='" + link + "'/><origin xyz='0 " +
             (parent == "stand" ? y : "0") + " 0.3'/><axis xyz='0 1 0'/></joint>";
      parent = link;
    }
    return xml;
  };
  const std::string xml = "<robot name='two'><link name='stand'/>" + arm("left", "0.4") + arm("right", "-0.4") + "</robot>";
  const RobotModel both = parsed(xml);
  ASSERT_EQ(both.n(), 4);
  EXPECT_EQ(both.joints[2].parent, -1);
  EXPECT_EQ(both.end_effector().name, "left_hand");
  const RobotModel right = parsed(xml, {Unphysical::kError, "right_hand"});
  ASSERT_EQ(right.n(), 2);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(right.joints[i].name, both.joints[i + 2].name);
    EXPECT_EQ(right.bodies[i], both.bodies[i + 2]);
  }
  EXPECT_EQ(right.end_effector().name, "right_hand");
}

TEST(Urdf, WrittenAndReadAgainIsTheSameToTheLastBit) {
  RobotModel robot = load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  for (int i = 0; i < 50; ++i) {  // rotations that no three angles represent exactly, some with a pitch of ±90°
    const double pitch = i % 5 == 0 ? std::copysign(1.5707963267948966, i - 25) : 0.1 * i;
    const Pose X = Pose{rotation_from_rpy(0.3 * i, pitch, 0.7 * i), {0.1 * i, 1.0 / 3, -0.0}} *
                   Pose{rotation_from_rpy(i, 1, 2), Vector3d::Zero()};
    attach(robot,
           {"part_" + std::to_string(i), "link_" + std::to_string(i % 7 + 1), X, {0.1, {1, 2, 3}, Matrix3d::Identity() / 3}});
  }
  robot.joints[2].type = JointType::kPrismatic;
  robot.joints[2].q_max = kInfinity;
  robot.joints[3].q_min = -kInfinity;
  robot.joints[3].q_max = kInfinity;
  robot.joints[4].axis = Vector3d(1, 2, 3).normalized();
  robot.joints[5].damping = 0.1;
  robot.joints[5].tau_max = kInfinity;
  robot.joints[6].X_PJ.R = rotation_from_rpy(1, 2, 3) * rotation_from_rpy(4, 5, 6);
  robot.base.inertia = robot.bodies[0].inertia;
  robot.gravity = Vector3d(9.81, 0, 0);  // on the wall
  robot.name = "\"<lwr4 & Söhne>\"";
  robot.frames.back().name = "a & b";
  RobotModel again = parsed(to_urdf(robot));
  robot.history.clear();
  EXPECT_EQ(again, robot);
  EXPECT_EQ(to_urdf(again), to_urdf(robot));
}

TEST(Urdf, CannotCarryEveryModel) {
  const RobotModel robot = load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  const auto refusal = [&](const std::function<void(RobotModel&)>& change) {
    RobotModel changed = robot;
    change(changed);
    try {
      to_urdf(changed);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_THAT(refusal([](RobotModel& r) { r.frames[2].name = "link_1"; }), HasSubstr("two frames have the name 'link_1'"));
  EXPECT_THAT(refusal([](RobotModel& r) { r.frames[2].name = "line\nbreak"; }), HasSubstr("not a valid name in a URDF"));
  EXPECT_THAT(refusal([](RobotModel& r) { r.joints[2].name = "joint_1"; }), HasSubstr("two joints have the name 'joint_1'"));
  EXPECT_THAT(refusal([](RobotModel& r) { r.frames.pop_back(); }), HasSubstr("body 'link_7' has no frame"));
  EXPECT_THAT(refusal([](RobotModel& r) { r.joints[1].tau_max = 0; }), HasSubstr("limit of 0"));
  EXPECT_THAT(refusal([](RobotModel& r) { r.bodies[1].inertia.mass = std::nan(""); }), HasSubstr("not finite"));
  EXPECT_THAT(refusal([](RobotModel& r) { r.joints[1].X_PJ.R *= 2; }), HasSubstr("not a rotation"));
  EXPECT_THAT(refusal([](RobotModel& r) {
                r.joints[5].parent = 0;
                r.joints[6].parent = 4;  // 0-1-2-3-4 and 0-5: then back to 4
              }),
              HasSubstr("joint 'joint_7' is not in depth-first order"));
}

TEST(Urdf, ErrorsNameFileLineElementAndExpectation) {
  const auto mass = [](const std::string& value) { return arm_but("mass value=\"2\"", "mass value=\"" + value + "\""); };
  EXPECT_EQ(refusal_of(mass("-1")), "arm.urdf:3: link 'arm': mass -1 kg, expected > 0");
  EXPECT_EQ(refusal_of(mass("heavy")), "arm.urdf:3: link 'arm': value 'heavy' of <mass>, expected a number");
  EXPECT_EQ(refusal_of(mass("nan")), "arm.urdf:3: link 'arm': value 'nan' of <mass>, expected a number");
  EXPECT_EQ(refusal_of(mass("inf")), "arm.urdf:3: link 'arm': value 'inf' of <mass>, expected a finite number");
  for (const char* large : {"1e308", "-1e200", "1e15"}) {  // their products overflow
    EXPECT_EQ(refusal_of(mass(large)),
              std::string("arm.urdf:3: link 'arm': value '") + large + "' of <mass>, expected a magnitude below 1e+15");
  }
  EXPECT_EQ(refusal_of(mass("1,5")), "arm.urdf:3: link 'arm': value '1,5' of <mass>, expected a number");
  EXPECT_EQ(refusal_of(mass("")), "arm.urdf:3: link 'arm': value of <mass> has 0 numbers, expected 1");
  EXPECT_EQ(refusal_of(mass("${m}")),
            "arm.urdf:3: link 'arm': '${m}' is an expression of xacro, expected a URDF; expand it "
            "first: xacro FILE > robot.urdf (ROS package xacro, or pip install xacro)");
  EXPECT_EQ(refusal_of(arm_but("ixy=\"0\" ", "")), "arm.urdf:3: link 'arm': <inertia> without 'ixy'");
  EXPECT_EQ(refusal_of(arm_but("<mass value=\"2\"/>", "")), "arm.urdf:3: link 'arm': <inertial> without <mass>");
  EXPECT_EQ(refusal_of(arm_but("<mass value=\"2\"/>", "<mass value=\"2\"/><mass value=\"2\"/>")),
            "arm.urdf:3: link 'arm': <mass> more than once");
  EXPECT_EQ(refusal_of(arm_but("izz=\"0.1\"", "izz=\"0.3\"")),
            "arm.urdf:3: link 'arm': principal moments 0.1, 0.1, 0.3 kg m2 violate the triangle inequality");
  EXPECT_EQ(refusal_of(arm_but("revolute", "floating")),
            "arm.urdf:4: joint 'turn': type 'floating', expected revolute, continuous, prismatic or fixed");
  EXPECT_THAT(refusal_of(arm_but("revolute", "planar")), HasSubstr("type 'planar'"));
  EXPECT_THAT(refusal_of(arm_but("revolute", "hinge")), HasSubstr("type 'hinge'"));
  EXPECT_EQ(refusal_of(arm_but("<limit lower=\"-1\" upper=\"2\" velocity=\"3\" effort=\"4\"/>", "")),
            "arm.urdf:4: joint 'turn': a revolute joint needs a <limit>");
  EXPECT_EQ(refusal_of(arm_but(" effort=\"4\"", "")), "arm.urdf:4: joint 'turn': <limit> without 'effort'");
  EXPECT_EQ(refusal_of(arm_but("lower=\"-1\"", "lower=\"3\"")),
            "arm.urdf:4: joint 'turn': lower limit 3, upper limit 2, expected a range");
  EXPECT_EQ(refusal_of(arm_but("velocity=\"3\"", "velocity=\"-3\"")),
            "arm.urdf:4: joint 'turn': velocity of <limit> is negative");
  // Shares of such limits overflow.
  EXPECT_EQ(refusal_of(arm_but("velocity=\"3\"", "velocity=\"1e-320\"")),
            "arm.urdf:4: joint 'turn': velocity of <limit> is 1e-320, with which nothing can be computed, expected 1e-09 or "
            "more, or 0");
  EXPECT_THAT(refusal_of(arm_but("effort=\"4\"", "effort=\"9e-10\"")), HasSubstr("effort of <limit> is 9e-10"));
  EXPECT_THAT(refusal_of(arm_but("velocity=\"3\"", "velocity=\"3\" acceleration=\"1e-12\"")),
              HasSubstr("acceleration of <limit>"));
  EXPECT_THAT(refusal_of(arm_but("velocity=\"3\"", "velocity=\"3\" jerk=\"1e-320\"")), HasSubstr("jerk of <limit>"));
  EXPECT_THAT(refusal_of(arm_but("lower=\"-1\" upper=\"2\"", "lower=\"0\" upper=\"1e-320\"")),
              HasSubstr("the way from lower to upper of <limit> is 1e-320"));
  EXPECT_EQ(refusal_of(arm_but("velocity=\"3\"", "velocity=\"1e-9\"")), "no error");
  EXPECT_THAT(refusal_of(arm_but("velocity=\"3\"", "velocity=\"3\" velocity=\"4\"")),
              StartsWith("arm.urdf:4: not well-formed XML: "));
  EXPECT_EQ(refusal_of(arm_but("<parent link=\"base\"/>", "")), "arm.urdf:4: joint 'turn': <joint> without <parent>");
  EXPECT_EQ(refusal_of(arm_but("<child link=\"arm\"/>", "<child link=\"amr\"/>")),
            "arm.urdf:4: joint 'turn': no link 'amr', did you mean 'arm'?");
  EXPECT_EQ(refusal_of(arm_but("xyz=\"0 0 1\"", "xyz=\"0 1\"")),
            "arm.urdf:4: joint 'turn': xyz of <axis> has 2 numbers, expected 3");
  EXPECT_EQ(refusal_of(arm_but("<joint name=\"turn\"", "<joint")), "arm.urdf:4: <joint> without 'name'");
  EXPECT_EQ(refusal_of(arm_but("link name=\"base\"", "link name=\"\"")),
            "arm.urdf:2: 'name' of <link> is empty, long or not plain text, expected a name");
  for (const std::string& name : {std::string("a&#10;b"), std::string(1001, 'a')}) {
    EXPECT_THAT(refusal_of(arm_but("link name=\"base\"", "link name=\"" + name + "\"")),
                StartsWith("arm.urdf:2: 'name' of <link> is empty, long"));
  }
  EXPECT_THAT(refusal_of(arm_but("lower=\"-1\" upper=\"2\"", "lower=\"inf\" upper=\"inf\"")),
              HasSubstr("lower limit inf, upper limit inf"));
  EXPECT_EQ(refusal_of(arm_but("<parent", "<origin rpy=\"0 0 1\" R=\"1 0 0 0 1 0 0 0 1\"/><parent")),
            "arm.urdf:4: joint 'turn': R and rpy of <origin> are different rotations");
  EXPECT_EQ(refusal_of(arm_but("<parent", "<origin R=\"1 0 0 0 1 0 0 0 1.001\"/><parent")),
            "arm.urdf:4: joint 'turn': R of <origin> is not a rotation matrix");
}

TEST(Urdf, ThatIsNotATreeIsRefused) {
  EXPECT_EQ(refusal_of(arm_with(kArm)), "arm.urdf:5: link 'arm': already defined in line 3");
  EXPECT_EQ(refusal_of(arm_with(kTurn)), "arm.urdf:5: joint 'turn': already defined in line 4");
  EXPECT_EQ(refusal_of(arm_with("<link name=\"island\"/>")),
            "arm.urdf:5: link 'island': second root besides 'base', expected one");
  const auto fixed = [](const std::string& name, const std::string& parent, const std::string& child) {
    return "<joint name=\"" + name + "\" type=\"fixed\"><parent link=\"" + parent + "\"/><child link=\"" + child +
           "\"/></joint>";
  };
  EXPECT_EQ(refusal_of(arm_with(fixed("weld", "base", "arm"))),
            "arm.urdf:5: joint 'weld': link 'arm' is already the child of joint 'turn' (line 4)");
  EXPECT_EQ(refusal_of(arm_with(fixed("weld", "arm", "base"))),
            "arm.urdf:2: link 'base': is part of a cycle of joints, expected a tree with one root");
  EXPECT_EQ(refusal_of(arm_with("<link name=\"a\"/>\n<link name=\"b\"/>" + fixed("ab", "a", "b") + fixed("ba", "b", "a"))),
            "arm.urdf:5: link 'a': is part of a cycle of joints, expected a tree with one root");
  EXPECT_THAT(refusal_of(arm_with(fixed("weld", "arm", "arm"))), HasSubstr("link 'arm' is already the child"));
}

TEST(Urdf, OtherDocumentsAreRefused) {
  EXPECT_EQ(refusal_of(""), "arm.urdf: empty, expected a URDF");
  EXPECT_EQ(refusal_of(" \n"), "arm.urdf: empty, expected a URDF");
  EXPECT_EQ(refusal_of(std::string("<robot\0/>", 9)), "arm.urdf: byte 0x00, a character that XML cannot have, expected text");
  for (const char* mark : {"\xFF\xFE<", "\xFE\xFF"})
    EXPECT_EQ(refusal_of(std::string(mark) + std::string("\0r", 2)),
              "arm.urdf: UTF-16 text, expected UTF-8: iconv -f UTF-16 -t UTF-8");
  EXPECT_EQ(refusal_of(std::string("<\0r\0", 4)), "arm.urdf: UTF-16 text, expected UTF-8: iconv -f UTF-16LE -t UTF-8");
  EXPECT_EQ(refusal_of(std::string("\0<\0r", 4)), "arm.urdf: UTF-16 text, expected UTF-8: iconv -f UTF-16BE -t UTF-8");
  EXPECT_EQ(refusal_of(std::string("<\0\0\0", 4)), "arm.urdf: UTF-32 text, expected UTF-8: iconv -f UTF-32LE -t UTF-8");
  EXPECT_EQ(refusal_of(std::string("\xFF\xFE\0\0<", 5)), "arm.urdf: UTF-32 text, expected UTF-8: iconv -f UTF-32 -t UTF-8");
  const std::string latin = arm_but("name=\"turn\"", "name=\"dr\xE9hen\"");
  EXPECT_EQ(
      refusal_of(latin),
      "arm.urdf:4: 'name' of <joint>: byte 0xE9 is not UTF-8, expected UTF-8: iconv -f ISO-8859-1 -t UTF-8, if it is that");
  EXPECT_EQ(
      refusal_of("<?xml version='1.0' encoding='ISO-8859-15'?>" + latin),
      "arm.urdf:4: 'name' of <joint>: byte 0xE9 is not UTF-8 but ISO-8859-15, expected UTF-8: iconv -f ISO-8859-15 -t UTF-8");
  EXPECT_THAT(refusal_of("<?xml version='1.0' encoding='x;rm -rf $HOME'?>" + latin), Not(HasSubstr("HOME")))
      << "a word of the file in a command";
  EXPECT_EQ(refusal_of(arm_with("<!-- dr\xE9hen -->")), "no error");
  EXPECT_EQ(refusal_of("<!-- nothing -->"), "arm.urdf: no XML element, expected <robot>");
  EXPECT_EQ(refusal_of("<sdf/>"), "arm.urdf:1: root element <sdf>, expected <robot>");
  EXPECT_EQ(refusal_of("<robot/>"), "arm.urdf:1: a robot without links");
  EXPECT_EQ(refusal_of("<robot name=\"r\"/>"), "arm.urdf:1: a robot without links");
  EXPECT_THAT(refusal_of("<robot name=\"r\">\n<link></robot>"), StartsWith("arm.urdf:2: not well-formed XML: "));
  EXPECT_THAT(refusal_of(arm_but("<robot name", "<robot version=\"7.0\" name")),
              StartsWith("arm.urdf: urdfdom rejects the file: "));
  EXPECT_EQ(
      refusal_of(arm_with("<xacro:include filename=\"x\"/>")),
      "arm.urdf:5: an element of xacro, expected a URDF; expand it first: xacro FILE > robot.urdf (ROS package xacro, or pip "
      "install xacro)");
  EXPECT_THROW(load_urdf("no/such/file.urdf"), Error);
  EXPECT_THROW(load_urdf(places::source()), Error);  // a folder
}

TEST(Urdf, ThatXacroHasExpandedIsRead) {
  EXPECT_EQ(parsed(arm_but("<robot", "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\"")).n(), 1);
}

TEST(Urdf, ThatIsMuchTooDeepOrLongIsRefused) {
  std::string deep = kHead;
  for (int i = 0; i < 100000; ++i) deep += "<a>";
  EXPECT_THAT(refusal_of(deep), HasSubstr("not well-formed XML"));
  // The root comes last in alphabetical order: freeing the links in that order would free the whole chain with the root, by
  // recursion.
  const auto name = [](int i) { return "\"link_" + std::to_string(9000 - i) + "\""; };
  std::string chain = kHead + ("<link name=" + name(0) + "/>");
  for (int i = 1; i < 2000; ++i) {
    chain += "<link name=" + name(i) + "/><joint name=" + name(i) + " type=\"fixed\">";
    chain += "<parent link=" + name(i - 1) + "/><child link=" + name(i) + "/></joint>";
  }
  EXPECT_EQ(parsed(chain + "</robot>").frames.size(), 2000u);
  EXPECT_THAT(refusal_of(chain + "<link name=\"one too many\"/></robot>"), HasSubstr("more than 2000 links"));
}

// tinyxml2 took 112 s for 200 000 attributes of one element.
TEST(Urdf, WithAnElementOfCountlessAttributesIsRefusedAtOnce) {
  std::string many;
  for (int i = 0; i < 200'000; ++i) many += " x" + std::to_string(i) + "='1'";
  const auto robot = [](const std::string& attributes) {
    return "<robot name='r'>\n<!-- <a" + std::string(2000, '\'') + ">-->\n<link name='a'" + attributes + "/></robot>";
  };
  EXPECT_EQ(parse_urdf(robot(many.substr(0, many.find(" x500="))), "r.urdf").bodies.size(), 0u);
  EXPECT_THAT([&] { parse_urdf(robot(many), "r.urdf"); },
              ThrowsMessage<Error>(HasSubstr("r.urdf:3: an element with more than 1000 attributes")));
}

TEST(Urdf, UnphysicalInertiasAreAWarningOnRequest) {
  const UrdfOptions warn{Unphysical::kWarn, ""};
  EXPECT_THAT(warnings_of(arm_but("mass value=\"2\"", "mass value=\"-2\"")),
              ElementsAre("arm.urdf:3: link 'arm': mass -2 kg, expected > 0; kept unchanged"));
  EXPECT_EQ(parsed(arm_but("mass value=\"2\"", "mass value=\"-2\""), warn).bodies[0].inertia.mass, -2);
  EXPECT_THAT(warnings_of(arm_but("izz=\"0.1\"", "izz=\"0.3\"")),
              ElementsAre(HasSubstr("violate the triangle inequality; kept unchanged")));
}

TEST(Urdf, BodiesThatMoveNeedMassButMassesNeedNotBeOnEveryLink) {
  const std::string massless = kHead + std::string(kBase) + "<link name=\"arm\"/>\n" + kTurn;
  const std::string frame =
      "<link name=\"eye\"/><joint name=\"look\" type=\"fixed\"><parent link=\"arm\"/><child link=\"eye\"/></joint>";
  EXPECT_EQ(refusal_of(massless + frame + "</robot>"),
            "arm.urdf:3: link 'arm': joint 'turn' moves no mass ('arm', 'eye'), expected > 0 kg");
  EXPECT_THAT(warnings_of(massless + frame + "</robot>"), ElementsAre(HasSubstr("moves no mass ('arm', 'eye')")));
  EXPECT_EQ(parsed(massless + rigid_on("arm", "weight", "") + "</robot>").bodies[0].inertia.mass, 1);
  EXPECT_EQ(parsed(arm_with(frame)).bodies[0], parsed(arm_with("")).bodies[0]);
}

TEST(Urdf, AnInertiaIsJudgedWithAllThatIsWeldedToIt) {
  const auto welded = [](const std::string& parent, const std::string& name, const std::string& xyz, const std::string& mass) {
    return "<link name=\"" + name + "\"><inertial><mass value=\"" + mass +
           "\"/><inertia ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" iyz=\"0\" izz=\"0\"/></inertial></link><joint name=\"to_" +
           name + "\" type=\"fixed\"><parent link=\"" + parent + "\"/><child link=\"" + name + "\"/><origin xyz=\"" + xyz +
           "\"/></joint>";
  };
  const UrdfOptions estimate{Unphysical::kEstimate, ""};
  for (const UrdfOptions& options : {UrdfOptions{}, UrdfOptions{Unphysical::kWarn, ""}, estimate}) {
    std::vector<std::string> warnings;
    const RobotModel robot = parsed(arm_with(welded("arm", "tip", "2 0 0", "0.5")), options, &warnings);
    EXPECT_THAT(warnings, IsEmpty());
    EXPECT_EQ(robot.bodies[0].inertia, parsed(arm_with("")).bodies[0].inertia + (Inertia{0.5, {2, 0, 0}, Matrix3d::Zero()}));
    EXPECT_THAT(warnings_of(arm_with(welded("base", "foot", "0 0 1", "3")), options), IsEmpty());
  }
  // Point masses alone: in space a body, on a line none, as one none.
  const auto points = [&](const std::string& more) {
    return std::string(kHead) + kBase + "<link name=\"arm\"/>\n" + kTurn + welded("arm", "p", "1 0 0", "1") + more + "</robot>";
  };
  const std::string line = welded("p", "q", "0 1 0", "1");
  EXPECT_EQ(refusal_of(points(line + welded("q", "r", "0 0 1", "1"))), "no error");
  EXPECT_THAT(refusal_of(points(line)), StartsWith("arm.urdf:5: link 'p': principal moments 0, "));
  EXPECT_EQ(refusal_of(points("")), "arm.urdf:5: link 'p': no moments of inertia, expected > 0 kg m2");
  EXPECT_THAT(warnings_of(points("")),
              ElementsAre("arm.urdf:5: link 'p': no moments of inertia, expected > 0 kg m2; kept unchanged"));
  const RobotModel estimated = parsed(points(""), estimate);
  EXPECT_EQ(estimated.bodies[0].inertia.unphysical(), "");
  EXPECT_EQ(estimated.bodies[0].inertia.mass, 1);
  EXPECT_EQ(estimated.bodies[0].inertia.p_LC, Vector3d(1, 0, 0));
  for (const char* mass : {"-1e-9", "nan", "1e999"})
    EXPECT_NE(refusal_of(arm_with(welded("arm", "tip", "2 0 0", mass))), "no error");
}

/// What an option cures is the robot of the file that a person has mended.
TEST(Urdf, EstimateChangesNothingButInertiasAndNegativeLimits) {
  const UrdfOptions estimate{Unphysical::kEstimate, ""};
  const std::string more = rigid_on("arm", "tool", "<origin xyz=\"0 0 1\"/>");
  const RobotModel sound = parsed(arm_with(more));
  const auto read = [&](const std::string& from, const std::string& to) {
    std::string xml = arm_with(more);
    return parsed(xml.replace(xml.find(from), from.size(), to), estimate);
  };
  RobotModel robot = read("effort=\"4\"", "effort=\"-4\"");
  EXPECT_EQ(robot.joints[0].tau_max, kInfinity);
  robot.joints[0].tau_max = sound.joints[0].tau_max;
  EXPECT_EQ(robot, sound);
  robot = read("izz=\"0.1\"", "izz=\"0.5\"");
  EXPECT_NE(robot, sound);
  robot.bodies[0].inertia = sound.bodies[0].inertia;
  EXPECT_EQ(robot, sound);
  // A fault beside it stays one.
  for (const char* fault : {"<mimic joint=\"turn\" multiplyer=\"2\"/>", "<spring stiffness=\"5\"/>"}) {
    std::string xml = arm_with(more);
    xml.insert(xml.find("<limit"), fault);
    xml.replace(xml.find("izz=\"0.1\""), 9, "izz=\"0.5\"");
    EXPECT_THAT(refusal_of(xml, estimate), HasSubstr("is not read")) << fault;
    EXPECT_THROW(parsed(xml), Error);
    try {
      parsed(xml);
    } catch (const UnphysicalValue& value) {
      ADD_FAILURE() << value.what() << " has an option, though the word has none";
    } catch (const Error&) {
    }
  }
}

TEST(Urdf, MassesInGramsNameTheirUnitsWhereAllHaveThem) {
  const auto units = [](const std::string& xml) -> std::string {
    try {
      parsed(xml);
    } catch (const OtherUnits& other) {
      return other.units;
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  };
  EXPECT_EQ(units(arm_but("mass value", "mass unit=\"g\" value")), "inertia=kg.m2,mass=g");
  EXPECT_EQ(units(arm_but("mass value", "mass unit=\"kg\" value")), "no error");
  const std::string one = arm_but("mass value", "mass unit=\"g\" value");
  const std::string two = one.substr(0, one.find("</robot>")) + rigid_on("arm", "tool", "") + "</robot>";
  EXPECT_EQ(units(two), "arm.urdf:3: link 'arm': 'unit' as an attribute of <mass> is not read: 'g' is no unit of SI");
  EXPECT_EQ(units(arm_but("inertia ixx", "inertia units=\"g.mm2\" ixx")), "inertia=g.mm2,mass=kg");
  EXPECT_THAT(units(arm_but("inertia ixx", "inertia unit=\"t.m2\" ixx")), HasSubstr("'t.m2' is no unit of SI"));
}

TEST(Urdf, UnphysicalInertiaOfTheBaseIsAWarning) {
  const std::string xml =
      arm_but(kBase,
              "<link name=\"base\"><inertial><mass value=\"0\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" "
              "iyz=\"0\" izz=\"1\"/></inertial></link>\n");
  EXPECT_THAT(warnings_of(xml, {}),
              ElementsAre("arm.urdf:2: link 'base': mass 0 kg, expected > 0; it does not move, so no torque depends on it"));
}

TEST(Urdf, ImplausibleLimitsAndAxesAreReported) {
  EXPECT_THAT(warnings_of(arm_but("0 0 1", "0 0 2")), ElementsAre("arm.urdf:4: joint 'turn': axis of length 2 is normalised"));
  EXPECT_THAT(warnings_of(arm_but("effort=\"4\"", "effort=\"0\"")),
              ElementsAre("arm.urdf:4: joint 'turn': effort limit 0 is read as no limit"));
  EXPECT_EQ(parsed(arm_but("effort=\"4\"", "effort=\"0\"")).joints[0].tau_max, kInfinity);
  EXPECT_THAT(warnings_of(arm_but("lower=\"-1\" upper=\"2\" ", "")),
              ElementsAre("arm.urdf:4: joint 'turn': lower and upper limit are both 0; the joint cannot move"));
}

TEST(Urdf, LimitsThatAreAllZeroAreNone) {
  const std::string xml = arm_but("lower=\"-1\" upper=\"2\" velocity=\"3\" effort=\"4\"", "velocity=\"0\" effort=\"0\"");
  EXPECT_THAT(warnings_of(xml),
              ElementsAre("arm.urdf:4: joint 'turn': all limits are 0, as exporters write where none are known; "
                          "they are read as no limits"));
  const Joint joint = parsed(xml).joints[0];
  EXPECT_EQ(joint.q_max, kInfinity);
  EXPECT_EQ(joint.q_min, -kInfinity);
  EXPECT_EQ(joint.tau_max, kInfinity);
}

TEST(Urdf, LimitsOfAccelerationAndJerkAreReadAndWritten) {
  const std::string xml = arm_but("effort=\"4\"", "effort=\"4\" acceleration=\"5\" deceleration=\"4\" jerk=\"50\"");
  EXPECT_THAT(warnings_of(xml), IsEmpty());
  const RobotModel robot = parsed(xml);
  EXPECT_EQ(robot.joints[0].ddq_max, 4);  // of both directions, the smaller one
  EXPECT_EQ(robot.joints[0].dddq_max, 50);
  EXPECT_EQ(parsed(to_urdf(robot)), robot);
  for (const char* none : {"0", "inf", "1e16"})
    EXPECT_EQ(parsed(arm_but("effort=\"4\"", std::string("effort=\"4\" jerk=\"") + none + "\"")).joints[0].dddq_max, kInfinity);
  EXPECT_EQ(refusal_of(arm_but("effort=\"4\"", "effort=\"4\" jerk=\"-1\"")),
            "arm.urdf:4: joint 'turn': jerk of <limit> is negative");
  EXPECT_THAT(refusal_of(arm_but("effort=\"4\"", "effort=\"4\" jerk=\"much\"")),
              HasSubstr("jerk 'much' of <limit>, expected a number"));
}

TEST(Urdf, NegativeLimitsAreNoneOnRequest) {
  const std::string xml = arm_but("effort=\"4\"", "effort=\"-1\"");
  EXPECT_EQ(refusal_of(xml), "arm.urdf:4: joint 'turn': effort of <limit> is negative");
  EXPECT_EQ(parsed(xml, {Unphysical::kWarn, ""}).joints[0].tau_max, kInfinity);
  EXPECT_THAT(warnings_of(xml), ElementsAre("arm.urdf:4: joint 'turn': effort of <limit> is negative",
                                            "arm.urdf:4: joint 'turn': effort limit -1 is read as no limit"));
}

TEST(Urdf, ARobotWithoutANameIsCalledAfterItsFile) {
  const std::string xml = arm_but("<robot name=\"r\"", "<robot");
  EXPECT_EQ(parse_urdf(xml, "some/where/picker.urdf").name, "picker");
  EXPECT_THAT(warnings_of(xml), ElementsAre("arm.urdf:1: <robot> without 'name', called 'arm'"));
}

TEST(Urdf, ShapesAndExtensionsDoNotMatter) {
  const RobotModel arm = parsed(arm_with(""));
  EXPECT_EQ(parsed(arm_but("<inertial>",
                           "<visual><geometry><mesh filename=\"package://no/such.stl\"/></geometry></visual>"
                           "<collision><geometry><box/></geometry></collision><inertial>")),
            arm);
  EXPECT_EQ(parsed(arm_but("</joint>", "<safety_controller soft_lower_limit=\"x\"/><calibration rising=\"y\"/></joint>")), arm);
  EXPECT_EQ(parsed(arm_with(
                "<transmission name=\"t\"><joint name=\"turn\"/></transmission><gazebo><gravity>1</gravity></gazebo><!-- -->")),
            arm);
}

class CommaForAPoint : public std::numpunct<char> {
 protected:
  char do_decimal_point() const override { return ','; }
  std::string do_grouping() const override { return "\1"; }
};

TEST(Urdf, ReadsNumbersAlikeInEveryLocale) {
  const std::string xml = arm_but("mass value=\"2\"", "mass value=\" +1234.5e0 \"");
  const RobotModel here = parsed(xml);
  EXPECT_EQ(here.bodies[0].inertia.mass, 1234.5);
  const std::locale before = std::locale::global(std::locale(std::locale::classic(), new CommaForAPoint));
  const RobotModel there = parsed(xml);
  const std::string written = to_urdf(there);
  std::locale::global(before);
  EXPECT_EQ(there, here);
  EXPECT_EQ(written, to_urdf(here));
}

TEST(Urdf, NothingIsPrintedAndTheHostsHandlerIsKept) {
  console_bridge::OutputHandler* const before = console_bridge::getOutputHandler();
  ::testing::internal::CaptureStderr();
  ::testing::internal::CaptureStdout();
  parsed(arm_with(""));
  refusal_of(arm_but("<robot name", "<robot version=\"7.0\" name"));
  warnings_of(arm_but("mass value=\"2\"", "mass value=\"-2\""));
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(::testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(console_bridge::getOutputHandler(), before);
}

TEST(Urdf, IsReadByManyThreadsAtOnceAndEachGetsItsOwnError) {
  const auto versioned = [](std::size_t i) {
    return arm_but("<robot name", i % 2 == 0 ? "<robot version=\"7.0\" name" : "<robot version=\"seven\" name");
  };
  const RobotModel arm = parsed(arm_with(""));
  const std::vector<std::string> alone = {refusal_of(versioned(0)), refusal_of(versioned(1))};
  ASSERT_NE(alone[0], alone[1]);
  std::vector<std::string> wrong(8);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < wrong.size(); ++i) {
    threads.emplace_back([&, i] {
      for (int round = 0; round < 50; ++round) {
        if (!(parsed(arm_with("")) == arm)) wrong[i] = "another robot";
        const std::string message = refusal_of(versioned(i));
        if (message != alone[i % 2]) wrong[i] = message;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const std::string& message : wrong) EXPECT_EQ(message, "");
}

}  // namespace
}  // namespace cotwin::robot::urdf_test
