// The tuner's mathematics: time of 500 rounds of 200 particles with compressed torques, and with the same swarm where each
// particle is evaluated by the inverse dynamics of all samples; time and memory of the compression. LWR 4+, seven joints, 43
// base parameters, four drive parameters per joint.
#include <algorithm>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

#include "models/identification/identification.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/benchmarks/measure.h"
#include "tests/models/identification/samples.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using namespace cotwin::identification;
using namespace cotwin::identification::testing;
using cotwin::benchmark::keep;

/// CPU time of this process, which does not depend on the load of the machine.
double seconds(const std::function<void()>& f) {
  const std::clock_t begin = std::clock();
  f();
  return static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
}

/// The minimum of several runs, because other processes only add to it.
double least_seconds(int runs, const std::function<void()>& f) {
  double least = seconds(f);
  for (int i = 1; i < benchmark::shortened(runs, 1); ++i) least = std::min(least, seconds(f));
  return least;
}

/// Σ (τ − τ_measured)² of one particle over all samples, by the SIMD batch of inverse dynamics, without friction.
double direct_evaluation(const robot::RobotModel& robot, const Samples& samples) {
  const robot::Mechanism mechanism(robot);
  robot::Data scratch(mechanism);
  const std::size_t count = samples.count(), n = samples.joints;
  std::vector<double> q(count * n), dq(count * n), ddq(count * n), tau(count * n);
  for (std::size_t s = 0; s < count; ++s)
    for (std::size_t j = 0; j < n; ++j) {
      q[j * count + s] = samples.q[s * n + j];
      dq[j * count + s] = samples.dq[s * n + j];
      ddq[j * count + s] = samples.ddq[s * n + j];
    }
  return least_seconds(3, [&] {
    robot::inverse_dynamics_batch(mechanism, scratch, count, q.data(), dq.data(), ddq.data(), tau.data());
    double sum = 0;
    for (std::size_t j = 0; j < n; ++j)
      for (std::size_t s = 0; s < count; ++s) {
        const double e = tau[j * count + s] - samples.tau[s * n + j];
        sum += e * e;
      }
    keep(sum);
  });
}

}  // namespace

int main() {
  const robot::RobotModel robot = robot::load_urdf(cotwin::places::source() + "/models/robots/lwr4/robot.urdf");
  const robot::RobotModel prior = identification::testing::perturbed(robot, 0.3);
  constexpr std::size_t kPart = 100000, kWhole = 1000000;
  const Samples samples = identification::testing::simulate(robot, identification::testing::truth_of(robot), kPart, 0.1);

  TorqueData data(robot);
  const double compression = least_seconds(2, [&] {
    data = TorqueData(robot);
    for (std::size_t i = 0; i < kWhole / kPart; ++i) add(data, samples);
    data.flush();
  });
  const robot::Mechanism mechanism(robot);
  robot::Data scratch(mechanism);
  Eigen::MatrixXd Y(7, 70);
  const double regressors = 10 * least_seconds(2, [&] {
                              for (std::size_t s = 0; s < kPart; ++s) {
                                const Eigen::Map<const Eigen::VectorXd> q(&samples.q[7 * s], 7), dq(&samples.dq[7 * s], 7),
                                    ddq(&samples.ddq[7 * s], 7);
                                robot::regressor(mechanism, scratch, q, dq, ddq, Y);
                                keep(Y);
                              }
                            });
  benchmark::print(
      {"compression of 1 000 000 samples, one core", "s", compression, "their regressors alone", regressors, 2.0, false});

  std::size_t doubles = 0;
  for (int j = 0; j < 7; ++j) {
    const auto p = static_cast<std::size_t>(data.columns(j).size());
    doubles += p * (p + numerics::Triangle::kRows);
  }
  benchmark::print({"memory of compressed torques, any number of samples", "MB", static_cast<double>(8 * doubles) / 1e6,
                    "1 000 000 samples of q, dq, ddq, tau", 8.0 * 28 * kWhole / 1e6, 1.0, false});

  const auto swarm_seconds = [](const Problem& problem, const SwarmSearchOptions& options) {
    return least_seconds(3, [&] {
      SwarmSearch search(problem, options);
      keep(search.run().cost);
    });
  };
  // The time of the peer is that of one particle times 500 · 200, because the whole run would take minutes to hours.
  constexpr double kEvaluations = 500.0 * 200;
  constexpr std::size_t kFew = 1000;
  TorqueData few(robot);
  add(few, part(samples, 0, kFew));
  benchmark::print({"tuning, 500 rounds of 200 particles, 1000 samples, one core", "s", swarm_seconds(Problem(few, prior), {}),
                    "inverse dynamics of all samples per particle",
                    kEvaluations * direct_evaluation(robot, part(samples, 0, kFew)), 0.3, false});
  const Problem problem(data, prior);
  benchmark::print({"tuning, 500 rounds of 200 particles, 1000000 samples, one core", "s", swarm_seconds(problem, {}),
                    "inverse dynamics of all samples per particle", kEvaluations * 10 * direct_evaluation(robot, samples), 0.3,
                    false});
  const double feasible = least_seconds(3, [&] { keep(solve_feasible(problem).cost); });
  benchmark::print({"feasible least squares", "s", feasible, "tuning by the swarm", swarm_seconds(problem, {}), 0, false});

  ModelOptions sigmoid;
  sigmoid.friction = FrictionLaw::kSigmoid;
  TorqueData curved(robot, sigmoid);
  add(curved, part(samples, 0, 20000));
  const Problem shaped(curved, prior);
  benchmark::print({"the same with sigmoid friction in the search", "s", swarm_seconds(shaped, {}), "with Coulomb friction",
                    swarm_seconds(problem, {}), 0, true});
  return 0;
}
