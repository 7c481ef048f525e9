#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/unit/local_memory.h"
#include "components/unit/snapshot.h"
#include "master/engine/coupling/bonds.h"
#include "master/engine/coupling/extrapolation.h"
#include "master/engine/coupling/loop_report.h"
#include "master/engine/coupling/newton.h"
#include "master/engine/wiring/schedule.h"
#include "master/engine/wiring/wiring.h"

/// Steps the units of a loop together, with inputs and outputs that agree at the end of the step.
namespace cotwin::master {

/// The implicit interface of a group. Unknown are the real outputs x at the end of the step that feed inputs within the group.
/// An input goes linearly from its value at the beginning of the step to its value at the end. If its unit holds its inputs, it
/// has a mean of both, by the rule of choose_rule(). The units step from the same beginning until their outputs y(x) are x (class
/// Newton). If that does not converge, or if a unit discards its step, the step is divided.
class GroupSolver final : private CoupledOutputs {
 public:
  static constexpr int kMostHalvings = 10;

  /// `slots`: of the group; they must stay where they are. `links`: all of the scenario. `tolerance`: of the outputs at the end
  /// of a step, relative.
  GroupSolver(std::span<ScheduledUnit> slots, std::span<const Member> members, const std::vector<ResolvedConnection>& links,
              Bonds& bonds, double tolerance);
  GroupSolver(const GroupSolver&) = delete;
  GroupSolver& operator=(const GroupSolver&) = delete;

  /// Call after the initialisation of the units, so that steps allocate nothing.
  void prepare();
  /// Chooses what the units that hold their inputs get in steps of length `h`: the first of these rules with which a small deviation does not
  /// grow from the present state (measure_growth), or the one with which it grows least.
  ///   0. The rule without this call: where the gain of the loop at a Jacobian is small, the mean of the values at both ends of the step (second
  ///      order), else the value at the end. Inputs that an output at the end follows without delay get the value at the end.
  ///   1. The mean, three quarters of the value at the end, the value at the end; in a stiff loop in the opposite order, because the value at the
  ///      end damps what the step does not resolve.
  ///   2. The value at the beginning, for inputs with delay; for all.
  ///   3. The mean in steps of h/2 … h/16.
  /// Changes nothing else.
  void choose_rule(Time now, Duration h);
  /// Whether a unit holds an input, so that a rule matters.
  bool holds() const { return holds_; }
  /// The rule that choose_rule() has chosen.
  struct Rule {
    int number = -1;         // −1: none
    int least_halvings = 0;  // of a step
    friend bool operator==(const Rule&, const Rule&) = default;
  };
  Rule rule() const { return rule_; }
  /// Begins anew with the rule, without a Jacobian.
  void set_rule(Rule rule);
  /// Steps all units from `begin` to `end`. Inputs from outside have been set. Returns nullptr, or the slot that discarded the
  /// smallest part of the step. `seconds`: if not empty, the time of each slot's steps is added. Throws Error naming the members
  /// if the outputs do not converge even in the smallest part, and for an Error of a unit.
  const ScheduledUnit* step(Time begin, Time end, std::span<double> seconds);
  /// A slot that asked for the end of the run in the last step, or nullptr.
  const ScheduledUnit* finished() const { return finished_; }

  /// Largest magnitude of the eigenvalues of ∂y/∂x for a step of length `h` from the present state, which does not change; NaN
  /// if a unit discards such a step. From 1 on, explicit coupling diverges. Not between step() and step(): the Jacobian of the
  /// last step is lost.
  double loop_gain(Time now, Duration h);

  const LoopCounts& counts() const { return counts_; }
  void set_counts(const LoopCounts& counts) { counts_ = counts; }
  /// "drive, world"
  std::string names() const;
  std::size_t unknowns() const { return unknowns_.size(); }

  /// The numbers on which the next step depends: Jacobian, first guesses, scales.
  std::size_t state_size() const;
  void save(std::span<double> numbers) const;
  void restore(std::span<const double> numbers);

 private:
  using SteadyClock = std::chrono::steady_clock;
  class Trial;

