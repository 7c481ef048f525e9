#pragma once
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "components/bus/feed.h"
#include "components/bus/queue.h"
#include "components/bus/service.h"
#include "components/bus/wake.h"
#include "components/unit/time.h"
#include "components/unit/variables.h"

/// A running twin as threads beside its loop see it: signals to watch, values to set, commands.
namespace cotwin::bus {

/// A variable of the run.
struct LiveSignal {
  std::string name;  // "drive.tau_J": component.variable
  std::string component, variable;
  Kind kind = Kind::kReal;
  Role role = Role::kOutput;
  std::size_t size = 1;     // elements
  std::size_t channel = 0;  // of the first element; the other ones follow it. Strings have none: they are listed only
  std::string si;           // unit of measure of a real; "" where elements differ
  Elements elements{};
  std::string description;
  double min = -std::numeric_limits<double>::infinity(), max = +std::numeric_limits<double>::infinity();
  bool discrete = false;      // a real output that is no point of a curve
  std::vector<bool> fed{};    // per element: a connection writes it
  std::vector<double> start;  // values when the observation began

  /// An input or a tunable that no connection feeds.
  bool settable(std::size_t element) const;
  /// One of its elements is.
  bool settable() const;
};

/// Some elements of a signal: "drive.q", "drive.q[2]".
struct LiveElements {
  const LiveSignal* signal = nullptr;
  std::size_t first = 0, count = 0;

  std::size_t channel() const { return signal->channel + first; }
};

enum class RunPhase : std::uint8_t { kRunning, kPaused, kEnded };
inline constexpr std::pair<const char*, RunPhase> kRunPhaseWords[] = {
    {"running", RunPhase::kRunning}, {"paused", RunPhase::kPaused}, {"ended", RunPhase::kEnded}};

class LiveRun;

/// How a browser shows a run, for whoever serves it. Its functions are called on threads of the servers, also at the same time.
class RunPage {
 public:
  virtual ~RunPage() = default;
  /// The HTML page. It has nothing of the run in it and asks its own origin for everything else.
  virtual const std::string& html() const = 0;
  /// Whether it shows the run, not only what a gateway has; else content() is not called.
  virtual bool shows_runs() const { return true; }
  /// What is shown of this run, as JSON. May take as long as reading the robots' files.
  virtual std::string content(const LiveRun& run) = 0;
};

/// What does not change during the run.
struct RunFacts {
  std::string scenario;
  Time start, stop;
  Duration tick;
  std::int64_t ticks = 0;              // until the stop time
  std::string clock;                   // "free", "wall", "arrivals", "locked"
  std::string unpausable;              // why the run cannot pause; empty: it can
  std::shared_ptr<RunPage> page = {};  // nullptr: none
  std::filesystem::path results = {};  // folder; empty: nothing is kept
};

/// Where the run is.
struct RunPosition {
  RunPhase phase = RunPhase::kRunning;
  std::int64_t tick = 0;     // ticks that have ended
  Time time;                 // at their end
  std::int64_t changes = 0;  // values set from outside so far
};

enum class RunVerb : std::uint8_t {
  kSet,     // values
  kPause,   // before the next tick
  kResume,  //
  kStep,    // some ticks, then pause
  kStop     // ends the run in order, before the next tick
};
constexpr RunVerb last(RunVerb) { return RunVerb::kStop; }

inline constexpr std::pair<const char*, RunVerb> kRunVerbWords[] = {{"set", RunVerb::kSet},
                                                                    {"pause", RunVerb::kPause},
                                                                    {"resume", RunVerb::kResume},
                                                                    {"step", RunVerb::kStep},
                                                                    {"stop", RunVerb::kStop}};

/// What became of a request.
enum class RunReply : std::uint8_t {
  kDone,
  kPast,  // the time at which values were to be set is before the next tick
  kFull,  // too many values wait for their time
  kEnded  // the run is over
};

class LiveRun {
 public:
  static constexpr std::size_t kMaxWatched = 4096;  // elements at once, of all watches together
  static constexpr std::size_t kMaxSet = 256;       // elements in one request
  static constexpr std::size_t kMaxWaiting = 1024;  // elements that wait for their time
  static constexpr std::size_t kMostNames = 4096;   // of those who send requests; further ones are "others"
  static constexpr std::size_t kMostDeeds = 10'000;
  static constexpr std::size_t kNone = ~std::size_t{0};
  static constexpr std::int64_t kAtOnce = std::numeric_limits<std::int64_t>::min();

