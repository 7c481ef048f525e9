#include "components/contact_world/engine/joints/forest.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>

namespace cotwin::contact_world {
namespace {

using scene::JointType;

double dot(const Spatial& a, const Spatial& b) {
  double sum = 0;
  for (std::size_t i = 0; i < 6; ++i) sum += a[i] * b[i];
  return sum;
}

void add(Spatial& a, double factor, const Spatial& b) {
  for (std::size_t i = 0; i < 6; ++i) a[i] += factor * b[i];
}

/// y = A x, A symmetric.
void multiply(const std::array<double, 36>& A, const Spatial& x, Spatial& y) {
  y = {};
  for (std::size_t j = 0; j < 6; ++j) {
    for (std::size_t i = 0; i < 6; ++i) y[i] += A[6 * j + i] * x[j];
  }
}

Spatial spatial(const Vector3d& linear, const Vector3d& angular) {
  return {linear[0], linear[1], linear[2], angular[0], angular[1], angular[2]};
}

/// Error of a joint in its frame on the parent. Exactly zero in free directions.
Spatial local_error(const Joint& joint) {
  const Motion6 e = joint.error();
  const Vector3d linear = joint.R_parent.transpose() * e.linear, angular = joint.R_parent.transpose() * e.angular;
  Spatial local = spatial(linear, angular);
  if (joint.type == JointType::kRevolute || joint.type == JointType::kScrew) local[5] = 0;
  if (joint.type == JointType::kPrismatic) local[2] = 0;
  return local;
}

void set_beta(const Vector3d& O, Forest::Node& node) {
  const Spatial& c = node.local;
  const Vector3d linear = node.R * Vector3d(c[0], c[1], c[2]), angular = node.R * Vector3d(c[3], c[4], c[5]);
  node.beta = spatial(linear + (node.p - O).cross(angular), angular);
  node.has_beta = c != Spatial{};
}

int freedoms_of(JointType type) {
  switch (type) {
    case JointType::kRevolute:
    case JointType::kPrismatic:
    case JointType::kScrew:
      return 1;
    case JointType::kSpherical:
      return 3;
    case JointType::kFixed:
      return 0;
  }
  return 0;
}

}  // namespace

Forest::Forest(std::size_t bodies, std::size_t joints)
    : tree_of_(bodies, -1), node_of_(bodies, -1), freedom_of_(joints, -1), outside_(joints, 0) {}

Forest::Forest(std::span<const RigidBody> bodies, std::span<const Joint> joints) : Forest(bodies.size(), joints.size()) {
  const auto is_dynamic = [&](int body) { return body >= 0 && bodies[static_cast<std::size_t>(body)].dynamic(); };
  const auto index = [](int i) { return static_cast<std::size_t>(i); };
  std::vector<char> used(joints.size(), 0);

  const auto add_node = [&](int body, int parent, int carrier, int joint) {
    Node node;
    node.body = body;
    node.parent = parent;
    node.carrier = carrier;
    node.joint = joint;
    node.sign = joint >= 0 && joints[index(joint)].child != body ? -1 : 1;
    node.first = static_cast<int>(freedoms_.size());
    node.count = joint < 0 ? 6 : freedoms_of(joints[index(joint)].type);
    freedoms_.resize(freedoms_.size() + index(node.count));
    if (joint >= 0) {
      used[index(joint)] = 1;
      if (joints[index(joint)].has_axis()) freedom_of_[index(joint)] = node.first;
    }
    tree_of_[index(body)] = static_cast<int>(trees_.size());
    node_of_[index(body)] = static_cast<int>(nodes_.size());
    nodes_.push_back(node);
  };
  // Depth first, so that the nodes of a tree are contiguous, parents before children.
  const auto grow = [&](const auto& self, int body) -> void {
    for (std::size_t j = 0; j < joints.size(); ++j) {
      if (used[j]) continue;
      const Joint& joint = joints[j];
      if (joint.parent != body && joint.child != body) continue;
      const int other = joint.parent == body ? joint.child : joint.parent;
      if (!is_dynamic(other) || tree_of_[index(other)] >= 0) continue;
      add_node(other, node_of_[index(body)], -1, static_cast<int>(j));
      self(self, other);
    }
  };
  const auto begin_tree = [&] {
    Tree tree;
    tree.first = static_cast<int>(nodes_.size());
    tree.first_freedom = static_cast<int>(freedoms_.size());
    return tree;
  };
  const auto end_tree = [&](Tree& tree) {
    tree.end = static_cast<int>(nodes_.size());
    tree.end_freedom = static_cast<int>(freedoms_.size());
    trees_.push_back(tree);
  };

  for (std::size_t j = 0; j < joints.size(); ++j) {  // trees on a carrier
    const Joint& joint = joints[j];
    const bool child_moves = is_dynamic(joint.child), parent_moves = is_dynamic(joint.parent);
    if (child_moves == parent_moves) continue;
    const int body = child_moves ? joint.child : joint.parent;
    if (tree_of_[index(body)] >= 0) continue;
    Tree tree = begin_tree();
    add_node(body, -1, child_moves ? joint.parent : joint.child, static_cast<int>(j));
    grow(grow, body);
    end_tree(tree);
  }
  for (std::size_t b = 0; b < bodies.size(); ++b) {  // floating trees
    const int body = static_cast<int>(b);
    if (!is_dynamic(body) || tree_of_[b] >= 0) continue;
    bool joined = false;
    for (const Joint& joint : joints) joined = joined || joint.parent == body || joint.child == body;
    if (!joined) continue;
    Tree tree = begin_tree();
    add_node(body, -1, -1, -1);
    grow(grow, body);
    end_tree(tree);
  }
  find_loops(bodies, joints, used);
}

// A body's joints are all in its tree, so a joint that no tree uses closes a loop of one tree, or connects it to a carrier.
void Forest::find_loops(std::span<const RigidBody> bodies, std::span<const Joint> joints, std::span<const char> used) {
  const auto is_dynamic = [&](int body) { return body >= 0 && bodies[static_cast<std::size_t>(body)].dynamic(); };
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const Joint& joint = joints[j];
    if (used[j] || (!is_dynamic(joint.parent) && !is_dynamic(joint.child))) continue;
    const auto carrier = [&](int body) {
      return body >= 0 && bodies[static_cast<std::size_t>(body)].motion == scene::Motion::kDriven ? body : -1;
    };
    const auto node = [&](int body) { return is_dynamic(body) ? node_of(body) : -1; };
    Tree& tree = trees_[static_cast<std::size_t>(tree_of(is_dynamic(joint.child) ? joint.child : joint.parent))];
    tree.loops.add(static_cast<int>(j), joint.type, node(joint.parent), node(joint.child), carrier(joint.parent),
                   carrier(joint.child));
  }
  for (Tree& tree : trees_) {
    const auto freedoms = static_cast<std::size_t>(tree.end_freedom - tree.first_freedom);
    if (std::min(tree.loops.size(), freedoms) > Loops::kMostRank) {  // the decomposition costs its cube
      for (const Loops::Row& row : tree.loops.rows()) outside_[static_cast<std::size_t>(row.joint)] = 1;
      tree.loops = {};
    }
    if (!tree.loops.empty()) tree.loops.reserve(static_cast<int>(freedoms));
  }
}

