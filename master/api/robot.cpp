#include <algorithm>
#include <cmath>

#include "master/api/cotwin.h"
#include "master/scenario/folders.h"
#include "models/foundation/support/text.h"
#include "models/robot/dynamics.h"
#include "models/robot/floating_base.h"
#include "models/robot/indices.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin {

struct Robot::Impl {
  explicit Impl(const std::filesystem::path& file) : model(robot::load_urdf(file)), mechanism(model), data(mechanism) {}

  Eigen::Map<const Eigen::VectorXd> in(std::span<const double> values, const char* name) const {
    if (values.size() != model.joints.size()) {
      throw Error(std::string(name) + " of " + model.name, "has " + std::to_string(values.size()) + " elements, expected " +
                                                               std::to_string(model.joints.size()) + ", one per joint");
    }
    return {values.data(), model.n()};
  }
  /// Number of states of an array with n values per state.
  std::size_t states(std::span<const double> q) const {
    const std::size_t n = model.joints.size();
    if (n == 0 || q.size() % n != 0) {
      throw Error("q of " + model.name,
                  "has " + std::to_string(q.size()) + " elements, expected a multiple of " + std::to_string(n));
    }
    return q.size() / n;
  }
  /// Throws Error unless `size` values are `per_state` for each state.
  void check(const char* name, std::size_t size, std::size_t count, std::size_t per_state) const {
    if (size == count * per_state) return;
    throw Error(std::string(name) + " of " + model.name,
                "has " + std::to_string(size) + " elements, expected " + std::to_string(count * per_state) + ", " +
                    std::to_string(per_state) + " for each of " + std::to_string(count) + " states");
  }
  Eigen::Map<const Eigen::VectorXd> state(std::span<const double> values, std::size_t s) const {
    return {values.data() + s * model.joints.size(), model.n()};
  }
  Eigen::Map<Eigen::VectorXd> state(std::span<double> values, std::size_t s) const {
    return {values.data() + s * model.joints.size(), model.n()};
  }
  /// Writes a matrix by rows to the block `s` of an array.
  template <class Compute>
  void by_rows(std::span<double> to, std::size_t s, Eigen::Index rows, Eigen::Index columns, Compute compute) {
    if (by_columns.rows() != rows || by_columns.cols() != columns) by_columns.resize(rows, columns);
    compute(by_columns);
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
        to.data() + s * static_cast<std::size_t>(rows * columns), rows, columns) = by_columns;
  }

  /// A robot whose base floats.
  struct Floating {
    explicit Floating(const robot::RobotModel& robot) : mechanism(robot), data(mechanism), inertia(robot.n()) {}
    robot::FloatingMechanism mechanism;
    robot::FloatingData data;
    robot::FloatingInertia inertia;
  };
  /// Writes `rows` x n of each state: compute(base, q, matrix), the inertia of the base at q.
  template <class Compute>
  void floating(std::span<const double> q, const char* name, std::span<double> to, Eigen::Index rows, Compute compute) {
    const std::size_t count = states(q);
    check(name, to.size(), count, static_cast<std::size_t>(rows * model.n()));
    if (!base) base = std::make_unique<Floating>(model);
    for (std::size_t s = 0; s < count; ++s) {
      robot::floating_inertia(base->mechanism, base->data, state(q, s), base->inertia);
      by_rows(to, s, rows, model.n(), [&](Eigen::MatrixXd& one) { compute(*base, state(q, s), one); });
    }
  }

  robot::FrameOnBody frame(const std::string& name) const {
    return robot::on_body(name.empty() ? model.end_effector() : model.frame(name));
  }

  /// Inertia, frame and unit vector in B of the functions of indices.
  struct At {
    robot::FrameOnBody on;
    robot::FrameInertia inertia;
    Eigen::Vector3d u;
  };
  At at(std::span<const double> q, const std::array<double, 3>& u, const std::string& name, Axes axes,
        std::span<const double> motor_inertia) {
    At at{frame(name), robot::FrameInertia(model.n()), Eigen::Map<const Eigen::Vector3d>(u.data())};
    if (!at.u.allFinite() || at.u.stableNorm() == 0) {
      throw Error("u of " + model.name,
                  "has the length " + text::to_text(at.u.stableNorm()) + ", expected a finite length > 0");
    }
    if (!motor_inertia.empty()) in(motor_inertia, "motor_inertia");
    for (const double B : motor_inertia) {
      if (!(B >= 0)) throw Error("motor_inertia of " + model.name, "is " + text::to_text(B) + ", expected >= 0");
    }
    const Eigen::Map<const Eigen::VectorXd> B(motor_inertia.data(), static_cast<Eigen::Index>(motor_inertia.size()));
    robot::frame_inertia(mechanism, data, in(q, "q"), B, at.on, at.inertia);
    at.u.stableNormalize();
    if (axes == Axes::kFrame) at.u = at.inertia.X_BF.R * at.u;
    return at;
  }

  robot::RobotModel model;
  robot::Mechanism mechanism;
  robot::Data data;
  Eigen::MatrixXd by_columns;  // of one state
  std::vector<double> lanes;   // arrays by joints of a block of states
  std::unique_ptr<Floating> base;
};

