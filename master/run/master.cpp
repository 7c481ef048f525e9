#include "master/run/master.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <thread>
#include <utility>
#include <variant>

#include "fmu/import/unit/state_keeper.h"
#include "master/engine/threaded_unit.h"
#include "master/run/columns.h"
#include "master/run/loop.h"
#include "master/run/omissions.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/fields.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

using Values = std::variant<std::vector<double>, std::vector<std::int32_t>, std::vector<bool>, std::vector<std::string>>;

/// The values of a variable, or of one element.
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
    if (!is_unit(member.spec)) continue;  // a foreign FMU decides itself what a start value of a state means
    for (const ParameterValue& given : member.spec.start_values) {
      const FoundElement found = find_element(member.variables(), given.name);
      if (found.variable != nullptr && found.variable->role == Role::kState)
        all.push_back({&given, &member, found, values_of(found)});
    }
  }
  return all;
}

/// Throws Error for a start value that the initialisation has replaced, so that it is not ignored silently.
void check_kept(std::span<const GivenState> states) {
  for (const GivenState& s : states) {
    if (values_of(s.state) == s.value) continue;
    fail(s.given->place, "'" + s.member->name() + "." + s.given->name +
                             "' is a state that its unit computes when it is initialised: the start value has no effect, "
                             "expected a parameter, a tunable or an input");
  }
}

}  // namespace

namespace {

std::vector<Member> load(const Scenario& scenario, const MasterOptions& options) {
  std::vector<Member> members = load_members(scenario, options.types, options.folders, options.models);
  const bool free = options.clock ? options.clock->never_waits() : scenario.clock.kind == ClockKind::kFree;
  put_on_threads(scenario, members, free ? ThreadMode::kWait : ThreadMode::kHold);
  return members;
}

/// With absolute paths: an FMU may call chdir().
Scenario located(Scenario scenario) {
  scenario.folder = std::filesystem::current_path() / scenario.folder;
  return scenario;
}

}  // namespace

