#include "models/identification/diagnosis.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>

#include "models/identification/torque_data/torque_data.h"
#include "models/numerics/dense.h"
#include "models/robot/dynamics.h"

namespace cotwin::identification {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

// Smaller drops of Σ ln rms are chance: no robot moves exactly as its model. Undamaged logs of real robots reach a third to
// three quarters of them (docs/tuning.md).
constexpr double kDropOfGravity = 0.4, kDropOfClock = 0.3, kDropOfOneLag = 0.3, kDropOfOrder = 0.5;
constexpr double kDropOfLag = 0.14;    // per joint
constexpr double kDropOfSign = -0.02;  // it is enough that nothing fits worse
constexpr double kLeastTilt = 3 * std::numbers::pi / 180, kLeastRate = 1.3, kMostRate = 5;
constexpr double kLeastFriction = 0.03;  // of a joint's torque: friction that has a sign at all
constexpr double kLeastError = 1e-4;     // of a joint's torque: smaller errors are rounding,
constexpr double kGoodError = 0.01;      // and smaller ones than this no evidence: no model of friction is better

constexpr Index kFriction = 3;         // columns of friction: two widths of Coulomb's, viscous
constexpr double kSeenFriction = 0.5;  // of its error
constexpr double kSureFriction = 10;   // standard deviations; filtered errors are not independent

constexpr double kReach = 0.25, kSides = 5;  // s, longest lag that is tried; shifts on either side

/// What is taken to be true instead of the log.
struct Hypothesis {
  Vector3d gravity;
  double rate = 1;          // of the clock: true speeds over those of the log
  std::vector<int> joint;   // per joint, whose positions it has
  std::vector<int> column;  // whose torques,
  std::vector<int> shift;   // at which of the kept times,
  std::vector<double> sign;
  bool moves_alike(const Hypothesis& other) const {
    return gravity == other.gravity && rate == other.rate && joint == other.joint;
  }
};

struct Fit {
  VectorXd rms;         // n
  double score = 0;     // Σ ln rms over the joints that count
  VectorXd friction;    // n: mean power of friction over the RMS speed,
  VectorXd deviation;   // and its standard deviation under independent errors
  VectorXd torque_rms;  // n
};

/// Fits hypotheses to the samples.
class Search {
 public:
  Search(const robot::RobotModel& robot, const ModelOptions& options, const Diagnosis::Kept& kept,
         const std::vector<std::size_t>& at, double step)
      : robot_(robot), options_(options), kept_(kept), at_(at), step_(step), n_(robot.joints.size()), center_(at.size() / 2) {
    robot::RobotModel leaning = robot;
    leaning.gravity = Vector3d(4.1, -5.3, -7.1);  // along no axis of a joint: base parameters of every mounting
    base_ = base_parameters(leaning).columns;
    for (std::size_t j = 0; j < n_; ++j)
      if (counts(j)) all_.push_back(static_cast<int>(j));
    std::vector<int> order(n_);
    std::iota(order.begin(), order.end(), 0);
    now_ = {robot.gravity, 1, order, order, std::vector<int>(n_, static_cast<int>(center_)), std::vector<double>(n_, 1.0)};
  }

  std::vector<Finding> run() {
    constexpr std::size_t kMostFindings = 4;
    std::vector<Finding> found;
    if (all_.empty()) return found;
    while (found.size() < kMostFindings) {
      before_ = fit(now_, kAll);
      before_few_ = fit(now_, kFew);
      best_.reset();
      look_at_gravity();
      look_at_clock();
      look_at_lags();
      look_at_order();
      look_at_signs();
      if (!best_) break;
      now_ = best_->truth;
      found.push_back(std::move(best_->finding));
    }
    return found;
  }

 private:
  static constexpr std::size_t kFew = 300, kAll = 4000;  // samples
  struct Columns {
    Hypothesis of;
    std::size_t most = 0;
    std::vector<MatrixXd> C, A;  // per joint: of its torque, base parameters first; their products
  };
  struct Candidate {
    Finding finding;
    Hypothesis truth;
    double drop;  // of the score
    Fit fit;
  };

  bool counts(std::size_t joint) const {
    return !robot_.joints[joint].passive && (options_.still.empty() || options_.still[joint] == 0);
  }
  std::size_t samples() const { return kept_.q.size() / n_; }
  std::size_t every(std::size_t most) const { return (samples() + most - 1) / most; }
  std::size_t count(std::size_t most) const { return (samples() + every(most) - 1) / every(most); }
  const Columns& columns_of(const Hypothesis& h, std::size_t most);
  std::vector<VectorXd> torques_of(const Hypothesis& h, std::size_t most) const;
  Fit fit(const Hypothesis& h, std::size_t most);

