#pragma once
#include <functional>
#include <span>
#include <string>

#include "models/identification/excitation/fourier.h"

namespace cotwin::excitation {

/// Throws Error unless `rate` (Hz) gives a whole number of at least 10 and at most 1e8 samples per period (s). `name`: of the rate, for
/// the message.
void check_samples(const std::string& name, double period, double rate);

/// Calls `take` with the time (s) and the states of all joints of each sample of `periods` periods, both ends included. All periods
/// have the same bits.
void for_each_sample(const FourierSeries& series, double rate, int periods,
                     const std::function<void(double t, std::span<const FourierSeries::State>)>& take);

}  // namespace cotwin::excitation
