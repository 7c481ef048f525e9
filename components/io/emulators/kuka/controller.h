#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "components/io/emulators/kuka/interpolator.h"
#include "components/io/emulators/kuka/pose_interpolator.h"
#include "components/io/emulators/kuka/rating.h"
#include "components/io/fri/fri.h"
#include "components/io/fri/statistics.h"
#include "models/foundation/net/endpoint.h"

namespace cotwin::fri {

struct ControllerSettings {
  Protocol protocol = Protocol::kLwr;
  std::size_t joints = 7;
  net::Endpoint client;                  // whose commands are accepted. Default: the first sender after open()
  std::int64_t send_period = 5'000'000;  // ns, 1 to 100 ms; Sunrise: whole milliseconds
  std::uint32_t receive_multiplier = 1;  // Sunrise: messages per command, 1 to 100
  std::vector<double> speed_limit;       // rad/s, one per joint; required
  double acceleration_limit = std::numeric_limits<double>::infinity();  // rad/s², of commanded joint positions
  std::vector<double> lower, upper;                                     // rad, of commanded positions; empty: no limits
  std::vector<double> torque_limit;                                     // N.m, of overlaid torques; empty: no limits
  double force_limit = std::numeric_limits<double>::infinity();         // N, of an overlaid force
  double moment_limit = std::numeric_limits<double>::infinity();        // N.m, of an overlaid moment
  double joint_stiffness_limit = 5000;                                  // N.m/rad, of a client of LWR
  double linear_stiffness_limit = 5000;                                 // N/m, likewise
  double angular_stiffness_limit = 300;                                 // N.m/rad, likewise
  double linear_speed_limit = 2;                                        // m/s, of commanded poses
  double angular_speed_limit = 4;                                       // rad/s, of commanded poses
  double safety_factor = 1;  // 0 to 1, of friStart: scales all limits of speed, force and torque
  RatingSettings rating;
  Quality enter = Quality::kGood;        // commanding begins at this quality or above
  Quality hold = Quality::kFair;         // and ends below this one
  std::uint32_t max_lost = 10;           // command periods without a command that are bridged; one more stops the robot
  std::int64_t stop_time = 200'000'000;  // ns, from the full speed to rest
  std::int64_t slack = 0;                // ns by which the times of a client's commands may differ from those of their messages
  double synchronised = 1e-3;            // rad, m: difference from the interpolator at which COMMANDING_WAIT ends
  ControlMode control = ControlMode::kPosition;
  /// LWR: the control is the one that the client's quantities need. Otherwise quantities of another impedance end commanding.
  bool control_follows = false;
  ClientCommandMode command_mode = ClientCommandMode::kPosition;  // Sunrise
  OverlayType overlay = OverlayType::kJoint;                      // Sunrise
  /// The posture near `q` (rad) in which the robot's frame has the pose X, and the redundancy if there is one; false if there is
  /// none. Without this function poses are passed on in Setpoint::X, and the joints rest. Must not allocate or throw.
  std::function<bool(const Pose& X, const Redundancy* redundancy, Joints& q)> posture;
  /// Joint torques of a wrench at the tool, N.m; with it torque_limit limits wrenches, too. Must not allocate or throw.
  std::function<void(const Wrench& F, Joints& tau)> torque_of_wrench;
};

/// Why a commanding state ended.
enum class Drop : std::uint8_t {
  kNone,
  kRequest,      // by the robot's program: friStop, end of the motion
  kQuality,      // below `hold`
  kLost,         // more commands missing than are bridged
  kSpeed,        // a step beyond a speed limit
  kPosition,     // beyond a position limit
  kTorque,       // beyond a limit of torque, force or moment
  kRobot,        // a drive is off, or a safety stop
  kFields,       // LWR: another set of commanded quantities
  kClosed,       // friClose
  kStiffness,    // LWR: stiffness or damping out of range
  kPosture,      // no posture for a commanded pose
  kAcceleration  // a change of speed beyond the acceleration limit
};
inline constexpr std::size_t kDrops = static_cast<std::size_t>(Drop::kAcceleration) + 1;
const char* to_text(Drop drop);

/// What the controller asks from the drives.
struct Setpoint {
  bool active = false;       // commands of the client are applied
  Joints q{};                // rad
  Joints dq{};               // rad/s; 0 while the robot follows its own motion
  std::uint32_t fields = 0;  // Command::Field: which of the following the client has given
  Joints tau{};              // N.m; falls to 0 while the robot stops
  Wrench F = Wrench::Zero();
  Pose X;  // interpolated as q
  Redundancy redundancy;
  Joints joint_stiffness{}, joint_damping{};
  Wrench cartesian_stiffness = Wrench::Zero(), cartesian_damping = Wrench::Zero();
};

/// What the controller finds out about both directions.
struct ControllerStatistics {
  explicit ControllerStatistics(unsigned bits) : commands(bits) {}

