#pragma once
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <iosfwd>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// Tables as text: a header of column names, then rows of cells. Numbers have a decimal point, the same in every locale.
///
/// The reader accepts: comma, semicolon or tab between cells; cells in double quotes ("" inside is one quote; a quoted cell
/// ends on its line); LF or CRLF; a UTF-8 byte order mark; blank lines and comment lines (first character '#') anywhere. A
/// comment line ("# t,q1,q2") directly before a first row of numbers with as many cells is the header. A separator at the end
/// of the header and of the rows adds no column. A row that repeats the header (joined files) is passed over. Else Error `file.csv:17: …`.
namespace cotwin::csv {

struct Options {
  char separator = 0;      // ',', ';' or '\t'; 0: the most frequent one in the header
  std::string topic = {};  // of a ROS bag; "": the only one with joints
};

/// A table that is read row by row with one row in memory, so that files may exceed the memory.
class Source {
 public:
  virtual ~Source() = default;
  Source(const Source&) = delete;
  Source& operator=(const Source&) = delete;

  const std::vector<std::string>& names() const { return names_; }
  /// Index of the column with this name. Throws Error with the closest name.
  std::size_t column(std::string_view name) const;
  /// Reads the next row; false at the end. Throws Error for one that cannot be read.
  virtual bool next() = 0;
  /// Number of the current row in the file, from 1,
  std::size_t line() const { return line_; }
  /// what it counts ("line", "message"), and what stands before it in a place ("file.csv:").
  virtual const char* row() const { return "line"; }
  const std::string& before() const { return before_; }
  /// A cell of the current row without quotes and surrounding blanks; valid until next().
  virtual std::string_view text(std::size_t column) const = 0;
  /// A cell as a number, including "nan" and "inf". Throws Error `file.csv:17: column 'tau3': 'abc', expected a number`.
  virtual double real(std::size_t column) const = 0;
  /// Of a bag: messages without a value of one of these columns are left out, and counted.
  virtual void require(const std::vector<std::size_t>&) {}
  /// What a person should know of the rows so far: one sentence each.
  virtual std::vector<std::string> notes() const { return {}; }
  /// "file.csv:17"
  std::string place() const { return before_ + std::to_string(line_); }
  /// "file.csv:17: column 'tau3'"
  std::string place(std::size_t column) const { return place() + ": column '" + names_[column] + "'"; }

 protected:
  explicit Source(std::string file) : file_(std::move(file)), before_(file_ + ":") {}

  std::string file_, before_;
  std::vector<std::string> names_;
  std::size_t line_ = 0;
};

/// Opens a file that is no text: a ROS bag (models/bag, whose start() sets it). nullptr in exported units.
using Opener = std::unique_ptr<Source> (*)(const std::filesystem::path& file, const Options& options);
inline Opener bag_opener = nullptr;

/// Whether a file begins as a ROS bag: MCAP, SQLite, ROS 1; or a folder has a metadata.yaml.
bool is_bag(const std::filesystem::path& file);

/// A Reader, or what opens bags. Throws Error as these.
std::unique_ptr<Source> open(const std::filesystem::path& file, const Options& options = {});

/// A table of text.
class Reader final : public Source {
 public:
  /// Opens `file` and reads the header. Throws Error if it cannot be opened, is empty, or has no header or duplicate columns.
  explicit Reader(const std::filesystem::path& file, const Options& options = {});
  /// Reads text in memory, which must outlive the reader; `place` is its name in messages.
  Reader(std::string_view text, std::string place, const Options& options = {});

  char separator() const { return separator_; }
  /// Throws Error if the number of cells differs from the header's.
  bool next() override;
  std::string_view text(std::size_t column) const override { return cells_[column]; }
  double real(std::size_t column) const override;

 private:
  void read_header(const Options& options);
  bool next_line();
  bool refill();
  void split_line();
  void drop_empty_end();

  std::unique_ptr<std::ifstream> stream_;  // nullptr for text in memory
  std::string buffer_;                     // of the stream; begin_ and end_ point into it, or into the text
  const char* begin_ = nullptr;            // start of the text after the current line
  const char* end_ = nullptr;
  std::string_view current_;  // the current line without its end
  std::string unquoted_;      // its cells if some are quoted
  char separator_ = 0;
  bool pending_ = false;  // the current line is the first row, read together with a header in a comment
  std::vector<std::string_view> cells_;
};

/// A table in memory, column by column.
struct Table {
  std::string file;                          // for messages
  std::vector<std::string> names;            // m
  std::vector<std::vector<double>> columns;  // m, each as long as `lines`
  std::vector<std::size_t> lines;            // line number of each row, from 1

  std::size_t rows() const { return lines.size(); }
  /// Throws Error with the closest column name.
  const std::vector<double>& column(std::string_view name) const;
  /// "file.csv:17", "file.csv:17: column 'tau3'"
  std::string place(std::size_t row) const;
  std::string place(std::size_t row, std::size_t column) const;
};

/// Reads the named columns, or all of them, as numbers; the content of other columns is ignored.
Table load(const std::filesystem::path& file, const std::vector<std::string>& columns = {}, const Options& options = {});
Table parse(std::string_view text, const std::string& place, const std::vector<std::string>& columns = {},
            const Options& options = {});

/// Appends the shortest text that reads back to the same bits.
void append(std::string& line, double value);
/// Appends a cell, in quotes if it contains a quote, the separator, a line end or surrounding blanks, or begins like a comment
/// or a byte order mark; a line end becomes a blank.
void append(std::string& line, std::string_view cell, char separator = ',');

/// Writes a table row by row: the header, then rows with one cell per name.
class Writer {
 public:
  Writer(std::ostream& out, std::span<const std::string> names, char separator = ',');
  void cell(double value);
  void cell(std::string_view text);
  void end_row();
  void row(std::span<const double> values);

 private:
  void separate();

  std::ostream& out_;
  std::string line_;
  std::size_t width_;
  std::size_t cells_ = 0;
  char separator_;
};

}  // namespace cotwin::csv
