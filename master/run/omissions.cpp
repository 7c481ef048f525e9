#include "master/run/omissions.h"

#include <algorithm>
#include <functional>
#include <map>
#include <set>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "master/engine/wiring/trace.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

std::string seconds(Time t) { return text::to_text(t.seconds()) + " s"; }

bool is_effort(const Variable& v) { return v.kind() == Kind::kReal && (v.si_of(0) == "N.m" || v.si_of(0) == "N"); }

bool alike(const Variable& a, const Variable& b) {
  return a.kind() == Kind::kReal && b.kind() == Kind::kReal && a.size() == b.size() && a.si_of(0) == b.si_of(0);
}

/// The numbers of a text in a uniform notation.
std::string normalised(std::string text) {
  std::replace(text.begin(), text.end(), ',', ' ');
  std::string all;
  for (const std::string_view word : text::split(text, ' ')) {
    if (text::trim(word).empty()) continue;
    const auto number = text::parse_real(text::trim(word));
    text::append(all, number ? text::to_text(*number) : std::string(word), " ");
  }
  return all;
}

std::string text_of(const ParameterValue& value) {
  if (const auto* text = std::get_if<std::string>(&value.value)) return *text;
  if (const auto* real = std::get_if<double>(&value.value)) return text::to_text(*real);
  if (const auto* integer = std::get_if<std::int64_t>(&value.value)) return std::to_string(*integer);
  return std::get<bool>(value.value) ? "true" : "false";
}

bool all_zero(const std::string& numbers) { return numbers.find_first_not_of("0 ") == std::string::npos; }

class Finder {
 public:
  Finder(const Scenario& scenario, std::span<const Member> members, std::span<const ResolvedConnection> links)
      : scenario_(scenario), members_(members), links_(links) {}

  std::vector<std::string> find() {
    collect_ports();
    mark_connected();
    mark_events();
    for (const Port& port : ports_) {
      if (port.essential) find_forgotten(port);
    }
    for (const ResolvedConnection& link : links_) {
      find_derivative(link);
      find_reaction(link);
    }
    find_pushes();
    find_late_events();
    find_idle_tools();
    return std::move(found_);
  }

 private:
  /// An external force or torque on a port, from an event or a start value.
  struct Push {
    Time time;
    std::string element, value;
    Duration ramp;
    bool is_event;
    std::string place;  // of the event
    auto key() const { return std::tie(time.ns, element, value, ramp.ns); }
    friend bool operator<(const Push& a, const Push& b) { return a.key() < b.key(); }
  };
  /// A variable that should have a value.
  struct Port {
    std::size_t member;
    const Variable* variable;
    bool essential, required;
    std::vector<bool> given{};  // element by element
    bool fed = false;           // by a connection
    std::vector<Push> pushes{};
  };

  void collect_ports() {
    for (std::size_t m = 0; m < members_.size(); ++m) {
      const Member& member = members_[m];
      const bool unit = is_unit(member.spec);
      first_port_.push_back(ports_.size());
      Variables as_started;  // with `essential` as the start values decide it
      if (unit) member.instance.unit->declare(as_started);
      for (std::size_t i = 0; i < member.variables().size(); ++i) {
        const Variable& variable = member.variables().all()[i];
        const Variable& started = unit ? as_started.all()[i] : variable;
        const bool essential = started.essential;
        if (!essential && !(unit && variable.role == Role::kInput)) continue;
        index_.emplace(&variable, ports_.size());
        by_name_.emplace(member.name() + "." + variable.name, ports_.size());
        ports_.push_back({m, &variable, essential, started.required});
        ports_.back().given.resize(variable.size());
      }
      if (first_port_.back() == ports_.size()) continue;
      for (const std::string& name : member.instance.given) mark(m, name);
      for (const ParameterValue& value : member.spec.start_values) mark_start(m, value);
    }
    first_port_.push_back(ports_.size());
  }

  Port* port_of(const Variable* variable) {
    const auto found = index_.find(variable);
    return found == index_.end() ? nullptr : &ports_[found->second];
  }

  Port* mark(std::size_t member, const std::string& name) {
    const FoundElement found = find_element(members_[member].variables(), name);
    Port* port = found.variable != nullptr ? port_of(found.variable) : nullptr;
    if (port != nullptr) mark(*port, found.element);
    return port;
  }
  static void mark(Port& port, std::ptrdiff_t element) {
    for (std::size_t i = 0; i < port.given.size(); ++i) {
      if (element < 0 || i == static_cast<std::size_t>(element)) port.given[i] = true;
    }
  }

  void mark_start(std::size_t member, const ParameterValue& value) {
    Port* port = mark(member, value.name);
    const std::string number = normalised(text_of(value));
    if (port != nullptr && is_effort(*port->variable) && !all_zero(number))
      port->pushes.push_back(
          {scenario_.start, value.name.substr(std::min(value.name.size(), value.name.find('['))), number, {}, false, ""});
  }

