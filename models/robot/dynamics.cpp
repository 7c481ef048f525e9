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

namespace cotwin::robot {
namespace {

constexpr std::align_val_t kAlignment{64};  // bytes: a register of x86-64-v4

int padded(int n) { return (n + 7) / 8 * 8; }

bool is_chain(const RobotModel& robot) {
  if (!robot.mimics.empty()) return false;
  for (int i = 0; i < robot.n(); ++i)
    if (robot.joints[static_cast<std::size_t>(i)].type != JointType::kRevolute ||
        robot.joints[static_cast<std::size_t>(i)].parent != i - 1)
      return false;
  return true;
}

void store(const Eigen::Matrix3d& R, double* to) {
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) to[3 * r + c] = R(r, c);
}

void store(const Eigen::Vector3d& v, double* to) {
  for (int i = 0; i < 3; ++i) to[i] = v[i];
}

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

/// A rotation R_LJ that makes `axis` of J the z axis of L; the identity for z itself.
Eigen::Matrix3d rotation_to_z(const Eigen::Vector3d& axis) {
  const Eigen::Vector3d z = axis.normalized();
  Eigen::Index least = 0;
  z.cwiseAbs().minCoeff(&least);
  const Eigen::Vector3d x = (Eigen::Vector3d::Unit(least) - z[least] * z).normalized();
  Eigen::Matrix3d R;
  R << x.transpose(), z.cross(x).transpose(), z.transpose();
  return R;
}

Eigen::Matrix3d turn_z(double angle) { return Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()).toRotationMatrix(); }

/// Mass, first and second moments ∫ r rᵀ dm about the origin of L. Torques are linear in them, and they add for composite
/// bodies.
struct Moments {
  double m = 0;
  Eigen::Vector3d h = Eigen::Vector3d::Zero();
  Eigen::Matrix3d S = Eigen::Matrix3d::Zero();
};

Moments moments_in(const Inertia& inertia, const Pose& X_LJ) {
  const Eigen::Vector3d c = X_LJ * inertia.p_LC;
  const Eigen::Matrix3d I = X_LJ.R * inertia.I_CC * X_LJ.R.transpose();
  Moments moments;
  moments.m = inertia.mass;
  moments.h = inertia.mass * c;
  moments.S = 0.5 * I.trace() * Eigen::Matrix3d::Identity() - I + inertia.mass * c * c.transpose();
  return moments;
}

/// Mass on the z axis of a joint rotates with the joint's body but moves as if fixed to the parent: transfers m, h_z and S_zz
/// of the body to the parent. X_PL: the joint's frame in the parent's at q = 0.
void group(Moments& body, const Pose& X_PL, Moments* parent) {
  if (parent) {
    const Eigen::Vector3d &o = X_PL.p, z = X_PL.R.col(2);
    parent->m += body.m;
    parent->h += body.m * o + body.h.z() * z;
    parent->S +=
        body.m * o * o.transpose() + body.h.z() * (o * z.transpose() + z * o.transpose()) + body.S(2, 2) * z * z.transpose();
  }
  body.m = body.h.z() = body.S(2, 2) = 0;
}

}  // namespace

// Doubles in the largest set of scratch arrays of a kernel (derivatives). Per joint in lanes of eight: Tangent 18, Wrench 6,
// row 1; in addition rotation 12, motion 18, wrench 6, and M's composites and wrenches 10 + 48; operational inertia: M, for a
// tree twice.
std::size_t scratch_doubles(int n) {
  const auto joints = static_cast<std::size_t>(padded(n));
  return joints * (8 * 64 + 128) + 2 * joints * joints + 64;
}

