#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// Motion of a frame E in the base B: pose, twist (linear first) and its derivative.
struct FrameMotion {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();            // m
  Eigen::Quaterniond Q = Eigen::Quaterniond::Identity();  // of R_BE
  Twist V = Twist::Zero(), dV = Twist::Zero();            // m/s, rad/s; m/s², rad/s²
};

/// Forward kinematics of one frame with V = J q̇ and V̇ = J q̈ + J̇ q̇. The quaternion is the product of those of the joints on
/// the way to the frame, cos and sin of half their angles, so it is a continuous function of q without a choice of sign.
class FrameKinematics {
 public:
  FrameKinematics(const RobotModel& robot, const Frame& frame);

  int n() const { return mechanism_.n(); }
  /// Allocates nothing. Spans of n elements.
  FrameMotion at(const VectorIn& q, const VectorIn& dq, const VectorIn& ddq);
  /// The pose, and J (6 × n, linear first) in B.
  FrameMotion jacobian(const VectorIn& q, MatrixOut J);
  /// J̇ q̇.
  Twist bias(const VectorIn& q, const VectorIn& dq);

 private:
  struct Turn {
    Eigen::Quaterniond fixed;
    Eigen::Vector3d axis;  // zero of a prismatic joint
    int joint;             // the independent one
    double rate, offset;
  };
  Eigen::Quaterniond orientation(const VectorIn& q) const;

  Mechanism mechanism_;
  Data data_;
  FrameOnBody frame_;
  std::vector<Turn> turns_;  // from the base to the frame
  Eigen::Quaterniond last_;
  Eigen::MatrixXd J_;  // 6 × n
};

}  // namespace cotwin::robot
