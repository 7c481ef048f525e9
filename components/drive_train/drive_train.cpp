#include "components/drive_train/drive_train.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "components/drive_train/events.h"
#include "components/drive_train/floating_links.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"
#include "models/robot/start.h"

namespace cotwin::drive_train {
namespace {

constexpr std::size_t kLongestWarning = 512;
constexpr double kNegligible = 1e-9;  // rest of a tunable's change that is dropped: without changes, forces stay valid
/// Inertia of the motor of a passive joint with an elastic transmission, kg m²: nothing acts on this motor and its energy is
/// below rounding; its equation keeps its form.
constexpr double kNoInertia = 1e-30;

/// Stiffness of a stop: the joint's largest torque presses it 10 mrad or 10 mm into the stop.
double default_stop(const robot::Joint& joint) {
  constexpr double kDepth = 0.01;         // rad or m
  constexpr double kWithoutTorque = 1e4;  // N.m/rad or N/m, where the robot has no torque limits
  if (!std::isfinite(joint.q_min) && !std::isfinite(joint.q_max)) return 0;
  return joint.tau_max > 0 && std::isfinite(joint.tau_max) ? joint.tau_max / kDepth : kWithoutTorque;
}

/// Calls visit(parameter, offset in the state `drives`) for each tunable parameter. Returns the size of that state.
template <class Visit>
std::ptrdiff_t for_each_tunable(std::size_t joints, const Visit& visit) {
  std::ptrdiff_t offset = 0;
  for (const auto& row : robot::kDriveParameters) {
    if (row.mutability == Mutability::kFixed) continue;
    visit(row.values, offset);
    offset += static_cast<std::ptrdiff_t>(joints);
  }
  return offset;
}

}  // namespace

void DriveTrain::declare_settings(SettingList& s) {
  s.set_first_variables({"tau_m", "tau_e", "q", "dq", "theta", "tau_J", "tau_f", "q0", "K", "B"});
  s.robot("a name in models/robots, or a path to a URDF file; with link_side=outside it may be left out");
  s.integer("joints", 1, 1, 1000, "number of joints where there is no robot, with link_side=outside");
  s.choice("link_side", {"inside", "outside"},
           "where the link side (2a) is integrated: in this unit, or in another that gives q");
  s.choice("base", {"fixed", "floating"},
           "with link_side=inside: the base is fixed or moves freely, for example a satellite's; with link_side=outside the "
           "other unit "
           "moves it");
  s.choice("transmission", {"flexible", "rigid"}, "joints with the stiffness K of (2c), or rigid ones: theta = q");
  s.choice("friction", {"lugre", "elasto_plastic", "coulomb", "smooth"},
           "friction of the motors: LuGre, an elasto-plastic bristle, Coulomb friction that sticks exactly, or one without "
           "sticking, smooth in the speed");
  s.choice("method", {"auto", "exponential", "rosenbrock", "cvode"},
           "solver of the differential equations: auto takes the exponential method, and where damping is too fast for it the "
           "Rosenbrock method; cvode is SUNDIALS' CVODE: take it, with a small rtol, to check these two in your own scenario");
  s.boolean(
      "terms", false,
      "with link_side=inside: the terms of (2a) as outputs (inertia, Coriolis, gravity, link); the unit then has no partial "
      "derivatives");
}

// The values of the settings.
struct DriveTrain::Kind {
  explicit Kind(Settings& s) {
    link = s.choice("link_side") == "inside" ? LinkSide::kInside : LinkSide::kOutside;
    transmission = s.choice("transmission") == "flexible" ? Transmission::kFlexible : Transmission::kRigid;
    const std::string f = s.choice("friction");
    friction = f == "lugre"     ? Friction::kLugre
               : f == "coulomb" ? Friction::kCoulomb
               : f == "smooth"  ? Friction::kSmooth
                                : Friction::kElastoPlastic;
    base = s.choice("base") == "fixed" ? Base::kFixed : Base::kFloating;
    if (link == LinkSide::kOutside) base = Base::kFixed;  // the unit of the links moves it
    const std::string m = s.choice("method");
    if (base == Base::kFloating && m != "auto" && m != "rosenbrock")
      throw Error(s.unit(), "base=floating with method=" + m + ": the base has no history or closed form, expected rosenbrock");
    cvode = m == "cvode";
    method = m == "rosenbrock" || base == Base::kFloating ? Integrator::Method::kRosenbrock
             : m == "exponential"                         ? Integrator::Method::kExponential
                                                          : Integrator::Method::kAuto;
    terms = s.boolean("terms");
    if (terms && link == LinkSide::kOutside)
      throw Error(s.unit(),
                  "terms=true with link_side=outside: the unit of the links has their torques, expected link_side=inside");
    if (transmission == Transmission::kRigid && link == LinkSide::kOutside) {
      throw Error(s.unit(), "transmission=rigid with link_side=outside leaves nothing to move, expected one of them");
    }
    if (transmission == Transmission::kRigid && friction == Friction::kCoulomb) {
      throw Error(s.unit(),
                  "friction=coulomb sticks exactly only in front of an elastic gear, expected friction=lugre or elasto_plastic "
                  "with transmission=rigid");
    }
    if (link == LinkSide::kInside || !s.text("robot").empty()) {
      robot = s.robot();
      joints = static_cast<std::size_t>(robot->n());
      if (joints == 0) throw Error(s.unit(), "robot '" + robot->name + "' has no movable joint, expected at least one");
      const std::string why = robot->base.inertia.unphysical();
      if (base == Base::kFloating && !why.empty())
        throw Error(s.unit(), "base=floating: the base of robot '" + robot->name + "' cannot float: " + why);
    } else {
      joints = static_cast<std::size_t>(s.integer("joints"));
    }
  }
  LinkSide link;
  Base base;
  Transmission transmission;
  Friction friction;
  bool cvode;
  Integrator::Method method;
  bool terms;
  std::optional<robot::RobotModel> robot;
  std::size_t joints;
};

DriveTrain::DriveTrain(Settings& settings) : DriveTrain(settings, Kind(settings)) {}

DriveTrain::DriveTrain(Settings& settings, const Kind& kind)
    : place_(settings.unit()),
      n_(kind.joints),
      measures_(kind.robot ? &*kind.robot : nullptr),
      equations_(kind.robot ? &*kind.robot : nullptr, n_, kind.link, kind.transmission, kind.friction, kind.base),
      integrator_(equations_, kind.method),
      partials_(equations_),
      wanted_(n_),
      drives_(static_cast<std::size_t>(for_each_tunable(n_, [](auto, std::ptrdiff_t) {}))),
      x_(5 * n_),
      x_before_step_(5 * n_),
      modes_before_step_(n_),
      at_start_(n_),
      limits_(kind.robot ? kind.robot->joints : std::vector<robot::Joint>(n_)) {
  for (auto* v : {&q0_, &dq0_, &tau_m_, &dtau_m_, &tau_e_, &dtau_e_, &q_in_, &dq_in_, &tau_m_before_, &tau_e_before_,
                  &q_before_, &dq_before_, &ddq_, &tau_J_, &tau_f_}) {
    v->resize(n_);
  }
  if (equations_.inside()) {
    load_factor_.resize(n_ * n_);
    load_torque_.resize(n_);
    load_damping_.resize(n_);
  }
  with_terms_ = kind.terms;
  if (with_terms_) terms_ = TorqueTerms(n_);
  if (kind.cvode) {
    cvode_ = std::make_unique<CvodeSolver>(equations_);
    rtol_ = 1e-6;
    atol_ = 1e-9;
    atol_speed_ = 1e-7;
  }
  if (!kind.robot) {
    update_drives();
    return;
  }
  for (std::size_t i = 0; i < n_; ++i) {
    const robot::Joint& joint = kind.robot->joints[i];
    if (joint.passive) passive_.push_back(i);
    wanted_.q_min[i] = joint.q_min;
    wanted_.q_max[i] = joint.q_max;
    wanted_.stop_stiffness[i] = default_stop(joint);
    q0_[i] = robot::default_start(joint);
  }
  free_passive_joints();
  update_drives();
}

DriveTrain::~DriveTrain() = default;

void DriveTrain::check_inputs(Time now) const {
  const auto check = [&](const char* name, const std::vector<double>& v) {
    for (std::size_t i = 0; i < v.size(); ++i) {
      if (std::isfinite(v[i])) continue;
      throw Error(place_ + "." + name + "[" + std::to_string(i + 1) + "]",
                  "is " + text::to_text(v[i]) + " at " + text::to_text(now.seconds()) + " s, expected a finite value");
    }
  };
  check("tau_m", tau_m_);
  check("tau_m (rate)", dtau_m_);
  check("tau_e", tau_e_);
  check("tau_e (rate)", dtau_e_);
  check("load_factor", load_factor_);
  check("load_torque", load_torque_);
  check("load_damping", load_damping_);
  check("q", q_in_);
  check("dq", dq_in_);
  if (equations_.floating()) equations_.floating()->check_inputs(place_, now.seconds());
}

/// Removes the motors and gears of passive joints, whatever their parameters are.
void DriveTrain::free_passive_joints() {
  using P = robot::DriveParameters;
  for (const std::size_t i : passive_) {
    for (const auto values :
         {&P::K, &P::D, &P::backlash, &P::sigma0, &P::sigma1, &P::sigma2, &P::tau_C, &P::tau_S, &P::tau_0}) {
      (wanted_.*values)[i] = 0;
    }
    wanted_.B[i] = equations_.flexible() ? kNoInertia : 0;
  }
}

/// Sets all parameters in force to the wanted ones.
void DriveTrain::update_drives() {
  equations_.parameters() = wanted_;
  equations_.adopt_parameters();
  write_drives();
}

/// Moves the tunables in force towards the wanted ones: `remaining` of the difference is left. Returns whether anything
/// changed.
bool DriveTrain::follow_drives(double remaining) {
  free_passive_joints();
  if (!differ(equations_.parameters(), wanted_, robot::kDriveParameters)) return false;
  check_parameters();
  follow(equations_.parameters(), wanted_, robot::kDriveParameters, remaining, kNegligible);
  equations_.adopt_parameters();
  write_drives();
  return true;
}

/// Writes the tunables in force to the state `drives`.
void DriveTrain::write_drives() {
  for_each_tunable(n_, [this](auto values, std::ptrdiff_t offset) {
    std::ranges::copy(equations_.parameters().*values, drives_.begin() + offset);
  });
}

/// Sets the tunables in force to the state `drives`.
void DriveTrain::adopt_drives() {
  for_each_tunable(n_, [this](auto values, std::ptrdiff_t offset) {
    std::copy_n(drives_.begin() + offset, n_, (equations_.parameters().*values).begin());
  });
  equations_.adopt_parameters();
}

void DriveTrain::initialise(Time start) {
  free_passive_joints();
  check_parameters();
  check_inputs(start);
  update_drives();
  drives_before_step_ = drives_;  // allocates what steps need
  if (equations_.inside()) {
    equations_.update_bodies(place_);
    bodies_before_step_ = equations_.bodies().in_force;
    follow_load();
  }
  tool_changes_seen_ = tool_changes_;
  energy_bodies_ = 0;
  integrator_.forget();
  equations_.modes().clear();
  std::fill(x_.begin(), x_.end(), 0.0);
  tau_m_before_ = tau_m_;
  tau_e_before_ = tau_e_;
  q_before_ = q_in_;
  dq_before_ = dq_in_;
  proposal_ = 0;
  dissipated_ = work_m_ = work_e_ = work_0_ = error_ = 0;
  substeps_ = forced_ = events_ = 0;
  forced_steps_ = warned_steps_ = 0;
  limits_.clear();
  warned_limits_ = 0;
  worst_error_ = 0;
  warning_.clear();
  warning_.reserve(kLongestWarning);  // a step allocates nothing
  update_course(0);

  // Start with θ at which the gear carries the links: the joint torque that balances (2a) at τ_J = 0 and q̈ = 0. Bristles as in
  // steady motion.
  double *q = x_.data(), *dq = q + n_, *theta = q + 2 * n_, *dtheta = q + 3 * n_, *z = q + 4 * n_;
  std::copy(q0_.begin(), q0_.end(), q);
  std::copy(dq0_.begin(), dq0_.end(), dq);
  if (equations_.floating()) equations_.floating()->initialise(q, dq);
  equations_.prescribe(0, q);
  for (std::size_t i = 0; i < n_; ++i) {
    theta[i] = q[i];
    dtheta[i] = dq[i];
    if (equations_.has_bristles()) z[i] = equations_.bristle(i).steady_deflection(dq[i]);
  }
  settle_modes(equations_, q, true);
  Point p(n_);
  equations_.evaluate(q, p);  // with φ = 0 and θ̇ = q̇: τ_J = 0
  for (std::size_t i = 0; i < n_ && equations_.flexible(); ++i) {
    if (equations_.passive(i)) continue;
    // Outside, the load is unknown: the torque that the motor holds at rest.
    const double tau_J = equations_.inside() ? -equations_.link_balance(p, i, tau_e_[i], tau_m_[i], p.h[i])
                                             : equations_.motor_balance(p, i, tau_m_[i]);
    theta[i] = q[i] + equations_.torsion(i).under(tau_J);
  }
  settle_modes(equations_, q, true);
  equations_.evaluate(q, p);
  if (uses_cvode()) {
    cvode_->configure({.relative = rtol_, .angle = atol_, .speed = atol_speed_});
    std::fill(cvode_->log().x.begin(), cvode_->log().x.end(), 0.0);
    std::fill(cvode_->log().steps.begin(), cvode_->log().steps.end(), 0.0);
    cvode_->log().modes.clear();
    cvode_->log().count = 0;
  }
  write_outputs(0, p);
}

// The inputs as functions of the time in this step.
void DriveTrain::update_course(double h) {
  Course& c = equations_.course();
  const bool ramp = input_order_ == 1 && h > 0;
  const bool arc = (link_order_ < 0 ? input_order_ : link_order_) == 1 && h > 0;
  for (std::size_t i = 0; i < n_; ++i) {
    c.tau_m[i] = ramp ? tau_m_before_[i] : tau_m_[i];
    c.tau_e[i] = ramp ? tau_e_before_[i] : tau_e_[i];
    c.dtau_m[i] = ramp ? (tau_m_[i] - tau_m_before_[i]) / h : dtau_m_[i];
    c.dtau_e[i] = ramp ? (tau_e_[i] - tau_e_before_[i]) / h : dtau_e_[i];
    if (equations_.passive(i)) c.tau_m[i] = c.dtau_m[i] = 0;
    if (equations_.inside()) {
      c.tau_e[i] += load_torque_[i];
      continue;
    }
    double *c0 = c.link.data() + i, *c1 = c0 + n_, *c2 = c1 + n_, *c3 = c2 + n_;
    *c0 = arc ? q_before_[i] : q_in_[i];
    *c1 = arc ? dq_before_[i] : dq_in_[i];
    // Hermite's cubic through q and q̇ at both ends
    const double chord = arc ? (q_in_[i] - q_before_[i]) / h : 0;
    *c2 = arc ? (3 * chord - 2 * dq_before_[i] - dq_in_[i]) / h : 0;
    *c3 = arc ? (dq_before_[i] + dq_in_[i] - 2 * chord) / (h * h) : 0;
  }
}

// A step:
//   1. the inputs as functions of time
//   2. tunables in force
//   3. the solver
//   4. energy accounts and outputs at the step's end
//   5. the inputs, for the next step
StepResult DriveTrain::step(Time now, Duration duration) {
  check_inputs(now);
  const double h = duration.seconds();
  update_course(h);
  const double tool_changes_before = tool_changes_seen_, energy_bodies_before = energy_bodies_;
  const bool follows = !uses_cvode(), with_bodies = equations_.inside();
  if (with_bodies) bodies_before_step_ = equations_.bodies().in_force;
  const double remaining = transition_ > 0 ? std::exp(-h / transition_) : 0.0;
  drives_before_step_ = drives_;
  const bool drives_change = follows && follow_drives(remaining);
  const bool bodies_change = with_bodies && follow_bodies(remaining);
  const bool load_changes = with_bodies && follow_load();
  if (drives_change || bodies_change || load_changes) integrator_.forget();
  if ((bodies_change || load_changes) && uses_cvode()) cvode_->log().count = 0;  // restarts with these bodies
  if (equations_.floating()) {
    equations_.begin_base(x_.data());
    integrator_.forget();
  }
  x_before_step_ = x_;
  modes_before_step_ = equations_.modes();
  const double proposal_before = proposal_;
  StepAccount account;
  const bool done = uses_cvode()
                        ? cvode_->step(h, x_.data(), account)
                        : integrator_.step(h, x_.data(), proposal_, {.relative = rtol_, .angle = atol_, .speed = atol_speed_},
                                           max_substeps_, account);
  if (!done) {
    x_ = x_before_step_;
    equations_.modes() = modes_before_step_;
    proposal_ = proposal_before;
    if (with_bodies) {
      equations_.bodies().in_force = bodies_before_step_;
      tool_changes_seen_ = tool_changes_before;
      energy_bodies_ = energy_bodies_before;
      equations_.restored_bodies();
      if (equations_.floating()) equations_.floating()->set_velocity(x_.data(), x_.data() + n_);
    }
    if (follows) {
      drives_ = drives_before_step_;
      adopt_drives();
    }
    integrator_.forget();
    return StepResult::kDiscard;
  }
  if (FloatingLinks* base = equations_.floating()) {
    const double work = base->work();
    equations_.end_base(h, x_before_step_.data(), x_.data());
    account.work_e += base->work() - work;
  }
  work_m_ += account.work_m;
  work_e_ += account.work_e - equations_.load_energy(x_.data() + n_) + equations_.load_energy(x_before_step_.data() + n_);
  dissipated_ += account.dissipated;
  work_0_ += equations_.work_of_constant_friction(x_before_step_.data(), x_.data());
  error_ = account.error;
  substeps_ = account.substeps;
  forced_ = account.forced;
  worst_error_ = std::max(worst_error_, error_);
  forced_steps_ += forced_ > 0;
  if (equations_.inside()) limits_.look(x_.data(), wanted_, (now + duration).seconds());
  if (forced_steps_ != warned_steps_ || limits_.count() != warned_limits_) write_warning();
  events_ = account.events;
  write_outputs(h, uses_cvode() ? cvode_->end() : integrator_.end());
  for (std::size_t i = 0; i < n_; ++i) {
    tau_m_before_[i] = tau_m_[i];
    tau_e_before_[i] = tau_e_[i];
    q_before_[i] = q_in_[i];
    dq_before_[i] = dq_in_[i];
  }
  return StepResult::kDone;
}

// Also after a snapshot of an earlier step was restored.
void DriveTrain::write_warning() {
  warned_steps_ = forced_steps_;
  warned_limits_ = limits_.count();
  warning_.clear();
  limits_.describe(wanted_, warning_);
  if (forced_steps_ == 0) return;
  char text[256];
  const int length = std::snprintf(text, sizeof text,
                                   "%s%d steps ended at max_substeps with an error of up to %.2g times the tolerance (outputs "
                                   "forced_steps, worst_error): expected more max_substeps, shorter steps or method=cvode",
                                   warning_.empty() ? "" : "; ", static_cast<int>(forced_steps_), worst_error_);
  warning_.append(text, static_cast<std::size_t>(std::max(length, 0)));
}

void DriveTrain::write_outputs(double h, const Point& end) {
  double *dq = x_.data() + n_, *theta = x_.data() + 2 * n_, *dtheta = x_.data() + 3 * n_;
  const Course& c = equations_.course();
  if (equations_.inside()) equations_.acceleration(h, end, ddq_.data());
  power_m_ = power_e_ = 0;
  for (std::size_t i = 0; i < n_; ++i) {
    const double tau_m = equations_.motor_torque(i, h);
    if (equations_.passive(i)) {
      theta[i] = x_[i];
      dtheta[i] = dq[i];
      tau_J_[i] = tau_f_[i] = 0;
    } else if (equations_.flexible()) {
      // without what load_damping adds, as a sensor has it
      tau_J_[i] = end.tau_J[i] - (equations_.parameters().D[i] - wanted_.D[i]) * (dtheta[i] - dq[i]);
      tau_f_[i] =
          equations_.stuck(i) ? equations_.motor_balance(end, i, tau_m) : end.tau_f[i];  // a stuck motor is held in balance
    } else {
      theta[i] = x_[i];
      dtheta[i] = dq[i];
      tau_f_[i] = end.tau_f[i];
      tau_J_[i] = tau_m - tau_f_[i] - equations_.parameters().B[i] * ddq_[i];  // (2b) with θ = q
    }
    power_m_ += tau_m * dtheta[i];
    power_e_ += equations_.inside() ? (c.tau_e[i] + c.dtau_e[i] * h - load_torque_[i]) * dq[i] : -tau_J_[i] * dq[i];
  }
  if (equations_.floating()) power_e_ += equations_.floating()->power();
  if (with_terms_) equations_.torque_terms(x_.data(), end, ddq_.data(), terms_);
  const Energies e = equations_.energies(x_.data(), end);
  kinetic_ = e.kinetic;
  potential_ = e.potential;
  elastic_ = e.elastic;
}

std::span<const Partial> DriveTrain::partials() const {
  if (equations_.floating() || with_terms_) return {};  // not derived for M* and b*, and for the terms
  return partials_.list();
}

void DriveTrain::evaluate_partials(std::span<double> values) {
  std::vector<double>& x = partials_.state();
  std::copy(x_.begin(), x_.end(), x.begin());
  if (!equations_.inside()) {
    std::copy(q_in_.begin(), q_in_.end(), x.begin());
    std::copy(dq_in_.begin(), dq_in_.end(), x.begin() + static_cast<std::ptrdiff_t>(n_));
  }
  partials_.evaluate(equations_, tau_m_, tau_e_, load_torque_, values);
}

void DriveTrain::restored() {
  equations_.parameters() = wanted_;
  adopt_drives();
  if (equations_.inside()) {
    equations_.restored_bodies();
    follow_load();
  }
  integrator_.forget();
  warned_steps_ = -1;  // the text is written again
  if (!uses_cvode()) return;
  cvode_->configure({.relative = rtol_, .angle = atol_, .speed = atol_speed_});
  cvode_->replay();
}

}  // namespace cotwin::drive_train
