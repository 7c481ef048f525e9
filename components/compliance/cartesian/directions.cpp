#include "components/compliance/cartesian/directions.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string_view>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr const char* kNames[] = {"x", "y", "z", "rx", "ry", "rz"};

std::vector<int> named(const std::string& place, const std::string& task) {
  std::vector<int> directions;
  if (task.empty()) {
    directions.resize(6);
    std::iota(directions.begin(), directions.end(), 0);
    return directions;
  }
  for (const std::string_view part : text::split(task, ',')) {
    const std::string_view name = text::trim(part);
    const auto found = std::ranges::find(kNames, name);
    if (found == std::end(kNames))
      throw Error(place, "setting task: '" + std::string(name) + "', expected some of x, y, z, rx, ry, rz");
    const int i = static_cast<int>(found - std::begin(kNames));
    if (std::ranges::find(directions, i) != directions.end())
      throw Error(place, "setting task: names " + std::string(name) + " twice");
    directions.push_back(i);
  }
  std::ranges::sort(directions);
  return directions;
}

Index rank(const MatrixXd& J) {
  if (J.size() == 0) return 0;
  constexpr double kZero = 1e-6;
  return (numerics::singular_values(J).array() > kZero).count();
}

/// Jacobians in postures that are spread over the range of the joints.
std::vector<MatrixXd> samples(const robot::RobotModel& robot, const robot::FrameOnBody& frame) {
  const robot::Mechanism mechanism(robot);
  robot::Data data(mechanism);
  std::vector<MatrixXd> all;
  Eigen::VectorXd q(robot.n());
  for (int k = 1; k <= 8; ++k) {
    for (Index i = 0; i < q.size(); ++i) {
      const robot::Joint& joint = robot.joints[static_cast<std::size_t>(i)];
      const bool bound = std::isfinite(joint.q_min) && std::isfinite(joint.q_max);
      const double low = bound ? joint.q_min : -2, high = bound ? joint.q_max : 2;
      // A sequence without a regular pattern between the joints.
      const double share = std::fmod(0.6180339887498949 * k + 0.7548776662466927 * k * static_cast<double>(i + 1), 1.0);
      q[i] = low + share * (high - low);
    }
    MatrixXd J(6, robot.n());
    robot::jacobian(mechanism, data, q, frame, J);
    all.push_back(std::move(J));
  }
  return all;
}

MatrixXd rows(const MatrixXd& J, const std::vector<int>& directions) {
  MatrixXd part(static_cast<Index>(directions.size()), J.cols());
  for (std::size_t k = 0; k < directions.size(); ++k) part.row(static_cast<Index>(k)) = J.row(directions[k]);
  return part;
}

}  // namespace

std::vector<int> rendered_directions(const std::string& place, const std::string& task, const robot::RobotModel& robot,
                                     const robot::FrameOnBody& frame) {
  std::vector<int> directions = named(place, task);
  const std::vector<MatrixXd> J = samples(robot, frame);
  const auto most = [&](const std::vector<int>& which) {
    Index best = 0;
    for (const MatrixXd& at : J) best = std::max(best, rank(rows(at, which)));
    return static_cast<std::size_t>(best);
  };
  if (most(directions) == directions.size()) return directions;
  std::string single;
  for (int i = 0; i < 6; ++i) {
    if (most({i}) == 1) text::append(single, kNames[i]);
  }
  const std::size_t together = most({0, 1, 2, 3, 4, 5});
  std::string asked;
  for (const int i : directions) asked += (asked.empty() ? "" : ",") + std::string(kNames[i]);
  throw Error(place, "space=cartesian, setting task: robot '" + robot.name + "' of " + std::to_string(robot.n()) +
                         " joints cannot render " + asked + " at once, expected task= with at most " +
                         std::to_string(together) + " of " + single);
}

}  // namespace cotwin::compliance
