#include "components/services/json/clear_json.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "components/services/json/loads_json.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose_values.h"
#include "models/scene/urdf/urdf_shapes.h"

namespace cotwin::services {

namespace {

using collision::PlacedCell;

constexpr std::size_t kMostRobots = 20, kMostTools = 20;

Pose read_base(Reader& r, const char* what) {
  const auto read = [](Reader& own) { return read_pose(own, "in the scene; without it 0"); };
  if (r.describes()) r.declare("base", Reader::schema_of([&](Reader& own) { (void)read(own); }), false, what);
  const Json* const given = r.any("base");
  if (!given) return {};
  Reader own(*given, r.pointer("base"));
  const Pose X_WB = read(own);
  own.finish();
  return X_WB;
}

collision::Tool read_tool(const Robot& robot, Reader& r, const std::string& name, const Context& context,
                          std::vector<std::string>& notes) {
  collision::Tool tool;
  tool.name = r.text("name", name, "in names of links, beside those of the robot");
  const std::string frame = r.text("frame", {}, "of the robot that carries it, such as a link");
  const Pose X_FA = read_pose(r, "in that frame, of the root link or the middle of the box; without it 0");
  r.declare("urdf", schemas::kText, false,
            "tools/NAME.urdf beside the folder with robots, with collision shapes; on the command line also a path");
  const std::vector<double> box = r.vector("box_m", 3, true, "edges, in place of a URDF");
  if (r.describes()) return tool;
  if (r.has("urdf") == !box.empty())
    throw RequestError(r.pointer("urdf"), box.empty() ? "and box_m are missing, expected one of them"
                                                      : "is given beside box_m, expected one of them");
  robot::Frame carrier;
  try {
    carrier = robot.model.frame(frame);
  } catch (const Error& error) {
    throw RequestError(r.pointer("frame"), error.what());
  }
  tool.link = carrier.body;
  const Pose X_BA = carrier.X_BF * X_FA;
  if (box.empty()) {
    const std::string urdf = r.text("urdf");
    try {
      tool.shapes = context.robots->tool_shapes(urdf, X_BA, notes);
      if (tool.shapes.empty()) throw Error(urdf, "has no <collision> shapes, so it would meet nothing");
    } catch (const Error& error) {
      throw RequestError(r.pointer("urdf"), error.what());
    }
    return tool;
  }
  tool.shapes = box_of(r, box, X_BA);
  return tool;
}

std::vector<collision::Tool> read_tools(const Robot& robot, Reader& r, const Context& context,
                                        std::vector<std::string>& notes) {
  std::vector<collision::Tool> tools;
  if (r.describes())
    r.declare("tools",
              schemas::array_of(Reader::schema_of([&](Reader& own) { (void)read_tool(robot, own, "", context, notes); })),
              false, "what it carries");
  const Json* const given = r.any("tools");
  if (given && (!given->is_array() || given->size() > kMostTools))
    throw RequestError(r.pointer("tools"), "is no array of at most " + std::to_string(kMostTools) + " tools");
  for (std::size_t k = 0; given && k < given->size(); ++k) {
    Reader own((*given)[k], r.pointer("tools") + "/" + std::to_string(k));
    collision::Tool tool = read_tool(robot, own, "tool_" + std::to_string(k + 1), context, notes);
    own.finish();
    if (std::ranges::find(tools, tool.name, &collision::Tool::name) != tools.end() ||
        std::ranges::find(robot.model.frames, tool.name, &robot::Frame::name) != robot.model.frames.end())
      throw RequestError(own.pointer("name"), "'" + tool.name + "' is there twice, expected a name of its own");
    tools.push_back(std::move(tool));
  }
  return tools;
}

PlacedCell::Robot placed(const Robot& robot, std::string name, const Pose& X_WB, std::string by,
                         std::vector<collision::Tool> tools, std::vector<std::string>& notes) {
  PlacedCell::Robot one{{std::move(name), robot.model, {}}, X_WB, std::move(tools)};
  one.by = std::move(by);
  if (robot.urdf.empty())
    one.robot.shapes.resize(robot.model.bodies.size() + 1);
  else
    one.robot.shapes = scene::hulls_of_urdf(robot.urdf, robot.model, &notes);
  return one;
}

std::string placed_by(Reader& r) { return r.has("base") ? "request" : ""; }

/// One of the other robots: where it stands, and its posture or motion.
std::pair<std::string, collision::Motion> read_other(const Robot& robot, Reader& r, Pose& X_WB) {
  std::string name = r.text("name", robot.name, "in names of links, name/link; without it that of the robot");
  X_WB = read_base(r, "where its base stands");
  collision::Motion motion;
  if (r.describes())
    r.declare("series", Reader::schema_of([&](Reader& own) { (void)read_series(robot, own); }), false,
              "its motion; t_s counts from the beginning of the move");
  if (const Json* const given = r.any("series")) {
    Reader series(*given, r.pointer("series"));
    motion.path = read_series(robot, series);
  }
  motion.q =
      JointUnits(robot.model).read(r, "q", 0, r.describes() || motion.path.joints() > 0, "posture, in place of a motion");
  if (!motion.q.empty() && motion.path.joints() > 0)
    throw RequestError(r.pointer("series"), "is given beside a posture, expected one of them");
  if (!r.describes() && motion.path.joints() == 0 && motion.q.size() != robot.model.joints.size())
    throw RequestError(r.pointer(JointUnits(robot.model).name("q", 0).c_str()),
                       "has " + std::to_string(motion.q.size()) + " values, expected " +
                           std::to_string(robot.model.joints.size()) + ", one per joint");
  return {std::move(name), std::move(motion)};
}

PlacedCell::Cloud read_cloud(Reader& r, const Context& context, std::vector<std::string>& notes) {
  PlacedCell::Cloud placed;
  placed.by = "request";
  const std::string name = r.text("name", {},
                                  "scenes/NAME/scene.pcd or scenes/NAME.pcd beside the folder with robots; on the command line "
                                  "also a path (.pcd, .ply, .xyz, .csv)");
  r.declare("radius_m", {{"type", "number"}, {"minimum", 0}}, false,
            "of the ball around each point; without it half of the spacing that 95 % of the points have");
  placed.X_WC = read_pose(r, "of its frame in the scene; without it 0");
  if (r.describes()) return placed;
  std::shared_ptr<const cloud::Obstacle> cloud;
  try {
    cloud = context.robots->cloud(name, notes);
  } catch (const Error& error) {
    throw RequestError(r.pointer("name"), error.what());
  }
  placed.points = cloud->points;
  placed.radius = r.not_negative("radius_m", cloud->touching());
  if (std::string gaps = cloud->gaps("radius_m", placed.radius); !gaps.empty()) notes.push_back(std::move(gaps));
  r.finish();
  return placed;
}

}  // namespace

std::optional<ClearOf> ClearOf::read(const Robot& robot, Reader& r, const Context& context,
                                     const std::vector<collision::Tool>& carried) {
  PlacedCell cell;
  collision::Options options;
  std::vector<std::pair<std::string, collision::Motion>> others;
  ClearOf clear;
  const auto read = [&](Reader& own) {
    const std::string scene = own.text("scene", "", "name of a scene: scenes/NAME/scene.sdf beside the folder with robots");
    if (own.describes())
      own.declare("cloud", Reader::schema_of([&](Reader& points) { (void)read_cloud(points, context, clear.notes_); }), false,
                  "a point cloud beside the scene, or in its place");
    if (const Json* const given = own.any("cloud")) {
      Reader points(*given, own.pointer("cloud"));
      cell.clouds.push_back(read_cloud(points, context, clear.notes_));
    }
    options.clearance = clear.clearance_ = own.not_negative("clearance_m", 0, "less than this is not clear");
    options.self = own.boolean("self", false, "links of the robot that are no neighbours must not touch, either");
    cell.ignore = own.texts("ignore", {}, "pairs of links and bodies that do not count: link_5:table");
    const Pose X_WB = read_base(own, "where the base of the robot stands");
    std::vector<collision::Tool> tools = read_tools(robot, own, context, clear.notes_);
    if (own.describes())
      own.declare("robots", schemas::array_of(Reader::schema_of([](Reader& other) {
                    other.declare("robot", schemas::kText, true, "name of a robot");
                    Pose unused;
                    (void)read_other({}, other, unused);
                    std::vector<std::string> none;
                    (void)read_tools({}, other, {}, none);
                  })),
                  false, "other robots");
    const Json* const robots = own.any("robots");
    if (own.describes()) return;
    if (scene.empty() && cell.clouds.empty() && !robots && !options.self)
      throw RequestError(own.pointer("scene"),
                         "is missing, and there are no cloud, no robots and no self, expected one of them");
    try {
      if (!scene.empty()) cell.add(context.robots->scene(scene, clear.notes_));
    } catch (const Error& error) {
      throw RequestError(own.pointer("scene"), error.what());
    }
    for (const collision::Tool& payload : carried) {
      if (std::ranges::find(tools, payload.name, &collision::Tool::name) != tools.end())
        throw RequestError(own.pointer("tools"), "has '" + payload.name + "', which is a payload, too, expected one of them");
      tools.push_back(payload);
      clear.timed_ = clear.timed_ || payload.from > 0 || payload.until < 1;
    }
    const std::size_t first = tools.size() - carried.size();
    cell.robots.push_back(placed(robot, "", X_WB, placed_by(own), std::move(tools), clear.notes_));
    clear.motions_.resize(1);
    if (robots && (!robots->is_array() || robots->size() > kMostRobots))
      throw RequestError(own.pointer("robots"), "is no array of at most " + std::to_string(kMostRobots) + " robots");
    std::set<std::string> names;
    for (std::size_t k = 0; robots && k < robots->size(); ++k) {
      Reader other((*robots)[k], own.pointer("robots") + "/" + std::to_string(k));
      std::shared_ptr<const Robot> found;
      try {
        found = context.robots->find(other.text("robot"));
      } catch (const RequestError&) {
        throw;
      } catch (const Error& error) {
        throw RequestError(other.pointer("robot"), error.what());
      }
      Pose place;
      auto [name, motion] = read_other(*found, other, place);
      tools = read_tools(*found, other, context, clear.notes_);
      const std::string by = placed_by(other);
      other.finish();
      if (!names.insert(name).second)
        throw RequestError(other.pointer("name"), "'" + name + "' is there twice, expected a name for each robot");
      cell.robots.push_back(placed(*found, name, place, by, std::move(tools), clear.notes_));
      clear.motions_.push_back(std::move(motion));
    }
    own.finish();
    clear.places_ = collision::places(cell);
    clear.make_ = [cell = std::move(cell), options, first](double begin, double T) {
      PlacedCell timed = cell;
      for (std::size_t k = first; k < timed.robots.front().tools.size(); ++k) {
        collision::Tool& payload = timed.robots.front().tools[k];
        payload.from = payload.from > 0 ? begin + payload.from * T : -scene::kInfinity;
        payload.until = payload.until < 1 ? begin + payload.until * T : scene::kInfinity;
      }
      return std::make_unique<collision::Checker>(std::move(timed), options);
    };
    try {
      clear.checker_ = clear.make_(clear.begin_, clear.T_);
    } catch (const Error& error) {
      throw RequestError(r.pointer("clear_of"), error.what());
    }
    const std::vector<std::string>& notes = clear.checker_->notes();
    clear.notes_.insert(clear.notes_.end(), notes.begin(), notes.end());
  };
  if (r.describes()) r.declare("clear_of", Reader::schema_of(read), false, "what the motion keeps clear of");
  const Json* const given = r.any("clear_of");
  if (!given) return {};
  Reader own(*given, r.pointer("clear_of"));
  read(own);
  return clear;
}

collision::Verdict ClearOf::check(const trajectory::Path& path) {
  motions_.front().path = path;
  if (const double T = path.end() - path.begin(); timed_ && (path.begin() != begin_ || T != T_)) {
    begin_ = path.begin();
    T_ = T;
    checker_ = make_(begin_, T_);
  }
  return checker_->check(motions_);
}

std::string ClearOf::reason(const collision::Verdict& verdict) const {
  if (verdict.clear) return "";
  const collision::Nearest& n = verdict.nearest;
  const bool meets = clearance_ == 0 || n.d < 0;
  return n.link + (meets ? " meets " : " comes nearer than " + text::to_text(clearance_) + " m to ") + n.other + " at " +
         text::to_text(n.t, 4) + " s";
}

Json ClearOf::json(const collision::Verdict& verdict, Json& reply) const {
  const collision::Nearest& n = verdict.nearest;
  Json nearest;
  const auto point = [](const Eigen::Vector3d& p) { return Json{p.x(), p.y(), p.z()}; };
  if (std::isfinite(n.d))
    nearest = {{"t_s", n.t},
               {"link", n.link},
               {"obstacle", n.other},
               {"distance_m", n.d},
               {"p_link_m", point(n.p_link)},
               {"p_obstacle_m", point(n.p_other)}};
  add_notes(reply, notes_);
  return {{"clear", verdict.clear}, {"nearest", nearest}, {"places", places_json(places_)}};
}

Json places_json(const std::vector<collision::Place>& places) {
  Json all = Json::array();
  for (const collision::Place& place : places) {
    const Eigen::Vector3d& p = place.X_W.p;
    std::vector<double> quat;
    put_quaternion(place.X_W.R, quat);
    all.push_back({{"name", place.name}, {"p_m", {p.x(), p.y(), p.z()}}, {"quaternion_wxyz", quat}});
    if (place.radius > 0) all.back()["radius_m"] = place.radius;
    all.back()["by"] = place.by.empty() ? Json() : Json(place.by);
  }
  return all;
}

void ClearOf::judge(const trajectory::Path& path, Json& reply, Verdict& verdict) {
  const collision::Verdict found = check(path);
  verdict.add(Of::kClearOf, found.clear, reason(found));
  reply["clear_of"] = json(found, reply);
}

}  // namespace cotwin::services