  /// `signals`: without channels, which are numbered here.
  LiveRun(RunFacts facts, std::vector<LiveSignal> signals);
  ~LiveRun();

  // From any thread.
  const RunFacts& facts() const { return facts_; }
  std::span<const LiveSignal> signals() const { return signals_; }
  std::size_t channels() const { return channels_; }
  RunPosition position() const;
  Time time(std::int64_t tick) const { return tick < facts_.ticks ? facts_.start + tick * facts_.tick : facts_.stop; }
  /// The number of a name of those who send requests, which names() has at that place.
  std::uint32_t number_of(std::string_view name);
  std::vector<std::string> names() const;
  /// What somebody did that is no request to the run, such as an order of a job: for its record, which keeps the first kMostDeeds.
  struct Deed {
    std::int64_t tick = 0;  // ticks that had ended
    std::string what, by;

    static auto fields(auto& d, auto each) { return each(d.tick, d.what, d.by); }
  };
  void note(Deed deed);
  std::vector<Deed> deeds() const;
  /// "drive.q" or "drive.q[2]", counted from 1. Throws Error with the closest name.
  LiveElements find(std::string_view name) const;

  /// Values of some signals after a tick.
  struct Sample {
    std::int64_t tick = 0;
    Time time;
    std::vector<double> values;  // in the order of the names, element by element; integers and booleans as numbers
  };

  /// Signals that are watched. For one thread. Costs the loop one copy of the values per record, whatever the watcher does.
  class Watch {
   public:
    /// `every`: ticks between two records; 0: a record only after request(). The first record comes after the present tick. Throws
    /// Error for an unknown name, a string, more than kMaxWatched elements of all watches, and more than Feed::kMaxReaders watches.
    Watch(std::shared_ptr<LiveRun> run, std::span<const std::string> names, std::int64_t every = 1,
          std::shared_ptr<Wake> wake = nullptr);
    ~Watch();
    Watch(const Watch&) = delete;
    Watch& operator=(const Watch&) = delete;

    std::span<const LiveElements> elements() const { return elements_; }
    std::size_t size() const { return slots_.size(); }
    /// A record after the present tick, at once in a paused run.
    void request() { run_->request(); }
    /// The oldest record that was not taken; false: there is none.
    bool take(Sample& sample);
    /// The newest record; earlier ones are left out.
    bool pop_newest(Sample& sample);
    /// Waits for a record until CLOCK_MONOTONIC reaches `deadline`, ns. False: there is none.
    bool wait(std::int64_t deadline = kNever);
    /// Whether take() has one.
    bool ready() { return fetch(); }
    Wake& wake() { return reader_.wake(); }
    /// Records that came too fast for this watcher.
    std::uint64_t lost() const { return reader_.lost(); }

   private:
    bool read();
    bool fetch();

    std::shared_ptr<LiveRun> run_;
    std::vector<LiveElements> elements_;
    std::int64_t every_;
    std::vector<std::size_t> slots_;  // per element: its place in a record
    std::uint64_t since_ = 0;         // the first plan with all of them
    std::int64_t last_ = -1;          // tick of the last record
    std::vector<double> record_;
    Sample sample_;  // the next one, if held_
    bool held_ = false;
    Feed::Reader reader_;
  };

  struct Change {
    std::string name;            // "drive.K", "drive.K[2]"
    std::vector<double> values;  // one stands for all elements
  };
  struct Answer {
    RunReply reply = RunReply::kDone;
    std::int64_t tick = 0;  // the first tick that begins with the values, or does not begin because of the pause or the stop
  };

  /// Requests to the run. For one thread; one request at a time.
  class Control {
   public:
    /// `by`: who sends the requests, for the record of the run; "": nobody is named. Throws Error if there are Service::kMaxClients.
    explicit Control(std::shared_ptr<LiveRun> run, std::string_view by = "");
    ~Control();
    Control(const Control&) = delete;
    Control& operator=(const Control&) = delete;

    /// Sets values between two ticks, all between the same two: before the next one, or before the first that begins at or after `at`.
    /// Throws Error for an unknown name, a variable that cannot be set, another number of values, a value that is not finite, not of
    /// its kind or out of range, more than kMaxSet values, a run that has ended, and a request before whose answer did not come.
    void set(std::span<const Change> changes, std::optional<Time> at = {});
    /// `ticks`: of kStep, at least 1. Throws Error for a run that cannot pause, and as set().
    void command(RunVerb verb, std::int64_t ticks = 0);
    /// The answer to the last request; nothing: it has not come.
    std::optional<Answer> take();
    /// Waits for it until CLOCK_MONOTONIC reaches `deadline`, ns. Nothing: the loop has not begun the request and will not any more,
    /// or it was within a tick for that long.
    std::optional<Answer> wait(std::int64_t deadline);

