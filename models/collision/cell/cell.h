#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "models/collision/body.h"
#include "models/scene/cell.h"

/// What of robots and of a scene can meet.
namespace cotwin::collision {

/// What meets others as one: a body of the scene, a link of a robot, or a tool beside the link that carries it.
struct Part {
  std::string name;        // of a robot with a name: "left/link_5"
  std::string alias = {};  // in `ignore` that was checked, of a tool that of its link; "": none
  Body body;
  int robot = -1, link = -1;  // number of the robot, −1: a body of the scene; body of its model, −1: the base
  bool tool = false;
  bool moves = false;  // in W
  bool present = true;
  Pose X_W;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();  // of the ball around its shapes, in W
};

/// Two parts that can meet.
struct Pair {
  std::size_t a = 0, b = 0;  // a < b: bodies of the scene, then robots in their order
  bool self = false;         // both are of one robot
  int common = -1;           // then the body of the model that carries both, −1: the base
};

/// The parts of a scene and of robots, where they are, and their pairs.
class Cell {
 public:
  /// Adds the bodies of a scene, where they stand there. Before the robots. Throws Error for shapes whose distance is not measured.
  void add(const scene::Scene& scene);
  Part& add(const scene::Body& body);
  /// Adds a cloud, which stands; `ball`: around each point, m. Before the robots. Throws Error if a body has this name.
  Part& add(const std::string& name, std::shared_ptr<const cloud::Tree> points, double ball);
  /// Adds base and links of a robot, which must outlive the cell. `floats`: its base moves. Returns "no shapes of base, link_1", or "". Throws Error for a
  /// robot without shapes.
  std::string add(const scene::PlacedRobot& robot, bool floats);
  /// Adds what a link (−1: the base) of the last robot carries.
  void add_tool(const std::string& name, std::span<const scene::Shape> shapes, int link);
  /// All pairs of which one part moves, except bodies of the scene with one another, links that a joint connects, a tool with its link and with others
  /// on that link, and what `ignore` names, "link_5:table". Throws Error for unknown names. `checked`: by a monitor, whose
  /// names of links are aliases; unknown ones are passed over.
  void find_pairs(std::span<const std::string> ignore, bool checked = false);

  std::vector<Part> parts;
  std::vector<Pair> pairs;
  const robot::RobotModel& model(int robot) const { return robots_[static_cast<std::size_t>(robot)].placed->model; }
  /// The parts of a robot: its base, its links in their order, its tools.
  std::span<Part> of(int robot);

  /// Places the parts of a robot, X_WL: of its links.
  void place(int robot, const Pose& X_WB, std::span<const Pose> X_WL);
  void place(Part& part, const Pose& X_W);

  /// The distance of a pair where its parts are, if it is at most `most`, otherwise infinity. `bound`: a lower bound of it, at most `most` if
  /// the shapes were looked at. Allocates nothing.
  Distance distance(const Pair& pair, double most, double& bound);
  /// The same at other poses.
  Distance distance(const Pair& pair, const Pose& X_WA, const Pose& X_WB, double most = scene::kInfinity) {
    return finder_.find(parts[pair.a].body, X_WA, parts[pair.b].body, X_WB, most);
  }

  /// Removes the points of a cloud in W that are nearer than `most` (m) to robots. Returns how many.
  std::size_t drop_near(cloud::Cloud& cloud, double most);

  /// An upper bound of the path lengths, m, of a part's points relative to the body `from` of its model that carries it (−1: the base), while the independent
  /// joints move from q by at most `moved` (n each, rad or m): of each joint in between, how far it moves times the longest lever that it can have.
  /// `reach`: of the points from the origin of `from`.
  double travel(const Part& part, int from, std::span<const double> q, std::span<const double> moved, double& reach) const;

 private:
  struct Robot {
    const scene::PlacedRobot* placed;
    std::size_t first, end;  // parts
  };
  Part& add(const std::string& name, std::span<const scene::Shape> shapes, int robot, int link);
  Part& add(const std::string& name, Body body, int robot, int link);
  std::vector<Robot> robots_;
  Finder finder_;
};

/// Calls visit(body, joint, lever) for each joint from `link` to the body `from` that carries it (−1: the base). lever: of points up to `reach` from the
/// link's origin, m; 1 where a joint slides. farthest(body): how far it can slide from q = 0, m. Returns the points' reach from the origin of `from`.
template <class Farthest, class Visit>
double for_each_lever(const robot::RobotModel& model, int link, int from, double reach, const Farthest& farthest,
                      const Visit& visit) {
  for (; link != from; link = model.joint_of(link).parent) {
    const robot::Joint& joint = model.joint_of(link);
    const bool turns = joint.type == robot::JointType::kRevolute;
    const auto body = static_cast<std::size_t>(link);
    visit(body, joint, turns ? reach : 1.0);
    reach += joint.X_PJ.p.norm() + (turns ? 0.0 : farthest(body, joint));
  }
  return reach;
}

}  // namespace cotwin::collision
