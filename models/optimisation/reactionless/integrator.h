#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>
#include <string>

#include "models/optimisation/reactionless/reactionless.h"
#include "models/robot/floating_base.h"

namespace cotwin::optimisation {

inline constexpr int kTerms = 8;             // of each α_j
inline constexpr int kSteps = 50;            // of a search
inline constexpr double kLargest = 4;        // of a coefficient that is drawn, rad or m
inline constexpr double kDifference = 1e-6;  // of finite differences

/// φ_k at the times of RK4's stages: one column per half step.
Eigen::MatrixXd table_of(int steps);

/// Coefficients (columns × kTerms) of motion `number` of those that are grown: r · kLargest · u, r uniform in [0, 1], each u in [−1, 1].
Eigen::VectorXd drawn(Eigen::Index columns, std::uint64_t seed, std::uint32_t number);

/// Integrates motions; one per thread.
class Integrator {
 public:
  explicit Integrator(const ReactionlessProblem& problem);

  /// Z at q.
  Eigen::MatrixXd Z(const Eigen::VectorXd& q) {
    at(q);
    return inertia_.Z();
  }
  const Eigen::VectorXd& start() const { return start_; }

  /// Within null(Z), of dimension b.cols(), from the basis b at the start.
  void keep_attitude(Eigen::MatrixXd b) {
    basis_ = std::move(b);
    rank_ = std::min<Eigen::Index>(3, basis_.rows() - basis_.cols());
    turns_ = false;
  }
  /// With all joints.
  void allow_turn() {
    basis_ = Eigen::MatrixXd::Identity(start_.size(), start_.size());
    turns_ = true;
  }

  /// The motion with the coefficients c (columns of b × kTerms); visits q, dq/ds and the base's attitude at each step.
  template <class Visit>
  void run(const Eigen::VectorXd& c, const Eigen::MatrixXd& phi, Visit visit) {
    const Eigen::Map<const Eigen::MatrixXd> C(c.data(), basis_.cols(), kTerms);
    const Eigen::Index steps = (phi.cols() - 1) / 2;
    const double h = 1.0 / static_cast<double>(steps);
    State y{start_, basis_, Eigen::Vector4d::UnitW()}, mid = y;
    for (Eigen::Index k = 0;; ++k) {
      rate(y, C * phi.col(2 * k), k1_);
      visit(k, y.q, k1_.q, Eigen::Quaterniond(y.Q));
      if (k == steps) break;
      const Eigen::VectorXd middle = C * phi.col(2 * k + 1);
      moved(y, 0.5 * h, k1_, mid);
      rate(mid, middle, k2_);
      moved(y, 0.5 * h, k2_, mid);
      rate(mid, middle, k3_);
      moved(y, h, k3_, mid);
      rate(mid, C * phi.col(2 * k + 2), k4_);
      moved(y, h / 6, k1_, y);
      moved(y, h / 3, k2_, y);
      moved(y, h / 3, k3_, y);
      moved(y, h / 6, k4_, y);
      y.Q.normalize();
    }
  }

  /// What is left to the goal: a posture, or of a pose positions, then twice the vector part of the rotation's quaternion.
  Eigen::VectorXd left(const Eigen::VectorXd& q, const Eigen::Quaterniond& Q);
  /// The frame in B0; without a posture as goal.
  robot::PoseTarget pose(const Eigen::VectorXd& q, const Eigen::Quaterniond& Q);

 private:
  struct State {
    Eigen::VectorXd q;
    Eigen::MatrixXd b;
    Eigen::Vector4d Q;  // x, y, z, w
  };

  void at(const Eigen::VectorXd& q) { robot::floating_inertia(mechanism_, data_, q, inertia_); }

  /// y + h k.
  void moved(const State& y, double h, const State& k, State& to) {
    to.q = y.q + h * k.q;
    if (turns_)
      to.Q = y.Q + h * k.Q;
    else
      to.b = y.b + h * k.b;
  }

  /// An orthonormal basis of the rows of Z at q.
  void row_space(const Eigen::VectorXd& q, Eigen::MatrixX3d& V);
  template <class X>
  X projected(const Eigen::MatrixX3d& V, const X& x) const {
    return x - V.leftCols(rank_) * (V.leftCols(rank_).transpose() * x);
  }

  void rate(const State& y, const Eigen::VectorXd& alpha, State& k);

  const ReactionlessProblem& p_;
  robot::FloatingMechanism mechanism_;
  robot::FloatingData data_;
  robot::FloatingInertia inertia_;
  std::unique_ptr<robot::InverseKinematics> kinematics_;
  Eigen::VectorXd start_;
  Eigen::Vector3d centre_;  // of mass in B0
  Eigen::MatrixXd basis_;
  Eigen::Index rank_ = 3;
  bool turns_ = false;
  Eigen::MatrixX3d V_, ahead_;
  State k1_, k2_, k3_, k4_;
};

/// An orthonormal basis of null(Z) at the start; none where every motion turns the base or the start is singular, with the obstacle.
std::optional<Eigen::MatrixXd> attitude_keeping(Integrator& first, Eigen::Index n, std::string& obstacle);

/// Calls visit(step, joint, |dq/ds|, |d²q/ds²|, |d³q/ds³|) for the inner steps of dq/ds (n × steps + 1), by differences.
template <class Visit>
void each_rate(const Eigen::MatrixXd& rates, Visit visit) {
  const auto steps = static_cast<double>(rates.cols() - 1);
  for (Eigen::Index k = 1; k + 1 < rates.cols(); ++k)
    for (Eigen::Index j = 0; j < rates.rows(); ++j) {
      const double before = rates(j, k - 1), now = rates(j, k), after = rates(j, k + 1);
      visit(k, j, std::abs(now), 0.5 * steps * std::abs(after - before), steps * steps * std::abs(after - 2 * now + before));
    }
}

}  // namespace cotwin::optimisation
