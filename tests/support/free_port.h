#pragma once
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "models/foundation/net/udp_socket.h"
#include "models/foundation/support/error.h"

namespace cotwin::testing {

/// The first of `count` UDP ports in a row that are free on 127.0.0.1 at present.
inline std::uint16_t free_ports(int count = 1) {
  constexpr std::uint32_t kLoopback = 0x7f000001;
  for (int tries = 0; tries < 100; ++tries) {
    std::vector<net::UdpSocket> sockets;
    sockets.emplace_back(net::Endpoint{kLoopback, 0}, "free_ports");
    const std::uint16_t first = sockets.front().local().port;
    try {
      for (int i = 1; i < count; ++i)
        sockets.emplace_back(net::Endpoint{kLoopback, static_cast<std::uint16_t>(first + i)}, "free_ports");
      return first;
    } catch (const Error&) {  // another one has it
    }
  }
  throw std::runtime_error("no " + std::to_string(count) + " free UDP ports in a row");
}

}  // namespace cotwin::testing
