#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/bus/live_run.h"
#include "master/engine/coupling/bonds.h"
#include "master/engine/coupling/initialisation.h"
#include "master/engine/coupling/loop_report.h"
#include "master/engine/wiring/members.h"
#include "master/run/live_loop.h"
#include "master/run/pace.h"
#include "master/run/recorder.h"
#include "master/run/statistics.h"
#include "master/scenario/scenario.h"

namespace cotwin::robot {
struct RobotHistory;
}

/// The master: steps the units of a scenario together. As a library it has no globals and no signal handlers, and prints
/// nothing.
namespace cotwin::master {

/// Everything that another process needs to continue a run: states of units and events, figures of the summary, position in the
/// recording.
struct RunState {
  std::uint64_t beginning = 0;  // hash of all numbers at the start time, which identifies the run
  /// Of signals.csv and view.bin. Length and hash are known after Master::sync_recording().
  std::optional<Recorder::Kept> recording, view;
  double wall_seconds = 0;  // so far
  std::string bytes;

  static auto fields(auto& s, auto each) { return each(s.beginning, s.recording, s.view, s.wall_seconds, s.bytes); }
};

struct MasterOptions {
  std::span<const UnitType> types;             // available units
  std::vector<std::filesystem::path> folders;  // where units search for named data
  std::shared_ptr<FileStore> models{};         // keeps robots and cells for other runs with these folders; nullptr: none
  std::filesystem::path results;               // folder for signals.csv; empty: no recording
  bool joint_names = false;                    // columns of signals.csv have the names of joints in place of their numbers
  bool view_data = false;                      // view.bin in that folder, for pages, where the recording lacks what they show
  std::optional<int> threads;                  // instead of the scenario's
  bool always_threads = false;                 // use the threads even where they are slower
  std::unique_ptr<Clock> clock;                // instead of the scenario's
  HostTime* host = nullptr;                    // instead of the system's time; must outlive the master
  std::function<void()> before_results;        // called after the initialisation, before any file of results is changed
  std::optional<RunState> resume;              // continue from this state
  /// Called by finish() after a second of waiting for steps beside the loop, with the names of their components.
  std::function<void(const std::vector<std::string>&)> waiting{};
  /// Watches and influences the run, beside the units that do (bus::RunObserver). May be nullptr; used by initialise().
  bus::RunObserver* observer = nullptr;
  /// How a browser shows the run, for observers that serve it. May be nullptr.
  std::shared_ptr<bus::RunPage> page = nullptr;
};

/// Elements of an output whose values at the end are in the summary.
inline constexpr std::size_t kMostElementsOfEnds = 64;

/// Result of a run.
struct Summary {
  struct Share {
    std::string name;
    double seconds_per_step = 0;  // mean of the timed steps
    double share = 0;             // of the loop's time, without waiting for the clock
    std::int64_t samples = 0;     // timed steps
  };
  /// An output at the end.
  struct End {
    std::string name, si;        // "drive.q"
    std::vector<double> values;  // all of its elements
    Elements elements{};
  };
  std::string scenario;
  double start = 0, reached = 0, stop = 0;  // s
  double tick = 0;                          // s
  std::int64_t ticks = 0;
  double wall_seconds = 0;      // from the first tick until all files are written
  double real_time_factor = 0;  // simulated / wall
  int threads = 1;              // used at least once
  Initialisation initialisation;
  std::vector<Share> units;   // in the order of the scenario
  double exchange_share = 0;  // of the loop's time: events, checkpoints, exchange, waiting for threads
  double check_share = 0;     // likewise: search for NaN
  double observe_share = 0;   // likewise: figures of this summary and rows of the recording
  std::vector<Tally> tallies;
  std::vector<Work> works;
  std::vector<Compared> comparisons;
  std::vector<Bonded> bonds;
  std::vector<std::string> warnings;  // of units and of the run, each once
  std::vector<std::string> notes;     // of units (Unit::tell), "name: …"
  std::filesystem::path recording;    // empty if there is none
  std::int64_t rows = 0, dropped_rows = 0;
  std::int64_t overruns = 0;   // late ticks of a real-time run
  double worst_delay = 0;      // s
  ClockReport clock;           // since a resumption; without figures if the clock is free
  std::int64_t discarded = 0;  // tries of ticks that a unit discarded
  std::vector<std::pair<std::string, std::int64_t>> discarded_by;
  int most_parts = 1;  // largest number of parts of a tick
  double mean_parts = 1;
  std::int64_t rejected = 0;      // steps that missed the tolerance and were repeated
  std::vector<LoopReport> loops;  // of continuous connections
  Influence influence;            // by observers of the run
  std::vector<End> ends;          // of outputs with at most kMostElementsOfEnds elements that are no text
};

class Master {
 public:
  /// Loads the units and resolves the connections. Throws Error, as all functions here do if the user must act.
  Master(Scenario scenario, MasterOptions options);
  Master(Master&&) noexcept;
  ~Master();

  /// Initialises all units at the start time, opens the recording and takes the first sample. A failure before the recording is
  /// opened leaves the results of an earlier run unchanged.
  void initialise();
  /// Gives the calling thread and the workers the priority, CPUs and memory that the scenario's clock asks for. Call after
  /// initialise() on the thread that calls step_tick(); otherwise the first step_tick() does it. What is not permitted is a warning.
  void prepare_threads();
  /// Makes one tick, at most to the stop time; none if a signal interrupted the wait for the clock, and while the run is paused. Returns false at the end of
  /// the run. Allocates nothing. Throws Error for a NaN, a discarded step that cannot be repeated, or a failure of a unit or of
  /// the recording; then only finish() and summary() may be called.
  bool step_tick();
  /// Call after the values of members were changed between two ticks: a tick that must be repeated begins with them.
  void values_changed();
  /// The warnings so far: of the scenario, its probable omissions, and its units.
  std::vector<std::string> warnings() const;
  /// Ends the units, writes all data and closes the files; then waits for the steps beside the loop. May be called at any time,
  /// and repeatedly. Throws Error, after all that, if the files cannot be written or the last step of a component beside the loop has
  /// failed.
  void finish();

  /// Why another process could not continue this run, "'io' cannot be saved"; empty if it could. Valid after initialise().
  const std::string& unsavable() const;
  /// Passes the state of the run to `take` as soon as that does not change a bit of the results: at once if all units are of
  /// this program and no loop may be solved later, otherwise at the next checkpoint of the loop (every 256 ticks). `last`: the run
  /// is not continued here, so that a loop need not be waited for. Call between two calls of step_tick(), and
  /// again only after `take` was called and sync_recording() has returned. Throws Error if the run cannot be saved.
  void save(std::function<void(RunState)> take, bool last = false);
  /// Call on another thread, before finish(). Waits until the recording is on the disk up to the last save and tells the state its
  /// length and hash. False: it cannot be written.
  bool sync_recording(RunState& state) const;

  /// Position of the run.
  Time now() const;
  std::int64_t tick() const;
  std::int64_t ticks() const;
  const Scenario& scenario() const;
  std::span<Member> members();
  /// The recorded variables.
  std::span<const Column> columns() const;
  Summary summary() const;
  /// The robots whose tools have changed so far (Tools::histories).
  std::vector<robot::RobotHistory> histories() const;

 private:
  class Loop;
  std::unique_ptr<Loop> loop_;
};

}  // namespace cotwin::master
