#include "components/tuner/tuner.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>

#include "components/tuner/memory.h"
#include "components/tuner/worker.h"
#include "models/identification/motor_inertia.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::tuner {

class Tuner::Worker : public tuner::Worker {
  using tuner::Worker::Worker;
};

namespace {

constexpr const char* kBad = "samples with values that are not finite were left out (output skipped)";
constexpr std::size_t kLongest = 400;  // of a text that a step writes
constexpr std::size_t kBlock = numerics::Triangle::kRows;
constexpr std::int32_t kMostSteps = 1000000, kMostRounds = 1000000, kLeastParticles = 8, kMostParticles = 100000;
constexpr double kShortest = 1e-3, kLongestWait = 1e9;  // s

/// Without allocating: what is too long is cut.
void write(std::string& to, std::string_view text) { to.assign(text.substr(0, kLongest)); }

bool all_finite(std::span<const double> v) {
  return std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); });
}

/// One more, and never beyond what the counter holds.
void count(std::int32_t& counter) {
  if (counter < std::numeric_limits<std::int32_t>::max()) ++counter;
}

void expect_within(const char* place, double value, double least, double greatest) {
  if (value >= least && value <= greatest) return;
  throw Error(place, text::to_text(value) + ", expected " + text::to_text(least) + " to " + text::to_text(greatest));
}

}  // namespace

void Tuner::declare_settings(SettingList& s) {
  s.robot("the prior: a name in models/robots, or a path to a URDF file", true).required();
  s.choice("friction", {"none", "coulomb", "sigmoid", "stribeck"}, "friction law that is identified");
  s.boolean("viscous", false, "whether viscous friction is identified").fallback_rule("true unless friction=none");
  s.boolean("offset", true, "whether a constant torque per joint is identified");
  s.boolean("motor_inertia", false, "whether the reflected inertia of the motors is identified");
  s.boolean("wait", true,
            "a step waits for a tuning that is due; false: it is adopted when it is ready, so results depend on the machine");
}

Tuner::Tuner(Settings& settings)
    : prior_(settings.robot()), n_(static_cast<std::size_t>(prior_.n())), filter_(n_, 1), sample_(4 * n_) {
  if (n_ == 0) throw Error(settings.unit(), "robot '" + prior_.name + "' has no movable joint, expected at least one");
  model_.friction = identification::friction_law(settings.choice("friction"));
  model_.viscous = settings.boolean("viscous", model_.friction != identification::FrictionLaw::kNone);
  model_.offset = settings.boolean("offset");
  model_.motor_inertia = settings.boolean("motor_inertia");
  wait_ = settings.boolean("wait");
  for (Values* v :
       {&q_, &dq_, &tau_, &mass_, &tau_C_, &tau_S_, &v_S_, &v_R_, &sigma2_, &tau_0_, &B_, &rms_, &rms_prior_, &rms_floor_}) {
    v->assign(n_, 0.0);
  }
  first_moment_.resize(3 * n_);
  inertia_.resize(6 * n_);
  least_B_ = identification::least_motor_inertia(prior_);
  std::fill(v_S_.begin(), v_S_.end(), identification::JointDrive{}.v_S);
  std::fill(v_R_.begin(), v_R_.end(), model_.v_R);
}

Tuner::~Tuner() = default;

