#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

/// Which slave is plugged into which, and how long a frame travels between them (ETG.1000.4, distributed clocks).
namespace cotwin::ethercat {

/// What the slaves of a bus report, in the order in which frames pass them.
struct SlavePorts {
  std::uint16_t dl_status = 0;                   // register 0x0110
  bool has_clock = false;                        // latches receive times
  std::array<std::uint32_t, 4> receive_times{};  // ns of its own clock, register 0x0900, of one frame
};

/// Whether a cable with a neighbour that answers is at `port` of a slave with this DL status.
constexpr bool is_open(std::uint16_t dl_status, int port) { return (dl_status >> (8 + 2 * port) & 3) == 2; }

struct Place {
  int parent = -1;      // position of the neighbour towards the master; −1: the master
  int parent_port = 0;  // port of the parent to which the slave is plugged
  int entry_port = 0;   // own port at which frames arrive
};

/// The tree of slaves. Frames leave a slave by its open ports in the order 3, 1, 2 (0 when they came in elsewhere). Throws Error if the
/// open ports do not make up a tree of these slaves.
std::vector<Place> find_topology(std::span<const SlavePorts> slaves);

/// Delay of a frame from the first slave with a clock to each slave, ns; 0 for slaves without a clock. Assumes that cables and slaves take
/// as long in one direction as in the other:
///   delay(i) = delay(p) + earlier + (loop − through)/2
/// p: the nearest slave with a clock towards the master; earlier: time for which the frame was in branches that p serves before i's;
/// loop: time between leaving p for i's branch and coming back; through: time between entering i and coming back to it.
std::vector<std::uint32_t> propagation_delays(std::span<const SlavePorts> slaves, std::span<const Place> places);

}  // namespace cotwin::ethercat
