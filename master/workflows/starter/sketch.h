#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "models/robot/robot_model.h"

/// `cotwin new`: a first scenario for a robot of which only the URDF is known.
namespace cotwin::master::starter {

enum class Kind { kMotion, kCompliance, kContact };
inline constexpr std::pair<const char*, Kind> kKindWords[] = {
    {"motion", Kind::kMotion}, {"compliance", Kind::kCompliance}, {"contact", Kind::kContact}};

/// Data of the drives per joint, in the units of measure of unit:drive_train.
struct Drives {
  std::vector<double> K, D, B, sigma2, tau_C;  // K = D = 0: rigid transmission
  std::vector<double> k_t;                     // N.m/A of equivalent motors of 1 Ohm; empty: not assumed
  double power = 0;                            // W, of all motors, assumed with k_t
};

struct Waypoint {
  double t = 0;  // arrival, s
  Eigen::VectorXd q;
  double dwell = 0;  // s
};

/// A sphere at the end-effector that presses against a plate.
struct Contact {
  std::string tool;              // name of the probe
  std::string frame;             // of the robot that carries the probe
  Eigen::Vector3d p_FP;          // centre of the probe in that frame, m
  double radius = 0;             // of the probe, m
  Eigen::Vector3d direction;     // in which the probe presses, unit vector in the base frame
  Eigen::Vector3d p_WO, rpy;     // centre and orientation of the plate
  double width = 0, height = 0;  // of the plate, m
  double gap = 0, depth = 0;     // of the probe to the plate at the start; how far the desired motion goes into it, m
  double kp = 0, kd = 0;         // of the plate, N/m and N.s/m
  double force = 0;              // expected at rest, N
};

/// The numbers of the scenario.
struct Sketch {
  Kind kind = Kind::kMotion;
  Drives drives;
  bool assumed = true;           // the drives are assumptions
  bool energy_assumed = false;   // the electrical data, too
  std::vector<double> M_a, S_a;  // joint admittance (3a)
  double zeta_a = 1;
  std::vector<double> push;         // external torque of kCompliance, N.m or N
  std::vector<Waypoint> waypoints;  // at least two
  double stop = 0;                  // s
  std::optional<Contact> contact;
  bool robot_shapes = true;                // the robot's links collide; false: only the probe
  std::vector<std::string> without_limit;  // joints whose effort limit is set aside
  std::vector<std::string> notes;          // sentences for the user
};

class ContactPlanner;
struct Press;

/// Throws Error for a robot without joints, or with passive joints.
void check_robot(const robot::RobotModel& robot);

/// Chooses posture, motion, drives (unless `known`) and compliance so that they suit the robot's inertia, limits and
/// size. The motion keeps to 30 % of the speed limits and to the effort limits. Throws Error for a robot without joints and with
/// passive joints. `kind` is kMotion or kCompliance.
Sketch make_sketch(const robot::RobotModel& robot, Kind kind, const std::optional<Drives>& known);
/// The same with a contact. nullopt for a direction in which the end-effector does not move well. Throws Error also for a press that the
/// robot cannot make.
std::optional<Sketch> make_contact(const robot::RobotModel& robot, ContactPlanner& planner, const Press& press,
                                   const std::optional<Drives>& known);

}  // namespace cotwin::master::starter
