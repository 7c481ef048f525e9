#pragma once
#include <Eigen/Core>
#include <memory>

#include "models/robot/robot_model.h"

namespace cotwin::benchmark {

/// The parameters of Cartesian compliance and tracking in both programs: equal in all directions and joints.
struct ComplianceDesign {
  double M_T = 10, S_T = 1000, M_R = 1, K_o = 100;  // kg, N/m, kg.m², N.m/rad, at the aperiodic limit
  double omega = 30, zeta = 1, shaping = 4, bandwidth = 500;
  double K = 1e4, B = 1;
  double omega_k = 100, k_nu = 4;
  double h = 1e-3;  // s
};

/// Cartesian compliance (3a), (3b) of a frame of a robot with elastic joints and damped self-motion, with the tracking of
/// components/compliance/joints/tracking.h: the law of the unit, written on the kinematics and dynamics of Orocos KDL and Eigen with
/// fixed sizes, without checks, limits and friction. For 7 revolute joints.
class CompliancePeer {
 public:
  virtual ~CompliancePeer() = default;
  /// At rest at `q`, which is the desired pose.
  virtual void start(const Eigen::VectorXd& q) = 0;
  /// A step under the wrench F at E, in the base frame, with measured positions at rest.
  virtual void step(const Eigen::Matrix<double, 6, 1>& F, const Eigen::VectorXd& q, const Eigen::VectorXd& theta) = 0;

  Eigen::Matrix<double, 7, 1> q_c, tau_m;
};

std::unique_ptr<CompliancePeer> make_kdl_compliance(const robot::RobotModel& robot, const ComplianceDesign& design);

}  // namespace cotwin::benchmark
