#include "models/numerics/swarm.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/kernels/kernels.h"
#include "models/numerics/random.h"

namespace cotwin::numerics {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::size_t blocks_of(std::size_t particles) { return (particles + kSwarmBlock - 1) / kSwarmBlock; }

SwarmState empty_state(std::vector<double> lower, std::vector<double> upper, const SwarmOptions& options) {
  if (lower.empty() || lower.size() != upper.size())
    throw Error("swarm", std::to_string(lower.size()) + " lower and " + std::to_string(upper.size()) +
                             " upper bounds, expected as many of both, at least 1");
  for (std::size_t i = 0; i < lower.size(); ++i)
    if (!(lower[i] <= upper[i]) || !std::isfinite(lower[i]) || !std::isfinite(upper[i]))
      throw Error("swarm", "bounds " + text::to_text(lower[i]) + " and " + text::to_text(upper[i]) + " of coordinate " +
                               std::to_string(i + 1) + ", expected finite ones in ascending order");
  if (options.particles < 1) throw Error("swarm", std::to_string(options.particles) + " particles, expected at least 1");
  SwarmState s;
  s.dimensions = lower.size();
  s.particles = blocks_of(static_cast<std::size_t>(options.particles)) * kSwarmBlock;
  for (std::size_t i = 0; i < lower.size(); ++i) s.spread.push_back(options.spread * (upper[i] - lower[i]));
  s.lower = std::move(lower);
  s.upper = std::move(upper);
  const std::size_t all = s.dimensions * s.particles;
  s.x.assign(all, 0.0);
  s.v.assign(all, 0.0);
  s.best_x.assign(all, 0.0);
  s.cost.assign(s.particles, kInfinity);
  s.best_cost.assign(s.particles, kInfinity);
  return s;
}

Key key_of(std::uint64_t seed, Stream stream, std::uint32_t round, std::size_t particle, std::size_t coordinate) {
  return {seed, stream, round, static_cast<std::uint32_t>(particle), static_cast<std::uint32_t>(coordinate)};
}

}  // namespace

const char* to_text(SwarmStatus status) {
  switch (status) {
    case SwarmStatus::kRunning:
      return "running";
    case SwarmStatus::kThreshold:
      return "threshold reached";
    case SwarmStatus::kRounds:
      return "all rounds done";
  }
  return "";
}

Swarm::Swarm(std::vector<double> lower, std::vector<double> upper, Cost cost, const SwarmOptions& options)
    : Swarm(empty_state(std::move(lower), std::move(upper), options), std::move(cost), options) {
  SwarmState& s = state_;
  for (std::size_t i = 0; i < s.dimensions; ++i)
    for (std::size_t k = 0; k < s.particles; ++k) {
      const double width = s.upper[i] - s.lower[i];
      s.x[i * s.particles + k] = s.lower[i] + width * uniform(key_of(options.seed, kStart, 0, k, 2 * i));
      s.v[i * s.particles + k] = 0.5 * width * (uniform(key_of(options.seed, kStart, 0, k, 2 * i + 1)) - 0.5);
    }
}

Swarm::Swarm(std::vector<double> lower, std::vector<double> upper, std::vector<double> start, std::vector<double> start_spread,
             Cost cost, const SwarmOptions& options)
    : Swarm(empty_state(std::move(lower), std::move(upper), options), std::move(cost), options) {
  SwarmState& s = state_;
  if (start.size() != s.dimensions || start_spread.size() != s.dimensions)
    throw Error("swarm", "a start of " + std::to_string(start.size()) + " coordinates and a spread of " +
                             std::to_string(start_spread.size()) + ", expected " + std::to_string(s.dimensions));
  for (std::size_t i = 0; i < s.dimensions; ++i) {
    if (!(s.lower[i] <= start[i] && start[i] <= s.upper[i]))
      throw Error("swarm", "coordinate " + std::to_string(i + 1) + " starts at " + text::to_text(start[i]) +
                               ", expected within " + text::to_text(s.lower[i]) + " to " + text::to_text(s.upper[i]));
    for (std::size_t k = 0; k < s.particles; ++k) {
      const double away = k == 0 ? 0 : start_spread[i] * normal(key_of(options.seed, kStart, 0, k, 2 * i));
      s.x[i * s.particles + k] = std::clamp(start[i] + away, s.lower[i], s.upper[i]);
      s.v[i * s.particles + k] = 0.5 * start_spread[i] * normal(key_of(options.seed, kStart, 0, k, 2 * i + 1));
    }
  }
}

