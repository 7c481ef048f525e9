// Services: time of the optimisation of a motion, 200 particles, 500 rounds, 200 samples of seven torques, on one core; and the times of
// services for a chain of 30 joints.
#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "components/services/services.h"
#include "models/optimisation/search.h"
#include "models/robot/urdf/urdf.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/chain_urdf.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using namespace cotwin::optimisation;

Problem lwr_move(int degree) {
  Problem p;
  p.robot = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  const std::vector<double> zero(7, 0.0);
  p.ends = {{0, 0.5, 0, -1, 0, 0.6, 0}, zero, zero, {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}, zero, zero};
  p.T_min = p.T_max = 1.5;
  p.degree = degree;
  p.bounds = bounds_of(p.robot);
  p.bounds.dddq.assign(7, 500.0);
  p.costs = {{Quantity::kTorque, 1, {}}};
  return p;
}

/// Least processor time of nine calls.
double seconds_of(const std::function<void()>& call) {
  double least = 1e9;
  for (int run = 0; run < benchmark::shortened(9, 1); ++run) {
    const double begin = benchmark::thread_seconds();
    call();
    least = std::min(least, benchmark::thread_seconds() - begin);
  }
  return least;
}

void feasibility_of_7() {
  const Problem p = lwr_move(5);
  services::Move move;
  move.from_q = p.ends.q_from;
  move.to_q = p.ends.q_to;
  for (const double T : {2.0, 0.0}) {
    move.T = T;
    benchmark::print({std::string("feasibility, ") + (T > 0 ? "duration given" : "shortest duration") + ", 7 joints, one core",
                      "s", seconds_of([&] { benchmark::keep(services::plan(p.robot, move).solution.T); }), "none", 0, 0,
                      false});
  }
}

void chain_of_30() {
  const robot::RobotModel robot = robot::parse_urdf(cotwin::testing::chain_urdf(30), "chain");
  services::Move move;
  for (int j = 0; j < 30; ++j) {
    move.from_q.push_back(0.1 * std::sin(j));
    move.to_q.push_back(0.15 * std::cos(1.3 * j));
  }
  benchmark::print({"feasibility, shortest duration, 30 joints, one core", "s",
                    seconds_of([&] { benchmark::keep(services::plan(robot, move).solution.T); }), "none", 0, 0, false});
}

}  // namespace

int main() {
  feasibility_of_7();
  struct Case {
    int degree;
    bool refine;
  };
  for (const auto& [degree, refine] : {Case{7, false}, Case{9, false}, Case{9, true}, Case{15, false}}) {
    const Problem problem = lwr_move(degree);
    SearchOptions options;
    options.refine = refine;
    double best = 1e9;
    Solution solution;
    for (int run = 0; run < benchmark::shortened(3, 1); ++run) {
      const double begin = benchmark::thread_seconds();
      solution = minimise(problem, options);
      best = std::min(best, benchmark::thread_seconds() - begin);
    }
    Problem quintic = problem;
    quintic.degree = 5;
    benchmark::print({"motion of degree " + std::to_string(degree) +
                          ", 200 particles, 500 rounds, 200 samples, 7 joints, one core" + (refine ? ", refined" : ""),
                      "s", best, "torque cost relative to the quintic",
                      solution.cost / assess(quintic, {}, problem.ends.q_to, problem.T_min).cost,
                      degree == 9 && !refine ? 0.4 : 0, false});
  }
  chain_of_30();
  return 0;
}
