#include "master/engine/tools.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/dynamics.h"

namespace cotwin::master {

namespace {

constexpr std::size_t kParameters = 10;  // of Inertia::parameters()

std::string seconds(Time time) { return text::to_text(time.seconds()) + " s"; }

Eigen::Vector3d vector3(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }
Pose pose(const std::array<double, 3>& xyz, const std::array<double, 3>& rpy) {
  return {rotation_from_rpy(rpy[0], rpy[1], rpy[2]), vector3(xyz)};
}

/// The real variable `prefix`name with `elements` elements (0: any number); nullptr if there is none.
const Variable* find_real(const Variables& variables, const std::string& name, std::size_t elements) {
  const Variable* v = variables.find(name);
  const bool fits = v != nullptr && v->kind() == Kind::kReal && (elements == 0 || v->size() == elements);
  return fits ? v : nullptr;
}

bool is_settable(const Variable& v) { return v.role == Role::kTunable || v.role == Role::kInput; }

bool is_in(const std::string& label, const std::string& scope) { return scope.empty() || label.rfind(scope + ".", 0) == 0; }

bool ends_with(const std::string& name, std::string_view end) {
  return name.size() >= end.size() && name.compare(name.size() - end.size(), end.size(), end) == 0;
}

}  // namespace

robot::Attachment attachment(const ToolSpec& tool) {
  robot::Attachment part{tool.name, tool.parent, pose(tool.xyz, tool.rpy), {tool.mass, vector3(tool.com), {}}};
  const auto& I = tool.inertia;
  part.inertia.I_CC << I[0], I[1], I[2], I[1], I[3], I[4], I[2], I[4], I[5];
  for (const ToolSpec::Frame& frame : tool.frames) part.further.push_back({frame.name, pose(frame.xyz, frame.rpy)});
  return part;
}

int overloaded_joint(const robot::RobotModel& robot, const Eigen::VectorXd& g) {
  int worst = -1;
  double factor = 1;
  for (int i = 0; i < robot.n(); ++i) {
    const double limit = robot.joints[static_cast<std::size_t>(i)].tau_max;
    if (!(std::abs(g[i]) > factor * limit)) continue;
    factor = std::abs(g[i]) / limit;
    worst = i;
  }
  return worst;
}

std::string describe_overload(const robot::RobotModel& robot, const Eigen::VectorXd& g) {
  const int i = overloaded_joint(robot, g);
  if (i < 0) return "";
  const robot::Joint& joint = robot.joints[static_cast<std::size_t>(i)];
  const std::string si = joint.type == robot::JointType::kPrismatic ? " N" : " N.m";
  return "joint '" + joint.name + "' needs " + text::to_text(std::abs(g[i]), 4) + si +
         " against gravity, more than its limit of " + text::to_text(joint.tau_max, 4) + si;
}

/// A robot of a component, with the variables that hold its bodies.
struct Tools::Carrier {
  enum class Kind { kPlant, kController, kEstimator };

  const Member* member = nullptr;
  std::string label;   // "drive", "world.left"
  std::string prefix;  // of its variables: "", "left."
  Kind kind = Kind::kController;
  const Variable* mass = nullptr;  // what tools add, of an estimator
  const Variable* first_moment = nullptr;
  const Variable* inertia = nullptr;
  const Variable* count = nullptr;  // tool_changes, of an estimator restart
  const Variable* q = nullptr;      // of a plant
  std::string obstacle;             // why tools cannot change the bodies
  bool fed = false;                 // by connections
  bool floats = false;              // the base
  std::size_t bodies = 0;
  std::shared_ptr<const robot::RobotModel> model;

  // Of the plan: the robot, and the values of the bodies at the start.
  robot::RobotModel robot;
  std::vector<double> start;
  std::vector<Inertia> start_bodies;
  double count_now = 0;
  struct Part {
    std::string name;
    int body;
    bool known;
    Eigen::Matrix<double, kParameters, 1> pi;
  };
  std::vector<Part> mounted;

