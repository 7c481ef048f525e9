#include "master/report/results.h"

#include <algorithm>
#include <limits>

#include "models/support/error.h"
#include "models/support/file.h"
#include "models/support/text.h"

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

std::map<std::string, std::string> units_of(const json& record) {
  std::map<std::string, std::string> units;
  for (const json& column : list_of(member(member(record, "recording"), "columns")))
    units[text_of(member(column, "name"))] = text_of(member(column, "unit"));
  return units;
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
      const json &factor = member(entry, "factor"), &offset = member(entry, "offset");
      if (factor.is_number()) r.factor = number_of(factor);
      if (offset.is_number()) r.offset = number_of(offset);
      const bool known = std::ranges::any_of(all, [&](const Residual& other) { return other.a == r.a && other.b == r.b; });
      if (!known) all.push_back(std::move(r));
    }
  }
  return all;
}

void load_recording_of(Results& results, const fs::path& file, const std::vector<std::string>& patterns) {
  RecordingOptions options;
  options.units = units_of(results.record);
  options.patterns = patterns;
  options.residuals = residuals_of(results.summary);
  results.recording = load_recording(file, std::move(options));
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

Results load_results(const fs::path& place, const std::vector<std::string>& patterns) {
  Results results;
  results.place = place;
  results.name = place.string();
  while (results.name.size() > 1 && results.name.back() == '/') results.name.pop_back();
  std::error_code none;
  if (!fs::exists(place, none))
    throw Error(place.string(), "does not exist, expected a folder with results, or a recording (CSV)");
  if (!fs::is_directory(place, none)) {
    load_recording_of(results, place, patterns);
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
