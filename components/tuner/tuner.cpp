#include "components/tuner/tuner.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>

#include "components/tuner/worker.h"
#include "components/unit/joint_variables.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/identification/torque_data/motor_inertia.h"

namespace cotwin::tuner {

namespace {

constexpr const char* kNotFinite = "samples with values that are not finite were left out (output skipped)";
constexpr std::size_t kMaxLength = 400;  // characters of a text that a step writes
constexpr std::int32_t kMaxDecimation = 1000000, kMaxRounds = 1000000, kMinParticles = 8, kMaxParticles = 100000;
constexpr double kMinInterval = 1e-3, kMaxInterval = 1e9;  // s
constexpr double kCalm = 1e6;                              // s, longest time that is counted
constexpr double kLatest = 9.2e9;                          // s, what 64 bits of nanoseconds hold
constexpr double kSlowest = 0.1;                           // s, longest interval of measurements that is not a gap for itself
constexpr double kPatience = 5;                            // s, time without usable measurements after `settle`
constexpr const char* kFruitless =
    "measurements came for longer than settle + 5 s, but so irregularly or seldom that none became a sample (outputs samples, "
    "measurements; parameters bridge, settle)";

/// Copies the first kMaxLength characters. Allocates nothing.
void write(std::string& to, std::string_view text) { to.assign(text.substr(0, kMaxLength)); }

bool all_finite(std::span<const double> v) {
  return std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); });
}

/// Increments `counter` unless it is at its limit.
void increment(std::int32_t& counter) {
  if (counter < std::numeric_limits<std::int32_t>::max()) ++counter;
}

/// Whole nanoseconds: sums and differences of times in seconds are compared in these.
double to_ns(double seconds) { return std::round(seconds * 1e9); }

void expect_within(const char* place, double value, double least, double greatest) {
  if (value >= least && value <= greatest) return;
  throw Error(place, text::to_text(value) + ", expected " + text::to_text(least) + " to " + text::to_text(greatest));
}

}  // namespace

void Tuner::declare_settings(SettingList& s) {
  s.set_first_variables({"q", "dq", "tau", "enabled", "mass", "first_moment", "inertia", "rms", "rms_floor", "latency"});
  s.robot("the prior: a name in models/robots, or a path to a URDF file").required();
  s.choice("friction", {"none", "coulomb", "sigmoid", "stribeck"}, "friction law that is identified");
  s.boolean("viscous", false, "whether viscous friction is identified").fallback_rule("true unless friction=none");
  s.boolean("offset", true, "whether a constant torque per joint is identified");
  s.boolean("motor_inertia", false, "whether the reflected inertia of the motors is identified");
  s.boolean(
      "wait", true,
      "a step waits for an estimate that is due; false: it is adopted when it is ready, so results depend on the machine");
}

Tuner::Tuner(Settings& settings) : prior_(settings.robot()), n_(static_cast<std::size_t>(prior_.n())), filter_(n_, 1) {
  if (n_ == 0) throw Error(settings.unit(), "robot '" + prior_.name + "' has no movable joint, expected at least one");
  model_.friction = identification::friction_law(settings.choice("friction"));
  model_.viscous = settings.boolean("viscous", model_.friction != identification::FrictionLaw::kNone);
  model_.offset = settings.boolean("offset");
  model_.motor_inertia = settings.boolean("motor_inertia");
  wait_ = settings.boolean("wait");
  for (Values* v :
       {&q_, &dq_, &tau_, &tau_C_, &tau_S_, &v_S_, &v_R_, &sigma2_, &tau_0_, &B_, &rms_, &rms_prior_, &rms_floor_}) {
    v->assign(n_, 0.0);
  }
  mass_.resize(prior_.bodies.size());
  first_moment_.resize(3 * prior_.bodies.size());
  inertia_.resize(6 * prior_.bodies.size());
  tool_mass_.assign(mass_.size(), 0.0);
  tool_first_moment_.assign(first_moment_.size(), 0.0);
  tool_inertia_.assign(inertia_.size(), 0.0);
  estimate_.assign(10 * mass_.size(), 0.0);
  tools_.assign(10 * mass_.size(), 0.0);
  tool_robot_ = prior_;
  for (robot::Body& body : tool_robot_.bodies) body.inertia = {};
  tool_mechanism_ = std::make_unique<robot::Mechanism>(tool_robot_);
  tool_data_ = std::make_unique<robot::Data>(*tool_mechanism_);
  tool_tau_.setZero(prior_.n());
  least_B_ = identification::least_motor_inertia(prior_);
  std::fill(v_S_.begin(), v_S_.end(), identification::JointDrive{}.v_S);
  std::fill(v_R_.begin(), v_R_.end(), model_.v_R);
}

