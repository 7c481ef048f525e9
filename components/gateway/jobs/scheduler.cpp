#include "components/gateway/jobs/scheduler.h"

#include <poll.h>
#include <signal.h>

#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>
#include <set>

#include "components/gateway/jobs/threads.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway {

namespace {

constexpr auto kRetry = std::chrono::seconds(1);            // of the database
constexpr auto kCleaning = std::chrono::minutes(1);         // between two
constexpr auto kProgress = std::chrono::milliseconds(100);  // between two reports of a job
constexpr double kMostBackOff = 30;                         // s
constexpr std::int64_t kLongest_ms = 1000;                  // between two looks at the clock while something depends on it

std::string percent(double progress) { return text::to_text(100 * progress, 3) + " %"; }

}  // namespace

Scheduler::Scheduler(JobsCore& core)
    : core_(core), back_off_s_(core.options.back_off_s), thread_(thread_without_signals([this] { run(); })) {}

Scheduler::~Scheduler() { close(); }

void Scheduler::close() {
  {
    const std::lock_guard lock(core_.mutex);
    closing_ = true;
  }
  wake();
  if (thread_.joinable()) thread_.join();
}

Scheduler::WorkerSlot* Scheduler::slot_of(const Job& job) {
  for (const auto& slot : slots_) {
    if (!slot->doomed && slot->job && slot->job->sequence == job.sequence) return slot.get();
  }
  return nullptr;
}

bool Scheduler::pause(const Job& job) {
  WorkerSlot* slot = slot_of(job);
  if (slot == nullptr) return true;
  if (slot->process) {
    const auto paused =
        std::count_if(slots_.begin(), slots_.end(), [](const auto& s) { return s->paused && s->process && !s->doomed; });
    if (paused >= core_.options.paused) return false;
    slot->process->signal(SIGSTOP);
  }
  slot->busy_s = slot->busy(Clock::now());
  slot->paused = true;
  return true;
}

void Scheduler::resume(const Job& job) {
  WorkerSlot* slot = slot_of(job);
  if (slot == nullptr) return;
  slot->paused = false;
  slot->since = Clock::now();
  if (slot->process) slot->process->signal(SIGCONT);
}

void Scheduler::release(const Job& job) {
  if (WorkerSlot* slot = slot_of(job)) {
    slot->doomed = true;
    if (slot->process) slot->process->signal(SIGKILL);
  }
}

void Scheduler::report(Job& job) const {
  const WorkerSlot* slot = slot_of(job);
  if (slot == nullptr) return;
  job.progress = slot->progress;
  job.progress_message = slot->message;
  job.busy_s = slot->busy(Clock::now());
  if (slot->progress > 0) job.remaining_s = job.busy_s * (1 - slot->progress) / slot->progress;
}

int Scheduler::processes() const {
  return static_cast<int>(std::count_if(slots_.begin(), slots_.end(), [](const auto& s) { return s->process != nullptr; }));
}

int Scheduler::running() const {
  return static_cast<int>(
      std::count_if(slots_.begin(), slots_.end(), [](const auto& s) { return s->job && !s->paused && !s->doomed; }));
}

void Scheduler::run() {
  for (;;) {
    std::vector<pollfd> polled;
    std::vector<WorkerSlot*> who;
    int timeout = 0;
    {
      Lock lock(core_.mutex);
      wake_.arm();
      if (closing_) break;
      supervise(lock);
      if (auto doomed = pop_doomed(); !doomed.empty()) {
        lock.unlock();  // their processes take a while to end
        wake_.disarm();
        continue;
      }
      polled.push_back({wake_.descriptor(), POLLIN, 0});
      for (const auto& slot : slots_) {
        if (!slot->process || slot->paused) continue;
        polled.push_back({slot->process->output(), POLLIN, 0});
        polled.push_back({slot->process->errors(), POLLIN, 0});
        polled.push_back({slot->process->input(), POLLOUT, 0});
        who.push_back(slot.get());
      }
      timeout = timeout_ms();
    }
    poll(polled.data(), static_cast<nfds_t>(polled.size()), timeout);
    wake_.disarm();
    for (std::size_t i = 0; i < who.size(); ++i) {
      if (polled[3 * i + 1].revents != 0 || polled[3 * i + 2].revents != 0 || polled[3 * i + 3].revents != 0) serve(*who[i]);
    }
  }
  wake_.disarm();
  const std::lock_guard lock(core_.mutex);
  slots_.clear();
}

