// The contact world as a unit: its ports, and both kinds of link (inside, outside), together with the drive train.
#include "components/contact_world/contact_world.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "components/unit/snapshot.h"
#include "components/unit/unit_table.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/robot_links.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/unit_subject.h"

namespace cotwin::unit_test {
namespace {

using cotwin::testing::error_of;
using cotwin::testing::TemporaryFolder;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;
using Values = std::vector<double>;

const std::string kData = places::source() + "/tests/components/data/";
const std::string kPusher = kData + "pusher.urdf";
const std::string kFloor = kData + "floor.sdf";
constexpr double kGravity = 9.81;

using Subject = cotwin::testing::UnitSubject;

void copy(Subject& from, const std::string& out, Subject& to, const std::string& in) {
  std::copy(from[out].begin(), from[out].end(), to[in].begin());
}

/// A robot whose motors hold a posture, τ_m = τ_0 + k (θ_d − θ) − d θ̇, in a world, with either kind of link.
class Held {
 public:
  Held(const std::string& link, const std::string& world, const Values& q, const std::string& robot = kPusher)
      : outside_(link == "outside"),
        world_("unit:contact_world?link_side=" + link + "&robot=" + robot + world),
        q_(q),
        drive_("unit:drive_train?link_side=" + link + "&robot=" + robot) {
    if (robot != "lwr4") drive_.fill("K", 1e4).fill("B", 0.5).fill("D", 20);
    copy(drive_, "K", world_, "K");
    copy(drive_, "D", world_, "D");
    if (outside_) {
      world_.set("q0", q);
      drive_.set("link_order", 1);
      drive_.set("q", q);
    } else {
      drive_.set("q0", q);
      world_.set("q", q);
    }
  }
  void initialise(const Values& tau_0) {
    tau_0_ = tau_0;
    drive_.set("tau_m", tau_0);
    drive_.initialise();
    theta_d_ = q_;
    for (std::size_t i = 0; i < q_.size(); ++i) theta_d_[i] += tau_0[i] / drive_["K"][i];
    copy(drive_, "tau_J", world_, "tau_J");
    world_.initialise();
  }
  /// One tick: the world first, then the drive.
  void step(double h, double stiffness = 300, double damping = 60) {
    for (std::size_t i = 0; i < tau_0_.size(); ++i) {
      drive_["tau_m"][i] = tau_0_[i] + stiffness * (theta_d_[i] - drive_["theta"][i]) - damping * drive_["dtheta"][i];
    }
    copy(drive_, "tau_J", world_, "tau_J");
    copy(drive_, "dtheta", world_, "dtheta");
    if (outside_) {
      world_.step(h);
      copy(world_, "q", drive_, "q");
      copy(world_, "dq", drive_, "dq");
    } else {
      copy(drive_, "q", world_, "q");
      copy(drive_, "dq", world_, "dq");
      world_.step(h);
      copy(world_, "tau_e", drive_, "tau_e");
    }
    drive_.step(h);
  }
  Subject& world() { return world_; }
  Subject& drive() { return drive_; }
  Values& theta_d() { return theta_d_; }

