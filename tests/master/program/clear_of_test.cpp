// cotwin check --clear-of, cotwin excite --clear-of: against a monitor that watches the motion, and known legs.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "models/cloud/cloud_file.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace clear_of_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using ::testing::HasSubstr;

std::string box(const std::string& pose) {
  return "<sdf version=\"1.11\"><world name=\"w\"><model name=\"box\"><static>true</static><pose>" + pose +
         " 0 0 0</pose><link name=\"box\"><collision name=\"c\"><geometry><box><size>0.2 0.2 0.2</size></box></geometry>"
         "</collision></link></model></world></sdf>";
}

// The left robot goes from joint_1 = -2 to -0.4, and stands 0.31 m above the ground by the monitor's place.
TEST(CheckClearOf, NamesTheLegTheLinkAndTheTime) {
  const cotwin::testing::TemporaryFolder folder("clear_of");
  const std::string cell = cotwin::places::source() + "/examples/25_shared_cell/cell.ssd";
  folder.write("far.sdf", box("0 3 0.5"));
  const RunResult clear = run_program({"check", cell, "--clear-of", folder / "far.sdf"});
  EXPECT_EQ(clear.code, 0) << clear.out << clear.err;
  EXPECT_THAT(clear.out, HasSubstr("note: left: clear; nearest: "));
  EXPECT_THAT(clear.out, HasSubstr("note: right: clear; nearest: "));
  folder.write("near.sdf", box("0.4 -0.4 0.6"));
  const RunResult near = run_program({"check", cell, "--clear-of", folder / "near.sdf"});
  EXPECT_EQ(near.code, 2);
  EXPECT_THAT(near.out,
              ::testing::ContainsRegex("error: left: link_[3-7] meets box at [01]\\.[0-9]+ s, between waypoints 1 and 2"));
  EXPECT_THAT(near.out, HasSubstr("note: right: clear"));
  EXPECT_THAT(run_program({"check", cell, "--clear-of", "nowhere"}).err, HasSubstr("scene 'nowhere': is neither a file nor"));
}

// A scene, a cloud and both, by paths and by name. The straight motion of example 29 hits what its README says.
TEST(CheckClearOf, KnowsPointClouds) {
  const cotwin::testing::TemporaryFolder folder("clear_of_cloud");
  const std::string cell = cotwin::places::source() + "/examples/25_shared_cell/cell.ssd";
  folder.write("far.sdf", box("0 3 0.5"));
  folder.write("near.sdf", box("0.4 -0.4 0.6"));
  ASSERT_EQ(run_program({"cloud", "--from", folder / "near.sdf", "--spacing", "0.01", "-o", folder / "near.ply"}).code, 0);
  const RunResult scene = run_program({"check", cell, "--clear-of", folder / "near.sdf"});
  const RunResult cloud = run_program({"check", cell, "--clear-of", folder / "near.ply"});
  const RunResult both = run_program({"check", cell, "--clear-of", folder / "near.ply", "--clear-of", folder / "far.sdf"});
  for (const RunResult* result : {&cloud, &both}) {
    EXPECT_EQ(result->code, 2);
    EXPECT_THAT(result->out, ::testing::ContainsRegex("note: the 2400 points of near.ply have balls of 0.00[4-7][0-9]* m"));
  }
  const auto meeting = [](const std::string& out) {
    return out.substr(out.find("error: left"), out.find(" meets") - out.find("error: left"));
  };
  EXPECT_EQ(meeting(cloud.out), meeting(scene.out));
  EXPECT_THAT(cloud.out, HasSubstr(" meets cloud at "));
  EXPECT_THAT(both.out, HasSubstr("note: right: clear; nearest: "));
  EXPECT_THAT(run_program({"check", cell, "--clear-of", folder / "near.ply", "--clear-of", folder / "near.ply"}).err,
              HasSubstr("is the second cloud, expected one"));
  EXPECT_THAT(run_program({"check", cell, "--clear-of", folder / "far.sdf", "--clear-of", folder / "near.sdf"}).err,
              HasSubstr("is the second scene, expected one"));

  const std::string scanned = cotwin::places::source() + "/examples/29_scanned_cell/";
  const RunResult clear = run_program({"check", scanned + "cell.ssd", "--clear-of", "cell_cloud"});
  EXPECT_EQ(clear.code, 0) << clear.out << clear.err;
  EXPECT_THAT(clear.out, HasSubstr("note: motion: clear; nearest: wrist_1_link, 0.174 m from cloud"));
  const auto straight = [](const std::string& what) {
    return run_program({"ask", "feasibility", "--robot", "ur5e", "--from", "2.5,-1.2,1.4,-1.8,-1.57,0", "--to",
                        "3.8,-1.2,1.4,-1.8,-1.57,0", "--with",
                        R"({"clear_of": {)" + what + R"(, "base": {"p_m": [0, 0, 0.6]}}})"})
        .out;
  };
  EXPECT_THAT(straight(R"("cloud": {"name": "cell_cloud"})"), HasSubstr("wrist_1_link meets cloud at 0.2852 s"));
  EXPECT_THAT(straight(R"("scene": ")" + scanned + R"(cell.sdf")"), HasSubstr("wrist_1_link meets post at 0.2936 s"));
  // The cloud is what the program makes of the scene.
  ASSERT_EQ(run_program({"cloud", "--from", scanned + "cell.sdf", "--spacing", "0.03", "--sigma", "0.001", "--seed", "1", "-o",
                         folder / "again.pcd"})
                .code,
            0);
  const cotwin::cloud::Cloud again = cotwin::cloud::load_cloud(folder / "again.pcd").cloud;
  const cotwin::cloud::Cloud kept =
      cotwin::cloud::load_cloud(cotwin::places::source() + "/models/scenes/cell_cloud/scene.pcd").cloud;
  ASSERT_EQ(again.points.size(), kept.points.size());
  for (std::size_t k = 0; k < kept.points.size(); ++k) ASSERT_LT((again.point(k) - kept.point(k)).norm(), 1e-6);
}

