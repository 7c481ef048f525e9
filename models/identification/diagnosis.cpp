#include "models/identification/diagnosis.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>

#include "models/identification/log_fit.h"

namespace cotwin::identification {

using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

// Smaller drops of Σ ln rms are chance: no robot moves exactly as its model. By least squares undamaged logs reach up to 0.7 of
// them (a lag of one joint of a Panda), and more where they excite little, which robots that can exist do not confirm.
constexpr double kDropOfGravity = 0.4, kDropOfClock = 0.3, kDropOfOneLag = 0.3, kDropOfOrder = 0.5;
constexpr double kDropOfLag = 0.07;    // per joint
constexpr double kDropOfSign = -0.02;  // it is enough that nothing fits worse
constexpr double kLeastTilt = 3 * std::numbers::pi / 180, kLeastRate = 1.3, kMostRate = 5;
constexpr double kLeastFriction = 0.03;  // of a joint's torque: friction that has a sign at all
constexpr double kGoodError = 0.01;  // of a joint's torque: no model of friction is better, and smaller errors are no evidence

constexpr double kSeenFriction = 0.5;  // of its error
constexpr double kSureFriction = 10;   // standard deviations; filtered errors are not independent

constexpr std::array<double, Diagnosis::kPresliding> kWidths = {0.003, 0.01, 0.03, 0.1};  // rad, m

constexpr double kReach = 0.25, kSides = 5;  // s, longest lag that is tried; shifts on either side

/// Searches for the hypotheses that explain most.
class Search {
 public:
  Search(const robot::RobotModel& robot, const ModelOptions& options, const Diagnosis::Kept& kept,
         const std::vector<std::size_t>& at, double step)
      : log_(robot, options, kept, at.size()), robot_(robot), at_(at), step_(step), all_(log_.joints()) {
    std::vector<int> order(robot.joints.size());
    std::iota(order.begin(), order.end(), 0);
    now_ = {robot.gravity,
            1,
            order,
            order,
            std::vector<int>(order.size(), static_cast<int>(at.size() / 2)),
            std::vector<double>(order.size(), 1.0)};
  }

  Diagnosed run() {
    constexpr std::size_t kMostFindings = 4;
    std::vector<Finding> found;
    while (!all_.empty() && found.size() < kMostFindings) {
      before_ = fit(now_, kAll);
      before_few_ = fit(now_, kFew);
      candidates_.clear();
      look_at_gravity();
      look_at_clock();
      look_at_lags();
      look_at_order();
      look_at_signs();
      if (candidates_.empty()) break;
      // What explains the log by robots that cannot exist explains nothing.
      const VectorXd possible = log_.errors_of_possible(now_);
      for (Candidate& candidate : candidates_)
        candidate.drop = gained(all_, kGoodError, possible, log_.errors_of_possible(candidate.truth));
      const auto best = std::ranges::max_element(candidates_, {}, &Candidate::drop);
      if (best->drop < best->enough) break;
      now_ = best->truth;
      found.push_back(std::move(best->finding));
    }
    return {std::move(found), now_};
  }

 private:
  static constexpr std::size_t kFew = 300, kAll = 4000;  // samples
  struct Candidate {
    Finding finding;
    Hypothesis truth;
    double drop, enough;  // of the score; the least one that counts
    Fit fit;
  };

  Fit fit(const Hypothesis& h, std::size_t most) { return log_.fit(h, most); }
  double gained(const std::vector<int>& of, double least, const VectorXd& before, const VectorXd& after) const;

  bool is_confirmed(const Hypothesis& truth, double enough);
  void offer(Finding::Kind kind, const std::vector<int>& joints, double value, const Hypothesis& truth, double enough);
  std::vector<int> driven_by_friction(const Fit& fit) const;
  void look_at_gravity();
  void look_at_clock();
  void look_at_lags();
  void look_at_order();
  void look_at_signs();

