#pragma once
#include <filesystem>
#include <functional>
#include <map>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "components/services/json/json.h"
#include "components/services/json/request.h"
#include "master/farm/farm.h"
#include "models/foundation/formats/csv.h"
#include "tests/master/test_units.h"
#include "tests/support/files.h"

/// A study of units with closed forms.
namespace cotwin::testing {

inline const master::Build kBuild{"0.1.0", 42, "test"};

/// A rate of 2 rad/s is integrated, beside a chaotic map, whose bits show any difference, and a unit that fails after `after` s.
inline constexpr const char* kScenario = R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="plant" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssd:System name="plant"><ssd:Elements>
    <ssd:Component name="tank" source="unit:integrator" type="application/x-cotwin-unit"/>
    <ssd:Component name="map" source="unit:heavy" type="application/x-cotwin-unit"/>
    <ssd:Component name="gear" source="unit:faulty" type="application/x-cotwin-unit"/>
  </ssd:Elements></ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="0.05"/>
  <ssd:Annotations><ssc:Annotation type="cotwin.master">
    <cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="1 ms">
      <cotwin:Report name="level" kind="signal" a="tank.y"/>
    </cotwin:Master>
  </ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>)";

/// A study of the scenario above, with `members` beside the name of the scenario.
struct Trial {
  TemporaryFolder folder{"farm"};
  master::Study study;

  explicit Trial(const std::string& members, const std::string& scenario = kScenario) {
    folder.write("plant.ssd", scenario);
    study = master::read_study(
        services::parse_object(std::string("{\"scenario\": \"plant.ssd\", ") +
                               (members.find("\"set\"") == std::string::npos ? "\"set\": [\"gear.after=1\"], " : "") + members +
                               "}"),
        "study.json", folder.path());
  }
  master::Farm farm() const { return master::Farm(study, test_types()); }
  std::filesystem::path out() const { return folder / "out"; }
  master::Registry begin(const master::Farm& farm) const {
    std::vector<std::string> factors;
    for (const master::Factor& factor : study.design.factors) factors.push_back(factor.name);
    return master::Registry(out(), farm.facts(kBuild), factors, farm.figures());
  }
};

inline master::FarmHooks hooks(std::function<bool()> stops = [] { return false; }) {
  return {std::move(stops), [](std::int64_t, std::int64_t, const std::string&) {}};
}

/// The registry as CSV, without wall time and session.
inline std::map<std::string, std::vector<std::string>> columns(master::Registry& registry) {
  std::ostringstream out;
  registry.write(out);
  const std::string text = out.str();
  csv::Reader reader(text, "export");
  std::map<std::string, std::vector<std::string>> all;
  while (reader.next()) {
    for (std::size_t k = 0; k < reader.names().size(); ++k) {
      if (reader.names()[k] != "seconds" && reader.names()[k] != "session") all[reader.names()[k]].emplace_back(reader.text(k));
    }
  }
  return all;
}

}  // namespace cotwin::testing