struct Mechanism::Impl {
  KernelModel model{};
  std::vector<KernelLink> links;
  std::vector<double> theta_0, c_alpha, s_alpha;  // padded
  std::vector<Pose> X_PL;                         // at q = 0, without theta_0
  std::vector<Pose> X_LJ;
  std::vector<Moments> moments;
  std::vector<double> zeros;  // n
  Pose X_BP;                  // the first link's P of a chain
  std::vector<KernelTreeLink> tree;
  std::vector<double> tree_inertia;
  const Kernels* kernels = nullptr;
  int dofs = 0;                        // independent joints; the kernels have those of the mimics as well
  std::unique_ptr<Coupling> coupling;  // nullptr without mimics
  std::vector<int> body;               // of the RobotModel, by the kernels' joint

  Impl(const RobotModel& robot, const char* isa);
  void update(const RobotModel& robot);

 private:
  void align_chain();
  void order_tree();
  void update_tree();
};

Mechanism::Impl::Impl(const RobotModel& robot, const char* isa) {
  if (!robot.mimics.empty()) coupling = std::make_unique<Coupling>(robot);
  dofs = robot.n();
  body = robot.depth_first();
  const std::size_t n = body.size();
  links.resize(n);
  X_PL.resize(n);
  X_LJ.resize(n);
  moments.resize(n);
  zeros.assign(n, 0.0);
  theta_0.assign(static_cast<std::size_t>(padded(robot.body_count())), 0.0);
  c_alpha.assign(theta_0.size(), 1.0);
  s_alpha.assign(theta_0.size(), 0.0);
  const bool chain = is_chain(robot);
  for (std::size_t i = 0; i < n; ++i) {
    const Joint& joint = robot.joint_of(body[i]);
    links[i].parent =
        coupling && joint.parent >= 0 ? coupling->kernel_of[static_cast<std::size_t>(joint.parent)] : joint.parent;
    links[i].revolute = joint.type == JointType::kRevolute;
    X_LJ[i] = {rotation_to_z(joint.axis), Eigen::Vector3d::Zero()};
    X_PL[i] = joint.X_PJ * X_LJ[i].inverse();
    if (links[i].parent >= 0) X_PL[i] = X_LJ[static_cast<std::size_t>(links[i].parent)] * X_PL[i];
  }
  if (chain) align_chain();
  for (std::size_t i = 0; i < n; ++i) {
    store(X_PL[i].R, links[i].R);
    store(X_PL[i].p, links[i].p);
    store(X_LJ[i].R, links[i].R_LJ);
    store(X_LJ[i].p, links[i].p_LJ);
  }
  store(X_BP.R, model.R_BP);
  store(X_BP.p, model.p_BP);
  model.n = robot.body_count();
  model.links = links.data();
  model.theta_0 = theta_0.data();
  model.c_alpha = c_alpha.data();
  model.s_alpha = s_alpha.data();
  if (!chain) order_tree();
  kernels = &choose_kernels(robot.body_count(), chain, isa);
  update(robot);
}

