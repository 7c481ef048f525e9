#pragma once
#include <iosfwd>
#include <string>

#include "components/unit/settings.h"
#include "components/unit/unit_table.h"

/// Writes the description of a unit: as text, as JSON, and as a page of docs/reference.
namespace cotwin::master {

/// A unit to describe.
struct Described {
  std::string source;
  Settings settings;
  Instance instance;    // empty if a required setting is missing
  std::string missing;  // the message about the missing setting
};

/// Writes settings and variables as tables, the variables by role.
void describe(std::ostream& out, const Described& unit);
/// Writes the same as one JSON object.
void describe_json(std::ostream& out, const Described& unit);
/// Writes the same as a Markdown page. `given`: the settings to which sizes and start values belong, "robot=lwr4".
void describe_markdown(std::ostream& out, const UnitType& type, const Described& unit, const std::string& given);

}  // namespace cotwin::master
