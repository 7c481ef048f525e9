// Unconstrained least squares and what it tells of the motion.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "models/identification/compass.h"
#include "models/identification/problem_impl.h"
#include "models/numerics/triangle.h"
#include "models/text/error.h"
#include "models/text/text.h"

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
  Eigen::ColPivHouseholderQR<MatrixXd> qr(A * scale.asDiagonal());
  const auto R = qr.matrixR();
  Solution solution;
  while (solution.rank < p && std::abs(R(solution.rank, solution.rank)) > kRank * std::abs(R(0, 0))) ++solution.rank;
  const Index r = solution.rank;
  const MatrixXd R_r = R.topLeftCorner(r, r).template triangularView<Eigen::Upper>();
  const VectorXd projected = (qr.householderQ().transpose() * b).head(r);
  const VectorXd y = R_r.triangularView<Eigen::Upper>().solve(projected);
  solution.x.setZero(p);
  for (Index i = 0; i < r; ++i) {
    const Index column = qr.colsPermutation().indices()[i];
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
    const Index column = qr.colsPermutation().indices()[i];
    if (p > r && shared.row(i).cwiseAbs().maxCoeff() > kShared) continue;
    solution.deviation[column] = scale[column] * inverse.row(i).norm();
    solution.determined[static_cast<std::size_t>(column)] = true;
  }
  if (r > 0) {
    const VectorXd singular = R_r.jacobiSvd().singularValues();
    solution.condition = singular[0] / singular[r - 1];
  }
  return solution;
}

/// The joint's triangle with its drive's columns multiplied by C.
MatrixXd reduced(const TorqueData& data, int j, const MatrixXd& C) {
  const TorqueData::Columns& c = data.columns(j);
  const Eigen::Map<const RowMajor> R(data.triangle(j).R(), c.size(), c.size());
  MatrixXd result(c.size(), C.cols() + c.size() - c.drive);
  result << R.leftCols(c.drive) * C, R.rightCols(c.size() - c.drive);
  return result;
}

double own_residual(const MatrixXd& A) {
  const Index p = A.cols() - 1;
  const MatrixXd left = A.leftCols(p);
  const Solution solution = solve(left, A.col(p), true);
  return (left * solution.x - A.col(p)).squaredNorm();
}

}  // namespace

void Problem::Impl::solve_floor() {
  const int b = base_count(), joints = n();
  const double N = data.weight();
  std::vector<MatrixXd> C(static_cast<std::size_t>(joints));
  std::vector<VectorXd> eta(static_cast<std::size_t>(joints));
  std::vector<int> first;  // unknown of each joint's drive
  int unknowns = 0;
  for (const DriveTerms& t : terms) {
    first.push_back(unknowns);
    unknowns += t.size();
  }
  unknowns += b;
  if (N < unknowns)
    throw Error("torque data",
                text::to_text(N, 6) + " samples, expected at least as many as unknowns, " + std::to_string(unknowns));

  // Each joint alone, with base parameters of its own: weights to begin with, and the shape of nonlinear friction.
  VectorXd tau_rms(joints), own(joints);
  for (int j = 0; j < joints; ++j) {
    const auto k = static_cast<std::size_t>(j);
    const int at = first_nonlinear(j), count = terms[k].nonlinear();
    const auto residual = [&](const VectorXd& e) {
      terms[k].columns_of(shape(j, e.data()), C[k]);
      return own_residual(reduced(data, j, C[k]));
    };
    eta[k] = VectorXd::Zero(count);
    if (count > 0) {
      const VectorXd low = lower.segment(at, count), high = upper.segment(at, count);
      eta[k] = compass(scan(low, high, 13, residual), low, high, 0.04, 2e-3, residual);
    }
    own[j] = residual(eta[k]);
    const int last = data.columns(j).size() - 1;
    const Eigen::Map<const RowMajor> R(data.triangle(j).R(), last + 1, last + 1);
    tau_rms[j] = R.col(last).norm() / std::sqrt(N);
    if (!(tau_rms[j] > 0))
      throw Error("torque of joint " + std::to_string(j + 1) + " (" + prior.joints[k].name + ")",
                  "is zero in all samples, expected a measured one");
  }
  const VectorXd least = kLeastSigma * tau_rms;
  const bool given = options.sigma.size() != 0;
  if (given && (options.sigma.size() != joints || !(options.sigma.array() > 0).all()))
    throw Error("sigma", "of " + std::to_string(options.sigma.size()) + " joints, expected " + std::to_string(joints) +
                             " values above 0");
  sigma = given ? options.sigma : (own / N).cwiseSqrt().cwiseMax(least).eval();

  const bool shaped = lower.size() > 10 * joints;

  // All joints share their bodies: weighted least squares, weights from its residuals, four times (twice does for all but the
  // last digits). Nonlinear friction follows, joint by joint, at the base parameters found.
  Solution solution;
  VectorXd rms(joints);
  MatrixXd A;
  for (int pass = 0; pass < 4; ++pass) {
    numerics::Triangle stack(static_cast<std::size_t>(unknowns) + 1);
    VectorXd line(unknowns + 1);
    for (int j = 0; j < joints; ++j) {
      const auto k = static_cast<std::size_t>(j);
      const MatrixXd R = reduced(data, j, C[k]) / sigma[j];
      const Index drive = C[k].cols();
      for (Index r = 0; r < R.rows(); ++r) {
        line.setZero();
        line.segment(first[k], drive) = R.row(r).head(drive).transpose();
        for (std::size_t i = 0; i < data.columns(j).base.size(); ++i)
          line[unknowns - b + data.columns(j).base[i]] = R(r, drive + static_cast<Index>(i));
        line[unknowns] = R(r, R.cols() - 1);
        stack.add(line.data());
      }
    }
    stack.flush();
    A = Eigen::Map<const RowMajor>(stack.R(), unknowns + 1, unknowns + 1);
    solution = solve(A.leftCols(unknowns), A.col(unknowns));
    const VectorXd beta = solution.x.tail(b);
    for (int j = 0; j < joints; ++j) {
      const auto k = static_cast<std::size_t>(j);
      const int at = first_nonlinear(j), count = terms[k].nonlinear();
      const Index drive = C[k].cols();
      const auto rest = [&](const MatrixXd& R) -> VectorXd {  // τ that the bodies leave to the drive, in rows of the triangle
        VectorXd right = R.col(R.cols() - 1);
        for (std::size_t i = 0; i < data.columns(j).base.size(); ++i)
          right -= R.col(drive + static_cast<Index>(i)) * beta[data.columns(j).base[i]];
        return right;
      };
      if (count > 0 && pass < 3) {
        const auto residual = [&](const VectorXd& e) {
          terms[k].columns_of(shape(j, e.data()), C[k]);
          MatrixXd R = reduced(data, j, C[k]), alone(R.rows(), drive + 1);
          alone << R.leftCols(drive), rest(R);
          return own_residual(alone);
        };
        eta[k] = compass(eta[k], lower.segment(at, count), upper.segment(at, count), 0.02, 5e-4, residual);
        residual(eta[k]);
      }
      const MatrixXd R = reduced(data, j, C[k]);
      rms[j] = (R.leftCols(drive) * solution.x.segment(first[k], drive) - rest(R)).norm() / std::sqrt(N);
    }
    if (pass == 3 || (given && !shaped)) break;
    const double freedom = std::sqrt(N / std::max(N - static_cast<double>(solution.rank) / joints, 1.0));
    if (!given) sigma = (freedom * rms).cwiseMax(least);
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
    floor.drive.push_back(terms[k].drive(shape(j, eta[k].data()), phi.data()));
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
