#include "master/clock/clock.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

constexpr double kAveraged = 64;       // measurements in a mean
constexpr double kReordered = 16;      // cycles by which a packet may be older than the one before
constexpr double kSmoothing = 1. / 8;  // of an arrival, of the instants from which lost packets are counted

std::string milliseconds(double ns) { return text::to_text(1e-6 * ns, 4) + " ms"; }

}  // namespace

void ClockState::declare(Variables& v) {
  v.output("offset", offset, "s", "by how much ticks are later than the cycles of the source, at its last packet");
  v.output("jitter", jitter, "s", "rms of the offset about its mean, over about the last 64 packets");
  v.output("worst", worst, "s", "largest magnitude of the offset while locked");
  v.output("drift", drift, "1", "host time / source time - 1");
  v.output("lateness", lateness, "s", "from the instant at which the tick was due to its start");
  v.output("locked", locked, "whether the ticks follow the source");
  v.output("silent", silent, "whether there was no packet for the time-out");
  v.output("overruns", overruns, "ticks that began too late");
  v.output("skipped", skipped, "ticks that were left out");
  v.output("missed", missed, "cycles without a packet in time");
  v.output("steps", steps, "steps of the source's clock");
}

void Clock::begin_tick(std::int64_t due) {
  began_ = host_.now();
  lateness_ = {std::max<std::int64_t>(0, began_ - due)};
  state_.lateness = lateness_.seconds();
  start_delays_.add(lateness_.ns);
  if (overrun()) ++state_.overruns;
}

void Clock::note_offset(double ns) {
  state_.offset = 1e-9 * ns;
  if (!state_.locked) return;
  state_.worst = std::max(state_.worst, std::abs(state_.offset));
  squares_ += state_.offset * state_.offset;
  ++measured_;
}

double Clock::rms_offset() const { return measured_ > 0 ? std::sqrt(squares_ / static_cast<double>(measured_)) : 0; }

void RealTimeClock::start(Time now) { zero_ = host_.now() - now.ns; }

bool RealTimeClock::wait(Time now) {
  const std::int64_t due = zero_ + now.ns;
  if (const std::int64_t present = host_.now(); present < due) {
    host_.sleep_until(std::min(due, present + kSlice));
    if (host_.now() < due) return false;
  }
  begin_tick(due);
  return true;
}

SourceClock::SourceClock(const ClockSpec& spec, Duration tick, TickSource& source, std::string name, HostTime& host)
    : Clock(host), spec_(spec), tick_(tick.ns), cycle_(tick.ns), source_(source), name_(std::move(name)) {
  set_late(spec.late);
}

std::int64_t SourceClock::choose_cycle() {
  const std::int64_t own = source_.period();
  const std::int64_t cycle = spec_.cycle.ns > 0 ? spec_.cycle.ns : own > 0 ? own : tick_;
  if (cycle % tick_ != 0 && tick_ % cycle != 0)
    fail(spec_.place, "the clock of '" + name_ + "' has cycles of " + milliseconds(static_cast<double>(cycle)) +
                          " and a tick lasts " + milliseconds(static_cast<double>(tick_)) +
                          ", expected one of them to be a multiple of the other");
  if (spec_.timeout.ns / 2 < cycle)
    fail(spec_.place, "the clock's timeout is " + milliseconds(static_cast<double>(spec_.timeout.ns)) +
                          ", expected at least two cycles of '" + name_ + "' of " + milliseconds(static_cast<double>(cycle)));
  return cycle;
}

std::optional<Arrival> SourceClock::receive(std::int64_t deadline) {
  const std::optional<Arrival> arrival = source_.wait(std::min(deadline, host_.now() + kSlice));
  if (arrival) heard_ = std::max(heard_, arrival->host);
  return arrival;
}

void SourceClock::check_silence() {
  const std::int64_t silence = host_.now() - heard_;
  state_.silent = silence > spec_.timeout.ns;
  if (!state_.silent) return;
  state_.locked = false;
  if (spec_.silence == SilencePolicy::kStop)
    fail(spec_.place, "no packet from '" + name_ + "' for " + milliseconds(static_cast<double>(silence)) +
                          ", more than the clock's timeout of " + milliseconds(static_cast<double>(spec_.timeout.ns)) +
                          " (silence=stop)");
}

void ArrivalClock::start(Time now) {
  cycle_ = choose_cycle();
  source_.set_waits(spec_.silence == SilencePolicy::kWait);
  start_ = heard_ = host_.now();
  reached_ = now;
  any_ = false;
  followed_ = 0;
  owed_ = 0;
}

/// Whether the tick begins a cycle that has not come yet.
bool ArrivalClock::needs_packet(Time now) const { return !any_ || (now > reached_ && (now - reached_).ns % cycle_ == 0); }

