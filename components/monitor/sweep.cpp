// The least distance between two instants.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "components/monitor/parts.h"
#include "models/mechanics/pose_values.h"
#include "models/scene/robot_links.h"

namespace cotwin::monitor {
namespace {

using Eigen::Vector3d;

/// least_distance is at most this share of the way that a pair can have moved, or this share of itself, or this length, too large.
constexpr double kShareOfWay = 0.05, kShare = 1e-3, kLeastError = 1e-6;  // 1, 1, m
/// Distances that are measured for a pair in a step, at most; then a lower bound counts.
constexpr int kMostEvaluations = 500;

Pose between(const Pose& from, const Pose& to, double share) {
  const Eigen::Quaterniond a(from.R), b(to.R);
  return {a.slerp(share, b).toRotationMatrix(), from.p + share * (to.p - from.p)};
}

double way_of(const Pose& from, const Pose& to, double reach) {
  const double angle = Eigen::Quaterniond(from.R).angularDistance(Eigen::Quaterniond(to.R));
  return (to.p - from.p).norm() + (angle > 0 ? angle * reach : 0);
}

}  // namespace

/// An upper bound of the way that a point of the part has moved since the last step: of each joint on the way to the base, its motion times the
/// longest lever that it can have.
double Monitor::motion(const Part& part) const {
  double reach = part.solid.reach();
  if (part.robot < 0) return part.moves && !part.comes ? way_of(part.X_W_before, part.X_W, reach) : 0;  // obstacles jump
  const Robot& r = *robots_[static_cast<std::size_t>(part.robot)];
  const robot::RobotModel& model = r.placed->model;
  double way = 0;
  for (int link = part.link; link >= 0; link = model.joint_of(link).parent) {
    const robot::Joint& joint = model.joint_of(link);
    const auto i = static_cast<std::size_t>(link);
    const double from = scene::position_of(model, i, r.q_before), to = scene::position_of(model, i, r.q);
    const bool turns = joint.type == robot::JointType::kRevolute;
    way += std::abs(to - from) * (turns ? reach : 1);
    reach += joint.X_PJ.p.norm() + (turns ? 0 : std::max(std::abs(from), std::abs(to)));
  }
  return floating_ ? way + way_of(r.X_WB_before, r.X_WB, reach) : way;
}

/// The pose of a part at a share of the step.
Pose Monitor::pose_at(const Part& part, double share) {
  if (part.robot < 0) return part.moves && !part.comes ? between(part.X_W_before, part.X_W, share) : part.X_W;
  Robot& r = *robots_[static_cast<std::size_t>(part.robot)];
  const Pose X_WB = floating_ ? between(r.X_WB_before, r.X_WB, share) : r.X_WB;
  if (part.link < 0) return X_WB;
  if (r.at != share) {
    for (std::size_t i = 0; i < r.q.size(); ++i) r.q_at[i] = r.q_before[i] + share * (r.q[i] - r.q_before[i]);
    scene::place_links(r.placed->model, X_WB, r.q_at, r.zeros, r.X_WL_at, r.V_WL);
    r.at = share;
  }
  return r.X_WL_at[static_cast<std::size_t>(part.link)];
}

/// The least distance of a pair that ends at `last` and whose points move by at most `motion` (m), if it is below `most`. The distance in an interval is at least
/// (d_from + d_to - motion (to - from)) / 2 (Piyavskii 1972); the interval is divided until that says enough.
double Monitor::least_distance(const Pair& pair, double last, double motion, double most) {
  const Part &a = *parts_[pair.a], &b = *parts_[pair.b];
  const auto measure = [&](double share) {
    return finder_.find(a.solid, pose_at(a, share), b.solid, pose_at(b, share)).d - inflation(pair);
  };
  const double first = measure(0);
  double least = std::min(first, last), bound = least;
  int evaluations = 1;
  intervals_.clear();
  intervals_.push_back({0, 1, first, last});
  while (!intervals_.empty()) {
    const Interval interval = intervals_.back();
    intervals_.pop_back();
    const double width = interval.to - interval.from;
    const double lowest = (interval.d_from + interval.d_to - motion * width) / 2, known = std::min(least, most);
    const double error = std::max({kShareOfWay * motion, kShare * known, kLeastError});
    if (lowest >= known - error && !(lowest < 0 && known > 0)) continue;
    if (evaluations == kMostEvaluations || intervals_.size() + 2 > intervals_.capacity()) {
      bound = std::min(bound, lowest);
      continue;
    }
    ++evaluations;
    // Where the bound is the lowest, but not at an end.
    const double share = std::clamp(0.5 + (interval.d_from - interval.d_to) / (2 * motion * width), 0.1, 0.9);
    const double middle = interval.from + share * width, d = measure(middle);
    least = std::min(least, d);
    intervals_.push_back({middle, interval.to, d, interval.d_to});
    intervals_.push_back({interval.from, middle, interval.d_from, d});
  }
  return std::min(least, bound);
}

void Monitor::find_motions() {
  const auto pose = [](const Values& v) {
    return Pose{Eigen::Quaterniond(v[3], v[4], v[5], v[6]).normalized().toRotationMatrix(), {v[0], v[1], v[2]}};
  };
  for (const auto& body : bodies_) parts_[body->part]->X_W_before = pose(body->before);
  for (const auto& robot : robots_) robot->X_WB_before = pose(robot->base_before);
  for (const auto& part : parts_) part->motion = motion(*part);
}

void Monitor::sweep() {
  for (std::size_t g = 0; g < groups(); ++g) least_[g] = nearest_[g].way.d;
  for (std::size_t k = 0; k < pairs_.size(); ++k) {
    const Pair& pair = pairs_[k];
    const double moved = parts_[pair.a]->motion + parts_[pair.b]->motion;
    const double most = std::max(least_[pair.group_a], least_[pair.group_b]);
    // A motion without a bound, of a plane that turns, is left out.
    if (pair.inflated == 0 || !(moved > 0 && moved < scene::kInfinity) || bounds_[k] - moved >= most) continue;
    // A bound below most + moved is the distance.
    const double least = least_distance(pair, bounds_[k], moved, most);
    for (const std::size_t group : {pair.group_a, pair.group_b}) least_[group] = std::min(least_[group], least);
  }
}

}  // namespace cotwin::monitor
