// The watch for changes of a robot: time of a sample, and false alarms over many sessions beside those of the textbook's CUSUM.
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <vector>

#include "models/anomaly/anomaly.h"
#include "models/numerics/random.h"
#include "models/robot/urdf/urdf.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/places.h"
#include "tests/support/synthetic_log.h"

namespace {

using namespace cotwin;
using namespace cotwin::anomaly;

constexpr std::size_t kJoints = 6;
constexpr double kStep = 0.1;  // s

struct Robot {
  robot::RobotModel robot = robot::load_urdf(places::source() + "/models/robots/ur10e/robot.urdf");
  TorqueModel model{robot, true};
  testing::SyntheticLog motion{.amplitude = 0.6};
  std::array<double, kJoints> q{}, dq{}, ddq{}, tau{};

  Robot() {
    for (std::size_t j = 0; j < kJoints; ++j) model.drives.tau_C[j] = model.drives.sigma2[j] = 0.05 * robot.joints[j].tau_max;
    model.update();
  }
  void at(double t) {
    for (std::size_t j = 0; j < kJoints; ++j) {
      const Eigen::Vector3d x = motion.motion(j, t);
      q[j] = x[0], dq[j] = x[1], ddq[j] = x[2];
    }
    model.evaluate(q.data(), dq.data(), ddq.data());
  }
};

void time_of_a_sample() {
  Robot robot;
  Watch watch(robot.robot, robot.model, true, {});
  const robot::Mechanism mechanism(robot.robot);
  robot::Data data(mechanism);
  Eigen::VectorXd q(6), dq(6), ddq(6), tau(6);
  double t = 0;
  const auto state = [&] {
    t += 0.01;
    robot.motion.seed = 1;
    for (std::size_t j = 0; j < kJoints; ++j)
      robot.q[j] = std::sin(t + static_cast<double>(j)), robot.dq[j] = 0.5 * std::cos(t), robot.ddq[j] = std::sin(3 * t);
  };
  const benchmark::Figures f = benchmark::measure(
      [&] {
        state();
        robot.model.evaluate(robot.q.data(), robot.dq.data(), robot.ddq.data());
        for (std::size_t j = 0; j < kJoints; ++j)
          robot.tau[j] = robot.model.tau()[static_cast<Eigen::Index>(j)] + std::sin(17 * t * static_cast<double>(j + 1));
        watch.add(t, 0.01, robot.dq.data(), robot.ddq.data(), robot.tau.data());
      },
      [&] {
        state();
        for (std::size_t j = 0; j < kJoints; ++j) {
          const auto i = static_cast<Eigen::Index>(j);
          q[i] = robot.q[j], dq[i] = robot.dq[j], ddq[i] = robot.ddq[j];
        }
        robot::inverse_dynamics(mechanism, data, q, dq, ddq, tau);
        benchmark::keep(tau);
      });
  benchmark::print({"watch for changes, UR10e, a sample", "us", 1e6 * f.ours, "its inverse dynamics", 1e6 * f.peer, 5, false});
}

/// The textbook's: block means of each joint, standardised by the session's beginning, with the same mean time between false alarms.
class Textbook {
 public:
  void add(const std::array<double, kJoints>& r) {
    for (std::size_t j = 0; j < kJoints; ++j) sum_[j] += r[j];
    if (++samples_ < 5) return;
    samples_ = 0;
    ++blocks_;
    for (std::size_t j = 0; j < kJoints; ++j) {
      const double mean = std::exchange(sum_[j], 0) / 5;
      if (blocks_ <= kBaseline) {
        baseline_[j].push_back(mean);
        continue;
      }
      const double m = std::accumulate(baseline_[j].begin(), baseline_[j].end(), 0.0) / kBaseline;
      double squares = 0;
      for (const double x : baseline_[j]) squares += (x - m) * (x - m);
      cusum_[j].add((mean - m) / std::sqrt(squares / (kBaseline - 1)), 0.5);
      if (cusum_[j].largest() <= limit_) continue;
      cusum_[j] = {};
      ++alarms;
    }
  }
  int alarms = 0;

 private:
  static constexpr int kBaseline = 120;
  std::array<double, kJoints> sum_{};
  std::array<std::vector<double>, kJoints> baseline_;
  std::array<Cusum, kJoints> cusum_;
  int samples_ = 0, blocks_ = 0;
  double limit_ = threshold(0.5, kFalseAlarm * 3600 / kBlock * 2 * kJoints);
};

/// 240 sessions of an hour, each with a motion, noise and baseline of its own; noise that is alike for 0.2 s.
void false_alarms() {
  Robot robot;
  double ours = 0, peer = 0;
  const int sessions = benchmark::shortened(240, 1);
  for (int session = 0; session < sessions; ++session) {
    Watch watch(robot.robot, robot.model, true, {});
    Textbook textbook;
    robot.motion.seed = static_cast<unsigned>(session);
    std::array<double, kJoints> noise{};
    const auto samples = static_cast<std::uint32_t>(benchmark::shortened(3600.0, 120.0) / kStep);
    for (std::uint32_t k = 0; k < samples; ++k) {
      robot.at(k * kStep);
      const double keep = std::exp(-kStep / 0.2);
      for (std::size_t j = 0; j < kJoints; ++j) {
        noise[j] = keep * noise[j] +
                   std::sqrt(1 - keep * keep) * 0.01 * robot.robot.joints[j].tau_max *
                       numerics::normal(
                           {.seed = static_cast<std::uint64_t>(session), .stream = k, .round = static_cast<std::uint32_t>(j)});
        robot.tau[j] = robot.model.tau()[static_cast<Eigen::Index>(j)] + noise[j];
      }
      watch.add(k * kStep, k == 0 ? 0 : kStep, robot.dq.data(), robot.ddq.data(), robot.tau.data());
      textbook.add(noise);
    }
    ours += watch.count();
    peer += textbook.alarms;
  }
  benchmark::print(
      {"false alarms in 240 h of noise that is alike for 0.2 s, UR10e", "1", ours, "CUSUM of block means", peer, 0, false});
}

}  // namespace

int main() {
  time_of_a_sample();
  false_alarms();
}
