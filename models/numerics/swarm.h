#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "models/foundation/support/threads.h"

namespace cotwin::numerics {

/// Number of particles per block. One thread evaluates, draws and moves a block at a time, in the lanes of vector registers.
inline constexpr std::size_t kSwarmBlock = 8;

struct SwarmOptions {
  int particles = 200;                  // rounded up to whole blocks
  int rounds = 500;                     // N_P of IV-A4
  double threshold = 0;                 // stop at a cost of this or less; costs are >= 0 in most uses
  std::uint64_t seed = 1;               // same seed, same bits
  double inertia = 0.7298437881283576;  // constriction for c1 = c2 = 2.05 (Clerc and Kennedy 2002)
  double cognitive = 1.496179765663133;
  double social = 1.496179765663133;
  int neighbours = 0;             // informants on either side of a ring; 0: the whole swarm
  int stagnation_rounds = 60;     // window of the rate of convergence; 0: no reconfiguration
  double stagnation_rate = 1e-3;  // mean relative decrease of the best cost per round below which the swarm stagnates
  double spread = 0.1;            // standard deviation of a reconfigured swarm about its personal bests, relative to the box
  friend bool operator==(const SwarmOptions&, const SwarmOptions&) = default;
};

/// The whole state of a swarm, a plain value: a swarm made from it continues to the same bits. Arrays of particles are stored
/// by coordinate: coordinate i of particle k at [i * particles + k].
struct SwarmState {
  std::size_t dimensions = 0;
  std::size_t particles = 0;
  std::uint32_t round = 0;                 // rounds done, the first evaluation included
  std::uint32_t reconfigurations = 0;      // number of reconfigurations
  std::uint32_t last_reconfiguration = 0;  // its first round
  bool stagnated = false;                  // the next round starts with a reconfiguration
  std::vector<double> lower, upper;        // dimensions; the box
  std::vector<double> spread;              // dimensions; of a reconfigured swarm, absolute
  std::vector<double> x, v;                // dimensions x particles: positions and velocities
  std::vector<double> best_x;              // dimensions x particles: personal bests
  std::vector<double> cost, best_cost;     // particles
  std::size_t leader = 0;                  // the particle whose personal best is the best of all
  std::vector<double> history;             // best cost after each round
  friend bool operator==(const SwarmState&, const SwarmState&) = default;

  /// Serialises the state (little-endian, with a version in front).
  std::string bytes() const;
  /// Throws Error for bytes that are not a state.
  static SwarmState from_bytes(std::string_view bytes);
};

enum class SwarmStatus { kRunning, kThreshold, kRounds };
const char* to_text(SwarmStatus status);  // "running", "threshold reached", …

/// Particle swarm optimisation (Kennedy and Eberhart 1995, the paper's [26]) as in IV-A4: minimises f over a box in R^d.
///   v ← w v + c1 r1 ∘ (p − x) + c2 r2 ∘ (g − x),   x ← x + v
/// p is the personal best of a particle, g the best of its informants; r1 and r2 are uniform and keyed by (seed, round,
/// particle, coordinate). A coordinate that would leave the box is set to its face, with half of its velocity reversed. A swarm
/// whose rate of convergence is too low is reconfigured: each particle restarts, normally distributed about one of the personal
/// bests (those of the leader and of the better half, in turn), and its own personal best is reset; the leader restarts at its
/// best position.
///
/// Same seed, same bits, on any number of threads. A round allocates nothing. Costs that are NaN count as +∞.
class Swarm {
 public:
  /// Evaluates `count` (≤ kSwarmBlock) particles: coordinate i of particle k at x[i * stride + k]. `x` is readable for
  /// kSwarmBlock particles in any case. `block`: number of the block in [0, particles / kSwarmBlock). Called from several
  /// threads at once for different blocks.
  using Cost = std::function<void(std::size_t block, std::size_t count, const double* x, std::size_t stride, double* cost)>;

  /// `start` (d): the first position of one particle; the others are normally distributed about it with `start_spread` (d,
  /// absolute). Throws Error for an invalid box, a start outside of it, and options out of range.
  Swarm(std::vector<double> lower, std::vector<double> upper, std::vector<double> start, std::vector<double> start_spread,
        Cost cost, const SwarmOptions& options = {});
  /// Uniformly distributed over the box at the start.
  Swarm(std::vector<double> lower, std::vector<double> upper, Cost cost, const SwarmOptions& options = {});
  /// Continues from `state`, to the same bits if cost and options are the same.
  Swarm(SwarmState state, Cost cost, const SwarmOptions& options = {});

  /// Lets all particles of a round be looked at together, before their costs are asked for: `prepare` receives each block's positions as a
  /// Cost does, then `together` is called once.
  using Prepare = std::function<void(std::size_t block, const double* x, std::size_t stride)>;
  void set_together(Prepare prepare, std::function<void()> together);

  /// Makes one round; the first one evaluates the initial positions. Returns kRunning, or the reason of the end; after the end
  /// it does nothing.
  SwarmStatus round(Threads* threads = nullptr);
  /// Makes rounds until the end.
  SwarmStatus run(Threads* threads = nullptr);
  SwarmStatus status() const;

  const SwarmState& state() const { return state_; }
  double best_cost() const { return state_.best_cost[state_.leader]; }
  /// Copies the best position, d.
  void best(std::span<double> x) const;
  /// True after a round that ended in stagnation: the next one starts with reconfigured particles. The owner may change
  /// coordinates now.
  bool stagnated() const { return state_.stagnated; }

  /// Changes coordinates to y = A (x − b) (A: d x d, row-major, orthogonal so that velocities keep their meaning). Positions,
  /// personal bests and velocities are transformed. `lower`, `upper`, `spread`: in the new coordinates. Costs do not change, so
  /// the cost function must use the new coordinates afterwards. Allocates.
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
  Prepare prepare_;
  std::function<void()> together_;
  std::vector<std::size_t> order_;        // scratch: particles by personal best
  std::vector<double> centres_;           // scratch: d x particles
  std::vector<std::uint32_t> informant_;  // particle whose personal best attracts each
};

}  // namespace cotwin::numerics
