#pragma once
#include <span>
#include <string>
#include <vector>

#include "models/foundation/formats/csv.h"
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
std::vector<std::size_t> find_columns(const csv::Source& reader, const std::string& file, const std::string& columns,
                                      const Quantity& quantity, std::span<const Axis> axes);

/// The patterns of a table's numbered columns, for messages: "; numbered columns of the table: 'pos{}', 'current_{0}'". If there are none, its first
/// columns: "; columns of the table: 't', 'x'". Tells where blanks seem to separate them.
std::string table_columns(const std::vector<std::string>& names);

/// The time column: `column`, otherwise t, time or timestamp, ignoring case. Throws Error if there is none; `remedy` says in the
/// message what else can be given.
std::size_t find_time_column(const csv::Source& reader, const std::string& file, const std::string& column,
                             const char* remedy = ", the name of the time column, or a sampling rate");

/// The time column of a table.
struct TimeColumn {
  std::string name;        // "": t, time or timestamp
  double unit = 1;         // s per unit of the column
  std::string topic = {};  // of a ROS bag, see csv::Options
};
/// Seconds per "s", "ms", "us" or "ns". Throws Error for another word; `option` is its place in the message.
double seconds_per(const std::string& option, const std::string& word);

extern const Quantity kPositions, kVelocities, kTorques, kExternalTorques;

}  // namespace cotwin::trajectory
