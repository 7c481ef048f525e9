#pragma once
#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>

/// Functions of time to third order, f(t + δ) = c₀ + c₁ δ + c₂ δ² + c₃ δ³: sums, products and compositions of such series give
/// derivatives to rounding, without a formula for each of them.
namespace cotwin::trajectory {

template <class Value>
struct Taylor {
  std::array<Value, 4> c;

  friend Taylor operator+(const Taylor& a, const Taylor& b) {
    return {{Value(a.c[0] + b.c[0]), Value(a.c[1] + b.c[1]), Value(a.c[2] + b.c[2]), Value(a.c[3] + b.c[3])}};
  }
};

using Taylor1 = Taylor<double>;
using Taylor3 = Taylor<Eigen::Vector3d>;
/// Quaternions (w, x, y, z).
using Taylor4 = Taylor<Eigen::Vector4d>;

/// The series of a function with these derivatives.
inline Taylor1 from_derivatives(double f, double df, double ddf, double dddf) { return {{f, df, ddf / 2, dddf / 6}}; }

/// Coefficients of a bilinear product of two series.
template <class Value, class A, class B, class Product>
Taylor<Value> multiply(const Taylor<A>& a, const Taylor<B>& b, Product product) {
  Taylor<Value> r;
  for (std::size_t k = 0; k < 4; ++k) {
    r.c[k] = product(a.c[0], b.c[k]);
    for (std::size_t i = 1; i <= k; ++i) r.c[k] += product(a.c[i], b.c[k - i]);
  }
  return r;
}
inline Taylor1 operator*(const Taylor1& a, const Taylor1& b) {
  return multiply<double>(a, b, [](double x, double y) { return x * y; });
}
inline Taylor3 operator*(const Taylor1& a, const Taylor3& b) {
  return multiply<Eigen::Vector3d>(a, b, [](double x, const Eigen::Vector3d& y) { return Eigen::Vector3d(x * y); });
}
inline Taylor3 operator*(const Taylor1& a, const Eigen::Vector3d& b) {
  return {{Eigen::Vector3d(a.c[0] * b), Eigen::Vector3d(a.c[1] * b), Eigen::Vector3d(a.c[2] * b), Eigen::Vector3d(a.c[3] * b)}};
}
inline Taylor1 operator*(double a, const Taylor1& b) { return {{a * b.c[0], a * b.c[1], a * b.c[2], a * b.c[3]}}; }

/// f(x(t)) for a function with the derivatives f[0] to f[3] at x(t).
inline Taylor1 compose(const std::array<double, 4>& f, const Taylor1& x) {
  const double x1 = x.c[1], x2 = x.c[2], x3 = x.c[3];
  return {{f[0], f[1] * x1, f[1] * x2 + f[2] / 2 * x1 * x1, f[1] * x3 + f[2] * x1 * x2 + f[3] / 6 * x1 * x1 * x1}};
}
inline Taylor1 sin(const Taylor1& x) {
  const double s = std::sin(x.c[0]), c = std::cos(x.c[0]);
  return compose({s, c, -s, -c}, x);
}
inline Taylor1 cos(const Taylor1& x) {
  const double s = std::sin(x.c[0]), c = std::cos(x.c[0]);
  return compose({c, -s, -c, s}, x);
}

/// The rotation by the rotation vector ψ(t): (cos ½φ, ψ sin(½φ)/φ), φ = |ψ|. Smooth at every ψ, also at 0.
Taylor4 exponential(const Taylor3& psi);
/// Products of quaternions.
Eigen::Vector4d multiply(const Eigen::Vector4d& a, const Eigen::Vector4d& b);
Taylor4 operator*(const Taylor4& a, const Taylor4& b);
inline Eigen::Vector4d conjugate(const Eigen::Vector4d& Q) { return {Q[0], -Q[1], -Q[2], -Q[3]}; }
inline Taylor4 conjugate(const Taylor4& Q) {
  return {{conjugate(Q.c[0]), conjugate(Q.c[1]), conjugate(Q.c[2]), conjugate(Q.c[3])}};
}
/// Angular velocity of the orientation Q(t) with its first and second derivative (c₀ to c₂; c₃ = 0): 2 Q̇ Q* in the reference
/// frame, 2 Q* Q̇ in the body's.
Taylor3 angular_velocity(const Taylor4& Q);
Taylor3 angular_velocity_in_body(const Taylor4& Q);

/// The rotation vector of the shortest rotation from `a` to `b`, unit quaternions, in the frame of a: b = ± a exp(ψ), |ψ| ≤ π.
/// Of the two axes of a rotation by 180°, to 2e-9 rad, the one whose component of largest magnitude is positive.
Eigen::Vector3d shortest_rotation(const Eigen::Vector4d& a, const Eigen::Vector4d& b);

}  // namespace cotwin::trajectory
