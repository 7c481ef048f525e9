#include "components/gateway/jobs/jobs.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <utility>

#include "components/gateway/jobs/canonical.h"
#include "components/gateway/jobs/core.h"
#include "components/gateway/jobs/scheduler.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway {

namespace {

constexpr std::size_t kMostIdentifier = 200, kMostKey = 255, kMostPage = 1000;
constexpr std::size_t kMostTexts = 64, kMostText = 4096;  // of descriptions and comments
constexpr double kLongest_s = 1e6;                        // of running and of waiting

void check(bool good, const std::string& option, const std::string& expected) {
  if (!good) throw Error("jobs", option + " is out of range, expected " + expected);
}

JobsOptions checked(JobsOptions options) {
  check(!options.database.empty(), "database", "a file");
  check(!options.command.empty() && options.command[0].starts_with('/'), "command",
        "an absolute path of a program and arguments");
  check(options.workers >= 1 && options.workers <= 256, "workers", "1 to 256");
  check(options.paused >= 0 && options.paused <= 256, "paused", "0 to 256");
  check(options.nice >= 0 && options.nice <= 19, "nice", "0 to 19");
  check(options.line >= 1000, "line", "at least 1000 bytes");
  check(options.retries >= 0 && options.restarts >= 0, "retries or restarts", "at least 0");
  check(options.time_limit_s > 0 && options.time_limit_s <= kLongest_s, "time_limit_s", "0 to 1e6 s");
  check(options.back_off_s > 0 && options.back_off_s <= 30, "back_off_s", "0 to 30 s");
  check(options.result_days >= 0 && options.identifier_days >= 0, "result_days or identifier_days", "at least 0");
  check(options.most_jobs > 0 && options.most_results > 0 && options.most_result_bytes > 0, "a limit", "at least 1");
  options.database = std::filesystem::weakly_canonical(options.database);
  return options;
}

bool is_identifier(const std::string& id) {
  return !id.empty() && id.size() <= kMostIdentifier && id != "." && id != ".." &&
         std::all_of(id.begin(), id.end(), [](char c) { return c > ' ' && c <= '~' && c != '/'; });
}

std::optional<std::string> flaw_of(const std::vector<LocalizedText>& texts, const char* what) {
  if (texts.size() > kMostTexts) return std::string(what) + " has more than " + std::to_string(kMostTexts) + " texts";
  for (const LocalizedText& text : texts) {
    if (text.text.size() > kMostText || text.locale.size() > kMostText)
      return std::string(what) + " has a text of more than " + std::to_string(kMostText) + " bytes";
  }
  return std::nullopt;
}

/// What is wrong with an order; nullopt: nothing that can be seen without the store.
std::optional<std::string> flaw_of(const JobOrder& order, std::uint64_t most_request) {
  if (!order.id.empty() && !is_identifier(order.id))
    return "the identifier is not of 1 to " + std::to_string(kMostIdentifier) +
           " printable ASCII characters without blanks and '/'";
  if (order.request.size() > most_request)
    return "the request has " + std::to_string(order.request.size()) + " bytes, expected at most " +
           std::to_string(most_request);
  if (!(order.time_limit_s >= 0 && order.time_limit_s <= kLongest_s)) return "the time limit is not from 0 to 1e6 s";
  const UtcTime latest = *time_of("9999-12-31T23:59:59.999Z");
  for (const auto& time : {order.start_time, order.end_time, order.deadline}) {
    if (time && (*time < UtcTime() || *time > latest)) return "a time is not in the years 1970 to 9999";
  }
  if (order.start_time && order.deadline && *order.start_time >= *order.deadline)
    return "the start time " + to_text(*order.start_time) + " is not before the deadline " + to_text(*order.deadline);
  return flaw_of(order.description, "the description");
}

std::size_t checked_limit(std::size_t limit) {
  if (limit < 1 || limit > kMostPage) throw Error("limit", "is not from 1 to " + std::to_string(kMostPage));
  return limit;
}

}  // namespace

struct Jobs::Impl {
  explicit Impl(JobsOptions options) : core(std::move(options)) {}

