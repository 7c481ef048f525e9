#include "components/bus/live_run.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <utility>

#include "components/bus/errors.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::bus {

namespace {

constexpr std::size_t kFeedBytes = std::size_t{4} << 20;
constexpr std::size_t kMostRecords = 4096, kFewestRecords = 16;
constexpr std::int64_t kSlice = 50'000'000;  // ns, after which a waiting client looks whether the run has ended

std::size_t records_of(std::size_t bytes) { return std::clamp(kFeedBytes / bytes, kFewestRecords, kMostRecords); }

std::string element_name(const LiveSignal& signal, std::size_t element) {
  return signal.size == 1 ? signal.name : signal.name + "[" + std::to_string(element + 1) + "]";
}

void check_value(const LiveSignal& signal, std::size_t element, double value) {
  const auto refuse = [&](const std::string& expected) {
    throw Error("run", element_name(signal, element) + " = " + text::to_text(value) + ", expected " + expected);
  };
  if (!std::isfinite(value)) refuse("a finite number");
  if (signal.kind == Kind::kBoolean && value != 0 && value != 1) refuse("true or false");
  using Limits = std::numeric_limits<std::int32_t>;
  if (signal.kind == Kind::kInteger && (value != std::floor(value) || value < Limits::min() || value > Limits::max()))
    refuse("an integer of 32 bits");
  if (value < signal.min || value > signal.max)
    refuse(text::to_text(signal.min) + " to " + text::to_text(signal.max) + (signal.si.empty() ? "" : " " + signal.si));
}

Feed::Reader reader_of(Feed& feed, std::shared_ptr<Wake> wake) {
  try {
    return Feed::Reader(feed, std::move(wake));
  } catch (const Error&) {
    throw NoRoom("run", "it is watched by " + std::to_string(Feed::kMaxReaders) + " clients, expected no more");
  }
}

}  // namespace

bool LiveSignal::settable(std::size_t element) const {
  return (role == Role::kInput || role == Role::kTunable) && kind != Kind::kString && !(element < fed.size() && fed[element]);
}

bool LiveSignal::settable() const {
  for (std::size_t e = 0; e < size; ++e) {
    if (settable(e)) return true;
  }
  return false;
}

/// A client of the service with the memory for its request, which the loop reads.
struct LiveRun::Control::Slot {
  Calls::Client* client = nullptr;
  std::shared_ptr<Wake> wake;
  std::vector<Value> values;
  bool used = false;
};

LiveRun::LiveRun(RunFacts facts, std::vector<LiveSignal> signals)
    : facts_(std::move(facts)),
      signals_(std::move(signals)),
      channels_([this] {
        std::size_t next = 0;
        for (LiveSignal& signal : signals_) {
          signal.channel = next;
          if (signal.kind != Kind::kString) next += signal.size;
        }
        return next;
      }()),
      places_(std::min(channels_, kMaxWatched)),
      planned_(places_, kNoChannel),
      watchers_(places_, 0),
      place_of_(channels_, kNone),
      plans_(sizeof(PlanHeader) + places_ * sizeof(std::uint32_t)),
      feed_(sizeof(RecordHeader) + places_ * sizeof(double), records_of(sizeof(RecordHeader) + places_ * sizeof(double))),
      wake_(std::make_shared<Wake>()),
      calls_(Calls::kMaxClients, wake_) {
  for (std::size_t i = 0; i < signals_.size(); ++i) by_name_.emplace(signals_[i].name, i);
}

LiveRun::~LiveRun() = default;

RunPosition LiveRun::position() const {
  RunPosition p;
  p.phase = phase_.load(std::memory_order_acquire);
  p.tick = tick_.load(std::memory_order_relaxed);
  p.time = time(p.tick);
  p.changes = changes_.load(std::memory_order_relaxed);
  return p;
}

