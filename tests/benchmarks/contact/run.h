#pragma once
#include <algorithm>
#include <cstddef>
#include <memory>
#include <numeric>
#include <vector>

#include "tests/benchmarks/contact/engine.h"
#include "tests/benchmarks/measure.h"

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
    if (quick() && cpu_.size() == kQuickSteps) return;
    const double begin = thread_seconds();
    engine_->step(h_);
    cpu_.push_back(thread_seconds() - begin);
    engine_->read(X_WB, V_WB);
  }

  Engine& engine() { return *engine_; }
  const scene::Scene& scene() const { return scene_; }
  /// Time of a step if all steps are alike. The median is hardly affected by other processes.
  double median_microseconds() const {
    std::vector<double> sorted = cpu_;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    return 1e6 * *middle;
  }
  /// Time of a step if the steps differ; without the first steps.
  double mean_microseconds(std::size_t without = 0) const {
    if (quick()) without = 0;
    const double sum = std::accumulate(cpu_.begin() + static_cast<std::ptrdiff_t>(without), cpu_.end(), 0.0);
    return 1e6 * sum / static_cast<double>(cpu_.size() - without);
  }

 private:
  static constexpr std::size_t kQuickSteps = 5;  // of a quick run
  scene::Scene scene_;
  double h_;
  std::vector<double> cpu_;  // processor time of the thread, s, of each step

 public:
  std::vector<Pose> X_WB;
  std::vector<Twist> V_WB;

 private:
  std::unique_ptr<Engine> engine_;
};

}  // namespace cotwin::benchmark
