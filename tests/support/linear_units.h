#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit.h"
#include "components/unit/unit_table.h"

/// Linear units that are stepped exactly, and the exact motion of the systems that they form: what is left of an error in a run
/// is an error of the coupling.
namespace cotwin::testing {

/// A scalar input or output of a LinearUnit.
struct LinearPort {
  std::string name;
  std::string si;
  std::string description;
  std::string derivative_of;  // of an output: name of an output before it; else empty
};

struct LinearSystem {
  Eigen::MatrixXd A, B, C, D;  // ẋ = A x + B u, y = C x + D u
  Eigen::VectorXd x0;          // x at the start, unless the parameter x0 is set
  std::vector<LinearPort> inputs, outputs;
};

struct LinearOptions {
  bool held = false;      // inputs are constant over a step; else they follow their rate linearly
  bool partials = false;  // the unit has an analytic Jacobian: ∂y/∂u = D, ∂y/∂x = C
};

/// ẋ = A x + B u, y = C x + D u. A step is exact for u(now + s) = u + s u̇. With a state there are the parameter `x0` and the
/// state `x`, vectors whose elements have the measures of the equations. The first step of a length allocates; a step of one of
/// the last eight lengths does not.
class LinearUnit final : public Unit {
 public:
  /// Throws Error if the sizes of the matrices and lists do not fit.
  LinearUnit(LinearSystem system, LinearOptions options);
  void declare(Variables& v) override;
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  std::span<const Partial> partials() const override { return partials_; }
  void evaluate_partials(std::span<double> values) override;
  /// The calls of step() so far, also of steps that the master has taken back: it is no variable, so that snapshots do not
  /// restore it.
  std::int64_t steps() const { return steps_; }

 private:
  /// x(now + h) = Phi x + G u + G_rate u̇
  struct Propagator {
    std::int64_t ns = 0;  // h; 0: none
    Eigen::MatrixXd Phi, G, G_rate;
  };
  const Propagator& propagator(Duration h);
  void output(double s);

  const LinearSystem system_;
  const LinearOptions options_;
  Eigen::VectorXd x0_, x_, x_next_, u_, du_, u_end_, y_;
  std::array<Propagator, 8> cache_;
  std::size_t oldest_ = 0;
  std::vector<Partial> partials_;
  std::int64_t steps_ = 0;
};

/// The units below as types of scenarios. Those of class LinearUnit have the settings `held` and `partials` (LinearOptions);
/// all but lc_mass, lc_spring and lag have `derivatives` (false): speeds are declared as derivatives of positions, dy as that
/// of y.
///   lc_mass     in F, out v: m v̇ = −F; v(0) = 1                      setting m = 1
///   lc_spring   in v, out F: ẋ = v, F = k x; x(0) = 0                 setting k = 100
///     With lc_mass: v = cos(ωt), F = k/ω sin(ωt), ω² = k/m. The power F·v leaves the mass and enters the spring.
///   two_mass_1  in F, out x1, v1: side 1 of two_masses()
///   two_mass_2  in x1, v1, out F, x2, v2: side 2 with the spring between the sides
///   contact_1, contact_2   the same of contact(kc)                    setting kc = 1e6 (of contact_2)
///   lag         in u, out y: ẏ = (u − y)/T; y(0) = 0                  setting T = 1
///   clock       out y = t                                             with `derivatives`: dy = 1
///   cosine      out y = cos(2πt/T), parameter T = 1 s                 with `derivatives`: dy
///   jump        out y = 0 before parameter t0 = 1 s, 1 from then on
std::span<const UnitType> linear_types();

/// Two bodies on springs and dampers to the ground, and a spring and damper between them:
///   m1 ẍ1 = −c1 x1 − d1 ẋ1 + F,  m2 ẍ2 = −c2 x2 − d2 ẋ2 − F,  F = ck (x2 − x1) + dk (ẋ2 − ẋ1)
/// Masses in kg, c in N/m, d in N.s/m, x in m, v in m/s.
struct TwoBodies {
  double m1 = 0, c1 = 0, d1 = 0;
  double m2 = 0, c2 = 0, d2 = 0;
  double ck = 0, dk = 0;
  double x1 = 0, v1 = 0, x2 = 0, v2 = 0;  // at t = 0
};
/// The two-mass oscillator, the usual example for couplings by force and displacement.
TwoBodies two_masses();
/// A damped body in contact with a light one on a stiff spring; contact stiffness kc in N/m.
TwoBodies contact(double kc);

/// x1, v1, x2, v2 at time t (s) from a matrix exponential of the whole system; no code in common with LinearUnit.
Eigen::Vector4d coupled_reference(const TwoBodies& bodies, double t);

}  // namespace cotwin::testing
