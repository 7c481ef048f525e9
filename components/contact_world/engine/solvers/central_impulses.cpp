#include "components/contact_world/engine/solvers/central_impulses.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/solvers/numbers.h"

namespace cotwin::contact_world {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kMostSteps = 60;

/// τ at the start, relative to the energy of a mean impulse, and the share of it that is left after a step of full length.
constexpr double kFirst = 0.03, kFalls = 0.2;

/// Share of the way to the bounds that a step takes at most, and by which it is shortened until it does.
constexpr double kInside = 0.9, kShortens = 0.7;

/// Least start of an impulse relative to the mean one, and largest of friction relative to its bound.
constexpr double kLeastLoad = 0.3, kMostFriction = 0.5;

/// |w| of the result relative to that which is enough; weight of rows against the bodies' coordinates where contradictions are found.
constexpr double kFine = 1e-4, kWeight = 1e8;

/// Stiffness of rows without bounds or softness, relative to their mobility.
constexpr double kRigid = 1e-9;

/// Calls f(coordinate, y) with the coefficients of each coordinate.
template <typename F>
void for_columns(const CentralImpulses::Block& block, const F& f) {
  for (const CentralImpulses::Block::Part& part : block.part) {
    for (int i = 0; i < part.size; ++i) {
      Vector3d y = Vector3d::Zero();
      for (int k = 0; k < block.count; ++k) y[k] = part.y[k * part.size + i];
      f(index(part.first + i), y);
    }
  }
}

double mobility(const CentralImpulses::Block& block) {
  double sum = 0;
  for_columns(block, [&](std::size_t, const Vector3d& y) { sum += y[0] * y[0]; });
  return sum;
}

}  // namespace

void CentralImpulses::reserve(std::size_t blocks, std::size_t coordinates) {
  const std::size_t n = std::min(coordinates, index(kMostCoordinates));
  blocks_.reserve(blocks);
  matrix_.reserve(n * n);
  v_.reserve(n);
  ldl_.reserve(static_cast<int>(n));
}

/// Whether the rows are within their bounds after this share of the step.
bool CentralImpulses::inside(const Block& block, double share) {
  const Vector3d x = block.x + share * block.step;
  if (block.count == 1) return x[0] > block.lo && x[0] < block.hi;
  return std::hypot(x[1], x[2]) < block.mu * x[0];
}

/// Sets a step to a point inside the bounds.
void CentralImpulses::place_inside(Block& block, double load) {
  if (block.count == 1) {
    const double from = std::min(kLeastLoad * load, (block.hi - block.lo) / 4);
    block.step = {std::clamp(block.x[0], block.lo + from, block.hi - from) - block.x[0], 0, 0};
    return;
  }
  const double n = std::max(block.x[0], kLeastLoad * load), t = std::hypot(block.x[1], block.x[2]);
  const double share = std::min(1.0, t > 0 ? kMostFriction * block.mu * n / t : 0);
  block.step = {n - block.x[0], (share - 1) * block.x[1], (share - 1) * block.x[2]};
}

/// Gradient of τ B, and the inverse of D = τ B″ + softness.
void CentralImpulses::differentiate(Block& block, double tau) {
  block.gradient.setZero();
  block.inverse.setZero();
  if (block.count == 1) {
    double stiffness = block.softness;
    const auto add = [&](double inwards) {
      block.gradient[0] -= tau * inwards;
      stiffness += tau * inwards * inwards;
    };
    if (block.lo > -kInfinity) add(1 / (block.x[0] - block.lo));
    if (block.hi < kInfinity) add(-1 / (block.hi - block.x[0]));
    block.inverse(0, 0) = 1 / (stiffness > 0 ? stiffness : kRigid * mobility(block));
    return;
  }
  const Vector3d Q(block.mu * block.mu, -1, -1), u = Q.cwiseProduct(block.x);
  const double product = u.dot(block.x);
  block.gradient = -2 * tau / product * u;
  Matrix3d D = 4 * tau / (product * product) * u * u.transpose();
  D.diagonal() -= 2 * tau / product * Q;
  D(0, 0) += block.softness;
  block.inverse = D.inverse();
}

