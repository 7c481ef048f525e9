#include "models/energetics/power_log.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <optional>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/dynamics.h"

namespace cotwin::energetics {
namespace {

constexpr double kFastest = 30;      // rad/s, no arm is faster
constexpr double kMoves = 0.01;      // rad/s, sum over the joints of measured speeds
constexpr double kCommanded = 1e-3;  // the same of commanded speeds, which have no noise
constexpr double kGap = 5;           // times the usual step

using Columns = std::vector<std::size_t>;

/// Finds columns of a table by given or usual names.
class Finder {
 public:
  explicit Finder(const csv::Table& table) : table_(table) {}

  std::optional<std::size_t> one(const std::string& given, std::initializer_list<const char*> usual) const {
    if (!given.empty()) {
      table_.column(given);  // throws with the closest name
      return index(given);
    }
    for (const char* name : usual)
      if (const auto at = index(name)) return at;
    return {};
  }
  /// Columns name1, name2, … or name0, name1, …; none if neither name0 nor name1 is there.
  Columns joints(const std::string& given, std::initializer_list<const char*> usual) const {
    if (!given.empty()) {
      Columns found = numbered(given);
      if (found.empty()) table_.column(given + "1");  // throws with the closest name
      return found;
    }
    for (const char* name : usual) {
      Columns found = numbered(name);
      if (!found.empty()) return found;
    }
    return {};
  }

