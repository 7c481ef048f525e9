#pragma once
#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "models/foundation/support/parameter_table.h"

namespace cotwin::energetics {

/// Which current `i` means. Torque constants and resistances of data sheets differ by √2, 1.5 and 3 between them.
enum class Current {
  kDc,    // of a DC motor, or equivalent: R of the whole motor, losses R i²
  kPeak,  // amplitude of a phase = q-axis current of the amplitude-invariant dq transformation: losses 1.5 R i²
  kRms    // rms value of a phase: losses 3 R i²
};
/// m in P_cu = m R i², R the resistance of a phase (kDc: of the motor).
double copper_factor(Current current);
/// Reads "dc", "peak", "rms". Throws Error naming `place`.
Current parse_current(const std::string& place, const std::string& name);

/// Electrical losses of the drives of n joints:
///   P_el = τ_m θ̇ + m R i² + V_0 |i| + k_h |θ̇| + k_e θ̇²,      i = τ_m / k_t
/// k_h and k_e are losses that τ_m does not contain: in the iron (hysteresis, eddy currents), and friction where τ_m is the torque
/// behind it.
struct DriveLosses {
  DriveLosses() = default;
  explicit DriveLosses(std::size_t joints);
  std::vector<double> R, k_t, V_0, k_h, k_e;
};

inline constexpr auto kDriveLosses = [] {
  using P = DriveLosses;
  using Row = ParameterRow<P>;
  return std::to_array<Row>({
      {"R", &P::R, "Ohm", "resistance of a phase of the motor; with current=dc of the whole motor", 1, 0, Row::kLargest},
      {"k_t", &P::k_t, "N.m/A", "torque constant behind the gear, joint torque over current", 10, Row::kPositive,
       Row::kLargest},
      {"V_0", &P::V_0, "V", "losses of the converter over the magnitude of the current", 0, 0, Row::kLargest},
      {"k_h", &P::k_h, "N.m", "losses over the magnitude of the speed that tau_m does not contain: hysteresis of the iron", 0,
       0, Row::kLargest},
      {"k_e", &P::k_e, "N.m.s/rad", "losses over the square of the speed that tau_m does not contain: eddy currents", 0, 0,
       Row::kLargest},
  });
}();

/// What the robot draws beside its motion, and its brakes. All powers are taken from the DC link, except `controller`.
struct Standby {
  double P_0 = 0;         // W, servo on, without the brakes' coils
  double P_off = 0;       // W, servo off, brakes closed
  double P_brake = 0;     // W, coils that hold the brakes open
  double E_release = 0;   // J, to open the brakes, beyond P_brake
  double t_close = 0;     // s, the motors still hold while the brakes close
  double t_release = 0;   // s, the motors hold while the brakes open
  double controller = 0;  // W, of the controller's computer and fans, from the mains
};

/// The way from the mains to the DC link, and the value of energy.
struct Supply {
  double efficiency = 1;     // of the supply, mains to DC link; > 0, ≤ 1
  double eta_r = 1;          // of feeding back, DC link to mains, with Bus::kGrid; 0 to 1
  double price_per_kWh = 0;  // in any currency
  double co2_per_kWh = 0;    // kg
};

/// Parameters that the text `assumed` of an energy.ssv may name (models/foundation/support/assumed.h).
inline constexpr const char* kMayBeAssumed[] = {"R",     "k_t",     "V_0",       "k_h",        "k_e",       "P_0",
                                                "P_off", "P_brake", "E_release", "t_close",    "t_release", "controller",
                                                "C",     "V_min",   "V_max",     "efficiency", "eta_r"};

}  // namespace cotwin::energetics
