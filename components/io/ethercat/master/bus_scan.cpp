#include <array>

#include "components/io/ethercat/master/bus_setup.h"
#include "models/foundation/support/error.h"

namespace cotwin::ethercat {

namespace {

constexpr std::uint16_t kFirstStation = 0x1001;
constexpr int kLeastAttempts = 3;
constexpr int kMostCounts = 12;                       // of the slaves, until two are the same
constexpr std::size_t kLargestImage = 32'768;         // bytes of an SII
constexpr std::int64_t kSiiPatience = 1'000'000'000;  // ns that a slave may be busy with its EEPROM

/// Reads 4 or 8 bytes of the SII at a word address.
std::size_t read_sii_words(Exchange& exchange, std::uint16_t station, std::uint32_t word, std::span<std::uint8_t, 8> to,
                           const std::string& place) {
  const auto wait = [&]() -> std::uint16_t {
    const std::int64_t end = exchange.wire().now() + kSiiPatience;
    do {
      const std::optional<std::uint16_t> status = exchange.read<std::uint16_t>(station, reg::kSiiControl);
      if (!status) throw Error(place, "does not answer while its SII is read");
      if ((*status & sii_control::kBusy) == 0) return *status;
    } while (exchange.wire().now() < end);
    throw Error(place, "its EEPROM interface stays busy, expected it to be ready within 1 s");
  };
  wait();
  std::uint16_t status = 0;
  // After power-on the controller loads the EEPROM itself and refuses commands for a while.
  const std::int64_t end = exchange.wire().now() + kSiiPatience;
  do {
    std::array<std::uint8_t, 6> request{};
    store(request.data(), sii_control::kRead);
    store(request.data() + 2, word);
    if (!exchange.confirm(Command::kFpwr, at_station(station, reg::kSiiControl), request)) {
      throw Error(place, "does not take requests to read its SII");
    }
    status = wait();
  } while ((status & sii_control::kErrors) != 0 && exchange.wire().now() < end);
  if ((status & sii_control::kErrors) != 0) {
    throw Error(place, "reports an error for 1 s when its SII is read: is its EEPROM empty?");
  }
  const std::size_t bytes = (status & sii_control::kReads8Bytes) != 0 ? 8 : 4;
  if (!exchange.confirm(Command::kFprd, at_station(station, reg::kSiiData), to.first(bytes))) {
    throw Error(place, "does not answer while its SII is read");
  }
  return bytes;
}

void reset_slaves(Exchange& exchange) {
  exchange.broadcast<std::uint16_t>(reg::kStation, 0);  // those of another master: two slaves would answer under one
  exchange.broadcast<std::uint8_t>(reg::kAliasControl, 0);
  exchange.broadcast<std::uint16_t>(reg::kAlControl, static_cast<std::uint16_t>(State::kInit) | kStateError);
  exchange.broadcast<std::uint8_t>(reg::kPortControl, 0);
  exchange.broadcast<std::uint16_t>(reg::kEventMask, event::kDlStatus);
  exchange.clear(reg::kErrorCounters, 8);
  exchange.clear(reg::kFmmu, 16 * reg::kFmmuSize);
  exchange.clear(reg::kSyncManager, 16 * reg::kSyncManagerSize);
  exchange.clear(reg::kActivation, 1);
  exchange.clear(reg::kSystemTime, 4);
  exchange.broadcast<std::uint16_t>(reg::kSpeedCounterStart, 0x1000);
  exchange.broadcast<std::uint16_t>(reg::kDifferenceFilter, 0x0c00);
  // The EEPROM goes to the master, taken from the slave's application by force first.
  exchange.broadcast<std::uint8_t>(reg::kSiiConfig, 2);
  exchange.broadcast<std::uint8_t>(reg::kSiiConfig, 0);
}

}  // namespace

std::vector<std::uint8_t> read_sii_image(Exchange& exchange, std::uint16_t station, const std::string& place) {
  std::vector<std::uint8_t> image;
  std::array<std::uint8_t, 8> part{};
  const auto extend = [&](std::size_t bytes) {
    while (image.size() < bytes) {
      const std::size_t n = read_sii_words(exchange, station, static_cast<std::uint32_t>(image.size() / 2), part, place);
      image.insert(image.end(), part.begin(), part.begin() + static_cast<std::ptrdiff_t>(n));
    }
  };
  extend(128);
  // The size in the image is not always right, so the categories are followed up to their end.
  for (std::size_t at = 128; at + 4 <= kLargestImage;) {
    extend(at + 2);
    if (load<std::uint16_t>(image.data() + at) == 0xffff) {
      image.resize(at + 2);
      return image;
    }
    extend(at + 4);
    at += 4 + 2 * std::size_t{load<std::uint16_t>(image.data() + at + 2)};
    if (at <= kLargestImage) extend(at);
  }
  throw Error(place, "the categories of its SII have no end within " + std::to_string(kLargestImage) + " bytes");
}

std::vector<FoundSlave> scan_bus(Exchange& exchange, const std::string& place, std::int64_t wait) {
  std::uint8_t type = 0;
  const std::int64_t end = exchange.wire().now() + wait;
  std::optional<std::uint16_t> count;
  int attempts = 0;
  do {
    count = exchange.transfer(Command::kBrd, at_position(0, reg::kType), type);
  } while (count.value_or(0) == 0 && (exchange.wire().now() < end || ++attempts < kLeastAttempts));
  if (count.value_or(0) > 0) {
    reset_slaves(exchange);
    std::optional<std::uint16_t> before;
    for (int n = 0; n < kMostCounts && (n == 0 || count != before); ++n) {  // a damaged frame may give another number
      before = count;
      count = exchange.transfer(Command::kBrd, at_position(0, reg::kType), type);
    }
  }
  if (!count) throw Error(place, "no frame comes back, expected an EtherCAT bus that is switched on");
  if (*count == 0) throw Error(place, "frames come back unread, expected at least one EtherCAT slave");
  std::vector<FoundSlave> slaves(*count);
  for (std::size_t i = 0; i < slaves.size(); ++i) {
    FoundSlave& slave = slaves[i];
    const auto position = static_cast<std::uint16_t>(i);
    slave.station = static_cast<std::uint16_t>(kFirstStation + i);
    std::array<std::uint8_t, 2> station;
    store(station.data(), slave.station);
    if (!exchange.confirm(Command::kApwr, at_position(position, reg::kStation), station)) {
      throw Error(position_of(place, i), "does not take a station address");
    }
    const auto read = [&]<class T>(T& value, std::uint16_t offset) {
      const std::optional<T> answer = exchange.read<T>(slave.station, offset);
      if (!answer) throw Error(position_of(place, i), "does not answer under its station address");
      value = *answer;
    };
    read(slave.features, reg::kFeatures);
    read(slave.fmmus, reg::kFmmuCount);
    read(slave.sync_managers, reg::kSyncManagerCount);
    read(slave.ports.dl_status, reg::kDlStatus);
    slave.ports.has_clock = (slave.features & feature::kClock) != 0;
    slave.image = read_sii_image(exchange, slave.station, position_of(place, i));
    slave.sii = read_sii(slave.image, position_of(place, i) + ", SII");
  }
  return slaves;
}

}  // namespace cotwin::ethercat
