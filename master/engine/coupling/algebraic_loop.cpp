#include "master/engine/coupling/algebraic_loop.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Newton::Limits kLimits{.iterations = 50, .tolerance = 1e-12, .weak = 1e-8};
constexpr Newton::Limits kSearchLimits{.iterations = 20, .tolerance = 1e-10, .weak = 1e-8};
constexpr Index kMostUnknowns = 3000;  // decomposing ∂y/∂x takes seconds
constexpr int kRescalings = 3;
constexpr int kMostRounds = 200;          // until connections of integers, booleans and strings do not change any more
constexpr double kProbeIncrement = 1e-4;  // of an unknown, relative: rounding of ∂y/∂x 1e-12; its curvature is left to Newton
constexpr double kSmallestMagnitude = 1e-2;
constexpr double kProbeLinear = 1e-6;       // error of a linear prediction, relative
constexpr double kProbeNoise = 1e-6;        // residual of a unit that computes its outputs inexactly
constexpr double kFarMove = 1e-2;           // relative to 1 + |x|: a first guess farther away from the solution tests linearity
constexpr double kClearlyDifferent = 1e-3;  // relative to 1 + |x|

VectorXd scale_of(const VectorXd& x) { return (1 + x.array().abs()).matrix(); }

double distance(const VectorXd& a, const VectorXd& b) { return (a - b).cwiseQuotient(scale_of(a)).cwiseAbs().maxCoeff(); }

/// A step of the magnitude of x, with alternating signs.
VectorXd far_step(const VectorXd& x) {
  VectorXd step = scale_of(x);
  for (Index i = 1; i < step.size(); i += 2) step[i] *= -0.7;
  return step;
}

}  // namespace

/// y(x) − x times m(x) = 1 + 1/‖x − known‖: the other solutions stay, `known` is none any more.
class AlgebraicLoop::Deflated final : public CoupledOutputs {
 public:
  Deflated(AlgebraicLoop& loop, VectorXd known) : loop_(loop), known_(std::move(known)), scale_(scale_of(known_)) {}

  bool evaluate(const VectorXd& x, VectorXd& y) override {
    if (!loop_.evaluate(x, y)) return false;
    y = x + factor(x) * (y - x);
    return true;
  }
  bool linearise(const VectorXd& x, VectorXd& y, MatrixXd& jacobian) override {
    const double m = factor(x);
    const VectorXd residual = (y - x) / m;
    VectorXd of_loop = x + residual;
    if (!loop_.linearise(x, of_loop, jacobian)) return false;
    const VectorXd gradient = -std::pow(m - 1, 3) * (x - known_).cwiseQuotient(scale_.cwiseProduct(scale_));
    jacobian *= m;
    jacobian.diagonal().array() += 1 - m;
    jacobian += residual * gradient.transpose();
    return true;
  }

 private:
  double factor(const VectorXd& x) const { return 1 + 1 / (x - known_).cwiseQuotient(scale_).norm(); }

  AlgebraicLoop& loop_;
  VectorXd known_, scale_;
};

AlgebraicLoop::AlgebraicLoop(const System& system, std::vector<std::size_t> slots)
    : system_(system), slots_(std::move(slots)), rows_(slots_.size()), stale_(slots_.size(), true) {
  for (std::size_t i = 0; i < slots_.size(); ++i) all_.push_back(i);
  std::vector<std::size_t> unit_of(system_.schedule.slots.size(), slots_.size());
  for (const std::size_t i : all_) unit_of[slots_[i]] = i;
  for (const ResolvedConnection& link : system_.links) {
    const std::size_t from = unit_of[system_.schedule.slot_of[link.from.member]];
    const std::size_t to = unit_of[system_.schedule.slot_of[link.to.member]];
    if (from < slots_.size() && to < slots_.size()) add(link, from, to);
  }
  scratch_.resize(static_cast<Index>(unknowns_.size()));
}

