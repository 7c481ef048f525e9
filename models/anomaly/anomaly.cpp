#include "models/anomaly/anomaly.h"

#include <array>
#include <cmath>
#include <limits>

#include "models/anomaly/constants.h"
#include "models/foundation/support/error.h"
#include "models/identification/torque_data/torque_model.h"

namespace cotwin::anomaly {

Watch::Watch(const robot::RobotModel& robot, const TorqueModel& model, bool motor, const WatchOptions& options)
    : model_(model),
      motor_(motor),
      n_(robot.joints.size()),
      causes_(static_cast<std::size_t>(model.causes())),
      width_(1 + kPerJoint * n_ + kPerTerm * (3 * n_ + n_ * n_)),
      capacity_(static_cast<std::size_t>(std::max(std::ceil(options.baseline / kBlock), kLeastBlocks))) {
  if (n_ > kMostJoints) throw Error("robot", std::to_string(n_) + " joints, expected at most " + std::to_string(kMostJoints));
  for (std::size_t j = 0; j < n_; ++j) {
    const robot::Joint& joint = robot.joints[j];
    limit_.push_back(joint.tau_max > 0 ? joint.tau_max : std::numeric_limits<double>::infinity());
    floor_.push_back(std::isfinite(limit_[j]) ? 1e-6 * limit_[j] : 1e-9);
    passive_.push_back(joint.passive ? 1 : 0);
    slow_.push_back(kSlow * identification::speed_scale(joint));
    sign_.push_back(kSign * identification::speed_scale(joint));
  }
  blocks_.resize(capacity_ * width_);
  open_.resize(width_);
  for (auto* v : {&fastest_, &steepest_, &sigma_, &peak_, &mean_spread_, &resting_, &saturated_, &compared_}) v->resize(n_);
  beta_.resize(kFits * n_);
  x_.resize(capacity_);
  charts_.resize(causes_ + n_);
  events_.reserve(kMostEvents);
}

void Watch::restart() {
  for (auto* v : {&open_, &fastest_, &steepest_, &beta_, &sigma_, &peak_, &mean_spread_}) std::ranges::fill(*v, 0.0);
  std::ranges::fill(charts_, Chart{});
  ready_ = closed_ = elapsed_ = useful_ = hold_ = from_ = preparing_ = pooled_ = 0;
}

/// Where a block has the sums of cause k at joint i.
std::size_t Watch::term(int k, std::size_t i) const {
  const std::size_t cause = static_cast<std::size_t>(k);
  const std::size_t at = k == 0 ? i : cause <= 2 * n_ ? n_ + cause - 1 : 3 * n_ + (cause - 1 - 2 * n_) * n_ + i;
  return 1 + kPerJoint * n_ + kPerTerm * at;
}

bool Watch::judges_now(std::size_t j, double dq, double tau) const {
  return passive_[j] == 0 && !rests(j, dq) && std::abs(tau) < kAtLimit * limit_[j];
}

void Watch::add(double t, double h, const double* dq, const double* ddq, const double* tau) {
  if (h <= 0) {
    std::ranges::fill(open_, 0.0);
    elapsed_ = useful_ = 0;
    return;
  }
  if (preparing_ != 0) return prepare();
  if (elapsed_ == 0) open_[0] = t - h;
  elapsed_ += h;
  bool outside = false;
  for (std::size_t j = 0; j < n_; ++j) {
    if (ready_ == 0) {
      fastest_[j] = std::max(fastest_[j], std::abs(dq[j]));
      steepest_[j] = std::max(steepest_[j], std::abs(ddq[j]));
    } else {
      outside =
          outside || std::abs(dq[j]) > kFaster * fastest_[j] + slow_[j] || std::abs(ddq[j]) > kFaster * steepest_[j] + slow_[j];
    }
  }
  if (outside) outside_ += h;
  bool judged = false;
  const Eigen::MatrixXd& effects = model_.effects();
  for (std::size_t j = 0; j < n_ && !outside; ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    if (passive_[j]) continue;
    if (!judges_now(j, dq[j], tau[j])) {
      (rests(j, dq[j]) ? resting_ : saturated_)[j] += h;
      continue;
    }
    judged = true;
    if (sigma_[j] > 0) compared_[j] += h;
    const double v = dq[j], r = tau[j] - model_.tau()[row];
    const std::array<double, kFits> x = {1, std::tanh(v / sign_[j]), v, std::abs(v) * v};
    double* const own = open_.data() + 1 + kPerJoint * j;
    double e = r;
    for (std::size_t f = 0, pair = kPairs; f < kFits; ++f) {
      e -= beta_[kFits * j + f] * x[f];
      own[kWith + f] += x[f] * r;
      for (std::size_t g = f; g < kFits; ++g) own[pair++] += x[f] * x[g];
    }
    own[kGreatest] = own[kCount] > 0 ? std::max(own[kGreatest], e) : e;
    own[kLeast] = own[kCount] > 0 ? std::min(own[kLeast], e) : e;
    own[kCount] += 1;
    own[kSquares] += r * r;
    const auto take = [&](int k) {
      const double phi = effects(row, k);
      double* const sums = open_.data() + term(k, j);
      sums[kProduct] += phi * r;
      for (std::size_t f = 0; f < kFits; ++f) sums[kFitted + f] += phi * x[f];
      sums[kEffect] += phi * phi;
    };
    const int n = static_cast<int>(n_);
    take(0);
    take(1 + static_cast<int>(j));
    take(1 + n + static_cast<int>(j));
    for (int k = 1 + 2 * n; k <= 3 * n; ++k) take(k);
  }
  if (judged) useful_ += h, moving_ += h;
  if (elapsed_ >= kBlock * (1 - 1e-6)) close_block(t);
}

void Watch::close_block(double t) {
  const bool useful = useful_ >= 0.5 * kBlock;
  if (ready_ != 0 || useful) {
    std::ranges::copy(open_, block(static_cast<std::size_t>(closed_)));
    closed_ += 1;
    if (ready_ != 0) {
      watch(t);
    } else if (closed_ >= static_cast<double>(capacity_)) {
      preparing_ = 1;
    }
  }
  std::ranges::fill(open_, 0.0);
  elapsed_ = useful_ = 0;
}

Watch::Score Watch::score(const double* block, int k) const {
  Score score;
  each_joint(k, [&](std::size_t i) {
    if (sigma_[i] == 0) return;
    const double* const sums = block + term(k, i);
    double product = sums[kProduct];
    for (std::size_t f = 0; f < kFits; ++f) product -= beta_[kFits * i + f] * sums[kFitted + f];
    score.d += product / (sigma_[i] * sigma_[i]);
    score.information += sums[kEffect] / (sigma_[i] * sigma_[i]);
  });
  score.d -= charts_[static_cast<std::size_t>(k)].theta * score.information;
  return score;
}

/// Whether joint j moved in half of the samples of its block, or of the block's joint that did most.
bool Watch::tells(const double* block, std::size_t j) const {
  double most = 0;
  for (std::size_t i = 0; i < n_; ++i) most = std::max(most, block[1 + kPerJoint * i + kCount]);
  return sigma_[j] > 0 && most > 0 && block[1 + kPerJoint * j + kCount] >= 0.5 * most;
}

/// Σ (r − β·x)² of joint j.
double Watch::squares_of(const double* block, std::size_t j) const {
  const double* const own = block + 1 + kPerJoint * j;
  const double* const beta = beta_.data() + kFits * j;
  double sum = own[kSquares];
  for (std::size_t f = 0, pair = kPairs; f < kFits; ++f) {
    sum -= 2 * beta[f] * own[kWith + f];
    for (std::size_t g = f; g < kFits; ++g) sum += (f == g ? 1 : 2) * beta[f] * beta[g] * own[pair++];
  }
  return std::max(sum, 0.0);
}

/// ln of the mean square of the residuals over that of the baseline.
double Watch::spread(const double* block, std::size_t j) const {
  const double square = squares_of(block, j) / block[1 + kPerJoint * j + kCount];
  return std::log(square / (sigma_[j] * sigma_[j]) + kQuiet);
}

/// One value of a chart; `usual`: what a shift of one unit gives in it.
bool Watch::advance(Chart& chart, double z, double usual) {
  const Whitening white{chart.rho};
  const double w = chart.follows != 0 ? white(z, chart.before) : z;
  chart.before = z;
  chart.follows = 1;
  const double k = std::max(kLeastReference, 0.5 * chart.dead * white.gain() * usual) + chart.doubt * white.gain() * usual;
  chart.sum.add(std::clamp(w, -k - kClip, k + kClip), k);
  return chart.sum.largest() > chart.limit;
}

void Watch::watch(double t) {
  if (hold_ > 0) {
    if (--hold_ == 0) return conclude(t);
    if (told_ != 0 || pending_.spread) return;
    Event surer = pending_;
    const double from = from_;
    explain(surer);
    surer.found = t;
    if (sure(surer, kVerySure)) tell(pending_ = surer);
    from_ = from;
    return;
  }
  const double* const newest = block(static_cast<std::size_t>(closed_) - 1);
  Event event;
  event.found = t;
  event.since = newest[0];
  double most = 0;
  for (std::size_t j = 0; j < n_; ++j) {
    const double* const own = newest + 1 + kPerJoint * j;
    if (sigma_[j] == 0 || own[kCount] == 0) continue;
    const double up = own[kGreatest], down = -own[kLeast];
    const double least = std::isfinite(limit_[j]) ? kBlowOfLimit * limit_[j] : 0;
    const double times = std::max(up, down) / std::max(kPeak * peak_[j], least);
    if (!(times > 1)) continue;
    event.joints |= std::uint64_t{1} << j;
    if (times <= most) continue;
    most = times;
    event.brief = true;
    event.cause = event.other = Cause::kContact;
    event.joint = static_cast<int>(j);
    event.torque = up > down ? up : -down;
    event.size = std::abs(event.torque);
  }
  double first = 0, age = 0;
  bool spreads = false;
  const auto alarm = [&](const Chart& chart, bool of_spread, int joint) {
    if (chart.sum.largest() / chart.limit <= first) return;
    first = chart.sum.largest() / chart.limit;
    age = chart.sum.age();
    spreads = of_spread;
    if (of_spread) event.joint = joint;
  };
  for (int k = 0; k < static_cast<int>(causes_); ++k) {
    Chart& chart = charts_[static_cast<std::size_t>(k)];
    if (chart.ready == 0) continue;
    const Score s = score(newest, k);
    const double all = std::sqrt(s.information + kSettled * chart.information);
    if (s.information < kLittle * chart.information) {
      chart.follows = 0;
    } else if (advance(chart, s.d / (chart.scale * all), s.information / (chart.scale * all)) && !event.brief) {
      alarm(chart, false, 0);
    }
  }
  for (std::size_t j = 0; j < n_; ++j) {
    Chart& chart = charts_[causes_ + j];
    if (chart.ready == 0 || !tells(newest, j)) continue;
    const bool rises =
        advance(chart, (spread(newest, j) - mean_spread_[j]) / chart.scale, 1 / chart.scale) && chart.sum.up > chart.limit;
    if (rises && first == 0 && !event.brief) alarm(chart, true, static_cast<int>(j));
  }
  if (first == 0 && !event.brief) return;
  const double kept = std::min({static_cast<double>(capacity_), closed_, kLongest});
  from_ = closed_ - std::clamp(age, 1.0, kept);
  if (!event.brief) {
    event.since = block(static_cast<std::size_t>(from_))[0];
    const Event scatter = event;
    const double from = from_;
    if (explain(event) < kExplained && spreads) {
      from_ = from;
      describe_spread(event = scatter);
    }
  }
  hold_ = kHold;
  pending_ = event;
  told_ = 0;
  if (sure(event, kVerySure)) tell(event);
}

/// Whether a change is `times` its deviation, and large enough to matter; of a spread, whether it has that share of the squares' logarithm.
bool Watch::sure(const Event& event, double times) const {
  if (event.brief) return true;
  if (event.spread) return 2 * std::log(event.size) >= times / kSure * std::log(kScatter);
  return event.which >= 0 &&
         std::abs(event.size) >= std::max(times * event.deviation, 0.5 * charts_[static_cast<std::size_t>(event.which)].dead);
}

void Watch::tell(const Event& event) {
  told_ = 1;
  found_ += 1;
  last_ = event;
  if (events_.size() < kMostEvents) events_.push_back(event);
}

template <class Take>
void Watch::over_window(Take&& take) const {
  const double begin = std::max(from_, closed_ - static_cast<double>(capacity_));
  for (double b = begin; b < closed_; ++b) take(blocks_.data() + static_cast<std::size_t>(b) % capacity_ * width_);
}

/// Σ ((r − β·x)/σ)² and the number of values of joint j since `from_`.
Watch::Score Watch::squares(std::size_t j) const {
  Score sum;
  if (sigma_[j] == 0) return sum;
  over_window([&](const double* b) {
    sum.d += squares_of(b, j) / (sigma_[j] * sigma_[j]);
    sum.information += b[1 + kPerJoint * j + kCount];
  });
  return sum;
}

/// Writes the cause that explains best what the last blocks have beyond the baseline, and moves `from_` to the block from which on it explains
/// most, at most half of the way. Returns the share that it explains.
double Watch::explain(Event& event) {
  std::array<double, 4> gains{};
  int best = -1;
  double largest = 0, start = from_, excess = 0;
  for (int k = 0; k < static_cast<int>(causes_); ++k) {
    if (!judges(k)) continue;
    double& kind = gains[static_cast<std::size_t>(model_.cause(k))];
    Score all;
    for (double b = closed_ - 1; b >= std::max(from_, closed_ - static_cast<double>(capacity_)); --b) {
      const Score s = score(block(static_cast<std::size_t>(b)), k);
      all.d += s.d, all.information += s.information;
      const double gain = all.information > 0 ? all.d * all.d / all.information : 0;
      if (model_.cause(k) == Cause::kEncoder && std::abs(all.d) > kFarthest * all.information) continue;
      if (b > from_ + 0.5 * (closed_ - 1 - from_)) continue;
      kind = std::max(kind, gain);
      if (gain <= largest) continue;
      const Chart& chart = charts_[static_cast<std::size_t>(k)];
      largest = gain;
      best = k;
      start = b;
      event.size = all.d / all.information;
      event.deviation = std::hypot(chart.scale / std::sqrt(all.information) / Whitening{chart.rho}.gain(), chart.doubt);
    }
  }
  if (best < 0) return 0;
  from_ = start;
  event.since = block(static_cast<std::size_t>(from_))[0];
  event.spread = event.brief = false;
  event.which = best;
  event.cause = event.other = model_.cause(best);
  double second = kAsGood * largest;
  for (std::size_t c = 0; c < gains.size(); ++c) {
    if (static_cast<Cause>(c) == event.cause || gains[c] < second) continue;
    second = gains[c];
    event.other = static_cast<Cause>(c);
  }
  std::array<double, kMostJoints> effect{};  // RMS, N.m
  double most = 0;
  each_joint(best, [&](std::size_t i) {
    double sum = 0, count = 0;
    over_window([&](const double* b) {
      count += b[1 + kPerJoint * i + kCount];
      sum += b[term(best, i) + kEffect];
    });
    effect[i] = count > 0 ? std::sqrt(sum / count) * std::abs(event.size) : 0;
    if (effect[i] <= most) return;
    most = effect[i];
    event.joint = static_cast<int>(i);
  });
  event.torque = std::copysign(most, event.size);
  event.joints = 0;
  for (std::size_t i = 0; i < n_; ++i) {
    if (effect[i] > 0 && effect[i] >= kBears * most) event.joints |= std::uint64_t{1} << i;
    const Score sum = squares(i);
    excess += std::max(sum.d - sum.information, 0.0);
  }
  return excess > 0 ? largest / excess : 0;
}

/// Writes that the residuals of event.joint scatter more.
void Watch::describe_spread(Event& event) const {
  const std::size_t j = static_cast<std::size_t>(event.joint);
  const Score sum = squares(j);
  const double times = sum.information > 0 ? sum.d / sum.information : 1;
  event.spread = true;
  event.brief = false;
  event.cause = Cause::kEncoder;
  event.other = Cause::kContact;
  event.size = std::sqrt(times / std::exp(mean_spread_[j]));
  event.deviation = 0;
  event.torque = std::sqrt(times) * sigma_[j];
  event.joints = std::uint64_t{1} << j;
}

/// The size of the change is known as well as it will be. One that is not certain by now was none. Else what follows is compared with what follows
/// first.
void Watch::conclude(double t) {
  Event event = pending_, lasting = pending_;
  const double from = from_;
  const bool explained = explain(lasting) >= kExplained && lasting.concerns(static_cast<std::size_t>(event.joint));
  if (explained || (lasting.which >= 0 && !event.brief && !event.spread)) {
    event = lasting;
  } else {
    from_ = event.brief ? from + kBlow : from;  // whether residuals scatter after the blow, too
    const Score sum = squares(static_cast<std::size_t>(event.joint));
    const double usual = std::exp(mean_spread_[static_cast<std::size_t>(event.joint)]);
    if (event.spread || sum.d > kPeak * kPeak * usual * sum.information) describe_spread(event);
  }
  if (told_ != 0) {
    event.since = std::min(event.since, event.found);
    if (found_ <= static_cast<double>(kMostEvents)) events_.back() = event;
    last_ = event;
  } else if (sure(event, kSure)) {
    event.found = t;
    tell(event);
  }
  if (told_ != 0 && !event.brief) return restart();
  for (Chart& chart : charts_) chart.sum = {}, chart.follows = 0;
}

}  // namespace cotwin::anomaly
