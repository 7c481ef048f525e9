#include "models/numerics/second_order.h"

namespace cotwin::numerics {
namespace {

// The solution over a span t is affine in the start value and the input:
//   [x; ẋ](t) = (U + E) [x; ẋ](0) + Γ0 u0 + Γ1 u1
// E is stored without the unit matrix U, so that the small changes over a short span keep all digits.
struct Transition {
  double xx, xv, vx, vv;  // E
  double x0, v0;          // Γ0, response to u = 1
  double x1, v1;          // Γ1, response to u = t
};

// Taylor series of all eight from that of the impulse response of the normalised equation ẍ + 2p ẋ + w² x = δ(t):
//   x(t) = Σ a_k tᵏ/k!,   a_0 = 0,   a_1 = 1,   a_(k+2) = −2p a_(k+1) − w² a_k
// whose integrals are the responses to a step and to a ramp. For 2p t + w² t² ≤ 1/4, |a_(k+1)| tᵏ ≤ 2⁻ᵏ: there is no
// cancellation, and 12 terms are exact to the last bit.
Transition series(double two_p, double w2, double M, double t) {
  constexpr int kTerms = 12;
  double a = 0, a_next = 1;  // a_k, a_(k+1)
  double power = 1;          // tᵏ/k!
  double impulse = 0, step = 0, ramp = 0;
  for (int k = 0; k < kTerms; ++k) {
    impulse += a * power;
    step += a * power * t / (k + 1);
    ramp += a * power * t * t / ((k + 1) * (k + 2));
    const double a_after = -two_p * a_next - w2 * a;
    a = a_next;
    a_next = a_after;
    power *= t / (k + 1);
  }
  return {-w2 * step, impulse, -w2 * impulse, -two_p * impulse - w2 * step, step / M, impulse / M, ramp / M, step / M};
}

// Twice the span: the second half starts at the end of the first, with the ramp at t.
Transition doubled(const Transition& s, double t) {
  Transition d;
  d.xx = 2 * s.xx + s.xx * s.xx + s.xv * s.vx;
  d.xv = 2 * s.xv + s.xx * s.xv + s.xv * s.vv;
  d.vx = 2 * s.vx + s.vx * s.xx + s.vv * s.vx;
  d.vv = 2 * s.vv + s.vx * s.xv + s.vv * s.vv;
  d.x0 = 2 * s.x0 + s.xx * s.x0 + s.xv * s.v0;
  d.v0 = 2 * s.v0 + s.vx * s.x0 + s.vv * s.v0;
  d.x1 = 2 * s.x1 + s.xx * s.x1 + s.xv * s.v1 + t * s.x0;
  d.v1 = 2 * s.v1 + s.vx * s.x1 + s.vv * s.v1 + t * s.v0;
  return d;
}

}  // namespace

Deviation advance(const SecondOrder& system, const Deviation& start, double u0, double u1, double h) {
  const double two_p = system.D / system.M;
  const double w2 = system.S / system.M;
  int doublings = 0;
  double t = h;
  while (two_p * t + w2 * t * t > 0.25) {
    t *= 0.5;
    ++doublings;
  }
  Transition s = series(two_p, w2, system.M, t);
  for (; doublings > 0; --doublings, t *= 2) s = doubled(s, t);
  return {start.x + s.xx * start.x + s.xv * start.dx + s.x0 * u0 + s.x1 * u1,
          start.dx + s.vx * start.x + s.vv * start.dx + s.v0 * u0 + s.v1 * u1};
}

}  // namespace cotwin::numerics
