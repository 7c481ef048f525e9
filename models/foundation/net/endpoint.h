#pragma once
#include <cstdint>
#include <string>

namespace cotwin::net {

/// An IPv4 address with a UDP port, in the byte order of the host.
struct Endpoint {
  std::uint32_t address = 0;  // 0: any
  std::uint16_t port = 0;     // 0: any

  /// Whether a datagram from `other` comes from here; an address or a port of 0 here stands for any.
  bool covers(const Endpoint& other) const {
    return (address == 0 || address == other.address) && (port == 0 || port == other.port);
  }
  /// Whether only programs on this machine reach it.
  bool is_loopback() const { return address >> 24 == 127; }
  friend bool operator==(const Endpoint&, const Endpoint&) = default;
};

/// "192.168.0.20:30200", or without a port, which is `default_port` then. Throws Error at `place`; names are not looked up.
Endpoint endpoint_of(const std::string& text, std::uint16_t default_port, const std::string& place);
/// "192.168.0.20:30200"
std::string to_text(const Endpoint& endpoint);

}  // namespace cotwin::net
