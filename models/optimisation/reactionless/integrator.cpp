#include "models/optimisation/reactionless/integrator.h"

#include <algorithm>
#include <cmath>

#include "models/numerics/dense.h"
#include "models/numerics/random.h"
#include "models/trajectory/bernstein.h"
#include "models/trajectory/polynomial.h"

namespace cotwin::optimisation {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr std::uint32_t kGrownStream = 1;
constexpr double kLost = 1e-3;  // of the largest singular value: below it a direction of Z counts as lost

}  // namespace

MatrixXd table_of(int steps) {
  const trajectory::RedundantTerms terms(5 + kTerms);
  MatrixXd phi(kTerms, 2 * steps + 1);
  for (int i = 0; i <= 2 * steps; ++i)
    for (int k = 0; k < kTerms; ++k)
      phi(k, i) = trajectory::bernstein::evaluate(terms.term(static_cast<std::size_t>(k)), 0.5 * i / steps)[0];
  return phi;
}

VectorXd drawn(Index columns, std::uint64_t seed, std::uint32_t number) {
  VectorXd x(columns * kTerms);
  const auto uniform = [&](Index draw) {
    return numerics::uniform({seed, kGrownStream, 0, number, static_cast<std::uint32_t>(draw)});
  };
  const double r = uniform(x.size()) * kLargest;
  for (Index i = 0; i < x.size(); ++i) x[i] = r * (2 * uniform(i) - 1);
  return x;
}

Integrator::Integrator(const ReactionlessProblem& p)
    : p_(p),
      mechanism_(p.robot),
      data_(mechanism_),
      inertia_(p.robot.n()),
      start_(Eigen::Map<const VectorXd>(p.q_from.data(), p.robot.n())) {
  if (p.q_to.empty()) kinematics_ = std::make_unique<robot::InverseKinematics>(p.robot, p.frame, p.directions);
  at(start_);
  centre_ = inertia_.p_C;
}

VectorXd Integrator::left(const VectorXd& q, const Quaterniond& Q) {
  if (!kinematics_) return Eigen::Map<const VectorXd>(p_.q_to.data(), start_.size()) - q;
  at(q);
  const Vector3d p_B = centre_ - Q * inertia_.p_C;
  const robot::PoseTarget seen{Q.conjugate() * (p_.target.p - p_B), Q.conjugate() * p_.target.Q};
  VectorXd e(kinematics_->rows());
  MatrixXd J(kinematics_->rows(), start_.size());
  kinematics_->linearise(seen, q, e, J);
  return e;
}

robot::PoseTarget Integrator::pose(const VectorXd& q, const Quaterniond& Q) {
  at(q);
  VectorXd e(kinematics_->rows());
  MatrixXd J(kinematics_->rows(), start_.size());
  const robot::FrameMotion seen = kinematics_->linearise({}, q, e, J);
  return {centre_ - Q * inertia_.p_C + Q * seen.p, Q * seen.Q};
}

void Integrator::row_space(const VectorXd& q, Eigen::MatrixX3d& V) {
  at(q);
  V = inertia_.Z().transpose();
  for (Index i = 0; i < rank_; ++i) {
    Index largest = 0;
    V.rightCols(3 - i).colwise().squaredNorm().maxCoeff(&largest);
    if (largest > 0) V.col(i).swap(V.col(i + largest));
    for (Index j = 0; j < i; ++j) V.col(i) -= V.col(j).dot(V.col(i)) * V.col(j);  // once more, for rounding
    V.col(i).normalize();
    for (Index j = i + 1; j < 3; ++j) V.col(j) -= V.col(i).dot(V.col(j)) * V.col(i);
  }
}

void Integrator::rate(const State& y, const VectorXd& alpha, State& k) {
  k.q = y.b * alpha;
  if (turns_) {
    at(y.q);
    const Vector3d w = inertia_.Z() * k.q;
    k.Q = 0.5 * (Quaterniond(y.Q) * Quaterniond(0, w.x(), w.y(), w.z())).coeffs();
    return;
  }
  row_space(y.q, V_);
  k.q = projected(V_, k.q);
  const double length = k.q.norm();
  k.b.setZero(y.b.rows(), y.b.cols());
  if (length == 0) return;
  row_space(y.q + kDifference / length * k.q, ahead_);
  const MatrixXd b = projected(V_, y.b);
  k.b = (length / kDifference) * (projected(ahead_, b) - b);
}

std::optional<MatrixXd> attitude_keeping(Integrator& first, Index n, std::string& obstacle) {
  const auto rank_at = [&](const VectorXd& q, double threshold) {
    const VectorXd s = numerics::singular_values(first.Z(q));
    return static_cast<Index>((s.array() > threshold * s.maxCoeff()).count());
  };
  Index rank = 0;  // that of nearly all postures
  for (std::uint32_t k = 0; k < 8; ++k) {
    VectorXd q = first.start();
    for (Index j = 0; j < n; ++j)
      q[j] += numerics::uniform({.seed = 1, .particle = k, .draw = static_cast<std::uint32_t>(j)}) - 0.5;
    rank = std::max(rank, rank_at(q, 1e-9));
  }
  const Index columns = n - rank;
  if (columns == 0) {
    obstacle = n == 1 ? "the robot has one joint, which turns the base"
                      : "every motion of the robot's " + std::to_string(n) + " joints turns the base";
    return std::nullopt;
  }
  if (rank_at(first.start(), kLost) < rank) {
    obstacle = "the first posture is singular: its joints turn the base about " +
               std::to_string(rank_at(first.start(), kLost)) + " axes, those of its neighbours about " + std::to_string(rank);
    return std::nullopt;
  }
  return numerics::svd(first.Z(first.start())).V.rightCols(columns);
}

}  // namespace cotwin::optimisation
