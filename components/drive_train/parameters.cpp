// The drive train's parameters: names, ranges, and what is unphysical.
#include <cmath>

#include "components/drive_train/drive_train.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::drive_train {

void DriveTrain::declare_parameters(Variables& v) {
  Parameters& p = wanted_;
  constexpr double most = 1e12;  // a bound that no drive reaches
  // SUNDIALS' history is replayed after a restored snapshot, with the parameters of its end: they have to be those of its
  // beginning.
  const auto declare = [&](const char* name, std::vector<double>& values, const char* si, const char* description) {
    return uses_sundials() ? v.parameter(name, values, si, description) : v.tunable(name, values, si, description);
  };
  auto q0 = v.parameter("q0", q0_, "rad", "link-side joint position at the start, inside");
  if (equations_.inside()) q0.essential();
  v.parameter("dq0", dq0_, "rad/s", "link-side and motor speed at the start, inside");
  v.parameter("K", p.K, "N.m/rad", "joint stiffness, diagonal of K in (2c)").range(0, most);
  declare("B", p.B, "kg.m2", "motor inertia behind the gear, diagonal of B in (2b)").range(0, most);
  v.parameter("D", p.D, "N.m.s/rad", "joint damping parallel to K").range(0, most);
  v.parameter("backlash", p.backlash, "rad", "half of the gear's play").range(0, most);
  v.parameter("sigma0", p.sigma0, "N.m/rad", "bristle stiffness of the motor's friction; 0 for no bristle").range(0, most);
  v.parameter("sigma1", p.sigma1, "N.m.s/rad", "bristle damping").range(0, most);
  declare("sigma2", p.sigma2, "N.m.s/rad", "viscous friction of the motor").range(0, most);
  declare("tau_C", p.tau_C, "N.m", "Coulomb friction of the motor").range(0, most);
  declare("tau_S", p.tau_S, "N.m", "breakaway torque of the motor, at least tau_C").range(0, most);
  declare("v_S", p.v_S, "rad/s", "Stribeck speed").range(0, most);
  v.parameter("delta", p.delta, "1", "Stribeck exponent").range(0.1, 10);
  v.parameter("breakaway", p.breakaway, "1", "friction=elasto_plastic: share of the sliding deflection that is purely elastic")
      .range(0, 0.99);
  declare("tau_0", p.tau_0, "N.m", "constant part of the motor's friction, which makes it asymmetric");
  // of the links, which play their part where these are inside
  declare("link_tau_C", p.link_tau_C, "N.m", "Coulomb friction of the link, behind the torque sensor").range(0, most);
  declare("link_sigma2", p.link_sigma2, "N.m.s/rad", "viscous friction of the link").range(0, most);
  declare("link_tau_0", p.link_tau_0, "N.m", "constant part of the link's friction");
  declare("link_v_R", p.link_v_R, "rad/s", "speed below which link_tau_C creeps instead of sticking").range(0, most);
  v.parameter("link_A", p.link_A, "N.m", "height of the link's sigmoid friction k + A/(1 + exp(-alpha (dq + s)))");
  v.parameter("link_alpha", p.link_alpha, "s/rad", "its steepness");
  v.parameter("link_s", p.link_s, "rad/s", "its shift");
  v.parameter("link_k", p.link_k, "N.m", "its value at high negative speed");
  v.parameter("q_min", p.q_min, "rad", "lower joint limit, of the stop");
  v.parameter("q_max", p.q_max, "rad", "upper joint limit, of the stop");
  v.parameter("stop_stiffness", p.stop_stiffness, "N.m/rad", "of the stops at both limits; 0 for none").range(0, most);
  v.parameter("stop_restitution", p.stop_restitution, "1", "speed after over before an impact of a free link on its stop")
      .range(0.01, 1);
  v.parameter("rtol", rtol_, "1", "relative local error allowed in a sub-step").range(0, 1);
  v.parameter("atol", atol_, "rad", "absolute local error allowed in q and theta").range(1e-14, 1);
  v.parameter("atol_speed", atol_speed_, "rad/s", "absolute local error allowed in dq and dtheta").range(1e-14, 1e3);
  v.parameter("max_substeps", max_substeps_, "method=rosenbrock: attempts in one step, after which the tolerance is given up")
      .range(1, 100000);
  v.parameter("input_order", input_order_,
              "0: inputs are held over a step, or follow their rates; 1: they go linearly from their last value to the new "
              "one, which is "
              "that at the step's end (q and dq outside: a cubic; with 0 q moves on with dq)")
      .range(0, 1);
  v.parameter(
       "link_order", link_order_,
       "the same for q and dq with link=outside: 1 where their source makes its step before this unit's; -1: as input_order")
      .range(-1, 1);
  v.parameter("transition", transition_, "s", "time constant with which what is in force follows the tunables; 0: at once")
      .range(0, 1e6);
  v.parameter("v_R", p.v_R, "rad/s", "friction=smooth: speed over which the motor's friction changes its sign").range(0, most);
  v.parameter("link_tau_S", p.link_tau_S, "N.m", "breakaway torque of the link; up to link_tau_C: no Stribeck effect")
      .range(0, most);
  v.parameter("link_v_S", p.link_v_S, "rad/s", "Stribeck speed of the link").range(0, most);
  v.parameter("link_delta", p.link_delta, "1", "Stribeck exponent of the link").range(0.1, 10);
  v.parameter("link_load", p.link_load, "1",
              "friction of the link per torque of gravity: adds link_load |g(q)| tanh(dq / link_v_load)")
      .range(0, most);
  v.parameter("link_v_load", p.link_v_load, "rad/s", "speed over which that friction changes its sign").range(0, most);
  v.parameter("spring_sin", p.spring_sin, "N.m",
              "springs and counterbalances of the link: for each joint the amplitudes of sin q, sin 2q, sin 3q, sin 4q");
  v.parameter("spring_cos", p.spring_cos, "N.m", "likewise of cos q, cos 2q, cos 3q, cos 4q");
  if (!uses_sundials())
    v.state("drives", drives_, "1", "in force of each joint: B, sigma2, tau_C … link_v_R, in the order above");
  if (!equations_.inside()) return;
  robot::BodyParameters& b = equations_.bodies();
  declare("mass", b.mass, "kg", "mass of each body of the robot, as its model has it at the start");
  declare("first_moment", b.first_moment, "kg.m", "mass times centre of mass of body after body, in its frame (x, y, z)");
  declare("inertia", b.inertia, "kg.m2", "inertia of body after body about its frame's origin: xx, xy, xz, yy, yz, zz");
  v.state("bodies", b.in_force, "1", "the ten inertial parameters in force of body after body");
}

