#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "master/engine/engine.h"
#include "master/engine/step_control.h"
#include "master/run/live_loop.h"
#include "master/run/master.h"
#include "master/run/recorder.h"
#include "master/run/separation_loop.h"
#include "master/run/tick_times.h"

namespace cotwin::master {

/// The state of a run, and its ticks: what Master holds.
class Master::Loop {
 public:
  Loop(Scenario scenario, MasterOptions options);

  void initialise();
  bool step_tick();
  void finish();
  Summary summary() const;
  std::vector<std::string> warnings() const;
  std::vector<robot::RobotHistory> histories() const { return engine_.tools.histories(now()); }
  Time now() const { return engine_.schedule.time(tick_); }
  std::int64_t ticks() const { return engine_.schedule.ticks(); }

  void values_changed() { control_.forget(); }
  void prepare_threads() { pace_.prepare_threads(engine_); }
  void save(std::function<void(RunState)> take, bool last);
  const std::string& unsavable() const { return unsavable_; }
  bool sync_recording(RunState& state) const {
    if (state.view && !view_.recorder->sync_to_mark(*state.view)) return false;
    return !state.recording || signals_.recorder->sync_to_mark(*state.recording);
  }
  std::span<const Column> columns() const { return columns_; }

  const Scenario scenario_;
  std::vector<Member> members_;
  std::int64_t tick_ = 0;

 private:
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

  /// A recorder that is sampled every so many ticks.
  struct Rows {
    std::unique_ptr<Recorder> recorder;         // nullptr: none
    std::int64_t every = 1;                     // ticks
    std::int64_t next = kNever, past = kNever;  // tick at whose beginning it is sampled; past: at the last checkpoint
    void sample(std::int64_t tick, std::int64_t last, Time now);
    void keep();
    void rewind();
  };

  bool at_end() const {
    return tick_ >= engine_.schedule.ticks() || engine_.finished_by() != Engine::kNoSlot || (live_ && live_->stopped());
  }
  void begin_observation();
  bool begin_live_tick();
  void end_beside() const;
  std::vector<bus::RunObserver*> observers() const;
  void observe(Time now);
  void record(Time now);
  void open_recordings();
  [[noreturn]] void fail_discarded(std::size_t slot) const;
  void save_checkpoint();
  void keep_past();
  bool may_go_back() const { return engine_.may_change() && control_.not_restorable() == nullptr; }
  void rewind();
  void pass_state();
  std::uint64_t hash_of_values() const;
  std::string why_unsavable();
  std::string state() const;
  void restore(const RunState& state);
  double wall_seconds() const;

  Engine engine_;
  StepControl control_;
  std::vector<std::string> omissions_;
  SeparationLoop separation_;
  Pace pace_;
  std::vector<Column> columns_;
  Statistics statistics_, past_statistics_;  // past: at the last checkpoint
  std::int64_t past_tick_ = -1;              // that checkpoint
  bool has_statistics_;
  bool waits_;                                   // for the clock
  std::filesystem::path recording_, view_file_;  // empty if there is none
  std::vector<Column> view_columns_;
  bool joint_names_ = false;
  Rows signals_, view_;
  std::int64_t next_row_ = kNever;  // the tick at whose beginning one of them is sampled
  Initialisation initialisation_;

  TickTimes times_;
  std::chrono::steady_clock::time_point begun_, ended_;
  bool running_ = false, finished_ = false;

  // For saving the run for another process.
  std::function<void()> before_results_;
  std::optional<RunState> resume_;
  std::function<void(const std::vector<std::string>&)> waiting_;
  std::function<void(RunState)> state_taker_;  // empty unless a state was asked for
  bus::RunObserver* observer_ = nullptr;
  std::shared_ptr<bus::RunPage> page_;
  std::filesystem::path results_;   // folder; empty: none
  std::unique_ptr<LiveLoop> live_;  // nullptr: nobody observes the run
  bool saves_anywhere_ = true;      // saving a unit does not change its later steps
  std::string unsavable_;
  std::uint64_t beginning_ = 0;
  double earlier_seconds_ = 0;  // of processes before this one
};

}  // namespace cotwin::master
