#include "master/scenery/scenery.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <string_view>
#include <utility>

#include "components/unit/settings.h"
#include "master/engine/tools.h"
#include "master/engine/wiring/members.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/start.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

/// Variables with joint positions, those that show best where a robot was first.
constexpr std::array<std::string_view, 4> kPositions = {"q", "q_link", "q_c", "q_d"};
constexpr std::array<std::string_view, 3> kDesired = {"q_d", "dq_d", "ddq_d"};

/// A component, or one of the robots of a contact world.
struct Node {
  std::string component, prefix;  // "world", "world.left."
  std::string robot, of;          // "left", "left."; "" for a single robot
  std::size_t model = 0;
  /// Who says where its base is, in the order in which they count.
  enum class Place { kWorld, kItself, kMonitor, kScanner, kNowhere } place = Place::kNowhere;
  bool floats = false;
};

bool without_element(std::string_view variable, std::string_view name) {
  return variable == name || (variable.starts_with(name) && variable.size() > name.size() && variable[name.size()] == '[');
}

/// `name`: the variable of the signal, of kPositions.
void add_track(StagedRobot& robot, std::string_view name, const std::string& signal) {
  using Role = StagedTrack::Role;
  const Role role = robot.tracks.empty() ? Role::kMain
                    : name == "q_d"      ? Role::kDesired
                    : name == "q_c"      ? Role::kCompliant
                                         : Role::kOther;
  robot.tracks.push_back({role, signal, {}});
}

/// Disjoint sets of nodes.
class Groups {
 public:
  explicit Groups(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), std::size_t{0}); }
  std::size_t find(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::size_t a, std::size_t b) { parent_[std::max(find(a), find(b))] = std::min(find(a), find(b)); }

 private:
  std::vector<std::size_t> parent_;
};

class Builder {
 public:
  Builder(const Scenario& scenario, const Recorded& recorded, std::span<const UnitType> types,
          const std::vector<fs::path>& folders, const StartValues& values, const std::shared_ptr<FileStore>& models)
      : scenario_(scenario),
        recorded_(recorded),
        types_(types),
        folders_(folders),
        values_(values ? values : values_of_texts(scenario)),
        strict_(values != nullptr),
        models_(models) {}

  Scenery build();

 private:
  void take(const ComponentSpec& component);
  /// Whether it is a unit:monitor or unit:scanner, which move nothing.
  bool only_watches(const ComponentSpec& component) const {
    return has_setting(component.source, "ignore", types_) || has_setting(component.source, "beams", types_);
  }
  void add_cell(const ComponentSpec& component, Settings& settings, bool floats);
  void add_bodies(const ComponentSpec& component, const scene::Scene& scene, const fs::path& file,
                  const std::string& obstacles);
  std::size_t add_model(robot::RobotModel model, const fs::path& urdf);
  /// The node that has the variable, or nodes_.size().
  std::size_t node_of(const Port& port, std::string_view* variable) const;
  void group();
  void make_ghosts();
  void add_tracks(StagedRobot& robot, const std::vector<std::size_t>& members, const std::vector<std::size_t>& desired) const;
  /// Whether two nodes have robots with the same joints. They may differ in masses, as a robot and its twin.
  bool is_same_robot(std::size_t a, std::size_t b) const;
  bool recorded_positions(const std::string& signal, std::size_t model) const;
  /// Whether the positions come from another recorded signal by a connection.
  bool is_copy(const Node& node) const;
  void place(StagedRobot& robot, const Node& node);
  void add_tools(StagedRobot& robot, const std::vector<std::size_t>& members);
  /// Whether positions of another number of joints were recorded; then with a remark.
  bool tell_of_other_joints(const StagedRobot& robot);

  const Scenario& scenario_;
  const Recorded& recorded_;
  const std::span<const UnitType> types_;
  const std::vector<fs::path>& folders_;
  const StartValues values_;
  const bool strict_;
  const std::shared_ptr<FileStore>& models_;
  std::vector<Node> nodes_;
  Scenery stage_;
};

