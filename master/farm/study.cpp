#include "master/farm/study.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "components/services/json/request.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;
using services::Json;
using services::Reader;

constexpr int kMostRuns = 1'000'000'000;
constexpr std::size_t kMostFactors = 1000;  // the direction numbers of boost::random::sobol are for 3667

template <class Value, std::size_t N>
std::vector<std::string> words_of(const std::pair<const char*, Value> (&words)[N]) {
  std::vector<std::string> all;
  for (const auto& [word, value] : words) all.emplace_back(word);
  return all;
}

/// A value of a factor as --set takes it.
std::string value_text(const Json& value, const std::string& place) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>() ? "true" : "false";
  if (value.is_number_integer()) return value.dump();
  if (value.is_number()) return text::to_text(value.get<double>());
  throw services::RequestError(place,
                               std::string("is of type ") + value.type_name() + ", expected a number, a text, true or false");
}

Distribution read_distribution(const Json& json, const std::string& pointer) {
  Reader r(json, pointer);
  Distribution d;
  if (r.has("from")) {
    const double from = r.number("from"), to = r.number("to");
    const int points = r.integer("points", 2, 100'000, 2);
    for (int k = 0; k < points; ++k) {
      const double share = static_cast<double>(k) / (points - 1);
      d.values.push_back(text::to_text(k == points - 1 ? to : from + share * (to - from)));
    }
  } else {
    int given = 0;
    for (const auto& [word, kind] : kDistributionWords) {
      const Json* numbers = r.any(word);
      if (numbers == nullptr) continue;
      ++given;
      d.kind = kind;
      if (kind != Distribution::Kind::kValues) {
        d.numbers = r.numbers(word);
      } else if (!numbers->is_array()) {
        throw services::RequestError(r.pointer(word), "expected an array");
      } else {
        for (std::size_t k = 0; k < numbers->size(); ++k)
          d.values.push_back(value_text((*numbers)[k], r.pointer(word) + "/" + std::to_string(k)));
      }
    }
    if (given != 1)
      throw services::RequestError(
          pointer, "expected one of " + text::joined(words_of(kDistributionWords)) + ", or from, to and points");
    if (d.kind != Distribution::Kind::kValues) {
      d.min = r.number("min", d.min);
      d.max = r.number("max", d.max);
    }
  }
  r.finish();
  d.check(pointer);
  return d;
}

void read_table(const fs::path& file, Design& design) {
  csv::Reader rows(file);
  for (const std::string& name : rows.names()) design.factors.push_back({name, {}});
  while (rows.next()) {
    std::vector<std::string> row;
    for (std::size_t k = 0; k < rows.names().size(); ++k) row.emplace_back(rows.text(k));
    design.rows.push_back(std::move(row));
    if (design.rows.size() > std::size_t{kMostRuns}) throw Error(file.string(), "has too many rows");
  }
  design.runs = static_cast<std::int64_t>(design.rows.size());
  if (design.runs == 0) throw Error(file.string(), "has no rows, expected one for each run");
  // What varies is known of each column, so that all its values can be tried.
  for (std::size_t k = 0; k < design.factors.size(); ++k) {
    std::set<std::string> seen;
    for (const std::vector<std::string>& row : design.rows) seen.insert(row[k]);
    design.factors[k].distribution.values.assign(seen.begin(), seen.end());
  }
}

void read_design(Reader& r, Study& study) {
  Design& design = study.design;
  design.kind = text::choose("/design", r.word("design", words_of(kDesignWords)), kDesignWords);
  if (const std::string table = r.text("table", ""); !table.empty()) {
    if (r.gives("vary") || (r.gives("design") && design.kind != DesignKind::kTable))
      throw services::RequestError("/table", "is given beside vary or a design, expected one of them");
    design.kind = DesignKind::kTable;
    study.table = table;
    read_table(study.table, design);
  } else if (design.kind == DesignKind::kTable) {
    throw services::RequestError("/table", "is missing, expected a CSV file");
  }
  if (const Json* vary = r.any("vary")) {
    Reader check(*vary, "/vary");
    for (const auto& [name, json] : vary->items()) {
      const std::string pointer = check.pointer(name.c_str());
      design.factors.push_back({name, read_distribution(json, pointer)});
      if (design.kind == DesignKind::kGrid && design.factors.back().distribution.kind != Distribution::Kind::kValues)
        throw services::RequestError(pointer, "expected values, or from, to and points, in a grid");
    }
  }
  if (design.factors.empty()) throw services::RequestError("/vary", "is missing, expected what varies");
  if (design.factors.size() > kMostFactors)
    throw services::RequestError("/vary", "expected at most " + std::to_string(kMostFactors) + " factors");
  const bool counted = design.kind != DesignKind::kTable && design.kind != DesignKind::kGrid;
  r.only_if(counted, "runs", "design latin_hypercube, sobol or random");
  r.only_if(design.kind == DesignKind::kLatinHypercube || design.kind == DesignKind::kRandom, "seed",
            "design latin_hypercube or random");
  if (counted) {
    design.runs = r.integer("runs", 1, kMostRuns, 0);
    if (design.runs == 0) throw services::RequestError("/runs", "is missing, expected the number of runs");
  } else if (design.kind == DesignKind::kGrid) {
    design.runs = 1;
    for (const Factor& factor : design.factors) {
      design.runs *= static_cast<std::int64_t>(factor.distribution.values.size());
      if (design.runs > kMostRuns)
        throw services::RequestError("/vary", "gives a grid of more than " + std::to_string(kMostRuns) + " runs");
    }
  }
  design.seed = static_cast<std::uint64_t>(r.integer("seed", 0, std::numeric_limits<int>::max(), 1));
}

}  // namespace

