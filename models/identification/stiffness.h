#pragma once
#include <Eigen/Core>

namespace cotwin::identification {

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
