#include <algorithm>
#include <cmath>

#include "components/services/json/answers.h"
#include "components/services/reaction_service.h"
#include "models/foundation/support/text.h"
#include "models/trajectory/series/series.h"

namespace cotwin::services {

namespace {

constexpr double kTooLarge = 1e15;  // products of larger numbers are not finite
constexpr std::size_t kMostSamples = 100000;

template <std::size_t N>
Eigen::Matrix<double, N, 1> vector_of(Reader& r, const char* name, bool optional, const char* what) {
  const std::vector<double> x = r.vector(name, N, optional, what);
  Eigen::Matrix<double, N, 1> v = Eigen::Matrix<double, N, 1>::Zero();
  if (!x.empty()) v = Eigen::Map<const Eigen::Matrix<double, N, 1>>(x.data());
  if (!(v.cwiseAbs().maxCoeff() < kTooLarge))
    throw RequestError(r.pointer(name), "has numbers of 1e15 and more, expected smaller ones");
  return v;
}

Inertia read_inertia(Reader& r) {
  Inertia base;
  base.mass = r.positive("mass_kg", {}, "of the base link with what is rigidly attached to it");
  if (!(base.mass < kTooLarge))
    throw RequestError(r.pointer("mass_kg"), "is " + text::to_text(base.mass) + ", expected less than 1e15");
  base.p_LC = vector_of<3>(r, "com_m", true, "centre of mass in the frame of the base; without it its origin");
  const auto I =
      vector_of<6>(r, "inertia_kg_m2", false, "xx, xy, xz, yy, yz, zz about the centre of mass in the axes of the base");
  base.I_CC << I[0], I[1], I[2], I[1], I[3], I[4], I[2], I[4], I[5];
  r.finish();
  return base;
}

void read_momentum(Reader& r, ReactionOptions& o) {
  o.momentum = vector_of<3>(r, "linear_Ns", true, "of the whole robot, in the axes of the base at the start");
  o.spin = vector_of<3>(r, "angular_Nms", true, "of the whole robot about its centre of mass, in these axes");
  r.finish();
}

/// The robot with its base. Joints that are locked may have added bodies to the base of the model, which stay.
robot::RobotModel floating(const Robot& robot, Reader& r) {
  robot::RobotModel model = robot.model;
  const Json* const given = r.any("base");
  if (r.describes()) r.declare("base", Reader::schema_of(read_inertia), false, "in place of the robot's");
  if (r.describes()) return model;
  if (given) {
    Reader base(*given, r.pointer("base"));
    const Inertia own = read_inertia(base);
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

/// {"t_s": […], "q_rad": [[…], …]}, one row per time.
trajectory::Series read_series(const Robot& robot, Reader& r) {
  const std::string q = JointUnits(robot.model).name("q", 0);
  trajectory::Series s;
  s.width = robot.model.joints.size();
  if (r.describes()) {
    r.declare("t_s", schemas::kNumbers, true, "increasing");
    r.declare("q_rad", schemas::array_of(schemas::kNumbers), false, "a posture per time");
    r.declare("q", schemas::array_of(schemas::kNumbers), false, "the same of a robot with prismatic joints, those in m");
    return s;
  }
  s.t = r.numbers("t_s");
  const Json* const rows = r.any(q.c_str());
  if (!rows || !rows->is_array() || rows->size() != s.t.size() || s.t.size() < 2 || s.t.size() > kMostSamples)
    throw RequestError(r.pointer(q.c_str()), std::string(rows ? "is no array of " : "is missing, expected ") +
                                                 std::to_string(s.t.size()) + " postures, one per time (2 to 100000)");
  for (std::size_t i = 0; i < s.t.size(); ++i) {
    const std::string row = std::to_string(i);
    if (i > 0 && !(s.t[i] - s.t[i - 1] >= kBriefest))
      throw RequestError(r.pointer("t_s") + "/" + row, "is " + text::to_text(s.t[i]) + " after " + text::to_text(s.t[i - 1]) +
                                                           ", expected at least 0.0001 s more");
    const Json one{{row, (*rows)[i]}};
    for (const double x : Reader(one, r.pointer(q.c_str())).vector(row.c_str(), s.width, false)) {
      if (!(std::abs(x) <= 1e6))
        throw RequestError(r.pointer(q.c_str()) + "/" + row + "/" + std::to_string(s.x.size() % s.width),
                           "is " + text::to_text(x) + ", expected -1000000 to 1000000");
      s.x.push_back(x);
    }
  }
  r.finish();
  return s;
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
void judge(const Robot& robot, const Move& m, optimisation::Solution s, const Reaction& reaction, Detail detail, Json& reply) {
  const std::vector<double> limits = optimisation::bounds_of(robot.model, m.bounds).tau;
  const optimisation::Peak* worst = nullptr;
  for (optimisation::Peak& peak : s.peaks) {
    if (peak.bound != "tau") continue;
    const trajectory::Peak& torque = reaction.torques[peak.joint];
    peak = {peak.bound, peak.joint, torque.value, torque.t, limits[peak.joint], std::abs(torque.value) / limits[peak.joint]};
    if (!worst || peak.share > worst->share) worst = &peak;
  }
  bool feasible = s.status == optimisation::Status::kFeasible;
  if (feasible && worst && worst->share > 1 + 1e-9) {
    feasible = false;
    const std::string unit = JointUnits(robot.model).of(worst->joint, 4) == std::string("N") ? " N" : " N.m";
    s.reason = "joint " + robot.model.joints[worst->joint].name + ": tau = " + text::to_text(worst->value, 6) + unit + " at " +
               text::to_text(worst->t, 4) + " s, bound " + text::to_text(worst->limit, 6) + unit;
  }
  reply["feasible"] = feasible;
  reply["reason"] = s.reason;
  reply["limiting"] = limiting_of(robot.model, s.peaks);
  if (detail >= Detail::kMargins) reply["joints"] = peaks_of(robot.model, s.peaks);
}

}  // namespace

Json answer_reaction(const Robot& robot, Reader& r, const Context& context) {
  const Json* const given = r.any("series");
  const bool described = r.describes();
  trajectory::Path path;
  Move m;
  if (described) {
    r.declare("series", Reader::schema_of([&](Reader& s) { (void)read_series(robot, s); }), false,
              "a motion of any kind in place of the move");
    r.or_instead("series");
  }
  if (given) {
    Reader series(*given, r.pointer("series"));
    path = trajectory::interpolate(read_series(robot, series));
  } else {
    m = read_move(robot, r, true);
  }
  const Detail detail = read_detail(r);
  const robot::RobotModel model = floating(robot, r);
  ReactionOptions o;
  o.drives = m.drives;
  o.samples = static_cast<std::size_t>(r.integer("samples", 2, kMostSamples, 101, "of the series"));
  if (described)
    r.declare("momentum", Reader::schema_of([&](Reader& own) { read_momentum(own, o); }), false,
              "at the start; without it none");
  if (const Json* const momentum = r.any("momentum")) {
    Reader own(*momentum, r.pointer("momentum"));
    read_momentum(own, o);
  }
  if (!r.finish(context)) return {};
  optimisation::Solution s;
  Json reply;
  if (!given) {
    const bool shortest = m.T == 0;
    m.T = plan_of(robot, m).solution.T;
    if (shortest) add_notes(reply, {"T_s is the shortest duration of the robot on a fixed base, with its weight"});
    Move kinematic = m;
    kinematic.bounds.tau.assign(model.joints.size(), std::numeric_limits<double>::infinity());
    s = plan(robot.model, kinematic).solution;
    path = s.path;
  }
  const Reaction found = reaction(model, path, o);
  reply["T_s"] = path.end() - path.begin();
  if (!given) judge(robot, m, s, found, detail, reply);
  reply["mass_kg"] = found.mass;
  reply["momentum"] = {{"linear_Ns", array_of(o.momentum)}, {"angular_Nms", array_of(o.spin)}};
  reply["end"] = place(found.end);
  reply["worst"] = {
      {"turn", place(found.most_turned)}, {"rate", place(found.fastest)}, {"displacement", place(found.farthest)}};
  if (found.drift) reply["drift"] = place(*found.drift);
  if (detail >= Detail::kSeries) reply["series"] = series_of(found.series);
  return reply;
}

}  // namespace cotwin::services
