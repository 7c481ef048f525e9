#include "models/optimisation/evaluation/compliance.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/swarm.h"

namespace cotwin::optimisation {

namespace {

constexpr double kTier = 1e100;  // of violations: costs are far below
constexpr int kStages = 6;

std::vector<double> logarithms(const ComplianceValues& v) { return {std::log(v.M), std::log(v.D), std::log(v.S)}; }

}  // namespace

void check_ranges(const ComplianceValues& least, const ComplianceValues& most) {
  for (const auto& [name, from, to] : {std::tuple{"M", least.M, most.M}, {"D", least.D, most.D}, {"S", least.S, most.S}})
    if (!(from > 0 && from <= to && std::isfinite(to)))
      throw Error("compliance", std::string(name) + " from " + text::to_text(from) + " to " + text::to_text(to) +
                                    ", expected 0 < least <= most");
}

ComplianceSolution minimise_compliance(const ComplianceProblem& p) {
  check_ranges(p.least, p.most);
  const std::array<double, 3> least{p.least.M, p.least.D, p.least.S}, most{p.most.M, p.most.D, p.most.S};
  if (!p.cost) throw Error("compliance", "no cost is given, expected a function");
  const auto values_of = [&](const double* x, std::size_t stride) {
    std::array<double, 3> v{};
    for (std::size_t i = 0; i < 3; ++i) v[i] = std::clamp(std::exp(x[i * stride]), least[i], most[i]);
    return ComplianceValues{v[0], v[1], v[2]};
  };
  const auto deb = [&](const ComplianceValues& v) {
    const double beyond = p.violation ? p.violation(v) : 0;
    return beyond <= 0 ? p.cost(v) : kTier * (1 + beyond);
  };
  std::vector<double> lower = logarithms(p.least), upper = logarithms(p.most), best(3);
  double width = 1;
  for (int stage = 0; stage < kStages; ++stage, width *= 0.1) {
    numerics::SwarmOptions options;
    options.particles = 64;
    options.rounds = 60;
    options.seed = p.seed + static_cast<std::uint64_t>(stage);
    options.threshold = -std::numeric_limits<double>::infinity();
    options.stagnation_rounds = 0;
    const auto cost = [&](std::size_t, std::size_t count, const double* x, std::size_t stride, double* result) {
      for (std::size_t k = 0; k < count; ++k) result[k] = deb(values_of(x + k, stride));
    };
    std::vector<double> spread(3);
    for (std::size_t i = 0; i < 3; ++i) spread[i] = 0.3 * width * (upper[i] - lower[i]);
    numerics::Swarm swarm =
        stage == 0 ? numerics::Swarm(lower, upper, cost, options) : numerics::Swarm(lower, upper, best, spread, cost, options);
    swarm.run();
    swarm.best(best);
  }
  ComplianceSolution solution;
  solution.values = values_of(best.data(), 1);
  solution.feasible = !p.violation || p.violation(solution.values) <= 0;
  solution.cost = p.cost(solution.values);
  return solution;
}

}  // namespace cotwin::optimisation
