// Tools that come and go in a run (IV-A2): master/engine/tools.h.
#include "master/engine/tools.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "components/unit/snapshot.h"
#include "components/unit/unit_table.h"
#include "master/engine/wiring/wiring.h"
#include "master/run/master.h"
#include "master/scenario/scenario.h"
#include "master/twin/ssd_write.h"
#include "master/twin/twin.h"
#include "master/twin/twin_package.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::master::tools_test {
namespace {

using cotwin::testing::error_of;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// A scenario of units whose loops need no connections unless they are given.
struct Cell {
  std::string components, connections, events, master = "tick=\"1 ms\"";
  double stop = 0.4;

  Cell& unit(const std::string& name, const std::string& source, const std::map<std::string, std::string>& values = {}) {
    components += "<ssd:Component name=\"" + name + "\" type=\"application/x-cotwin-unit\" source=\"unit:" + source +
                  "\"><ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version=\"1.0\" "
                  "name=\"p\"><ssv:Parameters>";
    for (const auto& [variable, value] : values)
      components += "<ssv:Parameter name=\"" + variable + "\"><ssv:String value=\"" + value + "\"/></ssv:Parameter>";
    components +=
        "</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"
        "</ssd:Component>";
    return *this;
  }
  Cell& connect(const std::string& from, const std::string& to, const std::vector<std::string>& ports) {
    for (const std::string& port : ports)
      connections += "<ssd:Connection startElement=\"" + from + "\" startConnector=\"" + port + "\" endElement=\"" + to +
                     "\" endConnector=\"" + port + "\"/>";
    return *this;
  }
  /// Attributes of an event.
  Cell& event(const std::string& attributes) {
    events += "<cotwin:Event " + attributes + "/>\n";
    return *this;
  }
  Scenario scenario() const {
    return parse_scenario(
        R"(<ssd:SystemStructureDescription version="1.0" name="cell" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
        xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
        <ssd:System name="cell"><ssd:Elements>)" +
            components + "</ssd:Elements>" +
            (connections.empty() ? "" : "<ssd:Connections>" + connections + "</ssd:Connections>") +
            "</ssd:System><ssd:DefaultExperiment startTime=\"0\" stopTime=\"" + text::to_text(stop) +
            R"("/><ssd:Annotations><ssc:Annotation type="cotwin.master"><cotwin:Master xmlns:cotwin="urn:cotwin:master:1" )" +
            master + ">\n" + events + "</cotwin:Master></ssc:Annotation></ssd:Annotations></ssd:SystemStructureDescription>",
        "cell.ssd", "");
  }
  Master load(int threads = 1) const { return from(scenario(), threads); }
  static Master from(Scenario scenario, int threads = 1) {
    MasterOptions options;
    options.types = unit_types();
    options.folders = {places::source() + "/models"};
    options.threads = threads;
    options.always_threads = threads > 1;
    return {std::move(scenario), std::move(options)};
  }
};

std::span<double> values(Master& master, const std::string& name) { return find_signal(master.members(), name, "").reals(); }
std::vector<double> copy(std::span<const double> v) { return {v.begin(), v.end()}; }

/// All real variables of all components.
std::vector<double> everything(Master& master) {
  std::vector<double> all;
  for (const Member& member : master.members()) {
    for (const Variable& v : member.variables()) {
      if (v.kind() == Kind::kReal) all.insert(all.end(), v.reals().begin(), v.reals().end());
    }
  }
  return all;
}

void run(Master& master) {
  master.initialise();
  while (master.step_tick()) {
  }
}

constexpr const char* kGripper =
    R"(parent="tip" xyz="0.02 0.01 0" rpy="0.1 0.2 -0.3" mass="1.5" com="0.05 0 0.02" inertia="4e-3 1e-4 0 5e-3 2e-4 6e-3")";
std::string attach(double time, const std::string& more = "", const std::string& name = "gripper") {
  return "time=\"" + text::to_text(time) + "\" attach=\"" + name + "\" " + kGripper + " " + more;
}
std::string detach(double time, const std::string& more = "", const std::string& name = "gripper") {
  return "time=\"" + text::to_text(time) + "\" detach=\"" + name + "\" " + more;
}

robot::RobotModel planar() { return robot::load_urdf(places::source() + "/models/robots/planar2/robot.urdf"); }
robot::RobotModel with_gripper() {
  Scenario scenario = Cell().unit("d", "drive_train?robot=planar2").event(attach(0)).scenario();
  robot::RobotModel robot = planar();
  robot::attach(robot, attachment(scenario.tools.at(0)));
  return robot;
}

