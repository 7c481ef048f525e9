#pragma once
#include <optional>

#include "components/services/json/request.h"
#include "models/optimisation/search.h"

namespace cotwin::services {

/// Compliance parameters that are searched: those of least settling time after a step.
struct ComplianceRequest {
  optimisation::ComplianceValues least, most;
  double zeta_min = 0;       // least damping ratio D/(2 √(M S)); 0: none
  double omega_max = 0;      // largest natural frequency √(S/M), rad/s; 0: none
  double settled_share = 0;  // of a step that is left when it counts as settled
  double T_process = 0;      // s
};
/// The member "compliance". With "axes" it becomes the compliant frame of the problem: its parameters are searched together with the
/// motion. Without, {"M_kg", "D_Ns_per_m", "S_N_per_m": number or [least, most], "zeta_min", "omega_max_rad_per_s", "settled_share",
/// "T_process_s"} is returned, which is searched after the motion. Throws RequestError.
std::optional<ComplianceRequest> read_compliance(Reader& request, optimisation::Problem& problem);

/// The best parameters, their settling time, and the cycle with a move of T_move s. Where no parameters meet the conditions: "feasible":
/// false, a reason and null for all figures.
Json compliance_json(const ComplianceRequest& request, double T_move, std::uint64_t seed);
/// The same of the compliant frame of a problem, for the motion that was found.
Json compliance_json(const optimisation::Problem& problem, const optimisation::Solution& found);
/// [{"direction", "M_kg", "D_Ns_per_m", "S_N_per_m"}, …]
Json axes_json(const optimisation::Problem& problem, const std::vector<optimisation::ComplianceValues>& values);

}  // namespace cotwin::services
