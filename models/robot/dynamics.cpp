#include "models/robot/dynamics.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <iterator>
#include <new>
#include <utility>
#include <vector>

#include "models/robot/coupled_dynamics.h"
#include "models/robot/jacobian_rate.h"
#include "models/robot/kernels/kernels.h"
#include "models/robot/mechanism.h"

namespace cotwin::robot {
namespace {

constexpr std::align_val_t kAlignment{64};  // bytes: a register of x86-64-v4

KernelPose kernel_pose(const Pose& X) {
  KernelPose pose;
  store(X.R, pose.R);
  store(X.p, pose.p);
  return pose;
}

Pose pose_of(const KernelPose& X) {
  Pose pose;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) pose.R(r, c) = X.R[3 * r + c];
  for (int i = 0; i < 3; ++i) pose.p[i] = X.p[i];
  return pose;
}

}  // namespace

// Doubles in the largest set of scratch arrays of a kernel (derivatives). Per joint in lanes of eight: Tangent 18, Wrench 6,
// row 1; in addition rotation 12, motion 18, wrench 6, and M's composites and wrenches 10 + 48; operational inertia: M, for a
// tree twice.
std::size_t scratch_doubles(int n) {
  const auto joints = static_cast<std::size_t>(padded(n));
  return joints * (8 * 64 + 128) + 2 * joints * joints + 64;
}

struct Data::Impl {
  struct Free {
    void operator()(double* p) const { ::operator delete[](p, kAlignment); }
  };
  std::unique_ptr<double[], Free> scratch;
  std::vector<double> torque;  // n
  std::unique_ptr<CoupledScratch> coupled;

  explicit Impl(const Mechanism::Impl& m)
      : scratch(static_cast<double*>(::operator new[](scratch_doubles(m.model.n) * sizeof(double), kAlignment))),
        torque(static_cast<std::size_t>(m.dofs)) {
    if (m.coupling) coupled = std::make_unique<CoupledScratch>(m.dofs, m.model.n);
  }
};

namespace {

CoupledDynamics coupled(const Mechanism::Impl& m, Data& data) {
  return {m.model, *m.kernels, *m.coupling, data.impl().scratch.get(), *data.impl().coupled};
}

}  // namespace

Mechanism::Mechanism(const RobotModel& robot, const char* isa) : impl_(std::make_unique<Impl>(robot, isa)) {}
Mechanism::~Mechanism() = default;
Mechanism::Mechanism(Mechanism&&) noexcept = default;
Mechanism& Mechanism::operator=(Mechanism&&) noexcept = default;
int Mechanism::n() const { return impl_->dofs; }
int Mechanism::body_count() const { return impl_->model.n; }
void Mechanism::update(const RobotModel& robot) { impl_->update(robot); }

Data::Data(const Mechanism& mechanism) : impl_(std::make_unique<Impl>(mechanism.impl())) {}
Data::~Data() = default;
Data::Data(Data&&) noexcept = default;
Data& Data::operator=(Data&&) noexcept = default;

FrameOnBody on_body(const Frame& frame) { return {frame.body, frame.X_BF}; }

void inverse_dynamics(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq, const VectorIn& ddq,
                      VectorOut tau) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && dq.size() == m.dofs && ddq.size() == m.dofs && tau.size() == m.dofs);
  if (m.coupling) return coupled(m, data).inverse_dynamics(m.model.a_0, q.data(), dq.data(), ddq.data(), tau.data());
  m.kernels->inverse_dynamics(m.model, data.impl().scratch.get(), m.model.a_0, q.data(), dq.data(), ddq.data(), tau.data());
}

void bias(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq, VectorOut h) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && dq.size() == m.dofs && h.size() == m.dofs);
  if (m.coupling) return coupled(m, data).inverse_dynamics(m.model.a_0, q.data(), dq.data(), nullptr, h.data());
  m.kernels->inverse_dynamics(m.model, data.impl().scratch.get(), m.model.a_0, q.data(), dq.data(), m.zeros.data(), h.data());
}

