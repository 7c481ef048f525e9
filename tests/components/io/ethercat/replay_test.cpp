// The requests of captured masters, sent to an emulated bus of the same slaves: the answers are those of the real slaves.
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/bus.h"
#include "components/io/emulators/ethercat/slave.h"
#include "components/io/ethercat/frame.h"
#include "components/io/ethercat/registers.h"
#include "tests/components/io/ethercat/captures.h"

namespace cotwin::ethercat::replay_test {
namespace {

using Bytes = std::vector<std::uint8_t>;

SlaveOptions options(std::uint8_t fmmus, ClockUnit clock, std::uint16_t features, std::uint8_t ports) {
  SlaveOptions o;
  o.esc.fmmus = fmmus;
  o.esc.sync_managers = fmmus == 8 ? 8 : 4;
  o.esc.clock_unit = clock;
  o.esc.features = features;
  o.esc.ports = ports;
  return o;
}

void append(Bus& bus, const std::string& dump, const SlaveOptions& o) {
  bus.append(std::make_unique<Slave>(file_bytes(captures_folder() + "/sii_dumps/" + dump), o));
}

/// Compares the answers of the bus with the captured ones: working counter, position, and data where `compare` is true.
template <class Compare>
int replay(const std::string& file, Bus& bus, Compare compare) {
  std::map<int, Bytes> answers;  // by the index of the first datagram
  std::int64_t now = 0;
  int compared = 0;
  for (const Captured& packet : read_pcapng(captures_folder() + "/" + file)) {
    if (!packet.is_ethercat()) continue;
    const int index = packet.frame[17];
    if (!packet.returned()) {
      Bytes frame = packet.frame;
      EXPECT_TRUE(bus.transmit(frame, now += 100'000).has_value());
      answers[index] = frame;
      continue;
    }
    FrameReader real(packet.frame), ours(answers[index]);
    Datagram r, o;
    while (real.next(r)) {
      EXPECT_TRUE(ours.next(o));
      const auto place = ::testing::Message() << file << " index " << index << ", command " << static_cast<int>(r.command)
                                              << " at " << std::hex << r.address;
      EXPECT_EQ(o.working_counter, r.working_counter) << place;
      EXPECT_EQ(o.address, r.address) << place;
      const auto a = real.data(r), b = ours.data(o);
      if (compare(r)) {
        EXPECT_EQ(Bytes(a.begin(), a.end()), Bytes(b.begin(), b.end())) << place;
      }
      ++compared;
      if (::testing::Test::HasFailure()) return compared;
    }
  }
  return compared;
}

bool is_register(const Datagram& d, std::uint16_t offset) { return d.command == Command::kFprd && d.offset() == offset; }

bool known(const Datagram& d) {
  return d.working_counter != 0 &&
         (is_register(d, reg::kStation) || is_register(d, reg::kAlias) || is_register(d, reg::kDlStatus) ||
          is_register(d, reg::kFeatures) || is_register(d, reg::kSiiData) || is_register(d, reg::kFmmu) ||
          is_register(d, reg::kFmmu + 16) || is_register(d, reg::kPdiControl));
}

TEST(Replay, ATerminalStackAnswersAsTheRealOne) {
  for (const char* const file : {"replay-ek1100-el2828-el2889.pcapng", "replay-dc.pcapng"}) {
    if (!std::filesystem::exists(captures_folder() + "/" + file)) GTEST_SKIP() << "needs scripts/fetch_logs.py --tests";
    Bus bus;
    append(bus, "ek1100.hex", options(3, ClockUnit::kFull, 0x00fc, 0x3b));
    append(bus, "el2828.hex", options(8, ClockUnit::kReceiveTimes, 0x01fc, 0x0a));
    append(bus, "el2889.hex", options(3, ClockUnit::kFull, 0x00fc, 0x0a));
    const int compared = replay(file, bus, known);
    EXPECT_GT(compared, 1700);
  }
}

TEST(Replay, AnotherMasterFindsTheSameBus) {
  const char* const file = "soem-sdinfo-ek1100-el1004.pcapng";
  if (!std::filesystem::exists(captures_folder() + "/" + file)) GTEST_SKIP() << "needs scripts/fetch_logs.py --tests";
  Bus bus;
  append(bus, "ek1100.hex", options(3, ClockUnit::kFull, 0x00fc, 0x3b));
  // EL1004: no dump of it is there; its registers are like those of other digital terminals.
  append(bus, "el2004-eeprom-dump.bin", options(3, ClockUnit::kReceiveTimes, 0x01fc, 0x4a));
  EXPECT_EQ(replay(file, bus, [](const Datagram& d) { return known(d) && d.offset() != reg::kSiiData; }), 290);
}

}  // namespace
}  // namespace cotwin::ethercat::replay_test
