// Orders, verbs, states and results of the gateway's jobs (OPC 10031-4).
#include "components/gateway/jobs/jobs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

#include "models/foundation/support/error.h"
#include "tests/components/gateway/jobs_trial.h"
#include "tests/support/error_of.h"

namespace cotwin::gateway::testing::jobs_test {
namespace {

using namespace std::chrono_literals;

TEST(Jobs, ReplyWithTheBytesOfTheWorker) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  const JobReply stored = jobs.store(order_of("a", "echo", R"("x": 1)"));
  ASSERT_TRUE(stored.ok()) << stored.message;
  const Job job = done(jobs, "a");
  EXPECT_EQ(job.state, JobState::kEnded);
  EXPECT_EQ(job.result, JobResult::kSuccessful) << job.reason;
  EXPECT_EQ(job.service, "echo");
  EXPECT_EQ(job.robot, "lwr4");
  EXPECT_EQ(job.progress, 1);
  ASSERT_TRUE(job.result_number);
  // The worker writes a blank after the colon: the bytes of its reply are kept, not only its value.
  EXPECT_EQ(jobs.result(*job.result_number)->reply, reply_to(R"({"robot":"lwr4","service":"echo","x":1})"));
  EXPECT_EQ(jobs.result(*job.result_number)->request, R"({"robot":"lwr4","service":"echo","x":1})");
}

// A reply is a result, whatever its light; a light that is worse than required aborts the job, also where an earlier result is taken.
TEST(Jobs, HaveTheLightOfTheirReplyAndAbortWhereItIsNotTheRequiredOne) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  for (const std::string id : {"a", "b"}) {
    for (const auto& [name, request] : {std::pair{"red", order_of("red_" + id, "red")},
                                        std::pair{"unmet", order_of("unmet_" + id, "red", R"("require": "amber")")},
                                        std::pair{"green", order_of("green_" + id, "echo", R"("require": "green")")}}) {
      ASSERT_TRUE(jobs.store(request).ok());
      const Job job = done(jobs, request.id);
      const bool unmet = std::string(name) == "unmet";
      EXPECT_EQ(job.light, std::string(name) == "green" ? "green" : "red") << job.order.id;
      EXPECT_EQ(job.state, unmet ? JobState::kAborted : JobState::kEnded);
      EXPECT_EQ(job.result, unmet ? JobResult::kUnsuccessful : JobResult::kSuccessful);
      if (unmet) {
        EXPECT_EQ(job.reason, "It cannot.");
      }
      ASSERT_TRUE(job.result_number);
      EXPECT_EQ(jobs.result(*job.result_number)->reused, id == "b");
    }
  }
}

TEST(Jobs, MakeIdentifiersThatDiffer) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  std::set<std::string> ids;
  for (int i = 0; i < 50; ++i)
    ids.insert(jobs.store(order_of("", "echo"), {.start = false, .idempotency_key = "", .owner = "", .comment = {}}).id);
  EXPECT_EQ(ids.size(), 50u);
  for (const std::string& id : ids) EXPECT_TRUE(jobs.find(id)) << id;
}

