#pragma once
#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <vector>

#include "components/io/emulators/ethercat/bus.h"
#include "components/io/ethercat/frame.h"
#include "components/io/ethercat/little_endian.h"
#include "components/io/ethercat/registers.h"

namespace cotwin::ethercat {

/// A master's hand on an emulated bus: one datagram per frame, one frame per microsecond.
class BusWire {
 public:
  struct Answer {
    int count = -1;  // working counter; -1: no frame came back
    std::vector<std::uint8_t> data;
    std::uint16_t position = 0, irq = 0;

    std::uint64_t value() const {
      std::uint64_t v = 0;
      for (std::size_t i = 0; i < std::min<std::size_t>(8, data.size()); ++i)
        v |= static_cast<std::uint64_t>(data[i]) << (8 * i);
      return v;
    }
  };

  explicit BusWire(Bus& b) : bus(b) {}

  Answer send(Command command, std::uint32_t address, std::vector<std::uint8_t> data) {
    FrameWriter writer(buffer_);
    writer.begin();
    const std::size_t at = writer.add(command, 1, address, data.size());
    std::copy(data.begin(), data.end(), buffer_ + at);
    const std::size_t size = writer.finish().size();
    now += 1000;
    Answer answer;
    const auto back = bus.transmit({buffer_, size}, now);
    if (!back) return answer;
    arrival = *back;
    Datagram d;
    FrameReader reader({buffer_, size});
    reader.next(d);
    answer.count = d.working_counter;
    answer.data.assign(reader.data(d).begin(), reader.data(d).end());
    answer.position = d.station();
    answer.irq = d.irq;
    return answer;
  }
  Answer read(std::uint16_t station, std::uint16_t offset, std::size_t size) {
    return send(Command::kFprd, at_station(station, offset), std::vector<std::uint8_t>(size));
  }
  template <class T>
  int write(std::uint16_t station, std::uint16_t offset, T value) {
    std::vector<std::uint8_t> data(sizeof value);
    store(data.data(), value);
    return send(Command::kFpwr, at_station(station, offset), data).count;
  }
  int write_bytes(std::uint16_t station, std::uint16_t offset, std::vector<std::uint8_t> data) {
    return send(Command::kFpwr, at_station(station, offset), std::move(data)).count;
  }
  /// Stations 0x1001, 0x1002, … in the order of the bus.
  void number_stations() {
    for (std::uint16_t n = 0; n < bus.size(); ++n) {
      const auto station = static_cast<std::uint16_t>(0x1001 + n);
      send(Command::kApwr, at_position(n, reg::kStation),
           {static_cast<std::uint8_t>(station), static_cast<std::uint8_t>(station >> 8)});
    }
  }
  std::uint16_t request(std::uint16_t station, State state, bool acknowledge = false) {
    write(station, reg::kAlControl,
          static_cast<std::uint16_t>(static_cast<unsigned>(state) | (acknowledge ? kStateError : 0u)));
    return status(station);
  }
  std::uint16_t status(std::uint16_t station) { return static_cast<std::uint16_t>(read(station, reg::kAlStatus, 2).value()); }
  AlCode code(std::uint16_t station) { return static_cast<AlCode>(read(station, reg::kAlStatusCode, 2).value()); }
  /// Sets sync manager n of a slave.
  int set_sync_manager(std::uint16_t station, int n, std::uint16_t start, std::uint16_t length, std::uint8_t control) {
    std::vector<std::uint8_t> r(8);
    store(&r[0], start);
    store(&r[2], length);
    r[4] = control;
    r[6] = sync_manager::kEnabled;
    const auto at = static_cast<std::uint16_t>(reg::kSyncManager + 8 * n);
    write_bytes(station, at, std::vector<std::uint8_t>(8));
    return write_bytes(station, at, r);
  }
  /// The sync managers as the SII of slave n has them, with lengths of `outputs` and `inputs` bytes where not 0.
  void set_sync_managers(std::size_t n, std::uint16_t outputs = 0, std::uint16_t inputs = 0) {
    const auto station = static_cast<std::uint16_t>(0x1001 + n);
    int number = 0;
    for (const SiiSyncManager& s : bus.slave(n).sii().sync_managers) {
      std::uint16_t length = s.length;
      if (s.type == SyncManagerType::kOutputs && outputs != 0) length = outputs;
      if (s.type == SyncManagerType::kInputs && inputs != 0) length = inputs;
      set_sync_manager(station, number++, s.start, length, s.control);
    }
  }
  int set_fmmu(std::uint16_t station, int n, std::uint32_t logical, std::uint16_t length, int first_bit, int last_bit,
               std::uint16_t physical, int physical_bit, std::uint8_t type) {
    std::vector<std::uint8_t> r(16);
    store(&r[0], logical);
    store(&r[4], length);
    r[6] = static_cast<std::uint8_t>(first_bit);
    r[7] = static_cast<std::uint8_t>(last_bit);
    store(&r[8], physical);
    r[10] = static_cast<std::uint8_t>(physical_bit);
    r[11] = type;
    r[12] = 1;
    return write_bytes(station, static_cast<std::uint16_t>(reg::kFmmu + 16 * n), r);
  }

  Bus& bus;
  std::int64_t now = 0;      // ns
  std::int64_t arrival = 0;  // of the last answer

 private:
  std::uint8_t buffer_[kLongestFrame] = {};
};

}  // namespace cotwin::ethercat
