#pragma once
#include <algorithm>
#include <cmath>
#include <utility>

#include "models/collision/body.h"

namespace cotwin::collision {

/// A lower bound of the distance of a ball from a box about the origin.
inline double from_box(const Eigen::Vector3d& half, const Eigen::Vector3d& centre, double radius) {
  const Eigen::Vector3d beyond = centre.cwiseAbs() - half;
  const double inside = beyond.maxCoeff();
  return (inside > 0 ? beyond.cwiseMax(0).norm() : inside) - radius;
}

template <class Tree, class Visit>
void Finder::descend(const Body& a, const Tree& b, std::int32_t node, const Pose& X_AB, double grown, const double& most,
                     const Visit& visit) {
  constexpr double kSlack = 1e-12;  // of lower bounds, m and relative
  const auto lower_bound = [&](const auto& of_a, const auto& of_b) {
    const Eigen::Vector3d b_in_A = X_AB * of_b.middle - of_a.middle;
    const double balls = b_in_A.norm() - of_a.radius - of_b.radius - grown;
    if (balls > most) return balls;
    const Eigen::Vector3d a_in_B = -(X_AB.R.transpose() * b_in_A);
    return std::max(
        {balls, from_box(of_a.half, b_in_A, of_b.radius) - grown, from_box(of_b.half, a_in_B, of_a.radius) - grown});
  };
  stack_.clear();
  stack_.push_back({a.root(), node, lower_bound(a.node(a.root()), b.node(node))});
  while (!stack_.empty()) {
    const Step step = stack_.back();
    stack_.pop_back();
    // Bounds of deep overlaps are equal to the depth up to rounding.
    if (step.least > most + kSlack * (1 + std::abs(most))) continue;
    const auto& of_a = a.node(step.a);
    const auto& of_b = b.node(step.b);
    if (of_a.left < 0 && (!visit(of_a, of_b) || of_b.left < 0)) continue;
    const bool divide_a = of_b.left < 0 || (of_a.left >= 0 && of_a.radius > of_b.radius);
    Step near{divide_a ? of_a.left : step.a, divide_a ? step.b : of_b.left, 0};
    Step far{divide_a ? of_a.right : step.a, divide_a ? step.b : of_b.right, 0};
    near.least = lower_bound(a.node(near.a), b.node(near.b));
    far.least = lower_bound(a.node(far.a), b.node(far.b));
    if (far.least < near.least) std::swap(near, far);
    stack_.push_back(far);
    stack_.push_back(near);
  }
}

}  // namespace cotwin::collision
