#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "models/optimisation/search.h"

/// Random moves from rest to rest for the benchmarks of the services.
namespace cotwin::benchmark {

/// A robot of models/robots or a path to a URDF file, with its electrical data if it has any.
struct Arm {
  std::string name;
  robot::RobotModel model;
  std::optional<optimisation::Electrical> electrical;
};
/// `electrical_of`: the robot in models/robots whose energy.ssv is taken.
Arm load_arm(const std::string& robot, const std::string& electrical_of);

struct RandomMove {
  std::vector<double> from, to;
  double T_quintic = 0;  // s, shortest duration of the quintic within the bounds of position, speed and torque
};
/// `count` moves between postures that are uniformly distributed over the inner 80 % of the joints' ranges (at most ±π), for which
/// a quintic exists.
std::vector<RandomMove> random_moves(const Arm& arm, std::size_t count, std::uint64_t seed);

/// The problem of a move in T seconds.
optimisation::Problem problem_of(const Arm& arm, const RandomMove& move, int degree, double T, optimisation::Quantity quantity);
/// The quintic of the problem.
optimisation::Solution quintic_of(const optimisation::Problem& problem, double T);

/// Local optimum by Ipopt from the quintic: the same variables and costs; bounds at 65 places and at the problem's samples of
/// torque, of those joints whose bounds decide; limited-memory Hessian.
struct PeerSolution {
  bool solved = false;
  double share = 0;  // of the bounds that is used: above 1 by what the places miss
  double cost = 0, T = 0;
  std::vector<double> c;
};
PeerSolution minimise_by_ipopt(const optimisation::Problem& problem, double T_start);

}  // namespace cotwin::benchmark
