#include <algorithm>
#include <cmath>

#include "components/services/json/answers/answers.h"
#include "components/services/json/contact_json.h"
#include "components/services/json/end_pose_json.h"
#include "components/services/json/loads_json.h"
#include "components/services/json/problem_json.h"
#include "components/services/reaction_service.h"
#include "models/foundation/support/text.h"
#include "models/optimisation/reactionless/reactionless.h"
#include "models/robot/floating_base.h"
#include "models/robot/frame_kinematics.h"
#include "models/trajectory/series/series.h"

namespace cotwin::services {

namespace {

constexpr std::size_t kMostSamples = 100000;

Inertia read_base(Reader& r) {
  Inertia base = read_inertia(r, false, "of the base link with what is rigidly attached to it",
                              "centre of mass in the frame of the base; without it its origin");
  r.finish();
  return base;
}

void read_momentum(Reader& r, ReactionOptions& o) {
  o.momentum = read_vector<3>(r, "linear_Ns", true, "of the whole robot, in the axes of the base at the start");
  o.spin = read_vector<3>(r, "angular_Nms", true, "of the whole robot about its centre of mass, in these axes");
  r.finish();
}

/// The robot with its base. Joints that are locked may have added bodies to the base of the model, which stay.
robot::RobotModel floating(const Robot& robot, Reader& r) {
  robot::RobotModel model = robot.model;
  const Json* const given = r.any("base");
  if (r.describes()) r.declare("base", Reader::schema_of(read_base), false, "in place of the robot's");
  if (r.describes()) return model;
  if (given) {
    Reader base(*given, r.pointer("base"));
    const Inertia own = read_base(base);
    if (const std::string why = own.unphysical(); !why.empty()) throw RequestError(r.pointer("base"), why);
    model.base.inertia =
        model.locked.empty()
            ? own
            : Inertia::from_parameters(own.parameters() + model.base.inertia.parameters() - robot.base.parameters());
  }
  if (const std::string why = model.base.inertia.unphysical(); !why.empty())
    throw RequestError(r.pointer("base"), "is missing, and the robot's base '" + model.base.name + "' cannot float: " + why +
                                              "; expected its mass_kg, com_m and inertia_kg_m2");
  return model;
}

void refuse_passive(const robot::RobotModel& model) {
  for (const robot::Joint& joint : model.joints)
    if (joint.passive)
      throw RequestError("/robot", "has the passive joint " + joint.name + ", expected a motor at every joint");
}

Json array_of(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
Json array_of(const Eigen::Quaterniond& q) { return {q.w(), q.x(), q.y(), q.z()}; }

Json place(const BaseAt& b) {
  return {{"t_s", b.t},
          {"turn_rad", b.turn},
          {"quaternion_wxyz", array_of(b.attitude)},
          {"rate_rad_per_s", array_of(b.rate)},
          {"displacement_m", array_of(b.displacement)}};
}

Json series_of(const std::vector<BaseAt>& all) {
  Json series;
  for (const BaseAt& b : all) {
    const Json one = place(b);
    for (const auto& [name, value] : one.items()) series[name].push_back(value);
  }
  return series;
}

/// The verdict: bounds of position and its derivatives as on a fixed base, torques as on the floating one.
void add_verdict(const Robot& robot, const optimisation::Judgement& found, Verdict verdict, Detail detail, Json& reply) {
  verdict.add(Of::kBounds, found.reason.empty(), found.reason);
  verdict.tell(reply);
  reply["limiting"] = limiting_of(robot.model, found.peaks);
  if (detail >= Detail::kMargins) reply["joints"] = peaks_of(robot.model, found.peaks);
}

Json costs_of(const Reaction& r) {
  return {{"torque_squared_integral", r.torque}, {"work_J", r.work}, {"jerk_squared_integral", r.jerk}};
}

void add_reaction(const Reaction& found, const ReactionOptions& o, Detail detail, Json& reply) {
  reply["mass_kg"] = found.mass;
  reply["momentum"] = {{"linear_Ns", array_of(o.momentum)}, {"angular_Nms", array_of(o.spin)}};
  reply["end"] = place(found.end);
  reply["worst"] = {
      {"turn", place(found.most_turned)}, {"rate", place(found.fastest)}, {"displacement", place(found.farthest)}};
  if (found.drift) reply["drift"] = place(*found.drift);
  reply["costs"] = costs_of(found);
  if (detail >= Detail::kSeries) reply["series"] = series_of(found.series);
}

/// The members "samples" and "momentum".
ReactionOptions read_options(Reader& r, const optimisation::DriveTerms& drives) {
  ReactionOptions o;
  o.drives = drives;
  o.samples = static_cast<std::size_t>(r.integer("samples", 2, kMostSamples, 101, "of the series"));
  if (r.describes())
    r.declare("momentum", Reader::schema_of([&](Reader& own) { read_momentum(own, o); }), false,
              "at the start; without it none");
  if (const Json* const momentum = r.any("momentum")) {
    Reader own(*momentum, r.pointer("momentum"));
    read_momentum(own, o);
  }
  return o;
}

/// The pose that `q` has on the free base without reaction: its attitude stays, its centre of mass too.
robot::PoseTarget pose_at(const robot::RobotModel& model, const robot::Frame& frame, const std::vector<double>& from,
                          const std::vector<double>& to) {
  const robot::FloatingMechanism mechanism(model);
  robot::FloatingData data(mechanism);
  robot::FloatingInertia inertia(model.n());
  const auto posture = [&](const std::vector<double>& q) { return Eigen::Map<const Eigen::VectorXd>(q.data(), model.n()); };
  robot::floating_inertia(mechanism, data, posture(from), inertia);
  const Eigen::Vector3d centre = inertia.p_C;
  robot::floating_inertia(mechanism, data, posture(to), inertia);
  robot::FrameKinematics kinematics(model, frame);
  Eigen::MatrixXd J(6, model.n());
  const robot::FrameMotion pose = kinematics.jacobian(posture(to), J);
  return {pose.p + centre - inertia.p_C, pose.Q};
}

}  // namespace

Json answer_reaction(const Robot& robot, Reader& r, const Context& context) {
  MoveRequest m = read_move(robot, r, context, {.in_motion = true, .paths = true, .wrench = false, .intervals = false});
  const Detail detail = read_detail(r);
  const robot::RobotModel model = robot::loaded(floating(robot, r), m.loads, 0);
  const ReactionOptions o = read_options(r, m.drives);
  if (!r.finish(context)) return {};
  Json reply;
  if (m.searched()) add_notes(reply, {"T_s is the shortest duration of the robot on a fixed base, with its weight"});
  add_notes(reply, m.notes);
  const trajectory::Path path = plan_of(robot, m).solution.path;
  const Reaction found = reaction(model, path, o);
  reply["T_s"] = path.end() - path.begin();
  const optimisation::Bounds bounds = optimisation::bounds_of(robot.model, m.bounds);
  add_verdict(robot, optimisation::judge(robot.model, bounds, path, found.torques), {}, detail, reply);
  add_reaction(found, o, detail, reply);
  return reply;
}

Json answer_reactionless(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_goal(robot, r, context, {.wrench = false, .intervals = false}, false);
  double T = read_duration(r);
  const std::optional<PoseGoal> pose = read_pose_goal(r, robot.model);
  r.declare_one_of({"to_q_rad", "to_q_deg", "to_q", "to_pose"});
  const JointUnits units(robot.model);
  if (!r.describes() && m.to_q.empty() && !(pose && pose->target))
    throw RequestError(r.pointer(units.name("to_q", 0).c_str()),
                       "is missing, expected a posture, or p_m and quaternion_wxyz in to_pose");
  const Detail detail = read_detail(r);
  const robot::RobotModel model = robot::loaded(floating(robot, r), m.loads, 0);
  const ReactionOptions o = read_options(r, m.drives);
  optimisation::ReactionlessOptions search;
  search.particles = r.integer("particles", 8, 10000, search.particles, "of the swarm");
  search.rounds = r.integer("rounds", 1, 10000, search.rounds, "of the swarm");
  search.seed = static_cast<std::uint64_t>(r.integer("seed", 0, std::numeric_limits<int>::max(), 1, "same seed, same motion"));
  if (r.describes()) return {};
  const std::size_t n = model.joints.size();
  const optimisation::Bounds bounds = optimisation::bounds_of(model, m.bounds);
  optimisation::ReactionlessProblem p;
  p.robot = model;
  p.q_from = m.from_q;
  p.bounds = bounds;
  p.T = T;
  if (pose) {
    p.frame = pose->frame;
    p.directions = pose->directions;
    p.target = pose->target ? *pose->target : pose_at(model, pose->frame, m.from_q, m.to_q);
  } else {
    p.q_to = m.to_q;
  }
  for (const auto& [name, q] : {std::pair{"from_q", &m.from_q}, {"to_q", &p.q_to}})
    for (std::size_t j = 0; j < q->size(); ++j)
      if (!((*q)[j] >= bounds.q_min[j] && (*q)[j] <= bounds.q_max[j]))
        throw RequestError(r.pointer(units.name(name, 0).c_str()) + "/" + std::to_string(j),
                           "is " + text::to_text((*q)[j]) + ", expected " + text::to_text(bounds.q_min[j]) + " to " +
                               text::to_text(bounds.q_max[j]) + " for joint " + model.joints[j].name);
  refuse_passive(model);
  if (!r.finish(context)) return {};

  optimisation::ReactionlessMotion motion(p, search, context.threads);
  trajectory::Series series;
  trajectory::Path path;
  Reaction found;
  optimisation::Judgement judgement;
  const auto run = [&](double duration, int steps, const ReactionOptions& options) {
    series = motion.sample(duration, steps);
    path = trajectory::interpolate(series);
    found = reaction(model, path, options);
    judgement = optimisation::judge(model, bounds, path, found.torques);
  };
  constexpr int kFewest = 1000, kMost = 20000;
  if (T == 0) {
    // The way does not depend on T: q̇ is proportional to 1/T, q̈ to 1/T², and so on.
    double factor = T = 1;
    do {
      T = std::clamp(T * factor, kBriefest, kLongest);
      run(T, kFewest, o);
      factor = 0;
      for (const optimisation::Peak& peak : judgement.peaks)
        if (peak.bound != "q")
          factor = std::max(factor, std::pow(peak.share, peak.bound == "dq" ? 1.0 : peak.bound == "dddq" ? 1.0 / 3 : 0.5));
    } while (std::abs(factor - 1) > 1e-6 && T * factor > kBriefest && T * factor < kLongest);
    if (factor == 0)
      throw RequestError(
          r.pointer("T_s"),
          "is missing, and no bound limits the duration, expected it or bounds of speed, acceleration, jerk or torque");
    T = std::min(T * (1 + 1e-4), kLongest);
  }
  run(T, std::clamp(static_cast<int>(std::ceil(T / 0.001 - 1e-6)), kFewest, kMost), o);
  Json reply;
  reply["T_s"] = T;
  Verdict verdict;
  verdict.add(Of::kPoses, motion.reached(),
              "the goal is not reached: " + text::to_text(motion.distance(), 3) + " m and " + text::to_text(motion.angle(), 3) +
                  " rad are left, expected a goal within reach of the free robot");
  verdict.add(Of::kBase, motion.obstacle().empty(), motion.obstacle());
  add_verdict(robot, judgement, verdict, detail, reply);
  reply["reactionless"] = motion.obstacle().empty();
  reply["to_go"] = {{"distance_m", motion.distance()}, {"angle_rad", motion.angle()}};
  const std::vector<double> last(series.x.end() - static_cast<std::ptrdiff_t>(n), series.x.end()), rest(2 * n);
  reply[units.name("to_q", 0)] = last;
  add_reaction(found, o, detail, reply);
  std::vector<double> ends = m.from_q;
  const std::vector<double>& standard_end = m.to_q.empty() ? last : m.to_q;
  ends.insert(ends.end(), standard_end.begin(), standard_end.end());
  const Reaction standard = reaction(model, trajectory::Path(n, {0, T}, ends, rest, rest), o);
  reply["standard"] = {
      {"turn_rad", standard.end.turn}, {"worst_turn_rad", standard.most_turned.turn}, {"costs", costs_of(standard)}};
  if (detail == Detail::kAll) {
    Json rows = Json::array();
    for (std::size_t k = 0; k < series.size(); ++k)
      rows.push_back(std::vector<double>(series.x.begin() + static_cast<std::ptrdiff_t>(k * n),
                                         series.x.begin() + static_cast<std::ptrdiff_t>((k + 1) * n)));
    reply["motion"] = {{"unit", "unit:motion?kind=csv"}, {"t_s", series.t}, {units.name("q", 0), rows}};
  }
  std::vector<std::string> notes;
  if (!motion.obstacle().empty())
    notes.push_back(motion.obstacle() + ": the base turns on the way, and is turned at the end as little as was found");
  if (found.drift)
    notes.emplace_back("the robot has momentum: its base moves as drift tells, and the goal is where it would be without it");
  add_notes(reply, notes);
  return reply;
}

Json answer_grow_reactionless(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_goal(robot, r, context, {.wrench = false, .intervals = false, .start = false}, false);
  const Detail detail = read_detail(r);
  optimisation::ReactionlessProblem p;
  p.robot = robot::loaded(floating(robot, r), m.loads, 0);
  p.frame = read_frame(robot, r, "with the constraint base: of the URDF; without it the end effector");
  const auto [motions, seed] = read_draws(r);
  if (r.describes()) return {};
  const JointUnits units(robot.model);
  if (m.from_q.empty()) throw RequestError(r.pointer(units.name("from_q", 0).c_str()), "is missing, expected a posture");
  if (!m.to_q.empty())
    throw RequestError(r.pointer(units.name("to_q", 0).c_str()),
                       "is given with the constraint base, whose motions end anywhere");
  p.q_from = m.from_q;
  p.bounds = optimisation::bounds_of(p.robot, m.bounds);
  refuse_passive(p.robot);
  if (!r.finish(context)) return {};

  const std::size_t n = p.robot.joints.size();
  if (context.rows) {
    std::vector<std::string> names{"number", "feasible", "T", "x_m", "y_m", "z_m", "q_w", "q_x", "q_y", "q_z"};
    for (std::size_t j = 1; j <= n; ++j) names.push_back("q_to[" + std::to_string(j) + "]");
    context.rows->begin(names, motions);
  }
  const robot::PoseTarget start = pose_at(p.robot, p.frame, m.from_q, m.from_q);
  optimisation::Distribution time, distance;
  std::vector<std::uint32_t> forbidden(n);
  Eigen::Vector3d least = start.p, most = start.p;
  const auto progress = percent_of(context, motions);
  const auto visit = [&](const optimisation::ReactionlessGrown& one) {
    const bool feasible = one.beyond <= 0;
    if (feasible) {
      time.add(one.T);
      distance.add((one.pose.p - start.p).norm());
      least = least.cwiseMin(one.pose.p);
      most = most.cwiseMax(one.pose.p);
    } else {
      ++forbidden[one.joint];
    }
    if (context.rows) {
      const Eigen::Vector3d& x = one.pose.p;
      const Eigen::Quaterniond& Q = one.pose.Q;
      std::vector<double> row{double(one.number), feasible ? 1.0 : 0.0, one.T, x.x(), x.y(), x.z(), Q.w(), Q.x(), Q.y(), Q.z()};
      row.insert(row.end(), one.q.begin(), one.q.end());
      context.rows->row(row);
    }
    if (progress) progress(one.number + 1);
  };
  try {
    optimisation::grow_reactionless(p, motions, seed, context.threads, visit);
  } catch (const optimisation::NoReactionlessMotion& e) {
    throw RequestError("/constraint", std::string("is base, but ") + e.what());
  }
  Verdict verdict;
  verdict.add(Of::kBounds, time.count() > 0,
              "none of " + std::to_string(motions) + " motions keeps the joints within their limits");
  Json reply;
  verdict.tell(reply);
  reply["motions"] = motions;
  reply["feasible_motions"] = time.count();
  reply["forbidden"] = forbidden_json(p.robot, forbidden, motions);
  reply["costs"] = {{"time_s", distribution_json(time, detail)}, {"distance_m", distribution_json(distance, detail)}};
  reply["ends"] = {{"least_m", array_of(least)}, {"most_m", array_of(most)}};
  add_notes(reply, m.notes);
  add_notes(reply,
            {"time_s is the shortest duration within the bounds of speed, acceleration and jerk; torques are not looked at"});
  return reply;
}

}  // namespace cotwin::services
