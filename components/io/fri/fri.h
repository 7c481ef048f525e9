#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "models/mechanics/pose.h"

/// KUKA's Fast Robot Interface: the messages of both generations as one set of plain structs, and their codecs. Everything here
/// is a function of bytes and times; sockets and clocks are elsewhere. Quantities are in SI, wrenches and Jacobians in the order
/// x, y, z; KUKA's order of rotations (A, B, C: about z, y, x) and its millimetres exist only in the codecs.
/// Direction: the robot's controller sends monitoring messages cyclically, the client (the PC) answers each with a command.
namespace cotwin::fri {

/// Joints that fit a Sunrise message of at most 1500 bytes: six vectors of 9 bytes per joint and the status of each drive.
inline constexpr std::size_t kMaxJoints = 24;
inline constexpr std::size_t kMaxDatagram = 1500;  // bytes
inline constexpr std::size_t kMaxIos = 10, kMaxTransformations = 5;
inline constexpr std::size_t kMaxName = 63;  // characters

enum class Protocol : std::uint8_t {
  kLwr,  // LWR 4+, FRI 1.0: packed structs
  kSunrise1_11,
  kSunrise1_14,
  kSunrise1_15,
  kSunrise1_16,
  kSunrise2_5,
  kSunrise2_7
};
inline constexpr std::array kProtocols{Protocol::kLwr,         Protocol::kSunrise1_11, Protocol::kSunrise1_14,
                                       Protocol::kSunrise1_15, Protocol::kSunrise1_16, Protocol::kSunrise2_5,
                                       Protocol::kSunrise2_7};
/// `lwr`, `sunrise-1.11`, `sunrise-1.14` …
const char* to_text(Protocol protocol);
/// Throws Error at `place` that lists the words.
Protocol protocol_of(const std::string& word, const std::string& place);

/// Throws Error if a robot with so many joints has no messages in this protocol: LWR has 7, the others 1 to kMaxJoints.
void check_joints(Protocol protocol, std::size_t joints, const std::string& place);

/// LWR: OFF is kIdle, MON is kMonitoringReady if the quality is OK or PERFECT and kMonitoringWait below, CMD is
/// kCommandingActive.
enum class SessionState : std::uint8_t { kIdle, kMonitoringWait, kMonitoringReady, kCommandingWait, kCommandingActive };
/// LWR: UNACCEPTABLE, BAD, OK, PERFECT.
enum class Quality : std::uint8_t { kPoor, kFair, kGood, kExcellent };
enum class SafetyState : std::uint8_t { kNormal, kStopLevel0, kStopLevel1, kStopLevel2 };
enum class OperationMode : std::uint8_t { kTest1, kTest2, kAutomatic };
enum class DriveState : std::uint8_t { kOff, kTransitioning, kActive };
enum class ControlMode : std::uint8_t { kPosition, kCartesianImpedance, kJointImpedance, kNone };
enum class ClientCommandMode : std::uint8_t { kNone, kPosition, kWrench, kTorque, kCartesianPose };
enum class OverlayType : std::uint8_t { kNone, kJoint, kCartesian };

inline constexpr bool is_commanding(SessionState s) {
  return s == SessionState::kCommandingWait || s == SessionState::kCommandingActive;
}
inline constexpr bool is_monitoring(SessionState s) {
  return s == SessionState::kMonitoringWait || s == SessionState::kMonitoringReady;
}

/// One value per joint; only the first `joints` of the message count.
using Joints = std::array<double, kMaxJoints>;

/// Text of at most 63 characters, without allocation.
class Name {
 public:
  /// False, and no change, if it is longer.
  bool assign(std::string_view text);
  std::string_view view() const { return {text_.data(), size_}; }
  friend bool operator==(const Name& a, const Name& b) { return a.view() == b.view(); }

 private:
  std::array<char, kMaxName> text_{};
  std::uint8_t size_ = 0;
};

/// At most N values, without allocation.
template <class Value, std::size_t N>
struct Few {
  std::array<Value, N> values{};
  std::uint32_t count = 0;

