#include "models/identification/excitation/fourier.h"

#include <cmath>
#include <numbers>

namespace cotwin::excitation {

double FourierSeries::omega() const { return 2 * std::numbers::pi / period; }

FourierSeries::State FourierSeries::at(std::size_t j, double t) const {
  State state{q_start[j], 0, 0};
  const double w = omega();
  for (std::size_t l = 0; l < harmonics; ++l) {
    const double rate = w * static_cast<double>(l + 1), phase = rate * t;
    const double c = std::cos(phase), s = std::sin(phase);
    const double al = a[j * harmonics + l], bl = b[j * harmonics + l];
    state.q += al / rate * s + bl / rate * (1 - c);
    state.dq += al * c + bl * s;
    state.ddq += rate * (bl * c - al * s);
  }
  return state;
}

void bring_to_rest(std::span<double> a, std::span<double> b) {
  const std::size_t L = a.size();
  double mean = 0, along = 0, squares = 0;
  for (std::size_t l = 0; l < L; ++l) {
    const double number = static_cast<double>(l + 1);
    mean += a[l] / static_cast<double>(L);
    along += number * b[l];
    squares += number * number;
  }
  for (std::size_t l = 0; l < L; ++l) {
    a[l] -= mean;
    b[l] -= along / squares * static_cast<double>(l + 1);
  }
}

}  // namespace cotwin::excitation
