#include "components/gateway/api/job_board.h"

#include <algorithm>

#include "models/foundation/support/text.h"

namespace cotwin::gateway {

namespace {

constexpr std::size_t kKeptEvents = 1024, kMostWaiters = 1024;

Json texts_json(const std::vector<LocalizedText>& texts) {
  Json all = Json::array();
  for (const LocalizedText& t : texts) all.push_back({{"Locale", t.locale}, {"Text", t.text}});
  return all;
}

Json parameter(const char* id, Json value) { return {{"ID", id}, {"Value", std::move(value)}}; }

Json order_json(const Job& job) {
  const JobOrder& order = job.order;
  Json j{{"JobOrderID", order.id}, {"Description", texts_json(order.description)}, {"Priority", order.priority}};
  j["WorkMasterID"] = Json::array({{{"ID", job.service}}});
  if (order.start_time) j["StartTime"] = to_text(*order.start_time);
  if (order.end_time) j["EndTime"] = to_text(*order.end_time);
  Json parameters = Json::array();
  if (!order.request.empty()) parameters.push_back(parameter("Request", Json::parse(order.request)));
  if (order.deadline) parameters.push_back(parameter("Deadline", to_text(*order.deadline)));
  if (order.time_limit_s > 0) parameters.push_back(parameter("TimeLimit", order.time_limit_s));
  if (!order.reuse) parameters.push_back(parameter("Reuse", false));
  j["JobOrderParameters"] = std::move(parameters);
  return j;
}

http::Event event_of(const JobChange& change) {
  static const char* const kKinds[] = {"state", "order", "progress", "removed"};
  Json data{{"JobOrderID", change.job.order.id},
            {"Change", kKinds[static_cast<std::size_t>(change.kind)]},
            {"State", JobBoard::to_json(change.job)["State"]},
            {"JobResult", to_text(change.job.result)},
            {"Progress", change.job.progress}};
  if (!change.job.progress_message.empty()) data["ProgressMessage"] = change.job.progress_message;
  if (!change.job.light.empty()) data["Light"] = change.job.light;
  if (!change.job.reason.empty()) data["ReasonForStateChange"] = change.job.reason;
  http::Event event{"job", "", data.dump(-1, ' ', false, Json::error_handler_t::replace)};
  if (change.kind != JobChange::Kind::kProgress) event.id = std::to_string(change.job.version);
  return event;
}

}  // namespace

http::Refusal refusal_of(const JobReply& reply) {
  int status = 422;
  std::vector<http::Field> fields;
  if ((reply.status & kUnknownJobOrder) != 0) status = 404;
  if ((reply.status & kInvalidJobOrderStatus) != 0) status = 409;
  if ((reply.status & kVersionChanged) != 0) status = 412;
  if ((reply.status & kUnableToAccept) != 0) {
    status = 503;
    fields.push_back({"Retry-After", "5"});
  }
  http::Problem problem{status, reply.message, "", ""};
  problem.members = {{"ReturnStatus", std::to_string(reply.status)}};  // 64 bits: a decimal string (OPC 10000-6)
  return {std::move(problem), std::move(fields)};
}

http::Response response_of(const std::function<http::Response()>& function) {
  try {
    return function();
  } catch (const http::Refusal& refused) {
    return http::to_response(refused.problem, refused.fields);
  } catch (const Unavailable& error) {
    return http::to_response({503, error.what(), "", ""}, {{"Retry-After", "5"}});
  } catch (const Error& error) {
    return http::to_response({422, error.what(), "", ""});
  } catch (const std::exception& error) {
    return http::to_response({500, error.what(), "", ""});
  }
}

JobReply store_for(Jobs& jobs, const http::Request& client, const JobOrder& order, bool start) {
  StoreOptions options;
  options.start = start;
  options.owner = client.client;
  if (const std::string* const field = client.field("Idempotency-Key")) {
    std::string_view key = text::trim(*field);
    if (key.size() >= 2 && key.front() == '"' && key.back() == '"') key = key.substr(1, key.size() - 2);
    if (key.empty()) throw refusal(400, "the field Idempotency-Key is empty");
    options.idempotency_key = key;
  }
  const JobReply reply = jobs.store(order, options);
  if (!reply.ok()) throw refusal_of(reply);
  if (reply.repeated && !jobs.find(reply.id)) {
    http::Problem problem{410, "the job order '" + reply.id + "', for which the key was used before, was removed", "", ""};
    problem.members = {{"JobOrderID", reply.id}};
    throw http::Refusal{std::move(problem), {}};
  }
  return reply;
}

JobBoard::JobBoard(Jobs& jobs) : jobs_(jobs) {
  subscription_ = jobs_.subscribe([this](const JobChange& change) { on_change(change); });
  thread_ = std::thread([this] { run(); });
}

JobBoard::~JobBoard() { stop(); }

void JobBoard::stop() {
  {
    const std::lock_guard lock(mutex_);
    if (stopped_) return;
    stopped_ = true;
  }
  changed_.notify_all();
  thread_.join();
  jobs_.unsubscribe(subscription_);
}

void JobBoard::wait(const std::string& id, double seconds, std::function<void(bool)> function) {
  const auto end = std::chrono::steady_clock::now() +
                   std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(seconds));
  bool full = false;
  {
    const std::lock_guard lock(mutex_);
    full = stopped_ || waiters_.size() >= kMostWaiters;
    // Before the job is looked at: a change in between is noticed by on_change.
    if (!full) waiters_.push_back({id, end, function});
  }
  bool done = true;
  try {
    const std::optional<Job> job = jobs_.find(id);
    done = !job || is_done(job->state);
  } catch (const Unavailable&) {
    // The function asks for the job again, and gets the reason.
  }
  if (full) return function(done);
  if (!done) {
    changed_.notify_all();
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    ended_.push_back(id);
  }
  changed_.notify_all();
}

