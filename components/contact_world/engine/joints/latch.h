#pragma once
#include <Eigen/Core>
#include <span>

#include "components/contact_world/engine/joints/axes.h"
#include "components/contact_world/engine/joints/joint.h"
#include "models/scene/scene.h"

namespace cotwin::contact_world {

/// How a latch closes and what it bears.
struct LatchLaw {
  double reach = 0.005, tilt = 0.1;          // largest distance and angle of its frames when it closes, m, rad
  double time = 0;                           // in which it draws the frames together, s; 0: they stay as they met
  double stiffness = 0, turn_stiffness = 0;  // N/m, N.m/rad; 0: rigid
  double force = scene::kInfinity, moment = scene::kInfinity;  // that it bears, N, N.m
};

/// A connection of two bodies in all six directions that closes and opens. While it closes, that is until the frames are drawn together and
/// it bears the load, it slips at the force or moment that it bears at most; afterwards it breaks away there.
///
/// Closed it is six rows (rows.h). Rigid: the relative velocity of the frames is that of the drawing. With a stiffness k and the error e it is a
/// spring without damping by the implicit midpoint rule, as Axis: the impulse of each half of the step h is −k h/2 (e + (u − rate) h/2).
class Latch {
 public:
  /// `frames`: kFixed, with both frames and bodies. Throws Error as Joint does.
  Latch(const scene::Joint& frames, std::span<const RigidBody> bodies) : joint(frames, bodies) {}

  double distance() const { return (joint.p_child - joint.p_parent).norm(); }  // of the frames, m
  double angle() const;                                                        // rad
  bool within_reach() const { return distance() <= law.reach && angle() <= law.tilt; }
  /// Closes with the frames as they are placed.
  void close();
  void open() { closed = holds = false; }

  /// Of the child against where it is to be, and the rate at which that moves, at the start (kPosition) or the end (kVelocity) of a step.
  struct Aim {
    Motion6 error, rate;
    double cosine = 1;  // of the angle, whose sine is error.angular
  };
  Aim aim(Stage stage, double h) const;

  /// At the end of a step: draws the frames on. Opens where the load was too large, and then returns true.
  bool advance(double h);

  Joint joint;
  LatchLaw law;
  bool closed = false, holds = false;  // holds: it no longer slips, but breaks
  double progress = 0;                 // of the drawing, 0 … 1
  Motion6 met;                         // pose of the child's frame in the parent's one when it closed; angular: rotation vector
  Motion6 impulse;                     // on the child at its frame, in W, of the last solution
  Motion6 sum;                         // of both stages of this step
  bool overloaded = false;             // in this step

 private:
  double progress_after(double h) const;
};

}  // namespace cotwin::contact_world
