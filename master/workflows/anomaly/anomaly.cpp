#include "master/workflows/anomaly/anomaly.h"

#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <numeric>

#include "components/services/robots.h"
#include "master/workflows/tuning/data.h"
#include "models/anomaly/maturity.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file_hash.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLeastHealthy = 3;  // logs, from which the variation between days is known
constexpr double kAlpha = 0.005;          // probability that a healthy log is told to be of another robot
constexpr double kOwnBaseline = 0.45;     // of the motion of a session that is shorter than twice the baseline
constexpr double kLost = 2.5;             // steps; more is a gap

/// The robot, with what drive_train.ssv beside its URDF tells, or <dynamics> of the URDF.
struct Tuned {
  robot::RobotModel robot;
  anomaly::TorqueModel model;
  std::string drives;

  Tuned(const AnomalySettings& settings, robot::RobotModel given) : robot(std::move(given)), model(robot, settings.motor) {
    robot::UrdfOptions options;
    options.locked = robot.locked;
    options.unphysical = robot::Unphysical::kWarn;  // as the log's reader takes it
    const services::Robot beside = services::load_robot(settings.log.robot, robot.name, options);
    if (beside.drives) {
      const std::vector<double> none(robot.joints.size(), 0.0);
      static_cast<robot::DriveParameters&>(model.drives) = *beside.drives;
      if (!beside.drives->has("B")) model.drives.B = none;
      drives = "friction and motors of " + (settings.log.robot.parent_path() / services::kDrivesFile).string();
    } else {
      for (std::size_t j = 0; j < robot.joints.size(); ++j) {
        model.drives.sigma2[j] = robot.joints[j].damping;
        model.drives.tau_C[j] = robot.joints[j].friction;
        model.drives.v_R[j] = identification::ModelOptions{}.v_R * identification::speed_scale(robot.joints[j]);
      }
      drives = "friction of <dynamics> in the URDF, no inertia of motors: there is no " + std::string(services::kDrivesFile) +
               " beside it";
    }
    model.update();
  }
};

/// The residuals of one log, joint by joint.
struct Sums {
  std::vector<double> squares, moving, count, torques;
  double samples = 0, motion = 0, before = 0;  // s of motion, and of that in the reference
  double rms(const std::vector<double>& sum, std::size_t j, double number) const {
    return number > 0 ? std::sqrt(sum[j] / number) : 0;
  }
};

/// Reads the reference, then the log, into `watch`; the sums are those of the log.
Sums read(Tuned& tuned, const tuning::Settings& log, const tuning::Data& data, const tuning::Hooks& hooks,
          anomaly::Watch& watch, bool with_reference) {
  const std::size_t n = tuned.robot.joints.size();
  Sums sums{std::vector<double>(n), std::vector<double>(n), std::vector<double>(n), std::vector<double>(n)};
  std::size_t segment = std::numeric_limits<std::size_t>::max();
  tuning::Part before = tuning::Part::kTraining;
  double last = 0;
  tuning::for_each_block(log, data, hooks, "comparing the log", [&](const measurement::Block& block, tuning::Part part) {
    const bool of_log = !with_reference || part == tuning::Part::kHeldOut;
    if (part != before) {
      watch.finish();
      sums.before = watch.motion();
      segment = std::numeric_limits<std::size_t>::max();
      before = part;
    }
    for (std::size_t k = 0; k < block.count; ++k) {
      if (!block.measured[k]) continue;
      const std::size_t row = k * n;
      const double step = block.segment == segment ? block.t[k] - last : 0;
      segment = block.segment;
      last = block.t[k];
      const double* const tau = &block.tau[row];
      tuned.model.evaluate(&block.q[row], &block.dq[row], &block.ddq[row]);
      watch.add(block.t[k], step <= kLost * data.smoothing.step ? step : 0, &block.dq[row], &block.ddq[row], tau);
      if (watch.due()) watch.finish();
      if (!of_log) continue;
      sums.samples += 1;
      for (std::size_t j = 0; j < n; ++j) {
        const double r = tau[j] - tuned.model.tau()[static_cast<Eigen::Index>(j)];
        sums.squares[j] += r * r;
        if (!watch.judges_now(j, block.dq[row + j], tau[j])) continue;
        sums.moving[j] += r * r;
        sums.torques[j] += tau[j] * tau[j];
        sums.count[j] += 1;
      }
    }
  });
  sums.motion = watch.motion() - sums.before;
  return sums;
}

/// A log, surveyed.
tuning::Data survey(tuning::Settings& log, const tuning::Hooks& hooks) {
  tuning::Data data = tuning::survey_log(log, hooks);
  if (log.cutoff <= 0) log.cutoff = std::min(AnomalySettings::kCutoff, 0.2 * data.survey.rate());
  data.smoothing = tuning::smoothing_of(log, data.survey);
  tuning::split(log, data);
  return data;
}

/// The largest RMS of a further healthy log: ln RMS taken as normal, with a variance between days that all joints share,
///   x ≤ m_j + t_{ν, 1−α/n} s √(1 + 1/N)
/// and half of (N − 1) n degrees of freedom ν, because joints vary together.
void compare_with_healthy(std::vector<JointVerdict>& joints, const std::vector<std::vector<double>>& healthy) {
  const double number = static_cast<double>(healthy.size());
  std::vector<std::size_t> moving;  // in all logs
  std::vector<double> mean(joints.size());
  double squares = 0;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!(joints[j].moving_rms > 0) || !std::ranges::all_of(healthy, [&](const auto& rms) { return rms[j] > 0; })) continue;
    moving.push_back(j);
    for (const std::vector<double>& rms : healthy) mean[j] += std::log(rms[j]) / number;
    for (const std::vector<double>& rms : healthy) squares += std::pow(std::log(rms[j]) - mean[j], 2);
  }
  if (moving.empty()) return;
  const double n = static_cast<double>(moving.size()), freedom = (number - 1) * std::max(1.0, n / 2);
  const double t = boost::math::quantile(boost::math::students_t(freedom), 1 - kAlpha / n);
  const double width = t * std::sqrt(squares / ((number - 1) * n) * (1 + 1 / number));
  for (const std::size_t j : moving) {
    joints[j].high = std::exp(mean[j] + width);
    joints[j].other = joints[j].moving_rms > *joints[j].high;
  }
}

}  // namespace