Tuner::~Tuner() = default;

void Tuner::declare(Variables& v) {
  JointMeasures measures(&prior_);
  JointVariables joints(v, measures);
  joints.input("q", q_, "rad", "measured joint position").essential();
  joints.input("dq", dq_, "rad/s", "measured joint speed");
  joints.input("tau", tau_, "N.m", "measured joint torque, gravity's included; not used of passive joints, where it is 0")
      .essential();
  v.input("enabled", enabled_, "whether samples are taken and estimations start; without a connection: true");

  v.output("mass", mass_, "kg", "mass of each body; that of the prior before the first tuning");
  v.output("first_moment", first_moment_, "kg.m", "mass times centre of mass (x, y, z) in the body's frame, body after body");
  v.output("inertia", inertia_, "kg.m2",
           "inertia (xx, xy, xz, yy, yz, zz) about the origin of the body's frame, body after body");
  joints.output("tau_C", tau_C_, "N.m", "Coulomb friction");
  joints.output("tau_S", tau_S_, "N.m", "breakaway torque");
  joints.output("v_S", v_S_, "rad/s", "Stribeck speed");
  joints.output("v_R", v_R_, "rad/s", "speed over which Coulomb friction changes its sign; found with friction=sigmoid");
  joints.output("sigma2", sigma2_, "N.m.s/rad", "viscous friction");
  joints.output("tau_0", tau_0_, "N.m", "offset of the torque");
  joints.output("B", B_, "kg.m2", "reflected motor inertia, 1 before the first tuning; 0 without motor_inertia=true");
  v.output(
      "cost", cost_, "1",
      "cost of the best particle: mean squared error relative to the floor's, plus the weighted divergence from the prior");
  joints.output("rms", rms_, "N.m", "RMS of the torque error of the tuned robot on all samples of its estimation");
  joints.output("rms_prior", rms_prior_, "N.m", "the same error of the prior, without friction");
  joints.output("rms_floor", rms_floor_, "N.m", "the same error of unconstrained least squares, a lower bound for robots");
  v.output("rank", rank_, "number of unknowns that the samples determine");
  v.output("condition", condition_, "1", "condition number of the regressor within this rank");
  v.output("samples", samples_, "samples taken");
  v.output("tunings", tunings_, "estimates adopted");
  v.output("late", late_, "estimates adopted later than `latency` (wait=false)");
  v.output("skipped", skipped_, "samples that were left out");
  v.output("log", log_, "summary of the last estimate");
  v.output("warning", warning_, "what the user should know after the run; empty if nothing");

  v.parameter("cutoff", cutoff_, "Hz", "cutoff of the critically damped filter of q, dq and tau").range(1e-3, 1e4);
  v.parameter("settle", settle_, "s", "time after enabling before samples are taken, for the filter to settle").range(0, 1e6);
  v.parameter("decimation", decimation_, "number of steps from one sample to the next").range(1, kMaxDecimation);
  v.parameter("interval", interval_, "s", "time between the starts of two estimations").range(kMinInterval, kMaxInterval);
  v.parameter("latency", latency_, "s", "time from the start of an estimation to the adoption of its estimate")
      .range(0, kMaxInterval);
  v.parameter("least_samples", least_, "samples before the first estimation").range(1, 100000000);
  v.parameter("rounds", rounds_, "N_P, maximum number of rounds of the swarm").range(1, kMaxRounds);
  v.parameter("particles", particles_, "number of particles of the swarm").range(kMinParticles, kMaxParticles);
  v.parameter("threshold", threshold_, "1", "cost at which the swarm stops").range(0, 1e9);
  v.parameter("seed", seed_, "seed of the swarm's random numbers");
  v.parameter("prior_weight", prior_weight_, "1", "weight of the prior; it decides what the data leave open").range(0, 1e6);
  v.parameter("forgetting", forgetting_, "1",
              "factor on the weight of older samples with each new one; 1: all samples count alike")
      .range(0.9, 1);

  v.state("filter", filter_.state(), "1", "inputs before, filtered values and their rates of q, dq and tau");
  v.state("gathering", gathering_, "s", "time since samples were enabled");
  v.state("countdown", countdown_, "steps to the next sample");
  v.state("gap", gap_, "whether the filter starts again with the next sample");
  v.state("next", next_, "s", "time at which the next estimation may start");
  v.state("estimating", estimating_, "whether an estimation runs or waits to be adopted");
  v.state("estimation_start", estimation_start_, "s", "time at which it started");
  v.state("due", due_, "s", "time at which its estimate is due");
  v.state("overdue", overdue_, "whether its estimate is late");
  v.tunable("tool_mass", tool_mass_, "kg", "mass that known tools add to each body");
  v.tunable("tool_first_moment", tool_first_moment_, "kg.m", "the same of the first moment, body after body");
  v.tunable("tool_inertia", tool_inertia_, "kg.m2", "the same of the inertia about the origin of the body's frame");
  v.tunable("restart", restart_, "1", "changes when the robot has changed in an unknown way: earlier samples are dropped");
  v.state("estimate", estimate_, "1", "the ten inertial parameters of body after body without tools");
  v.state("tools", tools_, "1", "the same of the tools in force");
  v.state("restarted", restarted_, "1", "restart at the last step");
  v.state("outdated", outdated_, "whether the running estimation is of samples that were dropped");
  v.input("t_measured", t_measured_, "s",
          "time at which q, dq and tau were measured, by any clock: unchanged means held; without a connection: measured in "
          "each step");
  v.parameter("bridge", bridge_, "s",
              "longest time without measurements that the filter crosses in a straight line; at least 2.5 times their interval")
      .range(0, 1);
  v.state("measured", measured_, "s", "t_measured of the last measurement");
  v.state("heard", heard_, "s", "end of the step that got it");
  v.state("cadence", cadence_, "s", "time between the last two");
  v.state("calm", calm_, "s", "time since a measurement that came later than usual");
  v.state("fruitless", fruitless_, "s", "time of measurements since the last one that was usable as a sample");
  v.output("measurements", measurements_, "measurements that came while enabled");
}

