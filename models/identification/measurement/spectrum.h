#pragma once
#include <complex>
#include <cstddef>
#include <span>
#include <vector>

namespace cotwin::measurement {

/// In-place discrete Fourier transform X_k = Σ x_i e^(−2πi·ik/N) of N values, N a power of two.
void fourier_transform(std::span<std::complex<double>> x);

/// The power spectrum of a motion: spectra of the joint velocities, averaged over windows (Welch), in memory for one window.
class MotionSpectrum {
 public:
  /// `n` joints sampled at `rate` Hz. Above 50 Hz neighbouring samples are averaged, because motion is slower.
  MotionSpectrum(std::size_t n, double rate);
  /// Adds the next positions, n. `begins`: they are not connected with the ones before.
  void add(std::span<const double> q, bool begins);
  /// Returns per joint the frequency in Hz below which `share` of the power of the velocity lies; 0 for a joint that stands
  /// still.
  std::vector<double> frequency_of_share(double share);

 private:
  void add_velocity(std::span<const double> q);
  void transform();

  std::size_t n_, decimation_, window_;
  double rate_;              // of the transformed samples, Hz
  std::vector<double> sum_;  // of the positions in a group, n
  std::size_t in_group_ = 0;
  std::vector<double> q_;  // of the last group, n
  bool has_q_ = false;
  std::vector<double> v_;      // velocities of the window, row by row
  std::vector<double> power_;  // (window/2 + 1) · n, by joint
  std::size_t windows_ = 0;
};

}  // namespace cotwin::measurement
