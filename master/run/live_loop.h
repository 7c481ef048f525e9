#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/bus/live_run.h"
#include "master/engine/engine.h"

namespace cotwin {
class ByteReader;
class ByteWriter;
}  // namespace cotwin

/// The loop's side of bus::LiveRun: records of the watched signals, values that are set from outside, pause and stop.
namespace cotwin::master {

/// What others did to a run.
struct Influence {
  /// A value that was set: the run is repeated by an event of this time on this variable.
  struct Change {
    std::int64_t tick = 0;  // that began with it
    double time = 0;        // s
    std::string name;       // of the element
    Kind kind = Kind::kReal;
    double value = 0;
    std::string by;  // who set it; "": an observer without a name
  };
  /// A pause, step or stop.
  struct Command {
    std::int64_t tick = 0;  // before which it was taken
    double time = 0;        // s
    bus::RunVerb verb = bus::RunVerb::kPause;
    std::string by;
  };
  std::vector<bus::LiveRun::Deed> others;  // what was done beside the run
  std::vector<Change> changes;             // in their order
  std::vector<Command> commands;           // likewise, the first kMostListed
  std::int64_t more = 0;                   // further ones, which are not listed
  std::int64_t refused = 0;                // requests
  std::int64_t pauses = 0;
  double paused_seconds = 0;  // wall time
  bool stopped = false;       // the end of the run was asked for

  std::int64_t count() const { return static_cast<std::int64_t>(changes.size()) + more; }
};

/// Between two ticks of a run that is observed. Allocates nothing after the constructor, except in influence(), write() and read().
class LiveLoop {
 public:
  static constexpr std::size_t kMostListed = 100'000;  // changes
  static constexpr std::size_t kMostCommands = 10'000;

  /// The observers among the members; empty: the run needs no LiveLoop.
  static std::vector<bus::RunObserver*> observers(std::span<const Member> members);

  /// Call after the engine's initialise. `unpausable`, `page`, `results`: see bus::RunFacts.
  LiveLoop(const Scenario& scenario, std::span<const Member> members, Engine& engine, std::string unpausable,
           std::shared_ptr<bus::RunPage> page = nullptr, std::filesystem::path results = {});
  ~LiveLoop();
  LiveLoop(const LiveLoop&) = delete;
  LiveLoop& operator=(const LiveLoop&) = delete;

  const std::shared_ptr<bus::LiveRun>& run() const { return run_; }

  /// Before a tick: takes requests and sets the values that are due. False: the tick must not begin (pause, stop).
  bool begin_tick(std::int64_t tick, Time now) {
    if (!run_->calls().empty()) answer_calls(tick, now);
    if (now >= next_waiting_) apply_waiting(tick, now);
    return !paused_ && !stopped_;
  }
  /// Whether values were set since the last call.
  bool pop_changed() { return std::exchange(changed_, false); }
  bool paused() const { return paused_; }
  bool stopped() const { return stopped_; }
  /// In a pause: waits for a request, at most Clock::kSlice.
  void wait(std::int64_t tick);
  /// Whether the run goes on after a pause since the last call: its clock stood still.
  bool pop_resumed() { return std::exchange(resumed_, false); }

  /// After a tick, with the number of ticks so far: a record, if one is due.
  void end_tick(std::int64_t tick) {
    run_->set_tick(tick);
    if (steps_ > 0 && tick >= pause_at_) begin_pause();
    if (tick >= next_record_ || run_->requested()) record(tick);
  }
  /// The last record and the answer to all open requests: the run is over.
  void end(std::int64_t tick);

  Influence influence() const;
  /// The part of a checkpoint: changes so far, and those that wait for their time.
  void read(ByteReader& in, std::int64_t tick);
  static auto fields(auto& l, auto each) {
    return each(l.listed_, l.waiting_, l.taken_, l.more_, l.refused_, l.pauses_, l.changes_, l.paused_ns_);
  }
  void write(ByteWriter& out) const;

 private:
  struct Source {
    const void* value = nullptr;
    Kind kind = Kind::kReal;
  };
  struct Target {
    void* value = nullptr;
    double* rate = nullptr;
    Kind kind = Kind::kReal;
  };
  struct Waiting {
    Time time;
    bus::LiveRun::Value value;
    std::uint32_t by = 0;  // number of a name

    static auto fields(auto& w, auto each) { return each(w.time, w.value, w.by); }
  };
  struct Listed {
    std::int64_t tick = 0;
    bus::LiveRun::Value value;
    std::uint32_t by = 0;

    static auto fields(auto& l, auto each) { return each(l.tick, l.value, l.by); }
  };
  struct Taken {
    std::int64_t tick = 0;
    bus::RunVerb verb = bus::RunVerb::kPause;
    std::uint32_t by = 0;

    static auto fields(auto& t, auto each) { return each(t.tick, t.verb, t.by); }
  };

  void answer_calls(std::int64_t tick, Time now);
  bus::RunReply set_values(const bus::LiveRun::Call& call, std::int64_t tick, Time now, bus::LiveRun::Answer& answer);
  void apply_waiting(std::int64_t tick, Time now);
  void apply(const bus::LiveRun::Value& value, std::uint32_t by, std::int64_t tick);
  void find_next_waiting();
  void begin_pause();
  void end_pause();
  void record(std::int64_t tick);
  void adopt_plan(std::int64_t tick);
  static double read(const Source& source);
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

  Engine& engine_;
  std::shared_ptr<bus::LiveRun> run_;
  std::vector<Source> sources_;  // per channel
  std::vector<Target> targets_;  // per channel
  std::vector<Source> copied_;   // per place of the plan
  std::size_t places_ = 0;
  std::vector<double> record_;  // a header and the values
  std::uint64_t plan_ = 0;
  std::int64_t every_ = 0, next_record_ = kNever;

  std::vector<Waiting> waiting_;  // by time, then in the order of the requests
  Time next_waiting_{kNever};
  bool changed_ = false, paused_ = false, stopped_ = false, resumed_ = false, ended_ = false;
  std::int64_t steps_ = 0, pause_at_ = 0;
  std::vector<Listed> listed_;
  std::vector<Taken> taken_;
  std::int64_t more_ = 0, refused_ = 0, pauses_ = 0, changes_ = 0;
  std::int64_t pause_began_ = 0, paused_ns_ = 0;  // CLOCK_MONOTONIC
};

}  // namespace cotwin::master
