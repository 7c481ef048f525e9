#include "models/optimisation/growth/growth.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <numeric>

#include "models/foundation/support/error.h"
#include "models/numerics/random.h"

namespace cotwin::optimisation {

namespace {

constexpr std::size_t kPerSlot = 512, kSlots = 16;  // motions that one thread takes at a time, and such parts of a batch
constexpr int kFine = 44;                           // bits of a number below its sign, exponent and eight bits of its mantissa
constexpr std::size_t kFront = 100;

std::uint64_t place_of(double magnitude) { return std::bit_cast<std::uint64_t>(magnitude) >> kFine; }
const std::uint64_t kFirst = place_of(0x1p-40), kSize = place_of(0x1p60) - kFirst;

/// Bins from those of the largest negative numbers to those of the largest positive ones; the one of zero is at kSize.
std::size_t bin_of(double x) {
  const std::uint64_t far = std::clamp(place_of(std::abs(x)), kFirst, kFirst + kSize) - kFirst;
  return static_cast<std::size_t>(std::signbit(x) ? kSize - far : kSize + far);
}
/// The lower edge of a bin.
double edge_of(std::size_t bin) {
  const auto magnitude = [](std::uint64_t far) { return far == 0 ? 0.0 : std::bit_cast<double>((far + kFirst) << kFine); };
  return bin >= kSize ? magnitude(bin - kSize) : -magnitude(kSize - bin + 1);
}

/// Numbers of one motion.
class Draws {
 public:
  Draws(std::uint64_t seed, std::uint32_t number)
      : key_{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)}, number_(number) {}
  /// Uniform in [0, 1), of 32 bits.
  double next() {
    if (at_ == 4) {
      words_ = numerics::philox({number_, block_++, kStream, 0}, key_);
      at_ = 0;
    }
    return words_[at_++] * 0x1p-32;
  }

 private:
  static constexpr std::uint32_t kStream = 0x67726f77;
  std::array<std::uint32_t, 2> key_;
  std::uint32_t number_, block_ = 0;
  std::array<std::uint32_t, 4> words_{};
  std::size_t at_ = 4;
};

/// Sets motion `number` through set_q_from(joint, x), set_q_to(joint, x), set_c(index, x); returns T.
template <class From, class To, class C>
double draw(const Problem& p, const GrowthOptions& o, std::uint32_t number, From set_q_from, To set_q_to, C set_c) {
  const std::size_t n = p.robot.joints.size(), K = static_cast<std::size_t>(p.degree - 5);
  const std::size_t goals = std::max<std::size_t>(o.to.list.size(), 1), starts = std::max<std::size_t>(o.from.list.size(), 1);
  Draws draws(o.seed, number);
  const double T = p.T_min == p.T_max ? p.T_min : std::min(p.T_min * std::pow(p.T_max / p.T_min, draws.next()), p.T_max);
  const double r = draws.next();
  const auto posture = [&](const PostureSet& set, std::size_t in_list, auto set_q) {
    for (std::size_t j = 0; j < n; ++j)
      set_q(j, set.list.empty() ? set.low[j] + draws.next() * (set.high[j] - set.low[j]) : set.list[in_list][j]);
  };
  posture(o.from, number / goals % starts, set_q_from);
  posture(o.to, number % goals, set_q_to);
  for (std::size_t j = 0; j < n; ++j)
    for (std::size_t k = 0; k < K; ++k) set_c(j * K + k, r * o.c_max[j] * (2 * draws.next() - 1));
  return T;
}

/// What one thread finds of some motions, in their order.
struct Slot {
  std::unique_ptr<Evaluator::Scratch> scratch;
  Motions motions;
  Values values;
  std::vector<double> kinematic, torque, costs;  // costs: of motion k at [k · terms]
  std::vector<Values::Excess> worst;
  std::vector<char> promising;  // may belong to the front
};

void check(const Problem& p, const GrowthOptions& o) {
  const std::size_t n = p.robot.joints.size();
  const auto fail = [](const std::string& why) { throw Error("growth", why); };
  if (o.motions == 0) fail("0 motions, expected at least one");
  if (!p.ends.at_rest()) fail("ends in motion, expected motions from rest to rest");
  if (p.compliant) fail("a compliant frame, expected motions of joints alone");
  for (const PostureSet* set : {&o.from, &o.to}) {
    for (const auto& posture : set->list)
      if (posture.size() != n)
        fail("a posture has " + std::to_string(posture.size()) + " values, expected " + std::to_string(n));
    if (!set->list.empty()) continue;
    if (set->low.size() != n || set->high.size() != n) fail("has neither postures nor a box, expected one of them");
    for (std::size_t j = 0; j < n; ++j)
      if (!(set->low[j] <= set->high[j] && std::isfinite(set->high[j] - set->low[j])))
        fail("the box of joint " + p.robot.joints[j].name + " is empty or infinite, expected finite bounds in ascending order");
  }
  if (o.c_max.size() != n) fail("has " + std::to_string(o.c_max.size()) + " ranges of coefficients, expected one per joint");
  for (const double c : o.c_max)
    if (!(c >= 0 && std::isfinite(c))) fail("a range of coefficients is negative or infinite, expected 0 or more");
}

}  // namespace

