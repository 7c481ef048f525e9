#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

#include "models/identification/torque_data/torque_model.h"
#include "models/numerics/triangle.h"

namespace cotwin::identification {

/// The combinations of the 10n inertial parameters that joint torques depend on: Y π = Y_b (G π), where Y_b are the columns
/// `columns` of Y and G is b x 10n. Computed from the rank of the regressor on random motions; depends on the kinematics alone
/// (Gautier, Khalil, IEEE TRA 6(3), 1990; numerically: Gautier, J. Robotic Systems 8(4), 1991). Of linearly dependent columns
/// those of bodies nearer to the base are kept.
struct BaseParameters {
  std::vector<int> columns;  // b, body by body
  Eigen::MatrixXd G;         // b x 10n; G(·, columns) is the identity

  /// Base parameter i as text, "m_3 c_x + 0.4 m_4 + …", without terms below `least`.
  std::string name(int i, double least = 1e-6) const;
};
BaseParameters base_parameters(const robot::RobotModel& robot);
/// "Ixx_3": of element k of π.
std::string parameter_name(int k);

/// Compressed torque measurements: per joint the triangle of [F_j | Y_j,b | τ_j], with the columns of the linear drive
/// parameters, of the base parameters that the torque of the joint depends on, and of the torque. The sum of squared errors of
/// any estimate follows from it; memory does not grow with the number of samples. Nonlinear friction (kSigmoid, kStribeck)
/// enters F_j by the values of its curve at the nodes of a speed grid (denser about 0, up to the greatest speed of the joint).
/// So its parameters can be searched on the compressed data too, exact but for cubic interpolation between nodes.
class TorqueData {
 public:
  /// `robot`: its kinematics and gravity are used, its masses only for load friction (ModelOptions::load). `forgetting`: factor
  /// per sample, 1 for none.
  explicit TorqueData(const robot::RobotModel& robot, const ModelOptions& options = {}, double forgetting = 1);
  TorqueData(const TorqueData&);
  TorqueData& operator=(const TorqueData&);
  TorqueData(TorqueData&&) noexcept;
  TorqueData& operator=(TorqueData&&) noexcept;
  ~TorqueData();

  /// Adds one sample of n joints. dtheta, ddtheta: of the motors; null: those of the links. Allocates nothing. All values must
  /// be finite.
  void add(const double* q, const double* dq, const double* ddq, const double* tau, const double* dtheta = nullptr,
           const double* ddtheta = nullptr);
  /// Adds the samples of `older`, of the same robot and options: for data compressed in parts.
  void merge(const TorqueData& older);
  /// Adds an incomplete block to the triangles; required before triangles are read. Problem does it on its own copy.
  void flush();

  /// Removes all samples. Allocates nothing.
  void clear();
  /// Takes over the samples of `other`, of the same robot, options and forgetting, in place of those here. Allocates nothing.
  void copy_samples(const TorqueData& other);
  /// Appends all samples in their compressed form, those of an incomplete block included.
  void write_samples(ByteWriter& out) const;
  /// Continues from what data of the same robot, options and forgetting wrote, to the same bits. Allocates nothing. Throws
  /// Error as numerics::Triangle::read, and for triangles with unlike numbers of rows; then the samples are unspecified.
  void read_samples(ByteReader& in);

  std::size_t count() const;  // samples
  double weight() const;      // Σ of forgetting factors
  const robot::RobotModel& robot() const;
  const ModelOptions& options() const;
  const BaseParameters& base() const;

  /// The columns of one joint: `drive` columns (F_j), then one per entry of `base`, then τ_j.
  struct Columns {
    int nodes = 0;     // nodes of the friction curve (nonlinear friction), first in F_j
    int coulomb = -1;  // column of tanh(θ̇/v_R); −1 where absent, as are:
    int load = -1;     // of |g_j(q)| tanh(θ̇/v_R)
    int viscous = -1, offset = -1, motor_inertia = -1;
    int harmonics = -1;     // the first, sin q; 2 per harmonic
    int drive = 0;          // columns of F_j
    std::vector<int> base;  // rows of G
    int size() const { return drive + static_cast<int>(base.size()) + 1; }
  };
  const Columns& columns(int joint) const;
  const numerics::Triangle& triangle(int joint) const;
  const std::vector<double>& speed_nodes(int joint) const;  // rad/s, ascending

  /// Sum of squared errors of the estimate per joint (n), (N.m)², from flushed triangles.
  Eigen::VectorXd squared_errors(const Estimate& estimate) const;
  /// Root of the weighted mean square of the errors per joint, N.m.
  Eigen::VectorXd rms(const Estimate& estimate) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::identification
