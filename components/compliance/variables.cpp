// The unit's variables: names, meaning, what values they may have.
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "components/compliance/compliance.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::compliance {
namespace {

constexpr double kUnreachable = 1e12;  // a bound that no robot reaches

struct DriveVariable {
  std::string_view name;
  const char* addition = "";  // to the description
};
/// The parameters of the drive that the feed-forward uses, in the order of the FMI value references. tau_max follows B.
constexpr DriveVariable kDrive[] = {{"K", "; 0: the joint is taken as rigid"},
                                    {"B"},
                                    {"tau_C"},
                                    {"v_R"},
                                    {"sigma2"},
                                    {"sigma0"},
                                    {"sigma1"},
                                    {"tau_S"},
                                    {"v_S"},
                                    {"delta"},
                                    {"tau_0"},
                                    {"link_tau_C"},
                                    {"link_v_R"},
                                    {"link_sigma2"},
                                    {"link_tau_0"},
                                    {"link_A"},
                                    {"link_alpha"},
                                    {"link_s"},
                                    {"link_k"},
                                    {"link_tau_S"},
                                    {"link_v_S"},
                                    {"link_delta"},
                                    {"link_load"},
                                    {"link_v_load"},
                                    {"spring_sin"},
                                    {"spring_cos"}};

}  // namespace