namespace {

constexpr std::size_t kLanes = 8;    // fewer states are computed one by one
constexpr std::size_t kBlock = 128;  // states

/// A vector of n elements that `compute` fills.
template <class Compute>
std::vector<double> vector_of(int n, Compute compute) {
  std::vector<double> values(static_cast<std::size_t>(n));
  compute(Eigen::Map<Eigen::VectorXd>(values.data(), n));
  return values;
}

template <class Compute>
Matrix matrix_of(Eigen::Index rows, Eigen::Index columns, Compute compute) {
  Eigen::MatrixXd by_columns(rows, columns);
  compute(by_columns);
  Matrix m{static_cast<std::size_t>(rows), static_cast<std::size_t>(columns), {}};
  m.values.resize(m.rows * m.columns);
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(m.values.data(), rows, columns) =
      by_columns;
  return m;
}

Ellipsoid ellipsoid_of(const robot::Ellipsoid& from) {
  Ellipsoid to;
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(to.axes.data()) = from.axes;
  Eigen::Map<Eigen::Vector3d>(to.lengths.data()) = from.lengths;
  Eigen::Map<Eigen::Vector3d>(to.centre.data()) = from.centre;
  to.measure = from.measure();
  return to;
}

}  // namespace

std::string version() { return COTWIN_VERSION; }

Robot::Robot(const std::string& urdf) : impl_(std::make_unique<Impl>(master::urdf_of(urdf))) {}
Robot::~Robot() = default;
Robot::Robot(Robot&&) noexcept = default;
Robot& Robot::operator=(Robot&&) noexcept = default;

std::size_t Robot::n() const { return impl_->model.joints.size(); }

std::vector<JointInfo> Robot::joints() const {
  std::vector<JointInfo> all;
  for (const robot::Joint& j : impl_->model.joints)
    all.push_back({j.name, j.type == robot::JointType::kPrismatic, j.q_min, j.q_max, j.dq_max, j.tau_max});
  return all;
}

std::vector<std::string> Robot::frames() const {
  std::vector<std::string> names;
  for (const robot::Frame& frame : impl_->model.frames) names.push_back(frame.name);
  return names;
}

Matrix Robot::mass_matrix(std::span<const double> q) {
  const auto in = impl_->in(q, "q");
  return matrix_of(in.size(), in.size(), [&](Eigen::MatrixXd& M) { robot::mass_matrix(impl_->mechanism, impl_->data, in, M); });
}

std::vector<double> Robot::gravity(std::span<const double> q) {
  const auto in = impl_->in(q, "q");
  return vector_of(impl_->model.n(), [&](auto g) { robot::gravity(impl_->mechanism, impl_->data, in, g); });
}

std::vector<double> Robot::bias(std::span<const double> q, std::span<const double> dq) {
  const auto position = impl_->in(q, "q"), speed = impl_->in(dq, "dq");
  return vector_of(impl_->model.n(), [&](auto h) { robot::bias(impl_->mechanism, impl_->data, position, speed, h); });
}

