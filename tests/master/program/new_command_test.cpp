// cotwin new: the scenarios that it writes run unchanged and do what their comments say.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/recording.h"
#include "tests/support/run_program.h"

namespace new_command_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::read_recording;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;
using ::testing::HasSubstr;
using ::testing::Not;

RunResult make(const TemporaryFolder& folder, std::vector<std::string> options) {
  options.insert(options.begin(), "new");
  return run_program(std::move(options), {.folder = folder.path()});
}

/// Runs a scenario; its summary. An empty object if it fails.
nlohmann::json run(const TemporaryFolder& folder, const std::string& scenario) {
  const RunResult result = run_program(
      {"run", scenario, "--out", "results", "--overwrite", "--quiet", "--json", "summary.json"}, {.folder = folder.path()});
  EXPECT_EQ(result.code, 0) << result.err;
  if (result.code != 0) return nlohmann::json::object();
  return nlohmann::json::parse(content(folder / "summary.json"));
}

/// The largest number of a report over all joints, of rad and m alike.
double largest(const nlohmann::json& summary, const std::string& report) {
  for (const nlohmann::json& signal : summary.value("signals", nlohmann::json::array())) {
    if (signal.at("name") != report) continue;
    const auto most = signal.at("max").get<std::vector<double>>();
    return *std::max_element(most.begin(), most.end());
  }
  ADD_FAILURE() << "no report " << report;
  return NAN;
}

double at_time(const std::map<std::string, std::vector<double>>& columns, const std::string& name, double t) {
  const std::vector<double>& times = columns.at("time");
  const auto row = std::lower_bound(times.begin(), times.end(), t - 1e-6) - times.begin();
  return columns.at(name).at(static_cast<std::size_t>(row));
}

/// The joints follow the compliant motion. Rigid and known drives have errors below 1 mrad, or 1 mm.
void expect_tracking(const nlohmann::json& summary) { EXPECT_LT(largest(summary, "tracking error"), 2e-3); }

/// (3a) at rest: S_a Δ = τ_e. The controller follows Δ with the tracking error.
void expect_compliance(const TemporaryFolder& folder, std::size_t joints) {
  const auto columns = read_recording(folder / "results/signals.csv");
  for (std::size_t i = 1; i <= joints; ++i) {
    const std::string element = "[" + std::to_string(i) + "]";
    const auto deviation = [&](double t) {
      return at_time(columns, "drive.q" + element, t) - at_time(columns, "motion.q_d" + element, t);
    };
    EXPECT_GT(at_time(columns, "drive.tau_e" + element, 3.9), 0) << i;
    const double first = deviation(3.9), second = deviation(9.9);
    EXPECT_GT(first, 1e-4) << i;
    EXPECT_NEAR(second / first, 0.5, 0.05) << i;
    EXPECT_NEAR(deviation(12.9), 0, 0.05 * first) << i;
  }
}

/// The force during the rest at the plate is that of the comment in the file, computed from stiffness and depth in one pose.
void expect_contact(const TemporaryFolder& folder, const std::string& scenario) {
  const std::string text = content(folder / scenario);
  const std::size_t place = text.find("force at rest is about ");
  ASSERT_NE(place, std::string::npos);
  const double expected = std::strtod(text.c_str() + place + 23, nullptr);
  const auto columns = read_recording(folder / "results/signals.csv");
  const auto force = [&](std::size_t row) {
    double square = 0;
    for (int i = 1; i <= 3; ++i) square += std::pow(columns.at("world.f_c[" + std::to_string(i) + "]").at(row), 2);
    return std::sqrt(square);
  };
  const std::size_t rows = columns.at("time").size();
  EXPECT_EQ(force(1), 0) << "touches at the start";
  EXPECT_EQ(force(rows - 1), 0) << "touches at the end";
  // Near the end of the rest in the plate, the second of the waypoints.
  std::istringstream waypoints(content((folder / scenario).parent_path() / "waypoints.csv"));
  std::vector<double> arrival;
  for (std::string line; std::getline(waypoints, line);) {
    if (line.front() != '#' && line.front() != 't') arrival.push_back(std::strtod(line.c_str(), nullptr));
  }
  ASSERT_EQ(arrival.size(), 3u);
  const auto after = std::ranges::lower_bound(columns.at("time"), arrival[1] + 1.9);
  // The bent robot is not linear: 10 % for nine robots.
  EXPECT_NEAR(force(static_cast<std::size_t>(after - columns.at("time").begin())), expected, 0.2 * expected);
}

