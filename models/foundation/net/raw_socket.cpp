#include "models/foundation/net/raw_socket.h"

#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

#ifdef __linux__

#include <arpa/inet.h>
#include <linux/if_packet.h>
#include <net/ethernet.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "models/foundation/net/posix_socket.h"

namespace cotwin::net {

using posix::kSecond;
using posix::now_of;

namespace {

#ifndef PACKET_IGNORE_OUTGOING
constexpr int kIgnoreOutgoing = 23;  // Linux 4.20
#else
constexpr int kIgnoreOutgoing = PACKET_IGNORE_OUTGOING;
#endif

std::string interfaces() {
  std::string names;
  if (struct if_nameindex* const list = ::if_nameindex()) {
    for (const struct if_nameindex* i = list; i->if_index != 0; ++i) text::append(names, i->if_name);
    ::if_freenameindex(list);
  }
  return names;
}

}  // namespace

RawSocket::RawSocket(const std::string& interface, std::uint16_t ether_type, const std::string& place) {
  const auto fail = [&](const std::string& what) {
    if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
    throw Error(place, "interface '" + interface + "': " + what);
  };
  const auto check = [&](int result, const char* call) {
    if (result >= 0) return;
    const int reason = errno;
    if (reason == EPERM || reason == EACCES) {
      fail("raw sockets are not permitted, expected root or the capability CAP_NET_RAW (setcap cap_net_raw+ep PROGRAM)");
    }
    fail(std::string(call) + ": " + std::strerror(reason));
  };
  const unsigned index = ::if_nametoindex(interface.c_str());
  if (index == 0) fail("there is no such interface, expected one of " + interfaces());
  descriptor_ = ::socket(AF_PACKET, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);  // protocol 0: nothing arrives before bind
  check(descriptor_, "socket");
  ifreq request{};
  interface.copy(request.ifr_name, IFNAMSIZ - 1);
  check(::ioctl(descriptor_, SIOCGIFFLAGS, &request), "SIOCGIFFLAGS");
  if (!(request.ifr_flags & IFF_UP)) fail("it is down, expected up (ip link set " + interface + " up)");
  check(::ioctl(descriptor_, SIOCGIFHWADDR, &request), "SIOCGIFHWADDR");
  std::memcpy(address_.data(), request.ifr_hwaddr.sa_data, address_.size());
  posix::request_arrival_times(descriptor_);
  const int on = 1;
  ::setsockopt(descriptor_, SOL_PACKET, kIgnoreOutgoing, &on, sizeof on);  // else receive() leaves these frames out
  packet_mreq all{};
  all.mr_ifindex = static_cast<int>(index);
  all.mr_type = PACKET_MR_PROMISC;
  check(::setsockopt(descriptor_, SOL_PACKET, PACKET_ADD_MEMBERSHIP, &all, sizeof all), "PACKET_ADD_MEMBERSHIP");
  sockaddr_ll local{};
  local.sll_family = AF_PACKET;
  local.sll_protocol = htons(ether_type);
  local.sll_ifindex = static_cast<int>(index);
  check(::bind(descriptor_, reinterpret_cast<const sockaddr*>(&local), sizeof local), "bind");
}

RawSocket::~RawSocket() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::optional<RawSocket::Received> RawSocket::receive(std::span<std::uint8_t> buffer) {
  sockaddr_ll from{};
  for (int tries = 0; tries < 64; ++tries) {
    const std::optional<posix::Datagram> datagram = posix::receive(descriptor_, buffer, &from, sizeof from);
    if (!datagram) break;
    if (from.sll_pkttype != PACKET_OUTGOING) return Received{datagram->size, datagram->arrival};
  }
  return std::nullopt;
}

bool RawSocket::wait(std::int64_t deadline) const {
  const std::int64_t left = deadline - now_of(CLOCK_MONOTONIC);
  if (left <= 0) return true;
  pollfd poll{descriptor_, POLLIN, 0};
  const timespec timeout{left / kSecond, left % kSecond};
  return ::ppoll(&poll, 1, &timeout, nullptr) >= 0 || errno != EINTR;
}

bool RawSocket::send(std::span<const std::uint8_t> frame) {
  const ssize_t sent = ::send(descriptor_, frame.data(), frame.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
  return sent == static_cast<ssize_t>(frame.size());
}

#else

namespace cotwin::net {

RawSocket::RawSocket(const std::string& interface, std::uint16_t, const std::string& place) {
  throw Error(place, "interface '" + interface + "': raw sockets are only available on Linux");
}
RawSocket::~RawSocket() = default;
std::optional<RawSocket::Received> RawSocket::receive(std::span<std::uint8_t>) { return std::nullopt; }
bool RawSocket::wait(std::int64_t) const { return true; }
bool RawSocket::send(std::span<const std::uint8_t>) { return false; }

#endif

RawSocket::RawSocket(RawSocket&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), address_(other.address_) {}

RawSocket& RawSocket::operator=(RawSocket&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(address_, other.address_);
  return *this;
}

}  // namespace cotwin::net
