#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "models/cloud/tree.h"
#include "models/mechanics/pose.h"
#include "models/scene/cell.h"

namespace cotwin::collision {

/// What a link carries for some time, such as a gripper.
struct Tool {
  std::string name;
  int link = -1;                                              // index of a body of the robot; −1: the base
  std::vector<scene::Shape> shapes;                           // in the frame of the link
  double from = -scene::kInfinity, until = scene::kInfinity;  // s, both included
};

/// Robots and what they may meet, as they stand at the start. `by` says who places a thing: "monitor", "world", "cell.sdf", "--base", "request"; "":
/// nobody.
struct PlacedCell {
  struct Body {
    scene::Body body;                 // X_WB: where it stands; its shapes in their own size
    std::filesystem::path file = {};  // of its scene, links followed
    std::string by = {};
    bool moves = false;   // in the run, so that it meets bases, too; it is taken where it stands
    bool present = true;  // at the start
    double scale = 1;     // of its shapes about its origin
  };
  struct Cloud {
    std::string name = "cloud";
    std::shared_ptr<const cloud::Tree> points;
    double radius = 0;  // of the ball around each point, m
    Pose X_WC;
    std::filesystem::path file = {};  // links followed
    std::string by = {};
  };
  struct Robot {
    scene::PlacedRobot robot;
    Pose X_WB;
    std::vector<Tool> tools = {};
    std::vector<double> q0 = {};  // posture, rad or m; empty: not known
    bool floats = false;
    std::string by = {};
    std::optional<std::string> alias = {};  // "left/" before the names of its links in `ignore` of a monitor
  };
  std::vector<Body> bodies;
  std::vector<Cloud> clouds;
  std::vector<Robot> robots;
  std::vector<std::string> ignore;  // pairs of names, "link_5:table", "left/link_3:right/gripper"
  bool ignore_checked = false;      // by a monitor: links by alias, names that are not here are passed over
  double r = 0;                     // inflation of all robots, m: of distances from others, and twice of those between robots

  /// Adds the bodies of a scene as they stand in its file.
  void add(const scene::Scene& scene, const std::filesystem::path& file = {}) {
    for (const scene::Body& body : scene.bodies) bodies.push_back({body, file, file.filename().string()});
  }
};

/// Where a thing stands.
struct Place {
  std::string name;
  Pose X_W;
  double radius = 0;  // of the balls of a cloud, m
  std::string by;
};
/// What an answer rests on: robots, clouds, and bodies that do not stand as in their file.
std::vector<Place> places(const PlacedCell& cell);
/// "(0.3 0.05 0.85) m"; if it is turned, "…, turned by (0 0 0.2) rad", a rotation vector.
std::string text_of(const Pose& X_W);
/// "post at (0.3 0.05 0.85) m by monitor"
std::string text_of(const Place& place);

}  // namespace cotwin::collision
