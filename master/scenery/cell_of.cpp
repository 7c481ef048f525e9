#include "master/scenery/cell_of.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <sstream>
#include <string_view>
#include <tuple>

#include "master/engine/wiring/members.h"
#include "master/scenario/folders.h"
#include "master/scenery/scenery.h"
#include "models/cloud/cloud_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file_store.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose_values.h"
#include "models/scene/sdf/sdf.h"
#include "models/scene/urdf/urdf_shapes.h"

namespace cotwin::master {

namespace fs = std::filesystem;

namespace {

using collision::PlacedCell;

bool is_finite(const std::vector<double>& values) {
  return std::ranges::all_of(values, [](double x) { return std::isfinite(x); });
}

}  // namespace

Member member_of(const Scenario& scenario, const std::string& component, std::span<const UnitType> types,
                 const std::vector<fs::path>& folders, const std::shared_ptr<FileStore>& models) {
  fmu::FmuStore fmus;
  const auto spec = std::ranges::find(scenario.components, component, &ComponentSpec::name);
  Member member = load_member(*spec, scenario, types, folders, fmus, nullptr, models);
  apply(start_values(scenario, member), member.variables());
  return member;
}

StartValues values_of_units(const Scenario& scenario, std::span<const UnitType> types, const std::vector<fs::path>& folders,
                            const std::shared_ptr<FileStore>& models) {
  const auto members = std::make_shared<std::map<std::string, Member>>();
  return [=, &scenario](const std::string& component, const std::string& variable,
                        std::vector<double> otherwise) -> std::vector<double> {
    auto member = members->find(component);
    if (member == members->end())
      member = members->emplace(component, member_of(scenario, component, types, folders, models)).first;
    const Variable* const found = member->second.variables().find(variable);
    if (found == nullptr || found->kind() != Kind::kReal || found->role == Role::kOutput || found->role == Role::kState)
      return otherwise;
    const bool fed = std::ranges::any_of(scenario.connections, [&](const ConnectionSpec& connection) {
      const Port& to = connection.to;
      return to.component == component && to.variable.substr(0, to.variable.find('[')) == variable;
    });
    if (fed) return {};
    return {found->reals().begin(), found->reals().end()};
  };
}

StartValues values_of_texts(const Scenario& scenario) {
  return [&scenario](const std::string& component, const std::string& variable, std::vector<double> numbers) {
    const auto spec = std::ranges::find(scenario.components, component, &ComponentSpec::name);
    if (spec == scenario.components.end()) return numbers;
    for (const ParameterValue& value : spec->start_values) {
      if (value.name.substr(0, value.name.find('[')) != variable) continue;
      std::vector<double> given;
      if (const double* real = std::get_if<double>(&value.value)) given.push_back(*real);
      if (const std::int64_t* whole = std::get_if<std::int64_t>(&value.value)) given.push_back(static_cast<double>(*whole));
      if (const std::string* list = std::get_if<std::string>(&value.value)) {
        std::string words = *list;
        std::ranges::replace(words, ',', ' ');
        std::istringstream in(words);
        for (std::string word; in >> word;)
          if (const std::optional<double> x = text::parse_real(word)) given.push_back(*x);
      }
      if (const si::Measure m = value.unit.empty() ? si::Measure{} : measure(scenario, value.unit); true)
        for (double& x : given) x = x * m.factor + m.offset;
      if (value.name == variable) numbers = given;
      for (std::size_t i = 0; i < numbers.size() && given.size() == 1; ++i)
        if (value.name == variable + "[" + std::to_string(i + 1) + "]") numbers[i] = given[0];
    }
    return numbers;
  };
}

double start_value(const StartValues& values, const std::string& component, const std::string& variable, double otherwise) {
  const std::vector<double> found = values(component, variable, {otherwise});
  return found.size() == 1 ? found.front() : otherwise;
}

double largest_value(const Scenario& scenario, const StartValues& values, const std::string& component,
                     const std::string& variable) {
  double largest = start_value(values, component, variable, 0);
  for (const EventSpec& event : scenario.events)
    if (event.variable == component + "." + variable)
      largest = std::max(largest, text::parse_real(event.value).value_or(largest));
  return largest;
}

StartPose start_pose(const StartValues& values, const std::string& component, const std::string& prefix,
                     const Pose& otherwise) {
  const auto ask = [&](const std::string& name, std::vector<double> there) {
    return values(component, prefix + name + "0", values(component, prefix + name, std::move(there)));
  };
  const Eigen::Quaterniond Q(otherwise.R);
  const std::vector<double> p = ask("p", {otherwise.p.x(), otherwise.p.y(), otherwise.p.z()}),
                            quat = ask("quat", {Q.w(), Q.x(), Q.y(), Q.z()});
  if (p.size() != 3 || quat.size() != 4) return {otherwise, true};
  if (!is_finite(p) || !is_finite(quat))
    throw Error(component + "." + prefix + "p0", "a position or quaternion is no number, expected finite values");
  if (!values(component, prefix + "quat0", {}).empty()) return {pose_of(component + "." + prefix + "quat0", p, quat)};
  const bool turned = std::ranges::any_of(quat, [](double value) { return value != 0; });
  return {turned ? pose_of_input(component, prefix, "quat", p, quat) : Pose{Eigen::Matrix3d::Identity(), {p[0], p[1], p[2]}}};
}

bool differ(const Pose& a, const Pose& b) {
  constexpr double kMetres = 1e-4, kRadians = 2e-4;
  const Eigen::AngleAxisd turn(Eigen::Matrix3d(a.R.transpose() * b.R));
  return !((a.p - b.p).norm() <= kMetres && turn.angle() <= kRadians);
}

void Differing::add(const std::string& name, const std::string& what, const Pose& X_W, const std::string& told, double size) {
  constexpr double kSame = 1e-4;  // m, 1
  const collision::Place place{name, X_W, size, collision::text_of(X_W) + told};
  const collision::Place& first = first_.try_emplace(what, place).first->second;
  if (differ(first.X_W, X_W) || !(std::abs(first.radius - size) <= kSame))
    sentences.push_back(name + " stands at " + first.by + ", at " + place.by);
}

std::pair<std::string, Pose> read_base(const std::string& text, const std::string& option) {
  const std::size_t colon = text.rfind(':');
  const bool named = colon != std::string::npos;
  std::vector<double> numbers;
  for (const std::string_view word : text::split(std::string_view(text).substr(named ? colon + 1 : 0), ' '))
    if (!word.empty()) numbers.push_back(text::parse_real(word).value_or(std::numeric_limits<double>::quiet_NaN()));
  if (!is_finite(numbers) || (numbers.size() != 3 && numbers.size() != 6))
    throw Error(
        option,
        "'" + text + "', expected x y z or x y z roll pitch yaw in m and rad, after NAME: where there are several robots");
  numbers.resize(6);
  return {named ? std::string(text::trim(std::string_view(text).substr(0, colon))) : "",
          {rotation_from_rpy(numbers[3], numbers[4], numbers[5]), {numbers[0], numbers[1], numbers[2]}}};
}

namespace {

/// A file, or the one of a scene or cloud of the model folders; empty: there is none.
fs::path file_of(const std::string& name) {
  std::error_code none;
  if (fs::is_regular_file(name, none)) return name;
  for (const fs::path& ending :
       {fs::path("scenes") / name / "scene.sdf", fs::path("scenes") / name / "scene.pcd", fs::path(name)})
    for (const fs::path& folder : model_folders({}))
      if (fs::is_regular_file(folder / ending, none)) return folder / ending;
  return {};
}

/// What is asked for, as it is made.
class Maker {
 public:
  Maker(const Scenery* stage, std::shared_ptr<FileStore> models) : stage_(stage), models_(std::move(models)) {}

