// Speed and separation monitoring: S_p in closed form, zones with hysteresis, robots at rest before they are reached, and obstacles that come.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "components/unit/snapshot.h"
#include "models/collision/body.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/robot_links.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/components/monitor/slides.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::monitor::separation_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::error_of;
using cotwin::testing::UnitSubject;
using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

using Values = std::vector<double>;
constexpr double kNone = 1e12;

class Separations : public Slides {};

TEST_F(Separations, KeepTheDistanceOfTheTechnicalSpecification) {
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@ball.sdf&separation=all&ignore=hand:obstacle");
  unit.set("a_r", "0").set("C", "0.1").set("Z_d", "0.02").set("Z_r", "0.03").set("T_r", "0.2").set("T_s", "0.4");
  const double T_r = 0.2 + 2 * 0.01, known = 0.1 + 0.02 + 0.03;
  const auto S_p = [&](double v_r, const Vector3d& v, const Vector3d& w = Vector3d::Zero()) {
    unit.set("q", Values{0, 0, 0}).set("dq", Values{v_r, 0, 0}).set("obstacle.p", Values{2, 0, 0});
    unit.set("obstacle.v", Values{v.x(), v.y(), v.z()}).set("obstacle.w", Values{w.x(), w.y(), w.z()});
    unit.initialise();
    unit.step(0.01);
    EXPECT_NEAR(unit.real("separation"), 2 - 0.3 - unit.real("S_p"), 1e-12);
    return unit.real("S_p");
  };
  EXPECT_NEAR(S_p(0.5, {0, 0, 0}), 1.6 * (T_r + 0.4) + 0.5 * T_r + 0.5 * 0.2 + known, 1e-12) << "a person may start to walk";
  EXPECT_NEAR(S_p(0.5, {-2, 0, 0}), 2 * (T_r + 0.4) + 0.5 * T_r + 0.5 * 0.2 + known, 1e-12);
  EXPECT_NEAR(S_p(-0.5, {0, 2, 0}), 2 * (T_r + 0.4) + 0.5 * T_r + 0.5 * 0.2 + known, 1e-12) << "directions do not count";
  unit.set("v_h", "0");
  EXPECT_NEAR(S_p(0.5, {-0.3, 0, 0}, {0, 0, 2}), (0.3 + 0.2 * 2) * (T_r + 0.4) + 0.5 * T_r + 0.5 * 0.2 + known, 1e-12);
  unit.set("S_s", "0.35");
  EXPECT_NEAR(S_p(0.5, {0, 0, 0}), 0.5 * T_r + 0.35 + known, 1e-12);
  EXPECT_NEAR(S_p(0, {0, 0, 0}), 0.35 + known, 1e-12);
  unit.set("S_s", "-1").set("a_r", "3");
  const double v = 0.5 + 3 * T_r;  // when it begins to brake
  EXPECT_NEAR(S_p(0.5, {0, 0, 0}), (0.5 + v) / 2 * T_r + v * 0.4 / 2 + 3 * 0.4 * 0.4 / 6 + known, 1e-12);
}

TEST_F(Separations, SpeedUpAtMostAsTheStretchedArmAtItsLimit) {
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@ball.sdf&separation=all");
  EXPECT_NEAR(unit.real("a_r"), 1 / 0.5, 1e-12) << "slides of 1 m/s; the joint that turns has no limit";
}