  std::span<const Value> all() const { return {values.data(), count}; }
  /// Null if it is full.
  Value* add() { return count < N ? &values[count++] : nullptr; }
};

/// A field-bus value that the client asks to read or to write, with its full name `Group.Name` (Sunrise from 1.14).
struct Io {
  enum class Type : std::uint8_t { kBoolean, kDigital, kAnalog };
  enum class Direction : std::uint8_t { kInput, kOutput };
  Name name;
  Type type = Type::kBoolean;
  Direction direction = Direction::kInput;
  std::uint64_t digital = 0;  // of kBoolean and kDigital
  double analog = 0;
  friend bool operator==(const Io&, const Io&) = default;
};

/// A frame that the robot's application sends to the client, or asks from it (Sunrise).
struct Transformation {
  Name name;
  Pose pose;                         // m; on the wire mm
  std::optional<std::int64_t> time;  // ns since 1970
  friend bool operator==(const Transformation&, const Transformation&) = default;
};

/// Sunrise 2.x: the redundancy of a pose; the strategy E1 gives the angle of the third axis.
struct Redundancy {
  std::int32_t strategy = 0;  // 0: E1; 4: none
  double value = 0;           // rad
  friend bool operator==(const Redundancy&, const Redundancy&) = default;
};

/// Variables of the robot's program (LWR): $FRI_TO_… in monitoring messages, $FRI_FRM_… in commands.
struct KrlVariables {
  std::array<float, 16> real{};
  std::array<std::int32_t, 16> integer{};
  std::uint16_t boolean = 0;  // bit i: element i + 1
  friend bool operator==(const KrlVariables&, const KrlVariables&) = default;
};

/// From the controller to the client. A quantity is valid if its bit is in `fields`.
struct Monitoring {
  enum Field : std::uint32_t {
    kMeasuredPosition = 1 << 0,
    kMeasuredTorque = 1 << 1,
    kCommandedPosition = 1 << 2,
    kCommandedTorque = 1 << 3,
    kExternalTorque = 1 << 4,
    kInterpolatorPosition = 1 << 5,
    kMeasuredPose = 1 << 6,
    kCommandedPose = 1 << 7,
    kInterpolatorPose = 1 << 8,
    kMeasuredRedundancy = 1 << 9,
    kInterpolatorRedundancy = 1 << 10,
    kExternalWrench = 1 << 11,
    kTime = 1 << 12,
    kSafetyState = 1 << 13,
    kOperationMode = 1 << 14,
    kControlMode = 1 << 15,
    kDriveStates = 1 << 16,
    kCommandMode = 1 << 17,
    kOverlay = 1 << 18,
    kTracking = 1 << 19,
    kDynamics = 1 << 20,  // LWR: everything from `krl` on
  };
  bool has(std::uint32_t field) const { return (fields & field) == field; }

  std::uint32_t fields = 0;
  std::uint32_t counter = 0;    // +1 per message; LWR: modulo 65536
  std::uint32_t reflected = 0;  // counter of the latest command
  std::uint32_t joints = 0;
  SessionState state = SessionState::kIdle;
  Quality quality = Quality::kPoor;
  double send_period = 0;                // s
  std::uint32_t receive_multiplier = 1;  // a command is due every so many messages
  std::int64_t time = 0;  // ns of the controller's clock; Sunrise: since 1970; LWR: its own, at 32 bits of a float
  SafetyState safety = SafetyState::kNormal;
  OperationMode operation = OperationMode::kTest1;
  ControlMode control = ControlMode::kPosition;
  std::array<DriveState, kMaxJoints> drives{};
  ClientCommandMode command_mode = ClientCommandMode::kNone;
  OverlayType overlay = OverlayType::kNone;
  double tracking_performance = 0;  // 0 to 1

  Joints q_measured{};      // rad
  Joints q_commanded{};     // rad, with what the client adds; LWR: cmdJntPos + cmdJntPosFriOffset
  Joints q_interpolator{};  // rad, the robot's own motion, without the client; LWR: cmdJntPos
  Joints tau_measured{};    // N.m
  Joints tau_commanded{};   // N.m
  Joints tau_external{};    // N.m, estimated
  Pose X_measured, X_commanded, X_interpolator;
  Redundancy redundancy_measured, redundancy_interpolator;
  Wrench F_external = Wrench::Zero();  // on the end-effector, estimated