  /// Whether the change is on a link. One on the fixed base moves nothing; it is in the history, and shapes come and go with it.
  static bool moves(const robot::Change& change) { return change.body >= 0; }
  double* element(std::size_t body, std::size_t k) const {
    if (k == 0) return &mass->reals()[body];
    if (k < 4) return &first_moment->reals()[3 * body + k - 1];
    return &inertia->reals()[6 * body + k - 4];
  }
  /// Sets the robot to the bodies that the component has now.
  void begin() {
    robot = *model;
    robot.history.clear();
    start.clear();
    mounted.clear();
    count_now = count != nullptr ? count->reals().front() : 0;
    for (std::size_t b = 0; b < bodies; ++b) {
      Eigen::Matrix<double, kParameters, 1> pi;
      for (std::size_t k = 0; k < kParameters; ++k) pi[static_cast<Eigen::Index>(k)] = *element(b, k);
      start.insert(start.end(), pi.data(), pi.data() + kParameters);
      Inertia& body = robot.bodies[b].inertia;
      if (kind != Kind::kEstimator && pi.allFinite() && pi != body.parameters()) body = Inertia::from_parameters(pi);
    }
    start_bodies.clear();
    for (const robot::Body& body : robot.bodies) start_bodies.push_back(body.inertia);
  }
  /// The variable that says whether the tool's collision shapes are there; nullptr if it has none.
  const Variable* shapes_of(const std::string& tool) const {
    return kind == Kind::kPlant ? find_real(member->variables(), prefix + "tool." + text::identifier(tool), 1) : nullptr;
  }
  bool has(const std::string& name) const {
    return std::any_of(mounted.begin(), mounted.end(), [&](const Part& part) { return part.name == name; });
  }
  /// Changes the robot. Throws Error as attach() and detach() do, and for a part on a floating base.
  void change(const ToolSpec& tool) {
    const double time = tool.time.seconds();
    bool known = tool.known;
    if (tool.attach) {
      robot::attach(robot, attachment(tool), tool.reason, time);
      const robot::Change& change = robot.history.back();
      mounted.push_back({tool.name, change.body, tool.known, change.part.parameters()});
      if (change.body < 0 && floats) {
        throw Error(
            "'" + tool.parent +
            "' is on the floating base, whose mass cannot change in a run: expected a robot with the tool from the start "
            "(cotwin tool attach, cotwin tool export)");
      }
    } else {
      robot::detach(robot, tool.name, tool.reason, time);
      const auto part = std::find_if(mounted.begin(), mounted.end(), [&](const Part& p) { return p.name == tool.name; });
      known = part->known;
      mounted.erase(part);
    }
    if (moves(robot.history.back()) && (kind != Kind::kEstimator || !known)) count_now += 1;
  }
  /// The values of the body's variables after the changes.
  Eigen::Matrix<double, kParameters, 1> values(std::size_t body) const {
    Eigen::Matrix<double, kParameters, 1> pi(start.data() + kParameters * body);
    if (kind == Kind::kEstimator) {
      for (const Part& part : mounted) {
        if (part.known && part.body == static_cast<int>(body)) pi += part.pi;
      }
    } else if (!(robot.bodies[body].inertia == start_bodies[body])) {
      pi = robot.bodies[body].inertia.parameters();
    }
    return pi;
  }
};

Tools::Tools(const Scenario& scenario, std::span<const Member> members, std::span<const Signal> fed,
             const Events::Report& report)
    : scenario_(&scenario) {
  if (scenario.tools.empty()) return;
  find_carriers(members, fed);
  find_watchers(members);
  find_models();
  check_events(report);
  choose(report);
  plan();
}

Tools::~Tools() = default;
Tools::Tools(Tools&&) noexcept = default;
Tools& Tools::operator=(Tools&&) noexcept = default;

void Tools::find_carriers(std::span<const Member> members, std::span<const Signal> fed) {
  std::set<const Variable*> fed_variables;
  for (const Signal& signal : fed) fed_variables.insert(signal.variable);
  for (const Member& member : members) {
    const Variables& all = member.variables();
    std::size_t robots = 0;
    for (const Variable& v : all) {
      if (v.kind() != cotwin::Kind::kReal || !ends_with(v.name, "mass") || v.size() == 0) continue;
      std::string prefix = v.name.substr(0, v.name.size() - 4);
      const bool estimates = prefix == "tool_";
      if (!estimates && !prefix.empty() && prefix.back() != '.') continue;
      const Variable* first_moment = find_real(all, prefix + "first_moment", 3 * v.size());
      const Variable* inertia = find_real(all, prefix + "inertia", 6 * v.size());
      if (first_moment == nullptr || inertia == nullptr || v.role == Role::kOutput || v.role == Role::kState) continue;
      auto carrier = std::make_unique<Carrier>();
      Carrier& c = *carrier;
      c.member = &member;
      c.mass = &v;
      c.first_moment = first_moment;
      c.inertia = inertia;
      c.bodies = v.size();
      if (!is_settable(v))
        c.obstacle = "'" + member.name() + "." + v.name + "' is " + with_article(v.role) + ", expected a tunable";
      for (const Variable* one : {c.mass, c.first_moment, c.inertia}) c.fed = c.fed || fed_variables.contains(one);
      if (estimates) prefix.clear();
      c.prefix = prefix;
      c.floats = find_real(all, prefix + "base_v", 3) != nullptr;
      c.label = member.name() + (prefix.empty() ? "" : "." + prefix.substr(0, prefix.size() - 1));
      if (robots < member.instance.robots.size()) c.model = member.instance.robots[robots++];
      c.count = find_real(all, estimates ? "restart" : prefix + "tool_changes", 1);
      if (estimates) {
        c.kind = Carrier::Kind::kEstimator;
      } else if (c.count != nullptr) {
        c.kind = Carrier::Kind::kPlant;
        c.q = find_real(all, prefix + "q", 0);
      }
      carriers_.push_back(std::move(carrier));
    }
  }
}

/// Whoever has the shapes of a tool, and no bodies that it changes, follows it all the same: a monitor.
void Tools::find_watchers(std::span<const Member> members) {
  for (const Member& member : members) {
    const bool carries = std::ranges::any_of(carriers_, [&](const auto& carrier) { return carrier->member == &member; });
    for (const Variable& v : member.variables()) {
      const std::size_t dot = v.name.find("tool.");
      if (carries || v.role != Role::kTunable || v.size() != 1 || dot == std::string::npos) continue;
      const std::string robot = dot > 0 ? v.name.substr(0, dot - 1) : "";
      watchers_.push_back({&v, member.name() + (robot.empty() ? "" : "." + robot), robot, v.name.substr(dot + 5)});
    }
  }
}

/// An FMU without a robot of its own gets that of the units with as many bodies.
void Tools::find_models() {
  for (const auto& carrier : carriers_) {
    Carrier& c = *carrier;
    if (c.model != nullptr && c.model->bodies.size() == c.bodies) continue;
    c.model = nullptr;
    for (const auto& other : carriers_) {
      if (other->model == nullptr || other->model->bodies.size() != c.bodies || other->member->instance.robots.empty())
        continue;
      if (c.model != nullptr && c.model->name != other->model->name) {
        c.model = nullptr;
        break;
      }
      c.model = other->model;
    }
    if (c.model == nullptr && c.obstacle.empty())
      c.obstacle = "no unit of the scenario has the one robot with " + std::to_string(c.bodies) +
                   " bodies from which its frames are known, expected one";
  }
}

/// An event on a variable that tools change would be overwritten by them, or overwrite them.
void Tools::check_events(const Events::Report& report) const {
  for (const EventSpec& event : scenario_->events) {
    const std::string name = event.variable.substr(0, event.variable.find('['));
    for (const auto& c : carriers_) {
      bool same = false;
      for (const Variable* v : {c->mass, c->first_moment, c->inertia, c->count})
        same = same || (v != nullptr && name == c->member->name() + "." + v->name);
      if (!same) continue;
      const Error error(event.place,
                        "event on '" + event.variable +
                            "', which the scenario's attach and detach events change, expected only one of the two");
      if (!report) throw error;
      report(error);
    }
  }
}

/// The carriers that the attributes of the event name.
std::vector<std::size_t> Tools::named(const ToolSpec& tool) const {
  std::vector<std::size_t> found;
  std::vector<std::string> labels;
  for (const auto& c : carriers_) labels.push_back(c->label);
  if (tool.components.empty()) {
    std::set<std::string> robots;
    for (std::size_t i = 0; i < carriers_.size(); ++i) {
      const Carrier& c = *carriers_[i];
      const std::string name = c.model != nullptr ? c.model->name : "";
      const bool matches = tool.robot.empty() || tool.robot == name || tool.robot + "." == c.prefix;
      if (!matches || !is_in(c.label, tool.scope)) continue;
      found.push_back(i);
      robots.insert(name);
    }
    if (tool.robot.empty() && robots.size() > 1) {
      std::string list;
      for (const std::string& robot : robots) list += (list.empty() ? "'" : ", '") + robot + "'";
      fail(tool.place, "tool '" + tool.name + "': the scenario has the robots " + list + ", expected robot or components");
    }
    if (found.empty()) {
      fail(tool.place, "tool '" + tool.name + "': no component has " +
                           (tool.robot.empty() ? "a robot" : "the robot '" + tool.robot + "'") +
                           " with tunable bodies (mass, first_moment, inertia)");
    }
    return found;
  }
  for (const std::string& name : tool.components) {
    const std::size_t before = found.size();
    for (std::size_t i = 0; i < carriers_.size(); ++i) {
      if (carriers_[i]->label == name || carriers_[i]->member->name() == name) found.push_back(i);
    }
    const bool watches = std::ranges::any_of(watchers_, [&](const Watcher& watcher) { return watcher.label == name; });
    if (found.size() == before && !watches)
      fail(tool.place, "tool '" + tool.name + "': no component " + in_quotes(name) +
                           " has tunable bodies (mass, first_moment, inertia)" + suggestion(name, labels));
    if (found.size() > before + 1)
      fail(tool.place, "tool '" + tool.name + "': component " + in_quotes(name) +
                           " has several robots, expected one of them as in '" + carriers_[found[before]]->label + "'");
  }
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  return found;
}

/// Of those, the carriers that the tool changes.
std::vector<std::size_t> Tools::reached(const ToolSpec& tool) const {
  std::vector<std::size_t> result;
  bool simulated = false;
  for (const std::size_t i : named(tool)) {
    const Carrier& c = *carriers_[i];
    if (c.fed) continue;  // follows the connections
    if (!c.obstacle.empty()) fail(tool.place, "tool '" + tool.name + "' cannot reach '" + c.label + "': " + c.obstacle);
    if (!tool.known && c.kind == Carrier::Kind::kController) {
      if (!tool.components.empty())
        fail(tool.place, "tool '" + tool.name + "' with known=\"false\" names '" + c.label +
                             "', which does not simulate the robot (it has no tool_changes), expected only components that do");
      continue;
    }
    simulated = simulated || c.kind == Carrier::Kind::kPlant;
    result.push_back(i);
  }
  if (!tool.known && !simulated)
    fail(tool.place, "tool '" + tool.name + "' with known=\"false\": no component simulates the robot (has tool_changes)");
  if (result.empty())
    fail(tool.place, "tool '" + tool.name + "' reaches no component: connections feed the bodies of all that have the robot");
  return result;
}

/// The carriers from which a tool is to be removed.
std::vector<std::size_t> Tools::carrying(const ToolSpec& tool) const {
  const bool all = tool.components.empty() && tool.robot.empty();
  const std::vector<std::size_t> wanted = all ? std::vector<std::size_t>() : named(tool);
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < carriers_.size(); ++i) {
    const Carrier& c = *carriers_[i];
    if (c.has(tool.name) && is_in(c.label, tool.scope) && (all || std::count(wanted.begin(), wanted.end(), i) > 0))
      found.push_back(i);
  }
  if (found.empty())
    fail(tool.place, "no tool '" + tool.name + "' is attached at " + seconds(tool.time) + ", expected an attach event before");
  return found;
}