// All speeds and zones of an approach and a retreat, by hand.
TEST_F(Separations, HaveThreeZonesWithHysteresis) {
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@crate.sdf&obstacles=crate&separation=all&ignore=hand:crate");
  unit.set("a_r", "0").set("T_r", "0").set("T_s", "0.5").set("C", "1").set("slow_band", "0.5");
  unit.set("hysteresis", "0.1").set("restart_delay", "0");
  const auto zone_at = [&](double d, double v_r) {
    unit.set("dq", Values{v_r, 0, 0}).set("crate.p", Values{d + 0.2, 0, 0});
    unit.step(1e-3);
    return unit.integer("zone");
  };
  const double S_1 = 1 + 0.8 * 0.25 + 0.8 * 0.002, S_slow = 1 + 0.2 * 0.25 + 0.2 * 0.002;  // at 0.8 and 0.2 m/s
  unit.set("crate.p", Values{3, 0, 0});
  unit.initialise();
  EXPECT_EQ(unit.real("speed"), 1);
  EXPECT_EQ(zone_at(S_1 + 0.501, 0.8), 0);
  EXPECT_EQ(zone_at(S_1 + 0.499, 0.8), 1);
  EXPECT_EQ(unit.real("speed"), 0.25);
  EXPECT_EQ(unit.integer("event_code"), 11);
  EXPECT_EQ(unit.integer("event_count"), 1);
  EXPECT_EQ(unit.integer("event_link"), 3) << "crate, rail, ball";
  EXPECT_NEAR(unit.real("event_t"), 0.002, 1e-12);
  EXPECT_NEAR(unit.real("event_size"), 0.499, 1e-12);
  EXPECT_EQ(zone_at(S_1 + 0.599, 0.2), 1) << "it would be slowed again at 0.8 m/s";
  EXPECT_EQ(zone_at(S_slow + 0.001, 0.2), 1);
  EXPECT_EQ(zone_at(S_slow - 0.001, 0.2), 2);
  EXPECT_EQ(unit.real("speed"), 0);
  EXPECT_EQ(zone_at(S_slow + 0.099, 0), 2) << "a quarter of 0.8 m/s would stop it again";
  EXPECT_EQ(zone_at(S_slow + 0.101, 0), 1);
  EXPECT_EQ(zone_at(S_1 + 0.599, 0.2), 1);
  EXPECT_EQ(zone_at(S_1 + 0.601, 0.2), 0);
  EXPECT_EQ(unit.integer("event_count"), 4);
  EXPECT_EQ(unit.integer("event_code"), 10);
  EXPECT_EQ(zone_at(0.9, 0), 2) << "jumps from clear to stop";
  EXPECT_EQ(zone_at(5, 0), 1);
  EXPECT_EQ(zone_at(5, 0), 0);
  std::vector<std::string> notes;
  unit.unit().append_notes(notes);
  EXPECT_THAT(notes,
              ElementsAre("slide was asked to slow down once, at 0.002 s (ball 1.7 m from crate, S_p 1.2 m), to stop 2 times, "
                          "first at 0.005 s (ball 1.05 m from crate, S_p 1.05 m)",
                          "slide stopped in time in 0 of 2 stops, 2 not judged (stop or run ended before T_r + T_s); nearest "
                          "while it moved: 1.05 m from crate"));
}

// Both at constant speed, and the robot is told a step later: it comes to rest within one step's way beyond C + Z_d + Z_r.
TEST_F(Separations, ARobotAtConstantSpeedUsesItsDistanceUp) {
  folder_.write("line.csv", "t,q1,q2,q3\n0,0,0,0\n1,0.8,0,0\n2,1.6,0,0\n3,2.4,0,0\n4,3.2,0,0\n5,4,0,0\n6,4.8,0,0\n");
  for (const double h : {0.001, 0.003, 0.01, 0.04}) {
    for (const double walks : {0.0, 0.5, 1.7}) {
      UnitSubject motion = unit("unit:motion?robot=@slide.urdf&kind=csv&override=true");
      motion.set("file", (folder_.path() / "line.csv").string()).set("speed_ramp", "0.4");
      UnitSubject watch = monitor("robot=@slide.urdf&scene=@ball.sdf&separation=all&ignore=hand:obstacle");
      watch.set("a_r", "0").set("T_r", "0").set("T_s", "0.4").set("v_h", "0").set("C", "0.1").set("slow_band", "0");
      const auto observe = [&] {
        watch.set("q", motion.values("q_d")).set("dq", motion.values("dq_d")).set("obstacle.v", Values{-walks, 0, 0});
        watch.set("obstacle.p", Values{4 - walks * motion.now(), 0, 0});
      };
      motion.initialise();
      observe();
      watch.initialise();
      for (double told = 1; motion.real("path_speed") > 0;) {
        motion.set("speed", Values{told});
        told = watch.real("speed");
        motion.step(h);
        observe();
        watch.step(h);
      }
      EXPECT_GE(watch.real("distance"), 0.1 - 1e-6) << h << " " << walks;
      EXPECT_LE(watch.real("distance"), 0.1 + (0.8 + walks) * h + 1e-6) << h << " " << walks;
    }
  }
}