void gravity(const Mechanism& mechanism, Data& data, const VectorIn& q, VectorOut g) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && g.size() == m.dofs);
  if (m.coupling) return coupled(m, data).inverse_dynamics(m.model.a_0, q.data(), nullptr, nullptr, g.data());
  m.kernels->inverse_dynamics(m.model, data.impl().scratch.get(), m.model.a_0, q.data(), m.zeros.data(), m.zeros.data(),
                              g.data());
}

void mass_matrix(const Mechanism& mechanism, Data& data, const VectorIn& q, MatrixOut M) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && M.rows() == m.dofs && M.cols() == m.dofs);
  if (m.coupling) return coupled(m, data).mass_matrix(q.data(), M);
  m.kernels->mass_matrix(m.model, data.impl().scratch.get(), q.data(), M.data(), M.outerStride());
}

void mass_matrix_and_bias(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq, MatrixOut M,
                          VectorOut h) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && dq.size() == m.dofs && M.rows() == m.dofs && M.cols() == m.dofs && h.size() == m.dofs);
  if (m.coupling) return coupled(m, data).mass_matrix_and_bias(q.data(), dq.data(), M, h);
  m.kernels->mass_matrix_and_bias(m.model, data.impl().scratch.get(), q.data(), dq.data(), M.data(), M.outerStride(), h.data());
}

void coriolis_matrix(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq, MatrixOut C) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && dq.size() == m.dofs && C.rows() == m.dofs && C.cols() == m.dofs);
  if (m.coupling) return coupled(m, data).coriolis_matrix(q.data(), dq.data(), C);
  m.kernels->coriolis_matrix(m.model, data.impl().scratch.get(), q.data(), dq.data(), C.data(), C.outerStride());
}

void forward_dynamics(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq, const VectorIn& tau,
                      VectorOut ddq) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && dq.size() == m.dofs && tau.size() == m.dofs && ddq.size() == m.dofs);
  if (m.coupling) return coupled(m, data).forward_dynamics(q.data(), dq.data(), tau.data(), ddq.data());
  m.kernels->forward_dynamics(m.model, data.impl().scratch.get(), q.data(), dq.data(), tau.data(), ddq.data());
}

void inverse_dynamics_derivatives(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq,
                                  const VectorIn& ddq, MatrixOut dtau_dq, MatrixOut dtau_ddq) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && dq.size() == m.dofs && ddq.size() == m.dofs);
  assert(dtau_dq.rows() == m.dofs && dtau_dq.cols() == m.dofs && dtau_ddq.rows() == m.dofs && dtau_ddq.cols() == m.dofs);
  if (m.coupling) {
    return coupled(m, data).derivatives(q.data(), dq.data(), ddq.data(), dtau_dq, dtau_ddq);
  }
  m.kernels->derivatives(m.model, data.impl().scratch.get(), q.data(), dq.data(), ddq.data(), dtau_dq.data(),
                         dtau_dq.outerStride(), dtau_ddq.data(), dtau_ddq.outerStride());
}

void regressor(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq, const VectorIn& ddq,
               MatrixOut Y) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && dq.size() == m.dofs && ddq.size() == m.dofs);
  assert(Y.rows() == m.dofs && Y.cols() == 10 * m.model.n);
  if (m.coupling) return coupled(m, data).regressor(q.data(), dq.data(), ddq.data(), Y);
  m.kernels->regressor(m.model, data.impl().scratch.get(), q.data(), dq.data(), ddq.data(), Y.data(), Y.outerStride());
}

