// `cotwin run --view`: the run is the same with and without it, the page has what the run has, and works in Chromium.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <thread>

#include "master/scenery/recorded.h"
#include "master/view/calculated.h"
#include "models/robot/frame_kinematics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/files.h"
#include "tests/support/http_client.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace cotwin::master::live_page_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::http_call;
using cotwin::testing::HttpReply;
using cotwin::testing::Process;
using cotwin::testing::RawClient;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;
using cotwin::testing::within_patience;
using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::Not;

class LivePage : public ::testing::Test {
 protected:
  RunResult cotwin(std::vector<std::string> arguments) {
    return cotwin::testing::run_program(std::move(arguments), {.folder = folder_.path()});
  }
  /// `cotwin run` with these arguments and --view=0. The process writes to said().
  Process start(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "run");
    arguments.insert(arguments.end(), {"--view=0", "--quiet"});
    Process process = cotwin::testing::start_program(std::move(arguments),
                                                     {.folder = folder_.path(), .merge = true, .out = folder_ / "said"});
    const std::regex live(R"(live at (http://localhost:(\d+)/)\n)");
    std::smatch match;
    std::string said;
    const bool begun = within_patience([&] {
      said = content(folder_ / "said");
      return std::regex_search(said, match, live);
    });
    if (!begun) throw std::runtime_error("the run does not begin: " + said);
    url_ = match[1];
    port_ = static_cast<std::uint16_t>(std::stoi(match[2]));
    return process;
  }
  std::string said() const { return content(folder_ / "said"); }
  HttpReply call(const std::string& method, const std::string& target, const std::string& body = "") const {
    return http_call(port_, method, target, body);
  }
  json get(const std::string& target) const { return json::parse(call("GET", target).body); }
  std::string example(const std::string& name) const { return (fs::path(places::source()) / "examples" / name).string(); }

  const TemporaryFolder folder_{"live_page"};
  std::string url_;
  std::uint16_t port_ = 0;
};

TEST_F(LivePage, LeavesTheBitsOfTheRunAsTheyAre) {
  const std::string file = example("02_free_motion_lwr4/twin.ssd");
  ASSERT_EQ(cotwin({"run", file, "--stop", "1", "--quiet", "--out", "alone"}).code, 0);
  Process process = start({file, "--stop", "1", "--out", "viewed"});
  // A client that watches as a browser does, and one that never reads.
  RawClient watcher(port_), dead(port_, 4096);
  for (RawClient* client : {&watcher, &dead})
    client->send(testing::http_request("GET", "/run/stream?names=drive.q,drive.tau_J,motion.q_d&rate_hz=60"));
  EXPECT_TRUE(watcher.receive_until("event: sample")) << said();
  EXPECT_EQ(process.wait().code, 0) << said();
  EXPECT_TRUE(watcher.ended());
  EXPECT_THAT(watcher.received(), HasSubstr("\"phase\":\"ended\""));
  EXPECT_EQ(content(folder_ / "alone/signals.csv"), content(folder_ / "viewed/signals.csv"));
  const auto hash = [&](const char* run) { return json::parse(content(folder_ / run / "run.json"))["scenario"]["hash"]; };
  EXPECT_EQ(hash("alone"), hash("viewed"));
}

TEST_F(LivePage, CanBeInterruptedAndResumed) {
  const std::string file = example("02_free_motion_lwr4/twin.ssd");
  ASSERT_EQ(cotwin({"run", file, "--stop", "0.5", "--quiet", "--out", "alone"}).code, 0);
  Process process = start({file, "--stop", "0.5", "--out", "viewed"});
  ASSERT_EQ(call("POST", "/run/commands", R"({"command":"pause"})").status, 200);
  process.signal(SIGINT);
  EXPECT_EQ(process.wait().code, 128 + SIGINT) << said();
  const RunResult resumed = cotwin({"run", "--resume", "viewed", "--quiet"});
  EXPECT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_THAT(resumed.err, HasSubstr("live at http://localhost:"));  // as it began
  EXPECT_EQ(content(folder_ / "alone/signals.csv"), content(folder_ / "viewed/signals.csv"));
}

