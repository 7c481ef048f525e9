#pragma once
#include "components/services/json/move_json.h"

/// The services, for json.cpp: each reads its members, finishes the reader and, unless the context says only_read, returns the reply.
namespace cotwin::services {

Json answer_feasibility(const Robot&, Reader&, const Context&);
Json answer_cycle_time(const Robot&, Reader&, const Context&);
Json answer_torques(const Robot&, Reader&, const Context&);
Json answer_peak_power(const Robot&, Reader&, const Context&);
Json answer_jerk(const Robot&, Reader&, const Context&);
Json answer_throughput(const Robot&, Reader&, const Context&);
Json answer_energy(const Robot&, Reader&, const Context&);
Json answer_effective_mass(const Robot&, Reader&, const Context&);
Json answer_safety(const Robot&, Reader&, const Context&);
Json answer_optimise(const Robot&, Reader&, const Context&);
Json answer_verify(const Robot&, Reader&, const Context&);

}  // namespace cotwin::services
