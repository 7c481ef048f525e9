// Reduced dynamics of a 7-joint arm, in processor time of the thread. The unit of every row is the recursive Newton–Euler algorithm of Orocos KDL. Instruction
// sets that the machine lacks are left out. Usage: dynamics [robot.urdf]

#include <Eigen/Core>
#include <cmath>
#include <kdl/chain.hpp>
#include <kdl/chainidsolver_recursive_newton_euler.hpp>
#include <random>
#include <string>
#include <vector>

#include "models/robot/dynamics.h"
#include "models/robot/kernels/kernels.h"
#include "models/robot/urdf.h"
#include "models/support/error.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using namespace cotwin::robot;

constexpr int kBatches = 31;
constexpr double kBatchSeconds = 2e-3;
constexpr int kStates = 256;  // several states in turn, so that branch prediction cannot learn a single one

KDL::Vector kdl(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
KDL::Frame kdl(const Pose& X) {
  return {KDL::Rotation(X.R(0, 0), X.R(0, 1), X.R(0, 2), X.R(1, 0), X.R(1, 1), X.R(1, 2), X.R(2, 0), X.R(2, 1), X.R(2, 2)),
          kdl(X.p)};
}

/// The same robot as a KDL chain. The frame of a KDL segment is at its tip, where the next joint is at q = 0.
KDL::Chain kdl_chain(const RobotModel& robot) {
  KDL::Chain chain;
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    const Joint& joint = robot.joints[i];
    const Inertia& b = robot.bodies[i].inertia;
    const KDL::RotationalInertia I(b.I_CC(0, 0), b.I_CC(1, 1), b.I_CC(2, 2), b.I_CC(0, 1), b.I_CC(0, 2), b.I_CC(1, 2));
    const KDL::Joint turn(joint.name, kdl(joint.X_PJ.p), kdl(joint.X_PJ.R * joint.axis), KDL::Joint::RotAxis);
    chain.addSegment(KDL::Segment(robot.bodies[i].name, turn, kdl(joint.X_PJ), KDL::RigidBodyInertia(b.mass, kdl(b.p_LC), I)));
  }
  return chain;
}

struct States {
  std::vector<Eigen::VectorXd> q, dq, ddq, tau;
  std::vector<KDL::JntArray> kdl_q, kdl_dq, kdl_ddq;
  Eigen::MatrixXd by_joint_q, by_joint_dq, by_joint_ddq;  // for the batch: state x joint, column-major

  explicit States(int n) : by_joint_q(kStates, n), by_joint_dq(kStates, n), by_joint_ddq(kStates, n) {
    std::mt19937_64 engine(1);
    const auto draw = [&](double limit) {
      Eigen::VectorXd v(n);
      for (double& x : v) x = limit * (2 * static_cast<double>(engine() >> 11) * 0x1p-53 - 1);
      return v;
    };
    const auto of_kdl = [n](const Eigen::VectorXd& v) {
      KDL::JntArray a(static_cast<unsigned>(n));
      a.data = v;
      return a;
    };
    for (int s = 0; s < kStates; ++s) {
      q.push_back(draw(3));
      dq.push_back(draw(2));
      ddq.push_back(draw(4));
      tau.push_back(draw(50));
      kdl_q.push_back(of_kdl(q.back()));
      kdl_dq.push_back(of_kdl(dq.back()));
      kdl_ddq.push_back(of_kdl(ddq.back()));
      by_joint_q.row(s) = q.back();
      by_joint_dq.row(s) = dq.back();
      by_joint_ddq.row(s) = ddq.back();
    }
  }
};

}  // namespace

