#include "components/services/json/move_json.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <tuple>

#include "components/services/energy_service.h"
#include "components/services/json/loads_json.h"
#include "models/foundation/support/text.h"
#include "models/trajectory/waypoints.h"

namespace cotwin::services {

namespace {

constexpr const char* kRevolute[] = {"rad", "rad_per_s", "rad_per_s2", "rad_per_s3", "Nm"};
constexpr const char* kPrismatic[] = {"m", "m_per_s", "m_per_s2", "m_per_s3", "N"};
constexpr std::size_t kMostTimes = 100000;  // of a motion in a request
constexpr const char* kQuantities[] = {"q", "dq", "ddq", "dddq", "tau"};

Json peak_json(const optimisation::Peak& p) {
  Json j{{"value", p.value}, {"t_s", p.t}};
  if (!std::isfinite(p.limit)) return j;
  j["limit"] = p.limit;
  j["share"] = p.share;
  return j;
}

int order_of(const std::string& bound) {
  return static_cast<int>(std::find(kQuantities, kQuantities + 5, bound) - kQuantities);
}

}  // namespace

JointUnits::JointUnits(const robot::RobotModel& robot) : robot_(robot) {
  for (const robot::Joint& joint : robot.joints) all_revolute_ = all_revolute_ && joint.type == robot::JointType::kRevolute;
}

const char* JointUnits::of(std::size_t joint, int order) const {
  return (robot_.joints[joint].type == robot::JointType::kRevolute ? kRevolute : kPrismatic)[order];
}

std::string JointUnits::name(const std::string& plain, int order) const {
  return all_revolute_ ? plain + "_" + kRevolute[order] : plain;
}

const Json* JointUnits::member(Reader& r, const std::string& plain, int order, std::string& found) const {
  std::vector<std::string> names{name(plain, order)};
  if (all_revolute_ && order == 0) names.push_back(plain + "_deg");
  const Json* value = nullptr;
  for (const std::string& each : names) {
    const Json* own = r.any(each.c_str());
    if (!own) continue;
    if (value) throw RequestError(r.pointer(each.c_str()), "is given beside " + found + ", expected one of them");
    value = own;
    found = each;
  }
  if (!all_revolute_)
    for (const std::string& suffix : {std::string("_") + kRevolute[order], std::string("_deg")})
      if (const std::string other = plain + suffix; r.gives(other.c_str()))
        throw RequestError(r.pointer(other.c_str()), "is given, but the robot has prismatic joints, expected " + plain +
                                                         " with values in " + kRevolute[order] + " for revolute and in " +
                                                         kPrismatic[order] + " for prismatic joints");
  return value;
}

namespace {

/// A member of joints: with the suffix of revolute ones, without it for robots with prismatic joints.
std::vector<double> describe(Reader& r, const std::string& plain, int order, const Json& type, const char* what) {
  const std::string each = std::string(what) + ", one per joint";
  r.declare(plain + "_" + kRevolute[order], type, false, each.c_str());
  r.declare(plain, type, false, (each + " of a robot with prismatic joints, those in m, m/s, … and N").c_str());
  if (order == 0) r.declare(plain + "_deg", type, false, (std::string(what) + ", in degrees").c_str());
  return {};
}

}  // namespace

std::vector<double> JointUnits::read(Reader& r, const std::string& plain, int order, bool optional, const char* what) const {
  if (r.describes()) return describe(r, plain, order, schemas::kNumbers, what);
  std::string found = name(plain, order);
  if (!member(r, plain, order, found) && optional) return {};
  std::vector<double> values = r.numbers(found.c_str());
  if (found.ends_with("_deg"))
    for (double& value : values) value *= std::numbers::pi / 180;
  constexpr double kFarthest = 1e6;  // rad or m; squares of much larger numbers are not finite
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!(std::abs(values[i]) <= kFarthest))
      throw RequestError(r.pointer(found.c_str()) + "/" + std::to_string(i),
                         "is " + text::to_text(values[i], 4) + " " + kRevolute[order] + ", expected -1000000 to 1000000");
  return values;
}

