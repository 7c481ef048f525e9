#include "components/indices/indices.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::indices {
namespace {

/// In place of +∞, because outputs are finite.
constexpr double kLargest = 1e12;
/// Speed below which direction=motion takes u, m/s.
constexpr double kResting = 1e-6;
/// Rounding of speeds, relative, that does not count as too fast.
constexpr double kRounding = 1e-9;
/// Joints of a floating base, before those of the robot.
constexpr int kBaseJoints = 6;

double bounded(double value) { return std::min(value, kLargest); }

std::vector<std::string> listed(const std::string& list) {
  std::vector<std::string> names;
  if (list.empty()) return names;
  for (const std::string_view name : text::split(list, ',')) names.emplace_back(text::trim(name));
  return names;
}

constexpr const char* kTooFast = "E moved faster than the speed limit v_max of ";
constexpr const char* kNoLimit = "tau_max is not given for joints that then add nothing to the dynamic ellipsoids: ";

}  // namespace

void Indices::declare_settings(SettingList& s) {
  s.set_first_variables(
      {"q", "dq", "u", "effective_mass", "effective_inertia", "speed", "v_max", "kin_v", "kin_v_lengths", "warning"});
  s.robot("a name in models/robots, or a path to a URDF file").required();
  s.text("frame", "",
         "frame E of the robot to which the indices belong: a link of the URDF; none: the end of the longest chain");
  s.choice("direction", {"frame", "world", "motion"},
           "axes of u: those of the frame, or of the world; motion: along the velocity of the frame, at rest u in the world");
  s.choice("motors", {"free", "held"},
           "inertia that counts: that of the links (a blow), or with the motors that the gears hold to them (slower motions)");
  s.text("parts", "hands_and_fingers,chest", "body parts or regions for the speed limits: names of the table body_parts");
  s.choice("contact", {"transient", "quasi_static"},
           "limits of body parts for short contact that the person can leave, or for clamping");
  s.choice("robot_mass", {"larger", "effective"},
           "mass of the robot for the body parts: the larger one of M/2 + m_L (ISO/TS 15066, A.3.4) and effective_mass, or "
           "effective_mass, for which the motors must be known (B)");
  s.choice("base", {"fixed", "floating"}, "the base of the robot is fixed or moves freely, for example a satellite's");
}

Indices::Indices(Settings& settings) : Indices(settings, settings.robot(), settings.choice("base") == "floating") {}

Indices::Indices(Settings& settings, const robot::RobotModel& robot, bool floating)
    : settings_(settings),
      place_(settings.unit()),
      measures_(&robot),
      mechanism_(robot),
      data_(mechanism_),
      bodies_(robot),
      drive_(static_cast<std::size_t>(robot.n())),
      q_all_(Eigen::VectorXd::Zero(robot.n() + (floating ? kBaseJoints : 0))),
      dq_all_(q_all_),
      tau_max_all_(q_all_),
      gradient_all_(q_all_),
      inertia_at_E_(static_cast<int>(q_all_.size())),
      kinematic_(robot.n()),
      dynamic_(static_cast<int>(q_all_.size())) {
  if (robot.n() == 0) throw Error(place_, "robot '" + robot.name + "' has no movable joint, expected at least one");
  if (floating) {
    const std::string why = robot.base.inertia.unphysical();
    if (!why.empty()) throw Error(place_, "base=floating: the base of robot '" + robot.name + "' cannot float: " + why);
    floating_ = std::make_unique<Floating>(robot);
  }
  const std::string frame = settings.text("frame"), along = settings.choice("direction");
  frame_ = robot::on_body(frame.empty() ? robot.end_effector() : robot.frame(frame));
  along_ = along == "frame" ? Along::kFrame : along == "world" ? Along::kWorld : Along::kMotion;
  held_ = settings.choice("motors") == "held";
  names_ = listed(settings.text("parts"));
  transient_ = settings.choice("contact") == "transient";
  only_effective_ = settings.choice("robot_mass") == "effective";
  const auto n = static_cast<std::size_t>(robot.n());
  for (Joints* joints : {&q_, &dq_, &tau_max_, &B_, &gradient_}) joints->resize(n);
  for (Joints* part : {&mu_, &collision_, &v_max_}) part->resize(names_.size());
  fast_.resize(names_.size());
  for (std::size_t i = 0; i < n; ++i) {
    const robot::Joint& joint = robot.joints[i];
    if (joint.passive) {
      passive_.push_back(i);
    } else if (std::isfinite(joint.tau_max)) {
      tau_max_[i] = joint.tau_max;
    } else {
      unlimited_.push_back(i);
    }
  }
}