std::size_t Builder::add_model(robot::RobotModel model, const fs::path& urdf) {
  for (std::size_t i = 0; i < stage_.models.size(); ++i) {
    if (stage_.models[i].urdf == urdf && *stage_.models[i].model == model) return i;
  }
  stage_.models.push_back({std::make_shared<const robot::RobotModel>(std::move(model)), urdf});
  return stage_.models.size() - 1;
}

void Builder::add_cell(const ComponentSpec& component, Settings& settings, bool floats) {
  const scene::Cell cell = settings.cell();
  const bool monitors = has_setting(component.source, "ignore", types_), watches = only_watches(component);
  const Node::Place place = !watches ? Node::Place::kWorld : monitors ? Node::Place::kMonitor : Node::Place::kScanner;
  if (!watches) stage_.worlds.push_back(component.name);
  stage_.cells.push_back({component.name, monitors ? settings.text("ignore") : "", settings.cell_used()});
  const std::vector<fs::path> files = settings.robot_files();
  for (std::size_t i = 0; i < cell.robots.size(); ++i) {
    const scene::PlacedRobot& placed = cell.robots[i];
    const std::string of = placed.name.empty() ? "" : text::identifier(placed.name) + ".";
    const std::string prefix = component.name + "." + of;
    nodes_.push_back({component.name, prefix, placed.name, of,
                      add_model(placed.model, i < files.size() ? files[i] : fs::path()), place, floats});
    if (monitors) stage_.monitors.push_back(prefix);
  }
  if (watches && !monitors) stage_.scanners.push_back(component.name + ".");
  if (const std::string cloud = monitors ? settings.text("cloud") : ""; !cloud.empty()) {
    stage_.clouds.push_back({.points = nullptr,
                             .radius = largest_value(scenario_, values_, component.name, "cloud.r"),
                             .X_WC = start_pose(values_, component.name, "cloud.", {}).X_W,
                             .file = fs::weakly_canonical(settings.file(cloud)),
                             .by = component.name});
    const collision::PlacedCell::Cloud& made = stage_.clouds.back();
    stage_.differing.add(made.file.filename().string(), made.file.string(), made.X_WC,
                         " with balls of " + text::to_text(made.radius) + " m by " + made.by, made.radius);
  }
  if (!cell.scene.bodies.empty())
    add_bodies(component, cell.scene, fs::weakly_canonical(settings.scene_file()), monitors ? settings.text("obstacles") : "");
}

void Builder::add_bodies(const ComponentSpec& component, const scene::Scene& scene, const fs::path& file,
                         const std::string& obstacles) {
  std::vector<std::string_view> comes = text::split(obstacles, ',');
  for (std::string_view& name : comes) name = text::trim(name);
  for (const scene::Body& body : scene.bodies) {
    const std::string id = text::identifier(body.name);
    StagedBody made{{.body = body, .file = file}, component.name, component.name + "." + id};
    made.comes = std::ranges::find(comes, body.name) != comes.end();
    const StartPose start = start_pose(values_, component.name, id + ".", body.X_WB);
    made.body.X_WB = start.X_W;
    made.by = differ(start.X_W, body.X_WB) ? component.name : file.filename().string();
    made.present = start_value(values_, component.name, id + ".present", 1) != 0;
    made.scale = start_value(values_, component.name, id + ".scale", 1);
    const std::string of = !made.present ? ", not there" : made.scale != 1 ? ", scaled by " + text::to_text(made.scale) : "";
    if (!start.fed)
      stage_.differing.add(body.name, file.string() + "\n" + body.name, start.X_W,
                           of + (made.by == component.name ? " by " + made.by : " in " + made.by + " of " + component.name),
                           made.present ? made.scale : 0);
    for (const ConnectionSpec& connection : scenario_.connections)
      if (start.fed && connection.to.component == component.name && without_element(connection.to.variable, id + ".p"))
        made.fed_by = connection.from.component + "." + connection.from.variable.substr(0, connection.from.variable.rfind('.'));
    made.moves = made.comes || body.motion != scene::Motion::kStatic;
    made.appears =
        std::ranges::find(scenario_.events, made.prefix + ".present", &EventSpec::variable) != scenario_.events.end();
    // Monitors and scanners watch bodies of others; obstacles are where their monitor has them.
    const auto known = std::ranges::find_if(stage_.bodies, [&](const StagedBody& other) {
      return other.shown && other.file == file && other.body.name == body.name;
    });
    if (known != stage_.bodies.end()) {
      made.shown = !known->comes && (made.comes || !only_watches(component));
      known->shown = !(made.shown && made.comes);
    }
    stage_.bodies.push_back(std::move(made));
  }
}

