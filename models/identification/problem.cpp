#include "models/identification/problem.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/identification/problem_impl.h"
#include "models/numerics/dense.h"
#include "models/numerics/triangle.h"

namespace cotwin::identification {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// What holds friction's shape to its start where the data leave it open. Nobody has measured that start, so it gets no more
/// weight with a prior that is to be believed.
constexpr double kShapePull = 1e-5;

}  // namespace

Problem::Impl::Impl(const TorqueData& d, const robot::RobotModel& p, const ProblemOptions& o) : data(d), prior(p), options(o) {
  data.flush();
  if (p.n() != data.robot().n())
    throw Error("prior " + p.name, std::to_string(p.n()) + " joints, expected " + std::to_string(data.robot().n()));
  if (p.body_count() != data.robot().body_count())
    throw Error("prior " + p.name,
                std::to_string(p.body_count()) + " bodies, expected " + std::to_string(data.robot().body_count()));
  for (robot::Body& body : prior.bodies) {
    body.inertia = consistent(body.inertia);
    bodies.emplace_back(body.inertia);
  }
  for (int j = 0; j < n(); ++j) {
    terms.emplace_back(data, j);
    JointDrive shape;
    const double scale = speed_scale(prior.joints[static_cast<std::size_t>(j)]);
    shape.v_R = scale * data.options().v_R;
    shape.v_S *= scale;
    shape.delta = data.options().delta;
    shapes.push_back(shape);
    tall = std::max(tall, terms.back().columns());
    wide = std::max(wide, terms.back().size());
  }
  set_bounds();
  solve_floor();
  assemble();
  judge();
}

int Problem::Impl::first_nonlinear(int joint) const {
  int at = inertial();
  for (int j = 0; j < joint; ++j) at += terms[static_cast<std::size_t>(j)].nonlinear();
  return at;
}

void Problem::Impl::set_bounds() {
  const Bounds& b = options.bounds;
  Vector10d reach;
  reach << 0.5 * std::log(b.mass_factor), Eigen::Vector3d::Constant(std::log(b.stretch_factor)),
      Eigen::Vector3d::Constant(b.shear), Eigen::Vector3d::Constant(b.shift);
  if (!(b.mass_factor > 1 && b.stretch_factor > 1 && b.shear > 0 && b.shift > 0) || !reach.allFinite())
    throw Error("bounds", "mass and stretch factors must be above 1, shear and shift above 0");
  const int all = first_nonlinear(n());
  lower.resize(all);
  upper.resize(all);
  for (int i = 0; i < prior.body_count(); ++i) {
    upper.segment<10>(10 * i) = reach;
    lower.segment<10>(10 * i) = -reach;
  }
  for (int j = 0; j < n(); ++j) {
    const int at = first_nonlinear(j);
    const JointDrive& shape = shapes[static_cast<std::size_t>(j)];
    const double scale = speed_scale(prior.joints[static_cast<std::size_t>(j)]);
    const auto set = [&](int k, double low, double high) {
      if (!(low < 0 && high > 0)) throw Error("bounds", "of nonlinear friction leave out its prior value, expected around it");
      lower[k] = low;
      upper[k] = high;
    };
    if (terms[static_cast<std::size_t>(j)].nonlinear() == 2) {
      set(at, std::log(scale * b.v_R_min / shape.v_R), std::log(scale * b.v_R_max / shape.v_R));
      set(at + 1, -2, 2);
    } else if (terms[static_cast<std::size_t>(j)].nonlinear() == 1) {
      set(at, std::log(scale * b.v_S_min / shape.v_S), std::log(scale * b.v_S_max / shape.v_S));
    }
  }
}

JointDrive Problem::Impl::shape(int joint, const double* eta) const {
  JointDrive shape = shapes[static_cast<std::size_t>(joint)];
  if (terms[static_cast<std::size_t>(joint)].nonlinear() == 2) {
    shape.v_R *= std::exp(eta[0]);
    shape.s = 0.5 * speed_scale(prior.joints[static_cast<std::size_t>(joint)]) * options.bounds.s_max * eta[1];
  } else if (terms[static_cast<std::size_t>(joint)].nonlinear() == 1) {
    shape.v_S *= std::exp(eta[0]);
  }
  return shape;
}

