// cotwin ask: requests from lines of a queue, from options and from files.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "components/services/json/control/tasks.h"
#include "components/services/json/json.h"
#include "components/unit/unit_table.h"
#include "master/services/motion_file.h"
#include "master/services/verify.h"
#include "master/services/worker.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace ask_test {
namespace {

namespace fs = std::filesystem;
using cotwin::services::Robots;
using cotwin::testing::run_program;
using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;

fs::path robots_folder() { return fs::path(cotwin::places::source()) / "models/robots"; }

/// The lines that a worker writes for these lines.
std::vector<json> work(const std::string& lines, Robots&& robots = Robots({robots_folder()})) {
  std::istringstream in(lines);
  std::ostringstream out;
  EXPECT_TRUE(cotwin::master::run_worker(in, out, robots, {}));
  std::vector<json> all;
  std::istringstream written(out.str());
  for (std::string line; std::getline(written, line);) all.push_back(json::parse(line));
  return all;
}

const std::string kEnds = R"("from_q_rad":[0,0.5,0,-1,0,0.6,0],"to_q_rad":[1,0,0.4,0.7,-0.5,-0.3,0.8])";

TEST(Worker, AnswersEachLineWithItsIdentity) {
  const auto lines = work(R"({"id":"a","request":{"service":"feasibility","robot":"lwr4","T_s":3,)" + kEnds + "}}\n\n" +
                          R"({"id":7,"request":{"service":"feasibility","robot":"lwr4","T_s":0.1,)" + kEnds + "}}");
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_EQ(lines[0]["id"], "a");
  EXPECT_EQ(lines[0]["reply"]["feasible"], true);
  EXPECT_EQ(lines[1]["id"], 7);
  EXPECT_EQ(lines[1]["reply"]["feasible"], false);
}

TEST(Worker, TellsTheProgressOfAnOptimisation) {
  const auto lines = work(
      R"({"id":"o","request":{"service":"optimise","robot":"lwr4","T_min_s":2,"particles":16,"rounds":20,)" + kEnds + "}}\n");
  ASSERT_GE(lines.size(), 3U);
  double last = 0;
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
    EXPECT_EQ(lines[i]["id"], "o");
    EXPECT_GT(lines[i]["progress"].get<double>(), last);
    last = lines[i]["progress"];
  }
  EXPECT_LE(last, 1);
  EXPECT_EQ(lines.back()["reply"]["status"], "feasible");
}

TEST(Worker, SurvivesLinesThatAreNoRequests) {
  const std::string huge(cotwin::master::kLongestLine + 10, 'x');
  const std::string deep(100000, '[');
  const std::string lines =
      "{\n[1]\n\x80\xff\n" + huge + "\n" + deep + "\n" +
      R"({"request":{}})"
      "\n"
      R"({"id":"1"})"
      "\n"
      R"({"id":"2","request":3})"
      "\n"
      R"({"id":"3","id":"4","request":{}})"
      "\n"
      R"({"id":"5","request":{"service":"dance","robot":"lwr4"}})"
      "\n"
      R"({"id":"6","request":{"service":"feasibility","robot":"../robots/lwr4"}})"
      "\n"
      R"({"id":"7","request":{"service":"feasibility","robot":"lwr5"}})"
      "\n"
      R"({"id":"8","request":{"service":"feasibility","robot":"lwr4","from_q_rad":[NaN]}})"
      "\n"
      R"({"id":"9","request":{"service":"feasibility","robot":"lwr4","from_q_rad":[0,"a"],"to_q_rad":[]}})"
      "\n"
      R"({"id":"10","request":{"service":"feasibility","robot":"lwr4",)" +
      kEnds +
      R"(,"T_s":1e999}})"
      "\n"
      R"({"id":"11","request":{"service":"feasibility","robot":"lwr4",)" +
      kEnds + "}}";
  const auto replies = work(lines);
  ASSERT_EQ(replies.size(), 16U);
  for (std::size_t i = 0; i + 1 < replies.size(); ++i) {
    ASSERT_TRUE(replies[i].contains("problem")) << replies[i];
    EXPECT_FALSE(replies[i]["problem"]["detail"].get<std::string>().empty());
  }
  EXPECT_TRUE(replies[3]["id"].is_null());
  EXPECT_THAT(replies[3]["problem"]["detail"].get<std::string>(), HasSubstr("4194304"));
  EXPECT_EQ(replies[9]["problem"]["pointer"], "/service");
  EXPECT_EQ(replies[10]["problem"]["pointer"], "/robot");
  EXPECT_THAT(replies[11]["problem"]["detail"].get<std::string>(), HasSubstr("lwr4"));
  EXPECT_EQ(replies[13]["problem"]["pointer"], "/from_q_rad/1");
  EXPECT_EQ(replies.back()["reply"]["feasible"], true);
}

TEST(Worker, ReadsARobotAgainWhenItsFileHasChanged) {
  const cotwin::testing::TemporaryFolder folder("robots");
  fs::create_directory(folder.path() / "arm");
  fs::copy_file(robots_folder() / "planar2/robot.urdf", folder.path() / "arm/robot.urdf");
  Robots robots({folder.path()});
  const auto first = robots.find("arm");
  EXPECT_EQ(robots.find("arm"), first);
  EXPECT_EQ(first->model.joints.size(), 2U);
  EXPECT_EQ(robots.names(), std::vector<std::string>{"arm"});
  fs::copy_file(robots_folder() / "lwr4/robot.urdf", folder.path() / "arm/robot.urdf", fs::copy_options::overwrite_existing);
  fs::last_write_time(folder.path() / "arm/robot.urdf", fs::file_time_type::clock::now() + std::chrono::hours(1));
  EXPECT_EQ(robots.find("arm")->model.joints.size(), 7U);
}

const char* kLibrary = R"({"robots": ["lwr4", {"name": "elbow held", "robot": "lwr4", "locked_q": {"joint_4": -1}}],
  "defaults": {"service": "cycle_time"},
  "tasks": [
    {"name": "turn", "from_q_deg": [0,0,0,0,0,0,0], "to_q_deg": [57.29577951308232,0,0,0,0,0,0], "robots": ["lwr4"]},
    {"name": "cost", "service": "energy", "T_s": 2, "from_q_rad": [0,0,0,0,0,0], "to_q_rad": [1,0,0,0,0,0]},
    {"name": "odd, \"one\"", "from_q_rad": [0], "to_q_rad": [1], "robot": "planar2"},
    7]})";

TEST(Ask, NoticesPosturesInDegrees) {
  const std::vector<std::string> ask = {"ask",    "feasibility",       "--robot", "lwr4",
                                        "--from", "0,30,0,-60,0,40,0", "--to",    "57,0,20,40,-30,-20,45"};
  const auto refused = run_program(ask);
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err,
              HasSubstr("/from_q_rad/1: is 30 rad, expected -2.094 to 2.094 rad for joint joint_2; are these degrees? Then "
                        "from_q_deg (cotwin ask: --angle-unit deg)"));
  std::vector<std::string> degrees = ask;
  degrees.insert(degrees.end(), {"--angle-unit", "deg"});
  const auto answered = run_program(degrees);
  EXPECT_EQ(answered.code, 0) << answered.err;
  EXPECT_TRUE(json::parse(answered.out)["feasible"]);
  // A posture that is a little beyond a limit, or outside in degrees too, gets its answer; so does one with limits of its own.
  for (const char* q : {"0,2.2,0,0,0,0,0", "0,200,0,0,0,0,0"}) {
    const auto beyond = run_program({"ask", "feasibility", "--robot", "lwr4", "--from", "0,0,0,0,0,0,0", "--to", q});
    EXPECT_EQ(beyond.code, 0) << beyond.err;
    EXPECT_FALSE(json::parse(beyond.out)["feasible"]);
  }
}

