// What check and run tell about the wiring of robots that a monitor is to stop. The units are those of the program.
#include "master/run/separation_loop.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "models/foundation/support/text.h"
#include "tests/master/test_units.h"
#include "tests/support/places.h"

namespace cotwin::master::separation_loop_test {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

/// Two arms of two joints, a person and a trolley that move, and a monitor: right, unless a test changes it.
struct Cell : testing::Build {
  /// `between`: what the links of left are measured from, "" (its motion), "drive" or "sensor"; `in`: a nested system, "cell.".
  explicit Cell(const std::string& settings = "separation=person,trolley", const std::string& between = "",
                const std::string& in = "")
      : in_(in) {
    until(4);
    for (const std::string arm : {"left", "right"})
      unit(in + arm, "motion?robot=planar2&override=true").with("waypoint_q", std::string("0.5 -0.8 1.1 -1.4"));
    const std::string scene = "scene=" + std::string(places::source()) + "/tests/master/engine/two_bodies.sdf";
    unit(in + "floor", "contact_world?" + scene);
    unit(in + "monitor", "monitor?robots=left:planar2,right:planar2&" + settings + "&" + scene, 1);
    std::string source = "left";
    const bool driven = between == "drive";
    if (driven) {
      unit(in + "controller", "compliance?robot=planar2");
      unit(in + "drive", "drive_train?robot=planar2").with("q0", std::string("0.5 -0.8"));
      for (const std::string x : {"q_d", "dq_d", "ddq_d"}) link("left", x, "controller", x);
      for (const std::string x : {"q", "dq", "theta", "dtheta"}) link("drive", x, "controller", x);
      link("controller", "tau_m", "drive", "tau_m");
      source = "drive";
    } else if (between == "sensor") {
      unit(in + "sensor", "io?link=sensors&robot=planar2");
      link("left", "q_d", "sensor", "q_true").link("left", "dq_d", "sensor", "dq_true");
      source = "sensor";
    }
    link(source, source == "left" ? "q_d" : "q", "monitor", "left.q");
    link(source, source == "left" ? "dq_d" : "dq", "monitor", "left.dq");
    link("right", "q_d", "monitor", "right.q").link("right", "dq_d", "monitor", "right.dq");
    for (const std::string body : {"person.", "trolley."})
      for (const std::string x : {"p", "quat", "v", "w"}) link("floor", body + x, "monitor", body + x);
    link("monitor", "left.speed", "left", "speed").link("monitor", "right.speed", "right", "speed");
  }
  Cell& link(const std::string& a, const std::string& x, const std::string& b, const std::string& y, double factor = 1,
             double offset = 0) {
    scenario.connections.push_back({{in_ + a, x, ""}, {in_ + b, y, ""}, factor, offset, false, "test.ssd:41"});
    return *this;
  }
  /// Takes away what feeds an input.
  Cell& cut(const std::string& b, const std::string& y) {
    std::erase_if(scenario.connections,
                  [&](const ConnectionSpec& c) { return c.to.component == in_ + b && c.to.variable == y; });
    return *this;
  }
  Cell& relink(const std::string& a, const std::string& x, const std::string& b, const std::string& y, double factor = 1,
               double offset = 0) {
    return cut(b, y).link(a, x, b, y, factor, offset);
  }
  Cell& exchange(const std::string& b, const std::string& y, const std::string& d, const std::string& z) {
    const auto find = [&](const std::string& component, const std::string& variable) {
      return std::ranges::find_if(scenario.connections, [&](const ConnectionSpec& c) {
        return c.to.component == in_ + component && c.to.variable == variable;
      });
    };
    std::swap(find(b, y)->from, find(d, z)->from);
    return *this;
  }
  ComponentSpec& component(const std::string& name) {
    return *std::ranges::find(scenario.components, in_ + name, &ComponentSpec::name);
  }
  Cell& set(const std::string& name, const std::string& variable, const std::string& value) {
    component(name).start_values.push_back({variable, value, "", "test.ssd:50"});
    return *this;
  }

