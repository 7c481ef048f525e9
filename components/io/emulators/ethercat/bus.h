#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "components/io/emulators/ethercat/slave.h"

namespace cotwin::ethercat {

/// How a slave is connected to the slave before it.
struct Connection {
  std::size_t parent = 0;       // number of the slave before it; ignored for the first slave
  int port = 1;                 // of the parent: 1, 2 or 3
  std::int64_t cable = 10;      // ns: delay of the cable, 5.3 ns per metre
  std::int64_t forward = 290;   // ns: delay of this slave from port 0 through its processing unit
  std::int64_t backward = 290;  // ns: delay of this slave from another port to the next open port
};

/// An emulated bus: a tree of slaves behind the master's port. A frame visits the slaves in the order of real ones: in at port 0,
/// through the processing unit, then out and back at ports 3, 1 and 2, then out at port 0. All times are ns of simulated time, given by
/// the caller, and must not decrease. Allocates only in append().
class Bus {
 public:
  /// Adds a slave that is switched on and connected. Throws Error if the place is taken or does not exist.
  Slave& append(std::unique_ptr<Slave> slave, const Connection& connection);
  /// Adds it behind the last slave, at port 1.
  Slave& append(std::unique_ptr<Slave> slave);

  std::size_t size() const { return nodes_.size(); }
  Slave& slave(std::size_t n) { return *nodes_[n].slave; }
  const Slave& slave(std::size_t n) const { return *nodes_[n].slave; }

  /// Sends a frame at `now`, which is changed in place. Returns when its last bit comes back; none if it does not.
  std::optional<std::int64_t> transmit(std::span<std::uint8_t> frame, std::int64_t now);
  /// All slaves that are switched on, at `now`, without a frame.
  void advance(std::int64_t now);

  /// Cuts or restores the cable before slave n. Both neighbours close or open their ports.
  void cut(std::size_t n, bool cut);
  /// Switches slave n off or on. It loses its state, and the slaves behind it are not reached.
  void power(std::size_t n, bool on, std::int64_t now);
  /// The next frame is damaged on the cable before slave n: slaves count it, nothing comes back to the master.
  void damage_next(std::size_t n) { damaged_ = n; }
  /// Delay of a frame from the first slave to slave n, ns: what register 0x0928 should be if the first slave is the reference.
  std::int64_t delay_to(std::size_t n) const;

 private:
  struct Node {
    std::unique_ptr<Slave> slave;
    Connection connection;
    std::array<std::optional<std::size_t>, kPorts> children;
    bool cut = false, on = true;
  };
  std::optional<std::int64_t> pass(std::size_t n, std::span<std::uint8_t> frame, std::int64_t now);
  bool connected(std::size_t n) const;
  std::int64_t loop_of(std::size_t n) const;
  void update_links();

  std::vector<Node> nodes_;
  std::optional<std::size_t> damaged_;
  bool damage_ = false;  // the frame on the bus is damaged
};

}  // namespace cotwin::ethercat
