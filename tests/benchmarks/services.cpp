// Services: time of the optimisation of a motion, 200 particles, 500 rounds, 200 samples of seven torques, on one core; and the times of
// services for a chain of 30 joints, and of a move that is to keep clear of a scene.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "components/services/json/json.h"
#include "components/services/services.h"
#include "models/collision/meeting/meeting.h"
#include "models/optimisation/search.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/urdf/urdf_shapes.h"
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
  benchmark::print({"feasibility, shortest duration, 7 joints, one core", "s",
                    seconds_of([&] { benchmark::keep(services::plan(p.robot, move).solution.T); }), "none", 0, 0, false});
  services::Robots robots({std::string(cotwin::places::source()) + "/models/robots"});
  const std::string request =
      R"({"service":"feasibility","robot":"lwr4","T_s":2,"from_q_rad":[0,0.5,0,-1,0,0.6,0],"to_q_rad":[1.2,-0.2,0.4,0.7,-0.5,-0.3,0.8])";
  const std::string loads =
      R"(,"payload":{"mass_kg":3,"com_m":[0,0,0.1],"from_share":0.3,"to_share":0.8},"wrench":{"force_N":[1,2,-20],"from_share":0.4,)"
      R"("to_share":0.6},"dq_from_rad_per_s":[0.1,0.1,0.1,0.1,0.1,0.1,0.1])";
  const auto seconds = [&](const std::string& text) {
    return seconds_of([&] { benchmark::keep(services::answer(robots, text).size()); });
  };
  benchmark::print({"request of feasibility with payload, wrench and ends in motion, 7 joints", "s",
                    seconds(request + loads + "}"), "without them", seconds(request + "}"), 2});
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

/// Random moves of the LWR 4+ among 50 boxes.
void clearance_among_50() {
  const std::filesystem::path urdf = std::filesystem::path(cotwin::places::source()) / "models/robots/lwr4/robot.urdf";
  collision::PlacedCell cell;
  scene::PlacedRobot& robot = cell.robots.emplace_back().robot;
  robot.model = robot::load_urdf(urdf);
  robot.shapes = scene::hulls_of_urdf(urdf, robot.model);
  const std::size_t n = robot.model.joints.size();
  std::mt19937 random(4);
  const auto real = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  for (int k = 0; k < 50; ++k) {
    scene::Body box;
    box.name = "box" + std::to_string(k);
    box.motion = scene::Motion::kStatic;
    const double angle = real(-3, 3), far = real(0.5, 1.6);
    box.X_WB.p = {far * std::cos(angle), far * std::sin(angle), real(-0.3, 1.2)};
    box.shapes.resize(1);
    box.shapes[0].type = scene::ShapeType::kBox;
    box.shapes[0].size = {0.1, 0.15, 0.2};
    cell.bodies.push_back({box});
  }
  collision::Checker checker(std::move(cell), {0, true});
  std::vector<double> all;
  for (int k = 0; k < benchmark::shortened(200, 3); ++k) {
    std::vector<double> q;
    for (std::size_t i = 0; i < 2 * n; ++i) q.push_back(real(-1.5, 1.5));
    const std::vector<double> zeros(2 * n);
    const collision::Motion move{trajectory::Path(n, {0, 2}, q, zeros, zeros), {}};
    all.push_back(seconds_of([&] { benchmark::keep(checker.check({&move, 1}).clear); }));
  }
  std::ranges::sort(all);
  benchmark::print({"a random move of 7 joints among 50 bodies and clear of itself, slowest of 200", "ms", 1e3 * all.back(),
                    "median", 1e3 * all[all.size() / 2], 20, false});
}

/// Motions of grow, all within the bounds of speed, and with a duration at which many exceed them and are pruned.
void motions_at_random() {
  services::Robots robots({std::string(cotwin::places::source()) + "/models/robots"});
  const int motions = benchmark::shortened(200000, 1000);
  const auto microseconds = [&](const std::string& durations) {
    const std::string request =
        R"({"service":"grow","robot":"lwr4","from_q_rad":[0,0.5,0,-1,0,0.6,0],"to_q_rad":[1.2,-0.2,0.4,0.7,-0.5,-0.3,0.8],)" +
        durations + R"(,"cost":[{"name":"torque"},{"name":"energy"}],"detail":"verdict","best":1,"motions":)" +
        std::to_string(motions) + "}";
    return 1e6 / motions * seconds_of([&] { benchmark::keep(services::answer(robots, request).size()); });
  };
  benchmark::print({"a motion that grow draws, 7 joints, torque and energy at 56 samples, one core", "us",
                    microseconds(R"("T_min_s":3.5,"T_max_s":5)"), "where bounds prune 61 %",
                    microseconds(R"("T_min_s":1,"T_max_s":2.2)"), 2.5, false});
}

}  // namespace

int main() {
  feasibility_of_7();
  struct Case {
    int degree;
    bool refine;
  };
  for (const auto& [degree, refine] : {Case{9, false}, Case{9, true}, Case{15, false}}) {
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
  motions_at_random();
  chain_of_30();
  clearance_among_50();
  return 0;
}
