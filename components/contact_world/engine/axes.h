#pragma once
#include <cstdint>
#include <limits>
#include <span>

#include "components/contact_world/engine/forest.h"
#include "components/contact_world/engine/joint.h"

namespace cotwin::contact_world {

/// What acts along the axis of a joint besides inertia: drive, motor, friction, limits.
struct Axis {
  double tau = 0, stiffness = 0, damping = 0, rate = 0;  // of the next step, World::set_tau
  double inertia = 0, momentum = 0;                      // World::set_inertia; its momentum before the stage
  double motor_speed = 0, motor_torque = 0;              // World::set_motor
  double spring = 0;                                     // torque of the spring in the step's middle
  std::int32_t lock = 0;                                 // what holds the joint, as in AxisLaw::Corner; 0: nothing
};

/// The two solutions of a step: for x_{n+1} at x_n, and for v_{n+1} at x_{n+1}.
enum class Stage { kPosition, kVelocity };

/// Torque along an axis against its speed: constants between corners, where the speed is held by any torque between those of
/// both sides. Limits, a motor of bounded torque and Coulomb friction are one corner each; the sum is monotone.
class AxisLaw {
 public:
  struct Corner {
    double speed = 0;
    double below = 0, above = 0;  // impulse at lower and at higher speeds
    std::int32_t id = 0;          // 1 lower limit, 2 friction, 3 motor, 4 upper limit
  };

  AxisLaw() = default;
  AxisLaw(const Joint& joint, const Axis& axis, Stage stage, double h);

  bool empty() const { return count_ == 0; }
  std::span<const Corner> corners() const { return {corners_, static_cast<std::size_t>(count_)}; }

  /// Puts a freedom where it was held last, or else where its speed is.
  void begin(const Axis& axis, Forest::Freedom& freedom, double tau);
  /// Moves a freedom to where its solution belongs; false if it belongs where it is.
  bool move(Axis& axis, Forest::Freedom& freedom, double tau);

 private:
  double impulse_in(int region) const;  // region r: above r corners
  void release(Axis& axis, Forest::Freedom& freedom, double tau, int region);
  void hold(Axis& axis, Forest::Freedom& freedom, double tau, int corner);

  Corner corners_[4];
  int count_ = 0;
  int region_ = 0;  // where released
  int held_ = -1;   // corner; −1: released
};

/// Speeds at which an axis reaches its limits: `lower` ≤ s ≤ `upper`. Beyond a limit the position stage brings it back.
struct LimitSpeeds {
  LimitSpeeds(const Joint& joint, Stage stage, double h);
  double lower = -std::numeric_limits<double>::infinity(), upper = std::numeric_limits<double>::infinity();
};

/// Softness and constant impulse along an axis of damper and drive, in half a step. In the position stage the spring's torque
/// is that of the step's middle, s · h/2 on; the velocity stage gives it once more. An inertia takes what its change of speed
/// needs.
struct AxisDrive {
  AxisDrive(const Joint& joint, const Axis& axis, Stage stage, double h);
  double softness = 0, tau = 0;
};

}  // namespace cotwin::contact_world