/// Links without friction that fall from a pose, under a constant torque.
const std::map<std::string, std::string> kFalling = {{"q0", "0.4 -0.9"}, {"dq0", "0.7 -0.3"}, {"tau_m", "6 -2"},
                                                     {"B", "0.2"},       {"K", "2000"},       {"tau_C", "0"},
                                                     {"tau_S", "0"},     {"sigma0", "0"},     {"sigma2", "0"}};
Cell falling() { return Cell().unit("drive", "drive_train?robot=planar2", kFalling); }

TEST(Tools, ChangeTheBodiesOfTheSimulatedRobotInTheirTick) {
  Master master = falling().event(attach(0.0995)).event(detach(0.2)).load();
  master.initialise();
  const std::vector<double> bare = copy(values(master, "drive.bodies"));
  const auto pi = with_gripper().bodies[1].inertia.parameters();
  while (master.step_tick()) {
    const bool mounted = master.tick() > 100 && master.tick() <= 200;
    const std::span<double> now = values(master, "drive.bodies");
    for (std::size_t k = 0; k < now.size(); ++k)
      ASSERT_EQ(now[k], mounted && k >= 10 ? pi[static_cast<Eigen::Index>(k) - 10] : bare[k]) << k << " at " << master.tick();
  }
  EXPECT_EQ(values(master, "drive.tool_changes")[0], 2);
}

TEST(Tools, ThatWereThereForATickAtRestLeaveNoTrace) {
  // Motors that hold nothing: no gravity, at rest. What is attached and detached does not move.
  const std::map<std::string, std::string> rest = {{"q0", "0.4 -0.9"}, {"transition", "0"}};
  Cell cell;
  cell.unit("drive", "drive_train?robot=planar2", rest);
  cell.events = "<cotwin:Event time=\"0.2\" variable=\"drive.tau_m\" value=\"5 1\"/>";
  Master never = cell.load(), twice = cell.event(attach(0.0)).event(detach(0.0)).load();
  run(never);
  run(twice);
  values(twice, "drive.tool_changes")[0] = values(twice, "drive.tool_changes_seen")[0] = 0;
  EXPECT_EQ(everything(never), everything(twice));
}

// A run in which the tool comes at t = 0.2 s goes on as the robot with the tool from the start, set to that state.
TEST(Tools, AfterwardsTheRobotIsThatOfAUrdfWithTheTool) {
  Cell cell = falling();
  cell.components.clear();
  const std::map<std::string, std::string> values_of_rigid = [&] {
    auto v = kFalling;
    v.erase("K");
    return v;
  }();
  cell.unit("drive", "drive_train?robot=planar2&amp;transmission=rigid&amp;friction=smooth", values_of_rigid);
  Master master = cell.event(attach(0.2)).load();
  master.initialise();
  while (master.tick() < 200) master.step_tick();
  const std::vector<double> q = copy(values(master, "drive.q")), dq = copy(values(master, "drive.dq"));
  const double energy = values(master, "drive.energy_kinetic")[0] + values(master, "drive.energy_potential")[0];
  while (master.step_tick()) {
  }
  const testing::TemporaryFolder folder("tools");
  const std::string urdf = (folder / "exported.urdf").string();
  std::ofstream(urdf) << robot::to_urdf(master.histories().at(0).robot);
  auto start = values_of_rigid;
  start["q0"] = text::to_text(q[0]) + " " + text::to_text(q[1]);
  start["dq0"] = text::to_text(dq[0]) + " " + text::to_text(dq[1]);
  Cell other;
  other.stop = 0.2;
  Master whole = other.unit("drive", "drive_train?robot=" + urdf + "&amp;transmission=rigid&amp;friction=smooth", start).load();
  whole.initialise();
  // The tool brings its energy along.
  const double jump = values(whole, "drive.energy_kinetic")[0] + values(whole, "drive.energy_potential")[0] - energy;
  EXPECT_NEAR(values(master, "drive.energy_bodies")[0], jump, 1e-9 * std::abs(jump));
  EXPECT_GT(std::abs(jump), 1);
  while (whole.step_tick()) {
  }
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_NEAR(values(master, "drive.q")[i], values(whole, "drive.q")[i], 1e-9);
    EXPECT_NEAR(values(master, "drive.dq")[i], values(whole, "drive.dq")[i], 1e-8);
    EXPECT_NEAR(values(master, "drive.ddq")[i], values(whole, "drive.ddq")[i], 1e-6);
  }
}

