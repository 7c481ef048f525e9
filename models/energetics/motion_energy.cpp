#include "models/energetics/motion_energy.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"
#include "models/robot/drives/rigid_friction.h"

namespace cotwin::energetics {
namespace {

/// Places at which a path is divided, and the states at the nodes between them. Arrays by joint: joint j of node s at [j · count + s].
struct Nodes {
  std::vector<double> cuts;
  std::size_t n = 0, count = 0;            // joints, nodes
  std::vector<double> s, q, dq, ddq, tau;  // s: share of the motion
  double length(std::size_t k) const { return cuts[k + 1] - cuts[k]; }
};

/// The time in [a, b] at which the joint's velocity changes its sign.
double reversal(const trajectory::Path& path, std::size_t joint, double a, double b, std::vector<double>& q,
                std::vector<double>& dq, std::vector<double>& ddq) {
  const auto velocity = [&](double t) {
    path.at(t, q, dq, ddq);
    return dq[joint];
  };
  const bool rises = velocity(a) < 0;
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (a + b);
    if (!(middle > a && middle < b)) break;
    ((velocity(middle) < 0) == rises ? a : b) = middle;
  }
  return 0.5 * (a + b);
}

Nodes make_nodes(const RigidRobot& robot, const trajectory::Path& path, MotionGrid grid) {
  if (path.joints() != robot.n()) {
    throw Error("motion", "has " + std::to_string(path.joints()) + " joints, expected " + std::to_string(robot.n()));
  }
  if (grid.intervals < 1) throw Error("motion", std::to_string(grid.intervals) + " intervals, expected at least 1");
  Nodes nodes;
  nodes.n = robot.n();
  std::vector<double> q(nodes.n), dq(nodes.n), ddq(nodes.n), before(nodes.n);
  std::vector<double>& cuts = nodes.cuts;
  const auto times = path.times();
  for (std::size_t k = 0; k + 1 < times.size(); ++k) {
    for (int part = 0; part < grid.intervals; ++part) {
      const double a = times[k] + (times[k + 1] - times[k]) * part / grid.intervals;
      const double b = times[k] + (times[k + 1] - times[k]) * (part + 1) / grid.intervals;
      cuts.push_back(a);
      path.at(a, q, before, ddq);
      path.at(b, q, dq, ddq);
      const std::vector<double> after = dq;
      for (std::size_t j = 0; j < nodes.n; ++j) {
        if (before[j] * after[j] < 0) cuts.push_back(reversal(path, j, a, b, q, dq, ddq));
      }
    }
  }
  cuts.push_back(times.back());
  const double begin = times.front(), T = times.back() - begin;
  for (const double s : robot.dynamics.begins()) cuts.push_back(begin + s * T);
  std::ranges::sort(cuts);
  nodes.count = (cuts.size() - 1) * kNodes;
  for (auto* v : {&nodes.q, &nodes.dq, &nodes.ddq, &nodes.tau}) v->resize(nodes.n * nodes.count);
  for (std::size_t k = 0; k + 1 < cuts.size(); ++k) {
    for (std::size_t g = 0; g < kNodes; ++g) {
      const double t = cuts[k] + kNode[g] * nodes.length(k);
      path.at(t, q, dq, ddq);
      nodes.s.push_back((t - begin) / T);
      for (std::size_t j = 0; j < nodes.n; ++j) {
        const std::size_t at = j * nodes.count + k * kNodes + g;
        nodes.q[at] = q[j];
        nodes.dq[at] = dq[j];
        nodes.ddq[at] = ddq[j];
      }
    }
  }
  return nodes;
}

/// What the motion adds to kinetic and potential energy, in each phase with the bodies that the robot then has.
void add_energies(const RigidRobot& robot, robot::Data& data, const trajectory::Path& path, double stretch,
                  MotionEnergy& energy) {
  const auto n = static_cast<Eigen::Index>(robot.n());
  Eigen::VectorXd q(n), dq(n), ddq(n);
  std::vector<double> shares = robot.dynamics.begins();
  shares.push_back(1);
  for (std::size_t phase = 0; phase + 1 < shares.size(); ++phase) {
    const robot::Mechanism& mechanism = robot.dynamics.mechanism(shares[phase]);
    for (const double side : {-1.0, 1.0}) {
      const double s = shares[phase + (side < 0 ? 0 : 1)];
      path.at(s < 1 ? path.begin() + s * (path.end() - path.begin()) : path.end(), {q.data(), robot.n()},
              {dq.data(), robot.n()}, {ddq.data(), robot.n()});
      dq /= stretch;
      double kinetic = kinetic_energy(mechanism, data, q, dq);
      for (std::size_t j = 0; j < robot.n(); ++j) {
        const double v = dq[static_cast<Eigen::Index>(j)];
        kinetic += 0.5 * robot.B[j] * v * v;
      }
      energy.kinetic += side * kinetic;
      energy.potential += side * potential_energy(mechanism, data, q);
    }
  }
}

}  // namespace

