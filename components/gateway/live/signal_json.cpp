#include "components/gateway/live/signal_json.h"

#include <cmath>
#include <nlohmann/json.hpp>

namespace cotwin::gateway::live {

namespace {

using Json = nlohmann::ordered_json;

const char* causality(Role role) {
  switch (role) {
    case Role::kInput:
      return "input";
    case Role::kOutput:
      return "output";
    case Role::kState:
      return "local";
    default:
      return "parameter";
  }
}

/// The names of FMI.
const char* variability(const bus::LiveSignal& s) {
  if (s.role == Role::kParameter) return "fixed";
  if (s.role == Role::kTunable) return "tunable";
  return s.kind == Kind::kReal && !s.discrete ? "continuous" : "discrete";
}

const char* type_of(Kind kind) {
  switch (kind) {
    case Kind::kReal:
      return "Real";
    case Kind::kInteger:
      return "Integer";
    case Kind::kBoolean:
      return "Boolean";
    default:
      return "String";
  }
}

}  // namespace

Json describe(const bus::LiveSignal& s) {
  Json j{{"name", s.name},
         {"component", s.component},
         {"variable", s.variable},
         {"type", type_of(s.kind)},
         {"size", s.size},
         {"causality", causality(s.role)},
         {"variability", variability(s)},
         {"settable", s.settable()},
         {"watchable", s.kind != Kind::kString}};
  if (!s.si.empty()) j["unit"] = s.si;
  if (!s.elements.si.empty()) j["units"] = s.elements.si;
  if (!s.elements.names.empty()) j["joints"] = s.elements.names;
  if (!s.description.empty()) j["description"] = s.description;
  if (std::isfinite(s.min)) j["min"] = s.min;
  if (std::isfinite(s.max)) j["max"] = s.max;
  const auto value = [&](double x) -> Json {
    if (s.kind == Kind::kBoolean) return x != 0;
    if (s.kind == Kind::kInteger) return static_cast<std::int32_t>(x);
    return std::isfinite(x) ? Json(x) : Json(nullptr);
  };
  if (s.start.size() == 1) j["start"] = value(s.start[0]);
  if (s.start.size() > 1) {
    j["start"] = Json::array();
    for (const double x : s.start) j["start"].push_back(value(x));
  }
  return j;
}

}  // namespace cotwin::gateway::live
