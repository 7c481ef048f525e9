#include "master/program/time_options.h"

#include <algorithm>

#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace fs = std::filesystem;

void TimeOptions::add_to(CLI::App& command) {
  command.add_option("--t-column", column, "Name of the time column of a CSV file (default: t, time or timestamp)")
      ->type_name("NAME");
  command.add_option("--time-unit", unit, "Unit of the time in a CSV file: s, ms, us or ns")
      ->type_name("")
      ->capture_default_str();
}

void TimeOptions::add_topic_to(CLI::App& command) {
  command.add_option("--topic", topic, "Topic of a ROS bag (default: the only one with joints)")->type_name("NAME");
}

trajectory::TimeColumn TimeOptions::chosen(std::span<const fs::path> places) const {
  const trajectory::TimeColumn time{column, trajectory::seconds_per("--time-unit", unit), topic};
  const auto is_folder = [](const fs::path& place) {
    std::error_code none;
    return fs::is_directory(place, none) && !csv::is_bag(place);
  };
  if ((!column.empty() || time.unit != 1) && std::ranges::all_of(places, is_folder))
    throw Error(column.empty() ? "--time-unit" : "--t-column",
                places.front().string() + " is a folder with the results of a run, whose time is known; expected a CSV file");
  for (const fs::path& place : places) {
    if (place.extension() == ".ssd" || place.extension() == ".ssp")
      throw Error(place.string(), "is a scenario, expected the folder of its results, which cotwin run " + place.string() +
                                      " names at its end");
  }
  return time;
}

}  // namespace cotwin::master
