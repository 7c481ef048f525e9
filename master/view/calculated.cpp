#include "master/view/calculated.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "models/robot/indices.h"

namespace cotwin::master {

namespace {

constexpr double kSoftest = 1e-6;   // N.m/rad, of a joint without stiffness
constexpr double kSingular = 1e-9;  // m/N, added where the joints cannot move the tip: a stiffness of 1e9 N/m

/// A robot whose base recoils.
struct Floating {
  explicit Floating(const robot::RobotModel& robot)
      : mechanism(robot), data(mechanism), inertia(robot.n()), tip(robot.n() + 6), J(6, robot.n()) {}
  void place(const Eigen::VectorXd& q, const robot::FrameOnBody& frame) {
    robot::frame_inertia(mechanism, data, q, Eigen::VectorXd(0), frame, tip);
    robot::floating_inertia(mechanism, data, q, inertia);
    robot::generalised_jacobian(mechanism, data, inertia, q, frame, J);
  }
  robot::FloatingMechanism mechanism;
  robot::FloatingData data;
  robot::FloatingInertia inertia;
  robot::FrameInertia tip;
  robot::Matrix6X J;
};

void add(MatrixOverTime& matrices, const Eigen::Matrix3d& M) {
  const double values[] = {M(0, 0), M(0, 1), M(0, 2), M(1, 1), M(1, 2), M(2, 2)};
  for (std::size_t k = 0; k < matrices.size(); ++k) matrices[k].push_back(values[k]);
}

Eigen::Matrix3d stiffness_of(const Compliant& given, const Eigen::Ref<const Eigen::MatrixXd>& J_v,
                             const Eigen::Matrix3d& R_BE) {
  if (given.frame) {
    const Eigen::Matrix3d S = Eigen::Map<const Eigen::Vector3d>(given.frame->data()).asDiagonal();
    return given.in_tool ? Eigen::Matrix3d(R_BE * S * R_BE.transpose()) : S;
  }
  Eigen::VectorXd softness(J_v.cols());
  for (Eigen::Index i = 0; i < softness.size(); ++i)
    softness[i] = 1 / std::max(kSoftest, given.joints[static_cast<std::size_t>(i)]);
  Eigen::Matrix3d C = J_v * softness.asDiagonal() * J_v.transpose();
  C.diagonal().array() += kSingular;
  return C.inverse();
}

}  // namespace

std::vector<std::size_t> chosen_rows(const Recorded& recorded, double per_second, std::size_t most) {
  std::vector<std::size_t> rows;
  if (recorded.time.empty()) return rows;
  const double duration = static_cast<double>(recorded.time.back() - recorded.time.front()) * 1e-9;
  const double wanted = std::min(static_cast<double>(most - 1), std::max(1.0, std::ceil(duration * per_second)));
  const double stride = std::max(1.0, static_cast<double>(recorded.time.size() - 1) / wanted);
  for (double row = 0; row <= static_cast<double>(recorded.time.size() - 1) + 1e-6; row += stride)
    rows.push_back(std::min(recorded.time.size() - 1, static_cast<std::size_t>(std::lround(row))));
  if (rows.back() != recorded.time.size() - 1) rows.push_back(recorded.time.size() - 1);
  return rows;
}

TipMatrices tip_matrices(const robot::RobotModel& robot, const Recorded& recorded, const RecordedSignal& signal,
                         const std::vector<std::size_t>& rows,
                         const std::function<std::optional<Compliant>(std::size_t)>& compliant, bool floating) {
  TipMatrices matrices;
  const robot::Mechanism mechanism(robot);
  robot::Data data(mechanism);
  robot::FrameInertia tip(robot.n());
  const robot::FrameOnBody frame = robot::on_body(robot.end_effector());
  std::optional<Floating> base;
  if (floating) base.emplace(robot);
  const bool has_masses = std::ranges::all_of(robot.bodies, [](const robot::Body& body) { return body.inertia.mass > 0; });
  if (has_masses) matrices.mobility.emplace();
  if (!rows.empty() && compliant(rows.front())) matrices.stiffness.emplace();
  const Eigen::VectorXd free = Eigen::VectorXd(0);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(robot.n());
  for (const std::size_t row : rows) {
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      const double value = recorded.column(signal, static_cast<std::size_t>(i))[row];
      if (std::isfinite(value)) q[i] = value;
    }
    robot::frame_inertia(mechanism, data, q, free, frame, tip);
    const Eigen::Ref<const Eigen::MatrixXd> J_v = tip.J.topRows<3>();
    if (base) base->place(q, frame);
    const Eigen::Ref<const Eigen::MatrixXd> free_v = base ? base->J.topRows<3>() : tip.J.topRows<3>();
    add(matrices.velocity, free_v * free_v.transpose());
    if (matrices.mobility) add(*matrices.mobility, (base ? base->tip : tip).Lambda_inverse.topLeftCorner<3, 3>());
    if (matrices.stiffness) {
      const std::optional<Compliant> given = compliant(row);
      add(*matrices.stiffness, given ? stiffness_of(*given, J_v, tip.X_BF.R) : Eigen::Matrix3d::Zero().eval());
    }
  }
  if (matrices.mobility) {
    for (const std::vector<double>& values : *matrices.mobility) {
      if (std::ranges::any_of(values, [](double x) { return !std::isfinite(x); })) {
        matrices.mobility.reset();
        break;
      }
    }
  }
  return matrices;
}

}  // namespace cotwin::master
