#pragma once
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "components/io/fri/fri.h"
#include "models/foundation/net/udp_socket.h"
#include "tests/components/io/ports.h"

/// A twin's side of FRI beside a controller whose messages are made by the test.
namespace cotwin::io {

using fri::Protocol;
using fri::SessionState;
using M = fri::Monitoring;

inline constexpr double kSpeed = 0.5;                                  // rad/s, the default limit of commanded positions
inline constexpr std::array kQ{0.1, 0.3, -0.2, -1.2, 0.4, 0.9, 0.05};  // rad, where the robot is

inline constexpr std::array kProtocols{Protocol::kLwr, Protocol::kSunrise1_11, Protocol::kSunrise1_15, Protocol::kSunrise2_5,
                                       Protocol::kSunrise2_7};

/// Of a test for one of them.
inline std::string name_of_protocol(const ::testing::TestParamInfo<Protocol>& protocol) {
  std::string name = fri::to_text(protocol.param);
  std::erase_if(name, [](char c) { return c == '-' || c == '.'; });
  return name;
}

/// The twin and a robot at rest whose messages come each 2 ms.
struct Rig {
  explicit Rig(Protocol p, const std::string& mode = "position")
      : protocol(p),
        twin(std::string("robot=lwr4&link=fri&protocol=") + fri::to_text(p)),
        robot(net::Endpoint{0x7f000001, 0}, "test") {
    twin.set("address", "127.0.0.1");
    twin.set("port", "0");
    twin.set("mode", mode);
    twin.set("dq_cutoff", "0");
    std::ranges::copy(kQ, twin.reals("q_command").begin());
    m.joints = 7;
    m.fields = M::kMeasuredPosition | M::kMeasuredTorque | M::kExternalTorque | M::kTime | M::kDriveStates | M::kSafetyState |
               M::kControlMode | M::kOperationMode;
    m.quality = fri::Quality::kExcellent;
    m.send_period = 0.002;
    m.state = SessionState::kMonitoringReady;
    m.command_mode = fri::ClientCommandMode::kPosition;
    m.time = 1'000'000'000'000;
    put(kQ);
  }

  /// Measured and commanded position of the robot.
  void put(const std::array<double, 7>& q) {
    std::ranges::copy(q, m.q_measured.begin());
    std::ranges::copy(q, m.q_commanded.begin());
    std::ranges::copy(q, m.q_interpolator.begin());
  }
  void start() { twin.instance.unit->initialise(Time{}); }

  std::vector<std::uint8_t> message() {
    if (protocol < Protocol::kSunrise2_5) m.fields |= M::kCommandedPosition;
    const bool commanding = fri::is_commanding(m.state);
    m.fields &= ~std::uint32_t{M::kInterpolatorPosition | M::kCommandMode | M::kOverlay | M::kTracking};
    if (commanding) m.fields |= M::kInterpolatorPosition | M::kCommandMode;
    m.fields |= extra;
    m.fields &= ~std::uint32_t{without};
    std::vector<std::uint8_t> bytes(fri::kMaxDatagram);
    bytes.resize(fri::encode(protocol, m, bytes));
    if (damage) damage(bytes);
    ++m.counter;
    if (std::abs(m.send_period) < 1e6) m.time += static_cast<std::int64_t>(m.send_period * 1e9);  // not of a damaged one
    return bytes;
  }
  void send(std::span<const std::uint8_t> bytes) { robot.send(bytes, twin.datagrams().local()); }

  /// A step of the twin, before which the robot's message comes or not. True if there was an answer, which is then in `command`.
  bool period(bool comes = true) {
    const auto bytes = message();
    if (comes) send(bytes);
    return step(comes ? 1 : 0);
  }
  bool step(std::size_t datagrams) {
    EXPECT_TRUE(twin.has(datagrams));
    const int answers = twin.integer("answers");
    EXPECT_EQ(twin.instance.unit->step(Time{n * h.ns}, h), StepResult::kDone);
    ++n;
    for (const char* name : {"q", "dq", "ddq", "tau", "tau_e", "q_robot", "q_own", "q_sent", "e", "F_e", "p", "quat", "t_robot",
                             "period", "jitter", "round_trip"}) {
      for (const double value : twin.reals(name)) EXPECT_TRUE(std::isfinite(value)) << name;
    }
    bool answered = false;
    for (int k = answers; k < twin.integer("answers"); ++k) answered = read_command() || answered;
    return answered;
  }
  bool read_command() {
    std::vector<std::uint8_t> bytes(2048);
    const std::int64_t deadline = monotonic_now() + kPatience;
    while (monotonic_now() < deadline) {
      const auto received = robot.receive(bytes);
      if (!received) continue;
      const fri::Fault fault = fri::decode(protocol, std::span(bytes).first(received->size), 7, command);
      EXPECT_EQ(fault, fri::Fault::kNone);
      return fault == fri::Fault::kNone;
    }
    ADD_FAILURE() << "no command came";
    return false;
  }
  /// Until the robot takes commands.
  void begin() {
    start();
    for (int k = 0; k < 3; ++k) period();
    m.state = SessionState::kCommandingWait;
    if (protocol != Protocol::kLwr) period();
    m.state = SessionState::kCommandingActive;
    for (int k = 0; k < 60 && !twin.boolean("commanding"); ++k) period();
    ASSERT_TRUE(twin.boolean("commanding"));
  }
  /// Until the soft start is over.
  void settle() {
    for (int k = 0; k < 260; ++k) period();
  }
  /// `acknowledge` is off, and then on for the least time that counts, which ends with the last period.
  void acknowledge() {
    twin.set("acknowledge", "false");
    for (int k = 0; k < 3; ++k) period();
    twin.set("acknowledge", "true");
    for (int k = 0; k < 25; ++k) period();
  }
  /// rad, of the numbers on the wire.
  double rounding() const { return protocol == Protocol::kLwr ? 3e-7 : 1e-12; }

  Protocol protocol;
  Ports twin;
  net::UdpSocket robot;
  M m;
  fri::Command command;
  std::function<void(std::vector<std::uint8_t>&)> damage;  // of the next messages
  std::uint32_t extra = 0, without = 0;                    // fields of the messages
  Duration h{2'000'000};
  std::int64_t n = 0;
};

}  // namespace cotwin::io
