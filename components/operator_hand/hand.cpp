#include "components/operator_hand/hand.h"

namespace cotwin::operator_hand {
namespace {

using numerics::Deviation;

double pull(const Hand& hand, const Deviation& x, const Deviation& x_i) {
  return hand.K * (x_i.x - x.x) + hand.D * (x_i.dx - x.dx);
}

}  // namespace

double force(const Hand& hand, double grip, const Deviation& x, const Deviation& p) {
  return grip * (hand.K_g * (x.x - p.x) + hand.D_g * (x.dx - p.dx));
}

double energy(const Hand& hand, double grip, const Deviation& x, const Deviation& x_i, const Deviation& p) {
  const double arm = x_i.x - x.x, palm = x.x - p.x;
  return 0.5 * (hand.m * x.dx * x.dx + hand.K * arm * arm + grip * hand.K_g * palm * palm);
}

Deviation advance(const Hand& hand, double grip, const Deviation& x, const Course& x_i, const Course& p, double h, Work& work) {
  const numerics::SecondOrder system{hand.m, hand.D + grip * hand.D_g, hand.K + grip * hand.K_g};
  // m ẍ + (D + g D_g) ẋ + (K + g K_g) x = u
  const auto u = [&](std::size_t k) {
    return hand.K * x_i[k].x + hand.D * x_i[k].dx + grip * (hand.K_g * p[k].x + hand.D_g * p[k].dx);
  };
  const double half = h / 2;
  const Deviation middle = numerics::advance(system, x, u(0), (u(1) - u(0)) / half, half);
  const Deviation end = numerics::advance(system, middle, u(1), (u(2) - u(1)) / half, half);
  const Deviation* at[] = {&x, &middle, &end};
  constexpr double kSimpson[] = {1. / 6, 4. / 6, 1. / 6};
  for (std::size_t k = 0; k < 3; ++k) {
    const double weight = kSimpson[k] * h, arm = x_i[k].dx - at[k]->dx, palm = at[k]->dx - p[k].dx;
    work.muscles += weight * pull(hand, *at[k], x_i[k]) * x_i[k].dx;
    work.robot += weight * force(hand, grip, *at[k], p[k]) * p[k].dx;
    work.dissipated += weight * (hand.D * arm * arm + grip * hand.D_g * palm * palm);
  }
  return end;
}

}  // namespace cotwin::operator_hand
