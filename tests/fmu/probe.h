#pragma once
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "components/unit/settings.h"
#include "components/unit/unit.h"

/// A unit for tests of the FMI layer: it has a variable of every kind and role, and fails on demand.
namespace cotwin::probe {

class Probe final : public Unit {
 public:
  static void declare_settings(SettingList& s) {
    s.integer("size", 3, 1, 100, "number of elements");
    s.boolean("warn", false, "whether it warns when it is built");
  }
  explicit Probe(Settings& settings) : n_(static_cast<std::size_t>(settings.integer("size"))) {
    if (settings.boolean("warn")) settings.warn("made to warn");
    u_.resize(n_);
    rate_.resize(n_);
    gain_.resize(n_, 2);
    y_.resize(n_);
    x_.resize(n_);
  }

  void declare(Variables& v) override {
    v.input("u", u_, "N.m", "input that is followed over a step").rate(rate_);
    v.input("demand", demand_,
            "what the next step does: 0 steps, 1 discards, 2 throws, 3 gives NaN, 4 throws no exception, "
            "5 ends the run");
    v.input("on", on_, "whether anything happens at all");
    v.input("word", word_, "text to be echoed");
    v.parameter("limit", limit_, "1", "fixed parameter, a factor on y, taken over by the initialisation").range(0, 10);
    v.parameter("name", name_, "fixed text");
    v.tunable("gain", gain_, "N.m/rad", "factor on the input").range(0, 100);
    v.output("y", y_, "rad", "limit times gain times the integral of the input");
    v.output("h", h_ns_, "length of the last step, ns");
    v.output("echo", echo_, "the word of the last step");
    v.output("moved", moved_, "whether the last step did anything");
    v.output("initialisations", initialisations_, "how often the unit was initialised");
    v.state("x", x_, "N.m.s", "integral of the input");
    v.state("steps", steps_, "number of steps");
    v.input("held", held_, "N.m", "input that is held over a step, to no effect");
  }

  void initialise(Time) override {
    if (limit_ == 7) throw std::runtime_error("limit = 7 is not to my liking");
    cached_limit_ = limit_;
    for (std::size_t i = 0; i < n_; ++i) y_[i] = gain_[i] * x_[i] * cached_limit_;
    echo_ = word_;
    moved_ = false;
    h_ns_ = 0;
    ++initialisations_;
  }

  StepResult step(Time, Duration h) override {
    if (demand_ == 1) return StepResult::kDiscard;
    if (demand_ == 2) throw std::runtime_error("thrown on demand");
    if (demand_ == 4) throw 4;  // not even an exception
    h_ns_ = static_cast<std::int32_t>(h.ns);
    moved_ = on_;
    echo_ = word_;
    ++steps_;
    const double s = h.seconds();
    for (std::size_t i = 0; i < n_; ++i) {
      if (on_) x_[i] += s * (u_[i] + 0.5 * s * rate_[i]);
      y_[i] = demand_ == 3 ? std::numeric_limits<double>::quiet_NaN() : gain_[i] * x_[i] * cached_limit_;
    }
    return demand_ == 5 ? StepResult::kFinished : StepResult::kDone;
  }

 private:
  std::size_t n_;
  std::vector<double> u_, rate_, gain_, y_, x_;
  std::int32_t demand_ = 0, h_ns_ = 0, steps_ = 0, initialisations_ = 0;
  bool on_ = true, moved_ = false;
  std::string word_ = "start", echo_, name_ = "probe";
  double held_ = 0;
  double limit_ = 1, cached_limit_ = 0;  // derived from fixed parameters
};

}  // namespace cotwin::probe
