#pragma once
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <vector>

#include "models/control/small_matrices.h"

/// Redundancy resolution at the acceleration level (IV-A3, [28]; derivations in docs/equations.md). Nothing here allocates
/// after construction or throws.
namespace cotwin::control {

using VectorIn = Eigen::Ref<const Eigen::VectorXd>;
using VectorOut = Eigen::Ref<Eigen::VectorXd>;
using MatrixIn = Eigen::Ref<const Eigen::MatrixXd>;
using MatrixOut = Eigen::Ref<Eigen::MatrixXd>;

/// One task of a cascade: ẍ = J q̈ + J̇ q̇ should be followed, as far as the tasks before it leave freedom.
struct Task {
  Task(int rows, int joints);

  // Wanted.
  Eigen::MatrixXd J, dJ;  // rows x n: J(q) and its rate J̇
  Eigen::VectorXd a;      // rows: the wanted ẍ less J̇ q̇
  Eigen::VectorXd scale;  // rows, > 0: makes rows comparable: 1 for m, a length for rad
  double activation = 1;  // 0 … 1, the part of the task that is in force
  // Computed.
  double sigma_min = 0;      // smallest singular value of diag(scale) J N_{k-1}, m per rad
  double lambda = 0;         // largest damping of a direction, lambda_0 √(sigma_0² − g²); 0: the task is exact
  Eigen::VectorXd residual;  // rows: a − J q̈, what cannot be done, by solve()
};

/// Prioritised tasks k = 1 … r with the metric M (any symmetric positive definite n x n matrix; kinetic energy for dynamic
/// consistency), N_0 = I:
///   J_k|p = J_k N_{k-1}        A = J_k|p M⁻¹ J_k|pᵀ        J̄_k|p = M⁻¹ J_k|pᵀ A^#        N_k = N_{k-1} (I − J̄_k|p J_k|p)
///   q̈ ← q̈ + J̄_k|p (a_k − J_k q̈)
/// Computed with the rows of J L⁻ᵀ, M = L Lᵀ, made orthonormal (Gram–Schmidt, twice). Then N = L⁻ᵀ (I − Yᵀ Y) Lᵀ.
///
/// Damping: singular values g of J_k|p (rows scaled) below sigma_0, and only their directions, are damped,
///   A^# = (A + s lambda_0² U diag(sigma_0² − g²)⁺ Uᵀ)⁻¹,   J_k|p J_k|pᵀ = U diag(g²) Uᵀ,   s = tr(J_k M⁻¹ J_kᵀ)/tr(J_k J_kᵀ)
/// so a direction fades out continuously, and joint speeds are bounded by about ẋ/(lambda_0 sigma_0). Activation multiplies A^#. In both
/// cases N_k = N_{k-1} − M⁻¹ J_k|pᵀ A^# J_k|p, which is symmetric in M and has eigenvalues between 0 and 1. It is a projector
/// where nothing is damped or partly active: then, and only then, J_j q̈ of a higher task is exact, and lower tasks do not move
/// it.
class Cascade {
 public:
  /// `rows` of each task, highest first: 1 to kMostRows each, in total any number, also more than n.
  Cascade(int n, const std::vector<int>& rows);

  int n() const { return n_; }
  std::vector<Task> tasks;
  double sigma_0 = 0.02;  // m per rad, > 0
  double lambda_0 = 1;    // > 0

  /// Takes J, scale and activation of the tasks, and computes sigma_min and lambda. False if M is not positive definite; then
  /// nothing else may be called.
  [[nodiscard]] bool decompose(const MatrixIn& M);
  /// Whether no task is damped or partly active.
  bool exact() const { return exact_; }

  // After decompose().
  /// q̈ of all tasks, without null-space motion; and their residuals.
  void solve(VectorOut ddq);
  /// v ← N_r v.
  void project(VectorOut v);
  /// v ← N_r (v + M⁻¹ τ).
  void project(VectorOut v, const VectorIn& tau);
  /// x ← M⁻¹ x.
  void solve_mass(VectorOut x);
  /// A ← N_k M⁻¹ (n x n, symmetric): the accelerations by joint torques that do not act on the first `kept` tasks, 0 to r.
  void mobility(std::size_t kept, MatrixOut A);
  /// Splits v: on return v ← N_r v, and forces[k] are such that M (v_before − v) = Σ J_kᵀ forces[k]. In units of the tasks.
  void split(VectorOut v, std::vector<Eigen::VectorXd>& forces);

 private:
  using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMostRows, kMostRows>;
  struct Level {
    Level(int rows, int n);
    std::vector<double> J_hat, W;  // rows x n, row-major: scaled J L⁻ᵀ, and this projected
    std::vector<double> R;         // rows x rows, lower triangular: W = R Y without damping
    std::vector<double> inverse;   // rows: 1/R_ii
    std::vector<double> G;         // rows x rows: J_k|p J_k|pᵀ
    std::vector<double> t;         // rows
    Square damped;
    Eigen::SelfAdjointEigenSolver<Square> eigen;
    double root = 1;  // √activation
    int first = 0;    // row in Y
    bool active = false;
  };

  // n, m: integral constants if they are known to the compiler, otherwise int.
  template <class N>
  bool factorise(const MatrixIn& M, N n);
  template <class N, class M>
  void take(Task& task, Level& level, N n, M m);
  template <class N>
  void whiten(const Task& task, Level& level, N n);
  void project_row(const Level& level, double* row);
  template <class N, class M>
  void gram(const Task& task, Level& level, bool projected, N n, M m);
  template <class N, class M>
  void orthonormalise(Level& level, N n, M m);
  void damp(Task& task, Level& level, int rows);
  void forward(const double* x, double* y) const;
  void backward(const double* y, double* x) const;
  void lower_solve(double* x) const;
  void remove(double* x, int rows);  // x ← (I − Yᵀ Y) x with the first rows of Y

  int n_ = 0;
  int rows_ = 0;  // of Y in use
  bool exact_ = true;
  std::vector<double> l_;                    // n x n, row-major, below the diagonal: M = l D lᵀ, L = l √D
  std::vector<double> root_, inverse_root_;  // √D, 1/√D
  std::vector<double> columns_;              // n x kMostRows, scratch
  std::vector<double> Y_;                    // all rows x n, row-major
  std::vector<double> c_;                    // all rows
  std::vector<double> x_, z_;
  std::vector<Level> levels_;
};

}  // namespace cotwin::control