// The verdict of the monitor, and one of its inputs and outputs as they would be recorded.
TEST_F(Separations, StopsThatComeLateAreToldExactlyWhereTheRobotMovesTooLong) {
  folder_.write("line.csv", "t,q1,q2,q3\n0,0,0,0\n1,0.8,0,0\n2,1.6,0,0\n3,2.4,0,0\n4,3.2,0,0\n5,4,0,0\n6,4.8,0,0\n");
  int late = 0, in_time = 0;
  for (const double h : {0.001, 0.004, 0.04}) {
    for (const double longer : {-0.1, 0.0, 0.0005, 0.002, 0.004, 0.006, 0.01, 0.05, 0.1, 0.3, 1.0}) {
      UnitSubject motion = unit("unit:motion?robot=@slide.urdf&kind=csv&override=true");
      motion.set("file", (folder_.path() / "line.csv").string()).set("speed_ramp", Values{0.4 + longer});
      UnitSubject watch = monitor("robot=@slide.urdf&scene=@ball.sdf&separation=all&ignore=hand:obstacle");
      watch.set("a_r", "0").set("T_r", "0").set("T_s", "0.4").set("v_h", "0").set("C", "0.1").set("slow_band", "0");
      const auto observe = [&] {
        watch.set("q", motion.values("q_d")).set("dq", motion.values("dq_d")).set("obstacle.p", Values{4, 0, 0});
      };
      motion.initialise();
      observe();
      watch.initialise();
      double stopped = kNone, worst = 0, nearest = kNone;
      for (double t = 0; t < 6; t += h) {
        motion.set("speed", Values{watch.real("speed")});
        motion.step(h);
        observe();
        watch.step(h);
        const double v = motion.values("dq_d")[0];
        if (watch.integer("zone") == 2) stopped = std::min(stopped, motion.now());
        if (v > 0.01) nearest = std::min(nearest, watch.real("distance"));
        if (motion.now() - stopped > 0.4 + 2 * h + 1e-9 && v > 0.01) worst = std::max(worst, v);
      }
      EXPECT_EQ(watch.integer("stopped_late"), worst > 0 ? 1 : 0) << h << " " << longer;
      EXPECT_NEAR(watch.real("least_while_moving"), nearest, 1e-9);
      EXPECT_EQ(watch.integer("event_code"), worst > 0 ? 14 : 12);
      std::vector<std::string> notes;
      watch.unit().append_notes(notes);
      ASSERT_EQ(notes.size(), 2U);
      EXPECT_THAT(notes[1], HasSubstr(worst > 0 ? "slide stopped in time in 0 of 1 stop; at "
                                                : "slide stopped in time in 1 of 1 stop; nearest"));
      ++(worst > 0 ? late : in_time);
    }
  }
  EXPECT_GT(late, 10);
  EXPECT_GT(in_time, 8);
}

