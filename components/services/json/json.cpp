#include "components/services/json/json.h"

#include <algorithm>
#include <cmath>

#include "components/services/json/answers.h"
#include "components/services/json/move_json.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

using Answer = Json (*)(const Robot&, Reader&, const Context&);
constexpr std::pair<const char*, Answer> kServices[] = {
    {"feasibility", answer_feasibility},
    {"cycle_time", answer_cycle_time},
    {"energy", answer_energy},
    {"torques", answer_torques},
    {"peak_power", answer_peak_power},
    {"jerk", answer_jerk},
    {"effective_mass", answer_effective_mass},
    {"safety", answer_safety},
    {"throughput", answer_throughput},
    {"optimise", answer_optimise},
    {"verify", answer_verify},
};

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
  for (const auto& [name, answer] : kServices)
    if (service == name) return context.only_read ? answer(robot, r, context) : with_notes(answer(robot, r, context), robot);
  r.word("service", service_names());
  throw RequestError("/service", "is unknown");
}

/// Whether a number is NaN; infinite ones are written as null and mean that there is none.
bool has_nan(const Json& value) {
  if (value.is_number_float()) return std::isnan(value.get<double>());
  return value.is_structured() && std::ranges::any_of(value, has_nan);
}

std::string text_of(const Json& reply) {
  if (has_nan(reply))
    throw Error("reply", "contains a value that is not a number, expected finite ones: see the robot's inertias");
  return reply.dump();
}

}  // namespace

std::vector<std::string> service_names() {
  std::vector<std::string> names;
  for (const auto& [name, answer] : kServices) names.emplace_back(name);
  return names;
}

RequestError::RequestError(const std::string& pointer, const std::string& detail)
    : Error(pointer.empty() ? "request" : pointer, detail), pointer_(pointer), detail_(detail) {}

std::string answer(const Robot& robot, std::string_view request, const Context& context) {
  const Json object = parse_object(request);
  Reader r(object);
  if (const std::string name = r.text("robot", robot.name); name != robot.name)
    throw RequestError("/robot", "is '" + name.substr(0, 40) + "', expected '" + robot.name + "'");
  return text_of(reply_to(robot, r, context));
}

std::string answer(const robot::RobotModel& model, std::string_view request, numerics::Threads* threads) {
  Robot robot;
  robot.name = model.name;
  robot.model = model;
  Context context;
  context.threads = threads;
  return answer(robot, request, context);
}

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
  Reader r(object);
  const std::shared_ptr<const Robot> robot = robot_of(robots, r);
  return text_of(reply_to(*robot, r, context));
}

void check_object(Robots& robots, const Json& object) {
  Reader r(object);
  const std::shared_ptr<const Robot> robot = robot_of(robots, r);
  Context context;
  context.only_read = true;
  (void)reply_to(*robot, r, context);
}

std::string posture_member(Robots& robots, const Json& request, const std::string& plain) {
  Reader r(request);
  return JointUnits(robot_of(robots, r)->model).name(plain, 0);
}

std::string problem(const std::exception& error) {
  Json p{{"title", "The request cannot be answered"}, {"detail", error.what()}};
  if (const auto* e = dynamic_cast<const RequestError*>(&error)) {
    p["detail"] = e->detail();
    if (!e->pointer().empty()) p["pointer"] = e->pointer();
  }
  return p.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace cotwin::services
