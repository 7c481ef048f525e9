#pragma once
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat_slaves.h"
#include "components/io/ethercat/cia402.h"
#include "components/io/ethercat/master/master.h"
#include "components/io/link/acknowledgement.h"
#include "components/io/link/belief.h"
#include "components/io/link/link.h"
#include "components/io/links/synchronisation.h"
#include "models/trajectory/axes.h"

namespace cotwin::robot {
struct RobotModel;
}

namespace cotwin::io {

/// The drives with the profile CiA 402 on a bus (ethercat/cia402.h), each of which moves a joint, in the modes csp, csv and cst:
///   position   target = command of the synchronisation: within its limits of speed and acceleration, with its soft start
///   velocity   target = q̇ of that command + K_v (its position − q)
///   torque     target = tau_command, within its limit, with the soft start
/// A rising edge of `home` makes a drive find its zero, as its objects 0x6098 and 0x6099 say, while the others hold.
/// Nothing moves by itself. A drive is enabled with mode other than monitor while the input `enable` is on, where its position moves as its speed says
/// (Agreement, of drives with 0x606C); all drives are enabled before one moves;
/// a target begins where the drive is and stays there until then. Drives that are not enabled in time, a fault, a drive that leaves Operation enabled by
/// itself, a jump of a position, one far from its target, the input quick_stop and a loss of the bus stop all drives (quick stop; drives that the bus
/// does not reach stop by themselves) until `acknowledge` rises, which also resets faults, once. While a single status word says that an enabled drive
/// has left that state, or does not follow, its control word stays and targets come to rest; the third in a row is believed.
class EtherCatDrives {
 public:
  /// `joints`: of the unit. `robot`: for the limits of torques; may be nullptr. `joint_of[i]`: joint of slave i, if it is a drive. Throws Error for
  /// a drive whose process data lack an object, or have one that is not supported.
  EtherCatDrives(const std::vector<SlaveChoice>& slaves, const std::vector<std::size_t>& joint_of,
                 const std::vector<trajectory::Axis>& joints, const robot::RobotModel* robot, const std::string& place);

  bool empty() const { return drives_.empty(); }
  void declare(Variables& v, JointVariables& joints);
  /// The start of a run. Throws Error for parameters that do not fit, and a mode for which an object is missing in the process data.
  void initialise(double cycle, std::span<const double> q_scale, std::span<const double> q_offset,
                  const Acknowledgement& acknowledgement);
  /// Adds what the drives need in addition to the values of the user.
  void add_start_up(std::vector<ethercat::ExpectedSlave>& expected) const;
  Link::Needs needs() const;

  /// Inputs that were not used.
  std::int32_t implausible() const { return belief_.implausible(); }
  /// Whether nothing is known of the drives; whether their last inputs were not used; whether positions and speeds agree.
  bool is_blind() const { return blind_; }
  bool is_held() const { return belief_.is_held(); }
  bool agrees() const { return empty() || speeds_.holds(); }
  /// Whether the drives follow the commands.
  bool drives() const { return mode_ != Mode::kMonitor; }
  /// Writes the outputs of the next cycle, which is sent at `now` (ns, of the wire), and the safe ones: a quick stop. Demands an acknowledgement if a
  /// drive has stopped. `h`: s since the last call; targets move by at most one cycle of the bus, and no further than the time for which the drives
  /// have had the last ones.
  void write(ethercat::Master& master, std::int64_t now, const Command& command, double h, Acknowledgement& acknowledgement);
  /// Time between the frames whose answers have come last, s, before read(): nothing is known of the drives after `patience` without inputs that
  /// are used.
  void wait(double h, double patience);
  /// Takes fresh inputs. Those that no motion explains are held (Belief); returns whether they were used.
  bool read(const ethercat::Master& master);
  void measure(Measured& measured, double dq_cutoff, double patience);
  /// Instead of write(), at the end of a run: a quick stop. Whether a drive may still move.
  bool stop(ethercat::Master& master);
  void append_notes(std::vector<std::string>& sentences) const;

