// Chains as jobs: one job, whose steps are results of their own.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "components/gateway/jobs/jobs.h"
#include "components/services/json/control/control.h"
#include "tests/components/gateway/jobs_trial.h"

namespace cotwin::gateway::testing::chains_test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::ordered_json;

struct ChainTrial : Trial {
  explicit ChainTrial(const std::string& name) : Trial(name) {
    options.chains = {services::next_step, services::chain_reply, services::chain_problem, services::problem};
    options.robot_hash = [](const std::string& robot) { return "hash of " + robot; };
  }
};

/// A chain of services of the worker of the trials, which reply with {"of": their request}.
JobOrder chain_of(const std::string& id, const std::string& steps) {
  JobOrder order;
  order.id = id;
  order.request = R"({"steps": [)" + steps + "]}";
  return order;
}

constexpr const char* kThree = R"({"name": "a", "service": "echo", "robot": "lwr4", "x": 3},
  {"name": "b", "service": "echo", "robot": "ur5", "x": "$a/of/x", "y": ["$a/of/robot"]},
  {"name": "c", "service": "echo", "robot": "lwr4", "x": "$b/of/y/0"})";

Json reply_of(Jobs& jobs, const std::string& id) {
  const Job job = done(jobs, id);
  EXPECT_EQ(job.result, JobResult::kSuccessful) << job.reason;
  return job.result_number ? Json::parse(jobs.result(*job.result_number)->reply) : Json();
}

std::vector<Result> results_of(Jobs& jobs, const std::string& id) {
  ResultFilter filter;
  filter.job_id = id;
  filter.newest_first = false;
  return jobs.results(filter).results;
}

TEST(ChainJobs, GiveEachStepToAWorkerAndKeepItsReply) {
  const ChainTrial trial("chains");
  Jobs jobs(trial.options);
  ASSERT_TRUE(jobs.store(chain_of("j", kThree)).ok());
  const Json reply = reply_of(jobs, "j");
  ASSERT_EQ(reply["steps"].size(), 3u);
  EXPECT_EQ(reply["steps"][1]["reply"]["of"]["x"], 3);
  EXPECT_EQ(reply["steps"][1]["reply"]["of"]["y"], Json::array({"lwr4"}));
  EXPECT_EQ(reply["steps"][2]["reply"]["of"]["x"], "lwr4");
  EXPECT_EQ(trial.log(), "j/0\nj/1\nj/2\n");
  const Job job = *jobs.find("j");
  EXPECT_EQ(job.service, "chain");
  EXPECT_EQ(job.progress, 1);
  const std::vector<Result> kept = results_of(jobs, "j");
  ASSERT_EQ(kept.size(), 4u);
  EXPECT_EQ(kept[1].robot, "ur5");
  EXPECT_EQ(kept[1].robot_hash, "hash of ur5");
  EXPECT_EQ(kept[1].request, R"({"robot":"ur5","service":"echo","x":3,"y":["lwr4"]})");
  EXPECT_EQ(kept[3].service, "chain");
  // The steps are results of equal requests, of chains and of others; the chain itself depends on all robots and is put together again.
  ASSERT_TRUE(jobs.store(chain_of("again", kThree)).ok());
  EXPECT_EQ(reply_of(jobs, "again"), reply);
  ASSERT_TRUE(jobs.store(order_of("alone", "echo", R"("x": 3)")).ok());
  EXPECT_TRUE(jobs.result(*done(jobs, "alone").result_number)->reused);
  EXPECT_EQ(trial.log(), "j/0\nj/1\nj/2\n");
  JobOrder fresh = chain_of("fresh", kThree);
  fresh.reuse = false;
  ASSERT_TRUE(jobs.store(fresh).ok());
  EXPECT_EQ(reply_of(jobs, "fresh"), reply);
  EXPECT_EQ(trial.log(), "j/0\nj/1\nj/2\nfresh/0\nfresh/1\nfresh/2\n");
}