 private:
  Columns numbered(const std::string& name) const {
    const std::size_t first = index(name + "0") ? 0 : 1;
    Columns found;
    while (const auto at = index(name + std::to_string(first + found.size()))) found.push_back(*at);
    return found;
  }
  std::optional<std::size_t> index(const std::string& name) const {
    const auto at = std::ranges::find(table_.names, name);
    if (at == table_.names.end()) return {};
    return static_cast<std::size_t>(at - table_.names.begin());
  }
  const csv::Table& table_;
};

struct Layout {
  std::size_t t = 0;
  std::optional<std::size_t> power, voltage, current;
  Columns q, dq, ddq, tau, i, reference;
};

Layout layout_of(const csv::Table& table, const PowerColumns& c) {
  const Finder find(table);
  Layout l;
  const auto t = find.one(c.t, {"t", "time", "timestamp"});
  if (!t) throw Error(table.file, "has no column of time, expected t");
  l.t = *t;
  l.power = find.one(c.power, {"P", "power"});
  l.voltage = find.one(c.voltage, {"u_dc", "u", "voltage", "robot_voltage"});
  l.current = find.one(c.current, {"i_dc", "current", "robot_current"});
  if (!l.power && !(l.voltage && l.current))
    throw Error(table.file, "has no column of power, expected P in W, or u_dc in V and i_dc in A");
  l.q = find.joints(c.q, {"q"});
  l.dq = find.joints(c.dq, {"dq", "qd"});
  l.ddq = find.joints(c.ddq, {"ddq", "qdd", "ddq_ref", "qdd_ref"});
  l.tau = find.joints(c.tau, {"tau", "tau_m", "tau_ref"});
  l.i = find.joints(c.i, {"i", "i_m"});
  l.reference = find.joints(c.reference, {"dq_ref", "qd_ref"});
  const std::size_t n = l.dq.empty() ? l.q.size() : l.dq.size();
  if (n == 0)
    throw Error(table.file, "has no column of speeds, expected dq1, dq2, ... in rad/s, or positions q1, q2, ... in rad");
  for (const auto& [name, columns] : {std::pair{"q", &l.q}, std::pair{"ddq", &l.ddq}, std::pair{"tau", &l.tau},
                                      std::pair{"i", &l.i}, std::pair{"the reference", &l.reference}}) {
    if (!columns->empty() && columns->size() != n)
      throw Error(table.file, "has " + std::to_string(columns->size()) + " columns of " + name + " for " + std::to_string(n) +
                                  " joints, expected as many");
  }
  return l;
}

/// The median of the steps of time that go on, s.
double usual_step(const std::vector<double>& t) {
  std::vector<double> steps;
  for (std::size_t k = 1; k < t.size(); ++k)
    if (t[k] > t[k - 1]) steps.push_back(t[k] - t[k - 1]);
  if (steps.empty()) return 0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::ranges::nth_element(steps, middle);
  return *middle;
}

/// Where the time goes back, another recording must begin: ten rows without a gap, unlike a single damaged time.
void check_recordings(const csv::Table& table, const Layout& l, const std::vector<std::size_t>& rows,
                      const std::vector<std::size_t>& begins) {
  constexpr std::size_t kLeast = 10;
  const std::vector<double>& t = table.columns[l.t];
  const double gap = kGap * usual_step(t);
  for (const std::size_t begin : begins) {
    bool recording = begin + kLeast <= rows.size() && t[rows[begin - 1]] - t[rows[begin]] > gap;
    for (std::size_t k = begin + 1; recording && k < begin + kLeast; ++k) {
      const double step = t[rows[k]] - t[rows[k - 1]];
      recording = step > 0 && step <= gap;
    }
    if (recording) continue;
    throw Error(table.place(rows[begin], l.t), text::to_text(t[rows[begin]]) + " s after " + text::to_text(t[rows[begin - 1]]) +
                                                   " s, expected a later time, or another recording of at least " +
                                                   std::to_string(kLeast) + " rows");
  }
}

/// The rows that are used: all their values are finite, and their time is later than that of the row before, or another recording
/// begins with it.
std::vector<std::size_t> usable_rows(const csv::Table& table, const Layout& l, std::vector<std::string>& warnings) {
  std::vector<std::size_t> rows, used{l.t};
  for (const auto& one : {l.power, l.power ? std::nullopt : l.voltage, l.power ? std::nullopt : l.current})
    if (one) used.push_back(*one);
  for (const Columns* columns : {&l.q, &l.dq, &l.ddq, &l.tau, &l.i, &l.reference})
    used.insert(used.end(), columns->begin(), columns->end());
  std::size_t damaged = 0, repeated = 0;
  double before = -std::numeric_limits<double>::infinity();
  std::vector<std::size_t> begins;  // of further recordings, in `rows`
  for (std::size_t row = 0; row < table.rows(); ++row) {
    if (std::ranges::any_of(used, [&](std::size_t c) { return !std::isfinite(table.columns[c][row]); })) {
      ++damaged;
      continue;
    }
    const double t = table.columns[l.t][row];
    if (t == before) {
      ++repeated;
      continue;
    }
    if (t < before) begins.push_back(rows.size());
    before = t;
    rows.push_back(row);
  }
  check_recordings(table, l, rows, begins);
  if (damaged > 0) warnings.push_back(std::to_string(damaged) + " rows with values that are not finite were left out");
  if (repeated > 0) warnings.push_back(std::to_string(repeated) + " rows with the time of the row before were left out");
  if (rows.size() < 10) throw Error(table.file, "has " + std::to_string(rows.size()) + " usable rows, expected at least 10");
  return rows;
}

Eigen::MatrixXd values(const csv::Table& table, const std::vector<std::size_t>& rows, const Columns& columns) {
  Eigen::MatrixXd m(static_cast<Eigen::Index>(rows.size()), static_cast<Eigen::Index>(columns.size()));
  for (std::size_t c = 0; c < columns.size(); ++c)
    for (std::size_t r = 0; r < rows.size(); ++r)
      m(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)) = table.columns[columns[c]][rows[r]];
  return m;
}

/// Slopes by central differences within segments.
Eigen::MatrixXd slopes(const PowerLog& log, const Eigen::MatrixXd& x) {
  Eigen::MatrixXd d = Eigen::MatrixXd::Zero(x.rows(), x.cols());
  for (std::size_t s = 0; s < log.begins.size(); ++s) {
    const std::size_t end = s + 1 < log.begins.size() ? log.begins[s + 1] : log.t.size();
    for (std::size_t k = log.begins[s]; k < end; ++k) {
      const std::size_t a = k > log.begins[s] ? k - 1 : k, b = k + 1 < end ? k + 1 : k;
      if (a == b) continue;
      d.row(static_cast<Eigen::Index>(k)) =
          (x.row(static_cast<Eigen::Index>(b)) - x.row(static_cast<Eigen::Index>(a))) / (log.t[b] - log.t[a]);
    }
  }
  return d;
}

/// dq must be the slope of q.
void check_speeds(const PowerLog& log, const Eigen::MatrixXd& q) {
  const Eigen::MatrixXd d = slopes(log, q);
  const double squares = log.dq.squaredNorm();
  if (!(squares > 1e-6 * static_cast<double>(log.t.size()))) return;
  const double ratio = d.cwiseProduct(log.dq).sum() / squares;
  if (ratio > 0.5 && ratio < 2) return;
  const auto close_to = [&](double x) { return std::abs(ratio / x - 1) < 0.2; };
  std::string why;
  if (close_to(180 / 3.14159265358979) || close_to(3.14159265358979 / 180)) why = " (degrees in one of them?)";
  if (close_to(1e-3)) why = " (time in milliseconds?)";
  throw Error(log.place(), "the positions change " + text::to_text(ratio, 3) + " times as fast as the speeds say" + why +
                               ", expected rad, rad/s and s");
}

void find_segments(PowerLog& log) {
  const double gap = kGap * usual_step(log.t);
  std::size_t gaps = 0;
  log.begins.assign(1, 0);
  for (std::size_t k = 1; k < log.t.size(); ++k) {
    const double step = log.t[k] - log.t[k - 1];
    if (step > 0 && step <= gap) continue;
    log.begins.push_back(k);
    ++(step > 0 ? gaps : log.recordings);
  }
  if (gaps > 0)
    log.warnings.push_back(std::to_string(gaps) + (gaps == 1 ? " gap" : " gaps") + " in time, which no motion crosses");
}

void check_power(const PowerLog& log) {
  const auto [least, most] = std::ranges::minmax(log.P);
  if (most - least <= 1e-9 * std::abs(most))
    throw Error(log.place(), "the power is " + text::to_text(most) + " W all the time, expected measured values");
  double mean = 0;
  for (const double p : log.P) mean += p / static_cast<double>(log.P.size());
  if (mean <= 0)
    throw Error(log.place(), "the power is " + text::to_text(mean, 4) + " W on average, expected a robot that draws power");
}

Eigen::MatrixXd torques_of(const robot::RobotModel& robot, const PowerLog& log, const Eigen::MatrixXd& q,
                           const Eigen::MatrixXd& ddq) {
  if (static_cast<std::size_t>(robot.n()) != log.joints())
    throw Error(log.place(), "has " + std::to_string(log.joints()) + " joints, expected the " + std::to_string(robot.n()) +
                                 " of robot '" + robot.name + "'");
  const robot::Mechanism mechanism(robot);
  robot::Data data(mechanism);
  Eigen::MatrixXd tau(q.rows(), q.cols());
  inverse_dynamics_batch(mechanism, data, log.t.size(), q.data(), log.dq.data(), ddq.data(), tau.data());
  return tau;
}

PowerLog make_log(const csv::Table& table, const PowerColumns& columns, const robot::RobotModel* robot) {
  const Layout l = layout_of(table, columns);
  PowerLog log;
  log.files = {table.file};
  const std::vector<std::size_t> rows = usable_rows(table, l, log.warnings);
  for (const std::size_t row : rows) {
    log.t.push_back(table.columns[l.t][row]);
    log.P.push_back(l.power ? table.columns[*l.power][row] : table.columns[*l.voltage][row] * table.columns[*l.current][row]);
  }
  check_power(log);
  find_segments(log);
  const Eigen::MatrixXd q = values(table, rows, l.q);
  log.dq = l.dq.empty() ? slopes(log, q) : values(table, rows, l.dq);
  if (log.dq.cwiseAbs().maxCoeff() > kFastest)
    throw Error(log.place(), "a speed is " + text::to_text(log.dq.cwiseAbs().maxCoeff(), 4) + ", expected rad/s, up to " +
                                 text::to_text(kFastest));
  if (!l.dq.empty() && !l.q.empty()) check_speeds(log, q);
  log.tau = values(table, rows, l.tau);
  log.i = values(table, rows, l.i);
  if (l.tau.empty() && robot != nullptr && !l.q.empty())
    log.tau = torques_of(*robot, log, q, l.ddq.empty() ? slopes(log, log.dq) : values(table, rows, l.ddq));
  const Eigen::MatrixXd reference = values(table, rows, l.reference);
  log.moving.resize(rows.size());
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(k);
    log.moving[k] = reference.cols() > 0 ? reference.row(row).cwiseAbs().sum() > kCommanded
                                         : log.dq.row(row).cwiseAbs().sum() > kMoves * static_cast<double>(log.joints());
  }
  for (std::string& warning : log.warnings) warning = log.place() + ": " + warning;
  return log;
}

