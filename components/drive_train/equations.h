#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "models/robot/body_parameters.h"
#include "models/robot/drives/drive_parameters.h"
#include "models/robot/drives/friction.h"
#include "models/robot/robot_model.h"

/// The equations of the drive train for an integrator: forces and their derivatives at a state, the structured linear system of
/// an implicit step, energies. Only the modes of exact sticking and of stops persist between calls.
namespace cotwin::drive_train {

class FloatingLinks;

/// Where the links are moved: (2a) in this unit, or in another unit that gives q and q̇.
enum class LinkSide : std::uint8_t { kInside, kOutside };
/// kRigid: θ = q, (2a) and (2b) summed.
enum class Transmission : std::uint8_t { kFlexible, kRigid };
/// kFloating: the base moves freely, and M* and b* (models/robot/floating_base.h) replace M and C q̇ + g; link inside.
enum class Base : std::uint8_t { kFixed, kFloating };
/// The motor's friction τ_f in (2b).
enum class Friction : std::uint8_t { kLugre, kElastoPlastic, kCoulomb, kSmooth };

/// The parameters of the drives and of the hard stops of the links, described by robot::kDriveParameters and kStopParameters.
struct Parameters : robot::DriveParameters {
  explicit Parameters(std::size_t joints);
  std::vector<double> q_min, q_max, stop_stiffness, stop_restitution;
};

inline constexpr auto kStopParameters = [] {
  using P = Parameters;
  using Row = ParameterRow<P>;
  return std::to_array<Row>({
      {"q_min", &P::q_min, "rad", "lower joint limit, of the stop", -Row::kNoLimit},
      {"q_max", &P::q_max, "rad", "upper joint limit, of the stop", Row::kNoLimit},
      {"stop_stiffness", &P::stop_stiffness, "N.m/rad",
       "of the stops at both limits; 0 for none; default: the largest torque presses the joint 0.01 rad (0.01 m) into the stop",
       0, 0, Row::kLargest},
      {"stop_restitution", &P::stop_restitution, "1", "speed after over before an impact of a free link on its stop", 0.5, 0.01,
       1},
  });
}();

/// The inputs over one communication step as functions of the time t since its start: torques linear in t; with the link
/// outside, q as a cubic polynomial (index: power · n + joint).
struct Course {
  explicit Course(std::size_t n);
  std::vector<double> tau_m, dtau_m, tau_e, dtau_e;
  std::vector<double> link;
};

/// The discrete part of the state, per joint. Assigned in place: the unit declares this storage.
struct Modes {
  explicit Modes(std::size_t n);
  void clear();
  std::vector<std::int32_t> slip;  // of Friction::kCoulomb: 0 sticks, ±1 slips in that direction
  std::vector<std::int32_t> stop;  // −1 or +1 while the link is in its lower or upper stop, else 0
  std::vector<double> impact;      // rad/s, speed of the impact
};

/// All quantities that depend only on the state (q, q̇, θ, θ̇, z), hence valid until the state changes. Forces are without τ_m
/// and τ_e. All n long, M n x n.
struct Point {
  explicit Point(std::size_t n);
  std::vector<double> tau_J, tau_f;  // (2c), (2b)
  std::vector<double> force;         // on the link: τ_J (flexible) or −τ_f (rigid), link friction, stop; without C q̇ + g
  std::vector<double> motor_force;   // on the motor: −τ_J − τ_f
  std::vector<double> dz;            // ż
  std::vector<double> kappa;         // ∂τ_J/∂θ
  std::vector<double> f_w, f_z, z_w, z_z;  // ∂τ_f/∂θ̇, ∂τ_f/∂z, ∂ż/∂θ̇, ∂ż/∂z
  std::vector<double> d_l, k_l;            // −∂force/∂q̇, −∂force/∂q of link friction, springs and stop
  std::vector<double> gravity;             // N.m: g(q), only where has_load()
  std::vector<double> M, h;                // M(q) of (2a), with B on its diagonal if rigid; C q̇ + g
};

/// The terms of (2a) at one state, N.m, n long each; with a floating base those of M* and b*.
struct TorqueTerms {
  TorqueTerms() = default;
  explicit TorqueTerms(std::size_t n);
  std::vector<double> inertia;   // M q̈
  std::vector<double> coriolis;  // C q̇
  std::vector<double> gravity;   // g
  std::vector<double> link;      // τ_l + τ_s: friction, springs and stops of the link
};

/// Energies of one state, J.
struct Energies {
  double kinetic = 0, potential = 0, elastic = 0;
};

class Equations {
 public:
  /// `robot` may be null where the link is outside; n counts the joints.
  Equations(const robot::RobotModel* robot, std::size_t n, LinkSide link, Transmission transmission, Friction friction,
            Base base = Base::kFixed);
  ~Equations();

