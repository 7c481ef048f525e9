#include "models/identification/measurement/torque_watch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/foundation/support/text.h"

namespace cotwin::measurement {

namespace {

constexpr double kLongest = 1;  // s, at the same torque
constexpr double kWay = 0.05;   // of the joint's range, meanwhile
// A torque of low resolution turns at a value that occurs often, too, but the one beside it does not occur much less often.
constexpr double kShare = 0.02, kStep = 4;

}  // namespace

void TorqueWatch::Top::add(double x) {
  if (x > first) {
    second = std::exchange(first, x);
    of_second = std::exchange(of_first, 1);
  } else if (x == first) {
    ++of_first;
  } else if (x > second) {
    second = x;
    of_second = 1;
  } else if (x == second) {
    ++of_second;
  }
}

bool TorqueWatch::add(double t, double q, double tau, bool begins) {
  q_min_ = empty_ ? q : std::min(q_min_, q);
  q_max_ = empty_ ? q : std::max(q_max_, q);
  empty_ = false;
  if (!begins && q != q_) {
    ++moving_;
    top_.add(tau);
    bottom_.add(-tau);
    if (tau != tau_) ++changes_;
  }
  q_ = q;
  if (begins || tau != tau_) {
    tau_ = tau;
    since_ = t;
    from_ = q;
    return false;
  }
  const double way = std::abs(q - from_);
  if (t - since_ < kLongest || way <= way_) return false;
  way_ = way;
  time_ = t - since_;
  return true;
}

std::vector<std::string> TorqueWatch::damage(const trajectory::Axis& axis, const std::string& place,
                                             const std::string& frozen) const {
  const auto number = [](double x) { return text::to_text(x, 4); };
  const double all = static_cast<double>(moving_);
  std::vector<std::string> sentences;
  for (const double sign : {1.0, -1.0}) {
    const Top& end = sign > 0 ? top_ : bottom_;
    const double share = static_cast<double>(end.of_first) / std::max(1.0, all);
    if (share < kShare || static_cast<double>(end.of_first) <= kStep * static_cast<double>(end.of_second)) continue;
    sentences.push_back(
        place + ": is " + number(sign * end.first) + (axis.revolute ? " N.m in " : " N in ") + number(100 * share) +
        " % of the rows with motion, and never beyond, expected an extreme that is met in passing; are torques cut "
        "off there? Then a log with a wider range of torque");
  }
  if (way_ > kWay * (q_max_ - q_min_) && 3 * changes_ > moving_)
    sentences.push_back(frozen + ": stood still for " + number(time_) + " s while " + axis.name + " moved by " + number(way_) +
                        (axis.revolute ? " rad" : " m") +
                        ", expected a torque that changes; did the sensor or its line fail? Then a log without these rows");
  return sentences;
}

}  // namespace cotwin::measurement
