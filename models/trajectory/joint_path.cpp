#include "models/trajectory/joint_path.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"
#include "models/trajectory/spline.h"

namespace cotwin::trajectory {

namespace {

using Eigen::Index, Eigen::Vector3d, Eigen::Vector4d, Eigen::VectorXd;

constexpr double kLength = 0.3;        // m, by which rotations are scaled
constexpr double kTableError = 1e-9;   // m, rad
constexpr double kLargestStep = 0.05;  // rad, m: longer steps between two postures are divided
constexpr int kDivisions = 12;
constexpr double kWorstTableError = 1e-5;  // m, rad: within the reach of the correction
constexpr long kMostPostures = 200'000;    // per interval between two knots of the path, so that the search ends

Vector4d pure(const Vector3d& v) { return {0, v[0], v[1], v[2]}; }

/// Series of the orientation to second order.
Taylor4 orientation_series(const Vector4d& Q, const Vector3d& w, const Vector3d& dw) {
  const Vector4d dQ = 0.5 * multiply(pure(w), Q);
  return {{Q, dQ, 0.25 * (multiply(pure(dw), Q) + multiply(pure(w), dQ)), Vector4d::Zero()}};
}

bool rests(const PoseMotion& m) { return std::max({m.v.norm(), m.w.norm(), m.dv.norm(), m.dw.norm()}) < 1e-9; }

Eigen::Map<const VectorXd> row(const std::vector<double>& x, std::size_t k, Index n) {
  return {x.data() + static_cast<Index>(k) * n, n};
}
Eigen::Map<VectorXd> row(std::vector<double>& x, std::size_t k, Index n) { return {x.data() + static_cast<Index>(k) * n, n}; }

}  // namespace

JointPath::JointPath(const PosePath& poses, const Pose& X_WB, robot::InverseKinematics& kinematics, const VectorXd& reference,
                     const VectorXd& start)
    : poses_(poses), kinematics_(&kinematics), reference_(reference) {
  const Pose X_BW = X_WB.inverse();
  R_BW_ = X_BW.R;
  p_BW_ = X_BW.p;
  const Eigen::Quaterniond Q(R_BW_);
  Q_BW_ << Q.w(), Q.vec();
  const Index n = kinematics.n(), rows = kinematics.rows();
  J_.resize(rows, n);
  e_.resize(rows);
  inverse_.resize(rows, rows);

  VectorXd q = start;
  advance(poses.begin(), poses.begin(), q, 0);
  Grid all;
  for (std::size_t k = 0; k + 1 < poses.knots().size(); ++k) {
    const Grid part = solve_interval(poses.knots()[k], poses.knots()[k + 1], q);
    q = row(part.q, part.t.size() - 1, n);
    table_error_ = std::max(table_error_, part.error);
    std::size_t first = 0;
    if (k > 0) {  // the knot that both intervals share
      for (auto [whole, x] : {std::pair(&all.dq, &part.dq), std::pair(&all.ddq, &part.ddq)}) {
        auto last = row(*whole, all.t.size() - 1, n);
        last = (0.5 * (last + row(*x, 0, n))).eval();
      }
      first = 1;
    }
    all.t.insert(all.t.end(), part.t.begin() + static_cast<std::ptrdiff_t>(first), part.t.end());
    all.sigma.insert(all.sigma.end(), part.sigma.begin() + static_cast<std::ptrdiff_t>(first), part.sigma.end());
    for (auto [whole, x] : {std::pair(&all.q, &part.q), std::pair(&all.dq, &part.dq), std::pair(&all.ddq, &part.ddq)}) {
      whole->insert(whole->end(), x->begin() + static_cast<std::ptrdiff_t>(first) * n, x->end());
    }
  }
  const auto least = std::min_element(all.sigma.begin(), all.sigma.end());
  least_sigma_ = {*least, all.t[static_cast<std::size_t>(least - all.sigma.begin())]};
  sigma_ = std::move(all.sigma);
  table_ = Path(static_cast<std::size_t>(n), std::move(all.t), std::move(all.q), std::move(all.dq), std::move(all.ddq));
}

PoseMotion JointPath::in_base(double t) const {
  PoseMotion m = poses_.at(t);
  m.p = R_BW_ * m.p + p_BW_;
  m.Q = multiply(Q_BW_, m.Q);
  for (Vector3d* x : {&m.v, &m.dv, &m.ddv, &m.w, &m.dw, &m.ddw}) *x = R_BW_ * *x;
  return m;
}

robot::PoseTarget JointPath::target(double t) const {
  const PoseMotion m = in_base(t);
  return {m.p, Eigen::Quaterniond(m.Q[0], m.Q[1], m.Q[2], m.Q[3])};
}

/// The posture at `to` that continues the posture at `from`.
void JointPath::advance(double from, double to, VectorXd& q, int depth) {
  if (++postures_ > kMostPostures) {
    throw Error("inverse kinematics at " + text::to_text(to - poses_.begin(), 6) + " s",
                "more than " + std::to_string(kMostPostures) + " postures are needed for this leg, expected a shorter one");
  }
  VectorXd next = q;
  const bool found = kinematics_->track(target(to), reference_, next);
  if (found && (from == to || (next - q).cwiseAbs().maxCoeff() <= kLargestStep)) {
    q = next;
    return;
  }
  if (from < to && depth < kDivisions) {
    const double middle = 0.5 * (from + to);
    advance(from, middle, q, depth + 1);
    advance(middle, to, q, depth + 1);
    return;
  }
  const std::string place = "inverse kinematics at " + text::to_text(to - poses_.begin(), 6) + " s";
  const robot::Posture other = kinematics_->solve(target(to), q);
  if (!other.reached) throw Error(place, other.message);
  throw Error(place, "the posture would jump by " + text::to_text((other.q - q).cwiseAbs().maxCoeff(), 3) +
                         " rad or m, expected a path away from singular postures, or another start or null-space choice");
}

JointPath::Grid JointPath::solve_interval(double a, double b, const VectorXd& start) {
  const bool still =
      rests(poses_.at(a)) && rests(poses_.at(b)) && rests(poses_.at(0.5 * (a + b))) && rests(poses_.at(0.7 * a + 0.3 * b));
  if (still) return sample(a, b, 1, start);
  // At most 0.1 m or 0.3 rad from posture to posture, so that a full turn is not taken for rest.
  constexpr int kSamples = 64;
  double length = 0;
  for (int i = 0; i < kSamples; ++i) {
    const PoseMotion m = poses_.at(a + (b - a) * (i + 0.5) / kSamples);
    length += (m.v.norm() / 0.1 + m.w.norm() / 0.3) * (b - a) / kSamples;
  }
  const std::string place = "inverse kinematics from " + text::to_text(a - poses_.begin(), 6) + " s to " +
                            text::to_text(b - poses_.begin(), 6) + " s";
  constexpr std::size_t kMostParts = 8192;
  if (!(length < kMostParts)) {
    throw Error(place, "the leg needs " + text::to_text(length, 3) + " steps of 0.1 m or 0.3 rad, expected at most " +
                           std::to_string(kMostParts));
  }
  std::size_t parts = 8;
  while (static_cast<double>(parts) < length) parts *= 2;
  Grid grid;
  postures_ = 0;
  for (; parts <= kMostParts; parts *= 2) {
    grid = sample(a, b, parts, start);
    if (grid.error < kTableError) return grid;
  }
  if (grid.error < kWorstTableError) return grid;
  throw Error(place, "quintics between " + std::to_string(grid.t.size()) + " postures deviate by " +
                         text::to_text(grid.error, 3) + " m or rad, expected at most " + text::to_text(kWorstTableError) +
                         ": the leg is too long, or passes a singular posture");
}

JointPath::Grid JointPath::sample(double a, double b, std::size_t parts, const VectorXd& start) {
  const Index n = start.size();
  const std::size_t joints = static_cast<std::size_t>(n);
  Grid grid;
  VectorXd q = start;
  for (std::size_t k = 0; k <= parts; ++k) {
    const double t = k == parts ? b : a + (b - a) * static_cast<double>(k) / static_cast<double>(parts);
    if (k > 0) advance(grid.t.back(), t, q, 0);
    grid.t.push_back(t);
    grid.q.insert(grid.q.end(), q.begin(), q.end());
  }
  SplineKnots rates = solve_spline(grid.t, joints, grid.q, SplineEnds::kFree);
  grid.dq = std::move(rates.dq);
  grid.ddq = std::move(rates.ddq);
  for (std::size_t k = 0; k <= parts; ++k) {
    auto dq = row(grid.dq, k, n), ddq = row(grid.ddq, k, n);
    const PoseMotion pose = in_base(grid.t[k]);
    if (rests(pose)) {  // the posture is a function of the pose alone
      dq.setZero();
      ddq.setZero();
    }
    VectorXd corrected = row(grid.q, k, n);
    correct_derivatives(pose, corrected, dq, ddq);
    row(grid.q, k, n) = corrected;
    grid.sigma.push_back(smallest_singular_value());
  }
  const Path path(joints, grid.t, grid.q, grid.dq, grid.ddq);
  VectorXd dq(n), ddq(n);
  for (std::size_t k = 0; k < parts; ++k) {
    const double t = 0.5 * (grid.t[k] + grid.t[k + 1]);
    path.at(t, {q.data(), joints}, {dq.data(), joints}, {ddq.data(), joints});
    const auto [distance, angle] = kinematics_->error(target(t), q);
    grid.error = std::max({grid.error, distance, angle});
  }
  return grid;
}

/// (J Jᵀ + λ²)⁻¹ with λ² = 1e-12 of the trace, so that dependent rows do no harm.
void JointPath::prepare_correction() {
  Square A = J_.lazyProduct(J_.transpose());
  A.diagonal().array() += 1e-12 * A.trace();
  inverse_ = A.llt().solve(Square::Identity(A.rows(), A.rows()));
}

/// The smallest singular value that min(rows, n) independent directions have, for the J of the last correction.
double JointPath::smallest_singular_value() const {
  const std::array<bool, 6>& used = kinematics_->task().used;
  const Index rotations = std::count(used.begin() + 3, used.end(), true);
  Eigen::MatrixXd scaled = J_;
  scaled.bottomRows(rotations) *= kLength;
  return numerics::singular_values(scaled).tail<1>()[0];
}

/// The least change of x with J x = b; repeated because of the damping.
void JointPath::correct(const Rows& b, Eigen::Ref<VectorXd> x) const {
  for (int i = 0; i < 2; ++i) {
    const Rows left = b - J_.lazyProduct(x);
    const Rows y = inverse_.lazyProduct(left);
    x += J_.transpose().lazyProduct(y);
  }
}

void JointPath::correct_derivatives(const PoseMotion& pose, Eigen::Ref<VectorXd> q, Eigen::Ref<VectorXd> dq,
                                    Eigen::Ref<VectorXd> ddq) {
  const robot::PoseTarget wanted{pose.p, Eigen::Quaterniond(pose.Q[0], pose.Q[1], pose.Q[2], pose.Q[3])};
  Eigen::Map<VectorXd> e(e_.data(), e_.size());
  robot::FrameMotion at = kinematics_->linearise(wanted, q, e, J_);
  prepare_correction();
  for (int i = 0; i < 3 && e_.cwiseAbs().maxCoeff() > 1e-14; ++i) {
    q += J_.transpose().lazyProduct(Rows(inverse_.lazyProduct(e_)));
    at = kinematics_->linearise(wanted, q, e, J_);
  }
  // Pose error e(t) as a series: first with the robot at rest, then with its speed and without its acceleration.
  const bool of_tool = kinematics_->task().of_tool;
  const Taylor4 Q_d = orientation_series(pose.Q, pose.w, pose.dw);
  const auto rate = [&](const robot::FrameMotion& m, std::size_t order) {
    Vector4d Q0(m.Q.w(), m.Q.x(), m.Q.y(), m.Q.z());
    if (Q0.dot(pose.Q) < 0) Q0 = -Q0;
    const Taylor4 Q = orientation_series(Q0, m.V.tail<3>(), m.dV.tail<3>());
    Taylor4 distance{
        {pure(pose.p - m.p), pure(pose.v - m.V.head<3>()), pure(0.5 * (pose.dv - m.dV.head<3>())), Vector4d::Zero()}};
    if (of_tool) distance = conjugate(Q_d) * distance * Q_d;
    const Taylor4 rotation = of_tool ? conjugate(Q) * Q_d : Q_d * conjugate(Q);
    Rows rates(e_.size());
    const double factorial = order == 1 ? 1 : 2;
    for (Index i = 0, r = 0; i < 6; ++i) {
      if (!kinematics_->task().used[static_cast<std::size_t>(i)]) continue;
      rates[r++] = factorial * (i < 3 ? distance.c[order][1 + i] : 2 * rotation.c[order][i - 2]);
    }
    return rates;
  };
  correct(rate(at, 1), dq);
  at.V = kinematics_->twist(dq);
  at.dV = kinematics_->kinematics().bias(q, dq);
  correct(rate(at, 2), ddq);
}

void JointPath::at(double t, std::span<double> q, std::span<double> dq, std::span<double> ddq) {
  table_.at(t, q, dq, ddq);
  const Index n = reference_.size();
  Eigen::Map<VectorXd> q_out(q.data(), n), dq_out(dq.data(), n), ddq_out(ddq.data(), n);
  correct_derivatives(in_base(t), q_out, dq_out, ddq_out);
}

double JointPath::sigma_min(double t) const {
  const std::span<const double> times = table_.times();
  const std::size_t k = interval(times, t);
  const double x = std::clamp((t - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0);
  return (1 - x) * sigma_[k] + x * sigma_[k + 1];
}

}  // namespace cotwin::trajectory
