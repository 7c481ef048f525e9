#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "components/contact_world/engine/collision.h"
#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

namespace cotwin::contact_world {

enum class Method {
  kPgs,      // projected Gauss–Seidel over joints, limits and contacts alike (the paper's)
  kDantzig,  // limits, motors and contacts by Dantzig's pivoting, exact for the boxed problem; joints eliminated exactly
  kTree      // joint trees with their limits, motors and friction exactly in O(n), contacts iteratively
};

struct Options {
  Method method = Method::kTree;
  int iterations = 20;         // sweeps at most, in each of the two solutions of a step
  double tolerance = 1e-9;     // of the residual, m/s; sweeps end below it; 0: all sweeps are made
  std::size_t contacts = 256;  // points that a step takes without allocating
};

/// What the solver thinks of its last step.
struct Status {
  int iterations = 0;        // sweeps or pivots made, the most of any island
  double residual = 0;       // largest violation of the complementarity conditions, m/s
  std::size_t contacts = 0;  // points in the step
  std::size_t grown = 0;     // times that the capacity was exceeded and grew, since construction
  int degenerate = 0;        // rows that were redundant or contradicted each other and were relaxed
};

/// Bodies in maximal coordinates, (1): M ν̇ = f + f_c. Copyable state, no clock, no files; the unit around it is
/// contact_world.h.
///
/// A step from t_n to t_n + h is RATTLE with contacts:
///   1. half a kick by the forces at x_n, and impulses by which x_{n+1} satisfies the joints and closes no gap
///   2. drift with the velocity of the step's middle; angular momentum is kept, rotations are of second order
///   3. half a kick by the forces at x_{n+1}, and impulses by which v_{n+1} satisfies joints and contacts
/// Second order and symplectic where nothing strikes; momentum is kept exactly.
class World {
 public:
  /// Throws Error if a dynamic body has no physical inertia, a joint's bodies do not exist, or an axis is no unit vector.
  World(scene::Scene scene, Options options);
  ~World();
  World(World&&) noexcept;
  World& operator=(World&&) noexcept;

  /// Moves every body from t to t + h.
  void step(double h);

  const scene::Scene& scene() const;
  std::span<const Pose> poses() const;    // X_WB, one a body of the scene
  std::span<const Twist> twists() const;  // V_WB of the frame's origin, expressed in W
  void set_pose(std::size_t body, const Pose& X_WB);
  void set_twist(std::size_t body, const Twist& V_WB);
  /// A wrench on the body's origin, expressed in W, held over the next step.
  void apply(std::size_t body, const Wrench& F_B_W);

  std::span<const double> q() const;  // of each revolute or prismatic joint of the scene (0 for the others), rad or m
  std::span<const double> dq() const;
  /// N.m or N between child and parent over the next step, as a spring and a damper would give it while the joint moves:
  ///   τ(s) = tau + stiffness · (rate · s − (q(s) − q(0))) + damping · (rate − q̇(s))
  /// s after the step's start. The spring is taken by the implicit midpoint rule, so any stiffness is stable and keeps energy;
  /// the damper implicitly in each half of the step.
  void set_tau(std::size_t joint, double tau, double stiffness = 0, double damping = 0, double rate = 0);
  /// An inertia of kg.m2 or kg that moves with the joint's q̇ and is no body's, as a motor's behind a rigid gear; until it is
  /// set again.
  void set_inertia(std::size_t joint, double inertia);
  /// A motor that holds the joint at dq with at most `tau_max` (infinity: whatever it takes), until it is set again; 0 takes it
  /// away.
  void set_motor(std::size_t joint, double dq, double tau_max);

  std::span<const ContactPoint> contacts() const;   // of the last step
  std::span<const Eigen::Vector3d> forces() const;  // on body b at each of these points, expressed in W, N; mean over the step
  const Status& status() const;
  double energy() const;       // kinetic and potential, J
  double largest_gap() const;  // of all joints: how far the anchors have come apart, m

  /// The whole state as numbers, and back: poses, twists, warm start. A restored world steps to the same bits. Warm starts are
  /// kept for the first `Options::contacts` points, in the scheme as in the state.
  std::size_t state_size() const;  // constant
  void save(std::vector<double>& state) const;
  void restore(std::span<const double> state);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::contact_world
