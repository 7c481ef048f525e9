#pragma once
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "components/monitor/separation.h"
#include "models/collision/body.h"
#include "models/foundation/support/text.h"
#include "models/robot/start.h"
#include "models/scene/cell.h"

/// Robots and bodies of the unit, with their variables.
namespace cotwin::monitor {

using Values = std::vector<double>;

/// In place of +∞, because outputs are finite.
inline constexpr double kNone = 1e12;
/// Of obstacles.
inline constexpr double kLeastScale = 0.01, kMostScale = 100;

struct Ports {
  double distance = kNone, least = kNone, rate = 0, time = kNone, self = kNone;
  std::array<double, 3> p_a{}, p_b{}, n{};
  std::array<std::int32_t, 2> pair{};
  double separation = kNone, S_p = 0, speed = 1;
  std::int32_t zone = 0;
  /// The pair that `separation` is of, as pair, p_a and p_b.
  struct Apart {
    std::array<std::int32_t, 2> pair{};
    std::array<double, 3> p_a{}, p_b{};
  } apart;
};

/// A pose with its velocity as ports.
struct PosePorts {
  Values p{0, 0, 0}, quat{1, 0, 0, 0}, v{0, 0, 0}, w{0, 0, 0};
  Values before = Values(7, 0.0);  // state: p and quat at the last step
  Pose X_before;

  Pose last() const {
    return {Eigen::Quaterniond(before[3], before[4], before[5], before[6]).normalized().toRotationMatrix(),
            {before[0], before[1], before[2]}};
  }
};

struct Robot {
  explicit Robot(const scene::PlacedRobot& robot)
      : placed(&robot),
        prefix(robot.name.empty() ? "" : text::identifier(robot.name) + "."),
        X_WL(robot.model.bodies.size()),
        X_WL_at(X_WL),
        V_WL(X_WL.size()),
        V_WL_at(X_WL.size()),
        speeds(X_WL.size() + 1) {
    for (Values* v : {&q, &dq, &q_before, &q_at, &moved, &zeros}) v->assign(static_cast<std::size_t>(robot.model.n()), 0.0);
    for (std::size_t i = 0; i < q.size(); ++i) q[i] = robot::default_start(robot.model.joints[i]);
    for (const std::vector<scene::Shape>& shapes : robot.shapes) {
      for (const scene::Shape& shape : shapes) {
        if (!shape.tool.empty() && std::ranges::find(tools, shape.tool) == tools.end()) tools.push_back(shape.tool);
      }
    }
    tools_wanted.assign(tools.size(), 0.0);
    tools_in_force = tools_wanted;
  }

  const scene::PlacedRobot* placed;
  std::string prefix;
  std::size_t first = 0;  // part of its base
  Values q, dq, q_before, moved;
  PosePorts base;
  Pose X_WB;
  std::vector<Pose> X_WL, X_WL_at;
  std::vector<Twist> V_WL, V_WL_at;
  Values q_at, zeros;
  double at = -1;  // share of the step to which X_WL_at belongs
  std::vector<std::string> tools;
  Values tools_wanted, tools_in_force;
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
struct Body {
  std::string prefix;
  PosePorts pose;
  bool comes = false;                       // an obstacle
  bool kept = false;                        // robots keep their distance from it, and stop where it is lost
  bool was_lost = false;                    // in the last step
  std::array<double, 3> lost{};             // state: 1 while it is, how often it was, and when first, s
  std::optional<collision::Body> unscaled;  // of an obstacle
  double present = 1, scale = 1, scale_in_force = 1;
};

}  // namespace cotwin::monitor
