#pragma once
#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "master/workflows/starter/sketch.h"
#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"

namespace cotwin::master::starter {

/// The frame at which a tool is mounted: the end-effector (RobotModel::end_effector), or where this is a finger, the palm or flange. A
/// finger is a branch of at most five joints on a body that carries several and is itself moved by at least three joints.
const robot::Frame& flange(const robot::RobotModel& robot);

/// Where and how a probe at the end-effector presses: one of several possibilities, counted from the most natural one on.
struct Press {
  int posture = 0;    // of those in which the end-effector moves best
  int direction = 0;  // downwards, then those in which it moves best
  double scale = 1;   // of the way
};
inline constexpr int kPressPostures = 3, kPressDirections = 5;
inline constexpr double kPressScales[] = {1, 0.3};

/// A contact in which a probe at a frame of the robot presses against a plate.
class ContactPlanner {
 public:
  /// Throws Error if the frame does not move.
  ContactPlanner(const robot::RobotModel& robot, const robot::Frame& frame);

  const Eigen::VectorXd& posture(const Press& press) const;

  struct Plan {
    Contact contact;
    Eigen::VectorXd end;      // the desired posture in the plate
    std::vector<double> S_a;  // stiffness of the joint admittance; the force is about a tenth of the moving weight
  };
  /// From posture(press). M: mass matrix there with the motors; S_a: proposed stiffness. nullopt for a direction in which the frame does not
  /// move well. Throws Error for a press that the robot cannot make.
  std::optional<Plan> plan(const Press& press, const Eigen::MatrixXd& M, std::vector<double> S_a);

 private:
  Eigen::MatrixXd translation(const Eigen::VectorXd& q, Pose& X_BP);  // of the probe's centre, 3 x n, in the base frame
  double reach() const;
  void order_postures();
  std::optional<Eigen::Vector3d> direction(const Press& press, const Eigen::MatrixXd& J, const Eigen::Vector3d& p) const;
  Eigen::VectorXd follow(const Eigen::VectorXd& start, const Eigen::Vector3d& u, double way);
  double force_at_rest(const Eigen::VectorXd& end, const Contact& contact, const std::vector<double>& S_a, double start);
  [[noreturn]] void fail(const std::string& why) const;

  const robot::RobotModel& robot_;
  const robot::Frame frame_;
  robot::Mechanism mechanism_;
  robot::Data data_;
  robot::FrameOnBody probe_;
  Eigen::Vector3d p_FA_ = Eigen::Vector3d::Zero();  // where the probe is mounted: beside the axis if the frame is on it
  double size_ = 0;                                 // of the robot, m
  std::vector<Eigen::VectorXd> postures_;
};

/// Near zero and away from the limits.
Eigen::VectorXd rest_posture(const robot::RobotModel& robot);
/// `q` at least the share `margin` of the range away from both limits.
double within(const robot::Joint& joint, double q, double margin);

}  // namespace cotwin::master::starter