void Builder::take(const ComponentSpec& component) {
  if (!is_unit(component)) return;
  const UnitSource source = parse_unit_source(component.source);
  const UnitType& type = find_type(source.unit, types_);
  const bool has_cell = has_setting(component.source, "scene", types_) && has_setting(component.source, "robots", types_);
  if (!has_cell && !has_setting(component.source, "robot", types_)) return;
  Settings settings(source.unit, source.query, settings_for(scenario_, component.name), folders_, models_);
  settings.declare(settings_of(type));
  const bool floats = has_setting(component.source, "base", types_) && settings.choice("base") == "floating";
  if (has_cell) {
    add_cell(component, settings, floats);
    return;
  }
  if (const std::string name = settings.given("robot").value_or(""); name.empty() || name == "none") return;
  robot::RobotModel model = settings.robot(Settings::Masses::kUnused);
  const fs::path urdf = settings.robot_files().empty() ? fs::path() : settings.robot_files().front();
  const std::string prefix = component.name + ".";
  const bool is_recorded = recorded_.find(prefix + "base_p") != nullptr && recorded_.find(prefix + "base_quat") != nullptr;
  const bool placed = is_recorded || (floats && !values_(component.name, "base_p0", {}).empty());
  nodes_.push_back({component.name, prefix, "", "", add_model(std::move(model), urdf),
                    placed ? Node::Place::kItself : Node::Place::kNowhere, floats});
}

std::size_t Builder::node_of(const Port& port, std::string_view* variable) const {
  std::size_t best = nodes_.size();
  const std::string whole = port.component + "." + port.variable;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if (nodes_[i].component != port.component || !whole.starts_with(nodes_[i].prefix)) continue;
    if (best == nodes_.size() || nodes_[i].prefix.size() > nodes_[best].prefix.size()) best = i;
  }
  if (best < nodes_.size())
    *variable = std::string_view(port.variable).substr(nodes_[best].prefix.size() - port.component.size() - 1);
  return best;
}

bool Builder::is_same_robot(std::size_t a, std::size_t b) const {
  if (nodes_[a].model == nodes_[b].model) return true;
  const auto name = [](const robot::Joint& joint) { return joint.name; };
  return std::ranges::equal(stage_.models[nodes_[a].model].model->joints, stage_.models[nodes_[b].model].model->joints, {},
                            name, name);
}

bool Builder::recorded_positions(const std::string& signal, std::size_t model) const {
  const RecordedSignal* found = recorded_.find(signal);
  return found != nullptr && found->count == static_cast<std::size_t>(stage_.models[model].model->n());
}

bool Builder::is_copy(const Node& node) const {
  for (const ConnectionSpec& connection : scenario_.connections) {
    std::string_view to, from;
    const std::size_t target = node_of(connection.to, &to);
    if (target == nodes_.size() || &nodes_[target] != &node || !without_element(to, "q")) continue;
    const std::size_t source = node_of(connection.from, &from);
    if (source == nodes_.size() || source == target) continue;
    for (const std::string_view name : {"q", "q_link"}) {
      if (without_element(from, name) && recorded_positions(nodes_[source].prefix + std::string(name), node.model)) return true;
    }
  }
  return false;
}

