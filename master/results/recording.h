#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "master/results/curve.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/trajectory/columns.h"

/// Recordings (CSV) of runs, also of those that were cut short or contain anything else than numbers.
namespace cotwin::report {

/// What a message about a missing time column offers.
inline constexpr const char* kTimeRemedy = " or --t-column NAME";

/// What run.json tells of a column.
struct ColumnFact {
  std::string name;   // "drive.q[3]", also where the file has the joint's name in its place
  std::string unit;   // of measure
  std::string joint;  // to which it belongs; "": none
};
using ColumnFacts = std::map<std::string, ColumnFact, std::less<>>;  // by the name in the file

/// "drive.q quill", or the column's own name without a joint.
std::string shown_name(const ColumnFacts& facts, const std::string& column);
/// "drive.q[quill]", as --joint-names writes it; the column's own name without a joint.
std::string joint_name(const std::string& column, const std::string& joint);

/// Reads a recording row by row. What cannot be read becomes a note, not an error.
class RowReader {
 public:
  /// `words`: cells that are text, and the numbers that they stand for. `facts`: columns get the names of these. Throws Error if there is
  /// no table at all, or no time.
  explicit RowReader(const std::filesystem::path& file, const trajectory::TimeColumn& time = {},
                     std::map<std::string, double, std::less<>> words = {}, const ColumnFacts& facts = {});

  /// Columns without that of the time.
  const std::vector<std::string>& names() const { return names_; }
  /// Reads the next whole row with a time; false at the end, and where the rest cannot be read.
  bool next();
  /// Reads only these columns of names(); the others are NaN, without a note.
  void only(const std::vector<std::size_t>& columns);
  double t() const { return unit_ * row_[time_]; }  // s
  /// The value of a column of names(); NaN for an empty cell and for text.
  double value(std::size_t column) const { return row_[column < time_ ? column : column + 1]; }
  /// What was left out, after the last row: one sentence each.
  std::vector<std::string> notes() const;
  /// After the last row, if there was no row: throws Error with the reason if the file has rows and none can be read.
  void check_that_rows_were_read() const;

 private:
  bool read(std::vector<double>& row);
  bool more_lines();
  std::string reason_without_time() const;

  std::unique_ptr<csv::Source> csv_;
  std::string path_, file_;
  std::map<std::string, double, std::less<>> words_;
  std::vector<std::string> names_;
  std::size_t time_ = 0;
  double unit_ = 1;
  std::vector<std::size_t> read_;  // columns of the file that are read
  bool unended_ = false;           // the last line has no line end: it may have been cut
  bool cut_ = false;               // the same, after the last line was read
  bool pending_ = false;           // next_row_ is a row that may be the last one
  bool at_end_ = false;
  std::vector<double> row_, next_row_;
  std::string why_ended_, first_text_, first_without_time_;
  std::size_t texts_ = 0, without_time_ = 0;
  bool last_left_out_ = false;
  bool ended_within_ = false;  // lines follow that at which reading ended
};

/// A difference a − (factor · b + offset) of two signals, element by element, or the rotation vector from quaternion b to a.
struct Residual {
  std::string name, unit, a, b;
  double factor = 1, offset = 0;
  std::vector<std::string> elements;  // names of the columns of a
  std::vector<Curve> curves;          // empty if the signals were not recorded
  bool attitude = false;              // a rotation vector: three curves
  std::vector<std::string> units{};   // of elements that differ; else empty
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
  std::string joint;  // to which it belongs; "": none
};

/// Columns that belong together in a plot: the elements of a vector, or scalars of the same kind.
struct ColumnGroup {
  std::string name, unit;
  std::vector<std::size_t> columns;
};

struct RecordingOptions {
  ColumnFacts facts;
  std::vector<std::string> patterns;  // of the columns to plot; empty: all
  std::vector<Residual> residuals;    // to be computed
  trajectory::TimeColumn time;
};

struct LoadedRecording {
  std::filesystem::path file;
  trajectory::TimeColumn time;
  ColumnFacts facts;
  std::size_t rows = 0;
  double begin = 0, end = 0;            // s
  std::vector<std::string> names;       // of all columns, without the time
  std::vector<RecordedColumn> columns;  // the first ones of them
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

/// Reads the whole file once. Memory does not grow with its rows. Throws Error if there is no table, no time, or no row that can be
/// read.
LoadedRecording load_recording(const std::filesystem::path& file, RecordingOptions options);

/// "drive.q" of "drive.q[3]"; the name itself of a scalar.
std::string vector_of(std::string_view name);

/// Whether a pattern selects a column, by its own name, with that of its joint, or by that of its vector.
bool selects(const std::string& pattern, const std::string& column, const std::string& joint = "");
/// The error of a pattern that selects none of the columns of a file.
Error no_signal(const std::string& file, const std::string& pattern, const std::vector<std::string>& columns);

/// Groups columns by vector; scalars of a component with the same unit and beginning ("drive.energy_…") are one group, as are
/// columns with numbers at the end ("q1", "q2") in files of other programs.
std::vector<ColumnGroup> grouped(std::span<const RecordedColumn> columns);

}  // namespace cotwin::report