void Indices::declare(Variables& v) {
  JointVariables joints(v, measures_);
  joints.input("q", q_, "rad", "joint position at the step's end").essential();
  joints.input("dq", dq_, "rad/s", "joint velocity at the step's end");
  v.input("base_quat", base_quat_, "1", "orientation of the robot's base in W, unit quaternion (w, x, y, z)");
  v.tunable("u", u_, "1", "direction, in the axes that the setting direction names; its length has no meaning; acts at once");
  v.tunable("margin", margin_, "1", "safety margin: speeds above (1 - margin) v_max are reported").range(0, 1);
  v.tunable("contact_area", area_, "m2",
            "area of contact with a body part, for its permissible pressure; 0: only the permissible force counts")
      .range(0, 1);
  v.parameter("transition", transition_, "s", "time constant with which B and bodies in force follow the tunables; 0: at once")
      .range(0, 1e6);
  joints.parameter("tau_max", tau_max_, "N.m", "largest motor torque, from the URDF's effort; 0: the joint is not driven")
      .range(0, 1e12);
  v.parameter("body_parts", body_parts_, "table of body parts (CSV) with the columns of models/people/iso_ts_15066.csv");
  auto B = joints.parameter(drive_, robot::drive_parameter("B"), true, "; with motors=held");
  if (only_effective_) {
    B.required();  // a mass without motors permits speeds that hurt
  } else if (held_) {
    B.essential();
  }

  v.output("effective_mass", mass_, "kg", "m_u of E along u: a force along u accelerates E by force / m_u; 1e12: cannot move");
  v.output("effective_inertia", inertia_, "kg.m2", "likewise about u: a moment over it is the angular acceleration about u");
  joints.output("gradient", gradient_, "kg/rad", "derivative of effective_mass by q, with u fixed in its axes; 0 at 1e12");
  v.output("speed", speed_, "m/s", "velocity of E along u in W (of a fixed base: relative to it)");
  v.output("energy", energy_, "J", "kinetic energy of effective_mass at that speed");
  declare_ellipsoid(v, "kin_v", kin_v_, "velocities of E for joint speeds of norm 1", "m/s", "m3/s3", false);
  declare_ellipsoid(v, "kin_w", kin_w_, "angular velocities of E for joint speeds of norm 1", "rad/s", "rad3/s3", false);
  declare_ellipsoid(v, "dyn_v", dyn_v_, "accelerations of E that the motors reach", "m/s2", "m3/s6", true);
  declare_ellipsoid(v, "dyn_w", dyn_w_, "angular accelerations of E that the motors reach", "rad/s2", "rad3/s6", true);
  v.output("warning", warning_, "what the user should know after the run; empty if nothing");
  joints.state("B_in_force", B_, "kg.m2", "B on its way to the tunable");
  declare_bodies(v, bodies_, true);
  if (floating_) {
    v.input("base_v", base_v_, "m/s", "velocity of the floating base's origin in W");
    v.input("base_w", base_w_, "rad/s", "angular velocity of the floating base in W");
    v.output("Z", floating_->Z, "1",
             "angular velocity of the base per joint speed without momentum (V-C), in the base's axes, 3 x n by rows; columns "
             "of prismatic joints in rad/m");
    v.output("sigma_Z", floating_->sigma_Z, "1",
             "singular values of Z, largest first; 0: there is an axis about which no joint motion turns the base");
    v.output(
        "sigma_min", floating_->sigma_min, "1",
        "least singular value of the generalised Jacobian J*, m per rad (m), rotations times 0.3 m; 0: dynamically singular");
  }
  if (names_.empty()) return;
  v.output("reduced_mass", mu_, "kg", "of the mass of the setting robot_mass and that of each body part of the setting parts");
  v.output("collision_energy", collision_, "J", "energy that a collision with each body part at rest takes up at this speed");
  v.output("v_max", v_max_, "m/s",
           "speed along u at which each body part at rest receives its permissible force; 0: contact is not permitted");
  v.state("too_fast", fast_, "1 for a body part once the speed was above (1 - margin) v_max");
  v.tunable("load", load_, "kg", "m_L at E that is no body of the robot, in both masses for the body parts").range(0, 1e6);
  v.output("simple_mass", simple_mass_, "kg",
           "M/2 + m_L of ISO/TS 15066, A.3.4; M: what moves, with the tools that are attached");
}