/// Orthonormal rows Q with R C(η) = Qᵀ Q R C(η) to 1e-7 for all shapes η in the box: curves that change smoothly with η span
/// few directions, and what lies outside of them is friction's business no more.
RowMajor Problem::Impl::reachable(int joint, const RowMajor& R) const {
  const DriveTerms& t = terms[static_cast<std::size_t>(joint)];
  const int at = first_nonlinear(joint), count = t.nonlinear();
  constexpr int kShapes = 24;  // per nonlinear parameter; curves change slowly with them
  const int shapes_tried = count == 2 ? kShapes * kShapes : kShapes * 4;
  MatrixXd C, all(R.rows(), shapes_tried * t.size());
  VectorXd eta(count);
  for (int k = 0; k < shapes_tried; ++k) {
    for (int i = 0, rest = k; i < count; ++i, rest /= kShapes) {
      const int steps = count == 2 ? kShapes : shapes_tried;
      eta[i] = lower[at + i] + (upper[at + i] - lower[at + i]) * (rest % steps) / (steps - 1);
    }
    t.columns_of(shape(joint, eta.data()), C);
    all.middleCols(k * t.size(), t.size()) = R * C;
  }
  for (Index k = 0; k < all.cols(); ++k)
    if (const double length = all.col(k).norm(); length > 0) all.col(k) /= length;
  const numerics::SymmetricEigen<Eigen::Dynamic> axes = numerics::symmetric_eigen(all * all.transpose());
  // ascending eigenvalues, the squares of the singular values
  const Index small = (axes.values.array() <= 1e-14 * axes.values.maxCoeff()).count();
  RowMajor Q = axes.vectors.transpose().colwise().reverse();
  return Q.topRows(std::max<Index>(R.rows() - small, std::min<Index>(t.size(), R.rows())));
}

void Problem::Impl::assemble() {
  const int b = base_count();
  weights = (sigma * std::sqrt(n() * data.weight())).cwiseInverse();
  lambda = options.prior_weight / 100;
  lambda_shape = std::min(lambda, kShapePull);
  numerics::Triangle bottom(static_cast<std::size_t>(b) + 1);
  std::vector<RowMajor> tops;  // [R12 u] in all base parameters
  int rows = b;
  for (int j = 0; j < n(); ++j) {
    const TorqueData::Columns& c = data.columns(j);
    const RowMajor R = weights[j] * Eigen::Map<const RowMajor>(data.triangle(j).R(), c.size(), c.size());
    RowMajor spread = RowMajor::Zero(c.size(), b + 1);
    for (std::size_t i = 0; i < c.base.size(); ++i) spread.col(c.base[i]) = R.col(c.drive + static_cast<Index>(i));
    spread.col(b) = R.col(c.size() - 1);
    const RowMajor top = spread.topRows(c.drive), friction = R.topLeftCorner(c.drive, c.drive);
    const bool curved = terms[static_cast<std::size_t>(j)].curved();
    basis.push_back(curved ? reachable(j, friction) : RowMajor(RowMajor::Identity(c.drive, c.drive)));
    const RowMajor& Q = basis.back();
    row.push_back(rows);
    rows += static_cast<int>(Q.rows());
    R11.push_back(Q * friction);
    tops.push_back(Q * top);
    for (int r = c.drive; r < c.size(); ++r) bottom.add(spread.row(r).data());
    if (!curved) continue;
    const RowMajor beyond = top - Q.transpose() * tops.back();  // what no friction reaches
    for (Index r = 0; r < beyond.rows(); ++r) bottom.add(beyond.row(r).data());
  }
  bottom.flush();
  const Eigen::Map<const RowMajor> B(bottom.R(), b + 1, b + 1);
  S = B.topLeftCorner(b, b);
  s = B.topRightCorner(b, 1);
  rho = B(b, b);
  m.resize(rows);
  M.resize(rows, inertial());
  m.head(b) = s;
  M.topRows(b) = S * data.base().G;
  for (int j = 0; j < n(); ++j) {
    const RowMajor& top = tops[static_cast<std::size_t>(j)];
    m.segment(row[static_cast<std::size_t>(j)], top.rows()) = top.col(b);
    M.middleRows(row[static_cast<std::size_t>(j)], top.rows()) = top.leftCols(b) * data.base().G;
  }
  batch = numerics::BatchMatrix(static_cast<std::size_t>(rows), static_cast<std::size_t>(M.cols()), M.data());
}