  void mark_connected() {
    for (const ResolvedConnection& link : links_) {
      if (link.from.member != link.to.member) linked_.insert({link.from.member, link.to.member});
      Port* port = port_of(link.to.variable);
      if (port == nullptr) continue;
      port->fed = true;
      for (std::size_t i = link.to.first; i < link.to.first + link.to.count; ++i) port->given[i] = true;
    }
  }

  void mark_events() {
    for (const EventSpec& event : scenario_.events) {
      const std::size_t bracket = event.variable.back() == ']' ? event.variable.rfind('[') : std::string::npos;
      const std::string name = event.variable.substr(0, bracket);
      const auto found = by_name_.find(name);
      if (found == by_name_.end()) continue;
      Port& port = ports_[found->second];
      const std::string element = event.variable.substr(name.size());
      const auto number = element.size() > 2 ? text::parse_integer(element.substr(1, element.size() - 2)) : std::nullopt;
      // Until the event, a unit acts on the default.
      if (!port.required || event.time <= scenario_.start) mark(port, number ? static_cast<std::ptrdiff_t>(*number - 1) : -1);
      if (is_effort(*port.variable))
        port.pushes.push_back({event.time, element, normalised(event.value), event.ramp, true, event.place});
    }
  }

  void warn(std::size_t member, const std::string& what) { warn_at(members_[member].spec.place, what); }
  void warn_at(const std::string& place, const std::string& what) {
    const std::string all = place.empty() ? what : place + ": " + what;
    if (reported_.insert(all).second) found_.push_back(all);
  }

  std::string name_of(const Port& port) const { return members_[port.member].name() + "." + port.variable->name; }

  void find_forgotten(const Port& port) {
    const Variable& v = *port.variable;
    if (v.kind() == Kind::kString && !v.strings().empty() && !v.strings().front().empty()) return;
    std::string missing;
    std::size_t count = 0;
    for (std::size_t i = 0; i < port.given.size(); ++i) {
      if (port.given[i]) continue;
      text::append(missing, element_name(members_[port.member].name(), v, i));
      ++count;
    }
    if (count == 0) return;
    const std::string what = (count == port.given.size() ? name_of(port) : missing) + " (" + v.description + ")";
    if (port.required) {
      const std::string& place = members_[port.member].spec.place;
      throw Error((place.empty() ? "" : place + ": ") + what + " is not connected and has no value" +
                  ", but the unit would act on it; expected a connection or a value");
    }
    std::string value = v.kind() == Kind::kString ? "it is empty" : "the default is kept";
    if (v.kind() == Kind::kReal) {
      const std::span<double> values = v.reals();
      if (std::all_of(values.begin(), values.end(), [&](double x) { return x == values.front(); }))
        value = "it is " + text::to_text(values.front()) + (v.si.empty() || v.si == "1" ? "" : " " + v.si);
    }
    warn(port.member, what + " is not connected and has no value: " + value + "; expected a connection or a value");
  }

  /// Finds dq_d beside q_d, where the source of q_d has a declared derivative.
  void find_derivative(const ResolvedConnection& link) {
    if (link.derivative.empty() || !is_unit(members_[link.to.member].spec) || link.to.variable->role != Role::kInput) return;
    const std::string& name = link.to.variable->name;
    const Variable* beside = members_[link.to.member].variables().find(prefix_of(name) + "d" + last_part(name));
    const Port* port = beside != nullptr ? port_of(beside) : nullptr;
    if (port == nullptr || beside->role != Role::kInput || beside->size() != link.to.variable->size()) return;
    if (std::find(port->given.begin(), port->given.end(), true) != port->given.end()) return;
    std::string derivative;
    for (const Variable& v : members_[link.from.member].variables()) {
      if (v.derivative_of == link.from.variable->name) derivative = v.name;
    }
    warn(port->member, name_of(*port) + " (" + beside->description + ") is not connected, although " +
                           members_[link.to.member].name() + "." + name + " follows " + link.from.name +
                           ": it is 0; expected a connection from " + members_[link.from.member].name() + "." + derivative +
                           ", or a value");
  }

  /// Finds tau_e of b, where b.q → a.q and a returns tau_e.
  void find_reaction(const ResolvedConnection& link) {
    const Member &a = members_[link.to.member], &b = members_[link.from.member];
    if (!is_unit(b.spec) || link.to.member == link.from.member) return;
    if (last_part(link.from.variable->name) != last_part(link.to.variable->name)) return;  // a sensor: q → q_true
    const std::string returned_prefix = prefix_of(link.to.variable->name), taken_prefix = prefix_of(link.from.variable->name);
    for (std::size_t i = first_port_[link.from.member]; i < first_port_[link.from.member + 1]; ++i) {
      const Port& port = ports_[i];
      const Variable& taken = *port.variable;
      if (taken.role != Role::kInput || port.essential || !is_effort(taken) || prefix_of(taken.name) != taken_prefix) continue;
      if (std::find(port.given.begin(), port.given.end(), true) != port.given.end()) continue;
      const Variable* returned = a.variables().find(returned_prefix + last_part(taken.name));
      if (returned == nullptr || returned->role != Role::kOutput || !alike(taken, *returned)) continue;
      warn(port.member, name_of(port) + " (" + taken.description + ") is not connected, although " + a.name() + "." +
                            returned->name + " returns it: it is 0; expected this connection, or a value");
    }
  }

