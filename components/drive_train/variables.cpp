// The variables of the unit but its parameters (parameters.cpp).
#include "components/drive_train/drive_train.h"
#include "components/drive_train/floating_links.h"

namespace cotwin::drive_train {

void DriveTrain::declare(Variables& v) {
  const bool inside = equations_.inside(), flexible = equations_.flexible();
  JointVariables joints(v, measures_);
  const auto part = [&](std::size_t k) { return std::span(x_.data() + k * n_, n_); };
  joints.input("tau_m", tau_m_, "N.m", "motor torque in (2b)").rate(dtau_m_).essential();
  if (inside) {
    joints.input("tau_e", tau_e_, "N.m", "external joint torque in (2a)").rate(dtau_e_);
    joints.output("q", part(0), "rad", "link-side joint position in (2a)").initially_from({});
    joints.output("dq", part(1), "rad/s", "link-side joint speed").derivative_of("q").initially_from({});
    joints.output("ddq", ddq_, "rad/s2", "link-side joint acceleration, of (2a)").derivative_of("dq");
  } else {
    joints.input("q", q_in_, "rad", "link-side joint position in (2c)").essential();
    joints.input("dq", dq_in_, "rad/s", "link-side joint speed, the derivative of q");
    joints.input("tau_e", tau_e_, "N.m", "external joint torque: not used, because the links are in another unit");
  }
  auto theta = joints.output("theta", part(2), "rad", "motor position behind the gear in (2b)");
  auto dtheta = joints.output("dtheta", part(3), "rad/s", "motor speed behind the gear").derivative_of("theta");
  auto tau_J = joints.output("tau_J", tau_J_, "N.m", "joint torque in (2a), (2b), (2c)");
  dtheta.initially_from(inside ? std::vector<std::string>{} : std::vector<std::string>{"dq"});
  if (inside && flexible) {  // the gear carries the links, whatever the motor does
    std::vector<std::string> load = {"tau_e"};
    if (equations_.floating() != nullptr) load.insert(load.end(), {"base_f", "base_m"});
    theta.initially_from(load);
    tau_J.initially_from(load);
  }
  joints.output("tau_f", tau_f_, "N.m", "friction torque of the motor in (2b)");
  v.output("energy_kinetic", kinetic_, "J", flexible ? "of motors and, inside, links" : "of links and motors");
  v.output("energy_potential", potential_, "J", "of the links in gravity, inside");
  v.output("energy_elastic", elastic_, "J", "in gears, bristles, springs and stops");
  v.output("energy_dissipated", dissipated_, "J", "lost in friction, damping and stops since the start; without work_0");
  v.output("work_m", work_m_, "J", "done by tau_m since the start");
  v.output("work_e", work_e_, "J",
           inside ? "done by tau_e since the start" : "done by the links on the drive, -tau_J dq, since the start");
  v.output("power_m", power_m_, "W", "tau_m times dtheta").derivative_of("work_m");
  v.output("power_e", power_e_, "W", inside ? "tau_e times dq" : "minus tau_J times dq").derivative_of("work_e");
  v.output("substeps", substeps_, "sub-steps that the solver took in this step");
  v.output("forced_substeps", forced_, "of them, those taken against the tolerance because max_substeps allowed no more");
  v.output("events", events_, "joints that stuck, broke away, or came into or out of a stop in this step");
  v.output("error_estimate", error_, "1",
           "largest local error over tolerance in this step; 0 with cvode, which keeps to its tolerances or gives up");
  v.output("warning", warning_, "what the user should know after the run; empty if nothing");

  declare_parameters(v);

  joints.state("z", part(4), "rad", "bristle deflection of the motor's friction");
  joints.state("tau_m_before", tau_m_before_, "N.m", "tau_m at the end of the last step");
  joints.state("tau_e_before", tau_e_before_, "N.m", "tau_e at the end of the last step");
  joints.state("q_before", q_before_, "rad", "link outside: q at the end of the last step");
  joints.state("dq_before", dq_before_, "rad/s", "link outside: dq at the end of the last step");
  Modes& m = equations_.modes();
  v.state("slip", m.slip, "friction=coulomb: 0 while the motor sticks, else the direction in which it slips");
  v.state("stop", m.stop, "-1 or 1 while the link is in its lower or upper stop");
  joints.state("impact", m.impact, "rad/s", "speed at which the link came into its stop");
  v.state("substep", proposal_, "s", "length that the next sub-step should have");
  if (uses_cvode()) {
    CvodeSolver::Log& log = cvode_->log();
    v.state("log_count", log.count, "steps in the solver's history");
    v.state("log_x", log.x, "1", "q, dq, theta, dtheta, z where the solver's history begins");
    v.state("log_slip", log.modes.slip, "slip there");
    v.state("log_stop", log.modes.stop, "stop there");
    joints.state("log_impact", log.modes.impact, "rad/s", "impact there");
    v.state("log_steps", log.steps, "1", "lengths and inputs of the steps in the solver's history");
  }
  v.output("work_0", work_0_, "J",
           "taken up since the start by the constant parts of friction (tau_0, link_tau_0, the link's sigmoid at rest), which "
           "give it back on the way back");
  v.output("forced_steps", forced_steps_, "steps since the start in which max_substeps forced sub-steps against the tolerance");
  v.output("worst_error", worst_error_, "1", "largest error_estimate since the start");
  if (equations_.floating()) equations_.floating()->declare(v);
  const auto declare_tools = [&] {
    v.tunable("tool_changes", tool_changes_, "1",
              "number of tools attached or detached so far: when it changes, the bodies in force take the tunables at once");
    v.state("tool_changes_seen", tool_changes_seen_, "1", "tool_changes at the last step");
    v.output("energy_bodies", energy_bodies_, "J",
             "kinetic and potential energy that changes of the bodies have brought since the start, at constant speeds");
  };
  if (equations_.inside() && !uses_cvode()) declare_tools();
  if (with_terms_) {
    joints.output("tau_inertia", terms_.inertia, "N.m", "M ddq of (2a)");
    joints.output("tau_coriolis", terms_.coriolis, "N.m", "C dq of (2a): Coriolis and centrifugal torques");
    joints.output("tau_gravity", terms_.gravity, "N.m", "g of (2a)");
    joints.output("tau_link", terms_.link, "N.m",
                  "friction, springs and stops of the link; the four terms together are tau_J + tau_e");
  }
  if (equations_.inside() && uses_cvode()) declare_tools();
  if (equations_.inside()) {
    v.state("passed_at", limits_.passed_at, "s", "time at which each joint first passed its upper limit; -1e10: never");
    v.state("passed_below", limits_.passed_below, "s", "the same of its lower limit");
    v.output("takes_loads", takes_loads_, "1", "1, for the contact world");
    v.input("load_factor", load_factor_, "1",
            "F, n x n by rows, of the inertia F^T F that held bodies add to M in (2a); the master connects it, load_torque and "
            "load_damping where a contact world gives tau_e");
    joints.input("load_torque", load_torque_, "N.m", "F^T F times the joint acceleration that the contact world expects");
    joints.input("load_damping", load_damping_, "N.m.s/rad", "least damping of the gear with these bodies");
  }
  v.parameter("sources", sources_, "where the values of the drives come from");
  v.parameter("assumed", assumed_, "names of parameters of the drives that are assumptions, not measurements; all; or none");
}

}  // namespace cotwin::drive_train
