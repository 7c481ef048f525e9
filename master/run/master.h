#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "master/run/clock.h"
#include "master/run/initialisation.h"
#include "master/run/members.h"
#include "master/run/recorder.h"
#include "master/run/statistics.h"
#include "master/ssp/scenario.h"

/// The master: makes the units of a scenario step together. A library: no globals, no signal handlers, nothing printed.
namespace cotwin::master {

/// All that a run needs to go on in another process: units, events, figures of the summary, and where in the recording it is.
struct RunState {
  std::uint64_t beginning = 0;              // a hash of all numbers at the start time: other values, another run
  std::optional<Recorder::Kept> recording;  // its bytes are known when Master::sync_recording() has returned
  double wall_seconds = 0;                  // so far
  std::string bytes;
};

struct MasterOptions {
  std::span<const UnitType> types;             // units that sources may name
  std::vector<std::filesystem::path> folders;  // where units look up named data
  std::filesystem::path results;               // folder for signals.csv; empty: nothing is recorded
  std::optional<int> threads;                  // instead of the scenario's
  bool always_threads = false;                 // use the threads even where they do not pay
  std::unique_ptr<Clock> clock;                // instead of the scenario's
  std::function<void()> before_results;        // called when all units agree, before a file of results is touched
  std::optional<RunState> resume;              // goes on from there
};

/// What a run was like.
struct Summary {
  struct Share {
    std::string name;
    double seconds_per_step = 0;  // mean, from sampled steps
    double share = 0;             // of the loop's time, without waiting for a clock
    std::int64_t samples = 0;     // steps that were timed
  };
  std::string scenario;
  double start = 0, reached = 0, stop = 0;  // s
  double tick = 0;                          // s
  std::int64_t ticks = 0;
  double wall_seconds = 0;      // from the first tick until all files are written
  double real_time_factor = 0;  // simulated / wall
  int threads = 1;              // that were used at least once
  Initialisation initialisation;
  std::vector<Share> units;   // in the order of the scenario
  double exchange_share = 0;  // likewise, of the loop itself: events, copies of values, waiting for threads
  double check_share = 0;     // looking for NaN,
  double observe_share = 0;   // figures of this summary and rows of the recording
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
  std::int64_t discarded = 0;  // ticks that somebody discarded
  std::vector<std::pair<std::string, std::int64_t>> discarded_by;
  int most_parts = 1;  // into which a tick was cut
  double mean_parts = 1;
};

class Master {
 public:
  /// Loads the units and wires them. Throws Error, as everything here does where a human must act.
  Master(Scenario scenario, MasterOptions options);
  Master(Master&&) noexcept;
  ~Master();

  /// Makes all units agree at the start time, opens the recording and takes the first sample. What fails before that leaves the
  /// results of an earlier run as they are.
  void initialise();
  /// Steps by one tick (to the stop time at most), or by none if a signal came while it waited for the clock. Returns false if
  /// the stop time is reached. Allocates nothing after initialise(). Throws Error for a NaN, a discarded step that cannot be
  /// repeated, a unit or a recording that fails; then only finish() and summary() may be called.
  bool step_tick();
  /// To be called after the values of members were changed between two ticks: a tick that must be repeated begins with them.
  void values_changed();
  /// What the user should know so far: of the scenario, what it probably forgot, and of its units. More may come.
  std::vector<std::string> warnings() const;
  /// Writes everything to the end and closes the files. May be called at any time, and again.
  void finish();

  /// Why no other process could go on with this run, "'io' cannot be saved"; empty if it could. After initialise().
  const std::string& unsavable() const;
  /// Hands the state of the run to `take` as soon as that changes no bit of what follows: at once where all units are this
  /// program's, else at the next tick at which the loop saves them anyway (every 256 ticks). Between two calls of step_tick(),
  /// and again only after `take` was called and sync_recording() returned. Throws Error if the run is unsavable.
  void save(std::function<void(RunState)> take);
  /// From another thread, before finish(): waits until the recording is on the disk up to the last save, and returns its length
  /// there in bytes; nothing if it cannot be written.
  std::optional<std::uint64_t> sync_recording() const;

  /// Where the run is.
  Time now() const;
  std::int64_t tick() const;
  std::int64_t ticks() const;
  const Scenario& scenario() const;
  std::span<Member> members();
  /// What is recorded.
  std::span<const Column> columns() const;
  Summary summary() const;

 private:
  class Loop;
  std::unique_ptr<Loop> loop_;
};

}  // namespace cotwin::master
