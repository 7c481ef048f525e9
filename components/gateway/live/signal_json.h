#pragma once
#include <nlohmann/json_fwd.hpp>

#include "components/bus/live_run.h"

namespace cotwin::gateway::live {

/// A signal as the answer to GET /run/signals has it.
nlohmann::ordered_json describe(const bus::LiveSignal& s);

}  // namespace cotwin::gateway::live