std::vector<std::unique_ptr<Scheduler::WorkerSlot>> Scheduler::pop_doomed() {
  std::vector<std::unique_ptr<WorkerSlot>> doomed;
  for (auto& slot : slots_) {
    if (slot->doomed || (!slot->process && !slot->job)) doomed.push_back(std::move(slot));
  }
  std::erase(slots_, nullptr);
  return doomed;
}

double Scheduler::limit_s(const WorkerSlot& slot) const {
  return slot.job->order.time_limit_s > 0 ? slot.job->order.time_limit_s : core_.options.time_limit_s;
}

int Scheduler::timeout_ms() {
  const Clock::time_point now = Clock::now();
  const Clock::time_point next = next_try_ > now ? next_try_ : next_clean_;
  std::int64_t timeout = std::chrono::duration_cast<std::chrono::milliseconds>(next - now).count() + 1;
  const auto at_most = [&](std::int64_t ms) { timeout = std::min(timeout, std::max<std::int64_t>(ms, 0)); };
  if (next_start_ > now) at_most(std::chrono::duration_cast<std::chrono::milliseconds>(next_start_ - now).count() + 1);
  for (const auto& slot : slots_) {
    if (!slot->job || slot->paused || slot->reply || next_try_ > now) continue;
    at_most(std::min(static_cast<std::int64_t>(1e3 * std::min(limit_s(*slot) - slot->busy(now), 1.0)) + 1, kLongest_ms));
  }
  if (next_try_ <= now) {
    try {
      const UtcTime utc = core_.now();
      if (const auto time = core_.store.next_time(utc)) at_most(std::min((*time - utc).count(), kLongest_ms));
    } catch (const DatabaseError&) {
      at_most(kLongest_ms);
    }
  }
  return static_cast<int>(std::max<std::int64_t>(timeout, 0));
}

void Scheduler::supervise(Lock& lock) {
  const Clock::time_point now = Clock::now();
  if (now < next_try_) return;
  try {
    for (const auto& slot : slots_) {
      if (slot->reply && !slot->doomed) settle(*slot);
    }
    check_limits();
    dispatch(lock);
    if (now >= next_clean_) clean();
    core_.database_trouble.clear();
  } catch (const DatabaseError& error) {
    if (core_.database_trouble != error.what()) std::cerr << "cotwin: job database: " << error.what() << '\n';
    core_.database_trouble = error.what();
    next_try_ = now + kRetry;
  }
}

void Scheduler::clean() {
  std::vector<Job> removed;
  const bool more = core_.store.clean(core_.now(), removed);
  for (const Job& job : removed) core_.publish(JobChange::Kind::kRemoved, job);
  next_clean_ = Clock::now() + (more ? Clock::duration::zero() : Clock::duration(kCleaning));
}

/// Deadlines and limits of running.
void Scheduler::check_limits() {
  const UtcTime utc = core_.now();
  while (auto job = core_.store.overdue(utc)) {
    report(*job);
    end_job(*job, JobState::kAborted, "the deadline " + to_text(*job->order.deadline) + " has passed", utc);
    core_.store.save(*job, false);
    release(*job);
    core_.publish(JobChange::Kind::kState, *job);
  }
  const Clock::time_point now = Clock::now();
  for (const auto& slot : slots_) {
    if (!slot->job || slot->doomed || slot->paused || slot->reply) continue;
    const double limit = limit_s(*slot);
    if (slot->busy(now) <= limit) continue;
    if (auto job = core_.store.find(slot->job->order.id)) {
      report(*job);
      end_job(
          *job, JobState::kAborted,
          "the job ran longer than its limit of " + text::to_text(limit) + " s; its progress was " + percent(slot->progress),
          utc);
      core_.store.save(*job, false);
      core_.publish(JobChange::Kind::kState, *job);
    }
    release(*slot->job);
  }
}

