#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "models/identification/torque_data.h"

/// The part of a joint's model that is solved inside: which columns it has at given nonlinear parameters, and least squares in
/// which some coefficients must not be negative.
namespace cotwin::identification {

inline constexpr int kMostTerms = 16;  // linear unknowns of one joint: at most 6, and 4 harmonics of two each

/// The linear unknowns of one joint's drive, in the order in which they are solved for.
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

  /// The joint's drive of which the friction curve's shape is given and the linear unknowns are `phi`.
  JointDrive drive(const JointDrive& shape, const double* phi) const;
  /// C: what the columns F_j are multiplied by per unknown (drive columns x size()), so that F_j C φ is the drive's torque.
  void columns_of(const JointDrive& shape, Eigen::MatrixXd& C) const;
  /// The same of the curve alone: columns `k` < curves() over the nodes.
  int curves() const { return curves_; }
  double curve(const JointDrive& shape, int k, double v) const;

 private:
  TorqueData::Columns columns_;
  ModelOptions options_;
  std::vector<double> nodes_;
  std::vector<std::string> names_;
  std::vector<bool> nonnegative_;
  std::vector<int> column_;  // of F_j, per unknown that is no curve
  int nonlinear_ = 0;
  int curves_ = 0;
};

/// min ‖T φ − b‖² with φ_k ≥ 0 where asked, for a tall T (rows x m by column with leading dimension `ld`, m ≤ kMostTerms), of
/// which T and b are destroyed. Columns that depend on those before them, or are zero, get φ = 0. Returns the minimum. By
/// Householder reflections and block principal pivoting (Portugal, Júdice, Vicente, Math. Comp. 63, 1994), which ends where
/// nothing is negative and no fixed unknown's gradient points inside. Allocates nothing. `active`: bit k set where φ_k is held
/// at zero.
double solve_nonnegative(int rows, int m, double* T, int ld, double* b, const bool* nonnegative, double* phi,
                         unsigned* active = nullptr);

}  // namespace cotwin::identification
