#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace cotwin::net {

/// An IPv4 address and port.
struct UdpAddress {
  std::uint32_t host = 0;  // 127.0.0.1 is 0x7f000001
  std::uint16_t port = 0;

  friend bool operator==(const UdpAddress&, const UdpAddress&) = default;
};

/// Reads "192.168.0.10:30200". Throws Error `place: …`.
UdpAddress parse_udp_address(std::string_view text, const std::string& place);
std::string to_text(UdpAddress address);

/// A non-blocking UDP socket (POSIX). Sending and receiving allocate nothing.
class UdpSocket {
 public:
  /// Binds to `local`; port 0: a free one. Throws Error that names the address, for example if another program has it.
  explicit UdpSocket(UdpAddress local);
  ~UdpSocket();
  UdpSocket(UdpSocket&& other) noexcept;
  UdpSocket& operator=(UdpSocket&& other) noexcept;

  /// With the port that the system chose.
  UdpAddress local() const { return local_; }
  /// Readable when a datagram has arrived.
  int descriptor() const { return descriptor_; }

  /// False: not sent, because the system's buffer is full or there is no way to the host.
  bool send(UdpAddress to, std::span<const std::byte> datagram) noexcept;
  /// The size of the next datagram, written to `buffer` and cut to its size, and its sender; nothing if none has arrived.
  std::optional<std::size_t> receive(std::span<std::byte> buffer, UdpAddress& from) noexcept;

 private:
  int descriptor_ = -1;
  UdpAddress local_;
};

}  // namespace cotwin::net
