#include "components/services/json/loads_json.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

constexpr std::size_t kMostPayloads = 8;
constexpr double kTooLarge = 1e15;  // products of larger numbers are not finite

/// Runs read(), with an Error as one of the member.
template <class Read>
auto at_member(const Reader& r, const char* name, Read read) {
  try {
    return read();
  } catch (const RequestError&) {
    throw;
  } catch (const Error& error) {
    throw RequestError(r.pointer(name), error.what());
  }
}

/// `model`: the robot with the earlier payloads.
robot::Payload read_payload(const robot::RobotModel& model, const std::string& end_effector, Reader& r, const std::string& name,
                            const Context& context, const Takes& takes, MoveRequest& m) {
  robot::Payload payload;
  payload.part.name = r.text("name", name, "of its frame, for further payloads and the wrench");
  payload.part.parent = r.text("frame", end_effector, "that carries it; without it the end effector");
  payload.part.X_PA = read_pose(r, "in that frame; without it 0");
  const std::string tool =
      r.text("tool", "", "tools/NAME.urdf beside the folder with robots, in place of the mass; its other links are frames");
  const std::vector<double> box = r.vector("box_m", 3, true, "edges of its shape for clear_of, about its frame");
  if (takes.intervals) payload.when = read_interval(r);
  if (!tool.empty()) {
    for (const char* other : {"mass_kg", "com_m", "inertia_kg_m2", "box_m"})
      if (r.gives(other)) throw RequestError(r.pointer(other), "is given beside a tool, expected one of them");
    robot::Attachment part = at_member(r, "tool", [&] { return context.robots->tool(tool, payload.part.name); });
    payload.part.inertia = part.inertia;
    payload.part.further = std::move(part.further);
  } else {
    payload.part.inertia = read_inertia(r, true, "in place of a tool", "centre of mass in its frame; without it the origin");
  }
  r.finish();
  if (r.describes()) return payload;
  const robot::Frame carrier = at_member(r, "frame", [&] { return model.frame(payload.part.parent); });
  for (const robot::Payload& below : m.loads.payloads) {
    const bool on_it =
        below.part.name == payload.part.parent ||
        std::ranges::find(below.part.further, payload.part.parent, &robot::PartFrame::name) != below.part.further.end();
    if (on_it && (payload.when.from < below.when.from || payload.when.to > below.when.to))
      throw RequestError(r.pointer("frame"), "is on the payload " + below.part.name + ", which is not carried all that time");
  }
  const Pose X_BA = carrier.X_BF * payload.part.X_PA;
  collision::Tool shape{payload.part.name, carrier.body, box_of(r, box, X_BA), payload.when.from, payload.when.to};
  if (!tool.empty()) shape.shapes = at_member(r, "tool", [&] { return context.robots->tool_shapes(tool, X_BA, m.notes); });
  if (!shape.shapes.empty()) m.carried.push_back(std::move(shape));
  return payload;
}

robot::ExternalWrench read_wrench(const std::string& end_effector, Reader& r) {
  robot::ExternalWrench wrench;
  wrench.frame.name = r.text("frame", end_effector, "at whose origin it acts; without it the end effector");
  r.declare_one_of({"force_N", "moment_Nm"});
  if (!r.has("force_N") && !r.has("moment_Nm"))
    throw RequestError(r.pointer("force_N"), "and moment_Nm are missing, expected one of them");
  wrench.f << read_vector<3>(r, "force_N", true, "of the surroundings on the robot"),
      read_vector<3>(r, "moment_Nm", true, "of the surroundings on the robot, about the frame's origin");
  wrench.in_frame = r.word("axes", {"base", "frame"}, "in which both are constant") == "frame";
  wrench.when = read_interval(r);
  r.finish();
  return wrench;
}

}  // namespace

Pose read_pose(Reader& r, const char* what) {
  Pose X;
  X.p = read_vector<3>(r, "p_m", true, what);
  const std::vector<double> Q = r.vector("quaternion_wxyz", 4, true, "without it not turned");
  if (Q.empty()) return X;
  const Eigen::Quaterniond turned(Q[0], Q[1], Q[2], Q[3]);
  if (!(std::abs(turned.norm() - 1) < 1e-3))
    throw RequestError(r.pointer("quaternion_wxyz"), "has the length " + text::to_text(turned.norm()) + ", expected 1");
  X.R = turned.normalized().toRotationMatrix();
  return X;
}

