#pragma once
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "models/foundation/support/error.h"
#include "tests/support/error_of.h"

/// Small units with closed-form behaviour, and helpers that connect them.
namespace cotwin::testing {

/// y = gain · u + bias without delay, also at initialisation.
class Gain final : public Unit {
 public:
  /// `elements`: of u and y; nullptr: all are in rad. `relative`: u and y are differences.
  explicit Gain(std::size_t n, std::shared_ptr<const Elements> elements = {}, bool relative = false)
      : u_(n), y_(n), elements_(std::move(elements)), relative_(relative) {}
  void declare(Variables& v) override {
    for (auto declared : {v.input("u", u_, "rad", "what comes in").elements(elements_),
                          v.output("y", y_, "rad", "gain times u plus bias").elements(elements_)})
      if (relative_) declared.relative();
    v.tunable("gain", gain_, "1", "factor").range(-1e6, 1e6);
    v.parameter("bias", bias_, "rad", "offset");
  }
  void initialise(Time) override { output(); }
  StepResult step(Time, Duration) override {
    output();
    return StepResult::kDone;
  }

 private:
  void output() {
    for (std::size_t i = 0; i < u_.size(); ++i) y_[i] = gain_ * u_[i] + bias_;
  }
  std::vector<double> u_, y_;
  std::shared_ptr<const Elements> elements_;
  bool relative_;
  double gain_ = 1, bias_ = 0;
};

/// q = 2 u.
class Shown final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "rad", "what comes in");
    v.output("q", q_, "rad", "2 u");
  }
  void initialise(Time) override { q_ = 2 * u_; }
  StepResult step(Time, Duration) override {
    q_ = 2 * u_;
    return StepResult::kDone;
  }

 private:
  double u_ = 0, q_ = 0;
};

/// ẋ = u, constant over a step, y = x. `telling`: declares dy as the derivative of y.
class Integrator final : public Unit {
 public:
  explicit Integrator(bool telling = false) : telling_(telling) {}
  void declare(Variables& v) override {
    v.input("u", u_, "rad/s", "rate");
    v.output("y", y_, "rad", "integral");
    v.parameter("start", start_, "rad", "value at the start");
    v.state("x", x_, "rad", "integral");
    if (telling_) v.output("dy", dy_, "rad/s", "derivative").derivative_of("y");
  }
  void initialise(Time) override {
    x_ = y_ = start_;
    dy_ = u_;
  }
  StepResult step(Time, Duration h) override {
    x_ += u_ * h.seconds();
    y_ = x_;
    dy_ = u_;
    return StepResult::kDone;
  }

 private:
  bool telling_;
  double u_ = 0, y_ = 0, x_ = 0, dy_ = 0, start_ = 0;
};

/// ẋ = a(t), where a follows its input linearly over a step (Variable::rate): x is exact if the input is linear.
class RampedIntegrator final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "rad/s", "rate").rate(du_);
    v.output("y", y_, "rad", "integral");
    v.output("u_seen", u_seen_, "rad/s", "the input as it was at the beginning of the step");
    v.output("du_seen", du_seen_, "rad/s2", "its slope");
    v.state("x", x_, "rad", "integral");
  }
  void initialise(Time) override { x_ = y_ = 0; }
  StepResult step(Time, Duration h) override {
    const double s = h.seconds();
    u_seen_ = u_;
    du_seen_ = du_;
    x_ += u_ * s + 0.5 * du_ * s * s;
    y_ = x_;
    return StepResult::kDone;
  }

 private:
  double u_ = 0, du_ = 0, y_ = 0, x_ = 0, u_seen_ = 0, du_seen_ = 0;
};

