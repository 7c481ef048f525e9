// The choice of what held inputs get in a solved step.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "master/engine/coupling/group_solver.h"
#include "master/engine/coupling/held_rules.h"
#include "master/engine/coupling/step_growth.h"

namespace cotwin::master {

namespace {

constexpr std::size_t kMostTrialSteps = 2048;  // with a rule
constexpr std::size_t kTrialValues = 16384;    // these steps times the unknowns

}  // namespace

/// The solver as it steps with its present rule, without effect on counts and bonds.
class GroupSolver::Trial final : public CoupledSteps {
 public:
  explicit Trial(GroupSolver& solver) : solver_(solver) {
    for (ScheduledUnit& slot : solver.slots_) slots_.push_back(&slot);
    for (const Unknown& unknown : solver.unknowns_) values_.push_back(unknown.value);
  }
  /// Before the first step from the present state, and after the last one.
  void open() {
    counts_ = solver_.counts_;
    // What better guesses leave of the tolerance differs between the two runs that are compared, and would be taken for growth.
    solver_.extrapolates_ = false;
    metered_.clear();
    for (PerSlot& unit : solver_.units_) metered_.push_back(std::exchange(unit.metered, false));
    magnitudes_.clear();
    for (std::size_t k = 0; k < values_.size(); ++k)
      magnitudes_.push_back(std::max(solver_.scale_[static_cast<Eigen::Index>(k)], std::abs(*values_[k])));
  }
  void close() {
    for (std::size_t i = 0; i < metered_.size(); ++i) solver_.units_[i].metered = metered_[i];
    solver_.counts_ = counts_;
    solver_.finished_ = nullptr;
    solver_.extrapolates_ = true;
  }

  bool step(Time begin, Duration h) override {
    const bool made = solver_.step(begin, begin + h, {}) == nullptr;
    for_inputs([](Input& input) { input.deviation = 0; });
    return made;
  }
  void deviate() override {
    for_inputs([&](Input& input) {
      input.deviation = deviation_of(input.unknown) * magnitudes_[input.unknown] * input.factor;
      *input.to += input.deviation;
    });
  }
  std::span<double* const> values() const override { return values_; }
  double magnitude(std::size_t value) const override { return magnitudes_[value]; }
  std::span<ScheduledUnit* const> slots() const override { return slots_; }
  std::span<const Member> members() const override { return solver_.members_; }
  std::vector<double> numbers() const override {
    std::vector<double> numbers(solver_.state_size());
    solver_.save(numbers);
    return numbers;
  }
  void set_numbers(std::span<const double> numbers) override {
    solver_.restore(numbers);
    for_inputs([](Input& input) { input.deviation = 0; });
  }

 private:
  template <class Call>
  void for_inputs(Call call) {
    for (PerSlot& unit : solver_.units_) std::ranges::for_each(unit.inputs, call);
  }

  GroupSolver& solver_;
  LoopCounts counts_;
  std::vector<ScheduledUnit*> slots_;
  std::vector<double*> values_;
  std::vector<double> magnitudes_;
  std::vector<bool> metered_;
};

void GroupSolver::set_rule(Rule rule) {
  rule_ = rule;
  halvings_ = rule.least_halvings;
  newton_.set_known(false);
  for (PerSlot& unit : units_) {
    for (Input& input : unit.inputs) input.share = 1;
  }
}

void GroupSolver::choose_rule(Time now, Duration h) {
  if (!holds_) return;
  set_rule({});
  const bool stiff = !(loop_gain(now, h) <= kStiffGain);
  std::vector<Rule> rules;
  for (int number = 0; number < kHeldRuleCount; ++number) rules.push_back({number, 0});
  if (stiff) std::reverse(rules.begin(), rules.begin() + kDampingRules);
  rules.insert(rules.begin(), Rule());
  for (int halvings = 1; halvings <= kMostRuleHalvings; ++halvings) rules.push_back({0, halvings});
  const auto steps = static_cast<int>(std::min(kMostTrialSteps, kTrialValues / std::max<std::size_t>(1, unknowns_.size())));
  Rule best;
  double least = std::numeric_limits<double>::infinity();
  if (!trial_) trial_ = std::make_shared<Trial>(*this);
  trial_->open();
  for (const Rule& rule : rules) {
    set_rule(rule);
    const StepGrowth growth = measure_growth(*trial_, now, h, steps);
    if (!growth.grows && !std::isnan(growth.factor)) {
      best = rule;
      break;
    }
    if (growth.factor < least) {
      least = growth.factor;
      best = rule;
    }
  }
  trial_->close();
  set_rule(best);
}

}  // namespace cotwin::master