TEST_F(LivePage, TakesTheWallClockAndTellsWhatItShows) {
  Process process = start({example("01_joint_admittance/arm.ssd"), "--out", "viewed"});
  const json run = get("/run");
  EXPECT_EQ(run["clock"], "wall");
  EXPECT_EQ(run["commands"], true);
  const json page = get("/run/page");
  EXPECT_EQ(page["name"], run["scenario"]);
  ASSERT_EQ(page["figures"].size(), 1u);
  EXPECT_EQ(page["figures"][0]["tracks"][0]["signal"], "drive.q");
  EXPECT_EQ(page["figures"][0]["controller"]["signal"], "compliance.S_a");
  EXPECT_EQ(page["figures"][0]["controller"]["joints"], true);
  std::vector<std::string> tracks;
  for (const json& track : page["figures"][0]["tracks"]) tracks.push_back(track["signal"]);
  EXPECT_THAT(tracks, Not(::testing::Contains("compliance.q")));  // a copy of drive.q
  const json& robot = page["robots"][0];
  EXPECT_EQ(robot["inertias"].size(), robot["joints"].size());
  ASSERT_EQ(page["events"].size(), 10u);
  EXPECT_EQ(page["events"][0], json({{"time_s", 1.0}, {"name", "compliance.tau_e"}, {"values", {20.0, 9.0}}, {"ramp_s", 0.0}}));
  EXPECT_EQ(page["tables"], json::array());
  const std::string html = call("GET", "/").body;
  EXPECT_THAT(html, HasSubstr("connect-src 'self' data:"));
  EXPECT_THAT(html, HasSubstr("cotwin-live"));
  EXPECT_THAT(html, Not(HasSubstr("joint_admittance")));  // nothing of the run
  EXPECT_EQ(call("POST", "/run/commands", R"({"command":"stop"})").status, 200);
  EXPECT_EQ(process.wait().code, 0) << said();
}

TEST_F(LivePage, OfAGatewayInTheScenarioIsThereWithoutTheOption) {
  const fs::path scenario = fs::path(places::source()) / "tests/components/gateway/openapi.ssd";
  const std::string url_file = (folder_ / "url.txt").string();
  Process process = cotwin::testing::start_program(
      {"run", scenario.string(), "--quiet", "--set", "gateway.port=0", "--set", "gateway.url_file=" + url_file, "--out", "r"},
      {.folder = folder_.path()});
  std::string url;
  ASSERT_TRUE(within_patience([&] {
    url = fs::exists(url_file) ? content(url_file) : "";
    return url.ends_with('\n');
  }));
  port_ = static_cast<std::uint16_t>(std::stoi(url.substr(url.rfind(':') + 1)));
  HttpReply reply;
  EXPECT_TRUE(within_patience([&] { return (reply = call("GET", "/run/page")).status == 200; })) << reply.body;
  EXPECT_THAT(call("GET", "/").body, HasSubstr("cotwin-live"));
  EXPECT_EQ(json::parse(reply.body)["name"], "gateway_openapi");
  process.signal(SIGTERM);
  EXPECT_EQ(process.wait().code, 128 + SIGTERM);
}

TEST_F(LivePage, RefusesPortsThatAreNone) {
  const std::string file = example("01_joint_admittance/arm.ssd");
  for (const std::string port : {"x", "-1", "65536", "8081.5"}) {
    const RunResult run = cotwin({"run", file, "--view=" + port, "--stop", "0.1"});
    EXPECT_EQ(run.code, 2) << port;
    EXPECT_THAT(run.err, HasSubstr("--view: '" + port + "' is no port")) << port;
  }
  Process process = start({file, "--out", "first"});
  const RunResult taken = cotwin({"run", file, "--view=" + std::to_string(port_), "--stop", "0.1", "--out", "second"});
  EXPECT_EQ(taken.code, 2);
  EXPECT_THAT(taken.err, HasSubstr(std::to_string(port_)));
  EXPECT_FALSE(fs::exists(folder_ / "second"));
  const RunResult fmu = cotwin({"run", "--resume", "first", "--view"});
  EXPECT_EQ(fmu.code, 2);
  EXPECT_THAT(fmu.err, HasSubstr("--view"));
  process.signal(SIGTERM);
  (void)process.wait();
}