TEST(AskCommand, TakesARecordingInPlaceOfAMove) {
  const cotwin::testing::TemporaryFolder folder("series");
  const std::string file = folder.write("log.csv",
                                        "t,arm.q[1],arm.q[2],arm.q[3],arm.q[4],arm.q[5],arm.q[6],arm.q[7]\n"
                                        "0,0,30,0,-60,0,60,0\n1,10,30,0,-60,0,60,0\n2,20,30,0,-60,0,60,0\n");
  const std::vector<std::string> ask = {"ask", "reaction",    "--robot",   "lwr4",         "--series",
                                        file,  "--q-columns", "arm.q[{}]", "--angle-unit", "deg"};
  const auto answered = run_program(ask);
  ASSERT_EQ(answered.code, 0) << answered.err;
  const json reply = json::parse(answered.out);
  EXPECT_EQ(reply["T_s"], 2);
  EXPECT_GT(reply["end"]["turn_rad"].get<double>(), 0.05);
  const auto refusal = [&](const std::vector<std::string>& more) {
    std::vector<std::string> all = ask;
    all.insert(all.end(), more.begin(), more.end());
    const auto refused = run_program(all);
    EXPECT_EQ(refused.code, 2);
    return refused.err;
  };
  EXPECT_THAT(refusal({"--from", "0,0,0,0,0,0,0"}), HasSubstr("--from: is given beside a series or waypoints"));
  EXPECT_THAT(refusal({"--duration", "3"}), HasSubstr("--duration: is given beside a series or waypoints"));
  EXPECT_THAT(refusal({"--with", "{\"series\": {}}"}), HasSubstr("--series: is given beside the member series of --with"));
  EXPECT_THAT(run_program({"ask", "throughput", "--series", file}).err,
              HasSubstr("--series: is given for the service throughput"));
  // What the robot did, and what it cost; nothing that unit:motion would run in another way.
  std::vector<std::string> cost = ask;
  cost[1] = "energy";
  const auto spent = run_program(cost);
  EXPECT_EQ(json::parse(spent.out)["T_s"], 2) << spent.err;
  cost[1] = "feasibility";
  cost.insert(cost.end(), {"--motion", folder / "motion.ssv"});
  EXPECT_THAT(run_program(cost).err, HasSubstr("--motion: is given beside a series or waypoints"));
  EXPECT_EQ(
      run_program({"ask", "reach", "--with", R"({"poses": [{"p_m": [0.4, 0, 0.5], "quaternion_wxyz": [0, 1, 0, 0]}]})"}).code,
      0);
  EXPECT_THAT(run_program({"ask", "reach", "--to", "0,0,0,0,0,0,0"}).err, HasSubstr("--to: is given for the service reach"));
  EXPECT_EQ(run_program({"ask", "torques", "--with",
                         R"({"waypoints": {"t_s": [0, 1], "q_rad": [[0,0,0,0,0,0,0], [0.1,0,0,0,0,0,0]]}})"})
                .code,
            0);
  EXPECT_THAT(run_program({"ask", "reaction", "--q-columns", "x"}).err, HasSubstr("--q-columns: is given without --series"));
}

TEST(Tasks, AreCrossedWithRobotsAndDoNotLoseOneAnother) {
  Robots robots({robots_folder()});
  const auto tasks = cotwin::services::read_tasks(kLibrary, "library", {"lwr4", "verdict", {}});
  ASSERT_EQ(tasks.size(), 5U);
  EXPECT_EQ(tasks[2].robot, "elbow held");
  const auto rows = cotwin::services::ask_all(robots, tasks);
  const json all = json::parse(cotwin::services::to_json(rows));
  EXPECT_NEAR(all[0]["reply"]["T_s"].get<double>(), 1.875 / robots.find("lwr4")->model.joints[0].dq_max, 1e-6);
  EXPECT_EQ(all[1]["problem"]["pointer"], "/from_q_rad");  // 6 values for 7 joints
  EXPECT_GT(all[2]["reply"]["energy_J"].get<double>(), 0);
  EXPECT_TRUE(all[3].contains("problem"));
  EXPECT_TRUE(all[4].contains("problem"));
  const std::string csv = cotwin::services::to_csv(rows);
  EXPECT_THAT(csv, HasSubstr("task,robot,service,feasible,reason,verdict.light,T_s"));
  EXPECT_THAT(csv, HasSubstr("\n\"odd, \"\"one\"\"\",planar2,cycle_time,"));
  const std::string text = cotwin::services::to_text_table(rows);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 6);
  EXPECT_THAT(text, HasSubstr("elbow held"));
  for (const char* bad :
       {"", "3", "[]", "{\"tasks\": 3}", "{\"tasks\": [], \"robot\": 1}", "{\"tasks\": [{}], \"robots\": [1]}"})
    EXPECT_THROW(cotwin::services::read_tasks(bad, "bad", {"lwr4", "", {}}), cotwin::Error) << bad;
}

// Requests without a service and chains, alone, in lists and in libraries; robots beside the file.
TEST(Tasks, MayLeaveTheServiceOutAndHaveSteps) {
  const cotwin::testing::TemporaryFolder folder("orders");
  fs::copy_file(robots_folder() / "planar2/robot.urdf", folder / "own.urdf");
  const auto ask = [&](const std::string& order, const std::vector<std::string>& options = {}) {
    std::ofstream(folder / "order.json") << order;
    std::vector<std::string> command = {"ask", "--file", folder / "order.json"};
    command.insert(command.end(), options.begin(), options.end());
    return run_program(command);
  };
  const std::string move = R"("from_q_rad": [0, 0], "to_q_rad": [0.5, 1])";
  const auto brief =
      ask(R"({"goal": "fastest", "robot": "own.urdf", "audience": "operator", )" + move + "}", {"--table", "csv"});
  EXPECT_EQ(brief.code, 0) << brief.err;
  EXPECT_THAT(brief.out, HasSubstr("own.urdf,cycle_time,"));
  EXPECT_THAT(brief.out, HasSubstr("The move takes "));
  const std::string steps = R"("steps": [{"name": "a", "goal": "fastest"}, {"service": "torques", "T_s": "$a/T_s"}])";
  const auto chain = ask(R"({"defaults": {"robot": "own.urdf", )" + move + "}, " + steps + "}");
  EXPECT_EQ(chain.code, 0) << chain.err;
  const json reply = json::parse(chain.out)[0];
  EXPECT_EQ(reply["service"], "chain");
  EXPECT_EQ(reply["robot"], "own.urdf");
  EXPECT_EQ(reply["reply"]["steps"][1]["reply"]["T_s"], reply["reply"]["steps"][0]["reply"]["T_s"]);
  const auto cross = ask(R"({"robots": ["planar2", "own.urdf"], "defaults": {)" + move + R"(}, "tasks": [{"name": "both", )" +
                         steps + R"(}, {"goal": "fastest"}, {"goal": "gentle"}, {"steps": [{"goal": "fastest", "T_s": 1}]}]})");
  EXPECT_EQ(cross.code, 1);
  const json rows = json::parse(cross.out);
  ASSERT_EQ(rows.size(), 8U);
  EXPECT_EQ(rows[1]["task"], "both");
  EXPECT_EQ(rows[1]["reply"]["steps"][0]["reply"]["T_s"], rows[0]["reply"]["steps"][0]["reply"]["T_s"]);
  EXPECT_EQ(rows[2]["service"], "cycle_time");
  for (const std::size_t k : {4U, 5U, 6U, 7U}) EXPECT_TRUE(rows[k].contains("problem")) << k;
  EXPECT_EQ(rows[7]["problem"]["pointer"], "/steps/0");
}

TEST(Tasks, FromFilesGiveATableAndAnExitCode) {
  const cotwin::testing::TemporaryFolder folder("tasks");
  std::ofstream(folder / "tasks.json") << kLibrary;
  const auto table = run_program({"ask", "--file", folder / "tasks.json", "--table", "csv"});
  EXPECT_EQ(table.code, 1);
  EXPECT_THAT(table.err, HasSubstr("3 of 5 tasks"));
  EXPECT_EQ(std::count(table.out.begin(), table.out.end(), '\n'), 6);
  std::ofstream(folder / "one.json") << R"({"service":"jerk","T_s":1,"from_q_deg":[0,0],"to_q_deg":[30,60],"robot":"planar2"})";
  const auto one = run_program({"ask", "--file", folder / "one.json"});
  EXPECT_EQ(one.code, 0) << one.err;
  EXPECT_EQ(json::parse(one.out)[0]["reply"]["share_of_quintic"], 1);
  EXPECT_EQ(run_program({"ask", "--file", folder / "none.json"}).code, 2);
  const auto request =
      run_program({"ask", "cycle_time", "--robot", "planar2", "--from", "0,0", "--to", "1,1", "--detail", "verdict"});
  EXPECT_EQ(request.code, 0) << request.err;
  EXPECT_EQ(run_program({"ask", "dance"}).code, 2);
  // A light that is worse than required; tasks that say another one keep it.
  std::ofstream(folder / "two.json")
      << R"({"defaults":{"service":"cycle_time","from_q_rad":[0,0],"to_q_rad":[1,1]},"robots":["planar2"],
      "tasks":[{"name":"a"},{"name":"b","require":"amber"}]})";
  const auto required = run_program({"ask", "--file", folder / "two.json", "--require", "green"});
  EXPECT_EQ(required.code, 1);
  EXPECT_THAT(required.err,
              AllOf(HasSubstr("task a has not the light that is required: The move takes"), HasSubstr("task b has not")));
  EXPECT_NE(run_program({"ask", "--file", folder / "two.json", "--require", ""}).code, 0);
  EXPECT_EQ(run_program({"ask", "--file", folder / "two.json", "--require", "amber"}).code, 0);
  EXPECT_EQ(run_program({"ask", "--file", folder / "two.json"}).code, 0);
}

