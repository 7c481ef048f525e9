#include "models/robot/mechanism.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <iterator>
#include <utility>

namespace cotwin::robot {

namespace {

bool is_chain(const RobotModel& robot) {
  if (!robot.mimics.empty()) return false;
  for (int i = 0; i < robot.n(); ++i)
    if (robot.joints[static_cast<std::size_t>(i)].type != JointType::kRevolute ||
        robot.joints[static_cast<std::size_t>(i)].parent != i - 1)
      return false;
  return true;
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

}  // namespace cotwin::robot