TEST(New, NamesItsScenarioAsAShellTakesIt) {
  const TemporaryFolder folder("new");
  const RunResult made = make(folder, {"--robot", "planar2", "--out", "my arm's"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr(R"(run it with: cotwin run 'my arm'\''s/twin.ssd')"));
}

void expect_kinds(const std::string& robot, const std::vector<std::string>& options = {}) {
  for (const std::string kind : {"motion", "compliance", "contact"}) {
    SCOPED_TRACE(robot + " " + kind);
    const TemporaryFolder folder("new");
    std::vector<std::string> arguments = {"--robot", robot, "--kind", kind, "--out", "own"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const RunResult made = make(folder, arguments);
    ASSERT_EQ(made.code, 0) << made.err;
    EXPECT_THAT(made.out, HasSubstr("own/twin.ssd"));
    EXPECT_THAT(made.out, HasSubstr("run it with: cotwin run own/twin.ssd"));
    const nlohmann::json summary = run(folder, "own/twin.ssd");
    if (summary.empty()) continue;
    EXPECT_EQ(summary.at("state"), "done");
    expect_tracking(summary);
    const auto columns = read_recording(folder / "results/signals.csv");
    std::size_t joints = 0;
    while (columns.contains("drive.q[" + std::to_string(joints + 1) + "]")) ++joints;
    if (joints == 0) joints = 1;
    if (kind == "compliance" && columns.contains("drive.q[1]")) expect_compliance(folder, joints);
    if (kind == "contact") expect_contact(folder, "own/twin.ssd");
  }
}

class NewOfOurRobots : public ::testing::TestWithParam<const char*> {};

TEST_P(NewOfOurRobots, RunsUnchanged) { expect_kinds(GetParam()); }

INSTANTIATE_TEST_SUITE_P(All, NewOfOurRobots,
                         ::testing::Values("lwr4", "iiwa14", "planar2", "kr300_r2500", "ur3e", "ur5e", "ur10", "ur10e", "ur16e",
                                           "ur20"));

std::string link(const std::string& name, double mass) {
  const std::string m = std::to_string(mass), I = std::to_string(0.02 * mass);
  return "<link name=\"" + name + "\"><inertial><origin xyz=\"0 0 0.1\"/><mass value=\"" + m + "\"/><inertia ixx=\"" + I +
         "\" iyy=\"" + I + "\" izz=\"" + I + "\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>\n";
}
std::string joint(const std::string& name, const std::string& type, const std::string& parent, const std::string& child,
                  const std::string& axis, const std::string& more) {
  return "<joint name=\"" + name + "\" type=\"" + type + "\"><parent link=\"" + parent + "\"/><child link=\"" + child +
         "\"/><origin xyz=\"0.02 0 0.3\"/><axis xyz=\"" + axis + "\"/>" + more + "</joint>\n";
}

/// A robot on a rail, with a joint without limits of position, one without limits of speed and effort, a flange, and a gripper
/// of two fingers.
std::string mixed_robot(const std::string& name) {
  return "<robot name=\"" + name + "\">\n<link name=\"base\"/>\n" + link("slide", 8) + link("shoulder", 5) + link("elbow", 3) +
         "<link name=\"flange\"/>\n" + link("left", 0.2) + link("right", 0.2) +
         joint("rail", "prismatic", "base", "slide", "1 0 0",
               "<limit lower=\"0\" upper=\"2\" effort=\"500\" velocity=\"1\"/>") +
         joint("turn", "continuous", "slide", "shoulder", "0 0 1",
               "<limit effort=\"100\" velocity=\"3\"/><dynamics damping=\"2\" friction=\"1\"/>") +
         joint("bend", "revolute", "shoulder", "elbow", "0 1 0",
               "<limit lower=\"-2\" upper=\"2\" effort=\"0\" velocity=\"0\"/>") +
         joint("mount", "fixed", "elbow", "flange", "1 0 0", "") +
         joint("grip", "prismatic", "flange", "left", "0 1 0",
               "<limit lower=\"0\" upper=\"0.04\" effort=\"20\" velocity=\"0.1\"/>") +
         joint("grip_too", "prismatic", "flange", "right", "0 -1 0",
               "<limit lower=\"0\" upper=\"0.04\" effort=\"20\" velocity=\"0.1\"/><mimic joint=\"grip\"/>") +
         "</robot>\n";
}

TEST(New, TakesRailsContinuousJointsMimicsFlangesAndJointsWithoutLimits) {
  const TemporaryFolder folder("new");
  const fs::path file = folder.write("mixed.urdf", mixed_robot("mixed"));
  expect_kinds(file.string());
}

TEST(New, NamesItsFolderAfterTheFile) {
  const TemporaryFolder folder("new");
  for (const std::string file : {"arm.urdf", "robot.urdf"}) {
    folder.write(file, mixed_robot("mixed"));
    const std::string scenario = (file == "arm.urdf" ? "arm" : "mixed") + std::string("_motion");
    ASSERT_EQ(make(folder, {"--robot", file}).code, 0);
    EXPECT_THAT(content(folder / scenario / "twin.ssd"), HasSubstr("name=\"" + scenario + "\""))
        << "so that its results are named so, too";
  }
}

TEST(New, NamesWhatItAssumed) {
  const TemporaryFolder folder("new");
  folder.write("mixed.urdf", mixed_robot("mixed"));
  const RunResult made = make(folder, {"--robot", "mixed.urdf"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("mixed_motion/twin.ssd"));
  EXPECT_THAT(made.out, HasSubstr("note: nothing is known of the drives"));
  EXPECT_THAT(made.out, HasSubstr("joint 'bend': effort limit 0 is read as no limit"));
  EXPECT_THAT(made.out, HasSubstr("note: friction of the motors: <dynamics> of the URDF"));
  // Robot and scenario are below the working directory, so that they can be moved together.
  EXPECT_THAT(content(folder / "mixed_motion/twin.ssd"), HasSubstr("name=\"robot\" value=\"../mixed.urdf\""));
  EXPECT_THAT(content(folder / "mixed_motion/drive_train.ssv"), HasSubstr("name=\"sigma2\"><ssv:String value=\"0 2 0 0\""));
  EXPECT_THAT(content(folder / "mixed_motion/waypoints.csv"), HasSubstr("# q1: 'rail' in m, from 0 to 2, at most 1 m/s"));
}

// The command of docs/services.md for energy, with what `cotwin new` assumes beside the URDF.
TEST(New, WritesElectricalDataWithWhichEnergyIsTold) {
  const TemporaryFolder folder("new");
  folder.write("mixed.urdf", mixed_robot("mixed"));
  const RunResult made = make(folder, {"--robot", "mixed.urdf"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("note: drive_train.ssv and energy.ssv are all assumed"));
  const auto ask = [&] {
    return run_program({"ask", "energy", "--robot", folder / "mixed.urdf", "--from", "0,0,0,0", "--to", "1,1,1,0.02",
                        "--duration", "4", "--with", R"({"bus": "grid", "price_per_kWh": 0.3, "best": true})"});
  };
  EXPECT_NE(ask().code, 0);
  for (const char* file : {"drive_train.ssv", "energy.ssv"})
    fs::copy_file(fs::path(folder / "mixed_motion") / file, folder / file);
  const RunResult told = ask();
  ASSERT_EQ(told.code, 0) << told.err;
  const nlohmann::json reply = nlohmann::json::parse(told.out);
  EXPECT_EQ(reply["boundary"], "mains");
  EXPECT_EQ(reply["assumed"], "all");
  EXPECT_GT(reply["energy_J"].get<double>(), reply["work_positive_J"].get<double>());
  EXPECT_GT(reply["price"].get<double>(), 0);
  ASSERT_EQ(reply["assumptions"].size(), 6u) << reply["assumptions"];  // motors, both frictions, two limits, electrical data
  EXPECT_EQ(reply["assumptions"][0]["what"], "inertia of motors");
  EXPECT_EQ(reply["assumptions"][5]["file"], "energy.ssv");
  // The copper losses of a joint at its limits of torque and speed are a third of its power there.
  const std::string energy = content(folder / "energy.ssv");
  const std::size_t at = energy.find("value=\"", energy.find("\"k_t\"")) + 7;
  const double k_t = std::stod(energy.substr(at));
  EXPECT_NEAR(500 * 500 / (k_t * k_t), 500.0 * 1 / 3, 2) << "of the rail, with 1 Ohm";
  // What is there is not assumed again.
  const RunResult again = make(folder, {"--robot", "mixed.urdf", "--out", "again"});
  ASSERT_EQ(again.code, 0) << again.err;
  EXPECT_FALSE(fs::exists(folder / "again/energy.ssv"));
}

TEST(New, SetsEffortLimitsAsideThatDoNotCarryTheRobot) {
  const TemporaryFolder folder("new");
  std::string weak = mixed_robot("weak");
  const std::string limit = "effort=\"0\" velocity=\"0\"";
  weak.replace(weak.find(limit), limit.size(), "effort=\"0.5\" velocity=\"1\"");
  folder.write("weak.urdf", weak);
  const RunResult made = make(folder, {"--robot", "weak.urdf"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("note: joint 'bend': the URDF's effort limit of 0.5 does not carry the motion"));
  EXPECT_THAT(content(folder / "weak_motion/compliance.ssv"), HasSubstr("name=\"tau_max\"><ssv:String value=\"500 100 0 20\""));
  expect_tracking(run(folder, "weak_motion/twin.ssd"));
}

TEST(New, LinksWithoutInertiaAreAnErrorOrANote) {
  const TemporaryFolder folder("new");
  std::string hollow = mixed_robot("hollow");
  const std::string elbow = link("elbow", 3);
  hollow.replace(hollow.find(elbow), elbow.size(), "<link name=\"elbow\"/>\n");
  const std::string left = link("left", 0.2);
  hollow.replace(hollow.find(left), left.size(), "<link name=\"left\"/>\n");
  folder.write("hollow.urdf", hollow);
  const RunResult refused = make(folder, {"--robot", "hollow.urdf"});
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("hollow.urdf:"));
  EXPECT_THAT(refused.err, HasSubstr("moves no mass"));
  EXPECT_THAT(refused.err, HasSubstr("it runs with: --unphysical estimate"));
  EXPECT_FALSE(fs::exists(folder / "hollow_motion"));
  for (const std::string kind : {"motion", "compliance", "contact"}) {
    const RunResult estimated =
        make(folder, {"--robot", "hollow.urdf", "--kind", kind, "--unphysical", "estimate", "--out", "estimated_" + kind});
    ASSERT_EQ(estimated.code, 0) << estimated.err;
    EXPECT_THAT(estimated.out, HasSubstr("estimated as"));
    expect_tracking(run(folder, "estimated_" + kind + "/twin.ssd"));
  }

  const RunResult made = make(folder, {"--robot", "hollow.urdf", "--unphysical", "warn"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("moves no mass"));
  EXPECT_THAT(content(folder / "hollow_motion/twin.ssd"), HasSubstr("name=\"unphysical\" value=\"warn\""));
  expect_tracking(run(folder, "hollow_motion/twin.ssd"));
}

/// A mimic and a loop whose words change the machine: inertias are sound, so no option is offered, and no command takes the file.
TEST(New, OffersNoOptionThatWouldMakeAnotherMachine) {
  const TemporaryFolder folder("new");
  const auto with = [&](const std::string& name, const std::string& before, const std::string& more) {
    std::string xml = mixed_robot(name);
    xml.insert(xml.find(before), more);
    folder.write(name + ".urdf", xml);
  };
  const std::string joint = R"(<joint name="knob" type="revolute"><parent link="base"/><child link="knob"/>
<limit lower="-1" upper="1" effort="5" velocity="2"/>)";
  with("typo", "</robot>", link("knob", 1) + joint + R"(<mimic joint="bend" multiplyer="2"/></joint>)");
  with("spring", "</robot>", link("knob", 1) + joint + "<spring stiffness=\"50\"/></joint>");
  with("loop", "</robot>",
       R"(<gazebo><joint name="closing" type="revolute"><parent>base</parent><child>elbow</child></joint></gazebo>)");
  with("flip", "</robot>", link("knob", 1) + joint + R"(<mimic joint="bend" multiplyer="2"/></joint>)");
  std::string flip = content(folder / "flip.urdf");
  const std::string elbow = link("elbow", 3);
  flip.replace(flip.find(elbow), elbow.size(), "<link name=\"elbow\"/>\n");
  folder.write("flip.urdf", flip);
  folder.write("log.csv", "t,q1,tau1\n0,0,0\n");
  for (const std::string name : {"typo", "spring", "loop", "flip"}) {
    const std::string file = name + ".urdf";
    for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
             {"new", "--robot", file, "--out", "made"},
             {"new", "--robot", file, "--unphysical", "estimate", "--out", "made"},
             {"excite", "--robot", file, "--out", "made.csv"},
             {"tune", "--robot", file, "--data", "log.csv", "--out", "made"},
             {"ask", "torques", "--robot", file, "--unphysical", "estimate", "--from", "0,0,0", "--to", "0,0,0"},
             {"tool", "attach", "made", "gripper,parent=flange,mass=1", "--robot", file},
             {"pack", "unit:drive_train?robot=" + file, "--out", "made.fmu"}}) {
      const RunResult refused = run_program(command, {.folder = folder.path()});
      EXPECT_EQ(refused.code, 2) << command[0] << refused.out;
      EXPECT_THAT(refused.err, HasSubstr(file + ":")) << command[0];
      EXPECT_THAT(refused.err, Not(HasSubstr("it runs with"))) << command[0];
      EXPECT_FALSE(fs::exists(folder / "made") || fs::exists(folder / "made.csv") || fs::exists(folder / "made.fmu"))
          << command[0];
    }
  }
}

TEST(New, RefusesRobotsThatItCannotMove) {
  const TemporaryFolder folder("new");
  folder.write("rigid.urdf", "<robot name=\"rigid\">" + link("base", 1) + "</robot>");
  EXPECT_THAT(make(folder, {"--robot", "rigid.urdf"}).err, HasSubstr("has no joint that moves"));
  folder.write("rotor.urdf", "<robot name=\"rotor\">" + link("base", 1) + link("disc", 1) +
                                 joint("turn", "continuous", "base", "disc", "0 0 1", "<limit effort=\"1\" velocity=\"9\"/>") +
                                 "</robot>");
  folder.write("stiff.urdf", "<robot name=\"stiff\">" + link("base", 1) + link("flap", 1) + link("tip", 1) +
                                 joint("turn", "revolute", "base", "flap", "0 0 1",
                                       "<limit lower=\"0\" upper=\"1e-4\" effort=\"1\" velocity=\"9\"/>") +
                                 joint("mount", "fixed", "flap", "tip", "1 0 0", "") + "</robot>");
  const RunResult contact = make(folder, {"--robot", "stiff.urdf", "--kind", "contact"});
  EXPECT_EQ(contact.code, 2);
  EXPECT_THAT(contact.err, HasSubstr("frame 'tip': it cannot go on by"));
  EXPECT_THAT(contact.err, HasSubstr("expected --end-effector LINK, or --kind motion or compliance"));
  EXPECT_FALSE(fs::exists(folder / "stiff_contact"));
  EXPECT_EQ(make(folder, {"--robot", "rotor.urdf"}).code, 0);
  EXPECT_THAT(make(folder, {"--robot", "nowhere.urdf"}).err, HasSubstr("is neither a file nor the name of a robot"));
  folder.write("free.urdf", "<robot name=\"free\">" + link("base", 1) + link("body", 1) +
                                joint("fly", "floating", "base", "body", "0 0 1", "") + "</robot>");
  EXPECT_THAT(make(folder, {"--robot", "free.urdf"}).err, HasSubstr("free.urdf:"));
}

TEST(New, PressesWithAWheel) {
  const TemporaryFolder folder("new");
  const fs::path file = folder.write(
      "rotor.urdf", "<robot name=\"rotor\">" + link("base", 1) + link("disc", 1) +
                        joint("turn", "continuous", "base", "disc", "0 0 1", "<limit effort=\"1\" velocity=\"9\"/>") +
                        "</robot>");
  expect_kinds(file.string());
}

/// Two links that turn about vertical axes, a quill and a roll at its end.
TEST(New, PressesWithAScara) {
  const TemporaryFolder folder("new");
  const std::string turns = "<limit lower=\"-2.4\" upper=\"2.4\" effort=\"100\" velocity=\"5\"/>";
  const fs::path file = folder.write(
      "scara.urdf", "<robot name=\"scara\"><link name=\"base\"/>\n" + link("upper", 6) + link("fore", 4) + link("quill", 1) +
                        link("flange", 0.2) + joint("shoulder", "revolute", "base", "upper", "0 0 1", turns) +
                        joint("elbow", "revolute", "upper", "fore", "0 0 1", turns) +
                        joint("lift", "prismatic", "fore", "quill", "0 0 1",
                              "<limit lower=\"-0.1\" upper=\"0\" effort=\"200\" velocity=\"1\"/>") +
                        joint("roll", "revolute", "quill", "flange", "0 0 1", turns) + "</robot>");
  expect_kinds(file.string());
}

TEST(New, MountsTheProbeAtThePalmAndNotAtAFinger) {
  const TemporaryFolder folder("new");
  folder.write("mixed.urdf", mixed_robot("mixed"));
  const RunResult palm = make(folder, {"--robot", "mixed.urdf", "--kind", "contact"});
  ASSERT_EQ(palm.code, 0) << palm.err;
  EXPECT_THAT(palm.out, HasSubstr("note: the probe is mounted at 'flange', not at the finger 'left'"));
  EXPECT_THAT(content(folder / "mixed_contact/twin.ssd"), HasSubstr("parent=\"flange\""));
  const RunResult finger =
      make(folder, {"--robot", "mixed.urdf", "--kind", "contact", "--end-effector", "right", "--out", "finger"});
  ASSERT_EQ(finger.code, 0) << finger.err;
  EXPECT_THAT(content(folder / "finger/twin.ssd"), HasSubstr("parent=\"right\""));
  EXPECT_THAT(make(folder, {"--robot", "mixed.urdf", "--kind", "contact", "--end-effector", "rigth", "--out", "x"}).err,
              HasSubstr("'right'"));
  EXPECT_THAT(make(folder, {"--robot", "mixed.urdf", "--end-effector", "right", "--out", "x"}).err,
              HasSubstr("is of --kind contact"));
}

/// The longest chain can hardly move, and the other one is a wheel.
TEST(New, MountsTheProbeAtAnotherEndIfTheFirstCannotPress) {
  const TemporaryFolder folder("new");
  const std::string stiff = "<limit lower=\"0\" upper=\"1e-4\" effort=\"1\" velocity=\"9\"/>";
  folder.write("two.urdf", "<robot name=\"two\">" + link("base", 1) + link("disc", 1) + link("flap", 1) + link("tip", 1) +
                               joint("roll", "continuous", "base", "disc", "0 0 1", "<limit effort=\"1\" velocity=\"9\"/>") +
                               joint("turn", "revolute", "base", "flap", "0 0 1", stiff) +
                               joint("bend", "revolute", "flap", "tip", "0 1 0", stiff) + "</robot>");
  const RunResult made = make(folder, {"--robot", "two.urdf", "--kind", "contact"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("note: the probe is mounted at 'disc', not at 'tip' (--end-effector LINK): robot 'two', "
                                  "frame 'tip': it cannot go on by"));
  run(folder, "two_contact/twin.ssd");
  expect_contact(folder, "two_contact/twin.ssd");
  EXPECT_THAT(make(folder, {"--robot", "two.urdf", "--kind", "contact", "--end-effector", "tip", "--out", "x"}).err,
              HasSubstr("frame 'tip': it cannot go on by"));
}

TEST(New, LocksJointsThatCannotMove) {
  const TemporaryFolder folder("new");
  std::string robot = mixed_robot("mixed");
  const std::string free = "lower=\"-2\" upper=\"2\" effort=\"0\" velocity=\"0\"";
  robot.replace(robot.find(free), free.size(), "lower=\"0.3\" upper=\"0.3\" effort=\"9\" velocity=\"1\"");
  folder.write("mixed.urdf", robot);
  const RunResult made = make(folder, {"--robot", "mixed.urdf"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("note: joints whose lower and upper limit are the same are locked: bend:0.3"));
  expect_tracking(run(folder, "mixed_motion/twin.ssd"));
}

TEST(New, NamesTheUnitsOfAUrdfThatIsNotInSi) {
  const TemporaryFolder folder("new");
  std::string robot = mixed_robot("mixed");  // its lengths in mm; without inertias, which are estimated
  for (const auto& [metres, millimetres] :
       {std::pair{"0.02 0 0.3", "20 0 300"},
        {"upper=\"2\" effort=\"500\" velocity=\"1\"", "upper=\"2000\" effort=\"500\" velocity=\"1000\""},
        {"0.04", "40"},
        {"velocity=\"0.1\"", "velocity=\"100\""}}) {
    for (std::size_t at = 0; (at = robot.find(metres, at)) != std::string::npos; at += std::string(millimetres).size())
      robot.replace(at, std::string(metres).size(), millimetres);
  }
  folder.write("mixed.urdf", robot);
  const RunResult refused = make(folder, {"--robot", "mixed.urdf"});
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("\nif its numbers are in these units it runs with: --urdf-units length=mm"));
  EXPECT_THAT(refused.err, ::testing::EndsWith("; if they are in SI: --urdf-units si\n"));
  const RunResult made =
      make(folder, {"--robot", "mixed.urdf", "--urdf-units", "length=mm,inertia=kg.m2", "--kind", "compliance"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(content(folder / "mixed_compliance/twin.ssd"), HasSubstr("name=\"robot\" value=\"./robot.urdf\""));
  EXPECT_THAT(content(folder / "mixed_compliance/waypoints.csv"), HasSubstr("# q1: 'rail' in m, from 0 to 2, at most 1 m/s"));
  expect_tracking(run(folder, "mixed_compliance/twin.ssd"));
  EXPECT_THAT(make(folder, {"--robot", "mixed.urdf", "--urdf-units", "lenght=mm"}).err,
              HasSubstr("--urdf-units: 'lenght=mm', expected"));
}

TEST(New, LockedJointsStandStill) {
  const TemporaryFolder folder("new");
  folder.write("mixed.urdf", mixed_robot("mixed"));
  const RunResult made = make(folder, {"--robot", "mixed.urdf", "--lock", "grip:0.02"});
  ASSERT_EQ(made.code, 0) << made.err;
  const nlohmann::json summary = run(folder, "mixed_motion/twin.ssd");
  EXPECT_FALSE(read_recording(folder / "results/signals.csv").contains("drive.q[4]"));
  expect_tracking(summary);
}

TEST(New, KeepsExistingFiles) {
  const TemporaryFolder folder("new");
  ASSERT_EQ(make(folder, {"--robot", "planar2", "--out", "own"}).code, 0);
  folder.write("own/waypoints.csv", "mine");
  const RunResult again = make(folder, {"--robot", "planar2", "--out", "own"});
  EXPECT_EQ(again.code, 2);
  EXPECT_THAT(again.err, HasSubstr("exists, expected another folder after --out, or --overwrite"));
  EXPECT_EQ(content(folder / "own/waypoints.csv"), "mine");
  EXPECT_EQ(make(folder, {"--robot", "planar2", "--out", "own", "--overwrite"}).code, 0);
  EXPECT_NE(content(folder / "own/waypoints.csv"), "mine");
}

TEST(New, NamesWithMarkupDoNotBecomeMarkup) {
  const TemporaryFolder folder("new");
  std::string robot = mixed_robot("a --&gt; &lt;b&gt; &amp; 'c'");
  for (std::size_t at = 0; (at = robot.find("\"bend\"", at)) != std::string::npos;)
    robot.replace(at, 6, "\"x--&gt;&quot;&amp;\"");
  for (std::size_t at = 0; (at = robot.find("\"left\"", at)) != std::string::npos;) robot.replace(at, 6, "\"l&lt;&quot;e\"");
  folder.write("odd & robot.urdf", robot);
  for (const std::string kind : {"motion", "contact"}) {
    const RunResult made = make(folder, {"--robot", "odd & robot.urdf", "--kind", kind, "--out", kind});
    ASSERT_EQ(made.code, 0) << made.err;
    expect_tracking(run(folder, kind + "/twin.ssd"));
  }
}

}  // namespace
}  // namespace new_command_test
