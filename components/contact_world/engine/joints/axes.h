#pragma once
#include <cstdint>
#include <limits>
#include <span>

#include "components/contact_world/engine/joints/forest.h"
#include "components/contact_world/engine/joints/joint.h"

namespace cotwin::contact_world {

/// Loads along the axis of a joint besides the inertia of its bodies: drive, motor, friction, limits.
struct Axis {
  double tau = 0, stiffness = 0, damping = 0, rate = 0;  // for the next step, World::set_tau
  double inertia = 0, momentum = 0;                      // World::set_inertia; its momentum before the stage
  double motor_speed = 0, motor_torque = 0;              // World::set_motor
  double spring = 0;                                     // torque of the spring in the middle of the step
  double start = 0;                                      // speed after the impacts of this step
  double passive[2] = {};                                // impulses of limits, friction and motor in the stages of this step
  std::int32_t lock = 0;                                 // AxisLaw::Corner::id of the corner that holds the joint; 0: free
};

/// The two solutions of a step: the position stage finds x_{n+1} from x_n, the velocity stage v_{n+1} at x_{n+1}.
enum class Stage { kPosition, kVelocity };

/// Torque along an axis as a function of its speed: piecewise constant, with jumps at corners. At a corner the speed is held by
/// any torque between the values of both sides. Limits, a motor of bounded torque and Coulomb friction are one corner each; the
/// sum decreases monotonically.
class AxisLaw {
 public:
  struct Corner {
    double speed = 0;
    double below = 0, above = 0;  // impulse at lower and at higher speed
    std::int32_t id = 0;          // 1 lower limit, 2 friction, 3 motor, 4 upper limit
  };

  AxisLaw() = default;
  AxisLaw(const Joint& joint, const Axis& axis, Stage stage, double h);

  bool empty() const { return count_ == 0; }
  std::span<const Corner> corners() const { return {corners_, static_cast<std::size_t>(count_)}; }

  /// Initialises a freedom: held at the corner of the last step, otherwise released in the region of its speed.
  void begin(const Axis& axis, Forest::Freedom& freedom, double tau);
  /// Holds or releases a freedom as its solution requires. Returns false if nothing changed.
  bool move(Axis& axis, Forest::Freedom& freedom, double tau);
  /// The impulse of limits, friction and motor in the solution of a freedom.
  double impulse(const Forest::Freedom& freedom) const { return held_ >= 0 ? freedom.impulse : impulse_in(region_); }

 private:
  double impulse_in(int region) const;  // region r: above r corners
  void release(Axis& axis, Forest::Freedom& freedom, double tau, int region);
  void hold(Axis& axis, Forest::Freedom& freedom, double tau, int corner);

  Corner corners_[4];
  int count_ = 0;
  int region_ = 0;  // region, where released
  int held_ = -1;   // corner; −1: released
};

/// Speeds at which an axis reaches its limits: `lower` ≤ s ≤ `upper`. The position stage corrects a violated limit.
struct LimitSpeeds {
  LimitSpeeds(const Joint& joint, Stage stage, double h);
  double lower = -std::numeric_limits<double>::infinity(), upper = std::numeric_limits<double>::infinity();
};

/// Softness and constant impulse of damper and drive along an axis, over half a step. The position stage computes the spring's
/// torque in the middle of the step, at s · h/2; the velocity stage applies the same torque again. An inertia contributes
/// the impulse of its change of speed.
struct AxisDrive {
  AxisDrive(const Joint& joint, const Axis& axis, Stage stage, double h);
  double softness = 0, tau = 0;
};

}  // namespace cotwin::contact_world
