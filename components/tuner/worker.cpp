#include "components/tuner/worker.h"

#include <algorithm>
#include <exception>

#include "models/foundation/support/text.h"

namespace cotwin::tuner {

Worker::Worker(const robot::RobotModel& prior, const identification::ModelOptions& model, const EstimationOptions& options)
    : options_(options), prior_(prior), robot_(prior), samples_(prior, model, options.forgetting), thread_([this] { run(); }) {}

Worker::~Worker() {
  stop_.store(true, std::memory_order_release);
  order_.release();
  thread_.join();
}

void Worker::start(const identification::TorqueData& samples, double now) {
  samples_.copy_samples(samples);
  launch(now);
}

void Worker::launch(double now) {
  start_time_ = now;
  busy_ = true;
  order_.release();
}

void Worker::wait() {
  if (busy_) ready_.wait(false, std::memory_order_acquire);
}

void Worker::clear() {
  busy_ = false;
  ready_.store(false, std::memory_order_release);
}

void Worker::reset(const robot::RobotModel& robot) {
  if (busy_) {
    cancel_.store(true, std::memory_order_release);
    wait();
    clear();
    cancel_.store(false, std::memory_order_release);
  }
  robot_ = robot;
}

void Worker::restore(ByteReader& in, double now, const robot::RobotModel& robot) {
  if (busy_ && now == start_time_) {
    ByteWriter own;
    write_samples(own);
    if (std::ranges::equal(as_bytes(own.bytes()), in.rest())) return;
  }
  reset(robot);
  samples_.read_samples(in);
  in.expect_end();
  launch(now);
}

void Worker::run() {
  while (true) {
    order_.acquire();
    if (stop_.load(std::memory_order_acquire)) return;
    result_.failure.clear();
    try {
      estimate();
    } catch (const std::exception& error) {
      result_.failure = error.what();
    }
    ready_.store(true, std::memory_order_release);
    ready_.notify_one();
  }
}

void Worker::estimate() {
  const identification::Problem problem(samples_, prior_, {.bounds = {}, .prior_weight = options_.prior_weight, .sigma = {}});
  identification::SwarmSearchOptions options;
  options.swarm = options_.swarm;
  identification::SwarmSearch search(problem, options);
  identification::SwarmSearchProgress progress = search.progress();
  while (progress.status == numerics::SwarmStatus::kRunning && !stopped()) progress = search.round();
  if (stopped()) return;
  result_.estimate = search.estimate();
  result_.rms = problem.data().rms(result_.estimate);
  result_.rms_prior = problem.data().rms(identification::estimate_of(prior_));
  result_.rms_floor = problem.floor().rms;
  result_.cost = progress.cost;
  result_.condition = problem.floor().condition;
  result_.rank = problem.floor().rank;
  result_.log = "tuned at " + text::to_text(start_time_, 6) + " s with " + std::to_string(samples_.count()) +
                " samples: " + text::to_text(progress.weighted_rms, 4) + " times the floor's error after " +
                std::to_string(progress.round) + " rounds";
  robot_ = identification::with_bodies(robot_, result_.estimate, result_.log);
  result_.robot = robot_;
}

}  // namespace cotwin::tuner
