#include "models/trajectory/series/filter.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::trajectory {

namespace {

using std::numbers::pi;
using std::numbers::sqrt2;

}  // namespace

ZeroPhaseLowPass::ZeroPhaseLowPass(double cutoff, double rate, int order) : cutoff_(cutoff), rate_(rate), order_(order) {
  if (!(cutoff > 0 && cutoff < rate / 2)) {
    throw Error("low-pass", "cutoff " + text::to_text(cutoff) +
                                " Hz, expected more than 0 and less than half the sampling rate of " + text::to_text(rate, 6) +
                                " Hz");
  }
  if (order < 1 || order > 8) throw Error("low-pass", "order " + std::to_string(order) + ", expected 1 to 8");
  // One pass has |H|² = 1/(1 + (tan/W)^(2N)) after the bilinear transform s = (1 − 1/z)/(1 + 1/z); two passes |H|². With this W
  // they have 1/√2 at the cutoff.
  const double W = std::tan(pi * cutoff / rate) / std::pow(sqrt2 - 1, 0.5 / order);
  for (int k = 0; k < order / 2; ++k) {
    const double damping = 2 * std::sin(pi * (2 * k + 1) / (2.0 * order));  // of the pole pair s² + damping W s + W²
    const double norm = 1 + damping * W + W * W, b = W * W / norm;
    sections_.push_back({b, 2 * b, b, 2 * (W * W - 1) / norm, (1 - damping * W + W * W) / norm});
  }
  if (order % 2 == 1) sections_.push_back({W / (1 + W), W / (1 + W), 0, (W - 1) / (1 + W), 0});
  // The slowest pole decays to 1e-8 within 18.4 time constants.
  const double decay = 2 * std::sin(pi / (2.0 * order)) * std::min(W, 1 / W);  // per sample; W > 1: slow near f_s/2
  memory_ = static_cast<std::size_t>(std::ceil(18.4 / decay)) + 1;
}

// Runs each section in transposed direct form II from its steady state at the first value.
void ZeroPhaseLowPass::run(std::span<double> x) const {
  for (const Section& c : sections_) {
    double s2 = (c.b2 - c.a2) * x[0];
    double s1 = (c.b1 - c.a1) * x[0] + s2;
    for (double& value : x) {
      const double in = value;
      const double out = c.b0 * in + s1;
      s1 = c.b1 * in - c.a1 * out + s2;
      s2 = c.b2 * in - c.a2 * out;
      value = out;
    }
  }
}

void ZeroPhaseLowPass::apply(std::span<double> x) const {
  if (x.size() < 2) return;
  const std::size_t pad = std::min(memory_, x.size() - 1), last = x.size() - 1;
  std::vector<double> padded(x.size() + 2 * pad);
  for (std::size_t i = 0; i < pad; ++i) {
    padded[i] = 2 * x[0] - x[pad - i];
    padded[pad + x.size() + i] = 2 * x[last] - x[last - 1 - i];
  }
  std::copy(x.begin(), x.end(), padded.begin() + static_cast<std::ptrdiff_t>(pad));
  run(padded);
  std::reverse(padded.begin(), padded.end());
  run(padded);
  std::copy_n(padded.rbegin() + static_cast<std::ptrdiff_t>(pad), x.size(), x.begin());
}

}  // namespace cotwin::trajectory
