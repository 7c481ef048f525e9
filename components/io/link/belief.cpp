#include "components/io/link/belief.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

constexpr const char* kWrongTime = "its time does not follow from those before";
constexpr const char* kTooFast = "a speed is beyond twice the limit of its joint in the URDF";
constexpr const char* kNoMotion = "no motion explains a position";
constexpr const char* kTooStrong = "a torque is beyond ten times the effort of its joint in the URDF, or its pose does not fit";
constexpr const char* kTooShort = "a torque or force lasted for less than three messages";

}  // namespace

double largest_speed(const trajectory::Axis& axis) {
  return axis.dq_max > 0 ? 2 * axis.dq_max : std::numeric_limits<double>::infinity();
}

std::size_t BelievedNumbers::add(Kind kind, std::size_t count) {
  numbers_.resize(numbers_.size() + count, Number{.kind = kind});
  return numbers_.size() - count;
}

void BelievedNumbers::forget() {
  for (Number& number : numbers_) number = {.kind = number.kind};
}

double BelievedNumbers::put(std::size_t i, double value) {
  Number& n = numbers_[i];
  if (!std::isfinite(value)) return n.used;
  n.at = (n.at + 1) % kLast;
  n.last[n.at] = value;
  n.messages = std::min(n.messages + 1, kLast);
  if (!known(i)) return n.used;
  const double before = n.back(1), first = n.back(2);
  if (n.kind == Kind::kNumber) {
    std::array<double, kLast> sorted = n.last;
    std::ranges::nth_element(sorted, sorted.begin() + kLast / 2);
    n.used = sorted[kLast / 2];
  } else if (n.kind == Kind::kState) {
    if (value == before && value == first) n.used = value;
  } else {
    const auto bits = [](double x) { return static_cast<std::uint64_t>(std::clamp(x, 0.0, 9e15)); };
    const std::uint64_t same = ~(bits(value) ^ bits(before)) & ~(bits(value) ^ bits(first));
    n.used = static_cast<double>((bits(value) & same) | (bits(n.used) & ~same));
  }
  return n.used;
}

void ConfirmedState::see(int now) {
  constexpr int kInARow = BelievedNumbers::kInARow;
  in_a_row = now == std::exchange(last, now) ? in_a_row + 1 : 1;
  against = now == value ? 0 : against + 1;
  if (in_a_row < kInARow && against < kInARow) return;
  value = in_a_row >= kInARow ? now : 0;
  against = 0;
}

Belief::Belief(std::span<const trajectory::Axis> axes, int first)
    : largest_jump_(axes.size(), kLargestJump), first_(first), needed_(first), believed_(axes.size()), recent_(axes.size()) {
  for (const trajectory::Axis& axis : axes) {
    fastest_.push_back(largest_speed(axis));
    q_least_.push_back(axis.q_min - kMargin);
    q_most_.push_back(axis.q_max + kMargin);
  }
}

void Belief::declare(Variables& v, const std::string& what) {
  v.output("implausible", implausible_,
           what +
               " with a position, speed, time, torque or force that no motion or hit explains, which was not used; 5 "
               "positions in a row are a jump");
}

void Belief::begin() {
  forget();
  implausible_ = 0;
}

void Belief::count_implausible(const char* reason) {
  if (implausible_ < std::numeric_limits<std::int32_t>::max()) ++implausible_;
  reason_ = reason;
}

void Belief::append_notes(std::vector<std::string>& sentences, const std::string& one) const {
  if (implausible_ == 0) return;
  sentences.push_back(text::counted(implausible_, one) + " not used or not wholly, last because " + reason_ +
                      " (damaged, or of another scale)");
}

void Belief::set_resolution(std::size_t i, double resolution) {
  largest_jump_[i] = std::max(kLargestJump, kLargestCounts * std::abs(resolution));
}

void Belief::forget() {
  believed_.positions = recent_.positions = in_a_row_ = 0;
  since_ = 0;
  lost_ = held_ = false;
  needed_ = first_;
}

void Belief::expect_jump() {
  believed_.positions = in_a_row_ = 0;
  needed_ = 2;
}

void Belief::Track::append(std::span<const double> q_next, double elapsed) {
  // What is damaged by less than a jump gives no speed that leads away.
  const double change = kLargestAcceleration * (elapsed + interval) / 2;
  for (std::size_t i = 0; i < q.size(); ++i) {
    const double mean = positions > 0 ? (q_next[i] - q[i]) / elapsed : 0;
    dq[i] = positions > 1 ? std::clamp(mean, dq[i] - change, dq[i] + change) : mean;
    q[i] = q_next[i];
  }
  duration = positions > 0 ? duration + elapsed : 0;
  interval = elapsed;
  positions = std::min(positions + 1, 1000);
}

