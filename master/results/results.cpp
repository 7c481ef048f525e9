#include "master/results/results.h"

#include <algorithm>
#include <limits>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::report {

namespace fs = std::filesystem;

const json& member(const json& object, const char* key) {
  static const json none;
  if (!object.is_object()) return none;
  const auto found = object.find(key);
  return found == object.end() ? none : *found;
}

double number_of(const json& value) {
  return value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
}

std::string text_of(const json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>() ? "true" : "false";
  if (value.is_number_integer()) return value.dump();
  if (value.is_number()) return text::to_text(value.get<double>(), 9);
  return "";
}

const json::array_t& list_of(const json& value) {
  static const json::array_t none;
  return value.is_array() ? value.get_ref<const json::array_t&>() : none;
}

std::vector<double> numbers_of(const json& value) {
  std::vector<double> all;
  for (const json& element : list_of(value)) all.push_back(number_of(element));
  return all;
}

std::vector<std::string> texts_of(const json& value) {
  std::vector<std::string> all;
  for (const json& element : list_of(value)) all.push_back(text_of(element));
  return all;
}

ColumnFacts column_facts(const json& record) {
  constexpr double kMostElements = 1e6;
  ColumnFacts facts;
  const json& recording = member(record, "recording");
  for (const json& column : list_of(member(recording, "columns"))) {
    const std::string name = text_of(member(column, "name")), unit = text_of(member(column, "unit"));
    const std::vector<std::string> units = texts_of(member(column, "units")), joints = texts_of(member(column, "joints"));
    const double elements = number_of(member(column, "elements"));
    if (!(elements >= 1 && elements <= kMostElements)) continue;
    for (std::size_t i = 0; i < static_cast<std::size_t>(elements); ++i) {
      ColumnFact fact{elements == 1 ? name : name + "[" + std::to_string(i + 1) + "]", i < units.size() ? units[i] : unit,
                      i < joints.size() ? joints[i] : ""};
      const bool named = member(recording, "joint_names") == true;
      const std::string in_file = named ? joint_name(fact.name, fact.joint) : fact.name;
      facts.emplace(in_file, std::move(fact));
    }
  }
  return facts;
}

namespace {

/// The object in a file; null with a note if it is damaged, null if it is missing.
json read_object(const fs::path& file, std::vector<std::string>& notes) {
  std::error_code none;
  if (!fs::exists(file, none)) return nullptr;
  try {
    json object = json::parse(text::read_file(file, "JSON"));
    if (object.is_object()) return object;
    notes.push_back(file.filename().string() + " is not a JSON object and was left out.");
  } catch (const Error& error) {
    notes.push_back(std::string(error.what()) + "; it was left out.");
  } catch (const json::exception&) {
    notes.push_back(file.filename().string() + " is damaged or was cut short and was left out.");
  }
  return nullptr;
}

/// The differences that the summary has figures of.
std::vector<Residual> residuals_of(const json& summary) {
  std::vector<Residual> all;
  for (const char* kind : {"signals", "comparisons"}) {
    for (const json& entry : list_of(member(summary, kind))) {
      Residual r;
      r.a = text_of(member(entry, "a"));
      r.b = text_of(member(entry, "b"));
      if (r.a.empty() || r.b.empty()) continue;
      r.name = text_of(member(entry, "name"));
      r.unit = text_of(member(entry, "unit"));
      r.units = texts_of(member(entry, "units"));
      const json &factor = member(entry, "factor"), &offset = member(entry, "offset");
      if (factor.is_number()) r.factor = number_of(factor);
      if (offset.is_number()) r.offset = number_of(offset);
      r.attitude = member(entry, "attitude") == true;
      const bool known = std::ranges::any_of(all, [&](const Residual& other) { return other.a == r.a && other.b == r.b; });
      if (!known) all.push_back(std::move(r));
    }
  }
  return all;
}

void load_recording_of(Results& results, const fs::path& file, const std::vector<std::string>& patterns,
                       const trajectory::TimeColumn& time = {}) {
  RecordingOptions options;
  options.time = time;
  options.facts = column_facts(results.record);
  options.patterns = patterns;
  options.residuals = residuals_of(results.summary);
  results.recording = load_recording(file, std::move(options));
  const std::string other = misfit(results.record, file.filename().string(), results.recording->names, results.recording->rows,
                                   results.recording->end);
  if (!other.empty()) results.notes.push_back(other);
}

void load_recording_in(Results& results, const std::vector<std::string>& patterns) {
  std::error_code none;
  fs::path file = results.place / "signals.csv";
  if (!fs::exists(file, none)) {
    file += ".part";
    if (!fs::exists(file, none)) {
      if (results.record.is_object() && member(results.record, "recording").is_object())
        results.notes.push_back("The recording " + text_of(member(member(results.record, "recording"), "file")) +
                                " is missing.");
      return;
    }
    results.notes.push_back("The recording is " + file.filename().string() +
                            ": the run has not ended, or its program was killed.");
  }
  try {
    load_recording_of(results, file, patterns);
  } catch (const Error& error) {
    results.notes.push_back(std::string("The recording cannot be read: ") + error.what());
  }
}

}  // namespace

