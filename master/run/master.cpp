#include "master/run/master.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <utility>
#include <variant>

#include "fmu/import/fmu_unit.h"
#include "master/run/engine.h"
#include "master/run/omissions.h"
#include "master/run/recorder.h"
#include "master/run/step_control.h"
#include "models/support/bytes.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::master {

namespace {

// Ticks between two whose units are timed, as few as cost at most kMeasuring: a clock costs as much as a light unit. Primes, so
// that no period of the scenario is always met or always missed.
constexpr std::array<std::int64_t, 5> kSampleEvery = {61, 127, 251, 509, 1021};
constexpr double kMeasuring = 0.01;        // of the run's time
constexpr int kLaps = 4;                   // readings of the clock in such a tick, without those of its units
constexpr std::int64_t kSampleAll = 1024;  // a run of fewer ticks is timed throughout
constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
constexpr std::int64_t kCarefulTicks = 64;  // with a checkpoint each, after a discarded one

std::vector<Signal> signals_of(const std::vector<Column>& columns) {
  std::vector<Signal> signals;
  for (const Column& column : columns) signals.push_back(column.signal);
  return signals;
}

/// What the unit said when it was built, and what stands in outputs called `warning`.
std::vector<std::string> warnings_of(const Member& member) {
  std::vector<std::string> all = member.instance.warnings;
  const Variable* output = member.variables().find("warning");
  if (output == nullptr || output->role != Role::kOutput || output->kind() != Kind::kString) return all;
  for (const std::string& text : output->strings()) {
    if (!text.empty()) all.push_back(text);
  }
  return all;
}

using Values = std::variant<std::vector<double>, std::vector<std::int32_t>, std::vector<bool>, std::vector<std::string>>;

/// All elements, or one.
Values values_of(const FoundElement& found) {
  return std::visit(
      [&](auto all) -> Values {
        const auto part = found.element < 0 ? all : all.subspan(static_cast<std::size_t>(found.element), 1);
        return std::vector<typename decltype(all)::value_type>(part.begin(), part.end());
      },
      found.variable->storage);
}

/// A state of a unit of this program with the start value that the scenario gives it.
struct GivenState {
  const ParameterValue* given;
  const Member* member;
  FoundElement state;
  Values value;
};

std::vector<GivenState> given_states(std::span<const Member> members) {
  std::vector<GivenState> all;
  for (const Member& member : members) {
    if (!is_unit(member.spec)) continue;  // what a start value is to a foreign FMU it says itself
    for (const ParameterValue& given : member.spec.start_values) {
      const FoundElement found = find_element(member.variables(), given.name);
      if (found.variable != nullptr && found.variable->role == Role::kState)
        all.push_back({&given, &member, found, values_of(found)});
    }
  }
  return all;
}

/// A start value that the initialisation replaces would be lost without a word.
void check_kept(std::span<const GivenState> states) {
  for (const GivenState& s : states) {
    if (values_of(s.state) == s.value) continue;
    fail(s.given->place, "'" + s.member->name() + "." + s.given->name +
                             "' is a state that its unit computes when it is initialised: the start value has no effect, "
                             "expected a parameter, a tunable or an input");
  }
}

}  // namespace

/// Phases of a tick: wait for the clock; advance, and again in smaller parts where somebody discards or the tolerance asks;
/// check for NaN; let statistics and recorder see the new instant. Most ticks are plain ones: what else might be due in them is
/// known beforehand, and they are told by one comparison.
class Master::Loop {
 public:
  Loop(Scenario scenario, MasterOptions options);

  void initialise();
  bool step_tick();
  void finish();
  Summary summary() const;
  std::vector<std::string> warnings() const;
  Time now() const { return engine_.schedule.time(tick_); }
  std::int64_t ticks() const { return engine_.schedule.ticks(); }

  void values_changed() { plain_until_ = next_checkpoint_ = 0; }
  void save(std::function<void(RunState)> take);
  const std::string& unsavable() const { return unsavable_; }
  std::optional<std::uint64_t> sync_recording() const {
    return recorder_ ? recorder_->sync_to_mark() : std::optional(std::uint64_t{0});
  }
  std::span<const Column> columns() const { return columns_; }

  const Scenario scenario_;
  std::vector<Member> members_;
  std::int64_t tick_ = 0;

