#include <array>
#include <charconv>
#include <ostream>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::csv {

void append(std::string& line, double value) {
  std::array<char, 32> digits;
  const auto result = std::to_chars(digits.data(), digits.data() + digits.size(), value);
  line.append(digits.data(), result.ptr);
}

void append(std::string& line, std::string_view cell, char separator) {
  constexpr std::string_view kMarks = "#\xEF\xFE\xFF";  // first bytes of a comment and of byte order marks
  const bool plain = cell.find_first_of("\"\r\n") == std::string_view::npos && cell.find(separator) == std::string_view::npos &&
                     text::trim(cell).size() == cell.size() &&
                     (cell.empty() || kMarks.find(cell.front()) == std::string_view::npos);
  if (plain) {
    line += cell;
    return;
  }
  line += '"';
  for (const char c : cell) {
    if (c == '"') line += c;
    line += c == '\n' || c == '\r' ? ' ' : c;  // a row is one line
  }
  line += '"';
}

Writer::Writer(std::ostream& out, std::span<const std::string> names, char separator)
    : out_(out), width_(names.size()), separator_(separator) {
  for (const std::string& name : names) cell(name);
  end_row();
}

void Writer::separate() {
  if (cells_++ > 0) line_ += separator_;
}

void Writer::cell(double value) {
  separate();
  append(line_, value);
}

void Writer::cell(std::string_view text) {
  separate();
  append(line_, text, separator_);
}

void Writer::end_row() {
  if (cells_ != width_) throw Error("table", std::to_string(cells_) + " cells in a row, expected " + std::to_string(width_));
  line_ += '\n';
  out_.write(line_.data(), static_cast<std::streamsize>(line_.size()));
  line_.clear();
  cells_ = 0;
}

void Writer::row(std::span<const double> values) {
  for (const double value : values) cell(value);
  end_row();
}

}  // namespace cotwin::csv
