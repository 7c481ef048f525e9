#include "master/run/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

#include "master/engine/coupling/bonds.h"
#include "master/engine/wiring/schedule.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose_values.h"

namespace cotwin::master {

namespace {

constexpr std::size_t kDefaultTallies = 12;  // if the scenario has no report
constexpr int kMaxSegments = 1000;           // of a comparison; each has an RMS in the report

double root_mean(double squares, std::int64_t count) {
  return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

Statistics::Difference Statistics::make_difference(const Signal& a, const Signal* b, std::string name,
                                                   const std::string& place) {
  Difference d{std::move(name), a.name, a.si(), a.reals(), {}, 1, 0, a.name, "", false, a.of_elements()};
  if (b) {
    d.what = a.name + " - " + b->name;
    d.name_of_b = b->name;
    if (a.count != b->count) {
      fail(place, d.what + ": " + std::to_string(a.count) + " elements cannot be compared with " + std::to_string(b->count));
    }
    for (std::size_t i = 0; i < a.count && (i == 0 || a.variable->mixed() || b->variable->mixed()); ++i) {
      const std::string &of_a = a.variable->si_of(a.first + i), &of_b = b->variable->si_of(b->first + i);
      if (of_a.empty() || of_b.empty()) continue;
      const si::Measure to = si::parse(of_a), from = si::parse(of_b);
      if (!si::convertible(from, to)) fail(place, d.what + ": " + of_a + " cannot be compared with " + of_b);
      const si::Conversion conversion = si::conversion(from, to);
      if (i > 0 && (conversion.factor != d.factor || conversion.offset != d.offset))
        fail(place, d.what + ": elements are converted differently, expected a comparison of each");
      d.factor = conversion.factor;
      d.offset = conversion.offset;
    }
    d.b = b->reals();
  }
  if (d.name.empty()) d.name = d.what;
  return d;
}

Statistics::Difference Statistics::make_attitude(const Signal& a, const Signal& b, std::string name, const std::string& place) {
  for (const Signal* s : {&a, &b}) {
    if (s->count != 4)
      fail(place, s->name + " has " + std::to_string(s->count) + " elements, expected a quaternion (w, x, y, z)");
  }
  attitudes_.push_back({a.reals().first<4>(), b.reals().first<4>(), std::make_shared<std::array<double, 3>>()});
  const std::string what = "attitude of " + a.name + " against " + b.name;
  return {name.empty() ? what : std::move(name), what, "rad", *attitudes_.back().turn, {}, 1, 0, a.name, b.name, true};
}

void Statistics::Attitude::update() { Eigen::Map<Eigen::Vector3d>(turn->data()) = turn_between(b, a); }

Statistics::Power Statistics::make_power(const Signal& effort, const Signal& flow, const std::string& place) {
  return {effort.reals(), flow.reals(), power_factor(effort, flow, place), effort.variable->discrete};
}

Statistics::Statistics(const Scenario& scenario, std::span<const Member> members, std::span<const Column> recorded) {
  for (const ReportSpec& spec : scenario.reports) {
    const Signal a = find_real_signal(members, spec.a, spec.place);
    if (spec.kind == ReportKind::kSignal) {
      add_tally(make_difference(a, nullptr, spec.name, spec.place));
      continue;
    }
    const Signal b = find_real_signal(members, spec.b, spec.place);
    if (spec.kind == ReportKind::kDifference) {
      add_tally(make_difference(a, &b, spec.name, spec.place));
    } else if (spec.kind == ReportKind::kAttitude) {
      add_tally(make_attitude(a, b, spec.name, spec.place));
    } else {
      const std::string what = a.name + " * " + b.name;
      works_.emplace_back(spec.name.empty() ? what : spec.name, what, make_power(a, b, spec.place));
    }
  }
  if (scenario.reports.empty()) {
    for (const Column& column : recorded) {
      const Signal& signal = column.signal;
      if (signal.variable->kind() != Kind::kReal || tallies_.size() == kDefaultTallies) continue;
      add_tally(make_difference(signal, nullptr, "", ""));
    }
  }
  for (const ComparisonSpec& spec : scenario.comparisons) {
    const Signal a = find_real_signal(members, spec.a, spec.place), b = find_real_signal(members, spec.b, spec.place);
    const Time from = spec.from.value_or(scenario.start), to = spec.to.value_or(scenario.stop);
    if (spec.segments < 1 || spec.segments > kMaxSegments) {
      fail(spec.place, "comparison '" + spec.name + "': " + std::to_string(spec.segments) + " segments, expected 1 to " +
                           std::to_string(kMaxSegments));
    }
    if (to <= from) {
      fail(spec.place, "comparison '" + spec.name + "' would last from " + text::to_text(from.seconds(), 12) + " s to " +
                           text::to_text(to.seconds(), 12) + " s, expected an end after its beginning");
    }
    comparisons_.push_back({make_difference(a, &b, spec.name, spec.place), from, to, Sums(a.count),
                            std::vector<Sums>(static_cast<std::size_t>(spec.segments), Sums(a.count))});
  }
  more_than_tallies_ = !comparisons_.empty() || !works_.empty();
}

void Statistics::add_tally(Difference difference) {
  for (std::size_t i = 0; i < difference.a.size(); ++i) {
    const double* b = difference.b.empty() ? nullptr : &difference.b[i];
    tallied_.push_back({&difference.a[i], b, difference.factor, difference.offset, {}});
  }
  tallies_.push_back(std::move(difference));
}

/// `difference`: of two signals.
void Statistics::Sums::add(const Difference& difference, Time now) {
  ++count;
  const double *a = difference.a.data(), *b = difference.b.data();
  for (Sum& e : elements) e.add(*a++ - (difference.factor * *b++ + difference.offset), now);
}

std::vector<double> Statistics::Sums::rms() const {
  std::vector<double> all;
  for (const Sum& e : elements) all.push_back(root_mean(e.squares, count));
  return all;
}

Statistics::WorkState::WorkState(std::string name_of, std::string signals, const Power& power)
    : name(std::move(name_of)),
      what(std::move(signals)),
      effort(power.effort),
      flow(power.flow),
      factor(power.factor),
      held(power.held),
      last_effort(power.effort.size()),
      last_flow(power.effort.size()) {}

void Statistics::WorkState::add(double h) {
  for (std::size_t i = 0; i < effort.size(); ++i) {
    const double begin = factor * (held ? effort[i] : last_effort[i]) * last_flow[i], end = factor * effort[i] * flow[i];
    last_effort[i] = effort[i];
    last_flow[i] = flow[i];
    if (begin >= 0 && end >= 0) {
      positive += 0.5 * h * (begin + end);
    } else if (begin <= 0 && end <= 0) {
      negative += 0.5 * h * (begin + end);
    } else {  // the line crosses zero: two triangles
      const double above = std::max(begin, end), below = std::min(begin, end), range = above - below;
      positive += 0.5 * h * above * (above / range);
      negative += 0.5 * h * below * (-below / range);
    }
  }
}

void Statistics::sample_others(Time now) {
  if (!works_.empty()) {
    const double h = started_ ? (now - last_).seconds() : 0;
    started_ = true;
    last_ = now;
    for (WorkState& w : works_) w.add(h);
  }
  for (ComparisonState& c : comparisons_) {
    if (now < c.from || now > c.to) continue;
    const std::int64_t segment = part_at(c.from, c.to, now, static_cast<std::int64_t>(c.segments.size()));
    c.all.add(c.difference, now);
    c.segments[static_cast<std::size_t>(segment)].add(c.difference, now);
  }
}

template <class Self, class Each>
void Statistics::each_number(Self& self, Each each) {
  const auto sum = [&](auto& s) {
    each(s.squares);
    each(s.max);
    each(s.time_of_max.ns);
  };
  const auto sums = [&](auto& s) {
    each(s.count);
    for (auto& e : s.elements) sum(e);
  };
  each(self.samples_);
  each(self.last_.ns);
  for (auto& t : self.tallied_) sum(t.sum);
  for (auto& c : self.comparisons_) {
    sums(c.all);
    for (auto& s : c.segments) sums(s);
  }
  for (auto& w : self.works_) {
    for (auto& effort : w.last_effort) each(effort);
    for (auto& flow : w.last_flow) each(flow);
    each(w.positive);
    each(w.negative);
  }
}

void Statistics::write(ByteWriter& out) const {
  std::uint64_t numbers = 0;
  each_number(*this, [&](const auto&) { ++numbers; });
  out.value(static_cast<std::uint8_t>(started_));
  out.value(numbers);
  each_number(*this, [&](const auto& number) { out.value(number); });
}

void Statistics::read(ByteReader& in, Time start, Time now) {
  std::size_t numbers = 0;
  each_number(*this, [&](const auto&) { ++numbers; });
  started_ = in.value<std::uint8_t>() != 0;
  if (in.count(sizeof(double)) != numbers) in.fail("has the figures of other signals");
  each_number(*this, [&](auto& number) { number = in.value<std::remove_reference_t<decltype(number)>>(); });
  if (started_ && (last_ < start || last_ > now)) in.fail("has figures of an impossible time");
}

std::vector<Tally> Statistics::tallies() const {
  std::vector<Tally> result;
  std::size_t first = 0;
  for (const Difference& d : tallies_) {
    Tally& tally = result.emplace_back(
        Tally{d.name, d.what, d.si, {}, {}, {}, 0, 0, d.name_of_a, d.name_of_b, d.factor, d.offset, d.attitude, d.elements});
    double squares = 0;
    for (const Tallied& t : std::span(tallied_).subspan(first, d.a.size())) {
      tally.rms.push_back(root_mean(t.sum.squares, samples_));
      tally.max.push_back(t.sum.max);
      tally.time_of_max.push_back(t.sum.time_of_max.seconds());
      squares += t.sum.squares;
      tally.total_max = std::max(tally.total_max, t.sum.max);
    }
    tally.total_rms = root_mean(squares, samples_ * static_cast<std::int64_t>(d.a.size()));
    if (!d.elements.si.empty()) tally.total_rms = tally.total_max = std::numeric_limits<double>::quiet_NaN();
    first += d.a.size();
  }
  return result;
}

std::vector<Work> Statistics::works() const {
  std::vector<Work> result;
  for (const WorkState& w : works_) result.push_back({w.name, w.what, "J", w.positive + w.negative, w.positive, w.negative});
  return result;
}

std::vector<Compared> Statistics::comparisons() const {
  std::vector<Compared> result;
  for (const ComparisonState& c : comparisons_) {
    const Difference& d = c.difference;
    Compared& compared = result.emplace_back(Compared{d.name,
                                                      d.what,
                                                      d.si,
                                                      c.from.seconds(),
                                                      c.to.seconds(),
                                                      {},
                                                      {},
                                                      {},
                                                      {},
                                                      d.name_of_a,
                                                      d.name_of_b,
                                                      d.factor,
                                                      d.offset,
                                                      d.elements});
    for (const Sum& e : c.all.elements) {
      compared.max.push_back(e.max);
      compared.time_of_max.push_back(e.time_of_max.seconds());
    }
    compared.rms = c.all.rms();
    for (const Sums& s : c.segments) compared.segment_rms.push_back(s.rms());
  }
  return result;
}

}  // namespace cotwin::master
