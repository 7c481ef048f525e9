// Datagrams of FRI with any contents. The first byte chooses the protocol, what is read, and the number of joints:
//   decoders   a message that was read is written and read again with the same result
//   sessions   pieces of the rest, each after its length, reach a client and a controller between good datagrams; the set point
//              stays finite and within the limits of position and speed
//   twins      such pieces, each after its length in two bytes, reach the unit of a twin (link=fri) between good messages; its outputs stay finite, and so does what
//              it sends
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <span>
#include <string>

#include "components/io/emulators/kuka/controller.h"
#include "components/io/fri/client.h"
#include "components/io/link/datagram_queue.h"
#include "components/unit/unit_table.h"
#include "models/foundation/net/udp_socket.h"

namespace {

using namespace cotwin::fri;
using Bytes = std::span<const std::uint8_t>;
constexpr cotwin::net::Endpoint kController{1, 1}, kClient{2, 2};
constexpr std::int64_t kPeriod = 1'000'000;  // ns

void require(bool condition) {
  if (!condition) std::abort();
}

template <class Message>
void read(Protocol protocol, std::size_t joints, Bytes bytes) {
  static Message message, again;
  if (decode(protocol, bytes, joints, message) != Fault::kNone) return;
  require(message.joints == joints && message.transformations.count <= kMaxTransformations && message.ios.count <= kMaxIos);
  std::array<std::uint8_t, kMaxDatagram> written;
  const std::size_t size = encode(protocol, message, written);
  if (size == 0) return;  // packed numbers, which are not written so, may have made it too long
  require(decode(protocol, std::span(written).first(size), joints, again) == Fault::kNone);
  require(again.fields == message.fields && again.counter == message.counter && again.ios.count == message.ios.count);
}

void run_sessions(Protocol protocol, Bytes pieces) {
  ControllerSettings settings;
  settings.protocol = protocol;
  settings.send_period = kPeriod;
  settings.speed_limit.assign(7, 2.0);
  settings.lower.assign(7, -1.0);
  settings.upper.assign(7, 1.0);
  settings.rating.window = 8;
  settings.enter = settings.hold = Quality::kPoor;
  Controller controller(settings, "controller");
  ClientSettings client_settings;
  client_settings.protocol = protocol;
  Client client(client_settings, "client");
  Command wanted;
  wanted.fields = Command::kPosition;
  controller.robot().fields |= Monitoring::kMeasuredPosition;
  controller.open(0);
  Joints before{};
  for (std::int64_t k = 0; k < 60; ++k) {
    const std::int64_t now = k * kPeriod;
    controller.request(k % 40 > 12);
    if (client.receive(controller.cycle(now), kController, now) == Client::Reception::kAnswerDue) {
      controller.receive(client.answer(wanted, now), kClient, now);
    }
    if (!pieces.empty()) {
      const std::size_t size = std::min<std::size_t>(pieces[0] * 4u, pieces.size() - 1);
      const Bytes piece = pieces.subspan(1, size);
      if (k % 2 == 0) {
        controller.receive(piece, kClient, now + 1000);
      } else if (client.receive(piece, kController, now + 1000) == Client::Reception::kAnswerDue) {
        controller.receive(client.answer(wanted, now + 2000), kClient, now + 2000);
      }
      pieces = pieces.subspan(1 + size);
    }
    const Setpoint& s = controller.setpoint(now + 1500);
    for (std::size_t i = 0; i < 7; ++i) {
      require(std::isfinite(s.q[i]) && std::abs(s.q[i]) <= 1.0 && std::isfinite(s.tau[i]));
      require(std::abs(s.q[i] - before[i]) <= 2.0 * 1e-9 * kPeriod + 1e-9);
    }
    before = s.q;
  }
}

/// The unit, made once per protocol: the socket stays.
struct Twin {
  explicit Twin(Protocol protocol)
      : instance(cotwin::make_unit(std::string("unit:io?joints=7&link=fri&protocol=") + to_text(protocol), {}, {},
                                   cotwin::unit_types())) {
    set("address", "127.0.0.1");
    set("port", "0");
    set("mode", "position");
  }
  void set(const char* name, const char* value) { cotwin::assign_text(instance.variables.at(name), value); }
  void initialise() {
    for (const char* gain : {"K_P", "K_D"}) set(gain, "0");  // no search for their limits in every run
    instance.unit->initialise(cotwin::Time{});
    local = static_cast<cotwin::io::DatagramQueue*>(instance.unit->tick_source())->local();
    set("K_P", "0.5");
    set("K_D", "0.001");
  }
  void check() const {
    for (const cotwin::Variable& v : instance.variables) {
      if (v.role != cotwin::Role::kOutput || v.kind() != cotwin::Kind::kReal) continue;
      for (const double value : v.reals()) require(std::isfinite(value));
    }
  }

