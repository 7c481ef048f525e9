#pragma once
#include <cstddef>
#include <vector>

#include "components/drive_train/equations.h"
#include "components/drive_train/step_account.h"

namespace cotwin::drive_train {

/// An exponential method of order 3 for flexible transmissions. A sub-step solves the oscillation of links against motors, which
/// is linear, to rounding: its length is limited by the rest of the equations and not by the stiffness of the gears. With
/// δ = x(t) − x(0), J the Jacobian at x(0) without ∂(C q̇ + g), and f0, f1 the rates and their known slope in time:
///   δ' = J δ + f0 + f1 t + R(t)         R: what J δ + f0 + f1 t leaves of the rates
///   1. R = 0                      →  R_a at h/2
///   2. R = R_a 2 t/h              →  R_b at h/2, R_1 at h
///   3. R = parabola through 0, R_b and R_1        error: difference between 2. and 3.
/// (an exponential Runge-Kutta method, Hochbruck and Ostermann, Acta Numerica 19, 2010, section 2.3; any J gives order 3.) Each
/// of these linear equations is solved by its Taylor series in stretches of a few radians of the fastest oscillation. A term of
/// the series is one product with M⁻¹(q(0)) and no evaluation of the robot's dynamics. Since J is not inverted, negative slopes
/// of friction are in J as they are. As in Rosenbrock, M⁻¹ at the stages is that of the beginning: R = (force − inverse dynamics
/// of the predicted acceleration) M(0)⁻¹.
class Exponential {
 public:
  explicit Exponential(Equations& equations);

  /// Takes J of the forces `p` at the beginning of the next sub-step.
  void linearise(const Point& p);
  /// Upper bounds of the taken J, 1/s: of the frequency of its oscillations without damping, of its decay rates, of all its
  /// eigenvalues.
  double frequency() const { return frequency_; }
  double decay() const { return decay_; }
  double fastest() const { return fastest_; }

  /// One sub-step as Rosenbrock::attempt; linearise(p0) comes first. With `watch`, the sub-step ends at the first event that the
  /// linear part of the solution meets, even if the event function is positive again at the end of `length`, which is shortened.
  double attempt(double t, double& length, const double* x, const Tolerances& tolerances, const Point& p0, double* x1,
                 Point& p1, bool watch);
  /// State and forces in the middle of the sub-step.
  const double* middle() const { return middle_.data(); }
  const Point& middle_point() const { return middle_point_; }

 private:
  void invert_M(const Point& p);
  void bound_rates();
  template <std::size_t P>
  void term(double scale, const double* y, const double* force, double force_scale, double* out);
  template <std::size_t P>
  bool solve(double h, const double* b0, const double* b1, const double* b2, double* delta, double* half);
  bool solve(double h, const double* b0, const double* b1, const double* b2, double* delta, double* half);
  void rates(const double* delta, const double* b0, const double* b1, double t, double* out);
  void rest(double t, const double* u, const double* linear, double* R);
  void add(const double* x, const double* delta, double* u) const;
  void watch_events(double t, double s, int terms);

  Equations& equations_;
  std::size_t n_, stride_;  // joints; length of a part of the vectors below, which are padded with zeros
  // J of this sub-step: M⁻¹ by columns, slopes of the forces as in Point, 1/B (0: the motor is held)
  std::vector<double> W_, kappa_, D_, d_l_, k_l_, B_inverse_, f_w_, f_z_, z_w_, z_z_;
  double frequency_ = 0, decay_ = 0, fastest_ = 0;
  double small_speed_ = 0;  // rad/s: smaller terms end a series
  const double* x_ = nullptr;
  bool watches_ = false;
  double watch_from_ = 0, seen_ = 0;
  Point stage_, middle_point_;
  std::vector<double> factors_, padded_, b0_, b1_, ramp_, bend_, terms_, shifted_, shifted_ramp_, delta_, half_, correction_,
      half_correction_, linear_, R_a_, R_b_, R_1_;
  std::vector<double> u_, middle_, tau_, events_, events_begin_, events_end_;
};

}  // namespace cotwin::drive_train
