#include "models/foundation/formats/csv.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <ext/stdio_filebuf.h>
#include <numeric>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "models/foundation/formats/xml_text.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::csv {

namespace {

constexpr std::size_t kChunk = std::size_t{1} << 20;    // bytes read at once
constexpr std::size_t kLongest = std::size_t{1} << 26;  // bytes of a line; longer lines indicate a file that is not a table
constexpr std::size_t kMostColumns = 4'000'000;

const char* name_of(char separator) { return separator == ';' ? "semicolon" : separator == '\t' ? "tab" : "comma"; }

/// Text of a cell for messages: shortened and printable.
std::string shown(std::string_view cell) {
  std::string text(cell.substr(0, 40));
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  return "'" + text + (cell.size() > 40 ? "…" : "") + "'";
}

char most_frequent_separator(std::string_view header) {
  constexpr std::array<char, 3> kSeparators = {',', ';', '\t'};
  std::array<std::size_t, 3> counts{};
  bool quoted = false;
  for (const char c : header) {
    if (c == '"') quoted = !quoted;
    for (std::size_t k = 0; k < kSeparators.size(); ++k) counts[k] += !quoted && c == kSeparators[k] ? 1 : 0;
  }
  return kSeparators[static_cast<std::size_t>(std::max_element(counts.begin(), counts.end()) - counts.begin())];
}

bool is_number(std::string_view cell) { return text::parse_real(cell).has_value(); }

bool has_decimal_comma(std::string_view cell) {
  if (std::count(cell.begin(), cell.end(), ',') != 1) return false;
  std::string with_point(cell);
  std::replace(with_point.begin(), with_point.end(), ',', '.');
  return is_number(with_point);
}

std::string no_such_column(std::string_view name, const std::vector<std::string>& names) {
  const std::string candidate = text::closest(name, names);
  std::string message = "has no column '" + std::string(name) + "'";
  if (!candidate.empty()) return message + ", did you mean '" + candidate + "'?";
  if (names.size() == 1 && names[0].find(' ') != std::string::npos)
    return message + "; the table has one column, whose name has blanks, expected a comma, semicolon or tab between cells";
  message += ", expected one of";
  for (const std::string& n : names) {
    message += " '" + n + "'";
    if (message.size() > 300) return message + " …";
  }
  return message;
}

/// A stream of an opened file.
class FileStream final : public std::ifstream {
 public:
  explicit FileStream(text::File file) : file_(std::move(file)), buffer_(file_.get(), std::ios::in | std::ios::binary) {
    std::ios::rdbuf(&buffer_);
  }

 private:
  text::File file_;
  __gnu_cxx::stdio_filebuf<char> buffer_;
};

text::File open_text(const std::filesystem::path& file) {
  if (is_bag(file)) throw Error(file.string(), "is a ROS bag, expected a table (CSV): cotwin info BAG --csv FILE writes one");
  return text::open_file(file, "a table (CSV)");
}

}  // namespace

Reader::Reader(const std::filesystem::path& file, const Options& options)
    : Source(file.string()), stream_(std::make_unique<FileStream>(open_text(file))) {
  buffer_.resize(kChunk);
  begin_ = end_ = buffer_.data();
  read_header(options);
}

Reader::Reader(std::string_view text, std::string place, const Options& options)
    : Source(std::move(place)), begin_(text.data()), end_(text.data() + text.size()) {
  read_header(options);
}

bool is_bag(const std::filesystem::path& file) {
  std::error_code none;
  if (std::filesystem::is_directory(file, none)) return std::filesystem::is_regular_file(file / "metadata.yaml", none);
  if (!std::filesystem::is_regular_file(file, none)) return false;
  std::array<char, 16> first{};
  std::ifstream(file, std::ios::binary).read(first.data(), first.size());
  const std::string_view begin(first.data(), first.size());
  return begin.starts_with("\x89MCAP") || begin.starts_with("SQLite format 3") || begin.starts_with("#ROSBAG V");
}

std::unique_ptr<Source> open(const std::filesystem::path& file, const Options& options) {
  if (bag_opener != nullptr && is_bag(file)) return bag_opener(file, options);
  if (!options.topic.empty()) throw Error(file.string(), "is no ROS bag, expected one with a topic");
  return std::make_unique<Reader>(file, options);
}

std::size_t Source::column(std::string_view name) const {
  const auto found = std::find(names_.begin(), names_.end(), name);
  if (found == names_.end()) throw Error(file_, no_such_column(name, names_));
  return static_cast<std::size_t>(found - names_.begin());
}

