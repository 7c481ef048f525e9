#pragma once
#include <iosfwd>
#include <string>

#include "components/unit/settings.h"
#include "components/unit/unit_table.h"

/// What a unit says of itself, for people, programs and docs/reference.
namespace cotwin::master {

/// A unit that is described.
struct Described {
  std::string source;
  Settings settings;
  Instance instance;    // empty if a setting is missing without which the unit cannot be built
  std::string missing;  // the message of that
};

/// Settings and variables as tables, the variables by role.
void describe(std::ostream& out, const Described& unit);
/// The same as one JSON object.
void describe_json(std::ostream& out, const Described& unit);
/// The same as a page in Markdown. `given`: what sizes and start values belong to, "robot=lwr4".
void describe_markdown(std::ostream& out, const UnitType& type, const Described& unit, const std::string& given);

}  // namespace cotwin::master
