#include "components/scanner/scanner.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "components/unit/joint_variables.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose_values.h"
#include "models/numerics/random.h"

namespace cotwin::scanner {

using Eigen::Vector3d;
using surroundings::check_finite;
using surroundings::Velocity;

void Scanner::declare_settings(SettingList& s) {
  s.set_first_variables({"trigger", "ranges", "count", "t_scan", "p_scan", "quat_scan", "angle_increment", "q"});
  s.cell({"hulls", "all", "none"});
  s.choice("base", {"fixed", "floating"}, "the bases of the robots are fixed or move, for example on rails or in space");
  s.text("frame", "",
         "the frame to which the scanner is fixed: FRAME of a single robot, ROBOT/FRAME, or BODY or BODY/FRAME of the scene; "
         "empty: the end-effector of the robot");
  s.integer("beams", 121, 1, 100'000, "number of beams of a profile");
}

Scanner::Scanner(Settings& settings)
    : place_(settings.unit()),
      given_(settings.cell()),
      floating_(settings.choice("base") == "floating"),
      opening_(2 * std::numbers::pi / 3) {
  const std::string frame = settings.text("frame");
  if (frame.empty() && given_.robots.size() != 1)
    throw Error(place_ + ": frame", "is not given, and there " +
                                        (given_.robots.empty() ? std::string("is no robot") : "are several robots") +
                                        ", expected the frame to which the scanner is fixed, ROBOT/FRAME or BODY");
  frame_ = scene::find_frame(given_, frame.empty() ? given_.robots.front().model.end_effector().name : frame,
                             place_ + ": frame=" + frame);
  try {
    cell_.add(given_.scene);
    for (const scene::Body& body : given_.scene.bodies) bodies_.emplace_back(body);
    for (const scene::PlacedRobot& placed : given_.robots) {
      robots_.push_back(std::make_unique<surroundings::Robot>(placed));
      const bool seen = std::ranges::any_of(placed.shapes, [](const auto& shapes) { return !shapes.empty(); });
      const std::string bare = seen ? robots_.back()->add_to(cell_, floating_) : "no shapes";
      if (!bare.empty() && settings.choice("robot_shapes") != "none")
        settings.warn("robot '" + placed.model.name + "': " + bare + ", so that no beam meets them");
    }
  } catch (const Error& error) {
    throw Error(place_, error.what());
  }
  targets_.reserve(cell_.parts.size());
  for (Values* values : {&ranges_, &sin_, &cos_}) values->assign(static_cast<std::size_t>(settings.integer("beams")), 0.0);
}

void Scanner::declare(Variables& v) {
  v.input("trigger", trigger_, "a rising edge takes a profile of where everything is at the beginning of the step").essential();
  for (const auto& robot : robots_) {
    const JointMeasures measures(&robot->placed->model);
    JointVariables(v, measures)
        .input(robot->prefix + "q", robot->q, "rad", "joint position " + robot->of + " at the step's end, of its links")
        .essential();
    declare_pose(v, robot->base_prefix, robot->base, "of its base", floating_, Velocity::kNone);
    declare_tools(v, *robot);
    declare_before(v, *robot, floating_);
  }
  for (std::size_t k = 0; k < bodies_.size(); ++k) {
    surroundings::Body& body = bodies_[k];
    const bool moves = cell_.parts[k].moves;
    declare_pose(v, body.prefix, body.pose, "of body " + cell_.parts[k].name, moves, Velocity::kNone);
    if (moves) v.state(body.prefix + "before", body.pose.before, "1", "pose at the last step");
  }
  v.parameter("mount_p", mount_p_, "m", "position of the scanner in its frame");
  v.parameter("mount_quat", mount_quat_, "1",
              "its orientation there, unit quaternion (w, x, y, z): z is along the middle beam, x towards the last one");
  v.parameter("opening", opening_, "rad", "angle from the first to the last beam").range(0, 2 * std::numbers::pi);
  v.parameter("range_min", range_min_, "m", "shortest range that is measured").range(0, 1e6);
  v.parameter("range_max", range_max_, "m", "longest range that is measured").range(0, 1e6);
  v.parameter("sigma", sigma_, "m", "standard deviation of the noise of a range").range(0, 1e6);
  v.parameter("resolution", resolution_, "m", "step in which ranges are measured; 0: continuous").range(0, 1e6);
  v.parameter("dropout", dropout_, "1", "probability that a beam does not come back").range(0, 1);
  v.parameter("seed", seed_, "seed of noise and dropout");
  v.output("ranges", ranges_, "m", "of the last profile, by beam: distance to what is met; 0: nothing").discrete();
  v.output("count", count_, "number of profiles so far");
  v.output("t_scan", t_scan_, "s", "time of the last profile").discrete();
  v.output("p_scan", p_scan_, "m", "position of the scanner in W at that time").discrete();
  v.output("quat_scan", quat_scan_, "1", "its orientation in W, unit quaternion (w, x, y, z)").discrete();
  v.output("angle_increment", angle_increment_, "rad",
           "from one beam to the next, from z towards x; the beams are on both sides of z alike: opening / (beams - 1)")
      .discrete();
  v.state("trigger_before", trigger_before_, "trigger in the last step");
  v.state("met", met_, "1", "number of ranges so far that are not 0");
  v.state("inside", inside_, "1", "number of profiles from inside a body; of the first one the time, s, and the body");
}

void Scanner::check_inputs(Time now) const {
  const auto check_pose = [&](const std::string& prefix, const surroundings::PosePorts& pose) {
    check_finite(place_, prefix, pose, now);
    (void)pose_of_input(place_, prefix, "quat", pose.p, pose.quat);  // refuses zero
  };
  for (const auto& robot : robots_) {
    check_finite(place_, robot->prefix, "q", robot->q, now);
    if (floating_) check_pose(robot->base_prefix, robot->base);
  }
  for (std::size_t k = 0; k < bodies_.size(); ++k)
    if (cell_.parts[k].moves) check_pose(bodies_[k].prefix, bodies_[k].pose);
}

void Scanner::remember() {
  for (const auto& robot : robots_) robot->remember();
  for (surroundings::Body& body : bodies_) body.pose.remember();
  trigger_before_ = trigger_;
}

/// Brings what does not move to its parameters.
void Scanner::place_static() {
  for (std::size_t k = 0; k < bodies_.size(); ++k) {
    const surroundings::PosePorts& pose = bodies_[k].pose;
    if (!cell_.parts[k].moves)
      cell_.place(cell_.parts[k], pose_of(place_ + "." + bodies_[k].prefix + "quat0", pose.p, pose.quat));
  }
  for (const auto& robot : robots_) {
    if (!floating_) robot->X_WB = pose_of(place_ + "." + robot->base_prefix + "quat0", robot->base.p, robot->base.quat);
  }
  X_FS_ = pose_of(place_ + ".mount_quat", mount_p_, mount_quat_);
  const std::size_t n = ranges_.size();
  angle_increment_ = n > 1 ? opening_ / static_cast<double>(n - 1) : 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double angle = (static_cast<double>(i) - static_cast<double>(n - 1) / 2) * angle_increment_;
    sin_[i] = std::sin(angle);
    cos_[i] = std::cos(angle);
  }
}

/// Brings what moves to the last step's end.
void Scanner::place() {
  for (std::size_t k = 0; k < bodies_.size(); ++k)
    if (cell_.parts[k].moves) cell_.place(cell_.parts[k], bodies_[k].pose.last());
  for (const auto& robot : robots_) {
    if (floating_) robot->X_WB = robot->base.last();
    robot->place(cell_, robot->q_before, robot->dq);
    for (std::size_t link = 0; link < robot->placed->shapes.size() && robot->is_in_cell(); ++link)
      (void)robot->show_tools(cell_, link);
  }
}

Pose Scanner::pose() const {
  Pose X_WB;
  if (frame_.robot >= 0) {
    const surroundings::Robot& robot = *robots_[static_cast<std::size_t>(frame_.robot)];
    X_WB = frame_.body < 0 ? robot.X_WB : robot.X_WL[static_cast<std::size_t>(frame_.body)];
  } else if (frame_.body >= 0) {
    X_WB = cell_.parts[static_cast<std::size_t>(frame_.body)].X_W;
  }
  return X_WB * frame_.X_BF * X_FS_;
}

void Scanner::find_targets(const Pose& X_WS) {
  targets_.clear();
  for (std::size_t k = 0; k < cell_.parts.size(); ++k) {
    const collision::Part& part = cell_.parts[k];
    if (part.body.empty()) continue;
    const Vector3d middle = part.middle - X_WS.p;
    const double radius = part.body.radius(), least = std::max(middle.norm() - radius, 0.0);
    if (least > range_max_ || std::abs(X_WS.R.col(1).dot(middle)) > radius) continue;
    const Vector3d p_B = part.X_W.R.transpose() * (X_WS.p - part.X_W.p);
    targets_.push_back({k, least, middle, p_B, part.body.contains(p_B)});
  }
  std::ranges::sort(targets_, {}, &Target::least);
}

double Scanner::first_along(const Vector3d& d, std::size_t& part) const {
  double best = scene::kInfinity;
  for (const Target& target : targets_) {
    const double most = std::min(best, range_max_);
    if (target.least > most) break;
    const collision::Part& candidate = cell_.parts[target.part];
    const double radius = candidate.body.radius(), ahead = d.dot(target.middle);
    if (target.least > 0 && (ahead < 0 || (target.middle - ahead * d).norm() > radius)) continue;
    const double t = target.around ? 0 : candidate.body.first_along({target.p_B, candidate.X_W.R.transpose() * d}, most);
    if (t < best) best = t, part = target.part;
  }
  return best;
}

/// 0 where nothing is measured.
double Scanner::measured(double distance, std::size_t beam) const {
  enum Stream : std::uint32_t { kNoise, kDropout };
  const auto key = [&](Stream stream) {
    return numerics::Key{static_cast<std::uint32_t>(seed_), stream, static_cast<std::uint32_t>(count_),
                         static_cast<std::uint32_t>(beam), 0};
  };
  if (!(distance > 0 && distance < scene::kInfinity)) return 0;
  if (dropout_ > 0 && numerics::uniform(key(kDropout)) < dropout_) return 0;
  if (sigma_ > 0) distance += sigma_ * numerics::normal(key(kNoise));
  if (resolution_ > 0) distance = resolution_ * std::round(distance / resolution_);
  return distance >= range_min_ && distance <= range_max_ ? std::max(distance, 0.0) : 0;
}

void Scanner::scan(Time now) {
  place();
  const Pose X_WS = pose();
  find_targets(X_WS);
  ++count_;
  t_scan_ = now.seconds();
  std::copy_n(X_WS.p.data(), 3, p_scan_.begin());
  put_quaternion(X_WS.R, quat_scan_);
  std::size_t part = 0;
  bool inside = false;
  for (std::size_t i = 0; i < ranges_.size(); ++i) {
    const double distance = inside ? 0 : first_along(X_WS.R.col(0) * sin_[i] + X_WS.R.col(2) * cos_[i], part);
    inside = distance == 0;
    ranges_[i] = measured(distance, i);
    if (ranges_[i] > 0) ++met_;
  }
  if (!inside) return;
  if (inside_[0] == 0) inside_ = {0, t_scan_, static_cast<double>(part)};
  ++inside_[0];
}

void Scanner::initialise(Time start) {
  if (!(range_min_ < range_max_))
    throw Error(place_ + ".range_max",
                "is " + text::to_text(range_max_) + " m, expected more than range_min, " + text::to_text(range_min_) + " m");
  place_static();
  check_inputs(start);
  std::ranges::fill(ranges_, 0.0);
  p_scan_ = {0, 0, 0};
  quat_scan_ = {1, 0, 0, 0};
  inside_ = {0, 0, 0};
  t_scan_ = met_ = 0;
  count_ = 0;
  remember();
  if (trigger_) scan(start);
}

void Scanner::restored() { place_static(); }

StepResult Scanner::step(Time now, Duration h) {
  check_inputs(now + h);
  if (trigger_ && !trigger_before_) scan(now);
  remember();
  return StepResult::kDone;
}

void Scanner::append_notes(std::vector<std::string>& notes) const {
  if (count_ == 0) {
    notes.emplace_back("took no profile: trigger never became true");
    return;
  }
  const double all = static_cast<double>(ranges_.size()) * count_;
  notes.push_back("took " + std::to_string(count_) + (count_ == 1 ? " profile; " : " profiles; ") +
                  text::to_text(100 * met_ / all, 3) + " % of the beams came back");
  if (inside_[0] == 0) return;
  notes.push_back(
      "was inside " + cell_.parts[static_cast<std::size_t>(inside_[2])].name + " in " + text::to_text(inside_[0]) +
      " of them, first at " + text::to_text(inside_[1], 6) +
      " s, and measured nothing there: mount_p is its place in its frame; robot_shapes=none lets beams pass through links");
}

}  // namespace cotwin::scanner
