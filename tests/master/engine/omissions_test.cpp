// Warnings of check and run about things that a scenario forgot. The units are those of the program.
#include "master/run/omissions.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include "master/workflows/check.h"
#include "models/foundation/support/text.h"
#include "tests/master/test_units.h"
#include "tests/support/error_of.h"
#include "tests/support/growth.h"
#include "tests/support/places.h"

namespace cotwin::master::omissions_test {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using testing::Build;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<std::string> warnings_of(const Scenario& scenario) {
  MasterOptions options;
  options.types = unit_types();
  options.folders = {fs::path(places::source()) / "models"};
  return Master(scenario, std::move(options)).warnings();
}
std::vector<std::string> warnings_of(const Build& build) { return warnings_of(build.scenario); }

/// motion → controller → drive of planar2, with the usual wiring.
struct Robot : Build {
  explicit Robot(const std::string& forgotten = "", const std::string& more = "") {
    until(1);
    unit("motion", "motion?robot=planar2").with("waypoint_q", std::string("0.5 -0.8 1.1 -1.4"));
    unit("controller", "compliance?robot=planar2");
    unit("drive", "drive_train?robot=planar2" + more);
    if (forgotten != "q0") with("q0", std::string("0.5 -0.8"));
    const auto wire = [&](const std::string& from, const std::string& to) {
      if (to != forgotten) connect(from, to);
    };
    wire("motion.q_d", "controller.q_d");
    wire("motion.dq_d", "controller.dq_d");
    wire("motion.ddq_d", "controller.ddq_d");
    wire("drive.q", "controller.q");
    wire("drive.dq", "controller.dq");
    wire("drive.theta", "controller.theta");
    wire("drive.dtheta", "controller.dtheta");
    wire("controller.tau_m", "drive.tau_m");
  }
};

TEST(Omissions, ARobotThatIsWiredCompletelyGetsNoWarning) { EXPECT_THAT(warnings_of(Robot()), IsEmpty()); }

TEST(Omissions, EveryMissingConnectionOfARobotIsReported) {
  for (const std::string name : {"controller.q_d", "controller.dq_d", "controller.ddq_d", "controller.q", "controller.dq",
                                 "controller.theta", "controller.dtheta", "drive.tau_m"}) {
    EXPECT_THAT(warnings_of(Robot(name)), ElementsAre(HasSubstr(name + " ("))) << name;
  }
}

TEST(Omissions, HavePlaceFactAndExpectation) {
  EXPECT_THAT(
      warnings_of(Robot("controller.q_d")),
      ElementsAre("test.ssd:11: controller.q_d (desired joint position at the end of the step) is not connected and has "
                  "no value: it is 0 rad; expected a connection or a value"));
  EXPECT_THAT(warnings_of(Robot("controller.dq")),
              ElementsAre(AllOf(HasSubstr("controller.q follows drive.q"), HasSubstr("a connection from drive.dq"))));
}

TEST(Omissions, AMissingStartPostureIsReported) {
  EXPECT_THAT(warnings_of(Robot("q0")), ElementsAre(HasSubstr("test.ssd:12: drive.q0 (link-side joint position at the start")));
  Robot connected("q0");  // as if a recording gave it
  connected.connect("motion.q_d", "drive.q0");
  EXPECT_THAT(warnings_of(connected), IsEmpty());
}

TEST(Omissions, AGivenZeroIsNotReported) {
  Robot robot("drive.tau_m");
  robot.with("tau_m", std::string("0"));
  EXPECT_THAT(warnings_of(robot), IsEmpty());
  Robot later("drive.tau_m");
  later.event(0.5, "drive.tau_m", "1 1");
  EXPECT_THAT(warnings_of(later), IsEmpty());
}

/// A KUKA robot behind FRI, which would move to the zeros of an input that is not connected.
Build kuka(const std::string& mode) {
  Build build;
  build.until(1);
  build.unit("link", "io?robot=lwr4&link=fri&protocol=lwr");
  if (!mode.empty()) build.with("mode", mode);
  return build;
}

TEST(Omissions, ACommandThatARobotWouldFollowIsRequired) {
  const auto error = [](const Build& build) { return testing::error_of([&] { (void)warnings_of(build); }); };
  EXPECT_EQ(error(kuka("")), "") << "nothing is commanded by default";
  EXPECT_EQ(error(kuka("monitor")), "");
  EXPECT_THAT(
      error(kuka("position")),
      HasSubstr("link.q_command (commanded joint position) is not connected and has no value, but the unit would act on "
                "it; expected a connection or a value"));
  EXPECT_THAT(error(kuka("joint_impedance")), HasSubstr("link.q_command"));
  EXPECT_THAT(error(kuka("cartesian_impedance")), HasSubstr("link.p_command"));
  const std::string q = "0 0.3 0 -1.2 0 0.9 0";
  EXPECT_EQ(error(kuka("position").with("q_command", q)), "");
  EXPECT_THAT(error(kuka("torque").with("q_command", q)), HasSubstr("link.tau_command"));
  EXPECT_THAT(error(kuka("wrench").with("q_command", q)), HasSubstr("link.F_command"));
  EXPECT_EQ(error(kuka("wrench").with("q_command", q).with("F_command", std::string("0"))), "");
  Build late = kuka("position");
  late.event(0.5, "link.q_command", q);
  EXPECT_THAT(error(late), HasSubstr("link.q_command")) << "it would move to the zeros until then";
  Build first = kuka("position");
  first.event(0, "link.q_command", q);
  EXPECT_EQ(error(first), "");
}

TEST(Omissions, AMissingElementIsNamed) {
  Robot robot("controller.q_d");
  robot.connect("motion.q_d[1]", "controller.q_d[1]");
  EXPECT_THAT(warnings_of(robot), ElementsAre(HasSubstr("controller.q_d[2] (desired")));
  robot.event(0.1, "controller.q_d[2]", "-1");
  EXPECT_THAT(warnings_of(robot), IsEmpty());
}

TEST(Omissions, ARigidRobotNeedsNoMotorPositions) {
  Robot robot("controller.theta");
  std::erase_if(robot.scenario.connections, [](const ConnectionSpec& c) { return c.to.variable == "dtheta"; });
  robot.scenario.components[1].start_values.push_back({"K", std::string("0"), "", "test.ssd:50"});
  EXPECT_THAT(warnings_of(robot), IsEmpty());
}

TEST(Omissions, APushOnOneOfTwoConnectedUnitsIsReported) {
  Robot one;
  one.event(0.2, "drive.tau_e", "20 9");
  EXPECT_THAT(warnings_of(one), ElementsAre(AllOf(HasSubstr("test.ssd:60: the event at 0.2 s gives drive.tau_e the value 20 9"),
                                                  HasSubstr("controller.tau_e of the connected unit does not get it"))));
  one.event(0.2, "controller.tau_e", "20,9.0");  // the same in another notation
  EXPECT_THAT(warnings_of(one), IsEmpty());
  one.event(0.4, "controller.tau_e[2]", "0");
  EXPECT_THAT(warnings_of(one), ElementsAre(HasSubstr("the event at 0.4 s gives controller.tau_e[2] the value 0")));

  Robot at_start;
  at_start.with("tau_e", std::string("3 0"));  // of the drive
  EXPECT_THAT(warnings_of(at_start), ElementsAre(HasSubstr("the start value gives drive.tau_e the value 3 0")));
  Robot nothing;
  nothing.with("tau_e", std::string("0 0"));
  EXPECT_THAT(warnings_of(nothing), IsEmpty());
}

TEST(Omissions, APushThatAControllerMeasuresIsNotReported) {
  Robot robot;
  robot.unit("sensors", "io?link=sensors&robot=planar2");
  robot.connect("drive.q", "sensors.q_true").connect("drive.dq", "sensors.dq_true");
  robot.connect("sensors.tau_e", "controller.tau_e");
  robot.event(0.2, "drive.tau_e", "20 9");
  EXPECT_THAT(warnings_of(robot), IsEmpty());
}

TEST(Omissions, ContactForcesThatDoNotReachTheRobotAreReported) {
  Robot robot;
  robot.unit("world", "contact_world?scene=table&robot=planar2");
  robot.connect("drive.q", "world.q").connect("drive.dq", "world.dq");
  robot.connect("drive.tau_J", "world.tau_J").connect("drive.dtheta", "world.dtheta");
  EXPECT_THAT(warnings_of(robot), ElementsAre(AllOf(HasSubstr("drive.tau_e (external joint torque"),
                                                    HasSubstr("although world.tau_e returns it"))));
  robot.connect("world.tau_e", "drive.tau_e");
  EXPECT_THAT(warnings_of(robot), IsEmpty());
}

/// A motion, a person and a monitor that keeps their separation.
struct Cell : Build {
  explicit Cell(bool told, double T_s = 0.5, bool speed_known = true) {
    until(1);
    const std::string scene = "scene=" + std::string(places::source()) + "/examples/20_safety_hulls/person.sdf";
    unit("motion", "motion?robot=planar2&override=true").with("waypoint_q", std::string("0.5 -0.8 1.1 -1.4"));
    with("speed_ramp", std::string("0.5"));
    unit("floor", "contact_world?" + scene);
    unit("monitor", "monitor?robot=planar2&separation=person&" + scene, 1).with("T_s", text::to_text(T_s));
    connect("motion.q_d", "monitor.q");
    connect("motion.dq_d", "monitor.dq");
    for (const std::string x : {"p", "quat", "v", "w"})
      if (x != "v" || speed_known)
        scenario.connections.push_back(
            {{"floor", "person." + x, ""}, {"monitor", "person." + x, ""}, 1, 0, false, "test.ssd:41"});
    if (told) connect("monitor.speed", "motion.speed");
  }
};

TEST(Omissions, RobotsThatAreNotToldToStopAreReported) {
  EXPECT_THAT(warnings_of(Cell(true)), IsEmpty());
  EXPECT_THAT(warnings_of(Cell(false)),
              ::testing::Contains(
                  HasSubstr("monitor.speed is connected to nothing, so nobody tells the robot to slow down or to stop")));
  EXPECT_THAT(warnings_of(Cell(true, 0.3)),
              ElementsAre(HasSubstr("monitor.T_s is 0.3 s, but motion.speed_ramp is 0.5 s: the robot stops later than")));
  EXPECT_THAT(warnings_of(Cell(true, 0.5, false)),
              ElementsAre(HasSubstr("monitor.person.v (velocity of its origin in W) is not connected")));
}

TEST(Omissions, EventsAfterTheEndAreReported) {
  Robot robot;
  robot.event(0.999, "controller.S_a", "100").event(1, "controller.S_a", "200");
  EXPECT_THAT(warnings_of(robot),
              ElementsAre(HasSubstr("test.ssd:60: the event at 1 s on 'controller.S_a' has no effect: expected "
                                    "a time before the end of the run at 1 s")));
  robot.event(7, "controller.D_a", "1");
  EXPECT_THAT(warnings_of(robot), ElementsAre(HasSubstr("and 1 more have no effect")));
}

TEST(Omissions, EventsBeforeTheStartAndRampsBeyondTheEndAreReported) {
  Robot early;
  early.event(-0.5, "controller.S_a", "100").event(0, "controller.D_a", "1");
  EXPECT_THAT(warnings_of(early),
              ElementsAre(HasSubstr("test.ssd:60: the event at -0.5 s on 'controller.S_a' has begun before the run: expected "
                                    "a time from its start at 0 s on")));
  Robot cut;
  cut.event(0.5, "controller.S_a", "100");
  cut.scenario.events.back().ramp = Duration{500'000'000};
  EXPECT_THAT(warnings_of(cut), IsEmpty());
  cut.scenario.events.back().ramp = Duration{500'000'001};
  EXPECT_THAT(warnings_of(cut),
              ElementsAre(HasSubstr("on 'controller.S_a' has a ramp that the end of the run at 1 s cuts off")));
}

TEST(Omissions, ManyEventsAreCheckedInLinearTime) {
  const double ratio = testing::growth(10000, [](int events) {
    Robot robot;
    for (int i = 0; i < events; ++i) {
      robot.scenario.events.push_back({Time{i}, "controller.tau_e", std::to_string(i), {}, ""});
      robot.scenario.events.push_back({Time{i}, "drive.tau_e", std::to_string(i), {}, ""});
    }
    EXPECT_THAT(warnings_of(robot), IsEmpty());
  });
  EXPECT_LT(ratio, 8);
}

TEST(Omissions, UnconnectedUnitsReportTheirNeeds) {
  const auto alone = [](const std::string& source) {
    Build b;
    b.unit("a", source);
    return warnings_of(b);
  };
  EXPECT_THAT(alone("io?joints=2"), ElementsAre(HasSubstr("a.file (recording: CSV with named columns")));
  EXPECT_THAT(alone("io?joints=2&link=sensors"), ElementsAre(HasSubstr("a.q_true")));
  EXPECT_THAT(alone("motion?kind=csv"), ElementsAre(HasSubstr("a.file")));
  EXPECT_THAT(alone("motion"), ElementsAre(HasSubstr("a.waypoint_q")));
  EXPECT_THAT(alone("motion?kind=polynomial"), ElementsAre(HasSubstr("a.q_end")));
  EXPECT_THAT(alone("tuner?robot=planar2"), ElementsAre(HasSubstr("a.q ("), HasSubstr("a.tau (")));
  EXPECT_THAT(alone("drive_train?link_side=outside"), ElementsAre(HasSubstr("a.tau_m"), HasSubstr("a.q (")));
  EXPECT_THAT(alone("contact_world?scene=stack"), IsEmpty());
}

TEST(Omissions, ExamplesHaveNone) {
  for (const char* example :
       {"01_joint_admittance/arm.ssd", "02_free_motion_lwr4/twin.ssd", "04_peg_in_hole/twin.ssd", "05_maturation/twin.ssd"}) {
    const fs::path file = fs::path(places::source()) / "examples" / example;
    MasterOptions options;
    options.types = unit_types();
    options.folders = {file.parent_path(), fs::path(places::source()) / "models"};
    EXPECT_THAT(Master(load_scenario(file), std::move(options)).warnings(), IsEmpty()) << example;
  }
}

}  // namespace
}  // namespace cotwin::master::omissions_test
