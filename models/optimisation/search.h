#pragma once
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "models/foundation/support/threads.h"
#include "models/optimisation/judgement/device_judge.h"
#include "models/trajectory/trajectory.h"

namespace cotwin::optimisation {

/// The particles of one round, for whoever keeps them (data growing).
struct Round {
  int stage = 0, round = 0;
  struct Particle {
    std::vector<double> c;                          // n · (degree − 5)
    std::vector<double> q_to;                       // n
    double T = 0;                                   // s
    std::vector<double> costs;                      // of each cost term; NaN for a particle that was pruned
    double kinematic = 0, torque = 0;               // violations, see Values
    std::vector<ComplianceValues> compliance = {};  // of each axis of Problem::compliant
    std::vector<double> q_from = {};                // n; empty: that of Problem::ends
    std::uint64_t number = 0;                       // of a grown motion
    bool feasible() const { return kinematic == 0 && torque == 0; }
  };
  std::vector<Particle> particles;
};

struct SearchOptions {
  int particles = 200;
  int rounds = 500;  // of all stages together
  std::uint64_t seed = 1;
  bool refine = true;  // Newton's method from the best particle (barrier.h)
  /// The search ends with the best motion so far when this many motions were evaluated. Looked at between rounds and Newton's
  /// steps, so that it can be exceeded by one of them.
  std::uint64_t evaluations = std::numeric_limits<std::uint64_t>::max();
  double limit = std::numeric_limits<double>::infinity();  // s of real time, the same; the result then depends on the machine
  /// kAuto: a GPU for 10⁴ particles and more, if there is one; kGpu: one for any number, or an Error. The refinement is the processor's.
  DeviceUse device = DeviceUse::kAuto;
  /// Called with the GPU that judges the particles from now on and its DeviceJudge::rounding(); or with "" and the reason why this processor does.
  std::function<void(const std::string& device, double rounding, const std::string& reason)> on_device = {};
  /// Called between Newton's steps of the refinement; ends the search by returning false.
  std::function<bool()> on_step = {};
  /// Called after each round; ends the search by returning false.
  std::function<bool(const Round&)> on_round = {};
};

enum class Status {
  kFeasible,
  kBestEffort,  // the best motion violates a bound by less than 1 %
  kInfeasible
};
const char* to_text(Status status);  // "feasible", "best-effort", "infeasible"

/// A bound and the motion's largest value there.
struct Peak {
  std::string bound;  // "q", "dq", "ddq", "dddq", "tau"
  std::size_t joint = 0;
  double value = 0;                                        // of largest magnitude relative to the bound, in the bound's unit
  double t = 0;                                            // s
  double limit = std::numeric_limits<double>::infinity();  // the bound that is closest to it
  double share = 0;  // of the bound that is used: 1 at the bound; of positions from the middle of the range
};

/// The peaks of each joint of a motion, for q, dq, ddq, dddq and tau, against bounds.
struct Judgement {
  std::vector<Peak> peaks;
  double worst = 0;    // the largest share, at least 1 + 1e-9; +∞ with values that are not finite
  std::string reason;  // the joint, the time and the bound that is violated most; empty if none is
};
/// `torques`: the largest of each joint.
Judgement judge(const robot::RobotModel& robot, const Bounds& bounds, const trajectory::Path& path,
                std::span<const trajectory::Peak> torques);

/// A motion that was found.
struct Solution {
  Status status = Status::kInfeasible;
  std::string reason;  // the joint, the time and the bound that is violated most; empty if feasible
  double T = 0;        // s
  int degree = 5;
  std::vector<double> c;                     // n · (degree − 5), joint by joint
  std::vector<double> q_to;                  // n
  std::vector<double> costs;                 // of each cost term
  double cost = 0;                           // Σ weight · cost
  std::vector<Peak> peaks;                   // of each joint, for q, dq, ddq, dddq and tau
  trajectory::Path path;                     // joints over t in [0, T]
  std::vector<ComplianceValues> compliance;  // of each axis of Problem::compliant
  std::vector<AxisResponse> responses;       // likewise
  std::vector<double> optima;                // minimise_in_order: of each cost, within the bounds of the earlier ones
  std::vector<double> history;               // best cost after each round, violations included
  std::uint64_t evaluations = 0, pruned = 0;
  bool complete = true;  // false: ended by SearchOptions::evaluations, limit or a callback
};

/// Costs and peaks of one motion: kinematics exact, torques at ten times the problem's samples. `c`, `q_to` and `compliance` as in
/// Solution; without `compliance` the middle of its ranges (geometric mean).
Solution assess(const Problem& problem, std::span<const double> c, std::span<const double> q_to, double T,
                std::span<const ComplianceValues> compliance = {});

/// Places in (0, 1) at which assess() looks at the torques of a path: at least ten times the problem's samples, between its knots and where loads
/// come and go.
Quadrature places(const Problem& problem, const trajectory::Path& path);
/// Costs (time, torque, work, shared_work, acceleration, jerk) and peaks of a motion of any kind in place of the problem's polynomials; without c.
/// Times are those of the path. Throws Error for other costs.
Solution assess(const Problem& problem, const trajectory::Path& path);

/// The parameters of Problem::compliant of least Σ weight · cost for a motion as assess() takes it, or of least settling time if no
/// cost with a weight depends on them; with Deb's rules for its conditions. Searched from `start` (empty: the middle).
std::vector<ComplianceValues> best_compliance(const Problem& problem, std::span<const double> c, std::span<const double> q_to,
                                              double T, std::span<const ComplianceValues> start, std::uint64_t seed);

/// Minimises Σ weight · cost by a particle swarm with Deb's rules: a feasible motion is better than an infeasible one, of two
/// infeasible ones the one with the smaller violation; kinematic violations are counted before those of torques. The
/// coordinates of the swarm are c_r in the metric of ∫ Σ τ² dt about the start, ln T, the place among the end postures, and the
/// logarithms of the parameters of the compliant frame. These are not refined by Newton's method, since settling times leap: they are
/// searched again for each refined motion.
/// Stages with ever smaller swarms about the best motion follow one another; a feasible result is refined by Newton's method. Same problem, options and seed: same bits on any
/// number of threads.
Solution minimise(const Problem& problem, const SearchOptions& options = {}, numerics::Threads* threads = nullptr);
/// The same about a feasible motion of this problem or of one with another end; no worse than that motion with the end posture that
/// is nearest to its own. Throws Error if that motion has another number of joints, coefficients or compliant axes.
Solution minimise_from(const Problem& problem, const Solution& start, const SearchOptions& options = {},
                       numerics::Threads* threads = nullptr);

/// Minimises the costs one after another: each in the set in which no earlier one exceeds its optimum by more than
/// `tolerance` (relative). Weights are not used.
Solution minimise_in_order(const Problem& problem, double tolerance, const SearchOptions& options = {},
                           numerics::Threads* threads = nullptr);

/// Feasible motions none of which is better than another in all costs, in ascending order of the first cost.
class Archive {
 public:
  explicit Archive(std::size_t capacity = 200) : capacity_(capacity) {}
  /// Whether a member is at least as good in all costs.
  bool covers(std::span<const double> costs) const;
  /// Returns whether the particle was kept. If the archive is full, the most crowded motion is dropped.
  bool add(const Round::Particle& particle);
  const std::vector<Round::Particle>& members() const { return members_; }

 private:
  std::size_t capacity_;
  std::vector<Round::Particle> members_;
};

/// The Pareto front of two or more costs: searches with weights that are spread over the simplex (`directions` of them, costs
/// in units of their spread), and the archive of the quintic, all their particles and their results, each as assess() sees it.
/// Limits of the options hold for all searches together; `complete`: whether none was reached; `evaluations`: of all searches.
std::vector<Round::Particle> pareto_front(const Problem& problem, int directions, const SearchOptions& options = {},
                                          numerics::Threads* threads = nullptr, bool* complete = nullptr,
                                          std::uint64_t* evaluations = nullptr);

}  // namespace cotwin::optimisation
