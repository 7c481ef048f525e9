#include "master/view/stage_json.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "fmu/import/fmu_store.h"
#include "master/engine/wiring/members.h"
#include "master/view/calculated.h"
#include "master/view/visuals_json.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "models/scene/urdf/urdf_visuals.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

Json limit_json(double limit) { return std::isfinite(limit) ? Json(limit) : Json(nullptr); }

class Writer {
 public:
  Writer(const StageContent& content, const std::vector<std::size_t>& rows, CalculatedTable& calculated, Packer& packer,
         std::vector<std::string>& remarks)
      : stage_(content.stage),
        recorded_(content.recorded),
        content_(content),
        rows_(rows),
        calculated_(calculated),
        remarks_(remarks),
        packer_(packer),
        visuals_(packer, remarks) {}

  Json write();

 private:
  Json robot_json(const StagedModel& staged);
  Json distances_json() const;
  Json profiles_json() const;
  Json tool_json(const StagedTool& tool);
  Json figure_json(const StagedRobot& robot, std::size_t index);
  bool floats(const StagedRobot& robot) const;
  void add_live_matrices(Json& json, const StagedRobot& robot, std::size_t index) const;
  void add_base(Json& json, const StagedBase& base) const;
  Json tau_e_json(const StagedRobot& robot) const;
  std::string add_matrix(const std::string& name, const MatrixOverTime& matrix, const char* unit);
  /// The controller of a robot whose stiffness is shown, as a function of the row; `lacks` says what must be recorded.
  std::function<std::optional<Compliant>(std::size_t)> stiffness_of(const StagedRobot& robot, std::string& lacks);
  bool is_recorded(const std::string& signal, std::size_t count) const {
    const RecordedSignal* found = recorded_.find(signal);
    return found != nullptr && found->count == count;
  }
  Json contacts_json() const;
  Json forces_json() const;
  Json energy_json() const;

  const Scenery& stage_;
  const Recorded& recorded_;
  const StageContent& content_;
  const std::vector<std::size_t>& rows_;
  CalculatedTable& calculated_;
  std::vector<std::string>& remarks_;
  Packer& packer_;
  VisualWriter visuals_;
};

Json Writer::robot_json(const StagedModel& staged) {
  const robot::RobotModel& robot = *staged.model;
  Json json = {{"name", robot.name}, {"n", robot.n()}, {"joints", Json::array()}};
  for (int body = 0; body < robot.body_count(); ++body) {
    const robot::Joint& joint = robot.joint_of(body);
    const bool follows = body >= robot.n();
    Json entry = {{"name", joint.name},
                  {"type", joint.type == robot::JointType::kRevolute ? "revolute" : "prismatic"},
                  {"parent", joint.parent},
                  {"axis", vector_json(joint.axis)},
                  {"leader", robot.leader_of(body)},
                  {"multiplier", follows ? robot.mimics[static_cast<std::size_t>(body - robot.n())].multiplier : 1.0},
                  {"offset", follows ? robot.mimics[static_cast<std::size_t>(body - robot.n())].offset : 0.0},
                  {"min", limit_json(joint.q_min)},
                  {"max", limit_json(joint.q_max)}};
    add_pose(entry, joint.X_PJ);
    json["joints"].push_back(std::move(entry));
  }
  json["order"] = robot.depth_first();
  json["frames"] = Json::array();
  std::size_t tip = 0;
  const robot::Frame& end = robot.end_effector();
  for (const robot::Frame& frame : robot.frames) {
    if (&frame == &end) tip = json["frames"].size();
    Json entry = {{"name", frame.name}, {"body", frame.body}};
    add_pose(entry, frame.X_BF);
    json["frames"].push_back(std::move(entry));
  }
  json["tip"] = tip;
  json["names"] = Json::array();
  for (const robot::Joint& joint : robot.joints) json["names"].push_back(joint.name);

  json["visuals"] = Json::array();
  for (std::size_t i = 0; i <= robot.bodies.size(); ++i) json["visuals"].push_back(Json::array());
  json["solids"] = json["visuals"];
  if (staged.urdf.empty()) return json;
  try {
    std::vector<std::string> warnings;
    const auto visuals = scene::visuals_of_urdf(staged.urdf, robot, &warnings);
    for (std::size_t i = 0; i < visuals.size(); ++i) json["visuals"][i] = visuals_.write(visuals[i]);
    const auto shapes = scene::hulls_of_urdf(staged.urdf, robot);
    for (std::size_t i = 0; i < shapes.size(); ++i) json["solids"][i] = visuals_.write(shapes[i]);
    remarks_.insert(remarks_.end(), warnings.begin(), warnings.end());
  } catch (const Error& error) {
    remarks_.push_back(std::string("shapes of robot '") + robot.name + "' are left out: " + error.what());
  }
  return json;
}

