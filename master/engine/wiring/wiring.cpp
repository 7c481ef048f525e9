#include "master/engine/wiring/wiring.h"

#include <algorithm>
#include <bit>
#include <map>
#include <optional>
#include <unordered_map>

#include "master/engine/wiring/arrangement.h"

namespace cotwin::master {

namespace {

si::Conversion then(const si::Conversion& first, const si::Conversion& second) {
  return {second.factor * first.factor, second.factor * first.offset + second.offset};
}

/// Resolves many connections, with indexes by name.
class Resolver {
 public:
  Resolver(const Scenario& scenario, std::span<const Member> members) : members_(members), signals_(members) {
    for (const UnitDefinition& unit : scenario.units) units_.emplace(unit.name, &unit);
    derivatives_.resize(members.size());
  }

  ResolvedConnection resolve(const ConnectionSpec& connection);

 private:
  si::Measure measure(const std::string& name) const {
    const auto found = units_.find(name);
    return found != units_.end() ? si::from(*found->second) : si::parse(name);
  }

  /// Conversion between two named measures; identity if one of them is "", unknown.
  si::Conversion convert(const std::string& from, const std::string& to, bool relative, const std::string& place,
                         const std::string& what) const {
    if (from.empty() || to.empty() || from == to) return {};
    const si::Measure a = measure(from), b = measure(to);
    if (!si::convertible(a, b)) fail(place, what + ": " + from + " cannot feed " + to);
    return {si::conversion(a, b).factor, relative ? 0 : si::conversion(a, b).offset};
  }

  /// The variable of the same member that is the time derivative of `signal`, nullptr if there is none.
  const Variable* derivative_of(const Signal& signal) {
    std::optional<ByName>& known = derivatives_[signal.member];
    if (!known) {
      known.emplace();
      for (const Variable& v : members_[signal.member].variables()) {
        if (!v.derivative_of.empty()) known->insert_or_assign(v.derivative_of, &v);
      }
    }
    const auto found = known->find(signal.variable->name);
    return found == known->end() ? nullptr : found->second;
  }