TEST(Tools, KeepTheEnergyAccount) {
  Master master = falling().event(attach(0.1)).event(attach(0.1, "", "second")).event(detach(0.25)).load();
  master.initialise();
  const auto balance = [&] {
    double sum = 0;
    for (const char* name : {"energy_kinetic", "energy_potential", "energy_elastic", "energy_dissipated"})
      sum += values(master, std::string("drive.") + name)[0];
    for (const char* name : {"work_m", "work_e", "energy_bodies"}) sum -= values(master, std::string("drive.") + name)[0];
    return sum;
  };
  const double start = balance();
  double least = 0, most = 0;
  while (master.step_tick()) {
    EXPECT_NEAR(balance(), start, 1e-5) << master.tick();
    least = std::min(least, values(master, "drive.energy_bodies")[0]);
    most = std::max(most, values(master, "drive.energy_bodies")[0]);
  }
  EXPECT_GT(most - least, 5);  // J
}

Cell controlled(const std::string& robot = "planar2") {
  Cell cell;
  cell.unit("compliance", "compliance?robot=" + robot, {{"q_d", "0.4 -0.9"}})
      .unit("drive", "drive_train?robot=" + robot, {{"q0", "0.4 -0.9"}})
      .connect("compliance", "drive", {"tau_m"})
      .connect("drive", "compliance", {"q", "dq", "theta", "dtheta"});
  cell.events = "<cotwin:Component name=\"compliance\" stage=\"1\"/><cotwin:Component name=\"drive\" stage=\"2\"/>";
  return cell;
}

TEST(Tools, AreFollowedByTheControllerWithItsTransition) {
  Master master = controlled().event(attach(0.1)).load();
  master.initialise();
  const auto mass = [&](const char* unit) { return values(master, std::string(unit) + ".bodies")[10]; };
  while (master.tick() < 151) master.step_tick();
  EXPECT_EQ(mass("drive"), 5.5);
  EXPECT_NEAR(mass("compliance"), 5.5 - 1.5 * std::exp(-0.051 / 0.05), 1e-9);
  while (master.step_tick()) {
  }
  EXPECT_NEAR(mass("compliance"), 5.5, 1.5 * std::exp(-0.29 / 0.05));
  EXPECT_THAT(master.summary().notes, ::testing::Contains("tool 'gripper' attached to 'tip' at 0.1 s in compliance, drive"));
}

TEST(Tools, ThatNobodyKnowsReachOnlyTheSimulatedRobot) {
  Master known = controlled().event(attach(0.1)).load(), unknown = controlled().event(attach(0.1, "known=\"false\"")).load();
  run(known);
  run(unknown);
  EXPECT_EQ(values(unknown, "compliance.mass")[1], 4);
  EXPECT_EQ(values(unknown, "drive.mass")[1], 5.5);
  // Gravity pulls the arm down by the tool that the controller does not hold.
  const auto sag = [](Master& master) { return 0.4 + -0.9 - values(master, "drive.q")[0] - values(master, "drive.q")[1]; };
  EXPECT_GT(sag(unknown), 3 * std::abs(sag(known)));
  EXPECT_EQ(unknown.histories().size(), 1u);
  EXPECT_THAT(unknown.histories()[0].components, ElementsAre("drive"));
  EXPECT_THAT(known.histories()[0].components, ElementsAre("compliance", "drive"));
}

TEST(Tools, GiveTheSameBitsOnAnyNumberOfThreadsAndInTheTwin) {
  Cell cell = controlled();
  cell.unit("second", "drive_train?robot=planar2", kFalling).unit("third", "drive_train?robot=planar2", kFalling);
  cell.event(attach(0.1)).event(attach(0.15, "components=\"second third\"", "extra")).event(detach(0.3));
  Master one = cell.load(1), again = cell.load(1), eight = cell.load(8);
  run(one);
  run(again);
  run(eight);
  EXPECT_EQ(everything(one), everything(again));
  EXPECT_EQ(everything(one), everything(eight));

  const Scenario scenario = cell.scenario();
  TwinPackage package;
  package.scenario = scenario;
  package.packages.resize(scenario.components.size());
  const TwinPackage read = deserialise_twin(serialise(package), "scenario.bin");
  Scenario packed = scenario;
  packed.tools = read.scenario.tools;
  Twin twin(packed, load_members(scenario, unit_types(), {places::source() + "/models"}), {});
  Variables variables;
  twin.declare(variables);
  twin.initialise(Time{});
  std::vector<Snapshot> saved(1);
  const auto step = [&](int i) { EXPECT_EQ(twin.step(Time{i * 1'000'000}, Duration{1'000'000}), StepResult::kDone); };
  for (int i = 0; i < 400; ++i) {
    if (i == 50) saved[0].take(variables, twin);
    step(i);
  }
  const auto check = [&] {
    for (const Member& member : one.members()) {
      for (const Variable& v : member.variables()) {
        if (v.kind() != Kind::kReal) continue;
        const std::string name = member.name() + "." + v.name;
        EXPECT_EQ(copy(v.reals()), copy(variables.at(name).reals())) << name;
      }
    }
  };
  check();
  saved[0].restore(variables, twin);  // before the first event
  for (int i = 50; i < 400; ++i) step(i);
  check();
}