std::vector<double> JointUnits::read_bounds(Reader& r, const std::string& plain, int order, double none,
                                            const char* what) const {
  if (r.describes()) return describe(r, plain, order, schemas::kNumbersOrNull, what);
  std::string found;
  const Json* given = member(r, plain, order, found);
  if (!given) return {};
  if (!given->is_array()) throw RequestError(r.pointer(found.c_str()), "is no array, expected one number or null per joint");
  const std::size_t n = robot_.joints.size();
  if (given->size() != n)
    throw RequestError(r.pointer(found.c_str()),
                       "has " + std::to_string(given->size()) + " values, expected " + std::to_string(n) + ", one per joint");
  std::vector<double> values;
  for (std::size_t i = 0; i < n; ++i) {
    const Json& value = (*given)[i];
    if (value.is_null()) {
      values.push_back(none);
      continue;
    }
    if (!value.is_number() || !std::isfinite(value.get<double>()))
      throw RequestError(r.pointer(found.c_str()) + "/" + std::to_string(i),
                         "is no finite number, expected one, or null for no bound");
    values.push_back(value.get<double>() * (found.ends_with("_deg") ? std::numbers::pi / 180 : 1));
    if (order > 0 && !(values.back() > 0))
      throw RequestError(r.pointer(found.c_str()) + "/" + std::to_string(i),
                         "is " + value.dump() + ", expected a number greater than 0");
  }
  return values;
}

namespace {

/// Throws RequestError for a posture in rad that would be within the limits in degrees, and in which a joint is more than half a turn
/// beyond them and further than a turn from zero, or two are. Others that are beyond are answered: the motion is infeasible.
void refuse_degrees(const robot::RobotModel& robot, Reader& r, const std::string& plain, const std::vector<double>& q) {
  std::size_t far = q.size();
  int beyond_by_half_a_turn = 0;
  bool turns = false;
  for (std::size_t i = 0; i < q.size(); ++i) {
    const robot::Joint& joint = robot.joints[i];
    if (joint.type != robot::JointType::kRevolute) continue;
    const auto beyond = [&](double x) { return std::max(joint.q_min - x, x - joint.q_max); };
    if (beyond(q[i] * std::numbers::pi / 180) > 0) return;
    if (!(beyond(q[i]) > std::numbers::pi)) continue;
    if (far == q.size()) far = i;
    ++beyond_by_half_a_turn;
    turns = turns || std::abs(q[i]) > 2 * std::numbers::pi;
  }
  if (beyond_by_half_a_turn < 2 && !turns) return;
  const robot::Joint& joint = robot.joints[far];
  const auto number = [](double x) { return text::to_text(x, 4); };
  const std::string in_degrees =
      JointUnits(robot).name(plain, 0) == plain ? "" : " Then " + plain + "_deg (cotwin ask: --angle-unit deg)";
  throw RequestError(r.pointer(JointUnits(robot).name(plain, 0).c_str()) + "/" + std::to_string(far),
                     "is " + number(q[far]) + " rad, expected " + number(joint.q_min) + " to " + number(joint.q_max) +
                         " rad for joint " + joint.name + "; are these degrees?" + in_degrees);
}

/// The members of the ends; with `in_motion` also their velocities and accelerations.
void read_ends(const Robot& robot, Reader& r, const Takes& takes, bool posture, Move& m) {
  const JointUnits units(robot.model);
  const std::size_t n = robot.model.joints.size();
  if (r.gives("from"))
    throw RequestError(r.pointer("from"), "is given, expected " + units.name("from_q", 0) +
                                              " with a posture, or \"run\" in a request to the gateway of a run");
  const auto read = [&](const char* plain, int order, bool optional, const char* what) {
    std::vector<double> x = units.read(r, plain, order, optional, what);
    if (x.size() != n && !(optional && x.empty()))
      throw RequestError(r.pointer(units.name(plain, order).c_str()),
                         "has " + std::to_string(x.size()) + " values, expected " + std::to_string(n) + ", one per joint");
    return x;
  };
  m.from_q = read("from_q", 0, !takes.start, "posture at the start");
  m.to_q = read("to_q", 0, !posture, "posture at the end");
  if (takes.start) r.declare_one_of({"from_q_rad", "from_q_deg", "from_q"});
  if (posture) r.declare_one_of({"to_q_rad", "to_q_deg", "to_q"});
  if (takes.in_motion) {
    m.dq_from = read("dq_from", 1, true, "speed at the start; without it at rest");
    m.dq_to = read("dq_to", 1, true, "speed at the end; without it at rest");
    m.ddq_from = read("ddq_from", 2, true, "acceleration at the start; without it 0");
    m.ddq_to = read("ddq_to", 2, true, "acceleration at the end; without it 0");
  }
  bool own_limits = false;
  for (const char* name : {"q_min", "q_min_rad", "q_min_deg", "q_max", "q_max_rad", "q_max_deg"})
    own_limits = own_limits || r.gives(name);
  for (const auto& [plain, q] : {std::pair{"from_q", &m.from_q}, {"to_q", &m.to_q}})
    if (!own_limits && !q->empty() && !r.gives((std::string(plain) + "_deg").c_str()))
      refuse_degrees(robot.model, r, plain, *q);
}

/// The members of every motion: bounds, drives and loads.
void read_rest(const Robot& robot, Reader& r, const Context& context, const Takes& takes, MoveRequest& m) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const JointUnits units(robot.model);
  constexpr const char* kReplaced = "bound in place of the robot's, null: none";
  m.bounds.q_min = units.read_bounds(r, "q_min", 0, -kNone, kReplaced);
  m.bounds.q_max = units.read_bounds(r, "q_max", 0, kNone, kReplaced);
  m.bounds.dq = units.read_bounds(r, "dq_max", 1, kNone, kReplaced);
  m.bounds.ddq = units.read_bounds(r, "ddq_max", 2, kNone, kReplaced);
  m.bounds.dddq = units.read_bounds(r, "dddq_max", 3, kNone, kReplaced);
  m.bounds.tau =
      units.read_bounds(r, "tau_max", 4, kNone, "bound of the motors behind the gears in place of the robot's, null: none");
  if (r.word("drives", {"robot", "none"}, "whether inertia and friction of the motors count") == "robot")
    m.drives = drive_terms(robot);
  read_loads(robot, r, context, takes, m);
}

