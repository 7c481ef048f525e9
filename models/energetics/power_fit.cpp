#include "models/energetics/power_fit.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"

namespace cotwin::energetics {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::pair<const char*, PowerModel> kModels[] = {
    {"constant", PowerModel::kConstant}, {"work", PowerModel::kWork}, {"speed", PowerModel::kSpeed},
    {"motion", PowerModel::kMotion},     {"heat", PowerModel::kHeat}, {"current", PowerModel::kCurrent}};

constexpr double kDependent = 1e-9;  // of the greatest singular value of the scaled columns
constexpr double kTakesPart = 1e-6;  // component of a column in a combination that vanishes

std::vector<PowerParameter> parameters_of(PowerModel model, std::size_t joints) {
  std::vector<PowerParameter> all{{"P_0", "W", 0, true}};
  const auto per_joint = [&](const char* name, const char* si, bool nonnegative) {
    for (std::size_t j = 1; j <= joints; ++j) all.push_back({name + std::to_string(j), si, j, nonnegative});
  };
  if (model == PowerModel::kCurrent) {
    per_joint("k_", "N.m/A", true);
    per_joint("r_", "Ohm", true);
    return all;
  }
  if (model != PowerModel::kConstant) all.push_back({"a", "1", 0, false});
  if (model == PowerModel::kSpeed) all.push_back({"c", "N.m", 0, true});
  if (model == PowerModel::kMotion || model == PowerModel::kHeat) {
    per_joint("c_", "N.m", true);
    per_joint("d_", "N.m.s/rad", true);
  }
  if (model == PowerModel::kHeat) per_joint("r_", "W/(N2.m2)", true);
  return all;
}

/// The values that the parameters multiply at a sample, in the order of parameters_of().
void write_row(PowerModel model, const PowerLog& log, std::size_t sample, Eigen::Ref<Eigen::RowVectorXd> row) {
  const auto k = static_cast<Index>(sample), n = log.dq.cols();
  const auto dq = log.dq.row(k);
  row[0] = 1;
  if (model == PowerModel::kConstant) return;
  if (model == PowerModel::kCurrent) {
    row.segment(1, n) = log.i.row(k).cwiseProduct(dq);
    row.segment(1 + n, n) = log.i.row(k).cwiseAbs2();
    return;
  }
  row[1] = log.tau.row(k).dot(dq);
  if (model == PowerModel::kWork) return;
  if (model == PowerModel::kSpeed) {
    row[2] = dq.cwiseAbs().sum();
    return;
  }
  row.segment(2, n) = dq.cwiseAbs();
  row.segment(2 + n, n) = dq.cwiseAbs2();
  if (model == PowerModel::kHeat) row.segment(2 + 2 * n, n) = log.tau.row(k).cwiseAbs2();
}

struct Solution {
  VectorXd x;
  std::vector<Index> free;  // columns that are not at their bound
};

/// min |A x − b| with x_k ≥ 0 where `bounded`. Columns of A have length 1 or 0.
Solution solve(const MatrixXd& A, const VectorXd& b, const std::vector<bool>& bounded) {
  const Index m = A.cols();
  std::vector<bool> in(bounded.size());
  for (std::size_t k = 0; k < in.size(); ++k) in[k] = !bounded[k] && A.col(static_cast<Index>(k)).squaredNorm() > 0;
  Solution s{VectorXd::Zero(m), {}};
  const auto least_squares = [&] {
    s.free.clear();
    for (Index k = 0; k < m; ++k)
      if (in[static_cast<std::size_t>(k)]) s.free.push_back(k);
    VectorXd x = VectorXd::Zero(m);
    if (!s.free.empty()) {
      const MatrixXd part = A(Eigen::all, s.free);
      x(s.free) = numerics::least_squares(part, b);
    }
    return x;
  };
  s.x = least_squares();
  const double negligible = 1e-10 * b.norm();
  for (Index round = 0; round < 3 * m; ++round) {
    // The bounded column that improves the fit most enters.
    const VectorXd gradient = A.transpose() * (b - A * s.x);
    Index best = -1;
    for (Index k = 0; k < m; ++k) {
      const auto c = static_cast<std::size_t>(k);
      if (bounded[c] && !in[c] && gradient[k] > (best < 0 ? negligible : gradient[best])) best = k;
    }
    if (best < 0) break;
    in[static_cast<std::size_t>(best)] = true;
    // Goes from x to the unbounded solution as far as no bounded column becomes negative; the one that does leaves.
    for (Index inner = 0; inner < 3 * m; ++inner) {
      const VectorXd target = least_squares();
      double share = 1;
      Index leaves = -1;
      for (const Index k : s.free) {
        if (!bounded[static_cast<std::size_t>(k)] || target[k] > 0) continue;
        const double at = s.x[k] / std::max(s.x[k] - target[k], 1e-300);
        if (leaves < 0 || at < share) {
          share = at;
          leaves = k;
        }
      }
      if (leaves < 0) {
        s.x = target;
        break;
      }
      s.x += share * (target - s.x);
      s.x[leaves] = 0;
      in[static_cast<std::size_t>(leaves)] = false;
    }
  }
  return s;
}

/// Finds what the columns of A (length 1 or 0) do not tell.
void find_untold(const MatrixXd& A, std::vector<PowerParameter>& parameters) {
  for (std::size_t k = 0; k < parameters.size(); ++k)
    if (!(A.col(static_cast<Index>(k)).squaredNorm() > 0)) parameters[k].told = Told::kUnexcited;
  const MatrixXd R = numerics::qr_triangle(A);
  const numerics::Svd svd = numerics::svd(R);
  const VectorXd& sigma = svd.values;
  for (Index c = 0; c < A.cols(); ++c) {
    if (c < sigma.size() && sigma[c] > kDependent * sigma[0]) continue;
    for (std::size_t k = 0; k < parameters.size(); ++k) {
      if (parameters[k].told == Told::kValue && std::abs(svd.V(static_cast<Index>(k), c)) > kTakesPart)
        parameters[k].told = Told::kDependent;
    }
  }
}

void require_columns(const PowerLog& log, PowerModel model) {
  const bool current = model == PowerModel::kCurrent, tau = !current && model != PowerModel::kConstant;
  if (current && log.i.cols() == 0) throw Error(log.place(), "has no columns of currents, expected i1, i2, ... in A");
  if (tau && log.tau.cols() == 0)
    throw Error(log.place(),
                "has no columns of torques, expected tau1, tau2, ... in N.m, or a robot and positions to compute them");
}

/// Torque constants below zero are noise, or currents with the other sign.
void check_signs(const PowerLog& log, const PowerFit& plain) {
  for (const PowerParameter& p : plain.parameters) {
    if (p.name[0] != 'k' || p.told != Told::kValue || p.value >= -5 * p.error) continue;
    throw Error(log.place(), p.name + " = " + text::to_text(p.value, 4) + " N.m/A (standard error " +
                                 text::to_text(p.error, 2) +
                                 "), expected a current that is positive where it accelerates the joint in its direction");
  }
}

/// The gain a must be about 1.
void check_gain(const PowerLog& log, const PowerFit& fit) {
  for (const PowerParameter& p : fit.parameters) {
    if (p.name != "a" || p.told != Told::kValue) continue;
    if ((p.value > 0.5 && p.value < 2) || std::abs(p.value - 1) <= 5 * p.error) return;
    throw Error(log.place(), "the power rises by " + text::to_text(p.value, 3) +
                                 " times the mechanical power (standard error " + text::to_text(p.error, 2) +
                                 "), expected about 1: power in W, torques in N.m behind the gear, " +
                                 "speeds in rad/s, time of the wattmeter as that of the robot");
  }
}

PowerFit fit_unchecked(const PowerLog& log, PowerModel model, const std::vector<bool>& use, FitOptions options) {
  PowerFit fit{.model = model, .parameters = parameters_of(model, log.joints())};
  std::vector<std::size_t> samples;
  for (std::size_t k = 0; k < log.t.size(); ++k)
    if (use.empty() || use[k]) samples.push_back(k);
  fit.samples = samples.size();
  const auto m = static_cast<Index>(fit.parameters.size()), rows = static_cast<Index>(samples.size());
  if (rows <= m)
    throw Error(log.place(), std::to_string(rows) + " samples for " + std::to_string(m) + " parameters, expected more");
  MatrixXd A(rows, m);
  VectorXd b(rows);
  Eigen::RowVectorXd row(m);
  for (Index r = 0; r < rows; ++r) {
    const std::size_t k = samples[static_cast<std::size_t>(r)];
    write_row(model, log, k, row);
    A.row(r) = row;
    b[r] = log.P[k];
  }
  Index gain = -1;
  for (Index c = 0; c < m; ++c)
    if (fit.parameters[static_cast<std::size_t>(c)].name == "a") gain = c;
  if (options.gain_is_one && gain >= 0) {
    b -= A.col(gain);
    A.col(gain).setZero();
  }
  VectorXd length = A.colwise().norm();
  for (Index c = 0; c < m; ++c) {
    // What is below rounding of sensors (1e-9) against the others is no excitation.
    if (length[c] > 1e-12 * std::sqrt(static_cast<double>(rows))) {
      A.col(c) /= length[c];
    } else {
      A.col(c).setZero();
      length[c] = 1;
    }
  }
  std::vector<bool> bounded;
  for (const PowerParameter& p : fit.parameters) bounded.push_back(p.nonnegative && options.nonnegative);
  find_untold(A, fit.parameters);
  const Solution s = solve(A, b, bounded);
  const double squares = (b - A * s.x).squaredNorm();
  fit.rmse = std::sqrt(squares / static_cast<double>(rows));
  const MatrixXd part = A(Eigen::all, s.free);
  const numerics::PivotedQr qr = numerics::pivoted_qr(part, b);
  const Index rank = qr.rank;
  MatrixXd inverse = MatrixXd::Identity(rank, rank);
  qr.R.topLeftCorner(rank, rank).triangularView<Eigen::Upper>().solveInPlace(inverse);
  const double variance = squares / static_cast<double>(std::max<Index>(rows - rank, 1));
  for (Index k = 0; k < m; ++k) {
    PowerParameter& p = fit.parameters[static_cast<std::size_t>(k)];
    p.value = s.x[k] / length[k];
    if (p.told == Told::kValue && p.nonnegative && options.nonnegative && s.x[k] == 0) p.told = Told::kAtZero;
  }
  for (Index k = 0; k < rank; ++k) {
    const Index column = s.free[static_cast<std::size_t>(qr.columns[k])];
    fit.parameters[static_cast<std::size_t>(column)].error = std::sqrt(variance) * inverse.row(k).norm() / length[column];
  }
  if (options.gain_is_one && gain >= 0) {
    PowerParameter& a = fit.parameters[static_cast<std::size_t>(gain)];
    a.value = 1;
    a.told = Told::kValue;
  }
  return fit;
}

HeldOut evaluate(const PowerLog& log, const std::vector<std::pair<LoggedMotion, PowerFit>>& predictions) {
  HeldOut result{.motions = predictions.size()};
  const double rest = log.power_at_rest();
  if (predictions.empty() || std::isnan(rest))
    throw Error(log.place(), "has no motions to test or no samples at rest, expected some of both");
  std::vector<double> relative;
  double squares = 0, errors = 0, motion = 0;
  std::size_t samples = 0;
  for (const auto& [m, fit] : predictions) {
    double energy = 0, error = 0, before = 0;
    for (std::size_t k = m.begin; k < m.end; ++k) {
      const double e = fit.power(log, k) - log.P[k];
      squares += e * e;
      ++samples;
      if (k > m.begin) {
        const double h = 0.5 * (log.t[k] - log.t[k - 1]);
        energy += h * (log.P[k] + log.P[k - 1]);
        error += h * (e + before);
      }
      before = e;
    }
    relative.push_back(std::abs(error / energy));
    errors += std::abs(error);
    motion += energy - rest * (log.t[m.end - 1] - log.t[m.begin]);
  }
  std::ranges::sort(relative);
  const std::size_t half = relative.size() / 2;
  result.rmse = std::sqrt(squares / static_cast<double>(samples));
  result.median = relative.size() % 2 == 1 ? relative[half] : 0.5 * (relative[half - 1] + relative[half]);
  result.largest = relative.back();
  result.motion_part = errors / motion;
  return result;
}

}  // namespace

