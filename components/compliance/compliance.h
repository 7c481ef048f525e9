#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/unit/settings.h"
#include "components/unit/unit.h"

namespace cotwin::compliance {

/// Compliant motion of the joints and its tracking (IV-A3). Joint admittance, per joint like (3a):
///   M_a Δ̈ + D Δ̇ + S_a Δ = τ_e,   Δ = q_c − q_d,   D = D_a + 2 zeta_a √(S_a M_a)
/// Tracking of q_c by computed torque (passivity = 0) or in the passivity-based form of Slotine and Li (passivity = 1):
///   τ_m = M (q̈_c + 2ζω ė + ω² e) + B (θ̈_c + 2ζω ė + ω² e) + C q̇ + g − τ_e + τ_f
///   τ_m = M q̈_r + B θ̈_r + C q̇_r + g − τ_e + τ_f + K_s s,   q̇_r = q̇ + s,   s = ė + Λ e,   q̈_r = q̈_c + Λ ė
/// with Ṁ − 2C skew-symmetric. The error e is taken at the motor, θ_c − θ, where the joint is elastic:
///   θ_c = q_c + τ_J,c / K,   τ_J,c = M q̈_c + C q̇_c + g − τ_e  at q_c                           (2a), (2c)
/// and at the link, q_c − q, where it is rigid (K = 0): feedback of an elastic joint's link side alone is unstable from small
/// gains on, that of its motor is not, whatever the gains, in continuous time; with a torque that is held for h, computed
/// torque needs ζ ω h (M_ii + B)/B < 1 of an elastic joint. Links may still vibrate against motors that the feedback holds; a
/// feedback of τ_J = K (θ − q) on top, which lets a motor appear as light as B / shaping, damps them (Ott, Albu-Schäffer, Kugi,
/// Hirzinger: IEEE T-RO 24(2), 2008; passive in continuous time, sampled only for motor frequencies √(K shaping/B) well below
/// 1/h). Not in here: Cartesian impedance (3a), (3b).
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
  using Joints = std::vector<double>;  // one value a joint
  struct Dynamics;

  /// What may be changed while the robot moves.
  struct Tunables {
    Joints M_a, D_a, zeta_a, S_a;              // admittance
    Joints omega, zeta;                        // computed torque
    Joints Lambda, K_s;                        // passivity-based tracking
    Joints shaping;                            // of the motor inertia
    Joints passivity;                          // one value: the weight of the latter, 0 … 1
    Joints B;                                  // of the motors
    Joints tau_C, v_R, sigma2, tau_S, v_S;     // friction of the motor side
    Joints link_tau_C, link_v_R, link_sigma2;  // and of the link side
    Joints tau_0, link_tau_0;                  // which alone may be negative

    static constexpr std::array kNames = {"M_a",   "D_a",     "zeta_a",     "S_a",      "omega",       "zeta",  "Lambda",
                                          "K_s",   "shaping", "passivity",  "B",        "tau_C",       "v_R",   "sigma2",
                                          "tau_S", "v_S",     "link_tau_C", "link_v_R", "link_sigma2", "tau_0", "link_tau_0"};
    static constexpr std::size_t kSigned = 2;  // at the end
    std::array<Joints*, kNames.size()> all() {
      return {&M_a,   &D_a, &zeta_a, &S_a,   &omega, &zeta,       &Lambda,   &K_s,         &shaping, &passivity, &B,
              &tau_C, &v_R, &sigma2, &tau_S, &v_S,   &link_tau_C, &link_v_R, &link_sigma2, &tau_0,   &link_tau_0};
    }
  };

  void declare_bodies(Variables& v);
  void check();
  void take_error();
  void follow_tunables(double h);
  void move_compliantly(double h);
  void refer_to_motors(double h);
  void track(double h);
  void wind_up(std::size_t i, double tau_Jc, double h);
  double motor_friction(std::size_t i, double h);
  double link_friction(std::size_t i) const;
  void take_loads();

  std::size_t n_ = 0;
  std::unique_ptr<Dynamics> dynamics_;  // the robot and scratch

  // Inputs.
  Joints q_d_, dq_d_, ddq_d_, q_, dq_, theta_, dtheta_, tau_e_, tau_e_rate_;
  // Parameters.
  Joints K_, tau_max_;
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
  Joints Delta_, dDelta_;      // q_c − q_d
  Joints ddq_d_before_;        // at the beginning of the step
  Joints tau_w_, dtau_w_;      // smoothed τ_J,c, which winds up the elastic joints
  Joints z_;                   // bristle
  Joints theta_c_, dtheta_c_;  // where the motors should be
  // Outputs.
  Joints q_c_, dq_c_, ddq_c_, tau_m_, tau_id_, tau_f_, tau_excess_;
  bool saturated_ = false;
  std::string warning_;
  // Handed from one phase of a step to the next.
  Joints e_, de_;                         // tracking error at the beginning of the step
  Joints tau_fl_, tau_fm_;                // friction of the link (with its springs) and the motor side at the step's end
  Joints tau_fl_before_, tau_fm_before_;  // state: the same at its beginning
  Joints tau_fl_mean_, tau_fm_mean_;      // the mean of both, which the torque held over the step has to overcome
  Joints load_;                           // N.m: link_load |g(q_c)|
  Joints tau_unwound_;                    // τ_J,c − tau_w
  Joints a_q_, a_theta_;                  // mean of q̈_c and θ̈_c over the step
};

}  // namespace cotwin::compliance