TEST(Tools, ComeInAStepThatIsRepeatedToATolerance) {
  Cell cell = controlled();
  cell.master = "tick=\"10 ms\" tolerance=\"1e-4\"";
  Master master = cell.event(attach(0.1037)).load();
  run(master);
  Cell fine = controlled();
  fine.master = "tick=\"0.1 ms\"";
  Master reference = fine.event(attach(0.1037)).load();
  run(reference);
  for (std::size_t i = 0; i < 2; ++i) EXPECT_NEAR(values(master, "drive.q")[i], values(reference, "drive.q")[i], 2e-4);
  EXPECT_EQ(values(master, "drive.bodies")[10], 5.5);
}

TEST(Tools, AllocateNothingInAStep) {
  Master master = controlled().event(attach(0.1)).event(detach(0.2)).load();
  master.initialise();
  for (int i = 0; i < 50; ++i) master.step_tick();
  const std::uint64_t before = testing::allocations();
  for (int i = 0; i < 250; ++i) master.step_tick();
  EXPECT_EQ(testing::allocations() - before, 0u);
}

// The same tool on the links of the contact world and on those of the drive train, both without motors.
void compare_world_with_equations(const std::string& method) {
  SCOPED_TRACE(method);
  Cell cell;
  cell.master = "tick=\"10 us\"";
  cell.stop = 0.002;
  cell.unit("world", "contact_world?robot=planar2&amp;link_side=outside&amp;method=" + method,
            {{"q0", "0.4 -0.9"}, {"dq0", "0.7 -0.3"}, {"K", "0"}});
  Master master = cell.event(attach(0.001)).event(detach(0.0015)).load();
  master.initialise();
  const auto expected = [&](const robot::RobotModel& robot) {
    const robot::Mechanism mechanism(robot);
    robot::Data data(mechanism);
    const auto vector = [&](const char* name) { return Eigen::Map<Eigen::VectorXd>(values(master, name).data(), 2); };
    Eigen::VectorXd ddq(2);
    robot::forward_dynamics(mechanism, data, vector("world.q"), vector("world.dq"), Eigen::VectorXd::Zero(2), ddq);
    return ddq;
  };
  const robot::RobotModel bare = planar(), loaded = with_gripper();
  while (master.tick() < 200) {
    const bool mounted = master.tick() >= 100 && master.tick() < 150;
    const Eigen::VectorXd before = expected(mounted ? loaded : bare);
    const std::vector<double> dq = copy(values(master, "world.dq"));
    master.step_tick();
    for (std::size_t i = 0; i < 2; ++i) {
      const double mean = (values(master, "world.dq")[i] - dq[i]) / 1e-5;
      EXPECT_NEAR(mean, before[static_cast<Eigen::Index>(i)], 1e-3 * before.norm()) << master.tick();
    }
  }
  EXPECT_GT((expected(loaded) - expected(bare)).norm(), 0.01 * expected(bare).norm());
}

TEST(Tools, GiveTheContactWorldTheAccelerationOfTheEquationsOfMotion) {
  for (const char* method : {"tree", "dantzig"}) compare_world_with_equations(method);
}

