#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "components/contact_world/engine/body.h"
#include "components/contact_world/engine/joint.h"

namespace cotwin::contact_world {

/// A spatial vector at a tree's origin O, linear first: the twist of a body's point at O, or a force or impulse with its moment
/// about O.
using Spatial = std::array<double, 6>;

/// Bodies that joints hang together without loops, solved exactly in O(n). Of all velocities that the joints permit, the
/// solution is the one nearest to the free velocities in the measure of the kinetic energy:
///   min ½ (ν − ν*)ᵀ M (ν − ν*)   with   V_i = V_parent + β_i + Σ_k S_k s_k
/// by articulated inertias (Featherstone), leaf to root and back, in maximal coordinates: impulses of the joints are equal and
/// opposite at one point, so momentum is kept to rounding whatever β.
class Forest {
 public:
  /// One direction in which a joint, or a tree's free root, lets its body move against its parent.
  struct Freedom {
    Spatial S{};          // unit twist
    double softness = 0;  // N.m.s.s/rad …: impulse against the motion per speed, of dampers and springs
    double tau = 0;       // impulse along S
    bool locked = false;  // moves at `target` whatever it takes
    double target = 0;
    double s = 0;                                     // result: speed along S
    double impulse = 0;                               // result where locked: what it took
    Spatial U{};                                      // I^A S
    double D = 0, inverse_D = 0, inverse_root_D = 0;  // 0 where locked or without inertia
  };

  struct Node {
    int body = -1;
    int parent = -1;   // node; −1: the carrier below, or nothing
    int carrier = -1;  // body that is not dynamic and carries the root by a joint; −1: the world, or nothing at a free root
    int joint = -1;    // −1: a free root
    double sign = 1;   // −1 where the joint's parent is the node's body
    int first = 0, count = 0;  // its freedoms
    bool bent = false;         // β is not zero
    Spatial beta{};
    Matrix3d R = Matrix3d::Identity();  // R_WP' of the joint's frame on its parent, when placed
    Vector3d p = Vector3d::Zero();      // and where the child's anchor was
    Spatial local{};                    // β seen from there
    Spatial start{};                    // of it, what makes up for the error at the step's start
    Spatial curve[3]{};                 // and the rest in the last steps, the latest first
    Spatial F{};                        // momentum of the free motion and all impulses on the body
    Spatial V{};                        // result
    std::array<double, 36> inertia{};   // of the body at O
    std::array<double, 36> IA{};        // articulated, without what its freedoms let go
    Spatial pending{};                  // of F, what the node hands on to its parent
  };

  struct Tree {
    int first = 0, end = 0;                  // nodes
    int first_freedom = 0, end_freedom = 0;  //
    Vector3d O = Vector3d::Zero();
    bool factored = false;
    int degenerate = 0;  // freedoms without inertia
  };

  /// Takes all joints between dynamic bodies, or a dynamic one and the rest, that close no loop. Each tree is rooted where it
  /// is carried, if it is; else at its first body.
  Forest(std::span<const RigidBody> bodies, std::span<const Joint> joints);
  static Forest none(std::size_t bodies, std::size_t joints);  // without a tree

  std::span<Tree> trees() { return trees_; }
  std::span<const Tree> trees() const { return trees_; }
  std::span<Node> nodes() { return nodes_; }
  std::span<const Node> nodes() const { return nodes_; }
  std::span<Freedom> freedoms() { return freedoms_; }
  int tree_of(int body) const { return tree_of_[static_cast<std::size_t>(body)]; }  // −1: none
  int node_of(int body) const { return node_of_[static_cast<std::size_t>(body)]; }
  int freedom_of(int joint) const { return freedom_of_[static_cast<std::size_t>(joint)]; }  // of a joint with an axis; −1: none
  bool closes_loop(int joint) const { return closing_[static_cast<std::size_t>(joint)]; }

  /// Inertias and directions at the bodies' present poses and the joints' places.
  void place(Tree& tree, std::span<const RigidBody> bodies, std::span<const Joint> joints);
  /// For the present locks and softnesses.
  void factor(Tree& tree);
  /// F := momentum of the bodies' present twists.
  void load_momenta(const Tree& tree, std::span<const RigidBody> bodies);
  /// V, s and impulses from F, τ, β, targets.
  void solve(const Tree& tree, std::span<const RigidBody> bodies);
  /// The bodies' twists := V.
  void store(const Tree& tree, std::span<RigidBody> bodies) const;

  /// β += rate · the joints' present errors.
  void bend(const Tree& tree, std::span<const Joint> joints, double rate);
  void straighten(const Tree& tree);
  /// β := what the last three steps suggest, and what makes up for the joints' present errors, in a step h.
  void expect(const Tree& tree, std::span<const Joint> joints, double h);
  /// β := what makes up for the joints' errors at the step's start.
  void start(const Tree& tree);
  /// Keeps β for the next steps; the joints are where it brought them.
  void remember(const Tree& tree, std::span<const Joint> joints, double h);
  void forget(const Tree& tree);
  /// F of a node += an impulse and an angular impulse at p, all in W.
  void push(const Tree& tree, Node& node, const Vector3d& impulse, const Vector3d& moment, const Vector3d& p);

  /// y += sign · what a unit impulse f (at O) on a node does to the tree's freedoms, in coordinates in which its inertia is the
  /// unit matrix: for two rows, y_a · y_b is their entry of J M⁻¹ Jᵀ, joints eliminated. y has one number a freedom.
  void respond(const Tree& tree, int node, Spatial f, double sign, double* y) const;

 private:
  Forest(std::size_t bodies, std::size_t joints);

  std::vector<Tree> trees_;
  std::vector<Node> nodes_;
  std::vector<Freedom> freedoms_;
  std::vector<int> tree_of_, node_of_, freedom_of_;
  std::vector<char> closing_;
};

}  // namespace cotwin::contact_world