void Indices::declare_ellipsoid(Variables& v, const std::string& name, EllipsoidPorts& e, const std::string& what,
                                const std::string& length, const std::string& measure, bool with_centre) {
  v.output(name, e.measure, measure, "manipulability: product of " + name + "_lengths");
  v.output(name + "_axes", e.axes, "1",
           "directions of the half-axes in W of the ellipsoid of " + what + ", one after the other");
  v.output(name + "_lengths", e.lengths, length, "lengths of these half-axes, longest first; 1e12: without bound");
  if (with_centre) v.output(name + "_centre", e.centre, length, "centre of this ellipsoid in W: acceleration without motors");
}

void Indices::EllipsoidPorts::write(const robot::Ellipsoid& ellipsoid, const Eigen::Matrix3d& R_WB) {
  measure = 1;
  for (std::size_t i = 0; i < lengths.size(); ++i) {
    lengths[i] = bounded(ellipsoid.lengths[static_cast<Eigen::Index>(i)]);
    measure *= lengths[i];
  }
  Eigen::Map<Eigen::Matrix3d>(axes.data()) = R_WB * ellipsoid.axes;
  Eigen::Map<Eigen::Vector3d>(centre.data()) = R_WB * ellipsoid.centre;
}

void Indices::read_body_parts() {
  parts_.clear();
  if (names_.empty()) return;
  const std::vector<robot::BodyPart> all = robot::load_body_parts(settings_.file(body_parts_));
  for (const std::string& name : names_) parts_.push_back(robot::find_body_part(all, name, place_ + ": parts"));
}

void Indices::check() const {
  const auto length = [](const auto& v) {
    double sum = 0;
    for (const double x : v) sum += x * x;
    return std::sqrt(sum);
  };
  const auto fail = [this](const char* name, double value) {
    throw Error(place_ + "." + name, "has the length " + text::to_text(value) + ", expected a finite length > 0");
  };
  for (const auto& [name, value] : {std::pair{"u", length(u_)}, std::pair{"base_quat", length(base_quat_)}}) {
    if (!(value > 1e-150) || !std::isfinite(value)) fail(name, value);
  }
  const auto finite = [this](const char* name, const auto& values) {
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (!std::isfinite(values[i]))
        throw Error(place_ + "." + name + "[" + std::to_string(i + 1) + "]",
                    "is " + text::to_text(values[i]) + ", expected a finite value");
    }
  };
  finite("q", q_);
  finite("dq", dq_);
  finite("base_v", base_v_);
  finite("base_w", base_w_);
  if (held_ || only_effective_) {
    for (std::size_t i = 0; i < drive_.B.size(); ++i) {
      const bool known = !only_effective_ || drive_.B[i] > 0 || std::ranges::find(passive_, i) != passive_.end();
      if (drive_.B[i] >= 0 && std::isfinite(drive_.B[i]) && known) continue;
      throw Error(place_ + ".B[" + std::to_string(i + 1) + "]",
                  "is " + text::to_text(drive_.B[i]) + ", expected a finite value " +
                      (only_effective_ ? "> 0 with robot_mass=effective" : ">= 0"));
    }
  }
}

