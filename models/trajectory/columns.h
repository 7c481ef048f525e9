#pragma once
#include <span>
#include <string>
#include <vector>

#include "models/support/csv.h"
#include "models/trajectory/axes.h"

namespace cotwin::trajectory {

/// A quantity of all joints in a table: what it is called in messages, and how columns of it are usually named.
struct Quantity {
  const char* name;                   // "q"
  std::vector<const char*> patterns;  // in the order in which they are tried
};

/// The columns of `reader` for the joints, in their order, named by `columns` (see RecordingFormat) or by the first usual
/// pattern that the table has; empty if it has none, or `columns` is "none". Throws Error for columns that the table lacks, or
/// that are not as many as the joints.
std::vector<std::size_t> find_columns(const csv::Reader& reader, const std::string& file, const std::string& columns,
                                      const Quantity& quantity, std::span<const Axis> axes);

/// The column of time: `column`, or else t, time or timestamp, whatever their case.
std::size_t find_time_column(const csv::Reader& reader, const std::string& file, const std::string& column);

extern const Quantity kPositions, kVelocities, kTorques, kExternalTorques;

}  // namespace cotwin::trajectory