void Tuner::declare(Variables& v) {
  v.input("q", q_, "rad", "measured joint position").essential();
  v.input("dq", dq_, "rad/s", "measured joint speed");
  v.input("tau", tau_, "N.m", "measured joint torque, gravity's included").essential();
  v.input("enabled", enabled_, "whether samples are taken and tunings made; without a connection: true");

  v.output("mass", mass_, "kg", "mass of each body, the prior's before the first tuning");
  v.output("first_moment", first_moment_, "kg.m", "mass times centre of mass of body after body, in its frame (x, y, z)");
  v.output("inertia", inertia_, "kg.m2", "inertia of body after body about its frame's origin: xx, xy, xz, yy, yz, zz");
  v.output("tau_C", tau_C_, "N.m", "Coulomb friction");
  v.output("tau_S", tau_S_, "N.m", "breakaway torque");
  v.output("v_S", v_S_, "rad/s", "Stribeck speed");
  v.output("v_R", v_R_, "rad/s", "speed over which Coulomb friction changes its sign; found with friction=sigmoid");
  v.output("sigma2", sigma2_, "N.m.s/rad", "viscous friction");
  v.output("tau_0", tau_0_, "N.m", "offset of the torque");
  v.output("B", B_, "kg.m2", "reflected motor inertia, 1 before the first tuning; 0 without motor_inertia=true");
  v.output("cost", cost_, "1", "of the swarm's best particle: mean squared error over the floor's, plus the pull to the prior");
  v.output("rms", rms_, "N.m", "RMS of the torque error of the tuned robot on all samples of the tuning");
  v.output("rms_prior", rms_prior_, "N.m", "the same of the prior, without friction");
  v.output("rms_floor", rms_floor_, "N.m", "the same of unconstrained least squares, below which no robot comes");
  v.output("rank", rank_, "unknowns that the samples determine");
  v.output("condition", condition_, "1", "condition number of the regressor within that rank");
  v.output("samples", samples_, "samples taken");
  v.output("tunings", tunings_, "tunings adopted");
  v.output("late", late_, "of them, those that came after `latency` (wait=false)");
  v.output("skipped", skipped_, "samples that were left out");
  v.output("log", log_, "what the last tuning found");
  v.output("warning", warning_, "what the user should know after the run; empty if nothing");

  v.parameter("cutoff", cutoff_, "Hz", "of the critically damped filter through which q, dq and tau pass").range(1e-3, 1e4);
  v.parameter("settle", settle_, "s", "time after enabling before samples are taken, for the filter to settle").range(0, 1e6);
  v.parameter("decimation", decimation_, "a sample every so many steps").range(1, kMostSteps);
  v.parameter("interval", interval_, "s", "between two tunings").range(kShortest, kLongestWait);
  v.parameter("latency", latency_, "s", "from the last sample of a tuning to its result").range(0, kLongestWait);
  v.parameter("least_samples", least_, "before the first tuning").range(1, 100000000);
  v.parameter("rounds", rounds_, "N_P, rounds of the swarm at most").range(1, kMostRounds);
  v.parameter("particles", particles_, "of the swarm").range(kLeastParticles, kMostParticles);
  v.parameter("threshold", threshold_, "1", "cost at which the swarm stops").range(0, 1e9);
  v.parameter("seed", seed_, "of the swarm");
  v.parameter("prior_weight", prior_weight_, "1", "pull to the prior in what the data leave open").range(0, 1e6);
  v.parameter("forgetting", forgetting_, "1", "factor by which older samples lose weight with each new one; 1: never")
      .range(0.9, 1);

  v.state("filter", filter_.state(), "1", "inputs before, filtered values and their rates of q, dq and tau");
  v.state("gathering", gathering_, "s", "time since samples were enabled");
  v.state("countdown", countdown_, "steps to the next sample");
  v.state("gap", gap_, "whether the filter begins anew with the next sample");
  v.state("next", next_, "s", "when the next tuning begins");
  v.state("seeking", seeking_, "whether a tuning is under way");
  v.state("asked", asked_, "s", "when it began");
  v.state("due", due_, "s", "when its result is due");
  v.state("overdue", overdue_, "whether its result is late");
  v.state("pending_samples", pending_samples_, "samples that are not compressed yet");
  v.state("pending", pending_, "these samples, as text (components/tuner/memory.h)");
  v.state("gathered", gathered_, "the compressed samples, as text");
  v.state("sought", sought_, "the compressed samples of the tuning that is under way, as text");
}

/// Whatever depends on parameters, made anew where they have changed.
void Tuner::prepare() {
  Orders orders;
  orders.swarm = identification::TuningOptions{}.swarm;
  orders.swarm.rounds = rounds_;
  orders.swarm.particles = particles_;
  orders.swarm.threshold = threshold_;
  orders.swarm.seed = static_cast<std::uint64_t>(static_cast<std::uint32_t>(seed_));
  orders.prior_weight = prior_weight_;
  orders.forgetting = forgetting_;
  filter_.set_cutoff(cutoff_);
  for (std::string* text : {&warning_, &log_}) text->reserve(kLongest);
  if (worker_ && worker_->orders() == orders) return;
  worker_.reset();
  data_ = std::make_unique<identification::TorqueData>(prior_, model_, forgetting_);
  worker_ = std::make_unique<Worker>(prior_, model_, orders);
  numbers_.assign(data_->stored_doubles(), 0.0);
}

