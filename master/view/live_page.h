#pragma once
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/bus/live_run.h"
#include "components/unit/unit_table.h"
#include "master/scenario/scenario.h"

/// The page of `cotwin view` for a run that goes on: a gateway serves it at `/`.
namespace cotwin::master {

/// The page of a run of this scenario. `folders`: with robots and scenes. Robots and scene are read when the content is first asked for. Throws
/// Error if this build has no page.
std::shared_ptr<bus::RunPage> live_page(Scenario scenario, std::span<const UnitType> types,
                                        std::vector<std::filesystem::path> folders);

/// The page of a gateway without a run to show: robots, services and jobs. Throws Error as live_page().
std::shared_ptr<bus::RunPage> gateway_page();

}  // namespace cotwin::master