 private:
  std::int64_t plain_until_ = 0;  // a tick that is not a plain one
  void step_plainly();
  void step_in_smaller_parts(std::size_t who);
  void step_to_tolerance();
  void take_checkpoint();
  void hand_over();
  std::uint64_t beginning() const;
  std::string why_unsavable();
  std::string state() const;
  void go_on_from(const RunState& state);
  double wall_seconds() const;
  void count_discard(std::size_t who);
  void observe(Time now);
  void record(Time now);
  void step_timed();
  void step();
  void advance();
  bool step_tick_with_care();
  std::int64_t plain_until() const;
  std::int64_t next_sample() const;
  bool sampled() const { return tick_ == next_sample_ || engine_.schedule.ticks() < kSampleAll; }

  Engine engine_;
  std::vector<std::string> omissions_;
  std::vector<Column> columns_;
  Statistics statistics_;
  bool has_statistics_;
  std::unique_ptr<Clock> clock_;
  std::filesystem::path recording_;  // empty: none is wanted
  std::unique_ptr<Recorder> recorder_;
  std::int64_t next_row_ = kNever;  // the tick at whose beginning it is sampled
  Initialisation initialisation_;

  const Member* not_restorable_ = nullptr;  // the first that cannot go back
  Checkpoint checkpoint_;
  std::int64_t next_checkpoint_ = 0, careful_until_ = 0;
  std::vector<std::int64_t> discarded_by_;  // per slot
  std::int64_t discarded_ = 0;
  std::optional<OutputError> output_error_;  // with a tolerance
  int parts_ = 1;                            // of the next tick, with a tolerance
  int most_parts_ = 1;
  std::int64_t parts_sum_ = 0, tolerance_missed_ = 0;

  // Of the sampled ticks.
  double advance_seconds_ = 0, check_seconds_ = 0, observe_seconds_ = 0;
  std::int64_t sampled_ticks_ = 0, next_sample_ = 1;
  std::chrono::steady_clock::time_point begun_, ended_;
  bool running_ = false, finished_ = false;

  // Of saving the run for another process.
  std::function<void()> before_results_;
  std::optional<RunState> resume_;
  std::function<void(RunState)> saved_to_;  // empty unless a state is asked for
  bool saves_anywhere_ = true;              // saving a unit changes nothing of what it does next
  std::string unsavable_;
  std::uint64_t beginning_ = 0;
  double earlier_seconds_ = 0;  // of processes before this one
};

Master::Loop::Loop(Scenario scenario, MasterOptions options)
    : scenario_(std::move(scenario)),
      members_(load_members(scenario_, options.types, options.folders)),
      engine_(scenario_, members_, options.threads.value_or(scenario_.threads), options.always_threads),
      omissions_(find_omissions(scenario_, members_, engine_.links)),
      columns_(choose_columns(scenario_, members_)),
      statistics_(scenario_, members_, signals_of(columns_)),
      has_statistics_(!statistics_.empty()),
      clock_(options.clock ? std::move(options.clock) : make_clock(scenario_.clock)),
      discarded_by_(members_.size()),
      before_results_(std::move(options.before_results)),
      resume_(std::move(options.resume)) {
  for (const Member& member : members_) {
    if (!not_restorable_ && !member.instance.unit->restorable()) not_restorable_ = &member;
  }
  const std::string place = scenario_.file.filename().string();
  if (scenario_.decimation < 1) fail(place, "decimation " + std::to_string(scenario_.decimation) + ", expected >= 1 ticks");
  if (scenario_.tolerance > 0) {
    if (not_restorable_) {
      fail(not_restorable_->spec.place,
           "component '" + not_restorable_->name() +
               "' cannot be taken back, as steps to a tolerance need; leave the scenario's tolerance out");
    }
    output_error_.emplace(members_, scenario_.tolerance);
  }
  if (!options.results.empty() && !columns_.empty()) recording_ = options.results / "signals.csv";
}

void Master::Loop::initialise() {
  for (const Member& member : members_) {
    try {
      member.variables().check_ranges();
    } catch (const Error& error) {
      fail(member.spec.place, "component '" + member.name() + "': " + error.what());
    }
  }
  const std::vector<GivenState> given = given_states(members_);
  initialisation_ = engine_.initialise(scenario_.start);
  check_kept(given);
  engine_.check_numbers(scenario_.start);
  take_checkpoint();  // makes the room that later ones need
  if (output_error_) output_error_->remember();
  beginning_ = beginning();
  unsavable_ = why_unsavable();
  if (resume_) go_on_from(*resume_);
  if (before_results_) before_results_();
  if (!recording_.empty()) {
    Recorder::Options options{!clock_->real_time(), Recorder::Options{}.ring_bytes, {}};
    if (resume_) options.kept = resume_->recording;
    recorder_ = std::make_unique<Recorder>(columns_, recording_, options);
    if (!resume_) next_row_ = tick_;
  }
  if (!resume_) observe(now());
  resume_.reset();
  begun_ = std::chrono::steady_clock::now();
  running_ = true;
  clock_->start(now());
}