// Whatever the robot does and wherever a person comes from, it is at rest before less than C + Z_d + Z_r is left, and goes on afterwards.
TEST_F(Separations, RobotsAreAtRestBeforeTheyAreReached) {
  std::mt19937 random(5);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  UnitSubject motion = unit("unit:motion?robot=@slide.urdf&points=2&override=true");
  UnitSubject watch = monitor("robot=@slide.urdf&scene=@ball.sdf&separation=all");
  int approaches = 0, stopped = 0, ended = 0, near = 0;
  for (int k = 0; approaches < 1000; ++k) {
    const bool head_on = k % 3 == 0;
    const double T = uniform(0.8, 3), x = uniform(-1.5, 1.5), turn = head_on ? 0 : uniform(-2, 2),
                 h = k % 2 == 0 ? 0.005 : 0.02;
    const double T_s = uniform(0.1, 0.6), walks = uniform(0.4, 2.5), kept = uniform(0, 0.4);
    motion.set("waypoint_t", Values{0, T}).set("waypoint_q", Values{0, 0, 0, x, turn, 0});
    motion.set("limits", "warn").set("speed_ramp", Values{T_s}).set("speed", Values{1});
    // Largest q̈ and q̇ of a quintic; the hand is 0.45 m from the axis.
    const double ddq = 10 / std::sqrt(3.0) / (T * T), dq = 1.875 / T;
    watch.set("a_r", Values{ddq * std::abs(x) + 0.45 * (ddq * std::abs(turn) + std::pow(dq * turn, 2))});
    watch.set("T_s", Values{T_s}).set("T_r", Values{0}).set("v_h", Values{walks}).set("slow_band", Values{uniform(0, 0.5)});
    watch.set("restart_delay", Values{k % 5 == 0 ? uniform(0, 0.6) : 0});
    watch.set("C", Values{kept / 2}).set("Z_d", Values{kept / 4}).set("Z_r", Values{kept / 4}).set("hysteresis", Values{0.05});
    // The person stands first.
    const double angle = head_on ? (x > 0 ? 0 : M_PI) : uniform(-M_PI, M_PI), wait = uniform(0, T / 2);
    const Vector3d from = uniform(1.5, 4) * Vector3d(std::cos(angle), std::sin(angle), 0);
    const Vector3d v = walks * (Vector3d(uniform(-1, 1), head_on ? 0 : uniform(-0.5, 0.5), 0) - from).normalized();
    double t = 0, before = 1;
    bool was_stopped = false;
    const auto observe = [&] {
      const Vector3d p = from + std::max(t - wait, 0.0) * v, now = t > wait ? v : Vector3d::Zero();
      watch.set("obstacle.p", Values{p.x(), p.y(), p.z()}).set("obstacle.v", Values{now.x(), now.y(), now.z()});
      watch.set("q", motion.values("q_d")).set("dq", motion.values("dq_d"));
    };
    motion.initialise();
    observe();
    watch.initialise();
    if (watch.real("separation") < 0) continue;  // too near from the beginning
    ++approaches;
    while (t < T + wait + 10 / walks) {
      motion.set("speed", Values{watch.real("speed")});
      motion.step(h);
      t += h;
      observe();
      watch.step(h);
      const double rate = motion.real("path_speed"), left = watch.real("distance") - kept;
      if (motion.joints("dq_d").norm() > 0) {
        ASSERT_GE(left, 0) << k << " at " << t;
      }
      if (rate == 0 && before > 0) {
        ++stopped;
        was_stopped = true;
        near += left < 0.3 ? 1 : 0;
      }
      before = rate;
    }
    ended += was_stopped && motion.boolean("done") ? 1 : 0;
  }
  EXPECT_GT(stopped, 500);
  EXPECT_GT(ended, 300);
  EXPECT_GT(near, 100) << "they stop in time, not long before";
}

TEST_F(Separations, StopBeforeWhatJumpsOrIsThereFromTheBeginning) {
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@comes.sdf&separation=all&obstacles=crate");
  unit.set("crate.p", Values{0, 0, 0}).set("person.p", Values{0, 9, 0}).set("restart_delay", "0");
  unit.initialise();
  EXPECT_EQ(unit.integer("zone"), 2) << "the crate is around the robot";
  EXPECT_EQ(unit.integer("event_count"), 1);
  EXPECT_LT(unit.real("distance"), 0);
  unit.set("crate.present", Values{0});
  for (int k = 0; k < 2; ++k) unit.step(1e-3);
  EXPECT_EQ(unit.integer("zone"), 0);
  unit.set("person.p", Values{0, 0.2, 0});
  unit.step(1e-3);
  EXPECT_EQ(unit.real("speed"), 0);
  unit.set("person.p", Values{0, 50, 0});
  for (int k = 0; k < 3; ++k) unit.step(1e-3);
  EXPECT_EQ(unit.real("speed"), 1);
  unit.set("T_r", Values{60});  // longer than any approach
  unit.step(1e-3);
  EXPECT_EQ(unit.real("speed"), 0);
}

TEST_F(Separations, CountBodiesThatMoveAndObstaclesAlone) {
  UnitSubject plate = monitor("robot=@slide.urdf&scene=@plate.sdf&separation=all&ignore=hand:plate");
  plate.set("q", Values{2.8, 0, 0});
  plate.initialise();
  EXPECT_LT(plate.real("distance"), 0.1);
  EXPECT_EQ(plate.integer("zone"), 0) << "the plate stands";
  EXPECT_EQ(plate.real("separation"), kNone);
  EXPECT_THAT(plate.instance().warnings,
              ::testing::Contains(HasSubstr("no body of the scene moves or is in obstacles, so speed stays 1")));
  UnitSubject two = monitor("robots=a:@slide.urdf,b:@slide.urdf&scene=@ball.sdf&separation=all");
  two.set("b.base_p0", Values{0, 6, 0}).set("obstacle.p", Values{0, 5, 0});
  two.initialise();
  EXPECT_EQ(two.real("a.speed"), 1);
  EXPECT_EQ(two.real("b.speed"), 0);
  EXPECT_EQ(two.real("speed"), 0);
  EXPECT_EQ(two.integer("zone"), 2);
  EXPECT_EQ(two.real("separation"), two.real("b.separation"));
}

