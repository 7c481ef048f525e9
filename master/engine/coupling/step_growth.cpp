#include "master/engine/coupling/step_growth.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

constexpr int kFirstSteps = 32;       // of a first comparison; then twice as many each time
constexpr double kPolynomial = 2.8;   // log of the growth while the time doubles: that of the fourth power of time
constexpr double kExponential = 1.5;  // an exponential growth doubles its logarithm with each doubling of the time
constexpr int kMany = 256;            // steps in which slow growth is told from noise …
constexpr double kSlow = 0.3;         // … by the log of the growth while the time doubles
constexpr double kClear = 1e9;        // growth that needs no second look
constexpr double kVanished = 1e-7;    // of the largest deviation
constexpr double kDeviation = 1e-5;
constexpr double kSmallMagnitude = 1e-3;

bool step(CoupledSteps& system, Time now, Duration h) {
  try {
    return system.step(now, h);
  } catch (const Error&) {
    return false;
  }
}

/// Two runs side by side, without and with a deviation.
class Pair {
 public:
  Pair(CoupledSteps& system, Time now, Duration h) : system_(system), now_(now), h_(h) { system.save(system.begin); }
  /// Leaves the units as they were.
  void end() { system_.restore(system_.begin); }

  /// Makes `count` more steps of each. Returns the largest deviation in them relative to the magnitudes: infinite if only the steps that deviate
  /// cannot be made, NaN if the others cannot.
  double advance(int count) {
    const auto values = system_.values();
    std::vector<double> expected;
    system_.restore(first_ ? system_.begin : system_.plain);
    for (int i = 0; i < count; ++i) {
      if (!step(system_, now_ + i * h_, h_)) return std::numeric_limits<double>::quiet_NaN();
      ++steps;
      for (const double* value : values) expected.push_back(*value);
    }
    system_.save(system_.plain);

    system_.restore(first_ ? system_.begin : system_.deviating);
    if (first_) system_.deviate();
    first_ = false;
    double largest = 0;
    auto at = expected.begin();
    for (int i = 0; i < count; ++i) {
      if (!step(system_, now_ + i * h_, h_)) return std::numeric_limits<double>::infinity();
      for (std::size_t k = 0; k < values.size(); ++k) {
        const double difference = std::abs(*values[k] - *at++) / system_.magnitude(k);
        if (!std::isfinite(difference)) return std::numeric_limits<double>::infinity();
        largest = std::max(largest, difference);
      }
    }
    system_.save(system_.deviating);
    now_ = now_ + count * h_;
    return largest;
  }

  int steps = 0;  // of the run without deviation

 private:
  CoupledSteps& system_;
  Time now_;
  Duration h_;
  bool first_ = true;
};

}  // namespace

void CoupledSteps::save(CoupledState& state) const {
  const auto all = slots();
  state.units.resize(all.size());
  state.progress.clear();
  for (std::size_t i = 0; i < all.size(); ++i) {
    state.units[i].take(members()[all[i]->member].variables(), *all[i]->unit);
    state.progress.emplace_back(all[i]->time, all[i]->last_step);
  }
  state.numbers = numbers();
}

void CoupledSteps::restore(const CoupledState& state) {
  const auto all = slots();
  for (std::size_t i = 0; i < all.size(); ++i) {
    state.units[i].restore(members()[all[i]->member].variables(), *all[i]->unit);
    std::tie(all[i]->time, all[i]->last_step) = state.progress[i];
  }
  set_numbers(state.numbers);
}

double magnitude_of(const Variable& variable) { return variable.nominal > 0 ? variable.nominal : kSmallMagnitude; }

/// Different sizes and signs, so that no mode of the system is left out.
double deviation_of(std::size_t value) {
  const double spread = std::fmod(0.618 * static_cast<double>(value), 1.0);
  return (value % 2 == 0 ? 1 : -1) * kDeviation * (0.5 + spread);
}

namespace {

StepGrowth compare(Pair& pair, int most) {
  StepGrowth result;
  double first = 0, largest = 0, before = 0, log_before = 0;
  for (int made = 0, count = kFirstSteps; made < most; made += count, count = made) {
    const double deviation = pair.advance(std::min(count, most));
    if (std::isnan(deviation)) {  // what is known so far
      result.ended = true;
      return result;
    }
    if (std::isinf(deviation)) return {true, deviation, 0, false};
    if (deviation <= kVanished * largest || deviation == 0)
      return {false, made == 0 ? 0 : std::pow(kVanished, 1.0 / count), 0, false};
    largest = std::max(largest, deviation);
    if (made == 0) {
      first = before = deviation;
      result.factor = 1;
      continue;
    }
    const double log_growth = std::log(deviation / before);
    result.factor = std::exp(log_growth / count);
    const bool steepens = log_before > 0 ? log_growth > kExponential * log_before : made > kFirstSteps;
    if (log_growth > kPolynomial && (steepens || deviation > kClear * first)) return {true, result.factor, 0, false};
    const bool last = made + count >= most;
    if (last && made + count >= kMany && log_before > 0.5 * kSlow && log_growth > kSlow && steepens)
      return {true, result.factor, 0, false};
    before = deviation;
    log_before = log_growth;
  }
  return result;
}

}  // namespace

bool can_step(CoupledSteps& system, Time now, Duration h, int count) {
  system.save(system.begin);
  int made = 0;
  while (made < count && step(system, now + made * h, h)) ++made;
  system.restore(system.begin);
  return made == count;
}

StepGrowth measure_growth(CoupledSteps& system, Time now, Duration h, int most) {
  Pair pair(system, now, h);
  StepGrowth growth = compare(pair, most);
  growth.steps = pair.steps;
  pair.end();
  return growth;
}

}  // namespace cotwin::master