// Moves the rest of the buffer to its front and fills the remaining space. False at the end of the file.
bool Reader::refill() {
  if (!stream_) return false;
  const std::size_t left = static_cast<std::size_t>(end_ - begin_);
  if (left > kLongest)
    throw Error(file_ + ":" + std::to_string(line_ + 1), "line of more than 64 MiB, expected a table of text");
  std::memmove(buffer_.data(), begin_, left);
  if (buffer_.size() < left + kChunk) buffer_.resize(2 * (left + kChunk));
  stream_->read(buffer_.data() + left, static_cast<std::streamsize>(buffer_.size() - left));
  if (stream_->bad()) throw Error(file_, "reading failed");
  begin_ = buffer_.data();
  end_ = begin_ + left + static_cast<std::size_t>(stream_->gcount());
  return stream_->gcount() > 0;
}

// Reads the next line, without its end, into `current_`; false at the end of the file.
bool Reader::next_line() {
  std::size_t seen = 0;  // bytes already searched for a line end
  for (;;) {
    const std::size_t left = static_cast<std::size_t>(end_ - begin_);
    const void* found = left > seen ? std::memchr(begin_ + seen, '\n', left - seen) : nullptr;
    if (found) {
      const char* stop = static_cast<const char*>(found);
      current_ = std::string_view(begin_, static_cast<std::size_t>(stop - begin_));
      begin_ = stop + 1;
      break;
    }
    seen = left;
    if (refill()) continue;
    if (begin_ == end_) return false;
    current_ = std::string_view(begin_, static_cast<std::size_t>(end_ - begin_));
    begin_ = end_;
    break;
  }
  ++line_;
  if (!current_.empty() && current_.back() == '\r') current_.remove_suffix(1);
  return true;
}

void Reader::read_header(const Options& options) {
  if (options.separator && !std::strchr(",;\t", options.separator)) {
    throw Error(file_, "separator " + shown(std::string(1, options.separator)) + ", expected a comma, a semicolon or a tab");
  }
  std::string comment;  // the last one before the header
  bool found = false;
  while (!found && next_line()) {
    if (line_ == 1) {
      if (current_.substr(0, 2) == "\xFF\xFE" || current_.substr(0, 2) == "\xFE\xFF")
        throw Error(file_, xml::why_not_utf8(current_, ""));
      if (current_.substr(0, 3) == "\xEF\xBB\xBF") current_.remove_prefix(3);
    }
    if (current_.find('\r') != std::string_view::npos)
      throw Error(place(), "carriage return within the line, expected LF or CRLF at its end");
    const std::string_view content = text::trim(current_);
    if (content.empty()) continue;
    if (content.front() == '#') {
      comment = std::string(content.substr(1));
    } else {
      found = true;
    }
  }
  if (!found) throw Error(file_, "is empty, expected a line of column names");

  separator_ = options.separator ? options.separator : most_frequent_separator(current_);
  split_line();
  drop_empty_end();
  if (std::all_of(cells_.begin(), cells_.end(), is_number)) {
    const std::size_t width = cells_.size();
    const std::string_view first_row = current_;
    current_ = comment;
    split_line();
    drop_empty_end();
    if (cells_.size() != width || std::any_of(cells_.begin(), cells_.end(), is_number) || text::trim(comment).empty()) {
      throw Error(place(), "the first row contains only numbers, expected column names");
    }
    for (const std::string_view cell : cells_) names_.emplace_back(cell);
    current_ = first_row;
    pending_ = true;
  } else {
    for (const std::string_view cell : cells_) names_.emplace_back(cell);
  }
  std::unordered_set<std::string_view> seen;
  seen.reserve(names_.size());
  for (const std::string& name : names_) {
    if (!name.empty() && !seen.insert(name).second)
      throw Error(place(), "column " + shown(name) + " occurs twice, expected different names");
  }
}

// A separator at the end of a header adds no column.
void Reader::drop_empty_end() {
  if (cells_.size() > 1 && cells_.back().empty()) cells_.pop_back();
}

bool Reader::next() {
  do {
    if (pending_) {
      pending_ = false;
    } else {
      std::string_view content;
      do {
        if (!next_line()) return false;
        content = text::trim(current_);
      } while (content.empty() || content.front() == '#');
    }
    split_line();
    if (cells_.size() == names_.size() + 1 && cells_.back().empty()) cells_.pop_back();
  } while (std::ranges::equal(cells_, names_));
  if (cells_.size() != names_.size()) {
    throw Error(place(), std::to_string(cells_.size()) + (cells_.size() == 1 ? " cell" : " cells") + " separated by " +
                             name_of(separator_) + ", expected " + std::to_string(names_.size()) + " as in the header");
  }
  return true;
}