  JobReply refused(ReturnStatus status, const std::string& id, const std::string& message) const {
    return {status, id, message, false};
  }
  void must_be_open() const {
    if (closed) throw Unavailable("jobs", "the queue is closed");
  }
  /// Runs a verb with the mutex; a database that cannot be written is a reply.
  template <class Verb>
  JobReply change(const std::string& id, Verb verb) {
    const std::lock_guard lock(core.mutex);
    if (closed) return refused(kUnableToAccept, id, "the queue is closed");
    try {
      return verb();
    } catch (const DatabaseError& error) {
      core.database_trouble = error.what();
      return refused(kUnableToAccept, id, std::string("the job database cannot be written: ") + error.what());
    }
  }
  JobReply command(const std::string& id, JobVerb verb, const std::vector<LocalizedText>& comment);
  JobReply remove(Job& job, const char* reason) {
    core.store.remove(job, reason, core.now());
    core.publish(JobChange::Kind::kRemoved, job);
    return {kNoError, job.order.id, "", false};
  }

  JobsCore core;
  Scheduler scheduler{core};
  bool closed = false;
};

Jobs::Jobs(JobsOptions options) : impl_(std::make_unique<Impl>(checked(std::move(options)))) {}

Jobs::~Jobs() { close(); }

void Jobs::close() {
  impl_->scheduler.close();
  {
    const std::lock_guard lock(impl_->core.mutex);
    try {
      if (!std::exchange(impl_->closed, true)) impl_->core.store.close();
    } catch (const DatabaseError&) {
      // The next start counts this end as one of those that the jobs may have caused.
    }
    impl_->core.done.notify_all();
  }
  impl_->core.notifier.close();
}

JobReply Jobs::store(const JobOrder& order, const StoreOptions& options) {
  const auto invalid = [&](const std::string& why) { return impl_->refused(kInvalidRequest, order.id, why); };
  if (const auto flaw = flaw_of(order, impl_->core.options.most_request)) return invalid(*flaw);
  if (const auto flaw = flaw_of(options.comment, "the comment")) return invalid(*flaw);
  if (options.idempotency_key.size() > kMostKey)
    return invalid("the idempotency key has more than " + std::to_string(kMostKey) + " characters");
  CanonicalRequest request;
  std::optional<Origin> origin;
  try {
    request = canonical_request(order.request);
    origin = impl_->core.origin_of(request);
  } catch (const Error& error) {
    return invalid(error.what());
  }
  JobOrder stored = order;
  stored.reuse = order.reuse && (request.service == kChain || !request.reads_more);
  JobReply reply = impl_->change(order.id, [&] {
    JobStore::Insertion insertion = impl_->core.store.insert(stored, request, options, origin, impl_->core.now());
    if (insertion.job) impl_->core.publish(JobChange::Kind::kState, *insertion.job);
    return insertion.reply;
  });
  if (reply.ok()) impl_->scheduler.wake();
  return reply;
}

JobReply Jobs::update(const JobOrder& order, std::optional<std::int64_t> version, const std::vector<LocalizedText>& comment) {
  JobsCore& core = impl_->core;
  const auto refused = [&](ReturnStatus status, const std::string& why) { return impl_->refused(status, order.id, why); };
  if (const auto flaw = flaw_of(order, core.options.most_request)) return refused(kInvalidRequest, *flaw);
  if (const auto flaw = flaw_of(comment, "the comment")) return refused(kInvalidRequest, *flaw);
  CanonicalRequest request;
  try {
    request = canonical_request(order.request);
    static_cast<void>(core.origin_of(request));
  } catch (const Error& error) {
    return refused(kInvalidRequest, error.what());
  }
  JobReply reply = impl_->change(order.id, [&] {
    auto job = core.store.find(order.id);
    if (!job) return refused(kUnknownJobOrder, "no job order has this identifier");
    if (version && *version != job->version)
      return refused(kVersionChanged,
                     "the job order has version " + std::to_string(job->version) + ", expected " + std::to_string(*version));
    if (job->state != JobState::kNotAllowedToStart && job->state != JobState::kAllowedToStart)
      return refused(kInvalidJobOrderStatus,
                     "the job is " + std::string(to_text(job->state)) + ", expected NotAllowedToStart or AllowedToStart");
    const UtcTime now = core.now();
    if (order.deadline && *order.deadline <= now)
      return refused(kInvalidRequest, "the deadline " + to_text(*order.deadline) + " has passed: it is " + to_text(now));
    job->order = order;
    job->order.request = request.text;
    job->order.reuse = order.reuse && (request.service == kChain || !request.reads_more);
    job->request_hash = request.hash;
    job->service = request.service;
    job->robot = request.robot;
    job->comment = comment;
    job->reason = "updated";
    core.store.save(*job, true);
    core.publish(JobChange::Kind::kOrder, *job);
    return JobReply{kNoError, order.id, "", false};
  });
  if (reply.ok()) impl_->scheduler.wake();
  return reply;
}

