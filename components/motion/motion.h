#pragma once
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/motion/override.h"
#include "components/motion/poses.h"
#include "components/motion/sources.h"
#include "components/motion/timing.h"
#include "components/unit/joint_variables.h"
#include "components/unit/unit.h"
#include "models/trajectory/axes.h"

namespace cotwin::motion {

/// The desired motion, prepared at initialisation and then a function of time alone. Of the joints:
///   q_d = q(s(t)),   q̇_d = q′ ṡ,   q̈_d = q″ ṡ² + q′ s̈
/// with a path q of polynomials (trajectory.h) and the phase s (time_scaling.h: stretching, soft start and stop). Of a frame
/// (space = cartesian): the same with a path of poses (pose_path.h), with inverse = true also of the joints that follow it
/// (joint_path.h). The motion rests before t_start; after the end it rests,
/// repeats or runs back and forth. Limits are checked, or met by stretching. With pose = true the pose that belongs to the joint
/// motion is an output, too. With override = true an input slows it (override.h); then it depends on what was before.
class Motion final : public Unit {
 public:
  /// Declares the settings of the unit.
  static void declare_settings(SettingList& s);
  explicit Motion(Settings& settings);

  void declare(Variables& v) override;
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;

 private:
  Motion(Settings& settings, bool cartesian);
  void read_robot(Settings& settings, const std::string& reason);
  void prepare_poses();
  void prepare_phase();
  std::vector<trajectory::Axis> limited_axes() const;
  double stretch_needed() const;
  std::string violation() const;
  void check_ends();
  void check_pose_ends() const;
  void evaluate(const trajectory::Phase::Value& s, std::span<double> q, std::span<double> dq, std::span<double> ddq);
  void evaluate_at(double t);
  Override::Range allowed(double t, double rate);

  std::vector<trajectory::Axis> axes_;  // empty if there are no joints among the outputs
  JointMeasures measures_{nullptr};
  std::optional<AnySource> source_;    // of a joint motion
  std::optional<PoseSource> poses_;    // of a Cartesian motion
  std::optional<RobotInWorld> robot_;  // for the relation between joints and poses
  std::optional<JointsOfPoses> inverse_;
  std::string frame_ = "the frame";
  bool from_start_ = false, relative_ = false;

  std::optional<Override> override_;

  // Parameters.
  Timing timing_;
  std::vector<double> dq_limit_, ddq_limit_, dddq_limit_;  // 0: the robot's limit, or none
  std::vector<double> q_start_;

  // Computed from the parameters.
  trajectory::Path path_;
  std::vector<double> ddq_most_;  // of each joint; infinite: no limit
  trajectory::PosePath pose_path_;
  trajectory::PosePeaks pose_peaks_;
  double sign_ = 1;         // of quat_d from forward kinematics
  double closed_sign_ = 1;  // of quat_d at the end relative to the start

  // Outputs.
  std::vector<double> q_d_, dq_d_, ddq_d_;
  PoseOutputs pose_d_;
  std::string warning_;
};

}  // namespace cotwin::motion