/// The members "t_s" and "q_rad" (or "q_deg", "q"): a posture per time.
trajectory::Series read_postures(const Robot& robot, Reader& r) {
  const JointUnits units(robot.model);
  trajectory::Series s;
  s.width = robot.model.joints.size();
  if (r.describes()) {
    r.declare("t_s", schemas::kNumbers, true, "increasing");
    r.declare("q_rad", schemas::array_of(schemas::kNumbers), false, "a posture per time");
    r.declare("q_deg", schemas::array_of(schemas::kNumbers), false, "the same in degrees");
    r.declare("q", schemas::array_of(schemas::kNumbers), false, "the same of a robot with prismatic joints, those in m");
    return s;
  }
  const bool degrees = units.all_revolute() && r.gives("q_deg") && !r.gives("q_rad");
  const std::string q = degrees ? "q_deg" : units.name("q", 0);
  s.t = r.numbers("t_s");
  const Json* const rows = r.any(q.c_str());
  if (!rows || !rows->is_array() || rows->size() != s.t.size() || s.t.size() < 2 || s.t.size() > kMostTimes)
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
      s.x.push_back(degrees ? x * std::numbers::pi / 180 : x);
    }
  }
  return s;
}

/// The member "waypoints": as unit:motion has them.
trajectory::Path read_waypoints(const Robot& robot, Reader& r) {
  trajectory::Series postures = read_postures(robot, r);
  trajectory::Waypoints points{postures.width, std::move(postures.t), std::move(postures.x), {}, {}};
  r.declare("dwell_s", schemas::kNumbers, false, "rest at each of them after the arrival; without it none");
  if (r.any("dwell_s")) points.dwell = r.vector("dwell_s", points.t.size(), false);
  const bool through = r.word("passing", {"rest", "through"}, "rest at each of them, or pass with minimum jerk") == "through";
  r.finish();
  if (r.describes()) return {};
  try {
    return trajectory::make_path(points, through ? trajectory::Passing::kThrough : trajectory::Passing::kRest);
  } catch (const Error& error) {
    throw RequestError(r.pointer("t_s"), error.what());
  }
}