/// The texts of the state, as of no samples. On a clock there are none, for nobody can take that state.
void Tuner::clear_texts() {
  const std::size_t all = wait_ ? kCharacters * numbers_.size() : 0, block = wait_ ? kCharacters * kBlock * sample_.size() : 0;
  for (std::string* text : {&gathered_, &sought_}) text->assign(all, '0');
  pending_.assign(block, '0');
}

void Tuner::initialise(Time start) {
  prepare();
  worker_->cancel();
  worker_->continue_from(prior_);
  std::fill(numbers_.begin(), numbers_.end(), 0.0);
  data_->load(numbers_);
  clear_texts();
  pending_samples_ = 0;
  gap_ = !(all_finite(q_) && all_finite(dq_) && all_finite(tau_));
  std::ranges::fill(filter_.state(), 0.0);
  if (!gap_) filter_.reset(q_, dq_, tau_);
  robot_ = prior_;

  for (std::size_t i = 0; i < n_; ++i) {
    const auto pi = prior_.bodies[i].inertia.parameters();
    mass_[i] = pi[0];
    std::copy_n(pi.data() + 1, 3, first_moment_.data() + 3 * i);
    std::copy_n(pi.data() + 4, 6, inertia_.data() + 6 * i);
  }
  for (Values* v : {&tau_C_, &tau_S_, &sigma2_, &tau_0_, &rms_, &rms_prior_, &rms_floor_}) std::fill(v->begin(), v->end(), 0.0);
  std::fill(B_.begin(), B_.end(), model_.motor_inertia ? 1.0 : 0.0);  // the drive train's own, which divides by it
  cost_ = condition_ = gathering_ = 0;
  samples_ = tunings_ = late_ = skipped_ = rank_ = 0;
  countdown_ = 0;
  seeking_ = overdue_ = false;
  next_ = start.seconds() + interval_;
  due_ = asked_ = 0;
  for (std::string* text : {&warning_, &log_}) text->clear();
}

/// A sample, if it is time for one; false if it had to be left out.
bool Tuner::gather(double h) {
  bool usable = all_finite(q_) && all_finite(dq_) && all_finite(tau_);
  if (usable) {
    if (std::exchange(gap_, false)) {
      filter_.reset(q_, dq_, tau_);
    } else {
      filter_.step(h, q_, dq_, tau_);
    }
    usable = all_finite(filter_.state());  // the difference of two huge numbers may be none
    if (!usable) std::ranges::fill(filter_.state(), 0.0);
  }
  if (!usable) {
    gap_ = true;
    gathering_ = 0;
    write(warning_, kBad);
    return false;
  }
  gathering_ = enabled_ ? gathering_ + h : 0;
  if (gathering_ <= settle_) return true;
  if (countdown_ > 0) {
    --countdown_;
    return true;
  }
  countdown_ = decimation_ - 1;
  take_sample();
  count(samples_);
  return true;
}

/// Into the block, of which data_ makes part of the triangles when it is full.
void Tuner::take_sample() {
  double* to = sample_.data();
  for (const std::span<const double> part : {filter_.q(), filter_.dq(), filter_.ddq(), filter_.tau()})
    to = std::copy(part.begin(), part.end(), to);
  const double* const s = sample_.data();
  data_->add(s, s + n_, s + 2 * n_, s + 3 * n_);
  if (!wait_) return;
  write_numbers(sample_, pending_.data() + kCharacters * sample_.size() * static_cast<std::size_t>(pending_samples_));
  if (static_cast<std::size_t>(++pending_samples_) == kBlock) store();
}

/// The triangles, in which all samples are now, into the state and numbers_.
void Tuner::store() {
  data_->store(numbers_);
  if (!wait_) return;
  write_numbers(numbers_, gathered_.data());
  pending_samples_ = 0;
}

