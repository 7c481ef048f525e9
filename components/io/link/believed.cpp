#include "components/io/link/believed.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cotwin::io {

BelievedTorques::BelievedTorques(std::span<const trajectory::Axis> axes, std::size_t along) : tau_(axes.size()), along_(along) {
  for (const trajectory::Axis& axis : axes) {
    const bool given = axis.tau_max > 0 && std::isfinite(axis.tau_max);
    largest_.push_back(given ? kLargest * axis.tau_max : kLargestTorque);
    largest_step_.push_back(kLargestStep * (given ? axis.tau_max : kWithoutEffort));
  }
}

void BelievedTorques::forget() {
  known_ = begun_ = stepping_ = false;
  in_a_row_ = 0;
  std::ranges::fill(tau_.used, 0);
  std::ranges::fill(along_.used, 0);
}

void BelievedTorques::Values::use_middle(std::span<const double> next) {
  for (std::size_t i = 0; i < used.size(); ++i) {
    used[i] = std::max(std::min(used[i], last[i]), std::min(std::max(used[i], last[i]), next[i]));
  }
}

bool BelievedTorques::add(std::span<const double> tau, std::span<const double> along, bool possible) {
  bool sound = true, agrees = true, used = true, steps = false, go_on = false;
  for (std::size_t i = 0; i < tau.size(); ++i) {
    possible = possible && std::abs(tau[i]) <= largest_[i];
    agrees = agrees && std::abs(tau[i] - tau_.last[i]) <= largest_step_[i];
    const double before = tau_.last[i] - tau_.used[i], now = tau[i] - tau_.used[i];
    const bool waited = std::abs(before) > largest_step_[i], waits = std::abs(now) > largest_step_[i];
    const bool goes_on = waited && waits && (before > 0) == (now > 0);
    sound = sound && (!waited || goes_on || stepping_);  // in the midst of a hit there are peaks
    go_on = go_on || goes_on;
    used = used && (!waits || goes_on);
    steps = steps || waits;
  }
  const bool known = known_;
  in_a_row_ = possible && used ? 0 : in_a_row_ + 1;
  if (known_ && in_a_row_ > kMostHeld) forget();
  if (!possible) return false;
  if (known_ && steps) {
    tau_.use_middle(tau);
    along_.use_middle(along);
  } else if (known_ || (begun_ && agrees)) {
    std::ranges::copy(tau, tau_.used.begin());
    std::ranges::copy(along, along_.used.begin());
    known_ = true;
    in_a_row_ = 0;
  }
  std::ranges::copy(tau, tau_.last.begin());
  std::ranges::copy(along, along_.last.begin());
  begun_ = true;
  stepping_ = go_on;
  return !known || sound;
}

void BelievedSetPoint::forget() {
  jumps_.forget();
  first_ = believed_ = before_ = true;
  std::ranges::fill(offset_, 0);
}

void BelievedSetPoint::take(std::span<double> q, std::span<const double> q_measured, double elapsed, bool measured,
                            bool yields) {
  before_ = believed_;
  const bool follows = jumps_.add(q, elapsed) != JumpDetector::Verdict::kHeld, first = std::exchange(first_, false);
  bool near = true;
  for (std::size_t i = 0; i < q.size() && measured; ++i) near = near && std::abs(q[i] - q_measured[i]) <= kFarthest;
  believed_ = first ? near : follows && (near || yields);
  if (!measured) return;
  for (std::size_t i = 0; i < q.size(); ++i) {
    if (believed_) offset_[i] = q[i] - q_measured[i];
    q[i] = q_measured[i] + offset_[i];
  }
}

}  // namespace cotwin::io