/// A block of 3 m with a dent on top: closed and concave.
std::string block(const std::string& name) {
  const std::vector<std::array<double, 3>> v{{-1.5, -1.5, -1}, {1.5, -1.5, -1}, {1.5, 1.5, -1},
                                             {-1.5, 1.5, -1},  {-1.5, -1.5, 2}, {1.5, -1.5, 2},
                                             {1.5, 1.5, 2},    {-1.5, 1.5, 2},  {0, 0, 1.8}};
  std::string stl = "solid " + name + "\n";
  for (const auto& t : std::vector<std::array<std::size_t, 3>>{{0, 2, 1},
                                                               {0, 3, 2},
                                                               {4, 5, 8},
                                                               {5, 6, 8},
                                                               {6, 7, 8},
                                                               {7, 4, 8},
                                                               {0, 1, 5},
                                                               {0, 5, 4},
                                                               {1, 2, 6},
                                                               {1, 6, 5},
                                                               {2, 3, 7},
                                                               {2, 7, 6},
                                                               {3, 0, 4},
                                                               {3, 4, 7}}) {
    stl += "facet normal 0 0 0\nouter loop\n";
    for (const std::size_t k : t)
      stl += "vertex " + std::to_string(v[k][0]) + " " + std::to_string(v[k][1]) + " " + std::to_string(v[k][2]) + "\n";
    stl += "endloop\nendfacet\n";
  }
  return stl + "endsolid " + name + "\n";
}