void AlgebraicLoop::add(const ResolvedConnection& link, std::size_t from, std::size_t to) {
  if (link.from.variable->kind() != Kind::kReal) {
    has_other_kinds_ = true;
    return;
  }
  const Member &source = system_.members[link.from.member], &target = system_.members[link.to.member];
  for (std::size_t e = 0; e < link.from.count; ++e) {
    const std::size_t output = link.from.first + e, input = link.to.first + e;
    double* const at = &link.from.variable->reals()[output];
    auto found = std::ranges::find(unknowns_, at, &Unknown::at);
    if (found == unknowns_.end()) {
      rows_[from].push_back(static_cast<Index>(unknowns_.size()));
      unknowns_.push_back({at,
                           element_name(source.name(), *link.from.variable, output),
                           link.from.variable->si,
                           element_name(target.name(), *link.to.variable, input),
                           source.start_of(*link.from.variable, output),
                           {}});
      found = unknowns_.end() - 1;
    }
    if (std::ranges::find(found->feeds, to) == found->feeds.end()) found->feeds.push_back(to);
    const std::optional<double> start = target.start_of(*link.to.variable, input);
    if (start && !found->given && link.factor != 0) found->given = (*start - link.offset) / link.factor;
  }
}

void AlgebraicLoop::swap_outputs(VectorXd& values) {
  for (Index i = 0; i < values.size(); ++i) std::swap(values[i], *unknowns_[static_cast<std::size_t>(i)].at);
}

/// Copies x, and the present values of other kinds, into the inputs of `units`. The outputs have x only meanwhile, because a
/// unit may leave an output as it is.
void AlgebraicLoop::update(const VectorXd& x, std::span<const std::size_t> units) {
  scratch_ = x;
  swap_outputs(scratch_);
  for (const std::size_t i : units) stale_[i] = system_.wiring.update(slots_[i]) || stale_[i];
  swap_outputs(scratch_);
}

void AlgebraicLoop::initialise(std::size_t unit) {
  stale_[unit] = true;
  system_.initialise(slots_[unit]);
  stale_[unit] = false;
}

/// Passes values of other kinds on until they do not change any more.
bool AlgebraicLoop::settle(const VectorXd& x) {
  for (int round = 0; round < kMostRounds; ++round) {
    bool changed = false;
    for (const std::size_t i : all_) {
      update(x, std::span(&i, 1));
      if (!stale_[i]) continue;
      initialise(i);
      changed = true;
    }
    if (!changed) return true;
  }
  return false;
}

/// Where a unit throws, y is not a number, and Newton's method makes a shorter step.
bool AlgebraicLoop::evaluate(const VectorXd& x, VectorXd& y) {
  ++evaluations_;
  at_ = x;
  try {
    update(x, all_);
    for (const std::size_t i : all_) {
      if (stale_[i]) initialise(i);
    }
    if (has_other_kinds_ && !settle(x))
      throw Error("its integers, booleans or strings change in each of " + std::to_string(kMostRounds) + " exchanges");
  } catch (const Error& error) {
    last_error_ = error.what();
    if (evaluations_ == 1) first_error_ = last_error_;
    y.setConstant(std::numeric_limits<double>::quiet_NaN());
    return true;
  }
  for (Index i = 0; i < y.size(); ++i) y[i] = *unknowns_[static_cast<std::size_t>(i)].at;
  return true;
}

/// Initialises the units that unknown j feeds with x[j] = moved. Returns false if a unit throws or an output is not finite.
bool AlgebraicLoop::probe(const VectorXd& x, Index j, double moved) {
  const Unknown& unknown = unknowns_[static_cast<std::size_t>(j)];
  VectorXd at = x;
  at[j] = moved;
  update(at, unknown.feeds);
  try {
    for (const std::size_t i : unknown.feeds) initialise(i);
  } catch (const Error& error) {
    last_error_ = error.what();
    return false;
  }
  return std::ranges::all_of(unknown.feeds, [&](std::size_t unit) {
    return std::ranges::all_of(rows_[unit],
                               [&](Index row) { return std::isfinite(*unknowns_[static_cast<std::size_t>(row)].at); });
  });
}