// A chain runs to its end and is judged then, by its first step with the worst light.
TEST(ChainJobs, AreJudgedAtTheirEnd) {
  const ChainTrial trial("chains");
  Jobs jobs(trial.options);
  const std::string steps = R"({"service": "echo", "robot": "lwr4"}, {"service": "jerk", "robot": "lwr4", "T_s": 3},
                               {"service": "echo", "robot": "ur5"})";
  ASSERT_TRUE(jobs.store(chain_of("free", steps)).ok());
  EXPECT_EQ(done(jobs, "free").state, JobState::kEnded);
  EXPECT_EQ(done(jobs, "free").light, "green");
}

// Steps that are equal are computed once; another file of the robot makes it another step.
TEST(ChainJobs, ReuseByRequestRobotAndBuild) {
  ChainTrial trial("chains");
  std::string version = "1";
  trial.options.robot_hash = [&version](const std::string& robot) { return robot + version; };
  const std::string twice = R"({"service": "echo", "robot": "lwr4"}, {"service": "echo", "robot": "lwr4"})";
  {
    Jobs jobs(trial.options);
    ASSERT_TRUE(jobs.store(chain_of("j", twice)).ok());
    EXPECT_EQ(reply_of(jobs, "j")["steps"].size(), 2u);
    EXPECT_EQ(trial.log(), "j/0\n");
  }
  version = "2";
  Jobs jobs(trial.options);
  ASSERT_TRUE(jobs.store(chain_of("k", twice)).ok());
  EXPECT_EQ(reply_of(jobs, "k")["steps"].size(), 2u);
  EXPECT_EQ(trial.log(), "j/0\nk/0\n");
}

TEST(ChainJobs, LoseNoStepWhenTheProcessIsKilled) {
  const ChainTrial trial("chains");
  const std::string steps = R"({"name": "a", "service": "echo", "robot": "lwr4"},
    {"name": "b", "service": "echo", "robot": "lwr4", "clear_of": {}, "x": "$a/of/service"},
    {"name": "c", "service": "gate", "robot": "lwr4", "x": "$b/of/x"})";
  const pid_t child = fork();
  if (child == 0) {
    Jobs jobs(trial.options);
    jobs.store(chain_of("j", steps));
    for (;;) pause();
  }
  EXPECT_TRUE(within_patience([&] { return trial.log() == "j/0\nj/1\nj/2\n"; }));
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  trial.open_gate();
  Jobs jobs(trial.options);
  const Json reply = reply_of(jobs, "j");
  EXPECT_EQ(reply["steps"][2]["reply"]["of"]["x"], "echo");
  EXPECT_EQ(trial.log(),
            "j/0\nj/1\nj/2\nj/2\n");  // also of the step that depends on a scene, which other jobs would compute again
  EXPECT_EQ(results_of(jobs, "j").size(), 4u);
}

TEST(ChainJobs, EndWithOneCommandOrLimit) {
  const ChainTrial trial("chains");
  Jobs jobs(trial.options);
  const std::string steps =
      R"({"service": "echo", "robot": "lwr4"}, {"service": "gate", "robot": "lwr4"}, {"service": "echo", "robot": "ur5"})";
  ASSERT_TRUE(jobs.store(chain_of("j", steps)).ok());
  ASSERT_TRUE(within_patience([&] { return trial.log() == "j/0\nj/1\n"; }));
  EXPECT_TRUE(within_patience([&] { return jobs.find("j")->progress > 0.33; }));
  ASSERT_TRUE(jobs.command("j", JobVerb::kPause).ok());
  trial.open_gate();
  EXPECT_EQ(jobs.find("j")->state, JobState::kInterrupted);
  ASSERT_TRUE(jobs.command("j", JobVerb::kAbort).ok());
  EXPECT_EQ(done(jobs, "j").state, JobState::kAborted);
  EXPECT_EQ(results_of(jobs, "j").size(), 1u);  // what was answered is kept
  ASSERT_TRUE(jobs.store(order_of("after", "echo", R"("n": 1)")).ok());
  EXPECT_EQ(done(jobs, "after").result, JobResult::kSuccessful);
  EXPECT_EQ(trial.log(), "j/0\nj/1\nafter\n");
  JobOrder limited = chain_of("limited", R"({"service": "echo", "robot": "lwr4"}, {"service": "hang", "robot": "lwr4"})");
  limited.time_limit_s = 0.3;
  ASSERT_TRUE(jobs.store(limited).ok());
  const Job job = done(jobs, "limited");
  EXPECT_EQ(job.state, JobState::kAborted);
  EXPECT_THAT(job.reason, HasSubstr("longer than its limit of 0.3 s"));
}

