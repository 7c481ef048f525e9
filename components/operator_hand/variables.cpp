// The unit's variables: names, meaning, what values they may have.
#include <cmath>
#include <span>

#include "components/operator_hand/operator_hand.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::operator_hand {
namespace {

constexpr double kLeastMass = 1e-6, kAny = 1e9;

}  // namespace

void OperatorHand::declare(Variables& v) {
  JointVariables joints(v, measures_);
  if (robot_) {
    joints.input("q", q_, "rad", "joint position of the robot").rate(q_rate_).essential();
    joints.input("dq", dq_, "rad/s", "joint velocity of the robot").rate(dq_rate_).essential();
  } else {
    v.input("p", p_, "m", "position of the gripped point").rate(p_rate_).essential();
    v.input("v", v_, "m/s", "velocity of the gripped point").rate(v_rate_).essential();
  }
  v.output("f", f_, "N", "force of the hand on the robot at the gripped point");
  v.output("p_h", p_h_, "m", "position of the hand");
  v.output("v_h", v_h_, "m/s", "velocity of the hand").derivative_of("p_h");
  v.output("p_i", p_i_, "m", "intended position, with its correction");
  v.output("v_i", v_i_, "m/s", "intended velocity").derivative_of("p_i");
  v.output("p_seen", p_seen_, "m", "position of the gripped point that the person sees, reaction_delay ago");
  v.output("grip", grip_, "1", "share of the grip that is closed: 0 open, 1 closed");
  v.output("lag", lag_, "m", "distance of the gripped point from the planned position");
  v.output("energy", energy_, "J", "kinetic energy of the hand and energy of its springs");
  if (robot_) {
    v.output("p", p_, "m", "position of the gripped point in the robot's base frame");
    v.output("v", v_, "m/s", "velocity of the gripped point in the robot's base frame").derivative_of("p");
    joints.output("tau_e", tau_e_, "N.m", "joint torque of the force on the robot, transposed Jacobian times f");
  }
  figures_.declare_outputs(v);

  v.parameter("waypoint_t", waypoint_t_, "s", "arrival times at the waypoints of the intention").range(-kAny, kAny);
  v.parameter("waypoint_p", waypoint_p_, "m", "positions of the waypoints, x y z of the first, then of the next")
      .range(-kAny, kAny)
      .essential();
  v.parameter("waypoint_dwell", waypoint_dwell_, "s", "duration of the rest at each waypoint").range(0, kAny);
  v.parameter("passing", passing_,
              "rest: the intention stops at every waypoint; through: it passes waypoints without dwell with minimum jerk");
  v.parameter(
      "relative", relative_,
      "waypoints are displacements: the gripped point is where the intention is at the start of the run, and again each "
      "time the grip begins to close");
  v.parameter("m_h", m_h_, "kg", "mass of the hand along each principal axis").range(kLeastMass, kAny);
  v.parameter("axes", axes_, "1", "directions of the principal axes, unit quaternion (w, x, y, z)").range(-kAny, kAny);
  v.parameter("D_g", D_g_, "N.s/m", "damping of the grip along each principal axis").range(0, kAny);
  v.parameter("K_g", K_g_, "N/m", "stiffness of the grip along each principal axis").range(0, kAny);
  v.parameter("grip_t", grip_t_, "s", "times at which the grip begins to close; 1e9: never").range(-kAny, kAny);
  v.parameter("release_t", release_t_, "s", "times at which the grip begins to open, each not before its grip_t")
      .range(-kAny, kAny);
  v.parameter("grip_duration", grip_duration_, "s", "duration of closing and of opening the grip").range(0, kAny);
  v.parameter("reaction_delay", reaction_delay_, "s", "time after which the person reacts to what is seen").range(0, kAny);
  v.parameter("correction_max", correction_max_, "m", "largest correction of the intention").range(0, kAny);
  v.parameter("settling", settling_, "s", "time after the last arrival that still counts for f_rms, lag_rms and jerk")
      .range(0, kAny);
  if (robot_) v.parameter("offset", offset_, "m", "gripped point in the gripped frame").range(-kAny, kAny);
  v.tunable("D_h", D_h_, "N.s/m", "damping of the arm along each principal axis").range(0, kAny);
  v.tunable("K_h", K_h_, "N/m", "stiffness of the arm along each principal axis").range(0, kAny);
  v.tunable("correction", correction_, "1/s",
            "rate at which the intention is corrected by the lag that is seen (crossover frequency); 0: not corrected")
      .range(0, kAny);

  v.state("x", x_, "m", "position of the hand along the principal axes");
  v.state("dx", dx_, "m/s", "velocity of the hand along the principal axes");
  v.state("K_before", K_before_, "N/m", "K_h in the last step");
  v.state("grip_before", grip_before_, "1", "mean grip in the last step");
  v.state("origin", origin_, "m", "where the waypoints start from");
  v.state("e", e_, "m", "correction of the intention");
  v.state("de", de_, "m/s", "rate of the correction in the last step");
  seen_.declare(v, "seen", "m", "the position of the gripped point");
  v.state("work_muscles", work_.muscles, "J", "work of the intention on the hand, and of changes of K_h and grip");
  v.state("work_robot", work_.robot, "J", "work of the hand on the robot");
  v.state("work_dissipated", work_.dissipated, "J", "energy dissipated in arm and grip");
  figures_.declare_states(v);
  if (moment_) {
    if (!robot_) {
      v.input("quat", quat_, "1", "orientation of what is gripped, unit quaternion (w, x, y, z)").essential();
      v.input("w", w_, "rad/s", "angular velocity of what is gripped").rate(w_rate_).essential();
    }
    v.output("m", m_, "N.m", "moment of the hand on the robot");
    v.output("quat_i", quat_i_, "1", "intended orientation, unit quaternion (w, x, y, z)");
    v.parameter("waypoint_turn", waypoint_turn_, "rad",
                "turns of the waypoints, axis times angle: x y z of the first, then of the next; if relative, from the "
                "orientation at the start of the run, and again each time the grip begins to close")
        .range(-kAny, kAny);
    v.tunable("K_r", K_r_, "N.m/rad", "rotational stiffness of arm and grip about each principal axis").range(0, kAny);
    v.tunable("D_r", D_r_, "N.m.s/rad", "rotational damping of arm and grip about each principal axis").range(0, kAny);
    v.state("quat_start", quat_start_, "1", "orientation that the turns of the waypoints start from");
    v.state("work_turn", work_turn_, "J", "work of the moment on the robot");
  }
  v.state("taken", taken_, "number of grips that have begun");
}

