#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "components/bus/live_run.h"

namespace cotwin::gateway::live {

/// A value or a command that a client sends, as JSON. Throws http::Refusal for anything that is not as described in docs/gateway_run.md.
struct RunRequest {
  bus::RunVerb verb = bus::RunVerb::kSet;
  std::vector<bus::LiveRun::Change> changes;
  std::optional<Time> at;
  std::int64_t ticks = 0;
};
/// {"command": "pause"}, {"command": "step", "ticks": 10}, {"command": "set", "values": {"drive.K": 100}, "time_s": 1.5}
RunRequest read_command(std::string_view body);
/// {"value": 100, "time_s": 1.5}, for the tunable `name`. `check` is called once the members are known to be right.
RunRequest read_change(std::string_view body, const std::string& name, const std::function<void()>& check);

}  // namespace cotwin::gateway::live
