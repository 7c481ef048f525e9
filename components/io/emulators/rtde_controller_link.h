#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "components/io/emulators/ur/controller.h"
#include "components/io/emulators/ur/follower.h"
#include "components/io/link/link.h"
#include "components/io/link/robot_kinematics.h"
#include "components/unit/settings.h"
#include "models/foundation/net/tcp_socket.h"
#include "models/trajectory/axes.h"

namespace cotwin::io {

/// The controller of an emulated Universal Robots arm, for clients of RTDE (rtde/controller.h), with a program on it that follows
/// registers (rtde/follower.h). The ports are the other way round: what the robot behind it measures comes in, set points for its drives
/// go out. Control cycles are at the multiples of 1/frequency since the start; a step does those that are due before its end, and gives
/// the set point between two of them by linear interpolation.
class RtdeControllerLink final : public Link {
 public:
  RtdeControllerLink(Settings& settings, const std::vector<trajectory::Axis>& joints);

  void declare(Variables& v, JointVariables& joints) override;
  void initialise(Time start, Measured& measured) override;
  StepResult step(Time now, Duration h, const Command& command, Measured& measured) override;
  bool restorable() const override { return false; }
  bool is_robot() const override { return true; }
  void append_notes(std::vector<std::string>& sentences) const override;

 private:
  static constexpr std::size_t kRegisters = 48;

  void receive();
  void flush(std::size_t client);
  void drop(std::size_t client);
  void measure();
  void cycle(Time at);
  void write_outputs(Time at);
  void set(std::string_view name, std::span<const double> values);
  void check_start() const;
  std::array<double, 6> tcp_speed(std::span<const double> q, std::span<const double> dq);
  bool is_cb3() const { return frequency_ < 200; }

  std::optional<net::TcpListener> listener_;
  std::string listens_at_;
  std::array<net::TcpStream, rtde::Controller::kClients> streams_;
  std::optional<rtde::Controller> controller_;
  std::optional<rtde::Follower> follower_;
  std::optional<RobotKinematics> kinematics_;  // if the robot's URDF is given
  // Inputs.
  std::vector<double> q_, dq_, tau_, tau_e_, q_d_;
  std::int32_t digital_in_ = 0;
  std::array<double, 2> analog_in_{};
  std::array<double, kRegisters> double_out_{};
  std::array<std::int32_t, kRegisters> int_out_{};
  // Parameters.
  std::string address_ = "127.0.0.1";
  std::int32_t port_ = rtde::kPort;
  double frequency_ = 500, acceleration_ = 40, lookahead_ = 0.03, loss_time_ = 0.1, stop_time_ = 0.2, near_ = 0.1;
  std::vector<double> q_min_, q_max_, dq_max_, torque_per_current_;
  std::array<double, 6> tcp_offset_{};
  bool hold_ = true;
  // Tunables.
  bool ready_ = true, program_ = true;
  // Outputs.
  std::vector<double> q_command_, dq_command_;
  bool active_ = false;
  std::int32_t state_ = 0, losses_ = 0, clients_ = 0, listening_port_ = 0, digital_out_ = 0;
  double speed_fraction_ = 1;
  std::array<double, 2> analog_out_{};
  std::array<double, kRegisters> double_in_{};
  std::array<std::int32_t, kRegisters> int_in_{};
  std::int32_t sent_ = 0, dropped_ = 0, received_ = 0, rejected_ = 0, faults_ = 0, refused_ = 0;
  // Of the session.
  Time start_;
  std::int64_t cycles_ = 0;
  rtde::Joints before_{};  // set point before the last cycle
};

}  // namespace cotwin::io