/// The increment goes towards y, where the next step goes, or away from it if it cannot be made.
bool AlgebraicLoop::linearise(const VectorXd& x, VectorXd& y, MatrixXd& jacobian) {
  jacobian.setZero();
  update(x, all_);
  for (Index j = 0; j < x.size(); ++j) {
    const Unknown& unknown = unknowns_[static_cast<std::size_t>(j)];
    const double size = kProbeIncrement * std::max({std::abs(x[j]), std::abs(y[j]), kSmallestMagnitude});
    double moved = x[j] + (y[j] < x[j] ? -size : size);
    bool made = probe(x, j, moved);
    if (!made) {
      moved = x[j] - (y[j] < x[j] ? -size : size);
      made = probe(x, j, moved);
    }
    if (!made) return false;
    for (const std::size_t unit : unknown.feeds) {
      for (const Index row : rows_[unit])
        jacobian(row, j) = (*unknowns_[static_cast<std::size_t>(row)].at - y[row]) / (moved - x[j]);
    }
    update(x, unknown.feeds);
    if (!has_other_kinds_) continue;
    for (const std::size_t unit : unknown.feeds)
      initialise(unit);  // so that the next increment does not see integers of this one
  }
  return true;
}

VectorXd AlgebraicLoop::first_guess(const SweptValues& swept) const {
  double first_change = 0, last_change = 0;
  const bool any_given = std::ranges::any_of(unknowns_, [](const Unknown& u) { return u.given.has_value(); });
  for (const Unknown& unknown : unknowns_) {
    const auto& values = swept.of.at(unknown.at);
    const double scale = 1 + std::abs(values[0]);
    first_change = std::max(first_change, std::abs(values[1] - values[0]) / scale);
    const double change = std::abs(values[3] - values[2]) / scale;
    last_change = std::isfinite(change) ? std::max(last_change, change) : std::numeric_limits<double>::infinity();
  }
  const bool approached = swept.complete && !any_given && last_change < first_change;
  VectorXd x(static_cast<Index>(unknowns_.size()));
  for (Index i = 0; i < x.size(); ++i) {
    const Unknown& unknown = unknowns_[static_cast<std::size_t>(i)];
    x[i] = unknown.given.value_or(swept.of.at(unknown.at)[approached ? 3 : 0]);
  }
  return x;
}

/// Newton's method, with a tolerance relative to 1 + |x| of its result.
Newton::Outcome AlgebraicLoop::run(Newton& newton, VectorXd& x) {
  Newton::Outcome outcome = Newton::Outcome::kDiverged;
  for (int rescaling = 0; rescaling < kRescalings; ++rescaling) {
    const VectorXd scale = scale_of(x);
    outcome = newton.solve(*this, x, scale, kLimits);
    iterations_ += newton.iterations();
    nonlinear_ = nonlinear_ || newton.nonlinear();
    if (outcome != Newton::Outcome::kConverged) return outcome;
    const VectorXd ratio = scale_of(x).cwiseQuotient(scale);
    if (ratio.maxCoeff() < 2 && ratio.minCoeff() > 0.5) return outcome;
  }
  return outcome;
}

/// Whether ∂y/∂x at x predicts y at a point far away from it.
bool AlgebraicLoop::is_linear(const VectorXd& x) {
  VectorXd y(x.size()), far(x.size());
  MatrixXd jacobian(x.size(), x.size());
  evaluate(x, y);
  if (!y.allFinite() || !linearise(x, y, jacobian)) return false;
  const VectorXd step = far_step(x);
  evaluate(x + step, far);
  const VectorXd error = (far - y - jacobian * step).cwiseAbs();
  const VectorXd size = scale_of(y) + jacobian.cwiseAbs() * step.cwiseAbs();
  return (error.array() <= kProbeLinear * size.array()).all();
}

