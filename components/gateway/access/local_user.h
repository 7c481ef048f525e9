#pragma once
#include <sys/socket.h>

#include <cstdint>
#include <optional>

namespace cotwin::gateway::access {

/// The user whose process made the socket at the other end of a TCP connection within this machine. Nothing if that cannot be known:
/// the other end is in another network namespace (a container), its process has closed it, or the system does not tell. Asks the
/// system (sock_diag(7), else /proc/net/tcp); TCP has no SO_PEERCRED. `peer`, `own`: the addresses of the connection, both AF_INET or both
/// AF_INET6.
std::optional<std::uint32_t> user_at(const sockaddr& peer, const sockaddr& own);
/// The same from /proc/net/tcp alone, for kernels that do not answer sock_diag(7). Reads the lines of all sockets.
std::optional<std::uint32_t> user_in_tables(const sockaddr& peer, const sockaddr& own);

}  // namespace cotwin::gateway::access
