#include "master/engine/coupling/group_solver.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "master/engine/coupling/held_rules.h"
#include "master/engine/coupling/step_growth.h"
#include "master/engine/wiring/arrangement.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

constexpr double kIncrement = 1e-4;     // of an unknown for the Jacobian, relative to its scale
constexpr double kNoiseOfSteps = 1e-9;  // of units that choose their own steps, relative
constexpr double kSolverNoise = 1e-5;   // of units that iterate to a tolerance of their own, relative
constexpr double kMostRelaxed = 1e-2;   // tolerance of Newton's method / that of the scenario
constexpr std::int64_t kShort = 16;     // full step / short step, to find inputs that act without delay
constexpr double kNoDelay = 0.25;       // smallest change in the short step / change in the full step of such an input

/// Largest magnitude of the eigenvalues of `power`, by Gelfand's formula: ‖A^k‖^(1/k). Changes its arguments.
double spectral_radius(Eigen::MatrixXd& power, Eigen::MatrixXd& square) {
  const int squarings = power.rows() <= 64 ? 14 : 8;
  double log_norm = 0, share = 1;  // log ‖A^k‖ · share, k = 1/share
  for (int i = 0;; ++i) {
    const double norm = power.norm();
    if (norm == 0) return 0;
    log_norm += std::log(norm) * share;
    if (i == squarings) return std::exp(log_norm);
    power /= norm;
    square.noalias() = power * power;
    power.swap(square);
    share /= 2;
  }
}

Eigen::Index index(std::size_t i) { return static_cast<Eigen::Index>(i); }

std::string place_of(const std::string& names, Time t) { return names + " at t = " + text::to_text(t.seconds()) + " s"; }

std::vector<std::size_t> members_of(std::span<const ScheduledUnit> slots) {
  std::vector<std::size_t> members;
  for (const ScheduledUnit& slot : slots) members.push_back(slot.member);
  return members;
}

}  // namespace

GroupSolver::GroupSolver(std::span<ScheduledUnit> slots, std::span<const Member> members,
                         const std::vector<ResolvedConnection>& links, Bonds& bonds, double tolerance)
    : slots_(slots),
      members_(members),
      bonds_(bonds),
      units_(slots.size()),
      newton_(index(count_unknowns(links, members_of(slots)))),
      guess_(newton_.jacobian().rows()) {
  const auto slot_of = [&](std::size_t member) {
    const auto found = std::ranges::find_if(slots, [&](const ScheduledUnit& slot) { return slot.member == member; });
    return static_cast<std::size_t>(found - slots.begin());
  };
  const Eigen::Index n = newton_.jacobian().rows();
  x_ = first_x_ = probe_ = changed_ = y_ = Eigen::VectorXd::Zero(n);
  scale_ = Eigen::VectorXd::Zero(n);
  power_ = square_ = Eigen::MatrixXd::Zero(n, n);
  for (const ResolvedConnection& link : links) {
    const std::size_t to = slot_of(link.to.member), from = slot_of(link.from.member);
    if (to == slots.size() || link.initial) continue;
    if (from != slots.size() && is_continuous(link)) add(link, from, to);
  }
  find_outside();
  for (std::size_t i = 0; i < slots.size(); ++i) {
    units_[i].metered = bonds.meters(slots[i].member);
    units_[i].local = dynamic_cast<LocalMemory*>(slots[i].unit);
  }
  limits_.tolerance = std::max(limits_.tolerance, kMostRelaxed * tolerance);
  limits_.noise = kNoiseOfSteps;
  limits_.stagnant = kSolverNoise;
}

