#pragma once
#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "models/identification/log_cholesky.h"
#include "models/identification/torque_data/torque_data.h"

namespace cotwin::identification {

/// Bounds around the prior, in the coordinates of LogCholesky: |2α| ≤ ln mass_factor, and so on.
struct Bounds {
  double mass_factor = 5;                // mass within 1/5 and 5 times the prior's
  double stretch_factor = 10;            // each principal standard deviation of the mass distribution likewise
  double shear = 3;                      // |s|
  double shift = 4;                      // |t|, standard deviations of the prior's mass distribution
  double v_R_min = 1e-3, v_R_max = 0.5;  // rad/s, kSigmoid; see speed_scale()
  double s_max = 0.1;                    // rad/s, kSigmoid
  double v_S_min = 5e-3, v_S_max = 1;    // rad/s, kStribeck
  friend bool operator==(const Bounds&, const Bounds&) = default;
};

/// Default weights of the prior, see Problem. The data enter the cost as a mean over the samples. So the more samples there
/// are, the less weight the prior needs to decide what the data leave open.
inline constexpr double kPriorWeightOfShortData = 0.1;  // the tuner in a running twin: seconds of data, some 10³ samples
inline constexpr double kPriorWeightOfLogs = 1e-3;      // cotwin tune: minutes of data, 10⁴ samples and more

struct ProblemOptions {
  Bounds bounds;
  double prior_weight = kPriorWeightOfShortData;
  Eigen::VectorXd sigma;  // n, N.m: weights 1/σ_j² of the joints; empty: the residuals of the floor
};

/// Unconstrained least squares over base parameters, linear drive parameters and parameters of nonlinear friction. Its error is
/// a lower bound (the floor) for every physical robot on the same data.
struct Floor {
  Eigen::VectorXd beta;           // base parameters, b
  std::vector<JointDrive> drive;  // n
  Eigen::VectorXd sigma;          // n: root of the residual variance per joint, N.m
  Eigen::VectorXd rms;            // n: root of the mean square of the residuals, N.m
  int rank = 0;                   // of the weighted regressor, of `unknowns` columns
  int unknowns = 0;
  double condition = 0;                         // of its columns scaled to unit length, within the rank
  double cost = 0;                              // Σ_j rms_j² / (n σ_j²)
  std::vector<int> joint_rank, joint_unknowns;  // n: for the unknowns of the joint's torque, from this torque alone
};

/// How well the data determine one unknown of the floor.
struct Determination {
  std::string name;  // "Izz_1 + …", "tau_C_3"
  double value = 0;
  double deviation = 0;     // standard deviation under independent errors; ∞ where not determined
  double relative = 0;      // deviation / |value|
  bool determined = false;  // false where only a sum with others is determined, such as B_1 + Izz_1
};

/// The unknowns that the motion excites.
struct Excitation {
  int structural = 0;  // base parameters of the robot's kinematics
  int unknowns = 0;    // base and linear drive parameters
  int rank = 0;        // unknowns that the data determine
  double condition = 0;
  std::vector<Determination> unknown;  // one per unknown
  std::vector<std::string> warnings;   // empty: well excited
};

/// A bound at which a solution stands.
struct ActiveBound {
  enum class Kind { kMass, kStretch, kShear, kShift, kVR, kVS, kS };
  Kind kind;
  std::string of;  // body, or joint
};

/// The optimisation problem of both solvers: given compressed torques and a prior, over coordinates ξ (10 per body, then those
/// of nonlinear friction) in a box,
///   f(ξ) = min_φ 1/n Σ_j ‖τ_j − Y_j π(ξ) − F_j(ξ) φ_j‖² / (N σ_j²) + λ D(ξ)
/// The linear drive parameters φ are solved for at each ξ; τ_C, τ_S − τ_C, σ2 and B are constrained to be ≥ 0 (variable
/// projection: Golub, Pereyra, SIAM J. Numer. Anal. 10(2), 1973). D is the divergence from the prior (log_cholesky.h, summed
/// over bodies); λ = prior_weight / 100 is small and decides what the data leave open. λ D includes the squares of the
/// coordinates of nonlinear friction, with a weight of at most 1e-5 in place of λ, because their prior is only the start of the
/// search. √(f − λ D) is the weighted RMS; it is 1 at the floor.
/// Constant, and usable by several threads.
class Problem {
 public:
  /// Copies the compressed `data`. `prior` has the kinematics of the robot; its bodies are made consistent(). Throws Error
  /// where there are fewer samples than unknowns or the torque of a joint is constantly zero.
  Problem(const TorqueData& data, const robot::RobotModel& prior, const ProblemOptions& options = {});
  ~Problem();
  Problem(Problem&&) noexcept;
  Problem& operator=(Problem&&) noexcept;

  int dimensions() const;
  const Eigen::VectorXd& lower() const;
  const Eigen::VectorXd& upper() const;
  const TorqueData& data() const;        // flushed
  const Eigen::VectorXd& sigma() const;  // n, N.m
  const Floor& floor() const;
  const Excitation& excitation() const;

  double cost(const Eigen::VectorXd& xi) const;
  /// f of eight points in vector lanes: coordinate i of point k is xi[i * stride + k]. Allocates nothing; `scratch` has
  /// scratch_doubles() elements and belongs to the calling thread.
  void cost(const double* xi, std::size_t stride, double* scratch, double* cost) const;
  std::size_t scratch_doubles() const;
  /// λ D(ξ)
  double prior_cost(const Eigen::VectorXd& xi) const;
  /// Residuals r with f = ‖r‖², and ∂r/∂ξ.
  void residuals(const Eigen::VectorXd& xi, Eigen::VectorXd& r, Eigen::MatrixXd* jacobian = nullptr) const;
  /// The robot at ξ with its drives solved for.
  Estimate estimate(const Eigen::VectorXd& xi) const;
  /// The bounds of the box at which ξ stands.
  std::vector<ActiveBound> active_bounds(const Eigen::VectorXd& xi) const;
  /// √(1/n Σ_j rms_j² / σ_j²) of any estimate on the data (floor: 1 up to degrees of freedom).
  double weighted_rms(const Estimate& estimate) const;
  /// The parameters of the floor as an estimate; what the data leave open is that of the prior (least change of π with G π =
  /// β). Not physical.
  Estimate floor_estimate() const;

  struct Impl;
  const Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::identification
