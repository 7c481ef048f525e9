#include "tests/benchmarks/services/moves.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <random>

#include "models/robot/urdf/urdf.h"
#include "tests/models/energetics/electrical_data.h"
#include "tests/support/places.h"

namespace cotwin::benchmark {

using namespace optimisation;

Arm load_arm(const std::string& robot, const std::string& electrical_of) {
  const std::string robots = places::source() + "/models/robots/";
  const bool is_path = robot.find('/') != std::string::npos;
  Arm arm;
  arm.name = is_path ? std::filesystem::path(robot).stem().string() : robot;
  arm.model = robot::load_urdf(is_path ? robot : robots + robot + "/robot.urdf");
  arm.electrical = optimisation::testing::load_electrical(robots + electrical_of + "/energy.ssv", arm.model.joints.size());
  return arm;
}

Problem problem_of(const Arm& arm, const RandomMove& move, int degree, double T, Quantity quantity) {
  Problem p;
  p.robot = arm.model;
  const std::vector<double> zero(move.from.size(), 0.0);
  p.ends = {move.from, zero, zero, move.to, zero, zero};
  p.T_min = p.T_max = T;
  p.degree = degree;
  p.bounds = bounds_of(p.robot);
  p.electrical = arm.electrical;
  p.costs = {{quantity, 1, {}}};
  return p;
}

Solution quintic_of(const Problem& problem, double T) {
  Problem quintic = problem;
  quintic.degree = 5;
  return assess(quintic, {}, problem.ends.q_to, T);
}

std::vector<RandomMove> random_moves(const Arm& arm, std::size_t count, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto uniform = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  std::vector<RandomMove> moves;
  while (moves.size() < count) {
    RandomMove move;
    for (auto* q : {&move.from, &move.to})
      for (const robot::Joint& joint : arm.model.joints) {
        const double low = std::max(joint.q_min, -std::numbers::pi), high = std::min(joint.q_max, std::numbers::pi);
        q->push_back(low + (0.1 + 0.8 * uniform()) * (high - low));
      }
    Problem p = problem_of(arm, move, 5, 1, Quantity::kTime);
    p.samples = 40;
    const auto possible = [&](double T) { return quintic_of(p, T).status == Status::kFeasible; };
    double low = 0.05, high = 20;
    if (!possible(high)) continue;
    while (high - low > 1e-6 * high) {
      const double middle = 0.5 * (low + high);
      (possible(middle) ? high : low) = middle;
    }
    move.T_quintic = high;
    moves.push_back(move);
  }
  return moves;
}

}  // namespace cotwin::benchmark
