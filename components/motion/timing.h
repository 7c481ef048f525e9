#pragma once
#include <string>

#include "components/unit/variables.h"
#include "models/trajectory/time_scaling.h"

namespace cotwin::motion {

/// When the desired motion is where: start, stretching, soft start and stop, repetition. The same for joints and poses.
class Timing {
 public:
  /// What happens if a limit is violated.
  enum class Reaction { kError, kWarn, kStretch, kIgnore };
  enum class Loop { kNo, kRepeat, kThereAndBack };

  /// Declares the outputs done, duration, stretch, warning and the parameters.
  void declare(Variables& v, std::string& warning);
  /// Reads the parameters and prepares the phase of a path of this length, s, without limits.
  void prepare(double length);
  /// Lengthens all durations by a factor above one.
  void stretch_by(double factor);

  Reaction reaction() const { return reaction_; }
  Loop loop() const { return looping_; }
  const trajectory::Phase& phase() const { return phase_; }

  /// Phase at a time; sets the output `done`.
  struct Instant {
    trajectory::Phase::Value s;
    bool odd_repetition = false;  // of Loop::kRepeat
  };
  Instant at(double t);

 private:
  double t_start_ = 0, time_scale_ = 1, soft_start_ = 0, soft_stop_ = 0;
  std::string loop_ = "no", limits_ = "error";
  Reaction reaction_ = Reaction::kError;
  Loop looping_ = Loop::kNo;
  trajectory::Phase phase_;
  bool done_ = false;
  double duration_ = 0, stretch_ = 1;
};

}  // namespace cotwin::motion
