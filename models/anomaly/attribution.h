#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "models/robot/drives/drive_parameters.h"
#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"

namespace cotwin::anomaly {

/// What may have changed when torques no longer are those of the tuned robot.
enum class Cause { kLoad, kFriction, kContact, kEncoder };
const char* to_text(Cause cause);  // "load", "friction", "contact", "encoder"

/// The torques of the tuned robot, and what each cause would add to them (n joints, 1 + 3n causes in this order):
///   load        1 kg at the end of the robot: the origin of its last body whose bodies nobody carries; per kg
///   friction j  the friction curve of joint j without its constant part; per share. A joint without one: tanh(q̇_j / 0.02 rad/s), per N.m
///   contact j   a constant torque at joint j; per N.m
///   encoder j   ∂τ/∂q_j: the joint stands elsewhere than its encoder tells; per rad
/// For prismatic joints N, m/s and m.
class TorqueModel {
 public:
  /// `motor`: torques are measured at the motors, so that B q̈ and friction of the motor are in them; else behind the gears.
  TorqueModel(const robot::RobotModel& robot, bool motor);

  robot::DriveParameters drives;  // the start values of kDriveParameters, but B = 0
  /// For changes of masses, see Mechanism::update().
  robot::Mechanism& mechanism() { return mechanism_; }
  /// To be called after `drives` has changed. Allocates nothing.
  void update();
  void evaluate(const double* q, const double* dq, const double* ddq);

  int joints() const { return mechanism_.n(); }
  int causes() const { return 1 + 3 * joints(); }
  Cause cause(int k) const { return k == 0 ? Cause::kLoad : static_cast<Cause>(1 + (k - 1) / joints()); }
  int joint(int k) const { return k == 0 ? -1 : (k - 1) % joints(); }
  const Eigen::VectorXd& tau() const { return tau_; }          // n, N.m
  const Eigen::MatrixXd& effects() const { return effects_; }  // n x causes
  bool has_friction(int j) const { return has_friction_[static_cast<std::size_t>(j)]; }

 private:
  double friction(std::size_t j, double v, double gravity) const;

  bool motor_;
  robot::Mechanism mechanism_, load_;
  robot::Data data_, load_data_;
  Eigen::VectorXd q_, dq_, ddq_, tau_, gravity_, load_tau_;
  Eigen::MatrixXd effects_, by_q_, by_dq_;
  std::vector<double> usual_;  // rad/s or m/s, a speed at which joints have their friction
  std::vector<char> has_friction_;
};

}  // namespace cotwin::anomaly
