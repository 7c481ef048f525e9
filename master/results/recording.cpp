#include "master/results/recording.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <numeric>
#include <unordered_map>
#include <utility>

#include "master/engine/wiring/members.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose_values.h"

namespace cotwin::report {

namespace fs = std::filesystem;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kMostColumns = 4000, kMostSpans = 10000;

bool ends_with_a_line_end(const fs::path& file) {
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in || in.tellg() <= 0) return true;
  in.seekg(-1, std::ios::end);
  return in.get() == '\n';
}

std::string counted(std::size_t count, const char* one, const char* many) {
  return std::to_string(count) + " " + (count == 1 ? one : many);
}

}  // namespace

std::string shown_name(const ColumnFacts& facts, const std::string& column) {
  const auto found = facts.find(column);
  return found == facts.end() || found->second.joint.empty() ? column : vector_of(column) + " " + found->second.joint;
}

std::string joint_name(const std::string& column, const std::string& joint) {
  const std::string vector = vector_of(column);
  return joint.empty() || vector == column ? column : vector + "[" + joint + "]";
}

RowReader::RowReader(const fs::path& file, const trajectory::TimeColumn& time, std::map<std::string, double, std::less<>> words,
                     const ColumnFacts& facts)
    : csv_(csv::open(file, {.topic = time.topic})),
      path_(file.string()),
      file_(file.filename().string()),
      words_(std::move(words)),
      unit_(time.unit),
      unended_(!csv::is_bag(file) && !ends_with_a_line_end(file)),
      cut_(unended_) {
  time_ = trajectory::find_time_column(*csv_, file.string(), time.name, kTimeRemedy);
  read_.resize(csv_->names().size());
  std::iota(read_.begin(), read_.end(), std::size_t{0});
  for (std::size_t i = 0; i < csv_->names().size(); ++i) {
    if (i == time_) continue;
    const std::string& name = csv_->names()[i];
    const auto known = facts.find(name);
    names_.push_back(name.empty() ? "column " + std::to_string(i + 1) : known != facts.end() ? known->second.name : name);
  }
  row_.resize(csv_->names().size());
  next_row_.resize(row_.size());
}

void RowReader::only(const std::vector<std::size_t>& columns) {
  read_ = {time_};
  for (const std::size_t column : columns) read_.push_back(column < time_ ? column : column + 1);
  row_.assign(row_.size(), kNaN);
  next_row_ = row_;
}

bool RowReader::read(std::vector<double>& row) {
  for (;;) {
    try {
      if (at_end_ || !csv_->next()) {
        at_end_ = true;
        return false;
      }
    } catch (const Error& error) {
      at_end_ = true;
      unended_ = false;  // the row before is a whole one
      why_ended_ = error.what();
      ended_within_ = more_lines();
      return false;
    }
    for (const std::size_t i : read_) {
      const std::optional<double> value = text::parse_real(csv_->text(i));
      row[i] = value.value_or(kNaN);
      if (!value) [[unlikely]] {
        const auto word = words_.find(csv_->text(i));
        if (word != words_.end()) {
          row[i] = word->second;
        } else if (texts_++ == 0) {
          first_text_ = csv_->place(i);
        }
      }
    }
    if (std::isfinite(row[time_])) return true;
    if (without_time_++ == 0) first_without_time_ = reason_without_time();
  }
}

bool RowReader::next() {
  if (!unended_) return read(row_);
  // The last row of a file without a final line end is left out, because its last number may have lost digits.
  if (!pending_) pending_ = read(next_row_);
  if (!pending_) return false;
  std::swap(row_, next_row_);
  pending_ = read(next_row_);
  if (pending_ || !unended_) return true;
  last_left_out_ = true;
  return false;
}

/// Whether anything follows the line that cannot be read.
bool RowReader::more_lines() {
  try {
    return csv_->next();
  } catch (const Error&) {
    return true;
  }
}

std::string RowReader::reason_without_time() const {
  try {
    static_cast<void>(csv_->real(time_));
    return csv_->place(time_) + ": not finite, expected a time";
  } catch (const Error& error) {
    return error.what();
  }
}

void RowReader::check_that_rows_were_read() const {
  if (without_time_ > 0) throw Error(path_, "no row can be read: " + first_without_time_);
  if (ended_within_ || (!why_ended_.empty() && !cut_)) throw Error(path_, "no row can be read: " + why_ended_);
}

