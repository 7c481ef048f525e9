#pragma once
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "models/identification/excitation/fourier.h"
#include "models/robot/robot_model.h"

namespace cotwin::numerics {
class Threads;
}

namespace cotwin::excitation {

enum class Criterion {
  kCondition,   // least condition number of the base regressor with columns of unit length
  kDeterminant  // greatest determinant of its information matrix, rows in units of the torque limits
};

struct DesignOptions {
  double period = 10;  // s
  int harmonics = 5;
  double share = 0.9;                                       // of every limit, used by the motion
  double ddq_max = 10;                                      // rad/s², in addition to the limit of the URDF
  double dq_max = std::numeric_limits<double>::infinity();  // rad/s, in addition to the limit of the URDF
  std::vector<double> q_min, q_max;                         // n, or empty: limits narrower than those of the URDF
  Criterion criterion = Criterion::kCondition;
  std::uint64_t seed = 1;
  int rounds = 150;
  int particles = 40;
};

/// The largest values of the motion of one joint, relative to the limits: 1 is the limit.
struct Margins {
  double q = 0;  // of half the range
  double dq = 0, ddq = 0, tau = 0;
};

struct Design {
  FourierSeries series;
  double condition = 0;              // of the base regressor with columns of unit length
  double log_determinant = 0;        // of the information matrix of one period
  int rank = 0, base = 0;            // base parameters that the motion excites; all base parameters
  std::vector<Margins> margins;      // n
  std::vector<double> cost_history;  // after each round
};

/// Designs an exciting motion within the limits of `robot`. Deterministic by seed, on any number of threads. `progress` is
/// called after each round and ends the search by returning false. Throws Error for a joint without room to move, for options
/// out of range, and if no motion within the torque limits was found.
Design design_excitation(const robot::RobotModel& robot, const DesignOptions& options, numerics::Threads* threads = nullptr,
                         const std::function<bool(int round)>& progress = {});

}  // namespace cotwin::excitation
