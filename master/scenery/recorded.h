#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "components/unit/variables.h"
#include "master/results/recording.h"
#include "models/trajectory/columns.h"

namespace cotwin::master {

/// Columns of a recording that belong together: the elements of one variable.
struct RecordedSignal {
  std::string name;                  // "drive.q"; of a single element "drive.q[3]"
  std::string unit = {};             // of measure; "" if it is not known
  std::size_t first = 0, count = 0;  // columns
  Elements elements = {};            // names, and units of measure where they differ; then `unit` is ""
};

/// A recording as it is in its file, however it ended.
struct Recorded {
  std::vector<std::int64_t> time;            // ns, does not decrease
  std::vector<std::vector<double>> columns;  // without the time; NaN for cells that are no numbers
  std::vector<RecordedSignal> signals;
  std::vector<std::string> remarks;  // for people: what was left out

  /// Names of all columns, without the time: "drive.q[3]".
  std::vector<std::string> names;
  const RecordedSignal* find(std::string_view name) const;
  std::span<const double> column(const RecordedSignal& signal, std::size_t element) const {
    return columns[signal.first + element];
  }
};

/// Reads a recording (CSV). `time`: which column is the time, and its unit. `facts`: what is known of its columns. Columns x[1], x[2] …, and x1, x2 …, become one signal. Reading ends, with a remark, at a row that has too few or too many cells; so does a last row without a line
/// end, because a number in it may be cut. Rows whose time is not finite, decreases or is beyond 10⁶ s are left out, with a remark.
/// Throws Error if the file cannot be opened, has no header, no time or no column besides it, and if it has rows and none can be read. `progress` gets the share of the file that was read.
Recorded load_recorded(const std::filesystem::path& file, const std::function<void(double share)>& progress = {},
                       const trajectory::TimeColumn& time = {}, const report::ColumnFacts& facts = {});

/// Reads view.bin (master/run/columns.h), also of a run that was killed. Throws Error for a file that is none, and for a time that decreases.
Recorded load_view_data(const std::filesystem::path& file);
/// The same of the bytes of a file; `place`: for messages.
Recorded parse_view_data(const std::string& bytes, const std::string& place);

/// `base` with the signals that only `other` has, at the times of base: linear between the rows.
Recorded joined(Recorded base, const Recorded& other);

}  // namespace cotwin::master