TEST(MotionFile, IsNotWrittenForAMotionThatIsNotFeasible) {
  const cotwin::testing::TemporaryFolder folder("infeasible");
  const std::vector<std::string> move{"--robot", "planar2",  "--from",         "0,0",   "--to",
                                      "1,1",     "--motion", folder / "m.ssv", "--with"};
  const auto refused = [&](std::vector<std::string> words, const std::string& more) {
    words.insert(words.begin(), "ask");
    words.insert(words.end(), move.begin(), move.end());
    words.push_back(more);
    const auto run = run_program(words);
    EXPECT_EQ(run.code, 1) << run.out;
    EXPECT_THAT(run.err, HasSubstr("not written"));
    EXPECT_FALSE(fs::exists(folder.path() / "m.ssv"));
  };
  refused({"cycle_time"}, R"({"q_max_rad":[0.1,0.1]})");
  refused({"feasibility", "--duration", "0.001"}, R"({"tau_max_Nm":[0.001,0.001]})");
  refused({"optimise", "--duration", "0.001"}, R"({"tau_max_Nm":[0.001,0.001],"particles":8,"rounds":2})");
  // Nor for one that the twin does not make, that is not safe, or that has not the light that is required.
  refused({"optimise", "--duration", "2"}, R"({"particles":8,"rounds":2,"verify":true,"tracking_max_rad":1e-9})");
  refused({"optimise", "--duration", "2"},
          R"({"particles":8,"rounds":2,"cost":"safety","parts":"chest","contact":"quasi_static"})");
  refused({"feasibility", "--duration", "2", "--require", "green"}, "{}");
}

TEST(MotionFile, IsWrittenWhateverTheReplyTells) {
  const cotwin::testing::TemporaryFolder folder("detail");
  std::string whole;
  for (const char* detail : {"all", "verdict", "series"}) {
    const std::string file = folder / (std::string(detail) + ".ssv");
    const auto run = run_program({"ask", "feasibility", "--robot", "planar2", "--from", "0,0", "--to", "1,1", "--duration", "2",
                                  "--motion", file, "--detail", detail});
    ASSERT_EQ(run.code, 0) << run.err;
    EXPECT_EQ(json::parse(run.out).contains("motion"), detail == std::string("all"));
    if (whole.empty()) whole = cotwin::testing::content(file);
    EXPECT_THAT(whole, HasSubstr("q_end"));
    EXPECT_EQ(cotwin::testing::content(file), whole);
  }
  const auto none =
      run_program({"ask", "jerk", "--robot", "planar2", "--from", "0,0", "--to", "1,1", "--motion", folder / "m.ssv"});
  EXPECT_EQ(none.code, 2);
  EXPECT_THAT(none.err, HasSubstr("the service jerk replies with no motion"));
}

TEST(Tasks, WithoutARobotAreRefusedAndNotLost) {
  Robots robots({robots_folder()});
  const auto rows = cotwin::services::ask_all(
      robots, cotwin::services::read_tasks(
                  R"({"tasks": [{"name": "one\ntwo", "robots": []}, {"service": "jerk", "robot": "planar2", "T_s": 1,
                      "from_q_rad": [0, 0], "to_q_rad": [1, 1]}]})",
                  "library", {"lwr4", "verdict", {}}));
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_EQ(json::parse(rows[0].problem)["pointer"], "/robots");
  EXPECT_EQ(rows[1].problem, "");
  const std::string table = cotwin::services::to_text_table(rows);
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 3) << table;
}

TEST(Tasks, WithDoubledMembersOrDeepNestingAreRefused) {
  const auto refusal = [](const std::string& text) -> std::string {
    try {
      cotwin::services::read_tasks(text, "file", {"lwr4", "", {}});
    } catch (const cotwin::Error& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(refusal(R"({"service":"jerk","service":"energy"})"), HasSubstr("file: has the member 'service' twice"));
  EXPECT_THAT(refusal(R"([{"tasks":[],"a":{"b":1,"b":2}}])"), HasSubstr("'b' twice"));
  EXPECT_THAT(refusal(std::string(1000, '[')), HasSubstr("deeper than 32"));
  EXPECT_THAT(refusal(R"({"robots":["lwr4"],"task":[]})"),
              HasSubstr("file: /task: is an unknown member, expected robots, tasks or defaults"));
  EXPECT_THAT(refusal(R"({"defaults":{}})"), HasSubstr("file: /tasks: is missing"));
}

TEST(AskCommand, RefusesOptionsThatWouldHaveNoEffect) {
  const cotwin::testing::TemporaryFolder folder("options");
  const std::string file = folder / "one.json";
  std::ofstream(file) << R"({"service":"jerk","T_s":1,"from_q_deg":[0,0],"to_q_deg":[30,60],"robot":"planar2"})";
  const auto expect = [](std::vector<std::string> options, const std::string& part) {
    options.insert(options.begin(), "ask");
    const auto run = run_program(options);
    EXPECT_NE(run.code, 0) << ::testing::PrintToString(options);
    EXPECT_THAT(run.err, HasSubstr(part));
    EXPECT_EQ(run.out, "");
  };
  expect({"--file", file, "--from", "0,0"}, "--from");
  expect({"--file", file, "--to", "0,0"}, "--to");
  expect({"--file", file, "--duration", "2"}, "--duration");
  expect({"--file", file, "--with", "{}"}, "--with");
  expect({"--file", file, "--motion", folder / "m.ssv"}, "--motion");
  expect({"jerk", "--file", file}, "jerk");
  expect({"jerk", "--robot", "planar2", "--from", "0,0", "--to", "1,1", "--table", "csv"}, "--table");
  expect({"--worker", "--from", "0,0"}, "--from");
  expect({"--schema", "energy", "--worker"}, "--worker");
  expect({"--list-robots", "--worker"}, "--worker");
  expect({"--schema", "frog"}, "expected one of feasibility");
  expect({"--file", folder.path()}, "is a folder");
  expect({"cycle_time", "--robot", "planar2", "--from", "0,0", "--to", "1,1", "--duration", "2"}, "--duration");
  expect({"jerk", "--robot", "planar2", "--from", "0,0", "--to", "1,1", "--with", R"({"T_s":2,"T_s":3})"}, "'T_s' twice");
  expect({"jerk", "--robot", "planar2", "--from", "0,0", "--to", "1,1", "--particles", folder / "p.csv"}, "--particles");
  EXPECT_FALSE(fs::exists(folder / "m.ssv"));
  EXPECT_EQ(run_program({"ask", "--file", file}).code, 0);
}

// A motion that is not possible is not written, whoever asks.
TEST(AskCommand, WritesNoMotionFromABriefAnswer) {
  const cotwin::testing::TemporaryFolder folder("brief");
  std::vector<std::string> command = {"ask",        "feasibility", "--from",   "0,0,0,0,0,0,0",       "--to",  "1,0,0,0,0,0,0",
                                      "--duration", "0.1",         "--motion", folder / "motion.ssv", "--with"};
  const auto with = [&](const std::string& members) {
    std::vector<std::string> all = command;
    all.push_back(members);
    return run_program(all);
  };
  EXPECT_THAT(
      with(R"({"audience": "operator"})").err,
      HasSubstr("--motion: is given for the audience \"operator\", whose reply has no motions, expected a detail beside it"));
  for (const char* members : {R"({"audience": "operator", "detail": "verdict"})", R"({"audience": "engineer"})"})
    EXPECT_THAT(with(members).err, HasSubstr("not written, the move is not feasible")) << members;
  EXPECT_FALSE(fs::exists(folder / "motion.ssv"));
  command[7] = "3";
  EXPECT_EQ(with(R"({"audience": "planner", "detail": "margins"})").code, 0);
  EXPECT_TRUE(fs::exists(folder / "motion.ssv"));
}

TEST(AskCommand, ListsTheRobotsAndTheirData) {
  const auto run = run_program({"ask", "--list-robots"});
  ASSERT_EQ(run.code, 0) << run.err;
  EXPECT_THAT(run.out, HasSubstr("robot               joints  drive_train.ssv  compliance.ssv  energy.ssv"));
  EXPECT_THAT(run.out, HasSubstr("\niiwa14              7       partly assumed   given           assumed"));
  EXPECT_THAT(run.out, HasSubstr("\nur10e               6       missing          missing         missing"));
  const cotwin::testing::TemporaryFolder folder("list");
  std::ofstream(folder / "none.urdf") << "<robot";
  const auto broken = run_program({"ask", "--list-robots", "--robots", folder.path()});
  EXPECT_EQ(broken.code, 0);
  EXPECT_THAT(broken.out, HasSubstr("none.urdf:1"));
}

TEST(AskCommand, TakesEachMemberFromAnOptionOrFromWith) {
  const auto asked = [](std::vector<std::string> options) {
    options.insert(options.begin(), "ask");
    return run_program(options);
  };
  const std::vector<std::string> move{"--robot", "planar2", "--from", "0,0", "--to", "1,1", "--duration", "2"};
  const auto by_with = asked({"jerk", "--with", R"({"robot":"planar2","from_q_rad":[0,0],"to_q_rad":[1,1],"T_s":2})"});
  ASSERT_EQ(by_with.code, 0) << by_with.err;
  std::vector<std::string> options = move;
  options.insert(options.begin(), "jerk");
  EXPECT_EQ(asked(options).out, by_with.out);
  options.insert(options.end(), {"--detail", "all", "--with", ""});
  const std::pair<const char*, const char*> twice[] = {
      {"robot", "\"lwr4\""}, {"from_q_rad", "[0,0]"}, {"from_q_deg", "[0,0]"},      {"to_q", "[0,0]"},
      {"T_s", "3"},          {"detail", "\"all\""},   {"service", "\"cycle_time\""}};
  for (const auto& [member, value] : twice) {
    options.back() = std::string("{\"") + member + "\":" + value + "}";
    const auto run = asked(options);
    EXPECT_EQ(run.code, 2) << run.out;
    EXPECT_THAT(run.err, HasSubstr(member));
    EXPECT_THAT(run.err, HasSubstr("--with"));
    EXPECT_THAT(run.err, HasSubstr("expected one of them"));
  }
  EXPECT_THAT(
      asked({"optimise", "--robot", "planar2", "--from", "0,0", "--to", "1,1", "--duration", "2", "--with", R"({"T_min_s":1})"})
          .err,
      HasSubstr("--duration: is given beside the member T_min_s of --with"));
  const auto missing = asked({"jerk", "--robot", "planar2", "--from", "0,0"});
  EXPECT_EQ(missing.code, 2);
  EXPECT_THAT(missing.err, HasSubstr("--to: is missing, expected a posture, or to_q_rad in --with"));
}

// Locked joints are none of the robot: the others are all revolute.
TEST(AskCommand, TakesARobotWhosePrismaticJointIsLocked) {
  const cotwin::testing::TemporaryFolder folder("gantry");
  std::ofstream(folder / "gantry.urdf")
      << R"(<robot name="gantry"><link name="base"/><link name="part"><inertial><mass value="2"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.8" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tool"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="rail" type="prismatic"><parent link="base"/><child link="part"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="2" velocity="1" effort="100"/></joint><joint name="turn" type="revolute"><parent link="part"/>
    <child link="tool"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="10"/></joint></robot>)";
  const auto asked = [&](const std::string& from, const std::string& to, const std::string& more) {
    return run_program({"ask", "cycle_time", "--robot", folder / "gantry.urdf", "--from", from, "--to", to, "--with", more});
  };
  const auto locked = asked("0.5", "1", R"({"locked_q":{"rail":0.3}})");
  EXPECT_EQ(locked.code, 0) << locked.err;
  const auto whole = asked("0.1,0.5", "0.1,1", "{}");
  EXPECT_EQ(whole.code, 0) << whole.err;
}

TEST(AskCommand, WritesTheParticlesOfASearch) {
  const cotwin::testing::TemporaryFolder folder("particles");
  const auto run =
      run_program({"ask", "optimise", "--robot", "planar2", "--from", "0,0.3", "--to", "1,-0.4", "--duration", "1.5", "--with",
                   R"({"degree":31,"particles":16,"rounds":5,"refine":false})", "--particles", folder / "particles.csv"});
  ASSERT_EQ(run.code, 0) << run.err;
  const std::string table = cotwin::testing::content(folder / "particles.csv");
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 1 + 16 * 5);
  EXPECT_THAT(table, HasSubstr("c_r[2;26]"));
}