Swarm::Swarm(SwarmState state, Cost cost, const SwarmOptions& options)
    : options_(options), state_(std::move(state)), cost_(std::move(cost)) {
  check();
  state_.history.reserve(std::max(state_.history.size(), static_cast<std::size_t>(std::max(options.rounds, 0)) + 1));
  order_.resize(state_.particles);
  centres_.resize(state_.dimensions * state_.particles);
  informant_.resize(state_.particles);
  if (state_.round > 0) inform();
}

void Swarm::check() const {
  const SwarmState& s = state_;
  const std::size_t d = s.dimensions, p = s.particles;
  if (d == 0 || p == 0 || p % kSwarmBlock != 0 || s.lower.size() != d || s.upper.size() != d || s.spread.size() != d ||
      s.x.size() != d * p || s.v.size() != d * p || s.best_x.size() != d * p || s.cost.size() != p || s.best_cost.size() != p ||
      s.leader >= p || s.history.size() != s.round || s.last_reconfiguration > s.round)
    throw Error("swarm", "the sizes of its state do not belong together");
  if (std::any_of(s.best_cost.begin(), s.best_cost.end(), [](double c) { return std::isnan(c); }))
    throw Error("swarm", "a personal best in its state costs NaN, expected a number");
  if (blocks_of(static_cast<std::size_t>(std::max(options_.particles, 1))) * kSwarmBlock != p)
    throw Error("swarm", "a state of " + std::to_string(p) + " particles, expected " + std::to_string(options_.particles));
  const auto expect = [](bool good, const char* name, double value, const char* expected) {
    if (!good) throw Error("swarm", std::string(name) + " is " + text::to_text(value) + ", expected " + expected);
  };
  expect(options_.rounds >= 0, "rounds", options_.rounds, "at least 0");
  expect(std::isfinite(options_.inertia), "inertia", options_.inertia, "a finite number");
  expect(std::isfinite(options_.cognitive), "cognitive", options_.cognitive, "a finite number");
  expect(std::isfinite(options_.social), "social", options_.social, "a finite number");
  expect(options_.neighbours >= 0, "neighbours", options_.neighbours, "at least 0");
  expect(options_.stagnation_rounds >= 0, "stagnation_rounds", options_.stagnation_rounds, "at least 0");
  expect(options_.spread >= 0, "spread", options_.spread, "at least 0");
  expect(!std::isnan(options_.threshold), "threshold", options_.threshold, "a number");
}

SwarmStatus Swarm::status() const {
  if (state_.round > 0 && best_cost() <= options_.threshold) return SwarmStatus::kThreshold;
  return state_.round >= static_cast<std::uint32_t>(options_.rounds) ? SwarmStatus::kRounds : SwarmStatus::kRunning;
}

SwarmStatus Swarm::run(Threads* threads) {
  while (round(threads) == SwarmStatus::kRunning) {
  }
  return status();
}

void Swarm::set_together(Prepare prepare, std::function<void()> together) {
  prepare_ = std::move(prepare);
  together_ = std::move(together);
}

SwarmStatus Swarm::round(Threads* threads) {
  if (const SwarmStatus before = status(); before != SwarmStatus::kRunning) return before;
  SwarmState& s = state_;
  const bool move = s.round > 0 && !s.stagnated;
  if (s.stagnated) reconfigure();
  const std::size_t blocks = s.particles / kSwarmBlock;
  const auto all_blocks = [&](const auto& work) {
    if (threads && threads->threads() > 1)
      threads->run(blocks, std::cref(work));
    else
      for (std::size_t block = 0; block < blocks; ++block) work(block);
  };
  if (prepare_) {
    all_blocks([this, move](std::size_t block) {
      if (move) move_block(block);
      prepare_(block, state_.x.data() + block * kSwarmBlock, state_.particles);
    });
    together_();
  }
  all_blocks([this, move = move && !prepare_](std::size_t block) {
    if (move) move_block(block);
    evaluate_block(block);
  });
  remember();
  inform();
  s.history.push_back(best_cost());
  ++s.round;
  s.stagnated = stagnates();
  return status();
}

void Swarm::move_block(std::size_t block) {
  SwarmState& s = state_;
  kernels().move({s.dimensions, s.particles, block * kSwarmBlock, options_.seed, s.round, options_.inertia, options_.cognitive,
                  options_.social, s.lower.data(), s.upper.data(), s.best_x.data(), informant_.data(), s.x.data(), s.v.data()});
}

void Swarm::evaluate_block(std::size_t block) {
  const std::size_t first = block * kSwarmBlock;
  cost_(block, kSwarmBlock, state_.x.data() + first, state_.particles, state_.cost.data() + first);
  for (std::size_t k = first; k < first + kSwarmBlock; ++k)
    if (std::isnan(state_.cost[k])) state_.cost[k] = kInfinity;
}

