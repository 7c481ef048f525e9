// Services: motions that were found for random moves, against the quintic, Ipopt and the time-optimal motion on the same path.
//   services_moves [--robots lwr4] [--moves N] [--part energy|drives|ipopt|time|requests] [--table] [--degree D] [--cost torque]
// Without --moves five of energy and drives and one of each other part, so that it ends soon.
// --degree and --cost are those of the comparison with Ipopt; with --table it prints one row for each move.
// A robot is a folder of models/robots or, with a slash, a path to a URDF file, which then has the drives of kr300_r2500.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "tests/benchmarks/measure.h"
#include "tests/benchmarks/services/moves.h"
#include "tests/models/optimisation/time_optimal_path.h"

namespace {

using namespace cotwin;
using namespace cotwin::optimisation;
using namespace cotwin::benchmark;

/// The value below which this share of the values lies, linear between them.
double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  const double at = share * static_cast<double>(values.size() - 1);
  const std::size_t low = static_cast<std::size_t>(at), high = std::min(low + 1, values.size() - 1);
  return values[low] + (at - static_cast<double>(low)) * (values[high] - values[low]);
}

constexpr double kLonger = 1.2;  // duration over the shortest one of the quintic

/// Energy from the mains that the best motion of degree 9 saves, %. `drives`: of the drives alone, without stand-by and controller.
void energy(const Arm& arm, std::size_t moves, bool drives, bool table) {
  std::vector<double> saved, joules;
  for (const RandomMove& move : random_moves(arm, moves, 1)) {
    Problem p = problem_of(arm, move, 9, kLonger * move.T_quintic, Quantity::kEnergy);
    if (drives) p.electrical->standby = {};
    SearchOptions options;
    options.particles = 104;
    options.rounds = 200;
    const Solution best = minimise(p, options), quintic = quintic_of(p, p.T_max);
    if (best.status != Status::kFeasible) {
      std::fprintf(stderr, "services_moves: no feasible motion of %s: %s\n", arm.name.c_str(), best.reason.c_str());
      std::exit(1);
    }
    saved.push_back(100 * (1 - best.cost / quintic.cost));
    joules.push_back(quintic.cost - best.cost);
  }
  if (table) {
    std::printf("| %s | %s | %.1f %% | %.1f %% | %.1f %% | %.4g J |\n", arm.name.c_str(), drives ? "drives" : "all",
                quantile(saved, 0.25), quantile(saved, 0.5), quantile(saved, 0.75), quantile(joules, 0.5));
    std::fflush(stdout);
    return;
  }
  print({std::string("energy saved against the quintic, ") + (drives ? "drives of " : "") + arm.name + ", " +
             std::to_string(moves) + " random moves, median",
         "%", quantile(saved, 0.5), "upper quartile", quantile(saved, 0.75), 0, false});
}

/// Cost of motions over that of Ipopt. Motions of Ipopt that exceed a bound by more than 1 % are left out.
void ipopt(const Arm& arm, std::size_t moves, int degree, Quantity quantity, bool table) {
  std::vector<double> ratios;
  std::size_t number = 0;
  for (const RandomMove& move : random_moves(arm, moves, 2)) {
    Problem p = problem_of(arm, move, degree, kLonger * move.T_quintic, quantity);
    p.samples = 80;
    const Solution ours = minimise(p);
    const PeerSolution peer = minimise_by_ipopt(p, p.T_max);
    const double ratio = ours.status == Status::kFeasible ? ours.cost / peer.cost : 1e9;
    if (table) {
      std::printf("| %s | %d | %zu | %.5f | %s | Ipopt uses %.4f of its bounds |\n", arm.name.c_str(), degree, ++number, ratio,
                  to_text(ours.status), peer.share);
      std::fflush(stdout);
    }
    if (peer.share <= 1.01) ratios.push_back(ratio);
  }
  if (ratios.empty()) return;
  const std::string name = std::string(to_text(quantity)) + " cost of degree " + std::to_string(degree) +
                           " over that of Ipopt, " + arm.name + ", " + std::to_string(ratios.size()) + " random moves";
  print({name + ", largest", "1", quantile(ratios, 1), "Ipopt", 1, 1.01, false});
}