  std::string in_;
};

Master load(const Cell& cell) {
  MasterOptions options;
  options.types = unit_types();
  options.folders = {fs::path(places::source()) / "models"};
  return Master(cell.scenario, std::move(options));
}
std::vector<std::string> warnings_of(const Cell& cell) { return load(cell).warnings(); }
std::vector<std::string> notes_of(const Cell& cell) {
  const Master master = load(cell);
  return master.summary().notes;
}

TEST(SeparationLoop, OfARightWiringIsToldInANoteForEachRobot) {
  for (const std::string in : {"", "cell."}) {
    EXPECT_THAT(warnings_of(Cell("separation=all", "", in)), IsEmpty());
    EXPECT_THAT(notes_of(Cell("separation=all", "", in)),
                ElementsAre(HasSubstr("separation of left: " + in + "left.q_d; " + in + "left.speed ← " + in +
                                      "monitor.left.speed; T_s 0.5 s, speed_ramp 0.25 s"),
                            HasSubstr("separation of right: " + in + "right.q_d; ")));
    for (const std::string between : {"drive", "sensor"}) {
      const Cell cell("separation=all", between, in);
      EXPECT_THAT(warnings_of(cell), IsEmpty()) << between;
      EXPECT_THAT(notes_of(cell), Contains(HasSubstr("separation of left: " + in + between + ".q ← " + in + "left.q_d; ")));
    }
  }
  EXPECT_THAT(warnings_of(Cell().relink("monitor", "speed", "left", "speed").relink("monitor", "speed", "right", "speed")),
              IsEmpty());
}

TEST(SeparationLoop, OfSpeedsThatStopNobodyNamesTheRightConnection) {
  for (const std::string between : {"", "drive", "sensor"}) {
    for (const std::string in : {"", "cell."}) {
      const auto told = [&](const std::function<void(Cell&)>& change) {
        Cell cell("separation=person,trolley", between, in);
        change(cell);
        return warnings_of(cell);
      };
      const std::string left = in + "left", monitor = in + "monitor";
      EXPECT_THAT(told([](Cell& c) { c.cut("left", "speed"); }),
                  ElementsAre(HasSubstr(monitor + ".left.speed is connected to nothing, so nobody tells the robot")));
      EXPECT_THAT(told([](Cell& c) { c.relink("monitor", "left.zone", "left", "speed"); }),
                  ElementsAre(HasSubstr(left + ".speed comes from " + monitor + ".left.zone: a zone is no share")));
      EXPECT_THAT(told([](Cell& c) { c.exchange("left", "speed", "right", "speed"); }),
                  ElementsAre(HasSubstr(left + ".speed comes from " + monitor + ".right.speed: it has to come from " + monitor +
                                        ".left.speed or " + monitor + ".speed"),
                              HasSubstr(in + "right.speed comes from " + monitor + ".left.speed")));
      EXPECT_THAT(told([](Cell& c) { c.relink("monitor", "left.speed", "right", "speed"); }),
                  ElementsAre(HasSubstr(in + "right.speed comes from " + monitor + ".left.speed")));
      EXPECT_THAT(told([](Cell& c) { c.cut("left", "speed").link("monitor", "left.speed", "left", "time_scale"); }),
                  ElementsAre(HasSubstr("left.speed goes to " + left +
                                        ".time_scale, which does not stop a motion: expected a "
                                        "connection from " +
                                        monitor + ".left.speed or " + monitor + ".speed to " + left + ".speed")));
      EXPECT_THAT(told([](Cell& c) { c.relink("monitor", "left.speed", "left", "speed", 0.01); }), IsEmpty());
      EXPECT_THAT(told([](Cell& c) { c.relink("monitor", "left.speed", "left", "speed", 100); }),
                  ElementsAre(HasSubstr("is 100 times " + monitor + ".left.speed plus 0: expected the share itself")));
      EXPECT_THAT(told([](Cell& c) { c.relink("monitor", "left.speed", "left", "speed", -1, 1); }),
                  ElementsAre(HasSubstr("plus 1: expected the share itself")));
      EXPECT_THAT(told([](Cell& c) {
                    c.component("left").source = "unit:motion?robot=planar2";
                    c.cut("left", "speed");
                  }),
                  ElementsAre(HasSubstr(monitor + ".left.speed is connected to nothing")));
      EXPECT_THAT(
          told([&](Cell& c) {
            c.unit(c.in_ + "second", "motion?robot=planar2&override=true").with("waypoint_q", std::string("0.5 -0.8 1.1 -1.4"));
            c.cut("left", "speed").link("monitor", "left.speed", "second", "speed");
          }),
          ElementsAre(HasSubstr(monitor + ".left.speed goes to " + in + "second.speed, but " + left + " moves left")));
    }
  }
  EXPECT_THAT(warnings_of(Cell().relink("right", "stretch", "left", "speed")),
              ElementsAre(HasSubstr("left.speed comes from right.stretch, which does not hear monitor")));
  Cell chained;
  chained.relink("left", "path_speed", "right", "speed").relink("monitor", "speed", "left", "speed");
  EXPECT_THAT(warnings_of(chained), IsEmpty());
  EXPECT_THAT(notes_of(chained), Contains(HasSubstr("right.speed ← monitor.speed; T_s 0.5 s, speed_ramp 0.5 s")));
  for (const auto& [factor, offset] : {std::pair{1, 1}, {2, 0}, {0, 0}, {-1, 0}})
    EXPECT_THAT(warnings_of(chained.relink("left", "path_speed", "right", "speed", factor, offset)),
                ElementsAre(HasSubstr("right.speed is " + text::to_text(double(factor)) + " times left.path_speed plus")));
}

TEST(SeparationLoop, OfPosturesOfOthersIsTold) {
  EXPECT_THAT(
      warnings_of(
          Cell().exchange("monitor", "left.q", "monitor", "right.q").exchange("monitor", "left.dq", "monitor", "right.dq")),
      ElementsAre(HasSubstr("left watches what right moves: expected a connection to monitor.left.q"),
                  HasSubstr("right watches what left moves")));
  EXPECT_THAT(warnings_of(Cell().relink("right", "dq_d", "monitor", "left.dq")),
              ElementsAre(HasSubstr("monitor.left.dq comes from right.dq_d, but monitor.left.q from left.q_d")));
  Cell elements;
  elements.cut("monitor", "left.q")
      .link("left", "q_d[1]", "monitor", "left.q[1]")
      .link("left", "q_d[2]", "monitor", "left.q[2]");
  EXPECT_THAT(warnings_of(elements), IsEmpty());
  elements.exchange("monitor", "left.q[1]", "monitor", "left.q[2]");
  EXPECT_THAT(warnings_of(elements), ElementsAre(HasSubstr("monitor.left.q[2] comes from left.q_d[1]")));
  elements.relink("right", "q_d[2]", "monitor", "left.q[2]").relink("left", "q_d[1]", "monitor", "left.q[1]");
  EXPECT_THAT(warnings_of(elements), Contains(HasSubstr("right.speed comes from monitor.right.speed: it has to come from")));
}

TEST(SeparationLoop, WhoIsMovedByNoMotionIsNotAccused) {
  Cell recorded;
  recorded.unit("record", "io?joints=2").with("file", std::string(places::source()) + "/tests/master/engine/none.csv");
  recorded.relink("record", "q", "monitor", "left.q").relink("record", "dq", "monitor", "left.dq").cut("left", "speed");
  MasterOptions options;
  options.types = unit_types();
  options.folders = {fs::path(places::source()) / "models"};
  const std::vector<Member> members = load_members(recorded.scenario, options.types, options.folders);
  const SeparationLoop found = trace_separation(recorded.scenario, members, resolve_connections(recorded.scenario, members));
  EXPECT_THAT(found.warnings, IsEmpty());
  EXPECT_THAT(found.notes, Contains(HasSubstr("separation of left: record.q; not traced beyond record; T_s 0.5 s")));
}

// A controller that holds a posture closes a loop in which q and dq come back at different places.
TEST(SeparationLoop, ARobotThatHoldsItsPostureIsNotAccusedOfAnother) {
  Cell held("separation=person,trolley", "drive");
  for (const std::string x : {"q_d", "dq_d", "ddq_d"}) held.cut("controller", x).set("controller", x, "0 0");
  EXPECT_THAT(warnings_of(held), IsEmpty());
  EXPECT_THAT(notes_of(held), Contains(AllOf(HasSubstr("separation of left: drive.q"), HasSubstr("not traced beyond"))));
}

TEST(SeparationLoop, OfBodiesThatAreMixedUpIsTold) {
  EXPECT_THAT(warnings_of(Cell().exchange("monitor", "person.p", "monitor", "trolley.p")),
              ElementsAre(HasSubstr("monitor.person.p comes from floor.trolley.p, though floor has person.p"),
                          HasSubstr("monitor.trolley.p comes from floor.person.p, though floor has trolley.p")));
  for (const std::string part : {"v", "quat", "w"}) {
    EXPECT_THAT(warnings_of(Cell().relink("floor", "trolley." + part, "monitor", "person." + part)),
                ElementsAre(HasSubstr("monitor.person." + part + " comes from floor.trolley." + part +
                                      ", but monitor.person.p from floor.person.p")));
    EXPECT_THAT(warnings_of(Cell().cut("monitor", "person." + part)), ElementsAre(HasSubstr("monitor.person." + part + " (")));
    EXPECT_THAT(
        warnings_of(
            Cell().cut("monitor", "person." + part).set("monitor", "person." + part, part == "quat" ? "1 0 0 0" : "0 0 0")),
        IsEmpty());
  }
  for (const auto& [x, i] : {std::pair{"p", 2}, {"p", 3}, {"v", 3}, {"quat", 4}}) {
    Cell mixed;
    mixed.cut("monitor", std::string("person.") + x);
    const std::string name = std::string(".") + x + "[";
    for (int k = 1; k <= (x == std::string("quat") ? 4 : 3); ++k)
      mixed.link("floor", (k == i ? "trolley" : "person") + name + std::to_string(k) + "]", "monitor",
                 "person" + name + std::to_string(k) + "]");
    EXPECT_THAT(warnings_of(mixed), ElementsAre(HasSubstr("monitor.person" + name + std::to_string(i) +
                                                          "] comes from floor.trolley." + x + ", but monitor.person.p")));
  }
  const Cell turned =
      Cell().relink("floor", "person.p", "monitor", "person.p", -1).relink("left", "dq_d", "monitor", "left.dq", 1e-3);
  EXPECT_THAT(notes_of(turned), AllOf(Contains(HasSubstr("monitor.person.p is -1 times floor.person.p plus 0")),
                                      Contains(HasSubstr("monitor.left.dq is 0.001 times left.dq_d plus 0"))));
  EXPECT_THAT(notes_of(Cell("separation=trolley")), Contains(HasSubstr("person moves and does not count")));
  EXPECT_THAT(warnings_of(Cell("separation=trolley")), IsEmpty());
  EXPECT_THAT(notes_of(Cell("separation=all")), Each(Not(HasSubstr("does not count"))));
}

TEST(SeparationLoop, OfARobotThatIgnoresABodyIsTold) {
  const auto left_ignores = [](const std::string& links) {
    std::string pairs;
    for (const std::string_view link : text::split(links, ','))
      text::append(pairs, "left/" + std::string(link) + ":person", ",");
    return warnings_of(Cell("separation=all&ignore=" + pairs));
  };
  EXPECT_THAT(left_ignores("forearm"), IsEmpty());
  EXPECT_THAT(left_ignores("upper_arm,forearm"), ElementsAre(HasSubstr("left keeps no separation from person")));
}

TEST(SeparationLoop, OfFiguresCountsEventsToo) {
  EXPECT_THAT(warnings_of(Cell().set("monitor", "left.T_s", "0.2")),
              ElementsAre(HasSubstr("monitor.left.T_s is 0.2 s, but left.speed_ramp is 0.25 s: the robot stops later than")));
  const auto with_event = [](const std::string& variable, const std::string& value, double t) {
    Cell cell;
    cell.event(t, variable, value);
    return cell;
  };
  EXPECT_THAT(warnings_of(with_event("monitor.left.T_s", "0.2", 1)),
              ElementsAre(HasSubstr("monitor.left.T_s is 0.2 s from 1 s on, but left.speed_ramp is 0.25 s")));
  EXPECT_THAT(warnings_of(with_event("monitor.left.T_s", "0.25", 1)), IsEmpty());
  EXPECT_THAT(warnings_of(with_event("monitor.right.S_s", "0", 1)),
              ElementsAre(HasSubstr("monitor.right.S_s is 0 m from 1 s on: no distance is counted for stopping")));
  EXPECT_THAT(notes_of(with_event("monitor.v_h", "0", 2)), Contains(HasSubstr("monitor.v_h is 0 from 2 s on")));
  EXPECT_THAT(notes_of(Cell().set("monitor", "T_r", "0")), Contains(HasSubstr("monitor.T_r is 0: no reaction time")));
  for (const std::string between : {"", "drive"}) {
    Cell all("separation=all", between);
    all.relink("monitor", "speed", "left", "speed").set("left", "speed_ramp", "2");
    EXPECT_THAT(warnings_of(all), ElementsAre(HasSubstr("but left.speed_ramp is 2 s"))) << "also for the speed of all";
  }
}

// Sources of a right scenario in another order: told, or the robots hear what they have to, and are where the monitor sees them.
TEST(SeparationLoop, OfPermutedConnectionsIsTold) {
  std::mt19937 random(116);
  int told = 0, right = 0;
  for (int k = 0; k < 300; ++k) {
    Cell cell;
    auto& links = cell.scenario.connections;
    const std::vector<ConnectionSpec> before = links;
    // As many as are exchanged by mistake, of one kind: others do not fit.
    for (int n = 0; n < 1 + k % 3; ++n) {
      const std::size_t i = random() % links.size(), j = random() % links.size();
      const auto kind = [](const Port& p) { return p.variable.substr(p.variable.rfind('.') + 1); };
      if (kind(links[i].from) == kind(links[j].from)) std::swap(links[i].from, links[j].from);
    }
    bool same = true;
    for (std::size_t i = 0; i < links.size(); ++i)
      same = same && links[i].from.component == before[i].from.component && links[i].from.variable == before[i].from.variable;
    const std::vector<std::string> warnings = warnings_of(cell);
    EXPECT_EQ(warnings.empty(), same) << k;
    ++(same ? right : told);
  }
  EXPECT_GT(told, 30);
  EXPECT_GT(right, 30);
}

}  // namespace
}  // namespace cotwin::master::separation_loop_test
