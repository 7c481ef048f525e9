#include "models/robot/drives/drive_parameters.h"

#include <algorithm>

namespace cotwin::robot {

DriveParameters::DriveParameters(std::size_t joints) { write_start_values(*this, kDriveParameters, joints); }

const ParameterRow<DriveParameters>& drive_parameter(std::string_view name) {
  const auto* found = std::ranges::find_if(kDriveParameters, [&](const auto& row) { return name == row.name; });
  if (found == kDriveParameters.end()) throw Error(std::string(name), "is no parameter of a drive, expected one of its table");
  return *found;
}

Torsion torsion(const DriveParameters& p, std::size_t i) { return {.K = p.K[i], .backlash = p.backlash[i]}; }

Bristle bristle(const DriveParameters& p, std::size_t i) {
  return {.sigma0 = p.sigma0[i],
          .sigma1 = p.sigma1[i],
          .sigma2 = p.sigma2[i],
          .tau_C = p.tau_C[i],
          .tau_S = std::max(p.tau_C[i], p.tau_S[i]),
          .v_S = p.v_S[i],
          .delta = p.delta[i],
          .breakaway = p.breakaway[i]};
}

CoulombViscous motor_friction(const DriveParameters& p, std::size_t i) {
  return {.tau_C = p.tau_C[i],
          .sigma2 = p.sigma2[i],
          .tau_0 = p.tau_0[i],
          .v_R = p.v_R[i],
          .tau_S = p.tau_S[i],
          .v_S = p.v_S[i],
          .delta = p.delta[i]};
}

Harmonics spring(const DriveParameters& p, std::size_t i) {
  Harmonics spring;
  std::copy_n(&p.spring_sin[i * Harmonics::kMost], Harmonics::kMost, spring.a);
  std::copy_n(&p.spring_cos[i * Harmonics::kMost], Harmonics::kMost, spring.b);
  return spring;
}

LinkSideParameters link_side(const DriveParameters& p, std::size_t i) {
  LinkSideParameters link;
  link.friction = {.tau_C = p.link_tau_C[i],
                   .sigma2 = p.link_sigma2[i],
                   .tau_0 = p.link_tau_0[i],
                   .v_R = p.link_v_R[i],
                   .tau_S = p.link_tau_S[i],
                   .v_S = p.link_v_S[i],
                   .delta = p.link_delta[i]};
  link.sigmoid = {.A = p.link_A[i], .alpha = p.link_alpha[i], .s = p.link_s[i], .k = p.link_k[i]};
  link.load = p.link_load[i];
  link.v_load = p.link_v_load[i];
  link.spring = spring(p, i);
  link.viscous_only = link.friction.tau_C == 0 && link.friction.tau_S == 0 && link.sigmoid.A == 0 && link.sigmoid.k == 0 &&
                      link.load == 0 && !link.spring.present();
  return link;
}

}  // namespace cotwin::robot
