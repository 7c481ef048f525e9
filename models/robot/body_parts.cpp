#include "models/robot/body_parts.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::robot {
namespace {

double positive(const csv::Reader& table, std::size_t column) {
  const double value = table.real(column);
  if (value > 0 && std::isfinite(value)) return value;
  throw Error(table.place(column), "is " + text::to_text(value) + ", expected a finite value > 0");
}

std::optional<double> positive_or_empty(const csv::Reader& table, std::size_t column) {
  if (table.text(column).empty()) return std::nullopt;
  return positive(table, column);
}

std::string name_in(const csv::Reader& table, std::size_t column) {
  const std::string name(table.text(column));
  if (!name.empty() && name.find_first_of(", \t") == std::string::npos) return name;
  throw Error(table.place(column), "is '" + name + "', expected a name without blanks and commas");
}

}  // namespace

double BodyPart::Limits::on(double area) const { return area > 0 ? std::min(force, pressure * area) : force; }

std::vector<BodyPart> load_body_parts(const std::filesystem::path& file) {
  csv::Reader table(file);
  const std::size_t name = table.column("part"), region = table.column("region"), mass = table.column("mass"),
                    stiffness = table.column("stiffness"), force = table.column("force"),
                    transient_force = table.column("transient_force"), pressure = table.column("pressure"),
                    transient_pressure = table.column("transient_pressure");
  constexpr double kNoFigure = std::numeric_limits<double>::infinity();
  std::vector<BodyPart> parts;
  while (table.next()) {
    BodyPart part;
    part.name = name_in(table, name);
    part.region = name_in(table, region);
    part.mass = positive(table, mass);
    part.stiffness = positive(table, stiffness);
    part.quasi_static = {positive(table, force), positive_or_empty(table, pressure).value_or(kNoFigure)};
    part.transient = {positive_or_empty(table, transient_force).value_or(0),
                      positive_or_empty(table, transient_pressure).value_or(kNoFigure)};
    for (const BodyPart& other : parts) {
      if (other.name == part.name) throw Error(table.place(name), "'" + part.name + "' stands there twice");
    }
    parts.push_back(std::move(part));
  }
  if (parts.empty()) throw Error(file.string(), "has no rows, expected one per body part");
  return parts;
}

const BodyPart& find_body_part(const std::vector<BodyPart>& parts, const std::string& name, const std::string& place) {
  const BodyPart* found = nullptr;
  std::vector<std::string> names;
  for (const BodyPart& part : parts) {
    if (part.name == name) return part;
    names.push_back(part.name);
    if (std::find(names.begin(), names.end(), part.region) == names.end()) names.push_back(part.region);
    if (part.region != name) continue;
    if (found == nullptr || part.quasi_static.pressure < found->quasi_static.pressure) found = &part;
  }
  if (found != nullptr) return *found;
  const std::string closest = text::closest(name, names);
  throw Error(place, "no body part or region '" + name + "'" +
                         (closest.empty() ? ", expected a name of its table" : "; did you mean '" + closest + "'?"));
}

}  // namespace cotwin::robot