  std::size_t n() const { return n_; }
  /// Length of a state x = (q | q̇ | θ | θ̇ | z), 5 n for every variant. Rows that a variant does not have stay constant.
  std::size_t size() const { return 5 * n_; }
  bool inside() const { return link_ == LinkSide::kInside; }
  bool flexible() const { return transmission_ == Transmission::kFlexible; }
  Friction friction() const { return friction_; }
  bool has_bristles() const { return friction_ == Friction::kLugre || friction_ == Friction::kElastoPlastic; }

  /// The parameters in force. adopt_parameters() makes the models of the joints of them.
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
  /// The links' inertial parameters; link inside. follow_bodies() returns whether anything changed.
  robot::BodyParameters& bodies();
  void update_bodies(const std::string& place);
  bool follow_bodies(const std::string& place, double remaining);
  void restored_bodies();

  /// Inertia that bodies outside of this unit add to M (n x n, symmetric, by columns), within a step; link inside. Theirs are not among
  /// the energies and torque terms.
  std::span<const double> load() const { return load_; }
  bool loaded() const { return loaded_; }
  /// Sets it to Fᵀ F (F: n x n, by rows).
  void set_load(std::span<const double> factor);
  /// ½ q̇ᵀ L q̇ of the load's inertia L, J.
  double load_energy(const double* dq) const;

  /// The base of base=floating, else null. begin_base() and end_base() are to be called before and after the solver's step.
  FloatingLinks* floating() const { return floating_.get(); }
  void begin_base(const double* x);
  void end_base(double h, const double* x0, const double* x1);

  /// τ_m and τ_e of the course at time t.
  double motor_torque(std::size_t i, double t) const { return course_.tau_m[i] + course_.dtau_m[i] * t; }
  double external_torque(std::size_t i, double t) const { return course_.tau_e[i] + course_.dtau_e[i] * t; }

  /// M q̈ = τ_J − τ_l − τ_s + τ_e − (C q̇ + g)                                                       (2a)
  /// of link i; with a rigid transmission (M + B) q̈, and τ_m − τ_f in place of τ_J. `bias` is C q̇ + g, or M a + C q̇ + g for the
  /// torque that accelerates the link beyond a.
  double link_balance(const Point& p, std::size_t i, double tau_e, double tau_m, double bias) const {
    return p.force[i] + (flexible() ? tau_e : tau_e + tau_m) - bias;
  }
  double link_balance(const Point& p, std::size_t i, double t, double bias) const {
    return link_balance(p, i, external_torque(i, t), motor_torque(i, t), bias);
  }
  /// B θ̈ = τ_m − τ_J − τ_f                                                                        (2b)
  double motor_balance(const Point& p, std::size_t i, double tau_m) const { return tau_m + p.motor_force[i]; }
  /// τ_J = K d(φ) + D φ̇ with the torsion φ = θ − q, and ∂τ_J/∂φ                                       (2c)
  robot::TorqueAndSlope joint_torque(std::size_t i, double phi, double dphi) const {
    robot::TorqueAndSlope spring = torsion_[i].at(phi);
    spring.torque += parameters_.D[i] * dphi;
    return spring;
  }

  /// True for a joint without a motor: nothing drives it but its link.
  bool passive(std::size_t i) const { return passive_[i] != 0; }
  /// True for a motor that Coulomb friction holds.
  bool stuck(std::size_t i) const { return friction_ == Friction::kCoulomb && modes_.slip[i] == 0; }

