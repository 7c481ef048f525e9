// The end of a master's operation.
#include <algorithm>

#include "components/io/ethercat/little_endian.h"
#include "components/io/ethercat/master/master.h"

namespace cotwin::ethercat {

namespace {

constexpr std::int64_t kAnswer = 5'000'000;  // ns that an answer may take

}  // namespace

/// Sends one broadcast and waits for its answer until `deadline`. Returns the working counter; nothing without an answer.
std::optional<std::uint16_t> Master::ask(Wire& wire, Command command, std::uint16_t offset, std::span<std::uint8_t> data,
                                         std::int64_t deadline) {
  acyclic_index_ = static_cast<std::uint8_t>(kAcyclic | (acyclic_index_ + 1));
  FrameWriter writer(buffer_);
  writer.begin();
  writer.add(command, acyclic_index_, at_position(0, offset), data);
  wire.send(writer.finish());
  const std::int64_t end = std::min(wire.now() + kAnswer, deadline);
  do {
    const std::size_t size = wire.receive(buffer_, end);
    FrameReader reader(std::span<const std::uint8_t>(buffer_).first(size));
    Datagram d;
    if (size == 0 || !reader.next(d) || d.index != acyclic_index_ || d.command != command || d.length != data.size()) continue;
    const std::span<const std::uint8_t> answer = reader.data(d);
    std::copy(answer.begin(), answer.end(), data.begin());
    return d.working_counter;
  } while (wire.now() < end);
  return std::nullopt;
}

/// Requests a state of all slaves, and waits until all that answer have it.
bool Master::bring_all_to(Wire& wire, State state, std::int64_t deadline) {
  do {
    std::array<std::uint8_t, 2> control{}, status{};
    const auto value = static_cast<std::uint16_t>(state);
    if (state == State::kInit) {  // with and without acknowledging errors, as in bus_setup.cpp
      store(control.data(), static_cast<std::uint16_t>(value | kStateError));
      ask(wire, Command::kBwr, reg::kAlControl, control, deadline);
    }
    store(control.data(), value);
    ask(wire, Command::kBwr, reg::kAlControl, control, deadline);
    const std::optional<std::uint16_t> count = ask(wire, Command::kBrd, reg::kAlStatus, status, deadline);
    if (count && *count > 0 && status[0] == value) return *count >= bus_.slaves.size();
  } while (wire.now() < deadline);
  return false;
}

bool Master::stop(Wire& wire) {
  operational_ = false;
  const std::int64_t begin = wire.now();
  for (Recovery& r : recoveries_) r.way = Way::kNone;
  acyclic_open_ = false;
  for (int n = 0; n < 3; ++n) {
    send_frames(wire);
    if (collect(wire, wire.now() + kAnswer)) break;
  }
  sent_ = false;
  bring_all_to(wire, State::kSafeOp, begin + kLongestStop / 3);
  const bool all = bring_all_to(wire, State::kInit, begin + kLongestStop * 2 / 3);
  std::array<std::uint8_t, 1> off{};
  for (int n = 0; bus_.reference >= 0 && n < 3; ++n) {
    if (ask(wire, Command::kBwr, reg::kActivation, off, begin + kLongestStop)) break;
  }
  return all;
}

}  // namespace cotwin::ethercat