/// The box in A with the mass and the inertia; a point mass is a cube of steel.
scene::Shape box_of(const Inertia& inertia) {
  constexpr double kSteel = 7850, kLeast = 1e-3;  // kg/m³, m
  scene::Shape box;
  box.type = scene::ShapeType::kBox;
  box.X_BS.p = inertia.p_LC;
  const auto [moments, axes] = numerics::symmetric_eigen<3>(inertia.I_CC);
  box.X_BS.R = axes * (axes.determinant() < 0 ? -1 : 1);
  const Eigen::Vector3d squares = 6 / inertia.mass * (Eigen::Vector3d::Constant(moments.sum()) - 2 * moments);
  box.size = squares.cwiseMax(0).cwiseSqrt().cwiseMax(kLeast);
  if (moments.isZero(0)) box.size.setConstant(std::cbrt(inertia.mass / kSteel));
  return box;
}

/// The tool's visuals or collision shapes; without a file with shapes, the box with its inertia; nothing of a frame without mass.
Json Writer::tool_json(const StagedTool& tool) {
  Json json = {{"name", tool.name}, {"body", tool.body}, {"from", tool.from}, {"until", nullptr}, {"visuals", Json::array()}};
  if (tool.until) json["until"] = *tool.until;
  add_pose(json, tool.X_BA);
  try {
    if (tool.urdf.empty()) {
      if (tool.inertia.mass > 0) json["visuals"] = visuals_.write(std::vector{box_of(tool.inertia)});
      return json;
    }
    const robot::RobotModel model = robot::load_urdf(tool.urdf);
    json["visuals"] = visuals_.write(scene::visuals_of_urdf(tool.urdf, model).front());
    if (json["visuals"].empty()) json["visuals"] = visuals_.write(scene::hulls_of_urdf(tool.urdf, model).front());
  } catch (const Error& error) {
    remarks_.push_back("shapes of tool '" + tool.name + "' are left out: " + error.what());
  }
  return json;
}

/// Mass (kg), centre of mass (m) and inertia about it (xx, xy, xz, yy, yz, zz, kg m²).
Json inertia_json(const Inertia& inertia) {
  const Eigen::Matrix3d& I = inertia.I_CC;
  return {{"mass", inertia.mass},
          {"com", vector_json(inertia.p_LC)},
          {"inertia", {I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2)}}};
}

std::string Writer::add_matrix(const std::string& name, const MatrixOverTime& matrix, const char* unit) {
  calculated_.signals.push_back({name, unit, calculated_.columns.size(), matrix.size()});
  for (const std::vector<double>& column : matrix) calculated_.columns.push_back(column);
  return name;
}