  cotwin::Instance instance;
  cotwin::net::Endpoint local;
};

void run_twin(std::size_t index, Bytes pieces) {
  static std::array<std::unique_ptr<Twin>, kProtocols.size()> twins;
  static cotwin::net::UdpSocket robot(cotwin::net::Endpoint{0x7f000001, 0}, "robot");
  const Protocol protocol = kProtocols[index];
  if (!twins[index]) twins[index] = std::make_unique<Twin>(protocol);
  Twin& twin = *twins[index];
  std::array<std::uint8_t, 2048> bytes;
  while (robot.receive(bytes)) {
  }
  twin.initialise();
  static Monitoring message;
  message = {};
  message.joints = 7;
  message.fields = Monitoring::kMeasuredPosition | Monitoring::kMeasuredTorque | Monitoring::kExternalTorque |
                   Monitoring::kInterpolatorPosition | Monitoring::kCommandMode | Monitoring::kTime;
  if (protocol < Protocol::kSunrise2_5) message.fields |= Monitoring::kCommandedPosition;
  message.quality = Quality::kExcellent;
  message.command_mode = ClientCommandMode::kPosition;
  message.send_period = 1e-3;
  constexpr cotwin::Duration kTick{kPeriod};
  for (std::int64_t k = 0; k < 40; ++k) {
    message.state = k % 20 < 8 ? SessionState::kMonitoringReady : SessionState::kCommandingActive;
    std::array<std::uint8_t, kMaxDatagram> good;
    const std::size_t size = encode(protocol, message, good);
    require(size > 0);
    ++message.counter;
    message.time += kPeriod;
    if (pieces.size() >= 2) {
      const std::size_t length = std::min<std::size_t>(pieces[0] + pieces[1] * 256u, pieces.size() - 2);
      robot.send(pieces.subspan(2, length), twin.local);
      pieces = pieces.subspan(2 + length);
    }
    if (k % 7 != 5) robot.send(std::span(good).first(size), twin.local);
    require(twin.instance.unit->step(cotwin::Time{k * kPeriod}, kTick) == cotwin::StepResult::kDone);
    twin.check();
    while (const auto received = robot.receive(bytes)) {
      static Command command;
      if (decode(protocol, std::span(bytes).first(received->size), 7, command) != Fault::kNone) continue;
      for (std::size_t i = 0; i < 7; ++i) require(std::isfinite(command.q[i]) && std::isfinite(command.tau[i]));
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const Protocol protocol = kProtocols[data[0] % kProtocols.size()];
  const Bytes rest{data + 1, size - 1};
  const int what = data[0] / 8 % 4;
  if (what == 3) {
    if (data[0] >= 224) {
      run_twin(data[0] % kProtocols.size(), rest);
    } else {
      run_sessions(protocol, rest);
    }
    return 0;
  }
  const std::size_t joints = protocol == Protocol::kLwr || what < 2 ? 7 : 1 + data[0] / 32 % 8;
  if (what == 0) {
    read<Monitoring>(protocol, joints, rest);
  } else {
    read<Command>(protocol, joints, rest);
  }
  return 0;
}
