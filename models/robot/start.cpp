#include "models/robot/start.h"

#include <cmath>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::robot {

double default_start(const Joint& joint) {
  if (joint.q_min <= 0 && joint.q_max >= 0) return 0;
  if (std::isfinite(joint.q_min + joint.q_max)) return (joint.q_min + joint.q_max) / 2;
  return std::isfinite(joint.q_min) ? joint.q_min : joint.q_max;
}

void check_start(const std::string& place, std::span<const Joint> joints, std::span<const double> q0,
                 std::span<const double> q_min, std::span<const double> q_max) {
  constexpr double kRounding = 1e-9;  // of the range between the limits
  constexpr double kLargest = 1e6;    // rad or m; far beyond it, angles lose their fraction
  const auto number = [](double x) { return text::to_text(x, 6); };
  for (std::size_t i = 0; i < q0.size(); ++i) {
    const bool slides = joints[i].type == JointType::kPrismatic;
    const double slack = std::isfinite(q_max[i] - q_min[i]) ? kRounding * (q_max[i] - q_min[i]) : 0;
    const auto within = [&](double q) { return q >= q_min[i] - slack && q <= q_max[i] + slack; };
    if (within(q0[i]) && std::abs(q0[i]) <= kLargest) continue;
    const std::string si = slides ? " m" : " rad";
    const std::string expected =
        within(q0[i]) ? "a magnitude of at most " + number(kLargest) : number(q_min[i]) + " to " + number(q_max[i]);
    const bool degrees = !slides && !within(q0[i]) && within(q0[i] * M_PI / 180);
    throw Error(place + ".q0[" + std::to_string(i + 1) + "]", "joint " + joints[i].name + " starts at " + number(q0[i]) + si +
                                                                  ", expected " + expected + si +
                                                                  (degrees ? "; a value in degrees?" : ""));
  }
}

void check_start(const std::string& place, const RobotModel& robot, std::span<const double> q0) {
  std::vector<double> q_min, q_max;
  for (const Joint& joint : robot.joints) {
    q_min.push_back(joint.q_min);
    q_max.push_back(joint.q_max);
  }
  check_start(place, robot.joints, q0, q_min, q_max);
}

}  // namespace cotwin::robot