int main(int argc, char** argv) {
  const std::string file = argc > 1 ? argv[1] : cotwin::places::source() + "/models/robots/lwr4/robot.urdf";
  const RobotModel robot = load_urdf(file);
  const int n = robot.n();
  const States states(n);

  const KDL::Chain chain = kdl_chain(robot);
  KDL::ChainIdSolver_RNE peer(chain, kdl(robot.gravity));
  const KDL::Wrenches no_wrenches(chain.getNrOfSegments(), KDL::Wrench::Zero());
  KDL::JntArray kdl_tau(static_cast<unsigned>(n));
  std::size_t peer_state = 0;
  const auto kdl_inverse_dynamics = [&] {
    const std::size_t s = peer_state++ % kStates;
    peer.CartToJnt(states.kdl_q[s], states.kdl_dq[s], states.kdl_ddq[s], no_wrenches, kdl_tau);
    benchmark::keep(kdl_tau);
  };

  std::vector<std::string> isas{choose_kernels(n, true, "x86-64-v4").isa, choose_kernels(n, true, "x86-64-v3").isa,
                                choose_kernels(n, true, "x86-64-v2").isa};
  isas.erase(std::unique(isas.begin(), isas.end()), isas.end());
  for (const std::string& isa : isas) {
    const Mechanism mechanism(robot, isa.c_str());
    Data data(mechanism);
    const FrameOnBody tool = on_body(robot.end_effector());
    Eigen::VectorXd out(n);
    Eigen::MatrixXd M(n, n), A(n, n), J(6, n), Y(n, 10 * n), taus(kStates, n);
    Eigen::Matrix<double, 6, 6> Lambda;

    for (std::size_t s = 0; s < kStates; ++s) {  // check that the peer has the same robot
      peer.CartToJnt(states.kdl_q[s], states.kdl_dq[s], states.kdl_ddq[s], no_wrenches, kdl_tau);
      inverse_dynamics(mechanism, data, states.q[s], states.dq[s], states.ddq[s], out);
      if ((out - kdl_tau.data).norm() > 1e-9 * (1 + out.norm())) throw Error(file, "KDL's torque differs from ours");
    }

    const auto row = [&](const char* what, double goal, auto function) {
      std::size_t state = 0;
      const auto figures = benchmark::measure([&] { function(state++ % kStates); }, kdl_inverse_dynamics, kBatches,
                                              kBatchSeconds, benchmark::thread_seconds);
      benchmark::print({std::string(what) + ", " + std::to_string(n) + " joints, " + isa, "ns", 1e9 * figures.ours,
                        "KDL inverse dynamics", 1e9 * figures.peer, goal});
    };
    row("inverse dynamics", 0.11, [&](std::size_t s) {
      inverse_dynamics(mechanism, data, states.q[s], states.dq[s], states.ddq[s], out);
      benchmark::keep(out);
    });
    row("mass matrix", 0.11, [&](std::size_t s) {
      mass_matrix(mechanism, data, states.q[s], M);
      benchmark::keep(M);
    });
    row("forward kinematics and Jacobian", 0.06, [&](std::size_t s) {
      benchmark::keep(jacobian(mechanism, data, states.q[s], tool, J));
      benchmark::keep(J);
    });
    row("forward dynamics", 0.33, [&](std::size_t s) {
      forward_dynamics(mechanism, data, states.q[s], states.dq[s], states.tau[s], out);
      benchmark::keep(out);
    });
    row("J M^-1 J^T", 0.33, [&](std::size_t s) {
      operational_inertia_inverse(mechanism, data, states.q[s], tool, Lambda);
      benchmark::keep(Lambda);
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
    const auto batch = benchmark::measure(
        [&] {
          inverse_dynamics_batch(mechanism, data, kStates, states.by_joint_q.data(), states.by_joint_dq.data(),
                                 states.by_joint_ddq.data(), taus.data());
          benchmark::keep(taus);
        },
        kdl_inverse_dynamics, kBatches, kBatchSeconds, benchmark::thread_seconds);
    benchmark::print({"inverse dynamics in a batch, per state, " + std::to_string(n) + " joints, " + isa, "ns",
                      1e9 * batch.ours / kStates, "KDL inverse dynamics", 1e9 * batch.peer, 0.025});
  }
  return 0;
}