void JobBoard::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    const auto now = std::chrono::steady_clock::now();
    std::vector<std::pair<Waiter, bool>> due;
    std::erase_if(waiters_, [&](Waiter& w) {
      const bool done = std::find(ended_.begin(), ended_.end(), w.id) != ended_.end();
      if (!done && w.end > now && !stopped_) return false;
      due.emplace_back(std::move(w), done);
      return true;
    });
    ended_.clear();
    if (!due.empty()) {
      lock.unlock();
      for (const auto& [waiter, done] : due) waiter.function(done);
      due.clear();
      lock.lock();
      continue;
    }
    if (stopped_) return;
    auto next = now + std::chrono::hours(1);
    for (const Waiter& w : waiters_) next = std::min(next, w.end);
    changed_.wait_until(lock, next, [&] {
      return stopped_ || !ended_.empty() ||
             std::any_of(waiters_.begin(), waiters_.end(), [&](const Waiter& w) { return w.end < next; });
    });
  }
}

void JobBoard::on_change(const JobChange& change) {
  const http::Event event = event_of(change);
  const std::lock_guard lock(mutex_);
  if (change.kind == JobChange::Kind::kRemoved || is_done(change.job.state)) {
    const bool wanted =
        std::any_of(waiters_.begin(), waiters_.end(), [&](const Waiter& w) { return w.id == change.job.order.id; });
    if (wanted) ended_.push_back(change.job.order.id);
    changed_.notify_all();
  }
  if (change.lost) {
    kept_.clear();
    for (const auto& weak : streams_) {
      if (const auto stream = weak.lock()) stream->send({"resync", "", "{}"});
    }
  }
  if (!event.id.empty()) {
    kept_.emplace_back(change.job.version, event);
    if (kept_.size() > kKeptEvents) kept_.pop_front();
  }
  std::erase_if(streams_, [&](const auto& weak) {
    const auto stream = weak.lock();
    return !stream || !stream->send(event);
  });
}

void JobBoard::watch(const std::shared_ptr<http::Stream>& stream, const std::string& last) {
  const std::lock_guard lock(mutex_);
  if (stopped_) return stream->close();
  std::erase_if(streams_, [](const auto& weak) { return weak.expired(); });
  if (!last.empty()) {
    const auto at = std::find_if(kept_.begin(), kept_.end(), [&](const auto& kept) { return kept.second.id == last; });
    if (at == kept_.end()) {
      stream->send({"resync", "", "{}"});
    } else {
      for (auto each = at + 1; each != kept_.end(); ++each) stream->send(each->second);
    }
  }
  streams_.push_back(stream);
}

Json JobBoard::to_json(const Job& job) {
  Json j{{"JobOrder", order_json(job)},
         {"State",
          Json::array(
              {{{"BrowsePath", nullptr}, {"StateText", to_text(job.state)}, {"StateNumber", static_cast<int>(job.state)}}})},
         {"JobExecutionMode", "SimulationMode"},
         {"JobResult", to_text(job.result)},
         {"Progress", job.progress}};
  if (!job.progress_message.empty()) j["ProgressMessage"] = job.progress_message;
  if (!job.light.empty()) j["Light"] = job.light;
  if (!job.reason.empty()) j["ReasonForStateChange"] = job.reason;
  j["Stored"] = to_text(job.stored);
  j["Version"] = job.version;
  return j;
}

Json JobBoard::job_json(const std::string& id) {
  const std::optional<Job> job = jobs_.find(id);
  if (!job) throw refusal(404, "there is no job order '" + id.substr(0, 80) + "'");
  return to_json(*job);
}

http::Response JobBoard::reply_of(const std::string& id) {
  const std::optional<Job> job = jobs_.response(id);
  if (!job) throw refusal(404, "there is no job order '" + id.substr(0, 80) + "'");
  if (!is_done(job->state)) throw refusal(409, "the job is not done");
  if (!job->problem.empty()) {
    const Json problem = Json::parse(job->problem, nullptr, false);
    if (problem.is_object()) throw refusal(422, problem.value("detail", ""), problem.value("pointer", ""));
  }
  const std::optional<Result> result = job->result_number ? jobs_.result(*job->result_number) : std::nullopt;
  if (!result)
    throw refusal(500, "the job has no reply: " + (job->reason.empty() ? std::string(to_text(job->state)) : job->reason));
  return give_text(result->reply);
}

}  // namespace cotwin::gateway
