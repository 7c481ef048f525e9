#include "components/gateway/live/command.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <nlohmann/json.hpp>

#include "components/gateway/live/refusals.h"
#include "components/services/json/json.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway::live {

namespace {

using Json = nlohmann::ordered_json;
using bus::LiveRun;
using bus::RunVerb;

Json parse(std::string_view body) {
  try {
    return services::parse_object(body, services::kMostBodyValues);
  } catch (const services::RequestError& error) {
    refuse(400, error.detail(), error.pointer());
  }
}

void check_members(const Json& object, std::initializer_list<const char*> known) {
  for (const auto& member : object.items()) {
    const std::string& name = member.key();
    if (std::ranges::none_of(known, [&](const char* k) { return name == k; })) {
      std::string expected;
      for (const char* k : known) text::append(expected, k);
      refuse(422, "unknown member, expected " + expected, "/" + name);
    }
  }
}

double number_of(const Json& value, const std::string& pointer) {
  if (value.is_boolean()) return value.get<bool>() ? 1 : 0;
  if (!value.is_number()) refuse(422, "expected a number, true, false, or an array of them", pointer);
  const double number = value.get<double>();
  if (!std::isfinite(number)) refuse(422, "expected a finite number", pointer);
  return number;
}

std::vector<double> numbers_of(const Json& value, const std::string& pointer) {
  if (!value.is_array()) return {number_of(value, pointer)};
  if (value.empty() || value.size() > LiveRun::kMaxSet)
    refuse(422, "expected 1 to " + std::to_string(LiveRun::kMaxSet) + " values", pointer);
  std::vector<double> all;
  for (std::size_t i = 0; i < value.size(); ++i) all.push_back(number_of(value[i], pointer + "/" + std::to_string(i)));
  return all;
}

std::optional<Time> time_of(const Json& object) {
  if (!object.contains("time_s")) return std::nullopt;
  const Json& value = object["time_s"];
  constexpr double kMost = 9e9;  // s; 2^63 ns is 9.22e9 s
  if (!value.is_number() || !(std::abs(value.get<double>()) <= kMost)) refuse(422, "expected a time in seconds", "/time_s");
  return Time::from_seconds(value.get<double>());
}

}  // namespace

RunRequest read_command(std::string_view body) {
  const Json j = parse(body);
  RunRequest request;
  if (!j.contains("command") || !j["command"].is_string()) refuse(422, "expected a word", "/command");
  try {
    request.verb = text::choose("the command", j["command"].get<std::string>(), bus::kRunVerbWords);
  } catch (const Error& error) {
    refuse(422, error.what(), "/command");
  }
  switch (request.verb) {
    case RunVerb::kSet:
      check_members(j, {"command", "values", "time_s"});
      if (!j.contains("values") || !j["values"].is_object() || j["values"].empty())
        refuse(422, "expected an object of names and values", "/values");
      for (const auto& [name, value] : j["values"].items())
        request.changes.push_back({name, numbers_of(value, "/values/" + name)});
      request.at = time_of(j);
      break;
    case RunVerb::kStep:
      check_members(j, {"command", "ticks"});
      if (!j.contains("ticks") || !j["ticks"].is_number_integer() || j["ticks"].get<double>() < 1 ||
          j["ticks"].get<double>() > 1e15)
        refuse(422, "expected an integer from 1 to 1e15", "/ticks");
      request.ticks = j["ticks"].get<std::int64_t>();
      break;
    default:
      check_members(j, {"command"});
  }
  return request;
}

RunRequest read_change(std::string_view body, const std::string& name, const std::function<void()>& check) {
  const Json j = parse(body);
  check_members(j, {"value", "time_s"});
  if (!j.contains("value")) refuse(422, "is missing", "/value");
  RunRequest set;
  check();
  set.changes.push_back({name, numbers_of(j["value"], "/value")});
  set.at = time_of(j);
  return set;
}

}  // namespace cotwin::gateway::live
