// The master and the time of the bus: after silence, restarts of clocks and gaps of the host's clock.
#include <gtest/gtest.h>

#include "tests/components/io/ethercat/cell.h"

namespace cotwin::ethercat::master_time_test {
namespace {

TEST(Master, KeepsTheTimeOfTheBusWhenTheReferenceClockWasOff) {
  Cell cell;
  cell.set_up();
  cell.cycles(100);
  const std::int64_t before = cell.master->system_time();
  EXPECT_LT(std::abs(before - cell.options.system_time), 60'000'000'000);
  cell.bus.power(0, false, cell.wire.now());
  cell.cycles(200);
  EXPECT_FALSE(cell.master->operational());
  cell.bus.power(0, true, cell.wire.now());
  // The others keep their time from the first frame on, which finds a reference without address and time.
  for (int i = 0; i < 50; ++i) {
    cell.cycles(1);
    const std::int64_t now = cell.wire.now();
    for (std::size_t s = 1; s < 4; ++s) {
      const auto own = static_cast<std::int64_t>(cell.bus.slave(s).esc().clock().system_time(now));
      ASSERT_LT(std::abs(own - (cell.options.system_time + now)), 200'000) << "slave " << s << ", cycle " << i;
    }
  }
  cell.cycles(20'000);
  ASSERT_TRUE(cell.master->operational());
  EXPECT_NEAR(static_cast<double>(cell.master->system_time() - before), 20.25e9, 0.02e9);
  const std::int64_t now = cell.wire.now();
  const auto reference = static_cast<std::int64_t>(cell.bus.slave(0).esc().clock().system_time(now));
  for (std::size_t s = 1; s < 4; ++s) {
    const auto own = static_cast<std::int64_t>(cell.bus.slave(s).esc().clock().system_time(now));
    EXPECT_LT(std::abs(own - reference), 100) << "slave " << s;
  }
}

/// Moves the time on without the master.
void pass(Cell& cell, std::int64_t time) {
  cell.wire.advance_to(cell.wire.now() + time);
  cell.next = cell.wire.now() + kMs;
}

TEST(Master, FindsTheTimeOfTheBusAgainAfterALongSilence) {
  // At 100 ppm the clocks of host and reference come apart by 60 ms in 10 minutes.
  for (const bool late : {false, true}) {
    Cell cell(true, {100e-6, -50e-6, 50e-6, 35e-6});
    cell.options.drift_frames = 2000;
    cell.set_up();
    if (late) {
      pass(cell, 700'000 * kMs);  // to the first cycle
    } else {
      cell.cycles(200);
      cell.wire.unplug(true);
      cell.cycles(100);
      pass(cell, 600'000 * kMs);
      cell.wire.unplug(false);
    }
    cell.cycles(3000);
    ASSERT_TRUE(cell.master->operational()) << late;
    EXPECT_LT(cell.wire.now() - cell.master->system_time_at(), 2 * kMs) << late;
    EXPECT_EQ(cell.master->counters().clock_steps, 0);
    cell.bus.power(3, false, cell.wire.now());
    cell.cycles(50);
    cell.bus.power(3, true, cell.wire.now());
    cell.cycles(5000);
    EXPECT_TRUE(cell.master->operational()) << late << ": a slave whose clock is set again";
  }
}

TEST(Master, FollowsAStepOfTheReferenceThatDidNotRestart) {
  // A suspended host: its clock stands while that of the bus goes on.
  class Suspended final : public Wire {
   public:
    explicit Suspended(Wire& wire) : wire_(wire) {}
    bool send(std::span<const std::uint8_t> frame) override { return wire_.send(frame); }
    std::size_t receive(std::span<std::uint8_t> buffer, std::int64_t deadline) override {
      return wire_.receive(buffer, deadline == 0 ? 0 : deadline + gap);
    }
    std::int64_t now() const override { return wire_.now() - gap; }
    std::int64_t received_at() const override { return wire_.received_at() - gap; }
    std::int64_t gap = 0;

   private:
    Wire& wire_;
  };
  Cell cell;
  cell.options.drift_frames = 2000;
  cell.set_up();
  Suspended wire(cell.wire);
  const auto cycles = [&](int n) {
    for (int i = 0; i < n; ++i) {
      cell.wire.advance_to(cell.next);
      cell.next += kMs;
      cell.master->cycle(wire);
    }
  };
  cycles(200);
  ASSERT_TRUE(cell.master->operational());
  constexpr std::int64_t kHour = 3'600'000 * kMs;
  wire.gap = kHour;
  pass(cell, kHour);
  cycles(40);
  EXPECT_EQ(cell.master->counters().clock_steps, 0) << "not by a few answers";
  cycles(3000);
  ASSERT_TRUE(cell.master->operational());
  EXPECT_EQ(cell.master->counters().clock_steps, 1);
  EXPECT_LT(wire.now() - cell.master->system_time_at(), 2 * kMs);
  EXPECT_LT(std::abs(cell.master->system_time() - (cell.options.system_time + cell.wire.now())), 1000 * kMs);
  cell.bus.power(3, false, cell.wire.now());
  cycles(50);
  cell.bus.power(3, true, cell.wire.now());
  cycles(5000);
  EXPECT_TRUE(cell.master->operational());
}

}  // namespace
}  // namespace cotwin::ethercat::master_time_test
