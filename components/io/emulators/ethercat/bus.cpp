#include "components/io/emulators/ethercat/bus.h"

#include <string>

#include "models/foundation/support/error.h"

namespace cotwin::ethercat {

namespace {

constexpr int kOrderOfPorts[] = {3, 1, 2};         // of the ports behind the processing unit
constexpr std::int64_t kByteTime = 80;             // ns at 100 Mbit/s
constexpr std::int64_t kPreambleAndCheck = 8 + 4;  // bytes around a frame

}  // namespace

Slave& Bus::append(std::unique_ptr<Slave> slave, const Connection& connection) {
  const std::size_t n = nodes_.size();
  const std::string place = "slave " + std::to_string(n);
  if (n != 0) {
    if (connection.parent >= n)
      throw Error(place, "behind slave " + std::to_string(connection.parent) + ", expected one before it");
    if (connection.port < 1 || connection.port >= kPorts) {
      throw Error(place, "at port " + std::to_string(connection.port) + ", expected 1, 2 or 3");
    }
    auto& child = nodes_[connection.parent].children[static_cast<std::size_t>(connection.port)];
    if (child) {
      throw Error(place, "port " + std::to_string(connection.port) + " of slave " + std::to_string(connection.parent) +
                             " is taken by slave " + std::to_string(*child));
    }
    child = n;
  }
  nodes_.push_back({std::move(slave), connection, {}});
  update_links();
  return *nodes_.back().slave;
}

Slave& Bus::append(std::unique_ptr<Slave> slave) {
  Connection connection;
  connection.parent = nodes_.empty() ? 0 : nodes_.size() - 1;
  return append(std::move(slave), connection);
}

bool Bus::connected(std::size_t n) const {
  const Node& node = nodes_[n];
  return node.on && !node.cut && (n == 0 || nodes_[node.connection.parent].on);
}

void Bus::update_links() {
  for (std::size_t n = 0; n < nodes_.size(); ++n) {
    const Node& node = nodes_[n];
    node.slave->esc().set_link(0, connected(n));
    for (int p = 1; p < kPorts; ++p) {
      const auto child = node.children[static_cast<std::size_t>(p)];
      node.slave->esc().set_link(p, child && connected(*child));
    }
  }
}

std::optional<std::int64_t> Bus::transmit(std::span<std::uint8_t> frame, std::int64_t now) {
  damage_ = false;
  if (nodes_.empty() || !connected(0)) return std::nullopt;
  const auto returned = pass(0, frame, now + nodes_[0].connection.cable);
  damaged_.reset();
  if (damage_ || !returned) return std::nullopt;
  return *returned + nodes_[0].connection.cable + (static_cast<std::int64_t>(frame.size()) + kPreambleAndCheck) * kByteTime;
}

/// The frame arrives at port 0 of slave n. Returns when it leaves there; none if it was dropped.
std::optional<std::int64_t> Bus::pass(std::size_t n, std::span<std::uint8_t> frame, std::int64_t now) {
  Node& node = nodes_[n];
  Esc& esc = node.slave->esc();
  if (!esc.port_open(0)) return std::nullopt;
  const bool intact = damaged_ != n && !damage_;
  if (!intact) {
    esc.count_damaged(!damage_);
    damage_ = true;
    node.slave->advance(now);
  } else if (!node.slave->process(frame, now)) {
    return std::nullopt;
  }
  std::int64_t t = now + node.connection.forward;
  for (const int p : kOrderOfPorts) {
    const auto child = node.children[static_cast<std::size_t>(p)];
    if (!esc.port_open(p)) continue;
    if (!child || !connected(*child)) return std::nullopt;  // the port was opened by force
    const std::int64_t cable = nodes_[*child].connection.cable;
    const auto back = pass(*child, frame, t + cable);
    if (!back) return std::nullopt;
    if (intact) esc.frame_returned(p, *back + cable);
    t = *back + cable + node.connection.backward;
  }
  return t;
}

void Bus::advance(std::int64_t now) {
  for (Node& node : nodes_) {
    if (node.on) node.slave->advance(now);
  }
}

void Bus::cut(std::size_t n, bool cut) {
  nodes_[n].cut = cut;
  update_links();
}

void Bus::power(std::size_t n, bool on, std::int64_t now) {
  Node& node = nodes_[n];
  if (on && !node.on) node.slave->power_on(now);
  node.on = on;
  update_links();
}

std::int64_t Bus::delay_to(std::size_t n) const {
  std::int64_t sum = 0;
  while (n != 0) {
    const Connection& c = nodes_[n].connection;
    const Node& parent = nodes_[c.parent];
    sum += c.cable + parent.connection.forward;
    for (const int p : kOrderOfPorts) {
      if (p == c.port) break;
      const auto sibling = parent.children[static_cast<std::size_t>(p)];
      if (sibling && connected(*sibling)) sum += loop_of(*sibling) + parent.connection.backward;
    }
    n = c.parent;
  }
  return sum;
}

/// From the port of the parent through slave n, all behind it, and back.
std::int64_t Bus::loop_of(std::size_t n) const {
  const Node& node = nodes_[n];
  std::int64_t sum = 2 * node.connection.cable + node.connection.forward;
  for (const int p : kOrderOfPorts) {
    const auto child = node.children[static_cast<std::size_t>(p)];
    if (child && connected(*child)) sum += loop_of(*child) + node.connection.backward;
  }
  return sum;
}

}  // namespace cotwin::ethercat
