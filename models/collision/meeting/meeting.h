#pragma once
#include <Eigen/Core>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "models/collision/cell/placed_cell.h"
#include "models/trajectory/trajectory.h"

/// Whether a robot keeps clear of others and of what stands around it while it moves.
namespace cotwin::collision {

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
};

/// A place of the motion, seen from the robot.
struct Nearest {
  double t = 0, d = scene::kInfinity;  // s, m, less the inflation; negative: they overlap; infinity: there is nothing to meet
  std::string link, other;             // names of the parts, without that of the first robot
  Eigen::Vector3d p_link, p_other;     // the nearest points, in W
};

struct Verdict {
  bool clear = true;
  /// Not clear: the first time, and what overlaps most then; d is below the clearance, or above it by less than 1 µm. Clear: the least distance, to 0.1 mm or 0.1 %.
  Nearest nearest;
};

/// Answers for the first robot of a cell among others that move or stand; bodies and clouds stay where they are. Nothing is passed, however thin it is
/// (sweep.h): the joints' speeds and levers bound how far the points of a pair move.
class Checker {
 public:
  /// Throws Error for a robot without shapes, shapes whose distance is not measured, and unknown names in `ignore`.
  explicit Checker(PlacedCell cell, const Options& options = {});
  ~Checker();
  /// What should be told beside the verdict: bodies and bases that move later or are not there at the start, meshes that are not closed, links and
  /// tools without shapes.
  const std::vector<std::string>& notes() const;
  /// `motions`: of all robots, in their order; that of the first one says from when to when. If a robot gets a tool later, that counts, too, and
  /// if it loops all until `until` (s) does.
  Verdict check(std::span<const Motion> motions, double until = 0);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::collision
