#include "master/scenery/recorded.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "master/results/results.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
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

/// Gives signals what is known of their columns. `facts`: by the columns' own names.
void tell(std::vector<RecordedSignal>& signals, const std::vector<std::string>& names, const report::ColumnFacts& facts) {
  for (RecordedSignal& signal : signals) {
    std::set<std::string> units;
    for (std::size_t i = signal.first; i < signal.first + signal.count; ++i) {
      const auto fact = facts.find(names[i]);
      if (fact == facts.end()) break;
      units.insert(fact->second.unit);
      signal.elements.si.push_back(fact->second.unit);
      if (!fact->second.joint.empty()) signal.elements.names.push_back(fact->second.joint);
    }
    if (signal.elements.names.size() != signal.count) signal.elements.names.clear();
    if (units.size() == 1) signal.unit = *units.begin();
    if (units.size() == 1 || signal.elements.si.size() != signal.count) signal.elements.si.clear();
  }
}

report::ColumnFacts by_own_name(const report::ColumnFacts& in_file) {
  report::ColumnFacts facts;
  for (const auto& [name, fact] : in_file) facts.emplace(fact.name, fact);
  return facts;
}

std::string rows(std::size_t count) { return std::to_string(count) + (count == 1 ? " row" : " rows"); }

}  // namespace

const RecordedSignal* Recorded::find(std::string_view name) const {
  const auto found = std::find_if(signals.begin(), signals.end(), [&](const RecordedSignal& s) { return s.name == name; });
  return found == signals.end() ? nullptr : &*found;
}

Recorded load_recorded(const std::filesystem::path& file, const std::function<void(double)>& progress,
                       const trajectory::TimeColumn& time, const report::ColumnFacts& facts) {
  csv::Reader csv(file);
  const std::vector<std::string>& names = csv.names();
  const std::size_t t = trajectory::find_time_column(csv, file.string(), time.name, report::kTimeRemedy);
  std::vector<std::size_t> from;
  std::vector<std::string> kept;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (i == t) continue;
    from.push_back(i);
    const auto fact = facts.find(names[i]);
    kept.push_back(fact == facts.end() ? names[i] : fact->second.name);
  }
  if (kept.empty()) throw Error(file.string(), "has no column besides the time, expected recorded signals");
  Recorded recorded;
  recorded.signals = signals_of(kept);
  tell(recorded.signals, kept, by_own_name(facts));
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

Recorded load_view_data(const std::filesystem::path& file) {
  constexpr std::uint64_t kNoLimit = ~std::uint64_t{0};
  return parse_view_data(text::read_file(file, "what pages show of a run", kNoLimit), file.string());
}

Recorded parse_view_data(const std::string& bytes, const std::string& place) {
  constexpr double kMostElements = 1e6;
  const std::size_t end = bytes.find('\n');
  const nlohmann::json heading = nlohmann::json::parse(bytes.substr(0, end), nullptr, false);
  if (end == std::string::npos || report::member(heading, "format") != "cotwin view 1")
    throw Error(place, "has no heading of this version, expected view.bin of a run");
  Recorded recorded;
  for (const nlohmann::json& column : report::list_of(report::member(heading, "columns"))) {
    const std::string name = report::text_of(report::member(column, "name"));
    const double count = report::number_of(report::member(column, "elements"));
    if (name == "time") continue;
    if (name.empty() || !(count >= 1 && count + static_cast<double>(recorded.names.size()) <= kMostElements))
      throw Error(place, "has a heading that is damaged, expected names and numbers of elements");
    recorded.signals.push_back({name, {}, recorded.names.size(), static_cast<std::size_t>(count)});
    for (std::size_t i = 1; i <= recorded.signals.back().count; ++i)
      recorded.names.push_back(count == 1 ? name : name + "[" + std::to_string(i) + "]");
  }
  tell(recorded.signals, recorded.names, report::column_facts({{"recording", heading}}));
  const std::size_t width = recorded.names.size(), row = sizeof(std::int64_t) + width * sizeof(float);
  recorded.columns.resize(width);
  for (std::size_t at = end + 1; at + row <= bytes.size(); at += row) {
    std::int64_t ns = 0;
    std::memcpy(&ns, bytes.data() + at, sizeof ns);
    if (std::abs(static_cast<double>(ns) * 1e-9) > kLatest || (!recorded.time.empty() && ns < recorded.time.back()))
      throw Error(place, "is damaged: the time of row " + std::to_string(recorded.time.size() + 1) + " goes back or is none");
    recorded.time.push_back(ns);
    for (std::size_t i = 0; i < width; ++i) {
      float value = 0;
      std::memcpy(&value, bytes.data() + at + sizeof ns + i * sizeof value, sizeof value);
      recorded.columns[i].push_back(value);
    }
  }
  return recorded;
}

Recorded joined(Recorded base, const Recorded& other) {
  std::vector<std::size_t> chosen;
  for (const RecordedSignal& signal : other.signals) {
    if (base.find(signal.name) != nullptr) continue;
    base.signals.push_back(signal);
    base.signals.back().first = base.columns.size() + chosen.size();
    for (std::size_t i = 0; i < signal.count; ++i) {
      chosen.push_back(signal.first + i);
      base.names.push_back(other.names[signal.first + i]);
    }
  }
  const std::size_t first = base.columns.size(), last = other.time.empty() ? 0 : other.time.size() - 1;
  base.columns.resize(first + chosen.size(), std::vector<double>(base.time.size(), std::numeric_limits<double>::quiet_NaN()));
  for (std::size_t row = 0, at = 0; row < base.time.size() && !other.time.empty(); ++row) {
    const std::int64_t t = base.time[row];
    while (at < last && other.time[at + 1] <= t) ++at;
    const std::size_t next = std::min(at + 1, last);
    const auto length = static_cast<double>(other.time[next] - other.time[at]);
    const double share = length > 0 ? std::clamp(static_cast<double>(t - other.time[at]) / length, 0.0, 1.0) : 0;
    for (std::size_t k = 0; k < chosen.size(); ++k) {
      const std::vector<double>& column = other.columns[chosen[k]];
      base.columns[first + k][row] = share == 0 ? column[at] : column[at] + share * (column[next] - column[at]);
    }
  }
  return base;
}

}  // namespace cotwin::master