/// A solution that clearly differs from `x`, if one is found.
std::optional<VectorXd> AlgebraicLoop::find_second(const VectorXd& x, const VectorXd& guess) {
  Deflated deflated(*this, x);
  const VectorXd step = far_step(x), scale = scale_of(x);
  const VectorXd starts[] = {guess, 2 * x - guess, x + scale, x - scale, x + step, x - step};
  for (const VectorXd& start : starts) {
    if (distance(x, start) < kClearlyDifferent) continue;
    VectorXd second = start;
    Newton search(x.size()), polish(x.size());
    if (search.solve(deflated, second, scale, kSearchLimits) != Newton::Outcome::kConverged) continue;
    if (run(polish, second) == Newton::Outcome::kConverged && distance(x, second) > kClearlyDifferent) return second;
  }
  return std::nullopt;
}

int AlgebraicLoop::solve(const SweptValues& swept) {
  if (unknowns_.size() > static_cast<std::size_t>(kMostUnknowns))
    fail("it has " + std::to_string(unknowns_.size()) + " unknowns, expected at most " + std::to_string(kMostUnknowns));
  const VectorXd guess = first_guess(swept);
  VectorXd x = guess, y(x.size());
  if (x.size() == 0) {
    evaluate(x, y);
    if (!last_error_.empty()) fail(last_error_);
    return 0;
  }
  Newton newton(x.size());
  Newton::Outcome outcome = run(newton, x);
  if (outcome != Newton::Outcome::kConverged) {
    if (!first_error_.empty())
      fail("a unit refuses the first guess (" + first_error_ + "); give a start value that it accepts, for example for " +
           unknowns_.front().input);
    const Unknown& worst = unknowns_[static_cast<std::size_t>(newton.worst_unknown())];
    const double residual = newton.worst();
    const bool noisy = outcome == Newton::Outcome::kDiverged && residual < kProbeNoise;
    if (!noisy && is_linear(guess)) {
      fail(
          "it has no solution or no unique one, because the gain around it is 1; change a gain, or insert a unit whose output "
          "does not follow its input at once");
    }
    const VectorXd step = far_step(guess);
    for (const double times : {0.1, -0.1, 1.0, -1.0, 10.0, -10.0}) {
      x = guess + times * step;
      outcome = run(newton, x);
      if (outcome == Newton::Outcome::kConverged) break;
    }
    if (outcome != Newton::Outcome::kConverged) {
      const std::string gap = std::isfinite(residual) ? " differs by " + text::to_text(residual, 3) + " of 1 + its magnitude"
                                                      : " is not finite or differs too much";
      fail("no solution was found within " + std::to_string(kLimits.iterations) + " iterations: " + worst.name + gap +
           " from the value assumed for it" + (last_error_.empty() ? "" : " (" + last_error_ + ")") +
           "; give start values closer to a solution, for example for " + worst.input + ", or break the loop");
    }
  }
  const bool given = std::ranges::any_of(unknowns_, [](const Unknown& u) { return u.given.has_value(); });
  const bool tested = distance(guess, x) > kFarMove;
  const int iterations = iterations_;
  if (!given && (nonlinear_ || (!tested && !is_linear(x)))) {
    if (const std::optional<VectorXd> second = find_second(x, guess)) fail_ambiguous(x, *second);
  }
  if (at_ != x || std::ranges::find(stale_, true) != stale_.end()) evaluate(x, y);
  return iterations;
}

std::string AlgebraicLoop::member_names() const {
  std::string names;
  for (const std::size_t slot : slots_) text::append(names, system_.members[system_.schedule.slots[slot].member].name());
  return names;
}

void AlgebraicLoop::fail(const std::string& what) const {
  throw Error("initialisation", "algebraic loop between " + member_names() + ": " + what);
}

void AlgebraicLoop::fail_ambiguous(const VectorXd& a, const VectorXd& b) const {
  Index at = 0;
  (a - b).cwiseQuotient(scale_of(a)).cwiseAbs().maxCoeff(&at);
  const Unknown& unknown = unknowns_[static_cast<std::size_t>(at)];
  const auto value = [&](double x) {
    return unknown.name + " = " + text::to_text(x, 6) + (unknown.si.empty() ? "" : " " + unknown.si);
  };
  fail("it has several solutions, for example " + value(a[at]) + " and " + value(b[at]) + "; give " + unknown.input +
       " a start value near the one that is meant");
}

}  // namespace cotwin::master