void Indices::initialise(Time) {
  check();
  read_body_parts();
  bodies_.take(place_, mechanism_);
  adopt_bodies();
  B_ = drive_.B;
  for (const std::size_t i : passive_) B_[i] = 0;
  std::fill(fast_.begin(), fast_.end(), 0);
  warning_.clear();
  std::size_t longest = 200 + 12 * q_.size();
  for (const std::string& name : names_) longest += name.size() + 2;
  warning_.reserve(longest);  // a step allocates nothing
  compute();
  write_warning();
}

StepResult Indices::step(Time, Duration h) {
  check();
  const double remaining = transition_ > 0 ? std::exp(-h.seconds() / transition_) : 0.0;
  for (std::size_t i = 0; i < B_.size(); ++i) B_[i] = drive_.B[i] + (B_[i] - drive_.B[i]) * remaining;
  for (const std::size_t i : passive_) B_[i] = 0;
  if (bodies_.follow(place_, remaining, mechanism_)) adopt_bodies();
  compute();
  return StepResult::kDone;
}

void Indices::restored() {
  bodies_.restored(mechanism_);
  adopt_bodies();
}

void Indices::adopt_bodies() {
  moving_mass_ = robot::moving_mass(bodies_.robot()) + (floating_ ? bodies_.robot().base.inertia.mass : 0);
  if (floating_) floating_->mechanism.update(bodies_.robot());
}

/// The unit vector in B.
Eigen::Vector3d Indices::direction(const Eigen::Vector3d& v_E, const Eigen::Matrix3d& R_WB) const {
  if (along_ == Along::kMotion && v_E.norm() > kResting) return v_E.normalized();
  const Eigen::Vector3d u = Eigen::Map<const Eigen::Vector3d>(u_.data()).stableNormalized();
  return along_ == Along::kFrame ? Eigen::Vector3d(inertia_at_E_.X_BF.R * u) : Eigen::Vector3d(R_WB.transpose() * u);
}

/// Positions, speeds and torques of all joints.
void Indices::update_motion(const Eigen::Matrix3d& R_WB) {
  using Vector = Eigen::Map<const Eigen::VectorXd>;
  const auto n = static_cast<Eigen::Index>(q_.size());
  q_all_.tail(n) = Vector(q_.data(), n);
  dq_all_.tail(n) = Vector(dq_.data(), n);
  tau_max_all_.tail(n) = Vector(tau_max_.data(), n);
  if (!floating_) return;
  dq_all_.head<3>() = R_WB.transpose() * Eigen::Map<const Eigen::Vector3d>(base_v_.data());
  dq_all_.segment<3>(3) = R_WB.transpose() * Eigen::Map<const Eigen::Vector3d>(base_w_.data());
}

