#include "models/identification/excitation/samples.h"

#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::excitation {

void check_samples(const std::string& name, double period, double rate) {
  if (!(period > 0)) throw Error("period " + text::to_text(period), "expected a positive number of seconds");
  const double samples = period * rate;
  if (!(rate > 0) || !(samples >= 10 && samples <= 1e8) || std::abs(samples - std::round(samples)) > 1e-6 * samples) {
    throw Error(name + " " + text::to_text(rate),
                "gives " + text::to_text(samples, 6) + " samples a period, expected a whole number of at least 10");
  }
}

void for_each_sample(const FourierSeries& series, double rate, int periods,
                     const std::function<void(double t, std::span<const FourierSeries::State>)>& take) {
  const auto samples = static_cast<std::size_t>(std::llround(series.period * rate));
  std::vector<FourierSeries::State> states(series.joints);
  for (std::size_t k = 0; k <= samples * static_cast<std::size_t>(periods); ++k) {
    // Time within the period, so that all periods have the same bits.
    const double t = series.period * static_cast<double>(k % samples) / static_cast<double>(samples);
    for (std::size_t j = 0; j < series.joints; ++j) states[j] = series.at(j, t);
    take(static_cast<double>(k) / rate, states);
  }
}

}  // namespace cotwin::excitation
