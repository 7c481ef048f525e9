#include "models/collision/cell/placed_cell.h"

#include <Eigen/Geometry>

#include "models/foundation/support/text.h"

namespace cotwin::collision {

std::vector<Place> places(const PlacedCell& cell) {
  std::vector<Place> all;
  for (const PlacedCell::Robot& one : cell.robots)
    all.push_back({one.robot.name.empty() ? one.robot.model.name : one.robot.name, one.X_WB, 0, one.by});
  for (const PlacedCell::Body& one : cell.bodies)
    if (one.by != one.file.filename()) all.push_back({one.body.name, one.body.X_WB, 0, one.by});
  for (const PlacedCell::Cloud& one : cell.clouds) all.push_back({one.name, one.X_WC, one.radius, one.by});
  return all;
}

std::string text_of(const Pose& X_W) {
  const auto vector = [](const Eigen::Vector3d& v) {
    return "(" + text::to_text(v.x(), 4) + " " + text::to_text(v.y(), 4) + " " + text::to_text(v.z(), 4) + ")";
  };
  const Eigen::AngleAxisd turn(X_W.R);
  constexpr double kNoTurn = 1e-6;  // rad
  return vector(X_W.p) + " m" + (turn.angle() < kNoTurn ? "" : ", turned by " + vector(turn.angle() * turn.axis()) + " rad");
}

std::string text_of(const Place& place) {
  return place.name + " at " + text_of(place.X_W) +
         (place.radius > 0 ? " with balls of " + text::to_text(place.radius, 3) + " m" : "") +
         (place.by.empty() ? ", no place is given" : " by " + place.by);
}

}  // namespace cotwin::collision
