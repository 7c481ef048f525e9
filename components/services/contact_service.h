#pragma once
#include <Eigen/Core>

#include "components/services/services.h"
#include "models/robot/body_parts.h"
#include "models/robot/indices.h"

namespace cotwin::services {

struct ContactOptions {
  std::string frame;                 // of the URDF; "": the robot's end effector
  std::optional<Eigen::Vector3d> u;  // direction in the axes of the base; none: along the velocity of the frame
  bool motors_held = false;          // false: M, a blow; true: M + B, slower motions (needs the inertias of the motors)
  std::vector<double> B;             // inertias of the motors, n; for motors_held
  std::vector<robot::BodyPart> parts;
  bool transient = true;        // contact that the person can leave; false: clamping
  double area = 0;              // m², of the contact; 0: the pressure is not considered
  double load = 0;              // kg, at the frame, beside the payloads of the move
  bool only_effective = false;  // the verdict is that of the effective mass, not of the larger of both
  std::size_t samples = 401;    // of the series
};

/// A mass is +∞ in a direction in which the joints cannot move the frame.
struct MassAt {
  double t = 0, mass = 0, speed = 0;  // s, kg, m/s along the direction
};

/// Masses and speeds of the frame along a move. The extremes do not depend on `samples`.
struct PathMasses {
  double T = 0;                                    // s
  MassAt lightest, heaviest, fastest, start, end;  // only moving ones count for lightest and heaviest along the motion
  std::vector<double> t, mass, inertia, speed;     // at `samples` equidistant times; s, kg, kg m² about the direction, m/s
};

/// A body part in front of the frame, for one mass of the robot: the limit is least where the mass is largest.
struct MassRisk {
  double mass = 0;                  // kg, there
  double share = 0, t = 0;          // largest |speed| over its limit; > 1: too fast
  double speed = 0, limit = 0;      // m/s, there
  double energy = 0, t_energy = 0;  // largest energy of a collision, J
  double T_safe =
      0;  // s, duration from which on the shape is within the limit; +∞: contact is not permitted, or a move does not begin and end at rest
};

struct PartRisk {
  std::string name;
  MassRisk effective;  // m_u of the frame, with the load
  MassRisk simple;     // M/2 + m_L of ISO/TS 15066, A.3.4
  MassRisk decisive;   // of the larger mass, or of the effective one
};

struct PathSafety {
  bool safe = false;
  double T = 0;  // s
  PathMasses masses;
  std::vector<PartRisk> parts;
};

/// m_u and I_u along a move. Throws Error for an unknown frame, a direction without length, and if no duration meets the bounds.
PathMasses masses_along(const robot::RobotModel& robot, const Move& move, const ContactOptions& options);
/// The same with limits of persons (ISO/TS 15066: F_max/√(μ k_H)). The person is at rest. Not a proof of safety.
PathSafety safety_along(const robot::RobotModel& robot, const Move& move, const ContactOptions& options);

}  // namespace cotwin::services
