#include "components/io/emulators/ethercat/esc.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/devices.h"
#include "models/foundation/support/error.h"
#include "tests/components/io/ethercat/wire.h"
#include "tests/support/allocations.h"

namespace cotwin::ethercat::esc_test {
namespace {

using Bytes = std::vector<std::uint8_t>;
using ::testing::ElementsAre;

constexpr std::uint16_t kFirst = 0x1001;  // station of the first slave

/// A bus of the four devices.
struct Cell {
  Cell() {
    bus.append(std::make_unique<Ek1100>());
    inputs = static_cast<El1809*>(&bus.append(std::make_unique<El1809>()));
    outputs = static_cast<El2809*>(&bus.append(std::make_unique<El2809>()));
    encoder = static_cast<El5101*>(&bus.append(std::make_unique<El5101>()));
    wire.number_stations();
  }
  Bus bus;
  El1809* inputs;
  El2809* outputs;
  El5101* encoder;
  BusWire wire{bus};
};

/// One slave with RAM, 8 FMMUs and 8 sync managers.
struct Single {
  explicit Single(const SlaveOptions& options = {}) {
    bus.append(std::make_unique<Slave>(write_sii(Sii{}), options));
    wire.number_stations();
  }
  Bus bus;
  BusWire wire{bus};
};

TEST(Controller, EveryCommandReachesTheSlavesOfItsTable) {
  Cell c;
  BusWire& w = c.wire;
  const auto position = [](std::uint16_t n) { return at_position(n, reg::kStation); };
  // AP: the slave that receives position 0; every slave counts up.
  auto a = w.send(Command::kAprd, position(2), Bytes(2));
  EXPECT_EQ(a.count, 1);
  EXPECT_EQ(a.value(), 0x1003u);
  EXPECT_EQ(a.position, static_cast<std::uint16_t>(-2 + 4));
  EXPECT_EQ(w.send(Command::kAprd, position(4), Bytes(2)).count, 0);
  EXPECT_EQ(w.send(Command::kAprw, at_position(1, reg::kProcessRam + 0x100), Bytes(2)).count, 3);
  // FP: not counted up.
  a = w.read(0x1002, reg::kStation, 2);
  EXPECT_EQ(a.count, 1);
  EXPECT_EQ(a.position, 0x1002);
  EXPECT_EQ(w.read(0x1009, reg::kStation, 2).count, 0);
  w.write(0x1002, reg::kProcessRam + 0x100, std::uint16_t{0x1234});
  a = w.send(Command::kFprw, at_station(0x1002, reg::kProcessRam + 0x100), {0x78, 0x56});
  EXPECT_EQ(a.count, 3);
  EXPECT_EQ(a.value(), 0x1234u);
  EXPECT_EQ(w.read(0x1002, reg::kProcessRam + 0x100, 2).value(), 0x5678u);
  // B: all; the data read are combined by OR: 0x1001 | 0x1002 | 0x1003 | 0x1004.
  a = w.send(Command::kBrd, position(0), Bytes(2));
  EXPECT_EQ(a.count, 4);
  EXPECT_EQ(a.value(), 0x1007u);
  EXPECT_EQ(a.position, 4);
  EXPECT_EQ(w.send(Command::kBwr, at_position(0, reg::kProcessRam + 0x100), Bytes(1)).count, 4);
  EXPECT_EQ(w.send(Command::kBrw, at_position(0, reg::kProcessRam + 0x100), Bytes(1)).count, 12);
  EXPECT_EQ(w.send(Command::kNop, position(0), Bytes(2)).count, 0);
  // ARMW, FRMW: one reads, the others write.
  w.write(0x1002, reg::kProcessRam + 0x200, std::uint16_t{0xbeef});
  a = w.send(Command::kFrmw, at_station(0x1002, reg::kProcessRam + 0x200), Bytes(2));
  EXPECT_EQ(a.count, 4);
  EXPECT_EQ(a.value(), 0xbeefu);
  EXPECT_EQ(w.read(0x1004, reg::kProcessRam + 0x200, 2).value(), 0xbeefu);
  EXPECT_EQ(w.read(0x1001, reg::kProcessRam + 0x200, 2).value(), 0u);  // before the one that was read
  a = w.send(Command::kArmw, at_position(0, reg::kProcessRam + 0x200), Bytes(2));
  EXPECT_EQ(a.count, 4);
  EXPECT_EQ(w.read(0x1004, reg::kProcessRam + 0x200, 2).value(), 0u);
}

TEST(Controller, TheAliasIsReachedOnlyWhenItIsSwitchedOn) {
  Sii sii;
  sii.alias = 77;
  Bus bus;
  bus.append(std::make_unique<Slave>(write_sii(sii)));
  BusWire w(bus);
  EXPECT_EQ(w.read(77, reg::kAlias, 2).count, 0);
  w.send(Command::kBwr, at_position(0, reg::kAliasControl), {1});
  EXPECT_EQ(w.read(77, reg::kAlias, 2).value(), 77u);
}

TEST(Controller, RegistersThatDoNotExistOrAreReadOnlyCountNothing) {
  Single s;
  EXPECT_EQ(s.wire.read(kFirst, 0x0020, 2).count, 0);
  EXPECT_EQ(s.wire.read(kFirst, 0x0fff + 1 + 8 * 1024, 2).count, 0);      // behind the RAM
  EXPECT_EQ(s.wire.read(kFirst, 0x0fff + 1 + 8 * 1024 - 2, 4).count, 1);  // half of it exists
  EXPECT_EQ(s.wire.write(kFirst, reg::kType, std::uint8_t{1}), 0);
  EXPECT_EQ(s.wire.write(kFirst, reg::kAlStatus, std::uint16_t{8}), 0);
  EXPECT_EQ(s.wire.write(kFirst, reg::kSystemTimeDifference, std::uint32_t{0}), 0);
  EXPECT_EQ(s.wire.read(kFirst, reg::kFmmu + 8 * 16, 16).count, 0);
  EXPECT_EQ(s.wire.read(kFirst, 0xffff, 2).count, 0);
  EXPECT_EQ(s.wire.read(kFirst, reg::kType, 1).value(), 0x11u);
}

TEST(Controller, TheImageOfTheSiiIsReadWordByWordAndWrittenWithPermission) {
  SlaveOptions options;
  options.esc.sii_time = 2500;
  Single s(options);
  BusWire& w = s.wire;
  const auto read_word = [&](std::uint32_t word) {
    Bytes request = {0x00, 0x01, 0, 0, 0, 0};
    store(&request[2], word);
    EXPECT_EQ(w.write_bytes(kFirst, reg::kSiiControl, request), 1);
    int polls = 0;
    while (w.read(kFirst, reg::kSiiControl, 2).value() & sii_control::kBusy) ++polls;
    EXPECT_EQ(polls, 2);  // busy for 2.5 µs, a frame per µs
    return w.read(kFirst, reg::kSiiData, 8).value();
  };
  const auto image = s.bus.slave(0).esc().sii();
  EXPECT_EQ(read_word(0x3e), load<std::uint64_t>(&image[0x7c]));
  EXPECT_EQ(w.read(kFirst, reg::kSiiControl, 2).value(), sii_control::kReads8Bytes);
  // Write the alias without and with permission, reload. The checksum must be written, too.
  Bytes bytes(image.begin(), image.end());
  bytes[8] = 9;
  const auto write_word = [&](std::uint16_t command, std::uint32_t word, std::uint8_t value) {
    Bytes request(8);
    store(&request[0], command);
    store(&request[2], word);
    request[6] = value;
    w.write_bytes(kFirst, reg::kSiiControl, request);
    w.now += 5000;
    return w.read(kFirst, reg::kSiiControl, 2).value();
  };
  EXPECT_TRUE(write_word(sii_control::kWrite, 4, 9) & sii_control::kWriteError);
  EXPECT_FALSE(write_word(sii_control::kWrite | 1, 4, 9) & sii_control::kWriteError);
  EXPECT_TRUE(write_word(sii_control::kReload, 0, 0) & sii_control::kChecksumError);
  write_word(sii_control::kWrite | 1, 7, sii_checksum(bytes));
  EXPECT_FALSE(write_word(sii_control::kReload, 0, 0) & sii_control::kChecksumError);
  EXPECT_EQ(w.read(kFirst, reg::kAlias, 2).value(), 9u);
  // Behind the end, and while the application has the SII.
  EXPECT_TRUE(write_word(sii_control::kRead, 0x7fffffff, 0) & sii_control::kCommandError);
  w.write(kFirst, reg::kSiiConfig, std::uint8_t{1});
  EXPECT_TRUE(write_word(sii_control::kRead, 0, 0) & sii_control::kCommandError);
}

TEST(Controller, AnImageWithAWrongChecksumIsNotLoaded) {
  Bytes image = write_sii(Sii{});
  image[14] ^= 1;
  Bus bus;
  bus.append(std::make_unique<Slave>(image));
  BusWire w(bus);
  w.number_stations();
  EXPECT_EQ(w.read(kFirst, reg::kSiiControl, 2).value(),
            sii_control::kReads8Bytes | sii_control::kChecksumError | sii_control::kNotLoaded);
  EXPECT_EQ(w.read(kFirst, reg::kDlStatus, 2).value() & 1, 0u);
}

// -------------------------------------------------------------------------------------------------------------------- FMMU

TEST(Controller, AnFmmuMapsBitsBothWays) {
  // Sweep over positions of up to 20 bits in the logical and the physical bytes; the reference is a loop over single bits.
  for (int first = 0; first < 8; ++first) {
    for (int physical = 0; physical < 8; ++physical) {
      for (const int bits : {1, 2, 7, 8, 9, 16, 20}) {
        const int end = first + bits - 1;
        Single s;
        BusWire& w = s.wire;
        w.set_fmmu(kFirst, 0, 0x10002, static_cast<std::uint16_t>(end / 8 + 1), first, end % 8, 0x1800, physical, fmmu::kRead);
        w.set_fmmu(kFirst, 1, 0x20002, static_cast<std::uint16_t>(end / 8 + 1), first, end % 8, 0x1900, physical, fmmu::kWrite);
        const Bytes stored = {0x35, 0xca, 0x93, 0x6e};
        w.write_bytes(kFirst, 0x1800, stored);
        w.write_bytes(kFirst, 0x1900, stored);
        const Bytes sent = {0xff, 0x00, 0x5a, 0xa5, 0x3c, 0xc3, 0x0f, 0xf0};
        const auto read = w.send(Command::kLrd, 0x10000, sent);
        const auto write = w.send(Command::kLwr, 0x20000, sent);
        EXPECT_EQ(read.count, 1);
        EXPECT_EQ(write.count, 1);
        EXPECT_EQ(write.data, sent);
        Bytes expected = sent, memory = stored;
        for (int i = 0; i < bits; ++i) {
          const auto copy = [](const Bytes& from, int f, Bytes& to, int t) {
            const int bit = from[static_cast<std::size_t>(f / 8)] >> (f % 8) & 1;
            auto& byte = to[static_cast<std::size_t>(t / 8)];
            byte = static_cast<std::uint8_t>((byte & ~(1 << t % 8)) | bit << t % 8);
          };
          copy(stored, physical + i, expected, 16 + first + i);
          copy(sent, 16 + first + i, memory, physical + i);
        }
        EXPECT_EQ(read.data, expected) << first << " " << physical << " " << bits;
        EXPECT_EQ(w.read(kFirst, 0x1900, 4).data, memory) << first << " " << physical << " " << bits;
      }
    }
  }
}

TEST(Controller, ADatagramThatCoversPartOfAnFmmuExchangesThatPart) {
  Single s;
  s.wire.set_fmmu(kFirst, 0, 100, 8, 0, 7, 0x1800, 0, fmmu::kRead | fmmu::kWrite);
  s.wire.write_bytes(kFirst, 0x1800, {1, 2, 3, 4, 5, 6, 7, 8});
  auto a = s.wire.send(Command::kLrd, 104, Bytes(8));
  EXPECT_THAT(a.data, ElementsAre(5, 6, 7, 8, 0, 0, 0, 0));
  a = s.wire.send(Command::kLrw, 98, {9, 9, 9, 9});
  EXPECT_EQ(a.count, 3);
  EXPECT_THAT(a.data, ElementsAre(9, 9, 1, 2));  // what was there before the write
  EXPECT_THAT(s.wire.read(kFirst, 0x1800, 3).data, ElementsAre(9, 9, 3));
  EXPECT_EQ(s.wire.send(Command::kLrw, 108, Bytes(4)).count, 0);
  EXPECT_EQ(s.wire.send(Command::kLrw, 0xffffffff, Bytes(4)).count, 0);
}

TEST(Controller, ReadsAndWritesOfSeveralFmmusCountOncePerDatagram) {
  Single s;
  for (int n = 0; n < 4; ++n) {
    s.wire.set_fmmu(kFirst, n, static_cast<std::uint32_t>(n), 1, 0, 7, static_cast<std::uint16_t>(0x1800 + 16 * n), 0,
                    n % 2 ? fmmu::kRead : fmmu::kWrite);
  }
  EXPECT_EQ(s.wire.send(Command::kLrw, 0, Bytes(4)).count, 3);
  EXPECT_EQ(s.wire.send(Command::kLrd, 0, Bytes(4)).count, 1);
  EXPECT_EQ(s.wire.send(Command::kLwr, 0, Bytes(4)).count, 1);
  EXPECT_EQ(s.wire.send(Command::kLrw, 0, Bytes(1)).count, 2);  // an output alone
  EXPECT_EQ(s.wire.send(Command::kLrw, 1, Bytes(1)).count, 1);  // an input alone
}

TEST(Controller, AControllerWithoutLrwIgnoresIt) {
  SlaveOptions options;
  options.esc.features |= feature::kNoLrw;
  Single s(options);
  s.wire.set_fmmu(kFirst, 0, 0, 1, 0, 7, 0x1800, 0, fmmu::kWrite);
  EXPECT_EQ(s.wire.send(Command::kLrw, 0, Bytes(1)).count, 0);
  EXPECT_EQ(s.wire.send(Command::kLwr, 0, Bytes(1)).count, 1);
}

// ----------------------------------------------------------------------------------------------------------- sync managers

TEST(Controller, ABufferIsPassedOnWithItsLastByte) {
  Single s;
  BusWire& w = s.wire;
  Esc& esc = s.bus.slave(0).esc();
  w.set_sync_manager(kFirst, 2, 0x1100, 4, 0x24);
  EXPECT_EQ(w.write_bytes(kFirst, 0x1102, {7}), 0);  // does not begin at the first byte
  EXPECT_EQ(w.write_bytes(kFirst, 0x1100, {1, 2}), 1);
  EXPECT_THAT(esc.outputs(2), ElementsAre(0, 0, 0, 0));
  EXPECT_EQ(w.write_bytes(kFirst, 0x1102, {3, 4}), 1);
  EXPECT_THAT(esc.outputs(2), ElementsAre(1, 2, 3, 4));
  EXPECT_EQ(w.read(kFirst, 0x1100, 4).count, 0);  // the other direction
  w.set_sync_manager(kFirst, 3, 0x1180, 3, 0x20);
  EXPECT_TRUE(esc.set_inputs(3, Bytes{5, 6, 7}));
  EXPECT_EQ(w.read(kFirst, 0x1180, 1).data[0], 5);
  EXPECT_TRUE(esc.set_inputs(3, Bytes{8, 9, 10}));
  EXPECT_THAT(w.read(kFirst, 0x1181, 2).data, ElementsAre(6, 7));  // the rest of the same buffer
  EXPECT_THAT(w.read(kFirst, 0x1180, 3).data, ElementsAre(8, 9, 10));
  EXPECT_EQ(w.write_bytes(kFirst, 0x1180, {1, 2, 3}), 0);
  EXPECT_FALSE(esc.set_inputs(3, Bytes{1, 2}));
}

TEST(Controller, ASyncManagerInUseKeepsItsSetUp) {
  Single s;
  s.wire.set_sync_manager(kFirst, 0, 0x1100, 4, 0x24);
  s.wire.write(kFirst, reg::kSyncManager, std::uint16_t{0x1200});
  EXPECT_EQ(s.wire.read(kFirst, reg::kSyncManager, 2).value(), 0x1100u);
  s.wire.write(kFirst, reg::kSyncManager + 6, std::uint8_t{0});
  s.wire.write(kFirst, reg::kSyncManager, std::uint16_t{0x1200});
  EXPECT_EQ(s.wire.read(kFirst, reg::kSyncManager, 2).value(), 0x1200u);
}

TEST(Controller, AMailboxIsFullUntilItIsRead) {
  Single s;
  BusWire& w = s.wire;
  Esc& esc = s.bus.slave(0).esc();
  w.set_sync_manager(kFirst, 0, 0x1000, 8, 0x26);
  w.set_sync_manager(kFirst, 1, 0x1080, 8, 0x22);
  const auto full = [&](int n) {
    return (w.read(kFirst, static_cast<std::uint16_t>(reg::kSyncManager + 8 * n + 5), 1).value() & 8) != 0;
  };
  EXPECT_EQ(w.write_bytes(kFirst, 0x1000, {1, 2, 3, 4, 5, 6, 7, 8}), 1);
  EXPECT_TRUE(full(0));
  EXPECT_EQ(w.write_bytes(kFirst, 0x1000, {9, 9, 9, 9, 9, 9, 9, 9}), 0);
  EXPECT_THAT(esc.read_mail(0), ElementsAre(1, 2, 3, 4, 5, 6, 7, 8));
  EXPECT_TRUE(esc.read_mail(0).empty());
  EXPECT_FALSE(full(0));
  EXPECT_EQ(w.read(kFirst, 0x1080, 8).count, 0);
  EXPECT_TRUE(esc.put_mail(1, Bytes{3, 2, 1}));
  EXPECT_FALSE(esc.put_mail(1, Bytes{4}));
  EXPECT_TRUE(full(1));
  const auto mail = w.read(kFirst, 0x1080, 8);
  EXPECT_EQ(mail.count, 1);
  EXPECT_THAT(mail.data, ElementsAre(3, 2, 1, 0, 0, 0, 0, 0));
  EXPECT_EQ(w.read(kFirst, 0x1080, 8).count, 0);
}

// -------------------------------------------------------------------------------------------------- watchdog and errors

TEST(Controller, TheWatchdogExpiresAfterItsTimeAndCounts) {
  Cell c;
  BusWire& w = c.wire;
  w.set_sync_managers(2);
  w.write_bytes(0x1003, reg::kDigitalOutputs, {1, 2});
  EXPECT_EQ(w.read(0x1003, reg::kWatchdogStatus, 2).value(), 1u);
  const std::int64_t triggered = w.now - 1000;
  // (0x09C2 + 2) * 40 ns * 0x3E8 = 100 ms.
  w.now = triggered + 99'990'000;
  EXPECT_EQ(w.read(0x1003, reg::kWatchdogStatus, 2).value(), 1u);
  w.now = triggered + 100'010'000;
  EXPECT_EQ(w.read(0x1003, reg::kWatchdogStatus, 2).value(), 0u);
  EXPECT_EQ(w.read(0x1003, reg::kWatchdogCounter, 1).value(), 1u);
  w.write_bytes(0x1003, reg::kDigitalOutputs, {1, 2});
  EXPECT_EQ(w.read(0x1003, reg::kWatchdogStatus, 2).value(), 1u);
  w.write(0x1003, reg::kWatchdogCounter, std::uint8_t{0});
  EXPECT_EQ(w.read(0x1003, reg::kWatchdogCounter, 1).value(), 0u);
  w.write(0x1003, reg::kProcessDataWatchdog, std::uint16_t{0});
  w.now += 1'000'000'000;
  EXPECT_EQ(w.read(0x1003, reg::kWatchdogStatus, 2).value(), 1u);
}

TEST(Controller, EventsOfTheSlavesAreCombinedInTheDatagram) {
  Cell c;
  EXPECT_EQ(c.wire.read(0x1001, reg::kType, 1).irq, 0);
  c.wire.send(Command::kBwr, at_position(0, reg::kEventMask), {4, 0});
  for (std::uint16_t n = 2; n <= 4; ++n) c.wire.read(static_cast<std::uint16_t>(0x1000 + n), reg::kDlStatus, 2);
  EXPECT_EQ(c.wire.read(0x1004, reg::kType, 1).irq, event::kDlStatus);  // of the first slave, through all others
  for (std::uint16_t n = 1; n <= 4; ++n) c.wire.read(static_cast<std::uint16_t>(0x1000 + n), reg::kDlStatus, 2);
  EXPECT_EQ(c.wire.read(0x1001, reg::kType, 1).irq, 0);
  c.bus.cut(3, true);
  EXPECT_EQ(c.wire.read(0x1001, reg::kType, 1).irq, event::kDlStatus);  // slave 3 has lost its neighbour
  c.wire.read(0x1003, reg::kDlStatus, 2);
  EXPECT_EQ(c.wire.read(0x1001, reg::kType, 1).irq, 0);
}

TEST(Controller, AFrameThatIsNotValidIsPassedOnAndCounted) {
  Single s;
  Bytes frame(60);
  FrameWriter writer(frame);
  writer.begin();
  writer.add(Command::kBrd, 0, 0, 2);
  writer.finish();
  frame[16] = 99;
  EXPECT_TRUE(s.bus.transmit(frame, s.wire.now).has_value());
  EXPECT_EQ(s.wire.read(kFirst, reg::kProcessingErrors, 1).value(), 1u);
  // Not EtherCAT: dropped, unless forwarding is on.
  frame[12] = 8;
  EXPECT_FALSE(s.bus.transmit(frame, s.wire.now).has_value());
  s.wire.write(kFirst, reg::kDlControl, std::uint8_t{0});
  EXPECT_TRUE(s.bus.transmit(frame, s.wire.now).has_value());
}

TEST(Controller, ReservedBitsAreIgnored) {
  // KickCAT leaves one of them set.
  Single s;
  Bytes frame(60);
  FrameWriter writer(frame);
  writer.begin();
  writer.add(Command::kBrd, 0, 0, 2);
  writer.finish();
  frame[15] |= 0x08;
  frame[23] |= 0x10;
  EXPECT_EQ(FrameReader(frame).fault(), FrameFault::kReserved);
  ASSERT_TRUE(s.bus.transmit(frame, s.wire.now).has_value());
  FrameReader reader(frame, FrameReader::Reserved::kIgnored);
  Datagram d;
  ASSERT_TRUE(reader.next(d));
  EXPECT_EQ(d.working_counter, 1);
  EXPECT_EQ(d.length, 2u);
}

TEST(Controller, OptionsThatDoNotFitAreRefused) {
  SlaveOptions options;
  options.esc.fmmus = 17;
  EXPECT_THROW(Slave(write_sii(Sii{}), options), Error);
  EXPECT_THROW(Esc({}, Bytes(10)), Error);
}

TEST(Controller, AFrameAllocatesNothing) {
  Cell c;
  Bytes frame(200);
  const auto before = cotwin::testing::allocations();
  for (int i = 0; i < 10; ++i) {
    FrameWriter writer(frame);
    writer.begin();
    writer.add(Command::kLrw, 0, 0, 12);
    writer.add(Command::kFrmw, 0, at_station(0x1001, reg::kSystemTime), 8);
    writer.add(Command::kBrd, 0, at_position(0, reg::kAlStatus), 2);
    writer.finish();
    c.bus.transmit(frame, c.wire.now += 1'000'000);
  }
  c.bus.power(2, false, c.wire.now);
  c.bus.power(2, true, c.wire.now);
  EXPECT_EQ(cotwin::testing::allocations(), before);
}

}  // namespace
}  // namespace cotwin::ethercat::esc_test
