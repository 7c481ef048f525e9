// Unconstrained least squares and what it tells of the motion.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/identification/compass.h"
#include "models/identification/problem_impl.h"
#include "models/numerics/dense.h"
#include "models/numerics/triangle.h"
#include "models/robot/dynamics.h"

namespace cotwin::identification {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// Columns of a unit-length-column matrix that leave less than this of themselves beside the others count as dependent: errors
/// of the best encoders and differentiators are larger.
constexpr double kRank = 1e-8;
/// No torque sensor has more digits; below, weights would be rounding.
constexpr double kLeastSigma = 1e-6;

/// Least squares of a triangle [A | b] with columns scaled to unit length and the rank decided by pivoting.
struct Solution {
  VectorXd x;
  VectorXd deviation;            // root of diag (AᵀA)⁻¹; ∞ where not determined
  std::vector<bool> determined;  // alone, and not only in a sum with others
  int rank = 0;
  double condition = 1;
};

/// `alone`: x and rank, without what it costs to say how good they are.
Solution solve(const MatrixXd& A, const VectorXd& b, bool alone = false) {
  const Index p = A.cols();
  VectorXd scale = A.colwise().norm();
  for (double& s : scale) s = s > 0 ? 1 / s : 1;
  const numerics::PivotedQr qr = numerics::pivoted_qr(A * scale.asDiagonal(), b);
  const MatrixXd& R = qr.R;
  Solution solution;
  while (solution.rank < p && std::abs(R(solution.rank, solution.rank)) > kRank * std::abs(R(0, 0))) ++solution.rank;
  const Index r = solution.rank;
  const MatrixXd R_r = R.topLeftCorner(r, r);
  const VectorXd projected = qr.Qb.head(r);
  const VectorXd y = R_r.triangularView<Eigen::Upper>().solve(projected);
  solution.x.setZero(p);
  for (Index i = 0; i < r; ++i) {
    const Index column = qr.columns[i];
    solution.x[column] = scale[column] * y[i];
  }
  if (alone) return solution;
  const MatrixXd inverse = R_r.triangularView<Eigen::Upper>().solve(MatrixXd::Identity(r, r));
  solution.deviation.setConstant(p, std::numeric_limits<double>::infinity());
  solution.determined.assign(static_cast<std::size_t>(p), false);
  // Of columns beyond the rank, what they share with those within: unknowns that stand in such a sum are open, all of them, and
  // which of them pivoting took is rounding.
  const MatrixXd shared = R_r.triangularView<Eigen::Upper>().solve(MatrixXd(R.topRightCorner(r, p - r)));
  constexpr double kShared = 1e-6;
  for (Index i = 0; i < r; ++i) {
    const Index column = qr.columns[i];
    if (p > r && shared.row(i).cwiseAbs().maxCoeff() > kShared) continue;
    solution.deviation[column] = scale[column] * inverse.row(i).norm();
    solution.determined[static_cast<std::size_t>(column)] = true;
  }
  if (r > 0) {
    const VectorXd singular = numerics::singular_values(R_r);
    solution.condition = singular[0] / singular[r - 1];
  }
  return solution;
}

/// The joint's triangle with its drive's columns multiplied by C, without silent base parameters: scaled to unit length, what
/// is noise in them would count like motion.
MatrixXd reduced(const Problem::Impl& problem, int j, const MatrixXd& C) {
  const TorqueData::Columns& c = problem.data.columns(j);
  const Eigen::Map<const RowMajor> R(problem.data.triangle(j).R(), c.size(), c.size());
  MatrixXd result(c.size(), C.cols() + c.size() - c.drive);
  result << R.leftCols(c.drive) * C, R.rightCols(c.size() - c.drive);
  for (std::size_t i = 0; i < c.base.size(); ++i)
    if (problem.silent[static_cast<std::size_t>(c.base[i])]) result.col(C.cols() + static_cast<Index>(i)).setZero();
  return result;
}

double own_residual(const MatrixXd& A) {
  const Index p = A.cols() - 1;
  const MatrixXd left = A.leftCols(p);
  const Solution solution = solve(left, A.col(p), true);
  return (left * solution.x - A.col(p)).squaredNorm();
}

/// All joints at once, which share their bodies: the unknowns are those of the drives, joint by joint, then the base
/// parameters.
class Together {
 public:
  explicit Together(const Problem::Impl& problem) : p_(problem) {
    for (const DriveTerms& t : p_.terms) {
      first.push_back(unknowns);
      unknowns += t.size();
      eta.emplace_back(VectorXd::Zero(t.nonlinear()));
      C.emplace_back();
    }
    unknowns += p_.base_count();
  }

