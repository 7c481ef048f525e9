// Features of SDF in the contact world: meshes, joints of two axes, screws, springs, friction by direction, spin, ellipsoids.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "models/scene/sdf/sdf.h"
#include "tests/support/files.h"

namespace cotwin::contact_world::sdf_test {
namespace {

using cotwin::testing::TemporaryFolder;
using Eigen::Vector3d;

constexpr double kGravity = 9.81;  // m/s²

std::string number(double x) { return std::to_string(x); }

scene::Scene read(const std::string& models, const TemporaryFolder* folder = nullptr,
                  std::vector<std::string>* warnings = nullptr) {
  const std::string text = "<sdf version='1.10'><world name='w'><gravity>0 0 -9.81</gravity>" + models + "</world></sdf>";
  return scene::parse_sdf(text, folder != nullptr ? folder->path() / "test.sdf" : "test.sdf", warnings);
}

std::string inertial(double mass, double x, double y, double z) {
  return "<inertial><mass>" + number(mass) + "</mass><inertia><ixx>" + number(x) + "</ixx><iyy>" + number(y) + "</iyy><izz>" +
         number(z) + "</izz></inertia></inertial>";
}

std::string ground(const std::string& surface = "", const std::string& pose = "0 0 0 0 0 0") {
  return "<model name='ground'><static>true</static><link name='l'><pose>" + pose +
         "</pose><collision name='c'><geometry><plane/></geometry>" + surface + "</collision></link></model>";
}

std::string body(const std::string& pose, const std::string& geometry, const std::string& surface = "",
                 const std::string& velocity = "") {
  return "<model name='body' xmlns:cotwin='urn:cotwin:scene:1'><pose>" + pose +
         "</pose><link name='l'><inertial auto='true'/>" + velocity + "<collision name='c'><geometry>" + geometry +
         "</geometry>" + surface + "</collision></link></model>";
}

std::string friction(const std::string& inside) { return "<surface><friction>" + inside + "</friction></surface>"; }

void run(World& world, double time, double h = 1e-3) {
  for (int k = 0; k < static_cast<int>(std::lround(time / h)); ++k) world.step(h);
}

TEST(SdfJoints, AScrewUnderGravityAcceleratesAsItsInertiaSays) {
  // m g = (m + I / p²) a along the axis, with the pitch p in m/rad; a right-handed screw that turns positively advances.
  constexpr double kMass = 2, kInertia = 0.003, kTurn = 0.1;
  for (const std::string& pitch : {"<screw_thread_pitch>" + number(kTurn) + "</screw_thread_pitch>",
                                   "<thread_pitch>" + std::to_string(-2 * M_PI / kTurn) + "</thread_pitch>"}) {
    World w(read("<model name='m'><link name='nut'>" + inertial(kMass, 0.002, 0.002, kInertia) +
                 "</link><joint name='j' type='screw'><parent>world</parent><child>nut</child><axis><xyz>0 0 1</xyz></axis>" +
                 pitch + "</joint></model>"),
            {});
    run(w, 1);
    const double p = kTurn / (2 * M_PI), a = kGravity * kMass / (kMass + kInertia / (p * p));
    EXPECT_NEAR(w.twists()[0][2], -a, 1e-5 * a);
    EXPECT_NEAR(w.twists()[0][5], -a / p, 1e-5 * a / p);
    EXPECT_NEAR(w.poses()[0].p.z(), p * w.q()[0], 1e-9);
    EXPECT_LT(w.largest_gap(), 1e-8);
  }
}

TEST(SdfJoints, AUniversalJointTurnsAtHookesRatio) {
  // tan θ₂ = cos β tan θ₁ for shafts at an angle β (up to the phase of the cross).
  constexpr double kBeta = 0.5;
  const std::string shafts = "<model name='m'><link name='in'>" + inertial(1, 1, 1, 1) +
                             "</link><link name='out'><pose>0 0 0 0 " + number(kBeta) + " 0</pose>" +
                             inertial(0.01, 1e-4, 1e-4, 1e-4) + "</link>";
  const std::string joints =
      "<joint name='a' type='revolute'><parent>world</parent><child>in</child><axis><xyz>0 0 1</xyz></axis></joint>"
      "<joint name='b' type='revolute'><parent>world</parent><child>out</child><axis><xyz>0 0 1</xyz></axis></joint>"
      "<joint name='u' type='universal'><parent>in</parent><child>out</child><axis><xyz expressed_in='in'>0 1 0</xyz></axis>"
      "<axis2><xyz expressed_in='out'>1 0 0</xyz></axis2></joint></model>";
  World w(read(shafts + joints), {});
  w.set_motor(0, 5, 1000);
  double worst = 0, least = 10, most = 0;
  for (int k = 0; k < 2000; ++k) {
    w.step(1e-3);
    const double in = w.q()[0], out = w.q()[1];
    // The arm on the input shaft is along y, so that its angle is measured from the normal of the plane of the shafts.
    worst = std::max(worst, std::abs(std::remainder(std::atan2(std::sin(out), std::cos(out) * std::cos(kBeta)) - in, M_PI)));
    if (k > 100) {
      least = std::min(least, w.dq()[1]);
      most = std::max(most, w.dq()[1]);
    }
  }
  EXPECT_LT(std::min(worst, 1.0), 1e-3);
  EXPECT_NEAR(most, 5 / std::cos(kBeta), 0.01);
  EXPECT_NEAR(least, 5 * std::cos(kBeta), 0.01);
}

/// Two wheels of 0.2 and 0.05 kg.m2 on a static carrier; the second turns about −z.
std::string two_wheels(const std::string& more, const std::string& of_second = "") {
  return "<model name='fixed'><static>true</static><link name='carrier'/></model><model name='a'><link name='l'>" +
         inertial(1, 0.2, 0.2, 0.2) + "</link></model><model name='b'><pose>1 0 0 0 0 0</pose><link name='l'>" +
         inertial(1, 0.05, 0.05, 0.05) +
         "</link></model><joint name='first' type='revolute'><parent>fixed::carrier</parent><child>a::l</child><axis><xyz>0 0 "
         "1</xyz>"
         "</axis></joint><joint name='second' type='revolute'><parent>fixed::carrier</parent><child>b::l</child><axis><xyz>0 0 "
         "-1</xyz>" +
         of_second + "</axis></joint>" + more;
}

// θ_2 = −ratio θ_1 about the gearbox's axes; a torque on the first wheel moves I_1 + ratio² I_2.
TEST(SdfJoints, AGearboxTurnsTheSecondWheelAgainstTheFirstByItsRatio) {
  const std::string gearbox =
      "<joint name='gears' type='gearbox'><parent>a::l</parent><child>b::l</child><gearbox_ratio>3</gearbox_ratio>"
      "<gearbox_reference_body>fixed::carrier</gearbox_reference_body><axis><xyz>0 0 1</xyz></axis><axis2><xyz>0 0 "
      "1</xyz></axis2>"
      "</joint>";
  World w(read(two_wheels(gearbox)), {});
  constexpr double kTorque = 2;
  w.set_motor(0, 1000, kTorque);
  run(w, 0.5);
  const double speed = kTorque * 0.5 / (0.2 + 3 * 3 * 0.05);
  EXPECT_NEAR(w.twists()[1][5], speed, 1e-6 * speed);
  EXPECT_NEAR(w.twists()[2][5], -3 * speed, 1e-6 * speed);
  EXPECT_NEAR(w.q()[1], 3 * w.q()[0], 1e-9);
}

TEST(SdfJoints, AMimicFollowsItsLeaderByMultiplierOffsetAndReference) {
  std::vector<std::string> warnings;
  const std::string mimic =
      "<mimic joint='first'><multiplier>-2.5</multiplier><reference>0.2</reference><offset>-0.5</offset></mimic>";
  World w(read(two_wheels("", mimic), nullptr, &warnings), {});
  EXPECT_TRUE(warnings.empty()) << warnings.front();
  constexpr double kTorque = 2;
  w.set_motor(0, 1000, kTorque);
  run(w, 0.5);
  const double speed = kTorque * 0.5 / (0.2 + 2.5 * 2.5 * 0.05);
  EXPECT_NEAR(w.dq()[0], speed, 1e-6 * speed);
  EXPECT_NEAR(w.q()[1], -2.5 * w.q()[0], 1e-9);
}

TEST(SdfJoints, ASpringSwingsAboutItsReferenceAndKeepsItsEnergy) {
  constexpr double kMass = 0.5, kStiffness = 50, kReference = 0.1;
  World w(
      read("<model name='m'><link name='l'>" + inertial(kMass, 0.01, 0.01, 0.01) +
           "</link><joint name='j' type='prismatic'><parent>world</parent><child>l</child><axis><xyz>1 0 0</xyz><dynamics>"
           "<spring_stiffness>50</spring_stiffness><spring_reference>0.1</spring_reference></dynamics></axis></joint></model>"),
      {});
  const double before = w.energy();
  EXPECT_NEAR(before, kStiffness * kReference * kReference / 2, 1e-12);
  constexpr int kPeriods = 20;
  const double period = 2 * M_PI * std::sqrt(kMass / kStiffness), h = period / 1000;
  run(w, kPeriods * period, h);
  EXPECT_NEAR(w.q()[0], 0, 1e-4 * kReference);  // back at the start
  EXPECT_NEAR(w.energy(), before, 1e-4 * before);
  run(w, period / 2, h);
  EXPECT_NEAR(w.q()[0], 2 * kReference, 1e-4 * kReference);
}

TEST(SdfFriction, OfTwoDirectionsTurnsTheSlipDownASlope) {
  // Associated law of the elliptic cone, |(x₁/μ₁, x₂/μ₂)| ≤ x_n: the force is −x_n (μ₁² s₁, μ₂² s₂) / √((μ₁ s₁)² + (μ₂ s₂)²) for
  // a slip s. The figures of a block that slips at 45° to both directions come from that equation in small steps.
  constexpr double kMu1 = 0.1, kMu2 = 0.4, kSlope = 0.6;
  const std::string surface = friction("<ode><mu>0.1</mu><mu2>0.4</mu2><fdir1>1 1 0</fdir1></ode>");
  for (const Method method : {Method::kTree, Method::kPgs, Method::kDantzig}) {
    Options options;
    options.method = method;
    options.iterations = 200;
    World w(read(ground(surface, "0 0 0 0 0.6 0") + body("0 0 0 0 0.6 0", "<box><size>0.2 0.2 0.0002</size></box>", surface)),
            options);
    const double h = 1e-3;
    Vector3d s = Vector3d::Zero();  // in the slope's frame turned by 45°
    const double push = kGravity * std::sin(kSlope) / std::sqrt(2), load = kGravity * std::cos(kSlope);
    const int kFine = 1000;
    for (int k = 0; k < 500 * kFine; ++k) {
      const double size = std::hypot(kMu1 * s.x(), kMu2 * s.y());
      const Vector3d drag = Vector3d(kMu1 * kMu1 * s.x(), kMu2 * kMu2 * s.y(), 0) / std::max(size, 1e-300);
      s += h / kFine * (Vector3d(push, -push, 0) - load * drag);
    }
    const Eigen::Matrix3d R = Eigen::AngleAxisd(kSlope, Vector3d::UnitY()).toRotationMatrix() *
                              Eigen::AngleAxisd(M_PI / 4, Vector3d::UnitZ()).toRotationMatrix();
    Vector3d before = w.twists()[1].head<3>();
    run(w, 0.5, h);
    const Vector3d slip = R.transpose() * (w.twists()[1].head<3>() - before);
    EXPECT_NEAR(slip.x(), s.x(), 0.01 * s.norm()) << static_cast<int>(method);
    EXPECT_NEAR(slip.y(), s.y(), 0.01 * s.norm()) << static_cast<int>(method);
  }
}

TEST(SdfFriction, TorsionalStopsASpinningBallInTheTimeOfItsMoment) {
  // M = 3π/16 c a m g; a ball on rigid ground has no other moment about the normal.
  constexpr double kRadius = 0.05, kSpin = 20, kCoefficient = 0.8, kPatch = 0.01;
  const std::string surface =
      friction("<ode><mu>0.5</mu></ode><torsional><coefficient>0.8</coefficient><patch_radius>0.01</patch_radius></torsional>");
  for (const Method method : {Method::kTree, Method::kPgs, Method::kDantzig}) {
    Options options;
    options.method = method;
    World w(read(ground(surface) + body("0 0 0.05 0 0 0", "<sphere><radius>0.05</radius></sphere>", surface,
                                        "<cotwin:velocity>0 0 0 0 0 20</cotwin:velocity>")),
            options);
    const double rate = 3 * M_PI / 16 * kCoefficient * kPatch * kGravity / (0.4 * kRadius * kRadius), stop = kSpin / rate;
    run(w, stop / 2);
    EXPECT_NEAR(w.twists()[1][5], kSpin - rate * std::round(1e3 * stop / 2) * 1e-3, 2e-3 * kSpin) << static_cast<int>(method);
    run(w, stop / 2 + 0.02);
    EXPECT_NEAR(w.twists()[1][5], 0, 1e-9);
  }
}

TEST(SdfShapes, AnEllipsoidRocksAtTheFrequencyOfItsCurvature) {
  // At rest on its flat side, with radius of curvature ρ = a² / c at the bottom: ω² = g (ρ − c) m / (I + m c²).
  constexpr double kA = 0.1, kC = 0.05;
  scene::Scene scene =
      read(ground(friction("<ode><mu>5</mu></ode>")) +
           body("0 0 0.05 0 0.01 0", "<ellipsoid><radii>0.1 0.15 0.05</radii></ellipsoid>", friction("<ode><mu>5</mu></ode>")));
  World w(scene, {});
  const double inertia = (kA * kA + kC * kC) / 5, rho = kA * kA / kC;
  const double period = 2 * M_PI * std::sqrt((inertia + kC * kC) / (kGravity * (rho - kC)));
  std::vector<double> crossings;
  double before = 0;
  const double h = 2e-4;
  for (int k = 1; crossings.size() < 5 && k < 100000; ++k) {
    w.step(h);
    const double tilt = w.poses()[1].R(0, 2);
    if (k > 1 && before < 0 && tilt >= 0) crossings.push_back(h * (k - tilt / (tilt - before)));
    before = tilt;
  }
  ASSERT_EQ(crossings.size(), 5u);
  EXPECT_NEAR((crossings.back() - crossings.front()) / 4, period, 0.005 * period);
  EXPECT_NEAR(w.poses()[1].p.x(), 0, 0.05);
}

TEST(SdfShapes, ABallTouchesAnEllipsoidWhereItsNormalSaysSo) {
  // The ball's centre is on the normal of a point of the ellipsoid, at its radius.
  const Vector3d radii(0.1, 0.2, 0.3);
  const Vector3d u = Vector3d(0.3, -0.5, 0.8).normalized(), p = radii.cwiseProduct(u), n = u.cwiseQuotient(radii).normalized();
  scene::Scene scene = read(
      "<model name='e'><static>true</static><link name='l'><collision name='c'><geometry><ellipsoid><radii>0.1 0.2 "
      "0.3</radii></ellipsoid></geometry></collision></link></model>" +
      body("0 0 5 0 0 0", "<sphere><radius>0.05</radius></sphere>"));
  collision::Detector detector(scene);
  for (const double gap : {0.01, -0.002}) {
    Pose X_WB;
    X_WB.p = p + (0.05 + gap) * n;
    const std::vector<Pose> poses{Pose{}, X_WB};
    detector.detect(poses, 0.1);
    ASSERT_EQ(detector.points().size(), 1u);
    EXPECT_NEAR(detector.points()[0].gap, gap, 1e-9);
    EXPECT_LT((detector.points()[0].n_W - n).norm(), 1e-7);
  }
}

// Meshes --------------------------------------------------------------------------------------------------------------------

/// A thick bowl as OBJ: inner and outer half spheres and the rim between them, open upwards; its centre is the origin.
std::string bowl(double inner, double outer, int around, int down) {
  std::string text;
  const auto vertex = [&](double radius, int i, int j) {
    const double side = M_PI / 2 * i / down, angle = 2 * M_PI * j / around;
    text += "v " + std::to_string(radius * std::cos(side) * std::cos(angle)) + " " +
            std::to_string(radius * std::cos(side) * std::sin(angle)) + " " + std::to_string(-radius * std::sin(side)) + "\n";
  };
  for (const double radius : {inner, outer}) {
    for (int i = 0; i < down; ++i) {
      for (int j = 0; j < around; ++j) vertex(radius, i, j);
    }
    text += "v 0 0 " + std::to_string(-radius) + "\n";
  }
  const int half = around * down + 1;
  const auto index = [&](int surface, int i, int j) {
    return 1 + surface * half + (i == down ? half - 1 : i * around + j % around);
  };
  const auto face = [&](std::vector<int> corners, bool turned) {
    if (turned) std::reverse(corners.begin(), corners.end());
    text += "f";
    for (const int c : corners) text += " " + std::to_string(c);
    text += "\n";
  };
  for (const int surface : {0, 1}) {
    for (int i = 0; i < down; ++i) {
      for (int j = 0; j < around; ++j) {
        std::vector<int> corners{index(surface, i, j), index(surface, i, j + 1), index(surface, i + 1, j + 1)};
        if (i + 1 < down) corners.push_back(index(surface, i + 1, j));
        face(corners, surface == 1);
      }
    }
  }
  for (int j = 0; j < around; ++j) face({index(0, 0, j), index(1, 0, j), index(1, 0, j + 1), index(0, 0, j + 1)}, false);
  return text;
}

std::string mesh_model(const std::string& file, bool is_static, const std::string& pose = "0 0 0 0 0 0") {
  return "<model name='mesh'><static>" + std::string(is_static ? "true" : "false") + "</static><pose>" + pose +
         "</pose><link name='l'><inertial auto='true'/><collision name='c'><geometry><mesh><uri>" + file +
         "</uri></mesh></geometry></collision></link></model>";
}

TEST(Meshes, ABallRestsInABowlNotOnItsLid) {
  const TemporaryFolder folder("meshes");
  constexpr double kInner = 0.2, kBall = 0.05;
  folder.write("bowl.obj", bowl(kInner, 0.25, 48, 12));
  std::vector<std::string> warnings;
  scene::Scene scene = read(mesh_model("bowl.obj", true) + body("0.05 0.02 0 0 0 0", "<sphere><radius>0.05</radius></sphere>"),
                            &folder, &warnings);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_NE(warnings[0].find("bowl.obj: concave (its hull has"), std::string::npos) << warnings[0];
  Options options;
  options.contacts = 512;
  World w(scene, options);
  double deepest = 0;
  for (int k = 0; k < 4000; ++k) {
    w.step(1e-3);
    for (const ContactPoint& point : w.contacts()) deepest = std::max(deepest, -point.gap);
    ASSERT_LT(w.poses()[1].p.norm(), kInner) << k;  // in the bowl
  }
  EXPECT_LT(deepest, 1e-3);
  EXPECT_LE(w.poses()[1].p.norm(), kInner - kBall + 1e-4);
}

TEST(Meshes, ABallOnTheBottomOfABowlRestsAtTheAnalyticPlace) {
  const TemporaryFolder folder("meshes");
  folder.write("bowl.obj", bowl(0.2, 0.25, 48, 12));
  // The lowest faces meet in the pole; a ball on the axis touches them all at the distance of their planes from the centre.
  scene::Scene scene =
      read(mesh_model("bowl.obj", true) + body("0 0 -0.14 0 0 0", "<sphere><radius>0.05</radius></sphere>"), &folder);
  World w(scene, {});
  run(w, 1);
  // Plane through the pole (0, 0, −r) and two neighbours of the next ring.
  const double side = M_PI / 2 * 11 / 12, step = 2 * M_PI / 48;
  const Vector3d a(0, 0, -0.2), b(0.2 * std::cos(side), 0, -0.2 * std::sin(side)),
      c(0.2 * std::cos(side) * std::cos(step), 0.2 * std::cos(side) * std::sin(step), -0.2 * std::sin(side));
  const Vector3d n = (b - a).cross(c - a).normalized();
  const double height = a.z() + 0.05 / std::abs(n.z());
  EXPECT_NEAR(w.poses()[1].p.z(), height, 2e-5);
  EXPECT_LT(w.twists()[1].head<3>().norm(), 1e-2);  // 48 planes meet there: sweeps leave a slow motion between them
}

TEST(Meshes, AMovingBowlHasTheInertiaOfItsSolidAndStandsOverABall) {
  const TemporaryFolder folder("meshes");
  folder.write("bowl.obj", bowl(0.2, 0.25, 32, 8));
  scene::Scene scene = read(ground() + mesh_model("bowl.obj", false, "0 0 0.001 3.14159265358979 0 0") +
                                body("0.02 0 0.06 0 0 0", "<sphere><radius>0.05</radius></sphere>"),
                            &folder);
  const double volume = 2. / 3 * M_PI * (std::pow(0.25, 3) - std::pow(0.2, 3));
  EXPECT_NEAR(scene.bodies[1].inertia.mass, 1000 * volume, 0.03 * 1000 * volume);  // polyhedra have less volume
  Options options;
  options.contacts = 1024;
  World w(scene, options);
  run(w, 1);
  EXPECT_NEAR(w.poses()[1].p.z(), 0, 1e-4);     // stands on its rim
  EXPECT_NEAR(w.poses()[2].p.z(), 0.05, 1e-4);  // the ball under it rests on the ground
}

TEST(Meshes, OfAnyKindAreUsedOrRefusedWithAReason) {
  const TemporaryFolder folder("meshes");
  const std::string vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n", tetrahedron = "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
  folder.write("convex.obj", vertices + tetrahedron);
  folder.write("inverted.obj", vertices + "f 1 2 3\nf 1 4 2\nf 2 4 3\nf 3 4 1\n");
  folder.write("open.obj", vertices + "f 1 3 2\nf 1 2 4\nf 2 3 4\n");
  folder.write("double.obj", vertices + tetrahedron + "f 1 3 2\n");
  folder.write("empty.obj", "");
  folder.write("index.obj", vertices + "f 1 2 9\n");
  const auto remark = [&](const std::string& file, bool is_static) -> std::string {
    std::vector<std::string> warnings;
    try {
      read(mesh_model(file, is_static), &folder, &warnings);
    } catch (const std::exception& e) {
      return e.what();
    }
    return warnings.empty() ? "" : warnings[0];
  };
  const auto has = [](const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; };
  EXPECT_EQ(remark("convex.obj", false), "");
  EXPECT_TRUE(has(remark("inverted.obj", false), "face inwards; they are turned")) << remark("inverted.obj", false);
  EXPECT_TRUE(has(remark("open.obj", false), "open, so that it has no volume: its convex hull is used"));
  EXPECT_TRUE(has(remark("open.obj", true), "open: its 3 triangles are a surface"));
  EXPECT_TRUE(has(remark("double.obj", true), "not manifold"));
  EXPECT_TRUE(has(remark("empty.obj", true), "0 points, expected at least 4")) << remark("empty.obj", true);
  EXPECT_TRUE(has(remark("index.obj", true), "index.obj:5: '9', expected the number of one of the 4 vertices"));
  folder.write("huge.obj", bowl(0.2, 0.25, 80, 20));
  EXPECT_TRUE(has(remark("huge.obj", false), "on a moving body, expected 2000 at most: simplify it"))
      << remark("huge.obj", false);
}

}  // namespace
}  // namespace cotwin::contact_world::sdf_test