Pose forward_kinematics(const Mechanism& mechanism, Data& data, const VectorIn& q, const FrameOnBody& frame) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && frame.body < m.model.n);
  KernelPose X_BF;
  if (m.coupling) {
    coupled(m, data).kinematics(q.data(), frame.body, kernel_pose(frame.X_BF), &X_BF, nullptr);
    return pose_of(X_BF);
  }
  m.kernels->kinematics(m.model, data.impl().scratch.get(), q.data(), frame.body, kernel_pose(frame.X_BF), &X_BF, nullptr, 0);
  return pose_of(X_BF);
}

Pose jacobian(const Mechanism& mechanism, Data& data, const VectorIn& q, const FrameOnBody& frame, MatrixOut J) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && frame.body < m.model.n && J.rows() == 6 && J.cols() == m.dofs);
  KernelPose X_BF;
  if (m.coupling) {
    coupled(m, data).kinematics(q.data(), frame.body, kernel_pose(frame.X_BF), &X_BF, &J);
    return pose_of(X_BF);
  }
  m.kernels->kinematics(m.model, data.impl().scratch.get(), q.data(), frame.body, kernel_pose(frame.X_BF), &X_BF, J.data(),
                        J.outerStride());
  return pose_of(X_BF);
}

Pose jacobian(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq, const FrameOnBody& frame,
              MatrixOut J, MatrixOut dJ) {
  const auto& m = mechanism.impl();
  assert(dq.size() == m.dofs && dJ.rows() == 6 && dJ.cols() == m.dofs);
  if (m.coupling) {
    assert(q.size() == m.dofs && frame.body < m.model.n && J.rows() == 6 && J.cols() == m.dofs);
    KernelPose X_BF;
    coupled(m, data).jacobian_rate(q.data(), dq.data(), frame.body, kernel_pose(frame.X_BF), &X_BF, J, dJ);
    return pose_of(X_BF);
  }
  const Pose X = jacobian(mechanism, data, q, frame, J);
  jacobian_rate(m.dofs, J.data(), J.outerStride(), dq.data(), dJ.data(), dJ.outerStride());
  return X;
}

void jacobian_dot_times_dq(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq,
                           const FrameOnBody& frame, Eigen::Ref<Twist> a) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && dq.size() == m.dofs && frame.body < m.model.n);
  if (m.coupling) {
    return coupled(m, data).jacobian_dot_times_dq(q.data(), dq.data(), frame.body, kernel_pose(frame.X_BF), a.data());
  }
  m.kernels->jacobian_dot_times_dq(m.model, data.impl().scratch.get(), q.data(), dq.data(), frame.body, kernel_pose(frame.X_BF),
                                   a.data());
}

double kinetic_energy(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && dq.size() == m.dofs);
  const double no_gravity[3] = {0, 0, 0};
  double* momentum = data.impl().torque.data();  // M q̇: the torque of q̈ := q̇ from rest, without gravity
  if (m.coupling) {
    coupled(m, data).inverse_dynamics(no_gravity, q.data(), nullptr, dq.data(), momentum);
  } else {
    m.kernels->inverse_dynamics(m.model, data.impl().scratch.get(), no_gravity, q.data(), m.zeros.data(), dq.data(), momentum);
  }
  double energy = 0;
  for (int i = 0; i < m.dofs; ++i) energy += 0.5 * momentum[i] * dq[i];
  return energy;
}

double potential_energy(const Mechanism& mechanism, Data& data, const VectorIn& q) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs);
  if (m.coupling) return coupled(m, data).potential_energy(q.data());
  return m.kernels->potential_energy(m.model, data.impl().scratch.get(), q.data());
}

void inverse_dynamics_batch(const Mechanism& mechanism, Data& data, std::size_t count, const double* q, const double* dq,
                            const double* ddq, double* tau) {
  const auto& m = mechanism.impl();
  if (m.coupling) return coupled(m, data).inverse_dynamics_batch(count, q, dq, ddq, tau);
  m.kernels->inverse_dynamics_batch(m.model, data.impl().scratch.get(), count, q, dq, ddq, tau);
}

}  // namespace cotwin::robot
