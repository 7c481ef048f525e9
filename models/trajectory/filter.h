#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace cotwin::trajectory {

/// A Butterworth low-pass that runs over a finished recording forwards and then backwards: no delay, no phase. At the rate f_s
/// and with the order N of one pass, the two passes together have the gain
///   G(f) = 1 / (1 + (√2 − 1) r^(2N)),      r = tan(π f/f_s) / tan(π f_c/f_s),
/// so that the cutoff f_c is where the *whole* filter, both passes, lets −3 dB (1/√2) through. It falls with 2N orders.
/// Constant and linear signals pass unchanged: the recording is continued beyond both ends by its own reflection through the
/// end point, for as long as the filter remembers (or the recording is long), and each pass begins in the steady state of its
/// first value.
class ZeroPhaseLowPass {
 public:
  /// Frequencies in Hz. Throws Error unless 0 < cutoff < rate/2 and 1 <= order <= 8.
  ZeroPhaseLowPass(double cutoff, double rate, int order);

  /// Filters samples of one signal in place.
  void apply(std::span<double> x) const;
  /// G(f)
  double gain(double frequency) const;
  /// Samples after which a pass has forgotten to 1e-8: what a part of a longer recording needs on either side.
  std::size_t memory() const { return memory_; }

 private:
  struct Section {  // y = b₀x + …, of second (or, with b2 = a2 = 0, of first) order
    double b0, b1, b2, a1, a2;
  };
  void run(std::span<double> x) const;

  double cutoff_, rate_;
  int order_;
  std::size_t memory_;  // samples
  std::vector<Section> sections_;
};

}  // namespace cotwin::trajectory
