#include "models/identification/log_fit.h"

#include <algorithm>
#include <cmath>

#include "models/identification/feasible.h"
#include "models/identification/torque_data/torque_data.h"
#include "models/numerics/dense.h"
#include "models/robot/dynamics.h"

namespace cotwin::identification {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr Index kFriction = 4;  // columns of friction: two widths of Coulomb's, with the load, viscous
constexpr Index kHysteresis = Diagnosis::kPresliding;
constexpr Index kRich = 6 + kHysteresis;  // viscous and Coulomb's by direction, Stribeck's, quadratic; both by time; hysteresis

}  // namespace

LogFit::LogFit(const robot::RobotModel& robot, const ModelOptions& options, const Diagnosis::Kept& kept, std::size_t times)
    : robot_(robot), options_(options), kept_(kept), n_(robot.joints.size()), times_(times) {
  robot::RobotModel leaning = robot;
  leaning.gravity = Eigen::Vector3d(4.1, -5.3, -7.1);  // along no axis of a joint: base parameters of every mounting
  const BaseParameters base = base_parameters(leaning);
  base_ = base.columns;
  moments_ = base.G * estimate_of(robot).pi;
  for (std::size_t k = 0; k < base_.size(); ++k)
    if (base_[k] % 10 > 3) moments_[static_cast<Index>(k)] = 0;
  for (std::size_t j = 0; j < n_; ++j)
    if (counts(j)) all_.push_back(static_cast<int>(j));
}

const LogFit::Columns& LogFit::columns_of(const Hypothesis& h, std::size_t most, bool rich) {
  Columns& columns = columns_[(every(most) > 1 ? 0 : 1) + (rich ? 2 : 0)];
  if (columns.every == every(most) && columns.of.moves_alike(h)) return columns;
  robot::RobotModel robot = robot_;
  robot.gravity = h.gravity;
  const robot::Mechanism mechanism(robot);
  robot::Data scratch(mechanism);
  const auto b = static_cast<Index>(base_.size()), rows = static_cast<Index>(count(most));
  columns = {h, every(most), {}, {}};
  for (std::size_t j = 0; j < n_; ++j) {
    Index drive = 1;
    if (counts(j))
      drive = 1 + kFriction + (rich ? kRich : 0) + (options_.motor_inertia ? 1 : 0) +
              (options_.harmonics.empty() ? 0 : 2 * options_.harmonics[j]);
    columns.C.emplace_back(MatrixXd::Zero(rows, b + drive));
  }
  MatrixXd Y(robot.n(), 10 * robot.body_count());
  VectorXd q(robot.n()), dq(robot.n()), ddq(robot.n()), g(robot.n());
  for (Index k = 0; k < rows; ++k) {
    const std::size_t from = static_cast<std::size_t>(k) * every(most) * n_;
    const auto value = [&](const std::vector<double>& of, std::size_t j) {
      return of[from + static_cast<std::size_t>(h.joint[j])];
    };
    for (std::size_t j = 0; j < n_; ++j) {
      const auto i = static_cast<Index>(j);
      q[i] = value(kept_.q, j);
      dq[i] = h.rate * value(kept_.dq, j);
      ddq[i] = h.rate * h.rate * value(kept_.ddq, j);
    }
    Y.setZero();
    robot::regressor(mechanism, scratch, q, dq, ddq, Y);
    robot::gravity(mechanism, scratch, q, g);
    for (std::size_t j = 0; j < n_; ++j) {
      const auto i = static_cast<Index>(j);
      auto row = columns.C[j].row(k);
      for (Index c = 0; c < b; ++c) row[c] = Y(i, base_[static_cast<std::size_t>(c)]);
      row[b] = 1;
      if (!counts(j)) continue;
      // Friction's shape is unknown: it must not tell the rate of the clock.
      const double v = value(kept_.v, j), v_R = speed_scale(robot_.joints[j]) * options_.v_R;
      row.segment(b + 1, kFriction) << std::tanh(v / v_R), std::tanh(v / (5 * v_R)), std::abs(g[i]) * std::tanh(v / v_R), v;
      Index next = b + 1 + kFriction;
      if (rich) {
        const std::size_t sample = static_cast<std::size_t>(k) * every(most);
        const double sign = std::tanh(v / v_R), slow = v / (7.5 * v_R), t = kept_.t[sample] / kept_.t.back();
        row.segment(next, kRich - kHysteresis) << std::abs(v), std::abs(sign), sign * std::exp(-slow * slow), v * std::abs(v),
            t * sign, t * v;
        next += kRich - kHysteresis;
        const double* z = &kept_.z[(sample * Diagnosis::kPresliding) * n_ + static_cast<std::size_t>(h.joint[j])];
        for (std::size_t width = 0; width < Diagnosis::kPresliding; ++width) row[next++] = z[width * n_];
      }
      if (options_.motor_inertia) row[next++] = h.rate * h.rate * value(kept_.a, j);
      for (int harmonic = 1; next < row.size(); ++harmonic) {
        row[next++] = std::sin(harmonic * q[i]);
        row[next++] = std::cos(harmonic * q[i]);
      }
    }
  }
  for (const MatrixXd& C : columns.C) {
    MatrixXd lower = MatrixXd::Zero(C.cols(), C.cols());
    lower.selfadjointView<Eigen::Lower>().rankUpdate(C.transpose());
    columns.A.emplace_back(lower.selfadjointView<Eigen::Lower>());
  }
  return columns;
}

