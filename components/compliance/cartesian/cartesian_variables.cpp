// The variables of Cartesian compliance: names, meaning, what values they may have.
#include "components/compliance/cartesian/cartesian_motion.h"
#include "components/unit/joint_variables.h"

namespace cotwin::compliance {

void CartesianMotion::declare(Variables& v) {
  constexpr double kAny = 1e12;
  const JointMeasures measures(nullptr);
  JointVariables declared(v, measures);
  if (!desired_joints_) {
    v.input("p_d", p_d_, "m", "desired position of E in W at the end of the step").essential();
    v.input("quat_d", quat_d_, "1", "desired orientation of E in W, quaternion (w, x, y, z); Q and -Q are the same");
    v.input("v_d", v_d_, "m/s", "desired velocity of E in W");
    v.input("w_d", w_d_, "rad/s", "desired angular velocity of E in W");
    v.input("dv_d", dv_d_, "m/s2", "desired acceleration of E in W");
    v.input("dw_d", dw_d_, "rad/s2", "desired angular acceleration of E in W");
  }
  if (sensor_) {
    v.input("f_s", f_e_, "N", "force that the sensor measures, on the robot, in the sensor's axes").rate(f_rate_);
    v.input("m_s", m_e_, "N.m", "moment that the sensor measures about its origin, in its axes").rate(m_rate_);
    v.parameter("tool_mass", tool_mass_, "kg", "mass behind the sensor, whose weight and inertia are not part of the wrench")
        .range(0, kAny);
    v.parameter("tool_centre", tool_centre_, "m", "its centre of mass in the sensor's frame");
  } else if (!wrench_of_joints_) {
    v.input("f_e", f_e_, "N", "external force on the robot at E, in W").rate(f_rate_);
    v.input("m_e", m_e_, "N.m", "external moment on the robot about E, in W").rate(m_rate_);
  }
  v.parameter("p_FE", p_FE_, "m", "origin of the compliance frame E in the frame of the setting frame");
  v.parameter("quat_FE", quat_FE_, "1", "orientation of E in that frame, quaternion (w, x, y, z)");
  v.parameter("p_WB", p_WB_, "m", "origin of the robot's base B in W");
  v.parameter("quat_WB", quat_WB_, "1", "orientation of B in W, quaternion (w, x, y, z)");
  for (const auto& row : kCartesian) declared.parameter(wanted_, row);
  for (const auto& row : kCartesian) declared.in_force(in_force_, row);
  v.parameter("tank_start", tank_start_, "J", "energy at the start that a rise of mass or stiffness may give out")
      .range(0, kAny);
  v.parameter("tank_max", tank_max_, "J", "most energy that is kept for that").range(0, kAny);
  v.state("tank", tank_, "J", "energy kept for a rise of mass or stiffness");
  v.state("Delta_axes", Delta_, "m", "deviation of translation in the axes of the setting axes");
  v.state("dDelta_axes", dDelta_, "m/s", "its rate in these axes");
  v.state("quat_dc", quat_dc_, "1", "compliant orientation relative to the desired one");
  v.state("w_dc", w_dc_, "rad/s", "compliant less desired angular velocity, in the desired frame");
  v.state("p_before", p_before_, "m", "compliant position in B at the beginning of the next step");
  v.state("quat_before", quat_before_, "1", "compliant orientation in B at the beginning of the next step");
  v.state("V_before", V_before_, "1", "compliant twist in B at the beginning of the next step, m/s and rad/s");
  v.state("quat_d_before", quat_d_before_, "1", "desired orientation in B at the beginning of the next step");
  v.state("q_joints", joints_.q, "1", "joint positions of the compliant motion, rad or m");
  v.state("dq_joints", joints_.dq, "1", "joint velocities of the compliant motion, rad/s or m/s");
  v.state("ddq_joints", joints_.ddq, "1", "joint accelerations of the compliant motion, rad/s2 or m/s2");
  v.state("cartesian_met", met_,
          "what happened since the start, summed: 1 damped near a singular pose, 2 task_error above 1 mm, 4 a rise of mass or "
          "stiffness waited for energy, 8 moment above the least K_o, 16 started beside the desired pose, "
          "32 a lower task could not be done");
  v.output("p_c", p_c_, "m", "compliant position of E in W");
  v.output("quat_c", quat_c_, "1", "compliant orientation of E in W, unit quaternion (w, x, y, z) without jumps of its sign");
  v.output("v_c", v_c_, "m/s", "compliant velocity of E in W").derivative_of("p_c");
  v.output("w_c", w_c_, "rad/s", "compliant angular velocity of E in W");
  v.output("Delta_p", Delta_p_, "m", "deviation p_c - p_d in W");
  v.output("epsilon", epsilon_, "1", "vector part of the quaternion of C in the desired frame, with eta >= 0");
  v.output("sigma_min", sigma_min_, "m", "least singular value of the task's Jacobian, rotations times 0.3 m");
  v.output("lambda", lambda_, "1", "damping of the joints near a singular pose; 0: none");
  v.output("p_q", p_q_, "m", "position of E in W at the measured q, at the beginning of the step");
  v.output("quat_q", quat_q_, "1", "orientation of E in W at the measured q, unit quaternion (w, x, y, z)");
  v.output("epsilon_q", epsilon_q_, "1", "as epsilon, of E at the measured q");
  v.output("task_error", task_error_, "m", "distance of the joints' pose from the compliant pose, rotations times 0.3 m");
  self_motion_.declare(v);
  v.parameter(
       "alpha", alpha_, "1/s",
       "0: the tank limits how M_T, S_T, M_R, K_o change; above 0: S_T, K_o and damping change by the bound of Kronander and "
       "Billard with this rate, M_T and M_R stay")
      .range(0, 1e6);
  if (impedance_) {
    v.state("twist_static", impedance_->twist, "1", "motor less static link position, rad or m");
    v.output(
        "stiffness_ratio", impedance_->stiffness_ratio, "1",
        "stiffness of the frame relative to that of the joints, an upper bound; above 0.8 the links are softer than asked");
    v.output("static_error", impedance_->static_error, "1", "residual of the static position of the links, rad or m");
    v.state("beyond_high", impedance_limits_->beyond_high, "1",
            "how far above q_max a joint may still be, because it started there; rad or m");
    v.state("beyond_low", impedance_limits_->beyond_low, "1", "how far below q_min; rad or m");
    return;
  }
  declared.input(
      "xi", self_motion_.xi, "rad/s2",
      "acceleration of your own goal of the self-motion, beside those of the setting null_space: only its part in the "
      "null space of the tasks acts (IV-A3); -M^-1 grad V for a potential V");
  v.parameter("K_e", K_e_, "1", "stiffness of the environment along the axes of S_T, then of K_o, N/m and N.m/rad; 0: unknown")
      .range(0, kAny);
  v.parameter(
       "omega_t", omega_t_, "rad/s",
       "bandwidth of the position control of a robot that is moved by q_c, for K_e_max with the delay of the way there and "
       "back; 0: the tracking of this unit")
      .range(0, kAny);
  v.parameter("zeta_t", zeta_t_, "1", "its damping ratio").range(0, kAny);
  v.state("contact_turn", contact_turn_, "counter of the steps in which K_e_max is computed, one frequency every 16 steps");
  v.state("K_e_max", contact_.K_e_max, "1",
          "a stiffness of the environment below which no contact vibrates after pushes up to 0.06 N.s, along the axes of S_T, "
          "then of K_o, N/m and "
          "N.m/rad; 0 in directions that are not rendered, in the first steps, and where the motors vibrate without a contact");
  v.parameter("p_min", p_min_, "m", "lower sides of a box in W for the origin of the compliant frame; p_min >= p_max: none")
      .range(-kAny, kAny);
  v.parameter("p_max", p_max_, "m", "upper sides of the box").range(-kAny, kAny);
  v.parameter("v_max", v_max_, "m/s", "limit of the speed of the compliant frame; 0: none").range(0, kAny);
  v.parameter("w_max", w_max_, "rad/s", "limit of its angular speed; 0: none").range(0, kAny);
  v.parameter("braking_frame", braking_, "m/s2", "deceleration with which the frame stops at the box").range(1e-6, kAny);
  v.parameter(
      "brake_saturated", brake_saturated_,
      "motor torque that tau_max cuts brakes the compliant frame, so that it does not run away from a robot that cannot "
      "follow; (3a), (3b) do not hold meanwhile");
}

void CartesianMotion::declare_search(Variables& v) {
  if (!impedance_) {
    v.state("K_e_least", contact_.least, "1", "as K_e_max, of the frequencies that the present search has passed");
    v.state("contact_before", contact_.before, "1", "-1/G at the last frequency of the search, real and imaginary parts");
    v.state("contact_frequency", contact_.Omega, "rad/s", "the last frequency of the search; 0: a new search begins");
    v.state("contact_ratio", contact_.ratio, "1", "ratio of the last two frequencies of the search");
  }
  v.parameter("delay", delay_, "s",
              "age of the measurements at the beginning of a step (bus, filters), for the check whether the robot vibrates and "
              "for K_e_max")
      .range(0, 1);
  v.state("checked_step", checked_step_, "s", "the longest step for which this was checked; 0: none");
  if (!impedance_) {
    v.state("follower_vibrates", follower_vibrates_, "1 if the robot vibrates without a contact, so that K_e_max is 0");
    return;
  }
  v.state("gears_undamped", gears_undamped_, "where the robot vibrates: 1 if D is 0 for an elastic joint");
  v.state("delay_border", delay_border_, "s", "where the robot vibrates: the delay up to which it does not; 0: none helps");
  v.state("shaping_border", shaping_border_, "1", "likewise of the largest shaping");
  v.state("stiffness_border", stiffness_border_, "1", "likewise of S_T and K_o, with their damping, relative to their values");
}

}  // namespace cotwin::compliance
