#pragma once
#include <Eigen/Core>

#include "models/robot/dynamics.h"
#include "models/robot/floating_base.h"

/// Indices of a robot at a frame F (V-A, V-B, VI-C), at one position:
///   Λ⁻¹ = J M⁻¹ Jᵀ, with the blocks Λ_v⁻¹ = J_v M⁻¹ J_vᵀ and Λ_ω⁻¹ = J_ω M⁻¹ J_ωᵀ
///   effective mass      m_u = 1/(uᵀ Λ_v⁻¹ u)    a force f u at F's origin accelerates it along u by f/m_u
///   effective inertia   I_u = 1/(uᵀ Λ_ω⁻¹ u)    a moment about u, likewise
/// (Khatib 1995: all other motions of F are free.) Directions u are unit vectors in the axes of the base frame B.
///
/// Inertia of the motors: M is that of the links. It acts above the resonance of elastic joints, in a blow. In slower motions
/// the gears hold the motors to the links, and M + B acts. A locked joint (brake) has B = ∞.
///
/// A mass or inertia is +∞ in a direction in which the joints cannot move F (singular position, too few joints), up to
/// rounding; it is 0 where a joint moves F but no mass. No result is NaN for finite q. After construction nothing allocates or
/// throws.
namespace cotwin::robot {

/// All that a position determines at a frame.
struct FrameInertia {
  explicit FrameInertia(int n);

  Pose X_BF;
  Matrix6X J;         // of F in B, linear first (6 x n); 0 in the columns of locked joints
  Eigen::MatrixXd M;  // M or M + B = L D Lᵀ (n x n); rows and columns of locked joints are those of the identity
  Eigen::MatrixXd L;  // unit lower triangular (n x n)
  Eigen::VectorXd D;  // n; 0: the joint moves no mass
  Matrix6X W;         // J L⁻ᵀ (6 x n)
  Matrix6X J_over_M;  // J M⁻¹ (6 x n)
  Eigen::Matrix<double, 6, 6> Lambda_inverse;    // without joints that move no mass
  bool massless = false;                         // some D is 0
  Eigen::Array<bool, Eigen::Dynamic, 1> locked;  // n

  Eigen::MatrixXd C;  // scratch of the gradients
  Eigen::VectorXd x, y;
};

/// `B`: inertia of the motors at the joints (n, kg m² or kg, >= 0; +∞ locks the joint), or empty: the motors are free.
void frame_inertia(const Mechanism&, Data&, const VectorIn& q, const VectorIn& B, const FrameOnBody& frame,
                   FrameInertia& inertia);
/// The same of a robot on a floating base, which recoils. `inertia` is that of n + 6 joints, those of the base first; Λ⁻¹ =
/// J_B I_c⁻¹ J_Bᵀ + J* M*⁻¹ J*ᵀ with J_B = ∂V_F/∂V_B and the generalised Jacobian J*.
void frame_inertia(const FloatingMechanism&, FloatingData&, const VectorIn& q, const VectorIn& B, const FrameOnBody& frame,
                   FrameInertia& inertia);

/// m_u, kg.
double effective_mass(const FrameInertia&, const Eigen::Vector3d& u);
/// The same with a point mass `load` (kg) at F's origin: (Λ_v + load 1)⁻¹ in place of Λ_v⁻¹.
double effective_mass(const FrameInertia&, const Eigen::Vector3d& u, double load);
/// I_u, kg m².
double effective_inertia(const FrameInertia&, const Eigen::Vector3d& u);

/// Whether u keeps its direction in the base or turns with the frame.
enum class Direction { kInBase, kInFrame };
/// ∂m_u/∂q (n, kg per rad or m), analytically; B is constant. `inertia` at q for the same frame. 0 where the mass
/// is infinite, and for locked joints. With a = M⁻¹ J_vᵀ u:
///   ∂m_u/∂q_k = −m_u² (2 uᵀ ∂(J_v a)/∂q_k − aᵀ ∂M/∂q_k a [+ 2 (ω_k × u)ᵀ Λ_v⁻¹ u, u in the frame]),  aᵀ ∂M/∂q a = 2 C(q, a)ᵀ a
void effective_mass_gradient(const Mechanism&, Data&, const VectorIn& q, const FrameOnBody& frame, FrameInertia& inertia,
                             const Eigen::Vector3d& u, Direction direction, VectorOut gradient);

/// An ellipsoid of velocities or accelerations of F, in the axes of B.
struct Ellipsoid {
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // columns: directions of the half-axes, longest first, right-handed
  Eigen::Vector3d lengths = Eigen::Vector3d::Zero();   // of the half-axes
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();

  /// Yoshikawa's measure of the `dimensions` longest axes: w = √det(A Aᵀ) for three, area for two.
  double measure(int dimensions = 3) const { return lengths.head(dimensions).prod(); }
};

/// Ellipsoids of translation and rotation apart: a determinant over both would mix units of measure.
struct Manipulability {
  explicit Manipulability(int n);

  Ellipsoid translation, rotation;

  Eigen::MatrixX3d rows;  // scratch (n x 3)
};

/// Velocities J q̇ with ‖q̇‖ ≤ 1 (prismatic joints in m/s beside revolute ones in rad/s): m/s and rad/s.
void kinematic_manipulability(const FrameInertia&, Manipulability& manipulability);
/// Accelerations J M⁻¹ diag(τ_max) t with ‖t‖ ≤ 1 around the centre −J M⁻¹(g + C q̇) + J̇ q̇ (Yoshikawa 1985): m/s² and rad/s².
/// `inertia` at q for the same frame; `tau_max` (n, N m or N) finite. Lengths are +∞ where a driven joint moves no mass.
void dynamic_manipulability(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq, const FrameOnBody& frame,
                            FrameInertia& inertia, const VectorIn& tau_max, Manipulability& manipulability);

/// The singular values of A, descending, from Aᵀ in `rows`, which it changes. Small ones are accurate.
void singular_values(Eigen::Ref<Eigen::MatrixXd> rows, VectorOut values);

/// M: mass of all bodies that joints move, kg.
double moving_mass(const RobotModel& robot);
/// Effective mass of a robot without data of its drives and posture, M/2 + m_L (ISO/TS 15066:2016, A.3.4), with the load m_L, kg.
double simple_effective_mass(double M, double m_L);

/// μ = (1/m_u + 1/m_H)⁻¹ of two bodies that collide, kg. Each may be infinite.
double reduced_mass(double m_u, double m_H);
/// Energy that goes into a collision at the relative speed v, ½ μ v², J.
double collision_energy(double mu, double v);
/// Relative speed at which a body part with the spring constant k_H (N/m) receives the force F_max (N), F_max/√(μ k_H),
/// m/s.
double speed_limit_of_force(double F_max, double k_H, double mu);

}  // namespace cotwin::robot
