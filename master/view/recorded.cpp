#include "master/view/recorded.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <limits>
#include <optional>

#include "master/results/recording.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

constexpr double kLatest = 1e6;  // s; in ns below 2⁵³, so that JavaScript's numbers are exact

/// "drive.q[3]" → "drive.q" and 3; "q3" → "q" and 3.
struct Numbered {
  std::string name;
  std::size_t number;
  bool brackets;
};

std::optional<Numbered> numbered(const std::string& column) {
  const bool brackets = column.ends_with(']');
  std::size_t end = column.size() - (brackets ? 1 : 0), begin = end;
  while (begin > 0 && std::isdigit(static_cast<unsigned char>(column[begin - 1]))) --begin;
  constexpr std::size_t kMostDigits = 6;
  if (begin == end || end - begin > kMostDigits) return std::nullopt;
  const std::size_t name_end = brackets ? begin - 1 : begin;
  if (begin == 0 || name_end == 0 || (brackets && column[begin - 1] != '[')) return std::nullopt;
  return Numbered{column.substr(0, name_end), static_cast<std::size_t>(std::stoul(column.substr(begin, end - begin))),
                  brackets};
}

/// Joins columns that follow one another with the numbers 1, 2 … or (without brackets) 0, 1 …
std::vector<RecordedSignal> signals_of(const std::vector<std::string>& names) {
  std::vector<RecordedSignal> signals;
  for (std::size_t i = 0; i < names.size();) {
    std::size_t count = 1;
    const std::optional<Numbered> first = numbered(names[i]);
    if (first && first->number <= 1) {
      for (; i + count < names.size(); ++count) {
        const std::optional<Numbered> next = numbered(names[i + count]);
        if (!next || next->name != first->name || next->brackets != first->brackets || next->number != first->number + count)
          break;
      }
    }
    const bool vector = count > 1;
    signals.push_back({vector ? first->name : names[i], {}, i, count});
    i += count;
  }
  return signals;
}

bool ends_with_a_line(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in || in.tellg() <= 0) return true;
  in.seekg(-1, std::ios::end);
  return in.get() == '\n';
}

/// Why the cell of the current row is no time.
std::string why_no_time(const csv::Reader& csv, std::size_t column) {
  try {
    static_cast<void>(csv.real(column));
    return csv.place(column) + ": '" + std::string(csv.text(column)) + "', expected a time of at most " +
           text::to_text(kLatest) + " s";
  } catch (const Error& error) {
    return error.what();
  }
}

/// Whether anything follows a line that cannot be read.
bool more_lines(csv::Reader& csv) {
  try {
    return csv.next();
  } catch (const Error&) {
    return true;
  }
}

std::string rows(std::size_t count) { return std::to_string(count) + (count == 1 ? " row" : " rows"); }

}  // namespace

const RecordedSignal* Recorded::find(std::string_view name) const {
  const auto found = std::find_if(signals.begin(), signals.end(), [&](const RecordedSignal& s) { return s.name == name; });
  return found == signals.end() ? nullptr : &*found;
}

Recorded load_recorded(const std::filesystem::path& file, const std::function<void(double)>& progress,
                       const trajectory::TimeColumn& time) {
  csv::Reader csv(file);
  const std::vector<std::string>& names = csv.names();
  const std::size_t t = trajectory::find_time_column(csv, file.string(), time.name, report::kTimeRemedy);
  std::vector<std::size_t> from;
  std::vector<std::string> kept;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (i == t) continue;
    from.push_back(i);
    kept.push_back(names[i]);
  }
  if (kept.empty()) throw Error(file.string(), "has no column besides the time, expected recorded signals");
  Recorded recorded;
  recorded.signals = signals_of(kept);
  recorded.columns.resize(kept.size());
  recorded.names = kept;
  const std::string name = file.filename().string();
  const bool whole = ends_with_a_line(file);
  std::error_code none;
  const double size = static_cast<double>(std::filesystem::file_size(file, none));
  std::size_t bad_times = 0, no_numbers = 0, read = 0;  // read: about so many bytes
  std::string first_text, first_bad_time, unreadable;
  try {
    while (csv.next()) {
      constexpr std::size_t kRowsPerCall = 1000;
      if (progress && !recorded.time.empty() && recorded.time.size() % kRowsPerCall == 0)
        progress(std::min(static_cast<double>(read) / std::max(size, 1.0), 1.0));
      for (std::size_t i = 0; i < names.size(); ++i) read += csv.text(i).size() + 1;
      const std::optional<double> seconds = text::parse_real(csv.text(t));
      const bool valid = seconds && std::abs(*seconds * time.unit) <= kLatest;
      const std::int64_t ns = valid ? std::llround(*seconds * time.unit * 1e9) : 0;
      if (!valid || (!recorded.time.empty() && ns < recorded.time.back())) {
        if (bad_times++ == 0) first_bad_time = why_no_time(csv, t);
        continue;
      }
      recorded.time.push_back(ns);
      for (std::size_t i = 0; i < from.size(); ++i) {
        const std::optional<double> value = text::parse_real(csv.text(from[i]));
        if (!value && no_numbers++ == 0) first_text = csv.place(from[i]);
        recorded.columns[i].push_back(value.value_or(std::numeric_limits<double>::quiet_NaN()));
      }
    }
    if (!whole && !recorded.time.empty()) {
      recorded.time.pop_back();
      for (std::vector<double>& column : recorded.columns) column.pop_back();
      recorded.remarks.push_back(name + " was cut short: its last row, which has no end, is left out");
    }
  } catch (const Error& error) {
    recorded.remarks.push_back(name + (whole ? " is shown up to a row that cannot be read: " : " was cut short: ") +
                               error.what());
    if (whole || more_lines(csv)) unreadable = error.what();
  }
  if (recorded.time.empty() && bad_times > 0) unreadable = first_bad_time;
  if (recorded.time.empty() && !unreadable.empty()) throw Error(file.string(), "no row can be read: " + unreadable);
  if (bad_times > 0)
    recorded.remarks.push_back(name + ": " + rows(bad_times) + " left out, because their times are no numbers or go back");
  if (no_numbers > 0)
    recorded.remarks.push_back(first_text + ": no number; such cells are shown as gaps (" + std::to_string(no_numbers) + ")");
  return recorded;
}

}  // namespace cotwin::master