/// One of two masses that are connected by a spring of stiffness k. side=a integrates B θ̈ = −k(θ − q) with q ramped and
/// outputs tau = k(θ − q); side=b integrates q̈ = tau with tau ramped. Both are exact for a linear input.
class OscillatorA final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("q", q_, "rad", "other side").rate(dq_);
    v.output("theta", theta_out_, "rad", "own side");
    v.output("dtheta", dtheta_out_, "rad/s", "own speed");
    v.output("tau", tau_, "N.m", "spring torque");
    v.output("power", power_, "W", "spring torque times speed of the other side");
    v.state("theta_x", theta_, "rad", "own position");
    v.state("dtheta_x", dtheta_, "rad/s", "own speed");
  }
  void initialise(Time) override {
    theta_ = 0.01;
    dtheta_ = 0;
    output(q_);
  }
  StepResult step(Time, Duration h) override {
    const double omega = std::sqrt(kK), s = h.seconds();
    const double e = theta_ - q_, de = dtheta_ - dq_;  // B = 1: ë = −k e
    const double e2 = e * std::cos(omega * s) + de / omega * std::sin(omega * s);
    const double de2 = -e * omega * std::sin(omega * s) + de * std::cos(omega * s);
    theta_ = e2 + q_ + dq_ * s;
    dtheta_ = de2 + dq_;
    output(q_ + dq_ * s);
    return StepResult::kDone;
  }
  static constexpr double kK = 1e4;  // N.m/rad

 private:
  void output(double q) {
    theta_out_ = theta_;
    dtheta_out_ = dtheta_;
    tau_ = kK * (theta_ - q);
  }
  double q_ = 0, dq_ = 0, theta_ = 0, dtheta_ = 0, theta_out_ = 0, dtheta_out_ = 0, tau_ = 0, power_ = 0;
};

class OscillatorB final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("tau", tau_, "N.m", "spring torque").rate(dtau_);
    v.output("q", q_out_, "rad", "own side");
    v.output("dq", dq_out_, "rad/s", "own speed");
    v.state("q_x", q_, "rad", "own position");
    v.state("dq_x", dq_, "rad/s", "own speed");
  }
  void initialise(Time) override { q_ = dq_ = q_out_ = dq_out_ = 0; }
  StepResult step(Time, Duration h) override {
    const double s = h.seconds();
    q_ += dq_ * s + tau_ * s * s / 2 + dtau_ * s * s * s / 6;
    dq_ += tau_ * s + dtau_ * s * s / 2;
    q_out_ = q_;
    dq_out_ = dq_;
    return StepResult::kDone;
  }

 private:
  double tau_ = 0, dtau_ = 0, q_ = 0, dq_ = 0, q_out_ = 0, dq_out_ = 0;
};

/// Records the calls that it gets.
class Probe final : public Unit {
 public:
  void declare(Variables& v) override {
    v.output("steps", steps_, "number of steps");
    v.output("now", now_, "s", "beginning of the last step");
    v.output("h", h_, "s", "length of the last step");
    v.output("t", t_, "s", "end of the last step");
    v.output("odd", odd_, "an odd number of steps");
  }
  void initialise(Time start) override {
    steps_ = 0;
    now_ = t_ = start.seconds();
    h_ = 0;
    odd_ = false;
  }
  StepResult step(Time now, Duration h) override {
    ++steps_;
    now_ = now.seconds();
    h_ = h.seconds();
    t_ = (now + h).seconds();
    odd_ = !odd_;
    return StepResult::kDone;
  }

 private:
  std::int32_t steps_ = 0;
  double now_ = 0, h_ = 0, t_ = 0;
  bool odd_ = false;
};

/// All kinds of ports, copied from input to output.
class Mixed final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("real", real_, "m", "real");
    v.input("integer", integer_, "integer");
    v.input("boolean", boolean_, "boolean");
    v.input("string", string_, "string");
    v.output("real_out", real_out_, "m", "real");
    v.output("integer_out", integer_out_, "integer");
    v.output("boolean_out", boolean_out_, "boolean");
    v.output("string_out", string_out_, "string");
  }
  void initialise(Time) override { copy(); }
  StepResult step(Time, Duration) override {
    copy();
    return StepResult::kDone;
  }

 private:
  void copy() {
    real_out_ = real_;
    integer_out_ = integer_;
    boolean_out_ = boolean_;
    string_out_ = string_;
  }
  double real_ = 0, real_out_ = 0;
  std::int32_t integer_ = 0, integer_out_ = 0;
  bool boolean_ = false, boolean_out_ = false;
  std::string string_, string_out_;
};