bool Belief::explains(const Track& track, std::span<const double> q, double elapsed) const {
  if (track.positions == 0 || !(elapsed > 0)) return false;
  // The mean speeds of two intervals differ by the acceleration between their middles.
  const double turn = kLargestAcceleration * elapsed * (elapsed + track.interval) / 2;
  for (std::size_t i = 0; i < q.size(); ++i) {
    const double way = q[i] - track.q[i];
    if (!(std::abs(way) <= largest_jump_[i] + fastest_[i] * elapsed)) return false;
    if (track.positions >= 2 && !(std::abs(way - track.dq[i] * elapsed) <= largest_jump_[i] + turn)) return false;
  }
  return true;
}

/// Whether the last positions, up to q, follow from one another for long enough.
bool Belief::is_confirmed(std::span<const double> q) const {
  bool inside = true;
  for (std::size_t i = 0; i < q.size(); ++i) inside = inside && q[i] >= q_least_[i] && q[i] <= q_most_[i];
  if (!inside && recent_.duration < kOutsideTime) return false;
  if (believed_.positions == 0) return recent_.positions >= needed_;
  return in_a_row_ > kMostHeld && recent_.positions > kMostHeld;
}

Belief::Verdict Belief::add(std::span<const double> q, double elapsed, bool in_time, bool possible) {
  constexpr double kLongest = 0.1;  // s; what was believed before that explains nearly everything
  since_ += elapsed;
  if (in_a_row_ > kMostHeld && since_ > kLongest && believed_.positions > 0) {
    believed_.positions = 0;
    lost_ = true;
  }
  const bool begins = believed_.positions == 0, first = recent_.positions == 0;
  const bool plausible = in_time && possible && explains(believed_, q, since_), follows = explains(recent_, q, elapsed);
  if (!follows) recent_.positions = 0;
  recent_.append(q, elapsed);
  held_ = false;
  if (plausible) {
    believed_.append(q, since_);
  } else {
    ++in_a_row_;
    if (!begins || !(first || follows || needed_ < first_))
      count_implausible(!in_time ? kWrongTime : !possible ? kTooFast : kNoMotion);
    held_ = !possible || !is_confirmed(q);
    if (held_) return Verdict::kHeld;
    believed_ = recent_;
    needed_ = first_;
  }
  since_ = in_a_row_ = 0;
  const bool begun = begins && !std::exchange(lost_, false);
  return plausible ? Verdict::kPlausible : begun ? Verdict::kFirst : Verdict::kJump;
}

Agreement::Agreement(std::span<const trajectory::Axis> axes) : step_(axes.size()), dq_step_(axes.size()) {
  for (const trajectory::Axis& axis : axes) names_.push_back(axis.name);
  for (Moment& moment : window_) moment.q = moment.dq = moment.way = moment.covered = step_;
}

void Agreement::set_resolution(std::size_t i, double step, double dq_step) {
  step_[i] = std::abs(step);
  dq_step_[i] = std::abs(dq_step);
}

void Agreement::forget() {
  moments_ = messages_ = 0;
  complete_ = told_ = false;
  disagrees_ = -1;
}

const char* Agreement::compare(std::span<const double> q, std::span<const double> dq, double elapsed) {
  constexpr double kMissing = 3.5;  // periods: three messages
  if (!(elapsed > 0)) forget();
  const bool begins = messages_ == 0, gap = messages_ > 1 && elapsed > kMissing * shortest_;
  const auto moment = [&](std::size_t i) -> Moment& { return window_[(oldest_ + i) % kWindow]; };
  const Moment& before = moment(moments_ + kWindow - 1);
  // The last moment is replaced until it is far enough from the one before it.
  const bool replaces = moments_ > 1 && before.t - moment(moments_ - 2).t < kLongest / kWindow;
  if (moments_ == kWindow && !replaces) oldest_ = (oldest_ + 1) % kWindow, --moments_;
  Moment& now = moment(replaces ? moments_ - 1 : moments_++);
  now.t = begins ? 0 : before.t + elapsed;
  shortest_ = messages_ <= 1 ? elapsed : std::min(shortest_, elapsed);
  messages_ = std::min(messages_ + 1, kWindow);
  for (std::size_t i = 0; i < q.size(); ++i) {
    const double way = begins ? 0 : gap ? q[i] - before.q[i] : (before.dq[i] + dq[i]) / 2 * elapsed;
    now.way[i] = begins ? 0 : before.way[i] + way;
    now.covered[i] = begins ? 0 : before.covered[i] + (gap ? 0 : std::abs(way));
    now.q[i] = q[i];
    now.dq[i] = dq[i];
  }
  while (now.t - moment(0).t > kLongest) oldest_ = (oldest_ + 1) % kWindow, --moments_;
  const Moment& oldest = moment(0);
  complete_ = complete_ || messages_ == kWindow || now.t >= kLongest;
  disagrees_ = disagreeing(oldest, now);
  const bool told = std::exchange(told_, complete_ && differs());
  if (!told_ || told) return nullptr;
  const auto i = static_cast<std::size_t>(disagrees_);
  std::snprintf(why_.data(), why_.size(), "%s has moved by %.3g, and by %.3g as its speed or set point says, rad or m",
                names_[i].c_str(), now.q[i] - oldest.q[i], now.way[i] - oldest.way[i]);
  return why_.data();
}

