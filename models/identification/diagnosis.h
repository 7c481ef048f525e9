#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <deque>
#include <vector>

#include "models/identification/torque_data/torque_model.h"

namespace cotwin::identification {

/// What makes a log fit better to the robot's kinematics than the log as it stands.
struct Finding {
  enum class Kind {
    kGravity,  // another direction of gravity in the base: `gravity`
    kClock,    // time that runs `value` times as fast as its column
    kLag,      // torques of `joints` that come `value` s after the motion
    kTorques,  // the torque columns of the two `joints` exchanged
    kJoints,   // positions and torques of the two `joints` exchanged
    kSign,     // torques of `joints` of the other sign: friction would drive them
  };
  Kind kind = Kind::kGravity;
  std::vector<int> joints;  // that it concerns; all for gravity and clock
  double value = 0;
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();  // m/s²
  double gain = 1;                                    // RMS error before over after, geometric mean over `joints`
  Eigen::VectorXd before, after;                      // n: RMS errors, N.m (prismatic: N)
};

/// What is taken to be true instead of the log.
struct Hypothesis {
  Eigen::Vector3d gravity;
  double rate = 1;          // of the clock: true speeds over those of the log
  std::vector<int> joint;   // per joint, whose positions it has
  std::vector<int> column;  // whose torques,
  std::vector<int> shift;   // at which of the kept times,
  std::vector<double> sign;
  bool moves_alike(const Hypothesis& other) const {
    return gravity == other.gravity && rate == other.rate && joint == other.joint;
  }
};

struct Diagnosed {
  std::vector<Finding> findings;  // the one that explains most first, each with those before it mended
  Hypothesis truth;               // with all of them
};

/// Looks for damage of a log by least squares over base parameters, friction, offset and motor inertia, without any prior: each
/// joint has its own error variance, which is estimated with the parameters (maximum likelihood by reweighting). Every
/// hypothesis changes the data and is fitted anew; it counts if robots about the URDF that can exist fit better with it, too.
/// What a scale of all torques, a load, other lengths of links or other zero positions would change, no log tells.
class Diagnosis {
 public:
  /// `step`: s between rows.
  Diagnosis(const robot::RobotModel& robot, const ModelOptions& options, double step);

  /// Takes the rows of a log in order; at most kMost of them, evenly spread, are kept. `measured`: whether there is a sample at
  /// this row. dtheta, ddtheta: of the motors; null: those of the links.
  void add(std::size_t segment, bool measured, const double* q, const double* dq, const double* ddq, const double* tau,
           const double* dtheta = nullptr, const double* ddtheta = nullptr);

  /// Nothing for fewer than 100 samples, or 25 a joint.
  Diagnosed findings() const;

  /// Samples in rows of n values: position, speed, acceleration, speed and acceleration of the motor; torques at several times
  /// about that of the motion; friction with hysteresis of kPresliding widths, from -1 to 1 (Dahl). And the time, s.
  struct Kept {
    std::vector<double> q, dq, ddq, v, a, tau, z, t;
  };
  static constexpr std::size_t kPresliding = 4;

 private:
  static constexpr std::size_t kMost = 4000;

  robot::RobotModel robot_;
  ModelOptions options_;
  std::size_t n_;
  double step_;
  std::vector<std::size_t> at_;             // rows of the window at which torques are kept, from the earliest on
  std::deque<std::vector<double>> window_;  // the last rows: n values each of q, q̇, q̈, of the motor, τ, z
  std::deque<char> measured_;
  std::vector<double> z_;
  std::size_t segment_ = 0, rows_ = 0, seen_ = 0, every_ = 1;
  Kept kept_;
};

}  // namespace cotwin::identification
