#pragma once
#include <Eigen/Geometry>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "components/io/fri/fri.h"

/// Messages of FRI for tests: random ones, and bytes written as text.
namespace cotwin::testing {

using Bytes = std::vector<std::uint8_t>;

/// "0a 09 | 08" → bytes; spaces and bars are ignored.
inline Bytes bytes_of(const std::string& hex) {
  Bytes bytes;
  std::string digits;
  for (const char c : hex) {
    if (c == ' ' || c == '|') continue;
    digits += c;
    if (digits.size() < 2) continue;
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(digits, nullptr, 16)));
    digits.clear();
  }
  return bytes;
}

inline std::string hex_of(std::span<const std::uint8_t> bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text += "0123456789abcdef"[byte >> 4];
    text += "0123456789abcdef"[byte & 15];
  }
  return text;
}

template <class Message>
Bytes encoded(fri::Protocol protocol, const Message& message) {
  Bytes bytes(fri::kMaxDatagram);
  bytes.resize(fri::encode(protocol, message, bytes));
  return bytes;
}

/// Random messages whose numbers survive the protocol: single floats in LWR, which makes text of them comparable.
class RandomMessages {
 public:
  RandomMessages(fri::Protocol protocol, std::size_t joints, std::uint32_t seed)
      : protocol_(protocol), joints_(joints), random_(seed) {}

  double real(double low = -3, double high = 3) {
    return static_cast<double>(static_cast<float>(std::uniform_real_distribution(low, high)(random_)));
  }
  std::uint32_t natural(std::uint32_t below) { return static_cast<std::uint32_t>(random_() % below); }
  std::uint32_t word() { return static_cast<std::uint32_t>(random_()); }

  fri::Joints joints() {
    fri::Joints values{};
    for (std::size_t i = 0; i < joints_; ++i) values[i] = real();
    return values;
  }
  Wrench wrench() {
    Wrench F;
    for (double& value : F) value = real();
    return F;
  }
  Pose pose() {
    const Eigen::Quaterniond q(real(), real(), real(), real(0.1, 1));
    return {q.normalized().toRotationMatrix(), {real(), real(), real()}};
  }
  fri::Name name() {
    std::string text;
    for (std::uint32_t n = natural(fri::kMaxName + 1); n > 0; --n) text += static_cast<char>('!' + natural(94));
    fri::Name name;
    name.assign(text);
    return name;
  }
  fri::Transformation transformation() {
    fri::Transformation t{name(), pose(), {}};
    if (natural(2) == 0) t.time = std::int64_t{natural(2'000'000'000)} * 1'000'000'000 + natural(1'000'000'000);
    return t;
  }
  fri::Io io() {
    fri::Io value;
    value.name = name();
    value.type = static_cast<fri::Io::Type>(natural(3));
    value.direction = static_cast<fri::Io::Direction>(natural(2));
    if (value.type == fri::Io::Type::kAnalog) {
      value.analog = real();
    } else {
      value.digital = std::uint64_t{word()} << 32 | word();
    }
    return value;
  }
  fri::KrlVariables krl() {
    fri::KrlVariables k;
    for (float& value : k.real) value = static_cast<float>(real());
    for (std::int32_t& value : k.integer) value = static_cast<std::int32_t>(word());
    k.boolean = static_cast<std::uint16_t>(word());
    return k;
  }
  std::uint32_t counter() { return protocol_ == fri::Protocol::kLwr ? word() & 0xffff : word(); }

  fri::Monitoring monitoring();
  fri::Command command();

 private:
  fri::Protocol protocol_;
  std::size_t joints_;
  std::mt19937 random_;
};

/// The fields that a protocol carries in a message of this state.
std::uint32_t monitoring_fields(fri::Protocol protocol, fri::SessionState state);
std::uint32_t command_fields(fri::Protocol protocol);

/// The first difference of what `protocol` carries; "" if there is none. Rotations may differ by rounding.
std::string difference(fri::Protocol protocol, const fri::Monitoring& a, const fri::Monitoring& b);
std::string difference(fri::Protocol protocol, const fri::Command& a, const fri::Command& b);

}  // namespace cotwin::testing
