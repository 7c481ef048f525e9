#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <string>

#include "models/robot/frame_kinematics.h"
#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// Directions in which a frame E has to reach its pose: x, y, z (position), rx, ry, rz (rotation), of the base or of E. A robot
/// with fewer joints than six gets those that it can render; rx, ry of E alone point its z axis and leave the turn about it free.
struct TaskDirections {
  std::array<bool, 6> used{true, true, true, true, true, true};
  bool of_tool = false;

  int count() const;
};
/// Reads "x,y,z,rx,ry,rz", a part of it, or "all". Throws Error with the allowed names.
TaskDirections task_directions(const std::string& names, bool of_tool = false);

/// Which of the postures that reach a pose is chosen.
struct PostureChoice {
  enum class Kind {
    kReference,  // closest to the reference posture, |q − q_0|², rad and m
    kCentre,     // closest to the middle of the joint limits, in units of half the range; unlimited joints: to 0, in π
    kJoint,      // with joint `joint` at `value`
    kArmAngle    // with the arm angle `value` of arm_angle()
  };
  Kind kind = Kind::kReference;
  int joint = 0;
  double value = 0;  // rad or m
};

/// The pose that E has to reach, in the base.
struct PoseTarget {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();            // m
  Eigen::Quaterniond Q = Eigen::Quaterniond::Identity();  // of R_BE, of any sign
};

/// Result of InverseKinematics::solve.
struct Posture {
  bool reached = false;
  Eigen::VectorXd q;        // the best posture that was found, rad or m
  double distance = 0;      // that is left in the used directions, m
  double angle = 0;         // likewise, rad
  double choice_error = 0;  // of kJoint and kArmAngle, rad or m
  int starts = 0;           // postures from which the search began
  int solutions = 0;        // of them, those that ended at the pose
  std::string message;      // if not reached: what is left and which joint limits bind
};

/// Inverse kinematics of any robot: Levenberg–Marquardt steps on the pose error within the joint limits, from several starts
/// (the reference posture, the middle of the limits, then a fixed sequence of random postures), and among the solutions the
/// posture by PostureChoice, improved along its self-motion.
class InverseKinematics {
 public:
  /// Throws Error for directions that are empty, a joint that does not exist, or an arm angle of a robot that is not a chain of
  /// seven revolute joints.
  InverseKinematics(const RobotModel& robot, const Frame& frame, const TaskDirections& task = {},
                    const PostureChoice& choice = {});

  int n() const { return n_; }
  /// Task directions without the row of kJoint or kArmAngle.
  int rows() const { return rows_; }
  const TaskDirections& task() const { return task_; }
  FrameKinematics& kinematics() { return kinematics_; }
  const PostureChoice& choice() const { return choice_; }
  void set_value(double value) { choice_.value = value; }
  /// The value of kJoint or kArmAngle that a posture has.
  double value_of(const VectorIn& q);

  /// Error of the pose at q in the used directions, and J_e with ė = −J_e q̇ for a target at rest. The rotation is twice the
  /// vector part of the error's quaternion: bilinear, and zero with the angle. Returns the pose at q; twist() is then that of q.
  /// Allocates nothing. e: rows, J: rows × n.
  FrameMotion linearise(const PoseTarget& target, const VectorIn& q, VectorOut e, MatrixOut J);
  /// J q̇ with all six rows of the Jacobian of the last linearise().
  Twist twist(const VectorIn& dq) const { return J_.lazyProduct(dq); }
  /// The largest position error, m, and angle, rad, in the used directions.
  std::array<double, 2> error(const PoseTarget& target, const VectorIn& q);

  /// The whole search within the joint limits. `reference`: q_0 of kReference, and the first start. `starts`: if fewer are given,
  /// more are used until there is a solution, up to 128. The preferred posture can be missed, because there may be eight branches
  /// of solutions with several minima each: of 200 random poses of the LWR 4+, 128 starts missed it for none (against 400 starts),
  /// 64 for 7, 16 for 48.
  Posture solve(const PoseTarget& target, const VectorIn& reference, int starts = 128);
  /// The posture by the choice in the neighbourhood of q, without regard to joint limits, so that it moves smoothly with the
  /// target. Returns whether it was found; q is the best posture.
  bool track(const PoseTarget& target, const VectorIn& reference, Eigen::VectorXd& q);

 private:
  struct Residual {
    Eigen::VectorXd e;  // rows and the row of the choice, rotations and the choice in units of kLength
    Eigen::MatrixXd J;
    double distance = 0, angle = 0, choice = 0;
    bool within(double tolerance) const { return distance <= tolerance && angle <= tolerance && choice <= tolerance; }
  };
  Residual residual(const PoseTarget& target, const VectorIn& q);
  Residual search(const PoseTarget& target, Eigen::VectorXd& q);
  void improve(const PoseTarget& target, const VectorIn& reference, Eigen::VectorXd& q);
  void unwind(const VectorIn& reference, Eigen::VectorXd& q) const;
  Eigen::VectorXd desired(const VectorIn& reference) const;
  double preference(const VectorIn& reference, const VectorIn& q) const;
  Eigen::VectorXd draw(int start) const;
  std::string shortfall(const Residual& r, const VectorIn& q) const;

  RobotModel robot_;
  std::string frame_;
  TaskDirections task_;
  PostureChoice choice_;
  int n_, rows_;
  FrameKinematics kinematics_;
  Mechanism mechanism_;
  Data data_;
  Eigen::VectorXd q_min_, q_max_, weight_;
  Eigen::MatrixXd J_;  // 6 × n
};

/// Arm angle of a chain of seven revolute joints: the angle of the plane through shoulder, elbow and wrist (the origins of the
/// bodies 2, 4, 6) about the line from shoulder to wrist; 0 where the elbow is on the side of the base's z axis. Not defined if
/// the arm is stretched, or the line vertical.
double arm_angle(const Eigen::Vector3d& shoulder, const Eigen::Vector3d& elbow, const Eigen::Vector3d& wrist);

}  // namespace cotwin::robot