std::function<std::optional<Compliant>(std::size_t)> Writer::stiffness_of(const StagedRobot& robot, std::string& lacks) {
  const auto none = [](std::size_t) -> std::optional<Compliant> { return std::nullopt; };
  const auto n = static_cast<std::size_t>(stage_.models[robot.model].model->n());
  lacks = "the robot has no controller with a stiffness; a component of unit:compliance has one";
  if (content_.scenario == nullptr) return none;
  for (const std::string& component : robot.components) {
    const auto spec = std::ranges::find(content_.scenario->components, component, &ComponentSpec::name);
    if (spec == content_.scenario->components.end() || !is_unit(*spec) || !has_setting(spec->source, "render", content_.types))
      continue;
    const RecordedSignal* recorded = nullptr;
    for (const char* name : {".S_a", ".S_T"}) {
      const RecordedSignal* found = recorded_.find(component + name);
      if (found != nullptr && found->count == (std::string_view(name) == ".S_a" ? n : 3)) recorded = found;
    }
    lacks = "record " + component + ".S_a (joints) or " + component + ".S_T (Cartesian)";
    try {
      fmu::FmuStore fmus;
      const Member member = load_member(*spec, *content_.scenario, content_.types, content_.folders, fmus);
      apply(start_values(*content_.scenario, member), member.variables());
      const bool cartesian = member.variables().find("S_T") != nullptr;
      const Variable* variable = member.variables().find(cartesian ? "S_T" : "S_a");
      if (variable == nullptr) continue;
      const std::span<const double> start = variable->reals();
      const std::vector<double> values(start.begin(), start.end());
      const UnitSource source = parse_unit_source(spec->source);
      Settings settings(source.unit, source.query, settings_for(*content_.scenario, component), content_.folders);
      const bool in_tool = settings.given("axes").value_or("world") != "world";
      if (cartesian && values.size() != 3 && values.size() != 9) continue;
      lacks.clear();
      return [this, recorded, values, cartesian, in_tool](std::size_t row) -> std::optional<Compliant> {
        std::vector<double> now = values;
        for (std::size_t i = 0; recorded != nullptr && i < now.size(); ++i) now[i] = recorded_.column(*recorded, i)[row];
        Compliant compliant;
        if (!cartesian) {
          compliant.joints = std::move(now);
        } else {
          const std::size_t stride = now.size() == 9 ? 4 : 1;  // the diagonal of a matrix
          compliant.frame = std::array<double, 3>{now[0], now[stride], now[2 * stride]};
          compliant.in_tool = in_tool;
        }
        return compliant;
      };
    } catch (const Error& error) {
      remarks_.push_back(component + ": its stiffness is not shown: " + error.what());
    }
  }
  return none;
}

Json Writer::tau_e_json(const StagedRobot& robot) const {
  const auto n = static_cast<std::size_t>(stage_.models[robot.model].model->n());
  std::string wanted;
  for (const std::string& prefix : robot.prefixes) {
    if (is_recorded(prefix + "tau_e", n)) return {{"signals", Json::array({prefix + "tau_e"})}, {"lacks", ""}};
    if (std::ranges::find(stage_.monitors, prefix) == stage_.monitors.end())
      wanted += (wanted.empty() ? "" : " or ") + prefix + "tau_e";
  }
  const std::string lacks = wanted.empty() ? "no component of the robot has external torques" : "record " + wanted;
  return {{"signals", Json::array()}, {"lacks", lacks}};
}

/// Whether the base of the robot moves freely: only then its pose is recorded.
bool Writer::floats(const StagedRobot& robot) const {
  return is_recorded(robot.base.quat, 4) && stage_.models[robot.model].model->base.inertia.unphysical().empty();
}

/// Names of the matrices that the page calculates, and the signal that has the stiffness.
void Writer::add_live_matrices(Json& json, const StagedRobot& robot, std::size_t index) const {
  const robot::RobotModel& model = *stage_.models[robot.model].model;
  const bool has_masses = std::ranges::all_of(model.bodies, [](const robot::Body& body) { return body.inertia.mass > 0; });
  const std::string of = "figure " + std::to_string(index);
  const bool shown = !robot.tracks.empty();
  json["floats"] = floats(robot);
  json["mobility"] = has_masses && shown ? of + " mobility" : "";
  json["velocity"] = shown ? of + " velocity" : "";
  json["stiffness"] = {{"signals", Json::array()},
                       {"lacks", "the robot has no controller with a stiffness; a component of unit:compliance has one"}};
  for (const std::string& component : robot.components) {
    const auto spec = std::ranges::find(content_.scenario->components, component, &ComponentSpec::name);
    if (spec == content_.scenario->components.end() || !is_unit(*spec) || !has_setting(spec->source, "render", content_.types))
      continue;
    for (const char* name : {".S_a", ".S_T"}) {
      const RecordedSignal* found = recorded_.find(component + name);
      const bool joints = std::string_view(name) == ".S_a";
      if (found == nullptr ||
          (joints ? found->count != static_cast<std::size_t>(model.n()) : found->count != 3 && found->count != 9))
        continue;
      const UnitSource source = parse_unit_source(spec->source);
      Settings settings(source.unit, source.query, settings_for(*content_.scenario, component), content_.folders);
      json["stiffness"] = {{"signals", Json::array({of + " stiffness"})}, {"lacks", ""}};
      json["controller"] = {
          {"signal", component + name}, {"joints", joints}, {"in_tool", settings.given("axes").value_or("world") != "world"}};
    }
  }
}