  /// `own`: its bodies stand where it has them, otherwise where they count.
  void add_component(const std::string& component, bool own) {
    for (const StagedBody& body : stage_->bodies)
      if (body.component == component) add_watched(body, own ? component : "");
    for (const PlacedCell::Cloud& cloud : stage_->clouds)
      if (cloud.by == component) add(cloud);
  }

  void add_file(const std::string& name) {
    const fs::path file = file_of(name);
    if (file.empty())
      throw Error("scene '" + name + "'", "is neither a file nor the name of a scene" +
                                              std::string(stage_ == nullptr ? "" : ", nor a component") +
                                              ", expected an SDF file or a point cloud (.pcd, .ply, .xyz, .csv)");
    const bool is_cloud = cloud::is_cloud(file);
    bool& has = is_cloud ? has_cloud_ : has_scene_;
    if (std::exchange(has, true))
      throw Error("scene '" + name + "'", std::string("is the second ") + (is_cloud ? "cloud" : "scene") + ", expected one");
    const fs::path linked = fs::weakly_canonical(file);
    bool known = false;
    if (is_cloud) {
      const auto placed = stage_ == nullptr ? nullptr : find(stage_->clouds, linked);
      known = placed != nullptr;
      add(known ? *placed
                : PlacedCell::Cloud{
                      .points = nullptr, .radius = -1, .X_WC = {}, .file = linked, .by = linked.filename().string()});
    } else {
      PlacedCell own;
      own.add(scene::load(file, &notes), linked);
      for (const PlacedCell::Body& body : own.bodies) {
        const StagedBody* const placed = standing(body, "");
        known = known || placed != nullptr;
        placed != nullptr ? add(*placed) : add(body);
      }
    }
    if (!known && stage_ != nullptr)
      notes.push_back("no component of the scenario has " + file.filename().string() + ", which stands as in its file");
  }

