#pragma once
#include <netinet/in.h>
#include <time.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "models/foundation/net/endpoint.h"

/// What the sockets of this folder have in common on POSIX systems.
namespace cotwin::net::posix {

inline constexpr std::int64_t kSecond = 1'000'000'000;  // ns

sockaddr_in address_of(const Endpoint& endpoint);
Endpoint endpoint_of(const sockaddr_in& address);

/// ns.
std::int64_t now_of(clockid_t clock);
/// Asks for the kernel's time stamps. Without them receive() gives times of reading.
void request_arrival_times(int descriptor);

struct Datagram {
  std::size_t size = 0;      // bytes; more than the buffer has: the rest is lost
  std::int64_t arrival = 0;  // ns of the monotonic clock
};
/// The next datagram, and its sender in `from` of `from_size` bytes; none if there is none. Never blocks.
std::optional<Datagram> receive(int descriptor, std::span<std::uint8_t> buffer, void* from, std::size_t from_size);

}  // namespace cotwin::net::posix