// Any rotation is Rz(γ) Rx(α) Rz(β). Rotating P about its z by γ leaves Rx(α) Rz(β + q). Translating P along its z to the foot
// of the perpendicular from L's origin makes p_z zero. L must be translated first, hence the order from the tip to the base.
void Mechanism::Impl::align_chain() {
  const std::size_t n = links.size();
  if (n == 0) return;
  X_BP = X_PL[0];
  X_PL[0] = Pose{};
  for (std::size_t i = 1; i < n; ++i) {
    Pose& X = X_PL[i];
    const Eigen::Vector3d axis = X.R.col(2);
    const double gamma = axis.x() != 0 || axis.y() != 0 ? std::atan2(axis.x(), -axis.y()) : 0.0;
    const Pose turn{turn_z(-gamma), Eigen::Vector3d::Zero()};
    theta_0[i - 1] += gamma;
    X_LJ[i - 1] = turn * X_LJ[i - 1];
    X = turn * X;

    const double sine = std::hypot(axis.x(), axis.y()), length = std::hypot(sine, axis.z());
    c_alpha[i] = axis.z() / length;
    s_alpha[i] = sine / length;
    const Eigen::Matrix3d turn_x{{1, 0, 0}, {0, c_alpha[i], -s_alpha[i]}, {0, s_alpha[i], c_alpha[i]}};
    const Eigen::Matrix3d rest = turn_x.transpose() * X.R;
    theta_0[i] = std::atan2(rest(1, 0), rest(0, 0));
    X.R = turn_x;
  }
  for (std::size_t i = n - 1; i > 0; --i) {
    const double slide = X_PL[i].p.z();
    X_PL[i].p.z() = 0;
    X_LJ[i - 1].p.z() -= slide;
    if (i > 1) {
      X_PL[i - 1].p += slide * X_PL[i - 1].R.col(2);
    } else {
      X_BP.p += slide * X_BP.R.col(2);
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    theta_0[i] = std::remainder(theta_0[i], 2 * std::acos(-1.0));
    links[i].c_alpha = c_alpha[i];
    links[i].s_alpha = s_alpha[i];
    links[i].cc_alpha = c_alpha[i] * c_alpha[i];
    links[i].ss_alpha = s_alpha[i] * s_alpha[i];
    links[i].cs_alpha = c_alpha[i] * s_alpha[i];
  }
}

// The reference point is the origin of the trunk's last link that a prismatic joint moves, so that moments stay small however
// far it travels; the trunk are the links that carry all links after them.
void Mechanism::Impl::order_tree() {
  const auto n = links.size();
  std::vector<std::vector<int>> children(n + 1);  // of the base last
  for (std::size_t i = 0; i < n; ++i)
    children[links[i].parent < 0 ? n : static_cast<std::size_t>(links[i].parent)].push_back(static_cast<int>(i));
  std::vector<std::pair<int, int>> open;  // joint, slot of its parent
  const auto push_children = [&](std::size_t of, int slot) {
    for (auto child = children[of].rbegin(); child != children[of].rend(); ++child) open.emplace_back(*child, slot);
  };
  push_children(n, -1);
  while (!open.empty()) {
    const auto [joint, parent] = open.back();
    open.pop_back();
    KernelTreeLink link{};
    const KernelLink& constants = links[static_cast<std::size_t>(joint)];
    link.joint = joint;
    link.parent = parent;
    link.size = 1;
    link.revolute = constants.revolute;
    std::copy_n(constants.R, 9, link.R);
    std::copy_n(constants.p, 3, link.p);
    tree.push_back(link);
    push_children(static_cast<std::size_t>(joint), static_cast<int>(tree.size()) - 1);
  }
  std::vector<std::pair<int, int>> sweep;  // distance from the base, slot
  for (std::size_t k = 0; k < n; ++k)
    sweep.emplace_back(tree[k].parent < 0 ? 0 : sweep[static_cast<std::size_t>(tree[k].parent)].first + 1, static_cast<int>(k));
  std::sort(sweep.begin(), sweep.end());
  for (std::size_t k = n; k-- > 0;) {
    tree[k].sweep = sweep[k].second;
    if (tree[k].parent >= 0) tree[static_cast<std::size_t>(tree[k].parent)].size += tree[k].size;
  }
  model.reference = n > 0 && tree[0].size == model.n ? 0 : -1;
  for (std::size_t k = 0; k < n && tree[k].size == model.n - static_cast<int>(k); ++k)
    if (!tree[k].revolute) model.reference = static_cast<int>(k);
  model.tree_in_order = 1;
  for (std::size_t k = 0; k < n; ++k) model.tree_in_order &= tree[k].joint == static_cast<int>(k);
  tree_inertia.assign(11 * static_cast<std::size_t>(padded(model.n)), 0.0);
  model.tree = tree.data();
  model.tree_inertia = tree_inertia.data();
}

void Mechanism::Impl::update_tree() {
  const auto stride = static_cast<std::size_t>(padded(model.n));
  for (std::size_t k = 0; k < tree.size(); ++k) {
    const KernelLink& l = links[static_cast<std::size_t>(tree[k].joint)];
    const double values[] = {
        l.m, l.h[0], l.h[1], l.h[2], l.S_xx, l.S_yy, l.S_zz, l.S_xy, l.S_xz, l.S_yz, static_cast<double>(l.revolute)};
    for (std::size_t i = 0; i < std::size(values); ++i) tree_inertia[i * stride + k] = values[i];
  }
}

void Mechanism::Impl::update(const RobotModel& robot) {
  assert(robot.body_count() == model.n);
  for (std::size_t i = 0; i < links.size(); ++i) {
    moments[i] = moments_in(robot.bodies[static_cast<std::size_t>(body[i])].inertia, X_LJ[i]);
    links[i].mass = moments[i].m;
    store(moments[i].h, links[i].first_moment);
  }
  for (std::size_t i = links.size(); i-- > 0;) {
    Moments& own = moments[i];
    const int parent = links[i].parent;
    if (links[i].revolute) group(own, X_PL[i], parent < 0 ? nullptr : &moments[static_cast<std::size_t>(parent)]);
    links[i].m = own.m;
    store(own.h, links[i].h);
    links[i].S_xx = own.S(0, 0);
    links[i].S_yy = own.S(1, 1);
    links[i].S_zz = own.S(2, 2);
    links[i].S_xy = own.S(0, 1);
    links[i].S_xz = own.S(0, 2);
    links[i].S_yz = own.S(1, 2);
  }
  update_tree();
  const Eigen::Vector3d a_0 = -(X_BP.R.transpose() * robot.gravity);
  store(a_0, model.a_0);
  store(robot.gravity, model.gravity);
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
    return coupled(m, data).derivatives(q.data(), dq.data(), ddq.data(), nullptr, dtau_dq, dtau_ddq, nullptr);
  }
  m.kernels->derivatives(m.model, data.impl().scratch.get(), q.data(), dq.data(), ddq.data(), nullptr, dtau_dq.data(),
                         dtau_dq.outerStride(), dtau_ddq.data(), dtau_ddq.outerStride(), nullptr, 0);
}

