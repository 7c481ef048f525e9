#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/contact_world/engine/joints/latch.h"
#include "models/collision/contact/detector.h"
#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

namespace cotwin::contact_world {

using collision::ContactPoint;

enum class Method {
  kPgs,      // projected Gauss–Seidel for limits, motors, friction and contacts (the paper's); joints eliminated exactly
  kDantzig,  // limits, motors and contacts by Dantzig's pivoting, exact for the boxed problem; joints eliminated exactly
  kTree      // joint trees with their limits, motors and friction exactly in O(n), contacts iteratively
};

struct Options {
  Method method = Method::kTree;
  int iterations = 20;         // largest number of sweeps in each of the two stages of a step
  double tolerance = 1e-9;     // sweeps end at a smaller residual, m/s; 0: always `iterations` sweeps
  double friction_scale = 1;   // of all coefficients of friction
  std::size_t contacts = 256;  // number of points that a step takes without allocating
  std::size_t dents = 64;      // number of places that remember that they have yielded; then the oldest one is replaced
};

/// The solver's result of the last step.
struct Status {
  int iterations = 0;        // sweeps or pivots; the largest number of any island
  double residual = 0;       // largest violation of the complementarity conditions, m/s
  std::size_t contacts = 0;  // points in the step
  std::size_t grown = 0;     // number of times that the capacity was exceeded, since construction
  int degenerate = 0;        // redundant or contradicting rows that were relaxed
  int extended = 0;  // islands that took more than `iterations` sweeps, that sweeps left to pivoting, or the other way round
  int unsolved = 0;  // islands with a residual above 2 h g, weightless what presses them; at rest a twentieth of it or 1 mm/s
  int impacts = 0;   // rounds of impacts, one after the other
  double swing = 0;  // largest h ω of a loaded soft contact: its spring with the mobility behind it
};

/// A body with a surface that yields.
struct Yielding {
  std::size_t body = 0;
  double depth = 0;      // that stays at the deepest dent since the start, m
  double work = 0;       // dissipated by yielding, J
  double force = 0;      // sum of the normal forces on the surfaces that yield, mean over the step, N
  bool pierced = false;  // somewhere
};

/// Bodies in maximal coordinates, (1): M ν̇ = f + f_c. contact_world.h is the unit around it.
///
/// A step from t_n to t_n + h is RATTLE with contacts, after the impacts of bodies with restitution (impacts.cpp):
///   1. half a kick by the forces at x_n, and impulses such that x_{n+1} satisfies the joints and no gap becomes negative; contact points
///      stick in the middle of the step, to which they are followed along edges
///   2. drift with the velocity of the step's middle; rotations conserve angular momentum and are of second order
///   3. half a kick by the forces at x_{n+1}, and impulses such that v_{n+1} satisfies joints and contacts
/// Second order and symplectic without impacts; momentum is conserved exactly.
class World {
 public:
  /// Throws Error if a dynamic body has no physical inertia, a joint's bodies do not exist, or an axis is no unit vector.
  World(scene::Scene scene, Options options);
  ~World();
  World(World&&) noexcept;
  World& operator=(World&&) noexcept;

  /// Advances every body from t to t + h.
  void step(double h);

  const scene::Scene& scene() const;
  std::span<const Pose> poses() const;    // X_WB, one per body of the scene
  std::span<const Twist> twists() const;  // V_WB of the frame's origin, expressed in W
  void set_pose(std::size_t body, const Pose& X_WB);
  void set_twist(std::size_t body, const Twist& V_WB);
  const RigidBody& body(std::size_t body) const;
  /// Replaces the mass distribution of a dynamic body, given in its own frame. Its pose and twist stay, so that its energy and
  /// momentum change. Not part of the state: a world is restored with the bodies that it was saved with. Throws Error for an
  /// unphysical inertia. Allocates nothing.
  void set_body(std::size_t body, const Inertia& inertia);
  /// Applies a wrench at the body's origin, expressed in W, constant over the next step.
  void apply(std::size_t body, const Wrench& F_B_W);
  /// Adds the shapes of a tool (scene::Shape::tool) on a body that moves, or removes them; at first they are not there. Not part
  /// of the state, as set_body(). Allocates nothing.
  void set_tool(std::size_t body, const std::string& tool, bool present);
  /// Changes the foundation of all shapes of the body that have one: pressure per depth or stiffness, limit (Pa or N) and depth of
  /// breakthrough (m). Infinite limits must stay infinite, finite ones finite. Springs that are loaded change their energy; dents
  /// stay. Not part of the state, as set_body(). Allocates nothing. Throws Error for other values.
  void set_foundation(std::size_t body, double foundation, double yield, double breakthrough);

