#include "components/io/ethercat/master/raw_wire.h"

#include <poll.h>
#include <time.h>

#include "components/io/ethercat/frame.h"

namespace cotwin::ethercat {

RawWire::RawWire(const std::string& interface, const std::string& place) : socket_(interface, kEtherType, place) {}

std::int64_t RawWire::now() const {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<std::int64_t>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
}

std::size_t RawWire::receive(std::span<std::uint8_t> buffer, std::int64_t deadline) {
  for (;;) {
    while (const std::optional<net::RawSocket::Received> received = socket_.receive(buffer)) {
      if (received->size > 0 && received->size <= buffer.size()) return received->size;
    }
    const std::int64_t left = deadline - now();
    if (left <= 0) return 0;
    pollfd poll{socket_.descriptor(), POLLIN, 0};
    const timespec timeout{left / 1'000'000'000, left % 1'000'000'000};
    if (ppoll(&poll, 1, &timeout, nullptr) < 0) return 0;  // a signal: the caller looks what it wants to do
  }
}

}  // namespace cotwin::ethercat