  std::vector<int> first;  // unknown of each joint's drive
  int unknowns = 0;
  std::vector<VectorXd> eta;  // per joint: the shape of its friction,
  std::vector<MatrixXd> C;    // and its drive's columns with that shape

  void set_shape(int j, const VectorXd& shape) {
    const auto k = static_cast<std::size_t>(j);
    eta[k] = shape;
    p_.terms[k].columns_of(p_.shape(j, shape.data()), C[k]);
  }

  /// Rows of all joints over their σ as one triangle: the unknowns' columns, what `slopes` (per joint, or none) makes of its
  /// friction columns, τ.
  MatrixXd triangle(const std::vector<MatrixXd>& slopes = {}) const {
    const int b = p_.base_count();
    Index all = unknowns + 1, at = unknowns;
    for (const MatrixXd& slope : slopes) all += slope.cols();
    numerics::Triangle stack(static_cast<std::size_t>(all));
    VectorXd line(all);
    for (int j = 0; j < p_.n(); ++j) {
      const auto k = static_cast<std::size_t>(j);
      const MatrixXd R = reduced(p_, j, C[k]) / p_.sigma[j];
      MatrixXd slope(R.rows(), 0);
      if (!slopes.empty()) slope = reduced(p_, j, slopes[k]).leftCols(slopes[k].cols()) / p_.sigma[j];
      const Index drive = C[k].cols();
      for (Index r = 0; r < R.rows(); ++r) {
        line.setZero();
        line.segment(first[k], drive) = R.row(r).head(drive).transpose();
        for (std::size_t i = 0; i < p_.data.columns(j).base.size(); ++i)
          line[unknowns - b + p_.data.columns(j).base[i]] = R(r, drive + static_cast<Index>(i));
        line.segment(at, slope.cols()) = slope.row(r).transpose();
        line[all - 1] = R(r, R.cols() - 1);
        stack.add(line.data());
      }
      at += slope.cols();
    }
    stack.flush();
    return Eigen::Map<const RowMajor>(stack.R(), all, all);
  }

  /// Shapes that are near the least error, joint by joint, come to it, all at once and with all else free: steps of Gauss and
  /// Newton, halved until the error falls, in the box.
  void shape_together() {
    constexpr int kMostSteps = 20, kMostHalvings = 12;
    constexpr double kFurthest = 0.5, kGain = 1e-13;
    const Index inertial = p_.inertial(), count = p_.lower.size() - inertial, all = unknowns + count;
    const VectorXd low = p_.lower.tail(count), high = p_.upper.tail(count);
    VectorXd best(count);
    for (int j = 0; j < p_.n(); ++j) {
      const VectorXd& own = eta[static_cast<std::size_t>(j)];
      best.segment(p_.first_nonlinear(j) - inertial, own.size()) = own;
    }
    VectorXd x;
    double least = go_to(best, x);
    for (int step = 0; step < kMostSteps; ++step) {
      MatrixXd J = triangle(slopes(x));
      const auto way = [&] { return solve(J.leftCols(all), J.col(all), true).x.tail(count).eval(); };
      VectorXd d = way();
      for (Index i = 0; i < count; ++i)  // what leads out of the box stays on its face
        if ((best[i] <= low[i] && d[i] < 0) || (best[i] >= high[i] && d[i] > 0)) J.col(unknowns + i).setZero();
      d = way().cwiseMax(-kFurthest).cwiseMin(kFurthest);
      const VectorXd from = best;
      const double before = least;
      for (int k = 0; k < kMostHalvings && !(least < before); ++k) {
        best = (from + std::ldexp(1.0, -k) * d).cwiseMax(low).cwiseMin(high);
        least = go_to(best, x);
      }
      if (!(least < before)) go_to(from, x);
      if (!(before - least > kGain * before)) return;
    }
  }

