#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "components/io/datagram_queue.h"
#include "components/io/fri/controller.h"
#include "components/io/fri_values.h"
#include "components/io/link.h"
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
  void tell(std::vector<std::string>& sentences) const override;

 private:
  struct Kinematics;  // of the robot, if its URDF is given

  /// The answers, also as ticks. A robot whose ticks begin with answers has to send first: a message one period before the start,
  /// and again until the client answers for the first time. While the session is closed, it does not wait.
  class Datagrams final : public DatagramQueue {
   public:
    explicit Datagrams(FriControllerLink& link) : link_(link) {}
    std::optional<Arrival> wait(std::int64_t deadline) override;

   private:
    FriControllerLink& link_;
  };

  fri::ControllerSettings controller_settings() const;
  std::optional<DatagramQueue::Stamp> stamp(std::span<const std::uint8_t> bytes);
  void send_first();
  void take_measurements(std::int64_t now);
  void open_or_close(std::int64_t now);
  void request(double h);
  void write_outputs(std::int64_t now);

  fri::Protocol protocol_;
  std::size_t n_;
  Datagrams datagrams_{*this};
  fri::Command seen_;                // by the clock
  std::vector<std::uint8_t> first_;  // message
  std::optional<fri::Controller> controller_;
  std::unique_ptr<Kinematics> kinematics_;
  // Inputs.
  std::vector<double> q_, tau_, tau_e_, q_d_;
  KrlPorts krl_;
  IoPorts reads_;
  // Parameters.
  std::string address_, client_, client_mode_ = "position", control_ = "position";
  std::int32_t port_, receive_multiplier_ = 1, window_ = 100, max_lost_ = 10;
  double period_ = 0.005, excellent_ = 0.99, good_ = 0.95, fair_ = 0.75, excellent_latency_ = 0.5, stop_time_ = 0.2;
  double safety_factor_ = 1, restart_ = 0;
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
  // Of the session.
  std::vector<double> q_own_;
  std::int64_t host_ = 0, at_ = 0;  // ns: of the last step on the monotonic clock and in the scenario
  double since_drop_ = 0;           // s
  bool opened_ = false, answered_ = false, stepped_ = false;
  std::uint64_t commands_ = 0;    // of the client so far
  std::int64_t answered_at_ = 0;  // ns, scenario time of the last one
};

}  // namespace cotwin::io
