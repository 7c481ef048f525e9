#pragma once
#include <limits>
#include <string>
#include <vector>

#include "models/energetics/power_log.h"

namespace cotwin::energetics {

/// Models of the power that an arm draws, linear in their parameters. All but `a` are ≥ 0.
enum class PowerModel {
  kConstant,  // P_0
  kWork,      // P_0 + a Σ τ_j q̇_j
  kSpeed,     // the same + c Σ |q̇_j|
  kMotion,    // P_0 + a Σ τ_j q̇_j + Σ (c_j |q̇_j| + d_j q̇_j²)
  kHeat,      // the same + Σ r_j τ_j²
  kCurrent    // P_0 + Σ (k_j i_j q̇_j + r_j i_j²): with measured currents
};
/// Reads "constant", "work", "speed", "motion", "heat", "current". Throws Error naming `place`.
PowerModel parse_power_model(const std::string& place, const std::string& name);
const char* name_of(PowerModel model);

/// What the log says about a parameter.
enum class Told {
  kValue,      // its value, with the given standard error
  kAtZero,     // at its bound 0: the data would rather have it negative
  kUnexcited,  // nothing: its column is zero, the joint did not move
  kDependent   // nothing: its column is a combination of others, or constant; the value is one of many
};
struct PowerParameter {
  std::string name;  // "P_0", "a", "c_2", "d_2", "r_2", "k_2"
  std::string si;
  std::size_t joint = 0;  // from 1; 0: of the robot
  bool nonnegative = false;
  Told told = Told::kValue;
  double value = 0, error = 0;  // standard error for independent noise
};

struct PowerFit {
  PowerModel model = PowerModel::kConstant;
  std::vector<PowerParameter> parameters;
  double rmse = 0;  // W, over the samples of the fit
  std::size_t samples = 0;

  double value(const std::string& name) const;  // 0 if the model has no such parameter
  /// Power at a sample, W.
  double power(const PowerLog& log, std::size_t sample) const;
};

struct FitOptions {
  bool nonnegative = true;   // false: plain least squares
  bool gain_is_one = false;  // a = 1: mechanical power passes without a factor, as in unit:energy
};

/// Least squares over the samples in `use` (empty: all), by Lawson and Hanson's active sets (Solving Least Squares Problems, 1974,
/// chapter 23). Throws Error where the log lacks the model's columns or has fewer samples than parameters, and if a differs from 1
/// by more than a factor of two and five standard errors (power, torques and speeds are then not in W, N.m and rad/s), or a k_j of
/// plain least squares is below zero by more than five standard errors (its current is counted against its torque).
PowerFit fit_power(const PowerLog& log, PowerModel model, const std::vector<bool>& use = {}, FitOptions options = {});

/// Errors of the predicted energy of motions that the fit has not seen.
struct HeldOut {
  std::size_t motions = 0;
  double rmse = 0;                 // W, within the motions
  double median = 0, largest = 0;  // |error| of the energy of a motion over its energy
  double motion_part = 0;          // Σ |error| over Σ (energy − power at rest × duration)
};
/// Each motion is left out once. Throws Error without motions or samples at rest.
HeldOut leave_one_out(const PowerLog& log, PowerModel model, FitOptions options = {});
/// Fits to samples before t_split (s), and evaluates motions that begin later.
HeldOut train_before(const PowerLog& log, PowerModel model, double t_split, FitOptions options = {});

}  // namespace cotwin::energetics