std::vector<std::string> RowReader::notes() const {
  std::vector<std::string> all;
  if (!why_ended_.empty()) all.push_back("The recording was read up to a row that cannot be read: " + why_ended_);
  if (last_left_out_)
    all.push_back("The last line of " + file_ + " has no line end; it may have been cut short and was left out.");
  if (without_time_ > 0) all.push_back(counted(without_time_, "row has", "rows have") + " no finite time and were left out.");
  if (texts_ > 0)
    all.push_back(counted(texts_, "cell is not a number and counts", "cells are not numbers and count") +
                  " as missing; the first one: " + first_text_);
  for (std::string& note : csv_->notes()) all.push_back(std::move(note) + ".");
  return all;
}

std::string vector_of(std::string_view name) {
  if (name.empty() || name.back() != ']') return std::string(name);
  const std::size_t open = name.rfind('[');
  if (open == std::string_view::npos || open == 0) return std::string(name);
  const std::string_view index = name.substr(open + 1, name.size() - open - 2);
  if (index.empty() || index.find_first_not_of("0123456789, ") != std::string_view::npos) return std::string(name);
  return std::string(name.substr(0, open));
}

namespace {

/// The name without digits at its end, if it has both letters and digits: "q" of "q12".
std::string without_number(const std::string& name) {
  const std::size_t end = name.find_last_not_of("0123456789");
  return end == std::string::npos || end + 1 == name.size() ? "" : name.substr(0, end + 1);
}

/// "drive.energy_" of "drive.energy_kinetic"; "" without an underscore after the component.
std::string beginning_of(const std::string& name) {
  const std::size_t dot = name.rfind('.');
  if (dot == std::string::npos) return "";
  const std::size_t underscore = name.find('_', dot + 1);
  return underscore == std::string::npos || underscore == dot + 1 ? "" : name.substr(0, underscore + 1);
}

}  // namespace

std::vector<ColumnGroup> grouped(std::span<const RecordedColumn> columns) {
  // The key of a column's group; scalars that would be alone get their own name.
  std::vector<std::string> keys(columns.size()), names(columns.size());
  std::unordered_map<std::string, std::size_t> sizes;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const std::string& name = columns[i].name;
    names[i] = vector_of(name);
    if (names[i] == name) {
      const std::string numbered = without_number(name), begun = beginning_of(name);
      if (!numbered.empty()) {
        names[i] = numbered + "…";
      } else if (!begun.empty() && !columns[i].unit.empty() && columns[i].unit != "1") {
        names[i] = begun + "…";
      }
    }
    keys[i] = names[i] + '\n' + columns[i].unit;
    ++sizes[keys[i]];
  }
  std::vector<ColumnGroup> groups;
  std::unordered_map<std::string, std::size_t> known;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const bool alone = sizes[keys[i]] == 1;
    const std::string key = alone ? columns[i].name + "\n\n" : keys[i];
    const auto [found, is_new] = known.emplace(key, groups.size());
    if (is_new) groups.push_back({alone ? columns[i].name : names[i], columns[i].unit, {}});
    groups[found->second].columns.push_back(i);
  }
  return groups;
}

const RecordedColumn* LoadedRecording::find(std::string_view name) const {
  const auto found = std::ranges::find(columns, name, &RecordedColumn::name);
  return found == columns.end() ? nullptr : &*found;
}

namespace {

/// The columns of a signal: one element, a scalar, or all elements of a vector.
std::vector<std::size_t> columns_of(const std::vector<std::string>& names, const std::string& signal) {
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (names[i] == signal ||
        (names[i].size() > signal.size() && names[i].starts_with(signal) && vector_of(names[i]) == signal))
      found.push_back(i);
  }
  return found;
}

