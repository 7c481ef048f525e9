#pragma once
#include "models/energetics/power_fit.h"
#include "models/foundation/formats/parameter_set.h"

namespace cotwin::energetics {

/// The fit as parameters of unit:energy (energy.ssv), for power as the wattmeter saw it (efficiency 1, no controller):
///   kCurrent        current=dc: k_t = k_j, R = r_j
///   kMotion, kHeat  k_h = c_j, k_e = d_j; kHeat: R/k_t² = r_j with k_t = 1. They contain the friction of the joints, if the log's
///                   torques do not: tau_m must then be a torque without friction.
///   others          P_0
/// `assumed` lists what the log does not tell: joints that did not move, columns that depend on others, servo off, supply. A torque
/// constant that is not told is the mean of the others. Throws Error for a fit with a gain other than 1 (FitOptions::gain_is_one).
ParameterSet fitted_parameters(const PowerFit& fit, const PowerLog& log);

}  // namespace cotwin::energetics