/// Finds what each event reaches, by a dry run in the order of time.
void Tools::choose(const Events::Report& report) {
  reached_.assign(scenario_->tools.size(), {});
  begin_all();
  for (std::size_t t = 0; t < reached_.size(); ++t) {
    const ToolSpec& tool = scenario_->tools[t];
    try {
      const std::vector<std::size_t> changed = tool.attach ? reached(tool) : carrying(tool);
      for (const std::size_t i : changed) change(*carriers_[i], t);
      reached_[t] = changed;
    } catch (const Error& error) {
      if (!report) throw;
      report(error);
    }
  }
}

void Tools::change(Carrier& carrier, std::size_t t) const {
  const ToolSpec& tool = scenario_->tools[t];
  try {
    carrier.change(tool);
  } catch (const Error& error) {
    fail(tool.place, std::string(tool.attach ? "attach" : "detach") + " '" + tool.name + "' at " + seconds(tool.time) +
                         " to '" + carrier.label + "': " + error.what());
  }
}

void Tools::begin_all() {
  for (const auto& carrier : carriers_) {
    if (carrier->model != nullptr) carrier->begin();
  }
}

void Tools::plan() {
  jumps_.clear();
  checks_.clear();
  next_check_ = 0;
  begin_all();
  for (std::size_t t = 0; t < reached_.size(); ++t) {
    const Time time = scenario_->tools[t].time;
    for (const std::size_t i : reached_[t]) {
      Carrier& c = *carriers_[i];
      change(c, t);
      const bool moves = Carrier::moves(c.robot.history.back());
      if (moves) {
        const auto body = static_cast<std::size_t>(c.robot.history.back().body);
        const auto values = c.values(body);
        for (std::size_t k = 0; k < kParameters; ++k)
          jumps_.push_back({time, c.element(body, k), values[static_cast<Eigen::Index>(k)]});
        if (c.count != nullptr) jumps_.push_back({time, &c.count->reals().front(), c.count_now});
      }
      const ToolSpec& tool = scenario_->tools[t];
      if (const Variable* shapes = c.shapes_of(tool.name))
        jumps_.push_back({time, &shapes->reals().front(), tool.attach ? 1.0 : 0.0});
      const auto n = static_cast<std::size_t>(c.robot.n());
      if (!moves || c.kind != Carrier::Kind::kPlant || c.q == nullptr || c.q->size() != n) continue;
      checks_.push_back({time, i, t, std::make_unique<robot::Mechanism>(c.robot), nullptr, Eigen::VectorXd::Zero(c.robot.n())});
      checks_.back().data = std::make_unique<robot::Data>(*checks_.back().mechanism);
    }
    const ToolSpec& tool = scenario_->tools[t];
    for (const Watcher& watcher : watchers_) {
      const bool meant = tool.components.empty() ? tool.robot.empty() || watcher.robot.empty() || tool.robot == watcher.robot
                                                 : std::ranges::find(tool.components, watcher.label) != tool.components.end();
      if (meant && watcher.tool == text::identifier(tool.name) && is_in(watcher.label, tool.scope))
        jumps_.push_back({time, &watcher.shapes->reals().front(), tool.attach ? 1.0 : 0.0});
    }
  }
}

