#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/compliance/admittance.h"
#include "components/compliance/tracking.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"

namespace cotwin::compliance {

/// Compliant motion of the joints and its tracking (IV-A3):
///   admittance.h   the joint admittance M_a Δ̈ + D Δ̇ + S_a Δ = τ_e, Δ = q_c − q_d, like (3a), passive also while S_a rises
///   limits.h       limits of position and speed as one-sided walls on q_c
///   tracking.h     the motor torques that make links and motors follow q_c, of rigid and elastic joints
/// Friction of both sides is fed forward as the compliant motion meets it. Not in here: Cartesian impedance (3a), (3b).
///
/// The desired motion is expected for the end of a step (its source steps first), measurements for its beginning: as a robot's
/// controller, which knows where it wants to be next and where it has just been. Admittance, gains, bodies, B and friction in
/// force follow the tunables smoothly, so nothing jumps when they are changed.
class Compliance final : public Unit {
 public:
  /// What may be chosen by the source of the unit; cotwin describe shows it.
  static void declare_settings(SettingList& s);
  explicit Compliance(Settings& settings);
  ~Compliance() override;

  void declare(Variables& v) override;
  /// Throws Error for parameters without meaning, e.g. M_a = 0 (which would let q̇_c jump).
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  void restored() override;

 private:
  explicit Compliance(const robot::RobotModel& robot);
  struct Dynamics;

  /// What may be changed while the robot moves.
  struct Tunables {
    Joints M_a, S_a;                           // admittance, as far as the tank pays for them
    Joints D_a, zeta_a, omega_free;            // admittance
    Joints omega, zeta;                        // computed torque
    Joints Lambda, K_s;                        // passivity-based tracking
    Joints shaping;                            // of the motor inertia
    Joints passivity;                          // one value: the weight of the latter, 0 … 1
    Joints B;                                  // of the motors
    Joints tau_C, v_R, sigma2, tau_S, v_S;     // friction of the motor side
    Joints link_tau_C, link_v_R, link_sigma2;  // and of the link side
    Joints tau_0, link_tau_0;                  // which alone may be negative

    static constexpr std::array kNames = {"M_a",      "S_a",         "D_a",    "zeta_a",    "omega_free", "omega",
                                          "zeta",     "Lambda",      "K_s",    "shaping",   "passivity",  "B",
                                          "tau_C",    "v_R",         "sigma2", "tau_S",     "v_S",        "link_tau_C",
                                          "link_v_R", "link_sigma2", "tau_0",  "link_tau_0"};
    static constexpr std::size_t kPaid = 2;    // at the beginning
    static constexpr std::size_t kSigned = 2;  // at the end
    std::array<Joints*, kNames.size()> all() {
      return {&M_a, &S_a,   &D_a, &zeta_a, &omega_free, &omega, &zeta,       &Lambda,   &K_s,         &shaping, &passivity,
              &B,   &tau_C, &v_R, &sigma2, &tau_S,      &v_S,   &link_tau_C, &link_v_R, &link_sigma2, &tau_0,   &link_tau_0};
    }
  };

  /// What a run's summary names, as bits of `met`.
  enum Met : std::int32_t { kTorque = 1, kPosition = 2, kSpeed = 4, kDesired = 8, kTank = 16 };

  void declare_bodies(Variables& v);
  void check();
  void follow_tunables(double h);
  void move_compliantly(double h);
  void add_load(double h);
  void finish_torques(double h);
  void note(std::size_t i, Met what);
  void write_warning();
  Limits limits(std::size_t i) const { return {q_min_[i], q_max_[i], dq_max_[i], braking_[i]}; }
  Reference reference() const { return {q_c_, dq_c_, ddq_c_, a_q_}; }
  Load load() const { return {load_mean_, load_end_}; }
  Drives drives() const { return {K_, in_force_.B}; }
  Springs springs() const { return {spring_sin_, spring_cos_}; }
  Measured measured() const { return {q_, dq_, theta_, dtheta_}; }
  Gains gains() const {
    const Tunables& p = in_force_;
    return {p.omega, p.zeta, p.Lambda, p.K_s, p.shaping, p.passivity[0]};
  }
  double motor_friction(std::size_t i, double h);
  double link_friction(std::size_t i) const;
  void take_loads();

  std::size_t n_ = 0;
  std::unique_ptr<Dynamics> dynamics_;  // the robot and scratch

  // Inputs.
  Joints q_d_, dq_d_, ddq_d_, q_, dq_, theta_, dtheta_, tau_e_, tau_e_rate_;
  // Parameters.
  Joints K_, tau_max_;
  Joints q_min_, q_max_, dq_max_, braking_;  // limits of the compliant motion
  Joints tau_wind_up_;
  Joints tank_start_, tank_max_;                  // J
  Joints sigma0_, sigma1_, delta_;                // bristle of the motor side's friction
  Joints link_A_, link_alpha_, link_s_, link_k_;  // sigmoid friction of the link side
  Joints link_tau_S_, link_v_S_, link_delta_;     // its Stribeck effect
  Joints link_load_, link_v_load_;                // its friction that grows with the load
  Joints spring_sin_, spring_cos_;                // springs, robot::Harmonics::kMost per joint
  bool tau_e_acts_on_robot_ = true;
  double transition_ = 0.05;        // s
  double elastic_bandwidth_ = 500;  // rad/s
  Tunables wanted_;
  // States.
  Tunables in_force_;
  Joints Delta_, dDelta_;                 // q_c − q_d
  Joints ddq_d_before_;                   // at the beginning of the step
  Joints z_;                              // bristle
  Joints tau_fl_before_, tau_fm_before_;  // friction of the link and the motor side at the beginning of the step
  Joints tank_;                           // J
  std::vector<std::int32_t> met_;
  Tracking tracking_;  // with states of its own
  // Outputs.
  Joints q_c_, dq_c_, ddq_c_, tau_m_, tau_id_, tau_f_, tau_excess_;
  bool saturated_ = false;
  std::string warning_;
  std::vector<std::int32_t> limit_;
  // Handed from one phase of a step to the next.
  Joints tau_fl_, tau_fm_;       // friction of the link (with its springs) and the motor side at the end of the step
  Joints loaded_;                // N.m: link_load |g(q_c)|
  Joints load_mean_, load_end_;  // link friction less τ_e, over the step and at its end
  Joints a_q_;                   // mean of q̈_c over the step
};

}  // namespace cotwin::compliance
