// Contact world and drive train coupled by the master: the connections do what the unit tests copy by hand.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>

#include "components/unit/unit_table.h"
#include "master/engine/wiring/members.h"
#include "master/run/master.h"
#include "master/scenario/scenario.h"
#include "master/twin/twin.h"
#include "tests/support/places.h"
#include "tests/support/synthetic_log.h"

namespace cotwin::master::contact_scenario_test {
namespace {

/// An arm of two links, whose tip is a ball of 20 mm, falls on a floor without restitution; `tick` with its unit.
std::string scenario(const std::string& tick) {
  const std::string data = places::source() + "/tests/components/data/",
                    pusher = "robot=" + data + "pusher.urdf&amp;link_side=inside";
  const auto connection = [](const std::string& from, const std::string& to, const std::string& port) {
    return "<ssd:Connection startElement=\"" + from + "\" startConnector=\"" + port + "\" endElement=\"" + to +
           "\" endConnector=\"" + port + "\"/>";
  };
  const auto values = [](const std::string& parameters) {
    return R"(<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="p">
      <ssv:Parameters>)" +
           parameters +
           "</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>";
  };
  const auto value = [](const std::string& name, const std::string& type, const std::string& text) {
    return "<ssv:Parameter name=\"" + name + "\"><ssv:" + type + " value=\"" + text + "\"/></ssv:Parameter>";
  };
  const std::string gears = value("K", "Real", "1e4") + value("D", "Real", "20");
  return R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="fall" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="fall"><ssd:Elements>
    <ssd:Component name="world" type="application/x-cotwin-unit" source="unit:contact_world?)" +
         pusher + "&amp;scene=" + data + R"(floor.sdf">)" + values(gears) + R"(</ssd:Component>
    <ssd:Component name="robot" type="application/x-cotwin-unit" source="unit:drive_train?)" +
         pusher + "\">" +
         values(gears + value("q0", "String", "-0.4 -0.6") + value("B", "Real", "0.5") + value("sigma2", "Real", "20") +
                value("tau_m", "String", "5 2")) +
         "</ssd:Component></ssd:Elements><ssd:Connections>" + connection("robot", "world", "q") +
         connection("robot", "world", "dq") + connection("robot", "world", "tau_J") + connection("robot", "world", "dtheta") +
         connection("world", "robot", "tau_e") +
         R"(</ssd:Connections></ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="1"/>
  <ssd:Annotations><ssc:Annotation type="cotwin.master"><cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick=")" +
         tick + R"("><cotwin:Component name="world" stage="0"/><cotwin:Component name="robot" stage="1"/></cotwin:Master>
  </ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>)";
}

struct Fall {
  double before = 0,
         after = 0;  // m/s, speed of the tip along z at the impact, and the largest upward speed in the 20 ms afterwards
  double rest = 0;   // N, vertical contact force at the end, mean of 0.1 s
};

Fall fall(const std::string& tick, double h) {
  const testing::TemporaryFolder folder("contact_scenario");
  const std::string file = (folder / "fall.ssd").string();
  std::ofstream(file) << scenario(tick);
  const Scenario read = load_scenario(file);
  Twin twin(read, load_members(read, unit_types(), {}), {"robot.q", "robot.dq", "world.contacts", "world.f_c"});
  Variables variables;
  twin.declare(variables);
  twin.initialise(Time{});
  const auto q = variables.at("robot.q").reals(), dq = variables.at("robot.dq").reals(), f = variables.at("world.f_c").reals();
  const auto dz = [&] { return 0.4 * std::cos(q[0]) * dq[0] + 0.35 * std::cos(q[0] + q[1]) * (dq[0] + dq[1]); };
  Fall out;
  const Duration step = Duration::from_seconds(h);
  const int end = static_cast<int>(std::lround(1.0 / h)), last = static_cast<int>(std::lround(0.1 / h));
  int struck = -1;
  for (int i = 0; i < end; ++i) {
    const double speed = dz();
    EXPECT_EQ(twin.step(Time{i * step.ns}, step), StepResult::kDone);
    if (struck < 0 && variables.at("world.contacts").integers()[0] > 0 && f[2] > 0) {
      struck = i;
      out.before = speed;
      out.after = dz();
    }
    if (struck >= 0 && (i - struck) * h < 0.02) out.after = std::max(out.after, dz());
    if (i >= end - last) out.rest += f[2] / last;
  }
  return out;
}

