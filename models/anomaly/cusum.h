#pragma once
#include <algorithm>
#include <cstdint>

namespace cotwin::anomaly {

/// Mean number of independent N(0, 1) values until a one-sided CUSUM with reference value k > 0 exceeds h ≥ 0:
///   L = (e^{2kb} − 2kb − 1) / (2k²),   b = h + 1.166            (Siegmund, Sequential Analysis, 1985, chapter II)
double run_length(double k, double h);
/// The h ≥ 0 of that run length.
double threshold(double k, double length);

/// Two one-sided cumulative sums (Page, Biometrika 41, 1954) of values whose deviation is 1: one for a rise of their mean by more than k,
/// one for a fall.
struct Cusum {
  double up = 0, down = 0;
  double up_age = 0, down_age = 0;  // values since the sum was 0

  void add(double z, double k) {
    up = std::max(0.0, up + z - k);
    down = std::max(0.0, down - z - k);
    up_age = up > 0 ? up_age + 1 : 0;
    down_age = down > 0 ? down_age + 1 : 0;
  }
  double largest() const { return std::max(up, down); }
  double age() const { return up >= down ? up_age : down_age; }
};

}  // namespace cotwin::anomaly
