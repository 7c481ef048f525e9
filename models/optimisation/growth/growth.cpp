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

  void resize(std::size_t count, std::size_t terms) {
    kinematic.resize(count);
    torque.resize(count);
    costs.resize(count * terms);
    worst.resize(count);
    promising.resize(count);
  }
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

namespace {

/// Draws motions in batches: a device, if there is one, judges the next batch while threads look at what it found of this one and judge what it left.
class Growing {
 public:
  Growing(const Problem& problem, const GrowthOptions& options, numerics::Threads& threads)
      : problem_(problem), o_(options), threads_(threads), evaluator_(problem), terms_(problem.costs.size()), best_(terms_) {
    h_.forbidden.resize(5 * evaluator_.joints());
    h_.costs.resize(terms_);
    h_.goals.assign(o_.to.list.size(), {0, std::vector<double>(terms_, std::numeric_limits<double>::infinity())});
    if (o_.device == DeviceUse::kGpu || (o_.device == DeviceUse::kAuto && o_.motions >= kForDevice))
      try_device([&] {
        judge_ = std::make_unique<DeviceJudge>(evaluator_, o_, kSlots * kPerSlotOfDevice, device_for(o_.device));
        h_.device = judge_->device();
        h_.rounding = judge_->rounding();
      });
    per_slot_ = judge_ ? kPerSlotOfDevice : kPerSlot;
    slots_.resize(std::min<std::size_t>(kSlots, (o_.motions + per_slot_ - 1) / per_slot_));
    for (Slot& s : slots_) {
      s.scratch = evaluator_.scratch();
      s.motions = evaluator_.motions();
      s.values = evaluator_.values();
    }
  }

  Harvest run() {
    begin_on_device(0);
    for (first_ = 0; first_ < o_.motions; first_ += count_) {
      count_ = batch_from(first_);
      verdicts_.clear();
      if (judge_) try_device([&] { judge_->finish(verdicts_); });
      begin_on_device(first_ + count_);
      threads_.run((count_ + per_slot_ - 1) / per_slot_, [&](std::size_t slot) { evaluate(slot); });
      take_batch();
      if (o_.on_progress) o_.on_progress(static_cast<std::uint32_t>(first_ + count_));
    }
    choose_best();
    return std::move(h_);
  }

 private:
  struct Candidate {
    double cost;
    std::uint32_t number;
    auto operator<=>(const Candidate&) const = default;
  };

  /// Does without the device if it fails.
  template <class Work>
  void try_device(Work work) {
    try {
      work();
    } catch (const numerics::DeviceError& error) {
      if (o_.device == DeviceUse::kGpu) throw;
      judge_.reset();
      h_.not_device = error.what();
    }
  }

  std::size_t batch_from(std::size_t begin) const { return std::min(kSlots * per_slot_, o_.motions - begin); }

  void begin_on_device(std::size_t first) {
    if (judge_ && first < o_.motions) try_device([&] { judge_->start(static_cast<std::uint32_t>(first), batch_from(first)); });
  }

  /// Finds the values of the motions of a slot, from the device or by the evaluator.
  void evaluate(std::size_t slot) {
    Slot& s = slots_[slot];
    const std::size_t begin = slot * per_slot_, count = std::min(per_slot_, count_ - begin);
    s.resize(count, terms_);
    std::array<std::size_t, kLanes> places{};  // of the motions in the lanes
    s.motions.count = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t at = begin + k;
      if (verdicts_.count() > 0 && !verdicts_.open(at)) {
        s.kinematic[k] = verdicts_.kinematic(at);
        s.torque[k] = verdicts_.torque(at);
        s.worst[k] = verdicts_.worst(at);
        for (std::size_t term = 0; term < terms_; ++term) s.costs[k * terms_ + term] = verdicts_.cost(term, at);
        continue;
      }
      places[s.motions.count] = k;
      draw(problem_, o_, static_cast<std::uint32_t>(first_ + at), s.motions, s.motions.count);
      if (++s.motions.count == kLanes) evaluate_lanes(s, places);
    }
    evaluate_lanes(s, places);
    for (std::size_t k = 0; k < count; ++k)
      s.promising[k] =
          s.kinematic[k] == 0 && s.torque[k] == 0 && terms_ > 1 && !front_.covers({s.costs.data() + k * terms_, terms_});
  }

