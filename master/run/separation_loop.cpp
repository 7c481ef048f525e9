#include "master/run/separation_loop.h"

#include <algorithm>
#include <optional>
#include <set>

#include "master/engine/wiring/trace.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

constexpr double kShortStop = 1e-3;  // s

bool is_motion(const Member& member) { return is_unit_of(member.spec, "motion"); }
bool is_recording(const Member& member) { return is_unit_of(member.spec, "io") && !reaches_outside(member); }
/// "left" of "cell.left".
std::string own_name(const Member& member) { return last_part(member.name()); }

/// One monitor.
class Watch {
 public:
  Watch(const Scenario& scenario, std::span<const Member> members, std::span<const ResolvedConnection> links,
        const Trace& trace, std::size_t monitor, SeparationLoop& found)
      : scenario_(scenario), members_(members), links_(links), trace_(trace), monitor_(monitor), found_(found) {}

  void check() {
    for (const Variable& v : variables())
      if (last_part(v.name) == "T_s" && v.role == Role::kTunable) check_robot(prefix_of(v.name));
    for (const Variable& v : variables())
      if (last_part(v.name) == "p" && v.role == Role::kInput) check_body(prefix_of(v.name));
    for (const auto& [name, told] : {std::pair{"T_r", "no reaction time of sensors and control is counted"},
                                     std::pair{"v_h", "a body that stands counts as one that does not start to move"}}) {
      for (const auto& [value, from] : values_of(name))
        if (value == 0) note(full(name) + " is 0" + from + ": " + told);
    }
  }

 private:
  /// A motion that a robot follows.
  struct Mover {
    double ramp = 0;    // s, until its speed is 0
    std::string heard;  // "left.speed ← monitor.speed"
  };

  const Variables& variables() const { return members_[monitor_].variables(); }
  std::string full(const std::string& name) const { return members_[monitor_].name() + "." + name; }
  static std::string robot_of(const std::string& x) { return x.empty() ? "the robot" : x.substr(0, x.size() - 1); }
  std::string text_of(const OneElement& e) const { return members_[e.member].name() + "." + e.variable->name; }

  void warn(const std::string& what) { add(found_.warnings, members_[monitor_].spec.place, what); }
  void note(const std::string& what) { add(found_.notes, members_[monitor_].name(), what); }
  static void add(std::vector<std::string>& list, const std::string& place, const std::string& what) {
    std::string all = place.empty() ? what : place + ": " + what;
    if (std::ranges::find(list, all) == list.end()) list.push_back(std::move(all));
  }

  /// The values of a tunable of the monitor: at the start, and of events, with " from 2 s on".
  std::vector<std::pair<double, std::string>> values_of(const std::string& name) const {
    std::vector<std::pair<double, std::string>> all{{variables().at(name).reals()[0], ""}};
    for (const EventSpec& event : scenario_.events) {
      if (event.variable != full(name) || event.time >= scenario_.stop) continue;
      if (const auto value = text::parse_real(text::trim(event.value)))
        all.emplace_back(*value, " from " + text::to_text(event.time.seconds()) + " s on");
    }
    return all;
  }
  bool has_value(const std::string& name) const {
    const auto is_it = [&](const std::string& s) { return s.substr(0, s.find('[')) == name; };
    const Member& m = members_[monitor_];
    return std::ranges::any_of(m.instance.given, is_it) ||
           std::ranges::any_of(m.spec.start_values, [&](const ParameterValue& v) { return is_it(v.name); }) ||
           std::ranges::any_of(scenario_.events, [&](const EventSpec& e) {
             return e.variable.starts_with(m.name() + ".") && is_it(e.variable.substr(m.name().size() + 1));
           });
  }

  /// Where an element of an input comes from: the output that it is connected to, and the one that this follows.
  struct Way {
    OneElement source, origin;
  };
  /// Those of an input, each pair of variables once.
  std::vector<Way> trace(const Variable& input) const {
    std::vector<Way> ways;
    for (std::size_t i = 0; i < input.size(); ++i) {
      const auto source = trace_.source(input, i);
      if (!source) continue;
      const Way way{*source, trace_.origin(*source)};
      const auto same = [&](const Way& other) {
        return other.source.variable == way.source.variable && other.origin.variable == way.origin.variable;
      };
      if (std::ranges::none_of(ways, same)) ways.push_back(way);
    }
    return ways;
  }
  std::string sources_of(const std::vector<Way>& ways) const {
    std::string names;
    for (const Way& way : ways) text::append(names, text_of(way.source));
    return names;
  }

