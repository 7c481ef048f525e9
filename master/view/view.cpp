#include "master/view/view.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "components/unit/settings.h"
#include "master/engine/wiring/members.h"
#include "master/results/results.h"
#include "master/run/identity.h"
#include "master/scenery/recorded.h"
#include "master/scenery/scenery.h"
#include "master/view/calculated.h"
#include "master/view/packer.h"
#include "master/view/stage_json.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/installation.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kMark = "<!--data-->";
constexpr double kMatricesPerSecond = 50;
constexpr std::size_t kMostMatrices = 6000;

/// The results that are shown.
struct Results {
  fs::path recording;  // empty: nothing was recorded by choice
  fs::path view;       // view.bin; empty: there is none
  Json record;         // run.json; null without one
  std::vector<std::string> remarks;
};

Results find_results(const fs::path& given) {
  Results results;
  std::error_code none;
  if (!fs::exists(given, none))
    throw Error(given.string(), "does not exist, expected the folder of a run, or a recording (CSV)");
  if (!fs::is_directory(given, none)) {
    results.recording = given;
    return results;
  }
  const fs::path record = given / "run.json";
  const auto find = [&](const char* name) -> fs::path {
    if (fs::is_regular_file(given / name, none)) return given / name;
    const fs::path part = given / (std::string(name) + ".part");
    if (!fs::is_regular_file(part, none)) return {};
    results.remarks.push_back("the run has not ended, or its process was killed: " + part.filename().string() + " is shown");
    return part;
  };
  results.recording = find("signals.csv");
  results.view = find("view.bin");
  if (results.recording.empty() && results.view.empty()) {
    throw Error(given.string(), "has no signals.csv, expected the folder of a run that recorded something");
  }
  if (fs::is_regular_file(record, none)) {
    try {
      results.record = Json::parse(text::read_file(record, "the record of a run"));
      if (!results.record.is_object()) throw Error(record.string(), "is no object");
    } catch (const std::exception& error) {
      results.record = nullptr;
      results.remarks.push_back("run.json cannot be read: " + std::string(error.what()));
    }
  }
  return results;
}

/// A text of run.json; "" where there is none.
std::string text_of(const Json& record, std::initializer_list<const char*> path) {
  const Json* at = &record;
  for (const char* key : path) {
    if (!at->is_object() || !at->contains(key)) return "";
    at = &(*at)[key];
  }
  return at->is_string() ? at->get<std::string>() : at->is_number() ? at->dump() : "";
}

/// The texts of a list in run.json; none if it has no such list.
std::vector<std::string> texts_of(const Json& record, const char* name) {
  std::vector<std::string> texts;
  if (!record.contains(name) || !record[name].is_array()) return texts;
  for (const Json& text : record[name]) {
    if (text.is_string()) texts.push_back(text.get<std::string>());
  }
  return texts;
}

/// The scenario of the run with its --set, --attach and --detach, or nothing with a remark. A scenario that is not as it was in the run gets a remark.
std::optional<Scenario> find_scenario(const ViewOptions& options, const Results& results, std::span<const UnitType> types,
                                      std::vector<std::string>& remarks) {
  fs::path file = options.scenario;
  const std::string recorded = text_of(results.record, {"scenario", "file"});
  std::error_code none;
  if (file.empty() && !recorded.empty()) {
    const fs::path folder = text_of(results.record, {"scenario", "folder"});
    for (const fs::path& candidate : {folder / recorded, fs::path(recorded)}) {
      if (file.empty() && fs::is_regular_file(candidate, none)) file = candidate;
    }
    if (file.empty())
      remarks.push_back("the scenario " + recorded +
                        " was not found, so no robot is shown; give it by --scenario FILE, or the robot by --robot");
  }
  if (file.empty()) return std::nullopt;
  try {
    Scenario scenario = load_scenario(file);
    const std::string hash = text_of(results.record, {"scenario", "files_hash"});
    if (!hash.empty() && hash != hexadecimal(hash_of(scenario)))
      remarks.push_back(
          "the scenario " + file.string() +
          ", or a file that it names (URDF, scene, CSV), is not as it was in the run; robots and bodies are shown as they "
          "are now");
    for (const std::string& assignment : texts_of(results.record, "set")) assign(scenario, assignment, types);
    for (const char* kind : {"detach", "attach"}) {
      for (const std::string& tool : texts_of(results.record, kind)) {
        try {
          add_tool_event(scenario, *kind == 'a', tool);
        } catch (const Error& error) {
          remarks.push_back("a tool is not shown: " + std::string(error.what()));
        }
      }
    }
    if (results.record.contains("stop") && results.record["stop"].is_number())
      scenario.stop = Time::from_seconds(results.record["stop"].get<double>());
    return scenario;
  } catch (const Error& error) {
    if (!options.scenario.empty()) throw;
    remarks.push_back("the scenario cannot be read, so no robot is shown: " + std::string(error.what()));
    return std::nullopt;
  }
}