double Problem::Impl::fit(int joint, const double* eta, double* rhs, double* scratch, double* phi, unsigned* active) const {
  const DriveTerms& t = terms[static_cast<std::size_t>(joint)];
  const RowMajor& R = R11[static_cast<std::size_t>(joint)];
  const int rows = static_cast<int>(R.rows()), unknowns = t.size();
  bool nonnegative[kMostTerms];
  for (int k = 0; k < unknowns; ++k) nonnegative[k] = t.nonnegative(k);
  double* T = scratch;
  if (t.curved()) {
    const JointDrive s_j = shape(joint, eta);
    const std::vector<double>& nodes = data.speed_nodes(joint);
    const int grid = static_cast<int>(nodes.size());
    double* curve = scratch + static_cast<std::ptrdiff_t>(rows) * unknowns;
    for (int k = 0; k < t.curves(); ++k) {
      for (int i = 0; i < grid; ++i) curve[i] = t.curve(s_j, k, nodes[static_cast<std::size_t>(i)]);
      for (int r = 0; r < rows; ++r) {
        double sum = 0;
        for (int i = 0; i < grid; ++i) sum += R(r, i) * curve[i];
        T[k * rows + r] = sum;
      }
    }
    for (int k = t.curves(); k < unknowns; ++k)
      for (int r = 0; r < rows; ++r) T[k * rows + r] = R(r, grid + k - t.curves());
  } else {
    for (int k = 0; k < unknowns; ++k)
      for (int r = 0; r < rows; ++r) T[k * rows + r] = R(r, k);
  }
  return solve_nonnegative(rows, unknowns, T, rows, rhs, nonnegative, phi, active);
}

Problem::Problem(const TorqueData& data, const robot::RobotModel& prior, const ProblemOptions& options)
    : impl_(std::make_unique<Impl>(data, prior, options)) {}
Problem::~Problem() = default;
Problem::Problem(Problem&&) noexcept = default;
Problem& Problem::operator=(Problem&&) noexcept = default;

int Problem::dimensions() const { return static_cast<int>(impl_->lower.size()); }
const VectorXd& Problem::lower() const { return impl_->lower; }
const VectorXd& Problem::upper() const { return impl_->upper; }
const TorqueData& Problem::data() const { return impl_->data; }
const VectorXd& Problem::sigma() const { return impl_->sigma; }
const Floor& Problem::floor() const { return impl_->floor; }
const Excitation& Problem::excitation() const { return impl_->excitation; }

namespace {

constexpr std::size_t kLanes = numerics::BatchMatrix::kLanes;

/// π of a body at eight points, as LogCholesky::parameters, and the divergence from the prior added to `pull`. `u`: U_0.
void body_parameters(const Eigen::Matrix4d& u, const double* xi, std::size_t stride, double* pi, double* pull) {
  for (std::size_t k = 0; k < kLanes; ++k) {
    const auto at = [&](std::size_t i) { return xi[i * stride + k]; };
    const double e = std::exp(at(0));
    const double v00 = e * std::exp(at(1)), v11 = e * std::exp(at(2)), v22 = e * std::exp(at(3));
    const double v01 = e * at(4), v12 = e * at(5), v02 = e * at(6), v03 = e * at(7), v13 = e * at(8), v23 = e * at(9);
    pull[k] += e * e + v00 * v00 + v11 * v11 + v22 * v22 + v01 * v01 + v12 * v12 + v02 * v02 + v03 * v03 + v13 * v13 +
               v23 * v23 - 4 - 2 * (4 * at(0) + at(1) + at(2) + at(3));
    const double u00 = u(0, 0) * v00, u01 = u(0, 0) * v01 + u(0, 1) * v11, u02 = u(0, 0) * v02 + u(0, 1) * v12 + u(0, 2) * v22,
                 u03 = u(0, 0) * v03 + u(0, 1) * v13 + u(0, 2) * v23 + u(0, 3) * e;
    const double u11 = u(1, 1) * v11, u12 = u(1, 1) * v12 + u(1, 2) * v22, u13 = u(1, 1) * v13 + u(1, 2) * v23 + u(1, 3) * e;
    const double u22 = u(2, 2) * v22, u23 = u(2, 2) * v23 + u(2, 3) * e, u33 = u(3, 3) * e;
    const double xx = u00 * u00 + u01 * u01 + u02 * u02 + u03 * u03, yy = u11 * u11 + u12 * u12 + u13 * u13,
                 zz = u22 * u22 + u23 * u23;
    const double values[10] = {u33 * u33,
                               u03 * u33,
                               u13 * u33,
                               u23 * u33,
                               yy + zz,
                               -(u01 * u11 + u02 * u12 + u03 * u13),
                               -(u02 * u22 + u03 * u23),
                               xx + zz,
                               -(u12 * u22 + u13 * u23),
                               xx + yy};
    for (std::size_t i = 0; i < 10; ++i) pi[i * kLanes + k] = values[i];
  }
}

}  // namespace

