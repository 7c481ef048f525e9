#pragma once
#include <iosfwd>
#include <string>

#include "components/unit/unit_table.h"

/// What a unit says of itself, for people, programs and docs/reference.
namespace cotwin::master {

/// The variables as a table, grouped by role.
void describe(std::ostream& out, const std::string& source, const Instance& instance);
/// The same as one JSON object.
void describe_json(std::ostream& out, const std::string& source, const Instance& instance);
/// The same as a page in Markdown. `settings`: what sizes and start values belong to, "robot=lwr4".
void describe_markdown(std::ostream& out, const UnitType& type, const Instance& instance, const std::string& settings);

}  // namespace cotwin::master