// A ball of 20 mm in front of the tip of an arm without shapes, which falls on a floor.
TEST(Tools, TouchWithTheShapesOfTheirFileWhileTheyAreThere) {
  const testing::TemporaryFolder folder("tools");
  const std::string ball = folder.write("ball.urdf", R"(<robot name="ball"><link name="flange"/><link name="centre"><inertial>
      <mass value="0.5"/><inertia ixx="8e-5" ixy="0" ixz="0" iyy="8e-5" iyz="0" izz="8e-5"/></inertial>
      <collision><geometry><sphere radius="0.02"/></geometry></collision></link>
      <joint name="j" type="fixed"><parent link="flange"/><child link="centre"/><origin xyz="0.03 0 0"/></joint></robot>)");
  const auto cell_with = [&](const std::string& events) {
    Cell cell;
    cell.unit(
        "world",
        "contact_world?robot=planar2&amp;link_side=outside&amp;scene=" + places::source() + "/tests/components/data/floor.sdf",
        {{"q0", "-0.4 -0.3"}, {"K", "0"}});
    cell.events = events;
    cell.stop = 0.4;
    return cell;
  };
  // Height of the ball's centre over the floor, and whether a robot's link touches it (after the scene's two bodies and the base).
  const auto height = [](Master& master) {
    const std::span<double> q = values(master, "world.q");
    return 0.5 + 0.4 * std::sin(q[0]) + 0.38 * std::sin(q[0] + q[1]);
  };
  const auto touches = [](Master& master) {
    const auto bodies = find_signal(master.members(), "world.contact_bodies", "").variable->integers();
    return std::any_of(bodies.begin(), bodies.end(), [](std::int32_t body) { return body > 3; });
  };
  const std::string tool = "<cotwin:Event time=\"0.01\" attach=\"ball-1\" parent=\"tip\" file=\"" + ball + "\"/>";
  Master touching = cell_with(tool).load();
  touching.initialise();
  EXPECT_EQ(values(touching, "world.tool.ball_1")[0], 0);
  double least = 1;
  bool touched = false;
  while (touching.step_tick()) {
    least = std::min(least, height(touching));
    touched = touched || touches(touching);
  }
  EXPECT_TRUE(touched);
  EXPECT_NEAR(least, 0.02, 1e-3);
  EXPECT_EQ(values(touching, "world.mass")[1], 4.5);

  const std::string removed = tool + "<cotwin:Event time=\"0.02\" detach=\"ball-1\"/>";
  for (const std::string& events : {removed, std::string()}) {
    Master through = cell_with(events).load();
    through.initialise();
    while (through.step_tick()) EXPECT_FALSE(touches(through));
    EXPECT_LT(height(through), -0.1);
  }
  const std::string elsewhere =
      tool + "<cotwin:Event time=\"0.03\" attach=\"ball-1\" parent=\"upper_arm\" file=\"" + ball + "\"/>";
  EXPECT_THAT(error_of([&] { cell_with(elsewhere).load(); }), HasSubstr("is attached at two places"));
}

// The ball in front of the tip of an arm above a floor, as above. The monitor has no bodies that change, but the shapes of the tool.
TEST(Tools, AreSeenByAMonitorWhileTheyAreThere) {
  const testing::TemporaryFolder folder("tools");
  const std::string ball = folder.write("ball.urdf", R"(<robot name="ball"><link name="flange"/><link name="centre"><inertial>
      <mass value="0.5"/><inertia ixx="8e-5" ixy="0" ixz="0" iyy="8e-5" iyz="0" izz="8e-5"/></inertial>
      <collision><geometry><sphere radius="0.02"/></geometry></collision></link>
      <joint name="j" type="fixed"><parent link="flange"/><child link="centre"/><origin xyz="0.03 0 0"/></joint></robot>)");
  for (const char* components : {"", " components=\"drive monitor\"", " components=\"drive\""}) {
    Cell cell = falling();
    cell.unit("monitor", "monitor?robot=planar2&amp;scene=" + places::source() + "/tests/components/data/floor.sdf",
              {{"q", "0 -1.2"}});
    cell.event("time=\"0.01\" attach=\"ball-1\" parent=\"tip\" file=\"" + ball + "\"" + components);
    cell.event("time=\"0.02\" detach=\"ball-1\"" + std::string(components));
    cell.stop = 0.03;
    Master master = cell.load();
    master.initialise();
    const double bare = values(master, "monitor.distance")[0], with_ball = 0.5 + 0.38 * std::sin(-1.2) - 0.02;
    EXPECT_GT(bare, with_ball + 0.001);
    while (master.step_tick()) {
      const double t = master.now().seconds();
      const bool there = t > 0.0105 && t < 0.0205 && std::string(components) != " components=\"drive\"";
      EXPECT_NEAR(values(master, "monitor.distance")[0], there ? with_ball : bare, 1e-9) << t << components;
    }
  }
}