// The script of the example, whose output the README explains.
TEST(AskCommand, RunsTheExampleOfTheCheaperMotion) {
  const cotwin::testing::TemporaryFolder folder("example");
  const std::string out = folder / "out";
  const auto run =
      cotwin::testing::run_command({fs::path(cotwin::places::source()) / "examples/11_cheaper_motion/run.sh", "--quiet"},
                                   {.folder = folder.path(),
                                    .environment = {"PATH=/usr/bin:/bin", "COTWIN=" + cotwin::places::program(), "OUT=" + out},
                                    .only_this_environment = true,
                                    .merge = true});
  ASSERT_EQ(run.code, 0) << run.out;
  const json answer = json::parse(cotwin::testing::content(fs::path(out) / "answer.json"));
  EXPECT_EQ(answer["status"], "feasible");
  EXPECT_GT(answer["saved_share"].get<double>(), 0);
  const json reply_schema = json::parse(cotwin::services::schema("optimise"))["reply"];
  for (const auto& [name, unused] : answer.items()) EXPECT_TRUE(reply_schema["properties"].contains(name)) << name;
  for (const auto& [name, unused] : answer["verification"].items())
    EXPECT_TRUE(reply_schema["properties"]["verification"]["properties"].contains(name)) << name;
  EXPECT_TRUE(fs::exists(fs::path(out) / "twins/signals.csv"));
}

json reply_of(const std::vector<std::string>& options) {
  const auto run = run_program(options);
  EXPECT_EQ(run.code, 0) << run.err;
  return json::parse(run.out);
}

// The figures of the example with fewer motions: what is reached, and times near those of the quintic to the same posture.
TEST(AskCommand, RunsTheExampleOfTheMap) {
  const cotwin::testing::TemporaryFolder folder("map");
  std::string script = cotwin::testing::content(fs::path(cotwin::places::source()) / "examples/28_map/run.sh");
  const std::string common = fs::path(cotwin::places::source()) / "examples/common.sh";
  for (const auto& [from, to] : {std::pair<std::string, std::string>{"2883000", "192200, \"detail\": \"all\""},
                                 {"$here/../common.sh", common},
                                 {"[31, 31, 1]", "[31, 5, 1]"},
                                 {"-0.75, -0.75,", "-0.75, -0.1,"},
                                 {"0.75, 0.75,", "0.75, 0.1,"}}) {
    ASSERT_NE(script.find(from), std::string::npos) << from;
    script.replace(script.find(from), from.size(), to);
  }
  std::ofstream(folder / "run.sh") << script;
  const auto run = cotwin::testing::run_command(
      {"/bin/sh", folder / "run.sh"},
      {.folder = folder.path(),
       .environment = {"PATH=/usr/bin:/bin", "COTWIN=" + cotwin::places::program(), "OUT=" + folder.path().string()},
       .only_this_environment = true,
       .merge = true});
  ASSERT_EQ(run.code, 0) << run.out;
  const json answer = json::parse(cotwin::testing::content(folder / "answer.json")), goals = answer["goals"];
  ASSERT_EQ(goals["reached"].size(), 155u);
  EXPECT_NEAR(static_cast<double>(std::ranges::count(goals["reached"], json(true))), 90, 4)
      << "a posture at a limit may be missed";
  int compared = 0;
  for (std::size_t k = 0; k < 155; k += 13) {
    if (goals["time_s"][k].is_null()) continue;
    const std::string to = goals["q_rad"][k].dump();
    const json quintic =
        reply_of({"ask", "cycle_time", "--from", "0,0.6,0,-1.7,0,0.84,0", "--to", to.substr(1, to.size() - 2)});
    const double ratio = goals["time_s"][k].get<double>() / quintic["T_s"].get<double>();
    EXPECT_GT(ratio, 0.7) << k;
    EXPECT_LT(ratio, 1.2) << k;
    ++compared;
  }
  EXPECT_GE(compared, 5);
  const std::string table = cotwin::testing::content(folder / "map.csv"),
                    picture = cotwin::testing::content(folder / "map.svg");
  EXPECT_EQ(table.substr(0, table.find('\n')), "x_m,y_m,z_m,reached,feasible_share,time_s,energy_J");
  EXPECT_EQ(std::ranges::count(table, '\n'), 156);
  EXPECT_THAT(picture, AllOf(HasSubstr("least time [s]"), HasSubstr("least energy [J]"), HasSubstr("</svg>")));
}

