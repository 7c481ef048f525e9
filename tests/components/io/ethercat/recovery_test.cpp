// The master while slaves are lost, stuck, replaced and switched off again, and at the end of operation.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <array>
#include <optional>
#include <utility>

#include "tests/components/io/ethercat/cell.h"
#include "tests/components/io/ethercat/faulty_wire.h"

namespace cotwin::ethercat::recovery_test {
namespace {

using ::testing::HasSubstr;

/// Sends frames of the test between two cycles of the master.
bool write_state(Cell& cell, std::uint16_t station, State state) {
  Exchange exchange(cell.wire);
  return exchange.write(station, reg::kAlControl, static_cast<std::uint16_t>(state));
}

/// The cell, of which slave 3 needs `load_time` after power-on until its SII can be read.
Cell& with_slow_sii(Cell& cell, std::int64_t load_time) {
  SlaveOptions slow = terminal_options();
  slow.esc.load_time = load_time;
  Bus bus;
  bus.append(std::make_unique<Ek1100>());
  bus.append(std::make_unique<El1809>());
  bus.append(std::make_unique<El2809>());
  bus.append(std::make_unique<El5101>(slow));
  cell.bus = std::move(bus);
  return cell;
}

TEST(Recovery, OfOneSlaveGoesOnWhileAnotherOneIsStuck) {
  Cell cell(false);
  with_slow_sii(cell, 3'000 * kMs);
  cell.wire.advance_to(4'000 * kMs);
  cell.set_up();
  cell.cycles(60);
  ASSERT_TRUE(cell.master->operational());
  cell.bus.power(3, false, cell.wire.now());
  cell.cycles(20);
  cell.bus.power(3, true, cell.wire.now());
  cell.cycles(50);  // its address is not known, and its SII cannot be read for 3 s
  ASSERT_TRUE(write_state(cell, 0x1002, State::kPreOp));
  ASSERT_TRUE(write_state(cell, 0x1003, State::kInit));
  cell.cycles(300);
  EXPECT_EQ(cell.bus.slave(1).state(), State::kOp);
  EXPECT_EQ(cell.bus.slave(2).state(), State::kOp);
  EXPECT_FALSE(cell.master->operational());
  cell.cycles(3500);
  EXPECT_TRUE(cell.master->operational());
  EXPECT_EQ(cell.master->counters().wrong_slave, 0) << "an SII that cannot be read yet is not another device";
}

TEST(Recovery, BeginsAgainWhenTheSlaveIsSwitchedOffDuringIt) {
  int inside = 0;
  for (int n = 1; n < 260; n += 6) {
    Cell cell;
    cell.options.drift_frames = 100;
    cell.slaves[3].sync_activation = 0x0300;
    cell.set_up();
    cell.cycles(60);
    cell.bus.power(3, false, cell.wire.now());
    cell.cycles(20);
    cell.bus.power(3, true, cell.wire.now());
    cell.cycles(n);
    inside += cell.master->operational() ? 0 : 1;
    cell.bus.power(3, false, cell.wire.now());
    cell.cycles(30);
    cell.bus.power(3, true, cell.wire.now());
    cell.cycles(700);
    EXPECT_TRUE(cell.master->operational()) << n;
    EXPECT_TRUE(cell.encoder().esc().clock().sync0_active()) << n;
    EXPECT_EQ(cell.master->counters().wrong_slave, 0) << n;
  }
  EXPECT_GT(inside, 10);
}

TEST(Recovery, StartsSync0InTimeWhateverAnswersAreLost) {
  // Frames are lost for 150 ms, more than the lead of the first pulse, at different steps of the recovery.
  for (int n = 60; n < 180; n += 3) {
    Cell cell;
    cell.options.drift_frames = 100;
    cell.slaves[3].sync_activation = 0x0300;
    cell.slaves[3].sync0_shift = -kMs / 4;
    cell.set_up();
    cell.cycles(60);
    cell.bus.power(3, false, cell.wire.now());
    cell.cycles(5);
    cell.bus.power(3, true, cell.wire.now());
    cell.cycles(n);
    cell.wire.unplug(true);
    cell.cycles(150);
    cell.wire.unplug(false);
    cell.cycles(900);
    EXPECT_TRUE(cell.master->operational()) << n;
    EXPECT_GT(cell.encoder().esc().clock().sync0_count(), 0u) << n;
    EXPECT_EQ(cell.encoder().esc().clock().next_sync0() % kMs, 3u * kMs / 4) << n;
  }
}

TEST(Recovery, GivesNoAddressOfALostSlaveToAHealthyOne) {
  // Slave 2 is taken out of the line, and one is plugged in at the end: the healthy slave 3, a device like the lost one, is now third.
  Cell cell(false);
  Bus two;
  two.append(std::make_unique<Ek1100>());
  two.append(std::make_unique<El1809>());
  two.append(std::make_unique<El2809>());
  two.append(std::make_unique<El2809>());
  cell.bus = std::move(two);
  cell.slaves[3] = expected("EL2809", kEl2809, 0, 2);
  cell.set_up();
  cell.cycles(60);
  ASSERT_TRUE(cell.master->operational());
  Bus other;
  other.append(std::make_unique<Ek1100>());
  other.append(std::make_unique<El1809>());
  other.append(std::make_unique<El2809>());
  other.append(std::make_unique<El2809>());
  EmulatedWire wire(other, cell.wire.now());
  Exchange exchange(wire);
  for (std::uint16_t i = 0; i < 3; ++i) {
    auto station = static_cast<std::uint16_t>(i < 2 ? 0x1001 + i : 0x1004);
    ASSERT_EQ(exchange.transfer(Command::kApwr, at_position(i, reg::kStation), station), 1);
  }
  for (int i = 0; i < 2000; ++i) {
    wire.advance_to(wire.now() + kMs);
    cell.master->cycle(wire);
  }
  EXPECT_EQ(exchange.read<std::uint16_t>(0x1004, reg::kStation), 0x1004) << "the healthy slave";
  EXPECT_EQ(exchange.read<std::uint16_t>(0x1003, reg::kStation), std::nullopt);
  EXPECT_FALSE(cell.master->operational());
  EXPECT_EQ(cell.master->counters().wrong_slave, 1) << "one finding, however often it is looked for";
}

TEST(Recovery, GoesOnWhenASlaveIsLostThatHasLatchedTheClocks) {
  // All three set their clocks, and the last one is switched off at different steps of that.
  for (int n = 50; n < 70; n += 2) {
    Cell cell;
    cell.options.drift_frames = 20;
    cell.set_up();
    cell.cycles(60);
    ASSERT_TRUE(write_state(cell, 0x1004, State::kInit));
    cell.cycles(24);
    ASSERT_TRUE(write_state(cell, 0x1003, State::kInit));
    ASSERT_TRUE(write_state(cell, 0x1002, State::kInit));
    cell.cycles(n);
    cell.bus.power(3, false, cell.wire.now());
    cell.cycles(1000);
    EXPECT_EQ(cell.bus.slave(1).state(), State::kOp) << n;
    EXPECT_EQ(cell.bus.slave(2).state(), State::kOp) << n;
  }
}

TEST(SetUp, TakesNoNoticeOfTheAddressesOfAnotherMaster) {
  Cell cell(false);
  Exchange exchange(cell.wire);
  for (const std::uint16_t position : std::array<std::uint16_t, 2>{2, 3}) {
    std::uint16_t station = 0x1003;
    ASSERT_EQ(exchange.transfer(Command::kApwr, at_position(position, reg::kStation), station), 1);
  }
  ASSERT_EQ(cell.refusal(), "");
  cell.cycles(60);
  EXPECT_TRUE(cell.master->operational());
}

TEST(Recovery, OfAllSlavesAtOnceSetsAllClocks) {
  Cell cell;
  cell.slaves[3].sync_activation = 0x0300;
  cell.set_up();
  cell.cycles(100);
  for (std::size_t i = 0; i < 4; ++i) cell.bus.power(i, false, cell.wire.now());
  cell.cycles(100);
  for (std::size_t i = 0; i < 4; ++i) cell.bus.power(i, true, cell.wire.now());
  cell.cycles(15'000);
  ASSERT_TRUE(cell.master->operational());
  const std::int64_t now = cell.wire.now();
  const auto reference = static_cast<std::int64_t>(cell.bus.slave(0).esc().clock().system_time(now));
  EXPECT_LT(std::abs(reference - (cell.options.system_time + now)), 20 * kMs) << "the time of the bus goes on";
  for (std::size_t s = 1; s < 4; ++s) {
    const auto own = static_cast<std::int64_t>(cell.bus.slave(s).esc().clock().system_time(now));
    EXPECT_LT(std::abs(own - reference), 100) << "slave " << s;
  }
}

TEST(SetUp, WaitsForSlavesThatLoadTheirSii) {
  Cell cell(false);
  with_slow_sii(cell, 300 * kMs);
  cell.set_up();
  cell.cycles(60);
  EXPECT_TRUE(cell.master->operational());
  Cell never(false);
  with_slow_sii(never, 5'000 * kMs);
  EXPECT_THAT(never.refusal(), HasSubstr("slave 3: reports an error for 1 s when its SII is read"));
}

TEST(SetUp, RepeatsTheLatchOfTheClocksUntilAllTakeIt) {
  int latches = 0, bad = 2;
  const auto spoil = [&](std::span<std::uint8_t> frame) {
    FrameReader reader(frame);
    Datagram d;
    if (!reader.next(d) || d.command != Command::kBwr || d.offset() != reg::kReceiveTimes || ++latches > bad) return;
    store<std::uint16_t>(frame.data() + d.data + d.length, 2);
  };
  for (const int n : {2, 1000}) {
    Cell cell;
    cell.options.drift_frames = 10;
    FaultyWire wire(cell.wire);
    wire.changes = spoil;
    latches = 0;
    bad = n;
    Exchange exchange(wire);
    std::string refusal;
    try {
      set_up_bus(exchange, cell.slaves, cell.options);
    } catch (const Error& e) {
      refusal = e.what();
    }
    if (n == 2) {
      EXPECT_EQ(refusal, "");
    } else {
      EXPECT_EQ(refusal, "EtherCAT: 2 of the slaves take the command to latch their receive times, expected 4 to 4");
    }
  }
}

TEST(SetUp, NeedsNoTreeWithoutClocks) {
  for (const bool clocks : {false, true}) {
    Cell cell(clocks);
    cell.options.drift_frames = 10;
    FaultyWire wire(cell.wire);
    wire.changes = [](std::span<std::uint8_t> frame) {  // slaves whose ports report no link
      FrameReader reader(frame);
      Datagram d;
      if (reader.next(d) && d.command == Command::kFprd && d.offset() == reg::kDlStatus)
        store<std::uint16_t>(frame.data() + d.data, 0x1);
    };
    Exchange exchange(wire);
    const auto set_up = [&] { set_up_bus(exchange, cell.slaves, cell.options); };
    if (clocks) {
      EXPECT_THROW(set_up(), Error);
    } else {
      EXPECT_NO_THROW(set_up());
    }
  }
}

TEST(SetUp, GetsMailsAgainThatAreLost) {
  // Every kind of frame of the mailboxes is lost at every place.
  for (int n = 0; n < 60; ++n) {
    Cell cell(false);
    FaultyWire wire(cell.wire);
    int seen = 0;
    const SiiMailbox box = el5101_sii().mailbox;
    const auto is_mail = [&](std::span<const std::uint8_t> frame) {
      FrameReader reader(frame);
      Datagram d;
      return reader.next(d) && (d.offset() == box.out || d.offset() == box.in) && d.length > 16;
    };
    wire.loses_sent = [&](std::span<const std::uint8_t> frame) { return is_mail(frame) && seen++ == n; };
    wire.loses_returned = [&](std::span<const std::uint8_t> frame) { return is_mail(frame) && seen++ == n; };
    Exchange exchange(wire);
    Master master(set_up_bus(exchange, cell.slaves, cell.options), kMs, 20 * kMs, {});
    EXPECT_EQ(wire.lost, n < seen ? 1 : 0);
    for (int i = 0; i < 60; ++i) {
      cell.wire.advance_to(cell.wire.now() + kMs);
      master.cycle(wire);
    }
    EXPECT_TRUE(master.operational()) << n;
  }
}

TEST(Stop, SwitchesOutputsOffAndBringsSlavesToInitInOrder) {
  for (const double loss : {0.0, 0.2}) {
    Cell cell;
    cell.options.drift_frames = 100;
    cell.slaves[3].sync_activation = 0x0300;
    cell.set_up();
    cell.cycles(60);
    store<std::uint16_t>(cell.master->outputs(2).data(), 0xffff);
    cell.cycles(3);
    ASSERT_EQ(cell.outputs().channels(), 0xffff);
    FaultyWire wire(cell.wire);
    wire.loss = loss;
    std::string order;
    wire.loses_sent = [&](std::span<const std::uint8_t> frame) {
      FrameReader reader(frame);
      Datagram d;
      while (reader.next(d)) {
        std::string word;
        if (d.command == Command::kLrw) word = reader.data(d)[0] == 0 ? "zeros " : "values ";
        if (d.command == Command::kBwr && d.offset() == reg::kAlControl)
          word = (reader.data(d)[0] & kStateBits) == 4 ? "SAFEOP " : "INIT ";
        if (d.command == Command::kBwr && d.offset() == reg::kActivation) word = "SYNC0 ";
        if (!word.empty() && !order.ends_with(word)) order += word;
      }
      return false;
    };
    const std::int64_t begin = cell.wire.now();
    EXPECT_TRUE(cell.master->stop(wire));
    EXPECT_EQ(order, "zeros SAFEOP INIT SYNC0 ");
    EXPECT_LE(cell.wire.now() - begin, Master::kLongestStop);
    EXPECT_EQ(cell.outputs().channels(), 0);
    for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(cell.bus.slave(i).state(), State::kInit) << i;
    if (loss == 0.0) {
      EXPECT_LT(cell.wire.now() - begin, kMs);
      EXPECT_FALSE(cell.encoder().esc().clock().sync0_active());
    }
  }
}

TEST(Stop, EndsInTimeOnASilentBusAndDuringARecovery) {
  Cell cell;
  cell.set_up();
  cell.cycles(60);
  cell.bus.power(3, false, cell.wire.now());
  cell.cycles(20);
  cell.bus.power(3, true, cell.wire.now());
  cell.cycles(60);
  cell.bus.cut(3, true);
  EXPECT_FALSE(cell.master->stop(cell.wire)) << "one slave does not answer";
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(cell.bus.slave(i).state(), State::kInit) << i;
  Cell silent;
  silent.set_up();
  silent.cycles(60);
  silent.wire.unplug(true);
  const std::int64_t begin = silent.wire.now();
  EXPECT_FALSE(silent.master->stop(silent.wire));
  EXPECT_LE(silent.wire.now() - begin, Master::kLongestStop + kMs);
}

}  // namespace
}  // namespace cotwin::ethercat::recovery_test