/// A hash of every number of every unit, bit by bit.
std::uint64_t Master::Loop::beginning() const {
  std::uint64_t hash = hash_of("");
  const auto add = [&hash](const auto& values) {
    for (const auto& value : values) {
      std::uint64_t bits = 0;
      std::memcpy(&bits, &value, sizeof value);
      hash = (hash ^ bits) * 0x100000001b3u;
      hash ^= hash >> 29;  // high bits would never reach low ones
    }
  };
  for (const Member& member : members_) {
    add(std::array{member.variables().fingerprint()});
    for (const Variable& v : member.variables()) {
      if (v.kind() == Kind::kReal) add(v.reals());
      if (v.kind() == Kind::kInteger) add(v.integers());
      if (v.kind() == Kind::kBoolean) add(v.booleans());
    }
  }
  return hash;
}

std::string Master::Loop::why_unsavable() {
  if (not_restorable_) return "'" + not_restorable_->name() + "' cannot be saved";
  for (const Member& member : members_) {
    if (is_unit(member.spec)) continue;
    saves_anywhere_ = false;  // a solver of Model Exchange begins afresh where it is saved
    std::string memory;
    member.instance.unit->save_memory(memory);
    if (!fmu::holds_state(memory)) return "the states of the FMU '" + member.name() + "' cannot leave its process";
  }
  return "";
}

void Master::Loop::save(std::function<void(RunState)> take) {
  if (!unsavable_.empty()) throw Error(unsavable_);
  saved_to_ = std::move(take);
  if (!saves_anywhere_ || tick_ >= engine_.schedule.ticks() || engine_.finished_by() != Engine::kNobody) return;
  take_checkpoint();
  hand_over();
}

/// After take_checkpoint() in the same tick.
void Master::Loop::hand_over() {
  if (!saved_to_) return;
  RunState run;
  run.beginning = beginning_;
  run.wall_seconds = wall_seconds();
  run.bytes = state();
  if (recorder_) {
    run.recording = {0, recorder_->rows(), recorder_->dropped()};
    recorder_->mark();
  }
  std::exchange(saved_to_, nullptr)(std::move(run));
}

std::string Master::Loop::state() const {
  ByteWriter out;
  checkpoint_.write(out);
  statistics_.write(out);
  out.value(next_row_);
  out.value(careful_until_);
  out.value(discarded_);
  out.value(static_cast<std::uint64_t>(discarded_by_.size()));
  for (const std::int64_t count : discarded_by_) out.value(count);
  out.value(static_cast<std::int32_t>(parts_));
  out.value(static_cast<std::int32_t>(most_parts_));
  out.value(parts_sum_);
  out.value(tolerance_missed_);
  out.value(static_cast<std::uint8_t>(output_error_.has_value()));
  if (output_error_) output_error_->write(out);
  return out.bytes();
}

void Master::Loop::go_on_from(const RunState& run) {
  const std::string place = "checkpoint";
  if (run.beginning != beginning_)
    throw Error(place, "the run it is of began with other values, expected the same scenario and the same files");
  ByteReader in(as_bytes(run.bytes), place);
  checkpoint_.read(in, members_, engine_.schedule, engine_.events);
  statistics_.read(in);
  next_row_ = in.value<std::int64_t>();
  careful_until_ = in.value<std::int64_t>();
  discarded_ = in.value<std::int64_t>();
  if (in.count(sizeof(std::int64_t)) != discarded_by_.size()) in.fail("has the states of other units");
  for (std::int64_t& count : discarded_by_) count = in.value<std::int64_t>();
  parts_ = in.value<std::int32_t>();
  most_parts_ = in.value<std::int32_t>();
  parts_sum_ = in.value<std::int64_t>();
  tolerance_missed_ = in.value<std::int64_t>();
  if ((in.value<std::uint8_t>() != 0) != output_error_.has_value()) in.fail("is of another tolerance");
  if (output_error_) output_error_->read(in);
  in.expect_end();
  tick_ = checkpoint_.tick();
  const bool plausible = next_row_ > tick_ && parts_ >= 1 && parts_ <= kMostParts && most_parts_ >= 1;
  if (!plausible || run.recording.has_value() != !recording_.empty()) in.fail("is damaged");
  checkpoint_.restore(members_, engine_.schedule, engine_.events);
  engine_.check_numbers(now());
  earlier_seconds_ = run.wall_seconds;
  next_checkpoint_ = tick_ < careful_until_ ? tick_ + 1 : tick_ + kCheckpointEvery;
  next_sample_ = tick_ + 1;
}