void Builder::add_tracks(StagedRobot& robot, const std::vector<std::size_t>& members,
                         const std::vector<std::size_t>& desired) const {
  const auto is_known = [&](const std::string& signal) {
    return std::ranges::any_of(robot.tracks, [&](const StagedTrack& track) { return track.signal == signal; });
  };
  for (const std::string_view name : kPositions) {
    const bool measured = name == "q" || name == "q_link";
    std::vector<std::size_t> from = members;
    if (name == "q_d") from.insert(from.end(), desired.begin(), desired.end());
    for (const std::size_t i : from) {
      const std::string signal = nodes_[i].prefix + std::string(name);
      if (!recorded_positions(signal, robot.model) || is_known(signal)) continue;
      if (measured && is_copy(nodes_[i])) continue;
      add_track(robot, name, signal);
    }
  }
}

/// The first one that knows counts.
void Builder::place(StagedRobot& robot, const Node& node) {
  const StartPose start = start_pose(values_, node.component, node.of + "base_", {});
  const std::string by = node.prefix.substr(0, node.prefix.size() - 1);
  if (!start.fed) stage_.differing.add("the base of " + robot.name, "robot " + robot.name, start.X_W, " by " + by);
  if (!robot.by.empty() && (!robot.fed || start.fed)) return;
  if (robot.by.empty()) robot.base = {{}, node.prefix + "base_p", node.prefix + "base_quat"};
  robot.by = by;
  robot.fed = start.fed;
  robot.base.X_WB = start.X_W;
}

/// An event of a tool without `components` and `robot` means all robots that it can be mounted on.
void Builder::add_tools(StagedRobot& robot, const std::vector<std::size_t>& members) {
  robot::RobotModel carrier = *stage_.models[robot.model].model;
  const auto is_meant = [&](const ToolSpec& tool, const Node& node) {
    const std::string label = node.prefix.substr(0, node.prefix.size() - 1);
    return (tool.scope.empty() || label.starts_with(tool.scope + ".")) &&
           (tool.robot.empty() || tool.robot == node.robot || tool.robot == carrier.name) &&
           (tool.components.empty() || std::ranges::any_of(tool.components, [&](const std::string& name) {
              return name == label || name == node.component;
            }));
  };
  for (const ToolSpec& tool : scenario_.tools) {
    if (std::ranges::none_of(members, [&](std::size_t i) { return is_meant(tool, nodes_[i]); })) continue;
    try {
      const double time = tool.time.seconds();
      if (!tool.attach) {
        robot::detach(carrier, tool.name, "", time);
        for (StagedTool& mounted : robot.tools) {
          if (mounted.name == tool.name && !mounted.until) mounted.until = time;
        }
        continue;
      }
      const robot::Attachment part = attachment(tool);
      robot::attach(carrier, part, "", time);
      const robot::Frame& frame = carrier.frame(tool.name);
      robot.tools.push_back({tool.name, frame.body, frame.X_BF, part.inertia, time, {}, tool.shapes});
    } catch (const Error& error) {
      stage_.remarks.push_back("tool '" + tool.name + "' is not shown on robot " + robot.name + ": " + error.what());
    }
  }
}

bool Builder::tell_of_other_joints(const StagedRobot& robot) {
  const auto n = static_cast<std::size_t>(stage_.models[robot.model].model->n());
  for (const std::string_view name : kPositions) {
    for (const std::string& prefix : robot.prefixes) {
      const RecordedSignal* found = recorded_.find(prefix + std::string(name));
      if (found == nullptr || found->count == n) continue;
      stage_.remarks.push_back("robot of " + robot.name + ": " + std::to_string(found->count) + " elements of " + found->name +
                               " are recorded, the robot has " + std::to_string(n) +
                               " joints now, so it stands still; has its URDF changed since the run? Otherwise record " +
                               found->name);
      return true;
    }
  }
  return false;
}

