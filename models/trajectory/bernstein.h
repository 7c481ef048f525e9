#pragma once
#include <array>
#include <optional>
#include <span>
#include <vector>

/// Polynomials over s in [0, 1] in Bernstein form, p(s) = Σ_i b_i · C(d, i) sⁱ (1 − s)^(d−i). The d + 1 control points b bound
/// the polynomial, determine its value and derivatives at the ends one after another, and are evaluated by convex
/// combinations, so rounding does not grow with the degree as with powers of s.
namespace cotwin::trajectory::bernstein {

inline constexpr int kMaxDegree = 31;

/// p(s) and its first three derivatives with respect to s. `b` has 4 to kMaxDegree + 1 control points.
std::array<double, 4> evaluate(std::span<const double> b, double s);

/// Control points of the same polynomial with a higher degree.
std::vector<double> elevate(std::span<const double> b, int degree);

/// The quintic with given value and first and second derivative (with respect to s) at both ends.
std::array<double, 6> quintic(const std::array<double, 3>& start, const std::array<double, 3>& end);

struct Extreme {
  double value = 0;
  double s = 0;
};
struct Extremes {
  Extreme min, max;
};

/// Least and greatest value over [0, 1] of the derivative of this order (0 to 3; with respect to s), by subdivision of the
/// control polygon. The values are attained and within 1e-13 of the span (plus 1e-14 of the magnitude) of the derivative's
/// control points of the true extremes.
Extremes extremes(std::span<const double> b, int derivative = 0);

/// A value of the derivative of this order that exceeds `limit`, or none if it does not exceed it by more than the accuracy of
/// extremes(). Faster than extremes(): parts of [0, 1] that stay below the limit are skipped.
std::optional<double> value_above(std::span<const double> b, int derivative, double limit);

/// Fast bounds of the same: the least and the greatest control point of the derivative.
struct Hull {
  double min = 0, max = 0;
};
Hull hull(std::span<const double> b, int derivative = 0);

}  // namespace cotwin::trajectory::bernstein
