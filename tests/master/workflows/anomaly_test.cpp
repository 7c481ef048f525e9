// cotwin anomaly over synthetic logs: both questions, exit codes, and logs that it cannot or must not judge.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "models/robot/changes/attachment.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"
#include "tests/support/synthetic_log.h"

namespace cotwin::anomaly_log_test {
namespace {

using namespace testing;
using nlohmann::json;
using ::testing::HasSubstr;

/// A tuned UR10e with its drive_train.ssv, and logs of it.
class AnomalyOfLogs : public ::testing::Test {
 protected:
  AnomalyOfLogs() {
    std::ofstream(folder / "robot.urdf") << robot::to_urdf(robot);
    std::ofstream ssv(folder / "drive_train.ssv");
    ssv << "<?xml version=\"1.0\"?><ssv:ParameterSet xmlns:ssv=\"http://ssp-standard.org/SSP1/SystemStructureParameterValues\" "
           "version=\"1.0\" "
           "name=\"d\"><ssv:Parameters>";
    const std::pair<const char*, double> values[] = {
        {"tau_C", log.tau_C}, {"sigma2", log.sigma2}, {"tau_0", log.tau_0}, {"B", log.B}, {"v_R", log.v_R}};
    for (const auto& [name, value] : values)
      ssv << "<ssv:Parameter name=\"" << name << "\"><ssv:Real value=\"" << value << "\"/></ssv:Parameter>";
    ssv << "</ssv:Parameters></ssv:ParameterSet>";
  }
  /// Writes a log; `spoil` as in SyntheticLog::write, with noise that is correlated and drifts between days.
  std::string write(const std::string& name, unsigned day, const SyntheticLog& how, const robot::RobotModel& real,
                    const std::function<void(std::size_t row, std::vector<double>& cells)>& spoil = {}) {
    SyntheticLog one = how;
    one.seed = day;
    std::vector<double> state(6);
    std::mt19937 random(day);
    std::normal_distribution<double> normal(0, 1);
    one.write(folder / name, real, [&](std::size_t row, std::vector<double>& cells) {
      const double keep = std::exp(-1 / (0.2 * one.rate));
      for (std::size_t j = 0; j < 6; ++j) {
        state[j] = keep * state[j] +
                   std::sqrt(1 - keep * keep) * 0.004 * robot.joints[j].tau_max * (1 + 0.1 * (day % 3)) * normal(random);
        cells[7 + j] += state[j];
      }
      if (spoil) spoil(row, cells);
    });
    return (folder / name).string();
  }
  std::string write(const std::string& name, unsigned day) { return write(name, day, log, robot); }
  RunResult judge(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), "anomaly");
    arguments.insert(arguments.end(), {"--robot", (folder / "robot.urdf").string()});
    return run_program(arguments);
  }
  json figures(std::vector<std::string> arguments, int code) const {
    arguments.insert(arguments.end(), {"--json", "-"});
    const RunResult run = judge(arguments);
    EXPECT_EQ(run.code, code) << run.err;
    return json::parse(run.out);
  }

  TemporaryFolder folder{"anomaly"};
  robot::RobotModel robot = robot::load_urdf(places::source() + "/models/robots/ur10e/robot.urdf");
  SyntheticLog log{.rate = 100,
                   .duration = 70,
                   .amplitude = 0.6,
                   .noise = 0.2,
                   .tau_C = 8,
                   .v_R = 0.02,
                   .sigma2 = 8,
                   .tau_0 = 0.2,
                   .B = 0.4};
};

TEST_F(AnomalyOfLogs, FindsNothingInAHealthyLog) {
  const RunResult run = judge({write("log.csv", 1)});
  EXPECT_EQ(run.code, 0) << run.out << run.err;
  EXPECT_THAT(run.out,
              HasSubstr("Did it change within the session? Nothing found. A change from the beginning on is in the baseline"));
  EXPECT_THAT(run.out, HasSubstr("Is it another robot than the tuned one? Not known."));
  EXPECT_THAT(run.out, HasSubstr("the variation between days is not known: 0 healthy logs, expected at least 3 (--healthy)"));
  EXPECT_THAT(run.out, HasSubstr("friction and motors of"));
  EXPECT_EQ(judge({(folder / "log.csv").string(), "--quiet"}).out, "");
}

TEST_F(AnomalyOfLogs, DatesAndNamesAChangeInTheTimeOfTheFile) {
  robot::RobotModel loaded = robot;
  robot::Attachment load;
  load.name = "load";
  load.parent = robot.end_effector().name;
  load.inertia.mass = 1;
  robot::attach(loaded, load);
  const std::string heavier = write("heavier.csv", 1, log, loaded);
  std::vector<std::vector<double>> rows;
  write("heavier.csv", 1, log, loaded, [&](std::size_t, std::vector<double>& cells) { rows.push_back(cells); });
  const std::string file = write("log.csv", 1, log, robot, [&](std::size_t row, std::vector<double>& cells) {
    if (cells[0] >= 40) cells = rows[row];
    cells[0] += 1000;
  });
  const json found = figures({file}, 1);
  ASSERT_EQ(found["count"], 1);
  const json& event = found["events"][0];
  EXPECT_EQ(event["hint"], "load");
  EXPECT_NEAR(event["size"], 1, 0.15);
  EXPECT_NEAR(event["since_s"], 1040, 1.5);
  EXPECT_LE(event["found_s"], 1045);
  EXPECT_EQ(found["joints"][1]["verdict"].get<std::string>().substr(0, 14), "load since 104");
  EXPECT_EQ(found["joints"][5]["verdict"], "nothing");
  // The same change against the healthy log as reference.
  const json against = figures({heavier, "--reference", write("healthy.csv", 2)}, 1);
  EXPECT_EQ(against["events"][0]["hint"], "load");
  EXPECT_LE(against["events"][0]["found_s"], 10);
  EXPECT_NEAR(against["duration_s"], 70, 0.1);
}

