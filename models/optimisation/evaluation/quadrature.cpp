#include "models/optimisation/evaluation/quadrature.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cotwin::optimisation {

Quadrature gauss_legendre(std::size_t count) {
  Quadrature rule{std::vector<double>(count), std::vector<double>(count)};
  const double n = static_cast<double>(count);
  for (std::size_t i = 0; i < count; ++i) {
    double x = std::cos(std::numbers::pi * (static_cast<double>(i) + 0.75) / (n + 0.5));
    double slope = 1;
    for (int step = 0; step < 100; ++step) {  // Newton on P_n, which converges from these starts
      double p = 1, before = 0;
      for (std::size_t k = 1; k <= count; ++k) {
        const double order = static_cast<double>(k);
        const double next = ((2 * order - 1) * x * p - (order - 1) * before) / order;
        before = p;
        p = next;
      }
      slope = n * (x * p - before) / (x * x - 1);
      const double change = p / slope;
      x -= change;
      if (std::abs(change) < 1e-15) break;
    }
    rule.s[count - 1 - i] = 0.5 * (1 + x);
    rule.w[count - 1 - i] = 1 / ((1 - x * x) * slope * slope);
  }
  return rule;
}

Quadrature gauss_panels(std::size_t panels, std::span<const double> cuts) {
  const Quadrature one = gauss_legendre(8);
  Quadrature all;
  double begin = 0;
  for (std::size_t k = 0; k <= cuts.size(); ++k) {
    const double end = k < cuts.size() ? cuts[k] : 1, length = end - begin;
    const double count = std::max(1.0, std::round(static_cast<double>(panels) * length));
    for (double panel = 0; panel < count; ++panel)
      for (std::size_t i = 0; i < 8; ++i) {
        all.s.push_back(begin + length * ((panel + one.s[i]) / count));
        all.w.push_back(length * (one.w[i] / count));
      }
    begin = end;
  }
  return all;
}

}  // namespace cotwin::optimisation