Distribution::Distribution() : bins_(2 * kSize + 1) {}

void Distribution::add(double x) {
  ++bins_[bin_of(x)];
  least_ = count_ == 0 ? x : std::min(least_, x);
  most_ = count_ == 0 ? x : std::max(most_, x);
  sum_ += x;
  ++count_;
}

double Distribution::quantile(double p) const {
  const double rank = p * static_cast<double>(count_);
  double below = 0;
  std::size_t bin = bin_of(least_);
  for (const std::size_t last = bin_of(most_); bin < last; ++bin) {
    if (below + bins_[bin] >= rank && bins_[bin] > 0) break;
    below += bins_[bin];
  }
  const double low = edge_of(bin), high = edge_of(bin + 1);
  return std::clamp(low + (high - low) * (rank - below) / bins_[bin], least_, most_);
}

Distribution::Intervals Distribution::intervals(std::size_t most) const {
  Intervals all;
  if (count_ == 0) return all;
  const std::size_t first = bin_of(least_), last = bin_of(most_), width = (last - first) / most + 1;
  for (std::size_t bin = first; bin <= last; bin += width) {
    const auto from = bins_.begin() + static_cast<std::ptrdiff_t>(bin);
    all.edges.push_back(edge_of(bin));
    all.counts.push_back(
        std::accumulate(from, from + static_cast<std::ptrdiff_t>(std::min(width, last + 1 - bin)), std::uint64_t{0}));
  }
  all.edges.push_back(edge_of(last + 1));
  return all;
}

Round::Particle grown(const Problem& problem, const GrowthOptions& options, std::uint32_t number) {
  const std::size_t n = problem.robot.joints.size();
  Round::Particle p;
  p.number = number;
  p.q_from.resize(n);
  p.q_to.resize(n);
  p.c.resize(n * static_cast<std::size_t>(problem.degree - 5));
  p.T = draw(
      problem, options, number, [&](std::size_t j, double x) { p.q_from[j] = x; },
      [&](std::size_t j, double x) { p.q_to[j] = x; }, [&](std::size_t i, double x) { p.c[i] = x; });
  return p;
}

