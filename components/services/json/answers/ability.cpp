#include <algorithm>
#include <cmath>
#include <limits>

#include "components/services/ability_service.h"
#include "components/services/json/answers/answers.h"
#include "components/services/json/contact_json.h"
#include "components/services/json/end_pose_json.h"
#include "components/services/json/loads_json.h"
#include "models/foundation/support/text.h"
#include "models/robot/start.h"

namespace cotwin::services {

namespace {

constexpr std::size_t kMostPoses = 100;

Json array_of(const Eigen::VectorXd& v) { return std::vector<double>(v.begin(), v.end()); }

Json place(const ManipulabilityAt& at, bool dynamic) {
  return {{"t_s", at.t},
          {"measure", at.measure},
          {dynamic ? "translation_m_per_s2" : "translation_m_per_s", array_of(at.translation)},
          {dynamic ? "rotation_rad_per_s2" : "rotation_rad_per_s", array_of(at.rotation)}};
}

/// Why a pose is not reached: what is left, and what the bounds would have to be.
std::string obstacle(const robot::RobotModel& bounded, const PoseGoal& goal, const robot::PoseTarget& target,
                     const robot::Posture& best) {
  robot::RobotModel free = bounded;
  for (robot::Joint& joint : free.joints) {
    joint.q_min = -std::numeric_limits<double>::infinity();
    joint.q_max = std::numeric_limits<double>::infinity();
  }
  const robot::Posture posture = robot::InverseKinematics(free, goal.frame, goal.directions).solve(target, best.q);
  if (!posture.reached) return best.message + "; out of reach without bounds of positions, too";
  std::string beyond;
  for (std::size_t j = 0; j < bounded.joints.size(); ++j) {
    const robot::Joint& joint = bounded.joints[j];
    const double q = posture.q[static_cast<Eigen::Index>(j)];
    if (q >= joint.q_min && q <= joint.q_max) continue;
    text::append(beyond, joint.name + " at " + text::to_text(q, 4) + ", bound " +
                             text::to_text(q < joint.q_min ? joint.q_min : joint.q_max, 4));
  }
  return best.message + (beyond.empty() ? "" : "; reached beyond bounds with " + beyond);
}

}  // namespace

Json answer_manipulability(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, kAnyMotion);
  const Detail detail = read_detail(r);
  const robot::Frame frame = read_frame(robot, r, "of the URDF; without it the end effector");
  if (!r.finish(context)) return {};
  const Plan p = plan_of(robot, m);
  Json reply;
  verdict_of(p.solution).tell(reply);
  reply["T_s"] = p.solution.T;
  add_notes(reply, m.notes);
  add_notes(reply, p.notes);
  Move timed = m;
  timed.T = p.solution.T;
  const bool bounded = std::ranges::all_of(p.problem.bounds.tau, [](double tau) { return std::isfinite(tau); });
  for (const bool dynamic : {false, true}) {
    const char* const name = dynamic ? "dynamic" : "kinematic";
    reply[name] = nullptr;
    if (dynamic && !bounded) continue;
    const PathManipulability found = manipulability_along(robot.model, timed, frame, dynamic);
    reply[name] = {
        {"dimensions", found.dimensions}, {"least", place(found.least, dynamic)}, {"greatest", place(found.greatest, dynamic)}};
    if (detail < Detail::kSeries) continue;
    for (const ManipulabilityAt& at : found.series) {
      const Json one = place(at, dynamic);
      for (const auto& [member, value] : one.items()) reply[name]["series"][member].push_back(value);
    }
  }
  return reply;
}

