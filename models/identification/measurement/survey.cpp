#include "models/identification/measurement/survey.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/identification/measurement/spectrum.h"
#include "models/identification/measurement/torque_watch.h"
#include "models/robot/dynamics.h"

namespace cotwin::measurement {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::string number(double x) { return text::to_text(x, 4); }

/// Sums of two signals for their linear regression.
struct Sums {
  double n = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
  void add(double a, double b) {
    n += 1;
    x += a;
    y += b;
    xx += a * a;
    yy += b * b;
    xy += a * b;
  }
  double var_x() const { return std::max(0.0, xx / n - x / n * (x / n)); }
  double var_y() const { return std::max(0.0, yy / n - y / n * (y / n)); }
  double correlation() const {
    const double scale = std::sqrt(var_x() * var_y());
    return scale > 0 ? (xy / n - x / n * (y / n)) / scale : 0;
  }
  /// Slope of y over x.
  double slope() const { return var_x() > 0 ? (xy / n - x / n * (y / n)) / var_x() : 0; }
};

/// The sampling step at the start of a file of the log.
double first_step(const Log& log, std::size_t file, std::span<const trajectory::Axis> axes) {
  constexpr std::size_t kSteps = 4095;
  Log one = log;
  one.files = {log.files[file]};
  LogReader reader(one, axes, kInfinity);
  std::vector<double> t;
  while (t.size() <= kSteps && reader.next()) t.push_back(reader.sample().t());
  if (t.size() < 2) {
    throw Error(log.files[file].string(), "holds " + std::to_string(t.size()) + " samples, expected at least two");
  }
  return typical_step(t);
}

/// Longest gap, s, that is bridged: the filter continues the motion smoothly, and samples beside a long gap are left out
/// (Block::measured). A gap that splits the log costs the margin of a segment on both sides.
constexpr double kBridged = 1;

/// One pass over the log.
class Surveyor {
 public:
  /// `bridged`: s, steps up to this length are not gaps.
  Surveyor(const Log& log, const robot::RobotModel& robot, const SurveyOptions& options, double bridged)
      : log_(log),
        robot_(robot),
        options_(options),
        bridged_(bridged),
        axes_(trajectory::axes_of(robot)),
        n_(axes_.size()),
        mechanism_(robot),
        data_(mechanism_),
        g_(robot.n()),
        before_(n_),
        gravity_(n_),
        speed_(n_),
        watch_(n_),
        frozen_(n_),
        beyond_(n_),
        too_strong_(n_) {}

  Survey run() {
    result_.step = step();
    result_.gap = std::max(log_.format.max_gap * result_.step, bridged_);
    result_.joints.resize(n_);
    for (JointSurvey& joint : result_.joints) {
      joint.q_min = joint.tau_min = kInfinity;
      joint.q_max = joint.tau_max = -kInfinity;
    }
    MotionSpectrum spectrum(n_, result_.rate());
    LogReader reader(log_, axes_, result_.gap, result_.step);
    std::vector<double> between(n_);
    while (reader.next()) {
      const trajectory::RecordingReader& sample = reader.sample();
      if (reader.begins()) begin_segment(reader);
      // Fill lost rows linearly: the spectrum requires a constant rate.
      if (!reader.begins()) {
        const double steps = (sample.t() - t_before_) / result_.step;
        const auto lost = static_cast<std::size_t>(std::max(1.0, std::round(steps - ahead_))) - 1;
        ahead_ =
            std::max(0.0, 0.98 * (ahead_ + 1 - steps));  // of the clock: of samples that are stamped in bunches none is lost
        for (std::size_t k = 1; k <= lost; ++k) {
          const double share = static_cast<double>(k) / static_cast<double>(lost + 1);
          for (std::size_t j = 0; j < n_; ++j) between[j] = before_[j] + share * (sample.q().value[j] - before_[j]);
          spectrum.add(between, false);
        }
        lost_ += lost;
      }
      look_at(sample, reader.begins());
      spectrum.add(sample.q().value, reader.begins());
    }
    repeated_ = reader.repeated();
    warnings_.insert(warnings_.end(), reader.notes().begin(), reader.notes().end());
    if (reader.left_out() > 0)
      warn(log_.files[0].string(), std::to_string(reader.left_out()) + (reader.left_out() == 1 ? " row is" : " rows are") +
                                       " left out (--skip-rows), the first for this: " + reader.why());
    finish();
    const std::vector<double> frequency = spectrum.frequency_of_share(0.95);
    for (std::size_t j = 0; j < n_; ++j) result_.joints[j].frequency = frequency[j];
    return std::move(result_);
  }

