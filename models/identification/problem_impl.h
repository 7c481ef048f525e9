#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <vector>

#include "models/identification/problem.h"
#include "models/identification/torque_data/drive_terms.h"
#include "models/numerics/batch.h"

namespace cotwin::identification {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// The data of Problem. Per joint the triangle of [F_j | Y_j,b | τ_j] is
///   [ R11 R12 u; 0 R22 t; 0 0 ρ ]
/// The rows below R11 do not depend on friction: those of all joints, weighted, make one triangle S β − s. Friction is fitted
/// to the residual of the rows above.
struct Problem::Impl {
  TorqueData data;
  robot::RobotModel prior;
  ProblemOptions options;
  std::vector<LogCholesky> bodies;
  std::vector<DriveTerms> terms;   // n
  std::vector<JointDrive> shapes;  // n: nonlinear friction parameters of the prior
  Eigen::VectorXd lower, upper;
  Eigen::VectorXd sigma, weights;  // n: 1 / (σ √(n N))
  std::vector<char> silent;        // per base parameter: no plausible value has an effect on a torque
  Floor floor;
  Excitation excitation;
  double lambda = 0, lambda_shape = 0;  // weights of the prior: bodies, shape of friction

  RowMajor S;                   // b x b
  Eigen::VectorXd s;            // b
  double rho = 0;               // residual for every β
  std::vector<RowMajor> R11;    // per joint, weighted; for nonlinear friction in the basis below
  std::vector<RowMajor> basis;  // per joint: orthonormal rows that span all shapes of friction
  std::vector<int> row;         // of u_j in the stacked matrix
  RowMajor M;                   // (b + Σ drive columns) x 10n: [S; R12] G
  Eigen::VectorXd m;            // the right-hand side [s; u]
  numerics::BatchMatrix batch;
  int tall = 0, wide = 0;  // greatest number of columns and of unknowns of a drive

  Impl(const TorqueData& d, const robot::RobotModel& p, const ProblemOptions& o);
  int n() const { return prior.n(); }
  int inertial() const { return 10 * prior.body_count(); }  // inertial parameters of all bodies
  int base_count() const { return static_cast<int>(data.base().columns.size()); }
  JointDrive shape(int joint, const double* eta) const;
  int first_nonlinear(int joint) const;

  /// The shape of nonlinear friction, within its bounds, that fits best the torque that bodies with the base parameters β leave
  /// to the drive. Compass search from `eta` or, if that is empty, from the best point of a grid.
  Eigen::VectorXd best_shape(int joint, const Eigen::VectorXd& beta, const Eigen::VectorXd& eta) const;

  RowMajor reachable(int joint, const RowMajor& R) const;
  void set_bounds();
  void find_silent();
  void weigh_passive(Eigen::VectorXd& tau_rms, Eigen::VectorXd& own) const;
  void solve_floor();
  void assemble();
  void judge();
  /// Fits the drive of the joint to the right-hand side `rhs` (overwritten) of the top rows; returns the residual. scratch:
  /// tall · (wide + 1).
  double fit(int joint, const double* eta, double* rhs, double* scratch, double* phi, unsigned* active = nullptr) const;
};

/// ξ of the minimum of f in the box, to 1e-9 (convex.cpp); the current point when `stop` returns true.
Eigen::VectorXd convex_optimum(const Problem::Impl& problem, const std::function<bool()>& stop = {});

}  // namespace cotwin::identification