/// Time-optimal motions of degree 21 over the time-optimal motion on the same path.
void time(const Arm& arm, std::size_t moves) {
  std::vector<double> ratios;
  for (const RandomMove& move : random_moves(arm, moves, 3)) {
    Problem p = problem_of(arm, move, 21, 1, Quantity::kTime);
    p.samples = 96;
    p.T_min = 0.3 * move.T_quintic;
    p.T_max = 1.2 * move.T_quintic;
    SearchOptions options;
    options.rounds = 100;
    const Solution s = minimise(p, options);
    const double bound = optimisation::testing::time_optimal(p.robot, s.path, p.bounds.dq, p.bounds.tau, 1000);
    ratios.push_back(s.status == Status::kFeasible ? s.T / bound : 1e9);
  }
  const std::string name = "duration of degree 21 over the time-optimal one on the same path, " + arm.name + ", " +
                           std::to_string(moves) + " random moves";
  print({name + ", largest", "1", quantile(ratios, 1), "bound", 1, 1.05, false});
}

/// Processor time of searches with the default settings: costs, degrees and durations at random, and every second move to a limit of a
/// joint.
void requests(const Arm& arm, std::size_t moves) {
  std::mt19937_64 random(4);
  const auto draw = [&](double least, double most) { return std::uniform_real_distribution<double>(least, most)(random); };
  constexpr std::array kCosts = {Quantity::kTime, Quantity::kTorque, Quantity::kWork, Quantity::kJerk};
  constexpr std::array kDegrees = {7, 9, 9, 9, 11, 13, 15};
  std::vector<double> seconds;
  std::size_t number = 0;
  for (RandomMove move : random_moves(arm, moves, 4)) {
    const auto joint = static_cast<std::size_t>(draw(0, static_cast<double>(move.to.size())));
    const double limit = arm.model.joints[joint].q_max;
    if (++number % 2 == 0 && std::isfinite(limit)) move.to[joint] = limit;
    Problem p = problem_of(arm, move, kDegrees[static_cast<std::size_t>(draw(0, kDegrees.size()))], 1,
                           kCosts[static_cast<std::size_t>(draw(0, kCosts.size()))]);
    p.T_min = draw(0.8, 1.6) * move.T_quintic;
    p.T_max = draw(0, 1) < 0.5 ? p.T_min : draw(1.2, 4) * p.T_min;
    const double begin = thread_seconds();
    keep(minimise(p));
    seconds.push_back(thread_seconds() - begin);
  }
  const std::string name =
      "search with the default settings, " + arm.name + ", " + std::to_string(moves) + " random requests, processor time";
  print({name + ", median", "s", quantile(seconds, 0.5), "goal", 1, 1, false});
  print({name + ", largest", "s", quantile(seconds, 1), "goal", 5, 5, false});
}

}  // namespace

int main(int argc, char** argv) {
  std::string robots = "lwr4", part;
  int degree = 7;
  Quantity quantity = Quantity::kTorque;
  std::size_t moves = 0;
  bool table = false;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    if (name == "--table") {
      table = true;
    } else if (i + 1 < argc && name == "--robots") {
      robots = argv[++i];
    } else if (i + 1 < argc && name == "--moves") {
      moves = static_cast<std::size_t>(std::max(1, std::atoi(argv[++i])));
    } else if (i + 1 < argc && name == "--part") {
      part = argv[++i];
    } else if (i + 1 < argc && name == "--degree") {
      degree = std::atoi(argv[++i]);
    } else if (i + 1 < argc && name == "--cost") {
      const std::string cost = argv[++i];
      for (int q = 0; q <= static_cast<int>(Quantity::kStiffness); ++q)
        if (cost == to_text(static_cast<Quantity>(q))) quantity = static_cast<Quantity>(q);
    } else {
      std::fprintf(stderr, "services_moves: argument '%s', expected --robots, --moves, --part, --degree, --cost or --table\n",
                   argv[i]);
      return 2;
    }
  }
  for (std::size_t begin = 0; begin <= robots.size();) {
    const std::size_t end = std::min(robots.find(',', begin), robots.size());
    const std::string robot = robots.substr(begin, end - begin);
    begin = end + 1;
    const Arm arm = load_arm(robot, robot == "lwr4" ? "lwr4" : "kr300_r2500");
    for (const bool drives : {false, true})
      if (part.empty() || part == (drives ? "drives" : "energy"))
        energy(arm, moves > 0 ? moves : shortened(5, 1), drives, table);
    if (part.empty() || part == "ipopt") ipopt(arm, moves > 0 ? moves : 1, degree, quantity, table);
    if (part.empty() || part == "time") time(arm, moves > 0 ? moves : 1);
    if (part.empty() || part == "requests") requests(arm, moves > 0 ? moves : shortened(5, 1));
  }
  return 0;
}