/// ẋ = −50 x + u by explicit Euler; discards every step that begins after `from` and is longer than `longest`.
class Picky final : public Unit {
 public:
  explicit Picky(bool restorable) : restorable_(restorable) {}
  void declare(Variables& v) override {
    v.input("u", u_, "rad/s", "drive");
    v.output("y", y_, "rad", "position");
    v.output("h", h_, "s", "last step");
    v.parameter("longest", longest_, "s", "longest step that is made");
    v.parameter("from", from_, "s", "when that begins to count");
    v.parameter("start", start_, "rad", "value at the start");
    v.state("x", x_, "rad", "position");
  }
  void initialise(Time) override { x_ = y_ = start_; }
  StepResult step(Time now, Duration h) override {
    if (now.seconds() >= from_ && h.seconds() > longest_) {
      x_ = -777;  // the master restores the state, not the unit
      return StepResult::kDiscard;
    }
    x_ += h.seconds() * (-50 * x_ + u_);
    y_ = x_;
    h_ = h.seconds();
    return StepResult::kDone;
  }
  bool restorable() const override { return restorable_; }

 private:
  bool restorable_;
  double u_ = 0, y_ = 0, h_ = 0, longest_ = 1e9, from_ = 0, start_ = 1, x_ = 0;
};

/// Outputs NaN (or throws) after `after`.
class Faulty final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "1", "ignored");
    v.output("y", y_, "1", "a number, at first");
    v.parameter("after", after_, "s", "time of the fault");
    v.parameter("throws", throws_, "throws instead");
  }
  void initialise(Time) override {}
  StepResult step(Time now, Duration) override {
    if (now.seconds() < after_) return StepResult::kDone;
    if (throws_) throw Error("the gear has broken");
    y_[2] = std::numeric_limits<double>::quiet_NaN();
    return StepResult::kDone;
  }

 private:
  std::array<double, 3> u_{}, y_{};
  double after_ = 0;
  bool throws_ = false;
};

/// A chaotic map that takes some microseconds per step: any difference in order or time is visible.
class Heavy final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "1", "disturbance");
    v.output("y", y_, "1", "logistic map");
    v.parameter("rounds", rounds_, "iterations per step");
    v.parameter("start", start_, "1", "value at the start").range(0, 1);
    v.state("x", x_, "1", "logistic map");
  }
  void initialise(Time) override { x_ = y_ = start_; }
  StepResult step(Time, Duration) override {
    for (std::int32_t i = 0; i < rounds_; ++i) x_ = 3.99 * x_ * (1 - x_);
    x_ = 0.9 * x_ + 0.1 * std::abs(u_ - std::floor(u_));
    y_ = x_;
    return StepResult::kDone;
  }

 private:
  double u_ = 0, y_ = 0, start_ = 0.3, x_ = 0;
  std::int32_t rounds_ = 100;
};

/// Requests the end of the run after three steps.
class Brief final : public Unit {
 public:
  void declare(Variables& v) override {
    v.output("steps", steps_, "number of steps");
    v.output("warning", warning_, "what the user should know");
  }
  void initialise(Time) override {
    steps_ = 0;
    warning_ = "three steps only";
  }
  StepResult step(Time, Duration) override { return ++steps_ == 3 ? StepResult::kFinished : StepResult::kDone; }

 private:
  std::int32_t steps_ = 0;
  std::string warning_;
};

/// Two joints whose torques and speeds are copies of the inputs.
class Joints final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("tau_in", tau_in_, "N.m", "torques");
    v.input("dq_in", dq_in_, "rad/s", "speeds");
    v.output("tau", tau_, "N.m", "the torques");
    v.output("dq", dq_, "rad/s", "the speeds");
  }
  void initialise(Time) override { pass(); }
  StepResult step(Time, Duration) override {
    pass();
    return StepResult::kDone;
  }

 private:
  void pass() {
    tau_ = tau_in_;
    dq_ = dq_in_;
  }
  std::array<double, 2> tau_in_{}, dq_in_{}, tau_{}, dq_{};
};

