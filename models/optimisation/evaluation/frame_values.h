#pragma once
#include <Eigen/Core>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "models/numerics/second_order.h"
#include "models/optimisation/evaluation/compliance.h"
#include "models/robot/body_parts.h"
#include "models/robot/frame_kinematics.h"
#include "models/robot/indices.h"

namespace cotwin::optimisation {

/// A frame that may hit persons, for the costs kMass and kSafety.
struct ContactFrame {
  robot::FrameOnBody frame;
  std::optional<Eigen::Vector3d> u;    // direction of length 1 in the axes of the base; none: along the velocity of the frame
  std::vector<double> B;               // inertias of the motors that count, n; empty: none
  std::vector<robot::BodyPart> parts;  // of kSafety
  bool transient = true;               // contact that the person can leave; false: clamping
  double area = 0;                     // m², of the contact; 0: the pressure is not considered
  double load = 0;                     // kg, at the frame
  double least_mass = 0;               // kg, that counts at least for kSafety: robot::simple_effective_mass(); 0: m_u alone
};

/// A frame that an admittance lets deviate from the motion, independently along each axis:
///   (M + m) Δ̈ + D Δ̇ + S Δ = −m a(t)
/// with the load's mass m and the frame's acceleration a along the axis. The load's weight is compensated.
struct CompliantFrame {
  struct Axis {
    Eigen::Vector3d u = Eigen::Vector3d::UnitX();  // of length 1, in the axes of the base
    ComplianceValues least, most;                  // 0 < least ≤ most; equal: fixed
  };
  robot::Frame frame;
  std::vector<Axis> axes;
  double load = 0;                                                  // m, kg; > 0
  double settled = 0;                                               // |Δ| that counts as settled, m; > 0
  double deflection_max = std::numeric_limits<double>::infinity();  // bound of |Δ|, m
  double zeta_min = 0;                                              // least damping ratio D/(2 √((M + m) S))
  double omega_max = std::numeric_limits<double>::infinity();       // largest natural frequency √(S/(M + m)), rad/s
  double T_process = 0;                                             // s, after the frame has settled
};

/// What an axis of a compliant frame does in a motion.
struct AxisResponse {
  double settle = 0;      // time after the motion's end from which on |Δ| remains settled, s
  double deflection = 0;  // largest |Δ|, m
};

/// Time from which on |x| of the free mass–damper–spring (M, D, S > 0) remains within `band` > 0, s; 0: from the beginning.
double settled_after(const numerics::SecondOrder& system, const numerics::Deviation& start, double band);

/// Damping ratio and natural frequency, rad/s, with the load.
double damping_ratio(const ComplianceValues& values, double load);
double natural_frequency(const ComplianceValues& values, double load);

/// Responses of a compliant frame to one motion. Owns scratch memory: one per thread.
class CompliantMotion {
 public:
  CompliantMotion(const robot::RobotModel& robot, const CompliantFrame& frame);

  /// States at `count` ≥ 2 equidistant times from 0 to T s: joint j in state i at [j · count + i]. Between them the acceleration of the
  /// frame counts as linear.
  void set(std::size_t count, double T, const double* q, const double* dq, const double* ddq);
  AxisResponse respond(std::size_t axis, const ComplianceValues& values) const;
  /// By how much the conditions are violated, relative, sum over the axes; 0: met. `responses`: of these values.
  double violation(std::span<const ComplianceValues> values, std::span<const AxisResponse> responses) const;

 private:
  CompliantFrame frame_;
  robot::FrameKinematics kinematics_;
  Eigen::VectorXd q_, dq_, ddq_;
  std::size_t count_ = 0;
  double step_ = 0;
  std::vector<double> acceleration_;  // of axis a in state i at [a · count + i]
};

/// Masses and speeds of a contact frame in one motion. Owns scratch memory: one per thread.
class ContactMotion {
 public:
  ContactMotion(const robot::RobotModel& robot, const ContactFrame& frame);

  /// The largest effective mass, kg, and the largest speed over its limit, 1. +∞ where the joints cannot move the frame along the
  /// direction.
  struct Largest {
    double mass = 0, share = 0;
  };
  /// Of `count` states: joint j in state i at [j · count + i]. `norm` 0: the maxima; p: (mean of xᵖ)^(1/p), which is smooth.
  Largest largest(std::size_t count, const double* q, const double* dq, const double* ddq, double norm);

 private:
  ContactFrame frame_;
  robot::Mechanism mechanism_;
  robot::Data data_;
  Eigen::VectorXd B_;
  robot::FrameInertia inertia_;
  Eigen::VectorXd q_, dq_, ddq_;
  std::vector<double> mass_, share_;
};

}  // namespace cotwin::optimisation