/// The first joint whose position has not moved as its speed says; −1: none. Speeds are late: by the filters of drives, and as
/// differences by half of their time.
int Agreement::disagreeing(const Moment& from, const Moment& to) const {
  constexpr double kSlack = 2e-3, kShare = 0.05, kFilter = 0.02;  // rad, 1, s
  const double late = kFilter + shortest_ / 2;
  for (std::size_t i = 0; i < to.q.size(); ++i) {
    const double bound = kSlack + kShare * (to.covered[i] - from.covered[i]) + late * std::abs(to.dq[i] - from.dq[i]) +
                         step_[i] + dq_step_[i] * (to.t - from.t);
    // False for what is not a number.
    if (std::abs(to.q[i] - from.q[i] - (to.way[i] - from.way[i])) > bound) return static_cast<int>(i);
  }
  return -1;
}

BelievedTorques::BelievedTorques(std::span<const trajectory::Axis> axes, std::size_t along) {
  for (const trajectory::Axis& axis : axes) {
    const bool given = axis.tau_max > 0 && std::isfinite(axis.tau_max);
    largest_.push_back(given ? kLargest * axis.tau_max : kLargestTorque);
    named_.push_back(kNamed * (given ? axis.tau_max : kWithoutEffort));
  }
  numbers_.add(BelievedNumbers::Kind::kNumber, axes.size() + along);
}

void BelievedTorques::forget() {
  numbers_.forget();
  in_a_row_ = 0;
}

const char* BelievedTorques::add(std::span<const double> tau, std::span<const double> along, bool possible) {
  for (std::size_t i = 0; i < tau.size(); ++i) possible = possible && std::abs(tau[i]) <= largest_[i];
  in_a_row_ = possible ? 0 : in_a_row_ + 1;
  if (in_a_row_ > Belief::kMostHeld) numbers_.forget();
  if (!possible) return kTooStrong;
  bool sound = true;
  for (std::size_t i = 0; i < tau.size(); ++i) {
    const double used = numbers_.put(i, tau[i]);
    sound = sound && (!known() || std::abs(numbers_.expected(i) - used) <= named_[i]);
  }
  for (std::size_t i = 0; i < along.size(); ++i) numbers_.put(tau.size() + i, along[i]);
  return sound ? nullptr : kTooShort;
}

void BelievedSetPoint::forget() {
  positions_.forget();
  moves_.forget();
  first_ = believed_ = before_ = true;
  points_ = 0;
  since_ = 0;
  std::ranges::fill(offset_, 0);
}

const char* BelievedSetPoint::take(std::span<double> q, std::span<const double> q_measured, double elapsed, bool measured,
                                   bool yields, bool follows) {
  before_ = believed_;
  since_ += elapsed;
  free_ = yields || follows;
  const bool explained = positions_.add(q, elapsed) != Belief::Verdict::kHeld, first = std::exchange(first_, false);
  bool near = true;
  for (std::size_t i = 0; i < q.size() && measured; ++i) near = near && std::abs(q[i] - q_measured[i]) <= kFarthest;
  believed_ = first ? near : explained && (near || yields);
  if (!measured) return nullptr;
  for (std::size_t i = 0; i < q.size(); ++i) {
    if (believed_) offset_[i] = q[i] - q_measured[i];
    q[i] = q_measured[i] + offset_[i];
  }
  if (free_) return nullptr;
  const double since = std::exchange(since_, 0);
  points_ = since > 0 ? points_ + 1 : 1;
  for (std::size_t i = 0; i < q.size(); ++i) dq_[i] = points_ > 1 ? (q[i] - before_q_[i]) / since : 0;
  std::ranges::copy(q, before_q_.begin());
  const char* const why = moves_.compare(q_measured, dq_, points_ > 2 ? since : 0);  // the first one has no speed
  if (moves_.differs()) {
    std::ranges::copy(q_measured, q.begin());
    std::ranges::fill(offset_, 0);
  }
  return why;
}

}  // namespace cotwin::io