// Steps:
//   1. the inertia at E
//   2. masses along u and their gradient
//   3. ellipsoids
//   4. body parts
void Indices::compute() {
  const auto n = static_cast<Eigen::Index>(q_.size());
  const Eigen::Matrix3d R_WB =
      Eigen::Quaterniond(base_quat_[0], base_quat_[1], base_quat_[2], base_quat_[3]).normalized().toRotationMatrix();
  update_motion(R_WB);
  const Eigen::Map<const Eigen::VectorXd> B(B_.data(), held_ ? n : 0);
  robot::FrameInertia& f = inertia_at_E_;
  const robot::Mechanism& mechanism = floating_ ? floating_->mechanism.with_base() : mechanism_;
  robot::Data& data = floating_ ? floating_->data.data : data_;
  robot::FrameOnBody frame = frame_;
  if (floating_) {
    robot::frame_inertia(floating_->mechanism, floating_->data, q_all_.tail(n), B, frame_, f);
    frame.body += kBaseJoints;
  } else {
    robot::frame_inertia(mechanism_, data_, q_all_, B, frame_, f);
  }

  const Eigen::Vector3d v_E = f.J.topRows<3>().lazyProduct(dq_all_);
  const Eigen::Vector3d u = direction(v_E, R_WB);
  const double mass = robot::effective_mass(f, u);
  mass_ = bounded(mass);
  inertia_ = bounded(robot::effective_inertia(f, u));
  speed_ = u.dot(v_E);
  energy_ = std::isinf(mass) ? 0 : robot::collision_energy(mass, speed_);
  robot::effective_mass_gradient(mechanism, data, q_all_, frame, f, u,
                                 along_ == Along::kFrame ? robot::Direction::kInFrame : robot::Direction::kInBase,
                                 gradient_all_);
  std::copy_n(gradient_all_.data() + gradient_all_.size() - n, n, gradient_.begin());

  if (floating_) {
    robot::floating_inertia(floating_->mechanism, floating_->data, q_all_.tail(n), floating_->inertia);
    robot::generalised_jacobian(floating_->mechanism, floating_->data, floating_->inertia, q_all_.tail(n), frame_,
                                floating_->without_momentum.J);
    compute_reaction();
  }
  robot::kinematic_manipulability(floating_ ? floating_->without_momentum : f, kinematic_);
  kin_v_.write(kinematic_.translation, R_WB);
  kin_w_.write(kinematic_.rotation, R_WB);
  robot::dynamic_manipulability(mechanism, data, q_all_, dq_all_, frame, f, tau_max_all_, dynamic_);
  dyn_v_.write(dynamic_.translation, R_WB);
  dyn_w_.write(dynamic_.rotation, R_WB);
  simple_mass_ = robot::simple_effective_mass(moving_mass_, load_);
  const double with_load = robot::effective_mass(f, u, load_);
  compute_body_parts(only_effective_ ? with_load : std::max(with_load, simple_mass_), std::abs(speed_));
}

void Indices::compute_reaction() {
  constexpr double kLength = 0.3;  // m: a rotation by 1 rad counts as much as this distance
  Floating& f = *floating_;
  const Eigen::Index n = f.inertia.F.cols();
  Eigen::Map<Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor>>(f.Z.data(), 3, n) = f.inertia.Z();
  f.rows.leftCols<3>() = f.inertia.Z().transpose();
  robot::singular_values(f.rows.leftCols<3>(), Eigen::Map<Eigen::VectorXd>(f.sigma_Z.data(), 3));
  Eigen::Matrix<double, 6, 1> sigma;
  f.rows = f.without_momentum.J.transpose();
  f.rows.rightCols<3>() *= kLength;
  robot::singular_values(f.rows, sigma);
  f.sigma_min = sigma[std::min<Eigen::Index>(n, 6) - 1];
}

void Indices::compute_body_parts(double mass, double speed) {
  bool changed = false;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const robot::BodyPart& part = parts_[i];
    const double force = (transient_ ? part.transient : part.quasi_static).on(area_);
    mu_[i] = robot::reduced_mass(mass, part.mass);
    collision_[i] = robot::collision_energy(mu_[i], speed);
    v_max_[i] = force > 0 ? bounded(robot::speed_limit_of_force(force, part.stiffness, mu_[i])) : 0;
    if (fast_[i] != 0 || speed <= (1 - margin_) * v_max_[i] + kRounding) continue;
    fast_[i] = 1;
    changed = true;
  }
  if (changed) write_warning();
}

void Indices::write_warning() {
  warning_.clear();
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    if (fast_[i] == 0) continue;
    warning_ += warning_.empty() ? kTooFast : ", ";
    warning_ += names_[i];
  }
  bool first = true;
  for (const std::size_t i : unlimited_) {
    if (tau_max_[i] > 0) continue;
    if (first && !warning_.empty()) warning_ += "; ";
    warning_ += first ? kNoLimit : ", ";
    first = false;
    char digits[8];
    warning_.append(digits, std::to_chars(digits, digits + sizeof digits, i + 1).ptr);
  }
}

}  // namespace cotwin::indices