// NumPy's format 1.0: magic, version, length of the header, a dictionary, then records.
TEST(AskCommand, WritesTheMotionsThatItGrows) {
  const cotwin::testing::TemporaryFolder folder("rows");
  const auto grow = [&](const std::string& file, const std::string& more = "") {
    return run_program({"ask", "grow", "--robot", "planar2", "--from", "0,0.3", "--to", "1,-0.4", "--with",
                        R"({"T_min_s":1,"T_max_s":3,"motions":50,"degree":6)" + more + "}", "--rows", folder / file});
  };
  ASSERT_EQ(grow("rows.csv").code, 0);
  ASSERT_EQ(grow("rows.npy").code, 0);
  const std::string table = cotwin::testing::content(folder / "rows.csv"),
                    records = cotwin::testing::content(folder / "rows.npy");
  std::istringstream lines(table);
  std::string names, line;
  std::getline(lines, names);
  const auto columns = static_cast<std::size_t>(std::ranges::count(names, ',') + 1);
  ASSERT_EQ(records.substr(0, 8), std::string("\x93NUMPY\x01\0", 8));
  const std::size_t size = static_cast<unsigned char>(records[8]) + 256u * static_cast<unsigned char>(records[9]);
  EXPECT_EQ((10 + size) % 64, 0u);
  const std::string header = records.substr(10, size);
  EXPECT_THAT(header, AllOf(HasSubstr("{'descr': [('number', '<f8'), "), HasSubstr("('c_r[2;1]', '<f8'), ]"),
                            HasSubstr("'fortran_order': False, 'shape': (50,)}")));
  ASSERT_EQ(records.size(), 10 + size + 50 * columns * 8);
  for (std::size_t row = 0; row < 50; ++row) {
    ASSERT_TRUE(std::getline(lines, line));
    for (std::size_t column = 0; column < columns; ++column) {
      double value = 0;
      std::memcpy(&value, records.data() + 10 + size + (row * columns + column) * 8, 8);
      const std::size_t end = line.find(',');
      const double text = std::stod(line.substr(0, end));
      EXPECT_TRUE(value == text || (std::isnan(value) && std::isnan(text))) << row << " " << column;
      line.erase(0, end == std::string::npos ? end : end + 1);
    }
  }
  const auto wrong = grow("rows.txt");
  EXPECT_NE(wrong.code, 0);
  EXPECT_THAT(wrong.err, HasSubstr("has the suffix '.txt', expected .csv or .npy"));
  EXPECT_FALSE(fs::exists(folder / "rows.txt"));
  const auto refused = grow("kept.csv", R"(,"T_s":1)");
  EXPECT_NE(refused.code, 0);
  EXPECT_FALSE(fs::exists(folder / "kept.csv")) << "nothing is half written";
  const auto picture = run_program({"ask", "grow", "--from", "0,0,0,0,0,0,0", "--to", "0.1,0,0,0,0,0,0", "--with",
                                    R"({"T_min_s":1,"motions":5})", "--map", folder / "map.svg"});
  EXPECT_NE(picture.code, 0);
  EXPECT_THAT(picture.err, HasSubstr("the request has only one, expected to_grid or to_postures"));
  EXPECT_THAT(run_program({"ask", "jerk", "--map", "map.svg", "--from", "0,0,0,0,0,0,0", "--to", "0.1,0,0,0,0,0,0"}).err,
              HasSubstr("--map: is given for the service jerk, expected it with grow"));
}

cotwin::services::Verification twin_of(const cotwin::services::Robot& robot, const cotwin::services::Move& move, double T) {
  return cotwin::master::verify(cotwin::unit_types(), {cotwin::places::source() + "/models"}, robot, move, T, {});
}

// The twin with elastic joints and LuGre friction does about what the rigid formula with Coulomb and viscous friction says.
// A stand-in of the driver's library runs the GPU's programs on this processor.
TEST(AskCommand, LetsAGpuJudgeTheMotions) {
  const fs::path stand_in = fs::path(cotwin::places::program()).parent_path().parent_path() / "tests/stand_in";
  std::string ratio = "2";
  const auto ask = [&](std::vector<std::string> arguments, const std::string& fails = "0") {
    arguments.insert(arguments.begin(), {"ask"});
    return run_program(arguments, {.environment = {"LD_LIBRARY_PATH=" + stand_in.string(), "STAND_IN_FAILS=" + fails,
                                                   "STAND_IN_RATIO=" + ratio}});
  };
  const auto grow = [&](const std::string& device, const std::string& fails = "0") {
    return ask({"grow", "--robot", "planar2", "--from", "0,0.3", "--to", "1,-0.4", "--device", device, "--with",
                R"({"T_min_s":0.5,"T_max_s":3,"motions":3000})"},
               fails);
  };
  json here = json::parse(grow("cpu").out), there = json::parse(grow("gpu").out);
  EXPECT_EQ(here["device"], "cpu");
  EXPECT_EQ(there["device"], "stand-in of a GPU");
  EXPECT_LT(there["device_rounding"].get<double>(), 1e-12);
  EXPECT_FALSE(here.contains("device_rounding"));
  EXPECT_EQ(json::parse(grow("auto").out)["device"], "cpu") << "3000 motions are not worth a GPU";
  EXPECT_EQ(here["feasible_motions"], there["feasible_motions"]);
  EXPECT_EQ(here["forbidden"], there["forbidden"]);
  EXPECT_EQ(here["front"], there["front"]);
  const auto failed = grow("gpu", "1");
  EXPECT_EQ(failed.code, 2);
  EXPECT_EQ(failed.err, "cotwin: /device: is gpu, expected auto or cpu: GPU: cuInit: CUDA_ERROR_INVALID_VALUE\n");
  const auto optimise = [&](const std::string& fails) {
    return json::parse(ask({"optimise", "--robot", "planar2", "--from", "0,0.3", "--to", "1,-0.4", "--with",
                            R"({"T_min_s":1,"particles":10000,"rounds":2,"refine":false})"},
                           fails)
                           .out);
  };
  EXPECT_EQ(optimise("0")["device"], "stand-in of a GPU");
  const auto expect_none = [&](const std::string& fails, const std::string& reason) {
    const json without = optimise(fails);
    EXPECT_EQ(without["device"], "cpu");
    EXPECT_THAT(without["notes"].dump(), HasSubstr("device: this processor: GPU: " + reason));
  };
  expect_none("2", "cuDeviceGet: CUDA_ERROR_INVALID_VALUE");
  ratio = "64";
  EXPECT_EQ(json::parse(grow("gpu").out)["device"], "stand-in of a GPU");
  expect_none("0", "stand-in of a GPU is 64 times slower in double precision than in single, and taken only for device gpu");
  const auto refused =
      ask({"jerk", "--from", "0,0,0,0,0,0,0", "--to", "0.1,0,0,0,0,0,0", "--duration", "1", "--device", "gpu"});
  EXPECT_THAT(refused.err, HasSubstr("--device: is given for the service jerk, expected it with grow or optimise"));
}

TEST(Verify, AgreesWithTheRigidPredictionOfASmoothMove) {
  Robots robots({robots_folder()});
  const auto robot = robots.find("lwr4");
  cotwin::services::Move move;
  move.from_q = {0, 0.5, 0, -1, 0, 0.6, 0};
  move.to_q = {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8};
  const auto v = twin_of(*robot, move, 2);
  EXPECT_TRUE(v.feasible) << v.reason;
  EXPECT_NEAR(v.work, v.work_rigid, 0.02 * v.work_rigid);
  EXPECT_NEAR(v.drawn, v.drawn_rigid, 0.01 * v.drawn_rigid);
  for (std::size_t j = 0; j < 7; ++j) {
    EXPECT_LT(v.tracking[j], 1e-3);
    EXPECT_NEAR(v.tau[j], v.tau_rigid[j], 0.1 * v.tau_rigid[j] + 0.3) << j;
  }
  // The same request, the same bits.
  EXPECT_EQ(twin_of(*robot, move, 2).drawn, v.drawn);
  const auto fast = twin_of(*robot, move, 0.5);
  EXPECT_FALSE(fast.feasible);
  EXPECT_THAT(fast.reason, HasSubstr("joint "));
}

// The rigid move needs 322.6 N m of the 176 of joint 2. The controller cuts torques at the bounds of the move.
TEST(Verify, CutsTorquesAtTheBoundsOfTheMove) {
  Robots robots({robots_folder()});
  const auto robot = robots.find("lwr4");
  cotwin::services::Move move;
  move.from_q = move.to_q = {0, 0.5, 0, -1, 0, 0.6, 0};
  move.to_q[1] = 0.509;
  const auto v = twin_of(*robot, move, 0.03);
  EXPECT_FALSE(v.feasible);
  EXPECT_GT(v.tau[1], 1.2 * 176);
  EXPECT_GT(v.tau_cut[1], 0.2 * 176);
  // Without a bound of torque in the request nothing is cut, and with a smaller one more is.
  move.bounds.tau.assign(7, std::numeric_limits<double>::infinity());
  const auto unbound = twin_of(*robot, move, 0.03);
  EXPECT_TRUE(unbound.feasible) << unbound.reason;
  EXPECT_EQ(unbound.tau_cut[1], 0);
  EXPECT_LT(unbound.tracking[1], v.tracking[1]);
  move.bounds.tau.assign(7, 100);
  const auto weak = twin_of(*robot, move, 0.03);
  EXPECT_FALSE(weak.feasible);
  EXPECT_NEAR(weak.tau[1] - weak.tau_cut[1], 100, 1e-9);
}

