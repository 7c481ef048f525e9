#include "master/run/live_loop.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "master/clock/clock.h"
#include "master/engine/threaded_unit.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/fields.h"

namespace cotwin::master {

namespace {

using bus::LiveRun;

constexpr std::size_t kHeader = sizeof(LiveRun::RecordHeader) / sizeof(double);

bus::LiveSignal describe(const Member& member, const Variable& v) {
  bus::LiveSignal s;
  s.name = member.name() + "." + v.name;
  s.component = member.name();
  s.variable = v.name;
  s.kind = v.kind();
  s.role = v.role;
  s.size = v.size();
  s.si = v.si;
  if (v.elements != nullptr) s.elements = *v.elements;
  s.description = v.description;
  s.min = v.min;
  s.max = v.max;
  s.discrete = v.discrete;
  return s;
}

}  // namespace

std::vector<bus::RunObserver*> LiveLoop::observers(std::span<const Member> members) {
  std::vector<bus::RunObserver*> all;
  for (const Member& member : members) {
    ThreadedUnit* const beside = beside_of(member);
    Unit& unit = beside != nullptr ? beside->inner() : *member.instance.unit;
    if (auto* const observer = dynamic_cast<bus::RunObserver*>(&unit)) all.push_back(observer);
  }
  return all;
}

LiveLoop::LiveLoop(const Scenario& scenario, std::span<const Member> members, Engine& engine, std::string unpausable,
                   std::shared_ptr<bus::RunPage> page, std::filesystem::path results)
    : engine_(engine) {
  std::vector<bus::LiveSignal> signals;
  for (const Member& member : members) {
    for (const Variable& v : member.variables()) {
      bus::LiveSignal& signal = signals.emplace_back(describe(member, v));
      if (v.role == Role::kInput || v.role == Role::kTunable) signal.fed.assign(v.size(), false);
      for (const ResolvedConnection& link : engine.links) {
        if (link.initial || link.to.variable != &v) continue;
        for (std::size_t e = link.to.first; e < link.to.first + link.to.count && e < signal.fed.size(); ++e)
          signal.fed[e] = true;
      }
      std::visit(
          [&](auto values) {
            using T = typename decltype(values)::value_type;
            if constexpr (!std::is_same_v<T, std::string>) {
              for (std::size_t e = 0; e < values.size(); ++e) {
                sources_.push_back({&values[e], v.kind()});
                targets_.push_back({&values[e], v.rate.empty() ? nullptr : &v.rate[e], v.kind()});
                signal.start.push_back(static_cast<double>(values[e]));
              }
            }
          },
          v.storage);
    }
  }
  bus::RunFacts facts{scenario.name,         scenario.start,          engine.schedule.stop(),
                      scenario.tick,         engine.schedule.ticks(), text::word_of(scenario.clock.kind, kClockWords),
                      std::move(unpausable), std::move(page),         std::move(results)};
  run_ = std::make_shared<LiveRun>(std::move(facts), std::move(signals));
  copied_.resize(LiveRun::kMaxWatched);
  record_.resize(kHeader + LiveRun::kMaxWatched);
  waiting_.reserve(LiveRun::kMaxWaiting);
  listed_.reserve(kMostListed);
  taken_.reserve(kMostCommands);
}

LiveLoop::~LiveLoop() {
  if (!ended_) end(run_->position().tick);
}

void LiveLoop::answer_calls(std::int64_t tick, Time now) {
  LiveRun::Calls::Call call;
  // Limited, so that a flood of requests cannot hold up the tick: the others wait for the next one.
  for (std::size_t n = 0; n < LiveRun::Calls::kMaxClients && run_->calls().take(call); ++n) {
    LiveRun::Answer answer{bus::RunReply::kDone, tick};
    switch (call.request.verb) {
      case bus::RunVerb::kSet:
        answer.reply = set_values(call.request, tick, now, answer);
        break;
      case bus::RunVerb::kPause:
        begin_pause();
        break;
      case bus::RunVerb::kResume:
        steps_ = 0;
        end_pause();
        break;
      case bus::RunVerb::kStep:
        steps_ = call.request.number;
        pause_at_ = steps_ < kNever - tick ? tick + steps_ : kNever;
        answer.tick = pause_at_;
        end_pause();
        break;
      case bus::RunVerb::kStop:
        stopped_ = true;
        break;
    }
    if (call.request.verb != bus::RunVerb::kSet && taken_.size() < kMostCommands)
      taken_.push_back({tick, call.request.verb, call.request.by});
    if (answer.reply != bus::RunReply::kDone) ++refused_;
    run_->calls().reply(call, answer);
  }
}

bus::RunReply LiveLoop::set_values(const LiveRun::Call& call, std::int64_t tick, Time now, LiveRun::Answer& answer) {
  const std::span<const LiveRun::Value> values(call.values, call.count);
  if (call.number == LiveRun::kAtOnce) {
    for (const LiveRun::Value& value : values) apply(value, call.by, tick);
    return bus::RunReply::kDone;
  }
  const Time at{call.number};
  if (at < now) return bus::RunReply::kPast;
  if (waiting_.size() + values.size() > waiting_.capacity()) return bus::RunReply::kFull;
  for (const LiveRun::Value& value : values) {
    const auto later = std::ranges::upper_bound(waiting_, at, {}, &Waiting::time);
    waiting_.insert(later, {at, value, call.by});
  }
  find_next_waiting();
  const std::int64_t ns = run_->facts().tick.ns, since = (at - run_->facts().start).ns;
  answer.tick = since / ns + (since % ns != 0 ? 1 : 0);
  return bus::RunReply::kDone;
}

void LiveLoop::apply_waiting(std::int64_t tick, Time now) {
  const auto due = std::ranges::upper_bound(waiting_, now, {}, &Waiting::time);
  for (auto w = waiting_.begin(); w != due; ++w) apply(w->value, w->by, tick);
  waiting_.erase(waiting_.begin(), due);
  find_next_waiting();
}

void LiveLoop::find_next_waiting() { next_waiting_ = waiting_.empty() ? Time{kNever} : waiting_.front().time; }

/// As an event without a ramp.
void LiveLoop::apply(const LiveRun::Value& value, std::uint32_t by, std::int64_t tick) {
  const Target& target = targets_[value.channel];
  switch (target.kind) {
    case Kind::kReal:
      engine_.events.end_ramp(static_cast<double*>(target.value));
      if (target.rate != nullptr) *target.rate = 0;
      *static_cast<double*>(target.value) = value.value;
      break;
    case Kind::kInteger:
      *static_cast<std::int32_t*>(target.value) = static_cast<std::int32_t>(value.value);
      break;
    case Kind::kBoolean:
      *static_cast<bool*>(target.value) = value.value != 0;
      break;
    case Kind::kString:
      return;
  }
  changed_ = true;
  run_->set_changes(++changes_);
  if (listed_.size() < kMostListed) {
    listed_.push_back({tick, value, by});
  } else {
    ++more_;
  }
}

void LiveLoop::begin_pause() {
  steps_ = 0;
  if (std::exchange(paused_, true)) return;
  ++pauses_;
  pause_began_ = bus::monotonic_ns();
  run_->set_phase(bus::RunPhase::kPaused);
}

void LiveLoop::end_pause() {
  if (!std::exchange(paused_, false)) return;
  paused_ns_ += bus::monotonic_ns() - pause_began_;
  resumed_ = true;
  run_->set_phase(bus::RunPhase::kRunning);
}

void LiveLoop::wait(std::int64_t tick) {
  run_->hold(bus::monotonic_ns() + Clock::kSlice);
  if (run_->requested()) record(tick);
}

double LiveLoop::read(const Source& source) {
  switch (source.kind) {
    case Kind::kInteger:
      return *static_cast<const std::int32_t*>(source.value);
    case Kind::kBoolean:
      return *static_cast<const bool*>(source.value) ? 1 : 0;
    default:
      return source.value != nullptr ? *static_cast<const double*>(source.value) : 0;
  }
}

void LiveLoop::adopt_plan(std::int64_t tick) {
  LiveRun::Plan plan;
  if (!run_->pop_plan(plan)) return;
  plan_ = plan.number;
  every_ = plan.every;
  places_ = plan.channels.size();
  for (std::size_t i = 0; i < places_; ++i)
    copied_[i] = plan.channels[i] == LiveRun::kNoChannel ? Source{} : sources_[plan.channels[i]];
  next_record_ = every_ > 0 ? (tick / every_ + 1) * every_ : kNever;
}

void LiveLoop::record(std::int64_t tick) {
  (void)run_->pop_request();
  adopt_plan(tick);
  if (tick >= next_record_ && every_ > 0) next_record_ = (tick / every_ + 1) * every_;
  if (places_ == 0) return;
  const LiveRun::RecordHeader header{tick, plan_};
  std::memcpy(record_.data(), &header, sizeof header);
  double* const values = record_.data() + kHeader;
  for (std::size_t i = 0; i < places_; ++i) values[i] = read(copied_[i]);
  run_->publish(std::as_bytes(std::span(record_).first(kHeader + places_)));
}

void LiveLoop::end(std::int64_t tick) {
  ended_ = true;
  end_pause();
  run_->set_tick(tick);
  record(tick);
  run_->set_phase(bus::RunPhase::kEnded);
  LiveRun::Calls::Call call;
  while (run_->calls().take(call)) run_->calls().reply(call, {bus::RunReply::kEnded, tick});
}

Influence LiveLoop::influence() const {
  Influence all;
  const auto signals = run_->signals();
  const std::vector<std::string> names = run_->names();
  for (const Listed& listed : listed_) {
    const std::size_t channel = listed.value.channel;
    const auto after = std::ranges::partition_point(signals, [&](const bus::LiveSignal& s) { return s.channel <= channel; });
    // Strings and empty vectors have the channel of the next signal and come before it.
    const bus::LiveSignal& s = *std::prev(after);
    Influence::Change& change = all.changes.emplace_back();
    change.tick = listed.tick;
    change.time = run_->time(listed.tick).seconds();
    change.name = s.size == 1 ? s.name : s.name + "[" + std::to_string(channel - s.channel + 1) + "]";
    change.kind = s.kind;
    change.value = listed.value.value;
    change.by = names[listed.by];
  }
  for (const Taken& taken : taken_)
    all.commands.push_back({taken.tick, run_->time(taken.tick).seconds(), taken.verb, names[taken.by]});
  all.others = run_->deeds();
  all.more = more_;
  all.refused = refused_;
  all.pauses = pauses_;
  all.paused_seconds = 1e-9 * static_cast<double>(paused_ns_);
  all.stopped = stopped_;
  return all;
}

void LiveLoop::write(ByteWriter& out) const { Putter(out).put(run_->names(), run_->deeds(), *this); }

void LiveLoop::read(ByteReader& in, std::int64_t tick) {
  std::vector<std::string> names;
  std::vector<LiveRun::Deed> deeds;
  Getter(in).get(names, deeds, *this);
  std::vector<std::uint32_t> numbers;  // of the names in this process
  for (const std::string& name : names) numbers.push_back(run_->number_of(name));
  const auto adopt_name = [&](std::uint32_t& by) {
    if (by >= numbers.size()) in.fail("is damaged");
    by = numbers[by];
  };
  const auto adopt = [&](auto& changes) {
    for (auto& change : changes) {
      if (change.value.channel >= targets_.size()) in.fail("sets values of other units");
      adopt_name(change.by);
    }
  };
  if (listed_.size() > kMostListed || waiting_.size() > LiveRun::kMaxWaiting || taken_.size() > kMostCommands ||
      !std::ranges::is_sorted(waiting_, {}, &Waiting::time))
    in.fail("is damaged");
  adopt(listed_);
  adopt(waiting_);
  for (Taken& taken : taken_) adopt_name(taken.by);
  find_next_waiting();
  for (LiveRun::Deed& deed : deeds) run_->note(std::move(deed));
  run_->set_changes(changes_);
  run_->set_tick(tick);
}

}  // namespace cotwin::master
