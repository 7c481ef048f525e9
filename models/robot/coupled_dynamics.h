#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "models/robot/dynamics.h"
#include "models/robot/kernels/kernels.h"
#include "models/robot/robot_model.h"

/// Dynamics of robots with mimic joints, which dynamics.h uses. The positions of all joints are those of the independent ones,
///   q_all = G q + g_0,
/// with one factor per joint, so G and g_0 are constant and with V = G q̇ the principle of virtual power gives
///   M = Gᵀ M_all G,   C = Gᵀ C_all G,   g = Gᵀ g_all,   τ = Gᵀ τ_all,   J = J_all G,   Y = Gᵀ Y_all.
/// The kernels compute what has the index "all".
namespace cotwin::robot {

/// G, g_0 and the order of the kernels' joints.
struct Coupling {
  /// Throws Error unless every mimic has a leader, a finite multiplier and offset, and its parent before it.
  explicit Coupling(const RobotModel& robot);

  int n = 0;                   // independent joints
  std::vector<int> body;       // by the kernels' joint: the body of the RobotModel
  std::vector<int> kernel_of;  // the inverse
  std::vector<int> leader;     // by the kernels' joint: column of the one element in its row of G
  std::vector<double> rate;    // likewise: this element
  std::vector<double> offset;  // likewise: the element of g_0

  int all() const { return static_cast<int>(body.size()); }
};

/// Scratch memory of one thread.
struct CoupledScratch {
  CoupledScratch(int n, int all);

  static constexpr std::size_t kBatch = 64;                     // states of inverse_dynamics_batch at once
  Eigen::VectorXd q, dq, ddq, tau, zeros;                       // all
  Eigen::MatrixXd M, by_q, by_dq, J, dJ, Y;                     // all; J and dJ 6 x all, Y all x 10 all
  Eigen::MatrixXd reduced, J_reduced;                           // n x n, 6 x n
  Eigen::VectorXd h;                                            // n
  std::vector<double> batch_q, batch_dq, batch_ddq, batch_tau;  // all · kBatch
};

/// The functions of dynamics.h for one mechanism and the scratch memory of one thread. Allocates nothing.
class CoupledDynamics {
 public:
  CoupledDynamics(const KernelModel& model, const Kernels& kernels, const Coupling& coupling, double* scratch,
                  CoupledScratch& own)
      : model_(model), kernels_(kernels), G_(coupling), scratch_(scratch), s_(own) {}

  /// `a_0`: minus the acceleration of gravity; dq, ddq: nullptr for zero.
  void inverse_dynamics(const double* a_0, const double* q, const double* dq, const double* ddq, double* tau);
  void inverse_dynamics_batch(std::size_t count, const double* q, const double* dq, const double* ddq, double* tau);
  void mass_matrix(const double* q, MatrixOut M);
  void mass_matrix_and_bias(const double* q, const double* dq, MatrixOut M, VectorOut h);
  void coriolis_matrix(const double* q, const double* dq, MatrixOut C);
  void forward_dynamics(const double* q, const double* dq, const double* tau, double* ddq);
  void derivatives(const double* q, const double* dq, const double* ddq, MatrixOut dtau_dq, MatrixOut dtau_ddq);
  void regressor(const double* q, const double* dq, const double* ddq, MatrixOut Y);
  /// J: nullptr if it is not needed. `body` as in the RobotModel.
  void kinematics(const double* q, int body, const KernelPose& X_JF, KernelPose* X_BF, MatrixOut* J);
  void jacobian_rate(const double* q, const double* dq, int body, const KernelPose& X_JF, KernelPose* X_BF, MatrixOut J,
                     MatrixOut dJ);
  void jacobian_dot_times_dq(const double* q, const double* dq, int body, const KernelPose& X_JF, double* a);
  double potential_energy(const double* q);

 private:
  void positions(const double* q);
  void rates(const double* from, Eigen::VectorXd& to) const;
  void forces(const double* all, double* to) const;
  void sandwich(const Eigen::MatrixXd& all, MatrixOut to) const;
  int kernel_of(int body) const { return body < 0 ? body : G_.kernel_of[static_cast<std::size_t>(body)]; }

  const KernelModel& model_;
  const Kernels& kernels_;
  const Coupling& G_;
  double* scratch_;
  CoupledScratch& s_;
};

}  // namespace cotwin::robot
