// The least distance between two instants.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "components/monitor/monitor.h"
#include "models/mechanics/pose_values.h"
#include "models/scene/robot_links.h"

namespace cotwin::monitor {
namespace {

/// least_distance is at most this share of how far a pair can have moved, or this share of itself, or this length, too large.
constexpr double kShareOfWay = 0.05, kShare = 1e-3, kLeastError = 1e-6;  // 1, 1, m

Pose between(const Pose& from, const Pose& to, double share) {
  const Eigen::Quaterniond a(from.R), b(to.R);
  return {a.slerp(share, b).toRotationMatrix(), from.p + share * (to.p - from.p)};
}

double travel_of(const Pose& from, const Pose& to, double reach) {
  const double angle = Eigen::Quaterniond(from.R).angularDistance(Eigen::Quaterniond(to.R));
  return (to.p - from.p).norm() + (angle > 0 ? angle * reach : 0);
}

}  // namespace

/// An upper bound of how far a point of the part has moved since the last step. Obstacles jump.
double Monitor::motion(std::size_t k) const {
  const collision::Part& part = cell_.parts[k];
  if (part.robot < 0)
    return part.moves && !bodies_[k]->comes ? travel_of(bodies_[k]->pose.X_before, part.X_W, part.body.reach()) : 0;
  const Robot& r = robot_of(part);
  double reach = 0;
  const double travel = cell_.travel(part, -1, r.q_before, r.moved, reach);
  return floating_ ? travel + travel_of(r.base.X_before, r.X_WB, reach) : travel;
}

/// The pose of a part at a share of the step.
Pose Monitor::pose_at(std::size_t k, double share) {
  const collision::Part& part = cell_.parts[k];
  if (part.robot < 0) return part.moves && !bodies_[k]->comes ? between(bodies_[k]->pose.X_before, part.X_W, share) : part.X_W;
  Robot& r = robot_of(part);
  const Pose X_WB = floating_ ? between(r.base.X_before, r.X_WB, share) : r.X_WB;
  if (part.link < 0) return X_WB;
  if (r.at != share) {
    for (std::size_t i = 0; i < r.q.size(); ++i) r.q_at[i] = r.q_before[i] + share * (r.q[i] - r.q_before[i]);
    scene::place_links(r.placed->model, X_WB, r.q_at, r.zeros, r.X_WL_at, r.V_WL_at);
    r.at = share;
  }
  return r.X_WL_at[static_cast<std::size_t>(part.link)];
}

void Monitor::find_motions() {
  for (const auto& body : bodies_) body->pose.X_before = body->pose.last();
  for (const auto& robot : robots_) {
    robot->base.X_before = robot->base.last();
    for (std::size_t i = 0; i < robot->q.size(); ++i) robot->moved[i] = std::abs(robot->q[i] - robot->q_before[i]);
  }
  for (std::size_t k = 0; k < motions_.size(); ++k) motions_[k] = motion(k);
}

void Monitor::sweep() {
  for (std::size_t g = 0; g < groups(); ++g) least_[g] = nearest_[g].d;
  for (std::size_t k = 0; k < cell_.pairs.size(); ++k) {
    const collision::Pair& pair = cell_.pairs[k];
    const auto [group_a, group_b] = groups_of(pair);
    const double moved = motions_[pair.a] + motions_[pair.b], grown = inflation(pair);
    const double most = std::max(least_[group_a], least_[group_b]);
    // A motion without a bound, of a plane that turns, is left out.
    if (pair.self || !(moved > 0 && moved < scene::kInfinity) || bounds_[k] - moved >= most) continue;
    const auto enough = [&](double d) {
      const double known = std::min(d, most), error = std::max({kShareOfWay * moved, kShare * known, kLeastError});
      return known > 0 ? std::max(0.0, known - error) : known - error;
    };
    const auto measure = [&](double share, double more) {
      const double d = cell_.distance(pair, pose_at(pair.a, share), pose_at(pair.b, share), more + grown).d - grown;
      return std::min(d, more);
    };
    // A bound below most + moved is the distance.
    const double least = collision::least_distance(
                             {0, 1, measure(0, most + moved), bounds_[k]}, {}, intervals_, measure,
                             [&](double from, double to) { return moved * (to - from); }, enough)
                             .d;
    for (const std::size_t group : {group_a, group_b}) least_[group] = std::min(least_[group], least);
  }
}

}  // namespace cotwin::monitor