  void check_robot(const std::string& x) {
    const Variable& q = variables().at(x + "q");
    const std::vector<Way> ways = trace(q);
    check_order(q);
    check_order(variables().at(x + "dq"));
    check_factor(q);
    check_factor(variables().at(x + "dq"));
    check_speeds(x, ways, trace(variables().at(x + "dq")));
    std::string path, heard, beyond, braked;
    std::set<std::size_t> movers;
    bool recorded = !ways.empty();
    for (const Way& way : ways) {
      const Member& end = members_[way.origin.member];
      text::append(path, text_of(way.source));
      if (way.source.variable != way.origin.variable) path += " ← " + text_of(way.origin);
      recorded = recorded && is_recording(end);
      if (is_motion(end)) {
        movers.insert(way.origin.member);
      } else {
        text::append(beyond, end.name());
      }
    }
    const bool exchanged = find_exchanged(x, movers);
    double ramp = 0;
    for (const std::size_t m : movers) {
      const Mover mover = check_mover(x, m, exchanged, beyond);
      if (!mover.heard.empty()) text::append(heard, mover.heard, "; ");
      if (mover.ramp > ramp) braked = members_[m].name();
      ramp = std::max(ramp, mover.ramp);
    }
    const auto all = targets(x);
    if (movers.empty() && all.empty() && !recorded) warn_unheard(x);
    if (movers.empty() && !all.empty()) heard = all.front()->from.name + " → " + all.front()->to.name;
    check_figures(x, ramp, braked);
    std::string text = "separation of " + robot_of(x) + ": " + (path.empty() ? x + "q is connected to nothing" : path);
    if (!heard.empty()) text += "; " + heard;
    if (!beyond.empty()) text += "; not traced beyond " + beyond;
    if (const Variable* base = variables().find(x + "base_p"); base != nullptr && base->role == Role::kInput)
      text += "; what moves its base is not traced";
    text += "; T_s " + text::to_text(variables().at(x + "T_s").reals()[0]) + " s";
    if (ramp > 0) text += ", speed_ramp " + text::to_text(ramp) + " s";
    note(text);
  }

  /// Joints of one robot keep their order, as all units have them.
  void check_order(const Variable& q) {
    for (std::size_t i = 1; i < q.size(); ++i) {
      const auto before = trace_.source(q, i - 1), after = trace_.source(q, i);
      if (before && after && before->variable == after->variable && after->element <= before->element &&
          after->variable->size() == q.size() && is_unit(members_[after->member].spec))
        return warn(element_name(members_[monitor_].name(), q, i) + " comes from " +
                    element_name(members_[after->member].name(), *after->variable, after->element) +
                    ", and the joint before it from " +
                    element_name(members_[before->member].name(), *before->variable, before->element) +
                    ": expected joints in their order");
    }
  }

  /// The units of this program have SI units and the signs of the robot's joints.
  void check_factor(const Variable& input) {
    for (std::size_t i = 0; i < input.size(); ++i) {
      const ResolvedConnection* link = trace_.into(input, i);
      if (link != nullptr && is_unit(members_[link->from.member].spec) && (link->factor != 1 || link->offset != 0))
        return note(full(input.name) + " is " + text::to_text(link->factor) + " times " + link->from.name + " plus " +
                    text::to_text(link->offset));
    }
  }

  /// dq has to come from the robot that q comes from, as far as both are known.
  void check_speeds(const std::string& x, const std::vector<Way>& q, const std::vector<Way>& dq) {
    std::set<std::size_t> of_q, of_dq;
    for (const Way& way : q) of_q.insert(way.origin.member);
    for (const Way& way : dq) of_dq.insert(way.origin.member);
    const auto known = [&](std::size_t m) { return is_motion(members_[m]) || is_recording(members_[m]); };
    if (of_q.empty() || of_dq.empty() || of_q == of_dq || !std::ranges::all_of(of_q, known) ||
        !std::ranges::all_of(of_dq, known))
      return;
    warn(full(x + "dq") + " comes from " + sources_of(dq) + ", but " + full(x + "q") + " from " + sources_of(q) +
         ": expected both of one robot");
  }