void Forest::place(Tree& tree, std::span<const RigidBody> bodies, std::span<const Joint> joints) {
  tree.O = bodies[static_cast<std::size_t>(nodes_[static_cast<std::size_t>(tree.first)].body)].p;
  tree.factored = false;
  for (int n = tree.first; n < tree.end; ++n) {
    Node& node = nodes_[static_cast<std::size_t>(n)];
    const RigidBody& body = bodies[static_cast<std::size_t>(node.body)];
    const Vector3d r = body.p - tree.O;
    const Matrix3d I = body.R * body.moments.asDiagonal() * body.R.transpose();
    const double m = body.mass, x = r[0], y = r[1], z = r[2];
    // [m U, −m r×; m r×, I + m (r·r U − r rᵀ)]
    const double mx = m * x, my = m * y, mz = m * z;
    node.inertia = {m,
                    0,
                    0,
                    0,
                    mz,
                    -my,  //
                    0,
                    m,
                    0,
                    -mz,
                    0,
                    mx,  //
                    0,
                    0,
                    m,
                    my,
                    -mx,
                    0,  //
                    0,
                    -mz,
                    my,
                    I(0, 0) + my * y + mz * z,
                    I(0, 1) - mx * y,
                    I(0, 2) - mx * z,  //
                    mz,
                    0,
                    -mx,
                    I(0, 1) - mx * y,
                    I(1, 1) + mx * x + mz * z,
                    I(1, 2) - my * z,  //
                    -my,
                    mx,
                    0,
                    I(0, 2) - mx * z,
                    I(1, 2) - my * z,
                    I(2, 2) + mx * x + my * y};
    Freedom* freedom = freedoms_.data() + node.first;
    if (node.joint < 0) {
      for (std::size_t k = 0; k < 6; ++k) {
        freedom[k].S = {};
        freedom[k].S[k] = 1;
      }
      continue;
    }
    const Joint& joint = joints[static_cast<std::size_t>(node.joint)];
    node.R = joint.R_parent;
    node.p = joint.p_child;
    const Vector3d a = node.sign * joint.axis();
    const Vector3d arm = joint.p_parent - tree.O;
    if (joint.type == JointType::kRevolute || joint.type == JointType::kScrew) {
      freedom[0].S = spatial(arm.cross(a) + joint.pitch * a, a);
    } else if (joint.type == JointType::kPrismatic) {
      freedom[0].S = spatial(a, Vector3d::Zero());
    } else if (joint.type == JointType::kSpherical) {
      for (int k = 0; k < 3; ++k) freedom[k].S = spatial(arm.cross(Vector3d::Unit(k)), Vector3d::Unit(k));
    }
  }
  if (!tree.loops.empty()) tree.loops.place(tree.O, bodies, joints);
}