Master::Loop::Loop(Scenario scenario, MasterOptions options)
    : scenario_(located(std::move(scenario))),
      members_(load(scenario_, options)),
      engine_(scenario_, members_, options.threads.value_or(scenario_.threads), options.always_threads),
      control_(
          engine_, members_, scenario_.tolerance, [this](std::int64_t tick) { return engine_.schedule.tick(tick); }, false),
      omissions_(find_omissions(scenario_, members_, engine_.links)),
      separation_(trace_separation(scenario_, members_, engine_.links)),
      pace_(scenario_, members_, std::move(options.clock), options.host),
      columns_(choose_columns(scenario_, members_, &pace_.variables())),
      statistics_(scenario_, members_, columns_),
      past_statistics_(statistics_),
      has_statistics_(!statistics_.empty()),
      waits_(pace_.waits()),
      before_results_(std::move(options.before_results)),
      resume_(std::move(options.resume)),
      waiting_(std::move(options.waiting)),
      observer_(options.observer),
      page_(std::move(options.page)) {
  const std::string place = scenario_.file.filename().string();
  if (scenario_.decimation < 1) fail(place, "decimation " + std::to_string(scenario_.decimation) + ", expected >= 1 ticks");
  if (!options.results.empty()) results_ = std::filesystem::current_path() / options.results;
  if (!options.results.empty() && !columns_.empty())
    recording_ = std::filesystem::current_path() / options.results / "signals.csv";
  joint_names_ = options.joint_names;
  signals_.every = scenario_.decimation;
  if (!options.results.empty() && options.view_data) {
    view_columns_ = choose_view_columns(members_);
    view_.every = std::max<std::int64_t>(1, 1'000'000'000 / kViewRate / scenario_.tick.ns);
    if (!has_all(columns_, scenario_.decimation * scenario_.tick, view_columns_))
      view_file_ = std::filesystem::current_path() / options.results / "view.bin";
  }
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
  engine_.check_finite(scenario_.start);
  control_.initialise();
  beginning_ = hash_of_values();
  unsavable_ = why_unsavable();
  begin_observation();
  if (resume_) restore(*resume_);
  times_.begin_run(ticks(), tick_);
  if (before_results_) before_results_();
  open_recordings();
  if (!resume_) observe(now());
  resume_.reset();
  keep_past();
  begun_ = std::chrono::steady_clock::now();
  running_ = true;
  if (live_) {
    for (bus::RunObserver* observer : observers()) observer->observe(live_->run());
  }
}

void Master::Loop::open_recordings() {
  Recorder::Options options;
  options.may_wait = !pace_.real_time();
  options.joint_names = joint_names_;
  if (may_go_back()) {
    options.holds = true;
    options.least_rows = static_cast<std::size_t>(kCheckpointEvery + kMostWaiting) + 2;
  }
  if (!recording_.empty()) {
    if (resume_) options.kept = resume_->recording;
    signals_.recorder = std::make_unique<Recorder>(columns_, recording_, options);
    if (!resume_) signals_.next = tick_;
  }
  if (!view_file_.empty()) {
    options.heading = view_heading(view_columns_);
    options.ring_bytes = std::size_t{1} << 20;
    if (options.holds) options.least_rows = static_cast<std::size_t>((kCheckpointEvery + kMostWaiting) / view_.every) + 2;
    if (resume_) options.kept = resume_->view.value_or(Recorder::Kept{});
    view_.recorder = std::make_unique<Recorder>(view_columns_, view_file_, options);
    if (!resume_) view_.next = tick_;
  }
  next_row_ = std::min(signals_.next, view_.next);
}

/// The units that observe the run, and the observer of the options.
std::vector<bus::RunObserver*> Master::Loop::observers() const {
  std::vector<bus::RunObserver*> all = LiveLoop::observers(members_);
  if (observer_ != nullptr) all.push_back(observer_);
  return all;
}

void Master::Loop::begin_observation() {
  if (observers().empty()) return;
  std::string unpausable;
  if (scenario_.clock.follows()) {
    unpausable = "its ticks follow the clock of a robot or bus, which goes on";
  } else {
    const auto connected =
        std::ranges::find_if(members_, [](const Member& m) { return m.instance.unit->tick_source() != nullptr; });
    if (connected != members_.end()) unpausable = "'" + connected->name() + "' is connected to a robot or bus, which goes on";
  }
  live_ = std::make_unique<LiveLoop>(scenario_, members_, engine_, std::move(unpausable), page_, results_);
}

/// Requests to an observed run. Returns false if the tick must not begin.
bool Master::Loop::begin_live_tick() {
  const bool goes_on = live_->begin_tick(tick_, now());
  if (live_->pop_changed()) {
    control_.forget();
    control_.jump();
  }
  return goes_on;
}

/// Hash of the bits of all numbers of all units.
std::uint64_t Master::Loop::hash_of_values() const {
  std::uint64_t hash = hash_of("");
  const auto add = [&hash](const auto& values) {
    for (const auto& value : values) {
      std::uint64_t bits = 0;
      std::memcpy(&bits, &value, sizeof value);
      hash = (hash ^ bits) * 0x100000001b3u;
      hash ^= hash >> 29;  // otherwise high bits would not affect low ones
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
  if (const Member* member = control_.not_restorable()) return "'" + member->name() + "' cannot be saved";
  for (const Member& member : members_) {
    if (is_unit(member.spec)) continue;
    saves_anywhere_ = false;  // a Model Exchange solver restarts where it is saved
    std::string memory;
    ThreadedUnit* const beside = beside_of(member);
    (beside != nullptr ? beside->inner() : *member.instance.unit).save_memory(memory);
    if (!fmu::holds_state(memory)) return "the states of the FMU '" + member.name() + "' cannot leave its process";
  }
  return "";
}

void Master::Loop::save(std::function<void(RunState)> take, bool last) {
  if (!unsavable_.empty()) throw Error(unsavable_);
  state_taker_ = std::move(take);
  if (!saves_anywhere_ || (may_go_back() && !last) || at_end()) return;
  if (last) control_.forget();  // so that it does not wait
  save_checkpoint();
}

void Master::Loop::save_checkpoint() {
  if (!control_.save_checkpoint(tick_)) return;
  keep_past();
  if (state_taker_) pass_state();
}

/// What belongs to the checkpoint beside the units.
void Master::Loop::keep_past() {
  if (!may_go_back()) return;
  past_tick_ = tick_;
  past_statistics_ = statistics_;
  signals_.keep();
  view_.keep();
}

/// Goes back to the last checkpoint, because a loop is stepped in another way from there on.
void Master::Loop::rewind() {
  tick_ = *control_.rewound();
  statistics_ = past_statistics_;
  signals_.rewind();
  view_.rewind();
  next_row_ = std::min(signals_.next, view_.next);
}

void Master::Loop::pass_state() {
  RunState run;
  run.beginning = beginning_;
  run.wall_seconds = wall_seconds();
  run.bytes = state();
  if (Recorder* const recorder = signals_.recorder.get()) {
    run.recording = {0, recorder->rows(), recorder->dropped()};
    recorder->mark();
  }
  if (Recorder* const recorder = view_.recorder.get()) {
    run.view = {0, recorder->rows(), 0};
    recorder->mark();
  }
  std::exchange(state_taker_, nullptr)(std::move(run));
}

std::string Master::Loop::state() const {
  ByteWriter out;
  control_.write(out);
  statistics_.write(out);
  Putter(out).put(signals_.next, view_.next);
  if (live_) live_->write(out);
  return out.bytes();
}

void Master::Loop::restore(const RunState& run) {
  const std::string place = "checkpoint";
  if (run.beginning != beginning_)
    throw Error(place, "its run had other initial values, expected the same scenario and the same files");
  ByteReader in(as_bytes(run.bytes), place);
  tick_ = control_.restore(in);
  statistics_.read(in, engine_.schedule.time(0), now());
  Getter(in).get(signals_.next, view_.next);
  if (live_) live_->read(in, tick_);
  in.expect_end();
  const auto fits = [&](const Rows& rows, const std::filesystem::path& file) {
    return rows.next > tick_ && (rows.next == kNever || !file.empty());
  };
  if (!fits(signals_, recording_) || !fits(view_, view_file_) || (run.view && run.view->rows < 0) ||
      run.recording.has_value() != !recording_.empty())
    in.fail("is damaged");
  engine_.check_finite(now());
  earlier_seconds_ = run.wall_seconds;
}

double Master::Loop::wall_seconds() const {
  if (!running_) return earlier_seconds_;
  const auto end = finished_ ? ended_ : std::chrono::steady_clock::now();
  return earlier_seconds_ + std::chrono::duration<double>(end - begun_).count();
}

/// The loop body of "One master step" in docs/architecture.md.
[[gnu::always_inline]] inline bool Master::Loop::step_tick() {
  if (at_end()) return false;
  if (live_) [[unlikely]] {
    if (!begin_live_tick()) {
      if (live_->paused()) live_->wait(tick_);
      return !live_->stopped();
    }
    if (live_->pop_resumed()) pace_.restart(engine_, tick_);
  }
  if (waits_) {
    if (!pace_.wait(engine_, tick_)) return true;
    if (live_ && !begin_live_tick()) return !live_->stopped();  // asked for while it waited
  }
  const bool timed = tick_ >= times_.next();
  if (timed) times_.begin_tick();

  if (tick_ >= control_.next_checkpoint()) save_checkpoint();
  const Tick tick = pace_.next(engine_, tick_);
  const std::size_t discarded_by = control_.step(tick, timed);
  if (discarded_by != Engine::kNoSlot) fail_discarded(discarded_by);
  if (control_.checkpoint() == tick_ && past_tick_ != tick_) [[unlikely]]
    keep_past();  // a discarded step has taken one
  tick_ = tick.index + 1;
  if (tick.skipped > 0) control_.forget();
  if (timed) times_.end_stepping();

  engine_.check_finite(tick.end);
  if (timed) times_.end_checking();

  observe(tick.end);
  if (live_) [[unlikely]]
    live_->end_tick(tick_);
  if (timed) times_.end_tick(tick.index, engine_);
  if (waits_) pace_.end_tick();
  if (control_.rewound()) [[unlikely]]
    rewind();
  return true;
}

void Master::Loop::fail_discarded(std::size_t slot) const {
  const std::string fact = "'" + engine_.name(slot) + "' discarded its step at t = " + text::to_text(now().seconds()) + " s";
  const Member* const member = control_.not_restorable();
  if (scenario_.tolerance > 0 && !engine_.schedule.slots[slot].once)
    throw Error(fact + " even in the shortest step that the tolerance permits");
  if (member == nullptr) throw Error(fact + " even at 1/" + std::to_string(kMostParts) + " of the tick");
  const char* hint = is_unit(member->spec)
                         ? ""
                         : "; if the FMU can get and set its state, but not serialise it, rollback=true in its source lets it";
  throw Error(fact + ", which cannot be repeated: '" + member->name() + "' cannot be restored" + hint);
}

inline void Master::Loop::observe(Time now) {
  if (has_statistics_) statistics_.sample(now);
  if (tick_ >= next_row_) record(now);
}

void Master::Loop::record(Time now) {
  for (Rows* rows : {&signals_, &view_}) {
    if (tick_ >= rows->next) rows->sample(tick_, engine_.schedule.ticks(), now);
  }
  next_row_ = std::min(signals_.next, view_.next);
}

void Master::Loop::Rows::sample(std::int64_t tick, std::int64_t last, Time now) {
  recorder->sample(now);
  const std::int64_t after = tick < next + every ? next + every : tick + every - (tick - next) % every;
  next = tick == last ? kNever : std::min(last, after);
}

void Master::Loop::Rows::keep() {
  past = next;
  if (recorder) recorder->commit();
}

void Master::Loop::Rows::rewind() {
  next = past;
  if (recorder) recorder->rewind();
}

void Master::Loop::finish() {
  if (finished_) return;
  finished_ = true;
  pace_.finish(engine_);
  if (live_) live_->end(tick_);
  std::string failure;
  const auto attempt = [&](const auto& call) {
    try {
      call();
    } catch (const std::exception& error) {
      failure += (failure.empty() ? "" : "; ") + std::string(error.what());
    }
  };
  // Steps beside the loop may last long: robots and files do not wait for them.
  for (const Member& member : members_) {
    if (beside_of(member) == nullptr) member.instance.unit->end();
  }
  for (const Rows* rows : {&signals_, &view_}) {
    if (rows->recorder) attempt([&] { rows->recorder->close(); });
  }
  end_beside();
  for (const Member& member : members_) {
    if (ThreadedUnit* const beside = beside_of(member)) attempt([&] { beside->check_last_step(); });
  }
  ended_ = std::chrono::steady_clock::now();
  if (!failure.empty()) throw Error(failure);
}

/// Ends the units beside the loop, each as soon as its last step has ended.
void Master::Loop::end_beside() const {
  std::vector<const Member*> left;
  for (const Member& member : members_) {
    if (beside_of(member) != nullptr) left.push_back(&member);
  }
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(1);
  for (bool reported = !waiting_;;) {
    std::erase_if(left, [](const Member* member) {
      ThreadedUnit* const beside = beside_of(*member);
      const bool ready = !beside->stepping();
      if (ready) beside->end();
      return ready;
    });
    if (left.empty()) return;
    if (!reported && std::chrono::steady_clock::now() >= limit) {
      reported = true;
      std::vector<std::string> names;
      for (const Member* member : left) names.push_back(member->name());
      waiting_(names);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

Master::Master(Scenario scenario, MasterOptions options)
    : loop_(std::make_unique<Loop>(std::move(scenario), std::move(options))) {}
Master::Master(Master&&) noexcept = default;
Master::~Master() = default;

void Master::initialise() { loop_->initialise(); }
void Master::values_changed() { loop_->values_changed(); }
void Master::prepare_threads() { loop_->prepare_threads(); }
bool Master::step_tick() { return loop_->step_tick(); }
void Master::finish() { loop_->finish(); }
Time Master::now() const { return loop_->now(); }
std::int64_t Master::tick() const { return loop_->tick_; }
std::int64_t Master::ticks() const { return loop_->ticks(); }
const Scenario& Master::scenario() const { return loop_->scenario_; }
std::span<Member> Master::members() { return loop_->members_; }
std::vector<std::string> Master::warnings() const { return loop_->warnings(); }
const std::string& Master::unsavable() const { return loop_->unsavable(); }
void Master::save(std::function<void(RunState)> take, bool last) { loop_->save(std::move(take), last); }
bool Master::sync_recording(RunState& state) const { return loop_->sync_recording(state); }
std::span<const Column> Master::columns() const { return loop_->columns(); }
std::vector<robot::RobotHistory> Master::histories() const { return loop_->histories(); }
Summary Master::summary() const { return loop_->summary(); }

}  // namespace cotwin::master