/// Says so where the accelerations of a series rest on noise: with every second sample they would be much smaller.
void tell_noise(const Robot& robot, const trajectory::Series& s, const trajectory::Path& path,
                std::vector<std::string>& notes) {
  constexpr std::size_t kFewest = 32;
  constexpr double kMuch = 1.5;
  if (s.size() < kFewest) return;
  trajectory::Series half;
  half.width = s.width;
  for (std::size_t i = 0; i < s.size(); i += 2) {
    half.t.push_back(s.t[i]);
    for (std::size_t j = 0; j < s.width; ++j) half.x.push_back(s.x[i * s.width + j]);
  }
  const trajectory::Path coarse = trajectory::interpolate(half);
  std::size_t worst = 0;
  const auto largest = [](const trajectory::Path& p, std::size_t j) { return std::abs(p.range(j, 2).largest().value); };
  for (std::size_t j = 1; j < s.width; ++j)
    if (largest(path, j) > largest(path, worst)) worst = j;
  const double all = largest(path, worst), few = largest(coarse, worst);
  if (!(all > kMuch * few)) return;
  const std::string unit = JointUnits(robot.model).of(worst, 2);
  notes.push_back("accelerations of the series rest on its noise: joint " + robot.model.joints[worst].name + " has up to " +
                  text::to_text(all, 3) + " " + unit + ", with every second sample " + text::to_text(few, 3) +
                  "; torques and jerk are as uncertain without cutoff_Hz");
}

}  // namespace

MoveRequest read_goal(const Robot& robot, Reader& r, const Context& context, const Takes& takes, bool posture) {
  MoveRequest m;
  read_ends(robot, r, takes, posture, m);
  read_rest(robot, r, context, takes, m);
  return m;
}

double read_duration(Reader& r) { return r.duration("T_s", 0, "duration; without it the shortest one"); }

MoveRequest read_move(const Robot& robot, Reader& r, const Context& context, const Takes& takes) {
  MoveRequest m;
  const JointUnits units(robot.model);
  if (takes.paths) {
    if (r.describes()) {
      r.declare("series", Reader::schema_of([&](Reader& own) { (void)read_series(robot, own); }), false,
                "a motion of any kind in place of the move");
      r.declare("waypoints", Reader::schema_of([&](Reader& own) { (void)read_waypoints(robot, own); }), false,
                "a motion through points in place of the move");
      r.or_instead({"series", "waypoints"});
    }
    for (const char* kind : {"series", "waypoints"}) {
      const Json* const given = r.any(kind);
      if (!given) continue;
      for (const std::string& other :
           {std::string("waypoints"), units.name("from_q", 0), std::string("from_q_deg"), units.name("to_q", 0),
            std::string("to_q_deg"), std::string("T_s"), std::string("degree"), units.name("c_r", 0)})
        if (other != kind && r.gives(other.c_str()))
          throw RequestError(r.pointer(other.c_str()), std::string("is given beside ") + kind + ", expected one of them");
      Reader own(*given, r.pointer(kind));
      m.path = kind == std::string("series") ? read_series(robot, own, &m.notes) : read_waypoints(robot, own);
      read_rest(robot, r, context, takes, m);
      return m;
    }
  }
  m = read_goal(robot, r, context, takes, true);
  if (takes.duration) m.T = read_duration(r);
  m.degree = r.integer("degree", 5, 31, 5, "of the polynomials");
  m.c = units.read(r, "c_r", 0, true, "redundant coefficients, joint by joint, (degree - 5) each");
  const std::size_t expected = robot.model.joints.size() * static_cast<std::size_t>(m.degree - 5);
  if (!m.c.empty() && m.c.size() != expected)
    throw RequestError(r.pointer(units.name("c_r", 0).c_str()), "has " + std::to_string(m.c.size()) + " values, expected " +
                                                                    std::to_string(expected) + ": joints times (degree - 5)");
  if (takes.duration && m.searched() && !m.ends().at_rest())
    throw RequestError(r.pointer("T_s"), "is missing, and the move begins or ends in motion, expected its duration");
  return m;
}

void add_notes(Json& reply, const std::vector<std::string>& notes) {
  for (const std::string& note : notes) reply["notes"].push_back(note);
}

