// The database of the gateway's jobs: kills, damage, full disks, two owners.
#include <gtest/gtest.h>
#include <signal.h>
#include <sqlite3.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <sstream>
#include <string>

#include "components/gateway/jobs/jobs.h"
#include "tests/components/gateway/jobs_trial.h"
#include "tests/support/error_of.h"

namespace cotwin::gateway::testing::database_test {
namespace {

using cotwin::testing::error_of;

constexpr int kJobs = 1000;

std::string name_of(int i) { return "job" + std::to_string(i); }

/// Stores all jobs that are missing, under keys, and writes the number of each acknowledged one to `acknowledged`.
[[noreturn]] void serve_until_killed(const JobsOptions& options, int acknowledged) {
  try {
    Jobs jobs(options);
    for (int i = 0; i < kJobs; ++i) {
      const JobReply reply =
          jobs.store(order_of(name_of(i), "echo", "\"n\": " + std::to_string(i)),
                     {.start = true, .idempotency_key = "key" + std::to_string(i), .owner = "", .comment = {}});
      if (!reply.ok() || write(acknowledged, &i, sizeof i) != sizeof i) _exit(1);
    }
    for (;;) pause();
  } catch (...) {
    _exit(2);
  }
}

TEST(JobDatabase, LosesNoJobAndDoesNoneTwiceWhenItsProcessIsKilled) {
  Trial trial("database");
  trial.options.workers = 2;
  std::mt19937 random(16);
  constexpr int kKills = 6;
  int stored = -1, kills = 0;
  for (; kills < kKills; ++kills) {
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    if (child == 0) serve_until_killed(trial.options, ends[1]);
    close(ends[1]);
    // Killed after a random number of new jobs and a random time, so that storing, starting and ending are all met.
    const int target = std::min(kJobs - 1, stored + 1 + static_cast<int>(random() % 300));
    int i = -1;
    while (i < target && read(ends[0], &i, sizeof i) == sizeof i) continue;
    EXPECT_EQ(i, target);
    usleep(static_cast<useconds_t>(random() % 20'000));
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status));
    while (read(ends[0], &i, sizeof i) == sizeof i) continue;
    stored = std::max(stored, i);
    close(ends[0]);
  }
  Jobs jobs(trial.options);
  for (int i = 0; i <= stored; ++i) EXPECT_TRUE(jobs.find(name_of(i))) << "job " << i << " was acknowledged and is lost";
  for (int i = 0; i < kJobs; ++i) {
    const JobReply reply =
        jobs.store(order_of(name_of(i), "echo", "\"n\": " + std::to_string(i)),
                   {.start = true, .idempotency_key = "key" + std::to_string(i), .owner = "", .comment = {}});
    EXPECT_TRUE(reply.ok()) << reply.message;
    EXPECT_TRUE(i > stored || reply.repeated) << i;
  }
  std::map<std::string, int> results;
  for (int i = 0; i < kJobs; ++i) {
    const Job job = done(jobs, name_of(i));
    EXPECT_EQ(job.state, JobState::kEnded) << i;
    EXPECT_EQ(job.result, JobResult::kSuccessful) << i << ": " << job.reason;
  }
  std::string cursor;
  do {
    const ResultPage page = jobs.results({}, cursor, 1000);
    for (const Result& result : page.results) ++results[result.job_id];
    cursor = page.next;
  } while (!cursor.empty());
  EXPECT_EQ(results.size(), static_cast<std::size_t>(kJobs));
  for (const auto& [id, count] : results) EXPECT_EQ(count, 1) << id;
  EXPECT_EQ(jobs.status().done, static_cast<std::size_t>(kJobs));
  // A worker sees a job again only if it had the job when the gateway was killed.
  std::map<std::string, int> given;
  std::istringstream log(trial.log());
  int again = 0;
  for (std::string id; std::getline(log, id);) again += ++given[id] > 1 ? 1 : 0;
  EXPECT_EQ(given.size(), static_cast<std::size_t>(kJobs));
  EXPECT_LE(again, kills * trial.options.workers);
}

TEST(JobDatabase, LeavesNoWorkerBehindWhenItsProcessIsKilled) {
  const Trial trial("database");
  const pid_t child = fork();
  if (child == 0) {
    Jobs jobs(trial.options);
    jobs.store(order_of("a", "hang"));
    for (;;) pause();
  }
  ASSERT_TRUE(within_patience([&] { return trial.log() == "a\n"; }));
  const std::string mark = trial.folder.path().string();
  const auto workers = [&] {
    int count = 0;
    for (const auto& entry : std::filesystem::directory_iterator("/proc"))
      count += command_line(entry.path()).find(mark) != std::string::npos ? 1 : 0;
    return count;
  };
  EXPECT_GE(workers(), 1);  // and a moment of the shell's own child
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  EXPECT_TRUE(within_patience([&] { return workers() == 0; }));
  Jobs jobs(trial.options);
  ASSERT_TRUE(within_patience([&] { return trial.log() == "a\na\n"; }));
  EXPECT_EQ(jobs.find("a")->state, JobState::kRunning);
  EXPECT_EQ(jobs.find("a")->restarts, 1);
}

TEST(JobDatabase, RunsAnInterruptedJobAgainByItsPriority) {
  const Trial trial("database");
  const pid_t child = fork();
  if (child == 0) {
    Jobs jobs(trial.options);
    jobs.store(order_of("interrupted", "gate"));
    while (trial.log().empty()) usleep(1000);
    JobOrder urgent = order_of("urgent", "echo");
    urgent.priority = 2;
    jobs.store(urgent);
    jobs.store(order_of("later", "echo", "\"n\": 1"));
    trial.folder.write("stored", "");
    for (;;) pause();
  }
  ASSERT_TRUE(within_patience([&] { return std::filesystem::exists(trial.folder / "stored"); }));
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  trial.open_gate();
  Jobs jobs(trial.options);
  for (const char* id : {"urgent", "interrupted", "later"}) EXPECT_EQ(done(jobs, id).state, JobState::kEnded) << id;
  EXPECT_EQ(trial.log(), "interrupted\nurgent\ninterrupted\nlater\n");
}

TEST(JobDatabase, AbortsAJobDuringWhichTheGatewayEndsAgainAndAgain) {
  Trial trial("database");
  trial.options.restarts = 2;
  std::string expected;
  for (int i = 0; i < 3; ++i) {
    const pid_t child = fork();
    if (child == 0) {
      Jobs jobs(trial.options);
      if (i == 0) jobs.store(order_of("a", "hang"));
      for (;;) pause();
    }
    expected += "a\n";
    EXPECT_TRUE(within_patience([&] { return trial.log() == expected; }));
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
  }
  Jobs jobs(trial.options);
  EXPECT_EQ(jobs.find("a")->state, JobState::kAborted);
  EXPECT_NE(jobs.find("a")->reason.find("ended 3 times"), std::string::npos);
}

TEST(JobDatabase, AbortsNoJobBecauseTheGatewayIsClosedAgainAndAgain) {
  Trial trial("database");
  trial.options.restarts = 1;
  trial.options.workers = 2;
  for (int i = 0; i < 4; ++i) {
    Jobs jobs(trial.options);
    if (i == 0) {
      jobs.store(order_of("paused", "gate"));
      ASSERT_TRUE(reaches(jobs, "paused", JobState::kRunning));
      ASSERT_TRUE(jobs.command("paused", JobVerb::kPause).ok());
      jobs.store(order_of("running", "gate", "\"x\": 1"));
    }
    ASSERT_TRUE(reaches(jobs, "running", JobState::kRunning));
    EXPECT_EQ(jobs.find("running")->restarts, 0);
    EXPECT_EQ(jobs.find("paused")->state, JobState::kInterrupted);
  }
}

TEST(JobDatabase, CanBeReadByItsOwnerOnly) {
  const Trial trial("database");
  const mode_t before = umask(022);
  {
    Jobs jobs(trial.options);
    jobs.store(order_of("a", "echo"));
    done(jobs, "a");
    for (const char* file : {"jobs.db", "jobs.db-wal", "jobs.db-shm"}) {
      struct stat status {};
      ASSERT_EQ(stat((trial.folder / file).c_str(), &status), 0) << file;
      EXPECT_EQ(status.st_mode & 0777, 0600u) << file;
    }
  }
  umask(before);
}

TEST(JobDatabase, KeepsInterruptedJobsInterruptedOverARestart) {
  const Trial trial("database");
  {
    Jobs jobs(trial.options);
    jobs.store(order_of("a", "gate"));
    ASSERT_TRUE(reaches(jobs, "a", JobState::kRunning));
    ASSERT_TRUE(jobs.command("a", JobVerb::kPause).ok());
  }
  trial.open_gate();
  Jobs jobs(trial.options);
  EXPECT_EQ(jobs.wait("a", 0.2)->state, JobState::kInterrupted);
  ASSERT_TRUE(jobs.command("a", JobVerb::kResume).ok());
  EXPECT_EQ(done(jobs, "a").result, JobResult::kSuccessful);
}

TEST(JobDatabase, HasOneOwner) {
  const Trial trial("database");
  const Jobs jobs(trial.options);
  const std::string message = error_of([&] { const Jobs second(trial.options); });
  EXPECT_NE(message.find((trial.folder / "jobs.db").string() + ": is in use by process " + std::to_string(getpid())),
            std::string::npos)
      << message;
  Trial link("link");
  std::filesystem::create_symlink(trial.folder / "jobs.db", link.folder / "jobs.db");
  EXPECT_NE(error_of([&] { const Jobs second(link.options); }).find("is in use by process"), std::string::npos);
}

TEST(JobDatabase, RefusesWhatItCannotUse) {
  const Trial trial("database");
  const auto refusal = [&](const std::filesystem::path& file) {
    JobsOptions options = trial.options;
    options.database = file;
    const std::string message = error_of([&] { const Jobs jobs(options); });
    EXPECT_TRUE(message.starts_with(file.string())) << message;
    return message;
  };
  EXPECT_NE(refusal(trial.folder.write("text.db", std::string(5000, 'x'))).find("no SQLite database"), std::string::npos);
  EXPECT_NE(refusal(trial.folder / "missing/jobs.db").find("No such file or directory"), std::string::npos);
  EXPECT_NE(refusal("/proc/jobs.db"), "");  // nobody may write there, not even root
  std::filesystem::create_directory(trial.folder / "folder.db");
  EXPECT_NE(refusal(trial.folder / "folder.db"), "");
  sqlite3* other = nullptr;
  ASSERT_EQ(sqlite3_open((trial.folder / "other.db").c_str(), &other), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(other, "CREATE TABLE jobs(x)", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(other);
  EXPECT_NE(refusal(trial.folder / "other.db").find("of another program"), std::string::npos);
  { const Jobs jobs(trial.options); }
  sqlite3* newer = nullptr;
  ASSERT_EQ(sqlite3_open((trial.folder / "jobs.db").c_str(), &newer), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(newer, "PRAGMA user_version = 99", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(newer);
  EXPECT_NE(refusal(trial.folder / "jobs.db").find("newer cotwin"), std::string::npos);
}

// One of before jobs had lights: they have none.
TEST(JobDatabase, OpensOneOfTheVersionBefore) {
  const Trial trial("database");
  {
    Jobs jobs(trial.options);
    ASSERT_TRUE(jobs.store(order_of("before", "red")).ok());
    EXPECT_EQ(done(jobs, "before").light, "red");
  }
  sqlite3* older = nullptr;
  ASSERT_EQ(sqlite3_open((trial.folder / "jobs.db").c_str(), &older), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(older, "ALTER TABLE jobs DROP COLUMN light; PRAGMA user_version = 1", nullptr, nullptr, nullptr),
            SQLITE_OK);
  sqlite3_close(older);
  for (int start = 0; start < 2; ++start) {
    Jobs jobs(trial.options);
    EXPECT_EQ(jobs.find("before")->light, "");
    EXPECT_EQ(jobs.find("before")->state, JobState::kEnded);
    ASSERT_TRUE(jobs.store(order_of("after" + std::to_string(start), "red")).ok());
    EXPECT_EQ(done(jobs, "after" + std::to_string(start)).light, "red");
  }
}

TEST(JobDatabase, RefusesADamagedFileAndLeavesItAlone) {
  const Trial trial("database");
  {
    Jobs jobs(trial.options);
    const StoreOptions held{.start = false, .idempotency_key = "", .owner = "", .comment = {}};
    for (int i = 0; i < 200; ++i) jobs.store(order_of(name_of(i), "echo", "\"x\": \"" + std::string(200, 'x') + "\""), held);
  }
  const std::filesystem::path file = trial.folder / "jobs.db";
  std::string bytes = cotwin::testing::content(file);
  ASSERT_GT(bytes.size(), 20'000u);
  for (std::size_t page = 4096; page + 4096 <= bytes.size(); page += 4096)
    std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(page), 100, '\x55');
  std::ofstream(file, std::ios::binary) << bytes;
  EXPECT_NE(error_of([&] { const Jobs jobs(trial.options); }).find("is damaged"), std::string::npos);
  EXPECT_EQ(cotwin::testing::content(file), bytes);
  std::ofstream(file, std::ios::binary) << bytes.substr(0, 5000);  // cut off
  EXPECT_NE(error_of([&] { const Jobs jobs(trial.options); }).find("is damaged"), std::string::npos);
}

/// Limits the size of files that this process writes: a full disk for SQLite.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) : handler_(signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    signal(SIGXFSZ, handler_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  sighandler_t handler_;
  rlimit before_{};
};

TEST(JobDatabase, RefusesOrdersWhileTheDiskIsFullAndKeepsTheRepliesOfWorkers) {
  const Trial trial("database");
  Jobs jobs(trial.options);
  ASSERT_TRUE(jobs.store(order_of("running", "gate", "\"x\": \"" + std::string(50'000, 'y') + "\"")).ok());
  ASSERT_TRUE(within_patience([&] { return trial.log() == "running\n"; }));
  const StoreOptions held{.start = false, .idempotency_key = "", .owner = "", .comment = {}};
  int stored = 0;
  {
    const FullDisk full(600'000);
    JobReply reply;
    for (; stored < 100; ++stored) {
      reply = jobs.store(order_of(name_of(stored), "echo", "\"x\": \"" + std::string(30'000, 'x') + "\""), held);
      if (!reply.ok()) break;
    }
    EXPECT_EQ(reply.status, kUnableToAccept);
    EXPECT_NE(reply.message.find("cannot be written"), std::string::npos) << reply.message;
    trial.open_gate();
    EXPECT_TRUE(within_patience([&] { return !jobs.status().trouble.empty(); }));
    EXPECT_EQ(jobs.wait("running", 0.3)->state, JobState::kRunning);
  }
  EXPECT_EQ(done(jobs, "running").result, JobResult::kSuccessful);
  EXPECT_EQ(trial.log(), "running\n");  // the reply was kept, the job did not run again
  EXPECT_TRUE(jobs.store(order_of("more", "echo"), held).ok());
  for (int i = 0; i < stored; ++i) EXPECT_TRUE(jobs.find(name_of(i)));
  EXPECT_FALSE(jobs.find(name_of(stored)));
  EXPECT_TRUE(within_patience([&] { return jobs.status().trouble.empty(); }));
}

TEST(JobDatabase, CanBeReadByOthersMeanwhile) {
  const Trial trial("database");
  Jobs jobs(trial.options);
  sqlite3* reader = nullptr;
  ASSERT_EQ(sqlite3_open_v2((trial.folder / "jobs.db").c_str(), &reader, SQLITE_OPEN_READONLY, nullptr), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(reader, "BEGIN; SELECT count(*) FROM jobs", nullptr, nullptr, nullptr), SQLITE_OK);
  EXPECT_TRUE(jobs.store(order_of("a", "echo")).ok());
  EXPECT_EQ(done(jobs, "a").result, JobResult::kSuccessful);
  sqlite3_close(reader);
}

}  // namespace
}  // namespace cotwin::gateway::testing::database_test