 private:
  bool outside_;
  Subject world_;
  Values q_;
  Subject drive_;
  Values tau_0_, theta_d_;
};

TEST(ContactWorld, NamesItsVariablesAfterTheSceneAndTheRobots) {
  Subject world("unit:contact_world?scene=" + kFloor + "&robots=left:" + kPusher + ",right:" + kPusher);
  for (const char* name : {"left.q", "right.tau_e", "cube.p", "cube.f", "floor.f_c", "contacts"}) {
    EXPECT_NE(world.variables().find(name), nullptr) << name;
  }
  EXPECT_EQ(world.variables().find("floor.p"), nullptr) << "what never moves needs no output for its place";
}

TEST(ContactWorld, ACubeStandsOnTheFloorWithItsWeight) {
  Subject world("unit:contact_world?scene=" + kFloor);
  world.initialise();
  for (int i = 0; i < 500; ++i) world.step(1e-3);
  EXPECT_NEAR(world["cube.p"][2], 0.05, 2e-5);
  EXPECT_NEAR(world["cube.f_c"][2], 2 * kGravity, 1e-6);
  EXPECT_NEAR(world["floor.f_c"][2], -2 * kGravity, 1e-6);
  EXPECT_EQ(world.integer("contacts"), 4);
}

TEST(ContactWorld, BodiesFallAlongTheGravityThatIsSet) {
  Subject world("unit:contact_world?scene=" + kFloor);
  world.set("gravity", {1, -2, 3}).initialise();  // off the floor
  for (int i = 0; i < 100; ++i) world.step(1e-3);
  EXPECT_NEAR(world["cube.v"][0], 0.1, 1e-12);
  EXPECT_NEAR(world["cube.v"][1], -0.2, 1e-12);
  EXPECT_NEAR(world["cube.v"][2], 0.3, 1e-12);
}

TEST(ContactWorld, ACubeThatIsPulledSticksBelowTheConeAndSlidesAboveItAsCoulombSays) {
  for (const double scale : {1.0, 0.4, 2.0}) {
    Subject world("unit:contact_world?scene=" + kFloor);
    world.set("friction_scale", {scale}).initialise();
    const double limit = scale * 0.25 * 2 * kGravity;
    world.set("cube.f", {0.9 * limit, 0, 0});
    for (int i = 0; i < 1000; ++i) world.step(1e-3);
    EXPECT_NEAR(world["cube.p"][0], 0, 1e-6) << scale;
    world.set("cube.f", {1.5 * limit, 0, 0});
    for (int i = 0; i < 1000; ++i) world.step(1e-3);
    EXPECT_NEAR(world["cube.v"][0], 0.5 * limit / 2, 1e-3 * 0.5 * limit / 2) << scale;
  }
}

TEST(ContactWorld, ARobotWithoutContactHasNoExternalTorque) {
  Held robot("inside", "&scene=" + kFloor, {0.3, 0.2});
  robot.initialise({0, 0});
  for (int i = 0; i < 20; ++i) robot.step(1e-3);
  EXPECT_THAT(robot.world().values("tau_e"), ElementsAre(0, 0));
  // The world predicts the step that (2a) makes in the drive train afterwards.
  EXPECT_GT(std::abs(robot.drive()["dq"][0]), 1e-2);
  for (std::size_t j = 0; j < 2; ++j) EXPECT_NEAR(robot.world()["q_link"][j], robot.drive()["q"][j], 2e-7);
}

// A hand at the arm: (2a) with its torque, too, with either kind of link.
TEST(ContactWorld, OtherExternalTorquesMoveTheLinksAndAreReported) {
  std::vector<Values> effect;
  for (const std::string link : {"inside", "outside"}) {
    const auto moved = [&](const Values& other) {
      Held robot(link, "&scene=" + kFloor, {0.3, 0.2});
      robot.initialise({0, 0});
      robot.world().set("tau_other", other);
      for (int i = 0; i < 100; ++i) robot.step(1e-3);
      EXPECT_EQ(robot.world().values("tau_e"), other);
      for (std::size_t j = 0; j < 2 && link == "inside"; ++j)
        EXPECT_NEAR(robot.world()["q_link"][j], robot.drive()["q"][j], 2e-7) << "the prediction has the torque, too";
      return robot.world().values("q_link");
    };
    const Values with = moved({40, -6}), without = moved({0, 0});
    effect.push_back({with[0] - without[0], with[1] - without[1]});
  }
  EXPECT_GT(effect[0][0], 0.04);
  for (std::size_t j = 0; j < 2; ++j) EXPECT_NEAR(effect[0][j], effect[1][j], 2e-4) << "half a percent";
}

// The floor carries what a hand presses down: the contact's torque is what is left of τ_e.
TEST(ContactWorld, AHandPressesALinkOnTheFloor) {
  for (const std::string link : {"inside", "outside"}) {
    Held robot(link, "&scene=" + kData + "ice.sdf", {-0.4, -0.6});
    robot.initialise({5, 2});
    Subject& w = robot.world();
    for (int i = 0; i < 4000; ++i) robot.step(1e-3);
    const double before = w["f_c"][2];
    // The torque of 30 N downwards at the ball's centre, whose lever hardly changes.
    const double q1 = w["q_link"][0], q2 = w["q_link"][1];
    w.set("tau_other", {-30 * (0.4 * std::cos(q1) + 0.35 * std::cos(q1 + q2)), -30 * 0.35 * std::cos(q1 + q2)});
    for (int i = 0; i < 4000; ++i) robot.step(1e-3);
    EXPECT_NEAR(w["f_c"][2] - before, 30, 0.1) << link;
    const double x2 = 0.35 * std::cos(w["q_link"][0] + w["q_link"][1]);
    EXPECT_NEAR(w["tau_e"][1], x2 * (w["f_c"][2] - 30), 1e-2) << link;
  }
}

TEST(ContactWorld, OtherExternalTorquesMovePassiveJointsAndFollowTheirRate) {
  const auto speed = [](const std::string& query, const std::string& name) {
    Subject world("unit:contact_world?link_side=outside&scene=none&robot=" + kPusher + query);
    world.set("q0", {0.3, -0.5}).initialise();
    world.set(name, {0, 2});
    world.step(1e-3);
    return world["dq"][1];
  };
  EXPECT_NEAR(speed("&passive=elbow", "tau_other"), speed("", "tau_J"), 1e-12);
  Subject ramp("unit:contact_world?link_side=outside&scene=none&robot=" + kPusher);
  ramp.initialise();
  ramp.variables().at("tau_other").rate[1] = 100;
  ramp.set("tau_other", {0, 1}).step(1e-2);
  EXPECT_NEAR(ramp["tau_e"][1], 1.5, 1e-12) << "the mean over the step";
}

// At rest on the floor, (2a): g(q) = τ_J + τ_e, with τ_e = Jᵀ (0, 0, F).
TEST(ContactWorld, ExternalTorquesAreTheContactForceTimesItsLevers) {
  Held robot("inside", "&scene=" + kFloor, {-0.4, -0.6});
  robot.initialise({5, 2});
  for (int i = 0; i < 3000; ++i) robot.step(1e-3);
  Subject& w = robot.world();
  const double q1 = w["q_link"][0], q2 = w["q_link"][1], F = w["f_c"][2], T = w["f_c"][0];
  ASSERT_GT(F, 5) << "the test needs it to lie on the floor";
  // The lowest point of the ball; lever arms about the two axes, which point along −y.
  const double x = 0.4 * std::cos(q1) + 0.35 * std::cos(q1 + q2), x2 = 0.35 * std::cos(q1 + q2);
  const double z2 = -0.5 - 0.4 * std::sin(q1);
  EXPECT_NEAR(w["tau_e"][0], x * F + 0.5 * T, 1e-3 * F);
  EXPECT_NEAR(w["tau_e"][1], x2 * F - z2 * T, 1e-3 * F);
}

// Perpendicular to the plane in which the arm moves there is no motion for friction to stop, so rounding must not create a
// force.
TEST(ContactWorld, FrictionOnAPlanarArmActsOnlyWithinItsPlane) {
  for (const std::string link : {"inside", "outside"}) {
    for (const std::string method : {"tree", "pgs", "dantzig"}) {
      Held robot(link, "&scene=" + kFloor + "&method=" + method, {-0.4, -0.6});
      robot.initialise({5, 2});
      double across = 0;
      for (int i = 0; i < 1500; ++i) {
        robot.step(1e-3);
        across = std::max(across, std::abs(robot.world()["f_c"][1]));
      }
      EXPECT_GT(robot.world()["f_c"][2], 5) << link << ' ' << method;
      EXPECT_LT(across, 0.3) << link << ' ' << method
                             << ", N: about one degree of the direction of friction, in the step in which it sticks";
    }
  }
}

TEST(ContactWorld, BothWaysToHoldARobotGiveTheSameSteadyContactForce) {
  const Values q = {-0.4, -0.6};
  // Without friction, because with friction the place of rest depends on the path.
  Held inside("inside", "&scene=" + kData + "ice.sdf", q), outside("outside", "&scene=" + kData + "ice.sdf", q);
  for (Held* robot : {&inside, &outside}) {
    robot->initialise({5, 2});
    for (int i = 0; i < 4000; ++i) robot->step(1e-3);
  }
  // 13 µm of penetration at 10⁶ N/m with a motor stiffness of about 10³ N/m at the tip: 1 ‰ of the force
  const double F = inside.world()["f_c"][2];
  ASSERT_GT(F, 5);
  EXPECT_NEAR(outside.world()["f_c"][2], F, 2e-3 * F);
  for (std::size_t j = 0; j < 2; ++j) {
    EXPECT_NEAR(inside.world()["q_link"][j], outside.world()["q_link"][j], 1e-4);
    EXPECT_NEAR(inside.drive()["tau_J"][j], outside.drive()["tau_J"][j], 2e-3 * F);
    EXPECT_NEAR(inside.world()["tau_e"][j], outside.world()["tau_e"][j], 2e-3 * F);
  }
}

// A soft wall gives the force of its spring, with either kind of link and any mass; both kinds give the same.
TEST(ContactWorld, ASoftWallPushesWithItsSpring) {
  const Values q = {-0.4, -0.6};
  std::vector<double> force;
  for (const std::string link : {"inside", "outside"}) {
    Held robot(link, "&scene=" + kData + "sponge.sdf", q);
    robot.initialise({5, 2});
    for (int i = 0; i < 6000; ++i) robot.step(1e-3);
    Subject& w = robot.world();
    const double q1 = w["q_link"][0], q2 = w["q_link"][1];
    const double depth = 0.02 - (0.5 + 0.4 * std::sin(q1) + 0.35 * std::sin(q1 + q2));  // of the ball below z = 0
    force.push_back(w["f_c"][2]);
    EXPECT_NEAR(force.back(), 1e4 * depth, 2e-3 * force.back()) << link;
  }
  EXPECT_GT(force[0], 5);
  EXPECT_NEAR(force[0], force[1], 2e-3 * force[1]);
}

TEST(ContactWorld, NotesContactsThatItLeavesUnsolved) {
  std::string sdf =
      "<sdf version='1.10'><world name='w'><model name='ground'><static>true</static><link name='l'><collision name='c'>"
      "<geometry><plane/></geometry></collision></link></model>";
  for (int k = 0; k < 60; ++k) {
    sdf +=
        "<model name='cube_" + std::to_string(k) + "'><pose>0 0 " + std::to_string(0.05 + 0.1 * k) +
        " 0.01 0 0</pose><link name='l'><inertial auto='true'/><collision name='c'><geometry><box><size>0.1 0.1 "
        "0.1</size></box>"
        "</geometry><surface><friction><ode><mu>0.3</mu><mu2>0.3</mu2></ode></friction></surface></collision></link></model>";
  }
  const TemporaryFolder folder("tower");
  folder.write("tower.sdf", sdf + "</world></sdf>");
  Subject tower("unit:contact_world?scene=" + (folder.path() / "tower.sdf").string() + "&contacts=300");
  const auto notes = [&] {
    std::vector<std::string> all;
    tower.unit().append_notes(all);
    return all;
  };
  tower.initialise();
  for (int i = 0; i < 40; ++i) tower.step(1e-3);
  EXPECT_THAT(notes(), ElementsAre()) << "less than 50 ms";
  for (int i = 0; i < 40; ++i) tower.step(1e-3);
  EXPECT_THAT(notes(), ElementsAre(StartsWith("contacts were left unsolved for 0.0")));
  tower.initialise();
  EXPECT_THAT(notes(), ElementsAre());
}

// A stick that turns about its stiff axis by 2 rad a step.
TEST(ContactWorld, NotesTheBodyThatGainsEnergy) {
  const TemporaryFolder folder("stick");
  folder.write(
      "stick.sdf",
      "<sdf version='1.10' xmlns:cotwin='urn:cotwin:scene:1'><world name='w'><gravity>0 0 0</gravity><model name='stick'>"
      "<link name='l'><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>0.99</iyy><izz>0.01</izz></inertia></inertial>"
      "<cotwin:velocity>0 0 0 0.01 100 3</cotwin:velocity></link></model></world></sdf>");
  Subject stick("unit:contact_world?scene=" + (folder.path() / "stick.sdf").string());
  stick.fill("energy_limit", 0).initialise();
  const double before = stick["energy"][0];
  double least = before, most = 0;
  for (int i = 0; i < 50; ++i) {
    stick.step(0.02);
    least = std::min(least, stick["energy"][0]);
    most = std::max(most, stick["energy"][0] - least);
  }
  std::vector<std::string> notes;
  stick.unit().append_notes(notes);
  const std::string joules = cotwin::text::to_text(most, 3) + " J",
                    percent = cotwin::text::to_text(100 * most / before, 3) + " %";
  EXPECT_THAT(notes, ElementsAre(AllOf(StartsWith("energy has grown without work by " + joules), HasSubstr("body 'stick'"),
                                       HasSubstr(percent))));
}

// Steps that are taken back, such as those that measure a loop, are not part of the run.
TEST(ContactWorld, NotesOfStiffSoftContactsForgetStepsThatAreTakenBack) {
  const TemporaryFolder folder("swing");
  folder.write(
      "ball.sdf",
      "<sdf version='1.10'><world name='w'><model name='ball'><pose>0 0 0.05 0 0 0</pose><link name='l'><inertial "
      "auto='true'/><collision name='c'><density>1000</density><geometry><sphere><radius>0.02</radius></sphere></geometry>"
      "</collision></link></model><model name='ground'><static>true</static><link name='l'><collision name='c'><geometry>"
      "<plane/></geometry><surface><contact><ode><kp>1e6</kp></ode></contact></surface></collision></link></model></world></"
      "sdf>");
  Subject world("unit:contact_world?scene=" + (folder.path() / "ball.sdf").string());
  world.initialise();
  const auto notes = [&] {
    std::vector<std::string> all;
    world.unit().append_notes(all);
    return all;
  };
  Snapshot before;
  before.take(world.variables(), world.unit());
  for (int i = 0; i < 200; ++i) world.step(1e-3);
  EXPECT_THAT(notes(), ElementsAre(HasSubstr("times 1/ω of the stiffest soft contact")));
  before.restore(world.variables(), world.unit());
  EXPECT_THAT(notes(), ElementsAre());
}

TEST(ContactWorld, RefusesARobotThatStartsBeyondItsLimits) {
  const std::string source = "unit:contact_world?scene=none&robot=" + kPusher;
  const auto refusal = [&](const std::vector<double>& q0) {
    return error_of([&] {
      Subject outside(source + "&link_side=outside");
      outside.set("q0", q0).initialise();
    });
  };
  EXPECT_EQ(refusal({20, -20}), "");
  EXPECT_EQ(refusal({20.5, 0}),
            "contact_world.q0[1]: joint shoulder starts at 20.5 rad, expected -20 to 20 rad; a value in degrees?");
  EXPECT_THAT(refusal({0, -1e300}),
              HasSubstr("contact_world.q0[2]: joint elbow starts at -1e+300 rad, expected -20 to 20 rad"));
  Subject inside(source + "&link_side=inside");  // the limits are the drive train's
  inside.set("q", {20.5, -20.25}).initialise();
}

// SDF has no position at the start: it is 0, also where the limits exclude it.
TEST(ContactWorld, NotesJointsOfTheSceneThatStartBeyondTheirLimits) {
  const TemporaryFolder folder("contact_world");
  folder.write(
      "s.sdf",
      "<sdf version='1.10'><world name='w'><model name='m'><link name='a'><inertial><mass>1</mass><inertia><ixx>1</ixx>"
      "<iyy>1</iyy><izz>1</izz></inertia></inertial></link><joint name='j' type='prismatic'><parent>world</parent>"
      "<child>a</child><axis><xyz>1 0 0</xyz><limit><lower>0.5</lower><upper>1</upper></limit></axis></joint></model>"
      "</world></sdf>");
  Subject world("unit:contact_world?scene=" + (folder.path() / "s.sdf").string());
  world.initialise();
  std::vector<std::string> notes;
  world.unit().append_notes(notes);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_THAT(notes[0], HasSubstr("starts at 0 m, beyond its lower limit 0.5 m: it is brought back slowly"));
}

TEST(ContactWorld, CountsTheTurnsOfAJointFromItsStart) {
  Subject world("unit:contact_world?link_side=outside&robot=" + kPusher);
  world.set("q0", {4, -7}).set("gravity", {0, 0, 0}).initialise();
  for (int i = 0; i < 20; ++i) world.step(1e-3);
  EXPECT_NEAR(world["q"][0], 4, 1e-9);
  EXPECT_NEAR(world["q"][1], -7, 1e-9);
}

// A link that is moved without a torque, as by a recording, presses on a soft body with the force of its penetration.
TEST(ContactWorld, ALinkWithPrescribedMotionPressesWithTheForceOfASoftContact) {
  Subject world("unit:contact_world?actuation=prescribed&scene=" + kData + "sponge.sdf&robot=" + kPusher);
  const double q1 = -0.4;
  const auto elbow = [&](double depth) { return -std::asin((0.48 + depth + 0.4 * std::sin(q1)) / 0.35) - q1; };
  world.set("q", {q1, elbow(-1e-3)}).initialise();
  const double h = 1e-3, speed = 2e-3;  // m/s
  double depth = -1e-3;
  for (int i = 0; i < 3000; ++i) {
    const double before = elbow(depth);
    if (depth < 2e-3) depth += speed * h;
    world.set("q", {q1, elbow(depth)});
    world.set("dq", {0, (elbow(depth) - before) / h});
    world.step(h);
  }
  EXPECT_NEAR(world["f_c"][2], 1e4 * depth, 1e-3 * 1e4 * depth);
  EXPECT_NEAR(world["tau_e"][1], 0.35 * std::cos(q1 + elbow(depth)) * world["f_c"][2], 1e-6);
}

/// A recording of q1 without torques, with constant acceleration, at the ends of the given steps: largest error of the world's
/// predicted q̇ after the second step.
double worst_forecast(const Values& steps) {
  Subject world("unit:contact_world?actuation=prescribed&scene=none&robot=" + kPusher);
  world.set("q", {0.3, -0.5}).initialise();
  const double acceleration = 5;
  double t = 0, worst = 0;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    world.set("q", {0.3 + acceleration / 2 * t * t, -0.5}).set("dq", {acceleration * t, 0});
    world.step(steps[i]);
    t += steps[i];
    if (i > 1) worst = std::max(worst, std::abs(world["dq_link"][0] - acceleration * t));
  }
  return worst;
}

TEST(ContactWorld, ARecordingGoesOnWithItsAccelerationWhateverTheSteps) {
  const double h = 1e-3;
  EXPECT_LT(worst_forecast(Values(20, h)), 1e-5) << "5e-3 rad/s a step";
  Values steps(20, h);
  steps[8] = h / 10;
  EXPECT_LT(worst_forecast(steps), 1e-5) << "a shortened step";
}

// A setting decides what moves the links: a torque that passes through zero is a normal torque.
TEST(ContactWorld, ATorqueOfExactlyZeroIsATorque) {
  const auto forecast = [](double tau_J) {
    Subject world("unit:contact_world?link_side=inside&scene=none&robot=" + kPusher);
    world.set("q", {0.3, -0.5}).set("K", {0, 0}).initialise();
    world.set("tau_J", {tau_J, tau_J});
    world.step(1e-3);
    world.step(1e-3);
    return Values{world["dq_link"][0], world["dq_link"][1]};
  };
  const Values none = forecast(0), hardly_any = forecast(1e-12);
  for (std::size_t i = 0; i < 2; ++i) EXPECT_NEAR(none[i], hardly_any[i], 1e-12) << i;
  EXPECT_GT(std::abs(none[0]), 1e-3);  // only gravity moves it
}

TEST(ContactWorld, PrescribedLinksHaveNoTorquePorts) {
  Subject world("unit:contact_world?actuation=prescribed&scene=none&robot=" + kPusher);
  for (const char* name : {"tau_J", "dtheta", "K", "D", "B", "tau_other"})
    EXPECT_EQ(world.variables().find(name), nullptr) << name;
}

TEST(ContactWorld, TheLwrFloatsFreelyAndKeepsItsMomentum) {
  // No gravity, no torque: the centre of mass of base and links moves on a straight line at constant speed while the arm
  // swings.
  Subject world("unit:contact_world?link_side=outside&base=floating&scene=none&robot=lwr4");
  world.set("gravity", {0, 0, 0}).fill("dq0", 1).initialise();
  const Values start(world["base_p"].begin(), world["base_p"].end());
  const double energy = world["energy"][0];
  for (int i = 0; i < 500; ++i) world.step(1e-3);
  double moved = 0;
  for (std::size_t i = 0; i < 3; ++i) moved += std::abs(world["base_p"][i] - start[i]);
  EXPECT_GT(moved, 1e-2);  // 2 kg under 16 kg of arm
  EXPECT_NEAR(world["energy"][0], energy, 1e-3 * energy);
}

// A motor behind a rigid gear adds inertia to the link, (2a) + (2b): an impact without restitution does not bounce, and free
// motion is predicted with the motors' share of τ_J. Without knowledge of the motors the world would throw the link back.
TEST(ContactWorld, LinksBehindRigidGearsArePredictedWithTheirMotors) {
  for (const double B : {0.5, 0.0}) {
    Subject world("unit:contact_world?link_side=inside&scene=" + kData + "ice.sdf&robot=" + kPusher);
    Subject drive("unit:drive_train?link_side=inside&transmission=rigid&robot=" + kPusher);
    drive.fill("B", 0.5).set("q0", {-0.4, -0.55});
    world.fill("B", B).set("q", {-0.4, -0.55});
    drive.initialise();
    copy(drive, "tau_J", world, "tau_J");
    world.initialise();
    double free = 0, lowest = 1, back = 0;  // largest error of q̇, rad/s; distance that the ball bounces, m
    bool struck = false;
    for (int i = 0; i < 500; ++i) {
      for (const char* name : {"tau_J", "dtheta", "q", "dq"}) copy(drive, name, world, name);
      world.step(1e-3);
      copy(world, "tau_e", drive, "tau_e");
      drive.step(1e-3);
      struck = struck || world["f_c"][2] > 0;
      for (std::size_t j = 0; j < 2; ++j) {
        if (!struck && i > 1) free = std::max(free, std::abs(world["dq_link"][j] - drive["dq"][j]));
      }
      const double q1 = drive["q"][0], q2 = drive["q"][1];
      lowest = std::min(lowest, 0.5 + 0.4 * std::sin(q1) + 0.35 * std::sin(q1 + q2));
      if (struck) back = std::max(back, 0.5 + 0.4 * std::sin(q1) + 0.35 * std::sin(q1 + q2) - lowest);
    }
    EXPECT_TRUE(struck);
    if (B > 0) {
      EXPECT_LT(back, 1e-6);
      EXPECT_LT(free, 1e-5);
    } else {
      EXPECT_GT(back, 5e-5);
      EXPECT_GT(free, 2e-5);
    }
  }
}

// Position and heading of a base have no influence on gravity and a floor. Without friction, which keeps rounding errors of an
// impact.
TEST(ContactWorld, ARobotWhoseBaseIsTurnedPressesTheSameWay) {
  const double angle = 2;
  for (const std::string link : {"inside", "outside"}) {
    Held straight(link, "&scene=" + kData + "ice.sdf", {-0.4, -0.6}), turned(link, "&scene=" + kData + "ice.sdf", {-0.4, -0.6});
    turned.world().set("base_quat0", {std::cos(angle / 2), 0, 0, std::sin(angle / 2)}).set("base_p0", {-0.7, -0.3, 0});
    for (Held* robot : {&straight, &turned}) robot->initialise({5, 2});
    for (int i = 0; i < 1500; ++i) {
      for (Held* robot : {&straight, &turned}) robot->step(1e-3);
    }
    const auto f = straight.world()["f_c"], g = turned.world()["f_c"];
    EXPECT_GT(f[2], 5) << link;
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(g[k], f[k], 1e-6) << link;
    // The ball touches the floor below its centre, which is 0.4 cos q1 + 0.35 cos (q1 + q2) from the base, in its heading.
    const double q1 = turned.world()["q_link"][0], q2 = turned.world()["q_link"][1];
    const double reach = 0.4 * std::cos(q1) + 0.35 * std::cos(q1 + q2);
    EXPECT_NEAR(turned.world()["contact_p"][0], -0.7 + reach * std::cos(angle), 1e-6) << link;
    EXPECT_NEAR(turned.world()["contact_p"][1], -0.3 + reach * std::sin(angle), 1e-6) << link;
    for (std::size_t j = 0; j < 2; ++j) EXPECT_NEAR(turned.world()["tau_e"][j], straight.world()["tau_e"][j], 1e-6) << link;
  }
}

// (2a) of a gantry at rest: τ_e is the contact force along its axes, and F = m g − τ_J along z.
TEST(ContactWorld, APrismaticJointFeelsTheForceAlongItsAxis) {
  for (const std::string link : {"inside", "outside"}) {
    Held gantry(link, "&scene=" + kFloor, {0.1, -0.478}, kData + "gantry.urdf");
    gantry.initialise({0, 4});
    for (int i = 0; i < 3000; ++i) gantry.step(1e-3);
    Subject& w = gantry.world();
    EXPECT_NEAR(w["f_c"][2], 1.5 * kGravity - gantry.drive()["tau_J"][1], 1e-3) << link;
    EXPECT_GT(w["f_c"][2], 5) << link;
    EXPECT_NEAR(w["tau_e"][1], w["f_c"][2], 1e-9) << link;
    EXPECT_NEAR(w["tau_e"][0], w["f_c"][0], 1e-9) << link;
    EXPECT_NEAR(w["q_link"][1], -0.48, 1e-5) << link;
    EXPECT_LT(std::abs(w["dq_link"][1]), 1e-6) << link;
  }
}

/// Two robots with motors as in Held, in one world.
class Pair {
 public:
  Pair(const std::string& link, const std::string& world)
      : outside_(link == "outside"),
        world_("unit:contact_world?link_side=" + link + "&robots=left:" + kPusher + ",right:" + kPusher + world) {
    for (int i = 0; i < 2; ++i) drives_.emplace_back("unit:drive_train?link_side=" + link + "&robot=" + kPusher);
  }
  void initialise(const std::array<Values, 2>& q, const std::array<Values, 2>& tau_0) {
    tau_0_ = tau_0;
    for (std::size_t i = 0; i < 2; ++i) {
      Subject& drive = drives_[i];
      drive.fill("K", 1e4).fill("B", 0.5).fill("D", 20).set("tau_m", tau_0[i]);
      copy(drive, "K", world_, kNames[i] + "K");
      copy(drive, "D", world_, kNames[i] + "D");
      if (outside_) {
        world_.set(kNames[i] + "q0", q[i]);
        drive.set("link_order", 1).set("q", q[i]);
      } else {
        drive.set("q0", q[i]);
        world_.set(kNames[i] + "q", q[i]);
      }
      drive.initialise();
      theta_d_[i] = q[i];
      for (std::size_t j = 0; j < 2; ++j) theta_d_[i][j] += tau_0[i][j] / 1e4;
      copy(drive, "tau_J", world_, kNames[i] + "tau_J");
    }
    world_.initialise();
  }
  void step(double h) {
    for (std::size_t i = 0; i < 2; ++i) {
      Subject& drive = drives_[i];
      for (std::size_t j = 0; j < 2; ++j) {
        drive["tau_m"][j] = tau_0_[i][j] + 300 * (theta_d_[i][j] - drive["theta"][j]) - 60 * drive["dtheta"][j];
      }
      for (const char* name : {"tau_J", "dtheta"}) copy(drive, name, world_, kNames[i] + name);
      if (outside_) continue;
      for (const char* name : {"q", "dq"}) copy(drive, name, world_, kNames[i] + name);
    }
    world_.step(h);
    for (std::size_t i = 0; i < 2; ++i) {
      copy(world_, kNames[i] + "tau_e", drives_[i], "tau_e");
      if (outside_) {
        for (const char* name : {"q", "dq"}) copy(world_, kNames[i] + name, drives_[i], name);
      }
      drives_[i].step(h);
    }
  }
  Subject& world() { return world_; }

