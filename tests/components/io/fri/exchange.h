#pragma once
#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "components/io/emulators/kuka/controller.h"
#include "components/io/fri/client.h"
#include "tests/components/io/fri/messages.h"

namespace cotwin::testing {

/// What happens to the datagrams of one direction.
struct Disturbance {
  double loss = 0, duplicates = 0;  // shares of the datagrams
  std::int64_t delay = 100'000;     // ns
  std::int64_t jitter = 0;          // ns: uniform, added to the delay; reorders if it exceeds the distance of datagrams
};

/// A client and a controller with a network between them, in simulated time.
class Exchange {
 public:
  struct Counts {
    std::uint64_t sent = 0, lost = 0, doubled = 0;
  };

  Exchange(const fri::ControllerSettings& controller_settings, const fri::ClientSettings& client_settings,
           std::uint32_t seed = 1)
      : controller(controller_settings, "controller"), client(client_settings, "client"), random_(seed) {
    fri::Monitoring& robot = controller.robot();
    robot.fields |= fri::Monitoring::kMeasuredPosition | fri::Monitoring::kMeasuredTorque | fri::Monitoring::kDriveStates |
                    fri::Monitoring::kSafetyState | fri::Monitoring::kTime;
    robot.time = 1'700'000'000'000'000'000;
    wanted.fields = fri::Command::kPosition;
    wanted.joints = robot.joints;
    flights_.reserve(64);
    controller.open(0);
  }

  /// Up to `end` (ns), in steps of 50 µs. The robot's joints follow their set points without error.
  void run(std::int64_t end) {
    for (; now < end; now += kStep) {
      deliver();
      if (program) program(static_cast<double>(now) * 1e-9, controller.robot().q_interpolator);
      if (controller.next() <= now) {
        controller.robot().q_measured = controller.setpoint(now).q;
        send(controller.cycle(now), true, now);
      }
      if (observe) observe();
    }
  }
  void run_seconds(double seconds) { run(now + static_cast<std::int64_t>(std::llround(seconds * 1e9))); }

  /// Delivers what is under way; nothing more is sent.
  void drain() {
    silent_ = true;
    for (const std::int64_t end = now + 1'000'000'000; now < end; now += kStep) deliver();
    silent_ = false;
  }

  static constexpr std::int64_t kStep = 50'000;  // ns
  const net::Endpoint controller_endpoint{0x7f000002, 30200}, client_endpoint{0x7f000001, 30200};
  fri::Controller controller;
  fri::Client client;
  fri::Command wanted;
  Disturbance to_client, to_controller;
  Counts monitoring, commands;
  std::int64_t now = 0;
  std::function<void(double, fri::Joints&)> program;  // the robot's own motion at a time in s
  std::function<void()> want;                         // sets `wanted` before an answer
  std::function<void()> observe;                      // after each step

 private:
  struct Flight {
    std::int64_t arrival;
    bool to_client;
    std::size_t size;
    std::array<std::uint8_t, fri::kMaxDatagram> bytes;
  };

  bool happens(double share) { return std::uniform_real_distribution(0.0, 1.0)(random_) < share; }

  void send(std::span<const std::uint8_t> bytes, bool to_the_client, std::int64_t time) {
    if (bytes.empty() || silent_) return;
    const Disturbance& d = to_the_client ? to_client : to_controller;
    Counts& counts = to_the_client ? monitoring : commands;
    ++counts.sent;
    if (happens(d.loss)) {
      ++counts.lost;
      return;
    }
    const bool twice = happens(d.duplicates);
    counts.doubled += twice ? 1 : 0;
    for (int i = 0; i < (twice ? 2 : 1); ++i) {
      const std::int64_t jitter = d.jitter == 0 ? 0 : std::uniform_int_distribution<std::int64_t>(0, d.jitter)(random_);
      Flight flight{time + d.delay + jitter, to_the_client, bytes.size(), {}};
      std::copy(bytes.begin(), bytes.end(), flight.bytes.begin());
      const auto place = std::upper_bound(flights_.begin(), flights_.end(), flight.arrival,
                                          [](std::int64_t t, const Flight& f) { return t < f.arrival; });
      flights_.insert(place, flight);
    }
  }

  void deliver() {
    while (!flights_.empty() && flights_.front().arrival <= now) {
      const Flight flight = flights_.front();
      flights_.erase(flights_.begin());
      const std::span<const std::uint8_t> bytes(flight.bytes.data(), flight.size);
      if (!flight.to_client) {
        last_fault = controller.receive(bytes, client_endpoint, flight.arrival);
      } else if (client.receive(bytes, controller_endpoint, flight.arrival) == fri::Client::Reception::kAnswerDue && !silent_) {
        if (want) want();
        send(client.answer(wanted, flight.arrival), false, flight.arrival);
      }
    }
  }

 public:
  fri::Fault last_fault = fri::Fault::kNone;

 private:
  std::mt19937 random_;
  std::vector<Flight> flights_;
  bool silent_ = false;
};

/// A controller of 7 joints at 1 kHz with limits like those of an LBR.
inline fri::ControllerSettings controller_settings(fri::Protocol protocol, std::int64_t send_period = 1'000'000) {
  fri::ControllerSettings s;
  s.protocol = protocol;
  s.joints = 7;
  s.send_period = send_period;
  s.speed_limit.assign(7, 2.0);
  s.lower.assign(7, -2.9);
  s.upper.assign(7, 2.9);
  s.torque_limit.assign(7, 50.0);
  return s;
}

inline fri::ClientSettings client_settings(fri::Protocol protocol) {
  fri::ClientSettings s;
  s.protocol = protocol;
  s.joints = 7;
  return s;
}

}  // namespace cotwin::testing