std::vector<double> Robot::inverse_dynamics(std::span<const double> q, std::span<const double> dq,
                                            std::span<const double> ddq) {
  const auto position = impl_->in(q, "q"), speed = impl_->in(dq, "dq"), acceleration = impl_->in(ddq, "ddq");
  return vector_of(impl_->model.n(), [&](auto tau) {
    robot::inverse_dynamics(impl_->mechanism, impl_->data, position, speed, acceleration, tau);
  });
}

std::vector<double> Robot::forward_dynamics(std::span<const double> q, std::span<const double> dq,
                                            std::span<const double> tau) {
  const auto position = impl_->in(q, "q"), speed = impl_->in(dq, "dq"), torque = impl_->in(tau, "tau");
  return vector_of(impl_->model.n(),
                   [&](auto ddq) { robot::forward_dynamics(impl_->mechanism, impl_->data, position, speed, torque, ddq); });
}

FramePose Robot::forward_kinematics(std::span<const double> q, const std::string& frame) {
  const Pose X_BF = robot::forward_kinematics(impl_->mechanism, impl_->data, impl_->in(q, "q"), impl_->frame(frame));
  FramePose pose;
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(pose.R.data()) = X_BF.R;
  Eigen::Map<Eigen::Vector3d>(pose.p.data()) = X_BF.p;
  return pose;
}

Matrix Robot::jacobian(std::span<const double> q, const std::string& frame) {
  const auto in = impl_->in(q, "q");
  return matrix_of(6, in.size(),
                   [&](Eigen::MatrixXd& J) { robot::jacobian(impl_->mechanism, impl_->data, in, impl_->frame(frame), J); });
}

double Robot::effective_mass(std::span<const double> q, const std::array<double, 3>& u, const std::string& frame, Axes axes,
                             std::span<const double> motor_inertia) {
  const Impl::At at = impl_->at(q, u, frame, axes, motor_inertia);
  return robot::effective_mass(at.inertia, at.u);
}

double Robot::effective_inertia(std::span<const double> q, const std::array<double, 3>& u, const std::string& frame, Axes axes,
                                std::span<const double> motor_inertia) {
  const Impl::At at = impl_->at(q, u, frame, axes, motor_inertia);
  return robot::effective_inertia(at.inertia, at.u);
}

std::vector<double> Robot::effective_mass_gradient(std::span<const double> q, const std::array<double, 3>& u,
                                                   const std::string& frame, Axes axes, std::span<const double> motor_inertia) {
  Impl::At at = impl_->at(q, u, frame, axes, motor_inertia);
  const auto direction = axes == Axes::kFrame ? robot::Direction::kInFrame : robot::Direction::kInBase;
  return vector_of(impl_->model.n(), [&](auto gradient) {
    robot::effective_mass_gradient(impl_->mechanism, impl_->data, impl_->in(q, "q"), at.on, at.inertia, at.u, direction,
                                   gradient);
  });
}

Manipulability Robot::manipulability(std::span<const double> q, const std::string& frame) {
  const Impl::At at = impl_->at(q, {1, 0, 0}, frame, Axes::kBase, {});
  robot::Manipulability found(impl_->model.n());
  robot::kinematic_manipulability(at.inertia, found);
  return {ellipsoid_of(found.translation), ellipsoid_of(found.rotation)};
}

Manipulability Robot::dynamic_manipulability(std::span<const double> q, std::span<const double> dq,
                                             std::span<const double> tau_max, const std::string& frame,
                                             std::span<const double> motor_inertia) {
  const auto position = impl_->in(q, "q"), speed = impl_->in(dq, "dq"), torque = impl_->in(tau_max, "tau_max");
  for (const double tau : tau_max) {
    if (!(tau >= 0) || std::isinf(tau))
      throw Error("tau_max of " + impl_->model.name, "is " + text::to_text(tau) + ", expected a finite value >= 0");
  }
  Impl::At at = impl_->at(q, {1, 0, 0}, frame, Axes::kBase, motor_inertia);
  robot::Manipulability found(impl_->model.n());
  robot::dynamic_manipulability(impl_->mechanism, impl_->data, position, speed, at.on, at.inertia, torque, found);
  return {ellipsoid_of(found.translation), ellipsoid_of(found.rotation)};
}

