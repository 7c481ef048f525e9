#pragma once
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

namespace cotwin::robot {

/// A part of a person's body in a collision: a mass behind a spring, and what it may receive.
struct BodyPart {
  /// Limits of one kind of contact; 0: this kind of contact is not permitted.
  struct Limits {
    double force = 0;                                           // N
    double pressure = std::numeric_limits<double>::infinity();  // Pa; infinite: no figure

    /// The force that is permitted on a contact area in m²; 0: the area is unknown, and the pressure not considered.
    double on(double area) const;
  };

  std::string name, region;
  double mass = 0;       // effective mass, kg
  double stiffness = 0;  // N/m
  Limits quasi_static, transient;
};

/// Reads a table (CSV) with the columns of models/people/iso_ts_15066.csv. Throws Error `file.csv:17: …` for a missing column,
/// a value that is not positive, a doubled name, or a table without rows.
std::vector<BodyPart> load_body_parts(const std::filesystem::path& file);

/// The part with this name; for the name of a region its part with the smallest permissible pressure. Throws Error at `place`
/// with the closest name.
const BodyPart& find_body_part(const std::vector<BodyPart>& parts, const std::string& name, const std::string& place);

}  // namespace cotwin::robot