void Builder::group() {
  Groups groups(nodes_.size());
  std::vector<std::pair<std::size_t, std::size_t>> desired;  // source of a desired motion, and who follows it
  for (const ConnectionSpec& connection : scenario_.connections) {
    std::string_view from, to;
    const std::size_t a = node_of(connection.from, &from), b = node_of(connection.to, &to);
    if (a == nodes_.size() || b == nodes_.size() || a == b || !is_same_robot(a, b)) continue;
    const bool is_desired = std::ranges::any_of(kDesired, [&](std::string_view name) { return without_element(from, name); });
    if (is_desired) {
      desired.emplace_back(a, b);
    } else {
      groups.join(a, b);
    }
  }
  std::map<std::size_t, std::vector<std::size_t>> members;
  for (std::size_t i = 0; i < nodes_.size(); ++i) members[groups.find(i)].push_back(i);
  for (const auto& [root, of_group] : members) {
    std::vector<std::size_t> sources;
    bool is_source = false;
    for (const auto& [source, follower] : desired) {
      if (groups.find(follower) == root && groups.find(source) != root) sources.push_back(source);
      is_source = is_source || (groups.find(source) == root && groups.find(follower) != root);
    }
    if (is_source && of_group.size() == 1 && nodes_[of_group.front()].place != Node::Place::kWorld)
      continue;  // shown with those that follow it
    StagedRobot robot;
    robot.model = nodes_[root].model;
    robot.name = nodes_[root].component + (nodes_[root].robot.empty() ? "" : "." + nodes_[root].robot);
    for (const std::size_t i : of_group) {
      robot.prefixes.push_back(nodes_[i].prefix);
      robot.components.push_back(nodes_[i].component);
      robot.floats = robot.floats || nodes_[i].floats;
    }
    using Place = Node::Place;
    for (const Place place_by : {Place::kWorld, Place::kItself, Place::kMonitor, Place::kScanner})
      for (const std::size_t i : of_group)
        if (nodes_[i].place == place_by) place(robot, nodes_[i]);
    add_tracks(robot, of_group, sources);
    if (!robot.tracks.empty()) robot.name = robot.tracks.front().signal.substr(0, robot.tracks.front().signal.rfind('.'));
    for (const std::size_t i : of_group) {
      const bool leads = !robot.tracks.empty() && robot.tracks.front().signal.starts_with(nodes_[i].prefix);
      if (nodes_[i].place == Place::kWorld || (leads && robot.by.empty())) robot.model = nodes_[i].model;
    }
    const auto n = static_cast<std::size_t>(stage_.models[robot.model].model->n());
    for (const std::size_t i : of_group) {
      const auto ask = [&](const char* name, std::vector<double> otherwise) {
        return values_(nodes_[i].component, nodes_[i].of + name, std::move(otherwise));
      };
      std::vector<double> q0 = ask("q0", ask("q", {}));
      if (q0.size() == n && robot.q0.empty()) robot.q0 = std::move(q0);
    }
    for (std::size_t j = robot.q0.size(); j < n; ++j)
      robot.q0.push_back(robot::default_start(stage_.models[robot.model].model->joints[j]));
    add_tools(robot, of_group);
    if (robot.tracks.empty() && tell_of_other_joints(robot)) {
      stage_.robots.push_back(std::move(robot));
      continue;
    }
    if (robot.tracks.empty() && robot.by.empty() && of_group.size() == 1)
      continue;  // only names and limits of the robot are used
    if (robot.tracks.empty()) {
      std::string wanted;
      for (const std::string& prefix : robot.prefixes) wanted += (wanted.empty() ? "" : " or ") + prefix + "q";
      stage_.remarks.push_back("robot of " + robot.name + ": no joint positions are recorded, so it stands still; record " +
                               wanted);
    }
    stage_.robots.push_back(std::move(robot));
  }
}