void linearised_dynamics(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq, const VectorIn& ddq,
                         VectorOut tau, MatrixOut dtau_dq, MatrixOut dtau_ddq, MatrixOut M) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && dq.size() == m.dofs && ddq.size() == m.dofs && tau.size() == m.dofs);
  assert(dtau_dq.rows() == m.dofs && dtau_dq.cols() == m.dofs && dtau_ddq.rows() == m.dofs && dtau_ddq.cols() == m.dofs);
  assert(M.rows() == m.dofs && M.cols() == m.dofs);
  if (m.coupling) return coupled(m, data).derivatives(q.data(), dq.data(), ddq.data(), tau.data(), dtau_dq, dtau_ddq, &M);
  m.kernels->derivatives(m.model, data.impl().scratch.get(), q.data(), dq.data(), ddq.data(), tau.data(), dtau_dq.data(),
                         dtau_dq.outerStride(), dtau_ddq.data(), dtau_ddq.outerStride(), M.data(), M.outerStride());
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

void operational_inertia_inverse(const Mechanism& mechanism, Data& data, const VectorIn& q, const FrameOnBody& frame,
                                 Eigen::Ref<Eigen::Matrix<double, 6, 6>> Lambda_inverse) {
  const auto& m = mechanism.impl();
  assert(q.size() == m.dofs && frame.body < m.model.n);
  if (m.coupling) {
    return coupled(m, data).operational_inertia_inverse(q.data(), frame.body, kernel_pose(frame.X_BF), Lambda_inverse);
  }
  m.kernels->operational_inertia_inverse(m.model, data.impl().scratch.get(), q.data(), frame.body, kernel_pose(frame.X_BF),
                                         Lambda_inverse.data(), Lambda_inverse.outerStride());
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