  PlacedCell cell;
  std::vector<std::string> notes;

 private:
  static const PlacedCell::Cloud* find(const std::vector<PlacedCell::Cloud>& clouds, const fs::path& file) {
    const auto found = std::ranges::find(clouds, file, &PlacedCell::Cloud::file);
    return found == clouds.end() ? nullptr : &*found;
  }

  /// The one of the scenario that counts: of this component, an obstacle where its monitor has it, then the first one; nullptr: there is none.
  const StagedBody* standing(const PlacedCell::Body& body, const std::string& component) const {
    const StagedBody* best = nullptr;
    const auto rank = [&](const StagedBody& one) {
      return std::tuple(!one.fed_by.empty(), one.component != component, !one.comes);
    };
    for (std::size_t k = 0; stage_ != nullptr && k < stage_->bodies.size(); ++k) {
      const StagedBody& one = stage_->bodies[k];
      if (one.file == body.file && one.body.name == body.body.name && (best == nullptr || rank(one) < rank(*best))) best = &one;
    }
    return best;
  }

  /// One that a connection moves is where that begins.
  void add_watched(const StagedBody& body, const std::string& component) {
    const auto source = std::ranges::find(stage_->bodies, body.fed_by, &StagedBody::prefix);
    if (source == stage_->bodies.end()) return add(*standing(body, component));
    PlacedCell::Body placed = body;
    placed.body.X_WB = source->body.X_WB;
    placed.by = source->by;
    add(placed);
  }

  /// Names are unique, so that one of another file has that beside it.
  std::string free(const std::string& name, const fs::path& file) const {
    const bool taken = std::ranges::any_of(cell.bodies, [&](const auto& one) { return one.body.name == name; }) ||
                       std::ranges::find(cell.clouds, name, &PlacedCell::Cloud::name) != cell.clouds.end();
    return taken ? name + " of " + file.string() : name;
  }

  /// One that an event brings counts from the beginning.
  void add(const StagedBody& staged) {
    PlacedCell::Body body = staged;
    body.present = staged.present || staged.appears;
    add(body);
  }

  void add(const PlacedCell::Body& body) {
    const auto same = [&](const PlacedCell::Body& one) { return one.file == body.file && one.body.name == body.body.name; };
    if (std::ranges::any_of(cell.bodies, same)) return;
    const std::string name = free(body.body.name, body.file);
    cell.bodies.push_back(body);
    cell.bodies.back().body.name = name;
  }

  void add(PlacedCell::Cloud cloud) {
    if (find(cell.clouds, cloud.file) != nullptr) return;
    const auto read = read_once<cloud::Obstacle>(models_.get(), cloud::kCloudKey + cloud.file.string(),
                                                 [&] { return cloud::load_obstacle(cloud.file); });
    for (const std::string& remark : read->remarks) notes.push_back(cloud.file.string() + ": " + remark);
    if (cloud.radius < 0) cloud.radius = read->touching();
    notes.push_back("the " + text::counted(std::ssize(read->points->cloud().points), "point") + " of " +
                    cloud.file.filename().string() + " have balls of " + text::to_text(cloud.radius, 3) + " m");
    if (std::string gaps = read->gaps("cloud.r", cloud.radius); !gaps.empty()) notes.push_back(std::move(gaps));
    cloud.points = read->points;
    cloud.name = free(cloud.name, cloud.file);
    cell.clouds.push_back(std::move(cloud));
  }

