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
  /// threshold: of f; rounds: N_P. Reconfigurations compute new axes, so they start early.
  numerics::SwarmOptions swarm{.stagnation_rounds = 20, .stagnation_rate = 2e-3};
  double spread = 0.3;  // standard deviation in ξ of particles about the prior and about a best one, at most
};

struct SwarmSearchProgress {
  std::uint32_t round = 0;  // rounds done
  std::uint32_t reconfigurations = 0;
  double cost = 0;          // f of the best particle
  double weighted_rms = 0;  // of the best particle; 1 at the floor
  numerics::SwarmStatus status = numerics::SwarmStatus::kRunning;
};

/// The particle swarm of IV-A4 on a Problem. Particles are points ξ, so each is a physically consistent robot within the
/// bounds. The first particle starts at the prior, the others about it. Their coordinates are rotated to the principal axes of
/// the curvature of the cost, (∂r/∂ξ)ᵀ(∂r/∂ξ) at the best position, at the start and at each reconfiguration: a swarm moves by
/// coordinates, so it is slow on an ill-conditioned cost with oblique axes. The spread of particles along an axis follows from
/// the decrease of the cost that a quadratic model predicts. Derivatives have no other use.
/// `problem` must outlive the search at the same address.
class SwarmSearch {
 public:
  explicit SwarmSearch(const Problem& problem, const SwarmSearchOptions& options = {});
  /// Continues from where save() was called, to the same bits. Throws Error for bytes of another problem or other options.
  SwarmSearch(const Problem& problem, const SwarmSearchOptions& options, std::string_view saved);
  ~SwarmSearch();
  SwarmSearch(SwarmSearch&&) noexcept;
  SwarmSearch& operator=(SwarmSearch&&) noexcept;

  /// One round. The bits do not depend on the number of threads. Does nothing after the end.
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
