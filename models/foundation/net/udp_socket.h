#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "models/foundation/net/endpoint.h"

namespace cotwin::net {

/// A UDP socket (IPv4) that never blocks and allocates nothing after the constructor.
class UdpSocket {
 public:
  struct Received {
    std::size_t size = 0;  // bytes of the datagram; more than the buffer has: the rest is lost
    Endpoint from;
    std::int64_t arrival = 0;  // ns of the monotonic clock, by the kernel's time stamp where the system has one
  };

  /// Binds to `local`; port 0: the system chooses one. Throws Error at `place`.
  UdpSocket(const Endpoint& local, const std::string& place);
  ~UdpSocket();
  UdpSocket(UdpSocket&& other) noexcept;
  UdpSocket& operator=(UdpSocket&& other) noexcept;

  /// The address and port that it is bound to.
  Endpoint local() const { return local_; }
  /// For ppoll; −1 after a move.
  int descriptor() const { return descriptor_; }

  /// The next datagram that has arrived; none if there is none.
  std::optional<Received> receive(std::span<std::uint8_t> buffer);
  /// False if the system did not take the datagram: no buffer is free, or there is no way to `to`. It is lost then, as in a network.
  bool send(std::span<const std::uint8_t> bytes, const Endpoint& to);

 private:
  int descriptor_ = -1;
  Endpoint local_;
};

}  // namespace cotwin::net