  void offer(Finding::Kind kind, const std::vector<int>& joints, double value, const Hypothesis& truth, double enough);
  std::vector<int> driven_by_friction(const Fit& fit) const;
  void look_at_gravity();
  void look_at_clock();
  void look_at_lags();
  void look_at_order();
  void look_at_signs();

  const robot::RobotModel& robot_;
  const ModelOptions& options_;
  const Diagnosis::Kept& kept_;
  const std::vector<std::size_t>& at_;
  double step_;
  std::size_t n_, center_;
  std::vector<int> base_, all_;  // columns of the regressor; joints that count
  Columns cached_[2];            // of few and of all samples
  Hypothesis now_;
  Fit before_, before_few_;  // of it
  std::optional<Candidate> best_;
};

const Search::Columns& Search::columns_of(const Hypothesis& h, std::size_t most) {
  Columns& columns = cached_[most == kAll ? 1 : 0];
  if (columns.most == most && columns.of.moves_alike(h)) return columns;
  robot::RobotModel robot = robot_;
  robot.gravity = h.gravity;
  const robot::Mechanism mechanism(robot);
  robot::Data scratch(mechanism);
  const auto b = static_cast<Index>(base_.size()), rows = static_cast<Index>(count(most));
  columns = {h, most, {}, {}};
  for (std::size_t j = 0; j < n_; ++j) {
    Index drive = 1;
    if (counts(j))
      drive = 1 + kFriction + (options_.motor_inertia ? 1 : 0) + (options_.harmonics.empty() ? 0 : 2 * options_.harmonics[j]);
    columns.C.emplace_back(MatrixXd::Zero(rows, b + drive));
  }
  MatrixXd Y(robot.n(), 10 * robot.body_count());
  VectorXd q(robot.n()), dq(robot.n()), ddq(robot.n());
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
    for (std::size_t j = 0; j < n_; ++j) {
      const auto i = static_cast<Index>(j);
      auto row = columns.C[j].row(k);
      for (Index c = 0; c < b; ++c) row[c] = Y(i, base_[static_cast<std::size_t>(c)]);
      row[b] = 1;
      if (!counts(j)) continue;
      // Friction's shape is unknown: it must not tell the rate of the clock.
      const double v = value(kept_.v, j), v_R = speed_scale(robot_.joints[j]) * options_.v_R;
      row.segment(b + 1, kFriction) << std::tanh(v / v_R), std::tanh(v / (5 * v_R)), v;
      Index next = b + 1 + kFriction;
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

std::vector<VectorXd> Search::torques_of(const Hypothesis& h, std::size_t most) const {
  const std::size_t rows = count(most);
  std::vector<VectorXd> torques(n_, VectorXd(static_cast<Index>(rows)));
  for (std::size_t k = 0; k < rows; ++k)
    for (std::size_t j = 0; j < n_; ++j)
      torques[j][static_cast<Index>(k)] =
          h.sign[j] * kept_.tau[(k * every(most) * at_.size() + static_cast<std::size_t>(h.shift[j])) * n_ +
                                static_cast<std::size_t>(h.column[j])];
  return torques;
}

/// Least squares of all joints' torques, each weighted by the error that it had in the pass before.
Fit Search::fit(const Hypothesis& h, std::size_t most) {
  constexpr int kPasses = 6;
  const Columns& columns = columns_of(h, most);
  const std::vector<VectorXd> torques = torques_of(h, most);
  const auto b = static_cast<Index>(base_.size()), joints = static_cast<Index>(n_);
  std::vector<Index> first;
  Index unknowns = b;
  for (const MatrixXd& C : columns.C) {
    first.push_back(unknowns);
    unknowns += C.cols() - b;
  }
  const double N = static_cast<double>(count(most));
  Fit fit{VectorXd(joints), 0, VectorXd::Zero(joints), VectorXd::Zero(joints), VectorXd(joints)};
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

/// Keeps the candidate with the largest drop of the score.
void Search::offer(Finding::Kind kind, const std::vector<int>& joints, double value, const Hypothesis& truth, double enough) {
  const Fit after = fit(truth, kAll);
  const auto gained = [&](const std::vector<int>& of, double least) {
    double sum = 0;
    for (const int j : of)
      sum += std::log(std::max(before_.rms[j], least * before_.torque_rms[j]) /
                      std::max(after.rms[j], least * after.torque_rms[j]));
    return sum;
  };
  const double drop = gained(all_, kGoodError), own = gained(joints, kLeastError);
  const double gain = std::exp(own / static_cast<double>(joints.size()));
  if (!(drop >= enough) || (best_ && drop <= best_->drop)) return;
  best_ = {{kind, joints, value, truth.gravity, gain, before_.rms, after.rms}, truth, drop, after};
}

void Search::look_at_gravity() {
  const double g = robot_.gravity.norm();
  if (!(g > 0)) return;
  Hypothesis best = now_;
  double least = before_few_.score;
  const auto take = [&](const Vector3d& direction) {
    Hypothesis other = now_;
    other.gravity = g * direction.normalized();
    const double score = fit(other, kFew).score;
    if (!(score < least - 1e-9)) return false;
    least = score;
    best = std::move(other);
    return true;
  };
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y)
      for (int z = -1; z <= 1; ++z)
        if (x != 0 || y != 0 || z != 0) take(Vector3d(x, y, z));
  for (double turn = 0.3; turn > 0.004; turn /= 2)
    for (bool better = true; better;) {
      better = false;
      const Vector3d along = best.gravity / g, a = std::tan(turn) * along.unitOrthogonal(), b = along.cross(a);
      for (const Vector3d& way : {a, b, Vector3d(-a), Vector3d(-b)}) better = better || take(along + way);
    }
  const double tilt = std::atan2(best.gravity.cross(now_.gravity).norm(), best.gravity.dot(now_.gravity));
  if (tilt > kLeastTilt) offer(Finding::Kind::kGravity, all_, tilt, best, kDropOfGravity);
}

void Search::look_at_clock() {
  if (!(robot_.gravity.norm() > 0)) return;
  Hypothesis best = now_;
  double least = before_few_.score;
  const auto take = [&](double rate) {
    Hypothesis other = now_;
    other.rate = rate;
    if (std::abs(std::log(rate / now_.rate)) > std::log(kMostRate)) return false;
    const double score = fit(other, kFew).score;
    if (!(score < least - 1e-9)) return false;
    least = score;
    best = std::move(other);
    return true;
  };
  for (const double factor : {0.25, 0.35, 0.5, 0.7, 1.4, 2.0, 2.8, 4.0}) take(now_.rate * factor);
  for (double factor = 1.2; factor > 1.01; factor = std::sqrt(factor))
    while (take(best.rate * factor) || take(best.rate / factor)) {
    }
  const double change = std::abs(std::log(best.rate / now_.rate));
  if (change >= std::log(kLeastRate) && change < std::log(kMostRate) - 0.2)  // not where the search ends
    offer(Finding::Kind::kClock, all_, now_.rate / best.rate, best, kDropOfClock);
}

void Search::look_at_lags() {
  const auto look = [&](const std::vector<int>& joints, double enough) {
    const auto later = [&](std::size_t k) {
      Hypothesis other = now_;
      for (const int j : joints) other.shift[static_cast<std::size_t>(j)] = static_cast<int>(k);
      return other;
    };
    std::vector<double> scores;
    for (std::size_t k = 0; k < at_.size(); ++k) scores.push_back(fit(later(k), kFew).score);
    const auto best = static_cast<std::size_t>(std::ranges::min_element(scores) - scores.begin());
    const auto now = static_cast<std::size_t>(now_.shift[static_cast<std::size_t>(joints[0])]);
    if (best == now) return;
    // Between the times that are kept: the vertex of the parabola through three mean squares.
    double rows = static_cast<double>(at_[best]);
    if (best > 0 && best + 1 < at_.size()) {
      const auto square = [&](std::size_t k) {
        return std::exp(2 * (scores[k] - scores[best]) / static_cast<double>(joints.size()));
      };
      const double left = square(best - 1), right = square(best + 1), bend = left + right - 2;
      if (bend > 0) rows += 0.5 * (left - right) / bend * 0.5 * static_cast<double>(at_[best + 1] - at_[best - 1]);
    }
    offer(Finding::Kind::kLag, joints, step_ * (rows - static_cast<double>(at_[now])), later(best), enough);
  };
  look(all_, kDropOfLag * static_cast<double>(all_.size()));
  if (all_.size() < 2) return;
  for (const int j : all_) look({j}, kDropOfOneLag);
}

void Search::look_at_order() {
  for (std::size_t a = 0; a < all_.size(); ++a)
    for (std::size_t b = a + 1; b < all_.size(); ++b) {
      const auto i = static_cast<std::size_t>(all_[a]), j = static_cast<std::size_t>(all_[b]);
      if (robot_.joints[i].type != robot_.joints[j].type) continue;
      Hypothesis other = now_;
      std::swap(other.column[i], other.column[j]);
      std::swap(other.shift[i], other.shift[j]);
      std::swap(other.sign[i], other.sign[j]);
      const auto fits = [&] { return before_few_.score - fit(other, kFew).score >= kDropOfOrder; };
      if (fits()) offer(Finding::Kind::kTorques, {all_[a], all_[b]}, 0, other, kDropOfOrder);
      std::swap(other.joint[i], other.joint[j]);
      if (fits()) offer(Finding::Kind::kJoints, {all_[a], all_[b]}, 0, other, kDropOfOrder);
    }
}

/// Joints to which friction gives power.
std::vector<int> Search::driven_by_friction(const Fit& fit) const {
  std::vector<int> driven;
  for (const int j : all_)
    if (-fit.friction[j] >
        std::max({kLeastFriction * fit.torque_rms[j], kSeenFriction * fit.rms[j], kSureFriction * fit.deviation[j]}))
      driven.push_back(j);
  return driven;
}

/// Friction takes power from a joint. Where it gives power, torque or position has the other sign, unless the best candidate so
/// far explains that, too.
void Search::look_at_signs() {
  const std::vector<int> wrong = driven_by_friction(before_);
  if (wrong.empty()) return;
  if (best_ && !driven_by_friction(best_->fit).empty()) best_.reset();
  Hypothesis other = now_;
  for (const int j : wrong) other.sign[static_cast<std::size_t>(j)] *= -1;
  offer(Finding::Kind::kSign, wrong, 0, other, kDropOfSign);
}

}  // namespace

Diagnosis::Diagnosis(const robot::RobotModel& robot, const ModelOptions& options, double step)
    : robot_(robot), options_(options), n_(robot.joints.size()), step_(step) {
  const double reach = std::max(1.0, std::round(kReach / step)), sides = std::min(kSides, reach);
  for (double k = -sides; k <= sides; ++k) at_.push_back(static_cast<std::size_t>(reach + std::round(k * reach / sides)));
}

void Diagnosis::add(std::size_t segment, bool measured, const double* q, const double* dq, const double* ddq, const double* tau,
                    const double* dtheta, const double* ddtheta) {
  if (segment != segment_) {
    window_.clear();
    measured_.clear();
  }
  segment_ = segment;
  std::vector<double> row;
  for (const double* values : {q, dq, ddq, dtheta ? dtheta : dq, ddtheta ? ddtheta : ddq, tau})
    row.insert(row.end(), values, values + n_);
  window_.push_back(std::move(row));
  measured_.push_back(measured ? 1 : 0);
  if (window_.size() <= at_.back()) return;
  Kept& k = kept_;
  const std::size_t middle = at_[at_.size() / 2];
  if (measured_[middle] != 0 && seen_++ % every_ == 0) {
    std::size_t from = 0;
    for (std::vector<double>* to : {&k.q, &k.dq, &k.ddq, &k.v, &k.a}) {
      const auto first = window_[middle].begin() + static_cast<std::ptrdiff_t>(from);
      to->insert(to->end(), first, first + static_cast<std::ptrdiff_t>(n_));
      from += n_;
    }
    for (const std::size_t at : at_)
      k.tau.insert(k.tau.end(), window_[at].end() - static_cast<std::ptrdiff_t>(n_), window_[at].end());
    if (k.q.size() == kMost * n_) {
      every_ *= 2;
      const auto halve = [](std::vector<double>& values, std::size_t width) {
        for (std::size_t to = 0; 2 * to < values.size(); to += width)
          std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(2 * to), width,
                      values.begin() + static_cast<std::ptrdiff_t>(to));
        values.resize(kMost / 2 * width);
      };
      for (std::vector<double>* values : {&k.q, &k.dq, &k.ddq, &k.v, &k.a}) halve(*values, n_);
      halve(k.tau, n_ * at_.size());
    }
  }
  window_.pop_front();
  measured_.pop_front();
}

std::vector<Finding> Diagnosis::findings() const {
  constexpr std::size_t kLeast = 100;
  if (kept_.q.size() / n_ < kLeast) return {};
  return Search(robot_, options_, kept_, at_, step_).run();
}

}  // namespace cotwin::identification
