#include "models/scene/cell.h"

#include <algorithm>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::scene {

PlacedFrame find_frame(const Cell& cell, std::string_view name, const std::string& where) {
  const std::string whole(text::trim(name));
  const std::size_t slash = whole.find('/');
  const std::string owner = whole.substr(0, slash), frame = slash == std::string::npos ? "" : whole.substr(slash + 1);
  const Scene& scene = cell.scene;
  const auto named = [](const std::string& wanted) { return [wanted](const auto& x) { return x.name == wanted; }; };
  std::vector<std::string> names;
  for (std::size_t r = 0; r < cell.robots.size(); ++r) {
    const PlacedRobot& robot = cell.robots[r];
    const bool only = robot.name.empty();
    for (const robot::Frame& one : robot.model.frames) names.push_back((only ? "" : robot.name + "/") + one.name);
    if (!only && robot.name != owner) continue;
    const auto found = std::ranges::find_if(robot.model.frames, named(only ? whole : frame));
    if (found != robot.model.frames.end()) return {static_cast<int>(r), found->body, found->X_BF};
  }
  if (frame.empty()) {
    if (const auto body = std::ranges::find_if(scene.bodies, named(owner)); body != scene.bodies.end())
      return {-1, static_cast<int>(body - scene.bodies.begin()), {}};
  }
  const auto found = std::ranges::find_if(scene.frames, named(frame.empty() ? owner : owner + "." + frame));
  if (found != scene.frames.end()) return {-1, found->body, found->X_BF};
  for (const Body& body : scene.bodies) names.push_back(body.name);
  const std::string near = text::closest(whole, names);
  throw Error(where, "'" + whole + "' is no frame of a robot and no body or frame of scene '" + scene.name +
                         "', expected ROBOT/FRAME (FRAME of a single robot), BODY or BODY/FRAME" +
                         (near.empty() ? "" : "; did you mean '" + near + "'?"));
}

}  // namespace cotwin::scene
