// Protocols of robots: time to write and read the datagrams of one exchange, and to run both sides of a session, on one core, with
// messages that carry everything their protocol has for 7 joints. Peer: a copy of the same bytes, the least that any codec does.
// Every measured call is checked to allocate nothing.

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "components/io/emulators/kuka/controller.h"
#include "components/io/fri/client.h"
#include "tests/benchmarks/measure.h"
#include "tests/components/io/fri/messages.h"
#include "tests/support/allocations.h"

namespace {

using namespace cotwin;
using namespace cotwin::fri;
using Datagram = std::array<std::uint8_t, kMaxDatagram>;

constexpr std::size_t kMessages = 16;  // in turn, so that branch prediction cannot learn a single one

/// Runs `function` `calls` times; the program ends with an error if it allocates.
template <class Function>
void require_no_allocation(const std::string& name, int calls, const Function& function) {
  const std::uint64_t before = testing::allocations();
  for (int i = 0; i < calls; ++i) function();
  if (const std::uint64_t n = testing::allocations() - before; n != 0) {
    std::fprintf(stderr, "io: %s: %llu allocations, expected none\n", name.c_str(), static_cast<unsigned long long>(n));
    std::exit(1);
  }
}

/// Encodes and decodes a monitoring message and a command: what one side of a session and the other do together.
void benchmark_codec(Protocol protocol, double goal) {
  testing::RandomMessages random(protocol, 7, 1);
  std::vector<Monitoring> monitoring;
  std::vector<Command> commands;
  for (std::size_t i = 0; i < kMessages; ++i) {
    monitoring.push_back(random.monitoring());
    Monitoring& m = monitoring.back();
    m.state = SessionState::kCommandingActive;
    m.fields = testing::monitoring_fields(protocol, m.state);
    m.transformations.count = m.ios.count = 0;
    commands.push_back(random.command());
    Command& c = commands.back();
    c.fields = protocol == Protocol::kLwr ? testing::command_fields(protocol) : Command::kPosition | Command::kTorque;
    c.transformations.count = c.ios.count = 0;
  }
  Datagram bytes{}, copy{};
  Monitoring m_out;
  Command c_out;
  std::size_t i = 0, size_m = 0, size_c = 0;
  bool good = true;
  const auto ours = [&] {
    i = (i + 1) % kMessages;
    size_m = encode(protocol, monitoring[i], bytes);
    good = decode(protocol, std::span(bytes).first(size_m), 7, m_out) == Fault::kNone && good;
    size_c = encode(protocol, commands[i], bytes);
    good = decode(protocol, std::span(bytes).first(size_c), 7, c_out) == Fault::kNone && good;
    benchmark::keep(c_out);
    benchmark::keep(m_out);
  };
  const auto peer = [&] {
    for (const std::size_t size : {size_m, size_m, size_c, size_c}) {
      std::memcpy(copy.data(), bytes.data(), size);
      benchmark::keep(copy);
    }
  };
  const std::string name = std::string("FRI exchange encoded and decoded, ") + to_text(protocol);
  require_no_allocation(name, 100, ours);
  const benchmark::Figures figures = benchmark::measure(ours, peer, 31, 2e-3, benchmark::thread_seconds);
  if (!good) std::exit(1);
  benchmark::print({name + ", " + std::to_string(size_m) + " and " + std::to_string(size_c) + " bytes", "us",
                    1e6 * figures.ours, "copy of the bytes", 1e6 * figures.peer, goal, false});
}

/// A cycle of a session in command: both sides, without a network.
void benchmark_session(Protocol protocol) {
  ControllerSettings settings;
  settings.protocol = protocol;
  settings.send_period = 1'000'000;
  settings.speed_limit.assign(7, 2.0);
  Controller controller(settings, "controller");
  ClientSettings client_settings;
  client_settings.protocol = protocol;
  client_settings.speed_limit.assign(7, 1.0);
  Client client(client_settings, "client");
  Command wanted;
  wanted.fields = Command::kPosition;
  std::int64_t k = 0;
  controller.robot().fields = testing::monitoring_fields(protocol, SessionState::kCommandingActive);
  controller.open(0);
  const auto cycle = [&] {
    const std::int64_t now = 1'000'000 * k++;
    client.receive(controller.cycle(now), {1, 1}, now + 10'000);
    wanted.q[0] = 0.1 * std::sin(1e-3 * static_cast<double>(k));
    controller.receive(client.answer(wanted, now + 20'000), {2, 2}, now + 30'000);
    benchmark::keep(controller.setpoint(now + 500'000));
  };
  for (int i = 0; i < 200; ++i) cycle();
  controller.request(true);
  for (int i = 0; i < 10; ++i) cycle();
  const std::string name = std::string("FRI cycle of controller and client, ") + to_text(protocol);
  require_no_allocation(name, 100, cycle);
  const benchmark::Figures figures = benchmark::measure(
      cycle, [] {}, 31, 2e-3, benchmark::thread_seconds);
  if (controller.state() != SessionState::kCommandingActive) std::exit(1);
  benchmark::print({name, "us", 1e6 * figures.ours, "none", 0, 0, false});
}

}  // namespace

int main() {
  for (const Protocol protocol : {Protocol::kLwr, Protocol::kSunrise1_15, Protocol::kSunrise2_7})
    benchmark_codec(protocol, protocol == Protocol::kLwr ? 1 : 2);
  benchmark_session(Protocol::kSunrise2_7);
}
