#include "models/identification/torque_data/torque_data.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

#include "models/foundation/support/error.h"

namespace cotwin::identification {
namespace {

using Eigen::Index;
using Eigen::VectorXd;
using numerics::Triangle;
using ConstMap = Eigen::Map<const VectorXd>;

/// Nodes v_i = v_max sinh(8 x_i) / sinh 8, x_i even in [−1, 1]: 40 of them are 8e-4 rad/s apart about 0 and 1 at 3 rad/s.
constexpr double kDensity = 8;

std::vector<double> speed_grid(int count, double v_max) {
  std::vector<double> nodes;
  for (int i = 0; i < count; ++i)
    nodes.push_back(v_max * std::sinh(kDensity * (2.0 * i / (count - 1) - 1)) / std::sinh(kDensity));
  return nodes;
}

/// Weights of the nodes first … first + 3 at the speed v: cubic convolution in x (Keys, IEEE TASSP 29(6), 1981, a = −1/2),
/// beyond the ends of the grid with the linear continuation of the nodes. `first` may be −1, and its weight is then 0; likewise
/// the last.
struct NodeWeights {
  int first = 0;
  double w[4] = {};
};
NodeWeights node_weights(double v, int count, double v_max) {
  const double x = std::asinh(std::clamp(v, -v_max, v_max) / v_max * std::sinh(kDensity)) / kDensity;
  const double at = 0.5 * (x + 1) * (count - 1);
  const int i = std::clamp(static_cast<int>(at), 0, count - 2);
  const double f = at - i;
  NodeWeights n{
      i - 1,
      {f * (-0.5 + f * (1 - 0.5 * f)), 1 + f * f * (-2.5 + 1.5 * f), f * (0.5 + f * (2 - 1.5 * f)), f * f * (-0.5 + 0.5 * f)}};
  if (i == 0) {
    n.w[1] += 2 * n.w[0];
    n.w[2] -= n.w[0];
    n.w[0] = 0;
  }
  if (i == count - 2) {
    n.w[2] += 2 * n.w[3];
    n.w[1] -= n.w[3];
    n.w[3] = 0;
  }
  return n;
}

/// Greatest speed of the grid of a friction curve; beyond it the curve is continued as a constant. Clamped, because a nominal
/// limit of 1000 rad/s, or one below the speed at which friction levels off, would leave no nodes where friction changes.
double greatest_speed(const robot::Joint& joint) {
  constexpr double kUsual = 4, kLeast = 1, kMost = 30;  // rad/s or m/s
  return std::isfinite(joint.dq_max) && joint.dq_max > 0 ? std::clamp(joint.dq_max, kLeast, kMost) : kUsual;
}

}  // namespace

struct TorqueData::Impl {
  robot::RobotModel robot;
  ModelOptions options;
  BaseParameters base;
  std::vector<Columns> columns;
  std::vector<std::vector<double>> nodes;
  std::vector<Triangle> triangles;
  std::shared_ptr<const robot::Mechanism> mechanism;
  robot::Data scratch;
  Eigen::MatrixXd Y;
  VectorXd g;

  Impl(const robot::RobotModel& r, const ModelOptions& o, double forgetting)
      : robot(r),
        options(o),
        base(base_parameters(r)),
        mechanism(std::make_shared<const robot::Mechanism>(r)),
        scratch(*mechanism),
        Y(Eigen::MatrixXd::Zero(r.n(), 10 * r.body_count())),
        g(VectorXd::Zero(r.n())) {
    check();
    for (int j = 0; j < robot.n(); ++j) {
      const bool curve = options.friction == FrictionLaw::kSigmoid || options.friction == FrictionLaw::kStribeck;
      nodes.push_back(curve && !is_still(j)
                          ? speed_grid(options.speed_nodes, greatest_speed(robot.joints[static_cast<std::size_t>(j)]))
                          : std::vector<double>{});
      columns.push_back(columns_of(j));
      triangles.emplace_back(static_cast<std::size_t>(columns.back().size()), forgetting);
    }
  }
  Impl(const Impl& o)
      : robot(o.robot),
        options(o.options),
        base(o.base),
        columns(o.columns),
        nodes(o.nodes),
        triangles(o.triangles),
        mechanism(o.mechanism),
        scratch(*mechanism),
        Y(o.Y),
        g(o.g) {}

