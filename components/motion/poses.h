#pragma once
#include <Eigen/Core>
#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/unit/settings.h"
#include "components/unit/variables.h"
#include "models/robot/frame_kinematics.h"
#include "models/robot/inverse_kinematics.h"
#include "models/trajectory/joint_path.h"
#include "models/trajectory/pose_path.h"

/// Poses of the desired motion in the world W: their source, their outputs, and forward kinematics.
namespace cotwin::motion {

/// Cartesian waypoints from parameters or a file.
class PoseSource {
 public:
  explicit PoseSource(Settings& settings);
  void declare(Variables& v);
  /// The motion through the waypoints. `start`: another pose for the first waypoint, or nullptr; `relative`: the other waypoints
  /// and the arcs are given in the frame at the start.
  trajectory::PosePath path(const trajectory::PoseMotion* start, bool relative) const;
  trajectory::PoseLimits limits() const;

 private:
  trajectory::PoseWaypoints points() const;

  Settings settings_;
  std::string file_, passing_ = "rest";
  double blend_ = 0.1;
  std::vector<double> t_, p_, quat_, dwell_, point_, axis_, angle_, speed_, turn_speed_;
  std::vector<std::string> shape_;
  std::array<double, 6> limits_{};  // v_max, dv_max, ddv_max, w_max, dw_max, ddw_max; 0: none
};

/// The outputs p_d, quat_d, v_d, w_d, dv_d, dw_d.
class PoseOutputs {
 public:
  void declare(Variables& v, const std::string& frame);
  /// Quantities by the chain rule at the phase's rates; `sign` of the quaternion.
  void set(const trajectory::PoseMotion& m, const trajectory::Phase::Value& s, double sign);
  void set(const robot::FrameMotion& m, const Eigen::Vector3d& p_WB, const Eigen::Quaterniond& Q_WB, double sign);

 private:
  std::array<double, 3> p_{}, v_{}, w_{}, dv_{}, dw_{};
  std::array<double, 4> quat_{1, 0, 0, 0};
};

/// The frame that the setting `frame` names; empty: the end-effector. Throws Error with the closest name.
const robot::Frame& frame_of(Settings& settings, const robot::RobotModel& robot);

/// A frame of the robot whose base stands in W.
class RobotInWorld {
 public:
  RobotInWorld(Settings& settings, const robot::RobotModel& robot);
  void declare(Variables& v);
  /// Checks and reads the pose of the base.
  void initialise();

  const std::string& frame() const { return frame_; }
  robot::FrameKinematics& kinematics() { return kinematics_; }
  const Eigen::Vector3d& p_WB() const { return p_WB_; }
  const Eigen::Quaterniond& Q_WB() const { return Q_WB_; }

 private:
  std::string frame_;
  robot::FrameKinematics kinematics_;
  std::array<double, 3> base_p0_{};
  std::array<double, 4> base_quat0_{1, 0, 0, 0};
  Eigen::Vector3d p_WB_ = Eigen::Vector3d::Zero();
  Eigen::Quaterniond Q_WB_ = Eigen::Quaterniond::Identity();
};

/// The settings and parameters of inverse kinematics, and the joint motion along a path of poses.
class JointsOfPoses {
 public:
  static void declare_settings(SettingList& s);
  JointsOfPoses(Settings& settings, const robot::RobotModel& robot);
  void declare_outputs(Variables& v);
  /// `by_start`: the posture at the start is given and determines the value of the choice.
  void declare_parameters(Variables& v, bool by_start);

  /// Computes the motion; `from_start`: it begins in the posture q_start, else in the solution closest to the choice.
  void prepare(const trajectory::PosePath& poses, const RobotInWorld& robot, std::span<const double> q_start, bool from_start,
               std::string& warning);
  const trajectory::Path& table() const { return path_->table(); }
  void at(double t, std::span<double> q, std::span<double> dq, std::span<double> ddq);

 private:
  std::unique_ptr<robot::InverseKinematics> kinematics_;
  std::optional<trajectory::JointPath> path_;
  bool prismatic_ = false;  // the joint of the choice
  double value_ = 0, sigma_min_ = 0, inverse_error_ = 0;
};

}  // namespace cotwin::motion
