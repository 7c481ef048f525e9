#include "models/robot/coupled_dynamics.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/robot/jacobian_rate.h"

namespace cotwin::robot {
namespace {

std::size_t at(int i) { return static_cast<std::size_t>(i); }

/// Replaces the symmetric positive definite A by L and D of A = L D Lᵀ, below and on the diagonal.
void ldlt(Eigen::MatrixXd& A) {
  const Eigen::Index n = A.rows();
  for (Eigen::Index j = 0; j < n; ++j) {
    for (Eigen::Index k = 0; k < j; ++k) A(j, j) -= A(j, k) * A(j, k) * A(k, k);
    for (Eigen::Index i = j + 1; i < n; ++i) {
      for (Eigen::Index k = 0; k < j; ++k) A(i, j) -= A(i, k) * A(j, k) * A(k, k);
      A(i, j) /= A(j, j);
    }
  }
}

void solve(const Eigen::MatrixXd& LD, double* x) {
  const Eigen::Index n = LD.rows();
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index k = 0; k < i; ++k) x[i] -= LD(i, k) * x[k];
  }
  for (Eigen::Index i = 0; i < n; ++i) x[i] /= LD(i, i);
  for (Eigen::Index i = n; i-- > 0;) {
    for (Eigen::Index k = i + 1; k < n; ++k) x[i] -= LD(k, i) * x[k];
  }
}

}  // namespace

Coupling::Coupling(const RobotModel& robot) : n(robot.n()), body(robot.depth_first()), kernel_of(body.size()) {
  for (std::size_t k = 0; k < body.size(); ++k) {
    const int b = body[k];
    kernel_of[at(b)] = static_cast<int>(k);
    leader.push_back(robot.leader_of(b));
    const Mimic* const mimic = b < n ? nullptr : &robot.mimics[at(b - n)];
    rate.push_back(mimic ? mimic->multiplier : 1);
    offset.push_back(mimic ? mimic->offset : 0);
    const std::string place = "robot '" + robot.name + "', joint '" + robot.joint_of(b).name + "'";
    if (leader.back() < 0 || leader.back() >= n || !std::isfinite(rate.back()) || !std::isfinite(offset.back())) {
      throw Error(place, "mimics joint " + std::to_string(leader.back()) + " with a multiplier of " +
                             std::to_string(rate.back()) + ", expected a joint from 0 to " + std::to_string(n - 1) +
                             " and finite numbers");
    }
    const int parent = robot.joint_of(b).parent;
    if (parent >= 0 && std::find(body.begin(), body.begin() + static_cast<std::ptrdiff_t>(k), parent) ==
                           body.begin() + static_cast<std::ptrdiff_t>(k)) {
      throw Error(place, "stands before its parent in the order of the tree, expected after it");
    }
  }
}

CoupledScratch::CoupledScratch(int n, int all)
    : q(all),
      dq(all),
      ddq(all),
      tau(all),
      zeros(Eigen::VectorXd::Zero(all)),
      M(all, all),
      by_q(all, all),
      by_dq(all, all),
      J(6, all),
      dJ(6, all),
      Y(all, 10 * all),
      reduced(n, n),
      J_reduced(6, n),
      h(n) {
  for (auto* v : {&batch_q, &batch_dq, &batch_ddq, &batch_tau}) v->resize(at(all) * kBatch);
}

void CoupledDynamics::positions(const double* q) {
  for (int k = 0; k < model_.n; ++k) s_.q[k] = G_.rate[at(k)] * q[G_.leader[at(k)]] + G_.offset[at(k)];
}

void CoupledDynamics::rates(const double* from, Eigen::VectorXd& to) const {
  for (int k = 0; k < model_.n; ++k) to[k] = G_.rate[at(k)] * from[G_.leader[at(k)]];
}

void CoupledDynamics::forces(const double* all, double* to) const {
  std::fill(to, to + G_.n, 0.0);
  for (int k = 0; k < model_.n; ++k) to[G_.leader[at(k)]] += G_.rate[at(k)] * all[k];
}

/// Gᵀ A G
void CoupledDynamics::sandwich(const Eigen::MatrixXd& all, MatrixOut to) const {
  to.setZero();
  for (int c = 0; c < model_.n; ++c) {
    for (int r = 0; r < model_.n; ++r) {
      to(G_.leader[at(r)], G_.leader[at(c)]) += G_.rate[at(r)] * G_.rate[at(c)] * all(r, c);
    }
  }
}

void CoupledDynamics::inverse_dynamics(const double* a_0, const double* q, const double* dq, const double* ddq, double* tau) {
  positions(q);
  if (dq) rates(dq, s_.dq);
  if (ddq) rates(ddq, s_.ddq);
  kernels_.inverse_dynamics(model_, scratch_, a_0, s_.q.data(), dq ? s_.dq.data() : s_.zeros.data(),
                            ddq ? s_.ddq.data() : s_.zeros.data(), s_.tau.data());
  forces(s_.tau.data(), tau);
}