void GroupSolver::add(const ResolvedConnection& link, std::size_t from, std::size_t to) {
  const std::span<double> sources = link.from.reals(), targets = link.to.reals();
  const std::span<double> rate = link.to.variable->rate;
  for (std::size_t e = 0; e < sources.size(); ++e) {
    auto known = std::ranges::find_if(unknowns_, [&](const Unknown& u) { return u.value == &sources[e]; });
    if (known == unknowns_.end()) {
      scale_[index(unknowns_.size())] = magnitude_of(*link.from.variable);
      units_[from].outputs.push_back(unknowns_.size());
      unknowns_.push_back({&sources[e], link.derivative.empty() ? nullptr : &link.derivative[e], {}});
      known = unknowns_.end() - 1;
    }
    std::vector<std::size_t>& readers = known->readers;
    if (!std::ranges::binary_search(readers, to)) readers.insert(std::ranges::upper_bound(readers, to), to);
    const bool held = rate.empty();
    units_[to].inputs.push_back({&targets[e], held ? nullptr : &rate[link.to.first + e],
                                 static_cast<std::size_t>(known - unknowns_.begin()), link.factor, link.offset});
    holds_ = holds_ || held;
  }
}

/// Ramped inputs that no unknown feeds: connections from outside, and events.
void GroupSolver::find_outside() {
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    for (const Variable& v : members_[slots_[i].member].variables()) {
      for (std::size_t e = 0; e < v.rate.size(); ++e) {
        double* const to = &v.reals()[e];
        const bool fed = std::ranges::any_of(units_[i].inputs, [&](const Input& input) { return input.to == to; });
        if (!fed) outside_.push_back({to, &v.rate[e]});
      }
    }
  }
}

void GroupSolver::prepare() {
  for (std::size_t i = 0; i < slots_.size(); ++i) save_slot(i);
}

std::string GroupSolver::names() const {
  std::string names;
  for (const ScheduledUnit& slot : slots_) text::append(names, members_[slot.member].name());
  return names;
}

void GroupSolver::save_slot(std::size_t i) {
  PerSlot& unit = units_[i];
  const Variables& variables = members_[slots_[i].member].variables();
  if (unit.local == nullptr) return unit.begin.take(variables, *slots_[i].unit);
  unit.begin.take(variables);
  unit.local->save_local_memory(unit.memory);
}

void GroupSolver::restore_slot(std::size_t i) {
  if (!units_[i].moved) return;
  const Member& member = members_[slots_[i].member];
  units_[i].moved = false;
  try {
    if (units_[i].local == nullptr) return units_[i].begin.restore(member.variables(), *slots_[i].unit);
    units_[i].begin.write(member.variables());
    slots_[i].unit->restore_memory(units_[i].memory);
    slots_[i].unit->restored();
  } catch (const Error& error) {
    const bool failed = discarded_ == &slots_[i] && !error_.empty();  // the error that made it lose its state
    throw Error(place_of(member.name(), begin_), without_component(member.name(), failed ? error_ : error.what()));
  }
}

void GroupSolver::restore_all() {
  for (std::size_t i = 0; i < slots_.size(); ++i) restore_slot(i);
}

void GroupSolver::set_inputs(PerSlot& unit, const Eigen::VectorXd& x, Duration h) {
  for (const Input& input : unit.inputs) {
    const double end = input.at_end(x);
    if (input.rate != nullptr) {
      *input.to = input.begin;
      *input.rate = (end - input.begin) / h.seconds();
    } else {
      *input.to = input.share * end + (1 - input.share) * input.begin;
    }
  }
}

/// Steps a unit from the beginning of the part with the inputs that belong to x. Returns false if it cannot.
bool GroupSolver::step_slot(std::size_t i, const Eigen::VectorXd& x, Duration h) {
  PerSlot& unit = units_[i];
  restore_slot(i);
  set_inputs(unit, x, h);
  if (unit.metered) bonds_.begin(slots_[i].member, h);
  unit.moved = true;
  ++counts_.evaluations;
  error_.clear();
  try {
    if (seconds_.empty()) {
      unit.result = slots_[i].unit->step(begin_, h);
    } else {
      const auto before = SteadyClock::now();
      unit.result = slots_[i].unit->step(begin_, h);
      seconds_[i] += std::chrono::duration<double>(SteadyClock::now() - before).count();
    }
  } catch (const Error& error) {
    error_ = error.what();
    unit.result = StepResult::kDiscard;
  }
  if (unit.result != StepResult::kDiscard) {
    look_for_maker(i);
    return true;
  }
  discarded_ = &slots_[i];
  return false;
}