// A speed limit or range of the robot that the request lifts does not hold the motion back.
TEST(Verify, FollowsAMoveBeyondTheRobotsLimitsIfTheRequestLiftsThem) {
  Robots robots({robots_folder()});
  const auto robot = robots.find("lwr4");
  cotwin::services::Move move;
  move.from_q = move.to_q = std::vector<double>(7, 0.0);
  move.to_q[6] = 3.2;  // limit 2.967, at up to 4 rad/s, limit 3.141
  move.bounds.q_max.assign(7, 4);
  move.bounds.dq.assign(7, 5);
  const auto v = twin_of(*robot, move, 1.5);
  EXPECT_TRUE(v.feasible) << v.reason;
  EXPECT_GT(v.q_max[6], 3.19);
}

TEST(Verify, TakesBoundsOfPositionAccelerationAndJerkFromThePlan) {
  Robots robots({robots_folder()});
  const auto robot = robots.find("lwr4");
  cotwin::services::Move move;
  move.from_q = move.to_q = std::vector<double>(7, 0.0);
  move.to_q[3] = 3;  // limit 2.094
  const auto beyond = twin_of(*robot, move, 4);
  EXPECT_FALSE(beyond.feasible);
  EXPECT_THAT(beyond.reason, HasSubstr("joint joint_4: q"));
  move.to_q[3] = 0.5;
  EXPECT_TRUE(twin_of(*robot, move, 2).feasible);
  move.bounds.ddq.assign(7, 0.1);  // 5.77·0.5/4 rad/s² is needed
  EXPECT_THAT(twin_of(*robot, move, 2).reason, HasSubstr("ddq"));
  move.bounds.ddq.clear();
  move.bounds.dddq.assign(7, 0.1);
  EXPECT_THAT(twin_of(*robot, move, 2).reason, HasSubstr("dddq"));
}

// Drives and electrical data are those beside the URDF, whatever its name.
TEST(Verify, TakesTheDrivesBesideAUrdfOfAnyName) {
  const cotwin::testing::TemporaryFolder folder("named");
  for (const char* name : {"drive_train.ssv", "compliance.ssv", "energy.ssv"})
    fs::copy_file(robots_folder() / "lwr4" / name, folder.path() / name);
  fs::copy_file(robots_folder() / "lwr4/robot.urdf", folder.path() / "arm.urdf");
  Robots own({robots_folder()}), named({folder.path()});
  cotwin::services::Move move;
  move.from_q = {0, 0.5, 0, -1, 0, 0.6, 0};
  move.to_q = {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8};
  const auto v = twin_of(*named.find("arm"), move, 2), as_robot = twin_of(*own.find("lwr4"), move, 2);
  EXPECT_EQ(v.tau, as_robot.tau);
  EXPECT_EQ(v.drawn, as_robot.drawn);
  ASSERT_FALSE(v.notes.empty());
  EXPECT_EQ(v.notes[0], "the twin's drives are those of drive_train.ssv beside arm.urdf");
  // Softer gears than those of the model folder make a difference.
  std::string soft = cotwin::testing::content(folder / "drive_train.ssv");
  for (std::size_t at = soft.find("\"12000\""); at != std::string::npos; at = soft.find("\"12000\"", at))
    soft.replace(at, 7, "\"2000\"");
  std::ofstream(folder / "drive_train.ssv") << soft;
  Robots again({folder.path()});
  EXPECT_GT(twin_of(*again.find("arm"), move, 2).tracking[1], 2 * v.tracking[1]);
  // An error in a file names the robot's folder.
  std::ofstream(folder / "compliance.ssv") << "<ssv:ParameterSet>";
  try {
    twin_of(*again.find("arm"), move, 2);
    FAIL() << "a damaged file was accepted";
  } catch (const cotwin::Error& e) {
    EXPECT_THAT(e.what(), HasSubstr((folder / "compliance.ssv").string()));
  }
}

// Without motor inertia and friction the computed torque is that of the rigid formula.
TEST(Verify, HasRigidJointsForRobotsWithoutDrives) {
  Robots robots({robots_folder()});
  cotwin::services::Move move;
  move.from_q = {0, -1, 1, -1, -1, 0};
  move.to_q = {0.6, -1.4, 1.3, -0.6, -1.2, 0.5};
  const auto v = twin_of(*robots.find("ur5e"), move, 2);
  EXPECT_TRUE(v.feasible) << v.reason;
  EXPECT_TRUE(v.rigid);
  EXPECT_THAT(v.notes.at(0), HasSubstr("rigid joints"));
  EXPECT_THAT(v.notes.at(0), HasSubstr("no drive_train.ssv"));
  EXPECT_NEAR(v.work, v.work_rigid, 0.005 * std::abs(v.work_rigid) + 0.01);
  EXPECT_NEAR(v.friction, 0, 1e-6);
  for (std::size_t j = 0; j < 6; ++j) {
    EXPECT_LT(v.tracking[j], 1e-3);
    EXPECT_NEAR(v.tau[j], v.tau_rigid[j], 0.02 * v.tau_rigid[j] + 0.1) << j;
  }
  // A robot with drives, asked without them.
  cotwin::services::VerificationOptions rigid;
  rigid.rigid = true;
  cotwin::services::Move arm;
  arm.from_q = {0, 0.5, 0, -1, 0, 0.6, 0};
  arm.to_q = {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8};
  const auto without =
      cotwin::master::verify(cotwin::unit_types(), {cotwin::places::source() + "/models"}, *robots.find("lwr4"), arm, 2, rigid);
  EXPECT_TRUE(without.feasible) << without.reason;
  EXPECT_THAT(without.notes.at(0), HasSubstr("drives = none"));
  EXPECT_NEAR(without.work, without.work_rigid, 0.005 * std::abs(without.work_rigid) + 0.01);
  EXPECT_LT(without.work, 0.9 * twin_of(*robots.find("lwr4"), arm, 2).work);
}

TEST(Verify, TellsWhatTheTwinRestsOn) {
  Robots robots({robots_folder()});
  cotwin::services::Context context;
  context.verify = [](const auto& robot, const auto& move, double T, const auto& options) {
    return cotwin::master::verify(cotwin::unit_types(), {cotwin::places::source() + "/models"}, robot, move, T, options);
  };
  const auto listed = [&](const json& more) {
    json request{{"service", "verify"},
                 {"from_q_rad", {0, 0.3, 0, -1, 0, 0.6, 0}},
                 {"to_q_rad", {0.3, 0.2, 0, -0.9, 0, 0.5, 0}},
                 {"T_s", 1}};
    request.update(more);
    const json reply = json::parse(cotwin::services::answer(robots, request.dump(), context));
    std::string all;
    for (const json& one : reply["assumptions"]) all += one["what"].get<std::string>() + ";";
    return all;
  };
  const std::string energy =
      "energy data R, k_t, P_0, P_off, P_brake, E_release, t_close, controller, C, V_min, V_max, efficiency;";
  EXPECT_EQ(listed({{"robot", "lwr4"}}),
            "inertia of motors;Coulomb friction;viscous friction;stiffness of joints;D, sigma0, sigma1, tau_S, v_S;" + energy);
  EXPECT_EQ(listed({{"robot", "iiwa14"}}), "inertia of motors;stiffness of joints;D, sigma0, sigma1, tau_S, v_S;" + energy);
  EXPECT_EQ(listed({{"robot", "lwr4"}, {"drives", "none"}}), "inertia of motors;friction;" + energy);
}

