#include "components/io/emulators/ethercat/servo_drive.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "components/io/ethercat/little_endian.h"

namespace cotwin::ethercat {

namespace {

namespace object = cia402::object;
using cia402::Mode;
using DriveState = cia402::State;

constexpr std::int64_t kStep = 125'000;                 // ns, of the integration
constexpr std::int64_t kLongestInterval = 100'000'000;  // ns between outputs; longer ones are a break
constexpr std::int64_t kAveraged = 16;                  // intervals
constexpr std::int64_t kLongestGap = 1'000'000'000;     // ns without a frame or a tick that are integrated
constexpr double kStands = 10;                          // counts/s
constexpr double kBrake = 50;                           // 1/s
constexpr std::size_t kTable = 256;                     // bytes of 0x2001

// Offsets in the process data, bytes.
constexpr std::size_t kControlAt = 0, kModeAt = 2, kPositionAt = 4, kVelocityAt = 8, kTorqueAt = 12;
constexpr std::size_t kErrorAt = 14;

}  // namespace

Sii servo_drive_sii() {
  using namespace object_type;
  Sii s;
  s.vendor = kCotwinVendor;
  s.product = kServoDrive;
  s.revision = 1;
  s.size_kibit = 16;
  s.pdi_control = 0x0005;
  s.general.order = "DRIVE402";
  s.general.name = "emulated drive, CiA 402";
  s.general.physical_ports = 0x0011;
  s.general.coe = 0x03;  // SDO, SDO information
  s.mailbox = {0x1000, 128, 0x1080, 128};
  s.bootstrap = s.mailbox;
  s.protocols = mailbox_protocol::kCoE;
  s.fmmus = {1, 2};
  s.sync_managers = {{0x1000, 128, 0x26, 0, 1, SyncManagerType::kMailboxOut},
                     {0x1080, 128, 0x22, 0, 1, SyncManagerType::kMailboxIn},
                     {0x1100, 14, 0x64, 0, 1, SyncManagerType::kOutputs},
                     {0x1200, 16, 0x20, 0, 1, SyncManagerType::kInputs}};
  s.rx_pdos = {{0x1600,
                2,
                0,
                "Targets",
                0,
                {{object::kControlWord, 0, "Controlword", kU16, 16, 0},
                 {object::kMode, 0, "Modes of operation", kI8, 8, 0},
                 {0, 0, "", 0, 8, 0},
                 {object::kTargetPosition, 0, "Target position", kI32, 32, 0},
                 {object::kTargetVelocity, 0, "Target velocity", kI32, 32, 0},
                 {object::kTargetTorque, 0, "Target torque", kI16, 16, 0}}}};
  s.tx_pdos = {{0x1a00,
                3,
                0,
                "Actual values",
                0,
                {{object::kStatusWord, 0, "Statusword", kU16, 16, 0},
                 {object::kModeDisplay, 0, "Modes of operation display", kI8, 8, 0},
                 {0, 0, "", 0, 8, 0},
                 {object::kPosition, 0, "Position actual value", kI32, 32, 0},
                 {object::kVelocity, 0, "Velocity actual value", kI32, 32, 0},
                 {object::kTorque, 0, "Torque actual value", kI16, 16, 0},
                 {object::kErrorCode, 0, "Error code", kU16, 16, 0}}}};
  s.clock_modes = {{0, 0, 0, 0, 0x0000, 0, "Free run", "no synchronisation"}, {0, 0, 0, 0, 0x0300, 1, "DC", "SYNC0"}};
  return s;
}

ServoDrive::ServoDrive(const SlaveOptions& options) : Slave(write_sii(servo_drive_sii()), options) {
  using namespace object_type;
  ObjectDictionary& o = objects();
  o.add(object::kQuickStopOption, 0, "Quick stop option code", kI16, 16, 2);
  o.add(object::kFollowingWindow, 0, "Following error window", kU32, 32, 100'000, true);
  o.add(object::kPositionLimit, 0, "Software position limit", kU8, 8, 2);
  o.add(object::kPositionLimit, 1, "Min position limit", kI32, 32, 0, true);
  o.add(object::kPositionLimit, 2, "Max position limit", kI32, 32, 0, true);
  o.add(object::kMostSpeed, 0, "Max motor speed", kU32, 32, 0, true);
  o.add(object::kQuickStopDeceleration, 0, "Quick stop deceleration", kU32, 32, 10'000'000, true);
  o.add(object::kHomingMethod, 0, "Homing method", kI8, 8, 37, true);
  o.add(object::kHomingSpeeds, 0, "Homing speeds", kU8, 8, 2);
  o.add(object::kHomingSpeeds, 1, "Speed during search for switch", kU32, 32, 10'000, true);
  o.add(object::kHomingSpeeds, 2, "Speed during search for zero", kU32, 32, 10'000, true);
  o.add_text(0x2001, 0, "Cogging compensation table", std::string(kTable, '\0'), true);
}

void ServoDrive::restart() {
  drive_ = DriveState::kNotReady;
  mode_ = Mode::kNone;
  control_ = error_ = 0;
  v_ = a_ = 0;
  moving_ = limited_ = false;
  interval_ = period_ = written_ = 0;
  homing_ = Homing::kIdle;
  offset_ = 0;
}

ServoDrive::Targets ServoDrive::targets() const {
  const std::uint8_t* const from = outputs().data();
  Targets t;
  t.control = load<std::uint16_t>(from + kControlAt);
  t.mode = static_cast<Mode>(load<std::int8_t>(from + kModeAt));
  t.position = load<std::int32_t>(from + kPositionAt);
  t.velocity = load<std::int32_t>(from + kVelocityAt);
  t.torque = load<std::int16_t>(from + kTorqueAt);
  return t;
}

void ServoDrive::fail(std::uint16_t code) {
  error_ = code;
  drive_ = DriveState::kFaultReaction;
}

/// The automatic transitions, and those of the control word.
void ServoDrive::obey(const Targets& t) {
  if (drive_ == DriveState::kNotReady) drive_ = DriveState::kSwitchOnDisabled;                               // 1
  if (cause_ && drive_ != DriveState::kFault && drive_ != DriveState::kFaultReaction) fail(kExternalFault);  // 13
  const bool rests = v_ == 0;
  if (drive_ == DriveState::kFaultReaction && rests) drive_ = DriveState::kFault;         // 14
  if (drive_ == DriveState::kQuickStop && rests) drive_ = DriveState::kSwitchOnDisabled;  // 12
  const DriveState before = drive_;
  // Option code 2: an axis that stops cannot be enabled again before it rests.
  const cia402::Command command = cia402::command_of(t.control, control_);
  if (drive_ != DriveState::kQuickStop || command != cia402::Command::kEnableOperation)
    drive_ = cia402::after(drive_, command, cause_);
  if (torque_off_ && drive_ != DriveState::kFault && drive_ != DriveState::kFaultReaction)
    drive_ = DriveState::kSwitchOnDisabled;
  home(t);
  control_ = t.control;
  if (before == DriveState::kFault && drive_ != before) error_ = 0;
  if (before != DriveState::kOperationEnabled && drive_ == DriveState::kOperationEnabled) interval_ = 0;
  const bool known =
      t.mode == Mode::kPosition || t.mode == Mode::kVelocity || t.mode == Mode::kTorque || t.mode == Mode::kHoming;
  if (known && t.mode != mode_) {
    mode_ = t.mode;
    interval_ = 0;
  }
}

/// The start bit begins a homing with its rising edge and ends it when it falls.
void ServoDrive::home(const Targets& t) {
  const bool start = (t.control & cia402::kHomingStart) != 0;
  if (mode_ != Mode::kHoming || t.mode != Mode::kHoming || drive_ != DriveState::kOperationEnabled || !start) {
    homing_ = Homing::kIdle;
    return;
  }
  if ((control_ & cia402::kHomingStart) != 0) return;
  const auto method = static_cast<std::int8_t>(objects().number(object::kHomingMethod, 0));
  homing_ = method == 33 || method == 34 || method == 37 ? Homing::kRuns : Homing::kFailed;
  if (method != 37) return;
  offset_ = -x_;
  homing_ = Homing::kDone;
}

/// A pulse between `before` and x_ in the direction of the homing is where the position is 0.
void ServoDrive::find_pulse(double before) {
  const bool positive = objects().number(object::kHomingMethod, 0) == 34;
  const double pulse = kTurn * (positive ? std::floor(x_ / kTurn) : std::ceil(x_ / kTurn));
  if (positive ? pulse <= before : pulse >= before) return;
  offset_ = -pulse;
  homing_ = Homing::kDone;
}

double ServoDrive::within_limits(double position) const {
  const auto limit = [&](std::uint8_t sub) {
    return static_cast<double>(static_cast<std::int32_t>(objects().number(object::kPositionLimit, sub)));
  };
  const double least = limit(1), most = limit(2);
  return least < most ? std::clamp(position, least, most) : position;
}

void ServoDrive::measure_period() {
  const std::int64_t before = std::exchange(written_, esc().outputs_at()), last = written_ - before;
  if (before == 0 || last <= 0 || last > kLongestInterval) return;
  period_ = period_ == 0 ? last : period_ + (last - period_) / kAveraged;
}

double ServoDrive::interpolated(std::int64_t now) const {
  return from_ + std::clamp(static_cast<double>(now - began_) / static_cast<double>(interval_), 0.0, 1.0) * (to_ - from_);
}

/// From where it is, in the time between two targets: a late one that is followed by one in time is no jump.
void ServoDrive::set_target(const Targets& t, std::int64_t now) {
  const double target = within_limits(t.position) - offset_;
  limited_ = within_limits(t.position) != t.position;
  if (interval_ == 0) {
    from_ = to_ = target;
    began_ = now;
    interval_ = kLongestInterval;
  } else if (target != to_) {
    from_ = interpolated(now);
    interval_ = std::max<std::int64_t>(period_, 1);
    to_ = target;
    began_ = now;
  }
}

double ServoDrive::acceleration(const Targets& t, std::int64_t now) const {
  constexpr double w = kBandwidth;
  if (drive_ == DriveState::kQuickStop || drive_ == DriveState::kFaultReaction) {
    const double deceleration = static_cast<double>(objects().number(object::kQuickStopDeceleration, 0));
    return deceleration > 0 ? -std::copysign(deceleration, v_) : -kBrake * v_;
  }
  if (drive_ != DriveState::kOperationEnabled) return -kBrake * v_;
  const double most = static_cast<double>(objects().number(object::kMostSpeed, 0));
  const auto bounded = [&](double speed) { return most > 0 ? std::clamp(speed, -most, most) : speed; };
  if (mode_ == Mode::kPosition) {
    const double r = interpolated(now);
    const double dr = now - began_ < interval_ ? (to_ - from_) / (1e-9 * static_cast<double>(interval_)) : 0;
    return 2 * w * (bounded(dr + w / 2 * (r - x_)) - v_);
  }
  if (mode_ == Mode::kVelocity) return w * (bounded(t.velocity) - v_);
  if (mode_ == Mode::kTorque) return kAcceleration * t.torque - kFriction * v_;
  if (mode_ == Mode::kHoming && homing_ == Homing::kRuns) {
    const auto speed = static_cast<double>(objects().number(object::kHomingSpeeds, 2));
    return w * (bounded(objects().number(object::kHomingMethod, 0) == 34 ? speed : -speed) - v_);
  }
  return w * -v_;
}

void ServoDrive::move(const Targets& t, std::int64_t now, double h) {
  a_ = std::clamp(acceleration(t, now), -kMostAcceleration, kMostAcceleration);
  const double v = v_ + h * a_;
  const bool stopping = drive_ != DriveState::kOperationEnabled;
  constexpr double kRest = 1;  // counts/s
  const bool rests = stopping && (v * v_ <= 0 || std::abs(v) < kRest);
  const double before = x_;
  x_ += h * (rests ? v_ / 2 : (v + v_) / 2);
  v_ = rests ? 0 : v;
  if (homing_ == Homing::kRuns) find_pulse(before);
}

void ServoDrive::update(std::int64_t now) {
  if (!moving_) {
    moving_ = true;
    now_ = now;
  }
  const Targets t = targets();
  measure_period();
  obey(t);
  if (drive_ == DriveState::kOperationEnabled && mode_ == Mode::kPosition) set_target(t, now);
  now_ = std::max(now_, now - kLongestGap);
  while (now_ < now) {
    const std::int64_t step = std::min(kStep, now - now_);
    now_ += step;
    move(t, now_, 1e-9 * static_cast<double>(step));
  }
  const double window = static_cast<double>(objects().number(object::kFollowingWindow, 0));
  const bool follows = drive_ == DriveState::kOperationEnabled && mode_ == Mode::kPosition;
  if (follows && std::abs(to_ - x_) > window) fail(kFollowingError);
  write_inputs(t);
}

void ServoDrive::write_inputs(const Targets& t) {
  std::uint16_t status = cia402::status_of(drive_) | cia402::status::kRemote;
  if (torque_off_) status &= static_cast<std::uint16_t>(~cia402::status::kVoltage);
  const bool enabled = drive_ == DriveState::kOperationEnabled;
  if (enabled && mode_ == Mode::kHoming) {
    if (homing_ == Homing::kDone) status |= cia402::status::kHomed;
    if (homing_ == Homing::kFailed) status |= cia402::status::kHomingError;
    if (homing_ != Homing::kRuns && std::abs(v_) < kStands) status |= cia402::status::kReached;
  } else if (enabled && mode_ == t.mode) {
    status |= cia402::status::kFollows;
  }
  if (enabled && mode_ == Mode::kPosition && limited_) status |= cia402::status::kLimit;
  std::uint8_t* const to = inputs().data();
  const auto rounded = [](double value, double most) { return std::llround(std::clamp(value, -most, most)); };
  store(to + kControlAt, status);
  store(to + kModeAt, static_cast<std::int8_t>(mode_));
  to[kModeAt + 1] = 0;
  store(to + kPositionAt, static_cast<std::int32_t>(rounded(x_ + offset_, 2147483647.0)));
  store(to + kVelocityAt, static_cast<std::int32_t>(rounded(v_, 2147483647.0)));
  store(to + kTorqueAt, static_cast<std::int16_t>(rounded((a_ + kFriction * v_) / kAcceleration, 32767.0)));
  store(to + kErrorAt, error_);
}

}  // namespace cotwin::ethercat