 private:
  static inline const std::array<std::string, 2> kNames = {"left.", "right."};
  bool outside_;
  Subject world_;
  std::vector<Subject> drives_;
  std::array<Values, 2> tau_0_, theta_d_;
};

TEST(ContactWorld, TwoRobotsInOneWorldMoveAsEachWouldAlone) {
  for (const std::string link : {"inside", "outside"}) {
    Pair two(link, "&scene=" + kFloor);
    two.world().set("right.base_p0", {0, 1, 0});
    two.initialise({Values{-0.4, -0.6}, Values{-0.5, -0.3}}, {Values{5, 2}, Values{6, 1}});
    Held left(link, "&scene=" + kFloor, {-0.4, -0.6}), right(link, "&scene=" + kFloor, {-0.5, -0.3});
    left.initialise({5, 2});
    right.initialise({6, 1});
    for (int i = 0; i < 1000; ++i) {
      two.step(1e-3);
      left.step(1e-3);
      right.step(1e-3);
    }
    // The islands are solved separately, but with one tolerance: 1e-9 m/s.
    for (const auto& [name, alone] : {std::pair{"left.", &left}, {"right.", &right}}) {
      EXPECT_GT(alone->world()["f_c"][2], 5) << link;
      EXPECT_NEAR(two.world()[std::string(name) + "f_c"][2], alone->world()["f_c"][2], 1e-6) << link << " " << name;
      for (std::size_t j = 0; j < 2; ++j) {
        EXPECT_NEAR(two.world()[std::string(name) + "q_link"][j], alone->world()["q_link"][j], 1e-9) << link << " " << name;
      }
    }
  }
}

// The ball of the left arm is on the right arm: action equals reaction, for links that are placed and for links that move.
TEST(ContactWorld, TwoRobotsInContactHaveEqualForces) {
  std::vector<double> lifted;
  for (const std::string link : {"inside", "outside"}) {
    Pair two(link, "&scene=none");
    two.world().set("left.base_p0", {0, 0, 0.0405});
    two.initialise({Values{0.3, -0.5}, Values{0.3, -0.5}}, {Values{30, 8}, Values{40, 12}});
    for (int i = 0; i < 3000; ++i) two.step(1e-3);
    const auto left = two.world()["left.f_c"], right = two.world()["right.f_c"];
    EXPECT_GT(left[2], 3) << link;
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(left[k], -right[k], 1e-9) << link;
    lifted.push_back(left[2]);
  }
  EXPECT_NEAR(lifted[0], lifted[1], 0.01 * lifted[1]);
}

TEST(ContactWorld, ARobotThatIsRestoredInContactGoesOnToTheSameBits) {
  for (const std::string link : {"inside", "outside"}) {
    Held robot(link, "&scene=" + kFloor, {-0.4, -0.6}), other(link, "&scene=" + kFloor, {-0.4, -0.6});
    for (Held* one : {&robot, &other}) one->initialise({5, 2});
    for (int i = 0; i < 300; ++i) robot.step(1e-3);
    ASSERT_GT(robot.world()["f_c"][2], 1) << link;
    Snapshot world, drive;
    world.take(robot.world().variables(), robot.world().unit());
    drive.take(robot.drive().variables(), robot.drive().unit());
    world.restore(other.world().variables(), other.world().unit());
    drive.restore(other.drive().variables(), other.drive().unit());
    for (int i = 0; i < 200; ++i) {
      robot.step(1e-3);
      other.step(1e-3);
    }
    EXPECT_EQ(robot.world().values("world"), other.world().values("world")) << link;
    EXPECT_EQ(robot.world().values("tau_e"), other.world().values("tau_e")) << link;
    EXPECT_EQ(robot.drive().values("theta"), other.drive().values("theta")) << link;
  }
}

TEST(ContactWorld, ForcesOnARobotsBaseAreReported) {
  Subject world("unit:contact_world?link_side=outside&scene=" + kFloor + "&robot=" + kData + "gantry.urdf");
  world.set("base_p0", {0, 0.3, 0}).set("cube.p0", {0.02, 0.3, 0.15}).set("tau_J", {0, 1.5 * kGravity});
  world.initialise();
  for (int i = 0; i < 1000; ++i) {
    world.set("tau_J", {0, 1.5 * kGravity});
    world.step(1e-3);
  }
  EXPECT_NEAR(world["base_f_c"][2], -2 * kGravity, 1e-6);
  EXPECT_NEAR(world["base_m_c"][1], 0.02 * 2 * kGravity, 1e-4) << "p x F about the base's origin";
  EXPECT_THAT(world.values("f_c"), ElementsAre(0, 0, 0)) << "no link is touched";
}

// More points than the setting: all are computed, and the outputs contain the first `points` of them; memory grows once.
TEST(ContactWorld, AllocatesOnceIfThereAreMorePointsThanExpected) {
  Subject small("unit:contact_world?contacts=2&points=2&scene=" + kFloor), large("unit:contact_world?scene=" + kFloor);
  for (Subject* world : {&small, &large}) world->initialise();
  EXPECT_EQ(small.integer("grown"), 0);
  small.step(1e-3);
  large.step(1e-3);
  EXPECT_EQ(small.integer("contacts"), 4);
  EXPECT_EQ(small.integer("grown"), 1);
  EXPECT_EQ(large.integer("grown"), 0);
  const auto before = cotwin::testing::allocations();
  for (int i = 0; i < 200; ++i) small.step(1e-3);
  EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
  for (int i = 0; i < 200; ++i) large.step(1e-3);
  EXPECT_EQ(small.integer("grown"), 1);
  EXPECT_EQ(small["contact_p"].size(), 6u);
  EXPECT_EQ(small.integer("contact_bodies", 1), 2) << "the cube is the scene's second body";
  EXPECT_NEAR(small["cube.f_c"][2], 2 * kGravity, 5e-6) << "tolerance 1e-9 m/s times m / (h/2)";
  EXPECT_NEAR(small["cube.p"][2], large["cube.p"][2], 1e-7) << "only the warm start of the points beyond is missing";
}

// Keystone test with elastic joints: links in reduced coordinates (2a) and in maximal coordinates (1) move alike, and the
// difference decreases with the step.
TEST(ContactWorld, LinksInTheWorldMoveAsLinksInTheDriveTrain) {
  const auto difference = [](double h) {
    Held inside("inside", "", {0.5, -0.9}), outside("outside", "", {0.5, -0.9});
    for (Held* robot : {&inside, &outside}) {
      robot->initialise({40, 10});
      robot->theta_d() = {0.9, -0.4};
      for (int i = 0; i < static_cast<int>(0.8 / h + 0.5); ++i) robot->step(h);
    }
    double largest = 0;
    for (std::size_t j = 0; j < 2; ++j) largest = std::max(largest, std::abs(inside.drive()["q"][j] - outside.world()["q"][j]));
    return largest;
  };
  const double coarse = difference(1e-3), fine = difference(2.5e-4);
  EXPECT_LT(coarse, 2e-3);
  EXPECT_LT(fine, 0.4 * coarse);
}

// Light links on stiff gears: explicit exchange of τ_J and q would diverge at 1 ms (K h² / M = 2).
TEST(ContactWorld, LightLinksOnStiffGearsStayStableAtAMillisecond) {
  const Values rest(7, 0.0);
  Held robot("outside", "", rest, "lwr4");
  robot.world().set("gravity", {0, 0, 0});
  robot.initialise(rest);
  robot.theta_d() = {0.01, -0.01, 0.01, 0.01, -0.01, 0.01, 0.02};
  for (int i = 0; i < 4000; ++i) robot.step(1e-3, 500, 40);
  for (std::size_t j = 0; j < 7; ++j) {
    EXPECT_NEAR(robot.world()["q"][j], robot.drive()["theta"][j], 2e-5) << j;  // nothing loads the gear at rest
    EXPECT_LT(std::abs(robot.world()["dq"][j]), 1e-3) << j;
  }
}

TEST(ContactWorld, AnArmOnStiffGearsLosesLittleEnergyBetweenTheTwoUnits) {
  Held robot("outside", "", {0.5, -0.9});
  robot.drive().fill("D", 0);
  robot.world().fill("D", 0);
  robot.initialise({0, 0});
  const auto energy = [&] {
    Subject& d = robot.drive();
    return robot.world()["energy"][0] + d["energy_kinetic"][0] + d["energy_elastic"][0];
  };
  const double start = energy();
  for (int i = 0; i < 2000; ++i) robot.step(1e-3, 0, 0);
  EXPECT_NEAR(energy(), start, 0.1) << "of 40 J that go back and forth";
}

// No external forces: the centre of mass of base and links stays at rest.
TEST(ContactWorld, AFloatingRobotMovesItsBaseButNotItsCentreOfMass) {
  const robot::RobotModel satellite = robot::load_urdf(kData + "satellite.urdf");
  Subject world("unit:contact_world?link_side=outside&base=floating&robot=" + kData + "satellite.urdf");
  const auto centre = [&] {
    const auto Q = world["base_quat"];
    const Pose X_WB{Eigen::Quaterniond(Q[0], Q[1], Q[2], Q[3]).toRotationMatrix(), Eigen::Vector3d(world["base_p"].data())};
    std::vector<Pose> X_WL(2);
    std::vector<Twist> V_WL(2);
    scene::place_links(satellite, X_WB, world["q"], world["dq"], X_WL, V_WL);
    Eigen::Vector3d sum = satellite.base.inertia.mass * (X_WB * satellite.base.inertia.p_LC);
    double mass = satellite.base.inertia.mass;
    for (std::size_t i = 0; i < 2; ++i) {
      const Inertia& inertia = satellite.bodies[i].inertia;
      sum += inertia.mass * (X_WL[i] * inertia.p_LC);
      mass += inertia.mass;
    }
    return Eigen::Vector3d(sum / mass);
  };
  world.set("gravity", {0, 0, 0});
  world.initialise();
  const Eigen::Vector3d start = centre();
  for (int i = 0; i < 1000; ++i) {
    world.set("tau_J", {std::sin(0.01 * i), std::cos(0.013 * i)});
    world.step(1e-3);
  }
  EXPECT_GT(std::abs(world["dq"][0]), 1e-2);
  EXPECT_GT(Eigen::Vector3d(world["base_p"].data()).norm(), 1e-4);
  EXPECT_LT((centre() - start).norm(), 1e-8);
}

TEST(ContactWorld, MovesADrivenBodyAtItsInputSpeed) {
  Subject world("unit:contact_world?scene=" + kData + "driven.sdf");
  world.initialise();
  world.set("plate.v_d", {0.1, 0, 0});
  for (int i = 0; i < 500; ++i) world.step(1e-3);
  EXPECT_NEAR(world["plate.p"][0], 0.05, 1e-12);
}

TEST(ContactWorld, AStepAllocatesNothingAndGoesOnFromARestoredSnapshotToTheSameBits) {
  const std::string source = "unit:contact_world?scene=" + kFloor + "&robot=" + kPusher;
  Subject world(source), other(source);
  world.set("q", {-0.4, -0.6}).initialise();
  for (int i = 0; i < 50; ++i) world.step(1e-3);
  const auto before = cotwin::testing::allocations();
  for (int i = 0; i < 50; ++i) world.step(1e-3);
  EXPECT_EQ(cotwin::testing::allocations() - before, 0u);

  Snapshot snapshot;
  snapshot.take(world.variables(), world.unit());
  snapshot.restore(other.variables(), other.unit());
  for (int i = 0; i < 50; ++i) {
    world.step(1e-3);
    ASSERT_EQ(other.unit().step(Time{}, Duration::from_seconds(1e-3)), StepResult::kDone);
  }
  EXPECT_EQ(world.values("world"), other.values("world"));
}

TEST(ContactWorld, ReportsErrorsInItsSettingsAndInputs) {
  EXPECT_THAT(error_of([] { Subject("unit:contact_world?scene=nowhere"); }), HasSubstr("scenes/nowhere/scene.sdf"));
  EXPECT_THAT(error_of([] { Subject("unit:contact_world?robots=left"); }), HasSubstr("expected name:robot"));
  EXPECT_THAT(error_of([] { Subject("unit:contact_world?robots=a:" + kPusher + ",a:" + kPusher); }), HasSubstr("twice"));
  EXPECT_THAT(error_of([] { Subject("unit:contact_world?robot=" + kPusher + "&robots=a:" + kPusher); }),
              HasSubstr("expected one of the two settings"));
  EXPECT_THAT(error_of([] { Subject("unit:contact_world?scene=" + kFloor + "&robots=cube:" + kPusher); }),
              HasSubstr("robot 'cube' and body 'cube' have the same variable prefix cube."));
  EXPECT_THAT(error_of([] { Subject("unit:contact_world?robots=a-b:" + kPusher + ",a_b:" + kPusher); }),
              HasSubstr("robot 'a-b' and robot 'a_b'"));
  EXPECT_THAT(error_of([] { Subject("unit:contact_world?base=floating&robot=" + kPusher); }),
              HasSubstr("base=floating: the base of robot 'pusher' cannot float"));
  EXPECT_THAT(
      error_of([] { Subject("unit:contact_world?base=floating&actuation=prescribed&robot=" + kData + "satellite.urdf"); }),
      HasSubstr("expected actuation=torque"));
  EXPECT_THAT(error_of([] { Subject("unit:contact_world?maximal=left&robots=right:" + kPusher); }),
              HasSubstr("maximal=left: there is no robot of this name"));
  EXPECT_THAT(error_of([] { Subject("unit:contact_world?actuation=prescribed&link_side=outside&robot=" + kPusher); }),
              HasSubstr("expected link_side=inside"));
  Subject world("unit:contact_world?scene=" + kFloor);
  world.set("cube.quat0", {1, 1, 0, 0});
  EXPECT_THAT(error_of([&] { world.initialise(); }), HasSubstr("cube.quat0"));
  world.set("cube.quat0", {0.707, 0, 0, 0.707}).initialise();  // rounded
  EXPECT_NEAR(world["cube.quat"][0], std::sqrt(0.5), 1e-15);
  world.set("cube.quat0", {1, 0, 0, 0});
  world["cube.p0"][2] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(error_of([&] { world.initialise(); }), HasSubstr("cube.p0[3]"));
  world["cube.p0"][2] = 0.05;
  world["cube.w0"][0] = std::numeric_limits<double>::infinity();
  EXPECT_THAT(error_of([&] { world.initialise(); }), HasSubstr("cube.w0[1]"));
  world["cube.w0"][0] = 0;
  world.initialise();
  world["cube.f"][1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(error_of([&] { world.step(1e-3); }), HasSubstr("cube.f[2]"));
}

// A cube keeps its spin about any axis. The scene's velocity is the start value of the parameters.
TEST(ContactWorld, BodiesStartAtTheVelocityOfTheSceneOrOfTheirParameters) {
  Subject given("unit:contact_world?scene=" + kFloor);
  given.set("gravity", {0, 0, 0}).set("cube.p0", {0, 0, 2}).set("cube.v0", {0.1, 0.2, 0.3}).set("cube.w0", {0.3, -0.6, 0.6});
  const testing::TemporaryFolder folder("velocity");
  std::string scene = testing::content(kFloor);
  scene.insert(scene.rfind("<inertial>"),
               "<cotwin:velocity xmlns:cotwin='urn:cotwin:scene:1'>0.1 0.2 0.3 0.3 -0.6 0.6</cotwin:velocity>");
  folder.write("moving.sdf", scene);
  Subject read("unit:contact_world?scene=" + (folder.path() / "moving.sdf").string());
  read.set("gravity", {0, 0, 0}).set("cube.p0", {0, 0, 2});
  for (Subject* world : {&given, &read}) {
    world->initialise();
    for (int i = 0; i < 1000; ++i) world->step(1e-3);
    const auto p = (*world)["cube.p"], quat = (*world)["cube.quat"], w = (*world)["cube.w"];
    EXPECT_NEAR(p[0], 0.1, 1e-12);
    EXPECT_NEAR(p[2], 2.3, 1e-12);
    EXPECT_NEAR(w[1], -0.6, 1e-12);
    EXPECT_NEAR(quat[0], std::cos(0.45), 1e-7);  // 0.9 rad
    EXPECT_NEAR(quat[2], -2.0 / 3 * std::sin(0.45), 1e-7);
  }
}

TEST(ContactWorld, FollowsTheTunablesOfAFoundationToTheSameBitsFromARestoredSnapshot) {
  Subject world("unit:contact_world?scene=" + kData + "cushion.sdf"),
      other("unit:contact_world?scene=" + kData + "cushion.sdf");
  world.initialise();
  other.initialise();
  const auto run = [](Subject& subject) {
    for (int i = 0; i < 1000; ++i) subject.step(1e-3);
  };
  const double weight = 10 * kGravity, area = 0.01;
  run(world);
  EXPECT_NEAR(world["block.p"][2], 0.05 - weight / (1e8 * area), 1e-9);
  world.fill("pad.stiffness_per_area", 2e8);
  const auto before = cotwin::testing::allocations();
  world.step(1e-3);
  EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
  run(world);
  EXPECT_NEAR(world["block.p"][2], 0.05 - weight / (2e8 * area), 1e-9);
  EXPECT_EQ(world["pad.dent"][0], 0);
  Snapshot snapshot;
  snapshot.take(world.variables(), world.unit());
  // Softer than the pressure of the weight, it yields until it is changed again; the dent stays.
  world.fill("pad.yield_stress", 0.9 * weight / area);
  for (int i = 0; i < 50; ++i) world.step(1e-3);
  world.fill("pad.yield_stress", 1e5);
  run(world);
  const double dent = world["pad.dent"][0];
  EXPECT_NEAR(dent, 0.1 * kGravity * 0.05 * 0.05 / 2, 0.1 * dent);  // it falls with a tenth of g for 50 ms
  EXPECT_NEAR(world["block.p"][2], 0.05 - dent - weight / (2e8 * area), 2e-6);
  const Values there = world.values("world");
  snapshot.restore(other.variables(), other.unit());
  other.fill("pad.stiffness_per_area", 2e8);
  other.fill("pad.yield_stress", 0.9 * weight / area);
  for (int i = 0; i < 50; ++i) other.step(1e-3);
  other.fill("pad.yield_stress", 1e5);
  run(other);
  EXPECT_EQ(other.values("world"), there);

  EXPECT_THAT(error_of([&] { world.fill("pad.yield_stress", 0).step(1e-3); }),
              HasSubstr("pad.yield_stress: is 0, expected a finite value > 0"));
  world.fill("pad.yield_stress", 1e5);
  EXPECT_THAT(error_of([&] { world.fill("pad.breakthrough", 0.01).step(1e-3); }),
              HasSubstr("pad.breakthrough: is 0.01, expected 0 (never), as at the start"));
  world.fill("pad.breakthrough", 0);
  world["pad.foundation"][0] = -1;
  EXPECT_THAT(error_of([&] { world.unit().restored(); }), HasSubstr("foundation of body 'pad': -1"));
}

TEST(ContactWorld, RefusesAStateThatIsDamaged) {
  Subject world("unit:contact_world?scene=" + kFloor);
  world.initialise();
  for (int i = 0; i < 5; ++i) world.step(1e-3);
  for (const double points : {300.0, 1e18, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
    const double kept = std::exchange(world["world"][2], points);
    EXPECT_THROW(world.unit().restored(), Error) << points;
    world["world"][2] = kept;
  }
  // The first one, after the header, the bodies and the account of one: indices of bodies and shapes, both halves of its id
  const std::size_t contact = 8 + 16 * 2 + 13;
  for (std::size_t i = 0; i < 6; ++i) {
    const double kept = std::exchange(world["world"][contact + i], -3e10);
    EXPECT_THROW(world.unit().restored(), Error) << i;
    world["world"][contact + i] = kept;
  }
  EXPECT_NO_THROW(world.unit().restored());
}

}  // namespace
}  // namespace cotwin::unit_test
