#pragma once
#include <time.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <numeric>
#include <vector>

#include "tests/benchmarks/contact/engine.h"

namespace cotwin::benchmark {

/// Steps a scene in an engine: poses and twists after each step, and the times of the steps.
class Run {
 public:
  Run(const EngineKind& kind, scene::Scene scene, double h)
      : scene_(std::move(scene)), h_(h), X_WB(scene_.bodies.size()), V_WB(scene_.bodies.size()), engine_(kind.make(scene_, h)) {
    for (std::size_t k = 0; k < scene_.bodies.size(); ++k) {
      X_WB[k] = scene_.bodies[k].X_WB;
      V_WB[k] = scene_.bodies[k].V_WB;
    }
  }

  void step() {
    const double cpu = now(CLOCK_THREAD_CPUTIME_ID), wall = now(CLOCK_MONOTONIC);
    engine_->step(h_);
    const double wall_end = now(CLOCK_MONOTONIC), cpu_end = now(CLOCK_THREAD_CPUTIME_ID);
    wall_.push_back(wall_end - wall);
    cpu_.push_back(cpu_end - cpu);
    engine_->read(X_WB, V_WB);
  }

  Engine& engine() { return *engine_; }
  const scene::Scene& scene() const { return scene_; }
  double h() const { return h_; }
  /// Time of a step if all steps are alike. The median is hardly affected by other processes.
  double median_microseconds() const {
    std::vector<double> sorted = wall_;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    return 1e6 * *middle;
  }
  /// Time of a step if the steps differ, by the thread's own clock; without the first steps.
  double mean_microseconds(std::size_t without = 0) const {
    const double sum = std::accumulate(cpu_.begin() + static_cast<std::ptrdiff_t>(without), cpu_.end(), 0.0);
    return 1e6 * sum / static_cast<double>(cpu_.size() - without);
  }

 private:
  static double now(clockid_t clock) {
    timespec t{};
    clock_gettime(clock, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
  }

  scene::Scene scene_;
  double h_;
  std::vector<double> wall_, cpu_;  // s, of each step

 public:
  std::vector<Pose> X_WB;
  std::vector<Twist> V_WB;

 private:
  std::unique_ptr<Engine> engine_;
};

}  // namespace cotwin::benchmark