void Tools::check_loads_due(Time now) {
  for (; next_check_ < checks_.size() && checks_[next_check_].time <= now; ++next_check_) {
    Check& check = checks_[next_check_];
    const Carrier& c = *carriers_[check.carrier];
    const bool replaced = next_check_ + 1 < checks_.size() && checks_[next_check_ + 1].time <= now &&
                          checks_[next_check_ + 1].carrier == check.carrier;
    if (replaced) continue;
    const std::span<const double> q = c.q->reals();
    robot::gravity(*check.mechanism, *check.data, Eigen::Map<const Eigen::VectorXd>(q.data(), std::ssize(q)), check.gravity);
    check.overloaded = overloaded_joint(*c.model, check.gravity) >= 0;
    check.seconds = now.seconds();
  }
}

std::vector<std::string> Tools::warnings() const {
  std::vector<std::string> all;
  for (const Check& check : checks_) {
    if (!check.overloaded) continue;
    const ToolSpec& tool = scenario_->tools[check.tool];
    const Carrier& c = *carriers_[check.carrier];
    all.push_back((tool.place.empty() ? "" : tool.place + ": ") + "after tool '" + tool.name + "' was " +
                  (tool.attach ? "attached" : "detached") + ", '" + c.label + "' cannot be held in its pose at " +
                  text::to_text(check.seconds) + " s: " + describe_overload(*c.model, check.gravity));
  }
  return all;
}

