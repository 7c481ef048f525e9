// Services: time of the optimisation of a motion, 200 particles, 500 rounds, 200 samples of seven torques, on one core; and the times of
// services for a chain of 30 joints.
#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "components/services/energy_service.h"
#include "models/optimisation/search.h"
#include "models/robot/urdf/urdf.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/chain_urdf.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using namespace cotwin::optimisation;

/// `wide`: bounds that no particle violates, so that all torques are computed.
Problem lwr_move(int degree, bool wide) {
  Problem p;
  p.robot = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  const std::vector<double> zero(7, 0.0);
  p.ends = {{0, 0.5, 0, -1, 0, 0.6, 0}, zero, zero, {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}, zero, zero};
  p.T_min = p.T_max = 1.5;
  p.degree = degree;
  p.bounds = bounds_of(p.robot);
  if (wide) {
    for (auto* bound : {&p.bounds.q_max, &p.bounds.dq}) bound->assign(7, 1e6);
    p.bounds.q_min.assign(7, -1e6);
  } else {
    p.bounds.dddq.assign(7, 500.0);
  }
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
  const Problem p = lwr_move(5, false);
  services::Move move;
  move.from_q = p.ends.q_from;
  move.to_q = p.ends.q_to;
  for (const double T : {2.0, 0.0}) {
    move.T = T;
    benchmark::print({std::string("feasibility, ") + (T > 0 ? "duration given" : "shortest duration") + ", 7 joints, one core",
                      "s", seconds_of([&] { benchmark::keep(services::feasibility(p.robot, move).T); }), "none", 0, 0, false});
  }
}

void chain_of_30() {
  const robot::RobotModel robot = robot::parse_urdf(cotwin::testing::chain_urdf(30), "chain");
  services::Move move;
  for (int j = 0; j < 30; ++j) {
    move.from_q.push_back(0.1 * std::sin(j));
    move.to_q.push_back(0.15 * std::cos(1.3 * j));
  }
  services::Robot whole;
  whole.model = robot;
  const double shortest = services::shortest_duration(robot, move);
  const auto report = [](const std::string& what, double seconds) {
    benchmark::print({what + ", 30 joints, one core", "s", seconds, "none", 0, 0, false});
  };
  report("feasibility, shortest duration", seconds_of([&] { benchmark::keep(services::feasibility(robot, move).T); }));
  move.T = 1.5 * shortest;
  report("feasibility, duration given", seconds_of([&] { benchmark::keep(services::feasibility(robot, move).T); }));
  report("energy", seconds_of([&] { benchmark::keep(services::energy_of(whole, move).energy.potential); }));
  Problem p;
  p.robot = robot;
  const std::vector<double> zero(30, 0.0);
  p.ends = {move.from_q, zero, zero, move.to_q, zero, zero};
  p.T_min = p.T_max = move.T;
  p.degree = 7;
  p.bounds = bounds_of(robot);
  p.costs = {{Quantity::kTorque, 1, {}}};
  SearchOptions options;
  options.refine = false;  // Newton's method takes long with 60 variables
  options.rounds = benchmark::shortened(500, 20);
  const double begin = benchmark::thread_seconds();
  const Solution s = minimise(p, options);
  const double seconds = benchmark::thread_seconds() - begin;
  Problem quintic = p;
  quintic.degree = 5;
  benchmark::print({"motion of degree 7, 200 particles, 500 rounds, 200 samples, 30 joints, one core", "s", seconds,
                    "torque cost relative to the quintic", s.cost / assess(quintic, {}, p.ends.q_to, p.T_min).cost, 0, false});
}

}  // namespace

int main() {
  feasibility_of_7();
  struct Case {
    int degree;
    bool refine, wide;
  };
  for (const auto& [degree, refine, wide] : {Case{7, false, false}, Case{9, false, false}, Case{9, false, true},
                                             Case{9, true, false}, Case{15, false, false}, Case{15, true, false}}) {
    const Problem problem = lwr_move(degree, wide);
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
                          ", 200 particles, 500 rounds, 200 samples, 7 joints, one core" + (refine ? ", refined" : "") +
                          (wide ? ", none pruned" : ""),
                      "s", best, "torque cost relative to the quintic",
                      solution.cost / assess(quintic, {}, problem.ends.q_to, problem.T_min).cost,
                      degree == 9 && !refine && !wide ? 0.4 : 0, false});
  }
  chain_of_30();
  return 0;
}
