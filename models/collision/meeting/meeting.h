#pragma once
#include <Eigen/Core>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "models/cloud/tree.h"
#include "models/scene/cell.h"
#include "models/trajectory/trajectory.h"

/// Whether a robot keeps clear of others and of what stands around it while it moves.
namespace cotwin::collision {

/// What a link carries for some time, such as a gripper.
struct Tool {
  std::string name;
  int link = -1;                                              // index of a body of the robot; −1: the base
  std::vector<scene::Shape> shapes;                           // in the frame of the link
  double from = -scene::kInfinity, until = scene::kInfinity;  // s, both included
};

/// A robot at its place.
struct Stand {
  scene::PlacedRobot robot;
  Pose X_WB;
  std::vector<Tool> tools = {};
};

/// A point cloud that stands beside the bodies of a scene.
struct PlacedCloud {
  std::string name = "cloud";
  std::shared_ptr<const cloud::Tree> points;
  double radius = 0;  // of the ball around each point, m
  Pose X_WC;
};

/// What a robot does: it follows `path`, rests before and after it or goes on, or, where that has no joints, rests at q (n, rad or m).
struct Motion {
  enum class Loop { kNo, kRepeat, kThereAndBack };
  trajectory::Path path;
  std::vector<double> q = {};
  Loop loop = Loop::kNo;
  double period = 0;  // s, of the part before the path's end that is repeated
};

struct Options {
  double clearance = 0;  // m: less than this is no longer clear
  bool self = false;     // links of the robot that are no neighbours count, too, without clearance, and so do its tools and
                         // all links but those that carry them
  std::vector<std::string> ignore;  // pairs of names, "link_5:table", "left/link_3:right/gripper"
};

/// A place of the motion, seen from the robot.
struct Nearest {
  double t = 0, d = scene::kInfinity;  // s, m; negative: they overlap; infinity: there is nothing to meet
  std::string link, other;             // names of the parts
  Eigen::Vector3d p_link, p_other;     // the nearest points, in W
};

struct Verdict {
  bool clear = true;
  /// Not clear: the first time; d is below the clearance, or above it by less than 1 µm. Clear: the least distance, to 0.1 mm or 0.1 %.
  Nearest nearest;
};

/// Answers for one robot, the first, among others that move or stand, and a scene whose bodies all stand, with clouds. Nothing is passed, however thin it is
/// (sweep.h): the joints' speeds and levers bound how far the points of a pair move.
class Checker {
 public:
  /// Throws Error for a robot without shapes, shapes whose distance is not measured, and unknown names in `ignore`.
  Checker(const scene::Scene& scene, std::vector<Stand> robots, const Options& options,
          std::span<const PlacedCloud> clouds = {});
  ~Checker();
  /// What should be told beside the verdict: bodies that move in the scene and stand here, meshes that are not closed, links and tools without
  /// shapes.
  const std::vector<std::string>& notes() const;
  /// `motions`: of all robots, in their order; that of the first one says from when to when. If a robot gets a tool later, that counts, too, and
  /// if it loops all until `until` (s) does.
  Verdict check(std::span<const Motion> motions, double until = 0);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::collision