/// Finds who made the first value that is not finite.
void GroupSolver::look_for_maker(std::size_t i) {
  if (maker_) return;
  for (const std::size_t k : units_[i].outputs) {
    if (std::isfinite(*unknowns_[k].value)) continue;
    if (has_moderate_inputs(members_[slots_[i].member])) maker_ = {i, k, *unknowns_[k].value};
    return;
  }
}

/// Newton's method tries values that no unit has to answer: the fault is a unit's only if the last values of the step before will do it.
void GroupSolver::confirm_maker() {
  maker_.reset();
  (void)evaluate(first_x_, changed_);
  restore_all();
}

bool GroupSolver::evaluate(const Eigen::VectorXd& x, Eigen::VectorXd& y) {
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (!step_slot(i, x, h_)) return false;
    for (const std::size_t k : units_[i].outputs) y[index(k)] = *unknowns_[k].value;
  }
  return true;
}

double GroupSolver::increment(std::size_t unknown) const { return kIncrement * scale_[index(unknown)]; }

/// Probes with held inputs at their values at the end of the step, then gives them their share of it. Without a rule that is the mean where
/// the loop is not stiff, so that the step is of second order; in stiff loops the end values damp what the step does not resolve.
bool GroupSolver::linearise(const Eigen::VectorXd& x, Eigen::VectorXd& y, Eigen::MatrixXd& jacobian) {
  bool changed = false;
  for (PerSlot& unit : units_) {
    for (Input& input : unit.inputs) {
      changed = changed || input.share != 1;
      input.share = 1;
    }
  }
  if (changed && !evaluate(x, y)) return false;
  if (!probe(x, y, jacobian)) return false;
  if (!holds_) return true;
  HeldRule rule{0.5, false};
  if (rule_.number >= 0) {
    rule = kHeldRules[rule_.number];
  } else {
    power_ = jacobian;
    if (!power_.allFinite() || spectral_radius(power_, square_) > kStiffGain) return true;
  }
  if (rule.share == 1) return true;
  hold_shares(rule.share, rule.all, x, jacobian);
  return evaluate(x, y);
}

/// The Jacobian by one step per unknown and unit that it feeds.
bool GroupSolver::probe(const Eigen::VectorXd& x, const Eigen::VectorXd& y, Eigen::MatrixXd& jacobian) {
  jacobian.setZero();
  probe_ = x;
  for (std::size_t j = 0; j < unknowns_.size(); ++j) {
    probe_[index(j)] += increment(j);
    for (const std::size_t i : unknowns_[j].readers) {
      if (!step_slot(i, probe_, h_)) return false;
      for (const std::size_t k : units_[i].outputs)
        jacobian(index(k), index(j)) = (*unknowns_[k].value - y[index(k)]) / (probe_[index(j)] - x[index(j)]);
    }
    probe_[index(j)] = x[index(j)];
  }
  return true;
}

/// Lets the units hold `share` of an unknown where all their outputs follow it with delay, or everywhere. The rest is the value at the
/// beginning of the step, which does not depend on x.
void GroupSolver::hold_shares(double share, bool all, const Eigen::VectorXd& x, Eigen::MatrixXd& jacobian) {
  for (std::size_t j = 0; j < unknowns_.size(); ++j) {
    const auto is_held = [&](const Input& input) { return input.unknown == j && input.rate == nullptr; };
    probe_[index(j)] += increment(j);
    for (const std::size_t i : unknowns_[j].readers) {
      if (std::ranges::none_of(units_[i].inputs, is_held) || !(all || acts_with_delay(x, j, i, jacobian))) continue;
      for (Input& input : units_[i].inputs) {
        if (is_held(input)) input.share = share;
      }
      for (const std::size_t k : units_[i].outputs) jacobian(index(k), index(j)) *= share;
    }
    probe_[index(j)] = x[index(j)];
  }
}

