// The first task of a cascade is kept whatever the tasks below it ask for, also where the joints are at their limits.
#include <random>

#include "tests/components/compliance/cartesian_harness.h"

namespace cotwin::testing::cartesian_priority_test {
namespace {

using Eigen::Index;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// Random cascades of an arm, whose first task has to be kept where it is while the lower ones are moved far and fast.
struct RandomCascade {
  std::mt19937 source;
  std::string robot, tasks, held;
  bool position_first = false, orientation_first = false;  // else the held frame
  VectorXd q;

  double uniform(double low, double high) { return std::uniform_real_distribution(low, high)(source); }
  Vector3d vector(double length) { return Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)).normalized() * length; }

  explicit RandomCascade(unsigned seed) : source(seed) {
    const bool seven = seed % 3 != 0;
    robot = seven ? "lwr4" : seed % 2 != 0 ? "ur5e" : "kr300_r2500";
    held = seven ? "link_4" : seed % 2 != 0 ? "forearm_link" : "link_3";
    switch (static_cast<int>(uniform(0, 4))) {
      case 0:
        tasks = "position,orientation," + held;
        position_first = true;
        break;
      case 1:
        tasks = "position," + held + ",orientation";
        position_first = true;
        break;
      case 2:
        tasks = "orientation," + held + ":z,position";
        orientation_first = true;
        break;
      default:
        tasks = held + ":z,pose";
    }
    q = seven ? lwr4_posture() : VectorXd((VectorXd(6) << 0.3, -1.2, 1.4, -0.6, 0.8, 0.2).finished());
    for (Index j = 0; j < q.size(); ++j) q[j] += uniform(-0.3, 0.3);
  }
};

TEST(CartesianPriority, TheFirstTaskIsKeptWhateverTheLowerOnesAskFor) {
  constexpr int kCascades = 1000;
  double worst = 0;
  int limited = 0, contradicting = 0;
  for (unsigned seed = 0; seed < kCascades; ++seed) {
    RandomCascade random(seed);
    Kinematics E(random.robot), held(random.robot, random.held);
    Subject unit("unit:compliance?space=cartesian&tasks=" + random.tasks, random.robot);
    const Pose X = E.at(random.q), X_held = held.at(random.q);
    desire(unit, X);
    unit["q"] = random.q;
    unit["theta"] = random.q;
    unit["dq_max"] *= random.uniform(0.1, 0.5);
    unit.initialise();
    double error = 0;
    bool met = false;
    for (int i = 0; i < 300; ++i) {
      if (i % 150 == 0) {
        if (!random.position_first) unit["p_d"] = X.p + random.vector(random.uniform(0, 0.5));
        if (!random.orientation_first) {
          const Eigen::AngleAxisd turn(random.uniform(0, 2), random.vector(1));
          unit["quat_d"] = quaternion_values(Quaterniond(turn * X.R));
        }
        if (random.position_first || random.orientation_first) unit["shift_held"] = random.vector(random.uniform(0, 0.4));
      }
      unit.step();
      const Pose now = E.at(unit["q_c"]);
      const double off = random.position_first      ? (now.p - X.p).norm()
                         : random.orientation_first ? 0.3 * Quaterniond(now.R).angularDistance(Quaterniond(X.R))
                                                    : std::abs(held.at(unit["q_c"]).p.z() - X_held.p.z());
      error = std::max(error, off);
      for (const std::int32_t limit : unit.instance().variables.at("limit").integers()) met = met || limit != 0;
    }
    limited += met;
    contradicting += unit.warning().find("a lower task could not be done") != std::string::npos;
    worst = std::max(worst, error);
    EXPECT_LT(error, 1e-3) << random.robot << " " << random.tasks << ", seed " << seed;
  }
  RecordProperty("largest_error_m", std::to_string(worst));
  EXPECT_GT(limited, kCascades / 2);
  EXPECT_GT(contradicting, kCascades / 4);
}

}  // namespace
}  // namespace cotwin::testing::cartesian_priority_test
