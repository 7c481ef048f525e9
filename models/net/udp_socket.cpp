// For POSIX; udp_socket_windows.cpp is for Windows.
#include "models/net/udp_socket.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <utility>

#include "models/support/error.h"

namespace cotwin::net {

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;  // ns

sockaddr_in address_of(const Endpoint& endpoint) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(endpoint.address);
  address.sin_port = htons(endpoint.port);
  return address;
}

Endpoint endpoint_of(const sockaddr_in& address) { return {ntohl(address.sin_addr.s_addr), ntohs(address.sin_port)}; }

std::int64_t ns_of(const timespec& t) { return static_cast<std::int64_t>(t.tv_sec) * kSecond + t.tv_nsec; }

std::int64_t now_of(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return ns_of(t);
}

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

UdpSocket::UdpSocket(const Endpoint& local, const std::string& place) {
  const auto fail = [&](const char* call) {
    const std::string reason = std::strerror(errno);
    if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
    throw Error(place, std::string("UDP socket at ") + to_text(local) + ": " + call + ": " + reason +
                           ", expected an address of this machine and a free port");
  };
  descriptor_ = ::socket(AF_INET, SOCK_DGRAM, 0);
  if (descriptor_ < 0) fail("socket");
  if (::fcntl(descriptor_, F_SETFL, O_NONBLOCK) < 0 || ::fcntl(descriptor_, F_SETFD, FD_CLOEXEC) < 0) fail("fcntl");
#ifdef SO_TIMESTAMPNS
  const int on = 1;
  ::setsockopt(descriptor_, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);  // else times of reading are used
#endif
  sockaddr_in address = address_of(local);
  if (::bind(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) < 0) fail("bind");
  socklen_t size = sizeof address;
  if (::getsockname(descriptor_, reinterpret_cast<sockaddr*>(&address), &size) < 0) fail("getsockname");
  local_ = endpoint_of(address);
}

UdpSocket::~UdpSocket() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

UdpSocket::UdpSocket(UdpSocket&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)), local_(other.local_) {}

UdpSocket& UdpSocket::operator=(UdpSocket&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(local_, other.local_);
  return *this;
}

std::optional<UdpSocket::Received> UdpSocket::receive(std::span<std::uint8_t> buffer) {
  sockaddr_in from{};
  iovec place{buffer.data(), buffer.size()};
  alignas(cmsghdr) char control[128];
  msghdr message{};
  for (int tries = 0; tries < 16; ++tries) {
    message.msg_name = &from;
    message.msg_namelen = sizeof from;
    message.msg_iov = &place;
    message.msg_iovlen = 1;
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    message.msg_flags = 0;
    const ssize_t size = ::recvmsg(descriptor_, &message, MSG_DONTWAIT);
    if (size >= 0) {
      // A datagram that was cut is reported longer than the buffer, so that no reader takes it for a whole one.
      const bool cut = (message.msg_flags & MSG_TRUNC) != 0;
      return Received{cut ? buffer.size() + 1 : static_cast<std::size_t>(size), endpoint_of(from), arrival_of(message)};
    }
    if (errno == EAGAIN || errno == EWOULDBLOCK) return std::nullopt;
    // Others are interruptions and errors of earlier datagrams (unreachable port), each reported once.
  }
  return std::nullopt;
}

bool UdpSocket::send(std::span<const std::uint8_t> bytes, const Endpoint& to) {
  const sockaddr_in address = address_of(to);
  const ssize_t sent = ::sendto(descriptor_, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                                reinterpret_cast<const sockaddr*>(&address), sizeof address);
  return sent == static_cast<ssize_t>(bytes.size());
}

}  // namespace cotwin::net