/// Compares the change of a unit's outputs after the step with that after a short step. Where it is no smaller, the outputs
/// depend on the input without delay, or the unit has come to rest within the step.
bool GroupSolver::acts_with_delay(const Eigen::VectorXd& x, std::size_t unknown, std::size_t slot,
                                  const Eigen::MatrixXd& jacobian) {
  const PerSlot& unit = units_[slot];
  const Duration h{h_.ns / kShort};
  const Eigen::Index j = index(unknown);
  if (h.ns == 0 || !step_slot(slot, probe_, h)) return false;
  for (const std::size_t k : unit.outputs) changed_[index(k)] = *unknowns_[k].value;
  if (!step_slot(slot, x, h)) return false;
  bool acts = false;
  for (const std::size_t k : unit.outputs) {
    const double full = std::abs(jacobian(index(k), j));
    const double in_short = std::abs((changed_[index(k)] - *unknowns_[k].value) / (probe_[j] - x[j]));
    if (in_short > kNoDelay * full) return false;
    acts = acts || full > 0;
  }
  return acts;
}

void GroupSolver::begin_part(Time begin, Time end) {
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    PerSlot& unit = units_[i];
    for (Input& input : unit.inputs) input.begin = *input.to;
    save_slot(i);
    unit.moved = false;
  }
  begin_ = begin;
  h_ = end - begin;
  for (std::size_t k = 0; k < unknowns_.size(); ++k) first_x_[index(k)] = *unknowns_[k].value;
  scale_ = scale_.cwiseMax(first_x_.cwiseAbs());
  x_ = first_x_;
  const int degree = continues(begin) && extrapolates_ ? guess_.degree() : 1;
  if (degree > 1) return guess_.advance(x_, degree);
  const double last = slots_.front().last_step.seconds();
  for (std::size_t k = 0; k < unknowns_.size(); ++k) {
    if (unknowns_[k].derivative != nullptr) {
      x_[index(k)] += *unknowns_[k].derivative * h_.seconds();
    } else if (degree == 1 && last > 0) {
      x_[index(k)] += guess_.last_change()[index(k)] * (h_.seconds() / last);
    }
  }
}

/// Whether the part that begins is as long as the last one, which ended there.
bool GroupSolver::continues(Time begin) const { return slots_.front().time == begin && slots_.front().last_step == h_; }

Newton::Outcome GroupSolver::step_part(Time begin, Time end) {
  begin_part(begin, end);
  discarded_ = nullptr;
  maker_.reset();
  const Newton::Outcome outcome = newton_.solve(*this, x_, scale_, limits_);
  counts_.iterations += newton_.iterations();
  counts_.linearisations += newton_.linearisations();
  if (outcome == Newton::Outcome::kConverged) {
    accept(end);
  } else {
    restore_all();
    if (maker_ && outcome != Newton::Outcome::kStopped) confirm_maker();
  }
  return outcome;
}

void GroupSolver::accept(Time end) {
  ++counts_.steps;
  for (std::size_t k = 0; k < unknowns_.size(); ++k) changed_[index(k)] = *unknowns_[k].value;
  guess_.add(first_x_, changed_, scale_, continues(begin_));
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    ScheduledUnit& slot = slots_[i];
    slot.last_step = h_;
    slot.time = end;
    if (units_[i].metered) bonds_.end(slot.member, h_);
    for (const Input& input : units_[i].inputs) *input.to = input.at_end(x_);
    if (units_[i].result == StepResult::kFinished && finished_ == nullptr) finished_ = &slot;
  }
  scale_ = scale_.cwiseMax(x_.cwiseAbs());
}

const ScheduledUnit* GroupSolver::step(Time begin, Time end, std::span<double> seconds) {
  seconds_ = seconds;
  finished_ = nullptr;
  for (Outside& outside : outside_) outside.begin = *outside.to;
  int halvings = std::max(rule_.least_halvings, halvings_ - 1);
  Time now = begin;
  while (now < end) {
    const Duration part{std::max<std::int64_t>(1, (end - begin).ns >> halvings)};
    const bool last = 2 * (end - now).ns < 3 * part.ns;
    const Newton::Outcome outcome = step_part(now, last ? end : now + part);
    if (outcome == Newton::Outcome::kConverged) {
      halvings_ = halvings;
      now = last ? end : now + part;
      for (const Outside& outside : outside_) *outside.to = outside.begin + *outside.rate * (now - begin).seconds();
      if (finished_ != nullptr) return nullptr;
      if (halvings > rule_.least_halvings) --halvings;
      continue;
    }
    if (halvings == kMostHalvings || part.ns == 1) {
      halvings_ = 0;
      return fail(outcome, now);
    }
    ++halvings;
    ++counts_.divided;
  }
  return nullptr;
}