  /// Link outside: writes q, q̇ of the course at time t into x. Base floating: the following functions take the base at time t.
  /// Otherwise nothing.
  void prescribe(double t, double* x) const;
  /// Clamps bristle deflections to |z| ≤ τ_S / σ0, the range of exact solutions: larger deflections of an approximate solution
  /// would give unbounded torques.
  void confine_bristles(double* x) const;
  /// Forces, their derivatives, M and h.
  void evaluate(const double* x, Point& p);
  /// The same without M and h.
  void evaluate_joints(const double* x, Point& p) const;
  /// M(q) a + C q̇ + g by inverse dynamics, plus B a if rigid.
  void inverse_dynamics(const double* x, const double* a, double* tau);
  /// Splits (2a) at x and its point p, with the acceleration q̈. Link inside.
  void torque_terms(const double* x, const Point& p, const double* ddq, TorqueTerms& terms);
  /// ẋ at (t, x) from p, which was evaluated there.
  void derivative(double t, const double* x, const Point& p, double* dx);
  /// q̈ from the forces of p.
  void acceleration(double t, const Point& p, double* ddq);
  /// ∂(M a + C q̇ + g)/∂q and /∂q̇ at fixed a (n x n, by columns). Link inside.
  void inverse_dynamics_derivatives(const double* x, const double* a, double* by_q, double* by_dq);
  /// ∂T/∂q = Cᵀ q̇ of the links' kinetic energy T = ½ q̇ᵀ M q̇ (Ṁ = C + Cᵀ), and g = ∂U/∂q. Link inside.
  void energy_gradients(const double* x, double* kinetic_by_q, double* potential_by_q);

  /// Factorises W = I − γ J at p. J has all stiff terms (springs, friction, stops) exactly; ∂(C q̇ + g) and terms that would
  /// make W indefinite (negative slopes of friction) are left out. z, θ and the motors are eliminated by hand; the remaining
  /// n x n matrix
  ///   M + diag(γ e (B + γ d_f)/P + γ (d_l + γ k_l)),   e = D + γ κ,   P = B + γ (e + d_f)
  /// is symmetric and positive definite. Stuck motors have P = ∞.
  void factorise(const Point& p, double gamma);
  /// Solves W k = b with the last factors; the speeds' rows of b are given as M b and B b. k may be b.
  void solve(const double* b, double* k) const;
  /// y = M x (n) for a Point's M, or load().
  void times_M(const double* M, const double* x, double* y) const;
  /// Power lost in friction, damping and stops, W, without constant friction: not negative for friction that opposes the
  /// motion.
  double dissipation(const double* x, const Point& p) const;
  /// Work that the constant part of friction takes up between two states (q | q̇ | θ | …), J: τ_0 of the motors and, with the
  /// link inside, LinkSideParameters::constant(). It is given back on the way back, hence not a loss.
  double work_of_constant_friction(const double* from, const double* to) const;
  Energies energies(const double* x, const Point& p);
  /// ∂(friction that grows with the load)/∂q of all links at x (n x n, by columns); `scratch`: n x n. Link inside.
  void load_derivatives(const double* x, const Point& p, double* by_q, double* scratch);
  const robot::LinkSideParameters& link_side(std::size_t i) const { return link_side_[i]; }
  /// k δ of joint i's stop, N.m; 0 outside of it.
  double stop_spring(std::size_t i, double q) const;

 private:
  robot::StopTorque stop(std::size_t i, double q, double dq) const;
  double stop_depth(std::size_t i, double q) const;

  std::size_t n_;
  LinkSide link_;
  Transmission transmission_;
  Friction friction_;
  Parameters parameters_;
  Modes modes_;
  Course course_;
  std::vector<char> passive_;
  bool has_stops_ = false;
  bool has_load_ = false;
  std::vector<robot::Torsion> torsion_;
  std::vector<robot::Bristle> bristle_;
  std::vector<robot::CoulombViscous> motor_friction_;
  std::vector<robot::LinkSideParameters> link_side_;
  std::vector<double> stop_damping_, z_most_;

  struct Dynamics;  // Mechanism and Data
  std::unique_ptr<Dynamics> dynamics_;
  std::vector<double> load_;
  bool loaded_ = false;
  std::unique_ptr<FloatingLinks> floating_;
  std::unique_ptr<Point> base_point_;  // scratch of begin_base

  // factors of W
  double gamma_ = 0;
  std::vector<double> L_;  // n x n: L of L D Lᵀ below the diagonal, 1/D on it
  std::vector<double> kappa_, ratio_, P_inverse_, f_z_, z_w_, z_inverse_, k_l_;
  std::vector<double> scratch_;
};

}  // namespace cotwin::drive_train