TEST_F(LivePage, ThatIsNotInTheBuildIsAnError) {
  // The program looks for the page beside itself.
  fs::create_directories(folder_ / "bin");
  fs::copy_file(places::program(), folder_ / "bin/cotwin");
  fs::create_directory_symlink(fs::path(places::source()) / "models", folder_ / "models");
  const RunResult run = cotwin::testing::run_command(
      {(folder_ / "bin/cotwin").string(), "run", example("01_joint_admittance/arm.ssd"), "--view=0", "--stop", "0.1"},
      {.folder = folder_.path()});
  EXPECT_EQ(run.code, 2);
  EXPECT_THAT(run.err, HasSubstr("nodejs and npm"));
}

#ifdef COTWIN_CHROMIUM
/// Four columns of four, as the page has its matrices.
Eigen::Matrix4d matrix_of(const json& list) {
  Eigen::Matrix4d matrix;
  for (int i = 0; i < 16; ++i) matrix(i % 4, i / 4) = list[static_cast<std::size_t>(i)].get<double>();
  return matrix;
}

TEST_F(LivePage, FindsARunAgain) {
  const fs::path script = fs::path(places::source()) / "master/view/page/test/check_again.mjs";
  const RunResult browser = cotwin::testing::run_command(
      {COTWIN_NODE, script, COTWIN_CHROMIUM, places::program(), example("01_joint_admittance/arm.ssd"), folder_.path()},
      {.merge = true, .limit = std::chrono::seconds(500)});
  EXPECT_EQ(browser.code, 0) << browser.out << browser.err;
}