bool AnomalyReport::something() const {
  return found > 0 || std::ranges::any_of(joints, [](const JointVerdict& j) { return j.other || j.beyond; });
}

AnomalyReport find_anomalies(const AnomalySettings& settings, const tuning::Hooks& hooks) {
  tuning::Settings log = settings.log;
  const auto expect_other = [&](const char* option, const std::vector<fs::path>& files) {
    for (const fs::path& file : files)
      if (hash_of_file(file) == hash_of_file(settings.log.data.front()))
        throw Error(option, file.string() + " has the bytes of the log that is compared with it, expected another one");
  };
  expect_other("--reference", settings.reference);
  expect_other("--healthy", settings.healthy);
  const bool with_reference = !settings.reference.empty();
  if (with_reference) {
    log.held_out = log.data;
    log.data = settings.reference;
  }
  const tuning::Data data = survey(log, hooks);
  Tuned tuned(settings, data.robot);
  const std::size_t n = tuned.robot.joints.size();
  AnomalyReport report;
  report.robot = tuned.robot.name;
  for (const fs::path& file : settings.log.data) report.files.push_back(file.string());
  report.notes = data.warnings;
  report.notes.push_back("the tuned robot: " + settings.log.robot.string() + ", " + tuned.drives);

  anomaly::WatchOptions options = settings.watch;
  if (with_reference) options.baseline = data.survey.duration;
  std::optional<anomaly::Watch> watch(std::in_place, tuned.robot, tuned.model, settings.motor, options);
  Sums sums = read(tuned, log, data, hooks, *watch, with_reference);
  if (!with_reference && sums.motion < options.baseline / kOwnBaseline) {
    options.baseline = kOwnBaseline * sums.motion;
    if (options.baseline >= anomaly::kLeastBlocks * anomaly::kBlock) {
      watch.emplace(tuned.robot, tuned.model, settings.motor, options);
      sums = read(tuned, log, data, hooks, *watch, false);
    }
  }
  report.motion = sums.motion;
  for (const measurement::Segment& segment : data.survey.segments)
    if (!with_reference || segment.file >= settings.reference.size()) report.duration += segment.duration;
  if (watch->baselines() > 0) report.baseline = with_reference ? sums.before : options.baseline;
  report.again = watch->baselines() > 0 && !watch->ready();
  report.outside = watch->outside();
  report.events.assign(watch->events().begin(), watch->events().end());
  report.found = watch->count();
  trajectory::RecordingReader first(settings.log.data.front(), trajectory::axes_of(tuned.robot), settings.log.format);
  first.next();
  for (anomaly::Event& event : report.events) event.since += first.begin(), event.found += first.begin();
  for (const anomaly::Event& event : report.events)
    report.sentences.push_back(anomaly::describe(event, tuned.model, tuned.robot.joints));

  std::size_t moving = 0, beyond = 0;
  for (std::size_t j = 0; j < n; ++j) {
    const robot::Joint& joint = tuned.robot.joints[j];
    JointVerdict v;
    v.name = joint.name;
    v.unit = joint.type == robot::JointType::kPrismatic ? "N" : "N.m";
    v.rms = sums.rms(sums.squares, j, sums.samples);
    const double torque = sums.rms(sums.torques, j, sums.count[j]);
    v.index = anomaly::maturity(v.rms, joint.tau_max);
    v.moving_rms = sums.rms(sums.moving, j, sums.count[j]);
    v.beyond = v.moving_rms > 0 && anomaly::beyond(v.moving_rms, torque, joint.tau_max);
    moving += v.moving_rms > 0 ? 1 : 0;
    beyond += v.beyond ? 1 : 0;
    v.compared = watch->compared(j);
    v.resting = watch->resting(j);
    v.saturated = watch->saturated(j);
    report.joints.push_back(v);
  }
  if (2 * beyond < moving)
    for (JointVerdict& joint : report.joints) joint.beyond = false;

  std::vector<std::vector<double>> healthy;
  for (const fs::path& file : settings.healthy) {
    tuning::Settings one = settings.log;
    one.cutoff = log.cutoff;
    one.data = {file};
    const tuning::Data of = survey(one, hooks);
    anomaly::Watch unused(tuned.robot, tuned.model, settings.motor, {});
    const Sums s = read(tuned, one, of, hooks, unused, false);
    healthy.emplace_back();
    for (std::size_t j = 0; j < n; ++j) healthy.back().push_back(s.rms(s.moving, j, s.count[j]));
  }
  if (healthy.size() >= kLeastHealthy) {
    compare_with_healthy(report.joints, healthy);
  } else {
    report.notes.push_back("the variation between days is not known: " + std::to_string(healthy.size()) +
                           " healthy logs, expected at least " + std::to_string(kLeastHealthy) + " (--healthy)");
    if (report.baseline == 0)
      throw Error(report.files.front(), text::to_text(report.motion, 3) + " s of motion, and no baseline: expected at least " +
                                            text::to_text(anomaly::kLeastBlocks * anomaly::kBlock / kOwnBaseline, 2) +
                                            " s in which joints move, or healthy logs (--healthy) to compare it with");
  }
  return report;
}

}  // namespace cotwin::master
