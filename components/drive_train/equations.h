#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "models/robot/body_parameters.h"
#include "models/robot/friction.h"
#include "models/robot/robot_model.h"

/// The equations of the drive train as an integrator sees them: forces and their derivatives at a state, the structured linear
/// system of an implicit step, energies. No clock and no memory in here.
namespace cotwin::drive_train {

/// Who moves the links: (2a) in this unit, or somebody else who gives q and q̇.
enum class Link : std::uint8_t { kInside, kOutside };
/// kRigid: θ = q, (2a) and (2b) summed.
enum class Transmission : std::uint8_t { kFlexible, kRigid };
/// The motor's friction τ_f in (2b).
enum class Friction : std::uint8_t { kLugre, kElastoPlastic, kCoulomb, kSmooth };

/// Per joint; names, meaning and units of measure as declared by the unit.
struct Parameters {
  explicit Parameters(std::size_t n);
  std::vector<double> K, B, D, backlash;
  std::vector<double> sigma0, sigma1, sigma2, tau_C, tau_S, v_S, delta, breakaway, tau_0;
  std::vector<double> link_tau_C, link_sigma2, link_tau_0, link_v_R, link_A, link_alpha, link_s, link_k;
  std::vector<double> v_R, link_tau_S, link_v_S, link_delta, link_load, link_v_load;
  std::vector<double> spring_sin, spring_cos;  // robot::Harmonics::kMost per joint
  std::vector<double> q_min, q_max, stop_stiffness, stop_restitution;
};

/// What comes from outside over one communication step, with t counted from its start: torques linear in t, and where the link
/// is outside q as a cubic polynomial (index: power · n + joint).
struct Course {
  explicit Course(std::size_t n);
  std::vector<double> tau_m, dtau_m, tau_e, dtau_e;
  std::vector<double> link;
};

/// The discrete part of the state, per joint. Assigned in place: the storage of declared variables stays where it is.
struct Modes {
  explicit Modes(std::size_t n);
  void clear();
  std::vector<std::int32_t> slip;  // of Friction::kCoulomb: 0 sticks, ±1 slips in that direction
  std::vector<std::int32_t> stop;  // −1 or +1 while the link is in its lower or upper stop, else 0
  std::vector<double> impact;      // rad/s, speed at which it came there
};

/// Everything that depends on the state (q, q̇, θ, θ̇, z) and on nothing else, so that it can be kept from one step to the next.
/// Forces here are without τ_m and τ_e. All n long, M n x n.
struct Point {
  explicit Point(std::size_t n);
  std::vector<double> tau_J, tau_f;  // (2c), (2b)
  std::vector<double> force;         // on the link: τ_J (flexible) or −τ_f (rigid), link friction, stop; without C q̇ + g
  std::vector<double> motor_force;   // on the motor: −τ_J − τ_f
  std::vector<double> dz;            // ż
  std::vector<double> kappa;         // ∂τ_J/∂θ
  std::vector<double> f_w, f_z, z_w, z_z;  // ∂τ_f/∂θ̇, ∂τ_f/∂z, ∂ż/∂θ̇, ∂ż/∂z
  std::vector<double> d_l, k_l;            // −∂force/∂q̇, −∂force/∂q of link friction, springs and stop
  std::vector<double> load;                // N.m: link_load |g|, height of the friction that grows with the load
  std::vector<double> M, h;                // M(q) of (2a), with B on its diagonal if rigid; C q̇ + g
};

/// Energies in J and what flows, of one state.
struct Energies {
  double kinetic = 0, potential = 0, elastic = 0;
};

class Equations {
 public:
  /// `robot` may be null where the link is outside; n counts the joints.
  Equations(const robot::RobotModel* robot, std::size_t n, Link link, Transmission transmission, Friction friction);
  ~Equations();

  std::size_t n() const { return n_; }
  /// Length of a state x = (q | q̇ | θ | θ̇ | z), five times n whatever the variant: what a variant does not have stays as it is.
  std::size_t size() const { return 5 * n_; }
  bool inside() const { return link_ == Link::kInside; }
  bool flexible() const { return transmission_ == Transmission::kFlexible; }
  Friction friction() const { return friction_; }
  bool has_bristles() const { return friction_ == Friction::kLugre || friction_ == Friction::kElastoPlastic; }

  /// The unit writes here; the per-joint models are made of them by adopt_parameters().
  Parameters& parameters() { return parameters_; }
  const Parameters& parameters() const { return parameters_; }
  void adopt_parameters();
  const robot::Torsion& torsion(std::size_t i) const { return torsion_[i]; }
  const robot::Bristle& bristle(std::size_t i) const { return bristle_[i]; }
  Modes& modes() { return modes_; }
  Course& course() { return course_; }
  const Course& course() const { return course_; }
  const Modes& modes() const { return modes_; }
  bool has_stops() const { return has_stops_; }
  bool has_load() const { return has_load_; }
  /// The links' inertial parameters; link inside. follow_bodies() tells whether anything changed.
  robot::BodyParameters& bodies();
  void take_bodies(const std::string& place);
  bool follow_bodies(const std::string& place, double remaining);
  void restored_bodies();

