// Numbers of URDFs that are not in SI are noticed, and missing inertias are estimated.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/numerics/dense.h"
#include "models/robot/changes/tool.h"
#include "models/robot/urdf/estimate.h"
#include "models/robot/urdf/units.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/urdf/urdf_in_si.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::robot::urdf_units_test {
namespace {

using cotwin::testing::TemporaryFolder;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::SizeIs;

/// An arm of 0.9 m with a slide and a gripper, its numbers in other units of measure. Factors: SI to the unit.
struct Units {
  double length = 1, mass = 1, inertia = 1, angle = 1, speed = 1, rpy = 1;
};

std::string arm(const Units& u) {
  const auto n = [](double x) { return std::to_string(x); };
  const auto inertial = [&](double mass) {
    return "<inertial><origin xyz=\"0 0 " + n(0.2 * u.length) + "\"/><mass value=\"" + n(mass * u.mass) +
           "\"/><inertia ixx=\"" + n(0.05 * u.inertia) + "\" ixy=\"0\" ixz=\"0\" iyy=\"" + n(0.05 * u.inertia) +
           "\" iyz=\"0\" izz=\"" + n(0.02 * u.inertia) + "\"/></inertial><collision><origin xyz=\"0 0 " + n(0.1 * u.length) +
           "\"/><geometry><cylinder radius=\"" + n(0.04 * u.length) + "\" length=\"" + n(0.3 * u.length) +
           "\"/></geometry></collision>";
  };
  const auto joint = [&](const std::string& name, const std::string& type, const std::string& from, const std::string& to,
                         double z, double range, double speed, const std::string& more) {
    return "<joint name=\"" + name + "\" type=\"" + type + "\"><origin xyz=\"0 0 " + n(z * u.length) + "\" rpy=\"" +
           n(M_PI / 2 * u.rpy) + " 0 0\"/><parent link=\"" + from + "\"/><child link=\"" + to +
           "\"/><axis xyz=\"0 1 0\"/><limit lower=\"" + n(-range) + "\" upper=\"" + n(range) + "\" effort=\"90\" velocity=\"" +
           n(speed) + "\"/>" + more + "</joint>";
  };
  return "<robot name=\"arm\"><link name=\"base\"/><link name=\"one\">" + inertial(6) + "</link><link name=\"two\">" +
         inertial(4) + "</link><link name=\"three\">" + inertial(2) + "</link><link name=\"four\">" + inertial(1) + "</link>" +
         joint("turn", "revolute", "base", "one", 0.1, 2.9 * u.angle, 2 * u.speed, "") +
         joint("bend", "revolute", "one", "two", 0.4, 2.1 * u.angle, 3 * u.speed, "") +
         joint("slide", "prismatic", "two", "three", 0.3, 0.2 * u.length, 0.5 * u.length, "") +
         joint(
             "grip", "revolute", "three", "four", 0.1, 1 * u.angle, 3 * u.speed,
             "<mimic joint=\"slide\" multiplier=\"" + n(4 * u.angle / u.length) + "\" offset=\"" + n(0.1 * u.angle) + "\"/>") +
         "</robot>";
}

constexpr double kDegrees = 180 / M_PI;

/// The error of the reader, and the units that it proposes.
struct Refusal {
  std::string text, units;
};
Refusal refusal_of(const std::filesystem::path& file) {
  try {
    load_urdf(file);
  } catch (const OtherUnits& error) {
    return {error.what(), error.units};
  }
  return {"no error", ""};
}

struct Case {
  const char* name;
  Units units;
  const char* proposed;
};

class OtherUnitsOfUrdf : public ::testing::TestWithParam<Case> {};

TEST_P(OtherUnitsOfUrdf, AreRefusedWithTheOptionThatReadsThem) {
  const TemporaryFolder folder("units");
  folder.write("si.urdf", arm({}));
  folder.write("other.urdf", arm(GetParam().units));
  const RobotModel expected = load_urdf(folder / "si.urdf");
  const Refusal refusal = refusal_of(folder / "other.urdf");
  EXPECT_EQ(refusal.units, GetParam().proposed) << refusal.text;
  EXPECT_THAT(refusal.text, AllOf(HasSubstr("other.urdf"), HasSubstr("cotwin new --urdf-units " + refusal.units)));
  // What the option writes is the arm in SI, with its shapes.
  folder.write("again.urdf", scene::urdf_in_si(folder / "other.urdf", parse_urdf_units(refusal.units, "units")));
  const RobotModel again = load_urdf(folder / "again.urdf");
  const double kRounding = 2e-5;  // std::to_string has 6 decimals
  ASSERT_EQ(again.n(), expected.n());
  for (std::size_t i = 0; i < expected.joints.size(); ++i) {
    EXPECT_TRUE(again.joints[i].X_PJ.p.isApprox(expected.joints[i].X_PJ.p, kRounding)) << i;
    EXPECT_TRUE(again.joints[i].X_PJ.R.isApprox(expected.joints[i].X_PJ.R, kRounding)) << i;
    EXPECT_NEAR(again.joints[i].q_max, expected.joints[i].q_max, kRounding) << i;
    EXPECT_NEAR(again.joints[i].dq_max, expected.joints[i].dq_max, kRounding) << i;
    EXPECT_NEAR(again.bodies[i].inertia.mass, expected.bodies[i].inertia.mass, kRounding) << i;
    EXPECT_TRUE(again.bodies[i].inertia.I_CC.isApprox(expected.bodies[i].inertia.I_CC, kRounding)) << i;
  }
  EXPECT_NEAR(again.mimics[0].multiplier, expected.mimics[0].multiplier, 4e-3);  // 6 decimals of 0.23 deg/mm
  EXPECT_NEAR(again.mimics[0].offset, expected.mimics[0].offset, kRounding);
  const auto shapes = scene::shapes_of_urdf(folder / "again.urdf", again);
  EXPECT_NEAR(shapes[1][0].size[0], 0.04, kRounding);
  EXPECT_NEAR(shapes[1][0].size[1], 0.3, kRounding);
  EXPECT_NEAR(shapes[1][0].X_BS.p.z(), 0.1, kRounding);
}

INSTANTIATE_TEST_SUITE_P(All, OtherUnitsOfUrdf,
                         ::testing::Values(Case{"mm", {.length = 1e3, .inertia = 1e6}, "length=mm"},
                                           Case{"g", {.mass = 1e3, .inertia = 1e3}, "mass=g"},
                                           Case{"mm_g", {.length = 1e3, .mass = 1e3, .inertia = 1e9}, "length=mm,mass=g"},
                                           Case{"deg", {.angle = kDegrees}, "limit=deg"},
                                           Case{"deg_per_s", {.angle = kDegrees, .speed = kDegrees}, "limit=deg,speed=deg/s"},
                                           Case{"rpy", {.rpy = kDegrees}, "rpy=deg"}),
                         [](const auto& one) { return std::string(one.param.name); });

TEST(UrdfUnits, ThatTheFileNamesAreConvertedAloneAndNeverASecondTime) {
  const TemporaryFolder folder("units");
  const auto named = [&](std::string xml, const std::string& from, const std::string& to) {
    for (std::size_t at = xml.find(from); at != std::string::npos; at = xml.find(from, at + to.size()))
      xml.replace(at, from.size(), to);
    return folder.write("arm.urdf", xml);
  };
  const auto in = [&](const std::string& units, std::vector<std::string>* notes = nullptr) {
    folder.write("si.urdf", scene::urdf_in_si(folder / "arm.urdf", parse_urdf_units(units, ""), notes));
    return load_urdf(folder / "si.urdf");
  };
  const auto error_in = [&](const std::string& units) -> std::string {
    try {
      in(units);
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  };
  folder.write("expected.urdf", arm({}));
  const RobotModel expected = load_urdf(folder / "expected.urdf");
  named(arm({.mass = 1e3}), "<mass", "<mass unit=\"g\"");
  EXPECT_EQ(in(refusal_of(folder / "arm.urdf").units).bodies, expected.bodies) << "the inertias are in SI";
  std::vector<std::string> notes;
  EXPECT_GT(in("si", &notes).bodies[0].inertia.mass, 5000);
  EXPECT_THAT(notes, ::testing::ElementsAre(HasSubstr("<mass> has unit=\"g\" (4 times), which --urdf-units si takes in SI")));
  named(arm({.mass = 1e3, .inertia = 1e9}), "<inertia ", "<inertia unit=\"g.mm2\" ");
  named(text::read_file(folder / "arm.urdf", "a URDF", 1'000'000), "<mass", "<mass units=\"g\"");
  EXPECT_EQ(in(refusal_of(folder / "arm.urdf").units).bodies, expected.bodies);
  named(arm({}), "<mass", "<mass unit=\"kg\"");
  EXPECT_THAT(error_in("mass=g"), HasSubstr("<mass> has unit=\"kg\", expected mass in SI in --urdf-units mass=g"));
  named(arm({}), "<inertia ", "<inertia unit=\"kg.m2\" ");
  EXPECT_THAT(error_in("mass=g"), HasSubstr("<inertia> has unit=\"kg.m2\"")) << "which mass=g would scale, too";
  named(arm({}), "<limit", "<limit unit=\"deg\"");
  EXPECT_THAT(error_in("rpy=deg"), HasSubstr("'deg' is no unit of SI")) << "of another quantity";
}

TEST(UrdfUnits, AMarkTakesUnusualNumbersAsTheyAre) {
  const TemporaryFolder folder("units");
  folder.write("large.urdf", arm({.length = 1e3, .inertia = 1e6}));
  folder.write("marked.urdf", scene::urdf_in_si(folder / "large.urdf", parse_urdf_units("si", "units")));
  const RobotModel large = load_urdf(folder / "marked.urdf");
  EXPECT_NEAR(reach_of(large), 1e3 * (0.4 + 0.3 + 0.1), 1e-6);
  folder.write("again.urdf", to_urdf(large));  // keeps the mark
  EXPECT_EQ(load_urdf(folder / "again.urdf"), large);
}

/// The error of check_units for the arm, read in `units`.
std::string converted(const Units& of_file, const std::string& units) {
  const TemporaryFolder folder("units");
  folder.write("other.urdf", arm(of_file));
  try {
    const UrdfUnits parsed = parse_urdf_units(units, "--urdf-units");
    check_units(scene::urdf_in_si(folder / "other.urdf", parsed), "other.urdf", parsed);
  } catch (const OtherUnits& error) {
    return "not SI: " + error.units;
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(UrdfUnits, AreCheckedAgainWhereSomeAreGiven) {
  const Units mm_and_degrees{.length = 1e3, .inertia = 1e6, .rpy = kDegrees};
  EXPECT_EQ(converted(mm_and_degrees, "length=mm,rpy=deg"), "");
  EXPECT_EQ(converted(mm_and_degrees, "rpy=deg"), "not SI: rpy=deg,length=mm");
  EXPECT_EQ(converted(mm_and_degrees, "limit=rad"), "not SI: limit=rad,rpy=deg,length=mm");
  EXPECT_EQ(converted(mm_and_degrees, "length=m,rpy=rad"), "") << "what is named in SI is taken as it is";
  EXPECT_EQ(converted(mm_and_degrees, "si"), "");
  EXPECT_THAT(converted(mm_and_degrees, "length=in,rpy=deg"),
              HasSubstr("read with length=in,rpy=deg, the robot reaches 20.3 m"));
  EXPECT_THAT(converted({}, "length=mm"), HasSubstr("the robot reaches 0.8 mm, expected another unit of length"));
  const TemporaryFolder folder("units");
  folder.write("both.urdf", arm(mm_and_degrees));
  EXPECT_EQ(refusal_of(folder / "both.urdf").units, "rpy=deg,length=mm") << "both are named at once";
  folder.write("si.urdf", scene::urdf_in_si(folder / "both.urdf", parse_urdf_units("length=mm,rpy=deg", "")));
  try {
    (void)scene::urdf_in_si(folder / "si.urdf", parse_urdf_units("length=mm", ""));
    ADD_FAILURE() << "read in mm a second time";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("<si/>: its numbers are in SI already"));
  }
}

TEST(UrdfUnits, OfMimicsWithoutMultiplierAreThoseOfTheirJoints) {
  const TemporaryFolder folder("units");
  std::string xml = arm({.length = 1e3, .inertia = 1e6});
  const std::size_t begin = xml.find("<mimic"), end = xml.find("/>", begin);
  xml.replace(begin, end - begin, "<mimic joint=\"slide\"");  // 1 rad/mm
  xml.replace(xml.find("xyz=\"0 0 "), 9, "xyz=\"0\t0\n");
  folder.write("other.urdf", xml);
  folder.write("si.urdf", scene::urdf_in_si(folder / "other.urdf", parse_urdf_units("length=mm", "")));
  EXPECT_NEAR(load_urdf(folder / "si.urdf").mimics.at(0).multiplier, 1000, 1e-9);
}

TEST(UrdfUnits, OfGantriesAndDrumsAreThoseThatTheyHave) {
  const auto link = [](const std::string& name, double mass) {
    return "<link name=\"" + name + "\"><inertial><mass value=\"" + std::to_string(mass) +
           "\"/><inertia ixx=\"20\" ixy=\"0\" ixz=\"0\" iyy=\"20\" iyz=\"0\" izz=\"20\"/></inertial></link>";
  };
  const auto joint = [](const std::string& from, const std::string& to, const std::string& type, double travel) {
    return "<joint name=\"to_" + to + "\" type=\"" + type + "\"><origin xyz=\"0 0 0.3\"/><parent link=\"" + from +
           "\"/><child link=\"" + to + "\"/><axis xyz=\"1 0 0\"/><limit lower=\"0\" upper=\"" + std::to_string(travel) +
           "\" effort=\"9000\" velocity=\"1\"/></joint>";
  };
  const TemporaryFolder folder("units");
  folder.write("gantry.urdf", "<robot name=\"gantry\"><link name=\"floor\"/>" + link("bridge", 450) + link("trolley", 120) +
                                  link("drum", 60) + joint("floor", "bridge", "prismatic", 6) +
                                  joint("bridge", "trolley", "prismatic", 3) + joint("trolley", "drum", "revolute", 62.8) +
                                  "</robot>");
  EXPECT_NO_THROW(load_urdf(folder / "gantry.urdf"));
}

/// A part of the arm in another unit than the rest.
TEST(UrdfUnits, OfOneJointAloneAndOfInertiasAreNoticed) {
  const TemporaryFolder folder("units");
  const auto refusal = [&](const Units& units, const std::string& from, const std::string& to) {
    std::string xml = arm(units);
    if (!from.empty()) xml.replace(xml.find(from), from.size(), to);
    folder.write("arm.urdf", xml);
    return refusal_of(folder / "arm.urdf");
  };
  const std::string bend = "lower=\"-2.100000\" upper=\"2.100000\"", slide = "lower=\"-0.200000\" upper=\"0.200000\"";
  for (const auto& [to, text] :
       {std::pair{"lower=\"-120\" upper=\"120\"", "the limits of joint 'bend' are -120 and 120 rad"},
        std::pair{"lower=\"-172.5\" upper=\"90\"", "the limits of joint 'bend' are -172 and 90 rad"}}) {
    const Refusal found = refusal({}, bend, to);
    EXPECT_THAT(found.text, AllOf(HasSubstr(text), HasSubstr("expected SI: correct it, or take it as it is"),
                                  HasSubstr("--urdf-units limit=rad")));
    EXPECT_EQ(found.units, "") << "degrees for all would be wrong for the others";
    EXPECT_EQ(scene::urdf_in_si(folder / "arm.urdf", parse_urdf_units("limit=rad", "")).empty(), false);
  }
  EXPECT_THAT(refusal({}, slide, "lower=\"0\" upper=\"200\"").text,
              AllOf(HasSubstr("the limits of slide 'slide' are 0 and 200 m"), HasSubstr("--urdf-units length=m")));
  EXPECT_EQ(refusal({}, slide, "lower=\"0\" upper=\"15\"").text, "no error") << "a rail";
  EXPECT_EQ(refusal({}, slide, "lower=\"-1e6\" upper=\"1e6\"").text, "no error") << "no limit";
  for (const auto& [factor, unit] : {std::pair{1e6, "inertia=kg.mm2"}, {1e9, "inertia=g.mm2"}, {1e4, "inertia=kg.cm2"}}) {
    const Refusal found = refusal({.inertia = factor}, "", "");
    EXPECT_EQ(found.units, unit);
    folder.write("si.urdf", scene::urdf_in_si(folder / "arm.urdf", parse_urdf_units(unit, "")));
    EXPECT_NEAR(load_urdf(folder / "si.urdf").bodies[0].inertia.I_CC(0, 0), 0.05, 1e-9);
  }
}

TEST(UrdfUnits, OfToolsAreNoticed) {
  const auto tool = [](double z) {
    return "<robot name=\"probe\"><link name=\"probe\"><inertial><origin xyz=\"0 0 " + std::to_string(z) +
           "\"/><mass value=\"0.8\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" "
           "izz=\"1\"/></inertial></link></robot>";
  };
  EXPECT_NO_THROW(parse_tool(tool(0.06), "probe.urdf", "probe"));
  try {
    (void)parse_tool(tool(60), "probe.urdf", "probe");
    ADD_FAILURE() << "a tool of 60 m";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("probe.urdf: it reaches 60 m, expected m and kg (length=mm?)"));
  }
}

TEST(UrdfUnits, OfOurRobotsAreNotSuspected) {
  for (const auto& entry : std::filesystem::directory_iterator(places::source() + "/models/robots")) {
    const std::filesystem::path file = entry.path() / "robot.urdf";
    if (std::filesystem::exists(file)) {
      EXPECT_NO_THROW(load_urdf(file)) << file;
    }
  }
}

TEST(UrdfUnits, AreNamedWhereTheyAreUnknown) {
  const auto refusal = [](const std::string& text) -> std::string {
    try {
      (void)parse_urdf_units(text, "--urdf-units");
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  };
  EXPECT_THAT(refusal("lenght=mm"), HasSubstr("--urdf-units: 'lenght=mm', expected si, or quantities"));
  EXPECT_THAT(refusal("length=furlong"), HasSubstr("expected one of the units m, cm, mm, in"));
  EXPECT_THAT(refusal("mm"), HasSubstr("'mm', expected"));
  EXPECT_THAT(refusal(""), HasSubstr("expected"));
  EXPECT_EQ(parse_urdf_units("length=mm, mass=g", "").inertia, 1e-9);
  EXPECT_EQ(parse_urdf_units("inertia=kg.m2,length=mm", "").inertia, 1);
}

/// As the closest inertia of a body: mass and centre stay, and no physical body is changed.
TEST(EstimatedInertia, RepairsMomentsThatNoBodyCanHave) {
  const auto with = [](const Eigen::Vector3d& moments) {
    return Inertia{2, {0.1, 0.2, 0.3}, Eigen::Matrix3d(moments.asDiagonal())};
  };
  const Eigen::Matrix3d turned = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  for (const Eigen::Vector3d& moments :
       {Eigen::Vector3d(1, 2, 4), {0, 0, 0}, {0, 1, 1}, {-1e-22, 1, 1}, {5, 1, 1}, {-1, -1, -1}, {1e-9, 3e-9, 1e-8}}) {
    Inertia given = with(moments);
    given.I_CC = (turned * given.I_CC * turned.transpose()).eval();
    const Inertia found = repaired(given);
    EXPECT_EQ(found.unphysical(), "") << moments.transpose();
    EXPECT_EQ(found.mass, 2);
    EXPECT_EQ(found.p_LC, given.p_LC);
  }
  const Inertia body = with({1, 2, 2.5});
  EXPECT_TRUE(repaired(body).I_CC.isApprox(body.I_CC, 1e-12));
  EXPECT_TRUE(repaired({0, {}, Eigen::Matrix3d::Identity()}).is_nothing());
  EXPECT_TRUE(repaired({-1, {}, Eigen::Matrix3d::Identity()}).is_nothing());
  EXPECT_TRUE(repaired({NAN, {}, Eigen::Matrix3d::Identity()}).is_nothing());
}

TEST(EstimatedInertia, ReplacesWhatIsMissingAndTellsIt) {
  std::string xml = arm({});
  for (std::size_t at = 0; (at = xml.find("<inertial>")) != std::string::npos;)
    xml.erase(at, xml.find("</inertial>") + 11 - at);
  EXPECT_THROW(parse_urdf(xml, "arm.urdf"), Error);
  std::vector<std::string> warnings;
  UrdfOptions options;
  options.unphysical = Unphysical::kEstimate;
  const RobotModel robot = parse_urdf(xml, "arm.urdf", options, &warnings);
  EXPECT_THAT(warnings, SizeIs(4));
  EXPECT_THAT(warnings[0], HasSubstr("joint 'turn' moves no mass ('one'), expected > 0 kg; estimated as "));
  double mass = 0;
  for (const Body& body : robot.bodies) {
    EXPECT_EQ(body.inertia.unphysical(), "") << body.name;
    mass += body.inertia.mass;
  }
  // Also of links that are not along an axis of their frames: symmetric to the last bit.
  for (std::size_t at = 0; (at = xml.find("xyz=\"0 0 0.", at)) != std::string::npos; ++at)
    xml.replace(at + 5, 3, "0.123 0.457");
  for (const Body& body : parse_urdf(xml, "arm.urdf", options).bodies) EXPECT_EQ(body.inertia.unphysical(), "") << body.name;
  // Rods of 0.4, 0.3, 0.1 and, at least a tenth of the reach, 0.08 m with a radius of 0.04 m.
  EXPECT_NEAR(mass, 2700 * M_PI * 0.04 * 0.04 * (0.4 + 0.3 + 0.1 + 0.08), 1e-9);
}

}  // namespace
}  // namespace cotwin::robot::urdf_units_test
