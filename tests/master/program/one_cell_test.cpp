// What check, scan and clear_of say of a cell is what a monitor sees in the run, whoever places what.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>
#include <regex>
#include <string>
#include <vector>

#include "components/services/json/json.h"
#include "components/services/robots.h"
#include "master/run/master.h"
#include "master/scenario/folders.h"
#include "master/workflows/clear_of.h"
#include "models/collision/meeting/meeting.h"
#include "models/foundation/support/text.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::master::one_cell_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::error_of;
using Eigen::Vector3d;
using nlohmann::json;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr int kScenarios = 40, kStanding = 50;

std::string numbers(std::initializer_list<double> all) { return text::joined(std::span(all.begin(), all.size())); }
std::string words(const Vector3d& v) { return numbers({v.x(), v.y(), v.z()}); }
std::string words(const Eigen::Quaterniond& q) { return numbers({q.w(), q.x(), q.y(), q.z()}); }

/// A scenario in the making.
struct Text {
  std::string components, connections, events;

  void add(const std::string& name, const std::string& source, const std::vector<std::array<std::string, 2>>& values) {
    components += "<ssd:Component name=\"" + name + "\" source=\"unit:" + source +
                  "\" type=\"application/x-cotwin-unit\"><ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
                  "<ssv:ParameterSet version=\"1.0\" name=\"p\"><ssv:Parameters>";
    for (const auto& [parameter, value] : values)
      components += "<ssv:Parameter name=\"" + parameter + "\"><ssv:String value=\"" + value + "\"/></ssv:Parameter>";
    components +=
        "</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"
        "</ssd:Component>";
  }
  void connect(const std::string& from, const std::string& source, const std::string& to, const std::string& target,
               double offset = 0) {
    connections += "<ssd:Connection startElement=\"" + from + "\" startConnector=\"" + source + "\" endElement=\"" + to +
                   "\" endConnector=\"" + target + "\"><ssc:LinearTransformation factor=\"1\" offset=\"" +
                   text::to_text(offset) + "\"/></ssd:Connection>";
  }
  std::string ssd(double stop) const {
    return "<?xml version=\"1.0\" encoding=\"UTF-8\"?><ssd:SystemStructureDescription version=\"1.0\" name=\"cell\" "
           "xmlns:ssd=\"http://ssp-standard.org/SSP1/SystemStructureDescription\" "
           "xmlns:ssc=\"http://ssp-standard.org/SSP1/SystemStructureCommon\" "
           "xmlns:ssv=\"http://ssp-standard.org/SSP1/SystemStructureParameterValues\"><ssd:System name=\"cell\">"
           "<ssd:Elements>" +
           components + "</ssd:Elements><ssd:Connections>" + connections +
           "</ssd:Connections></ssd:System><ssd:DefaultExperiment startTime=\"0\" stopTime=\"" + text::to_text(stop) +
           "\"/><ssd:Annotations><ssc:Annotation type=\"cotwin.master\">"
           "<cotwin:Master xmlns:cotwin=\"urn:cotwin:master:1\" tick=\"2 ms\">" +
           events + "</cotwin:Master></ssc:Annotation></ssd:Annotations></ssd:SystemStructureDescription>";
  }
};

std::string box(const std::string& name, const Vector3d& p, const Vector3d& size) {
  return "<model name=\"" + name + "\"><static>true</static><pose>" + words(p) + " 0 0 0</pose><link name=\"" + name +
         "\"><collision name=\"c\"><geometry><box><size>" + words(size) + "</size></box></geometry></collision></link></model>";
}
std::string world(const std::string& bodies) { return "<sdf version=\"1.11\"><world name=\"w\">" + bodies + "</world></sdf>"; }