void OperatorHand::check() {
  const auto at_least = [](const char* name, std::span<const double> values, double least, const char* si) {
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (values[i] >= least && values[i] <= kAny) continue;
      throw Error(
          std::string("unit:operator_hand.") + name + "[" + std::to_string(i + 1) + "]",
          "is " + text::to_text(values[i]) + " " + si + ", expected " + text::to_text(least) + " to " + text::to_text(kAny));
    }
  };
  at_least("m_h", m_h_, kLeastMass, "kg");
  at_least("D_h", D_h_, 0, "N.s/m");
  at_least("K_h", K_h_, 0, "N/m");
  at_least("D_g", D_g_, 0, "N.s/m");
  at_least("K_g", K_g_, 0, "N/m");
  at_least("correction", {&correction_, 1}, 0, "1/s");
  at_least("K_r", K_r_, 0, "N.m/rad");
  at_least("D_r", D_r_, 0, "N.m.s/rad");
  const auto refuse = [&](const char* name, std::size_t k, double is, double least, const std::string& why) {
    const std::string index = grip_t_.size() > 1 ? "[" + std::to_string(k + 1) + "]" : "";
    throw Error("unit:operator_hand." + (name + index),
                "is " + text::to_text(is) + " s, expected at least " + text::to_text(least) + " s, " + why);
  };
  for (std::size_t k = 0; k < grip_t_.size(); ++k) {
    if (!(release_t_[k] >= grip_t_[k])) refuse("release_t", k, release_t_[k], grip_t_[k], "when this grip begins to close");
    if (k == 0 || grip_t_[k] >= kNever) continue;
    const double open = release_t_[k - 1] + grip_duration_;
    if (!(grip_t_[k] >= open)) refuse("grip_t", k, grip_t_[k], open, "when the grip before it is open");
  }
}

}  // namespace cotwin::operator_hand