  /// One element of an output that feeds inputs within the group.
  struct Unknown {
    double* value;
    const double* derivative;          // nullptr: not declared
    std::vector<std::size_t> readers;  // slots of the group whose inputs it feeds, ascending
  };
  /// One element of an input that an unknown feeds.
  struct Input {
    double* to;
    double* rate;  // nullptr: the input is held
    std::size_t unknown;
    double factor, offset;
    double share = 1;      // of the value at the end in a held one; the rest is the value at the beginning
    double begin = 0;      // value at the beginning of the part
    double deviation = 0;  // of a trial
    double at_end(const Eigen::VectorXd& x) const {
      return factor * x[static_cast<Eigen::Index>(unknown)] + offset + deviation;
    }
  };
  /// One element of an input that goes linearly over the step and that no unknown feeds.
  struct Outside {
    double* to;
    const double* rate;
    double begin = 0;  // value at the beginning of the step
  };
  struct PerSlot {
    std::vector<Input> inputs;
    std::vector<std::size_t> outputs;  // unknowns
    Snapshot begin;                    // of the part …
    LocalMemory* local = nullptr;      // if the unit has it, `begin` has the values of the variables alone …
    std::string memory;                // … and this the rest
    bool moved = false;                // it has stepped since it was at `begin`
    bool metered = false;
    StepResult result = StepResult::kDone;
  };

  bool evaluate(const Eigen::VectorXd& x, Eigen::VectorXd& y) override;
  bool linearise(const Eigen::VectorXd& x, Eigen::VectorXd& y, Eigen::MatrixXd& jacobian) override;
  bool probe(const Eigen::VectorXd& x, const Eigen::VectorXd& y, Eigen::MatrixXd& jacobian);
  void add(const ResolvedConnection& link, std::size_t from, std::size_t to);
  void find_outside();
  Newton::Outcome step_part(Time begin, Time end);
  void begin_part(Time begin, Time end);
  bool continues(Time begin) const;
  void restore_all();
  void accept(Time end);
  bool acts_with_delay(const Eigen::VectorXd& x, std::size_t unknown, std::size_t slot, const Eigen::MatrixXd& jacobian);
  void hold_shares(double share, bool all, const Eigen::VectorXd& x, Eigen::MatrixXd& jacobian);
  double increment(std::size_t unknown) const;
  void set_inputs(PerSlot& unit, const Eigen::VectorXd& x, Duration h);
  bool step_slot(std::size_t i, const Eigen::VectorXd& x, Duration h);
  void save_slot(std::size_t i);
  void restore_slot(std::size_t i);
  void look_for_maker(std::size_t i);
  void confirm_maker();
  std::string text_of_maker(Time at) const;
  const ScheduledUnit* fail(Newton::Outcome outcome, Time at) const;

  std::span<ScheduledUnit> slots_;
  std::span<const Member> members_;
  Bonds& bonds_;
  Newton::Limits limits_;
  std::vector<Unknown> unknowns_;
  std::vector<PerSlot> units_;  // per slot
  std::vector<Outside> outside_;
  bool holds_ = false;  // inputs are held
  Rule rule_;
  std::shared_ptr<Trial> trial_;  // shared: its type is known to group_solver_rules.cpp only

  // The present part of a step.
  Time begin_;
  Duration h_;
  std::span<double> seconds_;
  const ScheduledUnit *discarded_ = nullptr, *finished_ = nullptr;
  std::string error_;  // of `discarded_`; empty if it only discarded
  struct Maker {
    std::size_t slot, unknown;
    double value;
  };
  std::optional<Maker> maker_;  // the first unit of the last part that made a value which is not finite from inputs that were
  bool extrapolates_ = true;    // guesses of higher degree than a line

  Newton newton_;
  Eigen::VectorXd x_, first_x_, probe_, changed_, scale_, y_;
  Extrapolation guess_;
  Eigen::MatrixXd power_, square_;  // of the spectral radius
  int halvings_ = 0;                // of the last part that was made
  LoopCounts counts_;
};

}  // namespace cotwin::master
