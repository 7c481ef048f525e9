// The master against the emulated bus, in simulated time.
#include "components/io/ethercat/master/master.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "tests/components/io/ethercat/captures.h"
#include "tests/components/io/ethercat/cell.h"
#include "tests/components/io/ethercat/faulty_wire.h"
#include "tests/support/allocations.h"

namespace cotwin::ethercat::master_test {
namespace {

TEST(Master, BringsACellToOpAndExchangesItsProcessData) {
  Cell cell;
  cell.inputs().set_channels(0x8005, 0);
  cell.set_up();
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(cell.bus.slave(i).state(), State::kSafeOp) << i;
  cell.cycles(60);
  EXPECT_TRUE(cell.master->operational());
  EXPECT_TRUE(cell.master->fresh());
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(cell.bus.slave(i).state(), State::kOp) << i;
  ASSERT_EQ(cell.master->bus().segments.size(), 1u);
  EXPECT_EQ(cell.master->bus().segments[0].expected(), 6);  // ethercat.md, section 1: 0 + 1 + 2 + 3
  EXPECT_EQ(load<std::uint16_t>(cell.master->inputs(1).data()), 0x8005);
  store<std::uint16_t>(cell.master->outputs(2).data(), 0x1234);
  cell.encoder().set_position(-70'000, cell.next);
  cell.cycles(2);
  EXPECT_EQ(cell.outputs().channels(), 0x1234);
  EXPECT_EQ(load<std::int32_t>(cell.master->inputs(3).data() + 2), -70'000);
  const Master::Counters& c = cell.master->counters();
  EXPECT_EQ(c.lost + c.late + c.foreign + c.working_counter + c.slave_lost + c.slave_fault + c.recovered, 0);
}

TEST(Master, RefusesABusThatIsNotTheExpectedOne) {
  Cell swapped;
  std::swap(swapped.slaves[1], swapped.slaves[2]);
  EXPECT_EQ(swapped.refusal(),
            "EtherCAT: slave 1: is EL1809 (vendor 0x00000002, product 0x07113052), expected EL2809 (vendor 0x00000002, product "
            "0x0af93052)");
  Cell missing;
  missing.bus.cut(3, true);
  EXPECT_EQ(missing.refusal(), "EtherCAT: 3 slaves answer (EK1100, EL1809, EL2809), expected 4: slave 3 (EL5101) is missing");
  Cell further;
  further.slaves.pop_back();
  EXPECT_EQ(further.refusal(), "EtherCAT: 4 slaves answer (EK1100, EL1809, EL2809, EL5101), expected 3: slave 3 is unknown");
  Cell silent;
  silent.wire.unplug(true);
  EXPECT_EQ(silent.refusal(), "EtherCAT: no frame comes back, expected an EtherCAT bus that is switched on");
  Cell unknown;
  unknown.slaves[3].pdos.inputs = {0x1a99};
  EXPECT_NE(unknown.refusal().find("slave 3 (EL5101, axis): it has no PDO 0x1a99, expected one of: 0x1a00"), std::string::npos)
      << unknown.refusal();
  Cell digital;
  digital.slaves[1].pdos.inputs = {0x1a00};
  EXPECT_NE(digital.refusal().find("its PDOs cannot be chosen, because it has no mailbox with CoE"), std::string::npos)
      << digital.refusal();
  Cell narrow;
  narrow.slaves[3].pdos = {};
  EXPECT_NE(narrow.refusal().find("has 3 bytes of outputs and 5 of inputs, expected 6 and 10"), std::string::npos)
      << narrow.refusal();
}

TEST(Master, TurnsOutputsOffWhileASlaveIsCutOffAndComesBackByItself) {
  Cell cell;
  cell.set_up();
  cell.cycles(60);
  store<std::uint16_t>(cell.master->outputs(2).data(), 0xffff);
  cell.cycles(2);
  ASSERT_EQ(cell.outputs().channels(), 0xffff);
  cell.bus.cut(3, true);  // the encoder, behind the outputs
  cell.cycles(3);
  EXPECT_FALSE(cell.master->operational());
  EXPECT_EQ(cell.master->present(), 3);
  EXPECT_EQ(cell.outputs().channels(), 0);  // by the master: this slave is still in OP
  EXPECT_EQ(cell.outputs().state(), State::kOp);
  cell.cycles(500);
  EXPECT_FALSE(cell.master->status(3).present);
  EXPECT_EQ(cell.master->counters().slave_lost, 1);
  cell.bus.cut(3, false);
  cell.cycles(200);
  EXPECT_TRUE(cell.master->operational());
  EXPECT_EQ(cell.outputs().channels(), 0xffff);
  EXPECT_EQ(cell.master->counters().recovered, 1);
  EXPECT_EQ(cell.master->status(3).restarts, 0);  // it kept its settings
}

TEST(Master, SetsUpASlaveAgainThatWasSwitchedOff) {
  Cell cell;
  cell.slaves[3].sync_activation = 0x0300;
  cell.set_up();
  cell.cycles(60);
  ASSERT_TRUE(cell.master->operational());
  cell.bus.power(3, false, cell.wire.now());
  cell.cycles(300);
  EXPECT_FALSE(cell.master->operational());
  cell.bus.power(3, true, cell.wire.now());
  cell.cycles(400);
  EXPECT_TRUE(cell.master->operational());
  EXPECT_EQ(cell.master->status(3).restarts, 1);
  EXPECT_EQ(cell.encoder().state(), State::kOp);
  EXPECT_TRUE(cell.encoder().esc().clock().sync0_active());
  cell.encoder().set_position(123'456, cell.next);
  cell.cycles(2);
  EXPECT_EQ(load<std::int32_t>(cell.master->inputs(3).data() + 2), 123'456);
}

TEST(Master, ComesBackFromASilentBus) {
  Cell cell;
  cell.set_up();
  cell.cycles(60);
  store<std::uint16_t>(cell.master->outputs(2).data(), 1);
  cell.cycles(2);
  cell.wire.unplug(true);
  cell.cycles(15);
  EXPECT_TRUE(cell.master->operational()) << "patience is 20 ms";
  cell.cycles(200);
  EXPECT_FALSE(cell.master->operational());
  EXPECT_EQ(cell.outputs().channels(), 0);  // by the slave's watchdog
  EXPECT_EQ(cell.encoder().state(), State::kSafeOp);
  cell.wire.unplug(false);
  cell.cycles(200);
  EXPECT_TRUE(cell.master->operational());
  EXPECT_EQ(cell.outputs().channels(), 1);
  EXPECT_EQ(cell.master->counters().lost, 215);
}

TEST(Master, DoesNotSetUpAnotherDeviceInThePlaceOfALostOne) {
  Cell cell;
  cell.set_up();
  cell.cycles(60);
  cell.bus.power(3, false, cell.wire.now());
  cell.cycles(50);
  // The terminal comes back with another product in its SII.
  Bus other;
  other.append(std::make_unique<Ek1100>());
  other.append(std::make_unique<El1809>());
  other.append(std::make_unique<El2809>());
  other.append(std::make_unique<El2809>());
  EmulatedWire wire(other, cell.wire.now());
  for (int i = 0; i < 1000; ++i) {
    wire.advance_to(wire.now() + kMs);
    cell.master->cycle(wire);
  }
  EXPECT_FALSE(cell.master->operational());
  EXPECT_EQ(cell.master->counters().wrong_slave, 1);
  EXPECT_EQ(other.slave(3).state(), State::kInit);
  EXPECT_EQ(other.slave(2).state(), State::kOp);
}

TEST(Master, LosesNothingButTheCyclesOfLostFrames) {
  // A wire that loses a tenth of the frames at random, without delay.
  class Lossy final : public Wire {
   public:
    explicit Lossy(EmulatedWire& wire) : wire_(wire) {}
    bool send(std::span<const std::uint8_t> frame) override {
      if (lossy && random_() % 10 == 0) {
        ++dropped;
        return true;
      }
      return wire_.send(frame);
    }
    std::size_t receive(std::span<std::uint8_t> buffer, std::int64_t deadline) override {
      return wire_.receive(buffer, deadline);
    }
    std::int64_t now() const override { return wire_.now(); }
    std::int64_t received_at() const override { return wire_.received_at(); }
    bool lossy = true;
    int dropped = 0;

   private:
    EmulatedWire& wire_;
    std::mt19937 random_{7};
  };
  Cell cell;
  Lossy lossy(cell.wire);
  Exchange exchange(lossy);
  Master master(set_up_bus(exchange, cell.slaves, cell.options), kMs, 20 * kMs, BusTime{0, cell.options.system_time, 0});
  std::int64_t next = cell.wire.now();
  int operational = 0;
  lossy.dropped = 0;
  for (int i = 0; i < 5000; ++i) {
    cell.wire.advance_to(next += kMs);
    cell.encoder().set_position(10 * i, next);
    master.cycle(lossy);
    operational += master.operational() ? 1 : 0;
    if (master.fresh() && master.operational()) {
      EXPECT_EQ(load<std::int32_t>(master.inputs(3).data() + 2), 10 * (i - 1));
    }
  }
  EXPECT_GT(operational, 4700);
  EXPECT_GT(master.counters().lost, 400);
  EXPECT_LE(master.counters().lost, lossy.dropped);  // some of the dropped ones were errands
  EXPECT_EQ(master.counters().slave_lost, 0);
  EXPECT_EQ(master.counters().working_counter, 0);
}

TEST(Master, KeepsAllClocksWithin100NanosecondsOfTheReference) {
  // 50 ppm and cables of 100 m before each slave (530 ns).
  Cell cell(true, {50e-6, -50e-6, 50e-6, -50e-6}, 530);
  cell.set_up();
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(static_cast<double>(cell.master->bus().slaves[i].delay), static_cast<double>(cell.bus.delay_to(i)), 2.0) << i;
  }
  for (int i = 0; i < 3000; ++i) {
    cell.cycles(1);
    const std::int64_t now = cell.wire.now();
    const auto reference = static_cast<std::int64_t>(cell.bus.slave(0).esc().clock().system_time(now));
    for (std::size_t s = 1; s < 4; ++s) {
      const auto own = static_cast<std::int64_t>(cell.bus.slave(s).esc().clock().system_time(now));
      ASSERT_LT(std::abs(own - reference), 100) << "slave " << s << " in cycle " << i;
    }
  }
  EXPECT_LT(cell.master->clock_difference(), 100);
  // The time that the master knows is that of the reference clock.
  const auto& clock = cell.bus.slave(0).esc().clock();
  cell.cycles(1);
  cell.master->collect(cell.wire, cell.wire.now() + kMs);
  const auto now = static_cast<std::int64_t>(clock.system_time(cell.master->system_time_at()));
  EXPECT_LT(std::abs(cell.master->system_time() - now), 10'000);  // the host needs 5 us for a frame
}

TEST(Master, GivesALateSlaveTheTimeOfTheBus) {
  Cell cell;
  cell.set_up();
  cell.cycles(100);
  cell.bus.power(2, false, cell.wire.now());  // and with it the encoder behind it is not reached
  cell.cycles(200);
  cell.bus.power(2, true, cell.wire.now());
  cell.cycles(8000);
  ASSERT_TRUE(cell.master->operational());
  const std::int64_t now = cell.wire.now();
  const auto reference = static_cast<std::int64_t>(cell.bus.slave(0).esc().clock().system_time(now));
  for (std::size_t s = 1; s < 4; ++s) {
    const auto own = static_cast<std::int64_t>(cell.bus.slave(s).esc().clock().system_time(now));
    EXPECT_LT(std::abs(own - reference), 100) << "slave " << s;
  }
}

TEST(Master, TakesOnlyAnswersToItsOwnFrames) {
  // A wire that answers each cycle with one kind of datagram beside the states, all with the working counters of success.
  class Liar final : public Wire {
   public:
    Liar(Command command, std::size_t longest, std::int64_t now) : command_(command), longest_(longest), now_(now) {}
    bool send(std::span<const std::uint8_t> frame) override {
      FrameReader reader(frame);
      FrameWriter writer(answer_);
      writer.begin();
      Datagram d;
      std::vector<std::uint16_t> counts;
      while (reader.next(d)) {
        if (d.command != command_ && d.command != Command::kBrd) continue;
        std::vector<std::uint8_t> data(reader.data(d).begin(), reader.data(d).end());
        if (d.command == Command::kBrd) {
          data[0] = static_cast<std::uint8_t>(State::kOp);
        } else {
          data.resize(std::min(data.size(), longest_));
        }
        writer.add(d.command, d.index, d.address, data);
      }
      size_ = writer.finish().size();
      FrameReader again(std::span<const std::uint8_t>(answer_).first(size_));
      while (again.next(d)) {
        store<std::uint16_t>(answer_.data() + d.data + d.length, d.command == Command::kBrd ? 4 : 6);
      }
      return true;
    }
    std::size_t receive(std::span<std::uint8_t> buffer, std::int64_t) override {
      std::copy_n(answer_.begin(), size_, buffer.begin());
      return std::exchange(size_, std::size_t{0});
    }
    std::int64_t now() const override { return now_; }
    std::int64_t received_at() const override { return now_; }
    void advance() { now_ += kMs; }

   private:
    Command command_;
    std::size_t longest_;
    std::int64_t now_;
    std::array<std::uint8_t, kLongestFrame> answer_{};
    std::size_t size_ = 0;
  };
  Cell cell(false);
  cell.set_up();
  cell.cycles(60);
  ASSERT_TRUE(cell.master->operational());
  for (const std::size_t longest : {std::size_t{0}, std::size_t{3}}) {
    for (const Command command : {Command::kNop, Command::kLrw}) {
      Liar liar(command, longest, cell.wire.now());
      for (int i = 0; i < 50; ++i) {
        liar.advance();
        cell.master->cycle(liar);
        if (i > 0) {
          EXPECT_FALSE(cell.master->fresh());
        }
      }
      EXPECT_FALSE(cell.master->operational());
    }
  }
  EXPECT_GT(cell.master->counters().foreign, 100);
}

TEST(Master, AllocatesNothingInItsCycles) {
  Cell cell;
  cell.set_up();
  const std::uint64_t before = testing::allocations();
  cell.cycles(100);
  cell.bus.power(3, false, cell.wire.now());
  cell.cycles(100);
  cell.bus.power(3, true, cell.wire.now());
  cell.cycles(400);
  EXPECT_EQ(testing::allocations(), before);
  EXPECT_TRUE(cell.master->operational());
}

TEST(Master, SplitsLargeProcessDataIntoFrames) {
  Bus bus;
  EmulatedWire wire(bus);
  std::vector<ExpectedSlave> slaves;
  for (int i = 0; i < 3; ++i) {
    Sii sii;
    sii.vendor = 0x7777;
    sii.product = static_cast<std::uint32_t>(i + 1);
    sii.general.order = "BIG";
    sii.fmmus = {1, 2};
    sii.sync_managers = {{0x1000, 500, 0x24, 0, 1, SyncManagerType::kOutputs},
                         {0x1800, 500, 0x20, 0, 1, SyncManagerType::kInputs}};
    Pdo out, in;
    out.index = 0x1600;
    out.sync_manager = 0;
    in.index = 0x1a00;
    in.sync_manager = 1;
    for (int e = 0; e < 125; ++e) {
      out.entries.push_back({0x7000, static_cast<std::uint8_t>(e + 1), "", 7, 32, 0});
      in.entries.push_back({0x6000, static_cast<std::uint8_t>(e + 1), "", 7, 32, 0});
    }
    sii.rx_pdos = {out};
    sii.tx_pdos = {in};
    bus.append(std::make_unique<Slave>(write_sii(sii), terminal_options()));
    ExpectedSlave e;
    e.device = "BIG";
    e.vendor = sii.vendor;
    e.product = sii.product;
    e.input_bytes = e.output_bytes = 500;
    slaves.push_back(e);
  }
  Exchange exchange(wire);
  SetupOptions options;
  Master master(set_up_bus(exchange, slaves, options), kMs, 20 * kMs, BusTime{});
  EXPECT_EQ(master.bus().segments.size(), 3u);
  std::int64_t next = wire.now();
  const auto cycles = [&](int n) {
    for (int i = 0; i < n; ++i) {
      wire.advance_to(next += kMs);
      master.cycle(wire);
    }
  };
  cycles(60);
  ASSERT_TRUE(master.operational());
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t b = 0; b < 500; ++b) {
      master.outputs(i)[b] = static_cast<std::uint8_t>(b + i);
      bus.slave(i).inputs()[b] = static_cast<std::uint8_t>(3 * b + i);
    }
  }
  cycles(3);
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t b = 0; b < 500; ++b) {
      ASSERT_EQ(bus.slave(i).outputs()[b], static_cast<std::uint8_t>(b + i));
      ASSERT_EQ(master.inputs(i)[b], static_cast<std::uint8_t>(3 * b + i));
    }
  }
  // A slave that is missing ends operation at once, also if another frame of the cycle is lost.
  FaultyWire faulty(wire);
  faulty.loses_returned = [&](std::span<const std::uint8_t> frame) {
    FrameReader reader(frame);
    Datagram d;
    return reader.next(d) && d.command == Command::kLrw && d.address == kSegmentSpan;
  };
  for (int i = 0; i < 10; ++i) {
    wire.advance_to(next += kMs);
    master.cycle(faulty);
  }
  ASSERT_TRUE(master.operational()) << "lost frames alone are tolerated for 20 ms";
  bus.cut(2, true);
  for (int i = 0; i < 2; ++i) {
    wire.advance_to(next += kMs);
    master.cycle(faulty);
  }
  EXPECT_FALSE(master.operational());
}

TEST(Master, ReadsAndWritesSeparatelyIfASlaveHasNoLrw) {
  Cell cell;
  Bus bus;
  SlaveOptions plain = terminal_options();
  plain.esc.features |= feature::kNoLrw;
  bus.append(std::make_unique<Ek1100>());
  bus.append(std::make_unique<El1809>(plain));
  bus.append(std::make_unique<El2809>());
  EmulatedWire wire(bus);
  cell.slaves.pop_back();
  Exchange exchange(wire);
  Master master(set_up_bus(exchange, cell.slaves, {}), kMs, 20 * kMs, BusTime{});
  EXPECT_FALSE(master.bus().segments.at(0).combined);
  std::int64_t next = wire.now();
  static_cast<El1809&>(bus.slave(1)).set_channels(0x00ff, next);
  for (int i = 0; i < 80; ++i) {
    store<std::uint16_t>(master.outputs(2).data(), 0x0f0f);
    wire.advance_to(next += kMs);
    master.cycle(wire);
  }
  EXPECT_TRUE(master.operational());
  EXPECT_EQ(load<std::uint16_t>(master.inputs(1).data()), 0x00ff);
  EXPECT_EQ(static_cast<El2809&>(bus.slave(2)).channels(), 0x0f0f);
}

TEST(Topology, IsTheTreeOfTheBusAndItsDelays) {
  std::mt19937 random(3);
  for (int trial = 0; trial < 50; ++trial) {
    Bus bus;
    // Slaves are numbered in the order in which frames pass them, so each new one goes to the deepest place behind the last.
    struct Node {
      int parent, port;
    };
    std::vector<Node> nodes;
    constexpr std::array<int, 3> kPortOrder = {3, 1, 2};
    const auto grow = [&](auto& self, int parent, int port, int depth) -> void {
      const int n = static_cast<int>(nodes.size());
      if (n >= 12) return;
      nodes.push_back({parent, port});
      Connection c;
      c.parent = static_cast<std::size_t>(parent < 0 ? 0 : parent);
      c.port = port;
      c.cable = static_cast<std::int64_t>(random() % 600);
      SlaveOptions options = terminal_options();
      options.esc.ports = 0xff;
      bus.append(std::make_unique<El1809>(options), c);
      for (const int p : kPortOrder) {
        if (depth < 4 && random() % 2 == 0) self(self, n, p, depth + 1);
      }
    };
    grow(grow, -1, 1, 0);
    EmulatedWire wire(bus);
    Exchange exchange(wire);
    std::vector<ExpectedSlave> slaves(nodes.size(), expected("EL1809", kEl1809, 2, 0));
    SetupOptions options;
    options.clocks = true;
    options.drift_frames = 10;
    const BusSetup found = set_up_bus(exchange, slaves, options);
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      EXPECT_EQ(found.slaves[i].place.parent, nodes[i].parent) << trial << " " << i;
      if (i > 0) {
        EXPECT_EQ(found.slaves[i].place.parent_port, nodes[i].port);
      }
      EXPECT_NEAR(static_cast<double>(found.slaves[i].delay), static_cast<double>(bus.delay_to(i)), 6.0) << trial << " " << i;
    }
  }
}

TEST(Topology, GivesTheDelaysThatAnotherMasterWroteToARealBus) {
  const std::string file = captures_folder() + "/replay-dc.pcapng";
  if (file_bytes(file).empty()) GTEST_SKIP() << "needs scripts/fetch_logs.py --tests";
  struct Seen {
    SlavePorts ports;
    std::uint32_t delay = 0;
    bool written = false;
  };
  std::map<std::uint16_t, Seen> seen;
  for (const Captured& packet : read_pcapng(file)) {
    if (!packet.is_ethercat() || !packet.returned()) continue;
    FrameReader reader(packet.frame);
    Datagram d;
    while (reader.next(d)) {
      const std::span<const std::uint8_t> data = reader.data(d);
      Seen& s = seen[d.station()];
      if (d.command == Command::kFprd && d.working_counter == 1) {
        if (d.offset() == reg::kDlStatus && data.size() >= 2) s.ports.dl_status = load<std::uint16_t>(data.data());
        if (d.offset() >= reg::kReceiveTimes && d.offset() < reg::kReceiveTimes + 16 && data.size() >= 4) {
          s.ports.has_clock = true;
          for (std::size_t i = 0; i + 4 <= data.size() && d.offset() - reg::kReceiveTimes + i < 16; i += 4) {
            s.ports.receive_times[(d.offset() - reg::kReceiveTimes + i) / 4] = load<std::uint32_t>(data.data() + i);
          }
        }
      }
      if (d.command == Command::kFpwr && d.offset() == reg::kSystemTimeDelay && data.size() == 4) {
        s.delay = load<std::uint32_t>(data.data());
        s.written = true;
      }
    }
  }
  std::vector<SlavePorts> ports;
  std::vector<std::uint32_t> written;
  for (const auto& [station, s] : seen) {
    if (!s.written && !s.ports.has_clock) continue;
    ports.push_back(s.ports);
    written.push_back(s.delay);
  }
  ASSERT_EQ(ports.size(), 3u);
  EXPECT_EQ(propagation_delays(ports, find_topology(ports)), written);
}

}  // namespace
}  // namespace cotwin::ethercat::master_test