// What is carried all the way is as a link of the URDF; what comes and goes, and a wrench that comes and goes, shake the twin,
// whose work is the predicted one.
TEST(Verify, CarriesPayloadsAndIsPushed) {
  const cotwin::testing::TemporaryFolder folder("loads");
  std::string urdf = cotwin::testing::content(robots_folder() / "lwr4/robot.urdf");
  urdf.insert(
      urdf.rfind("</robot>"),
      "<link name=\"part\"><inertial><origin xyz=\"0 0.02 0.1\"/><mass value=\"4\"/><inertia ixx=\"0.02\" ixy=\"0\" ixz=\"0\" "
      "iyy=\"0.02\" iyz=\"0\" izz=\"0.01\"/></inertial></link><joint name=\"part_joint\" type=\"fixed\"><parent "
      "link=\"link_7\"/><child link=\"part\"/></joint>");
  folder.write("robots/heavy/robot.urdf", urdf);
  for (const char* file : {"drive_train.ssv", "energy.ssv", "compliance.ssv"})
    folder.write(std::string("robots/heavy/") + file, cotwin::testing::content(robots_folder() / "lwr4" / file));
  Robots robots({robots_folder(), folder / "robots"});
  cotwin::services::Move move;
  move.from_q = {0, 0.5, 0, -1, 0, 0.6, 0};
  move.to_q = {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8};
  const auto plain = twin_of(*robots.find("lwr4"), move, 2), heavy = twin_of(*robots.find("heavy"), move, 2);
  cotwin::robot::Payload part{{"part", "link_7", {}, {4, {0, 0.02, 0.1}, {}}, {}}, {}};
  part.part.inertia.I_CC = Eigen::Vector3d(0.02, 0.02, 0.01).asDiagonal();
  move.loads.payloads = {part};
  const auto carried = twin_of(*robots.find("lwr4"), move, 2);
  EXPECT_NEAR(carried.work, heavy.work, 1e-6 * heavy.work);
  EXPECT_NEAR(carried.work_rigid, heavy.work_rigid, 1e-9 * heavy.work);
  EXPECT_GT(carried.work, 1.1 * plain.work);
  for (std::size_t j = 0; j < 7; ++j) {
    EXPECT_NEAR(carried.tau[j], heavy.tau[j], 1e-5) << j;
    EXPECT_LT(carried.tracking[j], 1e-3);
  }
  move.loads.payloads.front().when = {0.3, 0.7};
  const auto lifted = twin_of(*robots.find("lwr4"), move, 2);
  EXPECT_NEAR(lifted.work, lifted.work_rigid, 0.02 * lifted.work_rigid);
  EXPECT_GT(lifted.work, plain.work + 5);
  EXPECT_GT(*std::ranges::max_element(lifted.tracking), 1e-3);
  EXPECT_LT(*std::ranges::max_element(lifted.end_error), 5e-4);  // without it again
  move.loads.payloads.clear();
  move.loads.wrench = cotwin::robot::ExternalWrench{robots.find("lwr4")->model.end_effector(), {}, false, {0, 0.6}};
  move.loads.wrench->f << 0, 0, -40, 0, 0, 0;
  const auto pushed = twin_of(*robots.find("lwr4"), move, 2);
  EXPECT_NEAR(pushed.work, pushed.work_rigid, 0.02 * pushed.work_rigid);
  EXPECT_GT(std::abs(pushed.work - plain.work), 2);
  EXPECT_LT(*std::ranges::max_element(pushed.tracking), 5e-3);
  EXPECT_LT(*std::ranges::max_element(pushed.end_error), 5e-4);
  EXPECT_THAT(pushed.notes, ::testing::Contains(HasSubstr("knows the wrench, and does not yield")));
  EXPECT_EQ(twin_of(*robots.find("lwr4"), move, 2).work, pushed.work);
}

// The written parameters make unit:motion run what the reply tells, with its speeds and accelerations at the ends.
TEST(AskCommand, WritesEndsInMotionForUnitMotion) {
  const cotwin::testing::TemporaryFolder folder("ends");
  const auto asked = run_program(
      {"ask", "feasibility", "--robot", "lwr4", "--from", "0,0.5,0,-1,0,0.6,0", "--to", "1.2,-0.2,0.4,0.7,-0.5,-0.3,0.8",
       "--duration", "2", "--detail", "series", "--motion", folder / "move.ssv", "--with",
       R"({"samples": 41, "dq_from_rad_per_s": [0.3,0,0,-0.2,0,0,0.1], "dq_to_rad_per_s": [0.1,0,0.2,0,0,0,0],
                                      "ddq_from_rad_per_s2": [0,1,0,0,0,0,0], "ddq_to_rad_per_s2": [0,0,0,0,0,0,-0.5]})"});
  ASSERT_EQ(asked.code, 0) << asked.err;
  folder.write(
      "move.ssd",
      R"(<ssd:SystemStructureDescription version="1.0" name="move" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription">
    <ssd:System name="move"><ssd:Elements><ssd:Component name="motion" source="unit:motion?kind=polynomial&amp;robot=lwr4" type="application/x-cotwin-unit">
    <ssd:ParameterBindings><ssd:ParameterBinding source="move.ssv"/></ssd:ParameterBindings></ssd:Component></ssd:Elements></ssd:System>
    <ssd:DefaultExperiment startTime="0" stopTime="2"/></ssd:SystemStructureDescription>)");
  const auto run = run_program({"run", folder / "move.ssd", "--out", folder / "out", "--set", "motion.limits=ignore",
                                "--record", "motion.*", "--quiet"});
  ASSERT_EQ(run.code, 0) << run.err;
  std::istringstream rows(cotwin::testing::content(folder / "out/signals.csv"));
  const auto cells = [&rows] {
    std::vector<std::string> all;
    std::string row, cell;
    std::getline(rows, row);
    for (std::istringstream in(row); std::getline(in, cell, ',');) all.push_back(cell);
    return all;
  };
  const std::vector<std::string> names = cells();
  const auto column = [&](const std::string& name, std::size_t joint) {
    return static_cast<std::size_t>(std::ranges::find(names, "motion." + name + "[" + std::to_string(joint + 1) + "]") -
                                    names.begin());
  };
  const json series = json::parse(asked.out)["series"];
  std::size_t compared = 0;
  for (std::vector<std::string> row = cells(); row.size() == names.size(); row = cells())
    for (std::size_t k = 0; k < 40; ++k)  // after the end it rests
      for (std::size_t j = 0; std::abs(series["t_s"][k].get<double>() - std::stod(row[0])) < 1e-9 && j < 7; ++j) {
        EXPECT_NEAR(std::stod(row.at(column("q_d", j))), series["joints"][j]["q_rad"][k].get<double>(), 1e-9) << row[0];
        EXPECT_NEAR(std::stod(row.at(column("dq_d", j))), series["joints"][j]["dq_rad_per_s"][k].get<double>(), 1e-9);
        EXPECT_NEAR(std::stod(row.at(column("ddq_d", j))), series["joints"][j]["ddq_rad_per_s2"][k].get<double>(), 1e-8);
        ++compared;
      }
  EXPECT_EQ(compared, 280U);
}

TEST(Verify, BeginsAndEndsInMotion) {
  Robots robots({robots_folder()});
  cotwin::services::Move move;
  move.from_q = {0, 0.5, 0, -1, 0, 0.6, 0};
  move.to_q = {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8};
  move.dq_from = move.dq_to = {0.5, -0.2, 0, 0.5, 0, -0.3, 0.2};
  const auto v = twin_of(*robots.find("lwr4"), move, 1.9995);
  EXPECT_TRUE(v.feasible) << v.reason;
  EXPECT_EQ(v.settle, 0);
  EXPECT_LT(*std::ranges::max_element(v.tracking), 1e-3);
  EXPECT_NEAR(v.work, v.work_rigid, 0.02 * v.work_rigid);
}

// The twin has the friction of the rigid formula: without drive_train.ssv that of the URDF.
TEST(Verify, HasTheFrictionOfTheUrdfForRobotsWithoutDrives) {
  const cotwin::testing::TemporaryFolder folder("friction");
  std::ofstream(folder / "disc.urdf") << R"(<robot name="disc"><link name="base"/><link name="part"><inertial><mass value="2"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.8" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="axis" type="revolute">
    <parent link="base"/><child link="part"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="50"/>
    <dynamics damping="3" friction="1"/></joint></robot>)";
  Robots robots({folder.path()});
  cotwin::services::Move move;
  move.from_q = {0};
  move.to_q = {1.5};
  const auto v = twin_of(*robots.find("disc"), move, 2);
  EXPECT_TRUE(v.feasible) << v.reason;
  EXPECT_THAT(v.notes.at(0), HasSubstr("with the friction of the URDF"));
  EXPECT_NEAR(v.work_rigid, 10.0 / 7 * 3 * 1.5 * 1.5 / 2 + 1.5, 1e-9);
  EXPECT_NEAR(v.work, v.work_rigid, 0.02 * v.work_rigid);
  EXPECT_NEAR(v.friction, v.work_rigid, 0.02 * v.work_rigid);
  EXPECT_LT(v.tracking[0], 1e-3);
}