  using ByName = std::unordered_map<std::string_view, const Variable*>;
  std::span<const Member> members_;
  SignalIndex signals_;
  std::unordered_map<std::string_view, const UnitDefinition*> units_;
  std::vector<std::optional<ByName>> derivatives_;  // per member: name → its derivative; filled at the first use
};

const std::string& measure_at(const Port& port, const std::string& si) { return port.unit.empty() ? si : port.unit; }

ResolvedConnection Resolver::resolve(const ConnectionSpec& connection) {
  const std::string from_name = connection.from.component + "." + connection.from.variable;
  const std::string to_name = connection.to.component + "." + connection.to.variable;
  const std::string what = from_name + " -> " + to_name;
  const std::string& place = connection.place;

  ResolvedConnection link{
      signals_.find(from_name, place), signals_.find(to_name, place), 1, 0, false, connection.suppress_unit_conversion, {}};
  const Variable &from = *link.from.variable, &to = *link.to.variable;
  const bool plain = connection.factor == 1 && connection.offset == 0;
  if (plain && from.role == Role::kInput && to.role == Role::kOutput) {
    // The system does not list these connectors as its own: the roles of the components' variables decide the direction.
    ConnectionSpec other = connection;
    std::swap(other.from, other.to);
    return resolve(other);
  }
  if (from.role != Role::kOutput)
    fail(place, what + ": " + from_name + " is " + with_article(from.role) + ", expected an output");
  if (const Variable* slope = derivative_of(link.from))
    link.derivative = slope->reals().subspan(link.from.first, link.from.count);
  link.initial = to.role == Role::kParameter;
  if (to.role != Role::kInput && to.role != Role::kTunable && !link.initial) {
    fail(place, what + ": " + to_name + " is " + with_article(to.role) + ", expected an input or a parameter");
  }
  const bool kinds_fit = from.kind() == to.kind() || (from.kind() == Kind::kInteger && to.kind() == Kind::kReal);
  if (!kinds_fit)
    fail(place, what + ": " + std::string(name_of(from.kind())) + " cannot feed " + std::string(name_of(to.kind())));
  if (link.from.count != link.to.count) {
    fail(place, what + ": " + std::to_string(link.from.count) + " elements cannot feed " + std::to_string(link.to.count));
  }

  if (to.kind() == Kind::kReal) {
    const bool relative = from.relative || to.relative;
    const std::size_t measures = from.mixed() || to.mixed() ? link.from.count : 1;
    for (std::size_t i = 0; i < measures; ++i) {
      const std::string &a = from.si_of(link.from.first + i), &b = to.si_of(link.to.first + i);
      const std::string element = measures == 1 ? what : what + ", element " + std::to_string(i + 1);
      const std::string &from_si = measure_at(connection.from, a), &to_si = measure_at(connection.to, b);
      si::Conversion total = convert(a, from_si, from.relative, place, element);
      if (!connection.suppress_unit_conversion) total = then(total, convert(from_si, to_si, relative, place, element));
      total = then(total, {connection.factor, connection.offset});
      total = then(total, convert(to_si, b, to.relative, place, element));
      if (i > 0 && (total.factor != link.factor || total.offset != link.offset))
        fail(place, element + ": is converted otherwise than those before, expected a connection of its own");
      link.factor = total.factor;
      link.offset = total.offset;
    }
  } else if (connection.factor != 1 || connection.offset != 0) {
    fail(place, what + ": a linear transformation needs reals, the input is " + std::string(name_of(to.kind())));
  }
  return link;
}

template <class T>
void copy_elements(const void* from, void* to, std::uint32_t count) {
  std::copy_n(static_cast<const T*>(from), count, static_cast<T*>(to));
}

template <class T>
bool elements_differ(const void* from, const void* to, std::uint32_t count) {
  return !std::equal(static_cast<const T*>(from), static_cast<const T*>(from) + count, static_cast<const T*>(to));
}

/// Compares bits: a NaN that stays is no change.
bool same_bits(double a, double b) { return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b); }

/// Where a contact world gives a drive train tau_e, the connections of what the robot holds belong to it.
void add_loads(std::vector<ConnectionSpec>& all, std::span<const Member> members) {
  const auto exists = [&](const Port& port) {
    const auto member = std::ranges::find_if(members, [&](const Member& m) { return m.name() == port.component; });
    return member != members.end() && member->variables().find(port.variable) != nullptr;
  };
  constexpr std::string_view kTorque = "tau_e";
  const std::vector<ConnectionSpec> given = all;
  for (const ConnectionSpec& torque : given) {
    if (torque.factor != 1 || !torque.from.variable.ends_with(kTorque) || !torque.to.variable.ends_with(kTorque)) continue;
    for (const char* name : {"load_factor", "load_torque", "load_damping", "takes_loads"}) {
      ConnectionSpec one = torque;
      for (Port* port : {&one.from, &one.to}) {
        port->variable.replace(port->variable.size() - kTorque.size(), kTorque.size(), name);
        port->unit.clear();
      }
      const auto has_end = [&](const ConnectionSpec& c) {
        return (c.to.component == one.to.component && c.to.variable.starts_with(one.to.variable)) ||
               (c.to.component == one.from.component && c.to.variable.starts_with(one.from.variable));
      };
      if (exists(one.from) && exists(one.to) && std::ranges::none_of(given, has_end)) all.push_back(one);
    }
  }
}

using Fed = std::map<std::pair<const Variable*, std::size_t>, std::size_t>;  // element → index of the link that feeds it

/// A value that the user gives for this run would be overwritten by a connection before the first step.
void check_given(const Member& member, const Fed& fed, std::span<const ResolvedConnection> links) {
  for (const ParameterValue& value : member.spec.start_values) {
    const auto [variable, element] = find_element(member.variables(), value.name);
    if (!value.by_user || variable == nullptr) continue;
    for (std::size_t e = 0; e < variable->size(); ++e) {
      const auto link = fed.find({variable, e});
      if (link == fed.end() || (element >= 0 && static_cast<std::size_t>(element) != e)) continue;
      const std::string name = member.name() + "." + value.name;
      throw Error(value.place, name + " is connected to " + links[link->second].from.name +
                                   ", which sets it, expected a variable without a connection");
    }
  }
}

}  // namespace

std::vector<ResolvedConnection> resolve_connections(const Scenario& scenario, std::span<const Member> members,
                                                    const ReportConnectionError& report) {
  Resolver resolver(scenario, members);
  std::vector<ConnectionSpec> connections = scenario.connections;
  add_loads(connections, members);
  std::vector<ResolvedConnection> links;
  links.reserve(connections.size());
  std::vector<const ConnectionSpec*> specs;  // of the links
  Fed fed;
  for (const ConnectionSpec& connection : connections) {
    try {
      ResolvedConnection link = resolver.resolve(connection);
      const Signal& to = link.to;
      for (std::size_t e = to.first; e < to.first + to.count; ++e) {
        const auto [earlier, is_first] = fed.emplace(std::pair{to.variable, e}, links.size());
        if (is_first || earlier->second == links.size()) continue;
        const std::string& place = specs[earlier->second]->place;
        fail(connection.place, link.from.name + " -> " + to.name + ": the input " +
                                   element_name(members[to.member].name(), *to.variable, e) + " is already fed by " +
                                   links[earlier->second].from.name + (place.empty() ? "" : " (" + place + ")"));
      }
      links.push_back(std::move(link));
      specs.push_back(&connection);
    } catch (const Error& error) {
      if (!report) throw;
      report(error);
    }
  }
  for (const Member& member : members) {
    try {
      check_given(member, fed, links);
    } catch (const Error& error) {
      if (!report) throw;
      report(error);
    }
  }
  return links;
}