/// Two UR5e that a monitor watches, the right one turned towards the left one.
class TwoRobots : public ::testing::Test {
 protected:
  TwoRobots() {
    folder_.write("rod.urdf",
                  "<robot name=\"rod\"><link name=\"rod\"><inertial><mass value=\"0.2\"/><inertia ixx=\"1e-3\" iyy=\"1e-3\" "
                  "izz=\"1e-3\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial><collision><origin xyz=\"0 0 0.35\"/><geometry><box "
                  "size=\"0.04 0.04 0.6\"/></geometry></collision></link></robot>");
    folder_.write("block.stl", block("block"));
    folder_.write("far.sdf", box("0 9 0.5"));
    folder_.write(
        "block.sdf",
        "<sdf version=\"1.11\"><world name=\"w\"><model name=\"block\"><static>true</static><link name=\"block\">"
        "<collision name=\"c\"><geometry><mesh><uri>block.stl</uri></mesh></geometry></collision></link></model></world>"
        "</sdf>");
  }
  void write(const std::string& place_of_right, const std::string& events, const std::string& scene = "far.sdf") {
    const auto component = [](const std::string& name, const std::string& source,
                              const std::vector<std::array<std::string, 2>>& values) {
      std::string text =
          "<ssd:Component name=\"" + name + "\" source=\"unit:" + source +
          "\" type=\"application/x-cotwin-unit\"><ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
          "<ssv:ParameterSet version=\"1.0\" name=\"p\"><ssv:Parameters>";
      for (const auto& [parameter, value] : values)
        text += "<ssv:Parameter name=\"" + parameter + "\"><ssv:String value=\"" + value + "\"/></ssv:Parameter>";
      return text +
             "</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"
             "</ssd:Component>";
    };
    std::string connections;
    const auto connect = [&](const std::string& from, const std::string& source, const std::string& to,
                             const std::string& target) {
      connections += "<ssd:Connection startElement=\"" + from + "\" startConnector=\"" + source + "\" endElement=\"" + to +
                     "\" endConnector=\"" + target + "\"/>";
    };
    for (const char* name : {"q_d", "dq_d", "ddq_d"}) connect("l", name, "control", name);
    for (const char* name : {"q", "dq", "theta", "dtheta"}) connect("drive", name, "control", name);
    connect("control", "tau_m", "drive", "tau_m");
    for (const std::string name : {"q", "dq"}) {
      connect("drive", name, "mon", "l." + name);
      connect("r", name + "_d", "mon", "r." + name);
    }
    folder_.write(
        "cell.ssd",
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><ssd:SystemStructureDescription version=\"1.0\" name=\"cell\" "
        "xmlns:ssd=\"http://ssp-standard.org/SSP1/SystemStructureDescription\" "
        "xmlns:ssc=\"http://ssp-standard.org/SSP1/SystemStructureCommon\" "
        "xmlns:ssv=\"http://ssp-standard.org/SSP1/SystemStructureParameterValues\"><ssd:System name=\"cell\"><ssd:Elements>" +
            component("l", "motion?robot=ur5e&amp;points=2",
                      {{"waypoint_t", "0 2"}, {"waypoint_q", "0 -1.5 1.5 -1.5 -1.5 0 0 -0.4 0.5 -1.5 -1.5 0"}}) +
            component("r", "motion?robot=ur5e&amp;points=2",
                      {{"waypoint_t", "0 2.4"}, {"waypoint_q", "3.1 -1.5 1.5 -1.5 -1.5 0 3.1 -0.5 0.4 -1.5 -1.5 0"}}) +
            component("control", "compliance?robot=ur5e", {}) +
            component("drive", "drive_train?robot=ur5e", {{"q0", "0 -1.5 1.5 -1.5 -1.5 0"}}) +
            component("mon", "monitor?robots=l:ur5e,r:ur5e", {{"r.base_p0", place_of_right}}) +
            "</ssd:Elements><ssd:Connections>" + connections +
            "</ssd:Connections></ssd:System><ssd:DefaultExperiment startTime=\"0\" stopTime=\"3\"/><ssd:Annotations>"
            "<ssc:Annotation type=\"cotwin.master\"><cotwin:Master xmlns:cotwin=\"urn:cotwin:master:1\" tick=\"1 ms\">"
            "<cotwin:Setting name=\"scene\" value=\"" +
            scene +
            "\"/><cotwin:Component name=\"l\" stage=\"0\"/>"
            "<cotwin:Component name=\"r\" stage=\"0\"/><cotwin:Component name=\"control\" stage=\"1\"/>"
            "<cotwin:Component name=\"drive\" stage=\"2\"/><cotwin:Component name=\"mon\" stage=\"3\"/>" +
            events +
            "<cotwin:Recording decimation=\"1\"><cotwin:Record "
            "variables=\"mon.l.distance\"/></cotwin:Recording></cotwin:Master>"
            "</ssc:Annotation></ssd:Annotations></ssd:SystemStructureDescription>");
  }
  RunResult check(std::vector<std::string> more = {}, const std::string& scene = "far.sdf") {
    std::vector<std::string> command{"check", folder_ / "cell.ssd", "--clear-of", folder_ / scene};
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command);
  }
  /// When the monitor of a run sees the left robot overlap with something for the first time, s; -1: never.
  double meets_at() {
    const RunResult run = run_program({"run", folder_ / "cell.ssd", "--out", folder_ / "results", "--quiet"});
    EXPECT_EQ(run.code, 0) << run.err;
    std::ifstream in(folder_ / "results/signals.csv");
    double t = 0, distance = 0;
    char comma = 0;
    std::string line;
    for (std::getline(in, line); in >> t >> comma >> distance;)
      if (distance < 0) return t;
    return -1;
  }
  static double told(const RunResult& result) {
    const std::size_t l = result.out.find("error: l: ");
    if (l == std::string::npos) return -1;
    return std::stod(result.out.substr(result.out.find(" at ", l) + 4));
  }
  cotwin::testing::TemporaryFolder folder_{"two_robots"};
};

