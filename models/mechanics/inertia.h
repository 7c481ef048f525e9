#pragma once
#include <Eigen/Core>
#include <string>

#include "models/mechanics/pose.h"

namespace cotwin {

/// Mass distribution of a rigid body, given in a frame L of the body.
struct Inertia {
  double mass = 0;                                 // kg
  Eigen::Vector3d p_LC = Eigen::Vector3d::Zero();  // centre of mass in L, m
  Eigen::Matrix3d I_CC = Eigen::Matrix3d::Zero();  // about the centre of mass, expressed in L's axes, kg m²
  static auto fields(auto& b, auto each) { return each(b.mass, b.p_LC, b.I_CC); }

  /// Inertia about L's origin instead of C (Steiner): I_CC + m (p·p U − p pᵀ).
  Eigen::Matrix3d about_origin() const;
  /// [m, m c, Ixx, Ixy, Ixz, Iyy, Iyz, Izz] about L's origin: torques are linear in these parameters.
  Eigen::Matrix<double, 10, 1> parameters() const;
  static Inertia from_parameters(const Eigen::Matrix<double, 10, 1>& pi);

  /// The same body expressed in frame A, with L at X_AL.
  Inertia seen_from(const Pose& X_AL) const;
  /// The composite body of two bodies given in the same frame.
  friend Inertia operator+(const Inertia& a, const Inertia& b);
  friend bool operator==(const Inertia& a, const Inertia& b) {
    return a.mass == b.mass && a.p_LC == b.p_LC && a.I_CC == b.I_CC;
  }

  /// Whether mass and moments are zero.
  bool is_nothing() const { return mass == 0 && I_CC.isZero(0); }
  /// Reason why no rigid body has this mass distribution ("principal moments 0.1, 0.1, 0.3 kg m2 violate the triangle
  /// inequality"), or "" if one has. All zero is not physical. The triangle inequality may be violated by 0.15 % of the largest
  /// moment, because published values are rounded. Of a part of a body with kZero a principal moment may be 0, as those of a point mass.
  enum class Least { kPositive, kZero };
  std::string unphysical(Least least = Least::kPositive) const;
};

}  // namespace cotwin
