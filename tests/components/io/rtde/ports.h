#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>

#include "components/io/emulators/ur/controller.h"
#include "components/unit/unit_table.h"
#include "models/foundation/net/tcp_socket.h"
#include "tests/support/places.h"

namespace cotwin::io {

inline constexpr std::int64_t kPatience = 20'000'000'000;  // ns

/// A unit of `io` by its ports.
struct Ports {
  Instance instance;

  explicit Ports(const std::string& query)
      : instance(make_unit("unit:io?" + query, {}, {std::filesystem::path(places::source()) / "models"}, unit_types())) {}
  void set(const std::string& name, const std::string& value) { assign_text(instance.variables.at(name), value); }
  std::span<double> reals(const std::string& name) { return instance.variables.at(name).reals(); }
  double real(const std::string& name, std::size_t i = 0) { return reals(name)[i]; }
  int integer(const std::string& name, std::size_t i = 0) { return instance.variables.at(name).integers()[i]; }
  bool boolean(const std::string& name) { return instance.variables.at(name).booleans()[0]; }
  std::string text(const std::string& name) { return instance.variables.at(name).strings()[0]; }
};

/// A controller over TCP on 127.0.0.1 whose quantities the test writes, with a robot that stays where it is.
struct PlainRobot {
  rtde::Controller controller{rtde::ControllerSettings{}};
  net::TcpListener listener{{0x7f000001, 0}, "test"};
  std::array<net::TcpStream, rtde::Controller::kClients> streams;
  std::array<double, 6> q{1, -1.4, 1.5, -1.6, -1.5, 0.3};
  double target_off = 0;  // rad, of the set point of the third joint
  double t = 0;           // s
  int accepted = 0;
  bool reads = true;
  std::function<void(rtde::Controller&)> damage;  // of the next packages

  PlainRobot() { say(1); }
  std::string address() const { return "127.0.0.1:" + std::to_string(listener.local().port); }
  /// That the robot is ready and its program in this state.
  void say(int state, int runtime = 2) {
    controller.at("robot_mode") = 7;
    controller.at("safety_mode") = 1;
    controller.at("runtime_state") = runtime;
    controller.at("output_int_register_25") = state;
  }
  void exchange() {
    while (auto stream = listener.accept()) {
      ++accepted;
      if (const int client = controller.connect(); client >= 0) {
        streams[static_cast<std::size_t>(client)] = std::move(*stream);
      }
    }
    for (std::size_t i = 0; i < streams.size(); ++i) {
      if (!controller.connected(i)) continue;
      for (std::size_t size = 1; reads && size > 0; controller.sent(i, streams[i].send(controller.waiting(i)))) {
        controller.received(i, size = streams[i].receive(controller.space(i)));
      }
      controller.sent(i, streams[i].send(controller.waiting(i)));
      if (streams[i].state() == net::TcpStream::State::kClosed) controller.disconnect(i);
    }
  }
  void hang_up() {
    for (std::size_t i = 0; i < streams.size(); ++i) {
      if (controller.connected(i)) controller.disconnect(i);
      streams[i].close();
    }
  }
  void cycle() {
    controller.at("timestamp") = t += 0.002;
    for (std::size_t i = 0; i < q.size(); ++i) controller.at("actual_q", i) = controller.at("target_q", i) = q[i];
    controller.at("target_q", 2) += target_off;
    controller.at("output_int_register_24") = controller.at("input_int_register_24");
    if (damage) damage(controller);
    controller.cycle();
    exchange();
  }
};

}  // namespace cotwin::io
