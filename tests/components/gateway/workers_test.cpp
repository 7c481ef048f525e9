// Worker processes of the gateway: crashes, hangs, garbage, limits, and what they inherit.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sqlite3.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>
#include <string>

#include "components/gateway/jobs/canonical.h"
#include "components/gateway/jobs/jobs.h"
#include "models/foundation/support/error.h"
#include "tests/components/gateway/jobs_trial.h"

namespace cotwin::gateway::testing::workers_test {
namespace {

/// Processes whose command line has this text.
int processes_of(const std::string& text) {
  int count = 0;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator("/proc", ignored)) {
    const std::string command = command_line(entry.path());
    count += command.find(text) != std::string::npos && entry.path().filename() != std::to_string(getpid()) ? 1 : 0;
  }
  return count;
}

int open_descriptors() {
  const std::filesystem::directory_iterator all("/proc/self/fd");
  return static_cast<int>(std::distance(begin(all), end(all)));
}

struct Failure {
  const char* service;
  const char* reason;
};

class Workers : public ::testing::TestWithParam<Failure> {};

// The script is given the job twice: the first time and one retry.
TEST_P(Workers, CostAJobOneRetryWhenTheyFail) {
  Trial trial("workers");
  trial.options.line = 5000;
  Jobs jobs(trial.options);
  ASSERT_TRUE(jobs.store(order_of("bad", GetParam().service)).ok());
  ASSERT_TRUE(jobs.store(order_of("good", "echo")).ok());
  const Job job = done(jobs, "bad");
  EXPECT_EQ(job.state, JobState::kAborted);
  EXPECT_EQ(job.result, JobResult::kUnsuccessful);
  EXPECT_EQ(job.retries, 2);
  EXPECT_NE(job.reason.find(GetParam().reason), std::string::npos) << job.reason;
  EXPECT_NE(job.reason.find("no retry left"), std::string::npos) << job.reason;
  EXPECT_FALSE(job.result_number);
  EXPECT_EQ(done(jobs, "good").result, JobResult::kSuccessful);
  EXPECT_EQ(trial.log(), "bad\nbad\ngood\n");
  EXPECT_EQ(jobs.status().lost_workers, 2u);
}

INSTANTIATE_TEST_SUITE_P(All, Workers,
                         ::testing::Values(Failure{"crash",
                                                   "was killed by signal 9 (Killed); it wrote to stderr: out of order"},
                                           Failure{"exit", "exited with code 3"}, Failure{"garbage", "expected a line of JSON"},
                                           Failure{"other", "answered job 'somebody', expected 'bad'"},
                                           Failure{"no_line", "a line of more than 5000 bytes"}),
                         [](const auto& failure) { return std::string(failure.param.service); });

TEST(Workers, AreReplacedWhenTheyFailOnce) {
  const Trial trial("workers");
  Jobs jobs(trial.options);
  jobs.store(order_of("a", "crash_once"));
  const Job job = done(jobs, "a");
  EXPECT_EQ(job.result, JobResult::kSuccessful) << job.reason;
  EXPECT_EQ(job.retries, 1);
}

TEST(Workers, AreKilledAtTheTimeLimitOfAJob) {
  const Trial trial("workers");
  Jobs jobs(trial.options);
  JobOrder order = order_of("a", "hang");
  order.time_limit_s = 0.2;
  jobs.store(order);
  order = order_of("b", "flood");
  order.time_limit_s = 0.2;
  jobs.store(order);
  jobs.store(order_of("c", "echo"));
  for (const char* id : {"a", "b"}) {
    const Job job = done(jobs, id);
    EXPECT_EQ(job.state, JobState::kAborted);
    EXPECT_NE(job.reason.find("longer than its limit of 0.2 s"), std::string::npos) << job.reason;
    EXPECT_EQ(job.retries, 0);  // it would run as long again
    EXPECT_GE(job.busy_s, 0.2);
  }
  EXPECT_EQ(done(jobs, "c").result, JobResult::kSuccessful);
}

TEST(Workers, ThatEndAfterTheReplyHaveAnswered) {
  const Trial trial("workers");
  Jobs jobs(trial.options);
  jobs.store(order_of("a", "last"));
  EXPECT_EQ(done(jobs, "a").result, JobResult::kSuccessful);
  jobs.store(order_of("b", "twice"));  // the second reply is for no job: the worker is replaced
  EXPECT_EQ(done(jobs, "b").result, JobResult::kSuccessful);
  jobs.store(order_of("c", "echo"));
  const Job job = done(jobs, "c");
  EXPECT_EQ(job.result, JobResult::kSuccessful);
  EXPECT_EQ(job.retries, 0);  // even if it was given to the worker that wrote again
}

TEST(Workers, StopWhileTheirJobIsInterrupted) {
  const Trial trial("workers");
  Jobs jobs(trial.options);
  jobs.store(order_of("a", "progress"));
  ASSERT_TRUE(within_patience([&] { return jobs.find("a")->progress == 0.25; }));
  ASSERT_TRUE(jobs.command("a", JobVerb::kPause).ok());
  jobs.store(order_of("b", "echo"));
  EXPECT_EQ(done(jobs, "b").result, JobResult::kSuccessful);  // a stopped worker takes no place
  trial.open_gate();
  EXPECT_EQ(jobs.wait("a", 0.2)->state, JobState::kInterrupted);
  ASSERT_TRUE(jobs.command("a", JobVerb::kResume).ok());
  EXPECT_EQ(done(jobs, "a").result, JobResult::kSuccessful);
  EXPECT_EQ(trial.log(), "a\nb\n");  // it went on, and did not begin again
}

// A lock on the database keeps the reply, whose worker has ended, from being settled.
TEST(Workers, LeaveTheirPlaceIfTheyEndBeforeTheirJobIsInterrupted) {
  const Trial trial("workers");
  Jobs jobs(trial.options);
  sqlite3* other = nullptr;
  ASSERT_EQ(sqlite3_open_v2((trial.folder / "jobs.db").c_str(), &other, SQLITE_OPEN_READWRITE, nullptr), SQLITE_OK);
  sqlite3_busy_timeout(other, 60000);  // the jobs' thread may be writing
  const auto execute = [&](const char* sql) { return sqlite3_exec(other, sql, nullptr, nullptr, nullptr); };
  bool paused = false;
  std::string id;
  for (int i = 0; i < 5 && !paused; ++i) {
    id = "a" + std::to_string(i);
    std::filesystem::remove(trial.folder / "open");
    ASSERT_TRUE(jobs.store(order_of(id, "gate_last", "\"i\": " + std::to_string(i))).ok());
    ASSERT_TRUE(within_patience([&] { return trial.log().ends_with(id + "\n"); }));
    ASSERT_EQ(execute("BEGIN IMMEDIATE"), SQLITE_OK);
    trial.open_gate();
    const bool ended = within_patience([&] { return jobs.status().workers == 0 && !jobs.status().trouble.empty(); });
    ASSERT_EQ(execute("ROLLBACK"), SQLITE_OK);
    ASSERT_TRUE(ended);
    paused = jobs.command(id, JobVerb::kPause).ok();  // unless it was settled meanwhile
  }
  sqlite3_close(other);
  if (!paused) GTEST_SKIP() << "the machine is too slow";
  ASSERT_TRUE(jobs.store(order_of("b", "echo")).ok());
  EXPECT_EQ(done(jobs, "b").result, JobResult::kSuccessful);
  ASSERT_TRUE(jobs.command(id, JobVerb::kResume).ok());
  EXPECT_EQ(done(jobs, id).result, JobResult::kSuccessful);
}

TEST(Workers, AreStoppedUpToALimit) {
  Trial trial("workers");
  trial.options.paused = 1;
  trial.options.workers = 2;
  Jobs jobs(trial.options);
  for (const char* id : {"a", "b"}) {
    jobs.store(order_of(id, "gate", "\"id\": \"" + std::string(id) + "\""));
    ASSERT_TRUE(reaches(jobs, id, JobState::kRunning));
  }
  EXPECT_TRUE(jobs.command("a", JobVerb::kPause).ok());
  EXPECT_EQ(jobs.command("b", JobVerb::kPause).status, kUnableToAccept);
  EXPECT_EQ(jobs.find("b")->state, JobState::kRunning);
}

TEST(Workers, EndWithTheirGroupWhenAJobIsAborted) {
  const Trial trial("workers");
  Jobs jobs(trial.options);
  jobs.store(order_of("a", "hang"));
  ASSERT_TRUE(within_patience([&] { return trial.log() == "a\n"; }));
  ASSERT_TRUE(jobs.command("a", JobVerb::kAbort).ok());
  EXPECT_TRUE(within_patience([&] { return processes_of(trial.folder.path().string()) == 0; }));
  jobs.store(order_of("b", "hang"));
  ASSERT_TRUE(within_patience([&] { return trial.log() == "a\nb\n"; }));
  EXPECT_EQ(jobs.command("b", JobVerb::kStop).status, kNoError);
  const Job stopped = *jobs.find("b");
  EXPECT_EQ(stopped.state, JobState::kEnded);
  EXPECT_EQ(stopped.result, JobResult::kUnsuccessful);
  EXPECT_TRUE(within_patience([&] { return processes_of(trial.folder.path().string()) == 0; }));
}

TEST(Workers, HaveALimitOfMemoryAndALowerPriorityAndNoDescriptorOfTheGateway) {
  Trial trial("workers");
  trial.options.memory = std::uint64_t{512} << 20;
  const int leak = socket(AF_INET, SOCK_STREAM, 0);  // inherited by exec
  const int before = open_descriptors();
  {
    Jobs jobs(trial.options);
    jobs.store(order_of("a", "limits"));
    const Job job = done(jobs, "a");
    ASSERT_TRUE(job.result_number) << job.reason;
    const auto reply = nlohmann::json::parse(jobs.result(*job.result_number)->reply);
    EXPECT_EQ(reply.at("nice"), std::to_string(std::min(19, nice(0) + 10)));
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    EXPECT_EQ(reply.at("data_KiB"), "524288");
#endif
    const std::string open = reply.at("open");
    EXPECT_NE(open.find("pipe:"), std::string::npos) << open;
    EXPECT_EQ(open.find(std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(leak)).string()), std::string::npos)
        << open;
    EXPECT_EQ(open.find("jobs.db"), std::string::npos) << open;
    jobs.store(order_of("b", "crash"));
    done(jobs, "b");
  }
  EXPECT_EQ(open_descriptors(), before);
  close(leak);
}

