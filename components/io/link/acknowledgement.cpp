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

JumpDetector::JumpDetector(std::span<const trajectory::Axis> axes) : q_(axes.size()), dq_(axes.size()) {
  std::ranges::transform(axes, std::back_inserter(fastest_), largest_speed);
}

void JumpDetector::declare(Variables& v, const std::string& what) {
  v.output("implausible", implausible_,
           what + " with a position, speed or time that no motion explains, which were not used; 5 in a row are a jump");
}

void JumpDetector::begin() {
  forget();
  implausible_ = 0;
}

void JumpDetector::append_notes(std::vector<std::string>& sentences, const std::string& one) const {
  if (implausible_ == 0) return;
  sentences.push_back(text::counted(implausible_, one) +
                      " not used, with a position, speed or time that no motion explains (damaged, of another scale, or beyond "
                      "twice the limit of speed that the URDF gives the joint)");
}

void JumpDetector::forget() { positions_ = in_a_row_ = 0; }

bool JumpDetector::is_plausible(std::span<const double> q, double elapsed) const {
  // The mean speeds of two intervals differ by the acceleration between their middles.
  const double tolerance = kLargestJump + kLargestAcceleration * elapsed * (elapsed + interval_) / 2;
  for (std::size_t i = 0; i < q_.size(); ++i) {
    const double way = q[i] - q_[i];
    if (positions_ >= 1 && !(std::abs(way) <= kLargestJump + fastest_[i] * elapsed)) return false;
    if (positions_ >= 2 && !(std::abs(way - dq_[i] * elapsed) <= tolerance)) return false;
  }
  return true;
}

JumpDetector::Verdict JumpDetector::add(std::span<const double> q, double elapsed, bool credible) {
  if (elapsed <= 0 && credible) forget();
  const bool plausible = credible && is_plausible(q, elapsed);
  if (!plausible && implausible_ < std::numeric_limits<std::int32_t>::max()) ++implausible_;
  if (!plausible && ++in_a_row_ <= kMostHeld) return Verdict::kHeld;
  in_a_row_ = 0;
  for (std::size_t i = 0; i < q_.size(); ++i) {
    if (positions_ >= 1) dq_[i] = (q[i] - q_[i]) / elapsed;
    q_[i] = q[i];
  }
  interval_ = elapsed;
  positions_ = plausible ? std::min(positions_ + 1, 2) : 1;
  return plausible ? Verdict::kPlausible : Verdict::kJump;
}

}  // namespace cotwin::io