void Compliance::declare(Variables& v) {
  JointVariables joints(v, measures_);
  if (!cartesian_ || cartesian_->desired_joints()) {
    joints.input("q_d", q_d_, "rad", "desired joint position at the end of the step").essential();
    joints.input("dq_d", dq_d_, "rad/s", "desired joint velocity at the end of the step");
    joints.input("ddq_d", ddq_d_, "rad/s2", "desired joint acceleration at the end of the step");
  }
  joints.input("q", q_, "rad", "measured link-side joint position").essential();
  joints.input("dq", dq_, "rad/s", "measured link-side joint velocity");
  auto theta = joints.input("theta", theta_, "rad", "measured motor position behind the gear; used where K > 0");
  if (std::ranges::any_of(drive_.K, [](double K) { return K > 0; })) theta.essential();
  joints.input("dtheta", dtheta_, "rad/s", "measured motor velocity behind the gear; used where K > 0");
  if (!cartesian_ || cartesian_->wrench_of_joints())
    joints.input("tau_e", tau_e_, "N.m", "external joint torque as in (2a)").rate(tau_e_rate_);

  for (const DriveVariable& d : kDrive) {
    joints.parameter(drive_, robot::drive_parameter(d.name), true, d.addition);
    if (d.name == "B") {
      joints.parameter("tau_max", tau_max_, "N.m", "limit of the motor torque, from the URDF's effort; 0: none")
          .range(0, kUnreachable);
    }
  }
  v.parameter("tau_e_acts_on_robot", tau_e_acts_on_robot_,
              "tau_e also pushes the robot that is tracked, so that tau_m has to carry it");
  v.parameter("transition", transition_, "s", "time constant with which parameters in force follow the tunables; 0: at once")
      .range(0, kUnreachable);
  v.parameter("elastic_bandwidth", elastic_bandwidth_, "rad/s", "bandwidth of the winding-up of elastic joints in theta_c")
      .range(1, 1e6);

  // omega_free was added later and is declared below. The gains of the joint admittance come first.
  const auto all_gains = std::span(kGains).first(kGains.size() - 1);
  const auto gains = cartesian_ ? all_gains.subspan(kAdmittanceGains) : all_gains;
  const auto& omega_free = kGains.back();
  const auto in_force = [&](const ParameterRow<GainParameters>& row) {
    const bool paid = row.mutability == Mutability::kByUnit;
    joints.in_force(in_force_, row, paid ? ", as far as the tank pays for it" : "");
  };
  for (const auto& row : gains) joints.parameter(wanted_, row);
  for (const auto& row : gains) in_force(row);
  for (const DriveVariable& d : kDrive) {
    const auto& row = robot::drive_parameter(d.name);
    if (row.mutability != Mutability::kFixed) joints.in_force(drive_in_force_, row);
  }
  if (!cartesian_) {
    joints.state("Delta", Delta_, "rad", "compliant deviation q_c - q_d");
    joints.state("dDelta", dDelta_, "rad/s", "rate of the compliant deviation");
    joints.state("ddq_d_before", ddq_d_before_, "rad/s2", "desired joint acceleration at the beginning of the next step");
  }
  joints.state("tau_w", tracking_.tau_w, "N.m", "joint torque of the compliant motion, smoothed, that winds up elastic joints");
  joints.state("dtau_w", tracking_.dtau_w, "N.m/s", "rate of tau_w");
  joints.state("z", z_, "rad", "deflection of the bristle as the compliant motion bends it");
  joints.state("theta_c", tracking_.theta_c, "rad", "motor position of the compliant motion; q_c where the joint is rigid");
  joints.state("dtheta_c", tracking_.dtheta_c, "rad/s", "motor velocity of the compliant motion");

  joints.output("q_c", q_c_, "rad", "compliant joint position");
  joints.output("dq_c", dq_c_, "rad/s", "compliant joint velocity").derivative_of("q_c");
  joints.output("ddq_c", ddq_c_, "rad/s2", "compliant joint acceleration").derivative_of("dq_c");
  joints.output("tau_m", tau_m_, "N.m", "motor torque of (2b) that tracks q_c, held until the next step").discrete();
  joints.output("tau_id", tau_id_, "N.m", "inverse dynamics (2a) alone: M ddq_c + C dq_c + g - tau_e, plus tau_f");
  joints.output("tau_f", tau_f_, "N.m", "friction of both sides in the compliant motion, after the friction parameters");
  joints.output("tau_excess", tau_excess_, "N.m", "motor torque asked for beyond tau_max, and not given");
  v.output("saturated", saturated_, "whether any joint's motor torque is at its limit");
  v.output("warning", warning_, "what the user should know after the run; empty if nothing");
  declare_bodies(v, links_.bodies(), true);
  joints.state("tau_fl_before", tau_fl_before_, "N.m", "friction of the link side at the end of the last step");
  joints.state("tau_fm_before", tau_fm_before_, "N.m", "friction of the motor side at the end of the last step");

  joints.parameter("q_min", q_min_, "rad", "lower limit of the compliant motion, from the URDF; q_min >= q_max: none")
      .range(-kUnreachable, kUnreachable);
  joints.parameter("q_max", q_max_, "rad", "upper limit of the compliant motion, from the URDF")
      .range(-kUnreachable, kUnreachable);
  joints.parameter("dq_max", dq_max_, "rad/s", "limit of the compliant motion's speed, from the URDF; 0: none")
      .range(0, kUnreachable);
  joints.parameter("braking", braking_, "rad/s2", "deceleration with which the compliant motion stops at q_min and q_max")
      .range(1e-6, kUnreachable);
  joints
      .parameter(
          "tau_wind_up", tau_wind_up_, "N.m",
          "what the motor of an elastic joint may need at most to wind up its spring after a jump of the torque; 0: no bound")
      .range(0, kUnreachable);
  if (!cartesian_) {
    v.parameter("tank_start", tank_start_, "J",
                "energy at the start that a rise of S_a or M_a of a moving or deflected joint may give out, beside what was "
                "dissipated")
        .range(0, kUnreachable);
    v.parameter("tank_max", tank_max_, "J", "most energy that is kept for that").range(0, kUnreachable);
    joints.parameter(wanted_, omega_free);
    in_force(omega_free);
    v.state("tank", tank_, "J", "energy kept for a rise of S_a or M_a");
  }
  v.state("limits_met", met_,
          "what happened since the start, summed: 1 torque cut, 2 stopped at a limit of position, 4 held at dq_max, 8 desired "
          "motion outside its limits, 16 a rise of S_a or M_a waited for energy");
  v.output("limit", limit_, "limit that acts on the compliant motion: 0 none, 1 position, 2 speed");
  if (cartesian_) {
    cartesian_->declare(v);
    if (!cartesian_->wrench_of_joints())
      joints.output("tau_wrench", tau_e_, "N.m",
                    "J(q)' [f_e; m_e] at the measured q: the wrench as external joint torque (2a)");
  }
  if (floating_) {
    v.input("base_quat", base_quat_, "1",
            "orientation of the floating base in W, unit quaternion (w, x, y, z); with spin only");
    v.input("spin", spin_, "kg.m2/s", "angular momentum of the robot about its centre of mass, in W; 0: it started at rest");
  }
  if (terms_) terms_->declare(joints);
  if (cartesian_) joints.state("tau_cut", tau_cut_, "N.m", "tau_excess of the last step, for brake_saturated");
  if (cartesian_) cartesian_->declare_search(v);
  joints.parameter(drive_, robot::drive_parameter("D"), true,
                   "; used with space=cartesian, for K_e_max and the check whether render=impedance vibrates");
}

void Compliance::check() {
  settled_ = same(drive_in_force_, drive_, robot::kDriveParameters) && same(in_force_, wanted_, kGains);
  if (!(settled_ && checked_)) {
    check_values(drive_, robot::kDriveParameters, place_);
    check_values(wanted_, kGains, place_);
    checked_ = checked_ || settled_;
  }
  if (cartesian_) cartesian_->check(place_);
  for (std::size_t i = 0; i < n_; ++i) {
    if (braking_[i] > 0) continue;
    throw Error(place_ + ".braking[" + std::to_string(i + 1) + "]",
                "is " + text::to_text(braking_[i]) + ", expected > 0 " + measures_.si("rad/s2", i));
  }
}

}  // namespace cotwin::compliance