TEST(Workers, ThatCannotBeStartedLeaveTheJobsWaiting) {
  Trial trial("workers");
  trial.options.command = {"/nonexistent/worker"};
  {
    Jobs jobs(trial.options);
    ASSERT_TRUE(jobs.store(order_of("a", "echo")).ok());
    ASSERT_TRUE(within_patience([&] { return !jobs.status().trouble.empty(); }));
    EXPECT_EQ(jobs.status().trouble, "/nonexistent/worker: cannot be started as a worker: No such file or directory");
    EXPECT_EQ(jobs.find("a")->state, JobState::kAllowedToStart);
  }
  trial.options.command = {"/bin/sh", (trial.folder / "worker.sh").string(), trial.folder.path().string()};
  Jobs jobs(trial.options);
  EXPECT_EQ(done(jobs, "a").result, JobResult::kSuccessful);
  EXPECT_EQ(jobs.status().trouble, "");
}

TEST(Workers, ThatDoNotReadTheirJobRaiseNoSignal) {
  Trial trial("workers");
  trial.options.command = {"/bin/true"};
  Jobs jobs(trial.options);
  jobs.store(order_of("big", "echo", "\"x\": \"" + std::string(500'000, 'x') + "\""));  // more than a socket buffers
  const Job job = done(jobs, "big");
  EXPECT_EQ(job.state, JobState::kAborted);
  EXPECT_NE(job.reason.find("exited with code 0"), std::string::npos) << job.reason;
}

TEST(WorkerLines, KeepTheBytesOfTheReply) {
  const WorkerLine line =
      parse_worker_line(R"( {"id":"a\"}", "other":[{"reply":1}] ,"reply" : {"x": [1.50, "}\"\\"], "y":{}}  } )");
  EXPECT_EQ(line.id, "a\"}");
  EXPECT_EQ(line.reply, R"({"x": [1.50, "}\"\\"], "y":{}})");
  EXPECT_EQ(parse_worker_line(R"({"reply":"a,b","id":""})").reply, R"("a,b")");
  EXPECT_EQ(parse_worker_line(R"({"reply": -1.5e3 ,"id":""})").reply, "-1.5e3");
  EXPECT_EQ(parse_worker_line(R"({"id":"","reply":null})").reply, "null");
  EXPECT_EQ(parse_worker_line(R"({"id":"","progress":1,"message":"ä"})").progress, 1);
  for (const char* bad : {"", "x", "[]", "{}", "1", R"({"id":"a"})", R"({"id":1,"reply":{}})", R"({"reply":{}})",
                          R"({"id":"a","reply":{},"progress":0})", R"({"id":"a","progress":1.01})",
                          R"({"id":"a","progress":-0.1})", R"({"id":"a","progress":"1"})", R"({"id":"a","problem":"no"})",
                          R"({"id":"a","reply":NaN})", R"({"id":"a","reply":{}} x)", R"({"id":"a","message":1,"progress":0})"})
    EXPECT_THROW(parse_worker_line(bad), Error) << bad;
  EXPECT_THROW(parse_worker_line(R"({"id":"a","problem":{"detail":")" + std::string(70'000, 'x') + "\"}}"), Error);
}

