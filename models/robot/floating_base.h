#pragma once
#include <Eigen/Core>

#include "models/robot/dynamics.h"

/// Dynamics in reduced coordinates of a robot whose base floats freely, for example on a satellite (V-C). With the twist
/// V_B = (v; ω) of the base's origin, the robot's momentum about that origin is
///   h = I_c V_B + F q̇
/// and its motion
///   [ I_c  F ] [ A_B − (g; 0) ]   [ b_B ]   [ W ]
///   [ Fᵀ   M ] [ q̈            ] + [ b_q ] = [ τ ]
/// with the wrench W that acts on the base from outside and τ of the joints (external forces on links: in τ by Jᵀ F and in W).
/// Eliminating the base gives
///   V_B = A q̇ + I_c⁻¹ h,  A = −I_c⁻¹ F              M* q̈ + b* = τ,  M* = M + Fᵀ A,  b* = b_q + Aᵀ (b_B − W)
/// Without momentum ω = Z q̇, Z the last three rows of A. Gravity accelerates all bodies alike and is not in b*. I_c is the
/// inertia of the robot as if its joints were locked.
///
/// All twists and wrenches are in the axes of the base frame B at its origin, linear part first. A_B = (dv/dt; dω/dt) are the
/// accelerations in an inertial frame. Vectors of joints as in dynamics.h. After construction nothing allocates or throws.
///
/// Computed as a robot with six more joints, which move the base: three prismatic ones, then revolute ones about x, y and z,
/// all at zero. There their speeds are V_B, and of their accelerations only the last three differ from A_B.
namespace cotwin::robot {

/// A robot with its base prepared for the kernels.
class FloatingMechanism {
 public:
  /// Throws Error if the base has no physical mass distribution. `isa` as for Mechanism.
  explicit FloatingMechanism(const RobotModel& robot, const char* isa = nullptr);

  int n() const { return mechanism_.n() - 6; }
  /// Replaces the mass distribution by that of `robot`, which must have the same joints.
  void update(const RobotModel& robot);
  /// Joints 0 to 5 move the base, joint i + 6 is the robot's joint i. Without gravity.
  const Mechanism& with_base() const { return mechanism_; }

 private:
  RobotModel robot_;
  Mechanism mechanism_;
};

/// Scratch memory of one thread.
class FloatingData {
 public:
  explicit FloatingData(const FloatingMechanism& mechanism);

  Data data;
  Eigen::VectorXd q, dq, ddq, tau;  // n + 6
  Eigen::MatrixXd M;                // n + 6 square
  Eigen::MatrixXd J;                // 6 x (n + 6)
};

using Matrix6X = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// All that q alone determines.
struct FloatingInertia {
  explicit FloatingInertia(int n);

  double mass = 0;                  // kg
  Eigen::Vector3d p_C;              // centre of mass of the whole robot, m
  Eigen::Matrix3d I_C;              // the locked inertia about it, kg m²
  Eigen::Matrix<double, 6, 6> I_c;  // locked inertia about B's origin
  Matrix6X F;                       // momentum per joint speed with the base at rest (6 x n)
  Matrix6X A;                       // base twist per joint speed without momentum (6 x n)
  Eigen::MatrixXd M, M_star;        // n x n
  Eigen::Matrix3d I_C_inverse;

  /// Angular velocity of the base per joint speed without momentum (3 x n).
  auto Z() const { return A.bottomRows<3>(); }
  /// h about B's origin.
  Wrench momentum(const Twist& V_B, const VectorIn& dq) const;
  /// V_B at the momentum `h` about B's origin.
  Twist base_twist(const Wrench& h, const VectorIn& dq) const;
  /// V_B of the locked robot: I_c⁻¹ h.
  Twist locked_twist(const Wrench& h) const;
  /// Angular velocity of the base at the angular momentum `spin` about the centre of mass, N m s, in B. Linear momentum has no
  /// influence.
  Eigen::Vector3d base_spin(const Eigen::Vector3d& spin, const VectorIn& dq) const;
};

void floating_inertia(const FloatingMechanism&, FloatingData&, const VectorIn& q, FloatingInertia& inertia);

/// J* (6 x n) of Umetani and Yoshida (1989): the frame's twist relative to an inertial frame, expressed in B, is J* q̇ without
/// momentum. `inertia` at q. Also returns the frame's pose in B. J* loses rank at positions that depend on the masses.
Pose generalised_jacobian(const FloatingMechanism&, FloatingData&, const FloatingInertia& inertia, const VectorIn& q,
                          const FrameOnBody& frame, MatrixOut J);

/// τ and the base reaction W, the wrench that must act on the base from outside, for any motion. `gravity` in B, m/s². With
/// V_B = A_B = 0: the load on the foundation of a robot on a fixed base is −W.
void floating_inverse_dynamics(const FloatingMechanism&, FloatingData&, const VectorIn& q, const VectorIn& dq,
                               const VectorIn& ddq, const Twist& V_B, const Twist& A_B, const Eigen::Vector3d& gravity,
                               VectorOut tau, Wrench& W);

/// M* q̈ + b* of a robot with the angular momentum `spin` about its centre of mass (in B, N m s; zero: at rest before it moved
/// its joints) under the wrench W on the base. `inertia` at q. Linear velocity and gravity have no influence.
void reduced_inverse_dynamics(const FloatingMechanism&, FloatingData&, const FloatingInertia& inertia, const VectorIn& q,
                              const VectorIn& dq, const VectorIn& ddq, const Eigen::Vector3d& spin, const Wrench& W,
                              VectorOut tau);
/// C* = (A; 1)ᵀ C (A; 1) of the robot with its base's joints, for which C* q̇ = b* without spin and W, and Ṁ* − 2 C* is
/// skew-symmetric without spin.
void reduced_coriolis_matrix(const FloatingMechanism&, FloatingData&, const FloatingInertia& inertia, const VectorIn& q,
                             const VectorIn& dq, const Eigen::Vector3d& spin, MatrixOut C);

/// A_B − (g; 0) in the motion with these q̈. Linear velocity has no influence.
Twist base_acceleration(const FloatingMechanism&, FloatingData&, const FloatingInertia& inertia, const VectorIn& q,
                        const VectorIn& dq, const VectorIn& ddq, const Eigen::Vector3d& spin, const Wrench& W);

}  // namespace cotwin::robot