RigidRobot::RigidRobot(const robot::RobotModel& robot, const robot::Loads& loads)
    : dynamics(robot, loads), B(static_cast<std::size_t>(robot.n())), tau_C(B), sigma(B), tau_0(B), passive(B.size()) {
  for (std::size_t j = 0; j < n(); ++j) passive[j] = robot.joints[j].passive;
}

RigidRobot::RigidRobot(const robot::RobotModel& robot, const robot::DriveParameters& p) : RigidRobot(robot) {
  for (std::size_t j = 0; j < n(); ++j) {
    if (passive[j]) continue;
    B[j] = p.B[j];
    tau_C[j] = p.tau_C[j] + p.link_tau_C[j];
    sigma[j] = p.sigma2[j] + p.link_sigma2[j];
    tau_0[j] = p.tau_0[j] + p.link_tau_0[j];
  }
}

MotionEnergy energy_of_motion(const RigidRobot& robot, const trajectory::Path& path, Accountant& accountant,
                              const Standby& standby, double stretch, double V, MotionGrid grid) {
  if (!(stretch > 0 && std::isfinite(stretch)))
    throw Error("stretch", text::to_text(stretch) + ", expected a finite value > 0");
  accountant.check("drives");
  accountant.adopt();
  Nodes nodes = make_nodes(robot, path, grid);
  for (double& dq : nodes.dq) dq /= stretch;
  for (double& ddq : nodes.ddq) ddq /= stretch * stretch;
  robot::LoadedDynamics::Scratch scratch(robot.dynamics);
  robot.dynamics.inverse_dynamics(scratch, nodes.count, nodes.s.data(), nodes.q.data(), nodes.dq.data(), nodes.ddq.data(),
                                  nodes.tau.data());
  const std::size_t n = robot.n();
  MotionEnergy energy;
  energy.books = EnergyBooks(n);
  energy.V = V > 0 ? V : accountant.link.V_min;
  for (std::size_t k = 0; k + 1 < nodes.cuts.size(); ++k) {
    const double h = stretch * nodes.length(k);
    if (!(h > 0)) continue;  // several joints reverse at the same time
    for (std::size_t g = 0; g < kNodes; ++g) {
      const std::size_t own = k * kNodes + g;
      if (robot.dynamics.pushed(nodes.s[own])) {
        for (std::size_t j = 0; j < n; ++j) scratch.q[static_cast<Eigen::Index>(j)] = nodes.q[j * nodes.count + own];
        const Eigen::VectorXd& tau_e = robot.dynamics.wrench_torque(scratch, nodes.s[own], scratch.q);
        for (std::size_t j = 0; j < n; ++j)
          energy.external += h * kWeight[g] * tau_e[static_cast<Eigen::Index>(j)] * nodes.dq[j * nodes.count + own];
      }
      for (std::size_t j = 0; j < n; ++j) {
        const std::size_t at = j * nodes.count + own, node = g * n + j;
        const double dq = nodes.dq[at];
        const double tau_f = robot::rigid_friction(robot.tau_C[j], robot.sigma[j], robot.tau_0[j], robot::coulomb_sign(dq), dq);
        accountant.tau[node] = robot.passive[j] ? 0 : nodes.tau[at] + robot.B[j] * nodes.ddq[at] + tau_f;
        accountant.speed[node] = dq;
        energy.friction += h * kWeight[g] * tau_f * dq;
      }
    }
    accountant.currents_from_torques();
    const double peak = energy.books.peak_power;
    accountant.add(h, true, standby.P_0 + standby.P_brake, 0, standby.controller, energy.V, energy.books);
    if (energy.books.peak_power > peak) energy.t_peak = stretch * (nodes.cuts[k] - path.begin()) + 0.5 * h;
  }
  add_energies(robot, scratch.data, path, stretch, energy);
  return energy;
}

}  // namespace cotwin::energetics