/// Appends a log of the same robot.
void append(PowerLog& log, const PowerLog& next) {
  if (next.joints() != log.joints())
    throw Error(next.place(), "has " + std::to_string(next.joints()) + " joints, expected the " + std::to_string(log.joints()) +
                                  " of " + log.place());
  for (const auto& [name, member] : {std::pair{"torques", &PowerLog::tau}, std::pair{"currents", &PowerLog::i}}) {
    const bool here = (next.*member).cols() > 0, before = (log.*member).cols() > 0;
    if (here == before) continue;
    throw Error(next.place(), std::string(here ? "has" : "lacks") + " columns of " + name +
                                  ", expected them in all logs or in none, as in " + log.place());
  }
  for (const std::size_t begin : next.begins) log.begins.push_back(log.t.size() + begin);
  log.t.insert(log.t.end(), next.t.begin(), next.t.end());
  log.P.insert(log.P.end(), next.P.begin(), next.P.end());
  log.moving.insert(log.moving.end(), next.moving.begin(), next.moving.end());
  log.warnings.insert(log.warnings.end(), next.warnings.begin(), next.warnings.end());
  log.recordings += next.recordings;
  log.files.insert(log.files.end(), next.files.begin(), next.files.end());
  for (const auto member : {&PowerLog::dq, &PowerLog::tau, &PowerLog::i}) {
    Eigen::MatrixXd all((log.*member).rows() + (next.*member).rows(), (log.*member).cols());
    all << log.*member, next.*member;
    log.*member = std::move(all);
  }
}

}  // namespace

