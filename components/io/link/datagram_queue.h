#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "components/unit/tick_source.h"
#include "models/foundation/net/udp_socket.h"

namespace cotwin::io {

/// A UDP socket with the datagrams that a clock has seen come and the next step of the unit will read. Allocates nothing after
/// the constructor and never blocks but in wait().
class DatagramQueue : public TickSource {
 public:
  struct Datagram {
    std::span<const std::uint8_t> bytes;  // until the next call
    net::Endpoint from;
    std::int64_t arrival = 0;  // ns, CLOCK_MONOTONIC
  };

  DatagramQueue();

  /// Binds to `local` and forgets what has come; keeps the socket if it is bound there already. Throws Error at `place`.
  void open(const net::Endpoint& local, const std::string& place);
  net::Endpoint local() const { return socket_ ? socket_->local() : net::Endpoint{}; }
  /// Number of a datagram, modulo 2^bits, and the source's time from one number to the next, ns.
  struct Stamp {
    std::uint32_t number = 0;
    std::int64_t period = 0;
  };
  /// The clock's datagrams: those from `from` (0: from anywhere) for which `stamp` has a number. `period`: nominal time between
  /// them, ns; 0: not known.
  void set_source(const net::Endpoint& from, unsigned bits,
                  std::function<std::optional<Stamp>(std::span<const std::uint8_t>)> stamp);
  void set_period(std::int64_t period) { period_ = period; }
  /// From now on datagrams of others than `sender` are counted and forgotten, so that a flood of them displaces none of the
  /// sender's. An address or a port of 0 stands for any. After `silence` ns without a datagram that has a number others are let
  /// through, and old numbers that come twice, or one after the other, are those of a sender that has begun anew.
  void keep_only(const net::Endpoint& sender, std::int64_t silence = std::numeric_limits<std::int64_t>::max()) {
    sender_ = sender;
    silence_ = silence;
  }
  /// The next newer number is one period after the last one, whatever is between them.
  void skip_numbers() { skips_ = true; }
  /// ns, CLOCK_MONOTONIC: when the last datagram with a number came, also an old one.
  std::int64_t heard() const { return heard_; }
  /// Datagrams since open() of others than the sender, and of the sender that were displaced by newer ones before they were read.
  std::uint64_t strangers() const { return strangers_; }
  std::uint64_t displaced() const { return displaced_; }

  /// The next datagram that waiting() has counted. A step reads so many and no more: an answer may bring the next message at once.
  std::optional<Datagram> receive();
  /// Takes what has come. The number of datagrams that receive() has to give.
  std::size_t waiting() {
    take();
    return count_;
  }
  bool send(std::span<const std::uint8_t> bytes, const net::Endpoint& to) { return socket_->send(bytes, to); }

  std::optional<Arrival> wait(std::int64_t deadline) override;
  std::int64_t period() const override { return period_; }

  /// A tick without a datagram: one period after the last one. `numbers`: that a period has.
  Arrival next_period(std::int64_t numbers);

  /// Blocks until there is a datagram to receive or until `deadline` (CLOCK_MONOTONIC, ns). For initialisation.
  bool wait_for_any(std::int64_t deadline);

 private:
  struct Slot {
    std::array<std::uint8_t, 2048> bytes;
    std::size_t size = 0;
    net::Endpoint from;
    std::int64_t arrival = 0;
  };
  static constexpr std::size_t kSlots = 64;
  static constexpr int kMostTaken = 512;  // datagrams at a time; more than a socket's usual buffer has

  /// Takes what has come from the socket, and notes the newest datagram of the source if it is newer than all before. A flood
  /// does not keep it busy without end.
  void take();
  bool is_newer(std::uint32_t number, const net::Endpoint& from, std::int64_t arrival);
  bool begins_anew(std::uint32_t number);
  bool sleep(std::int64_t deadline) const;

  std::optional<net::UdpSocket> socket_;
  std::optional<net::Endpoint> wanted_;
  std::vector<Slot> slots_;
  std::size_t first_ = 0, count_ = 0;
  std::int64_t period_ = 0;
  std::uint64_t strangers_ = 0, displaced_ = 0;
  net::Endpoint sender_, source_;
  unsigned bits_ = 32;
  std::function<std::optional<Stamp>(std::span<const std::uint8_t>)> stamp_;
  std::int64_t silence_ = std::numeric_limits<std::int64_t>::max();
  bool stamped_ = false, skips_ = false;
  std::optional<Arrival> newest_;           // that the clock has not seen
  std::int64_t position_ = 0;               // of the newest datagram, without wrap
  std::uint32_t number_ = 0;                // its number
  net::Endpoint from_;                      // its sender
  std::int64_t newest_at_ = 0, heard_ = 0;  // ns, CLOCK_MONOTONIC: when it came, and the last one with a number
  std::optional<std::uint32_t> last_old_;   // number of the last datagram if it was old and came after a silence
};

/// ns, CLOCK_MONOTONIC.
std::int64_t monotonic_now();

/// The scenario time of a datagram that a step at `now` finds: the host's time since the last step, which was at `before` in the
/// scenario and at `host_before` on the host's clock, but before `now`. So it is exact if the scenario runs on the wall clock, and
/// a scenario without a clock does not depend on the speed at which it runs.
inline std::int64_t scenario_time(std::int64_t arrival, std::int64_t host_before, std::int64_t before, std::int64_t now) {
  const std::int64_t since = arrival > host_before ? arrival - host_before : 0;
  if (since < now - before) return before + since;
  return now > before ? now - 1 : before;
}

}  // namespace cotwin::io
