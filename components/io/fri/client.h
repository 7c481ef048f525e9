#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "components/io/fri/fri.h"
#include "components/io/fri/statistics.h"
#include "models/net/endpoint.h"

namespace cotwin::fri {

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
};

/// The PC's side of a session: takes the controller's messages and makes the answers.
///   monitoring         mirrors the commanded position, so that the change to commanding has no step; 2.x sends no values
///   COMMANDING_WAIT    sends the interpolator's position
///   COMMANDING_ACTIVE  (LWR: CMD) sends the wanted values that the command mode asks for
/// LWR: the set of commanded quantities (`fields`) is that of the last answer before CMD, because it must not change in CMD.
/// Every message that is not a duplicate is answered, unless the receive multiplier says otherwise or the state is IDLE.
class Client {
 public:
  enum class Reception : std::uint8_t { kRefused, kNoAnswerDue, kAnswerDue };

  /// Throws Error at `place`.
  Client(const ClientSettings& settings, const std::string& place);

  /// A datagram that arrived at `arrival` (ns). After kAnswerDue call answer() before the next receive().
  Reception receive(std::span<const std::uint8_t> bytes, const net::Endpoint& from, std::int64_t arrival);
  /// The answer to the message received last, to be sent to controller(). `wanted`: fields, quantities, KRL variables, I/O values
  /// and transformations; its counters are ignored. Quantities that are not finite are replaced by those sent before.
  std::span<const std::uint8_t> answer(const Command& wanted, std::int64_t now);

  /// The newest message.
  const Monitoring& monitoring() const { return messages_[newest_]; }
  /// The answer sent last.
  const Command& sent() const { return sent_; }
  bool connected(std::int64_t now) const;
  /// IDLE if not connected.
  SessionState state(std::int64_t now) const { return connected(now) ? monitoring().state : SessionState::kIdle; }
  /// Whether wanted values reach the robot: the state of the newest message.
  bool commanding() const { return started_ && monitoring().state == SessionState::kCommandingActive; }
  net::Endpoint controller() const { return controller_; }
  const ClientStatistics& statistics() const { return statistics_; }

 private:
  bool is_stranger(const net::Endpoint& from, std::int64_t arrival) const;
  bool is_finite(const Monitoring& message) const;
  void note_interval(const Monitoring& message, std::int64_t arrival);
  void note_reflected(std::uint32_t reflected, std::int64_t arrival);
  void compose_lwr(const Command& wanted);
  void compose_sunrise(const Command& wanted);
  void take_quantities(const Command& wanted, std::uint32_t fields);
  void limit_speed(const Joints& before);

  ClientSettings settings_;
  ClientStatistics statistics_;
  std::array<Monitoring, 2> messages_;  // the newest, and room for the next
  std::size_t newest_ = 0;
  Command sent_;
  std::array<std::uint8_t, kMaxDatagram> datagram_{};
  net::Endpoint controller_;
  bool started_ = false;
  std::int64_t latest_ = 0;                  // ns, arrival of the newest message
  std::int64_t newest_position_ = 0;         // of the newest message
  std::int64_t arrival_ = 0, position_ = 0;  // of the message to be answered
  std::uint32_t answering_ = 0;              // its counter
  std::int64_t answered_ = 0;                // position of the newest message that was answered
  std::uint32_t since_answer_ = 0;           // messages, for the receive multiplier
  std::uint32_t counter_ = 0;                // of the next answer, modulo 2³²
  std::uint32_t reflected_ = 0;              // newest answer that was reflected
  bool has_reflected_ = false;
  std::array<std::int64_t, 256> sent_times_{};  // ns, of the latest answers
};

}  // namespace cotwin::fri