TEST(ChainJobs, TellWhichStepFailed) {
  const ChainTrial trial("chains");
  Jobs jobs(trial.options);
  const auto problem_of = [&](const std::string& id, const std::string& steps) {
    EXPECT_TRUE(jobs.store(chain_of(id, steps)).ok());
    const Job job = done(jobs, id);
    EXPECT_EQ(job.state, JobState::kEnded);
    EXPECT_EQ(job.result, JobResult::kUnsuccessful);
    const Json problem = Json::parse(job.problem);
    EXPECT_EQ(job.reason, problem["detail"]);
    return problem["pointer"].get<std::string>() + ": " + problem["detail"].get<std::string>();
  };
  EXPECT_EQ(
      problem_of("a", R"({"service": "echo", "robot": "lwr4"}, {"name": "no", "service": "refuse"}, {"service": "echo"})"),
      "/steps/1/T_s: step 'no': T_s is 0; not asked after it: '3'");
  EXPECT_EQ(problem_of("b", R"({"service": "echo"}, {"service": "echo", "x": "$1/of/y"})"),
            "/steps/1/x: step '2': takes '/of/y' of the step '1', which did not answer that");
  EXPECT_EQ(trial.log(), "a/0\na/1\nb/0\n");
  // A worker that is lost costs a retry of the job; without one left the chain ends.
  ASSERT_TRUE(jobs.store(chain_of("c", R"({"service": "echo", "n": 3}, {"service": "crash_once"})")).ok());
  EXPECT_EQ(done(jobs, "c").result, JobResult::kSuccessful);
  EXPECT_EQ(jobs.find("c")->retries, 1);
  ASSERT_TRUE(jobs.store(chain_of("d", R"({"service": "echo", "n": 3}, {"service": "crash"})")).ok());
  EXPECT_EQ(done(jobs, "d").state, JobState::kAborted);
  EXPECT_EQ(trial.log(), "a/0\na/1\nb/0\nc/0\nc/1\nc/1\nd/1\nd/1\n");
}

// A second line of a worker is not taken for the answer to the next step.
TEST(ChainJobs, TakeNoAnswerTwice) {
  const ChainTrial trial("chains");
  Jobs jobs(trial.options);
  ASSERT_TRUE(
      jobs.store(chain_of("j", R"({"service": "twice", "n": 1}, {"service": "echo", "n": 2}, {"service": "last", "n": 3},
                                         {"service": "echo", "n": 4})"))
          .ok());
  const Json reply = reply_of(jobs, "j");
  for (int k = 0; k < 4; ++k) EXPECT_EQ(reply["steps"][static_cast<std::size_t>(k)]["reply"]["of"]["n"], k + 1);
}

TEST(ChainJobs, AreRefusedWithoutTheirFunctions) {
  const Trial trial("chains");
  Jobs jobs(trial.options);
  const JobReply reply = jobs.store(chain_of("j", kThree));
  EXPECT_EQ(reply.status, kInvalidRequest);
  EXPECT_THAT(reply.message, HasSubstr("/steps: is given, but this queue has no chains"));
}

// A key stands for what a client sent, also where the gateway adds what is different each time.
TEST(ChainJobs, RepeatAnOrderByItsKeyWhateverWasAdded) {
  const ChainTrial trial("chains");
  Jobs jobs(trial.options);
  const auto store = [&](const std::string& asked, int added) {
    JobOrder order = order_of("", "echo", R"("deadline_s": )" + std::to_string(added));
    order.asked = asked;
    return jobs.store(order, {.start = true, .idempotency_key = "key", .owner = "", .comment = {}});
  };
  const JobReply first = store(R"({"goal": "fastest"})", 1), again = store(R"({"goal":"fastest"})", 2);
  EXPECT_TRUE(first.ok() && again.ok() && again.repeated);
  EXPECT_EQ(first.id, again.id);
  EXPECT_EQ(store(R"({"goal": "safe"})", 1).status, kKeyOfAnotherRequest);
}

}  // namespace
}  // namespace cotwin::gateway::testing::chains_test
