#pragma once
#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "components/unit/time.h"
#include "components/unit/variables.h"
#include "models/collision/cell/cell.h"
#include "models/mechanics/pose.h"
#include "models/scene/cell.h"

/// Robots and bodies as ports of a unit that follows their shapes.
namespace cotwin::surroundings {

using Values = std::vector<double>;

/// A pose in W with its velocity as ports.
struct PosePorts {
  Values p{0, 0, 0}, quat{1, 0, 0, 0}, v{0, 0, 0}, w{0, 0, 0};
  Values before = Values(7, 0.0);  // state: p and quat at the last step
  Pose X_before;                   // last(), for units that use it often

  void set(const Pose& X);
  void set_before(const Pose& X);
  void remember();
  bool is_finite() const;
  /// The one of the last step.
  Pose last() const;
};

/// A body of the scene.
struct Body {
  Body() = default;
  explicit Body(const scene::Body& body);

  std::string prefix;  // of its variables
  PosePorts pose;
};

struct Robot {
  explicit Robot(const scene::PlacedRobot& robot);

  const scene::PlacedRobot* placed;
  std::string prefix, base_prefix, of;  // of its variables: "left.", "left.base_"; "of robot left"
  int number = -1;                      // in the cell; −1: it was not added
  std::size_t first = 0;                // part of its base there
  Values q, dq, q_before;
  PosePorts base;
  Pose X_WB;
  std::vector<Pose> X_WL;
  std::vector<Twist> V_WL;
  std::vector<std::string> tools;
  Values tools_wanted, tools_in_force;

  /// Adds its parts to a cell. Returns what has no shapes, as Cell::add().
  std::string add_to(collision::Cell& cell, bool floating);
  bool is_in_cell() const { return number >= 0; }
  void remember();
  /// Brings links, and the parts in the cell, to positions and speeds of the joints, with the base at X_WB.
  void place(collision::Cell& cell, std::span<const double> q_at, std::span<const double> dq_at);
  /// Brings the shapes of tools on a link into force. Returns whether any of them came or went; tools_in_force stays for other links.
  bool show_tools(collision::Cell& cell, std::size_t link) const;
};

enum class Velocity { kNone, kUsed };

/// Declares a pose as inputs p, quat (and v, w), or where it does not move as parameters p0, quat0. `of`: "of its base". `may_be_lost`: the
/// unit knows what to do while it is no number, and needs its velocity.
void declare_pose(Variables& v, const std::string& prefix, PosePorts& pose, const std::string& of, bool moves,
                  Velocity velocity, bool may_be_lost = false);
/// Declares a tunable tool.NAME for each tool.
void declare_tools(Variables& v, Robot& robot);
/// Declares the states of the last step.
void declare_before(Variables& v, Robot& robot, bool floating);

/// Throws Error `unit:monitor.left.q[2]: is nan at 0.1 s` for a value that is not finite; `prefix`: "left.".
void check_finite(const std::string& place, const std::string& prefix, const char* name, const Values& values, Time now);
void check_finite(const std::string& place, const std::string& prefix, const PosePorts& pose, Time now);

}  // namespace cotwin::surroundings
