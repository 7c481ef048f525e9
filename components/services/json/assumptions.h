#pragma once
#include "components/services/json/request.h"

namespace cotwin::services {

/// Adds to the reply of a service what it rests on without anybody having told or measured it, and a sentence to its notes:
///   "assumptions": [{"what": "inertia of motors", "value": 0, "effect": "…", "file": "drive_train.ssv"}, …]
/// Data of the drives, energy data and limits that the robot does not have, that its files call `assumed`, or that the request leaves out. `value`: the
/// number that counts, one per joint where they differ; null: none, or those of several parameters. `file`: the one that has it, or would.
/// Nothing is added where nothing is assumed.
void add_assumptions(const std::string& service, const Robot& robot, Reader& r, Json& reply);

/// Why the motors of the robot are unknown, as the end of a sentence; "" if their inertias are known.
std::string unknown_motors(const Robot& robot);

}  // namespace cotwin::services
