#pragma once
#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// Writes a report as one HTML page that needs no script, no network and no other file.
namespace cotwin::report {

/// `text` for the content of an element or an attribute in double quotes: markup is escaped; control characters and bytes that
/// are not UTF-8 become U+FFFD; of more than `most` bytes the rest is left out, with "…".
std::string escaped(std::string_view text, std::size_t most = 2000);

/// `text` in a <code> element, escaped.
std::string code(std::string_view text);

/// Four significant digits; "–" for NaN.
std::string number(double value, int digits = 4);

/// A name with its unit of measure: "drive.q [rad]".
std::string with_unit(const std::string& name, const std::string& unit);

/// A cell of a table.
struct Cell {
  std::string html;
  bool is_number = false;

  Cell(const char* text) : html(escaped(text)) {}               // NOLINT: implicit on purpose
  Cell(const std::string& text) : html(escaped(text)) {}        // NOLINT
  Cell(double value) : html(number(value)), is_number(true) {}  // NOLINT
  static Cell of_html(std::string html) {
    Cell cell("");
    cell.html = std::move(html);
    return cell;
  }
};

/// The columns of a table: text on the left, numbers on the right.
class Table {
 public:
  /// `text_columns`: number of columns, from the first, that are text; `last_is_text`: also the last one.
  explicit Table(std::vector<std::string> heads, std::size_t text_columns = 1, bool last_is_text = false);
  void row(std::vector<Cell> cells);
  bool empty() const { return rows_ == 0; }
  std::string html(const std::string& caption) const;

 private:
  std::string cell(const char* element, std::size_t column, const std::string& html, bool is_number) const;
  std::vector<std::string> heads_;
  std::size_t text_columns_;
  bool last_is_text_;
  std::string body_;
  std::size_t rows_ = 0;
};

class Page {
 public:
  explicit Page(std::string title) : title_(std::move(title)) {}

  /// A heading of level 2 to 4; those of level 2 and 3 are in the list of contents. `new_page`: begins a page when printed.
  void heading(int level, const std::string& text, bool new_page = false);
  void paragraph(const std::string& html) { body_ += "<p>" + html + "</p>\n"; }
  /// Something that the reader must notice: missing data, a failed run.
  void note(const std::string& text) { body_ += "<p class=\"note\">" + escaped(text) + "</p>\n"; }
  void alarm(const std::string& text) { body_ += "<p class=\"bad\">" + escaped(text) + "</p>\n"; }
  void table(const Table& table, const std::string& caption = "") { body_ += table.html(caption); }
  /// `svg`: of this program or cleaned (plot.h). `caption_html` is above it, `below_html` below it.
  void figure(const std::string& svg, const std::string& caption_html, const std::string& below_html = "");

  /// The whole document. `footer_html`: its last line.
  std::string html(const std::string& footer_html) const;

 private:
  struct Entry {
    int level;
    std::string id, text;
  };
  std::string title_, body_;
  std::vector<Entry> contents_;
};

}  // namespace cotwin::report
