#include "models/optimisation/growth/growth.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <numeric>

#include "models/foundation/support/error.h"

namespace cotwin::optimisation {

namespace {

constexpr std::size_t kSlots = 16;  // parts of a batch, each of one thread
constexpr std::size_t kPerSlot = 512, kPerSlotOfDevice = 16384;
constexpr std::uint32_t kForDevice = 1000000;  // motions that are worth the second in which a device is opened
constexpr int kFine = 44;                      // bits of a number below its sign, exponent and eight bits of its mantissa
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

/// What one thread finds of some motions, in their order.
struct Slot {
  std::unique_ptr<Evaluator::Scratch> scratch;
  Motions motions;
  Values values;
  std::vector<double> kinematic, torque, costs;  // costs: of motion k at [k · terms]
  std::vector<std::size_t> worst;                // bound · n + joint
  std::vector<char> promising;                   // may belong to the front
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
  Motions m = room_for(problem);
  draw(problem, options, number, m, 0);
  const auto own = [](const std::vector<double>& lanes) {
    std::vector<double> values;
    for (std::size_t i = 0; i < lanes.size(); i += kLanes) values.push_back(lanes[i]);
    return values;
  };
  Round::Particle p;
  p.number = number;
  p.q_from = own(m.q_from);
  p.q_to = own(m.q_to);
  p.c = own(m.c);
  p.T = m.T[0];
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
  std::unique_ptr<DeviceJudge> judge;
  const auto without_device = [&](const numerics::DeviceError& error) {
    if (o.device == DeviceUse::kGpu) throw error;
    judge.reset();
    h.not_device = error.what();
  };
  if (o.device == DeviceUse::kGpu || (o.device == DeviceUse::kAuto && o.motions >= kForDevice)) {
    try {
      judge = std::make_unique<DeviceJudge>(evaluator, o, kSlots * kPerSlotOfDevice, device_for(o.device));
      h.device = judge->device();
      h.rounding = judge->rounding();
    } catch (const numerics::DeviceError& error) {
      without_device(error);
    }
  }
  const std::size_t per_slot = judge ? kPerSlotOfDevice : kPerSlot;
  std::vector<Slot> slots(std::min<std::size_t>(kSlots, (o.motions + per_slot - 1) / per_slot));
  for (Slot& s : slots) {
    s.scratch = evaluator.scratch();
    s.motions = evaluator.motions();
    s.values = evaluator.values();
  }

  std::uint32_t first = 0;  // of the batch
  Verdicts verdicts;        // of the batch; empty without a device
  const auto evaluate = [&](std::size_t slot) {
    Slot& s = slots[slot];
    const std::size_t begin = slot * per_slot, count = std::min<std::size_t>(per_slot, o.motions - first - begin);
    for (auto* list : {&s.kinematic, &s.torque}) list->resize(count);
    s.costs.resize(count * terms);
    s.worst.resize(count);
    s.promising.resize(count);
    std::array<std::size_t, kLanes> places{};  // of the motions in the lanes
    s.motions.count = 0;
    const auto evaluate_lanes = [&] {
      evaluator.evaluate(s.motions, *s.scratch, s.values);
      for (std::size_t lane = 0; lane < s.motions.count; ++lane) {
        const std::size_t k = places[lane];
        s.kinematic[k] = s.values.kinematic[lane];
        s.torque[k] = s.values.torque[lane];
        s.worst[k] = static_cast<std::size_t>(s.values.worst[lane].bound) * n + s.values.worst[lane].joint;
        for (std::size_t term = 0; term < terms; ++term)
          s.costs[k * terms + term] =
              s.values.pruned[lane] ? std::numeric_limits<double>::quiet_NaN() : s.values.costs[term * kLanes + lane];
      }
      s.motions.count = 0;
    };
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t at = begin + k;
      if (verdicts.count() > 0 && !verdicts.open(at)) {
        s.kinematic[k] = verdicts.kinematic(at);
        s.torque[k] = verdicts.torque(at);
        s.worst[k] = verdicts.worst(at);
        for (std::size_t term = 0; term < terms; ++term) s.costs[k * terms + term] = verdicts.cost(term, at);
        continue;
      }
      places[s.motions.count] = k;
      draw(problem, o, static_cast<std::uint32_t>(first + at), s.motions, s.motions.count);
      if (++s.motions.count == kLanes) evaluate_lanes();
    }
    if (s.motions.count > 0) evaluate_lanes();
    for (std::size_t k = 0; k < count; ++k) {
      const double* const costs = s.costs.data() + k * terms;
      s.promising[k] =
          s.kinematic[k] == 0 && s.torque[k] == 0 && terms > 1 && !front.covers({costs, static_cast<std::size_t>(terms)});
    }
  };
  const auto take = [&](const Slot& s, std::size_t k, std::uint32_t number) {
    ++h.motions;
    if (s.kinematic[k] != 0 || s.torque[k] != 0) {
      ++h.forbidden[s.worst[k]];
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
  const auto batch_from = [&](std::size_t begin) { return std::min(kSlots * per_slot, o.motions - begin); };
  const auto on_device = [&](auto&& work) {
    if (!judge) return;
    try {
      work();
    } catch (const numerics::DeviceError& error) {
      without_device(error);
    }
  };
  on_device([&] { judge->start(0, batch_from(0)); });
  while (first < o.motions) {
    const std::size_t count = batch_from(first), next = first + count;
    verdicts.clear();
    on_device([&] {
      judge->finish(verdicts);
      if (next < o.motions) judge->start(static_cast<std::uint32_t>(next), batch_from(next));
    });
    threads->run((count + per_slot - 1) / per_slot, evaluate);
    Round round;
    for (std::size_t i = 0; i < count; ++i) {
      const Slot& s = slots[i / per_slot];
      const std::size_t k = i % per_slot;
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
