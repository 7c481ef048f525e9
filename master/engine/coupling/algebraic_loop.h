#pragma once
#include <Eigen/Core>
#include <array>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "master/engine/coupling/newton.h"
#include "master/engine/wiring/schedule.h"
#include "master/engine/wiring/wiring.h"

namespace cotwin::master {

/// Values of the outputs that feed a cycle of units, while the cycle is swept: after the first initialisation, after one sweep,
/// before the last sweep and after it.
struct SweptValues {
  std::map<const double*, std::array<double, 4>> of;
  bool complete = false;  // every sweep was made to its end
};

/// An algebraic loop: units whose outputs follow inputs at once, at initialisation. Solves y(x) = x by Newton's method, where x
/// are the real outputs that feed inputs within the loop, and y(x) what the units compute if these inputs are given by x. ∂y/∂x
/// is computed by differences: per unknown, one initialisation of the units whose inputs it feeds. Connections of other kinds
/// are copied between the units, for given x, until they do not change any more.
///
/// The first guess of an unknown is the start value that the scenario gives to it or to an input that it feeds. Otherwise it is
/// the value at the end of the sweeps where these approached a solution, else at their beginning. Without a start value a second
/// solution of a nonlinear loop is searched for, by deflation (Farrell, Birkisson and Funke, SIAM J. Sci. Comput. 37, 2015).
class AlgebraicLoop final : private CoupledOutputs {
 public:
  /// The system that the loop is a part of. `initialise` computes a slot's outputs from its present inputs; may throw Error.
  struct System {
    std::span<const Member> members;
    const Schedule& schedule;
    const std::vector<ResolvedConnection>& links;
    Wiring& wiring;
    std::function<void(std::size_t slot)> initialise;
  };
  AlgebraicLoop(const System& system, std::vector<std::size_t> slots);

  /// Leaves the units initialised at the solution: |y − x| <= 1e-12 · (1 + |x|), or 1e-8 where rounding errors of the units
  /// permit no less. Returns the number of Newton's iterations. Throws Error with the names of the loop's members if there is no
  /// solution, no unique one, or more than one and no start value.
  int solve(const SweptValues& swept);

 private:
  struct Unknown {
    double* at;
    std::string name, si;            // of the output
    std::string input;               // one that it feeds
    std::optional<double> given;     // first guess, from a start value
    std::vector<std::size_t> feeds;  // units whose inputs it feeds: indices of slots_
  };
  class Deflated;

  void add(const ResolvedConnection& link, std::size_t from, std::size_t to);
  bool evaluate(const Eigen::VectorXd& x, Eigen::VectorXd& y) override;
  bool linearise(const Eigen::VectorXd& x, Eigen::VectorXd& y, Eigen::MatrixXd& jacobian) override;
  bool probe(const Eigen::VectorXd& x, Eigen::Index j, double moved);
  void swap_outputs(Eigen::VectorXd& values);
  void update(const Eigen::VectorXd& x, std::span<const std::size_t> units);
  void initialise(std::size_t unit);
  bool settle(const Eigen::VectorXd& x);
  Eigen::VectorXd first_guess(const SweptValues& swept) const;
  Newton::Outcome run(Newton& newton, Eigen::VectorXd& x);
  bool is_linear(const Eigen::VectorXd& x);
  std::optional<Eigen::VectorXd> find_second(const Eigen::VectorXd& x, const Eigen::VectorXd& guess);
  std::string member_names() const;
  [[noreturn]] void fail(const std::string& what) const;
  [[noreturn]] void fail_ambiguous(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const;

  System system_;
  std::vector<std::size_t> slots_, all_;  // all_: indices of slots_
  std::vector<Unknown> unknowns_;
  std::vector<std::vector<Eigen::Index>> rows_;  // per unit: its unknowns
  bool has_other_kinds_ = false;                 // connections of integers, booleans or strings within the loop
  std::vector<bool> stale_;                      // per unit: inputs were changed since its outputs were computed
  Eigen::VectorXd scratch_, at_;                 // at_: of the last evaluation
  std::string first_error_, last_error_;         // of a unit
  int iterations_ = 0, evaluations_ = 0;
  bool nonlinear_ = false;  // seen by Newton's method
};

}  // namespace cotwin::master