// The second formulation is the parser of nlohmann::json: a damaged line is refused, or has the same reply there.
TEST(WorkerLines, AreReadLikeTheJsonThatTheyAre) {
  const std::string good = R"({"id":"j\u00e4\"1","reply":{"a":[1,-2.5e-3,"}],\"{",[[]],{}],"b":null} , "more":[true]})";
  const std::string bytes = R"({}[]",:\ 01e-.nu)";
  std::mt19937 random(4);
  int read = 0;
  for (int n = 0; n < 30'000; ++n) {
    std::string line = good;
    for (std::size_t edits = 1 + random() % 3; edits > 0; --edits) {
      const std::size_t at = random() % line.size();
      const char byte = bytes[random() % bytes.size()];
      switch (random() % 3) {
        case 0:
          line[at] = byte;
          break;
        case 1:
          line.insert(at, 1, byte);
          break;
        default:
          line.erase(at, 1 + random() % 4);
      }
      if (line.empty()) line = "x";
    }
    try {
      const WorkerLine parsed = parse_worker_line(line);
      const auto whole = nlohmann::json::parse(line);
      ++read;
      EXPECT_EQ(parsed.id, whole.at("id")) << line;
      if (!parsed.reply.empty()) {
        EXPECT_EQ(nlohmann::json::parse(parsed.reply), whole.at("reply")) << line;
      }
    } catch (const Error&) {
      continue;
    }
  }
  EXPECT_GT(read, 1000);
}

}  // namespace
}  // namespace cotwin::gateway::testing::workers_test
