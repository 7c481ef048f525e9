// The counter of an EL5101 with cycles that are lost, and its command to set it.
#include "components/io/links/ethercat_encoder.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <random>

#include "components/io/emulators/ethercat_slaves.h"

namespace cotwin::io::encoder_test {
namespace {

constexpr double kCycle = 1e-3, kPatience = 0.02;

/// The terminal: a set bit that rises sets the counter, and its confirmation follows the bit.
struct Terminal {
  explicit Terminal(bool wide_counters) : wide(wide_counters) {}
  bool wide, before = false;
  std::int64_t axis = 0, offset = 0;
  int settings = 0;
  std::array<std::uint8_t, 10> in{};
  void take(std::span<const std::uint8_t> out) {
    const bool set = read_bits(out, 2, 1) != 0;
    if (set && !before) {
      const std::uint32_t value = read_bits(out, wide ? 16 : 8, wide ? 32 : 16);
      offset = static_cast<std::int64_t>(wide ? static_cast<std::int32_t>(value) : static_cast<std::int16_t>(value)) - axis;
      ++settings;
    }
    before = set;
    write_bits(in, 2, 1, set ? 1 : 0);
  }
  void give() { write_bits(in, wide ? 16 : 8, wide ? 32 : 16, static_cast<std::uint32_t>(axis + offset)); }
};

/// A master with one step of delay, whose cycles may be lost or bad (outputs off at the terminal).
struct Loop {
  explicit Loop(bool wide) : encoder(wide), terminal(wide) { encoder.reset(); }
  EtherCatEncoder encoder;
  Terminal terminal;
  std::array<std::uint8_t, 10> answer{};
  bool answered = false;
  enum class Cycle { kGood, kAnswerLost, kFrameLost, kOff };
  void step(Cycle cycle = Cycle::kGood) {
    std::array<std::uint8_t, 6> out{};
    encoder.write(out, cycle != Cycle::kOff);
    encoder.advance(kCycle);
    if (answered) encoder.read(answer, false, kPatience);
    terminal.give();
    answer = terminal.in;
    answered = cycle == Cycle::kGood;
    if (cycle == Cycle::kOff) out.fill(0);
    if (cycle != Cycle::kFrameLost) terminal.take(out);
  }
};

TEST(EtherCatEncoder, SetsTheCounterOnceAlsoIfOutputsAreOffAfterwards) {
  for (const bool wide : {false, true}) {
    Loop loop(wide);
    for (int i = 0; i < 5; ++i) loop.step();
    loop.encoder.set_value = -100;
    loop.encoder.set = true;
    for (int i = 0; i < 5; ++i) loop.step();
    EXPECT_TRUE(loop.encoder.set_done);
    EXPECT_EQ(loop.terminal.settings, 1);
    loop.terminal.axis += 30;
    for (int i = 0; i < 5; ++i) loop.step(Loop::Cycle::kOff);
    for (int i = 0; i < 10; ++i) loop.step();
    EXPECT_EQ(loop.terminal.settings, 1) << "the terminal must not be set again";
    EXPECT_EQ(loop.encoder.count, -70);
    loop.encoder.set = false;
    loop.step();
    EXPECT_TRUE(loop.encoder.set_done);
    loop.encoder.set = true;
    loop.step();
    EXPECT_FALSE(loop.encoder.set_done);
    for (int i = 0; i < 5; ++i) loop.step();
    EXPECT_EQ(loop.terminal.settings, 2);
    EXPECT_EQ(loop.encoder.count, -100);
  }
}

TEST(EtherCatEncoder, CountsTheMovementOfTheAxisWhileItsCounterIsSet) {
  for (const bool wide : {false, true}) {
    Loop loop(wide);
    for (int i = 0; i < 30; ++i) {
      loop.terminal.axis += 7;
      if (i == 10) {
        loop.encoder.set_value = 32'760;  // the counter of 16 bits wraps soon afterwards
        loop.encoder.set = true;
      }
      loop.step();
    }
    // The counter of the terminal without wrapping, in the last data that the master has: those of the step before the last.
    EXPECT_EQ(loop.encoder.count, loop.terminal.axis + loop.terminal.offset - 7);
    EXPECT_GT(loop.encoder.count, 32'800);
  }
}

TEST(EtherCatEncoder, KeepsThePositionWhateverCyclesAreLostDuringASetting) {
  std::mt19937 random(5);
  for (int trial = 0; trial < 2000; ++trial) {
    Loop loop(trial % 2 == 0);
    for (int i = 0; i < 4; ++i) loop.step();
    loop.encoder.set_value = static_cast<int>(random() % 20'000) - 10'000;
    loop.encoder.set = true;
    for (int i = 0; i < 12; ++i) {
      loop.terminal.axis += static_cast<int>(random() % 11) - 5;
      const int kind = static_cast<int>(random() % 6);
      loop.step(kind < 3 ? Loop::Cycle::kGood : static_cast<Loop::Cycle>(kind - 2));
      ASSERT_TRUE(loop.encoder.set_done || std::abs(loop.encoder.count) < 200) << trial << ": a jump without a confirmation";
    }
    for (int i = 0; i < 10; ++i) loop.step();
    ASSERT_TRUE(loop.encoder.set_done) << trial;
    ASSERT_EQ(loop.encoder.count, loop.terminal.axis + loop.terminal.offset) << trial;
    const int settings = loop.terminal.settings;
    for (int i = 0; i < 3; ++i) loop.step(Loop::Cycle::kOff);
    for (int i = 0; i < 5; ++i) loop.step();
    ASSERT_EQ(loop.terminal.settings, settings) << trial;
  }
}

TEST(EtherCatEncoder, CancelsASettingThatIsWithdrawnWhileTheBusIsNotOperational) {
  Loop loop(true);
  for (int i = 0; i < 4; ++i) loop.step();
  for (int i = 0; i < 5; ++i) loop.step(Loop::Cycle::kOff);
  loop.encoder.set = true;
  for (int i = 0; i < 5; ++i) loop.step(Loop::Cycle::kOff);
  loop.encoder.set = false;
  for (int i = 0; i < 5; ++i) loop.step(Loop::Cycle::kOff);
  for (int i = 0; i < 10; ++i) loop.step();
  EXPECT_EQ(loop.terminal.settings, 0);
  EXPECT_FALSE(loop.encoder.set_done);
}

TEST(EtherCatEncoder, MeasuresTheSpeedOverTheTimeThatHasPassed) {
  Loop loop(true);
  for (int i = 0; i < 100; ++i) {
    loop.terminal.axis += 5;
    loop.step(i % 10 > 6 ? Loop::Cycle::kAnswerLost : Loop::Cycle::kGood);
    if (const auto speed = loop.encoder.pop_speed()) {
      EXPECT_NEAR(speed->value, 5000, 1e-6);  // 5 counts per ms
    }
  }
}

TEST(EtherCatEncoder, SaysThatANarrowCounterMayHaveWrapped) {
  for (const bool wide : {false, true}) {
    Loop loop(wide);
    for (int i = 0; i < 5; ++i) loop.step();
    for (int i = 0; i < 15; ++i) loop.step(Loop::Cycle::kFrameLost);
    for (int i = 0; i < 3; ++i) loop.step();
    EXPECT_FALSE(loop.encoder.uncertain) << "within the patience";
    for (int i = 0; i < 100; ++i) {
      loop.terminal.axis += 1000;
      loop.step(Loop::Cycle::kFrameLost);
    }
    for (int i = 0; i < 3; ++i) loop.step();
    EXPECT_EQ(loop.encoder.uncertain, !wide);
    EXPECT_EQ(loop.encoder.may_have_wrapped(), !wide);
    if (wide) {
      EXPECT_EQ(loop.encoder.count, 100'000);
    }
    loop.encoder.set = true;
    for (int i = 0; i < 5; ++i) loop.step();
    EXPECT_FALSE(loop.encoder.uncertain) << "its position is known again";
  }
}

}  // namespace
}  // namespace cotwin::io::encoder_test