 private:
  /// Takes these shapes; x: the unknowns that fit best then. Returns what they leave.
  double go_to(const VectorXd& shapes, VectorXd& x) {
    for (int j = 0; j < p_.n(); ++j)
      set_shape(j, shapes.segment(p_.first_nonlinear(j) - p_.inertial(), eta[static_cast<std::size_t>(j)].size()));
    const MatrixXd A = triangle();
    x = solve(A.leftCols(unknowns), A.col(unknowns), true).x;
    return (A.leftCols(unknowns) * x - A.col(unknowns)).squaredNorm();
  }

  /// Per joint ∂(C φ)/∂η, by central differences.
  std::vector<MatrixXd> slopes(const VectorXd& x) const {
    constexpr double kStep = 1e-5;
    std::vector<MatrixXd> all;
    MatrixXd up, down;
    for (int j = 0; j < p_.n(); ++j) {
      const auto k = static_cast<std::size_t>(j);
      const VectorXd phi = x.segment(first[k], C[k].cols());
      all.emplace_back(C[k].rows(), eta[k].size());
      for (Index i = 0; i < eta[k].size(); ++i) {
        VectorXd shape = eta[k];
        shape[i] += kStep;
        p_.terms[k].columns_of(p_.shape(j, shape.data()), up);
        shape[i] -= 2 * kStep;
        p_.terms[k].columns_of(p_.shape(j, shape.data()), down);
        all.back().col(i) = (up - down) * phi / (2 * kStep);
      }
    }
    return all;
  }

  const Problem::Impl& p_;
};

}  // namespace

/// A base parameter is silent where ten times what the prior's bodies beyond its joint have (mass, first moment, inertia about
/// the joint's axis at q = 0) changes no joint's torque by a thousandth of its RMS: joints that stand still move by the noise
/// of their encoders.
void Problem::Impl::find_silent() {
  constexpr double kMost = 10, kShown = 1e-3, kLeastRadius = 0.05;  // m
  const robot::Mechanism mechanism(prior);
  robot::Data scratch(mechanism);
  MatrixXd inertia(n(), n());
  robot::mass_matrix(mechanism, scratch, VectorXd::Zero(n()), inertia);
  std::vector<double> mass(static_cast<std::size_t>(prior.body_count()));
  std::vector<int> order = prior.depth_first();
  for (auto i = order.rbegin(); i != order.rend(); ++i) {
    const auto k = static_cast<std::size_t>(*i);
    mass[k] += prior.bodies[k].inertia.mass;
    if (const int parent = prior.joint_of(*i).parent; parent >= 0) mass[static_cast<std::size_t>(parent)] += mass[k];
  }
  silent.assign(static_cast<std::size_t>(base_count()), 1);
  for (int j = 0; j < n(); ++j) {
    const TorqueData::Columns& c = data.columns(j);
    const Eigen::Map<const RowMajor> R(data.triangle(j).R(), c.size(), c.size());
    const double shown = kShown * R.col(c.size() - 1).norm();
    for (std::size_t i = 0; i < c.base.size(); ++i) {
      const int column = data.base().columns[static_cast<std::size_t>(c.base[i])], body = column / 10, kind = column % 10;
      const int leader = prior.leader_of(body);
      const double kg = mass[static_cast<std::size_t>(body)], I = inertia(leader, leader) + kg * kLeastRadius * kLeastRadius;
      const double value = kMost * (kind == 0 ? kg : kind < 4 ? std::sqrt(kg * I) : I);
      if (value * R.col(c.drive + static_cast<Index>(i)).norm() >= shown) silent[static_cast<std::size_t>(c.base[i])] = 0;
    }
  }
}

