#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "models/support/threads.h"

namespace cotwin::numerics {

/// Particles are evaluated, drawn and moved in blocks of so many, by one thread a block and in the lanes of vector registers.
inline constexpr std::size_t kSwarmBlock = 8;

struct SwarmOptions {
  int particles = 200;                  // rounded up to whole blocks
  int rounds = 500;                     // N_P of IV-A4
  double threshold = 0;                 // stop at a cost of this or less; costs are >= 0 in most uses
  std::uint64_t seed = 1;               // same seed, same bits
  double inertia = 0.7298437881283576;  // constriction for c1 = c2 = 2.05 (Clerc and Kennedy 2002)
  double cognitive = 1.496179765663133;
  double social = 1.496179765663133;
  int neighbours = 0;             // informants on either side of a ring; 0: the whole swarm informs each particle
  int stagnation_rounds = 60;     // the window in which the rate of convergence is tracked; 0: no reconfiguration
  double stagnation_rate = 1e-3;  // relative fall of the best cost per round, on average over the window, that is stagnation
  double spread = 0.1;            // standard deviation of a reconfigured swarm about its personal bests, share of the box
  friend bool operator==(const SwarmOptions&, const SwarmOptions&) = default;
};

/// Everything that a swarm remembers, a plain value: a swarm made from it goes on to the same bits. Arrays of particles are by
/// coordinate: coordinate i of particle k at [i * particles + k].
struct SwarmState {
  std::size_t dimensions = 0;
  std::size_t particles = 0;
  std::uint32_t round = 0;                 // rounds done, the first evaluation included
  std::uint32_t reconfigurations = 0;      // how often it stagnated
  std::uint32_t last_reconfiguration = 0;  // the round that it began with
  bool stagnated = false;                  // the next round begins with a reconfiguration
  std::vector<double> lower, upper;        // dimensions; the box
  std::vector<double> spread;              // dimensions; of a reconfigured swarm, absolute
  std::vector<double> x, v;                // dimensions x particles: positions and velocities
  std::vector<double> best_x;              // dimensions x particles: personal bests
  std::vector<double> cost, best_cost;     // particles
  std::size_t leader = 0;                  // the particle whose personal best is the best of all
  std::vector<double> history;             // best cost after each round
  friend bool operator==(const SwarmState&, const SwarmState&) = default;

  /// As bytes (little-endian, with a version in front), for a file.
  std::string bytes() const;
  /// Throws Error for bytes that are not a state.
  static SwarmState from_bytes(std::string_view bytes);
};

enum class SwarmStatus { kRunning, kThreshold, kRounds };
const char* to_text(SwarmStatus status);  // "running", "threshold reached", …

/// Particle swarm optimisation (Kennedy and Eberhart 1995, the paper's [26]) as in IV-A4: minimises f over a box in R^d.
///   v ← w v + c1 r1 ∘ (p − x) + c2 r2 ∘ (g − x),   x ← x + v
/// p is a particle's personal best, g the best of its informants, r1 and r2 uniform and keyed by (seed, round, particle,
/// coordinate). A coordinate that would leave the box is put on its face with half of its velocity turned back. The rate of
/// convergence is tracked, and a swarm that stagnates is reconfigured around single personal bests: each particle starts anew
/// from one of them (the leader's and those of the better half, in turn), normally distributed about it, and forgets its own
/// personal best; the leader stays where it was best.
///
/// Same seed, same bits, on any number of threads; a round allocates nothing. Costs that are NaN count as +∞.
class Swarm {
 public:
  /// Evaluates `count` (≤ kSwarmBlock) particles: coordinate i of particle k at x[i * stride + k]; `x` may be read for
  /// kSwarmBlock particles in any case. `block` is the block's number in [0, particles / kSwarmBlock). Called from several
  /// threads at once for different blocks.
  using Cost = std::function<void(std::size_t block, std::size_t count, const double* x, std::size_t stride, double* cost)>;

  /// `start` (d): one particle begins there, and the others about it, normally distributed with `start_spread` (d, absolute).
  /// Throws Error for a box that is none, a start outside of it, options out of range.
  Swarm(std::vector<double> lower, std::vector<double> upper, std::vector<double> start, std::vector<double> start_spread,
        Cost cost, const SwarmOptions& options = {});
  /// Uniformly distributed over the box at the start.
  Swarm(std::vector<double> lower, std::vector<double> upper, Cost cost, const SwarmOptions& options = {});
  /// Goes on where `state` was taken, to the same bits if cost and options are the same.
  Swarm(SwarmState state, Cost cost, const SwarmOptions& options = {});

  /// One round; the first one evaluates the initial positions. Returns kRunning, or why the run is over, and then does nothing.
  SwarmStatus round(Threads* threads = nullptr);
  /// Rounds until the run is over.
  SwarmStatus run(Threads* threads = nullptr);
  SwarmStatus status() const;

  const SwarmState& state() const { return state_; }
  double best_cost() const { return state_.best_cost[state_.leader]; }
  /// Copies the best position, d.
  void best(std::span<double> x) const;
  /// True after a round that ended in stagnation: the next one begins with reconfigured particles. The moment for the owner to
  /// change coordinates.
  bool stagnated() const { return state_.stagnated; }

  /// Changes coordinates to y = A (x − b) (A: d x d, row-major; orthogonal for velocities to keep their meaning): positions,
  /// personal bests and velocities follow. `lower`, `upper`, `spread`: of the new coordinates. Costs stay what they are, so the
  /// cost function must be of the new coordinates from then on. Allocates.
  void change_coordinates(std::span<const double> A, std::span<const double> b, std::vector<double> lower,
                          std::vector<double> upper, std::vector<double> spread);

 private:
  void check() const;
  void reconfigure();
  void move_block(std::size_t block);
  void evaluate_block(std::size_t block);
  void remember();
  void inform();
  bool stagnates() const;

  SwarmOptions options_;
  SwarmState state_;
  Cost cost_;
  std::vector<std::size_t> order_;        // scratch: particles by personal best
  std::vector<double> centres_;           // scratch: d x particles
  std::vector<std::uint32_t> informant_;  // particle whose personal best attracts each
};

}  // namespace cotwin::numerics