JobReply Jobs::Impl::command(const std::string& id, JobVerb verb, const std::vector<LocalizedText>& comment) {
  auto job = core.store.find(id);
  if (!job) return refused(kUnknownJobOrder, id, "no job order has this identifier");
  using enum JobState;
  const JobState from = job->state;
  const auto is = [&](std::initializer_list<JobState> states) {
    return std::find(states.begin(), states.end(), from) != states.end();
  };
  const auto not_allowed = [&](const char* expected) {
    return refused(kInvalidJobOrderStatus, id,
                   std::string(to_text(verb)) + ": the job is " + std::string(to_text(from)) + ", expected " + expected);
  };
  scheduler.report(*job);
  job->comment = comment;
  const UtcTime now = core.now();
  const std::string progress = "at a progress of " + text::to_text(100 * job->progress, 3) + " %";
  switch (verb) {
    case JobVerb::kStart:
      if (from != kNotAllowedToStart) return not_allowed("NotAllowedToStart");
      job->state = kAllowedToStart;
      job->reason = "started by a client";
      break;
    case JobVerb::kRevokeStart:
      if (from != kAllowedToStart) return not_allowed("AllowedToStart");
      job->state = kNotAllowedToStart;
      job->reason = "start revoked by a client";
      break;
    case JobVerb::kPause:
      if (from != kRunning) return not_allowed("Running");
      job->state = kInterrupted;
      job->reason = "paused by a client";
      break;
    case JobVerb::kResume:
      if (from != kInterrupted) return not_allowed("Interrupted");
      job->state = kRunning;
      job->reason = "resumed by a client";
      break;
    case JobVerb::kStop:
      if (!is({kRunning, kInterrupted})) return not_allowed("Running or Interrupted");
      end_job(*job, kEnded, "stopped by a client " + progress, now);
      break;
    case JobVerb::kAbort:
      if (is_done(from)) return not_allowed("a job that is not done");
      end_job(*job, kAborted, "aborted by a client" + (job->started ? " " + progress : ""), now);
      break;
    case JobVerb::kCancel:
      if (!is({kNotAllowedToStart, kAllowedToStart})) return not_allowed("NotAllowedToStart or AllowedToStart");
      return remove(*job, "cancelled by a client");
    case JobVerb::kClear:
      if (!is_done(from)) return not_allowed("Ended or Aborted");
      return remove(*job, "cleared by a client");
  }
  if (verb == JobVerb::kPause && !scheduler.pause(*job))
    return refused(kUnableToAccept, id, std::to_string(core.options.paused) + " jobs are interrupted, which is the limit");
  try {
    core.store.save(*job, true);
  } catch (...) {
    if (verb == JobVerb::kPause) scheduler.resume(*job);
    throw;
  }
  if (verb == JobVerb::kResume) scheduler.resume(*job);
  if (is_done(job->state)) scheduler.release(*job);
  core.publish(JobChange::Kind::kState, *job);
  return {kNoError, id, "", false};
}

JobReply Jobs::command(const std::string& id, JobVerb verb, const std::vector<LocalizedText>& comment) {
  if (const auto flaw = flaw_of(comment, "the comment")) return impl_->refused(kInvalidRequest, id, *flaw);
  const JobReply reply = impl_->change(id, [&] { return impl_->command(id, verb, comment); });
  if (reply.ok()) impl_->scheduler.wake();
  return reply;
}

JobReply Jobs::remove(const std::string& id) {
  const JobReply reply = impl_->change(id, [&] {
    auto job = impl_->core.store.find(id);
    if (!job) return impl_->refused(kUnknownJobOrder, id, "no job order has this identifier");
    if (job->state == JobState::kRunning || job->state == JobState::kInterrupted)
      return impl_->refused(
          kInvalidJobOrderStatus, id,
          "the job is " + std::string(to_text(job->state)) + ", expected one that does not run: Stop or Abort it first");
    return impl_->remove(*job, is_done(job->state) ? "cleared by a client" : "cancelled by a client");
  });
  if (reply.ok()) impl_->scheduler.wake();
  return reply;
}

