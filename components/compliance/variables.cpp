// The unit's variables: names, meaning, what values they may have.
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "components/compliance/compliance.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::compliance {
namespace {

[[noreturn]] void refuse(const char* name, std::size_t i, double value, const char* expected) {
  throw Error("compliance",
              std::string(name) + "[" + std::to_string(i + 1) + "] = " + text::to_text(value) + ", expected " + expected);
}

}  // namespace

void Compliance::declare(Variables& v) {
  constexpr double kAny = 1e12;  // a bound that no robot reaches
  const bool any_elastic = std::any_of(K_.begin(), K_.end(), [](double K) { return K > 0; });
  v.input("q_d", q_d_, "rad", "desired joint position at the end of the step").essential();
  v.input("dq_d", dq_d_, "rad/s", "desired joint velocity at the end of the step");
  v.input("ddq_d", ddq_d_, "rad/s2", "desired joint acceleration at the end of the step");
  v.input("q", q_, "rad", "measured link-side joint position").essential();
  v.input("dq", dq_, "rad/s", "measured link-side joint velocity");
  auto theta = v.input("theta", theta_, "rad", "measured motor position behind the gear; used where K > 0");
  if (any_elastic) theta.essential();
  v.input("dtheta", dtheta_, "rad/s", "measured motor velocity behind the gear; used where K > 0");
  v.input("tau_e", tau_e_, "N.m", "external joint torque as in (2a)").rate(tau_e_rate_);

  v.parameter("K", K_, "N.m/rad", "joint stiffness of (2c) for the feed-forward of flexibility; 0: the joint is taken as rigid")
      .range(0, kAny);
  v.tunable("B", wanted_.B, "kg.m2", "gear-reflected motor inertia of (2b) for the feed-forward").range(0, kAny);
  v.parameter("tau_max", tau_max_, "N.m", "limit of the motor torque, from the URDF's effort; 0: none").range(0, kAny);
  v.tunable("tau_C", wanted_.tau_C, "N.m",
            "Coulomb friction of the motor side, tau_C tanh(dtheta_c / v_R), for the feed-forward")
      .range(0, kAny);
  v.tunable("v_R", wanted_.v_R, "rad/s", "speed over which tau_C changes its sign").range(1e-9, kAny);
  v.tunable("sigma2", wanted_.sigma2, "N.m.s/rad", "viscous friction of the motor side").range(0, kAny);
  v.parameter("sigma0", sigma0_, "N.m/rad", "stiffness of a LuGre bristle, which then stands for tau_C tanh(..); 0: none")
      .range(0, kAny);
  v.parameter("sigma1", sigma1_, "N.m.s/rad", "damping of the bristle").range(0, kAny);
  v.tunable("tau_S", wanted_.tau_S, "N.m", "breakaway torque of the motor side; up to tau_C: no Stribeck effect")
      .range(0, kAny);
  v.tunable("v_S", wanted_.v_S, "rad/s", "Stribeck speed of the motor side").range(1e-9, kAny);
  v.parameter("delta", delta_, "1", "Stribeck exponent of the motor side").range(0.1, 10);
  v.tunable("tau_0", wanted_.tau_0, "N.m", "offset of the motor side's friction");
  v.tunable("link_tau_C", wanted_.link_tau_C, "N.m", "Coulomb friction of the link side, which a joint torque sensor feels")
      .range(0, kAny);
  v.tunable("link_v_R", wanted_.link_v_R, "rad/s", "speed over which link_tau_C changes its sign").range(1e-9, kAny);
  v.tunable("link_sigma2", wanted_.link_sigma2, "N.m.s/rad", "viscous friction of the link side").range(0, kAny);
  v.tunable("link_tau_0", wanted_.link_tau_0, "N.m", "offset of the link side's friction");
  v.parameter("link_A", link_A_, "N.m", "height of sigmoid friction of the link side, k + A / (1 + exp(-alpha (dq_c + s)))");
  v.parameter("link_alpha", link_alpha_, "s/rad", "steepness of sigmoid friction");
  v.parameter("link_s", link_s_, "rad/s", "shift of sigmoid friction");
  v.parameter("link_k", link_k_, "N.m", "offset of sigmoid friction");
  v.parameter("link_tau_S", link_tau_S_, "N.m", "breakaway torque of the link side; up to link_tau_C: no Stribeck effect")
      .range(0, kAny);
  v.parameter("link_v_S", link_v_S_, "rad/s", "Stribeck speed of the link side").range(1e-9, kAny);
  v.parameter("link_delta", link_delta_, "1", "Stribeck exponent of the link side").range(0.1, 10);
  v.parameter("link_load", link_load_, "1",
              "friction of the link side per torque of gravity: adds link_load |g(q_c)| tanh(dq_c / link_v_load)")
      .range(0, kAny);
  v.parameter("link_v_load", link_v_load_, "rad/s", "speed over which that friction changes its sign").range(1e-9, kAny);
  v.parameter("spring_sin", spring_sin_, "N.m",
              "springs and counterbalances of the link: for each joint the amplitudes of sin q, sin 2q, sin 3q, sin 4q");
  v.parameter("spring_cos", spring_cos_, "N.m", "likewise of cos q, cos 2q, cos 3q, cos 4q");
  v.parameter("tau_e_acts_on_robot", tau_e_acts_on_robot_,
              "tau_e also pushes the robot that is tracked, so that tau_m has to carry it");
  v.parameter("transition", transition_, "s", "time constant with which parameters in force follow the tunables; 0: at once")
      .range(0, kAny);
  v.parameter("elastic_bandwidth", elastic_bandwidth_, "rad/s", "bandwidth of the winding-up of elastic joints in theta_c")
      .range(1, 1e6);

  v.tunable("M_a", wanted_.M_a, "kg.m2", "desired inertia of the joint admittance, cf. (3a)").range(1e-9, kAny);
  v.tunable("D_a", wanted_.D_a, "N.m.s/rad", "desired damping of the joint admittance, beside that of zeta_a").range(0, kAny);
  v.tunable("zeta_a", wanted_.zeta_a, "1",
            "damping ratio of the joint admittance: adds 2 zeta_a sqrt(S_a M_a) to D_a; 1: aperiodic limit")
      .range(0, kAny);
  v.tunable("S_a", wanted_.S_a, "N.m/rad", "desired stiffness of the joint admittance; 0: freely guided").range(0, kAny);
  v.tunable("omega", wanted_.omega, "rad/s", "natural frequency of the tracking error under computed torque").range(0, kAny);
  v.tunable("zeta", wanted_.zeta, "1", "damping ratio of the tracking error under computed torque").range(0, kAny);
  v.tunable("Lambda", wanted_.Lambda, "1/s", "decay rate of the tracking error on s = 0, passivity-based tracking")
      .range(0, kAny);
  v.tunable("K_s", wanted_.K_s, "N.m.s/rad", "gain on s of passivity-based tracking").range(0, kAny);
  v.tunable("shaping", wanted_.shaping, "1",
            "torque feedback makes the motors of elastic joints lighter by this factor, which damps vibrating links; 1: none")
      .range(1, 100);
  v.tunable("passivity", wanted_.passivity, "1", "tracking: 0 computed torque, 1 passivity-based (Slotine and Li), or a blend")
      .range(0, 1);

  v.state("M_a_in_force", in_force_.M_a, "kg.m2", "M_a on its way to the tunable, as far as the tank pays for it");
  v.state("D_a_in_force", in_force_.D_a, "N.m.s/rad", "D_a on its way to the tunable");
  v.state("zeta_a_in_force", in_force_.zeta_a, "1", "zeta_a on its way to the tunable");
  v.state("S_a_in_force", in_force_.S_a, "N.m/rad", "S_a on its way to the tunable, as far as the tank pays for it");
  v.state("omega_in_force", in_force_.omega, "rad/s", "omega on its way to the tunable");
  v.state("zeta_in_force", in_force_.zeta, "1", "zeta on its way to the tunable");
  v.state("Lambda_in_force", in_force_.Lambda, "1/s", "Lambda on its way to the tunable");
  v.state("K_s_in_force", in_force_.K_s, "N.m.s/rad", "K_s on its way to the tunable");
  v.state("shaping_in_force", in_force_.shaping, "1", "shaping on its way to the tunable");
  v.state("passivity_in_force", in_force_.passivity, "1", "passivity on its way to the tunable");
  v.state("B_in_force", in_force_.B, "kg.m2", "B on its way to the tunable");
  v.state("tau_C_in_force", in_force_.tau_C, "N.m", "tau_C on its way to the tunable");
  v.state("v_R_in_force", in_force_.v_R, "rad/s", "v_R on its way to the tunable");
  v.state("sigma2_in_force", in_force_.sigma2, "N.m.s/rad", "sigma2 on its way to the tunable");
  v.state("tau_S_in_force", in_force_.tau_S, "N.m", "tau_S on its way to the tunable");
  v.state("v_S_in_force", in_force_.v_S, "rad/s", "v_S on its way to the tunable");
  v.state("tau_0_in_force", in_force_.tau_0, "N.m", "tau_0 on its way to the tunable");
  v.state("link_tau_C_in_force", in_force_.link_tau_C, "N.m", "link_tau_C on its way to the tunable");
  v.state("link_v_R_in_force", in_force_.link_v_R, "rad/s", "link_v_R on its way to the tunable");
  v.state("link_sigma2_in_force", in_force_.link_sigma2, "N.m.s/rad", "link_sigma2 on its way to the tunable");
  v.state("link_tau_0_in_force", in_force_.link_tau_0, "N.m", "link_tau_0 on its way to the tunable");
  v.state("Delta", Delta_, "rad", "compliant deviation q_c - q_d");
  v.state("dDelta", dDelta_, "rad/s", "rate of the compliant deviation");
  v.state("ddq_d_before", ddq_d_before_, "rad/s2", "desired joint acceleration at the beginning of the next step");
  v.state("tau_w", tracking_.tau_w, "N.m", "joint torque of the compliant motion, smoothed, that winds up elastic joints");
  v.state("dtau_w", tracking_.dtau_w, "N.m/s", "rate of tau_w");
  v.state("z", z_, "rad", "deflection of the bristle as the compliant motion bends it");
  v.state("theta_c", tracking_.theta_c, "rad", "motor position of the compliant motion; q_c where the joint is rigid");
  v.state("dtheta_c", tracking_.dtheta_c, "rad/s", "motor velocity of the compliant motion");

  v.output("q_c", q_c_, "rad", "compliant joint position");
  v.output("dq_c", dq_c_, "rad/s", "compliant joint velocity").derivative_of("q_c");
  v.output("ddq_c", ddq_c_, "rad/s2", "compliant joint acceleration").derivative_of("dq_c");
  v.output("tau_m", tau_m_, "N.m", "motor torque of (2b) that tracks q_c, held until the next step").discrete();
  v.output("tau_id", tau_id_, "N.m", "inverse dynamics (2a) alone: M ddq_c + C dq_c + g - tau_e, plus tau_f");
  v.output("tau_f", tau_f_, "N.m", "friction of both sides in the compliant motion, after the friction parameters");
  v.output("tau_excess", tau_excess_, "N.m", "motor torque asked for beyond tau_max, and not given");
  v.output("saturated", saturated_, "whether any joint's motor torque is at its limit");
  v.output("warning", warning_, "what the user should know after the run; empty if nothing");
  declare_bodies(v);
  v.state("tau_fl_before", tau_fl_before_, "N.m", "friction of the link side at the end of the last step");
  v.state("tau_fm_before", tau_fm_before_, "N.m", "friction of the motor side at the end of the last step");

  v.parameter("q_min", q_min_, "rad", "lower limit of the compliant motion, from the URDF; q_min >= q_max: none")
      .range(-kAny, kAny);
  v.parameter("q_max", q_max_, "rad", "upper limit of the compliant motion, from the URDF").range(-kAny, kAny);
  v.parameter("dq_max", dq_max_, "rad/s", "limit of the compliant motion's speed, from the URDF; 0: none").range(0, kAny);
  v.parameter("braking", braking_, "rad/s2", "deceleration with which the compliant motion stops at q_min and q_max")
      .range(1e-6, kAny);
  v.parameter(
       "tau_wind_up", tau_wind_up_, "N.m",
       "what the motor of an elastic joint may need at most to wind up its spring after a jump of the torque; 0: no bound")
      .range(0, kAny);
  v.parameter(
       "tank_start", tank_start_, "J",
       "energy at the start that a rise of S_a or M_a of a moving or deflected joint may give out, beside what was dissipated")
      .range(0, kAny);
  v.parameter("tank_max", tank_max_, "J", "most energy that is kept for that").range(0, kAny);
  v.tunable("omega_free", wanted_.omega_free, "rad/s", "damping is at least 2 zeta_a M_a omega_free, also for S_a = 0")
      .range(0, kAny);
  v.state("omega_free_in_force", in_force_.omega_free, "rad/s", "omega_free on its way to the tunable");
  v.state("tank", tank_, "J", "energy kept for a rise of S_a or M_a");
  v.state("limits_met", met_,
          "what happened since the start, summed: 1 torque cut, 2 stopped at a limit of position, 4 held at dq_max, 8 desired "
          "motion outside its limits, 16 a rise of S_a or M_a waited for energy");
  v.output("limit", limit_, "limit that acts on the compliant motion: 0 none, 1 position, 2 speed");
}

