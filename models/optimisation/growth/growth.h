#pragma once
#include <cstdint>
#include <functional>
#include <vector>

#include "models/foundation/support/threads.h"
#include "models/optimisation/search.h"

/// Data growing (V-B): many motions from rest to rest between postures, drawn at random within ranges of redundant coefficients and
/// duration. Motion k is a function of the seed and k alone, so that none has to be kept: the same request gives the same motions on any
/// number of threads, and memory does not grow with their number.
namespace cotwin::optimisation {

struct GrowthOptions : Drawing {
  std::uint32_t motions = 1000;
  std::size_t best = 3;  // that are kept of each cost
  /// kAuto: a GPU for a million motions and more, if there is one; kGpu: one for any number, or an Error.
  DeviceUse device = DeviceUse::kAuto;
  /// Called after each batch with the number of motions so far; may throw.
  std::function<void(std::uint32_t done)> on_progress = {};
  /// Called with all motions in their order, some thousands at a time; may throw.
  std::function<void(const Round&)> on_batch = {};
};

/// Values in bins whose width is at most 1/256 of their magnitude, from 2⁻⁴⁰ to 2⁶⁰: counts are exact, quantiles within a bin.
class Distribution {
 public:
  Distribution();
  void add(double x);
  std::uint64_t count() const { return count_; }
  double least() const { return least_; }
  double most() const { return most_; }
  double mean() const { return sum_ / static_cast<double>(count_); }
  /// The value that the share p of all is not above; p in [0, 1]. Of at least one value.
  double quantile(double p) const;
  /// At most `most` neighbouring intervals of about the same ratio: counts[i] values in [edges[i], edges[i + 1]).
  struct Intervals {
    std::vector<double> edges;
    std::vector<std::uint64_t> counts;
  };
  Intervals intervals(std::size_t most) const;

 private:
  std::vector<std::uint32_t> bins_;
  std::uint64_t count_ = 0;
  double least_ = 0, most_ = 0, sum_ = 0;
};

struct Harvest {
  std::uint32_t motions = 0, feasible = 0;
  std::string device;      // the GPU that judged them; empty: this processor
  double rounding = 0;     // DeviceJudge::rounding()
  std::string not_device;  // why this processor did, where a GPU was wanted
  /// Motions that are not feasible, by the bound that they exceed most, of those that were looked at: that of joint j at [d · n + j], d: q, dq, ddq, dddq, tau.
  std::vector<std::uint32_t> forbidden;
  std::vector<Distribution> costs;  // of each cost term, of feasible motions, at the samples of the problem
  /// What is possible to a posture of the list `to`.
  struct Goal {
    std::uint32_t feasible = 0;
    std::vector<double> least;  // of each cost, at the samples of the problem; +∞: none is feasible
  };
  std::vector<Goal> goals;
  /// As assess() sees them at no fewer samples than Problem has by itself, without those that it finds infeasible.
  std::vector<std::vector<Round::Particle>> best;  // of each cost, ascending
  std::vector<Round::Particle> front;              // of two costs and more, at most 100, see Archive
};

/// Motion `number` without costs.
Round::Particle grown(const Problem& problem, const GrowthOptions& options, std::uint32_t number);

/// Draws and evaluates all motions; kinematic bounds prune before torques. Throws Error for sizes that do not fit and empty boxes.
Harvest grow(const Problem& problem, const GrowthOptions& options, numerics::Threads* threads = nullptr);

}  // namespace cotwin::optimisation