double Master::Loop::wall_seconds() const {
  if (!running_) return earlier_seconds_;
  const auto end = finished_ ? ended_ : std::chrono::steady_clock::now();
  return earlier_seconds_ + std::chrono::duration<double>(end - begun_).count();
}

inline bool Master::Loop::step_tick() {
  if (tick_ >= plain_until_) return step_tick_with_care();
  const Time end = engine_.schedule.time_before_the_last(tick_ + 1);
  const std::size_t who = engine_.advance_plainly(end);
  if (who != Engine::kNobody) [[unlikely]]
    step_in_smaller_parts(who);
  if (engine_.finished_by() != Engine::kNobody) [[unlikely]]
    plain_until_ = 0;
  ++tick_;
  engine_.check_numbers(end);
  observe(end);
  return true;
}

bool Master::Loop::step_tick_with_care() {
  if (tick_ >= engine_.schedule.ticks() || engine_.finished_by() != Engine::kNobody) return false;
  if (!clock_->wait(now())) return true;
  if (sampled()) {
    step_timed();
  } else {
    step();
  }
  plain_until_ = plain_until();
  return true;
}

/// The first tick from the present one on that needs care.
std::int64_t Master::Loop::plain_until() const {
  if (!clock_->never_waits() || output_error_ || engine_.finished_by() != Engine::kNobody) return 0;
  if (engine_.schedule.ticks() < kSampleAll) return 0;
  std::int64_t until = std::min(engine_.plain_until(tick_), next_sample_);
  if (!not_restorable_) until = std::min(until, next_checkpoint_);
  return until;
}

void Master::Loop::step_timed() {
  auto last = std::chrono::steady_clock::now();
  const auto lap = [&last] {
    const auto before = std::exchange(last, std::chrono::steady_clock::now());
    return std::chrono::duration<double>(last - before).count();
  };
  advance();
  advance_seconds_ += lap();
  engine_.check_numbers(now());
  check_seconds_ += lap();
  observe(now());
  observe_seconds_ += lap();
  ++sampled_ticks_;
  next_sample_ = next_sample();
}

/// The tick that was sampled is the one before the present one.
std::int64_t Master::Loop::next_sample() const {
  const double seconds = advance_seconds_ + check_seconds_ + observe_seconds_;
  const double measuring = engine_.measuring_seconds() + kLaps * static_cast<double>(sampled_ticks_) * engine_.clock_seconds();
  for (const std::int64_t every : kSampleEvery) {
    if (measuring <= kMeasuring * static_cast<double>(every) * (seconds - measuring)) return tick_ - 1 + every;
  }
  return tick_ - 1 + kSampleEvery.back();
}

void Master::Loop::step() {
  advance();
  engine_.check_numbers(now());
  observe(now());
}

void Master::Loop::advance() {
  if (output_error_) {
    step_to_tolerance();
  } else {
    step_plainly();
  }
  ++tick_;
}

void Master::Loop::step_plainly() {
  if (tick_ >= next_checkpoint_ && !not_restorable_) {
    take_checkpoint();
    hand_over();
  }
  const std::size_t who = engine_.advance(tick_, 1, sampled());
  if (who != Engine::kNobody) step_in_smaller_parts(who);
}

void Master::Loop::take_checkpoint() {
  checkpoint_.take(tick_, members_, engine_.schedule, engine_.events);
  next_checkpoint_ = tick_ < careful_until_ ? tick_ + 1 : tick_ + kCheckpointEvery;
}