 private:
  double step() const {
    const double first = first_step(log_, 0, axes_);
    for (std::size_t f = 1; f < log_.files.size(); ++f) {
      const double other = first_step(log_, f, axes_);
      if (std::abs(other - first) > 0.05 * first) {
        throw Error(log_.files[f].string(), "is sampled every " + number(other) + " s, expected " + number(first) +
                                                " s as in " + log_.files[0].string());
      }
    }
    constexpr double kUsual = 0.5, kSlowest = 10;  // s
    if (first >= kUsual) {
      const char* const words[] = {"milliseconds? Then --time-unit ms", "microseconds? Then --time-unit us",
                                   "nanoseconds? Then --time-unit ns"};
      const int unit = first < 1e3 * kUsual ? 0 : first < 1e6 * kUsual ? 1 : 2;
      const std::string place = log_.files[0].string() + ": column of time",
                        fact = "the median step is " + number(first) + " s, expected less than 0.5 s; are these " + words[unit];
      if (first > kSlowest && log_.format.rate > 0)
        throw Error("--rate", number(log_.format.rate) + " Hz, expected at least 2 Hz");
      if (first > kSlowest) throw Error(place, fact);
      implausible(place, fact);
    }
    return first;
  }

  /// Throws Error, or adds a warning with SurveyOptions::accept.
  void implausible(const std::string& place, const std::string& what) const {
    if (!options_.accept) throw Error(place, what + " (--accept-data takes it as it is)");
    warnings_.push_back(place + ": " + what);
  }
  void warn(const std::string& place, const std::string& what) { warnings_.push_back(place + ": " + what); }

  void begin_segment(const LogReader& reader) {
    const trajectory::RecordingReader& sample = reader.sample();
    const bool gap = !result_.segments.empty() && reader.file() == file_;
    if (gap && ++gaps_ <= 3) {
      warn(sample.place(), "a gap of " + number(sample.t() - t_before_) + " s, expected at most " + number(result_.gap) +
                               " s; the log is taken in parts");
    }
    file_ = reader.file();
    result_.segments.push_back({sample.place(), file_, 0, 0});
    t_begin_ = sample.t();
  }

  void look_at(const trajectory::RecordingReader& sample, bool begins) {
    const std::vector<double>& q = sample.q().value;
    const std::vector<double>& tau = sample.tau().value;
    robot::gravity(mechanism_, data_, Eigen::Map<const Eigen::VectorXd>(q.data(), robot_.n()), g_);
    const double h = std::max(sample.t() - t_before_, result_.step);
    for (std::size_t j = 0; j < n_; ++j) {
      JointSurvey& joint = result_.joints[j];
      if (result_.samples == 0) {
        joint.q_column = sample.name(sample.q(), j);
        joint.tau_column = sample.name(sample.tau(), j);
      }
      joint.q_min = std::min(joint.q_min, q[j]);
      joint.q_max = std::max(joint.q_max, q[j]);
      joint.tau_min = std::min(joint.tau_min, tau[j]);
      joint.tau_max = std::max(joint.tau_max, tau[j]);
      check_position(sample, j);
      check_torque(sample, j);
      gravity_[j].add(g_[static_cast<Eigen::Index>(j)], tau[j]);
      if (begins) continue;
      const double speed = (q[j] - before_[j]) / h;
      joint.speed_max = std::max(joint.speed_max, std::abs(speed));
      check_speed(sample, j, q[j] - before_[j], h);
    }
    for (std::size_t j = 0; j < n_; ++j)
      if (watch_[j].add(sample.t(), q[j], tau[j], begins)) frozen_[j] = sample.place(sample.tau(), j);
    if (sample.dq().present()) compare_speeds(sample, begins);
    result_.has_speeds = sample.dq().present();
    before_ = q;
    t_before_ = sample.t();
    ++result_.samples;
    Segment& segment = result_.segments.back();
    ++segment.samples;
    segment.duration = sample.t() - t_begin_;
  }