// What was measured before saves time and changes nothing, whatever moves, jumps, grows or vanishes.
TEST_F(Separations, CountNamedBodiesAndNoOthers) {
  const auto zone = [&](const char* names) {
    UnitSubject unit = monitor(std::string("robot=@slide.urdf&scene=@comes.sdf&obstacles=crate&separation=") + names);
    unit.set("crate.p", Values{0, 0.3, 0}).set("person.p", Values{0, 9, 0});
    unit.initialise();
    return unit.integer("zone");
  };
  EXPECT_EQ(zone("crate"), 2);
  EXPECT_EQ(zone("person"), 0);
  EXPECT_EQ(zone("person, crate"), 2);
  EXPECT_EQ(zone("all"), 2);
  EXPECT_THAT(error_of([&] { zone("persom"); }), HasSubstr("separation=persom: 'persom' is no body of scene 'w'"));
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&scene=@plate.sdf&separation=plate"); }),
              HasSubstr("'plate' stands, expected bodies that move or are in obstacles"));
}

TEST_F(Separations, StopWhereATunableIsNoNumber) {
  for (const char* name : {"v_h", "T_r", "C", "Z_d", "Z_r", "T_s", "a_r", "S_s"}) {
    UnitSubject unit = monitor("robot=@slide.urdf&scene=@ball.sdf&separation=all");
    unit.set("obstacle.p", Values{0, 90, 0});
    unit.initialise();
    EXPECT_EQ(unit.integer("zone"), 0);
    unit.set(name, Values{name == std::string("S_s") ? INFINITY : NAN});
    unit.step(1e-3);
    EXPECT_EQ(unit.integer("zone"), 2) << name;
  }
}

TEST_F(Separations, GoOnFromASnapshotOfAnyStepWithTheSameBits) {
  const std::string query = "robot=@slide.urdf&scene=@comes.sdf&separation=all&obstacles=crate";
  std::mt19937 random(11);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  UnitSubject one = monitor(query), other = monitor(query);
  one.set("slow_band", "0.2").set("restart_delay", "0.01");
  one.initialise();
  Snapshot snapshot;
  double x = 0;
  for (int k = 0; k < 3000; ++k) {
    snapshot.take(one.variables(), one.unit());
    snapshot.restore(other.variables(), other.unit());
    x += uniform(-0.02, 0.02);
    const Values person{2 * std::cos(0.01 * k), 3 * std::sin(0.013 * k), 0}, q{x, 0.02 * k, 0},
        dq{uniform(-0.5, 0.5), uniform(-1, 1), 0};
    one.set("person.p", person).set("q", q).set("dq", dq);
    other.set("person.p", person).set("q", q).set("dq", dq);
    const auto change = [&](const char* name, double value) {
      for (UnitSubject* unit : {&one, &other}) (*unit)[name][0] = value;
    };
    if (k % 40 == 0) change("crate.p", uniform(-3, 3));
    if (k % 30 == 0) change("crate.scale", uniform(0.5, 3));
    if (k % 25 == 0) change("crate.present", k % 50 == 0 ? 1 : 0);
    if (k % 35 == 0) change("r", uniform(0, 0.2));
    if (k % 200 == 70) {
      for (UnitSubject* unit : {&one, &other}) (*unit)["person.p"][0] += 2;
    }
    if (k % 45 < 3) {
      for (UnitSubject* unit : {&one, &other}) (*unit)["person.p"][1] = NAN;
    }
    for (UnitSubject* unit : {&one, &other}) unit->step(1e-3);
    for (const char* name : {"separation", "S_p", "speed", "distance", "event_size", "least_distance"})
      ASSERT_EQ(one.real(name), other.real(name)) << name << " " << k;
    ASSERT_EQ(one.integer("event_count"), other.integer("event_count")) << k;
    ASSERT_EQ(one.real("least_while_moving"), other.real("least_while_moving")) << k;
    ASSERT_EQ(one.integer("stopped_late"), other.integer("stopped_late")) << k;
  }
  EXPECT_GT(one.integer("event_count"), 50);
}

