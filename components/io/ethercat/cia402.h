#pragma once
#include <cstdint>

/// The drive profile CiA 402 (IEC 61800-7-201 and -301): states, control word 0x6040, status word 0x6041 and modes of operation, as pure
/// functions, and the side of a master.
namespace cotwin::cia402 {

/// Objects of an axis.
namespace object {
inline constexpr std::uint16_t kErrorCode = 0x603f, kControlWord = 0x6040, kStatusWord = 0x6041, kQuickStopOption = 0x605a,
                               kMode = 0x6060, kModeDisplay = 0x6061, kPosition = 0x6064, kFollowingWindow = 0x6065,
                               kVelocity = 0x606c, kTargetTorque = 0x6071, kTorque = 0x6077, kTargetPosition = 0x607a,
                               kPositionLimit = 0x607d, kMostSpeed = 0x6080, kQuickStopDeceleration = 0x6085,
                               kHomingMethod = 0x6098, kHomingSpeeds = 0x6099, kTargetVelocity = 0x60ff;
}

/// The states of the power drive system, in the order of the standard.
enum class State : std::uint8_t {
  kNotReady,
  kSwitchOnDisabled,
  kReadyToSwitchOn,
  kSwitchedOn,
  kOperationEnabled,
  kQuickStop,
  kFaultReaction,
  kFault,
};

/// Bits of the status word.
namespace status {
inline constexpr std::uint16_t kFault = 1 << 3, kVoltage = 1 << 4, kWarning = 1 << 7, kRemote = 1 << 9, kLimit = 1 << 11,
                               kFollows = 1 << 12;  // modes csp, csv, cst: the drive follows the target; else it holds
// Mode homing: the target is reached, home was found, homing failed.
inline constexpr std::uint16_t kReached = 1 << 10, kHomed = 1 << 12, kHomingError = 1 << 13;
}  // namespace status
/// The state in a status word. Words that the standard leaves out are kNotReady, in which a drive needs no command.
State state_of(std::uint16_t status_word);
/// The status word of a state, with bits 4 to 6 as most drives have them and no others.
std::uint16_t status_of(State state);

/// The commands of the control word.
enum class Command : std::uint8_t {
  kShutdown,
  kSwitchOn,  // also: disable operation
  kEnableOperation,
  kDisableVoltage,
  kQuickStop,
  kFaultReset,
};
inline constexpr std::uint16_t kHomingStart = 1 << 4, kFaultResetBit = 1 << 7;
std::uint16_t control_of(Command command);
/// The command in a control word that follows `before`: a fault reset is a rising edge of bit 7, which goes before the others.
Command command_of(std::uint16_t control_word, std::uint16_t before);

/// The state that a drive goes to on a command, as the transitions of the standard say: 2 to 11 and 16, 15 if the cause of the fault has
/// gone (`fault`), 12 only for disable voltage. The state itself if the command is not for it. Automatic transitions (0, 1, 12 at the
/// end of a quick stop, 13, 14) are the drive's.
State after(State state, Command command, bool fault);

/// Modes of operation, object 0x6060.
enum class Mode : std::int8_t { kNone = 0, kHoming = 6, kPosition = 8, kVelocity = 9, kTorque = 10 };

/// The commands of a master to a drive.
enum class Wish : std::uint8_t { kOff, kStop, kOn };

/// The side of a master: brings a drive to the wished state, one step of the standard at a time. It never resets a fault by itself.
class Axis {
 public:
  /// Takes the status word that the drive gave last, once in each cycle, before control(). `rests`: its axis stands.
  void see(std::uint16_t status_word, bool rests);
  /// The control word of this cycle.
  ///   kOn    up to Operation enabled. From Quick stop active it goes over Switch on disabled: the drive then begins anew.
  ///   kStop  a quick stop of an enabled drive; voltage off in every other state
  ///   kOff   the drive is shut down, and voltage is off
  /// A quick stop that has begun is never cut short: kOn and kOff take effect when the drive has left it or its axis rests.
  std::uint16_t control(Wish wish);
  /// Resets the fault that the drive has now, with one rising edge: a drive whose cause has not gone stays in its fault, also when the
  /// cause goes later.
  void reset_fault() { reset_ = (last_ & kFaultResetBit) != 0 ? Reset::kRelease : Reset::kHold; }
  /// Nothing is known of the drive: it did not answer, or was switched off.
  void forget();

  State state() const { return state_; }
  /// Whether the drive has just left Operation enabled, although it was wished on: a fault, a limit switch, the
  /// power supply, somebody else's stop.
  bool fell() const { return fell_; }

 private:
  Command command(Wish wish);

  State state_ = State::kNotReady;
  std::uint16_t last_ = 0;                                                           // control word
  enum class Reset : std::uint8_t { kNone, kRelease, kHold } reset_ = Reset::kNone;  // bit 7: 0, 0 for a cycle, 1
  bool was_on_ = false, fell_ = false, rests_ = false;
};

/// The homing of an enabled drive: mode homing, its start, and back to the mode before.
class Homing {
 public:
  void start();
  /// Ends it without a result: the drive stands when its start bit and its mode go.
  void abort() { phase_ = Phase::kIdle; }
  bool is_active() const { return phase_ != Phase::kIdle; }
  /// Whether the drive searches its home, without the change of its mode before and after that.
  bool runs() const { return phase_ == Phase::kRuns; }
  /// One cycle of `h` seconds, with what the drive gave last. `mode`: the one to go back to.
  void advance(Mode shown, std::uint16_t status_word, Mode mode, double h);

  /// What the drive gets: the mode, and bits of the control word beside those of Axis.
  Mode mode(Mode otherwise) const { return phase_ == Phase::kMode || phase_ == Phase::kRuns ? Mode::kHoming : otherwise; }
  std::uint16_t control_bits() const { return phase_ == Phase::kRuns ? kHomingStart : 0; }
  /// Of the last homing.
  bool is_done() const { return done_; }
  bool has_failed() const { return failed_; }

 private:
  /// A result may be that of the homing before until the drive has taken it back, or for so many s.
  static constexpr double kOldResult = 0.1;

  enum class Phase : std::uint8_t { kIdle, kMode, kRuns, kBack } phase_ = Phase::kIdle;
  bool done_ = false, failed_ = false, begun_ = false;
  double since_ = 0;  // s, in kRuns
};

}  // namespace cotwin::cia402