LiveElements LiveRun::find(std::string_view name) const {
  if (const auto found = by_name_.find(name); found != by_name_.end()) {
    const LiveSignal& signal = signals_[found->second];
    return {&signal, 0, signal.size};
  }
  const std::size_t bracket = name.rfind('[');
  if (bracket != std::string_view::npos && name.ends_with("]")) {
    const auto found = by_name_.find(name.substr(0, bracket));
    const std::string_view number = name.substr(bracket + 1, name.size() - bracket - 2);
    const std::optional<std::int64_t> element = text::parse_integer(number);
    if (found != by_name_.end()) {
      const LiveSignal& signal = signals_[found->second];
      if (!element || *element < 1 || *element > static_cast<std::int64_t>(signal.size))
        throw Error("run", "'" + std::string(name) + "': " + signal.name + " has elements 1 to " + std::to_string(signal.size));
      return {&signal, static_cast<std::size_t>(*element - 1), 1};
    }
  }
  std::vector<std::string> names;
  for (const LiveSignal& signal : signals_) names.push_back(signal.name);
  const std::string closest = text::closest(name, names);
  throw Error("run",
              "there is no signal '" + std::string(name) + "'" + (closest.empty() ? "" : "; did you mean '" + closest + "'?"));
}

void LiveRun::request() {
  requested_.store(true);
  wake_->notify();
}

/// Each element that is not watched already gets a free place.
void LiveRun::select(std::span<const LiveElements> elements, std::int64_t every, std::vector<std::size_t>& slots,
                     std::uint64_t& since) {
  const std::lock_guard lock(mutex_);
  std::size_t place = 0;
  for (const LiveElements& e : elements) {
    for (std::size_t c = e.channel(); c < e.channel() + e.count; ++c) {
      if (place_of_[c] == kNone) {
        while (place < places_ && planned_[place] != kNoChannel) ++place;
        if (place == places_) {
          for (const std::size_t taken : slots) {
            if (--watchers_[taken] == 0) place_of_[std::exchange(planned_[taken], kNoChannel)] = kNone;
          }
          throw NoRoom("run", "more than " + std::to_string(kMaxWatched) + " values are watched");
        }
        planned_[place] = static_cast<std::uint32_t>(c);
        place_of_[c] = place;
      }
      ++watchers_[place_of_[c]];
      slots.push_back(place_of_[c]);
    }
  }
  intervals_.push_back(every);
  pass_plan();
  since = plan_;
}

void LiveRun::deselect(std::span<const std::size_t> slots, std::int64_t every) {
  const std::lock_guard lock(mutex_);
  for (const std::size_t place : slots) {
    if (--watchers_[place] == 0) place_of_[std::exchange(planned_[place], kNoChannel)] = kNone;
  }
  intervals_.erase(std::find(intervals_.begin(), intervals_.end(), every));
  pass_plan();
}

void LiveRun::pass_plan() {
  PlanHeader header;
  header.number = ++plan_;
  for (const std::int64_t every : intervals_) header.every = std::gcd(header.every, every);
  header.count = places_;
  while (header.count > 0 && planned_[header.count - 1] == kNoChannel) --header.count;
  std::byte* const to = plans_.back().data();
  std::memcpy(to, &header, sizeof header);
  if (header.count > 0) std::memcpy(to + sizeof header, planned_.data(), header.count * sizeof(std::uint32_t));
  plans_.publish();
}

bool LiveRun::pop_plan(Plan& plan) {
  if (!plans_.take()) return false;
  PlanHeader header;
  std::memcpy(static_cast<void*>(&header), plans_.front().data(), sizeof header);
  plan.number = header.number;
  plan.every = header.every;
  plan.channels = {reinterpret_cast<const std::uint32_t*>(plans_.front().data() + sizeof header), header.count};
  return true;
}

void LiveRun::hold(std::int64_t deadline) {
  wake_->wait([this] { return !calls_.empty() || requested(); }, deadline);
}

LiveRun::Watch::Watch(std::shared_ptr<LiveRun> run, std::span<const std::string> names, std::int64_t every,
                      std::shared_ptr<Wake> wake)
    : run_(std::move(run)), every_(std::max<std::int64_t>(every, 0)), reader_(reader_of(run_->feed_, std::move(wake))) {
  for (const std::string& name : names) {
    elements_.push_back(run_->find(name));
    if (elements_.back().signal->kind == Kind::kString)
      throw Error("run", "'" + name + "' is a text, expected a number or a boolean to watch");
  }
  record_.resize(run_->feed_.bytes() / sizeof(double));
  run_->select(elements_, every_, slots_, since_);
  request();
}