TEST_F(TwoRobots, AreCheckedAgainstEachOtherAndAgreeWithAMonitor) {
  write("-1.1 0.05 0", "");
  const RunResult met = check();
  EXPECT_EQ(met.code, 2);
  EXPECT_THAT(met.out, ::testing::ContainsRegex(
                           "error: l: [a-z0-9_]+ meets r/[a-z0-9_]+ at [01]\\.[0-9]+ s, between waypoints 1 and 2"));
  EXPECT_THAT(met.out, ::testing::ContainsRegex("error: r: [a-z0-9_]+ meets l/[a-z0-9_]+ at "));
  EXPECT_THAT(met.out, HasSubstr("note: places: l at (0 0 0) m by mon.l; r at (-1.1 0.05 0) m by mon.r"));
  EXPECT_NEAR(told(met), meets_at(), 2e-3);
  // Elsewhere they are clear.
  const RunResult away = check({"--base", "r: -4 0 0"});
  EXPECT_EQ(away.code, 0) << away.out;
  EXPECT_THAT(away.out, ::testing::ContainsRegex("note: l: clear; nearest: [a-z0-9_]+, [0-9.]+ m from r/"));
  EXPECT_THAT(away.out, HasSubstr("r at (-4 0 0) m by --base"));
  write("-4 0 0", "");
  EXPECT_EQ(meets_at(), -1);
  EXPECT_EQ(check({"--base", "r: -1.1 0.05 0 0 0 0"}).code, 2);
  EXPECT_THAT(check({"--base", "right: 0 0 0"}).err,
              HasSubstr("--base: 'right: 0 0 0' names no robot, expected NAME: of l, r"));
  EXPECT_THAT(check({"--base", "r: 0 0"}).err, HasSubstr("--base: 'r: 0 0', expected x y z"));
  EXPECT_THAT(check({"--base", "r: 0 0 nan"}).err, HasSubstr("expected x y z"));
}

TEST_F(TwoRobots, CarryTheToolsOfTheEvents) {
  const auto attach = [](const std::string& t) {
    return "<cotwin:Event time=\"" + t +
           "\" attach=\"rod\" parent=\"wrist_3_link\" file=\"rod.urdf\" components=\"control drive mon.l\"/>";
  };
  write("-1.9 0.05 0", "");
  EXPECT_EQ(check().code, 0) << check().out;
  EXPECT_EQ(meets_at(), -1);
  folder_.write("post.sdf", box("-0.82 -0.13 -0.25"));
  write("-1.9 0.05 0", attach("0.1"), "post.sdf");
  const RunResult met = check({}, "post.sdf");
  EXPECT_THAT(met.out, HasSubstr("error: l: rod meets box at "));
  EXPECT_THAT(met.out, HasSubstr("note: r: clear"));
  EXPECT_NEAR(told(met), meets_at(), 2e-3);
  // It goes before, or comes when it already overlaps.
  write("-1.9 0.05 0", attach("0.1") + "<cotwin:Event time=\"0.2\" detach=\"rod\" components=\"control drive mon.l\"/>",
        "post.sdf");
  EXPECT_EQ(check({}, "post.sdf").code, 0) << check({}, "post.sdf").out;
  write("-1.9 0.05 0", attach("2.5"), "post.sdf");
  const RunResult late = check({}, "post.sdf");
  EXPECT_EQ(told(late), 2.5) << late.out;
  EXPECT_NEAR(meets_at(), 2.5, 2e-3);
}

TEST_F(TwoRobots, InsideASolidAreNotClear) {
  write("-4 0 0", "", "block.sdf");
  const RunResult inside = check({}, "block.sdf");
  EXPECT_THAT(inside.out, ::testing::ContainsRegex("error: l: [a-z0-9_]+ meets block at 0 s"));
  EXPECT_THAT(inside.out, HasSubstr("note: r: clear"));
  EXPECT_EQ(meets_at(), 0);
  // One triangle is missing: nothing is inside, which is told.
  std::string hole = block("block");
  hole.erase(hole.find("facet"), hole.find("endfacet") + 9 - hole.find("facet"));
  folder_.write("block.stl", hole);
  const RunResult open = check({}, "block.sdf");
  EXPECT_EQ(open.code, 0);
  EXPECT_THAT(open.out, HasSubstr("note: l: not closed, so that nothing counts as inside: block"));
  EXPECT_THAT(open.out, HasSubstr("block.stl: open: its 13 triangles are a surface, with solid behind it for contacts only"));
  EXPECT_EQ(meets_at(), -1);
}