  /// Whether the posture is that of another robot: a motion has the name of this one, but that of another robot moves it.
  bool find_exchanged(const std::string& x, const std::set<std::size_t>& movers) {
    const auto is_own = [&](const Member& member) { return is_motion(member) && own_name(member) == robot_of(x); };
    const auto own = std::ranges::find_if(members_, is_own);
    const auto moves_other = [&](std::size_t m) {
      return !is_own(members_[m]) && variables().find(own_name(members_[m]) + ".T_s") != nullptr;
    };
    if (x.empty() || movers.empty() || own == members_.end() || !std::ranges::all_of(movers, moves_other)) return false;
    std::string names;
    for (const std::size_t m : movers) text::append(names, members_[m].name());
    warn(robot_of(x) + " watches what " + names + " moves: expected a connection to " + full(x + "q") + " of what " +
         own->name() + " moves");
    return true;
  }

  /// Where the speed of a robot, or that of all, goes.
  std::vector<const ResolvedConnection*> targets(const std::string& x) const {
    std::vector<const ResolvedConnection*> all;
    for (const std::string& name : {x + "speed", std::string("speed"), x + "zone", std::string("zone")}) {
      for (const ResolvedConnection& link : links_)
        if (link.from.member == monitor_ && link.from.variable->name == name) all.push_back(&link);
    }
    return all;
  }
  std::string wanted(const std::string& x) const { return full(x + "speed") + (x.empty() ? "" : " or " + full("speed")); }

  void warn_unheard(const std::string& x) {
    warn(full(x + "speed") +
         " is connected to nothing, so nobody tells the robot to slow down or to stop: expected a connection to speed of a "
         "motion with override=true");
  }

  /// Checks that the motion hears the speed of robot x.
  Mover check_mover(const std::string& x, std::size_t m, bool exchanged, std::string& beyond) {
    const Variable* speed = members_[m].variables().find("speed");
    if (speed != nullptr && speed->role != Role::kInput) speed = nullptr;
    Mover mover;
    if (speed == nullptr) return warn_wrong(x, m), mover;
    const std::string hears = members_[m].name() + ".speed";
    std::set<const Variable*> seen;
    std::size_t at = m;
    const ResolvedConnection* link = nullptr;
    // One motion may follow the speed of another.
    while (speed != nullptr && seen.insert(speed).second) {
      mover.ramp += members_[at].variables().at("speed_ramp").reals()[0];
      link = trace_.into(*speed);
      if (link != nullptr && (link->from.member == monitor_ || is_motion(members_[link->from.member])) &&
          (link->offset != 0 || link->factor > 1 || !(link->factor > 0)))
        warn(link->to.name + " is " + text::to_text(link->factor) + " times " + link->from.name + " plus " +
             text::to_text(link->offset) + ": expected the share itself, 0 to stop");
      if (link == nullptr || !is_motion(members_[link->from.member]) || link->from.variable->name != "path_speed") break;
      at = link->from.member;
      speed = members_[at].variables().find("speed");
    }
    if (link == nullptr) return warn_wrong(x, m), mover;
    const std::string &from = link->from.variable->name, source = link->from.name;
    if (link->from.member != monitor_) {
      const Member& other = members_[link->from.member];
      // Of a motion path_speed alone follows, which is traced above.
      if (is_motion(other) || (is_unit(other.spec) && !reaches_outside(other) && !trace_.reaches(monitor_, link->from.member)))
        return warn(hears + " comes from " + source + ", which does not hear " + members_[monitor_].name() +
                    ": expected a connection from " + wanted(x)),
               mover;
      text::append(beyond, other.name());
    } else if (last_part(from) == "zone") {
      warn(hears + " comes from " + source + ": a zone is no share of the speed, and 2 (stop) would be full speed: expected " +
           "a connection from " + wanted(x));
    } else if (from != x + "speed" && from != "speed") {
      if (!exchanged)
        warn(hears + " comes from " + source + ": it has to come from " + wanted(x) + ", because " + members_[m].name() +
             " moves " + robot_of(x));
    }
    mover.heard = hears + " ← " + source;
    return mover;
  }