/// Makes whatever depends on parameters, where they have changed.
void Tuner::prepare() {
  EstimationOptions options;
  options.swarm = identification::SwarmSearchOptions{}.swarm;
  options.swarm.rounds = rounds_;
  options.swarm.particles = particles_;
  options.swarm.threshold = threshold_;
  options.swarm.seed = static_cast<std::uint64_t>(static_cast<std::uint32_t>(seed_));
  options.prior_weight = prior_weight_;
  options.forgetting = forgetting_;
  filter_.set_cutoff(cutoff_);
  for (std::string* text : {&warning_, &log_}) text->reserve(kMaxLength);
  if (worker_ && worker_->options() == options) return;
  data_ = std::make_unique<identification::TorqueData>(prior_, model_, forgetting_);
  worker_ = std::make_unique<Worker>(prior_, model_, options);
}

/// A passive joint has the torque 0, whatever a sensor there measures.
void Tuner::free_passive_joints() {
  for (std::size_t i = 0; i < n_; ++i) {
    if (prior_.joints[i].passive) tau_[i] = 0;
  }
}

void Tuner::initialise(Time start) {
  prepare();
  worker_->reset(prior_);
  data_->clear();
  restarted_ = restart_;
  outdated_ = false;
  free_passive_joints();
  measured_ = std::isfinite(t_measured_) ? t_measured_ : 0;
  heard_ = start.seconds();
  cadence_ = fruitless_ = 0;
  measurements_ = 0;
  calm_ = kCalm;
  gap_ = is_told() || !(all_finite(q_) && all_finite(dq_) && all_finite(tau_));
  std::ranges::fill(filter_.state(), 0.0);
  if (!gap_) filter_.reset(q_, dq_, tau_);
  robot_ = prior_;

  for (std::size_t i = 0; i < prior_.bodies.size(); ++i) {
    const auto pi = prior_.bodies[i].inertia.parameters();
    std::copy_n(pi.data(), 10, estimate_.data() + 10 * i);
  }
  std::ranges::fill(tools_, 0.0);
  update_tools();
  follow_tools();
  write_bodies();
  for (Values* v : {&tau_C_, &tau_S_, &sigma2_, &tau_0_, &rms_, &rms_prior_, &rms_floor_}) std::fill(v->begin(), v->end(), 0.0);
  for (std::size_t i = 0; i < n_; ++i)
    B_[i] = model_.motor_inertia && !prior_.joints[i].passive ? 1.0
                                                              : 0.0;  // 1: the default of the drive train, which divides by it
  cost_ = condition_ = gathering_ = 0;
  samples_ = tunings_ = late_ = skipped_ = rank_ = 0;
  countdown_ = 0;
  estimating_ = overdue_ = false;
  next_ = start.seconds() + interval_;
  due_ = estimation_start_ = 0;
  for (std::string* text : {&warning_, &log_}) text->clear();
}

