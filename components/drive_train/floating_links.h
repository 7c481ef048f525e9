#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "components/unit/variables.h"
#include "models/robot/floating_base.h"

/// The links of a robot on a floating base: M* q̈ + b* in place of M q̈ + C q̇ + g of (2a), and the motion of the base.
namespace cotwin::drive_train {

/// The joints see the base only through the angular momentum about the centre of mass, in the base's axes. Within a step the
/// base's attitude for this is that of its angular velocity and acceleration at the step's beginning (error O(h³)); at its end
/// the attitude follows from the joints' motion to fourth order, and momentum and centre of mass move by their laws, which hold
/// exactly however coarse the steps are.
class FloatingLinks {
 public:
  explicit FloatingLinks(const robot::RobotModel& robot);

  /// Inputs, outputs, parameters and states of the base.
  void declare(Variables& v);
  /// Throws Error if a start value or an input is not finite, or the quaternion is not of length 1.
  void check_parameters(const std::string& place) const;
  void check_inputs(const std::string& place, double now) const;
  void update(const robot::RobotModel& robot) { mechanism_.update(robot); }

  /// The base at the start of a run, for the joints' q and q̇.
  void initialise(const double* q, const double* dq);
  /// Sets the momenta and the centre of mass to those of the base's pose and twist, which stay: after the bodies were changed.
  void set_velocity(const double* q, const double* dq);
  /// The base's course over the next step: first at its present angular velocity, then from q, q̇, q̈ (n) at its beginning.
  void hold(const double* q, const double* dq);
  void begin_step(const double* q, const double* dq, const double* ddq);
  /// Chooses the time within the step at which the following functions take the base, s.
  void set_time(double t) { attitude_at(t); }
  /// M* (n x n, both triangles) and b*.
  void mass_matrix_and_bias(const double* q, const double* dq, double* M, double* h);
  /// M* a + b*.
  void inverse_dynamics(const double* q, const double* dq, const double* a, double* tau);
  /// Moves the base over a step of h, s, in which the joints went from (q0, dq0) to (q1, dq1).
  void end_step(double h, const double* q0, const double* dq0, const double* q1, const double* dq1);

  /// ½ q̇ᵀ M* q̇ is that of the links; this is the rest, J. The gravity's potential is 0 for a centre of mass at W's origin.
  double kinetic_energy(const double* q);
  double potential_energy() const;
  /// Work of the wrench on the base since the start, J, and its power now, W.
  double work() const { return work_; }
  double power() const { return power_; }

 private:
  void write_outputs(const double* q, const double* dq);
  using ConstMap = Eigen::Map<const Eigen::VectorXd>;
  ConstMap joints(const double* x) const { return {x, mechanism_.n()}; }
  void attitude_at(double t);
  Eigen::Vector3d angular_velocity(const Eigen::Quaterniond& Q, const Eigen::Vector3d& spin_W, const double* q,
                                   const double* dq);
  Eigen::Quaterniond attitude() const { return {quat_[0], quat_[1], quat_[2], quat_[3]}; }
  double wrench_power() const;
  Eigen::Vector3d moment_about_centre(const Eigen::Quaterniond& Q, const Eigen::Vector3d& p_C) const;

  robot::FloatingMechanism mechanism_;
  robot::FloatingData data_;
  robot::FloatingInertia inertia_;

  std::vector<double> p0_{0, 0, 0}, quat0_{1, 0, 0, 0}, v0_{0, 0, 0}, w0_{0, 0, 0}, gravity_;  // parameters
  std::vector<double> f_{0, 0, 0}, m_{0, 0, 0};                                                // inputs
  std::vector<double> p_{0, 0, 0}, quat_{1, 0, 0, 0}, v_{0, 0, 0}, w_{0, 0, 0};                // outputs; quat: state
  std::vector<double> momentum_{0, 0, 0}, spin_{0, 0, 0};                                      // states, in W
  std::vector<double> centre_{0, 0, 0};
  double work_ = 0, power_ = 0;

  // the course within a step
  Eigen::Vector3d omega_, alpha_;  // at its beginning, in B
  Eigen::Vector3d spin_rate_;      // in W
  Eigen::Vector3d spin_B_;         // at the chosen time
  Wrench W_B_;
  Eigen::VectorXd ddq_, q_middle_, dq_middle_;
};

}  // namespace cotwin::drive_train