// The table of verbs in OPC 10031-4: each verb from each state that can be held.
TEST(Jobs, AllowEachVerbOnlyInItsStates) {
  const Trial trial("jobs");
  JobsOptions options = trial.options;
  options.workers = 4;
  struct Row {
    JobVerb verb;
    std::vector<int> from;
    int to;  // 0: removed
  };
  const std::vector<Row> table = {{JobVerb::kStart, {1}, 2},     {JobVerb::kRevokeStart, {2}, 1},
                                  {JobVerb::kPause, {3}, 4},     {JobVerb::kResume, {4}, 3},
                                  {JobVerb::kStop, {3, 4}, 5},   {JobVerb::kAbort, {1, 2, 3, 4}, 6},
                                  {JobVerb::kCancel, {1, 2}, 0}, {JobVerb::kClear, {5, 6}, 0}};
  Jobs jobs(options);
  int n = 0;
  for (const Row& row : table) {
    for (int from = 1; from <= 6; ++from) {
      const std::string id = "job" + std::to_string(++n);
      JobOrder order = order_of(id, "gate", "\"n\": " + std::to_string(n));
      if (from == 2) order.start_time = std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now()) + 1h;
      ASSERT_TRUE(jobs.store(order, {.start = from != 1, .idempotency_key = "", .owner = "", .comment = {}}).ok());
      if (from >= 3) {
        ASSERT_TRUE(reaches(jobs, id, JobState::kRunning));
      }
      if (from == 4) {
        ASSERT_TRUE(jobs.command(id, JobVerb::kPause).ok());
      }
      if (from == 5) {
        ASSERT_TRUE(jobs.command(id, JobVerb::kStop).ok());
      }
      if (from == 6) {
        ASSERT_TRUE(jobs.command(id, JobVerb::kAbort).ok());
      }
      ASSERT_EQ(static_cast<int>(jobs.find(id)->state), from);
      const bool allowed = std::find(row.from.begin(), row.from.end(), from) != row.from.end();
      const std::int64_t before = jobs.find(id)->version;
      const JobReply reply = jobs.command(id, row.verb, {{"en", "trial"}});
      EXPECT_EQ(reply.status, allowed ? kNoError : kInvalidJobOrderStatus) << to_text(row.verb) << " from " << from;
      const auto job = jobs.find(id);
      if (!allowed) {
        EXPECT_EQ(job->version, before);
        EXPECT_NE(reply.message.find(to_text(static_cast<JobState>(from))), std::string::npos) << reply.message;
      } else if (row.to == 0) {
        EXPECT_FALSE(job);
      } else if (!(row.verb == JobVerb::kStart)) {  // Start: a worker may have it already
        EXPECT_EQ(static_cast<int>(job->state), row.to) << to_text(row.verb) << " from " << from;
        EXPECT_GT(job->version, before);
        EXPECT_EQ(job->comment.at(0).text, "trial");
      }
      jobs.command(id, JobVerb::kAbort);
    }
  }
  EXPECT_EQ(jobs.command("nobody", JobVerb::kStart).status, kUnknownJobOrder);
  EXPECT_EQ(jobs.remove("nobody").status, kUnknownJobOrder);
}

TEST(Jobs, RunByPriorityThenDeadlineThenArrival) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  jobs.store(order_of("first", "gate"));
  ASSERT_TRUE(reaches(jobs, "first", JobState::kRunning));
  const UtcTime later = std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now()) + 24h;
  const auto store = [&](const char* id, int priority, std::optional<UtcTime> deadline) {
    JobOrder order = order_of(id, "echo", "\"id\": \"" + std::string(id) + "\"");
    order.priority = static_cast<std::int16_t>(priority);
    order.deadline = deadline;
    ASSERT_TRUE(jobs.store(order).ok());
  };
  store("e", 0, {});
  store("f", 0, {});
  store("d", 0, later);
  store("c", 0, later - 1h);
  store("g", -7, later - 2h);
  store("a", 32767, {});
  store("b", 5, {});
  trial.open_gate();
  EXPECT_EQ(done(jobs, "g").state, JobState::kEnded);
  EXPECT_EQ(trial.log(), "first\na\nb\nc\nd\ne\nf\ng\n");
}