void Writer::add_base(Json& json, const StagedBase& base) const {
  json["base"] = Json::object();
  add_pose(json["base"], base.X_WB);
  json["base_p"] = is_recorded(base.p, 3) ? base.p : "";
  json["base_quat"] = is_recorded(base.quat, 4) ? base.quat : "";
}

Json Writer::figure_json(const StagedRobot& robot, std::size_t index) {
  static constexpr const char* kRoles[] = {"main", "desired", "compliant", "other"};
  Json json = {{"name", robot.name}, {"robot", robot.model}};
  add_base(json, robot.base);
  json["q0"] = robot.q0;
  json["tracks"] = Json::array();
  for (const StagedTrack& track : robot.tracks) {
    json["tracks"].push_back({{"role", kRoles[static_cast<std::size_t>(track.role)]}, {"signal", track.signal}});
    if (track.base) add_base(json["tracks"].back(), *track.base);
  }
  json["tools"] = Json::array();
  for (const StagedTool& tool : robot.tools) json["tools"].push_back(tool_json(tool));
  json["tau_e"] = tau_e_json(robot);
  if (content_.live) {
    add_live_matrices(json, robot, index);
    return json;
  }
  std::string lacks;
  const auto compliant = stiffness_of(robot, lacks);
  std::string mobility, velocity;
  Json stiffness = Json::array();
  if (!robot.tracks.empty() && !rows_.empty()) {
    const TipMatrices matrices = tip_matrices(*stage_.models[robot.model].model, recorded_,
                                              *recorded_.find(robot.tracks.front().signal), rows_, compliant, floats(robot));
    const std::string of = "figure " + std::to_string(index);
    if (matrices.mobility) mobility = add_matrix(of + " mobility", *matrices.mobility, "1/kg");
    velocity = add_matrix(of + " velocity", matrices.velocity, "m2/s2");
    if (matrices.stiffness) stiffness.push_back(add_matrix(of + " stiffness", *matrices.stiffness, "N/m"));
  } else if (lacks.empty()) {
    lacks = "record the joint positions of the robot, for example drive.q";
  }
  json["mobility"] = mobility;
  json["velocity"] = velocity;
  json["stiffness"] = {{"signals", stiffness}, {"lacks", lacks}};
  return json;
}

Json Writer::contacts_json() const {
  Json contacts = Json::array();
  for (const RecordedSignal& signal : recorded_.signals) {
    if (!signal.name.ends_with(".contact_p") || is_of_ghost(stage_, signal.name)) continue;
    const std::string f = signal.name.substr(0, signal.name.size() - 1) + "f";
    if (is_recorded(f, signal.count)) contacts.push_back({{"p", signal.name}, {"f", f}});
  }
  for (const RecordedSignal& signal : recorded_.signals) {  // latches
    if (!signal.name.ends_with(".closed") || is_of_ghost(stage_, signal.name)) continue;
    const std::string prefix = signal.name.substr(0, signal.name.size() - 6);
    if (is_recorded(prefix + "p", 3) && is_recorded(prefix + "f", 3))
      contacts.push_back({{"p", prefix + "p"}, {"f", prefix + "f"}});
  }
  return contacts;
}

/// Forces of hands: the signals f and p of a component that belongs to a robot, in its base, or of a hand that grips a body, in W.
Json Writer::forces_json() const {
  Json forces = Json::array();
  for (std::size_t figure = 0; figure < stage_.robots.size(); ++figure) {
    for (const std::string& prefix : stage_.robots[figure].prefixes) {
      if (is_recorded(prefix + "f", 3) && is_recorded(prefix + "p", 3))
        forces.push_back({{"name", prefix}, {"p", prefix + "p"}, {"f", prefix + "f"}, {"figure", figure}});
    }
  }
  if (content_.scenario == nullptr) return forces;
  for (const ComponentSpec& spec : content_.scenario->components) {
    const std::string prefix = spec.name + ".", p = prefix + "p", f = prefix + "f";
    const bool is_known = std::ranges::any_of(forces, [&](const Json& force) { return force["name"] == prefix; });
    if (is_known || !is_recorded(f, 3) || !is_recorded(p, 3)) continue;
    if (is_unit(spec) && has_setting(spec.source, "grips", content_.types))
      forces.push_back({{"name", prefix}, {"p", p}, {"f", f}, {"figure", -1}});
  }
  return forces;
}