/// Residuals whose signals are in the file.
class ResidualReader {
 public:
  ResidualReader(std::vector<Residual> residuals, const std::vector<std::string>& names) : residuals_(std::move(residuals)) {
    for (Residual& r : residuals_) {
      std::vector<std::size_t> a = columns_of(names, r.a), b = columns_of(names, r.b);
      if (a.empty() || a.size() != b.size() || a.size() > kMostPlotted) a.clear(), b.clear();
      for (const std::size_t column : a) r.elements.push_back(names[column]);
      if (r.attitude && a.size() == 4) {
        r.elements = {"turn[1]", "turn[2]", "turn[3]"};
        r.curves.resize(3);
      } else if (!r.attitude) {
        r.curves.resize(a.size());
      }
      columns_.emplace_back(std::move(a), std::move(b));
    }
  }
  void add(const RowReader& row) {
    for (std::size_t k = 0; k < residuals_.size(); ++k) {
      Residual& r = residuals_[k];
      const auto& [of_a, of_b] = columns_[k];
      if (r.attitude && !r.curves.empty()) {
        std::array<double, 4> a, b;
        for (std::size_t i = 0; i < 4; ++i) a[i] = row.value(of_a[i]), b[i] = row.value(of_b[i]);
        const Eigen::Vector3d turn = turn_between(b, a);
        for (std::size_t i = 0; i < 3; ++i) r.curves[i].add(row.t(), turn[static_cast<Eigen::Index>(i)]);
        continue;
      }
      for (std::size_t i = 0; i < r.curves.size(); ++i) {
        const double a = row.value(of_a[i]), b = row.value(of_b[i]);
        r.curves[i].add(row.t(), a - (r.factor * b + r.offset));
      }
    }
  }
  std::vector<Residual> take() { return std::move(residuals_); }

 private:
  std::vector<Residual> residuals_;
  std::vector<std::pair<std::vector<std::size_t>, std::vector<std::size_t>>> columns_;
};

/// When components are in contact: contacts > 0; where that is not recorded, force > 0 or f_c other than 0.
class ContactReader {
 public:
  explicit ContactReader(const std::vector<std::string>& names) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      const std::string vector = vector_of(names[i]);
      const std::size_t dot = vector.rfind('.');
      if (dot == std::string::npos) continue;
      const std::string what = vector.substr(dot + 1);
      if (what != "contacts" && what != "force" && what != "penetration" && what != "f_c") continue;
      Watched& w = of(vector.substr(0, dot));
      if (what == "contacts") w.contacts = i;
      if (what == "force") w.force = i;
      if (what == "penetration") w.penetration = i;
      if (what == "f_c") w.f_c.push_back(i);
    }
    std::erase_if(watched_, [](const Watched& w) { return w.contacts == kNone && w.force == kNone && w.f_c.empty(); });
  }
  void add(const RowReader& row) {
    for (Watched& w : watched_) {
      const double force = force_of(w, row);
      const bool touching = w.contacts != kNone ? row.value(w.contacts) > 0 : force > 0;
      if (touching && !w.open) {
        w.open = spans_.size() < kMostSpans;
        if (!w.open) continue;
        w.span = {w.component, row.t(), row.t(), kNaN, kNaN, true};
      }
      if (!w.open) continue;
      if (!touching) {
        close(w, false);
        continue;
      }
      w.span.end = row.t();
      w.span.force = std::fmax(w.span.force, force);
      if (w.penetration != kNone) w.span.penetration = std::fmax(w.span.penetration, row.value(w.penetration));
    }
  }
  void finish(LoadedRecording& recording) {
    for (Watched& w : watched_) {
      if (w.open) close(w, true);
      recording.contact_units.push_back(w.component);
    }
    std::ranges::stable_sort(spans_, {}, &ContactSpan::begin);
    recording.contacts = std::move(spans_);
    if (recording.contacts.size() >= kMostSpans)
      recording.notes.push_back("Only the first " + std::to_string(kMostSpans) + " contacts are counted.");
  }

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  struct Watched {
    std::string component;
    std::size_t contacts = kNone, force = kNone, penetration = kNone;
    std::vector<std::size_t> f_c;
    bool open = false;
    ContactSpan span;
  };

  Watched& of(const std::string& component) {
    const auto found = std::ranges::find(watched_, component, &Watched::component);
    if (found != watched_.end()) return *found;
    watched_.emplace_back();
    watched_.back().component = component;
    return watched_.back();
  }
  static double force_of(const Watched& w, const RowReader& row) {
    if (w.force != kNone) return row.value(w.force);
    if (w.f_c.empty()) return kNaN;
    double squares = 0;
    for (const std::size_t column : w.f_c) squares += row.value(column) * row.value(column);
    return std::sqrt(squares);
  }
  void close(Watched& w, bool open) {
    w.span.open = open;
    spans_.push_back(w.span);
    w.open = false;
  }

  std::vector<Watched> watched_;
  std::vector<ContactSpan> spans_;
};

