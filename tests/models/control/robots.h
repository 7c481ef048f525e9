#pragma once
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <string>

#include "models/control/null_space.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/places.h"

/// Robots of all kinds for tests of models/control.
namespace cotwin::control::testing {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using robot::testing::Draw;
using robot::testing::Kind;

/// Seconds h for central differences along a motion: h q̇ has no element beyond 1e-4 rad (m), so the error is about 1e-9 of the
/// rate. 0 at rest.
inline double rate_step(const VectorXd& dq) {
  const double most = dq.lpNorm<Eigen::Infinity>();
  return most > 0 ? 1e-4 / most : 0;
}

/// N_r of a decomposed cascade, column by column.
inline MatrixXd projector(Cascade& cascade) {
  MatrixXd N = MatrixXd::Identity(cascade.n(), cascade.n());
  for (int j = 0; j < cascade.n(); ++j) cascade.project(N.col(j));
  return N;
}

struct Robot {
  Robot(const robot::RobotModel& robot, double motors)
      : model(robot), n(robot.n()), mechanism(robot), data(mechanism), B(motors) {}
  Robot(const std::string& name, double motors)
      : Robot(robot::load_urdf(places::source() + "/models/robots/" + name + "/robot.urdf"), motors) {}

  /// M + B.
  MatrixXd metric(const VectorXd& q) {
    MatrixXd M(n, n);
    robot::mass_matrix(mechanism, data, q, M);
    M.diagonal().array() += B;
    return M;
  }
  MatrixXd metric_rate(const VectorXd& q, const VectorXd& dq) {
    MatrixXd C(n, n);
    robot::coriolis_matrix(mechanism, data, q, dq, C);
    return C + C.transpose();
  }
  robot::FrameOnBody frame(int body) const {
    for (const robot::Frame& f : model.frames)
      if (f.body == body) return robot::on_body(f);
    return {body, {}};
  }
  MatrixXd jacobian(const VectorXd& q, int body) {
    MatrixXd J(6, n);
    robot::jacobian(mechanism, data, q, frame(body), J);
    return J;
  }
  /// Rows `first` … of the twist of a frame on `body`, −1: the last joint's; rotation scaled with 0.3 m. a: −J̇ q̇.
  void fill(Task& task, const VectorXd& q, const VectorXd& dq, int first, int body = -1) {
    if (body < 0) body = n - 1;
    const auto m = task.J.rows();
    task.J = jacobian(q, body).middleRows(first, m);
    const double h = rate_step(dq);
    task.dJ.setZero();
    if (h > 0) task.dJ = (jacobian(q + h * dq, body) - jacobian(q - h * dq, body)).middleRows(first, m) / (2 * h);
    for (int i = 0; i < m; ++i) task.scale[i] = first + i < 3 ? 1 : 0.3;
    Twist drift;
    robot::jacobian_dot_times_dq(mechanism, data, q, dq, frame(body), drift);
    task.a = -drift.segment(first, m);
  }

  robot::RobotModel model;
  int n;
  robot::Mechanism mechanism;
  robot::Data data;
  double B;
};

/// The pose of the specification, (0, 30, 0, −60, 0, 60, 0)°.
inline VectorXd lwr4_pose() { return (VectorXd(7) << 0, 30, 0, -60, 0, 60, 0).finished() * std::acos(-1.0) / 180; }

/// A chain whose last joint follows its second.
inline robot::RobotModel chain_with_mimic(Draw& draw, int joints) {
  robot::RobotModel robot = draw.robot(Kind::kMixedChain, joints);
  robot.mimics.push_back({robot.joints.back(), 1, draw.number(-2, 2), 0.3, joints - 1});
  robot.joints.pop_back();
  return robot;
}

/// Calls `f(robot, draw, checked)` for 60 random states of each of 45 robots. `f` counts in `checked` the states that it does not leave out, as
/// many of which as `share` of all are expected.
template <class F>
void sweep_robots(double share, F f) {
  Draw draw(5);
  int checked = 0, all = 0;
  const auto run = [&](Robot robot, const std::string& name) {
    for (int i = 0; i < 60; ++i) {
      SCOPED_TRACE(name + ", state " + std::to_string(i));
      f(robot, draw, checked);
      ++all;
      if (::testing::Test::HasFailure()) return;
    }
  };
  run(Robot("lwr4", 0), "lwr4");
  run(Robot("lwr4", 0.05), "lwr4 with motors");
  run(Robot("planar2", 0), "planar2");
  run(Robot("kr300_r2500", 0), "kr300_r2500");
  run(Robot("kr300_r2500", 50), "kr300_r2500 with motors");
  for (int i = 0; i < 20; ++i) {
    const Kind kind = i % 3 == 0 ? Kind::kChain : i % 3 == 1 ? Kind::kMixedChain : Kind::kTree;
    run(Robot(draw.robot(kind, draw.integer(2, 12)), 0), "random robot " + std::to_string(i));
    run(Robot(chain_with_mimic(draw, draw.integer(4, 9)), 0), "robot with a mimic " + std::to_string(i));
  }
  EXPECT_GE(checked, share * all) << "of " << all;
}

}  // namespace cotwin::control::testing