std::size_t Robot::bodies() const { return static_cast<std::size_t>(impl_->mechanism.body_count()); }

std::vector<double> Robot::inertial_parameters() const {
  std::vector<double> pi;
  for (const robot::Body& body : impl_->model.bodies) {
    const auto of_body = body.inertia.parameters();
    pi.insert(pi.end(), of_body.begin(), of_body.end());
  }
  return pi;
}

void Robot::mass_matrix(std::span<const double> q, std::span<double> M) {
  Impl& r = *impl_;
  const std::size_t n = this->n(), count = r.states(q);
  r.check("M", M.size(), count, n * n);
  for (std::size_t s = 0; s < count; ++s) {  // symmetric: rows are columns
    robot::mass_matrix(r.mechanism, r.data, r.state(q, s),
                       Eigen::Map<Eigen::MatrixXd>(M.data() + s * n * n, r.model.n(), r.model.n()));
  }
}

void Robot::gravity(std::span<const double> q, std::span<double> g) {
  Impl& r = *impl_;
  const std::size_t count = r.states(q);
  r.check("g", g.size(), count, n());
  for (std::size_t s = 0; s < count; ++s) robot::gravity(r.mechanism, r.data, r.state(q, s), r.state(g, s));
}

void Robot::bias(std::span<const double> q, std::span<const double> dq, std::span<double> h) {
  Impl& r = *impl_;
  const std::size_t count = r.states(q);
  r.check("dq", dq.size(), count, n());
  r.check("h", h.size(), count, n());
  for (std::size_t s = 0; s < count; ++s) robot::bias(r.mechanism, r.data, r.state(q, s), r.state(dq, s), r.state(h, s));
}

void Robot::coriolis_matrix(std::span<const double> q, std::span<const double> dq, std::span<double> C) {
  Impl& r = *impl_;
  const std::size_t count = r.states(q);
  r.check("dq", dq.size(), count, n());
  r.check("C", C.size(), count, n() * n());
  for (std::size_t s = 0; s < count; ++s) {
    r.by_rows(C, s, r.model.n(), r.model.n(),
              [&](Eigen::MatrixXd& one) { robot::coriolis_matrix(r.mechanism, r.data, r.state(q, s), r.state(dq, s), one); });
  }
}

void Robot::inverse_dynamics(std::span<const double> q, std::span<const double> dq, std::span<const double> ddq,
                             std::span<double> tau) {
  Impl& r = *impl_;
  const std::size_t n = this->n(), count = r.states(q);
  r.check("dq", dq.size(), count, n);
  r.check("ddq", ddq.size(), count, n);
  r.check("tau", tau.size(), count, n);
  if (count < kLanes) {
    for (std::size_t s = 0; s < count; ++s)
      robot::inverse_dynamics(r.mechanism, r.data, r.state(q, s), r.state(dq, s), r.state(ddq, s), r.state(tau, s));
    return;
  }
  // Blocks of states that stay in the first cache, turned to arrays by joints and back.
  r.lanes.resize(4 * n * kBlock);
  double* const block[] = {r.lanes.data(), r.lanes.data() + n * kBlock, r.lanes.data() + 2 * n * kBlock,
                           r.lanes.data() + 3 * n * kBlock};
  for (std::size_t first = 0; first < count; first += kBlock) {
    const std::size_t size = std::min(kBlock, count - first);
    const double* const from[] = {q.data() + first * n, dq.data() + first * n, ddq.data() + first * n};
    for (int k = 0; k < 3; ++k) {
      for (std::size_t j = 0; j < n; ++j) {
        for (std::size_t s = 0; s < size; ++s) block[k][j * size + s] = from[k][s * n + j];
      }
    }
    robot::inverse_dynamics_batch(r.mechanism, r.data, size, block[0], block[1], block[2], block[3]);
    double* const to = tau.data() + first * n;
    for (std::size_t j = 0; j < n; ++j) {
      for (std::size_t s = 0; s < size; ++s) to[s * n + j] = block[3][j * size + s];
    }
  }
}

