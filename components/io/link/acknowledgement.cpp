#include "components/io/link/acknowledgement.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/foundation/support/error.h"

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

bool JumpDetector::add(std::span<const double> q, double elapsed) {
  if (elapsed <= 0) forget();
  // The mean speeds of two intervals differ by the acceleration between their middles.
  const double tolerance = kLargestJump + kLargestAcceleration * elapsed * (elapsed + interval_) / 2;
  bool jumps = false;
  for (std::size_t i = 0; i < q_.size(); ++i) {
    jumps = jumps || (positions_ >= 2 && !(std::abs(q[i] - q_[i] - dq_[i] * elapsed) <= tolerance));
    if (positions_ >= 1) dq_[i] = (q[i] - q_[i]) / elapsed;
    q_[i] = q[i];
  }
  interval_ = elapsed;
  positions_ = jumps ? 1 : std::min(positions_ + 1, 2);
  return jumps;
}

}  // namespace cotwin::io