  const Scenery* stage_;
  std::shared_ptr<FileStore> models_;
  bool has_scene_ = false, has_cloud_ = false;
};

/// Which motion a robot follows, if any.
ScenarioCell::Robot follower_of(const StagedRobot& robot, const CellRequest& request, const Scenario& scenario) {
  ScenarioCell::Robot found{"", robot.components};
  const auto element = [](const std::string& name) { return name.substr(std::min(name.find('['), name.size())); };
  for (const auto& [motion, joints] : request.motions) {
    if (std::ranges::find(robot.tracks, motion + ".q_d", &StagedTrack::signal) == robot.tracks.end()) continue;
    found.motion = motion;
    std::map<std::string, std::size_t> fed;  // elements of each vector of positions
    for (const ConnectionSpec& c : scenario.connections) {
      const std::string to = c.to.component + "." + c.to.variable, vector = to.substr(0, to.find('['));
      if (std::ranges::none_of(robot.prefixes, [&](const auto& x) { return vector == x + "q" || vector == x + "q_d"; }))
        continue;
      fed[vector] += element(to).empty() ? joints : 1;
      found.changed = found.changed || c.factor != 1 || c.offset != 0 || element(c.from.variable) != element(to);
    }
    found.changed = found.changed || std::ranges::any_of(fed, [n = joints](const auto& one) { return one.second != n; });
    break;
  }
  return found;
}

PlacedCell::Robot robot_of(const StagedRobot& robot, const StagedModel& model, std::vector<std::string>& notes) {
  const std::string prefix = robot.prefixes.front();
  PlacedCell::Robot placed{{robot.by.empty() ? prefix.substr(0, prefix.rfind('.')) : robot.by, *model.model, {}},
                           robot.base.X_WB,
                           {},
                           robot.q0,
                           robot.floats,
                           robot.by};
  if (!model.urdf.empty()) placed.robot.shapes = scene::hulls_of_urdf(model.urdf, *model.model);
  for (const StagedTool& tool : robot.tools) {
    placed.tools.push_back({tool.name, tool.body, {}, tool.from, tool.until.value_or(scene::kInfinity)});
    if (!tool.urdf.empty()) placed.tools.back().shapes = scene::shapes_of_tool(tool.urdf, tool.X_BA, &notes);
  }
  return placed;
}

}  // namespace

bool share_component(const ScenarioCell::Robot& a, const ScenarioCell::Robot& b) {
  return std::ranges::find_first_of(a.components, b.components) != a.components.end();
}

PlacedCell cell_of(const std::vector<std::string>& names, std::vector<std::string>& notes) {
  Maker maker(nullptr, nullptr);
  for (const std::string& name : names) maker.add_file(name);
  notes.insert(notes.end(), maker.notes.begin(), maker.notes.end());
  return std::move(maker.cell);
}

ScenarioCell cell_of(const Scenario& scenario, const CellRequest& request, std::span<const UnitType> types) {
  const std::vector<fs::path> folders = model_folders(scenario.folder);
  const auto models = std::make_shared<FileStore>();
  const StartValues values = values_of_units(scenario, types, folders, models);
  Recorded signals;  // by which a robot on the stage is found to follow a motion
  for (const auto& [motion, joints] : request.motions) {
    signals.signals.push_back({motion + ".q_d", "", signals.columns.size(), joints});
    signals.columns.resize(signals.columns.size() + joints);
  }
  const Scenery stage = scenery_of(scenario, signals, types, folders, values, models);
  Maker maker(&stage, models);
  const StagedCell* watching = nullptr;
  std::vector<std::string> files;
  for (const std::string& name : request.names) {
    if (std::ranges::find(scenario.components, name, &ComponentSpec::name) == scenario.components.end()) {
      files.push_back(name);
      continue;
    }
    const auto cell = std::ranges::find(stage.cells, name, &StagedCell::component);
    if (cell == stage.cells.end())
      throw Error("--clear-of " + name,
                  "is a component that watches nothing, expected a monitor, a scanner or a contact world");
    if (std::exchange(watching, &*cell) != nullptr) throw Error("--clear-of " + name, "is the second component, expected one");
    maker.add_component(name, true);
    if (!file_of(name).empty())
      maker.notes.push_back(name + " is a component of the scenario and a scene, expected one: the component is taken");
  }
  for (const std::string& component : request.watching) maker.add_component(component, false);
  for (const std::string& name : files) maker.add_file(name);
  ScenarioCell found;
  Differing differing = stage.differing;
  for (const StagedRobot& robot : stage.robots) {
    maker.cell.robots.push_back(robot_of(robot, stage.models[robot.model], maker.notes));
    found.robots.push_back(follower_of(robot, request, scenario));
    if (found.robots.back().changed)
      maker.notes.push_back(robot.name + " follows " + found.robots.back().motion + " by connections that change positions");
  }
  found.cell = std::move(maker.cell);
  found.notes = std::move(maker.notes);
  std::vector<PlacedCell::Robot>& robots = found.cell.robots;
  // Those of a component that is named stand where it has them, with its shapes.
  for (std::size_t i = 0; watching != nullptr && i < robots.size(); ++i) {
    for (const scene::PlacedRobot& one : watching->cell->robots) {
      const std::string of = one.name.empty() ? "" : text::identifier(one.name) + ".";
      if (std::ranges::find(stage.robots[i].prefixes, watching->component + "." + of) == stage.robots[i].prefixes.end())
        continue;
      PlacedCell::Robot& robot = robots[i];
      robot.alias = one.name.empty() ? "" : one.name + "/";
      if (const StartPose base = start_pose(values, watching->component, of + "base_", {}); !base.fed) {
        robot.X_WB = base.X_W;
        robot.by = watching->component + (of.empty() ? "" : "." + of.substr(0, of.size() - 1));
      }
      auto shapes = one.shapes;
      for (std::vector<scene::Shape>& of_link : shapes) {
        std::erase_if(of_link, [&](const scene::Shape& shape) {  // of its setting `tools`
          const std::string tool = of + "tool." + text::identifier(shape.tool);
          return !shape.tool.empty() && start_value(values, watching->component, tool, 0) == 0;
        });
        for (scene::Shape& shape : of_link) shape.tool.clear();
      }
      const bool bare = std::ranges::all_of(shapes, &std::vector<scene::Shape>::empty);
      if (!bare && shapes.size() == robot.robot.shapes.size()) robot.robot.shapes = std::move(shapes);
    }
  }
  // One with a place if there are several, of a component that is named first: its twins do the same.
  for (const auto& [motion, joints] : request.motions) {
    std::size_t own = robots.size();
    for (std::size_t i = robots.size(); i-- > 0;)
      if (found.robots[i].motion == motion &&
          (own == robots.size() || (!robots[i].by.empty() && (robots[i].alias || !robots[own].alias))))
        own = i;
    if (own == robots.size()) continue;
    robots[own].robot.name = motion;
    for (std::size_t i = own; i < robots.size(); ++i)
      if (found.robots[i].motion == motion && !robots[i].by.empty() && !stage.robots[i].fed &&
          (i == own || !share_component(found.robots[own], found.robots[i])))
        differing.add("the base of the robot that " + motion + " moves", "motion " + motion, robots[i].X_WB,
                      " by " + robots[i].by);
  }
  found.differing = differing.sentences;
  if (watching != nullptr) {
    found.cell.ignore_checked = true;
    found.cell.r = largest_value(scenario, values, watching->component, "r");
    if (found.cell.r != 0 || !watching->ignore.empty())
      found.notes.push_back("as " + watching->component + ": robots are inflated by " + text::to_text(found.cell.r) + " m" +
                            (watching->ignore.empty() ? "" : ", without " + watching->ignore));
    for (const std::string_view item : text::split(watching->ignore, ','))
      if (!text::trim(item).empty()) found.cell.ignore.emplace_back(item);
  }
  std::vector<std::string> names;
  for (const PlacedCell::Robot& one : robots) names.push_back(one.robot.name);
  for (const std::string& text : request.bases) {
    const auto [name, X_WB] = read_base(text);
    const auto at = name.empty() && robots.size() == 1 ? names.begin() : std::ranges::find(names, name);
    if (at == names.end())
      throw Error("--base", "'" + text + "' names no robot, expected NAME: of " + text::joined(names) + " before the numbers");
    PlacedCell::Robot& robot = robots[static_cast<std::size_t>(at - names.begin())];
    robot.X_WB = X_WB;
    robot.by = "--base";
  }
  return found;
}

}  // namespace cotwin::master
