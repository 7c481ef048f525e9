#pragma once
#include <Eigen/Core>

#include "models/identification/torque_data/torque_model.h"
#include "models/numerics/swarm.h"

namespace cotwin::identification {

struct StiffnessOptions {
  double K_min = 1e2, K_max = 1e8;  // N.m/rad; a joint at K_max is rigid within the accuracy of the data
  int refinements = 2;              // number of times that the joint torques are recomputed from the identified model
  numerics::SwarmOptions swarm{.particles = 24, .rounds = 40};
};

struct StiffnessResult {
  Eigen::VectorXd K;                // n, N.m/rad
  Eigen::VectorXd rms, rigid_rms;   // n, N.m: of the floor with these stiffnesses, and with rigid joints
  double cost = 0, rigid_cost = 0;  // 1/n Σ rms² / σ², with σ of the rigid floor (so that rigid_cost is about 1)
  Samples samples;                  // with the links' motion q = θ − τ_J/K, for TorqueData; dtheta, ddtheta are the motors'
};

/// Joint stiffness from motor positions and torques alone, for robots without encoders behind the gears. In `motors`, q, dq and
/// ddq are the angles θ of the motors behind the gears and their derivatives, tau is the torque of the motors, and t is
/// regular. By (2b), (2c)
///   q = θ − τ_J / K,      τ_J = Y(q, q̇, q̈) π
/// so K changes the motion of the links. A swarm searches ln K; for each candidate all linear parameters are solved for by
/// unconstrained least squares on the samples. τ_J and its derivatives come from the bodies of the last identified model (at
/// first the rigid one), because derivatives of measured torques are dominated by noise.
/// Where θ and q were both measured, K is the slope of τ_J over θ − q: see TorsionFit.
StiffnessResult search_stiffness(const robot::RobotModel& robot, const Samples& motors, const ModelOptions& model = {},
                                 const StiffnessOptions& options = {}, numerics::Threads* threads = nullptr);

/// The joint parameters from motor and link positions measured together: least squares of
///   θ − q = τ_J / K + δ q̇ + c
/// with the joint torque τ_J, N.m, and the speed q̇ of the link, rad/s. δ is the delay of the record of q behind that of θ:
/// encoders behind the gears are often read by another device. A delay of a few milliseconds has a larger effect than the
/// torsion of gears, so δ must be estimated with K.
struct Torsion {
  double K = 0;            // N.m/rad; 0 if not determined: see TorsionFit::solve
  double deviation = 0;    // standard deviation of K
  double correlation = 0;  // partial correlation of torque and torsion at equal speed; near 1 for an elastic joint
  double lag = 0;          // s, δ
  double offset = 0;       // rad, c
};

/// The fit, sample by sample, in constant memory.
class TorsionFit {
 public:
  /// `torsion`: θ − q, rad.
  void add(double tau_J, double dq, double torsion);
  /// `independent`: number of independent samples (fewer than all behind a low-pass). K is 0 if its standard deviation is above
  /// 0.3 K, or if the torque explains less than half of the variance of the torsion that delay and offset leave: then play,
  /// hysteresis and misalignment dominate, which the standard deviation does not include.
  Torsion solve(double independent) const;

 private:
  double count_ = 0;
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();  // the first sample, subtracted from all
  Eigen::Vector3d sum_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d products_ = Eigen::Matrix3d::Zero();
};

}  // namespace cotwin::identification
