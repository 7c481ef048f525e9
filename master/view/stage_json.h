#pragma once
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/scenario/scenario.h"
#include "master/scenery/recorded.h"
#include "master/scenery/scenery.h"
#include "master/view/packer.h"

namespace cotwin::master {

/// Signals that are calculated for the page, over their own times (ns).
struct CalculatedTable {
  std::vector<std::int64_t> time;
  std::vector<std::vector<double>> columns;
  std::vector<RecordedSignal> signals;
};

struct StageContent {
  const Scenery& stage;
  const Recorded& recorded;
  const Scenario* scenario;  // nullptr: none
  std::span<const UnitType> types;
  const std::vector<std::filesystem::path>& folders;
  bool live = false;  // the page calculates the ellipsoids from the masses and the signals; `rows` is empty
};

/// The parts of the page's data (page/source/format.ts) that show the stage: robots, figures, bodies, meshes, contacts, forces, energy, and what
/// must be recorded for cues without data. Adds to `calculated`, at these rows of the recording, and to the remarks.
nlohmann::ordered_json stage_json(const StageContent& content, const std::vector<std::size_t>& rows,
                                  CalculatedTable& calculated, Packer& packer, std::vector<std::string>& remarks);

}  // namespace cotwin::master
