#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "models/identification/torque_data/torque_data.h"

/// The linear part of the model of one joint: its columns at given nonlinear parameters, and least squares with coefficients
/// that must not be negative.
namespace cotwin::identification {

inline constexpr int kMostTerms = 16;  // linear unknowns of one joint: at most 6, and 4 harmonics of two each

/// The linear unknowns of the drive of one joint, in the order of the solution.
class DriveTerms {
 public:
  DriveTerms(const TorqueData& data, int joint);

  int size() const { return static_cast<int>(names_.size()); }
  bool nonnegative(int k) const { return nonnegative_[static_cast<std::size_t>(k)]; }
  const std::string& name(int k) const { return names_[static_cast<std::size_t>(k)]; }

  /// Nonlinear parameters: 2 (ln v_R, s), 1 (ln v_S) or 0.
  int nonlinear() const { return nonlinear_; }
  bool curved() const { return columns_.nodes > 0; }
  int columns() const { return columns_.drive; }

  /// The drive of the joint with the friction curve `shape` and the linear unknowns `phi`.
  JointDrive drive(const JointDrive& shape, const double* phi) const;
  /// C (drive columns x size()): F_j C φ is the torque of the drive.
  void columns_of(const JointDrive& shape, Eigen::MatrixXd& C) const;
  /// The curve alone: columns `k` < curves() over the nodes.
  int curves() const { return curves_; }
  double curve(const JointDrive& shape, int k, double v) const;

 private:
  TorqueData::Columns columns_;
  ModelOptions options_;
  std::vector<double> nodes_;
  std::vector<std::string> names_;
  std::vector<bool> nonnegative_;
  std::vector<int> column_;  // of F_j, per unknown that is not part of the curve
  int nonlinear_ = 0;
  int curves_ = 0;
  double v_load_;
};

/// Solves min ‖T φ − b‖² with φ_k ≥ 0 where `nonnegative`, for a tall T (rows x m by column with leading dimension `ld`, m ≤
/// kMostTerms), and returns the minimum. T and b are overwritten. Columns that are zero or depend on those before them get φ =
/// 0. Householder reflections and block principal pivoting (Portugal, Júdice, Vicente, Math. Comp. 63, 1994), until no φ is
/// negative and no gradient of a fixed unknown points into the feasible set. Allocates nothing. `active`: bit k is set where
/// φ_k is fixed at zero.
double solve_nonnegative(int rows, int m, double* T, int ld, double* b, const bool* nonnegative, double* phi,
                         unsigned* active = nullptr);

}  // namespace cotwin::identification
