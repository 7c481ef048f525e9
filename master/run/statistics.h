#pragma once
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "master/run/recorder.h"
#include "models/foundation/support/bytes.h"

/// Figures of merit, computed at every tick of the run.
namespace cotwin::master {

/// RMS and largest magnitude of a signal, of a difference of two or of a rotation vector between two attitudes, element by element.
struct Tally {
  std::string name;  // "joint torque"
  std::string what;  // "drive.tau_J", "drive.q - motion.q_d"
  std::string si;
  std::vector<double> rms, max;         // per element
  std::vector<double> time_of_max;      // s
  double total_rms = 0, total_max = 0;  // over all elements
  std::string a{}, b{};                 // the signals; b is empty if there is one alone
  double factor = 1, offset = 0;        // a − (factor · b + offset)
  bool attitude = false;                // a and b are quaternions
  Elements elements{};                  // where units of measure differ, there are no totals (NaN), and `si` is ""
};

/// ∫ Σ effort · flow dt, split into positive and negative parts element by element: if one joint drives and another brakes,
/// both parts differ from 0. value = positive + negative.
struct Work {
  std::string name, what, si;
  double value = 0, positive = 0, negative = 0;
};

/// Comparison of two signals: the rows of Table I (largest discrepancy) and of Fig. 10 (RMS per segment).
struct Compared {
  std::string name, what, si;
  double from = 0, to = 0;                       // s
  std::vector<double> max;                       // per element
  std::vector<double> time_of_max;               // s
  std::vector<std::vector<double>> segment_rms;  // [segment][element]; NaN for segments that the run did not reach
  std::vector<double> rms;                       // per element, over all segments
  std::string a{}, b{};                          // the signals
  double factor = 1, offset = 0;                 // a − (factor · b + offset)
  Elements elements{};                           // as of Tally
};

class Statistics {
 public:
  /// Throws Error at the entry's place for signals that do not exist, are not real, or differ in size or measure.
  /// `recorded`: the signals to report where the scenario names none.
  Statistics(const Scenario& scenario, std::span<const Member> members, std::span<const Column> recorded);

  /// Samples the values at `now`. Allocates nothing.
  void sample(Time now) {
    ++samples_;
    for (Attitude& attitude : attitudes_) attitude.update();
    for (Tallied& t : tallied_) t.sum.add(t.b == nullptr ? *t.a : *t.a - (t.factor * *t.b + t.offset), now);
    if (more_than_tallies_) [[unlikely]]
      sample_others(now);
  }
  /// Writes the sums so far, for a resumed run.
  void write(ByteWriter& out) const;
  /// Throws Error for sums of other signals, and for a time outside `start` to `now`.
  void read(ByteReader& in, Time start, Time now);
  bool empty() const { return tallies_.empty() && !more_than_tallies_; }

  std::vector<Tally> tallies() const;
  std::vector<Work> works() const;
  std::vector<Compared> comparisons() const;

 private:
  /// a − (factor · b + offset), or a alone.
  struct Difference {
    std::string name, what, si;
    std::span<const double> a, b;
    double factor = 1, offset = 0;
    std::string name_of_a{}, name_of_b{};
    bool attitude = false;
    Elements elements{};
  };
  /// A rotation vector between two quaternions.
  struct Attitude {
    std::span<const double, 4> a, b;
    std::shared_ptr<std::array<double, 3>> turn;  // of all copies: update() comes before its use
    void update();
  };
  struct Sum {
    double squares = 0, max = 0;
    Time time_of_max;
    void add(double d, Time now) {
      squares += d * d;
      if (std::abs(d) > max) {
        max = std::abs(d);
        time_of_max = now;
      }
    }
  };
  struct Sums {
    std::vector<Sum> elements;
    std::int64_t count = 0;
    explicit Sums(std::size_t n) : elements(n) {}
    void add(const Difference& difference, Time now);
    std::vector<double> rms() const;  // per element
  };
  /// One element of a tally, with all data that a sample needs.
  struct Tallied {
    const double *a, *b;  // b: nullptr without a second signal
    double factor, offset;
    Sum sum;
  };
  struct ComparisonState {
    Difference difference;
    Time from, to;
    Sums all;
    std::vector<Sums> segments;
  };
  /// Trapezoidal rule over the ticks.
  struct Power {
    std::span<const double> effort, flow;
    double factor = 1;  // into SI base measures
    bool held = false;  // the effort is discrete: it had its value at the end of the step all over the step
  };
  /// The same by element and sign. The power of an element is linear between two ticks.
  struct WorkState {
    WorkState(std::string name_of, std::string signals, const Power& power);
    void add(double h);
    std::string name, what;
    std::span<const double> effort, flow;
    double factor;
    bool held;
    std::vector<double> last_effort, last_flow;  // of each element at the last tick
    double positive = 0, negative = 0;
  };
  static Difference make_difference(const Signal& a, const Signal* b, std::string name, const std::string& place);
  Difference make_attitude(const Signal& a, const Signal& b, std::string name, const std::string& place);
  static Power make_power(const Signal& effort, const Signal& flow, const std::string& place);

  void add_tally(Difference difference);
  /// Calls each(number) for every number that a sample changes, in a fixed order.
  template <class Self, class Each>
  static void each_number(Self& self, Each each);
  void sample_others(Time now);

  std::vector<Attitude> attitudes_;
  std::vector<Tallied> tallied_;  // the elements of all tallies, one tally after the other
  std::int64_t samples_ = 0;
  bool more_than_tallies_ = false;

  std::vector<Difference> tallies_;
  std::vector<ComparisonState> comparisons_;
  std::vector<WorkState> works_;
  bool started_ = false;
  Time last_;
};

}  // namespace cotwin::master
