#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <memory>

#include "models/robot/robot_model.h"

/// Kinematics and dynamics of (2a) in reduced coordinates:
///   M(q) q̈ + C(q, q̇) q̇ + g(q) = τ        τ = τ_J + τ_e
/// `Mechanism` holds the constants of a robot for the kernels and may be shared; `Data` is the scratch memory of one thread.
/// The functions do not allocate or throw. Vectors have length n in the joint order of the RobotModel, must be contiguous, and
/// are in rad, m, N.m, N. The kernels are compiled for several instruction sets, which are chosen per function by a fixed table
/// for the machine (kernels.h). For robots with mimic joints all quantities are those of the independent joints
/// (coupled_dynamics.h); they take more time, because their kernels compute all joints.
namespace cotwin::robot {

using VectorIn = Eigen::Ref<const Eigen::VectorXd>;
using VectorOut = Eigen::Ref<Eigen::VectorXd>;
using MatrixOut = Eigen::Ref<Eigen::MatrixXd>;

/// A robot prepared for the kernels: link frames rotated so that each joint's axis is z, constants arranged for vector
/// registers.
class Mechanism {
 public:
  /// `isa`: instruction set of the kernels, for example "x86-64-v2"; nullptr: that of COTWIN_CPU or the machine.
  explicit Mechanism(const RobotModel& robot, const char* isa = nullptr);
  ~Mechanism();
  Mechanism(Mechanism&&) noexcept;
  Mechanism& operator=(Mechanism&&) noexcept;

  int n() const;           // independent joints
  int body_count() const;  // n and the bodies of mimics
  /// Replaces mass distribution and gravity by those of `robot`, which must have the same joints. Allocates nothing. Must not
  /// run concurrently with computations.
  void update(const RobotModel& robot);

  struct Impl;
  const Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

/// Scratch memory of one thread for one mechanism.
class Data {
 public:
  explicit Data(const Mechanism& mechanism);
  ~Data();
  Data(Data&&) noexcept;
  Data& operator=(Data&&) noexcept;

  struct Impl;
  Impl& impl() { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

/// A frame for the functions below: body and pose on it, as in RobotModel::frames.
struct FrameOnBody {
  int body = -1;
  Pose X_BF;
};
FrameOnBody on_body(const Frame& frame);

/// τ = M q̈ + C q̇ + g (recursive Newton–Euler).
void inverse_dynamics(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq, const VectorIn& ddq, VectorOut tau);
/// h = C q̇ + g.
void bias(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq, VectorOut h);
/// g(q).
void gravity(const Mechanism&, Data&, const VectorIn& q, VectorOut g);
/// M(q), symmetric, both triangles (n x n).
void mass_matrix(const Mechanism&, Data&, const VectorIn& q, MatrixOut M);
/// M(q) and h = C q̇ + g in one pass.
void mass_matrix_and_bias(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq, MatrixOut M, VectorOut h);
/// C(q, q̇) with Ṁ − 2C skew-symmetric [21] (n x n), from the Christoffel symbols: C = ½ ∂(C q̇)/∂q̇.
void coriolis_matrix(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq, MatrixOut C);
/// q̈ = M⁻¹ (τ − C q̇ − g): by M = L D Lᵀ for chains of 6 and 7 revolute joints and with mimics,
/// otherwise by articulated bodies. M is positive
/// definite if every joint moves mass; otherwise q̈ is not finite.
void forward_dynamics(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq, const VectorIn& tau, VectorOut ddq);
/// ∂τ/∂q and ∂τ/∂q̇ of inverse dynamics (n x n each); ∂τ/∂q̈ is M.
void inverse_dynamics_derivatives(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq, const VectorIn& ddq,
                                  MatrixOut dtau_dq, MatrixOut dtau_ddq);
/// Y with τ = Y π (n x 10 body_count()); π stacks Inertia::parameters() of every body in its own (URDF) frame.
void regressor(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq, const VectorIn& ddq, MatrixOut Y);

/// X_BF(q): the frame's pose in the base.
Pose forward_kinematics(const Mechanism&, Data&, const VectorIn& q, const FrameOnBody& frame);
/// J_BF (6 x n), linear first, expressed in the base: V_BF = J q̇. Also returns the pose.
Pose jacobian(const Mechanism&, Data&, const VectorIn& q, const FrameOnBody& frame, MatrixOut J);
/// The same with J̇ (6 x n) at the velocities dq.
Pose jacobian(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq, const FrameOnBody& frame, MatrixOut J,
              MatrixOut dJ);
/// J̇ q̇ (6).
void jacobian_dot_times_dq(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq, const FrameOnBody& frame,
                           Eigen::Ref<Twist> a);

/// ½ q̇ᵀ M q̇ and −Σ m_i gᵀ p_i (0 if every centre of mass is at the base's origin).
double kinetic_energy(const Mechanism&, Data&, const VectorIn& q, const VectorIn& dq);
double potential_energy(const Mechanism&, Data&, const VectorIn& q);

/// Inverse dynamics of `count` states in SIMD lanes. Arrays are by joint: joint j of state s at [j * count + s]. Any count is
/// allowed; multiples of 8 are fastest. Agrees with inverse_dynamics to rounding.
void inverse_dynamics_batch(const Mechanism&, Data&, std::size_t count, const double* q, const double* dq, const double* ddq,
                            double* tau);

}  // namespace cotwin::robot
