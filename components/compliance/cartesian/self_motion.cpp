#include "components/compliance/cartesian/self_motion.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "components/compliance/cartesian/joint_motion.h"
#include "components/compliance/joints/views.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;
using P = SelfMotionParameters;
using Table = ParameterRow<P>;

constexpr double kMost = Table::kLargest, kAny = Table::kNoLimit;
constexpr Mutability kTunable = Mutability::kFollowed;

// In the order of declaration, each with the condition under which it exists.
constexpr Table kHeld[] = {
    {"omega_held", &P::omega_held, "rad/s", "frequency of the held frames of the setting tasks about their targets", 10, 0, 1e5,
     kTunable, 1, false},
    {"shift_held", &P::shift, "m", "targets of the held frames beside their positions at the start, in the base's axes", 0,
     -kAny, kAny, kTunable, 3, false},
    {"activation", &P::activation, "1", "part of each held frame's task that is in force, 0 to 1", 1, 0, 1, kTunable, 1,
     false}};
constexpr Table kPostureRows[] = {
    {"q_0", &P::q_0, "rad", "posture that the self-motion goes to", 0, -kAny, kAny, kTunable},
    {"K_0", &P::K_0, "N.m/rad", "stiffness of the self-motion towards q_0; 0: none", 10, 0, kMost, kTunable}};
constexpr Table kLimitRows[] = {
    {"w_limits", &P::w_limits, "J", "weight of the distance from joint limits in the self-motion; 0: none", 0.1, 0, kMost,
     kTunable, 0, false},
    {"limit_margin", &P::limit_margin, "1", "part of a joint's range at each end in which w_limits acts", 0.15, 1e-3, 0.5,
     kTunable, 0, false}};
constexpr Table kManipulabilityRows[] = {{"w_manipulability", &P::w_manipulability, "J",
                                          "weight of -ln manipulability in the self-motion; 0: none", 1, -kMost, kMost,
                                          kTunable, 0, false}};
constexpr Table kMassRows[] = {
    {"w_mass", &P::w_mass, "J/kg", "weight of the effective mass of E in the self-motion; 0: none, < 0: it is made larger", 20,
     -kMost, kMost, kTunable, 0, false},
    {"mass_axis", &P::mass_axis, "1", "direction of the effective mass in the axes of E; its length does not count", 0, -kAny,
     kAny, kTunable, 3, false}};
constexpr Table kYieldRows[] = {
    {"yield", &P::yield, "1",
     "part of the external joint torque that moves the self-motion; 0: stiff, 1: with the robot's own inertia", 1, 0, 1e6,
     kTunable, 0, false}};

control::ManipulabilityGoal::Rows rows(const std::vector<int>& rendered) {
  using Rows = control::ManipulabilityGoal::Rows;
  if (std::ranges::all_of(rendered, [](int i) { return i < 3; })) return Rows::kTranslation;
  return std::ranges::all_of(rendered, [](int i) { return i >= 3; }) ? Rows::kRotation : Rows::kBoth;
}

unsigned goals(const std::string& place, const std::string& names) {
  constexpr std::string_view kGoals[] = {"posture", "limits", "manipulability", "effective_mass"};
  unsigned found = 0;
  if (text::trim(names).empty()) return found;
  for (const std::string_view part : text::split(names, ',')) {
    const std::string_view name = text::trim(part);
    const auto at = std::ranges::find(kGoals, name);
    if (at == std::end(kGoals)) {
      throw Error(place, "setting null_space: '" + std::string(name) +
                             "', expected some of posture, limits, manipulability, effective_mass");
    }
    found |= 1U << (at - std::begin(kGoals));
  }
  return found;
}

}  // namespace

void SelfMotion::declare_settings(SettingList& s) {
  s.text("tasks", "",
         "space=cartesian: tasks in order of priority: pose, or position, orientation, x, y, z, rx, ry, rz of E, and frames "
         "that are held: FRAME, FRAME:x, …; empty: pose");
  s.text("null_space", "",
         "space=cartesian: goals of the self-motion beside damping: some of posture,limits,manipulability,effective_mass");
}

SelfMotion::SelfMotion(Settings& settings, const robot::RobotModel& robot, const std::vector<int>& rendered, bool joint_torques)
    : measures_(&robot),
      tasks_(task_list(settings.unit(), settings.text("tasks"), rendered, robot)),
      held_(static_cast<std::size_t>(std::ranges::count(tasks_, true, &TaskEntry::held))),
      goals_(goals(settings.unit(), settings.text("null_space"))),
      joint_torques_(joint_torques),
      q_min_(robot.n()),
      q_max_(robot.n()),
      manipulability_(robot.n(), rows(rendered), JointMotion::kLength),
      mass_(robot.n()) {
  const auto n = static_cast<std::size_t>(robot.n());
  write_start_values(wanted_, kHeld, held_);
  for (const auto table : {std::span<const Table>(kPostureRows), std::span<const Table>(kLimitRows),
                           std::span<const Table>(kManipulabilityRows), std::span<const Table>(kYieldRows)})
    write_start_values(wanted_, table, n);
  write_start_values(wanted_, kMassRows, 1);
  wanted_.mass_axis = {0, 0, 1};
  in_force_ = wanted_;
  p_start_.assign(3 * held_, 0);
  nu_.assign(n, 0);
  xi.assign(n, 0);
  task_sigma.assign(tasks_.size(), 0);
  task_residual.assign(tasks_.size(), 0);
  for (std::size_t i = 0; i < n; ++i) {
    q_min_[static_cast<Index>(i)] = robot.joints[i].q_min;
    q_max_[static_cast<Index>(i)] = robot.joints[i].q_max;
  }
}