void Forest::factor(Tree& tree) {
  tree.degenerate = 0;
  for (int n = tree.first; n < tree.end; ++n)
    nodes_[static_cast<std::size_t>(n)].IA = nodes_[static_cast<std::size_t>(n)].inertia;
  for (int n = tree.end - 1; n >= tree.first; --n) {
    Node& node = nodes_[static_cast<std::size_t>(n)];
    Spatial diagonal;
    for (std::size_t i = 0; i < 6; ++i) diagonal[i] = node.IA[7 * i];
    for (int k = node.first + node.count - 1; k >= node.first; --k) {
      Freedom& freedom = freedoms_[static_cast<std::size_t>(k)];
      multiply(node.IA, freedom.S, freedom.U);
      const double inertia = dot(freedom.S, freedom.U);
      freedom.D = inertia + freedom.softness;
      freedom.inverse_D = freedom.inverse_root_D = 0;
      if (freedom.locked) continue;
      double scale = freedom.softness;  // rounding of this size is not an inertia
      for (std::size_t i = 0; i < 6; ++i) scale += freedom.S[i] * freedom.S[i] * diagonal[i];
      if (!(freedom.D > 1e-13 * scale)) {
        ++tree.degenerate;
        continue;
      }
      freedom.inverse_D = 1 / freedom.D;
      freedom.inverse_root_D = std::sqrt(freedom.inverse_D);
      for (std::size_t j = 0; j < 6; ++j) {
        const double factor = freedom.U[j] * freedom.inverse_D;
        for (std::size_t i = 0; i < 6; ++i) node.IA[6 * j + i] -= factor * freedom.U[i];
      }
    }
    if (node.parent < 0) continue;
    Node& parent = nodes_[static_cast<std::size_t>(node.parent)];
    for (std::size_t i = 0; i < 36; ++i) parent.IA[i] += node.IA[i];
  }
  tree.factored = true;
  if (tree.loops.empty()) return;
  std::uint32_t locks = 2166136261U;  // FNV-1a
  for (int k = tree.first_freedom; k < tree.end_freedom; ++k) {
    locks = (locks ^ static_cast<std::uint32_t>(freedoms_[static_cast<std::size_t>(k)].locked)) * 16777619U;
  }
  tree.loops.factor(locks, [&](const Loops::Row& row, double* y) {
    if (row.node_a >= 0) add_tree_response(tree, row.node_a, row.f, -1, y);
    if (row.node_b >= 0) add_tree_response(tree, row.node_b, row.f, 1, y);
  });
}