std::vector<VectorXd> LogFit::torques_of(const Hypothesis& h, std::size_t most) const {
  const std::size_t rows = count(most);
  std::vector<VectorXd> torques(n_, VectorXd(static_cast<Index>(rows)));
  for (std::size_t k = 0; k < rows; ++k)
    for (std::size_t j = 0; j < n_; ++j)
      torques[j][static_cast<Index>(k)] =
          h.sign[j] * kept_.tau[(k * every(most) * times_ + static_cast<std::size_t>(h.shift[j])) * n_ +
                                static_cast<std::size_t>(h.column[j])];
  return torques;
}

Fit LogFit::fit(const Hypothesis& h, std::size_t most, bool rich) {
  constexpr int kPasses = 6;
  const Columns& columns = columns_of(h, most, rich);
  const std::vector<VectorXd> torques = torques_of(h, most);
  const auto b = static_cast<Index>(base_.size()), joints = static_cast<Index>(n_);
  std::vector<Index> first;
  Index unknowns = b;
  for (const MatrixXd& C : columns.C) {
    first.push_back(unknowns);
    unknowns += C.cols() - b;
  }
  const double N = static_cast<double>(count(most));
  Fit fit{VectorXd(joints), 0, VectorXd::Zero(joints), VectorXd::Zero(joints), VectorXd(joints), {}};
  std::vector<VectorXd> right, own(n_);
  for (std::size_t j = 0; j < n_; ++j) {
    fit.torque_rms[static_cast<Index>(j)] = std::sqrt(torques[j].squaredNorm() / N);
    right.emplace_back(columns.C[j].transpose() * torques[j]);
  }
  const VectorXd least = kLeastError * fit.torque_rms.cwiseMax(1e-6 * fit.torque_rms.maxCoeff()).cwiseMax(1e-300);
  fit.rms = fit.torque_rms;
  MatrixXd A;
  VectorXd s;
  for (int pass = 0; pass < kPasses; ++pass) {
    A.setZero(unknowns, unknowns);
    VectorXd r = VectorXd::Zero(unknowns);
    for (std::size_t j = 0; j < n_; ++j) {
      if (robot_.joints[j].passive) continue;
      const double sigma = std::max(fit.rms[static_cast<Index>(j)], least[static_cast<Index>(j)]), w = 1 / (sigma * sigma);
      const MatrixXd& own_A = columns.A[j];
      const Index f = own_A.cols() - b;
      A.topLeftCorner(b, b) += w * own_A.topLeftCorner(b, b);
      A.block(first[j], 0, f, b) += w * own_A.bottomLeftCorner(f, b);
      A.block(first[j], first[j], f, f) += w * own_A.bottomRightCorner(f, f);
      r.head(b) += w * right[j].head(b);
      r.segment(first[j], f) += w * right[j].tail(f);
    }
    // What no torque depends on stays at zero, by a weight of nothing but rounding.
    s = A.diagonal().cwiseSqrt();
    s = (s.array() > 1e-9 * s.maxCoeff()).select(s.cwiseInverse(), 0.0);
    A = (s.asDiagonal() * A * s.asDiagonal()).eval();
    A.diagonal().array() += 1e-11;
    const VectorXd x = s.cwiseProduct(numerics::solve_ldlt(A, s.cwiseProduct(r)));
    fit.beta = x.head(b);
    for (std::size_t j = 0; j < n_; ++j) {
      own[j].resize(columns.C[j].cols());
      own[j] << x.head(b), x.segment(first[j], columns.C[j].cols() - b);
      const double squares = torques[j].squaredNorm() + own[j].dot(columns.A[j] * own[j] - 2 * right[j]);
      fit.rms[static_cast<Index>(j)] = std::sqrt(std::max(0.0, squares) / N);  // what rounding takes is below kLeastError
    }
  }
  for (const int j : all_) {
    const auto k = static_cast<std::size_t>(j);
    fit.score += std::log(std::max(fit.rms[j], least[j]));
    const VectorXd v = columns.C[k].col(b + kFriction);
    const double speed = v.norm();
    if (!(speed > 0)) continue;
    VectorXd power = VectorXd::Zero(unknowns);
    power.segment(first[k] + 1, kFriction) = columns.C[k].middleCols(b + 1, kFriction).transpose() * v / (speed * std::sqrt(N));
    fit.friction[j] = power.segment(first[k] + 1, kFriction).dot(own[k].segment(b + 1, kFriction));
    const VectorXd scaled = s.cwiseProduct(power);
    fit.deviation[j] = std::sqrt(std::max(0.0, scaled.dot(numerics::solve_ldlt(A, scaled))));
  }
  return fit;
}

VectorXd LogFit::errors_of_possible(const Hypothesis& h) const {
  robot::RobotModel robot = robot_;
  robot.gravity = h.gravity;
  ModelOptions options = options_;
  options.friction = FrictionLaw::kCoulomb;
  TorqueData data(robot, options);
  const std::vector<VectorXd> torques = torques_of(h, samples());
  std::vector<double> row(6 * n_);
  for (std::size_t k = 0; k < samples(); ++k) {
    for (std::size_t j = 0; j < n_; ++j) {
      const std::size_t at = k * n_ + static_cast<std::size_t>(h.joint[j]);
      const double values[6] = {kept_.q[at],
                                h.rate * kept_.dq[at],
                                h.rate * h.rate * kept_.ddq[at],
                                torques[j][static_cast<Index>(k)],
                                h.rate * kept_.v[at],
                                h.rate * h.rate * kept_.a[at]};
      for (std::size_t i = 0; i < 6; ++i) row[i * n_ + j] = values[i];
    }
    data.add(&row[0], &row[n_], &row[2 * n_], &row[3 * n_], &row[4 * n_], &row[5 * n_]);
  }
  data.flush();
  ProblemOptions weights;
  weights.prior_weight = kPriorWeightOfLogs;
  return data.rms(solve_feasible(Problem(data, robot, weights)).estimate);
}

}  // namespace cotwin::identification