void Scheduler::dispatch(Lock& lock) {
  while (running() < core_.options.workers && !closing_) {
    std::set<std::int64_t> busy;
    for (const auto& slot : slots_) {
      if (slot->job && !slot->doomed) busy.insert(slot->job->sequence);
    }
    auto job = core_.store.next(busy, core_.now());
    if (!job || !give(lock, std::move(*job))) return;
  }
}

/// Ends a job whose request cannot be answered, and saves it.
void Scheduler::end_with_problem(Job& job, const std::string& problem, UtcTime now) {
  const auto told = nlohmann::json::parse(problem);
  const auto detail = told.find("detail");
  end_job(job, JobState::kEnded,
          detail != told.end() && detail->is_string() ? detail->get<std::string>() : "the request was refused", now);
  job.problem = problem;
  core_.store.save(job, false);
  core_.publish(JobChange::Kind::kState, job);
}

/// What is to be computed of a job. nullopt: nothing, it has ended, or was changed meanwhile.
std::optional<Scheduler::Task> Scheduler::task_of(Lock& lock, Job& job) {
  Task task{job, {}, 0, 0};
  const bool chain = job.service == kChain;
  const Chains& chains = core_.options.chains;
  std::vector<std::string> replies;
  for (;;) {
    std::string problem, reply;
    lock.unlock();
    try {
      if (chain) {
        const std::string next = chains.next(job.order.request, replies);
        task.steps = nlohmann::json::parse(job.order.request).at("steps").size();
        task.step = replies.size();
        if (next.empty()) {
          reply = chains.reply(job.order.request, replies);
        } else {
          const CanonicalRequest step = canonical_request(next);
          task.job.order.request = step.text;
          task.job.request_hash = step.hash;
          task.job.service = step.service;
          task.job.robot = step.robot;
          task.job.order.reuse = job.order.reuse && !step.reads_more;
        }
      }
      if (reply.empty()) task.origin = core_.origin_of(task.job.robot);
    } catch (const std::exception& error) {
      problem =
          chain && chains.problem
              ? chains.problem(job.order.request, replies.size(), chains.problem_of(error))
              : nlohmann::json{{"title", "The robot cannot be read."}, {"detail", error.what()}, {"pointer", "/robot"}}.dump(
                    -1, ' ', false, nlohmann::json::error_handler_t::replace);
    }
    lock.lock();
    const auto current = core_.store.find(job.order.id);
    if (!current || current->version != job.version) return std::nullopt;  // choose again
    const UtcTime utc = core_.now();
    if (chain && !job.started && (!problem.empty() || !reply.empty())) job.started = utc;
    if (!problem.empty()) {
      end_with_problem(job, problem, utc);
      return std::nullopt;
    }
    if (!reply.empty()) {
      job.ended = utc;
      job.reason.clear();
      core_.store.complete(job, reply, {"", core_.options.producer});
      core_.publish(JobChange::Kind::kState, job);
      return std::nullopt;
    }
    if (!chain) {
      if (!job.order.reuse || !core_.store.reuse(job, task.origin, utc)) return task;
      core_.publish(JobChange::Kind::kState, job);
      return std::nullopt;
    }
    task.job.ended = utc;
    task.job.busy_s = 0;
    const auto known = core_.store.answer_of_step(task.job, task.origin, task.job.order.reuse);
    if (!known) return task;
    replies.push_back(*known);
  }
}