/// The equation of a passive joint, 0 = Y β + friction, is data as those of the others are, but zero solves it alone. At the
/// beginning it gets the size of its terms with the prior's bodies, whose sum is zero for the true ones, and the mean relative error of the other joints.
void Problem::Impl::weigh_passive(VectorXd& tau_rms, VectorXd& own) const {
  const double N = data.weight();
  double relative = 0;
  int measured = 0;
  for (int j = 0; j < n(); ++j) {
    if (prior.joints[static_cast<std::size_t>(j)].passive || !(tau_rms[j] > 0)) continue;
    relative += own[j] / N / (tau_rms[j] * tau_rms[j]);
    ++measured;
  }
  if (measured == n()) return;
  if (measured == 0) {
    throw Error("torques of robot " + prior.name,
                "all joints that moved are passive, expected a measured torque, which gives the scale of the masses");
  }
  VectorXd pi(inertial());
  for (int i = 0; i < prior.body_count(); ++i)
    pi.segment<10>(10 * i) = prior.bodies[static_cast<std::size_t>(i)].inertia.parameters();
  const VectorXd beta = data.base().G * pi;
  for (int j = 0; j < n(); ++j) {
    if (!prior.joints[static_cast<std::size_t>(j)].passive) continue;
    const TorqueData::Columns& c = data.columns(j);
    const Eigen::Map<const RowMajor> R(data.triangle(j).R(), c.size(), c.size());
    double square = 0;
    for (std::size_t i = 0; i < c.base.size(); ++i)
      square += (R.col(c.drive + static_cast<Index>(i)) * beta[c.base[i]]).squaredNorm();
    tau_rms[j] = std::sqrt(square / N);
    own[j] = N * relative / measured * tau_rms[j] * tau_rms[j];
  }
}

void Problem::Impl::solve_floor() {
  find_silent();
  const int b = base_count(), joints = n();
  const double N = data.weight();
  Together all(*this);
  const std::vector<int>& first = all.first;
  const int unknowns = all.unknowns;
  if (N < unknowns)
    throw Error("torque data",
                text::to_text(N, 6) + " samples, expected at least as many as unknowns, " + std::to_string(unknowns));

  // Each joint alone, with base parameters of its own: weights to begin with, and the shape of nonlinear friction.
  VectorXd tau_rms(joints), own(joints);
  for (int j = 0; j < joints; ++j) {
    const auto k = static_cast<std::size_t>(j);
    const int at = first_nonlinear(j), count = terms[k].nonlinear();
    const auto residual = [&](const VectorXd& e) {
      all.set_shape(j, e);
      return own_residual(reduced(*this, j, all.C[k]));
    };
    VectorXd best = VectorXd::Zero(count);
    if (count > 0) {
      const VectorXd low = lower.segment(at, count), high = upper.segment(at, count);
      best = compass(scan(low, high, 13, residual), low, high, 0.04, 2e-3, residual);
    }
    own[j] = residual(best);
    const int last = data.columns(j).size() - 1;
    const Eigen::Map<const RowMajor> R(data.triangle(j).R(), last + 1, last + 1);
    tau_rms[j] = R.col(last).norm() / std::sqrt(N);
    if (prior.joints[k].passive) continue;
    const std::vector<char>& still = data.options().still;
    if (!(tau_rms[j] > 0) && (still.empty() || !still[k]))
      throw Error("torque of joint " + std::to_string(j + 1) + " (" + prior.joints[k].name + ")",
                  "is zero in all samples, expected a measured one");
  }
  weigh_passive(tau_rms, own);
  // A joint that stands still may be explained to rounding: its weight stays finite.
  constexpr double kLeastTorque = 1e-3;  // of the largest joint's
  VectorXd least = kLeastSigma * tau_rms.cwiseMax(kLeastTorque * tau_rms.maxCoeff());
  const bool given = options.sigma.size() != 0;
  if (given && (options.sigma.size() != joints || !(options.sigma.array() > 0).all()))
    throw Error("sigma", "of " + std::to_string(options.sigma.size()) + " joints, expected " + std::to_string(joints) +
                             " values above 0");
  sigma = given ? options.sigma : (own / N).cwiseSqrt().cwiseMax(least).eval();
  for (int j = 0; j < joints; ++j)  // zero solves it to rounding, and more weight would make bodies of nothing
    if (prior.joints[static_cast<std::size_t>(j)].passive) least[j] = sigma[j];

  const bool shaped = lower.size() > inertial();

  // All joints share their bodies: weighted least squares, weights from its residuals, four times (twice does for all but the
  // last digits). Nonlinear friction follows, joint by joint, at the base parameters found; in the end together with them.
  Solution solution;
  VectorXd rms(joints);
  for (int pass = 0; pass < 4; ++pass) {
    if (shaped && pass == 3) all.shape_together();
    const MatrixXd A = all.triangle();
    solution = solve(A.leftCols(unknowns), A.col(unknowns));
    const VectorXd beta = solution.x.tail(b);
    for (int j = 0; j < joints; ++j) {
      const auto k = static_cast<std::size_t>(j);
      const int at = first_nonlinear(j), count = terms[k].nonlinear();
      const Index drive = terms[k].size();
      const auto rest = [&](const MatrixXd& R) -> VectorXd {  // τ that the bodies leave to the drive, in rows of the triangle
        VectorXd right = R.col(R.cols() - 1);
        for (std::size_t i = 0; i < data.columns(j).base.size(); ++i)
          right -= R.col(drive + static_cast<Index>(i)) * beta[data.columns(j).base[i]];
        return right;
      };
      if (count > 0 && pass < 3) {
        const auto residual = [&](const VectorXd& e) {
          all.set_shape(j, e);
          MatrixXd R = reduced(*this, j, all.C[k]), alone(R.rows(), drive + 1);
          alone << R.leftCols(drive), rest(R);
          return own_residual(alone);
        };
        residual(compass(all.eta[k], lower.segment(at, count), upper.segment(at, count), 0.02, 5e-4, residual));
      }
      const MatrixXd R = reduced(*this, j, all.C[k]);
      rms[j] = (R.leftCols(drive) * solution.x.segment(first[k], drive) - rest(R)).norm() / std::sqrt(N);
    }
    if (pass == 3 || (given && !shaped)) break;
    const double freedom = std::sqrt(N / std::max(N - static_cast<double>(solution.rank) / joints, 1.0));
    if (!given) sigma = (freedom * rms).cwiseMax(least);
  }

  for (int j = 0; j < joints; ++j) {
    const MatrixXd R = reduced(*this, j, all.C[static_cast<std::size_t>(j)]);
    floor.joint_unknowns.push_back(static_cast<int>(R.cols()) - 1);
    floor.joint_rank.push_back(solve(R.leftCols(R.cols() - 1), R.col(R.cols() - 1), true).rank);
  }
  floor.beta = solution.x.tail(b);
  floor.rank = solution.rank;
  floor.unknowns = unknowns;
  floor.condition = solution.condition;
  floor.rms = rms;
  floor.sigma = sigma;
  floor.cost = rms.cwiseQuotient(sigma).squaredNorm() / joints;
  for (int j = 0; j < joints; ++j) {
    const auto k = static_cast<std::size_t>(j);
    const VectorXd phi = solution.x.segment(first[k], terms[k].size());
    floor.drive.push_back(terms[k].drive(shape(j, all.eta[k].data()), phi.data()));
    for (int i = 0; i < terms[k].size(); ++i)
      excitation.unknown.push_back({terms[k].name(i), phi[i], solution.deviation[first[k] + i], 0,
                                    solution.determined[static_cast<std::size_t>(first[k] + i)]});
  }
  for (int i = 0; i < b; ++i) {
    const int k = unknowns - b + i;
    excitation.unknown.push_back(
        {data.base().name(i), solution.x[k], solution.deviation[k], 0, solution.determined[static_cast<std::size_t>(k)]});
  }
}