StagedModel named_robot(const std::string& name, const std::vector<fs::path>& folders, std::vector<std::string>& remarks) {
  Settings settings("view", "", {}, folders);
  const fs::path urdf = settings.robot_file(name, " (another robot: --robot PATH.urdf)");
  robot::UrdfOptions options;
  options.unphysical = robot::Unphysical::kWarn;
  options.ignore_words = true;
  return {std::make_shared<const robot::RobotModel>(robot::load_urdf(urdf, options, &remarks)), urdf};
}

/// What people should know of the run, as pairs of texts.
Json facts_of(const Results& results, const Recorded& recorded) {
  Json facts = Json::array();
  const auto add = [&](const char* name, const std::string& value) {
    if (!value.empty()) facts.push_back({name, value});
  };
  const Json& record = results.record;
  add("recording", (results.recording.empty() ? results.view : results.recording).string());
  add("scenario", text_of(record, {"scenario", "file"}));
  add("begun", text_of(record, {"begun"}));
  add("cotwin", text_of(record, {"program", "version"}));
  add("tick", text_of(record, {"tick"}).empty() ? "" : text_of(record, {"tick"}) + " s");
  add("rows", std::to_string(recorded.time.size()));
  std::string set;
  if (record.contains("set") && record["set"].is_array()) {
    for (const Json& one : record["set"]) text::append(set, one.is_string() ? one.get<std::string>() : one.dump());
  }
  add("--set", set);
  add("accuracy", "a plotted number is within 1/16777216 of its signal's range, or of itself, of the recorded one");
  return facts;
}

std::string state_of(const Json& record) {
  const std::string state = text_of(record, {"state"}), reason = text_of(record, {"reason"});
  if (state.empty() || state == "complete") return state;
  return state + (reason.empty() ? "" : ": " + reason);
}

Json table_of(const std::vector<std::int64_t>& time, const std::vector<std::vector<double>>& columns,
              const std::vector<RecordedSignal>& signals, Packer& packer,
              const std::function<void(double share)>& progress = {}) {
  Json table = {
      {"rows", time.size()}, {"time", packer.add_integers(time)}, {"columns", Json::array()}, {"signals", Json::array()}};
  for (const std::vector<double>& column : columns) {
    if (progress) progress(static_cast<double>(table["columns"].size()) / static_cast<double>(columns.size()));
    table["columns"].push_back(packer.add_reals(column));
  }
  for (const RecordedSignal& signal : signals) {
    table["signals"].push_back(
        {{"name", signal.name}, {"unit", signal.unit}, {"first", signal.first}, {"count", signal.count}});
    if (!signal.elements.si.empty()) table["signals"].back()["units"] = signal.elements.si;
    if (!signal.elements.names.empty()) table["signals"].back()["joints"] = signal.elements.names;
  }
  return table;
}