std::size_t Problem::scratch_doubles() const {
  const auto tall = static_cast<std::size_t>(impl_->tall), wide = static_cast<std::size_t>(impl_->wide);
  return static_cast<std::size_t>(impl_->inertial()) * kLanes + impl_->batch.room() + tall * (wide + 3);
}

void Problem::cost(const double* xi, std::size_t stride, double* scratch, double* cost) const {
  const Impl& p = *impl_;
  double* const pi = scratch;
  double* const r = pi + static_cast<std::size_t>(p.inertial()) * kLanes;
  double* const fit = r + p.batch.room();
  double pull[kLanes] = {};
  for (std::size_t i = 0; i < p.bodies.size(); ++i)
    body_parameters(p.bodies[i].factor(), xi + 10 * i * stride, stride, pi + 10 * i * kLanes, pull);
  p.batch.times(pi, kLanes, r);
  for (std::size_t k = 0; k < kLanes; ++k) cost[k] = p.rho * p.rho + p.lambda * pull[k];
  for (std::size_t i = 10 * p.bodies.size(); i < static_cast<std::size_t>(dimensions()); ++i)
    for (std::size_t k = 0; k < kLanes; ++k) cost[k] += p.lambda_shape * xi[i * stride + k] * xi[i * stride + k];
  for (std::size_t i = 0; i < static_cast<std::size_t>(p.base_count()); ++i)
    for (std::size_t k = 0; k < kLanes; ++k) {
      const double e = r[i * kLanes + k] - p.s[static_cast<Index>(i)];
      cost[k] += e * e;
    }
  double* const rhs = fit + static_cast<std::ptrdiff_t>(p.tall) * (p.wide + 1);
  double phi[kMostTerms], eta[2];
  for (int j = 0; j < p.n(); ++j) {
    const DriveTerms& t = p.terms[static_cast<std::size_t>(j)];
    const RowMajor& R = p.R11[static_cast<std::size_t>(j)];
    const int first = p.row[static_cast<std::size_t>(j)], rows = static_cast<int>(R.rows()), nonlinear = p.first_nonlinear(j);
    for (std::size_t k = 0; k < kLanes; ++k) {
      for (int i = 0; i < rows; ++i) rhs[i] = p.m[first + i] - r[static_cast<std::size_t>(first + i) * kLanes + k];
      if (!t.curved()) {
        // Most often nothing is held at zero: then the triangle is solved and nothing is left.
        bool inside = true;
        for (int i = rows - 1; i >= 0 && inside; --i) {
          double x = rhs[i];
          for (int c = i + 1; c < rows; ++c) x -= R(i, c) * phi[c];
          phi[i] = x / R(i, i);
          inside = std::isfinite(phi[i]) && !(t.nonnegative(i) && phi[i] < 0);
        }
        if (inside) continue;
      }
      for (int i = 0; i < t.nonlinear(); ++i) eta[i] = xi[static_cast<std::size_t>(nonlinear + i) * stride + k];
      cost[k] += p.fit(j, eta, rhs, fit, phi);
    }
  }
}