/// The signals of any component with this name of a variable: "; did you mean 'motion.q' or 'drive.q'?"; at most three, "" if there are none.
std::string in_components(const std::string& variable, const std::vector<std::string>& columns) {
  constexpr std::size_t kMost = 3;
  std::vector<std::string> found;
  for (const std::string& column : columns) {
    const std::string name = vector_of(column);
    if (name.substr(name.rfind('.') + 1) != variable || std::ranges::find(found, name) != found.end()) continue;
    if (found.size() == kMost) break;
    found.push_back(name);
  }
  std::string text;
  for (const std::string& name : found) text += (text.empty() ? "; did you mean " : " or ") + master::in_quotes(name);
  return text.empty() ? "" : text + "?";
}

bool matches(const std::vector<std::string>& patterns, const std::string& name, const std::string& joint) {
  return patterns.empty() ||
         std::ranges::any_of(patterns, [&](const std::string& pattern) { return selects(pattern, name, joint); });
}

}  // namespace

bool selects(const std::string& pattern, const std::string& column, const std::string& joint) {
  return master::glob(pattern, column) || master::glob(pattern, vector_of(column)) ||
         (!joint.empty() && master::glob(pattern, joint_name(column, joint)));
}

Error no_signal(const std::string& file, const std::string& pattern, const std::vector<std::string>& columns) {
  const std::string of_components = in_components(pattern, columns);
  return Error(file, "no signal " + master::in_quotes(pattern) +
                         (of_components.empty() ? master::suggestion(pattern, columns) : of_components) + "; there are " +
                         std::to_string(columns.size()) +
                         (columns.empty() ? "" : ", the first is " + master::in_quotes(columns.front())));
}

LoadedRecording load_recording(const fs::path& file, RecordingOptions options) {
  LoadedRecording recording;
  recording.file = file;
  recording.time = options.time;
  recording.facts = std::move(options.facts);
  RowReader reader(file, options.time, {}, recording.facts);
  std::map<std::string_view, const ColumnFact*> facts;
  for (const auto& [in_file, fact] : recording.facts) facts.emplace(fact.name, &fact);
  recording.names = reader.names();
  const std::size_t columns = std::min(reader.names().size(), kMostColumns);
  std::size_t plotted = 0, chosen = 0;
  for (std::size_t i = 0; i < columns; ++i) {
    const std::string& name = reader.names()[i];
    const auto fact = facts.find(name);
    const std::string joint = fact != facts.end() ? fact->second->joint : "";
    const bool wanted = matches(options.patterns, name, joint);
    chosen += wanted ? 1 : 0;
    const bool with_points = wanted && plotted < kMostPlotted;
    plotted += with_points ? 1 : 0;
    recording.columns.push_back({name, fact != facts.end() ? fact->second->unit : "", Curve(with_points), with_points, joint});
  }
  if (columns < reader.names().size())
    recording.notes.push_back("Only the first " + std::to_string(columns) + " of " + std::to_string(reader.names().size()) +
                              " columns were read.");
  if (plotted < chosen)
    recording.notes.push_back("Only the first " + std::to_string(plotted) + " of " + std::to_string(chosen) +
                              " columns are plotted; --signals chooses others.");
  ResidualReader residuals(std::move(options.residuals), reader.names());
  ContactReader contacts(reader.names());
  std::size_t backwards = 0;
  for (double before = -std::numeric_limits<double>::infinity(); reader.next(); before = reader.t()) {
    if (recording.rows++ == 0) recording.begin = recording.end = reader.t();
    if (reader.t() < before) ++backwards;
    recording.begin = std::min(recording.begin, reader.t());
    recording.end = std::max(recording.end, reader.t());
    for (std::size_t i = 0; i < columns; ++i) recording.columns[i].curve.add(reader.t(), reader.value(i));
    residuals.add(reader);
    contacts.add(reader);
  }
  if (recording.rows == 0) reader.check_that_rows_were_read();
  recording.residuals = residuals.take();
  contacts.finish(recording);
  for (std::string& note : reader.notes()) recording.notes.push_back(std::move(note));
  if (backwards > 0)
    recording.notes.push_back("The time goes back in " + counted(backwards, "row", "rows") +
                              "; curves are drawn in the order of the rows.");
  std::size_t missing = 0;
  std::string first;
  for (const RecordedColumn& column : recording.columns) {
    if (column.curve.figures().missing > 0 && missing == 0) first = column.name;
    missing += column.curve.figures().missing;
  }
  if (missing > 0)
    recording.notes.push_back(counted(missing, "value is", "values are") + " not finite, first in column '" + first +
                              "'; curves are interrupted there and figures leave them out.");
  if (recording.rows == 0) recording.notes.push_back("The recording has no rows.");
  recording.groups = grouped(recording.columns);
  return recording;
}

}  // namespace cotwin::report