const ScheduledUnit* GroupSolver::fail(Newton::Outcome outcome, Time at) const {
  if (outcome == Newton::Outcome::kStopped) {
    if (error_.empty()) return discarded_;
    const std::string& name = members_[discarded_->member].name();
    throw Error(place_of(name, at), without_component(name, error_));
  }
  if (maker_) throw Error(text_of_maker(at));
  const std::string place = place_of(names(), at);
  if (outcome == Newton::Outcome::kSingular)
    throw Error(place, "the values that they exchange have no solution, or more than one: the loop's gain is 1");
  throw Error(place, "the values that they exchange do not converge even at 1/" + std::to_string(1 << kMostHalvings) +
                         " of the step (" + text::to_text(newton_.worst(), 3) +
                         " relative at last): they have no solution, or one that is too far from the last step's");
}

std::string GroupSolver::text_of_maker(Time at) const {
  const Member& member = members_[slots_[maker_->slot].member];
  for (const Variable& v : member.variables()) {
    if (v.kind() != Kind::kReal) continue;
    const std::span<double> values = v.reals();
    for (std::size_t e = 0; e < values.size(); ++e)
      if (&values[e] == unknowns_[maker_->unknown].value)
        return not_finite(member, v, e, maker_->value, at.seconds()) + kOwnFault;
  }
  return "";
}

double GroupSolver::loop_gain(Time now, Duration h) {
  const LoopCounts counts = counts_;
  seconds_ = {};
  begin_part(now, now + h);
  const bool measured = evaluate(x_, y_) && probe(x_, y_, power_) && power_.allFinite();
  restore_all();
  counts_ = counts;
  return measured ? spectral_radius(power_, square_) : std::numeric_limits<double>::quiet_NaN();
}

std::size_t GroupSolver::state_size() const {
  const std::size_t n = unknowns_.size();
  std::size_t inputs = 0;
  for (const PerSlot& unit : units_) inputs += unit.inputs.size();
  return n * n + n + static_cast<std::size_t>(guess_.state_size()) + inputs + 4;
}

void GroupSolver::save(std::span<double> numbers) const {
  double* to = numbers.data();
  const auto put_all = [&](const auto& matrix) { to = std::copy_n(matrix.data(), matrix.size(), to); };
  put_all(newton_.jacobian());
  put_all(scale_);
  guess_.save({to, static_cast<std::size_t>(guess_.state_size())});
  to += guess_.state_size();
  for (const PerSlot& unit : units_) {
    for (const Input& input : unit.inputs) *to++ = input.share;
  }
  for (const int number : {newton_.known() ? 1 : 0, halvings_, rule_.number, rule_.least_halvings}) *to++ = number;
}

void GroupSolver::restore(std::span<const double> numbers) {
  const double* from = numbers.data();
  const auto get_all = [&](auto& matrix) {
    std::copy_n(from, matrix.size(), matrix.data());
    from += matrix.size();
  };
  get_all(newton_.jacobian());
  get_all(scale_);
  guess_.restore({from, static_cast<std::size_t>(guess_.state_size())});
  from += guess_.state_size();
  for (PerSlot& unit : units_) {
    for (Input& input : unit.inputs) input.share = std::clamp(*from++, 0.0, 1.0);
  }
  // A damaged checkpoint may have any number.
  const auto integer = [&](int low, int high, int otherwise) {
    const double number = *from++;
    return number >= low && number <= high ? static_cast<int>(number) : otherwise;
  };
  newton_.set_known(integer(0, 1, 0) == 1);
  halvings_ = integer(0, kMostHalvings, 0);
  rule_.number = integer(-1, kHeldRuleCount - 1, -1);
  rule_.least_halvings = integer(0, kMostRuleHalvings, 0);
}

}  // namespace cotwin::master
