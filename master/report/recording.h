#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "master/report/curve.h"
#include "models/support/csv.h"

/// Recordings (CSV) of runs, also of those that were cut short or contain anything else than numbers.
namespace cotwin::report {

/// Reads a recording row by row. What cannot be read becomes a note, not an error.
class RowReader {
 public:
  /// `words`: cells that are text, and the numbers that they stand for. Throws Error if there is no table at all.
  explicit RowReader(const std::filesystem::path& file, std::map<std::string, double, std::less<>> words = {});

  /// Columns without that of the time.
  const std::vector<std::string>& names() const { return names_; }
  /// Reads the next whole row with a time; false at the end, and where the rest cannot be read.
  bool next();
  double t() const { return row_[time_]; }  // s, or the unit of the file
  /// The value of a column of names(); NaN for an empty cell and for text.
  double value(std::size_t column) const { return row_[column < time_ ? column : column + 1]; }
  /// What was left out, after the last row: one sentence each.
  std::vector<std::string> notes() const;

 private:
  bool read(std::vector<double>& row);

  csv::Reader csv_;
  std::string file_;
  std::map<std::string, double, std::less<>> words_;
  std::vector<std::string> names_;
  std::size_t time_ = 0;
  bool unended_ = false;  // the last line has no line end: it may have been cut
  bool pending_ = false;  // next_row_ is a row that may be the last one
  bool at_end_ = false;
  std::vector<double> row_, next_row_;
  std::string why_ended_, first_text_;
  std::size_t texts_ = 0, without_time_ = 0;
  bool last_left_out_ = false;
};

/// A difference a − (factor · b + offset) of two signals, element by element.
struct Residual {
  std::string name, unit, a, b;
  double factor = 1, offset = 0;
  std::vector<std::string> elements;  // names for keys
  std::vector<Curve> curves;          // empty if the signals were not recorded
};

/// Time in contact, as far as the recorded rows show it.
struct ContactSpan {
  std::string component;
  double begin = 0, end = 0;                                                     // s
  double force = std::numeric_limits<double>::quiet_NaN(), penetration = force;  // N, m, largest recorded; NaN: not recorded
  bool open = false;                                                             // not over at the end
};

struct RecordedColumn {
  std::string name, unit;
  Curve curve;
  bool plotted = false;
};

/// Columns that belong together in a plot: the elements of a vector, or scalars of the same kind.
struct ColumnGroup {
  std::string name, unit;
  std::vector<std::size_t> columns;
};

struct RecordingOptions {
  std::map<std::string, std::string> units;  // by name of a column or of its vector
  std::vector<std::string> patterns;         // of the columns to plot; empty: all
  std::vector<Residual> residuals;           // to be computed
};

struct LoadedRecording {
  std::filesystem::path file;
  std::size_t rows = 0;
  double begin = 0, end = 0;  // s
  std::vector<RecordedColumn> columns;
  std::vector<ColumnGroup> groups;
  std::vector<Residual> residuals;
  std::vector<ContactSpan> contacts;       // by begin
  std::vector<std::string> contact_units;  // components with contacts that were recorded
  std::vector<std::string> notes;

  /// nullptr if there is none of that name.
  const RecordedColumn* find(std::string_view name) const;
};

/// Largest number of columns with points; the others have figures only.
inline constexpr std::size_t kMostPlotted = 400;

/// Reads the whole file once. Memory does not grow with its rows. Throws Error if there is no table.
LoadedRecording load_recording(const std::filesystem::path& file, RecordingOptions options);

/// "drive.q" of "drive.q[3]"; the name itself of a scalar.
std::string vector_of(std::string_view name);

/// Groups columns by vector; scalars of a component with the same unit and beginning ("drive.energy_…") are one group, as are
/// columns with numbers at the end ("q1", "q2") in files of other programs.
std::vector<ColumnGroup> grouped(std::span<const RecordedColumn> columns);

}  // namespace cotwin::report
