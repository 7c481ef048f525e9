#pragma once
#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "models/foundation/formats/csv.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/files.h"

/// Synthetic logs of robots: multi-sine motions, torques by the equations of motion, friction, motors and noise.
namespace cotwin::testing {

struct SyntheticLog {
  double rate = 200;                                                 // Hz
  double duration = 20;                                              // s
  double amplitude = 0.35;                                           // rad, of the largest sine
  double noise = 0.02;                                               // N.m, standard deviation of the torque noise
  double tau_C = 1.5, v_R = 0.03, sigma2 = 2, tau_0 = 0.2, B = 0.4;  // of every joint
  double load = 0;                                                   // friction per gravity torque
  double K = 0;        // N.m/rad, of every joint; above 0: the log has motor positions θ = q + τ_J/K as theta1 …
  bool joint = false;  // the torques are those behind the gears, τ_J, which include friction of the link but not B
  unsigned seed = 1;
  std::size_t moving = 99;  // joints from this one on stand still
  double q_noise = 0;       // rad, standard deviation of the position noise

  std::size_t samples() const { return static_cast<std::size_t>(std::lround(rate * duration)) + 1; }
  /// Position, speed, acceleration of joint j at t. Both ends are in motion.
  Eigen::Vector3d motion(std::size_t j, double t) const {
    Eigen::Vector3d x(0.3 * std::sin(static_cast<double>(j) + seed), 0, 0);
    if (j >= moving) return x;
    for (int l = 1; l <= 3; ++l) {
      const double w = 2 * std::numbers::pi * (0.07 * l + 0.013 * static_cast<double>(j) + 0.05);
      const double a = amplitude / l, phase = 1.7 * l * static_cast<double>(j + seed) + 0.3;
      x += Eigen::Vector3d(a * std::sin(w * t + phase), a * w * std::cos(w * t + phase), -a * w * w * std::sin(w * t + phase));
    }
    return x;
  }
  /// Torques by `robot`; `spoil` may change a row [t, q…, tau…, theta…] before it is written. Friction and B are evaluated at
  /// the link's speed, which differs from the motor's by far less than v_R if the gears are stiff.
  void write(const std::filesystem::path& file, const robot::RobotModel& robot,
             const std::function<void(std::size_t row, std::vector<double>& cells)>& spoil = {}) const {
    const std::size_t n = robot.joints.size();
    std::ofstream out(file);
    std::vector<std::string> names = {"t"};
    for (const std::string what : {"q", "tau", "theta"})
      for (std::size_t j = 0; j < n && (K > 0 || what != "theta"); ++j) names.push_back(what + std::to_string(j + 1));
    csv::Writer writer(out, names);
    const robot::Mechanism mechanism(robot);
    robot::Data data(mechanism);
    Eigen::VectorXd q(robot.n()), dq(robot.n()), ddq(robot.n()), tau(robot.n()), g(robot.n());
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0, noise);
    std::vector<double> cells(names.size());
    for (std::size_t k = 0; k < samples(); ++k) {
      const double t = static_cast<double>(k) / rate;
      for (std::size_t j = 0; j < n; ++j) {
        const Eigen::Vector3d x = motion(j, t);
        const Eigen::Index i = static_cast<Eigen::Index>(j);
        q[i] = x[0];
        dq[i] = x[1];
        ddq[i] = x[2];
      }
      robot::inverse_dynamics(mechanism, data, q, dq, ddq, tau);
      robot::gravity(mechanism, data, q, g);
      cells[0] = t;
      for (std::size_t j = 0; j < n; ++j) {
        const Eigen::Index i = static_cast<Eigen::Index>(j);
        cells[1 + j] = q_noise > 0 ? q[i] + q_noise / noise * normal(random) : q[i];
        const double friction = (tau_C + load * std::abs(g[i])) * std::tanh(dq[i] / v_R) + sigma2 * dq[i] + tau_0;
        cells[1 + n + j] = tau[i] + friction + (joint ? 0 : B) * ddq[i] + normal(random);
        if (K > 0) cells[1 + 2 * n + j] = q[i] + (joint ? tau[i] + friction : tau[i]) / K;
      }
      if (spoil) spoil(k, cells);
      writer.row(cells);
    }
  }
};

}  // namespace cotwin::testing
