#include "master/engine/events.h"

#include <algorithm>
#include <limits>
#include <set>
#include <unordered_map>
#include <utility>

#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

template <class T>
std::span<T> part(std::span<T> whole, const Signal& signal) {
  return whole.empty() ? whole : whole.subspan(signal.first, signal.count);
}

/// The variable with the signal's elements only.
Variable narrowed(const Signal& signal) {
  Variable v = *signal.variable;
  std::visit([&](auto& storage) { storage = part(storage, signal); }, v.storage);
  v.rate = part(v.rate, signal);
  v.name = signal.name;
  return v;
}

void check_range(const Variable& variable, double value, const EventSpec& spec) {
  if (value >= variable.min && value <= variable.max) return;
  fail(spec.place, "event: " + spec.variable + " = " + text::to_text(value) + ", expected " + allowed_values(variable));
}

}  // namespace

Events::Events(const Scenario& scenario, std::span<const Member> members, std::span<const Signal> fed, const Report& report) {
  const SignalIndex index(members);
  std::set<std::pair<const Variable*, std::size_t>> fed_elements;
  for (const Signal& signal : fed) {
    for (std::size_t e = signal.first; e < signal.first + signal.count; ++e) fed_elements.emplace(signal.variable, e);
  }
  const auto is_fed = [&](const Signal& signal) {
    const auto next = fed_elements.lower_bound({signal.variable, signal.first});
    return next != fed_elements.end() && next->first == signal.variable && next->second < signal.first + signal.count;
  };
  const auto read = [&](const EventSpec& spec) {
    const Signal signal = index.find(spec.variable, spec.place);
    const Variable& variable = *signal.variable;
    if (variable.role != Role::kInput && variable.role != Role::kTunable) {
      fail(spec.place,
           "event on '" + spec.variable + "', " + with_article(variable.role) + ", expected an input or a tunable parameter");
    }
    if (is_fed(signal)) fail(spec.place, "event on '" + spec.variable + "', which a connection feeds");
    if (spec.ramp.ns < 0 || (spec.ramp.ns > 0 && variable.kind() != Kind::kReal)) {
      fail(spec.place, "event on '" + spec.variable + "': a ramp needs a real variable and a positive duration");
    }
    add(spec, signal);
  };
  for (const EventSpec& spec : scenario.events) {
    try {
      read(spec);
    } catch (const Error& error) {
      if (!report) throw;
      report(error);
    }
  }
  arrange();
}

void Events::add(std::span<const Jump> jumps) {
  std::size_t index = 0;
  for (const Jump& jump : jumps) {
    changes_.push_back({jump.time, {}, jump.value, nullptr, jump.target, 0});
    changes_.back().jump = index++;
  }
  arrange();
}

void Events::retarget(std::span<const Jump> jumps) {
  for (Change& change : changes_) {
    if (change.jump != kNone) change.target = jumps[change.jump].target;
  }
}

void Events::arrange() {
  std::stable_sort(changes_.begin(), changes_.end(), [](const Change& a, const Change& b) { return a.time < b.time; });
  for (Change& change : changes_) change.before = kNone;
  link_changes();
  find_next_time();
}

/// Finds the previous change of each value, and reserves memory for all ramps.
void Events::link_changes() {
  std::unordered_map<const double*, std::size_t> last;
  std::size_t ramps = 0;
  for (std::size_t i = 0; i < changes_.size(); ++i) {
    if (changes_[i].value == nullptr) continue;
    const auto [at, first] = last.emplace(changes_[i].value, i);
    if (!first) changes_[i].before = std::exchange(at->second, i);
    if (changes_[i].ramp.ns > 0) ++ramps;
  }
  active_.resize(changes_.size());
  ramps_.reserve(ramps);
}

void Events::add(const EventSpec& spec, const Signal& signal) {
  // Reads the text into temporary storage, by the same rules as start values.
  Other other{narrowed(signal), {}, {}, {}};
  const Variable& variable = other.variable;
  Variable value = variable;
  std::vector<double> reals;
  const std::size_t n = signal.count;
  switch (variable.kind()) {
    case Kind::kReal:
      reals.resize(n), value.storage = std::span(reals);
      break;
    case Kind::kInteger:
      other.integers.resize(n), value.storage = std::span(other.integers);
      break;
    case Kind::kBoolean:
      other.booleans = std::make_unique<bool[]>(n), value.storage = std::span(other.booleans.get(), n);
      break;
    case Kind::kString:
      other.strings.resize(n), value.storage = std::span(other.strings);
      break;
  }
  ExactIntegers exact;
  if (value.exact != nullptr) value.exact = &exact;
  try {
    assign_text(value, spec.value);
    if (!exact.empty())
      throw Error(variable.name, spec.value + ", which an event cannot set exactly, expected an integer that double has");
  } catch (const Error& error) {
    fail(spec.place, error.what());
  }
  for (const std::int32_t integer : other.integers) check_range(variable, integer, spec);
  if (variable.kind() != Kind::kReal) {
    changes_.push_back({spec.time, spec.ramp, nullptr, nullptr, 0, others_.size()});
    others_.push_back(std::move(other));
    return;
  }
  for (std::size_t i = 0; i < n; ++i) {
    check_range(variable, reals[i], spec);
    double* rate = variable.rate.empty() ? nullptr : &variable.rate[i];
    changes_.push_back({spec.time, spec.ramp, &variable.reals()[i], rate, reals[i], 0});
  }
}