  void check() const {
    const auto n = static_cast<std::size_t>(robot.n());
    if (!options.harmonics.empty() && options.harmonics.size() != n)
      throw Error("harmonics", std::to_string(options.harmonics.size()) + " numbers, expected " + std::to_string(n));
    for (const int k : options.harmonics)
      if (k < 0 || k > 4) throw Error("harmonics", std::to_string(k) + " of a joint, expected 0 to 4");
    if (!options.still.empty() && options.still.size() != n)
      throw Error("still", std::to_string(options.still.size()) + " joints, expected " + std::to_string(n));
    if (!(options.v_R > 0)) throw Error("v_R", std::to_string(options.v_R) + " rad/s, expected above 0");
    if (!(options.delta > 0)) throw Error("delta", std::to_string(options.delta) + ", expected above 0");
    if (options.speed_nodes < 8 || options.speed_nodes % 2 != 0)
      throw Error("speed_nodes", std::to_string(options.speed_nodes) + ", expected an even number of at least 8");
  }

  bool is_still(int j) const { return !options.still.empty() && options.still[static_cast<std::size_t>(j)] != 0; }

  Columns columns_of(int j) const {
    Columns c;
    c.nodes = static_cast<int>(nodes[static_cast<std::size_t>(j)].size());
    c.drive = c.nodes;
    const bool moves = !is_still(j);
    if (moves && options.friction == FrictionLaw::kCoulomb) c.coulomb = c.drive++;
    if (moves && options.load) c.load = c.drive++;
    if (moves && options.viscous) c.viscous = c.drive++;
    if (options.offset) c.offset = c.drive++;
    const bool driven = !robot.joints[static_cast<std::size_t>(j)].passive;
    if (moves && driven && options.motor_inertia) c.motor_inertia = c.drive++;
    if (const int k = options.harmonics.empty() || !moves ? 0 : options.harmonics[static_cast<std::size_t>(j)]; k > 0) {
      c.harmonics = c.drive;
      c.drive += 2 * k;
    }
    for (std::size_t i = 0; i < base.columns.size(); ++i)
      if (robot.moves(j, base.columns[i] / 10)) c.base.push_back(static_cast<int>(i));
    return c;
  }

  void add(const double* q, const double* dq, const double* ddq, const double* tau, const double* dtheta,
           const double* ddtheta) {
    const Index n = robot.n();
    robot::regressor(*mechanism, scratch, ConstMap(q, n), ConstMap(dq, n), ConstMap(ddq, n), Y);
    if (options.load) robot::gravity(*mechanism, scratch, ConstMap(q, n), g);
    constexpr std::size_t kStride = Triangle::kRows;
    for (Index j = 0; j < n; ++j) {
      const auto k = static_cast<std::size_t>(j);
      const Columns& c = columns[k];
      double* const row = triangles[k].next();
      const auto at = [row](int column) -> double& { return row[static_cast<std::size_t>(column) * kStride]; };
      const double v = (dtheta ? dtheta : dq)[j], v_R = speed_scale(robot.joints[k]) * options.v_R;
      if (c.nodes > 0) {
        for (int i = 0; i < c.nodes; ++i) at(i) = 0;
        const NodeWeights weights = node_weights(v, c.nodes, nodes[k].back());
        for (int i = 0; i < 4; ++i)
          if (weights.w[i] != 0) at(weights.first + i) = weights.w[i];
      }
      if (c.coulomb >= 0) at(c.coulomb) = std::tanh(v / v_R);
      constexpr double kNoLoad = 1e-3;  // N.m; gravity on a vertical axis is rounding noise
      if (c.load >= 0) at(c.load) = std::abs(g[j]) < kNoLoad ? 0.0 : std::abs(g[j]) * std::tanh(v / v_R);
      if (c.viscous >= 0) at(c.viscous) = v;
      if (c.offset >= 0) at(c.offset) = 1;
      if (c.motor_inertia >= 0) at(c.motor_inertia) = (ddtheta ? ddtheta : ddq)[j];
      for (int i = c.harmonics; i >= 0 && i < c.drive; i += 2) {
        const double angle = ((i - c.harmonics) / 2 + 1) * q[j];
        at(i) = std::sin(angle);
        at(i + 1) = std::cos(angle);
      }
      const double* const y = Y.data() + j;
      double* to = row + static_cast<std::size_t>(c.drive) * kStride;
      for (const int i : c.base) {
        *to = y[static_cast<Index>(base.columns[static_cast<std::size_t>(i)]) * n];
        to += kStride;
      }
      *to = robot.joints[k].passive ? 0.0 : tau[j];
      triangles[k].commit();
    }
  }