void Forest::load_momenta(const Tree& tree, std::span<const RigidBody> bodies) {
  for (int n = tree.first; n < tree.end; ++n) {
    Node& node = nodes_[static_cast<std::size_t>(n)];
    const RigidBody& body = bodies[static_cast<std::size_t>(node.body)];
    const Vector3d P = body.mass * body.v;
    node.F = spatial(P, body.L + (body.p - tree.O).cross(P));
  }
}

void Forest::solve(Tree& tree, std::span<const RigidBody> bodies) {
  solve_tree(tree, bodies);
  Loops& loops = tree.loops;
  if (loops.empty()) return;
  const auto speed = [&](int node, int carrier, const Spatial& f) {
    if (node >= 0) return dot(f, nodes_[static_cast<std::size_t>(node)].V);
    if (carrier < 0) return 0.0;
    const RigidBody& body = bodies[static_cast<std::size_t>(carrier)];
    return dot(f, spatial(body.v + body.w.cross(tree.O - body.p), body.w));
  };
  for (std::size_t i = 0; i < loops.size(); ++i) {
    const Loops::Row& row = loops.rows()[i];
    loops.present()[i] = speed(row.node_b, row.carrier_b, row.f) - speed(row.node_a, row.carrier_a, row.f);
  }
  loops.solve();
  for (const Loops::Row& row : loops.rows()) {
    if (row.node_a >= 0) add(nodes_[static_cast<std::size_t>(row.node_a)].F, -row.impulse, row.f);
    if (row.node_b >= 0) add(nodes_[static_cast<std::size_t>(row.node_b)].F, row.impulse, row.f);
  }
  solve_tree(tree, bodies);
}

void Forest::solve_tree(const Tree& tree, std::span<const RigidBody> bodies) {
  for (int n = tree.first; n < tree.end; ++n)
    nodes_[static_cast<std::size_t>(n)].pending = nodes_[static_cast<std::size_t>(n)].F;
  for (int n = tree.end - 1; n >= tree.first; --n) {
    Node& node = nodes_[static_cast<std::size_t>(n)];
    Spatial& F = node.pending;
    for (int k = node.first + node.count - 1; k >= node.first; --k) {
      Freedom& freedom = freedoms_[static_cast<std::size_t>(k)];
      if (freedom.locked) {
        freedom.impulse = -dot(freedom.S, F);
        add(F, -freedom.target, freedom.U);
      } else {
        freedom.s = (freedom.tau + dot(freedom.S, F)) * freedom.inverse_D;
        add(F, -freedom.s, freedom.U);
      }
    }
    if (node.parent < 0) continue;
    Spatial& onto = nodes_[static_cast<std::size_t>(node.parent)].pending;
    add(onto, 1, F);
    if (!node.has_beta) continue;
    Spatial bent;
    multiply(node.IA, node.beta, bent);
    add(onto, -1, bent);
  }
  for (int n = tree.first; n < tree.end; ++n) {
    Node& node = nodes_[static_cast<std::size_t>(n)];
    if (node.parent >= 0) {
      node.V = nodes_[static_cast<std::size_t>(node.parent)].V;
    } else if (node.carrier >= 0) {
      const RigidBody& carrier = bodies[static_cast<std::size_t>(node.carrier)];
      node.V = spatial(carrier.v + carrier.w.cross(tree.O - carrier.p), carrier.w);
    } else {
      node.V = {};
    }
    if (node.has_beta) add(node.V, 1, node.beta);
    for (int k = node.first; k < node.first + node.count; ++k) {
      Freedom& freedom = freedoms_[static_cast<std::size_t>(k)];
      const double carried = dot(freedom.U, node.V);
      if (freedom.locked) {
        freedom.s = freedom.target;
        freedom.impulse += carried + freedom.D * freedom.target - freedom.tau;
      } else {
        freedom.s -= carried * freedom.inverse_D;
      }
      add(node.V, freedom.s, freedom.S);
    }
  }
}

void Forest::store(const Tree& tree, std::span<RigidBody> bodies) const {
  for (int n = tree.first; n < tree.end; ++n) {
    const Node& node = nodes_[static_cast<std::size_t>(n)];
    RigidBody& body = bodies[static_cast<std::size_t>(node.body)];
    body.set_spin({node.V[3], node.V[4], node.V[5]});
    body.v = Vector3d(node.V[0], node.V[1], node.V[2]) + body.w.cross(body.p - tree.O);
  }
}

