#include "models/control/goals.h"

#include <algorithm>
#include <cmath>

namespace cotwin::control {

double posture(const VectorIn& q, const VectorIn& q_0, const VectorIn& K, VectorOut gradient) {
  double V = 0;
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const double force = K[i] * (q[i] - q_0[i]);
    gradient[i] += force;
    V += force * (q[i] - q_0[i]) / 2;
  }
  return V;
}

double joint_limits(const VectorIn& q, const VectorIn& q_min, const VectorIn& q_max, double weight, double margin,
                    VectorOut gradient) {
  constexpr double kStraight = 0.01;  // of the margin
  double V = 0;
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const double range = q_max[i] - q_min[i];
    if (!(range > 0 && std::isfinite(range))) continue;
    const bool upper = q[i] > q_min[i] + range / 2;
    const double x = (upper ? q_max[i] - q[i] : q[i] - q_min[i]) / range;
    if (x >= margin) continue;
    const double at = std::max(x, kStraight * margin);
    const double root = 1 / at - 1 / margin;
    const double slope = -2 * root / (at * at);  // by x
    V += weight * (root * root + slope * (x - at));
    gradient[i] += weight * (upper ? -slope : slope) / range;
  }
  return V;
}

EffectiveMassGoal::EffectiveMassGoal(int n) : inertia_(n), slope_(n) {}

double EffectiveMassGoal::add(const robot::Mechanism& mechanism, robot::Data& data, const VectorIn& q, const VectorIn& B,
                              const robot::FrameOnBody& frame, const Eigen::Vector3d& e, robot::Direction direction,
                              double weight, VectorOut gradient) {
  robot::frame_inertia(mechanism, data, q, B, frame, inertia_);
  const Eigen::Vector3d u = direction == robot::Direction::kInFrame ? Eigen::Vector3d(inertia_.X_BF.R * e) : e;
  m_u = robot::effective_mass(inertia_, u);
  if (weight == 0 || !std::isfinite(m_u)) return 0;
  robot::effective_mass_gradient(mechanism, data, q, frame, inertia_, u, direction, slope_);
  gradient += weight * slope_;
  return weight * m_u;
}

ManipulabilityGoal::ManipulabilityGoal(int n, Rows rows, double length)
    : first_(rows == Rows::kRotation ? 3 : 0),
      rows_(rows == Rows::kBoth ? 6 : 3),
      tall_(rows_ > n),
      length_(length),
      q_(n),
      J_(6, n),
      rows_of_J_(rows_, n),
      plus_(rows_, n),
      G_(tall_ ? n : rows_, tall_ ? n : rows_),
      factor_(Eigen::MatrixXd::Identity(G_.rows(), G_.rows())) {}

void ManipulabilityGoal::update_jacobian(const robot::Mechanism& mechanism, robot::Data& data, const VectorIn& q,
                                         const robot::FrameOnBody& frame) {
  robot::jacobian(mechanism, data, q, frame, J_);
  J_.bottomRows<3>() *= length_;
}

void ManipulabilityGoal::factorise(double addition) {
  if (tall_) {
    G_.noalias() = rows_of_J_.transpose() * rows_of_J_;
  } else {
    G_.noalias() = rows_of_J_ * rows_of_J_.transpose();
  }
  G_.diagonal().array() += addition;
  factor_.compute(G_);
}

double ManipulabilityGoal::w(const robot::Mechanism& mechanism, robot::Data& data, const VectorIn& q,
                             const robot::FrameOnBody& frame) {
  update_jacobian(mechanism, data, q, frame);
  rows_of_J_ = J_.middleRows(first_, rows_);
  factorise(0);
  if (factor_.info() != Eigen::Success) return 0;
  double w = 1;
  for (Eigen::Index i = 0; i < G_.rows(); ++i) w *= factor_.matrixLLT()(i, i);
  return w;
}

// V = −½ weight ln det G, G = J Jᵀ + ε² 1:  ∂V/∂q_i = −weight tr(Jᵀ G⁻¹ ∂J/∂q_i). For G = Jᵀ J + ε² 1: −weight tr(G⁻¹ Jᵀ ∂J/∂q_i).
double ManipulabilityGoal::add(const robot::Mechanism& mechanism, robot::Data& data, const VectorIn& q,
                               const robot::FrameOnBody& frame, double weight, VectorOut gradient) {
  constexpr double kEpsilon = 1e-3;  // m per rad
  constexpr double kStep = 1e-4;     // rad
  if (weight == 0) return 0;
  update_jacobian(mechanism, data, q, frame);
  rows_of_J_ = J_.middleRows(first_, rows_);
  factorise(kEpsilon * kEpsilon);
  double V = 0;
  for (Eigen::Index i = 0; i < G_.rows(); ++i) V -= weight * std::log(factor_.matrixLLT()(i, i));
  if (tall_) {  // (J G⁻¹)ᵀ
    for (Eigen::Index i = 0; i < rows_; ++i) {
      q_ = rows_of_J_.row(i);
      factor_.solveInPlace(q_);
      plus_.row(i) = q_;
    }
  } else {
    plus_ = rows_of_J_;
    factor_.solveInPlace(plus_);
  }
  q_ = q;
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    q_[i] = q[i] + kStep;
    update_jacobian(mechanism, data, q_, frame);
    double change = plus_.cwiseProduct(J_.middleRows(first_, rows_)).sum();
    q_[i] = q[i] - kStep;
    update_jacobian(mechanism, data, q_, frame);
    change -= plus_.cwiseProduct(J_.middleRows(first_, rows_)).sum();
    q_[i] = q[i];
    gradient[i] -= weight * change / (2 * kStep);
  }
  return V;
}

}  // namespace cotwin::control