Wiring::Wiring(const std::vector<ResolvedConnection>& links, const Schedule& schedule, std::span<const std::size_t> group_of) {
  const std::size_t slots = schedule.slots.size();
  std::vector<int> stage_of(slots);
  for (std::size_t s = 0; s < schedule.stages.size(); ++s) {
    for (std::size_t i = schedule.stages[s].first; i < schedule.stages[s].last; ++i) stage_of[i] = schedule.stages[s].exchange;
  }
  std::vector<std::vector<const ResolvedConnection*>> into(slots);
  std::size_t ramped_elements = 0;
  for (const ResolvedConnection& link : links) {
    const std::size_t group = group_of[link.to.member];
    const bool solved = group != kNoGroup && group == group_of[link.from.member] && is_continuous(link);
    if (solved) continue;
    into[schedule.slot_of[link.to.member]].push_back(&link);
    if (!link.initial && !link.to.variable->rate.empty()) ramped_elements += link.to.count;
  }
  targets_.reserve(ramped_elements);  // ramps_ points into it
  for (std::size_t slot = 0; slot < slots; ++slot) {
    begin_.push_back(copies_.size());
    initial_begin_.push_back(initial_copies_.size());
    ramp_begin_.push_back(ramps_.size());
    for (const ResolvedConnection* link : into[slot]) {
      const std::size_t source = schedule.slot_of[link->from.member];
      const bool earlier_stage = stage_of[source] < stage_of[slot];
      const bool slower_source = schedule.slots[source].period > schedule.slots[slot].period;
      add(*link, source, earlier_stage, slower_source);
    }
  }
  begin_.push_back(copies_.size());
  initial_begin_.push_back(initial_copies_.size());
  ramp_begin_.push_back(ramps_.size());
}

void Wiring::add(const ResolvedConnection& link, std::size_t source, bool earlier_stage, bool slower_source) {
  const Variable& to = *link.to.variable;
  if (link.initial) {
    initial_copies_.push_back(make_copy(link));
  } else if (to.rate.empty() || link.from.variable->kind() != Kind::kReal) {
    copies_.push_back(make_copy(link));
  } else {
    const Ramp ramp = link.from.variable->discrete ? Ramp::kHold
                      : earlier_stage              ? Ramp::kInterpolate
                      : slower_source              ? Ramp::kHold
                                                   : Ramp::kExtrapolate;
    const std::size_t at = targets_.size();
    targets_.resize(at + link.to.count);
    ramps_.push_back({ramp, static_cast<std::uint32_t>(link.to.count), source, link.from.reals().data(), link.to.reals().data(),
                      to.rate.data() + link.to.first, targets_.data() + at, link.factor, link.offset,
                      ramp == Ramp::kExtrapolate && !link.derivative.empty() ? link.derivative.data() : nullptr});
  }
}

Wiring::Copy Wiring::make_copy(const ResolvedConnection& link) {
  const Variable &from = *link.from.variable, &to = *link.to.variable;
  const auto source = [&](auto span) { return static_cast<const void*>(span.data() + link.from.first); };
  const auto target = [&](auto span) { return static_cast<void*>(span.data() + link.to.first); };
  const auto copy = [&](Way way, const void* a, void* b) {
    return Copy{way, static_cast<std::uint32_t>(link.to.count), a, b, link.factor, link.offset};
  };
  switch (from.kind()) {
    case Kind::kBoolean:
      return copy(Way::kBoolean, source(from.booleans()), target(to.booleans()));
    case Kind::kString:
      return copy(Way::kString, source(from.strings()), target(to.strings()));
    case Kind::kInteger:
      if (to.kind() == Kind::kReal) return copy(Way::kIntegerToReal, source(from.integers()), target(to.reals()));
      return copy(Way::kInteger, source(from.integers()), target(to.integers()));
    case Kind::kReal:
      break;
  }
  const bool affine = link.factor != 1 || link.offset != 0;
  return copy(affine ? Way::kAffine : link.to.count == 1 ? Way::kReal : Way::kReals, source(from.reals()), target(to.reals()));
}

