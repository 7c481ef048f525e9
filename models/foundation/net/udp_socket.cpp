// For POSIX; udp_socket_windows.cpp is for Windows.
#include "models/foundation/net/udp_socket.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <utility>

#include "models/foundation/net/posix_socket.h"
#include "models/foundation/support/error.h"

namespace cotwin::net {

using posix::address_of;

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
  posix::request_arrival_times(descriptor_);
  sockaddr_in address = address_of(local);
  if (::bind(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) < 0) fail("bind");
  socklen_t size = sizeof address;
  if (::getsockname(descriptor_, reinterpret_cast<sockaddr*>(&address), &size) < 0) fail("getsockname");
  local_ = posix::endpoint_of(address);
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
  const std::optional<posix::Datagram> datagram = posix::receive(descriptor_, buffer, &from, sizeof from);
  if (!datagram) return std::nullopt;
  return Received{datagram->size, posix::endpoint_of(from), datagram->arrival};
}

bool UdpSocket::send(std::span<const std::uint8_t> bytes, const Endpoint& to) {
  const sockaddr_in address = address_of(to);
  const ssize_t sent = ::sendto(descriptor_, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                                reinterpret_cast<const sockaddr*>(&address), sizeof address);
  return sent == static_cast<ssize_t>(bytes.size());
}

}  // namespace cotwin::net
