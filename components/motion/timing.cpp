#include "components/motion/timing.h"

#include <cmath>

#include "models/foundation/support/choice.h"

namespace cotwin::motion {

void Timing::declare(Variables& v, std::string& warning) {
  v.output("done", done_, "whether the motion has ended");
  v.output("duration", duration_, "s", "duration of the motion, without repetitions");
  v.output("stretch", stretch_, "1", "factor on all durations: time_scale, increased if limits = stretch requires it");
  v.output("warning", warning, "warnings of the initialisation; empty: none");
  v.parameter("t_start", t_start_, "s", "start time of the motion; it rests before").range(0, 1e9);
  v.parameter("time_scale", time_scale_, "1", "factor on all durations: 2 is half as fast").range(1e-6, 1e6);
  v.parameter("soft_start", soft_start_, "s",
              "duration of the acceleration at the start, before stretching; 0: starts at full rate")
      .range(0, 1e9);
  v.parameter("soft_stop", soft_stop_, "s", "duration of the deceleration at the end, before stretching; 0: stops at once")
      .range(0, 1e9);
  v.parameter("loop", loop_, "after the end: no (rest), repeat, or there_and_back");
  v.parameter("limits", limits_,
              "if limits are violated: error, warn, stretch (until velocity, acceleration and jerk meet them) or ignore");
}

void Timing::prepare(double length) {
  looping_ = text::choose<Loop>("motion: loop", loop_,
                                {{"no", Loop::kNo}, {"repeat", Loop::kRepeat}, {"there_and_back", Loop::kThereAndBack}});
  reaction_ = text::choose<Reaction>(
      "motion: limits", limits_,
      {{"error", Reaction::kError}, {"warn", Reaction::kWarn}, {"stretch", Reaction::kStretch}, {"ignore", Reaction::kIgnore}});
  stretch_ = time_scale_;
  phase_ = trajectory::Phase(length, stretch_, soft_start_, soft_stop_);
  duration_ = phase_.duration();
}

void Timing::stretch_by(double factor) {
  stretch_ *= factor;
  phase_ = trajectory::Phase(phase_.length(), stretch_, soft_start_, soft_stop_);
  duration_ = phase_.duration();
}

Timing::Instant Timing::at(double t) {
  Instant instant;
  double u = t - t_start_;  // since the start
  done_ = looping_ == Loop::kNo && u >= duration_;
  double direction = 1;
  if (looping_ == Loop::kRepeat && u > duration_) {
    instant.odd_repetition = std::fmod(std::floor(u / duration_), 2) == 1;
    u = std::fmod(u, duration_);
  }
  if (looping_ == Loop::kThereAndBack && u > duration_) {
    u = std::fmod(u, 2 * duration_);
    if (u > duration_) {
      u = 2 * duration_ - u;
      direction = -1;
    }
  }
  instant.s = phase_.at(u);
  instant.s.ds *= direction;  // reversed s(t): odd derivatives change their sign
  return instant;
}

}  // namespace cotwin::motion
