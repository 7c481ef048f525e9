#pragma once
#include <functional>
#include <string>
#include <vector>

#include "components/services/robots.h"
#include "components/services/services.h"

namespace cotwin::services {

/// Result of a co-simulation of a planned move by the twin with elastic joints and friction.
struct Verification {
  bool feasible = false;     // the plan is feasible, and the run kept torque, speed, position and tracking error within bounds
  std::string reason;        // of the plan, else the first bound that the run did not meet; empty if feasible
  double T = 0, settle = 0;  // s, of the move, and of the rest after it that was also simulated
  std::vector<double> tracking;   // largest |q − q_d| of each joint, rad or m
  std::vector<double> end_error;  // |q − q_d| at the end of the rest
  std::vector<double> tau, tau_limit,
      tau_rigid;  // largest |τ| asked of the motors: of the run, its bound (+∞: none), of the rigid prediction; N m or N
  std::vector<double> tau_cut;        // the part of it that exceeds what the motors give
  std::vector<double> dq;             // largest |q̇|
  std::vector<double> q_min, q_max;   // least and largest q
  double work = 0, work_rigid = 0;    // J, positive and negative work of the motors, run and prediction
  double friction = 0;                // J
  bool with_drives = false;           // the robot has data of its drives: drawn is valid
  double drawn = 0, drawn_rigid = 0;  // J from the mains, of the move without the rest
  bool rigid = false;                 // the twin had rigid joints
  std::vector<std::string> notes;     // which drives the twin had, and what its units warned of
};

struct VerificationOptions {
  double settle = 0.3;         // s
  double tracking_max = 0.01;  // rad or m
  bool rigid = false;          // rigid joints without motor inertia and friction, also of a robot that has data of its drives
};

/// Runs a move in the twin. Throws Error.
using Verify = std::function<Verification(const Robot& robot, const Move& move, double T, const VerificationOptions& options)>;

}  // namespace cotwin::services