void Forest::correct_beta(Tree& tree, std::span<const Joint> joints, double h) {
  tree.loops.correct();
  for (int n = tree.first; n < tree.end; ++n) {
    Node& node = nodes_[static_cast<std::size_t>(n)];
    if (node.joint < 0) continue;
    add(node.local, -node.sign / h, local_error(joints[static_cast<std::size_t>(node.joint)]));
    set_beta(tree.O, node);
  }
}

void Forest::clear_beta(Tree& tree) {
  tree.loops.clear_speeds();
  for (int n = tree.first; n < tree.end; ++n) {
    nodes_[static_cast<std::size_t>(n)].beta = {};
    nodes_[static_cast<std::size_t>(n)].has_beta = false;
  }
}

void Forest::predict_beta(Tree& tree, std::span<const RigidBody> bodies, std::span<const Joint> joints, double h) {
  if (!tree.loops.empty()) {
    double energy = 0;
    for (int n = tree.first; n < tree.end; ++n) {
      energy += bodies[static_cast<std::size_t>(nodes_[static_cast<std::size_t>(n)].body)].kinetic_energy();
    }
    tree.loops.predict(joints, h, std::sqrt(2 * energy));
  }
  for (int n = tree.first; n < tree.end; ++n) {
    Node& node = nodes_[static_cast<std::size_t>(n)];
    if (node.joint < 0) continue;
    node.start = {};
    add(node.start, -node.sign / h, local_error(joints[static_cast<std::size_t>(node.joint)]));
    node.local = node.start;
    add(node.local, 3, node.curve[0]);  // extrapolation by a parabola
    add(node.local, -3, node.curve[1]);
    add(node.local, 1, node.curve[2]);
    set_beta(tree.O, node);
  }
}

void Forest::restart_beta(Tree& tree) {
  tree.loops.restart();
  for (int n = tree.first; n < tree.end; ++n) {
    Node& node = nodes_[static_cast<std::size_t>(n)];
    if (node.joint < 0) continue;
    node.local = node.start;
    set_beta(tree.O, node);
  }
}

void Forest::store_beta(Tree& tree, std::span<const Joint> joints, double h) {
  tree.loops.store();
  for (int n = tree.first; n < tree.end; ++n) {
    Node& node = nodes_[static_cast<std::size_t>(n)];
    if (node.joint < 0) continue;
    node.curve[2] = node.curve[1];
    node.curve[1] = node.curve[0];
    node.curve[0] = node.local;
    add(node.curve[0], -1, node.start);
    add(node.curve[0], -node.sign / h, local_error(joints[static_cast<std::size_t>(node.joint)]));
  }
}

void Forest::clear_history(Tree& tree) {
  tree.loops.clear_history();
  for (int n = tree.first; n < tree.end; ++n) {
    Node& node = nodes_[static_cast<std::size_t>(n)];
    std::fill(std::begin(node.curve), std::end(node.curve), Spatial{});
  }
}

void Forest::apply_impulse(const Tree& tree, Node& node, const Vector3d& impulse, const Vector3d& moment, const Vector3d& p) {
  add(node.F, 1, spatial(impulse, moment + (p - tree.O).cross(impulse)));
}

void Forest::add_response(const Tree& tree, int node, const Spatial& f, double sign, double* y) const {
  add_tree_response(tree, node, f, sign, y);
  if (!tree.loops.empty()) tree.loops.project(y);
}

void Forest::add_tree_response(const Tree& tree, int node, Spatial f, double sign, double* y) const {
  while (node >= 0) {
    const Node& at = nodes_[static_cast<std::size_t>(node)];
    for (int k = at.first + at.count - 1; k >= at.first; --k) {
      const Freedom& freedom = freedoms_[static_cast<std::size_t>(k)];
      if (freedom.inverse_D == 0) continue;
      const double e = dot(freedom.S, f);
      y[k - tree.first_freedom] += sign * e * freedom.inverse_root_D;
      add(f, -e * freedom.inverse_D, freedom.U);
    }
    node = at.parent;
  }
}

}  // namespace cotwin::contact_world
