#include "models/robot/urdf/estimate.h"

#include <algorithm>
#include <cmath>

#include "models/numerics/dense.h"

namespace cotwin::robot {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kDensity = 2700;  // kg/m³, aluminium

/// Of a solid sphere of this mass.
Matrix3d sphere(double mass) {
  const double radius = std::cbrt(3 * mass / (4 * M_PI * kDensity));
  return 0.4 * mass * radius * radius * Matrix3d::Identity();
}

/// A solid cylinder from the origin to `end`.
Inertia rod(const Vector3d& end, double radius) {
  const double length = end.norm();
  const Vector3d axis = end / length;
  const double mass = kDensity * M_PI * radius * radius * length;
  const double along = mass * radius * radius / 2, across = mass * (3 * radius * radius + length * length) / 12;
  return {mass, end / 2, across * Matrix3d::Identity() + (along - across) * Matrix3d(axis * axis.transpose())};
}

}  // namespace

Inertia repaired(const Inertia& given) {
  if (!(given.mass > 0) || !std::isfinite(given.mass) || !given.p_LC.allFinite() || !given.I_CC.allFinite()) return {};
  constexpr double kSmallest = 1e-3;  // of the largest second moment
  const Matrix3d I = (given.I_CC + given.I_CC.transpose()) / 2;
  const double scale = I.cwiseAbs().maxCoeff();
  if (scale == 0) return {given.mass, given.p_LC, sphere(given.mass)};
  const auto second = numerics::symmetric_eigen<3>(Matrix3d((0.5 * I.trace() * Matrix3d::Identity() - I) / scale));
  const double largest = second.values.maxCoeff();
  if (!(largest > 0)) return {given.mass, given.p_LC, sphere(given.mass)};
  const Vector3d raised = scale * second.values.cwiseMax(kSmallest * largest);
  Matrix3d Sigma = second.vectors * raised.asDiagonal() * second.vectors.transpose();
  Sigma = (Sigma + Sigma.transpose()).eval() / 2;
  return {given.mass, given.p_LC, Sigma.trace() * Matrix3d::Identity() - Sigma};
}

double reach_of(const RobotModel& robot) {
  std::vector<double> length(robot.bodies.size(), 0.0);  // from the first joint of the chain to the body's joint
  for (const int body : robot.depth_first()) {
    const Joint& joint = robot.joint_of(body);
    if (joint.parent >= 0)
      length[static_cast<std::size_t>(body)] = length[static_cast<std::size_t>(joint.parent)] + joint.X_PJ.p.norm();
  }
  double longest = 0;
  for (const double l : length) longest = std::max(longest, l);
  for (const Frame& frame : robot.frames)
    if (frame.body >= 0) longest = std::max(longest, length[static_cast<std::size_t>(frame.body)] + frame.X_BF.p.norm());
  return longest;
}

std::vector<Inertia> estimated_inertia(const RobotModel& robot) {
  constexpr double kShortest = 0.1;  // of the reach: a rod's length
  constexpr double kRadius = 0.05;
  constexpr double kSmallestReach = 0.05;  // m; a lone wheel has none
  const double reach = std::max(reach_of(robot), kSmallestReach);
  std::vector<Vector3d> ends(robot.bodies.size(), Vector3d::Zero());
  const auto carries = [&](int body, const Vector3d& p) {
    if (body < 0) return;
    Vector3d& end = ends[static_cast<std::size_t>(body)];
    if (p.norm() > end.norm()) end = p;
  };
  for (int body = 0; body < robot.body_count(); ++body) carries(robot.joint_of(body).parent, robot.joint_of(body).X_PJ.p);
  for (const Frame& frame : robot.frames) carries(frame.body, frame.X_BF.p);
  std::vector<Inertia> bodies;
  for (int body = 0; body < robot.body_count(); ++body) {
    Vector3d end = ends[static_cast<std::size_t>(body)];
    if (end.norm() < kShortest * reach) {  // also where nothing is known of its direction
      const Vector3d direction = end.norm() > 1e-6 * reach ? end : robot.joint_of(body).axis;
      end = kShortest * reach * direction.normalized();
    }
    bodies.push_back(rod(end, kRadius * reach));
  }
  return bodies;
}

}  // namespace cotwin::robot
