// The master on a wire that loses, doubles and reorders frames, and on which others send.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <random>

#include "components/io/links/ethercat_encoder.h"
#include "tests/components/io/ethercat/cell.h"
#include "tests/components/io/ethercat/faulty_wire.h"

namespace cotwin::ethercat::faults_test {
namespace {

struct Faults {
  double loss, duplicates, reordering, foreign;
};

class FaultyBus : public ::testing::TestWithParam<Faults> {};

TEST_P(FaultyBus, GivesNoWrongInputsAndNoWrongOutputs) {
  const Faults f = GetParam();
  Cell cell;
  cell.options.drift_frames = 3000;
  FaultyWire wire(cell.wire, 11);
  wire.loss = f.loss;
  Exchange exchange(wire);
  Master master(set_up_bus(exchange, cell.slaves, cell.options), kMs, 20 * kMs, BusTime{0, cell.options.system_time, 0});
  wire.duplicates = f.duplicates;
  wire.reordering = f.reordering;
  wire.foreign = f.foreign;
  wire.lost = 0;
  std::int64_t next = cell.wire.now();
  constexpr int kCycles = 5000;
  int operational = 0;
  for (int i = 0; i < kCycles; ++i) {
    cell.wire.advance_to(next += kMs);
    cell.encoder().set_position(10 * i, next);
    store<std::uint16_t>(master.outputs(2).data(), static_cast<std::uint16_t>(0x8000 | i));
    const std::uint16_t before = cell.outputs().channels();
    master.cycle(wire);
    operational += master.operational() ? 1 : 0;
    if (master.fresh()) {
      ASSERT_EQ(load<std::int32_t>(master.inputs(3).data() + 2), 10 * (i - 1)) << "in cycle " << i;
    }
    // Outputs are the ones of this cycle, those before it if the frame was lost, or off.
    const std::uint16_t after = cell.outputs().channels();
    ASSERT_TRUE(after == (0x8000 | i) || after == before || after == 0) << "in cycle " << i;
    if (master.system_time() != 0) {
      ASSERT_LT(std::abs(master.system_time() - (cell.options.system_time + master.system_time_at())), 40 * kMs) << i;
    }
  }
  const Master::Counters& c = master.counters();
  EXPECT_GT(operational, kCycles * 9 / 10);
  EXPECT_EQ(c.slave_lost + c.slave_fault + c.wrong_slave + c.unexpected + c.working_counter, 0);
  EXPECT_LE(c.lost, wire.lost + wire.swapped);
  EXPECT_GE(c.lost, f.loss > 0 ? wire.lost / 4 : 0);  // of the frames of a cycle, one of two
  EXPECT_LE(c.foreign + c.late, wire.injected + wire.doubled + wire.swapped);
  EXPECT_GE(c.foreign + c.late, wire.injected * 9 / 10 + wire.doubled * 9 / 10);
  EXPECT_GE(c.foreign, wire.injected * 9 / 10);
  EXPECT_LE(c.late, wire.doubled + wire.swapped);
}

INSTANTIATE_TEST_SUITE_P(Faults, FaultyBus,
                         ::testing::Values(Faults{0.01, 0, 0, 0}, Faults{0.05, 0, 0, 0}, Faults{0, 0.1, 0, 0},
                                           Faults{0, 0, 0.1, 0}, Faults{0, 0, 0, 0.5}, Faults{0.02, 0.05, 0.05, 0.1}));

/// A device of one output, whose SII has this control byte for its sync manager.
class Drive final : public Slave {
 public:
  explicit Drive(std::uint8_t control) : Slave(image(control), terminal_options()) {}
  std::uint16_t output() const { return load<std::uint16_t>(outputs().data()); }