TEST(Tools, ReachARobotOfAWorldByItsName) {
  Cell cell;
  cell.unit("world", "contact_world?robots=left:planar2,right:planar2&amp;link_side=outside",
            {{"left.q0", "0.4 -0.9"}, {"right.q0", "0.4 -0.9"}, {"right.base_p0", "0 2 0"}, {"left.K", "0"}, {"right.K", "0"}});
  cell.stop = 0.1;
  Master master = cell.event(attach(0.01, "components=\"world.left\"")).load();
  run(master);
  EXPECT_EQ(values(master, "world.left.mass")[1], 5.5);
  EXPECT_EQ(values(master, "world.right.mass")[1], 4);
  EXPECT_NE(values(master, "world.left.q")[1], values(master, "world.right.q")[1]);
  Cell both = cell;
  both.events.clear();
  EXPECT_THAT(error_of([&] { both.event(attach(0.01, "components=\"world\"")).load(); }), HasSubstr("as in 'world.left'"));
}

TEST(Tools, TellWhichJointCannotCarryThem) {
  Cell cell = controlled();
  cell.event("time=\"0.1\" attach=\"anvil\" parent=\"tip\" mass=\"25\" com=\"0.1 0 0\"");
  Master master = cell.load();
  run(master);
  // 9.81 · (6 · 0.2 + 29 · 0.4) · cos 0.4 + 9.81 · (4 · 0.175 + 25 · 0.45) · cos 0.5 = 218.5 N.m; the arm has not moved
  EXPECT_THAT(master.warnings(),
              ::testing::Contains(HasSubstr("'drive' cannot be held in its pose at 0.1 s: joint 'shoulder' needs 218.5 N.m")));
  Master light = controlled().event(attach(0.1)).load();
  run(light);
  EXPECT_THAT(light.warnings(), ::testing::Not(::testing::Contains(HasSubstr("cannot be held"))));
}

// Steps, energy account and history of SUNDIALS begin anew with the changed bodies.
TEST(Tools, ReachASimulatedRobotOfAnySolver) {
  const auto cell_with = [](const std::string& method) {
    auto values = kFalling;
    values["rtol"] = "1e-9";
    values["atol"] = "1e-12";
    Cell cell;
    cell.unit("drive", "drive_train?robot=planar2&amp;method=" + method, values).event(attach(0.1)).event(detach(0.25));
    return cell;
  };
  Master exact = cell_with("rosenbrock").load();
  run(exact);
  for (const char* method : {"cvode"}) {
    Master master = cell_with(method).load();
    run(master);
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_NEAR(values(master, "drive.q")[i], values(exact, "drive.q")[i], 2e-5) << method;
      EXPECT_NEAR(values(master, "drive.dq")[i], values(exact, "drive.dq")[i], 2e-4) << method;
    }
    const auto value = [&](const char* name) { return values(master, std::string("drive.") + name)[0]; };
    EXPECT_NEAR(value("energy_bodies"), values(exact, "drive.energy_bodies")[0], 1e-4) << method;
    EXPECT_GT(std::abs(value("energy_bodies")), 0.01) << method;
    EXPECT_EQ(value("tool_changes"), 2) << method;
    // Restored between the two events, it continues to the same bits.
    Twin twin(cell_with(method).scenario(),
              load_members(cell_with(method).scenario(), unit_types(), {places::source() + "/models"}), {});
    Variables variables;
    twin.declare(variables);
    twin.initialise(Time{});
    const auto steps = [&](int first, int end) {
      for (int i = first; i < end; ++i) ASSERT_EQ(twin.step(Time{i * 1'000'000}, Duration{1'000'000}), StepResult::kDone);
    };
    std::vector<Snapshot> saved(2);
    steps(0, 110);
    saved[0].take(variables, twin);
    steps(110, 400);
    const std::vector<double> end = copy(variables.at("drive.q").reals());
    saved[0].restore(variables, twin);
    steps(110, 400);
    EXPECT_EQ(copy(variables.at("drive.q").reals()), end) << method;
    EXPECT_EQ(end, copy(values(master, "drive.q"))) << method;
  }
}

// Nothing of the run changes; the base of the history has the tool.
TEST(Tools, OnAFixedBaseAreOnlyInTheHistory) {
  const std::string cabinet =
      "time=\"0.1\" attach=\"cabinet\" parent=\"base\" xyz=\"1 0 0\" mass=\"20\" inertia=\"1 0 0 1 0 1\"";
  const std::string lamp = "time=\"0.2\" attach=\"lamp\" parent=\"cabinet\"";
  Master bare = controlled().load(), master = controlled().event(cabinet).event(lamp).load();
  run(bare);
  run(master);
  EXPECT_EQ(everything(master), everything(bare));
  const auto histories = master.histories();
  ASSERT_EQ(histories.size(), 1u);
  EXPECT_EQ(histories[0].robot.history.size(), 2u);
  EXPECT_EQ(histories[0].robot.base.inertia.mass, planar().base.inertia.mass + 20);
  EXPECT_EQ(histories[0].robot.bodies, planar().bodies);
}