Json answer_payload(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, kAnyMotion);
  const Detail detail = read_detail(r);
  const robot::Frame frame = read_frame(robot, r, "that carries it, of the URDF; without it the end effector");
  robot::Payload part{{"largest_payload", frame.name, {}, {}, {}}, {}};
  part.part.inertia.mass = 1;
  part.part.X_PA.p = read_vector<3>(r, "com_m", true, "its place in that frame; without it the origin");
  part.when = read_interval(r);
  if (!r.describes() && m.searched())
    throw RequestError(r.pointer("T_s"),
                       "is missing, expected it: the shortest duration of the move leaves no torque for a payload");
  if (!r.finish(context)) return {};
  const Plan p = plan_of(robot, m);
  const Verdict verdict = verdict_of(p.solution);
  const LargestPayload found = largest_payload(robot.model, m, part);
  const bool limited = verdict.feasible() && std::isfinite(found.mass);
  Json reply;
  verdict.tell(reply);
  reply["T_s"] = p.solution.T;
  reply["mass_kg"] = limited ? Json(found.mass) : Json(nullptr);
  if (detail >= Detail::kMargins) reply["limiting"] = limited ? limiting_of(robot.model, {found.at}) : Json(nullptr);
  add_notes(reply, m.notes);
  if (verdict.feasible() && !limited) add_notes(reply, {"no bound of torque limits the payload"});
  return reply;
}

Json answer_reach(const Robot& robot, Reader& r, const Context& context) {
  const JointUnits units(robot.model);
  const Detail detail = read_detail(r);
  PoseGoal goal;
  goal.frame = read_frame(robot, r, "of the URDF; without it the end effector");
  goal.directions = read_directions(r);
  std::vector<double> from = units.read(r, "from_q", 0, true, "posture to which the ones that are found are close");
  robot::RobotModel bounded = robot.model;
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const std::vector<double> low = units.read_bounds(r, "q_min", 0, -kNone, "bound in place of the robot's, null: none"),
                            high = units.read_bounds(r, "q_max", 0, kNone, "bound in place of the robot's, null: none");
  if (r.describes())
    r.declare("poses", schemas::array_of(Reader::schema_of([](Reader& own) { (void)read_target(own, false); })), true,
              "of the frame in the base");
  if (r.describes()) return {};
  const std::size_t n = bounded.joints.size();
  for (std::size_t j = 0; j < n; ++j) {
    if (!low.empty()) bounded.joints[j].q_min = low[j];
    if (!high.empty()) bounded.joints[j].q_max = high[j];
  }
  if (from.empty())
    for (const robot::Joint& joint : bounded.joints) from.push_back(robot::default_start(joint));
  if (from.size() != n)
    throw RequestError(r.pointer(units.name("from_q", 0).c_str()),
                       "has " + std::to_string(from.size()) + " values, expected " + std::to_string(n) + ", one per joint");
  const Json* const given = r.any("poses");
  if (!given || !given->is_array() || given->empty() || given->size() > kMostPoses)
    throw RequestError(r.pointer("poses"), std::string(given ? "is no array of" : "is missing, expected") + " 1 to " +
                                               std::to_string(kMostPoses) + " poses");
  std::vector<robot::PoseTarget> targets;
  for (std::size_t k = 0; k < given->size(); ++k) {
    Reader own((*given)[k], r.pointer("poses") + "/" + std::to_string(k));
    targets.push_back(*read_target(own, false));
    own.finish();
  }
  if (!r.finish(context)) return {};
  robot::InverseKinematics kinematics(bounded, goal.frame, goal.directions);
  Json poses = Json::array();
  std::string reason;
  for (std::size_t k = 0; k < targets.size(); ++k) {
    const robot::Posture posture =
        kinematics.solve(targets[k], Eigen::Map<const Eigen::VectorXd>(from.data(), static_cast<Eigen::Index>(n)));
    const std::string why = posture.reached ? "" : obstacle(bounded, goal, targets[k], posture);
    if (!posture.reached && reason.empty()) reason = "pose " + std::to_string(k + 1) + ": " + why;
    poses.push_back({{"reached", posture.reached},
                     {"reason", why},
                     {"distance_m", posture.distance},
                     {"angle_rad", posture.angle},
                     {units.name("q", 0), posture.reached ? array_of(posture.q) : Json(nullptr)}});
  }
  Verdict verdict;
  verdict.add(Of::kPoses, reason.empty(), reason);
  Json reply;
  verdict.tell(reply);
  if (detail >= Detail::kMargins) reply["poses"] = poses;
  return reply;
}

}  // namespace cotwin::services