/// Factors I + Yᵀ D⁻¹ Y.
bool CentralImpulses::factor() {
  std::fill(matrix_.begin(), matrix_.end(), 0.0);
  for (std::size_t i = 0; i < n_; ++i) matrix_[i * (n_ + 1)] = 1;
  for (const Block& block : blocks_) {
    for_columns(block, [&](std::size_t i, const Vector3d& y) {
      const Vector3d t = block.inverse * y;
      for_columns(block, [&](std::size_t j, const Vector3d& other) {
        if (j <= i) matrix_[i * n_ + j] += t.dot(other);
      });
    });
  }
  ldl_.clear(static_cast<int>(n_));
  for (int i = 0; i < static_cast<int>(n_); ++i) {
    const double* row = matrix_.data() + index(i) * n_;
    if (!(ldl_.pivot(i, row, row[i]) > 0)) return false;
    ldl_.append();
  }
  return true;
}

/// Sets the Newton steps to the centre, or to w = 0.
void CentralImpulses::find_steps(bool to_rest) {
  const auto pull = [&](const Block& block) { return to_rest ? block.w : Vector3d(block.w + block.gradient); };
  std::fill(v_.begin(), v_.end(), 0.0);
  for (const Block& block : blocks_) {
    const Vector3d free = block.inverse * pull(block);
    for_columns(block, [&](std::size_t i, const Vector3d& y) { v_[i] -= y.dot(free); });
  }
  ldl_.solve(v_.data());
  for (Block& block : blocks_) {
    Vector3d w = pull(block);
    for_columns(block, [&](std::size_t i, const Vector3d& y) { w += v_[i] * y; });
    block.step = -(block.inverse * w);
  }
}

/// Moves by a share of the step. Returns the largest |w|.
double CentralImpulses::move(double share) {
  std::fill(v_.begin(), v_.end(), 0.0);
  for (const Block& block : blocks_) {
    for_columns(block, [&](std::size_t i, const Vector3d& y) { v_[i] += share * y.dot(block.step); });
  }
  double largest = 0;
  for (Block& block : blocks_) {
    block.x += share * block.step;
    block.w[0] += share * block.softness * block.step[0];
    for_columns(block, [&](std::size_t i, const Vector3d& y) { block.w += v_[i] * y; });
    largest = std::max(largest, block.w.cwiseAbs().maxCoeff());
  }
  return largest;
}

/// Takes from w of the rows what no impulses can change, by least squares. Returns the largest part.
double CentralImpulses::drop_contradictions() {
  double scale = 0, largest = 0;
  for (const Block& block : blocks_) scale = std::max(scale, mobility(block));
  for (Block& block : blocks_) {
    block.inverse.setZero();
    for (int k = 0; k < block.count; ++k) block.inverse(k, k) = k == 0 && block.softness > 0 ? 0 : kWeight / scale;
  }
  if (!(scale > 0) || !factor()) return kInfinity;
  find_steps(true);
  for (Block& block : blocks_) {
    const Vector3d rest = -block.step * scale / kWeight;
    block.w -= rest;
    largest = std::max(largest, rest.cwiseAbs().maxCoeff());
  }
  return largest;
}

bool CentralImpulses::solve(int coordinates, double enough) {
  n_ = index(coordinates);
  matrix_.resize(n_ * n_);
  v_.resize(n_);
  if (!(drop_contradictions() <= enough)) return false;
  double load = 0, contacts = 0, tau = 0;
  for (const Block& block : blocks_) {
    if (block.count != 3) continue;
    load += std::max(0.0, block.x[0]);
    ++contacts;
  }
  if (!(load > 0)) return false;
  load /= contacts;
  for (Block& block : blocks_) {
    place_inside(block, load);
    if (block.count == 3) tau += kFirst / contacts * mobility(block) * load * load;
  }
  if (!(tau > 0)) return false;
  move(1);
  const auto all_inside = [&](double share) {
    return std::all_of(blocks_.begin(), blocks_.end(), [&](const Block& block) { return inside(block, share); });
  };
  for (int step = 0; step < kMostSteps; ++step) {
    for (Block& block : blocks_) differentiate(block, tau);
    if (!factor()) return false;
    find_steps(true);
    if (all_inside(1 / kInside)) {
      if (move(1) <= kFine * enough) return true;
      tau *= kFalls;
      continue;
    }
    find_steps(false);
    double share = 1;
    while (!all_inside(share / kInside) && share > 1e-6) share *= kShortens;
    const double largest = move(share);
    if (share < 1) continue;
    if (largest <= enough) return true;  // some are zero in every solution
    tau *= kFalls;
  }
  return false;
}

}  // namespace cotwin::contact_world