/// Makes the mechanism of the tools in force.
void Tuner::update_tools() {
  has_tools_ = false;
  for (std::size_t i = 0; i < tool_robot_.bodies.size(); ++i) {
    const Eigen::Map<const Eigen::Matrix<double, 10, 1>> pi(tools_.data() + 10 * i);
    if (!pi.allFinite())
      throw Error("tool_mass[" + std::to_string(i + 1) + "]", "with tool_first_moment and tool_inertia: a value is not finite");
    tool_robot_.bodies[i].inertia = pi[0] != 0 ? Inertia::from_parameters(pi) : Inertia{};
    has_tools_ = has_tools_ || pi[0] != 0;
  }
  const auto passive = std::ranges::find_if(prior_.joints, &robot::Joint::passive);
  if (has_tools_ && passive != prior_.joints.end())
    throw Error("tool_mass", "a known tool on a robot with the passive joint '" + passive->name +
                                 "', whose torque is taken as 0 without one: expected no passive joints or an unknown tool");
  tool_mechanism_->update(tool_robot_);
}

/// Takes changed tools, and drops all samples if a tool is unknown. Returns whether anything changed.
bool Tuner::follow_tools() {
  const bool restarts = restart_ != restarted_;
  restarted_ = restart_;
  if (restarts) {
    data_->clear();
    samples_ = 0;
    outdated_ = estimating_;
  }
  bool changed = false;
  for (std::size_t i = 0; i < tool_mass_.size(); ++i) {
    double* const pi = tools_.data() + 10 * i;
    const auto take = [&](double& now, double wanted) {
      changed = changed || now != wanted;
      now = wanted;
    };
    take(pi[0], tool_mass_[i]);
    for (std::size_t k = 0; k < 3; ++k) take(pi[1 + k], tool_first_moment_[3 * i + k]);
    for (std::size_t k = 0; k < 6; ++k) take(pi[4 + k], tool_inertia_[6 * i + k]);
  }
  if (changed) {
    update_tools();
    write_bodies();
  }
  return changed || restarts;
}

/// Writes the outputs of the bodies: the estimate with the tools.
void Tuner::write_bodies() {
  for (std::size_t i = 0; i < mass_.size(); ++i) {
    const double *pi = estimate_.data() + 10 * i, *tool = tools_.data() + 10 * i;
    mass_[i] = pi[0] + tool[0];
    for (std::size_t k = 0; k < 3; ++k) first_moment_[3 * i + k] = pi[1 + k] + tool[1 + k];
    for (std::size_t k = 0; k < 6; ++k) inertia_[6 * i + k] = pi[4 + k] + tool[4 + k];
  }
}

/// Whether a source says when it has measured.
bool Tuner::is_told() const { return t_measured_ != kEachStep; }

/// The longest interval of measurements that is not a gap, ns. Steps of h seconds see those of a regular source up to 2 h apart.
double Tuner::longest_wait(double h) const {
  constexpr double kOneLost = 2.5;
  return to_ns(std::max({bridge_, kOneLost * std::min(cadence_, kSlowest), 2 * h}));
}