 private:
  static std::vector<std::uint8_t> image(std::uint8_t control) {
    Sii sii;
    sii.vendor = kBeckhoff;
    sii.product = 77;
    sii.general.order = "DRV";
    sii.pdi_control = 5;
    sii.fmmus = {1};
    sii.sync_managers = {{0x1000, 0, control, 0, 1, SyncManagerType::kOutputs}};
    Pdo pdo;
    pdo.index = 0x1600;
    pdo.sync_manager = 0;
    pdo.entries = {{0x7000, 1, "value", 6, 16, 0}};
    sii.rx_pdos = {pdo};
    return write_sii(sii);
  }
};

TEST(FaultyBus, LeavesNoOutputOnBehindABrokenCableWhateverTheSiiSays) {
  for (const std::uint8_t control : std::array<std::uint8_t, 2>{0x64, 0x24}) {
    Bus bus;
    bus.append(std::make_unique<Ek1100>());
    auto drive = std::make_unique<Drive>(control);
    const Drive& device = *drive;
    bus.append(std::move(drive));
    EmulatedWire wire(bus);
    Exchange exchange(wire);
    Master master(set_up_bus(exchange, {expected("EK1100", kEk1100, 0, 0), expected("DRV", 77, 0, 2)}, {}), kMs, 20 * kMs, {});
    std::int64_t next = wire.now();
    const auto cycles = [&](int n) {
      for (int i = 0; i < n; ++i) {
        wire.advance_to(next += kMs);
        master.cycle(wire);
        bus.advance(wire.now());
      }
    };
    cycles(60);
    ASSERT_TRUE(master.operational());
    store<std::uint16_t>(master.outputs(1).data(), 1234);
    cycles(3);
    ASSERT_EQ(device.output(), 1234);
    wire.unplug(true);
    cycles(110);  // the watchdog has 100 ms
    EXPECT_EQ(device.output(), 0) << "control byte " << static_cast<int>(control);
  }
}

TEST(FaultyBus, HasNoSlavesWithinTwoCyclesWhenNothingAnswers) {
  Cell cell;
  cell.set_up();
  cell.cycles(60);
  ASSERT_TRUE(cell.master->operational());
  for (int round = 0; round < 2; ++round) {
    cell.wire.unplug(true);
    cell.cycles(1);  // sends what is not answered
    cell.cycles(2);
    EXPECT_EQ(cell.master->present(), 0);
    for (std::size_t i = 0; i < 4; ++i) EXPECT_FALSE(cell.master->present(i)) << i;
    cell.cycles(round == 0 ? 5 : 500);
    EXPECT_EQ(cell.master->present(), 0);
    cell.wire.unplug(false);
    cell.cycles(400);
    EXPECT_EQ(cell.master->present(), 4);
    for (std::size_t i = 0; i < 4; ++i) EXPECT_TRUE(cell.master->present(i)) << i;
    EXPECT_TRUE(cell.master->operational());
  }
}

TEST(FaultyBus, OneLostFrameIsNoLossOfSlaves) {
  Cell cell;
  cell.set_up();
  cell.cycles(60);
  cell.wire.unplug(true);
  cell.cycles(1);
  cell.wire.unplug(false);
  for (int i = 0; i < 5; ++i) {
    cell.cycles(1);
    EXPECT_EQ(cell.master->present(), 4);
    EXPECT_TRUE(cell.master->operational());
  }
}

// One byte behind the headers of one returning frame of twenty is another one, as behind a switch or an interface that does not check the
// checksum of Ethernet. The axis moves with 1 count per cycle at first, then with 40.
TEST(FaultyBus, DamagedFramesMoveNoEncoderAndPublishNoDifferenceOfClocks) {
  Cell cell;
  cell.options.drift_frames = 3000;
  cell.set_up();
  FaultyWire wire(cell.wire, 3);
  std::mt19937 random(4);
  int damaged = 0;
  wire.changes = [&](std::span<std::uint8_t> frame) {
    if (cell.next < 500 * kMs || random() % 20 != 0) return;
    ++damaged;
    const std::size_t at = kFrameHeader + random() % (frame.size() - kFrameHeader);
    frame[at] = static_cast<std::uint8_t>(frame[at] ^ (1 + random() % 255));
  };
  io::EtherCatEncoder encoder(true);
  encoder.reset();
  std::int64_t largest = 0, position = 0, start = 0;
  for (int i = 0; i < 6000; ++i) {
    cell.wire.advance_to(cell.next += kMs);
    position += i < 3000 ? 1 : 40;
    cell.encoder().set_position(position, cell.next);
    cell.master->cycle(wire);
    encoder.advance(1e-3);
    if (cell.master->fresh()) encoder.read(cell.master->inputs(3), false, 0.02);
    if (i == 400) start = encoder.counts() - position;
    if (i < 400) continue;
    const std::int64_t behind = std::abs(encoder.counts() - start - position);
    // Recovering after damaged states of slaves takes a while without data.
    if (cell.master->fresh()) {
      ASSERT_LE(behind, i < 3000 ? 4 : 2 * 40 + 23)
          << i << ": data are a cycle old, one more while a counter is doubted, and half of the way is believed";
    }
    largest = std::max(largest, cell.master->clock_difference());
  }
  EXPECT_GT(damaged, 200);
  EXPECT_LT(largest, 2000) << "ns";
  EXPECT_GT(encoder.implausible(), 0);
}

TEST(FaultyBus, TakesNoForeignAnswerForThatOfAnErrand) {
  // Others send what looks like a state read with each index: SAFEOP with an error, of a slave of theirs.
  Cell cell(false);
  cell.set_up();
  cell.cycles(60);
  ASSERT_TRUE(cell.master->operational());
  cell.bus.cut(3, true);  // so that states are read
  cell.cycles(20);
  class Stranger final : public Wire {
   public:
    explicit Stranger(Wire& wire) : wire_(wire) {}
    bool send(std::span<const std::uint8_t> frame) override { return wire_.send(frame); }
    std::size_t receive(std::span<std::uint8_t> buffer, std::int64_t deadline) override {
      if (const std::size_t size = wire_.receive(buffer, deadline); size > 0) {
        FrameReader reader(buffer.first(size));
        Datagram d;
        if (!reader.next(d) || d.index < 128 || d.offset() != reg::kAlStatus) return size;
        d.address = at_station(0x2001, reg::kAlStatus);
        FrameWriter writer(buffer);
        writer.begin();
        const std::array<std::uint8_t, 6> error{0x14, 0, 0, 0, 0x1b, 0};
        writer.add(d.command, d.index, d.address, error);
        const std::size_t forged = writer.finish().size();
        store<std::uint16_t>(buffer.data() + kFrameHeader + kDatagramHeader + 6, 1);
        return forged;
      }
      return 0;
    }
    std::int64_t now() const override { return wire_.now(); }
    std::int64_t received_at() const override { return wire_.received_at(); }

   private:
    Wire& wire_;
  } stranger(cell.wire);
  const std::int64_t faults = cell.master->counters().slave_fault;
  for (int i = 0; i < 50; ++i) {
    cell.wire.advance_to(cell.next += kMs);
    cell.master->cycle(stranger);
  }
  EXPECT_EQ(cell.master->counters().slave_fault, faults);
  EXPECT_EQ(cell.master->status(1).state, State::kOp);
  EXPECT_GT(cell.master->counters().foreign, 30);
}

}  // namespace
}  // namespace cotwin::ethercat::faults_test