TEST(Jobs, AbortWhatIsNotDoneByItsDeadline) {
  const Trial trial("jobs");
  JobsOptions options = trial.options;
  std::atomic<std::int64_t> clock = 1'700'000'000'000;  // ms
  options.now = [&] { return UtcTime(std::chrono::milliseconds(clock.load())); };
  Jobs jobs(options);
  const auto store = [&](const char* id, const char* service, std::int64_t ms, bool start) {
    JobOrder order = order_of(id, service, "\"id\": \"" + std::string(id) + "\"");
    order.deadline = options.now() + std::chrono::milliseconds(ms);
    return jobs.store(order, {.start = start, .idempotency_key = "", .owner = "", .comment = {}});
  };
  EXPECT_EQ(store("past", "echo", -1, true).status, kInvalidRequest);
  EXPECT_EQ(store("now", "echo", 0, true).status, kInvalidRequest);
  ASSERT_TRUE(store("running", "gate", 60'000, true).ok());
  ASSERT_TRUE(reaches(jobs, "running", JobState::kRunning));
  ASSERT_TRUE(store("waiting", "echo", 60'000, true).ok());
  ASSERT_TRUE(store("held", "echo", 60'000, false).ok());
  ASSERT_TRUE(store("later", "echo", 7'200'000, true).ok());
  clock += 3'600'000;  // the clock steps by an hour: no timer was set for that
  for (const char* id : {"running", "waiting", "held"}) {
    const Job job = done(jobs, id);
    EXPECT_EQ(job.state, JobState::kAborted) << id;
    EXPECT_EQ(job.result, JobResult::kUnsuccessful);
    EXPECT_NE(job.reason.find("the deadline 2023-11-14T22:14:20.000Z has passed"), std::string::npos) << job.reason;
  }
  EXPECT_EQ(done(jobs, "later").result, JobResult::kSuccessful);  // the worker of "running" was killed: there is room
  EXPECT_EQ(trial.log().find("waiting"), std::string::npos);
}

TEST(Jobs, StartNotBeforeTheirStartTimeAlsoIfTheClockStepsBack) {
  const Trial trial("jobs");
  JobsOptions options = trial.options;
  std::atomic<std::int64_t> clock = 1'700'000'000'000;
  options.now = [&] { return UtcTime(std::chrono::milliseconds(clock.load())); };
  Jobs jobs(options);
  JobOrder order = order_of("later", "echo");
  order.start_time = options.now() + 1h;
  ASSERT_TRUE(jobs.store(order).ok());
  clock -= 86'400'000;
  EXPECT_EQ(jobs.wait("later", 0.3)->state, JobState::kAllowedToStart);
  clock += 2 * 86'400'000;
  EXPECT_EQ(done(jobs, "later").state, JobState::kEnded);
}

TEST(Jobs, TakeAKeyOnce) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  const StoreOptions key{.start = true, .idempotency_key = "k1", .owner = "mes", .comment = {}};
  const JobReply first = jobs.store(order_of("", "echo", "\"x\": 1"), key);
  ASSERT_TRUE(first.ok());
  EXPECT_FALSE(first.repeated);
  const JobReply again = jobs.store(order_of("", "echo", "\"x\": 1.0"), key);  // the same number
  EXPECT_TRUE(again.ok());
  EXPECT_TRUE(again.repeated);
  EXPECT_EQ(again.id, first.id);
  EXPECT_EQ(jobs.store(order_of("", "echo", "\"x\": 2"), key).status, kKeyOfAnotherRequest);
  JobOrder urgent = order_of("", "echo", "\"x\": 1");
  urgent.priority = 1;
  EXPECT_EQ(jobs.store(urgent, key).status, kKeyOfAnotherRequest);
  StoreOptions other = key;
  other.owner = "planner";  // keys of different clients do not meet
  EXPECT_NE(jobs.store(order_of("", "echo", "\"x\": 2"), other).id, first.id);
  done(jobs, first.id);
  ASSERT_TRUE(jobs.remove(first.id).ok());
  EXPECT_TRUE(jobs.store(order_of("", "echo", "\"x\": 1"), key).repeated);  // keys outlive Clear
  EXPECT_FALSE(jobs.find(first.id));
}

TEST(Jobs, KeepIdentifiersReservedAfterClear) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  ASSERT_TRUE(jobs.store(order_of("a", "echo")).ok());
  EXPECT_EQ(jobs.store(order_of("a", "echo")).status, kInvalidJobOrderStatus);
  const auto number = done(jobs, "a").result_number;
  ASSERT_TRUE(jobs.remove("a").ok());
  EXPECT_FALSE(jobs.find("a"));
  EXPECT_EQ(jobs.store(order_of("a", "echo")).status, kInvalidJobOrderStatus);
  EXPECT_EQ(jobs.list({}).jobs.size(), 0u);
  EXPECT_TRUE(jobs.result(*number));  // results are kept longer than job orders
}

TEST(Jobs, UpdateOnlyWhatHasNotStartedAndOnlyTheGivenVersion) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  jobs.store(order_of("first", "gate"));
  ASSERT_TRUE(reaches(jobs, "first", JobState::kRunning));
  jobs.store(order_of("a", "echo", "\"x\": 1"));
  const std::int64_t version = jobs.find("a")->version;
  JobOrder better = order_of("a", "refuse", "\"x\": 2");
  better.priority = 3;
  EXPECT_EQ(jobs.update(better, version + 1).status, kVersionChanged);
  ASSERT_TRUE(jobs.update(better, version).ok());
  EXPECT_EQ(jobs.update(better, version).status, kVersionChanged);
  const Job changed = *jobs.find("a");
  EXPECT_EQ(changed.state, JobState::kAllowedToStart);
  EXPECT_EQ(changed.order.priority, 3);
  EXPECT_EQ(changed.service, "refuse");
  EXPECT_EQ(jobs.update(order_of("first", "echo")).status, kInvalidJobOrderStatus);
  EXPECT_EQ(jobs.update(order_of("nobody", "echo")).status, kUnknownJobOrder);
  trial.open_gate();
  const Job refused = done(jobs, "a");
  EXPECT_EQ(refused.state, JobState::kEnded);
  EXPECT_EQ(refused.result, JobResult::kUnsuccessful);
  EXPECT_EQ(refused.problem, R"({"title":"No","detail":"T_s is 0","pointer":"/T_s"})");
  EXPECT_EQ(refused.reason, "T_s is 0");
}

TEST(Jobs, RefuseOrdersThatCannotBeRun) {
  const Trial trial("jobs");
  JobsOptions options = trial.options;
  options.robot_hash = [](const std::string& robot) -> std::string {
    if (robot != "lwr4") throw Error("/robot", "is '" + robot + "', expected lwr4");
    return "1";
  };
  options.most_request = 1000;
  Jobs jobs(options);
  const auto refusal = [&](const std::string& id, const std::string& request) {
    JobOrder order;
    order.id = id;
    order.request = request;
    const JobReply reply = jobs.store(order);
    EXPECT_EQ(reply.status, kInvalidRequest) << id << " " << request;
    return reply.message;
  };
  EXPECT_EQ(refusal("a", R"({"service": "echo", "robot": "kr210"})"), "/robot: is 'kr210', expected lwr4");
  EXPECT_EQ(refusal("a", R"({"robot": "lwr4"})"), "/service: is missing, expected it in the request");
  EXPECT_EQ(refusal("a", R"({"service": 3})"), "/service: is of type number, expected a string");
  EXPECT_EQ(refusal("a", "[1]"), "/: is of type array, expected an object");
  EXPECT_NE(refusal("a", R"({"service": "echo", "x": NaN})").find("is not JSON"), std::string::npos);
  EXPECT_NE(refusal("a", "").find("is not JSON"), std::string::npos);
  EXPECT_NE(refusal("a", R"({"service": "echo", "x": 1, "x": 2})").find("has the member 'x' twice"), std::string::npos);
  EXPECT_NE(refusal("a", "{\"service\": \"echo\", \"x\": \"\xff\"}").find("is not JSON"), std::string::npos);
  EXPECT_NE(refusal("a", std::string(400, '[')).find("nested deeper than 32"), std::string::npos);
  EXPECT_NE(refusal("a", std::string(1001, ' ')).find("1001 bytes, expected at most 1000"), std::string::npos);
  for (const char* id : {"a/b", ".", "..", "a b", "\n", "ä"})
    EXPECT_NE(refusal(id, R"({"service": "echo"})").find("identifier"), std::string::npos);
  refusal(std::string(201, 'a'), R"({"service": "echo"})");
  JobOrder order = order_of("a", "echo");
  order.time_limit_s = std::nan("");
  EXPECT_EQ(jobs.store(order).status, kInvalidRequest);
  order = order_of("a", "echo");
  order.deadline = UtcTime(std::chrono::milliseconds(std::numeric_limits<std::int64_t>::max()));
  EXPECT_EQ(jobs.store(order).status, kInvalidRequest);
  EXPECT_EQ(jobs.list({}).jobs.size(), 0u);
}

TEST(Jobs, AcceptNoMoreThanTheirLimit) {
  const Trial trial("jobs");
  JobsOptions options = trial.options;
  options.most_jobs = 3;
  Jobs jobs(options);
  for (const char* id : {"a", "b", "c"}) ASSERT_TRUE(jobs.store(order_of(id, "gate")).ok());
  EXPECT_EQ(jobs.store(order_of("d", "gate")).status, kUnableToAccept);
  ASSERT_TRUE(jobs.command("b", JobVerb::kAbort).ok());
  EXPECT_TRUE(jobs.store(order_of("d", "gate")).ok());
}

TEST(Jobs, TakeAnEarlierResultOfTheSameRequestRobotAndBuild) {
  Trial trial("jobs");
  std::string files = "first";
  trial.options.robot_hash = [&](const std::string&) { return files; };
  const auto reply_of = [&](Jobs& jobs, const JobOrder& order) {
    jobs.store(order);
    const Job job = done(jobs, order.id);
    EXPECT_EQ(job.result, JobResult::kSuccessful) << job.reason;
    return jobs.result(job.result_number.value_or(0)).value_or(Result{});
  };
  {
    Jobs jobs(trial.options);
    const Result first = reply_of(jobs, order_of("a", "random", R"("x": 1, "y": 2)"));
    EXPECT_FALSE(first.reused);
    const Result again = reply_of(jobs, order_of("b", "random", R"("y": 2.0, "x": 1e0)"));
    EXPECT_TRUE(again.reused);
    EXPECT_EQ(again.reply, first.reply);
    EXPECT_NE(reply_of(jobs, order_of("c", "random", R"("x": 1, "y": 3)")).reply, first.reply);
    JobOrder fresh = order_of("d", "random", R"("x": 1, "y": 2)");
    fresh.reuse = false;
    EXPECT_EQ(jobs.status().differing_replies, 0u);
    EXPECT_NE(reply_of(jobs, fresh).reply, first.reply);
    EXPECT_EQ(jobs.status().differing_replies, 1u);  // this service is not deterministic: that is counted
    EXPECT_EQ(reply_of(jobs, order_of("e", "random", R"("x": 1, "y": 2)")).reply, first.reply);
  }
  files = "second";  // other files of the robot: read by a new worker
  Jobs jobs(trial.options);
  EXPECT_FALSE(reply_of(jobs, order_of("f", "random", R"("x": 1, "y": 2)")).reused);
  EXPECT_TRUE(reply_of(jobs, order_of("g", "random", R"("x": 1, "y": 2)")).reused);
  // A scene may have changed, of which the hash of the robot's files knows nothing.
  for (const char* id : {"h", "i"})
    EXPECT_FALSE(reply_of(jobs, order_of(id, "random", R"("clear_of": {"scene": "table"}, "x": 1)")).reused) << id;
}

TEST(Jobs, TakeAnEarlierResultNotBeforeTheirStartTime) {
  Trial trial("jobs");
  std::atomic<std::int64_t> clock = 1'700'000'000'000;
  trial.options.now = [&] { return UtcTime(std::chrono::milliseconds(clock.load())); };
  trial.options.robot_hash = [](const std::string&) { return "files"; };
  Jobs jobs(trial.options);
  jobs.store(order_of("a", "echo"));
  EXPECT_EQ(done(jobs, "a").state, JobState::kEnded);
  JobOrder order = order_of("later", "echo");
  order.start_time = trial.options.now() + 1h;
  ASSERT_TRUE(jobs.store(order).ok());
  EXPECT_EQ(jobs.find("later")->state, JobState::kAllowedToStart);
  EXPECT_FALSE(jobs.find("later")->started);
  clock += 3'600'000;
  const Job job = done(jobs, "later");
  EXPECT_EQ(job.state, JobState::kEnded);
  EXPECT_EQ(job.started, order.start_time);
  EXPECT_EQ(trial.log(), "a\n") << "it was not computed again";
}

TEST(Jobs, TakeNoEarlierResultIfTheDefaultRobotHasChanged) {
  Trial trial("jobs");
  std::string files = "first";  // of the robot that requests without a name are for
  trial.options.robot_hash = [&](const std::string& robot) { return robot.empty() ? files : "other"; };
  JobOrder order;
  order.request = R"({"service": "random"})";
  std::string replies[2];
  for (std::string& reply : replies) {
    Jobs jobs(trial.options);
    const auto number = done(jobs, jobs.store(order).id).result_number;
    ASSERT_TRUE(number);
    EXPECT_EQ(jobs.result(*number)->robot_hash, files);
    reply = jobs.result(*number)->reply;
    files = "second";
  }
  EXPECT_NE(replies[0], replies[1]);
}

TEST(Jobs, FindResultsByRequestRobotAndTime) {
  Trial trial("jobs");
  std::atomic<std::int64_t> clock = 1'700'000'000'000;
  trial.options.now = [&] { return UtcTime(std::chrono::milliseconds(clock.load())); };
  Jobs jobs(trial.options);
  for (int i = 0; i < 12; ++i) {
    JobOrder order;
    order.id = "j" + std::to_string(i);
    order.request = R"({"service":"echo","robot":")" + std::string(i % 2 == 0 ? "lwr4" : "kr210") + R"(","x":)" +
                    std::to_string(i / 2) + "}";
    clock += 1000;
    ASSERT_TRUE(jobs.store(order).ok());
    done(jobs, order.id);
  }
  const auto ids = [&](const ResultFilter& filter) {
    std::string all;
    for (const Result& result : jobs.results(filter).results) all += result.job_id + " ";
    return all;
  };
  ResultFilter filter;
  filter.robot = "kr210";
  EXPECT_EQ(ids(filter), "j11 j9 j7 j5 j3 j1 ");
  filter.stored_from = UtcTime(std::chrono::milliseconds(1'700'000'000'000 + 4000));
  filter.stored_before = *filter.stored_from + 5s;
  EXPECT_EQ(ids(filter), "j7 j5 j3 ");
  filter = {};
  filter.request = R"( {"x": 2e0, "service": "echo", "robot": "lwr4"} )";
  EXPECT_EQ(ids(filter), "j4 ");
  filter = {};
  filter.newest_first = false;
  filter.with_reply = true;
  std::string all, cursor;
  do {
    const ResultPage page = jobs.results(filter, cursor, 5);
    for (const Result& result : page.results) {
      all += result.job_id + " ";
      EXPECT_EQ(result.reply, reply_to(result.request));
    }
    cursor = page.next;
  } while (!cursor.empty());
  EXPECT_EQ(all, "j0 j1 j2 j3 j4 j5 j6 j7 j8 j9 j10 j11 ");
  filter.request = "{";
  EXPECT_THROW(jobs.results(filter), Error);
  filter = {};
  filter.robot = "nobody' OR '1'='1";
  EXPECT_EQ(ids(filter), "");
}

TEST(Jobs, KeepResultsUntilTheyAreReadOrCleared) {
  Trial trial("jobs");
  std::atomic<std::int64_t> clock = 1'700'000'000'000;
  trial.options.now = [&] { return UtcTime(std::chrono::milliseconds(clock.load())); };
  trial.options.most_results = 5;
  Jobs jobs(trial.options);
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(jobs.store(order_of("j" + std::to_string(i), "echo", "\"x\": " + std::to_string(i))).ok());
    done(jobs, "j" + std::to_string(i));
  }
  clock += std::int64_t{200} * 86'400'000;  // older than all limits, too
  jobs.clean();
  EXPECT_EQ(jobs.results({}).results.size(), 5u);
  EXPECT_EQ(jobs.store(order_of("more", "echo")).status, kUnableToAccept);
  EXPECT_TRUE(jobs.response("j1")->read);
  jobs.remove("j3");
  jobs.clean();
  std::string left;
  for (const Result& result : jobs.results({}).results) left += result.job_id + " ";
  EXPECT_EQ(left, "j4 j2 j0 ");
  EXPECT_FALSE(jobs.find("j1"));  // the response was read, and it is old
  EXPECT_TRUE(jobs.store(order_of("more", "echo")).ok());
  EXPECT_EQ(jobs.store(order_of("j1", "echo")).status, kInvalidJobOrderStatus);
  clock += std::int64_t{31} * 86'400'000;
  jobs.clean();
  EXPECT_TRUE(jobs.store(order_of("j1", "echo")).ok());  // identifiers are free again after their time
}

TEST(Jobs, AreListedByCursorWhileOthersAreStored) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  constexpr int kJobs = 3000;
  const StoreOptions held{.start = false, .idempotency_key = "", .owner = "", .comment = {}};
  for (int i = 0; i < kJobs; ++i) ASSERT_TRUE(jobs.store(order_of("j" + std::to_string(i), "echo"), held).ok());
  for (const bool newest_first : {false, true}) {
    JobFilter filter;
    filter.newest_first = newest_first;
    filter.states = {JobState::kNotAllowedToStart, JobState::kNotAllowedToStart};
    std::string cursor;
    std::vector<std::string> seen;
    do {
      const JobPage page = jobs.list(filter, cursor, 700);
      for (const Job& job : page.jobs) seen.push_back(job.order.id);
      cursor = page.next;
      jobs.remove(page.jobs.front().order.id);  // the list changes meanwhile
      jobs.store(order_of("", "echo", "\"later\": true"), held);
    } while (!cursor.empty());
    EXPECT_EQ(std::set<std::string>(seen.begin(), seen.end()).size(), seen.size());
    EXPECT_GE(seen.size(), newest_first ? kJobs - 5u : kJobs + 0u);
  }
  for (const char* cursor : {"x", "a", "d", "a0", "a-1", "d 1", "a01", "a99999999999999999999"})
    EXPECT_THROW(jobs.list({}, cursor), Error) << cursor;
  EXPECT_THROW(jobs.list({}, "", 0), Error);
  EXPECT_THROW(jobs.list({}, "", 1001), Error);
}

TEST(Jobs, AreListedInPagesOfBoundedBytes) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  constexpr std::size_t kJobs = 24, kBytes = 900'000, kMost = (4 << 20) + (1 << 20);
  for (std::size_t i = 0; i < kJobs; ++i) {
    const std::string more = "\"i\": " + std::to_string(i) + ", \"x\": \"" + std::string(kBytes, 'x') + "\"";
    const std::string id = "j" + std::to_string(i);
    ASSERT_TRUE(
        jobs.store(order_of(id, "echo", more), {.start = false, .idempotency_key = "", .owner = "", .comment = {}}).ok());
  }
  std::size_t seen = 0, pages = 0;
  std::string cursor;
  do {
    const JobPage page = jobs.list({}, cursor, 1000);
    std::size_t bytes = 0;
    for (const Job& job : page.jobs) bytes += job.order.request.size();
    EXPECT_LE(bytes, kMost);
    seen += page.jobs.size();
    ++pages;
    cursor = page.next;
  } while (!cursor.empty());
  EXPECT_EQ(seen, kJobs);
  EXPECT_GE(pages, kJobs * kBytes / kMost);
}