/// Filters new measurements and takes a sample if it is time for one. Returns false for inputs that are not finite.
bool Tuner::gather(Time end, double h) {
  free_passive_joints();
  if (follow_tools()) gathering_ = 0;  // the filter still has the torque before the change
  if (is_told() && t_measured_ == measured_) return true;
  if (enabled_) increment(measurements_);
  bool usable = std::isfinite(t_measured_) && all_finite(q_) && all_finite(dq_) && all_finite(tau_);
  double interval = h;  // s, since the last measurement
  bool regular = true;
  if (is_told() && std::isfinite(t_measured_)) {
    const double since = t_measured_ - std::exchange(measured_, t_measured_);
    interval = std::clamp(since, 0.0, kLatest);
    const double silent = end.seconds() - heard_;
    if (since <= 0 || to_ns(since) > longest_wait(h) || to_ns(silent) > longest_wait(h) + to_ns(2 * h)) {
      gap_ = true;
      gathering_ = 0;
    }
    // A source that measures less often than the tuner steps is regular; one with losses gives speeds that are means over the gap.
    constexpr double kIrregular = 1.5;
    regular = !gap_ && (to_ns(interval) <= to_ns(kIrregular * cadence_) || to_ns(interval) < to_ns(2 * h));
    cadence_ = interval;
    if (gap_) interval = h;
  }
  calm_ = regular ? std::min(calm_ + interval, kCalm) : 0;
  heard_ = end.seconds();
  if (usable) {
    if (std::exchange(gap_, false)) {
      filter_.reset(q_, dq_, tau_);
    } else {
      filter_.step(interval, q_, dq_, tau_);
    }
    usable = all_finite(filter_.state());  // the difference of two huge numbers may be infinite
    if (!usable) std::ranges::fill(filter_.state(), 0.0);
  }
  if (!usable) {
    gap_ = true;
    gathering_ = 0;
    write(warning_, kNotFinite);
    return false;
  }
  gathering_ = enabled_ ? gathering_ + interval : 0;
  constexpr double kForgotten = 2.5;  // delays of the filter, after which it has 4 % of a step before
  if (gathering_ <= settle_ || calm_ < kForgotten * filter_.delay()) {
    fruitless_ = enabled_ ? std::min(fruitless_ + std::min(std::max(interval, cadence_), kSlowest), kLatest) : 0;
    if (fruitless_ > settle_ + kPatience) write(warning_, kFruitless);
    return true;
  }
  fruitless_ = 0;
  if (countdown_ > 0) {
    --countdown_;
    return true;
  }
  countdown_ = decimation_ - 1;
  if (has_tools_) {
    const auto joint = [&](const auto& v) {
      return Eigen::Map<const Eigen::VectorXd>(v.data(), static_cast<Eigen::Index>(n_));
    };
    robot::inverse_dynamics(*tool_mechanism_, *tool_data_, joint(filter_.q()), joint(filter_.dq()), joint(filter_.ddq()),
                            tool_tau_);
    tool_tau_ = joint(filter_.tau()) - tool_tau_;
  }
  data_->add(filter_.q().data(), filter_.dq().data(), filter_.ddq().data(),
             has_tools_ ? tool_tau_.data() : filter_.tau().data());
  increment(samples_);
  return true;
}

void Tuner::save_memory(std::string& bytes) {
  ByteWriter out(std::move(bytes));
  if (data_) data_->write_samples(out);
  if (estimating_) worker_->write_samples(out);
  bytes = out.take();
}

/// Throws Error unless the values of a restored state are such as a tuner has: the state may come from anywhere.
void Tuner::check_restored() {
  if (!wait_) throw Error("wait", "false, expected true: the state of a tuner that does not wait cannot be restored");
  if (!all_finite(filter_.state())) throw Error("filter", "has numbers that are not finite");
  expect_within("decimation", decimation_, 1, kMaxDecimation);
  expect_within("rounds", rounds_, 1, kMaxRounds);
  expect_within("particles", particles_, kMinParticles, kMaxParticles);
  expect_within("interval", interval_, kMinInterval, kMaxInterval);
  expect_within("latency", latency_, 0, kMaxInterval);
  expect_within("next", next_, -kLatest, kLatest);
  expect_within("estimation_start", estimation_start_, -kLatest, kLatest);
  expect_within("due", due_, -kLatest, kLatest);
  expect_within("heard", heard_, -kLatest, kLatest);
  expect_within("fruitless", fruitless_, 0, kLatest);
  expect_within("cadence", cadence_, 0, kLatest);
  expect_within("calm", calm_, 0, kCalm);
}