void Problem::Impl::judge() {
  Excitation& e = excitation;
  e.structural = base_count();
  e.unknowns = floor.unknowns;
  e.rank = floor.rank;
  e.condition = floor.condition;
  std::string vague;
  int count = 0;
  for (Determination& u : e.unknown) {
    u.relative = u.value != 0 ? u.deviation / std::abs(u.value) : std::numeric_limits<double>::infinity();
    if (u.determined && u.relative <= 1) continue;
    ++count;
    if (count <= 8) vague += (count > 1 ? ", " : "") + u.name.substr(0, u.name.find(' '));
  }
  if (e.rank < e.unknowns)
    e.warnings.push_back("the motion determines " + std::to_string(e.rank) + " of " + std::to_string(e.unknowns) +
                         " unknowns: the others are left to the prior");
  if (e.condition > 1e3)
    e.warnings.push_back("the condition number of the regressor is " + text::to_text(e.condition, 3) +
                         ", expected below 1000 (exciting trajectories reach 20 to 200)");
  if (count > 0)
    e.warnings.push_back(std::to_string(count) + " of " + std::to_string(e.unknowns) +
                         " unknowns have a standard deviation above their own value: " + vague + (count > 8 ? ", ..." : ""));
  if (data.weight() < 10 * floor.unknowns)
    e.warnings.push_back(text::to_text(data.weight(), 6) + " samples for " + std::to_string(floor.unknowns) +
                         " unknowns, expected ten times as many");
}

}  // namespace cotwin::identification