std::optional<Job> Jobs::find(const std::string& id) {
  const std::lock_guard lock(impl_->core.mutex);
  impl_->must_be_open();
  auto job = impl_->core.store.find(id);
  if (job) impl_->scheduler.report(*job);
  return job;
}

std::optional<Job> Jobs::response(const std::string& id) {
  const std::lock_guard lock(impl_->core.mutex);
  impl_->must_be_open();
  auto job = impl_->core.store.find(id);
  if (!job) return job;
  impl_->scheduler.report(*job);
  if (is_done(job->state) && !job->read) {
    try {
      impl_->core.store.mark_read(*job);
    } catch (const DatabaseError& error) {
      impl_->core.database_trouble = error.what();  // the response is right; it is only kept longer
    }
  }
  return job;
}

JobPage Jobs::list(const JobFilter& filter, std::string_view cursor, std::size_t limit) {
  const std::lock_guard lock(impl_->core.mutex);
  impl_->must_be_open();
  JobPage page = impl_->core.store.list(filter, cursor, checked_limit(limit));
  for (Job& job : page.jobs) impl_->scheduler.report(job);
  return page;
}

std::optional<Result> Jobs::result(std::int64_t number) {
  const std::lock_guard lock(impl_->core.mutex);
  impl_->must_be_open();
  return impl_->core.store.result(number);
}

ResultPage Jobs::results(const ResultFilter& filter, std::string_view cursor, std::size_t limit) {
  const std::lock_guard lock(impl_->core.mutex);
  impl_->must_be_open();
  return impl_->core.store.results(filter, cursor, checked_limit(limit));
}

std::optional<Job> Jobs::wait(const std::string& id, double seconds) {
  const double longest = std::isfinite(seconds) ? std::clamp(seconds, 0.0, kLongest_s) : kLongest_s;
  const auto end = std::chrono::steady_clock::now() +
                   std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(longest));
  std::unique_lock lock(impl_->core.mutex);
  for (bool in_time = true;;) {
    impl_->must_be_open();
    auto job = impl_->core.store.find(id);
    if (!job || is_done(job->state) || !in_time) {
      if (job) impl_->scheduler.report(*job);
      return job;
    }
    in_time = impl_->core.done.wait_until(lock, end) == std::cv_status::no_timeout;
  }
}

std::uint64_t Jobs::subscribe(std::function<void(const JobChange&)> callback) {
  return impl_->core.notifier.add(std::move(callback));
}

void Jobs::unsubscribe(std::uint64_t number) { impl_->core.notifier.remove(number); }

JobsStatus Jobs::status() {
  const std::lock_guard lock(impl_->core.mutex);
  impl_->must_be_open();
  const JobsCore& core = impl_->core;
  const StoreTotals totals = impl_->core.store.totals();
  JobsStatus status;
  const auto count = [&](JobState state) { return static_cast<std::size_t>(totals.state[static_cast<int>(state)]); };
  status.not_allowed_to_start = count(JobState::kNotAllowedToStart);
  status.allowed_to_start = count(JobState::kAllowedToStart);
  status.running = count(JobState::kRunning);
  status.interrupted = count(JobState::kInterrupted);
  status.done = count(JobState::kEnded) + count(JobState::kAborted);
  status.workers = impl_->scheduler.processes();
  status.results = static_cast<std::uint64_t>(totals.results);
  status.result_bytes = static_cast<std::uint64_t>(totals.reply_bytes);
  status.lost_workers = core.lost_workers;
  status.differing_replies = core.differing_replies;
  status.trouble =
      core.database_trouble + (core.database_trouble.empty() || core.worker_trouble.empty() ? "" : "; ") + core.worker_trouble;
  return status;
}

void Jobs::clean() {
  for (bool more = true; more;) {
    const std::lock_guard lock(impl_->core.mutex);
    impl_->must_be_open();
    std::vector<Job> removed;
    more = impl_->core.store.clean(impl_->core.now(), removed);
    for (const Job& job : removed) impl_->core.publish(JobChange::Kind::kRemoved, job);
  }
}

}  // namespace cotwin::gateway
