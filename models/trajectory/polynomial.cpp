#include "models/trajectory/polynomial.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/trajectory/bernstein.h"

namespace cotwin::trajectory {

namespace {

double binomial(int n, int k) {
  double product = 1;
  for (int i = 1; i <= k; ++i) product *= static_cast<double>(n - k + i) / static_cast<double>(i);
  return product;
}

/// Control points of degree k + a + b of sᵃ (1 − s)ᵇ P_k^(2b,2a)(2s − 1), with
///   P_k^(α,β)(2s − 1) = Σ_i (−1)^(k−i) C(k + α, i) C(k + β, k − i) sⁱ (1 − s)^(k−i).
std::vector<double> weighted_jacobi(int k, int a, int b) {
  const int degree = k + a + b;
  std::vector<double> points(static_cast<std::size_t>(degree + 1), 0.0);
  for (int i = 0; i <= k; ++i) {
    const double sign = (k - i) % 2 == 0 ? 1 : -1;
    const double coefficient = sign * binomial(k + 2 * b, i) * binomial(k + 2 * a, k - i);
    points[static_cast<std::size_t>(i + a)] = coefficient / binomial(degree, i + a);
  }
  return points;
}

}  // namespace

RedundantTerms::RedundantTerms(int degree, bool start_jerk, bool end_jerk)
    : degree_(degree), start_jerk_(start_jerk), end_jerk_(end_jerk) {
  const int a = start_jerk ? 4 : 3, b = end_jerk ? 4 : 3;
  const int least = a + b - 1;
  if (degree < least || degree > bernstein::kMaxDegree) {
    throw Error("polynomial", "degree " + std::to_string(degree) + ", expected " + std::to_string(least) + " to " +
                                  std::to_string(bernstein::kMaxDegree));
  }
  for (int k = 0; k < degree - least; ++k) {
    std::vector<double> points = weighted_jacobi(k, a, b);
    const bernstein::Extremes range = bernstein::extremes(points);
    const double largest = std::max(range.max.value, -range.min.value);
    for (double& p : points) p /= largest;
    terms_.push_back(bernstein::elevate(points, degree));
  }
}

std::vector<double> make_polynomial(const Boundary& start, const Boundary& end, double T, const RedundantTerms& terms,
                                    std::span<const double> c_r) {
  if (!(T > 0)) throw Error("polynomial", "duration " + text::to_text(T) + " s, expected > 0");
  if (c_r.size() != terms.size()) {
    throw Error("polynomial", std::to_string(c_r.size()) + " redundant coefficients, expected " + std::to_string(terms.size()));
  }
  if (start.dddq.has_value() != terms.start_jerk() || end.dddq.has_value() != terms.end_jerk()) {
    throw Error("polynomial", "the ends with a prescribed jerk differ from those of the redundant terms");
  }
  const auto quintic = bernstein::quintic({start.q, start.dq * T, start.ddq * T * T}, {end.q, end.dq * T, end.ddq * T * T});
  // A prescribed jerk determines one more control point, after the end's first three: p‴ = d(d−1)(d−2) Δ³b.
  const int least = 5 + (terms.start_jerk() ? 1 : 0) + (terms.end_jerk() ? 1 : 0);
  std::vector<double> points = bernstein::elevate(quintic, least);
  const double scale = T * T * T / (least * (least - 1.0) * (least - 2.0));
  const std::size_t last = points.size() - 1;
  if (start.dddq) points[3] = *start.dddq * scale + 3 * points[2] - 3 * points[1] + points[0];
  if (end.dddq) points[last - 3] = -*end.dddq * scale + 3 * points[last - 2] - 3 * points[last - 1] + points[last];
  points = bernstein::elevate(points, terms.degree());
  for (std::size_t k = 0; k < terms.size(); ++k) {
    const auto term = terms.term(k);
    for (std::size_t i = 0; i < points.size(); ++i) points[i] += c_r[k] * term[i];
  }
  return points;
}

}  // namespace cotwin::trajectory