Study read_study(const Json& json, const std::string& place, const fs::path& folder) {
  try {
    Json object = json;
    for (const char* file : {"scenario", "table"}) {
      if (object.is_object() && object.contains(file) && object[file].is_string())
        object[file] = (fs::absolute(folder) / object[file].get<std::string>()).lexically_normal().string();
    }
    Reader r(object);
    Study study;
    study.name = r.text("name", fs::path(place).stem().string());
    study.scenario = r.text("scenario");
    study.set = r.texts("set", {}, nullptr);
    study.keep = r.texts("keep", {"figures"}, nullptr);
    study.success = r.texts("success", {}, nullptr);
    if (r.gives("stop_s")) study.stop = r.number("stop_s");
    study.limit = r.positive("limit_s", study.limit);
    read_design(r, study);
    r.finish();
    for (const std::string& assignment : study.set) {
      const std::string name = assignment.substr(0, assignment.find('='));
      if (std::ranges::find(study.design.factors, name, &Factor::name) != study.design.factors.end())
        throw services::RequestError("/set", name + " varies, expected it in vary or in set");
    }
    object["name"] = study.name;
    study.text = object.dump();
    return study;
  } catch (const services::RequestError& error) {
    throw Error(place, error.pointer().empty() ? error.detail() : error.pointer() + ": " + error.detail());
  } catch (const Error& error) {
    throw Error(place, error.what());
  }
}

std::vector<std::string> Study::assignments(const std::vector<std::string>& point) const {
  std::vector<std::string> all = set;
  for (std::size_t k = 0; k < point.size(); ++k) {
    const std::string braces = "{" + design.factors[k].name + "}";
    bool used = false;
    for (std::string& assignment : all) {
      for (std::size_t at = assignment.find(braces); at != std::string::npos;
           at = assignment.find(braces, at + point[k].size())) {
        assignment.replace(at, braces.size(), point[k]);
        used = true;
      }
    }
    if (!used) all.push_back(design.factors[k].name + "=" + point[k]);
  }
  return all;
}

Json distribution_of(std::string_view given) {
  const std::vector<std::string_view> parts = text::split(given, ':');
  const std::vector<std::string> words = words_of(kDistributionWords);
  const bool named = std::ranges::find(words, parts.front()) != words.end() && parts.front() != "values";
  const auto number = [](std::string_view part) { return text::parse_real(part); };
  std::vector<double> numbers;
  for (const std::string_view part : std::span(parts).subspan(named ? 1 : 0)) {
    if (const auto x = number(part)) numbers.push_back(*x);
  }
  if (parts.size() > 1 && numbers.size() == parts.size() - (named ? 1 : 0))
    return Json{{named ? std::string(parts.front()) : "uniform", numbers}};
  Json values = Json::array();
  for (const std::string_view value : text::split(given, ',')) values.push_back(std::string(text::trim(value)));
  return Json{{"values", values}};
}

}  // namespace cotwin::master
