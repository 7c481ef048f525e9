#pragma once
#include <cstdint>

#include "components/unit/tick_source.h"

namespace cotwin::master {

/// Phase-locked loop of second order (PI law): moves instants on the host's clock until they are `shift` after the beginnings of
/// a source's cycles, of which it gets noisy measurements. With e the time by which the instants are late, wrapped into
/// ±half a cycle, T the time since the last measurement, ω = 2π·bandwidth, and f the drift (host time / source time − 1):
///   instants −= 2ωT e      f −= ω²T e
/// Both poles are at −ω: an error of 100 ppm of f is below 0.1 ppm after 1.6/bandwidth, white jitter σ of the measurements moves the
/// instants by σ √(1.25 ωT) rms. The first measurements are averaged instead. ωT is limited to 0.25 for rare measurements.
/// A measurement off by more than a quarter of a cycle is an outlier; 16 in a row that agree are a step of the source's clock, and
/// the instants move there at once. Without measurements the instants go on with the last f (holdover).
class PhaseLockedLoop {
 public:
  struct Settings {
    std::int64_t cycle = 1'000'000;  // of the source, ns, > 0
    std::int64_t shift = 0;          // ns
    double bandwidth = 1;            // Hz
    std::int64_t within = 0;         // largest mean |e| in lock, ns; 0: cycle/20
  };
  explicit PhaseLockedLoop(const Settings& settings);

  /// Begins with an instant at `host` (ns) and f = 0; the next measurement is taken as it is.
  void start(std::int64_t host);
  /// The same with the present f: after a pause.
  void restart(std::int64_t host);
  /// The present instant, and the one `ns` of the source's time later.
  std::int64_t instant() const { return instant_; }
  void advance(std::int64_t ns);

  enum class Use : std::uint8_t { kUsed, kOutlier, kStep };
  Use measure(const Arrival& arrival);

  /// Ends the lock until the instants are near the measurements again.
  void unlock();
  /// Locked: the mean of e is at most `within` and its rms at most cycle/8, over about the last 64 measurements; lost beyond
  /// twice `within` or cycle/6, and after a step.
  bool locked() const { return locked_; }
  double offset() const { return offset_; }  // e of the last measurement, ns
  double mean() const { return mean_; }      // of e, ns
  double jitter() const;                     // rms of e about its mean, ns
  double drift() const { return drift_; }    // f
  std::int64_t steps() const { return steps_; }

 private:
  double late_by(const Arrival& arrival) const;
  void begin_averages();
  void average(double e);
  void move(double ns);
  bool is_step(double e);

  Settings settings_;
  double gate_;  // ns
  std::int64_t instant_ = 0;
  double fraction_ = 0;  // of a ns, of the instant
  double drift_ = 0;
  std::int64_t last_ = 0;  // host time of the last measurement that was no outlier
  std::int64_t used_ = 0;  // measurements since the start or the last step
  double offset_ = 0, mean_ = 0, square_ = 0;
  bool locked_ = false;
  std::int64_t steps_ = 0;
  int suspects_ = 0;                 // outliers in a row that agree
  double suspect_ = 0, excess_ = 0;  // e of the first one, ns; sum of the differences of all from it
};

/// `ns` modulo `cycle`, in (−cycle/2, cycle/2].
std::int64_t wrap(std::int64_t ns, std::int64_t cycle);
double wrap(double ns, double cycle);

}  // namespace cotwin::master
