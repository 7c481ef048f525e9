#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace cotwin::net {

/// A socket for Ethernet frames of one type at one interface (AF_PACKET). It never blocks and allocates nothing after the constructor.
/// Only Linux has it; elsewhere the constructor throws.
class RawSocket {
 public:
  struct Received {
    std::size_t size = 0;      // bytes of the frame; more than the buffer has: the rest is lost
    std::int64_t arrival = 0;  // ns of the monotonic clock, by the kernel's time stamp
  };

  /// Throws Error at `place` if there is no such interface, it is down, or raw sockets are not permitted.
  RawSocket(const std::string& interface, std::uint16_t ether_type, const std::string& place);
  ~RawSocket();
  RawSocket(RawSocket&& other) noexcept;
  RawSocket& operator=(RawSocket&& other) noexcept;

  /// For ppoll; −1 after a move.
  int descriptor() const { return descriptor_; }
  /// The hardware address of the interface.
  const std::array<std::uint8_t, 6>& address() const { return address_; }

  /// The next frame that has arrived, from its destination address on, without check sequence; none if there is none. Frames that this
  /// machine sends are not received.
  std::optional<Received> receive(std::span<std::uint8_t> buffer);
  /// Waits until a frame has arrived, `deadline` (ns of the monotonic clock) has passed, or a signal has come; returns false for the
  /// last.
  bool wait(std::int64_t deadline) const;
  /// False if the system did not take the frame: its queue is full, or the interface is down. It is lost then.
  bool send(std::span<const std::uint8_t> frame);

 private:
  int descriptor_ = -1;
  std::array<std::uint8_t, 6> address_{};
};

}  // namespace cotwin::net
