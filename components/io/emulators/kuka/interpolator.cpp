#include "components/io/emulators/kuka/interpolator.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/trajectory/approach.h"

namespace cotwin::fri {

namespace {

constexpr double kRounding = 1e-6;  // rad: two single floats below 2π

}  // namespace

Interpolator::Interpolator(InterpolatorSettings settings)
    : settings_(std::move(settings)),
      n_(settings_.speed_limit.size()),
      period_(static_cast<double>(settings_.message_period) * settings_.multiplier * 1e-9) {}

void Interpolator::start(const Joints& q, std::int64_t index) {
  q_ = from_ = to_ = q;
  slope_.fill(0);
  speed_.fill(0);
  index_ = index;
  gap_ = 1;
  stopping_ = false;
}

void Interpolator::command(const Joints& q, std::int64_t index, bool soft) {
  if (stopping_ || index <= index_) return;
  soft_ = soft;
  for (std::size_t i = 0; i < n_; ++i) slope_[i] = (q[i] - q_[i]) / static_cast<double>(index - index_);
  q_ = q;
  gap_ = index - index_;
  index_ = index;
}

bool Interpolator::is_jerk(const Joints& q, std::int64_t index) const {
  const double period = static_cast<double>(settings_.message_period) * 1e-9;
  const auto now = static_cast<double>(index - index_), before = static_cast<double>(gap_);
  // The mean speeds of two intervals differ by the acceleration between their middles.
  const double change = settings_.acceleration_limit * period * (now + before) / 2 + 2 * kRounding / period;
  for (std::size_t i = 0; i < n_; ++i) {
    if (!(std::abs((q[i] - q_[i]) / now - slope_[i]) / period <= change)) return true;
  }
  return false;
}

bool Interpolator::is_jump(const Joints& q, std::int64_t index) const {
  const double time = static_cast<double>(settings_.message_period) * static_cast<double>(index - index_) * 1e-9;
  const double slack = static_cast<double>(settings_.slack) * 1e-9;
  for (std::size_t i = 0; i < n_; ++i) {
    const double limit = settings_.speed_limit[i];
    if (!(std::abs(q[i] - q_[i]) <= limit * (time + slack) + kRounding)) return true;
    // Many steps within the slack, each too long, or a return after a wrong continuation.
    if (!(std::abs(q[i] - to_[i]) <= limit * (time + slack + settings_.longest_lag * period_) + kRounding)) return true;
  }
  return false;
}

double Interpolator::limited(std::size_t joint, double q) const {
  if (!settings_.lower.empty()) q = std::max(q, settings_.lower[joint]);
  if (!settings_.upper.empty()) q = std::min(q, settings_.upper[joint]);
  return q;
}

void Interpolator::begin_period(std::int64_t now, std::int64_t lost) {
  if (stopping_) return;
  Joints dq;
  at(now, from_, dq);
  for (std::size_t i = 0; i < n_; ++i) {
    double target = q_[i];
    if (lost > 0) target = limited(i, target + slope_[i] * static_cast<double>(lost));
    const double step = settings_.speed_limit[i] * period_;
    double way = std::clamp(target - from_[i], -step, step);
    if (soft_ && std::isfinite(settings_.acceleration_limit)) way = std::clamp(softened(i, target), -step, step);
    to_[i] = from_[i] + way;
    speed_[i] = way / period_;
  }
  begin_ = now;
}

/// rad: the way of a period towards `target`, which moves with the speed of the commands.
double Interpolator::softened(std::size_t i, double target) const {
  const double a = settings_.acceleration_limit, moves = slope_[i] * settings_.multiplier, behind = target - moves - from_[i];
  const double wanted = moves / period_ + std::copysign(trajectory::approach_speed(std::abs(behind), a, period_), behind);
  return std::clamp(wanted, speed_[i] - a * period_, speed_[i] + a * period_) * period_;
}

void Interpolator::stop(std::int64_t now) {
  if (stopping_) return;
  Joints q, dq;
  at(now, q, dq);
  // At the end of a period the joints still have its speed; they stand only if the next one has not begun long after it.
  if (static_cast<double>(now - begin_) * 1e-9 > 2 * period_) speed_.fill(0);
  from_ = q;
  begin_ = now;
  stopping_ = true;
}

double Interpolator::share_of_speed(std::int64_t now) const {
  if (!stopping_) return 1;
  if (at_rest(now)) return 0;
  return 1 - static_cast<double>(now - begin_) / static_cast<double>(settings_.stop_time);
}

void Interpolator::at(std::int64_t now, Joints& q, Joints& dq) const {
  const double t = static_cast<double>(std::max<std::int64_t>(now - begin_, 0)) * 1e-9;
  if (stopping_) {
    const double share = share_of_speed(now);
    const double stop_time = static_cast<double>(settings_.stop_time) * 1e-9;
    for (std::size_t i = 0; i < n_; ++i) {
      const double way = speed_[i] * stop_time * (1 - share * share) / 2;
      q[i] = way == 0 ? from_[i] : limited(i, from_[i] + way);
      dq[i] = q[i] == from_[i] + way ? speed_[i] * share : 0;
    }
    return;
  }
  const bool stepped = period_ <= kLongestStep;
  const double share = stepped ? 1 : std::min(t / period_, 1.0);
  for (std::size_t i = 0; i < n_; ++i) {
    q[i] = share == 1 ? to_[i] : from_[i] + share * (to_[i] - from_[i]);
    dq[i] = t < period_ ? speed_[i] : 0;
  }
}

}  // namespace cotwin::fri
