#include "components/tuner/worker.h"

#include <algorithm>
#include <cstring>
#include <exception>

#include "models/support/text.h"

namespace cotwin::tuner {

Worker::Worker(const robot::RobotModel& prior, const identification::ModelOptions& model, const Orders& orders)
    : orders_(orders),
      prior_(prior),
      robot_(prior),
      data_(prior, model, orders.forgetting),
      order_data_(data_.stored_doubles()),
      thread_([this] { run(); }) {}

Worker::~Worker() {
  stop_.store(true, std::memory_order_release);
  order_.release();
  thread_.join();
}

void Worker::seek(std::span<const double> data, double now) {
  std::copy(data.begin(), data.end(), order_data_.begin());
  order_now_ = now;
  busy_ = true;
  order_.release();
}

void Worker::wait() { ready_.wait(false, std::memory_order_acquire); }

void Worker::taken() {
  busy_ = false;
  ready_.store(false, std::memory_order_release);
}

void Worker::cancel() {
  if (!busy_) return;
  cancel_.store(true, std::memory_order_release);
  wait();
  taken();
  cancel_.store(false, std::memory_order_release);
}

bool Worker::seeks(std::span<const double> data, double now) const {
  return busy_ && now == order_now_ && data.size() == order_data_.size() &&
         std::memcmp(data.data(), order_data_.data(), data.size_bytes()) == 0;
}

void Worker::run() {
  while (true) {
    order_.acquire();
    if (stop_.load(std::memory_order_acquire)) return;
    finding_.failure.clear();
    try {
      tune();
    } catch (const std::exception& error) {
      finding_.failure = error.what();
    }
    ready_.store(true, std::memory_order_release);
    ready_.notify_one();
  }
}

void Worker::tune() {
  data_.load(order_data_);
  const identification::Problem problem(data_, prior_, {.bounds = {}, .prior_weight = orders_.prior_weight, .sigma = {}});
  identification::TuningOptions options;
  options.swarm = orders_.swarm;
  identification::Tuning tuning(problem, options);
  identification::TuningProgress progress = tuning.progress();
  while (progress.status == numerics::SwarmStatus::kRunning && !given_up()) progress = tuning.round();
  if (given_up()) return;
  finding_.estimate = tuning.estimate();
  finding_.rms = problem.data().rms(finding_.estimate);
  finding_.rms_prior = problem.data().rms(identification::estimate_of(prior_));
  finding_.rms_floor = problem.floor().rms;
  finding_.cost = progress.cost;
  finding_.condition = problem.floor().condition;
  finding_.rank = problem.floor().rank;
  finding_.log = "tuned at " + text::to_text(order_now_, 6) + " s with " + std::to_string(data_.count()) +
                 " samples: " + text::to_text(progress.weighted_rms, 4) + " times the floor's error after " +
                 std::to_string(progress.round) + " rounds";
  robot_ = identification::with_bodies(robot_, finding_.estimate, finding_.log);
  finding_.robot = robot_;
}

}  // namespace cotwin::tuner
