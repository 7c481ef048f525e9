#include "components/io/ethercat/cia402.h"

#include <utility>

namespace cotwin::cia402 {

State state_of(std::uint16_t status_word) {
  switch (status_word & 0x6f) {  // bits 0 to 3, 5 and 6
    case 0x21:
      return State::kReadyToSwitchOn;
    case 0x23:
      return State::kSwitchedOn;
    case 0x27:
      return State::kOperationEnabled;
    case 0x07:
      return State::kQuickStop;
    default:
      break;
  }
  switch (status_word & 0x4f) {  // bit 5 does not count
    case 0x40:
      return State::kSwitchOnDisabled;
    case 0x0f:
      return State::kFaultReaction;
    case 0x08:
      return State::kFault;
    default:
      return State::kNotReady;
  }
}

std::uint16_t status_of(State state) {
  switch (state) {
    case State::kNotReady:
      return 0x00;
    case State::kSwitchOnDisabled:
      return 0x50;
    case State::kReadyToSwitchOn:
      return 0x31;
    case State::kSwitchedOn:
      return 0x33;
    case State::kOperationEnabled:
      return 0x37;
    case State::kQuickStop:
      return 0x17;
    case State::kFaultReaction:
      return 0x1f;
    case State::kFault:
      return 0x18;
  }
  return 0;
}

std::uint16_t control_of(Command command) {
  switch (command) {
    case Command::kShutdown:
      return 0x06;
    case Command::kSwitchOn:
      return 0x07;
    case Command::kEnableOperation:
      return 0x0f;
    case Command::kDisableVoltage:
      return 0x00;
    case Command::kQuickStop:
      return 0x02;
    case Command::kFaultReset:
      return kFaultResetBit;
  }
  return 0;
}

Command command_of(std::uint16_t control_word, std::uint16_t before) {
  if ((control_word & kFaultResetBit) != 0 && (before & kFaultResetBit) == 0) return Command::kFaultReset;
  if ((control_word & 0x02) == 0) return Command::kDisableVoltage;
  if ((control_word & 0x04) == 0) return Command::kQuickStop;
  if ((control_word & 0x01) == 0) return Command::kShutdown;
  return (control_word & 0x08) == 0 ? Command::kSwitchOn : Command::kEnableOperation;
}

State after(State state, Command command, bool fault) {
  using C = Command;
  const bool off = command == C::kDisableVoltage;
  switch (state) {
    case State::kNotReady:
    case State::kFaultReaction:
      return state;
    case State::kSwitchOnDisabled:
      return command == C::kShutdown ? State::kReadyToSwitchOn : state;  // 2
    case State::kReadyToSwitchOn:
      if (off || command == C::kQuickStop) return State::kSwitchOnDisabled;  // 7
      // Enable operation contains switch on: 3, and 4 with the next control word.
      return command == C::kSwitchOn || command == C::kEnableOperation ? State::kSwitchedOn : state;
    case State::kSwitchedOn:
      if (off || command == C::kQuickStop) return State::kSwitchOnDisabled;      // 10
      if (command == C::kShutdown) return State::kReadyToSwitchOn;               // 6
      return command == C::kEnableOperation ? State::kOperationEnabled : state;  // 4
    case State::kOperationEnabled:
      if (off) return State::kSwitchOnDisabled;                     // 9
      if (command == C::kQuickStop) return State::kQuickStop;       // 11
      if (command == C::kShutdown) return State::kReadyToSwitchOn;  // 8
      return command == C::kSwitchOn ? State::kSwitchedOn : state;  // 5
    case State::kQuickStop:
      if (off) return State::kSwitchOnDisabled;                                  // 12
      return command == C::kEnableOperation ? State::kOperationEnabled : state;  // 16
    case State::kFault:
      return command == C::kFaultReset && !fault ? State::kSwitchOnDisabled : state;  // 15
  }
  return state;
}

void Axis::forget() {
  state_ = State::kNotReady;
  last_ = 0;
  reset_ = Reset::kNone;
  was_on_ = fell_ = rests_ = false;
}

Command Axis::command(Wish wish) {
  if (state_ == State::kFault) {
    if (reset_ == Reset::kRelease) {
      reset_ = Reset::kHold;
      return Command::kDisableVoltage;
    }
    return reset_ == Reset::kHold ? Command::kFaultReset : Command::kDisableVoltage;
  }
  const bool enabled = state_ == State::kOperationEnabled;
  // The status may be older than a quick stop that was sent.
  if (enabled && last_ == control_of(Command::kQuickStop) && !rests_) return Command::kQuickStop;
  if (state_ == State::kQuickStop && (wish == Wish::kStop || !rests_)) return Command::kQuickStop;
  if (wish == Wish::kStop) return enabled ? Command::kQuickStop : Command::kDisableVoltage;
  if (wish == Wish::kOff) return enabled || state_ == State::kSwitchedOn ? Command::kShutdown : Command::kDisableVoltage;
  switch (state_) {
    case State::kSwitchOnDisabled:
      return Command::kShutdown;
    case State::kReadyToSwitchOn:
      return Command::kSwitchOn;
    case State::kSwitchedOn:
    case State::kOperationEnabled:
      return Command::kEnableOperation;
    default:
      return Command::kDisableVoltage;
  }
}

void Axis::see(std::uint16_t status_word, bool rests) {
  rests_ = rests;
  const State before = std::exchange(state_, state_of(status_word));
  fell_ = was_on_ && before == State::kOperationEnabled && state_ != State::kOperationEnabled;
  if (state_ != State::kFault) reset_ = Reset::kNone;  // a later fault is another one
}

std::uint16_t Axis::control(Wish wish) {
  was_on_ = wish == Wish::kOn;
  return last_ = control_of(command(wish));
}

void Homing::start() {
  phase_ = Phase::kMode;
  done_ = failed_ = begun_ = false;
  since_ = 0;
}

void Homing::advance(Mode shown, std::uint16_t status_word, Mode mode, double h) {
  if (phase_ == Phase::kMode && shown == Mode::kHoming) {
    phase_ = Phase::kRuns;
  } else if (phase_ == Phase::kRuns) {
    since_ += h;
    const bool error = (status_word & status::kHomingError) != 0;
    const bool homed = (status_word & status::kHomed) != 0;
    begun_ = begun_ || (!homed && !error) || since_ >= kOldResult;
    failed_ = begun_ && (error || shown != Mode::kHoming);
    done_ = begun_ && !failed_ && homed && (status_word & status::kReached) != 0;
    if (failed_ || done_) phase_ = Phase::kBack;
  } else if (phase_ == Phase::kBack && shown == mode) {
    phase_ = Phase::kIdle;
  }
}

}  // namespace cotwin::cia402
