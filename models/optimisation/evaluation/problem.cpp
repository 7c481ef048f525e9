#include "models/optimisation/evaluation/problem.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/drives/rigid_friction.h"
#include "models/trajectory/bernstein.h"

namespace cotwin::optimisation {

namespace {

constexpr const char* kQuantities[] = {"time", "torque", "work",           "shared_work", "power",      "acceleration",
                                       "jerk", "energy", "effective_mass", "safety",      "cycle_time", "stiffness"};

[[noreturn]] void fail(const std::string& what) { throw Error("optimisation", what); }

void expect_size(const char* name, const std::vector<double>& values, std::size_t n) {
  if (values.size() != n)
    fail(std::string(name) + " has " + std::to_string(values.size()) + " values, expected " + std::to_string(n) +
         ", one per joint");
}

void expect_finite(const char* name, const std::vector<double>& values, std::size_t n) {
  expect_size(name, values, n);
  for (std::size_t j = 0; j < n; ++j)
    if (!std::isfinite(values[j]))
      fail(std::string(name) + " of joint " + std::to_string(j + 1) + " is " + text::to_text(values[j]) +
           ", expected a finite number");
}

void expect_bounds(const char* name, const std::vector<double>& values, std::size_t n) {
  expect_size(name, values, n);
  for (std::size_t j = 0; j < n; ++j)
    if (!(values[j] > 0))
      fail(std::string("bound ") + name + " of joint " + std::to_string(j + 1) + " is " + text::to_text(values[j]) +
           ", expected more than 0");
}

void check_electrical(const Electrical& e, std::size_t n) {
  for (const auto* values : {&e.losses.R, &e.losses.k_t, &e.losses.V_0, &e.losses.k_h, &e.losses.k_e})
    expect_size("a value of the drives' losses", *values, n);
  energetics::Accountant accountant(n, e.bus);
  accountant.losses = e.losses;
  accountant.current = e.current;
  accountant.link = e.link;
  accountant.supply = e.supply;
  accountant.check("electrical");
  for (const double power : {e.standby.P_0, e.standby.P_brake, e.standby.controller})
    if (!(power >= 0 && std::isfinite(power)))
      fail("a stand-by power of " + text::to_text(power) + " W, expected a finite number of 0 or more");
  if (!(e.V == 0 || (e.V >= e.link.V_min && e.V <= e.link.V_max)))
    fail("the voltage of the DC link is " + text::to_text(e.V) + " V, expected 0 or " + text::to_text(e.link.V_min) + " to " +
         text::to_text(e.link.V_max));
}

void expect_direction(const std::string& what, const Eigen::Vector3d& u) {
  if (!(std::abs(u.norm() - 1) < 1e-9))
    fail("the direction of " + what + " has the length " + text::to_text(u.norm()) + ", expected 1");
}

void check_contact(const ContactFrame& contact, std::size_t n, bool parts) {
  if (contact.u) expect_direction("the contact", *contact.u);
  if (!contact.B.empty()) expect_size("the inertia of the motors", contact.B, n);
  if (!(contact.area >= 0 && std::isfinite(contact.area)))
    fail("the area of the contact is " + text::to_text(contact.area) + " m2, expected 0 or more");
  if (parts && contact.parts.empty()) fail("the cost 'safety' has no body part, expected at least one");
  for (const robot::BodyPart& part : contact.parts)
    if (!((contact.transient ? part.transient : part.quasi_static).on(contact.area) > 0))
      fail("this contact with the body part " + part.name + " is not permitted, expected another one for the cost 'safety'");
}

void check_compliant(const CompliantFrame& frame) {
  if (frame.axes.empty()) fail("the compliant frame has no axis, expected at least one");
  for (const CompliantFrame::Axis& axis : frame.axes) {
    expect_direction("a compliant axis", axis.u);
    check_ranges(axis.least, axis.most);
  }
  for (const auto& [name, value] : {std::pair{"load", frame.load}, {"settled deflection", frame.settled}})
    if (!(value > 0 && std::isfinite(value)))
      fail(std::string("the ") + name + " of the compliant frame is " + text::to_text(value) + ", expected more than 0");
  for (const auto& [name, value] : {std::pair{"deflection", frame.deflection_max}, {"natural frequency", frame.omega_max}})
    if (!(value > 0))
      fail(std::string("the largest ") + name + " of the compliant frame is " + text::to_text(value) +
           ", expected more than 0");
  for (const auto& [name, value] : {std::pair{"least damping ratio", frame.zeta_min}, {"time of the process", frame.T_process}})
    if (!(value >= 0 && std::isfinite(value)))
      fail(std::string("the ") + name + " of the compliant frame is " + text::to_text(value) + ", expected 0 or more");
}

}  // namespace

const char* to_text(Quantity quantity) { return kQuantities[static_cast<std::size_t>(quantity)]; }

double drive_torque(const DriveTerms& d, std::size_t j, double dq, double ddq) {
  const auto term = [j](const std::vector<double>& values) { return values.empty() ? 0.0 : values[j]; };
  return term(d.B) * ddq + robot::rigid_friction(term(d.tau_C), term(d.sigma2), term(d.tau_0), robot::coulomb_share(dq), dq);
}

bool needs_torques(Quantity quantity) {
  return quantity == Quantity::kTorque || quantity == Quantity::kWork || quantity == Quantity::kSharedWork ||
         quantity == Quantity::kPower || quantity == Quantity::kEnergy;
}

bool needs_compliance(Quantity quantity) { return quantity == Quantity::kCycle || quantity == Quantity::kStiffness; }

Bounds bounds_of(const robot::RobotModel& robot, const Bounds& own) {
  Bounds b;
  for (const robot::Joint& joint : robot.joints) {
    b.q_min.push_back(joint.q_min);
    b.q_max.push_back(joint.q_max);
    b.dq.push_back(joint.dq_max);
    b.ddq.push_back(joint.ddq_max);
    b.dddq.push_back(joint.dddq_max);
    b.tau.push_back(joint.tau_max);
  }
  for (auto each : {&Bounds::q_min, &Bounds::q_max, &Bounds::dq, &Bounds::ddq, &Bounds::dddq, &Bounds::tau})
    if (!(own.*each).empty()) b.*each = own.*each;
  return b;
}

void check(const Problem& p) {
  const std::size_t n = p.robot.joints.size();
  if (n == 0) fail("the robot has no movable joint, expected at least one");
  for (const robot::Joint& joint : p.robot.joints)
    if (joint.passive) fail("joint " + joint.name + " is passive, expected a motor at every joint: the motion is prescribed");
  expect_finite("q_from", p.ends.q_from, n);
  expect_finite("dq_from", p.ends.dq_from, n);
  expect_finite("ddq_from", p.ends.ddq_from, n);
  expect_finite("q_to", p.ends.q_to, n);
  expect_finite("dq_to", p.ends.dq_to, n);
  expect_finite("ddq_to", p.ends.ddq_to, n);
  for (const auto& posture : p.end_postures) expect_finite("an end posture", posture, n);
  expect_size("bound q_min", p.bounds.q_min, n);
  expect_size("bound q_max", p.bounds.q_max, n);
  expect_bounds("dq", p.bounds.dq, n);
  expect_bounds("ddq", p.bounds.ddq, n);
  expect_bounds("dddq", p.bounds.dddq, n);
  expect_bounds("tau", p.bounds.tau, n);
  for (std::size_t j = 0; j < n; ++j)
    if (!(p.bounds.q_min[j] <= p.bounds.q_max[j]))
      fail("bounds of joint " + p.robot.joints[j].name + " are " + text::to_text(p.bounds.q_min[j]) + " and " +
           text::to_text(p.bounds.q_max[j]) + ", expected them in ascending order");
  for (const auto* terms : {&p.drives.B, &p.drives.sigma2, &p.drives.tau_C, &p.drives.tau_0})
    if (!terms->empty()) expect_finite("a term of the drives", *terms, n);
  const auto expect_interval = [](const robot::Interval& when) {
    if (!(when.from >= 0 && when.from < when.to && when.to <= 1))
      fail("a load acts from the share " + text::to_text(when.from) + " to " + text::to_text(when.to) +
           " of the motion, expected 0 <= from < to <= 1");
  };
  for (const robot::Payload& payload : p.loads.payloads) {
    expect_interval(payload.when);
    if (p.contact && !payload.when.whole())
      fail("payload '" + payload.part.name +
           "' comes or goes on the way, expected it all the way with the costs effective_mass and safety");
  }
  if (p.loads.wrench) expect_interval(p.loads.wrench->when);
  if (p.loads.wrench && !p.loads.wrench->f.allFinite()) fail("the external wrench is not finite, expected finite numbers");
  if (!(p.T_min > 0 && p.T_min <= p.T_max && std::isfinite(p.T_max)))
    fail("T from " + text::to_text(p.T_min) + " to " + text::to_text(p.T_max) + " s, expected 0 < T_min <= T_max");
  constexpr int kMost = trajectory::bernstein::kMaxDegree;
  if (p.degree < 5 || p.degree > kMost) fail("degree " + std::to_string(p.degree) + ", expected 5 to " + std::to_string(kMost));
  if (p.samples < 8 || p.samples > 100000) fail(std::to_string(p.samples) + " samples, expected 8 to 100000");
  if (!(p.torque_margin >= 0 && p.torque_margin < 1))
    fail("torque margin " + text::to_text(p.torque_margin) + ", expected 0 to less than 1");
  if (p.costs.empty()) fail("no cost is given, expected at least one");
  for (const CostTerm& term : p.costs) {
    if (!(term.weight >= 0 && std::isfinite(term.weight)))
      fail("weight " + text::to_text(term.weight) + " of " + to_text(term.quantity) + ", expected a number of 0 or more");
    if (term.quantity == Quantity::kPower && !term.power) fail("the cost 'power' has no function of power");
    if (term.quantity == Quantity::kEnergy && !p.electrical)
      fail("the cost 'energy' has no electrical data of the drives, expected an energy.ssv beside the robot");
    if ((term.quantity == Quantity::kMass || term.quantity == Quantity::kSafety) && !p.contact)
      fail(std::string("the cost '") + to_text(term.quantity) + "' has no frame, expected Problem::contact");
    if (needs_compliance(term.quantity) && !p.compliant)
      fail(std::string("the cost '") + to_text(term.quantity) + "' has no compliant frame, expected Problem::compliant");
  }
  if (p.electrical) check_electrical(*p.electrical, n);
  if (p.contact)
    check_contact(*p.contact, n,
                  std::ranges::any_of(p.costs, [](const CostTerm& t) { return t.quantity == Quantity::kSafety; }));
  if (p.compliant) check_compliant(*p.compliant);
  if (!(p.smooth_maxima == 0 || p.smooth_maxima >= 1))
    fail("smooth maxima of the norm " + text::to_text(p.smooth_maxima) + ", expected 0, or 1 or more");
}

}  // namespace cotwin::optimisation
