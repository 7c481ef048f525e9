#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "components/io/datagram_queue.h"
#include "components/io/fri/client.h"
#include "components/io/fri_values.h"
#include "components/io/link.h"
#include "components/io/synchronisation.h"
#include "components/unit/settings.h"
#include "models/trajectory/axes.h"

namespace cotwin::io {

/// A robot behind KUKA's FRI (LWR 4+ or Sunrise): the PC's side. A step takes the messages that have come, answers each, and gives
/// the newest measurements:
///   q, τ, τ_e   as reported
///   q̇          differences of q between messages over their send period, low-pass `dq_cutoff`;  q̈: differences of q̇
///   command     monitoring: mirrors what the robot commands; commanding: q_command with the PD synchronisation
///               (synchronisation.h), and by `mode` an overlaid torque or wrench, stiffness and damping
/// A robot that sends nothing for `timeout` is not connected: q and τ are held, q̇, q̈ and τ_e are 0, nothing is sent. When it is
/// back, commands begin at its own commanded position.
class FriLink final : public Link {
 public:
  FriLink(Settings& settings, std::vector<trajectory::Axis> joints);

  void declare(Variables& v, JointVariables& joints) override;
  void initialise(Time start, Measured& measured) override;
  StepResult step(Time now, Duration h, const Command& command, Measured& measured) override;
  bool restorable() const override { return false; }
  TickSource* tick_source() override { return &datagrams_; }
  void tell(std::vector<std::string>& sentences) const override;

 private:
  enum class Mode : std::uint8_t { kMonitor, kPosition, kTorque, kWrench, kJointImpedance, kCartesianImpedance };

  fri::ClientSettings client_settings() const;
  void open();
  std::optional<DatagramQueue::Stamp> stamp(std::span<const std::uint8_t> bytes);
  bool take(const DatagramQueue::Datagram& datagram, std::int64_t arrival, std::int64_t now, const Command& command);
  void choose_command(const Command& command);
  void follow(const Command& command, double elapsed);
  void measure(Measured& measured);
  void note_loss(Measured& measured);
  void write_outputs(std::int64_t now);

  fri::Protocol protocol_;
  std::size_t n_;
  Mode mode_ = Mode::kPosition;
  DatagramQueue datagrams_;
  std::optional<fri::Client> client_;
  Synchronisation synchronisation_;
  fri::Command wanted_;
  fri::Monitoring seen_;  // by the clock
  // Parameters.
  std::string address_ = "0.0.0.0", controller_, mode_text_ = "position";
  std::int32_t port_;
  double timeout_ = 0.1, wait_ = 0, dq_cutoff_ = 50, v_command_max_ = 0.25, w_command_max_ = 1;
  std::vector<double> dq_command_max_;
  // Inputs.
  std::array<double, 6> F_command_{};
  std::array<double, 3> p_command_{};
  std::array<double, 4> quat_command_{1, 0, 0, 0};
  KrlPorts krl_command_;
  IoPorts writes_;
  // Tunables.
  bool command_ = true, tau_e_gated_ = false;
  std::vector<double> K_P_, K_D_, stiffness_, damping_;
  std::array<double, 6> cartesian_stiffness_{}, cartesian_damping_{};
  // Outputs.
  bool connected_ = false, commanding_ = false;
  std::int32_t state_ = 0, quality_ = 0, command_mode_ = 0;
  double t_robot_ = 0, period_ = 0;
  std::vector<double> q_robot_, q_own_, q_sent_, e_;
  std::array<double, 6> F_e_{};
  std::array<double, 3> p_{};
  std::array<double, 4> quat_{1, 0, 0, 0};
  KrlPorts krl_;
  IoPorts reads_;
  ClientCounts counts_;
  std::int32_t losses_ = 0;  // of the connection
  double lost_time_ = 0;
  // Of the session.
  std::int64_t host_ = 0, at_ = 0;  // ns: of the last step on the monotonic clock and in the scenario
  std::int64_t position_ = -1;      // in the stream, of the message measured last; −1: none
  std::int64_t answered_ = -1;      // of the message answered last; −1: none
  bool following_ = false;          // q_command is followed; else the robot's own position is mirrored
  bool was_connected_ = false;
  bool waiting_ = false;  // for the first message, in the initialisation
};

}  // namespace cotwin::io