TEST_F(AnomalyOfLogs, AsksHealthyLogsWhetherItIsAnotherRobot) {
  std::vector<std::string> healthy = {"--healthy"};
  for (const unsigned day : {2, 3, 4, 5}) healthy.push_back(write("day" + std::to_string(day) + ".csv", day));
  const auto with_healthy = [&](const std::string& file, std::size_t logs = 4) {
    std::vector<std::string> arguments = {file};
    arguments.insert(arguments.end(), healthy.begin(), healthy.begin() + static_cast<std::ptrdiff_t>(1 + logs));
    return arguments;
  };
  const std::string good = write("good.csv", 6);
  const json nothing = figures(with_healthy(good), 0);
  EXPECT_GT(nothing["joints"][0]["healthy_rms"], nothing["joints"][0]["moving_rms"]);
  // A fault that is there from the beginning: only this question sees it.
  SyntheticLog worn = log;
  worn.tau_C *= 1.2;
  const std::string bad = write("bad.csv", 6, worn, robot);
  const json other = figures(with_healthy(bad), 1);
  EXPECT_EQ(other["count"], 0);
  EXPECT_EQ(other["joints"][3]["other_robot"], true);
  EXPECT_EQ(figures(with_healthy(bad, 2), 0)["joints"][3]["healthy_rms"], nullptr)
      << "two logs do not tell the variation between days";
}

TEST_F(AnomalyOfLogs, SaysWhatItCannotJudge) {
  SyntheticLog brief = log;
  brief.duration = 8;
  const RunResult run = judge({write("brief.csv", 1, brief, robot)});
  EXPECT_EQ(run.code, 2);
  EXPECT_THAT(run.err, HasSubstr("and no baseline: expected at least 11 s in which joints move, or healthy logs (--healthy)"));

  SyntheticLog partly = log;
  partly.moving = 3;
  const json found = figures({write("partly.csv", 1, partly, robot)}, 0);
  EXPECT_EQ(found["joints"][4]["verdict"], "not judged");
  EXPECT_EQ(found["joints"][4]["compared_s"], 0);
  EXPECT_EQ(found["joints"][0]["verdict"], "nothing");

  robot::RobotModel without = robot;
  for (robot::Joint& joint : without.joints) joint.tau_max = std::numeric_limits<double>::infinity();
  std::ofstream(folder / "robot.urdf") << robot::to_urdf(without);
  const RunResult unknown = judge({write("log.csv", 1)});
  EXPECT_EQ(unknown.code, 0) << unknown.err;
  EXPECT_THAT(unknown.out, HasSubstr("unknown"));
}

TEST_F(AnomalyOfLogs, JudgesLogsWithGapsRowsThatAreNoNumbersAndFrozenTorques) {
  const std::string holes = write("holes.csv", 1, log, robot, [](std::size_t row, std::vector<double>& cells) {
    if (row % 211 == 7) cells[9] = std::numeric_limits<double>::quiet_NaN();
    if (cells[0] > 30) cells[0] += 3;
  });
  EXPECT_EQ(figures({holes}, 0)["count"], 0);
  double last = 0;
  const std::string frozen = write("frozen.csv", 1, log, robot, [&](std::size_t, std::vector<double>& cells) {
    if (cells[0] < 45) last = cells[9];
    cells[9] = last;
  });
  const json found = figures({frozen}, 1);
  EXPECT_NEAR(found["events"][0]["since_s"], 45, 2);
  EXPECT_EQ(found["events"][0]["joint"], 3);
}

TEST_F(AnomalyOfLogs, TellsALogOfAnotherRobotAtOnce) {
  const std::string file = write("log.csv", 1, log, robot, [](std::size_t, std::vector<double>& cells) {
    for (std::size_t j = 0; j < 6; ++j) cells[7 + j] *= -1;
  });
  const RunResult refused = judge({file});
  EXPECT_EQ(refused.code, 2);
  const json found = figures({file, "--accept-data"}, 1);
  EXPECT_EQ(found["joints"][1]["other_robot"], true);
  // Seven joints in place of six.
  std::ofstream(folder / "seven.csv")
      << "t,q1,q2,q3,q4,q5,q6,q7,tau1,tau2,tau3,tau4,tau5,tau6,tau7\n0,0,0,0,0,0,0,0,0,0,0,0,0,0,0\n";
  const RunResult seven = judge({(folder / "seven.csv").string()});
  EXPECT_EQ(seven.code, 2);
  EXPECT_NE(seven.err, "");
}

TEST_F(AnomalyOfLogs, RefusesWhatItIsNotGiven) {
  EXPECT_EQ(judge({"nowhere.csv"}).code, 2);
  EXPECT_EQ(run_program({"anomaly", "log.csv"}).code, 2);
  const std::string file = write("log.csv", 1);
  for (const char* baseline : {"nan", "1", "-5", "1e9"}) EXPECT_EQ(judge({file, "--baseline", baseline}).code, 2) << baseline;
  const RunResult same = judge({file, "--reference", file});
  EXPECT_EQ(same.code, 2) << "a log compared with itself says nothing";
  EXPECT_THAT(same.err, HasSubstr("--reference: "));
  EXPECT_EQ(judge({file, "--healthy", write("a.csv", 2), file, write("b.csv", 3)}).code, 2);
  const RunResult full =
      run_program({"anomaly", file, "--robot", (folder / "robot.urdf").string(), "--json", "/nowhere/x.json"});
  EXPECT_EQ(full.code, 2);
}

}  // namespace
}  // namespace cotwin::anomaly_log_test
