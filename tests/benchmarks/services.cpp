// Services: time of the optimisation of a motion, 200 particles, 500 rounds, 200 samples of seven torques, on one core.
#include <functional>
#include <string>
#include <vector>

#include "models/optimisation/search.h"
#include "models/robot/urdf/urdf.h"
#include "tests/benchmarks/measure.h"
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

}  // namespace

int main() {
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
    for (int run = 0; run < 3; ++run) {
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
  return 0;
}