  /// Finds two connected units that follow the same force or torque over a step and get different values.
  void find_pushes() {
    std::map<std::pair<std::size_t, std::string>, const Port*> efforts;
    for (const Port& port : ports_) {
      const Variable& v = *port.variable;
      const bool followed = v.role == Role::kInput && is_effort(v) && !v.rate.empty();  // without a rate, the unit ignores it
      if (followed && !port.fed) efforts.emplace(std::pair{port.member, v.name}, &port);
    }
    for (const auto& [a, b] : linked_) {
      if (a > b && linked_.contains({b, a})) continue;  // each pair once
      for (auto at = efforts.lower_bound({a, ""}); at != efforts.end() && at->first.first == a; ++at) {
        const auto other = efforts.find({b, at->first.second});
        if (other == efforts.end() || !alike(*at->second->variable, *other->second->variable)) continue;
        compare(*at->second, *other->second);
      }
    }
  }

  void compare(const Port& a, const Port& b) {
    for (const auto& [pushed, other] : {std::pair{&a, &b}, std::pair{&b, &a}}) {
      const std::set<Push> theirs(other->pushes.begin(), other->pushes.end());
      const auto push =
          std::find_if(pushed->pushes.begin(), pushed->pushes.end(), [&](const Push& p) { return !theirs.contains(p); });
      if (push == pushed->pushes.end()) continue;
      const std::string what = push->is_event ? "the event at " + seconds(push->time) : std::string("the start value");
      warn_at(push->is_event && !push->place.empty() ? push->place : members_[pushed->member].spec.place,
              what + " gives " + name_of(*pushed) + push->element + " the value " + push->value + ", but " + name_of(*other) +
                  " of the connected unit does not get it: expected the same for both, because a push acts on both");
      return;
    }
  }

  void find_idle_tools() {
    for (const ToolSpec& tool : scenario_.tools) {
      if (tool.time < scenario_.stop) continue;
      found_.push_back((tool.place.empty() ? "" : tool.place + ": ") + "the event of tool '" + tool.name + "' at " +
                       seconds(tool.time) + " has no effect: expected a time before the end of the run at " +
                       seconds(scenario_.stop));
    }
  }

  void find_late_events() {
    const std::string limits = "a time before the end of the run at " + seconds(scenario_.stop);
    report_events([&](const EventSpec& e) { return e.time >= scenario_.stop; }, "no effect: expected " + limits);
    report_events([&](const EventSpec& e) { return e.time < scenario_.start; },
                  "begun before the run: expected a time from its start at " + seconds(scenario_.start) + " on");
    report_events([&](const EventSpec& e) { return e.time < scenario_.stop && e.time + e.ramp > scenario_.stop; },
                  "a ramp that the end of the run at " + seconds(scenario_.stop) + " cuts off");
  }

  /// One line for all events that are of a kind.
  void report_events(const std::function<bool(const EventSpec&)>& is_one, const std::string& what) {
    const EventSpec* first = nullptr;
    std::size_t count = 0;
    for (const EventSpec& event : scenario_.events) {
      if (!is_one(event)) continue;
      if (first == nullptr) first = &event;
      ++count;
    }
    if (first == nullptr) return;
    warn_at(first->place, "the event at " + seconds(first->time) + " on '" + first->variable + "' " +
                              (count > 1 ? "and " + std::to_string(count - 1) + " more have " : std::string("has ")) + what);
  }

  const Scenario& scenario_;
  std::span<const Member> members_;
  std::span<const ResolvedConnection> links_;
  std::vector<Port> ports_;                                 // by member
  std::vector<std::size_t> first_port_;                     // per member, and the end
  std::unordered_map<const Variable*, std::size_t> index_;  // into ports_; never iterated
  std::unordered_map<std::string, std::size_t> by_name_;    // likewise, "drive.tau_e"
  std::set<std::pair<std::size_t, std::size_t>> linked_;    // members, from and to
  std::set<std::string> reported_;
  std::vector<std::string> found_;
};

}  // namespace

std::vector<std::string> find_omissions(const Scenario& scenario, std::span<const Member> members,
                                        std::span<const ResolvedConnection> links) {
  return Finder(scenario, members, links).find();
}

}  // namespace cotwin::master