TEST_F(LivePage, ShowsAndChangesTheRunInABrowser) {
  // A name that would be markup in a page that is not careful.
  const std::string name = "<img src=x onerror='window.hacked=1'><script>hacked=1</script>";
  const std::string escaped = "&lt;img src=x onerror=&apos;window.hacked=1&apos;>&lt;script>hacked=1&lt;/script>";
  const std::string text = content(example("01_joint_admittance/arm.ssd"));
  folder_.write("arm.ssd", std::regex_replace(text, std::regex(R"(name="joint_admittance")"), "name=\"" + escaped + "\""));
  Process process = start({"arm.ssd", "--stop", "1000", "--out", "viewed"});
  json plan = {{"title", name}, {"q", "drive.q"}, {"controller", "compliance.S_a"}, {"slider", "compliance.S_a"}};
  plan["bounded"] = "compliance.S_a";
  plan["pulse"] = "drive.tau_e";
  plan["event"] = {{"names", {"drive.tau_e", "compliance.tau_e"}}, {"values", {20.0, 9.0}}};
  plan["cues"] = {"ghosts", "trails", "mass", "manipulability", "stiffness", "tau_e"};
  plan["latency"] = std::getenv("COTWIN_LATENCY") != nullptr;
  plan["dark"] = std::getenv("COTWIN_DARK") != nullptr;
  const fs::path file = folder_.write("plan.json", plan.dump()), result = folder_ / "result.json";
  const fs::path script = fs::path(places::source()) / "master/view/page/test/check_live.mjs";
  std::vector<std::string> command = {COTWIN_NODE, script, COTWIN_CHROMIUM, url_, file, result};
  if (const char* shots = std::getenv("COTWIN_SCREENSHOTS")) command.emplace_back(shots);
  const RunResult browser = cotwin::testing::run_command(command, {.merge = true, .limit = std::chrono::seconds(500)});
  EXPECT_EQ(browser.code, 0) << browser.out << browser.err;
  if (std::getenv("COTWIN_LATENCY") != nullptr) std::cout << browser.out;
  ASSERT_EQ(process.wait().code, 0) << said();

  // What the page showed in the pause, against the calculations for recordings.
  const json shown = json::parse(content(result));
  const robot::RobotModel arm = robot::load_urdf(fs::path(places::source()) / "models/robots/planar2/robot.urdf");
  const std::vector<double> values = shown["q"];
  const Eigen::Map<const Eigen::VectorXd> q(values.data(), static_cast<Eigen::Index>(values.size()));
  const Eigen::VectorXd rest = Eigen::VectorXd::Zero(q.size());
  const auto near_pose = [&](const json& found, const robot::Frame& frame) {
    const robot::FrameMotion motion = robot::FrameKinematics(arm, frame).at(q, rest, rest);
    Eigen::Matrix4d wanted = Eigen::Matrix4d::Identity();
    wanted.topLeftCorner<3, 3>() = motion.Q.toRotationMatrix();
    wanted.topRightCorner<3, 1>() = motion.p;
    EXPECT_LT((matrix_of(found) - wanted).cwiseAbs().maxCoeff(), 2e-6);
  };
  near_pose(shown["poses"]["tip"], arm.end_effector());
  for (int body = 0; body < arm.body_count(); ++body)
    near_pose(shown["poses"]["bodies"][static_cast<std::size_t>(body)], {"", body, {}});
  Recorded recorded;
  recorded.time = {0};
  for (const double x : values) recorded.columns.push_back({x});
  recorded.signals = {{"q", "rad", 0, values.size()}};
  const std::vector<double> S = shown["S"];
  const TipMatrices wanted = tip_matrices(arm, recorded, recorded.signals[0], {0}, [&](std::size_t) {
    return Compliant{std::nullopt, false, S};
  });
  const auto near = [&](const char* what, const MatrixOverTime& matrix) {
    double size = 0;
    for (const std::vector<double>& element : matrix) size = std::max(size, std::abs(element[0]));
    ASSERT_EQ(shown["matrices"][what].size(), 6u) << what;
    for (std::size_t k = 0; k < 6; ++k)
      EXPECT_NEAR(shown["matrices"][what][k].get<double>(), matrix[k][0], 1e-5 * size) << what << ' ' << k;
  };
  ASSERT_TRUE(wanted.mobility && wanted.stiffness);
  near("mobility", *wanted.mobility);
  near("velocity", wanted.velocity);
  near("stiffness", *wanted.stiffness);
}

TEST_F(LivePage, OfAGatewayWithoutARunShowsRobotsServicesAndJobs) {
  fs::copy_file(fs::path(places::source()) / "tests/components/data/scara.urdf", folder_ / "scara.urdf");
  fs::create_directories(folder_ / "robots/scara");
  fs::rename(folder_ / "scara.urdf", folder_ / "robots/scara/robot.urdf");
  fs::copy(fs::path(places::source()) / "models/robots/lwr4", folder_ / "robots/lwr4", fs::copy_options::recursive);
  Process process = cotwin::testing::start_program({"serve", "--port", "0", "--out", "served", "--quiet", "--robots", "robots"},
                                                   {.folder = folder_.path(), .merge = true, .out = folder_ / "said"});
  ASSERT_TRUE(within_patience([&] {
    return fs::exists(folder_ / "served/url.txt") && !content(folder_ / "served/url.txt").empty();
  })) << said();
  std::string url = content(folder_ / "served/url.txt");
  url.erase(url.find('\n'));
  const fs::path script = fs::path(places::source()) / "master/view/page/test/check_gateway.mjs";
  const RunResult browser = cotwin::testing::run_command({COTWIN_NODE, script, COTWIN_CHROMIUM, url + "/"},
                                                         {.merge = true, .limit = std::chrono::seconds(500)});
  EXPECT_EQ(browser.code, 0) << browser.out << browser.err;
  process.signal(SIGINT);
  process.wait();
}
#endif

}  // namespace
}  // namespace cotwin::master::live_page_test
