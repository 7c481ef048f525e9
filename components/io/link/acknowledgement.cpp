#include "components/io/link/acknowledgement.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

constexpr const char* kAcknowledged = "acknowledged";
constexpr const char* kAutomatic = "automatic";

}  // namespace

void Acknowledgement::declare(Variables& v, const std::string& withheld, const std::string& ready) {
  v.output("awaits_acknowledgement", awaits_,
           "whether " + withheld + " after a loss until acknowledge rises (restart=acknowledged)");
  v.input("acknowledge", acknowledge_, "a rising edge while " + ready + " ends that");
  v.parameter("restart", restart_,
              "after a loss: acknowledged (" + withheld + " until acknowledge rises) or automatic (until " + ready + ")");
}

void Acknowledgement::begin(const std::string& place) {
  if (restart_ != kAcknowledged && restart_ != kAutomatic) {
    throw Error(place, "restart is '" + restart_ + "', expected " + kAcknowledged + " or " + kAutomatic);
  }
  awaits_ = false;
  before_ = true;
}

void Acknowledgement::demand() { awaits_ = restart_ == kAcknowledged; }

void Acknowledgement::decide(bool ready) {
  const bool before = std::exchange(before_, acknowledge_);
  if (acknowledge_ && !before && ready) awaits_ = false;
}

double largest_speed(const trajectory::Axis& axis) {
  return axis.dq_max > 0 ? 2 * axis.dq_max : std::numeric_limits<double>::infinity();
}

JumpDetector::JumpDetector(std::span<const trajectory::Axis> axes)
    : largest_jump_(axes.size(), kLargestJump), believed_(axes.size()), recent_(axes.size()) {
  for (const trajectory::Axis& axis : axes) {
    fastest_.push_back(largest_speed(axis));
    q_least_.push_back(axis.q_min - kMargin);
    q_most_.push_back(axis.q_max + kMargin);
  }
}

void JumpDetector::declare(Variables& v, const std::string& what) {
  v.output("implausible", implausible_,
           what +
               " with a position, speed, time, torque or force that no motion or hit explains, which was not used; 5 "
               "positions in a row are a jump");
}

void JumpDetector::begin() {
  forget();
  implausible_ = 0;
}

void JumpDetector::count_implausible() {
  if (implausible_ < std::numeric_limits<std::int32_t>::max()) ++implausible_;
}

void JumpDetector::append_notes(std::vector<std::string>& sentences, const std::string& one) const {
  if (implausible_ == 0) return;
  sentences.push_back(text::counted(implausible_, one) +
                      " not used or not wholly, because no motion or hit explains a value (damaged, of another scale, or "
                      "beyond twice the speed or ten times the effort of the joint in the URDF)");
}

void JumpDetector::set_resolution(std::size_t i, double resolution) {
  largest_jump_[i] = std::max(kLargestJump, kLargestCounts * std::abs(resolution));
}

void JumpDetector::forget() {
  believed_.positions = recent_.positions = in_a_row_ = 0;
  since_ = 0;
  lost_ = false;
}

void JumpDetector::Track::append(std::span<const double> q_next, double elapsed) {
  for (std::size_t i = 0; i < q.size(); ++i) {
    if (positions > 0) dq[i] = (q_next[i] - q[i]) / elapsed;
    q[i] = q_next[i];
  }
  duration = positions > 0 ? duration + elapsed : 0;
  interval = elapsed;
  positions = std::min(positions + 1, 1000);
}

bool JumpDetector::explains(const Track& track, std::span<const double> q, double elapsed) const {
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
bool JumpDetector::is_confirmed(std::span<const double> q) const {
  const bool limited = std::ranges::all_of(fastest_, [](double dq) { return std::isfinite(dq); });
  bool inside = true;
  for (std::size_t i = 0; i < q.size(); ++i) inside = inside && q[i] >= q_least_[i] && q[i] <= q_most_[i];
  if (!inside && recent_.duration < kOutsideTime) return false;
  if (believed_.positions == 0) return recent_.positions >= (limited ? 2 : 3);
  return in_a_row_ > kMostHeld && recent_.positions > kMostHeld;
}

JumpDetector::Verdict JumpDetector::add(std::span<const double> q, double elapsed, bool in_time, bool possible) {
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
  if (plausible) {
    believed_.append(q, since_);
  } else {
    ++in_a_row_;
    if (!begins || !(first || follows)) count_implausible();
    if (!possible || !is_confirmed(q)) return Verdict::kHeld;
    believed_ = recent_;
  }
  since_ = in_a_row_ = 0;
  const bool begun = begins && !std::exchange(lost_, false);
  return plausible ? Verdict::kPlausible : begun ? Verdict::kFirst : Verdict::kJump;
}

}  // namespace cotwin::io
