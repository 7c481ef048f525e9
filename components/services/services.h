#pragma once
#include <string>
#include <vector>

#include "models/optimisation/search.h"

/// Services: pure functions (robot, request) → reply. The same request gives the same bits.
///   services.h          feasibility, cycle time, torques, power, jerk, throughput
///   energy_service.h    energy of a motion and its best duration
///   contact_service.h   effective mass and safety of persons along a motion
///   reaction_service.h  what a motion does to a free base
///   ability_service.h   manipulability along a motion, the largest payload
///   robots.h            robots with the data beside their URDF
///   json.h, schemas.h   the same as JSON
namespace cotwin::services {

/// A motion, and what acts on the robot meanwhile: a polynomial of degree 5 and more (models/trajectory/polynomial.h), or a path of any kind.
struct Move {
  std::vector<double> from_q, to_q;    // n, rad or m
  std::vector<double> dq_from, dq_to;  // n, rad/s or m/s; empty: at rest. A move that is not at rest needs T
  std::vector<double> ddq_from, ddq_to;
  double T = 0;  // s; 0: the shortest one within the bounds
  int degree = 5;
  std::vector<double> c;        // n · (degree − 5), joint by joint; empty: zeros
  trajectory::Path path;        // in place of all of these, where it has joints; times in replies are then its own
  optimisation::Bounds bounds;  // empty vectors: those of the robot
  optimisation::DriveTerms drives;
  robot::Loads loads;

  bool is_path() const { return path.joints() > 0; }
  /// Whether the duration is to be found.
  bool searched() const { return T == 0 && !is_path(); }
  /// The conditions at both ends.
  optimisation::Ends ends() const;
};

/// A move with its duration.
struct Plan {
  optimisation::Problem problem;                             // with the costs below
  optimisation::Solution solution;                           // path, T, peaks of the joints, and verdict
  std::vector<std::string> notes;                            // see creeping()
  double torque() const { return solution.costs[0]; }        // ∫ Σ τ² dt, N² m² s
  double work() const { return solution.costs[1]; }          // J, see optimisation::Quantity
  double shared_work() const { return solution.costs[2]; }   // J
  double acceleration() const { return solution.costs[3]; }  // ∫ Σ q̈² dt
  double jerk() const { return solution.costs[4]; }          // ∫ Σ (d³q/dt³)² dt
  bool moves() const;                                        // not a robot that stands still
};
/// With T = 0 the shortest duration is taken; if there is none, kLongest, and the verdict names the bound that no duration meets.
/// Throws Error for a request that does not fit the robot.
Plan plan(const robot::RobotModel& robot, const Move& move);
inline constexpr double kBriefest = 1e-4, kLongest = 1e4;  // s, durations of moves

/// Why the duration of a motion whose duration was searched is more than ten times what the bounds of speed, acceleration and jerk
/// need: gravity and Coulomb friction of a joint take nearly all of its torque. "" if it is not, or for another reason.
std::string creeping(const optimisation::Problem& problem, const optimisation::Solution& motion);

/// The T of a rest-to-rest move of given shape from which on every longer duration meets the bounds, s, to 1e-9; +∞ if there is
/// none. Without friction it is the shortest possible one: the torque at a sample is linear in 1/T².
double shortest_duration(const robot::RobotModel& robot, const Move& move);

/// Torques of a move at equidistant times, n values per sample, row by row, N m or N.
struct Torques {
  std::vector<double> t;                                   // s
  std::vector<double> q, dq, ddq;                          // rad or m, and derivatives
  std::vector<double> inertial, coriolis, gravity, drive;  // M q̈, C q̇, g, and the terms of the motors
  std::vector<double> external;                            // −J_Fᵀ f of the external wrench
  double torque(std::size_t k) const { return inertial[k] + coriolis[k] + gravity[k] + drive[k] + external[k]; }
  std::vector<double> power;                // Σ τ q̇ of each sample, W
  double peak_power = 0, peak_power_t = 0;  // largest Σ τ q̇ at a sample, W, s
};
Torques torques(const robot::RobotModel& robot, const Move& move, std::size_t samples);
/// At the places at which plan() looks for the peaks of torques: 2000 and more, not equidistant.
Torques torques_at_peaks(const robot::RobotModel& robot, const Move& move);

/// Mechanical power of the motors.
struct PeakPower {
  struct Extreme {
    double power = 0, t = 0;  // W, s
  };
  Extreme drawn, returned;              // largest and least Σ τ q̇
  std::vector<Extreme> joint_drawn;     // largest τ q̇ of each joint
  std::vector<Extreme> joint_returned;  // least, negative where a motor brakes
};
/// From 4001 samples, or four per knot of a path, with a parabola through the three about each extreme.
PeakPower peak_power(const robot::RobotModel& robot, const Move& move);

/// Time after which the step response of M ẍ + D ẋ + S x = S x_d remains within `share` of its end, s: from the poles. Throws Error
/// unless M, D, S > 0 and 0 < share < 1.
double settling_time(double M, double D, double S, double share);

/// Time of a cycle and moves per hour under compliance.
struct Throughput {
  double T_move = 0, T_settle = 0, T_process = 0, T_cycle = 0;  // s
  double per_hour = 0;
};
Throughput throughput(double T_move, double T_settle, double T_process);

}  // namespace cotwin::services
