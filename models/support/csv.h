#pragma once
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <iosfwd>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// Tables as text: a header of column names, then rows of cells. Numbers have a decimal point, the same in every locale.
///
/// Read are: comma, semicolon or tab between cells; cells in double quotes ("" inside stands for one quote; a quoted cell ends
/// on its line); LF or CRLF; a UTF-8 byte order mark; blank lines, and comment lines that begin with '#', anywhere. A header
/// that is itself a comment ("# t,q1,q2" above a first row of numbers, with as many cells) counts as the header. A separator at
/// the end of the header and of the rows adds no column. Everything else is an Error `file.csv:17: …`.
namespace cotwin::csv {

struct Options {
  char separator = 0;  // ',', ';' or '\t'; 0: whichever is most frequent in the header
};

/// Reads a table row by row, in memory for one row, so that files may be larger than memory.
class Reader {
 public:
  /// Opens `file` and reads the header. Throws Error if it cannot be opened, is empty, has no header or doubled column names.
  explicit Reader(const std::filesystem::path& file, const Options& options = {});
  /// The same from text in memory, which must outlive the reader; `place` stands in messages where a file name would.
  Reader(std::string_view text, std::string place, const Options& options = {});
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  const std::vector<std::string>& names() const { return names_; }
  /// The column of that name. Throws Error that names the closest one.
  std::size_t column(std::string_view name) const;
  char separator() const { return separator_; }

  /// Goes to the next row; false at the end. Throws Error if it has another number of cells than the header.
  bool next();
  /// The line of the file, counted from 1, that holds the current row.
  std::size_t line() const { return line_; }
  /// A cell of the current row without its quotes and the blanks around it; valid until next().
  std::string_view text(std::size_t column) const { return cells_[column]; }
  /// The same as a number; "nan" and "inf" are numbers. Throws Error `file.csv:17: column 'tau3': 'abc', expected a number`.
  double real(std::size_t column) const;
  /// "file.csv:17"
  std::string place() const;
  /// "file.csv:17: column 'tau3'"
  std::string place(std::size_t column) const;

 private:
  void read_header(const Options& options);
  bool next_line();
  bool refill();
  void split_line();
  void drop_empty_end();

  std::string file_;
  std::unique_ptr<std::ifstream> stream_;  // none where the text is in memory
  std::string buffer_;                     // of the stream; begin_ and end_ lie in it, or in the text
  const char* begin_ = nullptr;            // what follows the current line
  const char* end_ = nullptr;
  std::string_view current_;  // the current line without its end
  std::string unquoted_;      // its cells, where some are quoted
  std::size_t line_ = 0;
  char separator_ = 0;
  bool pending_ = false;  // the current line is the first row, read together with a header in a comment
  std::vector<std::string> names_;
  std::vector<std::string_view> cells_;
};

/// A table in memory, column by column.
struct Table {
  std::string file;                          // for messages
  std::vector<std::string> names;            // m
  std::vector<std::vector<double>> columns;  // m, each as long as `lines`
  std::vector<std::size_t> lines;            // of each row, counted from 1

  std::size_t rows() const { return lines.size(); }
  /// Throws Error that names the closest column.
  const std::vector<double>& column(std::string_view name) const;
  /// "file.csv:17", "file.csv:17: column 'tau3'"
  std::string place(std::size_t row) const;
  std::string place(std::size_t row, std::size_t column) const;
};

/// Reads the named columns, or all of them, as numbers; the other columns may hold anything.
Table load(const std::filesystem::path& file, const std::vector<std::string>& columns = {}, const Options& options = {});
Table parse(std::string_view text, const std::string& place, const std::vector<std::string>& columns = {},
            const Options& options = {});

/// Appends the shortest text that reads back to the same bits.
void append(std::string& line, double value);
/// Appends a cell, in quotes if it holds a quote, the separator, a line end, blanks at its ends, or begins like a comment or a
/// byte order mark; a line end becomes a blank.
void append(std::string& line, std::string_view cell, char separator = ',');

/// Writes a table row by row: the header, then as many cells a row as there are names.
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