PowerModel parse_power_model(const std::string& place, const std::string& name) { return text::choose(place, name, kModels); }

const char* name_of(PowerModel model) { return text::word_of(model, kModels); }

double PowerFit::value(const std::string& name) const {
  for (const PowerParameter& p : parameters)
    if (p.name == name) return p.value;
  return 0;
}

double PowerFit::power(const PowerLog& log, std::size_t sample) const {
  Eigen::RowVectorXd row(static_cast<Index>(parameters.size()));
  write_row(model, log, sample, row);
  double sum = 0;
  for (std::size_t k = 0; k < parameters.size(); ++k) sum += row[static_cast<Index>(k)] * parameters[k].value;
  return sum;
}

PowerFit fit_power(const PowerLog& log, PowerModel model, const std::vector<bool>& use, FitOptions options) {
  require_columns(log, model);
  const PowerFit fit = fit_unchecked(log, model, use, options);
  if (!options.gain_is_one) check_gain(log, fit);
  if (model == PowerModel::kCurrent && options.nonnegative)
    check_signs(log, fit_unchecked(log, model, use, {.nonnegative = false}));
  return fit;
}

HeldOut leave_one_out(const PowerLog& log, PowerModel model, FitOptions options) {
  std::vector<std::pair<LoggedMotion, PowerFit>> predictions;
  for (const LoggedMotion& motion : motions_of(log)) {
    std::vector<bool> use(log.t.size(), true);
    std::fill(use.begin() + static_cast<std::ptrdiff_t>(motion.begin), use.begin() + static_cast<std::ptrdiff_t>(motion.end),
              false);
    predictions.emplace_back(motion, fit_power(log, model, use, options));
  }
  return evaluate(log, predictions);
}

HeldOut train_before(const PowerLog& log, PowerModel model, double t_split, FitOptions options) {
  std::vector<bool> use(log.t.size());
  for (std::size_t k = 0; k < use.size(); ++k) use[k] = log.t[k] < t_split;
  const PowerFit fit = fit_power(log, model, use, options);
  std::vector<std::pair<LoggedMotion, PowerFit>> predictions;
  for (const LoggedMotion& motion : motions_of(log))
    if (log.t[motion.begin] >= t_split) predictions.emplace_back(motion, fit);
  return evaluate(log, predictions);
}

}  // namespace cotwin::energetics