// Splits `current_` into `cells_`. Cells refer to the line, or to `unquoted_` if quotes were removed.
void Reader::split_line() {
  cells_.clear();
  const auto add_cell = [this](std::string_view cell) {
    if (cells_.size() == kMostColumns) throw Error(place(), "more than " + std::to_string(kMostColumns) + " cells in a row");
    cells_.push_back(cell);
  };
  const char* at = current_.data();
  const char* const stop = at + current_.size();
  if (current_.find('"') == std::string_view::npos) {
    for (;;) {
      const void* found = at == stop ? nullptr : std::memchr(at, separator_, static_cast<std::size_t>(stop - at));
      const char* end = found ? static_cast<const char*>(found) : stop;
      const char* last = end;
      while (at != last && (*at == ' ' || *at == '\t')) ++at;
      while (at != last && (last[-1] == ' ' || last[-1] == '\t')) --last;
      add_cell({at, static_cast<std::size_t>(last - at)});
      if (!found) return;
      at = end + 1;
    }
  }
  unquoted_.clear();
  unquoted_.reserve(current_.size());  // keeps the cells' addresses valid
  for (;;) {
    while (at != stop && *at != separator_ && (*at == ' ' || *at == '\t')) ++at;
    const std::size_t start = unquoted_.size();
    if (at != stop && *at == '"') {
      for (++at;; ++at) {
        if (at == stop) throw Error(place(), "a quoted cell does not end on its line, expected '\"'");
        if (*at != '"') {
          unquoted_ += *at;
        } else if (at + 1 != stop && at[1] == '"') {
          unquoted_ += *at++;
        } else {
          break;
        }
      }
      for (++at; at != stop && *at != separator_; ++at) {
        if (*at != ' ' && *at != '\t')
          throw Error(place(), "text follows the end of a quoted cell, expected a " + std::string(name_of(separator_)));
      }
      add_cell({unquoted_.data() + start, unquoted_.size() - start});
    } else {
      const char* const begin = at;
      while (at != stop && *at != separator_) ++at;
      add_cell(text::trim(std::string_view(begin, static_cast<std::size_t>(at - begin))));
    }
    if (at == stop) return;
    ++at;
  }
}

double Reader::real(std::size_t column) const {
  const std::string_view cell = cells_[column];
  double value = 0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (error == std::errc{} && end == cell.data() + cell.size()) return value;
  if (cell.empty()) throw Error(place(column), "empty, expected a number");
  if (const auto other = text::parse_real(cell)) return *other;  // "+1"
  if (error == std::errc::result_out_of_range)
    throw Error(place(column), shown(cell) + ", expected a number that fits a double");
  if (has_decimal_comma(cell)) throw Error(place(column), shown(cell) + " has a decimal comma, expected a decimal point");
  throw Error(place(column), shown(cell) + ", expected a number");
}

std::string Table::place(std::size_t row) const { return file + ":" + std::to_string(lines[row]); }

std::string Table::place(std::size_t row, std::size_t column) const { return place(row) + ": column '" + names[column] + "'"; }

const std::vector<double>& Table::column(std::string_view name) const {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) throw Error(file, no_such_column(name, names));
  return columns[static_cast<std::size_t>(found - names.begin())];
}

namespace {

Table read_all(Reader& reader, const std::string& file, const std::vector<std::string>& columns) {
  Table table;
  table.file = file;
  table.names = columns.empty() ? reader.names() : columns;
  std::vector<std::size_t> chosen(table.names.size());
  if (columns.empty()) {
    std::iota(chosen.begin(), chosen.end(), std::size_t{0});
  } else {
    std::unordered_map<std::string_view, std::size_t> index;  // faster than column(), which searches all names
    for (std::size_t c = 0; c < reader.names().size(); ++c) index.emplace(reader.names()[c], c);
    std::transform(columns.begin(), columns.end(), chosen.begin(), [&](const std::string& name) {
      const auto found = index.find(name);
      return found == index.end() ? reader.column(name) : found->second;  // throws Error with the closest name
    });
  }
  table.columns.resize(chosen.size());
  while (reader.next()) {
    for (std::size_t c = 0; c < chosen.size(); ++c) table.columns[c].push_back(reader.real(chosen[c]));
    table.lines.push_back(reader.line());
  }
  return table;
}

}  // namespace

Table load(const std::filesystem::path& file, const std::vector<std::string>& columns, const Options& options) {
  Reader reader(file, options);
  return read_all(reader, file.string(), columns);
}

Table parse(std::string_view text, const std::string& place, const std::vector<std::string>& columns, const Options& options) {
  Reader reader(text, place, options);
  return read_all(reader, place, columns);
}

}  // namespace cotwin::csv