void CoupledDynamics::inverse_dynamics_batch(std::size_t count, const double* q, const double* dq, const double* ddq,
                                             double* tau) {
  for (std::size_t first = 0; first < count; first += CoupledScratch::kBatch) {
    const std::size_t part = std::min(count - first, CoupledScratch::kBatch);
    for (int k = 0; k < model_.n; ++k) {
      const std::size_t from = at(G_.leader[at(k)]) * count + first, to = at(k) * part;
      for (std::size_t s = 0; s < part; ++s) {
        s_.batch_q[to + s] = G_.rate[at(k)] * q[from + s] + G_.offset[at(k)];
        s_.batch_dq[to + s] = G_.rate[at(k)] * dq[from + s];
        s_.batch_ddq[to + s] = G_.rate[at(k)] * ddq[from + s];
      }
    }
    kernels_.inverse_dynamics_batch(model_, scratch_, part, s_.batch_q.data(), s_.batch_dq.data(), s_.batch_ddq.data(),
                                    s_.batch_tau.data());
    for (int i = 0; i < G_.n; ++i) std::fill_n(tau + at(i) * count + first, part, 0.0);
    for (int k = 0; k < model_.n; ++k) {
      double* const to = tau + at(G_.leader[at(k)]) * count + first;
      for (std::size_t s = 0; s < part; ++s) to[s] += G_.rate[at(k)] * s_.batch_tau[at(k) * part + s];
    }
  }
}

void CoupledDynamics::mass_matrix(const double* q, MatrixOut M) {
  positions(q);
  kernels_.mass_matrix(model_, scratch_, s_.q.data(), s_.M.data(), s_.M.outerStride());
  sandwich(s_.M, M);
}

void CoupledDynamics::mass_matrix_and_bias(const double* q, const double* dq, MatrixOut M, VectorOut h) {
  positions(q);
  rates(dq, s_.dq);
  kernels_.mass_matrix_and_bias(model_, scratch_, s_.q.data(), s_.dq.data(), s_.M.data(), s_.M.outerStride(), s_.tau.data());
  sandwich(s_.M, M);
  forces(s_.tau.data(), h.data());
}

void CoupledDynamics::coriolis_matrix(const double* q, const double* dq, MatrixOut C) {
  positions(q);
  rates(dq, s_.dq);
  kernels_.coriolis_matrix(model_, scratch_, s_.q.data(), s_.dq.data(), s_.M.data(), s_.M.outerStride());
  sandwich(s_.M, C);
}

void CoupledDynamics::forward_dynamics(const double* q, const double* dq, const double* tau, double* ddq) {
  mass_matrix_and_bias(q, dq, s_.reduced, s_.h);
  for (int i = 0; i < G_.n; ++i) ddq[i] = tau[i] - s_.h[i];
  ldlt(s_.reduced);
  solve(s_.reduced, ddq);
}

void CoupledDynamics::derivatives(const double* q, const double* dq, const double* ddq, MatrixOut dtau_dq, MatrixOut dtau_ddq) {
  positions(q);
  rates(dq, s_.dq);
  rates(ddq, s_.ddq);
  kernels_.derivatives(model_, scratch_, s_.q.data(), s_.dq.data(), s_.ddq.data(), s_.by_q.data(), s_.by_q.outerStride(),
                       s_.by_dq.data(), s_.by_dq.outerStride());
  sandwich(s_.by_q, dtau_dq);
  sandwich(s_.by_dq, dtau_ddq);
}

void CoupledDynamics::regressor(const double* q, const double* dq, const double* ddq, MatrixOut Y) {
  positions(q);
  rates(dq, s_.dq);
  rates(ddq, s_.ddq);
  kernels_.regressor(model_, scratch_, s_.q.data(), s_.dq.data(), s_.ddq.data(), s_.Y.data(), s_.Y.outerStride());
  Y.setZero();
  for (int b = 0; b < model_.n; ++b) {
    for (int k = 0; k < model_.n; ++k) {
      Y.block<1, 10>(G_.leader[at(k)], 10 * G_.body[at(b)]) += G_.rate[at(k)] * s_.Y.block<1, 10>(k, 10 * b);
    }
  }
}

void CoupledDynamics::kinematics(const double* q, int body, const KernelPose& X_JF, KernelPose* X_BF, MatrixOut* J) {
  positions(q);
  kernels_.kinematics(model_, scratch_, s_.q.data(), kernel_of(body), X_JF, X_BF, J ? s_.J.data() : nullptr,
                      s_.J.outerStride());
  if (!J) return;
  J->setZero();
  for (int k = 0; k < model_.n; ++k) J->col(G_.leader[at(k)]) += G_.rate[at(k)] * s_.J.col(k);
}

void CoupledDynamics::jacobian_rate(const double* q, const double* dq, int body, const KernelPose& X_JF, KernelPose* X_BF,
                                    MatrixOut J, MatrixOut dJ) {
  kinematics(q, body, X_JF, X_BF, &J);
  rates(dq, s_.dq);
  robot::jacobian_rate(model_.n, s_.J.data(), s_.J.outerStride(), s_.dq.data(), s_.dJ.data(), s_.dJ.outerStride());
  dJ.setZero();
  for (int k = 0; k < model_.n; ++k) dJ.col(G_.leader[at(k)]) += G_.rate[at(k)] * s_.dJ.col(k);
}

void CoupledDynamics::jacobian_dot_times_dq(const double* q, const double* dq, int body, const KernelPose& X_JF, double* a) {
  positions(q);
  rates(dq, s_.dq);
  kernels_.jacobian_dot_times_dq(model_, scratch_, s_.q.data(), s_.dq.data(), kernel_of(body), X_JF, a);
}

double CoupledDynamics::potential_energy(const double* q) {
  positions(q);
  return kernels_.potential_energy(model_, scratch_, s_.q.data());
}

}  // namespace cotwin::robot
