#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"

/// The model of a joint torque:
///   τ_j = Y_j(q, q̇, q̈) π + B_j θ̈_j + τ_f,j(θ̇_j) + Σ_k a_jk sin(k q_j) + b_jk cos(k q_j)
///         + μ_j |g_j(q)| tanh(θ̇_j/v_R)
///   τ_f(v) = [τ_C + (τ_S − τ_C) e^{−|v/v_S|^δ}] tanh((v + s)/v_R) + σ2 v + τ_0
/// with inertial parameters π (2a), reflected motor inertia B (2b) and friction. All quantities are those behind the gear; θ =
/// q where the position of the motor was not measured. μ is friction that grows with the load. The load is the gravity torque g
/// of the prior, so that the term is linear. The harmonics model springs and counterbalances. For prismatic joints the units
/// are m and N.
namespace cotwin::identification {

/// The friction law that is identified. Linear parameters (τ_C, τ_S − τ_C, σ2, τ_0, B, a, b) are solved for at each candidate.
/// The others:
enum class FrictionLaw {
  kNone,     // no τ_C: only viscous friction and offset
  kCoulomb,  // v_R as given, s = 0, τ_S = τ_C: all linear
  kSigmoid,  // v_R and s are searched, τ_S = τ_C: the sigmoid k + A/(1 + e^{−α(v+s)}) with A = 2 τ_C, α = 2/v_R, k = τ_0 − τ_C
  kStribeck,  // v_S is searched, v_R as given, s = 0: the static map of LuGre
};
const char* to_text(FrictionLaw law);               // "none", "coulomb", "sigmoid", "stribeck"
FrictionLaw friction_law(const std::string& text);  // throws Error that lists the choices

/// Speeds of friction's shape (v_R, v_S, s and their bounds) are given for revolute joints, in rad/s. Those of a slide are a
/// tenth of them, in m/s, as at a pinion of 0.1 m radius.
inline double speed_scale(const robot::Joint& joint) { return joint.type == robot::JointType::kPrismatic ? 0.1 : 1; }

struct ModelOptions {
  FrictionLaw friction = FrictionLaw::kCoulomb;
  bool viscous = true;
  bool offset = true;
  bool motor_inertia = true;   // for torques of the motors; joint torque sensors do not measure B
  bool load = false;           // μ is identified
  double v_R = 0.02;           // rad/s, see speed_scale()
  double delta = 2;            // Stribeck exponent
  std::vector<int> harmonics;  // n, or empty: none; number of harmonics of q_j per joint
  std::vector<char> still;     // n, or empty: joints that stand still; only an offset is identified for them
  int speed_nodes = 40;        // kSigmoid, kStribeck: nodes of the speed grid, see TorqueData; even, at least 8
  friend bool operator==(const ModelOptions&, const ModelOptions&) = default;
};

/// The drive of one joint. Names and meaning are those of components/drive_train.
struct JointDrive {
  double tau_C = 0;  // N.m, ≥ 0
  double tau_S = 0;  // N.m, ≥ τ_C
  double v_S = 0.1;  // rad/s
  double delta = 2;
  double sigma2 = 0;              // N.m.s/rad, ≥ 0
  double tau_0 = 0;               // N.m
  double B = 0;                   // kg.m2, ≥ 0
  double v_R = 0.02;              // rad/s
  double s = 0;                   // rad/s
  double load = 0;                // μ ≥ 0, N.m per N.m of gravity
  double v_load = 0.02;           // rad/s, v_R of that term
  std::vector<double> harmonics;  // a_1, b_1, a_2, b_2, …, N.m
  friend bool operator==(const JointDrive&, const JointDrive&) = default;

  /// τ_f(v), N.m.
  double friction(double v) const;
  /// The torque of the drive without the rigid bodies. `gravity`: gravity torque of the prior, N.m; used by load friction.
  double torque(double q, double dtheta, double ddtheta, double gravity) const;
};

/// A robot's parameters: π (10n, Inertia::parameters() of body after body in their URDF frames) and drives (n).
struct Estimate {
  Eigen::VectorXd pi;
  std::vector<JointDrive> drive;
};

/// The parameters π of a robot, with drives without torque; with `urdf_friction`, σ2 and τ_C from damping and friction of its
/// <dynamics>.
Estimate estimate_of(const robot::RobotModel& robot, bool urdf_friction = false);
/// The robot with the bodies of `estimate`. Each change is added to its history with `reason`. Throws Error for bodies that are
/// not physical, such as those of the floor.
robot::RobotModel with_bodies(const robot::RobotModel& robot, const Estimate& estimate, const std::string& reason);

/// Samples in rows: the value of joint j is at [s * n + j]. rad, rad/s, rad/s², N.m (prismatic: m, …, N).
struct Samples {
  std::size_t joints = 0;
  std::vector<double> t;                // s; may be empty where time is not used
  std::vector<double> q, dq, ddq, tau;  // count x n
  std::vector<double> dtheta, ddtheta;  // count x n, or empty: the speeds of the links are used

  std::size_t count() const { return joints ? q.size() / joints : 0; }
};

/// Torques of all samples (count x n) by recursive Newton–Euler with the bodies of `estimate`, physical or not, and the drives.
/// `robot`: the one given to TorqueData; its gravity is the load of friction.
std::vector<double> torques(const robot::RobotModel& robot, const Estimate& estimate, const Samples& samples);

}  // namespace cotwin::identification