inline std::span<const UnitType> test_types() {
  static const UnitType kTypes[] = {
      {"gain", "y = gain u + bias",
       [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<Gain>(static_cast<std::size_t>(s.integer("n"))); },
       [](SettingList& s) { s.integer("n", 1, 1, 1000, "number of elements"); }},
      {"difference", "a gain of a difference",
       [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Gain>(1, nullptr, true); }},
      {"arm", "a gain of three joints, of which the second one slides",
       [](Settings&) -> std::unique_ptr<Unit> {
         return std::make_unique<Gain>(
             3, std::make_shared<const Elements>(Elements{{"elbow", "my, slide", "roll"}, {"rad", "m", "rad"}}));
       }},
      {"shown", "q = 2 u, which pages show", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Shown>(); }},
      {"integrator", "y = ∫u", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Integrator>(); }},
      {"telling_integrator", "y = ∫u, dy = u",
       [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Integrator>(true); }},
      {"ramped", "y = ∫u, u ramped", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<RampedIntegrator>(); }},
      {"oscillator_a", "mass and spring", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<OscillatorA>(); }},
      {"oscillator_b", "mass", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<OscillatorB>(); }},
      {"probe", "tells its steps", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Probe>(); }},
      {"mixed", "all kinds", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Mixed>(); }},
      {"picky", "discards",
       [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<Picky>(s.boolean("restorable")); },
       [](SettingList& s) { s.boolean("restorable", true, "whether steps can be taken back"); }},
      {"faulty", "gives NaN", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Faulty>(); }},
      {"brief", "ends early", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Brief>(); }},
      {"joints", "torques and speeds", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Joints>(); }},
      {"heavy", "costs time", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Heavy>(); }},
  };
  return kTypes;
}

/// Builds scenarios in code.
struct Build {
  master::Scenario scenario;

  Build() {
    scenario.name = "test";
    scenario.file = "test.ssd";
    scenario.stop = Time::from_seconds(0.01);
    scenario.tick = Duration{1'000'000};
    scenario.threads = 1;
  }
  Build& unit(const std::string& name, const std::string& source, int stage = 0, int period = 1) {
    master::ComponentSpec spec;
    spec.name = name;
    spec.source = "unit:" + source;
    spec.place = "test.ssd:" + std::to_string(scenario.components.size() + 10);
    spec.stage = stage;
    spec.period = period;
    scenario.components.push_back(spec);
    return *this;
  }
  /// A start value of the unit added last.
  Build& with(const std::string& variable, std::variant<double, std::int64_t, bool, std::string> value) {
    scenario.components.back().start_values.push_back({variable, std::move(value), "", "test.ssd:50"});
    return *this;
  }
  Build& connect(const std::string& from, const std::string& to, double factor = 1, double offset = 0) {
    const auto port = [](const std::string& name) {
      const std::size_t dot = name.rfind('.');
      return master::Port{name.substr(0, dot), name.substr(dot + 1), ""};
    };
    scenario.connections.push_back({port(from), port(to), factor, offset, false, "test.ssd:41"});
    return *this;
  }
  /// The last added connection passes the number unchanged, whatever the units of measure.
  Build& as_it_is() {
    scenario.connections.back().suppress_unit_conversion = true;
    return *this;
  }
  Build& event(double time, const std::string& variable, const std::string& value, double ramp = 0) {
    scenario.events.push_back({Time::from_seconds(time), variable, value, Duration::from_seconds(ramp), "test.ssd:60"});
    return *this;
  }
  Build& record(const std::string& pattern) {
    scenario.recording.push_back({pattern, "test.ssd:70"});
    return *this;
  }
  Build& until(double seconds) {
    scenario.stop = Time::from_seconds(seconds);
    return *this;
  }
  master::Master load(const std::filesystem::path& results = {}) const {
    master::MasterOptions options;
    options.types = test_types();
    options.results = results;
    return master::Master(scenario, std::move(options));
  }
};

inline double value(master::Master& master, const std::string& name) {
  const master::Signal s = master::find_signal(master.members(), name, "");
  switch (s.variable->kind()) {
    case Kind::kReal:
      return s.variable->reals()[s.first];
    case Kind::kInteger:
      return s.variable->integers()[s.first];
    case Kind::kBoolean:
      return s.variable->booleans()[s.first] ? 1 : 0;
    case Kind::kString:
      break;
  }
  throw Error(name, "is a text");
}

}  // namespace cotwin::testing