/// The ticks since the last checkpoint are stepped once more, to the same bits: cheaper than a checkpoint in every tick of
/// every run.
void Master::Loop::step_in_smaller_parts(std::size_t who) {
  plain_until_ = 0;
  const auto blame = [&] {
    return "'" + engine_.name(who) + "' discarded its step at t = " + text::to_text(now().seconds()) + " s";
  };
  count_discard(who);
  if (not_restorable_) {
    const char* hint =
        is_unit(not_restorable_->spec)
            ? ""
            : "; if the FMU can get and set its state, but not serialise it, rollback=true in its source lets it";
    throw Error(blame() + ", which cannot be repeated: '" + not_restorable_->name() + "' cannot be taken back" + hint);
  }
  if (checkpoint_.tick() < tick_) {
    checkpoint_.restore(members_, engine_.schedule, engine_.events);
    for (std::int64_t tick = checkpoint_.tick(); tick < tick_; ++tick) {
      const std::size_t again = engine_.advance(tick, 1, false);
      if (again == Engine::kNobody) continue;
      throw Error("'" + engine_.name(again) + "' discards at t = " + text::to_text(engine_.schedule.time(tick).seconds()) +
                  " s a step that it has made before: its variables do not hold all that it remembers");
    }
    take_checkpoint();
  }
  careful_until_ = tick_ + kCarefulTicks;
  next_checkpoint_ = tick_ + 1;
  for (int parts = 2; parts <= kMostParts; parts *= 2) {
    checkpoint_.restore(members_, engine_.schedule, engine_.events);
    who = engine_.advance(tick_, parts, false);
    if (who != Engine::kNobody) continue;
    most_parts_ = std::max(most_parts_, parts);
    return;
  }
  throw Error(blame() + " even at 1/" + std::to_string(kMostParts) + " of the tick");
}

/// Step doubling: the tick in p parts is held against the tick in 2p, which is kept if they agree within the tolerance, and
/// else is the next p. A tick that agrees to an eighth gives the next one half the parts (the error of a part goes with its
/// square, two parts make the difference: a quarter, with a margin).
void Master::Loop::step_to_tolerance() {
  take_checkpoint();
  hand_over();
  std::size_t who = Engine::kNobody;
  const auto make = [&](int parts, bool timed) {
    who = engine_.advance(tick_, parts, timed);
    if (who != Engine::kNobody) count_discard(who);
    return who == Engine::kNobody;
  };
  bool has_coarse = make(parts_, sampled());
  if (has_coarse) output_error_->remember();
  for (;;) {
    checkpoint_.restore(members_, engine_.schedule, engine_.events);
    const int finer = 2 * parts_;
    const bool made = make(finer, false);
    if (!made && finer >= kMostParts) {
      throw Error("'" + engine_.name(who) + "' discarded its step at t = " + text::to_text(now().seconds()) + " s even at 1/" +
                  std::to_string(finer) + " of the tick");
    }
    const double error = made && has_coarse ? output_error_->against_remembered() : std::numeric_limits<double>::infinity();
    if (made && (error <= 1 || finer >= kMostParts)) {
      if (!(error <= 1)) ++tolerance_missed_;
      parts_sum_ += finer;
      most_parts_ = std::max(most_parts_, finer);
      if (error <= 0.125) parts_ = std::max(1, parts_ / 2);
      return;
    }
    if (made) output_error_->remember();
    has_coarse = made;
    parts_ = finer;
  }
}

void Master::Loop::count_discard(std::size_t who) {
  ++discarded_;
  ++discarded_by_[engine_.schedule.slots[who].member];
}

inline void Master::Loop::observe(Time now) {
  if (has_statistics_) statistics_.sample(now);
  if (tick_ >= next_row_) record(now);
}

void Master::Loop::record(Time now) {
  recorder_->sample(now);
  const std::int64_t last = engine_.schedule.ticks(), next = tick_ + scenario_.decimation;
  next_row_ = tick_ == last ? kNever : std::min(last, next);
}

void Master::Loop::finish() {
  if (finished_) return;
  finished_ = true;
  ended_ = std::chrono::steady_clock::now();
  if (!recorder_) return;
  recorder_->close();
  ended_ = std::chrono::steady_clock::now();
}

/// Each once, as a unit may say the same when it is built and after its initialisation.
std::vector<std::string> Master::Loop::warnings() const {
  std::vector<std::string> all;
  std::set<std::string> told;
  const auto tell = [&](const std::string& warning) {
    if (told.insert(warning).second) all.push_back(warning);
  };
  for (const std::string& warning : scenario_.warnings) tell(warning);
  for (const std::string& warning : omissions_) tell(warning);
  if (engine_.finished_by() != Engine::kNobody) {
    tell("'" + engine_.name(engine_.finished_by()) + "' asked for the end of the run at t = " + text::to_text(now().seconds()) +
         " s");
  }
  for (const Member& member : members_) {
    for (const std::string& warning : warnings_of(member)) tell(member.name() + ": " + warning);
  }
  return all;
}