Detail read_detail(Reader& r) {
  const std::string word = r.word("detail", {"margins", "verdict", "series", "all"}, "how much the reply tells");
  return word == "verdict"   ? Detail::kVerdict
         : word == "margins" ? Detail::kMargins
         : word == "series"  ? Detail::kSeries
                             : Detail::kAll;
}

energetics::Bus read_bus(Reader& r, const char* what) {
  const std::string word = r.word("bus", {"shared", "none", "grid"}, what);
  return word == "none" ? energetics::Bus::kSeparate : word == "grid" ? energetics::Bus::kGrid : energetics::Bus::kShared;
}

Json peaks_of(const robot::RobotModel& robot, const std::vector<optimisation::Peak>& peaks) {
  const JointUnits units(robot);
  Json all = Json::array();
  for (std::size_t j = 0; j < robot.joints.size(); ++j) {
    Json own{{"joint", robot.joints[j].name}};
    for (const auto& p : peaks)
      if (p.joint == j) own[p.bound + "_" + units.of(j, order_of(p.bound))] = peak_json(p);
    all.push_back(own);
  }
  return all;
}

Json limiting_of(const robot::RobotModel& robot, const std::vector<optimisation::Peak>& peaks) {
  // A posture at its bound does not decide on the duration: of shares that are equal to rounding a position counts last, unless it
  // exceeds its bound.
  constexpr double kRounding = 1e-6, kMet = 1 + 1e-9;
  const auto weight = [](const optimisation::Peak& p) {
    return p.bound == "q" && p.share <= kMet ? p.share - kRounding : p.share;
  };
  const optimisation::Peak* most = nullptr;
  for (const auto& p : peaks)
    if (std::isfinite(p.limit) && (!most || weight(p) > weight(*most))) most = &p;
  if (!most) return nullptr;
  Json own{{"joint", robot.joints[most->joint].name},
           {"bound", most->bound},
           {"unit", JointUnits(robot).of(most->joint, order_of(most->bound))}};
  own.update(peak_json(*most));
  return own;
}

Json motion_of(const Robot& robot, const Move& move, double T) {
  const JointUnits units(robot.model);
  Json motion{{"unit", "unit:motion?kind=polynomial&degree=" + std::to_string(move.degree)},
              {"T_s", T},
              {units.name("q_start", 0), move.from_q},
              {units.name("q_end", 0), move.to_q}};
  const optimisation::Ends ends = move.ends();
  if (!ends.at_rest()) {
    motion[units.name("dq_start", 1)] = ends.dq_from;
    motion[units.name("ddq_start", 2)] = ends.ddq_from;
    motion[units.name("dq_end", 1)] = ends.dq_to;
    motion[units.name("ddq_end", 2)] = ends.ddq_to;
  }
  if (move.degree > 5) {
    const std::vector<double> zeros(move.from_q.size() * static_cast<std::size_t>(move.degree - 5));
    motion[units.name("c_r", 0)] = move.c.empty() ? zeros : move.c;
  }
  return motion;
}

trajectory::Path read_series(const Robot& robot, Reader& r, std::vector<std::string>* notes) {
  constexpr double kGap = 5;  // median steps, as unit:motion has it
  trajectory::Series s = read_postures(robot, r);
  const double cutoff = r.positive("cutoff_Hz", 0, "of a zero-phase low-pass; without it the samples are not smoothed");
  r.finish();
  if (r.describes()) return {};
  const double step = trajectory::median_step(s.t);
  for (std::size_t i = 1; i < s.size(); ++i)
    if (s.t[i] - s.t[i - 1] > kGap * step)
      throw RequestError(r.pointer("t_s") + "/" + std::to_string(i),
                         "is " + text::to_text(s.t[i] - s.t[i - 1], 4) + " s after the one before, a gap, expected at most " +
                             text::to_text(kGap * step, 4) + " s, five median steps");
  if (cutoff > 0) try {
      s = trajectory::smooth(s, cutoff, 2);
    } catch (const Error& error) {
      throw RequestError(r.pointer("cutoff_Hz"), error.what());
    }
  trajectory::Path path = trajectory::interpolate(s);
  if (notes) tell_noise(robot, s, path, *notes);
  return path;
}

}  // namespace cotwin::services
