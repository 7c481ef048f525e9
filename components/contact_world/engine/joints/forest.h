#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "components/contact_world/engine/body/body.h"
#include "components/contact_world/engine/joints/joint.h"
#include "components/contact_world/engine/joints/loops.h"

namespace cotwin::contact_world {

/// Trees of bodies and joints, solved exactly in O(n), and the joints that close loops in them. Among the velocities that the
/// joints permit, the solution is closest to the free velocities ν* in kinetic energy:
///   min ½ (ν − ν*)ᵀ M (ν − ν*)   with   V_i = V_parent + β_i + Σ_k S_k s_k   and the rows of Loops
/// Uses articulated-body inertias (Featherstone), from leaf to root and back, in maximal coordinates. Joint impulses are equal
/// and opposite at one point, so momentum is conserved to rounding for any β.
class Forest {
 public:
  /// One degree of freedom of a joint, or of a tree's free root.
  struct Freedom {
    Spatial S{};          // unit twist
    double softness = 0;  // impulse against the motion per speed, of dampers and springs; for example N.m.s.s/rad
    double tau = 0;       // impulse along S
    bool locked = false;  // moves at `target` for any impulse
    double target = 0;
    double s = 0;                                     // result: speed along S
    double impulse = 0;                               // result if locked: the impulse along S
    Spatial U{};                                      // I^A S
    double D = 0, inverse_D = 0, inverse_root_D = 0;  // 0 where locked or without inertia
  };

  struct Node {
    int body = -1;
    int parent = -1;           // node; −1: the carrier below, or nothing
    int carrier = -1;          // body that is not dynamic and carries the root through a joint; −1: the world, or a free root
    int joint = -1;            // −1: free root
    double sign = 1;           // −1 where the joint's parent is the node's body
    int first = 0, count = 0;  // its freedoms
    bool has_beta = false;     // β ≠ 0
    Spatial beta{};
    Matrix3d R = Matrix3d::Identity();  // R_WP' of the joint's frame on its parent, at the last place()
    Vector3d p = Vector3d::Zero();      // the child's anchor, at the last place()
    Spatial local{};                    // β in the joint's frame
    Spatial start{};                    // part of `local` that corrects the error at the start of the step
    Spatial curve[3]{};                 // remaining part in the last three steps, latest first
    Spatial F{};                        // momentum of the free motion plus all impulses on the body
    Spatial V{};                        // result
    std::array<double, 36> inertia{};   // of the body at O
    std::array<double, 36> IA{};        // articulated-body inertia, without the directions of its freedoms
    Spatial pending{};                  // part of F that the node passes to its parent
  };

  struct Tree {
    int first = 0, end = 0;                  // nodes
    int first_freedom = 0, end_freedom = 0;  // freedoms
    Vector3d O = Vector3d::Zero();
    bool factored = false;
    int degenerate = 0;  // freedoms without inertia
    Loops loops;
  };

  /// Builds trees from all joints that have a dynamic body, except those that close a loop. The root of a tree is a body that a
  /// static or driven body or the world carries, otherwise its first body.
  Forest(std::span<const RigidBody> bodies, std::span<const Joint> joints);

  std::span<Tree> trees() { return trees_; }
  std::span<const Tree> trees() const { return trees_; }
  std::span<Node> nodes() { return nodes_; }
  std::span<const Node> nodes() const { return nodes_; }
  std::span<Freedom> freedoms() { return freedoms_; }
  int tree_of(int body) const { return tree_of_[static_cast<std::size_t>(body)]; }  // −1: none
  bool holds(int body) const { return body >= 0 && tree_of(body) >= 0; }
  int node_of(int body) const { return node_of_[static_cast<std::size_t>(body)]; }
  int freedom_of(int joint) const { return freedom_of_[static_cast<std::size_t>(joint)]; }  // of a joint with an axis; −1: none
  bool contains(int joint) const { return !outside_[static_cast<std::size_t>(joint)]; }     // in a tree or closing a loop of it

  /// Computes inertias and directions for the bodies' present poses and the joints' frames.
  void place(Tree& tree, std::span<const RigidBody> bodies, std::span<const Joint> joints);
  /// Factorises for the present locks and softnesses.
  void factor(Tree& tree);
  /// Sets F to the momentum of the bodies' present twists.
  void load_momenta(const Tree& tree, std::span<const RigidBody> bodies);
  /// Computes V, s and impulses from F, τ, β, targets and the speeds of the loops, whose impulses are added to F.
  void solve(Tree& tree, std::span<const RigidBody> bodies);
  /// Sets the bodies' twists to V.
  void store(const Tree& tree, std::span<RigidBody> bodies) const;

  // β and the speeds of the loops, which correct positions:

  /// β −= present errors of the joints / h; the loops are corrected as Loops::measure() found.
  void correct_beta(Tree& tree, std::span<const Joint> joints, double h);
  void clear_beta(Tree& tree);
  /// Sets β to its extrapolation from the last three steps plus the correction of the joints' present errors in a step h.
  void predict_beta(Tree& tree, std::span<const RigidBody> bodies, std::span<const Joint> joints, double h);
  /// Sets β to the correction of the joints' errors at the start of the step.
  void restart_beta(Tree& tree);
  /// Stores β for the next steps; the joints are in their final positions.
  void store_beta(Tree& tree, std::span<const Joint> joints, double h);
  void clear_history(Tree& tree);
  /// Adds an impulse and an angular impulse at p, in W, to F of a node.
  void apply_impulse(const Tree& tree, Node& node, const Vector3d& impulse, const Vector3d& moment, const Vector3d& p);

  /// Adds sign · response of the tree's freedoms to a unit impulse f (at O) on a node to y, in coordinates in which the inertia
  /// is the unit matrix: for two rows, y_a · y_b is their element of J M⁻¹ Jᵀ with the joints and loops eliminated. y: one element per
  /// freedom.
  void add_response(const Tree& tree, int node, const Spatial& f, double sign, double* y) const;

 private:
  Forest(std::size_t bodies, std::size_t joints);
  void find_loops(std::span<const RigidBody> bodies, std::span<const Joint> joints, std::span<const char> used);
  void solve_tree(const Tree& tree, std::span<const RigidBody> bodies);
  void add_tree_response(const Tree& tree, int node, Spatial f, double sign, double* y) const;

  std::vector<Tree> trees_;
  std::vector<Node> nodes_;
  std::vector<Freedom> freedoms_;
  std::vector<int> tree_of_, node_of_, freedom_of_;
  std::vector<char> outside_;  // per joint: in no tree although it has a dynamic body
};

}  // namespace cotwin::contact_world