/// A robot that starts where one of an earlier contact world does, with the same joints, is shown as its ghost with its own base; so are the bodies
/// around it.
void Builder::make_ghosts() {
  const auto world_of = [&](const StagedRobot& robot) {
    const auto found = std::ranges::find_first_of(stage_.worlds, robot.components);
    return found == stage_.worlds.end() ? std::string() : *found;
  };
  const auto names = [&](const StagedRobot& robot) {
    std::vector<std::string> all;
    for (const robot::Joint& joint : stage_.models[robot.model].model->joints) all.push_back(joint.name);
    return all;
  };
  std::vector<StagedRobot> shown;
  for (StagedRobot& robot : stage_.robots) {
    const std::string world = world_of(robot);
    const auto same = std::ranges::find_if(shown, [&](const StagedRobot& other) {
      return !world.empty() && !robot.tracks.empty() && world_of(other) != "" && world_of(other) != world &&
             other.base.X_WB == robot.base.X_WB && names(other) == names(robot);
    });
    if (same == shown.end()) {
      shown.push_back(std::move(robot));
    } else {
      same->tracks.push_back({StagedTrack::Role::kOther, robot.tracks.front().signal, robot.base});
      stage_.ghosts.insert(world);
    }
  }
  stage_.robots = std::move(shown);
  for (const StagedRobot& robot : stage_.robots) stage_.ghosts.erase(world_of(robot));
}

/// Robots without a place stand one beside the other, unless there is a contact world.
void spread(Scenery& stage) {
  double y = 0;
  std::size_t count = 0;
  if (std::ranges::any_of(stage.robots, [](const StagedRobot& robot) { return !robot.by.empty(); })) return;
  for (StagedRobot& robot : stage.robots) {
    double reach = 0.5;
    for (const robot::Joint& joint : stage.models[robot.model].model->joints) reach += joint.X_PJ.p.norm();
    if (count++ > 0) y += 0.7 * reach;
    robot.base.X_WB.p.y() = y;
    y += 0.7 * reach;
  }
  if (count > 1) stage.remarks.push_back("the scenario gives the robots no places: they are shown beside one another, along y");
}

Scenery Builder::build() {
  // Contact worlds, then monitors, then scanners: their scene may be that of another one.
  std::vector<const ComponentSpec*> components;
  for (const ComponentSpec& component : scenario_.components) components.push_back(&component);
  std::ranges::stable_sort(components, {}, [&](const ComponentSpec* component) {
    return !is_unit(*component) || !only_watches(*component) ? 0 : has_setting(component->source, "ignore", types_) ? 1 : 2;
  });
  for (const ComponentSpec* component : components) {
    try {
      take(*component);
    } catch (const Error& error) {
      if (strict_) throw;
      stage_.remarks.push_back(component->name + " is not shown: " + error.what());
    }
  }
  group();
  make_ghosts();
  spread(stage_);
  return std::move(stage_);
}

}  // namespace

bool is_of_ghost(const Scenery& stage, std::string_view variable) {
  return std::ranges::any_of(stage.ghosts, [&](const std::string& world) { return variable.starts_with(world + "."); });
}

Scenery scenery_of(const Scenario& scenario, const Recorded& recorded, std::span<const UnitType> types,
                   const std::vector<fs::path>& folders, const StartValues& values, const std::shared_ptr<FileStore>& models) {
  return Builder(scenario, recorded, types, folders, values, models).build();
}

Scenery scenery_of(const StagedModel& model, const Recorded& recorded) {
  Scenery stage;
  stage.models.push_back(model);
  StagedRobot robot;
  robot.name = model.model->name;
  const auto n = static_cast<std::size_t>(model.model->n());
  robot.q0.resize(n, 0);
  for (const std::string_view name : kPositions) {
    for (const RecordedSignal& signal : recorded.signals) {
      const bool fits = signal.name == name || signal.name.ends_with("." + std::string(name));
      if (!fits || signal.count != n) continue;
      add_track(robot, name, signal.name);
      robot.prefixes.push_back(signal.name.substr(0, signal.name.size() - name.size()));
      std::string component = robot.prefixes.back();
      if (component.ends_with('.')) component.pop_back();
      robot.components.push_back(component);
    }
  }
  if (robot.tracks.empty())
    stage.remarks.push_back("no signal q with " + std::to_string(n) + " elements, the joints of robot '" + model.model->name +
                            "', so it stands still");
  stage.robots.push_back(std::move(robot));
  return stage;
}

}  // namespace cotwin::master