void Wiring::run_other(const Copy& copy) {
  switch (copy.way) {
    case Way::kReal:
    case Way::kReals:
      copy_elements<double>(copy.from, copy.to, copy.count);
      return;
    case Way::kInteger:
      copy_elements<std::int32_t>(copy.from, copy.to, copy.count);
      return;
    case Way::kBoolean:
      copy_elements<bool>(copy.from, copy.to, copy.count);
      return;
    case Way::kString:
      copy_elements<std::string>(copy.from, copy.to, copy.count);
      return;
    case Way::kAffine: {
      const auto* from = static_cast<const double*>(copy.from);
      auto* to = static_cast<double*>(copy.to);
      for (std::uint32_t i = 0; i < copy.count; ++i) to[i] = copy.factor * from[i] + copy.offset;
      return;
    }
    case Way::kIntegerToReal: {
      const auto* from = static_cast<const std::int32_t*>(copy.from);
      auto* to = static_cast<double*>(copy.to);
      for (std::uint32_t i = 0; i < copy.count; ++i) to[i] = copy.factor * from[i] + copy.offset;
      return;
    }
  }
}

bool Wiring::differs(const Copy& copy) {
  switch (copy.way) {
    case Way::kInteger:
      return elements_differ<std::int32_t>(copy.from, copy.to, copy.count);
    case Way::kBoolean:
      return elements_differ<bool>(copy.from, copy.to, copy.count);
    case Way::kString:
      return elements_differ<std::string>(copy.from, copy.to, copy.count);
    case Way::kReal:
    case Way::kReals:
    case Way::kAffine:
    case Way::kIntegerToReal:
      break;
  }
  for (std::uint32_t i = 0; i < copy.count; ++i) {
    const double from = copy.way == Way::kIntegerToReal ? static_cast<const std::int32_t*>(copy.from)[i]
                                                        : static_cast<const double*>(copy.from)[i];
    const bool plain = copy.way == Way::kReal || copy.way == Way::kReals;
    if (!same_bits(plain ? from : copy.factor * from + copy.offset, static_cast<const double*>(copy.to)[i])) return true;
  }
  return false;
}

void Wiring::begin_ramps(std::span<const ScheduledUnit> slots, std::size_t slot, Time end) {
  const Time begin = slots[slot].time;
  const double h = (end - begin).seconds(), last = slots[slot].last_step.seconds();
  for (std::size_t k = ramp_begin_[slot]; k < ramp_begin_[slot + 1]; ++k) {
    const RampCopy& r = ramps_[k];
    const Time known = slots[r.source].time;  // of the source's value
    const double span = known > begin ? (known - begin).seconds() : r.ramp == Ramp::kExtrapolate ? last : h;
    const double slope = r.ramp == Ramp::kHold || span == 0 ? 0 : 1 / span;
    const bool from_here = r.ramp == Ramp::kInterpolate || (r.ramp == Ramp::kExtrapolate && known > begin);
    const double beyond = known > begin ? (end - known).seconds() : 0;
    for (std::uint32_t i = 0; i < r.count; ++i) {
      const double value = r.factor * r.from[i] + r.offset;
      r.rate[i] = r.derivative != nullptr ? r.factor * r.derivative[i] : (value - r.to[i]) * slope;
      r.target[i] = value;
      if (!from_here) {
        r.to[i] = value;
      } else if (beyond != 0) {
        r.target[i] = value + r.rate[i] * beyond;
        r.rate[i] = (r.target[i] - r.to[i]) / h;
      }
    }
  }
}

void Wiring::end_ramps(std::size_t slot) {
  for (std::size_t k = ramp_begin_[slot]; k < ramp_begin_[slot + 1]; ++k) {
    std::copy_n(ramps_[k].target, ramps_[k].count, ramps_[k].to);
  }
}

bool Wiring::update(const Copy& copy) {
  const bool changed = differs(copy);
  run(copy);
  return changed;
}

bool Wiring::update(std::size_t slot) {
  bool changed = false;
  for (std::size_t i = begin_[slot]; i < begin_[slot + 1]; ++i) changed = update(copies_[i]) || changed;
  for (std::size_t i = initial_begin_[slot]; i < initial_begin_[slot + 1]; ++i) changed = update(initial_copies_[i]) || changed;
  for (std::size_t k = ramp_begin_[slot]; k < ramp_begin_[slot + 1]; ++k) {
    const RampCopy& r = ramps_[k];
    for (std::uint32_t i = 0; i < r.count; ++i) {
      const double value = r.factor * r.from[i] + r.offset;
      changed = changed || !same_bits(value, r.to[i]);
      r.to[i] = value;
      r.rate[i] = 0;
    }
  }
  return changed;
}

}  // namespace cotwin::master