Summary Master::Loop::summary() const {
  Summary s;
  s.scenario = scenario_.name;
  s.start = scenario_.start.seconds();
  s.reached = now().seconds();
  s.stop = engine_.schedule.stop().seconds();
  s.tick = scenario_.tick.seconds();
  s.ticks = tick_;
  s.wall_seconds = wall_seconds();
  s.real_time_factor = s.wall_seconds > 0 ? (s.reached - s.start) / s.wall_seconds : 0;
  s.threads = engine_.threads_used();
  s.initialisation = initialisation_;
  // Ticks that were timed stand for all: what is not the units' is the loop's own.
  const double scale = static_cast<double>(tick_) / static_cast<double>(std::max<std::int64_t>(1, sampled_ticks_));
  const double exchange = scale * std::max(0.0, advance_seconds_ - engine_.sampled_seconds() - engine_.measuring_seconds());
  const double check = scale * check_seconds_, observe = scale * observe_seconds_;
  double all = exchange + check + observe;
  for (std::size_t m = 0; m < members_.size(); ++m) all += engine_.cost(m, tick_).seconds();
  s.exchange_share = all > 0 ? exchange / all : 0;
  s.check_share = all > 0 ? check / all : 0;
  s.observe_share = all > 0 ? observe / all : 0;
  s.warnings = warnings();
  for (std::size_t m = 0; m < members_.size(); ++m) {
    const Engine::Cost cost = engine_.cost(m, tick_);
    s.units.push_back({members_[m].name(), cost.seconds_per_step, all > 0 ? cost.seconds() / all : 0, cost.samples});
    std::vector<std::string> notes;
    members_[m].instance.unit->tell(notes);
    for (const std::string& note : notes) s.notes.push_back(members_[m].name() + ": " + note);
    if (discarded_by_[m] > 0) s.discarded_by.emplace_back(members_[m].name(), discarded_by_[m]);
  }
  s.discarded = discarded_;
  s.most_parts = most_parts_;
  s.mean_parts = output_error_ && tick_ > 0 ? static_cast<double>(parts_sum_) / static_cast<double>(tick_) : 1;
  s.tallies = statistics_.tallies();
  s.works = statistics_.works();
  s.comparisons = statistics_.comparisons();
  s.bonds = statistics_.bonds();
  for (const Bonded& bond : s.bonds) {
    if (bond.tolerance > 0 && std::abs(bond.leak) > bond.tolerance) {
      s.warnings.push_back("power bond '" + bond.name + "' leaks " + text::to_text(bond.leak, 4) + " J, more than " +
                           text::to_text(bond.tolerance, 4) + " J: couple its two sides in smaller ticks or in two stages");
    }
  }
  if (tolerance_missed_ > 0) {
    s.warnings.push_back("the tolerance was missed in " + std::to_string(tolerance_missed_) + " ticks even at 1/" +
                         std::to_string(kMostParts) + " of the tick");
  }
  if (recorder_) {
    s.recording = recorder_->file();
    s.rows = recorder_->rows();
    s.dropped_rows = recorder_->dropped();
    if (s.dropped_rows > 0) {
      s.warnings.push_back("the disk could not keep up: " + std::to_string(s.dropped_rows) +
                           " rows of the recording were dropped");
    }
  }
  s.overruns = clock_->overruns();
  s.worst_delay = clock_->worst_delay().seconds();
  return s;
}

Master::Master(Scenario scenario, MasterOptions options)
    : loop_(std::make_unique<Loop>(std::move(scenario), std::move(options))) {}
Master::Master(Master&&) noexcept = default;
Master::~Master() = default;

void Master::initialise() { loop_->initialise(); }
void Master::values_changed() { loop_->values_changed(); }
bool Master::step_tick() { return loop_->step_tick(); }
void Master::finish() { loop_->finish(); }
Time Master::now() const { return loop_->now(); }
std::int64_t Master::tick() const { return loop_->tick_; }
std::int64_t Master::ticks() const { return loop_->ticks(); }
const Scenario& Master::scenario() const { return loop_->scenario_; }
std::span<Member> Master::members() { return loop_->members_; }
std::vector<std::string> Master::warnings() const { return loop_->warnings(); }
const std::string& Master::unsavable() const { return loop_->unsavable(); }
void Master::save(std::function<void(RunState)> take) { loop_->save(std::move(take)); }
std::optional<std::uint64_t> Master::sync_recording() const { return loop_->sync_recording(); }
std::span<const Column> Master::columns() const { return loop_->columns(); }
Summary Master::summary() const { return loop_->summary(); }

}  // namespace cotwin::master