/// Gives a job to a worker, or ends it with an earlier result. False: no worker can be started now.
bool Scheduler::give(Lock& lock, Job job) {
  const std::optional<Task> task = task_of(lock, job);
  if (!task) return true;
  WorkerSlot* slot = idle_slot(task->job.robot, task->origin.robot_hash);
  if (slot == nullptr) {
    if (Clock::now() < next_start_) return false;
    auto made = std::make_unique<WorkerSlot>();
    try {
      const JobsOptions& o = core_.options;
      made->process = std::make_unique<WorkerProcess>(o.command, WorkerLimits{o.nice, o.memory, o.line});
    } catch (const Error& error) {
      if (core_.worker_trouble != error.what()) std::cerr << "cotwin: worker: " << error.what() << '\n';
      core_.worker_trouble = error.what();
      back_off();
      return false;
    }
    core_.worker_trouble.clear();
    slot = slots_.emplace_back(std::move(made)).get();
  }
  if (job.state == JobState::kAllowedToStart) {
    job.state = JobState::kRunning;
    job.started = core_.now();
    job.reason.clear();
    core_.store.save(job, false);
    core_.publish(JobChange::Kind::kState, job);
  }
  slot->task = *task;
  slot->task.job.busy_s = job.busy_s;
  slot->id = task->steps == 0 ? job.order.id : job.order.id + "/" + std::to_string(task->step);
  slot->robots[task->job.robot] = task->origin.robot_hash;
  slot->since = slot->told = Clock::now();
  slot->busy_s = task->steps > 0 ? job.busy_s : 0;
  slot->progress = task->share(0);
  slot->message.clear();
  slot->heard = false;
  slot->process->send(R"({"id":)" + nlohmann::json(slot->id).dump() + R"(,"request":)" + task->job.order.request + "}");
  slot->process->write();
  slot->job = std::move(job);
  return true;
}

/// A worker may keep what it has read of a robot: one that has read other files is ended.
Scheduler::WorkerSlot* Scheduler::idle_slot(const std::string& robot, const std::string& hash) {
  for (const auto& slot : slots_) {
    if (slot->job || slot->doomed || !slot->process) continue;
    const auto known = slot->robots.find(robot);
    if (known == slot->robots.end() || known->second == hash) return slot.get();
    slot->doomed = true;
  }
  return nullptr;
}

// Reading and parsing need no lock: other threads only signal the process.
void Scheduler::serve(WorkerSlot& slot) {
  slot.process->write();
  const bool open = slot.process->read();
  try {
    while (const auto line = slot.process->next_line()) {
      const WorkerLine parsed = parse_worker_line(*line);
      const bool same_robot = parsed.reply.empty() || !slot.job || robot_is_unchanged(slot);
      const std::lock_guard lock(core_.mutex);
      if (slot.doomed) return;
      accept(slot, parsed, same_robot);
    }
  } catch (const Error& error) {
    const std::lock_guard lock(core_.mutex);
    return fail(slot, error.what());
  }
  if (open) return;
  slot.process->await_end();
  const std::lock_guard lock(core_.mutex);
  const std::string how = "the worker " + slot.process->end();
  fail(slot, how, !slot.process->ended_by_itself() || slot.previous.empty() || slot.heard);
}

/// The files that the worker may have read in between.
bool Scheduler::robot_is_unchanged(const WorkerSlot& slot) const {
  try {
    return core_.origin_of(slot.task.job.robot).robot_hash == slot.task.origin.robot_hash;
  } catch (const std::exception&) {
    return false;
  }
}

