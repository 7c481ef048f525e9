#include "fmu/import/unit/clocks.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

/// Returns whether t has reached `when`, within the rounding of sums of steps.
bool reached(double t, double when) { return t >= when - 1e-14 * std::max(1.0, std::abs(when)); }

}  // namespace

ForeignClocks::ForeignClocks(const ModelDescription& description, ForeignVariables& variables) : variables_(variables) {
  for (const ModelVariable& v : description.variables) {
    if (v.type != Type::kClock) continue;
    const std::span<bool> ticked = variables.clock(v.reference);
    const bool input = v.causality == Causality::kInput;
    if (v.clock.interval_variability == IntervalVariability::kTriggered) {
      (input ? triggered_ : outputs_).push_back({v.reference, ticked});
      if (!input) output_references_.push_back(v.reference);
    } else if (input) {
      Timed clock;
      clock.reference = v.reference;
      clock.name = v.name;
      clock.variability = v.clock.interval_variability;
      if (v.clock.supports_fraction && v.clock.resolution && v.clock.interval_counter && *v.clock.resolution > 0) {
        const auto resolution = static_cast<double>(*v.clock.resolution);
        clock.interval = static_cast<double>(*v.clock.interval_counter) / resolution;
        clock.origin = static_cast<double>(v.clock.shift_counter) / resolution;
        clock.declared = true;
      } else if (v.clock.interval) {
        clock.interval = *v.clock.interval;
        clock.origin = v.clock.shift;
        clock.declared = true;
      }
      clock.ticked = ticked;
      timed_.push_back(std::move(clock));
    }
  }
  active_.reserve(timed_.size() + triggered_.size());
  output_active_ = std::make_unique<bool[]>(outputs_.size());
}

bool ForeignClocks::periodic(const Timed& clock) {
  return clock.variability != IntervalVariability::kChanging && clock.variability != IntervalVariability::kCountdown;
}

void ForeignClocks::query_interval(ForeignInstance& instance, Timed& clock, double t, bool first) {
  double interval = clock.interval;
  IntervalState state = IntervalState::kNotYetKnown;
  instance.get_intervals({&clock.reference, 1}, {&interval, 1}, {&state, 1});
  if (state == IntervalState::kNotYetKnown) {
    if (clock.variability != IntervalVariability::kCountdown) {
      throw Error("clock '" + clock.name + "'", "the FMU gives no interval at " + text::to_text(t) + " s, expected one");
    }
    clock.next = kNever;
    return;
  }
  if (state == IntervalState::kUnchanged && !first) {
    if (periodic(clock) || !clock.active) return;  // keeps its schedule
    interval = clock.interval;
  }
  if (!(interval >= 0) || !(interval < kNever) || (periodic(clock) && interval == 0)) {
    throw Error("clock '" + clock.name + "'",
                "interval " + text::to_text(interval) + " s at " + text::to_text(t) + " s, expected a finite one above 0");
  }
  clock.interval = interval;
  if (!periodic(clock)) {
    clock.next = t + interval;
  } else if (!first) {  // a tunable clock: the new interval begins now
    clock.origin = t;
    clock.count = 1;
    clock.next = t + interval;
  }
}

void ForeignClocks::begin(ForeignInstance& instance, double start) {
  ticks_ = 0;
  for (Timed& clock : timed_) {
    clock.active = false;
    clock.count = 0;
    double shift = clock.origin;
    if (periodic(clock) && clock.declared) {
      if (!(clock.interval > 0) || !(clock.interval < kNever)) {
        throw Error("clock '" + clock.name + "'",
                    "interval " + text::to_text(clock.interval) + " s, expected a finite one above 0");
      }
      // The interval of a constant clock cannot be set. For the others the importer confirms the declared interval.
      if (clock.variability != IntervalVariability::kConstant)
        instance.set_intervals({&clock.reference, 1}, {&clock.interval, 1});
    } else {
      query_interval(instance, clock, start, true);
      if (!periodic(clock)) continue;
      instance.get_shifts({&clock.reference, 1}, {&shift, 1});
    }
    clock.origin = start + shift;
    clock.next = clock.origin;
  }
  begin_step();
}

void ForeignClocks::begin_step() {
  for (Timed& clock : timed_) std::fill(clock.ticked.begin(), clock.ticked.end(), false);
  for (Triggered& clock : outputs_) std::fill(clock.ticked.begin(), clock.ticked.end(), false);
}

std::optional<double> ForeignClocks::next() const {
  double earliest = kNever;
  for (const Timed& clock : timed_) earliest = std::min(earliest, clock.next);
  return earliest < kNever ? std::optional(earliest) : std::nullopt;
}

bool ForeignClocks::due(double t) const {
  return std::any_of(timed_.begin(), timed_.end(), [&](const Timed& c) { return reached(t, c.next); });
}

bool ForeignClocks::triggered() const {
  return std::any_of(triggered_.begin(), triggered_.end(), [](const Triggered& c) { return !c.ticked.empty() && c.ticked[0]; });
}

void ForeignClocks::activate(ForeignInstance& instance, double t, bool triggered) {
  active_.clear();
  for (Timed& clock : timed_) {
    clock.active = reached(t, clock.next);
    if (!clock.active) continue;
    active_.push_back(clock.reference);
    std::fill(clock.ticked.begin(), clock.ticked.end(), true);
  }
  for (const Triggered& clock : triggered_) {
    if (triggered && !clock.ticked.empty() && clock.ticked[0]) active_.push_back(clock.reference);
  }
  if (active_.empty()) return;
  ticks_ += active_.size();
  instance.activate_clocks(active_);
  variables_.send_clocked(instance, active_);
  variables_.receive_clocked(instance, active_);
}

void ForeignClocks::observe(ForeignInstance& instance) {
  if (outputs_.empty()) return;
  const std::span<bool> active(output_active_.get(), outputs_.size());
  instance.get_clocks(output_references_, active);
  for (std::size_t i = 0; i < outputs_.size(); ++i) {
    if (!active[i]) continue;
    std::fill(outputs_[i].ticked.begin(), outputs_[i].ticked.end(), true);
    variables_.receive_clocked(instance, {&output_references_[i], 1});
  }
}

void ForeignClocks::schedule(ForeignInstance& instance, double t) {
  for (Timed& clock : timed_) {
    if (clock.active && periodic(clock)) clock.next = clock.origin + static_cast<double>(++clock.count) * clock.interval;
    const bool queries = clock.variability == IntervalVariability::kCountdown ||
                         (clock.variability == IntervalVariability::kChanging && clock.active) ||
                         (clock.variability == IntervalVariability::kTunable && !clock.declared);
    if (queries) {
      if (clock.active && !periodic(clock)) clock.next = kNever;
      query_interval(instance, clock, t, false);
    }
    clock.active = false;
  }
}

void ForeignClocks::write(ByteWriter& out) const {
  for (const Timed& clock : timed_) {
    out.value(clock.interval);
    out.value(clock.origin);
    out.value(clock.count);
    out.value(clock.next);
  }
  out.value(ticks_);
}

void ForeignClocks::read(ByteReader& in) {
  for (Timed& clock : timed_) {
    clock.interval = in.value<double>();
    clock.origin = in.value<double>();
    clock.count = in.value<std::uint64_t>();
    clock.next = in.value<double>();
    clock.active = false;
  }
  ticks_ = in.value<std::uint64_t>();
}

}  // namespace cotwin::fmu