  SequenceTracker commands;  // of the client's commands
  FaultCounts faults;
  std::uint64_t sent = 0;                            // messages
  std::uint64_t in_time = 0, late = 0, missing = 0;  // answers, by command period
  std::uint64_t unmatched = 0;                       // commands that answer no message of the session's last 256
  std::uint64_t bridged = 0;                         // command periods without a command in a commanding state
  std::uint64_t skipped = 0;                         // messages not sent because cycle() came too late
  std::array<std::uint64_t, kDrops> drops{};         // by reason
  Moments latency;                                   // s, from a message to its answer
  TimeHistogram answer_time;
};

/// The robot's side of a session: an emulated controller. States:
///   IDLE ─open()─→ MONITORING_WAIT ⇄ MONITORING_READY (quality ≥ GOOD) ─request(true)─→ COMMANDING_WAIT (the client must answer
///   with the interpolator's position) → COMMANDING_ACTIVE ─request(false) or a Drop─→ MONITORING
/// LWR has MON for the first two and CMD for the last, which it enters when the mirrored position agrees with the commanded one.
/// After a Drop the robot stops within `stop_time`, and stays until request(false) was called. From the last command to rest it
/// takes at most (max_lost + 1) command periods and the stop time.
/// The interpolator's position is the robot's own motion, never the client's: a client that adds to it would run away.
class Controller {
 public:
  /// Throws Error at `place`.
  Controller(const ControllerSettings& settings, const std::string& place);

  /// Opens the session; the first message is due at `now` (ns).
  void open(std::int64_t now);
  /// Sunrise: one more message, with the state IDLE, is due then.
  void close(std::int64_t now);
  /// The robot's program asks for commands of the client (friStart; a motion with overlay), or ends them.
  void request(bool commanding) {
    requested_ = commanding;
    acknowledged_ = acknowledged_ || !commanding;
  }

  /// A datagram that arrived at `arrival` (ns). kNone: it is a command, in time or not.
  Fault receive(std::span<const std::uint8_t> bytes, const net::Endpoint& from, std::int64_t arrival);

  /// What the robot measures, to be written before cycle(): measured quantities, status, time, poses, I/O values, KRL variables,
  /// and q_interpolator: the position of the robot's own motion. `fields` says which of them there are. Counters, state, rating,
  /// q_commanded and the modes are the controller's.
  Monitoring& robot() { return robot_; }
  /// ns, when the next message is due; the largest number when closed.
  std::int64_t next() const { return next_; }
  /// Rates the answers, changes the state, and makes the message that is due. Call it at next() or as soon as possible after it.
  /// Empty when closed.
  std::span<const std::uint8_t> cycle(std::int64_t now);
  /// The message of the last cycle().
  std::span<const std::uint8_t> message() const { return std::span(datagram_).first(size_); }
  /// rad: of the robot from its own motion, where the last stop has left it.
  const Joints& offset() const { return offset_; }
  /// The set point at `now`, for a robot whose own motion is at q_interpolator of robot().
  const Setpoint& setpoint(std::int64_t now);

