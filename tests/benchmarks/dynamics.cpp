// Reduced dynamics of a 7-joint arm, in processor time of the thread, against the same functions of Orocos KDL and MuJoCo, and
// against KDL's inverse dynamics as the unit of the goals. COTWIN_CPU chooses another instruction set. Usage:
// dynamics [robot.urdf]

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/robot/dynamics.h"
#include "models/robot/floating_base.h"
#include "models/robot/urdf/urdf.h"
#include "tests/benchmarks/dynamics_peers.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using namespace cotwin::robot;

constexpr int kBatches = 31;
constexpr double kBatchSeconds = 2e-3;
constexpr int kStates = 256;  // several states in turn, so that branch prediction cannot learn a single one

struct OwnStates : benchmark::States {
  Eigen::MatrixXd by_joint_q, by_joint_dq, by_joint_ddq;  // for the batch: state x joint, column-major

  explicit OwnStates(int n) : by_joint_q(kStates, n), by_joint_dq(kStates, n), by_joint_ddq(kStates, n) {
    std::mt19937_64 engine(1);
    const auto draw = [&](double limit) {
      Eigen::VectorXd v(n);
      for (double& x : v) x = limit * (2 * static_cast<double>(engine() >> 11) * 0x1p-53 - 1);
      return v;
    };
    for (int s = 0; s < kStates; ++s) {
      q.push_back(draw(3));
      dq.push_back(draw(2));
      ddq.push_back(draw(4));
      tau.push_back(draw(50));
      by_joint_q.row(s) = q.back();
      by_joint_dq.row(s) = dq.back();
      by_joint_ddq.row(s) = ddq.back();
    }
  }
};

/// The robot with six joints that move its base: three slides, then turns about x, y and z.
RobotModel with_base_joints(const RobotModel& robot) {
  RobotModel moved = robot;
  moved.gravity.setZero();
  for (Joint& joint : moved.joints) joint.parent += 6;
  for (int i = 5; i >= 0; --i) {
    Joint joint;
    joint.parent = i - 1;
    joint.type = i < 3 ? JointType::kPrismatic : JointType::kRevolute;
    joint.axis = Eigen::Vector3d::Unit(i % 3);
    moved.joints.insert(moved.joints.begin(), joint);
    moved.bodies.insert(moved.bodies.begin(), Body{});
  }
  moved.bodies[5] = robot.base;
  for (Frame& frame : moved.frames) frame.body += 6;
  return moved;
}

/// Z, M* and J* together, against KDL's mass matrix and Jacobian of the robot with the joints of its base, from which Eigen eliminates the
/// base.
void free_base(const RobotModel& robot) {
  const int n = robot.n();
  const FrameOnBody tool = on_body(robot.end_effector());
  const RobotModel moved = with_base_joints(robot);
  OwnStates states(n + 6);
  for (Eigen::VectorXd& q : states.q) q.head<6>().setZero();
  const auto kdl = benchmark::make_kdl(moved, states);
  const FloatingMechanism mechanism(robot);
  FloatingData data(mechanism);
  FloatingInertia inertia(n);
  Eigen::MatrixXd J(6, n), A(6, n), M(n, n), J_kdl(6, n);
  const auto ours = [&](std::size_t s) {
    floating_inertia(mechanism, data, states.q[s].tail(n), inertia);
    generalised_jacobian(mechanism, data, inertia, states.q[s].tail(n), tool, J);
    benchmark::keep(J);
  };
  const auto theirs = [&](std::size_t s) {
    kdl->mass_matrix(s);
    kdl->jacobian(s);
    A = -kdl->M.topLeftCorner<6, 6>().llt().solve(kdl->M.topRightCorner(6, n));
    M = kdl->M.bottomRightCorner(n, n);
    M.noalias() += kdl->M.bottomLeftCorner(n, 6).lazyProduct(A);
    J_kdl = kdl->J.rightCols(n);
    J_kdl.noalias() += kdl->J.leftCols<6>().lazyProduct(A);
    benchmark::keep(J_kdl);
  };
  for (std::size_t s = 0; s < kStates; ++s) {
    ours(s);
    theirs(s);
    const double difference = (inertia.A - A).norm() + (inertia.M_star - M).norm() + (J - J_kdl).norm();
    if (difference > 1e-8) throw Error(robot.name, "of a free base, KDL differs from ours by " + std::to_string(difference));
  }
  std::size_t state = 0, peer_state = 0;
  const auto figures = benchmark::measure([&] { ours(state++ % kStates); }, [&] { theirs(peer_state++ % kStates); }, kBatches,
                                          kBatchSeconds, benchmark::thread_seconds);
  benchmark::print({"Z, M* and J* of a free base, " + std::to_string(n) + " joints", "ns", 1e9 * figures.ours,
                    "KDL and Eigen, the same", 1e9 * figures.peer, 0.3});
}

}  // namespace