/// The largest number in each unit of measure. Larger ones than the bound, such as 1e12 for "none", do not count.
Json scales_of(const Recorded& recorded) {
  constexpr double kMost = 1e6;
  std::map<std::string, double> scales;
  for (const RecordedSignal& signal : recorded.signals) {
    for (std::size_t i = 0; i < signal.count; ++i) {
      double& largest = scales[signal.elements.si.empty() ? signal.unit : signal.elements.si[i]];
      for (const double x : recorded.column(signal, i))
        if (std::abs(x) <= kMost) largest = std::max(largest, std::abs(x));
    }
  }
  return scales;
}

/// Plots at the beginning: those of the options, otherwise the first ones that were recorded by choice. `all`: that and what pages show.
Json plots_of(const ViewOptions& options, const std::optional<Scenario>& scenario, const Recorded& recorded,
              const Recorded& all) {
  constexpr std::size_t kMost = 3;
  std::vector<std::string> names;
  const auto add = [&](const std::string& name, std::size_t most) {
    const bool known = all.find(name) != nullptr && std::ranges::find(names, name) == names.end();
    if (known && names.size() < most) names.push_back(name);
  };
  for (const std::string& pattern : options.plots) {
    bool any = false;
    for (const RecordedSignal& signal : all.signals) {
      const auto first = all.names.begin() + static_cast<std::ptrdiff_t>(signal.first);
      const auto is_of = [&](const std::string& column) { return report::selects(pattern, column); };
      const bool by_joint = std::ranges::any_of(signal.elements.names, [&](const std::string& joint) {
        return glob(pattern, report::joint_name(signal.name + "[1]", joint));
      });
      if (!by_joint && !glob(pattern, signal.name) &&
          std::none_of(first, first + static_cast<std::ptrdiff_t>(signal.count), is_of))
        continue;
      any = true;
      add(signal.name, all.signals.size());
    }
    if (!any) throw report::no_signal("--plot", pattern, all.names);
  }
  if (!names.empty()) return names;
  for (const std::string& name : first_plots(scenario ? &*scenario : nullptr, recorded)) add(name, kMost);
  return names;
}

/// Text for a script element: no "<" can end it or begin a comment.
std::string for_script(const Json& json) {
  const std::string text = json.dump(-1, ' ', false, Json::error_handler_t::replace);
  std::string safe;
  safe.reserve(text.size());
  for (const char c : text) {
    if (c == '<') {
      safe += "\\u003c";
    } else {
      safe += c;
    }
  }
  return safe;
}

}  // namespace

std::vector<std::string> first_plots(const Scenario* scenario, const Recorded& recorded) {
  std::vector<std::string> names;
  if (scenario != nullptr) {
    for (const ComparisonSpec& comparison : scenario->comparisons) names.push_back(comparison.a);
    for (const ReportSpec& report : scenario->reports) names.push_back(report.a);
  }
  constexpr std::size_t kMostLines = 24;  // beams of a scanner are hundreds, which is no plot to begin with
  for (const RecordedSignal& signal : recorded.signals) {
    if (signal.count > 1 && signal.count <= kMostLines) names.push_back(signal.name);
  }
  for (const RecordedSignal& signal : recorded.signals) {
    if (signal.count <= kMostLines) names.push_back(signal.name);
  }
  return names;
}

fs::path empty_page() {
  const fs::path page = installation() / "share/cotwin/view/view.html";
  std::error_code none;
  if (fs::is_regular_file(page, none)) return page;
  throw Error(
      page.string(),
      "does not exist: this build of Cotwin has no page. It needs nodejs and npm (group view of scripts/packages.txt) and "
      "the npm registry while it is built; install them, then configure and build again");
}