  LogFit log_;
  const robot::RobotModel& robot_;
  const std::vector<std::size_t>& at_;
  double step_;
  std::vector<int> all_;  // joints that count
  Hypothesis now_;
  Fit before_, before_few_;            // of it
  std::vector<Candidate> candidates_;  // the best of each kind
};

/// Σ ln of errors before over after; errors below `least` of the torque do not count.
double Search::gained(const std::vector<int>& of, double least, const VectorXd& before, const VectorXd& after) const {
  double sum = 0;
  for (const int j : of) {
    const double enough = std::max(least * before_.torque_rms[j], 1e-300);
    sum += std::log(std::max(before[j], enough) / std::max(after[j], enough));
  }
  return sum;
}

/// Whether the score drops by as much with the friction that real joints may have.
bool Search::is_confirmed(const Hypothesis& truth, double enough) {
  const VectorXd before = log_.fit(now_, kAll, true).rms;
  return gained(all_, kGoodError, before, log_.fit(truth, kAll, true).rms) >= enough;
}

/// Keeps the candidate of its kind with the largest drop of the score.
void Search::offer(Finding::Kind kind, const std::vector<int>& joints, double value, const Hypothesis& truth, double enough) {
  const Fit after = fit(truth, kAll);
  const double drop = gained(all_, kGoodError, before_.rms, after.rms);
  const double gain = std::exp(gained(joints, kLeastError, before_.rms, after.rms) / static_cast<double>(joints.size()));
  const auto known = std::ranges::find_if(candidates_, [&](const Candidate& other) { return other.finding.kind == kind; });
  if (!(drop >= enough) || (known != candidates_.end() && drop <= known->drop)) return;
  Candidate candidate{{kind, joints, value, truth.gravity, gain, before_.rms, after.rms}, truth, drop, enough, after};
  if (known != candidates_.end())
    *known = std::move(candidate);
  else
    candidates_.push_back(std::move(candidate));
}

void Search::look_at_gravity() {
  const double g = robot_.gravity.norm();
  if (!(g > 0)) return;
  Hypothesis best = now_;
  double least = before_few_.score;
  const auto take = [&](const Vector3d& direction) {
    Hypothesis other = now_;
    other.gravity = g * direction.normalized();
    const Fit found = fit(other, kFew);
    // With masses below zero, gravity upwards explains what gravity downwards does.
    if (!(found.score < least - 1e-9) || !(found.beta.dot(log_.moments()) > 0)) return false;
    least = found.score;
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
  if (change >= std::log(kLeastRate) && change < std::log(kMostRate) - 0.2 &&  // not where the search ends
      is_confirmed(best, kDropOfClock))
    offer(Finding::Kind::kClock, all_, now_.rate / best.rate, best, kDropOfClock);
}

void Search::look_at_lags() {
  const auto look = [&](const std::vector<int>& joints, double enough) {
    const auto later = [&](std::size_t k) {
      Hypothesis other = now_;
      for (const int j : joints) other.shift[static_cast<std::size_t>(j)] = static_cast<int>(k);
      return other;
    };
    const auto scores_of = [&](std::size_t most, bool rich) {
      std::vector<double> scores;
      for (std::size_t k = 0; k < at_.size(); ++k) scores.push_back(log_.fit(later(k), most, rich).score);
      return scores;
    };
    const auto least = [](const std::vector<double>& scores) {
      return static_cast<std::size_t>(std::ranges::min_element(scores) - scores.begin());
    };
    const auto now = static_cast<std::size_t>(now_.shift[static_cast<std::size_t>(joints[0])]);
    std::vector<double> scores = scores_of(kFew, false);
    const std::size_t plain = least(scores);
    if (plain == now || !(gained(all_, kGoodError, before_.rms, fit(later(plain), kAll).rms) >= enough)) return;
    // Friction with hysteresis looks like a lag, and where there is both, like a longer one.
    std::vector<double> rich = scores_of(kAll, true);
    const std::size_t best = least(rich);
    if (best == now || !is_confirmed(later(best), enough)) return;
    if (best != plain) scores = std::move(rich);
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
  // An exchange of other joints has nothing to explain of it.
  std::erase_if(candidates_, [&](const Candidate& candidate) {
    const Finding& f = candidate.finding;
    const bool order = f.kind == Finding::Kind::kTorques || f.kind == Finding::Kind::kJoints;
    return std::ranges::any_of(driven_by_friction(candidate.fit),
                               [&](int j) { return !order || std::ranges::find(f.joints, j) != f.joints.end(); });
  });
  Hypothesis other = now_;
  for (const int j : wrong) other.sign[static_cast<std::size_t>(j)] *= -1;
  offer(Finding::Kind::kSign, wrong, 0, other, kDropOfSign);
}

}  // namespace

Diagnosis::Diagnosis(const robot::RobotModel& robot, const ModelOptions& options, double step)
    : robot_(robot), options_(options), n_(robot.joints.size()), step_(step), z_(kPresliding * n_, 0.0) {
  const double reach = std::max(1.0, std::round(kReach / step)), sides = std::min(kSides, reach);
  for (double k = -sides; k <= sides; ++k) at_.push_back(static_cast<std::size_t>(reach + std::round(k * reach / sides)));
}

void Diagnosis::add(std::size_t segment, bool measured, const double* q, const double* dq, const double* ddq, const double* tau,
                    const double* dtheta, const double* ddtheta) {
  if (segment != segment_) {
    window_.clear();
    measured_.clear();
    std::ranges::fill(z_, 0.0);
  }
  segment_ = segment;
  const double* v = dtheta ? dtheta : dq;
  // It follows the sign of the motion over a width.
  for (std::size_t k = 0; k < z_.size(); ++k) {
    const double way = v[k % n_] * step_, end = way < 0 ? -1 : 1;
    z_[k] = end + (z_[k] - end) * std::exp(-std::abs(way) / kWidths[k / n_]);
  }
  std::vector<double> row;
  for (const double* values : {q, dq, ddq, v, ddtheta ? ddtheta : ddq, tau}) row.insert(row.end(), values, values + n_);
  row.insert(row.end(), z_.begin(), z_.end());
  window_.push_back(std::move(row));
  measured_.push_back(measured ? 1 : 0);
  ++rows_;
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
    const auto z = static_cast<std::ptrdiff_t>(z_.size()), one = static_cast<std::ptrdiff_t>(n_);
    for (const std::size_t at : at_) k.tau.insert(k.tau.end(), window_[at].end() - z - one, window_[at].end() - z);
    k.z.insert(k.z.end(), window_[middle].end() - z, window_[middle].end());
    k.t.push_back(step_ * static_cast<double>(rows_ - 1));
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
      halve(k.z, z_.size());
      halve(k.t, 1);
    }
  }
  window_.pop_front();
  measured_.pop_front();
}

Diagnosed Diagnosis::findings() const {
  constexpr std::size_t kLeast = 100, kPerJoint = 25;  // samples: more than unknowns
  if (kept_.q.size() / n_ < std::max(kLeast, kPerJoint * n_)) return {};
  return Search(robot_, options_, kept_, at_, step_).run();
}

}  // namespace cotwin::identification