  std::span<const double> q() const;  // of each revolute or prismatic joint of the scene (0 for the others), rad or m
  std::span<const double> dq() const;
  /// Sets the torque or force (N.m, N) between child and parent over the next step, with a spring and a damper on the joint:
  ///   τ(s) = tau + stiffness · (rate · s − (q(s) − q(0))) + damping · (rate − q̇(s))
  /// s after the start of the step. The implicit midpoint rule integrates the spring: any stiffness is stable and conserves
  /// energy. The damper is implicit in each half of the step.
  void set_tau(std::size_t joint, double tau, double stiffness = 0, double damping = 0, double rate = 0);
  /// Sets an inertia (kg.m2, kg) that moves with the joint's q̇ but belongs to no body, such as a motor behind a rigid gear. It
  /// remains until the next call.
  void set_inertia(std::size_t joint, double inertia);
  /// Sets a motor that holds the joint at dq with at most `tau_max` (may be infinite) until the next call; 0 removes it.
  void set_motor(std::size_t joint, double dq, double tau_max);

  /// Those of the scene. A closed one that bears too much opens by itself at the end of a step.
  std::span<const Latch> latches() const;
  /// In force at once; `reach`, `tilt` when it closes.
  void set_latch(std::size_t latch, const LatchLaw& law);
  /// Closes a latch whose frames are within reach; the relative velocity of the bodies is lost in the next step. Returns whether it is
  /// closed. Bodies that a latch connects have no contacts with one another.
  bool close_latch(std::size_t latch);
  void open_latch(std::size_t latch);

  std::span<const ContactPoint> contacts() const;   // of the last step
  std::span<const Eigen::Vector3d> forces() const;  // on body b at each of these points, expressed in W, N; mean over the step
  /// Friction, and stiffness (infinite if rigid) with its damping, of each of these points until the next step or restore().
  struct ContactLaw {
    double mu = 0, stiffness = 0, damping = 0;  // 1, N/m, N.s/m
  };
  ContactLaw contact_law(std::size_t point) const;
  const Status& status() const;
  std::span<const Yielding> yielding() const;  // the bodies that can yield
  std::size_t forgotten_dents() const;         // that were replaced because there were more than Options::dents
  double energy() const;                       // kinetic and potential, J
  double largest_gap() const;                  // largest distance of the anchors of a joint, m

  /// Describes what is wrong since the start, or returns an empty text: a joint has parted by more than `gap_limit` (m; 0: not
  /// checked) or tilted by 0.1 rad, or the energy has grown without work by more than the share `energy_limit` (0: not checked)
  /// of that which there was at most: kinetic, of springs, and potential above the lowest place. While joints that
  /// start apart come together, 1.5 times the largest gap at the start is allowed. Not counted are steps in which a driven body with
  /// joints moves, gains where the normal of a soft contact deeper than 5 % of a body jumps, up to its energy and all that there was, and steps until
  /// joints that start apart or beyond their limits are corrected.
  std::string fault(double gap_limit, double energy_limit) const;
  /// Energy that was gained without work since the start, J, for bodies that joints, gears or latches connect together.
  struct Gain {
    double joules = 0;     // of all
    std::size_t body = 0;  // the fastest of those whose gain is the largest share
    double of_body = 0;    // their gain, J
    double share = 0;      // of the most energy that they had: kinetic, of springs, and potential above their lowest place
  };
  Gain gain() const;
  /// Adds energy that a body and its surroundings have gained without work outside of this world, J; negative: lost.
  void add_gain(std::size_t body, double joules);
  /// Leaves out what the next step finds of the body's account: others decide where the body goes.
  void leave_out(std::size_t body);

  /// Saves and restores the whole state: poses, twists, warm start. A restored world steps to the same bits. Only the first
  /// `Options::contacts` points have a warm start, with and without restoring.
  std::size_t state_size() const;  // constant
  void save(std::vector<double>& state) const;
  void restore(std::span<const double> state);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::contact_world
