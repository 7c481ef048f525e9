#pragma once
#include <filesystem>
#include <nlohmann/json_fwd.hpp>

/// What is possible over a cell (the member "goals" of a reply of the service grow), as a file.
namespace cotwin::report {

/// Throws Error unless the suffix is .csv or .svg.
void check_map_file(const std::filesystem::path& file);
/// CSV with one row per goal, or SVG: for each cost the grid coloured by the least one, grey where a place is reached but no motion
/// keeps the bounds, white where it is not reached. Throws Error for a reply without goals, and for a picture of anything but a grid of
/// two dimensions.
void write_map(const std::filesystem::path& file, const nlohmann::ordered_json& reply);

}  // namespace cotwin::report
