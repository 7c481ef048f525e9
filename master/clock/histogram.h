#pragma once
#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace cotwin::master {

/// Counts of durations in fixed bins, four per octave from 1.024 µs to 1.07 s, with one bin below and one above. Adding allocates
/// nothing.
class Histogram {
 public:
  static constexpr std::size_t kBins = 82;

  void add(std::int64_t ns) {
    ++counts_[bin_of(ns)];
    ++count_;
    max_ = std::max(max_, ns);
    sum_ += static_cast<double>(ns);
  }
  /// Upper edge of a bin, ns; that of the last one is the largest number.
  static constexpr std::int64_t edge(std::size_t bin) {
    if (bin + 1 >= kBins) return INT64_MAX;
    return (std::int64_t{1} << (kFirst - 2 + bin / 4)) * static_cast<std::int64_t>(4 + bin % 4);
  }
  static constexpr std::size_t bin_of(std::int64_t ns) {
    if (ns < std::int64_t{1} << kFirst) return 0;
    const int octave = 63 - std::countl_zero(static_cast<std::uint64_t>(ns));
    const auto quarter = static_cast<std::size_t>((ns >> (octave - 2)) & 3);
    return std::min(kBins - 1, 1 + 4 * static_cast<std::size_t>(octave - kFirst) + quarter);
  }

  const std::array<std::int64_t, kBins>& counts() const { return counts_; }
  std::int64_t count() const { return count_; }
  std::int64_t max() const { return max_; }  // ns; 0 if there is none
  double mean() const { return count_ > 0 ? sum_ / static_cast<double>(count_) : 0; }
  /// An upper bound of the duration that the share `p` of all durations does not exceed: the edge of its bin, at most max().
  std::int64_t quantile(double p) const {
    std::int64_t below = 0;
    for (std::size_t bin = 0; bin < kBins; ++bin) {
      below += counts_[bin];
      if (static_cast<double>(below) >= p * static_cast<double>(count_)) return std::min(max_, edge(bin));
    }
    return max_;
  }

 private:
  static constexpr int kFirst = 10;  // 2¹⁰ ns

  std::array<std::int64_t, kBins> counts_{};
  std::int64_t count_ = 0, max_ = 0;
  double sum_ = 0;
};

}  // namespace cotwin::master