 private:
  enum class Outside : std::uint8_t { kRefuse, kReturn };
  enum class Mode : std::uint8_t { kMonitor, kPosition, kVelocity, kTorque };
  /// Where a value is in the process data of a slave.
  struct Place {
    std::size_t bit = 0, bits = 0;  // bits = 0: nowhere
  };
  /// An output with a constant value.
  struct Constant {
    Place place;
    std::string port, object;
    std::int32_t value = 0;
  };
  static constexpr std::int32_t kNotGiven = std::numeric_limits<std::int32_t>::min();
  static constexpr double kUnlimited = 1e9;              // rad, N.m
  static constexpr double kReset = 0.5;                  // s that a drive has to leave its fault after acknowledge has risen
  static constexpr double kLargestFollowingError = 0.2;  // rad
  struct Drive {
    std::size_t slave = 0, joint = 0;
    std::string name, joint_name;
    bool revolute = true;
    Place control, mode, target_position, target_velocity, target_torque;
    Place status, mode_display, position, velocity, torque, error;
    std::vector<Constant> constants;
    cia402::Axis axis;
    cia402::Homing homing;
    std::uint16_t status_word = 0, control_word = 0;
    std::int32_t error_code = 0, mode_shown = 0;
    bool known = false;       // `counts` is a position of the drive
    std::int64_t counts = 0;  // its position without wrapping
    std::int64_t reference =
        0;  // wraps are counted from here: it moves with the positions that a motion explains, and does not jump
    std::array<std::int64_t, 3>
        last_counts{};             // their median is where a drive is that is switched on: one of them may be damaged
    std::int64_t held = 0;         // target while it does not follow, counts
    double speed = 0;              // rad/s
    int doubts = 0;                // status words in a row that say that it does not move any more, and were not used
    std::int32_t unconfirmed = 0;  // of those that the next one contradicted
    double stood_at = 0;           // rad
    double stood = 0;              // s for which it has been near `stood_at`
  };

  static Place find(const std::vector<ethercat::Channel>& channels, std::uint16_t object);
  void add_constants(const SlaveChoice& s, Drive& d) const;
  void check_constants(const Drive& d) const;
  const char* missing(const Drive& d) const;
  cia402::Mode profile_mode() const;
  cia402::Wish wish(bool awaits) const;
  bool has_stopped(bool operational);
  bool is_confirmed(Drive& d, std::uint16_t status_word, std::int32_t mode) const;
  void advance_homing(bool may_home, double h);
  bool homes() const;
  bool takes_targets(const Drive& d) const;
  bool all_enabled() const;
  void choose_targets(const Command& command, double h, double interval, bool follows);
  void advance_enabling(bool on, double h);
  bool is_behind(std::size_t k) const;
  bool leaves_range(std::size_t k) const;
  void describe_place(std::size_t k);
  std::int64_t place_of(const Drive& d) const;
  const Drive& doubted_drive() const;
  double outside(std::size_t k) const;
  void write_image(std::span<std::uint8_t> out, const Drive& d, std::uint16_t control, std::int64_t position, double speed,
                   double torque) const;
  void write_targets(ethercat::Master& master, std::size_t k);
  double dq_scale_of(std::size_t k) const;
  void write_outputs();

  std::string place_;
  std::vector<Drive> drives_;
  Synchronisation synchronisation_;
  Belief belief_;
  Agreement speeds_;
  BelievedTorques tau_;
  BelievedNumbers errors_;
  Mode mode_ = Mode::kMonitor;
  Outside when_outside_ = Outside::kRefuse;
  std::span<const double> q_scale_, q_offset_;  // per joint of the unit
  bool awaited_ = false, follows_ = false, fresh_ = false;
  bool blind_ = false;                          // nothing is known of the drives
  bool pauses_ = false;                         // a drive may not move any more, which is not confirmed
  bool were_asked_ = false;                     // one, to enable operation, since they were wished on
  bool differed_ = false;                       // a position from its speed, before they were enabled
  const Drive* jumped_ = nullptr;               // since the last write()
  bool were_enabled_ = false;                   // all, since they were wished on
  double enabling_ = 0;                         // s for which they were wished on before that
  double cycle_ = 1e-3;                         // s
  double since_acknowledged_ = 0, silent_ = 0;  // s, since inputs that were used
  double elapsed_ = 0, last_elapsed_ = 0;       // s since the last inputs, and between the last two that were used
  int missing_ = 0;                             // frames since inputs that were used
  std::int32_t stops_ = 0;
  int stopped_missing_ = 0;  // of the last stop: missing_, silent_
  double stopped_silent_ = 0;
  const char* stopped_by_ = "";
  const Drive* stopped_drive_ = nullptr;
  std::string place_outside_;  // of the drive that stands outside, a sentence; its memory is reserved
  bool told_outside_ = false;
  // Per drive.
  std::vector<double> q_, q_wanted_, q_target_, tau_target_, no_gain_;
  std::vector<double> q_read_, dq_read_, dq_given_,
      tau_read_;                 // of the last inputs, used or not; dq_given_: NaN without 0x606C
  std::vector<double> outside_;  // rad out of the range, the least since the drives follow
  // Inputs and parameters.
  std::string mode_text_ = "monitor", outside_text_ = "refuse";
  bool enable_ = true, quick_stop_ = false;
  std::unique_ptr<bool[]> home_, homed_;  // input and output
  std::vector<bool> home_before_;
  std::vector<double> dq_command_max_, q_command_min_, q_command_max_, tau_command_max_, dq_scale_, tau_scale_,
      following_error_max_;
  double ddq_command_max_ = kSafeAcceleration, K_v_ = 10, enable_timeout_ = 2;
  // Outputs.
  std::vector<std::int32_t> state_, error_, warning_;
  bool enabled_ = false;
};

}  // namespace cotwin::io
