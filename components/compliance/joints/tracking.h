#pragma once
#include <Eigen/Core>
#include <vector>

#include "components/compliance/joints/link_dynamics.h"
#include "models/robot/drives/drive_parameters.h"

#include "models/robot/robot_model.h"

namespace cotwin::compliance {

using Joints = std::vector<double>;  // one value per joint

/// The motion to be tracked, at the end of a step, with its mean acceleration over the step.
struct Reference {
  const Joints &q_c, &dq_c, &ddq_c, &mean_ddq_c;
};

/// Torques on the links in the reference motion beside M q̈ + C q̇ + g: friction and springs of the link side less the external
/// torque.
struct Load {
  const Joints &mean, &end;  // over the step, at its end
};

/// Parameters of the motion of θ_c after a jump of the torque, in elastic joints.
struct WindingUp {
  double bandwidth;      // rad/s
  const Joints& torque;  // N.m; bound of the motor torque for it beyond τ_J,c; 0: no bound
};

struct Measured {
  const Joints &q, &dq, &theta, &dtheta;  // at the beginning of the step
};

struct Gains {
  const Joints &omega, &zeta;  // computed torque
  const Joints &Lambda, &K_s;  // passivity-based
  const Joints& shaping;       // of the motors of elastic joints
  double passivity = 0;        // the weight of the latter, 0 … 1
};

/// The motor torques with which a robot tracks a reference (IV-A3).
///
/// Drives with K = 0 are rigid. The springs of the links count with gravity in g.
///
/// A robot without elastic joints, e = q_c − q (passivity p = 0 and 1):
///   τ_m = M (q̈_c + 2ζω ė + ω² e) + B (θ̈_c + 2ζω ė + ω² e) + C q̇ + g − τ_e
///   τ_m = M q̈_r + B θ̈_r + C q̇_r + g − τ_e + K_s s,   q̇_r = q̇ + s,   s = ė + Λ e,   q̈_r = q̈_c + Λ ė
/// with Ṁ − 2C skew-symmetric. The first leaves ë + 2ζω ė + ω² e = 0 in each joint, the second has the Lyapunov function
/// ½ sᵀ M s + eᵀ Λ K_s e (Slotine and Li, IJRR 6(3), 1987).
///
/// A robot with elastic joints: feedback of a link behind a spring is unstable from small gains on, so the motors are fed back,
/// e = θ_c − θ (in rigid joints e = q_c − q), around
///   θ_c = q_c + τ_w/K,   τ_w: τ_J,c smoothed,   τ_J,c = M q̈_c + C q̇_c + g − τ_e  at q_c                 (2a), (2c)
/// with the control law
///   u = (B/r) θ̈_c + τ_w + K_P e + K_D ė + g(q̄) − g(q_c)
///   τ_m = r u − (r − 1) τ_J,   τ_J = K (θ − q)                       so that (B/r) θ̈ + τ_J = u by (2b)
///   K_P = (1 − p) Ω (M + B) Ω + p K_s Λ                      Ω = diag ω, Z = diag ζ, M = M(q_c)
///   K_D = (1 − p) 2 √(Z Ω) (M + B) √(Z Ω) + p (K_s + √Λ (M + B) √Λ)
/// with the motor inertia shaped by r (Ott, Albu-Schäffer, Kugi, Hirzinger, IEEE T-RO 24(2), 2008). q̄ is the position of the
/// links at rest for the given motor positions. Both gain matrices are symmetric and positive definite, for equal gains those
/// of the rigid law.
///
/// Stability in continuous time, for a reference at rest, any ω, ζ (Λ, K_s) > 0, p, r ≥ 1, B > 0 and K > −2 ∂g/∂q: the links
/// and motors come to rest at q_c, θ_c. Proof in docs/equations.md. With a torque that is held for h, ‖(B/r)⁻¹ K_D‖ h < 2 is
/// needed in addition: for one joint ζ ω h (M + B) r/B < 1 behind a soft spring.
class Tracking {
 public:
  explicit Tracking(const robot::RobotModel& robot);

  /// Motor reference at rest at `reference`: the start.
  void start(LinkDynamics& links, const Reference& reference, const Load& load, const robot::DriveParameters& drives);
  /// Motor reference at the end of a step of h seconds.
  void refer(LinkDynamics& links, const Reference& reference, const Load& load, const robot::DriveParameters& drives,
             const WindingUp& winding_up, double h);
  /// The tracking error at the beginning of a step: before refer().
  void update_error(const Measured& measured, const robot::DriveParameters& drives);
  /// The motor torque over the step, without friction of the motors, into `tau_m`. After refer().
  void torque(LinkDynamics& links, const Reference& reference, const Load& load, const robot::DriveParameters& drives,
              const Measured& measured, const Gains& gains, double h, Joints& tau_m);

  // States.
  Joints theta_c, dtheta_c;  // rad, rad/s; where the motors should be
  Joints tau_w, dtau_w;      // N.m, N.m/s; τ_J,c, smoothed
  // Results of refer().
  Joints tau_c;  // N.m; τ_J,c at the end of the step

 private:
  void update_loads(LinkDynamics& links, const Reference& reference, const robot::DriveParameters& drives);
  void add_springs(const robot::DriveParameters& drives, const Eigen::VectorXd& at, Eigen::VectorXd& torque) const;
  void wind_up(std::size_t i, double tau, const robot::DriveParameters& drives, const WindingUp& winding_up, double h,
               double left);
  void torque_of_rigid(LinkDynamics& links, const Reference& reference, const Load& load, const robot::DriveParameters& drives,
                       const Measured& measured, const Gains& gains, double h, Joints& tau_m);
  void torque_of_elastic(LinkDynamics& links, const robot::DriveParameters& drives, const Measured& measured,
                         const Gains& gains, Joints& tau_m);

  std::size_t n_;
  // Handed from one phase of a step to the next.
  bool elastic_ = false;              // any joint is
  bool sprung_ = false;               // any link has a spring
  Joints e_, de_;                     // at the beginning of the step
  bool at_error_ = false;             // g_ is that at q_ − e_
  Joints tau_w_before_, tau_w_mean_;  // τ_w at the beginning of the step and its mean over it
  Joints a_theta_;                    // mean of θ̈_c over the step
  /// Four states by row: the reference at the end of the step, in its middle, there at rest, and this less e_.
  struct States {
    explicit States(Eigen::Index n) : q(LinkDynamics::States::Zero(4, n)), dq(q), a(q), tau(q) {}
    LinkDynamics::States q, dq, a, tau;
  } states_;
  Eigen::MatrixXd M_;  // of the reference in the middle of the step, with the motors' B
  // Scratch.
  Eigen::MatrixXd C_;
  Eigen::VectorXd q_, dq_, v_, s_, tau_, g_, g_c_;
};

}  // namespace cotwin::compliance
