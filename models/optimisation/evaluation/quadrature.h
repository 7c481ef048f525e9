#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace cotwin::optimisation {

/// Nodes in (0, 1), ascending, and weights with Σ w = 1.
struct Quadrature {
  std::vector<double> s, w;
};

/// Gauss–Legendre with `count` ≥ 1 nodes: exact for polynomials of degree 2 count − 1.
Quadrature gauss_legendre(std::size_t count);
/// Gauss–Legendre with eight nodes on each of about `panels` ≥ 1 parts, equal ones between two neighbours of `cuts`, ascending places within
/// (0, 1).
Quadrature gauss_panels(std::size_t panels, std::span<const double> cuts = {});

}  // namespace cotwin::optimisation