std::vector<std::string> Tools::notes() const {
  std::vector<std::string> all;
  for (std::size_t t = 0; t < reached_.size(); ++t) {
    const ToolSpec& tool = scenario_->tools[t];
    std::string labels;
    for (const std::size_t i : reached_[t]) text::append(labels, carriers_[i]->label);
    all.push_back("tool '" + tool.name + "' " + (tool.attach ? "attached to '" + tool.parent + "'" : std::string("detached")) +
                  " at " + seconds(tool.time) + " in " + labels);
  }
  return all;
}

std::vector<robot::RobotHistory> Tools::histories(Time end) const {
  std::vector<robot::RobotHistory> all;
  for (const auto& carrier : carriers_) {
    const Carrier& c = *carrier;
    if (c.kind == Carrier::Kind::kEstimator) continue;
    const auto& history = c.robot.history;
    const auto later = std::find_if(history.begin(), history.end(),
                                    [&](const robot::Change& change) { return *change.time >= end.seconds(); });
    if (later == history.begin()) continue;
    const robot::RobotModel robot = robot::before(c.robot, static_cast<std::size_t>(later - history.begin()));
    const auto same =
        std::find_if(all.begin(), all.end(), [&](const robot::RobotHistory& other) { return other.robot == robot; });
    if (same != all.end()) {
      same->components.push_back(c.label);
    } else {
      all.push_back({robot.name, "", {c.label}, robot});
    }
  }
  return all;
}

}  // namespace cotwin::master
