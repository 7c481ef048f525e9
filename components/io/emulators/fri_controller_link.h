#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "components/io/emulators/kuka/controller.h"
#include "components/io/link/datagram_queue.h"
#include "components/io/link/fri_values.h"
#include "components/io/link/link.h"
#include "components/io/link/robot_kinematics.h"
#include "components/unit/settings.h"
#include "models/trajectory/axes.h"

namespace cotwin::io {

/// The controller of an emulated KUKA robot, for clients of FRI (fri/controller.h). The ports are the other way round: what the
/// robot behind it measures comes in, what the client commands goes out.
///   q_command   own motion + what the client adds; between commands interpolated, lost ones extrapolated; the robot's drives
///               follow it
///   own motion  rest where the robot is at the start, or q_d
/// A step at t receives the answers that have come, sends the message that is due at t, and gives the set point at t + h.
class FriControllerLink final : public Link {
 public:
  FriControllerLink(Settings& settings, std::vector<trajectory::Axis> joints);
  ~FriControllerLink() override;

  void declare(Variables& v, JointVariables& joints) override;
  void initialise(Time start, Measured& measured) override;
  StepResult step(Time now, Duration h, const Command& command, Measured& measured) override;
  bool restorable() const override { return false; }
  bool is_robot() const override { return true; }
  TickSource* tick_source() override { return &datagrams_; }
  void append_notes(std::vector<std::string>& sentences) const override;

 private:
  static constexpr double kNoLimit = 1e9;    // rad, N.m
  static constexpr double kMostSpeed = 1e3;  // rad/s

  /// The answers, also as ticks. A robot whose ticks begin with answers has to send first: a message one period before the start.
  /// After 20 ms without an answer the last message is sent again, with the same counter, because it or its answer may be lost
  /// and both sides wait for each other. While the session is closed, it does not wait.
  class Datagrams final : public DatagramQueue {
   public:
    explicit Datagrams(FriControllerLink& link) : link_(link) {}
    std::optional<Arrival> wait(std::int64_t deadline) override;
    void set_waits(bool waits) override;

   private:
    std::optional<Arrival> wait_closed(std::int64_t deadline);

    FriControllerLink& link_;
    bool waits_ = false;  // ticks wait without a limit
  };

  fri::ControllerSettings controller_settings();
  std::uint16_t local_port(const net::Endpoint& local) const;
  fri::ControlMode control_of(fri::ClientCommandMode mode) const;
  void request_transformations();
  std::optional<DatagramQueue::Stamp> stamp(std::span<const std::uint8_t> bytes);
  void receive(const DatagramQueue::Datagram& datagram, std::int64_t now);
  void send(std::span<const std::uint8_t> message);
  void send_again();
  void warn(const char* sentence);
  std::string what_was_rejected() const;
  void read_measurements(std::int64_t now);
  void open_or_close(std::int64_t now);
  void request(double h);
  void write_outputs(std::int64_t now);

  fri::Protocol protocol_;
  std::size_t n_;
  Datagrams datagrams_{*this};
  fri::Command seen_;  // by the clock
  std::optional<fri::Controller> controller_;
  std::optional<RobotKinematics> kinematics_;  // if the robot's URDF is given
  // Inputs.
  std::vector<double> q_, tau_, tau_e_, q_d_;
  KrlPorts krl_;
  IoPorts reads_;
  // Parameters.
  std::string address_, client_, client_mode_ = "position", control_, transformations_;
  std::int32_t port_ = -1, receive_multiplier_ = 1, window_ = 100, max_lost_ = 10;
  double period_ = 0.005, excellent_ = 0.99, good_ = 0.95, fair_ = 0.75, excellent_latency_ = 0.5, stop_time_ = 0.2;
  double safety_factor_ = 1, restart_ = 0, ddq_max_ = 50;
  double force_max_ = 1e9, moment_max_ = 1e9, stiffness_max_ = 5000, translational_stiffness_max_ = 5000,
         rotational_stiffness_max_ = 300, v_command_max_ = 2, w_command_max_ = 4;
  double start_time_ = 1.7e9, spacing_ = 0;  // s
  bool hold_ = true;
  std::vector<double> q_min_, q_max_, dq_max_, tau_command_max_;
  // Tunables.
  bool request_ = true, ready_ = true, open_ = true;
  std::vector<double> stiffness_, damping_;
  // Outputs.
  std::vector<double> q_command_, dq_command_, tau_command_, stiffness_command_, damping_command_;
  std::array<double, 6> F_command_{};
  bool active_ = false, connected_ = false;
  std::int32_t state_ = 0, quality_ = 0, drop_ = 0, drops_ = 0;
  KrlPorts krl_client_;
  IoPorts writes_;
  ControllerCounts counts_;
  std::int32_t unsent_ = 0, unmatched_ = 0, displaced_ = 0, last_fault_ = 0;
  double latency_median_ = 0, latency_99_ = 0, latency_max_ = 0;
  std::string warning_;
  // Of the session.
  std::vector<double> q_own_, q_total_;  // rad: own motion, and with the distance that a stop has left
  std::vector<double> tau_F_;            // N.m, of F_command
  std::vector<std::uint8_t> rejected_;   // the last datagram of the client that was no command
  std::int64_t sent_at_ = 0;             // ns, CLOCK_MONOTONIC
  std::int64_t closed_at_ = 0;           // ns, CLOCK_MONOTONIC: of the last period without a session
  std::uint64_t latencies_ = 0;          // in the outputs
  std::int64_t epoch_ = 0;               // ns since 1970 (LWR: 0) at scenario time 0
  bool stepped_ = false;
  std::int64_t host_ = 0, at_ = 0;  // ns: of the last step on the monotonic clock and in the scenario
  std::int64_t next_at_ = 0;        // ns: of the next step in the scenario
  double since_drop_ = 0;           // s
  std::int64_t opened_at_ = 0;      // ns, scenario time
  bool opened_ = false, waited_ = false;
  std::uint64_t commands_ = 0;    // of the client so far
  std::int64_t answered_at_ = 0;  // ns, scenario time of the last one
};

}  // namespace cotwin::io
