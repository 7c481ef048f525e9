// The drive profile CiA 402 as tables of IEC 61800-7-201, and the side of the master against all of its states: components/io/ethercat/cia402.h.
#include <gtest/gtest.h>

#include <array>
#include <optional>
#include <random>

#include "components/io/ethercat/cia402.h"

namespace cotwin::cia402::cia402_test {
namespace {

using S = State;
using C = Command;

constexpr std::array kStates{S::kNotReady,         S::kSwitchOnDisabled, S::kReadyToSwitchOn, S::kSwitchedOn,
                             S::kOperationEnabled, S::kQuickStop,        S::kFaultReaction,   S::kFault};
constexpr std::array kCommands{C::kShutdown,       C::kSwitchOn,  C::kEnableOperation,
                               C::kDisableVoltage, C::kQuickStop, C::kFaultReset};

// Table "state coding" of 6041h: the bits 6 5 3 2 1 0, x = any.
TEST(Cia402, FindsTheStateInEveryStatusWord) {
  struct Coding {
    const char* bits;  // 6 5 . 3 2 1 0
    State state;
  };
  constexpr Coding kTable[] = {{"0x.0000", S::kNotReady},         {"1x.0000", S::kSwitchOnDisabled},
                               {"01.0001", S::kReadyToSwitchOn},  {"01.0011", S::kSwitchedOn},
                               {"01.0111", S::kOperationEnabled}, {"00.0111", S::kQuickStop},
                               {"0x.1111", S::kFaultReaction},    {"0x.1000", S::kFault}};
  const auto fits = [](const char* bits, unsigned word) {
    for (int i = 0; i < 7; ++i) {
      const bool set = (word >> (6 - i) & 1) != 0;
      if (bits[i] != 'x' && bits[i] != '.' && (bits[i] == '1') != set) return false;
    }
    return true;
  };
  int coded = 0;
  for (unsigned word = 0; word <= 0xffff; ++word) {
    std::optional<State> expected;
    for (const Coding& c : kTable) {
      if (fits(c.bits, word)) expected = c.state;
    }
    coded += expected.has_value();
    ASSERT_EQ(state_of(static_cast<std::uint16_t>(word)), expected.value_or(S::kNotReady)) << word;
  }
  EXPECT_EQ(coded, 65536 / 64 * (2 + 2 + 1 + 1 + 1 + 1 + 2 + 2));
  for (const State s : kStates) EXPECT_EQ(state_of(status_of(s)), s);
}

// Table "command coding" of 6040h: the bits 7 3 2 1 0.
TEST(Cia402, FindsTheCommandInEveryControlWord) {
  for (unsigned before = 0; before <= 0xff; before += 0x80) {
    for (unsigned word = 0; word <= 0xff; ++word) {
      const bool b0 = word & 1, b1 = word & 2, b2 = word & 4, b3 = word & 8, edge = (word & 0x80) && !(before & 0x80);
      const Command expected = edge  ? C::kFaultReset
                               : !b1 ? C::kDisableVoltage  // 0 x x 0 x
                               : !b2 ? C::kQuickStop       // 0 x 0 1 x
                               : !b0 ? C::kShutdown        // 0 x 1 1 0
                               : !b3 ? C::kSwitchOn
                                     : C::kEnableOperation;  // 0 0 1 1 1, 0 1 1 1 1
      ASSERT_EQ(command_of(static_cast<std::uint16_t>(word), static_cast<std::uint16_t>(before)), expected)
          << before << " " << word;
    }
  }
  for (const Command c : kCommands) EXPECT_EQ(command_of(control_of(c), 0), c);
}

// The transitions of the standard; every other pair leaves the state as it is.
TEST(Cia402, MakesTheTransitionsOfTheStandardAndNoOthers) {
  struct Transition {
    int number;
    State from;
    Command command;
    State to;
  };
  const Transition kTable[] = {{2, S::kSwitchOnDisabled, C::kShutdown, S::kReadyToSwitchOn},
                               {3, S::kReadyToSwitchOn, C::kSwitchOn, S::kSwitchedOn},
                               {3, S::kReadyToSwitchOn, C::kEnableOperation, S::kSwitchedOn},
                               {4, S::kSwitchedOn, C::kEnableOperation, S::kOperationEnabled},
                               {5, S::kOperationEnabled, C::kSwitchOn, S::kSwitchedOn},
                               {6, S::kSwitchedOn, C::kShutdown, S::kReadyToSwitchOn},
                               {7, S::kReadyToSwitchOn, C::kDisableVoltage, S::kSwitchOnDisabled},
                               {7, S::kReadyToSwitchOn, C::kQuickStop, S::kSwitchOnDisabled},
                               {8, S::kOperationEnabled, C::kShutdown, S::kReadyToSwitchOn},
                               {9, S::kOperationEnabled, C::kDisableVoltage, S::kSwitchOnDisabled},
                               {10, S::kSwitchedOn, C::kDisableVoltage, S::kSwitchOnDisabled},
                               {10, S::kSwitchedOn, C::kQuickStop, S::kSwitchOnDisabled},
                               {11, S::kOperationEnabled, C::kQuickStop, S::kQuickStop},
                               {12, S::kQuickStop, C::kDisableVoltage, S::kSwitchOnDisabled},
                               {15, S::kFault, C::kFaultReset, S::kSwitchOnDisabled},
                               {16, S::kQuickStop, C::kEnableOperation, S::kOperationEnabled}};
  for (const bool fault : {false, true}) {
    for (const State from : kStates) {
      for (const Command command : kCommands) {
        State expected = from;
        for (const Transition& t : kTable) {
          if (t.from == from && t.command == command && !(t.number == 15 && fault)) expected = t.to;
        }
        EXPECT_EQ(after(from, command, fault), expected) << static_cast<int>(from) << " " << static_cast<int>(command);
      }
    }
  }
}

/// A drive that makes each transition at once.
struct Drive {
  State state = S::kSwitchOnDisabled;
  std::uint16_t control = 0;
  bool cause = false, rests = true;

