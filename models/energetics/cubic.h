#pragma once
#include <array>
#include <cstddef>

namespace cotwin::energetics {

/// c0 + c1 s + c2 s² + c3 s³ over s in [0, 1]: a power, in W, as a function of the share of an interval of time.
using Cubic = std::array<double, 4>;

/// The four nodes of Gauss and Legendre in [0, 1] and their weights, which integrate polynomials up to degree 7 exactly.
inline constexpr std::size_t kNodes = 4;
inline constexpr std::array<double, kNodes> kNode = {0.069431844202973712388, 0.33000947820757186760, 0.66999052179242813240,
                                                     0.93056815579702628761};
inline constexpr std::array<double, kNodes> kWeight = {0.17392742256872692869, 0.32607257743127307131, 0.32607257743127307131,
                                                       0.17392742256872692869};

/// The cubic through values at the nodes. Its integral is that of Gauss's quadrature.
Cubic through(const std::array<double, kNodes>& values);

inline double value(const Cubic& p, double s) { return p[0] + s * (p[1] + s * (p[2] + s * p[3])); }
/// ∫ p ds from 0 to s.
inline double integral(const Cubic& p, double s) { return s * (p[0] + s * (p[1] / 2 + s * (p[2] / 3 + s * p[3] / 4))); }

/// The places in (0, 1) at which p changes its sign, in order.
struct Crossings {
  std::array<double, 3> s{};
  std::size_t count = 0;
};
Crossings crossings(const Cubic& p);

/// ∫ max(p, 0) ds and ∫ min(p, 0) ds over [0, 1].
struct Parts {
  double positive = 0, negative = 0;
};
Parts parts(const Cubic& p);

}  // namespace cotwin::energetics