TEST(Jobs, PassOnEveryChangeOfStateInOrder) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  std::mutex mutex;
  std::vector<JobChange> changes;
  const std::uint64_t number = jobs.subscribe([&](const JobChange& change) {
    const std::lock_guard lock(mutex);
    changes.push_back(change);
  });
  jobs.store(order_of("a", "progress"));
  ASSERT_TRUE(within_patience([&] { return jobs.find("a")->progress == 0.25; }));
  EXPECT_EQ(jobs.find("a")->progress_message, "a quarter");
  EXPECT_GT(jobs.find("a")->remaining_s, 0);
  trial.open_gate();
  done(jobs, "a");
  jobs.remove("a");
  const auto seen = [&] {
    const std::lock_guard lock(mutex);
    std::string text;
    for (const JobChange& change : changes)
      if (change.kind != JobChange::Kind::kProgress)
        text +=
            std::to_string(static_cast<int>(change.job.state)) + (change.kind == JobChange::Kind::kRemoved ? "-" : "") + " ";
    return text;
  };
  EXPECT_TRUE(within_patience([&] { return seen() == "2 3 5 5- "; })) << seen();
  const std::lock_guard lock(mutex);
  EXPECT_TRUE(std::is_sorted(changes.begin(), changes.end(),
                             [](const JobChange& a, const JobChange& b) { return a.job.version < b.job.version; }));
  EXPECT_EQ(changes[0].job.order.request, "");
  static_cast<void>(number);
}

