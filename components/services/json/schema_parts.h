#pragma once
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

/// What the schemas of several services are made of.
namespace cotwin::services::schemas {

using Json = nlohmann::ordered_json;

/// The names of values of a joint, as a pattern.
inline constexpr const char* kValueNames =
    "^(q|dq|ddq|dddq|tau|inertial|coriolis|gravity|drive|external|limit|quintic_dddq|rigid_tau|tracking_error|"
    "end_error)_(rad|rad_per_s|rad_per_s2|rad_per_s3|Nm|m|m_per_s|m_per_s2|m_per_s3|N)$";
inline constexpr const char* kCosts[] = {"time_s",
                                         "torque_squared_integral",
                                         "work_J",
                                         "shared_work_J",
                                         "acceleration_squared_integral",
                                         "jerk_squared_integral",
                                         "energy_J",
                                         "effective_mass_kg",
                                         "safety_share",
                                         "cycle_time_s",
                                         "stiffness_N_per_m"};

inline const Json kNumber{{"type", "number"}};
inline const Json kNumberOrNull{{"type", {"number", "null"}}};
inline const Json kBoolean{{"type", "boolean"}};
inline const Json kText{{"type", "string"}};
inline const Json kNumbers{{"type", "array"}, {"items", kNumber}};
inline const Json kNumbersOrNull{{"type", "array"}, {"items", kNumberOrNull}};

/// A strict object: `required` names come first in `members`, further ones are optional.
struct Object {
  Json members = Json::object(), required = Json::array(), patterns = Json::object(), choices = Json::array();
  std::vector<const char*> instead;  // further members of each one_of()
  Object& must(const char* name, Json type) {
    members[name] = std::move(type);
    required.push_back(name);
    return *this;
  }
  Object& may(const char* name, Json type) {
    members[name] = std::move(type);
    return *this;
  }
  /// At least one of these members.
  Object& one_of(std::initializer_list<const char*> names) {
    Json any = Json::array();
    for (const char* name : names) any.push_back({{"required", {name}}});
    for (const char* name : instead) any.push_back({{"required", {name}}});
    choices.push_back({{"anyOf", any}});
    return *this;
  }
  Object& like(const char* pattern, Json type) {
    patterns[pattern] = std::move(type);
    return *this;
  }
  operator Json() const {
    Json all{{"type", "object"}, {"properties", members}};
    if (!required.empty()) all["required"] = required;
    if (!choices.empty()) all["allOf"] = choices;
    if (!patterns.empty()) all["patternProperties"] = patterns;
    all["additionalProperties"] = false;
    return all;
  }
};

Json described(Json type, const char* description);
Json positive();
Json at_least_zero();
Json array_of(Json items);
Json or_null(Json object);
/// A member of joints: with the suffix of revolute ones, without it for robots with prismatic joints.
void joints(Object& o, const std::string& plain, const char* si, const Json& type, const char* what);
Object joint();
Json peak();
Json peaks();
Json limiting();
Json series();
Object reaction();
Json motion();
Json extreme();
Json base_at();
Json place();
Json masses();
Object risk();
Json clear_of();
Json verified();
Json found_compliance();
Json costs();

}  // namespace cotwin::services::schemas

namespace cotwin::services {

/// The JSON Schema (2020-12) of the reply of a service, one of service_names().
nlohmann::ordered_json reply_schema(const std::string& service);

}  // namespace cotwin::services
