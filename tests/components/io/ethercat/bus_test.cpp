// Topology, faults of cables, and distributed clocks of the emulated bus.
#include "components/io/emulators/ethercat/bus.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/devices.h"
#include "tests/components/io/ethercat/wire.h"
#include "tests/support/error_of.h"

namespace cotwin::ethercat::bus_test {
namespace {

using Bytes = std::vector<std::uint8_t>;
using ::testing::HasSubstr;

std::uint16_t station(std::size_t n) { return static_cast<std::uint16_t>(0x1001 + n); }

std::unique_ptr<Slave> clocked(double drift = 0, double jitter = 0, std::uint64_t start = 0) {
  return std::make_unique<Slave>(write_sii(Sii{}),
                                 terminal_options({.drift = drift, .jitter = jitter, .start = start, .seed = start + 1}));
}

/// Receive time of a frame at a port.
std::int64_t received(BusWire& w, std::size_t n, int port) {
  return static_cast<std::int64_t>(w.read(station(n), static_cast<std::uint16_t>(reg::kReceiveTimes + 4 * port), 4).value());
}

void latch(BusWire& w) { w.send(Command::kBwr, at_position(0, reg::kReceiveTimes), Bytes(4)); }

TEST(Bus, TheDelaysOfALineFollowFromItsReceiveTimesAsInTheExampleOfTheCoupler) {
  // EK1100, EL1809, EL2809, EL5101: 1800, 1200 and 600 ns around the loops behind each.
  Bus bus;
  bus.append(std::make_unique<Ek1100>());
  bus.append(std::make_unique<El1809>());
  bus.append(std::make_unique<El2809>());
  bus.append(std::make_unique<El5101>());
  BusWire w(bus);
  w.number_stations();
  latch(w);
  std::int64_t loop[4] = {};
  for (std::size_t n = 0; n < 3; ++n) loop[n] = received(w, n, 1) - received(w, n, 0);
  EXPECT_EQ(loop[0], 1800);
  EXPECT_EQ(loop[1], 1200);
  EXPECT_EQ(loop[2], 600);
  std::int64_t delay = 0;
  for (std::size_t n = 1; n < 4; ++n) {
    delay += (loop[n - 1] - loop[n]) / 2;
    EXPECT_EQ(delay, static_cast<std::int64_t>(300 * n));
    EXPECT_EQ(bus.delay_to(n), delay);
  }
}

TEST(Bus, AFrameVisitsABranchInTheOrderOfThePorts) {
  //        0
  //  port 3 | 1 | 2
  //         1   3   4
  //   port 1|
  //         2
  Bus bus;
  bus.append(clocked());
  bus.append(clocked(), {.parent = 0, .port = 3, .cable = 100, .forward = 300, .backward = 300});
  bus.append(clocked(), {.parent = 1, .port = 1, .cable = 200, .forward = 300, .backward = 300});
  bus.append(clocked(), {.parent = 0, .port = 1, .cable = 50, .forward = 300, .backward = 300});
  bus.append(clocked(), {.parent = 0, .port = 2, .cable = 70, .forward = 300, .backward = 300});
  BusWire w(bus);
  w.number_stations();  // numbers in the order of the ports are those of append()
  for (std::size_t n = 0; n < 5; ++n) EXPECT_EQ(bus.slave(n).esc().word(reg::kStation), station(n));
  latch(w);
  const std::int64_t t0 = received(w, 0, 0), t3 = received(w, 0, 3), t1 = received(w, 0, 1), t2 = received(w, 0, 2);
  // Forward 290 in slave 0; cable 100; forward 300 in 1; cable 200, forward 300 in 2, cable 200; backward 300 in 1; cable 100.
  EXPECT_EQ(t3 - t0, 290 + 100 + 300 + 200 + 300 + 200 + 300 + 100);
  EXPECT_EQ(t1 - t3, 290 + 50 + 300 + 50);
  EXPECT_EQ(t2 - t1, 290 + 70 + 300 + 70);
  EXPECT_EQ(received(w, 1, 1) - received(w, 1, 0), 300 + 200 + 300 + 200);
  // A later child: half of its loop, and the loops of the earlier children.
  EXPECT_EQ(bus.delay_to(3), (t3 - t0) + 290 + 50);
  EXPECT_EQ(bus.delay_to(4), (t1 - t0) + 290 + 70);
  EXPECT_EQ(bus.delay_to(2), 290 + 100 + 300 + 200);
  // Slave 0 has four links and no closed loop, slave 1 two, the others are ends.
  const std::uint64_t status[] = {0xaaf1, 0x5a31, 0x5611, 0x5611, 0x5611};
  for (std::size_t n = 0; n < 5; ++n) EXPECT_EQ(w.read(station(n), reg::kDlStatus, 2).value(), status[n]) << n;
}

TEST(Bus, TheLastBitComesBackAfterAllDelaysAndTheLengthOfTheFrame) {
  Bus bus;
  bus.append(clocked(), {.parent = 0, .port = 1, .cable = 500, .forward = 300, .backward = 200});
  bus.append(clocked(), {.parent = 0, .port = 1, .cable = 530, .forward = 310, .backward = 200});
  BusWire w(bus);
  w.send(Command::kNop, 0, Bytes(2));
  // 60 bytes, preamble 8 and check sequence 4 at 80 ns each.
  EXPECT_EQ(w.arrival - w.now, 500 + 300 + 530 + 310 + 530 + 200 + 500 + 72 * 80);
}

TEST(Bus, PlacesThatAreTakenOrMissingAreNamed) {
  Bus bus;
  bus.append(clocked());
  bus.append(clocked());
  const auto error = [&](const Connection& c) { return cotwin::testing::error_of([&] { bus.append(clocked(), c); }); };
  EXPECT_THAT(error({.parent = 0, .port = 1}), HasSubstr("slave 2: port 1 of slave 0 is taken by slave 1"));
  EXPECT_THAT(error({.parent = 7, .port = 1}), HasSubstr("behind slave 7, expected one before it"));
  EXPECT_THAT(error({.parent = 1, .port = 0}), HasSubstr("at port 0, expected 1, 2 or 3"));
  EXPECT_EQ(bus.size(), 2u);
}

TEST(Bus, ACutCableShortensTheBusAndIsCounted) {
  Bus bus;
  for (int i = 0; i < 4; ++i) bus.append(clocked());
  BusWire w(bus);
  w.number_stations();
  const auto count = [&] { return w.send(Command::kBrd, 0, Bytes(1)).count; };
  EXPECT_EQ(count(), 4);
  bus.cut(2, true);
  EXPECT_EQ(count(), 2);
  EXPECT_EQ(w.read(station(1), reg::kDlStatus, 2).value(), 0x5611u);
  EXPECT_EQ(w.read(station(1), reg::kLostLinks + 1, 1).value(), 1u);
  bus.cut(2, false);
  EXPECT_EQ(count(), 4);
  EXPECT_EQ(w.read(station(2), reg::kLostLinks, 1).value(), 1u);
  EXPECT_EQ(w.read(station(2), reg::kStation, 2).value(), station(2));  // it was on all the time
  bus.power(1, false, w.now);
  EXPECT_EQ(count(), 1);
  bus.power(1, true, w.now);
  EXPECT_EQ(count(), 4);
  EXPECT_EQ(w.read(station(1), reg::kStation, 2).count, 0);  // it has lost its number
  bus.cut(0, true);
  EXPECT_EQ(count(), -1);
}

TEST(Bus, APortThatIsForcedClosedEndsTheBusAndForcedOpenLosesTheFrame) {
  Bus bus;
  for (int i = 0; i < 3; ++i) bus.append(clocked());
  BusWire w(bus);
  w.number_stations();
  w.write(station(0), reg::kPortControl, std::uint8_t{0x0c});
  EXPECT_EQ(w.send(Command::kBrd, 0, Bytes(1)).count, 1);
  w.write(station(0), reg::kPortControl, std::uint8_t{0x00});
  EXPECT_EQ(w.send(Command::kBrd, 0, Bytes(1)).count, 3);
  w.write(station(0), reg::kPortControl, std::uint8_t{0x20});  // port 2 open without a neighbour
  EXPECT_EQ(w.send(Command::kBrd, 0, Bytes(1)).count, -1);
}

TEST(Bus, ADamagedFrameHasNoEffectAndIsCountedFromWhereItHappened) {
  Bus bus;
  for (int i = 0; i < 3; ++i) bus.append(clocked());
  BusWire w(bus);
  w.number_stations();
  bus.damage_next(1);
  EXPECT_EQ(w.send(Command::kBwr, at_position(0, reg::kProcessRam), {1}).count, -1);
  EXPECT_EQ(w.read(station(0), reg::kErrorCounters, 1).value(), 0u);
  EXPECT_EQ(w.read(station(1), reg::kErrorCounters, 1).value(), 1u);
  EXPECT_EQ(w.read(station(2), reg::kErrorCounters, 1).value(), 0u);
  EXPECT_EQ(w.read(station(2), reg::kForwardedErrors, 1).value(), 1u);
  EXPECT_EQ(w.read(station(1), reg::kProcessRam, 1).value(), 0u);
  w.write(station(1), reg::kErrorCounters, std::uint8_t{0});
  EXPECT_EQ(w.read(station(1), reg::kErrorCounters, 1).value(), 0u);
}

// ------------------------------------------------------------------------------------------------------- distributed clocks

/// Sets offsets and delays of all slaves from the known ones, as a master finds them, with the first as reference.
void set_clocks(BusWire& w) {
  latch(w);
  const std::int64_t reference = 700'000'000'000'000'000;  // ns since 2000
  for (std::size_t n = 0; n < w.bus.size(); ++n) {
    const std::uint64_t local = w.read(station(n), reg::kReceiveTime, 8).value();
    const auto delay = static_cast<std::uint32_t>(w.bus.delay_to(n));
    w.write(station(n), reg::kSystemTimeOffset, static_cast<std::uint64_t>(reference) + delay - local);
    w.write(station(n), reg::kSystemTimeDelay, delay);
    w.write(station(n), reg::kSpeedCounterStart, std::uint16_t{0x1000});
  }
}

/// Error of a slave's system time against the first slave's, ns, at the same instant.
std::int64_t error(BusWire& w, std::size_t n) {
  return static_cast<std::int64_t>(w.bus.slave(n).esc().clock().system_time(w.now) -
                                   w.bus.slave(0).esc().clock().system_time(w.now));
}

void distribute(BusWire& w, int frames, std::int64_t period = 1'000'000) {
  for (int i = 0; i < frames; ++i) {
    w.now += period - 1000;
    w.send(Command::kFrmw, at_station(station(0), reg::kSystemTime), Bytes(8));
  }
}

/// Five slaves with 50 ppm drift to both sides and 100 m of cable between them.
Bus drifting_bus(double jitter) {
  Bus bus;
  const double drifts[] = {20e-6, 50e-6, -50e-6, -35e-6, 50e-6};
  for (std::size_t n = 0; n < 5; ++n) {
    Connection c;
    c.parent = n == 0 ? 0 : n - 1;
    c.cable = 530;
    bus.append(clocked(drifts[n], jitter, 1'000'000'007 * n), c);
  }
  return bus;
}

TEST(DistributedClock, RunsAwayByItsDriftWithoutCorrection) {
  Bus bus;
  bus.append(clocked(50e-6, 0, 123));
  BusWire w(bus);
  // local = start + t (1 + drift)
  for (const std::int64_t t : {1'000L, 1'000'000'000L, 3'600'000'000'000L}) {
    EXPECT_EQ(bus.slave(0).esc().clock().local(t), 123u + static_cast<std::uint64_t>(t + t / 20000)) << t;
  }
}

TEST(DistributedClock, AStepOfThePhaseDecaysWithTheDoublePoleOfItsLoop) {
  // No low-pass, g = 2^-(12 - 4): e after k corrections is rho^k (1 - k (1 - rho) / rho) e of the start, rho = sqrt(1 - g).
  SlaveClock clock({.start = 100'000});
  clock.set_filters(0, 12);
  const double rho = std::sqrt(1 - 1.0 / 256);
  for (int k = 0; k <= 4000; ++k) {
    const std::int64_t t = 1'000'000 * std::int64_t{k};
    const double e = static_cast<double>(clock.local(t)) - static_cast<double>(t);
    if (k > 0) {
      const int n = k - 1;  // the first time only starts the loop
      EXPECT_NEAR(e, std::pow(rho, n) * (1 - n * (1 - rho) / rho) * 1e5, 5) << k;
    }
    clock.receive(static_cast<std::uint64_t>(t), 64, clock.stamp(t), t);
  }
}

TEST(DistributedClock, KeepsAllSlavesWithinAHundredNanosecondsOfTheReference) {
  for (const double jitter : {0.0, 20.0}) {
    for (const std::int64_t period : {250'000L, 1'000'000L, 4'000'000L}) {
      Bus bus = drifting_bus(jitter);
      BusWire w(bus);
      w.number_stations();
      set_clocks(w);
      w.send(Command::kBwr, at_position(0, reg::kDifferenceFilter), {0, 0x0c});  // as masters do
      distribute(w, 10'000, period);
      std::int64_t worst = 0;
      for (int i = 0; i < 2000; ++i) {
        distribute(w, 1, period);
        for (std::size_t n = 1; n < 5; ++n) worst = std::max(worst, std::abs(error(w, n)));
      }
      EXPECT_LE(worst, jitter == 0 ? 20 : 60) << "jitter " << jitter << " period " << period;
      EXPECT_LT(w.read(station(4), reg::kSystemTimeDifference, 4).value() & 0x7fffffff, 100u);
      // The speed counter holds what the drifts differ by: d / (5 (s + 2 + d) (s + 2 - d)), s = 0x1000.
      const double d = static_cast<std::int16_t>(w.read(station(2), reg::kSpeedCounterDifference, 2).value());
      EXPECT_NEAR(d / (5 * (4098 + d) * (4098 - d)), (1 + 20e-6) / (1 - 50e-6) - 1, 3e-7);
    }
  }
}

TEST(DistributedClock, TheReferenceIsNotChanged) {
  Bus bus = drifting_bus(0);
  BusWire w(bus);
  w.number_stations();
  set_clocks(w);
  const SlaveClock& clock = bus.slave(0).esc().clock();
  const std::uint64_t before = clock.local(w.now);
  const std::int64_t t = w.now;
  distribute(w, 1000);
  EXPECT_EQ(static_cast<std::int64_t>(clock.local(w.now) - before), std::llround(static_cast<double>(w.now - t) * (1 + 20e-6)));
  EXPECT_EQ(clock.difference(), 0u);
}

TEST(DistributedClock, EveryFrameReadsTheSameTimeFromAllSlavesOnceTheyAgree) {
  // A frame reads at 0x0910 the time when it passed the reference clock.
  Bus bus = drifting_bus(0);
  BusWire w(bus);
  w.number_stations();
  set_clocks(w);
  distribute(w, 8000);
  Bytes frame(400);
  FrameWriter writer(frame);
  writer.begin();
  for (std::size_t n = 0; n < 5; ++n) writer.add(Command::kFprd, 0, at_station(station(n), reg::kSystemTime), 8);
  const std::size_t size = writer.finish().size();
  bus.transmit(std::span(frame).first(size), w.now += 1000);
  FrameReader reader(std::span<const std::uint8_t>(frame).first(size));
  Datagram d;
  reader.next(d);
  const auto reference = static_cast<std::int64_t>(load<std::uint64_t>(&frame[d.data]));
  while (reader.next(d))
    EXPECT_NEAR(static_cast<double>(static_cast<std::int64_t>(load<std::uint64_t>(&frame[d.data])) - reference), 0, 20);
}

TEST(DistributedClock, ALateSlaveAndAStepOfTheReferenceAreFollowed) {
  Bus bus = drifting_bus(10);
  BusWire w(bus);
  w.number_stations();
  bus.power(4, false, w.now);
  set_clocks(w);
  distribute(w, 6000);
  bus.power(4, true, w.now);
  w.number_stations();
  set_clocks(w);
  distribute(w, 8000);
  EXPECT_LE(std::abs(error(w, 4)), 60);
  // A step of 2 ms: at most a tenth of the time is made good, 20 ms for it.
  const std::uint64_t offset = bus.slave(0).esc().clock().offset();
  w.write(station(0), reg::kSystemTimeOffset, offset + 2'000'000);
  distribute(w, 1);
  EXPECT_NEAR(static_cast<double>(error(w, 1)), -2'000'000, 110'000);
  distribute(w, 12'000);
  for (std::size_t n = 1; n < 5; ++n) EXPECT_LE(std::abs(error(w, n)), 60) << n;
}

TEST(DistributedClock, ATimeOf32BitsIsComparedWithTheLowHalf) {
  for (const std::size_t bytes : {4u, 8u}) {
    Bus bus;
    bus.append(clocked(0, 0, 5'000'000'000));
    BusWire w(bus);
    w.number_stations();
    w.send(Command::kFpwr, at_station(station(0), reg::kSystemTime), Bytes(bytes));
    // 5 s more than the received 0: limited to 31 bits, or 5e9 - 2^32 ns.
    const double difference = static_cast<double>(w.read(station(0), reg::kSystemTimeDifference, 4).value());
    EXPECT_NEAR(difference, bytes == 8 ? 2147483647.0 : 5e9 - 4294967296.0, 1e4);
  }
}

TEST(DistributedClock, TheSameSeedGivesTheSameBits) {
  std::vector<std::uint64_t> times[2];
  for (auto& list : times) {
    Bus bus = drifting_bus(20);
    BusWire w(bus);
    w.number_stations();
    set_clocks(w);
    for (int i = 0; i < 100; ++i) {
      distribute(w, 1);
      list.push_back(w.read(station(3), reg::kSystemTime, 8).value());
    }
  }
  EXPECT_EQ(times[0], times[1]);
}

TEST(DistributedClock, Sync0OfAllSlavesComesAtTheSameInstant) {
  Bus bus = drifting_bus(0);
  BusWire w(bus);
  w.number_stations();
  set_clocks(w);
  distribute(w, 8000);
  const std::uint64_t now = w.read(station(0), reg::kSystemTime, 8).value();
  const std::uint64_t cycle = 500'000, start = (now + 20'000'000) / cycle * cycle + cycle;
  for (std::size_t n = 0; n < 5; ++n) {
    w.write(station(n), reg::kStartTime, start);
    w.write(station(n), reg::kSync0Cycle, static_cast<std::uint32_t>(cycle));
    w.write(station(n), reg::kActivation, std::uint8_t{3});
  }
  EXPECT_EQ(w.read(station(2), reg::kActivationStatus, 1).value(), 1u);  // not begun
  distribute(w, 100);
  std::vector<std::int64_t> pulses;
  for (std::size_t n = 0; n < 5; ++n) {
    bus.slave(n).advance(w.now);
    const SlaveClock& clock = bus.slave(n).esc().clock();
    pulses.push_back(clock.next_sync0_at(w.now).value());
    const std::uint64_t expected = (clock.system_time(w.now) - start) / cycle + 1;
    EXPECT_EQ(clock.sync0_count(), expected);
    EXPECT_EQ(w.read(station(n), reg::kStartTime, 8).value() % cycle, 0u);
  }
  const auto [first, last] = std::minmax_element(pulses.begin(), pulses.end());
  EXPECT_LE(*last - *first, 40);
  // A start in the past never comes.
  w.write(station(1), reg::kActivation, std::uint8_t{0});
  w.write(station(1), reg::kStartTime, start);
  w.write(station(1), reg::kActivation, std::uint8_t{3});
  EXPECT_FALSE(bus.slave(1).esc().clock().next_sync0_at(w.now).has_value());
}

}  // namespace
}  // namespace cotwin::ethercat::bus_test
