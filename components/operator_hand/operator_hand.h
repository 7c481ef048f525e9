#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/operator_hand/figures.h"
#include "components/operator_hand/hand.h"
#include "components/unit/delay_line.h"
#include "components/unit/joint_variables.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/trajectory/trajectory.h"

namespace cotwin::operator_hand {

/// The default of times of further grips and of releases, s.
constexpr double kNever = 1e9;

/// The hand of a person who guides a robot (VI-C):
///   intention   x_i(t) = path(t) + e: minimum-jerk moves through given points (Flash, Hogan, J. Neuroscience 5(7), 1985), and a
///               correction ė = ω_c (path − p)(t − T_r) of the lag that the person sees after the reaction delay T_r (crossover
///               model of McRuer and Jex, IEEE Trans. Human Factors in Electronics 8(3), 1967)
///   hand.h      the hand on the impedance of the arm, and its grip, which closes and opens at given times. If `relative`, the hand takes
///               the gripped point wherever it is then, and the waypoints are displacements from there
///   figures.h   force, lag and smoothness of the motion
/// Masses, dampings and stiffnesses are principal values along three perpendicular axes (the stiffness ellipsoid of
/// Mussa-Ivaldi, Hogan, Bizzi, J. Neuroscience 5(10), 1985), which do not turn.
///   moment      with the setting `moment`: m = grip (K_r φ + D_r (ω_i − ω)) along the principal axes, φ the axis times angle of the turn
///               from the gripped orientation to the intended one, exp(turn(t)) Q_start with minimum jerk. Arm and grip together; the
///               rotational inertia of the hand is neglected. Without it the hand exerts a force alone.
///
/// All vectors are in W, or in the robot's base frame if there is a robot. Without a robot the inputs are position and velocity
/// of the gripped point. With a robot they are q and dq, the gripped point is on one of its frames, and tau_e = Jᵀ f.
class OperatorHand final : public Unit {
 public:
  /// Declares the settings of the unit.
  static void declare_settings(SettingList& s);
  explicit OperatorHand(Settings& settings);
  ~OperatorHand() override;

  void declare(Variables& v) override;
  /// Throws Error for waypoints that cannot be reached in their order, axes without a direction, or values out of range.
  void initialise(Time start) override;
  /// Throws Error if reaction_delay is longer than the history.
  StepResult step(Time now, Duration h) override;

 private:
  using Vector3 = std::array<double, 3>;
  struct Gripped;  // the robot's frame that is gripped
  struct Point {
    Eigen::Vector3d p, v;
    Eigen::Quaterniond Q{1, 0, 0, 0};
    Eigen::Vector3d w = Eigen::Vector3d::Zero();
  };

  OperatorHand(Settings& settings, std::unique_ptr<Gripped> robot);
  void check();
  void update_axes();
  void update_path();
  double grip_at(double t) const;
  double stored(const Vector3& K, const Point& x_i, const Point& p) const;
  void take(Time now, Duration h, const Point& here);
  Eigen::Vector3d turned(double t, Eigen::Vector3d& rate) const;
  Point planned(double t) const;
  Point intended(double t, double since) const;
  Point point(double h);
  void correct(Time now, Duration h);
  void see(Time now);
  void write_outputs(Time now, const Point& p);
  void turn_robot(double t, const Point& p);
  Hand hand(std::size_t axis) const { return {m_h_[axis], D_h_[axis], K_h_[axis], D_g_[axis], K_g_[axis]}; }

  std::unique_ptr<Gripped> robot_;  // nullptr: p and v are inputs
  JointMeasures measures_;
  std::vector<double> q_, dq_, q_rate_, dq_rate_;  // inputs with a robot
  Vector3 p_{}, v_{}, p_rate_{}, v_rate_{};        // inputs without a robot, else outputs
  // Parameters.
  std::vector<double> waypoint_t_, waypoint_p_, waypoint_dwell_;
  std::string passing_ = "rest";
  bool relative_ = true;
  Vector3 m_h_{0.8, 0.8, 0.8}, D_h_{25, 25, 25}, K_h_{300, 300, 300};
  Vector3 D_g_{50, 50, 50}, K_g_{5000, 5000, 5000};
  std::array<double, 4> axes_{1, 0, 0, 0};
  std::vector<double> grip_t_, release_t_;
  double grip_duration_ = 0.2;
  double reaction_delay_ = 0.2, correction_ = 0, correction_max_ = 0.1, settling_ = 0;
  Vector3 offset_{};
  // Computed from the parameters.
  Eigen::Matrix3d R_ = Eigen::Matrix3d::Identity();  // columns: the principal axes
  trajectory::Path path_;
  // States.
  Vector3 x_{}, dx_{};  // the hand, along the principal axes
  Vector3 K_before_{};  // stiffness and grip of the last step
  double grip_before_ = 0;
  Vector3 origin_{}, e_{}, de_{};  // of the waypoints; correction and its rate
  std::int32_t taken_ = 0;         // grips that have begun
  DelayLine seen_;
  Work work_;
  Figures figures_;
  // Outputs.
  Vector3 f_{}, p_h_{}, v_h_{}, p_i_{}, v_i_{}, p_seen_{};
  double lag_ = 0, energy_ = 0, grip_ = 0;
  std::vector<double> tau_e_;

  // With the setting `moment`.
  bool moment_;
  std::array<double, 4> quat_{1, 0, 0, 0};  // input without a robot
  Vector3 w_{}, w_rate_{};                  // input without a robot
  std::vector<double> waypoint_turn_;       // parameter
  Vector3 K_r_{10, 10, 10}, D_r_{0.5, 0.5, 0.5};
  trajectory::Path turns_;
  std::array<double, 4> quat_start_{1, 0, 0, 0};  // state
  double work_turn_ = 0;                          // state
  Vector3 m_{};                                   // outputs
  std::array<double, 4> quat_i_{1, 0, 0, 0};
};

}  // namespace cotwin::operator_hand