/// Of the monitors of single robots, with the pair that counts for separation.
Json Writer::distances_json() const {
  Json distances = Json::array();
  for (const std::string& prefix : stage_.monitors) {
    const std::string p_a = prefix + "p_a", p_b = prefix + "p_b", distance = prefix + "distance";
    if (!is_recorded(p_a, 3) || !is_recorded(p_b, 3) || !is_recorded(distance, 1)) continue;
    Json source = {{"name", prefix.substr(0, prefix.size() - 1)}, {"p_a", p_a}, {"p_b", p_b}, {"distance", distance}};
    const auto robot = std::ranges::find_if(
        stage_.robots, [&](const StagedRobot& one) { return std::ranges::find(one.prefixes, prefix) != one.prefixes.end(); });
    source["figure"] = robot == stage_.robots.end() ? -1 : robot - stage_.robots.begin();
    const auto cell =
        std::ranges::find_if(stage_.cells, [&](const StagedCell& one) { return prefix.starts_with(one.component + "."); });
    source["r"] =
        content_.scenario == nullptr ? 0.0 : start_value(values_of_texts(*content_.scenario), cell->component, "r", 0);
    const std::string apart_a = prefix + "separation_p_a", apart_b = prefix + "separation_p_b";
    if (is_recorded(apart_a, 3) && is_recorded(apart_b, 3) && is_recorded(prefix + "S_p", 1) && is_recorded(prefix + "zone", 1))
      source["apart"] = {{"p_a", apart_a}, {"p_b", apart_b}, {"S_p", prefix + "S_p"}, {"zone", prefix + "zone"}};
    distances.push_back(std::move(source));
  }
  return distances;
}

Json Writer::profiles_json() const {
  Json profiles = Json::array();
  for (const std::string& prefix : stage_.scanners) {
    const RecordedSignal* ranges = recorded_.find(prefix + "ranges");
    if (ranges == nullptr || !is_recorded(prefix + "p_scan", 3) || !is_recorded(prefix + "quat_scan", 4) ||
        !is_recorded(prefix + "angle_increment", 1))
      continue;
    profiles.push_back({{"name", prefix.substr(0, prefix.size() - 1)},
                        {"ranges", ranges->name},
                        {"p", prefix + "p_scan"},
                        {"quat", prefix + "quat_scan"},
                        {"increment", prefix + "angle_increment"}});
  }
  return profiles;
}

Json Writer::energy_json() const {
  struct Term {
    const char *variable, *kind, *label;
  };
  static constexpr Term kTerms[] = {
      {"work_m", "in", "motors"},
      {"work_e", "in", "external forces"},
      {"drawn", "in", "from the mains"},
      {"energy_kinetic", "stored", "kinetic"},
      {"energy_potential", "stored", "potential"},
      {"energy_elastic", "stored", "elastic"},
      {"stored", "stored", "DC link"},
      {"energy_dissipated", "lost", "friction"},
      {"copper", "lost", "windings"},
      {"converter", "lost", "converters"},
      {"iron", "lost", "iron"},
      {"chopped", "lost", "brake resistors"},
      {"idle", "lost", "stand-by, brakes"},
      {"controller_energy", "lost", "controller"},
      {"supply_losses", "lost", "supply"},
  };
  Json terms = Json::array();
  for (const Term& term : kTerms) {
    for (const RecordedSignal& signal : recorded_.signals) {
      const std::size_t dot = signal.name.rfind('.');
      if (dot == std::string::npos || signal.name.substr(dot + 1) != term.variable) continue;
      terms.push_back({{"signal", signal.name}, {"kind", term.kind}, {"label", term.label}});
    }
  }
  return terms;
}