/// Cells with robots that a monitor watches, drawn from one seed.
class OneCell : public ::testing::Test {
 protected:
  OneCell() {
    folder_.write("rod.urdf",
                  "<robot name=\"rod\"><link name=\"rod\"><inertial><mass value=\"0.2\"/><inertia ixx=\"1e-3\" iyy=\"1e-3\" "
                  "izz=\"1e-3\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial><collision><origin xyz=\"0 0 0.15\"/><geometry><box "
                  "size=\"0.04 0.04 0.3\"/></geometry></collision></link></robot>");
  }
  double real(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  bool chance(double share) { return real(0, 1) < share; }
  Vector3d around(double near, double far) {
    const double angle = real(-3.14, 3.14), r = real(near, far);
    return {r * std::cos(angle), r * std::sin(angle), real(0.1, 1.1)};
  }
  Eigen::Quaterniond turn() { return Eigen::Quaterniond(real(-1, 1), real(-1, 1), real(-1, 1), real(-1, 1)).normalized(); }

  struct Watched {
    std::string name, model, link;  // link: in the monitor, "a/"
    Vector3d p;
    double yaw;
    std::vector<double> q;
  };

  /// `stands`: each robot rests. Then `request` has the same cell as a request for the first one.
  void make(bool stands) {
    static const std::array<std::string, 2> kModels{"ur5e", "lwr4"};
    Text text;
    robots_.clear();
    request_ = {};
    const std::size_t n = stands ? 1 + (random_() % 2) : 1 + random_() % 3;
    std::string robots;
    std::vector<std::array<std::string, 2>> values;
    for (std::size_t k = 0; k < n; ++k) {
      Watched robot{n == 1 && chance(0.5) ? "" : std::string(1, static_cast<char>('a' + k)),
                    kModels[random_() % 2],
                    "",
                    {},
                    real(-3, 3),
                    {}};
      robot.p = {static_cast<double>(k) * real(0.9, 1.6), real(-0.2, 0.2), real(0, 0.3)};
      const std::size_t joints = robot.model == "ur5e" ? 6 : 7;
      for (std::size_t j = 0; j < 2 * joints; ++j)
        robot.q.push_back(j >= joints && stands ? robot.q[j - joints] : real(-1, 1) - (joints == 6 && j % joints == 1 ? 1 : 0));
      robot.link = robot.name.empty() ? "" : robot.name + "/";
      if (robot.name.empty())
        robots = "robot=" + robot.model;
      else
        robots += (robots.empty() ? "robots=" : ",") + robot.name + ":" + robot.model;
      const std::string motion = "move" + std::to_string(k), x = robot.name.empty() ? "" : robot.name + ".";
      text.add(motion, "motion?robot=" + robot.model + "&amp;points=2",
               {{"limits", "warn"},
                {"waypoint_t", "0 " + std::string(stands ? "0.02" : "1.5")},
                {"waypoint_q", text::joined(robot.q)}});
      text.connect(motion, "q_d", "monitor", x + "q");
      values.push_back({x + "base_p0", words(robot.p)});
      values.push_back({x + "base_quat0", words(Eigen::Quaterniond(Eigen::AngleAxisd(robot.yaw, Vector3d::UnitZ())))});
      robots_.push_back(robot);
    }
    std::string bodies, request_bodies, obstacles, ignore;
    std::vector<std::array<std::string, 2>> in_world;
    const int count = static_cast<int>(random_() % 6);
    for (int k = 0; k < count; ++k) {
      const std::string name = "box" + std::to_string(k);
      const Vector3d size(real(0.05, 0.25), real(0.05, 0.25), real(0.05, 0.3)), p = around(0.25, stands ? 0.5 : 1.1);
      bodies += box(name, p, size);
      const Vector3d moved = around(0.25, stands ? 0.5 : 1.1);
      if (chance(0.3)) {
        obstacles += (obstacles.empty() ? "" : ",") + name;
        const double scale = chance(0.5) ? real(0.3, 2) : 1;
        const bool present = chance(0.7);
        values.push_back({name + ".p", words(moved)});
        values.push_back({name + ".scale", text::to_text(scale)});
        values.push_back({name + ".present", present ? "1" : "0"});
        if (present) request_bodies += box(name, moved, scale * size);
      } else if (chance(0.5)) {
        values.push_back({name + ".p0", words(moved)});
        if (!stands) values.push_back({name + ".quat0", words(turn())});
        in_world.push_back({name + ".p0", words(chance(0.5) ? moved : p)});
        request_bodies += box(name, moved, size);
      } else {
        request_bodies += box(name, p, size);
      }
      if (!stands && chance(0.3)) {
        const Watched& robot = robots_[random_() % n];
        ignore += (ignore.empty() ? "" : ",") + robot.link + (robot.model == "ur5e" ? "wrist_1_link" : "link_5") + ":" + name;
      }
    }
    folder_.write("cell.sdf", world(bodies));
    folder_.write("request.sdf", world(request_bodies));
    std::string source = "monitor?" + robots + "&amp;scene=cell.sdf&amp;obstacles=" + obstacles;
    json clear_of{{"scene", folder_ / "request.sdf"}};
    if (chance(0.5)) {
      std::string points;
      const Vector3d p = around(0.3, 1);
      for (int k = 0; k < 60; ++k)
        points += words(p + Vector3d(real(-0.15, 0.15), real(-0.15, 0.15), real(-0.15, 0.15))) + "\n";
      folder_.write("cell.xyz", points);
      source += "&amp;cloud=cell.xyz";
      const Vector3d moved(real(-0.4, 0.4), real(-0.4, 0.4), real(-0.2, 0.2));
      const Eigen::Quaterniond turned = turn();
      const double radius = real(0.005, 0.08);
      values.push_back({"cloud.p0", words(moved)});
      values.push_back({"cloud.quat0", words(turned)});
      values.push_back({"cloud.r", text::to_text(radius)});
      clear_of["cloud"] = {{"name", folder_ / "cell.xyz"},
                           {"radius_m", radius},
                           {"p_m", {moved.x(), moved.y(), moved.z()}},
                           {"quaternion_wxyz", {turned.w(), turned.x(), turned.y(), turned.z()}}};
    }
    if (!ignore.empty()) source += "&amp;ignore=" + ignore;
    if (!stands && chance(0.5)) values.push_back({"r", text::to_text(real(0, 0.06))});
    text.add("monitor", source, values);
    if (chance(0.5)) text.add("world", "contact_world?scene=cell.sdf", in_world);
    if (!stands && chance(0.3)) {
      const Watched& robot = robots_[random_() % n];
      text.add("carrier", "drive_train?robot=" + robot.model, {});
      text.events = "<cotwin:Event time=\"" + text::to_text(chance(0.5) ? 0 : 0.002 * static_cast<double>(random_() % 700)) +
                    "\" attach=\"rod\" parent=\"" + (robot.model == "ur5e" ? "wrist_3_link" : "link_7") +
                    "\" file=\"rod.urdf\" components=\"carrier monitor" + (robot.name.empty() ? "" : "." + robot.name) + "\"/>";
    }
    folder_.write("cell.ssd", text.ssd(stands ? 0.02 : 1.5));
    if (!stands) return;
    const auto base = [](const Watched& robot) {
      return json{{"p_m", {robot.p.x(), robot.p.y(), robot.p.z()}},
                  {"quaternion_wxyz", {std::cos(robot.yaw / 2), 0, 0, std::sin(robot.yaw / 2)}}};
    };
    const auto posture = [](const Watched& robot) {
      return std::vector<double>(robot.q.begin(), robot.q.begin() + static_cast<std::ptrdiff_t>(robot.q.size() / 2));
    };
    clear_of["base"] = base(robots_.front());
    clear_of["self"] = false;
    for (std::size_t k = 1; k < n; ++k)
      clear_of["robots"].push_back(
          {{"robot", robots_[k].model}, {"name", "other"}, {"base", base(robots_[k])}, {"q_rad", posture(robots_[k])}});
    const std::vector<double> q = posture(robots_.front());
    request_ = {{"service", "feasibility"}, {"robot", robots_.front().model}, {"from_q_rad", q}, {"to_q_rad", q}, {"T_s", 1},
                {"clear_of", clear_of}};
  }

  struct Seen {
    double least = 1e12, at_start = 0, at = 1e12;  // m
    std::array<std::int32_t, 2> pair{};
  };
  /// The names of the monitor's numbers, from 1.
  std::vector<std::string> parts(const Scenario& scenario) const {
    const ScenarioCell all = cell_of(scenario, {.names = {"monitor"}, .motions = motions()}, unit_types());
    std::vector<std::string> names{""};
    for (const auto& body : all.cell.bodies) names.push_back(body.body.name);
    for (const auto& cloud : all.cell.clouds) names.push_back(cloud.name);
    for (std::size_t k = 0; k < robots_.size(); ++k) {
      const auto& robot =
          *std::ranges::find(all.cell.robots, "move" + std::to_string(k), [](const auto& one) { return one.robot.name; });
      names.push_back(robot.robot.name + "/" + (robot.robot.model.base.name.empty() ? "base" : robot.robot.model.base.name));
      for (const auto& link : robot.robot.model.bodies) names.push_back(robot.robot.name + "/" + link.name);
    }
    return names;
  }
  std::vector<std::pair<std::string, std::size_t>> motions() const {
    std::vector<std::pair<std::string, std::size_t>> all;
    for (std::size_t k = 0; k < robots_.size(); ++k) all.emplace_back("move" + std::to_string(k), robots_[k].q.size() / 2);
    return all;
  }

  /// What the monitor of a run sees of each robot.
  std::vector<Seen> run() {
    MasterOptions options;
    options.types = unit_types();
    options.folders = model_folders(folder_.path());
    Master master(load_scenario(folder_ / "cell.ssd"), std::move(options));
    master.initialise();
    const Variables& v = std::ranges::find(master.members(), std::string("monitor"), &Member::name)->variables();
    std::vector<Seen> seen(robots_.size());
    for (bool on = true, first = true;; first = false) {
      for (std::size_t k = 0; k < seen.size(); ++k) {
        const std::string x = robots_[k].name.empty() ? "" : robots_[k].name + ".";
        const double distance = v.at(x + "distance").reals()[0];
        seen[k].least = std::min(seen[k].least, v.at(x + "least_distance").reals()[0]);
        if (first) seen[k].at_start = distance;
        if (distance < seen[k].at) {
          seen[k].at = distance;
          std::ranges::copy(v.at(x + "pair").integers(), seen[k].pair.begin());
        }
      }
      if (!on) return seen;
      on = master.step_tick();
    }
  }

  std::vector<fmu::Finding> check(std::vector<std::string> names = {"monitor"}) {
    return check_clear(folder_ / "cell.ssd", unit_types(), names, {});
  }
  static std::string joined(const std::vector<fmu::Finding>& findings) {
    std::string all;
    for (const fmu::Finding& one : findings)
      all += (one.level == fmu::Finding::Level::kError     ? "error: "
              : one.level == fmu::Finding::Level::kWarning ? "warning: "
                                                           : "note: ") +
             one.text + "\n";
    return all;
  }

  std::mt19937 random_{115};
  cotwin::testing::TemporaryFolder folder_{"one_cell"};
  std::vector<Watched> robots_;
  json request_;
};

/// What a finding says of a robot: whether it is clear, the distance in m, which is rounded by at most `half`, and the names.
struct Said {
  bool known = false, clear = true;
  double d = 1e12, half = 0;
  std::string link, other;
};
Said said_of(const std::vector<fmu::Finding>& findings, const std::string& motion) {
  Said said;
  for (const fmu::Finding& one : findings) {
    std::smatch found;
    static const std::regex meets("(\\S+): (\\S+) meets (\\S+) at .*"),
        clear("(\\S+): clear; nearest: (\\S+), (\\S+) m from (\\S+) at .*"), nothing("(\\S+): clear; there is nothing to meet");
    if (std::regex_match(one.text, found, meets) && found[1] == motion) said = {true, false, 0, 0, found[2], found[3]};
    if (std::regex_match(one.text, found, clear) && found[1] == motion) {
      said = {true, true, std::stod(found[3]), 0, found[2], found[4]};
      said.half = 0.51e-2 * std::pow(10, std::floor(std::log10(said.d)));
    }
    if (std::regex_match(one.text, found, nothing) && found[1] == motion) said.known = true;
  }
  return said;
}

TEST_F(OneCell, CheckMeetsWhatTheMonitorOfTheRunSees) {
  int clear = 0, meeting = 0, others = 0;
  for (int k = 0; k < kScenarios; ++k) {
    make(false);
    const std::vector<std::string> names = parts(load_scenario(folder_ / "cell.ssd"));
    const std::vector<fmu::Finding> findings = check();
    const std::vector<Seen> seen = run();
    for (std::size_t r = 0; r < seen.size(); ++r) {
      const Said said = said_of(findings, "move" + std::to_string(r));
      ASSERT_TRUE(said.known) << k << ": " << joined(findings);
      const bool body = said.other.starts_with("box") || said.other == "cloud" || said.other.find('/') != std::string::npos;
      if (!said.clear && !body) continue;  // its own links, which least_distance does not count
      const double within = 1e-4 + 1e-3 * std::abs(seen[r].least);
      if (std::abs(seen[r].least) < within) continue;  // nobody can know
      ASSERT_EQ(said.clear, seen[r].least > 0) << k << ", robot " << r << ": " << seen[r].least << "\n"
                                               << joined(findings) << folder_.path();
      ++(said.clear ? clear : meeting);
      if (!said.clear) continue;
      EXPECT_NEAR(said.d, seen[r].least, within + said.half) << k << ", robot " << r << "\n" << joined(findings);
      if (seen[r].least > 1e11) continue;
      // Of the tick's end, and the links of the monitor have the tool.
      const auto name = [&](int at) {
        return names.at(static_cast<std::size_t>(seen[r].pair.at(static_cast<std::size_t>(at))));
      };
      const bool same = name(0) == "move" + std::to_string(r) + "/" + said.link && name(1) == said.other;
      others += same || said.link == "rod" || said.other.ends_with("/rod") ? 0 : 1;
    }
  }
  EXPECT_LE(others, 1 + clear / 50) << "two pairs are seldom as near";
  EXPECT_GT(clear, kScenarios / 4);
  EXPECT_GT(meeting, kScenarios / 4);
}

// A robot that stands: the same by a check, by a request with the same numbers, by the monitor, and as a leg of a scan.
TEST_F(OneCell, AllThatAreAskedSayTheSame) {
  services::Robots library({cotwin::places::source() + "/models/robots"}, "", true);
  int clear = 0, meeting = 0;
  for (int k = 0; k < kStanding; ++k) {
    make(true);
    const Said said = said_of(check(), "move0");
    const Seen seen = run().front();
    const json reply = json::parse(services::answer(library, request_.dump()));
    ASSERT_TRUE(reply.contains("clear_of")) << reply.dump(2);
    LegCheck leg(load_scenario(folder_ / "cell.ssd"), "move0",
                 {.names = {"monitor"}, .motions = {{"move0", robots_.front().q.size() / 2}}}, unit_types());
    const std::span<const double> q = std::span(robots_.front().q).first(robots_.front().q.size() / 2);
    const std::string met = leg.meets(q, q);
    const bool body = said.other.starts_with("box") || said.other == "cloud" || said.other.find('/') != std::string::npos;
    if (!said.clear && !body) continue;
    ++(said.clear ? clear : meeting);
    EXPECT_EQ(said.clear, seen.at_start > 0) << k;
    EXPECT_EQ(said.clear, reply["clear_of"]["clear"]) << k;
    EXPECT_EQ(said.clear, met.empty()) << k << met;
    if (!said.clear) continue;
    const double within = std::max(1e-4, 1e-3 * seen.at_start);
    EXPECT_NEAR(said.d, seen.at_start, within + said.half);
    if (seen.at_start < 1e11) {
      EXPECT_NEAR(reply["clear_of"]["nearest"]["distance_m"].get<double>(), seen.at_start, within);
    }
  }
  EXPECT_GT(clear, kStanding / 4);
  EXPECT_GT(meeting, kStanding / 8);
}

/// One UR5e that stands at the origin, and components beside its motion.
class Placed : public OneCell {
 protected:
  using Values = std::vector<std::array<std::string, 2>>;
  Placed() {
    folder_.write("cell.sdf", world(box("post", {5, 0, 0.5}, {0.2, 0.2, 0.2}) + box("table", {0, 5, 0.5}, {0.2, 0.2, 0.2})));
    folder_.write("other.sdf", world(box("table", {0, -5, 0.5}, {0.2, 0.2, 0.2})));
    folder_.write("cell.xyz", "0 0 9\n");
    text_.add("motion", "motion?robot=ur5e&amp;points=2",
              {{"waypoint_t", "0 1"}, {"waypoint_q", "0 -1.5 1.5 -1.5 -1.5 0 0 -1.5 1.5 -1.5 -1.5 0"}});
  }
  void watch(const std::string& name, const std::string& settings, const Values& values, const std::string& unit = "monitor") {
    text_.add(name, unit + "?robot=ur5e" + settings, values);
    text_.connect("motion", "q_d", name, "q");
  }
  std::string said(std::vector<std::string> names) {
    folder_.write("cell.ssd", text_.ssd(1));
    for (std::string& name : names)
      if (name.find('.') != std::string::npos && name.find('/') == std::string::npos) name = folder_ / name;
    return joined(check(names));
  }
  /// In reach of the robot, whose upper arm goes up from (0 0 0.16).
  static constexpr const char* kNear = "0 0 0.4";
  Text text_;
};

TEST_F(Placed, ByTheComponentsOfTheScenario) {
  watch("monitor", "&amp;scene=cell.sdf&amp;cloud=cell.xyz", {{"post.p0", kNear}, {"cloud.r", "0.03"}, {"cloud.p0", "0 0 -1"}});
  const std::string of_scene = said({"cell.sdf"});
  EXPECT_THAT(of_scene,
              HasSubstr("error: motion: upper_arm_link meets post at 0 s, between waypoints 1 and 2, overlapping by "));
  EXPECT_THAT(of_scene, HasSubstr("note: places: motion at (0 0 0) m by monitor; post at (0 0 0.4) m by monitor\n"));
  // The same file by another path.
  fs::create_symlink(folder_ / "cell.xyz", folder_ / "linked.xyz");
  for (const char* name : {"cell.xyz", "linked.xyz"}) {
    const std::string of_cloud = said({name});
    EXPECT_THAT(of_cloud, HasSubstr("cloud at (0 0 -1) m with balls of 0.03 m by monitor\n"));
    EXPECT_THAT(of_cloud, HasSubstr("motion: clear; nearest: "));
  }
  const std::string all = said({"monitor"});
  EXPECT_THAT(all, HasSubstr("meets post at 0 s"));
  EXPECT_THAT(all, HasSubstr("; cloud at (0 0 -1) m with balls of 0.03 m by monitor"));
  // A scene that nobody has, with a body of the same name as one that the monitor has.
  const std::string other = said({"monitor", "other.sdf"});
  EXPECT_THAT(other, HasSubstr("note: no component of the scenario has other.sdf, which stands as in its file"));
  EXPECT_THAT(said({"other.sdf"}), HasSubstr("note: motion: clear; nearest: "));
}

TEST_F(Placed, ByTwoComponentsDifferently) {
  watch("monitor", "&amp;scene=cell.sdf&amp;cloud=cell.xyz", {{"post.p0", kNear}, {"base_p0", "0 0 0.1"}});
  watch("second", "&amp;scene=cell.sdf&amp;cloud=cell.xyz", {{"table.p0", "0 5 0.50005"}, {"cloud.r", "0.2"}});
  watch("scanner", "&amp;scene=other.sdf", {{"base_p0", "0 0 0.1"}}, "scanner");
  const std::string told = said({"cell.sdf"});
  EXPECT_THAT(told, HasSubstr("warning: post stands at (0 0 0.4) m by monitor, at (5 0 0.5) m in cell.sdf of second\n"));
  EXPECT_THAT(
      told,
      HasSubstr(
          "warning: cell.xyz stands at (0 0 0) m with balls of 0 m by monitor, at (0 0 0) m with balls of 0.2 m by second\n"));
  EXPECT_THAT(told, HasSubstr("moves stands at (0 0 0.1) m by monitor, at (0 0 0) m by second\n"));
  EXPECT_THAT(told, Not(HasSubstr("table stands")));
  EXPECT_THAT(told, Not(::testing::ContainsRegex("warning: [^\n]* by scanner")));
  EXPECT_THAT(told, HasSubstr("meets post at 0 s"));
  EXPECT_THAT(said({"second"}), HasSubstr("motion: clear; nearest: "));
}

TEST_F(Placed, WhereAContactWorldHasWhatAMonitorIsFed) {
  folder_.write(
      "block.sdf",
      world("<model name=\"block\"><pose>3 0 0.5 0 0 0</pose><link "
            "name=\"block\"><inertial><mass>1</mass><inertia><ixx>0.01</ixx><iyy>0.01</iyy><izz>0.01</izz></inertia></inertial>"
            "<collision name=\"c\"><geometry><box><size>0.2 0.2 0.2</size></box></geometry></collision></link></model>"));
  text_.add("world", "contact_world?scene=block.sdf", {{"block.p0", kNear}});
  watch("monitor", "&amp;scene=block.sdf", {});
  for (const char* name : {"p", "quat"})
    text_.connect("world", std::string("block.") + name, "monitor", std::string("block.") + name);
  for (const char* name : {"monitor", "world", "block.sdf"}) {
    const std::string told = said({name});
    EXPECT_THAT(told, HasSubstr("upper_arm_link meets block at 0 s")) << name;
    EXPECT_THAT(told, HasSubstr("block at (0 0 0.4) m by world"));
    EXPECT_THAT(told, HasSubstr("note: motion: may move in the run, and are taken where they start: block"));
    EXPECT_THAT(told, Not(HasSubstr("warning: block stands")));
  }
}

// Events, connections and names that would otherwise be a "clear" in silence.
TEST_F(Placed, ByWhatConnectionsAndEventsDo) {
  const Text before = text_;
  watch("monitor", "&amp;scene=cell.sdf&amp;cloud=cell.xyz", {{"post.p0", "0.6 0 0.4"}, {"cloud.p0", "0.6 0 -8.6"}});
  EXPECT_THAT(said({"monitor"}), HasSubstr("motion: clear"));
  for (const char* name : {"r", "cloud.r"}) {
    text_.events = std::string("<cotwin:Event time=\"0.5\" variable=\"monitor.") + name + "\" value=\"0.7\"/>";
    EXPECT_THAT(said({"monitor"}), HasSubstr("error: motion: ")) << name;
  }
  // Positions with an offset are another motion.
  text_ = before;
  text_.add("monitor", "monitor?robot=ur5e&amp;scene=cell.sdf", {{"post.p0", kNear}});
  text_.connect("motion", "q_d", "monitor", "q", 0.5);
  const std::string changed = said({"monitor"});
  EXPECT_THAT(changed, HasSubstr("note: motion follows motion by connections that change positions"));
  EXPECT_THAT(changed, HasSubstr("note: motion: not checked for collisions, because its robot is not known"));
  // A monitor names links by its own robots, whatever the motions are called, and a body by its own scene.
  text_ = before;
  text_.add(
      "monitor",
      "monitor?robots=motion:ur5e,left-arm:ur5e&amp;scene=cell.sdf&amp;ignore=motion/upper_arm_link:post,left-arm/base:post",
      {{"motion.base_p0", "3 0 0"}, {"post.p0", kNear}});
  text_.connect("motion", "q_d", "monitor", "left_arm.q");
  EXPECT_THAT(said({"monitor"}), HasSubstr("error: motion: "));
  folder_.write("post.sdf", world(box("post", {9, 9, 9}, {0.2, 0.2, 0.2})));
  text_ = before;
  watch("monitor", "&amp;scene=cell.sdf&amp;ignore=upper_arm_link:post,shoulder_link:post,forearm_link:post",
        {{"post.p0", kNear}});
  for (const std::vector<std::string>& names : {std::vector<std::string>{"post.sdf", "monitor"}, {"monitor", "post.sdf"}})
    EXPECT_THAT(said(names), HasSubstr("motion: clear"));
  // Who of two is named has the base, the shapes and what is there.
  watch("second", "&amp;scene=cell.sdf&amp;obstacles=table", {{"table.present", "0"}, {"base_p0", "0 5 0.1"}});
  const std::string second = said({"second"});
  EXPECT_THAT(second, HasSubstr("motion at (0 5 0.1) m by second"));
  EXPECT_THAT(
      second,
      HasSubstr(
          "warning: table stands at (0 5 0.5) m in cell.sdf of monitor, at (0 5 0.5) m, not there in cell.sdf of second"));
}

TEST_F(Placed, TwoRobotsThatFollowOneMotionAreTwo) {
  const auto with = [&](const char* b) {
    text_ = {};
    text_.add("motion", "motion?robot=ur5e&amp;points=2",
              {{"waypoint_t", "0 1"}, {"waypoint_q", "0 -1.5 1.5 -1.5 -1.5 0 0 -1.5 1.5 -1.5 -1.5 0"}});
    text_.add("monitor", "monitor?robots=a:ur5e,b:ur5e&amp;scene=cell.sdf", {{"b.base_p0", b}, {"post.p0", "2 0 0.4"}});
    for (const char* q : {"a.q", "b.q"}) text_.connect("motion", "q_d", "monitor", q);
    return said({"monitor"});
  };
  const std::string near = with("0.1 0 0");
  EXPECT_THAT(near, HasSubstr("error: motion: "));
  EXPECT_THAT(near, HasSubstr(" meets monitor.b/"));
  const std::string apart = with("2 0 0");
  EXPECT_THAT(apart, HasSubstr("note: motion: clear; nearest: "));
  EXPECT_THAT(apart, HasSubstr("error: monitor.b: upper_arm_link meets post at 0 s"));
}

TEST_F(Placed, WhatCannotBeIsTold) {
  const auto with = [&](const Values& values) {
    text_ = {};
    text_.add("motion", "motion?robot=ur5e&amp;points=2",
              {{"waypoint_t", "0 1"}, {"waypoint_q", "0 -1.5 1.5 -1.5 -1.5 0 0 -1.5 1.5 -1.5 -1.5 0"}});
    watch("monitor", "&amp;scene=cell.sdf&amp;obstacles=table", values);
    return error_of([&] { (void)said({"cell.sdf"}); });
  };
  EXPECT_THAT(with({{"post.p0", "nan 0 0"}}), HasSubstr("post.p0"));
  EXPECT_THAT(with({{"post.quat0", "0 0 0 0"}}),
              HasSubstr("monitor.post.quat0: the quaternion (w, x, y, z) has length 0, expected 1"));
  EXPECT_EQ(with({{"table.quat", "0 0 0 0"}}), "");
  EXPECT_THAT(
      error_of([&] { (void)said({"motion"}); }),
      HasSubstr("--clear-of motion: is a component that watches nothing, expected a monitor, a scanner or a contact world"));
  EXPECT_THAT(error_of([&] { (void)said({"monitor", "monitor"}); }), HasSubstr("--clear-of monitor: is the second component"));
  EXPECT_THAT(error_of([&] { (void)said({"nothing"}); }),
              HasSubstr("is neither a file nor the name of a scene, nor a component"));
  // The name of a scene of the library, too.
  watch("table", "&amp;scene=cell.sdf", {{"post.p0", kNear}});
  const std::string both = said({"table"});
  EXPECT_THAT(both, HasSubstr("note: table is a component of the scenario and a scene, expected one: the component is taken"));
  EXPECT_THAT(both, HasSubstr("meets post at 0 s"));
  // One that is not there, and one that an event brings.
  text_ = {};
  text_.add("motion", "motion?robot=ur5e&amp;points=2",
            {{"waypoint_t", "0 1"}, {"waypoint_q", "0 -1.5 1.5 -1.5 -1.5 0 0 -1.5 1.5 -1.5 -1.5 0"}});
  watch("monitor", "&amp;scene=cell.sdf&amp;obstacles=post", {{"post.p", kNear}, {"post.present", "0"}});
  const std::string absent = said({"monitor"});
  EXPECT_THAT(absent, HasSubstr("note: motion: not there at the start, so that nothing meets it: post"));
  EXPECT_THAT(absent, HasSubstr("motion: clear"));
  text_.events = "<cotwin:Event time=\"0.5\" variable=\"monitor.post.present\" value=\"1\"/>";
  EXPECT_THAT(said({"monitor"}), HasSubstr("meets post at 0 s"));
}

}  // namespace
}  // namespace cotwin::master::one_cell_test