double Problem::cost(const VectorXd& xi) const {
  std::vector<double> lanes(static_cast<std::size_t>(dimensions()) * kLanes), scratch(scratch_doubles());
  for (Index i = 0; i < xi.size(); ++i)
    std::fill_n(lanes.begin() + static_cast<std::ptrdiff_t>(i) * static_cast<std::ptrdiff_t>(kLanes), kLanes, xi[i]);
  double costs[kLanes];
  cost(lanes.data(), kLanes, scratch.data(), costs);
  return costs[0];
}

void Problem::residuals(const VectorXd& xi, VectorXd& r, MatrixXd* jacobian) const {
  const Impl& p = *impl_;
  const int d = dimensions(), rows = static_cast<int>(p.M.rows()), b = p.base_count();
  VectorXd pi(p.inertial());
  MatrixXd J = MatrixXd::Zero(rows, d);
  for (int i = 0; i < p.prior.body_count(); ++i) {
    Matrix10d by_xi;
    pi.segment<10>(10 * i) = p.bodies[static_cast<std::size_t>(i)].parameters(xi.segment<10>(10 * i), by_xi);
    if (jacobian) J.middleCols(10 * i, 10) = p.M.middleCols(10 * i, 10) * by_xi;
  }
  const VectorXd e = p.M * pi - p.m;  // S β − s; R12 β − u
  r.setZero(rows + 1 + d);
  r.head(b) = e.head(b);
  r[rows] = p.rho;
  MatrixXd by_pull = MatrixXd::Identity(d, d);
  VectorXd pull = xi;
  for (int i = 0; i < p.prior.body_count(); ++i) {
    const Index at = 10 * i;
    Matrix10d block;
    pull.segment<10>(at) = divergence_roots(xi.segment<10>(at), block);
    by_pull.block<10, 10>(at, at) = block;
  }
  VectorXd weight = VectorXd::Constant(d, std::sqrt(p.lambda));
  weight.tail(d - p.inertial()).setConstant(std::sqrt(p.lambda_shape));
  r.tail(d) = weight.cwiseProduct(pull);
  std::vector<double> scratch(static_cast<std::size_t>(p.tall) * static_cast<std::size_t>(p.wide + 2));
  MatrixXd C;
  for (int j = 0; j < p.n(); ++j) {
    const DriveTerms& t = p.terms[static_cast<std::size_t>(j)];
    const int first = p.row[static_cast<std::size_t>(j)], nonlinear = p.first_nonlinear(j);
    const Index height = p.R11[static_cast<std::size_t>(j)].rows();
    if (height == 0) continue;
    // The residual (T P) φ − rhs of the free unknowns' columns is −(1 − Q Qᵀ) rhs.
    const auto project = [&](const VectorXd& eta, MatrixXd& Q) -> VectorXd {
      VectorXd rhs = -e.segment(first, height), phi(kMostTerms);
      const VectorXd target = rhs;
      unsigned active = 0;
      p.fit(j, eta.data(), rhs.data(), scratch.data(), phi.data(), &active);
      t.columns_of(p.shape(j, eta.data()), C);
      MatrixXd free(height, t.size());
      int count = 0;
      for (int k = 0; k < t.size(); ++k)
        if (!(active >> k & 1)) free.col(count++) = p.R11[static_cast<std::size_t>(j)] * C.col(k);
      if (count == 0) {  // all at 0; Eigen's factorisation of no columns reads what is not there
        Q.resize(height, 0);
        return -target;
      }
      Q = numerics::orthonormal_basis(free.leftCols(count), 1e-10);
      return Q * (Q.transpose() * target) - target;
    };
    const VectorXd eta = xi.segment(nonlinear, t.nonlinear());
    MatrixXd Q;
    r.segment(first, height) = project(eta, Q);
    if (!jacobian) continue;
    auto block = J.middleRows(first, height);
    block -= (Q * (Q.transpose() * block)).eval();
    for (int k = 0; k < t.nonlinear(); ++k) {
      constexpr double kStep = 1e-5;
      VectorXd up = eta, down = eta;
      up[k] += kStep;
      down[k] -= kStep;
      MatrixXd unused;
      const VectorXd high = project(up, unused), low = project(down, unused);
      block.col(nonlinear + k) = (high - low) / (2 * kStep);
    }
  }
  if (!jacobian) return;
  jacobian->setZero(r.size(), d);
  jacobian->topRows(rows) = J;
  jacobian->bottomRows(d) = weight.asDiagonal() * by_pull;
}