ViewSummary write_view(const ViewOptions& options, std::span<const UnitType> types) {
  const std::string empty = text::read_file(empty_page(), "the page without a recording");
  const std::size_t mark = empty.find(kMark);
  if (mark == std::string::npos) throw Error(empty_page().string(), std::string("has no ") + kMark);
  const Results results = find_results(options.results);
  const auto progress = [&](const char* what) {
    return [&options, what](double share) {
      if (options.progress) options.progress(what, share);
    };
  };
  const nlohmann::json record(results.record);
  ViewSummary summary;
  std::vector<std::string>& remarks = summary.remarks;
  remarks = results.remarks;
  Recorded recorded;
  std::optional<Recorded> view;
  if (!results.recording.empty()) {
    recorded = load_recorded(results.recording, progress("reading the recording"), options.time, report::column_facts(record));
    remarks.insert(remarks.end(), recorded.remarks.begin(), recorded.remarks.end());
    const std::string other =
        report::misfit(record, results.recording.filename().string(), recorded.names, recorded.time.size(),
                       recorded.time.empty() ? 0 : static_cast<double>(recorded.time.back()) * 1e-9);
    if (!other.empty()) remarks.push_back(other);
  }
  try {
    if (!results.view.empty()) view = load_view_data(results.view);
  } catch (const Error& error) {
    if (results.recording.empty()) throw;
    remarks.push_back("only what was recorded by choice is shown: " + std::string(error.what()));
  }
  if (results.recording.empty()) {
    recorded = std::move(*view);
    view.reset();
  }
  std::optional<Recorded> both;
  if (view) both = joined(*view, recorded);
  const Recorded& staged = both ? *both : recorded;

  const std::optional<Scenario> scenario = find_scenario(options, results, types, remarks);
  const std::vector<fs::path> folders = options.model_folders(scenario ? scenario->folder : fs::path());
  Scenery stage;
  if (!options.robot.empty()) {
    stage = scenery_of(named_robot(options.robot, folders, remarks), staged);
  } else if (scenario) {
    stage = scenery_of(*scenario, staged, types, folders);
  }
  remarks.insert(remarks.end(), stage.remarks.begin(), stage.remarks.end());

  Packer packer;
  const std::string name = scenario ? scenario->name : text_of(results.record, {"scenario", "name"});
  Json page = {{"format", 1},
               {"name", name.empty() ? results.recording.filename().string() : name},
               {"state", state_of(results.record)},
               {"facts", facts_of(results, recorded)}};
  page["remarks"] = Json::array();
  page["tables"] = Json::array();
  page["tables"].push_back(table_of(recorded.time, recorded.columns, recorded.signals, packer, progress("packing")));
  if (view) page["view"] = table_of(view->time, view->columns, view->signals, packer);
  const std::vector<std::size_t> rows = chosen_rows(staged, kMatricesPerSecond, kMostMatrices);
  CalculatedTable calculated;
  for (const std::size_t row : rows) calculated.time.push_back(staged.time[row]);
  page.update(stage_json({stage, staged, scenario ? &*scenario : nullptr, types, folders}, rows, calculated, packer, remarks));
  if (!calculated.signals.empty())
    page["tables"].push_back(table_of(calculated.time, calculated.columns, calculated.signals, packer));
  // Two robots of one file have the same notes.
  std::vector<std::string> once;
  for (std::string& remark : remarks)
    if (std::ranges::find(once, remark) == once.end()) once.push_back(std::move(remark));
  remarks = std::move(once);
  page["remarks"] = remarks;
  page["scales"] = scales_of(staged);
  page["plots"] = plots_of(options, scenario, recorded, staged);

  const fs::path& first = results.recording.empty() ? results.view : results.recording;
  summary.page = options.out.empty() ? first.parent_path() / "view.html" : options.out;
  AtomicFile out(summary.page);
  const std::string data = for_script(page), numbers = packer.base64();
  out.stream() << std::string_view(empty).substr(0, mark) << "<script type=\"application/json\" id=\"cotwin-data\">" << data
               << "</script>\n<script type=\"text/plain\" id=\"cotwin-numbers\">" << numbers << "</script>"
               << std::string_view(empty).substr(mark + std::string_view(kMark).size());
  out.commit();
  summary.rows = recorded.time.size();
  summary.columns = recorded.columns.size();
  summary.robots = stage.robots.size();
  summary.bodies = static_cast<std::size_t>(std::ranges::count(stage.bodies, true, &StagedBody::shown));
  summary.bytes = empty.size() + data.size() + numbers.size();
  return summary;
}

}  // namespace cotwin::master
