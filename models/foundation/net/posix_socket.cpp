#include "models/foundation/net/posix_socket.h"

#include <arpa/inet.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstring>

namespace cotwin::net::posix {

namespace {

std::int64_t ns_of(const timespec& t) { return static_cast<std::int64_t>(t.tv_sec) * kSecond + t.tv_nsec; }

/// The time of arrival by the monotonic clock. The kernel's stamp is of the real-time clock, whose distance from the monotonic one is
/// taken now; a stamp that would be in the future or older than a minute (the clock was set) is not used.
std::int64_t arrival_of([[maybe_unused]] msghdr& message) {
  const std::int64_t now = now_of(CLOCK_MONOTONIC);
#ifdef SO_TIMESTAMPNS
  for (cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
    if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_TIMESTAMPNS) continue;
    timespec stamp{};
    std::memcpy(&stamp, CMSG_DATA(c), sizeof stamp);
    const std::int64_t age = now_of(CLOCK_REALTIME) - ns_of(stamp);
    if (age > 0 && age < 60 * kSecond) return now - age;
  }
#endif
  return now;
}

}  // namespace

sockaddr_in address_of(const Endpoint& endpoint) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(endpoint.address);
  address.sin_port = htons(endpoint.port);
  return address;
}

Endpoint endpoint_of(const sockaddr_in& address) { return {ntohl(address.sin_addr.s_addr), ntohs(address.sin_port)}; }

std::int64_t now_of(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return ns_of(t);
}

void request_arrival_times([[maybe_unused]] int descriptor) {
#ifdef SO_TIMESTAMPNS
  const int on = 1;
  ::setsockopt(descriptor, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
#endif
}

std::optional<Datagram> receive(int descriptor, std::span<std::uint8_t> buffer, void* from, std::size_t from_size) {
  iovec place{buffer.data(), buffer.size()};
  alignas(cmsghdr) char control[128];
  msghdr message{};
  for (int tries = 0; tries < 16; ++tries) {
    message.msg_name = from;
    message.msg_namelen = static_cast<socklen_t>(from_size);
    message.msg_iov = &place;
    message.msg_iovlen = 1;
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    message.msg_flags = 0;
    const ssize_t size = ::recvmsg(descriptor, &message, MSG_DONTWAIT);
    if (size >= 0) {
      // A datagram that was cut is reported longer than the buffer, so that no reader takes it for a whole one.
      const bool cut = (message.msg_flags & MSG_TRUNC) != 0;
      return Datagram{cut ? buffer.size() + 1 : static_cast<std::size_t>(size), arrival_of(message)};
    }
    if (errno == EAGAIN || errno == EWOULDBLOCK) return std::nullopt;
    // Others are interruptions, a link that went down, and errors of earlier datagrams (unreachable port), each reported once.
  }
  return std::nullopt;
}

}  // namespace cotwin::net::posix
