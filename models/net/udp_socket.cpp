#include "models/net/udp_socket.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::net {

namespace {

constexpr int kBufferBytes = 1 << 20;  // asked of the system for each direction; it may give less

sockaddr_in to_system(UdpAddress address) {
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_addr.s_addr = htonl(address.host);
  a.sin_port = htons(address.port);
  return a;
}

UdpAddress from_system(const sockaddr_in& a) { return {ntohl(a.sin_addr.s_addr), ntohs(a.sin_port)}; }

}  // namespace

UdpAddress parse_udp_address(std::string_view text, const std::string& place) {
  const std::size_t colon = text.rfind(':');
  const std::optional<long long> port =
      colon == std::string_view::npos ? std::nullopt : text::parse_integer(text.substr(colon + 1));
  in_addr host{};
  if (!port || *port < 0 || *port > 65535 || inet_pton(AF_INET, std::string(text.substr(0, colon)).c_str(), &host) != 1)
    throw Error(place, "'" + std::string(text) + "', expected an IPv4 address and a port, as '192.168.0.10:30200'");
  return {ntohl(host.s_addr), static_cast<std::uint16_t>(*port)};
}

std::string to_text(UdpAddress a) {
  std::string text;
  for (int shift = 24; shift >= 0; shift -= 8) text += std::to_string(a.host >> shift & 255) + (shift > 0 ? "." : ":");
  return text + std::to_string(a.port);
}

UdpSocket::UdpSocket(UdpAddress local) : descriptor_(socket(AF_INET, SOCK_DGRAM, 0)), local_(local) {
  const auto fail = [&](const std::string& what) {
    const int error = errno;
    if (descriptor_ >= 0) close(descriptor_);
    throw Error("udp " + to_text(local), what + ": " + std::strerror(error));
  };
  if (descriptor_ < 0) fail("no socket");
  if (fcntl(descriptor_, F_SETFL, O_NONBLOCK) != 0 || fcntl(descriptor_, F_SETFD, FD_CLOEXEC) != 0)
    fail("no socket without blocking");
  for (const int option : {SO_RCVBUF, SO_SNDBUF})
    (void)setsockopt(descriptor_, SOL_SOCKET, option, &kBufferBytes, sizeof kBufferBytes);
  sockaddr_in address = to_system(local);
  if (bind(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) fail("cannot listen");
  socklen_t length = sizeof address;
  if (getsockname(descriptor_, reinterpret_cast<sockaddr*>(&address), &length) != 0) fail("no address");
  local_ = from_system(address);
}

UdpSocket::~UdpSocket() {
  if (descriptor_ >= 0) close(descriptor_);
}

UdpSocket::UdpSocket(UdpSocket&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)), local_(other.local_) {}

UdpSocket& UdpSocket::operator=(UdpSocket&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(local_, other.local_);
  return *this;
}

bool UdpSocket::send(UdpAddress to, std::span<const std::byte> datagram) noexcept {
  const sockaddr_in address = to_system(to);
  return sendto(descriptor_, datagram.data(), datagram.size(), 0, reinterpret_cast<const sockaddr*>(&address),
                sizeof address) == static_cast<ssize_t>(datagram.size());
}

// An error of an earlier datagram that was sent (port unreachable) is reported here by some systems; the next call goes on.
std::optional<std::size_t> UdpSocket::receive(std::span<std::byte> buffer, UdpAddress& from) noexcept {
  sockaddr_in address{};
  for (;;) {
    socklen_t length = sizeof address;
    const ssize_t n = recvfrom(descriptor_, buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&address), &length);
    if (n >= 0) {
      from = from_system(address);
      return static_cast<std::size_t>(n);
    }
    if (errno != EINTR && errno != ECONNREFUSED) return std::nullopt;
  }
}

}  // namespace cotwin::net