// A robot that stands at the foot of a person is not stopped for it, one on rails is.
TEST_F(Separations, BasesThatStandDoNotCount) {
  std::string urdf = cotwin::testing::content(folder_.path() / "slide.urdf");
  const std::string rail = "<link name=\"rail\">";
  urdf.insert(urdf.find(rail) + rail.size(), "<collision><geometry><sphere radius=\"0.5\"/></geometry></collision>");
  folder_.write("based.urdf", urdf);
  for (const bool floats : {false, true}) {
    UnitSubject unit = monitor(std::string("robot=@based.urdf&scene=@ball.sdf&separation=all&ignore=hand:obstacle&base=") +
                               (floats ? "floating" : "fixed"));
    unit.set("q", Values{3, 0, 0}).set("obstacle.p", Values{0, 1, 0}).set("a_r", Values{0});
    unit.initialise();
    EXPECT_NEAR(unit.real("distance"), 1 - 0.5 - 0.2, 1e-12) << "told all the same";
    const double from_link = std::hypot(3, 1) - 0.3, from_base = 0.3;
    EXPECT_NEAR(unit.real("separation"), (floats ? from_base : from_link) - unit.real("S_p"), 1e-12);
    EXPECT_EQ(unit.integer("separation_pair", 0), floats ? 2 : 3) << "obstacle, rail, ball";
    EXPECT_EQ(unit.integer("separation_pair", 1), 1);
    EXPECT_EQ(unit.integer("zone"), floats ? 2 : 0);
    EXPECT_EQ(unit.integer("event_body"), floats ? 1 : 0);
  }
}

// The levers by hand: each joint's distance from the next, and the reach of the link.
TEST_F(Separations, LinksSpeedUpAsTheirOwnJointsLetThem) {
  folder_.write(
      "person.sdf",
      "<sdf version=\"1.11\"><world name=\"w\"><model name=\"person\"><link name=\"person\"><inertial><mass>1</mass><inertia>"
      "<ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial><collision "
      "name=\"c\"><geometry><sphere><radius>0.01</radius></sphere>"
      "</geometry></collision></link></model></world></sdf>");
  UnitSubject unit = monitor("robot=ur5e&scene=@person.sdf&separation=all");
  const fs::path urdf = fs::path(places::source()) / "models/robots/ur5e/robot.urdf";
  const robot::RobotModel model = robot::load_urdf(urdf);
  const auto shapes = scene::hulls_of_urdf(urdf, model);
  std::vector<double> most(6, 0.0);  // m/s of a point of each link
  for (std::size_t link = 0; link < 6; ++link) {
    double lever = 0;
    for (const scene::Shape& s : shapes[link + 1]) lever = std::max(lever, collision::Body(std::span(&s, 1)).reach());
    for (std::size_t j = link + 1; j-- > 0;) {
      most[link] = std::max(most[link], model.joints[j].dq_max * lever);
      lever += model.joints[j].X_PJ.p.norm();
    }
  }
  const double largest = *std::ranges::max_element(most);
  EXPECT_NEAR(unit.real("a_r"), largest / 0.5, 1e-9);
  unit.set("T_r", "0.1").set("T_s", "0.4").set("a_r", "0.2");
  const Values q{0, -1.2, 1.4, -1.5, -1.57, 0};
  std::vector<Pose> X(6);
  std::vector<Twist> V(6);
  scene::place_links(model, {}, q, Values(6, 0.0), X, V);
  std::set<int> seen;
  for (std::size_t k = 0; k < 24; ++k) {
    const double turn = M_PI / 2 * static_cast<double>(k % 4);
    const Vector3d p = X[k / 4].p + 0.3 * Vector3d(std::cos(turn), std::sin(turn), 0);
    unit.set("q", q).set("person.p", Values{p.x(), p.y(), p.z()});
    unit.initialise();
    const int nearest = unit.integer("separation_pair", 0) - 3;  // person, base, first link
    ASSERT_GE(nearest, 0);
    seen.insert(nearest);
    const double a = 0.2 * most[static_cast<std::size_t>(nearest)] / largest;
    EXPECT_NEAR(unit.real("S_p"), 1.6 * 0.5 + a * (0.1 * 0.1 / 2 + 0.1 * 0.4 / 2 + 0.4 * 0.4 / 6), 1e-9) << nearest;
    const Vector3d way = unit.vector("separation_p_b") - unit.vector("separation_p_a");
    EXPECT_NEAR(way.norm() - unit.real("S_p"), unit.real("separation"), 1e-9);
    EXPECT_NEAR((unit.vector("separation_p_b") - p).norm(), 0.01, 1e-9);
  }
  EXPECT_GE(seen.size(), 3u);
}

