#include "components/io/ethercat/master/exchange.h"

#include <algorithm>
#include <string>

#include "models/foundation/support/error.h"

namespace cotwin::ethercat {

std::optional<std::uint16_t> Exchange::transfer(Command command, std::uint32_t address, std::span<std::uint8_t> data) {
  for (int attempt = 0; attempt < options_.attempts; ++attempt) {
    FrameWriter writer(sent_);
    writer.begin();
    if (!writer.add(command, ++index_, address, data)) {
      throw Error("EtherCAT",
                  "a datagram of " + std::to_string(data.size()) + " bytes, expected at most " + std::to_string(kLongestData));
    }
    const std::int64_t deadline = wire_.now() + options_.timeout;
    wire_.send(writer.finish());
    do {  // a wait may end early by a signal
      const std::size_t size = wire_.receive(received_, deadline);
      if (size == 0) continue;
      FrameReader reader(std::span<const std::uint8_t>(received_).first(size));
      Datagram d;
      // Answers to earlier attempts, and frames of others, are passed over.
      if (!reader.next(d) || d.index != index_ || d.command != command || d.length != data.size() ||
          d.offset() != static_cast<std::uint16_t>(address >> 16))
        continue;
      const std::span<const std::uint8_t> answer = reader.data(d);
      std::copy(answer.begin(), answer.end(), data.begin());
      return d.working_counter;
    } while (wire_.now() < deadline);
  }
  return std::nullopt;
}

bool Exchange::confirm(Command command, std::uint32_t address, std::span<std::uint8_t> data) {
  const bool writes = command == Command::kFpwr || command == Command::kApwr;
  const std::span<std::uint8_t> before = std::span(before_).first(data.size());
  std::ranges::copy(data, before.begin());
  bool known = writes;
  for (int n = 0; n < kMostRequests; ++n) {
    if (writes) std::ranges::copy(before, data.begin());
    if (transfer(command, address, data) != 1) continue;
    if (known && std::ranges::equal(data, before)) return true;
    if (writes) continue;
    std::ranges::copy(data, before.begin());
    known = true;
  }
  return false;
}

void Exchange::clear(std::uint16_t offset, std::size_t bytes) {
  std::array<std::uint8_t, 256> zeros{};
  transfer(Command::kBwr, at_position(0, offset), std::span<std::uint8_t>(zeros).first(bytes));
}

}  // namespace cotwin::ethercat