Json Writer::write() {
  Json json;
  json["robots"] = Json::array();
  for (const StagedModel& model : stage_.models) {
    json["robots"].push_back(robot_json(model));
    if (!content_.live) continue;
    Json& robot = json["robots"].back();
    robot["inertias"] = Json::array();
    for (const robot::Body& body : model.model->bodies) robot["inertias"].push_back(inertia_json(body.inertia));
    robot["base_inertia"] = inertia_json(model.model->base.inertia);
  }
  json["figures"] = Json::array();
  for (std::size_t i = 0; i < stage_.robots.size(); ++i) json["figures"].push_back(figure_json(stage_.robots[i], i));
  json["bodies"] = Json::array();
  std::string still;
  for (const StagedBody& staged : stage_.bodies) {
    if (!staged.shown) continue;
    const std::string p = staged.prefix + ".p", quat = staged.prefix + ".quat";
    Json body = {{"name", staged.body.name},
                 {"fixed", staged.body.motion == scene::Motion::kStatic},
                 {"ghost", is_of_ghost(stage_, staged.prefix)}};
    add_pose(body, staged.body.X_WB);
    body["p_signal"] = is_recorded(p, 3) ? p : "";
    body["quat_signal"] = is_recorded(quat, 4) ? quat : "";
    if (staged.comes) {
      const std::string present = staged.prefix + ".present", scale = staged.prefix + ".scale";
      body["obstacle"] = {{"present", staged.present ? 1.0 : 0.0},
                          {"present_signal", is_recorded(present, 1) ? present : ""},
                          {"scale", staged.scale},
                          {"scale_signal", is_recorded(scale, 1) ? scale : ""}};
    }
    body["visuals"] = visuals_.write(staged.body.shapes);
    json["bodies"].push_back(std::move(body));
    const bool moves = staged.body.motion != scene::Motion::kStatic || staged.comes;
    if (moves && (!is_recorded(p, 3) || !is_recorded(quat, 4)) && still.size() < 200) text::append(still, p + " and " + quat);
  }
  if (!still.empty())
    remarks_.push_back("bodies stand where they were at the start, because their poses are not recorded; record " + still);
  json["clouds"] = Json::array();
  for (const collision::PlacedCell::Cloud& staged : stage_.clouds) {
    try {
      json["clouds"].push_back(cloud_json(staged.by, staged.file, staged.X_WC, packer_, remarks_));
    } catch (const Error& error) {
      remarks_.push_back(std::string("a point cloud is left out: ") + error.what());
    }
  }
  json["meshes"] = visuals_.meshes();
  json["contacts"] = contacts_json();
  json["contacts_lack"] = stage_.worlds.empty()
                              ? "the scenario has no contact world"
                              : "record " + stage_.worlds.front() + ".contact_p and " + stage_.worlds.front() + ".contact_f";
  json["forces"] = forces_json();
  json["distances"] = distances_json();
  json["lights"] = Json::array();
  for (const std::string& prefix : stage_.monitors) {
    if (is_recorded(prefix + "zone", 1))
      json["lights"].push_back({{"name", prefix.substr(0, prefix.size() - 1)}, {"zone", prefix + "zone"}});
  }
  const std::string any = stage_.monitors.empty() ? "" : stage_.monitors.front();
  json["distances_lack"] = !json["distances"].empty() ? ""
                           : any.empty()              ? "the scenario has no unit:monitor"
                                                      : "record " + any + "p_a, " + any + "p_b and " + any + "distance";
  json["profiles"] = profiles_json();
  const std::string scanner = stage_.scanners.empty() ? "" : stage_.scanners.front();
  json["profiles_lack"] = !json["profiles"].empty() ? ""
                          : scanner.empty()         ? "the scenario has no unit:scanner"
                                                    : "record " + scanner + "ranges, " + scanner + "p_scan, " + scanner +
                                                  "quat_scan and " + scanner + "angle_increment";
  json["energy"] = energy_json();
  json["energy_lacks"] =
      "record the energies of a drive train, for example drive.energy_* and drive.work_*, or of a unit energy";
  return json;
}

}  // namespace

Json stage_json(const StageContent& content, const std::vector<std::size_t>& rows, CalculatedTable& calculated, Packer& packer,
                std::vector<std::string>& remarks) {
  return Writer(content, rows, calculated, packer, remarks).write();
}

}  // namespace cotwin::master
