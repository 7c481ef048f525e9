#include "components/io/ethercat/master/topology.h"

#include <string>

#include "models/foundation/support/error.h"

namespace cotwin::ethercat {

namespace {

/// Order in which a frame visits the ports of a slave, from the port where it came in.
constexpr std::array<std::array<int, 4>, 4> kOrderFromEntry = {{{0, 3, 1, 2}, {1, 2, 0, 3}, {2, 0, 3, 1}, {3, 1, 2, 0}}};

/// The port where the frame came in: that with the earliest time stamp, port 0 for a slave without a clock.
int entry_of(const SlavePorts& slave) {
  if (!slave.has_clock) return 0;
  int entry = -1;
  for (int port = 0; port < 4; ++port) {
    if (!is_open(slave.dl_status, port)) continue;
    const auto time = [&](int p) { return slave.receive_times[static_cast<std::size_t>(p)]; };
    // The counter may wrap between two ports.
    if (entry < 0 || static_cast<std::int32_t>(time(port) - time(entry)) < 0) entry = port;
  }
  return entry < 0 ? 0 : entry;
}

/// The open port that a frame visits before `port`.
int previous_port(const SlavePorts& slave, int entry, int port) {
  int previous = entry;
  for (const int p : kOrderFromEntry[static_cast<std::size_t>(entry)]) {
    if (p == port) break;
    if (is_open(slave.dl_status, p)) previous = p;
  }
  return previous;
}

int last_port(const SlavePorts& slave, int entry) {
  int last = entry;
  for (const int p : kOrderFromEntry[static_cast<std::size_t>(entry)]) {
    if (is_open(slave.dl_status, p)) last = p;
  }
  return last;
}

}  // namespace

std::vector<Place> find_topology(std::span<const SlavePorts> slaves) {
  std::vector<Place> places(slaves.size());
  std::vector<std::uint8_t> used(slaves.size());  // ports that lead to a found neighbour, one bit each
  for (std::size_t i = 0; i < slaves.size(); ++i) {
    Place& place = places[i];
    place.entry_port = entry_of(slaves[i]);
    if (i == 0) continue;
    // Slaves are numbered depth first: the next one is at the deepest slave that still has an open port.
    int parent = static_cast<int>(i) - 1;
    for (; parent >= 0 && place.parent < 0; parent = places[static_cast<std::size_t>(parent)].parent) {
      const auto p = static_cast<std::size_t>(parent);
      for (const int port : kOrderFromEntry[static_cast<std::size_t>(places[p].entry_port)]) {
        if (port == places[p].entry_port || !is_open(slaves[p].dl_status, port) || (used[p] >> port & 1) != 0) continue;
        place.parent = parent;
        place.parent_port = port;
        used[p] = static_cast<std::uint8_t>(used[p] | 1 << port);
        break;
      }
    }
    if (place.parent < 0) {
      throw Error("EtherCAT",
                  "slave " + std::to_string(i) +
                      " answers, but no slave before it has a free port with a cable; expected one: is a port switched off or "
                      "a cable loose?");
    }
  }
  return places;
}

std::vector<std::uint32_t> propagation_delays(std::span<const SlavePorts> slaves, std::span<const Place> places) {
  std::vector<std::uint32_t> delays(slaves.size(), 0);
  for (std::size_t i = 1; i < slaves.size(); ++i) {
    if (!slaves[i].has_clock) continue;
    std::size_t child = i;  // of the parent with a clock: i, or a slave without a clock on the way to it
    int parent = places[i].parent;
    while (parent >= 0 && !slaves[static_cast<std::size_t>(parent)].has_clock) {
      child = static_cast<std::size_t>(parent);
      parent = places[child].parent;
    }
    if (parent < 0) continue;  // the first slave with a clock
    const auto p = static_cast<std::size_t>(parent);
    const auto time = [](const SlavePorts& slave, int port) { return slave.receive_times[static_cast<std::size_t>(port)]; };
    const int entry = places[p].entry_port, port = places[child].parent_port, before = previous_port(slaves[p], entry, port);
    const auto earlier = static_cast<std::int32_t>(time(slaves[p], before) - time(slaves[p], entry));
    const auto loop = static_cast<std::int32_t>(time(slaves[p], port) - time(slaves[p], before));
    const auto through = static_cast<std::int32_t>(time(slaves[i], last_port(slaves[i], places[i].entry_port)) -
                                                   time(slaves[i], places[i].entry_port));
    const std::int32_t way = (loop - through) / 2;
    delays[i] =
        delays[p] + static_cast<std::uint32_t>(earlier > 0 ? earlier : 0) + static_cast<std::uint32_t>(way > 0 ? way : 0);
  }
  return delays;
}

}  // namespace cotwin::ethercat