void Robot::inverse_dynamics_by_joint(std::span<const double> q, std::span<const double> dq, std::span<const double> ddq,
                                      std::span<double> tau) {
  Impl& r = *impl_;
  const std::size_t count = r.states(q);
  r.check("dq", dq.size(), count, n());
  r.check("ddq", ddq.size(), count, n());
  r.check("tau", tau.size(), count, n());
  robot::inverse_dynamics_batch(r.mechanism, r.data, count, q.data(), dq.data(), ddq.data(), tau.data());
}

void Robot::forward_dynamics(std::span<const double> q, std::span<const double> dq, std::span<const double> tau,
                             std::span<double> ddq) {
  Impl& r = *impl_;
  const std::size_t count = r.states(q);
  r.check("dq", dq.size(), count, n());
  r.check("tau", tau.size(), count, n());
  r.check("ddq", ddq.size(), count, n());
  for (std::size_t s = 0; s < count; ++s)
    robot::forward_dynamics(r.mechanism, r.data, r.state(q, s), r.state(dq, s), r.state(tau, s), r.state(ddq, s));
}

void Robot::regressor(std::span<const double> q, std::span<const double> dq, std::span<const double> ddq, std::span<double> Y) {
  Impl& r = *impl_;
  const std::size_t count = r.states(q), columns = 10 * bodies();
  r.check("dq", dq.size(), count, n());
  r.check("ddq", ddq.size(), count, n());
  r.check("Y", Y.size(), count, n() * columns);
  for (std::size_t s = 0; s < count; ++s) {
    r.by_rows(Y, s, r.model.n(), static_cast<Eigen::Index>(columns), [&](Eigen::MatrixXd& one) {
      robot::regressor(r.mechanism, r.data, r.state(q, s), r.state(dq, s), r.state(ddq, s), one);
    });
  }
}

void Robot::forward_kinematics(std::span<const double> q, const std::string& frame, std::span<double> R, std::span<double> p) {
  Impl& r = *impl_;
  const std::size_t count = r.states(q);
  r.check("R", R.size(), count, 9);
  r.check("p", p.size(), count, 3);
  const robot::FrameOnBody on = r.frame(frame);
  for (std::size_t s = 0; s < count; ++s) {
    const Pose X_BF = robot::forward_kinematics(r.mechanism, r.data, r.state(q, s), on);
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.data() + 9 * s) = X_BF.R;
    Eigen::Map<Eigen::Vector3d>(p.data() + 3 * s) = X_BF.p;
  }
}

void Robot::jacobian(std::span<const double> q, const std::string& frame, std::span<double> J) {
  Impl& r = *impl_;
  const std::size_t count = r.states(q);
  r.check("J", J.size(), count, 6 * n());
  const robot::FrameOnBody on = r.frame(frame);
  for (std::size_t s = 0; s < count; ++s) {
    r.by_rows(J, s, 6, r.model.n(),
              [&](Eigen::MatrixXd& one) { robot::jacobian(r.mechanism, r.data, r.state(q, s), on, one); });
  }
}

void Robot::floating_mass_matrix(std::span<const double> q, std::span<double> M) {
  impl_->floating(q, "M", M, impl_->model.n(),
                  [](Impl::Floating& base, auto, Eigen::MatrixXd& one) { one = base.inertia.M_star; });
}

void Robot::floating_jacobian(std::span<const double> q, const std::string& frame, std::span<double> J) {
  const robot::FrameOnBody on = impl_->frame(frame);
  impl_->floating(q, "J", J, 6, [&](Impl::Floating& base, const auto& at, Eigen::MatrixXd& one) {
    robot::generalised_jacobian(base.mechanism, base.data, base.inertia, at, on, one);
  });
}

void Robot::floating_rotation(std::span<const double> q, std::span<double> Z) {
  impl_->floating(q, "Z", Z, 3, [](Impl::Floating& base, auto, Eigen::MatrixXd& one) { one = base.inertia.Z(); });
}

}  // namespace cotwin
