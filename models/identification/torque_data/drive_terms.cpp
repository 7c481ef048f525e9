#include "models/identification/torque_data/drive_terms.h"

#include <algorithm>
#include <cmath>

namespace cotwin::identification {

DriveTerms::DriveTerms(const TorqueData& data, int joint)
    : columns_(data.columns(joint)),
      options_(data.options()),
      nodes_(data.speed_nodes(joint)),
      v_load_(speed_scale(data.robot().joints[static_cast<std::size_t>(joint)]) * options_.v_R) {
  const std::string number = "_" + std::to_string(joint + 1);
  const auto term = [&](const std::string& name, bool nonnegative, int column) {
    names_.push_back(name + number);
    nonnegative_.push_back(nonnegative);
    column_.push_back(column);
  };
  if (curved()) {
    term("tau_C", true, -1);
    curves_ = 1;
    nonlinear_ = 2;
    if (options_.friction == FrictionLaw::kStribeck) {
      term("(tau_S - tau_C)", true, -1);
      curves_ = 2;
      nonlinear_ = 1;
    }
  }
  if (columns_.coulomb >= 0) term("tau_C", true, columns_.coulomb);
  if (columns_.load >= 0) term("mu", true, columns_.load);
  if (columns_.viscous >= 0) term("sigma2", true, columns_.viscous);
  if (columns_.offset >= 0) term("tau_0", false, columns_.offset);
  if (columns_.motor_inertia >= 0) term("B", true, columns_.motor_inertia);
  for (int i = columns_.harmonics; i >= 0 && i < columns_.drive; ++i) {
    const int k = i - columns_.harmonics;
    term(std::string(k % 2 == 0 ? "a" : "b") + std::to_string(k / 2 + 1), false, i);
  }
}

JointDrive DriveTerms::drive(const JointDrive& shape, const double* phi) const {
  JointDrive drive = shape;
  drive.tau_C = drive.tau_S = drive.sigma2 = drive.tau_0 = drive.B = drive.load = 0;
  drive.v_load = v_load_;
  drive.harmonics.clear();
  for (int k = 0; k < size(); ++k) {
    const int column = column_[static_cast<std::size_t>(k)];
    if ((column < 0 && k == 0) || (column >= 0 && column == columns_.coulomb))
      drive.tau_C = phi[k];
    else if (column < 0)
      drive.tau_S = phi[k];
    else if (column == columns_.load)
      drive.load = phi[k];
    else if (column == columns_.viscous)
      drive.sigma2 = phi[k];
    else if (column == columns_.offset)
      drive.tau_0 = phi[k];
    else if (column == columns_.motor_inertia)
      drive.B = phi[k];
    else
      drive.harmonics.push_back(phi[k]);
  }
  drive.tau_S += drive.tau_C;
  return drive;
}

double DriveTerms::curve(const JointDrive& shape, int k, double v) const {
  const double x = (v + shape.s) / shape.v_R, e = std::exp(-2 * std::abs(x));
  const double sign =
      std::copysign((1 - e) / (1 + e), x);  // tanh x, to absolute rounding; most of the time of a swarm is spent here
  if (k == 0) return sign;
  const double ratio = std::abs(v / shape.v_S);
  return sign * std::exp(-(shape.delta == 2 ? ratio * ratio : std::pow(ratio, shape.delta)));
}

void DriveTerms::columns_of(const JointDrive& shape, Eigen::MatrixXd& C) const {
  C.setZero(columns_.drive, size());
  for (int k = 0; k < curves_; ++k)
    for (int i = 0; i < columns_.nodes; ++i) C(i, k) = curve(shape, k, nodes_[static_cast<std::size_t>(i)]);
  for (int k = curves_; k < size(); ++k) C(column_[static_cast<std::size_t>(k)], k) = 1;
}

namespace {

/// Solves min ‖T φ − b‖² over the columns of T (m x m, upper triangular, by column) in `free`; φ is 0 elsewhere. The residual b
/// − T φ goes to `rest`. Modified Gram–Schmidt with repeated projections is as accurate as Householder reflections at this
/// size.
double solve_free(int m, const double (*T)[kMostTerms], const double* b, unsigned free, double* phi, double* rest) {
  double Q[kMostTerms][kMostTerms], R[kMostTerms][kMostTerms] = {}, along[kMostTerms] = {};
  std::copy(b, b + m, rest);
  for (int k = 0; k < m; ++k) {
    phi[k] = 0;
    if (!(free >> k & 1)) continue;
    double length = 0, left = 0;
    for (int i = 0; i < m; ++i) length += T[k][i] * T[k][i];
    std::copy(T[k], T[k] + m, Q[k]);
    for (int pass = 0; pass < 2; ++pass)
      for (int c = 0; c < k; ++c) {
        if (!(free >> c & 1)) continue;
        double dot = 0;
        for (int i = 0; i < m; ++i) dot += Q[c][i] * Q[k][i];
        for (int i = 0; i < m; ++i) Q[k][i] -= dot * Q[c][i];
        R[c][k] += dot;
      }
    for (int i = 0; i < m; ++i) left += Q[k][i] * Q[k][i];
    if (!(left > 1e-20 * length)) {
      free &= ~(1u << k);
      continue;
    }
    R[k][k] = std::sqrt(left);
    for (int i = 0; i < m; ++i) Q[k][i] /= R[k][k];
    for (int i = 0; i < m; ++i) along[k] += Q[k][i] * rest[i];
    for (int i = 0; i < m; ++i) rest[i] -= along[k] * Q[k][i];
  }
  for (int k = m - 1; k >= 0; --k) {
    if (!(free >> k & 1)) continue;
    double x = along[k];
    for (int c = k + 1; c < m; ++c)
      if (free >> c & 1) x -= R[k][c] * phi[c];
    phi[k] = x / R[k][k];
  }
  double squares = 0;
  for (int i = 0; i < m; ++i) squares += rest[i] * rest[i];
  return squares;
}

}  // namespace

double solve_nonnegative(int rows, int m, double* T, int ld, double* b, const bool* nonnegative, double* phi,
                         unsigned* active) {
  // Reduces T to a triangle of m rows; the part of b below it is a constant residual.
  double outside = 0;
  if (rows > m) {
    for (int k = 0; k < m; ++k) {
      double* w = T + k * ld;
      double squares = 0;
      for (int i = k; i < rows; ++i) squares += w[i] * w[i];
      if (!(squares > 0)) continue;
      const double norm = w[k] > 0 ? -std::sqrt(squares) : std::sqrt(squares);
      const double head = w[k] - norm, beta = 1 / (squares - norm * w[k]);
      w[k] = head;
      for (int c = k + 1; c <= m; ++c) {
        double* column = c < m ? T + c * ld : b;
        double dot = 0;
        for (int i = k; i < rows; ++i) dot += w[i] * column[i];
        dot *= beta;
        for (int i = k; i < rows; ++i) column[i] -= dot * w[i];
      }
      w[k] = norm;
      std::fill(w + k + 1, w + rows, 0.0);
    }
    for (int i = m; i < rows; ++i) outside += b[i] * b[i];
  }
  double triangle[kMostTerms][kMostTerms] = {}, rest[kMostTerms];
  for (int c = 0; c < m; ++c)
    for (int r = 0; r < std::min(rows, m); ++r) triangle[c][r] = T[c * ld + r];
  double target[kMostTerms] = {};
  std::copy(b, b + std::min(rows, m), target);

  const unsigned all = (1u << m) - 1;
  unsigned free = all;
  double squares = 0;
  int fewest = m + 1, patience = 3;
  for (int trial = 0; trial < 64; ++trial) {
    squares = solve_free(m, triangle, target, free, phi, rest);
    unsigned wrong = 0;
    int count = 0, last = -1;
    for (int k = 0; k < m; ++k) {
      if (!nonnegative[k]) continue;
      bool bad;
      if (free >> k & 1) {
        bad = phi[k] < 0;
      } else {
        double gradient = 0, length = 0, size = 0;
        for (int i = 0; i < m; ++i) {
          gradient += triangle[k][i] * rest[i];
          length += triangle[k][i] * triangle[k][i];
          size += target[i] * target[i];
        }
        bad = gradient > 1e-12 * std::sqrt(length * size);
      }
      if (!bad) continue;
      wrong |= 1u << k;
      last = k;
      ++count;
    }
    if (count == 0) break;
    // Exchange all infeasible unknowns at once while their number decreases; otherwise only the last one, which guarantees
    // termination.
    if (count < fewest) {
      fewest = count;
      patience = 3;
      free ^= wrong;
    } else if (patience-- > 0) {
      free ^= wrong;
    } else {
      free ^= 1u << last;
    }
  }
  for (int k = 0; k < m; ++k)
    if (nonnegative[k]) phi[k] = std::max(phi[k], 0.0);
  if (active) *active = all & ~free;
  return squares + outside;
}

}  // namespace cotwin::identification
