#pragma once
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "components/monitor/monitor.h"
#include "components/monitor/separation.h"
#include "models/foundation/support/text.h"
#include "models/robot/start.h"

/// Robots and bodies of the unit, with their variables.
namespace cotwin::monitor {

/// In place of +∞, because outputs are finite.
inline constexpr double kNone = 1e12;
/// Of obstacles.
inline constexpr double kLeastScale = 0.01, kMostScale = 100;

struct Monitor::Ports {
  double distance = kNone, least = kNone, rate = 0, time = kNone, self = kNone;
  std::array<double, 3> p_a{}, p_b{}, n{};
  std::array<std::int32_t, 2> pair{};
  double separation = kNone, S_p = 0, speed = 1;
  std::int32_t zone = 0;
};

struct Monitor::Part {
  Part(std::string part_name, std::span<const scene::Shape> shapes) : name(std::move(part_name)), solid(shapes) {}
  std::string name;
  distance::Solid solid;
  int robot = -1, link = -1;  // in robots_, and in its model (−1: the base); robot −1: a body of the scene
  bool moves = false;
  bool comes = false, present = true;  // an obstacle, and whether it is there
  bool jumped = false;                 // it is elsewhere or of another shape than in the last step, without a motion
  Pose X_W, X_W_before;
  Twist V_W = Twist::Zero();
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();  // of the ball around its shapes, in W
  double motion = 0;                                 // largest way of a point since the last step, m
};

/// A pose with its velocity as ports.
struct PosePorts {
  std::vector<double> p{0, 0, 0}, quat{1, 0, 0, 0}, v{0, 0, 0}, w{0, 0, 0};
};

struct Monitor::Robot {
  explicit Robot(const scene::PlacedRobot& robot)
      : placed(&robot),
        prefix(robot.name.empty() ? "" : text::identifier(robot.name) + "."),
        X_WL(robot.model.bodies.size()),
        X_WL_at(X_WL),
        V_WL(robot.model.bodies.size()) {
    for (Values* v : {&q, &dq, &q_before, &q_at, &zeros}) v->assign(static_cast<std::size_t>(robot.model.n()), 0.0);
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
  Values q, dq, q_before;
  PosePorts base;
  Pose X_WB, X_WB_before;
  std::vector<Pose> X_WL, X_WL_at;
  std::vector<Twist> V_WL;
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
  std::size_t kept_first = 0;           // the one that counted last
  Values speeds;                        // of the fastest points of base and links, m/s
  Values base_before = Values(7, 0.0);  // state
};

struct Monitor::Body {
  std::string prefix;
  std::size_t part = 0;
  PosePorts pose;
  Values before = Values(7, 0.0);           // state
  std::optional<distance::Solid> unscaled;  // of an obstacle
  double present = 1, scale = 1, scale_in_force = 1;
};

struct Monitor::Pair {
  std::size_t a = 0, b = 0;  // parts
  std::size_t group_a = 0, group_b = 0;
  int inflated = 0;  // number of the two that are inflated
};

}  // namespace cotwin::monitor