/// And back.
void Tuner::load() {
  const std::size_t each = sample_.size();
  const auto pending = static_cast<std::size_t>(pending_samples_);
  if (pending_samples_ < 0 || pending >= kBlock)
    throw Error("pending_samples", std::to_string(pending_samples_) + ", expected 0 to " + std::to_string(kBlock - 1));
  Values samples(kBlock * each);
  read_numbers(sought_, numbers_, "sought");
  data_->check(numbers_, "sought");
  read_numbers(gathered_, numbers_, "gathered");
  data_->check(numbers_, "gathered");
  read_numbers(pending_, samples, "pending");
  if (!all_finite(std::span(samples).first(pending * each))) throw Error("pending", "has samples that are not finite");
  data_->load(numbers_);
  for (std::size_t k = 0; k < pending; ++k) {
    const double* const s = samples.data() + k * each;
    data_->add(s, s + n_, s + 2 * n_, s + 3 * n_);
  }
}

/// That numbers of a restored state are such as a tuner has: a state may come from anywhere.
void Tuner::check_restored() {
  constexpr double kLatest = 9.2e9;  // s: what 64 bits of nanoseconds hold
  if (!wait_) throw Error("wait", "false, expected true: a tuner on a clock cannot be taken back");
  if (!all_finite(filter_.state())) throw Error("filter", "has numbers that are not finite");
  expect_within("decimation", decimation_, 1, kMostSteps);
  expect_within("rounds", rounds_, 1, kMostRounds);
  expect_within("particles", particles_, kLeastParticles, kMostParticles);
  expect_within("interval", interval_, kShortest, kLongestWait);
  expect_within("latency", latency_, 0, kLongestWait);
  expect_within("next", next_, -kLatest, kLatest);
  expect_within("asked", asked_, -kLatest, kLatest);
  expect_within("due", due_, -kLatest, kLatest);
}

void Tuner::restored() {
  check_restored();
  prepare();
  filter_.restored();
  if (gathered_.empty() && sought_.empty() && pending_.empty()) clear_texts();  // of a unit that was not initialised yet
  load();
  robot_ = prior_;
  if (tunings_ > 0) {
    identification::Estimate last = identification::estimate_of(prior_);
    for (std::size_t i = 0; i < n_; ++i) {
      double* const pi = last.pi.data() + 10 * i;
      pi[0] = mass_[i];
      std::copy_n(first_moment_.data() + 3 * i, 3, pi + 1);
      std::copy_n(inertia_.data() + 6 * i, 6, pi + 4);
    }
    robot_ = identification::with_bodies(prior_, last, log_);
  }
  if (seeking_) {
    read_numbers(sought_, numbers_, "sought");
    if (worker_->seeks(numbers_, asked_)) return;
  }
  worker_->cancel();
  worker_->continue_from(robot_);
  if (seeking_) worker_->seek(numbers_, asked_);
}

// A step: a sample; the finding, if its time has come; the next tuning, if its time has come.
StepResult Tuner::step(Time now, Duration h) {
  if (!gather(h.seconds())) count(skipped_);
  const Time end = now + h;
  if (seeking_ && end >= Time::from_seconds(due_)) {
    if (wait_) worker_->wait();
    if (worker_->ready()) {
      adopt();
    } else {
      overdue_ = true;
    }
  }
  if (!seeking_ && enabled_ && end >= Time::from_seconds(next_) && samples_ >= least_) seek(end);
  return StepResult::kDone;
}

void Tuner::seek(Time now) {
  data_->flush();
  store();
  sought_ = gathered_;
  asked_ = now.seconds();
  worker_->seek(numbers_, asked_);
  seeking_ = true;
  due_ = asked_ + latency_;
  next_ = asked_ + interval_;
}

void Tuner::adopt() {
  Finding& found = worker_->finding();
  if (!found.failure.empty()) {
    write(warning_, found.failure);
  } else {
    for (std::size_t i = 0; i < n_; ++i) {
      const double* pi = found.estimate.pi.data() + 10 * i;
      mass_[i] = pi[0];
      std::copy_n(pi + 1, 3, first_moment_.data() + 3 * i);
      std::copy_n(pi + 4, 6, inertia_.data() + 6 * i);
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
    count(tunings_);
    if (overdue_) count(late_);
  }
  worker_->taken();
  seeking_ = overdue_ = false;
}

}  // namespace cotwin::tuner