LiveRun::Watch::~Watch() {
  run_->deselect(slots_, every_);
  request();  // so that the loop takes the plan without them
}

/// Copies the watched values out of a record. False: it is of an earlier plan, or between two intervals of this watch.
bool LiveRun::Watch::read() {
  RecordHeader header;
  std::memcpy(static_cast<void*>(&header), record_.data(), sizeof header);
  if (header.plan < since_) return false;
  if (every_ > 0 && last_ >= 0 && header.tick / every_ == last_ / every_) return false;
  last_ = header.tick;
  sample_.tick = header.tick;
  sample_.time = run_->time(header.tick);
  sample_.values.resize(slots_.size());
  const double* const values = record_.data() + sizeof header / sizeof(double);
  for (std::size_t i = 0; i < slots_.size(); ++i) sample_.values[i] = values[slots_[i]];
  return held_ = true;
}

bool LiveRun::Watch::fetch() {
  while (!held_ && reader_.take(std::as_writable_bytes(std::span(record_)))) (void)read();
  return held_;
}

bool LiveRun::Watch::take(Sample& sample) {
  if (!fetch()) return false;
  std::swap(sample, sample_);
  held_ = false;
  return true;
}

bool LiveRun::Watch::pop_newest(Sample& sample) {
  if (reader_.pop_newest(std::as_writable_bytes(std::span(record_)))) (void)read();
  return take(sample);
}

bool LiveRun::Watch::wait(std::int64_t deadline) {
  while (!fetch()) {
    if (!reader_.wait(deadline)) return false;
  }
  return true;
}

/// A free client of the service, or a new one.
LiveRun::Control::Slot* LiveRun::reserve_slot() {
  const std::lock_guard lock(mutex_);
  for (const auto& slot : slots_) {
    Calls::Answer late;
    while (!slot->used && slot->client->take(late)) {
    }
    if (slot->used || slot->client->open() > 0) continue;
    slot->used = true;
    return slot.get();
  }
  if (slots_.size() == Calls::kMaxClients)
    throw NoRoom("run", "it has requests of " + std::to_string(Calls::kMaxClients) + " clients, expected no more");
  auto slot = std::make_unique<Control::Slot>();
  slot->client = &calls_.add_client(1);
  slot->values.resize(kMaxSet);
  slot->used = true;
  slots_.push_back(std::move(slot));
  return slots_.back().get();
}

std::uint32_t LiveRun::number_of(std::string_view name) {
  const std::lock_guard lock(naming_);
  auto found = std::ranges::find(names_, name);
  if (found == names_.end() && names_.size() >= kMostNames) found = std::ranges::find(names_, "others");
  if (found == names_.end()) found = names_.insert(names_.end(), std::string(names_.size() + 1 < kMostNames ? name : "others"));
  return static_cast<std::uint32_t>(found - names_.begin());
}

std::vector<std::string> LiveRun::names() const {
  const std::lock_guard lock(naming_);
  return names_;
}

void LiveRun::note(Deed deed) {
  const std::lock_guard lock(naming_);
  if (deeds_.size() < kMostDeeds) deeds_.push_back(std::move(deed));
}

std::vector<LiveRun::Deed> LiveRun::deeds() const {
  const std::lock_guard lock(naming_);
  return deeds_;
}

LiveRun::Control::Control(std::shared_ptr<LiveRun> run, std::string_view by)
    : run_(std::move(run)), slot_(run_->reserve_slot()), by_(run_->number_of(by)) {}

LiveRun::Control::~Control() {
  if (open_) slot_->client->cancel(*open_);
  const std::lock_guard lock(run_->mutex_);
  slot_->used = false;
}