void Scheduler::accept(WorkerSlot& slot, const WorkerLine& line, bool same_robot) {
  if (!slot.job || slot.reply) throw Error("the worker wrote a line without a job");
  if (!slot.heard && !slot.previous.empty() && line.id == slot.previous && line.id != slot.id)
    return fail(slot, "the worker answered a job twice", false);
  if (line.id != slot.id) throw Error("the worker answered job '" + line.id.substr(0, 80) + "', expected '" + slot.id + "'");
  slot.heard = true;
  const Clock::time_point now = Clock::now();
  if (line.progress) {
    slot.progress = slot.task.share(*line.progress);
    slot.message = line.message;
    if (now - slot.told < kProgress) return;
    slot.told = now;
    Job job = *slot.job;
    report(job);
    core_.publish(JobChange::Kind::kProgress, job);
    return;
  }
  slot.busy_s = slot.busy(now);
  slot.since = now;
  slot.reply = Reply{!line.problem.empty(), std::string(line.problem.empty() ? line.reply : line.problem)};
  if (!same_robot) {  // it is not certain which files the reply is for: it is not taken for other jobs
    slot.task.origin.robot_hash.clear();
    slot.robots[slot.task.job.robot].clear();
  }
  wake();  // settle() in supervise()
}

/// Ends a job that has its reply. A job that was interrupted in that moment waits for Resume.
void Scheduler::settle(WorkerSlot& slot) {
  auto job = core_.store.find(slot.job->order.id);
  if (job && job->state == JobState::kInterrupted) return;
  if (job && job->state == JobState::kRunning) {
    job->ended = core_.now();
    job->busy_s = slot.busy_s;
    job->reason.clear();
    Task& task = slot.task;
    const auto tell_difference = [&](bool differs) {
      if (!differs) return;
      ++core_.differing_replies;
      std::cerr << "cotwin: job " << job->order.id << ": the reply differs from an earlier one to the same request\n";
    };
    if (slot.reply->problem) {
      job->progress = slot.progress;
      end_with_problem(
          *job,
          task.steps == 0 ? slot.reply->json : core_.options.chains.problem(job->order.request, task.step, slot.reply->json),
          *job->ended);
    } else if (task.steps == 0) {
      tell_difference(core_.store.complete(*job, slot.reply->json, task.origin));
      core_.publish(JobChange::Kind::kState, *job);
    } else {  // the chain goes on in dispatch()
      task.job.ended = std::exchange(job->ended, std::nullopt);
      task.job.busy_s = job->busy_s - task.job.busy_s;
      job->progress = task.share(1);
      tell_difference(core_.store.complete_step(*job, task.job, slot.reply->json, task.origin));
      core_.publish(JobChange::Kind::kState, *job);
    }
  }
  slot.previous = slot.id;
  slot.job.reset();
  slot.reply.reset();
  slot.doomed = processes() > core_.options.workers;  // after Resume there may be more
  back_off_s_ = core_.options.back_off_s;
}

void Scheduler::back_off() {
  next_start_ = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(back_off_s_));
  back_off_s_ = std::min(2 * back_off_s_, kMostBackOff);
}

/// The worker has ended or broke the protocol: its job loses a retry. It costs nothing if the worker was through with the job
/// before (it ended with code 0, or wrote once more) when it was given this one.
void Scheduler::fail(WorkerSlot& slot, const std::string& why, bool costs) {
  if (slot.doomed) return;
  if (slot.reply) return slot.process.reset();  // it has answered
  slot.doomed = true;
  ++core_.lost_workers;
  if (!costs) return;  // the job is Running without a worker: it is given to another one
  back_off();
  if (!slot.job) return;
  try {
    auto job = core_.store.find(slot.job->order.id);
    if (!job || is_done(job->state)) return;
    job->progress = slot.progress;
    job->progress_message = slot.message;
    job->busy_s = slot.busy(Clock::now());
    if (++job->retries > core_.options.retries) {
      end_job(*job, JobState::kAborted, why + "; the job has no retry left", core_.now());
    } else {
      job->reason = why + "; the job is tried again";
      job->progress = 0;
      job->progress_message.clear();
    }
    core_.store.save(*job, false);
    core_.publish(JobChange::Kind::kState, *job);
  } catch (const DatabaseError& error) {
    core_.database_trouble = error.what();
    next_try_ = Clock::now() + kRetry;
  }
}

}  // namespace cotwin::gateway
