// Streams of RTDE with any contents. The first byte chooses who reads them:
//   controller   pieces of the rest, each after its length, come from one or two clients between control cycles; values stay finite,
//                the set point of the following program within its limits of position and speed
//   client       the rest comes from a controller, in pieces, between good packages; what is measured stays finite
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "components/io/emulators/ur/controller.h"
#include "components/io/emulators/ur/follower.h"
#include "components/io/rtde/client.h"

namespace {

using namespace cotwin::rtde;
using Bytes = std::span<const std::uint8_t>;

void require(bool condition) {
  if (!condition) std::abort();
}

/// The next piece: a length, then so many bytes.
Bytes take(Bytes& rest) {
  if (rest.empty()) return {};
  const std::size_t size = std::min<std::size_t>(rest[0], rest.size() - 1);
  const Bytes piece = rest.subspan(1, size);
  rest = rest.subspan(1 + size);
  return piece;
}

void run_controller(Bytes rest) {
  Controller controller{ControllerSettings{}};
  FollowerSettings limits;
  limits.lower.fill(-3);
  limits.upper.fill(3);
  limits.speed.fill(2);
  Follower follower(limits);
  controller.at("target_speed_fraction") = 1;
  follower.start({}, controller);
  for (int client = 0; client < 2; ++client) require(controller.connect() == client);
  constexpr double h = 0.002;
  while (!rest.empty()) {
    const std::size_t client = rest[0] & 1;
    Bytes piece = take(rest);
    while (!piece.empty() && !controller.broken(client)) {
      const std::span<std::uint8_t> space = controller.space(client);
      require(!space.empty());
      const std::size_t size = std::min(space.size(), piece.size());
      std::copy_n(piece.begin(), size, space.begin());
      controller.received(client, size);
      piece = piece.subspan(size);
    }
    const Joints before = follower.q();
    follower.cycle(controller, h, true, nullptr);
    for (std::size_t i = 0; i < kJoints; ++i) {
      require(std::abs(follower.q()[i]) <= 3 && std::abs(follower.q()[i] - before[i]) <= 2 * h + 1e-12);
    }
    controller.cycle();
    controller.sent(client, controller.waiting(client).size() / 2);
    if (!controller.broken(client)) continue;
    controller.disconnect(client);
    require(controller.connect() == static_cast<int>(client));
  }
  for (const double value : controller.values()) require(std::isfinite(value));
}

void run_client(Bytes rest) {
  ClientSettings settings;
  settings.outputs = {{"timestamp"}, {"actual_q"}, {"robot_mode", false}, {"actual_current_as_torque", false}};
  settings.inputs = {{"input_int_register_24"}, {"input_double_register_24"}};
  Client client(settings, "fuzz");
  Controller controller{ControllerSettings{}};
  const auto number = static_cast<std::size_t>(controller.connect());
  client.open(0);
  std::int64_t now = 0;
  while (!rest.empty() && client.state() != Client::State::kFailed) {
    const bool good = (rest[0] & 1) != 0;
    Bytes piece = take(rest);
    controller.cycle();
    if (good) piece = controller.waiting(number);
    const std::span<std::uint8_t> space = client.space();
    const std::size_t size = std::min(space.size(), piece.size());
    std::copy_n(piece.begin(), size, space.begin());
    client.received(size);
    if (good) controller.sent(number, size);
    client.set_up(now);
    client.look_ahead();
    client.make_room(now);
    while (client.read(now)) client.send();
    const Bytes asked = client.waiting();
    const std::span<std::uint8_t> room = controller.space(number);
    const std::size_t taken = std::min(room.size(), asked.size());
    std::copy_n(asked.begin(), taken, room.begin());
    client.sent(taken);
    controller.received(number, taken);
    now += 1'000'000;
  }
  for (const double value : client.values()) require(std::isfinite(value));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  if (data[0] % 2 == 0) {
    run_controller({data + 1, size - 1});
  } else {
    run_client({data + 1, size - 1});
  }
  return 0;
}