template <class F>
void SelfMotion::for_each(F f) const {
  if (held_ > 0) f(std::span<const Table>(kHeld));
  if (has(kPosture)) f(std::span<const Table>(kPostureRows));
  if (has(kLimits)) f(std::span<const Table>(kLimitRows));
  if (has(kManipulability)) f(std::span<const Table>(kManipulabilityRows));
  if (has(kMass)) f(std::span<const Table>(kMassRows));
  if (joint_torques_) f(std::span<const Table>(kYieldRows));
}

void SelfMotion::declare(Variables& v) {
  JointVariables declared(v, measures_);
  for_each([&](std::span<const Table> table) {
    for (const Table& row : table) declared.parameter(wanted_, row);
    for (const Table& row : table) declared.in_force(in_force_, row);
  });
  if (held_ > 0) v.state("p_held_start", p_start_, "m", "positions of the held frames at the start, in the base's axes");
  declared.output("nu", nu_, "rad/s", "velocity of the self-motion, N dq_c, in the middle of the step");
  v.output("null_energy", energy_, "J", "energy of the self-motion, nu' M nu/2");
  v.output("null_potential", potential_, "J", "potential of the goals of the setting null_space");
  v.output("null_power", power_, "W", "power of external torques on the self-motion less that of its damping");
  v.output("task_sigma", task_sigma, "m",
           "least singular value of each task beside the higher ones; small: they contradict, or the pose is singular");
  v.output("task_residual", task_residual, "m/s2", "acceleration of each task that could not be given, rotations times 0.3 m");
  if (has(kManipulability)) v.output("manipulability", w_, "1", "manipulability of E, rotations times 0.3 m");
  if (has(kMass)) v.output("effective_mass", m_u_, "kg", "effective mass of E along mass_axis, motors free");
}

void SelfMotion::check(const std::string& place) const {
  for_each([&](std::span<const Table> table) { check_values(wanted_, table, place); });
  if (has(kMass) && !(map(wanted_.mass_axis).norm() > 1e-6))
    throw Error(place + ".mass_axis", "has no length, expected a direction in the axes of E");
  if (!map(xi).allFinite()) throw Error(place + ".xi", "is not finite, expected finite values");
}

void SelfMotion::start(LinkDynamics& links, const VectorXd& q) {
  in_force_ = wanted_;
  std::size_t k = 0;
  for (const TaskEntry& task : tasks_) {
    if (!task.held) continue;
    Eigen::Map<Vector3d>(p_start_.data() + 3 * k++) = links.forward_kinematics(q, task.frame).p;
  }
  std::ranges::fill(nu_, 0);
  std::ranges::fill(task_residual, 0);
  energy_ = potential_ = power_ = w_ = m_u_ = 0;
}

void SelfMotion::follow(double remaining) {
  for_each([&](std::span<const Table> table) { cotwin::follow(in_force_, wanted_, table, remaining); });
}

SelfMotion::Held SelfMotion::held(std::size_t k) const {
  const Vector3d at = Eigen::Map<const Vector3d>(p_start_.data() + 3 * k), shift(in_force_.shift.data() + 3 * k);
  return {at + shift, in_force_.omega_held[k], in_force_.activation[k]};
}

double SelfMotion::add_goals(LinkDynamics& links, const VectorXd& q, const robot::FrameOnBody& E, VectorXd& gradient) {
  const P& p = in_force_;
  double V = 0;
  if (has(kPosture)) V += control::posture(q, map(p.q_0), map(p.K_0), gradient);
  if (has(kLimits)) V += control::joint_limits(q, q_min_, q_max_, p.w_limits[0], p.limit_margin[0], gradient);
  if (has(kManipulability)) {
    V += manipulability_.add(links.mechanism(), links.data(), q, E, p.w_manipulability[0], gradient);
    w_ = manipulability_.w(links.mechanism(), links.data(), q, E);
  }
  if (has(kMass)) {
    const Vector3d axis = Vector3d(p.mass_axis.data());
    const double length = axis.norm();  // on its way to the opposite direction an axis may vanish
    const Vector3d e = length > 1e-9 ? Vector3d(axis / length) : Vector3d::UnitZ();
    V += mass_.add(links.mechanism(), links.data(), q, no_motors_, E, e, robot::Direction::kInFrame, p.w_mass[0], gradient);
    m_u_ = mass_.m_u;
  }
  return V;
}

bool SelfMotion::contradicts(double sigma_0) const {
  constexpr double kMuch = 0.01;  // m/s²
  std::size_t k_held = 0;
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    const bool active = !tasks_[k].held || in_force_.activation[k_held++] > 0;
    if (k > 0 && active && task_sigma[k] < sigma_0 && task_residual[k] > kMuch) return true;
  }
  return false;
}

void SelfMotion::write_outputs(const Computed& c) {
  std::ranges::copy(c.nu, nu_.begin());
  energy_ = c.energy;
  potential_ = c.potential;
  power_ = c.power;
}

}  // namespace cotwin::compliance
