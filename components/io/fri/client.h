#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "components/io/fri/fri.h"
#include "components/io/fri/statistics.h"
#include "models/foundation/net/endpoint.h"

namespace cotwin::fri {

inline constexpr double kShortestPeriod = 0.5e-3, kLongestPeriod = 1;  // s
/// Larger positions, torques and forces (rad, m, N.m, N) are taken as damaged: differences and products of them stay finite.
inline constexpr double kLargestNumber = 1e9;
inline bool is_usable(double x) { return -kLargestNumber <= x && x <= kLargestNumber; }

struct ClientSettings {
  Protocol protocol = Protocol::kLwr;
  std::size_t joints = 7;
  net::Endpoint controller;  // whose messages are accepted. Default: the first sender, until it is silent for `timeout`
  std::int64_t timeout = 100'000'000;  // ns without a message, or twenty send periods if that is longer: not connected
  std::vector<double> speed_limit;     // rad/s: commanded positions move no faster; empty: no limit
};

/// What the client finds out about both directions.
struct ClientStatistics {
  explicit ClientStatistics(unsigned bits) : monitoring(bits) {}

  SequenceTracker monitoring;  // of the controller's messages
  FaultCounts faults;
  std::uint64_t answers = 0;
  std::uint64_t unreflected = 0;  // answers that no message reflected before a later answer: lost, or overtaken by it
  Moments round_trip;             // s, from an answer to the first message that reflects it
  Moments interval;               // s, between messages that follow one another
  double jitter = 0;          // s, mean deviation of the interval from the send period over about 16 messages (RFC 3550, 6.4.1)
  TimeHistogram answer_time;  // from the arrival of a message to its answer
  std::uint64_t sessions =
      0;  // begun: with the first message, after a loss of the connection, and when the controller has begun anew
  std::uint64_t restarts = 0;  // of the controller within `timeout`: another sender, or counters or time stamps that jump
};

/// Why a message that was decoded is not usable for a session of a client; kNone if it is:
///   kValue      send period or command period outside kShortestPeriod to kLongestPeriod
///   kMissing    no measured position; in a commanding state nothing that a command could begin at
///   kNotFinite  a position, torque, wrench or pose that is not finite or larger than kLargestNumber, a torque above 1e4 N.m
/// KRL variables and I/O values are not examined: the robot's program may give them any value.
Fault usability(const Monitoring& message);

/// The PC's side of a session: takes the controller's messages and makes the answers.
///   monitoring         mirrors the commanded position, so that the change to commanding has no step; 2.x sends no values
///   COMMANDING_WAIT    sends the interpolator's position
///   COMMANDING_ACTIVE  (LWR: CMD) sends the wanted values that the command mode asks for
/// LWR: the set of commanded quantities (`fields`) is that of the last answer before CMD, because it must not change in CMD.
/// Every message that is not a duplicate is answered, unless the receive multiplier says otherwise or the state is IDLE.
/// A message with a counter or a time stamp that is earlier or later than it can be waits for the next one. If that does not go on from there, it is lost;
/// otherwise the controller has begun anew, or messages were.
/// A new session (ClientStatistics::sessions) begins at the position that the robot commands, else at the measured one.
class Client {
 public:
  enum class Reception : std::uint8_t { kRefused, kNoAnswerDue, kAnswerDue };

  /// Throws Error at `place`.
  Client(const ClientSettings& settings, const std::string& place);

  /// A datagram that arrived at `arrival` (ns). After kAnswerDue call answer() before the next receive().
  /// `host`: when it arrived on a clock that does not stand still while the scenario waits, ns; by it a controller may have been
  /// silent, and another one is heard.
  Reception receive(std::span<const std::uint8_t> bytes, const net::Endpoint& from, std::int64_t arrival, std::int64_t host);
  Reception receive(std::span<const std::uint8_t> bytes, const net::Endpoint& from, std::int64_t arrival) {
    return receive(bytes, from, arrival, arrival);
  }
  /// The answer to the message received last, to be sent to controller(). `wanted`: fields, quantities, KRL variables, I/O values
  /// and transformations; its counters are ignored. Quantities that are not finite are replaced by those sent before.
  std::span<const std::uint8_t> answer(const Command& wanted, std::int64_t now);

  /// The newest message. A caller may replace values in it that it does not believe before it answers.
  const Monitoring& monitoring() const { return messages_[newest_]; }
  Monitoring& monitoring() { return messages_[newest_]; }
  /// The answer sent last.
  const Command& sent() const { return sent_; }
  bool connected(std::int64_t now) const;
  /// ns without a message for which the connection stands.
  std::int64_t longest_silence() const;
  /// Quantities (Command::fields) that an answer to the newest message in a commanding state can have.
  std::uint32_t taken() const;
  /// IDLE if not connected.
  SessionState state(std::int64_t now) const { return connected(now) ? monitoring().state : SessionState::kIdle; }
  /// Whether wanted values reach the robot: the state of the newest message.
  bool commanding() const { return started_ && monitoring().state == SessionState::kCommandingActive; }
  net::Endpoint controller() const { return controller_; }
  /// Why the last datagram was not accepted; kNone if it was, or if it was a duplicate or far too late.
  Fault last_fault() const { return last_fault_; }
  const ClientStatistics& statistics() const { return statistics_; }

 private:
  Fault fault_of(std::span<const std::uint8_t> bytes, bool stranger);
  bool continues(const Monitoring& message, std::int64_t messages, std::int64_t elapsed) const;
  bool waits(const Monitoring& message, std::int64_t position, std::int64_t arrival, std::int64_t elapsed);
  void begin_session();
  void note_interval(const Monitoring& message, std::int64_t arrival);
  void note_reflected(std::uint32_t reflected, std::int64_t arrival);
  void compose_lwr(const Command& wanted);
  void compose_sunrise(const Command& wanted);
  void set_quantities(const Command& wanted, std::uint32_t fields);
  void limit_speed(const Joints& before);

  ClientSettings settings_;
  ClientStatistics statistics_;
  std::array<Monitoring, 2> messages_;  // the newest, and room for the next
  std::size_t newest_ = 0;
  Command sent_;
  std::array<std::uint8_t, kMaxDatagram> datagram_{};
  net::Endpoint controller_;
  Fault last_fault_ = Fault::kNone;
  bool started_ = false;
  std::int64_t latest_ = 0, latest_host_ = 0;  // ns, arrival of the newest message
  std::int64_t newest_position_ = 0;           // of the newest message
  std::int64_t arrival_ = 0, position_ = 0;    // of the message to be answered
  std::uint32_t answering_ = 0;                // its counter
  std::int64_t answered_ = 0;                  // position of the newest message that was answered
  std::uint32_t since_answer_ = 0;             // messages, for the receive multiplier
  std::uint32_t counter_ = 0;                  // of the next answer, modulo 2³²
  std::uint32_t reflected_ = 0;                // newest answer that was reflected
  bool has_reflected_ = false;
  std::array<std::int64_t, 256> sent_times_{};   // ns, of the latest answers
  std::int64_t waiting_ = 0, waiting_time_ = 0;  // position and time stamp (ns) of the last message if it waits; 0: it does not
  double late_ = 0;                              // ns by which the newest message was later than the earliest ones
};

}  // namespace cotwin::fri