TEST(Tools, ThatCannotBeMountedAreOneErrorBeforeTheRun) {
  const auto refusal = [](const std::string& one, const std::string& two = "") {
    return error_of([&] {
      Cell cell = controlled();
      cell.event(one);
      if (!two.empty()) cell.event(two);
      cell.load();
    });
  };
  const auto with = [](const std::string& attributes) { return "time=\"0.1\" attach=\"gripper\" " + attributes; };
  EXPECT_THAT(refusal(with("parent=\"hand\" mass=\"1\"")),
              HasSubstr("cell.ssd:4: attach 'gripper' at 0.1 s to 'compliance': "));
  EXPECT_THAT(refusal(with("parent=\"tip\" mass=\"1\" inertia=\"1 0 0 0.1 0 0.1\"")), HasSubstr("triangle inequality"));
  EXPECT_THAT(refusal(with("parent=\"tip\" mass=\"-1\"")), HasSubstr("'mass' of 'Event': -1, expected"));
  EXPECT_THAT(refusal(with("parent=\"tip\" com=\"1 2\"")), HasSubstr("expected 3 finite numbers"));
  EXPECT_THAT(refusal(with("parent=\"tip\" file=\"no.urdf\"")), HasSubstr("tool 'gripper': no.urdf: cannot be read"));
  EXPECT_THAT(refusal(with("parent=\"tip\" colour=\"red\"")), HasSubstr("colour"));
  EXPECT_THAT(refusal(with("mass=\"1\"")), HasSubstr("parent"));
  EXPECT_THAT(refusal(attach(0.1), attach(0.2)), HasSubstr("the robot already has a frame with this name"));
  EXPECT_THAT(refusal(attach(0.1), attach(0.1)), HasSubstr("the robot already has a frame with this name"));
  EXPECT_THAT(refusal(detach(0.1)), HasSubstr("no tool 'gripper' is attached at 0.1 s"));
  EXPECT_THAT(refusal(attach(0.2), detach(0.1)), HasSubstr("no tool 'gripper' is attached at 0.1 s"));
  const std::string on_top = "time=\"0.2\" attach=\"bit\" parent=\"gripper\" mass=\"0.1\"";
  EXPECT_THAT(error_of([&] { controlled().event(attach(0.1)).event(on_top).event(detach(0.3)).load(); }),
              HasSubstr("'bit' is mounted on 'gripper'; detach it first"));
  EXPECT_THAT(refusal(attach(0.1, "robot=\"lwr4\"")), HasSubstr("no component has the robot 'lwr4'"));
  EXPECT_THAT(refusal(attach(0.1, "components=\"drives\"")), HasSubstr("did you mean 'drive'"));
  EXPECT_THAT(refusal(attach(0.1, "components=\"compliance\" known=\"false\"")), HasSubstr("does not simulate the robot"));
  EXPECT_THAT(refusal(attach(0.1), "time=\"0.2\" variable=\"drive.mass[2]\" value=\"5\""),
              HasSubstr("event on 'drive.mass[2]', which the scenario's attach and detach events change"));
  const std::string on_base = with("parent=\"base\" mass=\"1\" inertia=\"1 0 0 1 0 1\"");
  EXPECT_THAT(error_of([&] {
                Cell().unit("drive", "drive_train?robot=lwr4&amp;base=floating", {{"q0", "0"}}).event(on_base).load();
              }),
              HasSubstr("'base' is on the floating base, whose mass cannot change in a run: expected a robot with the tool"));
  EXPECT_THAT(error_of([&] {
                Cell cell = controlled();
                cell.unit("arm", "drive_train?robot=lwr4", {{"q0", "0"}}).event(attach(0.1)).load();
              }),
              HasSubstr("expected robot or components"));
  EXPECT_THAT(error_of([] { Cell().unit("m", "motion?kind=waypoints&amp;points=2&amp;joints=2").event(attach(0.1)).load(); }),
              HasSubstr("no component has a robot with tunable bodies"));
}

