#pragma once
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <array>
#include <complex>

#include "components/compliance/cartesian/frame/translation.h"
#include "components/compliance/joints/second_order.h"

namespace cotwin::compliance {

/// The largest stiffness K_e of an environment with which an admittance in one direction is stable:
///   M Δ̈ + D Δ̇ + S Δ = f,   x_c = x_d + Δ,   f = −K_e x
/// An environment without damping is the worst case.
///
/// For a robot with a position controller of its own, x = T x_c with T = ω²/(s² + 2ζω s + ω²), from Routh's criterion: with a₃ = D +
/// 2ζωM, a₂ = S + 2ζωD + ω²M, a₁ = 2ζωS + ω²D
///   K_e = a₁ (a₃ a₂ − M a₁)/(a₃² ω²) − S
/// A delay d (s) of the loop (sensors, lines, sampling) makes it less: K_e = |A(jΩ)/T(jΩ)|, A = M s² + D s + S, at the Ω < √(a₁/a₃) where
/// the phase arg A − arg T + Ω d is π (or 3π, 5π …, where that is less), at most
/// that without a delay. For D = 0 it is 0.
double largest_contact_stiffness(const SecondOrder& admittance, double omega, double zeta, double delay = 0);

/// A robot of n joints that follows the compliant motion with tracking.h, linearised at rest in one position. Directions 0 to 2 are
/// the axes of translation, 3 to 5 those of rotation.
struct FollowingRobot {
  explicit FollowingRobot(int n);

  Eigen::MatrixXd M;         // of the links (n x n); with the motors where all joints are rigid
  Eigen::VectorXd B, K, D;   // of the motors and the gears (n); K = 0: rigid
  Eigen::VectorXd shaping;   // of the motor inertia (n); 1 where a joint is rigid
  Eigen::MatrixXd K_P, K_D;  // gains of tracking (n x n)
  Eigen::MatrixXd J;         // of the frame along the axes (6 x n); a row that is 0: not rendered
  Eigen::MatrixXd J_bar;     // joints for a motion of the compliant frame along the axes (n x 6)
  Eigen::VectorXd tau;       // N.m; what the motors can give beside gravity (n)
  Impedance translation, rotation;
  double bandwidth = 500;  // rad/s; of the winding-up of elastic joints
  bool feeds_wrench_forward = true;
  double step = 1e-3;  // s; torques are held for it
  double delay = 0;    // s; age of the measurements at the beginning of a step
};

/// The largest stiffness of an environment in one of six directions, for such a robot, one frequency after the other: the least
/// −1/G(jΩ) > 0 for 0.1 ≤ Ω ≤ π/step (Nyquist), G = x/f of links, motors and controller along that direction without the
/// environment, with all joints and couplings. The steps of Ω are chosen so that the phase of no G turns by more than 0.3 rad.
///
/// The measured wrench is fed forward, so the loop has only the delays of that: `delay`, half a step, because torques are held for it, and
/// 2/bandwidth of the winding-up of elastic joints. During the delays the force itself moves the links, which helps if they are
/// not heavier than M.
///
/// A push must not saturate the motors, because their contact can vibrate on then, where it would not otherwise. Of a push of kImpulse the mass M has the speed
/// v = kImpulse/M and, at the contact, the acceleration a = v √(K_e/M). With l = M_links J̄ a the motors have to give l + B J̄ a and wind up
/// the gears, B ω² l/K with ω² = K_e/M, which the smoothing by `bandwidth` makes smaller. K_e is bounded so that this is at most kTorque `tau`; the
/// rest is for the winding-up after the jump of the force.
///
/// To be a lower bound in spite of sampling, friction, gravity and motion, which are not in G: where kDelay steps more or less of delay
/// would make the phase −π, it counts as −π, and the result is kShare (1 − ρ/2) of the least |1/G|, ρ = step λ_max((B/r)⁻¹ K_D): with ρ ≥ 2 the motors vibrate without a contact. It is at most min(M, mass of the links)/step²: a contact that vibrates at more than
/// 1/step rad/s is not resolved by the steps.
class ContactSweep {
 public:
  static constexpr double kDelay = 0.1;  // steps
  static constexpr double kShare = 0.5;
  static constexpr double kImpulse = 0.06;  // N.s; pushes of translation up to this do not saturate the motors
  static constexpr double kTorque = 0.5;

  explicit ContactSweep(int n);

  /// Forgets everything.
  void reset();
  /// Evaluates G at the next frequency. Returns true where that was the last one: then `K_e_max` has been renewed.
  bool advance(const FollowingRobot& robot);

  /// ρ of the last search.
  double gain() const { return gain_of_step_; }

  // States.
  std::array<double, 6> K_e_max{};  // N/m, N.m/rad; 0: not rendered, or not known yet
  std::array<double, 6> least{};    // of the sweep that has begun
  std::array<double, 12> before{};  // −1/G at the last frequency, real and imaginary parts
  double Omega = 0;                 // rad/s; 0: a new sweep begins
  double ratio = 1;                 // of the last two frequencies

 private:
  using Complex = std::complex<double>;
  using ComplexMatrix = Eigen::MatrixXcd;
  void respond(const FollowingRobot& robot, double at);
  void finish(const FollowingRobot& robot);
  double unsaturated(const FollowingRobot& robot, Eigen::Index direction, double most);

  std::array<Complex, 6> G_{};
  ComplexMatrix x_c_, q_c_, tau_w_, drive_, gain_, motors_, links_, held_, theta_, q_;
  Eigen::PartialPivLU<ComplexMatrix> lu_;
  Eigen::LLT<Eigen::MatrixXd> llt_;
  Eigen::MatrixXd scaled_;
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen_;
  double gain_of_step_ = 0;
  Eigen::VectorXd column_;
};

}  // namespace cotwin::compliance
