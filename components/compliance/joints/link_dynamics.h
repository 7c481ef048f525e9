#pragma once
#include <memory>
#include <string>

#include "models/robot/body_parameters.h"
#include "models/robot/dynamics.h"
#include "models/robot/floating_base.h"

namespace cotwin::compliance {

/// (2a) of the links on a fixed base, or M* and b* on one that floats (models/robot/floating_base.h), where gravity is no load.
/// With scratch memory and the inertial parameters in force.
class LinkDynamics {
 public:
  explicit LinkDynamics(const robot::RobotModel& robot, bool floating = false);

  /// Angular momentum of a floating robot about its centre of mass in the base's axes, N m s.
  void set_spin(const Eigen::Vector3d& spin) { spin_ = spin; }
  void inverse_dynamics(const robot::VectorIn& q, const robot::VectorIn& dq, const robot::VectorIn& a, robot::VectorOut tau);
  /// Whether inverse_dynamics() of several states in one call is possible: not with a floating base.
  bool has_batch() const { return !floating_; }
  /// As robot::inverse_dynamics_batch(): one state per row.
  using States = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic>;
  void inverse_dynamics(const States& q, const States& dq, const States& a, States& tau);
  void mass_matrix(const robot::VectorIn& q, robot::MatrixOut M);
  void coriolis_matrix(const robot::VectorIn& q, const robot::VectorIn& dq, robot::MatrixOut C);
  void gravity(const robot::VectorIn& q, robot::VectorOut g);
  /// As those of models/robot/dynamics.h, in the axes of the base.
  Pose forward_kinematics(const robot::VectorIn& q, const robot::FrameOnBody& frame);
  Pose jacobian(const robot::VectorIn& q, const robot::FrameOnBody& frame, robot::MatrixOut J);
  Pose jacobian(const robot::VectorIn& q, const robot::VectorIn& dq, const robot::FrameOnBody& frame, robot::MatrixOut J,
                robot::MatrixOut dJ);
  void jacobian_dot_times_dq(const robot::VectorIn& q, const robot::VectorIn& dq, const robot::FrameOnBody& frame,
                             Eigen::Ref<Twist> a);

  /// The links on a fixed base, for other functions of models/robot.
  const robot::Mechanism& mechanism() const { return mechanism_; }
  robot::Data& data() { return data_; }

  robot::BodyParameters& bodies() { return bodies_; }
  /// As those of BodyParameters.
  void update_bodies(const std::string& place);
  void follow_bodies(const std::string& place, double remaining);
  void restored_bodies();

 private:
  struct Floating {
    explicit Floating(const robot::RobotModel& robot) : mechanism(robot), data(mechanism), inertia(robot.n()) {}
    robot::FloatingMechanism mechanism;
    robot::FloatingData data;
    robot::FloatingInertia inertia;
  };
  void adopt_bodies();

  robot::Mechanism mechanism_;
  robot::Data data_;
  robot::BodyParameters bodies_;
  std::unique_ptr<Floating> floating_;
  Eigen::Vector3d spin_ = Eigen::Vector3d::Zero();
};

}  // namespace cotwin::compliance
