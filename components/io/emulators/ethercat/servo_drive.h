#pragma once
#include <cstdint>

#include "components/io/emulators/ethercat/slave.h"
#include "components/io/ethercat/cia402.h"

namespace cotwin::ethercat {

inline constexpr std::uint32_t kCotwinVendor = 0x00000c07;  // not assigned by the EtherCAT Technology Group
inline constexpr std::uint32_t kServoDrive = 0x00000402;

/// Its RxPDO 0x1600 has control word, mode, target position, target velocity and target torque; its TxPDO 0x1A00 status word, mode
/// display, position, velocity, torque and error code.
Sii servo_drive_sii();

/// An emulated servo drive with the profile CiA 402 and its axis, in the modes csp, csv, cst and homing. No device of a manufacturer: what the
/// standard leaves open is
///   axis        x'' = a, |a| ≤ kMostAcceleration; without voltage a brake stops it. In cst a = kAcceleration · torque − kFriction x'
///   csp         a = ω² (r − x) + 2 ω (r' − x'), ω = kBandwidth; r goes to a new target within the mean time between outputs
///   csv         a = ω (target − x')
///   homing      methods 33 and 34, the next index pulse in negative and positive direction with 0x6099:2, and 37, where it is; the position there
///               becomes 0. Pulses are at the multiples of kTurn of an encoder that begins at 0 when the drive is switched on
///   quick stop  with 0x6085 (counts/s²; 0: by the brake) to rest, then Switch on disabled (option code 2 of 0x605A)
///   faults      following error beyond 0x6065 (0x8611); set_fault_cause()
///   torque off  set_torque_off(): from every state but a fault to Switch on disabled, and it stays there; status bit 4 is off
///   limits      of 0x607D (no effect while both are 0) and 0x6080 (0: none); status bit 11 while they act
/// Positions are counts, velocities counts/s, torques 1/1000 of the rated torque. All are simulated time.
class ServoDrive final : public Slave {
 public:
  static constexpr double kBandwidth = 314.0;       // rad/s
  static constexpr double kMostAcceleration = 5e8;  // counts/s²
  static constexpr double kAcceleration = 1e4;      // counts/s² per 1/1000 of the rated torque
  static constexpr double kTurn = 10'000;           // counts
  static constexpr double kFriction = 5;            // 1/s
  static constexpr std::uint16_t kFollowingError = 0x8611, kExternalFault = 0x9000;  // codes of 0x603F

  explicit ServoDrive(const SlaveOptions& options);

  /// Where the axis is, at rest, when the drive is switched on, counts: an absolute encoder keeps it afterwards.
  void set_start(double position) { x_ = position; }
  /// An external fault while it is on (0x9000).
  void set_fault_cause(bool on) { cause_ = on; }
  /// Safe torque off, or no mains voltage, while it is on. No fault.
  void set_torque_off(bool on) { torque_off_ = on; }
  double position() const { return x_; }  // counts, of the axis: homing does not change it
  double speed() const { return v_; }     // counts/s
  cia402::State drive_state() const { return drive_; }

 private:
  struct Targets {
    std::uint16_t control = 0;
    cia402::Mode mode = cia402::Mode::kNone;
    double position = 0, velocity = 0, torque = 0;
  };

  void restart() override;
  void update(std::int64_t now) override;
  Targets targets() const;
  void obey(const Targets& t);
  void fail(std::uint16_t code);
  void set_target(const Targets& t, std::int64_t now);
  void measure_period();
  double interpolated(std::int64_t now) const;
  void move(const Targets& t, std::int64_t now, double h);
  double acceleration(const Targets& t, std::int64_t now) const;
  void home(const Targets& t);
  void find_pulse(double before);
  double within_limits(double position) const;
  void write_inputs(const Targets& t);

  double x_ = 0, v_ = 0, a_ = 0;  // counts, s
  bool cause_ = false, torque_off_ = false, limited_ = false;
  cia402::State drive_ = cia402::State::kNotReady;
  cia402::Mode mode_ = cia402::Mode::kNone;
  std::uint16_t control_ = 0, error_ = 0;
  enum class Homing : std::uint8_t { kIdle, kRuns, kDone, kFailed } homing_ = Homing::kIdle;
  double offset_ = 0;  // counts, of its position against x_
  std::int64_t now_ = 0;
  bool moving_ = false;  // `now_` is valid
  // Interpolation of csp.
  double from_ = 0, to_ = 0;               // counts
  std::int64_t began_ = 0, interval_ = 0;  // ns
  std::int64_t written_ = 0, period_ = 0;  // ns: of the last outputs, mean between them
};

}  // namespace cotwin::ethercat