std::string PowerLog::place() const { return text::joined(files); }

double PowerLog::power_at_rest() const {
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t k = 0; k < t.size(); ++k) {
    if (moving[k]) continue;
    sum += P[k];
    ++count;
  }
  return count > 0 ? sum / static_cast<double>(count) : std::numeric_limits<double>::quiet_NaN();
}

PowerLog read_power_log(const std::filesystem::path& file, const PowerColumns& columns, const robot::RobotModel* robot) {
  return make_log(csv::load(file), columns, robot);
}

PowerLog read_power_logs(std::span<const std::filesystem::path> files, const PowerColumns& columns,
                         const robot::RobotModel* robot) {
  if (files.empty()) throw Error("power log", "no file, expected at least one");
  PowerLog log = read_power_log(files.front(), columns, robot);
  for (const std::filesystem::path& file : files.subspan(1)) append(log, read_power_log(file, columns, robot));
  return log;
}

std::vector<LoggedMotion> motions_of(const PowerLog& log, double least) {
  std::vector<LoggedMotion> found;
  for (std::size_t s = 0; s < log.begins.size(); ++s) {
    const std::size_t first = log.begins[s], last = s + 1 < log.begins.size() ? log.begins[s + 1] : log.t.size();
    std::size_t start = last;  // last: at rest
    for (std::size_t k = first; k < last; ++k) {
      if (log.moving[k] && start == last) start = k;
      if (log.moving[k] || start == last) continue;
      const double step = log.t[k] - log.t[k - 1];
      if (log.t[k] - log.t[start] > least + 0.5 * step) found.push_back({start > first ? start - 1 : start, k});
      start = last;
    }
    if (start != last && log.t[last - 1] - log.t[start] > least) found.push_back({start > first ? start - 1 : start, last});
  }
  return found;
}

}  // namespace cotwin::energetics
