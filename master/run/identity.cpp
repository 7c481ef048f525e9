#include "master/run/identity.h"

#include <algorithm>
#include <optional>
#include <system_error>
#include <variant>

#include "components/robot_files/robot_files.h"
#include "master/engine/wiring/members.h"
#include "models/cloud/tree.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/fields.h"
#include "models/foundation/support/file_hash.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace fs = std::filesystem;

namespace {

/// Adds the contents of the files that a scenario may name, and which of them there are.
class Files {
 public:
  Files(const Scenario& scenario, Putter<>& out) : scenario_(scenario), out_(out) {}

  void add(const fs::path& name) {
    std::optional<std::uint64_t> hash;
    std::error_code none;
    for (const fs::path& file : {scenario_.folder / name, name}) {
      if (!hash && !name.empty() && (fs::is_regular_file(file, none) || csv::is_bag(file))) hash = hash_of_file(file);
    }
    out_.put(hash);
  }
  void add(const ComponentSpec& c) {
    for (const ParameterValue& start : c.start_values) {
      if (const std::string* text = std::get_if<std::string>(&start.value)) add(fs::path(*text));
    }
    if (!is_unit(c)) {
      const fs::path fmu = fmu_source(c, scenario_).path;
      add(fs::is_directory(fmu) ? fmu / "modelDescription.xml" : fmu);
      return;
    }
    const std::size_t query = std::min(c.source.find('?'), c.source.size());  // "robot=arm.urdf&kind=csv"
    for (const std::string_view setting : text::split(std::string_view(c.source).substr(query), '&')) {
      const std::size_t equals = setting.find('=');
      if (equals != std::string_view::npos) add(fs::path(setting.substr(equals + 1)));
    }
  }

 private:
  const Scenario& scenario_;
  Putter<>& out_;
};

}  // namespace

std::uint64_t hash_of(const Scenario& scenario) {
  Scenario s = scenario;
  for (ComparisonSpec& c : s.comparisons) {
    c.from = c.from.value_or(s.start);
    c.to = c.to.value_or(s.stop);
  }
  ByteWriter bytes;
  Putter out(bytes);
  out.put(s);
  Files files(s, out);
  for (const auto& [name, value] : s.settings) files.add(fs::path(value));
  for (const NestedSetting& setting : s.nested_settings) files.add(fs::path(setting.value));
  for (const ComponentSpec& c : s.components) files.add(c);
  for (const ToolSpec& t : s.tools) files.add(t.shapes);
  return cotwin::hash_of(bytes.bytes());
}

std::uint64_t hash_of(const FileStore& models) {
  ByteWriter bytes;
  Putter out(bytes);
  for (const auto& robot : models.all<FoundRobot>(kRobotKey)) out.put(robot->model);
  for (const auto& cell : models.all<FoundCell>(kCellKey)) out.put(cell->cell);
  for (const auto& obstacle : models.all<cloud::Obstacle>(cloud::kCloudKey)) out.put(obstacle->points->cloud());
  for (const auto& set : models.all<ParameterSet>(kValuesKey)) out.put(*set);
  return cotwin::hash_of(bytes.bytes());
}

}  // namespace cotwin::master
