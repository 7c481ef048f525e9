// The minimum of f on the cone of physical bodies within the box, by Newton's method on a falling barrier.
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>

#include "models/identification/compass.h"
#include "models/identification/problem_impl.h"
#include "models/numerics/dense.h"

namespace cotwin::identification {
namespace {

using Eigen::Index;
using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Coordinates p of a body in which its prior is the identity: P = U_0 X U_0ᵀ, X symmetric with these elements.
constexpr int kElement[10][2] = {{0, 0}, {1, 1}, {2, 2}, {3, 3}, {0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
/// Where s12, s23, s13, t1, t2, t3 of LogCholesky stand in U(ξ).
constexpr int kPlaceInConvex[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};

Matrix4d symmetric(int k) {
  Matrix4d E = Matrix4d::Zero();
  E(kElement[k][0], kElement[k][1]) = E(kElement[k][1], kElement[k][0]) = 1;
  return E;
}

/// A body X = V Vᵀ, V = U(ξ) upper triangular, and how its ξ follow its p.
struct BodyChart {
  Matrix4d X, V;
  Vector10d xi;

  /// False where X is not positive definite.
  bool set(const double* p) {
    for (int k = 0; k < 10; ++k) X(kElement[k][0], kElement[k][1]) = X(kElement[k][1], kElement[k][0]) = p[k];
    V.setZero();
    for (int j = 3; j >= 0; --j) {
      double square = X(j, j);
      for (int k = j + 1; k < 4; ++k) square -= V(j, k) * V(j, k);
      if (!(square > 0) || !std::isfinite(square)) return false;
      V(j, j) = std::sqrt(square);
      for (int i = 0; i < j; ++i) {
        double sum = X(i, j);
        for (int k = j + 1; k < 4; ++k) sum -= V(i, k) * V(j, k);
        V(i, j) = sum / V(j, j);
      }
    }
    xi[0] = std::log(V(3, 3));
    for (int i = 0; i < 3; ++i) xi[1 + i] = std::log(V(i, i) / V(3, 3));
    for (int k = 0; k < 6; ++k) xi[4 + k] = V(kPlaceInConvex[k][0], kPlaceInConvex[k][1]) / V(3, 3);
    return true;
  }
  /// ∂V/∂ξ_a
  Matrix4d slope(int a) const {
    if (a == 0) return V;
    Matrix4d D = Matrix4d::Zero();
    if (a <= 3)
      D(a - 1, a - 1) = V(a - 1, a - 1);
    else
      D(kPlaceInConvex[a - 4][0], kPlaceInConvex[a - 4][1]) = V(3, 3);
    return D;
  }
  /// ∂ξ/∂p
  Matrix10d xi_by_p() const {
    Matrix10d p_by_xi;
    for (int a = 0; a < 10; ++a) {
      const Matrix4d half = slope(a) * V.transpose();
      for (int k = 0; k < 10; ++k) {
        const auto [r, c] = kElement[k];
        p_by_xi(k, a) = half(r, c) + half(c, r);
      }
    }
    return p_by_xi.inverse();
  }
  /// ∂²⟨w, p⟩/∂ξ∂ξ with constant w: p is quadratic in V.
  Matrix10d curvature(const Vector10d& w) const {
    Matrix4d W;  // ⟨w, p⟩ = tr(W X)
    for (int k = 0; k < 10; ++k) {
      const auto [r, c] = kElement[k];
      W(r, c) = W(c, r) = r == c ? w[k] : 0.5 * w[k];
    }
    const Matrix4d WV = W * V;
    Matrix10d Q;
    for (int a = 0; a < 10; ++a) {
      const Matrix4d D_a = slope(a), WD_a = W * D_a;
      for (int b = a; b < 10; ++b) {
        const Matrix4d D_b = slope(b);
        double q = 2 * WD_a.cwiseProduct(D_b).sum();
        if (a == 0 || (a == b && a <= 3)) q += 2 * WV.cwiseProduct(D_b).sum();  // ∂²V/∂ξ_a∂ξ_b is ∂V/∂ξ_b
        Q(a, b) = Q(b, a) = q;
      }
    }
    return Q;
  }
};

/// The problem in x = (p of all bodies, φ of all joints, η of all joints), in which the residuals are linear but for η:
///   ‖A x − b‖² + ρ² + λ Σ [tr X − log det X − 4] + λ_η ‖η‖² − μ (Σ ln φ + Σ ln(ξ − ξ_lower) + Σ ln(ξ_upper − ξ))
/// so that Newton's steps do not have to follow the bent valleys that data make among ξ.
class ConeProblem {
 public:
  /// `eta`: of all joints, inside of the box.
  ConeProblem(const Problem::Impl& problem, const VectorXd& eta)
      : problem_(problem), n_(problem.n()), bodies_(problem.prior.body_count()), inertial_(problem.inertial()), fixed_(eta) {
    first_eta_ = inertial_;
    for (const DriveTerms& t : problem.terms) {
      first_.push_back(first_eta_);
      first_eta_ += t.size();
    }
    A_.setZero(problem.M.rows(), first_eta_ + eta.size());
    for (int i = 0; i < bodies_; ++i) {
      const Matrix4d& U = problem.bodies[static_cast<std::size_t>(i)].factor();
      Matrix10d by_p;
      for (int k = 0; k < 10; ++k) by_p.col(k) = from_pseudo_inertia(U * symmetric(k) * U.transpose());
      A_.middleCols(10 * i, 10) = problem.M.middleCols(10 * i, 10) * by_p;
    }
    set_curves(eta);
    scale_.setOnes(A_.cols());
    for (int j = 0; j < n_; ++j) {
      const auto k = static_cast<std::size_t>(j);
      for (int i = 0; i < problem.terms[k].size(); ++i) {
        const int column = first_[k] + i;
        const double length = A_.col(column).norm();
        if (length > 0) scale_[column] = 1 / length;
        if (problem.terms[k].nonnegative(i)) nonnegative_.push_back(column);
      }
    }
  }

  /// From here on η is sought too.
  void free_shapes() { shaped_ = true; }

  /// ξ = 0, φ small, η as given.
  VectorXd start() const {
    VectorXd x = VectorXd::Zero(A_.cols());
    for (int i = 0; i < bodies_; ++i) x.segment<4>(10 * i).setOnes();
    for (const int k : nonnegative_) x[k] = scale_[k];
    x.tail(fixed_.size()) = fixed_;
    return x;
  }
  double barriers() const {
    return 20.0 * bodies_ + static_cast<double>(nonnegative_.size()) + 2.0 * static_cast<double>(fixed_.size());
  }

  /// f + μ barriers; nothing outside of cone and box.
  std::optional<double> value(const VectorXd& x, double mu) {
    set_curves(x.tail(fixed_.size()));
    double f =
        residual(x).squaredNorm() + problem_.rho * problem_.rho + problem_.lambda_shape * x.tail(fixed_.size()).squaredNorm();
    for (int i = 0; i < bodies_; ++i) {
      BodyChart body;
      if (!body.set(x.data() + 10 * i)) return {};
      const double log_det = 2 * body.V.diagonal().array().log().sum();
      f += problem_.lambda * (body.X.trace() - log_det - 4);
      if (!add_barriers(body.xi, 10 * i, mu, f)) return {};
    }
    if (shaped_ && !add_barriers(x.tail(fixed_.size()), inertial_, mu, f)) return {};
    for (const int k : nonnegative_) {
      if (!(x[k] > 0)) return {};
      f -= mu * std::log(x[k] / scale_[k]);
    }
    if (!std::isfinite(f)) return {};
    return f;
  }

  /// Newton's step of it (η: Gauss's and Newton's), and the decrement (twice the fall it promises).
  VectorXd step(const VectorXd& x, double mu, double& decrement) {
    const Index count = fixed_.size();
    set_curves(x.tail(count));
    if (shaped_) set_slopes(x);
    const VectorXd r = residual(x);
    VectorXd g = 2 * A_.transpose() * r;
    MatrixXd H = 2 * A_.transpose() * A_;
    // Unknowns that the data do not see keep a weight of nothing but rounding.
    H.diagonal().array() += 1e-14 * H.diagonal().maxCoeff();
    std::vector<Matrix10d> bent(static_cast<std::size_t>(bodies_));
    for (int i = 0; i < bodies_; ++i) {
      BodyChart body;
      body.set(x.data() + 10 * i);
      const Matrix4d inverse = body.X.inverse();
      Matrix4d times[10];
      for (int k = 0; k < 10; ++k) times[k] = inverse * symmetric(k);
      for (int k = 0; k < 10; ++k) {
        g[10 * i + k] += problem_.lambda * (symmetric(k).trace() - times[k].trace());
        for (int l = 0; l < 10; ++l) H(10 * i + k, 10 * i + l) += problem_.lambda * (times[k] * times[l]).trace();
      }
      Vector10d push, wall;
      walls(body.xi, 10 * i, mu, push.data(), wall.data());
      const Matrix10d by_p = body.xi_by_p();
      const Vector10d force = by_p.transpose() * push;
      g.segment<10>(10 * i) += force;
      H.block<10, 10>(10 * i, 10 * i) += by_p.transpose() * wall.asDiagonal() * by_p;
      // ∂²ξ/∂p∂p from p(ξ(p)) = p
      bent[static_cast<std::size_t>(i)] = -by_p.transpose() * body.curvature(force) * by_p;
    }
    for (const int k : nonnegative_) {
      g[k] -= mu / x[k];
      H(k, k) += mu / (x[k] * x[k]);
    }
    if (shaped_) {
      VectorXd push(count), wall(count);
      walls(x.tail(count), inertial_, mu, push.data(), wall.data());
      g.tail(count) += push + 2 * problem_.lambda_shape * x.tail(count);
      H.diagonal().tail(count) += wall;
      H.diagonal().tail(count).array() += 2 * problem_.lambda_shape;
    } else {
      g.tail(count).setZero();
      H.rightCols(count).setZero();
      H.bottomRows(count).setZero();
      H.diagonal().tail(count).setOnes();
    }
    MatrixXd curved = H;
    for (int i = 0; i < bodies_; ++i) curved.block<10, 10>(10 * i, 10 * i) += bent[static_cast<std::size_t>(i)];
    VectorXd d;
    // The box is not convex in p: where its bending is stronger than all else it is left out. What the data and the prior leave
    // wholly open may still be singular to rounding.
    if (!solve(curved, g, d) && !solve(H, g, d)) {
      const VectorXd scale = H.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
      d = -scale.cwiseProduct(numerics::solve_ldlt(scale.asDiagonal() * H * scale.asDiagonal(), scale.cwiseProduct(g)));
      if (!d.allFinite()) d.setZero(g.size());
    }
    decrement = -g.dot(d);
    return d;
  }

  /// ξ of the problem at x.
  VectorXd coordinates(const VectorXd& x) const {
    VectorXd xi(inertial_ + fixed_.size());
    for (int i = 0; i < bodies_; ++i) {
      BodyChart body;
      body.set(x.data() + 10 * i);
      xi.segment<10>(10 * i) = body.xi;
    }
    xi.tail(fixed_.size()) = x.tail(fixed_.size());
    return xi;
  }

 private:
  VectorXd residual(const VectorXd& x) const { return A_.leftCols(first_eta_) * x.head(first_eta_) - problem_.m; }

  JointDrive shape(int j, const VectorXd& eta) const {
    const double* const own = eta.data() + problem_.first_nonlinear(j) - inertial_;
    return problem_.shape(j, eta.size() > 0 ? own : nullptr);
  }

  /// Columns of φ at this η.
  void set_curves(const VectorXd& eta) {
    MatrixXd C;
    for (int j = 0; j < n_; ++j) {
      const auto k = static_cast<std::size_t>(j);
      const DriveTerms& t = problem_.terms[k];
      if (ready_ && t.nonlinear() == 0) continue;
      t.columns_of(shape(j, eta), C);
      A_.block(problem_.row[k], first_[k], problem_.R11[k].rows(), t.size()) = problem_.R11[k] * C;
    }
    ready_ = true;
  }

  /// Columns of η at x: derivatives of the residual.
  void set_slopes(const VectorXd& x) {
    constexpr double kStep = 1e-5;
    MatrixXd up, down;
    for (int j = 0; j < n_; ++j) {
      const auto k = static_cast<std::size_t>(j);
      const DriveTerms& t = problem_.terms[k];
      for (int i = 0; i < t.nonlinear(); ++i) {
        const Index at = problem_.first_nonlinear(j) - inertial_ + i;
        VectorXd eta = x.tail(fixed_.size());
        eta[at] += kStep;
        t.columns_of(shape(j, eta), up);
        eta[at] -= 2 * kStep;
        t.columns_of(shape(j, eta), down);
        A_.col(first_eta_ + at).segment(problem_.row[k], problem_.R11[k].rows()) =
            problem_.R11[k] * ((up - down) * x.segment(first_[k], t.size()) / (2 * kStep));
      }
    }
  }

  /// Barriers of coordinates that stand in the box from `first` on; false outside of it.
  template <class Coordinates>
  bool add_barriers(const Coordinates& xi, Index first, double mu, double& f) const {
    for (Index i = 0; i < xi.size(); ++i) {
      const double above = xi[i] - problem_.lower[first + i], below = problem_.upper[first + i] - xi[i];
      if (!(above > 0 && below > 0)) return false;
      f -= mu * std::log(above * below);
    }
    return true;
  }
  /// Their first and second derivatives.
  template <class Coordinates>
  void walls(const Coordinates& xi, Index first, double mu, double* push, double* wall) const {
    for (Index i = 0; i < xi.size(); ++i) {
      const double above = 1 / (xi[i] - problem_.lower[first + i]), below = 1 / (problem_.upper[first + i] - xi[i]);
      push[i] = mu * (below - above);
      wall[i] = mu * (below * below + above * above);
    }
  }

  /// d = −H⁻¹ g; false where H is not positive definite.
  static bool solve(const MatrixXd& H, const VectorXd& g, VectorXd& d) {
    if (!(H.diagonal().minCoeff() > 0)) return false;
    const VectorXd s = H.diagonal().cwiseSqrt().cwiseInverse();  // the diagonal spans twenty orders of magnitude
    const auto scaled = numerics::solve_cholesky(s.asDiagonal() * H * s.asDiagonal(), s.cwiseProduct(g));
    if (!scaled) return false;
    d = -s.cwiseProduct(*scaled);
    return d.allFinite();
  }

  const Problem::Impl& problem_;
  int n_, bodies_, inertial_, first_eta_ = 0;
  VectorXd fixed_;
  bool ready_ = false, shaped_ = false;
  std::vector<int> first_, nonnegative_;
  MatrixXd A_;
  VectorXd scale_;
};

/// Newton's steps from x to where μ's barrier holds it. False when `stop` says so.
bool descend(ConeProblem& cone, double mu, VectorXd& x, const std::function<bool()>& stop) {
  for (int iteration = 0; iteration < 60; ++iteration) {
    if (stop && stop()) return false;
    double decrement = 0;
    const VectorXd d = cone.step(x, mu, decrement);
    if (!(decrement > 1e-3 * mu)) break;
    const double before = *cone.value(x, mu);
    double length = 1;
    std::optional<double> after;
    for (; length > 1e-12; length /= 2) {
      after = cone.value(x + length * d, mu);
      if (after && *after <= before - 0.1 * length * decrement) break;
    }
    if (!after || !(length > 1e-12)) break;  // rounding
    x += length * d;
  }
  return true;
}

}  // namespace

VectorXd Problem::Impl::best_shape(int joint, const VectorXd& beta, const VectorXd& eta) const {
  const auto k = static_cast<std::size_t>(joint);
  const DriveTerms& t = terms[k];
  const int at = first_nonlinear(joint);
  // The rows of F_j in the joint's own triangle; what is below them does not know of friction.
  const TorqueData::Columns& c = data.columns(joint);
  const Eigen::Map<const RowMajor> R(data.triangle(joint).R(), c.size(), c.size());
  VectorXd rest = R.col(c.size() - 1).head(c.drive);
  for (std::size_t i = 0; i < c.base.size(); ++i)
    rest -= R.col(c.drive + static_cast<Index>(i)).head(c.drive) * beta[c.base[i]];
  rest = weights[joint] * (basis[k] * rest);
  std::vector<double> scratch(static_cast<std::size_t>(tall) * static_cast<std::size_t>(wide + 2));
  const VectorXd low = lower.segment(at, t.nonlinear()), high = upper.segment(at, t.nonlinear());
  const auto cost = [&](const VectorXd& e) {
    VectorXd rhs = rest;
    double phi[kMostTerms];
    return fit(joint, e.data(), rhs.data(), scratch.data(), phi);
  };
  return compass(eta.size() == 0 ? scan(low, high, 17, cost) : eta, low, high, 0.04, 5e-4, cost);
}

VectorXd convex_optimum(const Problem::Impl& problem, const std::function<bool()>& stop) {
  const Index inertial = problem.inertial(), shapes = problem.lower.size() - inertial;
  const auto shapes_at = [&](const VectorXd& beta, const VectorXd& from) {
    VectorXd eta(shapes);
    for (int j = 0; j < problem.n(); ++j) {
      const int at = problem.first_nonlinear(j), count = problem.terms[static_cast<std::size_t>(j)].nonlinear();
      if (count == 0) continue;
      eta.segment(at - inertial, count) =
          problem.best_shape(j, beta, from.size() == 0 ? VectorXd() : from.segment(at - inertial, count).eval());
    }
    // Off the faces, where a barrier cannot begin.
    const VectorXd low = problem.lower.tail(shapes), high = problem.upper.tail(shapes), edge = 1e-3 * (high - low);
    return eta.cwiseMax(low + edge).cwiseMin(high - edge).eval();
  };
  // Phases: all but friction's shape down to a coarse barrier, twice, each with the shape that fits the bodies before it best;
  // then shapes with all else, down to the fine one. A barrier of weight μ leaves f at most μ times the number of barriers
  // above its minimum.
  constexpr double kCoarse = 1e-4, kFine = 1e-9, kFall = 8;
  VectorXd xi, beta = problem.floor.beta, eta;
  for (int phase = shapes > 0 ? 0 : 1; phase < 2; ++phase) {
    eta = shapes_at(beta, eta);
    ConeProblem cone(problem, eta);
    VectorXd x = cone.start();
    double mu = std::max(1.0, *cone.value(x, 0)) / cone.barriers();
    bool going = true;
    for (; going && mu * cone.barriers() > kCoarse; mu /= kFall) going = descend(cone, mu, x, stop);
    if (going && phase == 1) {
      cone.free_shapes();
      for (; going && mu * cone.barriers() > kFine; mu /= kFall) going = descend(cone, mu, x, stop);
    }
    xi = cone.coordinates(x);
    if (!going) break;
    VectorXd pi(inertial);
    for (int i = 0; i < problem.prior.body_count(); ++i)
      pi.segment<10>(10 * i) = problem.bodies[static_cast<std::size_t>(i)].parameters(xi.segment<10>(10 * i));
    beta = problem.data.base().G * pi;
  }
  return xi.cwiseMax(problem.lower).cwiseMin(problem.upper);
}

}  // namespace cotwin::identification
