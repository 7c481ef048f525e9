#pragma once
#include <Eigen/Core>

#include "models/identification/torque_model.h"
#include "models/numerics/swarm.h"

namespace cotwin::identification {

struct StiffnessOptions {
  double K_min = 1e2, K_max = 1e8;  // N.m/rad; a joint found at K_max is as stiff as the data can tell
  int refinements = 2;              // how often the joint torques are taken anew from the model found
  numerics::SwarmOptions swarm{.particles = 24, .rounds = 40};
};

struct StiffnessResult {
  Eigen::VectorXd K;                // n, N.m/rad
  Eigen::VectorXd rms, rigid_rms;   // n, N.m: of the floor with these stiffnesses, and with rigid joints
  double cost = 0, rigid_cost = 0;  // 1/n Σ rms² / σ², with σ of the rigid floor (so that rigid_cost is about 1)
  Samples samples;                  // with the links' motion q = θ − τ_J/K, for TorqueData; dtheta, ddtheta are the motors'
};

/// Joint stiffness from the motors alone: what a robot without encoders behind its gears records. In `motors`, q, dq and ddq
/// are the motors' angles behind the gears θ and their derivatives, tau the motors' torques, and t is regular. By (2b), (2c)
///   q = θ − τ_J / K,      τ_J = Y(q, q̇, q̈) π
/// so that K enters the motion, hence everything: it is searched by a swarm over ln K, and for each candidate all linear
/// parameters are solved inside by unconstrained least squares on the samples. τ_J comes from the bodies of the model found
/// before, the rigid one first, and so do its derivatives, which noise in the torques would drown.
/// Where θ and q were both measured, K is the slope of τ_J over θ − q: see TorsionFit.
StiffnessResult search_stiffness(const robot::RobotModel& robot, const Samples& motors, const ModelOptions& model = {},
                                 const StiffnessOptions& options = {}, numerics::Threads* threads = nullptr);

/// What motor and link positions, measured side by side, tell of a joint: least squares of
///   θ − q = τ_J / K + δ q̇ + c
/// with the torque of the joint τ_J, N.m, and the link's speed q̇, rad/s. δ is by how much the record of q is older than that of
/// θ: encoders behind the gears are often read by another device. A few milliseconds of it are more than gears give, so
/// without δ stiffness hides behind it.
struct Torsion {
  double K = 0;            // N.m/rad; 0 where it is not found: see TorsionFit::solve
  double deviation = 0;    // standard deviation of K
  double correlation = 0;  // partial: of torque and torsion at equal speed; near 1 if the torsion is one
  double lag = 0;          // s, δ
  double offset = 0;       // rad, c
};

/// The fit, sample by sample, in constant memory.
class TorsionFit {
 public:
  /// `torsion`: θ − q, rad.
  void add(double tau_J, double dq, double torsion);
  /// `independent`: how many of the samples tell anything new (all, or fewer behind a low-pass). K is 0 if its standard
  /// deviation is above 0.3 K, or if the torque explains less than half of the variance that lag and offset leave of the
  /// torsion: then play, hysteresis and misalignment are the greater part, of which the deviation does not know.
  Torsion solve(double independent) const;

 private:
  double count_ = 0;
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();  // the first sample, from which the others are counted
  Eigen::Vector3d sum_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d products_ = Eigen::Matrix3d::Zero();
};

}  // namespace cotwin::identification