  void evaluate_lanes(Slot& s, const std::array<std::size_t, kLanes>& places) const {
    if (s.motions.count == 0) return;
    evaluator_.evaluate(s.motions, *s.scratch, s.values);
    for (std::size_t lane = 0; lane < s.motions.count; ++lane) {
      const std::size_t k = places[lane];
      s.kinematic[k] = s.values.kinematic[lane];
      s.torque[k] = s.values.torque[lane];
      s.worst[k] = static_cast<std::size_t>(s.values.worst[lane].bound) * evaluator_.joints() + s.values.worst[lane].joint;
      for (std::size_t term = 0; term < terms_; ++term)
        s.costs[k * terms_ + term] =
            s.values.pruned[lane] ? std::numeric_limits<double>::quiet_NaN() : s.values.costs[term * kLanes + lane];
    }
    s.motions.count = 0;
  }

  void take_batch() {
    Round round;
    for (std::size_t i = 0; i < count_; ++i) {
      const Slot& s = slots_[i / per_slot_];
      const std::size_t k = i % per_slot_;
      const auto number = static_cast<std::uint32_t>(first_ + i);
      take(s, k, number);
      if (!o_.on_batch) continue;
      Round::Particle& p = round.particles.emplace_back(grown(problem_, o_, number));
      p.kinematic = s.kinematic[k];
      p.torque = s.torque[k];
      p.costs.assign(s.costs.data() + k * terms_, s.costs.data() + (k + 1) * terms_);
      if (round.particles.size() < kSlots * kPerSlot && i + 1 < count_) continue;
      o_.on_batch(round);
      round.particles.clear();
    }
  }

  void take(const Slot& s, std::size_t k, std::uint32_t number) {
    ++h_.motions;
    if (s.kinematic[k] != 0 || s.torque[k] != 0) {
      ++h_.forbidden[s.worst[k]];
      return;
    }
    ++h_.feasible;
    const double* const costs = s.costs.data() + k * terms_;
    for (std::size_t term = 0; term < terms_; ++term) {
      h_.costs[term].add(costs[term]);
      auto& own = best_[term];
      const Candidate candidate{costs[term], number};
      // Twice as many as are wanted, since assess() may find some infeasible.
      if (own.size() == 2 * o_.best && !(candidate < own.back())) continue;
      if (own.size() == 2 * o_.best) own.pop_back();
      own.insert(std::ranges::upper_bound(own, candidate), candidate);
    }
    if (!h_.goals.empty()) {
      Harvest::Goal& goal = h_.goals[number % h_.goals.size()];
      ++goal.feasible;
      for (std::size_t term = 0; term < terms_; ++term) goal.least[term] = std::min(goal.least[term], costs[term]);
    }
    if (!s.promising[k]) return;
    Round::Particle particle;
    particle.number = number;
    particle.costs.assign(costs, costs + terms_);
    front_.add(particle);
  }

  /// Motions as assess() sees them at no fewer samples than Problem has by itself, without those that it finds infeasible.
  std::vector<Round::Particle> assessed(const std::vector<std::uint32_t>& numbers) const {
    std::vector<std::optional<Round::Particle>> all(numbers.size());
    threads_.run(numbers.size(), [&](std::size_t k) {
      Round::Particle p = grown(problem_, o_, numbers[k]);
      Problem exact = problem_;
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
  }

  void choose_best() {
    std::vector<std::uint32_t> numbers;
    for (std::size_t term = 0; term < terms_; ++term) {
      numbers.clear();
      for (const Candidate& candidate : best_[term]) numbers.push_back(candidate.number);
      std::vector<Round::Particle>& kept = h_.best.emplace_back(assessed(numbers));
      std::ranges::sort(kept, {}, [&](const Round::Particle& p) { return std::pair(p.costs[term], p.number); });
      if (kept.size() > o_.best) kept.resize(o_.best);
    }
    numbers.clear();
    for (const Round::Particle& member : front_.members()) numbers.push_back(static_cast<std::uint32_t>(member.number));
    Archive checked;
    for (const Round::Particle& particle : assessed(numbers)) checked.add(particle);
    h_.front = checked.members();
  }

  const Problem& problem_;
  const GrowthOptions& o_;
  numerics::Threads& threads_;
  Evaluator evaluator_;
  std::size_t terms_;
  Harvest h_;
  Archive front_{kFront};
  std::vector<std::vector<Candidate>> best_;  // of each cost, ascending
  std::unique_ptr<DeviceJudge> judge_;
  Verdicts verdicts_;  // of the batch; empty without a device
  std::size_t per_slot_ = 0, first_ = 0, count_ = 0;
  std::vector<Slot> slots_;
};

}  // namespace

Harvest grow(const Problem& problem, const GrowthOptions& options, numerics::Threads* threads) {
  check(problem, options);
  numerics::Threads alone(1);
  return Growing(problem, options, threads ? *threads : alone).run();
}

}  // namespace cotwin::optimisation