  /// Coefficients of a joint's columns: drive, base, −1.
  VectorXd coefficients(int j, const Estimate& estimate, const VectorXd& beta) const {
    const Columns& c = columns[static_cast<std::size_t>(j)];
    const JointDrive& d = estimate.drive[static_cast<std::size_t>(j)];
    VectorXd b = VectorXd::Zero(c.size());
    JointDrive curve = d;  // without the terms that have columns of their own
    curve.sigma2 = curve.tau_0 = 0;
    for (int i = 0; i < c.nodes; ++i) b[i] = curve.friction(nodes[static_cast<std::size_t>(j)][static_cast<std::size_t>(i)]);
    if (c.coulomb >= 0) b[c.coulomb] = d.tau_C;
    if (c.load >= 0) b[c.load] = d.load;
    if (c.viscous >= 0) b[c.viscous] = d.sigma2;
    if (c.offset >= 0) b[c.offset] = d.tau_0;
    if (c.motor_inertia >= 0) b[c.motor_inertia] = d.B;
    for (int i = c.harmonics; i >= 0 && i < c.drive; ++i) {
      const auto k = static_cast<std::size_t>(i - c.harmonics);
      b[i] = k < d.harmonics.size() ? d.harmonics[k] : 0.0;
    }
    for (std::size_t i = 0; i < c.base.size(); ++i) b[c.drive + static_cast<Index>(i)] = beta[c.base[i]];
    b[c.size() - 1] = -1;
    return b;
  }
};

TorqueData::TorqueData(const robot::RobotModel& robot, const ModelOptions& options, double forgetting)
    : impl_(std::make_unique<Impl>(robot, options, forgetting)) {}
TorqueData::TorqueData(const TorqueData& other) : impl_(std::make_unique<Impl>(*other.impl_)) {}
TorqueData& TorqueData::operator=(const TorqueData& other) {
  if (this != &other) impl_ = std::make_unique<Impl>(*other.impl_);
  return *this;
}
TorqueData::TorqueData(TorqueData&&) noexcept = default;
TorqueData& TorqueData::operator=(TorqueData&&) noexcept = default;
TorqueData::~TorqueData() = default;

void TorqueData::add(const double* q, const double* dq, const double* ddq, const double* tau, const double* dtheta,
                     const double* ddtheta) {
  impl_->add(q, dq, ddq, tau, dtheta, ddtheta);
}

void TorqueData::merge(const TorqueData& older) {
  if (older.impl_->options != impl_->options || older.impl_->triangles.size() != impl_->triangles.size())
    throw Error("torque data", "of another model cannot be merged, expected the same robot and options");
  for (std::size_t j = 0; j < impl_->triangles.size(); ++j) impl_->triangles[j].merge(older.impl_->triangles[j]);
}

void TorqueData::flush() {
  for (Triangle& triangle : impl_->triangles) triangle.flush();
}

void TorqueData::clear() {
  for (Triangle& triangle : impl_->triangles) triangle.clear();
}

void TorqueData::copy_samples(const TorqueData& other) {
  std::copy(other.impl_->triangles.begin(), other.impl_->triangles.end(), impl_->triangles.begin());
}

void TorqueData::write_samples(ByteWriter& out) const {
  for (const Triangle& triangle : impl_->triangles) triangle.write(out);
}

void TorqueData::read_samples(ByteReader& in) {
  for (Triangle& triangle : impl_->triangles) {
    triangle.read(in);
    if (triangle.rows() != count() || triangle.pending() != impl_->triangles.front().pending())
      in.fail("has triangles of unlike numbers of rows, expected as many for each joint: one per sample");
  }
}

std::size_t TorqueData::count() const { return impl_->triangles.front().rows(); }
double TorqueData::weight() const { return impl_->triangles.front().weight(); }
const robot::RobotModel& TorqueData::robot() const { return impl_->robot; }
const ModelOptions& TorqueData::options() const { return impl_->options; }
const BaseParameters& TorqueData::base() const { return impl_->base; }
const TorqueData::Columns& TorqueData::columns(int joint) const { return impl_->columns[static_cast<std::size_t>(joint)]; }
const Triangle& TorqueData::triangle(int joint) const { return impl_->triangles[static_cast<std::size_t>(joint)]; }
const std::vector<double>& TorqueData::speed_nodes(int joint) const { return impl_->nodes[static_cast<std::size_t>(joint)]; }

VectorXd TorqueData::squared_errors(const Estimate& estimate) const {
  const VectorXd beta = base().G * estimate.pi;
  VectorXd errors(robot().n());
  for (int j = 0; j < robot().n(); ++j) {
    const VectorXd b = impl_->coefficients(j, estimate, beta);
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    errors[j] =
        (Eigen::Map<const RowMajor>(triangle(j).R(), b.size(), b.size()).triangularView<Eigen::Upper>() * b).squaredNorm();
  }
  return errors;
}

VectorXd TorqueData::rms(const Estimate& estimate) const { return (squared_errors(estimate) / weight()).cwiseSqrt(); }

}  // namespace cotwin::identification
