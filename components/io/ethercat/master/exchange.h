#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "components/io/ethercat/frame.h"
#include "components/io/ethercat/little_endian.h"
#include "components/io/ethercat/master/wire.h"

namespace cotwin::ethercat {

/// Single datagrams, each sent in a frame of its own and awaited: for setting up a bus.
class Exchange {
 public:
  struct Options {
    std::int64_t timeout = 20'000'000;  // ns that an answer may take
    int attempts = 3;                   // frames sent before the bus counts as silent
  };

  explicit Exchange(Wire& wire) : Exchange(wire, Options()) {}
  Exchange(Wire& wire, Options options) : wire_(wire), options_(options) {}

  /// Sends `data` and replaces it by what comes back. Returns the working counter; nothing if no attempt was answered.
  std::optional<std::uint16_t> transfer(Command command, std::uint32_t address, std::span<std::uint8_t> data);
  /// The same for one value; `value` is unchanged if there was no answer.
  template <class T>
  std::optional<std::uint16_t> transfer(Command command, std::uint32_t address, T& value) {
    std::array<std::uint8_t, sizeof(T)> bytes;
    store(bytes.data(), value);
    const std::optional<std::uint16_t> count = transfer(command, address, std::span<std::uint8_t>(bytes));
    if (count) value = load<T>(bytes.data());
    return count;
  }
  /// Reads from or writes to one slave and makes sure of it, because frames may be lost or damaged: until a write comes back as it was sent,
  /// or two reads give the same, each with the working counter 1. Whether that succeeded within kMostRequests.
  bool confirm(Command command, std::uint32_t address, std::span<std::uint8_t> data);
  /// Broadcast write of zeros.
  void clear(std::uint16_t offset, std::size_t bytes);
  /// Broadcast write. Returns the number of slaves that took it; nothing if the bus is silent.
  template <class T>
  std::optional<std::uint16_t> broadcast(std::uint16_t offset, T value) {
    return transfer(Command::kBwr, at_position(0, offset), value);
  }
  /// Reads from the slave with a station address, with confirm(). Nothing if it does not answer.
  template <class T>
  std::optional<T> read(std::uint16_t station, std::uint16_t offset) {
    std::array<std::uint8_t, sizeof(T)> bytes{};
    const bool done = confirm(Command::kFprd, at_station(station, offset), bytes);
    return done ? std::optional<T>(load<T>(bytes.data())) : std::nullopt;
  }
  /// Writes to the slave with a station address, with confirm(). Returns whether it took the value.
  template <class T>
  bool write(std::uint16_t station, std::uint16_t offset, T value) {
    std::array<std::uint8_t, sizeof(T)> bytes;
    store(bytes.data(), value);
    return confirm(Command::kFpwr, at_station(station, offset), bytes);
  }

  Wire& wire() { return wire_; }

 private:
  static constexpr int kMostRequests = 12;

  Wire& wire_;
  Options options_;
  std::uint8_t index_ = 0;
  std::array<std::uint8_t, kLongestFrame> sent_{}, received_{}, before_{};
};

}  // namespace cotwin::ethercat
