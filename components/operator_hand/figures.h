#pragma once
#include <Eigen/Core>
#include <array>

#include "components/unit/variables.h"

namespace cotwin::operator_hand {

/// Figures of a guided motion, summed over its steps:
///   f_rms     √(∫ ‖f‖² dt / T), guidance force, N
///   lag_rms   √(∫ ‖x_i − p‖² dt / T), distance of the gripped point behind the intention, m
///   jerk      T⁵/L² ∫ ‖d³p/dt³‖² dt, the dimensionless jerk with the duration T and the length L of the path of p:
///             720 for one minimum-jerk move, more if it is less smooth (Hogan, Sternad, J. Motor Behavior 41(6), 2009)
class Figures {
 public:
  struct Sample {
    Eigen::Vector3d f, lag, v;  // N, m, m/s: at the end of the step
  };

  void declare_states(Variables& v);
  void declare_outputs(Variables& v);
  void start(const Sample& first);
  /// A step of h seconds; `counts`: it is part of the motion.
  void add(const Sample& end, double h, bool counts);

 private:
  void take(const Sample& s, double h);
  void write();

  // States.
  double duration_ = 0, length_ = 0, force_ = 0, lag_ = 0, jerk_ = 0;  // T, L and the integrals
  std::array<double, 12> before_{};                                    // f, x_i − p, v, dv/dt at the end of the last step
  double h_before_ = 0;                                                // of the last step; 0: dv/dt is not known yet
  // Outputs.
  double f_rms_ = 0, lag_rms_ = 0, dimensionless_jerk_ = 0;
};

}  // namespace cotwin::operator_hand