void DriveTrain::check_parameters() const {
  const Parameters& p = wanted_;
  const auto fail = [&](const char* name, std::size_t i, double value, const std::string& expected) {
    throw Error(place_ + "." + name + "[" + std::to_string(i + 1) + "]",
                "is " + text::to_text(value) + ", expected " + expected);
  };
  for (std::size_t i = 0; i < n_; ++i) {
    const auto positive = [&](const char* name, const std::vector<double>& v) {
      if (!(v[i] > 0) || !std::isfinite(v[i])) fail(name, i, v[i], "a finite value > 0");
    };
    const auto not_negative = [&](const char* name, const std::vector<double>& v) {
      if (!(v[i] >= 0) || !std::isfinite(v[i])) fail(name, i, v[i], "a finite value >= 0");
    };
    const auto finite = [&](const char* name, const std::vector<double>& v) {
      if (!std::isfinite(v[i])) fail(name, i, v[i], "a finite value");
    };
    positive("B", p.B);
    if (equations_.flexible()) positive("K", p.K);
    not_negative("D", p.D);
    not_negative("backlash", p.backlash);
    not_negative("sigma0", p.sigma0);
    not_negative("sigma1", p.sigma1);
    not_negative("sigma2", p.sigma2);
    not_negative("tau_C", p.tau_C);
    not_negative("tau_S", p.tau_S);
    positive("v_S", p.v_S);
    positive("delta", p.delta);
    finite("tau_0", p.tau_0);
    if (equations_.has_bristles() && p.sigma0[i] == 0 && p.tau_C[i] > 0)
      fail("tau_C", i, p.tau_C[i], "0 where no bristle carries it (sigma0 = 0), or friction=coulomb or smooth");
    if (p.tau_S[i] < p.tau_C[i]) fail("tau_S", i, p.tau_S[i], "at least tau_C = " + text::to_text(p.tau_C[i]) + " N.m");
    if (equations_.has_bristles() && p.sigma0[i] == 0 && p.tau_S[i] > 0)
      fail("tau_S", i, p.tau_S[i], "0 where no bristle carries it (sigma0 = 0), or friction=coulomb or smooth");
    if (!(p.breakaway[i] >= 0 && p.breakaway[i] < 1)) fail("breakaway", i, p.breakaway[i], "0 to below 1");
    not_negative("link_tau_C", p.link_tau_C);
    not_negative("link_sigma2", p.link_sigma2);
    finite("link_tau_0", p.link_tau_0);
    positive("link_v_R", p.link_v_R);
    positive("v_R", p.v_R);
    not_negative("link_tau_S", p.link_tau_S);
    positive("link_v_S", p.link_v_S);
    positive("link_delta", p.link_delta);
    not_negative("link_load", p.link_load);
    positive("link_v_load", p.link_v_load);
    if (!equations_.inside()) continue;
    finite("q0", q0_);
    finite("dq0", dq0_);
    finite("link_A", p.link_A);
    finite("link_alpha", p.link_alpha);
    finite("link_s", p.link_s);
    finite("link_k", p.link_k);
    for (std::size_t k = i * robot::Harmonics::kMost; k < (i + 1) * robot::Harmonics::kMost; ++k) {
      if (!std::isfinite(p.spring_sin[k])) fail("spring_sin", k, p.spring_sin[k], "a finite value");
      if (!std::isfinite(p.spring_cos[k])) fail("spring_cos", k, p.spring_cos[k], "a finite value");
    }
    not_negative("stop_stiffness", p.stop_stiffness);
    if (!(p.stop_restitution[i] > 0 && p.stop_restitution[i] <= 1))
      fail("stop_restitution", i, p.stop_restitution[i], "above 0 to 1");
    if (!(p.q_min[i] < p.q_max[i])) fail("q_min", i, p.q_min[i], "below q_max = " + text::to_text(p.q_max[i]) + " rad");
  }
}

}  // namespace cotwin::drive_train