TEST(Jobs, CallNoSubscriberAfterItsEnd) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  std::atomic<int> calls = 0;
  const std::uint64_t throwing = jobs.subscribe([](const JobChange&) { throw Error("a subscriber that fails"); });
  const std::uint64_t number = jobs.subscribe([&](const JobChange&) { ++calls; });
  jobs.store(order_of("a", "echo"));
  done(jobs, "a");
  EXPECT_TRUE(within_patience([&] { return calls >= 3; }));
  jobs.unsubscribe(number);
  jobs.unsubscribe(throwing);
  const int before = calls;
  jobs.store(order_of("b", "echo", "\"x\": 1"));
  done(jobs, "b");
  EXPECT_EQ(calls, before);
}

TEST(Jobs, MayBeUsedByManyThreads) {
  const Trial trial("jobs");
  JobsOptions options = trial.options;
  options.workers = 2;
  Jobs jobs(options);
  std::vector<std::thread> clients;
  for (int c = 0; c < 4; ++c) {
    clients.emplace_back([&jobs, c] {
      for (int i = 0; i < 10; ++i) {
        const std::string id = std::to_string(c) + "-" + std::to_string(i);
        EXPECT_TRUE(jobs.store(order_of(id, i % 3 == 2 ? "hang" : "echo", "\"id\": \"" + id + "\"")).ok());
        if (i % 3 == 2) {
          jobs.command(id, JobVerb::kPause);
          jobs.command(id, JobVerb::kResume);
          EXPECT_TRUE(jobs.command(id, JobVerb::kAbort).ok());
        }
        EXPECT_EQ(done(jobs, id).state, i % 3 == 2 ? JobState::kAborted : JobState::kEnded) << id;
        jobs.list({}, "", 10);
        jobs.status();
        EXPECT_TRUE(jobs.remove(id).ok());
      }
    });
  }
  for (std::thread& client : clients) client.join();
  EXPECT_EQ(jobs.status().lost_workers, 0u);
  EXPECT_EQ(jobs.list({}).jobs.size(), 0u);
}

