#include "models/trajectory/axes.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"

namespace cotwin::trajectory {

std::vector<Axis> axes_of(const robot::RobotModel& robot) {
  std::vector<Axis> axes;
  for (const robot::Joint& joint : robot.joints) {
    Axis axis;
    axis.name = joint.name;
    axis.revolute = joint.type == robot::JointType::kRevolute;
    axis.q_min = joint.q_min;
    axis.q_max = joint.q_max;
    axis.dq_max = joint.dq_max;
    axis.ddq_max = joint.ddq_max;
    axis.dddq_max = joint.dddq_max;
    axis.tau_max = joint.tau_max;
    axes.push_back(axis);
  }
  return axes;
}

std::vector<Axis> free_axes(std::size_t n) {
  std::vector<Axis> axes(n);
  for (std::size_t j = 0; j < n; ++j) axes[j].name = "joint " + std::to_string(j + 1);
  return axes;
}

namespace {

struct Limit {
  double value;
  const char* verb;
  const char* per;
};

}  // namespace

std::string limit_violation(const Path& path, const Phase& phase, std::span<const Axis> axes, double tolerance) {
  assert(axes.size() == path.joints());
  const auto number = [](double x) { return text::to_text(x, 6); };
  const auto when = [&](const Peak& peak) { return " at " + number(phase.time_of(peak.t - path.begin())) + " s"; };
  for (std::size_t j = 0; j < axes.size(); ++j) {
    const Axis& axis = axes[j];
    const std::string si = axis.revolute ? " rad" : " m";
    const Path::Range q = path.range(j, 0);
    const double slack = std::isfinite(axis.q_max - axis.q_min) ? tolerance * (axis.q_max - axis.q_min) : 0;
    if (q.min.value < axis.q_min - slack || q.max.value > axis.q_max + slack) {
      const Peak& peak = q.min.value < axis.q_min - slack ? q.min : q.max;
      return axis.name + " is at " + number(peak.value) + si + when(peak) + ", expected " + number(axis.q_min) + " to " +
             number(axis.q_max) + si;
    }
    const Limit limits[] = {{axis.dq_max, " moves with ", "/s"},
                            {axis.ddq_max, " accelerates with ", "/s2"},
                            {axis.dddq_max, " has a jerk of ", "/s3"}};
    for (int derivative = 1; derivative <= 3; ++derivative) {
      const Limit& limit = limits[derivative - 1];
      if (std::isinf(limit.value)) continue;
      const double value = bound(path, phase, j, derivative);
      if (value <= limit.value * (1 + tolerance)) continue;
      return axis.name + limit.verb + number(value) + si + limit.per + when(path.range(j, derivative).largest()) +
             ", expected at most " + number(limit.value) + si + limit.per;
    }
  }
  return {};
}

}  // namespace cotwin::trajectory
