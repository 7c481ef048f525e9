#include "components/io/ethercat/master/raw_wire.h"

#include <chrono>

#include "components/io/ethercat/frame.h"

namespace cotwin::ethercat {

RawWire::RawWire(const std::string& interface, const std::string& place) : socket_(interface, kEtherType, place) {}

std::int64_t RawWire::now() const {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::size_t RawWire::receive(std::span<std::uint8_t> buffer, std::int64_t deadline) {
  for (bool waited = false;; waited = true) {
    while (const std::optional<net::RawSocket::Received> received = socket_.receive(buffer)) {
      if (received->size == 0 || received->size > buffer.size()) continue;
      received_at_ = received->arrival;
      return received->size;
    }
    // After one wait the deadline is over, or a signal has come, about which the caller decides.
    if (waited || now() >= deadline) return 0;
    socket_.wait(deadline);
  }
}

}  // namespace cotwin::ethercat