std::string misfit(const json& record, const std::string& recording, const std::vector<std::string>& columns, std::size_t rows,
                   double end) {
  std::string differences;
  const auto differs = [&](const std::string& has, const std::string& expected) {
    differences += (differences.empty() ? "" : "; ") + has + ", expected " + expected;
  };
  std::vector<std::string> told;  // the signal of each column
  for (const json& column : list_of(member(member(record, "recording"), "columns"))) {
    const std::string name = text_of(member(column, "name"));
    const double elements = number_of(member(column, "elements"));
    constexpr double kMostElements = 1e6;
    if (!(elements >= 1 && elements <= kMostElements)) return "";
    if (name == "time") continue;
    told.insert(told.end(), static_cast<std::size_t>(elements), name);
  }
  const auto is_of = [](const std::string& signal, const std::string& column) {
    return column == signal || vector_of(column) == signal;
  };
  const auto first = std::mismatch(told.begin(), told.end(), columns.begin(), columns.end(), is_of);
  if (!told.empty() && told.size() != columns.size()) {
    differs(std::to_string(columns.size()) + (columns.size() == 1 ? " column" : " columns") + " besides the time",
            std::to_string(told.size()));
  } else if (!told.empty() && first.first != told.end()) {
    differs("a column '" + *first.second + "'", "one of '" + *first.first + "'");
  }
  const json& all = member(record, "rows");
  if (all.is_number() && all.get<double>() != static_cast<double>(rows)) differs(std::to_string(rows) + " rows", text_of(all));
  // Rows that a slow disk dropped may be the last ones.
  const double reached = number_of(member(record, "reached")), dropped = number_of(member(record, "dropped_rows"));
  // The last row of a run that was stopped may be one of every so many ticks.
  const double tick = number_of(member(record, "tick")), every = number_of(member(member(record, "recording"), "every"));
  const bool ends_elsewhere = rows > 0 && (end > reached + tick / 2 || (dropped == 0 && end < reached - (every + 0.5) * tick));
  if (ends_elsewhere) differs("its end at " + text::to_text(end, 9) + " s", text::to_text(reached, 9) + " s");
  if (differences.empty()) return "";
  return "run.json does not fit " + recording + ", which has " + differences +
         ": they are not of the same run, or the recording is damaged.";
}

Results load_results(const fs::path& place, const std::vector<std::string>& patterns, const trajectory::TimeColumn& time) {
  Results results;
  results.place = place;
  results.name = place.string();
  while (results.name.size() > 1 && results.name.back() == '/') results.name.pop_back();
  std::error_code none;
  if (!fs::exists(place, none))
    throw Error(place.string(), "does not exist, expected a folder with results, or a recording (CSV, ROS bag)");
  if (!fs::is_directory(place, none) || csv::is_bag(place)) {
    load_recording_of(results, place, patterns, time);
    return results;
  }
  results.record = read_object(place / "run.json", results.notes);
  results.summary = read_object(place / "summary.json", results.notes);
  results.figures = read_object(place / "figures.json", results.notes);
  if (results.is_tuning()) {
    results.resume = read_object(place / "resume.json", results.notes);
    if (fs::exists(place / "torques.csv", none)) results.torques = place / "torques.csv";
  }
  load_recording_in(results, patterns);
  if (!results.is_run() && !results.is_tuning()) {
    std::string found;
    for (const std::string& note : results.notes) found += " " + note;
    throw Error(place.string(),
                "has no results that can be read, expected run.json, summary.json or signals.csv of a run, or "
                "figures.json of a tuning." +
                    found);
  }
  return results;
}

}  // namespace cotwin::report