TEST(Tools, OfTheCommandLineAreEventsOfTheScenario) {
  Scenario scenario = controlled().scenario();
  add_tool_event(scenario, false, "gripper@0.3");
  add_tool_event(scenario, true, "gripper, parent=tip,mass=0.8,com=0 0 0.05,inertia=1e-3 0 0 1e-3 0 1e-3,known=false@200 ms");
  ASSERT_EQ(scenario.tools.size(), 2u);
  EXPECT_EQ(scenario.tools[0].time, Time{200'000'000});
  EXPECT_EQ(scenario.tools[0].mass, 0.8);
  EXPECT_FALSE(scenario.tools[0].known);
  EXPECT_EQ(scenario.tools[0].com[2], 0.05);
  Master master = Cell::from(scenario);
  run(master);
  EXPECT_EQ(master.histories().at(0).robot.history.size(), 2u);
  const auto refusal = [&](bool attaches, const char* text) {
    return error_of([&] { add_tool_event(scenario, attaches, text); });
  };
  EXPECT_THAT(refusal(true, "gripper,parent=tip"),
              HasSubstr("--attach gripper,parent=tip: has no time, expected NAME,parent="));
  EXPECT_THAT(refusal(true, "gripper,parent=tip,weight=1@2"), HasSubstr("weight"));
  EXPECT_THAT(refusal(true, "gripper,parent=tip,parent=tip@2"), HasSubstr("'parent' stands there twice"));
  EXPECT_THAT(refusal(true, "gripper,parent=tip@soon"), HasSubstr("expected a time such as"));
  EXPECT_THAT(refusal(false, "@2"), HasSubstr("without the name of a tool"));
  EXPECT_THAT(refusal(false, "gripper,parent=tip@2"), HasSubstr("parent"));
}

TEST(Tools, AreWrittenIntoAPackageAndReadBack) {
  Cell cell = controlled();
  cell.events =
      "<cotwin:Event time=\"0.1\" attach=\"a\" parent=\"tip\" xyz=\"0.1 0 1e-3\" rpy=\"0.1 0.2 0.3\" mass=\"0.7\" com=\"0 "
      "0.01 0\" inertia=\"1e-3 1e-5 0 2e-3 0 1.5e-3\" known=\"false\" reason=\"to &lt;see&gt;\"><cotwin:Frame name=\"b\" "
      "xyz=\"0 0 0.1\" rpy=\"0 1 0\"/></cotwin:Event>";
  cell.event("time=\"0.3\" detach=\"a\" components=\"drive\"");
  const Scenario scenario = cell.scenario();
  const std::vector<Member> members = load_members(scenario, unit_types(), {places::source() + "/models"});
  const std::vector<PackedComponent> components(members.size(), PackedComponent{"resources/x.fmu", ""});
  const Scenario back =
      parse_scenario(to_ssd(scenario, members, resolve_connections(scenario, members), components, false), "x", "");
  ASSERT_EQ(back.tools.size(), 2u);
  EXPECT_EQ(back.tools[0].frames.at(0).rpy, scenario.tools[0].frames.at(0).rpy);
  EXPECT_EQ(back.tools[0].reason, "to <see>");
  EXPECT_FALSE(back.tools[0].known);
  EXPECT_EQ(attachment(back.tools[0]).inertia, attachment(scenario.tools[0]).inertia);
  EXPECT_EQ(attachment(back.tools[0]).X_PA, attachment(scenario.tools[0]).X_PA);
  EXPECT_THAT(back.tools[1].components, ElementsAre("drive"));
}

TEST(Tools, AreInTheHistoryAsFarAsTheRunHasCome) {
  Master master = falling().event(attach(0.1, "reason=\"pick\"")).event(detach(0.3)).load();
  master.initialise();
  while (master.tick() < 100) master.step_tick();
  EXPECT_THAT(master.histories(), IsEmpty());
  master.step_tick();
  ASSERT_EQ(master.histories().size(), 1u);
  const robot::RobotHistory history = master.histories()[0];
  EXPECT_EQ(history.name, "planar2");
  EXPECT_EQ(history.robot.bodies, with_gripper().bodies);
  EXPECT_EQ(history.robot.history[0].time, 0.1);
  EXPECT_EQ(history.robot.history[0].reason, "pick");
  EXPECT_EQ(robot::parse_history(robot::to_json(master.histories()), "h.json"), master.histories());
  while (master.step_tick()) {
  }
  EXPECT_EQ(master.histories()[0].robot.bodies, planar().bodies);
}

}  // namespace
}  // namespace cotwin::master::tools_test
