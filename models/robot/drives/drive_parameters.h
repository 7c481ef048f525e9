#pragma once
#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

#include "models/foundation/support/parameter_table.h"
#include "models/robot/drives/friction.h"

namespace cotwin::robot {

/// Parameters of the drives of a robot with n joints: (2b), (2c) and the torques on the link side of (2a) that are not those of
/// rigid bodies. kDriveParameters describes each vector. The units drive_train and compliance share this model.
struct DriveParameters {
  DriveParameters() = default;
  explicit DriveParameters(std::size_t joints);
  std::vector<double> K, B, D, backlash;
  std::vector<double> sigma0, sigma1, sigma2, tau_C, tau_S, v_S, delta, breakaway, tau_0, v_R;  // friction of the motor
  std::vector<double> link_tau_C, link_sigma2, link_tau_0, link_v_R, link_tau_S, link_v_S, link_delta;
  std::vector<double> link_A, link_alpha, link_s, link_k, link_load, link_v_load;
  std::vector<double> spring_sin, spring_cos;  // Harmonics::kMost values per joint
};

/// In the order in which drive_train declares them, which is that of its FMI value references. The start values are those of a
/// stiff, light drive without friction: assumptions, not measurements.
inline constexpr auto kDriveParameters = [] {
  using P = DriveParameters;
  using Row = ParameterRow<P>;
  constexpr double least = Row::kPositive, most = Row::kLargest, none = Row::kNoLimit;
  constexpr Mutability fixed = Mutability::kFixed, tunable = Mutability::kFollowed;
  return std::to_array<Row>({
      {"K", &P::K, "N.m/rad", "joint stiffness, diagonal of K in (2c)", 1e4, 0, most},
      {"B", &P::B, "kg.m2", "motor inertia behind the gear, diagonal of B in (2b)", 1, 0, most, tunable},
      {"D", &P::D, "N.m.s/rad", "joint damping parallel to K", 0, 0, most},
      {"backlash", &P::backlash, "rad", "half of the gear's play", 0, 0, most},
      {"sigma0", &P::sigma0, "N.m/rad", "bristle stiffness of the motor's friction; 0 for no bristle", 0, 0, most},
      {"sigma1", &P::sigma1, "N.m.s/rad", "bristle damping", 0, 0, most},
      {"sigma2", &P::sigma2, "N.m.s/rad", "viscous friction of the motor", 0, 0, most, tunable},
      {"tau_C", &P::tau_C, "N.m", "Coulomb friction of the motor", 0, 0, most, tunable},
      {"tau_S", &P::tau_S, "N.m", "breakaway torque of the motor; equal to tau_C: no Stribeck effect", 0, 0, most, tunable},
      {"v_S", &P::v_S, "rad/s", "Stribeck speed of the motor", 0.1, least, most, tunable},
      {"delta", &P::delta, "1", "Stribeck exponent of the motor", 2, 0.1, 10},
      {"breakaway", &P::breakaway, "1", "friction=elasto_plastic: share of the sliding deflection that is purely elastic", 0.7,
       0, 0.99},
      {"tau_0", &P::tau_0, "N.m", "constant part of the motor's friction, which makes it asymmetric", 0, -none, none, tunable},
      {"link_tau_C", &P::link_tau_C, "N.m", "Coulomb friction of the link, behind the torque sensor", 0, 0, most, tunable},
      {"link_sigma2", &P::link_sigma2, "N.m.s/rad", "viscous friction of the link", 0, 0, most, tunable},
      {"link_tau_0", &P::link_tau_0, "N.m", "constant part of the link's friction", 0, -none, none, tunable},
      {"link_v_R", &P::link_v_R, "rad/s", "speed below which link_tau_C creeps instead of sticking", 0.01, least, most,
       tunable},
      {"link_A", &P::link_A, "N.m", "height of the link's sigmoid friction k + A/(1 + exp(-alpha (dq + s)))"},
      {"link_alpha", &P::link_alpha, "s/rad", "steepness of the link's sigmoid friction"},
      {"link_s", &P::link_s, "rad/s", "shift of the link's sigmoid friction"},
      {"link_k", &P::link_k, "N.m", "value of the link's sigmoid friction at high negative speed"},
      {"v_R", &P::v_R, "rad/s", "speed over which the motor's friction changes its sign, in the model without a bristle", 0.01,
       least, most, tunable},
      {"link_tau_S", &P::link_tau_S, "N.m", "breakaway torque of the link; up to link_tau_C: no Stribeck effect", 0, 0, most},
      {"link_v_S", &P::link_v_S, "rad/s", "Stribeck speed of the link", 0.1, least, most},
      {"link_delta", &P::link_delta, "1", "Stribeck exponent of the link", 2, 0.1, 10},
      {"link_load", &P::link_load, "1",
       "friction of the link per torque of gravity: adds link_load |g(q)| tanh(dq / link_v_load)", 0, 0, most},
      {"link_v_load", &P::link_v_load, "rad/s", "speed over which that friction changes its sign", 0.01, least, most},
      {"spring_sin", &P::spring_sin, "N.m",
       "springs and counterbalances of the link: for each joint the amplitudes of sin q, sin 2q, sin 3q, sin 4q", 0, -none,
       none, fixed, Harmonics::kMost},
      {"spring_cos", &P::spring_cos, "N.m", "likewise of cos q, cos 2q, cos 3q, cos 4q", 0, -none, none, fixed,
       Harmonics::kMost},
  });
}();

/// The names of the table, in its order.
inline constexpr auto kDriveParameterNames = [] {
  std::array<const char*, kDriveParameters.size()> names{};
  for (std::size_t i = 0; i < names.size(); ++i) names[i] = kDriveParameters[i].name;
  return names;
}();
/// Throws Error for a name that is not in the table.
const ParameterRow<DriveParameters>& drive_parameter(std::string_view name);

/// The models of joint i.
Torsion torsion(const DriveParameters& p, std::size_t i);
/// τ_S is at least τ_C.
Bristle bristle(const DriveParameters& p, std::size_t i);
/// Friction of the motor without a bristle.
CoulombViscous motor_friction(const DriveParameters& p, std::size_t i);
Harmonics spring(const DriveParameters& p, std::size_t i);
LinkSideParameters link_side(const DriveParameters& p, std::size_t i);

}  // namespace cotwin::robot