  void take(std::uint16_t word) {
    state = after(state, command_of(word, control), cause);
    control = word;
  }
  void cycles(Axis& axis, Wish wish, int n) {
    for (int i = 0; i < n; ++i) {
      axis.see(status_of(state), rests);
      take(axis.control(wish));
    }
  }
};

TEST(Cia402Axis, EnablesADriveFromEveryStateButAFault) {
  for (const State from : kStates) {
    Drive drive{from};
    Axis axis;
    drive.cycles(axis, Wish::kOn, 5);
    const bool waits = from == S::kNotReady || from == S::kFaultReaction || from == S::kFault;
    EXPECT_EQ(drive.state, waits ? from : S::kOperationEnabled) << static_cast<int>(from);
    EXPECT_FALSE(axis.fell());
  }
}

TEST(Cia402Axis, NeverEnablesADriveThatIsToBeOffOrToStop) {
  for (const Wish wish : {Wish::kOff, Wish::kStop}) {
    for (const State from : kStates) {
      Drive drive{from};
      Axis axis;
      for (int i = 0; i < 6; ++i) {
        axis.see(status_of(drive.state), true);
        const std::uint16_t word = axis.control(wish);
        EXPECT_NE(command_of(word, 0), C::kEnableOperation);
        EXPECT_NE(command_of(word, 0), C::kFaultReset);
        drive.take(word);
      }
      const bool stops = wish == Wish::kStop && (from == S::kOperationEnabled || from == S::kQuickStop);
      const bool waits = from == S::kNotReady || from == S::kFaultReaction || from == S::kFault;
      EXPECT_EQ(drive.state, stops ? S::kQuickStop : waits ? from : S::kSwitchOnDisabled) << static_cast<int>(from);
    }
  }
}

TEST(Cia402Axis, NeverCutsAQuickStopShort) {
  for (const Wish wish : {Wish::kOff, Wish::kStop, Wish::kOn}) {
    Drive drive{S::kQuickStop};
    drive.rests = false;
    Axis axis;
    for (int i = 0; i < 20; ++i) {
      drive.cycles(axis, wish, 1);
      ASSERT_EQ(drive.control, control_of(C::kQuickStop)) << static_cast<int>(wish);
    }
    drive.rests = true;
    drive.cycles(axis, wish, 5);
    const S end = wish == Wish::kOn ? S::kOperationEnabled : wish == Wish::kOff ? S::kSwitchOnDisabled : S::kQuickStop;
    EXPECT_EQ(drive.state, end) << static_cast<int>(wish);
  }
}

TEST(Cia402Axis, ResetsAFaultOnceAndOnlyIfItIsAsked) {
  Drive drive{S::kFault};
  Axis axis;
  drive.cycles(axis, Wish::kOn, 50);
  EXPECT_EQ(drive.state, S::kFault) << "nobody asked";
  axis.reset_fault();
  drive.cycles(axis, Wish::kOn, 10);
  EXPECT_EQ(drive.state, S::kOperationEnabled);
  drive.state = S::kFault;
  drive.cycles(axis, Wish::kOn, 50);
  EXPECT_EQ(drive.state, S::kFault) << "the request was for the fault before";
  // A cause that goes later: the drive must not come back by itself.
  drive.cause = true;
  axis.reset_fault();
  drive.cycles(axis, Wish::kOn, 10);
  EXPECT_EQ(drive.state, S::kFault);
  drive.cause = false;
  drive.cycles(axis, Wish::kOn, 50);
  EXPECT_EQ(drive.state, S::kFault);
  axis.reset_fault();
  drive.cycles(axis, Wish::kOn, 10);
  EXPECT_EQ(drive.state, S::kOperationEnabled) << "a second edge";
}

TEST(Cia402Axis, SaysOnceThatADriveLeftOperationByItself) {
  for (const State to : {S::kFaultReaction, S::kFault, S::kSwitchOnDisabled, S::kQuickStop, S::kNotReady}) {
    Drive drive;
    Axis axis;
    drive.cycles(axis, Wish::kOn, 5);
    axis.see(status_of(to), true);
    EXPECT_TRUE(axis.fell());
    axis.control(Wish::kOn);
    axis.see(status_of(to), true);
    EXPECT_FALSE(axis.fell());
  }
  Drive drive;
  Axis axis;
  drive.cycles(axis, Wish::kOn, 5);
  drive.cycles(axis, Wish::kStop, 2);
  EXPECT_EQ(axis.state(), S::kQuickStop);
  EXPECT_FALSE(axis.fell()) << "it was wished";
}

// Whatever a drive does: no control word enables it unless it is wished on, and no fault is reset without a request.
TEST(Cia402Axis, StaysSafeWithAnyStatusWords) {
  std::mt19937 random(1);
  Axis axis;
  std::uint16_t before = 0;
  for (int i = 0; i < 200'000; ++i) {
    const auto wish = static_cast<Wish>(random() % 3);
    axis.see(static_cast<std::uint16_t>(random()), random() % 2 == 0);
    const std::uint16_t word = axis.control(wish);
    const Command command = command_of(word, before);
    ASSERT_TRUE(wish == Wish::kOn || command != C::kEnableOperation);
    ASSERT_NE(command, C::kFaultReset);
    before = word;
  }
}

// Table "homing" of 6041h: bits 13, 12 and 10.
TEST(Cia402Homing, EndsWithTheResultOfThisHomingAndGoesBackToItsMode) {
  constexpr std::uint16_t kDone = status::kHomed | status::kReached;
  Homing h;
  EXPECT_EQ(h.mode(Mode::kPosition), Mode::kPosition);
  h.start();
  EXPECT_EQ(h.mode(Mode::kPosition), Mode::kHoming);
  h.advance(Mode::kPosition, status::kFollows, Mode::kPosition, 1e-3);  // bit 12 of the mode before
  EXPECT_EQ(h.control_bits(), 0);
  h.advance(Mode::kHoming, kDone, Mode::kPosition, 1e-3);
  EXPECT_EQ(h.control_bits(), kHomingStart);
  for (int i = 0; i < 50; ++i) h.advance(Mode::kHoming, kDone, Mode::kPosition, 1e-3);
  EXPECT_FALSE(h.is_done()) << "perhaps the homing before";
  h.advance(Mode::kHoming, 0, Mode::kPosition, 1e-3);
  h.advance(Mode::kHoming, status::kHomed, Mode::kPosition, 1e-3);
  EXPECT_FALSE(h.is_done()) << "the axis has not come to rest";
  h.advance(Mode::kHoming, kDone, Mode::kPosition, 1e-3);
  EXPECT_TRUE(h.is_done());
  EXPECT_EQ(h.control_bits(), 0);
  EXPECT_EQ(h.mode(Mode::kPosition), Mode::kPosition);
  EXPECT_TRUE(h.is_active()) << "until the drive shows its mode";
  h.advance(Mode::kPosition, status::kFollows, Mode::kPosition, 1e-3);
  EXPECT_FALSE(h.is_active());
}

TEST(Cia402Homing, FailsWithTheErrorOfTheDriveAndWhenItLeavesTheMode) {
  for (const bool leaves : {false, true}) {
    Homing h;
    h.start();
    h.advance(Mode::kHoming, 0, Mode::kPosition, 1e-3);
    h.advance(Mode::kHoming, 0, Mode::kPosition, 1e-3);
    EXPECT_FALSE(h.has_failed());
    h.advance(leaves ? Mode::kNone : Mode::kHoming, leaves ? 0 : status::kHomingError, Mode::kPosition, 1e-3);
    EXPECT_TRUE(h.has_failed());
    EXPECT_FALSE(h.is_done());
  }
}

}  // namespace
}  // namespace cotwin::cia402::cia402_test
