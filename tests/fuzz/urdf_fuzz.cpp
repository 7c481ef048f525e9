// Any bytes are one Error with a place, or a valid model that can be written and read again.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <string>
#include <string_view>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"

namespace {

void require(bool condition, const char* what) {
  if (condition) return;
  std::cerr << what << '\n';
  std::abort();
}

void check(const cotwin::robot::RobotModel& robot, bool is_physical) {
  require(robot.bodies.size() == robot.joints.size() + robot.mimics.size(), "a body for each joint");
  std::vector<int> before;
  for (const int i : robot.depth_first()) {
    const auto& joint = robot.joint_of(i);
    const auto& inertia = robot.bodies[static_cast<std::size_t>(i)].inertia;
    require(joint.parent == -1 || std::count(before.begin(), before.end(), joint.parent) == 1, "parents come first");
    require(robot.leader_of(i) >= 0 && robot.leader_of(i) < robot.n(), "mimics have leaders");
    before.push_back(i);
    require(std::abs(joint.axis.norm() - 1) < 1e-12, "axes are unit vectors");
    require(joint.X_PJ.p.allFinite() && joint.X_PJ.R.isUnitary(1e-6), "joint frames are poses");
    require(joint.q_min <= joint.q_max && joint.dq_max > 0 && joint.tau_max > 0, "limits are ranges");
    require(inertia.p_LC.allFinite() && inertia.I_CC.allFinite(), "inertias are finite");
    require(!is_physical || inertia.mass > 0, "moving bodies have mass");
  }
  for (const auto& frame : robot.frames) require(frame.body >= -1 && frame.body < robot.body_count(), "frames are on bodies");
  robot.end_effector();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin::robot;
  const std::string_view xml(reinterpret_cast<const char*>(data), size);
  for (const std::string_view word : {"error", "estimate", "warn"}) {
    try {
      UrdfOptions options;
      take_unphysical(word, options);
      RobotModel robot = parse_urdf(xml, "fuzz.urdf", options);
      check(robot, word != "warn");
      robot.locked.clear();
      require(parse_urdf(to_urdf(robot), "again.urdf", {Unphysical::kWarn, ""}) == robot, "reads what it wrote");
    } catch (const cotwin::Error& error) {
      require(std::string_view(error.what()).substr(0, 10) == "fuzz.urdf:", error.what());
    }
  }
  return 0;
}