/// Throws Error if the memory of the last request may still be read, and for a run that has ended.
void LiveRun::Control::prepare() {
  Calls::Answer late;
  while (slot_->client->take(late)) {
  }
  if (slot_->client->open() > 0) throw NoRoom("run", "the request before this one has no answer yet: the run is within a tick");
  open_.reset();
  if (run_->position().phase == RunPhase::kEnded) throw RunEnded("run", "it has ended");
}

void LiveRun::Control::ask(RunVerb verb, std::int64_t number, std::size_t values) {
  open_ = slot_->client->ask({verb, number, slot_->values.data(), values, by_});
  if (!open_) throw NoRoom("run", "too many requests wait for it");
}

void LiveRun::Control::set(std::span<const Change> changes, std::optional<Time> at) {
  prepare();
  if (at && (*at < run_->facts().start || *at >= run_->facts().stop))
    throw Error("run", "values at " + text::to_text(at->seconds()) + " s, expected a time from " +
                           text::to_text(run_->facts().start.seconds()) + " s to before " +
                           text::to_text(run_->facts().stop.seconds()) + " s");
  std::size_t n = 0;
  for (const Change& change : changes) {
    const LiveElements e = run_->find(change.name);
    const LiveSignal& signal = *e.signal;
    if (change.values.size() != e.count && change.values.size() != 1)
      throw Error("run", change.name + ": " + std::to_string(change.values.size()) + " values, expected 1" +
                             (e.count > 1 ? " or " + std::to_string(e.count) : ""));
    if (n + e.count > kMaxSet) throw Error("run", "more than " + std::to_string(kMaxSet) + " values in one request");
    for (std::size_t i = 0; i < e.count; ++i) {
      const std::size_t element = e.first + i;
      if (!signal.settable(element)) {
        const bool fed = element < signal.fed.size() && signal.fed[element];
        const bool vowel = signal.role == Role::kInput || signal.role == Role::kOutput;
        throw Error("run", "'" + element_name(signal, element) + "' " +
                               (fed ? "is fed by a connection"
                                    : "is " + std::string(vowel ? "an " : "a ") + std::string(name_of(signal.role)) + " (" +
                                          std::string(name_of(signal.kind)) + ")") +
                               ", expected a tunable or a free input that is no text");
      }
      const double value = change.values[change.values.size() == 1 ? 0 : i];
      check_value(signal, element, value);
      slot_->values[n++] = {static_cast<std::uint32_t>(signal.channel + element), value};
    }
  }
  if (n == 0) throw Error("run", "no values to set");
  ask(RunVerb::kSet, at ? at->ns : kAtOnce, n);
}

void LiveRun::Control::command(RunVerb verb, std::int64_t ticks) {
  prepare();
  if (verb == RunVerb::kStep && ticks < 1) throw Error("run", std::to_string(ticks) + " ticks, expected 1 or more");
  const bool needs_pause = verb == RunVerb::kPause || verb == RunVerb::kResume || verb == RunVerb::kStep;
  if (needs_pause && !run_->facts().unpausable.empty()) throw Error("run", "it cannot pause: " + run_->facts().unpausable);
  ask(verb, ticks, 0);
}

std::optional<LiveRun::Answer> LiveRun::Control::take() {
  Calls::Answer answer;
  if (!open_ || !slot_->client->take(answer)) return std::nullopt;
  open_.reset();
  return answer.reply;
}

std::optional<LiveRun::Answer> LiveRun::Control::wait(std::int64_t deadline) {
  while (open_) {
    if (const std::optional<Answer> answer = take()) return answer;
    const std::int64_t now = monotonic_ns();
    const bool ended = run_->position().phase == RunPhase::kEnded;
    if (ended || (deadline != kNever && now >= deadline)) {
      if (const std::optional<Answer> answer = take()) return answer;
      slot_->client->cancel(*std::exchange(open_, std::nullopt));
      if (ended) return Answer{RunReply::kEnded, run_->position().tick};
      return std::nullopt;
    }
    slot_->client->wait(deadline == kNever ? now + kSlice : std::min(deadline, now + kSlice));
  }
  return std::nullopt;
}

}  // namespace cotwin::bus
