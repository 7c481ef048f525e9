#pragma once
#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "models/robot/kernels/kernels.h"
#include "models/robot/robot_model.h"

/// Random robots and states for tests of dynamics: any axes, any frames, physical inertias.
namespace cotwin::robot::testing {

/// The instruction sets of this machine, highest first; on other processors than Intel's, x86-64-v4-intel is not the default.
inline std::vector<const char*> isas() {
  std::vector<const char*> names;
  for (const char* name : {"x86-64-v4-intel", "x86-64-v4", "x86-64-v3", "x86-64-v2"}) {
    const char* isa = choose_kernels(1, true, name).isa;
    if (names.empty() || std::string(names.back()) != isa) names.push_back(isa);
  }
  return names;
}

enum class Kind { kChain, kMixedChain, kTree };

/// Draws that belong to one call are made one after the other: compilers evaluate arguments in different orders.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : engine_(seed) {}

  double number(double low, double high) { return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53; }
  int integer(int low, int high) { return low + static_cast<int>(engine_() % static_cast<std::uint64_t>(high - low + 1)); }
  Eigen::VectorXd numbers(int n, double low, double high) {
    Eigen::VectorXd v(n);
    for (double& x : v) x = number(low, high);
    return v;
  }
  Eigen::Vector3d direction() {
    for (;;) {
      const Eigen::Vector3d v = numbers(3, -1, 1);
      if (v.norm() > 0.1 && v.norm() < 1) return v.normalized();
    }
  }
  /// Any orientation; in one of three cases with right angles only, as robots have.
  Eigen::Matrix3d rotation() {
    if (integer(0, 2) == 0) {
      const double quarter = std::acos(-1.0) / 2;
      const int yaw = integer(-1, 2), pitch = integer(-1, 2), roll = integer(-1, 2);
      return rotation_from_rpy(quarter * roll, quarter * pitch, quarter * yaw);
    }
    const Eigen::Vector3d axis = direction();
    return Eigen::AngleAxisd(number(-3.1, 3.1), axis).toRotationMatrix();
  }
  Pose pose(double reach) { return {rotation(), numbers(3, -reach, reach)}; }
  /// A box whose centre of mass is not at the frame's origin.
  Inertia inertia() {
    Inertia body;
    body.mass = number(0.2, 5);
    body.p_LC = numbers(3, -0.2, 0.2);
    const Eigen::Vector3d size = numbers(3, 0.05, 0.4).cwiseAbs2();
    const Eigen::Matrix3d R = rotation();
    body.I_CC = body.mass / 12 * R * Eigen::Vector3d(size[1] + size[2], size[0] + size[2], size[0] + size[1]).asDiagonal() *
                R.transpose();
    return body;
  }
  RobotModel robot(Kind kind, int n) {
    RobotModel robot;
    robot.name = "random";
    robot.gravity = 9.81 * direction();
    for (int i = 0; i < n; ++i) {
      Joint joint;
      joint.name = "joint_" + std::to_string(i);
      joint.parent = kind == Kind::kTree ? integer(-1, i - 1) : i - 1;
      joint.type = kind != Kind::kChain && integer(0, 3) == 0 ? JointType::kPrismatic : JointType::kRevolute;
      joint.X_PJ = pose(0.4);
      const int axis = integer(0, 5);
      joint.axis = axis < 3 ? direction() : (integer(0, 1) ? 1.0 : -1.0) * Eigen::Vector3d::Unit(axis - 3);
      robot.joints.push_back(joint);
      Body body;
      body.name = "body_" + std::to_string(i);
      body.inertia = inertia();
      robot.bodies.push_back(body);
      robot.frames.push_back({"frame_" + std::to_string(i), i, pose(0.3)});
    }
    return robot;
  }
  /// Other parents, so that the joints are in depth-first order, as from a URDF.
  void order_depth_first(RobotModel& robot) {
    for (int j = 1; j < robot.n(); ++j) {
      int parent = j - 1;
      while (parent >= 0 && integer(0, 3) == 0) parent = robot.joints[static_cast<std::size_t>(parent)].parent;
      robot.joints[static_cast<std::size_t>(j)].parent = parent;
    }
  }

 private:
  std::mt19937_64 engine_;
};

/// A robot, the same robot with its mimics as free joints, and q_all = G q + g_0 between them.
struct MimicPair {
  RobotModel robot, all;
  Eigen::MatrixXd G;
  Eigen::VectorXd g_0;
  std::vector<int> free;  // by body of `robot`: the body of `all`
};

inline MimicPair random_pair(Draw& draw, int joints) {
  MimicPair pair;
  pair.all = draw.robot(Kind::kTree, joints);
  std::vector<int> follows(static_cast<std::size_t>(joints)), index(static_cast<std::size_t>(joints));
  int n = 0;
  for (int i = 0; i < joints; ++i) {
    follows[static_cast<std::size_t>(i)] = i != joints / 2 && draw.integer(0, 1) == 1;
    if (follows[static_cast<std::size_t>(i)] == 0) index[static_cast<std::size_t>(i)] = n++;
  }
  pair.robot = pair.all;
  pair.robot.joints.clear();
  pair.robot.bodies.clear();
  pair.G = Eigen::MatrixXd::Zero(joints, n);
  pair.g_0 = Eigen::VectorXd::Zero(joints);
  for (const int wanted : {0, 1}) {
    for (int i = 0; i < joints; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (follows[k] != wanted) continue;
      pair.free.push_back(i);
      pair.robot.bodies.push_back(pair.all.bodies[k]);
      if (wanted == 0) {
        pair.robot.joints.push_back(pair.all.joints[k]);
        pair.G(i, index[k]) = 1;
      } else {
        Mimic mimic{pair.all.joints[k], draw.integer(0, n - 1), draw.number(-2, 2), draw.number(-1, 1), i};
        index[k] = n + static_cast<int>(pair.robot.mimics.size());
        pair.G(i, mimic.leader) = mimic.multiplier;
        pair.g_0[i] = mimic.offset;
        pair.robot.mimics.push_back(mimic);
      }
    }
  }
  const auto renumber = [&](int& body) {
    if (body >= 0) body = index[static_cast<std::size_t>(body)];
  };
  for (Joint& joint : pair.robot.joints) renumber(joint.parent);
  for (Mimic& mimic : pair.robot.mimics) renumber(mimic.joint.parent);
  for (Frame& frame : pair.robot.frames) renumber(frame.body);
  return pair;
}

}  // namespace cotwin::robot::testing