  /// Over 50 ms: between two samples, positions are often equal but for the resolution of the encoder.
  void compare_speeds(const trajectory::RecordingReader& sample, bool begins) {
    constexpr double kTime = 0.05;  // s
    if (begins) count_ = 0;
    if (count_ > 0 && sample.t() - t_from_ >= kTime) {
      for (std::size_t j = 0; j < n_; ++j)
        speed_[j].add((sample.q().value[j] - q_from_[j]) / (sample.t() - t_from_), dq_sum_[j] / count_);
      count_ = 0;
    }
    if (count_ == 0) {
      q_from_ = sample.q().value;
      t_from_ = sample.t();
      dq_sum_.assign(n_, 0);
    }
    for (std::size_t j = 0; j < n_; ++j) dq_sum_[j] += sample.dq().value[j];
    count_ += 1;
  }

  void check_position(const trajectory::RecordingReader& sample, std::size_t j) {
    const trajectory::Axis& axis = axes_[j];
    const double q = sample.q().value[j];
    const double reach = std::max(std::abs(axis.q_min), std::abs(axis.q_max));
    const char* unit = axis.revolute ? " rad" : " m";
    if (axis.revolute && std::abs(q) > 2 * reach && told_far_ < 1) {
      ++told_far_;
      implausible(sample.place(sample.q(), j), axis.name + " would be at " + number(q) + " rad, expected " +
                                                   number(axis.q_min) + " to " + number(axis.q_max) +
                                                   " rad; are these degrees? Then --angle-unit deg");
    } else if (const double margin = 0.01 * (axis.q_max - axis.q_min); q < axis.q_min - margin || q > axis.q_max + margin) {
      if (beyond_[j]++ == 0) {
        warn(sample.place(sample.q(), j), axis.name + " is at " + number(q) + unit + ", expected " + number(axis.q_min) +
                                              " to " + number(axis.q_max) + unit + " (limits of the URDF)");
      }
    }
  }

  const char* effort_unit(std::size_t j) const { return axes_[j].revolute ? " N.m" : " N"; }

  void check_torque(const trajectory::RecordingReader& sample, std::size_t j) {
    const double limit = robot_.joints[j].tau_max, tau = sample.tau().value[j];
    if (!(std::abs(tau) > 2 * limit) || too_strong_[j]++ > 0) return;
    const std::string unit = effort_unit(j);
    warn(sample.place(sample.tau(), j), number(tau) + unit + ", expected at most " + number(limit) + unit +
                                            " (effort limit of the URDF); are these other units or currents? Then --tau-scale");
  }

  void check_speed(const trajectory::RecordingReader& sample, std::size_t j, double dq, double dt) {
    const std::string fact = told_fast_ == 0 ? too_fast(axes_[j], log_.format, dq, dt) : "";
    if (fact.empty()) return;
    ++told_fast_;
    implausible(sample.place(sample.q(), j), fact);
  }

  void finish() {
    if (lost_ > 0) {
      const double share = static_cast<double>(lost_) / static_cast<double>(lost_ + result_.samples);
      warn(log_.files[0].string(), number(100 * share) + " % of the rows are missing (" + std::to_string(lost_) + " at " +
                                       number(result_.rate()) + " Hz, in steps up to " + number(result_.gap) +
                                       " s), expected a constant rate; nothing is made up for them");
    }
    if (repeated_ > result_.samples) {
      throw Error(log_.files[0].string() + ": column of time", "stands still in " + std::to_string(repeated_) + " of " +
                                                                   std::to_string(repeated_ + result_.samples) +
                                                                   " rows, expected increasing time; --rate takes none");
    }
    if (repeated_ > 0) {
      warn(log_.files[0].string() + ": column of time", std::to_string(repeated_) +
                                                            " rows have the time of the row before, expected increasing time; "
                                                            "they are left out");
    }
    if (gaps_ > 3) warn(log_.files[0].string(), std::to_string(gaps_) + " gaps in all");
    for (const Segment& segment : result_.segments) result_.duration += segment.duration;
    constexpr std::size_t kLeast = 100;  // samples
    if (result_.samples < kLeast) {
      throw Error(log_.files[0].string(), "holds " + std::to_string(result_.samples) + " samples, expected at least " +
                                              std::to_string(kLeast) + " to identify anything");
    }
    std::size_t standing = 0;
    const bool wrong_clock = result_.has_speeds && check_clock();
    for (std::size_t j = 0; j < n_; ++j) {
      finish_joint(j, wrong_clock);
      standing += moves(j) ? 0 : 1;
    }
    if (standing == n_) throw Error(log_.files[0].string(), "no joint moves, expected a motion that excites the robot");
    result_.warnings = std::move(warnings_);
  }

  bool moves(std::size_t j) const { return result_.moves(j); }

