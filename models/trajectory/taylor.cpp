#include "models/trajectory/taylor.h"

#include <cstddef>

namespace cotwin::trajectory {

namespace {

/// cos(½√x) and sin(½√x)/√x with three derivatives by x. They are entire functions with C′ = −S/4 and 2x S′ = C/2 − S.
struct CosineAndSine {
  std::array<double, 4> C, S;
};

CosineAndSine at(double x) {
  CosineAndSine f{};
  if (x < 1) {  // Σ (−x)ᵏ / (2^(2k+1) (2k + 1)!): the recurrence below would divide a small difference by x
    double term = 0.5;
    std::array<double, 13> a;
    for (std::size_t k = 0; k < a.size(); ++k) {
      a[k] = term;
      term *= -0.25 / static_cast<double>((2 * k + 2) * (2 * k + 3));
    }
    for (std::size_t order = 0; order < 4; ++order) {
      double sum = 0;
      for (std::size_t k = a.size(); k-- > order;) {
        double factor = a[k];
        for (std::size_t i = 0; i < order; ++i) factor *= static_cast<double>(k - i);
        sum = sum * x + factor;
      }
      f.S[order] = sum;
    }
  } else {
    const double r = std::sqrt(x);
    f.S[0] = std::sin(r / 2) / r;
    double dC = std::cos(r / 2);
    for (std::size_t order = 1; order < 4; ++order) {  // derivatives of 2x S′ = C/2 − S
      f.S[order] = (dC / 2 - static_cast<double>(2 * order - 1) * f.S[order - 1]) / (2 * x);
      dC = -f.S[order - 1] / 4;
    }
  }
  f.C = {std::cos(std::sqrt(x) / 2), -f.S[0] / 4, -f.S[1] / 4, -f.S[2] / 4};
  return f;
}

/// The rate of a series, to second order.
Taylor4 rate(const Taylor4& Q) { return {{Q.c[1], 2 * Q.c[2], 3 * Q.c[3], Eigen::Vector4d::Zero()}}; }

Taylor3 twice_vector(const Taylor4& Q) {
  return {{2 * Q.c[0].tail<3>(), 2 * Q.c[1].tail<3>(), 2 * Q.c[2].tail<3>(), Eigen::Vector3d::Zero()}};
}

}  // namespace

Taylor4 exponential(const Taylor3& psi) {
  const Taylor1 x = multiply<double>(psi, psi, [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return a.dot(b); });
  const CosineAndSine f = at(x.c[0]);
  const Taylor1 w = compose(f.C, x);
  const Taylor3 v = compose(f.S, x) * psi;
  Taylor4 Q;
  for (std::size_t k = 0; k < 4; ++k) Q.c[k] << w.c[k], v.c[k];
  return Q;
}

Eigen::Vector4d multiply(const Eigen::Vector4d& a, const Eigen::Vector4d& b) {
  return {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3], a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
          a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1], a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
}

Taylor4 operator*(const Taylor4& a, const Taylor4& b) {
  return multiply<Eigen::Vector4d>(a, b, [](const Eigen::Vector4d& x, const Eigen::Vector4d& y) { return multiply(x, y); });
}

Taylor3 angular_velocity(const Taylor4& Q) { return twice_vector(rate(Q) * conjugate(Q)); }
Taylor3 angular_velocity_in_body(const Taylor4& Q) { return twice_vector(conjugate(Q) * rate(Q)); }

Eigen::Vector3d shortest_rotation(const Eigen::Vector4d& a, const Eigen::Vector4d& b) {
  Eigen::Vector4d d = multiply(conjugate(a), b);
  constexpr double kHalfTurn = 1e-9;
  if (std::abs(d[0]) <= kHalfTurn) {
    Eigen::Index largest = 1;
    for (Eigen::Index i = 2; i <= 3; ++i) {
      if (std::abs(d[i]) > std::abs(d[largest]) * (1 + kHalfTurn)) largest = i;
    }
    if (d[largest] < 0) d = -d;
  } else if (d[0] < 0) {
    d = -d;
  }
  const double sine = d.tail<3>().norm();
  return sine > 0 ? Eigen::Vector3d(2 * std::atan2(sine, d[0]) / sine * d.tail<3>()) : Eigen::Vector3d::Zero();
}

}  // namespace cotwin::trajectory
