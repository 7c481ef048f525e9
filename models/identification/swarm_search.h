#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "models/identification/problem.h"
#include "models/numerics/swarm.h"

namespace cotwin::identification {

struct SwarmSearchOptions {
  /// threshold: of f; rounds: N_P. Reconfigurations renew the axes, so they come early.
  numerics::SwarmOptions swarm{.stagnation_rounds = 20, .stagnation_rate = 2e-3};
  double spread = 0.3;  // of particles about the prior and about a best one: standard deviation in ξ, at most (30 %)
};

struct SwarmSearchProgress {
  std::uint32_t round = 0;  // rounds done
  std::uint32_t reconfigurations = 0;
  double cost = 0;          // f of the best particle
  double weighted_rms = 0;  // of it, in floors
  numerics::SwarmStatus status = numerics::SwarmStatus::kRunning;
};

/// The swarm of IV-A4 on a Problem. Particles live in ξ, so that each is a physically consistent robot within the bounds, and
/// begin about the prior, the first one on it. Their coordinates are turned to the principal axes of the cost's curvature
/// (∂r/∂ξ)ᵀ(∂r/∂ξ) at the best position, at the start and again at each reconfiguration: the same ellipsoids that make least
/// squares ill-conditioned make a swarm, which moves by coordinates, crawl. How much the cost promises to fall there says how
/// far particles are spread along each. No other use is made of derivatives.
/// `problem` must outlive the tuning and stay where it is.
class SwarmSearch {
 public:
  explicit SwarmSearch(const Problem& problem, const SwarmSearchOptions& options = {});
  /// Goes on where save() was called, to the same bits. Throws Error for bytes of another problem or options.
  SwarmSearch(const Problem& problem, const SwarmSearchOptions& options, std::string_view saved);
  ~SwarmSearch();
  SwarmSearch(SwarmSearch&&) noexcept;
  SwarmSearch& operator=(SwarmSearch&&) noexcept;

  /// One round. Same bits on any number of threads. After the end it does nothing.
  SwarmSearchProgress round(numerics::Threads* threads = nullptr);
  SwarmSearchProgress run(numerics::Threads* threads = nullptr);
  SwarmSearchProgress progress() const;
  Eigen::VectorXd best() const;                // ξ
  Estimate estimate() const;                   // at best()
  const std::vector<double>& history() const;  // f after each round
  std::string save() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::identification
