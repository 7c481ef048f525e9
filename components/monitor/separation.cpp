#include "components/monitor/separation.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "components/monitor/monitor.h"
#include "models/foundation/support/text.h"

namespace cotwin::monitor {

namespace {

constexpr double kStopping = 0.5;  // s, default
constexpr double kNever = 1e12;    // s

}  // namespace

void SeparationFigures::declare(Variables& v) {
  v.tunable("v_h", v_h, "m/s", "least speed that counts for bodies that move: of a person who may start to walk").range(0, 100);
  v.tunable("v_max", v_max, "m/s",
            "largest speed of such a body: where its place changes by more, and by 0.1 m, it is lost for restart_delay, and "
            "robots stop")
      .range(1e-3, 1e9);
  v.tunable("T_r", T_r, "s", "reaction time of sensors and control, besides two steps of this unit").range(0, 60);
  v.tunable("C", C, "m", "intrusion distance: how far a part of the body may reach in before it is seen").range(0, 100);
  v.tunable("Z_d", Z_d, "m", "uncertainty of the position of bodies").range(0, 100);
  v.tunable("Z_r", Z_r, "m", "uncertainty of the position of robots").range(0, 100);
  v.tunable("slow_speed", slow, "1", "speed while a robot is slowed").range(0, 1);
  v.tunable("slow_band", band, "m", "a robot is slowed while less than this is left to the protective separation distance")
      .range(0, 100);
  v.tunable("hysteresis", hysteresis, "m", "by how much more must be left until a robot goes on").range(0, 100);
  v.tunable("restart_delay", restart_delay, "s", "for how long it must be left until a robot goes on").range(0, 3600);
}

void Separation::declare(Variables& v, const std::string& x, const std::string& of) {
  v.tunable(x + "T_s", T_s_, "s", "stopping time " + of).range(1e-6, 60);
  v.tunable(x + "S_s", S_s_, "m", "stopping distance " + of + "; negative: v_r T_s / 2, and what a_r adds").range(-1, 100);
  v.tunable(
       x + "a_r", a_r_, "m/s2",
       "by how much the speed of a point " + of +
           " may grow, of the link for which this is the most; of others in proportion to their joints and levers; default: "
           "the fastest joint reaches its limit in 0.5 s with the arm stretched")
      .range(0, 1e6);
  v.state(x + "clear_speeds", clear_speeds_, "m/s", "of base and links, when the robot was slowed last");
  v.state(x + "separation_state", state_, "1",
          "zone; since when it could go on, s; how often slowed, and first: s, link, body, margin, S_p; stopped likewise; last "
          "stop, s, "
          "and T_r + T_s then, s; whether it was judged; judged stops; whether it is late; late stops; the worst: s, s after "
          "the stop, m/s; least distance while moving, m, and its body");
}

void Separation::reset() {
  std::ranges::fill(clear_speeds_, 0.0);
  state_ = {};
  state_[kFreeSince] = kNever;
  state_[kLeast] = kNone;
}

double Separation::distance(const SeparationFigures& f, double h, std::size_t link, double v_h, double v_r) const {
  const double T_r = f.T_r + 2 * h, a_r = a_r_ * shares_[link], v_brake = v_r + a_r * T_r;
  const double S_s = S_s_ >= 0 ? S_s_ : v_brake * T_s_ / 2 + a_r * T_s_ * T_s_ / 6;
  const double S_p = v_h * (T_r + T_s_) + (v_r + v_brake) / 2 * T_r + S_s + f.C + f.Z_d + f.Z_r;
  return std::isfinite(S_p) ? S_p : kNone;  // a tunable that is no number stops the robot
}

double Separation::speed_ahead(const SeparationFigures& f, std::size_t link, double v_r) const {
  return std::max(v_r, (zone() == kStop ? f.slow : 1) * clear_speeds_[link]);
}

bool Separation::update(const SeparationFigures& f, const Nearest& nearest, double margin_ahead,
                        const std::vector<double>& speeds, double t, bool lost) {
  constexpr double kRounding = 1e-9;  // s
  const Zone before = zone();
  Zone next = lost || nearest.margin < 0 ? kStop : nearest.margin >= f.band ? kClear : kSlow;
  const bool free = next < before && margin_ahead >= (before == kStop ? 0 : f.band) + f.hysteresis;
  double& since = state_[kFreeSince];
  since = free ? std::min(since, t) : kNever;
  if (next < before) next = !free || !(t - since >= f.restart_delay - kRounding) ? before : before == kStop ? kSlow : kClear;
  if (next == before) return false;
  if (before == kClear) clear_speeds_ = speeds;
  state_[kZone] = next;
  since = kNever;
  if (next == kStop) state_[kStopped] = t, state_[kLimit] = f.T_r + T_s_, state_[kIsJudged] = state_[kIsLate] = 0;
  if (next > before) {
    const std::size_t at = next == kStop ? kStops : kSlows;
    if (state_[at]++ == 0) {
      const double first[] = {t, static_cast<double>(nearest.link), static_cast<double>(nearest.body), nearest.margin,
                              nearest.S_p};
      std::ranges::copy(first, state_.begin() + static_cast<std::ptrdiff_t>(at) + 1);
    }
  }
  return true;
}

void Separation::met(double d, std::size_t body) {
  state_[kLeast] = d;
  state_[kNearest] = static_cast<double>(body);
}

bool Separation::judge(double h, double t, double fastest) {
  constexpr double kRounding = 1e-9;  // s
  const double after = t - state_[kStopped];
  if (zone() != kStop || !(after > state_[kLimit] + 2 * h + kRounding)) return false;
  if (state_[kIsJudged] == 0) ++state_[kJudged];
  state_[kIsJudged] = 1;
  if (!(fastest > kMoving)) return false;
  const bool first = state_[kIsLate] == 0;
  if (first) ++state_[kLates];
  state_[kIsLate] = 1;
  if (fastest > state_[kWorst + 2]) std::ranges::copy(std::array{t, after, fastest}, state_.begin() + kWorst);
  return first;
}

void Separation::append_note(const std::string& robot, const std::vector<std::string>& names,
                             std::vector<std::string>& notes) const {
  std::string note;
  for (const auto& [at, what] : {std::pair{kSlows, "slow down"}, {kStops, "stop"}}) {
    const double* first = &state_[at];
    if (first[0] == 0) continue;
    const auto name = [&](double part) { return names[static_cast<std::size_t>(part)]; };
    text::append(note, (note.empty() ? "asked to " : "to ") + std::string(what) +
                           (first[0] == 1 ? " once, at " : " " + text::to_text(first[0]) + " times, first at ") +
                           text::to_text(first[1], 6) + " s (" + name(first[2]) + " " + text::to_text(first[4] + first[5], 3) +
                           " m from " + name(first[3]) + ", S_p " + text::to_text(first[5], 3) + " m)");
  }
  if (!note.empty()) notes.push_back(robot + " was " + note);
  const double stops = state_[kStops];
  if (stops == 0) return;
  const double judged = state_[kJudged];
  note = robot + " stopped in time in " + text::to_text(judged - state_[kLates]) + " of " +
         text::counted(static_cast<std::int64_t>(stops), "stop");
  if (judged < stops) note += ", " + text::to_text(stops - judged) + " not judged (stop or run ended before T_r + T_s)";
  if (late() > 0)
    note += "; at " + text::to_text(state_[kWorst], 6) + " s it still moved at " + text::to_text(state_[kWorst + 2], 3) +
            " m/s, " + text::to_text(state_[kWorst + 1], 3) + " s after the stop";
  if (state_[kLeast] < kNone)
    note += "; nearest while it moved: " + text::to_text(state_[kLeast], 3) + " m from " +
            names[static_cast<std::size_t>(state_[kNearest])];
  notes.push_back(note);
}

void Monitor::add_separation(Settings& settings) {
  const std::string names = settings.text("separation");
  std::vector<char> counts(bodies_.size(), 0);
  if (names == "all") {
    for (std::size_t k = 0; k < bodies_.size(); ++k) counts[k] = cell_.parts[k].moves;
  } else {
    for (const std::size_t k : bodies_of("separation", names)) {
      if (!cell_.parts[k].moves)
        throw Error("separation=" + names,
                    "'" + cell_.parts[k].name + "' stands, expected bodies that move or are in obstacles");
      counts[k] = 1;
    }
  }
  if (std::ranges::count(counts, 1) == 0)
    settings.warn("separation=" + names + ", but no body of the scene moves or is in obstacles, so speed stays 1");
  for (std::size_t i = 0; i < robots_.size(); ++i) {
    Robot& r = *robots_[i];
    const robot::RobotModel& model = r.placed->model;
    // The share of a base that moves, and of a link with a joint that has no limit, is not known: it is 1.
    std::vector<double> shares;
    double fastest = 0;
    for (const collision::Part& part : cell_.of(static_cast<int>(i))) {
      double& own = shares.emplace_back(part.link < 0 ? scene::kInfinity : 0);
      (void)collision::for_each_lever(
          model, part.link, -1, part.body.reach(),
          [](std::size_t, const robot::Joint& joint) {
            const double farthest = std::max(std::abs(joint.q_min), std::abs(joint.q_max));
            return farthest < scene::kInfinity ? farthest : 0;
          },
          [&](std::size_t, const robot::Joint& joint, double lever) {
            own = std::max(own, joint.dq_max * lever);
            if (joint.dq_max < scene::kInfinity) fastest = std::max(fastest, joint.dq_max * lever);
          });
    }
    for (double& share : shares) share = fastest > 0 ? std::min(share / fastest, 1.0) : 1;
    if (fastest == 0)
      settings.warn("robot '" + model.name + "' has no limits of speed, so " + r.prefix +
                    "a_r starts at 0: set it to how fast the robot may speed up");
    r.separation = std::make_unique<Separation>(std::move(shares), fastest / kStopping);
    for (std::size_t k = 0; k < cell_.pairs.size(); ++k) {
      const collision::Pair& pair = cell_.pairs[k];
      const bool stands = cell_.parts[pair.b].link < 0 && !floating_;
      if (pair.a < counts.size() && counts[pair.a] != 0 && cell_.parts[pair.b].robot == static_cast<int>(i) && !stands)
        r.kept.push_back({k});
    }
    for (std::size_t k = 0; k < counts.size(); ++k) {
      if (counts[k] != 0 &&
          std::ranges::none_of(r.kept, [&](const Robot::Kept& kept) { return cell_.pairs[kept.pair].a == k; }))
        settings.warn((r.placed->name.empty() ? "the robot" : r.placed->name) + " keeps no separation from " +
                      cell_.parts[k].name + ": ignore leaves no pair of them");
    }
  }
  for (std::size_t k = 0; k < bodies_.size(); ++k) bodies_[k]->kept = counts[k] != 0 && !bodies_[k]->comes;
}

void Monitor::append_notes(std::vector<std::string>& notes) const {
  if (obstacle_ != nullptr) {
    if (std::string gaps = obstacle_->gaps("cloud.r", cloud_r_); !gaps.empty()) notes.push_back(std::move(gaps));
  }
  if (!separates_) return;
  std::vector<std::string> names;
  for (const collision::Part& part : cell_.parts) names.push_back(part.name);
  for (const auto& robot : robots_)
    robot->separation->append_note(robot->placed->name.empty() ? robot->placed->model.name : robot->placed->name, names, notes);
  for (std::size_t k = 0; k < bodies_.size(); ++k) {
    const std::array<double, 3>& lost = bodies_[k]->lost;
    bodies_[k]->track.append_note(names[k], notes);
    if (lost[1] > 0)
      notes.push_back(names[k] + " was lost (" + bodies_[k]->track.reason(lost[2]) + ") " +
                      (lost[1] == 1 ? "once, at " : text::to_text(lost[1]) + " times, first at ") + text::to_text(lost[2], 6) +
                      " s" + (lost[0] != 0 ? ", and was so at the end" : ""));
  }
}

/// From all bodies that move or come.
void Monitor::keep_separation(double t, double h) {
  all_.zone = 0;
  all_.speed = 1;
  all_.separation = kNone;
  all_.S_p = 0;
  all_.apart = {};
  all_.late = 0;
  all_.least_moving = kNone;
  bool lost = false;
  for (const auto& body : bodies_) lost = lost || body->lost[0] != 0;
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    Separation& separation = *r.separation;
    for (std::size_t i = 0; i < r.speeds.size(); ++i) r.speeds[i] = speed_of(r.first + i);
    const double fastest = *std::ranges::max_element(r.speeds);
    const bool moves = fastest > Separation::kMoving;
    Separation::Nearest nearest{.margin = kNone};
    collision::Distance apart;
    std::size_t best = r.kept.size();
    double ahead = kNone;
    const auto look = [&](std::size_t j) {
      const collision::Pair& pair = cell_.pairs[r.kept[j].pair];
      double& bound = r.kept[j].bound;
      const bool jumped = jumped_[pair.a] != 0 || jumped_[pair.b] != 0;
      bound = jumped ? -scene::kInfinity : bound - motions_[pair.a] - motions_[pair.b];
      if (!cell_.parts[pair.a].present) return;
      bound = std::max(bound, bounds_[r.kept[j].pair] + inflation(pair));
      const double v_h =
                       bodies_[pair.a]->comes ? 0 : std::max(figures_.v_h, speed_of(pair.a) + bodies_[pair.a]->track.untold()),
                   v_r = r.speeds[pair.b - r.first];
      const std::size_t link = pair.b - r.first;
      const double S_p = separation.distance(figures_, h, link, v_h, v_r);
      const double S_ahead = separation.distance(figures_, h, link, v_h, separation.speed_ahead(figures_, link, v_r));
      constexpr double kSlack = 1e-9;  // so that neither rounding nor what was measured before decides
      const double least = moves ? separation.least_while_moving() : -kNone;
      const double most = std::max({nearest.margin + S_p, ahead + S_ahead, least}) + inflation(pair) + kSlack;
      if (bound > most) return;
      const collision::Distance found = cell_.distance(pair, most, bound);
      const double d = found.d - inflation(pair);
      if (d - S_p < nearest.margin || (d - S_p == nearest.margin && j < best)) {
        nearest = {d - S_p, S_p, pair.b, pair.a};
        apart = found;
        best = j;
      }
      ahead = std::min(ahead, d - S_ahead);
      if (d < least && bodies_[pair.a]->lost[0] == 0) separation.met(d, pair.a);
    };
    // The pair that was the nearest before bounds all others.
    if (r.kept_first < r.kept.size()) look(r.kept_first);
    for (std::size_t j = 0; j < r.kept.size(); ++j) {
      if (j != r.kept_first) look(j);
    }
    r.kept_first = best;
    r.ports.apart = {};
    if (nearest.margin < kNone) {
      r.ports.apart.pair = {static_cast<std::int32_t>(nearest.link) + 1, static_cast<std::int32_t>(nearest.body) + 1};
      Eigen::Map<Eigen::Vector3d>(r.ports.apart.p_a.data()) = apart.p_b - r_ * apart.n;
      Eigen::Map<Eigen::Vector3d>(r.ports.apart.p_b.data()) = apart.p_a;
      r.ports.apart.points_known = apart.on_surfaces ? 1 : 0;
    }
    if (separation.update(figures_, nearest, ahead, r.speeds, t, lost && !r.kept.empty())) {
      constexpr EventCode kCodes[] = {EventCode::kClear, EventCode::kSlow, EventCode::kStop};
      events_.raise(kCodes[separation.zone()], r.ports.apart.pair[0], t, nearest.margin);
      event_body_ = r.ports.apart.pair[1];
    }
    if (separation.judge(h, t, fastest)) {
      events_.raise(EventCode::kNotStopped, r.ports.apart.pair[0], t, nearest.margin);
      event_body_ = r.ports.apart.pair[1];
    }
    r.ports.late = separation.late();
    r.ports.least_moving = separation.least_while_moving();
    all_.late += r.ports.late;
    all_.least_moving = std::min(all_.least_moving, r.ports.least_moving);
    r.ports.zone = separation.zone();
    r.ports.speed = separation.speed(figures_);
    r.ports.separation = nearest.margin;
    r.ports.S_p = nearest.S_p;
    all_.zone = std::max(all_.zone, r.ports.zone);
    all_.speed = std::min(all_.speed, r.ports.speed);
    if (nearest.margin < all_.separation) {
      all_.separation = nearest.margin;
      all_.S_p = nearest.S_p;
      all_.apart = r.ports.apart;
    }
  }
  for (std::size_t k = 0; k < bodies_.size(); ++k) {
    std::array<double, 3>& state = bodies_[k]->lost;
    if (state[0] == 0 || bodies_[k]->was_lost) continue;
    if (state[1]++ == 0) state[2] = t;
    events_.raise(EventCode::kLost, 0, t, 0);
    event_body_ = static_cast<std::int32_t>(k) + 1;
  }
}

}  // namespace cotwin::monitor
