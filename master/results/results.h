#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "master/results/recording.h"

/// The results of one run or tuning, as far as they are there and can be read.
namespace cotwin::report {

using nlohmann::json;

struct Results {
  std::string name;             // for headings: the path as given
  std::filesystem::path place;  // folder, or a recording (CSV)
  json record;                  // run.json; null if there is none
  json summary;                 // summary.json; null if there is none
  json figures, resume;         // figures.json and resume.json of a tuning; null if there are none
  std::optional<LoadedRecording> recording;
  std::filesystem::path torques;   // torques.csv of a tuning; empty if there is none
  std::vector<std::string> notes;  // about missing and damaged files

  bool is_tuning() const { return figures.is_object(); }
  /// Whether there is anything of a run.
  bool is_run() const { return recording || record.is_object() || summary.is_object(); }
};

/// Reads a folder with results, or one recording. `patterns`: of the columns to plot. `time`: that of a recording that is no folder.
/// Damaged files become notes. Throws Error if the path does not exist, or nothing in it can be read.
Results load_results(const std::filesystem::path& place, const std::vector<std::string>& patterns,
                     const trajectory::TimeColumn& time = {});

/// The columns that run.json lists.
ColumnFacts column_facts(const json& record);

/// What a recording has that its run.json does not tell, as one sentence: other columns, another number of rows, another end. ""
/// if it fits. `columns`: without that of the time; `end`: time of the last row, s.
std::string misfit(const json& record, const std::string& recording, const std::vector<std::string>& columns, std::size_t rows,
                   double end);

/// The member of an object; null if there is none, or if it is no object.
const json& member(const json& object, const char* key);
/// A number; NaN for everything else.
double number_of(const json& value);
/// Text, number or truth value as text; "" for null, objects and lists.
std::string text_of(const json& value);
/// The elements of a list; none for everything else.
const json::array_t& list_of(const json& value);
/// The numbers of a list; NaN for elements that are none.
std::vector<double> numbers_of(const json& value);
/// The texts of a list; "" for elements that are none.
std::vector<std::string> texts_of(const json& value);

}  // namespace cotwin::report
