#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/bus/transport.h"
#include "components/bus/wake.h"
#include "models/foundation/net/udp_socket.h"

namespace cotwin::bus {

/// Messages over UDP to and from one peer. A datagram is a fragment of a message, with a header of 16 bytes, little-endian:
///   0  u32  magic "CTFR"     8  u16  number of the fragment, from 0
///   4  u32  message          10  u16  number of fragments
///                            12  u32  bytes of the message
/// All fragments but the last have kFragment bytes of the message. Datagrams of other senders are ignored and counted. There is no
/// encryption and no password: for networks that only the machines of the cell can reach.
class UdpTransport final : public Transport {
 public:
  static constexpr std::size_t kHeader = 16, kFragment = 1384;  // bytes; together below the 1472 of a usual Ethernet frame
  static constexpr std::size_t kMaxFragments = 48;              // what the usual receive buffer of a Linux socket holds at once

  /// Throws Error at `place` if `local` cannot be bound.
  UdpTransport(net::Endpoint local, net::Endpoint peer, const std::string& place);

  bool send(std::span<const std::byte> message) override;
  /// Returns nothing also after kMostAtOnce datagrams, so that a flood cannot hold a step.
  std::span<const std::byte> receive() override;
  static constexpr int kMostAtOnce = 512;
  bool wait(std::int64_t deadline) override { return wait_readable(socket_.descriptor(), deadline); }
  std::size_t max_bytes() const override { return kMaxFragments * kFragment; }

  /// Readable when a datagram has arrived.
  int descriptor() const { return socket_.descriptor(); }
  net::Endpoint local() const { return socket_.local(); }
  net::Endpoint peer() const { return peer_; }
  void set_peer(net::Endpoint peer) { peer_ = peer; }
  /// Drops what has arrived, and counts from zero.
  void restart(net::Endpoint peer);

  struct Counts {
    std::uint64_t sent = 0, sent_bytes = 0;          // datagrams and their bytes, without the headers of UDP and IP
    std::uint64_t received = 0, received_bytes = 0;  // of the peer
    std::uint64_t unsent = 0;                        // datagrams that the system did not take
    std::uint64_t foreign = 0;                       // datagrams of other senders
    std::uint64_t damaged = 0;                       // datagrams of the peer that are no fragment
    std::uint64_t incomplete = 0;                    // messages of which fragments were lost
  };
  const Counts& counts() const { return counts_; }

 private:
  struct Partial {
    bool open = false;
    std::uint32_t message = 0, bytes = 0;
    std::uint64_t missing = 0;  // a bit per fragment
    std::vector<std::byte> buffer;
  };
  bool read_datagram(std::span<const std::byte>& message);
  std::span<const std::byte> add_fragment(std::span<const std::byte> datagram);
  Partial& partial_of(std::uint32_t message);

  net::UdpSocket socket_;
  net::Endpoint peer_;
  std::uint32_t next_;  // number of the next message
  int examined_ = 0;    // datagrams since receive() last returned nothing
  std::vector<std::uint8_t> datagram_;
  std::array<Partial, 4> partials_;  // messages that may arrive mixed
  std::size_t oldest_ = 0;
  std::array<std::optional<std::uint32_t>, 8> whole_;  // messages that came last
  std::size_t last_whole_ = 0;
  Counts counts_;
};

}  // namespace cotwin::bus