void Events::apply_due(Time now, Duration h) {
  while (next_ < changes_.size() && changes_[next_].time <= now) begin(next_++);
  std::erase_if(ramps_, [&](const Ramp& ramp) { return active_[ramp.change] == 0 || !follow(ramp, now, h); });
  find_next_time();
}

void Events::find_next_time() {
  using Limits = std::numeric_limits<std::int64_t>;
  next_time_ = !ramps_.empty() ? Time{Limits::min()} : next_ < changes_.size() ? changes_[next_].time : Time{Limits::max()};
}

void Events::end_ramp(const double* value) {
  if (ramps_.empty()) return;
  std::erase_if(ramps_, [&](const Ramp& ramp) {
    const Change& change = changes_[ramp.change];
    if (change.value != value) return false;
    active_[ramp.change] = 0;
    if (change.rate) *change.rate = 0;
    return true;
  });
  find_next_time();
}

Time Events::next_after(Time now) const {
  Time next{std::numeric_limits<std::int64_t>::max()};
  const auto consider_end = [&](const Change& change) {
    const Time end = change.time + change.ramp;
    if (end > now) next = std::min(next, end);
  };
  for (const Ramp& ramp : ramps_) consider_end(changes_[ramp.change]);
  for (std::size_t i = next_; i < changes_.size(); ++i) {
    if (changes_[i].time > now) return std::min(next, changes_[i].time);
    consider_end(changes_[i]);
  }
  return next;
}

void Events::begin(std::size_t index) {
  const Change& change = changes_[index];
  if (!change.value) {
    Other& other = others_[change.other];
    switch (other.variable.kind()) {
      case Kind::kReal:
        break;
      case Kind::kInteger:
        std::copy(other.integers.begin(), other.integers.end(), other.variable.integers().begin());
        break;
      case Kind::kBoolean:
        std::copy_n(other.booleans.get(), other.variable.size(), other.variable.booleans().begin());
        break;
      case Kind::kString:
        std::copy(other.strings.begin(), other.strings.end(), other.variable.strings().begin());
        break;
    }
    return;
  }
  // Ends the previous ramp of this value; earlier ones have ended already.
  if (change.before != kNone) active_[change.before] = 0;
  if (change.rate) *change.rate = 0;
  if (change.ramp.ns > 0) {
    ramps_.push_back({index, *change.value});
    active_[index] = 1;
  } else {
    *change.value = change.target;
  }
}

/// Returns whether the ramp continues.
bool Events::follow(const Ramp& ramp, Time now, Duration h) {
  const Change& change = changes_[ramp.change];
  const auto share = [&](Time t) {
    const std::int64_t elapsed = std::clamp((t - change.time).ns, std::int64_t{0}, change.ramp.ns);
    return static_cast<double>(elapsed) / static_cast<double>(change.ramp.ns);
  };
  const double at_begin = share(now), at_end = share(now + h), rise = change.target - ramp.begin;
  *change.value = at_begin == 1 ? change.target : ramp.begin + rise * at_begin;
  if (change.rate) *change.rate = rise * (at_end - at_begin) / h.seconds();
  if (at_begin == 1) active_[ramp.change] = 0;
  return at_begin != 1;
}

void Events::save(State& state) const {
  state.changes = changes_.size();
  state.next = next_;
  state.ramps.reserve(ramps_.capacity());
  state.ramps = ramps_;
}

void Events::restore(const State& state) {
  next_ = state.next;
  for (const Ramp& ramp : ramps_) active_[ramp.change] = 0;
  ramps_ = state.ramps;
  for (const Ramp& ramp : ramps_) active_[ramp.change] = 1;
  find_next_time();
}

bool Events::is_valid(const State& state) const {
  if (state.changes != changes_.size() || state.next > changes_.size()) return false;
  std::size_t least = 0;  // smallest valid index: ramps begin in the order of the changes
  for (const Ramp& ramp : state.ramps) {
    if (ramp.change < least || ramp.change >= state.next || changes_[ramp.change].ramp.ns <= 0) return false;
    if (changes_[ramp.change].value == nullptr) return false;
    least = ramp.change + 1;
  }
  return true;
}

}  // namespace cotwin::master
