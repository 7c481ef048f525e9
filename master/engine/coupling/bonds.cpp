#include "master/engine/coupling/bonds.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "models/foundation/support/error.h"

namespace cotwin::master {

bool is_power(const si::Measure& effort, const si::Measure& flow) {
  std::array<int, 8> sum{};
  for (std::size_t i = 0; i < sum.size(); ++i) sum[i] = effort.exponents[i] + flow.exponents[i];
  sum[7] = 0;
  return sum == std::array<int, 8>{1, 2, -3, 0, 0, 0, 0, 0} && effort.offset == 0 && flow.offset == 0;
}

double power_factor(const Signal& effort, const Signal& flow, const std::string& place) {
  if (effort.count != flow.count) {
    fail(place, effort.name + " * " + flow.name + ": " + std::to_string(effort.count) + " elements of effort, " +
                    std::to_string(flow.count) + " of flow");
  }
  double factor = 1;
  const bool mixed = effort.variable->mixed() || flow.variable->mixed();
  for (std::size_t i = 0; i < effort.count && (i == 0 || mixed); ++i) {
    const std::string &of_effort = effort.variable->si_of(effort.first + i), &of_flow = flow.variable->si_of(flow.first + i);
    if (of_effort.empty() || of_flow.empty()) return 1;
    const si::Measure e = si::parse(of_effort), f = si::parse(of_flow);
    if (!is_power(e, f))
      fail(place, effort.name + " * " + flow.name + ": " + of_effort + " times " + of_flow + " is not a power");
    factor = e.factor * f.factor;
  }
  return factor;
}

void Bonds::Quantity::at_begin(double h) {
  std::copy(values.begin(), values.end(), begin.begin());
  if (!input) return;
  for (std::size_t i = 0; i < values.size(); ++i) end[i] = values[i] + (rate.empty() ? 0 : rate[i] * h);
}

void Bonds::Quantity::at_end() {
  if (input) return;
  std::copy(values.begin(), values.end(), end.begin());
  if (held) begin = end;
}

Bonds::Quantity Bonds::quantity(const Signal& signal) {
  const Variable& v = *signal.variable;
  Quantity q;
  q.values = signal.reals();
  q.input = v.role != Role::kOutput && v.role != Role::kState;
  if (!v.rate.empty()) q.rate = v.rate.subspan(signal.first, signal.count);
  q.held = v.discrete;
  q.begin.resize(signal.count);
  q.end.resize(signal.count);
  return q;
}

std::size_t Bonds::add_side(const std::string& effort, const std::string& flow, std::span<const Member> members,
                            const std::string& place) {
  const Signal e = find_real_signal(members, effort, place), f = find_real_signal(members, flow, place);
  sides_.push_back({quantity(e), quantity(f), power_factor(e, f, place), nullptr,
                    e.member == f.member && !members[e.member].instance.unit->restorable()});
  const std::size_t side = sides_.size() - 1;
  (e.member == f.member ? of_member_[e.member] : of_two_members_).push_back(side);
  return side;
}

Bonds::Bonds(const Scenario& scenario, std::span<const Member> members) : of_member_(members.size()) {
  for (const BondSpec& spec : scenario.bonds) {
    const std::size_t a = add_side(spec.effort_a, spec.flow_a, members, spec.place);
    const std::size_t b = add_side(spec.effort_b, spec.flow_b, members, spec.place);
    const auto makes_every_step = [&](const std::string& name) {
      const Member& member = members[find_real_signal(members, name, spec.place).member];
      return member.spec.period == 1 && member.instance.unit->restorable();
    };
    const bool controlled = makes_every_step(spec.effort_a) && makes_every_step(spec.flow_a) &&
                            makes_every_step(spec.effort_b) && makes_every_step(spec.flow_b);
    bonds_.push_back({spec.name, a, b, spec.tolerance, spec.reference, controlled});
  }
  numbers_.resize(kNumbers * sides_.size());
  for (std::size_t s = 0; s < sides_.size(); ++s) sides_[s].sums = &numbers_[kNumbers * s];
}

namespace {

double product(std::span<const double> a, std::span<const double> b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

}  // namespace

void Bonds::start() {
  std::fill(numbers_.begin(), numbers_.end(), 0);
  for (const std::size_t s : of_two_members_) {
    Side& side = sides_[s];
    side.sums[kLastPower] = side.factor * product(side.effort.values, side.flow.values);
  }
}

void Bonds::begin(std::size_t member, Duration h) {
  for (const std::size_t s : of_member_[member]) {
    sides_[s].effort.at_begin(h.seconds());
    sides_[s].flow.at_begin(h.seconds());
  }
}

void Bonds::end(std::size_t member, Duration h) {
  for (const std::size_t s : of_member_[member]) {
    Side& side = sides_[s];
    side.effort.at_end();
    side.flow.at_end();
    const double at_begin = product(side.effort.begin, side.flow.begin), at_end = product(side.effort.end, side.flow.end);
    side.sums[kWork] += 0.5 * h.seconds() * side.factor * (at_begin + at_end);
    side.sums[kThroughput] += 0.5 * h.seconds() * std::abs(side.factor) * (std::abs(at_begin) + std::abs(at_end));
  }
}

void Bonds::end_part(Duration h) {
  for (const std::size_t s : of_two_members_) {
    Side& side = sides_[s];
    const double power = side.factor * product(side.effort.values, side.flow.values), last = side.sums[kLastPower];
    side.sums[kWork] += 0.5 * h.seconds() * (last + power);
    side.sums[kThroughput] += 0.5 * h.seconds() * (std::abs(last) + std::abs(power));
    side.sums[kLastPower] = power;
  }
}

double Bonds::leak(std::size_t bond, std::span<const double> numbers) const {
  return numbers[kNumbers * bonds_[bond].a + kWork] - numbers[kNumbers * bonds_[bond].b + kWork];
}

void Bonds::restore(std::span<const double> state) {
  for (const Side& side : sides_) {
    const std::ptrdiff_t first = side.sums - numbers_.data();
    if (!side.kept) std::copy_n(state.begin() + first, std::size_t{kNumbers}, side.sums);
  }
}

double Bonds::error(std::span<const double> before, double tolerance) const {
  double worst = 0;
  for (std::size_t i = 0; i < bonds_.size(); ++i) {
    if (!bonds_[i].controlled) continue;
    const double passed = sides_[bonds_[i].a].sums[kThroughput];
    const double change = std::abs(leak(i, numbers_) - leak(i, before));
    if (change > 0) worst = std::max(worst, change / (tolerance * (bonds_[i].reference + passed)));
  }
  return worst;
}

std::vector<Bonded> Bonds::results() const {
  std::vector<Bonded> results;
  for (std::size_t i = 0; i < bonds_.size(); ++i) {
    const Bond& bond = bonds_[i];
    const double a = sides_[bond.a].sums[kWork], b = sides_[bond.b].sums[kWork];
    const double passed = sides_[bond.a].sums[kThroughput];
    results.push_back({bond.name, a, b, a - b, bond.tolerance, passed, passed > 0 ? std::abs(a - b) / passed : 0});
  }
  return results;
}

}  // namespace cotwin::master