  void finish_joint(std::size_t j, bool wrong_clock) {
    JointSurvey& joint = result_.joints[j];
    const std::string file = log_.files[0].string() + ": column '";
    const std::string tau_place = file + joint.tau_column + "'", q_place = file + joint.q_column + "'";
    const Sums& sums = gravity_[j];
    joint.tau_rms = std::sqrt(sums.yy / sums.n);
    joint.gravity_rms = std::sqrt(sums.xx / sums.n);
    joint.gravity_correlation = sums.correlation();
    const bool passive = robot_.joints[j].passive;
    if (passive && (joint.tau_min != 0 || joint.tau_max != 0))
      warn(tau_place, "is not 0, but " + axes_[j].name + " is passive: the tuning takes 0, the errors compare with the column");
    if (!passive && joint.tau_max == joint.tau_min && moves(j)) {
      throw Error(tau_place, "is " + number(joint.tau_min) + " in every row, expected the measured torque of " + axes_[j].name);
    }
    if (!moves(j)) {
      warn(q_place, axes_[j].name + " moves by " + number(joint.q_max - joint.q_min) + (axes_[j].revolute ? " rad" : " m") +
                        ", expected a motion: what only shows when it moves stays as in the URDF");
    }
    if (!passive && joint.tau_max > joint.tau_min) check_gravity(j, tau_place);
    if (!passive && moves(j))
      for (const std::string& sentence : watch_[j].damage(axes_[j], tau_place, frozen_[j])) result_.damage.push_back(sentence);
    if (result_.has_speeds && moves(j) && !wrong_clock) check_velocities(j);
  }

  // The gravity of a prior is accurate enough to check sign and size of a torque.
  void check_gravity(std::size_t j, const std::string& place) {
    const JointSurvey& joint = result_.joints[j];
    const Sums& sums = gravity_[j];
    const double known = std::sqrt(sums.var_x()), measured = std::sqrt(sums.var_y());
    if (known > 0.2 * measured && joint.gravity_correlation < -0.7) {
      implausible(place, "goes against the URDF's gravity (correlation " + number(joint.gravity_correlation) +
                             "), expected the torque that drives " + axes_[j].name +
                             "; is its sign, or that of the position, the other way round? Then --tau-scale " +
                             scales(log_.format.tau_scale, n_, {static_cast<int>(j)}, -1) +
                             ", or --q-scale; or does the robot hang from its base?");
      return;
    }
    const double floor = 0.02 * std::min(robot_.joints[j].tau_max, 50.0);  // N.m, least gravity torque that is compared
    const double ratio = joint.tau_rms / joint.gravity_rms;
    if (joint.gravity_rms > floor && ratio < 0.1) {
      implausible(
          place, "is " + number(joint.tau_rms) + effort_unit(j) + " RMS where the URDF's gravity alone is " +
                     number(joint.gravity_rms) + effort_unit(j) +
                     ", expected torques behind the gear; are these the motor's? Then --tau-scale with the gear ratio (about " +
                     number(1 / ratio) + "), or another joint's? Then --tau-columns; or is the base mounted otherwise?");
    } else if (joint.gravity_rms > floor && joint.gravity_correlation > 0.8 && sums.slope() > 10) {
      implausible(place, "is " + number(sums.slope()) + " times the URDF's gravity, expected" + effort_unit(j) +
                             "; another unit? Then --tau-scale");
    }
  }

  /// Velocities that are those of the positions at another rate of time, alike in all joints: then the time column is wrong.
  bool check_clock() {
    constexpr double kAlike = 0.1, kSure = 0.9, kLeast = 1.3, kMost = 5;
    double least = kInfinity, most = 0;
    for (std::size_t j = 0; j < n_; ++j) {
      if (!moves(j) || speed_[j].n == 0 || speed_[j].correlation() < kSure) continue;
      least = std::min(least, speed_[j].slope());
      most = std::max(most, speed_[j].slope());
    }
    const double rate = 0.5 * (least + most), factor = std::max(rate, 1 / rate);
    if (!(most - least < kAlike * rate) || factor < kLeast || factor > kMost) return false;
    result_.damage.push_back(log_.files[0].string() + ": velocities of all joints are " + number(rate) +
                             " times the derivatives of the positions, expected the same; does time run " + number(1 / rate) +
                             " times as fast as the log's? Then --time-unit or --rate");
    return true;
  }