bool ArrivalClock::wait(Time now) {
  const bool waits = spec_.silence == SilencePolicy::kWait;
  for (;;) {
    const bool needed = needs_packet(now);
    const bool strict = needed && waits;  // no tick without its packet
    std::int64_t deadline = host_.now() + kSlice;
    if (!strict) deadline = any_ ? due(now) : heard_ + spec_.timeout.ns + 1;
    if (!strict && needed && any_ && !state_.silent) deadline += cycle_ / 2;
    const std::optional<Arrival> arrival = receive(deadline);
    if (arrival) accept(*arrival, now);
    check_silence();
    if (state_.silent) followed_ = 0;
    const std::int64_t present = host_.now();
    if (!arrival) {
      if (strict || present < deadline) return false;
      if (any_) {
        if (needed && !state_.silent) ++state_.missed;
        begin_tick(deadline);
        return true;
      }
      if (state_.silent) {  // the run begins on the wall clock
        any_ = true;
        anchor_ = present;
        grid_ = static_cast<double>(present);
      }
    }
    if (!needs_packet(now) && present >= due(now)) break;
  }
  begin_tick(due(now));
  return true;
}

/// The number of cycles from the anchor to the packet; 0 for one that comes twice, or whose cycle has been counted.
std::int64_t ArrivalClock::cycles_since(const Arrival& arrival, double& offset) {
  constexpr double kMost = 1e9;
  const auto cycle = static_cast<double>(cycle_);
  const double passed = (static_cast<double>(arrival.host) - grid_) / cycle;
  double cycles = std::round(passed);
  if (arrival.source != 0 && source_time_ != 0) {
    const double counted = std::round((static_cast<double>(arrival.source) - static_cast<double>(source_time_)) / cycle);
    if (counted <= 0 && counted > -kReordered) return 0;
    // After a pause a source goes on in its cycles; one whose packets were only held up sends those that are overdue faster.
    constexpr int kCaughtUp = 16;
    if (++punctual_ > kCaughtUp) owed_ = 0;
    if (counted > 0 && counted <= owed_ && passed < 0.5) {
      owed_ -= counted;
      punctual_ = 0;
      source_time_ = arrival.source;
      return 0;
    }
    // The next packet is one cycle later, however slow or fast the source is. With `wait`, scenario time follows the source through
    // losses, too; more cycles than can be lost in a row are those of a source that has begun anew, with this packet.
    constexpr double kMostLost = 256;
    const bool waits = spec_.silence == SilencePolicy::kWait, follows = counted > 0 && counted <= kMostLost;
    if (counted == 1 || (waits && follows) || (counted < passed + 1.5 && counted > passed - 1.5)) cycles = counted;
    if (waits && !follows) cycles = 1;
    // The source stood still, and perhaps its clock with it, while ticks went on.
    constexpr double kPause = 8;
    const double since = (static_cast<double>(arrival.host) - static_cast<double>(anchor_)) / cycle;
    if (!waits && counted == 1 && since > kPause) cycles = std::round(since);
    if (!waits && counted > 0 && cycles - counted > 1) {
      owed_ += cycles - counted;
      punctual_ = 0;
      grid_ = static_cast<double>(arrival.host) - cycle * cycles;  // the source may be at another phase
      offset = 0;
      return static_cast<std::int64_t>(std::min(cycles, kMost));
    }
  }
  cycles = std::clamp(cycles, 0.0, kMost);
  offset = cycle * (passed - cycles);
  return static_cast<std::int64_t>(cycles);
}

void ArrivalClock::accept(const Arrival& arrival, Time now) {
  // A packet that came during the initialisation would begin a late tick. A source that waits for the answer sends no other one.
  if (!any_ && arrival.host < start_ && spec_.silence != SilencePolicy::kWait) return;
  const bool begins = !any_ || pauses();
  double offset = 0;
  const std::int64_t cycles = begins ? 0 : cycles_since(arrival, offset);
  state_.silent = false;
  if (begins || followed_ == 0) {
    // The run begins, or goes on after a pause, with this packet; the packets after a silence are counted from it. The source's clock may have
    // stood still during the silence, but scenario time did not.
    reached_ = begins ? std::max(reached_, now) : std::max(reached_ + Duration{cycles * cycle_}, now);
    grid_ = static_cast<double>(arrival.host);
    mean_ = square_ = 0;
    followed_ = 1;
  } else {
    if (cycles == 0) return;  // it came twice, or after a younger one
    reached_ = reached_ + Duration{cycles * cycle_};
    // Packets of a source that catches up tell nothing of its phase.
    grid_ += static_cast<double>(cycles * cycle_) + (owed_ > 0 ? 0 : kSmoothing * offset);
    ++followed_;
    const double weight = 1 / std::min(kAveraged, static_cast<double>(followed_ - 1));
    mean_ += weight * (offset - mean_);
    square_ += weight * (offset * offset - square_);
    state_.jitter = 1e-9 * std::sqrt(std::max(0.0, square_ - mean_ * mean_));
    state_.locked = static_cast<double>(followed_) > kAveraged;
    note_offset(offset);
  }
  any_ = true;
  anchor_ = arrival.host;
  source_time_ = arrival.source;
}