Estimate Problem::estimate(const VectorXd& xi) const {
  const Impl& p = *impl_;
  Estimate estimate;
  estimate.pi.resize(p.inertial());
  for (int i = 0; i < p.prior.body_count(); ++i)
    estimate.pi.segment<10>(10 * i) = p.bodies[static_cast<std::size_t>(i)].parameters(xi.segment<10>(10 * i));
  const VectorXd e = p.M * estimate.pi - p.m;
  std::vector<double> scratch(static_cast<std::size_t>(p.tall) * static_cast<std::size_t>(p.wide + 2));
  for (int j = 0; j < p.n(); ++j) {
    const DriveTerms& t = p.terms[static_cast<std::size_t>(j)];
    VectorXd rhs = -e.segment(p.row[static_cast<std::size_t>(j)], p.R11[static_cast<std::size_t>(j)].rows());
    double phi[kMostTerms] = {};
    const VectorXd eta = xi.segment(p.first_nonlinear(j), t.nonlinear());
    p.fit(j, eta.data(), rhs.data(), scratch.data(), phi);
    estimate.drive.push_back(t.drive(p.shape(j, eta.data()), phi));
  }
  return estimate;
}

double Problem::prior_cost(const VectorXd& xi) const {
  const Impl& p = *impl_;
  double pull = 0;
  Matrix10d unused;
  for (int i = 0; i < p.prior.body_count(); ++i) pull += divergence_roots(xi.segment<10>(10 * i), unused).squaredNorm();
  return p.lambda * pull + p.lambda_shape * xi.tail(dimensions() - p.inertial()).squaredNorm();
}

std::vector<ActiveBound> Problem::active_bounds(const VectorXd& xi) const {
  constexpr double kNear = 1e-3;  // of the width of the box
  using Kind = ActiveBound::Kind;
  const Impl& p = *impl_;
  std::vector<ActiveBound> active;
  const auto look = [&](int i, Kind kind, const std::string& of) {
    const double near = kNear * (p.upper[i] - p.lower[i]);
    const bool known = !active.empty() && active.back().kind == kind && active.back().of == of;  // another axis of the body
    if (!known && (xi[i] < p.lower[i] + near || xi[i] > p.upper[i] - near)) active.push_back({kind, of});
  };
  for (int i = 0; i < p.inertial(); ++i)
    look(i,
         i % 10 == 0  ? Kind::kMass
         : i % 10 < 4 ? Kind::kStretch
         : i % 10 < 7 ? Kind::kShear
                      : Kind::kShift,
         p.prior.bodies[static_cast<std::size_t>(i / 10)].name);
  for (int j = 0; j < p.n(); ++j) {
    const std::string& of = p.prior.joints[static_cast<std::size_t>(j)].name;
    const int count = p.terms[static_cast<std::size_t>(j)].nonlinear(), at = p.first_nonlinear(j);
    if (count > 0) look(at, count == 2 ? Kind::kVR : Kind::kVS, of);
    if (count == 2) look(at + 1, Kind::kS, of);
  }
  return active;
}

double Problem::weighted_rms(const Estimate& estimate) const {
  const Impl& p = *impl_;
  return std::sqrt(p.data.squared_errors(estimate).dot(p.weights.cwiseAbs2()));
}

Estimate Problem::floor_estimate() const {
  const Impl& p = *impl_;
  Estimate estimate = estimate_of(p.prior);
  const MatrixXd& G = p.data.base().G;
  const VectorXd change = p.floor.beta - G * estimate.pi;
  estimate.pi += G.transpose() * numerics::solve_ldlt(G * G.transpose(), change);
  estimate.drive = p.floor.drive;
  return estimate;
}

}  // namespace cotwin::identification