void Tuner::restore_memory(const std::string& bytes) {
  check_restored();
  prepare();
  filter_.restored();
  update_tools();
  robot_ = prior_;
  if (tunings_ > 0) {
    identification::Estimate last = identification::estimate_of(prior_);
    for (std::size_t i = 0; i < prior_.bodies.size(); ++i) {
      std::copy_n(estimate_.data() + 10 * i, 10, last.pi.data() + 10 * i);
    }
    robot_ = identification::with_bodies(prior_, last, log_);
  }
  ByteReader in(as_bytes(bytes), "samples of the tuner");
  if (bytes.empty() && samples_ == 0 && !estimating_) {  // the state was saved before the first initialise()
    data_->clear();
  } else {
    data_->read_samples(in);
  }
  if (estimating_) {
    worker_->restore(in, estimation_start_, robot_);
  } else {
    in.expect_end();
    worker_->reset(robot_);
  }
}

// Phases of a step: a sample; adoption of the estimate that is due; start of the next estimation.
StepResult Tuner::step(Time now, Duration h) {
  const Time end = now + h;
  if (!gather(end, h.seconds())) increment(skipped_);
  if (estimating_ && end >= Time::from_seconds(due_)) {
    if (wait_) worker_->wait();
    if (worker_->ready()) {
      adopt();
    } else {
      overdue_ = true;
    }
  }
  const bool measuring = to_ns(end.seconds() - heard_) <= longest_wait(h.seconds());
  if (!estimating_ && enabled_ && measuring && end >= Time::from_seconds(next_) && samples_ >= least_) start_estimation(end);
  return StepResult::kDone;
}

void Tuner::append_notes(std::vector<std::string>& sentences) const {
  if (samples_ > 0 || !warning_.empty()) return;
  if (is_told() && measurements_ == 0) {
    sentences.push_back("no measurement came (t_measured did not change while enabled), so nothing was learnt");
  } else if (measurements_ > 0) {
    const std::string interval = is_told() ? ", the last two " + text::to_text(cadence_, 3) + " s apart" : "";
    sentences.push_back("no sample was taken of " + std::to_string(measurements_) + " measurements" + interval +
                        "; expected regular ones for longer than settle, " + text::to_text(settle_, 3) + " s");
  }
}

void Tuner::start_estimation(Time now) {
  data_->flush();
  estimation_start_ = now.seconds();
  worker_->start(*data_, estimation_start_);
  estimating_ = true;
  due_ = estimation_start_ + latency_;
  next_ = estimation_start_ + interval_;
}

void Tuner::adopt() {
  Estimation& found = worker_->result();
  if (outdated_) {
    outdated_ = false;  // of samples before an unknown tool
  } else if (!found.failure.empty()) {
    write(warning_, found.failure);
  } else {
    for (std::size_t i = 0; i < prior_.bodies.size(); ++i) {
      std::copy_n(found.estimate.pi.data() + 10 * i, 10, estimate_.data() + 10 * i);
    }
    write_bodies();
    for (std::size_t i = 0; i < n_; ++i) {
      const identification::JointDrive& drive = found.estimate.drive[i];
      tau_C_[i] = drive.tau_C;
      tau_S_[i] = drive.tau_S;
      v_S_[i] = drive.v_S;
      v_R_[i] = drive.v_R;
      sigma2_[i] = drive.sigma2;
      tau_0_[i] = drive.tau_0;
      if (model_.motor_inertia) B_[i] = std::max(drive.B, least_B_[i]);
      const auto j = static_cast<Eigen::Index>(i);
      rms_[i] = found.rms[j];
      rms_prior_[i] = found.rms_prior[j];
      rms_floor_[i] = found.rms_floor[j];
    }
    cost_ = found.cost;
    condition_ = found.condition;
    rank_ = found.rank;
    write(log_, found.log);
    std::swap(robot_, found.robot);
    increment(tunings_);
    if (overdue_) increment(late_);
  }
  worker_->clear();
  estimating_ = overdue_ = false;
}

}  // namespace cotwin::tuner
