#pragma once
#include <span>
#include <string>
#include <vector>

#include "models/support/csv.h"
#include "models/trajectory/axes.h"

namespace cotwin::trajectory {

/// A quantity of all joints in a table: its name in messages and usual patterns of its column names.
struct Quantity {
  const char* name;                   // "q"
  std::vector<const char*> patterns;  // in the order of the search
};

/// The columns of `reader` for the joints, in their order, named by `columns` (see RecordingFormat) or by the first usual
/// pattern found in the table; empty if there is none or `columns` is "none". Throws Error if columns are missing or their
/// number differs from that of the joints.
std::vector<std::size_t> find_columns(const csv::Reader& reader, const std::string& file, const std::string& columns,
                                      const Quantity& quantity, std::span<const Axis> axes);

/// The time column: `column`, otherwise t, time or timestamp, ignoring case.
std::size_t find_time_column(const csv::Reader& reader, const std::string& file, const std::string& column);

extern const Quantity kPositions, kVelocities, kTorques, kExternalTorques;

}  // namespace cotwin::trajectory