  SessionState state() const { return state_; }
  Quality quality() const { return rating_.quality(); }
  /// Why the last commanding state ended.
  Drop drop() const { return drop_; }
  /// The newest command: KRL variables, I/O values, transformations. Its other quantities are checked only in setpoint().
  const Command& command() const { return command_; }
  /// Where messages go: the client's endpoint of the settings or, if that has no port or address, that of the newest command.
  net::Endpoint client() const { return client_; }
  const ControllerSettings& settings() const { return settings_; }
  const ControllerStatistics& statistics() const { return statistics_; }

 private:
  enum class Motion : std::uint8_t { kOwn, kClient, kStopping };
  enum class Answer : std::uint8_t { kNone, kInTime, kLate };

  bool lwr() const { return settings_.protocol == Protocol::kLwr; }
  bool is_stranger(const net::Endpoint& from, std::int64_t arrival) const;
  /// The message that `reflected` means; 0: none of the last 256.
  std::int64_t index_of(std::uint32_t reflected) const;
  std::int64_t group_of(std::int64_t index) const { return (index - first_) / settings_.receive_multiplier; }
  void rate(std::int64_t index, std::int64_t arrival);
  Fault use(std::int64_t index, std::int64_t arrival);
  bool has_needed_fields() const;
  bool is_finite() const;
  /// Whether the newest command moves the joints by its pose.
  bool commands_pose() const;
  Drop limit_exceeded(std::int64_t index);
  Drop joints_exceeded(std::int64_t index, bool by_pose) const;
  Drop stiffness_exceeded() const;
  Drop overlay_exceeded() const;
  bool is_near(const Command& command, std::int64_t index) const;
  bool robot_is_ready() const;
  void advance_state(std::int64_t now);
  void start_commanding(std::int64_t now);
  void leave(Drop why, std::int64_t now);
  void begin_command_period(std::int64_t now);
  void finish_stop(std::int64_t now);
  std::span<const std::uint8_t> write_message(std::int64_t now);
  void total_position(std::int64_t now, Joints& q, Joints& dq) const;

  ControllerSettings settings_;
  ControllerStatistics statistics_;
  Rating rating_;
  Interpolator interpolator_;
  PoseInterpolator frame_;
  Monitoring robot_;
  Command command_, received_;
  Setpoint setpoint_;
  std::array<std::uint8_t, kMaxDatagram> datagram_{};
  std::size_t size_ = 0;
  net::Endpoint client_;
  std::int64_t client_time_ = 0;  // ns, of the newest command
  bool has_client_ = false;
  SessionState state_ = SessionState::kIdle;
  Drop drop_ = Drop::kNone;
  Motion motion_ = Motion::kOwn;
  bool requested_ = false, acknowledged_ = true;
  Joints offset_{};  // rad, of the robot from its own motion
  std::int64_t next_ = std::numeric_limits<std::int64_t>::max();
  std::int64_t index_ = 0;                      // of the newest message, without wrap; the first is 1
  std::int64_t first_ = 1;                      // of the session
  std::int64_t newest_ = 0;                     // message that the newest command answers
  std::array<std::int64_t, 256> sent_times_{};  // ns, by message
  std::array<Answer, 256> answers_{};           // by command period
  std::uint32_t reflected_ = 0;                 // counter of the newest command
  std::uint32_t in_step_ = 0;                   // answers in a row that agree with the interpolator
  std::uint32_t fields_ = 0;                    // LWR: commanded quantities when CMD began
  std::int64_t began_ = 0;                      // first message of this commanding state
  bool has_pose_ = false;                       // in this commanding state
  Joints tau_{};                                // N.m, overlay of the newest command that was applied
  Wrench F_ = Wrench::Zero();
  std::int64_t clock_ = std::numeric_limits<std::int64_t>::min();  // ns, latest time of a cycle or set point
};

}  // namespace cotwin::fri