  /// The motion m, which moves robot x, hears nothing: tells where its speed goes instead.
  void warn_wrong(const std::string& x, std::size_t m) {
    const auto all = targets(x);
    const bool deaf = members_[m].variables().find("speed") == nullptr;
    if (all.empty()) return warn_unheard(x);
    const ResolvedConnection& link = *all.front();
    const std::string name = members_[m].name();
    const bool motion = is_motion(members_[link.to.member]), speed = link.to.variable->name == "speed";
    warn(link.from.name + " goes to " + link.to.name +
         (motion && !speed ? ", which does not stop a motion" : ", but " + name + " moves " + robot_of(x)) +
         ": expected a connection from " + wanted(x) + " to " + name + ".speed" +
         (deaf ? " of a motion with override=true" : ""));
  }

  void check_figures(const std::string& x, double ramp, const std::string& motion) {
    for (const auto& [T_s, from] : values_of(x + "T_s")) {
      if (T_s < ramp)
        warn(full(x + "T_s") + " is " + text::to_text(T_s) + " s" + from + ", but " + motion + ".speed_ramp is " +
             text::to_text(ramp) +
             " s: the robot stops later than its separation counts; expected a T_s of at least that, and of the lag of the "
             "drives");
      if (T_s < kShortStop) note(full(x + "T_s") + " is " + text::to_text(T_s) + " s" + from + ": robots take longer to stop");
    }
    for (const auto& [S_s, from] : values_of(x + "S_s"))
      if (S_s == 0)
        warn(full(x + "S_s") + " is 0 m" + from +
             ": no distance is counted for stopping; expected the stopping distance, or -1 " + "for v_r T_s / 2");
  }

  void check_body(const std::string& b) {
    const Variable* velocity = variables().find(b + "v");
    const auto p = trace_.source(variables().at(b + "p"));
    if (velocity == nullptr || !p) return;
    const std::string name = robot_of(b);
    if (variables().find(b + "lost") == nullptr) return note(name + " moves and does not count: it is not in separation");
    const std::string whose = prefix_of(p->variable->name);
    const Variables& beside = members_[p->member].variables();
    if (whose != b && is_body(p->member, whose) && beside.find(b + "p") != nullptr)
      return warn(full(b + "p") + " comes from " + text_of(*p) + ", though " + members_[p->member].name() + " has " + b +
                  "p: expected a connection from there");
    for (const char* part : {"p", "v", "quat", "w"}) {
      const Variable& input = variables().at(b + part);
      const auto source = trace_.source(input);
      check_factor(input);
      for (std::size_t i = 0; i < input.size(); ++i) {
        const auto from = trace_.source(input, i);
        if (!from || of_one(*p, *from)) continue;
        warn((i == 0 ? full(b + part) : element_name(members_[monitor_].name(), input, i)) + " comes from " + text_of(*from) +
             ", but " + full(b + "p") + " from " + text_of(*p) + ": expected both of one body");
        break;
      }
      if (!source && part != std::string("v") && beside.find(whose + part) != nullptr && !has_value(b + part))
        warn(full(b + part) + " (" + input.description + ") is not connected and has no value, though " +
             members_[p->member].name() + " has " + whose + part + ": expected a connection from there");
    }
  }

  /// Whether a prefix of a member means a body: in a contact world, or if it is one of the monitor's.
  bool is_body(std::size_t m, const std::string& prefix) const {
    return is_unit_of(members_[m].spec, "contact_world") || variables().find(prefix + "p") != nullptr;
  }
  /// Not of two bodies of one member, or of two contact worlds.
  bool of_one(const OneElement& a, const OneElement& b) const {
    const std::string of_a = prefix_of(a.variable->name), of_b = prefix_of(b.variable->name);
    if (!is_body(a.member, of_a) || !is_body(b.member, of_b)) return true;
    return a.member == b.member
               ? of_a == of_b
               : !is_unit_of(members_[a.member].spec, "contact_world") || !is_unit_of(members_[b.member].spec, "contact_world");
  }

  const Scenario& scenario_;
  std::span<const Member> members_;
  std::span<const ResolvedConnection> links_;
  const Trace& trace_;
  std::size_t monitor_;
  SeparationLoop& found_;
};

}  // namespace

SeparationLoop trace_separation(const Scenario& scenario, std::span<const Member> members,
                                std::span<const ResolvedConnection> links) {
  SeparationLoop found;
  std::optional<Trace> trace;
  for (std::size_t m = 0; m < members.size(); ++m) {
    if (!is_unit_of(members[m].spec, "monitor") || members[m].variables().find("restart_delay") == nullptr) continue;
    if (!trace) trace.emplace(members, links);
    Watch(scenario, members, links, *trace, m, found).check();
  }
  return found;
}

}  // namespace cotwin::master
