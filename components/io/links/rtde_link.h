#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "components/io/emulators/ur/follower.h"
#include "components/io/link/acknowledgement.h"
#include "components/io/link/belief.h"
#include "components/io/link/link.h"
#include "components/io/link/robot_kinematics.h"
#include "components/io/links/gain_check.h"
#include "components/io/links/rtde_line.h"
#include "components/io/links/synchronisation.h"
#include "components/unit/settings.h"
#include "models/trajectory/axes.h"

namespace cotwin::io {

/// A Universal Robots arm behind RTDE: the PC's side. A step takes the data packages that have come and gives the newest:
///   q, q̇       actual_q, actual_qd;  q̈: differences of q̇ by the robot's time, low-pass `ddq_cutoff`
///   τ          actual_current_as_torque; else actual_current × torque_per_current, if that is given; else none
///   τ_e        J^T actual_TCP_force, at the flange (e-Series) or the TCP (CB3), if the robot's URDF is given; else none. What is believed of all of them: belief.h
///   command    mode=monitor: nothing is written; mode=position: registers that the program follow.script on the robot follows (rtde/follower.h), one command per step with new
///              data, from q_command with the PD synchronisation (synchronisation.h); until the robot follows, its own target position
/// Where the robot's program or safety does not let it follow, the command comes to rest at once; that has ended when three packages in a row say so.
/// A robot that sends nothing that is believed for `timeout` is not connected: q and τ are held, q̇, q̈ and τ_e are 0. Connections are set up again without
/// end. After a loss, a step back of the robot's clock, a jump of its position, or when its program does not follow any more, it is asked to
/// rest until the input `acknowledge` rises (acknowledgement.h). Commands then begin at the robot's own target position.
/// Inputs that are not finite, and positions beyond rtde::kLargestNumber, are not sent: their last usable values are (`refused`).
class RtdeLink final : public Link {
 public:
  RtdeLink(Settings& settings, const std::vector<trajectory::Axis>& joints);

  void declare(Variables& v, JointVariables& joints) override;
  void initialise(Time start, Measured& measured) override;
  StepResult step(Time now, Duration h, const Command& command, Measured& measured) override;
  bool restorable() const override { return false; }
  TickSource* tick_source() override { return &line_; }
  Needs needs() const override;
  void append_notes(std::vector<std::string>& sentences) const override;

 private:
  static constexpr std::size_t kRegisters = 24;  // for clients of RTDE

  void choose_mode();
  double patience() const;
  rtde::ClientSettings client_settings() const;
  bool read_all(Time now, Measured& measured);
  bool waits(double t, std::int64_t host, Time now);
  bool is_believed(double t, std::int64_t host);
  void measure(Measured& measured, Time now);
  void read_others(Measured& measured);
  void read_forces();
  void forget();
  void count_reflected();
  bool read_registers();
  double used(std::string_view name, std::size_t i = 0) const;
  void send(const Command& command, Measured& measured);
  void follow();
  bool requests() const;
  void demand_acknowledgement() {
    if (commands_) acknowledgement_.demand();
  }
  void note_loss(Measured& measured);
  void write_outputs();
  bool robot_ready() const { return is_ready(robot_mode_, safety_, runtime_); }
  bool is_ready(int robot_mode, int safety, int runtime) const;
  bool robot_follows() const;
  bool agrees() const { return speeds_.holds() && set_point_.moves_alike(); }

  std::size_t n_;
  RtdeLine line_;
  Synchronisation synchronisation_;
  GainCheck gains_{33};  // 1/s: the lookahead time of the program on the robot
  Acknowledgement acknowledgement_;
  Belief belief_;
  BelievedTorques tau_, F_;  // the force by its joint torques
  Agreement speeds_;
  BelievedSetPoint set_point_;
  BelievedNumbers numbers_;                    // of RTDE, by slots
  std::vector<std::size_t> slots_;             // of those that come
  ConfirmedState follows_;                     // the robot, the commands
  std::optional<RobotKinematics> kinematics_;  // if the robot's URDF is given
  bool commands_ = false;                      // mode=position
  // Inputs.
  std::int32_t digital_command_ = 0;
  std::array<double, kRegisters> double_command_{};
  std::array<std::int32_t, kRegisters> int_command_{};
  // Parameters.
  std::string controller_ = "127.0.0.1", mode_ = "monitor";
  double frequency_ = 500, timeout_ = 0.1, wait_ = 0, ddq_cutoff_ = 50, ddq_command_max_ = kSafeAcceleration;
  std::int32_t digital_mask_ = 0;
  bool registers_ = false;
  std::vector<double> dq_command_max_, torque_per_current_;
  // Tunables.
  bool command_ = true, tau_e_gated_ = false;
  std::vector<double> K_P_, K_D_;
  // Outputs.
  bool connected_ = false, commanding_ = false;
  std::int32_t state_ = 0, robot_mode_ = 0, safety_ = 0, runtime_ = 0, digital_in_ = 0, digital_out_ = 0;
  double t_robot_ = 0, speed_scaling_ = 0;
  std::vector<double> q_robot_, q_sent_, e_, current_;
  std::array<double, 6> F_e_{};
  std::array<double, 3> p_{};
  std::array<double, 4> quat_{1, 0, 0, 0};
  std::array<double, kRegisters> double_value_{};
  std::array<std::int32_t, kRegisters> int_value_{};
  std::array<std::int32_t, 4> version_{};
  std::int32_t received_ = 0, skipped_ = 0, rejected_ = 0, sent_ = 0, unsent_ = 0, refused_ = 0, losses_ = 0, connections_ = 0;
  double jitter_ = 0, round_trip_ = 0;
  // Of the session.
  bool has_torque_ = false, following_ = false, was_connected_ = false, waiting_ = false;
  std::uint64_t set_ups_ = 0;     // of the connection
  double t_sent_ = -1;            // s, robot's time of the last command that was sent; −1: none
  double t_commanded_ = -1;       // s, robot's time when the last command was chosen; −1: none
  double elapsed_ = 0;            // s, robot's time between the last two packages
  double since_used_ = 0;         // s, robot's time since the last one that was used
  double period_ = 0;             // s, between two commands: a package, or a step if that is longer
  std::vector<double> q_wanted_;  // the last usable q_command
  bool has_wanted_ = false;
  std::array<double, kRegisters> registers_sent_{};  // the last finite values of double_command
  std::array<std::int32_t, kRegisters> registers_int_sent_{};
  double t_offered_ = 0;      // s, robot's time of the last package with a possible one
  double t_waiting_ = -1;     // s, robot's time of the last package, if it waits for the next one; −1: it does not
  std::int64_t heard_ = 0;    // ns, scenario time of the last package that was used
  std::int64_t arrived_ = 0;  // ns, host
  std::int32_t counter_ = 0, reflected_ = 0;
  std::array<std::int64_t, 256> sent_at_{};  // ns, host, by counter
  std::int64_t trips_ = 0;
  std::vector<double> q_target_;  // rad, target_q that is believed
  int misfits_ = 0;               // poses in a row that do not fit to the URDF
  double lost_time_ = 0;          // s
};

}  // namespace cotwin::io