TEST_F(Separations, RobotsStopForWhoIsLost) {
  UnitSubject unit = monitor("robots=a:@slide.urdf,b:@slide.urdf&scene=@comes.sdf&separation=person&obstacles=crate");
  unit.set("person.p", Values{0, 9, 0})
      .set("b.base_p0", Values{0, -9, 0})
      .set("restart_delay", "0.02")
      .set("crate.present", "0");
  unit.initialise();
  EXPECT_EQ(unit.integer("zone"), 0);
  int expected = 0;
  for (const char* input : {"person.p", "person.quat", "person.v", "person.w"}) {
    for (const double bad : {double{NAN}, double{INFINITY}}) {
      const Values good = unit.values(input);
      unit[input][1] = bad;
      unit.step(0.01);
      expected += 3;  // both robots stop, and the body is lost
      EXPECT_EQ(unit.integer("event_count"), expected);
      EXPECT_EQ(unit.integer("event_code"), 13);
      EXPECT_EQ(unit.integer("event_body"), 2) << "crate, person";
      for (const char* prefix : {"", "a.", "b."}) {
        EXPECT_EQ(unit.integer(std::string(prefix) + "zone"), 2) << input;
        EXPECT_EQ(unit.real(std::string(prefix) + "speed"), 0);
      }
      EXPECT_NEAR(unit.real("separation_p_b", 1), 9 - 0.2, 1e-12) << "where it was seen last";
      unit.set(input, good);
      unit.step(0.01);
      EXPECT_EQ(unit.integer("zone"), 2);
      for (int k = 0; k < 3; ++k) unit.step(0.01);
      EXPECT_EQ(unit.integer("zone"), 1);
      for (int k = 0; k < 3; ++k) unit.step(0.01);
      EXPECT_EQ(unit.integer("zone"), 0);
      expected += 4;
    }
  }
  EXPECT_EQ(unit.integer("event_count"), expected);
  // Long, and from the beginning, when the scene says where it is.
  UnitSubject late = monitor("robot=@slide.urdf&scene=@ball.sdf&separation=all&ignore=hand:obstacle");
  late.set("obstacle.p", Values{NAN, NAN, NAN}).set("obstacle.quat", Values{NAN, NAN, NAN, NAN});
  late.start();
  EXPECT_EQ(late.integer("zone"), 2);
  EXPECT_NEAR(late.real("distance"), std::hypot(2, 0.5) - 0.3, 1e-12);
  for (int k = 0; k < 1000; ++k) late.step(1e-3);
  EXPECT_EQ(late.integer("event_count"), 2);
  std::vector<std::string> notes;
  late.unit().append_notes(notes);
  EXPECT_THAT(notes,
              ::testing::Contains("obstacle was lost (its pose or speed was no number) once, at 0 s, and was so at the end"));
  // Its own joints, and bodies from which nobody keeps a distance, end the run.
  late.set("q", Values{NAN, 0, 0});
  EXPECT_THAT(error_of([&] { late.step(1e-3); }), HasSubstr("q[1]: is nan"));
  UnitSubject watches = monitor("robot=@slide.urdf&scene=@ball.sdf");
  watches.initialise();
  watches.set("obstacle.p", Values{NAN, 0, 0});
  EXPECT_THAT(error_of([&] { watches.step(1e-3); }), HasSubstr("obstacle.p[1]: is nan"));
}

TEST_F(Separations, RobotsGoOnAfterTheDelay) {
  for (const double delay : {0.0, 0.05, 0.3, 100.0}) {
    UnitSubject unit = monitor("robot=@slide.urdf&scene=@crate.sdf&obstacles=crate&separation=all&ignore=hand:crate");
    unit.set("restart_delay", Values{delay}).set("a_r", Values{0}).set("crate.p", Values{0.1, 0, 0});
    unit.initialise();
    EXPECT_EQ(unit.integer("zone"), 2);
    // Gone for a moment, then for good.
    unit.set("crate.p", Values{50, 0, 0});
    for (int k = 0; k < 3; ++k) unit.step(0.01);
    EXPECT_EQ(unit.integer("zone"), delay == 0 ? 0 : 2);
    unit.set("crate.p", Values{0.1, 0, 0});
    unit.step(0.01);
    EXPECT_EQ(unit.integer("zone"), 2);
    unit.set("crate.p", Values{50, 0, 0});
    const double gone = unit.now() + 0.01;
    double slow = -1, clear = -1;
    for (int k = 0; k < 120; ++k) {
      unit.step(0.01);
      if (slow < 0 && unit.integer("zone") == 1) slow = unit.now();
      if (clear < 0 && unit.integer("zone") == 0) clear = unit.now();
    }
    EXPECT_NEAR(slow, delay > 1 ? -1 : gone + delay, 1e-9) << delay;
    EXPECT_NEAR(clear, delay > 1 ? -1 : gone + 2 * delay + 0.01, 1e-9) << delay;
  }
}

