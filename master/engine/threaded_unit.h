#pragma once
#include <atomic>
#include <cstdint>
#include <exception>
#include <memory>
#include <semaphore>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "components/unit/snapshot.h"
#include "components/unit/unit.h"
#include "components/unit/unit_table.h"
#include "master/engine/wiring/members.h"
#include "master/scenario/scenario.h"

namespace cotwin::master {

/// Who makes the steps of a component that runs beside the loop, and what happens if one has not ended when the next is due.
enum class ThreadMode : std::uint8_t {
  kInStep,  // the caller: no thread (scenarios as one FMU)
  kWait,    // a thread; the loop waits for it, so that results do not depend on the machine
  kHold     // a thread; the loop goes on with the last outputs and never waits, and the next step is longer
};

/// A unit that steps on a thread of its own, beside the loop. It has its own copy of inputs, tunables, outputs and states, which is
/// exchanged as a whole between two of its steps: every step reads the values of one instant, and the loop sees the outputs
/// of one step. step(now, h) takes over the outputs of the step before, which hold at `now`, and starts the next one with the
/// present inputs. So outputs are one step older than those of a unit in the loop. All modes give the same bits as long as every
/// step has ended in time. Inputs are held over a step.
class ThreadedUnit final : public Unit {
 public:
  /// `name`: of the component, for errors.
  ThreadedUnit(Instance instance, ThreadMode mode, std::string name = {});
  ~ThreadedUnit() override;

  void declare(Variables& v) override;
  void initialise(Time start) override;
  /// Throws Error of the step that has ended (with kInStep: of this one), and if the unit discarded it.
  StepResult step(Time now, Duration h) override;
  /// Waits for the step that runs. Throws as check_last_step().
  void save_memory(std::string& bytes) override;
  void restore_memory(const std::string& bytes) override;
  /// False with kHold: the machine's speed decides when outputs change.
  bool restorable() const override { return mode_ != ThreadMode::kHold && inner_.unit->restorable(); }
  bool has_cheap_rollback() const override { return false; }
  void append_notes(std::vector<std::string>& sentences) const override;
  /// Waits for the step that runs.
  void end() noexcept override;

  /// Whether a step runs. From any thread.
  bool stepping() const { return !ready_.load(std::memory_order_acquire); }
  /// Waits for the step that runs. Throws Error, once, if it has failed or was discarded: "name at t = …".
  void check_last_step();
  /// The unit that makes the steps; only while none runs.
  Unit& inner() { return *inner_.unit; }

 private:
  /// Copies of the values of the unit's variables: what others see of them.
  struct Values {
    std::vector<double> reals;
    std::vector<std::int32_t> integers;
    std::unique_ptr<bool[]> booleans;
    std::vector<std::string> strings;
  };
  template <class Action>
  void for_each(const Action& action);
  void give(bool only_changeable);
  void take(bool only_results);
  void run();
  void make_step();
  void wait() const;
  void check_step();
  bool pop_results();

  Instance inner_;
  const ThreadMode mode_;
  const std::string name_;
  Values outer_;

  Time time_;             // end of the last step that was started
  bool pending_ = false;  // a step was started whose outputs were not taken over
  std::int64_t steps_ = 0, late_ = 0;
  Duration longest_;
  Snapshot snapshot_;

  // The step; written by the loop before it is started and by the thread until ready_.
  Time begin_;
  Duration length_;
  StepResult result_ = StepResult::kDone;
  std::exception_ptr failure_;
  std::atomic<bool> ready_ = true, quit_ = false;
  std::counting_semaphore<2> order_{0};  // a step, and the end of the thread
  std::thread thread_;
};

/// Replaces the components with beside="true" by units that step beside the loop. Throws Error if the scenario cannot have them.
/// Call before signals of the members are resolved.
void put_on_threads(const Scenario& scenario, std::span<Member> members, ThreadMode mode);

/// The member's unit if it steps beside the loop, else nullptr.
ThreadedUnit* beside_of(const Member& member);

}  // namespace cotwin::master