// The monitor sees the same motion, at every millisecond.
TEST(ExciteClearOf, FindsAMotionThatAMonitorSeesTouchNothing) {
  const cotwin::testing::TemporaryFolder folder("excite_clear");
  folder.write(
      "floor.sdf",
      "<sdf version=\"1.11\"><world name=\"w\"><model name=\"floor\"><static>true</static><pose>0 0 -0.02 0 0 0</pose><link "
      "name=\"floor\"><collision name=\"c\"><geometry><plane><normal>0 0 1</normal></plane></geometry></collision></link>"
      "</model></world></sdf>");
  const auto excite = [&](std::vector<std::string> more) {
    std::vector<std::string> command{"excite",      "--robot", "ur5e",  "--rounds",           "12",
                                     "--particles", "8",       "--out", folder / "motion.csv"};
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command);
  };
  const auto watched = [&] {
    const RunResult run = run_program({"run", folder / "cell.ssd", "--out", folder / "results", "--quiet"});
    EXPECT_EQ(run.code, 0) << run.err;
    std::ifstream in(folder / "results/signals.csv");
    std::string line;
    double least = 1e12;
    for (std::getline(in, line); std::getline(in, line);) {
      std::istringstream row(line);
      std::string t, distance, self;
      std::getline(row, t, ',') && std::getline(row, distance, ',') && std::getline(row, self, ',');
      least = std::min({least, std::stod(distance), std::stod(self)});
    }
    fs::remove_all(folder / "results");
    return least;
  };
  folder.write("cell.ssd", R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="cell" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="cell">
    <ssd:Elements>
      <ssd:Component name="motion" source="unit:motion?robot=ur5e&amp;kind=csv" type="application/x-cotwin-unit">
        <ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="file"><ssv:Parameters>
          <ssv:Parameter name="file"><ssv:String value=")" +
                               (folder / "motion.csv").string() +
                               R"("/></ssv:Parameter>
        </ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>
      </ssd:Component>
      <ssd:Component name="monitor" source="unit:monitor?robot=ur5e&amp;scene=floor.sdf" type="application/x-cotwin-unit"/>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startElement="motion" startConnector="q_d" endElement="monitor" endConnector="q"/>
    </ssd:Connections>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="10"/>
  <ssd:Annotations><ssc:Annotation type="cotwin.master">
    <cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="2 ms">
      <cotwin:Component name="motion" stage="0"/>
      <cotwin:Component name="monitor" stage="1"/>
      <cotwin:Recording decimation="1"><cotwin:Record variables="monitor.distance monitor.self_distance"/></cotwin:Recording>
    </cotwin:Master>
  </ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>
)");
  ASSERT_EQ(excite({"--quiet"}).code, 0);
  EXPECT_LT(watched(), 0) << "without a scene this robot touches itself or the floor";
  const auto checked = [&] { return run_program({"check", folder / "cell.ssd", "--clear-of", folder / "floor.sdf"}); };
  EXPECT_THAT(checked().out, ::testing::ContainsRegex("error: motion: [a-z0-9_]+ meets [a-z0-9_]+ at [0-9.]+ s"));
  const RunResult found = excite({"--clear-of", folder / "floor.sdf"});
  ASSERT_EQ(found.code, 0) << found.err;
  EXPECT_THAT(found.err,
              ::testing::ContainsRegex("search 1: [a-z0-9_]+ meets [a-z0-9_]+ at [0-9.]+ s; again with smaller ranges"));
  EXPECT_THAT(found.out, HasSubstr("clear: "));
  EXPECT_THAT(found.out, ::testing::Not(HasSubstr("not checked for collisions")));
  EXPECT_GT(watched(), 0);
  EXPECT_THAT(checked().out, HasSubstr("note: motion: clear; nearest: "));
  folder.write("far.csv", "x,y,z\n3,0,1\n");
  const RunResult both = excite({"--clear-of", folder / "floor.sdf", "--clear-of", folder / "far.csv"});
  EXPECT_EQ(both.out, found.out);
  EXPECT_THAT(both.err, HasSubstr("the 1 point of far.csv have balls of 0 m"));

  fs::remove(folder / "motion.csv");
  const RunResult never = excite({"--floor", "0.3"});
  EXPECT_EQ(never.code, 2);
  EXPECT_THAT(never.err, HasSubstr("meets floor in every posture"));
  EXPECT_FALSE(fs::exists(folder / "motion.csv")) << "nothing is written";
}

}  // namespace
}  // namespace clear_of_test