void Swarm::remember() {
  SwarmState& s = state_;
  for (std::size_t k = 0; k < s.particles; ++k) {
    if (s.round > 0 && !(s.cost[k] < s.best_cost[k])) continue;
    s.best_cost[k] = s.cost[k];
    for (std::size_t i = 0; i < s.dimensions; ++i) s.best_x[i * s.particles + k] = s.x[i * s.particles + k];
  }
  for (std::size_t k = 0; k < s.particles; ++k)
    if (s.best_cost[k] < s.best_cost[s.leader]) s.leader = k;
}

void Swarm::inform() {
  const SwarmState& s = state_;
  const std::size_t reach = static_cast<std::size_t>(options_.neighbours);
  for (std::size_t k = 0; k < s.particles; ++k) {
    std::size_t best = k;
    if (reach == 0 || 2 * reach + 1 >= s.particles) {
      best = s.leader;
    } else {
      for (std::size_t j = 0; j <= 2 * reach; ++j) {
        const std::size_t other = (k + s.particles + j - reach) % s.particles;
        if (s.best_cost[other] < s.best_cost[best]) best = other;
      }
    }
    informant_[k] = static_cast<std::uint32_t>(best);
  }
}

bool Swarm::stagnates() const {
  const SwarmState& s = state_;
  const auto window = static_cast<std::uint32_t>(options_.stagnation_rounds);
  if (window == 0 || s.round < s.last_reconfiguration + window + 1) return false;
  const double before = s.history[s.round - 1 - window], now = s.history[s.round - 1];
  return !(before - now > options_.stagnation_rate * window * std::abs(before));
}

void Swarm::reconfigure() {
  SwarmState& s = state_;
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  std::sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) {
    return s.best_cost[a] != s.best_cost[b] ? s.best_cost[a] < s.best_cost[b] : a < b;
  });
  for (std::size_t i = 0; i < s.dimensions; ++i)
    for (std::size_t k = 0; k < s.particles; ++k) {
      const std::size_t centre = k % 2 == 0 ? s.leader : order_[k / 2];
      centres_[i * s.particles + k] = s.best_x[i * s.particles + centre];
    }
  for (std::size_t k = 0; k < s.particles; ++k) {
    const bool leads = k == s.leader;
    if (!leads) s.best_cost[k] = kInfinity;
    for (std::size_t i = 0; i < s.dimensions; ++i) {
      const std::size_t at = i * s.particles + k;
      const Key key = key_of(options_.seed, kReconfiguration, s.round, k, 2 * i);
      const Key other = key_of(options_.seed, kReconfiguration, s.round, k, 2 * i + 1);
      const double away = leads ? 0 : s.spread[i] * normal(key);
      s.x[at] = std::clamp((leads ? s.best_x[at] : centres_[at]) + away, s.lower[i], s.upper[i]);
      s.v[at] = 0.5 * s.spread[i] * normal(other);
    }
  }
  s.last_reconfiguration = s.round;
  ++s.reconfigurations;
  s.stagnated = false;
}

void Swarm::best(std::span<double> x) const {
  for (std::size_t i = 0; i < state_.dimensions; ++i) x[i] = state_.best_x[i * state_.particles + state_.leader];
}

void Swarm::change_coordinates(std::span<const double> A, std::span<const double> b, std::vector<double> lower,
                               std::vector<double> upper, std::vector<double> spread) {
  SwarmState& s = state_;
  const std::size_t d = s.dimensions;
  if (A.size() != d * d || b.size() != d || lower.size() != d || upper.size() != d || spread.size() != d)
    throw Error("swarm", "a change of coordinates of other than " + std::to_string(d) + " dimensions");
  std::vector<double> before(d);
  const auto turn = [&](std::vector<double>& x, bool position) {
    for (std::size_t k = 0; k < s.particles; ++k) {
      for (std::size_t i = 0; i < d; ++i) before[i] = x[i * s.particles + k] - (position ? b[i] : 0.0);
      for (std::size_t i = 0; i < d; ++i) {
        double y = 0;
        for (std::size_t j = 0; j < d; ++j) y += A[i * d + j] * before[j];
        x[i * s.particles + k] = y;
      }
    }
  };
  turn(s.x, true);
  turn(s.best_x, true);
  turn(s.v, false);
  s.lower = std::move(lower);
  s.upper = std::move(upper);
  s.spread = std::move(spread);
}

}  // namespace cotwin::numerics