  void check_velocities(std::size_t j) {
    const Sums& sums = speed_[j];
    const JointSurvey& joint = result_.joints[j];
    const std::string place = log_.files[0].string() + ": velocity of " + axes_[j].name;
    if (sums.correlation() < 0.5) {
      warn(place, "is not the derivative of column '" + joint.q_column + "' (correlation " + number(sums.correlation()) +
                      "), expected the same joint and sign; velocities are taken from the positions");
    } else if (sums.slope() < 0.5 || sums.slope() > 2) {
      warn(place, "is " + number(sums.slope()) + " times the derivative of column '" + joint.q_column +
                      "', expected the same; degrees for radians, or milliseconds for seconds in one of them?");
    }
  }

  const Log& log_;
  const robot::RobotModel& robot_;
  SurveyOptions options_;
  double bridged_;
  std::vector<trajectory::Axis> axes_;
  std::size_t n_;
  robot::Mechanism mechanism_;
  robot::Data data_;
  Eigen::VectorXd g_;
  std::vector<double> before_;
  double t_before_ = 0, t_begin_ = 0, ahead_ = 0;
  std::size_t file_ = 0, gaps_ = 0, told_far_ = 0, told_fast_ = 0, lost_ = 0, repeated_ = 0;
  std::vector<Sums> gravity_, speed_;    // n
  std::vector<TorqueWatch> watch_;       // n
  std::vector<std::string> frozen_;      // n: place of the last row of the longest standstill
  std::vector<double> q_from_, dq_sum_;  // of compare_speeds
  double t_from_ = 0, count_ = 0;
  std::vector<std::size_t> beyond_, too_strong_;  // n, samples
  mutable std::vector<std::string> warnings_;
  Survey result_;
};

}  // namespace

std::string scales(std::vector<double> given, std::size_t n, const std::vector<int>& joints, double factor) {
  given.resize(n, 1);
  for (const int j : joints) given[static_cast<std::size_t>(j)] *= factor;
  std::string list;
  for (const double scale : given) text::append(list, text::to_text(scale), ",");
  return list;
}

double Survey::cutoff() const {
  std::vector<double> moving;
  for (const JointSurvey& joint : joints) {
    if (joint.q_max - joint.q_min > 1e-3) moving.push_back(joint.frequency);
  }
  if (moving.empty()) return rate() / 5;
  std::sort(moving.begin(), moving.end());
  const double median = moving[moving.size() / 2];
  return std::min(std::max(0.2, 10 * median), rate() / 5);
}

Survey survey(const Log& log, const robot::RobotModel& robot, const SurveyOptions& options) {
  Survey found = Surveyor(log, robot, options, kBridged).run();
  // A gap of 1/cutoff is bridged too: it is a tenth of the period of the fast part of the motion.
  const double slow = std::min(2.0, 1 / found.cutoff());
  if (found.segments.size() > log.files.size() && slow > found.gap) return Surveyor(log, robot, options, slow).run();
  return found;
}

double typical_step(std::span<const double> t) {
  std::vector<double> steps(t.size() - 1);
  for (std::size_t k = 0; k < steps.size(); ++k) steps[k] = t[k + 1] - t[k];
  std::sort(steps.begin(), steps.end());
  const double median = steps[steps.size() / 2], duration = t.back() - t.front();
  if (steps.back() <= 1.5 * median) return median;
  constexpr double kMostLost = 8, kNear = 0.25, kShare = 0.8;  // multiples; of a step; of steps, and of time in pauses
  for (const std::size_t percent : {50, 25, 10, 5, 2}) {
    const double tried = steps[steps.size() * percent / 100];
    if (!(tried > 0)) break;
    double time = 0, count = 0, near = 0, pauses = 0;
    for (const double step : steps) {
      const double multiple = std::round(step / tried);
      if (multiple > kMostLost) {
        pauses += step;
        near += 1;
      } else if (multiple >= 1 && std::abs(step / tried - multiple) <= kNear) {
        near += 1;
        time += step;
        count += multiple;
      }
    }
    // Samples that were written in bunches have stamps close together: nearly all time would count as pauses.
    if (count == 0 || near < kShare * static_cast<double>(steps.size()) || pauses > kShare * duration) continue;
    return percent == 50 && steps[steps.size() * 9 / 10] <= 1.5 * median ? median : time / count;
  }
  double time = 0, count = 0;
  const double mean = duration / static_cast<double>(steps.size());
  for (const double step : steps) {
    if (step > 10 * mean) continue;
    time += step;
    count += 1;
  }
  return time / count;
}

}  // namespace cotwin::measurement
