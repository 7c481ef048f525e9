#include "components/compliance/cartesian/task_list.h"

#include <algorithm>
#include <iterator>
#include <string_view>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::compliance {
namespace {

constexpr std::string_view kDirectionNames[] = {"x", "y", "z", "rx", "ry", "rz"};

/// Index of a direction, −1: none of that name.
int direction(std::string_view name) {
  const auto found = std::ranges::find(kDirectionNames, name);
  return found == std::end(kDirectionNames) ? -1 : static_cast<int>(found - std::begin(kDirectionNames));
}

std::vector<int> directions_of_E(std::string_view name) {
  if (name == "pose") return {0, 1, 2, 3, 4, 5};
  if (name == "position") return {0, 1, 2};
  if (name == "orientation") return {3, 4, 5};
  const int single = direction(name);
  return single < 0 ? std::vector<int>() : std::vector{single};
}

TaskEntry held(const std::string& place, const std::string& name, const robot::RobotModel& robot) {
  TaskEntry task{.name = name, .held = true, .frame = {}, .directions = {0, 1, 2}};
  std::string frame = name;
  const bool whole = std::ranges::any_of(robot.frames, [&](const robot::Frame& f) { return f.name == name; });
  if (const std::size_t colon = name.rfind(':'); colon != std::string::npos && !whole) {
    frame = name.substr(0, colon);
    const int axis = direction(std::string_view(name).substr(colon + 1));
    if (axis < 0 || axis > 2)
      throw Error(place, "setting tasks: '" + name + "', expected x, y or z after the colon: a position is held");
    task.directions = {axis};
  }
  const auto found = std::ranges::find(robot.frames, frame, &robot::Frame::name);
  if (found == robot.frames.end()) {
    throw Error(place, "setting tasks: '" + frame + "' is no frame of robot '" + robot.name +
                           "', expected pose, position, orientation, x, y, z, rx, ry, rz, or a frame that is held");
  }
  if (found->body < 0) throw Error(place, "setting tasks: frame '" + frame + "' is fixed to the base, expected one that moves");
  task.frame = robot::on_body(*found);
  return task;
}

}  // namespace

std::vector<TaskEntry> task_list(const std::string& place, const std::string& tasks, const std::vector<int>& rendered,
                                 const robot::RobotModel& robot) {
  std::vector<TaskEntry> list;
  std::vector<int> open = rendered;
  const std::string names = tasks.empty() ? "pose" : tasks;
  for (const std::string_view part : text::split(names, ',')) {
    const std::string name(text::trim(part));
    TaskEntry task{.name = name, .held = false, .frame = {}, .directions = directions_of_E(name)};
    if (task.directions.empty()) {
      list.push_back(held(place, name, robot));
      continue;
    }
    std::erase_if(task.directions, [&](int i) { return std::ranges::find(rendered, i) == rendered.end(); });
    if (task.directions.empty())
      throw Error(place, "setting tasks: '" + name + "' has no direction that the setting task renders");
    for (const int i : task.directions) {
      const auto found = std::ranges::find(open, i);
      if (found == open.end())
        throw Error(place, "setting tasks: direction " + std::string(kDirectionNames[i]) + " is in two tasks");
      open.erase(found);
    }
    list.push_back(std::move(task));
  }
  if (!open.empty()) {
    throw Error(place, "setting tasks: no task has direction " + std::string(kDirectionNames[open.front()]) +
                           ", expected every direction of the setting task (empty: all six), for example tasks=pose");
  }
  return list;
}

std::vector<int> row_counts(const std::vector<TaskEntry>& tasks) {
  std::vector<int> counts;
  for (const TaskEntry& task : tasks) counts.push_back(static_cast<int>(task.directions.size()));
  return counts;
}

}  // namespace cotwin::compliance