// Joints that are locked at the positions at which they also stand in the whole robot: the motion is the same.
TEST(Verify, HoldsLockedJoints) {
  Robots robots({robots_folder()});
  cotwin::services::Move whole, part;
  whole.from_q = {0, 0.5, 0.2, -1, 0, 0.6, 0.3};
  whole.to_q = {0.8, 0.1, 0.2, -0.4, 0, 0.2, 0.3};
  part.from_q = {0, 0.5, -1, 0.6};
  part.to_q = {0.8, 0.1, -0.4, 0.2};
  const auto v = twin_of(*robots.find("lwr4", {{"joint_3", 0.2}, {"joint_5", 0}, {"joint_7", 0.3}}), part, 2);
  const auto all = twin_of(*robots.find("lwr4"), whole, 2);
  EXPECT_TRUE(v.feasible) << v.reason;
  ASSERT_EQ(v.tau.size(), 4U);
  for (const auto& [own, other] : {std::pair<std::size_t, std::size_t>{0, 0}, {1, 1}, {2, 3}, {3, 5}})
    EXPECT_NEAR(v.tau[own], all.tau[other], 0.05 * all.tau[other] + 0.1) << own;
  // A robot of one joint that is left.
  cotwin::services::Move one;
  one.from_q = {0};
  one.to_q = {0.5};
  EXPECT_TRUE(twin_of(*robots.find("planar2", {{"elbow", 0}}), one, 3).tau.size() == 1);
}

TEST(Verify, RefusesMovesThatTakeTooLongToSimulate) {
  Robots robots({robots_folder()});
  cotwin::services::Move move;
  move.from_q = move.to_q = {0, 0};
  EXPECT_THROW(twin_of(*robots.find("planar2"), move, 1001), cotwin::Error);
  EXPECT_EQ(twin_of(*robots.find("planar2"), move, 1e-4).T, 1e-4);
}

// The whole way: request in JSON, twin, reply with its notes.
TEST(AskCommand, VerifiesWithTheBoundsAndDrivesOfTheRequest) {
  const cotwin::testing::TemporaryFolder folder("verify");
  fs::copy_file(robots_folder() / "lwr4/robot.urdf", folder.path() / "arm.urdf");
  const auto asked = [&](const std::string& robot, const std::string& more) {
    return run_program({"ask", "verify", "--robot", robot, "--from", "0,0.5,0,-1,0,0.6,0", "--to", "0,0.509,0,-1,0,0.6,0",
                        "--duration", "0.03", "--with", more});
  };
  const auto rigid = asked(folder / "arm.urdf", "{}");
  ASSERT_EQ(rigid.code, 0) << rigid.err;
  const json reply = json::parse(rigid.out);
  EXPECT_EQ(reply["drives"], "rigid");
  EXPECT_THAT(reply["notes"][0].get<std::string>(), HasSubstr("there is no drive_train.ssv beside the URDF"));
  const auto relaxed = asked("lwr4", R"({"tau_max_Nm": [null, null, null, null, null, null, null]})");
  ASSERT_EQ(relaxed.code, 0) << relaxed.err;
  EXPECT_EQ(json::parse(relaxed.out)["feasible"], true) << relaxed.out;
  EXPECT_EQ(json::parse(relaxed.out)["drives"], "elastic");
  EXPECT_THAT(asked("lwr4", R"({"settle_s": 61})").err, HasSubstr("/settle_s"));
  const auto threads = run_program({"ask", "jerk", "--robot", "planar2", "--from", "0,0", "--to", "1,1", "--threads", "2"});
  EXPECT_NE(threads.code, 0);
  EXPECT_THAT(threads.err, HasSubstr("--threads"));
}

// The services accept in drive_train.ssv and energy.ssv every parameter of the units, as the units do.
TEST(FilesBesideTheRobot, MayHaveEveryParameterOfTheUnits) {
  for (const char* unit : {"drive_train", "energy"}) {
    const cotwin::testing::TemporaryFolder folder("parameters");
    fs::copy_file(robots_folder() / "planar2/robot.urdf", folder.path() / "arm.urdf");
    const auto instance = cotwin::make_unit(std::string("unit:") + unit + "?robot=planar2", {},
                                            {cotwin::places::source() + "/models"}, cotwin::unit_types());
    for (const cotwin::Variable& v : instance.variables.all()) {
      if ((v.role != cotwin::Role::kParameter && v.role != cotwin::Role::kTunable) || v.kind() != cotwin::Kind::kReal) continue;
      const auto values = v.reals();
      std::ofstream(folder.path() / (std::string(unit) + ".ssv"))
          << R"(<ssv:ParameterSet version="1.0" name="x" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">)"
          << "<ssv:Parameters><ssv:Parameter name=\"" << v.name << (v.size() > 1 ? "[1]" : "") << "\"><ssv:Real value=\""
          << (std::isfinite(values[0]) ? values[0] : 0.0) << "\" unit=\"" << v.si
          << "\"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>";
      EXPECT_NO_THROW(Robots({folder.path()}).find("arm")) << unit << " " << v.name << " " << v.si;
    }
  }
}

TEST(MotionFile, IsReadByTheUnitAsTheSameMotion) {
  const cotwin::testing::TemporaryFolder folder("motion");
  const auto asked =
      run_program({"ask", "optimise", "--robot", "planar2", "--from", "0,0.3", "--to", "1,-0.4", "--duration", "1.5", "--with",
                   R"({"degree":7,"particles":8,"rounds":4})", "--motion", folder / "motion.ssv"});
  ASSERT_EQ(asked.code, 0) << asked.err;
  const json reply = json::parse(asked.out);
  std::ofstream(folder / "run.ssd") << R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="run" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"><ssd:System name="run"><ssd:Elements>
<ssd:Component name="motion" source="unit:motion?robot=planar2&amp;kind=polynomial&amp;degree=7" type="application/x-cotwin-unit">
<ssd:ParameterBindings><ssd:ParameterBinding source="motion.ssv"/></ssd:ParameterBindings></ssd:Component>
</ssd:Elements></ssd:System><ssd:DefaultExperiment startTime="0" stopTime="1.5"/></ssd:SystemStructureDescription>)";
  const auto run = run_program({"run", folder / "run.ssd", "--out", folder / "results", "--quiet"});
  ASSERT_EQ(run.code, 0) << run.err << run.out;
  // The last row is the end of the motion; the largest speed is that of the reply.
  std::istringstream rows(cotwin::testing::content(folder / "results/signals.csv"));
  std::string line, header;
  std::getline(rows, header);
  std::vector<std::string> names;
  std::istringstream head(header);
  for (std::string name; std::getline(head, name, ',');) names.push_back(name);
  double largest = 0, last = 0;
  while (std::getline(rows, line)) {
    std::istringstream cells(line);
    std::size_t k = 0;
    for (std::string cell; std::getline(cells, cell, ','); ++k) {
      if (names.at(k).find("dq_d[1]") != std::string::npos && names[k].find("ddq") == std::string::npos)
        largest = std::max(largest, std::abs(std::stod(cell)));
      if (names.at(k).find("q_d[2]") != std::string::npos && names[k].find("dq") == std::string::npos) last = std::stod(cell);
    }
  }
  EXPECT_NEAR(last, -0.4, 1e-9);
  EXPECT_NEAR(largest, std::abs(reply["joints"][0]["dq_rad_per_s"]["value"].get<double>()), 1e-4);
  // The file defines the units of measure that it uses; one that does not fit is refused when the scenario is read.
  const std::string file = cotwin::testing::content(folder / "motion.ssv");
  EXPECT_THAT(file, HasSubstr("<ssc:Unit name=\"s\">"));
  for (const auto& [unit, part] : {std::pair{"kg", "T: kg cannot give s"}, {"furlong", "furlong"}}) {
    std::string other = file;
    other.replace(other.find("unit=\"s\""), 8, std::string("unit=\"") + unit + "\"");
    std::ofstream(folder / "motion.ssv") << other;
    const auto refused = run_program({"run", folder / "run.ssd", "--out", folder / "results", "--quiet"});
    EXPECT_EQ(refused.code, 2) << unit;
    EXPECT_THAT(refused.err, HasSubstr(part));
    EXPECT_THAT(refused.err, HasSubstr("motion.ssv"));
  }
  std::string unknown = file;
  unknown.replace(unknown.find("name=\"T\""), 8, "name=\"duration\"");
  std::ofstream(folder / "motion.ssv") << unknown;
  const auto refused = run_program({"run", folder / "run.ssd", "--out", folder / "results", "--quiet"});
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("duration"));
  EXPECT_THROW(cotwin::master::motion_file("{}"), cotwin::Error);
  EXPECT_THROW(cotwin::master::motion_file("["), cotwin::Error);
}

}  // namespace
}  // namespace ask_test
