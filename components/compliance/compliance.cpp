#include "components/compliance/compliance.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/drives/friction.h"
#include "models/robot/robot_model.h"

namespace cotwin::compliance {
namespace {

struct Sentence {
  std::int32_t what;
  std::string_view begin, end;  // around the numbers of the joints
};
/// In the order of the bits of `met`.
constexpr Sentence kSentences[] = {
    {1, "motor torques of joints ",
     " reached tau_max and were cut (outputs saturated, tau_excess): too much is asked, or the loop is unstable"},
    {2, "the compliant motion of joints ", " was stopped at a limit of position, q_min or q_max (output limit)"},
    {4, "the compliant motion of joints ", " was held at the limit of speed, dq_max (output limit)"},
    {8, "the desired motion of joints ", " is outside q_min, q_max or dq_max; it is followed all the same"},
    {16, "a rise of S_a or M_a of joints ", " had to wait: the energy for it was not in the tank (tank_start, tank_max)"}};
constexpr std::string_view kSeparator = "; ";

std::size_t longest_warning(std::size_t joints) {
  std::size_t length = 0;
  for (const Sentence& s : kSentences) length += s.begin.size() + s.end.size() + kSeparator.size() + 12 * joints;
  return length;
}

/// `floating`; throws Error if the robot's base has no mass to float with.
bool can_float(const std::string& place, const robot::RobotModel& robot, bool floating) {
  const std::string why = floating ? robot.base.inertia.unphysical() : "";
  if (!why.empty()) throw Error(place, "base=floating: the base of robot '" + robot.name + "' cannot float: " + why);
  return floating;
}

/// nullptr for compliance of the joints.
std::unique_ptr<CartesianMotion> cartesian(Settings& settings, const robot::RobotModel& robot, bool floating) {
  if (settings.choice("space") == "joints") return nullptr;
  if (floating) throw Error(settings.unit(), "space=cartesian with base=floating: expected base=fixed");
  return std::make_unique<CartesianMotion>(settings, robot);
}

}  // namespace

void Compliance::declare_settings(SettingList& s) {
  s.set_first_variables({"q_d", "q", "tau_e", "q_c", "tau_m", "S_a", "M_a", "zeta_a", "K", "omega"});
  s.robot("a name in models/robots, or a path to a URDF file").required();
  s.choice("base", {"fixed", "floating"}, "the base of the robot is fixed or moves freely, for example a satellite's");
  s.choice("space", {"joints", "cartesian"}, "compliance of each joint, or of a frame of the robot (3a), (3b)");
  CartesianMotion::declare_settings(s);
  s.boolean("terms", false, "the terms of (2a) in the compliant motion as outputs: inertia, Coriolis, gravity");
}

GainParameters::GainParameters(std::size_t joints) { write_start_values(*this, kGains, joints); }

Compliance::Compliance(Settings& settings) : Compliance(settings, settings.robot(), settings.choice("base") == "floating") {}

Compliance::Compliance(Settings& settings, const robot::RobotModel& robot, bool floating)
    : place_(settings.unit()),
      n_(static_cast<std::size_t>(robot.n())),
      measures_(&robot),
      links_(robot, can_float(place_, robot, floating)),
      floating_(floating),
      cartesian_(cartesian(settings, robot, floating)),
      drive_(n_),
      wanted_(n_),
      drive_in_force_(drive_),
      in_force_(wanted_),
      tracking_(robot) {
  for (Joints* input : {&q_d_, &dq_d_, &ddq_d_, &q_, &dq_, &theta_, &dtheta_, &tau_e_, &tau_e_rate_}) input->resize(n_);
  for (Joints* limit : {&tau_max_, &q_min_, &q_max_, &dq_max_, &tau_wind_up_}) limit->resize(n_);
  for (Joints* state : {&tau_fl_before_, &tau_fm_before_, &Delta_, &dDelta_, &ddq_d_before_, &z_, &tank_, &tau_cut_})
    state->resize(n_);
  for (Joints* output : {&q_c_, &dq_c_, &ddq_c_, &tau_m_, &tau_id_, &tau_f_, &tau_excess_}) output->resize(n_);
  for (Joints* scratch : {&a_q_, &tau_fl_, &tau_fm_, &load_mean_, &load_end_, &gravity_, &tau_acting_}) scratch->resize(n_);
  met_.resize(n_);
  limit_.resize(n_);
  limits_.resize(n_);
  link_sides_.resize(n_);
  if (settings.boolean("terms")) terms_ = std::make_unique<TorqueTerms>(n_);
  for (std::size_t i = 0; i < n_; ++i) {
    const robot::Joint& joint = robot.joints[i];
    if (joint.passive) {
      throw Error(place_, "joint '" + joint.name + "' of robot '" + robot.name +
                              "' is passive, expected a motor at every joint, because the control law drives all of them");
    }
    const auto finite = [](double value) { return std::isfinite(value) ? value : 0.0; };
    tau_max_[i] = finite(joint.tau_max);
    tau_wind_up_[i] = 0.45 * tau_max_[i];
    dq_max_[i] = finite(joint.dq_max);
    const bool bound = std::isfinite(joint.q_min) && std::isfinite(joint.q_max);
    q_min_[i] = bound ? joint.q_min : 0;
    q_max_[i] = bound ? joint.q_max : 0;
  }
  braking_.assign(n_, 10);
  tank_start_.assign(n_, 1);
  tank_max_.assign(n_, 10);
}

Compliance::~Compliance() = default;

void Compliance::initialise(Time) {
  checked_ = false;
  check();
  update_spin();
  drive_in_force_ = drive_;
  update_links();
  in_force_ = wanted_;
  checked_ = true;
  links_.update_bodies(place_);
  warning_.clear();
  warning_.reserve(longest_warning(n_) + (cartesian_ ? CartesianMotion::longest_warning() : 0));  // a step allocates nothing
  for (std::size_t i = 0; i < n_; ++i) {
    Delta_[i] = dDelta_[i] = z_[i] = 0;
    tank_[i] = std::min(tank_start_[i], tank_max_[i]);
    met_[i] = limit_[i] = 0;
    if (!cartesian_ && outside(limits(i), {q_d_[i], dq_d_[i]})) note(i, kDesired);
  }
  ddq_d_before_ = ddq_d_;
  start_motion();
  if (cartesian_ && cartesian_->impedance()) {
    for (std::size_t i = 0; i < n_; ++i) limits_[i] = limits(i);
    cartesian_->start_impedance(measured(), limits_);
    impede(0);
    finish_torques(0);
    return;
  }
  add_load(0);
  tracking_.start(links_, reference(), load(), drive_in_force_);
  tracking_.update_error(measured(), drive_in_force_);
  tracking_.torque(links_, reference(), load(), drive_in_force_, measured(), gains(), 0, tau_m_);
  finish_torques(0);
}

// A step:
//   1. the tracking error at its beginning, where the last step's reference and the measurements meet
//   2. parameters and gains move towards the tunables
//   3. q_c, q̇_c, q̈_c at its end
//   4. inverse dynamics of that motion, and θ_c, θ̇_c
//   5. the motor torque over the step
StepResult Compliance::step(Time, Duration h) {
  const double seconds = h.seconds();
  check();
  update_spin();
  if (cartesian_ && cartesian_->impedance()) {
    follow_tunables(seconds);
    impede(seconds);
    finish_torques(seconds);
    return StepResult::kDone;
  }
  tracking_.update_error(measured(), drive_in_force_);
  follow_tunables(seconds);
  brake_by_saturation(seconds);
  move_compliantly(seconds);
  add_load(seconds);
  tracking_.refer(links_, reference(), load(), drive_in_force_, {elastic_bandwidth_, tau_wind_up_}, seconds);
  tracking_.torque(links_, reference(), load(), drive_in_force_, measured(), gains(), seconds, tau_m_);
  finish_torques(seconds);
  return StepResult::kDone;
}

/// The momentum of a floating robot, in the axes of its base.
void Compliance::update_spin() {
  if (!floating_) return;
  const Eigen::Quaterniond Q(base_quat_[0], base_quat_[1], base_quat_[2], base_quat_[3]);
  const Eigen::Vector3d spin(spin_[0], spin_[1], spin_[2]);
  if (!(std::isfinite(Q.norm()) && Q.norm() > 0))
    throw Error(place_ + ".base_quat", "the quaternion (w, x, y, z) has length " + text::to_text(Q.norm()) + ", expected 1");
  if (!spin.allFinite()) throw Error(place_ + ".spin", "is not finite, expected three finite values");
  links_.set_spin(Q.normalized().conjugate() * spin);
}

void Compliance::start_motion() {
  if (cartesian_) {
    cartesian_->start(links_, from_joints());
    cartesian_->update_wrench(links_, from_joints(), tau_e_, tau_e_rate_);
    update_cartesian_motion();
    std::ranges::fill(a_q_, 0);
    return;
  }
  q_c_ = q_d_;
  dq_c_ = dq_d_;
  ddq_c_ = a_q_ = ddq_d_;
}

void Compliance::follow_tunables(double h) {
  const double remaining = transition_ > 0 ? std::exp(-h / transition_) : 0.0;
  const auto towards = [remaining](double value, double target) { return target + (value - target) * remaining; };
  if (!settled_) {
    follow(drive_in_force_, drive_, robot::kDriveParameters, remaining);
    update_links();
    follow(in_force_, wanted_, kGains, remaining);
  }
  if (cartesian_) cartesian_->follow(remaining, h);
  for (std::size_t i = 0; i < n_ && !cartesian_ && !settled_; ++i) {
    Admittance now{.M_a = in_force_.M_a[i], .S_a = in_force_.S_a[i]};
    Tank tank{tank_[i], tank_max_[i]};
    const Admittance next{.M_a = towards(now.M_a, wanted_.M_a[i]), .S_a = towards(now.S_a, wanted_.S_a[i])};
    if (!change(now, next, {Delta_[i], dDelta_[i]}, tank)) note(i, kTank);
    in_force_.M_a[i] = now.M_a;
    in_force_.S_a[i] = now.S_a;
    tank_[i] = tank.energy;
  }
  links_.follow_bodies(place_, remaining);
}

void Compliance::restored() {
  checked_ = false;
  copy_fixed(drive_in_force_, drive_, robot::kDriveParameters);
  update_links();
  links_.restored_bodies();
  if (cartesian_) cartesian_->restored();
}

/// The energy that saturated motors did not give in the last step is taken from the motion of the compliant frame.
void Compliance::brake_by_saturation(double h) {
  if (!cartesian_ || !cartesian_->brakes_saturated()) return;
  double energy = 0;
  for (std::size_t i = 0; i < n_; ++i) energy += std::max(h * tau_cut_[i] * dq_c_[i], 0.0);
  cartesian_->brake(energy);
}

void Compliance::move_frame_compliantly(double h) {
  for (std::size_t i = 0; i < n_; ++i) limits_[i] = limits(i);
  a_q_ = dq_c_;
  cartesian_->update_wrench(links_, from_joints(), tau_e_, tau_e_rate_);
  cartesian_->advance(links_, from_joints(), limits_, h);
  cartesian_->find_contact_stiffness(links_, drive_in_force_, gains(), elastic_bandwidth_, tau_e_acts_on_robot_, tau_max_, h);
  update_cartesian_motion();
  note_limits();
  for (std::size_t i = 0; i < n_; ++i) a_q_[i] = (dq_c_[i] - a_q_[i]) / h;
}

void Compliance::note_limits() {
  for (std::size_t i = 0; i < n_; ++i) {
    if (limit_[i] == static_cast<std::int32_t>(Limit::kPosition)) note(i, kPosition);
    if (limit_[i] == static_cast<std::int32_t>(Limit::kSpeed)) note(i, kSpeed);
  }
}

/// render=impedance in place of admittance and tracking. Friction is fed forward at the speed of the desired motion.
void Compliance::impede(double h) {
  cartesian_->update_wrench(links_, from_joints(), tau_e_, tau_e_rate_);
  for (std::size_t i = 0; i < n_; ++i) {
    limits_[i] = limits(i);
    tau_acting_[i] = tau_e_acts_on_robot_ ? tau_e_[i] : 0.0;
  }
  cartesian_->impede(links_, from_joints(), drive_in_force_, measured(), in_force_.shaping, limits_, tau_acting_, h, tau_m_);
  update_cartesian_motion();
  note_limits();
  tracking_.tau_c = tau_m_;
  tracking_.theta_c = theta_;
  tracking_.dtheta_c = dq_c_;
  update_gravity();
  for (std::size_t i = 0; i < n_; ++i) {
    robot::LinkSideParameters side = link_sides_[i];
    side.spring = {};  // part of the static torque
    tau_fl_[i] = side.at(q_c_[i], dq_c_[i], gravity_[i]).torque;
    tau_m_[i] += h > 0 ? (tau_fl_before_[i] + tau_fl_[i]) / 2 : tau_fl_[i];
    tau_fl_before_[i] = tau_fl_[i];
  }
}

void Compliance::update_cartesian_motion() {
  const JointMotion& joints = cartesian_->joints();
  const auto copy = [](const Eigen::VectorXd& from, Joints& to) { std::copy(from.begin(), from.end(), to.begin()); };
  copy(joints.q, q_c_);
  copy(joints.dq, dq_c_);
  copy(joints.ddq, ddq_c_);
  limit_ = joints.met;
  if (cartesian_->warnings_changed()) write_warning();
}

void Compliance::move_compliantly(double h) {
  if (cartesian_) return move_frame_compliantly(h);
  for (std::size_t i = 0; i < n_; ++i) {
    // (3a) prints Δx = x_d − x_c: a force would then pull against its own direction. x_c − x_d is meant, which yields to it.
    const GainParameters& p = in_force_;
    const Admittance admittance{p.M_a[i], p.D_a[i], p.zeta_a[i], p.S_a[i], p.omega_free[i]};
    const Desired desired{q_d_[i], dq_d_[i]};
    const double dDelta_before = dDelta_[i];
    Tank tank{tank_[i], tank_max_[i]};
    const Compliant c = advance(admittance, {Delta_[i], dDelta_before}, tau_e_[i], tau_e_rate_[i], limits(i), desired, h, tank);
    Delta_[i] = c.Delta.x;
    dDelta_[i] = c.Delta.dx;
    tank_[i] = tank.energy;
    limit_[i] = static_cast<std::int32_t>(c.limit);
    if (c.limit == Limit::kPosition) note(i, kPosition);
    if (c.limit == Limit::kSpeed) note(i, kSpeed);
    if (outside(limits(i), desired)) note(i, kDesired);

    q_c_[i] = q_d_[i] + c.Delta.x;
    dq_c_[i] = dq_d_[i] + c.Delta.dx;
    ddq_c_[i] = ddq_d_[i] + c.ddDelta;
    a_q_[i] = (ddq_d_before_[i] + ddq_d_[i]) / 2 + (c.Delta.dx - dDelta_before) / h;
    ddq_d_before_[i] = ddq_d_[i];
  }
}

void Compliance::add_load(double h) {
  update_gravity();
  for (std::size_t i = 0; i < n_; ++i) {
    tau_fl_[i] = link_sides_[i].at(q_c_[i], dq_c_[i], gravity_[i]).torque;
    load_mean_[i] = h > 0 ? (tau_fl_before_[i] + tau_fl_[i]) / 2 : tau_fl_[i];
    load_end_[i] = tau_fl_before_[i] = tau_fl_[i];
    if (!tau_e_acts_on_robot_) continue;
    load_mean_[i] -= tau_e_[i] + tau_e_rate_[i] * h / 2;
    load_end_[i] -= tau_e_[i] + tau_e_rate_[i] * h;
  }
}

// Friction of the motor in the reference motion, over a step at whose end the motor has the speed θ̇_c.
double Compliance::motor_friction(std::size_t i, double h) {
  const double v = tracking_.dtheta_c[i];
  if (drive_in_force_.sigma0[i] == 0) return robot::motor_friction(drive_in_force_, i).at(v).torque;
  const robot::Bristle bristle = robot::bristle(drive_in_force_, i);
  if (h > 0) z_[i] = robot::lugre_after(bristle, v, z_[i], h);
  return robot::lugre(bristle, v, z_[i]).torque + drive_in_force_.tau_0[i];
}

void Compliance::update_gravity() {
  if (std::ranges::all_of(drive_in_force_.link_load, [](double load) { return load == 0; })) return;
  const auto n = static_cast<Eigen::Index>(n_);
  links_.gravity(Eigen::Map<const Eigen::VectorXd>(q_c_.data(), n), Eigen::Map<Eigen::VectorXd>(gravity_.data(), n));
}

void Compliance::update_links() {
  for (std::size_t i = 0; i < n_; ++i) link_sides_[i] = robot::link_side(drive_in_force_, i);
}

// Adds friction of the motors and applies the limits.
void Compliance::finish_torques(double h) {
  if (terms_) terms_->compute(links_, q_c_, dq_c_, ddq_c_);
  saturated_ = false;
  for (std::size_t i = 0; i < n_; ++i) {
    tau_fm_[i] = motor_friction(i, h);
    tau_f_[i] = tau_fl_[i] + tau_fm_[i];
    tau_id_[i] = tracking_.tau_c[i] + tau_fm_[i];
    const double tau = tau_m_[i] + (h > 0 ? (tau_fm_before_[i] + tau_fm_[i]) / 2 : tau_fm_[i]);
    tau_fm_before_[i] = tau_fm_[i];
    tau_m_[i] = tau_max_[i] > 0 ? std::clamp(tau, -tau_max_[i], tau_max_[i]) : tau;
    tau_excess_[i] = tau_cut_[i] = tau - tau_m_[i];
    if (tau_excess_[i] == 0) continue;
    saturated_ = true;
    note(i, kTorque);
  }
}

void Compliance::note(std::size_t i, WarningBit what) {
  if ((met_[i] & what) != 0) return;
  met_[i] |= what;
  write_warning();
}

void Compliance::write_warning() {
  warning_.clear();
  for (const Sentence& s : kSentences) {
    bool first = true;
    for (std::size_t i = 0; i < n_; ++i) {
      if ((met_[i] & s.what) == 0) continue;
      if (first && !warning_.empty()) warning_ += kSeparator;
      warning_ += first ? s.begin : ", ";
      first = false;
      char digits[8];
      warning_.append(digits, std::to_chars(digits, digits + sizeof digits, i + 1).ptr);
    }
    if (!first) warning_ += s.end;
  }
  if (cartesian_) cartesian_->append_warning(warning_);
}

}  // namespace cotwin::compliance