Inertia read_inertia(Reader& r, bool may_be_point, const char* of_mass, const char* of_com) {
  Inertia body;
  body.mass = r.positive("mass_kg", {}, of_mass);
  if (!(body.mass < kTooLarge))
    throw RequestError(r.pointer("mass_kg"), "is " + text::to_text(body.mass) + ", expected less than 1e15");
  body.p_LC = read_vector<3>(r, "com_m", true, of_com);
  const auto I =
      read_vector<6>(r, "inertia_kg_m2", may_be_point, "xx, xy, xz, yy, yz, zz about the centre of mass in its axes");
  body.I_CC << I[0], I[1], I[2], I[1], I[3], I[4], I[2], I[4], I[5];
  return body;
}

std::vector<scene::Shape> box_of(Reader& r, const std::vector<double>& edges, const Pose& X_BA) {
  if (edges.empty()) return {};
  if (!(*std::ranges::min_element(edges) > 0))
    throw RequestError(r.pointer("box_m"), "has an edge of 0 or less, expected lengths");
  std::vector<scene::Shape> shapes(1);
  shapes.front().type = scene::ShapeType::kBox;
  shapes.front().size = {edges[0], edges[1], edges[2]};
  shapes.front().X_BS = X_BA;
  return shapes;
}

robot::Interval read_interval(Reader& r) {
  robot::Interval when;
  const auto read = [&](const char* name, double other, const char* what) {
    r.declare(name, {{"type", "number"}, {"minimum", 0}, {"maximum", 1}, {"default", other}}, false, what);
    const double share = r.number(name, other);
    if (!(share >= 0 && share <= 1)) throw RequestError(r.pointer(name), "is " + Json(share).dump() + ", expected 0 to 1");
    return share;
  };
  when.from = read("from_share", 0, "of the duration, from which on it acts");
  when.to = read("to_share", 1, "of the duration, up to which it acts");
  if (!(when.from < when.to))
    throw RequestError(r.pointer("to_share"),
                       "is " + Json(when.to).dump() + ", expected more than from_share, which is " + Json(when.from).dump());
  return when;
}

void read_loads(const Robot& robot, Reader& r, const Context& context, const Takes& takes, MoveRequest& m) {
  if (r.describes()) {
    const Json one = Reader::schema_of([&](Reader& own) { (void)read_payload({}, "", own, "", context, takes, m); });
    const Json all{{"anyOf", {one, schemas::kText}}};
    r.declare("payload", {{"anyOf", {one, schemas::kText, {{"type", "array"}, {"items", all}, {"maxItems", kMostPayloads}}}}},
              false,
              "what the robot carries: mass_kg or tool, the name of a tool, or several, which may be mounted on earlier ones");
    if (takes.wrench)
      r.declare("wrench", Reader::schema_of([&](Reader& own) { (void)read_wrench("", own); }), false, "what pushes the robot");
    return;
  }
  robot::RobotModel carrying = robot.model;
  const auto end_effector = [&](const char* name) {
    return at_member(r, name, [&] { return robot.model.end_effector().name; });
  };
  if (const Json* const given = r.any("payload")) {
    const bool several = given->is_array();
    const std::string place = r.pointer("payload");
    const std::size_t count = several ? given->size() : 1;
    if (count == 0 || count > kMostPayloads)
      throw RequestError(place, "has " + std::to_string(count) + " payloads, expected 1 to " + std::to_string(kMostPayloads));
    for (std::size_t k = 0; k < count; ++k) {
      const Json& one = several ? (*given)[k] : *given;
      const Json named{{"tool", one}};
      Reader own(one.is_string() ? named : one, several ? place + "/" + std::to_string(k) : place);
      m.loads.payloads.push_back(
          read_payload(carrying, end_effector("payload"), own, "payload_" + std::to_string(k + 1), context, takes, m));
      try {
        attach(carrying, m.loads.payloads.back().part);
        (void)robot::LoadedDynamics(robot.model, m.loads);
      } catch (const Error& error) {
        throw RequestError(several ? place + "/" + std::to_string(k) : place, error.what());
      }
    }
  }
  const Json* const given = takes.wrench ? r.any("wrench") : nullptr;
  if (!given) return;
  Reader own(*given, r.pointer("wrench"));
  m.loads.wrench = read_wrench(end_effector("wrench"), own);
  m.loads.wrench->frame = at_member(own, "frame", [&] { return carrying.frame(m.loads.wrench->frame.name); });
}

}  // namespace cotwin::services