  Few<Transformation, kMaxTransformations> transformations;  // Sunrise: requested from the client
  Few<Io, kMaxIos> ios;                                      // Sunrise: read for the client

  KrlVariables krl;                        // LWR, and all that follows
  double command_period = 0;               // s, at which commands are expected
  double safety_factor = 1;                // given to friStart: scales the limits
  double answer_rate = 0, miss_rate = 0;   // shares of answered and unanswered messages
  double latency = 0, jitter = 0;          // s, averages
  std::uint32_t misses = 0;                // messages without an answer so far
  std::uint16_t errors = 0, warnings = 0;  // bit i: drive i
  std::array<double, 7> temperature{};     // °C
  std::array<double, 42> jacobian{};       // 6 × 7, row-major, rows x, y, z, rotations about x, y, z
  std::array<double, 49> mass{};           // kg.m², 7 × 7
  std::array<double, 7> gravity{};         // N.m
};

/// From the client to the controller. A quantity is valid if its bit is in `fields`.
struct Command {
  enum Field : std::uint32_t {
    kPosition = 1 << 0,
    kTorque = 1 << 1,
    kWrench = 1 << 2,
    kPose = 1 << 3,
    kRedundancy = 1 << 4,          // Sunrise 2.x
    kJointStiffness = 1 << 5,      // LWR
    kJointDamping = 1 << 6,        // LWR
    kCartesianStiffness = 1 << 7,  // LWR
    kCartesianDamping = 1 << 8,    // LWR
  };
  bool has(std::uint32_t field) const { return (fields & field) == field; }

  std::uint32_t fields = 0;
  std::uint32_t counter = 0;    // +1 per command; LWR: modulo 65536
  std::uint32_t reflected = 0;  // counter of the monitoring message that it answers
  std::uint32_t joints = 0;
  Joints q{};                 // rad
  Joints tau{};               // N.m, added to the torques of the control law
  Wrench F = Wrench::Zero();  // added at the end-effector
  Pose X;
  Redundancy redundancy;
  Joints joint_stiffness{};                                  // N.m/rad
  Joints joint_damping{};                                    // 1, 0 to 1
  Wrench cartesian_stiffness = Wrench::Zero();               // N/m, N.m/rad
  Wrench cartesian_damping = Wrench::Zero();                 // 1, 0 to 1
  Few<Transformation, kMaxTransformations> transformations;  // Sunrise
  Few<Io, kMaxIos> ios;                                      // Sunrise: to be written
  KrlVariables krl;                                          // LWR
};

/// Why a datagram was not accepted.
enum class Fault : std::uint8_t {
  kNone,
  kSize,        // not the size of the protocol's datagrams, or of what its header gives
  kIdentifier,  // not the message identifier of the protocol
  kTruncated,   // ends within a field
  kWireType,    // a field of another type than its number has, or an invalid key
  kCount,       // another number of joints or elements, or more than the protocol allows
  kMissing,     // without a required field, or without what a session needs
  kValue,       // an enumeration or a period out of its range
  kChecksum,    // Sunrise 2.7: wrong checksum
  kNotFinite,   // an infinite, undefined or huge number where a session needs one
  kStranger     // from another sender
};
inline constexpr std::size_t kFaults = static_cast<std::size_t>(Fault::kStranger) + 1;
const char* to_text(Fault fault);

/// Writes a datagram. Returns its size; 0 if the message is not possible: `bytes` or kMaxDatagram is too small, a number of
/// joints that the protocol does not have. Quantities that the protocol does not have are left out.
std::size_t encode(Protocol protocol, const Monitoring& message, std::span<std::uint8_t> bytes);
std::size_t encode(Protocol protocol, const Command& message, std::span<std::uint8_t> bytes);

/// Reads a datagram of a robot with `joints` joints. Unless the result is kNone, the content of `message` is unspecified.
Fault decode(Protocol protocol, std::span<const std::uint8_t> bytes, std::size_t joints, Monitoring& message);
Fault decode(Protocol protocol, std::span<const std::uint8_t> bytes, std::size_t joints, Command& message);

}  // namespace cotwin::fri
