#pragma once
#include <optional>

#include "models/optimisation/compliance.h"
#include "models/services/request.h"

namespace cotwin::services {

/// Compliance parameters that are searched: those of least settling time after a move.
struct ComplianceRequest {
  optimisation::ComplianceValues least, most;
  double zeta_min = 0;       // least damping ratio D/(2 √(M S)); 0: none
  double omega_max = 0;      // largest natural frequency √(S/M), rad/s; 0: none
  double settled_share = 0;  // of a step that is left when it counts as settled
  double T_process = 0;      // s
};
/// The member "compliance": {"M_kg", "D_Ns_per_m", "S_N_per_m": number or [least, most], "zeta_min", "omega_max_rad_per_s",
/// "settled_share", "T_process_s"}. Throws RequestError.
std::optional<ComplianceRequest> read_compliance(Reader& request);

/// The best parameters, their settling time, and the cycle with a move of T_move s. Where no parameters meet the conditions: "feasible":
/// false, a reason and null for all figures.
Json compliance_json(const ComplianceRequest& request, double T_move, std::uint64_t seed);

}  // namespace cotwin::services
