#pragma once
#include <string>

#include "components/io/ethercat/master/wire.h"
#include "models/foundation/net/raw_socket.h"

namespace cotwin::ethercat {

/// A network interface to which the bus is connected. Time is CLOCK_MONOTONIC.
class RawWire final : public Wire {
 public:
  /// Throws Error at `place` as RawSocket does.
  RawWire(const std::string& interface, const std::string& place);

  bool send(std::span<const std::uint8_t> frame) override { return socket_.send(frame); }
  std::size_t receive(std::span<std::uint8_t> buffer, std::int64_t deadline) override;
  std::int64_t now() const override;
  std::int64_t received_at() const override { return received_at_; }

 private:
  net::RawSocket socket_;
  std::int64_t received_at_ = 0;
};

}  // namespace cotwin::ethercat