void Compliance::check() {
  const auto all = wanted_.all();
  for (std::size_t k = 0; k < all.size(); ++k) {
    const bool signed_too = k >= all.size() - Tunables::kSigned;
    for (std::size_t i = 0; i < all[k]->size(); ++i) {
      const double value = (*all[k])[i];
      if (!std::isfinite(value)) refuse(Tunables::kNames[k], i, value, "a finite value");
      if (!(signed_too || value >= 0)) refuse(Tunables::kNames[k], i, value, ">= 0");
    }
  }
  if (!(wanted_.passivity[0] <= 1)) refuse("passivity", 0, wanted_.passivity[0], "0 to 1");
  for (std::size_t i = 0; i < n_; ++i) {
    if (!(wanted_.M_a[i] > 0)) refuse("M_a", i, wanted_.M_a[i], "> 0 kg.m2");
    if (!(wanted_.shaping[i] >= 1)) refuse("shaping", i, wanted_.shaping[i], ">= 1");
    if (!(braking_[i] > 0)) refuse("braking", i, braking_[i], "> 0 rad/s2");
    if (!(K_[i] >= 0)) refuse("K", i, K_[i], ">= 0 N.m/rad");
    if (!(wanted_.v_S[i] > 0)) refuse("v_S", i, wanted_.v_S[i], "> 0 rad/s");
    if (!(wanted_.v_R[i] > 0)) refuse("v_R", i, wanted_.v_R[i], "> 0 rad/s");
    if (!(wanted_.link_v_R[i] > 0)) refuse("link_v_R", i, wanted_.link_v_R[i], "> 0 rad/s");
  }
}

}  // namespace cotwin::compliance
