#pragma once
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "components/monitor/separation.h"
#include "components/monitor/track.h"
#include "components/unit/surroundings/surroundings.h"
#include "models/collision/body.h"

/// Robots and bodies of the unit, with their variables.
namespace cotwin::monitor {

using surroundings::PosePorts;
using surroundings::Values;

/// In place of +∞, because outputs are finite.
inline constexpr double kNone = 1e12;
/// Of obstacles.
inline constexpr double kLeastScale = 0.01, kMostScale = 100;

struct Ports {
  double distance = kNone, least = kNone, rate = 0, time = kNone, self = kNone;
  std::array<double, 3> p_a{}, p_b{}, n{};
  std::array<std::int32_t, 2> pair{};
  double separation = kNone, S_p = 0, speed = 1, least_moving = kNone;
  std::int32_t zone = 0, points_known = 0, late = 0;
  /// The pair that `separation` is of, as pair, p_a and p_b.
  struct Apart {
    std::array<std::int32_t, 2> pair{};
    std::array<double, 3> p_a{}, p_b{};
    std::int32_t points_known = 0;
  } apart;
};

struct Robot : surroundings::Robot {
  explicit Robot(const scene::PlacedRobot& robot)
      : surroundings::Robot(robot),
        X_WL_at(X_WL),
        V_WL_at(X_WL.size()),
        moved(q.size()),
        q_at(q.size()),
        zeros(q.size()),
        speeds(X_WL.size() + 1) {}

  std::vector<Pose> X_WL_at;
  std::vector<Twist> V_WL_at;
  Values moved, q_at, zeros;
  double at = -1;  // share of the step to which X_WL_at belongs
  Ports ports;
  std::unique_ptr<Separation> separation;
  /// A pair with a body from which the robot keeps its distance.
  struct Kept {
    std::size_t pair = 0;
    double bound = -scene::kInfinity;  // lower bound of its distance without inflation, m
  };
  std::vector<Kept> kept;
  std::size_t kept_first = 0;  // the one that counted last
  Values speeds;               // of the fastest points of base and links, m/s
};

/// A body of the scene.
struct Body : surroundings::Body {
  using surroundings::Body::Body;

  bool comes = false;                       // an obstacle
  bool kept = false;                        // robots keep their distance from it, and stop where it is lost
  bool was_lost = false;                    // in the last step
  std::array<double, 3> lost{};             // state: 1 while it is, how often it was, and when first, s
  Track track;                              // of a kept one
  std::optional<collision::Body> unscaled;  // of an obstacle
  double present = 1, scale = 1, scale_in_force = 1;
};

}  // namespace cotwin::monitor
