#pragma once
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "models/energetics/books.h"
#include "models/optimisation/evaluation/frame_values.h"
#include "models/optimisation/evaluation/motion_basis.h"
#include "models/robot/changes/loads.h"
#include "models/robot/robot_model.h"

/// Optimisation of point-to-point motions (V-B): polynomials of degree 5 to 31 whose redundant coefficients c_r, duration and
/// end posture minimise a cost within bounds.
///   problem.h     the motion to be found: ends, bounds, costs
///   evaluation.h  costs and violated bounds of eight motions at once
///   ../search.h   particle swarm, lexicographic order of costs, Pareto front
namespace cotwin::optimisation {

/// Bounds of joints, n each; +∞: none.
struct Bounds {
  std::vector<double> q_min, q_max;  // rad or m
  std::vector<double> dq;            // rad/s
  std::vector<double> ddq;           // rad/s²
  std::vector<double> dddq;          // rad/s³
  std::vector<double> tau;           // N m, of the motors behind the gears
};
/// Those of the URDF: position, speed and torque.
Bounds bounds_of(const robot::RobotModel& robot, const Bounds& own = {});

/// What the motors add to the torques of rigid bodies, n each or empty: τ_m = τ + B q̈ + σ2 q̇ + τ_C sat(q̇/v_0) + τ_0
/// (models/robot/drives/rigid_friction.h).
struct DriveTerms {
  std::vector<double> B, sigma2, tau_C, tau_0;
};

/// The sum of these terms of one joint, N m.
double drive_torque(const DriveTerms& drives, std::size_t joint, double dq, double ddq);

/// A cost of the motion, each an integral over its time or a maximum.
enum class Quantity {
  kTime,          // T, s
  kTorque,        // ∫ Σ τ_m² dt, N² m² s
  kWork,          // ∫ Σ max(τ_m q̇, 0) dt, J: no joint returns energy
  kSharedWork,    // ∫ max(Σ τ_m q̇, 0) dt, J: joints exchange energy, nothing is stored
  kPower,         // ∫ P dt, J, with the function `power` of the cost term
  kAcceleration,  // ∫ Σ q̈² dt, exact
  kJerk,          // ∫ Σ (d³q/dt³)² dt, exact
  kEnergy,        // drawn from the mains, J, with Problem::electrical
  kMass,          // largest effective mass along the motion, kg, with Problem::contact
  kSafety,        // largest speed over what the body parts permit, 1, with Problem::contact
  kCycle,         // motion, settling of the compliant frame and process, s, with Problem::compliant
  kStiffness      // Σ S of the compliant frame, N/m, with Problem::compliant
};
/// "time", "torque", "work", "shared_work", "power", "acceleration", "jerk", "energy", "effective_mass", "safety", "cycle_time",
/// "stiffness"
const char* to_text(Quantity quantity);
/// Whether the quantity depends on torques.
bool needs_torques(Quantity quantity);

/// Electrical or other power in `states` states, W: τ_m and q̇ of joint j in state i at [j · states + i]. Called from several
/// threads.
using Power = std::function<void(std::size_t states, const double* tau, const double* dq, double* power)>;

struct CostTerm {
  Quantity quantity = Quantity::kTorque;
  double weight = 1;
  Power power = {};
};

/// Drives, DC link and stand-by (models/energetics, energy.ssv). The servo is on during the motion. What the capacitor of a shared
/// link holds at the end is not credited.
struct Electrical {
  energetics::DriveLosses losses;
  energetics::Current current = energetics::Current::kDc;
  energetics::Bus bus = energetics::Bus::kShared;
  energetics::DcLink link;
  energetics::Supply supply;
  energetics::Standby standby;
  double V = 0;  // of the link at the beginning, V; 0: V_min
};

struct Problem {
  robot::RobotModel robot;
  Ends ends;
  /// Postures that reach the goal, in an order in which neighbours are close (self-motion): the end of the motion lies on the
  /// broken line through them. Empty: the motion ends at ends.q_to.
  std::vector<std::vector<double>> end_postures;
  double T_min = 1, T_max = 1;  // s; equal: T is fixed
  int degree = 9;
  Bounds bounds;
  DriveTerms drives;
  robot::Loads loads;
  std::vector<CostTerm> costs;
  std::size_t samples = 200;                // of the torques, rounded up to a multiple of 8
  double torque_margin = 0.005;             // share of the torque bounds that is kept free at the samples
  std::optional<Electrical> electrical;     // of the cost kEnergy
  std::optional<ContactFrame> contact;      // of the costs kMass and kSafety
  std::optional<CompliantFrame> compliant;  // of the costs kCycle and kStiffness; its parameters are variables
  double smooth_maxima = 0;  // 0: kMass and kSafety are maxima; p: (mean of xᵖ)^(1/p) of them, for methods with derivatives
};

/// Whether the cost depends on the parameters of the compliant frame.
bool needs_compliance(Quantity quantity);

/// Throws Error for sizes that do not fit, numbers out of range, bounds that exclude the ends, and duplicate or missing costs.
void check(const Problem& problem);

}  // namespace cotwin::optimisation