int main(int argc, char** argv) {
  const std::string file = argc > 1 ? argv[1] : cotwin::places::source() + "/models/robots/lwr4/robot.urdf";
  const RobotModel robot = load_urdf(file);
  const int n = robot.n();
  const OwnStates states(n);
  std::vector<std::unique_ptr<benchmark::DynamicsPeer>> peers;
  peers.push_back(benchmark::make_kdl(robot, states));
  if (auto mujoco = benchmark::make_mujoco_dynamics(file, robot, states)) peers.push_back(std::move(mujoco));
  benchmark::DynamicsPeer& unit = *peers.front();
  std::size_t unit_state = 0;
  const auto kdl_inverse_dynamics = [&] {
    unit.inverse_dynamics(unit_state++ % kStates);
    benchmark::keep(unit.out);
  };

  const Mechanism mechanism(robot);
  Data data(mechanism);
  const FrameOnBody tool = on_body(robot.end_effector());
  Eigen::VectorXd out(n);
  Eigen::MatrixXd M(n, n), A(n, n), J(6, n), Y(n, 10 * n), taus(kStates, n);

  for (std::size_t s = 0; s < kStates; ++s) {  // check that the peers have the same robot and the same functions
    for (const auto& peer : peers) {
      const auto equal = [&](const char* what, const auto& ours, const auto& theirs, double tolerance = 1e-9) {
        const double difference = (ours - theirs).norm() / (1 + ours.norm());
        if (difference <= tolerance) return;
        throw Error(file, peer->name() + "'s " + what + " differs from ours by " + std::to_string(1e9 * difference) + "e-9");
      };
      inverse_dynamics(mechanism, data, states.q[s], states.dq[s], states.ddq[s], out);
      peer->inverse_dynamics(s);
      equal("torque", out, peer->out);
      mass_matrix(mechanism, data, states.q[s], M);
      peer->mass_matrix(s);
      equal("mass matrix", M, peer->M);
      jacobian(mechanism, data, states.q[s], tool, J);
      peer->jacobian(s);
      equal("Jacobian", J, peer->J);
      forward_dynamics(mechanism, data, states.q[s], states.dq[s], states.tau[s], out);
      peer->forward_dynamics(s);
      equal("acceleration", out, peer->out, 1e-7);  // the mass matrix has a condition of 1e3
    }
  }

  const auto name = [&](const char* what) { return std::string(what) + ", " + std::to_string(n) + " joints"; };
  // Against KDL's inverse dynamics, the unit of the goals.
  const auto row = [&](const char* what, double goal, auto function) {
    std::size_t state = 0;
    const auto figures = benchmark::measure([&] { function(state++ % kStates); }, kdl_inverse_dynamics, kBatches, kBatchSeconds,
                                            benchmark::thread_seconds);
    benchmark::print({name(what), "ns", 1e9 * figures.ours, "KDL inverse dynamics", 1e9 * figures.peer, goal});
  };
  // The same, and against the same function of each peer.
  const auto rows = [&](const char* what, double goal, auto theirs, auto function) {
    row(what, goal, function);
    for (const auto& peer : peers) {
      std::size_t state = 0, peer_state = 0;
      const auto figures = benchmark::measure([&] { function(state++ % kStates); },
                                              [&] {
                                                (*peer.*theirs)(peer_state++ % kStates);
                                                benchmark::keep(*peer);
                                              },
                                              kBatches, kBatchSeconds, benchmark::thread_seconds);
      benchmark::print({name(what), "ns", 1e9 * figures.ours, peer->name() + ", the same", 1e9 * figures.peer, 1});
    }
  };
  rows("inverse dynamics", 0.11, &benchmark::DynamicsPeer::inverse_dynamics, [&](std::size_t s) {
    inverse_dynamics(mechanism, data, states.q[s], states.dq[s], states.ddq[s], out);
    benchmark::keep(out);
  });
  rows("mass matrix", 0.11, &benchmark::DynamicsPeer::mass_matrix, [&](std::size_t s) {
    mass_matrix(mechanism, data, states.q[s], M);
    benchmark::keep(M);
  });
  rows("forward kinematics and Jacobian", 0.06, &benchmark::DynamicsPeer::jacobian, [&](std::size_t s) {
    benchmark::keep(jacobian(mechanism, data, states.q[s], tool, J));
    benchmark::keep(J);
  });
  rows("forward dynamics", 0.33, &benchmark::DynamicsPeer::forward_dynamics, [&](std::size_t s) {
    forward_dynamics(mechanism, data, states.q[s], states.dq[s], states.tau[s], out);
    benchmark::keep(out);
  });
  row("Coriolis matrix", 0.35, [&](std::size_t s) {
    coriolis_matrix(mechanism, data, states.q[s], states.dq[s], M);
    benchmark::keep(M);
  });
  row("regressor", 0.35, [&](std::size_t s) {
    regressor(mechanism, data, states.q[s], states.dq[s], states.ddq[s], Y);
    benchmark::keep(Y);
  });
  row("derivatives of inverse dynamics", 0.55, [&](std::size_t s) {
    inverse_dynamics_derivatives(mechanism, data, states.q[s], states.dq[s], states.ddq[s], M, A);
    benchmark::keep(M);
  });
  free_base(robot);
  const auto batch = benchmark::measure(
      [&] {
        inverse_dynamics_batch(mechanism, data, kStates, states.by_joint_q.data(), states.by_joint_dq.data(),
                               states.by_joint_ddq.data(), taus.data());
        benchmark::keep(taus);
      },
      kdl_inverse_dynamics, kBatches, kBatchSeconds, benchmark::thread_seconds);
  benchmark::print({"inverse dynamics in a batch, per state, " + std::to_string(n) + " joints", "ns",
                    1e9 * batch.ours / kStates, "KDL inverse dynamics", 1e9 * batch.peer, 0.025});
  return 0;
}