TEST(Jobs, SayThatTheyAreClosed) {
  const Trial trial("jobs");
  Jobs jobs(trial.options);
  jobs.close();
  EXPECT_EQ(jobs.store(order_of("a", "echo")).status, kUnableToAccept);
  EXPECT_THROW(jobs.find("a"), Error);
}

TEST(Jobs, RefuseOptionsOutOfRange) {
  Trial trial("jobs");
  const auto refusal = [&](auto change) {
    JobsOptions options = trial.options;
    change(options);
    return cotwin::testing::error_of([&] { const Jobs jobs(options); });
  };
  EXPECT_NE(refusal([](JobsOptions& o) { o.workers = 0; }).find("workers is out of range, expected 1 to 256"),
            std::string::npos);
  EXPECT_NE(refusal([](JobsOptions& o) { o.command = {"sh"}; }).find("command"), std::string::npos);
  EXPECT_NE(refusal([](JobsOptions& o) { o.time_limit_s = -1; }).find("time_limit_s"), std::string::npos);
}

TEST(JobText, WritesAndReadsTimes) {
  using std::chrono::milliseconds;
  EXPECT_EQ(to_text(UtcTime(milliseconds(0))), "1970-01-01T00:00:00.000Z");
  EXPECT_EQ(to_text(UtcTime(milliseconds(951'782'400'123))), "2000-02-29T00:00:00.123Z");  // date -u -d @951782400
  EXPECT_EQ(time_of("2000-02-29T01:00:00.123+01:00"), UtcTime(milliseconds(951'782'400'123)));
  EXPECT_EQ(time_of("2000-02-28T18:30:00.1239-05:30"), UtcTime(milliseconds(951'782'400'123)));
  for (const char* text : {"", "2000", "2000-02-30T00:00:00Z", "2001-02-29T00:00:00Z", "2000-02-29T24:00:00Z",
                           "2000-02-29T00:00:00", "2000-02-29 00:00:00Z", "2000-02-29T00:00:00.Z", "2000-02-29T00:00:00Zx",
                           "20000-02-29T00:00:00Z", "-200-02-29T00:00:00Z", "2000-02-29T00:00:60Z", "1969-12-31T23:59:59Z",
                           "2000-02-29T00:00:00+1:00", "2000-02-29T00:00:00+24:00"})
    EXPECT_FALSE(time_of(text)) << text;
}

TEST(JobText, HasOneCanonicalFormOfEqualRequests) {
  EXPECT_EQ(canonical_json(R"( {"b" : [1.0, 2e0 , -0.0, 1e300], "a": {"y":null,"x":true} } )"),
            R"({"a":{"x":true,"y":null},"b":[1,2,-0.0,1e+300]})");
  EXPECT_EQ(canonical_json(R"({"a":"\u00e4"})"), canonical_json("{\"a\":\"ä\"}"));
  EXPECT_NE(canonical_json(R"({"a":1})"), canonical_json(R"({"a":1.0000000000000002})"));
  EXPECT_EQ(canonical_json(R"({"a":9007199254740993})"), R"({"a":9007199254740993})");  // 2^53 + 1 keeps its digits
}

}  // namespace
}  // namespace cotwin::gateway::testing::jobs_test
