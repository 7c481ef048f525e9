#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/foundation/support/threads.h"
#include "models/optimisation/evaluation/problem.h"
#include "models/robot/inverse_kinematics.h"
#include "models/trajectory/series/series.h"

/// Joint motions that do not turn a free base (V-C, Fig. 7b). Without momentum its angular velocity is ω = Z(q) q̇, so it keeps its attitude
/// on motions within null(Z):
///   dq/ds = Σ_j α_j(s) b_j,   α_j = Σ_k c_jk φ_k(s),   s = t/T
/// The columns of b are orthonormal in null(Z) and carried along the motion without a turn of their own (parallel transport),
/// db/ds = (dP/ds) b with the projector P on null(Z): b is as smooth as Z, and dq/ds is projected once more. φ_k are those of
/// trajectory::RedundantTerms, so speed, acceleration and jerk are zero at both ends. The way q(s) does not depend on T.
namespace cotwin::optimisation {

/// From rest to rest. The base is B; B0 is B at the beginning.
struct ReactionlessProblem {
  robot::RobotModel robot;  // its base has a physical mass distribution
  std::vector<double> q_from;
  std::vector<double> q_to;  // the posture to reach; empty: any that brings `frame` to `target`
  robot::Frame frame;
  robot::TaskDirections directions;
  robot::PoseTarget target;  // in B0
  Bounds bounds;             // n each, without torques: speeds are kept low relative to theirs
  double T = 0;              // s, in which speed, acceleration and jerk are to keep their bounds; 0: any duration
};

struct ReactionlessOptions {
  int particles = 64;
  int rounds = 60;
  int attempts = 3;  // swarms with other seeds, until a motion reaches the goal within the limits
  std::uint64_t seed = 1;
};

/// The way of a motion. Same problem and options: same bits on any number of threads.
class ReactionlessMotion {
 public:
  /// Coefficients by the particle swarm, improved by Levenberg–Marquardt steps; where that does not reach the goal, from the nearest of
  /// 2048 motions that are drawn at random. Minimises the speeds; where no motion without reaction
  /// is found, the turn of the base at the end, and less so on the way. Throws Error for sizes that do not fit.
  ReactionlessMotion(const ReactionlessProblem& problem, const ReactionlessOptions& options, numerics::Threads* threads);
  ~ReactionlessMotion();

  /// "" for a motion without reaction, else why there is none: this one then turns the base, at the end as little as was found.
  const std::string& obstacle() const;
  /// What is left to the goal in its worst direction or joint, both below 1e-6 where it is reached.
  double distance() const;  // m
  double angle() const;     // rad
  bool reached() const;
  /// Postures at `steps` + 1 equidistant times in [0, T], for which the coefficients are corrected so that the end meets the goal to
  /// 1e-9 on this grid. Changes distance() and angle().
  trajectory::Series sample(double T, int steps);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Why motions have to turn the base, as in ReactionlessMotion::obstacle().
class NoReactionlessMotion : public Error {
 public:
  using Error::Error;
};

/// A motion of constrained data growing (V-C): it does not turn the base, and ends somewhere.
struct ReactionlessGrown {
  std::uint32_t number = 0;
  std::vector<double> q;   // n, at the end
  robot::PoseTarget pose;  // of the frame at the end, in B0
  double beyond = 0;       // rad or m: the most by which a joint leaves its limits on the way
  std::size_t joint = 0;   // that one
  double T = 0;  // s, the shortest that keeps the bounds of speed, acceleration and jerk at 50 steps; 0: none limits it
};

/// Draws motions of a problem without a goal and visits them in their order: motion k is a function of seed and k, on any number of
/// threads. Throws NoReactionlessMotion where every motion turns the base, and what `visit` throws.
void grow_reactionless(const ReactionlessProblem& problem, std::uint32_t motions, std::uint64_t seed,
                       numerics::Threads* threads, const std::function<void(const ReactionlessGrown&)>& visit);

}  // namespace cotwin::optimisation