   private:
    void prepare();
    void ask(RunVerb verb, std::int64_t number, std::size_t values);

    struct Slot;
    friend LiveRun;
    std::shared_ptr<LiveRun> run_;
    Slot* slot_;
    std::uint32_t by_;
    std::optional<std::uint64_t> open_;
  };

  // By the loop. Nothing of this blocks or allocates, except hold().

  /// What a record contains.
  struct Plan {
    std::uint64_t number = 0;
    std::int64_t every = 0;                   // ticks; 0: on request only
    std::span<const std::uint32_t> channels;  // kNoChannel: the place is free
  };
  static constexpr std::uint32_t kNoChannel = ~std::uint32_t{0};
  struct RecordHeader {
    std::int64_t tick = 0;
    std::uint64_t plan = 0;
  };
  struct Value {
    std::uint32_t channel = 0;
    double value = 0;

    static auto fields(auto& v, auto each) { return each(v.channel, v.value); }
  };
  struct Call {
    RunVerb verb = RunVerb::kSet;
    std::int64_t number = 0;  // ticks of kStep; time of kSet, ns, or kAtOnce
    const Value* values = nullptr;
    std::size_t count = 0;
    std::uint32_t by = 0;  // number of a name
  };
  using Calls = Service<Call, Answer>;

  /// The plan, if it has changed since the last call.
  bool pop_plan(Plan& plan);
  /// Whether a client has requested a record.
  bool requested() const { return requested_.load(std::memory_order_relaxed); }
  bool pop_request() { return requested_.exchange(false); }
  /// `record`: a RecordHeader and a double per place of the plan.
  void publish(std::span<const std::byte> record) { feed_.publish(record); }
  Calls& calls() { return calls_; }
  void set_tick(std::int64_t tick) { tick_.store(tick, std::memory_order_relaxed); }
  void set_changes(std::int64_t changes) { changes_.store(changes, std::memory_order_relaxed); }
  void set_phase(RunPhase phase) { phase_.store(phase, std::memory_order_release); }
  /// Waits for a call or a request until CLOCK_MONOTONIC reaches `deadline`, ns.
  void hold(std::int64_t deadline);

 private:
  struct PlanHeader {
    std::uint64_t number = 0;
    std::int64_t every = 0;
    std::uint64_t count = 0;
  };
  void request();
  void select(std::span<const LiveElements> elements, std::int64_t every, std::vector<std::size_t>& slots,
              std::uint64_t& since);
  void deselect(std::span<const std::size_t> slots, std::int64_t every);
  void pass_plan();
  Control::Slot* reserve_slot();

  const RunFacts facts_;
  std::vector<LiveSignal> signals_;
  std::unordered_map<std::string_view, std::size_t> by_name_;  // never iterated
  std::size_t channels_ = 0, places_ = 0;

  std::atomic<RunPhase> phase_ = RunPhase::kRunning;
  std::atomic<std::int64_t> tick_ = 0, changes_ = 0;

  // Watches.
  std::mutex mutex_;                     // of the clients: the loop does not take it
  std::vector<std::uint32_t> planned_;   // per place: its channel
  std::vector<std::uint32_t> watchers_;  // per place
  std::vector<std::size_t> place_of_;    // per channel; kNone
  std::vector<std::int64_t> intervals_;  // `every` of the watches
  std::uint64_t plan_ = 0;
  TripleBuffer plans_;
  alignas(64) std::atomic<bool> requested_ = false;
  Feed feed_;

  // Requests.
  std::shared_ptr<Wake> wake_;
  Calls calls_;
  std::vector<std::unique_ptr<Control::Slot>> slots_;  // each of a client; in use by one Control or none
  mutable std::mutex naming_;
  std::vector<std::string> names_{""};  // guarded by naming_; only added to
  std::vector<Deed> deeds_;             // likewise
};

/// A unit that reads and changes the run that it is part of. The master calls observe() once, after the initialisation of all
/// units. The unit may keep the run and use it on other threads, also after its end.
class RunObserver {
 public:
  virtual ~RunObserver() = default;
  virtual void observe(std::shared_ptr<LiveRun> run) = 0;
  /// Where clients reach an observer that is a server, "http://127.0.0.1:8080"; empty: it is none, or is not started.
  virtual std::string url() const { return {}; }
};

}  // namespace cotwin::bus