  double motor_torque(std::size_t i, double t) const { return course_.tau_m[i] + course_.dtau_m[i] * t; }
  /// True for a motor that Coulomb friction holds.
  bool stuck(std::size_t i) const { return friction_ == Friction::kCoulomb && modes_.slip[i] == 0; }

  /// Link outside: writes q, q̇ of the course at time t into x. Link inside: nothing.
  void prescribe(double t, double* x) const;
  /// Brings bristle deflections back to |z| ≤ τ_S / σ0, which no exact solution leaves: an approximate one that does makes
  /// torques without bound.
  void confine_bristles(double* x) const;
  /// Forces, their derivatives, M and h.
  void evaluate(const double* x, Point& p);
  /// The same without M and h.
  void evaluate_joints(const double* x, Point& p) const;
  /// M(q) a + C q̇ + g by inverse dynamics, plus B a if rigid.
  void inverse_dynamics(const double* x, const double* a, double* tau);
  /// ẋ at (t, x) from p, which was evaluated there.
  void derivative(double t, const double* x, const Point& p, double* dx);
  /// q̈ from the forces of p.
  void acceleration(double t, const Point& p, double* ddq);
  /// ∂(M a + C q̇ + g)/∂q and /∂q̇ at fixed a (n x n, by columns). Link inside.
  void inverse_dynamics_derivatives(const double* x, const double* a, double* by_q, double* by_dq);
  /// ∂T/∂q = Cᵀ q̇ of the links' kinetic energy T = ½ q̇ᵀ M q̇ (Ṁ = C + Cᵀ), and g = ∂U/∂q. Link inside.
  void energy_gradients(const double* x, double* kinetic_by_q, double* potential_by_q);

  /// Makes the factors of W = I − γ J at p. J has all stiff terms (springs, friction, stops) exactly, and leaves out ∂(C q̇ + g)
  /// and what would make W indefinite (negative slopes of friction). z, θ and the motors are eliminated by hand: what remains
  /// is n x n,
  ///   M + diag(γ e (B + γ d_f)/P + γ (d_l + γ k_l)),   e = D + γ κ,   P = B + γ (e + d_f)
  /// symmetric and positive definite. Stuck motors have P = ∞.
  void factorise(const Point& p, double gamma);
  /// Solves W k = b with the last factors; the speeds' rows of b are given as M b and B b. k may be b.
  void solve(const double* b, double* k) const;
  /// y = M x (n) for a Point's M.
  void times_M(const double* M, const double* x, double* y) const;
  /// Power lost in friction, damping and stops, W. Never negative for friction that opposes the motion: constant torques are
  /// not in here.
  double dissipation(const double* x, const Point& p) const;
  /// Work, J, that the constant part of friction takes up on the way between two states (q | q̇ | θ | …): τ_0 of the motors, and
  /// with the link inside link_tau_0 and the sigmoid's torque at rest. It comes back on the way back, so it is no loss.
  double work_of_constant_friction(const double* from, const double* to) const;
  Energies energies(const double* x, const Point& p);
  /// ∂(friction that grows with the load)/∂q of all links at x (n x n, by columns); `scratch`: n x n. Link inside.
  void load_derivatives(const double* x, const Point& p, double* by_q, double* scratch);
  /// Torque of joint i's springs, N.m.
  double spring_torque(std::size_t i, double q) const { return has_springs_ ? spring_[i].at(q).torque : 0; }
  /// k δ of joint i's stop, N.m; 0 outside of it.
  double stop_spring(std::size_t i, double q) const;

 private:
  robot::StopTorque stop(std::size_t i, double q, double dq) const;
  double link_drive(std::size_t i, double t) const;
  robot::CoulombViscous load_friction(std::size_t i, double gravity) const;

  std::size_t n_;
  Link link_;
  Transmission transmission_;
  Friction friction_;
  Parameters parameters_;
  Modes modes_;
  Course course_;
  bool has_stops_ = false;
  bool has_link_sigmoid_ = false;
  bool has_link_coulomb_ = false;
  bool has_load_ = false;
  bool has_springs_ = false;
  std::vector<robot::Torsion> torsion_;
  std::vector<robot::Bristle> bristle_;
  std::vector<robot::CoulombViscous> motor_friction_, link_friction_;
  std::vector<robot::Harmonics> spring_;
  std::vector<robot::Sigmoid> link_sigmoid_;
  std::vector<double> stop_damping_, z_most_;

  struct Dynamics;  // Mechanism and Data
  std::unique_ptr<Dynamics> dynamics_;

  // factors of W
  double gamma_ = 0;
  std::vector<double> L_;  // n x n: L of L D Lᵀ below the diagonal, 1/D on it
  std::vector<double> kappa_, ratio_, P_inverse_, f_z_, z_w_, z_inverse_, k_l_;
  std::vector<double> scratch_;
};

}  // namespace cotwin::drive_train
