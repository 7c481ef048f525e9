#include "components/io/link/acknowledgement.h"

#include <algorithm>

#include "models/foundation/support/error.h"

namespace cotwin::io {

namespace {

constexpr const char* kAcknowledged = "acknowledged";
constexpr const char* kAutomatic = "automatic";

}  // namespace

void Acknowledgement::declare(Variables& v, const std::string& withheld, const std::string& ready) {
  v.output("awaits_acknowledgement", awaits_,
           "whether " + withheld + " after a loss until acknowledge rises (restart=acknowledged)");
  v.input("acknowledge", acknowledge_, "ends that when it was off for three steps and then on for 50 ms while " + ready);
  v.parameter("restart", restart_,
              "after a loss: acknowledged (" + withheld + " until acknowledge rises) or automatic (until " + ready + ")");
}

void Acknowledgement::begin(const std::string& place) {
  if (restart_ != kAcknowledged && restart_ != kAutomatic) {
    throw Error(place, "restart is '" + restart_ + "', expected " + kAcknowledged + " or " + kAutomatic);
  }
  awaits_ = false;
  low_ = 0;
  high_ = 0;
}

void Acknowledgement::demand() {
  awaits_ = restart_ == kAcknowledged;
  if (acknowledge_) low_ = 0;
  high_ = 0;
}

void Acknowledgement::decide(bool ready, bool believed, double h) {
  constexpr double kRounding = 1e-9;  // s, of a sum of steps
  if (acknowledge_ && !ready) low_ = 0;
  if (!believed) return;
  if (!acknowledge_) {
    low_ = high_ > 0 ? 1 : std::min(low_ + 1, kLowSteps);
    high_ = 0;
    return;
  }
  if (low_ < kLowSteps) low_ = 0;
  high_ = low_ > 0 ? high_ + h : 0;
  if (high_ >= kHighTime - kRounding) awaits_ = false;
}

}  // namespace cotwin::io
