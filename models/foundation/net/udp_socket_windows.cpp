#include <winsock2.h>

#include <chrono>
#include <string>
#include <utility>

#include "models/foundation/net/udp_socket.h"
#include "models/foundation/support/error.h"

namespace cotwin::net {

namespace {

sockaddr_in address_of(const Endpoint& endpoint) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(endpoint.address);
  address.sin_port = htons(endpoint.port);
  return address;
}

Endpoint endpoint_of(const sockaddr_in& address) { return {ntohl(address.sin_addr.s_addr), ntohs(address.sin_port)}; }

SOCKET socket_of(int descriptor) { return static_cast<SOCKET>(descriptor); }

}  // namespace

UdpSocket::UdpSocket(const Endpoint& local, const std::string& place) {
  const auto fail = [&](const char* call) {
    const int reason = WSAGetLastError();
    if (descriptor_ >= 0) closesocket(socket_of(std::exchange(descriptor_, -1)));
    throw Error(place, std::string("UDP socket at ") + to_text(local) + ": " + call + ": error " + std::to_string(reason) +
                           ", expected an address of this machine and a free port");
  };
  WSADATA data;
  if (WSAStartup(MAKEWORD(2, 2), &data) != 0) fail("WSAStartup");
  const SOCKET socket = ::socket(AF_INET, SOCK_DGRAM, IPPROTO_UDP);
  if (socket == INVALID_SOCKET) fail("socket");
  descriptor_ = static_cast<int>(socket);  // handles of sockets are small numbers
  u_long on = 1;
  if (ioctlsocket(socket, FIONBIO, &on) != 0) fail("ioctlsocket");
  sockaddr_in address = address_of(local);
  if (::bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) fail("bind");
  int size = sizeof address;
  if (::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) != 0) fail("getsockname");
  local_ = endpoint_of(address);
}

UdpSocket::~UdpSocket() {
  if (descriptor_ >= 0) closesocket(socket_of(descriptor_));
}

UdpSocket::UdpSocket(UdpSocket&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)), local_(other.local_) {}

UdpSocket& UdpSocket::operator=(UdpSocket&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(local_, other.local_);
  return *this;
}

std::optional<UdpSocket::Received> UdpSocket::receive(std::span<std::uint8_t> buffer) {
  for (int tries = 0; tries < 16; ++tries) {
    sockaddr_in from{};
    int from_size = sizeof from;
    const int size = ::recvfrom(socket_of(descriptor_), reinterpret_cast<char*>(buffer.data()), static_cast<int>(buffer.size()),
                                0, reinterpret_cast<sockaddr*>(&from), &from_size);
    const bool cut = size < 0 && WSAGetLastError() == WSAEMSGSIZE;
    if (size >= 0 || cut) {
      // std::chrono::steady_clock is the monotonic clock; Windows stamps no datagrams.
      const auto now = std::chrono::steady_clock::now().time_since_epoch();
      return Received{cut ? buffer.size() + 1 : static_cast<std::size_t>(size), endpoint_of(from),
                      std::chrono::duration_cast<std::chrono::nanoseconds>(now).count()};
    }
    if (WSAGetLastError() == WSAEWOULDBLOCK) return std::nullopt;
    // Others are errors of earlier datagrams (unreachable port), each reported once.
  }
  return std::nullopt;
}

bool UdpSocket::send(std::span<const std::uint8_t> bytes, const Endpoint& to) {
  const sockaddr_in address = address_of(to);
  const int sent = ::sendto(socket_of(descriptor_), reinterpret_cast<const char*>(bytes.data()), static_cast<int>(bytes.size()),
                            0, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  return sent == static_cast<int>(bytes.size());
}

}  // namespace cotwin::net
