// Settings and variables of the contact world.
#include <algorithm>

#include "components/contact_world/parts.h"
#include "components/unit/joint_variables.h"

namespace cotwin::contact_world {

void ContactWorld::declare_settings(SettingList& s) {
  s.set_first_variables({"q", "dq", "tau_J", "tau_e", "f_c", "contacts", "penetration", "force", "gravity", "energy"});
  s.cell();
  s.choice("link_side", {"inside", "outside"},
           "which unit integrates the links of the robots: the drive train (q is an input) or this unit (q is an output)");
  s.choice("actuation", {"torque", "prescribed"},
           "with link_side=inside: tau_J drives the links, or q and dq prescribe their motion");
  s.choice("base", {"fixed", "floating"}, "the bases of the robots are fixed or move freely");
  s.choice("method", {"tree", "pgs", "dantzig"},
           "solver of (1): joint trees exactly and contacts by sweeps, projected Gauss-Seidel, or Dantzig's pivoting");
  s.integer("contacts", 256, 1, 1000000, "number of contact points that a step takes without allocating memory");
  s.integer("points", 8, 0, 1000, "number of contact points that are outputs");
  s.text("maximal", "", "with link_side=inside: names of robots, separated by commas, that this unit integrates all the same");
  s.text("latches", "",
         "connections that close and open, each name|frame|frame, separated by semicolons; a frame is ROBOT/FRAME (FRAME of a "
         "single "
         "robot), BODY or BODY/FRAME of the scene");
  s.integer("dents", 64, 1, 100000,
            "number of places where a surface that yields remembers its dents, then the oldest is forgotten");
}

void ContactWorld::declare_robot(Variables& v, Robot& r) {
  const std::string& x = r.prefix;
  const JointMeasures measures(&r.placed->model);
  JointVariables joints(v, measures);
  const bool outside = r.link == LinkSide::kOutside;
  const std::string of = r.placed->name.empty() ? "of the robot" : "of robot " + r.placed->name;
  if (outside) {
    joints
        .output(x + "q", r.q, "rad",
                "link-side joint position " + of + " at the end of the step, input of the drive train's (2c)")
        .initially_from({});
    joints.output(x + "dq", r.dq, "rad/s", "link-side joint speed").initially_from({});
  } else {
    joints.input(x + "q", r.q, "rad", "link-side joint position " + of + ", output of the drive train's (2a)").essential();
    joints.input(x + "dq", r.dq, "rad/s", "link-side joint speed, the derivative of q");
  }
  const bool torque = actuation_ == Actuation::kTorque;
  if (torque) {
    joints.input(x + "tau_J", r.tau_J, "N.m", "joint torque of (2a) that drives the links").essential();
    auto dtheta = joints.input(x + "dtheta", r.dtheta, "rad/s",
                               "motor speed behind the gear; tau_J changes with it by (2c) within the step");
    if (std::any_of(r.K.begin(), r.K.end(), [](double K) { return K > 0; })) dtheta.essential();
  }
  joints
      .output(x + "tau_e", r.tau_e, "N.m",
              "external joint torque in (2a), mean over the step: J^T F of the contacts and latches, and tau_other")
      .discrete()
      .initially_from(torque ? std::vector{x + "tau_other"} : std::vector<std::string>{});
  joints.output(x + "q_link", r.q_link, "rad",
                "joint position of the links in the world at the end of the step, for either value of link");
  joints.output(x + "dq_link", r.dq_link, "rad/s", "joint speed of the links in the world");
  joints.output(x + "ddq_link", r.ddq, "rad/s2", "mean joint acceleration of the links over the step");
  v.output(x + "f_c", r.f_c, "N", "sum of the contact forces on the links, in W, mean over the step").discrete();
  v.parameter(x + "base_p0", r.base_p0, "m", "position of the base in W at the start");
  v.parameter(x + "base_quat0", r.base_quat0, "1", "orientation of the base in W at the start, unit quaternion (w, x, y, z)");
  auto q0 = joints.parameter(x + "q0", r.q0, "rad", "joint position at the start; link_side=outside");
  if (outside) q0.essential();
  joints.parameter(x + "dq0", r.dq0, "rad/s", "joint speed at the start; link_side=outside");
  if (torque) {
    joints
        .parameter(x + "K", r.K, "N.m/rad",
                   "joint stiffness of (2c) for the change of tau_J within a step; 0: tau_J is constant")
        .range(0, 1e9);
    joints.parameter(x + "D", r.D, "N.m.s/rad", "joint damping of the gear for the change of tau_J within a step")
        .range(0, 1e9);
  }
  if (torque && !outside) {
    joints
        .parameter(x + "B", r.B, "kg.m2",
                   "motor inertia behind the gear if the drive train's transmission is rigid; 0: elastic transmission")
        .range(0, 1e9);
  }
  joints.state(x + "dq_before", r.dq_before, "rad/s", "link_side=inside: dq at the start of the last step");
  if (may_hold(r)) {
    v.input(x + "takes_loads", r.takes_loads, "1",
            "1: the drive train takes load_factor, load_torque and load_damping, which are 0 otherwise");
    joints.state(x + "q_before", r.q_before, "rad", "q at the start of the last step");
    joints.state(x + "tau_l", r.tau_l, "N.m", "tau_e of latches and grips, mean over the last step");
    v.output(x + "load_factor", r.load_factor, "1",
             "F, n x n by rows, of the inertia F^T F that bodies in latches and grips add to M of (2a) within a step; for the "
             "drive train")
        .discrete()
        .initially_from({});
    joints.output(x + "load_torque", r.load_torque, "N.m", "F^T F times ddq_link").discrete().initially_from({});
    joints
        .output(x + "load_damping", r.load_damping, "N.m.s/rad",
                "least damping of the gears with these bodies: their oscillation may be too fast for the step")
        .discrete()
        .initially_from({});
  }
  v.output(x + "base_f_c", r.base_f_c, "N", "sum of the contact forces on the base, in W, mean over the step").discrete();
  v.output(x + "base_m_c", r.base_m_c, "N.m", "their moment about the base's origin, in W").discrete();
  if (!floating_) return;
  if (!outside) {
    v.input(x + "base_p", r.base_p, "m", "position of the floating base in W").essential();
    v.input(x + "base_quat", r.base_quat, "1", "its orientation in W, unit quaternion (w, x, y, z)").essential();
    v.input(x + "base_v", r.base_v, "m/s", "velocity of its origin in W");
    v.input(x + "base_w", r.base_w, "rad/s", "its angular velocity in W");
    v.output(x + "base_f", r.base_f, "N",
             "sum of the forces of contacts and latches on base and links, in W, mean over the step")
        .discrete()
        .initially_from({});
    v.output(x + "base_m", r.base_m, "N.m", "their moment about the base's origin, in W").discrete().initially_from({});
    return;
  }
  v.output(x + "base_p", r.base_p, "m", "position of the floating base in W");
  v.output(x + "base_quat", r.base_quat, "1", "its orientation in W, unit quaternion (w, x, y, z)");
  v.output(x + "base_v", r.base_v, "m/s", "velocity of its origin in W");
  v.output(x + "base_w", r.base_w, "rad/s", "its angular velocity in W");
}

void ContactWorld::declare_body(Variables& v, Body& b) {
  const std::string& x = b.prefix;
  v.parameter(x + "p0", b.p0, "m", "position of body " + b.name + " in W at the start");
  v.parameter(x + "quat0", b.quat0, "1", "orientation of body " + b.name + " in W at the start, unit quaternion (w, x, y, z)");
  v.output(x + "f_c", b.f_c, "N", "sum of the contact forces on the body, in W, mean over the step").discrete();
  v.output(x + "m_c", b.m_c, "N.m", "their moment about the body's origin, in W").discrete();
  if (b.motion == scene::Motion::kStatic) return;
  if (b.motion == scene::Motion::kDynamic) {
    v.parameter(x + "v0", b.v0, "m/s", "velocity of the body's origin in W at the start");
    v.parameter(x + "w0", b.w0, "rad/s", "angular velocity of the body in W at the start");
    v.input(x + "f", b.f, "N", "external force on the body at its origin, in W");
    v.input(x + "m", b.m, "N.m", "external moment on the body, in W");
  } else {
    v.input(x + "v_d", b.v_d, "m/s", "prescribed velocity of the body's origin, in W");
    v.input(x + "w_d", b.w_d, "rad/s", "prescribed angular velocity of the body, in W");
  }
  v.output(x + "p", b.p, "m", "position of the body in W");
  v.output(x + "quat", b.quat, "1", "orientation of the body in W, unit quaternion (w, x, y, z) with w >= 0");
  v.output(x + "v", b.v, "m/s", "velocity of the body's origin, in W");
  v.output(x + "w", b.w, "rad/s", "angular velocity of the body, in W");
}

void ContactWorld::declare(Variables& v) {
  for (const auto& robot : robots_) declare_robot(v, *robot);
  for (const auto& body : bodies_) declare_body(v, *body);
  v.output("contacts", contacts_, "contact points in the step");
  v.output("penetration", penetration_, "m", "deepest interpenetration of two shapes");
  v.output("force", largest_force_, "N", "largest force at one contact point, mean over the step");
  v.output("joint_gap", joint_gap_, "m", "largest distance between the two anchors of a joint");
  v.output("energy", energy_, "J", "kinetic and potential energy of all moving bodies");
  v.output("iterations", used_iterations_, "sweeps or pivots of the solver in the step");
  v.output("residual", residual_, "m/s", "largest remaining violation of the complementarity conditions");
  v.output("degenerate", degenerate_, "redundant or contradicting constraints that were relaxed");
  v.output("grown", grown_, "number of steps with more contacts than the setting `contacts`, each of which allocated memory");
  v.parameter("gravity", gravity_, "m/s2", "gravity in W");
  v.parameter("friction_scale", friction_scale_, "1", "factor of all coefficients of friction between surfaces").range(0, 1000);
  v.parameter("max_iterations", iterations_, "largest number of sweeps of the solver in a step").range(1, 100000);
  v.parameter("tolerance", tolerance_, "m/s", "residual below which the sweeps end; 0: always max_iterations").range(0, 1);
  v.parameter("joint_gap_limit", joint_gap_limit_, "m",
              "gap of a joint that ends the run with an error, as does a tilt of 0.1 rad; 0: no check")
      .range(0, 1000);
  v.parameter(
       "energy_limit", energy_limit_, "1",
       "energy gained without work that ends the run with an error, as a share of the most energy that was there; 0: no check")
      .range(0, 1000);
  if (shown_ > 0) {
    v.output("contact_p", contact_p_, "m", "position in W of the first `points` contact points, x, y, z of each");
    v.output("contact_f", contact_f_, "N", "force in W on the second body at each of these points");
    v.output("contact_gap", contact_gap_, "m", "gap at each of these points; negative: interpenetration");
    v.output("contact_bodies", contact_bodies_,
             "the two bodies of each of these points: bodies of the scene from 1, then base and links of each robot; 0: none");
  }
  v.state("world", state_, "1", "poses, twists and the solver's warm start");
  v.state("unsolved_time", unsolved_time_, "s", "time in which islands were left unsolved");
  v.state("largest_unsolved", largest_unsolved_, "m/s", "largest residual in that time");
  v.state("h_before", h_before_, "s", "duration of the last step; 0: no step yet");
  v.output("impacts", impacts_, "rounds of impacts with restitution, one after the other");
  v.output("contact_swing", contact_swing_, "1",
           "largest h ω of a loaded soft contact, with its spring and the mobility behind it; above 1 `force` misses peaks");
  v.output("extended", extended_,
           "islands that took more than max_iterations sweeps in the step, up to 50 times as many, or were pivoted");
  v.output("unsolved", unsolved_,
           "islands left with a residual above 2 h g, the speed that gravity gives in two steps, at rest above a twentieth of "
           "it or 1 mm/s");
  for (const auto& body : bodies_) {
    if (body->foundation.any()) body->foundation.declare(v, body->prefix);
  }
  for (const auto& robot : robots_) {
    if (robot->placed->model.bodies.empty()) continue;
    declare_bodies(v, robot->inertias, true, robot->prefix);
    v.tunable(robot->prefix + "tool_changes", robot->tool_changes, "1",
              "number of tools attached or detached so far; changed bodies are in force at once");
    Robot& r = *robot;
    for (std::size_t k = 0; k < r.tools.size(); ++k) {
      v.tunable(r.prefix + "tool." + text::identifier(r.tools[k]), r.tools_wanted[k], "1",
                "1 while the collision shapes of tool " + r.tools[k] + " are there, else 0")
          .range(0, 1);
    }
    if (!r.tools.empty()) v.state(r.prefix + "tools_in_force", r.tools_in_force, "1", "the same of all tools, in force");
  }
  for (const auto& body : bodies_) {
    if (body->foundation.any()) body->foundation.declare_state(v, body->prefix);
  }
  v.state("largest_swing", largest_swing_, "1", "largest contact_swing since the start");
  for (LatchPort& latch : latches_) latch.declare(v);
  if (loads_->free.rows() > 0)
    v.state("load_gain", load_gain_, "1", "whether the energy that held bodies got in the last step is known; J");
  if (!grips_.empty())
    v.state("grips", grips_, "1", "contacts of links with bodies that can move: bodies, place, normal, softness, friction");
  if (actuation_ == Actuation::kPrescribed) return;
  for (const auto& robot : robots_) {
    const JointMeasures measures(&robot->placed->model);
    JointVariables(v, measures)
        .input(robot->prefix + "tau_other", robot->tau_other, "N.m",
               "external joint torque that does not come from contacts, such as that of unit:operator_hand; part of tau_e")
        .rate(robot->tau_other_rate);
  }
}

}  // namespace cotwin::contact_world