// The torque of a contact is a mean over the same step of the drive train. As a ramp from the last value, half of it would be
// missing: half of the speed would remain, and the tip would bounce with 0.5.
TEST(ContactScenario, AnInelasticFallDoesNotBounceWhateverTheTick) {
  for (const auto& [tick, h] : {std::pair{"1 ms", 1e-3}, {"0.1 ms", 1e-4}}) {
    SCOPED_TRACE(tick);
    const Fall tip = fall(tick, h);
    EXPECT_LT(tip.before, -0.3);
    EXPECT_LT(tip.after, 0.02 * -tip.before);
    EXPECT_GT(tip.rest, 5);
  }
}

/// A hand lifts the block of example 10, moves it, and puts it down, in a solved loop with the world.
Scenario hand_on_block(const std::string& folder) {
  std::string connections;
  const auto connect = [&](const std::string& from, const std::string& to) {
    const auto half = [](const std::string& end, const std::string& side) {
      const std::size_t dot = end.find('.');
      return " " + side + "Element=\"" + end.substr(0, dot) + "\" " + side + "Connector=\"" + end.substr(dot + 1) + "\"";
    };
    connections += "<ssd:Connection" + half(from, "start") + half(to, "end") + "/>";
  };
  for (const std::string state : {"p", "v", "quat", "w"}) connect("world.block." + state, "hand." + state);
  connect("hand.f", "world.block.f");
  connect("hand.m", "world.block.m");
  const std::string file = folder + "/hand.ssd";
  std::ofstream(file) << R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="hand" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssd:System name="hand"><ssd:Elements>
    <ssd:Component name="hand" type="application/x-cotwin-unit" source="unit:operator_hand?moment=true&amp;points=4&amp;history=10"/>
    <ssd:Component name="world" type="application/x-cotwin-unit" source="unit:contact_world?scene=)" +
                             places::source() + R"(/examples/10_cooperation/cell.sdf"/>
  </ssd:Elements><ssd:Connections>)" +
                             connections + R"(</ssd:Connections></ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="2.3"/>
  <ssd:Annotations><ssc:Annotation type="cotwin.master">
    <cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="1 ms" coupling="implicit"/>
  </ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>)";
  Scenario scenario = load_scenario(file);
  for (const char* value :
       {"hand.waypoint_t=0.4 0.8 1.8 2.2", "hand.waypoint_p=0 0 0  0 0 0.02  0 0.2 0.02  0 0.2 0", "hand.m_h=0.7",
        "hand.D_h=20", "hand.K_r=2", "hand.D_r=0.05", "hand.D_g=150", "hand.reaction_delay=0"}) {
    assign(scenario, value, unit_types());
  }
  return scenario;
}

// The impulses of contacts end at a residual of 1e-9 m/s, so that the block's angular velocity is known to some 1e-8 rad/s. The loop asked for
// 1e-11 rad/s when the block struck the table: no division of the step helped, and the run ended.
TEST(ContactScenario, ASolvedLoopEndsAtTheNoiseOfItsContacts) {
  const testing::TemporaryFolder folder("contact_scenario");
  MasterOptions options;
  options.types = unit_types();
  Master master(hand_on_block(folder.path().string()), std::move(options));
  const auto p = find_real_signal(master.members(), "world.block.p", "").reals();
  master.initialise();
  while (master.step_tick()) {
  }
  EXPECT_NEAR(p[2], -0.11, 1e-6) << "on the table";
  EXPECT_NEAR(p[1], 0.2, 1e-3) << "where the hand put it";
  const Summary summary = master.summary();
  ASSERT_EQ(summary.loops.size(), 1u);
  EXPECT_LT(summary.loops[0].counts.divided, 10) << "22 before it ended";
}

}  // namespace
}  // namespace cotwin::master::contact_scenario_test
