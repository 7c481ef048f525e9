#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace cotwin::trajectory {

/// A Butterworth low-pass applied to a complete recording forwards and backwards: no delay, no phase shift. At the sampling
/// rate f_s and with the order N of each pass, both passes together have the gain
///   G(f) = 1 / (1 + (√2 − 1) r^(2N)),      r = tan(π f/f_s) / tan(π f_c/f_s),
/// so that the *whole* filter has −3 dB (1/√2) at the cutoff f_c. Its roll-off is that of order 2N. Constant and linear signals
/// pass unchanged: the recording is extended beyond both ends by point reflection, for the length of the impulse response (or
/// of the recording), and each pass starts in the steady state of its first value.
class ZeroPhaseLowPass {
 public:
  /// Frequencies in Hz. Throws Error unless 0 < cutoff < rate/2 and 1 <= order <= 8.
  ZeroPhaseLowPass(double cutoff, double rate, int order);

  /// Filters samples of one signal in place.
  void apply(std::span<double> x) const;
  /// Samples after which the impulse response of a pass is below 1e-8: overlap required on both sides of a part of a recording.
  std::size_t memory() const { return memory_; }

 private:
  struct Section {  // y = b₀x + …, of second order, or of first order with b2 = a2 = 0
    double b0, b1, b2, a1, a2;
  };
  void run(std::span<double> x) const;

  double cutoff_, rate_;
  int order_;
  std::size_t memory_;  // samples
  std::vector<Section> sections_;
};

}  // namespace cotwin::trajectory