Harvest grow(const Problem& problem, const GrowthOptions& o, numerics::Threads* threads) {
  check(problem, o);
  numerics::Threads alone(1);
  if (!threads) threads = &alone;
  const Evaluator evaluator(problem);
  const std::size_t n = evaluator.joints(), terms = problem.costs.size();
  Harvest h;
  h.forbidden.resize(5 * n);
  h.costs.resize(terms);
  h.goals.assign(o.to.list.size(), {0, std::vector<double>(terms, std::numeric_limits<double>::infinity())});
  Archive front(kFront);
  struct Candidate {
    double cost;
    std::uint32_t number;
    auto operator<=>(const Candidate&) const = default;
  };
  // Twice as many as are wanted, since assess() may find some infeasible.
  std::vector<std::vector<Candidate>> best(terms);
  std::vector<Slot> slots(std::min<std::size_t>(kSlots, (o.motions + kPerSlot - 1) / kPerSlot));
  for (Slot& s : slots) {
    s.scratch = evaluator.scratch();
    s.motions = evaluator.motions();
    s.values = evaluator.values();
  }

  std::uint32_t first = 0;  // of the batch
  const auto evaluate = [&](std::size_t slot) {
    Slot& s = slots[slot];
    for (auto* list : {&s.kinematic, &s.torque, &s.costs}) list->clear();
    s.worst.clear();
    s.promising.clear();
    const std::uint64_t begin = first + slot * kPerSlot, end = std::min<std::uint64_t>(begin + kPerSlot, o.motions);
    for (std::uint64_t at = begin; at < end; at += kLanes) {
      s.motions.count = std::min<std::size_t>(kLanes, end - at);
      for (std::size_t lane = 0; lane < s.motions.count; ++lane)
        s.motions.T[lane] = draw(
            problem, o, static_cast<std::uint32_t>(at + lane),
            [&](std::size_t j, double x) { s.motions.q_from[j * kLanes + lane] = x; },
            [&](std::size_t j, double x) { s.motions.q_to[j * kLanes + lane] = x; },
            [&](std::size_t i, double x) { s.motions.c[i * kLanes + lane] = x; });
      evaluator.evaluate(s.motions, *s.scratch, s.values);
      for (std::size_t lane = 0; lane < s.motions.count; ++lane) {
        s.kinematic.push_back(s.values.kinematic[lane]);
        s.torque.push_back(s.values.torque[lane]);
        s.worst.push_back(s.values.worst[lane]);
        for (std::size_t term = 0; term < terms; ++term)
          s.costs.push_back(s.values.pruned[lane] ? std::numeric_limits<double>::quiet_NaN()
                                                  : s.values.costs[term * kLanes + lane]);
        const bool feasible = s.kinematic.back() == 0 && s.torque.back() == 0;
        s.promising.push_back(feasible && terms > 1 &&
                              !front.covers({s.costs.end() - static_cast<std::ptrdiff_t>(terms), s.costs.end()}));
      }
    }
  };
  const auto take = [&](const Slot& s, std::size_t k, std::uint32_t number) {
    ++h.motions;
    if (s.kinematic[k] != 0 || s.torque[k] != 0) {
      ++h.forbidden[static_cast<std::size_t>(s.worst[k].bound) * n + s.worst[k].joint];
      return;
    }
    ++h.feasible;
    const double* const costs = s.costs.data() + k * terms;
    for (std::size_t term = 0; term < terms; ++term) {
      h.costs[term].add(costs[term]);
      auto& own = best[term];
      const Candidate candidate{costs[term], number};
      if (own.size() == 2 * o.best && !(candidate < own.back())) continue;
      if (own.size() == 2 * o.best) own.pop_back();
      own.insert(std::ranges::upper_bound(own, candidate), candidate);
    }
    if (!h.goals.empty()) {
      Harvest::Goal& goal = h.goals[number % h.goals.size()];
      ++goal.feasible;
      for (std::size_t term = 0; term < terms; ++term) goal.least[term] = std::min(goal.least[term], costs[term]);
    }
    if (!s.promising[k]) return;
    Round::Particle particle;
    particle.number = number;
    particle.costs.assign(costs, costs + terms);
    front.add(particle);
  };
  while (first < o.motions) {
    const std::size_t count = std::min<std::size_t>(kSlots * kPerSlot, o.motions - first);
    const std::size_t used = (count + kPerSlot - 1) / kPerSlot;
    threads->run(used, evaluate);
    Round round;
    for (std::size_t i = 0; i < count; ++i) {
      const Slot& s = slots[i / kPerSlot];
      const std::size_t k = i % kPerSlot;
      const auto number = static_cast<std::uint32_t>(first + i);
      take(s, k, number);
      if (!o.on_batch) continue;
      Round::Particle& p = round.particles.emplace_back(grown(problem, o, number));
      p.kinematic = s.kinematic[k];
      p.torque = s.torque[k];
      p.costs.assign(s.costs.begin() + static_cast<std::ptrdiff_t>(k * terms),
                     s.costs.begin() + static_cast<std::ptrdiff_t>((k + 1) * terms));
    }
    if (o.on_batch) o.on_batch(round);
    first += static_cast<std::uint32_t>(count);
    if (o.on_progress) o.on_progress(first);
  }

  const auto assessed = [&](const std::vector<std::uint32_t>& numbers) {
    std::vector<std::optional<Round::Particle>> all(numbers.size());
    threads->run(numbers.size(), [&](std::size_t k) {
      Round::Particle p = grown(problem, o, numbers[k]);
      Problem exact = problem;
      exact.samples = std::max(exact.samples, Problem().samples);
      exact.ends.q_from = p.q_from;
      const Solution found = assess(exact, p.c, p.q_to, p.T);
      p.costs = found.costs;
      if (found.status == Status::kFeasible) all[k] = std::move(p);
    });
    std::vector<Round::Particle> kept;
    for (auto& particle : all)
      if (particle) kept.push_back(std::move(*particle));
    return kept;
  };
  std::vector<std::uint32_t> numbers;
  for (std::size_t term = 0; term < terms; ++term) {
    numbers.clear();
    for (const Candidate& candidate : best[term]) numbers.push_back(candidate.number);
    std::vector<Round::Particle>& kept = h.best.emplace_back(assessed(numbers));
    std::ranges::sort(kept, {}, [&](const Round::Particle& p) { return std::pair(p.costs[term], p.number); });
    if (kept.size() > o.best) kept.resize(o.best);
  }
  numbers.clear();
  for (const Round::Particle& member : front.members()) numbers.push_back(static_cast<std::uint32_t>(member.number));
  Archive checked;
  for (const Round::Particle& particle : assessed(numbers)) checked.add(particle);
  h.front = checked.members();
  return h;
}

}  // namespace cotwin::optimisation
