#include "components/services/json/json.h"

#include <algorithm>
#include <cmath>

#include "components/services/assumptions.h"
#include "components/services/json/answers/answers.h"
#include "components/services/json/control/control.h"
#include "components/services/json/move_json.h"
#include "components/services/json/schema_parts.h"
#include "models/foundation/support/text.h"
#include "models/numerics/device/device.h"

namespace cotwin::services {

namespace {

struct Service {
  const char *name, *description;
  Json (*answer)(const Robot&, Reader&, const Context&);
};
constexpr Service kServices[] = {
    {"feasibility", "Can the robot make the move? Names joint, time and bound.", answer_feasibility},
    {"cycle_time", "The shortest duration of the move within the bounds.", answer_cycle_time},
    {"energy", "What the move costs: books from the mains to the joints, and the duration of least energy.", answer_energy},
    {"torques", "Torques of the move by terms: inertia, Coriolis, gravity, drives.", answer_torques},
    {"peak_power", "The largest mechanical power of the motors, drawn and returned.", answer_peak_power},
    {"jerk", "Jerk of the move against its bound and against the quintic of the same duration.", answer_jerk},
    {"effective_mass", "Mass that a frame shows along the move. null: it cannot move in that direction.",
     answer_effective_mass},
    {"safety", "Speeds of a frame against limits of body parts (ISO/TS 15066). Not a proof of safety.", answer_safety},
    {"manipulability", "Velocities and accelerations that a frame can have along the move: where they are least and greatest.",
     answer_manipulability},
    {"payload", "The largest mass that the robot can carry at a frame during the move.", answer_payload},
    {"reach", "Can a frame get to these poses, and which bound of a joint forbids it?", answer_reach},
    {"reaction", "What a motion does to the free base of a robot: its turn, rate and displacement (V-C).", answer_reaction},
    {"reactionless", "A motion to a posture or pose that does not turn the free base of a robot, and what it costs (V-C).",
     answer_reactionless},
    {"throughput", "Time of a cycle and moves per hour when a compliance M x'' + D x' + S x must settle after the move.",
     answer_throughput},
    {"optimise", "The better motion: redundant coefficients and duration of least cost within the bounds.", answer_optimise},
    {"grow", "What is possible between postures: costs and bounds of very many motions that are drawn at random (V-B).",
     answer_grow},
    {"verify",
     "The move in a co-simulation of the twin, with elastic joints and friction where the robot has data of its drives.",
     answer_verify},
};

/// Whether the costs of an optimisation have this one.
bool has_cost(Reader& r, const char* name) {
  const Json* cost = r.any("cost");
  if (!cost) return false;
  if (!cost->is_array()) return *cost == name;
  return std::ranges::any_of(*cost, [&](const Json& one) { return one.value("name", "") == name; });
}

/// Adds "assumptions" and a sentence to the notes, if there are any.
void add_assumptions(const std::string& service, const Robot& robot, Reader& r, Json& reply) {
  const auto is = [&](const char* name, const Json& value) { return r.gives(name) && *r.any(name) == value; };
  const bool grow = service == "grow", optimise = grow || service == "optimise",
             path = r.gives("series") || r.gives("waypoints");
  Needs n;
  n.searched = !path && !r.gives("T_s") && (!optimise || r.gives("T_max_s"));
  if (service == "reach" || (grow && is("constraint", "base"))) return;  // of the shape alone
  const bool safety = service == "safety" || (optimise && has_cost(r, "safety"));
  n.contact = safety || service == "effective_mass" || (optimise && has_cost(r, "effective_mass"));
  if (is("drives", "none")) n.without_drives = "request: drives = none";
  const JointUnits units(robot.model);
  n.limits_of_speed = !r.gives(units.name("dq_max", 1).c_str());
  n.limits_of_torque = !r.gives(units.name("tau_max", 4).c_str());
  if (safety && r.gives("load_kg")) n.load = r.number("load_kg");
  n.elastic = n.without_drives.empty() && (service == "verify" || is("verify", true));
  n.energy = service == "energy" || (optimise && has_cost(r, "energy")) || (grow && !r.gives("cost") && robot.energy) ||
             (service == "verify" && robot.energy);
  std::string assumed;
  std::vector<std::pair<std::string, std::string>> unknown;  // names, effect
  for (const Assumption& a : assumptions(robot, n)) {
    const Json value = a.value.empty() ? Json(nullptr) : a.value.size() == 1 ? Json(a.value[0]) : Json(a.value);
    reply["assumptions"].push_back({{"what", a.what}, {"value", value}, {"effect", a.effect}, {"file", a.file}});
    if (a.unknown && (unknown.empty() || unknown.back().second != a.effect)) unknown.push_back({"", a.effect});
    text::append(a.unknown ? unknown.back().first : assumed, a.what);
  }
  for (const auto& [what, effect] : unknown) add_notes(reply, {"unknown: " + what + "; " + effect});
  if (!assumed.empty()) add_notes(reply, {"assumed, not measured: " + assumed + "; the answer is as uncertain"});
}

/// The reply with the notes on the robot before its own, as the last member.
Json with_notes(Json reply, const Robot& robot) {
  const Json own = reply.value("notes", Json::array());
  reply.erase("notes");
  add_notes(reply, robot.notes);
  for (const Json& note : own) reply["notes"].push_back(note);
  return reply;
}

Json reply_to(const Robot& robot, Reader& r, const Context& context) {
  const std::string service = r.text("service");
  for (const auto& [name, description, answer] : kServices)
    if (service == name) {
      Json reply;
      try {
        reply = answer(robot, r, context);
      } catch (const numerics::DeviceError& e) {
        throw RequestError("/device", std::string("is gpu, expected auto or cpu: ") + e.what());
      }
      if (context.only_read) return reply;
      add_assumptions(service, robot, r, reply);
      return with_notes(std::move(reply), robot);
    }
  r.word("service", service_names());
  throw RequestError("/service", "is unknown");
}

/// Whether a number is NaN; infinite ones are written as null and mean that there is none.
bool has_nan(const Json& value) {
  if (value.is_number_float()) return std::isnan(value.get<double>());
  return value.is_structured() && std::ranges::any_of(value, has_nan);
}

void must_be_finite(const Json& reply) {
  if (has_nan(reply))
    throw Error("reply", "contains a value that is not a number, expected finite ones: see the robot's inertias");
}

}  // namespace

std::vector<std::string> service_names() {
  std::vector<std::string> names;
  for (const Service& service : kServices) names.emplace_back(service.name);
  return names;
}

std::string schema(const std::string& name) {
  constexpr const char* kDialect = "https://json-schema.org/draft/2020-12/schema";
  const auto* const service = std::ranges::find(kServices, name, &Service::name);
  if (service == std::end(kServices))
    throw Error("schema", "'" + name + "' is no service, expected one of those that service_names() lists");
  Json request = Reader::schema_of([&](Reader& r) {
    r.declare("service", {{"const", name}}, true);
    r.text("robot", "", "name of a robot");
    r.declare("locked_q", {{"type", "object"}, {"additionalProperties", schemas::kNumber}}, false,
              "joints that stand still, by name: position in rad or m");
    (void)service->answer({}, r, {});
  });
  Json reply = reply_schema(name);
  add_control_schemas(name, request, reply);
  request["$schema"] = reply["$schema"] = kDialect;
  return Json{{"title", name}, {"description", service->description}, {"request", request}, {"reply", reply}}.dump();
}

RequestError::RequestError(const std::string& pointer, const std::string& detail)
    : Error(pointer.empty() ? "request" : pointer, detail), pointer_(pointer), detail_(detail) {}

std::string answer(Robots& robots, std::string_view request, const Context& context) {
  return answer_object(robots, parse_object(request), context);
}

namespace {

std::shared_ptr<const Robot> robot_of(Robots& robots, Reader& r) {
  const std::string name = r.text("robot", robots.fallback());
  if (name.empty()) throw RequestError("/robot", "is missing, expected the name of a robot");
  std::map<std::string, double> locked;
  if (const Json* given = r.any("locked_q")) {
    Reader joints(*given, "/locked_q");
    for (const auto& [joint, unused] : given->items()) locked[joint] = joints.number(joint.c_str());
  }
  try {
    if (!locked.empty())
      for (const robot::Joint& joint : robots.find(name)->model.joints)
        if (const auto at = locked.find(joint.name);
            at != locked.end() && !(at->second >= joint.q_min && at->second <= joint.q_max))
          throw Error(joint.name, "is locked at " + text::to_text(at->second) + ", expected " + text::to_text(joint.q_min) +
                                      " to " + text::to_text(joint.q_max));
    return robots.find(name, locked);
  } catch (const Error& e) {
    throw RequestError(locked.empty() ? "/robot" : "/locked_q", e.what());
  }
}

}  // namespace

std::string answer_object(Robots& robots, const Json& object, const Context& context) {
  if (is_chain(object)) return answer_chain(robots, object, context);
  const auto given = [&](const char* name) { return object.is_object() && object.contains(name); };
  const Audience audience = audience_of(object, given("detail"));
  Json settled;
  if (!given("service") || given("choice") || !(audience.name.empty() || given("detail"))) {
    settled = object;
    choose(settled);
    if (!audience.name.empty() && !given("detail")) settled["detail"] = detail_for(audience.name);
  }
  const Json& request = settled.is_null() ? object : settled;
  Reader r(request);
  const std::shared_ptr<const Robot> robot = robot_of(robots, r);
  const Json choice = request.value("choice", Json());
  if (std::ranges::any_of(choices(), [&](const Choice& row) { return request["service"] == row.service; }))
    (void)r.has("choice");
  for (const char* own : {"audience", "require"}) (void)r.has(own);
  Context own = context;
  own.robots = &robots;
  Json reply;
  try {
    reply = reply_to(*robot, r, own);
  } catch (const RequestError& e) {
    if (choice.is_null()) throw;
    const Choice& row = row_of(choice);
    if (e.pointer().empty() ||
        (e.pointer() != std::string("/") + row.becomes && !Json::parse(row.sets).contains(Json::json_pointer(e.pointer()))))
      throw;
    throw RequestError(e.pointer(), e.detail() + "; the goal " + row.goal + " has set it, by the row " + row.name);
  }
  if (context.only_read) return "";
  must_be_finite(reply);
  return presented(request["service"], audience, choice, std::move(reply)).dump();
}

void check_object(Robots& robots, const Json& object) {
  if (is_chain(object)) return check_chain(robots, object);
  Context context;
  context.only_read = true;
  (void)answer_object(robots, object, context);
}

Json data_of(const Robot& robot) {
  const auto word = [](const auto& data) {
    if (!data) return "missing";
    return data->assumed == "all" ? "assumed" : data->assumed.empty() || data->assumed == "none" ? "given" : "partly assumed";
  };
  std::error_code none;
  const bool compliance = std::filesystem::is_regular_file(robot.urdf.parent_path() / kComplianceFile, none);
  return {{kDrivesFile, word(robot.drives)},
          {kComplianceFile, compliance ? "given" : "missing"},
          {kEnergyFile, word(robot.energy)}};
}

Json data_of_all(Robots& robots) {
  Json all = Json::object();
  for (const std::string& name : robots.names()) try {
      const std::shared_ptr<const Robot> robot = robots.find(name);
      all[name] = {{"joints", robot->model.joints.size()}};
      all[name].update(data_of(*robot));
    } catch (const Error& e) {
      all[name] = {{"problem", e.what()}};
    }
  return all;
}

std::string posture_member(Robots& robots, const Json& request, const std::string& plain) {
  Reader r(request);
  return JointUnits(robot_of(robots, r)->model).name(plain, 0);
}

Json series_member(Robots& robots, const Json& request, const std::filesystem::path& file, trajectory::RecordingFormat format) {
  Reader r(request);
  const std::shared_ptr<const Robot> robot = robot_of(robots, r);
  format.dq_columns = format.tau_columns = format.tau_e_columns = "none";
  const trajectory::Series q = trajectory::load_recording(file, trajectory::axes_of(robot->model), format).q;
  Json rows = Json::array();
  for (auto row = q.x.begin(); row != q.x.end(); row += static_cast<std::ptrdiff_t>(q.width))
    rows.push_back(std::vector<double>(row, row + static_cast<std::ptrdiff_t>(q.width)));
  return {{"t_s", q.t}, {JointUnits(robot->model).name("q", 0), rows}};
}

std::string problem(const std::exception& error) {
  Json p{{"title", "The request cannot be answered"}, {"detail", text::reason_of(error)}};
  if (const auto* e = dynamic_cast<const RequestError*>(&error)) {
    p["detail"] = e->detail();
    if (!e->pointer().empty()) p["pointer"] = e->pointer();
  }
  return p.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace cotwin::services