TEST_F(Separations, ObstaclesMoveTurnGrowAndVanishWithoutAllocating) {
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@crate.sdf&obstacles=crate&ignore=hand:crate");
  unit.initialise();
  EXPECT_NEAR(unit.real("distance"), 3 - 0.1 - 0.1, 1e-12);
  const auto distance = [&](const Values& p, const Values& quat, double scale, double present) {
    unit.set("crate.p", p).set("crate.quat", quat).set("crate.scale", Values{scale}).set("crate.present", Values{present});
    const std::uint64_t before = cotwin::testing::allocations();
    unit.step(Duration{1'000'000});
    EXPECT_EQ(cotwin::testing::allocations(), before);
    EXPECT_EQ(unit.real("least_distance"), unit.real("distance")) << "it jumps: nothing is between";
    return unit.real("distance");
  };
  EXPECT_NEAR(distance({-2, 0, 0}, {1, 0, 0, 0}, 1, 1), 1.8, 1e-12);
  EXPECT_NEAR(distance({2, 0, 0}, {3, 0, 0, 3}, 1, 1), 2 - 0.2 - 0.1, 1e-12) << "a quarter turn, of any length";
  EXPECT_NEAR(distance({2, 0, 0}, {1, 0, 0, 0}, 2.5, 1), 2 - 0.25 - 0.1, 1e-12);
  EXPECT_NEAR(distance({2, 0, 0}, {1, 0, 0, 0}, 0.01, 1), 2 - 0.001 - 0.1, 1e-12);
  EXPECT_EQ(distance({2, 0, 0}, {1, 0, 0, 0}, 1, 0), kNone);
  EXPECT_NEAR(distance({2, 0, 0}, {1, 0, 0, 0}, 1, 1), 1.8, 1e-12) << "its size does not drift";
  UnitSubject larger = monitor("robot=@slide.urdf&scene=@crates.sdf&obstacles=crate&ignore=hand:crate");
  for (UnitSubject* x : {&unit, &larger}) {
    x->set("crate.p", Values{1, 0.4, 0.3}).set("crate.quat", Values{0.9, 0.1, -0.3, 0.2});
    x->set("crate.scale", Values{x == &unit ? 1.5 : 1});
  }
  larger.initialise();
  unit.step(1e-3);
  EXPECT_NEAR(unit.real("distance"), larger.real("distance"), 1e-12);
}

TEST_F(Separations, RefuseObstaclesThatAreNone) {
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&scene=@crate.sdf&obstacles=crat"); }),
              HasSubstr("obstacles=crat: 'crat' is no body of scene 'w'"));
  EXPECT_THAT(error_of([&] { monitor("robot=@slide.urdf&scene=@ball.sdf&obstacles=obstacle"); }),
              HasSubstr("'obstacle' moves by itself, expected static bodies"));
  UnitSubject unit = monitor("robot=@slide.urdf&scene=@crate.sdf&obstacles=crate,,crate");
  unit.initialise();
  for (const double scale : {0.0, -1.0, 1e3, std::nan("")}) {
    unit.set("crate.scale", Values{scale});
    EXPECT_THAT(error_of([&] { unit.step(1e-3); }), HasSubstr("crate.scale: is ")) << scale;
  }
  unit.set("crate.scale", Values{1}).set("crate.quat", Values{0, NAN, 0, 0});
  EXPECT_THAT(error_of([&] { unit.step(1e-3); }), HasSubstr("crate.quat[2]: is nan"));
  unit.set("crate.quat", Values{0, 0, 0, 0});
  unit.step(1e-3);
  EXPECT_NEAR(unit.real("distance"), 3 - 0.1 - 0.45, 1e-12) << "not turned";
  unit.set("crate.p", Values{0, INFINITY, 0});
  EXPECT_THAT(error_of([&] { unit.step(1e-3); }), HasSubstr("crate.p[2]: is inf"));
}

}  // namespace
}  // namespace cotwin::monitor::separation_test