void LockedClock::start(Time now) {
  cycle_ = choose_cycle();
  // Every tick may stand at a cycle, and every cycle may begin a tick.
  loop_.emplace(PhaseLockedLoop::Settings{std::min(cycle_, tick_), spec_.shift.ns, spec_.bandwidth, spec_.within.ns});
  heard_ = not_before_ = host_.now();
  loop_->start(heard_);
  at_ = now;
}

bool LockedClock::wait(Time now) {
  if (now > at_) loop_->advance((now - at_).ns);
  at_ = now;
  for (;;) {
    const bool paused = pauses();
    const std::int64_t deadline = paused ? host_.now() + kSlice : loop_->instant();
    const std::optional<Arrival> arrival = receive(deadline);
    if (arrival && paused) {  // scenario time stood still
      loop_->restart(arrival->host);
      not_before_ = host_.now();
    }
    if (arrival) accept(*arrival);
    check_silence();
    if (state_.silent) loop_->unlock();
    const std::int64_t present = host_.now();
    if (!pauses() && present >= loop_->instant()) break;
    if (!arrival && (pauses() || present < deadline)) return false;
  }
  begin_tick(std::max(loop_->instant(), not_before_));
  return true;
}

void LockedClock::accept(const Arrival& arrival) {
  const std::int64_t before = loop_->instant();
  const PhaseLockedLoop::Use use = loop_->measure(arrival);
  // A tick is not late because the loop has just moved it into the past.
  if (loop_->instant() < before) not_before_ = std::min(before, host_.now());
  if (use == PhaseLockedLoop::Use::kStep) ++state_.steps;
  if (use == PhaseLockedLoop::Use::kOutlier) ++state_.missed;
  state_.locked = loop_->locked();
  state_.jitter = 1e-9 * loop_->jitter();
  state_.drift = loop_->drift();
  note_offset(loop_->offset());
}

namespace {

/// A source that only answers falls silent with the ticks that wait for it.
void check_follows(const ClockSpec& spec, const TickSource& source, const std::string& name) {
  if (!source.answers_only()) return;
  const std::string fact = "'" + name + "' only gets answers to what its steps send, so that ";
  if (spec.kind == ClockKind::kArrivals)
    fail(spec.place, fact + "packets cannot begin ticks (kind=arrivals), expected kind=locked");
  if (spec.silence == SilencePolicy::kWait)
    fail(spec.place, fact + "ticks that wait for it would wait for ever (silence=wait), expected silence=wall or stop");
}

}  // namespace

std::unique_ptr<Clock> make_clock(const ClockSpec& spec, Duration tick, std::span<const Member> members, HostTime& host) {
  if (spec.kind == ClockKind::kFree) return std::make_unique<FreeClock>();
  if (spec.kind == ClockKind::kWall) return std::make_unique<RealTimeClock>(spec.late, host);
  const Member* chosen = nullptr;
  std::string all;
  for (const Member& member : members) {
    const bool has_clock = member.instance.unit->tick_source() != nullptr;
    if (has_clock) all += (all.empty() ? "'" : ", '") + member.name() + "'";
    if (spec.component.empty() ? has_clock : member.name() == spec.component) {
      if (chosen != nullptr)
        fail(spec.place, "several components have a clock that ticks can follow: " + all + ", expected one to be named");
      chosen = &member;
    }
  }
  const std::string which = all.empty() ? "; no component has one" : "; those that have one: " + all;
  if (chosen == nullptr)
    fail(spec.place, spec.component.empty() ? "no component has the clock of a robot or bus that ticks can follow"
                                            : "'" + spec.component + "' is not a component" + which);
  TickSource* const source = chosen->instance.unit->tick_source();
  if (source == nullptr)
    fail(spec.place, "'" + spec.component + "' has no clock of a robot or bus that ticks can follow" + which);
  check_follows(spec, *source, chosen->name());
  if (spec.kind == ClockKind::kArrivals) return std::make_unique<ArrivalClock>(spec, tick, *source, chosen->name(), host);
  return std::make_unique<LockedClock>(spec, tick, *source, chosen->name(), host);
}

}  // namespace cotwin::master
