#pragma once
#include <Eigen/Core>
#include <kdl/chain.hpp>

#include "models/robot/robot_model.h"

namespace cotwin::benchmark {

inline KDL::Vector kdl(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
inline KDL::Frame kdl(const Pose& X) {
  return {KDL::Rotation(X.R(0, 0), X.R(0, 1), X.R(0, 2), X.R(1, 0), X.R(1, 1), X.R(1, 2), X.R(2, 0), X.R(2, 1), X.R(2, 2)),
          kdl(X.p)};
}

/// The same robot as a KDL chain. The frame of a KDL segment is at its tip, where the next joint is at q = 0.
inline KDL::Chain kdl_chain(const robot::RobotModel& robot) {
  KDL::Chain chain;
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    const robot::Joint& joint = robot.joints[i];
    const Inertia& b = robot.bodies[i].inertia;
    const KDL::RotationalInertia I(b.I_CC(0, 0), b.I_CC(1, 1), b.I_CC(2, 2), b.I_CC(0, 1), b.I_CC(0, 2), b.I_CC(1, 2));
    const KDL::Joint turn(joint.name, kdl(joint.X_PJ.p), kdl(joint.X_PJ.R * joint.axis),
                          joint.type == robot::JointType::kPrismatic ? KDL::Joint::TransAxis : KDL::Joint::RotAxis);
    chain.addSegment(KDL::Segment(robot.bodies[i].name, turn, kdl(joint.X_PJ), KDL::RigidBodyInertia(b.mass, kdl(b.p_LC), I)));
  }
  return chain;
}

}  // namespace cotwin::benchmark
